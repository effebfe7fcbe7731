"""Labels of what a frame shows: each beside its point, clear of panels, of markers and of one another."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.film.canvas import Canvas, Colour, Place, Shape, Stroke, corners

_SIZE = 13
_GAP = 3.0
_MARKER = 8.0
"""Half the side of the square that a marker keeps free, at 720 rows [px]."""
_STEP = 22.0
"""Distance from one row of places for labels to the next, at 720 rows [px]."""
_ROWS = 5
_ASIDE = (16.0, 70.0)
_GROUND: Colour = (0.0, 0.05, 0.08, 0.55)
_FOOT = 24.0
"""Height of the strip at the lower edge that belongs to the footer, at 720 rows [px]."""


class Label(NamedTuple):
    """Words for a point of the frame."""

    at: Floats
    """Place of the label on the frame, shape (2,), [px]."""
    words: str
    colour: Colour
    rise: float
    """Length of the line to the words [px]; above the point if negative, below it if positive."""


def _overlap(a: Place, b: Place) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def _places(label: Label, width: float, height: float, scale: float) -> list[tuple[Place, Floats]]:
    """Places for the words, the most wanted first, with the end of the line that leads there."""
    found = []
    rows = [
        side * label.rise + np.sign(side * label.rise) * _STEP * scale * n for side in (1, -1) for n in range(_ROWS)
    ]
    for aside in _ASIDE:
        for rise in rows:
            for way in (1.0, -1.0):
                end = label.at + np.array([aside * scale * way, rise])
                left = end[0] + 2 * scale if way > 0 else end[0] - 2 * scale - width
                found.append(((float(left), float(end[1] - height / 2), width, height), end))
    return found


def place(labels: Iterable[Label], taken: Iterable[Place], canvas: Canvas) -> list[tuple[Label, Place, Floats]]:
    """Place labels by a pure function of one frame, so that frames may be drawn in any order.

    Args:
        labels: the most important first.
        taken: areas that labels must keep clear of.
        canvas: measures the words.

    Returns:
        Each label with its area and the end of its line, shape (2,), [px]; labels without room are left out.
    """
    s = canvas.scale
    labels, full = list(labels), list(taken)
    full.append((0.0, canvas.height - _FOOT * s, float(canvas.width), _FOOT * s))
    half = _MARKER * s
    markers = [(float(m.at[0]) - half, float(m.at[1]) - half, 2 * half, 2 * half) for m in labels]
    placed = []
    for label in labels:
        width, height = canvas.extent(label.words, -_SIZE)
        width, height = width + 2 * _GAP * s, height + 2 * _GAP * s
        for area, end in _places(label, width, height, s):
            left, top = area[:2]
            inside = left >= 0 and top >= 0 and left + width <= canvas.width and top + height <= canvas.height
            if inside and not any(_overlap(area, other) for other in (*full, *markers)):
                full.append(area)
                placed.append((label, area, end))
                break
    return placed


def plates(canvas: Canvas, texts: Sequence[tuple[str, Colour, float, float]]) -> None:
    """Draw texts, each with its colour and the left and upper edge [px] of its dark ground."""
    gap, extents = _GAP * canvas.scale, [canvas.extent(words, -_SIZE) for words, *_ in texts]
    canvas.shapes([Shape(corners((left, top, width + 2 * gap, height + 2 * gap)), _GROUND)
                   for (_, _, left, top), (width, height) in zip(texts, extents, strict=True)])  # fmt: skip
    for (words, colour, left, top), (_, height) in zip(texts, extents, strict=True):
        canvas.text((left + gap, top + gap + height / 2), words, colour, -_SIZE, "lm")


def draw(labels: Iterable[Label], taken: Iterable[Place], canvas: Canvas) -> None:
    """Put labels on the canvas, each at the end of a line from its point."""
    placed = place(labels, taken, canvas)
    starts = [label.at + canvas.scale * np.array([4.0, 7.5]) * np.sign(end - label.at) for label, _, end in placed]
    canvas.strokes([Stroke(np.array([start, end]), (*label.colour[:3], 0.8), 1.2)
                    for start, (label, _, end) in zip(starts, placed, strict=True)])  # fmt: skip
    plates(canvas, [(label.words, label.colour, area[0], area[1]) for label, area, _ in placed])
