"""The point motion, against closed forms."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from laisn.errors import LaisnError
from laisn.geometry import signed_angle
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route, library_route, names
from sim.simulation import simulate_points

TURN_RATE, ACCELERATION = np.deg2rad(10.0), 0.2
RADIUS = 1.0 / TURN_RATE


def corner_route(corner_deg: float, leg: float = 200.0) -> Route:
    """A leg east [m] and one turned to starboard by an angle.

    The arc that cuts the corner is shorter than the legs to the waypoint; times allow for that, so
    that the speed is 1 m/s throughout.
    """
    corner = np.deg2rad(corner_deg)
    points = [[0, 0], [leg, 0], [leg + leg * np.cos(corner), -leg * np.sin(corner)]]
    half_shortcut = RADIUS * (np.tan(corner / 2) - corner / 2)
    time = [0, leg - half_shortcut, 2 * leg - 2 * half_shortcut]
    return Route.timed("corner", np.column_stack([time, points]), 5.0)


def test_a_quarter_turn_takes_nine_seconds_on_a_circle():
    planned = plan(corner_route(90.0))
    turning = np.flatnonzero(planned.turn_rate)
    assert planned.turn_rate[turning] == pytest.approx(TURN_RATE)
    begin, end = planned.start[turning[0]], planned.start[turning[-1] + 1]
    assert end - begin == pytest.approx(9.0)
    assert begin == pytest.approx(200 - RADIUS)
    motion = planned.at(np.linspace(begin, end, 50))
    assert np.hypot(motion.east - (200 - RADIUS), motion.north + RADIUS) == pytest.approx(RADIUS)
    assert motion.speed == pytest.approx(1.0)


@pytest.mark.parametrize("corner_deg", [-130.0, -45.0, 10.0, 90.0])
def test_legs_are_straight_and_exact(corner_deg):
    starboard_route = corner_route(abs(corner_deg))
    side = np.sign(corner_deg)
    route = Route.timed(
        "corner", np.column_stack([starboard_route.time, starboard_route.waypoint * [1, side]]), 5.0
    )
    planned = plan(route)
    motion = planned.at(np.arange(0, 350.0, 0.1))
    begin, end = (
        planned.start[np.flatnonzero(planned.turn_rate)[0]],
        planned.start[np.flatnonzero(planned.turn_rate)[-1] + 1],
    )
    time = np.arange(0, 350.0, 0.1)
    assert motion.north[time <= begin] == pytest.approx(0.0, abs=1e-9)
    direction = (route.waypoint[2] - route.waypoint[1]) / 200
    after_turn = time >= end
    cross_track = (motion.east[after_turn] - 200) * direction[1] - motion.north[
        after_turn
    ] * direction[0]
    assert cross_track == pytest.approx(0.0, abs=1e-8)
    assert end - begin == pytest.approx(abs(corner_deg) / 10)


def test_a_change_of_speed_is_a_ramp():
    # 100 s at most: 1 to 2 m/s takes 5 s and loses 2.5 m against 2 m/s from the start
    planned = plan(Route.timed("ramp", [[0, 0, 0], [100, 0, 197.5]], 5.0))
    assert planned.acceleration.tolist() == [ACCELERATION, 0, 0]
    assert planned.start == pytest.approx([0, 5, 100])
    motion = planned.at(np.array([0.0, 2.5, 5.0, 50.0, 100.0, 110.0]))
    assert motion.speed == pytest.approx([1, 1.5, 2, 2, 2, 2])
    assert motion.north == pytest.approx([0, 2.5 + 0.1 * 2.5**2, 7.5, 97.5, 197.5, 217.5])


@pytest.mark.parametrize("name", names())
def test_waypoints_are_met_on_time(name):
    route = library_route(name)
    planned = plan(route)
    for k in range(1, route.time.size):
        motion = planned.at(route.time[k] + np.array([-0.05, 0.0, 0.05]))
        distance = np.hypot(motion.east - route.waypoint[k, 0], motion.north - route.waypoint[k, 1])
        assert distance[1] <= distance[[0, 2]].min() + 1e-9
    assert route.waypoint[-1] == pytest.approx([motion.east[1], motion.north[1]], abs=1e-6)


@pytest.mark.parametrize("name", names())
def test_motion_keeps_to_its_limits_and_is_continuous(name):
    time = np.arange(0, 1000.05, 0.01)
    motion = plan(library_route(name)).at(time)
    assert np.abs(motion.turn_rate).max() <= TURN_RATE + 1e-12
    assert np.abs(motion.acceleration).max() <= ACCELERATION
    assert not (motion.turn_rate * motion.acceleration).any()
    for value, rate in (
        (motion.course, TURN_RATE),
        (motion.speed, ACCELERATION),
        (motion.east, 3.0),
        (motion.north, 3.0),
    ):
        assert np.abs(np.diff(value)).max() <= rate * 0.01 + 1e-9


def test_the_position_is_the_integral_of_the_velocity():
    dt = 0.001
    time = np.arange(0, 1000, dt)
    motion = plan(library_route("T8")).at(time)
    for position, direction in (
        (motion.east, np.sin(motion.course)),
        (motion.north, np.cos(motion.course)),
    ):
        velocity = motion.speed * direction
        integral = position[0] + np.concatenate(
            [[0], np.cumsum((velocity[1:] + velocity[:-1]) / 2 * dt)]
        )
        # trapezoids: the jump of acceleration at a segment's end costs dt²/2 times it at most
        assert np.abs(position - integral).max() < 100 * dt**2


def test_a_start_off_the_first_leg_turns_to_it_first():
    # the leg leads north, the vehicle heads east: a quarter circle to port of radius R would end
    # R east of the leg, so the vehicle turns further and aims back at the waypoint
    route = Route.timed("start", [[0, 0, 0], [100, 0, 100]], 5.0, start_heading=np.pi / 2)
    planned = plan(route)
    motion = planned.at(np.array([0.0, 100.0]))
    assert motion.course[0] == pytest.approx(np.pi / 2)
    assert planned.turn_rate[0] == pytest.approx(-TURN_RATE)
    assert [motion.east[1], motion.north[1]] == pytest.approx([0, 100], abs=1e-9)


def test_sharp_corners_are_turned_after_the_waypoint():
    route = Route.timed("back", [[0, 0, 0], [100, 0, 100], [260, 1, -40]], 5.0)
    motion = plan(route).at(route.time)
    assert motion.east == pytest.approx(route.waypoint[:, 0], abs=1e-9)
    assert motion.north == pytest.approx(route.waypoint[:, 1], abs=1e-9)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            [[0, 0, 0], [100, 0, 100], [120, 0, 180]],
            "route 'mine', waypoint 3: 4.* on average required",
        ),
        (
            [[0, 0, 0], [5e-324, 1, 1]],
            "route 'mine', waypoint 2: inf m/s on average required after 1 m/s",
        ),
        (
            [[0, 0, 0], [10, 0, 29]],
            "waypoint 2: 2.9 m/s on average required after 1 m/s; out of reach",
        ),
        (
            [[0, 0, 0], [10, 0, 0.5]],
            "waypoint 2: 0.05 m/s on average required after 1 m/s; out of reach",
        ),
        # two quarter turns of 5.7 m radius do not fit on 9 m
        (
            [[0, 0, 0], [100, 0, 100], [107, 9, 100], [290, 9, 280]],
            "waypoint 3: a leg of 9 m is .* m too short",
        ),
        # almost back, and within the circle about (5.7, 100)
        (
            [[0, 0, 0], [100, 0, 100], [106, 4, 95.5]],
            "waypoint 3: it lies within the turning circle of 5.73 m radius",
        ),
    ],
)
def test_what_cannot_be_flown_is_refused_by_name(points, message):
    with pytest.raises(ValueError, match=message):
        plan(Route.timed("mine", points, 5.0))


@given(
    st.lists(
        st.tuples(st.floats(20, 200), st.floats(-200, 200), st.floats(-200, 200)),
        min_size=1,
        max_size=6,
    )
)
def test_any_route_is_met_on_time_or_refused(steps):
    points = np.cumsum(np.array([(0.0, 0.0, 0.0), *steps]), axis=0)
    assume(np.hypot(*np.diff(points[:, 1:], axis=0).T).min() > 0)
    route = Route.timed("any", points, 5.0)
    try:
        planned = plan(route)
    except ValueError as error:
        refusal = str(error)
    else:
        refusal = ""
    if refusal:
        assert refusal.startswith("route 'any', waypoint ")
        return
    time = np.linspace(0, points[-1, 0], 2000)
    motion = planned.at(time)
    assert motion.speed.max() <= 3.0 + 1e-6
    assert np.abs(motion.turn_rate).max() <= np.deg2rad(10.0) + 1e-12
    end = planned.at(route.time[-1:])
    assert [end.east[0], end.north[0]] == pytest.approx(route.waypoint[-1].tolist(), abs=1e-6)
    # corners are cut by less than R (1 / cos(c / 2) − 1), sharper ones not at all
    largest_cut = 3.0 / np.deg2rad(10.0) * (1 / np.cos(np.deg2rad(135.0) / 2) - 1)
    at_waypoints = planned.at(route.time)
    assert (
        np.hypot(at_waypoints.east - points[:, 1], at_waypoints.north - points[:, 2]).max()
        <= largest_cut + 1e-6
    )


def test_a_fleet_moves_level_on_its_course():
    routes = (library_route("L"), library_route("T4", 12.0))
    plant: Any = SimpleNamespace(
        site_names=("leader/bow", "follower/top"),
        site_vehicle=np.array([0, 1]),
        site_offset=np.array([[1.0, 0, 0], [0, 0, 0.1]]),
    )
    trajectory = simulate_points(("leader", "follower"), routes, 1000.0, plant)
    assert trajectory.time.size == 10001
    assert trajectory.time[-1] == pytest.approx(1000.0)
    assert np.abs(trajectory.pitch).max() < 1e-12
    assert np.abs(trajectory.roll).max() < 1e-12
    assert trajectory.depth[:, 0] == pytest.approx(8.0)
    assert trajectory.depth[:, 1] == pytest.approx(12.0)
    for i, route in enumerate(routes):
        motion = plan(route).at(trajectory.time)
        heading_difference = trajectory.heading[:, i] - motion.course
        assert np.abs(signed_angle(heading_difference)).max() < 1e-12
        assert trajectory.forward_speed[:, i] == pytest.approx(motion.speed)
        assert trajectory.angular_velocity[:, i, 2] == pytest.approx(-motion.turn_rate)
    # the bow is 1 m along the course, east at first
    assert trajectory.site_position[0, 0] == pytest.approx([1.0, 0.0, -8.0])
    assert trajectory.site_position[:, 1, 2] == pytest.approx(-11.9)


def route_with_stop(
    *,
    arrival: float = 150.0,
    departure: float = 270.0,
    corner_deg: float = 90.0,
    starts_at_rest: bool = False,
) -> Route:
    """East for 120 m until the arrival [s], a stop until the departure [s], and 100 m on another
    course; all of that after a stop of 30 s if it starts at rest.
    """
    course = np.deg2rad(90.0 + corner_deg)
    end = [arrival + 400.0, 120.0 + 100.0 * np.sin(course), 100.0 * np.cos(course)]
    points = [[0, 0, 0], [arrival, 120, 0], [departure, 120, 0], end]
    if starts_at_rest:
        points = [[0, 0, 0], *([t + 30.0, x, y] for t, x, y in points)]
    return Route.timed("stop", points, 5.0)


@pytest.mark.parametrize(
    ("starts_at_rest", "arrival"), [(True, 150.0), (False, 150.0), (False, 90.0), (False, 122.5)]
)
def test_a_vehicle_rests_at_a_place_that_is_given_twice(
    starts_at_rest: bool, arrival: float
) -> None:
    """From rest the leg is a trapezoid, v (T − v / a); from 1 m/s the difference of the ramps is
    lost besides.
    """
    a, delay = ACCELERATION, 30.0 if starts_at_rest else 0.0
    planned = plan(route_with_stop(arrival=arrival, starts_at_rest=starts_at_rest))
    time = np.arange(0.0, arrival + 400.0 + delay, 0.1)
    motion = planned.at(time)
    v = motion.speed[np.searchsorted(time, delay + arrival / 2)]
    distance = (
        v * (arrival - v / a)
        if starts_at_rest
        else v * arrival - (abs(v - 1.0) * (v - 1.0) + v * v) / (2 * a)
    )
    assert distance == pytest.approx(120.0)
    is_resting = (time >= arrival + delay) & (time <= arrival + 120.0 + delay)
    assert np.abs(motion.speed[is_resting]).max() < 1e-12
    assert motion.east[is_resting] == pytest.approx(120.0, abs=1e-9)
    assert np.ptp(motion.course[is_resting]) < 1e-12
    if starts_at_rest:
        assert np.abs(motion.east[time <= 30.0]).max() == 0.0
    # at all times the speed is the rate of change of the position
    assert np.hypot(np.gradient(motion.east, 0.1), np.gradient(motion.north, 0.1))[
        1:-1
    ] == pytest.approx(motion.speed[1:-1], abs=0.03)
    assert motion.speed.min() >= 0.0


@pytest.mark.parametrize("corner_deg", [-150.0, -60.0, 0.0, 90.0])
def test_after_a_stop_a_vehicle_turns_on_the_spot_and_reaches_its_waypoint_in_time(
    corner_deg: float,
) -> None:
    route = route_with_stop(corner_deg=corner_deg)
    planned = plan(route)
    turned = planned.at(np.array([270.0 + abs(corner_deg) / 10.0]))
    assert (turned.east[0], turned.north[0], turned.speed[0]) == pytest.approx(
        (120.0, 0.0, 0.0), abs=1e-9
    )
    assert turned.course[0] == pytest.approx(np.pi / 2 + np.deg2rad(corner_deg))
    end = planned.at(route.time[-1:])
    assert [end.east[0], end.north[0]] == pytest.approx(route.waypoint[-1].tolist(), abs=1e-6)


@pytest.mark.parametrize(
    ("distance", "time"), [(120.0, 30.0), (120.0, 50.0), (1.0, 2.0), (2.4, 30.0)]
)
def test_a_stop_that_comes_too_soon_is_refused(distance: float, time: float) -> None:
    """Beyond 3 m/s with the ramps, or nearer than the 2.5 m in which 1 m/s comes to rest."""
    with pytest.raises(LaisnError, match=r"waypoint 2: .* required"):
        plan(Route.timed("stop", [[0, 0, 0], [time, distance, 0], [200, distance, 0]], 5.0))


def test_a_vehicle_stays_where_its_route_ends_with_a_stop() -> None:
    planned = plan(Route.timed("end", [[0, 0, 0], [100, 80, 0], [101, 80, 0]], 5.0))
    motion = planned.at(np.array([100.0, 5000.0]))
    assert (motion.speed.tolist(), motion.east) == ([0.0, 0.0], pytest.approx(80.0))
