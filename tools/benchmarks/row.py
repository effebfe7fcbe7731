"""A line of a benchmark's table, its goal, and how time is taken."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np


class Goal(NamedTuple):
    """What a row is to reach."""

    value: float
    at_least: bool = False  # else at most

    def is_met(self, value: float) -> bool:
        """Whether a value reaches it; what was not measured does not miss it."""
        if np.isnan(value):
            return True
        return value >= self.value if self.at_least else value <= self.value

    def __str__(self) -> str:
        return f"{'≥' if self.at_least else '≤'} {self.value:g}"


class Row(NamedTuple):
    """A line of the table."""

    name: str
    value: float
    unit: str
    ratio: float = np.nan
    """How many times faster than the peer named in `against`; NaN: there is none."""
    against: str = ""
    floor: float = np.nan
    """What the machine could do at best, in the same unit; NaN: it is not known."""
    goal: Goal | None = None
    """What the value is to reach, in the same unit; None: it only informs."""


def least_time(work: Callable[[], object], repeats: int = 7) -> float:
    """Least processor time of several, after one that warms up [s]; waiting for other processes
    does not count.
    """
    return least_times([work], repeats)[0]


def least_times(works: Sequence[Callable[[], object]], repeats: int) -> list[float]:
    """Least processor time [s] of each of several that take turns, so that a machine that slows
    down slows all of them.
    """
    for work in works:
        work()
    times = [np.inf] * len(works)
    for _ in range(repeats):
        for i, work in enumerate(works):
            begin = time.process_time()
            work()
            times[i] = min(times[i], time.process_time() - begin)
    return times


class CommandTime(NamedTuple):
    """What a command took [s]."""

    processor_s: float  # of it and of its child processes, on all cores
    wall_s: float


def time_of_command(
    arguments: Sequence[str], environment: Mapping[str, str] | None = None
) -> CommandTime:
    """Time of a Python program with arguments, without its output; CalledProcessError: it fails.

    Python keeps bytecode, as it does unless its environment says otherwise.
    """
    call = [sys.executable, *arguments]
    begin = time.perf_counter()
    with subprocess.Popen(
        call,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", **(environment or {})},
    ) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, call)
    return CommandTime(usage.ru_utime + usage.ru_stime, time.perf_counter() - begin)


def least_time_of_command(arguments: Sequence[str], repeats: int) -> CommandTime:
    """The least of several of each, after one that compiles what is missing."""
    time_of_command(arguments)
    times = [time_of_command(arguments) for _ in range(repeats)]
    return CommandTime(*(min(values) for values in zip(*times, strict=True)))
