"""Pings that leave one after the other, messages that are late, and a leader that errs about its
place: straight ways without noise, and posteriors in closed form.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.delays import delays_of
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges, Reception
from laisn.navigators import find
from laisn.settings import NavigationSettings, RivalSettings, Settings, TightSettings

DT = 0.1
SLOT = 0.2
SOUND = 1500.0
EAST = np.pi / 2
CURRENT = np.array([0.1, -0.2])
LEADER_SPEED = 1.4
START = np.array([-15.0, 20.0])
EVERY = 20

HULL = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.1]])
"""Transmitters of a leader that heads east."""


def leader_at(time: float) -> Floats:
    return np.array([LEADER_SPEED, 0.0]) * time + CURRENT * time


def follower_at(time: float) -> Floats:
    return START + np.array([0.8, 0.6]) * time + CURRENT * time


HEADING = float(np.arctan2(0.8, 0.6))


def arrival(i: int, sent: float) -> tuple[float, float]:
    """When ping i of a message arrives, and its range, by its definition."""
    leaves = sent + i * SLOT
    source = leader_at(leaves) + HULL[i]
    arrives = leaves
    for _ in range(10):
        distance = float(np.hypot(*(follower_at(arrives) - source)))
        arrives = leaves + distance / SOUND
    return arrives, distance


def mission(delay: float, duration: float = 120.0) -> tuple[Measurements, Floats]:
    """Readings without errors of a straight mission whose messages are handed over so much later
    than their last ping; and true places.
    """
    n = round(duration / DT)
    steps = []
    messages = []
    ranges = []
    for sent_step in range(EVERY, n - 50, EVERY):
        sent = sent_step * DT
        times, distances = zip(*(arrival(i, sent) for i in range(3)), strict=True)
        steps.append(int(np.ceil((max(times) + delay) / DT - 1e-9)))
        messages.append([sent, *leader_at(sent), EAST, LEADER_SPEED, 10.0, *[np.nan] * 4])
        ranges.append(distances)
    measured = Measurements(
        dt=DT,
        speed=np.ones(n),
        heading=np.full(n, HEADING),
        depth=np.full(n, 10.0),
        message_step=np.array(steps),
        message=np.array(messages),
        ranges=np.array(ranges),
    )
    return measured, np.array([follower_at(DT * k) for k in range(1, n + 1)])


SENSORS: dict[str, Any] = {
    "range_scale_bias_sigma": 0.001,
    "range_scale_sigma": 0.001,
    "speed_sigma": 0.02,
    "heading_sigma": 0.01,
    "speed_bias_sigma": 0.01,
    "heading_bias_sigma": 0.01,
}
TIMES: dict[str, Any] = {"ping_slot": SLOT, "sound_slowness": 1.0 / SOUND}


def settings_of(variant: str, compensate: bool) -> Settings:
    times = TIMES | {"compensate_motion": compensate}
    if variant.startswith("laisn"):
        return NavigationSettings(variant=variant, **times)  # type: ignore[arg-type]
    if variant == "tight":
        made = TightSettings(**times, **SENSORS)
    else:
        made = RivalSettings(**times, **SENSORS)
    assume = type(made.assume)(current=True)
    return type(made)(**{**made.__dict__, "assume": assume, "current_sigma": 0.3})


def last_error(variant: str, delay: float, compensate: bool) -> float:
    """Mean error of the last half of a mission [m]."""
    if variant == "factor-graph" and find_spec("gtsam") is None:
        pytest.skip("GTSAM is not installed")
    measured, truth = mission(delay)
    start = np.array([*START, 0.8, 0.6])
    navigator = find(variant).make(settings_of(variant, compensate), start)
    estimates = navigator.run(measured)
    errors = np.hypot(*(estimates.state[:, :2] - truth).T)
    return float(errors[errors.size // 2 :].mean())


@pytest.mark.parametrize(
    ("variant", "most"),
    [("tight", 0.03), ("ekf", 0.03), ("imm", 0.05), ("factor-graph", 0.03), ("laisn-3-2", 0.6)],
)
@pytest.mark.parametrize("delay", [0.0, 1.0])
def test_both_ways_between_pings_and_since_their_reception_count(
    variant: str, most: float, delay: float
) -> None:
    """In a second the follower has gone 1.1 m over ground; in two slots both went 0.4 m apart.

    LAISN knows no current.
    """
    error = last_error(variant, delay, compensate=True)
    assert error < most
    assert last_error(variant, delay, compensate=False) > 2.0 * error


def test_delays_by_hand() -> None:
    """Sent at 10 s; the last ping leaves at 10.4 s and travels 0.02 s; at 11 s."""
    settings = TightSettings(ping_slot=0.2, sound_slowness=1.0 / 1500.0)
    message = LeaderMessage(10.0, 0.0, 0.0, 0.0, 1.0, 5.0)
    ranges = Ranges(15.0, np.nan, 30.0)
    lag, drift_time = delays_of(message, ranges, 11.0, settings)
    np.testing.assert_allclose(lag, [0.99, np.nan, 0.58])
    np.testing.assert_allclose(drift_time, [0.99, np.nan, 0.98])
    # a clock that has nothing to do with the message's, or a message without a time: the last ping
    # is in just now
    for stated, clock in ((message, 9.0), (message, 1e9), (message._replace(timestamp=0.0), 3.0)):
        lag, drift_time = delays_of(stated, ranges, clock, settings)
        np.testing.assert_allclose(lag, [0.41, np.nan, 0.0], atol=1e-12)
        np.testing.assert_allclose(drift_time, [0.41, np.nan, 0.40], atol=1e-12)


SIGMA = 0.5
WIDE = {"baseline": 20.0, "middle_offset": 10.0}
EXACT = {
    "range_scale_bias_sigma": 0.0,
    "range_scale_sigma": 0.0,
    "speed_bias_sigma": 0.0,
    "heading_bias_sigma": 0.0,
    "range_sigma": 1e-3,
}


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("variant", ["tight", "ekf", "factor-graph"])
def test_a_leader_that_errs_about_its_place_leaves_a_follower_what_it_knew(
    variant: str, stated: bool
) -> None:
    """Ranges from three sites far apart show where the leader is: of a prior N(0, 0.5²) and a
    measurement N(e, σ²) of a place along each axis the posterior has 1 / (1/0.5² + 1/σ²).

    The message states twice the σ of the settings, or nothing.
    """
    if variant == "factor-graph" and find_spec("gtsam") is None:
        pytest.skip("GTSAM is not installed")
    kind = TightSettings if variant == "tight" else RivalSettings
    settings = kind(start_sigma=0.5, leader_position_sigma=SIGMA, **WIDE, **EXACT)
    sigma = 2.0 * SIGMA if stated else SIGMA
    sites = np.array([[-10.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    place = np.array([3.0, -30.0])
    ranges = Ranges(*np.hypot(*(place - sites).T).tolist())
    error = np.array([0.3, -0.2])
    message = LeaderMessage(
        DT, *error.tolist(), EAST, 0.0, 10.0, position_sigma=sigma if stated else np.nan
    )
    navigator = find(variant).make(settings, np.array([*place, 0.0, 0.0]))
    navigator.step(OwnMotion(0.0, EAST, 10.0), Reception(message, ranges))
    known = 1.0 / (1.0 / 0.5**2 + 1.0 / sigma**2)
    expected = place + error * known / sigma**2
    np.testing.assert_allclose(navigator.state[:2], expected, atol=0.02)
    covariance = navigator.covariance[:2, :2]
    np.testing.assert_allclose(np.diag(covariance), known, rtol=0.05)
    assert abs(covariance[0, 1]) < 0.05 * known


def test_a_walk_of_the_leaders_position_is_told_from_the_followers_own() -> None:
    """A follower at rest beside a leader at rest whose broadcast walks off by 0.05 m a second.

    Dead reckoning that is exact shows that it is the leader's position that walks.
    """
    settings = TightSettings(
        start_sigma=0.01,
        leader_position_walk=0.1,
        speed_sigma=1e-3,
        heading_sigma=1e-3,
        **EXACT,  # type: ignore[arg-type]
    )
    unaware = TightSettings(
        start_sigma=0.01,
        speed_sigma=1e-3,
        heading_sigma=1e-3,
        **EXACT,  # type: ignore[arg-type]
    )
    place = np.array([12.0, -9.0])
    ranges = Ranges(*np.hypot(*(place - HULL).T).tolist())
    errors = []
    for one in (settings, unaware):
        navigator = find("tight").make(one, np.array([*place, 0.0, 0.0]))
        for second in range(1, 41):
            for _ in range(9):
                navigator.step(OwnMotion(0.0, EAST, 10.0))
            message = LeaderMessage(float(second), 0.05 * second, 0.0, EAST, 0.0, 10.0)
            navigator.step(OwnMotion(0.0, EAST, 10.0), Reception(message, ranges))
        errors.append(float(np.hypot(*(navigator.state[:2] - place))))
    assert errors[0] < 0.1
    assert errors[1] > 1.0
