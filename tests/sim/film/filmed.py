"""Shared by tests of the film: settings of small films, and a canvas that records what is drawn."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from laisn.arrays import Floats
from sim.film import canvas
from sim.film.canvas import Area, Canvas, Colour, Polygon, Stroke
from sim.scenario.settings import Video

WHITE: Colour = (1.0, 1.0, 1.0)


class RecordingCanvas(Canvas):
    """A canvas that records its draw calls."""

    def __init__(self, width: int = 1280, height: int = 720) -> None:
        super().__init__(width, height)
        self.lines: list[Floats] = []
        self.polygons: list[Floats] = []
        self.words: list[str] = []
        self.boxes: list[Area] = []
        """Areas of the words."""
        self.sizes: list[float] = []
        """Of their fonts [px]."""

    def strokes(self, strokes: Sequence[Stroke], box: Area | None = None) -> None:
        self.lines += [np.array(stroke.points) for stroke in strokes]

    def shapes(self, shapes: Sequence[Polygon], box: Area | None = None) -> None:
        self.polygons += [np.array(shape.points) for shape in shapes]

    def text(
        self,
        at: tuple[float, float],
        words: str,
        colour: Colour = (1, 1, 1),
        size: float = 14,
        anchor: str = "la",
    ) -> None:
        self.words.append(words)
        font = canvas.font(self.text_size(size), size < 0)
        left, top, right, bottom = font.getbbox(words, anchor=anchor)
        self.boxes.append((at[0] + left, at[1] + top, right - left, bottom - top))
        self.sizes.append(font.size)


def overlap(a: Area, b: Area) -> bool:
    """Whether two areas (left, top, width, height) have a point in common."""
    return not (
        a[0] + a[2] <= b[0] or b[0] + b[2] <= a[0] or a[1] + a[3] <= b[1] or b[1] + b[3] <= a[1]
    )


def small_video(**changes):
    """Settings of a film that renders quickly."""
    return Video(**({"width_px": 320, "height_px": 180, "speed_up": 20.0} | changes))


def with_estimate_moved_east(flight, metres):
    """A flight whose estimate is moved east by a number of metres."""
    estimates = tuple(
        dataclasses.replace(
            estimate,
            state=estimate.state + np.array([metres, 0, 0, 0]),
            covariance=estimate.covariance.copy(),
        )
        for estimate in flight.estimates
    )
    return dataclasses.replace(flight, estimates=estimates)
