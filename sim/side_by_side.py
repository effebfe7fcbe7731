"""Missions side by side: up to eight whose motion depends on no noise, each in a lane of its own.

The physics is that of `sim.vehicle.stepping.advance`, the control that of
`sim.simulation.steer_vehicle`, both compiled for lanes (`laisn.simd`). A mission moves in a lane as
it does alone with the solver "direct", to the bit, whatever flies beside it.

No vehicle depends on another. One that is the same in all missions of a group, as a leader is where
followers are varied, is flown in the first group and then known.
"""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, Self, TypeVar

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Records, have_same_bits, numbers_of
from laisn.compiled import compiled
from laisn.errors import LaisnError
from laisn.held import borrowed_values
from laisn.simd import LANES, in_lanes, lanes_of
from sim.scenario.parts import MotionSettings
from sim.simulation import (
    TICK,
    Mission,
    RouteControl,
    end_mission,
    mission_for_lanes,
    simulate_open_loop,
    steer_vehicle,
)
from sim.trajectory import StateHistory, Trajectory
from sim.vehicle.effectors import Kinds
from sim.vehicle.lanes import (
    MAX_ALONE,
    LaneMotion,
    handles_of_lanes,
    handles_of_vehicles,
    lane_motion_of,
    suits_lanes,
)
from sim.vehicle.stepping import OK, Fault, StepHandles, advance
from sim.water.environment import Environment, sea_at, velocity_of_water


class LaneMemory(NamedTuple):
    """Motion and control of v vehicles of each mission, the lanes along the last axis; records are
    of lanes.
    """

    vehicles: Ints  # their numbers in each mission, shape (v,)
    motion: LaneMotion
    water: Floats  # velocity of the water at the vehicles, shape (v, 3, LANES), [m/s]
    reference: Records  # as of `RouteControl`, shape (n, v), as are the next three, shape (v,)
    autopilot_designs: Records
    guidance: Records
    autopilot_memories: Records
    commanded_from_outside: Bools  # as of `RouteControl`: none is


def _columns(table: Records, vehicles: Ints) -> Records:
    """Columns of a table of records of doubles, shape (n, v); NumPy copies records one by one, and
    numbers eight times as fast.
    """
    return np.take(numbers_of(table), vehicles, axis=1).view(table.dtype)[..., 0]


def _memory_of(missions: Sequence[Mission], vehicles: Ints) -> LaneMemory:
    """States of vehicles of missions whose plants are not settled, side by side; ValueError if they
    differ in more than numbers.
    """
    handles = [mission.plant.handles_alone for mission in missions]
    motion = lane_motion_of([handles_of_vehicles(each, vehicles) for each in handles])
    routes = [mission.routes for mission in missions]
    v = len(vehicles)
    return LaneMemory(
        vehicles=vehicles,
        motion=motion,
        water=np.zeros((v, 3, LANES)),
        reference=in_lanes([_columns(each.reference, vehicles) for each in routes]),
        autopilot_designs=in_lanes([each.autopilot_designs[vehicles] for each in routes]),
        guidance=in_lanes([each.guidance[vehicles] for each in routes]),
        autopilot_memories=in_lanes([each.autopilot_memories[vehicles] for each in routes]),
        commanded_from_outside=np.zeros(v, dtype=np.bool_),
    )


@compiled
def _record_water(k: int, memory: LaneMemory, environment: Environment) -> None:
    """Find the water at all vehicles at instant k."""
    pose = lanes_of(memory.motion.pose)
    out = lanes_of(memory.water)
    sea = sea_at(environment, k * TICK)
    for i in range(pose.shape[0]):
        point = (pose[i, 0], pose[i, 1], pose[i, 2])
        u = velocity_of_water(sea, point)
        out[i, 0] = u[0]
        out[i, 1] = u[1]
        out[i, 2] = u[2]


@compiled
def _copy_lane(values: Floats, lane: int, vehicles: Ints, out: Floats) -> None:
    """Copy a lane of rows of values to the rows of `out` that have these numbers."""
    for i in range(vehicles.size):
        for j in range(out.shape[1]):
            out[vehicles[i], j] = values[i, j, lane]


@compiled
def _copy_all(source: Floats, target: Floats) -> None:
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            for lane in range(LANES):
                target[i, j, lane] = source[i, j, lane]


@compiled
def _settle(memory: LaneMemory, handles: StepHandles) -> Fault:
    """Find the accelerations at the start, on which the first step depends, by a step that is taken
    back, as `Plant` does for its own.
    """
    pose = memory.motion.pose.copy()
    twist = memory.motion.twist.copy()
    fault = advance(handles, lanes_of(memory.motion.command), 1)
    _copy_all(pose, memory.motion.pose)
    _copy_all(twist, memory.motion.twist)
    _copy_all(np.zeros(memory.motion.states.shape), memory.motion.states)
    memory.motion.clock[0] = 0.0
    return fault


@compiled
def _routes_of(memory: LaneMemory, kinds: Kinds) -> RouteControl:
    """The control of all missions, in lanes."""
    return RouteControl(
        kinds,
        lanes_of(memory.reference),
        lanes_of(memory.autopilot_designs),
        lanes_of(memory.guidance),
        lanes_of(memory.autopilot_memories),
        lanes_of(memory.motion.command),
        memory.commanded_from_outside,
    )


@compiled
def _steer(k: int, memory: LaneMemory, routes: RouteControl) -> None:
    """Find the commands of all vehicles from instant k on."""
    poses = lanes_of(memory.motion.pose)
    twists = lanes_of(memory.motion.twist)
    water = lanes_of(memory.water)
    for i in range(poses.shape[0]):
        p = poses[i]
        t = twists[i]
        state = (
            (p[0], p[1], p[2], p[3], p[4], p[5], p[6]),
            (t[0], t[1], t[2], t[3], t[4], t[5]),
            (water[i, 0], water[i, 1], water[i, 2]),
        )
        steer_vehicle(k, i, state, routes)


@compiled
def _fly(
    used: int,
    substeps: int,
    memory: LaneMemory,
    kinds: Kinds,
    truths: tuple[StateHistory, ...],
) -> Fault:
    """Fly the missions in the first `used` lanes to their end; what ended that.

    `substeps` are physics steps from one instant to the next, `truths` histories by lane, out.
    """
    # to count references to these arrays at each step would take 5 % of the time
    memory = borrowed_values(memory)
    truths = borrowed_values(truths)
    vehicles = memory.vehicles
    handles = handles_of_lanes(memory.motion, kinds)
    fault = _settle(memory, handles)
    if fault[0] != OK:
        return fault
    routes = _routes_of(memory, kinds)
    for k in range(truths[0].pose.shape[0]):
        if k > 0:
            fault = advance(handles, routes.command, substeps)
            if fault[0] != OK:
                return fault
        _record_water(k, memory, handles.environment)
        for lane in range(used):
            truth = truths[lane]
            _copy_lane(memory.motion.pose, lane, vehicles, truth.pose[k])
            _copy_lane(memory.motion.twist, lane, vehicles, truth.twist[k])
            _copy_lane(memory.water, lane, vehicles, truth.water[k])
            _copy_lane(memory.motion.states, lane, vehicles, truth.effector_states[k])
        _steer(k, memory, routes)
    return OK, -1


class _VehicleInputs(NamedTuple):
    """All that the motion of a vehicle in lanes follows from."""

    sea: tuple[object, ...]
    own: tuple[object, ...]  # of hull, effectors, autopilot and start
    table: Records  # as of `RouteControl.reference`, of which it follows a column
    vehicle: int  # number of the column

    @classmethod
    def of(cls, mission: Mission, vehicle: int) -> Self:
        """The inputs of a mission that `suits_lanes`, before its first instant."""
        handles = mission.plant.handles_alone
        sea = handles.environment
        routes = mission.routes
        of_all = (
            handles.pose,
            handles.twist,
            handles.response,
            handles.coefficients,
            handles.fitted.records,
            handles.solver.bodies,
            routes.autopilot_designs,
            routes.guidance,
            routes.autopilot_memories,
        )
        # copies of what changes under way
        own = (handles.clock.copy(), *(np.array(array[vehicle]) for array in of_all))
        return cls((sea.current, sea.waves, sea.density_model), own, routes.reference, vehicle)

    def _reference(self) -> Records:
        return _columns(self.table, np.array([self.vehicle]))

    def equals(self, other: Self) -> bool:
        """Whether the same motion follows from both, to the bit."""
        if not have_same_bits((self.own, self.sea), (other.own, other.sea)):
            return False
        # missions along the same routes share their tables
        if self.table is other.table and self.vehicle == other.vehicle:
            return True
        return have_same_bits(self._reference(), other._reference())


class _KnownMotion(NamedTuple):
    """What a vehicle of a group that was flown did."""

    inputs: _VehicleInputs
    history: StateHistory  # of this vehicle, arrays of shape (n, c)

    @classmethod
    def of(cls, inputs: _VehicleInputs, truth: StateHistory, vehicle: int) -> Self:
        """A copy of what is recorded of a vehicle."""
        return cls(inputs, StateHistory(*(array[:, vehicle].copy() for array in truth)))

    def give(self, truth: StateHistory, vehicle: int) -> None:
        """Record it as that of a vehicle."""
        for source, target in zip(self.history, truth, strict=True):
            target[:, vehicle] = source


# motions that missions of further groups may share: 2 MB each of a mission of 1000 s
_known_motions: deque[_KnownMotion] = deque(maxlen=4)
_MAX_KNOWN_INSTANTS = 100_000  # longer motions are not kept


def _known_motion(inputs: _VehicleInputs) -> _KnownMotion | None:
    return next((known for known in _known_motions if known.inputs.equals(inputs)), None)


def _shared_inputs(missions: Sequence[Mission]) -> dict[int, _VehicleInputs]:
    """What the motions of the vehicles follow from that are the same in all missions, by their
    numbers.
    """
    shared = {}
    for vehicle in range(len(missions[0].plant.names)):
        first = _VehicleInputs.of(missions[0], vehicle)
        others = (_VehicleInputs.of(mission, vehicle) for mission in missions[1:])
        if all(first.equals(other) for other in others):
            shared[vehicle] = first
    return shared


def _fly_vehicles(missions: Sequence[Mission], vehicles: Ints) -> bool:
    """Fly some vehicles of each mission; see `fly_group`."""
    if not vehicles.size:
        return True
    try:
        memory = _memory_of(missions, vehicles)
    except ValueError:
        return False
    plant = missions[0].plant
    padded = [*missions, *[missions[0]] * (LANES - len(missions))]
    fault = _fly(
        len(missions),
        round(TICK / plant.dt),
        memory,
        plant.kinds,
        tuple(mission.truth for mission in padded),
    )
    return fault[0] == OK


def fly_group(missions: Sequence[Mission]) -> bool:
    """Fly up to eight missions of `mission_for_lanes` to their end; False, with motions of no use,
    if they differ in more than numbers, or one of them diverges.
    """
    if not all(suits_lanes(mission.plant.handles_alone) for mission in missions):
        return False
    shapes = {mission.truth.pose.shape for mission in missions}
    controllers = {type(mission.controller) for mission in missions}
    if len(shapes) > 1 or controllers != {RouteControl}:
        return False
    shared = _shared_inputs(missions)
    known = {vehicle: _known_motion(inputs) for vehicle, inputs in shared.items()}
    first = missions[0].truth
    instants, vehicles, _ = first.pose.shape
    unknown = [vehicle for vehicle in range(vehicles) if known.get(vehicle) is None]
    if not _fly_vehicles(missions, np.array(unknown, dtype=np.int64)):
        return False
    for vehicle, inputs in shared.items():
        motion = known[vehicle]
        if motion is not None:
            for mission in missions:
                motion.give(mission.truth, vehicle)
        elif instants <= _MAX_KNOWN_INSTANTS:
            _known_motions.append(_KnownMotion.of(inputs, first, vehicle))
    return True


def _is_for_lanes(motion: MotionSettings) -> bool:
    """Whether vehicles may move in a lane."""
    return motion.engine == "direct" and motion.kind == "physics"


def _shape_of(motion: MotionSettings) -> str:
    """What missions side by side have in common, beside the physics."""
    # keys of the sea whose values may differ
    free_keys = {"current_speed_m_s", "current_direction_deg", "current_shear_per_s"}
    free_keys |= {"density_kg_m3", "waves"}
    sea = motion.sea.ocean.model_dump(mode="json", exclude=free_keys)
    waves = motion.sea.ocean.waves
    components = {"none": 0, "regular": 1, "jonswap": waves.components}[waves.kind]
    one_way = components < 2 or waves.spreading_deg == 0.0
    return repr(
        (
            motion.plan.duration_s,
            motion.physics_step_s,
            motion.plan.models,
            sea,
            components,
            one_way,
        )
    )


def groups_for_lanes(motions: Sequence[MotionSettings], most: int = LANES) -> list[list[int]]:
    """Indices of the missions that may move side by side, in groups of up to `most`; groups of up
    to MAX_ALONE, whose missions move faster alone, are left out.
    """
    by_shape: dict[str, list[int]] = {}
    for i, motion in enumerate(motions):
        if _is_for_lanes(motion):
            by_shape.setdefault(_shape_of(motion), []).append(i)
    groups = [
        indices[first : first + most]
        for indices in by_shape.values()
        for first in range(0, len(indices), most)
    ]
    return [group for group in groups if len(group) > MAX_ALONE]


Made = TypeVar("Made")


def _or_none(make: Callable[[], Made]) -> Made | None:
    """What a function makes; None if it raises a LaisnError."""
    try:
        return make()
    except LaisnError:
        return None


def simulate_side_by_side(motions: Sequence[MotionSettings]) -> list[Trajectory | None]:
    """Motions of up to eight missions of a group; None: `simulate_open_loop` raises an error."""
    if len(motions) > LANES:
        raise ValueError(f"{len(motions)} missions, at most {LANES} lie side by side")
    missions = [_or_none(partial(mission_for_lanes, motion)) for motion in motions]
    ready = [mission for mission in missions if mission is not None]
    if not ready or not fly_group(ready):
        return [_or_none(partial(simulate_open_loop, motion)) for motion in motions]
    return [
        None if mission is None else _or_none(partial(end_mission, motion, mission))
        for motion, mission in zip(motions, missions, strict=True)
    ]
