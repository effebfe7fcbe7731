"""The current that the leader's own way shows, for all rival methods that estimate one."""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.geometry import signed_angle
from laisn.messages import LeaderMessage

_WINDOW = 10.0  # longest window [s]
# it is shorter at the start, so that something is known soon: so long after the first message [s],
# and longer by this share of the time since then
_FIRST_WINDOW = 1.0
_GROWTH = 0.2
_ROUNDING = 1e-6  # of differences of timestamps [s]
# windows with more turn of the leader are not used: its way between messages is uncertain [rad]
_MAX_TURN = 0.2
_SIGMA = 0.05  # of the mean current over the longest window [m/s]


class CurrentMeasurement(NamedTuple):
    """A measurement of the current."""

    current: Floats  # mean over the window, east and north, shape (2,), [m/s]
    variance: float  # along each axis [m²/s²]


class LeaderTrack:
    """The leader's way over ground less its way through the water, window by window.

    z = Δp_L / T − mean(s_L u(θ_L)), by the positions, headings and speeds that it broadcasts, which
    count as exact. The tightly coupled navigator takes the same (`laisn.tight.motion`).
    """

    def __init__(self) -> None:
        self._begin: LeaderMessage | None = None  # the message at which the window began
        self._last_message: LeaderMessage | None = None
        self._first_time = 0.0  # timestamp of the first message [s]
        # displacement through the water since the window began, by log and compass, shape (2,), [m]
        self._through_water = np.zeros(2)

    def receive(self, message: LeaderMessage) -> CurrentMeasurement | None:
        """Take a message; the current, where a window ends with it."""
        begin = self._begin
        last = self._last_message
        self._last_message = message
        if begin is None or last is None:
            self._begin = message
            self._first_time = message.timestamp
            return None
        elapsed = message.timestamp - last.timestamp
        self._through_water += 0.5 * elapsed * (_velocity(last) + _velocity(message))
        window = message.timestamp - begin.timestamp
        target_window = min(
            _WINDOW, _FIRST_WINDOW + _GROWTH * (message.timestamp - self._first_time)
        )
        has_turned = abs(signed_angle(message.heading - begin.heading)) > _MAX_TURN
        if not has_turned and window < target_window - _ROUNDING:
            return None
        displacement = np.array([message.east - begin.east, message.north - begin.north])
        current = (displacement - self._through_water) / window if window > 0.0 else displacement
        self._begin = message
        self._through_water = np.zeros(2)
        if has_turned or window <= 0.0:
            return None
        return CurrentMeasurement(current, _SIGMA**2 * _WINDOW / window)


def _velocity(message: LeaderMessage) -> Floats:
    """Through the water, east and north, shape (2,), [m/s]."""
    return message.speed * np.array([math.sin(message.heading), math.cos(message.heading)])
