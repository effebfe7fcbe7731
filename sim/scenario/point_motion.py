"""The paper's point motion: turns at 10°/s, changes of speed at 0.2 m/s² (Section 3). Analytic,
exact at any instant.

A route becomes a plan of segments on which acceleration and turn rate are constant and one of them
is zero:

    turn out of the last corner │ ramp to the leg's speed │ constant speed │ half of the next turn …

Corners are cut by the arc that touches both legs; its middle is the arrival at the waypoint, at its
time. Before a stop the leg ends with a ramp down to rest; after it the vehicle turns on the spot.
Follower routes are drawn at random in the classes of the paper (Section 3).
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.geometry import signed_angle
from sim.scenario.routes import FOLLOWER_DEPTH, SPEED_MAX, Route, library_route

TURN_RATE = float(np.deg2rad(10.0))  # turn rate in every turn [rad/s] (paper, Section 3)
ACCELERATION = 0.2  # rate of every change of speed [m/s²] (paper, Section 3)
SPEED_MIN = 0.1  # a leg with less is refused: a hull without way cannot be steered along it [m/s]
# sharper corners are not cut: the arc would begin far ahead [rad]
SHARPEST_CUT = float(np.deg2rad(135.0))


class PlannedMotion(NamedTuple):
    """Motion on a time grid, each of shape (n,)."""

    east: Floats  # [m]
    north: Floats  # [m]
    course: Floats  # compass direction of motion, continuous (not wrapped) [rad]
    speed: Floats  # over ground [m/s]
    turn_rate: Floats  # rate of turn, clockwise [rad/s]
    acceleration: Floats  # change of the speed over time [m/s²]


def _later(begin: PlannedMotion, dt: Floats | float) -> PlannedMotion:
    """Motion a time dt [s] after the beginning of a segment; numbers or arrays of one shape."""
    speed = begin.speed + begin.acceleration * dt
    # on an arc the chord points along the mean course and is sin(half)/half of the arc long
    half_turn = 0.5 * begin.turn_rate * dt
    chord = 0.5 * (begin.speed + speed) * dt * np.sinc(half_turn / np.pi)
    return begin._replace(
        east=begin.east + chord * np.sin(begin.course + half_turn),
        north=begin.north + chord * np.cos(begin.course + half_turn),
        course=begin.course + begin.turn_rate * dt,
        speed=speed,
    )


class Plan(NamedTuple):
    """Segments of constant acceleration and turn rate, each array of shape (m,); the last one
    has no end. Fields are those of `PlannedMotion` at the beginning of each.
    """

    start: Floats  # time at which the segment begins [s]
    east: Floats
    north: Floats
    course: Floats
    speed: Floats
    turn_rate: Floats
    acceleration: Floats

    def at(self, time: Floats) -> PlannedMotion:
        """Motion at instants of shape (n,), not negative, [s]."""
        i = np.searchsorted(self.start, time, side="right") - 1
        begin = PlannedMotion(*(column[i] for column in self[1:]))
        return _later(begin, time - self.start[i])


class _Planner:
    """Appends segments, rows of `Plan`, and keeps time and motion at the end of the last one;
    `least_radius` is that of turns [m].
    """

    def __init__(
        self, east: float, north: float, course: float, speed: float, least_radius: float
    ) -> None:
        self.rows: list[tuple[float, ...]] = []
        self.least_radius = least_radius
        self.time = 0.0
        self.east = east
        self.north = north
        self.course = course
        self.speed = speed

    @property
    def turn_rate(self) -> float:
        """Rate of the next turn [rad/s]."""
        tight = self.speed < self.least_radius * TURN_RATE
        return self.speed / self.least_radius if tight and self.speed > 0.0 else TURN_RATE

    def go(self, duration: float, turn_rate: float = 0.0, acceleration: float = 0.0) -> None:
        """One more segment; one of no duration is left out."""
        if duration <= 0:
            return
        begin = self.east, self.north, self.course, self.speed, turn_rate, acceleration
        self.rows.append((self.time, *begin))
        # the rounding of times is that of `Plan.at`
        end = _later(PlannedMotion(*begin), self.time + duration - self.time)  # type: ignore[arg-type]  # numbers of one instant
        self.time += duration
        self.east, self.north, self.course, self.speed = (float(value) for value in end[:4])


def _turn_towards(planner: _Planner, point: list[float]) -> float:
    """Signed turn [rad] after which the vehicle heads for a point; NaN if the point lies within
    the turning circle.
    """
    radius = max(planner.speed / TURN_RATE, planner.least_radius)
    course = planner.course
    dx, dy = point[0] - planner.east, point[1] - planner.north
    side = 1.0 if signed_angle(np.arctan2(dx, dy) - course) >= 0 else -1.0
    # the circle's centre lies abeam; seen from there the point is at distance d and bearing b
    cx, cy = dx - side * radius * np.cos(course), dy + side * radius * np.sin(course)
    d = np.hypot(cx, cy)
    b = np.arctan2(cx, cy)
    if d <= radius:
        return float("nan")
    turn = side * (b - course) + np.arcsin(radius / d)
    return side * float(turn % (2 * np.pi)) if abs(signed_angle(turn)) > 1e-12 else 0.0


def _leg_speed(distance: float, time: float, speed: float) -> float:
    """Speed v after a ramp for `distance` in `time`, d = v t ∓ (v − speed)² / (2 acceleration);
    NaN: there is none.
    """
    missing = distance - speed * time
    root = time * time - 2.0 * abs(missing) / ACCELERATION
    if time <= 0 or root < 0:
        return float("nan")
    return speed + float(np.copysign(ACCELERATION * (time - np.sqrt(root)), missing))


def _leg_speed_to_rest(distance: float, time: float, speed: float) -> float:
    """Speed as of `_leg_speed`, with a ramp to rest at the end, d = … − v² / (2 acceleration)."""
    if time <= 0:
        return float("nan")
    if distance < speed * time - 0.5 * speed**2 / ACCELERATION:
        spare = time - speed / ACCELERATION
        return (distance - 0.5 * speed**2 / ACCELERATION) / spare if spare > 0 else float("nan")
    # 2 v² − 2 (speed + acceleration time) v + speed² + 2 acceleration distance = 0
    half_sum = 0.5 * (speed + ACCELERATION * time)
    root = half_sum**2 - 0.5 * speed**2 - ACCELERATION * distance
    return half_sum - float(np.sqrt(root)) if root >= 0 else float("nan")


def _leg(route: Route, k: int, planner: _Planner, cut: float) -> tuple[float, float]:
    """Speed [m/s], and time at it [s], on the straight way to waypoint k, whose corner of `cut`
    [rad] is to be cut.
    """
    where = f"route {route.name!r}, waypoint {k + 1}"
    east, north = route.waypoint[k, 0] - planner.east, route.waypoint[k, 1] - planner.north
    straight = float(east * np.sin(planner.course) + north * np.cos(planner.course))
    # along the arc to its middle the way is shorter than to the corner by speed × saved [s]
    saved = (np.tan(cut / 2) - cut / 2) / TURN_RATE
    time_left = float(route.time[k]) - planner.time
    stops = _stops(route, k)
    leg_speed = _leg_speed_to_rest if stops else _leg_speed
    speed = leg_speed(straight, time_left + saved, planner.speed)
    if speed < planner.least_radius * TURN_RATE:
        # on an arc of that radius, what it saves is a distance
        shorter = straight - planner.least_radius * saved * TURN_RATE
        speed = leg_speed(shorter, time_left, planner.speed)
    if not SPEED_MIN <= speed <= SPEED_MAX * (1 + 1e-9):
        requirement = (
            f"{max(straight, 0.0) / time_left:.3g} m/s on average" if time_left > 0 else "more time"
        )
        raise LaisnError(
            f"{where}: {requirement} required after {planner.speed:.3g} m/s; out of reach with "
            f"{ACCELERATION:.3g} m/s² and speeds from {SPEED_MIN} to {SPEED_MAX:.3g} m/s"
        )
    ramp = abs(speed - planner.speed) / ACCELERATION
    radius = max(speed / TURN_RATE, planner.least_radius)
    braking = 0.5 * speed**2 / ACCELERATION if stops else 0.0
    spare = straight - radius * np.tan(cut / 2) - 0.5 * (planner.speed + speed) * ramp - braking
    if spare < -1e-9:
        raise LaisnError(
            f"{where}: a leg of {route.leg_length[k - 1]:.3g} m is {-spare:.3g} m too short for "
            f"its changes of speed and course: {planner.speed:.3g} to {speed:.3g} m/s, then a turn "
            f"of {np.rad2deg(cut):.0f}° (radius {radius:.3g} m)"
        )
    return speed, float(spare / speed)


def _stops(route: Route, k: int) -> bool:
    """Whether the vehicle stays at waypoint k, counted from 0, for a while."""
    return k < route.leg_length.size and route.leg_length[k] == 0


@lru_cache(maxsize=256)
def plan(route: Route, least_radius: float = 0.0) -> Plan:
    """The motion along a route, on time at every waypoint, with turns of a least radius [m], in
    arrays that cannot be written.

    LaisnError if the vehicle cannot fly the route; names the route, the waypoint (counted from 1),
    what it requires and the limit.
    """
    points = route.waypoint.tolist()
    course = np.arctan2(*np.diff(route.waypoint, axis=0).T).tolist()
    start = route.initial_heading
    east, north = points[0]
    planner = _Planner(east, north, start, route.start_speed, least_radius)
    # the turn that leads from the last corner to the next leg; a start off the first leg is such a
    # corner
    begins_aside = not _stops(route, 0) and abs(signed_angle(course[0] - start)) > 1e-12
    turn = _turn_towards(planner, points[1]) if begins_aside else 0.0
    for k in range(1, len(points)):
        if _stops(route, k - 1):
            planner.go(float(route.time[k]) - planner.time)
            turn = (
                0.0
                if k == len(course) or _stops(route, k)
                else signed_angle(course[k] - planner.course)
            )
            continue
        if np.isnan(turn):
            raise LaisnError(
                f"route {route.name!r}, waypoint {k + 1}: it lies within the turning circle of "
                f"{max(planner.speed / TURN_RATE, least_radius):.3g} m radius that begins at "
                f"waypoint {k}"
            )
        planner.go(
            abs(turn) / planner.turn_rate, turn_rate=float(np.copysign(planner.turn_rate, turn))
        )
        corner = (
            signed_angle(course[k] - planner.course)
            if k < len(course) and not _stops(route, k)
            else 0.0
        )
        cut = abs(corner) if abs(corner) <= SHARPEST_CUT else 0.0
        speed, cruise = _leg(route, k, planner, cut)
        change = speed - planner.speed
        planner.go(
            abs(change) / ACCELERATION, acceleration=float(np.copysign(ACCELERATION, change))
        )
        planner.speed = speed
        planner.go(cruise)
        if _stops(route, k):
            planner.go(speed / ACCELERATION, acceleration=-ACCELERATION)
            planner.speed = 0.0
        turn = 0.5 * corner
        planner.go(
            0.5 * cut / planner.turn_rate, turn_rate=float(np.copysign(planner.turn_rate, corner))
        )
        if corner and not cut:
            turn = _turn_towards(planner, points[k + 1])
    planner.rows.append(
        (planner.time, planner.east, planner.north, planner.course, planner.speed, 0.0, 0.0)
    )
    segments = np.array(planner.rows).T
    segments.flags.writeable = False
    return Plan(*segments)


# waypoints drawn for one route before the class counts as impossible; seldom more than 300 are
# needed
_TRIES = 4000
_CHECK_INTERVAL = 1.0  # distances to the leader are checked at this interval [s]


class RouteClass(NamedTuple):
    """What routes of a class have in common; waypoints are drawn evenly in distance and bearing
    about the leader.
    """

    distance_max: float  # largest distance to the leader, at all times [m]
    leg_time: tuple[float, float]  # time from waypoint to waypoint, drawn evenly between [s]
    # of a leg to the leader's course at one of its ends, whichever is closer [rad]
    heading_difference_max: float
    distance_min: float = 5.0
    bearings: tuple[float, float] = (float(np.deg2rad(100.0)), float(np.deg2rad(260.0)))
    """Relative bearings from the leader, clockwise from its bow [rad]."""
    speed_min: float = 0.3  # least mean speed of a leg [m/s]


# of the paper, by distance, waypoints near or far apart, headings alike or not
CLASSES: dict[str, RouteClass] = {
    f"{distance}-{legs}-{headings}": RouteClass(
        distance_max=float(distance),
        leg_time={"near": (40.0, 80.0), "far": (120.0, 280.0)}[legs],
        heading_difference_max=float(np.deg2rad({"alike": 30.0, "drastic": 110.0}[headings])),
    )
    for distance, legs, headings in product((50, 100), ("near", "far"), ("alike", "drastic"))
}


def _place_around(
    leader: PlannedMotion, i: int, rng: np.random.Generator, route_class: RouteClass
) -> tuple[float, float]:
    """A point near the leader as it is at instant i: east and north [m]."""
    bearing = leader.course[i] + rng.uniform(*route_class.bearings)
    distance = rng.uniform(route_class.distance_min, route_class.distance_max)
    return float(leader.east[i] + distance * np.sin(bearing)), float(
        leader.north[i] + distance * np.cos(bearing)
    )


def _acceptable(
    points: list[tuple[float, float, float]],
    route_class: RouteClass,
    time: Floats,
    leader: PlannedMotion,
) -> bool:
    """Whether the route through all points so far, each time [s], east and north [m], can be flown
    and keeps to its class; `leader` is the motion at `time`.
    """
    route = Route.timed("random", points, FOLLOWER_DEPTH, start_heading=float(leader.course[0]))
    if route.leg_speed[-1] < route_class.speed_min:
        return False
    leg = np.arctan2(*(route.waypoint[-1] - route.waypoint[-2]))
    ends = np.searchsorted(time, route.time[-2:] - 1e-9)
    angle = np.abs(signed_angle(leader.course[ends] - leg))
    if angle.min() > route_class.heading_difference_max:
        return False
    try:
        motion = plan(route).at(time[: ends[1] + 1])
    except LaisnError:
        return False
    n = motion.east.size
    distance = np.hypot(motion.east - leader.east[:n], motion.north - leader.north[:n])
    return bool(
        distance.min() >= route_class.distance_min and distance.max() <= route_class.distance_max
    )


def random_route(
    rng: np.random.Generator, route_class: RouteClass, duration: float = 1000.0
) -> Route:
    """A follower's route about the leader's L that the vehicle can fly, in its class until its end
    at `duration` [s].

    It is a function of the state of `rng`. LaisnError if no route of the class was found.
    """
    time = np.arange(0.0, duration + _CHECK_INTERVAL, _CHECK_INTERVAL)
    moving = plan(library_route("L")).at(time)
    start = (0.0, *_place_around(moving, 0, rng, route_class))
    points = [start]
    failed = 0
    for _ in range(_TRIES):
        arrival = points[-1][0] + rng.uniform(*route_class.leg_time)
        # whole seconds lie on the grid of the check; what would leave a short last leg goes to the
        # end
        arrival = (
            duration if arrival > duration - route_class.leg_time[0] else float(round(arrival))
        )
        candidate = (
            arrival,
            *_place_around(moving, int(np.searchsorted(time, arrival - 1e-9)), rng, route_class),
        )
        if _acceptable([*points, candidate], route_class, time, moving):
            points.append(candidate)
            failed = 0
        else:
            failed += 1
        if points[-1][0] == duration:
            return Route.timed(
                "random", points, FOLLOWER_DEPTH, start_heading=float(moving.course[0])
            )
        if failed == 100:
            # a dead end: take back the last legs, or draw another start
            points = (
                points[:-2]
                if len(points) > 2
                else [(0.0, *_place_around(moving, 0, rng, route_class))]
            )
            failed = 0
    raise LaisnError(
        f"no route found in {_TRIES} tries; {route_class} exceeds the limits of the vehicle"
    )


def random_waypoints(
    class_name: str, address: Sequence[int]
) -> tuple[tuple[float, float, float], ...]:
    """Waypoints of a drawn route of a class of CLASSES that can also be flown from its first
    course: time [s], east, north [m].

    `address` is the seed of the random numbers. LaisnError if no such route was found.
    """
    for attempt in range(100):
        route = random_route(np.random.default_rng([*address, attempt]), CLASSES[class_name])
        points = np.column_stack([route.time, route.waypoint.round(1)])
        try:
            plan(Route.timed(class_name, points, FOLLOWER_DEPTH))
        except LaisnError:
            continue
        return tuple((float(t), float(x), float(y)) for t, x, y in points)
    raise LaisnError(f"no route of class {class_name} can be flown")
