"""The leader's trail: where it was heard, by the length of its way.

A smooth curve leads through the positions (cubic Hermite segments with mean slopes, as Catmull and Rom 1974). Beyond
its head the leader is taken to go on as it went over the last seconds; before its tail, to have come straight.
"""

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.geometry import signed_angle

EAST, NORTH, ARC, TIME, THROUGH, HEADING = range(6)
"""Columns of a trail: [m], [m], length of the way to there [m], [s], and what the leader said of itself there: its
speed through the water [m/s] and its heading [rad]."""
TRAIL = 6

SHORTEST = 0.3
"""Points of a trail are at least this far apart [m]: below it, a way would be made of waves and rounding."""
PACE_TIME = 10.0
"""The pace is the mean over this time [s]."""

TAIL = 20.0
"""Before its first point the trail is taken to have come straight, as it went on for so long [m]."""

Place = tuple[float, float, float, float]
"""East, north [m], course [rad], and the leader's speed through the water there [m/s]."""


@compiled
def extend(trail: Floats, count: Ints, east: float, north: float, time: float, said: tuple[float, float]) -> None:
    """Add where the leader was to its trail.

    Args:
        trail: columns EAST … THROUGH, shape (room, TRAIL); overwritten from `count` on.
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
        count[0] = 1
        return
    # the head moves on until it is far enough from the point before
    if n > 1 and trail[n - 1, ARC] - trail[n - 2, ARC] < SHORTEST:
        n -= 1
    step = np.hypot(east - trail[n - 1, EAST], north - trail[n - 1, NORTH])
    # a way that bends evenly is longer than its chord
    half = 0.5 * abs(signed_angle(heading - trail[n - 1, HEADING]))
    if 1e-3 < half < 1.5:
        step *= half / np.sin(half)
    trail[n, EAST], trail[n, NORTH], trail[n, TIME] = east, north, time
    trail[n, THROUGH], trail[n, HEADING] = through, heading
    trail[n, ARC] = trail[n - 1, ARC] + step
    count[0] = n + 1


@compiled
def pace(trail: Floats, count: int) -> float:
    """Mean speed over ground at the end of a trail [m/s]; that through the water where there is no way yet."""
    if count < 2:
        return float(trail[0, THROUGH])
    last = count - 1
    i = last - 1
    while i > 0 and trail[last, TIME] - trail[i, TIME] < PACE_TIME - 1e-6:
        i -= 1
    return float((trail[last, ARC] - trail[i, ARC]) / (trail[last, TIME] - trail[i, TIME]))


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
def _chord(trail: Floats, a: int, b: int) -> tuple[float, float]:
    """East and north from point a to point b, for a metre of way; nothing where there is none."""
    length = trail[b, ARC] - trail[a, ARC]
    if length <= 0.0:
        return 0.0, 0.0
    return (trail[b, EAST] - trail[a, EAST]) / length, (trail[b, NORTH] - trail[a, NORTH]) / length


@compiled
def _slope(trail: Floats, count: int, i: int) -> tuple[float, float]:
    """East and north of the direction of the curve at point i; at its ends it bends on as before."""
    last = count - 1
    if count == 2:
        return _chord(trail, 0, 1)
    if 0 < i < last:
        return _chord(trail, i - 1, i + 1)
    inner = 1 if i == 0 else last - 1
    x, y = _chord(trail, 0, 1) if i == 0 else _chord(trail, last - 1, last)
    mean_x, mean_y = _chord(trail, inner - 1, inner + 1)
    return 2.0 * x - mean_x, 2.0 * y - mean_y


@compiled
def _straight(trail: Floats, i: int, course: float, beyond: float) -> Place:
    """A place so far beyond point i in a direction."""
    sine, cosine = np.sin(course), np.cos(course)
    return trail[i, EAST] + beyond * sine, trail[i, NORTH] + beyond * cosine, course, trail[i, THROUGH]


@compiled
def _tail_course(trail: Floats, count: int) -> float:
    """Course over the first stretch of a trail; the shorter it is yet, the more the heading said there instead."""
    course = trail[0, HEADING]
    i = 1
    while i < count - 1 and trail[i, ARC] < TAIL:
        i += 1
    made = np.arctan2(trail[i, EAST] - trail[0, EAST], trail[i, NORTH] - trail[0, NORTH])
    return float(course + signed_angle(made - course) * min(trail[i, ARC] / TAIL, 1.0))


@compiled
def at(trail: Floats, count: int, arc: float) -> Place:
    """The trail at a length of the way.

    Args:
        trail: columns EAST … THROUGH, shape (room, TRAIL).
        count: how many points it has, at least 1.
        arc: length of the way; less than that of the first point or more than that of the last is straight on [m].
    """
    last = count - 1
    if count < 2 or trail[last, ARC] <= 0.0:
        return _straight(trail, 0, trail[0, HEADING], arc)
    if arc <= 0.0:
        return _straight(trail, 0, _tail_course(trail, count), arc)
    if arc >= trail[last, ARC]:
        i = last - 1 if trail[last, ARC] - trail[last - 1, ARC] < SHORTEST and count > 2 else last
        x, y = _slope(trail, count, i)
        return _straight(trail, last, np.arctan2(x, y), arc - trail[last, ARC])
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if trail[middle, ARC] <= arc:
            low = middle
        else:
            high = middle
    length = trail[high, ARC] - trail[low, ARC]
    u = (arc - trail[low, ARC]) / length
    ax, ay = _slope(trail, count, low)
    bx, by = _slope(trail, count, high)
    dx, dy = trail[high, EAST] - trail[low, EAST], trail[high, NORTH] - trail[low, NORTH]
    # Hermite's cubic about the first point, and its derivative by u
    p, q, r = u * (1.0 - u) * (1.0 - u), u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    dp, dq, dr = (1.0 - u) * (1.0 - 3.0 * u), 6.0 * u * (1.0 - u), u * (3.0 * u - 2.0)
    east = trail[low, EAST] + length * (p * ax + r * bx) + q * dx
    north = trail[low, NORTH] + length * (p * ay + r * by) + q * dy
    slope_east = length * (dp * ax + dr * bx) + dq * dx
    slope_north = length * (dp * ay + dr * by) + dq * dy
    through = (1.0 - u) * trail[low, THROUGH] + u * trail[high, THROUGH]
    return east, north, float(np.arctan2(slope_east, slope_north)), through
