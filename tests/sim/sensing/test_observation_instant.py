"""What followers read and receive at an instant of a mission that is being flown."""

from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats, numbers_of, records
from laisn.swarm import READING
from sim import attitude
from sim.scenario.parts import SensingSettings
from sim.scenario.sensors import VehicleSensors
from sim.scenario.settings import Scenario, Sensors
from sim.sensing.acoustics import Motion, Sites
from sim.sensing.noise import Stream, normals, uniforms
from sim.sensing.own_sensors import new_instrument_noise, read_instruments, read_roll
from sim.sensing.reception import NO_RANGES, RECEIVED, new_inbox, receive
from sim.sensing.sensor_model import SensorModel, sensor_model_of
from sim.trajectory import StateHistory
from sim.water.floors import LevelFloor
from tests.synthetic import make_scenario

PITCH, RATES = 0.1, (0.02, -0.03, 0.05)
"""Pitch [rad] and rates of turn about the forward, port and up axis [rad/s]."""


def scenario(tilt_sigma_deg: float, gyro_sigma_deg_s: float) -> Scenario:
    """A scenario with two followers and these deviations of inclinometers and gyros."""
    sensors = Sensors(tilt_sigma_deg=tilt_sigma_deg, gyro_sigma_deg_s=gyro_sigma_deg_s)
    one_follower = make_scenario(10.0)
    return one_follower.model_copy(
        update={"sensors": sensors, "followers": one_follower.followers * 2}
    )


def vehicles_at_rest(poses: Floats, instants: int) -> StateHistory:
    """Poses, shape (v, 7), that stay the same at all instants."""
    states = StateHistory(*(np.zeros((instants, len(poses), columns)) for columns in (7, 6, 3, 5)))
    states.pose[:] = poses
    return states


def with_errors(sensors: SensorModel, **errors: Any) -> SensorModel:
    """The same sensors, whose errors are set in place."""
    for name, value in errors.items():
        sensors.errors[name] = value
    return sensors


def attitude_readings(sensors: SensorModel, steps: int, follower: int = 0) -> Floats:
    """Readings of pitch and of the turning about the up and the port axis, step by step, shape
    (steps, 3).
    """
    pose, twist = (
        np.r_[0.0, 0.0, -10.0, attitude.from_euler(1.0, PITCH, 0.2)],
        np.r_[1.0, 0.0, 0.0, RATES],
    )
    readings = records(READING, steps)
    drawn = new_instrument_noise(2)
    for k in range(steps):
        read_instruments(
            sensors,
            k + 1,
            follower,
            (pose, twist, np.zeros(3)),
            np.zeros(3),
            drawn,
            numbers_of(readings)[k],
        )
    return numbers_of(readings)[:, 3:6]


@pytest.mark.system
def test_readings_are_those_of_their_step_whatever_was_read_before() -> None:
    """Noise is drawn for several steps at once, also of steps that are read out of order."""
    sensors = sensor_model_of(SensingSettings.of(scenario(0.5, 0.1)))
    state = (np.r_[0.0, 0.0, -10.0, attitude.from_euler(1.0)], np.zeros(6), np.zeros(3))
    kept = new_instrument_noise(2)
    steps = [0, 1, 15, 16, 17, 40, 39, 3, 3000, 2]
    readings = records(READING, 2, len(steps), 2)
    for j, step in enumerate(steps):
        for i, drawn in enumerate((kept, new_instrument_noise(2))):
            for follower in range(2):
                reading = numbers_of(readings)[i, j, follower]
                read_instruments(sensors, step, follower, state, np.zeros(3), drawn, reading)
    np.testing.assert_array_equal(readings[0], readings[1])
    assert len({row.tobytes() for row in numbers_of(readings)[0].reshape(-1, 8)}) == 2 * len(steps)
    other_run = sensors._replace(run=np.uint64(8))
    reading = numbers_of(records(READING, 1))[0]
    read_instruments(other_run, 3, 1, state, np.zeros(3), new_instrument_noise(2), reading)
    assert reading.tobytes() != numbers_of(readings)[0, 7, 1].tobytes()


def test_heel_and_rate_of_roll_are_read_with_errors_of_inclinometer_and_gyro() -> None:
    """Of vehicles that hold roll; the sine of the heel is sin(roll) cos(pitch)."""
    n = 2000
    pose, twist = (
        np.r_[0.0, 0.0, -10.0, attitude.from_euler(1.0, PITCH, 0.2)],
        np.r_[1.0, 0.0, 0.0, RATES],
    )
    expected = [np.sin(0.2) * np.cos(PITCH), RATES[0]]
    sensors = sensor_model_of(SensingSettings.of(scenario(0.5, 0.1)))
    readings = records(READING, n)
    for k in range(n):
        read_roll(sensors, k + 1, 1, (pose, twist, np.zeros(3)), numbers_of(readings)[k])
    assert not numbers_of(readings)[:, :6].any()
    errors = numbers_of(readings)[:, 6:] - expected
    sigma = np.deg2rad([0.5, 0.1])
    assert np.all(np.abs(errors.mean(axis=0)) < 5 * sigma / np.sqrt(n))
    assert errors.std(axis=0) == pytest.approx(sigma, rel=5 / np.sqrt(2 * n))
    # independent of each other and of the other instruments
    errors = np.hstack([errors, attitude_readings(sensors, n, follower=1)])
    assert np.abs(np.corrcoef(errors.T) - np.eye(5)).max() < 5 / np.sqrt(n)
    perfect = sensor_model_of(SensingSettings.of(scenario(0.0, 0.0)))
    read_roll(perfect, 1, 1, (pose, twist, np.zeros(3)), numbers_of(readings)[0])
    assert (readings[0].heel, readings[0].rolling) == pytest.approx(expected)


@pytest.mark.system
def test_perfect_instruments_read_pitch_and_the_rates_of_the_hull() -> None:
    assert attitude_readings(sensor_model_of(SensingSettings.of(scenario(0.0, 0.0))), 1)[
        0
    ] == pytest.approx([PITCH, RATES[2], RATES[1]])


def test_sensor_errors_have_the_scenarios_deviations_and_are_independent() -> None:
    n = 2000
    actual = attitude_readings(sensor_model_of(SensingSettings.of(scenario(0.5, 0.1))), n)
    sigma = np.deg2rad([0.5, 0.1, 0.1])
    # five standard deviations of a mean, and of a standard deviation
    assert np.all(
        np.abs(actual.mean(axis=0) - [PITCH, RATES[2], RATES[1]]) < 5 * sigma / np.sqrt(n)
    )
    assert actual.std(axis=0) == pytest.approx(sigma, rel=5 / np.sqrt(2 * n))
    assert np.abs(np.corrcoef(actual.T) - np.eye(3)).max() < 5 / np.sqrt(n)
    of_other_follower = attitude_readings(
        sensor_model_of(SensingSettings.of(scenario(0.5, 0.1))), n, follower=1
    )
    assert np.abs(
        [np.corrcoef(a, b)[0, 1] for a, b in zip(actual.T, of_other_follower.T, strict=True)]
    ).max() < 5 / np.sqrt(n)


def test_one_follower_has_errors_of_its_own() -> None:
    """Compass, log and inclinometer of the second have errors; the first reads the same bits as
    without them.
    """
    without_errors = scenario(0.0, 0.0)
    erring_follower = without_errors.followers[0].model_copy(
        update={
            "sensors": VehicleSensors(
                heading_bias_deg=-12.0,
                heading_sigma_deg=0.0,
                speed_sigma_m_s=0.0,
                speed_bias_m_s=-0.25,
                tilt_sigma_deg=1.0,
            )
        }
    )
    with_errors_of_second = without_errors.model_copy(
        update={"followers": (without_errors.followers[0], erring_follower)}
    )
    pose, twist = (
        np.r_[0.0, 0.0, -10.0, attitude.from_euler(1.0)],
        np.r_[np.sin(1.0), np.cos(1.0), 0.0, 0.0, 0.0, 0.0],
    )
    readings = records(READING, 2, 2)
    for i, world in enumerate((without_errors, with_errors_of_second)):
        for follower in range(2):
            read_instruments(
                sensor_model_of(SensingSettings.of(world)),
                7,
                follower,
                (pose, twist, np.zeros(3)),
                np.zeros(3),
                new_instrument_noise(2),
                numbers_of(readings)[i, follower],
            )
    np.testing.assert_array_equal(readings[0, 0], readings[1, 0])
    tilt = (
        np.deg2rad(1.0)
        * normals(without_errors.seed, without_errors.run, Stream.TILT.number(1), [7])[0, 0]
    )
    assert readings[1, 1].tolist() == pytest.approx(
        [0.75, 1.0 - np.deg2rad(12.0), 10.0, tilt, 0.0, 0.0, 0.0, 0.0], abs=1e-12
    )


@pytest.mark.system
@pytest.mark.parametrize("centre", [0.0, 0.5])
@pytest.mark.parametrize("transmitters_used", [2, 3])
def test_each_range_has_the_error_of_its_own_ping(transmitters_used: int, centre: float) -> None:
    """By Equation 28 of the paper with another τ for each transmitter and the draws of step, run
    and follower. `centre` is subtracted from the uniform draws.
    """
    taus, (mean, sigma), seed, run = (0.1, 0.2, 0.4), (0.3, 0.05), 2, 5
    sensors = sensor_model_of(
        SensingSettings.of(scenario(0.0, 0.0).model_copy(update={"seed": seed, "run": run}))
    )
    sensors = with_errors(
        sensors,
        range_tau=taus,
        range_error_centred=centre > 0.0,
        range_scale_mean=mean,
        range_scale_sigma=sigma,
    )
    sensors = sensors._replace(transmitters=np.full(2, transmitters_used))
    transmitters = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    hydrophones = np.full((2, 3), [0.0, 0.0, 0.1])
    # the leader heads east, the second follower north
    poses = np.array(
        [
            np.r_[0.0, 0.0, -8.0, attitude.from_euler(np.pi / 2)],
            np.r_[9.0, 9.0, -9.0, attitude.from_euler(0.0)],
            np.r_[-30.0, 20.0, -10.0, attitude.from_euler(0.0)],
        ]
    )
    offset = np.array([-30.0, 20.0, -1.9]) - transmitters
    true = np.linalg.norm(offset, axis=1)
    truth, inbox = vehicles_at_rest(poses, 21), new_inbox(2, 10)
    for k in (10, 20):
        receive(
            sensors,
            k,
            1,
            Sites(transmitters, hydrophones),
            Motion(truth, 0.0, k),
            np.zeros((21, 2)),
            inbox,
        )
        assert inbox.outcome.tolist() == [0, RECEIVED]
        actual = inbox.ranges[1]
        draws = uniforms(seed, run, Stream.RANGE_UNIFORM.number(1), [k])[0]
        psi = mean + sigma * normals(seed, run, Stream.RANGE_SCALE.number(1), [k])[0, 0]
        longest = np.array([true[:transmitters_used].max()] * 2 + [true.max()])
        assert actual == pytest.approx(
            true + taus * (draws[:3] - centre) + psi * true / longest, abs=1e-9
        )


@pytest.mark.parametrize("common_echoes", [False, True])
def test_ranges_have_echoes_clock_errors_losses_and_a_maximum_range(
    common_echoes: bool,
) -> None:
    """All errors of a range at once, by their formulas, for 60 successive messages."""
    taus, (mean, sigma), seed, run, floor, max_range = (
        (0.1, 0.2, 0.4),
        (0.3, 0.05),
        2,
        5,
        35.0,
        45.2,
    )
    sensors = sensor_model_of(
        SensingSettings.of(scenario(0.0, 0.0).model_copy(update={"seed": seed, "run": run}))
    )
    sensors = with_errors(
        sensors,
        range_tau=taus,
        range_scale_mean=mean,
        range_scale_sigma=sigma,
        surface_echo_probability=0.3,
        bottom_echo_probability=0.2,
        common_echoes=common_echoes,
        loss_probability=0.1,
        burst_probability=0.25,
        burst_mean_messages=3.0,
        burst_loss_probability=0.8,
    )._replace(
        transmitters=np.full(1, 3),
        sound=sensors.sound._replace(
            paths=(True, True, True),
            rays=sensors.sound.rays._replace(floor=LevelFloor(floor)),
            max_range=max_range,
            ratio=1.01,
            assumed_speed=1515.0,
            clock_offset=2e-4,
            clock_drift=1e-6,
        ),
    )
    transmitters = np.array([[-1.0, 0.0, 0.2], [1.0, 0.0, 0.2], [0.0, 0.1, -0.1]])
    leader_attitude = attitude.from_euler(np.pi / 2, PITCH, 0.2)
    poses = np.array(
        [
            np.r_[0.0, 0.0, -8.0, leader_attitude],
            np.r_[-36.0, 27.0, -10.0, attitude.from_euler(0.0)],
        ]
    )
    hydrophone, sources = (
        poses[1, :3] + [0.0, 0.0, 0.1],
        poses[0, :3] + attitude.rotate(leader_attitude, transmitters),
    )
    direct = np.linalg.norm(sources - hydrophone, axis=1)
    assert direct.min() < max_range < direct.max(), "one transmitter is out of reach"
    truth, inbox, in_burst, received, steps_in_bursts = (
        vehicles_at_rest(poses, 601),
        new_inbox(1, 10),
        False,
        [],
        0,
    )
    for k in range(10, 610, 10):
        receive(
            sensors,
            k,
            0,
            Sites(transmitters, np.array([[0.0, 0.0, 0.1]])),
            Motion(truth, 0.0, k),
            np.zeros((601, 2)),
            inbox,
        )
        actual, any_received = inbox.ranges[0], inbox.outcome[0] == RECEIVED
        assert any_received or inbox.outcome[0] == NO_RANGES
        streams = Stream.ECHO, Stream.RANGE_UNIFORM, Stream.LOSS
        echo_draw, range_draw, loss_draw = (
            uniforms(seed, run, stream.number(0), [k])[0, :3] for stream in streams
        )
        echo_draw = np.full(3, echo_draw[0]) if common_echoes else echo_draw
        # mirrored in the surface, in the floor or not at all
        image_height = np.where(
            echo_draw < 0.3,
            -sources[:, 2],
            np.where(echo_draw < 0.5, -2 * floor - sources[:, 2], sources[:, 2]),
        )
        path_length = np.hypot(
            np.hypot(*(sources - hydrophone)[:, :2].T), image_height - hydrophone[2]
        )
        expected = np.where(
            direct <= max_range,
            1.01 * path_length + 1515.0 * (2e-4 + 1e-6 * k * sensors.dt),
            np.nan,
        )
        psi = mean + sigma * normals(seed, run, Stream.RANGE_SCALE.number(0), [k])[0, 0]
        expected += taus * range_draw + psi * expected / np.nanmax(expected)
        # a burst of three messages on average ends with a probability of a third
        in_burst = loss_draw[0] >= 1 / 3 if in_burst else loss_draw[0] < 0.25
        if loss_draw[1] < (0.8 if in_burst else 0.1):
            expected[:] = np.nan
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9)
        assert any_received == bool(np.isfinite(expected).any())
        received.append(any_received)
        steps_in_bursts += in_burst
    assert 10 < steps_in_bursts < 50
    assert 10 < sum(received) < 50


def test_log_compass_and_depth_sensor_err_by_equations_26_and_27() -> None:
    """Bias and deviation of each, with the draws of step, run and follower; the log measures the
    speed through the water along the hull.
    """
    seed, run, k = 2, 5, 30
    sensors = sensor_model_of(
        SensingSettings.of(scenario(0.0, 0.0).model_copy(update={"seed": seed, "run": run}))
    )
    errors = sensors.errors[1]
    errors.speed_bias, errors.speed_sigma, errors.heading_bias, errors.heading_sigma = (
        0.1,
        0.02,
        0.05,
        0.01,
    )
    errors.depth_sigma = 0.3
    quaternion = attitude.from_euler(1.0, PITCH, 0.2)
    twist, water, readings = (
        np.r_[0.9, 0.7, 0.2, RATES],
        np.array([0.1, -0.2, 0.05]),
        records(READING, 1),
    )
    reading = readings[0]
    read_instruments(
        sensors,
        k,
        1,
        (np.r_[3.0, 4.0, -10.0, quaternion], twist, water),
        np.array([0.5, 0.0, 0.0]),
        new_instrument_noise(2),
        numbers_of(readings)[0],
    )
    motion, depth = (
        normals(seed, run, stream.number(1), [k])[0] for stream in (Stream.OWN_MOTION, Stream.DEPTH)
    )
    assert reading.speed == pytest.approx(
        attitude.forward_of(quaternion) @ (twist[:3] - water) + 0.1 + 0.02 * motion[0]
    )
    assert reading.heading == pytest.approx(1.0 + 0.05 + 0.01 * abs(motion[1]))
    assert reading.depth == pytest.approx(10.0 - 0.5 * np.sin(PITCH) + 0.3 * depth[0])
    # inclinometer and gyros likewise, in the order up and port
    errors.tilt_sigma, errors.gyro_sigma = 0.02, 0.004
    read_instruments(
        sensors,
        k,
        1,
        (np.r_[3.0, 4.0, -10.0, quaternion], twist, water),
        np.zeros(3),
        new_instrument_noise(2),
        numbers_of(readings)[0],
    )
    tilt, gyro = (
        normals(seed, run, stream.number(1), [k])[0] for stream in (Stream.TILT, Stream.GYRO)
    )
    expected = [PITCH + 0.02 * tilt[0], RATES[2] + 0.004 * gyro[0], RATES[1] + 0.004 * gyro[1]]
    assert reading.tolist()[3:6] == pytest.approx(expected)


def test_a_leader_broadcasts_its_position_motion_and_attitude() -> None:
    seed, run, k = 2, 5, 40
    sensors = sensor_model_of(
        SensingSettings.of(scenario(0.0, 0.0).model_copy(update={"seed": seed, "run": run}))
    )
    sensors = with_errors(
        sensors,
        leader_speed_bias=0.1,
        leader_heading_bias=0.05,
        leader_heading_sigma=0.01,
        leader_depth_sigma=0.3,
        leader_position_sigma=0.7,
        leader_position_walk=0.2,
        leader_attitude_offset_sigma=0.001,
        leader_tilt_sigma=0.002,
    )
    poses = np.array(
        [
            np.r_[3.0, 4.0, -9.0, attitude.from_euler(1.0, PITCH, 0.2)],
            np.r_[9.0, 9.0, -9.0, 1.0, np.zeros(3)],
        ]
    )
    truth, inbox, sites = (
        vehicles_at_rest(poses, k + 1),
        new_inbox(1, 10, sent_before=3),
        Sites(np.zeros((3, 3)), np.zeros((1, 3))),
    )
    truth.twist[k, 0] = 0.9, 0.7, 0.2, *RATES
    receive(sensors, k, 0, sites, Motion(truth, 0.0, k), np.full((k + 1, 2), (0.02, -0.03)), inbox)
    streams = (Stream.LEADER_MOTION, Stream.LEADER_DEPTH, Stream.LEADER_ATTITUDE)
    motion, depth, tilt = (normals(seed, run, stream, [k])[0] for stream in streams)
    attitude_offset = normals(seed, run, Stream.LEADER_ATTITUDE, [0])[0]
    position_error = 0.7 * normals(seed, run, Stream.LEADER_POSITION, [k])[0]
    # a random walk from the start, with a draw for each filter step
    random_walk = normals(seed, run, Stream.LEADER_POSITION_WALK, range(1, k + 1)).sum(axis=0)
    position_error += 0.2 * np.sqrt(sensors.dt) * random_walk
    expected = [
        k * sensors.dt,
        3.0 + position_error[0],
        4.0 + position_error[1],
        1.0 + 0.05 + 0.01 * abs(motion[1]),
        attitude.forward_of(poses[0, 3:]) @ truth.twist[k, 0, :3] + 0.1,
        9.0 + 0.3 * depth[0],
        PITCH + 0.02 + 0.001 * attitude_offset[0] + 0.002 * tilt[0],
        0.2 - 0.03 + 0.001 * attitude_offset[1] + 0.002 * tilt[1],
    ]
    assert inbox.message[0].tolist() == pytest.approx([*expected, np.nan, np.nan], nan_ok=True)
