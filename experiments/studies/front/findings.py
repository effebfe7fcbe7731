"""What the study found: how far followers are off their stations, for each estimate that they
steer by, and each current.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from experiments.study.run import Cells, StudyResults
from reports.findings import Finding, interval_finding, plain_finding
from reports.intervals import mean_interval

ARMS = {
    "tight": "tightly coupled, estimates a current",
    "tight-still": "tightly coupled, knows of no current",
    "laisn-2": "LAISN-2",
    "laisn-3-2": "LAISN-3(2)",
    "truth": "the truth",
}
CASES = {"still": "still water", "uniform": "0.4 m/s everywhere", "front": "front"}


def _findings_of_case(name: str, cells: Cells) -> Iterator[tuple[str, Finding]]:
    """Findings of an arm in a case, of six followers in each run."""
    station_errors = np.median(cells.values_by_run("station_rms_m"), axis=1)
    error = cells.values_by_run("e_p_mean_m").mean(axis=1)
    largest = float(cells.values_by_run("station_max_m").max())
    lost = int(cells.values_by_run("lost").sum())
    closest = float(cells.values_by_run("closest_horizontal_m").min())
    station = interval_finding(
        mean_interval(station_errors), "RMS off the station, median of followers, 95 %", "m"
    )
    yield f"station {name}", station
    yield (
        f"error {name}",
        interval_finding(mean_interval(error), "mean E_P, mean of followers, 95 %", "m"),
    )
    yield f"largest {name}", plain_finding(largest, "largest distance from a station", "m")
    yield f"lost {name}", plain_finding(lost, "followers lost in all runs")
    yield (
        f"closest {name}",
        plain_finding(closest, "least horizontal distance of two vehicles", "m"),
    )


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Findings of all arms and cases."""
    cells = outcomes["study"].cells
    findings = {
        "runs": plain_finding(max(len(lists["run"]) for lists in cells.lists), "runs of each case")
    }
    for name, cells_of_case in cells.by("arm", "case").items():
        findings |= dict(_findings_of_case(name, cells_of_case))
    for arm in ARMS:
        in_front, in_still_water = (cells.where(arm=arm, case=case) for case in ("front", "still"))
        if in_front.rows and in_still_water.rows:
            added = np.median(in_front.values_by_run("station_rms_m"), axis=1)
            added = added - np.median(in_still_water.values_by_run("station_rms_m"), axis=1)
            meaning = "what the front adds to the distance from the station, paired by run, 95 %"
            findings[f"added {arm}"] = interval_finding(mean_interval(added), meaning, "m")
    return findings
