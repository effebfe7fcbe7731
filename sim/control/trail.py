"""The leader's trail: where it was heard, by the length of its way.

A smooth curve leads through the positions (cubic Hermite segments with mean slopes, as Catmull and Rom 1974). Beyond
its head the leader is taken to go on as it went over the last seconds; before its tail, to have come straight.
"""

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.geometry import wrap_angle

EAST, NORTH, ARC, TIME, THROUGH, HEADING, SLOPE_EAST, SLOPE_NORTH, TURNED, PACE = range(10)
"""Columns of a trail: [m], [m], length of the way to there [m], [s]; what the leader said of itself there: its speed
through the water [m/s] and its heading [rad]; slope of the curve there, for a metre of way; what the curve has turned
until there at most, to port and to starboard added up [rad]; and the leader's mean speed over ground over the last
seconds until then [m/s]."""
TRAIL = 10

SHORTEST = 0.3
"""Points of a trail are at least this far apart [m]: below it, a way would be made of waves and rounding."""
PACE_TIME = 10.0
"""The pace is the mean over this time [s]."""

TAIL = 20.0
"""Before its first point the trail is taken to have come straight, as it went on for so long [m]."""

Place = tuple[float, float, float, float, float]
"""East and north [m]; the way's direction, a unit vector east and north; the leader's speed through the water there
[m/s]."""


@compiled
def _chord(trail: Floats, a: int, b: int) -> tuple[float, float]:
    """East and north from point a to point b, for a metre of way; nothing where there is none."""
    length = trail[b, ARC] - trail[a, ARC]
    if length <= 0.0:
        return 0.0, 0.0
    return (trail[b, EAST] - trail[a, EAST]) / length, (trail[b, NORTH] - trail[a, NORTH]) / length


@compiled
def _tail(trail: Floats, count: int) -> tuple[float, float]:
    """Direction of the first stretch of a trail; the shorter it is yet, the more that of the heading said there."""
    course = trail[0, HEADING]
    i = 1
    while i < count - 1 and trail[i, ARC] < TAIL:
        i += 1
    made = np.arctan2(trail[i, EAST] - trail[0, EAST], trail[i, NORTH] - trail[0, NORTH])
    course += wrap_angle(made - course) * min(trail[i, ARC] / TAIL, 1.0)
    return np.sin(course), np.cos(course)


@compiled
def _slope(trail: Floats, count: int, i: int) -> tuple[float, float]:
    """East and north of the direction of the curve at point i; it begins as it came, and at its head bends on."""
    last = count - 1
    if i == 0:
        return _tail(trail, count)
    if count == 2:
        return _chord(trail, 0, 1)
    if i < last:
        return _chord(trail, i - 1, i + 1)
    x, y = _chord(trail, last - 1, last)
    mean_x, mean_y = _chord(trail, last - 2, last)
    return 2.0 * x - mean_x, 2.0 * y - mean_y


@compiled
def _turn_to(trail: Floats, i: int) -> float:
    """Angle that the curve turns by at most from the point before to point i, to either side added up [rad].

    A derivative of Hermite's cubic is a Bézier curve, which turns no more than the polygon of its three points.
    """
    length = trail[i, ARC] - trail[i - 1, ARC]
    ax, ay = length * trail[i - 1, SLOPE_EAST], length * trail[i - 1, SLOPE_NORTH]
    bx, by = length * trail[i, SLOPE_EAST], length * trail[i, SLOPE_NORTH]
    mx = 3.0 * (trail[i, EAST] - trail[i - 1, EAST]) - ax - bx
    my = 3.0 * (trail[i, NORTH] - trail[i - 1, NORTH]) - ay - by
    first = np.arctan2(ax * my - ay * mx, ax * mx + ay * my)
    second = np.arctan2(mx * by - my * bx, mx * bx + my * by)
    return float(abs(first) + abs(second))


@compiled
def _mean_speed(trail: Floats, last: int) -> float:
    """Mean speed over ground over the last seconds until a point that has one before it [m/s]."""
    i = last - 1
    while i > 0 and trail[last, TIME] - trail[i, TIME] < PACE_TIME - 1e-6:
        i -= 1
    return float((trail[last, ARC] - trail[i, ARC]) / (trail[last, TIME] - trail[i, TIME]))


@compiled
def extend(trail: Floats, count: Ints, east: float, north: float, time: float, said: tuple[float, float]) -> None:
    """Add where the leader was to its trail.

    Args:
        trail: columns EAST … PACE, shape (room, TRAIL); overwritten from `count` on, and the slopes of the last points.
        count: how many points it has, shape (1,); brought forward.
        east: [m].
        north: [m].
        time: [s], later than before.
        said: speed through the water [m/s] and heading [rad].
    """
    n = count[0]
    through, heading = said
    if n == 0:
        trail[0, EAST], trail[0, NORTH], trail[0, ARC], trail[0, TIME] = east, north, 0.0, time
        trail[0, THROUGH], trail[0, HEADING] = through, heading
        trail[0, SLOPE_EAST], trail[0, SLOPE_NORTH] = np.sin(heading), np.cos(heading)
        trail[0, TURNED], trail[0, PACE] = 0.0, through
        count[0] = 1
        return
    # the head moves on until it is far enough from the point before
    if n > 1 and trail[n - 1, ARC] - trail[n - 2, ARC] < SHORTEST:
        n -= 1
    step = np.hypot(east - trail[n - 1, EAST], north - trail[n - 1, NORTH])
    # a way that bends evenly is longer than its chord
    half = 0.5 * abs(wrap_angle(heading - trail[n - 1, HEADING]))
    if 1e-3 < half < 1.5:
        step *= half / np.sin(half)
    trail[n, EAST], trail[n, NORTH], trail[n, TIME] = east, north, time
    trail[n, THROUGH], trail[n, HEADING] = through, heading
    trail[n, ARC] = trail[n - 1, ARC] + step
    trail[n, PACE] = _mean_speed(trail, n)
    count[0] = n + 1
    # the slope at the head hangs on three points, that at the tail on the first stretch
    first = n - 1 if trail[n - 1, ARC] >= TAIL else 0
    for i in range(first, n + 1):
        trail[i, SLOPE_EAST], trail[i, SLOPE_NORTH] = _slope(trail, n + 1, i)
    for i in range(max(first, 1), n + 1):
        trail[i, TURNED] = trail[i - 1, TURNED] + _turn_to(trail, i)


@compiled
def pace(trail: Floats, count: int) -> float:
    """Mean speed over ground at the end of a trail [m/s]; that through the water where there is no way yet."""
    return float(trail[count - 1, PACE])


@compiled
def arc_at(trail: Floats, count: int, time: float) -> float:
    """Length of the way at a time [s]; after the last point the leader is taken to have kept its pace [m]."""
    last = count - 1
    if time >= trail[last, TIME]:
        return float(trail[last, ARC] + pace(trail, count) * (time - trail[last, TIME]))
    i = last
    while i > 1 and trail[i - 1, TIME] > time:
        i -= 1
    share = (time - trail[i - 1, TIME]) / (trail[i, TIME] - trail[i - 1, TIME])
    return float(trail[i - 1, ARC] + share * (trail[i, ARC] - trail[i - 1, ARC]))


@compiled
def _unit(east: float, north: float) -> tuple[float, float]:
    """Direction of a vector, north if it has none."""
    length = np.sqrt(east * east + north * north)
    return (east / length, north / length) if length > 0.0 else (0.0, 1.0)


@compiled
def _straight(trail: Floats, i: int, ahead: tuple[float, float], beyond: float) -> Place:
    """A place so far beyond point i in a direction."""
    east, north = trail[i, EAST] + beyond * ahead[0], trail[i, NORTH] + beyond * ahead[1]
    return east, north, ahead[0], ahead[1], trail[i, THROUGH]


@compiled
def _before(trail: Floats, count: int, arc: float) -> int:
    """The last point that is not beyond a length of the way, which lies between the ends of a trail.

    It is sought from where it would be at an even pace: bisection would touch all of a long trail, which no cache holds
    of many followers.
    """
    last = count - 1
    low = min(int(arc / trail[last, ARC] * last), last - 1)
    while trail[low, ARC] > arc:
        low -= 1
    while trail[low + 1, ARC] <= arc:
        low += 1
    return low


@compiled
def _head(trail: Floats, count: int) -> int:
    """The last point whose slope says where the leader goes: too near to the one before, its own does not."""
    last = count - 1
    return last - 1 if trail[last, ARC] - trail[last - 1, ARC] < SHORTEST and count > 2 else last


@compiled
def turned_since(trail: Floats, count: int, arc: float) -> float:
    """By how much the way turns at most from a length of it on, to port and to starboard added up [rad].

    Args:
        trail: columns EAST … PACE, shape (room, TRAIL).
        count: how many points it has, at least 1.
        arc: length of the way, as of `at` [m].
    """
    last = count - 1
    if arc <= 0.0 or trail[last, ARC] <= 0.0:
        return float(trail[last, TURNED])
    since = last - 1 if arc >= trail[last, ARC] else _before(trail, count, arc)
    return float(trail[last, TURNED] - trail[since, TURNED])


@compiled
def at(trail: Floats, count: int, arc: float) -> Place:
    """The trail at a length of the way.

    Args:
        trail: columns EAST … PACE, shape (room, TRAIL).
        count: how many points it has, at least 1.
        arc: length of the way; less than that of the first point or more than that of the last is straight on [m].
    """
    last = count - 1
    if arc <= 0.0 or trail[last, ARC] <= 0.0:
        return _straight(trail, 0, (trail[0, SLOPE_EAST], trail[0, SLOPE_NORTH]), arc)
    if arc >= trail[last, ARC]:
        i = _head(trail, count)
        return _straight(trail, last, _unit(trail[i, SLOPE_EAST], trail[i, SLOPE_NORTH]), arc - trail[last, ARC])
    low = _before(trail, count, arc)
    high = low + 1
    length = trail[high, ARC] - trail[low, ARC]
    u = (arc - trail[low, ARC]) / length
    ax, ay = length * trail[low, SLOPE_EAST], length * trail[low, SLOPE_NORTH]
    bx, by = length * trail[high, SLOPE_EAST], length * trail[high, SLOPE_NORTH]
    dx, dy = trail[high, EAST] - trail[low, EAST], trail[high, NORTH] - trail[low, NORTH]
    # Hermite's cubic about the first point, and its derivative by u
    p, q, r = u * (1.0 - u) * (1.0 - u), u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    dp, dq, dr = (1.0 - u) * (1.0 - 3.0 * u), 6.0 * u * (1.0 - u), u * (3.0 * u - 2.0)
    ahead_east, ahead_north = _unit(dp * ax + dr * bx + dq * dx, dp * ay + dr * by + dq * dy)
    return (
        trail[low, EAST] + p * ax + r * bx + q * dx,
        trail[low, NORTH] + p * ay + r * by + q * dy,
        ahead_east,
        ahead_north,
        (1.0 - u) * trail[low, THROUGH] + u * trail[high, THROUGH],
    )
