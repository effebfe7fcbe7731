"""Sensor errors that filters on ranges assume, in the terms of a data sheet: tightly coupled, and rival methods."""

from dataclasses import dataclass, field

import numpy as np

from laisn.arrays import require_probability
from laisn.failure import LaisnError
from laisn.settings import Settings

# Biases of real sensors are never quite constant: a filter that takes them as constant loses them for good.
LOG_WALK, COMPASS_WALK, CURRENT_WALK = 2e-4, 1.5e-4, 1e-3
"""Random walks that filters on ranges assume of constant biases and currents [m/s/√s], [rad/√s], [m/s/√s]."""


@dataclass(frozen=True, kw_only=True)
class Assume:
    """Model assumptions: what is given, and what is estimated."""

    exact_leader: bool = True
    """No bias of the leader's compass; false: estimate it."""
    drift: bool = False
    """Biases of log and compass drift."""
    deviation: bool = False
    """Compass biases depend on heading, by 3 % of a turn; the leader's too, unless exact."""
    current: bool = False
    """Estimate a current common to leader and follower."""
    offsets: bool = False
    """Estimate a constant range error of each transmitter."""
    clock: bool = False
    """Estimate offset and drift of the follower's clock."""


@dataclass(frozen=True, kw_only=True)
class TightSettings(Settings):
    """Settings of the tightly coupled navigator: standard deviations of its sensors, without their signs."""

    POSITIVE = Settings.POSITIVE | {"start_sigma", "range_sigma", "outlier_span"}

    assume: Assume = field(default_factory=Assume)
    transmitters: int = 3
    """How many of rear, front and middle transmitter are used: 2 or 3."""
    known_start: bool = True
    """The start is given; false: initialise from the first message with at least two ranges."""
    start_sigma: float = 0.01
    """σ of the initial position along each axis [m]."""
    speed_sigma: float = 0.2
    """Random σ of a speed log reading [m/s]."""
    speed_bias_sigma: float = 0.3
    """Prior σ of the speed log bias [m/s]."""
    heading_sigma: float = float(np.deg2rad(1.2))
    """Random σ of a compass reading [rad]."""
    heading_bias_sigma: float = float(np.deg2rad(8.0))
    """Prior σ of the compass bias [rad]."""
    range_sigma: float = 0.003
    """Random σ of each range [m]."""
    range_scale_sigma: float = 0.05
    """Random σ common to the ranges of a message, proportional to range, at the longest [m]."""
    range_scale_bias_sigma: float = 0.2
    """Prior σ of the mean of this common error [m]."""
    leader_heading_sigma: float = float(np.deg2rad(1.2))
    """Random σ of a broadcast heading, unless the leader is exact [rad]."""
    leader_heading_bias_sigma: float = float(np.deg2rad(6.0))
    """Prior σ of the broadcast heading bias, unless the leader is exact [rad]."""
    current_sigma: float = 0.4
    """Prior σ of the current along each axis [m/s]."""
    offset_sigma: float = 0.015
    """Prior σ of a transmitter's constant error, relative to the first [m]."""
    clock_offset_sigma: float = 1.5
    """σ of the clocks' offset at the start, as a range [m]: 1 ms, if there may be one."""
    clock_drift_sigma: float = 1.5e-3
    """σ of the rate at which it grows [m/s]: 1 ppm."""
    slip: float = 0.0
    """Motion that the log does not see: leeway and turbulence, in a second [m/√s]."""
    outlier_probability: float = 0.05
    """Chance that a range is an echo's."""
    outlier_span: float = 4.5
    """Maximum excess of an echo's range over the direct range [m]."""

    @property
    def estimated(self) -> frozenset[str]:
        """Constants that are states beside the biases of log, compass and ranges, named as in `TrueNoise`."""
        assume = self.assume
        states = {
            "leader_heading_bias": not assume.exact_leader,
            "current": assume.current,
            "range_offset": assume.offsets,
            "clock": assume.clock,
        }
        return frozenset(name for name, is_state in states.items() if is_state)

    def __post_init__(self) -> None:
        if self.transmitters not in (2, 3):
            raise ValueError(f"transmitters is {self.transmitters}, expected 2 or 3")
        if self.transmitter_offsets and len(self.transmitter_offsets) < self.transmitters:
            raise ValueError(
                f"transmitter_offsets has {len(self.transmitter_offsets)} places, expected one for each of "
                f"{self.transmitters} transmitters"
            )
        require_probability("outlier_probability", self.outlier_probability)
        super().__post_init__()


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
