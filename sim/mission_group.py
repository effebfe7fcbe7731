"""Missions under way whose vehicles move side by side: up to eight, each with sensors, navigators
and controllers of its own.

A vehicle moves in a lane as it does alone with the solver "direct", to the bit, whatever moves
beside it. Lanes hold missions, rows their vehicles. All else runs mission by mission, as in
`sim.simulation`.
"""

from collections.abc import Sequence
from typing import NamedTuple, NoReturn, SupportsIndex

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled, copy_rows
from laisn.held import Held, held_values, refuse_copy
from laisn.simd import LANES
from sim.simulation import Mission, record_state
from sim.vehicle.effectors import Kinds
from sim.vehicle.lanes import (
    MAX_ALONE,
    LaneMotion,
    advance_lanes,
    lane_motion_of,
    suits_lanes,
)
from sim.vehicle.stepping import OK
from sim.water.lanes import is_steady


class _GroupMemory(NamedTuple):
    """Motion of v vehicles of each mission, as rows of lanes."""

    motion: LaneMotion
    kinds: Kinds  # of their effectors


@compiled
def _take(values: Floats, lane: int, out: Floats) -> None:
    """Copy numbers of the vehicles of a mission, shape (v, c), to its lane, of (v, c, LANES)."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j, lane] = values[i, j]


@compiled
def _give(values: Floats, lane: int, out: Floats) -> None:
    """The way back."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j, lane]


@compiled
def _take_all(missions: tuple[Held, ...], moving: Bools, first: int, motion: LaneMotion) -> None:
    """Copy the states of missions to their lanes, and their commands, which are worked out before;
    lanes of missions that rest repeat those of the first one that moves.
    """
    for lane in range(LANES):
        loop = held_values(missions[lane if moving[lane] else first])
        if moving[lane]:
            loop.outside.apply(loop.instants[0] - 1, loop.truth, loop.routes)
        handles = loop.handles
        _take(handles.pose, lane, motion.pose)
        _take(handles.twist, lane, motion.twist)
        _take(handles.acceleration, lane, motion.acceleration)
        _take(handles.fitted.states, lane, motion.states)
        _take(loop.routes.command, lane, motion.command)


@compiled
def _advance_together(
    ticks: int,
    moving: Bools,
    missions: tuple[Held, ...],
    held_memory: Held,
    failed: Ints,
) -> int:
    """Advance the missions that move by a number of instants, or until one of them cannot go on.

    Gives by how many they have advanced. `failed` are numbers, from 1, of followers whose navigator
    failed in the last one, out, shape (LANES,); 0: none.
    """
    memory = held_values(held_memory)
    motion = memory.motion
    first = 0
    while not moving[first]:
        first += 1
    for tick in range(ticks):
        _take_all(missions, moving, first, motion)
        leading = held_values(missions[first])
        # of missions at different times nothing in the sea depends on it
        motion.clock[0] = leading.handles.clock[0]
        fault = advance_lanes(motion, memory.kinds, leading.substeps)
        if fault[0] != OK:
            return tick
        some_failed = False
        for lane in range(LANES):
            if not moving[lane]:
                continue
            loop = held_values(missions[lane])
            handles = loop.handles
            _give(motion.pose, lane, handles.pose)
            _give(motion.twist, lane, handles.twist)
            _give(motion.acceleration, lane, handles.acceleration)
            _give(motion.states, lane, handles.fitted.states)
            copy_rows(handles.pose, handles.last_pose)
            copy_rows(handles.twist, handles.last_twist)
            for _ in range(loop.substeps):
                handles.clock[0] += handles.clock[1]
            k = loop.instants[0]
            record_state(k, loop.state, loop.environment, loop.truth)
            failed[lane] = loop.controller.control(k, loop.truth)
            if failed[lane]:
                some_failed = True
            else:
                loop.seen.keep(k)
                loop.instants[0] = k + 1
        if some_failed:
            return tick + 1
    return ticks


class MissionGroup:
    """Up to eight missions that are under way, whose vehicles move side by side.

    Attributes:
        missions: each may be at an instant of its own, and may be advanced alone meanwhile.
    """

    def __init__(self, missions: Sequence[Mission]) -> None:
        """Of missions before their end; ValueError if they cannot lie side by side: a part of one
        is in Python, or they differ in more than numbers.
        """
        if not MAX_ALONE < len(missions) <= LANES:
            raise ValueError(f"{len(missions)} missions; {MAX_ALONE + 1} to {LANES} form a group")
        handles = [mission.plant.handles_alone for mission in missions]
        held = [mission.held_alone() for mission in missions]
        if not all(map(suits_lanes, handles)) or None in held:
            raise ValueError("a part of a mission is in Python, or solved by MuJoCo")
        padded = [each for each in held if each is not None]
        padded += padded[:1] * (LANES - len(missions))
        if len({each.type for each in padded}) > 1:
            raise ValueError("missions differ in more than numbers")
        self.missions = list(missions)
        self._held = tuple(padded)
        plant = missions[0].plant
        self._motion = lane_motion_of(handles)
        self._memory = Held(_GroupMemory(self._motion, plant.kinds))
        self._is_steady = all(is_steady(each.environment) for each in handles)
        self._failed = np.zeros(LANES, dtype=np.int64)

    def __reduce_ex__(self, _: SupportsIndex) -> NoReturn:
        """See `laisn.held.refuse_copy`."""
        refuse_copy(self)

    def advance(self, ends: Sequence[int]) -> dict[int, int]:
        """Advance missions until an instant each, as far as they move side by side: those of a
        changing sea beside others at the same instant. Each goes on alone from where it is then,
        by `Mission.advance`.

        Gives numbers, from 1, of followers whose navigator failed, by the indices of the missions.
        """
        instants = [mission.instants for mission in self.missions]
        moving = [i for i, end in enumerate(ends) if 0 < instants[i] <= end]
        parts = [moving]
        if not self._is_steady:
            parts = [[i for i in moving if instants[i] == k] for k in {instants[i] for i in moving}]
        failed: dict[int, int] = {}
        for part in parts:
            failed |= self._advance_part(part, ends)
        for i in moving:
            self.missions[i].end_advance()
        return failed

    def _advance_part(self, part: Sequence[int], ends: Sequence[int]) -> dict[int, int]:
        failed: dict[int, int] = {}
        while not failed:
            left = {i: ends[i] + 1 - self.missions[i].instants for i in part}
            left = {i: ticks for i, ticks in left.items() if ticks > 0}
            if len(left) <= MAX_ALONE:
                break
            moving = np.zeros(LANES, dtype=np.bool_)
            moving[list(left)] = True
            self._failed[:] = 0
            ticks = min(left.values())
            done = _advance_together(ticks, moving, self._held, self._memory, self._failed)
            failed = {i: int(self._failed[i]) for i in left if self._failed[i]}
            if done < ticks:
                break
        return failed


def fly_side_by_side(missions: Sequence[Mission]) -> list[bool]:
    """Fly up to eight missions before their first instant to their end, as far as they move side by
    side; `sim.simulation.fly_mission` flies the rest, and finds what ended them.

    Gives whether each is fit for that: not where a navigator failed.
    """
    for mission in missions:
        mission.advance(0)
    try:
        group = MissionGroup(missions)
    except ValueError:
        return [True] * len(missions)
    failed = group.advance([mission.last for mission in missions])
    return [i not in failed for i in range(len(missions))]
