"""Ten followers in formation, through all conditions: `laisn formation`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Unpack

import numpy as np

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions
from experiments.campaign.tasks import with_arrays
from experiments.findings import FILE, Finding, Findings, of, plain, record
from experiments.formation import weave
from experiments.formation.conditions import CONDITIONS, Condition
from experiments.intervals import mean_interval, proportion
from experiments.study.facts import thruster_power
from laisn.arrays import Floats
from sim.closed_loop import simulate_closed_loop
from sim.contact import contacts
from sim.station_keeping import (
    LOST_M,
    closest_approaches,
    closest_in_a_layer,
    off_station,
    station_keeping,
    true_stations,
)

COMMAND = "laisn formation"
MODULES = ("experiments.formation.study",)
RUNS = 60
DURATION_S = 1000.0
TURNING = 1e-3
"""A formation whose frame turns faster is in a turn [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """What one run came to, for each of f followers where an array, shape (f,)."""

    rms: Floats
    """Distance from the station, RMS [m]."""
    p95: Floats
    largest: Floats
    turn: Floats
    """Largest distance in turns [m]."""
    leg: Floats
    """RMS distance on legs [m]."""
    lost: Floats
    """1 where the follower was ever more than 10 m off, else 0."""
    away: Floats
    """1 where the follower was more than 10 m off when the run ended, else 0."""
    error: Floats
    """Mean E_P [m]."""
    closest: float
    """Least horizontal distance of two vehicles, whatever their layers [m]."""
    within: float
    """Least horizontal distance of two vehicles of one layer [m]; NaN: no layer has two."""
    touching: float
    """1 where any hulls touched, else 0."""
    power: float
    """Mean of the followers' thrusters [W]."""


def measure(condition: Condition, run: int, duration_s: float = DURATION_S) -> Run:
    """Fly one run of a condition."""
    scenario = condition.scenario(run, duration_s)
    trajectory, loop = simulate_closed_loop(scenario)
    stations = true_stations(scenario, trajectory)
    off = off_station(scenario, trajectory, stations)
    kept = [station_keeping(column, trajectory.time) for column in off.T]
    turning = np.abs(stations[..., 3]) > TURNING
    hydrophones = np.stack([trajectory.site_path(f"{f.name}/hydrophone")[:, :2] for f in scenario.followers], axis=1)
    error = np.hypot(*np.moveaxis(loop.state.history.position[1:] - hydrophones[1:], -1, 0))
    density = scenario.ocean.density_kg_m3
    power = [float(thruster_power(trajectory, v + 1, density).mean()) for v in range(len(kept))]
    layer = closest_in_a_layer(scenario, trajectory)
    legs = np.where(turning, np.nan, off)
    return Run(
        rms=np.array([k.station_rms_m for k in kept]),
        p95=np.array([k.station_p95_m for k in kept]),
        largest=np.array([k.station_max_m for k in kept]),
        turn=np.max(np.where(turning, off, 0.0), axis=0),
        leg=np.sqrt(np.nanmean(legs**2, axis=0)),
        lost=np.array([float(k.lost) for k in kept]),
        away=(off[-1] > LOST_M).astype(np.float64),
        error=error.mean(axis=0),
        closest=closest_approaches(trajectory)[1].distance_m,
        within=float("nan") if layer is None else layer.distance_m,
        touching=float(bool(contacts(trajectory))),
        power=float(np.mean(power)),
    )


def _of_layers(within: Sequence[float]) -> Finding:
    """The least distance in a layer, which is None where all have layers of their own."""
    least = min(within)
    what = "least horizontal distance of two vehicles of one layer"
    return Finding(value=None, what=what, unit="m") if np.isnan(least) else plain(least, what, "m")


def _of_condition(name: str, runs: Sequence[Run]) -> dict[str, Finding]:
    """Findings of one condition; intervals are over runs."""
    rms = np.array([run.rms for run in runs])
    lost, away = int(sum(run.lost.sum() for run in runs)), int(sum(run.away.sum() for run in runs))
    followers = rms.size

    def over_runs(values: Sequence[float], what: str, unit: str) -> Finding:
        return of(mean_interval(np.array(values)), what, unit)

    medians = [float(np.median(run.rms)) for run in runs]
    return {
        f"median {name}": plain(float(np.median(rms)), "RMS distance from the station, median of followers", "m"),
        f"run-median {name}": over_runs(medians, "median of a run's followers, mean of runs, 95 %", "m"),
        f"worst {name}": plain(float(rms.max()), "RMS distance from the station, worst follower", "m"),
        f"p95 {name}": plain(float(np.median([r.p95 for r in runs])), "95 % of the time within, median follower", "m"),
        f"max {name}": plain(float(max(r.largest.max() for r in runs)), "largest distance from a station", "m"),
        f"turn {name}": plain(float(max(r.turn.max() for r in runs)), "largest distance in the turn", "m"),
        f"leg {name}": plain(float(np.median([r.leg for r in runs])), "RMS on legs, median of followers", "m"),
        f"error {name}": over_runs([float(r.error.mean()) for r in runs], "mean E_P, mean of runs, 95 %", "m"),
        f"lost-runs {name}": plain(lost, f"followers lost, of {followers}"),
        f"lost {name}": of(proportion(lost, followers), "share of followers lost, 95 %"),
        f"away {name}": of(proportion(away, followers), "share of followers more than 10 m off at the end, 95 %"),
        f"closest {name}": plain(min(r.closest for r in runs), "least horizontal distance of two vehicles", "m"),
        f"within {name}": _of_layers([r.within for r in runs]),
        f"contact {name}": of(proportion(int(sum(r.touching for r in runs)), len(runs)), "share of runs with contact"),
        f"power {name}": over_runs([r.power for r in runs], "mean power of a follower's thrusters, 95 %", "W"),
    }


def findings_of(found: Mapping[str, Sequence[Run]]) -> Findings:
    """The record of all conditions, and of what a leader's weave could tell."""
    named: dict[str, Finding] = {"runs": plain(max(len(runs) for runs in found.values()), "runs of most conditions")}
    for name, runs in found.items():
        named |= _of_condition(name, runs)
    named |= weave.findings()
    return record("formation", COMMAND, MODULES, named)


def run(folder: Path, runs: int = RUNS, duration_s: float = DURATION_S, **options: Unpack[ExecutionOptions]) -> None:
    """Fly all conditions, or what is missing, and write the record into a folder; `options` as of `campaign.fly`."""
    tasks = {
        (c.name, number): partial(measure, c, number, duration_s)
        for number in range(runs)
        for c in CONDITIONS
        if number % c.share == 0
    }
    design = Design(tasks=tasks, what="formations", ahead=partial(measure, CONDITIONS[0], 0, 3.0))
    flown = campaign.fly(design, folder, **options).tasks
    found: dict[str, list[Run]] = {condition.name: [] for condition in CONDITIONS}
    for (name, _), (row,) in flown.items():
        found[name].append(Run(**with_arrays(row)))
    findings_of(found).write(folder / FILE)
