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

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from typing import NamedTuple

from scipy.special import ndtri

from experiments.intervals import Interval, difference_of_shares, mean_interval
from laisn.arrays import Bools, Floats

WRONG = 0.025
"""Chance, at most, that a remedy which just misses its aim is called met, and the same the other way round."""
_OF_ERRORS, _OF_CAPTURES = 0.015, 0.01
"""Chances that the limits are asked for: limits over 64 skewed runs may be crossed half as often again, and those
of rare captures twice as often and more."""


class Verdict(Enum):
    """Judgement of one remedy on one mission."""

    MET = "met"
    OPEN = "open"
    MISSED = "missed"
    NO_HARM = "no harm shown"


class Judgement(NamedTuple):
    """A verdict and what it rests on."""

    verdict: Verdict
    runs: int
    """Number of runs after which it fell, or on which the question is still open."""
    promising: bool
    """The question is open, and more runs, up to the last look, would settle it if the mean stayed about as it is."""
    needed: float = math.nan
    """Runs that would settle a question that is open, if mean and scatter stayed as they are; else NaN."""


_REACH = 0.5
"""Standard errors by which the mean of d may yet move when it is asked whether more runs would settle a question."""


def _within_reach(rest: Interval, confidence: float, share: float) -> bool:
    """Whether an open question would be settled by the plan's last run if the mean stayed about where it is.

    Args:
        rest: the interval of mean(d) so far.
        confidence: of that interval.
        share: of the runs of the plan that it rests on.
    """
    slack = _REACH / float(ndtri((1.0 + confidence) / 2.0))
    up, down = rest.high - rest.value, rest.value - rest.low
    still = math.sqrt(share)
    return rest.value - slack * down + still * up <= 0.0 or rest.value + slack * up - still * down > 0.0


def _runs_needed(rest: Interval, runs: int) -> float:
    """Runs after which an open question would be settled if mean and scatter stayed as they are.

    An interval of many runs is symmetric about the mean, and shrinks with the square root of their number.
    """
    return runs * ((rest.high - rest.low) / (2.0 * rest.value)) ** 2 if rest.value else math.inf


def _judge(
    part: Floats, left: Floats, wanted: float, looks: Sequence[int],
    interval: Callable[[Floats, int, float], Interval], chance: float,
) -> Judgement:  # fmt: skip
    """Judge by `interval`, of values of the first so many runs with a confidence, after each look until it is settled.

    Each look has its part of the chance.
    """
    if not interval(part, looks[0], 1.0 - 2.0 * WRONG).low > 0.0:
        return Judgement(Verdict.NO_HARM, looks[0], False)
    confidence = 1.0 - 2.0 * chance / len(looks)
    runs, promising, needed = looks[0], False, math.nan
    for runs in (look for look in looks if look <= part.size):
        rest = interval(left - (1.0 - wanted) * part, runs, confidence)
        if rest.high <= 0.0:
            return Judgement(Verdict.MET, runs, False)
        if rest.low > 0.0:
            return Judgement(Verdict.MISSED, runs, False)
        promising = runs < looks[-1] and _within_reach(rest, confidence, runs / looks[-1])
        needed = _runs_needed(rest, runs)
    return Judgement(Verdict.OPEN, runs, promising, needed)


def judge_errors(part: Floats, left: Floats, free: Bools, wanted: float, looks: Sequence[int]) -> Judgement:
    """Judge errors of runs without capture, by an interval over the runs.

    Args:
        part: pitch-driven error of each run without the remedy, r − l, shape (R,), [m].
        left: with it, a − b, likewise.
        free: runs that no arm captures, shape (R,).
        wanted: share q that the remedy should remove.
        looks: numbers of runs after which to judge, increasing; those above R are still to be flown.
    """

    def interval(values: Floats, runs: int, confidence: float) -> Interval:
        return mean_interval(values[:runs], free[:runs], confidence)

    return _judge(part, left, wanted, looks, interval, _OF_ERRORS)


def judge_captures(part: Floats, left: Floats, wanted: float, looks: Sequence[int]) -> Judgement:
    """Judge captures; arguments as of `judge_errors`, differences of 0 and 1 instead of errors."""

    def interval(values: Floats, runs: int, confidence: float) -> Interval:
        return difference_of_shares(values[:runs], confidence)

    return _judge(part, left, wanted, looks, interval, _OF_CAPTURES)


def counts(verdicts: Iterable[Verdict]) -> tuple[int, int, int, int]:
    """How many are met, open and missed, and on how many missions no harm is shown."""
    number = Counter(verdicts)
    met, undecided, missed, harmless = (number[verdict] for verdict in Verdict)
    return met, undecided, missed, harmless
