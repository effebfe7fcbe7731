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
    """Add the power of all m thrusters to those of each instant, shape (n,): of each the thrust,
    shape (m, n), and force along the hull for a unit of it, shape (m,), at the hull's forward
    speed, shape (n,).
    """
    # one thruster after the other, so that instants are computed several at once
    for i in range(thrust.shape[0]):
        for k in range(thrust.shape[1]):
            forward = speed[k] * along[i]
            inflow = select(thrust[i, k] < 0.0, -forward, forward)
            power[k] += disc_power(thrust[i, k], inflow, density)


def thruster_power(trajectory: Trajectory, vehicle: int, density: float) -> Floats:
    """Power of all thrusters of a vehicle at each instant, shape (n,), [W]; NaN if it has effectors
    of other kinds.

    The inflow of a thruster is the hull's forward speed along its axis; thrusters across the hull
    have none.
    """
    # states of all effectors, which are thrusts [N] of thrusters alone
    states = trajectory.effector_states[:, vehicle]
    force = trajectory.effector_force[vehicle]  # of a unit of thrust, shape (m, 3), [-]
    # of fins and other effectors, whose states are no thrusts; records that pad a vehicle have no
    # force either, and their state is always 0
    are_thrusters = force.any(axis=1)
    if states[:, ~are_thrusters].any():
        return np.full(len(states), np.nan)
    thrust = np.ascontiguousarray(states[:, are_thrusters].T)
    speed = np.ascontiguousarray(trajectory.forward_speed[:, vehicle])
    power = np.zeros(len(states))
    _total_powers(thrust, speed, force[are_thrusters, 0], density, power)
    return power
