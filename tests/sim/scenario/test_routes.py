"""Routes: what they hold, and what they refuse."""

import json
from importlib import resources

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.scenario import routes
from sim.scenario.point_motion import CLASSES, plan, random_route, random_waypoints
from sim.scenario.routes import DepthProfile, Route
from tests.effort import examples

MISSION = np.arange(0.0, 1000.05, 0.1)
"""Instants of the paper's mission [s]."""
FOLLOWER_ROUTES = routes.names()[:-1]
"""All but the last, which is the leader's."""


def test_the_leader_draws_an_l_of_a_kilometre_in_a_thousand_seconds():
    leader = routes.library_route("L")
    assert leader.waypoint.tolist() == [[0, 0], [500, 0], [500, 500]]
    assert leader.time.tolist() == [0, 500, 1000]
    assert leader.leg_length.sum() == 1000


@pytest.mark.parametrize("name", FOLLOWER_ROUTES)
def test_followers_start_heading_east_at_one_metre_per_second(name):
    motion = plan(routes.library_route(name)).at(np.zeros(1))
    assert motion.course[0] == pytest.approx(np.pi / 2)
    assert motion.speed[0] == pytest.approx(1.0)


@pytest.mark.parametrize("name", FOLLOWER_ROUTES)
def test_the_figures_beside_the_waypoints_are_those_of_the_point_motion(name):
    text = (resources.files("sim.scenario") / "data" / "followers_T2_T9.json").read_text(
        encoding="utf-8"
    )
    stored = json.loads(text)[name]
    follower, leader = (
        plan(routes.library_route(name)).at(MISSION),
        plan(routes.library_route("L")).at(MISSION),
    )
    east, north = follower.east - leader.east, follower.north - leader.north
    distance, bearing = np.hypot(east, north), np.arctan2(east, north) - leader.course
    assert stored["mean_distance_m"] == pytest.approx(distance.mean(), abs=1e-3)
    assert stored["max_distance_m"] == pytest.approx(distance.max(), abs=1e-3)
    assert stored["min_distance_m"] == pytest.approx(distance.min(), abs=1e-3)
    assert stored["mean_abs_sin_bearing"] == pytest.approx(np.abs(np.sin(bearing)).mean(), abs=1e-3)
    assert stored["max_speed_m_s"] == pytest.approx(follower.speed.max(), abs=1e-3)


def test_t8_has_one_burst_close_to_the_leader():
    # paper, Section 4.1: about 1 m/s, but for one burst to 3 m/s, close to the leader, which shows
    # for about 30 s
    follower, leader = (
        plan(routes.library_route("T8")).at(MISSION),
        plan(routes.library_route("L")).at(MISSION),
    )
    burst_times = MISSION[follower.speed > 1.7]
    assert follower.speed.max() == pytest.approx(3.0, abs=0.05)
    assert np.ptp(burst_times) < 30
    assert np.diff(burst_times).max() < 0.2
    distance = np.hypot(follower.east - leader.east, follower.north - leader.north)
    nearest_time = MISSION[distance.argmin()]
    assert burst_times[0] < nearest_time < burst_times[-1]
    assert abs(nearest_time - 700) < 10
    assert distance.min() < 6
    assert 20 < np.ptp(MISSION[distance < 15]) < 40


def test_unknown_routes_are_named_with_what_exists():
    with pytest.raises(ValueError, match=r"unknown route 'T1'; available: T2 … T9, L"):
        routes.library_route("T1")


def test_a_vehicle_whose_waypoints_are_one_place_stays_there_and_heads_east():
    route = Route.timed("mine", [[0, 10, 0], [10, 10, 0], [20, 10, 0]], 5.0)
    assert (route.start_speed, route.initial_heading) == (0.0, pytest.approx(np.pi / 2))
    motion = plan(route).at(np.array([0.0, 15.0, 300.0]))
    assert motion.east.tolist() == [10.0] * 3
    assert not motion.speed.any()


def test_untimed_waypoints_get_their_times_from_the_speed():
    route = Route.at_speed("mine", [[0, 0], [30, 40], [30, 140]], 2.0, 5.0)
    assert route.time.tolist() == [0, 25, 75]


def test_a_route_cannot_be_changed():
    route = routes.library_route("T2")
    with pytest.raises(ValueError, match="read-only"):
        route.waypoint[0, 0] = 1.0


def test_depth_profiles_are_linear_between_points_and_constant_beyond_the_last():
    time = np.array([0.0, 5.0, 10.0, 15.0, 30.0])
    depth, rate = DepthProfile.through([[0, 10], [10, 15], [20, 15]]).at(time)
    assert depth.tolist() == [10, 12.5, 15, 15, 15]
    assert rate.tolist() == [0.5, 0.5, 0, 0, 0]
    depth, rate = DepthProfile.constant(7.0).at(time)
    assert set(depth) == {7.0}
    assert not rate.any()


@given(st.floats(0, 5000), st.floats(2, 20), st.floats(0, 2), st.floats(10, 300))
def test_a_saw_tooth_is_a_triangle_wave(time, mean, amplitude, period):
    depth, rate = DepthProfile.saw_tooth(mean, amplitude, period).at(np.array([time]))
    # independent form of the triangle wave
    wave = 2 / np.pi * np.arcsin(np.sin(2 * np.pi * time / period))
    assert depth[0] == pytest.approx(mean + amplitude * wave, abs=1e-6)
    assert abs(rate[0]) == pytest.approx(4 * amplitude / period)


@examples(20)
@given(st.integers(0, 2**32), st.sampled_from(sorted(CLASSES)))
def test_random_routes_keep_to_their_class(seed, name):
    route_class = CLASSES[name]
    route = random_route(np.random.default_rng(seed), route_class)
    follower, leader = plan(route).at(MISSION), plan(routes.library_route("L")).at(MISSION)
    distance = np.hypot(follower.east - leader.east, follower.north - leader.north)
    # the route is checked every second; at 3 + 1 m/s the distance changes by 2 m in half of that
    assert route_class.distance_min - 2 < distance.min()
    assert distance.max() < route_class.distance_max + 2
    assert follower.speed.max() <= 3.0 + 1e-9
    assert route.leg_speed.min() >= route_class.speed_min
    assert route.time[-1] == 1000
    # legs are drawn between two times; the last may be longer by what would have been too short for
    # one of its own
    shortest, longest = route_class.leg_time
    legs = np.diff(route.time)
    assert shortest - 0.5 <= legs.min()
    assert legs[:-1].max() <= longest + 0.5
    assert legs[-1] <= longest + shortest
    east, north = route.waypoint.T - np.array(
        [
            np.interp(route.time, MISSION, leader_coordinate)
            for leader_coordinate in (leader.east, leader.north)
        ]
    )
    bearing = np.arctan2(east, north) - np.interp(route.time, MISSION, leader.course)
    # within a degree, as the leader turns by that much in a tick
    assert np.all(np.cos(bearing) < np.cos(np.deg2rad(99)))


def test_a_random_route_is_a_function_of_the_seed():
    route, same_seed, other_seed = (
        random_route(np.random.default_rng(seed), CLASSES["100-near-drastic"]) for seed in (1, 1, 2)
    )
    assert np.array_equal(route.waypoint, same_seed.waypoint)
    assert route.waypoint.shape != other_seed.waypoint.shape or not np.array_equal(
        route.waypoint, other_seed.waypoint
    )


def test_an_impossible_class_is_refused():
    slow = CLASSES["50-near-alike"]._replace(speed_min=2.99)
    with pytest.raises(ValueError, match="no route found"):
        random_route(np.random.default_rng(0), slow, 200.0)


def test_random_waypoints_depend_on_their_address_and_can_be_flown():
    waypoints = random_waypoints("50-near-alike", [4, 0])
    assert random_waypoints("50-near-alike", [4, 0]) == waypoints
    assert random_waypoints("50-near-alike", [4, 1]) != waypoints
    assert (waypoints[0][0], waypoints[-1][0]) == (0.0, 1000.0)
    motion = plan(routes.Route.timed("drawn", waypoints, 8.0)).at(MISSION)
    for time, east, north in waypoints[1:-1]:
        closest = np.hypot(motion.east - east, motion.north - north).min()
        assert closest < 10.0, f"the route passes the waypoint of {time} s"
