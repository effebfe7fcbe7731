"""Effectors: the actuators of an MJCF as records, their forces, and the lag of their states behind
commands.

An actuator is a thruster whose state is its thrust [N], unless the MJCF has a numeric of its name
and a suffix:

    NAME.curve      thruster; the state is any quantity, the curve has pairs of state and thrust
    [N], both increasing NAME.propeller  the state is revolutions per second: diameter [m], K_T at J
    = 0, its slope dK_T/dJ, K_Q and its
                    slope, wake fraction, thrust deduction, and the share of the torque that turns
                    the hull (negative for a propeller of the other hand)
    NAME.fin        the state is the deflection [rad], positive where it pushes along the actuator's
    axis: area [m²],
                    slope of the normal force [1/rad], stall angle [rad], drag coefficient at no
                    incidence
    NAME.foil       a fin with the forces of gz-sim's LiftDrag: area [m²], slope of the lift
                    [1/rad], stall angle [rad], slope beyond it [1/rad], incidence at no deflection
                    [rad], drag coefficient per incidence [1/rad], beyond the stall angle [1/rad],
                    and 1 if it also acts in flow from behind, or 0

A fixed fin is a site NAME with a numeric NAME.fin or NAME.foil and no actuator. It pushes along
the site's z axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.errors import LaisnError
from sim import attitude
from sim.attitude import Vector, cross, plus, scaled
from sim.vehicle.mjcf import Vehicle, VehicleSetup, numeric

MAX_EFFECTORS = 16  # largest number of effectors of a vehicle
MAX_CURVE_POINTS = 32  # largest number of points of a thruster's curve
THRUSTER, CURVE, PROPELLER, FIN = range(4)  # kinds of effectors
SUFFIXES = {".curve": CURVE, ".propeller": PROPELLER, ".fin": FIN, ".foil": FIN}
FIN_SUFFIXES = (".fin", ".foil")
# by suffix, with the intervals of their values
_PARAMETERS: dict[str, dict[str, tuple[str, float, float]]] = {
    ".propeller": {
        "diameter [m]": ("more than", 0.0, 1e3),
        "K_T at J = 0": ("more than", 0.0, 1e3),
        "dK_T/dJ": ("more than", -1e3, 1e-9),
        "K_Q at J = 0": ("more than", -1e3, 1e3),
        "dK_Q/dJ": ("more than", -1e3, 1e3),
        "wake fraction": ("at least", 0.0, 1.0),
        "thrust deduction": ("at least", 0.0, 1.0),
        "share of the torque on the hull": ("more than", -1e3, 1e3),
    },
    ".fin": {
        "area [m²]": ("more than", 0.0, 1e3),
        "slope of the normal force [1/rad]": ("more than", 0.0, 1e3),
        "stall angle [rad]": ("more than", 0.0, 1.571),
        "drag coefficient": ("at least", 0.0, 1e3),
    },
    ".foil": {
        "area [m²]": ("more than", 0.0, 1e3),
        "slope of the lift [1/rad]": ("more than", 0.0, 1e3),
        "stall angle [rad]": ("more than", 0.0, 1.571),
        "slope of the lift beyond the stall angle [1/rad]": ("more than", -1e3, 1e3),
        "incidence at no deflection [rad]": ("more than", -1.571, 1.571),
        "drag coefficient per incidence [1/rad]": ("more than", -1e3, 1e3),
        "drag coefficient per incidence beyond the stall angle [1/rad]": ("more than", -1e3, 1e3),
        "1 if it acts in flow from behind, or 0": ("at least", 0.0, 1.000001),
    },
}
# speed below which allocation leaves fins out, and hulls that need them cannot be steered [m/s]
MIN_STEERAGE_SPEED = 0.5
LEAST_FLOW = 0.01  # speed up to which gz-sim's LiftDrag gives no force [m/s]

EFFECTOR = np.dtype(  # one actuator of a vehicle, as its MJCF gives it
    [
        ("force", np.float64, (3,)),  # force of a unit of thrust, in the body frame [-]
        ("torque", np.float64, (3,)),  # its torque about the body's origin [m]
        ("lag", np.float64),  # time constant of the state [s]
        ("limits", np.float64, (2,)),  # lowest and highest state: thrust [N], or as of the kind
        ("kind", np.int64),
        ("foil", np.int64),  # 1: a fin with the forces of gz-sim's LiftDrag
        ("place", np.float64, (3,)),  # of the site, in the body frame [m]
        ("parameters", np.float64, (8,)),  # of a propeller or a fin, as the MJCF has them
        ("points", np.int64),
        ("curve", np.float64, (MAX_CURVE_POINTS, 2)),  # states and thrusts [N]
    ],
    align=True,
)


def read(model: Any, vehicles: Sequence[Vehicle]) -> npt.NDArray[np.void]:
    """Effectors of vehicles, from a compiled model: records of EFFECTOR in the order of the MJCF,
    shape (v, m).

    Records that pad a vehicle are zero. LaisnError if an actuator does not act at a site of its own
    hull, or its numeric is wrong.
    """
    records = np.zeros(
        (len(vehicles), max(len(vehicle.actuators) for vehicle in vehicles)), EFFECTOR
    )
    for row, vehicle in zip(records, vehicles, strict=True):
        for record, actuator in zip(row, vehicle.actuators, strict=False):
            site, reference = model.actuator_trnid[actuator]
            at_site = (
                model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_SITE.value and reference < 0
            )
            if not at_site or model.site_bodyid[site] != vehicle.body:
                raise LaisnError(
                    f"actuator {model.actuator(actuator).name!r} must act at a site of the body "
                    f"'{vehicle.name}/hull', without a reference site"
                )
            record["lag"] = model.actuator_dynprm[actuator, 0]
            record["limits"] = model.actuator_ctrlrange[actuator]
            _fill(record, model, model.actuator(actuator).name, site, model.actuator_gear[actuator])
    return records


def read_fixed(model: Any, vehicles: Sequence[Vehicle]) -> npt.NDArray[np.void]:
    """Fixed fins of vehicles, from a compiled model: likewise, with limits of zero, shape (v,
    q).
    """
    numerics = [model.numeric(i).name for i in range(model.nnumeric)]
    fins = [name.rpartition(".")[0] for name in numerics if name.endswith(FIN_SUFFIXES)]
    fixed = [
        name for name in fins if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name) < 0
    ]
    own = [[name for name in fixed if name.startswith(f"{vehicle.name}/")] for vehicle in vehicles]
    records = np.zeros((len(vehicles), max(map(len, own), default=0)), EFFECTOR)
    for row, vehicle, names in zip(records, vehicles, own, strict=True):
        for record, name in zip(row, names, strict=False):
            site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
            if site < 0 or model.site_bodyid[site] != vehicle.body:
                raise LaisnError(
                    f"<numeric name='{name}.fin'>: there is no actuator {name!r}, nor a site of "
                    f"the body '{vehicle.name}/hull' for a fixed fin"
                )
            _fill(record, model, name, site, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
            # rounding of the attitude: an upright fin has no lift
            record["force"][np.abs(record["force"]) < 1e-12] = 0.0
    return records


def _fill(record: Any, model: Any, name: str, site: int, gear: Floats) -> None:
    """Fill in place, unit force and torque, given in the frame of the site, and kind and
    parameters of a numeric.
    """
    force, torque = attitude.rotate(model.site_quat[site], gear.reshape(2, 3))
    record["force"] = force
    record["torque"] = torque + np.cross(model.site_pos[site], force)
    record["place"] = model.site_pos[site]
    for suffix, kind in SUFFIXES.items():
        values = numeric(model, name + suffix)
        if values is None:
            continue
        if record["kind"] != THRUSTER:
            raise LaisnError(f"actuator {name!r} has several of the numerics {', '.join(SUFFIXES)}")
        record["kind"] = kind
        record["foil"] = suffix == ".foil"
        where = f"<numeric name={name + suffix!r}>"
        if kind == CURVE:
            pairs = values.reshape(-1, 2) if values.size % 2 == 0 else np.zeros((0, 2))
            rises = (
                len(pairs)
                and np.all(np.diff(pairs[:, 0]) > 0)
                and np.all(np.diff(pairs[:, 1]) >= 0)
            )
            if not (2 <= len(pairs) <= MAX_CURVE_POINTS and rises and pairs[0, 1] < pairs[-1, 1]):
                raise LaisnError(
                    f"{where} must have 2 to {MAX_CURVE_POINTS} pairs of state and thrust, rising"
                )
            record["points"] = len(pairs)
            record["curve"][: len(pairs)] = pairs
            continue
        expected = _PARAMETERS[suffix]
        if values.size != len(expected):
            raise LaisnError(
                f"{where} has {values.size} values, expected {len(expected)}: {', '.join(expected)}"
            )
        record["parameters"][: values.size] = values
        for i, (what, (above, low, high)) in enumerate(expected.items()):
            if not (low < values[i] < high or (values[i] == low and above == "at least")):
                bound = f"{above} {low:g} and below {high:g}"
                raise LaisnError(
                    f"{where}: value {i + 1}, {what}, must be {bound} (given: {values[i]:g})"
                )
        across = (
            abs(record["force"][0]) < 1e-9 and abs(np.linalg.norm(record["force"]) - 1.0) < 1e-6
        )
        if kind == FIN and not across:
            axis = " ".join(f"{value:g}" for value in record["force"])
            raise LaisnError(
                f"{name!r}: the axis of a fin must be a unit vector across the hull (given: {axis})"
            )


@dataclass(frozen=True, kw_only=True)
class Hinge:
    """What turns with a fin: a geom of a compiled model, about an axis of the body frame."""

    effector: int  # index among the vehicle's effectors
    geom: int
    axis: Floats
    still: Floats  # attitude of the geom at no deflection


class MovingFins:
    """The geoms of a vehicle in a compiled model with looks that have the names of fins, turned
    as the fins are.
    """

    def __init__(self, model: Any, prefix: str = "") -> None:
        """Take a model of which the names of the vehicle's parts, or of all, have a prefix."""
        self._model = model
        self.hinges: list[Hinge] = []
        own = [i for i in range(model.nu) if model.actuator(i).name.startswith(prefix)]
        for number, i in enumerate(own):
            name = model.actuator(i).name
            geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
            is_fin = any(numeric(model, name + suffix) is not None for suffix in FIN_SUFFIXES)
            if geom >= 0 and is_fin:
                push = attitude.rotate(
                    model.site_quat[model.actuator_trnid[i, 0]], model.actuator_gear[i, :3]
                )
                axis = np.cross((1.0, 0.0, 0.0), push)
                still = model.geom_quat[geom].copy()
                self.hinges.append(Hinge(effector=number, geom=geom, axis=axis, still=still))

    def __bool__(self) -> bool:
        return bool(self.hinges)

    def turn(self, state: Floats) -> None:
        """Turn the geoms by the states of the vehicle's effectors, shape (m,); deflections are
        [rad].
        """
        for hinge in self.hinges:
            turned = np.zeros(4)
            mujoco.mju_axisAngle2Quat(turned, hinge.axis, float(state[hinge.effector]))
            mujoco.mju_mulQuat(self._model.geom_quat[hinge.geom], turned, hinge.still)


@compiled
def propeller_load(p: Floats, density: float, rate: float, inflow: float) -> tuple[float, float]:
    """Thrust, less its deduction [N], and torque on the hull [N m] (Fossen 2021, chapter 9).

    K_T and K_Q fall linearly with J = (1 − w) u / (n D), with `rate` n [1/s] and `inflow` u, the
    speed of the propeller along its axis [m/s]. Astern, and in water from behind, they are those of
    J = 0. `p` are its parameters.
    """
    size = density * p[0] ** 3 * abs(rate)
    own = rate * p[0]
    advance = (1.0 - p[5]) * max(inflow, 0.0) if rate > 0.0 else 0.0
    return (1.0 - p[6]) * size * (p[1] * own + p[2] * advance), p[7] * size * p[0] * (
        p[3] * own + p[4] * advance
    )


@compiled
def thrust_on_curve(record: Any, state: float) -> float:
    """Thrust of a curve [N], linear between its points and constant beyond them."""
    curve = record.curve
    last = record.points - 1
    if state <= curve[0, 0]:
        return float(curve[0, 1])
    for i in range(last):
        if state <= curve[i + 1, 0]:
            share = (state - curve[i, 0]) / (curve[i + 1, 0] - curve[i, 0])
            return float(curve[i, 1] + share * (curve[i + 1, 1] - curve[i, 1]))
    return float(curve[last, 1])


@compiled
def fin_force(record: Any, density: float, deflection: float, local: Vector) -> Vector:
    """Force of a fin by the velocity of its place relative to the water, in the body [N].

    Across the deflected chord acts ½ρ S a U² sin α |cos α|, with α the incidence of the flow on the
    chord, beyond the stall angle that of this angle (an assumption): it tilts back with the fin.
    Along the flow acts ½ρ S C_D0 U².
    """
    e = record.force
    p = record.parameters
    u = local[0]
    across = local[0] * e[0] + local[1] * e[1] + local[2] * e[2]
    square = u * u + across * across
    if square < 1e-12:
        return 0.0, 0.0, 0.0
    speed = np.sqrt(square)
    sine = 0.0
    cosine = 1.0
    limit = 1.0
    # fixed fins, which are met at every step, need no sine
    if deflection != 0.0:
        sine, cosine = np.sin(deflection), np.cos(deflection)
    if p[2] < 0.5 * np.pi:
        limit = np.sin(p[2])
    incidence = min(max((u * sine - across * cosine) / speed, -limit), limit)
    scale = 0.5 * density * p[0]
    normal = scale * p[1] * square * incidence * np.sqrt(1.0 - incidence * incidence)
    drag = scale * p[3] * speed
    aside = normal * cosine - drag * across
    return -normal * sine - drag * u, aside * e[1], aside * e[2]


@compiled
def foil_force(record: Any, density: float, deflection: float, local: Vector) -> Vector:
    """Force of a fin as gz-sim's LiftDrag has it, by the velocity of its place, in the body [N].

    Lift acts across the flow and drag along it, in the plane of the hull's axis and the fin's:
    ½ρ S C U² with C = C_Lα α and C = |C_Dα α|, of other slopes beyond the stall angle, times the
    squared cosine of the sweep. α is the incidence of the flow on the deflected chord.
    """
    e = record.force
    p = record.parameters
    along = local[0]
    across = local[0] * e[0] + local[1] * e[1] + local[2] * e[2]
    total = local[0] * local[0] + local[1] * local[1] + local[2] * local[2]
    square = along * along + across * across
    ahead = along * np.cos(deflection) + across * np.sin(deflection)
    if total <= LEAST_FLOW * LEAST_FLOW or square == 0.0 or (ahead <= 0.0 and p[7] == 0.0):
        return 0.0, 0.0, 0.0
    incidence = p[4] + deflection + np.arctan2(-across, along)
    while abs(incidence) > 0.5 * np.pi:
        incidence -= np.copysign(np.pi, incidence)
    beyond_stall = max(abs(incidence) - p[2], 0.0)
    below_stall = min(abs(incidence), p[2])
    lift = np.copysign(max(p[1] * below_stall + p[3] * beyond_stall, 0.0), incidence)
    drag = abs(p[5] * below_stall + p[6] * beyond_stall)
    # dynamic pressure times area and the squared cosine of the sweep, over the speed in the plane
    scale = 0.5 * density * p[0] * np.sqrt(square) * (square / total)
    aside = scale * (lift * along - drag * across)
    return -scale * (lift * across + drag * along), aside * e[1], aside * e[2]


@compiled
def effector_wrench(
    fitted: tuple[Any, Floats], number: int, density: float, v: Vector, w: Vector
) -> tuple[Vector, Vector, Vector, Vector]:
    """Forces of all effectors and fixed fins of a vehicle.

    Args:
        fitted: of all vehicles: records of EFFECTOR, first those with a state, shape (v, m + q);
            states, shape (v, m).
        number: of the vehicle.
        density: of the water [kg/m³].
        v: velocity relative to the water, in the body [m/s].
        w: rate of turn relative to the water [rad/s].

    Returns:
        Force [N] and moment about the origin [N m], in the body, of thrusters whose state is the
        thrust; likewise of all others, which fade where the hull leaves the water.
    """
    thrust = (0.0, 0.0, 0.0)
    torque = (0.0, 0.0, 0.0)
    force = (0.0, 0.0, 0.0)
    moment = (0.0, 0.0, 0.0)
    records, states = fitted
    for i in range(records.shape[1]):
        record = records[number, i]
        e = record.force
        arm = record.torque
        axis = (e[0], e[1], e[2])
        lever = (arm[0], arm[1], arm[2])
        # fixed fins, and the zero records that pad them, have no state
        state = states[number, i] if i < states.shape[1] else 0.0
        if record.kind == THRUSTER:
            thrust = plus(thrust, scaled(state, axis))
            torque = plus(torque, scaled(state, lever))
            continue
        if record.kind == CURVE:
            push = thrust_on_curve(record, state)
            force = plus(force, scaled(push, axis))
            moment = plus(moment, scaled(push, lever))
            continue
        place = (record.place[0], record.place[1], record.place[2])
        local = plus(v, cross(w, place))
        if record.kind == FIN:
            if record.foil == 1:
                part = foil_force(record, density, state, local)
            else:
                part = fin_force(record, density, state, local)
            force = plus(force, part)
            moment = plus(moment, cross(place, part))
            continue
        inflow = local[0] * e[0] + local[1] * e[1] + local[2] * e[2]
        push, twist = propeller_load(record.parameters, density, state, inflow)
        force = plus(force, scaled(push, axis))
        moment = plus(moment, plus(scaled(push, lever), scaled(twist, axis)))
    return thrust, torque, force, moment


@compiled
def apply_lag(fitted: tuple[Any, Floats], command: Floats, response: Floats) -> None:
    """Bring states, as of `effector_wrench`, a step closer to commands within their limits, both of
    shape (v, m).

    `response` is the share of a first-order lag that passes in a step, 1 − exp(−dt/lag).
    """
    records, states = fitted
    for i in range(states.shape[0]):
        for j in range(states.shape[1]):
            limits = records[i, j].limits
            states[i, j] += response[i, j] * (
                min(max(command[i, j], limits[0]), limits[1]) - states[i, j]
            )


@compiled
def force_limits(record: Any, density: float, speed: float) -> tuple[float, float]:
    """Least and largest force along an effector's axis at a speed along the hull, of fins at
    least `MIN_STEERAGE_SPEED`, [N].
    """
    low, high = record.limits[0], record.limits[1]
    if record.kind == CURVE:
        return thrust_on_curve(record, low), thrust_on_curve(record, high)
    if record.kind == PROPELLER:
        p = record.parameters
        inflow = speed * record.force[0]
        return propeller_load(p, density, low, inflow)[0], propeller_load(p, density, high, inflow)[
            0
        ]
    if record.kind == FIN:
        lift = fin_lift(record, density, speed)
        stall = record.parameters[2]
        at_rest = record.parameters[4]  # incidence of a foil at no deflection
        return lift * max(low + at_rest, -stall), lift * min(high + at_rest, stall)
    return low, high


@compiled
def fin_lift(record: Any, density: float, speed: float) -> float:
    """Force of a fin per deflection at a speed, `MIN_STEERAGE_SPEED` or more [N/rad]."""
    way = max(speed, MIN_STEERAGE_SPEED)
    return float(0.5 * density * record.parameters[0] * record.parameters[1] * way * way)


@compiled
def state_for(record: Any, density: float, force: float, speed: float) -> float:
    """State of an effector that gives a force along its axis, within `force_limits` [N], at a speed
    along the hull.
    """
    if record.kind == FIN:
        return float(force / fin_lift(record, density, speed) - record.parameters[4])
    if record.kind == PROPELLER:
        p = record.parameters
        size = (1.0 - p[6]) * density * p[0] ** 3
        square = size * p[1] * p[0]
        half = 0.5 * size * p[2] * (1.0 - p[5]) * max(speed * record.force[0], 0.0)
        if half * half + square * force >= 0.0:
            return float((-half + np.sqrt(half * half + square * force)) / square)
        return float(-np.sqrt(-force / square))
    if record.kind == CURVE:
        curve = record.curve
        if force == 0.0:
            return 0.0
        for i in range(record.points - 1):
            if curve[i, 1] <= force <= curve[i + 1, 1] and curve[i, 1] < curve[i + 1, 1]:
                share = (force - curve[i, 1]) / (curve[i + 1, 1] - curve[i, 1])
                return float(curve[i, 0] + share * (curve[i + 1, 0] - curve[i, 0]))
        return float(curve[0, 0]) if force < 0.0 else float(curve[record.points - 1, 0])
    return force


def scaled_records(
    records: npt.NDArray[np.void], setups: Sequence[VehicleSetup]
) -> npt.NDArray[np.void]:
    """What effectors really give whose MJCF is not quite right: records of `read` with the
    setups' scales applied.
    """
    true = records.copy()
    for row, setup in zip(true, setups, strict=True):
        kind = row["kind"]
        thrust_scale = setup.settings.thrust_scale
        row["parameters"][kind == FIN, 1] *= setup.settings.lift_scale
        row["parameters"][kind == PROPELLER, 1:3] *= thrust_scale
        row["curve"][..., 1] *= thrust_scale
        row["force"][kind == THRUSTER] *= thrust_scale
        row["torque"][kind == THRUSTER] *= thrust_scale
    true.flags.writeable = False
    return true


def unit_wrenches(records: npt.NDArray[np.void]) -> Floats:
    """Force and torque about the body's origin of a unit of force along the axis, in the body,
    shape (v, m, 6).
    """
    return np.concatenate([records["force"], records["torque"]], axis=-1)
