"""LinkCoefficients of the Hydrodynamics plugin and of <fluid_added_mass>."""

from pathlib import Path

import numpy as np
import pytest

from sim.gazebo.hydrodynamics import LinkCoefficients, about_point
from tests.sim.gazebo.imported import PROBE, changed, import_text, refusal

ADDED = "<xDotU>-5</xDotU><yDotV>-40</yDotV><zDotW>-41</zDotW><mDotQ>-6</mDotQ><nDotR>-7</nDotR>"
FLUID_ADDED_MASS = (
    "</inertia><fluid_added_mass><xx>5</xx><yy>40</yy><zz>41</zz><qq>6</qq><rr>7</rr><yr>0.5</yr>"
    "</fluid_added_mass></inertial>\n        <collision"
)
END_OF_INERTIAL = "</inertia>\n        </inertial>\n        <collision"
LINK_NAME = "<link_name>hull</link_name>"


def test_coefficients_have_their_places_and_signs(tmp_path: Path) -> None:
    more = "<yDotR>-0.5</yDotR><nDotV>-0.5</nDotV><yR>-1.5</yR><nPabsP>0.25</nPabsP>"
    hull = import_text(tmp_path, changed(PROBE, (LINK_NAME, LINK_NAME + more)))
    added = np.diag([5.0, 40, 41, 0, 6, 7])
    added[1, 5] = added[5, 1] = 0.5
    linear = np.diag([1.0, 0, 0, 2, 0, 0])
    linear[1, 5] = 1.5
    quadratic = np.diag([4.0, 80, 81, 0, 30, 31])
    quadratic[5, 3] = -0.25
    np.testing.assert_allclose(hull.record["added_mass"], added, atol=1e-9)
    np.testing.assert_allclose(hull.matrix("linear"), linear, atol=1e-9)
    np.testing.assert_allclose(hull.matrix("quadratic"), quadratic, atol=1e-9)
    assert hull.record["munk_factor"] == 1.0


def test_fluid_added_mass_is_that_of_sdf_1_10(tmp_path: Path) -> None:
    expected = np.diag([5.0, 40, 41, 0, 6, 7])
    expected[1, 5] = expected[5, 1] = 0.5
    hull = import_text(tmp_path, changed(PROBE, (ADDED, ""), (END_OF_INERTIAL, FLUID_ADDED_MASS)))
    np.testing.assert_allclose(hull.record["added_mass"], expected, atol=1e-9)
    assert not hull.says("no added mass")
    both = import_text(tmp_path, changed(PROBE, (END_OF_INERTIAL, FLUID_ADDED_MASS)))
    np.testing.assert_allclose(np.diag(both.record["added_mass"]), 2 * np.diag(expected), atol=1e-6)
    assert both.says("both count")


@pytest.mark.parametrize(
    ("flag", "added", "munk", "words"),
    [
        (
            "<disable_added_mass>true</disable_added_mass>",
            0.0,
            1.0,
            ["disable_added_mass", "Coriolis"],
        ),
        ("<disable_coriolis>1</disable_coriolis>", 40.0, 0.0, ["munk_factor is 0", "roll rate"]),
        ("<disable_coriolis>False</disable_coriolis>", 40.0, 1.0, ["sign", "opposite"]),
    ],
)
def test_flags_that_disable_terms_count(
    tmp_path: Path, flag: str, added: float, munk: float, words: list[str]
) -> None:
    hull = import_text(tmp_path, changed(PROBE, (LINK_NAME, LINK_NAME + flag)))
    assert hull.record["added_mass"][1, 1] == pytest.approx(added)
    assert hull.record["munk_factor"] == munk
    assert hull.says(*words)


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (("<xUabsU>-4</xUabsU>", "<xUU>-4</xUU>"), ["<xUU>", "drives a hull astern", "|u| u"]),
        (
            ("<xUabsU>-4</xUabsU>", "<xUabsU>-4</xUabsU><nUabsV>3</nUabsV>"),
            ["<nUabsV>", "not modelled"],
        ),
        (
            (LINK_NAME, f"{LINK_NAME}<default_current>1 0 0</default_current>"),
            ["<default_current>", "scenario"],
        ),
        ((LINK_NAME, f"{LINK_NAME}<spare>1</spare>"), ["Hydrodynamics: <spare> is not used"]),
        (
            (LINK_NAME, f"{LINK_NAME}<namespace>a</namespace>"),
            ["Hydrodynamics: <namespace> is not used"],
        ),
        (
            ("<xDotU>-5</xDotU>", "<xDotU>5</xDotU>"),
            ["<xDotU> is positive", "taken for the added mass"],
        ),
        (("<xDotU>-5</xDotU>", "<xDotU>-5</xDotU><yDotR>1</yDotR>"), ["not symmetric"]),
    ],
)
def test_what_is_not_taken_as_it_stands_is_remarked(
    tmp_path: Path, pair: tuple[str, str], words: list[str]
) -> None:
    hull = import_text(tmp_path, changed(PROBE, pair))
    assert hull.says(*words), hull.notes
    assert hull.record["added_mass"][0, 0] == pytest.approx(5.0)
    assert hull.matrix("quadratic")[0, 0] == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (("<xU>-1</xU>", "<xU>4</xU>"), "<xU> must not be positive"),
        (("<xUabsU>-4</xUabsU>", "<xUabsU>4</xUabsU>"), "<xUabsU> must not be positive"),
        (
            ("<xU>-1</xU>", "<xU>four</xU>"),
            "Hydrodynamics: <xU>: expected 1 number (given: 'four')",
        ),
        ((LINK_NAME, "<link_name>keel</link_name>"), "no <link name='keel'>"),
        (
            ("gz::sim::systems::Hydrodynamics", "tethys::HydrodynamicsPlugin"),
            "<yV> must not be positive, since it would drive the hull (not given, default of "
            "tethys::HydrodynamicsPlugin: 20)",
        ),
    ],
)
def test_coefficients_that_cannot_be_are_refused(
    tmp_path: Path, pair: tuple[str, str], words: str
) -> None:
    assert words in refusal(tmp_path, changed(PROBE, pair))


def test_each_plugin_is_of_its_own_link(tmp_path: Path) -> None:
    """A wing at (−0.5, 0, 0.2), turned by 90° about z: its drag along its x is along y here."""
    wing = (
        '<link name="wing"><pose degrees="true">-0.5 0 0.2 0 0 90</pose>'
        "<inertial><mass>0</mass></inertial></link>"
        '<joint name="j" type="fixed"><parent>hull</parent><child>wing</child></joint>'
    )
    plugin = (
        '<plugin filename="h" name="gz::sim::systems::Hydrodynamics"><link_name>wing</link_name>'
        "<xU>-10</xU><xDotU>-2</xDotU><xUabsU>-20</xUabsU></plugin></model>"
    )
    text = changed(PROBE, ("<!-- more parts -->", wing), ("</model>", plugin))
    hull = import_text(tmp_path, text)
    # velocity at the wing along y of each motion of the hull, v − z p + x r, with (x, z) =
    # (−0.5, 0.2)
    motion_to_wing = np.array([0.0, 1.0, 0.0, -0.2, 0.0, -0.5])
    without_wing = import_text(tmp_path, PROBE)
    np.testing.assert_allclose(
        hull.matrix("linear") - without_wing.matrix("linear"),
        10.0 * np.outer(motion_to_wing, motion_to_wing),
        atol=1e-8,
    )
    np.testing.assert_allclose(
        hull.record["added_mass"] - without_wing.record["added_mass"],
        2.0 * np.outer(motion_to_wing, motion_to_wing),
        atol=1e-7,
    )
    np.testing.assert_allclose(
        hull.matrix("quadratic") - without_wing.matrix("quadratic"),
        20.0 * np.outer(motion_to_wing, np.abs(motion_to_wing) * motion_to_wing),
        atol=1e-8,
    )
    assert hull.says("moved by 0.539 m", "quadratic damping")


def test_coefficients_about_another_point_have_the_same_power() -> None:
    """Power of linear damping and energy of added mass do not depend on the point of reference."""
    generator = np.random.default_rng(5)
    frame = np.eye(4)
    rotation = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    frame[:3, :3] = rotation * np.linalg.det(rotation)
    frame[:3, 3] = generator.normal(size=3)
    root = generator.normal(size=(6, 6))
    matrix = root @ root.T
    coefficients = LinkCoefficients(frame, matrix, matrix)
    point = generator.normal(size=3)
    moved = about_point([coefficients], np.eye(3), point)
    angular_velocity = generator.normal(size=3)
    velocity = generator.normal(size=3)
    at_link = velocity + np.cross(angular_velocity, frame[:3, 3] - point)
    velocity_of_link = np.concatenate(
        [frame[:3, :3].T @ at_link, frame[:3, :3].T @ angular_velocity]
    )
    velocity_of_hull = np.concatenate([velocity, angular_velocity])
    assert velocity_of_hull @ moved.linear @ velocity_of_hull == pytest.approx(
        velocity_of_link @ matrix @ velocity_of_link
    )
    assert velocity_of_hull @ moved.added_mass @ velocity_of_hull == pytest.approx(
        velocity_of_link @ matrix @ velocity_of_link
    )
