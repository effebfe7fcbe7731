"""The table of LAISN-Bench: `python -m tools.documents.studies benchmark`.

Every navigator of the project that needs no other sensor and no further package is scored on all
missions and seeds.
"""

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from experiments.benchmark.catalogue import SEEDS, missions
from experiments.benchmark.data import generate
from experiments.benchmark.score import (
    SEGMENTS_M,
    MissionScore,
    by_mission,
    navigate,
    overall_score,
    runs_of,
    score_all,
)
from reports.findings import RESULTS_FILE, Finding, interval_finding, plain_finding, record

COMMAND = "python -m tools.documents.studies benchmark"
MODULES = ("tools.documents.benchmark_navigators",)
NAVIGATORS = (
    *("dead-reckoning", "laisn-2", "laisn-3-1", "laisn-3-2", "laisn-best"),
    *("geodetic", "owtt", "particle", "ekf", "imm", "tight"),
)


def findings_of(navigator: str, scores: Sequence[MissionScore]) -> dict[str, Finding]:
    """What a navigator reached, mission by mission and in all."""
    findings = dict[str, Finding]()
    for score in scores:
        key = f"{navigator} {score.mission}"
        findings |= {
            f"mean {key}": interval_finding(score.mean_m, "mean position error over seeds", "m"),
            f"ratio {key}": plain_finding(score.times_bound, "RMS error over the bound"),
            f"nees {key}": plain_finding(score.nees, "mean NEES"),
            f"relative {key}": plain_finding(
                score.relative_m[1], f"RMS error over segments of {SEGMENTS_M[1]:g} m", "m"
            ),
        }
    worst = max(scores, key=lambda score: score.times_bound)
    runs = sum(score.runs for score in scores)
    return findings | {
        f"score {navigator}": plain_finding(
            overall_score(scores), "geometric mean of RMS error over the bound"
        ),
        f"worst {navigator}": plain_finding(worst.times_bound, "largest of these ratios"),
        f"worst-mission {navigator}": plain_finding(worst.mission, "where that is"),
        f"far {navigator}": plain_finding(
            sum(score.lost for score in scores) / runs, "share of runs with an error above 10 m"
        ),
        f"step {navigator}": plain_finding(
            max(score.step_us for score in scores), "processor time a filter step", "µs"
        ),
    }


def scores_of(folder: Path, navigator: str) -> list[MissionScore]:
    """Scores of a navigator on the data in a folder."""
    runs = runs_of(folder)
    return by_mission(score_all(folder, navigate(folder, runs, navigator), runs))


def all_scores(folder: Path, navigators: Sequence[str]) -> Mapping[str, list[MissionScore]]:
    """Scores of navigators on the data in a folder, each in a process."""
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        scores = pool.map(partial(scores_of, folder), navigators)
        return dict(zip(navigators, scores, strict=True))


def run(folder: Path) -> None:
    """Write the data of the benchmark, score the navigators, and write the record into a folder."""
    data = folder / "data"
    scored = [mission for mission in missions().values() if mission.scored]
    generate(data, scored, range(1, SEEDS + 1), workers=os.cpu_count() or 1)
    findings = dict[str, Finding]()
    for name, scores in all_scores(data, NAVIGATORS).items():
        findings |= findings_of(name, scores)
    record("benchmark", COMMAND, MODULES, findings).write(folder / RESULTS_FILE)
