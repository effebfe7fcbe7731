"""Passes over a block of runs side by side: the Kalman filter, gate and fix of `filter`, `fix` and `variants` in lanes.

Every lane takes every branch and selects; only what is the same for all runs (the variant) branches truly. Covariances
are kept as 2×2 blocks, and updates are written without cancellation: after a measurement with covariance R, P S⁻¹ R
stands for P − P S⁻¹ P. That equals the Joseph form up to rounding.
"""

from collections.abc import Callable

import numpy as np

from laisn import lane_rows as row
from laisn.arrays import Floats
from laisn.compiled import compiled_lanes, inlined
from laisn.elementary import sin_cos
from laisn.filter import expected_acceleration, is_beyond, larger, reach, speed_share, turn_share
from laisn.fix import GATED, LOST, SINGULAR, Circle, Fix, Pair, circles, fix_variance, pair_fix
from laisn.geometry import Point, Turn, is_singular, level_arms, tilted_arms
from laisn.lane_rows import LANES
from laisn.messages import Ranges
from laisn.settings import VARIANTS, Tuning
from laisn.variants import SINGLE, Pairs


@compiled_lanes
def own_motion(block: Floats, t: Tuning) -> None:
    """Take a step's own measurements: their γ, and the direction of motion."""
    for lane in range(LANES):
        speed, heading = block[row.SPEED + lane], block[row.HEADING + lane]
        block[row.GAMMA_V + lane] = speed_share(block[row.LAST_SPEED + lane], speed, t.follower_speed_max)
        block[row.GAMMA_THETA + lane] = turn_share(block[row.LAST_HEADING + lane], heading)
        block[row.LAST_SPEED + lane], block[row.LAST_HEADING + lane] = speed, heading
        block[row.SIN + lane], block[row.COS + lane] = sin_cos(heading)


@compiled_lanes
def leader_motion(block: Floats, t: Tuning) -> None:
    """Take a message's speed and heading, if it has a range: γ becomes that of the vehicle that changed most."""
    for lane in range(LANES):
        rear, front, middle = block[row.R1 + lane], block[row.R2 + lane], block[row.R3 + lane]
        received = rear == rear or front == front or middle == middle
        last_speed, last_heading = block[row.LAST_LEADER_SPEED + lane], block[row.LAST_LEADER_HEADING + lane]
        # a message without ranges repeats the last one
        speed = block[row.LEADER_SPEED + lane] if received else last_speed
        heading = block[row.LEADER_HEADING + lane] if received else last_heading
        of_speed = speed_share(last_speed, speed, t.leader_speed_max)
        of_heading = turn_share(last_heading, heading)
        block[row.GAMMA_V + lane] = larger(of_speed, block[row.GAMMA_V + lane])
        block[row.GAMMA_THETA + lane] = larger(of_heading, block[row.GAMMA_THETA + lane])
        block[row.LAST_LEADER_SPEED + lane], block[row.LAST_LEADER_HEADING + lane] = speed, heading


@compiled_lanes
def predict(block: Floats, t: Tuning) -> None:
    """Constant velocity, with process noise that grows with manoeuvres (paper, Section 2.1)."""
    dt = t.dt
    for lane in range(LANES):
        sigma_a = expected_acceleration(block[row.GAMMA_V + lane], block[row.GAMMA_THETA + lane], t)
        q = sigma_a * sigma_a * (dt * dt)
        q_mixed, q_position = q * (0.5 * dt), q * (0.25 * dt * dt)
        cxx, cxy, cyx, cyy = row.cross_covariance_at(block, lane)
        vxx, vxy, vyy = block[row.VXX + lane] * dt, block[row.VXY + lane] * dt, block[row.VYY + lane] * dt
        block[row.X + lane] += dt * block[row.VX + lane]
        block[row.Y + lane] += dt * block[row.VY + lane]
        block[row.PXX + lane] += dt * (2.0 * cxx + vxx) + q_position
        block[row.PXY + lane] += dt * (cxy + cyx + vxy)
        block[row.PYY + lane] += dt * (2.0 * cyy + vyy) + q_position
        block[row.CXX + lane] = cxx + vxx + q_mixed
        block[row.CXY + lane] = cxy + vxy
        block[row.CYX + lane] = cyx + vxy
        block[row.CYY + lane] = cyy + vyy + q_mixed
        block[row.VXX + lane] += q
        block[row.VYY + lane] += q


@compiled_lanes
def speed_update(block: Floats, t: Tuning) -> None:
    """Velocity from speed log and compass (paper, Section 2.1)."""
    for lane in range(LANES):
        speed, s, c = block[row.SPEED + lane], block[row.SIN + lane], block[row.COS + lane]
        along, across = t.speed_variance, t.heading_variance * (speed * speed)
        rxx, rxy, ryy = s * s * along + c * c * across, s * c * (along - across), c * c * along + s * s * across
        vxx, vxy, vyy = block[row.VXX + lane], block[row.VXY + lane], block[row.VYY + lane]
        cxx, cxy, cyx, cyy = row.cross_covariance_at(block, lane)
        sxx, sxy, syy = vxx + rxx, vxy + rxy, vyy + ryy
        per_det = 1.0 / (sxx * syy - sxy * sxy)
        ixx, ixy, iyy = syy * per_det, -sxy * per_det, sxx * per_det
        # Gains: row by state, column by component of the measurement.
        k_xx, k_xy = cxx * ixx + cxy * ixy, cxx * ixy + cxy * iyy
        k_yx, k_yy = cyx * ixx + cyy * ixy, cyx * ixy + cyy * iyy
        k_ux, k_uy = vxx * ixx + vxy * ixy, vxx * ixy + vxy * iyy
        k_wx, k_wy = vxy * ixx + vyy * ixy, vxy * ixy + vyy * iyy
        ex, ey = speed * s - block[row.VX + lane], speed * c - block[row.VY + lane]
        block[row.X + lane] += k_xx * ex + k_xy * ey
        block[row.Y + lane] += k_yx * ex + k_yy * ey
        block[row.VX + lane] += k_ux * ex + k_uy * ey
        block[row.VY + lane] += k_wx * ex + k_wy * ey
        block[row.PXX + lane] -= k_xx * cxx + k_xy * cxy
        block[row.PXY + lane] -= k_xx * cyx + k_xy * cyy
        block[row.PYY + lane] -= k_yx * cyx + k_yy * cyy
        block[row.CXX + lane] = k_xx * rxx + k_xy * rxy
        block[row.CXY + lane] = k_xx * rxy + k_xy * ryy
        block[row.CYX + lane] = k_yx * rxx + k_yy * rxy
        block[row.CYY + lane] = k_yx * rxy + k_yy * ryy
        block[row.VXX + lane] = k_ux * rxx + k_uy * rxy
        block[row.VXY + lane] = k_ux * rxy + k_uy * ryy
        block[row.VYY + lane] = k_wx * rxy + k_wy * ryy


@compiled_lanes
def update(block: Floats, t: Tuning, k: int) -> None:
    """Gate the chosen fix, and update the state with it (paper, Sections 2.1 and 2.4).

    Its kind becomes GATED or SINGULAR where the update is skipped.
    """
    for lane in range(LANES):
        zx, zy, kind = block[row.ZX + lane], block[row.ZY + lane], block[row.KIND + lane]
        r = fix_variance(block[row.SIGMA + lane], block[row.DZ + lane], t)
        bound = reach((k - block[row.ACCEPTED_STEP + lane]) * t.dt, block[row.SPEED + lane], t)
        gated = is_beyond(Point(zx, zy), row.point_at(block, row.ACCEPTED_X, lane), bound)

        pxx, pxy, pyy = block[row.PXX + lane], block[row.PXY + lane], block[row.PYY + lane]
        cxx, cxy, cyx, cyy = row.cross_covariance_at(block, lane)
        sxx, syy = pxx + r, pyy + r
        singular = is_singular(sxx, syy)
        lost = kind == LOST
        kind = kind if lost else (GATED if gated else (SINGULAR if singular else kind))
        used = not (lost or gated or singular)
        block[row.KIND + lane] = kind
        block[row.PASSED + lane] = 1.0 if not (lost or gated) else block[row.PASSED + lane]

        per_det = 1.0 / (sxx * syy - pxy * pxy)
        ixx, ixy, iyy = syy * per_det, -pxy * per_det, sxx * per_det
        ex, ey = zx - block[row.X + lane], zy - block[row.Y + lane]
        fx, fy = ixx * ex + ixy * ey, ixy * ex + iyy * ey
        block[row.NIS + lane] = ex * fx + ey * fy if used else np.nan
        block[row.X + lane] += pxx * fx + pxy * fy if used else 0.0
        block[row.Y + lane] += pxy * fx + pyy * fy if used else 0.0
        block[row.VX + lane] += cxx * fx + cyx * fy if used else 0.0
        block[row.VY + lane] += cxy * fx + cyy * fy if used else 0.0
        # S⁻¹ C; the velocity's covariance loses Cᵀ S⁻¹ C.
        nxx, nxy = ixx * cxx + ixy * cyx, ixx * cxy + ixy * cyy
        nyx, nyy = ixy * cxx + iyy * cyx, ixy * cxy + iyy * cyy
        block[row.PXX + lane] = r * (ixx * pxx + ixy * pxy) if used else pxx
        block[row.PXY + lane] = r * (ixx * pxy + ixy * pyy) if used else pxy
        block[row.PYY + lane] = r * (ixy * pxy + iyy * pyy) if used else pyy
        block[row.CXX + lane] = r * nxx if used else cxx
        block[row.CXY + lane] = r * nxy if used else cxy
        block[row.CYX + lane] = r * nyx if used else cyx
        block[row.CYY + lane] = r * nyy if used else cyy
        block[row.VXX + lane] -= cxx * nxx + cyx * nyx if used else 0.0
        block[row.VXY + lane] -= cxx * nxy + cyx * nyy if used else 0.0
        block[row.VYY + lane] -= cxy * nxy + cyy * nyy if used else 0.0


@compiled_lanes
def update_gate(block: Floats, k: int) -> None:
    """Make the gate measure from the position and step of this message, in the lanes that accepted it."""
    for lane in range(LANES):
        passed = block[row.PASSED + lane] > 0.0
        block[row.ACCEPTED_X + lane] = block[row.X + lane] if passed else block[row.ACCEPTED_X + lane]
        block[row.ACCEPTED_Y + lane] = block[row.Y + lane] if passed else block[row.ACCEPTED_Y + lane]
        block[row.ACCEPTED_STEP + lane] = float(k) if passed else block[row.ACCEPTED_STEP + lane]
        block[row.PASSED + lane] = 0.0


Choose = Callable[[Floats, Tuning], None]
"""A pass that makes one fix of three."""


@inlined
def _turn(angle: float) -> Turn:
    sine, cosine = sin_cos(angle)
    return Turn(sine, cosine)


@inlined
def _put_circle(block: Floats, first: int, lane: int, circle: Circle) -> None:
    block[first + lane], block[first + LANES + lane] = circle.centre.east, circle.centre.north
    block[first + 2 * LANES + lane] = circle.radius


@inlined
def _circle_at(block: Floats, first: int, lane: int) -> Circle:
    return Circle(row.point_at(block, first, lane), block[first + 2 * LANES + lane])


@compiled_lanes
def place_transmitters(block: Floats, t: Tuning) -> None:
    """Transmitters as the message places them, and the horizontal ranges to them."""
    for lane in range(LANES):
        heading = _turn(block[row.LEADER_HEADING + lane])
        block[row.LEADER_SIN + lane], block[row.LEADER_COS + lane] = heading.sine, heading.cosine
        depth_difference = (block[row.DEPTH + lane] - t.hydrophone_height) - block[row.LEADER_DEPTH + lane]
        block[row.DZ + lane] = depth_difference
        arms = level_arms(t.baseline, t.middle_offset, heading)
        if t.use_attitude:
            pitch, roll = block[row.PITCH + lane], block[row.ROLL + lane]
            known = pitch == pitch and roll == roll
            pitched, rolled = _turn(pitch if known else 0.0), _turn(roll if known else 0.0)
            arms = tilted_arms(t.baseline, t.middle_offset, heading, pitched, rolled)
        ranges = Ranges(block[row.R1 + lane], block[row.R2 + lane], block[row.R3 + lane])
        placed = circles(row.point_at(block, row.EAST, lane), arms, ranges, depth_difference)
        _put_circle(block, row.X1, lane, placed.rear)
        _put_circle(block, row.X2, lane, placed.front)
        _put_circle(block, row.X3, lane, placed.middle)


@inlined
def _fix_pair(block: Floats, t: Tuning, rows: tuple[int, int, int], from_front: bool) -> None:
    """Fix of a pair, from the state as it is; `rows` are those where its circles and the fix begin."""
    rear, front, out = rows
    for lane in range(LANES):
        pair = Pair(_circle_at(block, rear, lane), _circle_at(block, front, lane), from_front)
        heading = Turn(block[row.LEADER_SIN + lane], block[row.LEADER_COS + lane])
        row.put_fix(block, out, lane, pair_fix(pair, heading, row.point_at(block, row.X, lane), t))


@compiled_lanes
def fix_rear_front(block: Floats, t: Tuning) -> None:
    """Fix of the pair (1, 2)."""
    _fix_pair(block, t, (row.X1, row.X2, row.ZX12), False)


@compiled_lanes
def fix_rear_middle(block: Floats, t: Tuning) -> None:
    """Fix of the pair (1, 3)."""
    _fix_pair(block, t, (row.X1, row.X3, row.ZX13), False)


@compiled_lanes
def fix_middle_front(block: Floats, t: Tuning) -> None:
    """Fix of the pair (2, 3), whose rear transmitter is the middle one."""
    _fix_pair(block, t, (row.X3, row.X2, row.ZX23), True)


@compiled_lanes
def copy_fix(block: Floats, source: int, target: int) -> None:
    """Copy a fix, with its kind and NIS, between the rows that begin at `source` and `target`."""
    for i in range(6 * LANES):
        block[target + i] = block[source + i]


def _pass(single: Callable[[Pairs, Point], Fix]) -> Choose:
    """A variant's formula over the lanes."""

    @compiled_lanes
    def choose(block: Floats, t: Tuning) -> None:
        for lane in range(LANES):
            pairs = (
                row.fix_at(block, row.ZX12, lane),
                row.fix_at(block, row.ZX13, lane),
                row.fix_at(block, row.ZX23, lane),
            )
            row.put_fix(block, row.ZX, lane, single(pairs, row.point_at(block, row.X, lane)))

    return choose


def _branch(number: int, chosen: Choose, otherwise: Choose) -> Choose:
    @compiled_lanes
    def choose(block: Floats, t: Tuning) -> None:
        if t.variant == number:
            chosen(block, t)
        else:
            otherwise(block, t)

    return choose


def _by_variant() -> Choose:
    """One pass for all variants: compiled code branches by their numbers, as it cannot look up functions."""
    (_, choose), *others = [(VARIANTS.index(variant), _pass(single)) for variant, single in SINGLE.items()]
    for number, chosen in others:
        choose = _branch(number, chosen, choose)
    return choose


choose = _by_variant()
"""Make one fix of those of the three pairs, as the variant does."""
