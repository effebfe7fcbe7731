"""Followers that move by the truth alone: they sense and navigate behind their motion, stretch
after stretch.
"""

from collections.abc import Callable
from typing import Any

from laisn.estimates import Estimates, FixTable
from laisn.messages import Measurements
from laisn.navigators import find
from laisn.swarm import SwarmRecord
from sim.flight import FlightRecord, Termination, navigate, navigation_settings
from sim.scenario.parts import sensing_of_each
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.measurement_record import MeasurementRecord
from sim.sensing.observation import start_of
from sim.sensing.under_way import FollowerSensing, SenderMotion
from sim.system import signals_after
from sim.trajectory import StateHistory, Trajectory


class OpenLoop:
    """A flight under way whose followers do not steer by what they measure.

    What is measured and estimated is what `sim.flight.navigate` gives of the finished mission, to
    the bit. A navigator that works on whole missions, such as a smoother, runs at the end.
    """

    def __init__(
        self,
        scenario: Scenario,
        at_start: Trajectory,
        truth: StateHistory,
        motion: Callable[[int], Trajectory],
    ) -> None:
        """Before the first instant.

        `at_start` holds names and sites of the vehicles where they start. `truth` has room for the
        motion of the whole mission, which the simulation fills in. `motion` gives the part of it
        from an instant, by its index, until now.
        """
        self.scenario = scenario
        self._truth = truth
        self._motion = motion
        # instants of the motion from one filter step to the next
        self._stride = round(scenario.timing.filter_step_s / CONTROL_STEP_S)
        sensing_of = sensing_of_each(scenario)
        followers = range(len(scenario.followers))
        navigations = [scenario.navigation_of(i) for i in followers]
        link_names = [sensing.links.main for sensing in sensing_of]
        # of each link that somebody navigates on, by its name
        self._senders = {
            sensing.links.main: SenderMotion(sensing, at_start, truth) for sensing in sensing_of
        }
        self._sender_of = [self._senders[name] for name in link_names]
        settings = [navigation_settings(scenario, at_start.sites, i) for i in followers]
        links = [sender.link for sender in self._senders.values()]
        broadcast_every = sensing_of[0].links.message_every
        # filter steps from one message to the next, of the link that has most messages
        message_every = min(broadcast_every if link is None else link.every for link in links)
        n = len(truth.pose)
        steps = (n - 1) // self._stride
        self._measured = MeasurementRecord.empty(len(followers), steps, message_every)
        self._sensing = [
            FollowerSensing(
                sensing_of[i], i, self._sender_of[i], settings[i].transmitters, self._measured
            )
            for i in followers
        ]
        self._navigators = [
            find(navigations[i].variant).make(settings[i], start_of(at_start, i)) for i in followers
        ]
        # messages of further links are sensed of the finished mission
        self._has_further_links = any(navigation.further_links for navigation in navigations)
        self.navigates = not self._has_further_links and all(
            getattr(navigator, "runs_by_steps", False) for navigator in self._navigators
        )
        """Whether estimates are there as soon as the steps are over; else at the end."""
        self._estimated = SwarmRecord.empty(
            len(followers), steps if self.navigates else 0, 0, Estimates, whole=True
        )
        self._estimate_classes = [
            getattr(navigator, "ESTIMATES", Estimates) for navigator in self._navigators
        ]
        self._fixes = [FixTable(estimates) for estimates in self._estimate_classes]
        self._failed = False
        self.steps = 0
        """Filter steps that are over."""

    def advance(self, last: int) -> None:
        """Sense and navigate until an instant of the motion, by its index; the motion is there
        until then.

        Signals wait until that is done. After an error nothing more is sensed.
        """
        if self._failed:
            return
        self._failed = True
        with signals_after():
            self._advance(last)
            self._failed = False

    def _advance(self, last: int) -> None:
        for sender in self._senders.values():
            sender.advance(self._truth, last)
        span = range(self.steps, last // self._stride)
        if not span:
            return
        for follower, sensing in enumerate(self._sensing):
            if not self._has_further_links:
                sensing.advance(last)
            if self.navigates:
                self._navigate(follower, span)
        self.steps = span.stop

    def _measurements(self, follower: int, steps: range) -> Measurements:
        """What a follower has measured in filter steps `steps.start` + 1 … `steps.stop`."""
        sensing = self._sensing[follower]
        link = self._sender_of[follower].link
        custom = {name: rows[steps.start : steps.stop] for name, rows in sensing.custom.items()}
        return self._measured.measurements(
            follower,
            steps,
            self.scenario.timing.filter_step_s,
            custom,
            sensing.headers,
            None if link is None else link.places,
        )

    def _navigate(self, follower: int, span: range) -> None:
        """Estimate in filter steps `span.start` + 1 … `span.stop`, by what is measured in them."""
        navigator: Any = self._navigators[follower]
        state = self._estimated.state[follower]
        covariance = self._estimated.covariance[follower]
        measurements = self._measurements(follower, span)
        for k, (own_motion, reception) in zip(span, measurements.steps(), strict=True):
            self._fixes[follower].extend(navigator.step(own_motion, reception))
            state[k] = navigator.state
            covariance[k] = navigator.covariance

    def _estimates(self, follower: int, steps: range) -> Estimates:
        fixes = self._fixes[follower].rows
        return self._estimated.estimates_with(
            fixes, follower, steps, self._estimate_classes[follower]
        )

    def part(self, first: int) -> FlightRecord:
        """The flight from a filter step on until now, with the fixes that hold there."""
        trajectory = self._motion(first * self._stride)
        steps = range(first, first + (trajectory.time.size - 1) // self._stride)
        followers = range(len(self._navigators))
        return FlightRecord(
            scenario=self.scenario,
            trajectory=trajectory,
            measurements=tuple(self._measurements(i, steps) for i in followers),
            estimates=tuple(self._estimates(i, steps) for i in followers),
            outcome=Termination.INTERRUPTED,
        )

    def flight(self, trajectory: Trajectory, outcome: Termination) -> FlightRecord:
        """The flight at its end; nothing is sensed or navigated later.

        ValueError if it was too short for one filter step.
        """
        if self._has_further_links:
            return navigate(self.scenario, trajectory, outcome=outcome)
        if self.steps < 1:
            end = trajectory.time[-1]
            dt = self.scenario.timing.filter_step_s
            raise ValueError(
                f"the flight ends at {end:g} s, before its first filter step of {dt:g} s"
            )
        steps = range(self.steps)
        for sensing in self._sensing:
            sensing.close()
        for array in (self._estimated.state, self._estimated.covariance):
            # so that estimates need not copy them
            array.flags.writeable = False
        measurements = []
        estimates = []
        for i, navigator in enumerate(self._navigators):
            follower_measurements = self._measurements(i, steps)
            measurements.append(follower_measurements)
            estimates.append(
                self._estimates(i, steps)
                if self.navigates
                else navigator.run(follower_measurements)
            )
        return FlightRecord(
            scenario=self.scenario,
            trajectory=trajectory,
            measurements=tuple(measurements),
            estimates=tuple(estimates),
            outcome=outcome,
        )
