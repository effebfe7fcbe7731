"""How thrusters act on their hulls: what MuJoCo calls the moments of the actuators.

A thruster's site is fixed in its hull and a free joint counts torque in the body, so that a unit of thrust always has
the same force and torque in the body frame; only the direction of the force in the world turns with the hull.
`mj_transmission` finds the same from Jacobians of the whole model, at a price that grows with the square of the number
of vehicles and makes up a fifth of a step of ten.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.geometry import attitude
from sim.geometry.vectors import rotation, times
from sim.vehicle.mjcf import Vehicle

Layout = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int32]]
"""Layout of MuJoCo's sparse matrix of moments: numbers of entries and their addresses by row, and their columns."""


def unit_wrenches(model: Any, vehicles: Sequence[Vehicle]) -> Floats:
    """Force and torque about the body's origin of a unit of thrust, in the body frame.

    Args:
        model: MjModel.
        vehicles: of the model.

    Returns:
        Shape (v, 5, 6), thrusters in the order of `sim.vehicle.mjcf.THRUSTERS`, [-] and [m].

    Raises:
        ValueError: a thruster does not act at a site of its own hull.
    """
    out = np.empty((len(vehicles), len(vehicles[0].actuators), 6))
    for v, vehicle in enumerate(vehicles):
        for i, actuator in enumerate(vehicle.actuators):
            site, reference = model.actuator_trnid[actuator]
            at_site = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_SITE.value and reference < 0
            if not at_site or model.site_bodyid[site] != vehicle.body:
                raise ValueError(
                    f"actuator {model.actuator(actuator).name!r} must act at a site of the body "
                    f"'{vehicle.name}/hull', without a reference site"
                )
            force, torque = attitude.rotate(model.site_quat[site], model.actuator_gear[actuator].reshape(2, 3))
            out[v, i, :3] = force
            out[v, i, 3:] = torque + np.cross(model.site_pos[site], force)
    return out


@compiled
def lay_out(layout: Layout, per_vehicle: int) -> None:
    """Have MuJoCo's matrix of moments hold all six of each thruster; `mj_forward` leaves out those of zero.

    Args:
        layout: `moment_rownnz`, `moment_rowadr` and `moment_colind`; overwritten.
        per_vehicle: number of thrusters of a vehicle.
    """
    entries, address, column = layout
    for i in range(entries.size):
        entries[i], address[i] = 6, 6 * i
        for j in range(6):
            column[6 * i + j] = 6 * (i // per_vehicle) + j


@compiled
def turn(wrenches: Floats, pose: Floats, moments: Floats) -> None:
    """Write the moments of all thrusters, shape (v, 5, 6): force in the world, torque in the body.

    Args:
        wrenches: of `unit_wrenches`, shape (v, 5, 6).
        pose: position and quaternion, shape (v, 7).
        moments: overwritten.
    """
    for v in range(pose.shape[0]):
        to_world = rotation(pose[v, 3:7])
        for i in range(wrenches.shape[1]):
            w = wrenches[v, i]
            force = times(to_world, (w[0], w[1], w[2]))
            for j in range(3):
                moments[v, i, j] = force[j]
                moments[v, i, 3 + j] = w[3 + j]
