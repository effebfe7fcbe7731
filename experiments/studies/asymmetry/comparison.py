"""Results of the pitch study: rows by mission and arm, arms compared run by run, and verdicts on remedies.

Errors and mirror locks (estimates at the mirror image beyond the leader's axis) are judged separately. For either, let
r_i be the outcome of run i behind the real leader, l_i behind the level one, a_i with the remedy and b_i behind a level
leader with the same equipment, or simply l_i: its mean error, or 1 if it is locked and 0 if not. A remedy meets its aim
if it removes the share q of what pitch adds,

    mean(d) ≤ 0,    d_i = (a_i − b_i) − (1 − q)(r_i − l_i).

All arms of a run share their noise, so that d_i is a paired difference; errors are compared in runs that no arm of the
comparison has locked. Met: the whole interval of mean(d) is at or below zero; missed: it is wholly above; open:
neither. Where the first runs do not show that pitch adds anything, there is nothing that a remedy could remove.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtri

from experiments import intervals
from experiments.campaign.store import Record
from experiments.intervals import CONFIDENCE, Interval
from experiments.studies.asymmetry.design import LEVEL, LEVEL_BROADCAST, READINGS, REAL, REMEDIES, Arm
from laisn.arrays import Bools, Floats

WRONG = 0.025
"""Chance, at most, that a remedy which just misses its aim is called met, and the same the other way round."""
_OF_ERRORS, _OF_LOCKS = 0.015, 0.01
"""Confidence of the limits: limits over 64 skewed runs may be crossed half as often again, and those
of rare mirror locks twice as often and more."""
_REACH = 0.5
"""Standard errors by which the mean of d may yet move in the estimate of how many runs would settle a question."""
JUDGED_FROM_M = 0.1
"""Remedies are judged on missions in which pitch moves a noiseless fix by this much or more in the mean. That follows
from the motion alone, independently of the runs."""
LOCKS_WANTED = 0.9
"""Share of the mirror locks that pitch adds which any remedy should remove: a run is locked or not, so that 99 % of
them would take thousands of runs to tell."""
Question = Literal["error", "mirror_lock"]
QUESTIONS: tuple[Question, ...] = ("error", "mirror_lock")
"""What a remedy is judged by: errors of runs without mirror lock, and mirror locks."""
OF_RUNS: Mapping[Question, str] = {"error": "e_p_run_mean_m", "mirror_lock": "mirror_locked_run"}
"""Columns of a row with a value for each run: mean E_P [m], and whether it was locked on the mirror image."""
JUDGEMENTS = (*((arm, LEVEL) for arm in REMEDIES), (READINGS, LEVEL_BROADCAST))
"""Remedies, and what each is compared with."""


class Verdict(StrEnum):
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
    promising: bool = False
    """The question is open, and more runs, up to the last look, would settle it if the mean stayed about as it is."""
    needed: float = math.nan
    """Runs that would settle a question that is open, if mean and scatter stayed as they are; else NaN."""


def _within_reach(rest: Interval, confidence: float, share: float) -> bool:
    """Whether the plan's last run would settle an open question, from the interval after a share of the plan's runs."""
    slack = _REACH / float(ndtri((1.0 + confidence) / 2.0))
    up, down = rest.high - rest.value, rest.value - rest.low
    still = math.sqrt(share)
    return rest.value - slack * down + still * up <= 0.0 or rest.value + slack * up - still * down > 0.0


def judge(part: Floats, left: Floats, wanted: float, looks: Sequence[int], free: Bools | None = None) -> Judgement:
    """Judge after each look until the question is settled; each look has its part of the chance of a wrong verdict.

    Args:
        part: what pitch adds to each run without the remedy, r − l, shape (R,): errors [m], or mirror locks (−1, 0, 1).
        left: with it, a − b, likewise.
        wanted: share q that the remedy should remove.
        looks: numbers of runs after which to judge, increasing; those above R are still to be flown.
        free: runs that count, of errors; None: mirror locks, of which all do.
    """

    def interval(values: Floats, runs: int, confidence: float) -> Interval:
        if free is None:
            return intervals.difference_of_shares(values[:runs], confidence)
        return intervals.mean_interval(values[:runs], free[:runs], confidence)

    if not interval(part, looks[0], 1.0 - 2.0 * WRONG).low > 0.0:
        return Judgement(Verdict.NO_HARM, looks[0])
    confidence = 1.0 - 2.0 * (_OF_LOCKS if free is None else _OF_ERRORS) / len(looks)
    judgement = Judgement(Verdict.OPEN, looks[0])
    for runs in (look for look in looks if look <= part.size):
        rest = interval(left - (1.0 - wanted) * part, runs, confidence)
        if rest.high <= 0.0 or rest.low > 0.0:
            return Judgement(Verdict.MET if rest.high <= 0.0 else Verdict.MISSED, runs)
        promising = runs < looks[-1] and _within_reach(rest, confidence, runs / looks[-1])
        # an interval of many runs is symmetric about the mean, and shrinks with the square root of their number
        needed = runs * ((rest.high - rest.low) / (2.0 * rest.value)) ** 2 if rest.value else math.inf
        judgement = Judgement(Verdict.OPEN, runs, promising, needed)
    return judgement


@dataclass(frozen=True, kw_only=True)
class ComparedMission:
    """One mission of one variant in all its arms: rows by the keys of the arms."""

    arms: Mapping[str, Record]

    @property
    def real(self) -> Record:
        """Behind the leader that pitches."""
        return self.arms[REAL.key]

    @property
    def added(self) -> float:
        """What pitch adds to the mean position error, locked runs included [m]."""
        return float(self.real["e_p_mean_m"] - self.arms[LEVEL.key]["e_p_mean_m"])

    @property
    def judged(self) -> bool:
        """Whether remedies are judged on this mission."""
        return bool(self.real["fix_error_m"] >= JUDGED_FROM_M)

    @property
    def lever(self) -> float:
        """Δz sin φ, both root mean square [m]."""
        return float(self.real["depth_offset_rms_m"] * np.sin(np.deg2rad(self.real["pitch_rms_deg"])))

    def first_runs(self, arm: Arm, question: Question = "error") -> Floats:
        """Mean error [m], or 1 if locked, of each of the first runs, shape (R,)."""
        return np.array(self.arms[arm.key][OF_RUNS[question]][: self.real["runs"]], dtype=np.float64)

    def compared(self, question: Question, arm: Arm, base: Arm = LEVEL) -> tuple[Floats, Floats, Bools]:
        """What pitch adds to each run, what a remedy leaves of it, and the runs that no arm of the comparison locks."""
        rows = [self.arms[one.key] for one in (REAL, LEVEL, arm, base)]
        runs = min(len(row[OF_RUNS[question]]) for row in rows)
        locked, outcomes = (
            np.array([row[OF_RUNS[of]][:runs] for row in rows], dtype=np.float64) for of in ("mirror_lock", question)
        )
        real, level, remedy, other = outcomes
        return real - level, remedy - other, np.logical_not(locked.any(axis=0))

    def judge(self, question: Question, arm: Arm, looks: Sequence[int], base: Arm = LEVEL) -> Judgement:
        """Whether a remedy removes the share that it should of the errors, or of the mirror locks, that pitch adds."""
        part, left, free = self.compared(question, arm, base)
        if question == "error":
            return judge(part, left, arm.wanted, looks, free)
        return judge(part, left, LOCKS_WANTED, looks)


Missions = Sequence[ComparedMission]


def paired(rows: Iterable[Record]) -> list[ComparedMission]:
    """Rows of the same mission and variant, put together."""
    found: dict[tuple[object, ...], dict[str, Record]] = {}
    for row in rows:
        key = tuple(row[name] for name in ("condition", "route", "depth_offset_m", "variant"))
        found.setdefault(key, {})[row["arm"]] = row
    return [ComparedMission(arms=arms) for arms in found.values()]


def undecided(mission: ComparedMission, looks: Sequence[int], flown: int) -> list[str]:
    """Keys of the arms, in the order of flying, that must be flown on to settle what is open on a mission.

    Args:
        mission: in all its arms.
        looks: numbers of runs after which to judge.
        flown: number of runs of the arms that were flown on so far; what was left behind with fewer stays as it is.
    """
    wanted: set[str] = set()
    for arm, base in JUDGEMENTS if mission.judged else ():
        if {arm.key, base.key} <= mission.arms.keys():
            questions = QUESTIONS if base is LEVEL else QUESTIONS[:1]
            judged = [mission.judge(question, arm, looks, base) for question in questions]
            if any(one.promising and one.runs == flown for one in judged):
                wanted |= {LEVEL.key, REAL.key, arm.key, base.key}
    return [key for key in mission.arms if key in wanted]


def with_verdicts(mission: ComparedMission, looks: Sequence[int]) -> list[Record]:
    """The rows of a mission with verdicts on errors and mirror locks: of remedies, if they are judged on it."""
    judged = [arm for arm in REMEDIES if mission.judged]
    verdicts = {
        arm.key: {f"{question}_verdict": str(mission.judge(question, arm, looks).verdict) for question in QUESTIONS}
        for arm in judged
        if arm.key in mission.arms
    }
    none = {f"{question}_verdict": "" for question in QUESTIONS}
    return [row | verdicts.get(key, none) for key, row in mission.arms.items()]


def select(missions: Missions, *, judged: bool = False, **wanted: object) -> list[ComparedMission]:
    """Missions whose columns have these values, None being any; `judged`: only those on which remedies are judged."""
    given = {name: value for name, value in wanted.items() if value is not None}
    return [
        m for m in missions if (m.judged or not judged) and all(m.real[name] == value for name, value in given.items())
    ]


def mean_error(missions: Missions, arm: Arm) -> Interval:
    """Mean error of an arm over missions, locked runs included [m]."""
    return intervals.mean_over_missions([m.first_runs(arm) for m in missions])


def added(missions: Missions, arm: Arm, base: Arm = LEVEL, question: Question = "error") -> list[Floats]:
    """What an arm adds to another, run by run and mission by mission, locked runs included."""
    return [m.first_runs(arm, question) - m.first_runs(base, question) for m in missions]


def mean_added(missions: Missions, arm: Arm, base: Arm = LEVEL) -> Interval:
    """What an arm adds to the mean error of another over missions, locked runs included [m]."""
    return intervals.mean_over_missions(added(missions, arm, base))


def locks_added(missions: Missions) -> Interval:
    """Number of the first runs that pitch locks on the mirror image."""
    share = intervals.mean_over_missions(added(missions, REAL, question="mirror_lock"))
    return Interval(*(sum(m.real["runs"] for m in missions) * value for value in share))


def removed_in_all(
    missions: Missions, arm: Arm, question: Question = "error", confidence: float = CONFIDENCE
) -> Interval:
    """Share that a remedy removes of what pitch adds to missions, added up: to errors, or to mirror locks."""
    part, left = added(missions, REAL, question=question), added(missions, arm, question=question)
    return intervals.share_removed(list(zip(part, left, strict=True)), confidence)
