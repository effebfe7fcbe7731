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


class Bench:
    """Control of a follower, called by hand: its leader goes north at 1 m/s, and a message a second
    came in for half a minute.

    It is to be 20 m behind, and is estimated to be so, `aside` [m] east of the track.
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
        trail_so_far = self.trail, self.count[0]
        senses = Senses(self.reading, self.estimate)
        return keep_station(
            self.formation,
            self.station,
            senses,
            trail_so_far,
            (now, DT),
            self.memory,
            self.reference,
            NO_PLAN,
        )

    def ticks(self, n: int) -> Floats:
        """Surge and heading as they are measured, and as they are commanded, shape (n, 4)."""
        rows = []
        for _ in range(n):
            command, motion = self.tick()
            rows.append((motion.surge, motion.heading, command[0], command[2]))
        return np.array(rows)


def test_a_message_that_was_long_under_way_turns_the_frame_as_far_as_one_that_was_not() -> None:
    """The leader has turned to the east 8 m ahead of the station; the message of 30 s is in at
    once, or at 30.4 s.
    """
    frames = []
    for is_late in (False, True):
        bench = Bench()
        bench.station.behind, bench.station.port = 2.0, 12.0
        for second in range(31, 40):
            bench.extend_trail(message(second, second - 30.0, 30.0, np.pi / 2, 1.0), second)
        sent = message(40.0, 10.0, 30.0, np.pi / 2, 1.0)
        if not is_late:
            bench.extend_trail(sent, 40.0)
        for now in (40.0, 40.1, 40.2, 40.3):
            bench.tick(now)
        if is_late:
            bench.extend_trail(sent, 40.4)
        bench.tick(40.4)
        frames.append(bench.memory.frame.tolist())
    np.testing.assert_allclose(frames[1], frames[0], rtol=0, atol=1e-12)
    assert frames[0][1] > 1e-3


def test_the_log_is_smoothed_over_a_second_and_the_compass_over_two() -> None:
    """Of a step in each, what is left after n ticks of Euler's rule is (1 − Δt / T)ⁿ."""
    bench = Bench()
    bench.tick()
    bench.reading.speed, bench.reading.heading = 1.5, 0.2
    motion = bench.ticks(30)
    n_ticks = np.arange(1, 31)
    np.testing.assert_allclose(motion[:, 0], 1.5 - 0.5 * (1 - DT / 1.0) ** n_ticks)
    np.testing.assert_allclose(motion[:, 1], 0.2 - 0.2 * (1 - DT / 2.0) ** n_ticks)


def test_gyros_are_followed_at_once_and_biases_are_taken_off() -> None:
    bench = Bench()
    bench.tick()
    bench.reading.turning, bench.estimate.log_bias, bench.estimate.compass_bias = 0.05, 0.25, 0.1
    _, motion = bench.tick()
    # to port is the other way round than headings are counted; the compass still reads 0
    turned = -0.05 * DT
    assert motion.heading == pytest.approx(turned * (1 - DT / 2.0) - 0.1)
    assert motion.surge == pytest.approx(0.75)
    assert motion.turning == 0.05


def test_pitch_and_depth_are_felt_as_they_are_read() -> None:
    bench = Bench()
    bench.reading.depth, bench.reading.pitch, bench.reading.pitching = 11.5, -0.2, 0.03
    _, motion = bench.tick()
    assert (motion.depth, motion.pitch, motion.pitching, motion.sway) == (11.5, -0.2, 0.03, 0.0)
    assert motion.sinking == pytest.approx(np.sin(0.2))


def test_commands_change_no_faster_than_a_hull_can_follow() -> None:
    bench = Bench(aside=50.0)
    commands = bench.ticks(5)
    np.testing.assert_allclose(commands[:, 2], -TURN_RATE * DT * np.arange(1, 6))
    assert bench.tick()[0][1] == pytest.approx(-TURN_RATE)
    far_behind = Bench()
    far_behind.estimate.position[1] = -500.0
    np.testing.assert_allclose(far_behind.ticks(3)[:, 3], 1.0 + ACCELERATION * DT * np.arange(1, 4))


@pytest.mark.parametrize(("position_sigma", "aims"), [(0.99, True), (1.01, False), (np.nan, False)])
def test_a_follower_of_too_uncertain_position_goes_parallel_to_the_trail(
    position_sigma: float, aims: bool
) -> None:
    bench = Bench(aside=10.0, max_trail_sigma_m=1.0)
    bench.estimate.position_sigma = position_sigma
    bench.tick()
    assert (bench.memory.heading_wanted < -0.001) == aims
    # along the way it closes up all the same
    bench.estimate.position[1] = 4.0
    before = bench.memory.speed_wanted
    bench.tick()
    assert bench.memory.speed_wanted > before


def test_a_follower_with_two_likely_places_steers_by_the_likelier() -> None:
    """4 m to port of its station or as much to starboard, in the mean on it; by the mean it
    would go straight on.
    """
    headings = []
    for offset in (-4.0, 0.0, 4.0):
        bench = Bench()
        bench.estimate.offset_to_likelier[0] = offset
        headings.append(bench.ticks(20)[-1, 2])
    assert headings[1] == pytest.approx(0.0, abs=1e-9)
    assert headings[0] > 0.1
    assert headings[2] == pytest.approx(-headings[0])
    # the same as if it were surely there
    certain = Bench(aside=4.0)
    assert certain.ticks(20)[-1, 2] == headings[2]


def test_a_new_depth_is_taken_up_at_a_fifth_of_a_metre_a_second() -> None:
    bench = Bench()
    bench.station.depth = 11.0
    for n in range(1, 4):
        bench.tick()
        assert (bench.reference.depth, bench.reference.sinking) == pytest.approx(
            (12.0 - 0.02 * n, -0.2)
        )
    bench.station.depth = 12.0 - 0.07
    bench.tick()
    assert (bench.reference.depth, bench.reference.sinking) == pytest.approx((11.93, -0.1))


def test_silence_ends_steering_for_the_station_once_its_place_in_the_trail_is_uncertain() -> None:
    """Standard deviations of 0.3 m of its own and 0.1 m/s of the leader's make (0.3² + 0.4²)^½ =
    0.5 m after 4 s: until then it aims at the station, then goes parallel, and circles after 8 s.
    """
    settings = {
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
        bench = Bench(aside=10.0, **settings)
        bench.estimate.position[1], bench.estimate.position_sigma = now - 20.0, 0.3
        command, _ = bench.tick(now)
        assert (command[0] < -0.001) == aims, now
        assert (command[0] == pytest.approx(np.deg2rad(4.0) * DT)) == circles, now
