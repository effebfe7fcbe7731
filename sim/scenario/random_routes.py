"""Follower routes drawn at random, in the classes by which the paper chose its own (Section 3)."""

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.geometry import signed_angle
from sim.scenario.point_motion import Motion, plan
from sim.scenario.routes import FOLLOWER_DEPTH, Route, library_route

_TRIES = 4000
"""Waypoints drawn for one route before the class counts as impossible; seldom more than 300 are needed."""
_CHECK_INTERVAL = 1.0
"""Distances to the leader are checked at this interval [s]."""


class RouteClass(NamedTuple):
    """What the routes of a class have in common.

    Waypoints are drawn in polar coordinates about the leader: its distance evenly, and its bearing evenly astern.
    """

    distance_max: float
    """Largest distance to the leader, at all times [m]."""
    leg_time: tuple[float, float]
    """Time from waypoint to waypoint, drawn evenly between [s]."""
    heading_difference_max: float
    """Largest angle of a leg to the leader's course at one of its ends, whichever is closer to the leg [rad]."""
    distance_min: float = 5.0
    bearings: tuple[float, float] = (float(np.deg2rad(100.0)), float(np.deg2rad(260.0)))
    """Relative bearings from the leader, clockwise from its bow [rad]."""
    speed_min: float = 0.3
    """Least mean speed of a leg [m/s]."""


CLASSES: dict[str, RouteClass] = {
    f"{distance}-{legs}-{headings}": RouteClass(
        distance_max=float(distance),
        leg_time={"near": (40.0, 80.0), "far": (120.0, 280.0)}[legs],
        heading_difference_max=float(np.deg2rad({"alike": 30.0, "drastic": 110.0}[headings])),
    )
    for distance, legs, headings in product((50, 100), ("near", "far"), ("alike", "drastic"))
}
"""The paper's constraints, combined: greatest distance to the leader, waypoints near or far apart, headings alike or
drastically different: "50-near-alike" … "100-far-drastic"."""


def _about(leader: Motion, i: int, rng: np.random.Generator, route_class: RouteClass) -> tuple[float, float]:
    """A point near the leader as it is at instant i: east and north [m]."""
    bearing = leader.course[i] + rng.uniform(*route_class.bearings)
    distance = rng.uniform(route_class.distance_min, route_class.distance_max)
    return float(leader.east[i] + distance * np.sin(bearing)), float(leader.north[i] + distance * np.cos(bearing))


def _acceptable(
    points: list[tuple[float, float, float]], route_class: RouteClass, time: Floats, leader: Motion
) -> bool:
    """Whether the route through all points so far can be flown and keeps to its class."""
    route = Route.timed("random", points, FOLLOWER_DEPTH, start_heading=float(leader.course[0]))
    if route.leg_speed[-1] < route_class.speed_min:
        return False
    leg = np.arctan2(*(route.waypoint[-1] - route.waypoint[-2]))
    ends = np.searchsorted(time, route.time[-2:] - 1e-9)
    off = np.abs(signed_angle(leader.course[ends] - leg))
    if off.min() > route_class.heading_difference_max:
        return False
    try:
        motion = plan(route).at(time[: ends[1] + 1])
    except LaisnError:
        return False
    n = motion.east.size
    distance = np.hypot(motion.east - leader.east[:n], motion.north - leader.north[:n])
    return bool(distance.min() >= route_class.distance_min and distance.max() <= route_class.distance_max)


def random_route(rng: np.random.Generator, route_class: RouteClass, duration: float = 1000.0) -> Route:
    """A follower's route about the leader's L that the vehicle can fly; what it cannot fly is drawn again.

    Args:
        rng: source of randomness; the route is a function of its state.
        route_class: what the route keeps to, from its start to `duration`.
        duration: time of the last waypoint [s].

    Raises:
        LaisnError: no route of the class was found.
    """
    time = np.arange(0.0, duration + _CHECK_INTERVAL, _CHECK_INTERVAL)
    moving = plan(library_route("L")).at(time)
    start = (0.0, *_about(moving, 0, rng, route_class))
    points, failed = [start], 0
    for _ in range(_TRIES):
        due = points[-1][0] + rng.uniform(*route_class.leg_time)
        # whole seconds lie on the grid of the check; what would leave a short last leg goes to the end
        due = duration if due > duration - route_class.leg_time[0] else float(round(due))
        candidate = (due, *_about(moving, int(np.searchsorted(time, due - 1e-9)), rng, route_class))
        if _acceptable([*points, candidate], route_class, time, moving):
            points.append(candidate)
            failed = 0
        else:
            failed += 1
        if points[-1][0] == duration:
            return Route.timed("random", points, FOLLOWER_DEPTH, start_heading=float(moving.course[0]))
        if failed == 100:
            # a dead end: take back the last legs, or draw another start
            points = points[:-2] if len(points) > 2 else [(0.0, *_about(moving, 0, rng, route_class))]
            failed = 0
    raise LaisnError(f"no route found in {_TRIES} tries; {route_class} exceeds the limits of the vehicle")


def random_waypoints(name: str, address: Sequence[int]) -> tuple[tuple[float, float, float], ...]:
    """Waypoints of a drawn route that can also be flown from the course of its first leg: time [s], east, north [m].

    Args:
        name: of one of CLASSES.
        address: key of the random numbers.

    Raises:
        LaisnError: no such route was found.
    """
    for attempt in range(100):
        route = random_route(np.random.default_rng([*address, attempt]), CLASSES[name])
        points = np.column_stack([route.time, route.waypoint.round(1)])
        try:
            plan(Route.timed(name, points, FOLLOWER_DEPTH))
        except LaisnError:
            continue
        return tuple((float(t), float(x), float(y)) for t, x, y in points)
    raise LaisnError(f"no route of class {name} can be flown")
