"""Trails extended along the leader's waypoints without receptions, against the trail with all
receptions.
"""

import numpy as np
import pytest

from laisn.arrays import Ints, Record, Records, records
from sim.control.follower import FOLLOWER_MEMORY, extend_trail, init_memory
from sim.control.guidance import REFERENCE
from sim.control.station import (
    STATION,
    TRAIL,
    LeaderPlan,
    correct_planned,
    extend,
    extend_as_planned,
    plan_of,
    station_at,
    turn_frame,
)
from sim.scenario.formation import Formation
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from tests.synthetic import message, record

DT, LAST_STEP = 0.1, 900  # control step [s], and the number of the last one
ROUTE = Route.timed("r", [(0, 0, 0), (40, 0, 40), (200, 160, 40)], depth=10.0)
STEP_TIMES = DT * np.arange(LAST_STEP + 1)
TRACK = records(REFERENCE, LAST_STEP + 1)
TRACK.east, TRACK.north, TRACK.course = plan(ROUTE).at(STEP_TIMES)[:3]


def message_at(k: int, offset: tuple[float, float] = (0.0, 0.0)) -> Record:
    """A message sent at control step k by a leader so far east and north of its plan [m]."""
    return message(
        k * DT, TRACK[k].east + offset[0], TRACK[k].north + offset[1], TRACK[k].course, 1.0
    )


class Listener:
    """A follower 15 m behind and 10 m to port; its methods take control steps."""

    def __init__(self, plan: LeaderPlan) -> None:
        self.plan, self.formation, self.memory = plan, Formation().record(), record(FOLLOWER_MEMORY)
        self.trail, self.count = records(TRAIL, 300), np.zeros(1, dtype=np.int64)
        self.station = record(STATION, 15.0, 10.0, 12.0, 0.0)
        init_memory(message_at(0), self.trail, self.count, self.memory)

    def hear(self, k: int, offset: tuple[float, float] = (0.0, 0.0)) -> None:
        clock = k * DT, DT
        extend_trail(
            self.formation,
            self.station,
            message_at(k, offset),
            self.trail,
            self.count,
            clock,
            self.memory,
        )

    def miss(self, first: int, last: int) -> None:
        """Control steps without a message: the trail is extended as planned, the frame turned."""
        for k in range(first, last + 1):
            received = self.memory.last_received, self.memory.received_points
            extend_as_planned(self.plan, self.trail, self.count, received, (k, DT))
            trail = self.trail, self.count[0]
            turn_frame(
                self.formation, self.station, trail, ((k - 1) * DT, k * DT), DT, self.memory.frame
            )

    def target_place(self, k: int) -> tuple[float, float]:
        """East and north of the station [m]."""
        target = station_at(self.station, (self.trail, self.count[0]), k * DT, self.memory.frame)
        return target.east, target.north


def planned(waypoints: int) -> LeaderPlan:
    """The plan of a leader whose messages carry so many waypoints."""
    return plan_of(TRACK, ROUTE.time, waypoints, DT)


def test_a_message_contains_the_track_until_the_turn_at_its_last_waypoint() -> None:
    """The next leg is not known, and a corner has at most 135°: at 10°/s, half of it lasts 6.75 s
    before the waypoint.
    """
    one_waypoint, two_waypoints = planned(1).known_until, planned(2).known_until
    np.testing.assert_allclose(one_waypoint[1:400], 40.0 - 6.75)
    assert np.isinf(one_waypoint[400:]).all()
    assert (one_waypoint[400:] > 0).all()
    assert np.isinf(two_waypoints[1:]).all()
    # nothing is known before the first message
    assert one_waypoint[0] == two_waypoints[0] == -np.inf
    assert planned(0).known_until.size == 0


def test_the_trail_of_a_plan_is_that_of_messages() -> None:
    """The leader turns at 40 s; one follower receives it each second, the other nothing from 21 s
    to 79 s.

    After the next message the frame is where it would be, had no message been missed.
    """
    hears_all, hears_part = Listener(planned(2)), Listener(planned(2))
    for k in range(10, 810, 10):
        hears_all.hear(k)
        if k <= 200:
            hears_part.hear(k)
    hears_part.miss(201, 800)
    # 1 cm: the frame turned on a trail that ended at each step, whose last slope the point after
    # it alters
    np.testing.assert_allclose(
        hears_part.target_place(800), hears_all.target_place(800), rtol=0, atol=0.01
    )
    hears_part.hear(800)
    for name in TRAIL.names or ():
        actual, expected = (
            hears_part.trail[: hears_part.count[0]][name],
            hears_all.trail[: hears_all.count[0]][name],
        )
        np.testing.assert_allclose(actual, expected, atol=1e-9)
    frames = hears_part.memory.frame.tolist(), hears_all.memory.frame.tolist()
    np.testing.assert_allclose(*frames, rtol=0, atol=1e-9)


def test_without_its_waypoints_a_leader_is_taken_to_go_straight_on() -> None:
    """Messages come until 20 s. With one waypoint the track is known until 33 s, and goes north
    from there as it did before.
    """
    # a point a second: received at 0 to 20 s, planned at 21 to 33 s
    for waypoints, points in ((0, 21), (1, 21 + 13)):
        follower = Listener(planned(waypoints))
        for k in range(10, 210, 10):
            follower.hear(k)
        follower.miss(201, 800)
        assert follower.count[0] == points
        last_north, speed = TRACK[10 * (points - 1)].north, TRACK[200].north - TRACK[190].north
        assert follower.trail[points - 1].north == pytest.approx(last_north)
        # the last point is at points − 1 s; the station is 15 m behind and 10 m to port of the
        # leader at 80 s
        leader_north = last_north + speed * (80 - (points - 1))
        assert follower.target_place(800) == pytest.approx((-10.0, leader_north - 15.0))


def test_messages_that_come_in_time_leave_no_planned_points() -> None:
    without_plan, with_plan = Listener(planned(0)), Listener(planned(2))
    for k in range(1, 801):
        if k % 10 == 0:
            without_plan.hear(k)
            with_plan.hear(k)
        with_plan.miss(k, k)
    np.testing.assert_array_equal(with_plan.trail, without_plan.trail)


def straight(points: int) -> tuple[Records, Ints]:
    """A trail that goes north at 1 m/s, a point each second."""
    trail, count = records(TRAIL, 20), np.zeros(1, dtype=np.int64)
    for second in range(points):
        extend(trail, count, 0.0, float(second), float(second), (1.0, 0.0))
    return trail, count


def test_planned_points_are_moved_to_where_the_leader_was() -> None:
    """A message at 10 s is 1 m east of the plan: points move by a tenth of that a second, and the
    point at 10 s is dropped.
    """
    trail, count = straight(11)
    correct_planned(trail, count, 1, (1.0, 10.0, 10.0))
    assert count[0] == 10
    np.testing.assert_allclose(trail[:10].east, 0.1 * np.arange(10))
    np.testing.assert_allclose(trail[:10].north, np.arange(10.0))
    np.testing.assert_allclose(trail[:10].time, np.arange(10.0))
    # a leader 30 m off the plan has turned after its end, and was on it until then: nothing moves
    trail, count = straight(8)
    correct_planned(trail, count, 1, (30.0, 10.0, 40.0))
    assert count[0] == 8
    np.testing.assert_allclose(trail[:8].east, 0.0)
