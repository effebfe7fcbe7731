"""What a film shows of followers on stations: where each should be, and the two nearest vehicles.

Takes a flight, positions of vehicles and a scale; gives lines in the water, which the overlay draws.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from sim.film.annotations import RGB
from sim.flight import Flight
from sim.station_keeping import true_stations

STATION: RGB = (0.45, 1.0, 1.0)
"""Colour of stations."""
NEAREST: RGB = (1.0, 1.0, 1.0)
"""Colour of the line between the two nearest vehicles."""

_RADIUS_M = 1.0
_RADIUS_PX = 9.0
"""Least radius of a ring: a smaller one would lie under the marker of its follower."""
_RING = np.linspace(0.0, 2 * np.pi, 33)


class WorldLine(NamedTuple):
    """A polyline in the water."""

    points: Floats
    """Shape (p, 3), [m]."""
    colour: RGB
    opacity: float
    width: float
    """At 720 rows [px]."""


class Stations:
    """True stations of the followers of a flight; those that keep to routes have none.

    Args:
        flight: of f followers.
    """

    def __init__(self, flight: Flight) -> None:
        followers, truth = flight.scenario.followers, flight.trajectory
        self._flight = flight
        self._kept = np.array([follower.station is not None for follower in followers])
        self._stations = np.full((truth.time.size, len(followers), 3), np.nan)
        if self:
            self._stations[..., :2] = true_stations(flight.scenario, truth)[..., :2]
            self._stations[..., 2] = [-f.station.depth_m if f.station else np.nan for f in followers]
            self._stations[:, ~self._kept] = np.nan

    def __bool__(self) -> bool:
        """Whether any follower keeps a station."""
        return bool(self._kept.any())

    def at(self, time: float) -> Floats:
        """Stations at mission time `time` [s], shape (f, 3), [m]; NaN for a follower on a route."""
        truth = self._flight.trajectory
        place = (time - float(truth.time[0])) / truth.dt
        i = min(max(int(place), 0), truth.time.size - 1)
        before, after = self._stations[i], self._stations[min(i + 1, truth.time.size - 1)]
        return np.asarray(before + (place - i) * (after - before))

    def error(self, follower: int) -> Floats | None:
        """Horizontal distance from its station at filter steps, shape (n,), [m]; None for a follower on a route."""
        if not self._kept[follower]:
            return None
        station = self._stations[self._flight.step_index(), follower, :2]
        return np.asarray(np.linalg.norm(self._flight.hydrophone(follower)[:, :2] - station, axis=1))


def station_rings(
    stations: Floats, hydrophones: Floats, metres_per_pixel: Callable[[Floats], float]
) -> list[WorldLine]:
    """A level ring about each station, large enough to be seen, and a line to it from the follower's hydrophone.

    Args:
        stations: shape (f, 3), [m]; NaN for followers without one.
        hydrophones: shape (f, 3), [m].
        metres_per_pixel: at a position of shape (3,), in a frame of 720 rows [m].
    """
    found = []
    for station, hydrophone in zip(stations, hydrophones, strict=True):
        if np.isfinite(station).all():
            radius = max(_RADIUS_M, _RADIUS_PX * metres_per_pixel(station))
            ring = station + radius * np.column_stack([np.cos(_RING), np.sin(_RING), np.zeros(_RING.size)])
            found += [WorldLine(ring, STATION, 0.22, 7.0), WorldLine(ring, STATION, 0.75, 1.5)]
            found.append(WorldLine(np.array([station, hydrophone]), STATION, 0.5, 1.0))
    return found


def nearest(positions: Floats) -> Floats:
    """The two of several points, shape (v, 3), that are nearest to each other, shape (2, 3)."""
    first, second = np.triu_indices(len(positions), 1)
    pair = int(np.argmin(np.linalg.norm(positions[first] - positions[second], axis=1)))
    return positions[[first[pair], second[pair]]]


def dashes(ends: Floats, number: int) -> list[Floats]:
    """A line between two points, shape (2, d), as so many dashes and gaps of equal length, each of shape (2, d)."""
    points = ends[0] + np.linspace(0.0, 1.0, 2 * number)[:, None] * (ends[1] - ends[0])
    return [points[i : i + 2] for i in range(0, len(points), 2)]
