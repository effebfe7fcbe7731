"""The paper's point motion: turns at 10°/s, changes of speed at 0.2 m/s² (Section 3). Analytic, exact at any instant.

A route becomes a plan of segments on which acceleration and turn rate are constant and one of them is zero:

    turn out of the last corner │ ramp to the leg's speed │ constant speed │ half of the next turn …

Corners are cut by the arc that touches both legs; its middle is the arrival at the waypoint, at the waypoint's time.
The leg's speed follows from that in closed form. Before a stop the leg ends with a ramp down to rest at the waypoint;
after it the vehicle turns on the spot. The same plan is the reference that `sim.control.guidance` follows,
so that the paper's motion and the physical one differ by the physics alone.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.geometry import signed_angle
from sim.scenario.routes import Route

TURN_RATE = float(np.deg2rad(10.0))
"""Turn rate in every turn [rad/s] (paper, Section 3)."""
ACCELERATION = 0.2
"""Rate of every change of speed [m/s²] (paper, Section 3)."""
SPEED_MAX = 3.0
"""Top speed of a follower [m/s] (paper, Section 3)."""
SPEED_MIN = 0.1
"""A leg with less is refused: a hull without way cannot be steered along it [m/s]."""
SHARPEST_CUT = float(np.deg2rad(135.0))
"""Sharper corners are not cut: the turn begins at the waypoint, for the touching arc would begin far ahead [rad]."""


class Motion(NamedTuple):
    """Motion on a time grid, each of shape (n,)."""

    east: Floats
    north: Floats
    course: Floats
    """Compass direction of motion, continuous (not wrapped) [rad]."""
    speed: Floats
    turn_rate: Floats
    """Rate of turn, clockwise [rad/s]."""
    acceleration: Floats
    """Change of the speed over time [m/s²]."""


def _later(begin: Motion, dt: Floats | float) -> Motion:
    """Motion a time dt [s] after the beginning of a segment; numbers or arrays of one shape."""
    speed = begin.speed + begin.acceleration * dt
    # on an arc the chord points along the mean course and is sin(half)/half of the arc long
    half = 0.5 * begin.turn_rate * dt
    chord = 0.5 * (begin.speed + speed) * dt * np.sinc(half / np.pi)
    return begin._replace(
        east=begin.east + chord * np.sin(begin.course + half),
        north=begin.north + chord * np.cos(begin.course + half),
        course=begin.course + begin.turn_rate * dt,
        speed=speed,
    )


class Plan(NamedTuple):
    """Segments of constant acceleration and turn rate, each array of shape (m,); the last one has no end."""

    start: Floats
    """Time at which the segment begins [s]."""
    east: Floats
    north: Floats
    course: Floats
    speed: Floats
    turn_rate: Floats
    acceleration: Floats

    def at(self, time: Floats) -> Motion:
        """Motion at instants of shape (n,), not negative, [s]."""
        i = np.searchsorted(self.start, time, side="right") - 1
        begin = Motion(*(column[i] for column in self[1:]))
        return _later(begin, time - self.start[i])


class _Planner:
    """Appends segments and keeps the pose at the end of the last one."""

    def __init__(self, east: float, north: float, course: float, speed: float, least_radius: float) -> None:
        self.rows: list[tuple[float, ...]] = []
        self.least_radius = least_radius
        self.time = 0.0
        self.east, self.north, self.course, self.speed = east, north, course, speed

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
        end = _later(Motion(*begin), self.time + duration - self.time)  # type: ignore[arg-type]  # numbers of one instant
        self.time += duration
        self.east, self.north, self.course, self.speed = (float(value) for value in end[:4])


def _turn_towards(planner: _Planner, point: list[float]) -> float:
    """Signed turn [rad] after which the vehicle heads for a point; NaN if the point lies within the turning circle.

    The straight line from the circle to the point touches the circle. Clockwise is positive.
    """
    radius, course = max(planner.speed / TURN_RATE, planner.least_radius), planner.course
    dx, dy = point[0] - planner.east, point[1] - planner.north
    side = 1.0 if signed_angle(np.arctan2(dx, dy) - course) >= 0 else -1.0
    # the circle's centre lies abeam; seen from there the point is at distance d and bearing b
    cx, cy = dx - side * radius * np.cos(course), dy + side * radius * np.sin(course)
    d, b = np.hypot(cx, cy), np.arctan2(cx, cy)
    if d <= radius:
        return float("nan")
    turn = side * (b - course) + np.arcsin(radius / d)
    return side * float(turn % (2 * np.pi)) if abs(signed_angle(turn)) > 1e-12 else 0.0


def _leg_speed(distance: float, time: float, speed: float) -> float:
    """Speed v that, reached from `speed` by a ramp, covers `distance` in `time`; NaN if no ramp is short enough.

    distance = v time ∓ (v − speed)² / (2 acceleration): the ramp up loses, the ramp down gains.
    """
    missing = distance - speed * time
    root = time * time - 2.0 * abs(missing) / ACCELERATION
    if time <= 0 or root < 0:
        return float("nan")
    return speed + float(np.copysign(ACCELERATION * (time - np.sqrt(root)), missing))


def _leg_speed_to_rest(distance: float, time: float, speed: float) -> float:
    """Speed v that, reached from `speed` by a ramp, covers `distance` in `time`, ended by a ramp to rest.

    distance = v time ∓ (v − speed)² / (2 acceleration) − v² / (2 acceleration); NaN if no ramps are short enough.
    """
    if time <= 0:
        return float("nan")
    if distance < speed * time - 0.5 * speed**2 / ACCELERATION:
        spare = time - speed / ACCELERATION
        return (distance - 0.5 * speed**2 / ACCELERATION) / spare if spare > 0 else float("nan")
    # 2 v² − 2 (speed + acceleration time) v + speed² + 2 acceleration distance = 0
    half = 0.5 * (speed + ACCELERATION * time)
    root = half**2 - 0.5 * speed**2 - ACCELERATION * distance
    return half - float(np.sqrt(root)) if root >= 0 else float("nan")


def _leg(route: Route, k: int, planner: _Planner, cut: float) -> tuple[float, float]:
    """Speed [m/s], and time at that speed [s], of the straight way to the turn at waypoint k; LaisnError if impossible.

    The planner has left the last turn and heads for the waypoint, where a corner of `cut` [rad] is to be cut, or where
    it stops (`cut` is 0 then).
    """
    where = f"route {route.name!r}, waypoint {k + 1}"
    mean_speed = route.leg_speed[k - 1]
    if mean_speed > SPEED_MAX * (1 + 1e-9):
        raise LaisnError(f"{where}: {mean_speed:.3g} m/s required, the limit is {SPEED_MAX:.3g} m/s")
    east, north = route.waypoint[k, 0] - planner.east, route.waypoint[k, 1] - planner.north
    straight = float(east * np.sin(planner.course) + north * np.cos(planner.course))
    # along the arc to its middle the way is shorter than to the corner by speed × saved
    saved = (np.tan(cut / 2) - cut / 2) / TURN_RATE
    left = float(route.time[k]) - planner.time
    stops = _stops(route, k)
    find = _leg_speed_to_rest if stops else _leg_speed
    speed = find(straight, left + saved, planner.speed)
    if speed < planner.least_radius * TURN_RATE:
        # on an arc of that radius, what it saves is a distance
        speed = find(straight - planner.least_radius * saved * TURN_RATE, left, planner.speed)
    if not SPEED_MIN <= speed <= SPEED_MAX * (1 + 1e-9):
        asked = f"{max(straight, 0.0) / left:.3g} m/s on average" if left > 0 else "more time"
        raise LaisnError(
            f"{where}: {asked} required after {planner.speed:.3g} m/s; out of reach with "
            f"{ACCELERATION:.3g} m/s² and speeds from {SPEED_MIN} to {SPEED_MAX:.3g} m/s"
        )
    ramp = abs(speed - planner.speed) / ACCELERATION
    radius = max(speed / TURN_RATE, planner.least_radius)
    braking = 0.5 * speed**2 / ACCELERATION if stops else 0.0
    spare = straight - radius * np.tan(cut / 2) - 0.5 * (planner.speed + speed) * ramp - braking
    if spare < -1e-9:
        raise LaisnError(
            f"{where}: a leg of {route.leg_length[k - 1]:.3g} m is {-spare:.3g} m too short for its changes of "
            f"speed and course: {planner.speed:.3g} to {speed:.3g} m/s, then a turn of {np.rad2deg(cut):.0f}° "
            f"(radius {radius:.3g} m)"
        )
    return speed, float(spare / speed)


def _stops(route: Route, k: int) -> bool:
    """Whether the vehicle stays at waypoint k, counted from 0, for a while."""
    return k < route.leg_length.size and route.leg_length[k] == 0


def plan(route: Route, least_radius: float = 0.0) -> Plan:
    """The motion along a route, on time at every waypoint.

    Args:
        route: waypoints and their times.
        least_radius: of the turns of a hull that cannot turn at TURN_RATE [m].

    Raises:
        LaisnError: the vehicle cannot fly the route; names the route, the waypoint (counted from 1), what it requires
            and the limit.
    """
    points = route.waypoint.tolist()
    course = np.arctan2(*np.diff(route.waypoint, axis=0).T).tolist()
    start = route.initial_heading
    east, north = points[0]
    planner = _Planner(east, north, start, route.start_speed, least_radius)
    # the turn that leads from the last corner to the next leg; a start off the first leg is such a corner
    begins_aside = not _stops(route, 0) and abs(signed_angle(course[0] - start)) > 1e-12
    turn = _turn_towards(planner, points[1]) if begins_aside else 0.0
    for k in range(1, len(points)):
        if _stops(route, k - 1):
            planner.go(float(route.time[k]) - planner.time)
            turn = 0.0 if k == len(course) or _stops(route, k) else signed_angle(course[k] - planner.course)
            continue
        if np.isnan(turn):
            raise LaisnError(
                f"route {route.name!r}, waypoint {k + 1}: it lies within the turning circle of "
                f"{max(planner.speed / TURN_RATE, least_radius):.3g} m radius that begins at waypoint {k}"
            )
        planner.go(abs(turn) / planner.turn_rate, turn_rate=float(np.copysign(planner.turn_rate, turn)))
        corner = signed_angle(course[k] - planner.course) if k < len(course) and not _stops(route, k) else 0.0
        cut = abs(corner) if abs(corner) <= SHARPEST_CUT else 0.0
        speed, cruise = _leg(route, k, planner, cut)
        change = speed - planner.speed
        planner.go(abs(change) / ACCELERATION, acceleration=float(np.copysign(ACCELERATION, change)))
        planner.speed = speed
        planner.go(cruise)
        if _stops(route, k):
            planner.go(speed / ACCELERATION, acceleration=-ACCELERATION)
            planner.speed = 0.0
        turn = 0.5 * corner
        planner.go(0.5 * cut / planner.turn_rate, turn_rate=float(np.copysign(planner.turn_rate, corner)))
        if corner and not cut:
            turn = _turn_towards(planner, points[k + 1])
    planner.rows.append((planner.time, planner.east, planner.north, planner.course, planner.speed, 0.0, 0.0))
    return Plan(*np.array(planner.rows).T)
