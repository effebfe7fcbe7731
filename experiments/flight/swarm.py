"""Followers that steer by the navigators of this project: sensing, navigation, steering and physics in one tick."""

from typing import Any

import numpy as np

from laisn import lane_swarm
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.failure import LaisnError
from laisn.navigating import AnySettings
from laisn.tight import swarm as tight_swarm
from laisn.tight.settings import TightSettings
from sim.closed_loop import ClosedLoopState, guide, init_closed_loop, sense
from sim.fleet import Steering, record_state, standing
from sim.flight import navigation_settings
from sim.motion import simulate_motion
from sim.scenario.settings import Scenario
from sim.sensing.observation import start_of
from sim.trajectory import Trajectory
from sim.vehicle.plant import Plant
from sim.vehicle.stepping import FINE, Fault, advance
from sim.water.ocean import Water

NAVIGATOR_FAILED = -2
"""Fault of a navigator, whose follower is named with it."""

# Compiled code that is handed functions cannot be kept from one process to the next: each kind of navigator has its
# own tick.


@compiled
def _control_tight(k: int, record: Floats, navigators: Any, a: ClosedLoopState) -> int:
    failed = -1
    if sense(k, record, a):
        heard = a.inbox
        failed = tight_swarm.navigate(navigators, a.readings, a.arrived, heard.message, heard.ranges, a.estimates)
    guide(k, record[k], a)
    return failed


@compiled
def _simulate_tight(
    span: tuple[int, int, int],
    handles: Any,
    state: Any,
    water: Water,
    record: Floats,
    navigators: Any,
    a: ClosedLoopState,
) -> tuple[int, Fault]:
    for k in range(span[0], span[1]):
        failed = _control_tight(k, record, navigators, a)
        if failed >= 0:
            return k, (NAVIGATOR_FAILED, failed)
        fault = advance(handles, a.steering[3], span[2])
        if fault[0] != FINE:
            return k, fault
        record_state(k + 1, state, water, record)
    return span[1], (FINE, -1)


@compiled
def _control_lanes(k: int, record: Floats, navigators: Any, a: ClosedLoopState) -> int:
    if sense(k, record, a):
        step, heard = k // a.senses.stride, a.inbox
        lane_swarm.navigate(navigators, step, a.readings, a.arrived, heard.message, heard.ranges, a.estimates)
    guide(k, record[k], a)
    return -1


@compiled
def _simulate_lanes(
    span: tuple[int, int, int],
    handles: Any,
    state: Any,
    water: Water,
    record: Floats,
    navigators: Any,
    a: ClosedLoopState,
) -> tuple[int, Fault]:
    for k in range(span[0], span[1]):
        _control_lanes(k, record, navigators, a)
        fault = advance(handles, a.steering[3], span[2])
        if fault[0] != FINE:
            return k, fault
        record_state(k + 1, state, water, record)
    return span[1], (FINE, -1)


class Swarm:
    """The controller of a fleet whose followers navigate under way."""

    def __init__(self, settings: AnySettings, state: ClosedLoopState, starts: Floats) -> None:
        """Set up navigators.

        Args:
            settings: of all navigators.
            state: at the start.
            starts: known start of each follower's hydrophone, rows of x, y [m], vx, vy [m/s], shape (f, 4).
        """
        self.state = state
        self._navigators: Any
        if isinstance(settings, TightSettings):
            self._navigators = tight_swarm.new_navigators(settings, starts)
            self._control, self._fly = _control_tight, _simulate_tight
        else:
            self._navigators = lane_swarm.new_navigators(settings, starts)
            self._control, self._fly = _control_lanes, _simulate_lanes
        known = not isinstance(settings, TightSettings) or settings.known_start
        state.estimates[:, :2] = starts[:, :2] if known else np.nan

    def _check(self, failed: int) -> None:
        if failed >= 0:
            raise ArithmeticError(f"the covariance of follower {failed + 1} is not positive definite any more")

    @property
    def gated(self) -> Ints:
        """How many fixes of each follower its navigator has rejected so far, shape (f,)."""
        return np.array(self._navigators[-1])

    def control(self, k: int, record: Floats) -> None:
        """Find the commands that hold from the recorded instant k until k + 1."""
        self._check(self._control(k, record, self._navigators, self.state))

    def fly(self, span: tuple[int, int, int], handles: Any, state: Any, water: Water, record: Floats) -> Any:
        """Control, advance and record from one instant to another."""
        k, fault = self._fly(span, handles, state, water, record, self._navigators, self.state)
        if fault[0] == NAVIGATOR_FAILED:
            self._check(fault[1])
        return k, fault

    def end(self, k: int, record: Floats) -> None:
        """Handle the last instant: what navigators conclude there."""
        self.control(k, record)


def swarm_of(scenario: Scenario, plant: Plant, steering: Steering) -> Swarm:
    """The controller of a scenario whose followers navigate under way, at its start.

    Args:
        scenario: mission.
        plant: at its start.
        steering: arrays of the routes.

    Raises:
        LaisnError: the followers' hydrophones are not equally high above their pressure sensors.
    """
    still, numbers = standing(plant), range(len(scenario.followers))
    settings = [navigation_settings(scenario, still, i) for i in numbers]
    if any(one != settings[0] for one in settings):
        raise LaisnError(
            f"scenario {scenario.name!r}: followers that navigate under way need hydrophones of one height above their "
            "depth sensors"
        )
    starts = np.array([start_of(still, i) for i in numbers])
    return Swarm(settings[0], init_closed_loop(scenario, plant, steering), starts)


def simulate_swarm(scenario: Scenario) -> tuple[Trajectory, Floats, Ints]:
    """Fly a scenario while its followers navigate, for studies that need no more than its motion and their beliefs.

    Whoever steers by the truth navigates all the same.

    Returns:
        The motion; what every navigator concluded at each instant, columns of `laisn.tight.swarm`, shape
        (n + 1, f, COLUMNS); and how many fixes it gated, shape (f,).

    Raises:
        LaisnError: a route cannot be flown, or the sea is impossible.
        DivergedError: the simulation left finite numbers.
    """
    controllers: list[Swarm] = []

    def make_controller(scenario: Scenario, plant: Plant, steering: Steering) -> Swarm:
        controllers.append(swarm_of(scenario, plant, steering))
        return controllers[0]

    trajectory = simulate_motion(scenario, make_controller=make_controller)
    return trajectory, controllers[0].state.history, controllers[0].gated
