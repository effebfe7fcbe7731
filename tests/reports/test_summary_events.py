"""Events of a flight, by geometry: hulls that touch, stations that are too near, avoidance."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.flight.fly import fly
from laisn.arrays import records
from reports import summary as flight_events
from reports.summary import (
    contact_events,
    giving_way_events,
    largest_sigma,
    uncertainty_events,
)
from sim import feasibility
from sim.scenario.file import validate
from sim.scenario.formation import Formation
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.sensing.proximity import sightings
from sim.tracking import STATION_PLACE
from tests import synthetic
from tests.synthetic import make_flight


def test_vehicles_that_meet_on_their_routes_touch_once() -> None:
    head_on = [
        {"waypoints": [[0, 0, 100], [60, 60, 100]], "depth_m": 12.0},
        {"waypoints": [[0, 60, 100], [60, 0, 100]], "depth_m": 12.0},
    ]
    flight, _ = fly(validate({"name": "s", "duration_s": 40.0, "followers": head_on}, "test"))
    (event,) = contact_events(flight)
    # noses meet when both have swum 30 m, less half a hull each
    assert event.time_s == pytest.approx(30.0 - 0.7, abs=0.5)
    assert event.text == "follower-2 and follower-1 touch"


def test_the_largest_sigma_is_the_larger_half_axis_of_the_ellipse() -> None:
    rotation = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    covariance = rotation @ np.diag([9.0, 4.0]) @ rotation.T
    assert largest_sigma(covariance[None]) == pytest.approx([3.0])


@pytest.mark.parametrize(("separation", "reported"), [(8.4, True), (8.6, False)])
def test_stations_are_near_within_three_sigma_of_both(
    separation: float, reported: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have σ = 2 m, so that 3 √(2² + 2²) = 8.49 m."""
    flight = make_flight(10.0, 2)
    table = {
        "name": "s",
        "followers": [
            {"station": {"behind_m": 20.0, "port_m": p, "depth_m": 12.0}} for p in (0, 9)
        ],
    }
    covariance = np.tile(4.0 * np.eye(4), (100, 1, 1))
    changed = replace(
        flight,
        scenario=validate(table, "test"),
        estimates=tuple(replace(e, covariance=covariance) for e in flight.estimates),
    )
    places = records(STATION_PLACE, flight.trajectory.time.size, 2)
    places.east[:, 1] = separation
    monkeypatch.setattr(flight_events.tracking, "true_stations", lambda *_: places)
    assert [event.time_s for event in uncertainty_events(changed)] == (
        [pytest.approx(0.1)] if reported else []
    )


def test_of_many_stations_those_within_three_sigma_of_any_axis_are_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Eight stations on ways of their own, with ellipses of all shapes and directions: each pair
    from the eigenvalues of its summed covariance.
    """
    count = 8
    flight = make_flight(10.0, count)
    stations = [
        {"station": {"behind_m": 20.0, "port_m": 9.0 * i, "depth_m": 12.0}} for i in range(count)
    ]
    scenario = validate({"name": "s", "followers": stations}, "test")
    rng = np.random.default_rng(4)
    roots = rng.normal(0.0, 0.6, (count, 100, 4, 4))
    covariances = roots @ roots.swapaxes(2, 3)
    estimates = [
        replace(e, covariance=c) for e, c in zip(flight.estimates, covariances, strict=True)
    ]
    places = records(STATION_PLACE, flight.trajectory.time.size, count)
    steps = flight.step_index()
    for coordinate in (places.east, places.north):
        coordinate[:] = rng.uniform(0.0, 60.0, count) + np.cumsum(
            rng.normal(0.0, 0.4, coordinate.shape), 0
        )
    monkeypatch.setattr(flight_events.tracking, "true_stations", lambda *_: places)
    expected = {}
    for i in range(count):
        for j in range(i):
            summed = covariances[i, :, :2, :2] + covariances[j, :, :2, :2]
            axis = np.sqrt(np.linalg.eigvalsh(summed)[:, -1])
            east, north = (
                coordinate[steps, i] - coordinate[steps, j]
                for coordinate in (places.east, places.north)
            )
            near = np.flatnonzero(np.sqrt(east**2 + north**2) < 3.0 * axis)
            if near.size:
                expected[i, j] = flight.trajectory.time[steps[near[0]]]
    assert 3 < len(expected) < count * (count - 1) / 2 - 3
    names = [follower.name for follower in scenario.followers]
    texts = [f"stations of {names[i]} and {names[j]}" for i, j in expected]
    changed = replace(flight, scenario=scenario, estimates=tuple(estimates))
    events = uncertainty_events(changed)
    assert [event.text.split(",")[0] for event in events] == texts
    assert [event.time_s for event in events] == pytest.approx(list(expected.values()))


@pytest.mark.system
def test_stations_nearer_than_three_sigma_are_reported() -> None:
    table = {
        "name": "s",
        "duration_s": 20.0,
        "navigation": {"variant": "tight", "assume": {"start_sigma_m": 3.0}},
        "followers": [
            {"station": {"behind_m": 20.0, "port_m": port, "depth_m": 12.0}}
            for port in (0.0, 5.0, -40.0)
        ],
    }
    flight, _ = fly(validate(table, "test"))
    events = uncertainty_events(flight)
    assert [event.text.split(",")[0] for event in events] == [
        "stations of follower-2 and follower-1"
    ]
    assert "3 sigma" in events[0].text


def test_a_shape_of_a_formation_makes_its_followers() -> None:
    shaped = Scenario(name="s", formation={"shape": {"kind": "v", "count": 6, "depth_m": 12.0}})
    assert [f.name for f in shaped.followers] == [f"follower-{i}" for i in range(1, 7)]
    assert [f.held_depth_m for f in shaped.followers] == [12.0 + i for i in range(6)]
    with pytest.raises(ValueError, match="kind"):
        validate({"name": "s", "formation": {"shape": {"kind": "star", "count": 6}}}, "test")
    beside = {
        "name": "s",
        "formation": {"shape": {"kind": "v", "count": 6}},
        "followers": [{"route": "T5"}],
    }
    with pytest.raises(ValueError, match="there are \\[\\[followers\\]\\] beside it"):
        validate(beside, "test")


def test_a_leader_too_fast_for_followers_is_reported() -> None:
    table = {
        "name": "s",
        "duration_s": 100.0,
        "leader": {"waypoints": [[0, 0, 0], [50, 100, 0], [100, 360, 0]]},
        "followers": [{"station": {"behind_m": 10.0, "depth_m": 10.0}}],
    }
    with pytest.raises(ValueError, match=r"waypoint 3 followers at 10 m would need 5\.2 m/s"):
        validate(table, "test", lambda s: feasibility._leader_too_fast(MotionSettings.of(s)))


def test_avoidance_is_reported_with_first_time_and_duration() -> None:
    """One of two abreast closes up at 0.5 m/s from 10.1 m: within 5 m after 10.2 s, as the look
    at 10.5 s shows.
    """
    flight = make_flight(20.0, 2)
    table = {
        "name": "s",
        "followers": [
            {"station": {"behind_m": 20.0, "port_m": port, "depth_m": 12.0}} for port in (0, 9)
        ],
        "formation": {"proximity": {"range_sigma_m": 0.0}},
    }
    trajectory = flight.trajectory
    position = np.zeros_like(trajectory.position)
    position[:, 0] = 500.0
    position[:, 2, 0] = 10.1 - 0.5 * trajectory.time
    moved = replace(
        flight,
        scenario=validate(table, "test"),
        trajectory=synthetic.moved(trajectory, position=position),
    )
    assert [(event.time_s, event.level, event.text) for event in giving_way_events(moved)] == [
        (pytest.approx(10.5), "info", "follower1 gives way to follower2"),
        (pytest.approx(10.5), "info", "follower2 gives way to follower1"),
    ]
    # looks at 10.5, 11.0 … 20.0 s
    np.testing.assert_allclose(
        sightings(MotionSettings.of(moved.scenario), moved.trajectory).detected_s, 20 * 0.5
    )
    blind = moved.scenario.model_copy(update={"formation": Formation()})
    assert giving_way_events(replace(moved, scenario=blind)) == []
