"""Followers that steer by their own estimates: they sense and navigate while the mission is flown.

What such a follower measures depends on where its estimates have led it. At every filter step its navigator gets what
`sim.sensing.observation` and `sim.sensing.sensor_errors` make of the truth so far, which is what they make of it once
the mission is over, for noise is addressed by step. Navigating on the finished mission therefore gives the very
estimates that steered it.
"""

import numpy as np

from laisn import POSITION, VELOCITY
from laisn.arrays import Floats
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.navigating import AnyNavigator, NavigatorFactory
from sim.fleet import TrajectorySince
from sim.flight import navigation_settings
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.sensing.hearing import Hearing
from sim.sensing.observation import SITES, errors_of, observe, own_motion, start_of
from sim.sensing.sensor_errors import measure, sense_own
from sim.sensing.wandering import wander

_PATIENCE_S = 10.0
"""A message that is not in after this time never will be: one that came in the same step was kept instead."""


class Pilot:
    """One follower's senses, its navigator, and where it takes itself to be."""

    def __init__(self, scenario: Scenario, follower: int, navigator: NavigatorFactory) -> None:
        self._scenario, self._vehicles, self._make = scenario, (0, follower + 1), navigator
        self._errors, self._hearing = errors_of(scenario), Hearing.of(scenario)
        self._seed, self._run, self._follower = scenario.seed, scenario.run, follower
        dt = scenario.timing.filter_step_s
        self._stride, self._patience = round(dt / CONTROL_STEP_S), round(_PATIENCE_S / dt)
        self._remembering = (
            self._errors.channel.loses
            or self._errors.leader_attitude_time > 0.0
            or scenario.sensors.leader_attitude_feels_acceleration
        )
        self._awaited: list[int] = []
        self._navigator: AnyNavigator | None = None

    def believe(self, tick: int, flown: TrajectorySince) -> Floats:
        """Position at an instant of the trajectory's grid, shape (2,), [m]; NaN before the first filter step.

        Args:
            tick: number of the instant; instants must come one by one.
            flown: the mission until then.
        """
        k, beyond = divmod(tick, self._stride)
        if k > 0 and beyond == 0:
            self._step(k, flown)
        if self._navigator is None:
            return np.full(2, np.nan)
        # between filter steps it dead-reckons
        state = self._navigator.state
        return np.asarray(state[POSITION] + beyond * CONTROL_STEP_S * state[VELOCITY])

    def _step(self, k: int, flown: TrajectorySince) -> None:
        """Sense and navigate at filter step k, which is now."""
        true = own_motion(flown(k * self._stride - 1), self._follower)[-1:]
        wander(self._hearing.wandering, self._follower, np.array([k * self._hearing.filter_step_s]), true)
        (own,) = sense_own(
            true, np.array([k]), self._errors, seed=self._seed, run=self._run, follower=self._follower
        ).tolist()
        if k % self._scenario.message_every == 0:
            self._awaited.append(k)
        self._awaited = [sent for sent in self._awaited if k - sent <= self._patience]
        reception = self._listen(k, flown) if self._awaited else None
        if self._navigator is None:
            start = flown(0)
            settings = navigation_settings(self._scenario, start, self._follower)
            self._navigator = self._make(settings, start_of(start, self._follower))
        self._navigator.step(OwnMotion(*own), reception)

    def _listen(self, k: int, flown: TrajectorySince) -> Reception | None:
        """The message that is in at filter step k, if there is one."""
        # errors with a history take the whole of it
        since = 0 if self._remembering else self._awaited[0] - 1
        truth = observe(flown(since * self._stride).only(self._vehicles, SITES), self._hearing)
        if not truth.message_step.size or truth.message_step[-1] != k:
            return None
        self._awaited = [sent for sent in self._awaited if sent > truth.emission_step[-1]]
        heard = measure(
            truth,
            self._errors,
            seed=self._seed,
            run=self._run,
            follower=self._follower,
            transmitters=self._scenario.navigation.transmitters,
        )
        return Reception(LeaderMessage(*heard.message[-1].tolist()), Ranges(*heard.ranges[-1].tolist()))


class Feedback:
    """Positions that a fleet's vehicles believe to be their own; those that steer by the truth give none."""

    def __init__(self, scenario: Scenario, navigator: NavigatorFactory) -> None:
        """Set up a pilot for each follower with `steers_by = "estimate"`."""
        steering = [i for i, follower in enumerate(scenario.followers) if follower.believes]
        self._pilots = {i + 1: Pilot(scenario, i, navigator) for i in steering}
        self._shape = len(scenario.followers) + 1, 2

    def __call__(self, tick: int, flown: TrajectorySince) -> Floats:
        """Believed positions of all vehicles, shape (v, 2), [m]; NaN where the truth is to be used."""
        belief = np.full(self._shape, np.nan)
        for vehicle, pilot in self._pilots.items():
            belief[vehicle] = pilot.believe(tick, flown)
        return belief
