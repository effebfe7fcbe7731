"""What sensors measure of a mission without their errors: formulas of vehicles on circles."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Acoustics, Sensors
from sim.sensing.observation import measure, observe, start_of
from sim.sensing.sensors import errors_of
from sim.trajectory import OF_VEHICLES
from tests import synthetic

DEPTH_SENSOR_BELOW_M = 0.05
"""Distance of the follower's depth sensor below its origin [m]."""


@pytest.mark.parametrize(("step", "interval"), [(0.1, 1.0), (0.2, 2.0)])
def test_truth_is_that_of_the_motion_at_filter_steps_and_messages(
    step: float, interval: float
) -> None:
    """For the second follower; times, headings and positions by the formulas of `synthetic`."""
    scenario = synthetic.make_scenario(20.0, 2, filter_step=step, message_interval=interval)
    trajectory = synthetic.make_trajectory(scenario)
    offset = trajectory.site_offset.copy()
    offset[trajectory.site("follower2/depth_sensor")] = 0.0, 0.0, -DEPTH_SENSOR_BELOW_M
    trajectory = replace(trajectory, site_offset=offset)
    truth = observe(trajectory, SensingSettings.of(scenario), 1)
    steps = np.arange(1, round(20.0 / step) + 1)
    time, ticks = steps * step, steps * round(step / 0.1)
    radius = synthetic.LEADER_RADIUS_M + 2 * synthetic.LANE_M
    angle = time / synthetic.LEADER_RADIUS_M - synthetic.LAG_RAD
    pitch_roll = [
        np.deg2rad(3.0) * np.sin(0.4 * time + 2.0),
        np.deg2rad(2.0) * np.cos(0.7 * (0.4 * time + 2.0)),
    ]
    assert truth.heading == pytest.approx(np.mod(np.pi / 2 - angle, 2 * np.pi))
    forward = np.column_stack(
        [
            np.cos(pitch_roll[0]) * np.cos(angle),
            np.cos(pitch_roll[0]) * np.sin(angle),
            np.sin(pitch_roll[0]),
        ]
    )
    velocity_through_water = trajectory.velocity[ticks, 2] - [0.10, -0.05, 0.0]
    assert truth.speed == pytest.approx(np.sum(forward * velocity_through_water, axis=1))
    up_component = np.cos(pitch_roll[0]) * np.cos(pitch_roll[1])
    assert truth.depth == pytest.approx(
        11.0 - 0.1 * np.cos(0.4 * time + 2.0) + DEPTH_SENSOR_BELOW_M * up_component
    )
    # the hydrophone sits 0.1 m above the axis and leans with the hull
    on_axis = radius * np.column_stack([np.sin(angle), -np.cos(angle)]) + [
        0.0,
        synthetic.LEADER_RADIUS_M,
    ]
    assert (
        np.abs(truth.hydrophone - on_axis).max()
        < 0.1 * np.sin(np.hypot(*np.max(np.abs(pitch_roll), axis=1))) + 1e-9
    )
    assert truth.leader_position == pytest.approx(trajectory.position[ticks, 0, :2])
    sent = np.arange(interval, 20.0 + 1e-9, interval)
    leader_angle = sent / synthetic.LEADER_RADIUS_M
    assert truth.sent.timestamp == pytest.approx(sent)
    assert truth.message_step == pytest.approx(sent / step)
    assert truth.sent.heading == pytest.approx(np.mod(np.pi / 2 - leader_angle, 2 * np.pi))
    assert np.column_stack([truth.sent.east, truth.sent.north]) == pytest.approx(
        trajectory.position[np.round(sent / 0.1).astype(int), 0, :2]
    )
    assert truth.sent.depth == pytest.approx(8.0 - 0.1 * np.cos(0.4 * sent))
    assert truth.sent.speed == pytest.approx(
        trajectory.forward_speed[np.round(sent / 0.1).astype(int), 0]
    )
    start_velocity = trajectory.velocity[0, 2, :2] - [0.10, -0.05]
    assert start_of(trajectory, 1)[2:] == pytest.approx(start_velocity)
    assert np.hypot(*(start_of(trajectory, 1)[:2] - trajectory.position[0, 2, :2])) < 0.01


def test_errors_are_those_of_the_scenario_in_si_units() -> None:
    """Each setting has a value of its own, so that none is taken for another."""
    sensors = Sensors(
        speed_bias_m_s=0.11,
        speed_sigma_m_s=0.12,
        heading_bias_deg=-1.3,
        heading_sigma_deg=1.4,
        depth_sigma_m=0.15,
        leader_speed_bias_m_s=-0.17,
        leader_heading_bias_deg=-1.6,
        leader_heading_sigma_deg=1.7,
        leader_depth_sigma_m=0.18,
        leader_position_sigma_m=0.31,
        leader_position_walk_m_sqrt_s=0.32,
        leader_attitude_sigma_deg=1.9,
        leader_attitude_offset_sigma_deg=2.1,
    )
    acoustics = Acoustics(
        range_tau_m=(0.01, 0.02, 0.03),
        range_scale_mean_m=0.04,
        range_scale_sigma_m=0.05,
        surface_echo_probability=0.06,
        bottom_echo_probability=0.07,
        range_error_centred=True,
        loss_probability=0.08,
        burst_probability=0.09,
        burst_mean_messages=4.0,
        burst_loss_probability=0.91,
    )
    errors = errors_of(
        SensingSettings.of(
            synthetic.make_scenario().model_copy(
                update={"sensors": sensors, "acoustics": acoustics}
            )
        )
    )
    expected = {
        "speed_bias": 0.11,
        "speed_sigma": 0.12,
        "heading_bias": np.deg2rad(-1.3),
        "heading_sigma": np.deg2rad(1.4),
        "depth_sigma": 0.15,
        "leader_heading_bias": np.deg2rad(-1.6),
        "leader_speed_bias": -0.17,
        "leader_heading_sigma": np.deg2rad(1.7),
        "leader_depth_sigma": 0.18,
        "leader_position_sigma": 0.31,
        "leader_position_walk": 0.32,
        "leader_tilt_sigma": np.deg2rad(1.9),
        "leader_tilt_time": 0.0,
        "leader_attitude_offset_sigma": np.deg2rad(2.1),
        "range_tau": (0.01, 0.02, 0.03),
        "range_error_centred": True,
        "range_scale_mean": 0.04,
        "range_scale_sigma": 0.05,
        "surface_echo_probability": 0.06,
        "bottom_echo_probability": 0.07,
        "loss_probability": 0.08,
        "burst_probability": 0.09,
        "burst_mean_messages": 4.0,
        "burst_loss_probability": 0.91,
    }
    for name, value in expected.items():
        assert getattr(errors, name) == pytest.approx(value), name


def test_a_motion_is_observed_from_its_start() -> None:
    """A motion that begins later is refused: errors of the leader's attitude depend on its past."""
    scenario = synthetic.make_scenario(20.0)
    trajectory = synthetic.make_trajectory(scenario)
    fields_over_time = ("time", *OF_VEHICLES)
    without_start = replace(
        trajectory, **{name: getattr(trajectory, name)[80:] for name in fields_over_time}
    )
    with pytest.raises(ValueError, match="begins at 8 s"):
        observe(without_start, SensingSettings.of(scenario))


def test_sensing_a_long_mission_takes_less_memory_than_the_mission_itself() -> None:
    """For ten hours: intermediate values are computed in blocks."""
    scenario = synthetic.make_scenario(36_000.0, 1)
    trajectory = synthetic.make_trajectory(scenario)
    mission_bytes = sum(getattr(trajectory, name).nbytes for name in OF_VEHICLES)
    tracemalloc.start()
    try:
        observe(trajectory, SensingSettings.of(scenario))
        assert tracemalloc.get_traced_memory()[1] < mission_bytes
    finally:
        tracemalloc.stop()


def test_compiled_code_senses_the_bits_that_python_does() -> None:
    """With echoes, losses, refraction and all errors: a campaign, which is compiled, senses what a
    single flight does.
    """
    acoustics = Acoustics(
        travel_time=True,
        ping_slot_s=0.05,
        surface_echo_probability=0.2,
        bottom_echo_probability=0.1,
        loss_probability=0.1,
        burst_probability=0.1,
        sound_speed_profile=((0.0, 1480.0), (20.0, 1510.0)),
        clock_drift_ppm=20.0,
        max_range_m=60.0,
    )
    sensors = Sensors(
        speed_drift_m_s=0.1,
        heading_drift_deg=2.0,
        depth_sigma_m=0.1,
        leader_heading_sigma_deg=1.0,
        leader_depth_sigma_m=0.1,
        leader_attitude_sigma_deg=0.5,
        leader_attitude_offset_sigma_deg=0.2,
        leader_gyro_time_constant_s=3.0,
        leader_attitude_senses_acceleration=True,
    )
    scenario = synthetic.make_scenario(60.0, 2)
    leader = scenario.leader.model_copy(update={"broadcast_attitude": True})
    scenario = scenario.model_copy(
        update={"acoustics": acoustics, "sensors": sensors, "leader": leader}
    )
    trajectory = synthetic.make_trajectory(scenario)
    by_python, by_compiled = (
        observe(trajectory, SensingSettings.of(scenario), 1, use_compiled=use_compiled)
        for use_compiled in (False, True)
    )
    assert len(by_python.message_step) > 50
    errors = errors_of(SensingSettings.of(scenario), 1)
    measured = [
        measure(truth, errors, seed=5, run=3, follower=1, use_compiled=truth is by_compiled)
        for truth in (by_python, by_compiled)
    ]
    for expected, actual in ((by_python, by_compiled), measured):
        for name, value in vars(expected).items():
            if isinstance(value, np.ndarray):
                assert value.tobytes() == getattr(actual, name).tobytes(), name
    assert np.isnan(measured[0].ranges).any()
    # columns of the leader's pitch and roll
    assert np.isfinite(measured[0].message[:, 6:8]).all()
