"""Speeds at which vehicles start, and vehicles that hover, by scenarios as users write them."""

from typing import Any

import numpy as np
import pytest

import laisn_sim
from sim.assembly import routes_of
from sim.flight import Termination
from sim.scenario.file import ScenarioError
from sim.scenario.parts import MissionPlan
from sim.scenario.routes import Route
from sim.tracking import cross_track

WAYPOINTS_AT_HALF_M_S = [[0, 0, 0], [60, 30, 0], [120, 30, 30]]


def start_speeds(table: dict[str, Any]) -> list[float]:
    """Start speeds of the leader and its followers [m/s]."""
    return [route.start_speed for route in routes_of(MissionPlan.of(laisn_sim.load(table)))]


def test_missions_share_the_route_of_a_station_only_if_all_that_it_follows_from_is_alike() -> None:
    table: dict[str, Any] = {
        "duration_s": 90.0,
        "followers": [{"name": "a", "station": {"behind_m": 10.0, "port_m": 4.0, "depth_m": 12.0}}],
    }

    def route_with(duration_s: float = 90.0, leader: str = "L", **keys: Any) -> Route:
        follower = table["followers"][0] | keys
        changed = {"duration_s": duration_s, "leader": {"route": leader}, "followers": [follower]}
        return routes_of(MissionPlan.of(laisn_sim.load(changed)))[1]

    changes: list[dict[str, Any]] = [
        {},
        {"name": "b"},
        {"duration_s": 91.0},
        {"leader": "T5"},
        {"start_m": [3.0, 5.0]},
        {"start_speed_m_s": 0.7},
        *(
            {"station": {"behind_m": 10.0, "port_m": 4.0, "depth_m": 12.0} | change}
            for change in ({"behind_m": 11.0}, {"port_m": 5.0}, {"depth_m": 13.0})
        ),
    ]
    routes = [route_with(**change) for change in changes]
    assert len(set(routes)) == len(changes)
    assert [route_with(**change) for change in changes] == routes
    assert [route.name for route in routes[:2]] == ["a", "b"]
    numbers = [
        (*route.time.tolist(), *route.waypoint.ravel().tolist(), *route.depth.depth.tolist())
        for route in routes[1:]
    ]
    assert len(set(numbers)) == len(numbers)


def test_a_vehicle_starts_at_the_mean_speed_of_its_first_leg() -> None:
    table: dict[str, Any] = {"followers": [{"waypoints": [[0, 0, 0], [50, 30, 40], [100, 60, 80]]}]}
    # the paper's routes begin at 1 m/s
    assert start_speeds(table) == [1.0, 1.0]
    table["followers"][0]["waypoints"] = WAYPOINTS_AT_HALF_M_S
    assert start_speeds(table) == [1.0, 0.5]
    station = {"station": {"behind_m": 10.0, "depth_m": 12.0}}
    assert start_speeds(
        {"leader": {"waypoints": WAYPOINTS_AT_HALF_M_S}, "followers": [station]}
    ) == [0.5, 0.5]
    table["followers"][0]["start_speed_m_s"] = 0.2
    assert start_speeds(table) == [1.0, 0.2]
    flight = laisn_sim.fly(table | {"duration_s": 20.0})
    assert np.hypot(*flight.trajectory.twist[0, 1, :2]) == pytest.approx(0.2)
    # 0.2 m/s² from 0.2 to just above 0.5 m/s, which makes up for the slow start
    assert np.hypot(*flight.trajectory.twist[150, 1, :2]) == pytest.approx(0.5, abs=0.03)


def test_a_route_that_begins_with_a_stop_starts_at_rest() -> None:
    follower = {"waypoints": [[0, 0, 0], [10, 0, 0], [70, 30, 0]]}
    assert start_speeds({"followers": [follower]}) == [1.0, 0.0]
    with pytest.raises(ScenarioError, match=r"begins with a stop, which start_speed_m_s = 0.5"):
        laisn_sim.load({"followers": [follower | {"start_speed_m_s": 0.5}]})


@pytest.mark.parametrize("role", ["leader", "follower", "follower that stops first"])
def test_a_slow_vehicle_flies_missions_at_the_speeds_that_it_reaches(role: str) -> None:
    waypoints = [[0, 0, 0], [20, 0, 0], [80, 30, 0], [140, 30, 30]]
    slow_vehicle = {
        "model": "bluerov2_heavy",
        "waypoints": waypoints if role == "follower that stops first" else WAYPOINTS_AT_HALF_M_S,
    }
    table: dict[str, Any] = {"duration_s": 140.0, "followers": [slow_vehicle]}
    if role == "leader":
        table = {"duration_s": 140.0, "leader": slow_vehicle, "followers": [{"route": "T5"}]}
    flight = laisn_sim.fly(table)
    i = 0 if role == "leader" else 1
    assert flight.outcome is Termination.COMPLETED
    route = routes_of(MissionPlan.of(flight.scenario))[i]
    on_route = flight.trajectory.time <= route.time[-1]
    position = flight.trajectory.position[:, i, :2]
    cross_track_error = cross_track(route, flight.trajectory.time[on_route], position[on_route])
    # the corner is cut by R (1 / cos 45° - 1) with R = v / 10°/s = 2.9 m, measured from the legs
    assert cross_track_error.max() < 1.0
    assert np.hypot(*(position[1200] - position[1100])) == pytest.approx(5.0, abs=0.3)


@pytest.mark.parametrize("model", [None, "bluerov2_heavy"])
def test_a_vehicle_with_thrusters_hovers(model: str | None) -> None:
    follower = {"waypoints": [[0, 5, -8], [100, 5, -8]]} | ({"model": model} if model else {})
    current = {"current_speed_m_s": 0.2, "current_direction_deg": 60.0}
    flight = laisn_sim.fly({"duration_s": 100.0, "ocean": current, "followers": [follower]})
    position_error = flight.trajectory.position[:, 1] - (5.0, -8.0, -10.0)
    # half a metre is how far the current sets the vehicle off until its controller has learned it;
    # HOLD_SPEED bounds the speed of the return
    assert np.abs(position_error[500:]).max() < 0.5


@pytest.mark.parametrize("model", ["remus100", "lauv"])
def test_a_hull_that_cannot_hover_is_refused_with_advice_that_works(model: str) -> None:
    follower = {"waypoints": [[0, 5, -8], [100, 5, -8]], "model": model}
    with pytest.raises(ScenarioError, match=r"cannot hover: its fins need 0.5 m/s.*without stops"):
        laisn_sim.load({"followers": [follower]})
    follower["waypoints"] = [[0, 5, -8], [100, 75, -8]]
    flight = laisn_sim.fly({"duration_s": 60.0, "followers": [follower]})
    assert flight.outcome is Termination.COMPLETED
