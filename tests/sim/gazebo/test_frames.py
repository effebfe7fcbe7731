"""Poses and axes by SDF's rules, through the command, against positions and axes by hand."""

from pathlib import Path

import numpy as np
import pytest

from tests.sim.gazebo.imported import PROBE, changed, import_text, refusal

POSE = "<pose>-0.8 0 0 0 0 0</pose>"
AXIS = "<axis><xyz>1 0 0</xyz></axis>"
CHILD = "<child>screw</child>"
QUARTER_TURN = "1.5707963267948966"
PLACEHOLDER = "<!-- more parts -->"  # where tests add elements to the probe


@pytest.mark.parametrize(
    ("pairs", "position"),
    [
        ([(POSE, '<pose relative_to="hull">-0.8 0 0 0 0 0</pose>')], (-0.8, 0, 0)),
        ([(POSE, '<pose relative_to="__model__">-0.8 0 0 0 0 0</pose>')], (-0.8, 0, 0)),
        (
            # a frame at (−0.7, 0.1, 0), turned by 90°: its x is the model's y
            [
                (POSE, '<pose relative_to="tail">0.2 0.1 0 0 0 0</pose>'),
                (
                    PLACEHOLDER,
                    f'<frame name="tail"><pose>-0.7 0.1 0 0 0 {QUARTER_TURN}</pose></frame>',
                ),
            ],
            (-0.8, 0.3, 0),
        ),
        (
            # relative to what it is attached to, which stands at (−0.4, 0, 0)
            [
                (POSE, '<pose relative_to="tail">-0.2 0 0 0 0 0</pose>'),
                (
                    PLACEHOLDER,
                    '<frame name="half"><pose>-0.4 0 0 0 0 0</pose></frame>'
                    '<frame name="tail" attached_to="half"><pose>-0.2 0 0 0 0 0</pose></frame>',
                ),
            ],
            (-0.8, 0, 0),
        ),
        ([(POSE, '<pose degrees="true">-0.8 0 0.1 0 0 180</pose>')], (-0.8, 0, 0.1)),
    ],
)
def test_a_link_stands_where_its_pose_says(
    tmp_path: Path, pairs: list[tuple[str, str]], position: tuple[float, float, float]
) -> None:
    hull = import_text(tmp_path, changed(PROBE, *pairs))
    np.testing.assert_allclose(hull.effector("screw")["place"], position, atol=1e-9)


@pytest.mark.parametrize(
    ("pairs", "axis"),
    [
        # by the poses of link and joint, and the axis in the joint's frame
        ([(CHILD, f"{CHILD}<pose>0 0 0 0 0 {QUARTER_TURN}</pose>")], (0, 1, 0)),
        (
            [
                (POSE, f"<pose>-0.8 0 0 0 0 {QUARTER_TURN}</pose>"),
                (CHILD, f'{CHILD}<pose degrees="true">0 0 0 90 0 0</pose>'),
                (AXIS, "<axis><xyz>0 1 0</xyz></axis>"),
            ],
            # turned by 90° about x, y becomes z, which the link's yaw does not change
            (0, 0, 1),
        ),
        (
            [
                (POSE, f"<pose>-0.8 0 0 0 0 {QUARTER_TURN}</pose>"),
                (AXIS, '<axis><xyz expressed_in="__model__">1 0 0</xyz></axis>'),
            ],
            (1, 0, 0),
        ),
        (
            [
                (POSE, f"<pose>-0.8 0 0 0 0 {QUARTER_TURN}</pose>"),
                (AXIS, '<axis><xyz expressed_in="hull">0 2 0</xyz></axis>'),
            ],
            (0, 1, 0),
        ),
        (
            [
                (POSE, f"<pose>-0.8 0 0 0 0 {QUARTER_TURN}</pose>"),
                (
                    AXIS,
                    "<axis><xyz>1 0 0</xyz><use_parent_model_frame>1</use_parent_model_frame>"
                    "</axis>",
                ),
            ],
            (1, 0, 0),
        ),
        (
            # before SDF 1.5, axes were always in the model's frame
            [
                ('version="1.9"', 'version="1.4"'),
                (POSE, f"<pose>-0.8 0 0 0 0 {QUARTER_TURN}</pose>"),
            ],
            (1, 0, 0),
        ),
        (
            [
                (
                    POSE,
                    '<pose rotation_format="quat_xyzw">-0.8 0 0 0 0 0.7071067811865476 '
                    "0.7071067811865476</pose>",
                )
            ],
            (0, 1, 0),
        ),
        ([(AXIS, "")], (0, 0, 1)),
    ],
)
def test_an_axis_is_turned_by_link_joint_and_frame(
    tmp_path: Path, pairs: list[tuple[str, str]], axis: tuple[float, float, float]
) -> None:
    hull = import_text(tmp_path, changed(PROBE, *pairs))
    np.testing.assert_allclose(hull.effector("screw")["force"], axis, atol=1e-9)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([(POSE, '<pose relative_to="hulk">0 0 0 0 0 0</pose>')], "has no frame 'hulk'"),
        (
            [(POSE, '<pose relative_to="screw_joint">0 0 0 0 0 0</pose>')],
            "the pose of 'screw' is relative to itself",
        ),
        ([(POSE, "<pose>-0.8 0 0</pose>")], "<pose> of 'screw': expected 6 numbers"),
        ([(AXIS, "<axis><xyz>0 0 0</xyz></axis>")], "<axis> of joint 'screw_joint' must not be"),
        (
            [(PLACEHOLDER, '<link name="screw"/>')],
            "model 'probe': two elements have the name 'screw'",
        ),
    ],
)
def test_frames_that_cannot_be_resolved_are_refused(
    tmp_path: Path, pairs: list[tuple[str, str]], words: str
) -> None:
    assert words in refusal(tmp_path, changed(PROBE, *pairs))


def test_parts_of_nested_models_count(tmp_path: Path) -> None:
    """A ballast of 2 kg at (0.5, 0.2, 0): the nested model at (0.4, 0.1, 0), turned by 90°."""
    nested = (
        f'<model name="pack"><pose>0.4 0.1 0 0 0 {QUARTER_TURN}</pose>'
        '<link name="ballast"><pose>0.1 -0.1 0 0 0 0</pose>'
        "<inertial><mass>2</mass></inertial></link>"
        '</model><joint name="hold" type="fixed"><parent>hull</parent><child>pack::ballast</child>'
        "</joint>"
    )
    hull = import_text(tmp_path, changed(PROBE, (PLACEHOLDER, nested)))
    assert hull.mass == pytest.approx(42.0)
    centre = (2 * np.array([0.5, 0.2, 0.0]) + 0.01 * np.array([-0.8, 0.0, 0.0])) / 42.0
    np.testing.assert_allclose(hull.centre, centre, atol=1e-9)
