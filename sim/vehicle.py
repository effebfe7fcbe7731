"""Vehicles out of MJCF: attach them to the ocean, resolve their names to ids once, read their coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

import models
from sim import attitude
from sim.hydrodynamics import COEFFICIENTS, MAX_STRIPS, NUMERICS

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

THRUSTERS = (
    "thruster_main",
    "thruster_lateral_bow",
    "thruster_lateral_stern",
    "thruster_vertical_bow",
    "thruster_vertical_stern",
)
"""Order of a vehicle's actuators, and of commands and thrusts in every array over thrusters."""
MODELS = ("leader", "follower")


@dataclass(frozen=True, kw_only=True)
class VehicleSetup:
    """One vehicle of a scenario. Raises ValueError if a value is not possible."""

    name: str
    model: str
    """MJCF of the hull: "leader" or "follower"."""
    position_m: tuple[float, float, float]
    """Of the body origin in the world, at the start."""
    heading_rad: float = 0.0
    """Compass, at the start."""
    speed_m_s: float = 0.0
    """Forward, over ground, at the start."""
    excess_buoyancy_n: float = 0.0
    """Added to the buoyancy; positive floats up."""
    cg_offset_x_m: float = 0.0
    """Moves the centre of gravity forward."""
    cg_offset_z_m: float = 0.0
    """Moves the centre of gravity up."""
    baseline_m: float | None = None
    """L, distance of the rear and front transmitters; None leaves them where the MJCF has them."""
    middle_offset_m: float | None = None
    """H_T, distance of the middle transmitter to port; None leaves it where the MJCF has it."""

    def __post_init__(self) -> None:
        if not self.name or "/" in self.name:
            raise ValueError(f"vehicle name {self.name!r} must not be empty or contain '/'")
        if self.model not in MODELS:
            raise ValueError(f"unknown vehicle model {self.model!r}; available: {', '.join(MODELS)}")
        for name in ("heading_rad", "speed_m_s", "excess_buoyancy_n", "cg_offset_x_m", "cg_offset_z_m"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{self.name}: {name}={getattr(self, name)} must be finite")
        if len(self.position_m) != 3 or not np.isfinite(self.position_m).all():
            raise ValueError(f"{self.name}: position_m={self.position_m} must be three finite numbers")
        if self.baseline_m is not None and not self.baseline_m > 0:
            raise ValueError(f"{self.name}: baseline_m={self.baseline_m} must be positive")


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """A vehicle of a compiled model: the ids of its parts."""

    name: str
    body: int
    qpos: int
    """First of its seven entries in `qpos`."""
    dof: int
    """First of its six entries in `qvel`."""
    actuators: tuple[int, ...]
    """In the order of THRUSTERS."""


def compose(setups: Sequence[VehicleSetup], floor_depth_m: float | None = None) -> mujoco.MjSpec:
    """The ocean with vehicles attached, each under the prefix "name/".

    Raises:
        ValueError: two vehicles share a name, there is no vehicle, or a vehicle lacks the site that is to be moved.
    """
    names = [s.name for s in setups]
    if not names or len(set(names)) != len(names):
        raise ValueError(f"vehicles need distinct names, and there must be one at least; given: {names}")
    spec = mujoco.MjSpec.from_file(str(models.path("ocean")))
    if floor_depth_m is not None:
        spec.geom("floor").pos[2] = -floor_depth_m
    for setup in setups:
        spec.attach(_edited(setup), frame=spec.worldbody.add_frame(), prefix=f"{setup.name}/")
    return spec


def _edited(setup: VehicleSetup) -> mujoco.MjSpec:
    """The vehicle's own MJCF, loaded afresh, with what the setup changes of it."""
    spec = mujoco.MjSpec.from_file(str(models.path(setup.model)))
    for key in list(spec.keys):
        spec.delete(key)  # the keyframe of one vehicle alone does not fit the composed model
    hull = spec.body("hull")
    hull.ipos = hull.ipos + np.array([setup.cg_offset_x_m, 0.0, setup.cg_offset_z_m])
    hull.pos = np.asarray(setup.position_m)
    hull.quat = attitude.from_euler(setup.heading_rad)
    spec.site("cg").pos = hull.ipos
    buoyancy = spec.numeric("buoyancy")
    buoyancy.data = np.asarray(buoyancy.data) + setup.excess_buoyancy_n
    moves = {}
    if setup.baseline_m is not None:
        moves |= {"tx_rear": (0, -setup.baseline_m / 2), "tx_front": (0, setup.baseline_m / 2)}
    if setup.middle_offset_m is not None:
        moves |= {"tx_middle": (1, setup.middle_offset_m)}
    for name, (axis, value) in moves.items():
        site = spec.site(name)
        if site is None:
            raise ValueError(f"{setup.name}: the model {setup.model!r} has no site {name!r} to move")
        site.pos[axis] = value
    return spec


def resolve(model: Any, name: str) -> Vehicle:
    """Ids of the vehicle `name`; ValueError if the model has no such vehicle or it lacks a thruster."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{name}/hull")
    actuators = tuple(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, f"{name}/{t}") for t in THRUSTERS)
    if body < 0 or min(actuators) < 0:
        missing = [f"{name}/hull"] * (body < 0)
        missing += [f"{name}/{t}" for t, i in zip(THRUSTERS, actuators, strict=True) if i < 0]
        raise ValueError(f"the model lacks {', '.join(missing)}")
    joint = model.body_jntadr[body]
    return Vehicle(
        name=name,
        body=body,
        qpos=int(model.jnt_qposadr[joint]),
        dof=int(model.jnt_dofadr[joint]),
        actuators=actuators,
    )


def coefficients(model: Any, names: Sequence[str], density: float) -> npt.NDArray[np.void]:
    """Hydrodynamic coefficients of vehicles, from the numerics of a compiled model.

    Args:
        model: the compiled MjModel.
        names: of vehicles, prefixes of their numerics.
        density: of the water [kg/m³].

    Returns:
        Records of COEFFICIENTS, shape (v,), read-only.

    Raises:
        ValueError: a numeric is missing or of the wrong size, or the added mass is not symmetric positive semidefinite.
    """
    records = np.zeros(len(names), COEFFICIENTS)
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
