"""The part of the plane, and the time, that a mission may need of a field."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats
from sim.scenario.parts import MissionPlan
from sim.scenario.routes import library_route
from sim.scenario.settings import Vehicle

# vehicles may be off their routes, and draw aside in formations
_MARGIN_M = 1000.0


class Region(NamedTuple):
    """A rectangle, in coordinates from the origin, and a time from the start."""

    west: float  # [m]
    east: float
    south: float
    north: float
    end_time: float  # [s]

    def within(self, positions: Floats) -> Bools:
        """Which of the places, shape (n, 2), [m], are in it."""
        x, y = positions.T
        level = (x >= self.west) & (x <= self.east)
        return np.asarray(level & (y >= self.south) & (y <= self.north))

    def holds(self, positions: Floats) -> bool:
        """Whether all places, shape (n, 2), [m], are in it."""
        return bool(self.within(positions).all())


@lru_cache(maxsize=32)
def _library_waypoints(name: str) -> tuple[Floats, Floats]:
    """Times [s] and places of a route of the library, read-only."""
    route = library_route(name)
    return route.time, route.waypoint


def _waypoints(vehicle: Vehicle, duration: float) -> Floats:
    """Places of a route until a time [s], shape (n, 2), [m]; after the last waypoint it goes
    straight on.
    """
    if vehicle.waypoints:
        points = np.array(vehicle.waypoints)
        time = points[:, 0]
        positions = points[:, 1:]
    elif vehicle.route is not None:
        time, positions = _library_waypoints(vehicle.route)
    else:
        return np.zeros((0, 2))
    path = positions[: int(np.searchsorted(time, duration)) + 1]
    if duration <= time[-1] or len(positions) < 2:
        return np.asarray(path)
    step = positions[-1] - positions[-2]
    beyond = positions[-1] + step * (duration - time[-1]) / (time[-1] - time[-2])
    return np.vstack([path, beyond])


def region_of(plan: MissionPlan, margin: float = _MARGIN_M) -> Region:
    """What a mission may need: its routes and stations, and a margin [m] about them."""
    reach = 0.0
    places = []
    for _, vehicle in plan.vehicles():
        station = getattr(vehicle, "station", None)
        places.append(_waypoints(vehicle, plan.duration_s))
        if station is not None:
            reach = max(reach, float(np.hypot(station.behind_m, station.port_m)))
            start = getattr(vehicle, "start_m", None)
            if start is not None:
                places.append(np.array([start]))
    all_positions = np.vstack(places)
    west, south = all_positions.min(axis=0) - (reach + margin)
    east, north = all_positions.max(axis=0) + (reach + margin)
    return Region(float(west), float(east), float(south), float(north), plan.duration_s)
