"""When the pings of a message left and arrived, and what both vehicles moved meanwhile.

Rear, front and middle ping leave one after the other, a slot apart, and a message is used when all
are in, or later. A range is the distance of the places at these times.
"""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.messages import LeaderMessage, Ranges
from laisn.settings import Settings

LONGEST_DELAY = 5.0
"""A message that seems to have been longer under way has a clock of its own [s]."""
SMOOTHING_TIME = 1.5
"""The speed over the pings is the log's exponential mean over this time [s]."""
MEAN_SPEED_SIGMA = 0.03
"""Random error of that speed, of what the vehicle accelerates [m/s]."""


class Delays(NamedTuple):
    """Of the pings from the rear, front and middle transmitter, shape (3,) each."""

    lag: Floats  # how long ago each arrived [s]; NaN where nothing was received
    # time since the message's timestamp without the ping's travel [s]: for so long a current has
    # carried leader and follower alike
    age: Floats


def delays_of(message: LeaderMessage, ranges: Ranges, clock: float, settings: Settings) -> Delays:
    """Delays at a time since the start [s], by the time of the message on the same clock.

    A time of the message that is no such time, or zero, which states none, is taken for that at
    which the last ping arrives now.
    """
    leaves = settings.ping_slot * np.arange(3)
    travel_times = settings.sound_slowness * np.array(ranges)
    last = float(np.nanmax(leaves + travel_times, initial=0.0))
    elapsed = clock - message.timestamp
    if message.timestamp == 0.0 or not last <= elapsed <= LONGEST_DELAY:
        elapsed = last
    return Delays(
        np.maximum(elapsed - leaves - travel_times, 0.0), np.maximum(elapsed - travel_times, 0.0)
    )


def leader_way(message: LeaderMessage, settings: Settings) -> Floats:
    """East and north from the message's place to where each ping leaves, shape (3, 2), [m]."""
    direction = np.array([math.sin(message.heading), math.cos(message.heading)])
    slots = settings.ping_slot * np.arange(3)
    return np.asarray(message.speed * slots[:, None] * direction)


class MeanSpeed:
    """Exponential mean of a log's readings, and the time since the start."""

    def __init__(self) -> None:
        self.clock = 0.0
        self.speed = 0.0
        self.since_message = 0.0

    def advance(self, speed: float, dt: float) -> None:
        """Take a reading at the end of a step that took a time [s]."""
        self.clock += dt
        self.since_message += dt
        self.speed += dt * max(1.0 / SMOOTHING_TIME, 1.0 / self.clock) * (speed - self.speed)

    def variance(self, dt: float, speed_sigma: float) -> float:
        """Of the mean, by that of a reading and the filter step [s], [m²/s²].

        It is of readings since the last message alone, so that the errors of messages are
        independent.
        """
        share = dt / min(max(self.since_message, dt), SMOOTHING_TIME)
        return speed_sigma**2 * share + MEAN_SPEED_SIGMA**2
