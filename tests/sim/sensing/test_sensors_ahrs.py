"""The leader's attitude sensor against closed forms: specific force, gain of its filter, random
error.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.messages import LeaderMessage
from sim import attitude
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Sensors
from sim.sensing.observation import IdealMeasurements, measure, observe
from sim.sensing.sensors import SensorErrors, errors_of, leader_tilt_error, tilt_errors
from sim.trajectory import OF_VEHICLES, Trajectory
from tests import straight, synthetic
from tests.experiments.campaign.test_montecarlo import make_truth

G = 9.81
SENSING = Sensors(leader_attitude_senses_acceleration=True)


def leader_motion(velocity: Floats, quaternion: Floats) -> Trajectory:
    """A leader with velocities of shape (n, 3) and attitudes that broadcast to (n, 4), every 0.1
    s.
    """
    n = len(velocity)
    at_rest = straight.make_trajectory((0.0, 20.0, -10.0))
    motion: dict[str, Any] = {
        name: np.repeat(getattr(at_rest, name)[:1], n, axis=0)
        for name in (
            "position",
            "velocity",
            "quaternion",
            "angular_velocity",
            "water_velocity",
            "effector_states",
        )
    }
    motion["velocity"][:, 0] = velocity
    motion["quaternion"][:, 0] = quaternion
    return synthetic.moved(at_rest, time=0.1 * np.arange(n, dtype=np.float64), **motion)


def apparent_tilt(trajectory: Trajectory) -> Floats:
    """Pitch and roll that the sensor shows at each instant without gyros, shape (n, 2), [rad]."""
    return tilt_errors(trajectory, SENSING) + np.column_stack(
        [trajectory.pitch[:, 0], trajectory.roll[:, 0]]
    )


def test_a_hull_at_rest_shows_its_tilt() -> None:
    pitch, roll = np.deg2rad(7.0), np.deg2rad(-4.0)
    at_rest = leader_motion(np.zeros((5, 3)), attitude.from_euler(1.1, pitch, roll))
    assert apparent_tilt(at_rest) == pytest.approx(np.tile([pitch, roll], (5, 1)), abs=1e-12)


def test_a_hull_that_speeds_up_seems_to_raise_its_nose() -> None:
    time = 0.1 * np.arange(50)
    north = leader_motion(np.outer(time, [0.0, 0.5, 0.0]), attitude.from_euler(0.0))
    assert apparent_tilt(north) == pytest.approx(
        np.tile([np.arctan(0.5 / G), 0.0], (50, 1)), abs=1e-12
    )


def test_a_hull_that_turns_to_port_seems_to_heel_to_starboard() -> None:
    # centripetal acceleration v²/R to port: its mean over the last 0.1 s, during which the hull has
    # turned, so that the mean points half that turn aside of the hull's port
    speed, radius = 1.5, 12.0
    rate = speed / radius
    angle = rate * 0.1 * np.arange(200)
    velocity = speed * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    circling = leader_motion(velocity, attitude.from_euler(np.pi / 2 - angle))
    half_turn = rate * 0.1 / 2
    mean_acceleration = speed**2 / radius * np.sinc(half_turn / np.pi)
    heel = np.arctan(mean_acceleration * np.cos(half_turn) / G)
    pitch = np.arctan(
        mean_acceleration * np.sin(half_turn) / np.hypot(mean_acceleration * np.cos(half_turn), G)
    )
    assert apparent_tilt(circling)[1:] == pytest.approx(np.tile([pitch, heel], (199, 1)), abs=1e-12)


def test_the_sensor_is_causal() -> None:
    rng = np.random.default_rng(2)
    motion = leader_motion(
        rng.normal(size=(60, 3)), attitude.from_euler(0.3, *(0.1 * rng.normal(size=(2, 60))))
    )
    first_instants = replace(
        motion,
        time=motion.time[:40],
        **{name: getattr(motion, name)[:40] for name in OF_VEHICLES},
    )
    np.testing.assert_array_equal(
        tilt_errors(first_instants, SENSING), tilt_errors(motion, SENSING)[:40]
    )


@pytest.mark.parametrize("time_constant", [0.0, 2.0, 10.0])
def test_gyros_keep_waves_out(time_constant: float) -> None:
    # surge acceleration a cos ωt with a period of 4 s in a hull that stays level: the gain of the
    # filter is γ / |1 − (1 − γ) z| with z = exp(−iω dt)
    amplitude, omega, dt = 0.02, 2 * np.pi / 4.0, 0.1
    time = dt * np.arange(1600)
    surge = np.outer(amplitude / omega * np.sin(omega * time), [1.0, 0.0, 0.0])
    hull = leader_motion(surge, attitude.from_euler(np.pi / 2))
    sensors = SENSING.model_copy(update={"leader_gyro_time_constant_s": time_constant})
    pitch, roll = tilt_errors(hull, sensors)[-800:].T
    gamma = 1.0 - np.exp(-dt / time_constant) if time_constant else 1.0
    gain = gamma / abs(1 - (1 - gamma) * np.exp(-1j * omega * dt))
    pitch_amplitude = amplitude / G * np.sinc(omega * dt / (2 * np.pi)) * gain
    # 20 whole periods: the root mean square is that of a sine; arctan is linear to 1e-6 here
    assert np.sqrt(2 * np.mean(pitch**2)) == pytest.approx(pitch_amplitude, rel=1e-5)
    assert np.abs(roll).max() < 1e-12
    if time_constant == 10.0:
        assert gain == pytest.approx(1 / (omega * time_constant), rel=0.02)


def test_only_a_sensor_of_accelerations_errs_by_them() -> None:
    motion = leader_motion(
        np.random.default_rng(1).normal(size=(30, 3)), attitude.from_euler(0.3, 0.1, -0.2)
    )
    assert not tilt_errors(motion, Sensors(leader_gyro_time_constant_s=5.0)).any()
    # specific force in the hull's axes; the acceleration of a step is known at its end
    force = np.diff(motion.velocity[:, 0], axis=0, prepend=0.0) / 0.1 + [0.0, 0.0, G]
    force[0] = force[1]
    forward, port, up = attitude.rotate(motion.quaternion[:, 0] * [1.0, -1.0, -1.0, -1.0], force).T
    apparent = np.column_stack([np.arctan2(forward, np.hypot(port, up)), np.arctan2(port, up)])
    assert tilt_errors(motion, SENSING) == pytest.approx(apparent - [0.1, -0.2], abs=1e-12)


def test_the_leaders_tilt_error_is_that_of_a_simulated_filter() -> None:
    sensors = Sensors(
        leader_attitude_sigma_deg=0.5,
        leader_gyro_time_constant_s=3.0,
        leader_gyro_random_walk_deg_sqrt_h=12.0,
    )
    rng = np.random.default_rng(5)
    gamma, samples = 1.0 - np.exp(-0.1 / 3.0), 20_000
    error, history = np.zeros(samples), []
    for _ in range(330):
        # the gyros add a random walk to the angle, then the inclinometer corrects it by its reading
        error = error + np.deg2rad(12.0 / 60.0) * np.sqrt(0.1) * rng.normal(size=samples)
        error += gamma * (np.deg2rad(0.5) * rng.normal(size=samples) - error)
        history.append(error)
    sigma, time = leader_tilt_error(sensors)
    assert time == 3.0
    assert history[-1].std() == pytest.approx(sigma, rel=0.02)
    # the autocorrelation 3 s later is 1/e
    assert np.mean(history[-31] * history[-1]) == pytest.approx(
        sigma**2 / np.e, abs=0.02 * sigma**2
    )
    assert leader_tilt_error(sensors.model_copy(update={"leader_gyro_time_constant_s": 0.0})) == (
        np.deg2rad(0.5),
        0.0,
    )
    # closed form of a stationary AR(1) process: the variance that a step adds, over 1 − decay²
    decay, walk_sigma = np.exp(-0.1 / 3.0), np.deg2rad(12.0 / 60.0) * np.sqrt(0.1)
    added_variance = (decay * walk_sigma) ** 2 + (gamma * np.deg2rad(0.5)) ** 2
    assert sigma == pytest.approx(np.sqrt(added_variance / (1.0 - decay**2)), rel=1e-12)
    # any gyros make the error smaller, those with a time constant of 1 s too
    quick_sigma, quick_time = leader_tilt_error(
        sensors.model_copy(update={"leader_gyro_time_constant_s": 1.0})
    )
    assert quick_time == 1.0
    assert quick_sigma < np.deg2rad(0.5)


@pytest.fixture(scope="module")
def truth() -> IdealMeasurements:
    return make_truth(60)


def attitude_errors(truth: IdealMeasurements, errors: SensorErrors, runs: int) -> Floats:
    """Errors of the broadcast pitch and roll, shape (runs, messages, 2), [rad]."""
    pitch = LeaderMessage._fields.index("pitch")
    broadcast = [
        measure(truth, errors, seed=3, run=run).message[:, pitch : pitch + 2] for run in range(runs)
    ]
    return np.array(broadcast) - np.column_stack([truth.sent.pitch, truth.sent.roll])


@pytest.mark.system
def test_broadcast_errors_have_an_exponential_autocorrelation(truth: IdealMeasurements) -> None:
    errors = SensorErrors(leader_tilt_sigma=0.01, leader_tilt_time=2.0)
    pitch, roll = np.moveaxis(attitude_errors(truth, errors, 4000) / 0.01, -1, 0)
    # messages come every second
    lag_s = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    for angle in (pitch, roll):
        assert angle.T @ angle / 4000 == pytest.approx(np.exp(-lag_s / 2.0), abs=0.08)
    assert pitch.T @ roll / 4000 == pytest.approx(np.zeros((6, 6)), abs=0.08)


@pytest.mark.system
def test_an_offset_stays_throughout_a_run(truth: IdealMeasurements) -> None:
    offsets = attitude_errors(truth, SensorErrors(leader_attitude_offset_sigma=0.03), 2000)
    assert np.ptp(offsets, axis=1).max() < 1e-15
    assert np.cov(offsets[:, 0].T) == pytest.approx(0.03**2 * np.eye(2), abs=0.1 * 0.03**2)


def test_a_scenario_states_the_sensor_in_degrees() -> None:
    sensors = Sensors(
        leader_attitude_sigma_deg=0.5,
        leader_attitude_offset_sigma_deg=0.2,
        leader_attitude_senses_acceleration=True,
        leader_gyro_time_constant_s=30.0,
    )
    scenario = straight.make_scenario(sensors=sensors)
    errors = errors_of(SensingSettings.of(scenario))
    assert errors.leader_attitude_offset_sigma == pytest.approx(np.deg2rad(0.2))
    assert errors.leader_tilt_time == 30.0
    # with γ ≪ 1: σ² = γ σ_i² / 2 + q τ / 2
    gamma, walk_per_s = 0.1 / 30.0, (0.3 / 60.0) ** 2
    expected = np.deg2rad(np.sqrt(gamma * 0.25 / 2 + walk_per_s * 30.0 / 2))
    assert errors.leader_tilt_sigma == pytest.approx(expected, rel=0.003)

    trajectory = straight.make_trajectory((0.0, 20.0, -10.0), heading_pitch_roll=(0.4, 0.1, 0.05))
    with_attitude = scenario.model_copy(
        update={"leader": scenario.leader.model_copy(update={"broadcast_attitude": True})}
    )
    sent, sent_without_attitude = (
        observe(trajectory, SensingSettings.of(with_attitude)).sent,
        observe(trajectory, SensingSettings.of(scenario)).sent,
    )
    assert (sent.pitch, sent.roll) == (
        pytest.approx(np.full(20, 0.1)),
        pytest.approx(np.full(20, 0.05)),
    )
    assert np.isnan([sent_without_attitude.pitch, sent_without_attitude.roll]).all()
