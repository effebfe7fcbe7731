"""The pitch study on missions: arithmetic of its tables against closed forms, its design, and a
smoke run.
"""

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_allclose

from experiments.campaign import campaign
from experiments.studies.asymmetry import figures
from experiments.studies.asymmetry.findings import (
    AHRS,
    ARMS,
    EXACT,
    LEVEL,
    LEVEL_BROADCAST,
    LOOKS,
    READINGS,
    Curve,
    curves_of,
    judged_rows,
    mean_added,
    paired,
)
from experiments.studies.asymmetry.fix_map import deepest_offset, worst_error
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import StudyPlan, plan_of
from experiments.study.run import fly_studies
from experiments.study.study import run
from laisn.errors import LaisnError

FILES = built_in_files("asymmetry")
TRIM = {"name": "trim-12N", "leader.excess_buoyancy_n": 12.0}
SHORT = {
    "scenario": ["T3", "T6"],
    "runs": 24,
    "case": [TRIM],
    "vary": {"offset_m": [0.0, 10.0]},
    "set": {"duration_s": 40.0},
}


def plan(study_part: str = "missions", keys: dict[str, Any] | None = None) -> StudyPlan:
    return plan_of(study_of(str(FILES[study_part]), keys or {}))


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Rows of LAISN-2 of a short study: two routes, each with two depth offsets."""
    actual = fly_studies([plan(keys=SHORT)], tmp_path_factory.mktemp("rows"), workers=1, quiet=True)
    return [row for row in judged_rows({"missions": actual[0]}) if row["variant"] == "laisn-2"]


@pytest.mark.system
def test_every_mission_is_flown_in_every_arm(rows):
    assert len(rows) == 4 * len(ARMS)
    assert {(row["route"], row["depth_offset_m"]) for row in rows} == set(
        itertools.product(("T3", "T6"), (0.0, 10.0))
    )
    for row in rows:
        assert row["leader_pitch_rms_deg"] > 1.0
        assert row["runs"] == len(row["e_p_run_mean_m"]) == len(row["mirror_locked_run"]) == 24
        assert row["e_p_mean_m"] == pytest.approx(np.mean(row["e_p_run_mean_m"]), rel=1e-9)
        assert row["mirror_locked_runs"] == sum(row["mirror_locked_run"])
        if row["arm"] == "expected":
            assert row["navigation.expected_pitch_deg"] == row["leader_pitch_rms_deg"]


@pytest.mark.system
def test_no_two_missions_share_noise():
    # with the usual physics step, with which no hull has to be checked
    one_arm = {"arm": [{"name": "1 1"}], "set": {"timing": {"physics_step_s": 0.02}}}
    plans = [plan(part, one_arm) for part in ("pitch", "missions")]
    first_runs = sorted(
        {entry.scenario.run for study_plan in plans for entry in study_plan.entries}
    )
    assert len(first_runs) == (1 + 23) * 8 * 4
    assert all(next_run - run >= max(LOOKS) for run, next_run in itertools.pairwise(first_runs))
    # τ and pitch are compared on the same noise
    runs_of_pitch = {
        (plans[0].points[entry.point]["scenario"], entry.scenario.run)
        for entry in plans[0].entries
        if plans[0].points[entry.point]["offset_m"] == 2.0
    }
    tau_plan = plan("tau", one_arm)
    assert {
        (tau_plan.points[entry.point]["scenario"], entry.scenario.run) for entry in tau_plan.entries
    } == runs_of_pitch


def share_removed(mission, arm):
    """Share that a remedy removes of what pitch adds to runs without mirror lock."""
    added_by_pitch, left_by_remedy, unlocked = mission.compared("error", arm)
    return 1 - left_by_remedy[unlocked].mean() / added_by_pitch[unlocked].mean()


def test_exact_attitude_gives_the_level_leaders_error(rows):
    for excess in paired(rows):
        exact, level = (excess.arms[arm]["e_p_mean_m"] for arm in (EXACT, LEVEL))
        assert_allclose(exact, level, rtol=0.02)
        if excess.real["depth_offset_m"] == 10.0:
            assert excess.added > 0.1
            assert share_removed(excess, EXACT) > 0.95


def test_attitude_of_an_ahrs_removes_what_pitch_does(rows):
    for excess in paired(rows):
        if excess.real["depth_offset_m"] == 10.0:
            assert share_removed(excess, AHRS) > 0.9
            # beside a level leader with the same sensor, pitch adds hardly anything
            assert abs(mean_added([excess], READINGS, LEVEL_BROADCAST).value) < 0.02 * excess.added


def test_arms_differ_in_the_leaders_sensor_and_in_what_followers_make_of_it():
    arms = {
        entry.arm.removesuffix(" laisn-2"): entry
        for entry in plan(keys=SHORT).entries
        if entry.arm.endswith(" laisn-2")
    }
    study = plan(keys=SHORT).study
    assert {*arms} == {*ARMS}
    assert {arm for arm in arms if study.arm(f"{arm} laisn-2").leader_pitch_deg == 0.0} == {
        "level",
        "level-0.5",
    }
    using_attitude = {arm for arm, entry in arms.items() if entry.scenario.navigation.use_attitude}
    assert using_attitude == {
        "level-0.5",
        "attitude-0",
        "ahrs-0.5",
        "attitude-0.5",
        "attitude-2",
        "offset-0.5",
    }
    attitude_sigma = {
        arm: entry.scenario.sensors.leader_attitude_sigma_deg for arm, entry in arms.items()
    }
    expected = {"level-0.5": 0.5, "ahrs-0.5": 0.5, "attitude-0.5": 0.5, "attitude-2": 2.0}
    assert attitude_sigma == dict.fromkeys(arms, 0.0) | expected
    with_offset = {
        arm
        for arm, entry in arms.items()
        if entry.scenario.sensors.leader_attitude_offset_sigma_deg == 0.5
    }
    assert with_offset == {"offset-0.5"}
    with_gyros = {
        arm
        for arm, entry in arms.items()
        if entry.scenario.sensors.leader_attitude_senses_acceleration
    }
    assert with_gyros == {"ahrs-0.5"}
    assert {arm: dict(entry.measured) for arm, entry in arms.items() if entry.measured} == {
        "expected": {"navigation.expected_pitch_deg": "leader_pitch_rms_deg"}
    }


def test_curves_vary_the_range_error_of_the_rear_transmitter_and_the_leader_s_pitch():
    tau, pitch = (plan(part, {"scenario": ["T5"]}) for part in ("tau", "pitch"))
    assert [entry.scenario.acoustics.range_tau_m for entry in tau.entries[:8]] == [
        (float(entry.arm.split()[0]), 0.01, 0.01) for entry in tau.entries[:8]
    ]
    assert {entry.scenario.timing.message_interval_s for entry in tau.entries[:8]} == {1.0}
    assert {
        entry.scenario.timing.message_interval_s for entry in (*tau.entries[8:16], *pitch.entries)
    } == {5.0}
    for name, arm in pitch.study.arms.items():
        assert arm.leader_pitch_deg == float(name.split()[0]) <= 0.0
    assert {arm.leader_pitch_deg for arm in tau.study.arms.values()} == {0.0}


def test_the_excess_of_a_curve_is_paired_run_by_run():
    """Runs scatter by 1 m alike at all values, and by 0.1 m about what the second value adds,
    0.4 m.
    """
    rng = np.random.default_rng(2)
    common_noise, scatter_of_excess = rng.normal(size=400), 0.1 * rng.normal(size=400)
    errors = {"0 5": 2.0 + common_noise, "-2 5": 2.4 + common_noise + scatter_of_excess}
    rows = [
        {"point": 0, "arm": arm, "scenario": "T3", "offset_m": 2.0, "e_p_mean_m": error.mean()}
        for arm, error in errors.items()
    ]
    outcomes: Any = SimpleNamespace(
        rows=rows, runs=[({}, {"e_p_mean_m": error}) for error in errors.values()]
    )
    (curve,) = curves_of(outcomes)
    assert (curve.route, curve.interval_s, curve.depth_offset_m, curve.value) == (
        "T3",
        5.0,
        2.0,
        (0.0, -2.0),
    )
    excess = curve.excess_at(-2.0)
    assert excess.value == pytest.approx(0.4 + scatter_of_excess.mean())
    half_interval = 1.959964 * scatter_of_excess.std(ddof=1) / 20.0
    assert (excess.low, excess.high) == pytest.approx(
        (excess.value - half_interval, excess.value + half_interval)
    )
    assert curve.excess_half_m[0] == 0.0


def test_a_curve_that_dips_counts_as_flat_there() -> None:
    curve = Curve(
        route="T3",
        interval_s=1.0,
        depth_offset_m=5.0,
        value=(0.0, -1.0, -2.0, -4.0),
        e_p_mean_m=(0.3, 0.6, 0.5, 1.0),
        excess_half_m=(0.0, 0.1, 0.1, 0.1),
    )
    assert curve.equivalent(0.35) == pytest.approx(2.25)


def test_equivalent_value_inverts_a_curve():
    curve = Curve(
        route="T3",
        interval_s=1.0,
        depth_offset_m=5.0,
        value=(0.0, -1.0, -2.0, -4.0),
        e_p_mean_m=(0.3, 0.4, 0.6, 1.0),
        excess_half_m=(0.0, 0.1, 0.1, 0.1),
    )
    assert curve.equivalent(0.0) == 0.0
    assert curve.equivalent(0.2) == pytest.approx(1.5)
    assert curve.equivalent(0.7) == pytest.approx(4.0)
    assert np.isnan(curve.equivalent(0.71))
    assert np.isnan(curve.equivalent(-0.01))


@pytest.mark.parametrize("pitch_deg", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("bound", [0.25, 1.0])
def test_planner_abeam_is_the_bound_over_sin_pitch(pitch_deg, bound):
    pitch = np.deg2rad(pitch_deg)
    depth_offset = deepest_offset(pitch, np.pi / 2, 40.0, bound)
    assert depth_offset == pytest.approx(bound / np.sin(pitch), rel=0.02)
    assert worst_error(pitch, depth_offset, np.pi / 2, 40.0) == pytest.approx(bound, rel=1e-6)


@pytest.mark.parametrize("longest_range", [40.0, 100.0])
@pytest.mark.parametrize("off_axis_deg", [30.0, 60.0])
def test_the_worst_error_is_over_nose_up_and_down_ahead_and_astern_and_all_ranges(
    longest_range, off_axis_deg
):
    """By the closed form cos B̂ = cos B cos φ − (Δz / D) sin φ, error = 2 D sin(|B̂ − B| / 2), on
    a fine grid of ranges.
    """
    pitch, depth_offset = np.deg2rad(4.0), 3.0
    ranges, worst = np.linspace(5.0, longest_range, 4001), 0.0
    for sign in (1.0, -1.0):
        for bearing in np.deg2rad([off_axis_deg, 180.0 - off_axis_deg]):
            fix_bearing = np.arccos(
                np.cos(bearing) * np.cos(pitch) - sign * depth_offset / ranges * np.sin(pitch)
            )
            worst = max(
                worst, float((2.0 * ranges * np.sin(np.abs(fix_bearing - bearing) / 2.0)).max())
            )
    assert worst_error(
        pitch, depth_offset, np.deg2rad(off_axis_deg), longest_range
    ) == pytest.approx(worst, rel=1e-3)


def test_planner_finds_offsets_of_decimetres():
    assert deepest_offset(np.deg2rad(30.0), np.pi / 2, 40.0, 0.05) == pytest.approx(0.1, rel=0.02)


def test_the_planner_looks_no_deeper_than_50_m():
    assert (
        deepest_offset(np.deg2rad(1.0), np.pi / 2, 40.0, 1.0)
        == 50.0
        < 1.0 / np.sin(np.deg2rad(1.0))
    )


def test_planner_reports_where_no_offset_suffices():
    # foreshortening alone, D cos B (1 − cos φ) / sin B to first order, is more than the bound
    assert np.isnan(deepest_offset(np.deg2rad(10.0), np.deg2rad(30.0), 100.0, 0.5))
    assert 100.0 * (1 - np.cos(np.deg2rad(10.0))) / np.tan(np.deg2rad(30.0)) > 0.5


@pytest.mark.system
def test_quick_study_is_resumable_and_repeatable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = {"set": {"duration_s": 40.0}, "scenario": ["T3"]}
    report = run("asymmetry", keys, tmp_path, quick=True, workers=1, quiet=True).report()
    first = report.read_bytes()
    assert b"How much does the leader" in first
    missions = pq.read_table(tmp_path / "missions.parquet")
    assert set(missions["condition"].to_pylist()) == {
        "trim-12N",
        "dive-4m",
        "waves-1m-following-2m",
    }
    for name in ("map", "equivalents"):
        assert pq.read_table(tmp_path / f"{name}.parquet").num_rows > 0

    def refuse_to_compute(*_: object) -> None:
        raise AssertionError("a stored cell was computed again")

    def fail_to_render(*_: object) -> None:
        raise RuntimeError("a process that renders frames ended with code 1")

    monkeypatch.setattr(campaign, "compute", refuse_to_compute)
    monkeypatch.setattr(figures, "film", fail_to_render)
    report.unlink()
    with pytest.raises(RuntimeError, match="renders frames"):
        run("asymmetry", keys, tmp_path, quick=True, film="example", workers=1, quiet=True)
    assert report.read_bytes() == first
    with pytest.raises(LaisnError, match="without films"):
        run("formation", {}, tmp_path, film="worst")
