"""Errors of odometry and ranges that the navigator among beacons assumes, in the terms of a data sheet."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from laisn.arrays import require_numbers, require_probability


@dataclass(frozen=True, kw_only=True)
class BeaconSettings:
    """Settings of the navigator among beacons: standard deviations of its sensors, without their signs.

    The defaults are those of a wheeled vehicle with radio ranges, `MEDIA` has others. Raises ValueError naming the
    field if a value is out of its range.
    """

    POSITIVE: ClassVar[frozenset[str]] = frozenset({"dt", "start_sigma", "range_sigma", "outlier_span"})
    """Numbers that must not be zero."""

    dt: float = 0.1
    """Filter step Δt [s]; steps of other lengths may come between."""
    hydrophone_height: float = 0.0
    """Height of the receiver above the depth sensor when level [m]."""
    known_start: bool = True
    """The start is given. Otherwise the first ranges give it."""
    start_sigma: float = 1.0
    """Standard deviation of the position at the start, along each axis [m]."""
    heading_sigma: float = float(np.deg2rad(5.0))
    """Standard deviation of the heading's error at the start [rad]."""
    gyro_bias_sigma: float = float(np.deg2rad(0.5))
    """Standard deviation of the rate at which that error grows [rad/s]; 0 for a compass."""
    speed_scale_sigma: float = 0.03
    """Standard deviation of the logarithm of true over measured speed."""
    slip: float = 0.05
    """Motion that odometry does not see, in a second, along each axis [m/√s]."""
    heading_walk: float = float(np.deg2rad(0.0573))
    """Random walk of the heading's error beside that rate, in a second [rad/√s]."""
    current_sigma: float = 0.0
    """Standard deviation of a current that carries the vehicle, along each axis [m/s]; 0 for none."""
    range_sigma: float = 0.5
    """Random error of each range [m]; the estimate for each beacon stays between half and four times this."""
    range_scale_sigma: float = 0.1
    """Standard deviation of the scale error that all ranges share: of radio. Sound under water has 0.003."""
    range_offset_sigma: float = 0.1
    """Standard deviation of each beacon's constant error of range [m]."""
    survey_sigma: float = 0.1
    """Standard deviation of each beacon's place, along each axis [m]."""
    outlier_probability: float = 0.05
    """Chance that a range is wrong altogether."""
    outlier_span: float = 20.0
    """Width of the span in which wrong ranges lie [m]; the same for all `MEDIA`, so that their evidence compares."""

    def __post_init__(self) -> None:
        require_probability("outlier_probability", self.outlier_probability)
        require_numbers(self, positive=self.POSITIVE, signed={"hydrophone_height"})


MEDIA = {
    "air": BeaconSettings(),
    "water": BeaconSettings(
        gyro_bias_sigma=0.0,
        slip=0.2,
        current_sigma=0.1,
        range_scale_sigma=0.003,
        survey_sigma=1.0,
    ),
}
"""What ranges are measured through: radio on land, or sound under water, where a vehicle has a compass and drifts."""
