"""A fleet flown by its autopilots: plant, guidance and autopilot make a Trajectory."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.failure import LaisnError
from sim.contact import Ending
from sim.control.autopilot import AUTOPILOT_MEMORY, DepthControl, control, design, feel
from sim.control.guidance import GUIDANCE_MEMORY, begin, reference, steer
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
THRUST, WATER = slice(13, 18), slice(18, 21)
"""Columns of a record of one vehicle at one instant."""
COLUMNS = 21
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


TrajectorySince = Callable[[int], Trajectory]
"""The mission since an instant, which its number on the grid names, until now."""
BelievedPositions = Callable[[int, TrajectorySince], Floats]
"""Where vehicles take themselves to be at an instant, shape (v, 2), [m]; NaN: where they are."""


@compiled
def note(k: int, state: tuple[Floats, Floats, Floats], water: Water, record: Floats) -> None:
    """Record instant k."""
    pose, twist, thrust = state
    row = record[k]
    water_velocity(pose[:, POSITION], k * TICK, water, row[:, WATER])
    for i in range(pose.shape[0]):
        row[i, 0:7] = pose[i]
        row[i, 7:13] = twist[i]
        row[i, THRUST] = thrust[i]


@compiled
def steer_along_routes(
    k: int,
    row: Floats,
    wanted: Floats,
    belief: Floats,
    autopilots: Any,
    memory: tuple[Floats, Floats],
    command: Floats,
) -> None:
    """Find the commands that hold from the recorded instant k until k + 1; memory is set up at k = 0."""
    for i in range(row.shape[0]):
        pose, twist, around = row[i, 0:7], row[i, 7:13], row[i, WATER]
        if k == 0:
            begin(wanted[k, i], pose, twist, around, memory[0][i])
        where = belief[i] if np.isfinite(belief[i, 0]) else pose[:2]
        steering = steer(wanted[k, i], where, around, TICK, memory[0][i])
        felt = feel(pose, twist, around)
        control(autopilots[i], steering, wanted[k, i], felt, TICK, memory[1][i], command[i])


@compiled
def _fly(
    span: tuple[int, int, int],
    afloat: Any,
    state: tuple[Floats, Floats, Floats],
    water: Water,
    steering: tuple[Floats, Floats, Any, tuple[Floats, Floats], Floats],
    record: Floats,
) -> tuple[int, Fault]:
    """Steer, advance and record from one instant to another.

    Args:
        span: the first instant, which is recorded; the last; physics steps from one to the next.
        afloat: of `Plant.afloat`.
        state: pose, twist and thrust of the plant.
        water: as of `note`.
        steering: wanted, belief, autopilots, memory and command of `steer_along_routes`.
        record: of all instants, shape (n, v, COLUMNS).

    Returns:
        The last instant that is recorded, and what ended the flight there, if it is not FINE.
    """
    first, last, substeps = span
    wanted, belief, autopilots, memory, command = steering
    for k in range(first, last):
        steer_along_routes(k, record[k], wanted, belief, autopilots, memory, command)
        fault = advance(afloat, command, substeps)
        if fault[0] != FINE:
            return k, fault
        note(k + 1, state, water, record)
    return last, (FINE, -1)


Steering = tuple[Floats, Floats, Any, tuple[Floats, Floats], Floats]
"""Wanted, belief, autopilots, memory and command of `steer_along_routes`."""


class Crew(Protocol):
    """What steers the vehicles of a fleet."""

    def think(self, k: int, record: Floats) -> None:
        """Find the commands that hold from the recorded instant k until k + 1."""

    def fly(
        self,
        span: tuple[int, int, int],
        afloat: Any,
        state: tuple[Floats, Floats, Floats],
        water: Water,
        record: Floats,
    ) -> tuple[int, Fault]:
        """Think, advance and record from one instant to another in compiled code; arguments as of `_fly`."""

    def end(self, k: int, record: Floats) -> None:
        """Take note of the last instant, after which nothing is steered."""


class RouteCrew:
    """Vehicles on routes, steered by the truth or by positions that are given."""

    def __init__(self, steering: Steering) -> None:
        """Take the arrays that `steer_along_routes` works on."""
        self._steering = steering

    def think(self, k: int, record: Floats) -> None:
        """Find the commands that hold from the recorded instant k until k + 1."""
        steer_along_routes(k, record[k], *self._steering)

    def fly(
        self,
        span: tuple[int, int, int],
        afloat: Any,
        state: tuple[Floats, Floats, Floats],
        water: Water,
        record: Floats,
    ) -> tuple[int, Fault]:
        """Steer, advance and record; see `Crew.fly`."""
        return _fly(span, afloat, state, water, self._steering, record)

    def end(self, k: int, record: Floats) -> None:
        """Do nothing: whoever is steered by the truth has nothing to remember."""


Boarding = Callable[[Plant, Steering], Crew]
"""Makes the crew of a plant from the arrays of its routes."""


def _trajectory(plant: Plant, record: Floats, since: int = 0) -> Trajectory | None:
    """What is recorded since an instant; None if that is no two instants."""
    n = record.shape[0]
    if n - since < 2:
        return None
    record = record[since:]
    part = {
        name: np.ascontiguousarray(record[..., columns])
        for name, columns in {
            "position": POSITION,
            "quaternion": QUATERNION,
            "velocity": VELOCITY,
            "angular_velocity": SPIN,
            "water_velocity": WATER,
            "thrust": THRUST,
        }.items()
    }
    return Trajectory(
        names=plant.names,
        time=np.arange(since, n, dtype=np.float64) * TICK,
        site_names=plant.site_names,
        site_vehicle=plant.site_vehicle.copy(),
        site_offset=plant.site_offset.copy(),
        **part,
    )


def standing(plant: Plant) -> Trajectory:
    """A plant as it stands: a trajectory of two equal instants, for what is told of vehicles before they move."""
    record = np.empty((2, len(plant.names), COLUMNS))
    for k in range(2):
        note(k, plant.state, plant.ocean.water, record)
    still = _trajectory(plant, record)
    assert still is not None  # of two instants
    return still


def _trajectory_since(plant: Plant, record: Floats, since: int = 0) -> Trajectory:
    flown = _trajectory(plant, record, since)
    if flown is None:
        raise ValueError(f"only {record.shape[0]} instants are flown, none after number {since}")
    return flown


def simulate_fleet(
    plant: Plant,
    routes: Sequence[Route],
    duration: float,
    depth_control: Sequence[DepthControl] = (),
    *,
    limits: Sequence[Limits] | None = None,
    believe: BelievedPositions | None = None,
    boarding: Boarding | None = None,
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
        believe: where vehicles take themselves to be when they steer; None: they know.
        boarding: makes a crew that does other than follow routes; None: there is none.
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
    record = np.empty((ticks + 1, v, COLUMNS))
    memory = np.zeros((v, GUIDANCE_MEMORY)), np.zeros((v, AUTOPILOT_MEMORY))
    command, belief = np.zeros((v, 5)), np.full((v, 2), np.nan)
    state, water = plant.state, plant.ocean.water
    steering = wanted, belief, autopilots, memory, command
    crew: Crew = RouteCrew(steering) if boarding is None else boarding(plant, steering)

    def leg(k: int, last: int) -> None:
        """Fly from instant k to the last one."""
        afloat = plant.afloat()
        try:
            if afloat is not None:
                k, fault = crew.fly((k, last, substeps), afloat, state, water, record)
                plant.settle(fault)
            while k < last:
                crew.think(k, record)
                plant.step(command, substeps)
                k += 1
                note(k, state, water, record)
        except PlantError as error:
            raise FleetError(str(error), error.time, _trajectory(plant, record[: k + 1])) from error

    note(0, state, water, record)
    k = 0
    while k < ticks:
        if believe is not None:
            belief[:] = believe(k, partial(_trajectory_since, plant, record[: k + 1]))
        # between these instants nothing from outside is looked at: not the beliefs, not Ctrl-C
        last = k + 1 if believe is not None else min(k + _PROGRESS_TICKS - (k - 1) % _PROGRESS_TICKS, ticks)
        leg(k, last)
        new = record[k : last + 1]
        end = None if ending is None else ending(new[..., POSITION], new[..., QUATERNION])
        if end is not None:
            return _trajectory_since(plant, record[: max(k + end, 1) + 1])
        if progress is not None and (last - 1) % _PROGRESS_TICKS == 0:
            progress((last - 1) * TICK)
        k = last
    crew.end(ticks, record)
    if believe is not None:
        believe(ticks, partial(_trajectory_since, plant, record))
    return _trajectory_since(plant, record)
