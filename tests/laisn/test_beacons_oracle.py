"""The navigator among beacons against one that is written independently, range by range."""

import re
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.beacons import (
    MEDIA,
    BeaconNavigator,
    BeaconSettings,
    RangeMeasurement,
    add_ring,
    new_belief,
    prune_and_merge,
    split,
    with_beacon,
)
from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.settings import Settings
from tests.laisn.beacon_oracle import BeaconOracle

PLACES = np.array([[-20.0, 5.0, 3.0], [25.0, -10.0, 0.0], [8.0, 40.0, 12.0]])
DT = 1.0


@dataclass(frozen=True, kw_only=True)
class Trip:
    """A vehicle that circles among three beacons; all else follows from the seed."""

    seed: int = 0
    steps: int = 30
    received: float = 0.5
    """Share of ranges that arrive."""
    wrong: float = 0.0
    """Share of these that are wrong."""
    first_wrong: int = 0
    """Steps at the start whose ranges are all wrong."""
    carried: int = 1000
    """Step at which the vehicle is moved elsewhere."""
    robot: bool = False
    """Whether the first beacon is a robot that goes by odometry whose heading errs."""

    def readings(self) -> tuple[list[tuple[OwnMotion, Reception, float]], Floats]:
        """Readings and receptions of the vehicle in each step, and its start."""
        rng = np.random.default_rng(self.seed)
        begin = place = np.array([-3.0, 2.0])
        heading, steps = rng.uniform(-3.0, 3.0), []
        places = PLACES.copy()
        claimed = PLACES.copy()
        for k in range(self.steps):
            time, heading = float(rng.uniform(0.5, 1.5)), heading + 0.3 * rng.normal()
            place = place + 1.4 * time * np.array([np.sin(heading), np.cos(heading)])
            place = place + (np.array([30.0, 25.0]) if k == self.carried else 0.0)
            if self.robot:
                course = 0.1 * k
                step = 0.9 * time * np.array([np.sin(course), np.cos(course)])
                claimed[0, :2] += step
                places[0, :2] += 0.9 * time * np.array([np.sin(course - 0.2), np.cos(course - 0.2)])
            ranges = np.linalg.norm(places - [*place, 4.3], axis=1) * 1.01 + 0.3 * rng.normal(
                size=3
            )
            wrong = rng.random(3) < (1.0 if k < self.first_wrong else self.wrong)
            ranges = np.abs(ranges + wrong * rng.uniform(-15.0, 25.0, 3))
            ranges[rng.random(3) > self.received] = np.nan
            own = OwnMotion(1.4 + 0.05 * rng.normal(), heading + 0.03 + 0.004 * k, 4.5)
            message = LeaderMessage(float(k), 0.0, 0.0, 0.0, 0.0, 0.0)
            if self.robot:
                message = LeaderMessage(float(k), *claimed[0, :2].tolist(), 0.1 * k, 0.9, 0.0)
            received = Reception(message, Ranges(*ranges.tolist()), claimed.copy())
            steps.append((own, received, time))
        return steps, np.array([*begin, 0.0, 0.0])


RADIO = BeaconSettings(dt=DT, hydrophone_height=0.2)
SOUND = replace(MEDIA["water"], gyro_bias_sigma=0.0, range_sigma=0.2)


@pytest.mark.parametrize(
    ("settings", "trip"),
    [
        (RADIO, Trip()),
        (SOUND, Trip(seed=1, wrong=0.1)),
        (replace(SOUND, known_start=False), Trip(seed=2, steps=9)),
        (replace(RADIO, known_start=False), Trip(seed=3, steps=3, first_wrong=2)),
        (
            replace(RADIO, start_sigma=6.0, speed_scale_sigma=0.0),
            Trip(seed=4, received=0.7, carried=12),
        ),
        (
            replace(RADIO, track_slip=0.1, track_heading_walk=0.03),
            Trip(seed=5, received=0.7, robot=True),
        ),
        (
            replace(RADIO, known_start=False, track_heading_walk=0.02, gyro_bias_sigma=0.0),
            Trip(seed=6, steps=9, robot=True),
        ),
    ],
    ids=[
        "radio",
        "sound",
        "unknown start",
        "wrong start",
        "carried away",
        "robot",
        "robot anywhere",
    ],
)
def test_an_independent_navigator_agrees(settings: BeaconSettings, trip: Trip) -> None:
    """Mixtures to rounding; splits, wrong ranges, rings and estimated variances of ranges one by
    one.
    """
    steps, start = trip.readings()
    begin = start if settings.known_start else None
    navigator = BeaconNavigator(settings, begin)
    order: list[int] = []
    for _, reception, _ in steps:
        order += [i for i in range(3) if not np.isnan(reception.ranges[i]) and i not in order]
    robots = (order.index(0),) if trip.robot else ()
    oracle = BeaconOracle(settings, PLACES[order], begin, robots)
    now = 0.0
    for own, reception, time in steps:
        (update,) = navigator.step(own, reception, time)
        oracle.advance(own.speed, own.heading, time)
        received = [i for i in range(3) if not np.isnan(reception.ranges[i])]
        depth = own.depth - settings.hydrophone_height
        now += time
        used = []
        for i in received:
            if order.index(i) in robots:
                oracle.follow(order.index(i), reception.transmitters[i], now)
            used.append(oracle.receive_range(order.index(i), reception.ranges[i], depth))
        mean, covariance = oracle.now(own.speed, own.heading)
        np.testing.assert_allclose(navigator.state, mean, rtol=0, atol=1e-7)
        np.testing.assert_allclose(navigator.covariance, covariance, rtol=1e-6, atol=1e-9)
        assert navigator.evidence == pytest.approx(oracle.evidence, abs=1e-7)
        kind = FixKind.ONE_RANGE if any(used) else (FixKind.GATED if received else FixKind.LOST)
        assert update.kind == kind
        np.testing.assert_allclose(update.position, mean[:2], rtol=0, atol=1e-7)
        assert update.sigma == pytest.approx(
            np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])), nan_ok=True
        )
        b = navigator._belief
        assert b.n_hypotheses[0] == len(oracle.mixture)
        np.testing.assert_allclose(b.variance, oracle.variance[: b.variance.size], rtol=1e-9)
        for k, c in enumerate(oracle.mixture[:3]):
            np.testing.assert_allclose(b.state[k], c.x[: b.prior_variance.size], rtol=0, atol=1e-7)
            assert b.weight[k] == pytest.approx(c.weight, rel=1e-6)


def test_the_heaviest_components_are_kept_and_the_heaviest_of_all_comes_first() -> None:
    """Three hundred far from each other, ten of them of next to no weight."""
    b = new_belief(RADIO, (0.0, 0.0))
    rng, count = np.random.default_rng(3), 300
    weight = rng.uniform(0.5, 1.5, count)
    weight[rng.choice(count, 10, replace=False)] = 1e-7
    b.n_hypotheses[0], b.weight[:count] = count, weight / weight.sum()
    b.state[:count, 0], b.covariance[:count] = (
        100.0 * np.arange(count),
        np.eye(b.prior_variance.size),
    )
    prune_and_merge(b)
    kept = np.sort(weight)[-256:]
    assert b.n_hypotheses[0] == 256
    assert b.state[0, 0] == 100.0 * np.argmax(weight)
    np.testing.assert_allclose(np.sort(b.weight[:256]), kept / kept.sum(), rtol=1e-12)
    np.testing.assert_allclose(
        np.sort(weight[(b.state[:256, 0] / 100.0).astype(int)]), kept, rtol=1e-12
    )


def test_where_there_is_no_room_for_more_nothing_is_split_and_no_ring_is_added() -> None:
    """1024 components at most: of 1022 that are wide one is split, and a ring of 48 must leave a
    place free.
    """
    b, z = (
        with_beacon(new_belief(RADIO, None), RADIO),
        RangeMeasurement(0, 0.0, 0.0, 0.0, 20.0, 0.25, -0.05, -6.0),
    )
    for alive, after in ((1022, 1024), (1023, 1023)):
        b.n_hypotheses[0], b.weight[:alive], b.state[:alive, 1] = alive, 1.0 / alive, 20.0
        b.covariance[:alive] = 100.0 * np.eye(b.prior_variance.size)
        split(b, z)
        assert b.n_hypotheses[0] == after
    # what is not alive any more is left alone
    b.n_hypotheses[0], b.covariance[0] = 1, 0.01 * np.eye(b.prior_variance.size)
    split(b, z)
    assert b.n_hypotheses[0] == 1
    for alive, after in ((976, 976), (975, 1023)):
        b.n_hypotheses[0], b.weight[:alive] = alive, 1.0 / alive
        add_ring(b, z, 0.1, False)
        assert b.n_hypotheses[0] == after


def test_positions_are_one_within_a_third_of_their_spread() -> None:
    """Squared distance 0.3 in units of the mean covariance, across a correlated one."""
    spread = np.array([[4.0, 1.5], [1.5, 1.0]])
    for aside, alive in ((0.54, 1), (0.56, 2)):
        b = new_belief(RADIO, (0.0, 0.0))
        b.n_hypotheses[0], b.weight[:2] = 2, [0.25, 0.75]
        b.covariance[:2] = np.eye(b.prior_variance.size)
        b.covariance[0, :2, :2], b.covariance[1, :2, :2] = 0.5 * spread, 1.5 * spread
        root = np.linalg.cholesky(spread)
        b.state[1, :2] = aside * root @ [0.6, 0.8]
        prune_and_merge(b)
        assert b.n_hypotheses[0] == alive
        # the heavier one comes first; together they lie at their mean
        expected = (0.75 if alive == 1 else 1.0) * aside * root @ [0.6, 0.8]
        np.testing.assert_allclose(b.state[0, :2], expected, rtol=1e-12)


def test_settings_of_media_are_those_of_the_documents() -> None:
    """docs/real-ranges.md has a table of them, in degrees where a name ends in it."""
    text = (Path(__file__).parents[2] / "docs" / "real-ranges.md").read_text(encoding="utf-8")
    table = re.findall(
        r"^\| (`.*) \| (.+) \| (.+) \|$",
        text.partition("| key `beacons.…` |")[2],
        flags=re.MULTILINE,
    )
    counted = 0
    for keys, *columns in table:
        for medium, column in zip(("air", "water"), columns, strict=True):
            for key, value in zip(re.findall(r"`(\w+)`", keys), column.split(", "), strict=True):
                expected = np.deg2rad(float(value)) if "_deg" in key else float(value)
                actual = getattr(
                    MEDIA[medium], re.sub(r"_(m|m_s|m_sqrt_s|deg|deg_s|deg_sqrt_s)$", "", key)
                )
                assert actual == pytest.approx(expected), key
                counted += 1
    # those of all navigators, and the start
    others = {item.name for item in fields(Settings)} | {"known_start"}
    assert counted == 2 * len({item.name for item in fields(BeaconSettings)} - others)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_readings_at_the_limits_are_taken_and_those_beyond_them_refused(sign: float) -> None:
    """50 m/s of the odometry, ranges of 100 km."""

    def step(speed: float = 1.0, farthest: float = 20.0) -> None:
        message = LeaderMessage(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        reception = Reception(message, Ranges(np.nan, farthest, np.nan), PLACES)
        BeaconNavigator(RADIO, np.zeros(4)).step(OwnMotion(speed, 0.0, 4.5), reception)

    step(50.0 * sign)
    step(farthest=1e5 if sign > 0.0 else 0.0)
    with pytest.raises(LaisnError, match="the speed is"):
        step(50.0 * sign * (1.0 + 1e-12))
    with pytest.raises(LaisnError, match="expected 0"):
        step(farthest=1e5 * (1.0 + 1e-12) if sign > 0.0 else -1e-9)
