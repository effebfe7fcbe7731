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
    """A random linear system: its Kalman filter as a chain, two quantities a message, and its
    batch solution.
    """

    chain: Chain
    filtered: tuple[Floats, Floats]
    onward: Floats
    latest: Ints
    batch: tuple[Floats, Floats]


def linear_system(seed: int) -> Linear:
    """Each message is followed by two moves; y is the state's first two numbers, at messages and
    between the moves.
    """
    rng = np.random.default_rng(seed)
    s, read = STATES, np.eye(2, STATES)

    def positive() -> Floats:
        root = rng.normal(size=(s, s))
        return np.asarray(root @ root.T + 0.1 * np.eye(s))

    moves = np.eye(s) + 0.3 * rng.normal(size=(2 * MESSAGES, s, s))
    noise = 0.2 * np.array([positive() for _ in range(2 * MESSAGES)])
    rows, variance = rng.normal(size=(MESSAGES, 1, s)), 0.5
    seen = rng.normal(size=MESSAGES)
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
    known = []
    for i in range(MESSAGES):
        here = slice(2 * i * s, (2 * i + 1) * s)
        information[here, here] += rows[i].T @ rows[i] / variance
        vector[here] += rows[i, 0] * seen[i] / variance
        known.append((np.linalg.solve(information, vector), np.linalg.inv(information)))
    # Kalman filter, and what the smoother needs of it
    x, P = start, prior
    beliefs, predicted, onward, ys = [], [], [], []
    for i in range(MESSAGES):
        predicted.append((x, P))
        gain = P @ rows[i].T / (rows[i] @ P @ rows[i].T + variance)
        x, P = x + gain[:, 0] * (seen[i] - rows[i, 0] @ x), P - gain @ rows[i] @ P
        beliefs.append((x, P))
        one, other = moves[2 * i], moves[2 * i + 1]
        half, spread = one @ x, one @ P @ one.T + noise[2 * i]
        onward.append(P @ (other @ one).T)
        ys.append((read @ x, read @ P @ read.T, read @ onward[-1]))
        ys.append((read @ half, read @ spread @ read.T, read @ spread @ other.T))
        x, P = other @ half, other @ spread @ other.T + noise[2 * i + 1]
    chain = Chain(
        *map(np.array, zip(*beliefs, strict=True)),
        *map(np.array, zip(*predicted, strict=True)),
        np.array(onward),
    )
    mean, covariance, cross = map(np.array, zip(*ys, strict=True))
    latest = np.repeat(np.arange(MESSAGES), 2)
    picked = [(i * s, min(m + LAG, MESSAGES - 1)) for i, m in enumerate(latest.tolist())]
    best = np.array([known[m][0][k : k + 2] for k, m in picked])
    spread = np.array([known[m][1][k : k + 2, k : k + 2] for k, m in picked])
    return Linear(chain, (mean, covariance), cross, latest, (best, spread))


@pytest.mark.parametrize("seed", range(3))
def test_a_linear_system_is_smoothed_as_by_least_squares_over_the_window(seed: int) -> None:
    """An independent solution: the normal equations of all states and of the messages up to the
    lag.
    """
    made = linear_system(seed)
    last = np.minimum(made.latest + LAG, MESSAGES - 1)
    mean, covariance = smooth(made.chain, made.latest, last, made.filtered, made.onward)
    assert mean == pytest.approx(made.batch[0], abs=1e-9)
    assert covariance == pytest.approx(made.batch[1], abs=1e-9)
    less = np.linalg.eigvalsh(made.filtered[1] - covariance)
    assert less.min() > -1e-12
    assert less[:-2].max(axis=1).min() > 1e-6


@pytest.mark.parametrize(
    "more", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], ids=["known exactly", "a copy"]
)
def test_a_state_that_adds_nothing_changes_nothing(more: list[float]) -> None:
    """Covariances are singular then."""
    made = linear_system(0)
    wide = np.vstack([np.eye(STATES), more])
    wider = Chain(
        *(part @ wide.T if part.ndim == 2 else wide @ part @ wide.T for part in made.chain)
    )
    last = np.minimum(made.latest + LAG, MESSAGES - 1)
    plain = smooth(made.chain, made.latest, last, made.filtered, made.onward)
    other = smooth(wider, made.latest, last, made.filtered, made.onward @ wide.T)
    for one, same in zip(plain, other, strict=True):
        assert same == pytest.approx(one, abs=1e-9)


def test_a_message_without_ranges_changes_nothing() -> None:
    """The way goes on as if there had been none."""
    mission = Mission(steps=400, every=50)
    measured = mission.measured(np.random.default_rng(4), compass=0.1)
    ranges, kept = measured.ranges.copy(), np.arange(measured.message_step.size) != 3
    ranges[~kept] = np.nan
    named = ("message_step", "message", "ranges")
    some: dict[str, Any] = {name: getattr(measured, name)[kept] for name in named}
    fewer = replace(measured, **some)
    silent, absent = (
        SmoothingNavigator(TightSettings(), mission.start, 60.0).run(m)
        for m in (replace(measured, ranges=ranges), fewer)
    )
    assert (silent.state == absent.state).all()
    assert (silent.covariance == absent.covariance).all()


def test_without_a_later_message_it_is_the_filter() -> None:
    """With no lag everywhere, to the bit; with one, after the last message of all."""
    mission = Mission(steps=305, every=50)
    measured = mission.measured(np.random.default_rng(2), log=0.2, compass=0.1)
    plain = TightNavigator(TightSettings(), mission.start).run(measured)
    same, smoothed = (
        SmoothingNavigator(TightSettings(), mission.start, lag).run(measured) for lag in (0.0, 10.0)
    )
    assert (same.state == plain.state).all()
    assert (same.covariance == plain.covariance).all()
    assert (smoothed.state[299:] == plain.state[299:]).all()
    # 10 s reach from step 200 to the message of step 300, and not from 149 to that of 250 alone
    assert (np.abs(smoothed.state[:299, :2] - plain.state[:299, :2]).max(axis=1) > 0).all()
    early = SmoothingNavigator(TightSettings(), mission.start, 3.0).run(measured)
    untouched = (early.state == plain.state).all(axis=1)
    step = np.arange(1, 306)
    assert (untouched == ((-step % 50 > 30) | (step % 50 == 0) | (step > 300))).all()


class North(NamedTuple):
    """A navigator that goes north at constant speed to one message."""

    navigator: SmoothingNavigator
    steps: int
    speed: float

    def fly(self, turn: float = 0.0) -> None:
        """Turn at the last step."""
        for i in range(self.steps):
            heading = turn if i == self.steps - 1 else 0.0
            leader = LeaderMessage(0.1 * self.steps, 10.0, 5.0, 0.0, self.speed, 0.0)
            there = Reception(leader, Ranges(11.0, 11.2, 11.1)) if i == self.steps - 1 else None
            self.navigator.step(OwnMotion(self.speed, heading, 0.0), there)


def test_covariances_along_a_straight_way_north_are_those_of_its_integrals() -> None:
    """x_t = x_0 − v ∫ b_θ and y_t = y_0 − ∫ b_v, whose covariances with those at the end are
    integrals by hand.
    """
    settings = TightSettings(slip=0.05)
    speed, steps = 1.3, 40
    north = North(SmoothingNavigator(settings, np.zeros(4), 60.0), steps, speed)
    north.fly()
    before, received = north.navigator._priors[0]
    way = _Leg(before, received, north.navigator._model, (0.0, 0.0))
    model = north.navigator._model
    end, q_log, q_compass = 0.1 * steps, model.log_walk[0], model.compass_walk[0]
    for k in (1, 13, steps - 1):
        t = 0.1 * k
        mean, covariance, onward = way.at(north.navigator._motions[k - 1])
        assert mean == pytest.approx([0.0, speed * t, 0.0, speed])
        walk = t**3 / 3 + t**2 / 2 * (end - t)
        seen = (
            t * 0.1 * np.array([speed**2 * settings.heading_sigma**2, settings.speed_sigma**2])
            + 0.05**2 * t
        )
        east = (
            0.01**2
            + speed**2 * (t * end * settings.heading_bias_sigma**2 + q_compass * walk)
            + seen[0]
        )
        along = 0.01**2 + t * end * settings.speed_bias_sigma**2 + q_log * walk + seen[1]
        assert onward[0, X] == pytest.approx(east, rel=1e-12)
        assert onward[1, Y] == pytest.approx(along, rel=1e-12)
        # vy = v − b_v, and vx = −v b_θ
        so_far = t**2 / 2 + t * (end - t)
        assert onward[3, Y] == pytest.approx(
            end * settings.speed_bias_sigma**2 + q_log * so_far, rel=1e-12
        )
        sideways = speed**2 * (end * settings.heading_bias_sigma**2 + q_compass * so_far)
        assert onward[2, X] == pytest.approx(sideways, rel=1e-12)
        assert onward[3, LOG_BIAS] == pytest.approx(
            -(settings.speed_bias_sigma**2) - q_log * t, rel=1e-12
        )
        assert covariance[0, 0] == pytest.approx(
            0.01**2
            + speed**2 * (t**2 * settings.heading_bias_sigma**2 + q_compass * t**3 / 3)
            + seen[0],
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
    way = _Leg(before, received, model, (0.0, 0.0))
    slow = 0.5 + 0.4 * np.exp(-2.0 * 0.004 * 0.1 * steps)
    drift = 0.1 * steps * (slow * model.compass_walk[0] + (1.0 - slow) * model.compass_walk[1])
    variance = settings.heading_bias_sigma**2 + (0.03 * turn) ** 2 + drift
    assert way.predicted_covariance[COMPASS_BIAS, COMPASS_BIAS] == pytest.approx(
        variance, rel=1e-12
    )
    assert way.cross_to_next[COMPASS_BIAS, COMPASS_BIAS] == pytest.approx(
        settings.heading_bias_sigma**2, rel=1e-12
    )


@pytest.mark.parametrize(
    ("assume", "transmitters", "known"),
    [(Assume(), 3, True), (Assume(), 2, True), (EVERYTHING, 3, True), (Assume(), 3, False)],
)
def test_smoothing_reduces_errors_and_covariance_consistently(
    assume: Assume, transmitters: int, known: bool
) -> None:
    """Over runs with noise and biases of the settings: less error and less covariance, and a NEES
    near 2.

    An unknown start stays unknown until the first message.
    """
    mission = Mission(steps=1000, every=50)
    settings = TightSettings(assume=assume, transmitters=transmitters)
    start, first = (mission.start, 0) if known else (None, 49)
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
def test_a_lag_is_a_time(lag: float) -> None:
    with pytest.raises(ValueError, match="expected a finite time"):
        SmoothingNavigator(TightSettings(), np.zeros(4), lag)
