"""A line of a benchmark's table, and how time is taken."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Row(NamedTuple):
    """A line of the table."""

    name: str
    value: float
    unit: str
    ratio: float = np.nan
    """How many times faster than the peer named in `against`."""
    against: str = ""
    floor: float = np.nan
    """What the machine could do at best, in the same unit."""


def least_time(work: Callable[[], object], repeats: int = 7) -> float:
    """Least processor time of several, after one that warms up [s]; waiting for other processes does not count."""
    work()
    durations = []
    for _ in range(repeats):
        begin = time.process_time()
        work()
        durations.append(time.process_time() - begin)
    return min(durations)
