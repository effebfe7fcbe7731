"""A frame to draw on: lines, shapes and images by matplotlib's Agg renderer, text by Pillow, all in
one buffer.

Measured for a frame of the film: Agg draws lines as fast as Skia does, Pillow draws text thirty
times as fast as Agg does, and keeping the masks of the words saves most of the rest.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Affine2D, Bbox
from PIL import Image, ImageDraw, ImageFont

from laisn.arrays import Bytes, Floats

Colour = tuple[float, ...]  # red, green, blue and, where given, opacity, each in [0, 1]
Area = tuple[float, float, float, float]  # left, top, width, height [px]
PALE: Colour = (0.80, 0.92, 0.97)
DIM: Colour = (0.60, 0.76, 0.83)  # colours of values and of their names

# least size of text relative to that at 720 rows: smaller digits lose their strokes
_MIN_TEXT = 0.8
_CIRCLE = np.column_stack(
    [f(np.linspace(0.0, 2 * np.pi, 24, endpoint=False)) for f in (np.cos, np.sin)]
)
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


def new_figure(width: int, height: int) -> Figure:
    """A transparent matplotlib figure with a point for each pixel."""
    return Figure(figsize=(width / 72, height / 72), dpi=72, facecolor="none")


@lru_cache(maxsize=64)
def font(size: int, bold: bool) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib, of a size [px]."""
    folder = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    return ImageFont.truetype(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"), size)


@lru_cache(maxsize=4096)
def _mask(words: str, size: int, bold: bool, anchor: str) -> tuple[Floats, int, int]:
    """Coverage of pixels by text, shape (h, w), in [0, 1], and the offset of its corner from the
    anchor [px].
    """
    box = font(size, bold).getbbox(words, anchor=anchor)
    x, y = int(box[0]) - 1, int(box[1]) - 1
    image = Image.new("L", (int(box[2]) - x + 2, int(box[3]) - y + 2))
    ImageDraw.Draw(image).text((-x, -y), words, font=font(size, bold), fill=255, anchor=anchor)
    return np.asarray(image, dtype=np.float64) / 255.0, x, y


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
        # kept, for making one takes longer than drawing what a frame has
        self._lines: Any = LineCollection([], capstyle="butt", joinstyle="round")
        self._polygons: Any = PolyCollection([])
        for collection in (self._lines, self._polygons):
            collection.set_transform(Affine2D().scale(1, -1).translate(0, height))
            collection.set_figure(figure)
        # the frame, top row first, shape (height, width, 4)
        self.pixels: Bytes = np.asarray(agg.buffer_rgba())

    def load(self, picture: Bytes) -> None:
        """Start from a rendered picture, bottom row first, shape (height, width, 3)."""
        # a channel at a time: NumPy copies triples six times slower
        for channel in range(3):
            self.pixels[..., channel] = picture[::-1, :, channel]
        self.pixels[..., 3] = 255

    def strokes(self, strokes: Sequence[Stroke], box: Area | None = None) -> None:
        """Draw polylines in their order, only inside `box` if given."""
        self._lines.set_segments([stroke.points for stroke in strokes])
        self._lines.set_color([stroke.colour for stroke in strokes])
        # matplotlib pairs each width with each style that is set, also with those of the last call
        self._lines.set_linestyle("-")
        self._lines.set_linewidth([stroke.width * self.scale for stroke in strokes])
        if any(stroke.dashed for stroke in strokes):
            self._lines.set_linestyle(
                [(0.0, (4.0, 3.0)) if stroke.dashed else "-" for stroke in strokes]
            )
        self._draw(self._lines, box)

    def shapes(self, shapes: Sequence[Polygon], box: Area | None = None) -> None:
        """Draw filled polygons in their order, only inside `box` if given."""
        self._polygons.set_verts([shape.points for shape in shapes])
        self._polygons.set_facecolor([shape.fill for shape in shapes])
        self._polygons.set_edgecolor([shape.edge or (0, 0, 0, 0) for shape in shapes])
        self._polygons.set_linewidth([1.5 * self.scale if shape.edge else 0.0 for shape in shapes])
        self._draw(self._polygons, box)

    def _draw(self, collection: Collection, box: Area | None) -> None:
        left, top, width, height = box or (0, 0, self.width, self.height)
        collection.set_clip_box(Bbox.from_bounds(left, self.height - top - height, width, height))
        collection.draw(self._renderer)

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

    def image(self, rgba: Bytes, left: int, top: int) -> None:
        """Lay an image with straight alpha over the frame, bottom row first, shape (h, w, 4)."""
        self._renderer.draw_image(
            self._renderer.new_gc(), left, self.height - top - len(rgba), rgba
        )

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
        mask = mask[
            max(0, -top) : max(0, self.height - top), max(0, -left) : max(0, self.width - left)
        ]
        top = max(0, top)
        left = max(0, left)
        background = self.pixels[top : top + mask.shape[0], left : left + mask.shape[1], :3]
        share = (mask * (*colour, 1.0)[3])[..., None]
        background[:] = background + share * (255.0 * np.array(colour[:3]) - background) + 0.5

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
