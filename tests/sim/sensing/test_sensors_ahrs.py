"""The leader's attitude sensor against closed forms: specific force, what the filter passes, its
random error.
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


def moved(velocity: Floats, quaternion: Floats) -> Trajectory:
    """A leader with velocities of shape (n, 3) and attitudes that broadcast to (n, 4), every 0.1
    s.
    """
    n = len(velocity)
    still = straight.make_trajectory((0.0, 20.0, -10.0))
    pair: dict[str, Any] = {
        name: np.repeat(getattr(still, name)[:1], n, axis=0)
        for name in (
            "position",
            "velocity",
            "quaternion",
            "angular_velocity",
            "water_velocity",
            "effector_states",
        )
    }
    pair["velocity"][:, 0] = velocity
    pair["quaternion"][:, 0] = quaternion
    return synthetic.moved(still, time=0.1 * np.arange(n, dtype=np.float64), **pair)


def apparent_tilt(trajectory: Trajectory) -> Floats:
    """Pitch and roll that the sensor shows at each instant without gyros, shape (n, 2), [rad]."""
    return tilt_errors(trajectory, SENSING) + np.column_stack(
        [trajectory.pitch[:, 0], trajectory.roll[:, 0]]
    )


def test_a_hull_at_rest_shows_its_tilt() -> None:
    pitch, roll = np.deg2rad(7.0), np.deg2rad(-4.0)
    still = moved(np.zeros((5, 3)), attitude.from_euler(1.1, pitch, roll))
    assert apparent_tilt(still) == pytest.approx(np.tile([pitch, roll], (5, 1)), abs=1e-12)


def test_a_hull_that_speeds_up_seems_to_raise_its_nose() -> None:
    time = 0.1 * np.arange(50)
    north = moved(np.outer(time, [0.0, 0.5, 0.0]), attitude.from_euler(0.0))
    assert apparent_tilt(north) == pytest.approx(
        np.tile([np.arctan(0.5 / G), 0.0], (50, 1)), abs=1e-12
    )


def test_a_hull_that_turns_to_port_seems_to_heel_to_starboard() -> None:
    # centripetal acceleration v²/R to port, the mean of the last 0.1 s, in which the hull has
    # turned on
    speed, radius = 1.5, 12.0
    rate = speed / radius
    angle = rate * 0.1 * np.arange(200)
    velocity = speed * np.column_stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)])
    circling = moved(velocity, attitude.from_euler(np.pi / 2 - angle))
    half = rate * 0.1 / 2
    mean = speed**2 / radius * np.sinc(half / np.pi)
    heel = np.arctan(mean * np.cos(half) / G)
    rise = np.arctan(mean * np.sin(half) / np.hypot(mean * np.cos(half), G))
    assert apparent_tilt(circling)[1:] == pytest.approx(np.tile([rise, heel], (199, 1)), abs=1e-12)


def test_the_sensor_is_causal() -> None:
    rng = np.random.default_rng(2)
    rough = moved(
        rng.normal(size=(60, 3)), attitude.from_euler(0.3, *(0.1 * rng.normal(size=(2, 60))))
    )
    past = replace(
        rough,
        time=rough.time[:40],
        **{name: getattr(rough, name)[:40] for name in OF_VEHICLES},
    )
    np.testing.assert_array_equal(tilt_errors(past, SENSING), tilt_errors(rough, SENSING)[:40])


@pytest.mark.parametrize("time_constant", [0.0, 2.0, 10.0])
def test_gyros_keep_waves_out(time_constant: float) -> None:
    # surge a cos ωt of 4 s in a level hull that heaves no more than it pitches: the filter passes γ
    # / |1 − (1 − γ) z|
    amplitude, omega, dt = 0.02, 2 * np.pi / 4.0, 0.1
    time = dt * np.arange(1600)
    surge = np.outer(amplitude / omega * np.sin(omega * time), [1.0, 0.0, 0.0])
    hull = moved(surge, attitude.from_euler(np.pi / 2))
    sensors = SENSING.model_copy(update={"leader_gyro_time_constant_s": time_constant})
    pitch, roll = tilt_errors(hull, sensors)[-800:].T
    share = 1.0 - np.exp(-dt / time_constant) if time_constant else 1.0
    passed = share / abs(1 - (1 - share) * np.exp(-1j * omega * dt))
    swing = amplitude / G * np.sinc(omega * dt / (2 * np.pi)) * passed
    # 20 whole periods: the root mean square is that of a sine; arctan is linear to 1e-6 here
    assert np.sqrt(2 * np.mean(pitch**2)) == pytest.approx(swing, rel=1e-5)
    assert np.abs(roll).max() < 1e-12
    if time_constant == 10.0:
        assert passed == pytest.approx(1 / (omega * time_constant), rel=0.02)


def test_without_accelerations_the_attitude_is_true() -> None:
    rough = moved(
        np.random.default_rng(1).normal(size=(30, 3)), attitude.from_euler(0.3, 0.1, -0.2)
    )
    assert not tilt_errors(rough, Sensors(leader_gyro_time_constant_s=5.0)).any()
    # specific force in the hull's axes; the acceleration of a step is known at its end
    force = np.diff(rough.velocity[:, 0], axis=0, prepend=0.0) / 0.1 + [0.0, 0.0, G]
    force[0] = force[1]
    forward, port, up = attitude.rotate(rough.quaternion[:, 0] * [1.0, -1.0, -1.0, -1.0], force).T
    shown = np.column_stack([np.arctan2(forward, np.hypot(port, up)), np.arctan2(port, up)])
    assert tilt_errors(rough, SENSING) == pytest.approx(shown - [0.1, -0.2], abs=1e-12)


def test_the_leaders_tilt_error_is_that_of_the_filter_itself() -> None:
    sensors = Sensors(
        leader_attitude_sigma_deg=0.5,
        leader_gyro_time_constant_s=3.0,
        leader_gyro_random_walk_deg_sqrt_h=12.0,
    )
    rng = np.random.default_rng(5)
    share, lanes = 1.0 - np.exp(-0.1 / 3.0), 20_000
    error, history = np.zeros(lanes), []
    for _ in range(330):
        # gyros carry the angle on, then the inclinometer draws it towards its own reading
        error = error + np.deg2rad(12.0 / 60.0) * np.sqrt(0.1) * rng.normal(size=lanes)
        error += share * (np.deg2rad(0.5) * rng.normal(size=lanes) - error)
        history.append(error)
    sigma, time = leader_tilt_error(sensors)
    assert time == 3.0
    assert history[-1].std() == pytest.approx(sigma, rel=0.02)
    # 3 s later a share 1/e of it is left
    assert np.mean(history[-31] * history[-1]) == pytest.approx(
        sigma**2 / np.e, abs=0.02 * sigma**2
    )
    assert leader_tilt_error(sensors.model_copy(update={"leader_gyro_time_constant_s": 0.0})) == (
        np.deg2rad(0.5),
        0.0,
    )
    # in closed form: what a step adds, over what it takes away
    kept, step = np.exp(-0.1 / 3.0), np.deg2rad(12.0 / 60.0) * np.sqrt(0.1)
    added = (kept * step) ** 2 + (share * np.deg2rad(0.5)) ** 2
    assert sigma == pytest.approx(np.sqrt(added / (1.0 - kept**2)), rel=1e-12)
    # any gyros make it smaller, those of a second too
    quick_sigma, quick_time = leader_tilt_error(
        sensors.model_copy(update={"leader_gyro_time_constant_s": 1.0})
    )
    assert quick_time == 1.0
    assert quick_sigma < np.deg2rad(0.5)


@pytest.fixture(scope="module")
def truth() -> IdealMeasurements:
    return make_truth(60)


def pitch_errors(truth: IdealMeasurements, errors: SensorErrors, runs: int) -> Floats:
    """Errors of the broadcast pitch and roll, shape (runs, messages, 2), [rad]."""
    pitch = LeaderMessage._fields.index("pitch")
    read = [
        measure(truth, errors, seed=3, run=run).message[:, pitch : pitch + 2] for run in range(runs)
    ]
    return np.array(read) - np.column_stack([truth.sent.pitch, truth.sent.roll])


@pytest.mark.system
def test_broadcast_errors_die_away_with_time(truth: IdealMeasurements) -> None:
    errors = SensorErrors(leader_tilt_sigma=0.01, leader_tilt_time=2.0)
    pitch, roll = np.moveaxis(pitch_errors(truth, errors, 4000) / 0.01, -1, 0)
    # messages come every second
    lag = np.abs(np.subtract.outer(np.arange(6), np.arange(6)))
    for angle in (pitch, roll):
        assert angle.T @ angle / 4000 == pytest.approx(np.exp(-lag / 2.0), abs=0.08)
    assert pitch.T @ roll / 4000 == pytest.approx(np.zeros((6, 6)), abs=0.08)


@pytest.mark.system
def test_an_offset_stays_throughout_a_run(truth: IdealMeasurements) -> None:
    offsets = pitch_errors(truth, SensorErrors(leader_attitude_offset_sigma=0.03), 2000)
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
    share, walk = 0.1 / 30.0, (0.3 / 60.0) ** 2
    expected = np.deg2rad(np.sqrt(share * 0.25 / 2 + walk * 30.0 / 2))
    assert errors.leader_tilt_sigma == pytest.approx(expected, rel=0.003)

    turning = straight.make_trajectory((0.0, 20.0, -10.0), heading_pitch_roll=(0.4, 0.1, 0.05))
    loud = scenario.model_copy(
        update={"leader": scenario.leader.model_copy(update={"broadcast_attitude": True})}
    )
    sent, silent = (
        observe(turning, SensingSettings.of(loud)).sent,
        observe(turning, SensingSettings.of(scenario)).sent,
    )
    assert (sent.pitch, sent.roll) == (
        pytest.approx(np.full(20, 0.1)),
        pytest.approx(np.full(20, 0.05)),
    )
    assert np.isnan([silent.pitch, silent.roll]).all()
