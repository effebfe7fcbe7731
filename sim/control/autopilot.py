"""Autopilot: from heading, speed and depth wanted to a wrench, and by allocation to commands, ten
times a second.

PID by pole placement with feedforward of the reference (Fossen, Handbook of Marine Craft
Hydrodynamics and Motion Control, 2nd ed. 2021). The bandwidth of the attitude loops is ω = 1 / (4 ×
lag of the slowest effector that turns the hull, 0.3 s or more), of roll likewise by those that roll
it. All others follow:

    heading, pitch    ω, relative damping 1; integral ω/10
    roll              ω, relative damping 1, beside the hull's own righting moment; integral ω/10
    sway              side slip is taken out with ω/2, so that the vehicle goes where it points,
                      also in turns
    speed             ω/2; integral ω/10
    depth             ω/5 through pitch, integral ω/20; ω/2 through heave, integral ω/10

By pitch, the hull climbs and dives, and takes the incidence whose lift holds its depth; what it
cannot lift, and all of it when it is slow, vertical thrusters carry, where it has them. By thrust,
they carry all. Roll is held at zero by what the other components leave of the effectors' limits, if
these have the authority or `roll_control` says so. Integrals stand still while limits withhold
their part of the wrench and they would push further (conditional integration).

Functions take `d`, the design of an autopilot, a record of AUTOPILOT; `memory`, of
AUTOPILOT_MEMORY; and `reference`, of `sim.control.guidance`.
"""

from functools import partial
from typing import Annotated, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, RecordFields, Records, row_dtype
from laisn.compiled import compiled, select
from laisn.errors import LaisnError
from laisn.geometry import wrap_angle
from laisn.vector_math import arcsin, arctan2, sin_cos
from sim.attitude import Pose, Twist, Vector, rotation, transposed
from sim.control.allocation import (
    FULL_STEERAGE_SPEED,
    HEAVE,
    PITCH,
    ROLL,
    SURGE,
    SWAY,
    YAW,
    add_roll,
    allocate,
    clip,
    given_components,
    greatest_roll,
    pseudo_inverse,
    pseudo_inverse_at,
)
from sim.control.guidance import Reference
from sim.vehicle import effectors
from sim.vehicle.effector_kinds import EFFECTOR, MAX_EFFECTORS, MIN_STEERAGE_SPEED
from sim.vehicle.hydrodynamics import linear_share
from sim.vehicle.mjcf import inertia_tensor
from sim.vehicle.plant import Plant

DepthControl = Literal["pitch", "thrust"]
RollControl = Literal["hold", "free"]


class AutopilotMemory(RecordFields):
    """Memory of the autopilot of one vehicle, from one control step to the next."""

    heading_integral: float  # [N m]
    speed_integral: float  # [N]
    pitch_integral: float  # [N m]
    depth_integral: float  # [N]
    roll_integral: float  # [N m]
    pitch_command: float  # [rad]
    # room for what a control step computes
    wrench: Annotated[Floats, (6,)]
    limits: Annotated[Floats, (MAX_EFFECTORS, 2)]
    allocation: Annotated[Floats, (MAX_EFFECTORS, 6)]


AUTOPILOT_MEMORY = row_dtype(AutopilotMemory)


CLIMB_MAX = float(np.deg2rad(20.0))  # steepest climb and dive [rad]
_SIN_CLIMB_MAX = float(np.sin(CLIMB_MAX))
# most incidence used for lift [rad]; hulls of this kind stall soon after
INCIDENCE_MAX = float(np.deg2rad(12.0))
PITCH_RATE_MAX = float(np.deg2rad(5.0))  # largest rate of the pitch command [rad/s]
# effectors that follow faster make the loops no faster, which run ten times a second [s]
MIN_LAG = 0.3
# below SPEED_HEAVE vertical thrusters alone hold depth, above SPEED_PITCH the hull alone; shared
# between [m/s]
SPEED_HEAVE = 0.3
SPEED_PITCH = 0.6
# roll is held by default where effectors give, at `MIN_STEERAGE_SPEED`, the moment that heels the
# hull by this angle [rad] (an assumption): the fins of a LAUV, which hold roll at sea, give that of
# 4.5°, those of a REMUS 100, which are driven in pairs, would give that of 0.9°
HELD_HEEL = float(np.deg2rad(1.5))
_MIN_VERTICAL = float(np.sqrt(0.5))  # vertical part of the direction of a vertical thruster, 45°


class Autopilot(RecordFields):
    """Parameters of the autopilot of one vehicle; rows beyond its effectors are zero."""

    omega: float  # bandwidth of the attitude loops [rad/s]
    roll_omega: float  # of roll [rad/s]
    # masses and inertias include the added ones
    surge_mass: float  # [kg]
    sway_mass: float
    heave_mass: float
    roll_inertia: float  # [kg m²]
    pitch_inertia: float
    yaw_inertia: float
    # righting moment of weight and buoyancy per pitch, and per sine of the heel [N m/rad]
    righting: float
    # drag of surge at u: (drag_linear exp(−drag_fade |u|) + drag |u|) u
    drag_linear: float  # [N s/m]
    drag_fade: float  # [s/m]
    drag: float  # [N s²/m²]
    lift: float  # vertical force per incidence and speed² [N s²/m² per rad]
    fin_side: float  # side force of the fins per turn rate and speed [N s²/m per rad]
    # damping moment over the rate: constant [N m s/rad], per speed [N s²/rad], per rate
    # [N m s²/rad²], as of `_damping`
    yaw_damping: Annotated[Floats, (3,)]
    pitch_damping: Annotated[Floats, (3,)]
    # nose-up moment per (downward speed · forward speed), as far as fins do not outweigh it [kg]
    pitch_munk: float
    # yaw moment per heading error and speed² [kg]: Munk moment that fins do not outweigh, times
    # surge_mass / sway_mass, the slip per angle that is turned as a turn begins
    yaw_munk: float
    by_pitch: float  # 1: depth by pitch, 0: by thrust
    has_heave: float  # 1: vertical thrusters, 0: depth by pitch at any speed
    density: float  # [kg/m³]
    scheduled: bool  # whether the allocation depends on the speed, as with fins
    holds_roll: bool  # whether roll is held at zero; else it is left to the hull
    effectors: Annotated[Records, EFFECTOR, (MAX_EFFECTORS,)]
    # forces per unit of a wrench, at `MIN_STEERAGE_SPEED` and at `allocation.FULL_STEERAGE_SPEED`
    slow_allocation: Annotated[Floats, (MAX_EFFECTORS, 6)]
    fast_allocation: Annotated[Floats, (MAX_EFFECTORS, 6)]


AUTOPILOT = row_dtype(Autopilot)


def design(plant: Plant, depth_control: tuple[DepthControl | None, ...]) -> npt.NDArray[np.void]:
    """Autopilots of all vehicles, from their MJCF as the plant has compiled it: records of
    AUTOPILOT, shape (v,).

    A vehicle without `depth_control` holds its depth by pitch if its hull or fins lift or it has no
    vertical thrusters, else by thrust. One whose settings have no `roll_control` holds roll if its
    effectors can at `HELD_HEEL`. LaisnError if its effectors or hull lack what its autopilot needs;
    the text names it.
    """
    model = plant.model
    masses = (model.body_mass, model.body_ipos, model.body_inertia, model.body_iquat)
    roll_control = tuple(setup.settings.roll_control for setup in plant.setups)
    cache_key = (depth_control, roll_control, *(values.tobytes() for values in masses))
    return plant.kept_design(cache_key, partial(_design, plant, depth_control, roll_control))


def _has_vertical_thrusters(fitted: npt.NDArray[np.void]) -> bool:
    """Whether effectors other than fins push more up or down than along or across."""
    thrusters = fitted[fitted["lift_area"] == 0.0]
    return bool(np.any(np.abs(thrusters["force"][:, 2]) > _MIN_VERTICAL))


def _design(
    plant: Plant,
    depth_control: tuple[DepthControl | None, ...],
    roll_control: tuple[RollControl | None, ...],
) -> npt.NDArray[np.void]:
    model = plant.model
    records = np.zeros(len(plant.names), AUTOPILOT)
    allocations = dict[tuple[bytes, bool], list[Floats]]()
    for i, (record, c, name) in enumerate(
        zip(records, plant.coefficients, plant.names, strict=True)
    ):
        body = model.body(f"{name}/hull")
        mass = float(body.mass[0])
        added = np.diag(c["added_mass"])
        centre = body.ipos
        fitted = effectors.as_allocated(plant.effectors[i, : len(plant.effector_names[i])])
        area, drag_coefficient, lift_slope = c["hull_lift"]
        fins = effectors.fins_of(fitted, plant.fixed_fins[i])
        # force per incidence and speed², sideways and up, of each fin
        per_fin = 0.5 * c["density"] * fins["lift_area"][:, None] * fins["force"][:, 1:] ** 2
        record["lift"] = (
            0.5 * c["density"] * area * lift_slope * c["hull_lift_planes"][1] + per_fin[:, 1].sum()
        )
        has_lift = record["lift"] > 0.0
        slow_limits, fast_limits = (
            effectors.force_limits_of(fitted, c["density"], speed)
            for speed in (MIN_STEERAGE_SPEED, FULL_STEERAGE_SPEED)
        )
        by_thrust = (depth_control[i] or ("pitch" if has_lift else "thrust")) == "thrust"
        # of effectors that give either pitch or heave, what holds the depth; fins only pitch
        heave_first = by_thrust and _has_vertical_thrusters(fitted)
        allocation_key = (fitted.tobytes(), heave_first)
        if allocation_key not in allocations:
            # fins give what they give with way
            components = given_components(fitted, fast_limits, heave_first=heave_first)
            allocations[allocation_key] = [
                pseudo_inverse(fitted, limits, components) for limits in (slow_limits, fast_limits)
            ]
        slow, fast = allocations[allocation_key]
        turns_hull = slow[:, [PITCH, YAW]].any(axis=1)
        record["omega"] = _bandwidth(fitted["lag"][turns_hull])
        record["roll_omega"] = _bandwidth(fitted["lag"][slow[:, ROLL] != 0.0])
        record["surge_mass"], record["sway_mass"], record["heave_mass"] = mass + added[:3]
        inertia = inertia_tensor(model, body.id)
        record["roll_inertia"] = inertia[0, 0] + mass * (centre[1] ** 2 + centre[2] ** 2) + added[3]
        record["pitch_inertia"] = (
            inertia[1, 1] + mass * (centre[0] ** 2 + centre[2] ** 2) + added[4]
        )
        record["yaw_inertia"] = inertia[2, 2] + mass * (centre[0] ** 2 + centre[1] ** 2) + added[5]
        # weight and buoyancy, each at its centre
        record["righting"] = (
            -mass * c["gravity"] * centre[2] + c["buoyancy"] * c["buoyancy_centre"][2]
        )
        record["drag_linear"] = c["linear_damping"][0]
        record["drag_fade"] = c["linear_damping_fade"][0]
        record["drag"] = 0.5 * c["density"] * area * drag_coefficient + c["quadratic_damping"][0]
        fin_moments = per_fin.T @ fins["place"][:, 0]
        record["fin_side"] = -fin_moments[0]
        record["pitch_munk"] = max(c["munk_factor"] * (added[2] - added[0]) + fin_moments[1], 0.0)
        yaw_munk = max(c["munk_factor"] * (added[1] - added[0]) + fin_moments[0], 0.0)
        record["yaw_munk"] = yaw_munk * record["surge_mass"] / record["sway_mass"]
        if not c["linear_damping_fade"][2]:
            # heave damping that does not fade acts as lift per incidence, D·u·α: taken as D·u²·α,
            # right at 1 m/s
            record["lift"] += c["linear_damping"][2]
        strips = 0.5 * c["density"] * np.sum(c["strip_area"] * np.abs(c["strip_x"]) ** 3)
        for turning, axis in enumerate(("pitch", "yaw")):
            # coefficients are those sideways and upward, in this order: pitch is by those upward
            direction = 1 - turning
            cross_flow_damping = (
                strips * c["cross_flow_drag"][direction] + c["quadratic_damping"][4 + turning]
            )
            fin_damping = per_fin[:, direction] @ fins["place"][:, 0] ** 2
            record[f"{axis}_damping"] = (
                c["linear_damping"][4 + turning],
                fin_damping,
                cross_flow_damping,
            )
        record["has_heave"] = float(slow[:, HEAVE].any())
        mode = depth_control[i] or ("pitch" if has_lift or not record["has_heave"] else "thrust")
        record["by_pitch"] = float(mode == "pitch")
        record["density"] = c["density"]
        record["effectors"][: fitted.size] = fitted
        record["slow_allocation"][: fitted.size] = slow
        record["fast_allocation"][: fitted.size] = fast
        record["scheduled"] = not np.array_equal(slow, fast)
        record["holds_roll"] = _holds_roll(record, fitted, roll_control[i])
        _require_control(name, record, mode)
    records.flags.writeable = False
    return records


def _bandwidth(lags: Floats) -> float:
    """Bandwidth of loops whose effectors have these lags [rad/s]."""
    return 1.0 / (4.0 * max(float(lags.max(initial=0.0)), MIN_LAG))


def _holds_roll(
    record: np.void, fitted: npt.NDArray[np.void], roll_control: RollControl | None
) -> bool:
    """Whether an autopilot, with its allocation and its righting moment, holds roll."""
    if roll_control is not None:
        return roll_control == "hold"
    limits = effectors.force_limits_of(fitted, float(record["density"]), MIN_STEERAGE_SPEED)
    attainable = greatest_roll(record["slow_allocation"][: fitted.size], limits)
    heeling = abs(float(record["righting"])) * np.sin(HELD_HEEL)
    return bool(attainable > 0.0 and attainable >= heeling)


def can_roll(d: Autopilot | np.void) -> bool:
    """Whether the effectors give a moment of roll without changing the other components."""
    return bool(d["slow_allocation"][:, ROLL].any())


def _require_control(name: str, record: np.void, mode: DepthControl) -> None:
    """LaisnError naming the demands of the autopilot that a vehicle cannot meet."""
    demands = {"surge": SURGE, "yaw": YAW} | (
        {"pitch": PITCH} if mode == "pitch" else {"heave": HEAVE}
    )
    missing = [
        axis for axis, column in demands.items() if not record["slow_allocation"][:, column].any()
    ]
    if missing:
        raise LaisnError(
            f"{name}: the effectors cannot give {' and '.join(missing)} independently of the other "
            f"components that depth_control = {mode!r} needs ({', '.join(demands)})"
        )
    if record["holds_roll"] and not can_roll(record):
        raise LaisnError(
            f"{name}: roll_control = 'hold' needs effectors that give a moment of roll "
            "independently of the other components, such as two vertical thrusters side by side or "
            "four moving fins"
        )
    if mode == "pitch" and not record["lift"] > 0.0:
        raise LaisnError(
            f"{name}: depth_control = 'pitch' needs vertical lift of the hull or of level fins "
            "(hull_lift, "
            "hull_lift_planes, NAME.fin); set depth_control = 'thrust' or give the hull lift"
        )


@compiled
def _greatest_forces(
    kinds: effectors.Kinds,
    d: Autopilot,
    speeds: Floats,
    axis: int,
    side: float,
    memory: AutopilotMemory,
) -> tuple[Floats, Floats]:
    """`greatest_forces` at speeds of shape (n,), shapes (n,) and (n, MAX_EFFECTORS)."""
    components = np.empty(speeds.size)
    forces = np.zeros((speeds.size, MAX_EFFECTORS))
    for k in range(speeds.size):
        limits = memory.limits
        for i in range(MAX_EFFECTORS):
            limits[i, 0], limits[i, 1] = effectors.force_limits(
                kinds, d.effectors[i], d.density, speeds[k]
            )
        wrench = memory.wrench
        for i in range(6):
            wrench[i] = 0.0
        wrench[axis] = side * 1e6
        pseudo_inverse_at(d.slow_allocation, d.fast_allocation, speeds[k], memory.allocation)
        allocate(memory.allocation, limits, wrench, forces[k])
        components[k] = wrench[axis]
    return components, forces


def _forces_at(d: Autopilot, speeds: Floats, axis: int, side: float) -> tuple[Floats, Floats]:
    kinds = effectors.kinds_of(d["effectors"])
    return _greatest_forces(kinds, d, speeds, axis, side, np.zeros(1, AUTOPILOT_MEMORY)[0])


def greatest_forces(
    d: Autopilot, speed: float, axis: int, side: float = 1.0
) -> tuple[float, Floats]:
    """Largest component of a wrench that the effectors give at a speed, to one side (1 or -1), [N]
    or [N m], and their forces for it [N].
    """
    components, forces = _forces_at(d, np.array([speed]), axis, side)
    return float(components[0]), forces[0]


def top_speed(d: Autopilot) -> float:
    """Speed at which all thrust ahead balances the drag of surge [m/s], 10 at most."""
    speeds = np.arange(0.0, 10.0, 0.02)
    thrust, _ = _forces_at(d, speeds, SURGE, 1.0)
    drag = (d["drag_linear"] * np.exp(-d["drag_fade"] * speeds) + d["drag"] * speeds) * speeds
    return float(speeds[np.argmax(thrust < drag)] if (thrust < drag).any() else speeds[-1])


@compiled
def _damping(coefficients: Floats, speed: float, rate: float) -> float:
    """Moment that holds a rate of turn or of pitch at a speed [N m]."""
    moment: float = (coefficients[0] + coefficients[1] * speed + coefficients[2] * abs(rate)) * rate
    return moment


@compiled
def _increment(increment: float, demanded: float, achieved: float) -> float:
    """`increment`, or 0 where it would drive an integral further beyond what the effectors give:
    `demanded` and `achieved` are the component of the wrench before and after allocation.
    """
    too_high = (increment > 0.0) & (demanded > achieved + 1e-9)
    too_low = (increment < 0.0) & (demanded < achieved - 1e-9)
    return float(select(too_high | too_low, 0.0, increment))


@compiled
def _hold_depth(
    d: Autopilot,
    reference: Reference,
    depth: float,
    sinking: float,
    speed: float,
    dt: float,
    memory: AutopilotMemory,
) -> tuple[float, float, float, float]:
    """Pitch wanted [rad] and its rate [rad/s], heave force wanted, upward [N], and what is added to
    the depth integral in this step [N].
    """
    share = clip((speed - SPEED_HEAVE) / (SPEED_PITCH - SPEED_HEAVE), 0.0, 1.0)
    by_pitch = d.by_pitch * select(d.has_heave > 0.0, share, 1.0)
    speed = max(speed, SPEED_HEAVE)
    height_error = reference.depth - depth  # positive where the vehicle is too high

    # through pitch: the angle of climb, and the incidence whose lift the integral demands
    lift_slope = d.lift * speed * speed
    uses_pitch = by_pitch > 0.0
    incidence_wanted = by_pitch * memory.depth_integral / select(uses_pitch, lift_slope, 1.0)
    incidence = select(uses_pitch, clip(incidence_wanted, -INCIDENCE_MAX, INCIDENCE_MAX), 0.0)
    max_sink_rate = speed * _SIN_CLIMB_MAX
    depth_by_pitch_bandwidth = d.omega / 5.0
    sink_rate = reference.sinking + depth_by_pitch_bandwidth * height_error
    climb = -arcsin(clip(sink_rate, -max_sink_rate, max_sink_rate) / speed)
    last_command = memory.pitch_command
    step = PITCH_RATE_MAX * dt
    memory.pitch_command += clip(by_pitch * climb + incidence - last_command, -step, step)

    # through heave, force downward: a level hull that sinks is held back by its lift
    depth_by_heave_bandwidth = d.omega / 2.0
    heave_demand = d.heave_mass * (
        depth_by_heave_bandwidth * depth_by_heave_bandwidth * height_error
        + 2.0 * depth_by_heave_bandwidth * (reference.sinking - sinking)
    )
    heave_demand += d.lift * speed * reference.sinking
    force = memory.depth_integral - incidence * lift_slope - (1.0 - by_pitch) * heave_demand

    gain = (
        by_pitch * 0.25 * depth_by_pitch_bandwidth * depth_by_pitch_bandwidth * d.lift * speed
        + (1.0 - by_pitch)
        * 0.2
        * d.heave_mass
        * (depth_by_heave_bandwidth * depth_by_heave_bandwidth * depth_by_heave_bandwidth)
    )
    # a depth far away is a matter of climbing, not of lift
    is_near = by_pitch * abs(sink_rate) < max_sink_rate
    depth_increment = select(is_near, -gain * height_error * dt, 0.0)
    return memory.pitch_command, (memory.pitch_command - last_command) / dt, force, depth_increment


class HullMotion(NamedTuple):
    """Motion of a vehicle, measured or true."""

    surge: float  # speed through the water along the hull [m/s]
    sway: float  # speed through the water to port [m/s]; 0 where nothing measures it
    heading: float  # [rad]
    turning: float  # rate of turn about the hull's upward axis, positive to port [rad/s]
    pitch: float  # positive nose up [rad]
    pitching: float  # rate of turn about the hull's port axis, positive nose down [rad/s]
    # sine of the heel, the angle of the port axis above the level, positive starboard down; 0 where
    # roll is not held and nothing measures it, as the next one
    heel: float
    rolling: float  # rate of turn about the hull's forward axis, positive starboard down [rad/s]
    depth: float  # [m]
    sinking: float  # [m/s]


@compiled
def true_motion(pose: Pose, twist: Twist, water: Vector | Floats) -> HullMotion:
    """True motion of a vehicle, from rows of `sim.trajectory.StateHistory`."""
    forward, port, _ = transposed(rotation(pose[3:7]))
    flow = (twist[0] - water[0], twist[1] - water[1], twist[2] - water[2])
    surge = flow[0] * forward[0] + flow[1] * forward[1] + flow[2] * forward[2]
    sway = flow[0] * port[0] + flow[1] * port[1] + flow[2] * port[2]
    heading = arctan2(forward[0], forward[1])
    pitch = arcsin(clip(forward[2], -1.0, 1.0))
    return HullMotion(
        surge,
        sway,
        heading,
        twist[5],
        pitch,
        twist[4],
        port[2],
        twist[3],
        -pose[2],
        -twist[2],
    )


@compiled
def _allocate_forces(
    kinds: effectors.Kinds, d: Autopilot, surge: float, memory: AutopilotMemory, command: Floats
) -> None:
    """Write forces that give `memory.wrench`, but for its roll, at a speed through the water [m/s];
    `memory.wrench` becomes what the effectors really give.
    """
    limits = memory.limits
    for i in range(command.shape[0]):
        limits[i, 0], limits[i, 1] = effectors.force_limits(kinds, d.effectors[i], d.density, surge)
    if d.scheduled:
        pseudo_inverse_at(d.slow_allocation, d.fast_allocation, surge, memory.allocation)
        allocate(memory.allocation, limits, memory.wrench, command)
    else:
        allocate(d.slow_allocation, limits, memory.wrench, command)


@compiled
def _give_roll(d: Autopilot, roll: float, memory: AutopilotMemory, command: Floats) -> None:
    """Add to forces of `_allocate_forces` what gives a moment of roll [N m], as far as limits
    allow; `memory.wrench` has what they really give.
    """
    if d.scheduled:
        given = add_roll(memory.allocation, memory.limits, d.effectors, roll, command)
    else:
        given = add_roll(d.slow_allocation, memory.limits, d.effectors, roll, command)
    memory.wrench[ROLL] = given


@compiled
def _write_states(kinds: effectors.Kinds, d: Autopilot, surge: float, command: Floats) -> None:
    """Turn forces into the states that give them."""
    for i in range(command.shape[0]):
        command[i] = effectors.state_for(kinds, d.effectors[i], d.density, command[i], surge)


@compiled
def apply_wrench(
    kinds: effectors.Kinds, d: Autopilot, surge: float, memory: AutopilotMemory, command: Floats
) -> None:
    """Write commands that give `memory.wrench`, all its six components, at a speed through the
    water [m/s]; `memory.wrench` becomes what the effectors really give.

    Roll comes last: it gets what the other components leave of the effectors' limits.
    """
    roll = memory.wrench[ROLL]
    _allocate_forces(kinds, d, surge, memory, command)
    _give_roll(d, roll, memory, command)
    _write_states(kinds, d, surge, command)


@compiled
def _hold_roll(
    d: Autopilot, motion: HullMotion, dt: float, memory: AutopilotMemory, command: Floats
) -> None:
    """Add to forces of `_allocate_forces` what brings roll to zero, and bring its integral forward.

    K = −I_x (ω² sin φ + 2 ω p) + integral, beside the hull's own −k sin φ; the integral takes out
    what I_x ω² + k leaves of a constant moment, with a time constant of 10/ω.
    """
    omega = d.roll_omega
    stiffness = d.roll_inertia * omega * omega
    roll_moment = (
        memory.roll_integral
        - stiffness * motion.heel
        - 2.0 * d.roll_inertia * omega * motion.rolling
    )
    _give_roll(d, roll_moment, memory, command)
    # a hull that does not right itself is held by the stiffness of the law alone
    held_stiffness = stiffness + max(d.righting, 0.0)
    memory.roll_integral += _increment(
        -0.1 * omega * held_stiffness * motion.heel * dt, roll_moment, memory.wrench[ROLL]
    )


@compiled
def control(
    kinds: effectors.Kinds,
    d: Autopilot,
    steering: tuple[float, float, float],
    reference: Reference,
    motion: HullMotion,
    dt: float,
    memory: AutopilotMemory,
    command: Floats,
) -> None:
    """Commands of one vehicle's effectors.

    Args:
        kinds: of effectors, to which the records of `d.effectors` refer by number, as of
            `sim.vehicle.effectors.kinds_of`.
        steering: heading [rad], its rate [rad/s], speed through the water [m/s], as of `steer`.
        reference: accelerations, depth and sinking are read.
        motion: how the vehicle moves.
        dt: time since the last call [s].
        memory: brought forward.
        command: out: in the units of the effectors' states, shape (m,).
    """
    heading_wanted, turn_wanted, speed_wanted = steering
    surge = motion.surge
    sway = motion.sway
    heading = motion.heading
    pitch = motion.pitch
    speed = abs(surge)
    omega = d.omega
    lag = 0.25 / omega  # as of the module: ω = 1 / (4 · lag)

    # X = m_u (a_r + ½ ω (u_r − u)) + integral + D(u). With the hull pitched, its way over ground is
    # shorter than its way through the water. Drag, here and below, is that of when the thrusters
    # will have followed
    sin_pitch, cos_pitch = sin_cos(pitch)
    cos_pitch = max(cos_pitch, 0.5)
    speed_error = speed_wanted / cos_pitch - surge
    speed_after_lag = speed_wanted / cos_pitch + lag * reference.acceleration
    thrust = (
        d.surge_mass * (reference.acceleration + 0.5 * omega * speed_error) + memory.speed_integral
    )
    thrust += (
        d.drag_linear * linear_share(d.drag_fade, abs(speed_after_lag))
        + d.drag * abs(speed_after_lag)
    ) * speed_after_lag

    # N = −I_z (α_r + ω² (ψ_d − ψ) + 2 ω (r_d − r)) − slip + integral − D(r_d) and
    # Y = −(m_u u − F |u|) r_d − ½ m_v ω v; moments to port are positive, turns to port are negative
    turn_after_lag = turn_wanted + lag * reference.turn_acceleration
    heading_error = wrap_angle(heading_wanted - heading)
    turn_moment = -d.yaw_inertia * (
        reference.turn_acceleration
        + omega * omega * heading_error
        + 2.0 * omega * (turn_wanted + motion.turning)
    )
    # a short hull whose slip turns it away is held more firmly, the faster it is
    slip_stiffness = d.yaw_munk * surge * surge
    turn_moment -= slip_stiffness * heading_error
    turn_moment -= np.sqrt(slip_stiffness * d.yaw_inertia) * (turn_wanted + motion.turning)
    turn_moment += memory.heading_integral - _damping(d.yaw_damping, speed, turn_after_lag)
    sway_force = (
        d.surge_mass * surge - d.fin_side * speed
    ) * -turn_after_lag - d.sway_mass * 0.5 * omega * sway

    # M = I_y (ω² (θ_d − θ) + 2 ω (q_d − q)) − Munk + integral + k θ_d + D(q_d); moments nose up are
    # positive here, and negative about the body's axis to port
    pitch_wanted, pitch_rate_wanted, heave_force, depth_increment = _hold_depth(
        d, reference, motion.depth, motion.sinking, speed, dt, memory
    )
    pitch_error = pitch_wanted - pitch
    pitch_moment = d.pitch_inertia * (
        omega * omega * pitch_error + 2.0 * omega * (pitch_rate_wanted + motion.pitching)
    )
    # the Munk moment that fins leave, by the speed across the hull
    pitch_moment -= d.pitch_munk * surge * (motion.sinking + surge * sin_pitch) / cos_pitch
    pitch_moment += (
        memory.pitch_integral
        + d.righting * pitch_wanted
        + _damping(d.pitch_damping, speed, pitch_rate_wanted)
    )

    wrench = memory.wrench
    wrench[ROLL] = 0.0
    wrench[SURGE] = thrust
    wrench[SWAY] = sway_force
    wrench[HEAVE] = heave_force
    wrench[PITCH] = -pitch_moment
    wrench[YAW] = turn_moment
    _allocate_forces(kinds, d, surge, memory, command)
    if d.holds_roll:
        # after the other components, whose own moments of roll are taken back
        _hold_roll(d, motion, dt, memory, command)
    _write_states(kinds, d, surge, command)
    omega_cubed = omega * omega * omega
    memory.speed_integral += _increment(
        d.surge_mass * 0.05 * omega * omega * speed_error * dt, thrust, wrench[SURGE]
    )
    memory.heading_integral += _increment(
        -0.1 * d.yaw_inertia * omega_cubed * heading_error * dt, turn_moment, wrench[YAW]
    )
    memory.pitch_integral += _increment(
        0.1 * d.pitch_inertia * omega_cubed * pitch_error * dt, pitch_moment, -wrench[PITCH]
    )
    memory.depth_integral += _increment(depth_increment, heave_force, wrench[HEAVE])
