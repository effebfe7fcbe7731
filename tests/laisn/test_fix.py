"""Fixes of every variant, on geometry with hand calculations.

The leader lies at the origin and heads east: P1 = (−1, 0), P2 = (1, 0), P3 = (0, 0.1).
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laisn.estimates import FixKind
from laisn.fix import (
    CHOOSE_PAIR,
    Circle,
    Circles,
    Fix,
    RangeCircles,
    fix_variance,
    laisn_3_2,
    to_circles,
)
from laisn.geometry import Point, sin_cos_of
from laisn.messages import LeaderMessage, Ranges, Reception
from laisn.settings import LAISN_VARIANTS, NavigationSettings, Tuning

TRANSMITTERS = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.1]])
EAST = np.pi / 2
SETTINGS = NavigationSettings()
PREDICTED = NavigationSettings(side_rule="predicted")


def circles_of(*radius: float) -> RangeCircles:
    return RangeCircles(
        Circles(
            *(Circle(Point(*p), r) for p, r in zip(TRANSMITTERS.tolist(), radius, strict=True))
        ),
        sin_cos_of(EAST),
        0.0,
    )


def error_free(x: float, y: float) -> RangeCircles:
    """Error-free ranges from (x, y)."""
    return circles_of(*np.hypot(*(TRANSMITTERS - [x, y]).T).tolist())


def pair_fixes(
    circles: RangeCircles, predicted: tuple[float, float], settings: NavigationSettings = SETTINGS
) -> tuple[Fix, Fix, Fix]:
    """Fixes of the pairs (1, 2), (1, 3) and (2, 3)."""
    a, b, c = (
        circles.fix(pair, Point(*predicted), Tuning.of(settings)) for pair in circles.pairs()
    )
    return a, b, c


def fix_of(
    variant: str,
    circles: RangeCircles,
    predicted: tuple[float, float],
    settings: NavigationSettings = SETTINGS,
) -> Fix:
    """The fix of a variant."""
    return CHOOSE_PAIR[variant](pair_fixes(circles, predicted, settings), Point(*predicted))  # type: ignore[index]


def position_of(fix: Fix) -> tuple[float, float]:
    return fix.east, fix.north


@given(x=st.floats(-90, 90), y=st.floats(1.0, 90), port=st.booleans())
@pytest.mark.parametrize("variant", CHOOSE_PAIR)
def test_error_free_ranges_give_the_true_position(
    variant: str, x: float, y: float, port: bool
) -> None:
    """From 1 m off the axes all pairs are clear (T = 0.1 m) unless the follower is on the axis
    of a small pair.
    """
    y = y if port else -y
    all_clear = all(
        pair.kind == FixKind.TWO_POINTS for pair in pair_fixes(error_free(x, y), (x, y))
    )
    if variant in ("laisn-2", "laisn-main") or all_clear:
        actual = fix_of(variant, error_free(x, y), (x, y))
        # conditioning: rounding of D² ~ 1e-12 m² over the half-chord of a small pair, a decimetre
        # at least
        np.testing.assert_allclose(position_of(actual), (x, y), atol=1e-7)
        assert actual.kind == (FixKind.FUSED if variant == "laisn-3-2" else FixKind.TWO_POINTS)


def test_sigma_is_beta_over_separation() -> None:
    actual = fix_of("laisn-2", error_free(0.0, 20.0), (0.0, 19.0))
    np.testing.assert_allclose(position_of(actual), (0, 20), atol=1e-12)
    assert actual.sigma == pytest.approx(0.1 / 40)
    assert actual.kind == FixKind.TWO_POINTS


def test_the_nearer_intersection_is_taken() -> None:
    assert fix_of("laisn-2", error_free(3.0, 20.0), (3.0, -1.0)).north == pytest.approx(-20)


def test_no_intersection_snaps_astern() -> None:
    """|D2 − D1| > L: the follower is put D1 behind P1."""
    actual = fix_of("laisn-2", circles_of(30.0, 32.5, 31.0), (-31.0, 2.0))
    assert actual == Fix(-31.0, 0.0, 0.0, FixKind.ASTERN, -1.0)


def test_intersections_closer_than_t_snap_astern() -> None:
    actual = fix_of("laisn-2", error_free(-30.0, 0.04), (-30.0, 0.04))
    assert actual.kind == FixKind.ASTERN
    np.testing.assert_allclose(position_of(actual), (-1 - np.hypot(29, 0.04), 0))
    assert fix_of("laisn-2", error_free(-30.0, 0.06), (-30.0, 0.06)).kind == FixKind.TWO_POINTS


def test_one_intersection_is_certain() -> None:
    actual = fix_of("laisn-2", circles_of(3.0, 5.0, 4.0), (-4.0, 1.0))
    assert actual == Fix(-4.0, 0.0, 0.0, FixKind.TANGENT, -1.0)


def test_a_follower_ahead_is_snapped_behind_as_published_and_ahead_with_the_other_rule() -> None:
    circles = circles_of(32.2, 30.0, 31.0)
    behind = fix_of("laisn-2", circles, (31.0, 1.0))
    np.testing.assert_allclose(position_of(behind), (-33.2, 0))
    ahead = fix_of("laisn-2", circles, (31.0, 1.0), PREDICTED)
    np.testing.assert_allclose(position_of(ahead), (31.0, 0))
    still_behind = fix_of("laisn-2", circles_of(30.0, 32.2, 31.0), (-31.0, 1.0), PREDICTED)
    np.testing.assert_allclose(position_of(still_behind), (-31.0, 0))


def test_the_predicted_end_is_that_on_whose_side_of_the_pairs_middle_the_prediction_lies() -> None:
    circles = circles_of(32.2, 30.0, 31.0)
    assert position_of(fix_of("laisn-2", circles, (0.05, 3.0), PREDICTED)) == pytest.approx(
        (31.0, 0.0)
    )
    assert position_of(fix_of("laisn-2", circles, (-0.05, 3.0), PREDICTED)) == pytest.approx(
        (-33.2, 0.0)
    )
    # of the pair (1, 3), 1.005 m long on its own axis, the middle lies at (−0.5, 0.05)
    ahead, behind = (
        pair_fixes(circles_of(32.2, 30.0, 31.0), (-0.5 + s, 0.05), PREDICTED)[1]
        for s in (0.05, -0.05)
    )
    assert np.hypot(ahead.east, ahead.north - 0.1) == pytest.approx(31.0)
    assert np.hypot(behind.east + 1.0, behind.north) == pytest.approx(32.2)
    assert ahead.east > 0.0 > behind.east


def test_of_two_points_equally_near_the_one_to_port_is_taken() -> None:
    assert fix_of("laisn-2", error_free(3.0, -20.0), (3.0, 0.0)).north == pytest.approx(20.0)


def test_points_as_far_apart_as_t_are_clear() -> None:
    """Radii of 1.25 m about centres 2 m apart meet 1.5 m apart, which binary numbers have
    exactly.
    """
    circles = circles_of(1.25, 1.25, 1.0)
    for threshold, kind in ((1.5, FixKind.TWO_POINTS), (np.nextafter(1.5, 2.0), FixKind.ASTERN)):
        assert (
            fix_of("laisn-2", circles, (0.0, 1.0), NavigationSettings(threshold=threshold)).kind
            == kind
        )


def test_snap_of_every_pair_uses_its_own_axis() -> None:
    """Eq. 23: from P1 against P3 − P1 for (1, 3), from P2 against P2 − P3 for (2, 3)."""
    circles = circles_of(30.0, 40.0, 20.0)
    along_13 = np.array([1.0, 0.1]) / np.hypot(1.0, 0.1)
    along_32 = np.array([1.0, -0.1]) / np.hypot(1.0, 0.1)
    positions = [position_of(snapped) for snapped in pair_fixes(circles, (-9.0, 0.0))]
    np.testing.assert_allclose(positions[0], (-31.0, 0.0))
    np.testing.assert_allclose(positions[1], TRANSMITTERS[0] - 30.0 * along_13)
    np.testing.assert_allclose(positions[2], TRANSMITTERS[1] - 40.0 * along_32)


def test_laisn_3_2_weighs_pairs_by_their_certainty() -> None:
    """Eqs. 24 and 25 by hand: pair (1, 2) and (2, 3) meet, (1, 3) does not."""
    circles = circles_of(20.0, 20.5, 21.5)
    predicted = (0.0, 20.0)
    pair_12, pair_13, pair_23 = pair_fixes(circles, predicted)
    assert pair_13.separation == -1.0
    weights = [1 / (1 + 0.1 / met.separation) for met in (pair_12, pair_23)]
    expected = (
        weights[0] * np.array(position_of(pair_12)) + weights[1] * np.array(position_of(pair_23))
    ) / sum(weights)
    actual = fix_of("laisn-3-2", circles, predicted)
    np.testing.assert_allclose(position_of(actual), expected)
    assert actual.sigma == pytest.approx((pair_12.sigma + pair_23.sigma) / 3)
    assert actual.kind == FixKind.FUSED


@pytest.mark.parametrize("variant", ["laisn-3-2", "laisn-best", "laisn-main"])
def test_three_transmitter_variants_snap_on_the_main_axis_if_no_pair_meets(variant: str) -> None:
    actual = fix_of(variant, circles_of(30.0, 33.0, 31.4), (-31.0, 1.0))
    assert actual == Fix(-31.0, 0.0, 0.0, FixKind.ASTERN, -1.0)


def test_laisn_best_takes_the_pair_with_the_widest_intersections() -> None:
    circles = circles_of(20.0, 20.5, 20.0)
    widest = max(pair_fixes(circles, (0.0, 20.0)), key=lambda pair: pair.separation)
    assert fix_of("laisn-best", circles, (0.0, 20.0)) == widest


def test_laisn_main_takes_another_pair_only_where_the_main_one_is_not_clear() -> None:
    clear = circles_of(20.0, 20.5, 20.1)
    assert fix_of("laisn-main", clear, (0.0, 20.0)) == fix_of("laisn-2", clear, (0.0, 20.0))
    unclear = circles_of(20.0, 22.5, 20.1)
    second = pair_fixes(unclear, (0.0, 20.0))[1]
    assert second.kind == FixKind.TWO_POINTS
    assert fix_of("laisn-main", unclear, (0.0, 20.0)) == second


@pytest.mark.parametrize("crossing", [0, 1, 2])
@pytest.mark.parametrize("other", [FixKind.LOST, FixKind.ASTERN])
def test_a_pair_that_alone_has_an_intersection_is_the_fused_fix(
    crossing: int, other: FixKind
) -> None:
    """Position and kind are those of that pair; σp keeps the factor 1/3 (Eq. 25)."""
    pairs = [Fix(50.0 + i, -9.0, 0.0, float(other), -1.0) for i in range(3)]
    pairs[crossing] = Fix(3.0, 4.0, 0.6, float(FixKind.TWO_POINTS), 2.0)
    fused = laisn_3_2((pairs[0], pairs[1], pairs[2]), Point(0.0, 0.0))
    assert (fused.east, fused.north, fused.sigma) == pytest.approx((3.0, 4.0, 0.2))
    assert fused.kind == FixKind.TWO_POINTS
    assert fused.separation == -1.0


@pytest.mark.parametrize("received", [0, 1, 2])
def test_where_no_pair_has_an_intersection_the_first_that_was_received_is_taken(
    received: int,
) -> None:
    pairs = [Fix(np.nan, np.nan, 0.0, float(FixKind.LOST), -1.0)] * received
    pairs += [Fix(5.0 + i, -2.0, 0.0, float(FixKind.ASTERN), -1.0) for i in range(received, 3)]
    fused = laisn_3_2((pairs[0], pairs[1], pairs[2]), Point(0.0, 0.0))
    assert (fused.east, fused.north, fused.sigma) == (5.0 + received, -2.0, 0.0)
    assert fused.kind == FixKind.ASTERN


def test_with_missing_ranges_the_pairs_that_were_received_are_used() -> None:
    """Without the front range that is the pair (1, 3); with one range there is no fix."""
    without_front = circles_of(20.0, np.nan, 20.1)
    assert fix_of("laisn-2", without_front, (0.0, 20.0)).kind == FixKind.LOST
    only_13 = pair_fixes(without_front, (0.0, 20.0))[1]
    for variant in ("laisn-best", "laisn-main"):
        assert fix_of(variant, without_front, (0.0, 20.0)) == only_13
    fused = fix_of("laisn-3-2", without_front, (0.0, 20.0))
    np.testing.assert_allclose(position_of(fused), position_of(only_13))
    assert fused.sigma == pytest.approx(only_13.sigma / 3)
    assert fused.kind == FixKind.TWO_POINTS
    one_range = circles_of(np.nan, np.nan, 20.1)
    for variant in CHOOSE_PAIR:
        assert fix_of(variant, one_range, (0.0, 20.0)).kind == FixKind.LOST


def reception_of(
    pitch: float, depth_difference: float, east: float, north: float
) -> tuple[LeaderMessage, Ranges, Reception]:
    """Reception of a follower `depth_difference` below a pitched leader at 8 m that heads east."""
    forward, rise = np.cos(pitch), np.sin(pitch)
    sites = np.array([[-forward, 0, -rise], [forward, 0, rise], [0, 0.1, 0]])
    ranges = np.linalg.norm(sites - [east, north, -depth_difference], axis=1)
    return Reception(
        LeaderMessage(0.0, 0.0, 0.0, EAST, 1.0, 8.0, pitch, 0.0), Ranges(*ranges.tolist())
    )


@pytest.mark.parametrize(("pitch_deg", "error"), [(5.0, 0.87), (15.0, 2.6)])
def test_pitch_shifts_a_fix_abeam_by_dz_sin_phi(pitch_deg: float, error: float) -> None:
    """laisn-2 with a level leader at Δz = 10 m, and none of it with the broadcast attitude."""
    pitch = np.deg2rad(pitch_deg)
    reception = reception_of(pitch, 10.0, 0.0, 40.0)
    actual = fix_of("laisn-2", to_circles(reception, 18.0, SETTINGS), (0.0, 40.0))
    shift = np.hypot(actual.east, actual.north - 40.0)
    assert shift == pytest.approx(10.0 * np.sin(pitch), rel=0.02)
    assert shift == pytest.approx(error, rel=0.02)
    with_attitude = to_circles(reception, 18.0, NavigationSettings(use_attitude=True))
    np.testing.assert_allclose(
        position_of(fix_of("laisn-2", with_attitude, (0.0, 40.0))), (0, 40), atol=1e-9
    )


def test_hydrophone_above_the_depth_sensor_is_allowed_for() -> None:
    reception = reception_of(0.0, 10.0, 0.0, 40.0)
    range_circles = to_circles(reception, 18.3, NavigationSettings(hydrophone_height=0.3))
    np.testing.assert_allclose(
        [circle.radius for circle in range_circles.circles], np.hypot(*(TRANSMITTERS - [0, 40]).T)
    )
    assert range_circles.depth_difference == pytest.approx(10.0)


def test_circles_move_with_the_follower_since_each_ping_and_with_the_leader_until_it() -> None:
    """At 1 m/s to the east and pings half a second apart transmitters of the hull move by 0, 0.5
    and 1 m. Transmitters whose positions are received move with the follower alone.
    """
    reception = reception_of(0.0, 10.0, 0.0, 40.0)
    displacement = np.array([[0.3, 2.0], [0.2, 1.5], [0.1, 1.0]])
    settings = NavigationSettings(ping_slot=0.5)
    of_hull = to_circles(reception, 18.0, settings, displacement).circles
    np.testing.assert_allclose(
        [circle.centre for circle in of_hull],
        TRANSMITTERS + displacement + [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]],
        atol=1e-12,
    )
    transmitters = np.column_stack([TRANSMITTERS + 7.0, [8.0, 8.0, 8.0]])
    of_given_transmitters = to_circles(
        reception._replace(transmitters=transmitters), 18.0, settings, displacement
    ).circles
    np.testing.assert_allclose(
        [circle.centre for circle in of_given_transmitters],
        TRANSMITTERS + 7.0 + displacement,
        atol=1e-12,
    )
    expected = np.hypot(*(TRANSMITTERS - [0, 40]).T)
    for circles in (of_hull, of_given_transmitters):
        np.testing.assert_allclose([circle.radius for circle in circles], expected)


def test_variance_of_a_fix() -> None:
    """σp², not below the floor, and (Δz sin φ)² for an expected pitch φ."""

    def deviation(**settings: float) -> float:
        return float(np.sqrt(fix_variance(0.003, 10.0, Tuning.of(NavigationSettings(**settings)))))  # type: ignore[arg-type]

    assert deviation() == 0.003
    assert deviation(sigma_floor=0.2) == 0.2
    assert deviation(expected_pitch=0.1) == pytest.approx(np.hypot(0.003, 10 * np.sin(0.1)))


def test_every_variant_has_a_formula() -> None:
    assert set(LAISN_VARIANTS) == {*CHOOSE_PAIR, "laisn-3-1"}
