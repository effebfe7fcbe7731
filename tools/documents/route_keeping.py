"""How closely the physical vehicles keep to the published routes: `python -m tools.documents.studies route-keeping`.

Simulates the leader and all eight followers in one calm sea.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.findings import FILE, Finding, Findings, plain, record
from experiments.flight.library import ROUTES
from sim.assembly import routes_of
from sim.motion import simulate_motion
from sim.scenario.settings import Follower, Scenario
from sim.tracking import TrackingReport, tracking

COMMAND = "python -m tools.documents.studies route-keeping"
MODULES = ("tools.documents.route_keeping",)


def scenario(routes: tuple[str, ...] = ROUTES, duration_s: float = 1000.0) -> Scenario:
    """Leader and followers on their routes, each named after its route."""
    return Scenario(
        name="routes",
        duration_s=duration_s,
        followers=tuple(Follower(name=route, route=route) for route in routes),
    )


def measure(mission: Scenario) -> tuple[TrackingReport, ...]:
    """Fly the mission and report on every vehicle, the leader first."""
    return tracking(simulate_motion(mission), routes_of(mission))


def _findings(report: TrackingReport, name: str) -> dict[str, Finding]:
    """Row of a vehicle in the table."""
    pitch, spread, roll = (float(np.rad2deg(a)) for a in (report.pitch_max, report.pitch_std, report.roll_max))
    values = {
        "off-rms": (report.cross_track_rms, "m"),
        "off-max": (report.cross_track_max, "m"),
        "arrival": (report.arrival_error_max, "s"),
        "speed": (report.speed_error_rms, "m/s"),
        "depth": (report.depth_error_rms, "m"),
        "pitch-max": (pitch, "°"),
        "pitch-sigma": (spread, "°"),
        "roll-max": (roll, "°"),
    }
    return {f"{key} {name}": plain(float(value), "", unit) for key, (value, unit) in values.items()}


def findings_of(reports: Sequence[TrackingReport], planned: TrackingReport) -> Findings:
    """The record: every vehicle, the extremes of them all, and T8 as the point motion flies it."""
    each = [_findings(report, report.name) for report in reports]
    named: dict[str, Finding] = {key: finding for one in each for key, finding in one.items()}
    for row in zip(*(one.items() for one in each), strict=True):
        quantity, values = row[0][0].partition(" ")[0], [finding.number for _, finding in row]
        named[f"{quantity} least"] = plain(min(values), "of all vehicles", row[0][1].unit)
        named[f"{quantity} most"] = plain(max(values), "of all vehicles", row[0][1].unit)
    named |= _findings(planned, "T8-plan")
    return record("route-keeping", COMMAND, MODULES, named)


def run(folder: Path) -> None:
    """Fly everything and write the record into a folder."""
    planned = measure(scenario(("T8",)).model_copy(update={"motion": "kinematic"}))[1]
    findings_of(measure(scenario()), planned).write(folder / FILE)
