"""Whether an autopilot stabilises its hull: eigenvalues of the motion about a straight course,
speed by speed.

The forces are those of `sim.vehicle.hydrodynamics`, with the true coefficients, those of the MJCF
times `drag_scale`, `added_mass_scale` and the like, linearised by differences; effectors follow the
linear law of the autopilot, designed for the MJCF's coefficients, with their lag. Limits of
effectors and the slow loops (integrals, depth through pitch) are left out.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.errors import LaisnError
from sim.attitude import Vector, cross, matvec, minus, plus, transposed
from sim.control.allocation import HEAVE, PITCH, ROLL, SURGE, SWAY, YAW, pseudo_inverse_at
from sim.control.autopilot import SPEED_HEAVE, SPEED_PITCH, Autopilot, greatest_forces, top_speed
from sim.control.guidance import CATCH_UP, PLANNED_TURN_SHARE
from sim.scenario.point_motion import SPEED_MIN, TURN_RATE
from sim.scenario.routes import START_SPEED
from sim.scenario.section import CONTROL_STEP_S
from sim.vehicle.effectors import Fitted, kinds_of, states_for, unit_wrenches
from sim.vehicle.hydrodynamics import wrench
from sim.vehicle.mjcf import Coefficients, inertia_tensor
from sim.vehicle.plant import Plant
from sim.vehicle.solvers import matrix_times
from sim.water.environment import SeaInstant, sea_at
from sim.water.ocean import Ocean

_SPEED_STEP = 0.25  # speeds are looked at in such steps, from the slowest of a mission [m/s]
_TOLERATED_GROWTH = 0.02  # slower growth is left to the loops that are left out [1/s]
_CATCH_UP_FACTOR = 1.0 + CATCH_UP  # largest commanded speed as a multiple of the speed of a route
_ROUNDING = 1e-6  # of rates of growth [1/s]
# sway and heave, and roll, pitch and yaw rates of a brisk turn
_TURN_SWAY_HEAVE_M_S = (0.3, 0.3)
_TURN_RATES_RAD_S = (0.2, 0.2, 0.2)
_DIFFERENCE_STEP = 1e-4  # of velocities and angles, for derivatives [m/s], [rad/s], [rad]
# a mode swings if the imaginary part of its eigenvalue is so many times the real part
_SWING_RATIO = 5.0
# roll, pitch and yaw rates of a slow swing
_SWING_RATES_RAD_S = (0.05, 0.05, 0.05)
# physics steps that are advised are this share of the longest possible one
_STEP_RESERVE = 0.8
SHORTEST_STEP_S = 1e-4
HEIGHT = 9  # place of the height among velocities (0 to 5) and angles (6 to 8)


def _skew(a: Floats) -> Floats:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@compiled
def _forces(
    c: Coefficients,
    rigid: Floats,
    centre: Vector,
    states: Floats,
    sea: SeaInstant,
    fitted: Fitted,
) -> Floats:
    """Wrenches of water, weight and inertia in the body, shape (n, 6), [N] and [N m].

    `rigid` is the rigid body's inertia about the origin, shape (6, 6), `centre` its centre of
    gravity [m]. `states` are velocities (6) and small angles about the body's axes (3), shape
    (n, 9), [m/s], [rad/s], [rad].
    """
    out = np.empty((states.shape[0], 6))
    for k in range(states.shape[0]):
        velocity = (states[k, 0], states[k, 1], states[k, 2])
        spin = (states[k, 3], states[k, 4], states[k, 5])
        x = states[k, 6]
        y = states[k, 7]
        z = states[k, 8]
        # I + S + S S / 2, with S the matrix of the cross product with the angles
        to_world = (
            (1.0 - 0.5 * (y * y + z * z), 0.5 * x * y - z, 0.5 * x * z + y),
            (0.5 * x * y + z, 1.0 - 0.5 * (x * x + z * z), 0.5 * y * z - x),
            (0.5 * x * z - y, 0.5 * y * z + x, 1.0 - 0.5 * (x * x + y * y)),
        )
        to_body = transposed(to_world)
        scalar = np.sqrt(1.0 - 0.25 * (x * x + y * y + z * z))
        pose = (0.0, 0.0, -10.0, scalar, 0.5 * x, 0.5 * y, 0.5 * z)
        over_ground = matvec(to_world, velocity)
        force, moment, _ = wrench(c, pose, over_ground + spin, sea, fitted, 0)
        weight = matvec(to_body, (0.0, 0.0, -rigid[0, 0] * c.gravity))
        momentum, angular = matrix_times(rigid, velocity, spin)
        # f = f_w + Rᵀ m g − ω × p and n = n_w + r × Rᵀ m g − ω × l − v × p, with p and l the rigid
        # body's momentum and angular momentum.
        # `wrench` adds what the solver needs of added mass in the world's frame, which is not
        # accelerated here
        added_inertia = matrix_times(c.added_mass, cross(spin, velocity), (0.0, 0.0, 0.0))
        net_force = plus(matvec(to_body, force), weight)
        net_force = minus(minus(net_force, cross(spin, momentum)), added_inertia[0])
        net_moment = plus(moment, cross(centre, weight))
        net_moment = minus(minus(net_moment, cross(spin, angular)), cross(velocity, momentum))
        net_moment = minus(net_moment, added_inertia[1])
        for j in range(3):
            out[k, j] = net_force[j]
            out[k, 3 + j] = net_moment[j]
    return out


def _feedback(d: Autopilot, climb: Floats, speed: Floats) -> Floats:
    """Linear law of the autopilot at speeds of shape (n,): the wrench that it commands per
    velocities (6), angles (3) and height, shape (n, 6, 10). `climb` is the rate of climb per each
    of the same, shape (n, 10).
    """
    feedback = np.zeros((speed.size, 6, 10))
    omega = d["omega"]
    thruster_share = 1.0 - d["by_pitch"] * np.clip(
        (speed - SPEED_HEAVE) / (SPEED_PITCH - SPEED_HEAVE), 0.0, 1.0
    )
    thruster_share *= d["has_heave"]
    feedback[:, SURGE, SURGE] = -0.5 * omega * d["surge_mass"]
    feedback[:, SWAY, SWAY] = -0.5 * omega * d["sway_mass"]
    for axis, inertia in ((PITCH, d["pitch_inertia"]), (YAW, d["yaw_inertia"])):
        feedback[:, axis, axis] = -2.0 * omega * inertia
        feedback[:, axis, axis + 3] = -omega * omega * inertia
    if d["holds_roll"]:
        roll_omega = d["roll_omega"]
        feedback[:, ROLL, ROLL] = -2.0 * roll_omega * d["roll_inertia"]
        feedback[:, ROLL, ROLL + 3] = -roll_omega * roll_omega * d["roll_inertia"]
    slip_stiffness = d["yaw_munk"] * speed**2
    feedback[:, YAW, YAW] -= np.sqrt(slip_stiffness * d["yaw_inertia"])
    feedback[:, YAW, YAW + 3] -= slip_stiffness
    feedback[:, PITCH, HEAVE] = -d["pitch_munk"] * speed
    feedback[:, HEAVE] = (-omega * thruster_share * d["heave_mass"])[:, None] * climb
    feedback[:, HEAVE, HEIGHT] = -0.25 * omega * omega * thruster_share * d["heave_mass"]
    return feedback


def _rigid_body(plant: Plant, i: int) -> tuple[Floats, Vector]:
    """Rigid inertia (6×6) about the origin, and centre of gravity of vehicle i."""
    body = plant.model.body(f"{plant.names[i]}/hull")
    mass = float(body.mass[0])
    centre = np.array(body.ipos)
    arm = mass * _skew(centre)
    inertia = inertia_tensor(plant.model, body.id)
    rigid = np.zeros((6, 6))
    rigid[:3, :3] = mass * np.eye(3)
    rigid[:3, 3:] = -arm
    rigid[3:, :3] = arm
    rigid[3:, 3:] = inertia - arm @ _skew(centre)
    return rigid, (float(centre[0]), float(centre[1]), float(centre[2]))


def steady_turn(plant: Plant, i: int, d: Autopilot, speed: float) -> tuple[float, float]:
    """Largest rate of turn of vehicle i in calm water at a speed along the hull [rad/s], and the
    turn's radius [m].

    Sway and yaw balance the effectors; without a balance the rate is infinite. `d` is its
    autopilot, a record of AUTOPILOT.
    """
    # takes half a second to load, and hulls without fins need none of it
    from scipy.optimize import fsolve

    rigid, centre = _rigid_body(plant, i)
    c = plant.coefficients.view(np.recarray)[i]
    effectors = plant.effectors[i, : len(plant.effector_names[i])]
    fitted = np.concatenate([effectors, plant.fixed_fins[i]])[None]
    # as those of a plant, or another version of the forces would be compiled
    fitted.flags.writeable = False
    sea = sea_at(Ocean().environment, 0.0)
    forces = greatest_forces(d, speed, YAW)[1][: effectors.size]
    states = states_for(effectors, d["density"], forces, speed)[None]

    def balance(x: Floats) -> Floats:
        motion = np.array([[speed, x[0], 0.0, 0.0, 0.0, x[1], 0.0, 0.0, 0.0]])
        total = _forces(c, rigid, centre, motion, sea, Fitted(kinds_of(fitted), fitted, states))
        return np.asarray(total[0, [SWAY, YAW]])

    (sway, rate), _, status, _ = fsolve(balance, [0.0, 0.05], full_output=True)
    if status != 1 or not rate > 0.0:
        return np.inf, 0.0
    return float(rate), float(np.hypot(speed, sway) / rate)


def least_radius(plant: Plant, i: int, d: Autopilot) -> float:
    """Radius with which turns of vehicle i are planned [m]; 0 without fins, or if it turns
    faster than TURN_RATE.
    """
    if not d["effectors"]["lift_area"].any():
        return 0.0
    rate, radius = steady_turn(plant, i, d, START_SPEED)
    return 0.0 if rate > TURN_RATE else min(radius / PLANNED_TURN_SHARE, 1e4)


class _ControlledHull(NamedTuple):
    """A vehicle and its autopilot, as far as they are alike at all speeds."""

    name: str
    d: Autopilot
    c: Coefficients  # with all scales
    rigid: Floats  # inertia, (6, 6)
    centre: Vector  # of gravity
    inverse: Floats  # of the inertia with added mass, (6, 6)
    fitted: Fitted
    sea: SeaInstant
    # true wrenches, with the scales of thrust and lift, for a unit of each commanded force, (6, m)
    unit_wrench: Floats


def _controlled_hull(plant: Plant, i: int, d: Autopilot) -> _ControlledHull:
    rigid, centre = _rigid_body(plant, i)
    c = plant.true_coefficients.view(np.recarray)[i]
    effectors = plant.effectors[i]
    settings = plant.setups[i].settings
    scale = np.where(effectors["lift_area"] > 0.0, settings.lift_scale, settings.thrust_scale)
    return _ControlledHull(
        name=plant.names[i],
        d=d,
        c=c,
        rigid=rigid,
        centre=centre,
        inverse=np.linalg.inv(rigid + c.added_mass),
        fitted=Fitted(plant.kinds, plant.true_effectors[i : i + 1], np.zeros((1, effectors.size))),
        sea=sea_at(plant.ocean.environment, 0.0),
        unit_wrench=(scale[:, None] * unit_wrenches(effectors)).T,
    )


def _straight_ahead(speeds: Floats) -> Floats:
    """Velocities and angles of level, straight courses at speeds of shape (n,), shape (n, 9)."""
    equilibria = np.zeros((speeds.size, 9))
    equilibria[:, SURGE] = speeds
    return equilibria


def _state_matrices(hull: _ControlledHull, equilibria: Floats) -> Floats:
    """Matrices A of the linear motion ẋ = A x of a controlled vehicle about n equilibria of 6
    velocities and 3 angles, shape (n, 9). The state x is made of these, the height and the lagging
    wrench; shape (n, 16, 16).
    """
    d = hull.d
    n = len(equilibria)
    speed = equilibria[:, SURGE]
    steps = _DIFFERENCE_STEP * np.eye(9)
    states = equilibria[:, None] + np.concatenate([steps, -steps])
    forces = _forces(
        hull.c, hull.rigid, hull.centre, states.reshape(-1, 9), hull.sea, hull.fitted
    ).reshape(n, 18, 6)
    # change of each component of the wrench per velocity or angle, shape (n, 6, 9)
    slopes = (forces[:, :9] - forces[:, 9:]).swapaxes(1, 2)
    lag = np.full((6, 1), 0.25 / d["omega"])
    if d["holds_roll"]:
        lag[ROLL] = 0.25 / d["roll_omega"]
    matrices = np.zeros((n, 16, 16))
    matrices[:, :6, :9] = hull.inverse @ slopes / (2.0 * _DIFFERENCE_STEP)
    matrices[:, :6, 10:] = hull.inverse
    matrices[:, 6:9, 3:6] = np.eye(3)
    # nose down is positive about the axis to port
    matrices[:, HEIGHT, HEAVE] = 1.0
    matrices[:, HEIGHT, PITCH + 3] = -speed
    feedback = _feedback(d, matrices[:, HEIGHT, :10], speed)
    allocation = _allocations(d, speed, hull.unit_wrench.shape[1])
    matrices[:, 10:, :10] = hull.unit_wrench @ allocation @ feedback / lag
    matrices[:, 10:, 10:] = -np.eye(6) / lag
    return matrices


def _allocations(d: Autopilot, speeds: Floats, count: int) -> Floats:
    """Forces of `count` effectors per unit of a wrench at speeds of shape (n,), (n, count, 6);
    where roll is held, components but roll have no moment of roll.
    """
    slow = d["slow_allocation"][:count]
    fast = d["fast_allocation"][:count]
    allocations = np.empty((speeds.size, count, 6))
    for allocation, speed in zip(allocations, speeds.tolist(), strict=True):
        pseudo_inverse_at(slow, fast, speed, allocation)
    if d["holds_roll"]:
        # as `add_roll` does
        by_products = d["effectors"]["torque"][:count, 0] @ allocations
        by_products[:, ROLL] = 0.0
        allocations -= allocations[:, :, [ROLL]] * by_products[:, None, :]
    return allocations


_PLANES = {  # rows of the motion that belong together
    "sway and yaw": (1, 5, 8),
    "heave and pitch": (2, 4, 7, HEIGHT),
    "roll": (3, 6),
    "surge": (0,),
}


def _growth(hull: _ControlledHull, speed: float) -> tuple[float, str]:
    """Rate at which the motion of a vehicle grows fastest at a speed [1/s], and its plane.

    A hull without linear damping may swing by a degree or two, which its quadratic damping bounds:
    what swings is looked at about a slow swing.
    """
    [matrix] = _state_matrices(hull, _straight_ahead(np.array([speed])))
    rates, modes = np.linalg.eig(matrix)
    worst = int(np.argmax(rates.real))
    if (
        rates[worst].real > _TOLERATED_GROWTH
        and abs(rates[worst].imag) > _SWING_RATIO * rates[worst].real
    ):
        swinging = np.array([[speed, 0.0, 0.0, *_SWING_RATES_RAD_S, 0.0, 0.0, 0.0]])
        [matrix] = _state_matrices(hull, swinging)
        rates, modes = np.linalg.eig(matrix)
        worst = int(np.argmax(rates.real))
    size = np.abs(modes[:10, worst])
    plane = max(_PLANES, key=lambda name: size[list(_PLANES[name])].max())
    return float(rates[worst].real), plane


def _turning(speed: float) -> Floats:
    """Velocities and angles of a brisk turn, shape (9,)."""
    return np.array([speed, *_TURN_SWAY_HEAVE_M_S, *_TURN_RATES_RAD_S, 0.0, 0.0, 0.0])


def _require_short_steps(hull: _ControlledHull, dt: float, matrix: Floats, speed: float) -> None:
    """LaisnError naming a physics step that is short enough, or what makes the motion too fast, by
    the state matrix in a brisk turn at a speed.
    """
    rate = np.abs(np.linalg.eigvals(matrix)).max() if np.all(np.isfinite(matrix)) else np.inf
    if rate * dt < 1.0:
        return
    steps = np.ceil(CONTROL_STEP_S * rate / _STEP_RESERVE)
    advice = "damping, drag areas, levers and fins must fit mass and added mass"
    most_steps = round(CONTROL_STEP_S / SHORTEST_STEP_S)
    if steps <= most_steps:
        # of steps that divide the control step, and that decimals state exactly
        divisors = [n for n in range(int(steps), most_steps + 1) if most_steps % n == 0]
        advice = f"set timing.physics_step_s = {CONTROL_STEP_S / divisors[0]:.6g}"
    raise LaisnError(
        f"{hull.name}: its motion changes within {1.0 / rate:.2g} s at {speed:.3g} m/s, too "
        f"fast for physics steps of {dt:g} s; {advice}"
    )


def _stable_below(hull: _ControlledHull, unstable: float) -> float:
    """Highest speed, in hundredths, up to which a vehicle is stable, below an unstable one; 0: it
    is nowhere [m/s].
    """
    speeds = np.arange(0.05, unstable, 0.01)
    grows = [_growth(hull, speed)[0] > _TOLERATED_GROWTH for speed in speeds]
    first = grows.index(True) if True in grows else len(grows)
    return float(speeds[first - 1]) if first else 0.0


def require_stable(
    plant: Plant,
    autopilots: Iterable[Autopilot],
    max_speed: float,
    orbital_speed: float = 0.0,
    *,
    min_speed: float = 0.0,
    top_speeds: Sequence[float] | None = None,
) -> None:
    """LaisnError naming vehicle, speed and plane where the motion of a plant's vehicles diverges.

    Speeds through the water from `min_speed` to `max_speed`, and to that with which a vehicle
    catches up with its route, are looked at as far as the vehicle reaches them [m/s]. Or the
    motion, also in a turn and with the speed `orbital_speed` of the water in waves [m/s], is too
    fast for the plant's steps. `top_speeds` are the vehicles' by `top_speed`, where they are known
    [m/s].
    """
    for i, (name, d) in enumerate(zip(plant.names, autopilots, strict=True)):
        hull = _controlled_hull(plant, i, d)
        greatest_speed = top_speed(d) if top_speeds is None else top_speeds[i]
        top = max(min(_CATCH_UP_FACTOR * max_speed, greatest_speed), min_speed)
        count = 1 + int(np.ceil((top - min_speed) / _SPEED_STEP))
        speeds = np.linspace(min_speed, top, count)
        turning_speed = _CATCH_UP_FACTOR * max_speed + orbital_speed
        equilibria = np.vstack([_turning(turning_speed), _straight_ahead(speeds)])
        matrices = _state_matrices(hull, equilibria)
        _require_short_steps(hull, plant.dt, matrices[0], turning_speed)
        growths = np.linalg.eigvals(matrices[1:]).real.max(axis=1)
        # eigenvalues without their modes differ from those with them by rounding
        for speed in speeds[growths > _TOLERATED_GROWTH - _ROUNDING]:
            growth, plane = _growth(hull, float(speed))
            if growth <= _TOLERATED_GROWTH:
                continue
            advice = (
                "give the hull fins at the stern or hull lift (NAME.fin, hull_lift), or a centre "
                "of gravity below its origin"
            )
            stable_speed = _stable_below(hull, float(speed))
            leg_speed = np.floor(100.0 * stable_speed / _CATCH_UP_FACTOR) / 100.0
            if leg_speed >= SPEED_MIN:
                advice = (
                    f"it is stable on legs of up to {leg_speed:g} m/s through the water; "
                    f"or {advice}"
                )
            raise LaisnError(
                f"{name}: the autopilot cannot stabilise {plane} at {speed:.3g} m/s, they grow by "
                f"a factor of e in {1.0 / growth:.2g} s; {advice}"
            )
