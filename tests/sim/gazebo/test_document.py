"""Files that are read as Gazebo reads them, and those that are refused, with what converts them."""

from pathlib import Path

import pytest

from laisn.errors import COLUMNS, ROWS, LaisnError
from sim.gazebo.document import DEEPEST, Parameters, Remarks, parse, read_document
from tests.sim.gazebo.imported import PROBE, changed, import_text, refusal


def test_prefixes_need_no_declaration(tmp_path: Path) -> None:
    """Gazebo's parser knows no namespaces."""
    sensor = '<sensor name="log" type="custom" gz:type="dvl"><gz:dvl/></sensor></link>'
    first_link = "</collision>\n      </link>"
    hull = import_text(tmp_path, changed(PROBE, (first_link, f"</collision>{sensor}")))
    assert hull.mass == pytest.approx(40.0)
    assert hull.says("sensors of links (1) are not read")


def test_a_name_of_any_length_leaves_a_note_readable(tmp_path: Path) -> None:
    plugin = f'<plugin filename="a" name="{"x" * 5000}"/></model>'
    hull = import_text(tmp_path, changed(PROBE, ("</model>", plugin)))
    (note,) = (note for note in hull.notes if "plugins that are not read" in note)
    assert "xxx…xxx" in note
    assert len(f"note: {note}") == COLUMNS * ROWS // 2


def test_deep_and_large_files_are_refused_at_once(tmp_path: Path) -> None:
    """Reading ends where the bound is passed: 100,000 levels took minutes, and are not closed."""
    deep = "<sdf>" + "<a>" * 100_000
    assert f"nested more than {DEEPEST} deep" in refusal(tmp_path, deep)
    with pytest.raises(LaisnError, match="more than 200000 elements"):
        read_document("<sdf>" + "<a/>" * 200_001 + "</sdf>")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<sdf>", "no valid SDF: no element found"),
        ('<!DOCTYPE sdf [<!ENTITY a "b">]><sdf/>', "it declares entities"),
        ("<mujoco/>", "its root is <mujoco>, expected <sdf>"),
        ("<robot name='a'/>", "URDF, not SDF: gz sdf -p model.urdf > model.sdf converts it"),
        (
            "<robot xmlns:xacro='http://www.ros.org/wiki/xacro' name='a'/>",
            "a xacro file, not SDF: xacro FILE > model.urdf, then gz sdf -p",
        ),
        (
            "<robot name='a'><gazebo><plugin filename='libuuv_underwater_object_ros_plugin.so'/>"
            "</gazebo></robot>",
            "its coefficients are those of uuv_simulator",
        ),
        ("<sdf version='1.9'/>", "has no <model> with links and a Hydrodynamics plugin"),
        (
            "<sdf><model name='a'><link name='b'/>"
            "<plugin filename='libuuv_underwater_object_ros_plugin.so'/></model></sdf>",
            "write <added_mass>, <linear_damping> and <quadratic_damping> as xDotU, xU, xUabsU",
        ),
        (
            "<sdf><world name='w'><include><uri>https://fuel.example/Tethys</uri></include></world>"
            "</sdf>",
            "<include> of https://fuel.example/Tethys is not on this machine: gz sdf -p",
        ),
    ],
)
def test_what_is_no_sdf_is_refused_with_advice(tmp_path: Path, text: str, words: str) -> None:
    assert words in refusal(tmp_path, text)


def test_the_first_of_doubled_elements_counts(tmp_path: Path) -> None:
    """As `Get` of sdformat."""
    twice = "<xUabsU>-4</xUabsU><xUabsU>-9</xUabsU>"
    hull = import_text(tmp_path, changed(PROBE, ("<xUabsU>-4</xUabsU>", twice)))
    assert hull.matrix("quadratic")[0, 0] == pytest.approx(4.0)
    assert hull.says("<xUabsU> stands 2 times; as in Gazebo, the first counts (-4)")


def test_each_child_that_is_not_asked_for_is_remarked() -> None:
    remarks = Remarks()
    parameters = Parameters(parse("<p><a>1</a><b/><c/><d> true </d></p>"), "Kind", remarks)
    assert parameters.number("a", 2.0) == 1.0
    assert parameters.number("e", 2.0) == 2.0
    assert parameters.flag("d")
    parameters.set_aside(["b", "z"], "reason")
    parameters.remark_unused()
    assert remarks.sentences() == ["Kind: <b> is not used (reason)", "Kind: <c> is not used"]


def test_parts_with_the_same_remark_share_a_sentence() -> None:
    remarks = Remarks()
    remarks.add_for_part("link", "a", "is late")
    remarks.add("all is well")
    remarks.add_for_part("link", "b", "is late")
    assert remarks.sentences() == ["link 'a', 'b': is late", "all is well"]
