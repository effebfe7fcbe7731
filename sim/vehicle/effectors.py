"""Effectors: the actuators of an MJCF as records, their forces, and the lag of their states behind
commands.

An actuator is a thruster whose state is its thrust [N], unless the MJCF has a numeric of its name
and a suffix: NAME.curve, NAME.propeller, NAME.fin, NAME.foil, or NAME.module:Class with a class of
a plugin. `sim.vehicle.effector_kinds` has the kinds. A fixed fin is a site NAME with a numeric
NAME.fin or NAME.foil and no actuator. It pushes along the site's z axis.

A record holds the number of its kind. Compiled code gets the kinds as a tuple, so that its type has
their classes, and calls a method of the kind with this number (`calls_method`).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, cast

import mujoco
import numba
import numpy as np
import numpy.typing as npt
from numba.extending import overload

from laisn.arrays import Floats
from laisn.compile_errors import compiling_own
from laisn.compiled import compiled
from laisn.errors import LaisnError
from laisn.plugins import class_and_file, find_class, is_plugin_name
from sim import attitude
from sim.attitude import Vector, plus
from sim.vehicle.effector_kinds import (
    BUILT_IN,
    EFFECTOR,
    MAX_PARAMETERS,
    Effector,
    EffectorKind,
    HullFlow,
)
from sim.vehicle.mjcf import VehicleIds, VehicleSetup, numeric

Kinds = tuple[EffectorKind, ...]

_CUSTOM: list[EffectorKind] = []
"""Kinds of plugins that this process has met; their numbers follow those of BUILT_IN."""


class Fitted(NamedTuple):
    """The effectors of v vehicles: up to m with a state, and up to q fixed fins, of each."""

    kinds: Kinds  # as of `kinds_of`
    records: Any  # of EFFECTOR, first those with a state, shape (v, m + q)
    states: Floats  # shape (v, m)


def kinds_of(records: npt.NDArray[np.void]) -> Kinds:
    """Kinds of which the records hold the numbers.

    Those of the project are always among them, so that compiled code is the same for all hulls
    without kinds of the user's own.
    """
    custom = int(np.max(records["kind"], initial=0)) >= len(BUILT_IN)
    return (*BUILT_IN, *_CUSTOM) if custom else BUILT_IN


def kind_of(record: Effector | np.void) -> EffectorKind:
    """The kind of an effector."""
    return (*BUILT_IN, *_CUSTOM)[int(record["kind"])]


def number_of(kind: type[EffectorKind]) -> int:
    """Number of a class of kinds in records; ValueError if no effector has been of it."""
    return [type(known_kind) for known_kind in (*BUILT_IN, *_CUSTOM)].index(kind)


def _kind_named(suffix: str, where: str) -> EffectorKind:
    """The kind of a numeric; LaisnError if there is none, or its methods cannot be compiled."""
    for kind in BUILT_IN[1:]:
        if kind.suffix == suffix:
            return kind
    if not is_plugin_name(suffix):
        available = ", ".join(kind.suffix for kind in BUILT_IN[1:])
        raise LaisnError(
            f"{where}: unknown kind of effector {suffix!r}; available: {available}, and "
            "module:Class of a plugin"
        )
    # a name without a class, "module", means the class in it that has this method
    kind_class: type[EffectorKind] = find_class("effector", suffix, "load")
    if not (isinstance(kind_class, type) and issubclass(kind_class, EffectorKind)):
        raise LaisnError(f"{where}: {suffix} must be derived from laisn_sim.EffectorKind")
    if len(kind_class.parameters) > MAX_PARAMETERS:
        raise LaisnError(f"{where}: {suffix} may have {MAX_PARAMETERS} parameters at most")
    for kind in _CUSTOM:
        if type(kind) is kind_class:
            return kind
    kind = kind_class()
    _require_compilable(kind, suffix)
    _CUSTOM.append(kind)
    return kind


class _Answer(NamedTuple):
    """What a method of a kind returns."""

    shape: tuple[int, ...]
    meaning: str


_ANSWERS = {
    "load": _Answer((2, 3), "force [N] and moment [N m] in the body, three numbers each"),
    "respond": _Answer((), "the state after the step, a number"),
    "force_limits": _Answer((2,), "the least and the largest force [N]"),
    "state_for": _Answer((), "a state, a number"),
}


def _require_compilable(kind: EffectorKind, name: str) -> None:
    """LaisnError with the reason if the methods of a kind of the user's own do not compile, or do
    not return what they must.
    """
    still_water = HullFlow(1000.0, 9.81, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    kinds = (kind,)
    record = np.zeros((1, 1), EFFECTOR)
    fitted = Fitted(kinds, record, np.zeros((1, 1)))
    effector = record[0, 0]
    arguments: dict[str, tuple[Any, ...]] = {
        "load": (effector, 0.0, still_water),
        "respond": (effector, 0.0, 0.0, 1.0, 0.02),
        "force_limits": (effector, 1000.0, 1.0),
        "state_for": (effector, 1000.0, 0.0, 1.0),
    }
    calls: dict[str, Callable[[], Any]] = {
        "load": lambda: effector_wrench(fitted, 0, still_water),
        "respond": lambda: update_states(fitted, np.zeros((1, 1)), np.ones((1, 1)), 0.02),
        "force_limits": lambda: force_limits(kinds, effector, 1000.0, 1.0),
        "state_for": lambda: state_for(kinds, effector, 1000.0, 0.0, 1.0),
    }
    for method, call in calls.items():
        with compiling_own(f"effector {name}: its `{method}`"):
            # alone at first, so that an error is that of its own lines
            kind_class: Any = type(kind)
            answer = _compiled_method(kind_class, method)(kind, *arguments[method])
            _require_answer(answer, kind, method, name)
            call()


def _require_answer(answer: object, kind: EffectorKind, method: str, name: str) -> None:
    """LaisnError if a method of a kind of the user's own returns something else than it must."""
    expected = _ANSWERS[method]
    try:
        shape = np.shape(np.array(answer, dtype=np.float64))
    except (TypeError, ValueError):
        shape = None
    if answer is None or shape != expected.shape:
        code = getattr(type(kind), method).__code__
        raise LaisnError(
            f"effector {name}: its `{method}` ({code.co_filename}:{code.co_firstlineno}) returns "
            f"{answer!r:.60}; expected {expected.meaning}"
        )


@cache
def _compiled_method(kind: type[EffectorKind], method: str) -> Any:
    return numba.njit(error_model="numpy", forceinline=True)(getattr(kind, method))


def _choice_of(functions: Sequence[Any]) -> Callable[..., Any]:
    """A function `(kinds, number, arguments)` that calls that of this number, on its kind.

    Its text is a chain of comparisons, one for each function: compiled code has no lists of
    functions of several types.
    """
    *others, last = range(len(functions))
    lines = ["def choose(kinds, number, arguments):"]
    for i in others:
        lines += [f"    if number == {i}:", f"        return call_{i}(kinds[{i}], *arguments)"]
    lines.append(f"    return call_{last}(kinds[{last}], *arguments)")
    names = {f"call_{i}": function for i, function in enumerate(functions)}
    exec("\n".join(lines), names)
    choose: Callable[..., Any] = names["choose"]
    return choose


def calls_method(method: str) -> Callable[..., Any]:
    """A function `(kinds, number, arguments)` that calls a method of one of the kinds.

    In compiled code it is a chain of comparisons, which the compiler turns into a jump.
    """

    def call(kinds: Kinds, number: int, arguments: tuple[Any, ...]) -> Any:
        return getattr(kinds[number], method)(*arguments)

    @overload(call, strict=False, inline="always")
    def _chosen(kinds: Any, number: Any, arguments: Any) -> Any:
        classes = [kind.instance_class for kind in kinds.types]
        function = _compiled_method(classes[0], method)
        if all(getattr(kind, method) is getattr(classes[0], method) for kind in classes):
            return lambda kinds, number, arguments: function(kinds[0], *arguments)
        return _choice_of([_compiled_method(kind, method) for kind in classes])

    return call


_load = calls_method("load")
_respond = calls_method("respond")
_force_limits = calls_method("force_limits")
_state_for = calls_method("state_for")


def read(model: mujoco.MjModel, vehicles: Sequence[VehicleIds]) -> npt.NDArray[np.void]:
    """Effectors of vehicles, from a compiled model: records of EFFECTOR in the order of the MJCF,
    shape (v, m).

    Records that pad a vehicle are zero. LaisnError if an actuator does not act at a site of its own
    hull, or its numeric is wrong.
    """
    records = np.zeros(
        (len(vehicles), max(len(vehicle.actuators) for vehicle in vehicles)), EFFECTOR
    )
    numerics = _numerics(model)
    for row, vehicle in zip(records, vehicles, strict=True):
        for record, actuator in zip(row, vehicle.actuators, strict=False):
            site, reference = model.actuator_trnid[actuator]
            name = model.actuator(actuator).name
            at_site = (
                model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_SITE.value and reference < 0
            )
            if not at_site or model.site_bodyid[site] != vehicle.body:
                raise LaisnError(
                    f"actuator {name!r} must act at a site of the body '{vehicle.name}/hull', "
                    "without a reference site"
                )
            record["lag"] = model.actuator_dynprm[actuator, 0]
            record["limits"] = model.actuator_ctrlrange[actuator]
            suffixes = [suffix for owner, suffix in numerics if owner == name]
            if len(suffixes) > 1:
                suffixes_text = ", ".join(f".{suffix}" for suffix in suffixes)
                raise LaisnError(f"actuator {name!r} has several of the numerics {suffixes_text}")
            gear = model.actuator_gear[actuator]
            _place(record, model, site, gear if has_fin(model, name) else unit_gear(gear))
            _fill(record, model, name, suffixes[0] if suffixes else "")
    return records


def read_fixed(model: mujoco.MjModel, vehicles: Sequence[VehicleIds]) -> npt.NDArray[np.void]:
    """Fixed fins of vehicles, from a compiled model: records and errors as of `read`, with limits
    of zero, shape (v, q).
    """
    fixed = [
        (owner, suffix)
        for owner, suffix in _numerics(model)
        if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, owner) < 0
    ]
    of_vehicle = [
        [entry for entry in fixed if entry[0].startswith(f"{vehicle.name}/")]
        for vehicle in vehicles
    ]
    records = np.zeros((len(vehicles), max(map(len, of_vehicle), default=0)), EFFECTOR)
    for row, vehicle, entries in zip(records, vehicles, of_vehicle, strict=True):
        for record, (name, suffix) in zip(row, entries, strict=False):
            where = f"<numeric name={f'{name}.{suffix}'!r}>"
            if not _kind_named(suffix, where).is_fin:
                raise LaisnError(f"{where}: there is no actuator {name!r}")
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
            if site < 0 or model.site_bodyid[site] != vehicle.body:
                raise LaisnError(
                    f"{where}: there is no actuator {name!r}, nor a site of the body "
                    f"'{vehicle.name}/hull' for a fixed fin"
                )
            _place(record, model, site, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
            _fill(record, model, name, suffix)
            # rounding of the attitude: an upright fin has no lift
            record["force"][np.abs(record["force"]) < 1e-12] = 0.0
    return records


def _numerics(model: mujoco.MjModel) -> list[tuple[str, str]]:
    """Owners and suffixes of the numerics of effectors; names of vehicles may have points too."""
    names = [model.numeric(i).name for i in range(model.nnumeric)]
    return [
        (f"{vehicle}{slash}{owner}", suffix)
        for vehicle, slash, inner in (name.rpartition("/") for name in names)
        for owner, point, suffix in [inner.partition(".")]
        if point
    ]


_GEAR_TOLERANCE = 1e-3  # of the length of a unit vector that is rounded


def gear_length(gear: Floats) -> float:
    """Length of the force of a gear, shape (6,), or of its torque where it has no force; 1 of a
    unit vector that is rounded.
    """
    force_length = float(np.linalg.norm(gear[:3]))
    length = force_length if force_length > 0.0 else float(np.linalg.norm(gear[3:]))
    return 1.0 if abs(length - 1.0) <= _GEAR_TOLERANCE else length


def unit_gear(gear: Floats) -> Floats:
    """Direction that a gear says, shape (6,): its force, or else its torque, has the length 1, so
    that the thrust of a state is that of the log, of limits and of power. Zero stays zero.
    """
    length = gear_length(gear)
    return gear / length if length > 0.0 else gear


def _place(record: Effector, model: mujoco.MjModel, site: int, gear: Floats) -> None:
    """Write unit force and torque, given in the frame of the site, and its place."""
    force, torque = attitude.rotate(model.site_quat[site], gear.reshape(2, 3))
    record["force"] = force
    record["torque"] = torque + np.cross(model.site_pos[site], force)
    record["place"] = model.site_pos[site]


def _fill(record: Effector, model: mujoco.MjModel, name: str, suffix: str) -> None:
    """Write kind and parameters of a numeric; an empty suffix is that of a thruster."""
    kind = BUILT_IN[0]
    if suffix:
        where = f"<numeric name={f'{name}.{suffix}'!r}>"
        kind = _kind_named(suffix, where)
        kind.fill(record, cast(Floats, numeric(model, f"{name}.{suffix}")), where)
    record["kind"] = number_of(type(kind))
    record["fades"] = kind.fades


def has_fin(model: mujoco.MjModel, actuator: str) -> bool:
    """Whether an actuator moves a fin of the project's kinds."""
    suffixes = [kind.suffix for kind in BUILT_IN if kind.is_fin]
    return any(numeric(model, f"{actuator}.{suffix}") is not None for suffix in suffixes)


@dataclass(frozen=True, kw_only=True)
class Hinge:
    """What turns with a fin: a geom of a compiled model, about an axis of the body frame."""

    effector: int  # index among the vehicle's effectors
    geom: int
    axis: Floats  # shape (3,)
    undeflected: Floats  # quaternion (w, x, y, z) of the geom at no deflection


class MovingFins:
    """The geoms of a vehicle in a compiled model with looks that have the names of fins, turned
    as the fins are.
    """

    def __init__(self, model: mujoco.MjModel, prefix: str = "") -> None:
        """Take a model of which the names of the vehicle's parts, or of all, have a prefix."""
        self._model = model
        self.hinges: list[Hinge] = []
        actuators = [i for i in range(model.nu) if model.actuator(i).name.startswith(prefix)]
        for number, i in enumerate(actuators):
            name = model.actuator(i).name
            geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
            if geom >= 0 and has_fin(model, name):
                push = attitude.rotate(
                    model.site_quat[model.actuator_trnid[i, 0]], model.actuator_gear[i, :3]
                )
                axis = np.cross((1.0, 0.0, 0.0), push)
                orientation = model.geom_quat[geom].copy()
                self.hinges.append(
                    Hinge(effector=number, geom=geom, axis=axis, undeflected=orientation)
                )

    def __bool__(self) -> bool:
        return bool(self.hinges)

    def turn(self, state: Floats) -> None:
        """Turn the geoms by the states of the vehicle's effectors, shape (m,); deflections are
        [rad].
        """
        for hinge in self.hinges:
            orientation = np.zeros(4)
            mujoco.mju_axisAngle2Quat(orientation, hinge.axis, float(state[hinge.effector]))
            mujoco.mju_mulQuat(self._model.geom_quat[hinge.geom], orientation, hinge.undeflected)


@compiled
def effector_wrench(
    fitted: Fitted, vehicle: int, water: HullFlow
) -> tuple[Vector, Vector, Vector, Vector]:
    """Forces of all effectors and fixed fins of a vehicle, by its index.

    Returns:
        Force [N] and moment about the origin [N m], in the body, of effectors that act wherever the
        hull is; likewise of all others, which fade where it leaves the water.
    """
    steady_force = (0.0, 0.0, 0.0)
    steady_moment = (0.0, 0.0, 0.0)
    fading_force = (0.0, 0.0, 0.0)
    fading_moment = (0.0, 0.0, 0.0)
    records = fitted.records
    states = fitted.states
    for i in range(records.shape[1]):
        record = records[vehicle, i]
        # fixed fins, and the zero records that pad them, have no state
        state = states[vehicle, i] if i < states.shape[1] else 0.0
        push, turn = _load(fitted.kinds, record.kind, (record, state, water))
        if record.fades == 0:
            steady_force = plus(steady_force, push)
            steady_moment = plus(steady_moment, turn)
        else:
            fading_force = plus(fading_force, push)
            fading_moment = plus(fading_moment, turn)
    return steady_force, steady_moment, fading_force, fading_moment


def not_finite(fitted: Fitted, vehicle: int, water: HullFlow) -> Iterator[tuple[int, str]]:
    """Indices of a vehicle's effectors of plugins whose state or load is not finite, and what is
    told of each: class, state, force and moment.
    """
    for j, record in enumerate(fitted.records[vehicle]):
        if record["kind"] < len(BUILT_IN):
            continue
        kind = kind_of(record)
        state = float(fitted.states[vehicle, j]) if j < fitted.states.shape[1] else 0.0
        # the method itself: numba takes classes of one name for each other within tuples
        kind_class: Any = type(kind)
        load = _compiled_method(kind_class, "load")(kind, record, state, water)
        force, moment = np.array(load, dtype=np.float64).tolist()
        if not np.isfinite([state, *force, *moment]).all():
            yield (
                j,
                f"{class_and_file(kind)} at its state {state:g}: force {force} N, moment "
                f"{moment} N m; expected finite numbers",
            )


@compiled
def update_states(fitted: Fitted, command: Floats, response: Floats, dt: float) -> None:
    """Bring states a step of `dt` [s] closer to commands within their limits, both of shape (v, m).

    `response` is the share of a first-order lag that passes in the step, 1 − exp(−dt/lag).
    """
    records = fitted.records
    states = fitted.states
    for i in range(states.shape[0]):
        for j in range(states.shape[1]):
            record = records[i, j]
            limits = record.limits
            demand = min(max(command[i, j], limits[0]), limits[1])
            states[i, j] = _respond(
                fitted.kinds, record.kind, (record, states[i, j], demand, response[i, j], dt)
            )


@compiled
def force_limits(
    kinds: Kinds, record: Effector, density: float, speed: float
) -> tuple[float, float]:
    """Least and largest force along an effector's axis at a speed along the hull [N]."""
    low, high = _force_limits(kinds, record.kind, (record, density, speed))
    return low, high


@compiled
def state_for(kinds: Kinds, record: Effector, density: float, force: float, speed: float) -> float:
    """State of an effector that gives a force along its axis, within `force_limits` [N], at a speed
    along the hull.
    """
    return float(_state_for(kinds, record.kind, (record, density, force, speed)))


def force_limits_of(records: npt.NDArray[np.void], density: float, speed: float) -> Floats:
    """`force_limits` of each record of a vehicle, shape (m, 2), [N]."""
    limits = np.empty((len(records), 2))
    _write_force_limits(kinds_of(records), records, density, speed, limits)
    return limits


@compiled
def _write_force_limits(
    kinds: Kinds, records: npt.NDArray[np.void], density: float, speed: float, limits: Floats
) -> None:
    """`force_limits` of each record; that Python calls this, and not `force_limits`, leaves the
    latter to its compiled callers, which take it in.
    """
    for i in range(limits.shape[0]):
        limits[i, 0], limits[i, 1] = force_limits(kinds, records[i], density, speed)


def states_for(
    records: npt.NDArray[np.void], density: float, forces: Floats, speed: float
) -> Floats:
    """`state_for` of each record of a vehicle, shape (m,)."""
    states = np.empty(len(records))
    _write_states(kinds_of(records), records, density, (forces, speed), states)
    return states


@compiled
def _write_states(
    kinds: Kinds,
    records: npt.NDArray[np.void],
    density: float,
    wanted: tuple[Floats, float],
    states: Floats,
) -> None:
    """`state_for` of each record, as `_write_force_limits`; `wanted` are forces and speed."""
    forces, speed = wanted
    for i in range(states.shape[0]):
        states[i] = state_for(kinds, records[i], density, forces[i], speed)


def scaled_records(
    records: npt.NDArray[np.void], setups: Sequence[VehicleSetup]
) -> npt.NDArray[np.void]:
    """What effectors really give whose MJCF is not quite right: records of `read` with the
    setups' scales applied.
    """
    true = records.copy()
    for row, setup in zip(true, setups, strict=True):
        for record in row:
            kind_of(record).scale(record, setup.settings.thrust_scale, setup.settings.lift_scale)
    true.flags.writeable = False
    return true


def states_are_thrust(records: npt.NDArray[np.void]) -> npt.NDArray[np.bool_]:
    """Whether the state of each effector is its thrust along its axis [N], shape (v, m)."""
    flat = [kind_of(record).state_is_thrust for record in records.ravel()]
    return np.array(flat, dtype=np.bool_).reshape(records.shape)


def as_allocated(records: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Records of a vehicle as its autopilot takes them: those whose kind states no `force_limits`
    are thrusters without thrust, whose commands it leaves at zero.

    Compiled code of controllers is then the same with kinds that forces are not allocated to.
    """
    allocated = records.copy()
    for record in allocated:
        if type(kind_of(record)).force_limits is EffectorKind.force_limits:
            record["kind"] = 0
            record["limits"] = 0.0
    return allocated


def fins_of(*records: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """The fins among records of one vehicle, moving and fixed ones."""
    all_records = np.concatenate(records)
    return all_records[all_records["lift_area"] > 0.0]


def unit_wrenches(records: npt.NDArray[np.void]) -> Floats:
    """Force and torque about the body's origin of a unit of force along the axis, in the body,
    shape (v, m, 6).
    """
    return np.concatenate([records["force"], records["torque"]], axis=-1)
