"""A straight course past beacons, measured in steps of any length."""

import numpy as np

from laisn.arrays import Floats
from laisn.messages import Measurements
from laisn.settings import NavigationSettings

BEACONS = np.array([[-200.0, 0.0, 5.0], [150.0, 40.0, 12.0], [20.0, 260.0, 3.0]])
"""East, north, depth; not on one line."""


def passage(
    durations: Floats | None, n: int = 400, *, lost: tuple[int, ...] = ()
) -> tuple[Measurements, Floats]:
    """Exact measurements of a follower that keeps its speed and course past beacons, 200 m and more
    apart, and its true positions (n + 1, 2). Ranges to the beacons `lost` are missing.
    """
    time = np.append(0.0, np.cumsum(np.full(n, 0.5) if durations is None else durations))
    position = np.array([-100.0, 60.0]) + time[:, None] * [0.8, 0.6]
    message_step = np.arange(4, n + 1, 4)
    from_beacons = (
        np.column_stack([position[message_step], np.full(message_step.size, 9.0)])[:, None]
        - BEACONS
    )
    ranges = np.linalg.norm(from_beacons, axis=2)
    ranges[:, lost] = np.nan
    message = np.full((message_step.size, 10), np.nan)
    message[:, :6] = 0.0
    measurements = Measurements(
        dt=0.5,
        speed=np.ones(n),
        heading=np.full(n, np.arctan2(0.8, 0.6)),
        depth=np.full(n, 9.0),
        message_step=message_step,
        message=message,
        ranges=ranges,
        durations=durations,
        transmitters=np.broadcast_to(BEACONS, (message_step.size, 3, 3)).copy(),
    )
    return measurements, position


START = np.array([-100.0, 60.0, 0.8, 0.6])
SETTINGS = NavigationSettings(dt=0.5)
