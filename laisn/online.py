"""What navigators that run online have in common: a known start or none, readings that can be, one step after another.

A navigator derives from `Online`, and its `step` begins with `require_readings`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.messages import Measurements, OwnMotion, Reception

FASTEST = 50.0
"""A measured speed beyond this is broken, not fast [m/s]."""
FARTHEST = 1e5
"""A range beyond this is broken, not far [m]."""


def require_start(start: Floats) -> Floats:
    """A start x, y [m], vx, vy [m/s], shape (4,); ValueError unless its four numbers are finite."""
    own = np.array(start, dtype=np.float64)
    if own.shape != (4,) or not np.all(np.isfinite(own)):
        raise ValueError(f"start is {start}, expected four finite numbers x, y, vx, vy")
    return own


def require_time(step: int, duration: float | None) -> None:
    """LaisnError unless a step takes a positive time [s], or that of all steps (None)."""
    if duration is not None and not 0.0 < duration < math.inf:
        raise LaisnError(f"step {step}: it takes {duration} s, expected a positive time")


def require_own(step: int, own: OwnMotion) -> None:
    """LaisnError unless a step's own motion is of finite numbers; a missing depth is NaN."""
    if not (math.isfinite(own.speed) and math.isfinite(own.heading)) or math.isinf(own.depth):
        raise LaisnError(f"step {step}: own motion {own} is not finite")


def require_readings(step: int, own: OwnMotion, reception: Reception | None, log: str) -> None:
    """LaisnError naming what of a step's readings cannot be; `log` is what measures the speed."""
    require_own(step, own)
    if not -FASTEST <= own.speed <= FASTEST:
        raise LaisnError(f"step {step}: the {log} reads {own.speed:g} m/s, expected −{FASTEST:g} … {FASTEST:g} m/s")
    ranges = () if reception is None else reception.ranges
    for value in ranges:
        if value < 0.0 or value > FARTHEST:
            raise LaisnError(f"step {step}: ranges {ranges}, expected 0 … {FARTHEST:g} m, NaN for a missing one")


class Online(ABC):
    """A navigator under way: at a step, with a state and its covariance."""

    def __init__(self, start: Floats | None, start_sigma: float) -> None:
        """Begin at a known start, or anywhere.

        Args:
            start: x, y [m], vx, vy [m/s], shape (4,); None: unknown.
            start_sigma: standard deviation of its place along each axis [m].

        Raises:
            ValueError: the start is not four finite numbers.
        """
        self._step, self._depth = 0, math.nan
        self._state, self._covariance = np.full(4, np.nan), np.full((4, 4), np.nan)
        if start is not None:
            self._state = require_start(start)
            self._covariance = np.diag(np.repeat([start_sigma**2, 0.0], 2))

    @property
    def _start(self) -> tuple[float, float] | None:
        """Place of the known start [m], before the first step."""
        x, y = self._state[:2].tolist()
        return None if math.isnan(x) else (x, y)

    @property
    def state(self) -> Floats:
        """x, y, vx, vy after the last step, shape (4,): mean over the mixture."""
        return self._state.copy()

    @property
    def covariance(self) -> Floats:
        """Covariance of `state` over the mixture, shape (4, 4)."""
        return self._covariance.copy()

    def _with_depth(self, own: OwnMotion) -> OwnMotion:
        """Own motion, with the last depth that was read in place of a missing one (NaN).

        A depth enters a range by its square beside the distance's, and changes little in a few steps. Before the first
        reading it stays NaN, and ranges cannot be used.
        """
        if math.isnan(own.depth):
            return own._replace(depth=self._depth)
        self._depth = own.depth
        return own

    @abstractmethod
    def step(self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None) -> Sequence[Any]:
        """Advance by one filter step; what a message changed, if there was one."""

    def _take(self, measurements: Measurements, dt: float) -> tuple[Floats, Floats, list[Any]]:
        """Take a whole mission step by step.

        Args:
            measurements: n steps.
            dt: filter step that they must have [s].

        Returns:
            State and covariance after each step, shapes (n, 4) and (n, 4, 4), and all that `step` gave.

        Raises:
            ValueError: the measurements have another filter step, or the navigator is under way.
        """
        measurements.require_fresh(self._step, dt)
        n = measurements.speed.size
        state, covariance = np.empty((n, 4)), np.empty((n, 4, 4))
        updates: list[Any] = []
        durations = [None] * n if measurements.durations is None else measurements.durations.tolist()
        for i, (own, reception) in enumerate(measurements.steps()):
            updates += self.step(own, reception, durations[i])
            state[i], covariance[i] = self.state, self.covariance
        return state, covariance, updates
