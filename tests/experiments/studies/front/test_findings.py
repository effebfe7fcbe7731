"""The study of a formation that crosses a front: findings as functions of rows, and its page."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

import experiments.studies.front
from experiments.studies.front import figures
from experiments.studies.front.findings import ARMS, CASES, findings_of
from experiments.study.file import study_of
from experiments.study.plan import plan_of
from experiments.study.run import Cells
from reports.findings import Finding
from reports.page import page_of
from tests.golden import numbered_record, require_golden
from tools.documents.front_field import LINE_M

RUNS = 25
FOLLOWERS = 6


class StudyPart:
    """A part of a study, of which only the cells are read."""

    def __init__(self, cells: Cells) -> None:
        self.cells = cells


def outcomes() -> dict[str, StudyPart]:
    """Followers 1 to 6 are off their stations by 1 to 6 times the base distance of the case, plus
    noise that all followers of a run share.
    """
    noise = 0.01 * np.random.default_rng(1).normal(size=RUNS)
    base_distance_m = {"still": 0.1, "uniform": 0.2, "front": 0.4}
    rows = []
    run_arrays = []
    for (arm, case), follower in product(product(ARMS, CASES), range(1, FOLLOWERS + 1)):
        is_lost = arm == "laisn-2" and case == "front" and follower == 6
        distance = follower * base_distance_m[case] + noise
        rows.append({"arm": arm, "case": case, "follower": f"f{follower}"})
        run_arrays.append(
            {
                "run": [*range(RUNS)],
                "station_rms_m": distance.tolist(),
                "station_max_m": (3.0 * distance).tolist(),
                "e_p_mean_m": [0.1 * follower] * RUNS,
                "lost": [float(is_lost and run < 3) for run in range(RUNS)],
                "closest_horizontal_m": [10.0 - follower] * RUNS,
            }
        )
    return {"study": StudyPart(Cells(rows, run_arrays))}


@pytest.fixture(scope="module")
def findings() -> dict[str, Finding]:
    return findings_of(outcomes())  # type: ignore[arg-type]


def test_stations_are_those_of_the_median_follower(findings: dict[str, Finding]) -> None:
    # the median of 1 to 6 is 3.5; noise of the run falls out of the difference of two cases
    assert findings["station tight still"].number == pytest.approx(0.35, abs=0.01)
    assert findings["added tight"].number == pytest.approx(3.5 * 0.3, abs=1e-9)
    assert findings["added tight"].high == pytest.approx(3.5 * 0.3, abs=1e-6)
    assert findings["error tight front"].number == pytest.approx(0.35)
    assert findings["lost laisn-2 front"].value == 3
    assert findings["lost tight front"].value == 0
    assert findings["closest tight front"].number == pytest.approx(4.0)
    # three times the largest distance, 6 · 0.4 m, and noise
    assert 7.1 < findings["largest truth front"].number < 7.4


def test_the_page_is_the_golden_one(findings: dict[str, Finding]) -> None:
    """Each finding has a number of its own."""
    record = numbered_record("front", findings)
    values = {"quick": False, "found": record, **figures.values(record, {})}
    require_golden(page_of("experiments.studies.front", [], values, record), "front")


def test_a_trial_run_takes_all_followers_across_the_front() -> None:
    """The leader goes north at 1 m/s from 0; followers come to their distances behind it."""
    file = Path(experiments.studies.front.__file__).with_name("study.toml")
    plan = plan_of(study_of(str(file), {}, quick=True))
    for entry in plan.entries:
        scenario = entry.scenario
        behind = [follower.station.behind_m for follower in scenario.followers if follower.station]
        assert len(behind) == FOLLOWERS
        assert scenario.duration_s - max(behind) > LINE_M
