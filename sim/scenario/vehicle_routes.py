"""Routes and depths of the vehicles of a scenario."""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, Protocol, Self

from laisn.errors import LaisnError
from sim.scenario.routes import DepthProfile, Route, library_route
from sim.scenario.settings import Vehicle


class _Depths(Protocol):
    """What the depth of a vehicle follows from."""

    @property
    def held_depth_m(self) -> float: ...
    @property
    def depth_profile(self) -> tuple[tuple[float, float], ...]: ...
    @property
    def saw_tooth_amplitude_m(self) -> float: ...
    @property
    def saw_tooth_period_s(self) -> float: ...


class DepthKeys(NamedTuple):
    """Keys of a vehicle that its depth follows from."""

    held_depth_m: float
    depth_profile: tuple[tuple[float, float], ...]
    saw_tooth_amplitude_m: float
    saw_tooth_period_s: float

    @classmethod
    def of(cls, vehicle: _Depths) -> Self:
        """Those of a vehicle."""
        return cls(*(getattr(vehicle, key) for key in cls._fields))


class _RouteKeys(NamedTuple):
    """Keys of a vehicle that its route follows from."""

    route: str | None
    waypoints: tuple[tuple[float, float, float], ...]
    start_speed_m_s: float | None
    held_depth_m: float
    depth_profile: tuple[tuple[float, float], ...]
    saw_tooth_amplitude_m: float
    saw_tooth_period_s: float


def depth_profile_of(vehicle: _Depths) -> DepthProfile:
    """Depth of a vehicle over time."""
    if vehicle.depth_profile:
        return DepthProfile.through(vehicle.depth_profile)
    if vehicle.saw_tooth_amplitude_m > 0:
        return DepthProfile.saw_tooth(
            vehicle.held_depth_m, vehicle.saw_tooth_amplitude_m, vehicle.saw_tooth_period_s
        )
    return DepthProfile.constant(vehicle.held_depth_m)


def route_of(vehicle: Vehicle, name: str) -> Route:
    """Route of one vehicle; LaisnError if the library has no route `vehicle.route`, or if waypoints
    that begin with a stop have a start speed.

    `name` is for messages, and the name of a route of own waypoints. Calls with equal keys and name
    give the same object, and so the same plan.
    """
    return _route_of(_RouteKeys(*(getattr(vehicle, key) for key in _RouteKeys._fields)), name)


@lru_cache(maxsize=256)
def _route_of(keys: _RouteKeys, name: str) -> Route:
    speed = keys.start_speed_m_s
    if not keys.waypoints:
        assert keys.route is not None  # the scenario's validation
        route = library_route(keys.route, depth_profile_of(keys))
        return route if speed is None else replace(route, start_speed=speed)
    route = Route.timed(name, keys.waypoints, depth_profile_of(keys), start_speed=speed)
    if speed is not None and route.start_speed != speed:
        raise LaisnError(
            f"route {name!r}: it begins with a stop, which start_speed_m_s = {speed:g} contradicts"
        )
    return route
