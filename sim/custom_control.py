"""Controllers of a user's own: what they are given, what they may command, and how that reaches
the effectors.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Record, records
from laisn.errors import LaisnError
from laisn.messages import Reception
from laisn.plugins import calling, class_and_file, find_controller
from sim.control import follower as steering
from sim.control.autopilot import HullMotion, apply_wrench, control
from sim.control.guidance import REFERENCE, limit_command, start_guidance
from sim.scenario.settings import CONTROL_STEP_S, Vehicle
from sim.simulation import RouteControl
from sim.vehicle.plant import Plant


class Readings(NamedTuple):
    """What a vehicle measures at a control step; the values of a filter step stay until the
    next one.
    """

    time: float  # since the start [s]
    speed: float  # speed log, along the hull [m/s]
    heading: float  # compass θ, clockwise from north [rad]
    depth: float  # pressure sensor [m]
    pitch: float  # inclinometer, positive nose up [rad]
    yaw_rate: float  # gyro about the hull's upward axis, positive to port [rad/s]
    pitch_rate: float  # gyro about the hull's port axis, positive nose down [rad/s]
    # inclinometer across the hull, the angle of its port axis above the level, positive starboard
    # down [rad]
    heel: float
    roll_rate: float  # gyro about the hull's forward axis, positive starboard down [rad/s]
    # message of the link used for navigation; only at the control step in which it has arrived
    reception: Reception | None
    custom: Mapping[str, Floats] = MappingProxyType({})
    """Readings of further sensors at the last filter step by their names, shape (c,)."""
    receptions: Mapping[str, Reception] = MappingProxyType({})
    """Messages of further links that arrived in this control step, by the links' names."""


class Belief(NamedTuple):
    """Estimate of a vehicle's navigator, brought forward by its velocity between filter steps."""

    east: float  # position of the hydrophone [m]; NaN before there is an estimate
    north: float
    east_velocity: float  # velocity over ground [m/s]
    north_velocity: float
    # navigator's estimate of the speed log's bias, 0 if it estimates none [m/s]
    log_bias: float
    compass_bias: float  # likewise [rad]
    # estimate of the current, 0 of a navigator that estimates none [m/s]
    east_current: float
    north_current: float


class Command(NamedTuple):
    """What an autopilot is to hold; it turns and accelerates within the limits of routes.

    Numbers; for `laisn_sim.Simulations.command` also arrays with one number for each mission.
    """

    heading: float | Floats  # clockwise from north [rad]
    speed: float | Floats  # through the water [m/s]
    depth: float | Floats  # [m]


class Wrench(NamedTuple):
    """Force and moment about the hull's axes, which the effectors give as far as they can; where
    limits bind, roll is left out first. Numbers or arrays as of `Command`.
    """

    surge: float | Floats = 0.0  # forward [N]
    sway: float | Floats = 0.0  # to port [N]
    heave: float | Floats = 0.0  # upward [N]
    roll: float | Floats = 0.0  # about the forward axis, positive to starboard [N m]
    pitch: float | Floats = 0.0  # about the port axis, positive nose down [N m]
    yaw: float | Floats = 0.0  # about the upward axis, positive to port [N m]


def as_numbers(values: Any) -> Floats:
    """Values as numbers; TypeError or ValueError if they are none: text, dates, complex numbers or
    lists of unlike lengths.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "biufO":
        raise TypeError(f"{array.dtype} is no type of real numbers")
    return np.asarray(array, dtype=np.float64)


def require_command(command: Any, effector_count: int, subject: str, origin: str = "") -> None:
    """LaisnError if `command` is not one a vehicle can be given; the message begins with `subject`
    and ends with `origin`.

    It may be a `Command` or three numbers, a `Wrench`, or an array of the states of all effectors.
    """
    expected = 3
    if isinstance(command, Wrench):
        expected = 6
    elif isinstance(command, np.ndarray):
        expected = effector_count
    try:
        numbers = as_numbers(command)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (expected,) or not np.isfinite(numbers).all():
        raise LaisnError(
            f"{subject} {command!r:.80}; expected heading, speed and depth, a Wrench, "
            f"or an array of the states of {effector_count} effectors, all finite{origin}"
        )


def belief_of(estimate: Record) -> Belief:
    """What a navigator believes, by a record of ESTIMATE."""
    east, north = estimate.position.tolist()
    east_velocity, north_velocity = estimate.velocity.tolist()
    east_current, north_current = estimate.current.tolist()
    return Belief(
        east=east,
        north=north,
        east_velocity=east_velocity,
        north_velocity=north_velocity,
        log_bias=float(estimate.log_bias),
        compass_bias=float(estimate.compass_bias),
        east_current=east_current,
        north_current=north_current,
    )


def readings_of(
    time: float,
    reading: Record,
    reception: Reception | None,
    custom: Mapping[str, Floats],
    receptions: Mapping[str, Reception],
) -> Readings:
    """What a vehicle measures, by a record of READING."""
    return Readings(
        time=time,
        speed=float(reading.speed),
        heading=float(reading.heading),
        depth=float(reading.depth),
        pitch=float(reading.pitch),
        yaw_rate=float(reading.turning),
        pitch_rate=float(reading.pitching),
        heel=math.asin(min(max(float(reading.heel), -1.0), 1.0)),
        roll_rate=float(reading.rolling),
        reception=reception,
        custom=custom,
        receptions=receptions,
    )


def _made_controller(vehicle: Vehicle) -> Any:
    """The controller of a vehicle's table; LaisnError if there is no such class."""
    name = str(vehicle.controller)
    with calling(f"controller {name}"):
        return find_controller(name)(vehicle.without_hidden_errors)


class CustomControl:
    """Calls the controllers of vehicles and writes what they command.

    A controller is made of the vehicle's table, less what is hidden from it
    (`Vehicle.without_hidden_errors`). Its `control(readings, belief, dt)` returns what holds for
    the next `dt` seconds: a `Command` or a tuple of its three numbers, a `Wrench`, or an
    array of the states of all effectors, in the order of the hull's actuators, shape (m,), each in
    the unit of its kind: N, revolutions per second [1/s], rad, or that of its curve.
    """

    def __init__(self, vehicles: Mapping[int, Vehicle], plant: Plant, routes: RouteControl) -> None:
        """Make the controllers of vehicles by their index; LaisnError if there is no such class."""
        self._controllers = {i: _made_controller(vehicle) for i, vehicle in vehicles.items()}
        self._names = plant.names
        self._effector_counts = [len(names) for names in plant.effector_names]
        self._routes = routes
        self._reference = records(REFERENCE, 1)[0]
        # vehicles whose autopilots hold what their controllers commanded last
        self._held = set[int]()

    def __bool__(self) -> bool:
        return bool(self._controllers)

    @property
    def self_commanded(self) -> list[int]:
        """Indices of the vehicles with own controllers that no outside command overrides."""
        return [i for i in self._controllers if not self._routes.commanded_from_outside[i]]

    def command(
        self, k: int, i: int, readings: Readings, senses: steering.Senses, follower_memory: Record
    ) -> None:
        """Write the command of vehicle i from instant k on; `follower_memory` is of
        FOLLOWER_MEMORY.
        """
        estimate = senses.estimate
        controller = self._controllers[i]
        kind = class_and_file(controller)
        with calling(f"controller {kind}: control"):
            answer = controller.control(readings, belief_of(estimate), CONTROL_STEP_S)
        origin = f" (class {kind}, at {readings.time:g} s)"
        subject = f"controller of {self._names[i]} returned"
        require_command(answer, self._effector_counts[i], subject, origin)
        motion = steering.measured_motion(senses.reading, estimate, CONTROL_STEP_S, follower_memory)
        effector_command = self._routes.command[i]
        if isinstance(answer, Wrench):
            self._held.discard(i)
            autopilot_design = self._routes.autopilot_designs[i]
            autopilot_memory = self._routes.autopilot_memories[i]
            autopilot_memory.wrench[:] = answer
            apply_wrench(
                self._routes.kinds,
                autopilot_design,
                motion.surge,
                autopilot_memory,
                effector_command,
            )
        elif isinstance(answer, np.ndarray):
            self._held.discard(i)
            # rows are as long as the largest number of effectors
            effector_command[: len(answer)] = answer
        else:
            heading, speed, depth = map(float, answer)
            self._hold(k, i, motion, heading=heading, speed=speed, depth=depth)

    def _hold(
        self, k: int, i: int, motion: HullMotion, *, heading: float, speed: float, depth: float
    ) -> None:
        """Write what the autopilot commands to hold the demand of a `Command`.

        Of `_reference`, a scratch record, only the depth is set; the rest stays 0. Guidance begins
        where the hull is, by its measured motion, unless the autopilot held the command before.
        """
        routes = self._routes
        reference = self._reference
        guidance: Record = routes.guidance[i]
        reference.depth = depth
        if i not in self._held:
            start_guidance(
                routes.reference[k, i], motion.heading, motion.surge, (0.0, 0.0), guidance
            )
            self._held.add(i)
        steered = limit_command(heading, speed, CONTROL_STEP_S, guidance)
        autopilot_design = routes.autopilot_designs[i]
        autopilot_memory = routes.autopilot_memories[i]
        control(
            routes.kinds,
            autopilot_design,
            steered,
            reference,
            motion,
            CONTROL_STEP_S,
            autopilot_memory,
            routes.command[i],
        )
