"""Whether a remedy removes enough of what pitch does to a mission, and whether its runs can tell.

A remedy meets its aim on a mission if it removes the wanted share q of the pitch-driven part of the mean error. With
the mean errors of run i behind the real leader r_i, behind the level one l_i, and with the remedy a_i, that is

    mean(d) ≤ 0,    d_i = (a_i − b_i) − (1 − q)(r_i − l_i),

b being the error behind a level leader with the same equipment, or simply l. All arms of a run share their noise, so
that d_i is a paired difference. Where few runs are captured on the wrong side of the leader's axis, one run more or
less decides on the mean; a one-sided t-test over the runs tells a failure from such a chance.
"""

from collections import Counter
from collections.abc import Iterable
from enum import Enum

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

Floats = npt.NDArray[np.float64]

FALSE_ALARM = 0.01
"""Chance that any of all missions together is called missed though the remedy meets its aim (Bonferroni)."""


class Verdict(Enum):
    """On one remedy and mission."""

    MET = "met"
    OPEN = "open: the runs cannot tell"
    MISSED = "missed"


def verdict(excess: Floats, left: Floats, wanted: float, missions: int = 1) -> Verdict:
    """Judge one mission.

    Args:
        excess: pitch-driven error of each run without the remedy, r − l, shape (R,), [m].
        left: with it, a − b, in the same order, [m].
        wanted: share q that the remedy should remove.
        missions: number of missions that are judged together.
    """
    kept = left - (1.0 - wanted) * excess
    mean, runs = float(kept.mean()), kept.size
    if mean <= 0.0:
        return Verdict.MET
    if runs < 2:
        return Verdict.OPEN
    spread = float(kept.std(ddof=1)) / np.sqrt(runs)
    bound = float(stdtrit(runs - 1, 1.0 - FALSE_ALARM / missions))
    return Verdict.MISSED if mean > bound * spread else Verdict.OPEN


def counts(verdicts: Iterable[Verdict]) -> tuple[int, int, int]:
    """How many are met, open and missed."""
    number = Counter(verdicts)
    return number[Verdict.MET], number[Verdict.OPEN], number[Verdict.MISSED]
