"""Gross-error gate: a fix farther away than the vehicle can have travelled is rejected (paper, Section 2.4).

The bound grows with the time since the last accepted position. With a constant bound one rejection would lead to the
next, and the filter would lock itself out for good.
"""

import math

import numpy as np

from laisn.compiled import formula
from laisn.geometry import Point
from laisn.tuning import GATE_MEASURED, GATE_OFF, Tuning


@formula
def reach(elapsed: float, speed: float, t: Tuning) -> float:
    """Greatest distance that a vehicle can have come in a time [s], at top speed or at the one measured [m]."""
    top = speed if t.gate == GATE_MEASURED else t.follower_speed_max
    return np.inf if t.gate == GATE_OFF else top * elapsed


@formula
def is_beyond(place: Point, start: Point, bound: float) -> bool:
    """Whether a place lies farther from a start than the bound [m]."""
    east, north = place.east - start.east, place.north - start.north
    return math.sqrt(east * east + north * north) > bound


class Gate:
    """Remembers the last accepted position: the state right after the update that was accepted."""

    def __init__(self, tuning: Tuning, start: Point) -> None:
        self._tuning = tuning
        self._position = start
        self._step = 0
        self._extra = 0.0

    def lengthen(self, extra: float) -> None:
        """Say that the step that begins takes so much longer than Δt [s]."""
        self._extra += extra

    def bound(self, step: int, speed: float) -> float:
        """Greatest distance that the vehicle can be from the last accepted position at a step [m].

        Args:
            step: k.
            speed: measured at this step [m/s]; used by the rule "v-measured".
        """
        # steps of Δt are counted, not added up, so that this is exact where there are no others
        return reach((step - self._step) * self._tuning.dt + self._extra, speed, self._tuning)

    def passes(self, position: Point, step: int, speed: float) -> bool:
        """Whether a fix at that position is believable."""
        return not is_beyond(position, self._position, self.bound(step, speed))

    def accept(self, position: Point, step: int) -> None:
        """Take the state after an update as the new last accepted position."""
        self._position = position
        self._step = step
        self._extra = 0.0
