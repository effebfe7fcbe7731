"""Imported hulls in missions: they have all that one needs, are flyable and keep their way."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn_sim.cli.main import app
from sim.vehicle.own_hull import hull_errors
from tests.sim.gazebo.imported import DATA, changed, import_file, import_text

THRUSTER = """
<link name="{name}"><pose>{place} 0 0 0</pose><inertial><mass>1e-6</mass><inertia>
  <ixx>1e-9</ixx><iyy>1e-9</iyy><izz>1e-9</izz></inertia></inertial></link>
<joint name="{name}_joint" type="revolute"><parent>hull</parent><child>{name}</child>
  <axis><xyz>{axis}</xyz></axis></joint>
<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
  <joint_name>{name}_joint</joint_name>
  <max_thrust_cmd>30</max_thrust_cmd><min_thrust_cmd>-30</min_thrust_cmd>
</plugin>
"""
WITH_ONE_VERTICAL_THRUSTER = """
<sdf version="1.9"><model name="trio">
  <link name="hull">
    <inertial><pose>0 0 -0.03 0 0 0</pose><mass>40</mass><inertia>
      <ixx>1.2</ixx><iyy>2.1</iyy><izz>2.4</izz></inertia></inertial>
    <collision name="c"><geometry><box><size>0.8 0.25 0.2</size></box></geometry></collision>
  </link>
  {thrusters}
  <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
    <link_name>hull</link_name>
    <xDotU>-5</xDotU><yDotV>-12</yDotV><zDotW>-14</zDotW>
    <kDotP>-0.1</kDotP><mDotQ>-0.2</mDotQ><nDotR>-0.2</nDotR>
    <xU>-4</xU><yV>-10</yV><zW>-12</zW><kP>-2</kP><mQ>-3</mQ><nR>-3</nR>
    <xUabsU>-18</xUabsU><yVabsV>-40</yVabsV><zWabsW>-60</zWabsW>
  </plugin>
</model></sdf>
"""
"""A hull of 40 kg whose centre of gravity lies 0.03 m below that of its buoyancy."""
LINEAR_DAMPING_TAGS = (
    "<xU>-4</xU><yV>-6.2</yV><zW>-5.2</zW>",
    "<kP>-1.5</kP><mQ>-1.5</mQ><nR>-0.4</nR>",
)


@pytest.mark.parametrize("name", ["torpedo", "hovering", "long_range", "probe"])
@pytest.mark.parametrize("role", ["leader", "follower"])
def test_imported_hulls_lack_nothing(name: str, role: str) -> None:
    assert hull_errors(import_file(DATA / f"{name}.sdf").text, role) == []


def scenario(folder: Path, hull: str, seconds: int) -> Path:
    """A follower of an imported hull at 0.5 m/s with a right-angled turn, in a file."""
    (folder / "hull.xml").write_text(hull, encoding="utf-8")
    path = folder / "mission.toml"
    east = seconds / 4
    path.write_text(
        f"duration_s = {seconds}\n[[followers]]\nmodel = 'hull.xml'\n"
        f"waypoints = [[0, 0, 0], [{seconds // 2}, {east}, 0], [{seconds}, {east}, {east}]]\n",
        encoding="utf-8",
    )
    return path


def test_a_hovering_hull_without_linear_damping_is_flyable(tmp_path: Path) -> None:
    """As public models of the BlueROV2 with the added mass of Wu (2018): quadratic drag alone."""
    text = (DATA / "hovering.sdf").read_text(encoding="utf-8")
    hull = import_text(
        tmp_path, changed(text, *[(tags, "") for tags in LINEAR_DAMPING_TAGS]), 1025.0
    )
    path = scenario(tmp_path, hull.text, 120)
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0, result.output
    assert "valid: 120 s, 1 follower" in result.output


def test_an_imported_hull_keeps_its_route(tmp_path: Path) -> None:
    """Within a length of the vehicle of the end of a leg of 15 m, after a turn of 90°."""
    hull = import_file(DATA / "hovering.sdf", 1025.0)
    path = scenario(tmp_path, hull.text, 60)
    flight = laisn_sim.fly(path)
    end_position = flight.trajectory.position[-1, 1]
    np.testing.assert_allclose(end_position[:2], (15.0, 15.0), atol=0.5)
    assert flight.trajectory.position[-1, 1, 2] == pytest.approx(
        flight.trajectory.position[0, 1, 2], abs=0.3
    )


@pytest.mark.parametrize("forward", [0.12, -0.12])
def test_a_single_vertical_thruster_holds_the_depth_and_its_moment_pitches_the_hull(
    tmp_path: Path, forward: float
) -> None:
    """At a place, too light by B = 5 N: of the forces F of the vertical thruster and T of those
    along the hull, T cos θ = F sin θ and T sin θ + F cos θ = -B, hence F = -B cos θ; its moment
    about the centre of buoyancy is that of the weight, F x = W h sin θ.
    """
    places = {"port": "-0.3 0.2 0", "starboard": "-0.3 -0.2 0", "vertical": f"{forward} 0 0"}
    thrusters = [
        THRUSTER.format(name=name, place=place, axis="0 0 1" if name == "vertical" else "1 0 0")
        for name, place in places.items()
    ]
    hull = import_text(tmp_path, WITH_ONE_VERTICAL_THRUSTER.format(thrusters="".join(thrusters)))
    (tmp_path / "hull.xml").write_text(hull.text, encoding="utf-8")
    path = tmp_path / "hover.toml"
    path.write_text(
        "duration_s = 120\n[[followers]]\nmodel = 'hull.xml'\ntrim = 'neutral'\n"
        "excess_buoyancy_n = 5.0\nwaypoints = [[0, -20, 0], [120, -20, 0]]\n",
        encoding="utf-8",
    )
    flight = laisn_sim.fly(path)
    end = laisn_sim.truth(flight).to_pandas().query("vehicle == 'follower'").iloc[-1]
    assert end.depth_m == pytest.approx(10.0, abs=0.01)
    expected_deg = np.degrees(np.arctan(-5.0 * forward / (40.0 * 9.81 * 0.03)))
    assert end.pitch_deg == pytest.approx(expected_deg, abs=0.05)
