"""Deterministic slow errors: sinusoidal drift of the biases of log and compass, and drift of the leader's position.

The biases of log and compass swing as sines about their means, those of each follower at another phase; the leader's
inertial navigation walks off at a constant rate. They are functions of time alone, so that what is sensed under way and
what is measured on the finished mission are the same.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.scenario.sensors import OwnSensors, Sensors

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""The next follower's swings are ahead by this angle, which spreads any number of phases evenly [rad]."""


class BiasDrift(NamedTuple):
    """Sinusoidal drift of the biases of one follower's log and compass."""

    speed: float
    """Amplitude of the log's bias about its mean [m/s]."""
    heading: float
    """Amplitude of the compass's bias about its mean [rad]."""
    rate: float
    """Angular rate of both sines [rad/s]."""
    speed_phase: float
    """Phase of the log's sine at the start [rad]."""
    heading_phase: float
    """Phase of the compass's sine at the start [rad]."""

    @classmethod
    def of(cls, sensors: OwnSensors, follower: int) -> "BiasDrift":
        """The drift of a follower, by its index, with the sensors of `Scenario.sensors_of`."""
        return cls(
            speed=sensors.speed_drift_m_s,
            heading=float(np.deg2rad(sensors.heading_drift_deg)),
            rate=2.0 * np.pi / sensors.drift_period_s,
            speed_phase=float(np.deg2rad(sensors.speed_drift_phase_deg)) + follower * _GOLDEN,
            heading_phase=float(np.deg2rad(sensors.heading_drift_phase_deg)) + follower * _GOLDEN,
        )


def position_drift(sensors: Sensors) -> tuple[float, float]:
    """Rate at which the position that the leader broadcasts departs from the true one, east and north [m/s]."""
    towards, speed = np.deg2rad(sensors.leader_position_drift_deg), sensors.leader_position_drift_m_s
    return float(speed * np.sin(towards)), float(speed * np.cos(towards))


@compiled
def biased(w: BiasDrift, time: float, speed: float, heading: float) -> tuple[float, float]:
    """Speed [m/s] and heading [rad] with the drift at a time [s]; `w`: also a record with these fields."""
    if w.speed == 0.0 and w.heading == 0.0:
        return speed, heading
    turned = w.rate * time
    return speed + w.speed * np.sin(turned + w.speed_phase), heading + w.heading * np.sin(turned + w.heading_phase)


@compiled
def apply_bias_drift(w: BiasDrift, time: Floats, own: Floats) -> None:
    """Add the drift to columns speed and heading of a follower's own motion, shape (n, 2) or wider, in place."""
    for i in range(time.size):
        own[i, 0], own[i, 1] = biased(w, time[i], own[i, 0], own[i, 1])
