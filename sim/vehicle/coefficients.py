"""Hydrodynamic coefficients of the vehicles: the numerics of their MJCF, as records that compiled code reads."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from laisn.failure import LaisnError
from sim.vehicle import mjcf
from sim.vehicle.mjcf import VehicleSetup

MAX_STRIPS = 32

NUMERICS: dict[str, tuple[tuple[int, ...], str]] = {  # coefficients of an MJCF: shape and unit; strips may be fewer
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
}

_SIGNED = ("added_mass", "strip_x")

MATRICES = {"linear_damping": "linear_coupling", "quadratic_damping": "quadratic_coupling"}
"""Numerics that may have 6×6 values by rows, D of the wrench −D ν or −D |ν| ν, and where those off the diagonal go."""

RECORD = np.dtype(
    [(name, np.float64, shape) for name, (shape, _) in NUMERICS.items()]
    + [("linear_coupling", np.float64, (6, 6)), ("quadratic_coupling", np.float64, (6, 6)), ("coupled", np.int64)]
    + [("n_strips", np.int64), ("gravity", np.float64), ("density", np.float64), ("cross_flow_root", np.float64, (2,))],
    align=True,
)
"""One record per vehicle: the numerics of its MJCF, damping off the diagonals where they have 6×6 values, the world's
gravity [m/s²] and density [kg/m³], and what is computed once: the cube roots of `cross_flow_drag`."""


def read(model: Any, names: Sequence[str], density: float) -> npt.NDArray[np.void]:
    """Hydrodynamic coefficients of vehicles by name in a compiled model, in water of a density [kg/m³].

    Records of RECORD, shape (v,), read-only. LaisnError if a numeric is missing, of the wrong size or negative, or the
    added mass is not symmetric positive semidefinite.
    """
    records, sizes = np.zeros(len(names), RECORD), dict[str, int]()
    for record, name in zip(records, names, strict=True):
        for numeric, (shape, _) in NUMERICS.items():
            value = mjcf.numeric(model, f"{name}/{numeric}")
            fault = numeric_error(numeric, None if value is None else value.size)
            if value is None or fault:
                raise LaisnError(f"the MJCF of {name!r}: {fault}")
            own = np.diag(value.reshape(6, 6)) if numeric in MATRICES and value.size == 36 else value
            if numeric not in _SIGNED and np.any(own < 0.0):
                raise LaisnError(f"{name}: {numeric} must not be negative")
            if numeric in ("strip_x", "strip_area"):
                record[numeric][: value.size] = value
            elif numeric in MATRICES and value.size == 36:
                record[numeric], record[MATRICES[numeric]] = own, value.reshape(6, 6) - np.diag(own)
                record["coupled"] |= int(record[MATRICES[numeric]].any())
            else:
                record[numeric] = value.reshape(shape)
            sizes[numeric] = value.size
        record["n_strips"] = sizes["strip_x"]
        if sizes["strip_area"] != sizes["strip_x"]:
            raise LaisnError(f"{name}: strip_x and strip_area must have the same number of values")
        added = record["added_mass"]
        if not np.array_equal(added, added.T) or np.linalg.eigvalsh(added)[0] < 0:
            raise LaisnError(f"{name}: added_mass must be symmetric and positive semidefinite")
        record["gravity"] = -model.opt.gravity[2]
        record["density"] = density
    _take_roots(records)
    records.flags.writeable = False
    return records


def _take_roots(records: npt.NDArray[np.void]) -> None:
    """Bring the roots of `cross_flow_drag` up to date."""
    for root, drag in zip(records["cross_flow_root"], records["cross_flow_drag"], strict=True):
        # not all at once: NumPy's powers of arrays round otherwise than compiled code's of numbers
        root[:] = [float(value) ** (1 / 3) for value in drag]


def scaled(records: npt.NDArray[np.void], setups: Sequence[VehicleSetup]) -> npt.NDArray[np.void]:
    """What the water really does to vehicles whose MJCF is not quite right: records with the setups' scales applied."""
    true = records.copy()
    for i, settings in enumerate(setup.settings for setup in setups):
        for name in (*MATRICES, *MATRICES.values(), "cross_flow_drag"):
            true[name][i] *= settings.drag_scale
        true["hull_lift"][i] *= (1.0, settings.drag_scale, settings.lift_scale)
        true["added_mass"][i] *= settings.added_mass_scale
    _take_roots(true)
    true.flags.writeable = False
    return true


def numeric_error(name: str, given: int | None) -> str:
    """Error of a numeric of a vehicle by its number of values (None: missing); empty: valid."""
    shape, unit = NUMERICS[name]
    size, strips = int(np.prod(shape)), name.startswith("strip_")
    expected = f"{'1 to ' if strips else ''}{size} value{'s' if size > 1 else ''} [{unit}]"
    if given is None:
        return f"lacks <numeric name={name!r}>, {expected}"
    fits = 1 <= given <= size if strips else given == size or (name in MATRICES and given == 36)
    return "" if fits else f"<numeric name={name!r}> has {given} values, expected {expected}"
