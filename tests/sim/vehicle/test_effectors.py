"""A vehicle uses the effectors of its MJCF, at any positions."""

import re
from pathlib import Path

import numpy as np
import pytest

import laisn_sim
from sim.feasibility import cautions
from sim.scenario.routes import DepthProfile, Route
from sim.simulation import simulate
from sim.vehicle.effector_kinds import HullFlow
from sim.vehicle.effectors import Fitted, effector_wrench
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.own_hull import gear_remarks, hull_errors
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

SITES = """<site name="a" class="thruster" pos="-0.8 0.02 0"/>
<site name="b" class="thruster" pos="0.5 0 0.05"/>
<site name="c" class="thruster" pos="-0.4 0 0"/>"""
ACTUATORS = """<actuator><general name="ahead" class="propeller" site="a"/>
<general name="aside" class="lateral" site="b" gear="0 1 0.2 0 0 0"/>
<general name="up" class="vertical" site="c"/></actuator>"""


# direction of the gear 0 1 0.2
SLANTED = np.array([0.0, 1.0, 0.2]) / np.sqrt(1.04)


def three_thrusters() -> str:
    """The follower's hull with three thrusters: one off the axis, one slanted at the bow, one
    below the stern.
    """
    text = re.sub(r"<site name=.thruster_[^>]*/>", "", laisn_sim.hull("follower"))
    text = re.sub(r"<keyframe>.*</keyframe>", "", text, flags=re.DOTALL)
    text = re.sub(r"<actuator>.*</actuator>", ACTUATORS, text, flags=re.DOTALL)
    return text.replace('<site name="cg"', f'{SITES}<site name="cg"')


def setup(name: str, model: str) -> VehicleSetup:
    return VehicleSetup(
        name=name, model=model, position_m=(0.0, 0.0, -10.0), heading_rad=np.pi / 2, speed_m_s=1.0
    )


def test_records_are_those_of_the_mjcf() -> None:
    plant = Plant([setup("one", three_thrusters()), setup("two", "follower")], Ocean())
    assert plant.effector_names[0] == ("ahead", "aside", "up")
    assert len(plant.effector_names[1]) == 5
    records = plant.effectors[0]
    np.testing.assert_allclose(records["force"][:3], [[1, 0, 0], SLANTED, [0, 0, 1]], atol=1e-12)
    positions = [[-0.8, 0.02, 0], [0.5, 0, 0.05], [-0.4, 0, 0]]
    np.testing.assert_allclose(
        records["torque"][:3], np.cross(positions, records["force"][:3]), atol=1e-12
    )
    assert records["limits"][:3].tolist() == [[-40, 100], [-25, 25], [-25, 25]]
    assert records["lag"][:3].tolist() == [0.3] * 3
    # records beyond a vehicle's own effectors are zero, and give no thrust
    assert not records["force"][3:].any()
    plant.step(np.full((2, 5), 10.0), 2)
    at_rest = 0.0, 0.0, 0.0
    fitted = Fitted(plant.kinds, plant.true_effectors, plant.effector_states)
    thrust, torque, *others = effector_wrench(
        fitted, 0, HullFlow(1026.0, 9.81, at_rest, at_rest, (0.0, 0.0, 1.0))
    )
    assert not np.any(others)
    # equal thrusts: 1 ahead, 1 to port and upwards, and 1 up, and their torques
    expected = [
        1,
        SLANTED[1],
        SLANTED[2] + 1,
        *np.cross(positions, records["force"][:3]).sum(axis=0),
    ]
    np.testing.assert_allclose(np.array([*thrust, *torque]) / thrust[0], expected, atol=1e-12)


def test_three_thrusters_at_unsymmetric_positions_follow_a_route(tmp_path: Path) -> None:
    """The autopilot controls surge, yaw and pitch, which they can give, and neither heave nor sway;
    the vehicle moves within 0.3 m of the follower with its five thrusters.
    """
    plant = Plant([setup("one", three_thrusters())], Ocean())
    depth = DepthProfile(time=np.array([0.0, 40.0]), depth=np.array([10.0, 12.0]))
    route = Route.at_speed("turn", [[0, 0], [60, 0], [60, 60]], 1.0, depth)
    trajectory = simulate(plant, [route], 110.0)
    of_follower = simulate(Plant([setup("one", "follower")], Ocean()), [route], 110.0)
    distance = np.linalg.norm(trajectory.position - of_follower.position, axis=2)
    assert distance[-1, 0] < 0.1
    assert np.sqrt(np.mean(distance**2)) < 0.3
    (tmp_path / "three.xml").write_text(three_thrusters(), encoding="utf-8")
    flight = laisn_sim.fly(
        "T3", {"duration_s": 20, "followers.0.model": str(tmp_path / "three.xml")}
    )
    from_log = laisn_sim.read_log(laisn_sim.write_log(flight, tmp_path / "three.mcap"))
    assert from_log.trajectory.effector_names == flight.trajectory.effector_names
    assert (
        from_log.trajectory.effector_states.tobytes() == flight.trajectory.effector_states.tobytes()
    )


def test_a_vehicle_without_any_actuator_is_refused(tmp_path: Path) -> None:
    text = re.sub(r"<actuator>.*</actuator>", "<actuator/>", three_thrusters(), flags=re.DOTALL)
    (tmp_path / "none.xml").write_text(text, encoding="utf-8")
    with pytest.raises(laisn_sim.LaisnError, match="has 0 actuators, expected 1 to 16"):
        laisn_sim.load("T3", {"followers.0.model": str(tmp_path / "none.xml")})


def with_gear(gear: str) -> str:
    """The hull of `three_thrusters` with another gear of its bow thruster."""
    return three_thrusters().replace('gear="0 1 0.2 0 0 0"', f'gear="{gear}"')


@pytest.mark.parametrize(
    ("gear", "force", "torque"),
    [
        ("0 3 0 0 0 0", [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]),
        ("0 2 0 0.4 0 0", [0.0, 1.0, 0.0], [0.2, 0.0, 0.0]),
        ("0 0 0 0 0 -4", [0.0, 0.0, 0.0], [0.0, 0.0, -1.0]),
        # rounded
        ("0 0.70711 0.70711 0 0 0", [0.0, 0.70711, 0.70711], [0.0, 0.0, 0.0]),
    ],
)
def test_a_gear_is_a_direction(gear: str, force: list[float], torque: list[float]) -> None:
    """The bow thruster is at (0.5, 0, 0.05) m; torques of its force are about the origin."""
    record = Plant([setup("one", with_gear(gear))], Ocean()).effectors[0, 1]
    np.testing.assert_allclose(record["force"], force, atol=1e-12)
    about_origin = np.add(torque, np.cross([0.5, 0.0, 0.05], force))
    np.testing.assert_allclose(record["torque"], about_origin, atol=1e-12)


def test_the_length_of_a_gear_does_not_move_a_vehicle_faster() -> None:
    twists = []
    for gear in ("0 1 0.2 0 0 0", "0 5 1 0 0 0"):
        plant = Plant([setup("one", with_gear(gear))], Ocean())
        for _ in range(50):
            plant.step(np.array([[5.0, 10.0, 0.0]]))
        twists.append(plant.twist[0].copy())
    np.testing.assert_allclose(twists[0], twists[1], rtol=1e-9, atol=1e-12)


def test_a_gear_that_is_no_unit_vector_is_told_before_the_flight() -> None:
    assert gear_remarks(with_gear("0 1 0 0 0 0")) == []
    (remark,) = gear_remarks(with_gear("0 -3 4 0 0 0"))
    assert "name='aside'" in remark
    assert "length 5" in remark
    scenario = laisn_sim.load("T5", {"followers.0.model": with_gear("0 -3 4 0 0 0")})
    assert any("gear has the length 5" in caution for caution in cautions(scenario))


def test_a_gear_without_a_direction_is_refused() -> None:
    (error,) = hull_errors(with_gear("0 0 0 0 0 0"), "follower")
    assert "gear must be a direction" in error
