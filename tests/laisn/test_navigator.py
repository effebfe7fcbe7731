"""The navigator: noiseless missions, an independent implementation, and hard cases."""

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.estimates import Estimates, FixKind
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges, Reception
from laisn.navigator import Navigator
from laisn.settings import LAISN_VARIANTS, GateRule, NavigationSettings, Variant
from sim import attitude
from tests.laisn import in_lanes
from tests.laisn.oracle import Oracle

DT = 0.1
TRANSMITTERS = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, 0.1, 0]])


def mission(
    n_steps: int = 1000,
    steps_per_message: int = 10,
    *,
    pitch: float = 0.0,
    offset: tuple[float, float, float] = (-30.0, 25.0, -2.0),
    noise: np.random.Generator | None = None,
) -> tuple[Measurements, Floats, Floats]:
    """A leader on a gentle curve and a follower in formation; measurements, true positions, start.

    The velocity of the follower over a step is what its log and compass show at the end of it, as
    the constant velocity model has it, so that without noise the filter can be exact.
    """
    k = np.arange(n_steps + 1)
    heading = 0.8 + 0.3 * np.sin(0.01 * k)
    leader = np.cumsum(DT * np.stack([np.sin(heading), np.cos(heading)], axis=1), axis=0)
    course = heading + 0.1 * np.sin(0.02 * k)
    speed = 1.0 + 0.2 * np.sin(0.013 * k)
    step = DT * speed[:, None] * np.stack([np.sin(course), np.cos(course)], axis=1)
    follower = leader[0] + np.array(offset[:2]) + np.cumsum(step, axis=0) - step[0]
    message_step = np.arange(steps_per_message, n_steps + 1, steps_per_message)
    hull = attitude.from_euler(heading[message_step], pitch)
    sites = (
        attitude.rotate(hull[:, None], TRANSMITTERS)
        + np.column_stack([leader[message_step], np.full(message_step.size, -8.0)])[:, None]
    )
    hydrophone = np.column_stack(
        [follower[message_step], np.full(message_step.size, -8.0 + offset[2])]
    )
    ranges = np.linalg.norm(sites - hydrophone[:, None], axis=2)
    message = np.full((message_step.size, 10), np.nan)
    message[:, :8] = np.column_stack(
        [
            message_step * DT,
            leader[message_step],
            heading[message_step],
            np.ones(message_step.size),
            np.full(message_step.size, 8.0),
            np.full(message_step.size, pitch),
            np.zeros(message_step.size),
        ]
    )
    measured_speed, measured_course = speed[1:].copy(), course[1:].copy()
    if noise is not None:
        measured_speed = np.maximum(measured_speed + noise.normal(0.2, 0.2, n_steps), 0)
        measured_course += np.deg2rad(5) + np.abs(noise.normal(0, np.deg2rad(2), n_steps))
        ranges = (
            ranges
            + noise.uniform(0, 0.01, ranges.shape)
            + noise.normal(0.1, 0.05, (message_step.size, 1))
        )
    measurements = Measurements(
        dt=DT,
        speed=measured_speed,
        heading=measured_course,
        depth=np.full(n_steps, 8.0 - offset[2]),
        message_step=message_step,
        message=message,
        ranges=ranges,
    )
    start = np.concatenate([follower[0], (step[1] / DT)])
    return measurements, follower[1:], start


def navigate(measurements: Measurements, start: Floats, **settings: object) -> Estimates:
    return Navigator(NavigationSettings(**settings), start).run(measurements)  # type: ignore[arg-type]


def test_dead_reckoning_alone_is_the_trapezoid_rule() -> None:
    """With certain speed the acceleration over a step is known: x + Δt (v₋ + v) / 2, to
    rounding.
    """
    measurements, _, start = mission(steps_per_message=1000)
    estimates = navigate(measurements, start, sigma_speed=1e-9, sigma_heading=1e-9)
    velocity = measurements.speed[:, None] * np.stack(
        [np.sin(measurements.heading), np.cos(measurements.heading)], axis=1
    )
    velocity_before = np.vstack([start[2:], velocity[:-1]])
    expected = start[:2] + np.cumsum(DT * (velocity_before + velocity) / 2, axis=0)
    np.testing.assert_allclose(estimates.state[:-1, :2], expected[:-1], atol=1e-9)


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
@pytest.mark.parametrize(("pitch_deg", "use_attitude"), [(0.0, False), (12.0, True)])
def test_noiseless_mission_recovers_the_truth_at_every_message(
    variant: Variant, pitch_deg: float, use_attitude: bool
) -> None:
    """With β = 0 every fix is certain and replaces the prediction, which only chooses the side:
    exact at messages; between them turning adds a few millimetres, below 2 cm.
    """
    measurements, truth, start = mission(pitch=np.deg2rad(pitch_deg))
    estimates = navigate(measurements, start, variant=variant, use_attitude=use_attitude, beta=0.0)
    error = np.hypot(*(estimates.state[:, :2] - truth).T)
    assert error[measurements.message_step - 1].max() < 1e-9
    assert error.max() < 0.02
    skipped = {FixKind.SINGULAR} if variant == "laisn-3-1" else set()
    kinds = set(estimates.fix_kind.tolist())
    assert kinds == {FixKind.FUSED if variant == "laisn-3-2" else FixKind.TWO_POINTS} | skipped


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_with_the_papers_beta_a_noiseless_mission_is_exact_to_the_gain(variant: Variant) -> None:
    """The gain is 1 − (β/sep)² / P with P ≥ (σa0 Δt²/2)² = 0.09 m² and sep ≈ 50 m: a thousandth of
    the prediction's error of a few millimetres remains."""
    measurements, truth, start = mission()
    estimates = navigate(measurements, start, variant=variant)
    error = np.hypot(*(estimates.state[:, :2] - truth).T)
    assert error[measurements.message_step - 1].max() < 1e-4


@pytest.mark.parametrize(
    "offset", [(-20.0, -19.0, 0.0), (-8.0, 16.0, -4.0)], ids=["astern", "abeam"]
)
@pytest.mark.parametrize("gate", ["v-max", "v-measured"])
@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_an_independent_navigator_agrees(
    variant: Variant, gate: GateRule, offset: tuple[float, float, float]
) -> None:
    """On noisy missions with gross errors, lost messages and a leader whose speed is measured
    with noise.
    """
    random = np.random.default_rng(5)
    measurements, _, start = mission(700, noise=random, offset=offset)
    ranges, message = measurements.ranges.copy(), measurements.message.copy()
    n_messages = len(ranges)
    message[:, 4] += random.normal(0, 0.2, n_messages)
    ranges[random.random(n_messages) < 0.1] += 8.0
    lost = random.random(n_messages) < 0.15
    ranges[lost] = np.nan
    spoiled = Measurements(**{**vars(measurements), "ranges": ranges, "message": message})
    estimates = navigate(spoiled, start, variant=variant, gate=gate)

    oracle = Oracle(variant, gate, start)
    message_of_step = dict(zip(spoiled.message_step.tolist(), range(n_messages), strict=True))
    expected = []
    for k, own in enumerate(
        zip(spoiled.speed, spoiled.heading, spoiled.depth, strict=True), start=1
    ):
        i = message_of_step.get(k)
        received = i is not None and not lost[i]
        oracle.step(*own, message[i] if received else None, ranges[i] if received else None)
        expected.append(oracle.x)
    np.testing.assert_allclose(estimates.state[:, :2], np.array(expected)[:, :2], atol=1e-8)
    np.testing.assert_allclose(estimates.state[:, 2:], np.array(expected)[:, 2:], atol=1e-6)
    kinds = estimates.fix_kind.tolist()
    assert kinds.count(FixKind.GATED) == oracle.rejected > 2
    assert kinds.count(FixKind.LOST) == lost.sum() > 2
    if offset[0] == -20.0 and variant in ("laisn-2", "laisn-3-1"):
        assert FixKind.ASTERN in kinds


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_a_lost_message_is_no_message(variant: Variant) -> None:
    """Of a message without ranges nothing is used, not even its heading and speed."""
    random = np.random.default_rng(6)
    measurements, _, start = mission(600, noise=random)
    message = measurements.message.copy()
    message[:, 3:5] += random.normal(0, 0.3, (len(message), 2))
    lost = random.random(len(message)) < 0.4
    ranges = np.where(lost[:, None], np.nan, measurements.ranges)
    arrays = {**vars(measurements), "message": message}
    with_lost = Measurements(**{**arrays, "ranges": ranges})
    received_arrays = {
        "message_step": measurements.message_step[~lost],
        "message": message[~lost],
        "ranges": ranges[~lost],
    }
    measurements_of_both = with_lost, Measurements(**{**arrays, **received_arrays})
    with_lost_ones, without_them = (
        navigate(m, start, variant=variant).state.tobytes() for m in measurements_of_both
    )
    assert with_lost_ones == without_them
    with_lost_ones, without_them = (
        in_lanes.run([m], start, NavigationSettings(variant=variant)).state.tobytes()
        for m in measurements_of_both
    )
    assert with_lost_ones == without_them


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_online_steps_and_run_are_the_same_to_the_bit(variant: Variant) -> None:
    measurements, _, start = mission(300, noise=np.random.default_rng(1))
    estimates = navigate(measurements, start, variant=variant)
    online = Navigator(NavigationSettings(variant=variant), start)
    for i, (own, reception) in enumerate(measurements.steps()):
        online.step(own, reception)
        assert np.array_equal(online.state, estimates.state[i])
        assert np.array_equal(online.covariance, estimates.covariance[i])


def test_a_second_certain_fix_of_a_message_is_skipped() -> None:
    """LAISN-3(1) dead astern: all pairs snap to the axis; S is singular for the last two."""
    start = np.array([-20.0, 0.0, 1.0, 0.0])
    navigator = Navigator(NavigationSettings(variant="laisn-3-1", gate="off"), start)
    for _ in range(9):
        navigator.step(OwnMotion(1.0, np.pi / 2, 8.0))
    message = LeaderMessage(1.0, 1.0, 0.0, np.pi / 2, 1.0, 8.0)
    records = navigator.step(
        OwnMotion(1.0, np.pi / 2, 8.0), Reception(message, Ranges(19.0, 21.2, 20.1))
    )
    assert [r.kind for r in records] == [FixKind.ASTERN, FixKind.SINGULAR, FixKind.SINGULAR]
    np.testing.assert_allclose(navigator.state[:2], [-19.0, 0.0], atol=1e-9)
    assert np.all(np.isfinite(navigator.covariance))


def test_a_gross_error_is_rejected_and_the_filter_recovers() -> None:
    measurements, truth, start = mission()
    ranges = measurements.ranges.copy()
    ranges[20] += 15.0
    spoiled = Measurements(**{**vars(measurements), "ranges": ranges})
    estimates = navigate(spoiled, start)
    assert estimates.fix_kind[20] == FixKind.GATED
    assert np.count_nonzero(estimates.fix_kind == FixKind.GATED) == 1
    assert np.hypot(*(estimates.state[:, :2] - truth).T).max() < 0.1
    ungated = navigate(spoiled, start, gate="off")
    assert np.hypot(*(ungated.state[:, :2] - truth).T).max() > 10.0


def test_a_long_silence_does_not_lock_the_filter_out() -> None:
    """Dead reckoning with a biased compass drifts away for 60 s; the first message afterwards is
    accepted.
    """
    measurements, truth, start = mission(1000, noise=np.random.default_rng(2))
    received = (measurements.message_step < 300) | (measurements.message_step > 900)
    silent = Measurements(
        **{
            **vars(measurements),
            "message_step": measurements.message_step[received],
            "message": measurements.message[received],
            "ranges": measurements.ranges[received],
        }
    )
    estimates = navigate(silent, start)
    error = np.hypot(*(estimates.state[:, :2] - truth).T)
    # 60 s of |1.2 e^{i 6.6°} − 1| = 0.236 m/s
    assert 8.0 < error[900] < 20.0
    assert error[-1] < 1.5


def test_a_variant_without_a_complete_pair_makes_no_fix() -> None:
    """Without front ranges LAISN-2 has none; `laisn-best` uses the rear and middle transmitter."""
    measurements, _, start = mission()
    ranges = measurements.ranges.copy()
    ranges[:, 1] = np.nan
    without_front = Measurements(**{**vars(measurements), "ranges": ranges})
    estimates = navigate(without_front, start)
    assert np.all(estimates.fix_kind == FixKind.LOST)
    assert np.all(np.isnan(estimates.fix_position))
    assert np.all(
        navigate(without_front, start, variant="laisn-best").fix_kind == FixKind.TWO_POINTS
    )


def test_a_follower_ahead_is_thrown_astern_as_published_unless_the_prediction_decides() -> None:
    measurements, truth, start = mission(400, offset=(20 * np.sin(0.8), 20 * np.cos(0.8), 0.0))
    ranges = measurements.ranges.copy()
    ranges[:, 0] = ranges[:, 1] + 2.05
    too_long = Measurements(**{**vars(measurements), "ranges": ranges})
    published = navigate(too_long, start, gate="off")
    error = np.hypot(*(published.state[:, :2] - truth).T)[too_long.message_step - 1]
    # from R ahead of the leader's middle, where D1 = R + L/2 + 0.05 m, to D1 + L/2 behind it: 2 R +
    # L + 0.05 m
    distance = np.linalg.norm(truth[too_long.message_step - 1] - too_long.message[:, 1:3], axis=1)
    assert error[0] == pytest.approx(2 * distance[0] + 2.05, rel=1e-3)
    by_prediction = navigate(too_long, start, gate="off", side_rule="predicted")
    # D2 is exact; by the first message the leader has turned by 0.3 sin 0.1, which moves the fix
    # aside by that angle
    first_step = too_long.message_step[0] - 1
    assert (
        np.hypot(*(by_prediction.state[first_step, :2] - truth[first_step]))
        < 0.3 * np.sin(0.1) * distance[0]
    )


def test_a_known_start_has_zero_covariance() -> None:
    navigator = Navigator(NavigationSettings(), np.array([1.0, 2.0, 0.0, 1.0]))
    assert np.array_equal(navigator.covariance, np.zeros((4, 4)))
    navigator.step(OwnMotion(1.0, 0.0, 8.0))
    np.testing.assert_allclose(navigator.state, [1.0, 2.1, 0.0, 1.0], atol=1e-12)


def test_bad_input_is_refused() -> None:
    with pytest.raises(ValueError, match="four finite numbers"):
        Navigator(NavigationSettings(), np.array([1.0, 2.0]))
    navigator = Navigator(NavigationSettings(), np.zeros(4))
    with pytest.raises(ValueError, match=r"step 1: own motion .* is not finite"):
        navigator.step(OwnMotion(np.nan, 0.0, 8.0))
    measurements, _, start = mission(20)
    with pytest.raises(ValueError, match=r"every 0\.1 s, but the filter steps 1 s"):
        Navigator(NavigationSettings(dt=1.0), start).run(measurements)
    with pytest.raises(ValueError, match="variant is 'laisn-4', expected one of laisn-2"):
        NavigationSettings(variant="laisn-4")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="baseline is -1"):
        NavigationSettings(baseline=-1.0)
    message = LeaderMessage(0.1, 0.0, 0.0, 0.0, 1.0, 8.0)
    with pytest.raises(ValueError, match=r"step 2: ranges .*inf.*, NaN for a missing one"):
        navigator.step(OwnMotion(1.0, 0.0, 8.0), Reception(message, Ranges(20.0, np.inf, 20.0)))
