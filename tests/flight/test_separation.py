"""Hulls that touch, stations that are too near: by geometry."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.flight import separation
from experiments.flight.fly import fly
from experiments.flight.separation import _spread, contact_events, hull_gap, uncertainty_events
from sim import flyable
from sim.geometry import attitude
from sim.scenario.file import validate
from sim.scenario.settings import Scenario
from sim.scenario.shapes import Shape, followers_of
from tests.synthetic import make_flight


@pytest.mark.parametrize(
    ("between", "other", "gap"),
    [
        ((0.0, 0.5, 0.0), (1.0, 0.0, 0.0), 0.5),  # side by side
        ((3.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.3),  # one before the other: 3 less both halves
        ((0.0, 0.4, 0.0), (0.0, 0.0, 1.0), 0.4),  # crossed at right angles
        ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), 0.3),  # a T: 1 less the half of the upright one
        ((2.0, 1.0, 0.0), (1.0, 0.0, 0.0), np.hypot(1.0, 0.3)),  # offset and parallel
    ],
)
def test_the_gap_of_two_hulls_is_that_of_their_axes(
    between: tuple[float, ...], other: tuple[float, ...], gap: float
) -> None:
    one = np.array([1.0, 0.0, 0.0])
    found = hull_gap(np.array(between), one, np.array(other), (1.0, 0.7))
    assert found == pytest.approx(gap, abs=1e-9)


def test_no_two_points_of_hulls_are_nearer_than_their_gap() -> None:
    """By trial of places along both hulls, 1 cm apart: the distance is convex in them."""
    rng, halves = np.random.default_rng(8), (1.0, 0.7)
    places = np.stack(np.meshgrid(np.linspace(-1.0, 1.0, 201), np.linspace(-0.7, 0.7, 141)), axis=-1)
    for _ in range(40):
        one, other = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
        between = rng.normal(0.0, 1.0, 3)
        points = between + places[..., 1:] * other - places[..., :1] * one
        least = np.linalg.norm(points, axis=-1).min()
        assert hull_gap(between, one, other, halves) == pytest.approx(least, abs=0.008)
        assert hull_gap(between, one, other, halves) <= least + 1e-12


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


def test_hulls_touch_where_their_skins_meet() -> None:
    """All head north at 0.1 m of radius: one closes in from astern at 1 m/s, 1 + 0.7 m of hulls; another abeam."""
    flight = make_flight(10.0, 2)
    trajectory, time = flight.trajectory, flight.trajectory.time
    position = np.zeros_like(trajectory.position)
    position[:, 1, 1] = -10.05 + time
    position[:, 2, 0], position[:, 2, 1] = 5.07 - 0.5 * time, 1.65
    quaternion = np.broadcast_to(attitude.from_euler(0.0), trajectory.quaternion.shape).copy()
    events = contact_events(replace(flight, trajectory=replace(trajectory, position=position, quaternion=quaternion)))
    # 10.05 − t < 1.9 m, and 5.07 − t / 2 < 0.2 m
    assert [(event.time_s, event.text) for event in events] == [
        (pytest.approx(8.2), "follower1 and leader touch"), (pytest.approx(9.8), "follower2 and leader touch"),
    ]  # fmt: skip


def test_an_ellipse_is_as_wide_as_its_larger_half_axis() -> None:
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    assert _spread((turn @ np.diag([9.0, 4.0]) @ turn.T)[None]) == pytest.approx([3.0])


@pytest.mark.parametrize(("apart", "near"), [(8.4, True), (8.6, False)])
def test_stations_are_near_within_three_sigma_of_both(
    apart: float, near: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both know their places to 2 m, so that 3 √(2² + 2²) = 8.49 m."""
    flight = make_flight(10.0, 2)
    table = {"name": "s", "followers": [{"station": {"behind_m": 20.0, "port_m": p, "depth_m": 12.0}} for p in (0, 9)]}
    covariance = np.tile(4.0 * np.eye(4), (100, 1, 1))
    known = replace(
        flight, scenario=validate(table, "test"),
        estimates=tuple(replace(e, covariance=covariance) for e in flight.estimates),
    )  # fmt: skip
    places = np.zeros((flight.trajectory.time.size, 2, 4))
    places[:, 1, 0] = apart
    monkeypatch.setattr(separation, "true_stations", lambda *_: places)
    assert [event.time_s for event in uncertainty_events(known)] == ([pytest.approx(0.1)] if near else [])


def test_stations_nearer_than_three_sigma_are_told() -> None:
    table = {
        "name": "s",
        "duration_s": 20.0,
        "navigation": {"variant": "tight", "assume": {"start_sigma_m": 3.0}},
        "followers": [{"station": {"behind_m": 20.0, "port_m": port, "depth_m": 12.0}} for port in (0.0, 5.0, -40.0)],
    }
    flight, _ = fly(validate(table, "test"))
    events = uncertainty_events(flight)
    assert [event.text.split(",")[0] for event in events] == ["stations of follower-2 and follower-1"]
    assert "3 sigma" in events[0].text


@pytest.mark.parametrize("kind", ["line", "v", "column", "grid", "ring"])
@pytest.mark.parametrize("count", [1, 2, 7, 18])
def test_shapes_keep_their_spacing(kind: str, count: int) -> None:
    tables = followers_of(Shape(kind=kind, count=count, spacing_m=8.0, layer_m=0.0))  # type: ignore[arg-type]
    places = np.array([(t["station"]["behind_m"], t["station"]["port_m"]) for t in tables])
    assert len(places) == count
    if count > 1:
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)) + 1e9 * np.eye(count)
        assert apart.min() == pytest.approx(8.0, abs=3.5 if kind == "v" else 1e-5)
    assert places[:, 0].min() == pytest.approx(10.0)


def test_a_shape_stands_for_its_followers() -> None:
    shaped = Scenario(name="s", formation={"shape": {"kind": "v", "count": 6, "depth_m": 12.0}})
    assert [f.name for f in shaped.followers] == [f"follower-{i}" for i in range(1, 7)]
    assert [f.layer_m for f in shaped.followers] == [12.0 + i for i in range(6)]
    with pytest.raises(ValueError, match="kind"):
        validate({"name": "s", "formation": {"shape": {"kind": "star", "count": 6}}}, "test")
    beside = {"name": "s", "formation": {"shape": {"kind": "v", "count": 6}}, "followers": [{"route": "T5"}]}
    with pytest.raises(ValueError, match="there are \\[\\[followers\\]\\] beside it"):
        validate(beside, "test")


def test_a_leader_that_followers_cannot_keep_up_with_is_named() -> None:
    table = {
        "name": "s",
        "duration_s": 100.0,
        "leader": {"waypoints": [[0, 0, 0], [50, 100, 0], [100, 360, 0]]},
        "followers": [{"station": {"behind_m": 10.0, "depth_m": 10.0}}],
    }
    with pytest.raises(ValueError, match=r"waypoint 3 followers at 10 m would need 5\.2 m/s"):
        validate(table, "test", flyable._outrun)
