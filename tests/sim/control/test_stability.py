"""Gains of the linear laws whose stability is examined."""

import numpy as np
import pytest

from sim.control.allocation import HEAVE, PITCH, YAW
from sim.control.stability import HEIGHT, _feedback
from sim.hull import calm_plant, hull_of
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario

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
    design = autopilots[0]
    climb = np.zeros((1, 10))
    climb[:, HEAVE] = 1.0
    [feedback] = _feedback(design, climb, np.zeros(1))
    mass = float(design[inertia])
    damping = -feedback[axis, axis] / mass
    stiffness = -feedback[axis, angle] / mass
    assert damping > 0.0
    assert damping**2 == pytest.approx(4.0 * stiffness)
