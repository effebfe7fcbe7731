"""Rays that bend: which of them join two places, how long sound takes, and where it comes from.

In water whose speed of sound c depends on depth z alone a ray is the path of a particle: with the
slowness n = 1/c, its horizontal part p and vertical part q, and dσ = c ds,

    dr/dσ = p,    dz/dσ = q,    dq/dσ = ½ d(n²)/dz,    dT/dσ = n² = p² + q²,    p constant

(Jensen, Kuperman, Porter & Schmidt, Computational Ocean Acoustics, 2011, Section 3.2). Nyström's
method of fourth order integrates it (Hairer, Nørsett & Wanner, Solving Ordinary Differential
Equations I, 1993, II.14). A ray turns where q passes zero, which is no special case.

The speed of sound is that of level, unmoved water; surface and floor are level and reflect as
mirrors. Depths z are positive down, angles positive downwards from the horizontal. Slownesses are
multiples of 1 / 1500 s/m, so that times are metres at 1500 m/s.
"""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, formula, jitable
from sim.water.smooth_profile import SmoothProfile, mean_slowness, speed_and_gradient

REFERENCE_M_S = 1500.0
_SQUARE = REFERENCE_M_S * REFERENCE_M_S
_MAX_HORIZONTAL_STEP_M = 2.0  # of a step along a ray
_MAX_VERTICAL_STEP_M = 0.5
_MIN_STEPS = 8
_SEARCH_TOLERANCE_M = 1e-8  # of the receiver's depth, at which the search for a ray ends
_ACCEPTED_MISS_M = 1e-4  # of a ray that ends at the receiver
CLEAR_M = 1e-3  # least distance of places from surface and floor
FAN = 257  # rays of a fan
_EDGE_HALVINGS = 14  # of the interval in which a fan's rays cease to be of the wanted path
MAX_RAYS = 16
_STEEP_SQUARE = 4e-4  # q² above which q follows from n² and p
_VERTICAL = 1e-4  # horizontal by vertical distance, below which a ray does not bend noticeably


class Water(NamedTuple):
    """Water in which rays run: its speed of sound, its floor, and how often a ray meets surface
    and floor.
    """

    profile: SmoothProfile
    floor: float  # depth of the floor [m]
    by_surface: int  # reflections that the wanted path has
    by_floor: int


class Eigenray(NamedTuple):
    """A ray that joins two places; NaN if there is none."""

    time: float  # [s]
    departure: float  # angle at the source, positive downwards [rad]
    arrival: float  # angle at the receiver, positive where it runs downwards [rad]
    horizontal: float  # horizontal part of the slowness [s/m]; p is this times 1500 m/s


NO_RAY = Eigenray(math.nan, math.nan, math.nan, math.nan)


@jitable
def drop(w: Water, source: float, receiver: float) -> float:
    """Depth of the receiver, or of its mirror image, below the source [m]."""
    if w.by_surface > 0:
        return -receiver - source
    if w.by_floor > 0:
        return 2.0 * w.floor - receiver - source
    return receiver - source


@compiled
def straight_slowness(w: Water, source: float, receiver: float) -> float:
    """Mean of 1/c over the depths that a path crosses [s/m]."""
    if w.by_surface == 0 and w.by_floor == 0:
        return mean_slowness(w.profile, source, receiver)
    turn = 0.0 if w.by_surface > 0 else w.floor
    first = abs(source - turn)
    second = abs(receiver - turn)
    if first + second == 0.0:
        return 1.0 / speed_and_gradient(w.profile, turn, 0)[0]
    legs = first * mean_slowness(w.profile, source, turn) + second * mean_slowness(
        w.profile, receiver, turn
    )
    return legs / (first + second)


@formula
def _medium(depths: Floats, cubic: Floats, depth: float, i: int) -> tuple[float, float, int]:
    """n² and ½ d(n²)/dz at a depth, and the interval of the profile, searched from a near one."""
    while i + 1 < depths.size and depths[i + 1] <= depth:
        i += 1
    while i > 0 and depths[i] > depth:
        i -= 1
    x = max(depth - depths[i], 0.0)
    second = cubic[i, 2]
    third = cubic[i, 3]
    speed = cubic[i, 0] + x * (cubic[i, 1] + x * (second + x * third))
    gradient = cubic[i, 1] + x * (2.0 * second + 3.0 * x * third)
    square = _SQUARE / (speed * speed)
    return square, -square * gradient / speed, i


class RayState(NamedTuple):
    """Where a ray is."""

    depth: float  # [m]
    vertical: float  # q
    time: float  # since it left, times 1500 m/s [m]
    interval: int  # of the profile


NO_STATE = RayState(math.nan, math.nan, math.nan, 0)
"""A ray that meets surface or floor otherwise than wanted."""


@formula
def _advance(
    depths: Floats, cubic: Floats, horizontal: float, state: RayState, h: float
) -> RayState:
    """A step h of σ on; `horizontal` is p, a multiple of 1 / 1500 s/m."""
    z = state.depth
    q = state.vertical
    n2_first, k1, i = _medium(depths, cubic, z, state.interval)
    # n² = p² + q² keeps what steps over kinks of the gradient would lose
    vertical_squared = n2_first - horizontal * horizontal
    if vertical_squared > _STEEP_SQUARE:
        q = math.copysign(math.sqrt(vertical_squared), q)
    n2_middle, k2, i = _medium(depths, cubic, z + 0.5 * h * q + 0.125 * h * h * k1, i)
    n2_last, k3, i = _medium(depths, cubic, z + h * q + 0.5 * h * h * k2, i)
    return RayState(
        z + h * q + h * h / 6.0 * (k1 + 2.0 * k2),
        q + h / 6.0 * (k1 + 4.0 * k2 + k3),
        state.time + h / 6.0 * (n2_first + 4.0 * n2_middle + n2_last),
        i,
    )


@compiled
def _reflect(
    w: Water, horizontal: float, state: RayState, h: float, hits: tuple[int, int]
) -> tuple[RayState, tuple[int, int]]:
    """A step that meets surface or floor; it ends early where that is more often than wanted."""
    depths = w.profile.depth
    cubic = w.profile.cubic
    surface, bottom = hits
    remaining = h
    while True:
        ahead = _advance(depths, cubic, horizontal, state, remaining)
        if 0.0 <= ahead.depth <= w.floor:
            return ahead, (surface, bottom)
        boundary = 0.0 if ahead.depth < 0.0 else w.floor
        if ahead.depth < 0.0:
            surface += 1
        else:
            bottom += 1
        if surface > w.by_surface or bottom > w.by_floor:
            return state, (surface, bottom)
        # Newton for the part of the step at which the boundary is met
        step = remaining * (state.depth - boundary) / (state.depth - ahead.depth)
        reached = state
        for _ in range(6):
            reached = _advance(depths, cubic, horizontal, state, step)
            if reached.vertical == 0.0:
                break
            step = min(max(step - (reached.depth - boundary) / reached.vertical, 0.0), remaining)
        reached = _advance(depths, cubic, horizontal, state, step)
        state = RayState(boundary, -reached.vertical, reached.time, reached.interval)
        remaining -= step


@jitable
def _launch(p: SmoothProfile, depth: float, angle: float) -> tuple[float, float]:
    """Horizontal and vertical slowness of a ray that leaves a depth at an angle."""
    slowness = REFERENCE_M_S / speed_and_gradient(p, depth, 0)[0]
    return slowness * math.cos(angle), slowness * math.sin(angle)


@jitable
def _steps(distance: float, depth_change: float) -> int:
    return max(
        _MIN_STEPS,
        math.ceil(distance / _MAX_HORIZONTAL_STEP_M),
        math.ceil(abs(depth_change) / _MAX_VERTICAL_STEP_M),
    )


@compiled
def trace(w: Water, source: float, angle: float, distance: float, steps: int) -> RayState:
    """Follow a ray from a depth [m] at an angle [rad] to a horizontal distance [m]."""
    horizontal, vertical = _launch(w.profile, source, angle)
    h = distance / (steps * horizontal)
    state = RayState(source, vertical, 0.0, 0)
    hits = (0, 0)
    depths = w.profile.depth
    cubic = w.profile.cubic
    for _ in range(steps):
        ahead = _advance(depths, cubic, horizontal, state, h)
        if not 0.0 <= ahead.depth <= w.floor:
            ahead, hits = _reflect(w, horizontal, state, h, hits)
            if hits[0] > w.by_surface or hits[1] > w.by_floor:
                return NO_STATE
        state = ahead
    if hits[0] < w.by_surface or hits[1] < w.by_floor:
        return NO_STATE
    return state


@compiled
def trace_fan(
    w: Water, source: float, first: float, spacing: float, ranges: Floats, depths: Floats
) -> None:
    """Write the depths of rays that leave a depth [m] at angles with a spacing [rad], at
    increasing horizontal distances, shape (m,), [m], to `depths`, shape (rays, m).
    """
    for j in range(depths.shape[0]):
        horizontal, vertical = _launch(w.profile, source, first + j * spacing)
        state = RayState(source, vertical, 0.0, 0)
        hits = (0, 0)
        last_range = 0.0
        for k in range(ranges.size):
            steps = max(1, math.ceil((ranges[k] - last_range) / _MAX_HORIZONTAL_STEP_M))
            h = (ranges[k] - last_range) / (steps * horizontal)
            if hits[0] > w.by_surface or hits[1] > w.by_floor:
                depths[j, k] = math.nan
                continue
            for _ in range(steps):
                ahead = _advance(w.profile.depth, w.profile.cubic, horizontal, state, h)
                if not 0.0 <= ahead.depth <= w.floor:
                    ahead, hits = _reflect(w, horizontal, state, h, hits)
                    if hits[0] > w.by_surface or hits[1] > w.by_floor:
                        break
                state = ahead
            is_wanted = hits[0] == w.by_surface and hits[1] == w.by_floor
            depths[j, k] = state.depth if is_wanted else math.nan
            last_range = ranges[k]


@jitable
def _eigenray(w: Water, source: float, angle: float, end: RayState, receiver: float) -> Eigenray:
    """An eigenray of a ray that ends within a small miss of the receiver."""
    horizontal, _ = _launch(w.profile, source, angle)
    time = end.time + end.vertical * (receiver - end.depth)
    return Eigenray(
        time / REFERENCE_M_S,
        angle,
        math.atan2(end.vertical, horizontal),
        horizontal / REFERENCE_M_S,
    )


@compiled
def refine(w: Water, source: float, receiver: float, distance: float, angle: float) -> Eigenray:
    """The eigenray near an angle of departure, by secants; `NO_RAY` where they lead to none."""
    steps = _steps(distance, drop(w, source, receiver))
    last_angle = angle
    last = trace(w, source, last_angle, distance, steps)
    slope = distance / math.cos(angle) ** 2
    for _ in range(12):
        miss = last.depth - receiver
        if not abs(miss) > _SEARCH_TOLERANCE_M:
            break
        change = -miss / slope
        change = min(max(change, -0.05), 0.05)
        angle = last_angle + change
        if not abs(angle) < 0.5 * math.pi:
            return NO_RAY
        end = trace(w, source, angle, distance, steps)
        if end.depth != end.depth:
            return NO_RAY
        slope = (end.depth - last.depth) / change if end.depth != last.depth else slope
        last = end
        last_angle = angle
    if not abs(last.depth - receiver) <= _ACCEPTED_MISS_M:
        return NO_RAY
    return _eigenray(w, source, last_angle, last, receiver)


@jitable
def _between(
    w: Water,
    places: tuple[float, float, float],
    steps: int,
    left: tuple[float, float],
    right: tuple[float, float],
) -> Eigenray:
    """The eigenray between two angles with misses of different signs (Illinois method)."""
    source, receiver, distance = places
    a, miss_a = left
    b, miss_b = right
    angle = a
    end = NO_STATE
    for k in range(80):
        if k % 8 == 7:
            angle = 0.5 * (a + b)
        else:
            angle = (a * miss_b - b * miss_a) / (miss_b - miss_a)
        end = trace(w, source, angle, distance, steps)
        miss = end.depth - receiver
        if not abs(miss) > _SEARCH_TOLERANCE_M or b - a < 1e-15:
            break
        if (miss < 0.0) == (miss_b < 0.0):
            b = angle
            miss_b = miss
            miss_a *= 0.5
        else:
            a = angle
            miss_a = miss
            miss_b *= 0.5
        # halved misses only steer; signs hold
    if not abs(end.depth - receiver) <= _ACCEPTED_MISS_M:
        return NO_RAY
    return _eigenray(w, source, angle, end, receiver)


@jitable
def _edge(w: Water, source: float, distance: float, valid: float, invalid: float) -> float:
    """The last angle between one whose ray is of the wanted path and one whose is not, at which
    it is.
    """
    steps = _steps(distance, 0.0)
    for _ in range(_EDGE_HALVINGS):
        middle = 0.5 * (valid + invalid)
        if trace(w, source, middle, distance, steps).depth >= 0.0:
            valid = middle
        else:
            invalid = middle
    return valid


class Fan(NamedTuple):
    """Rays that leave a depth: where they are at a distance."""

    angle: Floats  # increasing, shape (n,), [rad]
    depth: Floats  # shape (n,), [m]; NaN where a ray is not of the wanted path


@compiled
def add_edges(
    w: Water, source: float, distance: float, angles: tuple[float, float], depths: Floats, fan: Fan
) -> int:
    """Fill a fan with rays, whose depths have the shape (rays,), and with the last ray of the
    wanted path beside each that is lost; gives their number.

    `angles` are that of the first ray and their spacing [rad].
    """
    count = 0
    for j in range(depths.size):
        angle = angles[0] + j * angles[1]
        is_lost = depths[j] != depths[j]
        if j > 0 and is_lost != (depths[j - 1] != depths[j - 1]):
            last_angle = angle - angles[1]
            if is_lost:
                edge = _edge(w, source, distance, last_angle, angle)
            else:
                edge = _edge(w, source, distance, angle, last_angle)
            fan.angle[count] = edge
            fan.depth[count] = trace(w, source, edge, distance, _steps(distance, 0.0)).depth
            count += 1
        fan.angle[count] = angle
        fan.depth[count] = depths[j]
        count += 1
    return count


@jitable
def _vertex_angle(fan: Fan, j: int, receiver: float) -> float:
    """Angle of the extremum of the miss of a receiver's depth, by a parabola through three rays;
    NaN if they are not evenly spaced, or the extremum cannot have another sign than they have.
    """
    a, b, c = fan.depth[j - 1] - receiver, fan.depth[j] - receiver, fan.depth[j + 1] - receiver
    spacing = fan.angle[j + 1] - fan.angle[j]
    is_even = abs(fan.angle[j] - fan.angle[j - 1] - spacing) < 1e-9
    curve = a - 2.0 * b + c
    same_signs = (a > 0.0) == (b > 0.0) and (c > 0.0) == (b > 0.0)
    if is_even and same_signs and abs(b) <= abs(a) and abs(b) <= abs(c) and curve * b > 0.0:
        return float(fan.angle[j] - 0.5 * spacing * (c - a) / curve)
    return math.nan


@jitable
def _add_between(
    w: Water,
    places: tuple[float, float, float],
    left: tuple[float, float],
    right: tuple[float, float],
    count: int,
    candidates: Floats,
) -> int:
    """Add the eigenray between two angles and misses, if these have different signs."""
    if (left[1] < 0.0) == (right[1] < 0.0) or count == MAX_RAYS:
        return count
    steps = _steps(places[2], drop(w, places[0], places[1]))
    ray = _between(w, places, steps, left, right)
    if ray.time != ray.time:
        return count
    for number in range(4):
        candidates[count, number] = ray[number]
    return count + 1


@compiled
def roots(
    w: Water, places: tuple[float, float, float], fan: Fan, rays: int, candidates: Floats
) -> int:
    """Eigenrays among the rays of a fan.

    Args:
        w: the water.
        places: depths of source and receiver, and their horizontal distance [m].
        fan: rays from the source at that distance.
        rays: how many it has.
        candidates: out: a row of each ray, fields of `Eigenray`, shape (16, 4); later rows are
            not written.

    Returns:
        How many there are, at most 16.
    """
    count = 0
    receiver = places[1]
    for j in range(1, rays):
        left = fan.angle[j - 1], fan.depth[j - 1] - receiver
        right = fan.angle[j], fan.depth[j] - receiver
        if left[1] != left[1] or right[1] != right[1]:
            continue
        count = _add_between(w, places, left, right, count, candidates)
        if j + 1 < rays and fan.depth[j + 1] == fan.depth[j + 1]:
            vertex_angle = _vertex_angle(fan, j, receiver)
            if vertex_angle == vertex_angle:
                steps = _steps(places[2], drop(w, places[0], receiver))
                end = trace(w, places[0], vertex_angle, places[2], steps)
                vertex = vertex_angle, end.depth - receiver
                # left and right are of one sign
                following = fan.angle[j + 1], fan.depth[j + 1] - receiver
                count = _add_between(w, places, left, vertex, count, candidates)
                count = _add_between(w, places, vertex, following, count, candidates)
    return count


@jitable
def steepest(p: SmoothProfile, depth: float, distance: float, depth_change: float) -> float:
    """A bound of the angles at a depth of all rays that have a mean slope."""
    speed = speed_and_gradient(p, depth, 0)[0]
    return math.acos(min(1.0, distance / math.hypot(distance, depth_change) * speed / p.fastest))


@jitable
def may_turn(p: SmoothProfile, distance: float, depth_change: float) -> bool:
    """Whether a ray with a mean slope may turn: else there is one, whose depth is monotone."""
    return distance / math.hypot(distance, depth_change) * p.fastest >= p.slowest


@jitable
def _steep_ray(w: Water, places: tuple[float, float, float]) -> Eigenray:
    """The one ray between places that no ray that turns can join."""
    source, receiver, distance = places
    depth_change = drop(w, source, receiver)
    if distance < _VERTICAL * abs(depth_change):
        slowness = straight_slowness(w, source, receiver)
        angle = math.atan2(depth_change, distance)
        length = math.hypot(depth_change, distance)
        reflected = w.by_surface + w.by_floor > 0
        return Eigenray(
            length * slowness,
            angle,
            -angle if reflected else angle,
            distance / length * slowness,
        )
    return refine(w, source, receiver, distance, math.atan2(depth_change, distance))


@compiled
def eigenrays(w: Water, source: float, receiver: float, distance: float, candidates: Floats) -> int:
    """All rays of a path that join two depths at a horizontal distance [m].

    Args:
        w: the water, and the path.
        source: depth between surface and floor [m].
        receiver: the same.
        distance: horizontal one [m].
        candidates: out: a row of each ray, fields of `Eigenray`, shape (16, 4); later rows are
            not written.

    Returns:
        How many there are, at most 16.
    """
    depth_change = drop(w, source, receiver)
    if distance == 0.0 and depth_change == 0.0:
        for number in range(4):
            candidates[0, number] = 0.0
        return 1
    places = source, receiver, distance
    if not may_turn(w.profile, distance, depth_change):
        ray = _steep_ray(w, places)
        if ray.time == ray.time:
            for number in range(4):
                candidates[0, number] = ray[number]
            return 1
    max_angle = min(
        steepest(w.profile, source, distance, depth_change) + 1e-3, 0.5 * math.pi - 1e-6
    )
    angles = (-max_angle, 2.0 * max_angle / (FAN - 1))
    steps = _steps(distance, depth_change)
    depths = np.empty(FAN)
    for j in range(FAN):
        depths[j] = trace(w, source, angles[0] + j * angles[1], distance, steps).depth
    fan = Fan(np.empty(3 * FAN), np.empty(3 * FAN))
    rays = add_edges(w, source, distance, angles, depths, fan)
    return roots(w, places, fan, rays, candidates)


@jitable
def earliest_of(candidates: Floats, count: int) -> Eigenray:
    """The ray that arrives first; `NO_RAY` if there is none."""
    best = NO_RAY
    for k in range(count):
        if not best.time <= candidates[k, 0]:
            best = Eigenray(candidates[k, 0], candidates[k, 1], candidates[k, 2], candidates[k, 3])
    return best


@compiled
def earliest(w: Water, source: float, receiver: float, distance: float) -> tuple[Eigenray, int]:
    """The ray of a path that arrives first, and how many there are; arguments as of
    `eigenrays`. It is the same ray in both directions.
    """
    candidates = np.empty((MAX_RAYS, 4))
    if source <= receiver:
        count = eigenrays(w, source, receiver, distance, candidates)
        return earliest_of(candidates, count), count
    count = eigenrays(w, receiver, source, distance, candidates)
    ray = earliest_of(candidates, count)
    return Eigenray(ray.time, -ray.arrival, -ray.departure, ray.horizontal), count
