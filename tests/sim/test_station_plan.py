"""Stations on the leader's plan, by closed forms: where the frame of the formation does not turn, a
station's path is the leader's, shifted.
"""

from typing import Any

import numpy as np
import pytest

from sim import feasibility
from sim.closed_loop import simulate_closed_loop
from sim.scenario.file import validate
from sim.scenario.parts import MissionPlan, MotionSettings
from sim.scenario.settings import Scenario
from sim.tracking import closest_in_a_layer, closest_stations

RIGHT_ANGLE_TO_PORT = {"waypoints": [[0, 0, 0], [60, 60, 0], [200, 60, 140]]}
STRAIGHT = {"waypoints": [[0, 0, 0], [200, 200, 0]]}
FRAME_WITHOUT_TURN = {"frame_time_constant_s": 1e6}


def mission(
    *stations: tuple[float, float, float], leader: object = RIGHT_ANGLE_TO_PORT, **formation: Any
) -> Scenario:
    """Followers on stations by their distances behind and to port, and depths [m]."""
    followers = [
        {"station": {"behind_m": behind, "port_m": port, "depth_m": depth}}
        for behind, port, depth in stations
    ]
    table = {
        "name": "s",
        "duration_s": 150.0,
        "leader": leader,
        "followers": followers,
        "formation": formation,
    }
    return validate(table, "test")


@pytest.mark.parametrize(
    ("other_station", "distance"),
    [
        # Δy = Δs: they meet after the turn to port
        ((20.0, 15.0), 0.0),
        ((20.0, 25.0), 10.0),
        ((18.0, 15.0), 2.0),
        ((20.0, -5.0), np.hypot(10.0, 10.0)),  # nearest before the turn
    ],
)
def test_after_a_right_angle_stations_are_apart_by_the_difference_of_port_and_behind(
    other_station: tuple[float, float], distance: float
) -> None:
    """The first is 10 m behind and 5 m to port. On the second leg both move along one line, and are
    Δy − Δs apart, by the differences of their distances to port and behind.
    """
    actual = closest_stations(
        MotionSettings.of(mission((10.0, 5.0, 12.0), (*other_station, 12.0), **FRAME_WITHOUT_TURN))
    )
    assert actual is not None
    assert actual.distance_m == pytest.approx(distance, abs=0.02)
    assert actual.pair == ("followers[0].station", "followers[1].station")
    if distance < 5.0:
        # after the second one has passed the corner
        assert 60.0 + 15.0 < actual.time_s < 60.0 + 30.0


def test_on_a_straight_leg_stations_keep_their_distance() -> None:
    actual = closest_stations(
        MotionSettings.of(
            mission((10.0, 5.0, 12.0), (20.0, 15.0, 12.5), (12.0, 5.0, 13.5), leader=STRAIGHT)
        )
    )
    assert actual is not None
    assert actual.distance_m == pytest.approx(np.hypot(10.0, 10.0), abs=1e-6)


def test_stations_in_different_layers_have_no_closest_pair() -> None:
    assert (
        closest_stations(MotionSettings.of(mission((10.0, 5.0, 12.0), (20.0, 15.0, 13.0)))) is None
    )


def test_the_leader_is_in_a_layer_too() -> None:
    """At 8 m, by default. Its distance to a station 10 m behind along its path is least round the
    corner.

    These 10 m are then a quarter of a circle, turned at 10°/s at 1 m/s, and equal straight lengths
    before and after it.
    """
    radius = 1.0 / np.deg2rad(10.0)
    distance = np.sqrt(2.0) * (radius + 0.5 * (10.0 - 0.5 * np.pi * radius))
    actual = closest_stations(MotionSettings.of(mission((10.0, 0.0, 8.5))))
    assert actual is not None
    assert actual.pair == ("the leader's place", "followers[0].station")
    assert actual.distance_m == pytest.approx(distance, abs=0.1)


@pytest.mark.parametrize("count", [2, 5, 12])
def test_wings_of_a_v_do_not_meet_in_a_right_angle(count: int) -> None:
    """Neighbours in a wing are 10 m apart, twice as far aside as behind, and thus
    10 (2 − 1) / √5 m apart on the second leg.
    """
    shape = {"kind": "v", "count": count, "layer_m": 0.0}
    formation = {"shape": shape, **FRAME_WITHOUT_TURN}
    actual = closest_stations(
        MotionSettings.of(
            validate(
                {
                    "name": "s",
                    "duration_s": 180.0,
                    "leader": RIGHT_ANGLE_TO_PORT,
                    "formation": formation,
                },
                "t",
            )
        )
    )
    assert actual is not None
    assert actual.distance_m == pytest.approx(
        10.0 / np.sqrt(5.0) if count > 2 else 2 * 10 * 2 / np.sqrt(5.0), abs=0.02
    )


def scenario_of(table: dict[str, Any]) -> Scenario:
    return validate(
        {"name": "s", "duration_s": 150.0, "leader": RIGHT_ANGLE_TO_PORT, **table},
        "test",
        feasibility.infeasibilities,
    )


GRID = {"kind": "grid", "count": 12, "layer_m": 0.0}


def test_stations_that_meet_in_the_turn_are_refused_unless_followers_give_way() -> None:
    with pytest.raises(
        ValueError, match=r"followers\[\d+\].station and followers\[\d+\].station, in one layer"
    ):
        scenario_of({"formation": {"shape": GRID}})
    scenario_of({"formation": {"shape": GRID, "proximity": {"range_m": 6.0}}})
    scenario_of({"formation": {"shape": GRID | {"layer_m": 1.0, "layers": 4}}})
    scenario_of({"formation": {"shape": GRID}, "leader": STRAIGHT})


@pytest.mark.parametrize("ocean", [{}, {"current_speed_m_s": 0.5, "current_direction_deg": 180.0}])
def test_followers_that_sense_each_other_stay_two_metres_apart_where_stations_meet(
    ocean: dict[str, float],
) -> None:
    """With a range of the sensor little above the braking distance; the stations themselves pass
    each other within a metre.
    """
    with_current = scenario_of(
        {"formation": {"shape": GRID, "proximity": {"range_m": 6.0}}, "ocean": ocean}
    )
    scenario = with_current.model_copy(update={"duration_s": 110.0})
    closest_planned, (trajectory, _) = (
        closest_stations(MotionSettings.of(scenario)),
        simulate_closed_loop(scenario),
    )
    closest_flown = closest_in_a_layer(MissionPlan.of(scenario), trajectory)
    assert closest_planned is not None
    assert closest_flown is not None
    assert closest_planned.distance_m < 1.0
    assert 2.0 < closest_flown.distance_m < 6.0


def test_layers_are_taken_in_turn() -> None:
    scenario = scenario_of(
        {"formation": {"shape": GRID | {"layer_m": 1.5, "layers": 4, "depth_m": 9.0}}}
    )
    assert [f.held_depth_m for f in scenario.followers] == [9.0, 10.5, 12.0, 13.5] * 3


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"formation": {"proximity": {"full_avoidance_range_m": 5.0}}},
            r"full_avoidance_range_m = 5 is not less than formation.proximity.range_m = 5",
        ),
        (
            {"formation": {"proximity": {"period_s": 0.25}}},
            r"period_s = 0.25 is no multiple of 0.1",
        ),
        (
            {"formation": {"proximity": {"range_m": 12.0}}},
            r"are 10 m apart in one layer, within formation.prox",
        ),
        (
            {
                "followers": [
                    {"station": {"behind_m": 10.0, "depth_m": 9.5}},
                    {"station": {"behind_m": 30.0, "depth_m": 9.0}, "start_m": [-12.0, 0.0]},
                ]
            },
            r"followers\[0\] and followers\[1\] start 2 m apart in layers 0.5 m apart",
        ),
        (
            {"contact": "end", "followers": [{"route": "T5"}] * 2},
            r"followers\[0\] and followers\[1\] start 0 m apart",
        ),
    ],
)
def test_impossible_settings_of_formations_are_reported_before_the_simulation(
    table: dict[str, Any], message: str
) -> None:
    followers = [{"station": {"behind_m": behind, "depth_m": 10.0}} for behind in (20.0, 30.0)]
    with pytest.raises(ValueError, match=message):
        scenario_of({"followers": followers} | table)
