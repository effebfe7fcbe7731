"""Power of thrusters, as of ideal actuator discs."""

from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, jitable, select
from sim.trajectory import Trajectory

DISC_DIAMETER_M = 0.1
"""Disc of every thruster: the MJCF has thrusts and no propellers. Powers compare missions; they
size no battery.
"""
_DISC_AREA_M2 = np.pi * DISC_DIAMETER_M**2 / 4


@jitable
def disc_power(thrust: Any, inflow: Any, density: float) -> Any:
    """Power of ideal actuator discs, |T| (v / 2 + √(v² / 4 + |T| / 2ρA)), [W]; numbers or arrays.

    Rankine-Froude momentum theory (Newman, Marine Hydrodynamics, 1977; Breslin & Andersen, 1994).
    Thrust [N] has any sign; the inflow [m/s] is the disc's speed through the water, positive the
    way it pushes. Water that comes from behind a disc is taken for still.
    """
    magnitude = abs(thrust)
    speed = select(inflow > 0.0, inflow, 0.0)
    return magnitude * (
        speed / 2 + np.sqrt(speed * speed / 4 + magnitude / (2 * density * _DISC_AREA_M2))
    )


@compiled
def _total_powers(
    thrust: Floats, speed: Floats, along: Floats, density: float, power: Floats
) -> None:
    """Power of all m thrusters at each instant, shape (n,): of each the thrust, shape (n, m), and
    force along the hull for a unit of it, shape (m,), at the hull's forward speed, shape (n,).
    """
    for k in range(thrust.shape[0]):
        total = 0.0
        for i in range(thrust.shape[1]):
            inflow = speed[k] * along[i] * np.sign(thrust[k, i])
            total += disc_power(thrust[k, i], inflow, density)
        power[k] = total


def thruster_power(trajectory: Trajectory, vehicle: int, density: float) -> Floats:
    """Power of all thrusters of a vehicle at each instant, shape (n,), [W]; NaN if it has effectors
    of other kinds.

    The inflow of a thruster is the hull's forward speed along its axis; thrusters across the hull
    have none.
    """
    # states of all effectors, which are thrusts [N] of thrusters alone
    thrust = np.ascontiguousarray(trajectory.effector_states[:, vehicle])
    force = trajectory.effector_force[vehicle]  # of a unit of thrust, shape (m, 3), [-]
    power = np.full(len(thrust), np.nan)
    # of fins and other effectors, whose states are no thrusts; records that pad a vehicle have no
    # force either, and their state is always 0
    not_thrusters = ~force.any(axis=1)
    if not_thrusters.any() and thrust[:, not_thrusters].any():
        return power
    speed = np.ascontiguousarray(trajectory.forward_speed[:, vehicle])
    _total_powers(thrust, speed, np.ascontiguousarray(force[:, 0]), density, power)
    return power
