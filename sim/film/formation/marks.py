"""Lines in the water that show a formation: a ring where each follower should be, and the two nearest vehicles."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats

STATION = (0.45, 1.0, 1.0)
"""Colour of stations."""
APART = (1.0, 1.0, 1.0)
"""Colour of the line between the two nearest vehicles."""

_RADIUS_M = 1.0
_RADIUS_PX = 9.0
"""Least radius of a ring: a smaller one would lie under the marker of its follower."""
_RING = np.linspace(0.0, 2 * np.pi, 33)
_DASHES = 7
"""Dashes of the line between the nearest vehicles."""


class Mark(NamedTuple):
    """A polyline in the water."""

    points: Floats
    """Shape (p, 3), [m]."""
    colour: tuple[float, float, float]
    opacity: float
    width: float
    """At 720 rows [px]."""


def of_stations(stations: Floats, hydrophones: Floats, metres_per_pixel: Callable[[Floats], float]) -> list[Mark]:
    """A level ring about each station, large enough to be seen, and a line to it from the follower's hydrophone.

    Args:
        stations: shape (f, 3), [m]; NaN for followers without one.
        hydrophones: shape (f, 3), [m].
        metres_per_pixel: at a place of shape (3,), in a frame of 720 rows [m].
    """
    found = []
    for station, place in zip(stations, hydrophones, strict=True):
        if np.isfinite(station).all():
            radius = max(_RADIUS_M, _RADIUS_PX * metres_per_pixel(station))
            ring = station + radius * np.column_stack([np.cos(_RING), np.sin(_RING), np.zeros(_RING.size)])
            found += [Mark(ring, STATION, 0.22, 7.0), Mark(ring, STATION, 0.75, 1.5)]
            found.append(Mark(np.array([station, place]), STATION, 0.5, 1.0))
    return found


def nearest(positions: Floats) -> Floats:
    """The two of several points, shape (v, 3), that are nearest to each other, shape (2, 3)."""
    first, second = np.triu_indices(len(positions), 1)
    pair = int(np.argmin(np.linalg.norm(positions[first] - positions[second], axis=1)))
    return positions[[first[pair], second[pair]]]


def between(ends: Floats) -> list[Mark]:
    """A dashed line between two points, shape (2, 3), [m]."""
    places = ends[0] + np.linspace(0.0, 1.0, 2 * _DASHES)[:, None] * (ends[1] - ends[0])
    return [Mark(places[i : i + 2], APART, 0.9, 1.6) for i in range(0, len(places), 2)]
