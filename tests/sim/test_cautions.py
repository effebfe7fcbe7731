"""Cautions before a flight are true: the flight that they warn of has the error that they state."""

import math
import re
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from experiments.flight.fly import fly
from experiments.flight.library import as_scenario, scenario_names
from laisn_sim.cli.main import app
from reports.bound import noise_of
from sim.cautions import RULES, Navigated, clock_error_s, echo_excess_m, max_range_rate
from sim.feasibility import cautions, effect_cautions
from sim.flight import FlightRecord, position_and_bearing_errors
from sim.scenario.parts import MotionSettings, SensingSettings
from sim.scenario.settings import Scenario

NO_ERRORS = {
    "motion": "kinematic",
    "duration_s": 120.0,
    "navigation.variant": "tight",
    "sensors.speed_bias_m_s": 0.0,
    "sensors.speed_sigma_m_s": 0.0,
    "sensors.heading_bias_deg": 0.0,
    "sensors.heading_sigma_deg": 0.0,
    "acoustics.range_scale_mean_m": 0.0,
    "acoustics.range_scale_sigma_m": 0.0,
}
TRANSMITTERS = ("rear", "front", "middle")


def scenario_of(changes: dict[str, Any]) -> Scenario:
    return as_scenario("T7", {**NO_ERRORS, **changes})


def navigated(changes: dict[str, Any]) -> Navigated:
    """The only follower."""
    return Navigated.of(scenario_of(changes), [0])


def fly_with(changes: dict[str, Any]) -> FlightRecord:
    flight, _ = fly(scenario_of(changes))
    return flight


@pytest.fixture(scope="module")
def without_errors() -> FlightRecord:
    """The flight of no cautions, with which others are compared."""
    return fly_with({})


def only_caution(changes: dict[str, Any]) -> str:
    """The caution of a scenario that has exactly one."""
    (line,) = cautions(scenario_of(changes))
    return line


def stated_metres(line: str) -> float:
    """The last number of metres in a caution, before the semicolon."""
    return float(re.findall(r"([\d.]+) m\b", line.split(";")[0])[-1])


def test_a_mission_without_such_errors_has_no_cautions(without_errors: FlightRecord) -> None:
    assert cautions(without_errors.scenario) == []


def test_clocks_that_differ_change_every_range_by_what_is_stated(
    without_errors: FlightRecord,
) -> None:
    changes = {"acoustics.clock_offset_s": 1e-3, "acoustics.clock_drift_ppm": 5.0}
    line = only_caution(changes)
    error = fly_with(changes).measurements[0].ranges - without_errors.measurements[0].ranges
    assert clock_error_s(SensingSettings.of(scenario_of(changes))) == pytest.approx(
        1e-3 + 5e-6 * 120.0
    )
    assert stated_metres(line) == pytest.approx(1500.0 * 1.6e-3)
    assert np.nanmax(np.abs(error)) == pytest.approx(2.4, rel=0.02)
    assert line.endswith("navigation.assume.clock = false assumes equal clocks")
    assert cautions(scenario_of({**changes, "navigation.assume.clock": True})) == []


def test_pings_in_slots_change_ranges_by_what_is_stated(without_errors: FlightRecord) -> None:
    """The middle ping leaves two slots after the rear one."""
    changes = {"acoustics.ping_slot_s": 0.2}
    slot_m = 0.2 * max_range_rate(navigated(changes))
    in_slots = fly_with(changes).measurements[0].ranges
    # the last message with slots ends after the mission
    error = np.abs(in_slots - without_errors.measurements[0].ranges[: len(in_slots)])
    largest_of_middle = float(np.nanmax(error[:, TRANSMITTERS.index("middle")]))
    assert 0.5 * 2.0 * slot_m < largest_of_middle < 1.2 * 2.0 * slot_m
    # the tight navigator of the flights allows for slots, LAISN does not
    assert cautions(scenario_of(changes)) == []
    line = only_caution({**changes, "navigation.variant": "laisn-2"})
    assert stated_metres(line.replace("of a baseline of 2 m", "")) == pytest.approx(
        slot_m, rel=0.05
    )


@pytest.mark.parametrize(
    ("changes", "way"),
    [
        ({"acoustics.sound_speed_profile": [[0.0, 1480.0], [30.0, 1440.0]]}, "long"),
        ({"acoustics.sound_speed_bias_m_s": -20.0}, "short"),
        (
            {
                "acoustics.sound_speed_profile": [[0.0, 1480.0], [30.0, 1440.0]],
                "acoustics.sound_speed_bias_m_s": 30.0,
                "navigation.sound_speed": "straight",
            },
            "long",
        ),
    ],
)
def test_a_wrong_speed_of_sound_changes_ranges_by_what_is_stated(
    without_errors: FlightRecord, changes: dict[str, Any], way: str
) -> None:
    line = only_caution(changes)
    error = fly_with(changes).measurements[0].ranges - without_errors.measurements[0].ranges
    largest = float(np.nanmax(error) if way == "long" else -np.nanmin(error))
    assert stated_metres(line) == pytest.approx(largest, rel=0.05)
    assert f"m too {way};" in line
    # the profile itself, or errors within what is expected of ranges, need no caution
    known = {**changes, "navigation.sound_speed": "straight", "acoustics.sound_speed_bias_m_s": 0.0}
    assert cautions(scenario_of(known)) == []
    small = {"acoustics.sound_speed_bias_m_s": 2.0}
    assert cautions(scenario_of(small)) == []


def position_error(flight: FlightRecord) -> float:
    """Mean over the second half of the mission [m]."""
    errors = position_and_bearing_errors(flight)[0][0]
    return float(errors[errors.size // 2 :].mean())


def test_a_bias_of_the_leaders_compass_turns_fixes_about_the_leader(
    without_errors: FlightRecord,
) -> None:
    changes = {"sensors.leader_heading_bias_deg": 5.0}
    line = only_caution(changes)
    flight = fly_with(changes)
    distance = navigated(changes).distances
    chord_per_metre = 2.0 * math.sin(math.radians(2.5))
    assert stated_metres(line) == pytest.approx(chord_per_metre * distance.max(), rel=0.05)
    expected = chord_per_metre * distance[distance.size // 2 :].mean()
    messages = flight.measurements[0].message
    heading_error = messages[:, 3] - without_errors.measurements[0].message[:, 3]
    assert np.rad2deg(heading_error) == pytest.approx(np.full(len(heading_error), 5.0))
    # the filter ascribes a part of the contradiction to errors of the follower's own sensors
    assert position_error(flight) > 0.8 * expected
    assert position_error(without_errors) < 0.2 * expected
    with_estimated_bias = {**changes, "navigation.assume.exact_leader": False}
    assert cautions(scenario_of(with_estimated_bias)) == []


def test_a_bias_by_leader_sensors_is_stated_as_one_by_sensors() -> None:
    line = only_caution({"sensors.leader_heading_bias_deg": 5.0})
    assert only_caution({"leader.sensors.heading_bias_deg": 5.0}) == line
    overridden = {"sensors.leader_heading_bias_deg": 5.0, "leader.sensors.heading_bias_deg": 0.0}
    assert cautions(scenario_of(overridden)) == []


def test_a_maximum_range_below_the_planned_distances_is_stated() -> None:
    scenario = scenario_of({})
    (follower,) = scenario.followers
    slant_ranges = np.hypot(
        navigated({}).distances, scenario.leader.held_depth_m - follower.held_depth_m
    )
    max_range = float(np.median(slant_ranges))
    line = only_caution({"acoustics.max_range_m": max_range})
    assert line.startswith(f"messages reach {max_range:g} m, and ")
    assert "50% of the planned distances are longer" in line
    assert stated_metres(line) == pytest.approx(slant_ranges.max(), rel=0.01)
    assert cautions(scenario_of({"acoustics.max_range_m": slant_ranges.max() + 0.1})) == []


def test_biases_that_drift_are_stated_where_navigators_assume_constant_ones() -> None:
    changes = {"sensors.speed_drift_m_s": 0.1, "sensors.heading_drift_deg": -4.0}
    line = only_caution(changes)
    assert (
        "the log's bias drifts by up to 0.1 m/s and the compass's bias drifts by up to 4°" in line
    )
    assert line.endswith("navigation.assume.drift = false assumes constant biases")
    assert cautions(scenario_of({**changes, "navigation.assume.drift": True})) == []
    assert cautions(scenario_of({**changes, "navigation.variant": "laisn-2"})) == []


@pytest.mark.system
def test_common_echoes_are_longer_than_the_span_by_what_is_stated(
    without_errors: FlightRecord,
) -> None:
    changes = {
        "acoustics.common_echoes": True,
        "acoustics.surface_echo_probability": 1.0,
        "leader.depth_m": 20.0,
        "followers.0.depth_m": 20.0,
        "navigation.variant": "ekf",
    }
    line = only_caution(changes)
    direct = fly_with({**changes, "acoustics.surface_echo_probability": 0.0})
    delay = fly_with(changes).measurements[0].ranges - direct.measurements[0].ranges
    assert stated_metres(line.replace("beyond the 4.5 m", "")) == pytest.approx(
        echo_excess_m(navigated(changes)), rel=0.05
    )
    assert np.nanmax(delay) == pytest.approx(echo_excess_m(navigated(changes)), rel=0.05)
    assert np.nanmin(delay) > 4.5
    assert line.endswith("beyond the 4.5 m; navigator 'ekf' assumes echoes within that span")
    assert cautions(scenario_of({**changes, "navigation.assume.outlier_span_m": 40.0})) == []
    assert cautions(scenario_of({**changes, "acoustics.common_echoes": False})) == []


def test_followers_drift_with_the_position_that_the_leader_broadcasts(
    without_errors: FlightRecord,
) -> None:
    changes = {"sensors.leader_position_drift_m_s": 0.05}
    line = only_caution(changes)
    assert stated_metres(line) == pytest.approx(6.0)
    final_error = position_and_bearing_errors(fly_with(changes))[0][0][-1]
    assert final_error == pytest.approx(6.0, rel=0.15)


def test_random_errors_of_the_broadcast_position_are_stated_where_not_assumed() -> None:
    """A random walk grows with the root of time; assuming white errors does not cover a walk."""
    sigma_key, walk_key = "leader_position_sigma_m", "leader_position_walk_m_sqrt_s"
    line = only_caution({f"sensors.{sigma_key}": 0.5})
    assert stated_metres(line) == pytest.approx(0.5)
    assert f"navigation.assume.{sigma_key} = 0 assumes an exact position" in line
    line = only_caution({f"sensors.{walk_key}": 0.1, f"navigation.assume.{sigma_key}": 0.5})
    assert stated_metres(line) == pytest.approx(0.1 * math.sqrt(120.0), rel=0.01)
    for key in (sigma_key, walk_key):
        changes = {f"sensors.{key}": 0.5, f"navigation.assume.{key}": 0.5}
        assert cautions(scenario_of(changes)) == []
        assert cautions(scenario_of({f"sensors.{key}": 0.005})) == []


def test_a_current_adds_a_drift_that_logs_and_compasses_do_not_measure() -> None:
    changes = {
        "motion": "physics",
        "duration_s": 20.0,
        "ocean.current_speed_m_s": 0.3,
        "ocean.current_direction_deg": 90.0,
    }
    assert only_caution(changes).startswith("there is a current; ")
    truth = fly_with(changes).trajectory
    heading = truth.heading[:, 1]
    through_water = truth.forward_speed[:, 1] * np.sin(heading)
    drift = np.mean(truth.velocity[:, 1, 0] - through_water)
    assert drift == pytest.approx(0.3, abs=0.05)
    # points are not carried along
    of_points = cautions(scenario_of({**changes, "motion": "kinematic"}))
    assert of_points == ["without effect on motion = 'kinematic': ocean.current_speed_m_s"]
    assert not SensingSettings.of(scenario_of({**changes, "motion": "kinematic"})).has_current


ABEAM_M = 50.0
"""Least distance of a beacon, or of a follower that sends, from the one that navigates."""
BEACON_LINK = {"name": "lbl", "beacons_m": [[0.0, -ABEAM_M, 10.0]]}
ESCORT_LINK = {"name": "escort", "sender": "escort"}


def on_link(link: dict[str, Any], **changes: Any) -> Scenario:
    """A follower that swims 120 m east, an escort at its side, and a link on which both navigate,
    all at one depth.
    """
    variant = "beacons" if "beacons_m" in link else "tight"
    followers: list[dict[str, Any]] = [
        {"name": name, "waypoints": [[0, 0, north], [120, 120, north]], "depth_m": 10.0}
        for name, north in (("follower", 0.0), ("escort", ABEAM_M))
    ]
    table = {
        "duration_s": 120.0,
        "motion": "kinematic",
        "links": [link],
        "navigation": {"link": link["name"], "variant": variant},
        "followers": followers,
    }
    return as_scenario(table, changes)


def test_cautions_among_beacons_are_of_beacons() -> None:
    """They have no compass and are where they are said to be, at distances of their own; their
    navigator has a state for the current.
    """
    of_leader = {
        "sensors.leader_heading_bias_deg": 5.0,
        "sensors.leader_position_sigma_m": 1.0,
        "sensors.leader_position_walk_m_sqrt_s": 1.0,
        "sensors.leader_position_drift_m_s": 1.0,
    }
    assert cautions(on_link(BEACON_LINK, **of_leader)) == []
    in_current = {"motion": "physics", "ocean.current_speed_m_s": 0.1}
    assert cautions(on_link(BEACON_LINK, **in_current)) == []
    still = on_link(BEACON_LINK, **in_current, **{"navigation.beacons.current_sigma_m_s": 0.0})
    assert cautions(still) == ["there is a current; navigator 'beacons' assumes still water"]
    # of the follower √(50² + x²), of the escort √(100² + x²), x even in 0 … 120 m: half of the
    # former are above 78.1 m, and all of the latter
    reach = math.hypot(60.0, ABEAM_M)
    (line,) = cautions(on_link(BEACON_LINK, **{"acoustics.max_range_m": reach}))
    assert "75% of the planned distances are longer" in line
    assert stated_metres(line) == pytest.approx(math.hypot(120.0, 2.0 * ABEAM_M), rel=0.01)


def test_cautions_on_the_link_of_a_follower_are_of_that_follower() -> None:
    """Its compass is off by what its own table says; its clock is that of other followers."""
    changes = {
        "acoustics.clock_offset_s": 1e-3,
        "sensors.leader_heading_bias_deg": 9.0,
        "followers.1.sensors.heading_bias_deg": 5.0,
    }
    (line,) = cautions(on_link(ESCORT_LINK, **changes))
    assert line.startswith("the compass of escort is off by 5°, which turns fixes about escort")
    assert stated_metres(line) == pytest.approx(
        2.0 * math.sin(math.radians(2.5)) * ABEAM_M, rel=0.05
    )
    # of the leader's messages
    by_leader = cautions(on_link(ESCORT_LINK, **changes, **{"navigation.link": "leader"}))
    assert [line.split(",")[0] for line in by_leader] == [
        "without effect: links[0] ('escort')",
        "the clocks differ by up to 1 ms",
        "the leader's compass is off by 9°",
    ]


def test_a_follower_that_does_not_receive_what_it_navigates_on_is_named() -> None:
    """Who sends does not either, as it must be."""
    assert cautions(on_link(ESCORT_LINK)) == []
    (line,) = cautions(on_link({**BEACON_LINK, "receivers": ["escort"]}))
    assert line == (
        "follower does not receive 'lbl', on which it navigates: its receivers are escort"
    )
    scenario = on_link({**BEACON_LINK, "receivers": ["escort"]})
    heard = [len(measured.message) for measured in fly(scenario)[0].measurements]
    assert heard[0] == 0
    assert heard[1] > 0


def test_a_link_on_which_nobody_navigates_is_named_unless_somebody_is_steered() -> None:
    unused = on_link(BEACON_LINK, **{"navigation.link": "leader", "navigation.variant": "tight"})
    assert cautions(unused) == ["without effect: links[0] ('lbl'), on which nobody navigates"]
    assert fly(unused)[0].measurements[0].links == {}
    by_estimate = {"motion": "physics", "followers.0.guidance_position": "estimate"}
    steered = as_scenario(unused, by_estimate)
    assert cautions(steered) == []
    own = {"followers.1.navigation": {"link": "lbl", "variant": "beacons"}}
    assert cautions(as_scenario(unused, own)) == []


def test_errors_are_those_of_the_followers_that_navigate_so() -> None:
    """A drift of one follower's own log is no matter of the other, whose navigator is told of
    it.
    """
    told = {"assume": {"drift": True}}
    changes = {"followers.1.sensors.speed_drift_m_s": 0.1}
    (line,) = cautions(on_link(ESCORT_LINK, **changes))
    assert line.startswith("the log's bias drifts by up to 0.1 m/s")
    assert cautions(on_link(ESCORT_LINK, **changes, **{"followers.1.navigation": told})) == []
    other = cautions(on_link(ESCORT_LINK, **changes, **{"followers.0.navigation": told}))
    assert other == [line]


def test_an_estimate_that_is_broadcast_has_no_errors_of_a_true_position() -> None:
    estimating = {
        "motion": "physics",
        "leader.hydrophone_m": [0.0, 0.0, 0.1],
        "leader.navigation": {"variant": "beacons", "link": "lbl"},
        "links": [{**BEACON_LINK, "receivers": ["leader"]}],
        "sensors.leader_position_sigma_m": 1.0,
    }
    line = only_caution(estimating)
    assert stated_metres(line) == pytest.approx(1.0)
    assert cautions(scenario_of({**estimating, "leader.broadcast_position": "estimate"})) == []


def test_pings_at_the_end_of_a_message_change_ranges_by_what_is_stated(
    without_errors: FlightRecord,
) -> None:
    changes = {"acoustics.message_length_s": 2.0, "acoustics.ranging_pulse": "end"}
    line = only_caution(changes)
    late = fly_with(changes).measurements[0].ranges
    error = np.abs(late - without_errors.measurements[0].ranges[: len(late)])
    assert 0.5 * stated_metres(line) < np.nanmax(error) < 1.2 * stated_metres(line)
    assert cautions(scenario_of({**changes, "acoustics.ranging_pulse": "start"})) == []


@pytest.mark.parametrize("length", [2.0, 8.0])
def test_messages_that_take_long_put_laisn_back_by_what_is_stated(length: float) -> None:
    """Of exact readings the estimate is as old as the ranges are when their message is in."""
    changes = {"acoustics.message_length_s": length, "timing.message_interval_s": 10.0}
    line = only_caution({**changes, "navigation.variant": "laisn-3-2"})
    assert line.endswith("navigator 'laisn-3-2' assumes ranges of where they are")
    flight = fly_with({**changes, "navigation.variant": "laisn-3-2"})
    (error, _), *_ = position_and_bearing_errors(flight)
    at_message = error[flight.measurements[0].message_step - 1]
    assert at_message.max() == pytest.approx(stated_metres(line), rel=0.15)


def test_messages_that_take_long_are_allowed_for_in_turns_too() -> None:
    """Straight on at 1 m/s, and by a right angle, after which it would be 6.4 m elsewhere had it
    gone straight on.
    """
    straight = {
        "acoustics.message_length_s": 8.0,
        "leader.waypoints": [[0.0, 0.0, 20.0], [120.0, 120.0, 20.0]],
        "followers": [{"waypoints": [[0.0, 0.0, 0.0], [120.0, 120.0, 0.0]], "depth_m": 8.0}],
    }
    corner = [[0.0, 0.0, 0.0], [60.0, 60.0, 0.0], [120.0, 60.0, 60.0]]
    turning = {**straight, "followers": [{"waypoints": corner, "depth_m": 8.0}]}
    for changes in (straight, turning):
        assert cautions(scenario_of(changes)) == []
        error, _ = position_and_bearing_errors(fly_with(changes))[0]
        assert error.mean() < 0.1


def test_keys_of_bodies_without_effect_on_points_are_named() -> None:
    changes = {
        "ocean.waves.kind": "regular",
        "leader.excess_buoyancy_n": 5.0,
        "followers.0.drag_scale": 1.5,
        "followers.0.depth_m": 12.0,
    }
    of_bodies = MotionSettings.of(scenario_of({**changes, "motion": "physics"}))
    assert effect_cautions(of_bodies) == []
    assert effect_cautions(MotionSettings.of(scenario_of(changes))) == [
        "without effect on motion = 'kinematic': ocean.waves, leader.excess_buoyancy_n, "
        "followers[0].drag_scale"
    ]


def test_every_key_of_a_rule_exists_and_the_command_prints_cautions_first() -> None:
    table = Scenario(followers=[{"route": "T5"}]).model_dump()
    for rule in RULES:
        for key in rule.keys:
            section, name = key.split(".")
            assert name in table[section]
        if rule.assumption:
            section, name = rule.assumption.split(".")
            assert name in table["navigation"][section]
    arguments = ["check", "T5", "--set", "acoustics.clock_offset_s=0.001"]
    result = CliRunner().invoke(app, arguments)
    assert result.output.startswith("warning: the clocks differ by up to 1 ms")
    arguments_without_caution = ["check", "T5", "--set", "acoustics.clock_offset_s=1e-5"]
    assert "warning" not in CliRunner().invoke(app, arguments_without_caution).output


IDLE_KEYS: dict[str, dict[str, Any]] = {
    "ocean.waves.kind = 'none'": {"ocean.waves.height_m": 2.0, "ocean.waves.components": 50},
    "ocean.waves.kind = 'regular'": {
        "ocean.waves.spreading_deg": 20.0,
        "ocean.waves.kind": "regular",
    },
    "acoustics.source_level_db = 0": {
        "acoustics.frequency_khz": 12.0,
        "acoustics.wind_m_s": 12.0,
    },
    "acoustics.burst_probability = 0": {"acoustics.burst_mean_messages": 9.0},
    "acoustics.message_length_s = 0": {"acoustics.ranging_pulse": "end"},
    "leader.saw_tooth_amplitude_m = 0": {"leader.saw_tooth_period_s": 60.0},
    "followers[0].saw_tooth_amplitude_m = 0": {"followers.0.saw_tooth_period_s": 60.0},
    "sensors.speed_drift_m_s = 0": {"sensors.speed_drift_phase_deg": 90.0},
    "sensors.leader_gyro_time_constant_s = 0": {"sensors.leader_gyro_random_walk_deg_sqrt_h": 1.0},
    "formation.law = 'constant-bearing'": {"formation.integral_m_s": 0.5},
}
"""Keys without effect, by what keeps them from having one."""


@pytest.mark.parametrize("reason", IDLE_KEYS)
def test_keys_that_another_key_turns_off_change_nothing_and_are_named(reason: str) -> None:
    """A flight with them measures to the bit what it measures without them."""
    changes = IDLE_KEYS[reason]
    switch, _, value = reason.partition(" = ")
    on_kind = {key: text for key, text in changes.items() if key == switch}
    set_keys = [key.replace("followers.0", "followers[0]") for key in changes if key not in on_kind]
    motion = {"motion": "physics", "duration_s": 5.0}
    assert cautions(scenario_of({**motion, **changes})) == [
        f"without effect: {', '.join(set_keys)}, as {switch} = {value}"
    ]
    assert cautions(scenario_of({**motion, **on_kind})) == []
    with_keys, without_keys = (fly_with({**motion, **keys}) for keys in (changes, on_kind))
    for name in ("speed", "heading", "depth", "ranges"):
        np.testing.assert_array_equal(
            getattr(with_keys.measurements[0], name), getattr(without_keys.measurements[0], name)
        )


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (
            {
                "navigation.variant": "laisn-2",
                "navigation.assume.known_start": False,
                "navigation.rival.particles": 100,
            },
            "navigation.assume.known_start, navigation.rival.particles, as "
            "navigation.variant = 'laisn-2'",
        ),
        (
            {"navigation.variant": "tight", "navigation.sigma_speed_m_s": 0.3},
            "navigation.sigma_speed_m_s, as navigation.variant = 'tight'",
        ),
        ({"navigation.variant": "tight", "navigation.assume.clock": True}, ""),
        # the bound takes what is known of biases
        ({"navigation.variant": "laisn-2", "navigation.assume.speed_bias_sigma_m_s": 0.1}, ""),
        ({"navigation.variant": "laisn-2", "navigation.sigma_speed_m_s": 0.3}, ""),
        (
            {"followers.0.navigation.variant": "tight", "followers.0.navigation.gate": "off"},
            "followers[0].navigation.gate, as followers[0].navigation.variant = 'tight'",
        ),
    ],
)
def test_settings_of_another_navigator_change_nothing_and_are_named(
    changes: dict[str, Any], expected: str
) -> None:
    motion = {"motion": "physics", "duration_s": 5.0}
    lines = cautions(scenario_of({**motion, **changes}))
    unread = [line for line in lines if line.startswith("without effect")]
    assert unread == ([f"without effect: {expected}"] if expected else [])
    if unread:
        variants = {key: value for key, value in changes.items() if key.endswith("variant")}
        with_keys, without_keys = (fly_with({**motion, **keys}) for keys in (changes, variants))
        for name in ("state", "covariance"):
            np.testing.assert_array_equal(
                getattr(with_keys.estimates[0], name), getattr(without_keys.estimates[0], name)
            )


def test_rays_that_are_asked_to_bend_where_nothing_bends_them_are_named() -> None:
    refracted = {"acoustics.rays": "refracted"}
    line = "without effect: acoustics.rays = 'refracted', as the speed of sound is the same at all"
    (caution,) = cautions(scenario_of(refracted))
    assert caution == f"{line} depths"
    level = {**refracted, "acoustics.sound_speed_profile": [[0.0, 1500.0], [30.0, 1500.0]]}
    assert cautions(scenario_of(level)) == [caution]
    bent = {**refracted, "acoustics.sound_speed_profile": [[0.0, 1500.0], [30.0, 1499.0]]}
    assert cautions(scenario_of(bent)) == []


def test_no_built_in_scenario_has_keys_without_effect() -> None:
    for name in scenario_names():
        lines = cautions(as_scenario(name))
        assert not [line for line in lines if line.startswith("without effect")], name


def test_settings_by_which_the_bound_changes_count_as_read() -> None:
    """Of LAISN, which reads none of the table: every key is changed, in a mission with a current
    and an error of the leader's compass.
    """
    scenario = as_scenario(
        "T7",
        {
            "navigation.variant": "laisn-2",
            "ocean.current_speed_m_s": 0.2,
            "sensors.leader_heading_bias_deg": 2.0,
        },
    )
    navigation = scenario.navigation
    sensing = SensingSettings.of(scenario)
    plain = noise_of(sensing, navigation)
    changing = set()
    for key in type(navigation.assume).model_fields:
        value = getattr(navigation.assume, key)
        other = not value if isinstance(value, bool) else 2.0 * (value or 1.0)
        assume = navigation.assume.model_copy(update={key: other})
        if noise_of(sensing, navigation.model_copy(update={"assume": assume})) != plain:
            changing.add(key)
    read = {
        key for key in type(navigation.assume).model_fields if navigation.reads(f"assume.{key}")
    }
    assert changing == read
    assert "speed_bias_sigma_m_s" in read
