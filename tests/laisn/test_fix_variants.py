"""How three pairs become one fix: every combination of what pairs can be, against definitions in
words.
"""

import itertools

import numpy as np
import pytest

from laisn.estimates import FixKind
from laisn.fix import CHOOSE_PAIR, Fix, Pairs, laisn_2, laisn_3_2, laisn_best, laisn_main
from laisn.geometry import Point

NOWHERE = Point(0.0, 0.0)


def kinds_of_pairs() -> list[list[tuple[FixKind, float, float]]]:
    """Kind, separation and σp: clear points, near and far; one point; two that are too close;
    none; lost.
    """
    clear, wider = (FixKind.TWO_POINTS, 2.0, 0.05), (FixKind.TWO_POINTS, 4.0, 0.025)
    others = (FixKind.TANGENT, -1.0, 0.0), (FixKind.ASTERN, 0.05, 0.0), (FixKind.ASTERN, -1.0, 0.0)
    lost = (FixKind.LOST, -1.0, 0.0)
    return [list(three) for three in itertools.product((clear, wider, *others, lost), repeat=3)]


def pairs_of(three: list[tuple[FixKind, float, float]]) -> Pairs:
    """Fixes in different places; those that are lost are nowhere."""
    made = [
        Fix(
            *((np.nan, np.nan) if kind == FixKind.LOST else (3.0 + i, -2.0 * i * i)),
            sigma,
            float(kind),
            separation,
        )
        for i, (kind, separation, sigma) in enumerate(three)
    ]
    return made[0], made[1], made[2]


def received(pairs: Pairs) -> list[Fix]:
    return [fix for fix in pairs if fix.kind != FixKind.LOST]


def meets(fix: Fix) -> bool:
    return fix.kind == FixKind.TANGENT or fix.separation >= 0.0


def assert_is(actual: Fix, expected: Fix) -> None:
    np.testing.assert_array_equal(actual, expected)


def check(three: list[tuple[FixKind, float, float]]) -> None:
    """Section 2.3 of the paper; among equals the earlier pair, and where none will do the first
    that was received.
    """
    pairs = pairs_of(three)
    there = received(pairs)
    assert_is(laisn_2(pairs, NOWHERE), pairs[0])
    if not there:
        for variant in CHOOSE_PAIR:
            assert CHOOSE_PAIR[variant](pairs, NOWHERE).kind == FixKind.LOST
        return
    # the most certain one: one point, else the widest two
    best = max(there, key=lambda fix: np.inf if fix.kind == FixKind.TANGENT else fix.separation)
    assert_is(laisn_best(pairs, NOWHERE), best)
    # the main pair, or the first of which the points are clear
    clear = [fix for fix in there if fix.kind != FixKind.ASTERN]
    assert_is(laisn_main(pairs, NOWHERE), clear[0] if clear else there[0])
    # the mean of those that meet, with weights 1 / (1 + σ)
    used = [fix for fix in there if meets(fix)] or there[:1]
    place = np.average(
        [[fix.east, fix.north] for fix in used],
        axis=0,
        weights=[1 / (1 + fix.sigma) for fix in used],
    )
    fused = laisn_3_2(pairs, NOWHERE)
    np.testing.assert_allclose((fused.east, fused.north), place, rtol=1e-14)
    assert fused.sigma == pytest.approx(sum(fix.sigma for fix in pairs) / 3)
    assert fused.kind == (FixKind.FUSED if len(used) > 1 else used[0].kind)
    assert fused.separation == -1.0


def test_one_fix_of_three() -> None:
    for three in kinds_of_pairs():
        check(three)
