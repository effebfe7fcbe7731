"""Cases, several scenarios, leaders without pitch, runs and errors over time of studies."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.campaign.montecarlo import CampaignMission, Cell, simulate, simulate_mission
from experiments.study.file import StudyError, study_from_table, study_of
from experiments.study.page import StudyPage, commands, worst_run
from experiments.study.plan import StudyPlan, plan_of
from experiments.study.run import RunTotals, StudyResults, fly_further, fly_studies
from laisn.plugins import load_plugin
from sim.scenario.parts import MotionSettings
from sim.trajectory import tilted
from tests.without_plugins import without_plugins

ERRORS = "experiments.studies.estimators.errors"
CLOCK_SENSOR = """
from dataclasses import dataclass

@dataclass(frozen=True, kw_only=True)
class Clock:
    name = "clock"
    stream = 22
    channels = {"time": "s"}

    def true(self, state, environment):
        return [state.time]

    def read(self, true, draws):
        return true
"""
SHORT: dict[str, Any] = {
    "scenario": "T5",
    "runs": 3,
    "set": {"duration_s": 20.0, "leader.excess_buoyancy_n": 8.0},
}


def plan(table: dict[str, Any]) -> StudyPlan:
    """Plan of `SHORT` with the keys of a table."""
    return plan_of(study_from_table(SHORT | table, "s", "s"))


def fly_study(folder: Path, table: dict[str, Any]) -> StudyResults:
    """Results of `SHORT` with the keys of a table."""
    return fly_studies([plan(table)], folder, workers=1, quiet=True)[0]


def test_cases_scenarios_and_factors_are_crossed_and_a_case_may_have_some_of_the_arms() -> None:
    cases = [
        {"name": "calm"},
        {
            "name": "current",
            "title": "a current",
            "ocean.current_speed_m_s": 0.3,
            "arms": ["laisn"],
            "duration_s": 30.0,
        },
    ]
    arms = [{"name": "laisn"}, {"name": "tight", "navigation.variant": "tight"}]
    crossed = plan(
        {
            "scenario": ["T2", "T6"],
            "case": cases,
            "arm": arms,
            "vary": {"timing.message_interval_s": [1, 5]},
        }
    )
    assert [tuple(point.values()) for point in crossed.points] == [
        (case, route, interval)
        for case in ("calm", "current")
        for route in ("T2", "T6")
        for interval in (1, 5)
    ]
    assert [*crossed.points[0]] == ["case", "scenario", "timing.message_interval_s"]
    selected = plan(
        {
            "scenario": ["T2", "T6"],
            "case": cases,
            "arm": arms,
            "vary": {"scenario": ["T6"], "case": ["calm"]},
        }
    )
    assert [tuple(point.values()) for point in selected.points] == [("calm", "T6")]
    arms_of = {number: [e.arm for e in crossed.entries if e.point == number] for number in range(8)}
    assert arms_of == {
        number: ["laisn", "tight"] if number < 4 else ["laisn"] for number in range(8)
    }
    assert crossed.study.title("case", "current") == "a current"
    for entry in crossed.entries:
        scenario, point = entry.scenario, crossed.points[entry.point]
        assert scenario.followers[0].route == point["scenario"] == entry.source
        assert (scenario.duration_s, scenario.ocean.current_speed_m_s) == (
            (20.0, 0.0) if point["case"] == "calm" else (30.0, 0.3)
        )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"case": [{"name": "a"}, {"name": "a"}]}, "case: names must differ; repeated: a"),
        ({"case": [{"name": "a", "arms": ["b"]}]}, "case a: there is no arm 'b'"),
        ({"case": [{"title": "a"}]}, r"case\[0\].name: needs a name"),
        (
            {"case": [{"name": "a", "duration_s": 9.0}], "vary": {"duration_s": [1, 2]}},
            "duration_s: stands in ",
        ),
        ({"case": [{"name": "a", "seed": 9}]}, "seed: belongs to the study"),
        ({"arm": [{"name": "a", "run": 9}]}, "run: belongs to the study"),
        (
            {"case": [{"name": "base"}, {"name": "rough"}], "vary": {"case": ["bse"]}},
            r"vary.case: there is no case 'bse'; did you mean 'base'\? available: base, rough",
        ),
        (
            {"case": [{"name": "a", "arms": ["y"]}], "arm": [{"name": "x"}]},
            "case a: there is no arm 'y'; available: x",
        ),
        (
            {"scenario": ["T5", "T6"], "vary": {"scenario": ["T99"]}},
            "vary.scenario: there is no scenario 'T99'; available: T5, T6",
        ),
        ({"scenario": []}, "scenario: List should have at least 1 item"),
        ({"scenario": ["T2", "T2"]}, "vary.scenario: a value stands in the list twice"),
        ({"scenario": ["T2", "T77"]}, "unknown scenario"),
        ({"vary": {"duration_s": [5, 9]}, "runs_apart": 2**20}, "runs_apart: Input should be less"),
        ({"vary": {"run": [5, 2**31 - 5]}}, "the last run is number"),
        (
            {"arm": [{"name": "a", "disturb": {"use": f"{ERRORS}:Errors", "errors": ["x"]}}]},
            "there is no error 'x'",
        ),
        (
            {
                "arm": [
                    {"name": "a", "disturb": {"use": f"{ERRORS}:np.os.system", "command": "true"}}
                ]
            },
            "expected a class with",
        ),
        (
            {"arm": [{"name": "a", "disturb": {"use": f"{ERRORS}:Nothing"}}]},
            "expected a class with `disturb",
        ),
        (
            {"arm": [{"name": "a", "disturb": {"use": f"{ERRORS}:Measurements"}}]},
            "expected a class with `disturb",
        ),
        (
            {"arm": [{"name": "a", "disturb": {"use": "experiments.studies.no.way:Errors"}}]},
            "expected a class with",
        ),
        (
            {"scenario": "swarm", "arm": [{"name": "a", "leader_pitch_deg": 0}]},
            "leader_pitch_deg and measured apply to missions",
        ),
    ],
)
def test_errors_of_cases_scenarios_and_runs_are_named(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(StudyError, match=message):
        plan(changed)


def test_an_arm_may_follow_a_leader_without_pitch_on_the_same_track(tmp_path: Path) -> None:
    """Each arm has the results of its cell flown alone, behind a pitching or a level leader."""
    arms = [{"name": "real"}, {"name": "level", "leader_pitch_deg": 0}]
    outcomes = fly_study(tmp_path, {"arm": arms})
    scenario = plan({}).entries[0].scenario
    pitching = simulate_mission(scenario)
    assert np.abs(pitching.pitch[:, 0]).max() > np.deg2rad(1.0)
    for row, (labels_of_runs, values_of_runs), leader_motion in zip(
        outcomes.rows, outcomes.runs, (pitching, tilted(pitching, 0.0)), strict=True
    ):
        alone = simulate(
            Cell.of(
                scenario, 0, 3, mission=CampaignMission(MotionSettings.of(scenario), leader_motion)
            )
        )
        assert {name: row[name] for name in ("e_p_mean_m", "nees")} == {
            name: alone.row[name] for name in ("e_p_mean_m", "nees")
        }
        assert values_of_runs["e_p_mean_m"].tolist() == alone.runs["e_p_mean_m"].tolist()
        assert labels_of_runs["arm"] == row["arm"]
    assert outcomes.rows[0]["e_p_mean_m"] != outcomes.rows[1]["e_p_mean_m"]
    assert outcomes.rows[0]["leader_pitch_rms_deg"] == outcomes.rows[1]["leader_pitch_rms_deg"]


def test_sums_follow_other_keys_and_variables_of_the_study() -> None:
    depths = {
        "followers.0.depth_m": {"sum": ["leader.depth_m", "offset_m", 1.0]},
        "leader.depth_m": 8.0,
    }
    cases = [{"name": "deep"}, {"name": "shallow", "leader.depth_m": 3.0}]
    study_plan = plan(
        {"set": SHORT["set"] | depths, "vary": {"offset_m": [2.0, 5.0]}, "case": cases}
    )
    assert [entry.scenario.followers[0].depth_m for entry in study_plan.entries] == [
        11.0,
        14.0,
        6.0,
        9.0,
    ]
    assert [point["offset_m"] for point in study_plan.points] == [2.0, 5.0, 2.0, 5.0]
    assert all("offset_m" not in entry.settings for entry in study_plan.entries)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (
            {"set": {"followers.0.depth_m": {"sum": ["leader.depth_m", 2.0]}}},
            "keys that the study sets to numbers",
        ),
        ({"vary": {"offset_m": [1.0]}}, "offset_m: unknown key"),
        (
            {"set": {"navigation.expected_pitch_deg": {"measured": "no_m"}}},
            "unknown column of a mission 'no_m'",
        ),
        (
            {"set": {"navigation.pitch_deg": {"measured": "leader_pitch_rms_deg"}}},
            "navigation.pitch_deg: unknown key",
        ),
        (
            {
                "scenario": "swarm",
                "set": {"navigation.expected_pitch_deg": {"measured": "leader_pitch_rms_deg"}},
            },
            "measured apply to missions that runs share",
        ),
    ],
)
def test_errors_of_sums_and_measured_values_are_named(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(StudyError, match=message):
        plan(changed)


def test_a_measured_value_is_that_of_the_mission(tmp_path: Path) -> None:
    key = "navigation.expected_pitch_deg"
    arms = [{"name": "measured", key: {"measured": "leader_pitch_rms_deg"}}]
    (row,) = fly_study(tmp_path, {"arm": arms}).rows
    with_number = fly_study(
        tmp_path, {"set": SHORT["set"] | {key: row["leader_pitch_rms_deg"]}}
    ).rows[0]
    assert row[key] == row["leader_pitch_rms_deg"] > 1.0
    assert row["e_p_mean_m"] == with_number["e_p_mean_m"]
    assert row["e_p_mean_m"] != fly_study(tmp_path, {}).rows[0]["e_p_mean_m"]


def test_commands_have_the_measured_value_of_their_realization(tmp_path: Path) -> None:
    """Leaders in three realizations of waves pitch differently."""
    key = "navigation.expected_pitch_deg"
    arms = [{"name": "measured", key: {"measured": "leader_pitch_rms_deg"}}]
    settings = SHORT["set"] | {"ocean.waves.kind": "jonswap"}
    outcomes = fly_study(tmp_path, {"arm": arms, "set": settings, "realizations": 3})
    pitch = {row["realization"]: row["leader_pitch_rms_deg"] for row in outcomes.rows}
    assert len({*pitch.values()}) == 3
    text = commands(outcomes.plan, outcomes.results)
    values_in_commands = re.findall(rf"of realization (\d)\n.*--set {key}=(\S+)", text)
    assert len(values_in_commands) == 2
    assert {int(number) for number, _ in values_in_commands} != {0}
    for number, value in values_in_commands:
        assert float(value) == pytest.approx(pitch[int(number)], rel=1e-9)
    worst = worst_run(outcomes.plan, outcomes.results)
    assert worst is not None
    assumed_deg = worst.scenario.navigation.expected_pitch_deg
    assert assumed_deg == pytest.approx(pitch[worst.entry.realization], rel=1e-9)


def test_commands_load_plugins_and_leave_out_what_no_flight_can_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    source = tmp_path / "own" / "clocks.py"
    source.parent.mkdir()
    source.write_text(CLOCK_SENSOR)
    (tmp_path / "unused.py").write_text("")
    arms = [
        {"name": "plain"},
        {"name": "pitched", "leader_pitch_deg": 20.0},
        {"name": "drift", "disturb": {"use": f"{ERRORS}:Errors", "errors": ["drift"]}},
    ]
    (tmp_path / "own.toml").write_text(
        '[[sensors.custom]]\nsensor = "clocks:Clock"\n[[followers]]\nroute = "T5"\n'
    )
    with without_plugins():
        load_plugin(source)
        load_plugin(tmp_path / "unused.py")
        outcomes = fly_study(tmp_path, {"arm": arms, "scenario": "own.toml"})
        lines = commands(outcomes.plan, outcomes.results).splitlines()
        page = StudyPage(plan=outcomes.plan, results=outcomes.results, failures={})
        facts = dict(page.facts)
    assert [line.startswith("laisn fly") for line in lines[1::2]] == [True] * 2 + [False] * 4
    command = "laisn fly own.toml --plugin own/clocks.py --run"
    assert all(line.startswith(command) for line in lines[1:4:2])
    assert "no leader_pitch_deg" in lines[5]
    assert "no disturb" in lines[9]
    assert facts["repeat it"].startswith("laisn study study.toml --plugin own/clocks.py")
    # the worst place is one that a flight cannot repeat
    errors = {row["arm"]: row["e_p_mean_m"] for row in outcomes.rows}
    assert max(errors, key=errors.__getitem__) == "pitched"
    worst = worst_run(outcomes.plan, outcomes.results)
    assert worst is not None
    assert worst.entry.arm == "plain"
    assert page.look_text.endswith("that a flight can repeat.")


def test_runs_that_a_study_adds_are_those_of_a_longer_study(tmp_path: Path) -> None:
    arms = [{"name": "a"}, {"name": "b", "navigation.gate": "off"}]
    outcomes, runs_flown = {"part": fly_study(tmp_path, {"arm": arms})}, []

    def choose(outcomes: Any) -> dict[str, RunTotals]:
        runs_flown.append(
            [len(values_of_runs["run"]) for _, values_of_runs in outcomes["part"].runs]
        )
        return {"part": {(0, "b", 0): 5}} if len(runs_flown) == 1 else {}

    fly_further(outcomes, choose, tmp_path, workers=1, quiet=True)
    assert runs_flown == [[3, 3], [3, 5]]
    longer = fly_study(tmp_path / "whole", {"arm": arms, "runs": 5})
    for name, values in outcomes["part"].runs[1][1].items():
        assert values.tolist() == pytest.approx(longer.runs[1][1][name].tolist(), nan_ok=True)
    assert outcomes["part"].rows[1]["runs"] == 3


def test_runs_have_the_noise_of_their_numbers(tmp_path: Path) -> None:
    """`runs_apart` gives each point its own run numbers; run 5 has the same noise in any study."""
    of_eight_runs = fly_study(tmp_path, {"runs": 8}).runs[0][1]
    study_plan = plan(
        {
            "set": SHORT["set"] | {"run": 2},
            "vary": {"leader.broadcast_attitude": [False, True]},
            "runs_apart": 3,
        }
    )
    assert [entry.scenario.run for entry in study_plan.entries] == [2, 5]
    for first_run, (_, values_of_runs) in zip(
        (2, 5), fly_studies([study_plan], tmp_path, workers=1, quiet=True)[0].runs, strict=True
    ):
        assert values_of_runs["run"].tolist() == [first_run, first_run + 1, first_run + 2]
        assert (
            values_of_runs["e_p_mean_m"].tolist()
            == of_eight_runs["e_p_mean_m"][first_run : first_run + 3].tolist()
        )
    second_point_alone = fly_studies(
        [study_plan.part(study_plan.entries[1:], 1)], tmp_path, workers=1, quiet=True
    )[0]
    assert [values_of_runs["run"].tolist() for _, values_of_runs in second_point_alone.runs] == [
        [5]
    ]


def test_studies_fly_together_and_keep_errors_over_time(tmp_path: Path) -> None:
    with_steps, without_steps = fly_studies(
        [plan({"steps": True}), plan({"runs": 2})], tmp_path, workers=1, quiet=True
    )
    (steps,) = with_steps.steps
    assert steps["e_p_mean_m"].mean() == pytest.approx(with_steps.rows[0]["e_p_mean_m"], rel=1e-6)
    assert without_steps.steps == [{}]
    assert (with_steps.rows[0]["runs"], without_steps.rows[0]["runs"]) == (3, 2)


def test_a_trial_run_has_the_keys_of_quick() -> None:
    table = {
        "scenario": "T5",
        "quick": {"runs": 2, "set": {"duration_s": 20.0}},
        "set": {"duration_s": 50.0},
    }
    assert study_of(table, {}).runs == 60
    quick = study_of(table, {"set": {"seed_": 1}, "runs": None}, quick=True)
    assert (quick.runs, quick.settings) == (2, {"duration_s": 20.0, "seed_": 1})
    assert study_of(table, {"runs": 5}, quick=True).runs == 5
    with pytest.raises(StudyError, match=r"--quick: the study has no \[quick\]"):
        study_of({"scenario": "T5"}, {}, quick=True)
