"""A line of a benchmark's table, and how time is taken."""

import time
from collections.abc import Callable, Sequence
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
    """Least processor time of several, after one that warms up [s]; waiting for other processes
    does not count.
    """
    return least_times([work], repeats)[0]


def least_times(works: Sequence[Callable[[], object]], repeats: int) -> list[float]:
    """Least processor time of each of several that take turns, so that a machine that slows down
    slows all of them.
    """
    for work in works:
        work()
    least = [np.inf] * len(works)
    for _ in range(repeats):
        for i, work in enumerate(works):
            begin = time.process_time()
            work()
            least[i] = min(least[i], time.process_time() - begin)
    return least
