"""Missions of the pitch study: settings of arms, and results of their runs."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.campaign.montecarlo import Cell, CellResult
from experiments.studies.asymmetry import missions
from experiments.studies.asymmetry.design import (
    AHRS,
    ARMS,
    CONSTANT,
    EXACT,
    INFLATED,
    LEVEL,
    QUICK_CONDITIONS,
    READINGS,
    REAL,
    ROUGH,
    Plan,
)
from experiments.studies.asymmetry.findings import Curve
from experiments.studies.asymmetry.missions import Pair
from sim.scenario.settings import Sensors
from sim.sensing.errors import random_error
from sim.trajectory import tilted
from tests.synthetic import make_scenario, make_trajectory

RUNS = {
    "run": np.arange(700, 703), "e_p_max_m": np.array([5.0, 6.0, 7.0]), "e_p_mean_m": np.array([0.5, 0.6, 0.7]),
    "e_b_max_deg": np.array([15.0, 16.0, 17.0]), "e_b_mean_deg": np.array([1.5, 1.6, 1.7]),
    "mirror_locked": np.array([True, False, True]), "gated": np.array([1, 2, 3]),
}  # fmt: skip
ROW = {
    "runs": 3, "e_p_max_m": 7.0, "e_p_mean_m": 0.6, "e_p_std_m": 0.25, "e_b_mean_deg": 1.6, "e_p_p95_m": 0.953,
    "mirror_locked_runs": 2, "fixes_gated": 6,
}  # fmt: skip


SENSORS = Sensors(leader_attitude_sigma_deg=0.5, leader_gyro_time_constant_s=30.0)


def test_a_row_has_the_results_of_its_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missions, "simulate", lambda cell: CellResult(ROW, RUNS))
    cell: Any = SimpleNamespace(runs=range(700, 703))
    row = missions._row(cell)
    assert row["first_run"] == 700
    assert {name: row[name] for name in ROW} == ROW
    assert row["e_p_run_mean_m"].tolist() == [0.5, 0.6, 0.7]
    assert row["mirror_locked_run"].tolist() == [True, False, True]


@pytest.fixture(scope="module")
def mission() -> Pair:
    """Behind a leader that pitches by 6° all the time."""
    motion = tilted(make_trajectory(make_scenario(20.0)), np.deg2rad(6.0))
    return Pair(motion=motion, condition=QUICK_CONDITIONS[0], route="T6", offset=5.0)


def test_a_mission_takes_as_long_as_its_motion(mission: Pair) -> None:
    """Times of instants add up with rounding; a scenario takes a whole number of control steps."""
    longer = replace(mission, motion=replace(mission.motion, time=mission.motion.time * (1.0 + 1e-10)))
    assert longer.motion.time[-1] > 20.0
    assert mission.scenario().duration_s == longer.scenario().duration_s == 20.0


def test_arms_differ_in_the_leaders_sensor_and_in_what_followers_make_of_it(mission: Pair) -> None:
    made = {arm: mission.cell(arm, "laisn-2", mission.runs(0, 5)) for arm in ARMS}
    first = mission.condition.first_run(mission.route, mission.offset)
    assert {cell.runs for cell in made.values()} == {range(first, first + 5)}
    level = {arm.key for arm, cell in made.items() if cell.truth is mission.level.seen(mission.scenario(), 0)[1]}
    assert level == {"level", "level-0.5"}
    aware = {arm.key for arm, cell in made.items() if getattr(cell.settings, "use_attitude")}  # noqa: B009
    assert aware == {"level-0.5", "attitude-0", "ahrs-0.5", "attitude-0.5", "attitude-2", "offset-0.5"}
    for arm, degrees in ((REAL, 0.0), (LEVEL, 0.0), (EXACT, 0.0), (READINGS, 0.5), (ROUGH, 2.0), (CONSTANT, 0.0)):
        errors = made[arm].errors
        assert errors.leader_tilt_sigma == pytest.approx(np.deg2rad(degrees))
    steadied = made[AHRS].errors
    assert steadied.leader_tilt_sigma == random_error(SENSORS).sigma > 0.0
    assert steadied.leader_tilt_time == 30.0
    offsets = {arm: cell.errors.leader_attitude_offset_sigma for arm, cell in made.items()}
    assert offsets == {arm: np.deg2rad(0.5) if arm is CONSTANT else 0.0 for arm in ARMS}
    expected = {arm: getattr(cell.settings, "expected_pitch") for arm, cell in made.items()}  # noqa: B009
    assert expected == pytest.approx({arm: np.deg2rad(6.0) if arm is INFLATED else 0.0 for arm in ARMS})


def test_the_excess_of_a_curve_is_paired_run_by_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs scatter by 1 m alike at all values, and by 0.1 m about what the second value adds, 0.4 m."""
    rng = np.random.default_rng(2)
    noise, own = rng.normal(size=400), 0.1 * rng.normal(size=400)
    errors = [2.0 + noise, 2.4 + noise + own]

    def simulated(cell: Any) -> Any:
        return CellResult({"e_p_mean_m": float(errors[cell].mean())}, {"e_p_mean_m": errors[cell]})

    monkeypatch.setattr(missions, "simulate", simulated)
    curve = missions.curve_of({0.0: 0, -2.0: 1}, "T3", 5.0, 2.0)  # type: ignore[dict-item]
    excess = curve.excess_at(-2.0)
    assert excess.value == pytest.approx(0.4 + own.mean())
    half = 1.959964 * own.std(ddof=1) / 20.0
    assert (excess.low, excess.high) == pytest.approx((excess.value - half, excess.value + half))
    assert curve.excess_half_m[0] == 0.0


def test_a_curve_that_dips_counts_as_flat_there() -> None:
    curve = Curve(route="T3", interval_s=1.0, depth_offset_m=5.0, value=(0.0, -1.0, -2.0, -4.0),
                  e_p_mean_m=(0.3, 0.6, 0.5, 1.0), excess_half_m=(0.0, 0.1, 0.1, 0.1))  # fmt: skip
    assert curve.equivalent(0.35) == pytest.approx(2.25)


def test_curves_widen_the_rear_error_and_lower_the_bow(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a transmitter 1 m before and behind: R_rear² − R_front² = 4 (x cos φ − Δz sin φ), φ the pitch."""
    seen: list[tuple[dict[float, Cell], Any]] = []
    monkeypatch.setattr(missions, "curve_of", lambda cells, *where: seen.append((cells, where)))
    monkeypatch.setattr(missions, "INTERVALS_S", (1.0, 5.0))
    missions.fly_curves(Plan(routes=("T3",), offsets_m=(0.0, 2.0), looks=(4,), duration_s=20.0))
    (tilts, of_pitch), (_, of_first), (wider, of_tau) = seen
    assert (tuple(tilts), of_pitch) == (missions.PITCH_DEG, ("T3", 5.0, 2.0))
    assert (tuple(wider), of_first, of_tau) == (missions.TAU_M, ("T3", 1.0), ("T3", 5.0))
    over_pitch, over_tau = [*tilts.values()], [*wider.values()]
    assert [cell.errors.range_tau for cell in over_tau] == [(t, 0.01, 0.01) for t in missions.TAU_M]
    assert {cell.errors.range_tau for cell in over_pitch} == {(0.01, 0.01, 0.01)}
    ranges = [cell.truth.slant_range for cell in over_pitch]
    differences = np.array([r[:, 0] ** 2 - r[:, 1] ** 2 for r in ranges])
    ahead = differences[0] / 4.0
    pitch = np.deg2rad(missions.PITCH_DEG)[:, None]
    assert pitch.min() < -0.2
    assert differences == pytest.approx(4.0 * (ahead * np.cos(pitch) - 2.0 * np.sin(pitch)), abs=0.15)
    assert all(len(cell.runs) == 4 for cell in over_pitch)
    np.testing.assert_array_equal(over_tau[0].truth.slant_range, ranges[0])
