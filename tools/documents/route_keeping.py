"""How closely the physical vehicles keep to the published routes: `python -m
tools.documents.studies route-keeping`.

Simulates the leader and all eight followers in one calm sea.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.flight.library import ROUTES
from laisn.arrays import Floats
from reports.findings import RESULTS_FILE, Finding, Findings, plain_finding, record
from sim.assembly import routes_of
from sim.scenario.parts import MissionPlan
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from sim.scenario.settings import Follower, Scenario
from sim.simulation import simulate_motion
from sim.tracking import cross_track
from sim.trajectory import Trajectory

COMMAND = "python -m tools.documents.studies route-keeping"
MODULES = ("tools.documents.route_keeping",)


@dataclass(frozen=True, kw_only=True)
class TrackingReport:
    """One vehicle on its route, from the start to the last waypoint (or the end of the
    trajectory).
    """

    name: str
    cross_track_rms: float
    """Distance to the straight legs between waypoints [m]; cut corners count as they are."""
    cross_track_max: float  # [m]
    arrival_error_max: float
    """Largest difference between the time at which a waypoint is nearest and its time on the
    route [s].
    """
    speed_error_rms: float
    """Error of the speed over ground against the point motion along the same route [m/s]."""
    depth_error_rms: float
    """Error of the depth against that of the route or profile [m]."""
    depth_error_max: float  # [m]
    pitch_max: float
    """Largest size of the pitch [rad]."""
    pitch_std: float  # [rad]
    roll_max: float  # [rad]
    roll_std: float  # [rad]


def arrival_errors(route: Route, time: Floats, position: Floats) -> Floats:
    """When each waypoint is nearest, less its time on the route; arguments as of `cross_track`.

    A waypoint is looked for until half a leg before and after it; those where the vehicle stops,
    and those later than the last instant, are left out.

    Returns:
        Shape (number of waypoints passed,), [s].
    """
    middle = 0.5 * (route.time[:-1] + route.time[1:])
    begin = np.concatenate([route.time[:1], middle])
    end = np.concatenate([middle, [np.inf]])
    errors = []
    rests = route.leg_length == 0
    stops = np.append(rests, False) | np.append(False, rests)
    for arrival, waypoint, window_begin, window_end, is_stop in zip(
        route.time, route.waypoint, begin, end, stops, strict=True
    ):
        if arrival > time[-1] + 1e-9:
            break
        if is_stop:
            continue
        window = np.flatnonzero((time >= window_begin) & (time <= window_end))
        errors.append(time[window[np.hypot(*(position[window] - waypoint).T).argmin()]] - arrival)
    return np.array(errors)


def tracking(trajectory: Trajectory, routes: Sequence[Route]) -> tuple[TrackingReport, ...]:
    """How each vehicle of a trajectory kept to its route."""
    reports = []
    for i, (name, route) in enumerate(zip(trajectory.names, routes, strict=True)):
        n = int(np.searchsorted(trajectory.time, route.time[-1] + 1e-9, side="right"))
        time = trajectory.time[:n]
        position = trajectory.position[:n, i, :2]
        errors = cross_track(route, time, position)
        delays = arrival_errors(route, trajectory.time, trajectory.position[:, i, :2])
        intended = plan(route).at(time)
        speed_error = np.hypot(*trajectory.velocity[:n, i, :2].T) - intended.speed
        depth_error = trajectory.depth[:n, i] - route.depth.at(time)[0]
        pitch = trajectory.pitch[:n, i]
        roll = trajectory.roll[:n, i]
        reports.append(
            TrackingReport(
                name=name,
                cross_track_rms=float(np.sqrt(np.mean(errors**2))),
                cross_track_max=float(errors.max()),
                arrival_error_max=float(np.abs(delays).max(initial=0.0)),
                speed_error_rms=float(np.sqrt(np.mean(speed_error**2))),
                depth_error_rms=float(np.sqrt(np.mean(depth_error**2))),
                depth_error_max=float(np.abs(depth_error).max()),
                pitch_max=float(np.abs(pitch).max()),
                pitch_std=float(pitch.std()),
                roll_max=float(np.abs(roll).max()),
                roll_std=float(roll.std()),
            )
        )
    return tuple(reports)


def scenario(routes: tuple[str, ...] = ROUTES, duration_s: float = 1000.0) -> Scenario:
    """Leader and followers on their routes, each named after its route."""
    return Scenario(
        name="routes",
        duration_s=duration_s,
        followers=tuple(Follower(name=route, route=route) for route in routes),
    )


def measure(mission: Scenario) -> tuple[TrackingReport, ...]:
    """Fly the mission and report on every vehicle, the leader first."""
    return tracking(simulate_motion(mission), routes_of(MissionPlan.of(mission)))


def _findings(report: TrackingReport, name: str) -> dict[str, Finding]:
    """Findings on a vehicle, a row of the table."""
    pitch_max, pitch_std, roll_max = (
        float(np.rad2deg(a)) for a in (report.pitch_max, report.pitch_std, report.roll_max)
    )
    values = {
        "off-rms": (report.cross_track_rms, "m"),
        "off-max": (report.cross_track_max, "m"),
        "arrival": (report.arrival_error_max, "s"),
        "speed": (report.speed_error_rms, "m/s"),
        "depth": (report.depth_error_rms, "m"),
        "pitch-max": (pitch_max, "°"),
        "pitch-sigma": (pitch_std, "°"),
        "roll-max": (roll_max, "°"),
    }
    return {
        f"{key} {name}": plain_finding(float(value), "", unit)
        for key, (value, unit) in values.items()
    }


def findings_of(reports: Sequence[TrackingReport], planned: TrackingReport) -> Findings:
    """The record: every vehicle, the extremes of them all, and T8 as the point motion flies it."""
    report_findings = [_findings(report, report.name) for report in reports]
    record_findings: dict[str, Finding] = {
        key: finding for findings in report_findings for key, finding in findings.items()
    }
    for row in zip(*(findings.items() for findings in report_findings), strict=True):
        quantity = row[0][0].partition(" ")[0]
        values = [finding.number for _, finding in row]
        record_findings[f"{quantity} least"] = plain_finding(
            min(values), "of all vehicles", row[0][1].unit
        )
        record_findings[f"{quantity} most"] = plain_finding(
            max(values), "of all vehicles", row[0][1].unit
        )
    record_findings |= _findings(planned, "T8-plan")
    return record("route-keeping", COMMAND, MODULES, record_findings)


def run(folder: Path) -> None:
    """Fly everything and write the record into a folder."""
    planned = measure(scenario(("T8",)).model_copy(update={"motion": "kinematic"}))[1]
    findings_of(measure(scenario()), planned).write(folder / RESULTS_FILE)
