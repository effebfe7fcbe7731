"""Ranges and prediction to a fix, for a block of runs side by side: `fix.py` for lanes.

Every lane takes every branch and selects; only what is the same for all runs (the variant) branches truly.
"""

import math

import numpy as np
import numpy.typing as npt

from laisn import lane_rows as row
from laisn.compiled import compiled_lanes, inlined
from laisn.elementary import sin_cos
from laisn.estimates import FixKind
from laisn.lane_rows import LANES, Tuning

Floats = npt.NDArray[np.float64]

_TWO_POINTS = float(FixKind.TWO_POINTS)
_TANGENT = float(FixKind.TANGENT)
_ASTERN = float(FixKind.ASTERN)
_FUSED = float(FixKind.FUSED)
_LOST = float(FixKind.LOST)


@inlined
def _range_on_plane(slant: float, depth_difference: float) -> float:
    squared = slant * slant - depth_difference * depth_difference
    # The order of comparison lets NaN through: nothing was received.
    return math.sqrt(0.0 if squared < 0.0 else squared)


@compiled_lanes
def place_transmitters(block: Floats, t: Tuning) -> None:
    """Transmitters as the message places them, and the horizontal ranges to them."""
    half, offset = 0.5 * t.baseline, t.middle_offset
    for lane in range(LANES):
        own_depth = block[row.DEPTH + lane] - t.hydrophone_height
        sine, cosine = sin_cos(block[row.LEADER_HEADING + lane])
        block[row.LEADER_SIN + lane], block[row.LEADER_COS + lane] = sine, cosine
        east, north, depth = block[row.EAST + lane], block[row.NORTH + lane], block[row.LEADER_DEPTH + lane]
        depth_difference = depth - own_depth
        block[row.DZ + lane] = depth_difference
        forward_x, forward_y, forward_up = half * sine, half * cosine, 0.0
        port_x, port_y, port_up = -offset * cosine, offset * sine, 0.0
        if t.use_attitude:
            pitch, roll = block[row.PITCH + lane], block[row.ROLL + lane]
            known = pitch == pitch and roll == roll
            sin_pitch, cos_pitch = sin_cos(pitch if known else 0.0)
            sin_roll, cos_roll = sin_cos(roll if known else 0.0)
            forward_x, forward_y, forward_up = forward_x * cos_pitch, forward_y * cos_pitch, half * sin_pitch
            raised = offset * sin_roll
            ahead, aside = -raised * sin_pitch, offset * cos_roll
            port_x, port_y = ahead * sine - aside * cosine, ahead * cosine + aside * sine
            port_up = raised * cos_pitch
        block[row.X1 + lane], block[row.Y1 + lane] = east - forward_x, north - forward_y
        block[row.X2 + lane], block[row.Y2 + lane] = east + forward_x, north + forward_y
        block[row.X3 + lane], block[row.Y3 + lane] = east + port_x, north + port_y
        block[row.D1 + lane] = _range_on_plane(block[row.R1 + lane], depth_difference + forward_up)
        block[row.D2 + lane] = _range_on_plane(block[row.R2 + lane], depth_difference - forward_up)
        block[row.D3 + lane] = _range_on_plane(block[row.R3 + lane], depth_difference - port_up)


@inlined
def _fix_pair(block: Floats, t: Tuning, pair: tuple[int, int, int], front_anchor: bool) -> None:
    """Fix of a pair (paper, Section 2.2 and Eq. 23), from the state as it is.

    `pair` holds the rows where the rear transmitter, the front one and the fix begin; P_D is measured from the rear
    transmitter, or from the front one. Of two intersections equally near the one to port is taken.
    """
    rear, front, out = pair
    for lane in range(LANES):
        xi, yi, di = block[rear + lane], block[rear + LANES + lane], block[rear + 2 * LANES + lane]
        xj, yj, dj = block[front + lane], block[front + LANES + lane], block[front + 2 * LANES + lane]
        received = di == di and dj == dj
        dx, dy = xj - xi, yj - yi
        d = math.sqrt(dx * dx + dy * dy)
        apart = d > 0.0
        per_d = 1.0 / (d if apart else 1.0)
        ux = dx * per_d if apart else block[row.LEADER_SIN + lane]
        uy = dy * per_d if apart else block[row.LEADER_COS + lane]
        a = (d * d + di * di - dj * dj) * (0.5 * per_d)
        overlap = (di + dj - d) * (d + di - dj) * (d - di + dj)
        h_squared = (d + di + dj) * overlap * (0.25 * per_d * per_d)
        two = apart and h_squared > 0.0
        h = math.sqrt(h_squared if two else 0.0)
        sep = 2.0 * h
        clear = two and sep >= t.threshold
        tangent = apart and h_squared == 0.0

        east, north = block[row.X + lane] - xi, block[row.Y + lane] - yi
        side = h if north * ux >= east * uy else -h
        behind = d - dj if front_anchor else -di
        ahead = t.predicted_side and east * ux + north * uy > 0.5 * d
        along = a if clear or tangent else (d + dj if ahead else behind)
        aside = side if clear else 0.0
        block[out + lane] = xi + along * ux - aside * uy
        block[out + LANES + lane] = yi + along * uy + aside * ux
        block[out + 2 * LANES + lane] = t.beta / sep if clear else 0.0
        kind = _TWO_POINTS if clear else (_TANGENT if tangent else _ASTERN)
        block[out + 3 * LANES + lane] = kind if received else _LOST
        block[out + 4 * LANES + lane] = sep if two else -1.0


@compiled_lanes
def fix_rear_front(block: Floats, t: Tuning) -> None:
    """Fix of the pair (1, 2)."""
    _fix_pair(block, t, (row.X1, row.X2, row.ZX12), False)


@compiled_lanes
def fix_rear_middle(block: Floats, t: Tuning) -> None:
    """Fix of the pair (1, 3)."""
    _fix_pair(block, t, (row.X1, row.X3, row.ZX13), False)


@compiled_lanes
def fix_front_middle(block: Floats, t: Tuning) -> None:
    """Fix of the pair (2, 3), whose rear transmitter is the middle one."""
    _fix_pair(block, t, (row.X3, row.X2, row.ZX23), True)


@compiled_lanes
def take(block: Floats, fix: int) -> None:
    """Choose the fix whose rows begin at `fix`."""
    for i in range(6 * LANES):
        block[row.ZX + i] = block[fix + i]


@compiled_lanes
def give_back(block: Floats, fix: int) -> None:
    """What became of the chosen fix goes where it was taken from."""
    for i in range(6 * LANES):
        block[fix + i] = block[row.ZX + i]


@inlined
def _choose(block: Floats, lane: int, score12: float, score13: float, score23: float) -> None:
    """Take the fix with the highest score, the earlier pair among equals."""
    zx, zy = block[row.ZX12 + lane], block[row.ZY12 + lane]
    sigma, kind, best = block[row.SIGMA12 + lane], block[row.KIND12 + lane], score12
    better = score13 > best
    zx = block[row.ZX13 + lane] if better else zx
    zy = block[row.ZY13 + lane] if better else zy
    sigma = block[row.SIGMA13 + lane] if better else sigma
    kind = block[row.KIND13 + lane] if better else kind
    best = score13 if better else best
    better = score23 > best
    block[row.ZX + lane] = block[row.ZX23 + lane] if better else zx
    block[row.ZY + lane] = block[row.ZY23 + lane] if better else zy
    block[row.SIGMA + lane] = block[row.SIGMA23 + lane] if better else sigma
    block[row.KIND + lane] = block[row.KIND23 + lane] if better else kind


@inlined
def _baseline_score(kind: float, separation: float) -> float:
    """One intersection before all; then the separation of two (−1 for none); lost ranges last."""
    return np.inf if kind == _TANGENT else (-2.0 if kind == _LOST else separation)


@inlined
def _usable_score(kind: float, separation: float) -> float:
    """Clear intersections before none; lost ranges last."""
    return -2.0 if kind == _LOST else (0.0 if kind == _ASTERN else 1.0)


@compiled_lanes
def choose_best_baseline(block: Floats) -> None:
    """Best baseline (paper, Section 2.3.3): of three pairs the one with the most certain intersections."""
    for lane in range(LANES):
        score12 = _baseline_score(block[row.KIND12 + lane], block[row.SEP12 + lane])
        score13 = _baseline_score(block[row.KIND13 + lane], block[row.SEP13 + lane])
        score23 = _baseline_score(block[row.KIND23 + lane], block[row.SEP23 + lane])
        _choose(block, lane, score12, score13, score23)


@compiled_lanes
def choose_main_baseline(block: Floats) -> None:
    """Main baseline first (paper, Section 2.3.3): the other pairs only where (1, 2) has no clear intersections."""
    for lane in range(LANES):
        score12 = _usable_score(block[row.KIND12 + lane], block[row.SEP12 + lane])
        score13 = _usable_score(block[row.KIND13 + lane], block[row.SEP13 + lane])
        score23 = _usable_score(block[row.KIND23 + lane], block[row.SEP23 + lane])
        _choose(block, lane, score12, score13, score23)


@inlined
def _weight(kind: float, separation: float, sigma: float) -> float:
    """Weight of a pair with N > 0; zero for others (paper, Eq. 25)."""
    return 1.0 / (1.0 + sigma) if separation >= 0.0 or kind == _TANGENT else 0.0


@inlined
def _weighted(weight: float, value: float) -> float:
    """Weight times value; nothing for a weight of zero, even where the value is NaN."""
    return weight * value if weight > 0.0 else 0.0


@compiled_lanes
def fuse(block: Floats) -> None:
    """LAISN-3(2): weighted mean of the pairs that intersect (paper, Eqs. 24 and 25); P_D of the first if none does."""
    for lane in range(LANES):
        kind12, kind13, kind23 = block[row.KIND12 + lane], block[row.KIND13 + lane], block[row.KIND23 + lane]
        w12 = _weight(kind12, block[row.SEP12 + lane], block[row.SIGMA12 + lane])
        w13 = _weight(kind13, block[row.SEP13 + lane], block[row.SIGMA13 + lane])
        w23 = _weight(kind23, block[row.SEP23 + lane], block[row.SIGMA23 + lane])
        none = w12 + w13 + w23 == 0.0
        several = (w12 > 0.0 and w13 + w23 > 0.0) or (w13 > 0.0 and w23 > 0.0)
        w12 = 1.0 if none and kind12 != _LOST else w12
        w13 = 1.0 if none and w12 == 0.0 and kind13 != _LOST else w13
        w23 = 1.0 if none and w12 + w13 == 0.0 and kind23 != _LOST else w23
        per_total = 1.0 / (w12 + w13 + w23)
        x12, x13, x23 = block[row.ZX12 + lane], block[row.ZX13 + lane], block[row.ZX23 + lane]
        y12, y13, y23 = block[row.ZY12 + lane], block[row.ZY13 + lane], block[row.ZY23 + lane]
        block[row.ZX + lane] = (_weighted(w12, x12) + _weighted(w13, x13) + _weighted(w23, x23)) * per_total
        block[row.ZY + lane] = (_weighted(w12, y12) + _weighted(w13, y13) + _weighted(w23, y23)) * per_total
        sigma = block[row.SIGMA12 + lane] + block[row.SIGMA13 + lane] + block[row.SIGMA23 + lane]
        block[row.SIGMA + lane] = sigma * (1.0 / 3.0)
        only = kind12 if w12 > 0.0 else (kind13 if w13 > 0.0 else (kind23 if w23 > 0.0 else _LOST))
        block[row.KIND + lane] = _FUSED if several else only
