"""Fly one scenario with the navigator of this project."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from laisn.navigator import Navigator
from sim.flight import Flight, Outcome, navigate
from sim.motion import DivergedError, simulate_motion
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory


@dataclass
class Stopwatch:
    """Seconds that each phase took."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = time.perf_counter() - start


def motion_and_outcome(
    scenario: Scenario, progress: Callable[[float], None] | None = None
) -> tuple[Trajectory, Outcome]:
    """The motion of a scenario; if it leaves finite numbers, what was flown before, and an outcome that says so."""
    try:
        return simulate_motion(scenario, progress, Navigator), Outcome.COMPLETED
    except DivergedError as error:
        return error.trajectory, Outcome.DIVERGED


def fly(scenario: Scenario, progress: Callable[[float], None] | None = None) -> tuple[Flight, dict[str, float]]:
    """Fly a scenario with the navigator of this project.

    Returns:
        The flight, and the seconds that simulation and navigation took.
    """
    watch = Stopwatch()
    with watch.phase("simulate_s"):
        trajectory, outcome = motion_and_outcome(scenario, progress)
    with watch.phase("navigate_s"):
        flight = navigate(scenario, trajectory, Navigator, outcome)
    return flight, watch.seconds
