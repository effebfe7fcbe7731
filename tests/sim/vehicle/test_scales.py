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


def force(speed, **scales):
    """Forward acceleration times inertia of a hull that coasts at a speed: its drag [N]."""
    one = plant(speed, **scales)
    before = one.twist[0, 1]
    one.step(np.zeros((1, 5)))
    return (one.twist[0, 1] - before) / one.dt * _surge_mass(one)


def _surge_mass(one):
    return float(design(one, ("pitch",))[0]["surge_mass"])


def test_drag_is_scaled():
    assert force(1.5, drag_scale=1.3) / force(1.5) == pytest.approx(1.3, rel=5e-3)


def test_lift_and_thrust_do_not_change_the_drag_of_a_straight_way():
    assert force(1.5, lift_scale=2.0) == pytest.approx(force(1.5), rel=1e-9)
    assert force(1.5, thrust_scale=2.0) == pytest.approx(force(1.5), rel=1e-9)


def test_thrust_is_scaled():
    """A hull at rest takes up a = scale T / (m + added mass), as long as it has no way."""
    ways = []
    for scale in (1.0, 0.7):
        one = plant(thrust_scale=scale)
        one.step(np.array([[5.0, 0, 0, 0, 0]]), 5)
        ways.append(one.twist[0, 1])
    assert ways[1] / ways[0] == pytest.approx(0.7, rel=1e-3)


def test_added_mass_is_scaled():
    """Heave is mostly added mass: from rest, a = T / (m + scale m_A)."""
    accelerations, masses = [], []
    for scale in (1.0, 1.5):
        one = plant(added_mass_scale=scale)
        one.step(np.array([[0, 0, 0, 1.0, 1.0]]), 3)
        accelerations.append(one.twist[0, 2])
        masses.append(float(one.model.body("v/hull").mass[0]))
    heave = float(design(plant(), ("pitch",))[0]["heave_mass"])
    expected = heave / (heave + 0.5 * (heave - masses[0]))
    assert accelerations[1] / accelerations[0] == pytest.approx(expected, rel=5e-3)


def test_autopilots_go_by_the_model():
    assert design(
        plant(drag_scale=2.0, lift_scale=0.5, added_mass_scale=1.5), ("pitch",)
    ) == design(plant(), ("pitch",))


def test_an_autopilot_holds_its_speed_with_unknown_drag():
    scenario = load_scenario("T5", ["duration_s=120", "leader.drag_scale=1.4"])
    more, usual = (
        montecarlo.simulate_mission(s) for s in (scenario, load_scenario("T5", ["duration_s=120"]))
    )
    speeds = [np.hypot(*t.velocity[-300:, 0, :2].T).mean() for t in (more, usual)]
    assert speeds[0] == pytest.approx(speeds[1], abs=0.01)
    thrusts = [t.effector_states[-300:, 0, 0].mean() for t in (more, usual)]
    assert thrusts[0] / thrusts[1] == pytest.approx(1.4, rel=0.03)


LIFT = {"followers.0.lift_scale": 7.2, "followers.0.cg_offset_z_m": -0.077, "duration_s": 20.0}


@pytest.mark.parametrize(("speed", "towards"), [(1.14, 0.0), (0.6, 270.0)])
def test_a_hull_that_its_scales_make_too_fast_for_the_steps_is_refused(speed, towards):
    """Without the check this motion leaves finite numbers within 8 s."""
    current = {"ocean.current_speed_m_s": speed, "ocean.current_direction_deg": towards}
    with pytest.raises(
        LaisnError, match=r"followers\[0\]: its motion changes within .* too fast for physics steps"
    ) as caught:
        laisn_sim.load("T3", LIFT | current)
    # the advice works
    step = float(str(caught.value).split("timing.physics_step_s = ")[1].split()[0].rstrip(",;"))
    flight = laisn_sim.fly("T3", LIFT | current | {"timing.physics_step_s": step})
    assert np.abs(np.degrees(flight.trajectory.pitch[:, 1])).max() < 10.0


def test_a_hull_with_scales_is_flown_where_it_is_stable():
    flight = laisn_sim.fly("T3", LIFT)
    assert np.abs(np.degrees(flight.trajectory.pitch[:, 1])).max() < 1.0


@pytest.mark.parametrize("mode", ["pitch", "thrust"])
@pytest.mark.parametrize("name", ["leader", "follower"])
def test_the_projects_hulls_are_stable_at_all_speeds_of_scenarios(name, mode):
    one = Plant([VehicleSetup(name=name, model=name, position_m=(0, 0, -10))], Ocean())
    require_stable(one, design(one, (mode,)), SPEED_MAX + FASTEST_CURRENT_M_S, orbital_speed=4.0)
