"""Fins of LiftDrag: sense, law of forces, range, and the density of their fluid."""

from pathlib import Path

import numpy as np
import pytest

from sim.vehicle.effector_kinds import BUILT_IN, foil_force
from sim.vehicle.effectors import force_limits, state_for
from tests.sim.gazebo.imported import PROBE, changed, import_text, refusal

LIMIT = "<limit><lower>-0.26</lower><upper>0.2</upper></limit>"
PLUGIN = (
    '<plugin filename="f" name="gz::sim::systems::LiftDrag"><link_name>fin</link_name>'
    "<air_density>1000</air_density><area>0.02</area><cla>4</cla><cda>0.1</cda>"
    "<cla_stall>-1</cla_stall><cda_stall>0.5</cda_stall><alpha_stall>0.17</alpha_stall>"
    "<a0>0.1</a0><upward>0 0 1</upward><forward>1 0 0</forward></plugin>"
)
FIN = (
    '<link name="fin"><pose>-0.7 0 0 0 0 0</pose><inertial><mass>0</mass></inertial></link>'
    '<joint name="hinge" type="revolute"><parent>hull</parent><child>fin</child>'
    f"<axis><xyz>0 1 0</xyz>{LIMIT}</axis></joint>{PLUGIN}"
)
WITH_FIN = changed(PROBE, ("<!-- more parts -->", FIN))


def force(fin: object, angle: float, velocity: tuple[float, float, float]) -> np.ndarray:
    """Of a fin at a deflection [rad] in water of 1000 kg/m³, forward, to port and up [N]."""
    return np.array(foil_force(fin, 1000.0, angle, velocity))


def test_incidence_at_no_deflection_lifts(tmp_path: Path) -> None:
    """½ 1000 · 0.02 · 4 · 0.1 · 1² = 4 N up, drag ½ 1000 · 0.02 · 0.1 · 0.1 = 0.1 N."""
    fin = import_text(tmp_path, WITH_FIN).effector("fin")
    np.testing.assert_allclose(force(fin, 0.0, (1.0, 0.0, 0.0)), (-0.1, 0.0, 4.0), atol=1e-9)


def test_a_positive_angle_turns_about_the_joints_axis(tmp_path: Path) -> None:
    """About +y the leading edge goes down: less lift by ½ 1000 · 0.02 · 4 · 0.05."""
    fin = import_text(tmp_path, WITH_FIN).effector("fin")
    assert force(fin, 0.05, (1.0, 0.0, 0.0))[2] == pytest.approx(4.0 - 2.0)
    reversed_axis = changed(WITH_FIN, ("<xyz>0 1 0</xyz>", "<xyz>0 -1 0</xyz>"))
    reversed_fin = import_text(tmp_path, reversed_axis).effector("fin")
    assert force(reversed_fin, 0.05, (1.0, 0.0, 0.0))[2] == pytest.approx(4.0 + 2.0)
    joint_turned_round = changed(
        WITH_FIN,
        ("<child>fin</child>", '<child>fin</child><pose degrees="true">0 0 0 180 0 0</pose>'),
    )
    assert force(import_text(tmp_path, joint_turned_round).effector("fin"), 0.05, (1.0, 0.0, 0.0))[
        2
    ] == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("velocity", "expected"),
    [
        # beyond the stall angle: incidence 0.1 + 0.2, lift 4 · 0.17 − 0.13, drag 0.017 + 0.065
        ((np.cos(0.2), 0.0, -np.sin(0.2)), (0.55, 0.082)),
        # from above: −0.3 + 0.1, lift −(0.68 − 0.03), drag 0.017 + 0.015
        ((np.cos(0.3), 0.0, np.sin(0.3)), (-0.65, 0.032)),
    ],
)
def test_lift_and_drag_beyond_the_stall_angle(
    tmp_path: Path, velocity: tuple[float, float, float], expected: tuple[float, float]
) -> None:
    """Lift across the flow, drag along it, 10 N at a coefficient of 1 and 1 m/s."""
    fin = import_text(tmp_path, WITH_FIN).effector("fin")
    flow_direction = np.array(velocity)
    lift_direction = np.array([-flow_direction[2], 0.0, flow_direction[0]])
    actual = force(fin, 0.0, velocity)
    assert actual @ lift_direction == pytest.approx(10.0 * expected[0])
    assert actual @ flow_direction == pytest.approx(-10.0 * expected[1])


def test_sweep_and_flow_from_behind_take_lift(tmp_path: Path) -> None:
    """In a flow at 30° to the chord, along the span, pressure and coefficients each have the
    squared cosine as a factor; a flow from behind gives no force unless the fin is reversible.
    """
    hull = import_text(tmp_path, WITH_FIN)
    fin = hull.effector("fin")
    swept = force(fin, 0.0, (np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0))
    assert swept[2] == pytest.approx(4.0 * np.cos(np.pi / 6) ** 4)
    np.testing.assert_array_equal(force(fin, 0.0, (-1.0, 0.0, 0.0)), 0.0)
    np.testing.assert_array_equal(force(fin, 0.0, (0.005, 0.0, 0.0)), 0.0)
    both_ways = changed(WITH_FIN, ("<a0>", "<reversible>true</reversible><a0>"))
    reversible_fin = import_text(tmp_path, both_ways).effector("fin")
    # at 180° the incidence is a0, and the lift is across the reversed flow
    assert force(reversible_fin, 0.0, (-1.0, 0.0, 0.0))[2] == pytest.approx(-4.0)


def test_the_autopilot_knows_the_incidence_at_no_deflection(tmp_path: Path) -> None:
    """The deflection that is computed for a force gives it."""
    fin = import_text(tmp_path, WITH_FIN).effector("fin")
    for required_force in (-2.0, 0.0, 3.0):
        deflection = state_for(BUILT_IN, fin, 1000.0, required_force, 1.0)
        # a positive force of the fin is down, since its joint turns the leading edge down
        up = force(fin, deflection, (1.0, 0.0, 0.0))[2]
        assert -up == pytest.approx(required_force, abs=1e-9)
    # 40 N a radian: up by the stall angle of 0.17, down by the upper limit of 0.2 less a0 = 0.1
    low, high = force_limits(BUILT_IN, fin, 1000.0, 1.0)
    assert low == pytest.approx(40.0 * -0.17)
    assert high == pytest.approx(40.0 * 0.1)


@pytest.mark.parametrize(
    "limit",
    [
        "",
        "<limit><lower>-1e+16</lower><upper>1e+16</upper></limit>",
        "<limit><lower>-inf</lower><upper>inf</upper></limit>",
    ],
)
def test_no_limit_is_read_and_an_angle_assumed(tmp_path: Path, limit: str) -> None:
    hull = import_text(tmp_path, changed(WITH_FIN, (LIMIT, limit)))
    np.testing.assert_allclose(hull.effector("fin")["limits"], (-0.35, 0.35))
    assert hull.says("joint 'hinge': no limit", "±0.35 rad is assumed")


def test_a_fin_in_air_has_the_forces_of_air(tmp_path: Path) -> None:
    """Without <air_density>, LiftDrag takes 1.2041 kg/m³."""
    hull = import_text(tmp_path, changed(WITH_FIN, ("<air_density>1000</air_density>", "")))
    lift = force(hull.effector("fin"), 0.0, (1.0, 0.0, 0.0))[2]
    assert lift == pytest.approx(4.0 * 1.2041e-3, rel=1e-6)
    assert hull.says("LiftDrag of 'fin': no air_density", "1.2041 kg/m³")


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (("<a0>", "<cma>0.1</cma><cm_delta>1</cm_delta><a0>"), ["<cma>, <cm_delta> are not used"]),
        (("<a0>", "<radial_symmetry>1</radial_symmetry><a0>"), ["radial_symmetry is not used"]),
        (
            ("<a0>", "<control_joint_name>hinge</control_joint_name><a0>"),
            ["control_joint_name", "not modelled"],
        ),
        (("<a0>", "<spare>1</spare><a0>"), ["LiftDrag: <spare> is not used"]),
        (
            ("<forward>1 0 0", "<forward>-1 0 0"),
            ["<forward> points astern", "taken as pointing ahead"],
        ),
        (
            ("<upper>0.2</upper>", "<upper>0.2</upper><velocity>1</velocity>"),
            ["joints of fins: <velocity>"],
        ),
        (
            ("<xyz>0 1 0</xyz>", "<xyz>0 1 1</xyz>"),
            ["joint 'hinge' does not turn it about its span"],
        ),
    ],
)
def test_elements_of_a_fin_that_are_not_used_are_named(
    tmp_path: Path, pair: tuple[str, str], words: list[str]
) -> None:
    hull = import_text(tmp_path, changed(WITH_FIN, pair))
    assert hull.says(*words), hull.notes
    assert "fin" in hull.plant.effector_names[0]


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (("<upward>0 0 1", "<upward>1 0 0"), ["LiftDrag of 'fin': left out", "<upward> is along"]),
        (("<forward>1 0 0", "<forward>0 1 0"), ["left out", "<forward> is not along the hull"]),
        (("<cla>4</cla>", "<cla>0</cla>"), ["left out", "cla is 0 and its area 0.02 m²"]),
    ],
)
def test_a_fin_without_lift_or_with_unusable_axes_is_left_out_with_a_note(
    tmp_path: Path, pair: tuple[str, str], words: list[str]
) -> None:
    hull = import_text(tmp_path, changed(WITH_FIN, pair))
    assert hull.says(*words), hull.notes
    assert hull.plant.effector_names[0] == ("screw",)


def test_a_fin_without_a_joint_that_turns_is_fixed(tmp_path: Path) -> None:
    hull = import_text(
        tmp_path, changed(WITH_FIN, ('name="hinge" type="revolute"', 'name="hinge" type="fixed"'))
    )
    (fin,) = hull.plant.fixed_fins[0]
    np.testing.assert_allclose(force(fin, 0.0, (1.0, 0.0, 0.0)), (-0.1, 0.0, 4.0), atol=1e-9)
    assert hull.plant.effector_names[0] == ("screw",)


def test_a_fin_of_a_missing_link_is_refused(tmp_path: Path) -> None:
    text = changed(WITH_FIN, ("<link_name>fin</link_name>", "<link_name>wing</link_name>"))
    assert "LiftDrag: there is no <link name='wing'>" in refusal(tmp_path, text)
