"""Truth as one follower's sensors meet it: what a scenario's errors are added to."""

import numpy as np

from sim.errors import MissionTruth, SensorErrors
from sim.scenario import CONTROL_STEP_S, Scenario
from sim.trajectory import Trajectory

TRANSMITTERS = ("leader/tx_rear", "leader/tx_front", "leader/tx_middle")
"""Sites of P1, P2 and P3."""


def errors_of(scenario: Scenario) -> SensorErrors:
    """The true sensor errors of a scenario in SI units."""
    sensors, acoustics = scenario.sensors, scenario.acoustics
    return SensorErrors(
        speed_bias=sensors.speed_bias_m_s,
        speed_sigma=sensors.speed_sigma_m_s,
        heading_bias=np.deg2rad(sensors.heading_bias_deg),
        heading_sigma=np.deg2rad(sensors.heading_sigma_deg),
        depth_sigma=sensors.depth_sigma_m,
        leader_heading_bias=np.deg2rad(sensors.leader_heading_bias_deg),
        leader_heading_sigma=np.deg2rad(sensors.leader_heading_sigma_deg),
        leader_depth_sigma=sensors.leader_depth_sigma_m,
        leader_pitch_sigma=np.deg2rad(sensors.leader_attitude_sigma_deg),
        leader_roll_sigma=np.deg2rad(sensors.leader_attitude_sigma_deg),
        range_tau=acoustics.range_tau_m,
        range_scale_mean=acoustics.range_scale_mean_m,
        range_scale_sigma=acoustics.range_scale_sigma_m,
    )


def observe(trajectory: Trajectory, scenario: Scenario, follower: int = 0) -> MissionTruth:
    """What the sensors of one follower see of a trajectory, without errors.

    Ranges are distances between the transmitter sites and the hydrophone site at the instant of the ping.

    Args:
        trajectory: of the scenario, on the control grid.
        scenario: gives filter step and message interval.
        follower: its index, 0 for the first.

    Raises:
        ValueError: the trajectory is too short for one filter step.
    """
    dt = scenario.timing.filter_step_s
    stride = round(dt / CONTROL_STEP_S)
    n = (trajectory.time.size - 1) // stride
    if n < 1:
        raise ValueError(f"the trajectory ends at {trajectory.time[-1]:g} s, before the first filter step of {dt:g} s")
    grid = np.arange(1, n + 1) * stride
    v, name = follower + 1, trajectory.names[follower + 1]
    hydrophone = trajectory.site_position[:, trajectory.site(f"{name}/hydrophone")]
    depth_sensor = trajectory.site_position[:, trajectory.site(f"{name}/depth_sensor")]
    # integers count messages: an accumulated time would drop some
    steps = np.arange(scenario.message_every, n + 1, scenario.message_every)
    sent = steps * stride
    transmitters = trajectory.site_position[sent][:, [trajectory.site(t) for t in TRANSMITTERS]]
    attitude = np.stack([trajectory.pitch[sent, 0], trajectory.roll[sent, 0]], axis=1)
    if not scenario.leader.broadcast_attitude:
        attitude = np.full_like(attitude, np.nan)
    leader = trajectory.position[:, 0]
    return MissionTruth(
        dt=dt,
        start=np.concatenate([hydrophone[0, :2], trajectory.velocity[0, v, :2]]),
        speed=trajectory.forward_speed[grid, v],
        heading=trajectory.heading[grid, v],
        depth=-depth_sensor[grid, 2],
        hydrophone=hydrophone[grid, :2],
        leader_position=leader[grid, :2],
        leader_heading=trajectory.heading[grid, 0],
        message_step=steps,
        emission_step=steps,
        timestamp=np.asarray(steps * dt, dtype=np.float64),
        sent_position=np.column_stack([leader[sent, :2], -leader[sent, 2]]),
        sent_heading=trajectory.heading[sent, 0],
        sent_speed=trajectory.forward_speed[sent, 0],
        sent_attitude=attitude,
        slant_range=np.linalg.norm(transmitters - hydrophone[sent][:, None], axis=2),
    )
