"""A fleet flown by its autopilots: plant, guidance and autopilot make a Trajectory."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, copy_values
from laisn.failure import LaisnError
from sim.contact import Ending
from sim.control.autopilot import AUTOPILOT_MEMORY, DepthControl, control, design, vehicle_state
from sim.control.guidance import GUIDANCE_MEMORY, begin, reference, steer, track_current
from sim.scenario.point_motion import Limits
from sim.scenario.routes import Route
from sim.scenario.settings import CONTROL_STEP_S
from sim.trajectory import Trajectory
from sim.vehicle.plant import Plant, PlantError
from sim.vehicle.stepping import FINE, Fault, advance
from sim.water.ocean import Water, water_velocity

TICK = CONTROL_STEP_S
"""Interval of guidance, autopilot and recording [s]."""
POSITION, QUATERNION = slice(0, 3), slice(3, 7)
VELOCITY, SPIN = slice(7, 10), slice(10, 13)
WATER = slice(13, 16)
"""Columns of a record of one vehicle at one instant; the thrusts of its m effectors follow."""
COLUMNS = 16
"""Number of columns before the thrusts."""
_PROGRESS_TICKS = 500


class FleetError(LaisnError):
    """A flight that could not go on.

    Attributes:
        time: at which it stopped [s].
        trajectory: up to the last good instant; None if there are not two of them.
    """

    def __init__(self, message: str, time: float, trajectory: Trajectory | None) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory


Steering = tuple[Floats, Any, tuple[Floats, Floats], Floats]
"""Wanted, autopilots, memory and command of vehicles along their routes: the reference of all instants, shape
(n, v, 8); records of DESIGN, shape (v,); memories of guidance and autopilot; thrusts, shape (v, m), [N]."""


@compiled
def record_state(k: int, state: tuple[Floats, Floats, Floats], water: Water, record: Floats) -> None:
    """Record instant k."""
    pose, twist, thrust = state
    row = record[k]
    water_velocity(pose[:, POSITION], k * TICK, water, row[:, WATER])
    for i in range(pose.shape[0]):
        copy_values(pose[i], row[i, 0:7])
        copy_values(twist[i], row[i, 7:13])
        copy_values(thrust[i], row[i, COLUMNS:])


@compiled
def steer_along_route(k: int, row: Floats, i: int, steering: Steering) -> None:
    """Find the command of vehicle i, by its true motion, that holds from the recorded instant k until k + 1.

    Args:
        k: instant.
        row: recorded truth, shape (v, COLUMNS + m).
        i: vehicle.
        steering: memory is brought forward, set up at k = 0; command is written down.
    """
    wanted, autopilots, memory, command = steering
    reference, guided = wanted[k, i], memory[0][i]
    motion = vehicle_state(row[i, 0:7], row[i, 7:13], row[i, WATER])
    current = row[i, WATER][0], row[i, WATER][1]
    if k == 0:
        begin(reference, motion.heading, motion.surge, current, guided)
    track_current(current, TICK, guided)
    steered = steer(reference, row[i, 0:2], TICK, guided)
    control(autopilots[i], steered, reference, motion, TICK, memory[1][i], command[i])


@compiled
def steer_along_routes(k: int, row: Floats, steering: Steering) -> None:
    """Find the commands of all vehicles, which know where they are; memory is set up at k = 0."""
    for i in range(row.shape[0]):
        steer_along_route(k, row, i, steering)


@compiled
def _fly(
    span: tuple[int, int, int],
    handles: Any,
    state: tuple[Floats, Floats, Floats],
    water: Water,
    steering: Steering,
    record: Floats,
) -> tuple[int, Fault]:
    """Steer, advance and record from one instant to another.

    Args:
        span: the first instant, which is recorded; the last; physics steps from one to the next.
        handles: of `Plant.step_handles`.
        state: pose, twist and thrust of the plant.
        water: as of `record_state`.
        steering: of all vehicles.
        record: of all instants, shape (n, v, COLUMNS + m).

    Returns:
        The last instant that is recorded, and what ended the flight there, if it is not FINE.
    """
    first, last, substeps = span
    for k in range(first, last):
        steer_along_routes(k, record[k], steering)
        fault = advance(handles, steering[3], substeps)
        if fault[0] != FINE:
            return k, fault
        record_state(k + 1, state, water, record)
    return last, (FINE, -1)


class Controller(Protocol):
    """What steers the vehicles of a fleet."""

    def fly(
        self,
        span: tuple[int, int, int],
        handles: Any,
        state: tuple[Floats, Floats, Floats],
        water: Water,
        record: Floats,
    ) -> tuple[int, Fault]:
        """Control, advance and record from one instant to another in compiled code; arguments as of `_fly`."""

    def end(self, k: int, record: Floats) -> None:
        """Handle the last instant, after which nothing is steered."""


class RouteController:
    """Vehicles on routes, steered by the truth."""

    def __init__(self, steering: Steering) -> None:
        """Take the arrays of the routes."""
        self._steering = steering

    def fly(
        self,
        span: tuple[int, int, int],
        handles: Any,
        state: tuple[Floats, Floats, Floats],
        water: Water,
        record: Floats,
    ) -> tuple[int, Fault]:
        """Steer, advance and record; see `Controller.fly`."""
        return _fly(span, handles, state, water, self._steering, record)

    def end(self, k: int, record: Floats) -> None:
        """Do nothing: whoever is steered by the truth has nothing to remember."""


ControllerFactory = Callable[[Plant, Steering], Controller]
"""Makes the controller of a plant from the arrays of its routes."""


def _trajectory(plant: Plant, record: Floats) -> Trajectory:
    """What is recorded, which is two instants or more."""
    part = {
        name: np.ascontiguousarray(record[..., columns])
        for name, columns in {
            "position": POSITION,
            "quaternion": QUATERNION,
            "velocity": VELOCITY,
            "angular_velocity": SPIN,
            "water_velocity": WATER,
            "thrust": slice(COLUMNS, None),
        }.items()
    }
    return Trajectory(
        names=plant.names,
        time=np.arange(record.shape[0], dtype=np.float64) * TICK,
        site_names=plant.site_names,
        site_vehicle=plant.site_vehicle.copy(),
        site_offset=plant.site_offset.copy(),
        effector_names=plant.effector_names,
        effector_force=plant.effectors["force"].copy(),
        **part,
    )


def standing(plant: Plant) -> Trajectory:
    """A plant as it stands: a trajectory of two equal instants, for what is told of vehicles before they move."""
    record = np.empty((2, len(plant.names), COLUMNS + plant.thrust.shape[1]))
    for k in range(2):
        record_state(k, plant.state, plant.ocean.water, record)
    return _trajectory(plant, record)


def simulate_fleet(
    plant: Plant,
    routes: Sequence[Route],
    duration: float,
    depth_control: Sequence[DepthControl] = (),
    *,
    limits: Sequence[Limits] | None = None,
    make_controller: ControllerFactory | None = None,
    ending: Ending | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Fly every vehicle of a plant along its route.

    Args:
        plant: at its start, which is where the vehicles begin, whatever the routes say; moved on to the end.
        routes: one for each vehicle.
        duration: [s]; a multiple of 0.1 s.
        depth_control: of each vehicle; empty: "pitch" for all.
        limits: what each vehicle can do; None: the paper's turn rate, acceleration and top speed.
        make_controller: makes one that steers otherwise than along routes by the truth; None: there is none.
        ending: what ends the flight before its time; None: nothing does.
        progress: called with the mission time [s], every 50 s of it.

    Returns:
        Truth every 0.1 s, time 0 and `duration` included, or the instant that ended the flight.

    Raises:
        ValueError: there is not one route for each vehicle, a route cannot be flown, or the times do not fit.
        FleetError: the simulation left finite numbers; carries the trajectory up to there.
    """
    substeps, ticks = round(TICK / plant.dt), round(duration / TICK)
    if substeps < 1 or abs(substeps * plant.dt - TICK) > 1e-9:
        raise ValueError(f"the plant's step of {plant.dt:g} s does not divide {TICK:g} s")
    if ticks < 1 or abs(ticks * TICK - duration) > 1e-6:
        raise ValueError(f"duration {duration:g} s is no positive multiple of {TICK:g} s")
    v = len(plant.names)
    if len(routes) != v:
        raise ValueError(f"{v} vehicles need as many routes, got {len(routes)}")
    autopilots = design(plant, tuple(depth_control or ["pitch"] * v))
    lead = [float(lag) for lag in 0.25 / autopilots["omega"]]
    wanted = reference(routes, np.arange(ticks + 1, dtype=np.float64) * TICK, limits, lead)
    record = np.empty((ticks + 1, v, COLUMNS + plant.thrust.shape[1]))
    memory = np.zeros((v, GUIDANCE_MEMORY)), np.zeros((v, AUTOPILOT_MEMORY))
    command = np.zeros_like(plant.thrust)
    state, water = plant.state, plant.ocean.water
    steering = wanted, autopilots, memory, command
    controller: Controller = RouteController(steering) if make_controller is None else make_controller(plant, steering)

    def leg(k: int, last: int) -> None:
        """Fly from instant k to the last one."""
        try:
            k, fault = controller.fly((k, last, substeps), plant.step_handles(), state, water, record)
            plant.finish_step(fault)
        except PlantError as error:
            flown = _trajectory(plant, record[: k + 1]) if k > 0 else None
            raise FleetError(str(error), error.time, flown) from error

    record_state(0, state, water, record)
    k = 0
    while k < ticks:
        # between these instants nothing from outside is looked at, not even Ctrl-C
        last = min(k + _PROGRESS_TICKS - (k - 1) % _PROGRESS_TICKS, ticks)
        leg(k, last)
        new = record[k : last + 1]
        end = None if ending is None else ending(new[..., POSITION], new[..., QUATERNION])
        if end is not None:
            return _trajectory(plant, record[: max(k + end, 1) + 1])
        if progress is not None and (last - 1) % _PROGRESS_TICKS == 0:
            progress((last - 1) * TICK)
        k = last
    controller.end(ticks, record)
    return _trajectory(plant, record)
