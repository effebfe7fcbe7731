"""Hydrodynamic coefficients of the vehicles: the numerics of their MJCF, as records that compiled code reads."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from sim.vehicle.mjcf import VehicleSetup

MAX_STRIPS = 32

NUMERICS: dict[str, tuple[tuple[int, ...], str]] = {
    "added_mass": ((6, 6), "kg, kg m, kg m²"),
    "munk_factor": ((), "-"),
    "linear_damping": ((6,), "N s/m, N m s"),
    "linear_damping_fade": ((6,), "s/m"),
    "quadratic_damping": ((6,), "N s²/m², N m s²"),
    "buoyancy": ((), "N"),
    "displaced_inertia": ((), "kg m²"),
    "hull_radius": ((), "m"),
    "hull_lift": ((3,), "m², -, 1/rad"),
    "hull_lift_planes": ((2,), "-"),
    "cross_flow_drag": ((2,), "-"),
    "strip_x": ((MAX_STRIPS,), "m"),
    "strip_area": ((MAX_STRIPS,), "m²"),
    "fin_x": ((), "m"),
    "fin_area": ((2,), "m²"),
    "fin_lift_slope": ((), "1/rad"),
}
"""Coefficients of a vehicle as its MJCF gives them: shape and unit. Strips may be fewer than their array holds."""

RECORD = np.dtype(
    [(name, np.float64, shape) for name, (shape, _) in NUMERICS.items()]
    + [("n_strips", np.int64), ("gravity", np.float64), ("density", np.float64)],
    align=True,
)
"""One record per vehicle: the numerics of its MJCF, and the world's gravity [m/s²] and density [kg/m³]."""


def read(model: Any, names: Sequence[str], density: float) -> npt.NDArray[np.void]:
    """Hydrodynamic coefficients of vehicles, from the numerics of a compiled model.

    Args:
        model: the compiled MjModel.
        names: of vehicles, prefixes of their numerics.
        density: of the water [kg/m³].

    Returns:
        Records of RECORD, shape (v,), read-only.

    Raises:
        ValueError: a numeric is missing or of the wrong size, or the added mass is not symmetric positive semidefinite.
    """
    records = np.zeros(len(names), RECORD)
    for record, name in zip(records, names, strict=True):
        for numeric, (shape, unit) in NUMERICS.items():
            value = _numeric(model, f"{name}/{numeric}", shape, unit)
            if numeric in ("strip_x", "strip_area"):
                record[numeric][: value.size] = value
            else:
                record[numeric] = value.reshape(shape)
        record["n_strips"] = _numeric(model, f"{name}/strip_x", (MAX_STRIPS,), "m").size
        if _numeric(model, f"{name}/strip_area", (MAX_STRIPS,), "m²").size != record["n_strips"]:
            raise ValueError(f"{name}: strip_x and strip_area must have the same number of values")
        added = record["added_mass"]
        if not np.array_equal(added, added.T) or np.linalg.eigvalsh(added)[0] < 0:
            raise ValueError(f"{name}: added_mass must be symmetric and positive semidefinite")
        record["gravity"] = -model.opt.gravity[2]
        record["density"] = density
    records.flags.writeable = False
    return records


def scaled(records: npt.NDArray[np.void], setups: Sequence[VehicleSetup]) -> npt.NDArray[np.void]:
    """What the water really does to vehicles whose MJCF is not quite right: records with the setups' scales applied.

    Args:
        records: of `read`, shape (v,).
        setups: of the same vehicles; a scale of 1 changes no bit.
    """
    true = records.copy()
    for i, setup in enumerate(setups):
        for name in ("linear_damping", "quadratic_damping", "cross_flow_drag"):
            true[name][i] *= setup.drag_scale
        true["hull_lift"][i] *= (1.0, setup.drag_scale, setup.lift_scale)
        true["fin_lift_slope"][i] *= setup.lift_scale
        true["added_mass"][i] *= setup.added_mass_scale
    true.flags.writeable = False
    return true


def _numeric(model: Any, name: str, shape: tuple[int, ...], unit: str) -> Floats:
    i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    size = int(np.prod(shape))
    strips = name.endswith(("/strip_x", "/strip_area"))
    expected = f"{'1 to ' if strips else ''}{size} value{'s' if size > 1 else ''} [{unit}]"
    prefix, _, short = name.rpartition("/")
    if i < 0:
        raise ValueError(f"the MJCF of {prefix!r} lacks <numeric name={short!r}>, {expected}")
    given = int(model.numeric_size[i])
    if not (1 <= given <= size if strips else given == size):
        raise ValueError(f"<numeric name={short!r}> of {prefix!r} has {given} values, expected {expected}")
    start = model.numeric_adr[i]
    return np.array(model.numeric_data[start : start + given], dtype=np.float64)
