"""Sensor errors: the paper's formulas, term by term, on draws taken from the streams themselves."""

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.messages import LeaderMessage, Measurements
from laisn.swarm import MESSAGE
from sim.sensing.noise import Stream, normals, uniforms
from sim.sensing.observation import IdealMeasurements, measure
from sim.sensing.sensors import SensorErrors, loses

SEED, RUN = 11, 4
STEPS, SENT = 40, np.array([5, 10, 20, 39])
"""Number of filter steps, and those at which messages leave."""

PERFECT = SensorErrors(
    speed_bias=0.0,
    speed_sigma=0.0,
    heading_bias=0.0,
    heading_sigma=0.0,
    range_tau=(0.0, 0.0, 0.0),
    range_scale_mean=0.0,
    range_scale_sigma=0.0,
)


@pytest.fixture(scope="module")
def truth() -> IdealMeasurements:
    """Random true values of 40 filter steps and four messages, of which one lacks a range."""
    rng = np.random.default_rng(2)
    m = SENT.size
    ranges = rng.uniform(10, 50, (m, 3))
    ranges[1, 0] = np.nan
    return IdealMeasurements(
        dt=0.1,
        start=np.zeros(4),
        speed=rng.uniform(0.0, 2.0, STEPS),
        heading=rng.uniform(0, 6, STEPS),
        depth=rng.uniform(5, 15, STEPS),
        hydrophone=rng.normal(size=(STEPS, 2)),
        leader_position=rng.normal(size=(STEPS, 2)),
        leader_heading=rng.uniform(0, 6, STEPS),
        message_step=SENT + 1,
        emission_step=SENT,
        sent=np.rec.fromarrays(
            [
                SENT * 0.1,
                *rng.normal(size=(2, m)),
                rng.uniform(0, 6, m),
                rng.uniform(0, 2, m),
                *rng.normal(size=(3, m)),
                np.full(m, np.nan),
                np.full(m, np.nan),
            ],
            dtype=MESSAGE,
        ),
        slant_range=ranges,
    )


def column(measured: Measurements, name: str) -> Floats:
    """Values of a field of all messages, shape (m,)."""
    return measured.message[:, LeaderMessage._fields.index(name)]


def test_perfect_sensors_read_the_truth(truth: IdealMeasurements) -> None:
    measured = measure(truth, PERFECT, seed=SEED, run=RUN)
    for name in ("speed", "heading", "depth", "message_step"):
        assert np.array_equal(getattr(measured, name), getattr(truth, name))
    assert np.array_equal(measured.ranges, truth.slant_range, equal_nan=True)
    assert np.array_equal(measured.message, np.array(truth.sent.tolist()), equal_nan=True)


def test_own_sensors_follow_equations_26_and_27(truth: IdealMeasurements) -> None:
    errors = SensorErrors(
        speed_bias=-0.5, speed_sigma=0.4, heading_bias=0.1, heading_sigma=0.05, depth_sigma=0.3
    )
    measured = measure(truth, errors, seed=SEED, run=RUN, follower=2)
    k = np.arange(1, STEPS + 1)
    n = normals(SEED, RUN, Stream.OWN_MOTION.number(2), k)
    expected = np.maximum(truth.speed - 0.5 + 0.4 * n[:, 0], 0.0)
    assert np.any(expected == 0.0)
    assert measured.speed == pytest.approx(expected, abs=1e-14)
    # θ + μ + |N(μ, σ) − μ|
    assert measured.heading == pytest.approx(
        truth.heading + 0.1 + np.abs((0.1 + 0.05 * n[:, 1]) - 0.1), abs=1e-14
    )
    n = normals(SEED, RUN, Stream.DEPTH.number(2), k)
    assert measured.depth == pytest.approx(truth.depth + 0.3 * n[:, 0], abs=1e-14)


@pytest.mark.parametrize("centre", [0.0, 0.5])
@pytest.mark.parametrize("transmitters", [2, 3])
def test_ranges_follow_equation_28(
    truth: IdealMeasurements, transmitters: int, centre: float
) -> None:
    """The longest range is that of the transmitters in use; the middle one counts with LAISN-3
    alone.
    """
    widths = (0.01, 0.03, 0.06)
    errors = SensorErrors(
        range_tau=widths,
        range_error_centred=centre > 0.0,
        range_scale_mean=0.3,
        range_scale_sigma=0.05,
    )
    measured = measure(truth, errors, seed=SEED, run=RUN, follower=1, transmitters=transmitters)
    u = uniforms(SEED, RUN, Stream.RANGE_UNIFORM.number(1), truth.message_step)[:, :3]
    psi = 0.3 + 0.05 * normals(SEED, RUN, Stream.RANGE_SCALE.number(1), truth.message_step)[:, :1]
    longest = np.tile(np.nanmax(truth.slant_range, axis=1, keepdims=True), 3)
    if transmitters == 2:
        longest[:, :2] = np.nanmax(truth.slant_range[:, :2], axis=1, keepdims=True)
        assert np.any(longest[:, 0] < longest[:, 2])
    expected = (
        truth.slant_range
        + np.array([0.01, 0.03, 0.06]) * (u - centre)
        + psi * truth.slant_range / longest
    )
    assert measured.ranges == pytest.approx(expected, abs=1e-13, nan_ok=True)


def test_followers_receive_the_same_leader_readings(truth: IdealMeasurements) -> None:
    errors = SensorErrors(
        leader_speed_bias=0.1,
        leader_heading_bias=0.05,
        leader_heading_sigma=0.02,
        leader_depth_sigma=0.3,
        leader_tilt_sigma=0.01,
    )
    first, eighth = (measure(truth, errors, seed=SEED, run=RUN, follower=f) for f in (0, 7))
    assert first.message.tobytes() == eighth.message.tobytes()
    assert not np.any(first.speed == eighth.speed)
    assert not np.any(first.ranges == eighth.ranges)
    n = normals(SEED, RUN, Stream.LEADER_MOTION.number(), SENT)
    assert column(first, "speed") == pytest.approx(
        np.maximum(truth.sent.speed + 0.1, 0.0), abs=1e-14
    )
    assert column(first, "heading") == pytest.approx(
        truth.sent.heading + 0.05 + 0.02 * np.abs(n[:, 1]), abs=1e-14
    )
    n = normals(SEED, RUN, Stream.LEADER_ATTITUDE.number(), SENT)
    assert first.message[:, 6:8] == pytest.approx(
        np.column_stack([truth.sent.pitch, truth.sent.roll]) + 0.01 * n, abs=1e-14
    )
    n = normals(SEED, RUN, Stream.LEADER_DEPTH.number(), SENT)
    assert column(first, "depth") == pytest.approx(truth.sent.depth + 0.3 * n[:, 0], abs=1e-14)
    # errors of the position, which were off so far, leave all other values as they were
    position_errors = errors._replace(leader_position_sigma=0.5, leader_position_walk=0.1)
    first_with_position_errors, eighth_with_position_errors = (
        measure(truth, position_errors, seed=SEED, run=RUN, follower=f) for f in (0, 7)
    )
    assert (
        first_with_position_errors.message.tobytes()
        == eighth_with_position_errors.message.tobytes()
    )
    np.testing.assert_array_equal(first_with_position_errors.ranges, first.ranges)
    np.testing.assert_array_equal(first_with_position_errors.message[:, 3:], first.message[:, 3:])
    white = normals(SEED, RUN, Stream.LEADER_POSITION.number(), SENT)
    steps = normals(SEED, RUN, Stream.LEADER_POSITION_WALK.number(), range(1, max(SENT) + 1))
    walk = np.sqrt(truth.dt) * np.cumsum(steps, axis=0)[np.array(SENT) - 1]
    expected = first.message[:, 1:3] + 0.5 * white + 0.1 * walk
    np.testing.assert_allclose(
        first_with_position_errors.message[:, 1:3], expected, rtol=0, atol=1e-12
    )


def test_ranges_out_of_bounds_are_rejected_and_a_log_reads_50_m_s_at_most(
    truth: IdealMeasurements,
) -> None:
    for mean in (-100.0, 1e6):
        measured = measure(truth, PERFECT._replace(range_scale_mean=mean), seed=SEED, run=RUN)
        assert np.isnan(measured.ranges).all()
    assert (
        measure(truth, PERFECT._replace(speed_bias=1e6), seed=SEED, run=RUN).speed.tolist()
        == [50.0] * STEPS
    )


def test_sensors_err_by_default_as_in_the_paper() -> None:
    """Praczyk & Hożyń 2026, Eqs. 26 to 28 with the settings of Stage 1.

    Log 0.2 and 0.2 m/s, compass 5° and 2°, τ of 1 cm, ψ of 0.1 and 0.05 m.
    """
    expected = {
        "speed_bias": 0.2,
        "speed_sigma": 0.2,
        "heading_bias": np.deg2rad(5.0),
        "heading_sigma": np.deg2rad(2.0),
        "gyro_sigma": np.deg2rad(0.1),
        "tilt_sigma": np.deg2rad(0.5),
        "range_tau": (0.01, 0.01, 0.01),
        "range_scale_mean": 0.1,
        "range_scale_sigma": 0.05,
    }
    defaults = SensorErrors()
    assert not loses(defaults)
    expected |= {
        "sound_speed": 1500.0,
        "drift_period": 400.0,
        "burst_mean_messages": 5.0,
        "burst_loss_probability": 1.0,
    }
    for name, value in defaults._asdict().items():
        assert value == pytest.approx(expected.get(name, 0.0)), name
