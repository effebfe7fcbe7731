"""Scenario files: round trip, overrides, and messages for errors."""

import tomllib
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import laisn_sim
from experiments.flight import library
from laisn.errors import LaisnWarning
from laisn.settings import NavigationSettings, TightSettings
from sim.feasibility import cautions, infeasibilities
from sim.flight import navigation_settings
from sim.scenario import file as scenario_file
from sim.scenario.file import ScenarioError
from sim.scenario.parts import SeaSettings, SensingSettings
from sim.scenario.section import split_unit
from sim.scenario.settings import Follower, Leader, Scenario, Station
from sim.sensing.sensors import SensorErrors, errors_of
from sim.simulation import simulate_motion
from sim.water.assembly import ocean_of
from tools.documents import scenario_reference as reference

MINIMAL: dict[str, Any] = {"name": "mine", "followers": [{"route": "T5"}]}


@pytest.mark.parametrize("name", library.scenario_names())
def test_every_built_in_scenario_survives_toml(name: str) -> None:
    scenario = library.load_scenario(name, ())
    text = scenario.toml()
    assert scenario_file.validate(tomllib.loads(text), name) == scenario
    assert library.load_scenario(name, (), flyable=True) == scenario


def test_the_scenarios_defaults_are_those_of_sensors_and_navigator() -> None:
    """The paper's constants stand in the scenario in a user's units, and in SI where they are
    used.
    """
    scenario = scenario_file.validate(
        {**MINIMAL, "motion": "kinematic", "duration_s": 1.0}, "mine.toml"
    )
    assert errors_of(SensingSettings.of(scenario)) == SensorErrors()
    navigation = navigation_settings(scenario, simulate_motion(scenario).sites, 0)
    # the position of the hydrophone is the hull's and the depth of the floor the sea's: they have
    # no defaults
    assert navigation.floor_depth == scenario.ocean.floor_depth_m
    assert replace(navigation, hydrophone_height=0.0, floor_depth=0.0) == NavigationSettings()
    tight_scenario = scenario_file.validate(
        {**MINIMAL, "motion": "kinematic", "duration_s": 1.0, "navigation": {"variant": "tight"}},
        "mine.toml",
    )
    tight_settings = navigation_settings(tight_scenario, simulate_motion(tight_scenario).sites, 0)
    assert replace(tight_settings, hydrophone_height=0.0, floor_depth=0.0) == TightSettings()


def test_defaults_are_the_papers() -> None:
    """Paper, Section 3.1."""
    scenario = scenario_file.validate(MINIMAL, "mine.toml")
    assert scenario.leader.baseline_m == 2.0
    assert scenario.leader.middle_offset_m == 0.1
    assert scenario.timing.filter_step_s == 0.1
    assert (scenario.sensors.speed_bias_m_s, scenario.sensors.speed_sigma_m_s) == (0.2, 0.2)
    assert (scenario.sensors.heading_bias_deg, scenario.sensors.heading_sigma_deg) == (5.0, 2.0)
    assert (scenario.navigation.alpha_m_s2, scenario.navigation.sigma_a0_m_s2) == (8.0, 60.0)
    assert (scenario.acoustics.range_scale_mean_m, scenario.acoustics.range_scale_sigma_m) == (
        0.1,
        0.05,
    )


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"senors": {}}, "senors: unknown key; did you mean 'sensors'"),
        (
            {"sensors": {"speed_bais_m_s": 1.0}},
            "sensors.speed_bais_m_s: unknown key; did you mean 'speed_bias_m_s'",
        ),
        ({"seed": "one"}, "seed: Input should be a valid integer"),
        (
            {"ocean": {"density_kg_m3": float("nan")}},
            "ocean.density_kg_m3: Input should be a finite number",
        ),
        (
            {"leader": {"baseline_m": -2.0}},
            "leader.baseline_m: Input should be greater than or equal to 0.01 (given",
        ),
        (
            {"timing": {"message_interval_s": 0.25}},
            "message_interval_s = 0.25 is no multiple of filter_step_s = 0.1",
        ),
        ({"timing": {"physics_step_s": 0.03}}, "physics_step_s = 0.03 does not divide 0.1 s"),
        ({"followers": [{}]}, "followers[0]: a follower needs a route"),
        (
            {"followers": [{"route": "T2", "name": n} for n in ("a", "a")]},
            "vehicle names must differ; repeated: a",
        ),
        ({"followers": [{"waypoints": [[0, 0, 0], [0, 1, 1]]}]}, "waypoint 2 at 0 s is not later"),
        (
            {"navigation": {"variant": "laisn-4"}},
            "navigation.variant: Input should be 'laisn-2', 'laisn-3-1'",
        ),
        ({"navigation": {"use_attitude": True}}, "needs leader.broadcast_attitude = true"),
        (
            {
                "followers": [{"station": {"behind_m": 9.0, "depth_m": 9.0}}],
                "leader": {"broadcast_attitude": False},
                "navigation": {"use_attitude": True},
            },
            "needs leader.broadcast_attitude = true",
        ),
        (
            {"sensors": {"heading_bias_deg": -181.0}},
            "heading_bias_deg: Input should be greater than or equal to -180",
        ),
        ({"leader": {"depth_m": 40.0}}, "leader would dive to 40 m"),
        (
            {"sensors": {"speed_bias_m_s": 1e308}},
            "sensors.speed_bias_m_s: Input should be less than or equal to 10",
        ),
        (
            {"leader": {"depth_profile": [[0, 5], [0, 6]]}},
            "leader.depth_profile: depth 2 at 0 s is not later",
        ),
        (
            {"leader": {"saw_tooth_amplitude_m": 9.0}},
            "leader: saw_tooth_amplitude_m = 9 about depth_m = 8 would leave",
        ),
        ({"ocean": {"current_shear_per_s": 1.0}}, "the current at leader's 8 m would run at 8 m/s"),
        (
            {"followers": [{"waypoints": [[0, 0, 0], [9, 9]]}]},
            "mine.toml: 1 error\n  followers[0].waypoints[1]",
        ),
        ({"epoch": "yesterday"}, "epoch: Invalid isoformat string: 'yesterday'"),
        ({"name": "a/b"}, "name: expected 1 to 64 letters A to Z"),
    ],
)
def test_an_error_reports_file_key_and_expectation(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_file.validate({**MINIMAL, **change}, "mine.toml")
    assert str(caught.value).startswith("mine.toml: ")
    assert expected in str(caught.value)


def test_a_depth_profile_replaces_the_saw_tooth() -> None:
    leader = {"depth_profile": [[0, 5], [9, 28]], "saw_tooth_amplitude_m": 4.0}
    assert Scenario(**{**MINIMAL, "leader": leader}).leader.saw_tooth_amplitude_m == 4.0


@pytest.mark.parametrize(
    ("key", "unit", "scale"),
    [
        ("gyro_sigma_deg_s", "°/s", np.pi / 180),
        ("slip_m_sqrt_s", "m/√s", 1.0),
        ("heading_sigma_deg", "°", np.pi / 180),
    ],
)
def test_the_reference_explains_the_unit_of_a_key(key: str, unit: str, scale: float) -> None:
    _, printed_unit, factor = split_unit(key)
    assert (printed_unit, factor) == (unit, pytest.approx(scale, rel=1e-15))
    text_before, *entries = reference.text().split(f"`{key} = ")
    assert entries
    ending = key.removeprefix(split_unit(key)[0])
    assert f"`{ending}` ({unit})" in text_before


def test_the_reference_calls_heading_errors_one_sided() -> None:
    lines = reference.text().splitlines()
    own_line, leader_line = (
        next(line for line in lines if line.startswith(f"- `{key}heading_sigma_deg = "))
        for key in ("", "leader_")
    )
    assert "to starboard, the absolute value of a normal number" in own_line
    assert "one-sided" in leader_line


def test_all_errors_are_reported_at_once() -> None:
    table = {**MINIMAL, "seed": -1, "duration_s": 0.0, "wind": 3}
    with pytest.raises(ScenarioError, match="3 errors"):
        scenario_file.validate(table, "mine.toml")


def test_overrides_reach_nested_keys_and_list_items() -> None:
    assignments = [
        "followers.0.depth_m=5",
        "navigation.variant=laisn-3-1",
        "ocean.waves.kind=jonswap",
    ]
    table = scenario_file.assigned(MINIMAL, scenario_file.values_of(assignments))
    scenario = scenario_file.validate(table, "mine.toml")
    assert scenario.followers[0].depth_m == 5.0
    assert scenario.navigation.variant == "laisn-3-1"
    assert scenario.ocean.waves.kind == "jonswap"
    assert MINIMAL == {"name": "mine", "followers": [{"route": "T5"}]}


@pytest.mark.parametrize("assignment", ["seed", "=3", "followers.7.depth_m=1", "name.first=x"])
def test_a_broken_override_is_refused(assignment: str) -> None:
    with pytest.raises(ScenarioError, match=r"--set|is no key"):
        scenario_file.assigned(MINIMAL, scenario_file.values_of([assignment]))


@pytest.mark.parametrize(
    ("assignments", "expected"),
    [
        (
            ["followers.0.waypoints=[[0, 0, 0], [10, 52.2, 0]]"],
            "followers[0].waypoints: route 'follower', waypoint 2: 5.22 m/s",
        ),
        (["followers.0.route=T1"], "followers[0].route: unknown route 'T1'; available: T2 … T9, L"),
        (["video.camera=drone"], "video.camera: unknown camera 'drone'; available: chase"),
        (["epoch=1960-01-01T00:00:00+00:00"], "epoch 1960-01-01T00:00:00Z lies outside 1970"),
        (
            ["ocean.waves.kind=regular", "ocean.waves.height_m=5"],
            "ocean.waves.height_m: expected 0 to",
        ),
    ],
)
def test_what_cannot_be_flown_names_file_and_key(assignments: list[str], expected: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        library.load_scenario("T5", assignments, flyable=True)
    source, fault = str(caught.value).splitlines()
    assert source == f"T5 {' '.join(f'--set {a}' for a in assignments)}: 1 error"
    assert fault.startswith(f"  {expected}")


def test_unreadable_files_are_reported(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"No such file"):
        scenario_file.read(tmp_path / "none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("name = \n")
    with pytest.raises(ScenarioError, match=r"not valid TOML: .* line 1"):
        scenario_file.read(broken)
    with pytest.raises(ScenarioError, match="unknown scenario 'T1'; available: T2, T3"):
        library.load_scenario("T1", ())


def test_formations_broadcast_attitude_by_default() -> None:
    station, shape = (
        {"station": {"behind_m": 9.0, "depth_m": 9.0}},
        {"shape": {"kind": "line", "count": 2}},
    )
    for table, expected in (
        ({"followers": [{"route": "T2"}]}, (False, False)),
        ({"followers": [{"route": "T2"}, station]}, (True, True)),
        (
            {
                "followers": (Follower(station=Station(behind_m=9.0, depth_m=9.0)),),
                "leader": Leader(),
            },
            (True, True),
        ),
        ({"formation": shape}, (True, True)),
        ({"followers": [station], "leader": {"broadcast_attitude": False}}, (False, False)),
        ({"followers": [station], "navigation": {"use_attitude": False}}, (True, False)),
    ):
        scenario = Scenario.model_validate(table, strict=False)
        assert (scenario.leader.broadcast_attitude, scenario.navigation.use_attitude) == expected
        # the stored file is equivalent
        assert Scenario.model_validate(scenario.model_dump(), strict=False) == scenario


def test_a_scenario_loaded_of_another_is_equal_and_names_the_same_keys() -> None:
    """Built-in ones, one that Python code made, and one with a change."""
    made = Scenario(followers=(Follower(route="T5", depth_m=8.0),), motion="kinematic")
    changed = made.model_copy(update={"run": 3, "ocean": made.ocean.model_copy()})
    for scenario in (*map(library.as_scenario, library.scenario_names()), made, changed):
        again = library.as_scenario(scenario, {})
        assert again == scenario
        assert again.timing.model_fields_set == scenario.timing.model_fields_set
    longer = library.as_scenario(made, {"duration_s": 50.0})
    assert longer == made.model_copy(update={"duration_s": 50.0})


def test_a_current_profile_is_that_of_the_water() -> None:
    """The scenario's own reckoning, by which it is checked, is what the simulated water does."""
    ocean = {
        "current_profile": [[0, 0.2, 90], [100, 0.4, 180]],
        "current_shear_per_s": 0.01,
        "current_direction_deg": 0.0,
    }
    scenario = Scenario(followers=[{"route": "T5"}], ocean=ocean)
    water = ocean_of(SeaSettings.of(scenario))
    for depth, time, expected in (
        (0.0, 0.0, (0.2, 0.0)),
        (0.0, 50.0, (0.1, -0.2)),
        (10.0, 400.0, (0.0, -0.5)),
    ):
        assert scenario.ocean.current_at(depth, time) == pytest.approx(expected, abs=1e-12)
        position = np.array([[5.0, 6.0, -depth]])
        assert water.velocity(position, time)[0] == pytest.approx((*expected, 0.0), abs=1e-12)
    assert scenario.ocean.has_current
    assert not Scenario(
        followers=[{"route": "T5"}], ocean={"current_profile": [[0, 0, 0], [9, 0, 90]]}
    ).ocean.has_current


def test_a_current_profile_beside_the_speed_that_it_replaces_is_refused() -> None:
    ocean = {"current_profile": [[0, 0.2, 90]], "current_speed_m_s": 0.1}
    with pytest.raises(ValidationError, match="current_profile replaces current_speed_m_s"):
        Scenario(followers=[{"route": "T5"}], ocean=ocean)


def test_speeds_through_the_water_are_checked_against_the_current_of_the_time() -> None:
    """1 m/s over ground against 1 m/s needs 2 m/s through the water, and only while the current
    runs.
    """
    table = {
        "followers": [{"station": {"behind_m": 10.0, "depth_m": 9.0}}],
        "formation": {"max_speed_m_s": 1.9},
        "leader": {"route": None, "waypoints": [[0, 0, 0], [100, 100, 0], [200, 200, 0]]},
    }
    for times, expected in (
        ((150, 160, 170), "waypoint 3"),
        ((20, 60, 90), "waypoint 2"),
        ((250, 300, 310), ""),
    ):
        profile = [[0, 0, 270], *zip(times, (0, 1.0, 0), (270, 270, 270), strict=True)]
        scenario = Scenario(**table, ocean={"current_profile": profile})
        actual = [line for line in infeasibilities(scenario) if "through the water" in line]
        assert [expected in line and "2 m/s through" in line for line in actual] == [True] * bool(
            expected
        )


def test_a_saved_scenario_loads_to_an_equal_one(tmp_path: Path) -> None:
    table = {
        **MINIMAL,
        "leader": {
            "route": None,
            "waypoints": [[0, 0, 0], [60, 50, 0], [90, 50, 0]],
            "broadcast_attitude": True,
        },
        "ocean": {"current_profile": [[0, 0.1, 30], [50, 0.3, -45]], "waves": {"kind": "regular"}},
        "navigation": {"variant": "tight", "use_attitude": True, "assume": {"current": True}},
        "formation": {"proximity": None},
    }
    scenario = Scenario(**table)
    scenario.save(tmp_path / "saved.toml")
    assert (
        scenario_file.validate(scenario_file.read(tmp_path / "saved.toml"), "saved.toml")
        == scenario
    )
    assert [path.name for path in tmp_path.iterdir()] == ["saved.toml"]


@pytest.mark.parametrize(
    ("formation", "expected"),
    [
        (
            {"min_speed_m_s": 2.0, "max_speed_m_s": 1.5},
            "formation: min_speed_m_s = 2 is more than max_speed_m_s = 1.5",
        ),
        (
            {"inner_min_speed_m_s": 2.1},
            "formation: inner_min_speed_m_s = 2.1 is more than outer_max_speed_m_s = 2",
        ),
        (
            {"min_along_track_speed_m_s": 2.6},
            "formation: min_along_track_speed_m_s = 2.6 is more than max_speed_m_s = 2.5",
        ),
        (
            {"timeout_speed_m_s": 3.0},
            "formation: timeout_speed_m_s = 3 is more than max_speed_m_s = 2.5",
        ),
    ],
)
def test_bounds_in_the_wrong_order_are_refused_by_both_names(
    formation: dict[str, float], expected: str
) -> None:
    with pytest.raises(ScenarioError, match=expected):
        scenario_file.validate({**MINIMAL, "formation": formation}, "mine.toml")


STATION = {"station": {"behind_m": 10.0, "depth_m": 9.0}}
CURRENT = {"ocean": {"current_profile": [[0, 0, 0], [10, 0.2, 0]]}}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, []),
        (CURRENT, ["there is a current; navigator 'laisn-2' assumes still water"]),
        ({**CURRENT, "motion": "kinematic"}, ["without effect on motion = 'kinematic'"]),
        (
            {**CURRENT, "navigation": {"variant": "tight"}},
            ["navigation.assume.current = false assumes still water"],
        ),
        ({**CURRENT, "navigation": {"variant": "tight", "assume": {"current": True}}}, []),
        ({"followers": [STATION]}, ["stations are kept by navigator 'laisn-2'"]),
        ({"followers": [STATION], "navigation": {"variant": "tight"}}, []),
    ],
)
def test_settings_unsupported_by_navigators_are_reported(
    change: dict[str, Any], expected: list[str]
) -> None:
    actual = cautions(Scenario(**{**MINIMAL, **change}))
    assert len(actual) == len(expected)
    assert all(text in line for text, line in zip(expected, actual, strict=True))


def test_older_names_of_keys_are_accepted_with_a_note() -> None:
    table = {"followers": [{"route": "T5"}], "sensors": {"own": [{"sensor": "gyros"}]}}
    with pytest.warns(LaisnWarning, match=r"sensors\.own is now called sensors\.custom"):
        scenario = laisn_sim.load(table)
    assert [sensor.sensor for sensor in scenario.sensors.custom] == ["gyros"]
    assert "own" not in tomllib.loads(scenario.toml())["sensors"]
    with pytest.warns(LaisnWarning, match=r"sensors\.own is now called sensors\.custom"):
        by_older_name = laisn_sim.load(scenario, {"sensors.own.0.sensor": "inclinometer"})
    assert [sensor.sensor for sensor in by_older_name.sensors.custom] == ["inclinometer"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        by_current_name = laisn_sim.load(scenario, {"sensors.custom.0.sensor": "inclinometer"})
    assert by_current_name == by_older_name
