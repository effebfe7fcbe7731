"""Whether an autopilot stabilises its hull: eigenvalues of the motion about a straight course,
speed by speed.

The forces are those of `sim.vehicle.hydrodynamics`, with all scales of a setup, linearised by
differences; effectors follow the linear law of the autopilot, designed for the MJCF's coefficients,
with their lag. Limits of effectors and the slow loops (integrals, depth through pitch) are left
out.
"""

from typing import Any

import numpy as np
from scipy.optimize import fsolve

from laisn.arrays import Floats
from laisn.failure import LaisnError
from sim.control.allocation import HEAVE, PITCH, SURGE, SWAY, YAW, at_speed, clip
from sim.control.autopilot import SPEED_HEAVE, SPEED_PITCH, greatest_forces
from sim.control.guidance import CATCH_UP
from sim.scenario.point_motion import TURN_RATE
from sim.scenario.routes import START_SPEED
from sim.vehicle.effectors import FIN, state_for, unit_wrenches
from sim.vehicle.hydrodynamics import wrench
from sim.vehicle.mjcf import inertia_tensor
from sim.vehicle.plant import Plant
from sim.water import Water, instant_of

_SPEED_STEP = 0.5  # speeds are looked at in such steps, from the one at which missions begin [m/s]
_GROWTH = 0.02  # slower growth is left to the loops that are left out [1/s]
_CATCHING_UP = 1.0 + CATCH_UP  # largest commanded speed as a multiple of the speed of a route
# sway and heave, and roll, pitch and yaw rates of a brisk turn
_DRIFT_M_S = (0.3, 0.3)
_SPIN_RAD_S = (0.2, 0.2, 0.2)
_STEP = 1e-4
# turns are planned with the least radius over this, which leaves some rudder for corrections
TURN_RESERVE = 0.9
HEIGHT = 9  # place of the height among velocities (0 to 5) and angles (6 to 8)


def _skew(a: Floats) -> Floats:
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _forces(
    c: Any, rigid: Floats, centre: Floats, state: Floats, water: Water, fitted: tuple[Any, Floats]
) -> Floats:
    """Wrench of water, weight and inertia in the body, of velocities (6) and small angles about
    the body's axes (3).
    """
    velocity = state[:3]
    spin = state[3:6]
    angle = state[6:]
    to_world = np.eye(3) + _skew(angle) + 0.5 * _skew(angle) @ _skew(angle)
    pose = np.array([0.0, 0.0, -10.0, np.sqrt(1.0 - 0.25 * angle @ angle), *(0.5 * angle)])
    force, moment, _ = wrench(
        c, pose, np.concatenate([to_world @ velocity, spin]), *instant_of(0.0, water), fitted, 0
    )
    weight = to_world.T @ [0.0, 0.0, -rigid[0, 0] * c.gravity]
    momentum = rigid @ state[:6]
    carried = c.added_mass[:, :3] @ np.cross(spin, velocity)
    return np.concatenate(
        [
            # `wrench` adds what the solver needs of added mass in the world's frame, which is not
            # accelerated here
            to_world.T @ np.array(force) + weight - np.cross(spin, momentum[:3]) - carried[:3],
            np.array(moment)
            + np.cross(centre, weight)
            - np.cross(spin, momentum[3:])
            - np.cross(velocity, momentum[:3])
            - carried[3:],
        ]
    )


def _law(d: Any, climb: Floats, speed: float) -> Floats:
    """Wrench that the autopilot commands by velocities (6), angles (3) and height, as is
    `climb`, the rate of climb.
    """
    law = np.zeros((6, 10))
    omega = d["omega"]
    thrust = 1.0 - d["by_pitch"] * clip(
        (speed - SPEED_HEAVE) / (SPEED_PITCH - SPEED_HEAVE), 0.0, 1.0
    )
    thrust *= d["has_heave"]
    law[SURGE, SURGE] = -0.5 * omega * d["surge_mass"]
    law[SWAY, SWAY] = -0.5 * omega * d["sway_mass"]
    for axis, inertia in ((PITCH, d["pitch_inertia"]), (YAW, d["yaw_inertia"])):
        law[axis, axis] = -2.0 * omega * inertia
        law[axis, axis + 3] = -omega * omega * inertia
    law[PITCH, HEAVE] = -d["pitch_munk"] * speed
    law[HEAVE] = -omega * thrust * d["heave_mass"] * climb
    law[HEAVE, HEIGHT] = -0.25 * omega * omega * thrust * d["heave_mass"]
    return law


def _body(plant: Plant, i: int) -> tuple[Floats, Floats]:
    """Rigid inertia (6×6) about the origin, and centre of gravity of vehicle i."""
    body = plant.model.body(f"{plant.names[i]}/hull")
    mass = float(body.mass[0])
    centre = np.array(body.ipos)
    cross = mass * _skew(centre)
    inertia = inertia_tensor(plant.model, body.id)
    return np.block([[mass * np.eye(3), -cross], [cross, inertia - cross @ _skew(centre)]]), centre


def steady_turn(plant: Plant, i: int, d: Any, speed: float) -> tuple[float, float]:
    """Largest rate of turn of vehicle i in calm water at a speed along the hull [rad/s], and the
    turn's radius [m].

    Sway and yaw balance the effectors; without a balance the rate is infinite. `d` is its
    autopilot, a record of DESIGN.
    """
    rigid, centre = _body(plant, i)
    c = plant.coefficients.view(np.recarray)[i]
    own = plant.effectors[i, : len(plant.effector_names[i])]
    fitted = np.concatenate([own, plant.fixed_fins[i]])[None]
    # as those of a plant, or another version of the forces would be compiled
    fitted.flags.writeable = False
    forces = greatest_forces(d, speed, YAW)[1][: own.size]
    states = np.array(
        [
            [
                state_for(one, d["density"], force, speed)
                for one, force in zip(own, forces, strict=True)
            ]
        ]
    )

    def balance(x: Floats) -> Floats:
        motion = np.array([speed, x[0], 0.0, 0.0, 0.0, x[1], 0.0, 0.0, 0.0])
        total = _forces(c, rigid, centre, motion, plant.ocean.water, (fitted, states))
        return np.asarray(total[[SWAY, YAW]])

    (sway, rate), _, found, _ = fsolve(balance, [0.0, 0.05], full_output=True)
    if found != 1 or not rate > 0.0:
        return np.inf, 0.0
    return float(rate), float(np.hypot(speed, sway) / rate)


def least_radius(plant: Plant, i: int, d: Any) -> float:
    """Radius with which turns of vehicle i are planned [m]; 0 without fins, or if it turns
    faster than TURN_RATE.
    """
    if FIN not in d["effectors"]["kind"]:
        return 0.0
    rate, radius = steady_turn(plant, i, d, START_SPEED)
    return 0.0 if rate > TURN_RATE else min(radius / TURN_RESERVE, 1e4)


def _motion(plant: Plant, i: int, d: Any, about: Floats) -> Floats:
    """Matrix of the motion of vehicle i about 6 velocities and 3 angles: these, height and
    lagging wrench, (16, 16).
    """
    rigid, centre = _body(plant, i)
    c = plant.true_coefficients.view(np.recarray)[i]
    own = plant.effectors[i]
    settings = plant.setups[i].settings
    speed = float(about[0])
    steps = _STEP * np.eye(9)
    fitted = plant.true_effectors[i : i + 1], np.zeros((1, own.size))
    rates = [
        _forces(c, rigid, centre, about + step, plant.ocean.water, fitted)
        - _forces(c, rigid, centre, about - step, plant.ocean.water, fitted)
        for step in steps
    ]
    allocation = np.empty((own.size, 6))
    at_speed(d["slow_allocation"][: own.size], d["fast_allocation"][: own.size], speed, allocation)
    # forces that act for a unit of the commanded ones
    scale = np.where(own["kind"] == FIN, settings.lift_scale, settings.thrust_scale)
    given = (scale[:, None] * unit_wrenches(own)).T @ allocation
    inverse = np.linalg.inv(rigid + c.added_mass)
    lag = 0.25 / d["omega"]
    matrix = np.zeros((16, 16))
    matrix[:6, :9] = inverse @ np.array(rates).T / (2.0 * _STEP)
    matrix[:6, 10:] = inverse
    matrix[6:9, 3:6] = np.eye(3)
    # nose down is positive about the axis to port
    matrix[HEIGHT, HEAVE] = 1.0
    matrix[HEIGHT, PITCH + 3] = -speed
    matrix[10:, :10] = given @ _law(d, matrix[HEIGHT, :10], speed) / lag
    matrix[10:, 10:] = -np.eye(6) / lag
    return matrix


def require_stable(plant: Plant, autopilots: Any, fastest: float, orbital: float = 0.0) -> None:
    """LaisnError naming vehicle, speed and plane where the motion of a plant's vehicles diverges,
    up to a speed [m/s].

    Or a motion, also in a turn and with the speed `orbital` of the water in waves [m/s], that is
    too fast for its steps.
    """
    turning = np.array([_CATCHING_UP * fastest + orbital, *_DRIFT_M_S, *_SPIN_RAD_S, 0.0, 0.0, 0.0])
    for i, (name, d) in enumerate(zip(plant.names, autopilots, strict=True)):
        matrix = _motion(plant, i, d, turning)
        rate = np.abs(np.linalg.eigvals(matrix)).max() if np.all(np.isfinite(matrix)) else np.inf
        if not rate * plant.dt < 1.0:
            raise LaisnError(
                f"{name}: its motion changes within {1.0 / rate:.2g} s at {turning[0]:.3g} m/s, "
                f"too fast for physics steps of {plant.dt:g} s; damping, drag areas, levers and "
                "fins must fit mass and added mass"
            )
        for speed in np.arange(START_SPEED, max(fastest, START_SPEED) + _SPEED_STEP, _SPEED_STEP):
            growth, modes = np.linalg.eig(_motion(plant, i, d, np.append(speed, np.zeros(8))))
            worst = int(np.argmax(growth.real))
            if growth[worst].real > _GROWTH:
                size = np.abs(modes[:10, worst])
                planes = {
                    "sway and yaw": (1, 5, 8),
                    "heave and pitch": (2, 4, 7, 9),
                    "roll": (3, 6),
                    "surge": (0,),
                }
                plane = max(planes, key=lambda one: size[list(planes[one])].max())
                raise LaisnError(
                    f"{name}: the autopilot cannot stabilise {plane} at {speed:g} m/s, they grow "
                    f"by a factor of e in {1.0 / growth[worst].real:.2g} s; give the hull fins at "
                    "the stern or hull lift (NAME.fin, hull_lift), or a centre of gravity below "
                    "its origin"
                )
