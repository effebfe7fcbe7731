"""What claims are judged on, figures of many cells, and the verdict that their criteria lead to."""

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from experiments.intervals import Interval
from experiments.reproduction.stages import Key
from laisn.arrays import Floats
from laisn.settings import Variant

Verdict = Literal["holds", "does not hold", "depends", "undecided", "no data"]
WORDS: Mapping[Verdict, str] = {
    "holds": "holds", "does not hold": "does not hold", "depends": "depends on the mission", "undecided": "undecided",
    "no data": "no data",
}  # fmt: skip
Relation = Literal["<", "≤", ">", "≥"]
Outcome = Literal["met", "not met", "undecided"]
Kind = Literal["ratio", "share", "replications"]
"""Of a figure: a ratio, whose interval is symmetric in its logarithm; a share, whose interval is symmetric; or a share
of replications, with the exact limits of a proportion."""
MARGIN = 0.01
"""A figure nearer than this share of its bound cannot be told from it: the paper prints errors of some metres with two
decimals, so that its own ratios are that uncertain."""

_HOLDS: Mapping[Relation, Callable[[float, float], bool]] = {
    "<": operator.lt, "≤": operator.le, ">": operator.gt, "≥": operator.ge,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Results:
    """Figures of many cells, by setting, mission and variant: numbers, or arrays of shape (B,) of as many resamples."""

    rows: Mapping[Key, Mapping[str, float | Floats]]
    missions: Sequence[str]
    replicated: Mapping[Key, Mapping[str, Floats]] = field(default_factory=dict)
    """Figures of each of K replications, shape (K,); empty: `rows` are those of the only one."""
    lateral: Sequence[str] = ("T3", "T4")
    """Missions of followers that stay abeam; the defaults are those that the paper names."""
    astern: Sequence[str] = ("T2", "T5")
    """Missions of followers that are astern for long."""
    burst: Sequence[str] = ("T8",)
    """Missions with a burst of speed."""

    def value(self, setting: str, mission: str, variant: Variant, metric: str) -> float | Floats:
        """One figure; NaN if there is none."""
        return self.rows.get((setting, mission, variant), {}).get(metric, np.nan)

    def values(self, setting: str, variant: Variant, metric: str, missions: Iterable[str] | None = None) -> Floats:
        """One figure of all missions, shape (m,), or (B, m) of B resamples."""
        chosen = self.missions if missions is None else missions
        found = [np.asarray(self.value(setting, m, variant, metric), dtype=np.float64) for m in chosen]
        return np.stack(np.broadcast_arrays(*found), axis=-1) if found else np.empty(0)

    def in_replications(self, setting: str, variant: Variant, metric: str, missions: Iterable[str]) -> Floats:
        """One figure of some missions in each replication, shape (K, m)."""
        found = [np.atleast_1d((self.replicated or self.rows)[setting, m, variant][metric]) for m in missions]
        return np.stack(found, axis=-1)

    def among(self, group: Sequence[str]) -> list[str]:
        """Missions of a group, as often as they occur."""
        return [m for m in self.missions if m in group]

    def others(self, group: Sequence[str]) -> list[str]:
        """Missions that are not of a group."""
        return [m for m in self.missions if m not in group]


class Criterion(NamedTuple):
    """A part of a claim: a figure, and the bound that it must keep."""

    what: str
    value: Floats
    """Shape (), or (B,) of B resamples."""
    relation: Relation
    bound: float
    kind: Kind = "ratio"


class Evaluated(NamedTuple):
    """The criteria of a claim on some results."""

    criteria: Sequence[Criterion]
    figures: Callable[[], str]
    """The numbers behind them, of results without resamples."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A criterion with its interval, which is a point where there are no resamples."""

    what: str
    interval: Interval
    relation: Relation
    bound: float
    margin: float = MARGIN
    """0 where figures are taken as exact."""

    @property
    def outcome(self) -> Outcome:
        """Undecided where the interval contains the bound, or comes nearer to it than the margin."""
        bounds = self.bound * (1.0 - self.margin), self.bound * (1.0 + self.margin)
        ends = [
            _HOLDS[self.relation](end, bound) for end in (self.interval.low, self.interval.high) for bound in bounds
        ]
        return "met" if all(ends) else "undecided" if any(ends) else "not met"

    def __str__(self) -> str:
        """Figure, limits, bound and outcome."""
        value, low, high = self.interval
        limits = "" if low == high == value else f" ({low:.2f} to {high:.2f})"
        return f"{self.what}: {value:.2f}{limits} {self.relation} {self.bound:g}: {self.outcome}"


def verdict_of(outcomes: Sequence[Outcome]) -> Verdict:
    """All met: holds; none: does not hold; some: depends; undecided where that hangs on a criterion that is."""
    if "met" in outcomes and "not met" in outcomes:
        return "depends"
    if "undecided" in outcomes:
        return "undecided"
    return "holds" if "met" in outcomes else "does not hold"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The verdict on a claim."""

    verdict: Verdict
    figures: str
    """The numbers behind it."""
    criteria: Sequence[Judged] = ()
