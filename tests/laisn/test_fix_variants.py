"""How three pairs become one fix: every combination of kinds of pairs, against independent
definitions.
"""

import itertools

import numpy as np
import pytest

from laisn.estimates import FixKind
from laisn.fix import CHOOSE_PAIR, Fix, Pairs, laisn_2, laisn_3_2, laisn_best, laisn_main
from laisn.geometry import Point

PREDICTED = Point(0.0, 0.0)


def kinds_of_pairs() -> list[list[tuple[FixKind, float, float]]]:
    """Kind, separation and σp: clear points, near and far; one point; two that are too close;
    none; lost.
    """
    clear, wider = (FixKind.TWO_POINTS, 2.0, 0.05), (FixKind.TWO_POINTS, 4.0, 0.025)
    others = (FixKind.TANGENT, -1.0, 0.0), (FixKind.ASTERN, 0.05, 0.0), (FixKind.ASTERN, -1.0, 0.0)
    lost = (FixKind.LOST, -1.0, 0.0)
    return [list(kinds) for kinds in itertools.product((clear, wider, *others, lost), repeat=3)]


def pairs_of(kinds: list[tuple[FixKind, float, float]]) -> Pairs:
    """Fixes at different positions; those of lost pairs are NaN."""
    fixes = [
        Fix(
            *((np.nan, np.nan) if kind == FixKind.LOST else (3.0 + i, -2.0 * i * i)),
            sigma,
            float(kind),
            separation,
        )
        for i, (kind, separation, sigma) in enumerate(kinds)
    ]
    return fixes[0], fixes[1], fixes[2]


def received_fixes(pairs: Pairs) -> list[Fix]:
    return [fix for fix in pairs if fix.kind != FixKind.LOST]


def has_intersection(fix: Fix) -> bool:
    return fix.kind == FixKind.TANGENT or fix.separation >= 0.0


def require_equal(actual: Fix, expected: Fix) -> None:
    np.testing.assert_array_equal(actual, expected)


def require_definitions(kinds: list[tuple[FixKind, float, float]]) -> None:
    """Section 2.3 of the paper; of equal pairs the earlier one, and without an intersection the
    first pair that was received.
    """
    pairs = pairs_of(kinds)
    received = received_fixes(pairs)
    require_equal(laisn_2(pairs, PREDICTED), pairs[0])
    if not received:
        for variant in CHOOSE_PAIR:
            assert CHOOSE_PAIR[variant](pairs, PREDICTED).kind == FixKind.LOST
        return
    # the most certain one: one point, else the widest two
    best = max(received, key=lambda fix: np.inf if fix.kind == FixKind.TANGENT else fix.separation)
    require_equal(laisn_best(pairs, PREDICTED), best)
    # the main pair, or the first of which the points are clear
    clear = [fix for fix in received if fix.kind != FixKind.ASTERN]
    require_equal(laisn_main(pairs, PREDICTED), clear[0] if clear else received[0])
    # the mean of those that meet, with weights 1 / (1 + σ)
    fused_fixes = [fix for fix in received if has_intersection(fix)] or received[:1]
    position = np.average(
        [[fix.east, fix.north] for fix in fused_fixes],
        axis=0,
        weights=[1 / (1 + fix.sigma) for fix in fused_fixes],
    )
    fused = laisn_3_2(pairs, PREDICTED)
    np.testing.assert_allclose((fused.east, fused.north), position, rtol=1e-14)
    assert fused.sigma == pytest.approx(sum(fix.sigma for fix in pairs) / 3)
    assert fused.kind == (FixKind.FUSED if len(fused_fixes) > 1 else fused_fixes[0].kind)
    assert fused.separation == -1.0


def test_every_variant_makes_one_fix_of_three_as_the_paper_defines_it() -> None:
    for kinds in kinds_of_pairs():
        require_definitions(kinds)
