"""The variants of LAISN: how the fixes of three pairs of transmitters become the one fix of a message.

Each variant of `laisn.settings.Variant` is a function of the fixes of the pairs (1, 2), (1, 3) and (2, 3), and of the
prediction. LAISN-3(1) has none: it updates the filter with one pair after the other.
"""

from collections.abc import Callable

import numpy as np

from laisn.compiled import formula
from laisn.fix import ASTERN, FUSED, LOST, TANGENT, Fix
from laisn.geometry import Point
from laisn.settings import Variant

SEQUENTIAL: Variant = "laisn-3-1"
"""The variant that updates with one pair after the other (paper, Section 2.3.1)."""

Pairs = tuple[Fix, Fix, Fix]


@formula
def highest(pairs: Pairs, first: float, second: float, third: float) -> Fix:
    """The pair with the highest score of three, the earlier one among equals."""
    better = pairs[1] if second > first else pairs[0]
    return pairs[2] if third > (second if second > first else first) else better


@formula
def laisn_2(pairs: Pairs, predicted: Point) -> Fix:
    """Two transmitters (paper, Section 2.2)."""
    return pairs[0]


@formula
def _meets(fix: Fix) -> bool:
    return fix.separation >= 0.0 or fix.kind == TANGENT


@formula
def _weight(fix: Fix) -> float:
    """Weight of a pair whose circles meet; zero for others (paper, Eq. 25)."""
    return 1.0 / (1.0 + fix.sigma) if _meets(fix) else 0.0


@formula
def _weighted(weight: float, value: float) -> float:
    """Weight times value; nothing for a weight of zero, even where the value is NaN."""
    return weight * value if weight > 0.0 else 0.0


@formula
def laisn_3_2(pairs: Pairs, predicted: Point) -> Fix:
    """Weighted mean of the pairs whose circles meet, w_i = 1 / (1 + σp,i) (paper, Eqs. 24 and 25).

    If no pair's circles meet, the fix is P_D of the first pair that was received, (1, 2) if possible. The factor 1/3 of
    Eq. 25 is kept when fewer than three pairs contribute.
    """
    a, b, c = pairs
    w_a, w_b, w_c = _weight(a), _weight(b), _weight(c)
    none = w_a + w_b + w_c == 0.0
    several = (w_a > 0.0 and w_b + w_c > 0.0) or (w_b > 0.0 and w_c > 0.0)
    w_a = 1.0 if none and a.kind != LOST else w_a
    w_b = 1.0 if none and w_a == 0.0 and b.kind != LOST else w_b
    w_c = 1.0 if none and w_a + w_b == 0.0 and c.kind != LOST else w_c
    total = w_a + w_b + w_c
    per_total = 1.0 / (total if total > 0.0 else np.nan)
    only = a.kind if w_a > 0.0 else (b.kind if w_b > 0.0 else (c.kind if w_c > 0.0 else LOST))
    return Fix(
        (_weighted(w_a, a.east) + _weighted(w_b, b.east) + _weighted(w_c, c.east)) * per_total,
        (_weighted(w_a, a.north) + _weighted(w_b, b.north) + _weighted(w_c, c.north)) * per_total,
        (a.sigma + b.sigma + c.sigma) * (1.0 / 3.0),
        FUSED if several else only,
        -1.0,
    )


@formula
def _baseline_score(fix: Fix) -> float:
    """One intersection before all; then the separation of two (−1 for none); lost ranges last."""
    return np.inf if fix.kind == TANGENT else (-2.0 if fix.kind == LOST else fix.separation)


@formula
def laisn_best(pairs: Pairs, predicted: Point) -> Fix:
    """The most certain pair: N = 1, else the largest distance of intersections (Section 2.3.3), else the first P_D."""
    return highest(pairs, _baseline_score(pairs[0]), _baseline_score(pairs[1]), _baseline_score(pairs[2]))


@formula
def _usable_score(fix: Fix) -> float:
    """Clear intersections before none; lost ranges last."""
    return -2.0 if fix.kind == LOST else (0.0 if fix.kind == ASTERN else 1.0)


@formula
def laisn_main(pairs: Pairs, predicted: Point) -> Fix:
    """The main pair, or another where it is missing, does not meet, or meets too close (Section 2.3.3)."""
    return highest(pairs, _usable_score(pairs[0]), _usable_score(pairs[1]), _usable_score(pairs[2]))


SINGLE: dict[Variant, Callable[[Pairs, Point], Fix]] = {
    "laisn-2": laisn_2,
    "laisn-3-2": laisn_3_2,
    "laisn-best": laisn_best,
    "laisn-main": laisn_main,
}
