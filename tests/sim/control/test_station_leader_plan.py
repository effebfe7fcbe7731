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

DT, END = 0.1, 900
ROUTE = Route.timed("r", [(0, 0, 0), (40, 0, 40), (200, 160, 40)], depth=10.0)
TIME_AT = DT * np.arange(END + 1)
TRACK = records(REFERENCE, END + 1)
TRACK.east, TRACK.north, TRACK.course = plan(ROUTE).at(TIME_AT)[:3]


def said_at(k: int, off: tuple[float, float] = (0.0, 0.0)) -> Record:
    """A message of a leader so far off its plan [m]."""
    return message(k * DT, TRACK[k].east + off[0], TRACK[k].north + off[1], TRACK[k].course, 1.0)


class Listener:
    """A follower 15 m behind and 10 m to port that receives given messages at given seconds."""

    def __init__(self, plan: LeaderPlan) -> None:
        self.plan, self.formation, self.memory = plan, Formation().record(), record(FOLLOWER_MEMORY)
        self.trail, self.count = records(TRAIL, 300), np.zeros(1, dtype=np.int64)
        self.station = record(STATION, 15.0, 10.0, 12.0, 0.0)
        init_memory(said_at(0), self.trail, self.count, self.memory)

    def hear(self, k: int, off: tuple[float, float] = (0.0, 0.0)) -> None:
        clock = k * DT, DT
        extend_trail(
            self.formation,
            self.station,
            said_at(k, off),
            self.trail,
            self.count,
            clock,
            self.memory,
        )

    def miss(self, first: int, last: int) -> None:
        """Ticks without a message, of which each turns the frame."""
        for k in range(first, last + 1):
            received = self.memory.last_received, self.memory.received_points
            extend_as_planned(self.plan, self.trail, self.count, received, (k, DT))
            known = self.trail, self.count[0]
            turn_frame(
                self.formation, self.station, known, ((k - 1) * DT, k * DT), DT, self.memory.frame
            )

    def place(self, k: int) -> tuple[float, float]:
        target = station_at(self.station, (self.trail, self.count[0]), k * DT, self.memory.frame)
        return target.east, target.north


def planned(waypoints: int) -> LeaderPlan:
    return plan_of(TRACK, ROUTE.time, waypoints, DT)


def test_a_message_contains_the_track_until_the_turn_at_its_last_waypoint() -> None:
    """A corner of at most 135° is cut at 10°/s, half of it before the waypoint: 6.75 s."""
    one, two = planned(1).known_until, planned(2).known_until
    np.testing.assert_allclose(one[1:400], 40.0 - 6.75)
    assert np.isinf(one[400:]).all()
    assert (one[400:] > 0).all()
    assert np.isinf(two[1:]).all()
    # nothing is known before the first message
    assert one[0] == two[0] == -np.inf
    assert planned(0).known_until.size == 0


def test_the_trail_of_a_plan_is_that_of_messages() -> None:
    """The leader turns at 40 s; one follower receives it each second, the other nothing from 21 s
    to 79 s.

    After a message the frame is where it would be, had no message been missed.
    """
    all_heard, quiet = Listener(planned(2)), Listener(planned(2))
    for k in range(10, 810, 10):
        all_heard.hear(k)
        if k <= 200:
            quiet.hear(k)
    quiet.miss(201, 800)
    # the trail on which its frame turned was that of then, whose last slope the next message alters
    np.testing.assert_allclose(quiet.place(800), all_heard.place(800), rtol=0, atol=0.01)
    quiet.hear(800)
    for name in TRAIL.names or ():
        actual, expected = (
            quiet.trail[: quiet.count[0]][name],
            all_heard.trail[: all_heard.count[0]][name],
        )
        np.testing.assert_allclose(actual, expected, atol=1e-9)
    frames = quiet.memory.frame.tolist(), all_heard.memory.frame.tolist()
    np.testing.assert_allclose(*frames, rtol=0, atol=1e-9)


def test_without_its_waypoints_a_leader_is_taken_to_go_straight_on() -> None:
    """With one waypoint the track is known until 33 s, and goes north from there as it did
    before.
    """
    for waypoints, points in ((0, 21), (1, 21 + 13)):
        quiet = Listener(planned(waypoints))
        for k in range(10, 210, 10):
            quiet.hear(k)
        quiet.miss(201, 800)
        assert quiet.count[0] == points
        head, speed = TRACK[10 * (points - 1)].north, TRACK[200].north - TRACK[190].north
        assert quiet.trail[points - 1].north == pytest.approx(head)
        # the station is 15 m behind and 10 m to port of the leader at 80 s
        assert quiet.place(800) == pytest.approx((-10.0, head + speed * (81 - points) - 15.0))


def test_messages_that_come_in_time_leave_no_planned_points() -> None:
    received, planning = Listener(planned(0)), Listener(planned(2))
    for k in range(1, 801):
        if k % 10 == 0:
            received.hear(k)
            planning.hear(k)
        planning.miss(k, k)
    np.testing.assert_array_equal(planning.trail, received.trail)


def straight(points: int) -> tuple[Records, Ints]:
    """A trail that goes north at 1 m/s, a point each second."""
    trail, count = records(TRAIL, 20), np.zeros(1, dtype=np.int64)
    for second in range(points):
        extend(trail, count, 0.0, float(second), float(second), (1.0, 0.0))
    return trail, count


def test_planned_points_are_moved_to_where_the_leader_was() -> None:
    """Of 1 m aside after 10 s, a tenth a second; a point as late as the message is dropped."""
    trail, count = straight(11)
    correct_planned(trail, count, 1, (1.0, 10.0, 10.0))
    assert count[0] == 10
    np.testing.assert_allclose(trail[:10].east, 0.1 * np.arange(10))
    np.testing.assert_allclose(trail[:10].north, np.arange(10.0))
    np.testing.assert_allclose(trail[:10].time, np.arange(10.0))
    # a leader that is far away has turned after the received plan, and was on it until then
    trail, count = straight(8)
    correct_planned(trail, count, 1, (30.0, 10.0, 40.0))
    assert count[0] == 8
    np.testing.assert_allclose(trail[:8].east, 0.0)
