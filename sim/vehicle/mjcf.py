"""Vehicles out of MJCF: attach them to the ocean, resolve their names to ids once, read their
coefficients.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from typing import Annotated, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

import models
from laisn.arrays import Floats, RecordFields, row_dtype
from laisn.errors import LaisnError
from sim import attitude
from sim.scenario import vehicles
from sim.vehicle.effector_kinds import Bounds


@dataclass(frozen=True, kw_only=True)
class VehicleSetup:
    """One vehicle of a scenario."""

    name: str
    model: str  # a name for `models.path`, "leader" or "follower", or the text of an MJCF file
    # position (east, north, up) of the body origin in the world, at the start
    position_m: tuple[float, float, float]
    heading_rad: float = 0.0  # compass, at the start
    speed_m_s: float = 0.0  # forward, over ground, at the start
    settings: vehicles.Vehicle = field(default_factory=vehicles.Vehicle.model_construct)
    """What is changed of the MJCF: trim, true over nominal coefficients, the hydrophone's
    place.
    """
    transmitters: Mapping[str, tuple[int, float]] = field(default_factory=dict)
    """What is changed of the places of a leader's transmitters, as of `transmitter_places`."""


class VehicleIds(NamedTuple):
    """A vehicle of a compiled model: the ids of its parts."""

    name: str
    body: int
    qpos: int  # first of its seven entries in `qpos`
    actuators: tuple[int, ...]  # MuJoCo's ids, in the order of the MJCF
    effectors: tuple[str, ...]  # their names in the MJCF


def compose(
    setups: Sequence[VehicleSetup], floor_depth_m: float | None = None, *, with_geoms: bool = True
) -> mujoco.MjSpec:
    """The ocean with vehicles attached, each under the prefix "name/".

    `floor_depth_m` None leaves the floor where the MJCF has it; without `with_geoms` the vehicles
    have no geoms, and are not seen.
    """
    spec = spec_of("ocean")
    if floor_depth_m is not None:
        # crests of the relief reach up to the floor's depth, so that what is above it is clear
        spec.geom("floor").pos[2] = -floor_depth_m - spec.hfield("floor").size[2]
    for group in _groups(setups):
        if len(group) == 1:
            hull = _edited(group[0], with_geoms)
            spec.attach(hull, frame=spec.worldbody.add_frame(), prefix=f"{group[0].name}/")
        else:
            initial = group[0].name[0]
            fleet = _fleet(group, spec, with_geoms)
            spec.attach(fleet, frame=spec.worldbody.add_frame(), prefix=initial)
    return spec


_GROUP = 16  # largest number of vehicles that are attached together


def _groups(setups: Sequence[VehicleSetup]) -> Iterator[list[VehicleSetup]]:
    """Vehicles in their order, in groups of one initial letter."""
    for _, group in groupby(setups, key=lambda setup: setup.name[0]):
        yield from _batched([*group])


def _batched(setups: Sequence[VehicleSetup]) -> Iterator[list[VehicleSetup]]:
    for first in range(0, len(setups), _GROUP):
        yield [*setups[first : first + _GROUP]]


def _fleet(group: Sequence[VehicleSetup], ocean: mujoco.MjSpec, with_geoms: bool) -> mujoco.MjSpec:
    """Vehicles attached together, without the initial of their names, in a model with the options
    of the ocean.

    Attaching one costs time in proportion to the vehicles that are there. So many of them are
    attached to a small model first, and this to the ocean.
    """
    fleet = mujoco.MjSpec()
    for name in _OPTIONS:
        setattr(fleet.option, name, getattr(ocean.option, name))
    for setup in group:
        hull = _edited(setup, with_geoms)
        fleet.attach(hull, frame=fleet.worldbody.add_frame(), prefix=f"{setup.name[1:]}/")
    return fleet


_OPTIONS = ("timestep", "integrator", "density", "viscosity", "gravity")
"""What the MJCF of the ocean sets; MuJoCo warns of models that are attached with others."""


def text_of(model: str) -> str:
    """The MJCF of a model by name, or the text of a file, as it is."""
    return model if vehicles.is_mjcf(model) else models.path(model).read_text("utf-8")


def spec_of(model: str, with_geoms: bool = True) -> mujoco.MjSpec:
    """A vehicle's own MJCF without keyframes, to be changed: of a model by name, or of the text
    of a file.
    """
    return _attachable(text_of(model), with_geoms).copy()


@lru_cache(maxsize=8)
def _attachable(text: str, with_geoms: bool) -> mujoco.MjSpec:
    """A vehicle's MJCF as the composed model has room for it, to be copied: to make it takes
    forty times as long.
    """
    spec = mujoco.MjSpec.from_string(text)
    for key in list(spec.keys):
        spec.delete(key)  # the keyframe of one vehicle alone does not fit the composed model
    for geom in [] if with_geoms else list(spec.geoms):
        spec.delete(geom)
    return spec


def transmitter_places(leader: vehicles.Leader) -> dict[str, tuple[int, float]]:
    """Axis and coordinate [m] to which keys of a leader move its transmitters' sites; the others
    stay where the MJCF has them.
    """
    moves: dict[str, tuple[int, float]] = {}
    if leader.baseline_m is not None:
        moves |= {
            "tx_rear": (0, -leader.baseline_m / 2),
            "tx_front": (0, leader.baseline_m / 2),
        }
    if leader.middle_offset_m is not None:
        moves |= {"tx_middle": (1, leader.middle_offset_m)}
    return moves


def _edited(setup: VehicleSetup, with_geoms: bool) -> mujoco.MjSpec:
    """A vehicle's own MJCF with all that its setup changes."""
    spec = spec_of(setup.model, with_geoms)
    hull = spec.body("hull")
    settings = setup.settings
    hull.ipos = hull.ipos + np.array([settings.cg_offset_x_m, 0.0, settings.cg_offset_z_m])
    hull.pos = np.asarray(setup.position_m)
    hull.quat = attitude.from_euler(setup.heading_rad)
    spec.site("cg").pos = hull.ipos
    spec.add_numeric(name="excess_buoyancy", size=1, data=[settings.excess_buoyancy_n])
    spec.add_numeric(name="neutral", size=1, data=[float(settings.trim == "neutral")])
    for name, (axis, value) in setup.transmitters.items():
        spec.site(name).pos[axis] = value
    if settings.hydrophone_m is not None:
        hydrophone = spec.site("hydrophone") or hull.add_site(name="hydrophone", group=4)
        hydrophone.pos = np.asarray(settings.hydrophone_m)
    return spec


def numeric(model: mujoco.MjModel, name: str) -> Floats | None:
    """Values of a numeric of a compiled model; None: it has none of this name."""
    i = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    return (
        None
        if i < 0
        else model.numeric_data[model.numeric_adr[i] : model.numeric_adr[i] + model.numeric_size[i]]
    )


def inertia_tensor(model: mujoco.MjModel, body: int) -> Floats:
    """Inertia of a body of a compiled model about its centre of gravity, on the axes of the body
    frame, shape (3, 3), [kg m²].

    MuJoCo keeps principal moments and the attitude of their axes (`body_inertia`, `body_iquat`).
    """
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    to_body = axes.reshape(3, 3)
    return np.asarray((to_body * model.body_inertia[body]) @ to_body.T)


def resolve(model: mujoco.MjModel, names: Sequence[str]) -> list[VehicleIds]:
    """Ids of vehicles by their names."""
    actuators: dict[str, list[int]] = {name: [] for name in names}
    effectors: dict[str, list[str]] = {name: [] for name in names}
    for i in range(model.nu):
        vehicle, _, effector = model.actuator(i).name.partition("/")
        if vehicle in actuators:
            actuators[vehicle].append(i)
            effectors[vehicle].append(effector)
    vehicles = []
    for name in names:
        body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, f"{name}/hull")
        first = int(model.jnt_qposadr[model.body_jntadr[body]])
        vehicles.append(
            VehicleIds(name, body, first, tuple(actuators[name]), tuple(effectors[name]))
        )
    return vehicles


MAX_STRIPS = 32

SEA_WATER = 1026.0  # density at which a hull's buoyancy holds unless its file says another [kg/m³]


class Coefficients(RecordFields):
    """What the water does to one vehicle; units are those of NUMERICS and OPTIONAL.

    Buoyancy and inertia of the displaced water hold in water of `density`: that of the world, or,
    where this depends on depth, its value at one depth.
    """

    # numerics of its MJCF, damping as its diagonal; docs/vehicles.md says what each means
    added_mass: Annotated[Floats, (6, 6)]
    munk_factor: float
    linear_damping: Annotated[Floats, (6,)]
    linear_damping_fade: Annotated[Floats, (6,)]
    quadratic_damping: Annotated[Floats, (6,)]
    buoyancy: float
    displaced_inertia: float
    hull_radius: float
    hull_lift: Annotated[Floats, (3,)]  # area, drag coefficient, slope of the lift
    hull_lift_planes: Annotated[Floats, (2,)]
    cross_flow_drag: Annotated[Floats, (2,)]
    strip_x: Annotated[Floats, (MAX_STRIPS,)]  # of the first `n_strips`, as is `strip_area`
    strip_area: Annotated[Floats, (MAX_STRIPS,)]
    buoyancy_density: float
    buoyancy_centre: Annotated[Floats, (3,)]
    # damping off the diagonals, and whether there is any
    linear_coupling: Annotated[Floats, (6, 6)]
    quadratic_coupling: Annotated[Floats, (6, 6)]
    coupled: int
    n_strips: int
    off_centre: int  # 1: the centre of buoyancy is off the origin
    gravity: float  # [m/s²]
    density: float  # [kg/m³]
    cross_flow_root: Annotated[Floats, (2,)]  # cube roots of `cross_flow_drag`


COEFFICIENTS = row_dtype(Coefficients)

_UNITS = {
    "added_mass": "kg, kg m, kg m²",
    "munk_factor": "-",
    "linear_damping": "N s/m, N m s",
    "linear_damping_fade": "s/m",
    "quadratic_damping": "N s²/m², N m s²",
    "buoyancy": "N",
    "displaced_inertia": "kg m²",
    "hull_radius": "m",
    "hull_lift": "m², -, 1/rad",
    "hull_lift_planes": "-",
    "cross_flow_drag": "-",
    "strip_x": "m",
    "strip_area": "m²",
}
NUMERICS = {name: (COEFFICIENTS[name].shape, unit) for name, unit in _UNITS.items()}
"""Coefficients of an MJCF: shape and unit; strips may be fewer."""

OPTIONAL: dict[str, tuple[tuple[int, ...], str, tuple[float, ...]]] = {
    "buoyancy_density": ((), "kg/m³", (SEA_WATER,)),
    "buoyancy_centre": ((3,), "m", (0.0, 0.0, 0.0)),
}
"""Coefficients that an MJCF may leave out: shape, unit and default.

`buoyancy` and `displaced_inertia` hold in water of `buoyancy_density`, and are in proportion to the
density of a mission's water; together they state the displaced volume. `buoyancy_centre` is the
centre of buoyancy in the body frame, whose origin is the reference point of all other coefficients.
"""

_NOT_NEGATIVE = Bounds(0.0, with_low=True)
_POSITIVE = Bounds(0.0)
_SHARE = Bounds(0.0, 1.0, with_low=True, with_high=True)
BOUNDS = {
    "munk_factor": _SHARE,
    "linear_damping": _NOT_NEGATIVE,
    "linear_damping_fade": _NOT_NEGATIVE,
    "quadratic_damping": _NOT_NEGATIVE,
    "buoyancy": _NOT_NEGATIVE,
    "buoyancy_density": _POSITIVE,
    "displaced_inertia": _NOT_NEGATIVE,
    "hull_radius": _POSITIVE,
    "hull_lift": _NOT_NEGATIVE,
    "hull_lift_planes": _SHARE,
    "cross_flow_drag": _NOT_NEGATIVE,
    "strip_area": _NOT_NEGATIVE,
}
"""Values that coefficients may have, of matrices their diagonals; the others have either sign."""

LAG_BOUNDS = _NOT_NEGATIVE
"""Time constants that effectors may have [s]."""

MATRICES = {"linear_damping": "linear_coupling", "quadratic_damping": "quadratic_coupling"}
"""Numerics that may have 6×6 values by rows, D of the wrench −D ν or −D |ν| ν, and where those
off the diagonal go.
"""


def read_coefficients(
    model: mujoco.MjModel, names: Sequence[str], density: float | Sequence[float]
) -> npt.NDArray[np.void]:
    """Hydrodynamic coefficients of vehicles by name in a compiled model, in water of a density, or
    of one for each [kg/m³].

    Records of COEFFICIENTS, shape (v,), read-only. LaisnError if a numeric is missing, of the wrong
    size or out of its BOUNDS, strips lack a position or an area, or the added mass is
    not symmetric positive semidefinite.
    """
    records = np.zeros(len(names), COEFFICIENTS)
    sizes = dict[str, int]()
    densities = np.broadcast_to(np.asarray(density, dtype=np.float64), len(names)).tolist()
    for record, name, water_density in zip(records, names, densities, strict=True):
        for key in NUMERICS:
            sizes[key] = _read_required(record, model, name, key)
        record["n_strips"] = sizes["strip_x"]
        if sizes["strip_area"] != sizes["strip_x"]:
            raise LaisnError(f"{name}: strip_x and strip_area must have the same number of values")
        added = record["added_mass"]
        if not np.array_equal(added, added.T) or np.linalg.eigvalsh(added)[0] < 0:
            raise LaisnError(f"{name}: added_mass must be symmetric and positive semidefinite")
        _read_optional(record, model, name)
        record["gravity"] = -model.opt.gravity[2]
        record["density"] = water_density
        _displace(record, model, name)
    _take_roots(records)
    records.flags.writeable = False
    return records


def _require_bounds(name: str, key: str, values: npt.ArrayLike) -> None:
    """LaisnError naming the first value of a coefficient that is out of its bounds."""
    for value in np.ravel(values).tolist() if key in BOUNDS else ():
        fault = BOUNDS[key].fault(value)
        if fault:
            raise LaisnError(f"{name}: {key} {fault}")


def _read_required(record: np.void, model: mujoco.MjModel, name: str, key: str) -> int:
    """Fill in place, and return the number of values; LaisnError as of `read_coefficients`."""
    value = numeric(model, f"{name}/{key}")
    fault = numeric_error(key, None if value is None else value.size)
    if value is None or fault:
        raise LaisnError(f"the MJCF of {name!r}: {fault}")
    is_matrix = key in MATRICES and value.size == 36
    diagonal = np.diag(value.reshape(6, 6)) if is_matrix else value
    _require_bounds(name, key, diagonal)
    if key in ("strip_x", "strip_area"):
        record[key][: value.size] = value
    elif is_matrix:
        record[key] = diagonal
        record[MATRICES[key]] = value.reshape(6, 6) - np.diag(diagonal)
        record["coupled"] |= int(record[MATRICES[key]].any())
    else:
        shape, _ = NUMERICS[key]
        record[key] = value.reshape(shape)
    return int(value.size)


def _read_optional(record: np.void, model: mujoco.MjModel, name: str) -> None:
    """Fill in place, by the file's value or the default; LaisnError as of `read_coefficients`."""
    for key, (shape, _, default) in OPTIONAL.items():
        value = numeric(model, f"{name}/{key}")
        if value is not None and (fault := numeric_error(key, value.size)):
            raise LaisnError(f"the MJCF of {name!r}: {fault}")
        record[key] = np.reshape(default if value is None else value, shape)
        _require_bounds(name, key, record[key])
    record["off_centre"] = int(record["buoyancy_centre"].any())


def _displace(record: np.void, model: mujoco.MjModel, name: str) -> None:
    """Bring buoyancy and inertia of the displaced water to the density of the world, in place, and
    trim the vehicle as its setup does.
    """
    density_ratio = record["density"] / record["buoyancy_density"]
    record["displaced_inertia"] *= density_ratio
    neutral = numeric(model, f"{name}/neutral")
    if neutral is not None and neutral[0]:
        record["buoyancy"] = model.body(f"{name}/hull").mass[0] * record["gravity"]
    else:
        record["buoyancy"] *= density_ratio
    excess = numeric(model, f"{name}/excess_buoyancy")
    record["buoyancy"] += 0.0 if excess is None else excess[0]


def _take_roots(records: npt.NDArray[np.void]) -> None:
    """Write `cross_flow_root` by `cross_flow_drag`."""
    for root, drag in zip(records["cross_flow_root"], records["cross_flow_drag"], strict=True):
        # not all at once: NumPy's powers of arrays round otherwise than compiled code's of numbers
        root[:] = [float(value) ** (1 / 3) for value in drag]


def _scale(values: Floats, scales: Sequence[float]) -> None:
    """Multiply values of v vehicles, shape (v, …), by a number of each, in place."""
    vehicles_last = values.T
    vehicles_last *= scales


def scaled_coefficients(
    records: npt.NDArray[np.void], setups: Sequence[VehicleSetup]
) -> npt.NDArray[np.void]:
    """What the water really does to vehicles whose MJCF is not quite right: records with the
    setups' scales applied.
    """
    true = records.copy()
    settings = [setup.settings for setup in setups]
    drag_scales = [each.drag_scale for each in settings]
    for name in (*MATRICES, *MATRICES.values(), "cross_flow_drag"):
        _scale(true[name], drag_scales)
    true["hull_lift"] *= [(1.0, each.drag_scale, each.lift_scale) for each in settings]
    _scale(true["added_mass"], [each.added_mass_scale for each in settings])
    _take_roots(true)
    true.flags.writeable = False
    return true


def numeric_error(name: str, count: int | None) -> str:
    """Error of a numeric of a vehicle by its number of values (None: missing); empty: valid.

    Those of OPTIONAL are not asked for where they are missing.
    """
    shape, unit = NUMERICS[name] if name in NUMERICS else OPTIONAL[name][:2]
    size = int(np.prod(shape))
    strips = name.startswith("strip_")
    expected = f"{'1 to ' if strips else ''}{size} value{'s' if size > 1 else ''} [{unit}]"
    if count is None:
        return f"lacks <numeric name={name!r}>, {expected}"
    fits = 1 <= count <= size if strips else count == size or (name in MATRICES and count == 36)
    return "" if fits else f"<numeric name={name!r}> has {count} values, expected {expected}"
