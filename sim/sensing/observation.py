"""A finished mission: what one follower's sensors see of it without random errors, and what they measure in a run."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Records, own_arrays, records
from laisn.messages import LeaderMessage, Measurements
from laisn.swarm import MESSAGE, READING
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.acoustics import Path, propagate, received_range
from sim.sensing.errors import SensorErrors, errors_of, gauss_markov, is_bad, is_lost, loses, tilt_errors
from sim.sensing.noise import STREAMS, Address, Stream, normals, normals_at, uniforms
from sim.sensing.sensors import (
    FollowerState,
    OwnSensor,
    own_sensors,
    read_message,
    read_own,
    read_ranges,
    true_message,
    true_own,
)
from sim.trajectory import Trajectory

SITES = ("tx_rear", "tx_front", "tx_middle", "depth_sensor", "hydrophone")
"""Sites of leader and follower that sensing needs."""


@dataclass(frozen=True, kw_only=True)
class MissionTruth:
    """What one follower's sensors see of a mission, without errors: n filter steps (k = 1 … n) and m messages."""

    dt: float  # filter step Δt [s]
    start: Floats  # state of the hydrophone at step 0: x, y [m] and velocity through the water [m/s], shape (4,)
    speed: Floats  # speed of the follower through the water, along its hull, shape (n,), [m/s]
    heading: Floats  # heading of the follower, shape (n,), [rad]
    depth: Floats  # depth of the follower's depth sensor, shape (n,), [m]
    hydrophone: Floats  # horizontal position that is estimated, shape (n, 2), [m]
    leader_position: Floats  # horizontal position of the leader's body origin, shape (n, 2), [m]
    leader_heading: Floats  # heading of the leader, shape (n,), [rad]
    message_step: Ints  # step k at which a message is available, shape (m,), increasing
    emission_step: Ints
    """Step at which the leader sent it, shape (m,): address of the leader's noise, which all followers share."""
    sent: Records
    """What the message holds at emission without random errors and constant biases, of `laisn.swarm.MESSAGE`, shape
    (m,); pitch and roll are NaN if they are not broadcast."""
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
    """What the sensors of one follower see of a trajectory of a mission from its start, without errors.

    Ranges come from `sim.sensing.acoustics`: with the paper's settings they are distances between the transmitter sites
    and the hydrophone site at the instant of the ping. ValueError if the trajectory begins later, or is too short for
    one filter step.
    """
    dt, v, name = scenario.timing.filter_step_s, follower + 1, trajectory.names[follower + 1]
    stride = round(dt / CONTROL_STEP_S)
    n = (trajectory.time.size - 1) // stride
    if n < 1:
        raise ValueError(f"the trajectory ends at {trajectory.time[-1]:g} s, before the first filter step of {dt:g} s")
    if trajectory.time[0] != 0.0:
        raise ValueError(f"the trajectory begins at {trajectory.time[0]:g} s; what is sensed depends on all before")
    steps, grid = np.arange(1, n + 1), slice(stride, n * stride + 1, stride)
    errors, sound = errors_of(scenario, follower), propagate(trajectory, scenario, follower)
    own, sent = records(READING, n), records(MESSAGE, sound.emission_step.size)
    depth_sensor = trajectory.site_offset[trajectory.site(f"{name}/depth_sensor")]
    true_own(errors, follower, steps * dt, trajectory.body(v, grid), depth_sensor, own)
    emitted, tilt = sound.emission_step * stride, np.full((2, sound.emission_step.size), np.nan)
    if scenario.leader.broadcast_attitude:
        tilt = tilt_errors(trajectory, scenario.sensors)[emitted].T
    true_message(errors, sound.emission_step * dt, trajectory.body(0, emitted), tilt, sent)
    hydrophone = trajectory.site_path(f"{name}/hydrophone", steps * stride)
    ranges = received_range(sound.arrival, sound.message_step[:, None, None], dt)

    @cache
    def state() -> FollowerState:
        source = np.full((n, 3, 3), np.nan)
        source[sound.message_step - 1] = np.where(np.isnan(ranges[:, :, [Path.DIRECT]]), np.nan, sound.transmitter)
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

    return MissionTruth(
        dt=dt,
        start=start_of(trajectory, follower),
        speed=own.speed,
        heading=own.heading,
        depth=own.depth,
        hydrophone=hydrophone[:, :2],
        leader_position=trajectory.position[grid, 0, :2],
        leader_heading=trajectory.heading[grid, 0],
        message_step=sound.message_step,
        emission_step=sound.emission_step,
        sent=sent,
        slant_range=ranges[:, :, Path.DIRECT],
        echo_range=np.moveaxis(ranges[:, :, Path.SURFACE :], 2, 0),
        own=tuple((sensor, sensor.true(state())) for sensor in own_sensors(scenario)),
    )


def received(seed: int, run: int, follower: int, emission_step: Ints, e: SensorErrors) -> Bools:
    """Whether each message arrives, shape (m,).

    The chain starts in its good state before the first message; all transmitters share a message's fate.
    `emission_step` is that at which each message was sent, shape (m,), increasing, none left out.
    """
    drawn = uniforms(seed, run, Stream.LOSS.number(follower), emission_step)
    arrived, bad = np.empty(len(drawn), dtype=np.bool_), False
    for i, (change, fate) in enumerate(drawn[:, :2].tolist()):
        bad = is_bad(bad, change, e)
        arrived[i] = not is_lost(bad, fate, e)
    return arrived


def measure(
    truth: MissionTruth, errors: SensorErrors, *, seed: int, run: int, follower: int = 0, transmitters: int = 3
) -> Measurements:
    """Everything that one follower measures in a run: exactly the noise of that run in a campaign.

    Followers share the leader's errors and nothing else. `transmitters` is N_T, how many of the leader's it uses, rear
    and front first. LaisnError if seed or run is out of range.
    """
    every = Address(seed, run, follower, np.arange(1, truth.speed.size + 1))
    sent, taken_up = every._replace(step=truth.emission_step), every._replace(step=truth.message_step)
    own, message = records(READING, every.step.size), truth.sent.copy()
    read_own(errors, every, truth, own)
    # step 0, at which nothing is measured, addresses errors that a run keeps
    offset = normals_at(every._replace(step=0), Stream.LEADER_ATTITUDE)
    drawn = normals_at(sent, Stream.LEADER_ATTITUDE).T
    fluctuation = gauss_markov(drawn, truth.emission_step, truth.dt, errors.leader_tilt_time).T
    read_message(errors, sent, truth.sent, offset, fluctuation, message)
    by_echo = np.full((2, *truth.slant_range.shape), np.nan) if truth.echo_range is None else truth.echo_range
    true = np.transpose([truth.slant_range, *by_echo], (2, 0, 1))
    ranges = np.column_stack(read_ranges(errors, transmitters, sent, taken_up, true))
    if loses(errors):
        ranges[~received(seed, run, follower, truth.emission_step, errors)] = np.nan
    lost = truth.message_step[np.isnan(ranges).all(axis=1)] - 1
    extra = {}
    for sensor, values in truth.own:
        found = sensor.read(values, normals(seed, run, STREAMS * follower + sensor.stream, every.step))
        if sensor.acoustic:
            found[lost] = np.nan
        extra[sensor.name] = found
    return Measurements(
        dt=truth.dt,
        speed=own.speed,
        heading=own.heading,
        depth=own.depth,
        message_step=truth.message_step,
        message=np.asarray(message).view((np.float64, len(LeaderMessage._fields))),
        ranges=ranges,
        own=extra,
    )
