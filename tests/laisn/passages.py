"""A way among beacons, measured in steps of any length."""

import numpy as np

from laisn.arrays import Floats
from laisn.messages import Measurements
from laisn.settings import NavigationSettings

BEACONS = np.array([[-200.0, 0.0, 5.0], [150.0, 40.0, 12.0], [20.0, 260.0, 3.0]])
"""East, north, depth: they lie apart, and not on one line."""


def passage(
    durations: Floats | None, n: int = 400, *, lost: tuple[int, ...] = ()
) -> tuple[Measurements, Floats]:
    """A follower that keeps its speed and course past beacons, 200 m and more apart; and its
    true places (n + 1, 2).
    """
    time = np.append(0.0, np.cumsum(np.full(n, 0.5) if durations is None else durations))
    place = np.array([-100.0, 60.0]) + time[:, None] * [0.8, 0.6]
    step = np.arange(4, n + 1, 4)
    apart = np.column_stack([place[step], np.full(step.size, 9.0)])[:, None] - BEACONS
    ranges = np.linalg.norm(apart, axis=2)
    ranges[:, lost] = np.nan
    message = np.full((step.size, 10), np.nan)
    message[:, :6] = 0.0
    measurements = Measurements(
        dt=0.5,
        speed=np.ones(n),
        heading=np.full(n, np.arctan2(0.8, 0.6)),
        depth=np.full(n, 9.0),
        message_step=step,
        message=message,
        ranges=ranges,
        durations=durations,
        transmitters=np.broadcast_to(BEACONS, (step.size, 3, 3)).copy(),
    )
    return measurements, place


START = np.array([-100.0, 60.0, 0.8, 0.6])
SETTINGS = NavigationSettings(dt=0.5)
