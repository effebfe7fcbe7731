"""A fleet flown by its autopilots: plant, guidance and autopilot make a Trajectory."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled
from sim.autopilot import AUTOPILOT_MEMORY, DepthControl, control, design
from sim.guidance import GUIDANCE_MEMORY, begin, reference, steer
from sim.kinematics import Limits
from sim.missions import Route
from sim.ocean import Water, water_velocity
from sim.plant import Plant, PlantError
from sim.scenario import CONTROL_STEP_S
from sim.trajectory import Trajectory

Floats = npt.NDArray[np.float64]

TICK = CONTROL_STEP_S
"""Interval of guidance, autopilot and recording [s]."""
POSITION, QUATERNION = slice(0, 3), slice(3, 7)
VELOCITY, SPIN = slice(7, 10), slice(10, 13)
THRUST, WATER = slice(13, 18), slice(18, 21)
"""Columns of a record of one vehicle at one instant."""
COLUMNS = 21
_PROGRESS_TICKS = 500


class FleetError(RuntimeError):
    """A flight that could not go on.

    Attributes:
        time: at which it stopped [s].
        trajectory: up to the last good instant; None if there are not two of them.
    """

    def __init__(self, message: str, time: float, trajectory: Trajectory | None) -> None:
        super().__init__(message)
        self.time = time
        self.trajectory = trajectory


@compiled
def _tick(
    k: int,
    state: tuple[Floats, Floats, Floats],
    water: Water,
    wanted: Floats,
    autopilots: Any,
    memory: tuple[Floats, Floats],
    record: Floats,
    command: Floats,
) -> None:
    """Record instant k and find the commands that hold until instant k + 1; memory is set up at k = 0."""
    pose, twist, thrust = state
    row = record[k]
    water_velocity(pose[:, POSITION], k * TICK, water, row[:, WATER])
    for i in range(pose.shape[0]):
        row[i, 0:7] = pose[i]
        row[i, 7:13] = twist[i]
        row[i, THRUST] = thrust[i]
        around = row[i, WATER]
        if k == 0:
            begin(wanted[k, i], pose[i], twist[i], around, memory[0][i])
        steering = steer(wanted[k, i], pose[i], around, TICK, memory[0][i])
        control(autopilots[i], steering, wanted[k, i], pose[i], twist[i], around, TICK, memory[1][i], command[i])


def _trajectory(plant: Plant, record: Floats) -> Trajectory | None:
    n = record.shape[0]
    if n < 2:
        return None
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
        time=np.arange(n, dtype=np.float64) * TICK,
        site_names=plant.site_names,
        site_vehicle=plant.site_vehicle.copy(),
        site_offset=plant.site_offset.copy(),
        **part,
    )


def fly_fleet(
    plant: Plant,
    routes: Sequence[Route],
    duration: float,
    depth_control: Sequence[DepthControl] = (),
    *,
    limits: Sequence[Limits] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Fly every vehicle of a plant along its route.

    Args:
        plant: at its start, which is where the vehicles begin, whatever the routes say; moved on to the end.
        routes: one for each vehicle.
        duration: [s]; a multiple of 0.1 s.
        depth_control: of each vehicle; empty: "pitch" for all.
        limits: what each vehicle can do; None: the paper's turn rate, acceleration and top speed.
        progress: called with the mission time [s], every 50 s of it.

    Returns:
        Truth every 0.1 s, time 0 and `duration` included.

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
    command = np.zeros((v, 5))
    state, water = (plant.pose, plant.twist, plant.thrust), plant.ocean.water
    step = plant.step
    for k in range(ticks + 1):
        _tick(k, state, water, wanted, autopilots, memory, record, command)
        if k == ticks:
            break
        try:
            step(command, substeps)
        except PlantError as error:
            raise FleetError(str(error), error.time, _trajectory(plant, record[: k + 1])) from error
        if progress is not None and k % _PROGRESS_TICKS == 0:
            progress(k * TICK)
    flown = _trajectory(plant, record)
    assert flown is not None  # one tick at least makes two instants
    return flown
