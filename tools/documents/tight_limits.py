"""Where the tightly coupled navigator comes to its limits: `python -m tools.documents.studies
tight-limits`.

The study `leader-errors` compares it with LAISN and a plain filter, route by route, where the
leader errs about its place and where its pings leave one after another. A map of NEES over bearing
and distance shows where its covariance with two transmitters is the size of its errors.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from experiments.campaign.campaign import ExecutionOptions
from experiments.study.file import study_of
from experiments.study.plan import plan_of
from experiments.study.run import Cells, fly_studies
from laisn.arrays import Floats
from laisn.messages import LeaderMessage, Measurements
from laisn.settings import TightSettings
from laisn.tight.navigator import run_mission
from reports.findings import (
    RESULTS_FILE,
    Finding,
    interval_finding,
    plain_finding,
    record,
    share_finding,
)
from reports.intervals import mean_interval, mean_over_missions

COMMAND = "python -m tools.documents.studies tight-limits"
MODULES = ("tools.documents.tight_limits", "experiments.study.run")
STUDY = "leader-errors"
RIVALS = {"tight": ("ekf", "laisn-3-2"), "tight-2": ("ekf-2", "laisn-2")}
"""Arms of the study that are compared with the tightly coupled navigator, with as many
transmitters.
"""

DT = 0.1  # [s]
STEPS = 4000
RUNS = 30
START = np.zeros(4)  # east, north and velocity of the follower
BEARINGS_DEG = (0.0, 15.0, 30.0, 60.0, 90.0, 120.0, 150.0, 165.0, 180.0)
"""From the leader's bow to starboard."""
DISTANCES_M = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 400.0, 500.0)
INTERVALS_S = (1.0, 5.0)
DEEPER_M = (0.0, 1.0)
"""Depths of the follower below the leader."""
LOCKED_NEES = 25.0
"""Mean over a run beyond which it counts as locked on a wrong place: five standard deviations."""

# transmitters of a leader that heads east, from its middle: rear, front, middle; east, north [m]
_TRANSMITTERS = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.1]])
_SPEED_BIAS = 0.2  # [m/s]
_COMPASS_BIAS = np.deg2rad(5.0)  # [rad]
_RANGE_ERROR = 0.005  # of each range, uniform [m]
# σ of an error in proportion to the ranges of a message, at the largest of them [m]
_COMMON_ERROR = 0.05
_DEPTH = 8.0  # of the leader [m]


def measured_beside(
    bearing_deg: float, distance: float, deeper: float, run: int, interval: float = 1.0
) -> Measurements:
    """Measurements of a follower that keeps its place beside a leader on a straight course east at
    1 m/s, with the paper's errors; the follower starts at the origin.

    Args:
        bearing_deg: of the follower from the leader's bow, to starboard.
        distance: of the two in the plane [m].
        deeper: depth of the follower below the leader [m].
        run: number of the draw of errors.
        interval: between messages [s].
    """
    rng = np.random.default_rng([run, int(10 * distance), int(bearing_deg)])
    stride = round(interval / DT)
    step = np.arange(stride, STEPS + 1, stride)
    bearing = np.pi / 2 + np.deg2rad(bearing_deg)
    offset = distance * np.array([np.sin(bearing), np.cos(bearing)])
    true = np.sqrt(np.sum((offset - _TRANSMITTERS) ** 2, axis=1) + deeper**2)
    common = rng.normal(0.0, _COMMON_ERROR, (step.size, 1)) / true.max()
    ranges = true * (1.0 + common) + rng.uniform(-_RANGE_ERROR, _RANGE_ERROR, (step.size, 3))
    message = np.full((step.size, len(LeaderMessage._fields)), np.nan)
    # as `LeaderMessage`: time, east, north, heading, speed, depth
    message[:, 0] = DT * step
    message[:, 1] = DT * step - offset[0]
    message[:, 2] = -offset[1]
    message[:, 3] = np.pi / 2
    message[:, 4] = 1.0
    message[:, 5] = _DEPTH
    return Measurements(
        dt=DT,
        speed=1.0 + _SPEED_BIAS + rng.normal(0.0, 0.2, STEPS),
        heading=np.pi / 2 + _COMPASS_BIAS + rng.normal(0.0, np.deg2rad(1.2), STEPS),
        depth=np.full(STEPS, _DEPTH + deeper),
        message_step=step,
        message=message,
        ranges=ranges,
    )


def normalised_errors(
    bearing_deg: float, distance: float, deeper: float, interval: float, runs: int
) -> Floats:
    """Mean eᵀP⁻¹e (NEES) of each run, shape (runs,); 2 for a right covariance. Places as of
    `measured_beside`.
    """
    truth = np.zeros((STEPS, 2))
    truth[:, 0] = DT * np.arange(1, STEPS + 1)
    means = np.empty(runs)
    for run in range(runs):
        measured = measured_beside(bearing_deg, distance, deeper, run, interval)
        estimates = run_mission(TightSettings(transmitters=2), measured, START)
        errors = estimates.state[:, :2] - truth
        xx, xy, yy = estimates.covariance.T
        squared = (
            errors[:, 0] ** 2 * yy - 2.0 * errors[:, 0] * errors[:, 1] * xy + errors[:, 1] ** 2 * xx
        )
        means[run] = np.mean(squared / (xx * yy - xy**2))
    return means


def map_of_nees(runs: int = RUNS) -> Iterator[tuple[str, Finding]]:
    """Median over runs at each place, and over all places its least and most and the share of
    locked runs.
    """
    for interval in INTERVALS_S:
        nees_of_places = list[Floats]()
        for deeper in DEEPER_M:
            for bearing in BEARINGS_DEG:
                for distance in DISTANCES_M:
                    nees = normalised_errors(bearing, distance, deeper, interval, runs)
                    nees_of_places.append(nees)
                    yield (
                        f"nees {bearing:g} {distance:g} {deeper:g} {interval:g}",
                        plain_finding(float(np.median(nees)), "NEES, median of runs"),
                    )
        medians = np.median(nees_of_places, axis=1)
        yield f"nees-least {interval:g}", plain_finding(float(medians.min()), "of all places")
        yield f"nees-most {interval:g}", plain_finding(float(medians.max()), "of all places")
        locked = np.array(nees_of_places).ravel() > LOCKED_NEES
        yield f"nees-locked {interval:g}", share_finding(locked, "share of runs that lock, 95 %")


def case_findings(case: str, arms: Mapping[str, Cells]) -> Iterator[tuple[str, Finding]]:
    """Errors, NEES and paired differences of all arms in a case, of means over routes and of the
    worst route.
    """
    for arm, routes in arms.items():
        errors = routes.values_by_run("e_p_mean_m")
        nees = routes.values_by_run("nees").mean(axis=0)
        name = f"{arm} {case}"
        yield (
            f"error {name}",
            interval_finding(mean_over_missions([*errors.T]), "mean E_P over routes", "m"),
        )
        worst = float(errors.mean(axis=0).max())
        yield f"worst {name}", plain_finding(worst, "mean E_P on the worst route", "m")
        yield f"nees-least {name}", plain_finding(float(nees.min()), "mean NEES, of all routes")
        yield f"nees-most {name}", plain_finding(float(nees.max()), "mean NEES, of all routes")
    for ours, rivals in RIVALS.items():
        better = 0  # pairs of a rival and a route
        for rival in rivals:
            rival_error = arms[rival].values_by_run("e_p_mean_m")
            advantage = rival_error - arms[ours].values_by_run("e_p_mean_m")
            name = f"{rival} {case}"
            meaning = f"paired difference of mean E_P: {rival} less {ours}"
            yield (
                f"less {name}",
                interval_finding(mean_over_missions([*advantage.T]), f"{meaning}, 95 %", "m"),
            )
            intervals = [mean_interval(route_advantage) for route_advantage in advantage.T]
            nearest = min(intervals, key=lambda interval: interval.value)
            yield (
                f"least {name}",
                interval_finding(nearest, f"{meaning}, on the route of the least, 95 %", "m"),
            )
            better += sum(interval.high < 0.0 for interval in intervals)
        meaning = "routes on which a rival's mean E_P is smaller, the whole interval below 0"
        yield f"better-than {ours} {case}", plain_finding(better, meaning)


def run(
    folder: Path,
    keys: Mapping[str, Any] | None = None,
    map_runs: int = RUNS,
    **options: Unpack[ExecutionOptions],
) -> None:
    """Fly the study and draw the map, and write the record into a folder.

    `keys` replace some of the study; folder and options as of `campaign.fly`.
    """
    results = fly_studies([plan_of(study_of(STUDY, keys or {}))], folder, **options)[0]
    cells = results.cells.by("arm", "case")
    arms = list(results.plan.study.arms)
    findings: dict[str, Finding] = {
        "runs": plain_finding(len(next(iter(cells.values())).values_by_run("run")), "")
    }
    for case in results.plan.study.cases:
        findings |= dict(case_findings(case, {arm: cells[f"{arm} {case}"] for arm in arms}))
    for ours in RIVALS:
        total = sum(
            findings[f"better-than {ours} {case}"].number for case in results.plan.study.cases
        )
        findings[f"better-than {ours}"] = plain_finding(
            int(total), "the same of all cases together"
        )
    findings |= dict(map_of_nees(map_runs))
    record("tight-limits", COMMAND, MODULES, findings).write(folder / RESULTS_FILE)
