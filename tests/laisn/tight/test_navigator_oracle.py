"""The tightly coupled navigator against one that is written independently, message by message."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.estimates import FixKind, FixRecord
from laisn.geometry import place_on_body
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges, Reception
from laisn.navigator import Navigator
from laisn.settings import Assume, NavigationSettings, TightSettings
from laisn.tight.estimator import place_arms, prune_and_merge, receive
from laisn.tight.model import model_of, new_belief
from laisn.tight.navigator import TightNavigator
from laisn.tight.ranging import new_range_message
from tests.laisn.tight.mission import details
from tests.laisn.tight.mixture import SCALE, heaviest, moments, weight_of
from tests.laisn.tight.oracle import Oracle

EVERYTHING = Assume(
    exact_leader=False, drift=True, deviation=True, current=True, offsets=True, clock=True
)


@dataclass(frozen=True, kw_only=True)
class Voyage:
    """Motion of a leader and a follower; all errors are drawn from the seed."""

    seed: int = 0
    messages: int = 20
    every: int = 3
    """Steps from message to message."""
    offset: tuple[float, float] = (-14.0, 9.0)
    """Of the follower from the leader at the start: ahead and to port [m]."""
    turn_sigma: float = 0.2
    """Standard deviation of the change of the leader's heading in a step [rad]."""
    corner: float = 0.0
    """By how much the leader turns, all at once, after two thirds of the messages [rad]."""
    echo_share: float = 0.0
    """Share of ranges that are those of echoes."""
    late_share: float = 0.0
    """Share of messages whose ranges are all too long by the same."""
    lost_share: float = 0.0
    """Share of ranges that are not received."""
    rear_echoes: tuple[int, int] = (0, 0)
    """Numbers, from and to, of messages of which only the rear transmitter is received, by an echo
    of 30 m.
    """
    current: tuple[float, float] = (0.0, 0.0)
    position_sigma: float = 0.0
    """Standard deviation of the position that the leader broadcasts [m]; every second message
    states twice as much.
    """
    delay: float = 0.0
    """By how much a message's timestamp is earlier than the places that its ranges and position
    belong to [s].
    """
    jitter: float = 0.0
    """By how much steps differ in length, as a share of Δt."""
    dt: float = 0.5

    def readings(self) -> tuple[list[tuple[OwnMotion, Reception | None, float]], Floats]:
        """Readings and receptions of the follower in each step, and its start."""
        rng, n = np.random.default_rng(self.seed), self.messages * self.every
        times = self.dt * (1.0 + self.jitter * rng.uniform(-1.0, 1.0, n))
        clock = np.cumsum(times)
        theta = rng.uniform(-np.pi, np.pi) + np.cumsum(self.turn_sigma * rng.normal(size=n))
        theta[2 * n // 3 :] += self.corner
        heading, speed = theta + 0.2 * np.sin(0.5 * clock), 1.2 + 0.4 * np.sin(0.8 * clock)

        def path(speed: Floats, heading: Floats) -> Floats:
            through_water = speed[:, None] * np.column_stack([np.sin(heading), np.cos(heading)])
            return np.cumsum(times[:, None] * (through_water + np.array(self.current)), axis=0)

        ahead = np.array([np.sin(theta[0]), np.cos(theta[0])])
        start = self.offset[0] * ahead + self.offset[1] * np.array([-ahead[1], ahead[0]])
        leader, follower = path(np.full(n, 1.1), theta), start + path(speed, heading)
        steps = []
        for k in range(n):
            own = OwnMotion(
                speed[k] + 0.1 + 0.2 * rng.normal(), heading[k] + 0.06 + 0.02 * rng.normal(), 9.0
            )
            reception = None
            if (k + 1) % self.every == 0:
                pitch, roll = 0.15 * rng.normal(size=2)
                bow = np.array(
                    [
                        np.sin(theta[k]) * np.cos(pitch),
                        np.cos(theta[k]) * np.cos(pitch),
                        np.sin(pitch),
                    ]
                )
                port = np.array([-np.cos(theta[k]), np.sin(theta[k]), 0.0])
                sites = np.array([-bow, bow, 0.1 * port]) + np.array([*leader[k], -7.5])
                ranges = np.linalg.norm(sites - np.array([*follower[k], -9.2]), axis=1)
                ranges = (
                    ranges * (1.0 + 0.05 * rng.normal() / ranges.max())
                    + 0.003 * rng.normal(size=3)
                    + 0.08
                )
                ranges[rng.random(3) < self.echo_share] += rng.uniform(0.5, 3.0)
                if self.late_share > 0.0:
                    ranges += rng.uniform(0.5, 3.0) * (rng.random() < self.late_share)
                ranges[rng.random(3) < self.lost_share] = np.nan
                if self.rear_echoes[0] <= k // self.every < self.rear_echoes[1]:
                    ranges = np.array([30.0, np.nan, np.nan])
                message = LeaderMessage(
                    clock[k] - self.delay,
                    *(
                        leader[k] + self.position_sigma * rng.normal(size=2)
                        if self.position_sigma
                        else leader[k]
                    ),
                    theta[k] + 0.05 + 0.02 * rng.normal(),
                    1.1 + 0.05 * rng.normal(),
                    7.5,
                    pitch,
                    roll,
                    position_sigma=2.0 * self.position_sigma
                    if self.position_sigma and k % 2
                    else np.nan,
                )
                reception = Reception(message, Ranges(*ranges.tolist()))
            steps.append((own, reception, float(times[k])))
        return steps, start


def assert_alike(fix: FixRecord, oracle: Oracle) -> None:
    """Output of a navigator for a message is that of the oracle's mixture."""
    update = details(fix)
    if not oracle.sides:
        assert np.all(np.isnan(update.full_state))
        assert (update.weight.size, update.used) == (0, 0)
        return
    mean, covariance = moments(oracle.all)
    mean, covariance = mean[:12], covariance[:12, :12]
    known = ~np.isnan(update.full_state)
    np.testing.assert_allclose(update.full_state[known], mean[known], rtol=0, atol=1e-7)
    np.testing.assert_allclose(
        update.full_sigma[known], np.sqrt(np.diag(covariance))[known], rtol=1e-6, atol=1e-9
    )
    assert not covariance[~known].any()
    sides = sorted(oracle.sides, key=weight_of, reverse=True)
    np.testing.assert_allclose(
        update.weight, [weight_of(side) for side in sides], rtol=1e-6, atol=1e-9
    )
    for i, side in enumerate(sides):
        mean, covariance = moments(side)
        np.testing.assert_allclose(update.hypothesis[i], mean[:2], rtol=0, atol=1e-6)
        np.testing.assert_allclose(
            update.hypothesis_covariance[i], covariance[:2, :2], rtol=1e-5, atol=1e-8
        )
    top = heaviest(sides[0])
    assert update.used == (top.taken if oracle.used else 0)
    assert update.nis == pytest.approx(
        top.squared if update.used else np.nan, rel=1e-6, nan_ok=True
    )


TWO, THREE = TightSettings(transmitters=2), TightSettings()
ALL_OF_2 = TightSettings(
    assume=EVERYTHING, transmitters=2, slip=0.03, hydrophone_height=-0.2, use_attitude=True
)
ALL_OF_3 = replace(ALL_OF_2, transmitters=3)
LEADER_COMPASS = replace(THREE, assume=Assume(exact_leader=False), leader_heading_sigma=0.05)
DRIFTING = replace(
    TWO, assume=Assume(drift=True, deviation=True, current=True), heading_bias_sigma=0.03
)
PING_DELAYS = {"ping_slot": 0.1, "sound_slowness": 1.0 / 1500.0, "floor_depth": 30.0}
NEW_POSITION_ERROR = {"leader_position_sigma": 0.5}
POSITION_ERRORS = NEW_POSITION_ERROR | {"leader_position_walk": 0.1}
CLOCK_OF_2 = replace(TWO, assume=Assume(clock=True))
STEADY_2 = replace(TWO, assume=Assume(steady_speed=True))
STEADY_3 = replace(THREE, assume=Assume(steady_speed=True))
STEADY_ALL_OF_2 = replace(ALL_OF_2, assume=replace(EVERYTHING, steady_speed=True))
CURRENT_AND_JITTER: dict[str, Any] = {"current": (0.2, -0.1), "jitter": 0.5}


@pytest.mark.parametrize(
    ("settings", "voyage"),
    [
        (THREE, Voyage(turn_sigma=0.05, lost_share=0.1)),
        (TWO, Voyage(offset=(-20.0, 0.3), turn_sigma=0.03)),
        (LEADER_COMPASS, Voyage(seed=6, turn_sigma=0.05)),
        (LEADER_COMPASS, Voyage(seed=10, turn_sigma=0.0, corner=0.6)),
        (
            ALL_OF_2,
            Voyage(
                seed=11,
                turn_sigma=0.0,
                corner=-0.4,
                echo_share=0.05,
                offset=(-25.0, 1.0),
                jitter=0.5,
            ),
        ),
        (DRIFTING, Voyage(seed=7, turn_sigma=0.03, offset=(-12.0, 4.0), current=(0.3, 0.1))),
        (
            ALL_OF_3,
            Voyage(seed=1, turn_sigma=0.1, echo_share=0.1, lost_share=0.1, **CURRENT_AND_JITTER),
        ),
        (
            ALL_OF_2,
            Voyage(
                seed=2,
                turn_sigma=0.05,
                echo_share=0.05,
                lost_share=0.1,
                offset=(-25.0, 1.0),
                **CURRENT_AND_JITTER,
            ),
        ),
        (replace(THREE, known_start=False), Voyage(seed=3, turn_sigma=0.05, lost_share=0.3)),
        (replace(ALL_OF_2, known_start=False), Voyage(seed=4, turn_sigma=0.05, messages=8)),
        (ALL_OF_3, Voyage(seed=5, turn_sigma=0.05, rear_echoes=(5, 10))),
        (CLOCK_OF_2, Voyage(seed=12, turn_sigma=0.05, offset=(-12.0, 4.0), jitter=0.5)),
        (
            replace(THREE, **NEW_POSITION_ERROR),
            Voyage(seed=15, turn_sigma=0.05, position_sigma=0.5),
        ),
        (
            replace(TWO, **NEW_POSITION_ERROR),
            Voyage(seed=16, offset=(-20.0, 0.3), turn_sigma=0.03, position_sigma=0.5),
        ),
        (
            replace(ALL_OF_2, **POSITION_ERRORS),
            Voyage(seed=17, turn_sigma=0.03, position_sigma=0.3, **CURRENT_AND_JITTER),
        ),
        (
            replace(ALL_OF_3, **POSITION_ERRORS, known_start=False),
            Voyage(seed=18, turn_sigma=0.03, position_sigma=0.3, **CURRENT_AND_JITTER),
        ),
        (replace(THREE, **PING_DELAYS), Voyage(seed=19, turn_sigma=0.05, delay=0.25)),
        (
            replace(TWO, **PING_DELAYS),
            Voyage(seed=20, offset=(-20.0, 0.3), turn_sigma=0.03, delay=0.25),
        ),
        (
            replace(ALL_OF_2, **PING_DELAYS, **POSITION_ERRORS),
            Voyage(
                seed=21,
                turn_sigma=0.05,
                delay=0.25,
                echo_share=0.05,
                position_sigma=0.3,
                **CURRENT_AND_JITTER,
            ),
        ),
        (
            replace(ALL_OF_2, **PING_DELAYS, known_start=False),
            Voyage(seed=22, turn_sigma=0.05, delay=0.25, lost_share=0.1),
        ),
        (THREE, Voyage(seed=13, turn_sigma=0.05, late_share=0.3)),
        (LEADER_COMPASS, Voyage(seed=14, turn_sigma=0.05, late_share=0.3, lost_share=0.1)),
        (TWO, Voyage(seed=15, turn_sigma=0.03, offset=(1.0, 4.0))),
        (
            ALL_OF_2,
            Voyage(seed=16, turn_sigma=0.05, offset=(-3.0, 5.0), lost_share=0.1, echo_share=0.05),
        ),
        (LEADER_COMPASS, Voyage(seed=17, turn_sigma=0.05, offset=(2.0, 3.0))),
        (STEADY_3, Voyage(seed=18, turn_sigma=0.05, lost_share=0.1)),
        (STEADY_2, Voyage(seed=19, turn_sigma=0.03, offset=(-20.0, 0.3), jitter=0.5)),
        (
            STEADY_ALL_OF_2,
            Voyage(
                seed=20, turn_sigma=0.05, offset=(-25.0, 1.0), echo_share=0.05, **CURRENT_AND_JITTER
            ),
        ),
        (replace(STEADY_ALL_OF_2, known_start=False), Voyage(seed=21, turn_sigma=0.05, messages=8)),
    ],
    ids=[
        "3",
        "2 astern",
        "leader's compass",
        "legs",
        "legs of 2",
        "drift",
        "all of 3",
        "all of 2",
        "start of 3",
        "start of 2",
        "lost",
        "clock",
        "place of 3",
        "place of 2",
        "place and its walk, all of 2",
        "place and its walk, start of 3",
        "delays of 3",
        "delays of 2",
        "delays, places, all of 2",
        "delays, start of 2",
        "late as a whole",
        "leader's compass, late as a whole",
        "near 2",
        "all near 2",
        "near 3, leader's compass",
        "steady 3",
        "steady 2",
        "steady, all of 2",
        "steady, start of 2",
    ],
)
def test_an_independent_navigator_agrees(settings: TightSettings, voyage: Voyage) -> None:
    """After each message states, covariances, hypotheses and used ranges, and after each step
    position and velocity, are the oracle's to rounding.
    """
    steps, start = voyage.readings()
    begin = np.array([*start, 0.0, 0.0]) if settings.known_start else None
    navigator, oracle = TightNavigator(settings, begin), Oracle(settings, begin)
    for own, reception, dt in steps:
        updates = navigator.step(own, reception, dt)
        oracle.step(own, reception, dt)
        for update in updates:
            assert_alike(update, oracle)
        mean, covariance = oracle.now()
        np.testing.assert_allclose(navigator.state, mean, rtol=0, atol=1e-7)
        np.testing.assert_allclose(navigator.covariance, covariance, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("use_attitude", [False, True])
@pytest.mark.parametrize("broadcasts_attitude", [False, True])
def test_arms_are_those_of_a_body_that_is_turned_as_a_whole(
    use_attitude: bool, broadcasts_attitude: bool
) -> None:
    """A leader whose attitude is not broadcast, or not used, is level."""
    settings = TightSettings(baseline=3.0, middle_offset=0.4, use_attitude=use_attitude)
    range_message, heading, pitch, roll = new_range_message(), 0.7, 0.2, -0.3
    range_message.heading = heading
    place_arms(
        range_message, model_of(settings), pitch, roll if broadcasts_attitude else np.nan, 1.5
    )
    tilt = (pitch, roll) if use_attitude and broadcasts_attitude else (0.0, 0.0)
    body = np.array([[-1.5, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 0.4, 0.0]])
    # east, north and depth of places on a body at the origin, which is 1.5 m deeper than the
    # hydrophone
    expected = place_on_body((0.0, 0.0, 1.5), (heading, *tilt), body)
    np.testing.assert_allclose(range_message.arms, expected, rtol=0, atol=1e-12)


def test_a_start_whose_covariance_is_not_positive_definite_is_refused() -> None:
    """As documented in `receive`: −1."""
    settings = replace(THREE, known_start=False)
    belief, model, range_message = (
        new_belief(settings, model_of(settings), None),
        model_of(settings),
        new_range_message(),
    )
    range_message.ranges = 20.0, 20.5, 20.2
    place_arms(range_message, model, 0.0, 0.0, 1.0)
    belief.prior_variance[SCALE] = -1.0
    assert receive(belief, model, range_message) == -1


def test_the_record_of_a_mission_is_what_its_messages_changed() -> None:
    """σ of a fix is the root of half the trace; absent sides weigh nothing; kinds follow from
    the ranges.
    """
    settings, dt = replace(ALL_OF_2, dt=0.5, known_start=False), 0.5
    steps, _ = Voyage(seed=4, turn_sigma=0.05, echo_share=0.1, lost_share=0.2).readings()
    receptions = [(k, r) for k, (_, r, _) in enumerate(steps, start=1) if r is not None]
    readings = np.array([o for o, _, _ in steps])
    measured = Measurements(
        dt=dt,
        speed=readings[:, 0],
        heading=readings[:, 1],
        depth=readings[:, 2],
        message_step=np.array([k for k, _ in receptions]),
        message=np.array([r.message for _, r in receptions]),
        ranges=np.array([r.ranges for _, r in receptions]),
    )
    result, online = TightNavigator(settings, None).run(measured), TightNavigator(settings, None)
    updates = [u for o, r, _ in steps for u in online.step(o, r)]
    kinds = []
    for i, fix in enumerate(updates):
        u, n_received = details(fix), np.isfinite(measured.ranges[i, :2]).sum()
        sides = u.weight.size
        assert (result.fix_step[i], result.used[i]) == (fix.step, u.used)
        np.testing.assert_array_equal(result.fix_position[i], u.full_state[:2])
        mean_variance = 0.5 * (u.full_sigma[0] ** 2 + u.full_sigma[1] ** 2)
        assert result.fix_sigma[i] == pytest.approx(np.sqrt(mean_variance), nan_ok=True)
        np.testing.assert_array_equal(result.nis[i], u.nis)
        np.testing.assert_array_equal(result.full_state[i], u.full_state)
        np.testing.assert_array_equal(result.full_sigma[i], u.full_sigma)
        np.testing.assert_array_equal(result.weight[i], [*u.weight, *[0.0] * (8 - sides)])
        np.testing.assert_array_equal(result.hypothesis[i, :sides], u.hypothesis)
        np.testing.assert_array_equal(
            result.hypothesis_covariance[i, :sides], u.hypothesis_covariance
        )
        assert np.isnan(result.hypothesis[i, sides:]).all()
        assert np.isnan(result.hypothesis_covariance[i, sides:]).all()
        all_used = FixKind.ONE_RANGE if n_received == 1 else FixKind.RANGES
        kind = (
            FixKind.GATED if u.used == 0 else (FixKind.PARTLY if u.used < n_received else all_used)
        )
        kinds.append(FixKind.LOST if n_received == 0 or not sides else kind)
    assert result.fix_kind.tolist() == kinds
    assert len(set(kinds)) > 3
    assert np.isnan(result.innovation).all()


@pytest.mark.parametrize("use_attitude", [False, True])
@pytest.mark.parametrize("broadcasts_attitude", [False, True])
def test_transmitters_as_offsets_or_as_a_baseline_give_the_same_estimates(
    use_attitude: bool, broadcasts_attitude: bool
) -> None:
    """The same transmitters as offsets, and as baseline and middle offset; both are tilted where
    the attitude is broadcast and used.
    """
    steps, start = Voyage(seed=9, turn_sigma=0.05, messages=6, offset=(2.0, 14.0)).readings()
    begin = np.array([*start, 0.0, 0.0])
    same_hull = ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.1, 0.0))
    navigators: list[TightNavigator | Navigator] = []
    for transmitter_offsets in ((), same_hull):
        settings = TightSettings(
            use_attitude=use_attitude,
            hydrophone_height=0.3,
            transmitter_offsets=transmitter_offsets,
        )
        paper = NavigationSettings(
            use_attitude=use_attitude,
            hydrophone_height=0.3,
            transmitter_offsets=transmitter_offsets,
            variant="laisn-3-2",
            gate="off",
        )
        navigators += [TightNavigator(settings, begin), Navigator(paper, begin)]
    tight_baseline, paper_baseline, tight_offsets, paper_offsets = navigators
    for own, sent, dt in steps:
        reception = sent
        if sent is not None and not broadcasts_attitude:
            reception = sent._replace(message=sent.message._replace(roll=np.nan))
        for navigator in navigators:
            navigator.step(own, reception, dt)
        np.testing.assert_allclose(tight_offsets.state, tight_baseline.state, rtol=0, atol=1e-9)
        np.testing.assert_allclose(paper_offsets.state, paper_baseline.state, rtol=0, atol=1e-7)


AT_LIMIT = LeaderMessage(0.1, 1e8, -1e8, 0.3, 1.0, 8.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_readings_at_the_limits_are_taken_and_those_beyond_them_refused(sign: float) -> None:
    """50 m/s of the log, ranges of 100 km, places within 100 000 km."""

    def step(
        speed: float = 1.0,
        farthest: float = 20.0,
        message: LeaderMessage = AT_LIMIT,
        coordinate: float = 0.0,
    ) -> None:
        navigator = TightNavigator(THREE, np.array([1e8, -1e8, 0.0, 0.0]))
        transmitters = np.full((3, 3), coordinate) if coordinate else None
        navigator.step(
            OwnMotion(speed, 0.0, 8.0),
            Reception(message, Ranges(farthest, np.nan, np.nan), transmitters),
        )

    just_above_1 = 1.0 + 1e-12
    step(50.0 * sign)
    step(farthest=1e5 if sign > 0.0 else 0.0)
    step(coordinate=1e8 * sign)
    for argument, pattern in (
        ({"speed": 50.0 * just_above_1 * sign}, "the speed is"),
        ({"farthest": 1e5 * just_above_1 if sign > 0.0 else -1e-9}, "expected 0"),
        ({"message": AT_LIMIT._replace(east=1e8 * just_above_1 * sign)}, "farther than"),
        ({"message": AT_LIMIT._replace(north=1e8 * just_above_1 * sign)}, "farther than"),
        ({"message": AT_LIMIT._replace(depth=1e8 * just_above_1 * sign)}, "farther than"),
        ({"coordinate": 1e8 * just_above_1 * sign}, "farther than"),
    ):
        with pytest.raises(LaisnError, match=pattern):
            step(**argument)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(4))
def test_the_eight_heaviest_of_ten_hypotheses_are_kept(seed: int) -> None:
    belief, model = new_belief(THREE, model_of(THREE), (0.0, 0.0)), model_of(THREE)
    weights = np.random.default_rng(seed).permutation(np.arange(1, 11))
    belief.n_hypotheses, belief.weight[:10] = 10, weights / 55.0
    belief.state[:10, 0], belief.covariance[:10] = 100.0 * weights, np.eye(17)
    prune_and_merge(belief, model)
    assert belief.n_hypotheses == 8
    remaining_weights = belief.weight[:8]
    # weights of 3 to 10, normalised by their sum
    np.testing.assert_allclose(np.sort(remaining_weights), np.arange(3, 11) / 52.0)
    # each is where it was, at 100 m times its weight of 1 to 10
    np.testing.assert_allclose(belief.state[:8, 0], 5200.0 * remaining_weights)
