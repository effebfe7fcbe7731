"""An AUV that mows the lawn among three beacons hundreds of metres apart, and what goes wrong with
its sensors: written apart from the navigator.
"""

from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.messages import LeaderMessage, Measurements

BEACONS = np.array([[0.0, 0.0], [400.0, 50.0], [180.0, 350.0]])
DT = 0.2
EVERY = 25
LEG_S = 160.0
TURN = np.deg2rad(6.0)  # [rad/s]


@dataclass(frozen=True, kw_only=True)
class Faults:
    """Errors beyond white noise."""

    speed_scale: float = 0.0
    """Logarithm of true over measured speed, of either sign."""
    speed_wave: float = 0.0
    """The same, as a wave of five minutes."""
    deviation: float = 0.0
    """Amplitude of the compass's error over heading [rad]."""
    wrong: float = 0.0
    """Share of ranges that are echoes, 3 to 40 m too long."""
    burst: int = 1
    """How many ranges in a row are echoes of one length."""
    memory: float = 0.0
    """Correlation of a range's error with that of the range before."""
    range_sigma: float = 0.5
    start_sigma: float = 0.0


def headings(steps: int) -> Floats:
    """East and west in turn, and over north from one to the other."""
    result = np.empty(steps)
    heading = 0.5 * np.pi
    for k in range(steps):
        west = int(DT * k / LEG_S) % 2
        goal = -0.5 * np.pi if west else 0.5 * np.pi
        heading += np.clip(goal - heading, -TURN * DT, TURN * DT)
        result[k] = heading
    return result


def mown(faults: Faults, seed: int, seconds: float = 1200.0) -> tuple[Measurements, Floats, Floats]:
    """What it measures, where it is from the start on, shape (n + 1, 2), and where it is said to
    start, x, y, 0, 0.
    """
    rng = np.random.default_rng([seed, 3])
    n = round(seconds / DT)
    time = DT * np.arange(n)
    heading = headings(n)
    speed = 1.4 + 0.1 * np.sin(time / 40.0)
    way = DT * speed[:, None] * np.column_stack([np.sin(heading), np.cos(heading)])
    way += DT * 0.05 * rng.standard_normal(2) + 0.05 * np.sqrt(DT) * rng.standard_normal((n, 2))
    place = np.vstack([np.zeros(2), np.cumsum(way, axis=0)]) + np.array([100.0, 50.0])
    scale = faults.speed_scale * rng.choice([-1.0, 1.0])
    scale = scale + faults.speed_wave * np.sin(time / 47.7 + rng.uniform(0.0, 6.0))
    compass = heading + faults.deviation * np.sin(heading + rng.uniform(0.0, 6.0))
    step = np.arange(EVERY, n + 1, EVERY)
    sites = BEACONS + 0.5 * rng.standard_normal(BEACONS.shape)
    ranges = np.linalg.norm(place[step][:, None] - sites, axis=2)
    ranges *= 1.0 + 0.003 * rng.standard_normal()
    error = np.zeros(3)
    left = np.zeros(3, dtype=int)
    excess = np.zeros(3)
    for k in range(step.size):
        error = faults.memory * error
        error += faults.range_sigma * np.sqrt(1.0 - faults.memory**2) * rng.standard_normal(3)
        begins = (left == 0) & (rng.random(3) < faults.wrong / faults.burst)
        left[begins] = faults.burst
        excess[begins] = rng.uniform(3.0, 40.0, np.count_nonzero(begins))
        ranges[k] += error + (left > 0) * (excess + 0.3 * rng.standard_normal(3))
        left -= left > 0
    ranges[rng.random(ranges.shape) < 0.2] = np.nan
    transmitters = np.zeros((step.size, 3, 3))
    transmitters[:, :, :2] = BEACONS
    message = np.zeros((step.size, len(LeaderMessage._fields)))
    message[:, 0] = DT * step
    measured = Measurements(
        dt=DT,
        speed=speed * np.exp(-scale) + 0.03 * rng.standard_normal(n),
        heading=compass + np.deg2rad(0.5) * rng.standard_normal(n),
        depth=np.zeros(n),
        message_step=step.astype(np.int64),
        message=message,
        ranges=ranges,
        transmitters=transmitters,
    )
    start = np.zeros(4)
    start[:2] = place[0] + faults.start_sigma * rng.standard_normal(2)
    return measured, place, start
