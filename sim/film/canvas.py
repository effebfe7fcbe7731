"""A frame to draw on: smooth lines and shapes by Agg, text by Pillow, both in one buffer."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.path import Path as Outline
from matplotlib.transforms import IdentityTransform
from PIL import Image, ImageDraw, ImageFont

from laisn.arrays import Bytes, Floats

Colour = tuple[float, ...]
"""Red, green, blue and, where given, opacity, each in [0, 1]."""
PALE: Colour = (0.80, 0.92, 0.97)
"""Colour of text that is read, such as a value."""
DIM: Colour = (0.60, 0.76, 0.83)
"""Colour of text that explains it, such as a value's name."""

_HERE = IdentityTransform()
_SHIFTS = 4


@lru_cache(maxsize=64)
def _font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), size)


@lru_cache(maxsize=4096)
def _written(words: str, size: int, bold: bool, anchor: str, shift: tuple[float, float]) -> tuple[Any, int, int]:
    """Words as a mask, and where its corner lies from their anchor [px]; most words of a frame were in the last one."""
    font = _font(size, bold)
    left, top, right, bottom = font.getbbox(words, anchor=anchor)
    x, y = int(left) - 1, int(top) - 1
    mask = Image.new("L", (int(right) - x + 2, int(bottom) - y + 2))
    ImageDraw.Draw(mask).text((shift[0] - x, shift[1] - y), words, font=font, fill=255, anchor=anchor)
    return mask, x, y


def _rgba(colour: Colour, opacity: float = 1.0) -> tuple[float, float, float, float]:
    r, g, b, a = (*colour, 1.0)[:4]
    return r, g, b, a * opacity


class Canvas:
    """Pixels count from the top left; sizes are in pixels times `scale`, which is 1 at 720 rows.

    Args:
        width: of the frame [px].
        height: of the frame [px].
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.scale = height / 720
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
        for channel in range(3):  # one by one: five times as fast as all at once
            self.pixels[..., channel] = pixels[::-1, :, channel]
        self.pixels[..., 3] = 255

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
        self, at: tuple[float, float], words: str, colour: Colour = (1, 1, 1), size: float = 14, anchor: str = "la"
    ) -> None:
        """Words in DejaVu Sans; `anchor` as in Pillow; a size below zero means bold."""
        if not words:
            return
        r, g, b, a = (round(255 * c) for c in _rgba(colour))
        # words that move do so by quarters of a pixel
        (x, dx), (y, dy) = (divmod(round(_SHIFTS * v), _SHIFTS) for v in at)
        mask, left, top = _written(
            words, max(6, round(abs(size) * self.scale)), size < 0, anchor, (dx / _SHIFTS, dy / _SHIFTS)
        )
        self._draw.bitmap((x + left, y + top), mask, fill=(r, g, b, a))

    def extent(self, words: str, size: float = 14) -> tuple[float, float]:
        """Width of words and height of their line [px]; a size below zero means bold."""
        font = _font(max(6, round(abs(size) * self.scale)), size < 0)
        ascent, descent = font.getmetrics()
        return float(font.getlength(words)), float(ascent + descent)

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
