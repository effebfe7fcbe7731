"""Reports: self-contained, the same bytes for the same content, nothing that escapes its place."""

import base64
import colorsys
import dataclasses
import re
import sys
from html.parser import HTMLParser
from io import BytesIO
from xml.etree import ElementTree

import av
import mujoco
import numba
import numpy as np
import pytest
import scipy
from PIL import Image

from experiments.flight.summary import true_bearing
from experiments.pages import figures, flight_figures, page, style
from experiments.pages.figures import Line
from experiments.pages.flight_figures import without_wraps
from experiments.pages.flight_report import flight_report
from experiments.pages.page import Cell, Code, Figures, Film, Notice, Page, Section, Table, Text, number, words
from experiments.pages.style import ESTIMATE, FOLLOWER, FRONT, LEADER, MIDDLE, SERIES, TRANSMITTERS
from sim.film import panels as filmed
from sim.film import scene
from sim.flight import Outcome
from tests.synthetic import make_flight

VOID = {"meta", "link", "br", "img", "hr", "input", "source"}


class Checker(HTMLParser):
    """Notes unbalanced tags, ids and addresses."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.addresses, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if "id" in values:
            self.ids.append(values["id"])
        self.addresses += [values[name] for name in ("src", "href") if name in values]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def checked(html):
    checker = Checker()
    checker.feed(html)
    assert not checker.open
    assert len(set(checker.ids)) == len(checker.ids)
    targets = {a[1:] for a in checker.addresses if a.startswith("#")}
    assert targets <= set(checker.ids)
    assert not [a for a in checker.addresses if re.match(r"(https?:)?//", a)]
    return checker


def drawing(name="one"):
    x = np.linspace(0, 100, 5000)
    return figures.svg(
        figures.panel([Line(x=x, y=np.sin(x))], x_label="time [s]", y_label="y [m]", title="T2 <&>"), name, 'a "label"'
    )


def sample_page(**changes):
    blocks = [
        Text(text="E_P with `code <b>` and <i>text</i>"),
        Code(text="a < b"),
        Notice(text="it failed", tone="failure"),
        Table(heads=["name", "E_P [m]"], rows=[[words("T2"), number(1.234)], [words("T3"), number(None)]]),
        Figures(panels=[drawing("one"), drawing("two")], caption="Both", legend=[("--c1", "y")]),
    ]
    content = {"title": "Title & more", "summary": "s", "facts": [("seed", "1")], "sections": [
        Section(title="A section", blocks=blocks)
    ]}  # fmt: skip
    return Page(**(content | changes))


def test_a_page_is_whole_escaped_and_always_the_same():
    html = page.render(sample_page())
    assert html == page.render(sample_page())
    checker = checked(html)
    assert "<i>text</i>" not in html
    assert "&lt;i&gt;text&lt;/i&gt;" in html
    assert "Title & more" in checker.text
    assert "prefers-color-scheme: dark" in html


def test_a_page_says_what_it_was_made_with():
    """The packages' own words are the judge."""
    [footer] = re.findall(r"<footer>(.*?)</footer>", page.render(sample_page()))
    packages = {"MuJoCo": mujoco, "NumPy": np, "SciPy": scipy, "Numba": numba}
    expected = [f"Python {sys.version.split()[0]}", *(f"{name} {p.__version__}" for name, p in packages.items())]
    assert footer == f"Made with {', '.join(expected)}."


def test_figures_are_well_formed_and_take_their_colours_from_the_page():
    text = drawing()
    root = ElementTree.fromstring(text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1))
    assert root.get("aria-label") == 'a "label"'
    assert not re.search(r"#0101", text)
    used = set(re.findall(r"var\((--[a-z0-9]+),", text))
    assert {"--ink", "--grid", "--frame", SERIES[0].variable} <= used
    style = page.render(sample_page()).partition("<style>")[2].partition("</style>")[0]
    assert all(re.search(rf"{variable}:", style) for variable in used)
    assert all(i.startswith("one-") for i in re.findall(r'id="([^"]*)"', text))


def test_every_colour_has_a_light_and_a_dark_value():
    sheet = page.render(sample_page()).partition("<style>")[2].partition("</style>")[0]
    for colour in style.COLOURS:
        assert re.findall(rf"{colour.variable}: (#[0-9a-f]+)", sheet) == [colour.light, colour.dark]


def test_decimation_keeps_ends_and_extremes():
    x = np.arange(10_000.0)
    y = np.random.default_rng(3).normal(size=x.size)
    y[4321], y[8765] = 50.0, -60.0
    kept_x, kept_y = figures.decimate(x, y, 200)
    assert kept_x.size <= 202
    assert (kept_x[0], kept_x[-1]) == (0.0, 9999.0)
    assert (kept_y.max(), kept_y.min()) == (50.0, -60.0)
    assert np.all(np.diff(kept_x) > 0)
    np.testing.assert_array_equal(kept_y, y[kept_x.astype(int)])


def test_decimation_keeps_gaps():
    x, y = np.arange(1000.0), np.ones(1000)
    y[300:700] = np.nan
    kept_x, kept_y = figures.decimate(x, y, 100)
    assert np.isnan(kept_y[(kept_x > 320) & (kept_x < 680)]).all()
    assert np.isfinite(kept_y[(kept_x < 300) | (kept_x >= 720)]).all()


def test_a_wrap_leaves_a_gap():
    broken = without_wraps(np.array([350.0, 359.0, 1.0, 10.0]))
    assert np.isnan(broken).tolist() == [False, False, True, False]


def drawn(axes):
    """Data of the lines of axes."""
    return [np.column_stack(line.get_data()) for line in axes.lines]


def test_errors_stand_above_one_another_each_on_its_own_axis():
    """Metres, degrees and the bearing, with an error as long as 3, 4, 5 and a covariance of known axes."""
    flight = make_flight(20.0)
    (found,) = flight.estimates
    n = len(found.state)
    state = found.state.copy()
    state[:, :2] = flight.hydrophone(0)[:, :2] + [3.0, 4.0]
    covariance = np.zeros((n, 4, 4))
    # variances 9 and 4 along axes turned by 30°
    turn = np.array([[np.cos(np.pi / 6), -np.sin(np.pi / 6)], [np.sin(np.pi / 6), np.cos(np.pi / 6)]])
    covariance[:, :2, :2] = turn @ np.diag([9.0, 4.0]) @ turn.T
    known = dataclasses.replace(flight, estimates=(dataclasses.replace(found, state=state, covariance=covariance),))
    figure = flight_figures.error_stack(known, 0, (np.full(n, 5.0), np.full(n, np.pi / 18)))
    bearing, bearing_error, position = figure.axes
    own, error = drawn(position)
    np.testing.assert_allclose(own[:, 1], 6.0)
    np.testing.assert_allclose(error[:, 1], 5.0)
    np.testing.assert_allclose(drawn(bearing_error)[0][:, 1], 10.0)
    assert {axes.get_ylabel() for axes in figure.axes} == {"E_P, 2σ [m]", "E_B [°]", "B [°]"}
    assert bearing.get_ylim() == (0, 360)
    (scattered, origin) = drawn(flight_figures.difference(known, 0).axes[0])
    np.testing.assert_allclose(scattered, np.tile([3.0, 4.0], (len(scattered), 1)))
    np.testing.assert_allclose(origin, [[0.0, 0.0]])


def test_the_bearing_is_that_from_the_leaders_bow_clockwise():
    """The synthetic leader turns left on a circle, and its follower trails it on a wider one: abaft to starboard."""
    flight = make_flight(20.0)
    truth, k = flight.trajectory, 150
    step = flight.step_index()[k]
    forward = truth.velocity[step, 0, :2] / np.hypot(*truth.velocity[step, 0, :2])
    away = flight.hydrophone(0)[k, :2] - truth.position[step, 0, :2]
    ahead, starboard = away @ forward, forward[1] * away[0] - forward[0] * away[1]
    bearing = true_bearing(flight, 0)[k]
    assert np.pi / 2 < bearing < np.pi
    assert np.cos(bearing) == pytest.approx(ahead / np.hypot(*away), abs=1e-6)
    assert np.sin(bearing) == pytest.approx(starboard / np.hypot(*away), abs=1e-6)


@pytest.mark.parametrize(("variant", "transmitters"), [("laisn-2", 2), ("laisn-3-2", 3)])
def test_a_transmitter_that_is_not_used_is_not_drawn(tmp_path, variant, transmitters):
    flight = make_flight(20.0)
    navigation = flight.scenario.navigation.model_copy(update={"variant": variant})
    told = dataclasses.replace(flight, scenario=flight.scenario.model_copy(update={"navigation": navigation}))
    lines = flight_figures.ranges(told, 0).axes[0].lines
    assert {line.get_color() for line in lines} == {colour.placeholder for colour in TRANSMITTERS[:transmitters]}
    html = flight_page(tmp_path, told)
    assert ("from the middle transmitter" in html) == (transmitters == 3)


@pytest.mark.parametrize(
    ("colour", "filmed"),
    [
        (LEADER, filmed.LEADER),
        (FOLLOWER, filmed.TRUTH),
        (ESTIMATE, scene.ESTIMATE),
        (FRONT, scene.TRANSMITTER_COLOURS[1]),
        (MIDDLE, scene.TRANSMITTER_COLOURS[2]),
    ],
)
def test_pages_have_the_hues_of_the_film(colour, filmed):
    hue, _, _ = colorsys.rgb_to_hsv(*filmed)
    for shade in (colour.light, colour.dark):
        rgb = [int(shade[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        assert colorsys.rgb_to_hsv(*rgb)[0] == pytest.approx(hue, abs=0.012)


def contrast(a, b):
    """Contrast of two colours, as WCAG 2.2 defines it."""

    def luminance(colour):
        channels = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("colour", [*style.SERIES, LEADER, FOLLOWER, ESTIMATE, *TRANSMITTERS])
def test_lines_stand_out_from_light_and_dark_paper(colour):
    """WCAG 2.2, success criterion 1.4.11: at least 3 to 1."""
    assert contrast(colour.light, "#ffffff") > 3
    assert contrast(colour.dark, "#12181e") > 3


def test_ratios_are_coloured_evenly_either_way():
    assert [page.ratio_tone(r) for r in (1.0, 1.19, 1.3, 1.7, 3.0)] == [
        "ratio-even", "ratio-even", "ratio-high1", "ratio-high2", "ratio-high3",
    ]  # fmt: skip
    assert [page.ratio_tone(1 / r) for r in (1.3, 1.7, 3.0)] == ["ratio-low1", "ratio-low2", "ratio-low3"]
    assert page.ratio_tone(np.nan) == ""


def test_rows_must_fit_their_table():
    with pytest.raises(ValueError, match="a row of 1 cells in a table of 2 columns"):
        Table(heads=["a", "b"], rows=[[Cell(text="x")]])


@pytest.mark.parametrize(
    ("value", "text"), [(-0.004, "0.00"), (-0.006, "−0.01"), (-3, "−3"), (0, "0"), (1.005, "1.00"), (None, "–")]
)
def test_numbers_in_tables_have_a_minus_only_where_one_can_see_why(value, text):
    cell = page.number(value)
    assert cell.text == text
    assert cell.sort == (np.inf if value is None else value)


def test_small_films_are_embedded_and_large_ones_linked(tmp_path):
    small, large = tmp_path / "small.mp4", tmp_path / "large.mp4"
    small.write_bytes(b"film")
    large.write_bytes(bytes(page.EMBEDDED_FILM_BYTES + 1))
    assert Film(path=small).source == "data:video/mp4;base64,ZmlsbQ=="
    assert Film(path=large).source == "large.mp4"


def test_a_film_has_a_picture_of_its_middle_before_it_plays(tmp_path):
    """Of nine frames that brighten evenly, with a key frame every third, the fourth is shown."""
    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as target:
        stream = target.add_stream("libx264", rate=10, width=64, height=48, pix_fmt="yuv420p")
        stream.options = {"g": "3", "bf": "0", "sc_threshold": "0"}
        for k in range(9):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 20 * k + 40, np.uint8), format="rgb24")
            target.mux(stream.encode(frame))
        target.mux(stream.encode(None))
    kind, _, data = Film(path=path).poster.partition(",")
    assert kind == "data:image/jpeg;base64"
    picture = np.asarray(Image.open(BytesIO(base64.b64decode(data))))
    assert picture.shape == (48, 64, 3)
    assert abs(picture.mean() - 100) < 8


def test_numbers_stand_to_the_right_under_their_heads():
    html = page.render(sample_page())
    assert '<th scope="col"><button type="button">name' in html
    assert '<th scope="col" class="n"><button type="button"><i>E</i><sub>P</sub> [m]' in html


def test_panels_alike_make_a_grid_and_others_share_a_row():
    one, wide = drawing(), figures.svg(figures.panel([], x_label="x", y_label="y", width=8.0), "wide")
    assert Figures(panels=[one] * 3).layout == "grid"
    assert Figures(panels=[one] * 2).layout == "row"
    assert Figures(panels=[one, one, wide]).layout == "row"
    assert 'style="--w: 576"' in wide


def test_symbols_in_drawings_carry_their_index_below_the_line():
    text = figures.svg(figures.panel([], x_label="D_front, UPPER_CASE", y_label="E_P, 2σ [m]"), "one")
    assert re.search(r'>E<tspan dy="2" font-size="70%">P</tspan><tspan dy="-2">[^<]*</tspan>, 2σ', text)
    assert re.search(r'>D<tspan dy="2" font-size="70%">front</tspan>', text)
    assert "UPPER_CASE" in text
    ElementTree.fromstring(text)


def flight_page(tmp_path, flight, name="report.html"):
    errors = []
    for i, found in enumerate(flight.estimates):
        away = found.state[:, :2] - flight.hydrophone(i)[:, :2]
        errors.append((np.hypot(*away.T), np.abs(away[:, 0]) / 20))
    figures_of = {"e_p_max_m": 1.0, "e_p_mean_m": 0.5, "e_p_std_m": 0.1, "e_b_max_deg": 2.0, "e_b_mean_deg": 1.0,
                  "e_b_std_deg": 0.3, "fixes": {"two_points": 20, "gated": 0}}  # fmt: skip
    summary = {"followers": dict.fromkeys(flight.trajectory.names[1:], figures_of), "versions": {"laisn-sim": "0.1.0"}}
    flight_report(flight, errors, summary, tmp_path / name, None)
    return (tmp_path / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("followers", [1, 3])
def test_the_report_of_a_flight(tmp_path, followers):
    flight = make_flight(60.0, followers)
    html = flight_page(tmp_path, flight)
    checker = checked(html)
    text = " ".join(checker.text)
    assert "laisn fly scenario.toml" in text
    assert 'name = "synthetic"' in text
    assert all(name in text for name in flight.trajectory.names)
    assert len(html) < 5_000_000
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    if followers > 1:
        assert html == flight_page(tmp_path, flight, "again.html")


def test_a_flight_that_failed_says_so(tmp_path):
    flight = make_flight(30.0)
    broken = type(flight)(**{**vars(flight), "outcome": Outcome.DIVERGED})
    html = flight_page(tmp_path, broken)
    assert 'class="notice failure"' in html
    assert Outcome.DIVERGED.value in html
