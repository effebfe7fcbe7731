"""The navigator among beacons: its formulas against independent ones, and its behaviour under
faults of sensors.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from laisn.arrays import Floats
from laisn.beacons import (
    CAPACITY,
    GYRO_BIAS,
    HEADING_ERROR,
    MEDIA,
    RANGE_SCALE,
    SHARED,
    SPEED_SCALE,
    BeaconBelief,
    BeaconNavigator,
    BeaconSettings,
    RangeMeasurement,
    X,
    Y,
    new_belief,
    predict,
    predict_range,
    prune_and_merge,
    split,
    update,
    with_beacon,
)
from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from tests.laisn.lawn_mower import DT as STEP
from tests.laisn.lawn_mower import Faults, mow_the_lawn
from tests.laisn.round_trip import Errors, round_trip

RANDOM = np.random.default_rng(5)
ALL_ON = replace(BeaconSettings(), current_sigma=0.3)


def to_first_beacon(
    beacon: tuple[float, float],
    measured: float,
    *,
    depth_difference: float = 0.0,
    sigma: float = 0.5,
) -> RangeMeasurement:
    """A range to the first beacon."""
    return RangeMeasurement(
        0, *beacon, depth_difference, measured, sigma**2, math.log(0.95), math.log(0.05 / 20.0)
    )


def correlated_belief(
    settings: BeaconSettings = ALL_ON, position: tuple[float, float] = (3.0, -4.0)
) -> BeaconBelief:
    """A belief with one beacon and errors that are correlated with each other."""
    belief = with_beacon(new_belief(settings, position), settings)
    n = belief.prior_variance.size
    belief.state[0, 2:] = 0.02 * RANDOM.standard_normal(n - 2)
    root = RANDOM.standard_normal((n, n)) * 0.05
    belief.covariance[0] += root @ root.T
    return belief


def with_covariance(belief: BeaconBelief, covariance: Floats) -> BeaconBelief:
    belief.covariance[0] = covariance
    return belief


def expected_range(x: Floats, beacon: tuple[float, float], depth_difference: float) -> float:
    first = SHARED
    offset = np.array(
        [x[X] - beacon[0] - x[first + 1], x[Y] - beacon[1] - x[first + 2], depth_difference]
    )
    return float((1.0 + x[RANGE_SCALE]) * np.linalg.norm(offset) + x[first])


def test_a_range_has_the_derivatives_of_finite_differences() -> None:
    belief, beacon = correlated_belief(), (40.0, 25.0)
    n, x = belief.prior_variance.size, belief.state[0].copy()
    with_covariance(belief, np.eye(n) * 1e-12)
    predict_range(belief, 0, to_first_beacon(beacon, 50.0, depth_difference=6.0))
    row = belief.ph / 1e-12
    for j in range(n):
        step = np.zeros(n)
        step[j] = 1e-6
        slope = (
            expected_range(x + step, beacon, 6.0) - expected_range(x - step, beacon, 6.0)
        ) / 2e-6
        assert row[j] == pytest.approx(slope, abs=1e-8)


def test_a_range_has_the_mean_and_variance_of_many_draws() -> None:
    """Second-order terms: two metres across at thirty bend a circle by centimetres."""
    belief, beacon = correlated_belief(), (20.0, 18.0)
    root = 0.8 * RANDOM.standard_normal((belief.prior_variance.size, belief.prior_variance.size))
    root[2:] *= 0.001
    with_covariance(belief, root @ root.T)
    x = belief.state[0] + RANDOM.standard_normal((400_000, belief.prior_variance.size)) @ root.T
    offset = x[:, :2] - np.array(beacon) - x[:, SHARED + 1 : SHARED + 3]
    drawn = (1.0 + x[:, RANGE_SCALE]) * np.hypot(*offset.T) + x[:, SHARED]
    residual, variance, _ = predict_range(belief, 0, to_first_beacon(beacon, 0.0))
    standard_error = drawn.std() / math.sqrt(drawn.size)
    assert -residual == pytest.approx(drawn.mean(), abs=5.0 * standard_error)
    first_order = -residual - expected_range(belief.state[0], beacon, 0.0)
    assert abs(first_order) > 10.0 * standard_error, "the correction must matter here"
    assert variance == pytest.approx(drawn.var(), rel=0.01)


def after_odometry(x: Floats, speed: float, heading: float, time: float) -> Floats:
    """A state after a step of odometry, by formulas written out once more."""
    y = x.copy()
    y[HEADING_ERROR] += time * x[GYRO_BIAS]
    distance = math.exp(x[SPEED_SCALE]) * speed * time
    y[:2] += (
        distance
        * np.array([math.sin(heading - y[HEADING_ERROR]), math.cos(heading - y[HEADING_ERROR])])
        + time * x[6:8]
    )
    return y


def test_odometry_moves_mean_and_covariance_as_finite_differences_do() -> None:
    belief = correlated_belief()
    n, x, before = belief.prior_variance.size, belief.state[0].copy(), belief.covariance[0].copy()
    step = 1e-6
    jacobian = np.column_stack(
        [
            (
                after_odometry(x + step * e, 1.7, 0.8, 0.5)
                - after_odometry(x - step * e, 1.7, 0.8, 0.5)
            )
            / (2 * step)
            for e in np.eye(n)
        ]
    )
    predict(belief, (0.0, 1e-3), 1.7, 0.8, 0.5)
    np.testing.assert_allclose(belief.state[0], after_odometry(x, 1.7, 0.8, 0.5), atol=1e-12)
    added = belief.covariance[0] - jacobian @ before @ jacobian.T
    # the random walks of the biases add to the diagonal, and nothing else is added
    assert np.all(np.abs(added - np.diag(np.diag(added))) < 1e-8)
    assert np.all(np.diag(added)[[SPEED_SCALE, HEADING_ERROR, GYRO_BIAS]] > 0.0)
    np.testing.assert_allclose(np.diag(added)[[X, Y, RANGE_SCALE]], 0.0, atol=1e-8)


def test_far_away_it_is_the_linear_filter_of_filterpy() -> None:
    """A circle of ten thousand kilometres is straight: the update is that of a linear filter."""
    belief, beacon = correlated_belief(position=(0.0, -4.0)), (0.0, 1e7)
    n = belief.prior_variance.size
    root = 0.1 * RANDOM.standard_normal((n, n))
    root[RANGE_SCALE] = 0.0
    with_covariance(belief, root @ root.T)
    belief.state[0, RANGE_SCALE] = 0.0
    kalman = KalmanFilter(dim_x=n, dim_z=1)
    kalman.x, kalman.P, kalman.R = (
        belief.state[0][:, None].copy(),
        belief.covariance[0].copy(),
        np.array([[0.25]]),
    )
    H = np.zeros((1, n))
    H[0, [Y, SHARED, SHARED + 2]] = -1.0, 1.0, 1.0
    predicted = 1e7 - belief.state[0, Y] + belief.state[0, SHARED + 2] + belief.state[0, SHARED]
    z = to_first_beacon(beacon, predicted + 0.3)
    kalman.update(np.array([[z.range - predicted]]) + H @ kalman.x, H=H)
    update(belief, 0, z)
    used = belief.outcome[0]["used"]
    assert used
    np.testing.assert_allclose(belief.state[0], kalman.x[:, 0], atol=1e-8)
    np.testing.assert_allclose(belief.covariance[0], kalman.P, atol=1e-9)


def mixture_moments(belief: BeaconBelief) -> tuple[Floats, Floats]:
    count = belief.n_hypotheses[0]
    weight, state = belief.weight[:count] / belief.weight[:count].sum(), belief.state[:count]
    mean = weight @ state
    offsets = state - mean
    return mean, np.einsum("k,kij->ij", weight, belief.covariance[:count]) + np.einsum(
        "k,ki,kj->ij", weight, offsets, offsets
    )


def test_splits_keep_mean_and_covariance_until_a_circle_is_straight() -> None:
    belief = correlated_belief()
    belief.covariance[0, X, X] += 9.0
    belief.covariance[0, Y, Y] += 25.0
    before, z = mixture_moments(belief), to_first_beacon((10.0, 0.0), 30.0)
    split(belief, z)
    assert 5 < belief.n_hypotheses[0] < CAPACITY - 1
    for moments_before, moments_after in zip(before, mixture_moments(belief), strict=True):
        np.testing.assert_allclose(moments_after, moments_before, rtol=1e-9, atol=1e-9)
    for k in range(belief.n_hypotheses[0]):
        assert predict_range(belief, k, z)[2] <= 0.7 * 0.5


def test_components_at_one_position_merge_and_keep_their_moments() -> None:
    belief = correlated_belief()
    belief.covariance[0, X, X] += 4.0
    split(belief, to_first_beacon((3.0, 1.0), 5.0, sigma=0.05))
    before = mixture_moments(belief)
    # all within a third of their spread
    belief.covariance[:, X, X] += 400.0
    belief.covariance[:, Y, Y] += 400.0
    prune_and_merge(belief)
    assert belief.n_hypotheses[0] == 1
    mean, covariance = mixture_moments(belief)
    covariance[[X, Y], [X, Y]] -= 400.0
    np.testing.assert_allclose(mean, before[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(covariance, before[1], rtol=1e-9, atol=1e-9)


def test_without_noise_the_errors_of_all_sensors_are_found() -> None:
    true = Errors(speed_scale=0.02, gyro_bias=math.radians(0.3), range_scale=0.07, noise=0.0)
    settings = BeaconSettings(
        slip=1e-3, range_sigma=0.02, survey_sigma=1e-4, range_offset_sigma=1e-4
    )
    measured, truth = round_trip(true, seconds=600)
    navigator = BeaconNavigator(settings, np.array([*truth[0], 0.0, 0.0]))
    actual = navigator.run(measured)
    x = navigator._belief.state[0]
    assert x[RANGE_SCALE] == pytest.approx(0.07, abs=1e-3)
    assert x[SPEED_SCALE] == pytest.approx(0.02, abs=2e-3)
    assert x[GYRO_BIAS] == pytest.approx(math.radians(0.3), abs=math.radians(0.01))
    assert np.hypot(*(actual.state[:, :2] - truth[1:]).T)[-1000:].max() < 0.05


@pytest.mark.parametrize(
    ("noise", "lowest", "highest"), [(1.0, 0.79, 1.21), (0.05, 0.25, 0.3), (4.0, 1.7, 2.0)]
)
def test_range_variances_are_estimated_within_bounds(
    noise: float, lowest: float, highest: float
) -> None:
    """With 0.5 m on the data sheet, twice that is estimated, and nothing below half of it or above
    four times it.

    With a gain of 0.02 a variance rests on some hundred ranges: σ is uncertain by 7 %, and three
    times that is allowed.
    """
    measured, truth = round_trip(Errors(noise=noise), seconds=900)
    navigator = BeaconNavigator(BeaconSettings(outlier_span=200.0), np.array([*truth[0], 0.0, 0.0]))
    navigator.run(measured)
    range_sigma = np.sqrt(navigator._belief.variance)
    assert range_sigma.min() >= lowest
    assert range_sigma.max() <= highest


@pytest.mark.parametrize("medium", MEDIA)
def test_the_covariance_is_consistent_where_its_assumptions_hold(medium: str) -> None:
    """Errors drawn from the settings: the mean of NEES over runs lies where χ² of two degrees
    has it.
    """
    settings = MEDIA[medium]
    nees = []
    for seed in range(12):
        measured, truth = round_trip(
            Errors.drawn(settings, seed), seconds=300, seed=seed, slip=settings.slip
        )
        start = truth[0] + settings.start_sigma * np.random.default_rng(seed).standard_normal(2)
        estimates = BeaconNavigator(settings, np.array([*start, 0.0, 0.0])).run(measured)
        errors = estimates.state[::100, :2] - truth[1::100]
        nees.append(
            np.mean(
                [
                    e @ np.linalg.solve(p[:2, :2], e)
                    for e, p in zip(errors, estimates.covariance[::100], strict=True)
                ]
            )
        )
    # twelve runs whose errors are correlated over time count as some fifty draws of mean 2, σ 2
    assert 1.2 < np.mean(nees) < 2.8


def test_the_evidence_is_larger_for_the_settings_of_the_true_medium() -> None:
    for true_medium, other_medium in (("air", "water"), ("water", "air")):
        true = Errors(range_scale=0.07 if true_medium == "air" else 0.001)
        measured, truth = round_trip(true, seconds=600, slip=MEDIA[true_medium].slip)
        start = np.array([*truth[0], 0.0, 0.0])
        evidence = {}
        for medium in (true_medium, other_medium):
            navigator = BeaconNavigator(MEDIA[medium], start)
            navigator.run(measured)
            evidence[medium] = navigator.evidence
        assert evidence[true_medium] > evidence[other_medium] + 5.0


def test_an_unknown_start_is_found_though_its_first_ranges_are_wrong() -> None:
    measured, truth = round_trip(Errors(), seconds=300)
    ranges = measured.ranges.copy()
    ranges[:3] += np.array([[-35.0], [60.0], [-20.0]])
    navigator = BeaconNavigator(BeaconSettings(known_start=False), None)
    estimates = navigator.run(replace(measured, ranges=ranges))
    assert np.isnan(estimates.state[0]).all()
    errors = np.hypot(*(estimates.state[:, :2] - truth[1:]).T)
    assert errors[600:].mean() < 0.5
    assert np.all(estimates.fix_kind[:3] != FixKind.LOST)


def test_media_have_the_same_density_of_wrong_ranges() -> None:
    """Otherwise a wrong range would add to the evidence of one medium alone."""
    assert (
        len({(settings.outlier_probability, settings.outlier_span) for settings in MEDIA.values()})
        == 1
    )


def test_under_water_a_known_start_is_no_worse_than_none() -> None:
    """With a compass, which has no bias of a rate: mean errors over runs after a minute."""
    settings = MEDIA["water"]
    assert settings.gyro_bias_sigma == 0.0
    mean_errors: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(4):
        measured, truth = round_trip(
            Errors.drawn(settings, seed), seconds=600, seed=seed, slip=settings.slip
        )
        believed_start = truth[0] + settings.start_sigma * np.random.default_rng(
            seed
        ).standard_normal(2)
        for known_start, errors_of_runs in mean_errors.items():
            start = np.array([*believed_start, 0.0, 0.0]) if known_start else None
            estimates = BeaconNavigator(replace(settings, known_start=known_start), start).run(
                measured
            )
            errors_of_runs.append(
                float(np.hypot(*(estimates.state[600:, :2] - truth[601:]).T).mean())
            )
    assert np.mean(mean_errors[True]) <= 1.02 * np.mean(mean_errors[False])


FAULTS = {
    "log": Faults(speed_scale=0.08, speed_wave=0.05),
    "compass": Faults(deviation=np.deg2rad(5.0)),
    "echoes": Faults(echo_share=0.15),
    "echoes in bursts": Faults(echo_share=0.2, echo_burst=6),
    "correlated ranges": Faults(error_correlation=0.8),
    "all": Faults(
        speed_scale=0.06,
        speed_wave=0.03,
        deviation=np.deg2rad(5.0),
        echo_share=0.15,
        echo_burst=4,
        error_correlation=0.5,
        range_sigma=0.8,
        start_sigma=3.0,
    ),
}
"""Sensors of an AUV that are worse than the settings for water say."""


@pytest.mark.system
@pytest.mark.parametrize("known_start", [True, False])
@pytest.mark.parametrize("faults", FAULTS.values(), ids=FAULTS)
def test_under_water_the_covariance_bears_faults_of_log_compass_and_ranges(
    faults: Faults, known_start: bool
) -> None:
    """Default settings: a mean NEES below 3, where 2 is consistent, and a mean error below 1.5 m.

    The first five minutes are left out, as echoes at the start may mislead that long. If eight
    echoes in a row from one beacon alone added a ring, these bounds would be exceeded.
    """
    settings = replace(MEDIA["water"], dt=STEP, known_start=known_start)
    nees = []
    mean_errors = []
    for seed in range(5):
        measured, truth, start = mow_the_lawn(faults, seed)
        navigator = BeaconNavigator(settings, start if known_start else None)
        estimates = navigator.run(measured)
        settled = slice(round(300.0 / STEP), None)
        position_error = (estimates.state[:, :2] - truth[1:])[settled]
        P = estimates.covariance[settled, :2, :2]
        nees.append(
            np.mean(np.einsum("ki,kij,kj->k", position_error, np.linalg.inv(P), position_error))
        )
        mean_errors.append(np.hypot(*position_error.T).mean())
    assert np.mean(nees) < 3.0
    assert np.mean(mean_errors) < 1.5


def test_echoes_are_left_out_and_a_vehicle_carried_away_is_found_again() -> None:
    measured, truth = round_trip(Errors(), seconds=400)
    start = np.array([*truth[0], 0.0, 0.0])
    ranges = measured.ranges.copy()
    echoes = np.arange(5, 400, 10)
    ranges[echoes] += 12.0
    estimates = BeaconNavigator(BeaconSettings(), start).run(replace(measured, ranges=ranges))
    assert np.hypot(*(estimates.state[:, :2] - truth[1:]).T).mean() < 0.6
    assert np.mean(estimates.fix_kind[echoes] == FixKind.GATED) > 0.95
    # it is lifted at 200 s and set down 70 m away, without odometry
    carried = replace(
        measured,
        ranges=np.vstack(
            [measured.ranges[:200], round_trip(Errors(), 400, shift=70.0)[0].ranges[200:]]
        ),
    )
    estimates = BeaconNavigator(BeaconSettings(), start).run(carried)
    errors = np.hypot(*(estimates.state[-500:, :2] - (truth[-500:] + np.array([70.0, 0.0]))).T)
    assert errors.mean() < 1.0


@settings(max_examples=8, deadline=None)
@given(turn=st.floats(-3.0, 3.0), east=st.floats(-1e3, 1e3), north=st.floats(-1e3, 1e3))
def test_a_world_that_is_turned_and_moved_gives_the_same_estimates(
    turn: float, east: float, north: float
) -> None:
    measured, truth = round_trip(Errors(), seconds=60)
    c, s = math.cos(turn), math.sin(turn)
    rotation, shift = np.array([[c, s], [-s, c]]), np.array([east, north])
    assert measured.transmitters is not None
    transmitters = measured.transmitters.copy()
    transmitters[..., :2] = transmitters[..., :2] @ rotation.T + shift
    turned_world = replace(measured, heading=measured.heading + turn, transmitters=transmitters)
    estimates = BeaconNavigator(BeaconSettings(), np.array([*truth[0], 0.0, 0.0])).run(measured)
    of_turned_world = BeaconNavigator(
        BeaconSettings(), np.array([*(rotation @ truth[0] + shift), 0.0, 0.0])
    ).run(turned_world)
    np.testing.assert_allclose(
        of_turned_world.state[:, :2], estimates.state[:, :2] @ rotation.T + shift, atol=1e-6
    )
    np.testing.assert_allclose(
        of_turned_world.covariance[:, :2, :2],
        rotation @ estimates.covariance[:, :2, :2] @ rotation.T,
        atol=1e-8,
    )


def test_step_by_step_is_the_whole_mission_to_the_bit_and_stays_positive_definite() -> None:
    measured, truth = round_trip(Errors(), seconds=600)
    start = np.array([*truth[0], 0.0, 0.0])
    whole = BeaconNavigator(ALL_ON, start).run(measured)
    navigator = BeaconNavigator(ALL_ON, start)
    for i, (own, reception) in enumerate(measured.steps()):
        navigator.step(own, reception, measured.dt)
        assert navigator.state.tolist() == whole.state[i].tolist()
        assert navigator.covariance.tolist() == whole.covariance[i].tolist()
    P = navigator._belief.covariance[0]
    assert np.linalg.eigvalsh(P).min() > 0.0
    assert np.array_equal(P, P.T)


def reception(
    ranges: tuple[float, float, float] = (20.0, math.nan, math.nan), east: float = 0.0
) -> Reception:
    transmitters = np.full((3, 3), math.nan)
    transmitters[0] = east, 5.0, 0.0
    return Reception(LeaderMessage(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), Ranges(*ranges), transmitters)


def test_absurd_readings_are_named() -> None:
    valid, start = OwnMotion(1.0, 0.0, 0.0), np.zeros(4)
    cases = [
        (OwnMotion(math.nan, 0.0, 0.0), None, 0.1, "is not finite"),
        (OwnMotion(80.0, 0.0, 0.0), None, 0.1, "the speed is 80 m/s"),
        (valid, None, 0.0, "expected a positive time"),
        (valid, reception((-3.0, math.nan, math.nan)), 0.1, "NaN for a missing one"),
        (valid, reception()._replace(transmitters=None), 0.1, "needs beacons"),
    ]
    for own_motion, received_ranges, duration, error_message in cases:
        with pytest.raises(LaisnError, match=error_message):
            BeaconNavigator(BeaconSettings(), start).step(own_motion, received_ranges, duration)
    with pytest.raises(ValueError, match="expected four finite numbers"):
        BeaconNavigator(BeaconSettings(), np.zeros(3))
    with pytest.raises(ValueError, match="slip is -1"):
        BeaconSettings(slip=-1.0)
    with pytest.raises(ValueError, match="outlier_probability is 1"):
        BeaconSettings(outlier_probability=1.0)
    among_65_beacons = BeaconNavigator(BeaconSettings(), start)
    for k in range(64):
        among_65_beacons.step(valid, reception(east=float(k)))
    with pytest.raises(LaisnError, match="more than 64 places; a beacon must lie still"):
        among_65_beacons.step(valid, reception(east=64.0))
    already_used = BeaconNavigator(BeaconSettings(), start)
    already_used.step(valid, reception((math.nan, math.nan, math.nan)))
    with pytest.raises(ValueError, match="a mission needs a new one"):
        already_used.run(round_trip(Errors(), seconds=1)[0])
