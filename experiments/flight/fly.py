"""Fly one scenario with the navigator of this project."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from laisn.navigators import NavigatorFactory, find
from sim.flight import Flight, Outcome, navigate, navigation_settings
from sim.scenario.file import ScenarioError, assigned, validate
from sim.scenario.settings import Scenario
from sim.sensing.observation import start_of
from sim.simulation import (
    ContactError,
    ControllerFactory,
    DivergedError,
    listeners,
    simulate_motion,
)
from sim.trajectory import Trajectory


class Stopwatch(dict[str, float]):
    """Seconds that each phase took."""

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self[name] = time.perf_counter() - start


def motion_and_outcome(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> tuple[Trajectory, Outcome]:
    """The motion of a scenario and how it ended; if before its time, what was flown until then."""
    if make_controller is None and listeners(scenario):
        # control of formations takes long to load
        from sim.closed_loop import closed_loop_of

        make_controller = partial(closed_loop_of, scenario)
    try:
        return simulate_motion(scenario, progress, make_controller), Outcome.COMPLETED
    except DivergedError as error:
        return error.trajectory, Outcome.DIVERGED
    except ContactError as error:
        return error.trajectory, Outcome.CONTACT


def fly(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> tuple[Flight, dict[str, float]]:
    """Fly a scenario, perhaps with another controller; the flight, and the seconds of simulation
    and navigation.
    """
    watch = Stopwatch()
    with watch.phase("simulate_s"):
        trajectory, outcome = motion_and_outcome(scenario, progress, make_controller)
    with watch.phase("navigate_s"):
        flight = navigate(scenario, trajectory, outcome=outcome)
    return flight, watch


def navigate_again(
    flight: Flight,
    changes: Mapping[str, Any] | None = None,
    navigator: NavigatorFactory | None = None,
) -> Flight:
    """Navigate once more on the very measurements of a flight; how it moved and what was measured
    stay as they were.

    `changes` are of its navigation by dotted key: {"navigation.variant": "laisn-3-2"}. `navigator`
    makes that of a follower from its settings and its start [x, y, vx, vy]: whatever has
    `run(measurements) -> Estimates`. ScenarioError if changes are invalid, or touch more than
    navigation.
    """
    changes = {} if changes is None else changes
    if not isinstance(changes, Mapping):
        raise ScenarioError(
            f"changes: expected a table of values by dotted key (given: {changes!r:.80})"
        )
    outside = [key for key in changes if not key.startswith("navigation.")]
    if outside:
        raise ScenarioError(
            f"{outside[0]}: a replay can change navigation only; what was measured is fixed"
        )
    table = assigned(flight.scenario.model_dump(mode="json", exclude_none=True), changes)
    scenario = validate(
        table, ", ".join([flight.scenario.name, *(f"{k} = {v}" for k, v in changes.items())])
    )
    make = navigator or find(scenario.navigation.variant).make
    estimates = tuple(
        make(
            navigation_settings(scenario, flight.trajectory, i), start_of(flight.trajectory, i)
        ).run(measured)
        for i, measured in enumerate(flight.measurements)
    )
    return replace(flight, scenario=scenario, estimates=estimates)
