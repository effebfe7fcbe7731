"""Control of a follower by its readings and estimates, against filters and limits calculated by
hand.
"""

from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats, Record, records
from laisn.swarm import ESTIMATE, READING
from sim.control import follower
from sim.control.autopilot import HullMotion
from sim.control.follower import Senses, extend_trail, init_memory, keep_station
from sim.control.guidance import REFERENCE
from sim.control.station import NO_PLAN, STATION, TRAIL
from sim.scenario.formation import Formation
from sim.scenario.point_motion import ACCELERATION, TURN_RATE
from tests.synthetic import message, record

DT = 0.1


class Deck:
    """A follower 20 m behind a leader that goes north at 1 m/s, with receptions for half a
    minute.
    """

    def __init__(self, aside: float = 0.0, **formation: Any) -> None:
        self.formation, self.memory = (
            Formation(**formation).record(),
            record(follower.FOLLOWER_MEMORY),
        )
        self.trail, self.count = records(TRAIL, 50), np.zeros(1, dtype=np.int64)
        self.station, self.reference = record(STATION, 20.0, 0.0, 12.0, 0.0), record(REFERENCE)
        self.reading, self.estimate = record(READING), record(ESTIMATE)
        self.reading.speed, self.reading.depth, self.estimate.position = 1.0, 12.0, (aside, 10.0)
        init_memory(message(0.0, 0.0, 0.0, 0.0, 1.0), self.trail, self.count, self.memory)
        for second in range(1, 31):
            sent = message(second, 0.0, second, 0.0, 1.0)
            self.extend_trail(sent, second)

    def extend_trail(self, sent: Record, now: float) -> None:
        extend_trail(
            self.formation, self.station, sent, self.trail, self.count, (now, DT), self.memory
        )

    def tick(self, now: float = 30.0) -> tuple[tuple[float, float, float], HullMotion]:
        known = self.trail, self.count[0]
        senses = Senses(self.reading, self.estimate)
        return keep_station(
            self.formation,
            self.station,
            senses,
            known,
            (now, DT),
            self.memory,
            self.reference,
            NO_PLAN,
        )

    def ticks(self, n: int) -> Floats:
        """Measured surge and heading, and wanted heading and speed, shape (n, 4)."""
        rows = []
        for _ in range(n):
            expected, motion = self.tick()
            rows.append((motion.surge, motion.heading, expected[0], expected[2]))
        return np.array(rows)


def test_a_message_that_was_long_under_way_turns_the_frame_as_far_as_one_that_was_not() -> None:
    """The leader has turned to the east 8 m ahead of the station; the message of 30 s is in at
    once, or at 30.4 s.
    """
    frames = []
    for late in (False, True):
        deck = Deck()
        deck.station.behind, deck.station.port = 2.0, 12.0
        for second in range(31, 40):
            deck.extend_trail(message(second, second - 30.0, 30.0, np.pi / 2, 1.0), second)
        sent = message(40.0, 10.0, 30.0, np.pi / 2, 1.0)
        if not late:
            deck.extend_trail(sent, 40.0)
        for now in (40.0, 40.1, 40.2, 40.3):
            deck.tick(now)
        if late:
            deck.extend_trail(sent, 40.4)
        deck.tick(40.4)
        frames.append(deck.memory.frame.tolist())
    np.testing.assert_allclose(frames[1], frames[0], rtol=0, atol=1e-12)
    assert frames[0][1] > 1e-3


def test_the_log_is_smoothed_over_a_second_and_the_compass_over_two() -> None:
    """Of a step in each, what is left after n ticks of Euler's rule is (1 − Δt / T)ⁿ."""
    deck = Deck()
    deck.tick()
    deck.reading.speed, deck.reading.heading = 1.5, 0.2
    motion = deck.ticks(30)
    left = np.arange(1, 31)
    np.testing.assert_allclose(motion[:, 0], 1.5 - 0.5 * (1 - DT / 1.0) ** left)
    np.testing.assert_allclose(motion[:, 1], 0.2 - 0.2 * (1 - DT / 2.0) ** left)


def test_gyros_are_followed_at_once_and_biases_are_taken_off() -> None:
    deck = Deck()
    deck.tick()
    deck.reading.turning, deck.estimate.log_bias, deck.estimate.compass_bias = 0.05, 0.25, 0.1
    _, motion = deck.tick()
    # to port is the other way round than headings are counted; the compass still reads 0
    turned = -0.05 * DT
    assert motion.heading == pytest.approx(turned * (1 - DT / 2.0) - 0.1)
    assert motion.surge == pytest.approx(0.75)
    assert motion.turning == 0.05


def test_pitch_and_depth_are_felt_as_they_are_read() -> None:
    deck = Deck()
    deck.reading.depth, deck.reading.pitch, deck.reading.pitching = 11.5, -0.2, 0.03
    _, motion = deck.tick()
    assert (motion.depth, motion.pitch, motion.pitching, motion.sway) == (11.5, -0.2, 0.03, 0.0)
    assert motion.sinking == pytest.approx(np.sin(0.2))


def test_what_is_wanted_changes_no_faster_than_a_hull_can_follow() -> None:
    deck = Deck(aside=50.0)
    expected = deck.ticks(5)
    np.testing.assert_allclose(expected[:, 2], -TURN_RATE * DT * np.arange(1, 6))
    assert deck.tick()[0][1] == pytest.approx(-TURN_RATE)
    far = Deck()
    far.estimate.position[1] = -500.0
    np.testing.assert_allclose(far.ticks(3)[:, 3], 1.0 + ACCELERATION * DT * np.arange(1, 4))


@pytest.mark.parametrize(("spread", "aims"), [(0.99, True), (1.01, False), (np.nan, False)])
def test_a_follower_with_ambiguous_side_goes_parallel(spread: float, aims: bool) -> None:
    deck = Deck(aside=10.0, max_trail_sigma_m=1.0)
    deck.estimate.position_sigma = spread
    deck.tick()
    assert (deck.memory.heading_wanted < -0.001) == aims
    # along the way it closes up all the same
    deck.estimate.position[1] = 4.0
    before = deck.memory.speed_wanted
    deck.tick()
    assert deck.memory.speed_wanted > before


def test_who_may_be_at_either_of_two_places_steers_by_the_likelier() -> None:
    """4 m to port of its station or as much to starboard, in the mean on it; by the mean it
    would go straight on.
    """
    expected = []
    for lean in (-4.0, 0.0, 4.0):
        deck = Deck()
        deck.estimate.offset_to_likelier[0] = lean
        expected.append(deck.ticks(20)[-1, 2])
    assert expected[1] == pytest.approx(0.0, abs=1e-9)
    assert expected[0] > 0.1
    assert expected[2] == pytest.approx(-expected[0])
    # the same as if it were surely there
    sure = Deck(aside=4.0)
    assert sure.ticks(20)[-1, 2] == expected[2]


def test_a_new_depth_is_taken_up_at_a_fifth_of_a_metre_a_second() -> None:
    deck = Deck()
    deck.station.depth = 11.0
    for n in range(1, 4):
        deck.tick()
        assert (deck.reference.depth, deck.reference.sinking) == pytest.approx(
            (12.0 - 0.02 * n, -0.2)
        )
    deck.station.depth = 12.0 - 0.07
    deck.tick()
    assert (deck.reference.depth, deck.reference.sinking) == pytest.approx((11.93, -0.1))


def test_silence_takes_it_off_its_station_as_its_place_in_the_trail_gets_uncertain() -> None:
    """0.3 m of its own and 0.1 m/s of the leader's make 0.5 m after 4 s: until then it aims,
    then goes parallel.
    """
    given = {
        "leader_velocity_sigma_m_s": 0.1,
        "max_trail_sigma_m": 0.5,
        "message_timeout_s": 8.0,
        "timeout_action": "circle",
    }
    for now, aims, circles in (
        (33.95, True, False),
        (34.05, False, False),
        (37.95, False, False),
        (38.05, False, True),
    ):
        deck = Deck(aside=10.0, **given)
        deck.estimate.position[1], deck.estimate.position_sigma = now - 20.0, 0.3
        expected, _ = deck.tick(now)
        assert (expected[0] < -0.001) == aims, now
        assert (expected[0] == pytest.approx(np.deg2rad(4.0) * DT)) == circles, now
