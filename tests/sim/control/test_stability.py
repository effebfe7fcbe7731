"""Gains of the linear laws whose stability is examined."""

import numpy as np
import pytest

from laisn.arrays import Floats
from sim.control.allocation import HEAVE, PITCH, YAW
from sim.control.autopilot import design, top_speed
from sim.control.stability import (
    HEIGHT,
    _controlled_hull,
    _ControlledHull,
    _feedback,
    _state_matrices,
    _straight_ahead,
    require_stable,
)
from sim.hull import calm_plant, hull_of
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

SCENARIO = Scenario(name="s", followers=({"name": "f", "route": "T5", "depth_m": 12.0},))


@pytest.mark.parametrize(
    ("axis", "angle", "inertia"),
    [
        (HEAVE, HEIGHT, "heave_mass"),
        (PITCH, PITCH + 3, "pitch_inertia"),
        (YAW, YAW + 3, "yaw_inertia"),
    ],
)
def test_at_rest_each_loop_is_critically_damped(axis: int, angle: int, inertia: str) -> None:
    """An error fades with the characteristic polynomial s² + c s + k = (s + c / 2)²: c² = 4 k."""
    motion = MotionSettings.of(SCENARIO)
    _, autopilots = calm_plant(hull_of(motion, SCENARIO.leader))
    autopilot = autopilots[0]
    climb = np.zeros((1, 10))
    climb[:, HEAVE] = 1.0
    [feedback] = _feedback(autopilot, climb, np.zeros(1))
    mass = float(autopilot[inertia])
    damping = -feedback[axis, axis] / mass
    stiffness = -feedback[axis, angle] / mass
    assert damping > 0.0
    assert damping**2 == pytest.approx(4.0 * stiffness)


SPEEDS = np.array([0.0, 0.4, 1.0, 2.5])


def _hull_of_leader() -> _ControlledHull:
    plant, autopilots = calm_plant(hull_of(MotionSettings.of(SCENARIO), SCENARIO.leader))
    return _controlled_hull(plant, 0, autopilots[0])


def test_state_matrices_of_many_speeds_are_those_of_each() -> None:
    hull = _hull_of_leader()
    turning = np.array([[1.3, 0.3, 0.3, 0.2, 0.2, 0.2, 0.0, 0.0, 0.0]])
    equilibria = np.vstack([turning, _straight_ahead(SPEEDS)])
    together = _state_matrices(hull, equilibria)
    one_by_one = [_state_matrices(hull, equilibrium[None])[0] for equilibrium in equilibria]
    assert together.shape == (5, 16, 16)
    np.testing.assert_allclose(together, one_by_one, rtol=1e-12, atol=1e-12)


def test_a_state_matrix_has_kinematics_and_surge_drag_of_each_speed() -> None:
    """Drag X = (L exp(−F |u|) + Q |u|) u and rigid and added mass m: ∂u̇/∂u = −X' / m; a pitch θ,
    nose down, at a speed u gives a rate of climb w − u θ.
    """
    hull = _hull_of_leader()
    d = hull.d
    matrices = _state_matrices(hull, _straight_ahead(SPEEDS))
    u = SPEEDS
    fading = np.exp(-d["drag_fade"] * u)
    slope = d["drag_linear"] * fading * (1.0 - d["drag_fade"] * u) + 2.0 * d["drag"] * u
    # at rest |u| u has a derivative of 0, and its difference one of the step
    assert matrices[:, 0, 0] == pytest.approx(-slope / d["surge_mass"], rel=1e-3, abs=1e-3)
    climb = np.zeros((4, 16))
    climb[:, HEAVE] = 1.0
    climb[:, PITCH + 3] = -SPEEDS
    np.testing.assert_array_equal(matrices[:, HEIGHT], climb)


def test_speeds_are_looked_at_up_to_what_a_vehicle_reaches(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """That is its top speed, known or computed, and at most 1.3 times the largest of its route."""
    setup = VehicleSetup(name="hull", model="follower", position_m=(0.0, 0.0, -10.0))
    plant = Plant([setup], Ocean(), settled=False)
    autopilots = design(plant, (None,))
    looked_at = []

    def straight_ahead(speeds: Floats) -> Floats:
        looked_at.append((speeds.min(), speeds.max()))
        return _straight_ahead(speeds)

    monkeypatch.setattr("sim.control.stability._straight_ahead", straight_ahead)
    for max_speed, top_speeds in ((9.0, None), (9.0, [0.9]), (0.6, [0.9])):
        require_stable(plant, autopilots, max_speed, min_speed=0.4, top_speeds=top_speeds)
    assert looked_at == [(0.4, top_speed(autopilots[0])), (0.4, 0.9), (0.4, 1.3 * 0.6)]
