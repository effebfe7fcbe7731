"""A frame to draw on: smooth lines and shapes by Agg, text by Pillow, both in one buffer."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D, IdentityTransform
from PIL import Image, ImageDraw, ImageFont

from laisn.arrays import Bytes, Floats
from sim.film.pixels import lay, upright

Colour = tuple[float, ...]
"""Red, green, blue and, where given, opacity, each in [0, 1]."""
PALE: Colour = (0.80, 0.92, 0.97)
"""Colour of text that is read, such as a value."""
DIM: Colour = (0.60, 0.76, 0.83)
"""Colour of text that explains it, such as a value's name."""

_HERE = IdentityTransform()
_SHIFTS = 4
_LEAST_TEXT = 0.8
"""Least size of words, as a share of that at 720 rows: smaller digits lose their strokes."""
_MARGIN = 3
"""By which a layer is wider than its panel on each side, for the panel's edge [px]."""


class Stroke(NamedTuple):
    """A polyline of a colour."""

    points: Floats
    """Shape (n, 2), [px]."""
    colour: Colour
    width: float


class Layer(NamedTuple):
    """What was drawn once and is laid over many frames."""

    left: int
    top: int
    light: Bytes
    """What it adds, shape (h, w, 3)."""
    shine: Bytes
    """What it lets through of what lies below, of 255, shape (h, w, 3)."""


@lru_cache(maxsize=64)
def _font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), size)


@lru_cache(maxsize=4096)
def _written(words: str, size: int, bold: bool, anchor: str) -> tuple[Bytes, int, int]:
    """Words as a mask, shape (h, w), and where its corner lies from their anchor [px]."""
    font = _font(size, bold)
    left, top, right, bottom = font.getbbox(words, anchor=anchor)
    x, y = int(left) - 1, int(top) - 1
    mask = Image.new("L", (int(right) - x + 2, int(bottom) - y + 2))
    ImageDraw.Draw(mask).text((-x, -y), words, font=font, fill=255, anchor=anchor)
    return np.asarray(mask), x, y


@lru_cache(maxsize=4096)
def _shifted(words: str, size: int, bold: bool, anchor: str, right: int, down: int) -> tuple[Any, int, int]:
    """Words moved by so many of `_SHIFTS` parts of a pixel; most words of a frame were in the last one.

    Pillow could draw them there, but cuts off their uppermost row.
    """
    mask, x, y = _written(words, size, bold, anchor)
    moved = mask.astype(np.float64)
    for axis, parts in ((0, down), (1, right)):
        share = parts / _SHIFTS
        moved = (1 - share) * moved + share * np.roll(moved, 1, axis)
    return Image.fromarray(np.round(moved).astype(np.uint8), "L"), x, y


def _rgba(colour: Colour, opacity: float = 1.0) -> tuple[float, float, float, float]:
    r, g, b, a = (*colour, 1.0)[:4]
    return r, g, b, a * opacity


class Canvas:
    """Pixels count from the top left; sizes are in pixels times `scale`, which is 1 at 720 rows.

    Words shrink with the frame only as far as they can be read.

    Args:
        width: of the frame [px].
        height: of the frame [px].
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.scale = height / 720
        self.text_scale = max(self.scale, _LEAST_TEXT)
        """Pixels to a unit of the size of words."""
        self._flip = Affine2D().scale(1, -1).translate(0, height)
        # matplotlib's own classes carry no types
        make: Any = RendererAgg
        self._agg: Any = make(width, height, 72)
        self.pixels: Bytes = np.asarray(self._agg.buffer_rgba())
        """The frame, top row first, shape (height, width, 4)."""
        image = Image.frombuffer("RGBA", (width, height), self._agg.buffer_rgba(), "raw", "RGBA", 0, 1)
        image.readonly = 0  # draw into Agg's buffer itself; Pillow would copy it first
        self._draw = ImageDraw.Draw(image)

    def load(self, pixels: Bytes) -> None:
        """Start from a rendered picture, bottom row first, shape (height, width, 3)."""
        upright(pixels, self.pixels)

    def line(self, points: Floats, colour: Colour, width: float = 2.0, dash: tuple[float, ...] | None = None) -> None:
        """A polyline through points of shape (n, 2)."""
        gc = self._agg.new_gc()
        gc.set_foreground(_rgba(colour), isRGBA=True)
        gc.set_alpha(_rgba(colour)[3])
        gc.set_linewidth(width * self.scale)
        gc.set_capstyle("butt")
        gc.set_joinstyle("round")
        if dash:
            gc.set_dashes(0, [d * self.scale for d in dash])
        self._agg.draw_path(gc, Outline(self._flipped(points)), _HERE)

    def strokes(self, strokes: Sequence[Stroke]) -> None:
        """Polylines, in their order; one call for all takes half the time of one for each."""
        if not strokes:
            return
        gc = self._agg.new_gc()
        gc.set_capstyle("butt")
        gc.set_joinstyle("round")
        nothing = np.zeros((0, 4))
        self._agg.draw_path_collection(
            gc,
            self._flip,
            [Outline(stroke.points) for stroke in strokes],
            np.zeros((0, 3, 3)),
            np.zeros((0, 2)),
            _HERE,
            nothing,
            np.array([_rgba(stroke.colour) for stroke in strokes]),
            [stroke.width * self.scale for stroke in strokes],
            [(0, None)],
            [True],
            [None],
            "screen",
            hatchcolors=nothing,
        )

    def layer(self, place: tuple[float, float, float, float], draw: Callable[["Canvas"], None]) -> Layer:
        """What `draw` draws within a place (left, top, width, height) [px], to be laid over frames.

        Args:
            place: of a panel.
            draw: draws the same on whatever it is given; it only ever covers what is there.
        """
        left, top = (max(0, int(v) - _MARGIN) for v in place[:2])
        right, bottom = (int(place[i] + place[i + 2]) + _MARGIN for i in (0, 1))
        parts = []
        for ground in (0, 255):
            other = Canvas(self.width, self.height)
            other.pixels[..., :3], other.pixels[..., 3] = ground, 255
            draw(other)
            parts.append(other.pixels[top:bottom, left:right, :3].copy())
        # what is laid over black is its own light; over white comes what shines through
        black, white = parts
        return Layer(left, top, black, white - np.minimum(black, white))

    def lay(self, layer: Layer) -> None:
        """Lay a layer over the frame."""
        height, width = layer.light.shape[:2]
        lay(self.pixels[layer.top : layer.top + height, layer.left : layer.left + width], layer.light, layer.shine)

    def shape(self, points: Floats, fill: Colour, edge: Colour | None = None, width: float = 1.5) -> None:
        """A filled polygon with corners of shape (n, 2)."""
        self._fill(Outline(self._flipped(np.vstack([points, points[:1]]))), fill, edge, width)

    def dot(self, at: Floats, radius: float, fill: Colour, edge: Colour | None = None) -> None:
        """A disc about `at`, shape (2,)."""
        outline = Outline.circle(tuple(self._flipped(at[None, :])[0]), radius * self.scale)
        self._fill(outline, fill, edge, 1.5)

    def diamond(self, at: Floats, radius: float, fill: Colour, edge: Colour | None = None) -> None:
        """A square on its corner about `at`, shape (2,)."""
        self.shape(at + radius * self.scale * np.array([[1.0, 0], [0, 1], [-1, 0], [0, -1]]), fill, edge)

    def panel(self, left: float, top: float, width: float, height: float, opacity: float = 0.5) -> None:
        """A dark, translucent ground for text."""
        corners = np.array([[left, top], [left + width, top], [left + width, top + height], [left, top + height]])
        self.shape(corners, (0.01, 0.06, 0.10, opacity), (0.55, 0.80, 0.90, 0.35 * opacity / 0.5), 1.0)

    def text(
        self,
        at: tuple[float, float],
        words: str,
        colour: Colour = (1, 1, 1),
        size: float = 14,
        anchor: str = "la",
        *,
        moves: bool = False,
    ) -> None:
        """Words in DejaVu Sans.

        Args:
            at: of their anchor [px].
            words: one line.
            colour: theirs.
            size: below zero it means bold.
            anchor: as in Pillow.
            moves: whether they move from frame to frame, and so by parts of a pixel; others are sharper.
        """
        if not words:
            return
        r, g, b, a = (round(255 * c) for c in _rgba(colour))
        (x, right), (y, down) = (divmod(round(_SHIFTS * v), _SHIFTS) if moves else (round(v), 0) for v in at)
        mask, left, top = _shifted(words, self._size(size), size < 0, anchor, right, down)
        if a < 255:
            mask = Image.fromarray((np.asarray(mask) * (a / 255)).astype(np.uint8), "L")
        # an opacity in the fill would end in the fourth channel, and leave the words opaque
        self._draw.bitmap((x + left, y + top), mask, fill=(r, g, b, 255))

    def extent(self, words: str, size: float = 14) -> tuple[float, float]:
        """Width of words and height of their line [px]; a size below zero means bold."""
        font = _font(self._size(size), size < 0)
        ascent, descent = font.getmetrics()
        return float(font.getlength(words)), float(ascent + descent)

    def _size(self, size: float) -> int:
        return max(6, round(abs(size) * self.text_scale))

    def _flipped(self, points: Floats) -> Floats:
        turned = np.array(points, dtype=np.float64)
        np.subtract(self.height, turned[:, 1], turned[:, 1])
        return turned

    def _fill(self, outline: Outline, fill: Colour, edge: Colour | None, width: float) -> None:
        gc = self._agg.new_gc()
        gc.set_linewidth(width * self.scale if edge else 0.0)
        if edge:
            gc.set_foreground(_rgba(edge), isRGBA=True)
        self._agg.draw_path(gc, outline, _HERE, _rgba(fill))
