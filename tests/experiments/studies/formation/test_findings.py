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
def test_every_condition_is_a_scenario_that_can_be_flown(condition: PlanEntry) -> None:
    scenario = condition.scenario_at(3)
    assert scenario.run == 3
    assert all(follower.station for follower in scenario.followers)


@pytest.mark.parametrize("condition", CONDITIONS.values(), ids=CONDITIONS)
def test_numbers_of_a_title_are_those_of_its_condition(condition: PlanEntry) -> None:
    """What a title does not mention is as in all others: ten followers, three transmitters, a
    message each second.
    """
    made, title = condition.scenario_at(0), PLAN.study.title("arm", condition.arm)
    sound, sensors, ocean = made.acoustics, made.sensors, made.ocean

    def in_title(words: str, usual: float = 0.0) -> float:
        actual = re.search(words, title)
        return float(actual[1]) if actual else usual

    assert len(made.followers) == in_title(r"(\d+) followers", 10)
    assert made.navigation.transmitters == in_title(
        r"(\d) transmitters", 2 if title == "LAISN-2" else 3
    )
    assert made.timing.message_interval_s == in_title(r"every (\d+) s", 1)
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
    greatest = in_title(r"current up to ([\d.]+) m/s")
    # the first of five runs has a fifth of the greatest current
    assert ocean.current_speed_m_s == pytest.approx(in_title(r"current ([\d.]+) m/s", greatest / 5))
    assert max(speeds) == greatest or not greatest
    assert ocean.current_shear_per_s == in_title(r"([\d.]+) m/s less for each metre")
    assert (ocean.waves.height_m if ocean.waves.kind != "none" else 0.0) == in_title(
        r"Hs ([\d.]+) m"
    )
    assert sensors.leader_heading_bias_deg == in_title(r"compass (\d+)° off")
    assert made.navigation.assume.exact_leader != (
        "leader's compass" in title and "estimated" in title
    )
    assert made.navigation.assume.current != ("known to be still" in title)
    assert sensors.speed_drift_m_s == in_title(r"drift by ([\d.]+) m/s")
    assert sensors.heading_drift_deg == in_title(r"m/s and (\d)°")
    dive = (
        [[0.0, 5.0], [200.0, 5.0], [350.0, 40.0]]
        if "dives from 5 to 40 m in 150 s" in title
        else []
    )
    assert [list(point) for point in made.leader.depth_profile] == dive
    assert PLAN.runs_of(condition).step == (5 if "50 followers" in title else 1)


def test_conditions_match_their_titles() -> None:
    def made(name: str, run: int = 0) -> Scenario:
        return CONDITIONS[name].scenario_at(run)

    assert made("two aside").navigation.transmitters == 2
    ports = [f.station.port_m for f in made("two aside").followers if f.station]
    assert min(abs(port) for port in ports) > 3.0
    speeds = [made("current", run).ocean.current_speed_m_s for run in range(5)]
    assert sorted(speeds) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    # from all around, however many runs there are: no gap between directions is three times the
    # mean one
    ways = sorted(made("current", run).ocean.current_direction_deg for run in range(20))
    assert max(np.diff([*ways, ways[0] + 360.0])) < 3 * 360.0 / 20
    # 40 % are lost: a burst begins with p = 2/15 and lasts 5 messages, so that p / (p + 1/5) of the
    # time is one
    assert made("bursts").acoustics.burst_probability == pytest.approx(2 / 15, abs=1e-4)
    behind = [f.station.behind_m for f in made("5 s loss back").followers if f.station]
    assert min(behind) >= 20.0
    fifty = made("fifty")
    assert len(fifty.followers) == 50
    assert {f.held_depth_m for f in fifty.followers} == {10.0, 11.0, 12.0, 13.0}
    near = made("fifty near")
    assert {f.held_depth_m for f in near.followers} == {10.0}
    assert near.formation.proximity
    directions = {made("ins", run).sensors.leader_position_drift_deg for run in range(5)}
    assert len(directions) == 5
    swings = [made("drift", run).sensors for run in range(9)]
    phases = np.deg2rad([(s.speed_drift_phase_deg, s.heading_drift_phase_deg) for s in swings])
    # neither phase, nor how far log and compass are apart, is in favour of a direction
    apart = phases[:, 0] - phases[:, 1]
    for angles in (phases[:, 0], phases[:, 1], apart):
        assert abs(np.mean(np.exp(1j * angles))) < 0.2
    assert not any(f.guided_by_estimate for f in made("truth").followers)


def outcomes_of(by_arm: dict[str, Any]) -> dict[str, Any]:
    """Outcomes whose rows are given by arm, run and follower."""
    return {"study": SimpleNamespace(cells=cells_of(by_arm))}


def test_a_record_counts_what_runs_came_to() -> None:
    """Three runs of three followers, of whom one is far worse than the others: no mean is a
    median.
    """
    runs = [
        [
            {
                "station_rms_m": each * (1 + i),
                "station_p95_m": 2 * each + i,
                "station_max_m": 9 * each * (i + 1),
                "station_turn_max_m": each * i,
                "station_leg_rms_m": each / 2 + i,
                "lost": float(i > 0 and each > 2),
                "track_error_end_m": 10.1 if i > 1 and each > 2 else 9.9,
                "e_p_mean_m": each * i,
                "closest_horizontal_m": 5.0 - i + each - 1,
                "closest_in_layer_m": 4.0 + i if each > 1 else None,
                "touched": float(i == 1 and each > 1),
                "power_mean_w": 10.0 * i * i + each - 4.0,
            }
            for each in (1.0, 2.0, 9.0)
        ]
        for i in range(3)
    ]
    actual = findings_of(outcomes_of({"calm": runs}))
    # of 1, 2, 9, 2, 4, 18, 3, 6, 27
    assert (actual["median calm"].value, actual["worst calm"].value) == (4.0, 27.0)
    # medians of runs are 2, 4 and 6
    assert actual["run-median calm"].value == pytest.approx(4.0)
    # of 2, 4, 18 and one and two more, and of 0.5, 1, 4.5 likewise
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
    assert [actual[f"{what} calm"].unit for what in ("median", "error", "power", "lost")] == [
        "m",
        "m",
        "W",
        "",
    ]
    alone = findings_of(
        outcomes_of({"calm": [[row | {"closest_in_layer_m": None} for row in run] for run in runs]})
    )
    assert alone["within calm"].value is None


def test_runs_are_numbered_from_zero_and_some_conditions_fly_every_other_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plans: list[StudyPlan] = []

    def fly(given: list[StudyPlan], folder: Path, **_: object) -> list[StudyResults]:
        (plan,) = given
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
    numbers = {entry.arm: list(plan.runs_of(entry)) for entry in plan.entries}
    assert numbers["calm"] == [0, 1, 2, 3, 4, 5]
    assert numbers["fifty"] == [0, 5]
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
    given: list[Mapping[Any, engine.Task]] = []

    def fly(_: object, tasks: Mapping[Any, engine.Task], folder: Path, **options: object) -> None:
        given.append(tasks)
        raise InterruptedError

    monkeypatch.setattr(engine.campaign, "fly", fly)
    with pytest.raises(InterruptedError):
        engine.fly_studies([PLAN], tmp_path)
    (tasks,) = given
    design_key = CONDITIONS["current"].design_key
    flown = [tasks[0, design_key, run].args for run in range(60)]
    assert [run for _, run in flown] == list(range(60))
    assert [scenario.ocean.current_speed_m_s for scenario, _ in flown[:6]] == [
        0.1,
        0.2,
        0.3,
        0.4,
        0.5,
        0.1,
    ]
    assert flown[7][0].ocean.current_direction_deg == pytest.approx(7 * 137.508 - 2 * 360)


def test_a_short_run_keeps_its_stations() -> None:
    calm = CONDITIONS["calm"].scenario.model_copy(update={"duration_s": 30.0})
    rows = records_of_run(calm, 0)
    assert len(rows) == 10
    assert max(row["station_max_m"] for row in rows) < 3.0
    assert min(row["closest_horizontal_m"] for row in rows) > 4.0
    assert max(row["e_p_mean_m"] for row in rows) < 1.0
