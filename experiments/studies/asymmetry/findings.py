"""What the pitch study found: arms compared run by run, verdicts on remedies, and its record,
`results.json`.

Errors and mirror locks are judged separately. For either, let r_i be the outcome of run i behind
the real leader, l_i behind the level one, a_i with the remedy and b_i behind a level leader with
the same equipment, or simply l_i: its mean error, or 1 if it is locked on the mirror image and 0 if
not. A remedy meets its aim if it removes the share q of what pitch adds: mean(d) ≤ 0 with the
paired differences d_i = (a_i − b_i) − (1 − q)(r_i − l_i); of errors, in runs that no arm of the
comparison has locked. Met: the whole interval of mean(d) is at or below zero; missed: wholly above.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import groupby, pairwise, product
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import ndtri

from experiments.campaign.store import Record
from experiments.study.run import RunTotals, StudyResults
from laisn.arrays import Bools, Floats
from reports import intervals
from reports.findings import Finding, interval_finding, plain_finding
from reports.intervals import CONFIDENCE, Interval, proportion

CAUSES = {"trim": "trim", "dive": "depth changes", "waves": "waves"}
"""What makes the leader pitch, by the beginning of the names of conditions."""
VARIANTS = ("laisn-2", "laisn-3-2")
# remedies: the leader broadcasts its attitude, exact, of an AHRS, or with an error of 0.5° that is
# drawn for each message
BROADCASTS = EXACT, AHRS, READINGS = ("attitude-0", "ahrs-0.5", "attitude-0.5")
LEVEL = "level"  # a leader without pitch
REAL = "real"  # the leader that pitches, without a remedy
LEVEL_BROADCAST = "level-0.5"  # a leader without pitch that broadcasts as that of `READINGS`
ROUGH = "attitude-2"  # remedy: as `READINGS`, with 2°
CONSTANT = "offset-0.5"  # remedy: a broadcast with an error of 0.5° that stays throughout a run
INFLATED = "expected"  # remedy: no broadcast, but a σp of fixes inflated by the mission's pitch
REMEDIES = (*BROADCASTS, ROUGH, CONSTANT, INFLATED)
ARMS = (LEVEL, REAL, LEVEL_BROADCAST, *REMEDIES)
"""Names of arms without their variants; a remedy is held against the level leader."""
# share of the pitch-driven error that a remedy should remove
SHARES_WANTED = dict.fromkeys(REMEDIES, 0.9) | {EXACT: 0.99}
LOOKS = (64, 192, 512, 1280, 5120)
"""Numbers of runs after which verdicts are computed: of every cell, then of those whose verdict
is open.
"""
WRONG = 0.025
"""Chance, at most, that a remedy which just misses its aim is called met, and the same the other
way round.
"""
_ERRORS_RISK = 0.015
_LOCKS_RISK = 0.01
"""Nominal chances, over all looks together, that a limit of errors, or of mirror locks, is crossed.
They are below `WRONG`, since limits over 64 skewed runs may be crossed half as often again as they
should, and those of rare mirror locks twice as often and more."""
_REACH = 0.5
"""Standard errors by which the mean of d may yet move in the estimate of how many runs would
settle a question.
"""
JUDGED_FROM_M = 0.1
"""Remedies are judged on missions in which pitch moves a noiseless fix by this much or more in
the mean.
"""
LOCKS_WANTED = 0.9
"""Share of the mirror locks that pitch adds which any remedy should remove: 99 % would take
thousands of runs.
"""
Question = Literal["error", "mirror_lock"]
RUN_COLUMNS: Mapping[Question, str] = {
    "error": "e_p_run_mean_m",
    "mirror_lock": "mirror_locked_run",
}
"""What a remedy is judged by, and columns of a row with a value for each run: mean E_P [m], and
mirror lock.
"""
QUESTIONS = tuple(RUN_COLUMNS)
JUDGEMENTS = (*((arm, LEVEL) for arm in REMEDIES), (READINGS, LEVEL_BROADCAST))
"""Pairs of a remedy and the arm behind a level leader that it is held against."""


class RemedyVerdict(StrEnum):
    """Judgement of one remedy on one mission."""

    MET = "met"
    OPEN = "open"
    MISSED = "missed"
    NO_HARM = "no harm shown"


class RemedyJudgement(NamedTuple):
    """A verdict and what it rests on."""

    verdict: RemedyVerdict
    runs: int  # number of runs after which it fell, or on which the question is still open
    # open, but settled by more runs, up to the last look, if the mean stayed about as it is
    promising: bool = False
    # runs that would settle an open question, if mean and scatter stayed as they are
    needed: float = math.nan


def judge(
    added: Floats, remaining: Floats, share: float, looks: Sequence[int], free: Bools | None = None
) -> RemedyJudgement:
    """Judge after each look until the question is settled; each look has its part of the chance of
    a wrong verdict.

    `added` is what pitch adds to each run without the remedy, r − l, `remaining` what it adds with
    it, a − b, both of shape (R,): errors [m], or mirror locks (−1, 0, 1). The remedy should remove
    `share` of it. `free`, shape (R,), are the runs without a mirror lock, which count for errors;
    None: mirror locks are judged, for which all runs count.
    """

    def interval(values: Floats, runs: int, confidence: float) -> Interval:
        if free is None:
            return intervals.difference_of_shares(values[:runs], confidence)
        return intervals.mean_interval(values[:runs], free[:runs], confidence)

    if not interval(added, looks[0], 1.0 - 2.0 * WRONG).low > 0.0:
        return RemedyJudgement(RemedyVerdict.NO_HARM, looks[0])
    confidence = 1.0 - 2.0 * (_LOCKS_RISK if free is None else _ERRORS_RISK) / len(looks)
    judgement = RemedyJudgement(RemedyVerdict.OPEN, looks[0])
    slack = _REACH / float(ndtri((1.0 + confidence) / 2.0))
    for runs in (look for look in looks if look <= added.size):
        remaining_harm = interval(remaining - (1.0 - share) * added, runs, confidence)
        if remaining_harm.high <= 0.0 or remaining_harm.low > 0.0:
            return RemedyJudgement(
                RemedyVerdict.MET if remaining_harm.high <= 0.0 else RemedyVerdict.MISSED, runs
            )
        # whether the last run would settle it
        looks_ratio = math.sqrt(runs / looks[-1])
        half_width_up = remaining_harm.high - remaining_harm.value
        half_width_down = remaining_harm.value - remaining_harm.low
        is_met = remaining_harm.value - slack * half_width_down + looks_ratio * half_width_up <= 0.0
        missed = remaining_harm.value + slack * half_width_up - looks_ratio * half_width_down > 0.0
        promising = runs < looks[-1] and (is_met or missed)
        # an interval of many runs is symmetric about the mean, and shrinks with the square root of
        # their number
        needed = (
            runs * ((remaining_harm.high - remaining_harm.low) / (2.0 * remaining_harm.value)) ** 2
            if remaining_harm.value
            else math.inf
        )
        judgement = RemedyJudgement(RemedyVerdict.OPEN, runs, promising, needed)
    return judgement


@dataclass(frozen=True, kw_only=True)
class ComparedMission:
    """One mission of one variant in all its arms: rows by the keys of the arms."""

    arms: Mapping[str, Record]

    @property
    def real(self) -> Record:
        """Behind the leader that pitches."""
        return self.arms[REAL]

    @property
    def added(self) -> float:
        """What pitch adds to the mean position error, locked runs included [m]."""
        return float(self.real["e_p_mean_m"] - self.arms[LEVEL]["e_p_mean_m"])

    @property
    def judged(self) -> bool:
        """Whether remedies are judged on this mission."""
        return bool(self.real["pitch_fix_error_m"] >= JUDGED_FROM_M)

    @property
    def lever(self) -> float:
        """Δz sin φ, both root mean square [m]."""
        return float(
            self.real["depth_offset_rms_m"] * np.sin(np.deg2rad(self.real["leader_pitch_rms_deg"]))
        )

    def first_runs(self, arm: str, question: Question = "error") -> Floats:
        """Mean error [m], or 1 if locked, of each of the first runs, shape (R,)."""
        return np.array(
            self.arms[arm][RUN_COLUMNS[question]][: self.real["runs"]], dtype=np.float64
        )

    def compared(
        self, question: Question, arm: str, base: str = LEVEL
    ) -> tuple[Floats, Floats, Bools]:
        """What pitch adds to each run, what a remedy leaves of it, and the runs that no arm of
        the comparison locks.
        """
        rows = [self.arms[key] for key in (REAL, LEVEL, arm, base)]
        runs = min(len(row[RUN_COLUMNS[question]]) for row in rows)
        locked, (real, level, remedy, other) = (
            np.array([row[RUN_COLUMNS[outcome]][:runs] for row in rows], dtype=np.float64)
            for outcome in ("mirror_lock", question)
        )
        return real - level, remedy - other, np.logical_not(locked.any(axis=0))

    def judge(
        self, question: Question, arm: str, looks: Sequence[int], base: str = LEVEL
    ) -> RemedyJudgement:
        """Whether a remedy removes the share that it should of the errors, or of the mirror
        locks, that pitch adds.
        """
        added, remaining, free = self.compared(question, arm, base)
        judges_errors = question == "error"
        return judge(
            added,
            remaining,
            SHARES_WANTED[arm] if judges_errors else LOCKS_WANTED,
            looks,
            free if judges_errors else None,
        )


Missions = Sequence[ComparedMission]


def paired(rows: Iterable[Record]) -> list[ComparedMission]:
    """Rows of the same mission and variant, put together."""
    by_mission: dict[tuple[object, ...], dict[str, Record]] = {}
    for row in rows:
        key = tuple(row[name] for name in ("condition", "route", "depth_offset_m", "variant"))
        by_mission.setdefault(key, {})[row["arm"]] = row
    return [ComparedMission(arms=arms) for arms in by_mission.values()]


def rows_of(outcomes: StudyResults) -> list[Record]:
    """A row for each mission, variant and arm: figures of the first runs, and outcomes of all."""
    rows = []
    for row, (_, lists) in zip(outcomes.rows, outcomes.runs, strict=True):
        arm, _, variant = row["arm"].rpartition(" ")
        labels = {
            "condition": row["case"],
            "cause": row["case"].partition("-")[0],
            "route": row["scenario"],
            "depth_offset_m": row["offset_m"],
            "variant": variant,
            "arm": arm,
        }
        run_lists = {
            RUN_COLUMNS["error"]: lists["e_p_mean_m"],
            RUN_COLUMNS["mirror_lock"]: lists["mirror_locked"],
        }
        rows.append(row | labels | run_lists)
    return rows


def undecided(mission: ComparedMission, looks: Sequence[int], runs: int) -> list[str]:
    """Arms to fly on to settle what is open on a mission in all its arms; `runs` runs were
    flown of them so far.
    """
    names: set[str] = set()
    for arm, base in JUDGEMENTS if mission.judged else ():
        if {arm, base} <= mission.arms.keys():
            questions = QUESTIONS if base is LEVEL else QUESTIONS[:1]
            judged = [mission.judge(question, arm, looks, base) for question in questions]
            if any(judgement.promising and judgement.runs == runs for judgement in judged):
                names |= {LEVEL, REAL, arm, base}
    return [key for key in mission.arms if key in names]


def further_runs(
    outcomes: Mapping[str, StudyResults], looks: Sequence[int] = LOOKS
) -> dict[str, RunTotals]:
    """Runs up to the next look of arms whose verdict is open, unless even the last would hardly
    settle it.
    """
    numbers: dict[tuple[int, str, int], int] = {}
    for mission in paired(rows_of(outcomes["missions"])):
        runs = max(len(row[RUN_COLUMNS["error"]]) for row in mission.arms.values())
        for look, next_look in pairwise(looks):
            for arm in undecided(mission, looks, look) if look == runs else ():
                row = mission.arms[arm]
                numbers[row["point"], f"{arm} {row['variant']}", row["realization"]] = next_look
    return {"missions": numbers} if numbers else {}


def with_verdicts(mission: ComparedMission, looks: Sequence[int]) -> list[Record]:
    """The rows of a mission with verdicts on errors and mirror locks: of remedies, if they are
    judged on it.
    """

    def verdict(question: Question, arm: str) -> str:
        return (
            str(mission.judge(question, arm, looks).verdict)
            if mission.judged and arm in REMEDIES
            else ""
        )

    return [
        row | {f"{q}_verdict": verdict(q, arm) for q in QUESTIONS}
        for arm, row in mission.arms.items()
    ]


def select(missions: Missions, *, judged: bool = False, **columns: object) -> list[ComparedMission]:
    """Missions whose columns have these values, None being any; `judged`: only those on which
    remedies are judged.
    """
    return [
        m
        for m in missions
        if m.judged >= judged
        and all(value is None or m.real[name] == value for name, value in columns.items())
    ]


def mean_error(missions: Missions, arm: str) -> Interval:
    """Mean error of an arm over missions, locked runs included [m]."""
    return intervals.mean_over_missions([m.first_runs(arm) for m in missions])


def added(
    missions: Missions, arm: str, base: str = LEVEL, question: Question = "error"
) -> list[Floats]:
    """What an arm adds to another, run by run and mission by mission, locked runs included."""
    return [m.first_runs(arm, question) - m.first_runs(base, question) for m in missions]


def mean_added(missions: Missions, arm: str, base: str = LEVEL) -> Interval:
    """What an arm adds to the mean error of another over missions, locked runs included [m]."""
    return intervals.mean_over_missions(added(missions, arm, base))


def locks_added(missions: Missions) -> Interval:
    """Number of the first runs that pitch locks on the mirror image."""
    share = intervals.mean_over_missions(added(missions, REAL, question="mirror_lock"))
    return Interval(*(sum(m.real["runs"] for m in missions) * value for value in share))


def removed_in_all(
    missions: Missions, arm: str, question: Question = "error", confidence: float = CONFIDENCE
) -> Interval:
    """Share that a remedy removes of what pitch adds to missions, added up: to errors, or to
    mirror locks.
    """
    added_errors = added(missions, REAL, question=question)
    left = added(missions, arm, question=question)
    return intervals.share_removed(list(zip(added_errors, left, strict=True)), confidence)


INTERVALS_S = (1.0, 5.0)
"""Message intervals of the curves over τ_rear."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Mean position error of LAISN-2 on a route over τ_rear, the scale of the range error of the
    rear transmitter (`acoustics.range_tau_m`), or over pitch at a depth offset.
    """

    route: str
    interval_s: float  # between messages
    depth_offset_m: float | None  # None: a curve over τ_rear
    value: Sequence[float]  # τ_rear [m], or pitch [°]
    e_p_mean_m: Sequence[float]
    # half of the 95 % interval, over runs, of the excess at each value [m]
    excess_half_m: Sequence[float]

    @property
    def excess(self) -> Floats:
        """Mean error above that of the first value, [m]."""
        return np.asarray(self.e_p_mean_m) - self.e_p_mean_m[0]

    def excess_at(self, value: float) -> Interval:
        """The excess at one of the values that were flown, with its interval [m]."""
        excess, half_width = (
            float(values[self.value.index(value)]) for values in (self.excess, self.excess_half_m)
        )
        return Interval(excess, excess - half_width, excess + half_width)

    def equivalent(self, excess: float) -> float:
        """Size of the value at which the curve has that excess; NaN below zero and beyond the
        curve's end.

        Between the flown values the excess counts as linear; where noise makes a curve dip, its
        largest value so far.
        """
        running_maximum = np.maximum.accumulate(self.excess)
        return (
            float(np.interp(excess, running_maximum, np.abs(self.value)))
            if 0.0 <= excess <= running_maximum[-1]
            else math.nan
        )


def _over_tau(curves: Sequence["Curve"], interval_s: float) -> dict[str, "Curve"]:
    """The curves over τ_rear at a message interval, by route."""
    return {c.route: c for c in curves if c.depth_offset_m is None and c.interval_s == interval_s}


def curves_of(outcomes: StudyResults) -> list[Curve]:
    """The curves of a part over the values that its arms are named by, "VALUE INTERVAL"; the noise
    that arms share drops out of the excess.
    """
    curves = []
    cells = zip(outcomes.rows, outcomes.runs, strict=True)
    for (_, interval), cells_of_curve in groupby(
        cells, key=lambda cell: (cell[0]["point"], cell[0]["arm"].split()[1])
    ):
        rows, runs = zip(*cells_of_curve, strict=True)
        means = [lists["e_p_mean_m"] for _, lists in runs]
        limits = [intervals.mean_over_missions([mean - means[0]]) for mean in means]
        values, errors = zip(
            *((float(row["arm"].split()[0]), row["e_p_mean_m"]) for row in rows), strict=True
        )
        curves.append(
            Curve(
                route=rows[0]["scenario"],
                interval_s=float(interval),
                depth_offset_m=rows[0].get("offset_m"),
                value=values,
                e_p_mean_m=errors,
                excess_half_m=tuple(limit.high - limit.value for limit in limits),
            )
        )
    return curves


def equivalents(curves: Sequence[Curve], tau: float, depth_offset: float) -> dict[str, Interval]:
    """Pitch that raises LAISN-2's mean error as a τ_rear does, and at the limits of its excess, by
    route, [°].

    Messages come every 5 s, as in the paper's Stage 4. NaN: there is no excess, or more than at any
    pitch flown.
    """
    over_tau = _over_tau(curves, INTERVALS_S[1])
    values = {}
    for curve in sorted(
        (c for c in curves if c.depth_offset_m == depth_offset), key=lambda c: c.route
    ):
        if curve.route in over_tau:
            value, low, high = over_tau[curve.route].excess_at(tau)
            values[curve.route] = Interval(
                *(curve.equivalent(e) for e in (value, max(low, 0.0), high))
            )
    return values


def tau_equivalent(missions: Missions, curves: Sequence[Curve]) -> float:
    """τ_rear that raises the error as pitch does, mean over missions, messages every second [m];
    NaN if none does.
    """
    over_tau = _over_tau(curves, INTERVALS_S[0])
    taus = np.array([over_tau[m.real["route"]].equivalent(m.added) for m in missions])
    return float(taus[~np.isnan(taus)].mean()) if (~np.isnan(taus)).any() else math.nan


# open questions are distinguished by whether this number of runs would settle them
SETTLING_RUNS = 100_000
STAGE_4_TAU_M = (0.03, 0.06)
"""τ_rear of the paper's Stage 4, in which the random range error of one transmitter is wider."""


def _errors(missions: Missions) -> dict[str, Finding]:
    """Mean error over the routes at the largest depth offset, behind the level and the real
    leader, by condition.
    """
    findings = {}
    offset = max(m.real["depth_offset_m"] for m in missions)
    for condition, variant in product(
        dict.fromkeys(m.real["condition"] for m in missions), VARIANTS
    ):
        missions_of_route = select(
            missions, condition=condition, depth_offset_m=offset, variant=variant
        )
        for arm in (LEVEL, REAL) if missions_of_route else ():
            name = f"error {condition} {offset:g} {variant} {arm}"
            findings[name] = interval_finding(
                mean_error(missions_of_route, arm), "mean E_P over the routes, 95 % over runs", "m"
            )
    return findings


def _on_routes(missions: Missions, cause: str) -> dict[str, Finding]:
    """The least and the largest share that attitude broadcasts remove on any route, with limits
    for all together.
    """
    findings = {}
    routes = dict.fromkeys(m.real["route"] for m in missions)
    confidence = 1.0 - (1.0 - CONFIDENCE) / (len(routes) * len(CAUSES))
    by_route = [select(missions, variant="laisn-2", cause=cause, route=route) for route in routes]
    for arm in BROADCASTS:
        judged = [chosen for chosen in by_route if chosen and arm in chosen[0].arms]
        shares = [removed_in_all(chosen, arm, confidence=confidence) for chosen in judged]
        for name, extreme in (("least", min), ("largest", max)) if shares else ():
            meaning = (
                f"{name} share removed of what pitch adds on a route, limits that hold for all "
                "routes and causes"
            )
            findings[f"{name} {arm} {cause}"] = interval_finding(extreme(shares), meaning)
    return findings


def _verdicts(missions: Missions, arm: str, name: str, looks: Sequence[int]) -> dict[str, Finding]:
    """Number of missions on which a remedy comes to each verdict, and of those that stay open
    for long.
    """
    findings = {}
    for question in QUESTIONS:
        verdicts = [m.arms[arm][f"{question}_verdict"] for m in missions]
        judged = f"missions, of {len(verdicts)} judged,"
        for verdict in (RemedyVerdict.MET, RemedyVerdict.OPEN, RemedyVerdict.MISSED):
            meaning = f"{judged} with this verdict on {question}s"
            findings[f"{question} {verdict} {name}"] = plain_finding(
                verdicts.count(verdict), meaning
            )
        undecided = [
            m
            for m, verdict in zip(missions, verdicts, strict=True)
            if verdict == RemedyVerdict.OPEN
        ]
        unsettled = sum(m.judge(question, arm, looks).needed > SETTLING_RUNS for m in undecided)
        meaning = (
            f"of the open ones, missions that would take more than {SETTLING_RUNS:,} runs to settle"
        )
        findings[f"{question} beyond {name}"] = plain_finding(unsettled, meaning)
        harmed = len(verdicts) - verdicts.count(RemedyVerdict.NO_HARM)
        findings[f"{question} harmed {name}"] = plain_finding(
            harmed, f"{judged} on which harm is shown"
        )
    return findings


def _remedies(
    missions: Missions, variant: str, cause: str | None, looks: Sequence[int]
) -> dict[str, Finding]:
    """What each arm does on the missions of a variant, of one cause or of all."""
    group = f"{variant} {cause or 'all'}"
    all_routes = select(missions, variant=variant, cause=cause)
    judged = select(all_routes, judged=True)
    findings = {
        f"judged {group}": plain_finding(len(judged), "missions on which remedies are judged")
    }
    for arm in (a for a in ARMS if all_routes and a in all_routes[0].arms):
        rows = [m.arms[arm] for m in all_routes]
        name = f"{arm} {group}"
        locked = proportion(
            sum(row["mirror_locked_runs"] for row in rows), sum(row["runs"] for row in rows)
        )
        findings[f"mirror-locked {name}"] = interval_finding(
            locked, "probability of a mirror lock, missions of any kind"
        )
        if arm in REMEDIES and judged:
            meaning = "share removed of what pitch adds to errors, judged missions, 95 %"
            findings[f"removed {name}"] = interval_finding(removed_in_all(judged, arm), meaning)
            meaning = "share removed of the mirror locks that pitch adds, 95 %"
            findings[f"mirror-locks-removed {name}"] = interval_finding(
                removed_in_all(all_routes, arm, "mirror_lock"), meaning
            )
            findings |= _verdicts(judged, arm, name, looks)
    return findings


def _stage_4(curves: Sequence[Curve], offsets: Sequence[float]) -> dict[str, Finding]:
    """Pitch that raises the mean error as the paper's τ does, over the routes."""
    findings = {}
    for tau, offset in product(STAGE_4_TAU_M, offsets):
        pitch = [
            v.value for v in equivalents(curves, tau, offset).values() if not math.isnan(v.value)
        ]
        if pitch:
            value, low, high = (round(float(f(pitch)), 2) for f in (np.median, min, max))
            meaning = "pitch that does what τ_rear does: median, least and largest of the routes"
            findings[f"stage-4 {tau:g} {offset:g}"] = Finding(
                value=value, low=low, high=high, unit="°", what=meaning
            )
    return findings


def findings_of_rows(
    rows: Sequence[Record], curves: Sequence[Curve], looks: Sequence[int] = LOOKS
) -> dict[str, Finding]:
    """All findings, from rows with verdicts and curves."""
    missions = paired(rows)
    findings = {
        "missions": plain_finding(
            len({(r["condition"], r["route"], r["depth_offset_m"]) for r in rows}), "missions flown"
        ),
        "cells": plain_finding(len(rows), "missions, arms and variants"),
        "first-runs": plain_finding(looks[0], "runs of every cell"),
        "most-runs": plain_finding(looks[-1], "runs of cells whose verdict was open"),
        "runs": plain_finding(sum(len(r[RUN_COLUMNS["error"]]) for r in rows), "runs flown"),
    }
    findings |= _errors(missions)
    for cause in CAUSES:
        findings |= _on_routes(missions, cause)
    for variant, cause_or_all in product(VARIANTS, (*CAUSES, None)):
        findings |= _remedies(missions, variant, cause_or_all, looks)
    return findings | _stage_4(
        curves, sorted({c.depth_offset_m for c in curves if c.depth_offset_m})
    )


def judged_rows(outcomes: Mapping[str, StudyResults]) -> list[Record]:
    """Rows of all missions, with verdicts."""
    return [
        row
        for mission in paired(rows_of(outcomes["missions"]))
        for row in with_verdicts(mission, LOOKS)
    ]


def all_curves(outcomes: Mapping[str, StudyResults]) -> list[Curve]:
    """Curves over τ, and over pitch."""
    return [*curves_of(outcomes["tau"]), *curves_of(outcomes["pitch"])]


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Findings of all parts of the study."""
    return findings_of_rows(judged_rows(outcomes), all_curves(outcomes))
