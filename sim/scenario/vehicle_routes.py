"""Routes and depths of the vehicles of a scenario."""

from dataclasses import replace

from laisn.errors import LaisnError
from sim.scenario.routes import DepthProfile, Route, library_route
from sim.scenario.settings import Vehicle


def depth_profile_of(vehicle: Vehicle) -> DepthProfile:
    """Depth of a vehicle over time."""
    if vehicle.depth_profile:
        return DepthProfile.through(vehicle.depth_profile)
    if vehicle.saw_tooth_amplitude_m > 0:
        return DepthProfile.saw_tooth(
            vehicle.layer_m, vehicle.saw_tooth_amplitude_m, vehicle.saw_tooth_period_s
        )
    return DepthProfile.constant(vehicle.layer_m)


def route_of(vehicle: Vehicle, name: str) -> Route:
    """Route of one vehicle; LaisnError if the library has none of that name, or if it begins with
    a stop at a speed.
    """
    speed = vehicle.start_speed_m_s
    if not vehicle.waypoints:
        assert vehicle.route is not None  # the scenario's validation
        route = library_route(vehicle.route, depth_profile_of(vehicle))
        return route if speed is None else replace(route, start_speed=speed)
    route = Route.timed(name, vehicle.waypoints, depth_profile_of(vehicle), start_speed=speed)
    if speed is not None and route.start_speed != speed:
        raise LaisnError(
            f"route {name!r}: it begins with a stop, which start_speed_m_s = {speed:g} contradicts"
        )
    return route
