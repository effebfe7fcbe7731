"""A plan made into routes and vehicles."""

from functools import lru_cache

import numpy as np

from laisn.arrays import Floats
from sim.scenario.parts import MissionPlan
from sim.scenario.point_motion import SPEED_MIN
from sim.scenario.routes import Route
from sim.scenario.settings import Follower, Leader
from sim.scenario.vehicle_routes import DepthKeys, depth_profile_of, route_of
from sim.vehicle.mjcf import VehicleSetup, transmitter_places


def are_at_baseline_and_offset(sites: Floats) -> bool:
    """Whether rear, front and middle transmitter, shape (3, 3), [m], are at (−L/2, 0, 0),
    (L/2, 0, 0) and (0, H, 0) with L, H > 0, as a baseline L and an offset H put them.
    """
    half_baseline = sites[1, 0]
    port_offset = sites[2, 1]
    return bool(
        half_baseline > 0
        and port_offset > 0
        and np.array_equal(
            sites, [[-half_baseline, 0, 0], [half_baseline, 0, 0], [0, port_offset, 0]]
        )
    )


def _initial_route_of_station(follower: Follower, duration_s: float, leader: Route) -> Route:
    """Where a follower on a station begins, and how: beside the leader, as if its trail had been
    straight. Calls with equal results give the same object, and so the same plan.
    """
    assert follower.station is not None
    ahead = leader.initial_direction
    # a leg's direction has any length; that of a heading is 1
    if leader.start_heading is None:
        ahead = ahead / np.hypot(*ahead)
    port = np.array([-ahead[1], ahead[0]])
    start = leader.waypoint[0] - follower.station.behind_m * ahead + follower.station.port_m * port
    if follower.start_m is not None:
        start = np.array(follower.start_m)
    # a route needs a speed: of one that starts at rest, the least
    speed = leader.start_speed if follower.start_speed_m_s is None else follower.start_speed_m_s
    speed = speed or SPEED_MIN
    end = start + max(duration_s, 1.0) * speed * ahead
    points = (tuple(start.tolist()), tuple(end.tolist()))
    return _straight_route(follower.name, points, speed, DepthKeys.of(follower))


@lru_cache(maxsize=256)
def _straight_route(
    name: str, points: tuple[tuple[float, ...], ...], speed: float, depths: DepthKeys
) -> Route:
    return Route.at_speed(name, points, speed, depth_profile_of(depths))


def routes_of(plan: MissionPlan) -> tuple[Route, ...]:
    """Routes of all vehicles, the leader's first; followers on stations go straight on from where
    they begin. LaisnError names vehicle and waypoint.
    """
    leader = route_of(plan.leader, "leader")
    return (
        leader,
        *(
            _initial_route_of_station(f, plan.duration_s, leader)
            if f.station
            else route_of(f, f.name)
            for f in plan.followers
        ),
    )


def setups_of(
    plan: MissionPlan, routes: tuple[Route, ...], transmitter_keys: Leader | None = None
) -> tuple[VehicleSetup, ...]:
    """All vehicles at the start of their routes.

    `transmitter_keys` is the leader's table, whose baseline and offset place its transmitters;
    None: they are where its hull has them.
    """
    vehicles = (plan.leader, *plan.followers)
    of_leader = {} if transmitter_keys is None else transmitter_places(transmitter_keys)
    places = [of_leader, *[{}] * len(plan.followers)]
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
            transmitters=sites,
        )
        for vehicle, name, model, route, sites in zip(
            vehicles, plan.names, plan.models, routes, places, strict=True
        )
    )
