"""Sensor errors that the tightly coupled navigator assumes, in the terms of a data sheet."""

from dataclasses import dataclass, field

import numpy as np

from laisn.arrays import require_chance
from laisn.settings import Settings


@dataclass(frozen=True, kw_only=True)
class Assume:
    """What is taken as given, and what is estimated."""

    exact_leader: bool = True
    """The leader's compass has no bias; else that is estimated."""
    drift: bool = False
    """The biases of log and compass drift."""
    deviation: bool = False
    """Compasses err by another bias on another heading, by 3 % of a turn; the leader's too, unless it is exact."""
    current: bool = False
    """The water moves, alike for leader and follower; the current is estimated."""
    offsets: bool = False
    """Each transmitter may be early or late by a constant time."""
    clock: bool = False
    """The follower's clock has an offset from the leader's, and drifts; the error of all ranges is estimated."""


@dataclass(frozen=True, kw_only=True)
class TightSettings(Settings):
    """Settings of the tightly coupled navigator: standard deviations of its sensors, without their signs."""

    POSITIVE = Settings.POSITIVE | {"start_sigma", "range_sigma", "outlier_span"}

    assume: Assume = field(default_factory=Assume)
    transmitters: int = 3
    """How many of rear, front and middle transmitter are used: 2 or 3."""
    known_start: bool = True
    """The start is given. Otherwise the first message with two ranges or more makes the first estimate."""
    start_sigma: float = 0.01
    """σ of the position at the start, along each axis [m]."""
    speed_sigma: float = 0.2
    """σ of the random error of a reading of the speed log [m/s]."""
    speed_bias_sigma: float = 0.3
    """σ of the log's bias before the mission [m/s]."""
    heading_sigma: float = float(np.deg2rad(1.2))
    """σ of the random error of a reading of the compass [rad]."""
    heading_bias_sigma: float = float(np.deg2rad(8.0))
    """σ of the compass's bias before the mission [rad]."""
    range_sigma: float = 0.003
    """σ of the random error of each range [m]."""
    range_scale_sigma: float = 0.05
    """σ of the random error that the ranges of a message share in proportion to their length, at the longest [m]."""
    range_scale_bias_sigma: float = 0.2
    """σ of the mean of that shared error before the mission [m]."""
    leader_heading_sigma: float = float(np.deg2rad(1.2))
    """σ of the random error of the heading in a message, if the leader is not exact [rad]."""
    leader_heading_bias_sigma: float = float(np.deg2rad(6.0))
    """σ of the bias of the heading in messages, if the leader is not exact [rad]."""
    current_sigma: float = 0.4
    """σ of the current along each axis, if there may be one [m/s]."""
    offset_sigma: float = 0.015
    """σ of a transmitter's constant error beside the first one's, if there may be one [m]."""
    clock_offset_sigma: float = 1.5
    """σ of the clocks' offset at the start, as a range [m]: 1 ms, if there may be one."""
    clock_drift_sigma: float = 1.5e-3
    """σ of the rate at which it grows [m/s]: 1 ppm."""
    slip: float = 0.0
    """Motion that the log does not see: leeway and turbulence, in a second [m/√s]."""
    outlier_chance: float = 0.05
    """Chance that a range is an echo's."""
    outlier_span: float = 4.5
    """Largest excess of an echo's range over that of the direct ping [m]."""

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
        require_chance("outlier_chance", self.outlier_chance)
        super().__post_init__()
