"""Control allocation: from a wanted wrench to the commands of a vehicle's effectors.

The forces are those of the weighted pseudo-inverse (Fossen, Handbook of Marine Craft Hydrodynamics
and Motion Control, 2nd ed. 2021, chapter 11), u = P τ, P = W⁻¹ Bᵀ (B W⁻¹ Bᵀ)⁻¹, with the wrenches
of unit forces as the columns of B and W = diag(1 / range²). Ranges of fins, and W with them, grow
with the square of the speed (`pseudo_inverse_at`). Where limits do not allow u, components of τ are
added one after another in the order of `PRIORITY`, each with the largest share that keeps all
effectors within their limits.

P leaves the moment of roll open. Where it is asked for, by a user's wrench or an autopilot that
holds roll, `add_roll` adds to u what gives the moment and leaves the other components as they are,
as far as limits allow.
"""

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Records
from laisn.compiled import compiled, select
from laisn.simd import all_lanes, any_lane
from sim.vehicle.effector_kinds import MIN_STEERAGE_SPEED
from sim.vehicle.effectors import unit_wrenches

Wrench = tuple[float, float, float, float, float, float]
# components of a wrench in the body frame [N], [N m]
SURGE, SWAY, HEAVE, ROLL, PITCH, YAW = range(6)
# order in which components are served where limits bind
PRIORITY = (PITCH, YAW, HEAVE, SWAY, SURGE)
# orders in which components are looked for that effectors can give
_PITCH_FIRST = (SURGE, YAW, PITCH, HEAVE, SWAY, ROLL)
_HEAVE_FIRST = (SURGE, YAW, HEAVE, PITCH, SWAY, ROLL)
FULL_STEERAGE_SPEED = 2.0  # speed beyond which the weights of fins change no more [m/s]
# least part of a component that effectors give without changing others, over the largest force or
# moment of an effector: less is what places and directions in a file are off by, and would take all
# of the thrust
_MIN_SHARE = 0.02
_ROUNDING = 1e-12  # of sums of moments, as a share of them


@compiled
def clip(value: float, low: float, high: float) -> float:
    """`value` within [low, high]."""
    return min(max(value, low), high)


def given_components(
    records: npt.NDArray[np.void], limits: Floats, *, heave_first: bool = False
) -> list[int]:
    """Components of a wrench that a vehicle's effectors can give independently, as far as is worth
    it (`_MIN_SHARE`).

    Of pitch and heave effectors may give one alone, as a single vertical thruster does: pitch, or
    with `heave_first` heave.

    `limits` are least and largest force of each record of EFFECTOR, shape (m, 2), [N].
    """
    unit = unit_wrenches(records)  # Bᵀ
    scaled = unit * np.abs(limits).max(axis=1)[:, None]
    largest = [np.abs(scaled[:, :3]).max(), np.abs(scaled[:, 3:]).max()]
    scaled /= np.maximum(largest, 1e-300).repeat(3)
    independent: list[int] = []
    for axis in _HEAVE_FIRST if heave_first else _PITCH_FIRST:
        others = scaled[:, independent]
        share = scaled[:, axis] - others @ np.linalg.lstsq(others, scaled[:, axis])[0]
        if np.linalg.norm(share) > _MIN_SHARE:
            independent.append(axis)
    # the same numbers to the bit, whichever was looked for first
    return sorted(independent, key=_PITCH_FIRST.index)


def pseudo_inverse(
    records: npt.NDArray[np.void], limits: Floats, components: list[int] | None = None
) -> Floats:
    """P of components that a vehicle's effectors give, shape (m, 6), [-], [1/m]; 0 of the others.

    Components but roll are given with any moment of roll, that of roll without any other.

    `limits` are least and largest force of each record of EFFECTOR, of `force_limits_of` at
    some speed, shape (m, 2), [N]. `components` are those of `given_components`, by default of
    these limits.
    """
    unit = unit_wrenches(records)  # Bᵀ
    reach = np.abs(limits).max(axis=1)
    given = given_components(records, limits) if components is None else components
    out = np.zeros((len(records), 6))
    served = [axis for axis in given if axis != ROLL]
    out[:, served] = _weighted_inverse(unit, reach, served)
    if ROLL in given:
        out[:, ROLL] = _weighted_inverse(unit, reach, given)[:, given.index(ROLL)]
    # what is zero but for rounding would let an effector at its limit hold back others
    out[np.abs(out) < 1e-9 * np.abs(out).max(axis=0, initial=0.0)] = 0.0
    return out


def _weighted_inverse(unit: Floats, reach: Floats, axes: list[int]) -> Floats:
    """W⁻¹ Bᵀ (B W⁻¹ Bᵀ)⁻¹ of some components, by Bᵀ and the largest forces."""
    b = unit[:, axes].T
    weighted = reach[:, None] ** 2 * b.T  # W⁻¹ Bᵀ
    inverse: Floats = weighted @ np.linalg.inv(b @ weighted)
    return inverse


def greatest_roll(inverse: Floats, limits: Floats) -> float:
    """Largest moment of roll to either side that effectors give beside nothing else [N m]; 0 where
    they give none independently.

    `inverse` is of `pseudo_inverse`, `limits` are as there.
    """
    steps = inverse[:, ROLL]
    moving = steps != 0.0
    if not moving.any():
        return 0.0
    lowest, highest = limits[moving].T
    sides = [
        (np.where(side * steps[moving] > 0.0, highest, lowest) / (side * steps[moving])).min()
        for side in (1.0, -1.0)
    ]
    return float(min(sides))


@compiled
def pseudo_inverse_at(slow: Floats, fast: Floats, speed: float, out: Floats) -> None:
    """Write the pseudo-inverse P at a speed along the hull [m/s], interpolated in its square
    between `slow`, P at `MIN_STEERAGE_SPEED`, and `fast`, at `FULL_STEERAGE_SPEED`, of the same B;
    all of shape (M, 6).
    """
    slowest_square = MIN_STEERAGE_SPEED**2
    share = clip(
        (speed * abs(speed) - slowest_square) / (FULL_STEERAGE_SPEED**2 - slowest_square), 0.0, 1.0
    )
    for i in range(slow.shape[0]):
        for axis in range(6):
            out[i, axis] = slow[i, axis] + share * (fast[i, axis] - slow[i, axis])


@compiled
def allocate(inverse: Floats, limits: Floats, wrench: Floats, command: Floats) -> None:
    """Forces of effectors that give a wrench, or of it what limits allow; roll is not looked at.

    Args:
        inverse: of `pseudo_inverse_at`, zero in rows beyond the vehicle's effectors, shape (M, 6).
        limits: lowest and highest force, shape (M, 2), [N].
        wrench: wanted; out: what the forces give of it, shape (6,), [N] and [N m].
        command: out: forces, shape (m,), m ≤ M, [N].
    """
    m = command.shape[0]
    wrench[ROLL] = 0.0
    demand = (wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5])
    is_feasible = _exceeding(inverse, limits, demand, command) == 0.0
    if not all_lanes(is_feasible):
        _allocate_by_priority(inverse, limits, wrench, command)
        if any_lane(is_feasible):
            for i in range(m):
                command[i] = select(is_feasible, _force_of(inverse, i, demand), command[i])
    if any_lane(is_feasible):
        for axis in range(6):
            component = demand[axis] * _is_given(inverse, axis, m)
            wrench[axis] = select(is_feasible, component, wrench[axis])


@compiled
def _exceeding(inverse: Floats, limits: Floats, wrench: Wrench, command: Floats) -> float:
    """Command what gives a wrench; 1 if a force is beyond its limits, else 0."""
    exceeding = 0.0
    for i in range(command.shape[0]):
        force = _force_of(inverse, i, wrench)
        command[i] = force
        is_within = (limits[i, 0] <= force) & (force <= limits[i, 1])
        exceeding = select(is_within, exceeding, 1.0)
    return exceeding


@compiled
def _force_of(inverse: Floats, i: int, wrench: Wrench) -> float:
    """Force of an effector for a wrench, whatever its limits."""
    force = 0.0
    for axis in range(6):
        force = force + inverse[i, axis] * wrench[axis]
    return force


@compiled
def _allocate_by_priority(inverse: Floats, limits: Floats, wrench: Floats, command: Floats) -> None:
    """`allocate` where limits bind."""
    m = command.shape[0]
    for i in range(m):
        command[i] = 0.0
    for axis in PRIORITY:
        wrench[axis] = _add(inverse, limits, axis, wrench[axis], command)


@compiled
def _add(inverse: Floats, limits: Floats, axis: int, wanted: float, command: Floats) -> float:
    """Add to forces what gives a component of a wrench, or the largest share of it that limits
    allow, which is returned.
    """
    m = command.shape[0]
    share = _is_given(inverse, axis, m)
    for i in range(m):
        step = inverse[i, axis] * wanted
        limit = select(step > 0.0, limits[i, 1], limits[i, 0])
        # an effector that is not needed holds back none
        is_idle = step == 0.0
        possible_share = (limit - command[i]) / select(is_idle, 1.0, step)
        share = select(is_idle, share, min(share, possible_share))
    added: float = wanted * max(share, 0.0)
    for i in range(m):
        # the clip takes off what rounding may leave beyond a limit
        command[i] = clip(command[i] + inverse[i, axis] * added, limits[i, 0], limits[i, 1])
    return added


@compiled
def add_roll(
    inverse: Floats, limits: Floats, records: Records, roll: float, command: Floats
) -> float:
    """Add to forces, as of `allocate`, what brings their moment of roll to one that is wanted
    [N m], as far as limits allow; all other components stay. The moment then is returned.

    `records` are of EFFECTOR, shape (M,).
    """
    moment = 0.0
    size = abs(roll)
    for i in range(command.shape[0]):
        part = records[i].torque[0] * command[i]
        moment = moment + part
        size = size + abs(part)
    missing = roll - moment
    # rounding moves no effector
    missing = select(abs(missing) > _ROUNDING * size, missing, 0.0)
    return moment + _add(inverse, limits, ROLL, missing, command)


@compiled
def _is_given(inverse: Floats, axis: int, m: int) -> float:
    """1 if any effector gives a component of the wrench, else 0."""
    any_gives = 0.0
    for i in range(m):
        any_gives = select(inverse[i, axis] != 0.0, 1.0, any_gives)
    return any_gives
