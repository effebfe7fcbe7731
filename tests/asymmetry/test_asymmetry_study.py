"""The pitch study on missions: arithmetic of its tables against closed forms, and a smoke run."""

import itertools
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from numpy.testing import assert_allclose

from experiments.campaign import campaign
from experiments.campaign.montecarlo import histories
from experiments.flight.library import ROUTES, load
from experiments.studies.asymmetry import study as asymmetry
from experiments.studies.asymmetry.design import (
    AHRS,
    ARMS,
    CALM,
    CONDITIONS,
    EXACT,
    LEVEL,
    LEVEL_BROADCAST,
    OFFSETS_M,
    QUICK_CONDITIONS,
    READINGS,
    REAL,
    Plan,
)
from experiments.studies.asymmetry.findings import Curve, mean_added, paired
from experiments.studies.asymmetry.fix_map import deepest_offset, worst_error
from experiments.studies.asymmetry.missions import fly_condition, pairs
from laisn.compiled import FOLDER
from laisn.navigator import Navigator
from sim.flight import navigate
from sim.simulation import simulate_motion

SHORT = Plan(routes=("T3", "T6"), offsets_m=(0.0, 10.0), variants=("laisn-2",), looks=(24,),
             duration_s=40.0)  # fmt: skip


@pytest.fixture(scope="module")
def rows():
    return [row for offset in SHORT.offsets_m for row in fly_condition(QUICK_CONDITIONS[0], offset, SHORT)]


def test_every_mission_is_flown_in_every_arm(rows):
    assert len(rows) == len(SHORT.routes) * len(SHORT.offsets_m) * len(ARMS)
    places = {(row["route"], row["depth_offset_m"]) for row in rows}
    assert places == {(t, o) for t in SHORT.routes for o in SHORT.offsets_m}
    for row in rows:
        assert row["pitch_rms_deg"] > 1.0
        assert row["runs"] == len(row["e_p_run_mean_m"]) == len(row["mirror_locked_run"]) == 24
        assert row["e_p_mean_m"] == pytest.approx(np.mean(row["e_p_run_mean_m"]), rel=1e-9)
        assert row["mirror_locked_runs"] == sum(row["mirror_locked_run"])


def test_no_two_missions_share_noise(rows):
    numbers = [
        range(c.first_run(route, offset), c.first_run(route, offset) + 10_000)
        for c in (CALM, *CONDITIONS)
        for route in ROUTES
        for offset in OFFSETS_M
    ]
    ordered = sorted(numbers, key=lambda r: r.start)
    assert all(a.stop <= b.start for a, b in itertools.pairwise(ordered))
    assert ordered[-1].stop < 2**31
    assert max(Plan().looks) <= 10_000
    for row in rows:
        assert row["first_run"] == QUICK_CONDITIONS[0].first_run(row["route"], row["depth_offset_m"])


def removed(mission, arm):
    """Share that a remedy removes of what pitch adds to runs without mirror lock."""
    part, left, free = mission.compared("error", arm)
    return 1 - left[free].mean() / part[free].mean()


def test_exact_attitude_gives_the_level_leaders_error(rows):
    for excess in paired(rows):
        exact, level = (excess.arms[arm.key]["e_p_mean_m"] for arm in (EXACT, LEVEL))
        assert_allclose(exact, level, rtol=0.02)
        if excess.real["depth_offset_m"] == 10.0:
            assert excess.added > 0.1
            assert removed(excess, EXACT) > 0.95
            assert excess.arms[EXACT.key]["error_verdict"] in ("met", "no harm shown")


def test_attitude_of_an_ahrs_removes_what_pitch_does(rows):
    for excess in paired(rows):
        if excess.real["depth_offset_m"] == 10.0:
            assert removed(excess, AHRS) > 0.9
            # with the same sensor on a level leader, what pitch still does is less than what the sensor does
            assert abs(mean_added([excess], READINGS, LEVEL_BROADCAST).value) < 0.02 * excess.added
        # gyros and calm water: little is left of half a degree
        assert 0.02 < excess.real["ahrs_rms_deg"] < 0.1
        assert excess.real["inclinometer_rms_deg"] >= 0.5


def test_level_and_real_leader_differ_in_nothing_but_the_ranges():
    condition = QUICK_CONDITIONS[0]
    (mission,) = pairs(condition, 5.0, replace(SHORT, routes=("T6",), duration_s=20.0))
    real, level = (leader.seen(mission.scenario(), 0)[1] for leader in (mission.real, mission.level))
    for name in ("speed", "heading", "depth", "hydrophone", "message_step"):
        assert_allclose(getattr(real, name), getattr(level, name), atol=1e-12, err_msg=name)
    # the leader's log reads along its hull, which pitches
    for name in set(real.sent.dtype.names) - {"speed", "pitch"}:
        assert_allclose(real.sent[name], level.sent[name], atol=1e-12, err_msg=name)
    assert np.abs(real.slant_range - level.slant_range)[:, :2].max() > 1e-3


def test_a_mission_of_a_fleet_is_the_mission_flown_alone():
    condition = QUICK_CONDITIONS[2]
    together = pairs(condition, 10.0, replace(SHORT, duration_s=20.0))[1].motion
    alone = simulate_motion(condition.scenario("T6", 10.0, 20.0))
    assert_allclose(together.position, alone.position, atol=1e-9)
    assert_allclose(together.pitch, alone.pitch, atol=1e-9)


def test_commands_name_the_scenario_that_is_flown():
    for condition in CONDITIONS:
        words = condition.command("T5", 10.0, run=7).split()
        assert words[:5] == ["laisn", "fly", "T5", "--run", str(condition.first_run("T5", 10.0) + 7)]
        sets = [words[i + 1] for i, word in enumerate(words) if word == "--set"]
        assert load("T5", sets) == condition.scenario("T5", 10.0)


def test_equivalent_value_inverts_a_curve():
    curve = Curve(route="T3", interval_s=1.0, depth_offset_m=5.0, value=(0.0, -1.0, -2.0, -4.0),
                  e_p_mean_m=(0.3, 0.4, 0.6, 1.0), excess_half_m=(0.0, 0.1, 0.1, 0.1))  # fmt: skip
    assert curve.equivalent(0.0) == 0.0
    assert curve.equivalent(0.2) == pytest.approx(1.5)
    assert curve.equivalent(0.7) == pytest.approx(4.0)
    assert np.isnan(curve.equivalent(0.71))
    assert np.isnan(curve.equivalent(-0.01))


@pytest.mark.parametrize("pitch_deg", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("bound", [0.25, 1.0])
def test_planner_abeam_is_the_bound_over_sin_pitch(pitch_deg, bound):
    pitch = np.deg2rad(pitch_deg)
    deepest = deepest_offset(pitch, np.pi / 2, 40.0, bound)
    assert deepest == pytest.approx(bound / np.sin(pitch), rel=0.02)
    assert worst_error(pitch, deepest, np.pi / 2, 40.0) == pytest.approx(bound, rel=1e-6)


@pytest.mark.parametrize("reach", [40.0, 100.0])
@pytest.mark.parametrize("off_axis_deg", [30.0, 60.0])
def test_the_planner_reckons_with_nose_up_and_down_ahead_and_astern_and_far_away(reach, off_axis_deg):
    """cos B̂ = cos B cos φ − (Δz / D) sin φ, error = 2 D sin(|B̂ − B| / 2), searched on a fine grid of ranges."""
    pitch, offset = np.deg2rad(4.0), 3.0
    away, worst = np.linspace(5.0, reach, 4001), 0.0
    for sign in (1.0, -1.0):
        for bearing in np.deg2rad([off_axis_deg, 180.0 - off_axis_deg]):
            turned = np.arccos(np.cos(bearing) * np.cos(pitch) - sign * offset / away * np.sin(pitch))
            worst = max(worst, float((2.0 * away * np.sin(np.abs(turned - bearing) / 2.0)).max()))
    assert worst_error(pitch, offset, np.deg2rad(off_axis_deg), reach) == pytest.approx(worst, rel=1e-3)


def test_planner_finds_offsets_of_decimetres():
    assert deepest_offset(np.deg2rad(30.0), np.pi / 2, 40.0, 0.05) == pytest.approx(0.1, rel=0.02)


def test_beyond_fifty_metres_any_offset_will_do():
    assert deepest_offset(np.deg2rad(1.0), np.pi / 2, 40.0, 1.0) == 50.0 < 1.0 / np.sin(np.deg2rad(1.0))


def test_planner_reports_where_no_offset_suffices():
    # foreshortening alone, D cos B (1 − cos φ) / sin B to first order, is more than the bound
    assert np.isnan(deepest_offset(np.deg2rad(10.0), np.deg2rad(30.0), 100.0, 0.5))
    assert 100.0 * (1 - np.cos(np.deg2rad(10.0))) / np.tan(np.deg2rad(30.0)) > 0.5


def test_what_missions_need_is_compiled_ahead():
    fly_condition(QUICK_CONDITIONS[0], 0.0, SHORT.least)
    stored = set(FOLDER.rglob("*.nbc"))
    assert stored
    fly_condition(QUICK_CONDITIONS[0], 10.0, SHORT)
    assert set(FOLDER.rglob("*.nbc")) == stored


def test_quick_study_is_resumable_and_repeatable(tmp_path, monkeypatch):
    report = asymmetry.run(tmp_path, quick=True, workers=1, quiet=True)
    first = report.read_bytes()
    assert b"How much does the leader" in first
    missions = pq.read_table(tmp_path / "missions.parquet")
    assert set(missions["condition"].to_pylist()) == {c.key for c in QUICK_CONDITIONS}
    for name in ("map", "equivalents"):
        assert pq.read_table(tmp_path / f"{name}.parquet").num_rows > 0

    def never(*_: object) -> None:
        raise AssertionError("a stored task was computed again")

    def fail(*_: object) -> None:
        raise RuntimeError("a process that renders frames ended with code 1")

    monkeypatch.setattr(campaign, "_rows", never)
    report.unlink()
    with pytest.raises(RuntimeError, match="renders frames"):
        asymmetry.run(tmp_path, quick=True, workers=1, quiet=True, film=fail)
    assert report.read_bytes() == first


def test_a_run_of_the_study_is_the_flight_of_its_command():
    condition, duration = QUICK_CONDITIONS[2], 30.0
    flown = condition.scenario("T6", 5.0, duration).model_copy(update={"run": 3})
    alone = navigate(flown, simulate_motion(flown), Navigator)
    mission = pairs(condition, 5.0, replace(SHORT, duration_s=duration))[1]
    states = histories(mission.cell(REAL, "laisn-2", range(4)))
    assert_allclose(alone.estimates[0].state, states[..., 3], atol=1e-6)
