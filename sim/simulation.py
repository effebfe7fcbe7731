"""The simulation loop: controllers, a solver and the water make a Trajectory; or the paper's point
motion makes it.

A controller is a NamedTuple whose `control` is compiled, or any other object with such a method.
There is one loop. With a NamedTuple it is compiled and chooses the method by its type; with any
other object it runs as Python.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, NoReturn, Protocol, Self, SupportsIndex

import numpy as np
from numba import types
from numba.extending import overload_method

from laisn.arrays import Bools, Floats, Ints, Records, records
from laisn.compile_errors import compiling_own
from laisn.compiled import compiled, copy_rows, jitable, method_by_type
from laisn.errors import LaisnError
from laisn.held import Held, held_values, refuse_copy
from laisn.plugins import PluginError, class_and_file
from laisn.spilled import spillable_zeros
from sim import attitude
from sim.assembly import routes_of, setups_of
from sim.attitude import Pose, Twist, Vector
from sim.control.autopilot import (
    AUTOPILOT_MEMORY,
    DepthControl,
    apply_wrench,
    control,
    design,
    true_motion,
)
from sim.control.guidance import (
    GUIDANCE_MEMORY,
    REFERENCE,
    limit_command,
    mission_reference,
    start_guidance,
    steer,
    track_current,
)
from sim.control.stability import least_radius
from sim.scenario.parts import MotionSettings
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from sim.scenario.settings import CONTROL_STEP_S, Leader, Scenario
from sim.tracking import MissionBounds, bounds_of, contacts, first_departure, first_touch
from sim.trajectory import OF_VEHICLES, StateHistory, Trajectory
from sim.vehicle.effectors import Kinds, kinds_of, states_are_thrust
from sim.vehicle.lanes import FleetHandles
from sim.vehicle.plant import Plant, PlantError, PlantState
from sim.vehicle.stepping import OK, Fault, StepHandles
from sim.water.assembly import ocean_of
from sim.water.environment import Environment, water_velocity

TICK = CONTROL_STEP_S  # interval of guidance, autopilot and recording [s]
# code of a failed navigator; the number of its follower, from 1, is given with it
NAVIGATION_FAILED = -1
PROGRESS_TICKS = 500  # ticks from one call of `progress` to the next


class EndedError(LaisnError):
    """A mission that ended before its time; `trajectory` holds what was flown until then."""

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory


class GroundedError(EndedError):
    """A vehicle went below the floor."""


class OffRouteError(EndedError):
    """A vehicle left its route."""


class LeftFieldError(EndedError):
    """A vehicle left the area of a field of the sea."""


class DivergedError(EndedError):
    """The simulation left finite numbers."""


class Controller(Protocol):
    """Computes the commands of all vehicles; its class may be of a user's own, in Python."""

    def control(self, k: int, truth: StateHistory) -> int | None:
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


def navigation_error(follower: int) -> ArithmeticError:
    """That the navigator of a follower, by its number from 1, failed."""
    return ArithmeticError(
        f"the covariance of follower {follower} is not positive definite any more"
    )


class RouteControl(NamedTuple):
    """Controller of v vehicles along their routes, by the truth."""

    kinds: Kinds  # of the effectors that autopilots allocate forces to
    # of `sim.control.guidance.REFERENCE` at all instants, read-only, shape (n, v)
    reference: Records
    autopilot_designs: Records  # of `sim.control.autopilot.AUTOPILOT`, shape (v,)
    guidance: Records  # of GUIDANCE_MEMORY, shape (v,)
    autopilot_memories: Records  # of AUTOPILOT_MEMORY, shape (v,)
    # commanded state of each effector, shape (v, m), each in the unit of its kind: N, revolutions
    # per second [1/s], rad, or that of its curve
    command: Floats
    # vehicles whose commands come from outside: no controller writes these, shape (v,)
    commanded_from_outside: Bools

    @compiled
    def control(self, k: int, truth: StateHistory) -> int:
        """Find the commands of all vehicles; see `Controller.control`."""
        for i in range(self.command.shape[0]):
            if not self.commanded_from_outside[i]:
                steer_along_route(k, truth, i, self)
        return 0


# which writes the `command` of that of routes
ControllerFactory = Callable[[Plant, RouteControl], Controller]


@compiled
def record_state(k: int, state: PlantState, environment: Environment, truth: StateHistory) -> None:
    """Record instant k: the state of a plant, and its water."""
    water_velocity(environment, state.pose[:, :3], k * TICK, truth.water[k])
    copy_rows(state.pose, truth.pose[k])
    copy_rows(state.twist, truth.twist[k])
    copy_rows(state.effector_states, truth.effector_states[k])


@compiled
def steer_along_route(k: int, truth: StateHistory, i: int, routes: RouteControl) -> None:
    """Find the command of vehicle i, by its true motion, that holds from the recorded instant k
    until k + 1.
    """
    state = (truth.pose[k, i], truth.twist[k, i], truth.water[k, i])
    steer_vehicle(k, i, state, routes)


@compiled
def steer_vehicle(
    k: int, i: int, state: tuple[Pose, Twist, Vector | Floats], routes: RouteControl
) -> None:
    """`steer_along_route` by pose, twist and water of the vehicle, which are rows of a
    StateHistory, of one mission or in lanes.
    """
    reference = routes.reference[k, i]
    guidance = routes.guidance[i]
    pose, twist, water = state
    motion = true_motion(pose, twist, water)
    current = (water[0], water[1])
    if k == 0:
        start_guidance(reference, motion.heading, motion.surge, current, guidance)
    track_current(current, TICK, guidance)
    steered = steer(reference, (pose[0], pose[1]), TICK, guidance)
    control(
        routes.kinds,
        routes.autopilot_designs[i],
        steered,
        reference,
        motion,
        TICK,
        routes.autopilot_memories[i],
        routes.command[i],
    )


@compiled
def _hold_by_truth(
    k: int, truth: StateHistory, i: int, command: Floats, reference: Records, routes: RouteControl
) -> None:
    """Find the command of vehicle i, from the recorded instant k on, that holds heading [rad],
    speed through the water [m/s] and depth [m], by its true motion.

    `command` begins with these three, `reference` is room for a record of REFERENCE, shape (1,).
    """
    motion = true_motion(truth.pose[k, i], truth.twist[k, i], truth.water[k, i])
    reference[0].depth = command[2]
    control(
        routes.kinds,
        routes.autopilot_designs[i],
        limit_command(command[0], command[1], TICK, routes.guidance[i]),
        reference[0],
        motion,
        TICK,
        routes.autopilot_memories[i],
        routes.command[i],
    )


@compiled
def _apply_wrench_by_truth(
    k: int, truth: StateHistory, i: int, wrench: Floats, routes: RouteControl
) -> None:
    """Find the command of vehicle i, from the recorded instant k on, whose effectors give a wrench
    about the hull's axes as far as they can; `wrench` begins with its six numbers [N], [N m].
    """
    motion = true_motion(truth.pose[k, i], truth.twist[k, i], truth.water[k, i])
    memory = routes.autopilot_memories[i]
    for j in range(6):
        memory.wrench[j] = wrench[j]
    apply_wrench(routes.kinds, routes.autopilot_designs[i], motion.surge, memory, routes.command[i])


@compiled
def _take_over(k: int, truth: StateHistory, i: int, routes: RouteControl) -> None:
    """Begin the guidance of vehicle i anew where it is, at the recorded instant k."""
    motion = true_motion(truth.pose[k, i], truth.twist[k, i], truth.water[k, i])
    water = truth.water[k, i]
    guidance = routes.guidance[i]
    start_guidance(
        routes.reference[k, i], motion.heading, motion.surge, (water[0], water[1]), guidance
    )


method_by_type("apply")
method_by_type("keep")

# what a vehicle is commanded from outside
NOTHING, MOTION, WRENCH, EFFECTOR_STATES = range(4)


class OutsideCommands(NamedTuple):
    """Commands of v vehicles that come from outside, in the place of their controllers'."""

    kind: Ints  # of each vehicle: NOTHING, …, shape (v,)
    # heading [rad], speed through the water [m/s] and depth [m]; the six numbers of a wrench [N],
    # [N m]; or states of all effectors, shape (v, max(6, m))
    values: Floats
    begins: Bools  # vehicles whose guidance begins anew where they are, shape (v,)
    applied: Ints  # instant from which on they hold, shape (1,): they are worked out once for each
    reference: Records  # room for a record of REFERENCE, shape (1,)

    @classmethod
    def none(cls, vehicles: int, effectors: int) -> Self:
        """Of vehicles that nobody commands."""
        return cls(
            kind=np.full(vehicles, NOTHING),
            values=np.zeros((vehicles, max(6, effectors))),
            begins=np.zeros(vehicles, dtype=np.bool_),
            applied=np.full(1, -1),
            reference=records(REFERENCE, 1),
        )

    @compiled
    def apply(self, k: int, truth: StateHistory, routes: RouteControl) -> None:
        """Work out the commands that hold from the recorded instant k until k + 1."""
        if self.applied[0] == k:
            return
        self.applied[0] = k
        for i in range(self.kind.size):
            if self.begins[i]:
                _take_over(k, truth, i, routes)
                self.begins[i] = False
            if self.kind[i] == MOTION:
                _hold_by_truth(k, truth, i, self.values[i], self.reference, routes)
            elif self.kind[i] == WRENCH:
                _apply_wrench_by_truth(k, truth, i, self.values[i], routes)
            elif self.kind[i] == EFFECTOR_STATES:
                for j in range(routes.command.shape[1]):
                    routes.command[i, j] = self.values[i, j]


class NoCommands(NamedTuple):
    """In the place of `OutsideCommands`, of a mission that nobody commands from outside."""

    vehicles: int

    @compiled
    def apply(self, k: int, truth: StateHistory, routes: RouteControl) -> None:
        """Nothing."""


class InstantRecord(NamedTuple):
    """What f followers read and believe, and have at each of n instants."""

    readings: Floats  # present records of `laisn.swarm.READING` as numbers, shape (f, 8)
    estimates: Floats  # present records of `laisn.swarm.ESTIMATE` as numbers, shape (f, 11)
    readings_at: Floats  # at all instants, shape (n, f, 8)
    estimates_at: Floats  # at all instants, shape (n, f, 11)

    @classmethod
    def empty(cls, instants: int, readings: Floats, estimates: Floats) -> Self:
        """With room for so many instants."""
        return cls(
            readings=readings,
            estimates=estimates,
            readings_at=spillable_zeros((instants, *readings.shape)),
            estimates_at=spillable_zeros((instants, *estimates.shape)),
        )

    @compiled
    def keep(self, k: int) -> None:
        """Record those of instant k."""
        copy_rows(self.readings, self.readings_at[k])
        copy_rows(self.estimates, self.estimates_at[k])


class NoInstantRecord(NamedTuple):
    """In the place of `InstantRecord`, of a mission that nobody looks at under way."""

    followers: int

    @compiled
    def keep(self, k: int) -> None:
        """Nothing."""


class LoopState(NamedTuple):
    """All that the loop of a mission works on."""

    handles: StepHandles | FleetHandles  # of the plant
    state: PlantState  # of the plant
    environment: Environment
    controller: Controller
    outside: OutsideCommands | NoCommands
    seen: InstantRecord | NoInstantRecord
    routes: RouteControl  # which holds the commands of all effectors
    truth: StateHistory
    instants: Ints  # how many are over, shape (1,)
    substeps: int  # physics steps from one instant to the next


@jitable
def _simulate(first: int, last: int, loop: LoopState) -> tuple[int, Fault]:
    """Step, record and control from one instant to another.

    Gives the last instant that is recorded, and what ended the simulation.
    """
    for k in range(first, last + 1):
        if k > 0:
            loop.outside.apply(k - 1, loop.truth, loop.routes)
            fault = loop.handles.run_steps(loop.routes.command, loop.substeps)
            if fault[0] != OK:
                return k - 1, fault
        record_state(k, loop.state, loop.environment, loop.truth)
        failed = loop.controller.control(k, loop.truth)
        if failed:
            return k, (NAVIGATION_FAILED, failed)
        loop.seen.keep(k)
        loop.instants[0] = k + 1
    return last, (OK, -1)


@compiled
def _simulate_held(first: int, last: int, held: Held) -> tuple[int, Fault]:
    """`_simulate`, compiled."""
    return _simulate(first, last, held_values(held))


def _trajectory(plant: Plant, truth: StateHistory, first: int = 0) -> Trajectory:
    """The motion of two instants or more, of which the first has this number; the arrays are no
    longer written to.
    """
    for array in truth:
        array.flags.writeable = False
    return Trajectory(
        names=plant.names,
        time=np.arange(first, first + len(truth.pose), dtype=np.float64) * TICK,
        **dict(zip(OF_VEHICLES, truth, strict=True)),
        site_names=plant.site_names,
        site_vehicle=plant.site_vehicle,
        site_offset=plant.site_offset,
        effector_names=plant.effector_names,
        effector_force=plant.effectors["force"] * states_are_thrust(plant.effectors)[..., None],
    )


def static_trajectory(plant: Plant) -> Trajectory:
    """A plant as it stands, as a trajectory of two equal instants: for settings that depend on
    the hulls.
    """
    truth = StateHistory.empty(2, *plant.effector_states.shape)
    for k in range(2):
        record_state(k, plant.state, plant.ocean.environment, truth)
    return _trajectory(plant, truth)


@dataclass(frozen=True, kw_only=True)
class Block:
    """Consecutive instants of a mission, which observers get once; arrays can only be read."""

    names: tuple[str, ...]  # of the v vehicles
    time: Floats  # since the start, shape (n,), [s]
    truth: StateHistory  # of all vehicles, shapes (n, v, …)


Observer = Callable[[Block], object]


class Mission:
    """Vehicles of a plant under way, with what controls them and what is recorded until now.

    Attributes:
        plant: the vehicles in the ocean.
        controller: of all vehicles.
        truth: their motion, with room for n + 1 instants 0.1 s apart.
        observers: each gets every block of instants once, in order.
    """

    def __init__(
        self,
        plant: Plant,
        routes: Sequence[Route],
        duration: float,
        depth_control: Sequence[DepthControl | None] = (),
        make_controller: ControllerFactory | None = None,
    ) -> None:
        """Set out along a route each, for a time [s] of 0.1 s times n; see `simulate`."""
        self.plant = plant
        ticks = round(duration / TICK)
        v = len(plant.names)
        autopilot_designs = design(plant, tuple(depth_control or ["pitch"] * v))
        # how early accelerations are given, for the lag of the autopilot [s]
        lead = tuple((0.25 / autopilot_designs["omega"]).tolist())
        least_radii = tuple(least_radius(plant, i, d) for i, d in enumerate(autopilot_designs))
        self.routes = RouteControl(
            kinds=kinds_of(autopilot_designs["effectors"]),
            reference=mission_reference(tuple(routes), ticks, lead, least_radii),
            autopilot_designs=autopilot_designs,
            guidance=records(GUIDANCE_MEMORY, v),
            autopilot_memories=records(AUTOPILOT_MEMORY, v),
            command=np.zeros_like(plant.effector_states),
            commanded_from_outside=np.zeros(v, dtype=np.bool_),
        )
        self.controller: Controller = self.routes
        if make_controller is not None:
            self.controller = make_controller(plant, self.routes)
        self.truth = StateHistory.empty(ticks + 1, *plant.effector_states.shape)
        self._instants = np.zeros(1, dtype=np.int64)
        self._loop = LoopState(
            handles=plant.step_handles(),
            state=plant.state,
            environment=plant.ocean.environment,
            controller=self.controller,
            outside=NoCommands(v),
            seen=NoInstantRecord(v - 1),
            routes=self.routes,
            truth=self.truth,
            instants=self._instants,
            substeps=round(TICK / plant.dt),
        )
        self.observers: list[Observer] = []
        self._observed = 0  # how many instants observers got
        self._looked_at = 0  # at how many it was looked whether they end the mission

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)

    def take_commands(self) -> OutsideCommands:
        """The commands from outside, which the mission obeys from now on; before its first
        instant.
        """
        outside = OutsideCommands.none(*self.routes.command.shape)
        self._loop = self._loop._replace(outside=outside)
        return outside

    def keep_instants(self, readings: Floats, estimates: Floats) -> InstantRecord:
        """What followers read and believe at each instant from now on, by the arrays that hold what
        they do at present; before the first instant.
        """
        seen = InstantRecord.empty(self.last + 1, readings, estimates)
        self._loop = self._loop._replace(seen=seen)
        return seen

    @property
    def instants(self) -> int:
        """How many instants are recorded."""
        return int(self._instants[0])

    @instants.setter
    def instants(self, number: int) -> None:
        self._instants[0] = number

    @property
    def last(self) -> int:
        """The last instant that there is room for."""
        return len(self.truth.pose) - 1

    @cached_property
    def _held(self) -> Held | None:
        """What the loop works on, as compiled code takes it; None: a controller is in Python."""
        return Held(self._loop) if isinstance(self.controller, tuple) else None

    def held_alone(self) -> Held | None:
        """The same with vehicles that move one after the other, for `sim.mission_group`."""
        if self._held is None or isinstance(self._loop.handles, StepHandles):
            return self._held
        return Held(self._loop._replace(handles=self.plant.handles_alone))

    def end_advance(self) -> None:
        """Take over what was flown by `sim.mission_group`."""
        self.plant.finish_step((OK, -1))

    def advance(self, last: int) -> None:
        """Fly, control and record until an instant; nothing from outside is looked at meanwhile,
        not even Ctrl-C.

        DivergedError if the simulation left finite numbers, PlantError if at its start, PluginError
        if by a controller or an effector of the user's own; ArithmeticError naming the follower
        whose navigator failed.
        """
        plant = self.plant
        plant.set_clock()
        end = min(last, self.last)
        if self._held is None:
            k, fault = _simulate(self.instants, end, self._loop)
        else:
            with compiling_own(f"controller {class_and_file(self.controller)}"):
                k, fault = _simulate_held(self.instants, end, self._held)
        plant.ocean.raise_custom_error()
        if fault[0] == NAVIGATION_FAILED:
            raise navigation_error(fault[1])
        self.instants = k + 1
        try:
            plant.finish_step(fault)
        except PlantError as error:
            text = str(error)
            self._require_finite_command(k, text)
            if k < 1:
                raise PlantError(text) from error
            raise DivergedError(text, self.trajectory()) from error

    def _require_finite_command(self, k: int, consequence: str) -> None:
        """PluginError if the controller is the user's own and has commanded no finite numbers,
        which is no way in which a mission ends.
        """
        lost = np.flatnonzero(~np.isfinite(self.routes.command).all(axis=1))
        if not lost.size or type(self.controller).__module__.partition(".")[0] == "sim":
            return
        vehicle, command = self.plant.names[lost[0]], self.routes.command[lost[0]].tolist()
        raise PluginError(
            f"controller {class_and_file(self.controller)} commanded {vehicle} {command} at "
            f"{k * TICK:g} s; expected finite numbers; {consequence}"
        )

    def advance_within(
        self, last: int, *, until_contact: bool = False, bounds: MissionBounds | None = None
    ) -> bool:
        """Advance until an instant, hulls touch or a vehicle leaves the bounds; whether one of
        these ends the mission, of which nothing later is kept then. Errors as of `advance`.

        Parts in Python are called at no instant after such an end; compiled ones may be.
        """
        end = min(last, self.last)
        at_once = 1 if self._held is None else self.last
        ended = False
        error: Exception | None = None
        while not (ended or error):
            try:
                if self.instants <= end:
                    self.advance(min(end, max(self.instants - 1, 0) + at_once))
            except (DivergedError, ArithmeticError) as failure:
                error = failure
            ended = self._end_within(self._looked_at, until_contact, bounds)
            self._looked_at = self.instants
            if self.instants > end:
                break
        self._show_block()
        if error and not ended:
            raise error
        return ended

    def _end_within(self, first: int, until_contact: bool, bounds: MissionBounds | None) -> bool:
        """Whether hulls touch or a vehicle leaves the bounds from an instant on; drops what is
        later.
        """
        poses = self.truth.pose[first : self.instants]
        ends = [first_touch(poses)] if until_contact else []
        if bounds is not None:
            time = np.arange(first, self.instants, dtype=np.float64) * TICK
            departure = first_departure(time, poses, bounds)
            ends.append(None if departure is None else departure.instant)
        ended = min((instant for instant in ends if instant is not None), default=None)
        if ended is None:
            return False
        self.instants = max(first + ended, 1) + 1
        return True

    def _show_block(self) -> None:
        """Give observers the instants since the last block."""
        first = self._observed
        self._observed = self.instants
        if not self.observers or first == self.instants:
            return
        values = [array[first : self.instants] for array in self.truth]
        for array in values:
            array.flags.writeable = False
        time = np.arange(first, self.instants, dtype=np.float64) * TICK
        block = Block(names=self.plant.names, time=time, truth=StateHistory(*values))
        for observer in self.observers:
            observer(block)

    def fly(
        self,
        *,
        until_contact: bool = False,
        bounds: MissionBounds | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Trajectory:
        """Advance to the end, until hulls touch or a vehicle leaves the bounds; see `simulate`.
        Gives the motion.
        """
        last = self.last
        for end in sorted({1, *range(PROGRESS_TICKS, last, PROGRESS_TICKS), last}):
            if self.advance_within(end, until_contact=until_contact, bounds=bounds):
                break
            if progress is not None and end < last:
                progress(end // PROGRESS_TICKS * PROGRESS_TICKS * TICK)
        return self.trajectory()

    def end_flight(
        self, *, until_contact: bool = False, bounds: MissionBounds | None = None
    ) -> Trajectory:
        """The motion of a mission that was flown to its end elsewhere, until hulls touch or a
        vehicle leaves the bounds.
        """
        self.instants = self.last + 1
        self._end_within(0, until_contact, bounds)
        return self.trajectory()

    def trajectory(self) -> Trajectory:
        """The motion until now, of two instants or more; a copy where the mission goes on."""
        truth = self.truth
        if self.instants <= self.last:
            truth = StateHistory(*(array[: self.instants].copy() for array in truth))
        return _trajectory(self.plant, truth)

    def motion_since(self, first: int) -> Trajectory:
        """A copy of the motion from an instant until now, of two instants or more."""
        recorded = (array[first : self.instants].copy() for array in self.truth)
        return _trajectory(self.plant, StateHistory(*recorded), first)


def simulate(
    plant: Plant,
    routes: Sequence[Route],
    duration: float,
    depth_control: Sequence[DepthControl | None] = (),
    *,
    make_controller: ControllerFactory | None = None,
    until_contact: bool = False,
    bounds: MissionBounds | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Simulate all vehicles of a plant, from where they are, along a route each for a time [s], a
    multiple of 0.1 s.

    `depth_control` is of each vehicle, as of `design`; empty: "pitch" for all. `make_controller`
    makes another controller than that of routes. `until_contact` ends the flight where hulls touch,
    `bounds` where a vehicle leaves them. `progress` is called with the mission time [s], every 50 s
    of it. Gives the truth every 0.1 s.

    LaisnError if a route cannot be flown; DivergedError if the simulation left finite numbers,
    PlantError if at its start; ArithmeticError naming the follower whose navigator failed.
    """
    mission = Mission(plant, routes, duration, depth_control, make_controller)
    return mission.fly(until_contact=until_contact, bounds=bounds, progress=progress)


def _require_within(trajectory: Trajectory, bounds: MissionBounds) -> None:
    """GroundedError, LeftFieldError or OffRouteError where a vehicle is out of bounds at the end of
    a flight.
    """
    last = trajectory.time.size - 1
    departure = first_departure(trajectory.time[last:], trajectory.pose[last:], bounds)
    if departure is None:
        return
    time = trajectory.time[last]
    name = trajectory.names[departure.vehicle]
    if departure.left_field:
        raise LeftFieldError(
            f"at {time:g} s {name} left the area of {departure.left_field} about the planned "
            "routes, which ended the mission",
            trajectory,
        )
    if departure.off_route_m is None:
        raise GroundedError(
            f"at {time:g} s {name} went below the floor, which ended the mission", trajectory
        )
    raise OffRouteError(
        f"at {time:g} s {name} was {departure.off_route_m:.0f} m off its route, which ended the "
        "mission",
        trajectory,
    )


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
        effector_states=np.zeros((n, v, 0)),
        effector_force=np.zeros((v, 0, 3)),
        site_names=plant.site_names if plant else (),
        site_vehicle=plant.site_vehicle if plant else np.zeros(0, np.int64),
        site_offset=plant.site_offset if plant else np.zeros((0, 3)),
    )


def plant_of(
    motion: MotionSettings,
    routes: tuple[Route, ...],
    transmitter_keys: Leader | None = None,
    *,
    settled: bool = True,
) -> Plant:
    """Vehicles in their sea at the start of their routes, with transmitters as of `setups_of`, and
    `settled` as of `Plant`; LaisnError if the sea is none.
    """
    setups = setups_of(motion.plan, routes, transmitter_keys)
    ocean = ocean_of(motion.sea)
    return Plant(setups, ocean, motion.physics_step_s, motion.engine, settled=settled)


def require_physics(name: str, motion: str) -> None:
    """LaisnError naming a scenario if its vehicles move as points."""
    if motion != "physics":
        raise LaisnError(
            f"scenario {name!r}: motion is {motion!r}, whose path is no mission that can be "
            "controlled; expected 'physics'"
        )


def new_mission(scenario: Scenario, make_controller: ControllerFactory | None = None) -> Mission:
    """A scenario's mission before its first instant, of rigid bodies in water.

    LaisnError if a route cannot be flown, the sea is impossible, or vehicles move as points.
    """
    require_physics(scenario.name, scenario.motion)
    return _mission_of(MotionSettings.of(scenario), scenario.leader, make_controller)


def _mission_of(
    motion: MotionSettings,
    transmitter_keys: Leader | None,
    make_controller: ControllerFactory | None = None,
) -> Mission:
    """A mission of rigid bodies before its first instant, with transmitters as of `plant_of`."""
    routes = routes_of(motion.plan)
    depth_control = [vehicle.depth_control for _, vehicle in motion.plan.vehicles()]
    plant = plant_of(motion, routes, transmitter_keys)
    return Mission(plant, routes, motion.plan.duration_s, depth_control, make_controller)


def mission_for_lanes(motion: MotionSettings) -> Mission:
    """A mission of rigid bodies before its first instant, to be flown by `sim.side_by_side`."""
    routes = routes_of(motion.plan)
    depth_control = [vehicle.depth_control for _, vehicle in motion.plan.vehicles()]
    plant = plant_of(motion, routes, settled=False)
    return Mission(plant, routes, motion.plan.duration_s, depth_control)


def end_mission(motion: MotionSettings, mission: Mission) -> Trajectory:
    """The motion of a mission that was flown to its end elsewhere; errors as of
    `simulate_motion`.
    """
    bounds = bounds_of(motion)
    ends = motion.contact == "end"
    trajectory = mission.end_flight(until_contact=ends, bounds=bounds)
    return require_regular_end(trajectory, bounds, ends_on_contact=ends)


def fly_mission(
    motion: MotionSettings, mission: Mission, progress: Callable[[float], None] | None = None
) -> Trajectory:
    """Fly a mission of such motion to its end; errors and `progress` are as of
    `simulate_motion`.
    """

    def show_time(time: float) -> None:
        if progress is not None:
            progress(time / motion.plan.duration_s)

    bounds = bounds_of(motion)
    ends = motion.contact == "end"
    trajectory = mission.fly(until_contact=ends, bounds=bounds, progress=show_time)
    return require_regular_end(trajectory, bounds, ends_on_contact=ends)


def require_regular_end(
    trajectory: Trajectory, bounds: MissionBounds, *, ends_on_contact: bool
) -> Trajectory:
    """The motion of a mission; GroundedError, LeftFieldError, OffRouteError or ContactError if that
    ended it.
    """
    _require_within(trajectory, bounds)
    return _require_no_contact(trajectory) if ends_on_contact else trajectory


def _require_no_contact(trajectory: Trajectory) -> Trajectory:
    """The motion; ContactError if vehicles touched."""
    collisions = contacts(trajectory)
    if not collisions:
        return trajectory
    time, (first, second) = collisions[0]
    contact_text = f"at {time:g} s {first} and {second} touched, which ended the mission"
    raise ContactError(contact_text, trajectory.part(0, max(round(time / trajectory.dt), 1)))


def simulate_motion(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> Trajectory:
    """Simulate a scenario's vehicles: rigid bodies in water, or point motion in still water with
    the same sites.

    `progress` is called now and then with the share that is done, 0 … 1. `make_controller` makes
    another controller than that of routes; that of `sim.closed_loop` is needed if there are
    `Scenario.keys_needing_closed_loop`.

    LaisnError if a route cannot be flown, the sea is impossible, or that controller is missing;
    DivergedError if the simulation left finite numbers; GroundedError, LeftFieldError or
    OffRouteError if a vehicle went below the floor, left the area of a field of the sea or left its
    route (`sim.tracking.bounds_of`); ContactError if vehicles touched in a scenario whose missions
    end with that.
    """
    if make_controller is None:
        require_open_loop(scenario.name, scenario.keys_needing_closed_loop())
    motion = MotionSettings.of(scenario)
    if scenario.motion == "kinematic":
        return simulate_open_loop(motion, scenario.leader)
    mission = _mission_of(motion, scenario.leader, make_controller)
    return fly_mission(motion, mission, progress)


def starts_of(motion: MotionSettings, transmitter_keys: Leader) -> Trajectory:
    """Two control steps of vehicles as points along their routes, for their starts and sites:
    whatever steers them after that, also what is sensed under way.

    Transmitters are as of `setups_of`; LaisnError if a route cannot be flown, or the sea is none.
    """
    routes = routes_of(motion.plan)
    plant = plant_of(motion, routes, transmitter_keys, settled=False)
    return simulate_points(motion.plan.names, routes, 2.0 * CONTROL_STEP_S, plant)


def require_open_loop(name: str, keys: Sequence[str]) -> None:
    """LaisnError naming a scenario and the first of its keys that need a closed loop, if any."""
    if keys:
        raise LaisnError(
            f"scenario {name!r}: {keys[0]}: its path depends on the noise of the run, so "
            "that no campaign can fly it once for all runs; use `laisn fly --run N`"
        )


def simulate_open_loop(
    motion: MotionSettings,
    transmitter_keys: Leader | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Motion that follows from these settings alone: vehicles keep to their routes by the truth.

    Transmitters are as of `setups_of`; errors and `progress` are as of `simulate_motion`.
    """
    if motion.kind == "physics":
        return fly_mission(motion, _mission_of(motion, transmitter_keys), progress)
    routes = routes_of(motion.plan)
    plant = plant_of(motion, routes, transmitter_keys, settled=False)
    trajectory = simulate_points(motion.plan.names, routes, motion.plan.duration_s, plant)
    return _require_no_contact(trajectory) if motion.contact == "end" else trajectory
