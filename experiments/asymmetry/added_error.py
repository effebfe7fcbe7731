"""What pitch, and what a remedy, does to the mean error of a mission: arms of the same mission put together."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from experiments.asymmetry.missions import Row
from experiments.asymmetry.remedies import LEVEL, LEVEL_BROADCAST, READINGS, REAL, REMEDIES, Arm
from experiments.asymmetry.verdict import Judgement, Verdict, judge_captures, judge_errors
from experiments.intervals import CONFIDENCE, Interval, mean_over_missions, proportion, share_removed
from laisn.arrays import Bools, Floats

JUDGED_FROM_M = 0.1
"""Remedies are judged on missions in which pitch moves a noiseless fix by this much or more in the mean. That is known
from the motion alone, before anybody navigates; what came out of a mission has no say in it."""
CAPTURES_WANTED = 0.9
"""Share of the captures that pitch adds which any remedy should remove: a run is captured or not, so that 99 % of them
would take thousands of runs to tell."""
SETTLING_RUNS = (10_000, 100_000)
"""Numbers of runs by which questions that stay open are told apart: would so many settle them?"""
Question = Literal["error", "capture"]
QUESTIONS: tuple[Question, ...] = ("error", "capture")
"""What a remedy is judged by: errors of runs that nobody captures, and captures."""
JUDGEMENTS = (*((arm, LEVEL) for arm in REMEDIES), (READINGS, LEVEL_BROADCAST))
"""Remedies, and what each is held against."""
Mission = tuple[str, str, float, str]
"""Condition, route, depth offset, variant."""


@dataclass(frozen=True, kw_only=True)
class ComparedMission:
    """One mission in all its arms, by their keys."""

    level: Row
    real: Row
    arms: dict[str, Row]

    @property
    def part(self) -> float:
        """The pitch-driven part of the mean position error, captured runs included [m]."""
        return self.real.e_p_mean_m - self.level.e_p_mean_m

    @property
    def judged(self) -> bool:
        """Whether remedies are judged on this mission."""
        return self.level.fix_error_m >= JUDGED_FROM_M

    @property
    def lever(self) -> float:
        """Δz sin φ, both root mean square [m]."""
        return self.real.depth_offset_rms_m * float(np.sin(np.deg2rad(self.real.pitch_rms_deg)))

    def left(self, arm: Arm, base: Arm = LEVEL) -> float:
        """What a remedy leaves of it, against a level leader without equipment, or with that of another arm [m]."""
        return self.arms[arm.key].e_p_mean_m - self.arms[base.key].e_p_mean_m

    def removed(self, arm: Arm) -> float:
        """Share that a remedy removes of the pitch-driven part in runs that nobody captures; NaN if there are none."""
        part, left, free = self._compared(arm, LEVEL)
        return 1.0 - float(left[free].mean() / part[free].mean()) if free.any() else float("nan")

    def left_free(self, arm: Arm) -> float:
        """What a remedy leaves of the pitch-driven part in runs that nobody captures; NaN if there are none [m]."""
        _, left, free = self._compared(arm, LEVEL)
        return float(left[free].mean()) if free.any() else float("nan")

    def captures_removed(self, arm: Arm) -> float:
        """Share that a remedy removes of the captures that pitch adds to all runs; NaN if it adds none."""
        part, left = self._compared_captures(arm, LEVEL)
        return 1.0 - float(left.mean() / part.mean()) if part.sum() else float("nan")

    def judge_errors(self, arm: Arm, looks: Sequence[int], base: Arm = LEVEL) -> Judgement:
        """Whether the remedy removes the share that it should of the error in runs that nobody captures."""
        part, left, free = self._compared(arm, base)
        return judge_errors(part, left, free, arm.wanted, looks)

    def judge_captures(self, arm: Arm, looks: Sequence[int], base: Arm = LEVEL) -> Judgement:
        """Whether the remedy removes the share that it should of the captures that pitch adds."""
        part, left = self._compared_captures(arm, base)
        return judge_captures(part, left, CAPTURES_WANTED, looks)

    def errors(self, arm: Arm) -> Floats:
        """Mean error of each of the first runs, shape (R,), [m]."""
        return np.array(self.arms[arm.key].e_p_run_mean_m[: self.real.runs])

    def captures(self, arm: Arm) -> Floats:
        """1 for each of the first runs that is captured, else 0, shape (R,)."""
        return np.array(self.arms[arm.key].captured_run[: self.real.runs], dtype=np.float64)

    def _of_all(self, field: str, arm: Arm, base: Arm) -> list[tuple[float, ...]]:
        """A field of each run behind the real and the level leader, with a remedy and with another arm."""
        values = [getattr(row, field) for row in (self.real, self.level, self.arms[arm.key], self.arms[base.key])]
        runs = min(map(len, values))
        return [value[:runs] for value in values]

    def _compared(self, arm: Arm, base: Arm) -> tuple[Floats, Floats, Bools]:
        """Pitch-driven error and what the remedy leaves of it, run by run, and whether no arm captures the run."""
        real, level, remedy, other = np.array(self._of_all("e_p_run_mean_m", arm, base))
        captured = np.array(self._of_all("captured_run", arm, base))
        free: Bools = np.logical_not(captured.any(axis=0))
        return real - level, remedy - other, free

    def _compared_captures(self, arm: Arm, base: Arm) -> tuple[Floats, Floats]:
        """Captures that pitch adds and those that a remedy leaves, run by run: −1, 0 or 1."""
        real, level, remedy, other = np.array(self._of_all("captured_run", arm, base), dtype=np.float64)
        return real - level, remedy - other


def paired(rows: Iterable[Row]) -> dict[Mission, ComparedMission]:
    """Rows of the same mission, put together."""
    found: dict[Mission, dict[str, Row]] = {}
    for row in rows:
        found.setdefault((row.condition, row.route, row.depth_offset_m, row.variant), {})[row.arm] = row
    return {
        mission: ComparedMission(level=arms[LEVEL.key], real=arms[REAL.key], arms=arms)
        for mission, arms in found.items()
    }


def undecided(mission: ComparedMission, looks: Sequence[int], flown: int) -> list[str]:
    """Keys of the arms, in the order of flying, that must be flown on to settle what is open on a mission.

    Args:
        mission: in all its arms.
        looks: numbers of runs after which to judge.
        flown: number of runs of the arms that were flown on so far; what was left behind with fewer stays as it is.
    """
    if not mission.judged:
        return []
    wanted: set[str] = set()
    for arm, base in JUDGEMENTS:
        if not {arm.key, base.key} <= mission.arms.keys():
            continue
        judged = [mission.judge_errors(arm, looks, base)]
        if base is LEVEL:
            judged.append(mission.judge_captures(arm, looks, base))
        if any(one.promising and one.runs == flown for one in judged):
            wanted |= {LEVEL.key, REAL.key, arm.key, base.key}
    return [key for key in mission.arms if key in wanted]


def with_verdicts(mission: ComparedMission, looks: Sequence[int]) -> list[Row]:
    """The rows of a mission, those of remedies with their verdicts if they are judged on it."""
    remedies = {arm.key: arm for arm in REMEDIES} if mission.judged else {}
    return [
        replace(
            row,
            error_verdict=mission.judge_errors(remedies[key], looks).verdict.value,
            capture_verdict=mission.judge_captures(remedies[key], looks).verdict.value,
        )
        if key in remedies
        else row
        for key, row in mission.arms.items()
    ]


def open_questions(
    missions: Iterable[ComparedMission], arm: Arm, looks: Sequence[int], question: Question
) -> list[tuple[float, float]]:
    """The share that a remedy removes on each mission whose verdict is open, and the runs that would settle it."""
    found = []
    for e in missions:
        if getattr(e.arms[arm.key], f"{question}_verdict") == Verdict.OPEN.value:
            if question == "error":
                found.append((e.removed(arm), e.judge_errors(arm, looks).needed))
            else:
                found.append((e.captures_removed(arm), e.judge_captures(arm, looks).needed))
    return found


def mean_of(values: Iterable[float]) -> float:
    """Mean of those that are numbers; NaN if none is."""
    given = [v for v in values if not np.isnan(v)]
    return float(np.mean(given)) if given else float("nan")


def of_cause(
    missions: dict[Mission, ComparedMission], variant: str, cause: str | None = None, route: str | None = None
) -> list[ComparedMission]:
    """Missions of a variant, of one cause and on one route, or of all."""
    return [
        e
        for (_, flown_on, _, flown), e in missions.items()
        if flown == variant and cause in (None, e.real.cause) and route in (None, flown_on)
    ]


def judged(missions: dict[Mission, ComparedMission], variant: str, cause: str | None = None) -> list[ComparedMission]:
    """Missions of a variant on which remedies are judged, of one cause or of all."""
    return [e for e in of_cause(missions, variant, cause) if e.judged]


def removed_in_all(missions: Sequence[ComparedMission], arm: Arm, confidence: float = CONFIDENCE) -> Interval:
    """Share of the pitch-driven errors of missions, added up, that a remedy removes; captured runs are included."""
    level = [e.errors(LEVEL) for e in missions]
    pairs = [(e.errors(REAL) - own, e.errors(arm) - own) for e, own in zip(missions, level, strict=True)]
    return share_removed(pairs, confidence)


def mean_error(missions: Sequence[ComparedMission], arm: Arm) -> Interval:
    """Mean error of an arm over missions, captured runs included [m]."""
    return mean_over_missions([e.errors(arm) for e in missions])


def mean_added(missions: Sequence[ComparedMission], arm: Arm, base: Arm = LEVEL) -> Interval:
    """What an arm adds to the mean error of another over missions, captured runs included [m]."""
    return mean_over_missions([e.errors(arm) - e.errors(base) for e in missions])


def captures_in_all(missions: Sequence[ComparedMission], arm: Arm) -> Interval:
    """Chance that a run of these missions is captured."""
    rows = [e.arms[arm.key] for e in missions]
    return proportion(sum(row.captured for row in rows), sum(row.runs for row in rows))


def captures_removed(missions: Sequence[ComparedMission], arm: Arm) -> Interval:
    """Share of the captures that pitch adds to missions, added up, that a remedy removes."""
    return share_removed(
        [(e.captures(REAL) - e.captures(LEVEL), e.captures(arm) - e.captures(LEVEL)) for e in missions]
    )
