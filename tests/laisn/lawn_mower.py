"""An AUV on lawn-mower tracks among three beacons, and faults of its sensors.

The measurements are computed without code of the navigator.
"""

from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.messages import LeaderMessage, Measurements

BEACONS = np.array([[0.0, 0.0], [400.0, 50.0], [180.0, 350.0]])
DT = 0.2
STEPS_PER_MESSAGE = 25
LEG_S = 160.0
TURN_RATE = np.deg2rad(6.0)  # [rad/s]


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Errors beyond white noise."""

    speed_scale: float = 0.0
    """Logarithm of true over measured speed, of either sign."""
    speed_wave: float = 0.0
    """Amplitude of its variation with a period of five minutes."""
    deviation: float = 0.0
    """Amplitude of the compass's error over heading [rad]."""
    echo_share: float = 0.0
    """Share of ranges that are echoes, 3 to 40 m too long."""
    echo_burst: int = 1
    """How many ranges in a row are echoes with the same excess length."""
    error_correlation: float = 0.0
    """Correlation of a range's error with that of the range before."""
    range_sigma: float = 0.5
    """Standard deviation of a range without echo [m]."""
    start_sigma: float = 0.0
    """Standard deviation of the start as given to the navigator, along each axis [m]."""


def headings(steps: int) -> Floats:
    """Legs to the east and to the west by turns; it turns from one to the next over north."""
    result = np.empty(steps)
    heading = 0.5 * np.pi
    for step in range(steps):
        west = int(DT * step / LEG_S) % 2
        leg_heading = -0.5 * np.pi if west else 0.5 * np.pi
        heading += np.clip(leg_heading - heading, -TURN_RATE * DT, TURN_RATE * DT)
        result[step] = heading
    return result


def mow_the_lawn(
    faults: Faults, seed: int, seconds: float = 1200.0
) -> tuple[Measurements, Floats, Floats]:
    """Measurements, true positions from the start on, shape (n + 1, 2), and the start that a
    navigator is given, (x, y, 0, 0).
    """
    rng = np.random.default_rng([seed, 3])
    steps = round(seconds / DT)
    time = DT * np.arange(steps)
    heading = headings(steps)
    speed = 1.4 + 0.1 * np.sin(time / 40.0)
    displacement = DT * speed[:, None] * np.column_stack([np.sin(heading), np.cos(heading)])
    displacement += DT * 0.05 * rng.standard_normal(2) + 0.05 * np.sqrt(DT) * rng.standard_normal(
        (steps, 2)
    )
    position = np.vstack([np.zeros(2), np.cumsum(displacement, axis=0)]) + np.array([100.0, 50.0])
    log_scale = faults.speed_scale * rng.choice([-1.0, 1.0])
    log_scale = log_scale + faults.speed_wave * np.sin(time / 47.7 + rng.uniform(0.0, 6.0))
    compass = heading + faults.deviation * np.sin(heading + rng.uniform(0.0, 6.0))
    message_step = np.arange(STEPS_PER_MESSAGE, steps + 1, STEPS_PER_MESSAGE)
    true_beacons = BEACONS + 0.5 * rng.standard_normal(BEACONS.shape)
    ranges = np.linalg.norm(position[message_step][:, None] - true_beacons, axis=2)
    ranges *= 1.0 + 0.003 * rng.standard_normal()
    range_error = np.zeros(3)
    echoes_left = np.zeros(3, dtype=int)
    excess = np.zeros(3)
    for i in range(message_step.size):
        range_error = faults.error_correlation * range_error
        range_error += (
            faults.range_sigma * np.sqrt(1.0 - faults.error_correlation**2) * rng.standard_normal(3)
        )
        is_new_echo = (echoes_left == 0) & (rng.random(3) < faults.echo_share / faults.echo_burst)
        echoes_left[is_new_echo] = faults.echo_burst
        excess[is_new_echo] = rng.uniform(3.0, 40.0, np.count_nonzero(is_new_echo))
        ranges[i] += range_error + (echoes_left > 0) * (excess + 0.3 * rng.standard_normal(3))
        echoes_left -= echoes_left > 0
    ranges[rng.random(ranges.shape) < 0.2] = np.nan
    transmitters = np.zeros((message_step.size, 3, 3))
    transmitters[:, :, :2] = BEACONS
    message = np.zeros((message_step.size, len(LeaderMessage._fields)))
    message[:, 0] = DT * message_step
    measured = Measurements(
        dt=DT,
        speed=speed * np.exp(-log_scale) + 0.03 * rng.standard_normal(steps),
        heading=compass + np.deg2rad(0.5) * rng.standard_normal(steps),
        depth=np.zeros(steps),
        message_step=message_step.astype(np.int64),
        message=message,
        ranges=ranges,
        transmitters=transmitters,
    )
    start = np.zeros(4)
    start[:2] = position[0] + faults.start_sigma * rng.standard_normal(2)
    return measured, position, start
