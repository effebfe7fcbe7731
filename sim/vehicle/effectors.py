"""Effectors: the actuators of an MJCF as records, and their moments, which MuJoCo needs at every step.

The site of a thruster is fixed in its hull and a free joint counts torque in the body frame, so that a unit of thrust
has a constant force and torque in the body; only the direction of the force in the world turns with the hull.
`mj_transmission` finds the same from Jacobians of the whole model, which costs time with the square of the number of
vehicles.
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.failure import LaisnError
from sim.geometry import attitude
from sim.geometry.attitude import rotation, times
from sim.vehicle.mjcf import Vehicle

Layout = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int32]]
"""Layout of MuJoCo's sparse matrix of moments: numbers of entries and their addresses by row, and their columns."""


MOST = 16
"""Largest number of effectors of a vehicle."""

EFFECTOR = np.dtype(
    [
        ("force", np.float64, (3,)),  # force of a unit of thrust, in the body frame [-]
        ("torque", np.float64, (3,)),  # its torque about the body's origin [m]
        ("lag", np.float64),  # time constant of the thrust [s]
        ("limits", np.float64, (2,)),  # lowest and highest thrust [N]
    ],
    align=True,
)
"""One actuator of a vehicle, as its MJCF gives it."""


def read(model: Any, vehicles: Sequence[Vehicle]) -> npt.NDArray[np.void]:
    """Effectors of vehicles, from a compiled model.

    Args:
        model: MjModel.
        vehicles: of the model.

    Returns:
        Records of EFFECTOR in the order of the MJCF, shape (v, m); actuators that pad a vehicle are all zeros.

    Raises:
        LaisnError: an actuator does not act at a site of its own hull.
    """
    records = np.zeros((len(vehicles), len(vehicles[0].actuators)), EFFECTOR)
    for row, vehicle in zip(records, vehicles, strict=True):
        for record, actuator in zip(row[: vehicle.effectors], vehicle.actuators, strict=False):
            site, reference = model.actuator_trnid[actuator]
            at_site = model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_SITE.value and reference < 0
            if not at_site or model.site_bodyid[site] != vehicle.body:
                raise LaisnError(
                    f"actuator {model.actuator(actuator).name!r} must act at a site of the body "
                    f"'{vehicle.name}/hull', without a reference site"
                )
            force, torque = attitude.rotate(model.site_quat[site], model.actuator_gear[actuator].reshape(2, 3))
            record["force"], record["torque"] = force, torque + np.cross(model.site_pos[site], force)
            record["lag"], record["limits"] = model.actuator_dynprm[actuator, 0], model.actuator_ctrlrange[actuator]
    return records


def unit_wrenches(records: npt.NDArray[np.void]) -> Floats:
    """Force and torque about the body's origin of a unit of thrust, in the body frame.

    Args:
        records: of `read`, shape (v, m).

    Returns:
        Shape (v, m, 6), [-] and [m].
    """
    return np.concatenate([records["force"], records["torque"]], axis=-1)


@compiled
def lay_out(layout: Layout, per_vehicle: int) -> None:
    """Have MuJoCo's matrix of moments hold all six of each actuator; `mj_forward` leaves out those of zero.

    Args:
        layout: `moment_rownnz`, `moment_rowadr` and `moment_colind`; overwritten.
        per_vehicle: number of actuators of a vehicle.
    """
    entries, address, column = layout
    for i in range(entries.size):
        entries[i], address[i] = 6, 6 * i
        for j in range(6):
            column[6 * i + j] = 6 * (i // per_vehicle) + j


@compiled
def turn(wrenches: Floats, pose: Floats, moments: Floats) -> None:
    """Write the moments of all actuators, shape (v, m, 6): force in the world, torque in the body.

    Args:
        wrenches: of `unit_wrenches`, shape (v, m, 6).
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
