"""Smoothing after the fact: a batch solution, closed forms of the way, the filter where there is
nothing to smooth.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from laisn.arrays import Floats, Ints
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.metrics import nees
from laisn.mixture import Chain, smooth
from laisn.settings import Assume, TightSettings
from laisn.tight.model import COMPASS_BIAS, LOG_BIAS, X, Y
from laisn.tight.navigator import SmoothingNavigator, TightNavigator, _Leg
from tests.laisn.tight.mission import EVERYTHING, Mission

LAG = 4
MESSAGES = 12
STATES = 3


class Linear(NamedTuple):
    """A random linear system: its Kalman filter as a chain, two outputs y a message, and their
    batch solution.
    """

    chain: Chain
    filtered: tuple[Floats, Floats]  # mean and covariance of y by the filter
    cross_to_next: Floats  # covariance of y with the state just before the next message
    latest: Ints  # number of the last message at or before y
    batch: tuple[Floats, Floats]  # mean and covariance of y by messages up to LAG later ones


def linear_system(seed: int) -> Linear:
    """Each message is followed by two moves; y is the state's first two numbers, at messages and
    between the moves.
    """
    rng = np.random.default_rng(seed)
    s, output = STATES, np.eye(2, STATES)

    def positive() -> Floats:
        root = rng.normal(size=(s, s))
        return np.asarray(root @ root.T + 0.1 * np.eye(s))

    moves = np.eye(s) + 0.3 * rng.normal(size=(2 * MESSAGES, s, s))
    noise = 0.2 * np.array([positive() for _ in range(2 * MESSAGES)])
    rows, variance = rng.normal(size=(MESSAGES, 1, s)), 0.5
    measured = rng.normal(size=MESSAGES)
    # batch: all states, two a message, in one vector; least squares in information form, one
    # message more at a time
    size = 2 * MESSAGES * s
    information, vector = np.zeros((size, size)), np.zeros(size)
    prior, start = positive(), rng.normal(size=s)
    information[:s, :s], vector[:s] = np.linalg.inv(prior), np.linalg.solve(prior, start)
    for i in range(2 * MESSAGES - 1):
        step = np.zeros((s, size))
        step[:, i * s : (i + 1) * s], step[:, (i + 1) * s : (i + 2) * s] = -moves[i], np.eye(s)
        information += step.T @ np.linalg.solve(noise[i], step)
    batch_by_message = []
    for i in range(MESSAGES):
        block = slice(2 * i * s, (2 * i + 1) * s)
        information[block, block] += rows[i].T @ rows[i] / variance
        vector[block] += rows[i, 0] * measured[i] / variance
        batch_by_message.append((np.linalg.solve(information, vector), np.linalg.inv(information)))
    # Kalman filter, and what the smoother needs of it
    x, P = start, prior
    beliefs, predicted, cross_to_next, outputs = [], [], [], []
    for i in range(MESSAGES):
        predicted.append((x, P))
        gain = P @ rows[i].T / (rows[i] @ P @ rows[i].T + variance)
        x, P = x + gain[:, 0] * (measured[i] - rows[i, 0] @ x), P - gain @ rows[i] @ P
        beliefs.append((x, P))
        first_move, second_move = moves[2 * i], moves[2 * i + 1]
        between_moves, spread = first_move @ x, first_move @ P @ first_move.T + noise[2 * i]
        cross_to_next.append(P @ (second_move @ first_move).T)
        outputs.append((output @ x, output @ P @ output.T, output @ cross_to_next[-1]))
        outputs.append(
            (output @ between_moves, output @ spread @ output.T, output @ spread @ second_move.T)
        )
        x, P = second_move @ between_moves, second_move @ spread @ second_move.T + noise[2 * i + 1]
    chain = Chain(
        *map(np.array, zip(*beliefs, strict=True)),
        *map(np.array, zip(*predicted, strict=True)),
        np.array(cross_to_next),
    )
    mean, covariance, cross = map(np.array, zip(*outputs, strict=True))
    latest = np.repeat(np.arange(MESSAGES), 2)
    state_and_message = [(i * s, min(m + LAG, MESSAGES - 1)) for i, m in enumerate(latest.tolist())]
    best = np.array([batch_by_message[m][0][k : k + 2] for k, m in state_and_message])
    spread = np.array([batch_by_message[m][1][k : k + 2, k : k + 2] for k, m in state_and_message])
    return Linear(chain, (mean, covariance), cross, latest, (best, spread))


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_system_is_smoothed_as_by_least_squares_over_the_window(seed: int) -> None:
    """An independent solution: the normal equations of all states and of the messages up to the
    lag.
    """
    linear = linear_system(seed)
    last = np.minimum(linear.latest + LAG, MESSAGES - 1)
    mean, covariance = smooth(
        linear.chain, linear.latest, last, linear.filtered, linear.cross_to_next
    )
    assert mean == pytest.approx(linear.batch[0], abs=1e-9)
    assert covariance == pytest.approx(linear.batch[1], abs=1e-9)
    reduction = np.linalg.eigvalsh(linear.filtered[1] - covariance)
    assert reduction.min() > -1e-12
    assert reduction[:-2].max(axis=1).min() > 1e-6


@pytest.mark.parametrize(
    "extra_row", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ids=["known exactly", "a copy"]
)
def test_a_state_that_adds_nothing_changes_nothing(extra_row: list[float]) -> None:
    """A fourth state that is zero, or equal to the second one: covariances are singular."""
    linear = linear_system(0)
    extension = np.vstack([np.eye(STATES), extra_row])
    extended = Chain(
        *(
            part @ extension.T if part.ndim == 2 else extension @ part @ extension.T
            for part in linear.chain
        )
    )
    last = np.minimum(linear.latest + LAG, MESSAGES - 1)
    expected = smooth(linear.chain, linear.latest, last, linear.filtered, linear.cross_to_next)
    actual = smooth(
        extended, linear.latest, last, linear.filtered, linear.cross_to_next @ extension.T
    )
    for expected_part, actual_part in zip(expected, actual, strict=True):
        assert actual_part == pytest.approx(expected_part, abs=1e-9)


def test_a_message_without_ranges_changes_nothing() -> None:
    """To the bit, the estimates are those without that message."""
    mission = Mission(steps=400, steps_per_message=50)
    measured = mission.measured(np.random.default_rng(4), compass=0.1)
    ranges, has_ranges = measured.ranges.copy(), np.arange(measured.message_step.size) != 3
    ranges[~has_ranges] = np.nan
    fields = ("message_step", "message", "ranges")
    other_messages: dict[str, Any] = {name: getattr(measured, name)[has_ranges] for name in fields}
    without_message = replace(measured, **other_messages)
    silent, absent = (
        SmoothingNavigator(TightSettings(), mission.start, 60.0).run(m)
        for m in (replace(measured, ranges=ranges), without_message)
    )
    assert (silent.state == absent.state).all()
    assert (silent.covariance == absent.covariance).all()


def test_without_a_later_message_smoothing_gives_the_filters_estimates() -> None:
    """To the bit: with a lag of 0 in all steps, and with a longer one where no message follows
    within it.
    """
    mission = Mission(steps=305, steps_per_message=50)
    measured = mission.measured(np.random.default_rng(2), log=0.2, compass=0.1)
    filtered = TightNavigator(TightSettings(), mission.start).run(measured)
    without_lag, smoothed = (
        SmoothingNavigator(TightSettings(), mission.start, lag).run(measured) for lag in (0.0, 10.0)
    )
    assert (without_lag.state == filtered.state).all()
    assert (without_lag.covariance == filtered.covariance).all()
    assert (smoothed.state[299:] == filtered.state[299:]).all()
    # 10 s reach from step 200 to the message of step 300, and not from 149 to that of 250 alone
    assert (np.abs(smoothed.state[:299, :2] - filtered.state[:299, :2]).max(axis=1) > 0).all()
    short_lag = SmoothingNavigator(TightSettings(), mission.start, 3.0).run(measured)
    untouched = (short_lag.state == filtered.state).all(axis=1)
    step = np.arange(1, 306)
    assert (untouched == ((-step % 50 > 30) | (step % 50 == 0) | (step > 300))).all()


class North(NamedTuple):
    """A navigator that goes north at constant speed until its only message comes in."""

    navigator: SmoothingNavigator
    steps: int
    speed: float

    def fly(self, turn: float = 0.0) -> None:
        """All steps; the heading of the last one is `turn` [rad], and the message comes with it."""
        for i in range(self.steps):
            heading = turn if i == self.steps - 1 else 0.0
            leader = LeaderMessage(0.1 * self.steps, 10.0, 5.0, 0.0, self.speed, 0.0)
            reception = Reception(leader, Ranges(11.0, 11.2, 11.1)) if i == self.steps - 1 else None
            self.navigator.step(OwnMotion(self.speed, heading, 0.0), reception)


def test_covariances_along_a_straight_way_north_are_those_of_its_integrals() -> None:
    """x_t = x_0 − v ∫ b_θ and y_t = y_0 − ∫ b_v, whose covariances with those at the end are
    integrals by hand.
    """
    settings = TightSettings(slip=0.05)
    speed, steps = 1.3, 40
    north = North(SmoothingNavigator(settings, np.zeros(4), 60.0), steps, speed)
    north.fly()
    before, received = north.navigator._priors[0]
    leg = _Leg(before, received, north.navigator._model, (0.0, 0.0))
    model = north.navigator._model
    end, q_log, q_compass = 0.1 * steps, model.log_walk[0], model.compass_walk[0]
    for k in (1, 13, steps - 1):
        t = 0.1 * k
        mean, covariance, cross_to_end = leg.at(north.navigator._motions[k - 1])
        assert mean == pytest.approx([0.0, speed * t, 0.0, speed])
        double_integral = t**3 / 3 + t**2 / 2 * (end - t)
        reading_variance = (
            t * 0.1 * np.array([speed**2 * settings.heading_sigma**2, settings.speed_sigma**2])
            + 0.05**2 * t
        )
        east = (
            0.01**2
            + speed**2 * (t * end * settings.heading_bias_sigma**2 + q_compass * double_integral)
            + reading_variance[0]
        )
        along = (
            0.01**2
            + t * end * settings.speed_bias_sigma**2
            + q_log * double_integral
            + reading_variance[1]
        )
        assert cross_to_end[0, X] == pytest.approx(east, rel=1e-12)
        assert cross_to_end[1, Y] == pytest.approx(along, rel=1e-12)
        # vy = v − b_v, and vx = −v b_θ
        single_integral = t**2 / 2 + t * (end - t)
        assert cross_to_end[3, Y] == pytest.approx(
            end * settings.speed_bias_sigma**2 + q_log * single_integral, rel=1e-12
        )
        sideways = speed**2 * (end * settings.heading_bias_sigma**2 + q_compass * single_integral)
        assert cross_to_end[2, X] == pytest.approx(sideways, rel=1e-12)
        assert cross_to_end[3, LOG_BIAS] == pytest.approx(
            -(settings.speed_bias_sigma**2) - q_log * t, rel=1e-12
        )
        assert covariance[0, 0] == pytest.approx(
            0.01**2
            + speed**2 * (t**2 * settings.heading_bias_sigma**2 + q_compass * t**3 / 3)
            + reading_variance[0],
            rel=1e-12,
        )
        assert covariance[3, 3] == pytest.approx(
            settings.speed_bias_sigma**2 + q_log * t + settings.speed_sigma**2, rel=1e-12
        )


def test_the_prediction_includes_turns_and_both_drifts() -> None:
    """A turn gives a drifting compass 3 % of itself, and the drift changes its mode 0.004 times
    a second.
    """
    turn, steps = 0.5, 20
    settings = TightSettings(assume=Assume(drift=True, deviation=True))
    north = North(SmoothingNavigator(settings, np.zeros(4), 60.0), steps, 1.0)
    north.fly(turn)
    model = north.navigator._model
    before, received = north.navigator._priors[0]
    before["weight"][0, :2] = 0.9, 0.1
    leg = _Leg(before, received, model, (0.0, 0.0))
    slow_weight = 0.5 + 0.4 * np.exp(-2.0 * 0.004 * 0.1 * steps)
    drift = (
        0.1
        * steps
        * (slow_weight * model.compass_walk[0] + (1.0 - slow_weight) * model.compass_walk[1])
    )
    variance = settings.heading_bias_sigma**2 + (0.03 * turn) ** 2 + drift
    assert leg.predicted_covariance[COMPASS_BIAS, COMPASS_BIAS] == pytest.approx(
        variance, rel=1e-12
    )
    assert leg.cross_to_next[COMPASS_BIAS, COMPASS_BIAS] == pytest.approx(
        settings.heading_bias_sigma**2, rel=1e-12
    )


@pytest.mark.parametrize(
    ("assume", "transmitters", "known_start"),
    [(Assume(), 3, True), (Assume(), 2, True), (EVERYTHING, 3, True), (Assume(), 3, False)],
)
def test_smoothing_reduces_errors_and_covariance_consistently(
    assume: Assume, transmitters: int, known_start: bool
) -> None:
    """Over runs with noise and biases of the settings: less error and less covariance, and a NEES
    near 2.

    An unknown start stays unknown until the first message.
    """
    mission = Mission(steps=1000, steps_per_message=50)
    settings = TightSettings(assume=assume, transmitters=transmitters)
    start, first = (mission.start, 0) if known_start else (None, 49)
    truth = mission.follower[1:]
    squares, normalised = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        log, compass, scale = rng.normal(0, (0.3, np.deg2rad(8.0), 0.2))
        measured = mission.measured(rng, log=log, compass=compass, scale=scale)
        plain = TightNavigator(settings, start).run(measured)
        smoothed = SmoothingNavigator(settings, start, 60.0).run(measured)
        both = (plain, smoothed)
        assert all(np.isnan(e.state[:first]).all() for e in both)
        squares.append(
            [np.sum((e.state[first:, :2] - truth[first:]) ** 2, axis=1).mean() for e in both]
        )
        normalised.append(np.mean(nees(smoothed, truth)[first:]))
        wide, narrow = (e.covariance[first:, :2, :2] for e in both)
        assert np.linalg.eigvalsh(narrow).min() > 0
        assert np.trace(narrow, axis1=1, axis2=2).mean() < np.trace(wide, axis1=1, axis2=2).mean()
    before, after = np.mean(squares, axis=0)
    assert after < 0.8**2 * before
    assert 1.0 < np.mean(normalised) < 3.0


@pytest.mark.parametrize("lag", [-1.0, np.nan, np.inf])
def test_a_lag_that_is_no_finite_time_is_refused(lag: float) -> None:
    with pytest.raises(ValueError, match="expected a finite time"):
        SmoothingNavigator(TightSettings(), np.zeros(4), lag)
