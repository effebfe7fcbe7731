"""Thrusters: range, sense and what of their plugin is not used."""

from pathlib import Path

import numpy as np
import pytest

from tests.sim.gazebo.imported import PROBE, changed, import_text, refusal

LIMITS = "<max_thrust_cmd>60</max_thrust_cmd><min_thrust_cmd>-40</min_thrust_cmd>"
JOINT = "<joint_name>screw_joint</joint_name>"
POSE = "<pose>-0.8 0 0 0 0 0</pose>"
CHILD = "<child>screw</child>"
AXIS = "<axis><xyz>1 0 0</xyz></axis>"


def test_a_joint_that_is_turned_round_pushes_where_gazebo_says(tmp_path: Path) -> None:
    """An axis of −x, turned by a pose of π: 0 to 300 N ahead."""
    text = changed(
        PROBE,
        (CHILD, f"{CHILD}<pose>0 0 0 0 3.141592653589793 0</pose>"),
        (AXIS, "<axis><xyz>-1 0 0</xyz></axis>"),
        (LIMITS, "<max_thrust_cmd>300</max_thrust_cmd><min_thrust_cmd>0</min_thrust_cmd>"),
    )
    screw = import_text(tmp_path, text).effector("screw")
    np.testing.assert_allclose(screw["force"], (1.0, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(screw["limits"], (0.0, 300.0))


def test_a_thruster_that_pushes_astern_is_turned_with_its_range(tmp_path: Path) -> None:
    hull = import_text(tmp_path, changed(PROBE, (AXIS, "<axis><xyz>-1 0 0</xyz></axis>")))
    np.testing.assert_allclose(hull.effector("screw")["force"], (1.0, 0.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(hull.effector("screw")["limits"], (-60.0, 40.0))
    assert hull.says("thruster 'screw_joint'", "ahead here, astern in Gazebo")


@pytest.mark.parametrize(
    ("limits", "expected", "words"),
    [
        ("<max_thrust_cmd>60</max_thrust_cmd>", (-60, 60), ["min_thrust_cmd -60 N", "±1000"]),
        ("<min_thrust_cmd>-30</min_thrust_cmd>", (-30, 30), ["max_thrust_cmd 30 N"]),
        ("", (-50, 50), ["max_thrust_cmd 50 N and min_thrust_cmd -50 N", "±1000"]),
        (
            "<max_thrust_cmd>-1</max_thrust_cmd><min_thrust_cmd>1</min_thrust_cmd>",
            (-50, 50),
            ["max_thrust_cmd is below min_thrust_cmd", "neither is used"],
        ),
    ],
)
def test_limits_that_are_missing_are_assumed_and_named(
    tmp_path: Path, limits: str, expected: tuple[float, float], words: list[str]
) -> None:
    hull = import_text(tmp_path, changed(PROBE, (LIMITS, limits)))
    np.testing.assert_allclose(hull.effector("screw")["limits"], expected)
    assert hull.says(*words), hull.notes


def test_a_large_hull_gets_the_thrust_that_it_needs(tmp_path: Path) -> None:
    """1.5 m/s against 1 u + 400 u|u|: 901.5 N."""
    text = changed(PROBE, (LIMITS, ""), ("<xUabsU>-4</xUabsU>", "<xUabsU>-400</xUabsU>"))
    np.testing.assert_allclose(import_text(tmp_path, text).effector("screw")["limits"][1], 901.5)


@pytest.mark.parametrize(("coefficient", "expected"), [(0.02, (-3.2, 7.2)), (-0.02, (-7.2, 3.2))])
def test_a_command_of_rotation_becomes_the_thrust_of_its_rate(
    tmp_path: Path, coefficient: float, expected: tuple[float, float]
) -> None:
    """K_T ρ D⁴ ω|ω| at −40 and 60 rad/s, with 0.02, 1000 kg/m³ and 0.1 m."""
    elements = (
        f"<use_angvel_cmd>true</use_angvel_cmd><thrust_coefficient>{coefficient}"
        "</thrust_coefficient><propeller_diameter>0.1</propeller_diameter><deadband>3</deadband>"
    )
    hull = import_text(tmp_path, changed(PROBE, (LIMITS, LIMITS + elements)))
    np.testing.assert_allclose(hull.effector("screw")["limits"], expected, rtol=1e-9)
    assert hull.says("deadband of 3 N", "not modelled")
    assert hull.says("commanded in Gazebo by its rate of rotation")
    assert not hull.says("<thrust_coefficient>", "not used")


def test_every_element_that_is_not_used_is_named(tmp_path: Path) -> None:
    tags = [
        "namespace",
        "topic",
        "thrust_coefficient",
        "fluid_density",
        "propeller_diameter",
        "velocity_control",
        "p_gain",
        "i_gain",
        "d_gain",
        "wake_fraction",
        "alpha_1",
        "alpha_2",
        "battery_name",
        "power_load",
        "made_up",
    ]
    elements = "".join(f"<{tag}>1</{tag}>" for tag in tags)
    hull = import_text(tmp_path, changed(PROBE, (LIMITS, LIMITS + elements)))
    for tag in tags:
        assert hull.says("Thruster:", f"<{tag}>", "not used"), tag
    assert hull.says("Thruster: <made_up> is not used")


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        ((JOINT, "<joint_name>none</joint_name>"), "no <joint name='none'> with a child link"),
        (
            (LIMITS, "<max_thrust_cmd>0</max_thrust_cmd><min_thrust_cmd>0</min_thrust_cmd>"),
            "max_thrust_cmd must be above min_thrust_cmd",
        ),
        (("systems::Thruster", "systems::Sail"), "has no Thruster plugin"),
    ],
)
def test_thrusters_that_cannot_push_are_refused(
    tmp_path: Path, pair: tuple[str, str], words: str
) -> None:
    assert words in refusal(tmp_path, changed(PROBE, pair))


def test_a_nose_at_minus_x_turns_the_body_round(tmp_path: Path) -> None:
    hull = import_text(tmp_path, changed(PROBE, (POSE, "<pose>0.8 0.1 0 0 0 0</pose>")))
    assert hull.says("the nose is taken to be at −x")
    np.testing.assert_allclose(hull.effector("screw")["place"], (-0.8, -0.1, 0.0), atol=1e-9)
