"""A frame to draw on: lines, shapes and images by matplotlib's Agg renderer, text by Pillow, all in
one buffer.

Measured for a frame of the film: Agg draws lines as fast as Skia does, Pillow draws text thirty
times as fast as Agg does, and keeping the masks of the words saves most of the rest.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D, Bbox, IdentityTransform
from PIL import Image, ImageDraw, ImageFont

from laisn.arrays import Bytes, Floats
from sim.film.blending import Singles, blend, lay

Colour = tuple[float, ...]  # red, green, blue and, where given, opacity, each in [0, 1]
Area = tuple[float, float, float, float]  # left, top, width, height [px]
PALE: Colour = (0.80, 0.92, 0.97)
DIM: Colour = (0.60, 0.76, 0.83)  # colours of values and of their names

# least size of text relative to that at 720 rows: smaller digits lose their strokes
_MIN_TEXT = 0.8
_CIRCLE = np.column_stack(
    [f(np.linspace(0.0, 2 * np.pi, 24, endpoint=False)) for f in (np.cos, np.sin)]
)
_DASH, _GAP = 4.0, 3.0  # lengths of dashes and gaps, in widths of the line
_NO_COLOURS = np.zeros((0, 4))
_NO_TRANSFORMS = np.zeros((0, 3, 3))
_ORIGIN = np.zeros((1, 2))
_UNMOVED = IdentityTransform()
_OPAQUE = np.array([0, 0, 0, 255], np.uint8).view(np.uint32)
_DIAMOND = np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]])


class Stroke(NamedTuple):
    """A polyline through points, shape (n, 2), [px]."""

    points: Floats
    colour: Colour
    width: float = 2.0
    dashed: bool = False


class Polygon(NamedTuple):
    """A filled polygon with corners, shape (n, 2), [px]."""

    points: Floats
    fill: Colour
    edge: Colour | None = None


class Layer(NamedTuple):
    """An image as many frames get it: a colour for each byte of its pixels, and the share of the
    frame that shines through, shape (h, 4 w).
    """

    colour: Singles
    share: Singles


def layer_of(rgba: Bytes) -> Layer:
    """Of an image with straight alpha, top row first, shape (h, w, 4), as Agg blends it with an
    opaque frame.
    """
    image = rgba.astype(np.float64)
    opacity = image[..., 3:]
    # weights of image and frame: 256 a + 255 (256 − a) = 65280 + a
    weight_sum = 65280.0 + opacity
    is_opaque = opacity == 255.0
    # a little more, so that whole numbers are not cut to those below them
    colour = np.where(is_opaque, image, 256.0 * image * opacity / weight_sum) + 1e-5
    share = np.where(is_opaque, 0.0, 255.0 * (256.0 - opacity) / weight_sum)
    share = np.repeat(share, 4, axis=2)
    colour[..., 3], share[..., 3] = 255.0, 0.0
    return Layer(*(a.reshape(len(rgba), -1).astype(np.float32) for a in (colour, share)))


def new_figure(width: int, height: int) -> Figure:
    """A transparent matplotlib figure with a point for each pixel."""
    return Figure(figsize=(width / 72, height / 72), dpi=72, facecolor="none")


@lru_cache(maxsize=64)
def font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib, of a size [px]."""
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), size)


@lru_cache(maxsize=4096)
def _mask(words: str, size: int, bold: bool, anchor: str) -> tuple[Bytes, int, int]:
    """Coverage of pixels by text, shape (h, w), and the offset of its corner from the anchor
    [px].
    """
    box = font(size, bold).getbbox(words, anchor=anchor)
    x, y = int(box[0]) - 1, int(box[1]) - 1
    image = Image.new("L", (int(box[2]) - x + 2, int(box[3]) - y + 2))
    ImageDraw.Draw(image).text((-x, -y), words, font=font(size, bold), fill=255, anchor=anchor)
    return np.array(image), x, y


def _rgba(colours: Iterable[Colour]) -> Floats:
    return np.array([(*colour, 1.0)[:4] for colour in colours], dtype=np.float64).reshape(-1, 4)


class Canvas:
    """Pixels count from the top left; sizes are in pixels times `scale`, which is 1 at 720 rows."""

    def __init__(self, width: int, height: int) -> None:
        self.width = width
        self.height = height
        self.scale = height / 720
        self.text_scale = max(self.scale, _MIN_TEXT)
        """Pixels to a unit of text size: text shrinks with the frame only as far as it can be
        read.
        """
        figure = new_figure(width, height)
        agg: Any = FigureCanvasAgg(figure)
        self._renderer = agg.get_renderer()
        self._downward = Affine2D().scale(1, -1).translate(0, height).frozen()
        # the frame, top row first, shape (height, width, 4)
        self.pixels: Bytes = np.asarray(agg.buffer_rgba())

    def load(self, picture: Bytes) -> None:
        """Start from a rendered picture, bottom row first, shape (height, width, 4), as if its
        pixels were opaque.
        """
        np.bitwise_or(picture.view(np.uint32)[::-1], _OPAQUE, out=self.pixels.view(np.uint32))

    def strokes(self, strokes: Sequence[Stroke], box: Area | None = None) -> None:
        """Draw polylines in their order, only inside `box` if given."""
        widths = [stroke.width * self.scale for stroke in strokes]
        # dashes are counted in widths
        dashes = [
            (0.0, [_DASH * width, _GAP * width] if stroke.dashed else None)
            for stroke, width in zip(strokes, widths, strict=True)
        ]
        lines = [Outline(stroke.points) for stroke in strokes]
        self._draw(lines, _NO_COLOURS, _rgba(s.colour for s in strokes), widths, dashes, box)

    def shapes(self, shapes: Sequence[Polygon], box: Area | None = None) -> None:
        """Draw filled polygons in their order, only inside `box` if given."""
        outlines = [
            Outline(np.concatenate([shape.points, shape.points[:1]]), closed=True)
            for shape in shapes
        ]
        fills = _rgba(shape.fill for shape in shapes)
        edges = _rgba(shape.edge or (0, 0, 0, 0) for shape in shapes)
        widths = [1.5 * self.scale if shape.edge else 0.0 for shape in shapes]
        self._draw(outlines, fills, edges, widths, [(0.0, None)], box)

    def _draw(
        self,
        outlines: Sequence[Outline],
        fills: Floats,
        edges: Floats,
        widths: Sequence[float],
        dashes: Sequence[tuple[float, list[float] | None]],
        box: Area | None,
    ) -> None:
        """Draw outlines as a collection of matplotlib does, which takes several times as long to be
        filled.
        """
        if not outlines:
            return
        left, top, width, height = box or (0, 0, self.width, self.height)
        context = self._renderer.new_gc()
        context.set_clip_rectangle(
            Bbox.from_bounds(left, self.height - top - height, width, height)
        )
        self._renderer.draw_path_collection(
            context,
            self._downward,
            outlines,
            _NO_TRANSFORMS,
            _ORIGIN,
            _UNMOVED,
            fills,
            edges,
            widths,
            dashes,
            [True],
            [None],
            "screen",
        )

    def disc(
        self, centre: Floats, radius: float, fill: Colour, edge: Colour | None = None
    ) -> Polygon:
        """A disc about `centre`, shape (2,)."""
        return Polygon(centre + radius * self.scale * _CIRCLE, fill, edge)

    def diamond(
        self, centre: Floats, radius: float, fill: Colour, edge: Colour | None = None
    ) -> Polygon:
        """A square on its corner about `centre`, shape (2,)."""
        return Polygon(centre + radius * self.scale * _DIAMOND, fill, edge)

    def image(self, layer: Layer, left: int, top: int) -> None:
        """Lay an image over the frame, within which it lies."""
        lay(self.pixels, layer.colour, layer.share, left, top)

    def text(
        self,
        position: tuple[float, float],
        words: str,
        colour: Colour = (1, 1, 1),
        size: float = 14,
        anchor: str = "la",
    ) -> None:
        """Draw a line of text on whole pixels, with an anchor as in Pillow; a size below zero
        means bold.
        """
        if not words:
            return
        mask, dx, dy = _mask(words, self.text_size(size), size < 0, anchor)
        left = round(position[0]) + dx
        top = round(position[1]) + dy
        red, green, blue, opacity = map(float, (*colour, 1.0)[:4])
        blend(self.pixels, mask, left, top, red, green, blue, opacity)

    def extent(self, words: str, size: float = 14) -> tuple[float, float]:
        """Width of text and height of its line [px]; a size below zero means bold."""
        face = font(self.text_size(size), size < 0)
        return float(face.getlength(words)), float(sum(face.getmetrics()))

    def text_size(self, size: float) -> int:
        """Size of a font on this frame [px]."""
        return max(6, round(abs(size) * self.text_scale))


def corners(area: Area) -> Floats:
    """Corners of a rectangle, shape (4, 2), [px]."""
    left, top, width, height = area
    return np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * [width, height] + [
        left,
        top,
    ]
