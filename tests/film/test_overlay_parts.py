"""Parts of the film's overlay: words, labels, scale bars and curves; and the smoothing of edges."""

import numpy as np
import pytest
from PIL import Image, ImageDraw

from laisn.arrays import Bytes, Floats
from sim.film import antialiasing, canvas, curve, labels
from sim.film.cameras import View
from sim.film.canvas import Canvas, Colour
from sim.film.labels import Area, Label
from sim.film.panels import scale_bar

WHITE: Colour = (1.0, 1.0, 1.0)


class Notebook(Canvas):
    """A canvas that keeps what it is asked to draw."""

    def __init__(self, width: int = 1280, height: int = 720) -> None:
        super().__init__(width, height)
        self.lines: list[Floats] = []
        self.dots: list[Floats] = []
        self.words: list[str] = []

    def line(self, points: Floats, colour: Colour, width: float = 2.0, dash: tuple[float, ...] | None = None) -> None:
        self.lines.append(np.array(points))

    def dot(self, at: Floats, radius: float, fill: Colour, edge: Colour | None = None) -> None:
        self.dots.append(np.array(at))

    def text(
        self, at: tuple[float, float], words: str, colour: Colour = (1, 1, 1), size: float = 14, anchor: str = "la"
    ) -> None:
        self.words.append(words)


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
        font = canvas._font(round(size * ours.scale), False)
        ImageDraw.Draw(expected).text(place, "E_P 0.27 m, gjÅ", fill=(255, 128, 64, 255), font=font, anchor=anchor)
    np.testing.assert_array_equal(ours.pixels, np.asarray(expected))


def test_no_words_draw_nothing() -> None:
    ours = Canvas(64, 36)
    before = ours.pixels.copy()
    ours.text((10, 10), "")
    np.testing.assert_array_equal(ours.pixels, before)


# labels


def overlap(a: Area, b: Area) -> bool:
    return not (a[0] + a[2] <= b[0] or b[0] + b[2] <= a[0] or a[1] + a[3] <= b[1] or b[1] + b[3] <= a[1])


def crowd(n: int, seed: int) -> list[Label]:
    rng = np.random.default_rng(seed)
    places = rng.uniform([300, 100], [1000, 600], size=(n, 2))
    return [Label(at, f"vehicle {i}", WHITE, (-1) ** i * 30.0) for i, at in enumerate(places)]


@pytest.mark.parametrize("seed", range(6))
def test_labels_keep_clear_of_everything(seed: int) -> None:
    frame, panels = Canvas(1280, 720), [(16.0, 16.0, 292.0, 258.0), (1032.0, 16.0, 232.0, 232.0)]
    wanted = crowd(25, seed)
    placed = labels.place(wanted, panels, frame)
    areas = [area for _, area, _ in placed]
    assert len(placed) > 15
    markers = [(float(label.at[0]) - 5, float(label.at[1]) - 5, 10.0, 10.0) for label in wanted]
    for i, area in enumerate(areas):
        left, top, width, height = area
        assert left >= 0
        assert top >= 0
        assert left + width <= 1280
        assert top + height <= 720
        assert not any(overlap(area, other) for other in (*areas[:i], *panels, *markers))


def test_the_first_label_has_the_first_choice() -> None:
    frame, at = Canvas(1280, 720), np.array([640.0, 360.0])
    first, second = Label(at, "first", WHITE, -30.0), Label(at + np.array([9.0, 1.0]), "second", WHITE, -30.0)
    ((_, alone, end),) = labels.place([first], [], frame)
    assert end - at == pytest.approx([16.0, -30.0])
    (_, still, _), (_, other, _) = labels.place([first, second], [], frame)
    assert still == alone
    ((_, free, _),) = labels.place([second], [], frame)
    assert other != free


def test_a_label_without_room_is_left_out() -> None:
    frame = Canvas(1280, 720)
    label = Label(np.array([640.0, 360.0]), "nowhere", WHITE, 30.0)
    assert labels.place([label], [(0.0, 0.0, 1280.0, 720.0)], frame) == []


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


# edges


def halves(slope: float, across: bool, samples: int) -> Bytes:
    """A slanted edge between dark and bright water, each pixel the mean of samples²."""
    n = 96
    fine = (np.arange(n * samples) + 0.5) / samples
    x, y = np.meshgrid(fine, fine)
    u, v = (y, x) if across else (x, y)
    bright = v > 40.3 + slope * u
    share = bright.reshape(n, samples, n, samples).mean(axis=(1, 3))
    picture = np.array([20, 60, 80]) + share[..., None] * np.array([180, 120, 20])
    return np.round(picture).astype(np.uint8)


@pytest.mark.parametrize("slope", [0.08, 0.15, 0.3, -0.22])
@pytest.mark.parametrize("across", [False, True])
def test_smoothing_brings_an_edge_nearer_to_one_of_many_samples(slope: float, across: bool) -> None:
    hard, true = halves(slope, across, 1), halves(slope, across, 16)
    smooth = hard.copy()
    antialiasing.smooth(hard, smooth, 0, 0, 96, 96)
    inner = np.s_[4:-4, 4:-4]

    def error(picture: Bytes) -> float:
        return float(np.sqrt(np.mean((picture[inner].astype(float) - true[inner]) ** 2)))

    assert error(smooth) < 0.6 * error(hard)


def test_smoothing_leaves_faint_texture_and_what_lies_outside_alone() -> None:
    rng = np.random.default_rng(3)
    sand = (120 + rng.integers(0, 15, size=(60, 80, 1)) + np.zeros(3)).astype(np.uint8)
    out = sand.copy()
    antialiasing.smooth(sand, out, 0, 0, 80, 60)
    np.testing.assert_array_equal(out, sand)
    edge = halves(0.15, False, 1)
    part = edge.copy()
    antialiasing.smooth(edge, part, 30, -20, 25, 200)
    changed = np.argwhere((part != edge).any(axis=2))
    assert len(changed) > 10
    assert changed[:, 1].min() >= 30
    assert changed[:, 1].max() < 55
