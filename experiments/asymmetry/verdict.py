"""Whether a remedy removes enough of what pitch does to a mission, as far as its runs can tell.

An estimate that is captured on the wrong side of the leader's axis is a matter of its own: how often that happens, and
how large the error is in runs to which it does not happen, are judged apart. For either, let r_i be what happens to run
i behind the real leader, l_i behind the level one, a_i with the remedy and b_i behind a level leader with the same
equipment, or simply l_i: its mean error, or 1 if it is captured and 0 if not. A remedy meets its aim if it removes the
share q of what pitch adds,

    mean(d) ≤ 0,    d_i = (a_i − b_i) − (1 − q)(r_i − l_i).

All arms of a run share their noise, so that d_i is a paired difference; errors are compared in runs that no arm of the
comparison captures. Met: the whole interval of mean(d) is at or below zero; missed: it is wholly above; open: neither.
Where the first runs do not show that pitch does harm, there is nothing that a remedy could remove.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from enum import Enum

from experiments.intervals import Interval, bootstrap_mean, difference_of_shares
from laisn.arrays import Bools, Floats

WRONG = 0.025
"""Chance, at most, that a remedy which just misses its aim is called met, and the same the other way round."""
_NOMINAL = 0.015
"""Chance that the limits are asked for: those of a bootstrap over 64 skewed runs are crossed half as often again."""


class Verdict(Enum):
    """Judgement of one remedy on one mission."""

    MET = "met"
    OPEN = "open"
    MISSED = "missed"
    NO_HARM = "no harm shown"


def _judge(
    part: Floats, left: Floats, wanted: float, looks: Sequence[int], interval: Callable[[Floats, int, float], Interval]
) -> Verdict:
    """Judge by `interval`, of values of the first so many runs with a confidence, after each look until it is settled.

    Each look has its part of `_NOMINAL`.
    """
    if not interval(part, looks[0], 1.0 - 2.0 * WRONG).low > 0.0:
        return Verdict.NO_HARM
    for runs in (look for look in looks if look <= part.size):
        rest = interval(left - (1.0 - wanted) * part, runs, 1.0 - 2.0 * _NOMINAL / len(looks))
        if rest.high <= 0.0:
            return Verdict.MET
        if rest.low > 0.0:
            return Verdict.MISSED
    return Verdict.OPEN


def judge_errors(part: Floats, left: Floats, free: Bools, wanted: float, looks: Sequence[int]) -> Verdict:
    """Judge errors of runs without capture, by bootstrap over the runs.

    Args:
        part: pitch-driven error of each run without the remedy, r − l, shape (R,), [m].
        left: with it, a − b, likewise.
        free: runs that no arm captures, shape (R,).
        wanted: share q that the remedy should remove.
        looks: numbers of runs after which to judge, increasing; those above R are still to be flown.
    """

    def interval(values: Floats, runs: int, confidence: float) -> Interval:
        return bootstrap_mean(values[:runs], free[:runs], confidence)

    return _judge(part, left, wanted, looks, interval)


def judge_captures(part: Floats, left: Floats, wanted: float, looks: Sequence[int]) -> Verdict:
    """Judge captures; arguments as of `judge_errors`, differences of 0 and 1 instead of errors."""
    return _judge(part, left, wanted, looks, lambda values, runs, level: difference_of_shares(values[:runs], level))


def counts(verdicts: Iterable[Verdict]) -> tuple[int, int, int, int]:
    """How many are met, open and missed, and on how many missions no harm is shown."""
    number = Counter(verdicts)
    met, undecided, missed, harmless = (number[verdict] for verdict in Verdict)
    return met, undecided, missed, harmless
