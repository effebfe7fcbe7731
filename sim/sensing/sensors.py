"""Everything that one follower measures on a finished mission: one entry of a list for each sensor."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.messages import LeaderMessage, Measurements
from sim.sensing.drift import gauss_markov
from sim.sensing.errors import (
    SensorErrors,
    heading_reading,
    is_bad,
    is_lost,
    loses,
    path_taken,
    plain_reading,
    range_readings,
    speed_reading,
)
from sim.sensing.noise import STREAMS, Stream, normals, uniforms
from sim.sensing.observation import MissionTruth


class Sensor(NamedTuple):
    """A sensor that reads one number at a time."""

    name: str
    """Of its readings."""
    stream: Stream
    """Of its noise."""
    column: int
    """Which of the two normals of a step is its own."""
    parameters: tuple[str, ...]
    """Fields of `SensorErrors`."""
    read: Callable[..., Any]
    """Reading from the true value, the parameters and the normal; numbers or arrays."""


OWN = (
    Sensor("speed", Stream.OWN_MOTION, 0, ("speed_bias", "speed_sigma"), speed_reading),
    Sensor("heading", Stream.OWN_MOTION, 1, ("heading_bias", "heading_sigma"), heading_reading),
    Sensor("depth", Stream.DEPTH, 0, ("depth_sigma",), plain_reading),
)
"""A follower's own sensors; those that only steer it are read in `sim.sensing.instant`."""
LEADER = (
    Sensor("speed", Stream.LEADER_MOTION, 0, ("leader_speed_bias",), lambda true, bias, _: np.maximum(true + bias, 0)),
    Sensor("heading", Stream.LEADER_MOTION, 1, ("leader_heading_bias", "leader_heading_sigma"), heading_reading),
    Sensor("depth", Stream.LEADER_DEPTH, 0, ("leader_depth_sigma",), plain_reading),
    Sensor("pitch", Stream.LEADER_ATTITUDE, 0, ("leader_tilt_sigma",), plain_reading),
    Sensor("roll", Stream.LEADER_ATTITUDE, 1, ("leader_tilt_sigma",), plain_reading),
)
"""The leader's; normals of its attitude are those of a Gauss–Markov process."""


def received(seed: int, run: int, follower: int, emission_step: Ints, e: SensorErrors) -> Bools:
    """Whether each message arrives, shape (m,).

    The chain starts in its good state before the first message; all transmitters share a message's fate.

    Args:
        seed: of the study.
        run: of the campaign.
        follower: 0, 1, …
        emission_step: filter step at which each message was sent, shape (m,), increasing, none left out.
        e: the chances of loss.
    """
    drawn = uniforms(seed, run, Stream.LOSS.number(follower), emission_step)
    arrived, bad = np.empty(len(drawn), dtype=np.bool_), False
    for i, (change, fate) in enumerate(drawn[:, :2].tolist()):
        bad = is_bad(bad, change, e)
        arrived[i] = not is_lost(bad, fate, e)
    return arrived


def locked_path(seed: int, run: int, follower: int, emission_step: Ints, e: SensorErrors) -> Ints:
    """`Path` that the receiver takes, for each message and transmitter, shape (m, 3); arguments as of `received`."""
    drawn = uniforms(seed, run, Stream.ECHO.number(follower), emission_step)
    return np.asarray(path_taken(drawn[:, [0, 0, 0] if e.common_echoes else [0, 1, 2]], e))


def measure(
    truth: MissionTruth, errors: SensorErrors, *, seed: int, run: int, follower: int = 0, transmitters: int = 3
) -> Measurements:
    """Everything that one follower measures in a run: exactly the noise of that run in a campaign.

    Args:
        seed: key of all random numbers.
        run: of the campaign, 0, 1, …
        follower: index of the follower; followers share the leader's errors and nothing else.
        transmitters: N_T, how many of the leader's the follower uses, rear and front first.

    Returns:
        The measurements, without the leader's statement about its heading.

    Raises:
        LaisnError: seed or run is out of range.
    """
    sent, steps = truth.emission_step, np.arange(1, truth.speed.size + 1)

    @cache
    def drawn(stream: Stream) -> Floats:
        leaders = stream in {sensor.stream for sensor in LEADER}
        found = normals(seed, run, stream.number(follower), sent if leaders else steps)
        if stream == Stream.LEADER_ATTITUDE:
            return gauss_markov(found, sent, truth.dt, errors.leader_tilt_time)
        return found

    def readings(sensors: tuple[Sensor, ...], true: Mapping[str, Floats]) -> dict[str, Floats]:
        return {
            s.name: s.read(
                true[s.name], *(getattr(errors, name) for name in s.parameters), drawn(s.stream)[:, s.column]
            )
            for s in sensors
            if s.name in true
        }

    own = readings(OWN, {"speed": truth.speed, "heading": truth.heading, "depth": truth.depth})
    # step 0, at which nothing is measured, addresses errors that a run keeps
    offset = normals(seed, run, Stream.LEADER_ATTITUDE.number(), 0)
    pitch, roll = plain_reading(truth.sent_attitude, errors.leader_attitude_offset_sigma, offset).T
    east, north, depth = truth.sent_position.T
    leader = readings(
        LEADER,
        {"speed": truth.sent_speed, "heading": truth.sent_heading, "depth": depth, "pitch": pitch, "roll": roll},
    )
    ranges = _ranges(truth, errors, (seed, run, follower), transmitters)
    lost = truth.message_step[np.isnan(ranges).all(axis=1)] - 1
    extra = {}
    for sensor, true in truth.own:
        found = sensor.read(true, normals(seed, run, STREAMS * follower + sensor.stream, steps))
        if sensor.acoustic:
            found[lost] = np.nan
        extra[sensor.name] = found
    columns = {"timestamp": truth.timestamp, "east": east, "north": north, **leader}
    unknown = np.full(sent.size, np.nan)
    return Measurements(
        dt=truth.dt,
        **own,
        message_step=truth.message_step,
        message=np.column_stack([columns.get(name, unknown) for name in LeaderMessage._fields]),
        ranges=ranges,
        own=extra,
    )


def _ranges(truth: MissionTruth, e: SensorErrors, address: tuple[int, int, int], transmitters: int) -> Floats:
    """Ranges that are measured, shape (m, 3); `address` is seed, run and follower."""
    seed, run, follower = address

    def at(stream: Stream) -> tuple[int, int, int, Ints]:
        return seed, run, stream.number(follower), truth.message_step

    true = truth.slant_range
    if e.surface_echo_probability + e.bottom_echo_probability > 0.0:
        echoes = np.full((2, *true.shape), np.nan) if truth.echo_range is None else truth.echo_range
        path = locked_path(*address, truth.emission_step, e)
        true = np.choose(path, [true, *echoes])
    drawn = uniforms(*at(Stream.RANGE_UNIFORM)).T, normals(*at(Stream.RANGE_SCALE))[:, 0]
    read = np.column_stack(range_readings(e, transmitters, true.T, *drawn))
    if loses(e):
        read[~received(*address, truth.emission_step, e)] = np.nan
    return read
