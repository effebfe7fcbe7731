"""Parts of the film's overlay: text, shapes, panels, scale bars and curves; and the colours of
the encoder.
"""

import dataclasses
from typing import Any

import av
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from PIL import Image, ImageDraw

from laisn.estimates import FixKind
from laisn.settings import Variant
from sim.film import canvas, render
from sim.film.cameras import View
from sim.film.canvas import Area, Canvas, Polygon, Stroke, layer_of
from sim.film.dashboard import Dashboard, format_half_axes, round_length
from sim.film.film_data import FilmData
from sim.film.overlay import Overlay
from sim.scenario.settings import Video
from tests import synthetic
from tests.sim.film.filmed import WHITE, RecordingCanvas, overlap
from tests.synthetic import make_flight

# text


@pytest.mark.parametrize("anchor", ["la", "ra", "mm", "ms", "lm"])
def test_text_is_drawn_as_pillow_draws_it(anchor: str) -> None:
    """On whole pixels, drawing by a stored mask of the text gives the picture that Pillow draws
    directly.
    """
    ours = Canvas(320, 180)
    ours.pixels[:] = (10, 40, 60, 255)
    expected = Image.fromarray(ours.pixels.copy(), "RGBA")
    position, size = (140.0, 90.0), 40
    font = canvas.font(round(size * ours.text_scale), False)
    ImageDraw.Draw(expected).text(
        position, "E 0.27 m, gjÅ", fill=(255, 128, 64, 255), font=font, anchor=anchor
    )
    ours.text(position, "E 0.27 m, gjÅ", (1.0, 128 / 255, 64 / 255), size, anchor)
    np.testing.assert_allclose(ours.pixels.astype(int), np.asarray(expected).astype(int), atol=1)


def test_text_is_cut_at_the_edge_of_the_frame() -> None:
    """Of text that crosses an edge the same pixels are drawn as by Pillow."""
    ours = Canvas(60, 40)
    ours.pixels[:] = (10, 40, 60, 255)
    expected = Image.fromarray(ours.pixels.copy(), "RGBA")
    for position in ((-9.0, 30.0), (50.0, -4.0), (200.0, 10.0)):
        font = canvas.font(round(20 * ours.text_scale), False)
        ImageDraw.Draw(expected).text(position, "8.8 m", fill=(255, 255, 255, 255), font=font)
        ours.text(position, "8.8 m", WHITE, 20)
    np.testing.assert_allclose(ours.pixels.astype(int), np.asarray(expected).astype(int), atol=1)
    assert (ours.pixels == 255).all(axis=2).sum() > 5


# shapes and images


def test_lines_and_shapes_lie_where_they_should_and_keep_to_their_box() -> None:
    """A line 4 px wide covers 4 rows, a square its area, and neither is drawn outside a box."""
    ours = Canvas(320, 720)
    ours.pixels[:] = (0, 0, 0, 255)
    ours.strokes([Stroke(np.array([[20.0, 50.0], [300.0, 50.0]]), (1.0, 0.0, 0.0, 0.5), 4.0)])
    ours.shapes(
        [Polygon(np.array([[10.0, 100], [30, 100], [30, 130], [10, 130]]), (0.0, 1.0, 0.0))],
        (0, 0, 320, 120),
    )
    red, green = ours.pixels[..., 0].astype(float), ours.pixels[..., 1].astype(float)
    assert red.sum() / 255 == pytest.approx(0.5 * 280 * 4, rel=0.01)
    assert (red * np.arange(720)[:, None]).sum() / red.sum() == pytest.approx(49.5, abs=0.01)
    assert green[100:120, 10:30].min() == 255
    # Agg cuts on whole pixels, and draws that of the edge
    assert green[121:].max() == 0
    assert green[:, 30:].max() == 0


def test_an_image_lies_upright_and_lets_the_frame_shine_through() -> None:
    ours = Canvas(64, 36)
    ours.pixels[:] = (200, 100, 0, 255)
    layer = np.zeros((4, 6, 4), np.uint8)
    layer[:3] = (0, 0, 250, 51)
    layer[3] = (0, 0, 250, 255)
    ours.image(layer_of(layer), 10, 20)
    np.testing.assert_array_equal(ours.pixels[23, 10:16, :3], [(0, 0, 250)] * 6)
    np.testing.assert_allclose(
        ours.pixels[20:23, 10:16, :3], np.tile([160, 80, 50], (3, 6, 1)), atol=2
    )
    assert (ours.pixels[:20] == (200, 100, 0, 255)).all()


def test_an_image_lies_over_the_frame_as_agg_blends_it() -> None:
    """Of random colours and opacities, to one of 255 levels."""
    rng = np.random.default_rng(5)
    ours = Canvas(64, 36)
    ours.pixels[:] = rng.integers(0, 256, size=ours.pixels.shape)
    ours.pixels[..., 3] = 255
    agg: Any = FigureCanvasAgg(canvas.new_figure(64, 36))
    renderer = agg.get_renderer()
    expected = np.asarray(agg.buffer_rgba())
    expected[:] = ours.pixels
    image = rng.integers(0, 256, size=(20, 30, 4), dtype=np.uint8)
    # rows of an image count from below
    renderer.draw_image(renderer.new_gc(), 3, 36 - 2 - 20, np.ascontiguousarray(image[::-1]))
    ours.image(layer_of(image), 3, 2)
    np.testing.assert_allclose(ours.pixels.astype(int), expected.astype(int), atol=1)


def test_a_picture_from_below_is_turned_upright() -> None:
    source = np.random.default_rng(4).integers(0, 256, size=(6, 10, 4), dtype=np.uint8)
    ours = Canvas(10, 6)
    ours.load(source)
    np.testing.assert_array_equal(ours.pixels[..., :3], source[::-1, :, :3])
    assert (ours.pixels[..., 3] == 255).all()


def test_colours_are_converted_to_bt709() -> None:
    """ITU-R BT.709 in limited range, as declared in the stream: a decoder that uses it
    reproduces the colours.
    """
    colours = [(255, 255, 255), (0, 0, 0), (255, 64, 217), (255, 242, 64), (9, 66, 92)]
    rgba = np.zeros((128, 160, 4), np.uint8)
    for i, colour in enumerate(colours):
        rgba[:, 32 * i : 32 * i + 32] = (*colour, 255)
    ((unit,),) = render.encode([rgba], Video(width_px=160, height_px=128))
    (picture,) = av.CodecContext.create("h264", "r").decode(av.Packet(unit)) or [None]
    assert picture is not None
    assert (picture.colorspace, picture.color_range) == (1, 1)
    luma, blue, red = (
        np.asarray(plane, np.uint8).reshape(plane.height, -1)[:, : plane.width].astype(float)
        for plane in picture.planes
    )
    for i, colour in enumerate(colours):
        r, g, b = np.array(colour) / 255
        y = 0.2126 * r + 0.7152 * g + 0.0722 * b
        assert luma[16:48, 32 * i + 12 : 32 * i + 20].mean() == pytest.approx(16 + 219 * y, abs=1.5)
        patch = np.s_[8:24, 16 * i + 6 : 16 * i + 10]
        assert blue[patch].mean() == pytest.approx(128 + 224 * (b - y) / 1.8556, abs=2)
        assert red[patch].mean() == pytest.approx(128 + 224 * (r - y) / 1.5748, abs=2)


# panels


def static_text(board: Dashboard) -> list[Text]:
    """Text of a dashboard that is drawn once; ticks beyond the ends of an axis are not drawn."""
    texts = list(board.figure.texts)
    for axes in board.figure.axes:
        for axis, limits in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            ticks = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
            texts += [
                label for tick, label in ticks if axes.axison and limits[0] <= tick <= limits[1]
            ]
    return texts


def static_boxes(board: Dashboard, height: int) -> dict[str, Area]:
    """Areas of the static text of a dashboard, whose picture is so high [px], from the top left."""
    boxes = {}
    for i, text in enumerate(static_text(board)):
        box = text.get_window_extent()
        boxes[f"{text.get_text()}, text {i}"] = box.x0, height - box.y1, box.width, box.height
    return boxes


@pytest.mark.parametrize("size", [(640, 360), (854, 480), (1024, 576), (1280, 720), (1920, 1080)])
@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-2"])
def test_text_of_panels_can_be_read_and_keeps_clear_of_other_text(
    size: tuple[int, int], variant: Variant
) -> None:
    flight = make_flight(60.0)
    navigation = flight.scenario.navigation.model_copy(update={"variant": variant})
    flight = dataclasses.replace(
        flight, scenario=flight.scenario.model_copy(update={"navigation": navigation})
    )
    data = FilmData(flight, 20.0)
    data.position_error[:], data.bearing_error[:] = 123.456, 3.0
    board, state = Dashboard(data, Canvas(*size)), data.at(60.0)
    static_areas = static_boxes(board, size[1])
    for kind in FixKind:
        drawn = RecordingCanvas(*size)
        board.draw(drawn, dataclasses.replace(state, fix_kind=(kind,)), [])
        assert ("middle" in drawn.words) == (variant == "laisn-3-2" and size[1] >= 576)
        assert len(drawn.words) >= 5
        assert min(drawn.sizes) >= 8
        areas = static_areas | {
            f"number {i}, {words}": area
            for i, (words, area) in enumerate(zip(drawn.words, drawn.boxes, strict=True))
        }
        names = list(areas)
        for i, name in enumerate(names):
            left, top, width, height = areas[name]
            assert any(
                x - 1 <= left
                and left + width <= x + w + 1
                and y - 1 <= top
                and top + height <= y + h + 1
                for x, y, w, h in board.places
            ), name
            # areas of static text contain blank space below its baseline
            tight_area = (left + 1, top + 2, width - 2, height - 5)
            assert not [other for other in names[:i] if overlap(tight_area, areas[other])], name
        assert not [words for words in areas if "_" in words]
    assert min(text.get_fontsize() for text in static_text(board)) >= 8
    left, top, width, height = zip(*board.places, strict=True)
    assert min(left) > 0
    assert max(a + b for a, b in zip(top, height, strict=True)) < size[1]
    assert max(a + b for a, b in zip(left, width, strict=True)) < size[0]


@pytest.mark.parametrize(
    ("half_axes", "words"),
    [
        ((0.0001, 0.0004), "below 1 mm"),
        ((0.002, 0.0154), "±2 by ±15 mm"),
        ((0.5, 2.345), "±0.50 by ±2.35 m"),
        ((0.0021,), "±2 mm"),
        ((12.0,), "±12.00 m"),
    ],
)
def test_half_axes_are_given_in_a_unit_that_suits_them(
    half_axes: tuple[float, ...], words: str
) -> None:
    assert format_half_axes(*half_axes) == words


def test_a_curve_shows_the_whole_mission_and_its_cursor_the_present() -> None:
    """Pulses of the error before and after the present: the curve is drawn throughout, and a
    cursor moves along it.
    """
    flight = make_flight(60.0)
    position_error = np.zeros(600)
    position_error[199:202], position_error[399:402], position_error[500:] = 7.0, 7.0, 2.0
    data = FilmData(flight, 20.0)
    data.position_error[:], data.bearing_error[:] = position_error, 0.0
    board = Dashboard(data, Canvas(1280, 720))
    ours, state = RecordingCanvas(), data.at(30.1)
    ours.pixels[:] = (0, 0, 0, 255)
    board.draw(ours, state, [])
    cursor = ours.lines[0]
    dot = ours.polygons[0].mean(axis=0)
    # the axis spans 0 to 60 s: pulses about 20.1 s and 40.1 s lie as far on either side of the
    # cursor
    assert cursor[0, 0] == pytest.approx(dot[0], abs=0.5)
    axes, _ = board._curves[0]
    x, y, width, height = board.places[1]
    pulses = [axes.transData.transform((20.1 + 20 * n, 3.5))[0] for n in (0, 1)]
    assert cursor[0, 0] - pulses[0] == pytest.approx(pulses[1] - cursor[0, 0], abs=0.6)
    row = round(720 - axes.transData.transform((0.0, 3.5))[1])
    assert all(
        ours.pixels[row, round(pulse) - 2 : round(pulse) + 3, 0].max() > 200 for pulse in pulses
    )
    assert y < row < y + height
    assert x < pulses[0] < pulses[1] < x + width


def test_vehicles_of_a_fleet_are_distinct_on_the_map() -> None:
    """Vehicles a few metres apart on a mission of a kilometre: the map follows them, north up."""
    flight = make_flight(60.0, 3)
    truth = flight.trajectory
    spread_out = truth.position + np.linspace(0.0, 1000.0, truth.time.size)[:, None, None] * [
        1.0,
        0.0,
        0.0,
    ]
    flight = dataclasses.replace(flight, trajectory=synthetic.moved(truth, position=spread_out))
    data = FilmData(flight, 20.0)
    board, drawn, state = Dashboard(data, Canvas(1280, 720)), RecordingCanvas(), data.at(30.0)
    board.draw(drawn, state, [])
    left, top, width, height = board.places[3]
    # the last polygons are the vehicles
    dots = np.array([polygon.mean(axis=0) for polygon in drawn.polygons[-4:]])
    assert ((dots > [left, top]) & (dots < [left + width, top + height])).all()
    pixel_distances = np.linalg.norm(dots[:, None] - dots[None], axis=2)[np.triu_indices(4, 1)]
    assert pixel_distances.min() > 12
    offsets_m = state.position[1:, :2] - state.position[0, :2]
    scale = np.linalg.norm(offsets_m, axis=1) / np.linalg.norm(dots[1:] - dots[0], axis=1)
    np.testing.assert_allclose(dots[1:] - dots[0], offsets_m / scale[0] * [1, -1], atol=0.1)


# scale bars


@pytest.mark.parametrize("distance", [3.0, 17.0, 240.0])
def test_a_scale_bar_has_the_projected_length_of_its_metres(distance: float) -> None:
    flight = make_flight(5.0)
    overlay = Overlay(FilmData(flight, 20.0), Video())
    drawn = overlay.canvas = RecordingCanvas()
    view = View(position=np.zeros(3), target=np.array([0.0, distance, 0.0]), plane_m=distance)
    overlay._scale_bar(view, (0, 0, 1280, 720), (20.0, 600.0), 120 / 1280)
    length = float(drawn.words[0].split()[0])
    assert length == round_length(length)
    ends, _ = view.project(np.array([[0.0, distance, 0.0], [length, distance, 0.0]]), 1280, 720)
    bar_px = np.ptp(drawn.lines[0][:, 0])
    assert bar_px == pytest.approx(ends[1, 0] - ends[0, 0], rel=1e-6)
    assert 120.0 / 2.5 - 1e-6 <= bar_px <= 120.0 + 1e-6


@pytest.mark.parametrize(
    ("longest", "length"), [(0.99, 0.5), (1.0, 1.0), (4.99, 2.0), (5.0, 5.0), (1234.0, 1000.0)]
)
def test_lengths_of_scale_bars_are_round(longest: float, length: float) -> None:
    assert round_length(longest) == pytest.approx(length, rel=1e-12)
