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

LONGEST_DELAY = 20.0
"""Of a message that seems to have been longer under way the sender's clock is another one [s].

A message of 10 s with pings 2 s apart takes 14 s beside the way of its sound."""
NEGLIGIBLE_DELAY = 1e-3
"""An arrival within this time is now [s]."""
SMOOTHING_TIME = 1.5
"""The speed over the pings is the log's exponential mean over this time [s]."""
MEAN_SPEED_SIGMA = 0.03
"""Random error of that speed, of what the vehicle accelerates [m/s]."""


class Delays(NamedTuple):
    """Of the pings from the rear, front and middle transmitter, shape (3,) each."""

    lag: Floats  # how long ago each arrived [s]; NaN where nothing was received
    # time since the message's timestamp without the ping's travel [s]: for so long a current has
    # carried leader and follower alike
    drift_time: Floats


def delays_of(message: LeaderMessage, ranges: Ranges, clock: float, settings: Settings) -> Delays:
    """Delays at a time `clock` since the start [s], by the timestamp of the message on the same
    clock.

    If the timestamp is 0, which states none, or cannot be on that clock, the last ping counts as
    arriving now.
    """
    emission_delays = settings.ping_slot * np.arange(3)
    travel_times = settings.sound_slowness * np.array(ranges)
    last = float(np.nanmax(emission_delays + travel_times, initial=0.0))
    elapsed = clock - message.timestamp
    if message.timestamp == 0.0 or not last <= elapsed <= LONGEST_DELAY:
        elapsed = last
    return Delays(
        np.maximum(elapsed - emission_delays - travel_times, 0.0),
        np.maximum(elapsed - travel_times, 0.0),
    )


def leader_way(message: LeaderMessage, settings: Settings) -> Floats:
    """East and north from the message's place to where each ping leaves, shape (3, 2), [m]."""
    direction = np.array([math.sin(message.heading), math.cos(message.heading)])
    slots = settings.ping_slot * np.arange(3)
    return np.asarray(message.speed * slots[:, None] * direction)


class MeanSpeed:
    """Exponential mean of a log's readings, and the time since the start."""

    def __init__(self) -> None:
        self.clock = 0.0  # time since the start [s]
        self.speed = 0.0  # the mean [m/s]
        self.since_message = 0.0  # time since the last message, which the caller sets to 0 [s]

    def advance(self, speed: float, dt: float) -> None:
        """Take a reading at the end of a step that took a time [s]."""
        self.clock += dt
        self.since_message += dt
        self.speed += dt * max(1.0 / SMOOTHING_TIME, 1.0 / self.clock) * (speed - self.speed)

    def variance(self, dt: float, speed_sigma: float) -> float:
        """Variance of the mean [m²/s²], by σ of a reading [m/s] and the filter step [s].

        It is of readings since the last message alone, so that the errors of messages are
        independent.
        """
        share = dt / min(max(self.since_message, dt), SMOOTHING_TIME)
        return speed_sigma**2 * share + MEAN_SPEED_SIGMA**2
