"""Included models: merged, nested, renamed, and those that are not on this machine."""

from pathlib import Path

import numpy as np
import pytest

from tests.sim.gazebo.imported import PROBE, changed, import_file, import_text, refusal

MODEL = PROBE[PROBE.index("<model") : PROBE.index("</model>") + len("</model>")]
PLACEHOLDER = "<!-- more parts -->"  # where tests add elements to the probe


def test_a_missing_include_is_named(tmp_path: Path) -> None:
    include = "<include><uri>model://battery</uri></include>"
    hull = import_text(tmp_path, changed(PROBE, (PLACEHOLDER, include)))
    assert hull.mass == pytest.approx(40.0)
    assert hull.says("<include> of 'model://battery'", "not on this machine", "gz sdf -p")


def test_an_include_beside_the_file_is_read(tmp_path: Path) -> None:
    """A pack of 2 kg whose frame 'grip' is placed at (0.5, 0, 0): its cells are at (0.7, 0, 0), and
    the screw of 0.01 kg at (−0.8, 0, 0).
    """
    folder = tmp_path / "pack"
    folder.mkdir()
    (folder / "model.config").write_text(
        '<model><name>pack</name><sdf version="1.6">pack-1_6.sdf</sdf></model>', encoding="utf-8"
    )
    (folder / "pack-1_6.sdf").write_text(
        '<sdf version="1.6"><model name="pack"><pose>9 9 9 0 0 0</pose>'
        '<frame name="grip"><pose>0 0 0.1 0 0 0</pose></frame>'
        '<link name="cells"><pose>0.2 0 0.1 0 0 0</pose>'
        "<inertial><mass>2</mass></inertial></link></model></sdf>",
        encoding="utf-8",
    )
    include = (
        "<include><uri>model://pack</uri><name>left_pack</name><pose>0.5 0 0 0 0 0</pose>"
        "<placement_frame>grip</placement_frame></include>"
        '<joint name="hold" type="fixed"><parent>hull</parent><child>left_pack::cells</child>'
        "</joint>"
    )
    hull = import_text(tmp_path, changed(PROBE, (PLACEHOLDER, include)))
    assert hull.mass == pytest.approx(42.0)
    np.testing.assert_allclose(hull.centre, ((1.4 - 0.008) / 42.0, 0.0, 0.0), atol=1e-9)
    assert not hull.says("not on this machine")


def test_a_merged_model_is_the_same_hull_turned(tmp_path: Path) -> None:
    """As LRAUVs are: plugins beside an <include merge="true"> with a pose, in a world."""
    plugins = MODEL[MODEL.index("<plugin") : MODEL.rindex("</plugin>") + len("</plugin>")]
    folder = tmp_path / "models" / "probe"
    folder.mkdir(parents=True)
    without_plugins = MODEL.replace(plugins, "")
    (folder / "model.sdf").write_text(
        f'<sdf version="1.9">{without_plugins}</sdf>', encoding="utf-8"
    )
    equipped = tmp_path / "models" / "equipped"
    equipped.mkdir()
    text = (
        '<sdf version="1.9"><model name="equipped"><include merge="true">'
        '<pose degrees="true">1 2 0 0 0 -90</pose><uri>probe</uri>'
        "<experimental:params><sensor action='add'/></experimental:params>"
        f"{plugins}</include></model></sdf>"
    )
    hull = import_text(equipped, text)
    plain = import_text(tmp_path, PROBE)
    assert hull.says("the hull lies along y", "nose is taken to be at −y")
    for name in ("added_mass", "linear_damping", "quadratic_damping"):
        np.testing.assert_allclose(hull.record[name], plain.record[name], atol=1e-6)
    np.testing.assert_allclose(hull.effector("screw")["place"], (-0.8, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(hull.effector("screw")["force"], (1.0, 0.0, 0.0), atol=1e-9)
    world = tmp_path / "world.sdf"
    world.write_text(
        '<sdf version="1.9"><world name="sea"><include><uri>model://models/equipped</uri>'
        "</include></world></sdf>",
        encoding="utf-8",
    )
    assert import_file(world).text == hull.text


def test_parts_of_a_merged_model_that_name_it_stand_in_it(tmp_path: Path) -> None:
    """A pack of a litre at 0.3 m in its model, which is merged at 0.5 m, beside the probe's 40
    litres; in it stands a pod that is turned to port and pushes along its own x.
    """
    folder = tmp_path / "pack"
    folder.mkdir()
    cells = (
        '<link name="cells"><pose>0.2 0 0 0 0 0</pose><inertial><mass>1</mass></inertial>'
        '<collision name="box"><pose relative_to="__model__">0.3 0 0 0 0 0</pose>'
        "<geometry><box><size>0.1 0.1 0.1</size></box></geometry></collision></link>"
    )
    inertial = "<inertial><mass>0.001</mass></inertial>"
    pod = (
        '<model name="pod"><pose degrees="true">0 0 0 0 0 90</pose>'
        f'<link name="base">{inertial}</link><link name="blade">{inertial}</link>'
        '<joint name="pod_screw" type="revolute"><parent>base</parent><child>blade</child>'
        '<axis><xyz expressed_in="__model__">1 0 0</xyz></axis></joint>'
        '<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">'
        "<joint_name>pod_screw</joint_name><max_thrust_cmd>9</max_thrust_cmd></plugin></model>"
    )
    (folder / "model.sdf").write_text(
        f'<sdf version="1.9"><model name="pack">{cells}{pod}</model></sdf>', encoding="utf-8"
    )
    include = '<include merge="true"><uri>pack</uri><pose>0.5 0 0 0 0 0</pose></include>'
    hull = import_text(tmp_path, changed(PROBE, (PLACEHOLDER, include)))
    centre = (0.5 + 0.3) * 0.001 / 0.041
    np.testing.assert_allclose(hull.record["buoyancy_centre"], (centre, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(hull.effector("pod_screw")["force"], (0.0, 1.0, 0.0), atol=1e-9)


def test_a_model_that_includes_itself_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "loop"
    folder.mkdir()
    inner = '<sdf version="1.9"><model name="loop"><include><uri>loop</uri></include></model></sdf>'
    (folder / "model.sdf").write_text(inner, encoding="utf-8")
    text = changed(PROBE, (PLACEHOLDER, "<include><uri>loop</uri></include>"))
    assert "nested more than 10 deep" in refusal(tmp_path, text)
