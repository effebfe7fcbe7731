"""A scenario made into sea, routes and vehicles."""

import numpy as np

from laisn.arrays import Floats
from sim.scenario.point_motion import SPEED_MIN
from sim.scenario.routes import Route
from sim.scenario.settings import Follower, Scenario
from sim.scenario.vehicle_routes import depth_profile_of, route_of
from sim.vehicle.mjcf import VehicleSetup


def vehicle_names(scenario: Scenario) -> tuple[str, ...]:
    """All vehicles, the leader first."""
    return ("leader", *(f.name for f in scenario.followers))


def models_of(scenario: Scenario) -> tuple[str, ...]:
    """Models of all vehicles as `VehicleSetup` takes them, the leader's first."""
    return (scenario.leader.model or "leader", *(f.model or "follower" for f in scenario.followers))


def on_axis(sites: Floats) -> bool:
    """Whether rear, front and middle transmitter, shape (3, 3), [m], are where a baseline and an
    offset put them.
    """
    half = sites[1, 0]
    aside = sites[2, 1]
    return bool(
        half > 0
        and aside > 0
        and np.array_equal(sites, [[-half, 0, 0], [half, 0, 0], [0, aside, 0]])
    )


def _initial_route_of_station(follower: Follower, scenario: Scenario, leader: Route) -> Route:
    """Where a follower on a station begins, and how: beside the leader, as if its trail had been
    straight.
    """
    assert follower.station is not None
    ahead = leader.initial_direction
    if leader.start_heading is None:
        ahead = ahead / np.hypot(*ahead)
    port = np.array([-ahead[1], ahead[0]])
    start = leader.waypoint[0] - follower.station.behind_m * ahead + follower.station.port_m * port
    if follower.start_m is not None:
        start = np.array(follower.start_m)
    # a route has legs; a follower that starts at rest begins to move at once
    speed = leader.start_speed if follower.start_speed_m_s is None else follower.start_speed_m_s
    speed = speed or SPEED_MIN
    points = [start, start + max(scenario.duration_s, 1.0) * speed * ahead]
    return Route.at_speed(follower.name, points, speed, depth_profile_of(follower))


def routes_of(scenario: Scenario) -> tuple[Route, ...]:
    """Routes of all vehicles, the leader's first, from stations straight on; LaisnError names
    vehicle and waypoint.
    """
    leader = route_of(scenario.leader, "leader")
    return (
        leader,
        *(
            _initial_route_of_station(f, scenario, leader) if f.station else route_of(f, f.name)
            for f in scenario.followers
        ),
    )


def setups_of(scenario: Scenario, routes: tuple[Route, ...]) -> tuple[VehicleSetup, ...]:
    """All vehicles at the start of their routes."""
    vehicles = (scenario.leader, *scenario.followers)
    return tuple(
        VehicleSetup(
            name=name,
            model=model,
            position_m=(
                float(route.waypoint[0, 0]),
                float(route.waypoint[0, 1]),
                -float(route.depth.depth[0]),
            ),
            heading_rad=route.initial_heading,
            speed_m_s=route.start_speed,
            settings=vehicle,
        )
        for vehicle, name, model, route in zip(
            vehicles, vehicle_names(scenario), models_of(scenario), routes, strict=True
        )
    )
