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

# `x != x` and negated comparisons such as `not x <= y` are meant: they are true for NaN

REFERENCE_M_S = 1500.0
_REFERENCE_SQUARED = REFERENCE_M_S * REFERENCE_M_S
_MAX_HORIZONTAL_STEP_M = 2.0  # of a step along a ray
_MAX_VERTICAL_STEP_M = 0.5
_MIN_STEPS = 8
_SEARCH_TOLERANCE_M = 1e-8  # of the receiver's depth, at which the search for a ray ends
_ACCEPTED_MISS_M = 1e-4  # of a ray that ends at the receiver
MIN_CLEARANCE_M = 1e-3  # least distance of places from surface and floor
FAN_RAYS = 257  # number of rays that leave a source when all that join two places are searched
_EDGE_HALVINGS = 14  # of the interval in which a fan's rays cease to be of the wanted path
MAX_RAYS = 16  # largest number of rays of one path between two places that are looked for
_STEEP_SQUARE = 4e-4  # q² above which q follows from n² and p
# horizontal over vertical distance, below which bending is not noticeable
_NEAR_VERTICAL_RATIO = 1e-4


class PathInWater(NamedTuple):
    """The path that is wanted, direct or with one reflection at the surface or the floor, and the
    water in which its rays run.
    """

    profile: SmoothProfile
    floor: float  # depth of the floor [m]
    # reflections that the wanted path has: 0 or 1; at most one of the two is 1
    by_surface: int
    by_floor: int


class Geometry(NamedTuple):
    """Depths of source and receiver, and their horizontal distance [m]."""

    source: float
    receiver: float
    distance: float


class Eigenray(NamedTuple):
    """A ray that joins two places; NaN if there is none."""

    time: float  # [s]
    departure_angle: float  # at the source, positive downwards [rad]
    arrival_angle: float  # at the receiver, positive where the ray runs downwards [rad]
    horizontal_slowness: float  # horizontal part of the slowness [s/m]; p is this times 1500 m/s


NO_RAY = Eigenray(math.nan, math.nan, math.nan, math.nan)


@jitable
def drop(w: PathInWater, source: float, receiver: float) -> float:
    """Depth of the receiver, or of its mirror image, below the source [m]."""
    if w.by_surface > 0:
        return -receiver - source
    if w.by_floor > 0:
        return 2.0 * w.floor - receiver - source
    return receiver - source


@compiled
def straight_slowness(w: PathInWater, source: float, receiver: float) -> float:
    """Mean of 1/c over the depths that a path crosses [s/m]."""
    if w.by_surface == 0 and w.by_floor == 0:
        return mean_slowness(w.profile, source, receiver)
    boundary = 0.0 if w.by_surface > 0 else w.floor
    first = abs(source - boundary)
    second = abs(receiver - boundary)
    if first + second == 0.0:
        return 1.0 / speed_and_gradient(w.profile, boundary, 0)[0]
    crossing_time = first * mean_slowness(w.profile, source, boundary) + second * mean_slowness(
        w.profile, receiver, boundary
    )
    return crossing_time / (first + second)


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
    square = _REFERENCE_SQUARED / (speed * speed)
    return square, -square * gradient / speed, i


class RayState(NamedTuple):
    """Where a ray is."""

    depth: float  # [m]
    vertical: float  # q
    time: float  # since it left, times 1500 m/s [m]
    interval: int  # of the profile


NO_STATE = RayState(math.nan, math.nan, math.nan, 0)
"""A ray that meets surface or floor otherwise than wanted."""


# not a formula: inlined wherever it is called it would take the compiler twenty seconds more
@compiled
def _advance(
    depths: Floats, cubic: Floats, horizontal: float, state: RayState, h: float
) -> RayState:
    """The state after a step `h` of σ; `horizontal` is p, a multiple of 1 / 1500 s/m."""
    z = state.depth
    q = state.vertical
    n2_first, k1, i = _medium(depths, cubic, z, state.interval)
    # q from n² = p² + q²: an integrated q would keep the errors of steps over kinks of the gradient
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


class _Hits(NamedTuple):
    """Reflections of a ray so far."""

    surface: int
    floor: int


@compiled
def _reflect(
    w: PathInWater, horizontal: float, state: RayState, h: float, hits: _Hits
) -> tuple[RayState, _Hits]:
    """A step that meets surface or floor; it ends early where that is more often than wanted."""
    depths = w.profile.depth
    cubic = w.profile.cubic
    at_surface, at_floor = hits
    remaining = h
    while True:
        ahead = _advance(depths, cubic, horizontal, state, remaining)
        if 0.0 <= ahead.depth <= w.floor:
            return ahead, _Hits(at_surface, at_floor)
        boundary = 0.0 if ahead.depth < 0.0 else w.floor
        if ahead.depth < 0.0:
            at_surface += 1
        else:
            at_floor += 1
        if at_surface > w.by_surface or at_floor > w.by_floor:
            return state, _Hits(at_surface, at_floor)
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
def _launch(profile: SmoothProfile, depth: float, angle: float) -> tuple[float, float]:
    """Horizontal and vertical slowness of a ray that leaves a depth at an angle."""
    slowness = REFERENCE_M_S / speed_and_gradient(profile, depth, 0)[0]
    return slowness * math.cos(angle), slowness * math.sin(angle)


@jitable
def _steps(distance: float, depth_change: float) -> int:
    return max(
        _MIN_STEPS,
        math.ceil(distance / _MAX_HORIZONTAL_STEP_M),
        math.ceil(abs(depth_change) / _MAX_VERTICAL_STEP_M),
    )


@compiled
def trace(w: PathInWater, source: float, angle: float, distance: float, steps: int) -> RayState:
    """Follow a ray from a depth [m] at an angle [rad] to a horizontal distance [m], in so many
    steps; `NO_STATE` if it is not of the wanted path.
    """
    horizontal, vertical = _launch(w.profile, source, angle)
    h = distance / (steps * horizontal)
    state = RayState(source, vertical, 0.0, 0)
    hits = _Hits(0, 0)
    depths = w.profile.depth
    cubic = w.profile.cubic
    for _ in range(steps):
        ahead = _advance(depths, cubic, horizontal, state, h)
        if not 0.0 <= ahead.depth <= w.floor:
            ahead, hits = _reflect(w, horizontal, state, h, hits)
            if hits.surface > w.by_surface or hits.floor > w.by_floor:
                return NO_STATE
        state = ahead
    if hits.surface < w.by_surface or hits.floor < w.by_floor:
        return NO_STATE
    return state


@compiled
def trace_fan(
    w: PathInWater, source: float, first: float, spacing: float, ranges: Floats, depths: Floats
) -> None:
    """Write the depths of rays that leave a depth [m] at angles with a spacing [rad], at
    increasing horizontal distances, shape (m,), [m], to `depths`, shape (rays, m).
    """
    for j in range(depths.shape[0]):
        horizontal, vertical = _launch(w.profile, source, first + j * spacing)
        state = RayState(source, vertical, 0.0, 0)
        hits = _Hits(0, 0)
        last_range = 0.0
        for k in range(ranges.size):
            steps = max(1, math.ceil((ranges[k] - last_range) / _MAX_HORIZONTAL_STEP_M))
            h = (ranges[k] - last_range) / (steps * horizontal)
            if hits.surface > w.by_surface or hits.floor > w.by_floor:
                depths[j, k] = math.nan
                continue
            for _ in range(steps):
                ahead = _advance(w.profile.depth, w.profile.cubic, horizontal, state, h)
                if not 0.0 <= ahead.depth <= w.floor:
                    ahead, hits = _reflect(w, horizontal, state, h, hits)
                    if hits.surface > w.by_surface or hits.floor > w.by_floor:
                        break
                state = ahead
            is_wanted = hits.surface == w.by_surface and hits.floor == w.by_floor
            depths[j, k] = state.depth if is_wanted else math.nan
            last_range = ranges[k]


@jitable
def _eigenray(
    w: PathInWater, source: float, angle: float, end: RayState, receiver: float
) -> Eigenray:
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
def refine(
    w: PathInWater, source: float, receiver: float, distance: float, angle: float
) -> Eigenray:
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
    w: PathInWater,
    geometry: Geometry,
    steps: int,
    left: tuple[float, float],
    right: tuple[float, float],
) -> Eigenray:
    """The eigenray between two angles with misses of different signs, by false position: the miss
    of the end that stays is halved at every step (after the Illinois method), and every eighth step
    bisects.
    """
    source, receiver, distance = geometry
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
        # halving changes where the next angle lies, not the sign of a miss
    if not abs(end.depth - receiver) <= _ACCEPTED_MISS_M:
        return NO_RAY
    return _eigenray(w, source, angle, end, receiver)


@jitable
def _edge(
    w: PathInWater, source: float, distance: float, valid_angle: float, invalid_angle: float
) -> float:
    """Halve the interval between an angle whose ray is of the wanted path and one whose ray is not;
    gives the end that still is.
    """
    steps = _steps(distance, 0.0)
    for _ in range(_EDGE_HALVINGS):
        middle = 0.5 * (valid_angle + invalid_angle)
        # NaN: not of the wanted path
        if trace(w, source, middle, distance, steps).depth >= 0.0:
            valid_angle = middle
        else:
            invalid_angle = middle
    return valid_angle


class Fan(NamedTuple):
    """Rays that leave a depth: where they are at a distance."""

    angle: Floats  # increasing, shape (n,), [rad]
    depth: Floats  # shape (n,), [m]; NaN where a ray is not of the wanted path


@compiled
def fill_fan(
    w: PathInWater,
    source: float,
    distance: float,
    first: float,
    spacing: float,
    depths: Floats,
    fan: Fan,
) -> int:
    """Write into `fan` rays of known depths, shape (rays,), and, wherever a ray of the wanted path
    has a neighbour that is not, the last one that still is; gives how many rays it then has (`fan`
    has room for more).

    `first` is the angle of the first of the known rays, `spacing` that between them [rad].
    """
    count = 0
    for j in range(depths.size):
        angle = first + j * spacing
        is_lost = depths[j] != depths[j]
        if j > 0 and is_lost != (depths[j - 1] != depths[j - 1]):
            last_angle = angle - spacing
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
    """Angle at which the miss, a parabola through three rays, is extreme; NaN if the rays are not
    evenly spaced, or if the extremum is not on the side of zero, so that it cannot change the sign.
    """
    a, b, c = fan.depth[j - 1] - receiver, fan.depth[j] - receiver, fan.depth[j + 1] - receiver
    spacing = fan.angle[j + 1] - fan.angle[j]
    is_evenly_spaced = abs(fan.angle[j] - fan.angle[j - 1] - spacing) < 1e-9
    curve = a - 2.0 * b + c
    same_signs = (a > 0.0) == (b > 0.0) and (c > 0.0) == (b > 0.0)
    is_nearest = abs(b) <= abs(a) and abs(b) <= abs(c)
    if is_evenly_spaced and same_signs and is_nearest and curve * b > 0.0:
        return float(fan.angle[j] - 0.5 * spacing * (c - a) / curve)
    return math.nan


@jitable
def _add_between(
    w: PathInWater,
    geometry: Geometry,
    left: tuple[float, float],
    right: tuple[float, float],
    count: int,
    candidates: Floats,
) -> int:
    """Add the eigenray between two angles and misses, if these have different signs."""
    if (left[1] < 0.0) == (right[1] < 0.0) or count == MAX_RAYS:
        return count
    steps = _steps(geometry.distance, drop(w, geometry.source, geometry.receiver))
    ray = _between(w, geometry, steps, left, right)
    if ray.time != ray.time:
        return count
    for number in range(4):
        candidates[count, number] = ray[number]
    return count + 1


@compiled
def eigenrays_of_fan(
    w: PathInWater, geometry: Geometry, fan: Fan, ray_count: int, candidates: Floats
) -> int:
    """Eigenrays among the rays of a fan.

    Args:
        w: the water.
        geometry: source, receiver and distance.
        fan: rays from the source at that distance.
        ray_count: how many it has.
        candidates: output, shape (16, 4): row k gets the fields of the k-th `Eigenray`; rows beyond
            the count are left as they are.

    Returns:
        How many there are, at most 16.
    """
    count = 0
    source, receiver, distance = geometry
    for j in range(1, ray_count):
        left = fan.angle[j - 1], fan.depth[j - 1] - receiver
        right = fan.angle[j], fan.depth[j] - receiver
        if left[1] != left[1] or right[1] != right[1]:
            continue
        count = _add_between(w, geometry, left, right, count, candidates)
        if j + 1 < ray_count and fan.depth[j + 1] == fan.depth[j + 1]:
            vertex_angle = _vertex_angle(fan, j, receiver)
            if vertex_angle == vertex_angle:
                steps = _steps(distance, drop(w, source, receiver))
                end = trace(w, source, vertex_angle, distance, steps)
                vertex = vertex_angle, end.depth - receiver
                # left and right are of one sign
                following = fan.angle[j + 1], fan.depth[j + 1] - receiver
                count = _add_between(w, geometry, left, vertex, count, candidates)
                count = _add_between(w, geometry, vertex, following, count, candidates)
    return count


@jitable
def steepest(profile: SmoothProfile, depth: float, distance: float, depth_change: float) -> float:
    """Upper bound of the angle [rad] at a depth of any ray that covers `depth_change` over
    `distance`.
    """
    speed = speed_and_gradient(profile, depth, 0)[0]
    straight_cosine = distance / math.hypot(distance, depth_change)
    return math.acos(min(1.0, straight_cosine * speed / profile.fastest))


@jitable
def may_turn(profile: SmoothProfile, distance: float, depth_change: float) -> bool:
    """Whether a ray that covers `depth_change` over `distance` may turn on the way. If none may,
    exactly one ray joins the two depths, and its depth is monotone.
    """
    return distance / math.hypot(distance, depth_change) * profile.fastest >= profile.slowest


@jitable
def _steep_ray(w: PathInWater, geometry: Geometry) -> Eigenray:
    """The only ray between places so steeply apart that no ray that turns joins them."""
    source, receiver, distance = geometry
    depth_change = drop(w, source, receiver)
    if distance < _NEAR_VERTICAL_RATIO * abs(depth_change):
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
def eigenrays(
    w: PathInWater, source: float, receiver: float, distance: float, candidates: Floats
) -> int:
    """All rays of a path that join two depths at a horizontal distance [m].

    Args:
        w: the water, and the path.
        source: depth between surface and floor [m].
        receiver: the same.
        distance: horizontal one [m].
        candidates: output, shape (16, 4): row k gets the fields of the k-th `Eigenray`; rows beyond
            the count are left as they are.

    Returns:
        How many there are, at most 16.
    """
    depth_change = drop(w, source, receiver)
    if distance == 0.0 and depth_change == 0.0:
        for number in range(4):
            candidates[0, number] = 0.0
        return 1
    geometry = Geometry(source, receiver, distance)
    if not may_turn(w.profile, distance, depth_change):
        ray = _steep_ray(w, geometry)
        if ray.time == ray.time:
            for number in range(4):
                candidates[0, number] = ray[number]
            return 1
    max_angle = min(
        steepest(w.profile, source, distance, depth_change) + 1e-3, 0.5 * math.pi - 1e-6
    )
    first = -max_angle
    spacing = 2.0 * max_angle / (FAN_RAYS - 1)
    steps = _steps(distance, depth_change)
    depths = np.empty(FAN_RAYS)
    for j in range(FAN_RAYS):
        depths[j] = trace(w, source, first + j * spacing, distance, steps).depth
    fan = Fan(np.empty(3 * FAN_RAYS), np.empty(3 * FAN_RAYS))
    ray_count = fill_fan(w, source, distance, first, spacing, depths, fan)
    return eigenrays_of_fan(w, geometry, fan, ray_count, candidates)


@jitable
def earliest_of(candidates: Floats, count: int) -> Eigenray:
    """The ray that arrives first; `NO_RAY` if there is none."""
    best = NO_RAY
    for k in range(count):
        if not best.time <= candidates[k, 0]:
            best = Eigenray(candidates[k, 0], candidates[k, 1], candidates[k, 2], candidates[k, 3])
    return best


@compiled
def earliest(
    w: PathInWater, source: float, receiver: float, distance: float
) -> tuple[Eigenray, int]:
    """The ray of a path that arrives first, and how many there are; arguments as of
    `eigenrays`. It is the same ray in both directions.
    """
    candidates = np.empty((MAX_RAYS, 4))
    if source <= receiver:
        count = eigenrays(w, source, receiver, distance, candidates)
        return earliest_of(candidates, count), count
    count = eigenrays(w, receiver, source, distance, candidates)
    ray = earliest_of(candidates, count)
    reverse = Eigenray(ray.time, -ray.arrival_angle, -ray.departure_angle, ray.horizontal_slowness)
    return reverse, count
