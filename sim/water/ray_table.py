"""A table of how much rays bend, for missions that follow thousands of pings.

A ray takes less time than sound would along the straight line. Its time over the length of that
line is the mean slowness along the line plus r² G, in which r is the horizontal distance and G, not
above zero, a smooth function of both depths and of r. G is interpolated by cubics of Hermite in
each of the three, so that its gradient is continuous; its derivatives at the nodes follow from the
angles of the ray.

Where another ray becomes the earliest, G has an edge, and where there is none, no value. Cells of
the table in which G at the middle differs from that of a traced ray are marked, and rays in them
are traced, from the angles at the corners on.
"""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bytes, Floats
from laisn.compiled import compiled, jitable
from sim.water.eigenrays import (
    FAN_RAYS,
    MAX_RAYS,
    MIN_CLEARANCE_M,
    NO_RAY,
    REFERENCE_M_S,
    Eigenray,
    Fan,
    Geometry,
    PathInWater,
    drop,
    earliest,
    earliest_of,
    eigenrays_of_fan,
    fill_fan,
    may_turn,
    refine,
    straight_slowness,
    trace_fan,
)
from sim.water.smooth_profile import SmoothProfile, speed_and_gradient

SMOOTH, MARKED, DARK = range(3)
"""Kinds of cells: G is interpolated, rays are traced, no ray gets there."""

_TOLERANCE_M = 1.5e-4  # error of the range within a cell above which the cell is marked
_SAME_RAY_RAD = 3e-3  # rays at corners that leave at angles nearer than this count as one


class RayTable(NamedTuple):
    """G at n depths of source and receiver from the surface down, and m distances from 0."""

    depth: Floats  # shape (n,), [m]
    range_step: float  # [m]
    # G, its derivatives by source, receiver and distance, by source and receiver, source and
    # distance, receiver and distance, and by all, shape (n, n, m, 8), [s/m³] and by m
    value: Floats
    departure: Floats  # angle at the source, positive downwards, shape (n, n, m), [rad]
    kind: Bytes  # of each cell: SMOOTH, MARKED or DARK, shape (n − 1, n − 1, m − 1)


class _Weights(NamedTuple):
    """Of value and slope at both ends of an interval."""

    left: float
    left_slope: float
    right: float
    right_slope: float


@jitable
def _weights(x: float, width: float) -> _Weights:
    """Weights of a cubic of Hermite at the part x, 0 … 1, of an interval of a width."""
    y = 1.0 - x
    return _Weights(
        y * y * (1.0 + 2.0 * x), x * y * y * width, x * x * (3.0 - 2.0 * x), -x * x * y * width
    )


@jitable
def _weighted(
    w: _Weights, left: float, left_slope: float, right: float, right_slope: float
) -> float:
    return w.left * left + w.left_slope * left_slope + w.right * right + w.right_slope * right_slope


@jitable
def _along_range(
    value: Floats, i: int, j: int, k: int, w: _Weights
) -> tuple[float, float, float, float]:
    """G, its derivatives by source and receiver and by both, between two distances."""
    a = value[i, j, k]
    b = value[i, j, k + 1]
    return (
        _weighted(w, a[0], a[3], b[0], b[3]),
        _weighted(w, a[1], a[5], b[1], b[5]),
        _weighted(w, a[2], a[6], b[2], b[6]),
        _weighted(w, a[4], a[7], b[4], b[7]),
    )


class _Cell(NamedTuple):
    """A cell, and a place in it in parts of its sides."""

    # of the first corner: index of the source's depth, the receiver's depth and the distance
    i: int
    j: int
    k: int
    # place along the same, each 0 … 1
    x: float
    y: float
    z: float


@compiled
def bending(table: RayTable, cell: _Cell) -> float:
    """G at a place in a cell."""
    i, j, k = cell.i, cell.j, cell.k
    by_range = _weights(cell.z, table.range_step)
    by_source = _weights(cell.x, table.depth[i + 1] - table.depth[i])
    by_receiver = _weights(cell.y, table.depth[j + 1] - table.depth[j])
    a = _along_range(table.value, i, j, k, by_range)
    b = _along_range(table.value, i, j + 1, k, by_range)
    left = _weighted(by_receiver, a[0], a[2], b[0], b[2])
    left_slope = _weighted(by_receiver, a[1], a[3], b[1], b[3])
    a = _along_range(table.value, i + 1, j, k, by_range)
    b = _along_range(table.value, i + 1, j + 1, k, by_range)
    right = _weighted(by_receiver, a[0], a[2], b[0], b[2])
    right_slope = _weighted(by_receiver, a[1], a[3], b[1], b[3])
    return _weighted(by_source, left, left_slope, right, right_slope)


@jitable
def _interval(depths: Floats, depth: float) -> int:
    """Index of the last of increasing depths that is not below another one, by halving."""
    low = 0
    high = depths.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if depths[middle] <= depth:
            low = middle
        else:
            high = middle
    return low


@jitable
def _traced(
    table: RayTable, w: PathInWater, cell: tuple[int, int, int], geometry: Geometry
) -> Eigenray:
    """The earliest ray in a marked cell."""
    i, j, k = cell
    tried_angles = np.empty(8)
    count = 0
    best = NO_RAY
    for corner in range(8):
        angle = table.departure[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)]
        is_new = angle == angle
        for t in range(count):
            is_new = is_new and abs(angle - tried_angles[t]) > _SAME_RAY_RAD
        if is_new:
            tried_angles[count] = angle
            count += 1
            ray = refine(w, geometry.source, geometry.receiver, geometry.distance, angle)
            if not best.time <= ray.time and ray.time == ray.time:
                best = ray
    if best.time == best.time:
        return best
    return earliest(w, geometry.source, geometry.receiver, geometry.distance)[0]


@compiled
def ray_slowness(
    table: RayTable, w: PathInWater, source: float, receiver: float, distance: float
) -> float:
    """Time of the earliest ray by the length of the straight path, between depths and at a
    horizontal distance [m]; NaN if there is no ray.
    """
    length = math.hypot(distance, drop(w, source, receiver))
    straight = straight_slowness(w, source, receiver)
    if length == 0.0:
        return straight
    if source > receiver:
        # the ray is the same in both directions, to the last digit
        source, receiver = receiver, source
    r = distance / table.range_step
    deepest = table.depth[table.depth.size - 1]
    if source > deepest or receiver > deepest or r >= table.kind.shape[2]:
        return earliest(w, source, receiver, distance)[0].time / length
    i = _interval(table.depth, source)
    j = _interval(table.depth, receiver)
    k = int(r)
    kind = table.kind[i, j, k]
    if kind == SMOOTH:
        x = (source - table.depth[i]) / (table.depth[i + 1] - table.depth[i])
        y = (receiver - table.depth[j]) / (table.depth[j + 1] - table.depth[j])
        return straight + distance * distance * bending(table, _Cell(i, j, k, x, y, r - k))
    if kind == DARK:
        return math.nan
    return _traced(table, w, (i, j, k), Geometry(source, receiver, distance)).time / length


@jitable
def _side(w: PathInWater, source: float, receiver: float, at_source: bool) -> float:
    """Derivative of the drop's size by a depth: 1 or −1."""
    if w.by_surface > 0:
        return 1.0
    if w.by_floor > 0:
        return -1.0
    return 1.0 if at_source == (source > receiver) else -1.0


@jitable
def _straight_slope(w: PathInWater, source: float, receiver: float, at_source: bool) -> float:
    """Derivative of the straight path's mean slowness by a depth [s/m²]."""
    speed, gradient, _ = speed_and_gradient(w.profile, source if at_source else receiver, 0)
    size = abs(drop(w, source, receiver))
    if size < 1e-3:
        return -0.5 * gradient / (speed * speed)
    side = _side(w, source, receiver, at_source)
    return side * (1.0 / speed - straight_slowness(w, source, receiver)) / size


@jitable
def _write_node(w: PathInWater, geometry: Geometry, ray: Eigenray, out: Floats) -> None:
    """Write G and its derivatives by source, receiver and distance."""
    source, receiver, distance = geometry
    size = abs(drop(w, source, receiver))
    length = math.hypot(distance, size)
    square = distance * distance
    slowness = ray.time / length
    out[0] = (slowness - straight_slowness(w, source, receiver)) / square
    at_source = REFERENCE_M_S / speed_and_gradient(w.profile, source, 0)[0]
    at_receiver = REFERENCE_M_S / speed_and_gradient(w.profile, receiver, 0)[0]
    # derivatives of the ray's time by both depths [s/m]
    by_depth = (
        -at_source * math.sin(ray.departure_angle) / REFERENCE_M_S,
        at_receiver * math.sin(ray.arrival_angle) / REFERENCE_M_S,
    )
    for number in range(2):
        is_source = number == 0
        length_slope = _side(w, source, receiver, is_source) * size / length
        slope = (by_depth[number] - slowness * length_slope) / length
        out[1 + number] = (slope - _straight_slope(w, source, receiver, is_source)) / square
    slope = (ray.horizontal_slowness - slowness * distance / length) / length
    out[3] = slope / square - 2.0 * out[0] / distance


@jitable
def _earliest_in_fan(
    w: PathInWater,
    geometry: Geometry,
    fan: Fan,
    ray_count: int,
    candidates: Floats,
) -> Eigenray:
    """The earliest ray between places, by a fan of rays at that distance."""
    source, receiver, distance = geometry
    if not may_turn(w.profile, distance, drop(w, source, receiver)):
        return earliest(w, source, receiver, distance)[0]
    return earliest_of(candidates, eigenrays_of_fan(w, geometry, fan, ray_count, candidates))


@compiled
def _widest(w: PathInWater, source: float) -> float:
    """Upper bound of the angles [rad] at a depth of all rays between places with `may_turn`."""
    speed = speed_and_gradient(w.profile, source, 0)[0]
    share = w.profile.slowest * speed / (w.profile.fastest * w.profile.fastest)
    return math.acos(min(1.0, share)) + 2e-3


@compiled
def _earliest_rays(
    w: PathInWater, source: float, receivers: Floats, ranges: Floats, earliest_rays: Floats
) -> None:
    """Write the earliest rays from a depth [m] to m depths at r distances [m] as numbers of
    `Eigenray`, shape (m, r, 4).
    """
    widest = _widest(w, source)
    first = -widest
    spacing = 2.0 * widest / (FAN_RAYS - 1)
    depths = np.empty((FAN_RAYS, ranges.size))
    trace_fan(w, source, first, spacing, ranges, depths)
    fan = Fan(np.empty(3 * FAN_RAYS), np.empty(3 * FAN_RAYS))
    candidates = np.empty((MAX_RAYS, 4))
    for k in range(ranges.size):
        ray_count = fill_fan(w, source, ranges[k], first, spacing, depths[:, k], fan)
        for j in range(receivers.size):
            geometry = Geometry(source, receivers[j], ranges[k])
            ray = _earliest_in_fan(w, geometry, fan, ray_count, candidates)
            for number in range(4):
                earliest_rays[j, k, number] = ray[number]


@compiled
def _trace_nodes(
    w: PathInWater, depth: Floats, range_step: float, value: Floats, departure: Floats
) -> None:
    """Fill the nodes of a table; cross derivatives excepted."""
    n = value.shape[0]
    m = value.shape[2]
    ranges = np.empty(m - 1)
    for k in range(1, m):
        ranges[k - 1] = k * range_step
    rays = np.empty((n, m - 1, 4))
    for i in range(n):
        _earliest_rays(w, depth[i], depth[i:], ranges, rays)
        for j in range(i, n):
            node = value[i, j]
            for k in range(1, m):
                numbers = rays[j - i, k - 1]
                ray = Eigenray(numbers[0], numbers[1], numbers[2], numbers[3])
                geometry = Geometry(depth[i], depth[j], ranges[k - 1])
                _write_node(w, geometry, ray, node[k])
                departure[i, j, k] = ray.departure_angle
                departure[j, i, k] = -ray.arrival_angle
            # G is even in the distance
            for number in range(3):
                node[0, number] = (4.0 * node[1, number] - node[2, number]) / 3.0
            node[0, 3] = 0.0
            departure[i, j, 0] = math.atan2(drop(w, depth[i], depth[j]), 0.0)
            departure[j, i, 0] = math.atan2(drop(w, depth[j], depth[i]), 0.0)
            for k in range(m):
                g, by_source, by_receiver, by_range = node[k, 0], node[k, 1], node[k, 2], node[k, 3]
                value[j, i, k, 0] = g
                value[j, i, k, 1] = by_receiver
                value[j, i, k, 2] = by_source
                value[j, i, k, 3] = by_range


@jitable
def _is_dark(table: RayTable, i: int, j: int, k: int) -> bool:
    """Whether there is no ray at any corner of a cell."""
    for corner in range(8):
        angle = table.departure[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)]
        if angle == angle:
            return False
    return True


@compiled
def _check_cells(w: PathInWater, table: RayTable, x: float, y: float, z: float) -> None:
    """Mark the cells in which the table is wrong, or has no value, at a place in parts of their
    sides.
    """
    n, _, m = table.kind.shape
    ranges = np.empty(m)
    for k in range(m):
        ranges[k] = (k + z) * table.range_step
    receivers = np.empty(n)
    for j in range(n):
        receivers[j] = table.depth[j] + y * (table.depth[j + 1] - table.depth[j])
    rays = np.empty((n, m, 4))
    for i in range(n):
        source = table.depth[i] + x * (table.depth[i + 1] - table.depth[i])
        _earliest_rays(w, source, receivers[i:], ranges, rays)
        for j in range(i, n):
            for k in range(m):
                time = rays[j - i, k, 0]
                length = math.hypot(ranges[k], drop(w, source, receivers[j]))
                straight = straight_slowness(w, source, receivers[j])
                bent = ranges[k] * ranges[k] * bending(table, _Cell(i, j, k, x, y, z))
                error = abs((straight + bent) * length - time) * REFERENCE_M_S
                if time != time and _is_dark(table, i, j, k):
                    table.kind[i, j, k] = DARK
                elif not error <= _TOLERANCE_M:
                    table.kind[i, j, k] = MARKED
                table.kind[j, i, k] = table.kind[i, j, k]


_CHECKED = ((0.5, 0.5, 0.5), (0.25, 0.75, 0.3))  # places in cells at which they are checked
_MAX_DEPTHS = 90  # largest number of depths of a table
_RANGES = 33  # number of distances of a table
_FINEST_M = 0.2  # smallest and largest step of depth [m]
_COARSEST_M = 2.0
_STEPS_A_BEND = 14.0  # steps of depth in L, with L² |d²c/dz²| the difference of largest and least c


def _depths(profile: SmoothProfile, deepest: float) -> Floats:
    """Depths of a table, close where the gradient changes."""
    depth = np.linspace(0.0, deepest, 2001)
    gradient = np.array([speed_and_gradient(profile, z, 0)[1] for z in depth.tolist()])
    curvature = np.abs(np.gradient(gradient, depth))
    change = max(profile.fastest - profile.slowest, 1e-6)
    step = np.sqrt(change / np.maximum(curvature, 1e-9)) / _STEPS_A_BEND
    step = np.clip(step, _FINEST_M, _COARSEST_M)
    # steps grow by no more than a quarter of the way
    for order in (slice(None), slice(None, None, -1)):
        ordered = step[order]
        for i in range(1, ordered.size):
            ordered[i] = min(ordered[i], ordered[i - 1] + 0.25 * (depth[1] - depth[0]))
    count = np.concatenate([[0.0], np.cumsum(0.5 * (1.0 / step[1:] + 1.0 / step[:-1]))])
    count *= depth[1] - depth[0]
    n = min(max(math.ceil(count[-1]), 4), _MAX_DEPTHS - 1) + 1
    nodes = np.interp(np.linspace(0.0, count[-1], n), count, depth)
    nodes[0] = MIN_CLEARANCE_M
    nodes[-1] = deepest
    return nodes


def table_of(w: PathInWater, deepest: float, farthest: float) -> RayTable:
    """The table of a path from the surface to a depth, and to a horizontal distance [m]."""
    depth = _depths(w.profile, min(deepest, w.floor - MIN_CLEARANCE_M))
    n = depth.size
    range_step = farthest / (_RANGES - 1)
    value = np.zeros((n, n, _RANGES, 8))
    departure = np.empty((n, n, _RANGES))
    _trace_nodes(w, depth, range_step, value, departure)
    axes = (depth, depth, range_step * np.arange(_RANGES))
    with np.errstate(invalid="ignore"):
        by_source, by_receiver, by_range = (
            np.gradient(value[..., number], *axes) for number in (1, 2, 3)
        )
        value[..., 4] = 0.5 * (by_source[1] + by_receiver[0])
        value[..., 5] = 0.5 * (by_source[2] + by_range[0])
        value[..., 6] = 0.5 * (by_receiver[2] + by_range[1])
        value[..., 7] = np.gradient(value[..., 4], axes[2], axis=2)
    kind = np.zeros((n - 1, n - 1, _RANGES - 1), dtype=np.uint8)
    table = RayTable(depth, range_step, value, departure, kind)
    for x, y, z in _CHECKED:
        _check_cells(w, table, x, y, z)
    return table
