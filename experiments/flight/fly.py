"""Fly one scenario with the navigator of this project."""

from __future__ import annotations

import re
import resource
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from laisn.navigators import NavigatorFactory, SteppedNavigator, find
from laisn.plugins import require_factory
from laisn.spilled import release_mapped_memory
from sim.flight import FlightRecord, FlightUnderWay, Termination, navigation_settings
from sim.open_loop import OpenLoop
from sim.scenario.file import ScenarioError, assigned, validate
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Navigation, Scenario
from sim.sensing.observation import start_of
from sim.simulation import (
    PROGRESS_TICKS,
    ContactError,
    ControllerFactory,
    DivergedError,
    EndedError,
    GroundedError,
    LeftFieldError,
    Mission,
    OffRouteError,
    fly_mission,
    new_mission,
    simulate_motion,
    static_trajectory,
)
from sim.trajectory import Trajectory, history_of

if TYPE_CHECKING:
    from sim.closed_loop import ClosedLoopFlight
    from sim.log.writer import FlightLog


_KEY_OF_NAVIGATION = re.compile(r"(followers\.(\d+|\*)\.)?navigation\.")
"""Beginning of a key that a replay can change."""


class Stopwatch(dict[str, float]):
    """Seconds that each phase took, all times together: NAME_s by the wall clock, and
    NAME_processor_s of processors, by this process and its children that have ended.
    """

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        wall_s = time.perf_counter()
        processor_s = processor_time()
        try:
            yield
        finally:
            self.add(name, time.perf_counter() - wall_s, processor_time() - processor_s)

    def add(self, name: str, wall_s: float, processor_s: float) -> None:
        """Add times to those of a phase."""
        for key, seconds in ((f"{name}_s", wall_s), (f"{name}_processor_s", processor_s)):
            self[key] = self.get(key, 0.0) + seconds


def processor_time() -> float:
    """Processor time of this process and of its children that have ended [s]."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


OUTCOME_BY_ERROR: dict[type[EndedError], Termination] = {
    DivergedError: Termination.DIVERGED,
    GroundedError: Termination.GROUNDED,
    OffRouteError: Termination.OFF_ROUTE,
    LeftFieldError: Termination.LEFT_FIELD,
    ContactError: Termination.CONTACT,
}
"""How a mission ended, by its error."""


class MissionToFly:
    """A mission before its flight: how it is to move, and what its followers make of it.

    Followers that steer by their estimates navigate under way, and their flight is what was
    recorded. All others move by the truth alone; they sense and navigate behind their motion.

    Attributes:
        watch: seconds of simulation, navigation and logging until now.
    """

    def __init__(
        self, scenario: Scenario, make_controller: ControllerFactory | None = None
    ) -> None:
        """Set up a scenario's mission, perhaps with another controller; errors as of
        `simulate_motion`.
        """
        self._scenario = scenario
        self.watch = Stopwatch()
        self._log: FlightLog | None = None
        self._outcome = Termination.INTERRUPTED
        self._mission: Mission | None = None
        # what senses and navigates while vehicles move; of point motion `_move_kinematic` makes it
        self._under_way: OpenLoop | ClosedLoopFlight | None = None
        if make_controller is None and scenario.keys_needing_closed_loop():
            # control of formations takes long to load
            from sim.closed_loop import ClosedLoopFlight, closed_loop_mission

            self._mission = closed_loop_mission(scenario)
            self._under_way = ClosedLoopFlight(scenario, self._mission)
        elif scenario.motion == "physics":
            self._mission = new_mission(scenario, make_controller)
            self._under_way = OpenLoop(
                scenario,
                static_trajectory(self._mission.plant),
                self._mission.truth,
                self._mission.motion_since,
            )

    def simulate(
        self, progress: Callable[[float], None] | None = None, log: FlightLog | None = None
    ) -> tuple[Trajectory, Termination]:
        """Its motion and how it ended; if before its time, what was flown until then.

        What its followers measure and estimate meanwhile is written into the log.
        """
        self._log = log
        total = Stopwatch()
        try:
            with total.phase("simulate"):
                trajectory = self._move(progress)
            self._outcome = Termination.COMPLETED
        except EndedError as error:
            trajectory = error.trajectory
            self._outcome = OUTCOME_BY_ERROR[type(error)]
        finally:
            # navigation and log, which go on meanwhile, have their own times
            for name in ("navigate", "log"):
                meanwhile = (self.watch.get(f"{name}{end}", 0.0) for end in ("_s", "_processor_s"))
                total.add("simulate", *(-seconds for seconds in meanwhile))
            self.watch |= total
        return trajectory, self._outcome

    def _move(self, progress: Callable[[float], None] | None) -> Trajectory:
        mission = self._mission
        if mission is None:
            return self._move_kinematic()
        mission.observers.append(lambda _: self._follow(mission.instants - 1))
        return fly_mission(MotionSettings.of(self._scenario), mission, progress)

    def _move_kinematic(self) -> Trajectory:
        """Point motion without physics, which is computed as a whole; followers then sense and
        navigate behind it in parts, so that log and memory are as of other motions.
        """
        ended: EndedError | None = None
        try:
            trajectory = simulate_motion(self._scenario)
        except EndedError as error:
            ended = error
            trajectory = error.trajectory
        last = trajectory.time.size - 1
        instants = [*range(PROGRESS_TICKS, last, PROGRESS_TICKS), last]
        until = instants[0]
        self._under_way = OpenLoop(
            self._scenario,
            trajectory.part(0, 1),
            history_of(trajectory),
            lambda first: trajectory.part(first, until),
        )
        for until in instants:
            self._follow(until)
        if ended is not None:
            raise ended
        return trajectory

    def _follow(self, last: int) -> None:
        """Sense, navigate and log until an instant of the motion."""
        if isinstance(self._under_way, OpenLoop):
            with self.watch.phase("navigate"):
                self._under_way.advance(last)
        if self._log is not None and self._under_way is not None:
            with self.watch.phase("log"):
                self._log.update(self._under_way)
        release_mapped_memory()

    def flight(self, trajectory: Trajectory, outcome: Termination) -> FlightRecord:
        """The flight of a motion and an outcome of `simulate`."""
        assert self._under_way is not None
        with self.watch.phase("navigate"):
            return self._under_way.flight(trajectory, outcome)

    def rest_of(self, flight: FlightRecord) -> FlightRecord | FlightUnderWay:
        """What `FlightLog.finish` takes after `flight`: what flew under way, most of which is in
        the log already, or, where nothing did, the flight.
        """
        if self._under_way is not None and self._under_way.navigates:
            return self._under_way
        return flight

    def end_log(self, log: FlightLog) -> None:
        """Write what was flown until now, unless the log has its end already or nothing was
        estimated.
        """
        flight = self._under_way
        if log.ended or flight is None or not flight.navigates:
            return
        if (
            isinstance(flight, OpenLoop)
            and self._mission is not None
            and self._mission.instants > 1
        ):
            flight.advance(self._mission.instants - 1)
        if flight.steps > 0:
            log.finish(flight, self._outcome)


def fly(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> tuple[FlightRecord, dict[str, float]]:
    """Fly a scenario, perhaps with another controller; the flight, and the seconds of simulation
    and navigation.
    """
    mission = MissionToFly(scenario, make_controller)
    trajectory, outcome = mission.simulate(progress)
    flight = mission.flight(trajectory, outcome)
    return flight, mission.watch


def _require_measured(flight: FlightRecord, navigations: Sequence[Navigation]) -> None:
    """ScenarioError if followers that navigate otherwise than in a flight, in their order, would
    take messages or ranges that they have not measured in it.
    """
    for i, navigation in enumerate(navigations):
        name = flight.scenario.followers[i].name
        flown = flight.scenario.navigation_of(i)
        if navigation.link != flown.link:
            raise ScenarioError(
                f"navigation.link = {navigation.link!r}: {name} has navigated on {flown.link!r}, "
                "and what was measured is fixed; fly it anew"
            )
        # of the links that it was to take in the flight it need not have heard all
        measured = {*flight.measurements[i].links, *flown.further_links}
        unheard = [link for link in navigation.further_links if link not in measured]
        if unheard:
            raise ScenarioError(
                f"navigation.further_links: the flight has no messages of {unheard[0]!r} to "
                f"{name}; fly it anew"
            )
        if navigation.sound_speed != flown.sound_speed:
            raise ScenarioError(
                f"navigation.sound_speed = {navigation.sound_speed!r}: {name} has measured ranges "
                f"by {flown.sound_speed!r}, and what was measured is fixed; fly it anew"
            )


def _navigated_with(flight: FlightRecord, changes: Mapping[str, Any]) -> Scenario:
    """The scenario of a flight with changes of its navigation; arguments and errors as of
    `navigate_again`.
    """
    scenario = flight.scenario
    outside = [key for key in changes if not _KEY_OF_NAVIGATION.match(key)]
    if outside:
        raise ScenarioError(
            f"{outside[0]}: a replay can change navigation only; what was measured is fixed"
        )
    of_all = {key: value for key, value in changes.items() if key.startswith("navigation.")}
    table = assigned(scenario.model_dump(mode="json", exclude_none=True), of_all)
    for i, follower in enumerate(scenario.followers):
        if follower.navigation is not None:
            own = {f"followers.{i}.{key}": value for key, value in of_all.items()}
            table = assigned(table, own)
    table = assigned(table, {key: changes[key] for key in changes if key not in of_all})
    changes_text = [f"{key} = {value}" for key, value in changes.items()]
    return validate(table, ", ".join([scenario.name, *changes_text]))


def navigate_again(
    flight: FlightRecord,
    changes: Mapping[str, Any] | None = None,
    navigator: NavigatorFactory | None = None,
) -> FlightRecord:
    """Navigate once more on the very measurements of a flight; how it moved and what was measured
    stay as they were.

    `changes` are of its navigation by dotted key: {"navigation.variant": "laisn-3-2"}, of all
    followers, or of one: {"followers.0.navigation.variant": "tight"}. `navigator`
    makes that of a follower from its settings and its start [x, y, vx, vy]: whatever has
    `run(measurements) -> Estimates`, or `step`. ScenarioError if changes are invalid, touch more
    than navigation, or need what was not measured.
    """
    if navigator is not None:
        require_factory("navigator", navigator)
    changes = {} if changes is None else changes
    if not isinstance(changes, Mapping):
        raise ScenarioError(
            f"changes: expected a table of values by dotted key (given: {changes!r:.80})"
        )
    scenario = _navigated_with(flight, changes)
    followers = range(len(scenario.followers))
    _require_measured(flight, [scenario.navigation_of(i) for i in followers])
    estimates = []
    for i, measurements in enumerate(flight.measurements):
        navigation = scenario.navigation_of(i)
        make = navigator or find(navigation.variant).make
        settings = navigation_settings(scenario, flight.trajectory.sites, i)
        instance = make(settings, start_of(flight.trajectory, i))
        if not hasattr(instance, "run"):
            instance = SteppedNavigator(instance, settings)
        estimates.append(instance.run(measurements.with_links(navigation.further_links)))
    return replace(flight, scenario=scenario, estimates=tuple(estimates))
