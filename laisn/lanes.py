"""LAISN for a block of runs side by side, one in each lane: what `navigator` does for one follower.

A block is rows of `LANES` doubles in one flat array, a lane for each run. A *pass* is a function
that goes through a block lane by lane; passes address `block[ROW + lane]`. Rows of one array
provably do not overlap, so that passes become vector instructions. They compute the lanes that are
in use, the first of each row.
Every lane takes every branch and selects; only what is the same for all runs (the variant) branches
truly. After a measurement with covariance R, P S⁻¹ R stands for P − P S⁻¹ P, without cancellation;
it equals the Joseph form.
"""

from collections.abc import Callable, Sequence
from itertools import count
from typing import NamedTuple, cast

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Records
from laisn.compiled import compiled, compiled_apart, inlined, jitable
from laisn.errors import LaisnError
from laisn.fix import (
    CHOOSE_PAIR,
    GATED,
    LOST,
    SEQUENTIAL,
    SINGULAR,
    Circle,
    Fix,
    Pair,
    circles,
    fix_variance,
    pair_fix,
)
from laisn.geometry import Point, SinCos, is_singular, tilted_arms
from laisn.messages import LeaderMessage, Measurements, Ranges
from laisn.navigator import (
    exceeds_gate,
    expected_acceleration,
    gate_radius,
    speed_share,
    turn_share,
)
from laisn.settings import LAISN_VARIANTS, NavigationSettings, Settings, Tuning, Variant
from laisn.swarm import SwarmRecord, new_fix
from laisn.vector_math import sin_cos

LANES = 64
_VECTOR = 8
"""Lanes that are computed at once at most; what remains of a row is computed lane by lane."""

_row = count(0, LANES)

# State and covariance: P are position, V velocity terms, C those between (CXY of x and vy).
X, Y, VX, VY = (next(_row) for _ in range(4))
PXX, PXY, PYY, CXX, CXY, CYX, CYY, VXX, VXY, VYY = (next(_row) for _ in range(10))
# Memory of the last accepted position and of the last measurements.
ACCEPTED_X, ACCEPTED_Y, ACCEPTED_STEP = (next(_row) for _ in range(3))
LAST_SPEED, LAST_HEADING, LAST_LEADER_SPEED, LAST_LEADER_HEADING = (next(_row) for _ in range(4))
# Own measurements of a step, and what follows from them; γ are those of the vehicle that changed
# most.
SPEED, HEADING, DEPTH, SIN, COS, GAMMA_V, GAMMA_THETA = (next(_row) for _ in range(7))
# A message and the ranges measured on it.
EAST, NORTH, LEADER_HEADING, LEADER_SPEED, LEADER_DEPTH, PITCH, ROLL = (
    next(_row) for _ in range(7)
)
R1, R2, R3 = (next(_row) for _ in range(3))
# Transmitters, the horizontal ranges to them (NaN where nothing was received), and one's own depth
# below the leader's.
X1, Y1, D1, X2, Y2, D2, X3, Y3, D3, DZ = (next(_row) for _ in range(10))
LEADER_SIN, LEADER_COS = (next(_row) for _ in range(2))
# The fix of each pair of transmitters and the fix chosen of them: position, σp, kind, separation of
# two intersections (−1 for fewer), and squared distance from the prediction in units of S (NaN
# where no update was made).
ZX12, ZY12, SIGMA12, KIND12, SEP12, NIS12 = (next(_row) for _ in range(6))
ZX13, ZY13, SIGMA13, KIND13, SEP13, NIS13 = (next(_row) for _ in range(6))
ZX23, ZY23, SIGMA23, KIND23, SEP23, NIS23 = (next(_row) for _ in range(6))
ZX, ZY, SIGMA, KIND, SEP, NIS = (next(_row) for _ in range(6))
# 1 where an update of this message passed the gate.
PASSED = next(_row)
IDLE = next(_row)  # one number: how many of the last lanes are left out
SIZE = IDLE + 1


def tuning(settings: Settings) -> Tuning:
    """Settings of LAISN as lanes take them; LaisnError for those of one vehicle's navigator
    alone.
    """
    laisn = cast(NavigationSettings, settings)
    if laisn.use_single_range or laisn.transmitter_offsets or laisn.compensate_motion:
        raise LaisnError(
            "use_single_range, compensate_motion and transmitter offsets are for single vehicles "
            "and their logs; campaigns take "
            "transmitters on the leader's hull only, and drop a range that arrives alone"
        )
    return Tuning.of(laisn)


@inlined
def point_at(block: Floats, first: int, lane: int) -> Point:
    """The point whose two rows begin at `first`."""
    return Point(block[first + lane], block[first + LANES + lane])


@jitable
def lanes_for(runs: int) -> int:
    """How many lanes to compute for so many runs: a run that is alone, or whole vectors."""
    return 1 if runs == 1 else -(-runs // _VECTOR) * _VECTOR


@inlined
def in_use(block: Floats) -> int:
    """How many lanes are computed, from the first on."""
    return LANES - int(block[IDLE])


@inlined
def cross_covariance_at(block: Floats, lane: int) -> tuple[float, float, float, float]:
    """Covariance of position and velocity: CXX, CXY, CYX, CYY."""
    return block[CXX + lane], block[CXY + lane], block[CYX + lane], block[CYY + lane]


@inlined
def fix_at(block: Floats, first: int, lane: int) -> Fix:
    """The fix whose rows begin at `first`."""
    z = point_at(block, first, lane)
    sigma = block[first + 2 * LANES + lane]
    i = first + lane
    return Fix(z.east, z.north, sigma, block[i + 3 * LANES], block[i + 4 * LANES])


@inlined
def put_fix(block: Floats, first: int, lane: int, fix: Fix) -> None:
    """Write a fix into the rows that begin at `first`."""
    block[first + lane] = fix.east
    block[first + LANES + lane] = fix.north
    block[first + 2 * LANES + lane] = fix.sigma
    block[first + 3 * LANES + lane] = fix.kind
    block[first + 4 * LANES + lane] = fix.separation


@compiled
def new_block(starts: Floats, t: Tuning) -> Floats:
    """A block before its first step at starts (x, y, vx, vy), shape (f, 4), of which the last
    one is repeated.
    """
    block = np.zeros(SIZE)
    for lane in range(LANES):
        start = starts[min(lane, starts.shape[0] - 1)]
        block[X + lane] = start[0]
        block[Y + lane] = start[1]
        block[VX + lane] = start[2]
        block[VY + lane] = start[3]
        block[PXX + lane] = block[PYY + lane] = t.position_variance0
        block[VXX + lane] = block[VYY + lane] = t.velocity_variance0
        block[ACCEPTED_X + lane] = start[0]
        block[ACCEPTED_Y + lane] = start[1]
        block[LAST_SPEED + lane] = block[LAST_HEADING + lane] = np.nan
        block[LAST_LEADER_SPEED + lane] = block[LAST_LEADER_HEADING + lane] = np.nan
    return block


@compiled
def own_motion(block: Floats, t: Tuning) -> None:
    """Take a step's own measurements: their γ, and the direction of motion; faster apart from
    `predict`.
    """
    for lane in range(in_use(block)):
        speed = block[SPEED + lane]
        heading = block[HEADING + lane]
        block[GAMMA_V + lane] = speed_share(block[LAST_SPEED + lane], speed, t.follower_speed_max)
        block[GAMMA_THETA + lane] = turn_share(block[LAST_HEADING + lane], heading)
        block[LAST_SPEED + lane] = speed
        block[LAST_HEADING + lane] = heading
        block[SIN + lane], block[COS + lane] = sin_cos(heading)


@compiled
def leader_motion(block: Floats, t: Tuning) -> None:
    """Take a message's speed and heading, if it has a range: γ becomes that of the vehicle that
    changed most.
    """
    for lane in range(in_use(block)):
        rear = block[R1 + lane]
        front = block[R2 + lane]
        middle = block[R3 + lane]
        received = rear == rear or front == front or middle == middle
        last_speed = block[LAST_LEADER_SPEED + lane]
        last_heading = block[LAST_LEADER_HEADING + lane]
        # a message without ranges repeats the last one
        speed = block[LEADER_SPEED + lane] if received else last_speed
        heading = block[LEADER_HEADING + lane] if received else last_heading
        of_speed = speed_share(last_speed, speed, t.leader_speed_max)
        own_speed = block[GAMMA_V + lane]
        of_heading = turn_share(last_heading, heading)
        own_heading = block[GAMMA_THETA + lane]
        block[GAMMA_V + lane] = of_speed if of_speed > own_speed else own_speed
        block[GAMMA_THETA + lane] = of_heading if of_heading > own_heading else own_heading
        block[LAST_LEADER_SPEED + lane] = speed
        block[LAST_LEADER_HEADING + lane] = heading


@compiled
def predict(block: Floats, t: Tuning) -> None:
    """Constant velocity, with process noise that grows with manoeuvres (paper, Section 2.1)."""
    dt = t.dt
    for lane in range(in_use(block)):
        sigma_a = expected_acceleration(block[GAMMA_V + lane], block[GAMMA_THETA + lane], t)
        # x ← F x and P ← F P Fᵀ + σ_a² G Gᵀ with F = [I, Δt I; 0, I] and G = [½ Δt² I; Δt I]
        q = sigma_a * sigma_a * (dt * dt)
        q_mixed = q * (0.5 * dt)
        q_position = q * (0.25 * dt * dt)
        cxx, cxy, cyx, cyy = cross_covariance_at(block, lane)
        vxx = block[VXX + lane] * dt
        vxy = block[VXY + lane] * dt
        vyy = block[VYY + lane] * dt
        block[X + lane] += dt * block[VX + lane]
        block[Y + lane] += dt * block[VY + lane]
        block[PXX + lane] += dt * (2.0 * cxx + vxx) + q_position
        block[PXY + lane] += dt * (cxy + cyx + vxy)
        block[PYY + lane] += dt * (2.0 * cyy + vyy) + q_position
        block[CXX + lane] = cxx + vxx + q_mixed
        block[CXY + lane] = cxy + vxy
        block[CYX + lane] = cyx + vxy
        block[CYY + lane] = cyy + vyy + q_mixed
        block[VXX + lane] += q
        block[VYY + lane] += q


@compiled
def speed_update(block: Floats, t: Tuning) -> None:
    """Velocity from speed log and compass (paper, Section 2.1)."""
    for lane in range(in_use(block)):
        speed = block[SPEED + lane]
        s = block[SIN + lane]
        c = block[COS + lane]
        # R = Rot diag(σ_v², (σ_θ v)²) Rotᵀ: the log errs along the way, the compass across it
        along_variance = t.speed_variance
        across_variance = t.heading_variance * (speed * speed)
        rxx = s * s * along_variance + c * c * across_variance
        rxy = s * c * (along_variance - across_variance)
        ryy = c * c * along_variance + s * s * across_variance
        vxx = block[VXX + lane]
        vxy = block[VXY + lane]
        vyy = block[VYY + lane]
        cxx, cxy, cyx, cyy = cross_covariance_at(block, lane)
        # H = [0, I] and the blocks P, C, V of the covariance: S = V + R
        sxx = vxx + rxx
        sxy = vxy + rxy
        syy = vyy + ryy
        per_det = 1.0 / (sxx * syy - sxy * sxy)
        ixx = syy * per_det
        ixy = -sxy * per_det
        iyy = sxx * per_det
        # K = [C; V] S⁻¹: row by state (x, y, u for vx, w for vy), column by component of the
        # measurement
        k_xx, k_xy = cxx * ixx + cxy * ixy, cxx * ixy + cxy * iyy
        k_yx, k_yy = cyx * ixx + cyy * ixy, cyx * ixy + cyy * iyy
        k_ux, k_uy = vxx * ixx + vxy * ixy, vxx * ixy + vxy * iyy
        k_wx, k_wy = vxy * ixx + vyy * ixy, vxy * ixy + vyy * iyy
        # x += K e with e = z − H x; P −= K_p Cᵀ, C ← K_p R, V ← K_v R (as V − V S⁻¹ V = V S⁻¹ R)
        ex, ey = speed * s - block[VX + lane], speed * c - block[VY + lane]
        block[X + lane] += k_xx * ex + k_xy * ey
        block[Y + lane] += k_yx * ex + k_yy * ey
        block[VX + lane] += k_ux * ex + k_uy * ey
        block[VY + lane] += k_wx * ex + k_wy * ey
        block[PXX + lane] -= k_xx * cxx + k_xy * cxy
        block[PXY + lane] -= k_xx * cyx + k_xy * cyy
        block[PYY + lane] -= k_yx * cyx + k_yy * cyy
        block[CXX + lane] = k_xx * rxx + k_xy * rxy
        block[CXY + lane] = k_xx * rxy + k_xy * ryy
        block[CYX + lane] = k_yx * rxx + k_yy * rxy
        block[CYY + lane] = k_yx * rxy + k_yy * ryy
        block[VXX + lane] = k_ux * rxx + k_uy * rxy
        block[VXY + lane] = k_ux * rxy + k_uy * ryy
        block[VYY + lane] = k_wx * rxy + k_wy * ryy


@compiled
def update(block: Floats, t: Tuning, k: int) -> None:
    """Gate the chosen fix, and update the state (Sections 2.1, 2.4); kind GATED or SINGULAR
    where that is skipped.
    """
    for lane in range(in_use(block)):
        zx = block[ZX + lane]
        zy = block[ZY + lane]
        kind = block[KIND + lane]
        r = fix_variance(block[SIGMA + lane], block[DZ + lane], t)
        bound = gate_radius((k - block[ACCEPTED_STEP + lane]) * t.dt, block[SPEED + lane], t)
        gated = exceeds_gate(Point(zx, zy), point_at(block, ACCEPTED_X, lane), bound)

        # H = [I, 0] and R = r I: S = P + r I
        pxx = block[PXX + lane]
        pxy = block[PXY + lane]
        pyy = block[PYY + lane]
        cxx, cxy, cyx, cyy = cross_covariance_at(block, lane)
        sxx = pxx + r
        syy = pyy + r
        singular = is_singular(sxx, syy)
        lost = kind == LOST
        outcome = SINGULAR if singular else kind
        outcome = GATED if gated else outcome
        outcome = kind if lost else outcome
        used = not (lost or gated or singular)
        block[KIND + lane] = outcome
        block[PASSED + lane] = 1.0 if not (lost or gated) else block[PASSED + lane]

        # x += [P; Cᵀ] S⁻¹ e with e = z − H x, and NIS = eᵀ S⁻¹ e
        per_det = 1.0 / (sxx * syy - pxy * pxy)
        ixx = syy * per_det
        ixy = -pxy * per_det
        iyy = sxx * per_det
        ex, ey = zx - block[X + lane], zy - block[Y + lane]
        fx, fy = ixx * ex + ixy * ey, ixy * ex + iyy * ey
        block[NIS + lane] = ex * fx + ey * fy if used else np.nan
        block[X + lane] += pxx * fx + pxy * fy if used else 0.0
        block[Y + lane] += pxy * fx + pyy * fy if used else 0.0
        block[VX + lane] += cxx * fx + cyx * fy if used else 0.0
        block[VY + lane] += cxy * fx + cyy * fy if used else 0.0
        # P ← r S⁻¹ P (as P − P S⁻¹ P = r S⁻¹ P), C ← r S⁻¹ C, V −= Cᵀ S⁻¹ C
        nxx, nxy = ixx * cxx + ixy * cyx, ixx * cxy + ixy * cyy
        nyx, nyy = ixy * cxx + iyy * cyx, ixy * cxy + iyy * cyy
        block[PXX + lane] = r * (ixx * pxx + ixy * pxy) if used else pxx
        block[PXY + lane] = r * (ixx * pxy + ixy * pyy) if used else pxy
        block[PYY + lane] = r * (ixy * pxy + iyy * pyy) if used else pyy
        block[CXX + lane] = r * nxx if used else cxx
        block[CXY + lane] = r * nxy if used else cxy
        block[CYX + lane] = r * nyx if used else cyx
        block[CYY + lane] = r * nyy if used else cyy
        block[VXX + lane] -= cxx * nxx + cyx * nyx if used else 0.0
        block[VXY + lane] -= cxx * nxy + cyx * nyy if used else 0.0
        block[VYY + lane] -= cxy * nxy + cyy * nyy if used else 0.0


@compiled
def update_gate(block: Floats, k: int) -> None:
    """Make the gate measure from the position and step of this message, in the lanes that
    accepted it.
    """
    for lane in range(in_use(block)):
        passed = block[PASSED + lane] > 0.0
        block[ACCEPTED_X + lane] = block[X + lane] if passed else block[ACCEPTED_X + lane]
        block[ACCEPTED_Y + lane] = block[Y + lane] if passed else block[ACCEPTED_Y + lane]
        block[ACCEPTED_STEP + lane] = float(k) if passed else block[ACCEPTED_STEP + lane]
        block[PASSED + lane] = 0.0


Pass = Callable[[Floats, Tuning], None]
"""A function that goes through a block lane by lane."""


@inlined
def _put_circle(block: Floats, first: int, lane: int, circle: Circle) -> None:
    block[first + lane] = circle.centre.east
    block[first + LANES + lane] = circle.centre.north
    block[first + 2 * LANES + lane] = circle.radius


@inlined
def _circle_at(block: Floats, first: int, lane: int) -> Circle:
    return Circle(point_at(block, first, lane), block[first + 2 * LANES + lane])


@compiled
def place_transmitters(block: Floats, t: Tuning) -> None:
    """Transmitters as the message places them, and the horizontal ranges to them."""
    for lane in range(in_use(block)):
        heading = SinCos(*sin_cos(block[LEADER_HEADING + lane]))
        pitched = SinCos(0.0, 1.0)
        rolled = SinCos(0.0, 1.0)
        block[LEADER_SIN + lane] = heading.sine
        block[LEADER_COS + lane] = heading.cosine
        depth_difference = (block[DEPTH + lane] - t.hydrophone_height) - block[LEADER_DEPTH + lane]
        block[DZ + lane] = depth_difference
        if t.use_attitude:
            pitch = block[PITCH + lane]
            roll = block[ROLL + lane]
            has_attitude = pitch == pitch and roll == roll
            pitched = SinCos(*sin_cos(pitch if has_attitude else 0.0))
            rolled = SinCos(*sin_cos(roll if has_attitude else 0.0))
        arms = tilted_arms(t.baseline, t.middle_offset, heading, pitched, rolled)
        ranges = Ranges(block[R1 + lane], block[R2 + lane], block[R3 + lane])
        range_circles = circles(point_at(block, EAST, lane), arms, ranges, depth_difference)
        _put_circle(block, X1, lane, range_circles.rear)
        _put_circle(block, X2, lane, range_circles.front)
        _put_circle(block, X3, lane, range_circles.middle)


def _fix_pair(rear: int, front: int, out: int, from_front: bool) -> Pass:
    """Pass for the fix of a pair, from the state as it is, by the rows where its circles and the
    fix begin.
    """

    @compiled
    def fix(block: Floats, t: Tuning) -> None:
        for lane in range(in_use(block)):
            pair = Pair(_circle_at(block, rear, lane), _circle_at(block, front, lane), from_front)
            heading = SinCos(block[LEADER_SIN + lane], block[LEADER_COS + lane])
            put_fix(block, out, lane, pair_fix(pair, heading, point_at(block, X, lane), t))

    return fix


fix_rear_front = _fix_pair(X1, X2, ZX12, False)
fix_rear_middle = _fix_pair(X1, X3, ZX13, False)
fix_middle_front = _fix_pair(X3, X2, ZX23, True)


@compiled
def copy_fix(block: Floats, source: int, target: int) -> None:
    """Copy a fix, with its kind and NIS, between the rows that begin at `source` and `target`."""
    for i in range(6 * LANES):
        block[target + i] = block[source + i]


def _choice(otherwise: Pass, variant: Variant) -> Pass:
    """Pass for the fix that a variant chooses, or the pass `otherwise` where the settings have
    another variant: compiled code cannot look up functions.
    """
    number = LAISN_VARIANTS.index(variant)
    single_fix = CHOOSE_PAIR[variant]

    @compiled
    def choose(block: Floats, t: Tuning) -> None:
        if t.variant != number:
            otherwise(block, t)
        else:
            for lane in range(in_use(block)):
                pairs = (
                    fix_at(block, ZX12, lane),
                    fix_at(block, ZX13, lane),
                    fix_at(block, ZX23, lane),
                )
                put_fix(block, ZX, lane, single_fix(pairs, point_at(block, X, lane)))

    return choose


@compiled
def _choose_nothing(block: Floats, t: Tuning) -> None:
    """For the variant that does not choose among fixes."""


choose: Pass = _choose_nothing
for _variant in CHOOSE_PAIR:
    choose = _choice(choose, _variant)

_SEQUENTIAL = LAISN_VARIANTS.index(SEQUENTIAL)

_BROADCAST = [
    LeaderMessage._fields.index(n)
    for n in ("east", "north", "heading", "speed", "depth", "pitch", "roll")
]


_PRIOR = (X, Y, PXX, PXY, PYY)
"""Rows that an update is recorded with, as they are before it."""


@compiled
def no_prior() -> Floats:
    """Room for no rows of `_PRIOR`: updates are not recorded."""
    return np.empty((0, len(_PRIOR), LANES))


@compiled
def _keep_prior(block: Floats, prior: Floats, update: int) -> None:
    """Copy the rows of `_PRIOR` before an update, 0 … 2 of a message, if there is room for them."""
    if prior.shape[0] > 0:
        for i, first in enumerate(_PRIOR):
            for lane in range(in_use(block)):
                prior[update, i, lane] = block[first + lane]


@compiled
def _use_pair(block: Floats, t: Tuning, k: int, fix: int) -> None:
    copy_fix(block, fix, ZX)
    update(block, t, k)
    copy_fix(block, ZX, fix)


@compiled
def position_update(block: Floats, t: Tuning, k: int, prior: Floats) -> None:
    """Position from the message of step k, by the variant (paper, Sections 2.2 and 2.3).

    `prior`, out, are rows of `_PRIOR` before each update, shape (3, 5, LANES), or (0, 5, LANES).
    """
    place_transmitters(block, t)
    fix_rear_front(block, t)
    if t.variant == _SEQUENTIAL:
        _keep_prior(block, prior, 0)
        _use_pair(block, t, k, ZX12)
        fix_rear_middle(block, t)
        _keep_prior(block, prior, 1)
        _use_pair(block, t, k, ZX13)
        fix_middle_front(block, t)
        _keep_prior(block, prior, 2)
        _use_pair(block, t, k, ZX23)
    else:
        if t.transmitters > 2:
            fix_rear_middle(block, t)
            fix_middle_front(block, t)
        choose(block, t)
        _keep_prior(block, prior, 0)
        update(block, t, k)
    update_gate(block, k)


@compiled
def advance(block: Floats, t: Tuning, k: int, received: bool, prior: Floats) -> None:
    """Step k: predict, position if a message is received, speed. Rows of measurements must be
    filled; `prior` is as of `position_update`.
    """
    own_motion(block, t)
    if received:
        leader_motion(block, t)
    predict(block, t)
    if received:
        position_update(block, t, k, prior)
    speed_update(block, t)


@compiled
def fix_rows(variant: float) -> tuple[int, int, int]:
    """Rows where the fixes of a message begin; −1 for fixes that the variant does not make."""
    if variant == _SEQUENTIAL:
        return ZX12, ZX13, ZX23
    return ZX, -1, -1


def stacked(missions: Sequence[Measurements]) -> tuple[Floats, Floats]:
    """Rows from SPEED to before SIN at each step, shape (n, 3 · LANES), and from EAST to before X1
    of each message, shape (m, 10 · LANES), of missions, the last of which is repeated.
    """
    filled = [missions[min(lane, len(missions) - 1)] for lane in range(LANES)]
    readings = np.stack(
        [np.column_stack([m.speed, m.heading, m.last_depth]) for m in filled], axis=-1
    )
    messages = np.stack(
        [np.column_stack([m.message[:, _BROADCAST], m.ranges]) for m in filled], axis=-1
    )
    return readings.reshape(len(readings), 3 * LANES), messages.reshape(len(messages), 10 * LANES)


class LaneSwarm(NamedTuple):
    """LAISN's navigators of f followers; biases and current are no states of theirs."""

    block: Floats
    tuning: Tuning
    gated: Ints  # fixes of each follower that were gated so far, shape (f,)
    prior: Floats  # rows of `_PRIOR` before each update of a message, shape (3, 5, LANES)

    @compiled_apart
    def navigate(
        self,
        step: int,
        readings: Records,
        received: Bools,
        messages: Records,
        ranges: Floats,
        estimates: Records,
        record: SwarmRecord,
    ) -> int:
        """Advance by one filter step; see `laisn.swarm.Swarm.navigate`."""
        block = self.block
        last = readings.shape[0] - 1
        any_received = bool(received.any())
        for lane in range(LANES):
            i = min(lane, last)
            block[SPEED + lane] = readings[i].speed
            block[HEADING + lane] = readings[i].heading
            block[DEPTH + lane] = readings[i].depth
            if any_received:
                message = messages[i]
                block[EAST + lane] = message.east
                block[NORTH + lane] = message.north
                block[LEADER_HEADING + lane] = message.heading
                block[LEADER_SPEED + lane] = message.speed
                block[LEADER_DEPTH + lane] = message.depth
                block[PITCH + lane] = message.pitch
                block[ROLL + lane] = message.roll
                for j in range(3):
                    # a message without ranges has the same effect as none
                    block[R1 + j * LANES + lane] = ranges[i, j] if received[i] else np.nan
        advance(block, self.tuning, step, any_received, self.prior)
        records_covariance = record.covariance.shape[1] > 0
        for i in range(readings.shape[0]):
            _record_state(block, i, step, record)
            if records_covariance and received[i]:
                _record_fixes(block, self.tuning, self.prior, i, step, record)
            position = estimates[i].position
            velocity = estimates[i].velocity
            position[0] = block[X + i]
            position[1] = block[Y + i]
            velocity[0] = block[VX + i]
            velocity[1] = block[VY + i]
            if received[i]:
                for first in fix_rows(self.tuning.variant):
                    self.gated[i] += first >= 0 and block[first + 3 * LANES + i] == GATED
        return 0


@compiled
def _record_state(block: Floats, i: int, step: int, record: SwarmRecord) -> None:
    """Record state and covariance of the follower in lane i after a step."""
    state = record.state[i, step - 1]
    state[0] = block[X + i]
    state[1] = block[Y + i]
    state[2] = block[VX + i]
    state[3] = block[VY + i]
    if record.covariance.shape[1] > 0:
        # P = [[Pxx, Pxy, Cxx, Cxy], [Pxy, Pyy, Cyx, Cyy], [Cxx, Cyx, Vxx, Vxy], [Cxy, Cyy, Vxy,
        # Vyy]]
        P = record.covariance[i, step - 1]
        P[0, 0] = block[PXX + i]
        P[0, 1] = P[1, 0] = block[PXY + i]
        P[1, 1] = block[PYY + i]
        P[0, 2] = P[2, 0] = block[CXX + i]
        P[0, 3] = P[3, 0] = block[CXY + i]
        P[1, 2] = P[2, 1] = block[CYX + i]
        P[1, 3] = P[3, 1] = block[CYY + i]
        P[2, 2] = block[VXX + i]
        P[2, 3] = P[3, 2] = block[VXY + i]
        P[3, 3] = block[VYY + i]


@compiled
def _record_fixes(
    block: Floats, t: Tuning, prior: Floats, i: int, step: int, record: SwarmRecord
) -> None:
    """Record the fixes of the message that the follower in lane i has received at a step."""
    n_fixes = 0
    for update, first in enumerate(fix_rows(t.variant)):
        if first < 0:
            continue
        fix = fix_at(block, first, i)
        if fix.kind == LOST:
            continue
        n_fixes += 1
        row = record.fix[i, new_fix(record, i, step, int(fix.kind))]
        # R = r I of the position update
        r = fix_variance(fix.sigma, block[DZ + i], t)
        row.fix_position[0] = fix.east
        row.fix_position[1] = fix.north
        row.fix_sigma = np.sqrt(r)
        if fix.kind != GATED:
            # z − H x̂ and S = H P Hᵀ + R, with the rows x, y, Pxx, Pxy, Pyy
            predicted = prior[update]
            row.innovation[0] = fix.east - predicted[0, i]
            row.innovation[1] = fix.north - predicted[1, i]
            row.innovation_covariance[0, 0] = predicted[2, i] + r
            row.innovation_covariance[0, 1] = predicted[3, i]
            row.innovation_covariance[1, 0] = predicted[3, i]
            row.innovation_covariance[1, 1] = predicted[4, i] + r
    if n_fixes == 0:
        new_fix(record, i, step, int(LOST))


def new_lanes(settings: NavigationSettings, starts: Floats) -> LaneSwarm:
    """Navigators of followers at starts x, y [m], vx, vy [m/s], shape (f, 4); LaisnError for
    more than LANES.
    """
    if len(starts) > LANES:
        raise LaisnError(f"{len(starts)} followers cannot navigate together, at most {LANES}")
    t = tuning(settings)
    block = new_block(starts, t)
    block[IDLE] = LANES - lanes_for(len(starts))
    gated = np.zeros(len(starts), dtype=np.int64)
    return LaneSwarm(block, t, gated, np.empty((3, len(_PRIOR), LANES)))
