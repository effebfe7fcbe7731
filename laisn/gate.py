"""Gross-error gate: a fix farther away than the vehicle can have travelled is rejected (paper, Section 2.4).

The bound grows with the time since the last accepted position. With a constant bound one rejection would lead to the
next, and the filter would lock itself out for good.
"""

import numpy as np

from laisn.settings import NavigationSettings

Point = tuple[float, float]


class Gate:
    """Remembers the last accepted position: the state right after the update that was accepted."""

    def __init__(self, settings: NavigationSettings, start: Point) -> None:
        self._settings = settings
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
        elapsed = (step - self._step) * self._settings.dt + self._extra
        if self._settings.gate == "v-max":
            return self._settings.follower_speed_max * elapsed
        if self._settings.gate == "v-measured":
            return speed * elapsed
        if self._settings.gate == "off":
            return np.inf
        raise NotImplementedError(f"there is no bound for the gate {self._settings.gate!r}")

    def passes(self, position: Point, step: int, speed: float) -> bool:
        """Whether a fix at that position is believable."""
        travelled = np.hypot(position[0] - self._position[0], position[1] - self._position[1])
        return bool(travelled <= self.bound(step, speed))

    def accept(self, position: Point, step: int) -> None:
        """Take the state after an update as the new last accepted position."""
        self._position = position
        self._step = step
        self._extra = 0.0
