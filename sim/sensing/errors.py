"""Errors of sensors and ranges in SI units, and the formulas by which they add to the truth (paper, Eqs. 26–28).

Numbers and arrays go through the same formulas: those of one instant, those of a finished mission (both by
`sim.sensing.sensors`), and those of runs side by side (`experiments.campaign.lane_flight`).

The biases of log and compass may drift as sines about their means, those of each follower at another phase.

Messages are lost one by one, or in bursts. Bursts follow the two-state chain of Gilbert (Bell System Technical Journal
39, 1960) and Elliott (ibid. 42, 1963): in its good state a channel loses few messages, in its bad state most of them.

The leader measures pitch and roll by an inclinometer, alone or steadied by gyros (AHRS). An inclinometer takes the
specific force a − g for the vertical, so that a hull that accelerates, as in waves, reads
wrong by up to a / g. A complementary filter follows the gyros at once and the inclinometer slowly (Mahony, Hamel &
Pflimlin, IEEE Transactions on Automatic Control 53, 2008). Its error e is linear in the inclinometer's error i and in
the angle w by which the gyros walk off in a step:

    e_k = (1 − γ)(e_{k−1} + w_k) + γ i_k,    γ = 1 − exp(−Δt / τ).

Accelerations are the same in every run, and go through the filter here. The random part is a first-order Gauss–Markov
process of correlation time τ, exact at whatever instants it is read (Gelb, Applied Optimal Estimation, 1974):

    x(t_i) = a_i x(t_{i−1}) + √(1 − a_i²) n_i,    a_i = exp(−(t_i − t_{i−1}) / τ).
"""

import math
from collections import namedtuple
from functools import partial
from itertools import accumulate
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, elementwise, formula, select
from laisn.geometry import signed_angle
from laisn.navigators import FARTHEST, FASTEST
from sim.attitude import pitch_of, roll_of, rotated
from sim.scenario.section import in_si
from sim.scenario.sensors import Acoustics, Sensors
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.trajectory import Trajectory
from sim.water import GRAVITY

_SECONDS_AN_HOUR = 3600.0


class RandomError(NamedTuple):
    """Random error of a measured angle, after the filter has run for long."""

    sigma: float  # standard deviation [rad]
    time: float  # correlation time; 0: each reading has its own [s]


def gain(sensors: Sensors) -> float:
    """γ: share of the inclinometer in each step of the filter; 1 without gyros."""
    if sensors.leader_gyro_time_constant_s == 0.0:
        return 1.0
    return float(-np.expm1(-CONTROL_STEP_S / sensors.leader_gyro_time_constant_s))


def random_error(sensors: Sensors) -> RandomError:
    """Random error of the leader's pitch and roll."""
    reading = float(np.deg2rad(sensors.leader_attitude_sigma_deg))
    if sensors.leader_gyro_time_constant_s == 0.0:
        return RandomError(reading, 0.0)
    share = gain(sensors)
    walk = np.deg2rad(sensors.leader_gyro_random_walk_deg_sqrt_h) * np.sqrt(CONTROL_STEP_S / _SECONDS_AN_HOUR)
    kept = 1.0 - share
    variance = (share**2 * reading**2 + kept**2 * walk**2) / (1.0 - kept**2)
    return RandomError(float(np.sqrt(variance)), sensors.leader_gyro_time_constant_s)


@elementwise
def _shown(quaternion: Any, change: Any) -> Any:
    """Pitch and roll that specific force seems to show, from attitude and change of velocity in a control step."""
    force = change[0] / CONTROL_STEP_S, change[1] / CONTROL_STEP_S, change[2] / CONTROL_STEP_S + GRAVITY
    to_body = quaternion[0], -quaternion[1], -quaternion[2], -quaternion[3]
    forward, port, up = rotated(to_body, force)
    return np.arctan2(forward, np.hypot(port, up)), np.arctan2(port, up)


@formula
def _filtered(last: float, error: float, share: float) -> float:
    """e_k = (1 − γ) e_{k−1} + γ i_k."""
    return last + share * (error - last)


def apparent_tilt(trajectory: Trajectory) -> Floats:
    """Pitch and roll that specific force seems to show at the leader's origin, shape (n, 2), [rad].

    Accelerations are means over the interval that ends at an instant; the first instant has those of the second.
    """
    change = np.diff(trajectory.velocity[:, 0], axis=0)
    change = np.concatenate([change[:1], change])
    return np.column_stack(_shown(trajectory.quaternion[:, 0].T, change.T))


def tilt_errors(trajectory: Trajectory, sensors: Sensors) -> Floats:
    """What accelerations add to the leader's measured pitch and roll, from none at the start, shape (n, 2), [rad]."""
    true = np.column_stack([trajectory.pitch[:, 0], trajectory.roll[:, 0]])
    if not sensors.leader_attitude_senses_acceleration:
        return np.zeros_like(true)
    step = partial(_filtered, share=gain(sensors))
    errors = signed_angle(apparent_tilt(trajectory) - true).T
    return np.array([list(accumulate([0.0, *column], step))[1:] for column in errors.tolist()]).T


@compiled
def follow_tilt(share: float, quaternion: Floats, change: Floats, last: Floats, error: Floats) -> None:
    """One step of `tilt_errors` in compiled code: from the errors at the instant before, shape (2,), to those at this.

    `share` is the `gain` of the filter, `change` that of the velocity since then, shape (3,), [m/s].
    """
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    pitch, roll = _shown((w, x, y, z), (change[0], change[1], change[2]))
    error[0] = _filtered(last[0], signed_angle(pitch - pitch_of(w, x, y, z)), share)
    error[1] = _filtered(last[1], signed_angle(roll - roll_of(w, x, y, z)), share)


def weights(step: Ints, dt: float, time: float) -> Floats:
    """Weights of the last value of a Gauss–Markov process and of the fresh normal, a_i and √(1 − a_i²), shape (m, 2).

    The first value is all fresh. `step` at which the process is read has shape (m,), `dt` is its length [s], and `time`
    the correlation time τ [s]; 0 for independent values.
    """
    kept = np.zeros(step.size)
    if time > 0.0:
        # not `np.exp`, which rounds otherwise for arrays than for numbers
        kept[1:] = [math.exp(-steps * (dt / time)) for steps in np.diff(step).tolist()]
    return np.column_stack([kept, np.sqrt(1.0 - kept**2)])


@formula
def advanced(last: Any, kept: float, fresh: float, normal: Any) -> Any:
    """Next value of the process."""
    return kept * last + fresh * normal


def gauss_markov(normals: Floats, step: Ints, dt: float, time: float) -> Floats:
    """Values of processes, one for each column of normals, shape (m, …); other arguments as of `weights`."""
    values, last = np.empty_like(normals), np.zeros(normals.shape[1:])
    for i, (kept, fresh) in enumerate(weights(step, dt, time).tolist()):
        last = values[i] = advanced(last, kept, fresh, normals[i])
    return values


_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""The next follower's drift is ahead by this angle, which spreads any number of phases evenly [rad]."""
_DERIVED = ("leader_position_drift", "leader_gyro", "leader_attitude_senses", "leader_attitude_sigma")
"""Keys that count by what follows from them."""


def _values(sensors: Sensors, acoustics: Acoustics) -> dict[str, Any]:
    given = in_si({**dict(sensors), **dict(acoustics)})
    declared = {
        name: value
        for name, value in given.items()
        if name not in ("own", "sound_speed_profile") and not name.startswith(_DERIVED)
    }
    tilt, towards = random_error(sensors), np.deg2rad(sensors.leader_position_drift_deg)
    return declared | {
        "leader_tilt_sigma": tilt.sigma,
        "leader_tilt_time": tilt.time,
        "leader_drift_east": float(sensors.leader_position_drift_m_s * np.sin(towards)),
        "leader_drift_north": float(sensors.leader_position_drift_m_s * np.cos(towards)),
    }


_DEFAULTS = _values(Sensors(), Acoustics())

if TYPE_CHECKING:

    class SensorErrors(tuple[Any, ...]):
        """Keys of `[sensors]` and `[acoustics]` without their units, in SI units, by default those of the paper.

        Besides: `leader_tilt_sigma` [rad] and `leader_tilt_time` [s], standard deviation and correlation time of the
        leader's pitch and roll (0: each message has its own), and `leader_drift_east` and `leader_drift_north`, the
        rate at which its broadcast position departs from the true one [m/s]. No navigator has access to them.
        """

        def __new__(cls, **errors: Any) -> "SensorErrors": ...

        def __getattr__(self, name: str) -> Any: ...

else:
    SensorErrors = namedtuple("SensorErrors", _DEFAULTS, defaults=_DEFAULTS.values())

ERRORS = np.dtype(
    [
        (name, np.float64, np.shape(value)) if np.ndim(value) else (name, type(value))
        for name, value in _DEFAULTS.items()
    ]
)
"""The same as a record for compiled code."""


def errors_of(scenario: Scenario, follower: int = 0) -> SensorErrors:
    """The true errors of a follower's and the leader's sensors."""
    return SensorErrors(**_values(scenario.sensors_of(follower), scenario.acoustics))


@elementwise
def drift(e: Any, amplitude: float, phase: float, follower: int, time: Any) -> Any:
    """Sinusoidal drift of a bias of a follower, by its index, at a time [s]; in the unit of the amplitude."""
    if amplitude == 0.0:
        return 0.0
    return amplitude * np.sin(2.0 * np.pi / e.drift_period * time + (phase + follower * _GOLDEN))


@formula
def speed_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Speed log, never negative (paper, Eq. 26); its scale ends at `FASTEST`."""
    return np.minimum(np.maximum(true + bias + sigma * normal, 0.0), FASTEST)


@formula
def heading_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Compass: the random part adds to the bias, whatever its sign (paper, Eq. 27)."""
    return true + bias + sigma * np.abs(normal)


@formula
def plain_reading(true: Any, bias: float, sigma: float, normal: Any) -> Any:
    """Normal error: pressure sensor, inclinometer, gyro."""
    return true + bias + sigma * normal


@formula
def _range_reading(true: Any, longest: Any, tau: float, uniform: Any, psi: Any) -> Any:
    reading = true + tau * uniform + psi * (true / (longest + (longest == 0.0)))
    return select((reading > 0.0) & (reading <= FARTHEST), reading, np.nan)


@formula
def range_readings(e: SensorErrors, transmitters: int, true: Any, uniform: Any, normal: Any) -> Any:
    """Ranges of a message to the rear, front and middle transmitter (paper, Eq. 28); NaN where none is received.

    A receiver rejects what is no range: zero, negative, or beyond `FARTHEST`. N_T, the number of transmitters in use,
    is 2 with LAISN-2 and 3 with LAISN-3 (Sections 2.2 and 2.3). ψ counts in proportion to the longest range to them.
    The middle one, which LAISN-2 has no use for, is scaled by the longest of all.
    """
    psi, centre = e.range_scale_mean + e.range_scale_sigma * normal, 0.5 * e.range_error_centred
    of_two = np.fmax(np.fmax(true[0], true[1]), 0.0)
    of_all = np.fmax(of_two, true[2])
    longest = of_all if transmitters > 2 else of_two
    return (
        _range_reading(true[0], longest, e.range_tau[0], uniform[0] - centre, psi),
        _range_reading(true[1], longest, e.range_tau[1], uniform[1] - centre, psi),
        _range_reading(true[2], of_all, e.range_tau[2], uniform[2] - centre, psi),
    )


@formula
def loses(e: SensorErrors) -> bool:
    """Whether a message is ever lost."""
    return bool(e.loss_probability + e.burst_probability > 0.0)


@formula
def is_bad(bad: bool, uniform: float, e: SensorErrors) -> bool:
    """Whether the next message meets the bad state, which is left with the inverse of its mean length."""
    return bool(uniform * e.burst_mean_messages >= 1.0 if bad else uniform < e.burst_probability)


@formula
def is_lost(bad: bool, uniform: float, e: SensorErrors) -> bool:
    """Whether a message in that state is lost."""
    return bool(uniform < (e.burst_loss_probability if bad else e.loss_probability))


@formula
def path_taken(uniform: Any, e: SensorErrors) -> Any:
    """`Path` that the receiver takes for the direct one by a draw in (0, 1); numbers or arrays."""
    surface = uniform < e.surface_echo_probability
    either = uniform < e.surface_echo_probability + e.bottom_echo_probability
    # 1 for the surface, 2 for the bottom: a draw below the first chance is below the sum of both
    return 2 * either - 1 * surface
