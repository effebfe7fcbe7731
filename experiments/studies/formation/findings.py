"""What the study found, from the rows of its runs (`experiments.study.measure.records_of_run`)."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.campaign.store import Record
from experiments.findings import Finding, of, plain
from experiments.intervals import mean_interval, proportion
from experiments.studies.formation import limits
from experiments.study.run import Outcomes
from laisn.arrays import Floats
from sim.station_keeping import LOST_M


def of_condition(name: str, runs: Sequence[Sequence[Record]]) -> dict[str, Finding]:
    """Findings of one condition; intervals are over runs.

    Args:
        name: of the condition.
        runs: a row for each follower of each run.
    """

    def column(metric: str) -> Floats:
        """A metric of all runs and followers, shape (R, f); NaN where there is none."""
        return np.array([[row[metric] for row in run] for run in runs], dtype=np.float64)

    def over_runs(values: Floats, what: str, unit: str) -> Finding:
        return of(mean_interval(values), what, unit)

    rms, layer = column("station_rms_m"), column("closest_in_layer_m")
    lost, away = int(column("lost").sum()), int(np.count_nonzero(column("track_error_end_m") > LOST_M))
    touched, power = column("touched").max(axis=1), column("power_mean_w")
    found = {
        "median": plain(float(np.median(rms)), "RMS distance from the station, median of followers", "m"),
        "run-median": over_runs(np.median(rms, axis=1), "median of a run's followers, mean of runs, 95 %", "m"),
        "worst": plain(float(rms.max()), "RMS distance from the station, worst follower", "m"),
        "p95": plain(float(np.median(column("station_p95_m"))), "95 % of the time within, median follower", "m"),
        "max": plain(float(column("station_max_m").max()), "largest distance from a station", "m"),
        "turn": plain(float(column("station_turn_max_m").max()), "largest distance in the turn", "m"),
        "leg": plain(float(np.median(column("station_leg_rms_m"))), "RMS on legs, median of followers", "m"),
        "error": over_runs(column("e_p_mean_m").mean(axis=1), "mean E_P, mean of runs, 95 %", "m"),
        "lost-runs": plain(lost, f"followers lost, of {rms.size}"),
        "lost": of(proportion(lost, rms.size), "share of followers lost, 95 %"),
        "away": of(proportion(away, rms.size), "share of followers more than 10 m off at the end, 95 %"),
        "closest": plain(float(column("closest_horizontal_m").min()), "least horizontal distance of two vehicles", "m"),
        # None where every vehicle has a layer of its own
        "within": plain(
            None if np.isnan(layer).all() else float(np.nanmin(layer)),
            "least horizontal distance of two vehicles of one layer", "m",
        ),
        "contact": of(proportion(int(touched.sum()), len(runs)), "share of runs with contact"),
        "power": over_runs(power.mean(axis=1), "mean power of a follower's thrusters, 95 %", "W"),
    }  # fmt: skip
    return {f"{key} {name}": finding for key, finding in found.items()}


def findings_of(outcomes: Mapping[str, Outcomes]) -> dict[str, Finding]:
    """Findings of all conditions, and of the bound behind a weaving leader."""
    found = outcomes["study"].runs_by()
    named = {"runs": plain(max(len(runs) for runs in found.values()), "runs of most conditions")}
    for name, runs in found.items():
        named |= of_condition(name, runs)
    return named | limits.findings()
