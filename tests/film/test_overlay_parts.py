"""Parts of the film's overlay: words, panels, scale bars and curves; and pixels."""

import dataclasses

import numpy as np
import pytest
from PIL import Image, ImageDraw
from synthetic import make_flight

from laisn.estimates import FixKind
from laisn.settings import Variant
from sim.film import canvas, curve, pixels
from sim.film.annotations import NOTHING
from sim.film.cameras import View
from sim.film.canvas import Canvas, Stroke
from sim.film.dashboard import Dashboard
from sim.film.footage import Footage
from sim.film.labels import Area
from sim.film.numbers import in_words
from sim.film.panels import scale_bar
from tests.film.filmed import WHITE, Notebook, overlap

# words


@pytest.mark.parametrize("anchor", ["la", "ra", "mm", "ms", "lm"])
def test_words_are_pillows(anchor: str) -> None:
    """On whole pixels the mask that is kept for later gives the picture that Pillow draws at once."""
    ours = Canvas(320, 180)
    ours.pixels[:] = (10, 40, 60, 255)
    expected = Image.fromarray(ours.pixels.copy(), "RGBA")
    place, size = (140.0, 90.0), 40
    for _ in range(2):
        ours.text(place, "E_P 0.27 m, gjÅ", (1.0, 0.5, 0.25), size, anchor)
        font = canvas._font(round(size * ours.text_scale), False)
        ImageDraw.Draw(expected).text(place, "E_P 0.27 m, gjÅ", fill=(255, 128, 64, 255), font=font, anchor=anchor)
    np.testing.assert_array_equal(ours.pixels, np.asarray(expected))


@pytest.mark.parametrize("size", [6, 8, 10, 16])
def test_words_that_move_lose_nothing(size: int) -> None:
    """A shift moves the centre of what is drawn by so much, and cuts nothing off."""
    whole, x, y = canvas._shifted("i 0 8 Å 5.78 [m]", size, False, "la", 0, 0)
    still = np.asarray(whole, dtype=np.float64)
    rows, columns = np.indices(still.shape)
    for right in range(4):
        for down in range(4):
            moved, *corner = canvas._shifted("i 0 8 Å 5.78 [m]", size, False, "la", right, down)
            mask = np.asarray(moved, dtype=np.float64)
            assert corner == [x, y]
            assert mask.sum() == pytest.approx(still.sum(), rel=0.01)
            for place, parts in ((columns, right), (rows, down)):
                shift = (place * mask).sum() / mask.sum() - (place * still).sum() / still.sum()
                assert shift == pytest.approx(parts / 4, abs=0.03)


def test_no_words_draw_nothing() -> None:
    ours = Canvas(64, 36)
    before = ours.pixels.copy()
    ours.text((10, 10), "")
    np.testing.assert_array_equal(ours.pixels, before)


# strokes and layers


def scribble(seed: int) -> list[Stroke]:
    rng = np.random.default_rng(seed)
    starts, steps = rng.uniform([50, 50], [270, 130], size=(20, 2)), rng.normal(0, 9, size=(20, 4, 2))
    return [Stroke(a + np.cumsum(s, axis=0), tuple(rng.uniform(0, 1, 4)), float(rng.choice([1.2, 7.0])))
            for a, s in zip(starts, steps, strict=True)]  # fmt: skip


def test_many_strokes_are_drawn_as_one_after_another() -> None:
    together, one_by_one = Canvas(320, 180), Canvas(320, 180)
    for ours in (together, one_by_one):
        ours.pixels[:] = (10, 40, 60, 255)
    together.strokes(scribble(2))
    together.strokes([])
    for stroke in scribble(2):
        one_by_one.line(*stroke)
    assert (together.pixels[..., :3] != (10, 40, 60)).any(axis=2).sum() > 500
    np.testing.assert_array_equal(together.pixels, one_by_one.pixels)


def test_a_layer_laid_over_a_picture_is_what_would_be_drawn_on_it() -> None:
    place = (40.0, 30.0, 180.0, 90.0)

    def draw(ours: Canvas) -> None:
        ours.panel(*place)
        ours.text((60, 50), "E_P 0.27 m", (1.0, 0.5, 0.25, 0.8), 18)
        ours.line(np.array([[45.0, 40.0], [200.0, 110.0]]), (0.2, 0.9, 0.3, 0.4), 5.0)

    sea = np.random.default_rng(1).integers(0, 256, size=(180, 320, 4), dtype=np.uint8)
    sea[..., 3] = 255
    drawn, laid = Canvas(320, 180), Canvas(320, 180)
    layer = laid.layer(place, draw)
    for ours in (drawn, laid):
        ours.pixels[:] = sea
    draw(drawn)
    laid.lay(layer)
    difference = np.abs(drawn.pixels.astype(int) - laid.pixels.astype(int))
    # each of its strokes rounds once more
    assert difference.max() <= 3
    assert (np.abs(drawn.pixels.astype(int) - sea.astype(int)).max(axis=2) > 20).sum() > 10_000


# pixels


def test_a_picture_from_below_is_turned_upright() -> None:
    source = np.random.default_rng(4).integers(0, 256, size=(6, 10, 3), dtype=np.uint8)
    target = np.zeros((6, 10, 4), dtype=np.uint8)
    pixels.upright(source, target)
    np.testing.assert_array_equal(target[..., :3], source[::-1])
    assert (target[..., 3] == 255).all()


def test_colours_become_those_of_television() -> None:
    """ITU-R BT.709 in floating point; chroma is a mean weighted 1, 2, 1 about even columns, over two rows."""
    rgb = np.random.default_rng(5).integers(0, 256, size=(38, 32, 4), dtype=np.uint8)
    planes = np.zeros((57, 32), dtype=np.uint8)
    pixels.to_yuv420(rgb, planes)
    r, g, b = np.moveaxis(rgb[..., :3] / 255.0, 2, 0)
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    np.testing.assert_allclose(planes[:38], 16 + 219 * y, atol=0.51)
    chroma = planes[38:].ravel()
    for plane, colour, scale in ((chroma[:304], b, 1.8556), (chroma[304:], r, 1.5748)):
        whole = np.pad((colour - y) / scale, ((0, 0), (1, 0)), mode="edge")
        across = (whole[:, 0:-1:2] + 2 * whole[:, 1::2] + whole[:, 2::2]) / 4
        wanted = 128 + 224 * (across[0::2] + across[1::2]) / 2
        np.testing.assert_allclose(plane.reshape(19, 16), wanted, atol=0.52)


# panels


@pytest.mark.parametrize("size", [(640, 360), (854, 480), (1024, 576), (1280, 720), (1920, 1080)])
@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-2"])
def test_words_of_panels_can_be_read_and_keep_clear_of_one_another(size: tuple[int, int], variant: Variant) -> None:
    flight = make_flight(60.0)
    navigation = flight.scenario.navigation.model_copy(update={"variant": variant})
    flight = dataclasses.replace(flight, scenario=flight.scenario.model_copy(update={"navigation": navigation}))
    footage = Footage(flight, [(np.full(600, 123.456), np.full(600, 3.0))], 20.0)
    board = Dashboard(footage, 0, Canvas(*size), NOTHING)
    moment = footage.at(60.0)
    for kind in FixKind:
        numbers, notes = board._numbers, Notebook(*size)
        numbers.ground(notes)
        numbers.draw(notes, dataclasses.replace(moment, fix_kind=(kind,)), ((1.0, 1.0, 1.0),) * 3)
        apart_and_within(notes, numbers.place)
        assert ("middle" in notes.words) == (variant == "laisn-3-2" and size[1] >= 576)
    for part in board._curves:
        notes = Notebook(*size)
        part.ground(notes)
        apart_and_within(notes, part.place)
    left, top, width, height = zip(*board.places, strict=True)
    assert min(left) > 0
    assert max(a + b for a, b in zip(top, height, strict=True)) < size[1]
    assert max(a + b for a, b in zip(left, width, strict=True)) < size[0]


@pytest.mark.parametrize(
    ("half_axes", "words"),
    [((0.0001, 0.0004), "below 1 mm"), ((0.002, 0.0154), "±2 by ±15 mm"), ((0.5, 2.345), "±0.50 by ±2.35 m"),
     ((0.0021,), "±2 mm"), ((12.0,), "±12.00 m")],
)  # fmt: skip
def test_half_axes_are_told_in_a_unit_that_suits_them(half_axes: tuple[float, ...], words: str) -> None:
    assert in_words(*half_axes) == words


def apart_and_within(notes: Notebook, place: Area) -> None:
    assert len(notes.words) >= 4
    assert min(notes.sizes) >= 8
    for i, box in enumerate(notes.boxes):
        assert box[0] >= place[0]
        assert box[1] >= place[1]
        assert box[0] + box[2] <= place[0] + place[2] + 1
        assert box[1] + box[3] <= place[1] + place[3] + 1
        assert not [notes.words[j] for j, other in enumerate(notes.boxes[:i]) if overlap(box, other)], notes.words[i]


# scale bars


@pytest.mark.parametrize("distance", [3.0, 17.0, 240.0])
def test_a_scale_bar_is_as_long_as_the_camera_sees_its_metres(distance: float) -> None:
    view = View(position=np.array([0.0, 0.0, 0.0]), target=np.array([0.0, distance, 0.0]), plane_m=distance)
    (a, b), _ = view.project(np.array([[0.0, distance, 0.0], [1.0, distance, 0.0]]), 1280, 720)
    notes = Notebook()
    scale_bar(notes, (20.0, 600.0), float(b[0] - a[0]), 120.0)
    (words,) = notes.words
    length = float(words.split()[0])
    digits = length / 10 ** np.floor(np.log10(length) + 1e-9)
    assert min(abs(digits - nice) for nice in (1.0, 2.0, 5.0)) < 1e-6
    ends, _ = view.project(np.array([[0.0, distance, 0.0], [length, distance, 0.0]]), 1280, 720)
    drawn = np.ptp(notes.lines[0][:, 0])
    assert drawn == pytest.approx(ends[1, 0] - ends[0, 0], rel=1e-6)
    assert 120.0 / 2.5 - 1e-6 <= drawn <= 120.0 + 1e-6


# curves


def test_a_curve_keeps_its_peak_and_ends_at_the_value_of_now() -> None:
    values = np.zeros(5000)
    values[1234] = 7.0
    values[4000:] = 2.0
    drawn = curve.Curve("error [m]", 0.1, [(WHITE, values)], (16.0, 280.0, 292.0, 92.0))
    notes = Notebook()
    drawn.draw(notes, 450.0)
    line = max(notes.lines, key=len)
    (dot,) = notes.dots
    # heights are linear in the values: zero lies where the curve begins, the peak 7/2 times as high as the end
    assert line[0, 1] - line[:, 1].min() == pytest.approx(3.5 * (line[0, 1] - dot[1]), rel=1e-9)
    assert line[-1] == pytest.approx(dot)
    # and places in the time: the peak at 123.5 s, to a column of pixels
    peak, start = line[line[:, 1].argmin(), 0], line[0, 0]
    assert (peak - start) / (dot[0] - start) == pytest.approx(123.5 / 450.0, abs=0.01)
