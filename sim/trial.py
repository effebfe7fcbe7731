"""A trial before a flight: how far vehicles will be off their routes, depths and stations.

Vehicles of the user's choice are flown along the mission by the truth, in its sea, without
navigation. What limits them is all in it: turning circles, slip in turns, thrust, currents, waves.
The project's own hulls with their own coefficients keep all routes and stations that are accepted,
and are not tried.
"""

from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.hull import HULL_KEYS
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Follower, Navigation, Scenario, Vehicle
from sim.scenario.vehicle_routes import route_of
from sim.simulation import (
    EndedError,
    simulate_motion,
)
from sim.tracking import JOINED_M, cross_track, off_station
from sim.trajectory import Trajectory

OFF_ROUTE_M = 2.0  # a vehicle that is once farther than this off its legs is reported [m]
OFF_DEPTH_M = 2.0  # … or off the depth that is due
OFF_STATION_M = 5.0  # … or off its station, once it has joined it
LONGEST_S = 3600.0  # a trial of a longer mission ends at this time [s]


class TrackDeviation(NamedTuple):
    """How far a vehicle is off what it is to keep."""

    quantity: str  # its route, its depth, its station
    rms_m: float
    largest_m: float
    time_s: float  # of the largest distance

    def __str__(self) -> str:
        return (
            f"it is up to {self.largest_m:.1f} m off {self.quantity}, at {self.time_s:.0f} s "
            f"(RMS {self.rms_m:.2g} m)"
        )


def is_custom(vehicle: Vehicle) -> bool:
    """Whether a vehicle has another hull than the project's own leader and follower."""
    fields = Vehicle.model_fields
    changed = any(getattr(vehicle, key) != fields[key].default for key in HULL_KEYS)
    return changed or vehicle.model is not None


def _deviation(quantity: str, errors: Floats, time: Floats) -> TrackDeviation:
    worst = int(np.argmax(errors))
    return TrackDeviation(
        quantity, float(np.sqrt(np.mean(errors**2))), float(errors[worst]), float(time[worst])
    )


def _deviations_of(
    vehicle: Vehicle, trajectory: Trajectory, i: int, station_error: Floats
) -> list[TrackDeviation]:
    """Where vehicle i is off by more than is usual; `station_error` is its distance from its
    station, shape (n,), [m]; without one it is not read.
    """
    time = trajectory.time
    if isinstance(vehicle, Follower) and vehicle.station:
        joined = int(np.argmax(station_error < JOINED_M))
        deviation = _deviation("its station", station_error[joined:], time[joined:])
        return [deviation] if deviation.largest_m > OFF_STATION_M else []
    route = route_of(vehicle, trajectory.names[i])
    on_route = time <= route.time[-1] + 1e-9
    route_error = cross_track(route, time[on_route], trajectory.position[on_route, i, :2])
    depth_error = np.abs(trajectory.depth[:, i] - route.depth.depth_at(time))
    deviations = []
    for errors, bound, quantity in (
        (route_error, OFF_ROUTE_M, "its route"),
        (depth_error, OFF_DEPTH_M, "its depth"),
    ):
        deviation = _deviation(quantity, errors, time)
        if deviation.largest_m > bound:
            deviations.append(deviation)
    return deviations


def track_deviations(motion: MotionSettings, trajectory: Trajectory) -> list[str]:
    """How far vehicles with other hulls than the project's own are off their routes, depths and
    stations, a line for each that is farther off than is usual.
    """
    lines = []
    station_errors = off_station(motion, trajectory)
    for i, (_, vehicle) in enumerate(motion.plan.vehicles()):
        if not is_custom(vehicle):
            continue
        deviations = _deviations_of(vehicle, trajectory, i, station_errors[:, max(i - 1, 0)])
        if deviations:
            lines.append(f"{trajectory.names[i]}: {'; '.join(map(str, deviations))}")
    return lines


def _on_trial(followers: Iterable[Follower]) -> list[Follower]:
    return [f for f in followers if is_custom(f) and not f.controller]


def needs_trial(motion: MotionSettings) -> bool:
    """Whether a mission has rigid bodies with other hulls than the project's own."""
    any_custom = is_custom(motion.plan.leader) or bool(_on_trial(motion.plan.followers))
    return motion.kind == "physics" and any_custom


def _trial_scenario(scenario: Scenario) -> Scenario:
    """The mission of the leader and of followers to be tried, steered by the truth."""
    followers = _on_trial(scenario.followers)
    if not followers:
        # a mission has one at least, best one whose control needs no closed loop
        followers = sorted(scenario.followers, key=lambda f: f.station is not None)[:1]
    step = scenario.timing.filter_step_s
    duration = min(scenario.duration_s, round(LONGEST_S / step) * step)
    by_truth = {"guidance_position": "truth", "controller": None}
    leader_by_truth = {
        "controller": None,
        "navigation": None,
        "broadcast_position": "truth",
        "guidance_position": "truth",
    }
    changes: dict[str, Any] = {
        "duration_s": duration,
        "leader": scenario.leader.model_copy(update=leader_by_truth),
        "contact": "mark",
        "followers": tuple(f.model_copy(update=by_truth) for f in followers),
    }
    if scenario.links:
        # who sends or receives may not be on trial, and estimates steer nobody
        changes |= {"links": (), "navigation": Navigation()}
    return scenario.model_copy(update=changes)


def trial(scenario: Scenario) -> list[str]:
    """What `track_deviations` says of a flight by the truth, and how that ends if it does before
    its time; nothing unless the scenario `needs_trial`.
    """
    if not needs_trial(MotionSettings.of(scenario)):
        return []
    on_trial = _trial_scenario(scenario)
    motion = MotionSettings.of(on_trial)
    make_controller = None
    if on_trial.keys_needing_closed_loop():
        # control of formations takes long to load
        from sim.closed_loop import closed_loop_of

        make_controller = partial(closed_loop_of, on_trial)
    try:
        trajectory = simulate_motion(on_trial, make_controller=make_controller)
    except EndedError as error:
        return [str(error), *track_deviations(motion, error.trajectory)]
    except (LaisnError, ArithmeticError) as error:
        return [str(error)]
    return track_deviations(motion, trajectory)
