"""Hulls that differ from their models: each scale acts on its own force, unknown to the
autopilot.
"""

import numpy as np
import pytest

import laisn_sim
from experiments.campaign import montecarlo
from experiments.flight.library import load_scenario
from laisn.errors import LaisnError
from sim.control.autopilot import design
from sim.control.stability import require_stable
from sim.scenario.point_motion import SPEED_MAX
from sim.scenario.settings import FASTEST_CURRENT_M_S
from sim.scenario.vehicles import Vehicle
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean


def plant(speed=0.0, **scales):
    settings = Vehicle.model_construct(**scales)
    setup = VehicleSetup(
        name="v", model="follower", position_m=(0, 0, -10), speed_m_s=speed, settings=settings
    )
    return Plant([setup], Ocean())


def surge_force(speed, **scales):
    """Surge force [N] on a hull that coasts north at a speed, minus its drag: acceleration times
    mass and added mass.
    """
    hull = plant(speed, **scales)
    speed_before = hull.twist[0, 1]
    hull.step(np.zeros((1, 5)))
    return (hull.twist[0, 1] - speed_before) / hull.dt * _surge_mass(hull)


def _surge_mass(hull):
    return float(design(hull, ("pitch",))[0]["surge_mass"])


def test_drag_scale_multiplies_the_drag():
    assert surge_force(1.5, drag_scale=1.3) / surge_force(1.5) == pytest.approx(1.3, rel=5e-3)


def test_scales_of_lift_and_thrust_leave_the_drag_of_straight_motion():
    assert surge_force(1.5, lift_scale=2.0) == pytest.approx(surge_force(1.5), rel=1e-9)
    assert surge_force(1.5, thrust_scale=2.0) == pytest.approx(surge_force(1.5), rel=1e-9)


def test_thrust_scale_multiplies_the_acceleration_from_rest():
    """A hull at rest takes up a = scale T / (m + added mass), as long as drag is small."""
    speeds = []
    for scale in (1.0, 0.7):
        hull = plant(thrust_scale=scale)
        hull.step(np.array([[5.0, 0, 0, 0, 0]]), 5)
        speeds.append(hull.twist[0, 1])
    assert speeds[1] / speeds[0] == pytest.approx(0.7, rel=1e-3)


def test_added_mass_scale_lessens_the_heave_from_rest():
    """Heave is mostly added mass: from rest, a = T / (m + scale m_A)."""
    accelerations, hull_masses = [], []
    for scale in (1.0, 1.5):
        hull = plant(added_mass_scale=scale)
        hull.step(np.array([[0, 0, 0, 1.0, 1.0]]), 3)
        accelerations.append(hull.twist[0, 2])
        hull_masses.append(float(hull.model.body("v/hull").mass[0]))
    heave_mass = float(design(plant(), ("pitch",))[0]["heave_mass"])
    expected = heave_mass / (heave_mass + 0.5 * (heave_mass - hull_masses[0]))
    assert accelerations[1] / accelerations[0] == pytest.approx(expected, rel=5e-3)


def test_autopilots_are_designed_for_the_unscaled_model():
    assert design(
        plant(drag_scale=2.0, lift_scale=0.5, added_mass_scale=1.5), ("pitch",)
    ) == design(plant(), ("pitch",))


def test_an_autopilot_holds_its_speed_with_unknown_drag():
    scenario = load_scenario("T5", ["duration_s=120", "leader.drag_scale=1.4"])
    with_drag_scaled, unscaled = (
        montecarlo.simulate_mission(s) for s in (scenario, load_scenario("T5", ["duration_s=120"]))
    )
    speeds = [
        np.hypot(*trajectory.velocity[-300:, 0, :2].T).mean()
        for trajectory in (with_drag_scaled, unscaled)
    ]
    assert speeds[0] == pytest.approx(speeds[1], abs=0.01)
    thrusts = [
        trajectory.effector_states[-300:, 0, 0].mean()
        for trajectory in (with_drag_scaled, unscaled)
    ]
    assert thrusts[0] / thrusts[1] == pytest.approx(1.4, rel=0.03)


LARGE_LIFT = {
    "followers.0.lift_scale": 7.2,
    "followers.0.cg_offset_z_m": -0.077,
    "duration_s": 20.0,
}
"""Lift and righting moment so large that the motion is quick."""


@pytest.mark.parametrize(("speed", "towards_deg"), [(1.14, 0.0), (0.6, 270.0)])
def test_a_hull_that_its_scales_make_too_fast_for_the_steps_is_refused(speed, towards_deg):
    """Without the check this motion leaves finite numbers within 8 s."""
    current = {"ocean.current_speed_m_s": speed, "ocean.current_direction_deg": towards_deg}
    with pytest.raises(
        LaisnError, match=r"followers\[0\]: its motion changes within .* too fast for physics steps"
    ) as caught:
        laisn_sim.load("T3", LARGE_LIFT | current)
    # with the step that the error advises, the hull flies
    step = float(str(caught.value).split("timing.physics_step_s = ")[1].split()[0].rstrip(",;"))
    flight = laisn_sim.fly("T3", LARGE_LIFT | current | {"timing.physics_step_s": step})
    assert np.abs(np.degrees(flight.trajectory.pitch[:, 1])).max() < 10.0


def test_a_hull_with_scales_is_flown_where_it_is_stable():
    flight = laisn_sim.fly("T3", LARGE_LIFT)
    assert np.abs(np.degrees(flight.trajectory.pitch[:, 1])).max() < 1.0


@pytest.mark.parametrize("mode", ["pitch", "thrust"])
@pytest.mark.parametrize("name", ["leader", "follower"])
def test_the_projects_hulls_are_stable_at_all_speeds_of_scenarios(name, mode):
    hull = Plant([VehicleSetup(name=name, model=name, position_m=(0, 0, -10))], Ocean())
    require_stable(hull, design(hull, (mode,)), SPEED_MAX + FASTEST_CURRENT_M_S, orbital_speed=4.0)
