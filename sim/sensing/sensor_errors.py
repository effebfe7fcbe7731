"""What sensors and ranges add to the truth (paper, Eqs. 26–28): one formula each, for flights and campaigns alike."""

from dataclasses import dataclass, fields

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, inlined
from laisn.elementary import fma
from laisn.messages import LeaderMessage, Measurements
from sim.sensing import gauss_markov
from sim.sensing.echo import locked_path
from sim.sensing.loss import NO_LOSS, Channel
from sim.sensing.loss import received as received_messages
from sim.sensing.noise import Stream, normals, uniforms
from sim.sensing.truth import MissionTruth

RUN_LONG: Ints = np.zeros(1, dtype=np.int64)
"""Address of errors that a run keeps: step 0, at which nothing is measured."""


@dataclass(frozen=True, kw_only=True)
class SensorErrors:
    """True errors of all sensors, with the paper's values as defaults. No navigator sees them.

    Raises ValueError naming the field if a value is not finite, or a standard deviation or time negative.
    """

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
    channel: Channel = NO_LOSS
    """How messages are lost: none of their pings is heard."""

    def __post_init__(self) -> None:
        for field in fields(self):
            values = np.atleast_1d(np.asarray(getattr(self, field.name), dtype=np.float64))
            spread = field.name.endswith(("sigma", "_time")) or field.name == "range_tau"
            if not np.all(np.isfinite(values)) or (spread and values.min() < 0):
                bound = "finite numbers, zero or more" if spread else "a finite number"
                raise ValueError(f"{field.name} is {getattr(self, field.name)}, expected {bound}")
        chances = (*self.echo_chance, sum(self.echo_chance), *self.channel.chances)
        if min(chances) < 0.0 or max(chances) > 1.0 or self.channel.burst_mean_messages < 1.0:
            raise ValueError(f"echo_chance {self.echo_chance} or {self.channel}: a chance is 0 … 1, a burst 1 or more")

    @property
    def echoes(self) -> bool:
        """Whether echoes are ever taken for pings."""
        return sum(self.echo_chance) > 0.0


@inlined
def speed_reading(true: float, bias: float, sigma: float, normal: float) -> float:
    """Speed log, never negative (paper, Eq. 26). Compiled code only."""
    reading = fma(sigma, normal, true + bias)
    return reading if reading > 0.0 else 0.0


@inlined
def heading_reading(true: float, bias: float, sigma: float, normal: float) -> float:
    """Compass: the random part adds to the bias, whatever its sign (paper, Eq. 27). Compiled code only."""
    return fma(sigma, abs(normal), true + bias)


@inlined
def plain_reading(true: float, sigma: float, normal: float) -> float:
    """Unbiased normal error: pressure sensor. Compiled code only."""
    return fma(sigma, normal, true)


@inlined
def longest(rear: float, front: float, middle: float) -> float:
    """Longest range that is received; NaN counts as none. Compiled code only."""
    far = rear if rear > 0.0 else 0.0
    far = front if front > far else far
    return middle if middle > far else far


@inlined
def longest_used(rear: float, front: float, middle: float, transmitters: int) -> float:
    """The range that those to the rear and front transmitter are scaled by (paper, Eq. 28). Compiled code only.

    N_T is 2 with LAISN-2 and 3 with LAISN-3 (Sections 2.2 and 2.3). The middle one, which LAISN-2 has no use for, is
    scaled by the longest of all.
    """
    return longest(rear, front, middle if transmitters > 2 else 0.0)


@inlined
def range_reading(true: float, far: float, tau: float, uniform: float, psi: float) -> float:
    """Range of a message, `far` being the longest one (paper, Eq. 28). Compiled code only.

    The uniform draw is less `SensorErrors.range_centre`.
    """
    return fma(psi, true / (far if far > 0.0 else 1.0), fma(tau, uniform, true))


@compiled
def _own(truth: Floats, normals: Floats, biases: Floats, sigmas: Floats) -> Floats:
    """Columns speed, heading and depth read from columns of truth and of normals."""
    read = np.empty_like(truth)
    for k in range(truth.shape[0]):
        read[k, 0] = speed_reading(truth[k, 0], biases[0], sigmas[0], normals[k, 0])
        read[k, 1] = heading_reading(truth[k, 1], biases[1], sigmas[1], normals[k, 1])
        read[k, 2] = plain_reading(truth[k, 2], sigmas[2], normals[k, 2])
    return read


@compiled
def _ranges(truth: Floats, uniforms: Floats, normal: Floats, tau: Floats, scale: Floats, transmitters: int) -> Floats:
    """Ranges read from true ones, shape (m, 3); `scale` is (μD, σD)."""
    read = np.empty_like(truth)
    for i in range(truth.shape[0]):
        rear, front, middle = truth[i, 0], truth[i, 1], truth[i, 2]
        far, farthest = longest_used(rear, front, middle, transmitters), longest(rear, front, middle)
        psi = plain_reading(scale[0], scale[1], normal[i])
        read[i, 0] = range_reading(rear, far, tau[0], uniforms[i, 0], psi)
        read[i, 1] = range_reading(front, far, tau[1], uniforms[i, 1], psi)
        read[i, 2] = range_reading(middle, farthest, tau[2], uniforms[i, 2], psi)
    return read


@inlined
def attitude_reading(true: float, offset_sigma: float, offset: float, sigma: float, wandering: float) -> float:
    """Pitch or roll with a constant and a wandering error, both of unit variance. Compiled code only."""
    return fma(sigma, wandering, fma(offset_sigma, offset, true))


@compiled
def _attitude(truth: Floats, normals: Floats, weights: Floats, offset: Floats, sigmas: Floats) -> Floats:
    """Pitch and roll read from true ones, shape (m, 2); sigmas are the offset's, pitch's and roll's."""
    read = np.empty_like(truth)
    for j in range(2):
        wandering = 0.0
        for i in range(truth.shape[0]):
            wandering = gauss_markov.advanced(wandering, weights[i, 0], weights[i, 1], normals[i, j])
            read[i, j] = attitude_reading(truth[i, j], sigmas[0], offset[j], sigmas[1 + j], wandering)
    return read


def _heard_ranges(truth: MissionTruth, errors: SensorErrors, address: tuple[int, int, int]) -> Floats:
    """True range of the path that each ping is heard on, shape (m, 3); `address` is seed, run and follower."""
    if not errors.echoes:
        return truth.slant_range
    echoes = truth.echo_range
    surface, bottom = (np.full_like(truth.slant_range, np.nan),) * 2 if echoes is None else echoes
    path = locked_path(*address, truth.emission_step, errors.echo_chance, errors.common_echoes)
    return np.choose(path, [truth.slant_range, surface, bottom])


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
        ValueError: seed or run is out of range.
    """

    def drawn(stream: Stream, steps: Ints) -> Floats:
        return normals(seed, run, stream.number(follower), steps)

    k = np.arange(1, truth.speed.size + 1)
    received, sent = truth.message_step, truth.emission_step
    own = _own(
        np.column_stack([truth.speed, truth.heading, truth.depth]),
        np.column_stack([drawn(Stream.OWN_MOTION, k), drawn(Stream.DEPTH, k)[:, 0]]),
        np.array([errors.speed_bias, errors.heading_bias]),
        np.array([errors.speed_sigma, errors.heading_sigma, errors.depth_sigma]),
    )
    leader = _own(
        np.column_stack([truth.sent_speed, truth.sent_heading, truth.sent_position[:, 2]]),
        np.column_stack([drawn(Stream.LEADER_MOTION, sent), drawn(Stream.LEADER_DEPTH, sent)[:, 0]]),
        np.array([errors.leader_speed_bias, errors.leader_heading_bias]),
        np.array([errors.leader_speed_sigma, errors.leader_heading_sigma, errors.leader_depth_sigma]),
    )
    columns = {
        "timestamp": truth.timestamp,
        "east": truth.sent_position[:, 0],
        "north": truth.sent_position[:, 1],
        "speed": leader[:, 0],
        "heading": leader[:, 1],
        "depth": leader[:, 2],
    }
    attitude = _attitude(
        truth.sent_attitude,
        drawn(Stream.LEADER_ATTITUDE, sent),
        gauss_markov.weights(sent, truth.dt, errors.leader_attitude_time),
        drawn(Stream.LEADER_ATTITUDE, RUN_LONG)[0],
        np.array([errors.leader_attitude_offset_sigma, errors.leader_pitch_sigma, errors.leader_roll_sigma]),
    )
    columns |= {"pitch": attitude[:, 0], "roll": attitude[:, 1]}
    unknown = np.full(received.size, np.nan)
    ranges = _ranges(
        _heard_ranges(truth, errors, (seed, run, follower)),
        uniforms(seed, run, Stream.RANGE_UNIFORM.number(follower), received) - errors.range_centre,
        drawn(Stream.RANGE_SCALE, received)[:, 0],
        np.array(errors.range_tau),
        np.array([errors.range_scale_mean, errors.range_scale_sigma]),
        transmitters,
    )
    if errors.channel.loses:
        ranges[~received_messages(seed, run, follower, sent, errors.channel)] = np.nan
    return Measurements(
        dt=truth.dt,
        speed=own[:, 0].copy(),
        heading=own[:, 1].copy(),
        depth=own[:, 2].copy(),
        message_step=received,
        message=np.column_stack([columns.get(name, unknown) for name in LeaderMessage._fields]),
        ranges=ranges,
    )
