"""Controllers of the user's own: a follower's class computes its commands from readings and the estimate, in Python."""

from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Record, records
from laisn.failure import LaisnError
from laisn.messages import Reception
from laisn.plugins import find_controller
from sim.control.autopilot import apply_wrench, control
from sim.control.follower import measured_motion
from sim.control.guidance import REFERENCE, begin, limit_command
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.simulation import RouteControl
from sim.vehicle.plant import Plant


class Readings(NamedTuple):
    """What a follower measures at a control step; the values of a filter step stay until the next one."""

    time: float  # since the start [s]
    speed: float  # speed log, along the hull [m/s]
    heading: float  # compass θ, clockwise from north [rad]
    depth: float  # pressure sensor [m]
    pitch: float  # inclinometer, positive nose up [rad]
    yaw_rate: float  # gyro about the hull's upward axis, positive to port [rad/s]
    pitch_rate: float  # gyro about the hull's port axis, positive nose down [rad/s]
    reception: Reception | None
    """Message of the leader and its ranges, at the control step at which they arrive; otherwise None."""


class Belief(NamedTuple):
    """Estimate of a follower's navigator, brought forward by its velocity between filter steps."""

    east: float  # position of the hydrophone [m]; NaN before there is an estimate
    north: float
    east_velocity: float  # velocity over ground [m/s]
    north_velocity: float
    log_bias: float  # of the navigator, 0 if it estimates none [m/s]
    compass_bias: float  # [rad]
    east_current: float  # [m/s]
    north_current: float


class Command(NamedTuple):
    """What an autopilot is to hold; it turns and accelerates within the limits of routes."""

    heading: float  # clockwise from north [rad]
    speed: float  # through the water [m/s]
    depth: float  # [m]


class Wrench(NamedTuple):
    """Force and moment about the hull's axes, which the effectors give as far as they can."""

    surge: float = 0.0  # forward [N]
    sway: float = 0.0  # to port [N]
    heave: float = 0.0  # upward [N]
    roll: float = 0.0  # about the forward axis [N m]
    pitch: float = 0.0  # about the port axis, positive nose down [N m]
    yaw: float = 0.0  # about the upward axis, positive to port [N m]


class OwnControl:
    """Calls the controllers of a scenario's followers and writes what they command.

    A controller is made of the follower's table. Its `control(readings, belief, dt)` returns what holds for the next
    `dt` seconds: a `Command` or a tuple of its three numbers, a `Wrench`, or an array of the states of all effectors,
    in the order of the hull's actuators, shape (m,): N, rad/s or rad.
    """

    def __init__(self, scenario: Scenario, plant: Plant, routes: RouteControl) -> None:
        """Make the controllers; LaisnError if there is no such class."""
        named = [(i, f, f.controller) for i, f in enumerate(scenario.followers) if f.controller]
        self._controllers = {i: find_controller(name)(follower) for i, follower, name in named}
        self._names, self._effectors = plant.names[1:], [len(names) for names in plant.effector_names[1:]]
        self._routes, self._reference = routes, records(REFERENCE, 1)[0]

    def __bool__(self) -> bool:
        return bool(self._controllers)

    def command(self, k: int, received: list[Reception | None], known: tuple[Any, Any, Any]) -> None:
        """Write the commands that hold from instant k on.

        `received` are receptions of this instant by follower, `known` records of READING, ESTIMATE and FOLLOWER_MEMORY.
        """
        for f, controller in self._controllers.items():
            reading, estimate, memory = (table[f] for table in known)
            speed, heading, depth, pitch, yaw_rate, pitch_rate = reading.tolist()
            readings = Readings(k * CONTROL_STEP_S, speed, heading, depth, pitch, yaw_rate, pitch_rate, received[f])
            biases = estimate.log_bias, estimate.compass_bias
            belief = Belief(*map(float, (*estimate.position, *estimate.velocity, *biases, *estimate.current)))
            found = controller.control(readings, belief, CONTROL_STEP_S)
            self._require_valid(f, found)
            motion = measured_motion(reading, estimate, CONTROL_STEP_S, memory)
            command, autopilot = self._routes.command[f + 1], self._routes.autopilot[f + 1]
            if isinstance(found, Wrench):
                autopilot.wrench[:] = found
                apply_wrench(self._routes.autopilots[f + 1], motion.surge, autopilot, command)
            elif isinstance(found, np.ndarray):
                command[: len(found)] = found
            else:
                self._hold(k, f, Command(*map(float, found)), motion)

    def _require_valid(self, f: int, found: Any) -> None:
        """LaisnError naming the follower if its controller has returned none of the three."""
        size = self._effectors[f]
        expected = 6 if isinstance(found, Wrench) else size if isinstance(found, np.ndarray) else 3
        try:
            values = np.asarray(found, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.shape != (expected,) or not np.all(np.isfinite(values)):
            raise LaisnError(
                f"controller of {self._names[f]} returned {found!r:.80}; expected heading, speed and depth, a Wrench, "
                f"or an array of the states of {size} effectors, all finite"
            )

    def _hold(self, k: int, f: int, wanted: Command, motion: Any) -> None:
        routes, i, reference = self._routes, f + 1, self._reference
        guidance: Record = routes.guidance[i]
        reference.depth = wanted.depth
        if k == 0:
            begin(routes.reference[0, i], motion.heading, motion.surge, (0.0, 0.0), guidance)
        steered = limit_command(wanted.heading, wanted.speed, CONTROL_STEP_S, guidance)
        autopilot, memory = routes.autopilots[i], routes.autopilot[i]
        control(autopilot, steered, reference, motion, CONTROL_STEP_S, memory, routes.command[i])
