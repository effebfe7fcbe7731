"""The simulation loop with controllers and navigators in Python, against the compiled ones and
closed forms.
"""

from functools import partial
from typing import Any

import numpy as np
import pytest

from experiments.flight.library import load_scenario
from laisn.navigators import find
from laisn.swarm import SeparateNavigators
from sim.closed_loop import simulate_closed_loop
from sim.flight import navigate
from sim.scenario.settings import Scenario
from sim.simulation import RouteControl, simulate_motion
from sim.trajectory import StateHistory
from sim.vehicle.plant import Plant


def steered_by_estimate(*assignments: str) -> Scenario:
    """A follower that steers along a route by its estimates."""
    return load_scenario(
        "T6", ["duration_s=60", "followers.0.guidance_position=estimate", *assignments]
    )


class Recorder:
    """A controller in Python that records its calls and leaves control to another one."""

    def __init__(self, plant: Plant, routes: RouteControl) -> None:
        self.plant, self.routes, self.instants, self.poses = plant, routes, [], []  # type: ignore[var-annotated]

    def control(self, k: int, truth: StateHistory) -> None:
        self.instants.append(k)
        self.poses.append((truth.pose[k].copy(), self.plant.pose.copy()))
        self.routes.control(k, truth)


def test_a_controller_in_python_is_called_at_each_instant_and_flies_as_the_compiled_one() -> None:
    scenario = load_scenario("T5", ["duration_s=60", "ocean.current_speed_m_s=0.3"])
    recorders: list[Recorder] = []

    def make(plant: Plant, routes: RouteControl) -> Recorder:
        recorders.append(Recorder(plant, routes))
        return recorders[0]

    by_python, by_compiled = (
        simulate_motion(scenario, make_controller=make),
        simulate_motion(scenario),
    )
    for name in (
        "position",
        "quaternion",
        "velocity",
        "angular_velocity",
        "water_velocity",
        "effector_states",
    ):
        np.testing.assert_array_equal(getattr(by_python, name), getattr(by_compiled, name))
    assert recorders[0].instants == list(range(601))
    # it is given the state of the plant at that instant
    for recorded, true in recorders[0].poses:
        np.testing.assert_array_equal(recorded, true)


def test_a_command_from_python_holds_until_the_next_instant() -> None:
    """Thrust follows a constant command u as u (1 - exp(-t / lag)), and one that ends as exp(-t
    / lag).
    """
    lags: list[float] = []

    class Pulse:
        def __init__(self, plant: Plant, routes: RouteControl) -> None:
            self.command = routes.command
            lags.append(float(plant.effectors["lag"][1, 0]))

        def control(self, k: int, truth: StateHistory) -> None:
            self.command[1, 0] = 5.0 if k < 10 else 0.0

    trajectory = simulate_motion(load_scenario("T5", ["duration_s=3"]), make_controller=Pulse)
    time, start = trajectory.time, trajectory.effector_states[0, 1, 0]
    assert start == 0.0
    rise = 5.0 * -np.expm1(-time / lags[0])
    fall = rise[10] * np.exp(-(time - 1.0) / lags[0])
    np.testing.assert_allclose(
        trajectory.effector_states[:, 1, 0], np.where(time <= 1.0, rise, fall), rtol=0, atol=1e-9
    )
    assert not trajectory.effector_states[:, 0].any()


@pytest.mark.parametrize("variant", ["laisn-3-1", "tight"])
def test_navigators_in_python_steer_by_their_estimates(variant: str) -> None:
    """Estimates in flight are those of navigation after the mission; with LAISN the follower moves
    as with the compiled navigator.
    """
    scenario = steered_by_estimate(
        f"navigation.variant={variant}", "acoustics.loss_probability=0.2"
    )
    by_python, loop = simulate_closed_loop(
        scenario, partial(SeparateNavigators, find(scenario.navigation.variant).make)
    )
    (estimates,) = navigate(scenario, by_python).estimates
    np.testing.assert_array_equal(loop.state.concluded.state[0], estimates.state)
    if variant == "laisn-3-1":
        by_compiled, _ = simulate_closed_loop(scenario)
        np.testing.assert_allclose(by_python.position, by_compiled.position, rtol=0, atol=1e-9)


def test_a_navigator_that_fails_is_named_by_its_number_from_one() -> None:
    class Failing:
        gated = np.zeros(1, dtype=np.int64)

        def navigate(self, step: int, *_: Any) -> int:
            return 3 if step == 7 else 0

    with pytest.raises(
        ArithmeticError, match="the covariance of follower 3 is not positive definite"
    ):
        simulate_closed_loop(steered_by_estimate(), lambda *_: Failing())
