"""A follower's station: a place in the leader's trail, and aside of it in a frame that turns
slowly.

The trail is a smooth curve through the leader's received positions, by the length of its way (cubic
Hermite segments with mean slopes, as Catmull and Rom 1974), and through planned ones between
messages that carry the leader's next waypoints. Beyond its head the leader is taken to go on as it
went over the last seconds.

A station s behind and y to port stands at trail(S − s) + y · port(ψ). The frame's heading ψ follows
the trail no faster than the station can be swum. A hull turns at a limited rate, the velocity that
its station needs may not: `rate_limited_velocity` has the heading in the middle of the envelopes
that fall and rise at that rate (McShane 1934), nearest to what the station needs from now on and
needed just before.

Functions of the trail take `trail`, records of TRAIL of shape (room,), and `count`, how many points
it has, at least one; those that change the trail bring `count`, of shape (1,), forward. Functions
of a station take `f`, the record of `[formation]`; `station`, a record of STATION; `trail`, the
leader's and how many points it has; `dt`, a time step, and `time`, now [s]; and `state`, of
FRAME_STATE.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Record, RecordFields, Records, records, row_dtype
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.allocation import clip
from sim.control.guidance import REFERENCE
from sim.scenario.point_motion import SHARPEST_CUT, TURN_RATE
from sim.scenario.section import CONTROL_STEP_S


class TrailPoint(RecordFields):
    """One point of a trail."""

    east: float  # [m]
    north: float
    arc: float  # length of the way to there [m]
    time: float  # [s]
    water_speed: float  # the leader's broadcast speed through the water [m/s]
    heading: float  # its broadcast heading [rad]
    slope_east: float  # slope of the curve, per metre of way
    slope_north: float
    # bound of what the curve has turned until there, both sides added up [rad]
    turned: float
    # the leader's mean speed over ground over the last seconds; at first through water [m/s]
    pace: float


TRAIL = row_dtype(TrailPoint)


# points of a trail are at least this far apart [m]: below it, a way would be made of waves and
# rounding
MIN_SPACING = 0.3
PACE_TIME = 10.0  # the pace is the mean over this time [s]

# before its first point the trail is taken to have come straight, as it went on for so long [m]
TAIL = 20.0

# place [m], unit vector of the way, speed through water [m/s]
Place = tuple[float, float, float, float, float]


@compiled
def _chord(trail: Records, a: int, b: int) -> tuple[float, float]:
    """East and north from point a to point b, for a metre of way; nothing where there is none."""
    length = trail[b].arc - trail[a].arc
    if length <= 0.0:
        return 0.0, 0.0
    return (trail[b].east - trail[a].east) / length, (trail[b].north - trail[a].north) / length


@compiled
def _slope(trail: Records, count: int, i: int) -> tuple[float, float]:
    """East and north of the direction of the curve at point i; it begins as it came, and at its
    head bends on.
    """
    last = count - 1
    if i == 0:
        # that of the first stretch; the shorter it is yet, the more that of the heading there
        course = trail[0].heading
        end = 1
        while end < last and trail[end].arc < TAIL:
            end += 1
        made_good = np.arctan2(trail[end].east - trail[0].east, trail[end].north - trail[0].north)
        course += wrap_angle(made_good - course) * min(trail[end].arc / TAIL, 1.0)
        return np.sin(course), np.cos(course)
    if count == 2:
        return _chord(trail, 0, 1)
    if i < last:
        return _chord(trail, i - 1, i + 1)
    x, y = _chord(trail, last - 1, last)
    mean_x, mean_y = _chord(trail, last - 2, last)
    return 2.0 * x - mean_x, 2.0 * y - mean_y


@compiled
def _turn_to(trail: Records, i: int) -> float:
    """Bound of the angle by which the curve turns to point i from the one before, that of its
    Bézier polygon [rad].
    """
    length = trail[i].arc - trail[i - 1].arc
    ax, ay = length * trail[i - 1].slope_east, length * trail[i - 1].slope_north
    bx, by = length * trail[i].slope_east, length * trail[i].slope_north
    mx = 3.0 * (trail[i].east - trail[i - 1].east) - ax - bx
    my = 3.0 * (trail[i].north - trail[i - 1].north) - ay - by
    first = np.arctan2(ax * my - ay * mx, ax * mx + ay * my)
    second = np.arctan2(mx * by - my * bx, mx * bx + my * by)
    return float(abs(first) + abs(second))


@compiled
def extend(
    trail: Records, count: Ints, east: float, north: float, time: float, motion: tuple[float, float]
) -> None:
    """Add where the leader was to its trail: east, north [m], time [s], later than before, speed
    and heading.
    """
    n = count[0]
    water_speed, heading = motion
    # the head moves on until it is far enough from the point before
    if n > 1 and trail[n - 1].arc - trail[n - 2].arc < MIN_SPACING:
        n -= 1
    count[0] = n + 1
    trail[n].east = east
    trail[n].north = north
    trail[n].time = time
    trail[n].water_speed = water_speed
    trail[n].heading = heading
    if n == 0:
        trail[0].slope_east, trail[0].slope_north = np.sin(heading), np.cos(heading)
        trail[0].arc = 0.0
        trail[0].turned = 0.0
        trail[0].pace = water_speed
        return
    step = np.hypot(east - trail[n - 1].east, north - trail[n - 1].north)
    # a way that bends evenly is longer than its chord
    half_turn = 0.5 * abs(wrap_angle(heading - trail[n - 1].heading))
    if 1e-3 < half_turn < 1.5:
        step *= half_turn / np.sin(half_turn)
    trail[n].arc = trail[n - 1].arc + step
    index = n - 1
    while index > 0 and time - trail[index].time < PACE_TIME - 1e-6:
        index -= 1
    trail[n].pace = (trail[n].arc - trail[index].arc) / (time - trail[index].time)
    # the slope at the head hangs on three points, that at the tail on the first stretch
    first = n - 1 if trail[n - 1].arc >= TAIL else 0
    for i in range(first, n + 1):
        trail[i].slope_east, trail[i].slope_north = _slope(trail, n + 1, i)
    for i in range(max(first, 1), n + 1):
        trail[i].turned = trail[i - 1].turned + _turn_to(trail, i)


@compiled
def arc_at(trail: Records, count: int, time: float) -> float:
    """Length of the way at a time [s]; after the last point the leader is taken to have kept its
    pace [m].
    """
    last = count - 1
    if time >= trail[last].time:
        return float(trail[last].arc + trail[last].pace * (time - trail[last].time))
    i = last
    while i > 1 and trail[i - 1].time > time:
        i -= 1
    share = (time - trail[i - 1].time) / (trail[i].time - trail[i - 1].time)
    return float(trail[i - 1].arc + share * (trail[i].arc - trail[i - 1].arc))


@compiled
def _unit(east: float, north: float) -> tuple[float, float]:
    """Direction of a vector, north if it has none."""
    length = np.sqrt(east * east + north * north)
    return (east / length, north / length) if length > 0.0 else (0.0, 1.0)


@compiled
def _index_before(trail: Records, count: int, arc: float) -> int:
    """The last point not beyond a length of the way within a trail; bisection would touch all of
    a long one.
    """
    last = count - 1
    low = min(int(arc / trail[last].arc * last), last - 1)
    while trail[low].arc > arc:
        low -= 1
    while trail[low + 1].arc <= arc:
        low += 1
    return low


@compiled
def turned_since(trail: Records, count: int, arc: float) -> float:
    """By how much the way turns at most from a length of it on [m], to port and to starboard
    added up [rad].
    """
    last = count - 1
    if arc <= 0.0 or trail[last].arc <= 0.0:
        return float(trail[last].turned)
    index = last - 1 if arc >= trail[last].arc else _index_before(trail, count, arc)
    return float(trail[last].turned - trail[index].turned)


@compiled
def place_at(trail: Records, count: int, arc: float) -> Place:
    """The trail at a length of the way [m]; before the first point and after the last it is
    straight.
    """
    last = count - 1
    begins = arc <= 0.0 or trail[last].arc <= 0.0
    if begins or arc >= trail[last].arc:
        end = 0 if begins else last
        ahead_east = trail[0].slope_east
        ahead_north = trail[0].slope_north
        excess = arc - trail[end].arc
        if not begins:
            # a point too near to the one before it has no useful slope
            i = (
                last - 1
                if trail[last].arc - trail[last - 1].arc < MIN_SPACING and count > 2
                else last
            )
            ahead_east, ahead_north = _unit(trail[i].slope_east, trail[i].slope_north)
        east, north = trail[end].east + excess * ahead_east, trail[end].north + excess * ahead_north
        return east, north, ahead_east, ahead_north, trail[end].water_speed
    low = _index_before(trail, count, arc)
    high = low + 1
    length = trail[high].arc - trail[low].arc
    u = (arc - trail[low].arc) / length
    ax, ay = length * trail[low].slope_east, length * trail[low].slope_north
    bx, by = length * trail[high].slope_east, length * trail[high].slope_north
    dx, dy = trail[high].east - trail[low].east, trail[high].north - trail[low].north
    # Hermite's cubic x(u) = x_0 + p a + r b + q (x_1 − x_0) with the slopes a and b by u at its
    # ends, and its derivative by u
    p = u * (1.0 - u) * (1.0 - u)
    q = u * u * (3.0 - 2.0 * u)
    r = u * u * (u - 1.0)
    dp = (1.0 - u) * (1.0 - 3.0 * u)
    dq = 6.0 * u * (1.0 - u)
    dr = u * (3.0 * u - 2.0)
    ahead_east, ahead_north = _unit(dp * ax + dr * bx + dq * dx, dp * ay + dr * by + dq * dy)
    return (
        trail[low].east + p * ax + r * bx + q * dx,
        trail[low].north + p * ay + r * by + q * dy,
        ahead_east,
        ahead_north,
        (1.0 - u) * trail[low].water_speed + u * trail[high].water_speed,
    )


PLANNED_INTERVAL = 1.0  # time from one planned point of a trail to the next [s]
# a turn begins at most so long before its waypoint [s]
_HALF_TURN_TIME = 0.5 * SHARPEST_CUT / TURN_RATE
# a leader farther off its plan than this has left it after the last waypoint that was received [m]
_OFF_PLAN = 5.0


class LeaderPlan(NamedTuple):
    """The leader's track as a follower computes it from waypoints, at n control steps."""

    track: Records  # of REFERENCE, of which place and course are read, shape (n,)
    # until when a message sent at each step gives the track, shape (n,), [s]; of no length: none
    # does
    known_until: Floats


NO_PLAN = LeaderPlan(records(REFERENCE, 0), np.zeros(0))
"""That of a leader whose messages carry no waypoints."""


def plan_of(track: Records, times: Floats, waypoints: int, dt: float) -> LeaderPlan:
    """The plan of a leader whose messages carry so many of its next waypoints, at times of shape
    (w,), increasing, [s].

    The track is known until the turn at the last of them, which depends on the next leg, or until
    the end of the route. `track` is the leader's reference at n control steps dt [s] apart, records
    of REFERENCE, shape (n,).
    """
    if waypoints == 0:
        return NO_PLAN
    last = np.searchsorted(times, dt * np.arange(len(track)), side="right") + waypoints - 1
    known_until = np.append(times[:-1] - _HALF_TURN_TIME, np.inf)[np.minimum(last, times.size - 1)]
    # the start is known, but no message has been sent yet
    known_until[0] = -np.inf
    return LeaderPlan(np.ascontiguousarray(track), known_until)


@compiled
def extend_as_planned(
    plan: LeaderPlan,
    trail: Records,
    count: Ints,
    received: tuple[float, int],
    clock: tuple[int, float],
) -> None:
    """Add where the leader is by the plan to its trail while no message is in, if the last one had
    the plan for now.

    Args:
        received: time of the last message [s], and how many points the trail had with it; the
            others are planned ones.
        clock: control step, and its length [s].
    """
    k, dt = clock
    last_received, received_points = received
    is_due = (
        plan.known_until.size > 0
        and k % round(PLANNED_INTERVAL / dt) == 0
        and k * dt - last_received > 0.5 * PLANNED_INTERVAL
    )
    if not is_due or k * dt > plan.known_until[round(last_received / dt)]:
        return
    # of a leader that stands still, planned points take the place of the one that was received
    head = received_points - 1
    first_step = round(trail[head].time / dt)
    if k <= first_step:
        return
    east = trail[head].east + plan.track[k].east - plan.track[first_step].east
    north = trail[head].north + plan.track[k].north - plan.track[first_step].north
    heading = trail[head].heading + plan.track[k].course - plan.track[first_step].course
    extend(trail, count, east, north, k * dt, (trail[head].water_speed, heading))


@compiled
def correct_planned(
    trail: Records, count: Ints, received: int, message: tuple[float, float, float]
) -> None:
    """Move planned points of a trail to where the leader was by the message after them; later ones
    are dropped.

    Its distance from the plan is taken to have grown evenly since the message before.

    Args:
        received: how many points it had after the last message, at least one.
        message: east, north [m] and time [s].
    """
    total = count[0]
    east, north, time = message
    count[0] = received
    if total == received:
        return
    begin = trail[received - 1].time
    last = total - 1
    while last >= received and trail[last].time > time - 0.5 * PLANNED_INTERVAL:
        last -= 1
    if last < received:
        return
    planned_east, planned_north, _, _, _ = place_at(trail, total, arc_at(trail, total, time))
    off_east, off_north = east - planned_east, north - planned_north
    if np.hypot(off_east, off_north) > _OFF_PLAN:
        off_east = off_north = 0.0
    for i in range(received, last + 1):
        point_time = trail[i].time
        share = (point_time - begin) / (time - begin)
        motion = trail[i].water_speed, trail[i].heading
        # a point is written where it was read, or before
        extend(
            trail,
            count,
            trail[i].east + share * off_east,
            trail[i].north + share * off_north,
            point_time,
            motion,
        )


class StationGeometry(RecordFields):
    """A station, and the hull that is to keep it [m]."""

    behind: float
    port: float
    depth: float
    # least radius with which turns of the hull are planned, as of
    # `sim.control.stability.least_radius`; 0: none limits them
    planned_radius: float


STATION = row_dtype(StationGeometry)


class StationFrame(RecordFields):
    """The frame of a station."""

    heading: float  # [rad]
    rate: float  # its rate of turn, clockwise [rad/s]


FRAME_STATE = row_dtype(StationFrame)

_MIN_OFFSET = 5.0  # a station nearer to the trail is turned as if it were this far aside [m]
# rate of turn that a follower counts on [rad/s]; 10°/s is what it is allowed
AGILITY = float(np.deg2rad(8.0))
PREVIEW_STEP = 1.0  # a follower looks ahead and back in steps of this time [s]
PREVIEW_STEPS = 10  # number of these steps
# a hull of a least radius looks so far that it can begin half of a right angle before a corner
_HALF_CORNER = 0.25 * np.pi
# the curvature of a trail is looked up over this share of a hull's least radius …
_CHORD_SHARE = 0.25
# … so many times, from half of a right angle of its turn before a place to as much behind it
_CHORDS = 6
# a frame turns at least this fast: at the inner station this share of the leader's speed
_MIN_MARGIN_SHARE = 0.05
# share of a hull's greatest acceleration across its way that turning frames may ask for
_SIDEWAYS_SHARE = 0.3


class Target(NamedTuple):
    """Where a station is now, and how it moves."""

    east: float  # [m]
    north: float
    velocity_east: float  # over ground [m/s]
    velocity_north: float
    # velocity along the trail: the way of the leader, when it was there, at its latest pace [m/s]
    way_east: float
    way_north: float


@compiled
def _inner_speed_margin(
    trail: tuple[Records, int], arc: float, speed: float, radius: float
) -> float:
    """By how much an inner station may be slower than the leader, where a hull of a least radius
    can still follow its path [m/s].

    The path of a station that is slower by w bends as V² κ / (V − w)², with the trail's curvature
    κ, as far as its own turns reach about the place.
    """
    points, count = trail
    chord = _CHORD_SHARE * radius
    first = arc - 0.5 * _CHORDS * chord
    _, _, east, north, _ = place_at(points, count, first)
    course = np.arctan2(east, north)
    curvature = 0.0
    for i in range(1, _CHORDS + 1):
        _, _, east, north, _ = place_at(points, count, first + i * chord)
        last_course = course
        course = np.arctan2(east, north)
        curvature = max(curvature, abs(wrap_angle(course - last_course)) / chord)
    return float(speed * max(1.0 - np.sqrt(curvature * radius), _MIN_MARGIN_SHARE))


@compiled
def turn_frame(
    f: Record,
    station: StationGeometry,
    trail: tuple[Records, int],
    span: tuple[float, float],
    dt: float,
    state: StationFrame,
) -> None:
    """Turn a station's frame from one time to another [s], along the trail as it is known now."""
    points, count = trail
    pace = points[count - 1].pace
    width = max(abs(station.port), _MIN_OFFSET)
    max_rate = f.max_station_acceleration / width
    if station.planned_radius > 0.0:
        across_acceleration = max(pace * pace / station.planned_radius, 1e-3)
        max_rate = min(max_rate, _SIDEWAYS_SHARE * across_acceleration / width)
    for i in range(round((span[1] - span[0]) / dt)):
        arc = arc_at(points, count, span[0] + (i + 1) * dt) - station.behind
        _, _, east, north, water_speed = place_at(points, count, arc)
        ahead = clip(station.behind, 0.0, f.frame_lookahead)
        if ahead > 0.0:
            _, _, east, north, _ = place_at(points, count, arc + ahead)
        heading_error = wrap_angle(np.arctan2(east, north) - state.heading)
        rate = heading_error / f.frame_time_constant
        if rate * station.port > 0.0:
            speed_margin = min(f.outer_speedup * pace, max(f.outer_max_speed - water_speed, 0.1))
        else:
            speed_margin = min(f.inner_slowdown * pace, max(water_speed - f.inner_min_speed, 0.1))
            if station.planned_radius > 0.0:
                speed_margin = min(
                    speed_margin, _inner_speed_margin(trail, arc, pace, station.planned_radius)
                )
        # what is turned has to be stopped again
        limit = min(speed_margin / width, np.sqrt(max_rate * abs(heading_error)))
        rate = clip(rate, -limit, limit)
        state.rate += dt * clip(
            (rate - state.rate) / f.frame_rate_time_constant, -max_rate, max_rate
        )
        state.heading += dt * state.rate


@compiled
def station_at(
    station: StationGeometry, trail: tuple[Records, int], time: float, state: StationFrame
) -> Target:
    """Where a station is, by its frame as it stands."""
    points, count = trail
    port = station.port
    pace = points[count - 1].pace
    arc = arc_at(points, count, time) - station.behind
    east, north, ahead_east, ahead_north, _ = place_at(points, count, arc)
    sine = np.sin(state.heading)
    cosine = np.cos(state.heading)
    rate = state.rate
    return Target(
        east - port * cosine,
        north + port * sine,
        pace * ahead_east + port * rate * sine,
        pace * ahead_north + port * rate * cosine,
        pace * ahead_east,
        pace * ahead_north,
    )


@compiled
def _planned_course(
    plan: LeaderPlan, trail: tuple[Records, int], arc: float, sent_time: float
) -> float:
    """Course of the leader at a length of its way beyond its trail [m], by the plan in the message
    sent at a time [s]; NaN: that does not give it [rad].
    """
    points, count = trail
    head = points[count - 1]
    if plan.known_until.size == 0 or arc <= head.arc:
        return np.nan
    time = head.time + (arc - head.arc) / max(head.pace, 0.1)
    k = round(time / CONTROL_STEP_S)
    if k >= plan.known_until.size or time > plan.known_until[round(sent_time / CONTROL_STEP_S)]:
        return np.nan
    return float(plan.track[k].course)


@compiled
def _velocity_needed(
    station: StationGeometry,
    trail: tuple[Records, int],
    arc: float,
    preview: float,
    current: tuple[float, float],
    state: StationFrame,
    foreseen: tuple[LeaderPlan, float],
) -> tuple[float, float]:
    """Velocity through the water that a station needs a time `preview` later (less than 0: earlier)
    [s], east and north [m/s].

    `arc` is the length of the way to where the station is in the trail [m]; `foreseen` as of
    `rate_limited_velocity`.
    """
    points, count = trail
    pace = points[count - 1].pace
    later_arc = arc + preview * pace
    _, _, ahead_east, ahead_north, _ = place_at(points, count, later_arc)
    if station.planned_radius > 0.0:
        course = _planned_course(foreseen[0], trail, later_arc, foreseen[1])
        if course == course:
            ahead_east, ahead_north = np.sin(course), np.cos(course)
    frame_heading = state.heading + preview * state.rate
    swing_speed = station.port * state.rate
    east = pace * ahead_east + swing_speed * np.sin(frame_heading)
    north = pace * ahead_north + swing_speed * np.cos(frame_heading)
    return east - current[0], north - current[1]


@compiled
def rate_limited_velocity(
    f: Record,
    station: StationGeometry,
    trail: tuple[Records, int],
    time: float,
    current: tuple[float, float],
    state: StationFrame,
    foreseen: tuple[LeaderPlan, float],
) -> tuple[float, float]:
    """Velocity over ground with which a hull stays nearest to its station in a current, east and
    north [m/s].

    `foreseen` is the leader's plan, and when the message that gave it was sent [s]: a hull that
    turns slowly has to begin before the leader does.
    """
    points, count = trail
    arc = arc_at(points, count, time) - station.behind
    pace = points[count - 1].pace
    east, north = _velocity_needed(station, trail, arc, f.preview, current, state, foreseen)
    speed = np.sqrt(east * east + north * north)
    agility = AGILITY
    step = PREVIEW_STEP
    if station.planned_radius > 0.0:
        agility = min(AGILITY, max(speed, 0.1) / station.planned_radius)
        step = max(PREVIEW_STEP, _HALF_CORNER / (agility * PREVIEW_STEPS))
    horizon = PREVIEW_STEPS * step
    turned = turned_since(points, count, arc + (f.preview - horizon) * pace)
    velocity_change = pace * turned + abs(station.port * state.rate * state.rate) * horizon
    steps = PREVIEW_STEPS
    # headings nearby surely differ by less than a hull turns in more steps than these, on straight
    # legs in a single one; what is foreseen of a leader's plan is in no trail yet
    if station.planned_radius == 0.0 and velocity_change < speed:
        steps = min(int(np.arcsin(velocity_change / speed) / (agility * step)), PREVIEW_STEPS)
    if steps > 0:
        required_heading = np.arctan2(east, north)
        upper = lower = required_heading
        for side in (-1.0, 1.0):
            neighbour_heading = required_heading
            for j in range(1, steps + 1):
                x, y = _velocity_needed(
                    station, trail, arc, f.preview + side * j * step, current, state, foreseen
                )
                neighbour_heading += wrap_angle(np.arctan2(x, y) - neighbour_heading)
                upper = max(upper, neighbour_heading - agility * j * step)
                lower = min(lower, neighbour_heading + agility * j * step)
        heading = 0.5 * (upper + lower)
        east, north = speed * np.sin(heading), speed * np.cos(heading)
    return east + current[0], north + current[1]
