"""Errors that change slowly and surely: biases that come and go, and a leader that loses its way.

The biases of log and compass swing as sines about their means, those of each follower at another phase; the leader's
inertial navigation walks off at a constant rate. They are functions of time alone, so that what is sensed under way and
what is measured on the finished mission are the same.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.scenario.sensors import Sensors

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""The next follower's swings are ahead by this angle, which spreads any number of phases evenly [rad]."""


class Wandering(NamedTuple):
    """Slow errors, of `[sensors]`."""

    speed: float
    """Amplitude of the log's bias about its mean [m/s]."""
    heading: float
    """Amplitude of the compass's bias about its mean [rad]."""
    rate: float
    """Angular rate of both sines [rad/s]."""
    phases: tuple[float, float]
    """Phases of the sines of log and compass at the start, for the first follower [rad]."""
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
            phases=(
                float(np.deg2rad(sensors.speed_drift_phase_deg)),
                float(np.deg2rad(sensors.heading_drift_phase_deg)),
            ),
            leader=(float(astray * np.sin(towards)), float(astray * np.cos(towards))),
        )


@compiled
def biased(w: Wandering, follower: int, time: float, speed: float, heading: float) -> tuple[float, float]:
    """Speed [m/s] and heading [rad] of a follower, by its index, with the errors of an instant [s]."""
    if w.speed == 0.0 and w.heading == 0.0:
        return speed, heading
    turned = w.rate * time + follower * _GOLDEN
    return speed + w.speed * np.sin(turned + w.phases[0]), heading + w.heading * np.sin(turned + w.phases[1])


@compiled
def wander(w: Wandering, follower: int, time: Floats, own: Floats) -> None:
    """Add the errors to columns speed and heading of a follower's own motion, shape (n, 2) or wider, in place."""
    for i in range(time.size):
        own[i, 0], own[i, 1] = biased(w, follower, time[i], own[i, 0], own[i, 1])
