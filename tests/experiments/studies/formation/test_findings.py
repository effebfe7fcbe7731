"""The study of formations: its conditions, and figures by hand."""

import re
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.studies.formation.findings import findings_of
from experiments.study import run as engine
from experiments.study import study as studies
from experiments.study.file import study_of
from experiments.study.measure import METRICS, records_of_run
from experiments.study.plan import PlanEntry, StudyPlan, plan_of
from experiments.study.run import StudyResults
from reports.findings import read_findings
from sim.scenario.settings import Scenario
from tests.experiments.study.cells import cells_of

PLAN = plan_of(study_of("formation", {}))
CONDITIONS = {entry.arm: entry for entry in PLAN.entries}


@pytest.mark.parametrize("condition", CONDITIONS.values(), ids=CONDITIONS)
def test_every_run_of_a_condition_is_a_scenario_whose_followers_have_stations(
    condition: PlanEntry,
) -> None:
    scenario = condition.scenario_at(3)
    assert scenario.run == 3
    assert all(follower.station for follower in scenario.followers)


@pytest.mark.parametrize("condition", CONDITIONS.values(), ids=CONDITIONS)
def test_numbers_of_a_title_are_those_of_its_condition(condition: PlanEntry) -> None:
    """What a title does not mention is as in all others: ten followers, three transmitters, a
    message each second.
    """
    scenario, title = condition.scenario_at(0), PLAN.study.title("arm", condition.arm)
    sound, sensors, ocean = scenario.acoustics, scenario.sensors, scenario.ocean

    def in_title(pattern: str, default: float = 0.0) -> float:
        match = re.search(pattern, title)
        return float(match[1]) if match else default

    assert len(scenario.followers) == in_title(r"(\d+) followers", 10)
    assert scenario.navigation.transmitters == in_title(
        r"(\d) transmitters", 2 if title == "LAISN-2" else 3
    )
    assert scenario.timing.message_interval_s == in_title(r"every (\d+) s", 1)
    # a burst of n messages that begins with p takes up p / (p + 1/n) of the time
    bursts = sound.burst_probability / (sound.burst_probability + 1.0 / sound.burst_mean_messages)
    assert sound.burst_mean_messages == in_title(r"bursts of (\d+) s", 5)
    assert 100 * (sound.loss_probability + bursts) == pytest.approx(
        in_title(r"(\d+) % (?:of messages )?lost"), abs=0.1
    )
    assert 100 * (sound.surface_echo_probability + sound.bottom_echo_probability) == pytest.approx(
        in_title(r"(\d+) % echoes")
    )
    speeds = [condition.scenario_at(run).ocean.current_speed_m_s for run in range(6)]
    largest_current = in_title(r"current up to ([\d.]+) m/s")
    # the first of five runs has a fifth of the greatest current
    assert ocean.current_speed_m_s == pytest.approx(
        in_title(r"current ([\d.]+) m/s", largest_current / 5)
    )
    assert max(speeds) == largest_current or not largest_current
    assert ocean.current_shear_per_s == in_title(r"([\d.]+) m/s less for each metre")
    assert (ocean.waves.height_m if ocean.waves.kind != "none" else 0.0) == in_title(
        r"Hs ([\d.]+) m"
    )
    assert sensors.leader_heading_bias_deg == in_title(r"compass (\d+)° off")
    assert scenario.navigation.assume.exact_leader != (
        "leader's compass" in title and "estimated" in title
    )
    assert scenario.navigation.assume.current != ("known to be still" in title)
    assert sensors.speed_drift_m_s == in_title(r"drift by ([\d.]+) m/s")
    assert sensors.heading_drift_deg == in_title(r"m/s and (\d)°")
    dive = (
        [[0.0, 5.0], [200.0, 5.0], [350.0, 40.0]]
        if "dives from 5 to 40 m in 150 s" in title
        else []
    )
    assert [list(point) for point in scenario.leader.depth_profile] == dive
    assert PLAN.runs_of(condition).step == (5 if "50 followers" in title else 1)


def test_conditions_have_the_settings_that_their_titles_do_not_number() -> None:
    def scenario_of(name: str, run: int = 0) -> Scenario:
        return CONDITIONS[name].scenario_at(run)

    assert scenario_of("two aside").navigation.transmitters == 2
    ports = [
        follower.station.port_m
        for follower in scenario_of("two aside").followers
        if follower.station
    ]
    assert min(abs(port) for port in ports) > 3.0
    speeds = [scenario_of("current", run).ocean.current_speed_m_s for run in range(5)]
    assert sorted(speeds) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    # from all around, however many runs there are: no gap between directions is three times the
    # mean one
    directions = sorted(
        scenario_of("current", run).ocean.current_direction_deg for run in range(20)
    )
    assert max(np.diff([*directions, directions[0] + 360.0])) < 3 * 360.0 / 20
    # 40 % are lost: a burst begins with p = 2/15 and lasts 5 messages, so that p / (p + 1/5) of the
    # time is one
    assert scenario_of("bursts").acoustics.burst_probability == pytest.approx(2 / 15, abs=1e-4)
    distances_behind = [
        follower.station.behind_m
        for follower in scenario_of("5 s loss back").followers
        if follower.station
    ]
    assert min(distances_behind) >= 20.0
    fifty = scenario_of("fifty")
    assert len(fifty.followers) == 50
    assert {follower.held_depth_m for follower in fifty.followers} == {10.0, 11.0, 12.0, 13.0}
    fifty_near = scenario_of("fifty near")
    assert {follower.held_depth_m for follower in fifty_near.followers} == {10.0}
    assert fifty_near.formation.proximity
    drift_directions = {
        scenario_of("ins", run).sensors.leader_position_drift_deg for run in range(5)
    }
    assert len(drift_directions) == 5
    sensors = [scenario_of("drift", run).sensors for run in range(9)]
    phases = np.deg2rad(
        [(sensor.speed_drift_phase_deg, sensor.heading_drift_phase_deg) for sensor in sensors]
    )
    # both phases, and their difference, are spread all around
    phase_difference = phases[:, 0] - phases[:, 1]
    for angles in (phases[:, 0], phases[:, 1], phase_difference):
        assert abs(np.mean(np.exp(1j * angles))) < 0.2
    assert not any(follower.guided_by_estimate for follower in scenario_of("truth").followers)


def outcomes_of(by_arm: dict[str, Any]) -> dict[str, Any]:
    """Outcomes whose rows are given by arm, run and follower."""
    return {"study": SimpleNamespace(cells=cells_of(by_arm))}


def test_findings_are_medians_means_and_counts_over_runs_and_followers() -> None:
    """Three runs of three followers, of whom one is far worse than the others: no mean is a
    median.
    """
    runs = [
        [
            {
                "station_rms_m": base * (1 + number),
                "station_p95_m": 2 * base + number,
                "station_max_m": 9 * base * (number + 1),
                "station_turn_max_m": base * number,
                "station_leg_rms_m": base / 2 + number,
                "lost": float(number > 0 and base > 2),
                "track_error_end_m": 10.1 if number > 1 and base > 2 else 9.9,
                "e_p_mean_m": base * number,
                "closest_horizontal_m": 5.0 - number + base - 1,
                "closest_in_layer_m": 4.0 + number if base > 1 else None,
                "touched": float(number == 1 and base > 1),
                "power_mean_w": 10.0 * number * number + base - 4.0,
            }
            for base in (1.0, 2.0, 9.0)
        ]
        for number in range(3)
    ]
    actual = findings_of(outcomes_of({"calm": runs}))
    # of 1, 2, 9, 2, 4, 18, 3, 6, 27
    assert (actual["median calm"].value, actual["worst calm"].value) == (4.0, 27.0)
    # medians of runs are 2, 4 and 6
    assert actual["run-median calm"].value == pytest.approx(4.0)
    # medians of 2, 4, 18 with 0, 1 and 2 added, and of 0.5, 1, 4.5 likewise
    assert (actual["p95 calm"].value, actual["leg calm"].value) == (5.0, 2.5)
    assert (actual["max calm"].value, actual["turn calm"].value) == (243.0, 18.0)
    # means of runs are 0, 4 and 8, and 0, 10 and 40
    assert (actual["error calm"].value, actual["power calm"].value) == pytest.approx(
        (4.0, 50 / 3), rel=1e-5
    )
    assert (actual["lost-runs calm"].value, actual["closest calm"].value) == (2, 3.0)
    assert actual["lost-runs calm"].what == "followers lost, of 9"
    assert actual["lost calm"].value == pytest.approx(2 / 9, rel=1e-5)
    assert actual["away calm"].value == pytest.approx(1 / 9, rel=1e-5)
    assert (actual["within calm"].value, actual["contact calm"].value) == (
        4.0,
        pytest.approx(1 / 3, rel=1e-5),
    )
    assert actual["runs"].value == 3
    assert [actual[f"{finding} calm"].unit for finding in ("median", "error", "power", "lost")] == [
        "m",
        "m",
        "W",
        "",
    ]
    without_layer_mates = findings_of(
        outcomes_of({"calm": [[row | {"closest_in_layer_m": None} for row in run] for run in runs]})
    )
    assert without_layer_mates["within calm"].value is None


def test_runs_are_numbered_from_zero_and_some_conditions_fly_every_fifth_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans: list[StudyPlan] = []

    def fly(study_plans: list[StudyPlan], folder: Path, **_: object) -> list[StudyResults]:
        (plan,) = study_plans
        plans.append(plan)
        outcomes = StudyResults(plan=plan, rows=[], runs=[], steps=[], store=None)  # type: ignore[arg-type]
        for entry in plan.entries:
            runs = list(plan.runs_of(entry))
            for follower in entry.scenario.followers:
                labels = {"point": 0, "arm": entry.arm, "realization": 0, "follower": follower.name}
                outcomes.rows.append(labels | dict.fromkeys(METRICS, 1.0))
                outcomes.runs.append((labels, {"run": runs}))
        return [outcomes]

    monkeypatch.setattr(studies, "fly_until_narrow", fly)
    studies.run("formation", {"runs": 6}, tmp_path)
    (plan,) = plans
    runs_by_arm = {entry.arm: list(plan.runs_of(entry)) for entry in plan.entries}
    assert runs_by_arm["calm"] == [0, 1, 2, 3, 4, 5]
    assert runs_by_arm["fifty"] == [0, 5]
    assert plan.entries[0].scenario.duration_s == 1000.0
    actual = read_findings(tmp_path / "results.json")
    assert actual["runs"].value == 6
    assert actual["lost-runs calm"].value == 60
    assert actual["lost-runs fifty"].value == 100


@pytest.mark.system
def test_every_run_of_a_condition_has_values_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What the engine computes is the scenario of each run, independently of other runs."""
    task_tables: list[Mapping[Any, engine.Task]] = []

    def fly(_: object, tasks: Mapping[Any, engine.Task], folder: Path, **options: object) -> None:
        task_tables.append(tasks)
        raise InterruptedError

    monkeypatch.setattr(engine.campaign, "fly", fly)
    with pytest.raises(InterruptedError):
        engine.fly_studies([PLAN], tmp_path)
    (tasks,) = task_tables
    design_key = CONDITIONS["current"].design_key
    scenarios_and_runs = [tasks[0, design_key, run].args for run in range(60)]
    assert [run for _, run in scenarios_and_runs] == list(range(60))
    assert [scenario.ocean.current_speed_m_s for scenario, _ in scenarios_and_runs[:6]] == [
        0.1,
        0.2,
        0.3,
        0.4,
        0.5,
        0.1,
    ]
    # directions of runs are the golden angle apart
    assert scenarios_and_runs[7][0].ocean.current_direction_deg == pytest.approx(
        7 * 137.508 - 2 * 360
    )


def test_a_short_run_keeps_its_stations() -> None:
    calm = CONDITIONS["calm"].scenario.model_copy(update={"duration_s": 30.0})
    rows = records_of_run(calm, 0)
    assert len(rows) == 10
    assert max(row["station_max_m"] for row in rows) < 3.0
    assert min(row["closest_horizontal_m"] for row in rows) > 4.0
    assert max(row["e_p_mean_m"] for row in rows) < 1.0
