"""Hulls written by `laisn hull`: formulas by other means, what is written flies, SDF files by
hand-made ones.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from typer.testing import CliRunner

from experiments.command.cli import app
from laisn.arrays import Floats
from laisn.failure import LaisnError
from sim.control.autopilot import design, top_speed
from sim.control.stability import require_stable
from sim.scenario.routes import Route
from sim.simulation import simulate
from sim.vehicle import mjcf
from sim.vehicle.effectors import FIN
from sim.vehicle.hull_file import from_dimensions, helmbold_slope, lamb_factors
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.vehicle.sdf_import import from_sdf
from sim.water import Ocean
from tools.documents.route_keeping import tracking

SIZE = 1.8, 0.2, 50.0


def plant_of(text: str, speed: float = 0.0, heading: float = 0.0) -> Plant:
    place = {"position_m": (0.0, 0.0, -10.0), "speed_m_s": speed, "heading_rad": heading}
    return Plant([VehicleSetup(name="own", model=text, **place)], Ocean())  # type: ignore[arg-type]


def record_of(text: str) -> np.void:
    (one,) = mjcf.read_coefficients(plant_of(text).model, ["own"], 1026.0)
    return one


@pytest.mark.parametrize("slenderness", [3.0, 9.0, 20.0])
def test_added_mass_is_that_of_lambs_integrals(slenderness: float) -> None:
    a, b = slenderness, 1.0
    alpha = a * b**2 * quad(lambda x: 1 / ((a**2 + x) ** 1.5 * (b**2 + x)), 0, np.inf)[0]
    beta = a * b**2 * quad(lambda x: 1 / ((a**2 + x) ** 0.5 * (b**2 + x) ** 2), 0, np.inf)[0]
    turning = (a**2 - b**2) ** 2 * (beta - alpha)
    turning /= (2 * (a**2 - b**2) + (a**2 + b**2) * (alpha - beta)) * (a**2 + b**2)
    expected = alpha / (2 - alpha), beta / (2 - beta), turning
    assert lamb_factors(2 * a, 2 * b) == pytest.approx(expected, rel=1e-6)


def test_slope_of_fins_has_the_limits_of_wing_theory() -> None:
    assert helmbold_slope(1e-4) == pytest.approx(np.pi / 2 * 1e-4, rel=1e-4)  # slender wing
    assert helmbold_slope(1e6) == pytest.approx(2 * np.pi, rel=1e-5)  # thin aerofoil
    assert helmbold_slope(2.6) == pytest.approx(3.09, abs=0.005)  # leader.xml


@pytest.mark.parametrize("fins", ["+", "x"])
def test_an_estimated_hull_flies(fins: str) -> None:
    text = from_dimensions(*SIZE, fins=fins, propeller=0.14).xml()  # type: ignore[arg-type]
    assert hull_errors(text, "follower") == hull_errors(text, "leader") == []
    plant = plant_of(text, speed=1.0, heading=np.pi / 2)
    autopilot = design(plant, (None,))
    require_stable(plant, autopilot, 2.0)
    assert top_speed(autopilot[0]) == pytest.approx(2.5, abs=0.03)
    # fins outweigh the Munk moment (A22 − A11) u v of the hull by the margin that the file names
    c = record_of(text)
    moving = plant.effectors[0][plant.effectors[0]["kind"] == FIN]
    for axis in (1, 2):
        share = moving["force"][:, axis] ** 2
        lift = 0.5 * 1026.0 * np.prod(moving["parameters"][:, :2], axis=1) * share
        munk = c["added_mass"][axis, axis] - c["added_mass"][0, 0]
        assert -(lift @ moving["place"][:, 0]) / munk == pytest.approx(1.15, rel=1e-3)
    route = Route.at_speed("bend", [[0, 0], [50, 0], [100, 20], [150, 20]], 1.0, 10.0)
    report = tracking(simulate(plant, [route], 150.0, [None]), [route])[0]
    assert report.cross_track_rms < 0.5
    assert report.depth_error_rms < 0.2


def test_estimated_strips_and_buoyancy_are_those_of_the_hull() -> None:
    c = record_of(from_dimensions(*SIZE).xml())
    n = c["n_strips"]
    assert c["strip_area"][:n].sum() == pytest.approx(np.pi * 0.9 * 0.1, rel=1e-5)
    assert c["buoyancy"] == pytest.approx(50.0 * 9.81)
    # drag at 1 m/s: 0.42 on the frontal area
    area, drag, _ = c["hull_lift"]
    assert area * drag == pytest.approx(0.42 * np.pi * 0.1**2, rel=1e-5)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((1.8, 0.7, 50.0), "at least three times as long as thick"),
        ((1.8, 0.2, 500.0), r"mass 500 kg: a neutral hull of 1\.8 m and 0\.2 m has 26\.1 to 58 kg"),
        ((-1.8, 0.2, 50.0), r"length: expected a positive number \(given: -1\.8\)"),
        ((1.8, float("nan"), 50.0), "diameter: expected a positive number"),
        ((1.8, 0.2, 50.0, "x", 0.5), r"propeller 0\.5 m: at most twice the diameter"),
    ],
)
def test_dimensions_of_no_hull_are_refused(given: tuple[float, ...], words: str) -> None:
    with pytest.raises(LaisnError, match=words):
        from_dimensions(*given)  # type: ignore[arg-type]


HYDRODYNAMICS = """
<xDotU>-2</xDotU><yDotV>-20</yDotV><zDotW>-21</zDotW><kDotP>-0.1</kDotP><mDotQ>-3</mDotQ><nDotR>-3.5</nDotR>
<yDotR>-0.5</yDotR><nDotV>-0.5</nDotV><xU>-4</xU><yR>-1.5</yR><xUabsU>-6</xUabsU><yVabsV>-60</yVabsV>
<zWabsW>-61</zWabsW><mQabsQ>-9</mQabsQ><nRR>-8</nRR>"""
SDF = f"""<sdf version="1.9"><model name="glider">
<link name="base"><inertial><pose>0 0 -0.03 0 0 0</pose><mass>29</mass>
  <inertia><ixx>0.2</ixx><iyy>4</iyy><izz>4.1</izz></inertia></inertial>
  <collision name="c"><pose>0 0 0 0 1.5707963267948966 0</pose>
    <geometry><cylinder><radius>0.08</radius><length>1.5</length></cylinder></geometry></collision></link>
<link name="rudder"><pose>-0.6 0 0.1 0 0 0</pose><inertial><mass>1</mass>
  <inertia><ixx>0.001</ixx><iyy>0.001</iyy><izz>0.001</izz></inertia></inertial></link>
<link name="plane"><pose>-0.6 0 0 0 0 0</pose></link>
<link name="screw"><pose>-0.75 0 0 0 90 0</pose></link>
<joint name="rudder_joint" type="revolute"><parent>base</parent><child>rudder</child>
  <axis><xyz>0 0 1</xyz><limit><lower>-0.3</lower><upper>0.25</upper></limit></axis></joint>
<joint name="plane_joint" type="revolute"><parent>base</parent><child>plane</child>
  <axis><xyz>0 1 0</xyz></axis></joint>
<joint name="screw_joint" type="revolute"><parent>base</parent><child>screw</child>
  <axis><xyz>0 0 1</xyz></axis></joint>
<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
  <joint_name>screw_joint</joint_name>
  <max_thrust_cmd>40</max_thrust_cmd><min_thrust_cmd>-20</min_thrust_cmd></plugin>
<plugin filename="gz-sim-lift-drag-system" name="gz::sim::systems::LiftDrag">
  <link_name>rudder</link_name>
  <area>0.03</area><cla>4.1</cla><alpha_stall>0.2</alpha_stall><upward>0 1 0</upward>
  <cp>0.02 0 0</cp></plugin>
<plugin filename="gz-sim-lift-drag-system" name="gz::sim::systems::LiftDrag">
  <link_name>plane</link_name>
  <area>0.03</area><cla>4.1</cla><upward>0 0 1</upward></plugin>
<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
  <link_name>base</link_name>
  <water_density>1000</water_density>{HYDRODYNAMICS}</plugin>
</model></sdf>""".replace(
    "<pose>-0.75 0 0 0 90 0</pose>", '<pose degrees="true">-0.75 0 0 0 90 0</pose>'
)


def expected_matrices() -> dict[str, Floats]:
    added, linear, square = (
        np.diag([2.0, 20, 21, 0.1, 3, 3.5]),
        np.zeros((6, 6)),
        np.diag([6.0, 60, 61, 0, 9, 8]),
    )
    added[1, 5] = added[5, 1] = 0.5
    linear[0, 0], linear[1, 5] = 4.0, 1.5
    return {"added_mass": added, "linear": linear, "quadratic": square}


def test_an_sdf_file_is_converted_to_a_hull_with_its_coefficients() -> None:
    file, remarks = from_sdf(SDF)
    text = file.xml()
    assert remarks == []
    assert hull_errors(text, "leader") == []
    c, wanted = record_of(text), expected_matrices()
    np.testing.assert_allclose(c["added_mass"], wanted["added_mass"])
    for name in ("linear", "quadratic"):
        np.testing.assert_allclose(
            np.diag(c[f"{name}_damping"]) + c[f"{name}_coupling"], wanted[name]
        )
    volume = np.pi * 0.08**2 * 1.5
    assert c["buoyancy"] == pytest.approx(1000 * volume * 9.81, rel=1e-5)
    plant = plant_of(text)
    hull = plant.model.body("own/hull")
    assert hull.mass[0] == pytest.approx(30.0)
    centre = np.array([-0.6, 0.0, 29 * -0.03 + 0.1]) / 30
    np.testing.assert_allclose(hull.ipos, centre, atol=1e-6)
    # Steiner: rudder of 1 kg at (−0.6, 0, 0.1) beside 29 kg at (0, 0, −0.03)
    apart = np.array([0.6, 0.0, 0.13])
    yaw = 4.1 + 0.001 + 29 / 30 * (apart[0] ** 2 + apart[1] ** 2)
    assert hull.inertia.max() == pytest.approx(yaw, rel=0.01)
    screw, rudder, plane = plant.effectors[0]
    np.testing.assert_allclose(screw["force"], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(screw["limits"], [-20, 40])
    np.testing.assert_allclose(rudder["force"], [0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(rudder["place"], [-0.58, 0, 0.1], atol=1e-6)
    np.testing.assert_allclose(rudder["parameters"][:4], [0.03, 4.1, 0.2, 0.0])
    np.testing.assert_allclose(rudder["limits"], [-0.3, 0.25])
    np.testing.assert_allclose(plane["force"], [0, 0, 1], atol=1e-6)


def test_a_hull_with_its_nose_at_minus_x_is_turned_round() -> None:
    """As MBARI's Tethys in gz-sim: propeller at +x, which drives astern of the frame."""
    front = SDF.replace("-0.75 0 0 0 90 0", "0.75 0 0 0 90 0").replace("<pose>-0.6 ", "<pose>0.6 ")
    file, remarks = from_sdf(front)
    (remark,) = remarks
    assert "the nose is taken to be at −x" in remark
    forward, backward = record_of(from_sdf(SDF)[0].xml()), record_of(file.xml())
    # y and r: turned round, sway changes its sign and yaw does not
    assert backward["added_mass"][1, 5] == -forward["added_mass"][1, 5]
    np.testing.assert_allclose(np.diag(backward["added_mass"]), np.diag(forward["added_mass"]))
    screw, rudder, _ = plant_of(file.xml()).effectors[0]
    np.testing.assert_allclose(screw["place"], [-0.75, 0, 0], atol=1e-6)
    np.testing.assert_allclose(screw["force"], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(screw["limits"], [-40, 20])
    assert rudder["place"][0] == pytest.approx(-0.62)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "<xU>-4</xU>",
            "<xU>4</xU>",
            r"<xU> must not be positive, since it would drive the hull \(given: 4\)",
        ),
        ("<xU>-4</xU>", "<xU>four</xU>", r"<xU>: expected 1 number \(given: 'four'\)"),
        (
            "<joint_name>screw_joint",
            "<joint_name>no_joint",
            "there is no <joint name='no_joint'> with a child link",
        ),
        ("<link_name>plane", "<link_name>wing", "LiftDrag: there is no <link name='wing'>"),
        (
            "systems::Hydrodynamics",
            "systems::Buoyancy",
            "no <model> with links and a Hydrodynamics plugin",
        ),
        (
            "<pose>-0.6 0 0 0 0 0</pose>",
            '<pose relative_to="base">0 0 0 0 0 0</pose>',
            "relative_to .* are not read",
        ),
        ("</sdf>", "", "no valid SDF"),
    ],
)
def test_sdf_files_that_cannot_be_read_are_refused(old: str, new: str, words: str) -> None:
    assert old in SDF
    with pytest.raises(LaisnError, match=words):
        from_sdf(SDF.replace(old, new))


def test_what_an_sdf_file_lacks_is_remarked() -> None:
    thin = SDF.replace("<max_thrust_cmd>40</max_thrust_cmd>", "").replace(
        "<xDotU>-2</xDotU>", "<xDotU>2</xDotU>"
    )
    file, remarks = from_sdf(thin.replace("<xU>-4</xU>", "<xUU>-4</xUU><spare>1</spare>"))
    assert [text.split(":")[0] for text in remarks] == [
        "thruster 'screw_joint' has no max_thrust_cmd (Gazebo",
        "<xDotU> is positive, where SNAME has minus the added mass",
        "<spare> of Hydrodynamics is not read",
    ]
    assert record_of(file.xml())["added_mass"][0, 0] == 2.0


def test_the_command_prints_a_hull(tmp_path: Path) -> None:
    source = tmp_path / "model.sdf"
    source.write_text(SDF, encoding="utf-8")
    dimensions = [
        "--length",
        "1.8",
        "--diameter",
        "0.2",
        "--mass",
        "50",
        "--fins",
        "x",
        "--propeller",
        "0.14",
    ]
    for given in (dimensions, ["--sdf", str(source)]):
        result = CliRunner().invoke(app, ["hull", *given])
        assert result.exit_code == 0, result.output
        assert hull_errors(result.stdout, "follower") == []
    assert (
        from_dimensions(1.8, 0.2, 50.0, "x", 0.14).xml()
        == CliRunner().invoke(app, ["hull", *dimensions]).stdout
    )
