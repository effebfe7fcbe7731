"""The simulation loop: controllers, MuJoCo and the water make a Trajectory; or the paper's point
motion makes it.

A controller is a NamedTuple whose `control` is compiled, or any other object with such a method.
There is one loop. With a NamedTuple it is compiled and chooses the method by its type; with any
other object it runs as Python.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numba import types
from numba.extending import overload_method

from laisn.arrays import Floats, Records, records
from laisn.compiled import compiled, copy_values
from laisn.failure import LaisnError
from sim import attitude
from sim.assembly import ocean_of, routes_of, setups_of, vehicle_names
from sim.control.autopilot import AUTOPILOT_MEMORY, DepthControl, control, design, vehicle_state
from sim.control.guidance import GUIDANCE_MEMORY, begin, reference, steer, track_current
from sim.control.stability import least_radius
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.tracking import contacts, first_touch
from sim.trajectory import OF_VEHICLES, Trajectory, Truth
from sim.vehicle.effectors import THRUSTER
from sim.vehicle.plant import FINE, Fault, Plant, PlantError, advance
from sim.water import Water, water_velocity

TICK = CONTROL_STEP_S  # interval of guidance, autopilot and recording [s]
# code of a failed navigator; the number of its follower, from 1, is given with it
NAVIGATION_FAILED = -1
_PROGRESS_TICKS = 500


class EndedError(LaisnError):
    """A mission that ended before its time; `trajectory` holds what was flown until then."""

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory


class DivergedError(EndedError):
    """The simulation left finite numbers."""


class Controller(Protocol):
    """Computes the commands of all vehicles; its class may be of a user's own, in Python."""

    def control(self, k: int, truth: Truth) -> int | None:
        """Write the commands that hold from instant k until k + 1 into the array that it was made
        with.

        All instants are controlled in order, the last one as well; later ones of the truth hold no
        values yet. Returns the number, from 1, of the follower whose navigator failed; 0 or None if
        none did.
        """


@overload_method(types.BaseNamedTuple, "control", inline="always")
def _control(controller, k, truth):  # type: ignore[no-untyped-def]
    method = getattr(controller.instance_class, "control", None)
    return method and (lambda controller, k, truth: method(controller, k, truth))


class RouteControl(NamedTuple):
    """Controller of v vehicles along their routes, by the truth."""

    reference: Records  # of `sim.control.guidance.REFERENCE` at all instants, shape (n, v)
    autopilots: Records  # of `sim.control.autopilot.DESIGN`, shape (v,)
    guidance: Records  # of GUIDANCE_MEMORY, shape (v,)
    autopilot: Records  # of AUTOPILOT_MEMORY, shape (v,)
    command: Floats  # commanded thrust of each effector, shape (v, m), [N]

    @compiled
    def control(self, k: int, truth: Truth) -> int:
        """Find the commands of all vehicles; see `Controller.control`."""
        for i in range(self.command.shape[0]):
            steer_along_route(k, truth, i, self)
        return 0


# which writes the `command` of that of routes
ControllerFactory = Callable[[Plant, RouteControl], Controller]


@compiled
def record_state(k: int, state: tuple[Floats, Floats, Floats], water: Water, truth: Truth) -> None:
    """Record instant k: pose, twist and thrust of a plant, and its water."""
    pose, twist, thrust = state
    water_velocity(pose[:, :3], k * TICK, water, truth.water[k])
    for i in range(pose.shape[0]):
        copy_values(pose[i], truth.pose[k, i])
        copy_values(twist[i], truth.twist[k, i])
        copy_values(thrust[i], truth.thrust[k, i])


@compiled
def steer_along_route(k: int, truth: Truth, i: int, routes: RouteControl) -> None:
    """Find the command of vehicle i, by its true motion, that holds from the recorded instant k
    until k + 1.
    """
    reference = routes.reference[k, i]
    guidance = routes.guidance[i]
    pose = truth.pose[k, i]
    water = truth.water[k, i]
    motion = vehicle_state(pose, truth.twist[k, i], water)
    current = (water[0], water[1])
    if k == 0:
        begin(reference, motion.heading, motion.surge, current, guidance)
    track_current(current, TICK, guidance)
    steered = steer(reference, (pose[0], pose[1]), TICK, guidance)
    control(
        routes.autopilots[i],
        steered,
        reference,
        motion,
        TICK,
        routes.autopilot[i],
        routes.command[i],
    )


@compiled
def _simulate(
    span: tuple[int, int, int],
    plant: tuple[Any, tuple[Floats, Floats, Floats], Water],
    controller: Controller,
    command: Floats,
    truth: Truth,
) -> tuple[int, Fault]:
    """Step, record and control from the first to the last instant of `span`, with so many physics
    steps in between.

    Gives the last instant that is recorded, and what ended the simulation.
    """
    first, last, substeps = span
    handles, state, water = plant
    for k in range(first, last + 1):
        if k > 0:
            fault = advance(handles, command, substeps)
            if fault[0] != FINE:
                return k - 1, fault
        record_state(k, state, water, truth)
        failed = controller.control(k, truth)
        if failed:
            return k, (NAVIGATION_FAILED, failed)
    return last, (FINE, -1)


def _trajectory(plant: Plant, truth: Truth, instants: int) -> Trajectory:
    """What is recorded of the first instants, which are two or more; the arrays are no longer
    written to.
    """
    for array in truth:
        array.flags.writeable = False
    return Trajectory(
        names=plant.names,
        time=np.arange(instants, dtype=np.float64) * TICK,
        **dict(zip(OF_VEHICLES, (array[:instants] for array in truth), strict=True)),
        site_names=plant.site_names,
        site_vehicle=plant.site_vehicle.copy(),
        site_offset=plant.site_offset.copy(),
        effector_names=plant.effector_names,
        effector_force=plant.effectors["force"] * (plant.effectors["kind"] == THRUSTER)[..., None],
    )


def standing(plant: Plant) -> Trajectory:
    """A plant as it stands, as a trajectory of two equal instants: for settings that depend on
    the hulls.
    """
    truth = Truth.empty(2, *plant.thrust.shape)
    for k in range(2):
        record_state(k, plant.state, plant.ocean.water, truth)
    return _trajectory(plant, truth, 2)


def simulate(
    plant: Plant,
    routes: Sequence[Route],
    duration: float,
    depth_control: Sequence[DepthControl | None] = (),
    *,
    make_controller: ControllerFactory | None = None,
    until_contact: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate all vehicles of a plant, from where they are, along a route each for a time [s], a
    multiple of 0.1 s.

    `depth_control` is of each vehicle, as of `design`; empty: "pitch" for all. `make_controller`
    makes another controller than that of routes. `until_contact` ends the flight where hulls touch.
    `progress` is called with the mission time [s], every 50 s of it. Gives the truth every 0.1 s.

    LaisnError if a route cannot be flown; DivergedError if the simulation left finite numbers,
    PlantError if at its start; ArithmeticError naming the follower whose navigator failed.
    """
    substeps = round(TICK / plant.dt)
    ticks = round(duration / TICK)
    v = len(plant.names)
    autopilots = design(plant, tuple(depth_control or ["pitch"] * v))
    lead = [float(lag) for lag in 0.25 / autopilots["omega"]]
    radii = [least_radius(plant, i, d) for i, d in enumerate(autopilots)]
    wanted = reference(routes, np.arange(ticks + 1, dtype=np.float64) * TICK, lead, radii)
    memory = records(GUIDANCE_MEMORY, v), records(AUTOPILOT_MEMORY, v)
    along = RouteControl(wanted, autopilots, *memory, np.zeros_like(plant.thrust))
    controller = along if make_controller is None else make_controller(plant, along)
    loop = _simulate if isinstance(controller, tuple) else cast(Any, _simulate).py_func
    truth = Truth.empty(ticks + 1, *plant.thrust.shape)
    first = 0
    for last in sorted({1, *range(_PROGRESS_TICKS, ticks, _PROGRESS_TICKS), ticks}):
        # between these instants nothing from outside is looked at, not even Ctrl-C
        handles = plant.step_handles(), plant.state, plant.ocean.water
        k, fault = loop((first, last, substeps), handles, controller, along.command, truth)
        if fault[0] == NAVIGATION_FAILED:
            raise ArithmeticError(
                f"the covariance of follower {fault[1]} is not positive definite any more"
            )
        try:
            plant.finish_step(fault)
        except PlantError as error:
            if k < 1:
                raise
            raise DivergedError(str(error), _trajectory(plant, truth, k + 1)) from error
        end = first_touch(truth.pose[first : last + 1]) if until_contact else None
        if end is not None:
            return _trajectory(plant, truth, max(first + end, 1) + 1)
        if progress is not None and last < ticks:
            progress(last // _PROGRESS_TICKS * _PROGRESS_TICKS * TICK)
        first = last + 1
    return _trajectory(plant, truth, ticks + 1)


class ContactError(EndedError):
    """Vehicles touched, in a scenario whose missions end with that."""


def simulate_points(
    names: tuple[str, ...], routes: Sequence[Route], duration: float, plant: Plant | None = None
) -> Trajectory:
    """Point motion for a time [s]: level hulls on their courses, with a plant's sites, in still
    water, no thrust.
    """
    time: Floats = (
        np.arange(round(duration / CONTROL_STEP_S) + 1, dtype=np.float64) * CONTROL_STEP_S
    )
    n = time.size
    v = len(routes)
    pose = np.empty((n, v, 7))
    twist = np.zeros((n, v, 6))
    for i, route in enumerate(routes):
        motion = plan(route).at(time)
        depth, sinking = route.depth.at(time)
        pose[:, i] = np.column_stack(
            [motion.east, motion.north, -depth, attitude.from_euler(motion.course)]
        )
        level = motion.speed * np.array([np.sin(motion.course), np.cos(motion.course)])
        twist[:, i, :3] = np.column_stack([*level, -sinking])
        twist[:, i, 5] = -motion.turn_rate
    return Trajectory(
        names=names,
        time=time,
        pose=pose,
        twist=twist,
        water_velocity=np.zeros((n, v, 3)),
        thrust=np.zeros((n, v, 0)),
        effector_force=np.zeros((v, 0, 3)),
        site_names=plant.site_names if plant else (),
        site_vehicle=plant.site_vehicle if plant else np.zeros(0, np.int64),
        site_offset=plant.site_offset if plant else np.zeros((0, 3)),
    )


def listeners(scenario: Scenario) -> list[str]:
    """Keys by which the motion of followers depends on their estimates: stations, or steering by
    them.
    """
    followers = list(enumerate(scenario.followers))
    kept = [f"followers.{i}.station" for i, follower in followers if follower.station]
    kept += [f"followers.{i}.controller" for i, follower in followers if follower.controller]
    return kept + [
        f"followers.{i}.guidance_position = 'estimate'"
        for i, f in followers
        if f.guided_by_estimate
    ]


def simulate_motion(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> Trajectory:
    """Simulate a scenario's vehicles: rigid bodies in water, or point motion in still water with
    the same sites.

    `progress` is called now and then with the share that is done, 0 … 1. `make_controller` makes
    another controller than that of routes; that of `sim.closed_loop` is needed if there are
    `listeners`.

    LaisnError if a route cannot be flown, the sea is impossible, or that controller is missing;
    DivergedError if the simulation left finite numbers; ContactError if vehicles touched, which
    ends the scenario's mission.
    """
    keys = listeners(scenario)
    if keys and make_controller is None:
        raise LaisnError(
            f"scenario {scenario.name!r}: {keys[0]}: its path depends on the noise of the run, so "
            "that no campaign can fly it once for all runs; use `laisn fly --run N`"
        )
    routes = routes_of(scenario)
    plant = Plant(setups_of(scenario, routes), ocean_of(scenario), scenario.timing.physics_step_s)
    if scenario.motion == "kinematic":
        trajectory = simulate_points(vehicle_names(scenario), routes, scenario.duration_s, plant)
    else:
        trajectory = simulate(
            plant,
            routes,
            scenario.duration_s,
            [vehicle.depth_control for vehicle in (scenario.leader, *scenario.followers)],
            make_controller=make_controller,
            until_contact=scenario.contact == "end",
            progress=None
            if progress is None
            else lambda time: progress(time / scenario.duration_s),
        )
    met = contacts(trajectory) if scenario.contact == "end" else []
    if not met:
        return trajectory
    time, (one, other) = met[0]
    touched = f"at {time:g} s {one} and {other} touched, which ended the mission"
    raise ContactError(touched, trajectory.part(0, max(round(time / trajectory.dt), 1)))
