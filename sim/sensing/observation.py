"""Truth as one follower's sensors meet it: what a scenario's errors are added to."""

import numpy as np

from laisn.arrays import Floats
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import TRANSMITTERS as TRANSMITTERS
from sim.sensing.acoustics import propagate
from sim.sensing.ahrs import measured_attitude, random_error
from sim.sensing.drift import apply_bias_drift
from sim.sensing.echo import Path
from sim.sensing.hearing import Hearing
from sim.sensing.loss import Channel
from sim.sensing.sensor_errors import SensorErrors
from sim.sensing.truth import MissionTruth
from sim.trajectory import Trajectory

SITES = ("tx_rear", "tx_front", "tx_middle", "depth_sensor", "hydrophone")
"""Sites of leader and follower that sensing needs."""


def errors_of(scenario: Scenario, follower: int = 0) -> SensorErrors:
    """The true errors of a follower's and the leader's sensors in SI units."""
    own, sensors, acoustics = scenario.sensors_of(follower), scenario.sensors, scenario.acoustics
    attitude = random_error(sensors)
    return SensorErrors(
        speed_bias=own.speed_bias_m_s,
        speed_sigma=own.speed_sigma_m_s,
        heading_bias=np.deg2rad(own.heading_bias_deg),
        heading_sigma=np.deg2rad(own.heading_sigma_deg),
        depth_sigma=own.depth_sigma_m,
        leader_speed_bias=sensors.leader_speed_bias_m_s,
        leader_heading_bias=np.deg2rad(sensors.leader_heading_bias_deg),
        leader_heading_sigma=np.deg2rad(sensors.leader_heading_sigma_deg),
        leader_depth_sigma=sensors.leader_depth_sigma_m,
        leader_pitch_sigma=attitude.sigma,
        leader_roll_sigma=attitude.sigma,
        leader_attitude_time=attitude.time,
        leader_attitude_offset_sigma=np.deg2rad(sensors.leader_attitude_offset_sigma_deg),
        range_tau=acoustics.range_tau_m,
        range_centre=0.5 if acoustics.range_error_centred else 0.0,
        range_scale_mean=acoustics.range_scale_mean_m,
        range_scale_sigma=acoustics.range_scale_sigma_m,
        echo_chance=(acoustics.surface_echo_chance, acoustics.bottom_echo_chance),
        common_echoes=acoustics.common_echoes,
        channel=Channel(
            acoustics.loss_chance,
            acoustics.burst_chance,
            acoustics.burst_mean_messages,
            acoustics.burst_loss_chance,
        ),
    )


def own_motion(trajectory: Trajectory, follower: int = 0) -> Floats:
    """What a follower's own sensors see at every instant: speed, heading and depth, shape (n, 3), [m/s], [rad], [m]."""
    v, name = follower + 1, trajectory.names[follower + 1]
    depth = -trajectory.site_path(f"{name}/depth_sensor")[:, 2]
    return np.column_stack([trajectory.forward_speed[:, v], trajectory.heading[:, v], depth])


def start_of(trajectory: Trajectory, follower: int = 0) -> Floats:
    """Initial position of a follower's hydrophone [m], and its velocity through the water [m/s], shape (4,)."""
    v, name = follower + 1, trajectory.names[follower + 1]
    hydrophone = trajectory.site_path(f"{name}/hydrophone")[0]
    return np.concatenate([hydrophone[:2], trajectory.velocity[0, v, :2] - trajectory.water_velocity[0, v, :2]])


def observe(trajectory: Trajectory, hearing: Hearing, follower: int = 0) -> MissionTruth:
    """What the sensors of one follower see of a trajectory, without errors.

    Ranges come from `sim.sensing.acoustics`: with the paper's settings they are distances between the transmitter sites
    and the hydrophone site at the instant of the ping.

    Args:
        trajectory: of a mission from its start, on the control grid.
        hearing: of its scenario.
        follower: its index, 0 for the first.

    Raises:
        ValueError: the trajectory begins later, or is too short for one filter step.
    """
    dt = hearing.filter_step_s
    stride = round(dt / CONTROL_STEP_S)
    n = (trajectory.time.size - 1) // stride
    if n < 1:
        raise ValueError(f"the trajectory ends at {trajectory.time[-1]:g} s, before the first filter step of {dt:g} s")
    if trajectory.time[0] != 0.0:
        raise ValueError(f"the trajectory begins at {trajectory.time[0]:g} s; what is sensed depends on all before")
    steps = np.arange(1, n + 1)
    grid = steps * stride
    name = trajectory.names[follower + 1]
    hydrophone = trajectory.site_path(f"{name}/hydrophone")
    own = own_motion(trajectory, follower)[grid]
    apply_bias_drift(hearing.bias_drift, np.asarray(steps * dt, dtype=np.float64), own)
    sound = propagate(trajectory, hearing, follower)
    sent = sound.emission_step * stride
    limit = hearing.max_range_m or np.inf
    # the follower takes a message up at a filter step, and hears no more of it
    in_time = sound.arrival_time <= (sound.message_step[:, None, None] + 1e-6) * dt
    heard = np.where((sound.length[:, :, [Path.DIRECT]] <= limit) & in_time, sound.range, np.nan)
    attitude = np.full((sent.size, 2), np.nan)
    if hearing.broadcast_attitude:
        attitude = measured_attitude(trajectory, hearing)[sent]
    leader = trajectory.position[:, 0]
    timestamp = np.asarray(sound.emission_step * dt, dtype=np.float64)
    drift_east, drift_north = hearing.leader_drift
    return MissionTruth(
        dt=dt,
        start=start_of(trajectory, follower),
        speed=own[:, 0].copy(),
        heading=own[:, 1].copy(),
        depth=own[:, 2].copy(),
        hydrophone=hydrophone[grid, :2],
        leader_position=leader[grid, :2],
        leader_heading=trajectory.heading[grid, 0],
        message_step=sound.message_step,
        emission_step=sound.emission_step,
        timestamp=timestamp,
        sent_position=np.column_stack(
            [
                leader[sent, 0] + drift_east * timestamp,
                leader[sent, 1] + drift_north * timestamp,
                -leader[sent, 2],
            ]
        ),
        sent_heading=trajectory.heading[sent, 0],
        sent_speed=trajectory.forward_speed[sent, 0],
        sent_attitude=attitude,
        slant_range=heard[:, :, Path.DIRECT].copy(),
        echo_range=np.stack([heard[:, :, path] for path in (Path.SURFACE, Path.BOTTOM)]),
    )
