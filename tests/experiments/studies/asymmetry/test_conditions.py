"""Conditions of the pitch study: keys and labels match the simulated settings."""

import re

import pytest

from experiments.study.file import built_in_files, study_of
from experiments.study.plan import PlanEntry, plan_of

PERIODS_S = {0.3: 4.0, 0.5: 4.0, 1.0: 5.0}
"""Periods of young wind seas by their significant height [m]."""
DIRECTIONS_DEG = {"head": 270.0, "beam": 0.0, "following": 90.0}
"""Compass directions in which waves run, from their names for a leader that goes east."""


KEYS = {"scenario": ["T5"], "vary": {"offset_m": [2.0]}, "arm": [{"name": "real laisn-2"}]}
STUDY = study_of(str(built_in_files("asymmetry")["missions"]), KEYS)


@pytest.fixture(scope="module")
def entries() -> dict[str, PlanEntry]:
    """Entries of the plan by the names of their conditions."""
    plan = plan_of(STUDY)
    return {plan.points[entry.point]["case"]: entry for entry in plan.entries}


@pytest.mark.parametrize("name", STUDY.cases)
def test_a_condition_has_the_settings_of_its_key(name: str, entries: dict[str, PlanEntry]) -> None:
    case = STUDY.cases[name]
    scenario, cause = entries[name].scenario, case.name.partition("-")[0]
    leader, waves = scenario.leader, scenario.ocean.waves
    key_numbers = [float(number) for number in re.findall(r"[\d.]+", case.name)]
    trim, dive = (key_numbers[0] if cause == kind else 0.0 for kind in ("trim", "dive"))
    assert (leader.excess_buoyancy_n, leader.saw_tooth_amplitude_m) == (trim, dive)
    assert (waves.kind != "none") == (cause == "waves")
    depth = 8.0
    if cause == "waves":
        height, depth = key_numbers
        sea = case.name.split("-")[2]
        assert (waves.height_m, waves.period_s, waves.direction_deg) == (
            height,
            PERIODS_S[height],
            DIRECTIONS_DEG[sea],
        )
        assert case.title == f"Hs {height:g} m, {sea} sea, leader at {depth:g} m"
    assert (leader.depth_m, scenario.followers[0].depth_m) == (depth, depth + 2.0)
    assert (scenario.seed, leader.broadcast_attitude) == (1, True)
    if cause == "dive":
        assert leader.saw_tooth_period_s == 120.0
