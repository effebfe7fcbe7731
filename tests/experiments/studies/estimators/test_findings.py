"""The study of the estimators: its figures, its parts, its record and its page."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from experiments.studies.estimators import figures, findings
from experiments.studies.estimators.findings import MESSAGE_INTERVAL
from experiments.study import study as studies
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import StudyPlan, plan_of
from experiments.study.run import Cells, StudyResults
from experiments.study.study import run
from laisn.bound import TrueNoise
from laisn.settings import TightSettings
from laisn_sim.cli.main import app
from reports.bound import noise_of
from reports.findings import Findings, read_findings
from reports.page import page_of
from sim.scenario.parts import SensingSettings
from sim.scenario.routes import library_route
from tests.golden import numbered_record, require_golden

PARTS = {
    part: plan_of(study_of(str(file), {}, quick=True))
    for part, file in built_in_files("estimators").items()
}
# when the leader's route L turns
TURN_TIME_S = float(library_route("L").time[1])


def mission_by_hand(
    route: str,
    error: float,
    laisn: float,
    lost: int = 0,
    laisn_lost: int = 0,
    runs: int = 20,
    **point: Any,
) -> Cells:
    """A mission with the arms tight, laisn-2 and ekf, whose runs have these mean errors [m] of the
    first two; the first `lost` and `laisn_lost` runs are mirror-locked.
    """
    ones = np.ones(runs)
    tight_arrays = {
        "run": np.arange(runs),
        "e_p_mean_m": error * ones,
        "e_p_rms_m": 2.0 * error * ones,
        "e_p_max_m": np.linspace(0.0, 7.0 * error, runs),
        "nees": 10.0 * error * ones,
        "nis": 6.0 * error * ones,
        "mirror_locked": np.arange(runs) < lost,
    }
    laisn_arrays = {
        "e_p_mean_m": laisn * ones,
        "e_p_rms_m": 1.25 * laisn * ones,
        "mirror_locked": np.arange(runs) < laisn_lost,
    }
    ekf_arrays = {
        "e_p_mean_m": 2.0 * ones,
        "nees": 6.0 * ones,
        "mirror_locked": np.arange(runs) < 0.4 * runs,
    }
    row = {
        "scenario": route,
        MESSAGE_INTERVAL: 5.0,
        "bound": 0.5,
        "nees_inside": error,
        "bound_rms_m": 0.5,
        "bound_smoothed_rms_m": 0.5 * (error + 0.1),
    } | point
    return Cells(
        [row | {"arm": arm} for arm in ("tight", "laisn-2", "ekf")],
        [tight_arrays, laisn_arrays, ekf_arrays],
    )


def joined(*missions: Cells) -> Cells:
    """The cells of several missions."""
    return Cells(*([item for mission in missions for item in mission[field]] for field in range(3)))


def test_findings_of_several_missions_are_means_medians_and_extremes_over_them() -> None:
    first_two = mission_by_hand("T2", 0.2, 1.0, 0, 5), mission_by_hand("T3", 0.4, 1.0, 3, 6)
    missions = joined(*first_two, mission_by_hand("T4", 0.9, 1.5, 0, 1))
    actual = findings.mission_findings("G", missions)
    values = {key.removesuffix(" G"): finding.value for key, finding in actual.items()}
    assert values == pytest.approx(
        {
            "ratio": 0.4,
            "worst": 0.6,
            "error": 0.5,
            "laisn-2": 3.5 / 3,
            "largest": 6.3,
            "nees": 5.0,
            "nees-least": 2.0,
            "nees-most": 9.0,
            "inside": 0.5,
            "nis": 1.5,
            "mirror-locked": 3 / 60,
            "mirror-locked-runs": 3,
            "mirror-locked-laisn-2": 12 / 60,
            "bound": 1.6,
            "bound-worst": 3.6,
            # 0.5 m over 1.25, 1.25 and 1.875 m
            "least": 0.4,
            "smoothing": 0.5,
        },
        rel=1e-5,
    )
    exact = stats.binomtest(12, 60).proportion_ci(0.95, "exact")
    limits = actual["mirror-locked-laisn-2 G"]
    assert (limits.low, limits.high) == pytest.approx((exact.low, exact.high), rel=1e-5)
    assert actual["mirror-locked-runs G"].what == "runs locked on the mirror image of 60"
    assert findings.median_ratio(joined(*first_two)).value == pytest.approx(0.3)
    without_bound = findings.mission_findings(
        "G", missions._replace(rows=[row | {"bound": None} for row in missions.rows])
    )
    assert {"bound G", "bound-worst G", "least G"} == actual.keys() - without_bound.keys()


def test_a_plain_filter_is_held_against_the_tightly_coupled_navigator_route_by_route() -> None:
    missions = joined(
        mission_by_hand("T2", 0.5, 1.0, runs=25), mission_by_hand("T5", 1.5, 1.0, runs=25)
    )
    values = {
        key: finding.value for key, finding in findings.plain_filter_findings("G", missions).items()
    }
    assert values == pytest.approx(
        {
            "ekf G": 2.0,
            "over-ekf G": 0.5,
            "over-ekf G T2": 0.25,
            "over-ekf G T5": 0.75,
            "ekf G T2": 2.0,
            "ekf G T5": 2.0,
            "ekf-nees G": 6.0,
            "ekf-mirror-locked G": 0.4,
        }
    )


def test_what_a_clock_costs_is_the_ratio_of_the_same_runs_in_each_part_of_the_mission() -> None:
    """An unknown clock gives twice the error before the turn, and 1.2 or 1.6 times from a minute
    after it on; the bound grows by the square of that. The minute between does not count.
    """
    time = np.arange(1.0, 1001.0)
    missions = []
    for route, ratio_after in (("T2", 1.2), ("T5", 1.6)):
        for case, cost in (("exact", (1.0, 9.0, 1.0)), ("unknown", (2.0, 9.0, ratio_after))):
            ratio = np.select([time <= TURN_TIME_S, time <= TURN_TIME_S + 60.0], cost[:2], cost[2])
            steps = {"time_s": time, "e_p_mean_m": 0.3 * ratio, "bound_m": 0.1 * ratio**2}
            mission = mission_by_hand(route, 1.0, 1.0, case=case).where(arm="tight")
            missions.append(mission._replace(steps=[steps]))
    actual = findings.clock_findings(joined(*missions))
    for name, value in (
        ("clock before", 2.0),
        ("clock after", 1.4),
        ("clock-worst after", 1.6),
        ("clock-bound before", 4.0),
        ("clock-bound-worst after", 2.56),
    ):
        assert actual[name].value == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(
    ("assume", "expected"),
    [
        ({}, {}),
        (
            {"exact_leader": False},
            {"leader_heading_bias": np.deg2rad(6.0), "leader_way_sigma": 0.05},
        ),
        ({"current": True}, {"current": 0.4, "current_walk": 1e-3, "leader_way_sigma": 0.05}),
        ({"offsets": True}, {"range_offset": 0.015}),
        ({"clock": True}, {"clock_offset": 1.5, "clock_drift": 1.5e-3, "clock_walk": 3e-6}),
        # a quarter of 2.5 mm/s and 1.7 mrad in a second: the slower of its two modes
        ({"drift": True}, {"speed_walk": 6.25e-4, "heading_walk": 4.25e-4}),
    ],
)
def test_a_bound_leaves_open_what_is_estimated_and_lets_it_walk(
    assume: dict[str, bool], expected: Any
) -> None:
    keys = {f"navigation.assume.{key}": value for key, value in assume.items()}
    study = study_of(
        str(built_in_files("estimators")["clock"]), {"scenario": "T5", "set": keys, "case": []}
    )
    (entry,) = plan_of(study).entries
    noise = noise_of(SensingSettings.of(entry.scenario), entry.scenario.navigation)
    assert asdict(noise) == pytest.approx(asdict(TrueNoise()) | expected, rel=1e-12)


@pytest.mark.system
def test_the_parts_fly_the_settings_of_the_study() -> None:
    plans = {
        part: plan_of(study_of(str(file), {}))
        for part, file in built_in_files("estimators").items()
    }
    assert {part: (len(plan.points), plan.study.runs) for part, plan in plans.items()} == {
        "cases": (7 * 2 * 8, 60),
        "clock": (2 * 8, 30),
        "locks": (4, 10_000),
        "offset": (6 * 4, 30),
        "sea": (4 * 4, 30),
        "sigma": (14 * 4, 30),
        "weave": (4, 60),
        "wrong": (14 * 4, 30),
    }
    default = TightSettings()
    for entry in plans["sigma"].entries:
        sigma, factor = plans["sigma"].points[entry.point]["case"].split()
        if entry.arm == "tight":
            settings = entry.scenario.navigation.settings()
            assert getattr(settings, sigma) == pytest.approx(
                float(factor) * getattr(default, sigma)
            )
    assert {entry.scenario.seed for plan in plans.values() for entry in plan.entries} == {12}
    for part, plan in PARTS.items():
        assert 1 < plan.study.runs < plans[part].study.runs, "of one run there is no scatter"


def test_a_weaving_leader_heads_5_degrees_off_its_legs_in_turn_and_passes_their_corners() -> None:
    route = library_route("L")
    points = np.array(PARTS["weave"].study.cases["weaving"].settings["leader.waypoints"])
    corners = points[np.isin(points[:, 0], route.time)]
    np.testing.assert_allclose(corners[:, 1:], route.waypoint, atol=1e-9)
    heading = np.arctan2(*np.diff(points[:, 1:], axis=0).T)
    for k in range(len(route.time) - 1):
        leg = np.arctan2(*(route.waypoint[k + 1] - route.waypoint[k]))
        # but for the legs to and from a corner
        inner = (points[:-1, 0] > route.time[k] + 1) & (points[1:, 0] < route.time[k + 1] - 1)
        heading_off_leg = np.angle(np.exp(1j * (heading[inner] - leg)))
        np.testing.assert_allclose(np.abs(heading_off_leg), np.deg2rad(5.0), rtol=1e-9)
        assert np.all(heading_off_leg[1:] * heading_off_leg[:-1] < 0.0)


def random_results(plan: StudyPlan) -> StudyResults:
    """Results of a part of the study, drawn at random and not flown: 25 runs of each entry, whose
    squared errors are as their covariance predicts.
    """
    rng = np.random.default_rng([7, len(plan.entries)])
    outcomes = StudyResults(plan=plan, rows=[], runs=[], steps=[], store=None)  # type: ignore[arg-type]
    for entry in plan.entries:
        runs, scale = 25, {"tight": 1.0, "all": 1.0, "laisn-2": 4.0, "ekf": 2.0}[entry.arm]
        error = scale * rng.uniform(0.1, 0.3, runs)
        labels = {
            "point": entry.point,
            **plan.points[entry.point],
            "arm": entry.arm,
            "realization": 0,
            "follower": "f",
        }
        bound = (
            {"bound_rms_m": 0.15, "bound_smoothed_rms_m": 0.09}
            if scale == 1.0
            else {"bound_rms_m": None}
        )
        outcomes.rows.append(labels | {"nees_inside": 0.95, "seed": 12, "worst_run": 0} | bound)
        outcomes.runs.append(
            (
                labels,
                {
                    "run": np.arange(runs),
                    "e_p_mean_m": error,
                    "e_p_rms_m": error,
                    "e_p_max_m": 3.0 * error,
                    "nees": rng.chisquare(2, (200, runs)).mean(axis=0),
                    "nis": 2.0 * np.ones(runs),
                    "mirror_locked": np.arange(runs) < (7 if entry.arm == "laisn-2" else 0),
                },
            )
        )
        time = np.arange(1.0, 1001.0)
        outcomes.steps.append(
            {"time_s": time, "e_p_mean_m": 0.2 * np.ones(1000), "bound_m": 0.1 * np.ones(1000)}
        )
    return outcomes


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> tuple[Findings, str]:
    """Record and page of a study with `random_results`."""
    folder = tmp_path_factory.mktemp("estimators")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            studies,
            "fly_until_narrow",
            lambda plans, folder, **_: [random_results(plan) for plan in plans],
        )
        report = run("estimators", {}, folder, quick=True).report()
    return read_findings(folder / "results.json"), report.read_text(encoding="utf-8")


@pytest.mark.system
def test_the_record_has_every_part(page: tuple[Findings, str]) -> None:
    record, _ = page
    tight_locked = record["many 3 T5"]
    assert (tight_locked.value, tight_locked.low) == (0.0, 0.0)
    exact = stats.binomtest(0, 25).proportion_ci(0.95, "exact")
    assert tight_locked.high == pytest.approx(exact.high, rel=1e-4)
    assert record["many-laisn-2 3 T5"].value == pytest.approx(7 / 25, rel=1e-4)
    assert record["seed"].value == 12
    names = [
        "rms straight T2",
        "rms weaving T5",
        "error sea waves-level",
        "error wrong clock unaware",
        "ekf G2 1 T6",
        "nees offset 0.05",
        "bound sigma range_scale_bias_sigma 2",
        "smoothing G5 1",
        "clock before",
    ]
    assert set(names) <= record.findings.keys()
    assert record["rms-bound straight T5"].value == 0.15
    assert "bound G3 5" not in record.findings, "there are errors that the bound does not model"
    assert "bound G7 5" in record.findings


def test_the_page_is_the_golden_one() -> None:
    """Each finding has a number of its own, missions have those of `random_results`."""
    outcomes = {part: random_results(plan) for part, plan in PARTS.items()}
    record = numbered_record("estimators", findings.findings_of(outcomes))
    values = {"quick": True, "found": record} | figures.values(record, outcomes)
    require_golden(page_of("experiments.studies.estimators", [], values, record), "estimators")


def test_the_bound_of_a_mission_is_printed_and_written(tmp_path: Path) -> None:
    short = ["--set", "duration_s=30", "--set", "motion=kinematic"]
    table = tmp_path / "bound.csv"
    result = CliRunner().invoke(
        app, ["bound", "T5", *short, "--runs", "3", "--out", str(table)], env={"COLUMNS": "160"}
    )
    assert result.exit_code == 0, result.output
    assert "laisn-2, 3 runs" in result.output
    lines = table.read_text().splitlines()
    assert lines[0] == "follower,time_s,bound_m"
    assert len(lines) == 301
    refused = CliRunner().invoke(app, ["bound", "T5", *short, "--out", "bound.txt"])
    assert refused.exit_code != 0
