"""Errors that change slowly and surely: biases that come and go, and a leader that loses its way.

The biases of a follower's log and compass swing as sines about their means; the leader's inertial navigation walks off
at a constant rate. They are functions of time alone, so that what is sensed under way and what is measured on the
finished mission are the same.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.scenario.sensors import Sensors


class Wandering(NamedTuple):
    """Slow errors, of `[sensors]`."""

    speed: float
    """Amplitude of the log's bias about its mean [m/s]."""
    heading: float
    """Amplitude of the compass's bias about its mean [rad]."""
    rate: float
    """Of both sines [rad/s]."""
    leader: tuple[float, float]
    """Rate at which the leader's belief of its place walks off, east and north [m/s]."""

    @classmethod
    def of(cls, sensors: Sensors) -> "Wandering":
        """What a scenario says of them."""
        towards = np.deg2rad(sensors.leader_position_drift_deg)
        astray = sensors.leader_position_drift_m_s
        return cls(
            speed=sensors.speed_drift_m_s,
            heading=float(np.deg2rad(sensors.heading_drift_deg)),
            rate=2.0 * np.pi / sensors.drift_period_s,
            leader=(float(astray * np.sin(towards)), float(astray * np.cos(towards))),
        )


@compiled
def biased(w: Wandering, time: float, speed: float, heading: float) -> tuple[float, float]:
    """Speed [m/s] and heading [rad] with the errors of an instant [s]."""
    swing = np.sin(w.rate * time)
    return speed + w.speed * swing, heading + w.heading * swing


@compiled
def wander(w: Wandering, time: Floats, own: Floats) -> None:
    """Add the errors to columns speed and heading of a follower's own motion, shape (n, 2) or wider, in place."""
    for i in range(time.size):
        own[i, 0], own[i, 1] = biased(w, time[i], own[i, 0], own[i, 1])
