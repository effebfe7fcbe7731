"""Errors that the study adds to the paper's noise."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from laisn.messages import Measurements

SPEED_DRIFT = 0.1  # amplitude of a sinusoidal drift of the log's bias [m/s]
SPEED_PERIOD = 300.0  # its period [s]
HEADING_DRIFT = float(np.deg2rad(3.0))
HEADING_PERIOD = 400.0
"""Sinusoidal drift of the compass's bias: amplitude [rad] and period [s]."""
DEVIATION = 0.03  # amplitude of a compass deviation that goes once round with the heading [rad]
LATE_RANGE_M = 0.010  # excess of the front transmitter's ranges, whose pings leave late [m]
ECHO_CHANCE = 0.05  # chance of each range to be that of an echo
# least and largest excess of an echo's range, drawn evenly between them [m]
ECHO_EXCESS = (0.3, 4.8)
# chance of each message that all its ranges have the same excess, drawn likewise
COMMON_CHANCE = 0.1
# clock offset of 1 ms at the start, as a range [m], and drift of 1 ppm [m/s]
CLOCK_OFFSET = 1.5
CLOCK_DRIFT = 1.5e-3
LOSS_CHANCE = 0.2  # chance of each message to be lost
ERRORS = ("drift", "deviation", "echoes", "losses", "late", "common", "clock")


class Errors:
    """Errors of log, compass and ranges, which study files name with `disturb`."""

    def __init__(self, errors: Sequence[str]) -> None:
        """Take names of `ERRORS`; ValueError naming one that is none."""
        for name in errors:
            if name not in ERRORS:
                raise ValueError(f"there is no error {name!r}; available: {', '.join(ERRORS)}")
        self.errors = errors

    def disturb(self, measurements: Measurements, seed: int, run: int) -> Measurements:
        """Measurements with the errors added; a function of errors and arguments alone."""
        rng = np.random.default_rng([seed, run])
        if "drift" in self.errors:
            time = measurements.dt * np.arange(1, measurements.speed.size + 1)
            phase = rng.uniform(0.0, 2.0 * np.pi, 2)
            log = SPEED_DRIFT * np.sin(2.0 * np.pi * time / SPEED_PERIOD + phase[0])
            compass = HEADING_DRIFT * np.sin(2.0 * np.pi * time / HEADING_PERIOD + phase[1])
            measurements = replace(
                measurements,
                speed=np.maximum(measurements.speed + log, 0.0),
                heading=measurements.heading + compass,
            )
        if "deviation" in self.errors:
            angle = np.random.default_rng([seed, run, 1]).uniform(0.0, 2.0 * np.pi)
            deviation = DEVIATION * np.sin(measurements.heading + angle)
            measurements = replace(measurements, heading=measurements.heading + deviation)
        ranges = measurements.ranges.copy()
        if "clock" in self.errors:
            ranges += (
                CLOCK_OFFSET + CLOCK_DRIFT * measurements.dt * measurements.message_step[:, None]
            )
        if "common" in self.errors:
            common_rng = np.random.default_rng([seed, run, 2])
            excess = common_rng.uniform(*ECHO_EXCESS, (ranges.shape[0], 1))
            ranges += np.where(common_rng.random((ranges.shape[0], 1)) < COMMON_CHANCE, excess, 0.0)
        if "late" in self.errors:
            ranges[:, 1] += LATE_RANGE_M
        # drawn in any case, so that an error alone is the same as among others
        echo = rng.random(ranges.shape) < ECHO_CHANCE
        excess = rng.uniform(*ECHO_EXCESS, ranges.shape)
        lost = rng.random(ranges.shape[0]) < LOSS_CHANCE
        if "echoes" in self.errors:
            ranges += np.where(echo, excess, 0.0)
        if "losses" in self.errors:
            ranges[lost] = np.nan
        return replace(measurements, ranges=ranges)
