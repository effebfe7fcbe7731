"""Fly one scenario with the navigator of this project."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from laisn.navigators import NavigatorFactory, SteppedNavigator, find
from sim.flight import Flight, Termination, navigate, navigation_settings
from sim.scenario.file import ScenarioError, assigned, validate
from sim.scenario.settings import Scenario
from sim.sensing.observation import start_of
from sim.simulation import (
    ContactError,
    ControllerFactory,
    DivergedError,
    EndedError,
    GroundedError,
    LeftFieldError,
    Mission,
    OffRouteError,
    fly_mission,
    keys_needing_closed_loop,
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


OUTCOMES: dict[type[EndedError], Termination] = {
    DivergedError: Termination.DIVERGED,
    GroundedError: Termination.GROUNDED,
    OffRouteError: Termination.OFF_ROUTE,
    LeftFieldError: Termination.LEFT_FIELD,
    ContactError: Termination.CONTACT,
}
"""How a mission ended, by its error."""


class MissionToFly:
    """A mission before its flight: how it is to move, then what its followers made of it.

    Followers that steer by their estimates navigate under way, and their flight is what was
    recorded. All others move by the truth alone, so that they sense and navigate afterwards.
    """

    def __init__(
        self, scenario: Scenario, make_controller: ControllerFactory | None = None
    ) -> None:
        """Set up a scenario's mission, perhaps with another controller; errors as of
        `simulate_motion`.
        """
        self._scenario = scenario
        self._make_controller = make_controller
        self._mission: Mission | None = None
        if make_controller is None and keys_needing_closed_loop(scenario):
            # control of formations takes long to load
            from sim.closed_loop import closed_loop_mission

            self._mission = closed_loop_mission(scenario)

    def _move(self, progress: Callable[[float], None] | None) -> Trajectory:
        if self._mission is not None:
            return fly_mission(self._scenario, self._mission, progress)
        return simulate_motion(self._scenario, progress, self._make_controller)

    def simulate(
        self, progress: Callable[[float], None] | None = None
    ) -> tuple[Trajectory, Termination]:
        """Its motion and how it ended; if before its time, what was flown until then."""
        try:
            return self._move(progress), Termination.COMPLETED
        except EndedError as error:
            return error.trajectory, OUTCOMES[type(error)]

    def flight(self, trajectory: Trajectory, outcome: Termination) -> Flight:
        """The flight of a motion and an outcome of `simulate`."""
        if self._mission is None:
            return navigate(self._scenario, trajectory, outcome=outcome)
        from sim.closed_loop import flight_of

        return flight_of(self._scenario, self._mission, trajectory, outcome)


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
        mission = MissionToFly(scenario, make_controller)
        trajectory, outcome = mission.simulate(progress)
    with watch.phase("navigate_s"):
        flight = mission.flight(trajectory, outcome)
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
    `run(measurements) -> Estimates`, or `step`. ScenarioError if changes are invalid, or touch more
    than navigation.
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
    estimates = []
    for i, measured in enumerate(flight.measurements):
        settings = navigation_settings(scenario, flight.trajectory, i)
        made = make(settings, start_of(flight.trajectory, i))
        if not hasattr(made, "run"):
            made = SteppedNavigator(made, settings)
        estimates.append(made.run(measured.with_links(scenario.navigation.further_links)))
    return replace(flight, scenario=scenario, estimates=tuple(estimates))
