"""Mass, inertia and volume of links: closed forms of their shapes, and the defaults of SDF."""

from pathlib import Path

import numpy as np
import pytest

from laisn.arrays import Floats
from sim.gazebo.body import solid_of
from sim.gazebo.document import parse
from tests.sim.gazebo.imported import PROBE, changed, import_text, refusal

HULL_INERTIAL = PROBE[PROBE.index("<inertial>") : PROBE.index("</inertial>") + len("</inertial>")]
HULL_GEOMETRY = "<geometry><box><size>1.6 0.16 0.15625</size></box></geometry>"
PLACEHOLDER = "<!-- more parts -->"  # where tests add elements to the probe


def volume_and_mean_squares(
    inside: Floats, points: Floats, cell_volume: float
) -> tuple[float, Floats]:
    """Volume of a shape by the points inside it, each of which stands for a cell, and mean squares
    of their coordinates.
    """
    points_inside = points[inside]
    return len(points_inside) * cell_volume, (points_inside**2).mean(axis=0)


@pytest.mark.parametrize(
    ("shape", "formula"),
    [
        ("<box><size>0.6 0.8 1</size></box>", "box"),
        ("<sphere><radius>0.5</radius></sphere>", "sphere"),
        ("<ellipsoid><radii>0.3 0.4 0.5</radii></ellipsoid>", "ellipsoid"),
        ("<cylinder><radius>0.4</radius><length>1</length></cylinder>", "cylinder"),
        ("<capsule><radius>0.3</radius><length>0.4</length></capsule>", "capsule"),
    ],
)
def test_shapes_have_the_volume_and_inertia_of_their_points(shape: str, formula: str) -> None:
    count = 120
    coordinates = (np.arange(count) + 0.5) / count - 0.5
    points = np.stack(
        np.meshgrid(coordinates, coordinates, coordinates, indexing="ij"), axis=-1
    ).reshape(-1, 3)
    x, y, z = points.T
    radius = np.hypot(x, y)
    inside = {
        "box": (abs(x) < 0.3) & (abs(y) < 0.4),
        "sphere": x**2 + y**2 + z**2 < 0.25,
        "ellipsoid": (x / 0.3) ** 2 + (y / 0.4) ** 2 + (z / 0.5) ** 2 < 1.0,
        "cylinder": radius < 0.4,
        "capsule": radius**2 + np.maximum(abs(z) - 0.2, 0.0) ** 2 < 0.09,
    }[formula]
    volume, squares = volume_and_mean_squares(inside, points, 1.0 / count**3)
    solid = solid_of(parse(f"<collision><geometry>{shape}</geometry></collision>"))
    assert solid is not None
    assert solid.volume == pytest.approx(volume, rel=0.005)
    moments = squares.sum() - squares
    np.testing.assert_allclose(np.diag(solid.unit_inertia), moments, rtol=0.005)
    half_extents = abs(points[inside]).max(axis=0)
    np.testing.assert_allclose(solid.half_extents, half_extents, atol=1.0 / count)


def test_automatic_inertia_is_that_of_the_collisions(tmp_path: Path) -> None:
    """A box of 0.04 m³ and 1000 kg/m³, and the screw of 0.01 kg, 0.8 m astern, with moments of
    0.001 kg m²; where a mass is stated, it is that mass, as in sdformat 15.
    """
    hull = import_text(tmp_path, changed(PROBE, (HULL_INERTIAL, '<inertial auto="true"/>')))
    assert hull.mass == pytest.approx(40.01)
    moments = 40.0 / 12.0 * np.array([0.16**2 + 0.15625**2, 1.6**2 + 0.15625**2, 1.6**2 + 0.16**2])
    moments += [0.001, 0.001 + 0.01 * 0.64, 0.001 + 0.01 * 0.64]
    actual = np.sort(hull.plant.model.body("own/hull").inertia)
    np.testing.assert_allclose(actual, np.sort(moments), rtol=1e-4)
    of_stated_density = '<inertial auto="true"><density>990</density></inertial>'
    assert import_text(
        tmp_path, changed(PROBE, (HULL_INERTIAL, of_stated_density))
    ).mass == pytest.approx(39.61)
    of_stated_mass = '<inertial auto="true"><mass>39</mass></inertial>'
    assert import_text(
        tmp_path, changed(PROBE, (HULL_INERTIAL, of_stated_mass))
    ).mass == pytest.approx(39.01)


def test_what_an_inertial_lacks_is_as_in_gazebo(tmp_path: Path) -> None:
    """1 kg and moments of 1 kg m², which a note names."""
    bare = (
        '<link name="bare"/><joint name="j" type="fixed"><parent>hull</parent><child>bare</child>'
        "</joint>"
    )
    hull = import_text(tmp_path, changed(PROBE, (PLACEHOLDER, bare)))
    assert hull.mass == pytest.approx(41.0)
    # about the long axis: 0.4 of the hull, 0.001 of the screw, 1 of the link
    assert hull.plant.model.body("own/hull").inertia.min() == pytest.approx(1.401, rel=1e-6)
    assert hull.says("link 'bare': no <inertial>", "1 kg and moments of 1 kg m²")


@pytest.mark.parametrize("density", ["0", "-1000", "1e9"])
def test_a_density_that_no_fluid_has_is_refused(tmp_path: Path, density: str) -> None:
    uniform = "<uniform_fluid_density>{}</uniform_fluid_density>"
    text = changed(PROBE, (uniform.format("1000"), uniform.format(density)))
    words = "uniform_fluid_density of the world's Buoyancy: expected a density from 1 to 20000"
    assert words in refusal(tmp_path, text)


def test_buoyancy_is_that_of_the_water_of_the_world(tmp_path: Path) -> None:
    hull = import_text(tmp_path, PROBE)
    assert hull.record["buoyancy"] == pytest.approx(0.04 * 1000.0 * 9.81)
    graded = (
        "<graded_buoyancy><default_density>1025</default_density><density_change>"
        "<above_depth>0.5</above_depth><density>1.1</density></density_change></graded_buoyancy>"
        "<enable>probe</enable>"
    )
    uniform = "<uniform_fluid_density>1000</uniform_fluid_density>"
    sea = import_text(tmp_path, changed(PROBE, (uniform, graded)), density=1025.0)
    assert sea.record["buoyancy"] == pytest.approx(0.04 * 1025.0 * 9.81)
    assert sea.says("density of 1.1 kg/m³ above z = 0.5 m is not used")
    # the same hull in fresh water loses buoyancy in proportion
    fresh = import_text(tmp_path, changed(PROBE, (uniform, graded)), density=1000.0)
    assert fresh.record["buoyancy"] == pytest.approx(0.04 * 1000.0 * 9.81)
    for_another_model = changed(PROBE, (uniform, f"{uniform}<enable>another</enable>"))
    assert import_text(tmp_path, for_another_model).says(
        "its collisions displace 0 N", "weight is taken"
    )


def test_a_mesh_gives_no_volume_and_says_so(tmp_path: Path) -> None:
    """The size is that of a body of 39.99 kg with moments of 0.4, 8 and 8 kg m², and buoyancy is
    the weight.
    """
    mesh = "<geometry><mesh><uri>hull.dae</uri></mesh></geometry>"
    hull = import_text(tmp_path, changed(PROBE, (HULL_GEOMETRY, mesh)))
    assert hull.says("link 'hull': a collision is a <mesh>", "volume is not read")
    assert hull.says("length", "diameter", "without the meshes")
    assert hull.record["buoyancy"] == pytest.approx(hull.mass * 9.81)


def test_the_centre_of_buoyancy_is_kept_apart_from_the_reference_point(tmp_path: Path) -> None:
    """7 mm above the link of the coefficients."""
    raised = ('<collision name="box">', '<collision name="box"><pose>0 0 0.007 0 0 0</pose>')
    hull = import_text(tmp_path, changed(PROBE, raised))
    np.testing.assert_allclose(hull.record["buoyancy_centre"], (0.0, 0.0, 0.007), atol=1e-9)
    np.testing.assert_allclose(hull.record["added_mass"], np.diag([5, 40, 41, 0, 6, 7]), atol=1e-9)


def test_the_lengths_of_a_hull_that_emerge_stand_about_its_middle(tmp_path: Path) -> None:
    """Ten equal ones of 1.6 m, whose middle is 0.5 m ahead of the link of the coefficients."""
    ahead = ('<collision name="box">', '<collision name="box"><pose>0.5 0 0 0 0 0</pose>')
    record = import_text(tmp_path, changed(PROBE, ahead)).record
    middles = 0.5 + 0.16 * (np.arange(10) - 4.5)
    np.testing.assert_allclose(record["strip_x"][: record["n_strips"]], middles, atol=1e-9)


def test_a_collision_stands_relative_to_the_frame_that_it_names(tmp_path: Path) -> None:
    """0.9 m ahead of the screw, which is at -0.8 m, and so is the mass of a link by its shapes."""
    moved = (
        '<collision name="box">',
        '<collision name="box"><pose relative_to="screw">0.9 0 0.02 0 0 0</pose>',
    )
    hull = import_text(tmp_path, changed(PROBE, moved))
    np.testing.assert_allclose(hull.record["buoyancy_centre"], (0.1, 0.0, 0.02), atol=1e-9)
    automatic = (HULL_INERTIAL, '<inertial auto="true"/>')
    hull = import_text(tmp_path, changed(PROBE, moved, automatic))
    # 40 kg of water there, and 10 g of the screw
    assert hull.centre[0] == pytest.approx((40.0 * 0.1 - 0.01 * 0.8) / 40.01)


def test_a_hull_along_another_axis_is_turned(tmp_path: Path) -> None:
    """Along y: the nose at +y, x of the file to starboard."""
    text = changed(
        PROBE,
        ("1.6 0.16 0.15625", "0.16 1.6 0.15625"),
        ("<pose>-0.8 0 0 0 0 0</pose>", "<pose>0 -0.8 0 0 0 0</pose>"),
        ("<axis><xyz>1 0 0</xyz></axis>", "<axis><xyz>0 1 0</xyz></axis>"),
        ("<xDotU>-5</xDotU><yDotV>-40</yDotV>", "<xDotU>-40</xDotU><yDotV>-5</yDotV>"),
        ("<mDotQ>-6</mDotQ>", "<kDotP>-6</kDotP>"),
        ("<xU>-1</xU><kP>-2</kP>", "<yV>-1</yV><mQ>-2</mQ><yP>0.5</yP>"),
    )
    hull = import_text(tmp_path, text)
    assert hull.says("the hull lies along y", "nose is taken to be at +y")
    np.testing.assert_allclose(np.diag(hull.record["added_mass"]), (5, 40, 41, 0, 6, 7), atol=1e-9)
    linear = hull.matrix("linear")
    # a force along y by a rate about x of the file, ahead by −pitch here
    assert linear[0, 4] == pytest.approx(0.5)
    assert linear[0, 0] == pytest.approx(1.0)
    assert linear[3, 3] == pytest.approx(2.0)
    np.testing.assert_allclose(hull.effector("screw")["place"], (-0.8, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(hull.effector("screw")["force"], (1.0, 0.0, 0.0), atol=1e-9)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([("<mass>39.99</mass>", "<mass>heavy</mass>")], "<mass>: expected 1 number"),
        (
            # more than the sum of the others, which is that of a plate
            [("<izz>8</izz>", "<izz>99</izz>")],
            "<inertia> of link 'hull': no mass has principal moments",
        ),
        ([(PLACEHOLDER, "<static>true</static>")], "model 'probe' is <static>: it does not move"),
        (
            [
                (
                    PLACEHOLDER,
                    '<joint name="tie" type="fixed"><parent>world</parent><child>hull</child>'
                    "</joint>",
                )
            ],
            "joint 'tie' fixes the model to the world",
        ),
    ],
)
def test_bodies_that_cannot_swim_are_refused(
    tmp_path: Path, pairs: list[tuple[str, str]], words: str
) -> None:
    assert words in refusal(tmp_path, changed(PROBE, *pairs))
