"""The report of a flight: its figures, and the page as a whole."""

import colorsys
import dataclasses
import re

import numpy as np
import pytest

from reports import figures, flight_figures
from reports.flight_figures import without_wraps
from reports.flight_report import flight_report
from reports.style import ESTIMATE, FOLLOWER, FRONT, LEADER, MIDDLE, TRANSMITTERS
from reports.summary import true_bearing
from sim.film import film_data as film
from sim.flight import Termination
from tests import synthetic
from tests.reports.markup import require_well_formed
from tests.synthetic import make_flight


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
    with_gap = without_wraps(np.array([350.0, 359.0, 1.0, 10.0]))
    assert np.isnan(with_gap).tolist() == [False, False, True, False]


def test_errors_stand_above_one_another_each_on_its_own_axis():
    """Metres, degrees and the bearing, with an error as long as 3, 4, 5 and a covariance of
    known axes.
    """
    flight = make_flight(20.0)
    (estimates,) = flight.estimates
    n = len(estimates.state)
    state = estimates.state.copy()
    state[:, :2] = flight.hydrophone(0)[:, :2] + [3.0, 4.0]
    covariance = np.zeros((n, 4, 4))
    # variances 9 and 4 along axes turned by 30°
    rotation = np.array(
        [[np.cos(np.pi / 6), -np.sin(np.pi / 6)], [np.sin(np.pi / 6), np.cos(np.pi / 6)]]
    )
    covariance[:, :2, :2] = rotation @ np.diag([9.0, 4.0]) @ rotation.T
    changed = dataclasses.replace(
        flight, estimates=(dataclasses.replace(estimates, state=state, covariance=covariance),)
    )
    errors = (np.full(n, 5.0), np.full(n, np.pi / 18))
    position, bearing_error, bearing = flight_figures.error_parts(
        changed, 0, errors, np.full(n, 0.5)
    )
    assert {
        line.name: set(np.round(line.y, 9)) for line in (*position.lines, *bearing_error.lines)
    } == {
        "2σ by the filter": {6.0},
        "RMS by the filter": {round(13**0.5, 9)},
        "Cramér–Rao bound": {0.5},
        "E_P": {5.0},
        "E_B": {10.0},
    }
    assert [part.y_label for part in (position, bearing_error, bearing)] == [
        "E_P [m]",
        "E_B [°]",
        "B [°]",
    ]
    assert bearing.y_limits == (0, 360)
    scattered, origin = flight_figures.difference(changed, 0).parts[0].lines
    assert (set(np.round(scattered.x, 9)), set(np.round(scattered.y, 9))) == ({3.0}, {4.0})
    assert (origin.x.tolist(), origin.y.tolist()) == ([0.0], [0.0])


def test_the_bearing_is_that_from_the_leaders_bow_clockwise():
    """The synthetic leader turns left on a circle, and its follower trails it on a wider one:
    abaft to starboard.
    """
    flight = make_flight(20.0)
    truth, k = flight.trajectory, 150
    step = flight.step_index()[k]
    forward = truth.velocity[step, 0, :2] / np.hypot(*truth.velocity[step, 0, :2])
    from_leader = flight.hydrophone(0)[k, :2] - truth.position[step, 0, :2]
    ahead, starboard = (
        from_leader @ forward,
        forward[1] * from_leader[0] - forward[0] * from_leader[1],
    )
    bearing = true_bearing(flight, 0)[k]
    assert np.pi / 2 < bearing < np.pi
    assert np.cos(bearing) == pytest.approx(ahead / np.hypot(*from_leader), abs=1e-6)
    assert np.sin(bearing) == pytest.approx(starboard / np.hypot(*from_leader), abs=1e-6)


@pytest.mark.parametrize(("variant", "transmitters"), [("laisn-2", 2), ("laisn-3-2", 3)])
def test_a_transmitter_that_is_not_used_is_not_drawn(tmp_path, variant, transmitters):
    flight = make_flight(20.0)
    navigation = flight.scenario.navigation.model_copy(update={"variant": variant})
    changed = dataclasses.replace(
        flight, scenario=flight.scenario.model_copy(update={"navigation": navigation})
    )
    lines = flight_figures.ranges_part(changed, 0).lines
    assert {line.colour for line in lines} == set(TRANSMITTERS[:transmitters])
    html = flight_page(tmp_path, changed)
    assert ("from the middle transmitter" in html) == (transmitters == 3)


@pytest.mark.parametrize(
    ("colour", "filmed"),
    [
        (LEADER, film.LEADER),
        (FOLLOWER, film.TRUTH),
        (ESTIMATE, film.ESTIMATE),
        (FRONT, film.TRANSMITTER_COLOURS[1]),
        (MIDDLE, film.TRANSMITTER_COLOURS[2]),
    ],
)
def test_pages_have_the_hues_of_the_film(colour, filmed):
    hue, _, _ = colorsys.rgb_to_hsv(*filmed)
    for shade in (colour.light, colour.dark):
        rgb = [int(shade[i : i + 2], 16) / 255 for i in (1, 3, 5)]
        assert colorsys.rgb_to_hsv(*rgb)[0] == pytest.approx(hue, abs=0.012)


def flight_page(tmp_path, flight, name="report.html"):
    """HTML of a flight's report; the figures of its summary are stand-ins."""
    errors = []
    for i, estimates in enumerate(flight.estimates):
        error = estimates.state[:, :2] - flight.hydrophone(i)[:, :2]
        errors.append((np.hypot(*error.T), np.abs(error[:, 0]) / 20))
    figures_of_follower = {
        "e_p_max_m": 1.0,
        "e_p_mean_m": 0.5,
        "e_p_std_m": 0.1,
        "e_b_max_deg": 2.0,
        "e_b_mean_deg": 1.0,
        "e_b_std_deg": 0.3,
        "fixes": {"two_points": 20, "gated": 0},
    }
    summary = {
        "followers": dict.fromkeys(flight.trajectory.names[1:], figures_of_follower),
        "versions": {"laisn-sim": "0.1.0"},
    }
    flight_report(flight, errors, summary, tmp_path / name, None)
    return (tmp_path / name).read_text(encoding="utf-8")


@pytest.mark.parametrize("followers", [1, 3])
def test_the_report_of_a_flight_has_its_parts_in_order(tmp_path, followers):
    flight = make_flight(60.0, followers)
    html = flight_page(tmp_path, flight)
    checker = require_well_formed(html)
    text = " ".join(checker.text)
    assert "laisn fly scenario.toml" in text
    assert f"{flight.scenario.navigation.variant.upper()} on 2 transmitters" in text
    # the first screen has the answer; where it comes from stands at the end
    positions = [
        html.index(words)
        for words in (
            "mean position error is" if followers == 1 else "lie between",
            "outside 2σ",
            "Seed, run",
        )
    ]
    assert positions == sorted(positions)
    assert positions[1] < html.index("<h2>Details") < html.index("<h2>Provenance") < positions[2]
    assert 'name = "synthetic"' in text
    assert all(name in text for name in flight.trajectory.names)
    assert len(html.encode()) < 6_000_000
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    if followers == 1:
        assert html == flight_page(tmp_path, flight, "again.html")


def test_relative_errors_stand_under_their_lengths(tmp_path):
    flight = make_flight(40.0, 2)
    names = flight.trajectory.names[1:]
    errors = [(np.ones(400), np.zeros(400)) for _ in names]
    rows = [{"length_m": 10.0, "rms_m": 0.271}, {"length_m": 20.0, "rms_m": 0.353}]
    # the second follower's path is too short for the second length
    followers = dict(zip(names, ({"relative_errors": rows[:k]} for k in (2, 1)), strict=True))
    summary = {"followers": followers, "versions": {}}
    flight_report(flight, errors, summary, tmp_path / "report.html", None)
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    table = html[html.index("RMS of the relative error over") :]
    text = text_without_tags(table[: table.index("</table>")])
    assert [word for word in text.split() if word != "m"] == [
        *["RMS", "of", "the", "relative", "error", "over", "follower", "10", "20"],
        *("follower1", "0.27", "0.35", "follower2", "0.27", "–"),
    ]


def text_without_tags(html):
    return re.sub(r"<[^>]*>", " ", html)


def test_a_flight_that_failed_has_notices(tmp_path, monkeypatch):
    flight = make_flight(30.0)
    monkeypatch.setattr("reports.flight_report.mirror_locked_steps", lambda *_: np.arange(300) < 75)
    diverged = type(flight)(**{**vars(flight), "outcome": Termination.DIVERGED})
    html = flight_page(tmp_path, diverged)
    assert "follower: the estimate was more than 5 m off, at the mirror image of the truth" in html
    assert "for 25.0 % of the mission (mirror lock)." in html
    assert 'class="notice failure"' in html
    assert Termination.DIVERGED.value in html


def test_a_flight_ended_by_contact_reports_the_pair(tmp_path):
    """Hulls of two synthetic followers are put into one place for the last instants."""
    flight = make_flight(30.0, 2)
    position = flight.trajectory.position.copy()
    position[250:, 2] = position[250:, 1]
    ended_by_contact = dataclasses.replace(
        flight,
        outcome=Termination.CONTACT,
        trajectory=synthetic.moved(flight.trajectory, position=position),
    )
    html = flight_page(tmp_path, ended_by_contact)
    assert 'class="notice warning"' in html
    assert 'class="notice failure"' not in html
    assert "At 25 s follower1 and follower2 touched." in html
    assert Termination.CONTACT.value in html
