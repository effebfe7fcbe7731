"""What one follower's sensors see of a mission, before errors: the seam between motion and measurement."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from laisn.arrays import Floats, Ints, own_arrays
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import Path, is_in_time, propagate, range_of, sound_of
from sim.sensing.ahrs import measured_attitude
from sim.sensing.drift import biased
from sim.sensing.errors import errors_of
from sim.sensing.own_sensors import FollowerState, OwnSensor, own_sensors
from sim.trajectory import Trajectory

SITES = ("tx_rear", "tx_front", "tx_middle", "depth_sensor", "hydrophone")
"""Sites of leader and follower that sensing needs."""


@dataclass(frozen=True, kw_only=True)
class MissionTruth:
    """What one follower's sensors see of a mission, without errors: n filter steps (k = 1 … n) and m messages."""

    dt: float
    """Filter step Δt [s]."""
    start: Floats
    """State of the hydrophone at step 0: x, y [m] and velocity through the water [m/s], shape (4,)."""
    speed: Floats
    """Speed of the follower through the water, along its hull, shape (n,), [m/s]."""
    heading: Floats
    """Heading of the follower, shape (n,), [rad]."""
    depth: Floats
    """Depth of the follower's depth sensor, shape (n,), [m]."""
    hydrophone: Floats
    """Horizontal position that is estimated, shape (n, 2), [m]."""
    leader_position: Floats
    """Horizontal position of the leader's body origin, shape (n, 2), [m]."""
    leader_heading: Floats
    """Heading of the leader, shape (n,), [rad]."""
    message_step: Ints
    """Step k at which a message is available, shape (m,), increasing."""
    emission_step: Ints
    """Step at which the leader sent it, shape (m,): address of the leader's noise, which all followers share."""
    timestamp: Floats
    """Emission on the leader's clock, shape (m,), [s]."""
    sent_position: Floats
    """Leader's body origin at emission: east, north and depth, shape (m, 3), [m]."""
    sent_heading: Floats
    """Leader's heading at emission, shape (m,), [rad]."""
    sent_speed: Floats
    """Leader's speed at emission, shape (m,), [m/s]."""
    sent_attitude: Floats
    """Leader's pitch and roll at emission as measured, but for random errors, shape (m, 2), [rad]; NaN if they are not
    broadcast."""
    slant_range: Floats
    """Slant range to the rear, front and middle transmitter, shape (m, 3), [m]; NaN where nothing is received."""
    echo_range: Floats | None = None
    """Slant range by way of the surface and of the bottom, shape (2, m, 3), [m]; None if echoes are not modelled."""
    own: tuple[tuple[OwnSensor, Floats], ...] = ()
    """Sensors of the user's own and what they would read without errors, shape (n, …)."""

    def __post_init__(self) -> None:
        own_arrays(self)


def start_of(trajectory: Trajectory, follower: int = 0) -> Floats:
    """Initial position of a follower's hydrophone [m], and its velocity through the water [m/s], shape (4,)."""
    v, name = follower + 1, trajectory.names[follower + 1]
    hydrophone = trajectory.site_path(f"{name}/hydrophone", np.zeros(1, dtype=np.int64))[0]
    return np.concatenate([hydrophone[:2], trajectory.velocity[0, v, :2] - trajectory.water_velocity[0, v, :2]])


def observe(trajectory: Trajectory, scenario: Scenario, follower: int = 0) -> MissionTruth:
    """What the sensors of one follower see of a trajectory, without errors.

    Ranges come from `sim.sensing.acoustics`: with the paper's settings they are distances between the transmitter sites
    and the hydrophone site at the instant of the ping.

    Args:
        trajectory: of a mission from its start, on the control grid.

    Raises:
        ValueError: the trajectory begins later, or is too short for one filter step.
    """
    dt, v, name = scenario.timing.filter_step_s, follower + 1, trajectory.names[follower + 1]
    stride = round(dt / CONTROL_STEP_S)
    n = (trajectory.time.size - 1) // stride
    if n < 1:
        raise ValueError(f"the trajectory ends at {trajectory.time[-1]:g} s, before the first filter step of {dt:g} s")
    if trajectory.time[0] != 0.0:
        raise ValueError(f"the trajectory begins at {trajectory.time[0]:g} s; what is sensed depends on all before")
    steps = np.arange(1, n + 1)
    grid = steps * stride
    errors = errors_of(scenario, follower)
    speed, heading = biased(
        errors, follower, steps * dt, trajectory.forward_speed[grid, v], trajectory.heading[grid, v]
    )
    sound = propagate(trajectory, scenario, follower)
    sent = sound.emission_step * stride
    direct, step = sound.arrival.length[:, :, :1], sound.message_step[:, None, None]
    received = range_of(sound_of(scenario), direct, sound.arrival)
    received[~is_in_time(sound.arrival.time, step, dt)] = np.nan
    attitude = np.full((sent.size, 2), np.nan)
    if scenario.leader.broadcast_attitude:
        attitude = measured_attitude(trajectory, scenario.sensors)[sent]
    leader = trajectory.position[:, 0]
    hydrophone = trajectory.site_path(f"{name}/hydrophone", grid)

    @cache
    def state() -> FollowerState:
        source = np.full((n, 3, 3), np.nan)
        source[sound.message_step - 1] = np.where(np.isnan(received[:, :, [Path.DIRECT]]), np.nan, sound.transmitter)
        return FollowerState(
            time=trajectory.time[grid],
            position=trajectory.position[grid, v],
            quaternion=trajectory.quaternion[grid, v],
            velocity=trajectory.velocity[grid, v],
            angular_velocity=trajectory.angular_velocity[grid, v],
            water_velocity=trajectory.water_velocity[grid, v],
            hydrophone=hydrophone,
            source=source,
        )

    timestamp = np.asarray(sound.emission_step * dt, dtype=np.float64)
    return MissionTruth(
        dt=dt,
        start=start_of(trajectory, follower),
        speed=speed,
        heading=heading,
        depth=-trajectory.site_path(f"{name}/depth_sensor", grid)[:, 2],
        hydrophone=hydrophone[:, :2],
        leader_position=leader[grid, :2],
        leader_heading=trajectory.heading[grid, 0],
        message_step=sound.message_step,
        emission_step=sound.emission_step,
        timestamp=timestamp,
        sent_position=np.column_stack(
            [
                leader[sent, 0] + errors.leader_drift_east * timestamp,
                leader[sent, 1] + errors.leader_drift_north * timestamp,
                -leader[sent, 2],
            ]
        ),
        sent_heading=trajectory.heading[sent, 0],
        sent_speed=trajectory.forward_speed[sent, 0],
        sent_attitude=attitude,
        slant_range=received[:, :, Path.DIRECT],
        echo_range=np.stack([received[:, :, path] for path in (Path.SURFACE, Path.BOTTOM)]),
        own=tuple((sensor, sensor.true(state())) for sensor in own_sensors(scenario)),
    )
