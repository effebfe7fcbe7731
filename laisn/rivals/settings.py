"""Settings of the rival methods: the standard deviations of `[navigation.assume]`, and what a method has of its own."""

from dataclasses import dataclass

import numpy as np

from laisn.failure import LaisnError
from laisn.tight.settings import TightSettings


@dataclass(frozen=True, kw_only=True)
class RivalSettings(TightSettings):
    """Standard deviations as of the tightly coupled navigator, so that all methods assume the same sensors.

    Of its model assumptions `current` alone applies: the leader's heading and the clock count as exact, and no offset
    or drift is estimated.
    """

    POSITIVE = TightSettings.POSITIVE | {"lag", "azimuth_sigma", "elevation_sigma"}

    particles: int = 2000
    """Particle filter: number of particles."""
    lag: float = 20.0
    """Factor graph: time that its window reaches back [s]."""
    azimuth_sigma: float = float(np.deg2rad(1.0))
    """Inverted USBL: σ of the measured azimuth [rad]."""
    elevation_sigma: float = float(np.deg2rad(1.0))
    """Inverted USBL: σ of the measured elevation [rad]."""

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of log, compass and ranges: the current, if assumed."""
        return super().estimated & {"current"}

    def __post_init__(self) -> None:
        if not self.known_start:
            raise LaisnError("known_start is false, which only the tightly coupled navigator can begin with")
        if not 10 <= self.particles <= 1_000_000:
            raise LaisnError(f"particles is {self.particles}, expected 10 to 1000000")
        super().__post_init__()
