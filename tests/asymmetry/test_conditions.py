"""Conditions of the pitch study: keys and labels match the simulated settings."""

import re

import pytest

from experiments.studies.asymmetry.design import CONDITIONS, Condition

PERIODS = {0.3: 4.0, 0.5: 4.0, 1.0: 5.0}
"""Periods of young wind seas by their height: 0.5 m at 4 s, 1 m at 5 s."""
WAYS = {"head": 270.0, "beam": 0.0, "following": 90.0}
"""Where waves run to, for a leader that goes east."""


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.key)
def test_a_condition_has_the_settings_of_its_key(condition: Condition) -> None:
    flown = condition.scenario("T5", 2.0)
    leader, waves = flown.leader, flown.ocean.waves
    values = [float(v) for v in re.findall(r"[\d.]+", condition.key)]
    trim, dive = (values[0] if condition.cause == cause else 0.0 for cause in ("trim", "dive"))
    assert (leader.excess_buoyancy_n, leader.saw_tooth_amplitude_m) == (trim, dive)
    assert (waves.kind != "none") == (condition.cause == "waves")
    depth = 8.0
    if condition.cause == "waves":
        height, depth = values
        sea = condition.key.split("-")[2]
        assert (waves.height_m, waves.period_s, waves.direction_deg) == (height, PERIODS[height], WAYS[sea])
        assert condition.label == f"Hs {height:g} m, {sea} sea, leader at {depth:g} m"
    assert (leader.depth_m, flown.followers[0].depth_m) == (depth, depth + 2.0)
    assert (flown.seed, leader.broadcast_attitude) == (1, True)
    if condition.cause == "dive":
        assert leader.saw_tooth_period_s == 120.0
