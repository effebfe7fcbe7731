"""Vehicles side by side in vector registers (`laisn.simd`): the same steps, each vehicle to the bit
as alone with the solver "direct".

Lanes hold one vehicle each, and rows of eight lanes are what vehicles are to `stepping.advance`.
The lanes of a row differ in numbers alone: whole numbers, as that of strips or kinds of effectors,
are the same. They are vehicles of several missions (`sim.side_by_side`), or of one plant
(`FleetHandles`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints, Records
from laisn.compiled import compiled, compiled_apart, copy_rows, copy_values
from laisn.simd import LANES, in_lanes, lanes_of, whole_numbers
from sim.vehicle.effector_kinds import BUILT_IN
from sim.vehicle.effectors import Fitted, Kinds
from sim.vehicle.solvers import DirectSolver, Room
from sim.vehicle.stepping import OK, Fault, StepHandles, advance
from sim.water.lanes import SeaMemory, sea_memory_of, sea_of_lanes, sea_suits_lanes

MAX_ALONE = 2
"""So many vehicles or missions, or fewer, move faster one after the other than in lanes."""


class LaneMotion(NamedTuple):
    """States and parameters of r rows of vehicles, the lanes along the last axis; records are of
    lanes.
    """

    pose: Floats  # as of `StepHandles`, shape (r, 7, LANES), as are the next by their sizes
    twist: Floats
    states: Floats  # of the effectors
    acceleration: Floats
    solved: Floats  # as of `DirectSolver`, shape (r, 6, LANES)
    last_pose: Floats  # valid ones
    last_twist: Floats
    command: Floats  # shape (r, m, LANES), as the next; of both see `update_states`
    response: Floats
    coefficients: Records  # shape (r,), as is that of the bodies
    effectors: Records
    bodies: Records
    lower: Floats  # of the solver's `Room`, shapes (6, 6, LANES) and (6, LANES)
    load: Floats
    sea: SeaMemory
    clock: Floats  # as of `StepHandles`, as the next
    warnings: Ints


def lane_motion_of(lanes: Sequence[StepHandles]) -> LaneMotion:
    """Up to eight lanes, each of r vehicles that are as of `suits_lanes`; ValueError if they differ
    in more than numbers.
    """
    first = lanes[0]
    r, m = first.response.shape
    if len({float(each.clock[1]) for each in lanes}) > 1:
        raise ValueError("steps differ")

    def numbers(rows: int, columns: int) -> Floats:
        return np.zeros((rows, columns, LANES))

    return LaneMotion(
        pose=in_lanes([each.pose for each in lanes]),
        twist=in_lanes([each.twist for each in lanes]),
        states=numbers(r, m),
        acceleration=numbers(r, 6),
        solved=numbers(r, 6),
        last_pose=numbers(r, 7),
        last_twist=numbers(r, 6),
        command=numbers(r, m),
        response=in_lanes([each.response for each in lanes]),
        coefficients=in_lanes([each.coefficients for each in lanes]),
        effectors=in_lanes([each.fitted.records for each in lanes]),
        bodies=in_lanes([each.solver.bodies for each in lanes]),
        lower=numbers(6, 6),
        load=np.zeros((6, LANES)),
        sea=sea_memory_of([each.environment for each in lanes]),
        clock=np.array([0.0, first.clock[1]]),
        warnings=np.zeros(0, dtype=np.int64),
    )


def suits_lanes(handles: StepHandles) -> bool:
    """Whether vehicles may move in lanes: by their own equations, in a sea and with effectors of
    this project's kinds (those of the user are written for numbers).
    """
    return (
        isinstance(handles.solver, DirectSolver)
        and handles.fitted.kinds == BUILT_IN
        and sea_suits_lanes(handles.environment)
    )


@compiled
def handles_of_lanes(memory: LaneMotion, kinds: Kinds) -> StepHandles:
    """What `advance` works on, in lanes."""
    pose = lanes_of(memory.pose)
    twist = lanes_of(memory.twist)
    acceleration = lanes_of(memory.acceleration)
    solver = DirectSolver(
        lanes_of(memory.bodies),
        pose,
        twist,
        acceleration,
        lanes_of(memory.solved),
        Room(lanes_of(memory.lower), lanes_of(memory.load)),
        memory.clock[1],
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
        sea_of_lanes(memory.sea),
        solver,
        fitted,
    )


@compiled_apart
def advance_lanes(memory: LaneMotion, kinds: Kinds, n_substeps: int) -> Fault:
    """Advance all rows under their commands."""
    handles = handles_of_lanes(memory, kinds)
    return advance(handles, lanes_of(memory.command), n_substeps)


class _Rest(NamedTuple):
    """Vehicles of a plant beside those in lanes."""

    handles: StepHandles
    command: Floats
    vehicles: Ints  # their numbers in the plant


@compiled
def _take(values: Floats, vehicles: Ints, out: Floats) -> None:
    """Copy rows of values, shape (v, c), to the lanes of `out`, shape (r, c, LANES); `vehicles` are
    the numbers of their rows, shape (r, LANES).
    """
    for i in range(out.shape[0]):
        for lane in range(LANES):
            vehicle = vehicles[i, lane]
            for j in range(out.shape[1]):
                out[i, j, lane] = values[vehicle, j]


@compiled
def _give(values: Floats, vehicles: Ints, out: Floats) -> None:
    """The way back; lanes that repeat a vehicle hold the same of it."""
    for i in range(values.shape[0]):
        for lane in range(LANES):
            vehicle = vehicles[i, lane]
            for j in range(values.shape[1]):
                out[vehicle, j] = values[i, j, lane]


class FleetHandles(NamedTuple):
    """`StepHandles` of a plant some of whose vehicles move side by side."""

    alone: StepHandles  # of all vehicles, to move one after the other
    memory: LaneMotion
    vehicles: Ints  # number of the vehicle in each lane, shape (r, LANES)
    rest: _Rest

    @compiled
    def run_steps(self, command: Floats, n_substeps: int) -> Fault:
        """As of `StepHandles`."""
        alone = self.alone
        memory = self.memory
        rest = self.rest.handles
        states = alone.fitted.states
        _take(alone.pose, self.vehicles, memory.pose)
        _take(alone.twist, self.vehicles, memory.twist)
        _take(alone.acceleration, self.vehicles, memory.acceleration)
        _take(states, self.vehicles, memory.states)
        _take(command, self.vehicles, memory.command)
        for i in range(self.rest.vehicles.size):
            vehicle = self.rest.vehicles[i]
            copy_values(alone.pose[vehicle], rest.pose[i])
            copy_values(alone.twist[vehicle], rest.twist[i])
            copy_values(alone.acceleration[vehicle], rest.acceleration[i])
            copy_values(states[vehicle], rest.fitted.states[i])
            copy_values(command[vehicle], self.rest.command[i])
        memory.clock[0] = rest.clock[0] = alone.clock[0]
        fault = advance_lanes(memory, alone.fitted.kinds, n_substeps)
        if fault[0] == OK and self.rest.vehicles.size > 0:
            fault = advance(rest, self.rest.command, n_substeps)
        if fault[0] != OK:
            # nothing has moved yet; to move one after the other tells which vehicle failed when
            return advance(alone, command, n_substeps)
        _give(memory.pose, self.vehicles, alone.pose)
        _give(memory.twist, self.vehicles, alone.twist)
        _give(memory.acceleration, self.vehicles, alone.acceleration)
        _give(memory.states, self.vehicles, states)
        for i in range(self.rest.vehicles.size):
            vehicle = self.rest.vehicles[i]
            copy_values(rest.pose[i], alone.pose[vehicle])
            copy_values(rest.twist[i], alone.twist[vehicle])
            copy_values(rest.acceleration[i], alone.acceleration[vehicle])
            copy_values(rest.fitted.states[i], states[vehicle])
        copy_rows(alone.pose, alone.last_pose)
        copy_rows(alone.twist, alone.last_twist)
        alone.clock[0] = memory.clock[0]
        return fault


def _rows_of(handles: StepHandles) -> list[list[int]]:
    """Numbers of the vehicles that may lie in a row, up to eight each."""
    alike: dict[bytes, list[int]] = {}
    for i in range(len(handles.pose)):
        shared = whole_numbers(handles.coefficients[i]) + whole_numbers(handles.fitted.records[i])
        alike.setdefault(shared, []).append(i)
    rows = [
        vehicles[first : first + LANES]
        for vehicles in alike.values()
        for first in range(0, len(vehicles), LANES)
    ]
    return [row for row in rows if len(row) > MAX_ALONE]


def _frozen(records: npt.NDArray[np.void], vehicles: Ints) -> npt.NDArray[np.void]:
    chosen = records[vehicles]
    chosen.flags.writeable = False
    return chosen


def handles_of_vehicles(handles: StepHandles, vehicles: Ints) -> StepHandles:
    """Handles of some vehicles, in memory of their own."""
    r = len(vehicles)
    pose = handles.pose[vehicles]
    twist = handles.twist[vehicles]
    acceleration = np.zeros((r, 6))
    solver = handles.solver._replace(
        bodies=_frozen(handles.solver.bodies, vehicles),
        pose=pose,
        twist=twist,
        acceleration=acceleration,
        solved=np.zeros((r, 6)),
    )
    fitted = handles.fitted._replace(
        records=_frozen(handles.fitted.records, vehicles),
        states=np.zeros((r, handles.response.shape[1])),
    )
    return handles._replace(
        clock=handles.clock.copy(),
        pose=pose,
        twist=twist,
        acceleration=acceleration,
        response=handles.response[vehicles],
        last_pose=np.zeros((r, 7)),
        last_twist=np.zeros((r, 6)),
        coefficients=_frozen(handles.coefficients, vehicles),
        solver=solver,
        fitted=fitted,
    )


def fleet_handles(handles: StepHandles) -> StepHandles | FleetHandles:
    """Handles that move vehicles side by side where at least three may move so."""
    rows = _rows_of(handles) if suits_lanes(handles) else []
    if not rows:
        return handles
    vehicles = np.array([[*row, *[row[0]] * (LANES - len(row))] for row in rows], dtype=np.int64)
    beside = np.setdiff1d(np.arange(len(handles.pose)), vehicles)
    rest = _Rest(
        handles=handles_of_vehicles(handles, beside),
        command=np.zeros((len(beside), handles.response.shape[1])),
        vehicles=beside,
    )
    lanes = [handles_of_vehicles(handles, column) for column in vehicles.T]
    return FleetHandles(handles, lane_motion_of(lanes), vehicles, rest)
