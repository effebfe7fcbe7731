"""Fixes of every variant, on geometry that can be worked by hand.

The leader lies at the origin and heads east: P1 = (−1, 0), P2 = (1, 0), P3 = (0, 0.1).
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laisn import fix
from laisn.estimates import FixKind
from laisn.fix import Circles
from laisn.messages import LeaderMessage, Ranges, Reception
from laisn.settings import VARIANTS, NavigationSettings

P = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.1]])
EAST = np.pi / 2
SETTINGS = NavigationSettings()
PREDICTED = NavigationSettings(side_rule="predicted")


def heard(*radius: float) -> Circles:
    return Circles(P, radius, EAST, 0.0)  # type: ignore[arg-type]


def exact(x: float, y: float) -> Circles:
    """Error-free ranges from (x, y)."""
    return heard(*np.hypot(*(P - [x, y]).T).tolist())


@given(x=st.floats(-90, 90), y=st.floats(1.0, 90), port=st.booleans())
@pytest.mark.parametrize("variant", fix.SINGLE)
def test_error_free_ranges_give_the_true_place(variant: str, x: float, y: float, port: bool) -> None:
    """From 1 m off the axes all pairs are clear (T = 0.1 m) unless the follower is on the axis of a small pair."""
    y = y if port else -y
    pairs = [fix.pair_fix(pair, exact(x, y), (x, y), SETTINGS) for pair in fix.PAIRS]
    clear = all(p is not None and p.clear for p in pairs)
    if variant in ("laisn-2", "laisn-main") or clear:
        found = fix.SINGLE[variant](exact(x, y), (x, y), SETTINGS)
        # conditioning: rounding of D² ~ 1e-12 m² over the half-chord of a small pair, a decimetre at least
        np.testing.assert_allclose(found.position, (x, y), atol=1e-7)
        assert found.kind is (FixKind.FUSED if variant == "laisn-3-2" else FixKind.TWO_POINTS)


def test_sigma_is_beta_over_separation() -> None:
    found = fix.laisn_2(exact(0.0, 20.0), (0.0, 19.0), SETTINGS)
    np.testing.assert_allclose(found.position, (0, 20))
    assert found.sigma == pytest.approx(0.1 / 40)
    assert found.kind is FixKind.TWO_POINTS


def test_the_nearer_intersection_is_taken() -> None:
    assert fix.laisn_2(exact(3.0, 20.0), (3.0, -1.0), SETTINGS).position[1] == pytest.approx(-20)


def test_no_intersection_snaps_astern() -> None:
    """|D2 − D1| > L: the follower is put D1 behind P1."""
    found = fix.laisn_2(heard(30.0, 32.5, 31.0), (-31.0, 2.0), SETTINGS)
    assert found == fix.Fix((-31.0, 0.0), 0.0, FixKind.ASTERN)


def test_intersections_closer_than_t_snap_astern() -> None:
    found = fix.laisn_2(exact(-30.0, 0.04), (-30.0, 0.04), SETTINGS)
    assert found.kind is FixKind.ASTERN
    np.testing.assert_allclose(found.position, (-1 - np.hypot(29, 0.04), 0))
    assert fix.laisn_2(exact(-30.0, 0.06), (-30.0, 0.06), SETTINGS).kind is FixKind.TWO_POINTS


def test_one_intersection_is_certain() -> None:
    found = fix.laisn_2(heard(3.0, 5.0, 4.0), (-4.0, 1.0), SETTINGS)
    assert found == fix.Fix((-4.0, 0.0), 0.0, FixKind.TANGENT)


def test_a_follower_ahead_is_snapped_behind_as_published_and_ahead_with_the_other_rule() -> None:
    circles = heard(32.2, 30.0, 31.0)
    behind = fix.laisn_2(circles, (31.0, 1.0), SETTINGS)
    np.testing.assert_allclose(behind.position, (-33.2, 0))
    ahead = fix.laisn_2(circles, (31.0, 1.0), PREDICTED)
    np.testing.assert_allclose(ahead.position, (31.0, 0))
    still_behind = fix.laisn_2(heard(30.0, 32.2, 31.0), (-31.0, 1.0), PREDICTED)
    np.testing.assert_allclose(still_behind.position, (-31.0, 0))


def test_snap_of_every_pair_uses_its_own_axis() -> None:
    """Eq. 23: from P1 against P3 − P1 for (1, 3), from P2 against P2 − P3 for (2, 3)."""
    circles = heard(30.0, 40.0, 20.0)
    along_13 = np.array([1.0, 0.1]) / np.hypot(1.0, 0.1)
    along_32 = np.array([1.0, -0.1]) / np.hypot(1.0, 0.1)
    snapped = [fix.pair_fix(pair, circles, (-9.0, 0.0), SETTINGS) for pair in fix.PAIRS]
    positions = [s.fix.position for s in snapped if s is not None]
    np.testing.assert_allclose(positions[0], (-31.0, 0.0))
    np.testing.assert_allclose(positions[1], P[0] - 30.0 * along_13)
    np.testing.assert_allclose(positions[2], P[1] - 40.0 * along_32)


def test_laisn_3_2_weighs_pairs_by_their_certainty() -> None:
    """Eqs. 24 and 25 by hand: pair (1, 2) and (2, 3) meet, (1, 3) does not."""
    circles = heard(20.0, 20.5, 21.5)
    predicted = (0.0, 20.0)
    pairs = [fix.pair_fix(pair, circles, predicted, SETTINGS) for pair in fix.PAIRS]
    met = [p.fix for p in pairs if p is not None and p.n_points > 0]
    assert [p.n_points for p in pairs if p is not None] == [2, 0, 2]
    weights = [1 / (1 + 0.1 / p.separation) for p in pairs if p is not None and p.n_points > 0]
    expected = sum(w * np.array(f.position) for w, f in zip(weights, met, strict=True)) / sum(weights)
    found = fix.laisn_3_2(circles, predicted, SETTINGS)
    np.testing.assert_allclose(found.position, expected)
    assert found.sigma == pytest.approx(sum(f.sigma for f in met) / 3)
    assert found.kind is FixKind.FUSED


@pytest.mark.parametrize("variant", ["laisn-3-2", "laisn-best", "laisn-main"])
def test_three_transmitter_variants_snap_on_the_main_axis_if_no_pair_meets(variant: str) -> None:
    found = fix.SINGLE[variant](heard(30.0, 33.0, 31.4), (-31.0, 1.0), SETTINGS)
    assert found == fix.Fix((-31.0, 0.0), 0.0, FixKind.ASTERN)


def test_best_baseline_takes_the_pair_with_the_widest_intersections() -> None:
    circles = heard(20.0, 20.5, 20.0)
    pairs = [fix.pair_fix(pair, circles, (0.0, 20.0), SETTINGS) for pair in fix.PAIRS]
    widest = max((p for p in pairs if p is not None), key=lambda p: p.separation)
    assert fix.laisn_best(circles, (0.0, 20.0), SETTINGS) == widest.fix


def test_main_baseline_yields_only_where_it_is_not_clear() -> None:
    clear = heard(20.0, 20.5, 20.1)
    assert fix.laisn_main(clear, (0.0, 20.0), SETTINGS) == fix.laisn_2(clear, (0.0, 20.0), SETTINGS)
    unclear = heard(20.0, 22.5, 20.1)
    second = fix.pair_fix(fix.PAIRS[1], unclear, (0.0, 20.0), SETTINGS)
    assert second is not None
    assert second.clear
    assert fix.laisn_main(unclear, (0.0, 20.0), SETTINGS) == second.fix


def test_missing_ranges() -> None:
    without_front = heard(20.0, np.nan, 20.1)
    assert fix.laisn_2(without_front, (0.0, 20.0), SETTINGS).kind is FixKind.LOST
    only_13 = fix.pair_fix(fix.PAIRS[1], without_front, (0.0, 20.0), SETTINGS)
    assert only_13 is not None
    for variant in ("laisn-best", "laisn-main"):
        assert fix.SINGLE[variant](without_front, (0.0, 20.0), SETTINGS) == only_13.fix
    fused = fix.laisn_3_2(without_front, (0.0, 20.0), SETTINGS)
    np.testing.assert_allclose(fused.position, only_13.fix.position)
    assert fused.sigma == pytest.approx(only_13.fix.sigma / 3)
    nothing = heard(np.nan, np.nan, 20.1)
    for variant in fix.SINGLE:
        assert fix.SINGLE[variant](nothing, (0.0, 20.0), SETTINGS).kind is FixKind.LOST


def _reception(pitch: float, dz: float, x: float, y: float) -> tuple[LeaderMessage, Ranges, Reception]:
    """What a leader at 8 m depth, pitched by that angle and heading east, sends to a follower dz deeper."""
    half, rise = np.cos(pitch), np.sin(pitch)
    sites = np.array([[-half, 0, -rise], [half, 0, rise], [0, 0.1, 0]])
    ranges = np.linalg.norm(sites - [x, y, -dz], axis=1)
    return LeaderMessage(0.0, 0.0, 0.0, EAST, 1.0, 8.0, pitch, 0.0), Ranges(*ranges.tolist())


@pytest.mark.parametrize(("pitch_deg", "error"), [(5.0, 0.87), (15.0, 2.6)])
def test_pitch_shifts_a_fix_abeam_by_dz_sin_phi(pitch_deg: float, error: float) -> None:
    """laisn-2 with a level leader at Δz = 10 m, and none of it with the broadcast attitude."""
    pitch = np.deg2rad(pitch_deg)
    message, ranges = _reception(pitch, 10.0, 0.0, 40.0)
    level = fix.circles(Reception(message, ranges), 18.0, SETTINGS)
    found = fix.laisn_2(level, (0.0, 40.0), SETTINGS)
    off = np.hypot(found.position[0], found.position[1] - 40.0)
    assert off == pytest.approx(10.0 * np.sin(pitch), rel=0.02)
    assert off == pytest.approx(error, rel=0.02)
    aware = fix.circles(Reception(message, ranges), 18.0, NavigationSettings(use_attitude=True))
    np.testing.assert_allclose(fix.laisn_2(aware, (0.0, 40.0), SETTINGS).position, (0, 40), atol=1e-9)


def test_hydrophone_above_the_depth_sensor_is_allowed_for() -> None:
    message, ranges = _reception(0.0, 10.0, 0.0, 40.0)
    circles = fix.circles(Reception(message, ranges), 18.3, NavigationSettings(hydrophone_height=0.3))
    np.testing.assert_allclose(circles.radius, np.hypot(*(P - [0, 40]).T))
    assert circles.depth_difference == pytest.approx(10.0)


def test_effective_sigma() -> None:
    found = fix.Fix((0.0, 0.0), 0.003, FixKind.TWO_POINTS)
    deep = Circles(P, (1.0, 1.0, 1.0), EAST, 10.0)
    assert fix.effective_sigma(found, deep, SETTINGS) == 0.003
    assert fix.effective_sigma(found, deep, NavigationSettings(sigma_floor=0.2)) == 0.2
    inflated = fix.effective_sigma(found, deep, NavigationSettings(expected_pitch=0.1))
    assert inflated == pytest.approx(np.hypot(0.003, 10 * np.sin(0.1)))


def test_every_variant_has_an_implementation() -> None:
    assert set(VARIANTS) == set(fix.SINGLE) | {"laisn-3-1"}
