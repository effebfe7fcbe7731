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
    """A vehicle that wanders among three beacons; all else follows from the seed."""

    seed: int = 0
    steps: int = 30
    received_share: float = 0.5
    """Share of ranges that arrive."""
    wrong_share: float = 0.0
    """Share of these that are wrong."""
    wrong_steps: int = 0
    """Steps at the start whose ranges are all wrong."""
    carried_at: int = 1000
    """Step at which the vehicle is displaced by 39 m without odometry."""
    has_robot: bool = False
    """Whether the first beacon is a robot that moves by odometry with an error of its heading."""

    def readings(self) -> tuple[list[tuple[OwnMotion, Reception, float]], Floats]:
        """Readings and receptions of the vehicle in each step, and its start."""
        rng = np.random.default_rng(self.seed)
        start_position = position = np.array([-3.0, 2.0])
        heading, steps = rng.uniform(-3.0, 3.0), []
        true_beacons = PLACES.copy()
        claimed_beacons = PLACES.copy()
        for k in range(self.steps):
            duration, heading = float(rng.uniform(0.5, 1.5)), heading + 0.3 * rng.normal()
            position = position + 1.4 * duration * np.array([np.sin(heading), np.cos(heading)])
            position = position + (np.array([30.0, 25.0]) if k == self.carried_at else 0.0)
            if self.has_robot:
                course = 0.1 * k
                odometry = 0.9 * duration * np.array([np.sin(course), np.cos(course)])
                claimed_beacons[0, :2] += odometry
                true_beacons[0, :2] += (
                    0.9 * duration * np.array([np.sin(course - 0.2), np.cos(course - 0.2)])
                )
            ranges = np.linalg.norm(
                true_beacons - [*position, 4.3], axis=1
            ) * 1.01 + 0.3 * rng.normal(size=3)
            is_wrong = rng.random(3) < (1.0 if k < self.wrong_steps else self.wrong_share)
            ranges = np.abs(ranges + is_wrong * rng.uniform(-15.0, 25.0, 3))
            ranges[rng.random(3) > self.received_share] = np.nan
            own_motion = OwnMotion(1.4 + 0.05 * rng.normal(), heading + 0.03 + 0.004 * k, 4.5)
            message = LeaderMessage(float(k), 0.0, 0.0, 0.0, 0.0, 0.0)
            if self.has_robot:
                message = LeaderMessage(
                    float(k), *claimed_beacons[0, :2].tolist(), 0.1 * k, 0.9, 0.0
                )
            reception = Reception(message, Ranges(*ranges.tolist()), claimed_beacons.copy())
            steps.append((own_motion, reception, duration))
        return steps, np.array([*start_position, 0.0, 0.0])


RADIO = BeaconSettings(dt=DT, hydrophone_height=0.2)
SOUND = replace(MEDIA["water"], gyro_bias_sigma=0.0, range_sigma=0.2)


@pytest.mark.parametrize(
    ("settings", "trip"),
    [
        (RADIO, Trip()),
        (SOUND, Trip(seed=1, wrong_share=0.1)),
        (replace(SOUND, known_start=False), Trip(seed=2, steps=9)),
        (replace(RADIO, known_start=False), Trip(seed=3, steps=3, wrong_steps=2)),
        (
            replace(RADIO, start_sigma=6.0, speed_scale_sigma=0.0),
            Trip(seed=4, received_share=0.7, carried_at=12),
        ),
        (
            replace(RADIO, track_slip=0.1, track_heading_walk=0.03),
            Trip(seed=5, received_share=0.7, has_robot=True),
        ),
        (
            replace(RADIO, known_start=False, track_heading_walk=0.02, gyro_bias_sigma=0.0),
            Trip(seed=6, steps=9, has_robot=True),
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
    known_start = start if settings.known_start else None
    navigator = BeaconNavigator(settings, known_start)
    beacon_order: list[int] = []
    for _, reception, _ in steps:
        beacon_order += [
            i for i in range(3) if not np.isnan(reception.ranges[i]) and i not in beacon_order
        ]
    robots = (beacon_order.index(0),) if trip.has_robot else ()
    oracle = BeaconOracle(settings, PLACES[beacon_order], known_start, robots)
    time = 0.0
    for own_motion, reception, duration in steps:
        (update,) = navigator.step(own_motion, reception, duration)
        oracle.advance(own_motion.speed, own_motion.heading, duration)
        received_beacons = [i for i in range(3) if not np.isnan(reception.ranges[i])]
        depth = own_motion.depth - settings.hydrophone_height
        time += duration
        used_ranges = []
        for i in received_beacons:
            if beacon_order.index(i) in robots:
                oracle.follow(beacon_order.index(i), reception.transmitters[i], time)
            used_ranges.append(
                oracle.receive_range(beacon_order.index(i), reception.ranges[i], depth)
            )
        mean, covariance = oracle.now(own_motion.speed, own_motion.heading)
        np.testing.assert_allclose(navigator.state, mean, rtol=0, atol=1e-7)
        np.testing.assert_allclose(navigator.covariance, covariance, rtol=1e-6, atol=1e-9)
        assert navigator.evidence == pytest.approx(oracle.evidence, abs=1e-7)
        kind = (
            FixKind.ONE_RANGE
            if any(used_ranges)
            else (FixKind.GATED if received_beacons else FixKind.LOST)
        )
        assert update.kind == kind
        np.testing.assert_allclose(update.position, mean[:2], rtol=0, atol=1e-7)
        assert update.sigma == pytest.approx(
            np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])), nan_ok=True
        )
        belief = navigator._belief
        assert belief.n_hypotheses[0] == len(oracle.mixture)
        np.testing.assert_allclose(
            belief.variance, oracle.variance[: belief.variance.size], rtol=1e-9
        )
        for k, c in enumerate(oracle.mixture[:3]):
            np.testing.assert_allclose(
                belief.state[k], c.x[: belief.prior_variance.size], rtol=0, atol=1e-7
            )
            assert belief.weight[k] == pytest.approx(c.weight, rel=1e-6)


def test_the_heaviest_components_are_kept_and_the_heaviest_of_all_comes_first() -> None:
    """Of 300 components far from each other, ten of next to no weight, 256 are kept."""
    belief = new_belief(RADIO, (0.0, 0.0))
    rng, count = np.random.default_rng(3), 300
    weight = rng.uniform(0.5, 1.5, count)
    weight[rng.choice(count, 10, replace=False)] = 1e-7
    belief.n_hypotheses[0], belief.weight[:count] = count, weight / weight.sum()
    belief.state[:count, 0], belief.covariance[:count] = (
        100.0 * np.arange(count),
        np.eye(belief.prior_variance.size),
    )
    prune_and_merge(belief)
    heaviest = np.sort(weight)[-256:]
    assert belief.n_hypotheses[0] == 256
    assert belief.state[0, 0] == 100.0 * np.argmax(weight)
    np.testing.assert_allclose(np.sort(belief.weight[:256]), heaviest / heaviest.sum(), rtol=1e-12)
    np.testing.assert_allclose(
        np.sort(weight[(belief.state[:256, 0] / 100.0).astype(int)]), heaviest, rtol=1e-12
    )


def test_at_the_most_components_nothing_is_split_and_no_ring_is_added() -> None:
    """1024 components at most: of 1022 that are wide one is split into three, and a ring of 48 is
    added only to 975 or fewer.
    """
    belief, measurement = (
        with_beacon(new_belief(RADIO, None), RADIO),
        RangeMeasurement(0, 0.0, 0.0, 0.0, 20.0, 0.25, -0.05, -6.0),
    )
    for before, after in ((1022, 1024), (1023, 1023)):
        belief.n_hypotheses[0], belief.weight[:before], belief.state[:before, 1] = (
            before,
            1.0 / before,
            20.0,
        )
        belief.covariance[:before] = 100.0 * np.eye(belief.prior_variance.size)
        split(belief, measurement)
        assert belief.n_hypotheses[0] == after
    # components beyond the count are left alone
    belief.n_hypotheses[0], belief.covariance[0] = 1, 0.01 * np.eye(belief.prior_variance.size)
    split(belief, measurement)
    assert belief.n_hypotheses[0] == 1
    for before, after in ((976, 976), (975, 1023)):
        belief.n_hypotheses[0], belief.weight[:before] = before, 1.0 / before
        add_ring(belief, measurement, 0.1, False)
        assert belief.n_hypotheses[0] == after


def test_components_within_a_third_of_their_spread_merge() -> None:
    """The limit is a squared distance of 0.3 in units of the mean covariance, √0.3 = 0.548."""
    spread = np.array([[4.0, 1.5], [1.5, 1.0]])
    for distance, remaining in ((0.54, 1), (0.56, 2)):
        belief = new_belief(RADIO, (0.0, 0.0))
        belief.n_hypotheses[0], belief.weight[:2] = 2, [0.25, 0.75]
        belief.covariance[:2] = np.eye(belief.prior_variance.size)
        belief.covariance[0, :2, :2], belief.covariance[1, :2, :2] = 0.5 * spread, 1.5 * spread
        root = np.linalg.cholesky(spread)
        belief.state[1, :2] = distance * root @ [0.6, 0.8]
        prune_and_merge(belief)
        assert belief.n_hypotheses[0] == remaining
        # the heavier one comes first; together they lie at their mean
        expected = (0.75 if remaining == 1 else 1.0) * distance * root @ [0.6, 0.8]
        np.testing.assert_allclose(belief.state[0, :2], expected, rtol=1e-12)


def test_settings_of_media_are_those_of_the_documents() -> None:
    """docs/real-ranges.md has a table of them, in degrees where a name ends in it."""
    text = (Path(__file__).parents[2] / "docs" / "real-ranges.md").read_text(encoding="utf-8")
    table = re.findall(
        r"^\| (`.*) \| (.+) \| (.+) \|$",
        text.partition("| key `beacons.…` |")[2],
        flags=re.MULTILINE,
    )
    compared = 0
    for keys, *columns in table:
        for medium, column in zip(("air", "water"), columns, strict=True):
            for key, value in zip(re.findall(r"`(\w+)`", keys), column.split(", "), strict=True):
                expected = np.deg2rad(float(value)) if "_deg" in key else float(value)
                actual = getattr(
                    MEDIA[medium], re.sub(r"_(m|m_s|m_sqrt_s|deg|deg_s|deg_sqrt_s)$", "", key)
                )
                assert actual == pytest.approx(expected), key
                compared += 1
    # those of all navigators, and the start
    not_in_table = {item.name for item in fields(Settings)} | {"known_start"}
    assert compared == 2 * len({item.name for item in fields(BeaconSettings)} - not_in_table)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_readings_at_the_limits_are_taken_and_those_beyond_them_refused(sign: float) -> None:
    """Speeds up to 50 m/s either way, ranges from 0 to 100 km."""

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
