"""A vehicle on figures of eight among beacons, and its measurements: computed without code of the
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
    """Constant error of the measured heading [rad]."""
    gyro_bias: float = 0.0
    """Rate at which that error grows [rad/s]."""
    range_scale: float = 0.0
    """Measured over true range, less 1."""
    noise: float = 0.5
    """Standard deviation of a range [m]."""
    offsets: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    beacon_errors: tuple[tuple[float, float], ...] = ((0.0, 0.0),) * 4
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
            beacon_errors=tuple(
                (settings.survey_sigma * a, settings.survey_sigma * b)
                for a, b in draw[8:16].reshape(4, 2)
            ),
            current=(settings.current_sigma * draw[16], settings.current_sigma * draw[17]),
        )


def round_trip(
    true: Errors, seconds: int, *, seed: int = 1, slip: float = 0.0, shift: float = 0.0
) -> tuple[Measurements, Floats]:
    """Figures of eight among four beacons; one range a second, to each beacon by turns.

    Args:
        true: errors of the sensors.
        seconds: duration of the mission.
        seed: of the noise.
        slip: motion that odometry does not see [m/√s].
        shift: offset of all true positions to the east [m].

    Returns:
        Measurements, and true positions from the start on, shape (n + 1, 2), [m].
    """
    rng = np.random.default_rng([seed, 1])
    steps = round(seconds / DT)
    time = DT * np.arange(steps)
    speed = 1.5 + 0.5 * np.sin(time / 17.0)
    heading = 2.2 * np.sin(time / 23.0) + time / 70.0
    displacement = DT * speed[:, None] * np.column_stack(
        [np.sin(heading), np.cos(heading)]
    ) + DT * np.array(true.current)
    displacement += slip * np.sqrt(DT) * rng.standard_normal((steps, 2))
    position = np.vstack([np.zeros(2), np.cumsum(displacement, axis=0)]) + np.array(
        [shift - 10.0, 20.0]
    )
    message_step = np.arange(10, steps + 1, 10)
    beacon = np.arange(message_step.size) % 4
    ranges, transmitters = (
        np.full((message_step.size, 3), np.nan),
        np.full((message_step.size, 3, 3), np.nan),
    )
    from_beacon = position[message_step] - (BEACONS + np.array(true.beacon_errors))[beacon]
    ranges[:, 0] = (1.0 + true.range_scale) * np.hypot(*from_beacon.T) + np.array(true.offsets)[
        beacon
    ]
    ranges[:, 0] += true.noise * rng.standard_normal(message_step.size)
    transmitters[:, 0] = np.column_stack([BEACONS[beacon], np.zeros(message_step.size)])
    message = np.zeros((message_step.size, 10))
    message[:, 0] = DT * message_step
    measured = Measurements(
        dt=DT,
        speed=speed * np.exp(-true.speed_scale),
        heading=heading + true.heading + true.gyro_bias * DT * np.arange(1, steps + 1),
        depth=np.zeros(steps),
        message_step=message_step.astype(np.int64),
        message=message,
        ranges=np.abs(ranges),
        transmitters=transmitters,
    )
    return measured, position
