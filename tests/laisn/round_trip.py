"""A vehicle that goes round among beacons, and what it measures: written apart from the
navigator.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from laisn.arrays import Floats
from laisn.beacons import BeaconSettings
from laisn.messages import Measurements

BEACONS = np.array([[-45.0, 10.0], [15.0, -10.0], [20.0, 30.0], [-20.0, 60.0]])
DT = 0.1


@dataclass(frozen=True)
class Errors:
    """True errors of the sensors."""

    speed_scale: float = 0.0
    """Logarithm of true over measured speed."""
    heading: float = 0.0
    gyro_bias: float = 0.0
    range_scale: float = 0.0
    noise: float = 0.5
    offsets: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    places: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 4
    current: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def drawn(cls, settings: BeaconSettings, seed: int) -> Self:
        """Errors as the settings expect them."""
        draw = np.random.default_rng([seed, 7]).standard_normal(18)
        return cls(
            speed_scale=settings.speed_scale_sigma * draw[0],
            heading=settings.heading_sigma * draw[1],
            gyro_bias=settings.gyro_bias_sigma * draw[2],
            range_scale=settings.range_scale_sigma * draw[3],
            offsets=tuple(settings.range_offset_sigma * draw[4:8]),
            places=tuple(
                (settings.survey_sigma * a, settings.survey_sigma * b)
                for a, b in draw[8:16].reshape(4, 2)
            ),
            current=(settings.current_sigma * draw[16], settings.current_sigma * draw[17]),
        )


def round_trip(
    true: Errors, seconds: int, *, seed: int = 1, slip: float = 0.0, shift: float = 0.0
) -> tuple[Measurements, Floats]:
    """Figures of eight among four beacons, with one range a second, to one beacon after the other.

    Args:
        true: errors of the sensors.
        seconds: how long it takes.
        seed: of the noise.
        slip: motion that odometry does not see [m/√s].
        shift: how much farther east the vehicle is [m].

    Returns:
        What it measures, and where it is from the start on, shape (n + 1, 2), [m].
    """
    random = np.random.default_rng([seed, 1])
    n = round(seconds / DT)
    time = DT * np.arange(n)
    speed = 1.5 + 0.5 * np.sin(time / 17.0)
    heading = 2.2 * np.sin(time / 23.0) + time / 70.0
    way = DT * speed[:, None] * np.column_stack([np.sin(heading), np.cos(heading)]) + DT * np.array(
        true.current
    )
    way += slip * np.sqrt(DT) * random.standard_normal((n, 2))
    place = np.vstack([np.zeros(2), np.cumsum(way, axis=0)]) + np.array([shift - 10.0, 20.0])
    step = np.arange(10, n + 1, 10)
    beacon = np.arange(step.size) % 4
    ranges, places = np.full((step.size, 3), np.nan), np.full((step.size, 3, 3), np.nan)
    off = place[step] - (BEACONS + np.array(true.places))[beacon]
    ranges[:, 0] = (1.0 + true.range_scale) * np.hypot(*off.T) + np.array(true.offsets)[beacon]
    ranges[:, 0] += true.noise * random.standard_normal(step.size)
    places[:, 0] = np.column_stack([BEACONS[beacon], np.zeros(step.size)])
    message = np.zeros((step.size, 10))
    message[:, 0] = DT * step
    measured = Measurements(
        dt=DT,
        speed=speed * np.exp(-true.speed_scale),
        heading=heading + true.heading + true.gyro_bias * DT * np.arange(1, n + 1),
        depth=np.zeros(n),
        message_step=step.astype(np.int64),
        message=message,
        ranges=np.abs(ranges),
        transmitters=places,
    )
    return measured, place
