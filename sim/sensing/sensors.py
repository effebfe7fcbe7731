"""What sensors and ranges add to the truth (paper, Eqs. 26–28): one formula and one entry of a list for each sensor.

`measure` makes the measurements of a finished mission. Compiled code calls the same formulas, at one instant
(`sim.sensing.instant`) or for runs side by side (`experiments.campaign.lane_sensors`).
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import formula
from laisn.messages import LeaderMessage, Measurements
from sim.scenario.settings import Scenario
from sim.sensing.ahrs import random_error
from sim.sensing.channel import Channel, locked_path, loses, received
from sim.sensing.drift import gauss_markov
from sim.sensing.noise import STREAMS, Stream, normals, uniforms
from sim.sensing.observation import MissionTruth


class SensorErrors(NamedTuple):
    """True errors of all sensors, with the paper's values as defaults. No navigator has access to them."""

    speed_bias: float = 0.2
    """μV of the follower's speed log [m/s]."""
    speed_sigma: float = 0.2
    """σV [m/s]."""
    heading_bias: float = float(np.deg2rad(5.0))
    """μθ of the follower's compass [rad]."""
    heading_sigma: float = float(np.deg2rad(2.0))
    """σθ [rad]."""
    depth_sigma: float = 0.0
    """Standard deviation of the follower's pressure sensor [m]."""
    gyro_sigma: float = float(np.deg2rad(0.1))
    """Standard deviation of its rates of turn [rad/s]."""
    tilt_sigma: float = float(np.deg2rad(0.5))
    """Standard deviation of its inclinometer [rad]."""
    leader_speed_bias: float = 0.0
    """Bias of the speed that the leader broadcasts [m/s]."""
    leader_speed_sigma: float = 0.0
    leader_heading_bias: float = 0.0
    """μθ of the heading that the leader broadcasts (0, 2.5° or 5° in the paper) [rad]."""
    leader_heading_sigma: float = 0.0
    leader_depth_sigma: float = 0.0
    """Standard deviation of the depth that the leader broadcasts [m]."""
    leader_pitch_sigma: float = 0.0
    """Standard deviation of the pitch that the leader broadcasts [rad]."""
    leader_roll_sigma: float = 0.0
    leader_attitude_time: float = 0.0
    """Correlation time of the errors of broadcast pitch and roll [s]; 0: each message has its own."""
    leader_attitude_offset_sigma: float = 0.0
    """Standard deviation of errors of broadcast pitch and roll that stay the same throughout a run [rad]."""
    range_tau: tuple[float, float, float] = (0.01, 0.01, 0.01)
    """τ: width of the uniform error of the range to the rear, front and middle transmitter [m]."""
    range_centre: float = 0.0
    """What is subtracted from the uniform draw, which lies between 0 and 1: 0 in the paper, ½ for a mean of zero."""
    range_scale_mean: float = 0.1
    """μD of ψ, the error that the transmitters share in proportion to their ranges [m]."""
    range_scale_sigma: float = 0.05
    """σD of ψ [m]."""
    echo_chance: tuple[float, float] = (0.0, 0.0)
    """Chances that a ping's surface echo and its bottom echo is taken for the ping."""
    common_echoes: bool = False
    """All pings of a message take the same path."""
    channel: Channel = Channel()
    """How messages are lost: none of their pings is received."""


def errors_of(scenario: Scenario, follower: int = 0) -> SensorErrors:
    """The true errors of a follower's and the leader's sensors in SI units."""
    own, sensors, acoustics = scenario.sensors_of(follower), scenario.sensors, scenario.acoustics
    attitude = random_error(sensors)
    return SensorErrors(
        speed_bias=own.speed_bias_m_s,
        speed_sigma=own.speed_sigma_m_s,
        heading_bias=float(np.deg2rad(own.heading_bias_deg)),
        heading_sigma=float(np.deg2rad(own.heading_sigma_deg)),
        depth_sigma=own.depth_sigma_m,
        gyro_sigma=float(np.deg2rad(own.gyro_sigma_deg_s)),
        tilt_sigma=float(np.deg2rad(own.tilt_sigma_deg)),
        leader_speed_bias=sensors.leader_speed_bias_m_s,
        leader_heading_bias=float(np.deg2rad(sensors.leader_heading_bias_deg)),
        leader_heading_sigma=float(np.deg2rad(sensors.leader_heading_sigma_deg)),
        leader_depth_sigma=sensors.leader_depth_sigma_m,
        leader_pitch_sigma=attitude.sigma,
        leader_roll_sigma=attitude.sigma,
        leader_attitude_time=attitude.time,
        leader_attitude_offset_sigma=float(np.deg2rad(sensors.leader_attitude_offset_sigma_deg)),
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


@formula
def speed_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Speed log, never negative (paper, Eq. 26)."""
    return np.maximum(true + bias + sigma * normal, 0.0)


@formula
def heading_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Compass: the random part adds to the bias, whatever its sign (paper, Eq. 27)."""
    return true + bias + sigma * np.abs(normal)


@formula
def plain_reading(true: Any, sigma: float, normal: Any) -> Any:
    """Unbiased normal error: pressure sensor, inclinometer, gyro."""
    return true + sigma * normal


@formula
def _range_reading(true: Any, longest: Any, tau: float, uniform: Any, psi: Any) -> Any:
    return true + tau * uniform + psi * (true / (longest + (longest == 0.0)))


@formula
def range_readings(e: SensorErrors, transmitters: int, true: Any, uniform: Any, normal: Any) -> Any:
    """Ranges of a message to the rear, front and middle transmitter (paper, Eq. 28); NaN where none is received.

    N_T, the number of transmitters in use, is 2 with LAISN-2 and 3 with LAISN-3 (Sections 2.2 and 2.3). ψ counts in
    proportion to the longest range to them. The middle one, which LAISN-2 has no use for, is scaled by the longest of
    all.
    """
    psi = plain_reading(e.range_scale_mean, e.range_scale_sigma, normal)
    of_two = np.fmax(np.fmax(true[0], true[1]), 0.0)
    of_all = np.fmax(of_two, true[2])
    longest = of_all if transmitters > 2 else of_two
    return (
        _range_reading(true[0], longest, e.range_tau[0], uniform[0] - e.range_centre, psi),
        _range_reading(true[1], longest, e.range_tau[1], uniform[1] - e.range_centre, psi),
        _range_reading(true[2], of_all, e.range_tau[2], uniform[2] - e.range_centre, psi),
    )


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
    Sensor("pitch", Stream.TILT, 0, ("tilt_sigma",), plain_reading),
    Sensor("turning", Stream.GYRO, 0, ("gyro_sigma",), plain_reading),
    Sensor("pitching", Stream.GYRO, 1, ("gyro_sigma",), plain_reading),
)
"""A follower's own sensors, in the order of its readings; a mission's measurements hold the first three."""
LEADER = (
    Sensor("speed", Stream.LEADER_MOTION, 0, ("leader_speed_bias", "leader_speed_sigma"), speed_reading),
    Sensor("heading", Stream.LEADER_MOTION, 1, ("leader_heading_bias", "leader_heading_sigma"), heading_reading),
    Sensor("depth", Stream.LEADER_DEPTH, 0, ("leader_depth_sigma",), plain_reading),
    Sensor("pitch", Stream.LEADER_ATTITUDE, 0, ("leader_pitch_sigma",), plain_reading),
    Sensor("roll", Stream.LEADER_ATTITUDE, 1, ("leader_roll_sigma",), plain_reading),
)
"""The leader's; normals of its attitude are those of a Gauss–Markov process."""


def measure(
    truth: MissionTruth, errors: SensorErrors, *, seed: int, run: int, follower: int = 0, transmitters: int = 3
) -> Measurements:
    """Everything that one follower measures in a run: exactly the noise of that run in a campaign.

    Args:
        truth: of the mission.
        errors: of the sensors.
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
            return gauss_markov(found, sent, truth.dt, errors.leader_attitude_time)
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
    if sum(e.echo_chance) > 0.0:
        echoes = np.full((2, *true.shape), np.nan) if truth.echo_range is None else truth.echo_range
        path = locked_path(*address, truth.emission_step, e.echo_chance, e.common_echoes)
        true = np.choose(path, [true, *echoes])
    drawn = uniforms(*at(Stream.RANGE_UNIFORM)).T, normals(*at(Stream.RANGE_SCALE))[:, 0]
    read = np.column_stack(range_readings(e, transmitters, true.T, *drawn))
    if loses(e.channel):
        read[~received(*address, truth.emission_step, e.channel)] = np.nan
    return read
