"""Missions side by side: up to eight whose motion depends on no noise, each in a lane of its own.

The physics is that of `sim.vehicle.plant.advance`, the control that of
`sim.simulation.steer_vehicle`, both compiled for lanes (`laisn.simd`). A mission moves in a lane as
it does alone with the solver "direct", to the bit, whatever flies beside it.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Records
from laisn.compiled import compiled, method_by_type
from laisn.errors import LaisnError
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
from sim.vehicle.effector_kinds import BUILT_IN
from sim.vehicle.effectors import Fitted, Kinds
from sim.vehicle.plant import OK, Fault, StepHandles, advance
from sim.vehicle.solvers import DirectSolver, Room
from sim.water.currents import ShearedCurrent
from sim.water.densities import UniformDensity
from sim.water.environment import Environment, flow, sea_at
from sim.water.waves import CalmSurface, LaneWaves, WaveTrain

FEW = 2  # missions that move faster one after the other

method_by_type("surface_of_lanes")


class CalmMemory(NamedTuple):
    """A surface without waves in all lanes."""

    highest: float = 0.0

    @compiled
    def surface_of_lanes(self) -> CalmSurface:
        """The surface of all missions."""
        return CalmSurface(self.highest)


class WaveMemory(NamedTuple):
    """Waves of each mission, the lanes along the last axis."""

    components: Floats  # as of `WaveTrain`, shape (11, n, LANES)
    floor_depth: Floats  # [m], shape (1, LANES), as the next
    highest: Floats  # [m]
    room: Floats  # for orbits, shape (4, n, LANES)

    @compiled
    def surface_of_lanes(self) -> LaneWaves:
        """The surface of all missions."""
        return LaneWaves(
            lanes_of(self.components),
            lanes_of(self.floor_depth)[0],
            lanes_of(self.highest)[0],
            lanes_of(self.room),
        )


def _waves_in_lanes(trains: Sequence[WaveTrain]) -> CalmMemory | WaveMemory:
    """Waves side by side; ValueError if they differ in the number of their components."""
    components = in_lanes([train.components for train in trains])
    n = components.shape[1]
    if n == 0:
        return CalmMemory()
    return WaveMemory(
        components=components,
        floor_depth=in_lanes([np.array([train.floor_depth]) for train in trains]),
        highest=in_lanes([np.array([train.highest]) for train in trains]),
        room=np.empty((4, n, LANES)),
    )


class LaneMemory(NamedTuple):
    """States and parameters of v vehicles of each mission, the lanes along the last axis; records
    are of lanes.
    """

    pose: Floats  # as of `Plant`, shape (v, 7, LANES), as are the next by their sizes
    twist: Floats
    states: Floats  # of the effectors
    acceleration: Floats
    solved: Floats
    last_pose: Floats  # valid ones
    last_twist: Floats
    water: Floats  # velocity of the water at the vehicles, shape (v, 3, LANES), [m/s]
    command: Floats
    reference: Records  # as of `RouteControl`, shape (n, v), as are the next three, shape (v,)
    autopilots: Records
    guidance: Records
    autopilot: Records
    response: Floats
    coefficients: Records
    effectors: Records
    bodies: Records
    lower: Floats  # room of the solver, shapes (6, 6, LANES) and (6, LANES)
    load: Floats
    surface: Floats  # current at the surface, and its change with z, shape (2, LANES)
    shear: Floats
    change: Floats  # of the current, the same in all lanes
    waves: CalmMemory | WaveMemory
    clock: Floats
    warnings: Ints
    outside: Bools  # as of `RouteControl`: none is


def _memory_of(missions: Sequence[Mission], currents: Sequence[ShearedCurrent]) -> LaneMemory:
    """States of missions whose plants are not settled, side by side; ValueError if they differ in
    more than numbers.
    """
    plants = [mission.plant for mission in missions]
    routes = [mission.routes for mission in missions]
    v, m = plants[0].thrust.shape
    change = currents[0].change
    if any(not np.array_equal(current.change, change) for current in currents):
        raise ValueError("currents change otherwise")

    def numbers(rows: int, columns: int) -> Floats:
        return np.zeros((rows, columns, LANES))

    return LaneMemory(
        pose=in_lanes([plant.pose for plant in plants]),
        twist=in_lanes([plant.twist for plant in plants]),
        states=numbers(v, m),
        acceleration=numbers(v, 6),
        solved=numbers(v, 6),
        last_pose=numbers(v, 7),
        last_twist=numbers(v, 6),
        water=numbers(v, 3),
        command=numbers(v, m),
        reference=in_lanes([each.reference for each in routes]),
        autopilots=in_lanes([each.autopilots for each in routes]),
        guidance=in_lanes([each.guidance for each in routes]),
        autopilot=in_lanes([each.autopilot for each in routes]),
        response=in_lanes([plant.response for plant in plants]),
        coefficients=in_lanes([plant.true_coefficients for plant in plants]),
        effectors=in_lanes([plant.true_effectors for plant in plants]),
        bodies=in_lanes([plant.bodies for plant in plants]),
        lower=numbers(6, 6),
        load=np.zeros((6, LANES)),
        surface=in_lanes([np.array(current.surface) for current in currents]),
        shear=in_lanes([np.array(current.shear) for current in currents]),
        change=change,
        waves=_waves_in_lanes([plant.ocean.environment.waves for plant in plants]),
        clock=np.array([0.0, plants[0].dt]),
        warnings=np.zeros(0, dtype=np.int64),
        outside=np.zeros(v, dtype=np.bool_),
    )


@compiled
def _handles_of(memory: LaneMemory, kinds: Kinds) -> StepHandles:
    """What `advance` works on, in lanes."""
    pose = lanes_of(memory.pose)
    twist = lanes_of(memory.twist)
    acceleration = lanes_of(memory.acceleration)
    surface = lanes_of(memory.surface)
    shear = lanes_of(memory.shear)
    solver = DirectSolver(
        lanes_of(memory.bodies),
        pose,
        twist,
        acceleration,
        lanes_of(memory.solved),
        Room(lanes_of(memory.lower), lanes_of(memory.load)),
        memory.clock[1],
    )
    current = ShearedCurrent((surface[0], surface[1]), (shear[0], shear[1]), memory.change)
    environment = Environment(
        current, memory.waves.surface_of_lanes(), 0.0, 0.0, UniformDensity(0.0)
    )
    fitted = Fitted(kinds, lanes_of(memory.effectors), lanes_of(memory.states))
    return StepHandles(
        memory.clock,
        pose,
        twist,
        acceleration,
        lanes_of(memory.response),
        lanes_of(memory.last_pose),
        lanes_of(memory.last_twist),
        memory.warnings,
        lanes_of(memory.coefficients),
        environment,
        solver,
        fitted,
    )


@compiled
def _record_water(k: int, memory: LaneMemory, environment: Environment) -> None:
    """Find the water at all vehicles at instant k."""
    pose = lanes_of(memory.pose)
    out = lanes_of(memory.water)
    sea = sea_at(environment, k * TICK)
    for i in range(pose.shape[0]):
        point = (pose[i, 0], pose[i, 1], pose[i, 2])
        u = flow(sea, point, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)).velocity
        out[i, 0] = u[0]
        out[i, 1] = u[1]
        out[i, 2] = u[2]


@compiled
def _copy_lane(values: Floats, lane: int, out: Floats) -> None:
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j, lane]


@compiled
def _copy_all(source: Floats, target: Floats) -> None:
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            for lane in range(LANES):
                target[i, j, lane] = source[i, j, lane]


@compiled
def _settle(memory: LaneMemory, handles: StepHandles) -> Fault:
    """Take the accelerations of the start, as `Plant` does for its own."""
    pose = memory.pose.copy()
    twist = memory.twist.copy()
    fault = advance(handles, lanes_of(memory.command), 1)
    _copy_all(pose, memory.pose)
    _copy_all(twist, memory.twist)
    _copy_all(np.zeros(memory.states.shape), memory.states)
    memory.clock[0] = 0.0
    return fault


@compiled
def _routes_of(memory: LaneMemory, kinds: Kinds) -> RouteControl:
    """The control of all missions, in lanes."""
    return RouteControl(
        kinds,
        lanes_of(memory.reference),
        lanes_of(memory.autopilots),
        lanes_of(memory.guidance),
        lanes_of(memory.autopilot),
        lanes_of(memory.command),
        memory.outside,
    )


@compiled
def _steer(k: int, memory: LaneMemory, routes: RouteControl) -> None:
    """Find the commands of all vehicles from instant k on."""
    poses = lanes_of(memory.pose)
    twists = lanes_of(memory.twist)
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
    """Fly missions to their end; what ended that."""
    handles = _handles_of(memory, kinds)
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
            _copy_lane(memory.pose, lane, truth.pose[k])
            _copy_lane(memory.twist, lane, truth.twist[k])
            _copy_lane(memory.water, lane, truth.water[k])
            _copy_lane(memory.states, lane, truth.thrust[k])
        _steer(k, memory, routes)
    return OK, -1


def fly_group(missions: Sequence[Mission]) -> bool:
    """Fly up to eight missions of `mission_for_lanes` to their end; False, with motions of no use,
    if they differ in more than numbers, or one of them diverges.
    """
    plants = [mission.plant for mission in missions]
    seas = [plant.ocean.environment for plant in plants]
    currents = [sea.current for sea in seas]
    if not all(
        isinstance(sea.current, ShearedCurrent) and isinstance(sea.water, UniformDensity)
        for sea in seas
    ):
        return False
    try:
        memory = _memory_of(missions, currents)
    except ValueError:
        return False
    shapes = {mission.truth.pose.shape for mission in missions}
    controllers = {type(mission.controller) for mission in missions}
    steps = {plant.dt for plant in plants}
    if len(shapes) > 1 or controllers != {RouteControl} or len(steps) > 1:
        return False
    # kinds of the user's own are written for numbers
    if any(plant.kinds != BUILT_IN for plant in plants):
        return False
    padded = [*missions, *[missions[0]] * (LANES - len(missions))]
    fault = _fly(
        len(missions),
        round(TICK / plants[0].dt),
        memory,
        plants[0].kinds,
        tuple(mission.truth for mission in padded),
    )
    return fault[0] == OK


def _is_for_lanes(motion: MotionSettings) -> bool:
    """Whether vehicles may move in a lane."""
    return motion.engine == "direct" and motion.kind == "physics"


def _shape_of(motion: MotionSettings) -> str:
    """What missions side by side have in common, beside the physics."""
    numbers = {"current_speed_m_s", "current_direction_deg", "current_shear_per_s"}
    numbers |= {"density_kg_m3", "waves"}
    sea = motion.sea.ocean.model_dump(mode="json", exclude=numbers)
    waves = motion.sea.ocean.waves
    components = {"none": 0, "regular": 1, "jonswap": waves.components}[waves.kind]
    return repr(
        (motion.plan.duration_s, motion.physics_step_s, motion.plan.models, sea, components)
    )


def groups_for_lanes(motions: Sequence[MotionSettings], most: int = LANES) -> list[list[int]]:
    """Numbers of the missions that may move side by side, in groups of up to `most`; of a group of
    two each moves faster alone, so that it is left out.
    """
    by_shape: dict[str, list[int]] = {}
    for i, motion in enumerate(motions):
        if _is_for_lanes(motion):
            by_shape.setdefault(_shape_of(motion), []).append(i)
    groups = [
        numbers[first : first + most]
        for numbers in by_shape.values()
        for first in range(0, len(numbers), most)
    ]
    return [group for group in groups if len(group) > FEW]


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
