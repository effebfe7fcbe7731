"""Errors of sensors and ranges in SI units, and the formulas by which they add to the truth (paper, Eqs. 26–28).

Numbers and arrays go through the same formulas: those of one instant, those of a finished mission (both by
`sim.sensing.sensors`), and those of runs side by side (`experiments.campaign.lane_flight`).

The biases of log and compass may drift as sines about their means, those of each follower at another phase.

Messages are lost one by one, or in bursts. Bursts follow the two-state chain of Gilbert (Bell System Technical Journal
39, 1960) and Elliott (ibid. 42, 1963): in its good state a channel loses few messages, in its bad state most of them.
"""

from collections import namedtuple
from typing import TYPE_CHECKING, Any

import numpy as np

from laisn.compiled import elementwise, formula, select
from laisn.navigators import FARTHEST, FASTEST
from sim.scenario.section import in_si
from sim.scenario.sensors import Acoustics, Sensors
from sim.scenario.settings import Scenario
from sim.sensing.ahrs import random_error

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""The next follower's drift is ahead by this angle, which spreads any number of phases evenly [rad]."""
_DERIVED = ("leader_position_drift", "leader_gyro", "leader_attitude_senses", "leader_attitude_sigma")
"""Keys that count by what follows from them."""


def _values(sensors: Sensors, acoustics: Acoustics) -> dict[str, Any]:
    """Fields of `SensorErrors`."""
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

    A receiver rejects what is no range: zero, negative, or beyond `FARTHEST`.

    N_T, the number of transmitters in use, is 2 with LAISN-2 and 3 with LAISN-3 (Sections 2.2 and 2.3). ψ counts in
    proportion to the longest range to them. The middle one, which LAISN-2 has no use for, is scaled by the longest of
    all.
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
    surface, either = (
        uniform < e.surface_echo_probability,
        uniform < e.surface_echo_probability + e.bottom_echo_probability,
    )
    # 1 for the surface, 2 for the bottom: a draw below the first chance is below the sum of both
    return 2 * either - 1 * surface
