"""What a study is judged by: columns of its tables, those of a mission, and those of a run in
closed loop.
"""

import tomllib
from collections.abc import Sequence
from importlib import resources
from typing import NamedTuple, cast

import numpy as np

from experiments.campaign.montecarlo import PERCENTILES
from experiments.campaign.store import CampaignError, Record
from laisn import metrics
from laisn.arrays import Bools, Floats
from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.geometry import pitch_fix_error
from sim.assembly import routes_of
from sim.attitude import heading_angles, pitch_angles
from sim.closed_loop import AnyClosedLoop, closed_loop_mission
from sim.flight import Termination
from sim.mission_group import fly_side_by_side
from sim.power import thruster_power
from sim.scenario.formation import MIN_LAYER_SPACING_M
from sim.scenario.parts import MotionSettings
from sim.scenario.routes import Route
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.simulation import DivergedError, EndedError, Mission, fly_mission
from sim.tracking import (
    LeastDistances,
    contacts,
    cross_track,
    least_distances,
    station_keeping,
    track_errors,
    true_stations,
)
from sim.trajectory import Trajectory

UNITS = {
    "deg_sqrt_h": "°/√h",
    "m_s2": "m/s²",
    "m_s": "m/s",
    "kg_m3": "kg/m³",
    "deg_s": "°/s",
    "deg_h": "°/h",
    "per_s": "1/s",
    "ppm": "ppm",
    "deg": "°",
    "kg": "kg",
    "m2": "m²",
    "m": "m",
    "s": "s",
    "n": "N",
    "j": "J",
    "w": "W",
}
"""Units by the ends of keys and columns, the longer ones first."""


def without_unit(name: str) -> tuple[str, str]:
    """A key or column without the unit at its end, and that unit; empty where it has none."""
    suffix = next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")
    return name.removesuffix(f"_{suffix}") if suffix else name, UNITS.get(suffix, "")


class Metric(NamedTuple):
    """A column of results.parquet or runs.parquet."""

    label: str
    meaning: str
    unit: str = ""


_DATA = tomllib.loads((resources.files(__package__) / "metrics.toml").read_text(encoding="utf-8"))
# labels and meanings of what is measured of a mission
MISSION_METRICS: dict[str, list[str]] = _DATA["mission"]
_PERCENTILES = {
    f"e_{kind}_p{p}_{unit}": [f"{p}th percentile of E_{kind.upper()}", "over steps and runs"]
    for kind, unit in (("p", "m"), ("b", "deg"))
    for p in PERCENTILES
}
_FIXES = {
    f"fixes_{kind.name.lower()}": [
        f"fixes: {kind.name.lower().replace('_', ' ')}",
        "number over all runs",
    ]
    for kind in FixKind
}


def _metric(name: str, label: str, meaning: str) -> Metric:
    _, unit = without_unit(name)
    return Metric(f"{label} [{unit}]" if unit else label, meaning, unit)


_LABELS_AND_MEANINGS = _DATA["errors"] | _PERCENTILES | _FIXES | MISSION_METRICS
METRICS: dict[str, Metric] = {
    name: _metric(name, label, meaning) for name, (label, meaning) in _LABELS_AND_MEANINGS.items()
}
RUN_METRICS = (
    "e_p_mean_m",
    "e_p_max_m",
    "e_p_rms_m",
    "e_b_mean_deg",
    "e_b_max_deg",
    "mirror_locked",
    "gated",
    "nees",
    "nis",
)
"""Those that single runs of a mission have which runs share; each run of a closed loop has more."""
# metrics that a run either has or has not: 1 or 0
SHARES = frozenset({"mirror_locked", "lost", "touched", "ended"})

TURNING_RAD_S = 1e-3  # A formation whose frame turns faster is in a turn [rad/s]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _station(errors: Floats, turning: Bools, time: Floats) -> Record:
    """Columns of how a follower kept its station: distances from it [m], whether the formation's
    frame turns, and times [s], all of shape (n,).
    """
    keeping = station_keeping(errors, time)
    leg = errors[~turning]
    return {
        "station_rms_m": keeping.station_rms_m,
        "station_p95_m": keeping.station_p95_m,
        "station_max_m": keeping.station_max_m,
        "station_turn_max_m": float(errors[turning].max(initial=0.0)),
        "station_leg_rms_m": _rms(leg) if leg.size else None,
        "lost": float(keeping.lost),
    }


def _motion_columns(
    motion: MotionSettings, trajectory: Trajectory, v: int, depth_error: Floats
) -> Record:
    """Columns of the motion of vehicle v; `depth_error` is its depth less its route's, shape (n,),
    [m].
    """
    pitch_deg = np.rad2deg(pitch_angles(trajectory.quaternion[:, v]))
    power = None
    if motion.kind == "physics":
        mean = float(thruster_power(trajectory, v, motion.sea.ocean.density_kg_m3).mean())
        power = mean if np.isfinite(mean) else None
    span_s = float(trajectory.time[-1] - trajectory.time[0])
    return {
        "pitch_rms_deg": _rms(pitch_deg),
        "pitch_max_deg": float(np.abs(pitch_deg).max()),
        "depth_error_rms_m": _rms(depth_error),
        "power_mean_w": power,
        "energy_j": None if power is None else power * span_s,
    }


def _distance_columns(motion: MotionSettings, distances: LeastDistances, v: int) -> Record:
    """Columns of the least distances of vehicle v from all others."""
    held_depths = np.array([vehicle.held_depth_m for _, vehicle in motion.plan.vehicles()])
    horizontal = np.delete(distances.horizontal[v], v)
    is_in_layer = np.abs(np.delete(held_depths, v) - held_depths[v]) < MIN_LAYER_SPACING_M
    horizontal_in_layer = horizontal[is_in_layer]
    return {
        "closest_approach_m": float(distances.in_space[v].min()),
        "closest_horizontal_m": float(horizontal.min()),
        "closest_in_layer_m": (
            float(horizontal_in_layer.min()) if horizontal_in_layer.size else None
        ),
    }


def _pitch_fix_error(trajectory: Trajectory, v: int) -> float | None:
    """Mean over whole seconds of what the leader's pitch takes a fix of vehicle v off its place
    [m]; None: the mission has no whole second.
    """
    each_second = round(1.0 / CONTROL_STEP_S)
    seconds = slice(each_second, None, each_second)
    east, north, up = (trajectory.position[seconds, v] - trajectory.position[seconds, 0]).T
    if not east.size:
        return None
    off_bow = np.arctan2(east, north) - heading_angles(trajectory.quaternion[seconds, 0])
    horizontal = np.maximum(np.hypot(east, north), 1e-9)
    leader_pitch = pitch_angles(trajectory.quaternion[seconds, 0])
    return float(pitch_fix_error(leader_pitch, -up, horizontal, off_bow).mean())


def _cross_track_columns(route: Route, trajectory: Trajectory, v: int) -> Record:
    """Columns of the distances of vehicle v from the legs of its route, while that lasts."""
    last = np.searchsorted(trajectory.time, route.time[-1] + 1e-9, side="right")
    offsets = cross_track(route, trajectory.time[:last], trajectory.position[:last, v, :2])
    return {"cross_track_rms_m": _rms(offsets), "cross_track_max_m": float(offsets.max())}


def facts_of(motion: MotionSettings, trajectory: Trajectory) -> list[Record]:
    """What the motion of a mission shows of each of its followers: a record by columns of
    `METRICS`.

    Point motion has no thrusters: its powers are None. Followers without stations have no columns
    of stations.
    """
    plan = motion.plan
    routes = routes_of(plan)
    position = trajectory.position
    depth_errors = [
        -position[:, v, 2] - route.depth.depth_at(trajectory.time) for v, route in enumerate(routes)
    ]
    on_stations = any(follower.station for follower in plan.followers)
    stations = true_stations(motion, trajectory) if on_stations else None
    errors_of_tracks = track_errors(motion, trajectory, stations)
    distances = least_distances(position)
    touching = {name for contact in contacts(trajectory) for name in contact.pair}
    of_leader = _motion_columns(motion, trajectory, 0, depth_errors[0])
    leader_columns = {f"leader_{name}": value for name, value in of_leader.items()}
    records = []
    for v, follower in enumerate(plan.followers, start=1):
        errors = errors_of_tracks[:, v - 1]
        east, north, up = (position[:, v, axis] - position[:, 0, axis] for axis in range(3))
        row: Record = {
            "track_error_rms_m": _rms(errors),
            "track_error_max_m": float(errors.max()),
            "track_error_end_m": float(errors[-1]),
            "depth_error_max_m": float(np.abs(depth_errors[v]).max()),
            **_distance_columns(motion, distances, v),
            "touched": float(trajectory.names[v] in touching),
            "range_mean_m": float(np.sqrt(east**2 + north**2).mean()),
            "depth_offset_rms_m": _rms(up),
            "pitch_fix_error_m": _pitch_fix_error(trajectory, v),
        }
        if follower.station and stations is not None:
            is_turning = np.abs(stations.rate[:, v - 1]) > TURNING_RAD_S
            row |= _station(errors, is_turning, trajectory.time)
        else:
            row |= _cross_track_columns(routes[v], trajectory, v)
        of_follower = _motion_columns(motion, trajectory, v, depth_errors[v])
        records.append(row | of_follower | leader_columns)
    return records


_COLUMNS_OF_ENDED = ("run", "touched", "ended")


class _ClosedLoopRun(NamedTuple):
    """A run of a closed loop before its flight, and what its results follow from."""

    number: int
    motion: MotionSettings
    stride: int  # control instants of a filter step
    message_every: int  # filter steps
    mission: Mission


def _set_out(runs: Sequence[tuple[Scenario, int]]) -> list[_ClosedLoopRun]:
    """Runs of scenarios before their flights."""
    scenarios = [scenario.model_copy(update={"run": run}) for scenario, run in runs]
    return [
        _ClosedLoopRun(
            number=scenario.run,
            motion=MotionSettings.of(scenario),
            stride=round(scenario.timing.filter_step_s / CONTROL_STEP_S),
            message_every=scenario.message_every,
            mission=closed_loop_mission(scenario, whole=False),
        )
        for scenario in scenarios
    ]


def records_of_run(scenario: Scenario, run: int) -> list[Record]:
    """Simulates a run in closed loop; its results for each follower, by the names of a cell's lists
    and of `facts_of`.

    A run that contact, the floor or a lost route ended has no other results than that: a mean over
    missions of unlike length would hide it. CampaignError: the simulation left finite numbers.
    """
    (alone,) = _set_out([(scenario, run)])
    return _records(alone)


def records_of_runs(runs: Sequence[tuple[Scenario, int]]) -> list[list[Record] | None]:
    """The same of up to eight runs, whose vehicles move side by side where they can, to the bit;
    None: one that fails, and tells why when it is flown alone.
    """
    together = _set_out(runs)
    results: list[list[Record] | None] = []
    fit = fly_side_by_side([run.mission for run in together])
    for run, is_fit in zip(together, fit, strict=True):
        try:
            results.append(_records(run) if is_fit else None)
        except (LaisnError, ArithmeticError):
            results.append(None)
    return results


def _error_columns(name: str, unit: str, errors: Floats) -> Record:
    """Columns of a run's errors from the first estimate on; None where there is no estimate."""
    return {
        f"{name}_max_{unit}": float(errors.max()) if errors.size else None,
        f"{name}_mean_{unit}": float(errors.mean()) if errors.size else None,
    }


def _records(run: _ClosedLoopRun) -> list[Record]:
    """Results of `records_of_run` of a run that has not been flown, or to its end."""
    stride = run.stride
    loop = cast(AnyClosedLoop, run.mission.controller)
    ended = False
    try:
        trajectory = fly_mission(run.motion, run.mission)
        filter_steps = (trajectory.time.size - 1) // stride
        estimates = np.moveaxis(loop.state.concluded.state[:, :filter_steps, :2], 0, 1)
        gated = loop.gated.tolist()
    except DivergedError:
        raise CampaignError(f"run {run.number}: {Termination.DIVERGED.value}") from None
    except EndedError as error:
        trajectory = error.trajectory
        ended = True
        followers = len(run.motion.plan.followers)
        estimates = np.full(((trajectory.time.size - 1) // stride, followers, 2), np.nan)
        gated = [0] * followers
    steps = slice(stride, len(estimates) * stride + 1, stride)
    leader = trajectory.position[steps, 0, :2]
    heading = trajectory.heading[steps, 0]
    rows = []
    for i, facts in enumerate(facts_of(run.motion, trajectory)):
        estimate = estimates[:, i]
        truth = trajectory.site_path(f"{trajectory.names[i + 1]}/hydrophone")[steps, :2]
        position_error = metrics.position_errors(estimate, truth)
        bearing_error_deg = np.rad2deg(metrics.bearing_errors(estimate, truth, leader))
        # with an unknown start there is no estimate before the first messages
        has_estimate = np.isfinite(position_error)
        locked = metrics.mirror_locked_steps(estimate, truth, leader, heading)
        row: Record = {
            "run": run.number,
            **_error_columns("e_p", "m", position_error[has_estimate]),
            **_error_columns("e_b", "deg", bearing_error_deg[has_estimate]),
            "mirror_locked": metrics.longest_mirror_lock(locked) >= run.message_every,
            "gated": gated[i],
            **facts,
            "ended": ended,
        }
        rows.append(
            {
                name: value if not ended or name in _COLUMNS_OF_ENDED else None
                for name, value in row.items()
            }
        )
    return rows
