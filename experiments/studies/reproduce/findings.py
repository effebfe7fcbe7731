"""The record of the reproduction: the paper's claims of `claims.toml`, judged, ratios to its
figures, and mirror locks.

Claims are judged on means over replications of the paper's experiment on the eight missions, whose
noise all cells share; and on the published figures, as far as they have them.
"""

import csv
import math
import operator
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from typing import Any, Literal, Self

import numpy as np
from pydantic import TypeAdapter
from scipy.special import stdtrit

from experiments.campaign.store import Arrays, Record
from experiments.flight.library import ROUTES
from experiments.study.run import RunTotals, StudyResults
from laisn.arrays import Bools, Floats
from laisn.geometry import signed_angle
from reports.findings import Finding, interval_finding, plain_finding
from reports.intervals import Interval, proportion
from sim.trajectory import Trajectory

METRICS = {
    "e_p_max_m": "E_P max [m]",
    "e_b_max_deg": "E_B max [°]",
    "e_p_mean_m": "E_P mean [m]",
    "e_b_mean_deg": "E_B mean [°]",
    "e_p_std_m": "σ E_P [m]",
    "e_b_std_deg": "σ E_B [°]",
}
"""The paper's six figures of a row, in its order, and their heads."""
VARIANTS = {"laisn-2": "LAISN-2", "laisn-3-1": "LAISN-3(1)", "laisn-3-2": "LAISN-3(2)"}
Key = tuple[str, str, str]  # setting, mission and variant of a row
REPLICATIONS = 20
RESAMPLES = 2000
# of the interval of each criterion; of all 26 together 95 % (Bonferroni)
VERDICT_CONFIDENCE = 0.998
COMPARED_METRICS = ("e_p_mean_m", "e_p_max_m", "e_b_max_deg")  # of `METRICS`, those of claims
# cells, "SETTING VARIANT": the paper's usual settings, and a compass of the leader that is 5° off
BASE = "base laisn-2"
HEADING = "heading5 laisn-2"
LATERAL = np.isin(ROUTES, ("T3", "T4"))
BURST = np.isin(ROUTES, ("T8",))
"""Missions of followers that stay abeam, and with a burst of speed, as the paper names them;
shape (8,).
"""
ASTERN_DEG = 10.0  # A follower within this angle of dead astern counts as astern
LATERAL_DEG = (45.0, 135.0)  # angle off the bow, either side, that counts as abeam
SECTOR_STEPS = 300  # steps (of 0.1 s) that a mission must spend in a sector to be counted there
NEAR_BURST_S = 30.0
"""The largest bearing error within this time of 95 % of the follower's top speed counts as that
of the burst [s].
"""
TIMED = ("e_p_abeam_m", "e_p_astern_m", "e_b_peaks_at_burst")
"""Mean E_P [m] abeam and astern, and whether the largest E_B of all runs is that of the burst: 1
or 0.
"""


def _data(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")


def published() -> dict[Key, dict[str, float]]:
    """The published figures of every row."""
    rows = csv.DictReader(_data("published_tables.csv").splitlines())
    return {
        (row["setting"], row["trajectory"], row["variant"]): {
            metric: float(row[metric]) for metric in METRICS
        }
        for row in rows
    }


def key_of(row: Record) -> Key:
    """Key of a row of the study."""
    return row["case"], row["scenario"], row["arm"]


def rows_of(outcomes: Mapping[str, StudyResults]) -> dict[Key, Record]:
    """Our row of every cell."""
    return {key_of(row): row for row in outcomes["tables"].rows}


def over_time(steps: Arrays) -> dict[str, float]:
    """Errors over time that claims use, named as in `TIMED`; NaN for a sector where the follower
    hardly is.
    """
    off_bow = np.rad2deg(np.abs(signed_angle(np.deg2rad(steps["bearing_deg"]))))
    abeam = (off_bow >= LATERAL_DEG[0]) & (off_bow <= LATERAL_DEG[1])
    error = steps["e_p_mean_m"]
    time = steps["time_s"]
    sectors = (abeam, off_bow >= 180.0 - ASTERN_DEG)
    means = (
        float(error[sector].mean()) if sector.sum() >= SECTOR_STEPS else np.nan
        for sector in sectors
    )
    fastest = time[steps["speed_m_s"] >= 0.95 * steps["speed_m_s"].max()]
    time_apart = np.min(np.abs(time[np.argmax(steps["e_b_max_deg"])] - fastest))
    return dict(zip(TIMED, (*means, float(time_apart <= NEAR_BURST_S)), strict=True))


def mean_distance(flight: Trajectory) -> float:
    """Mean distance of the first follower's hydrophone and the leader [m]."""
    separation = flight.site_path(f"{flight.names[1]}/hydrophone") - flight.position[:, 0]
    return float(np.hypot(*separation[:, :2].T).mean())


Kind = Literal["ratio", "share", "replications"]
"""A ratio, whose interval is symmetric in its logarithm; a share, whose interval is symmetric; a
share of replications, with the exact limits of a proportion."""
Relation = Literal["<", "≤", ">", "≥"]
Outcome = Literal["met", "not met", "undecided"]
MARGIN = 0.01
"""A figure nearer than this share of its bound is indistinguishable from it: the paper prints
errors of some metres with two decimals, so that its own ratios are that uncertain."""
# functions of relations
HOLDS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "≤": operator.le,
    ">": operator.gt,
    "≥": operator.ge,
}


class NoDataError(LookupError):
    """Figures that a claim needs are missing."""


@dataclass(frozen=True, kw_only=True)
class JudgedCriterion:
    """A criterion with its interval, which is a point where there are no resamples."""

    quantity: str
    interval: Interval
    relation: Relation
    bound: float
    margin: float = MARGIN  # 0 where figures are taken as exact

    @property
    def outcome(self) -> Outcome:
        """Undecided where the interval contains the bound, or comes nearer to it than the
        margin.
        """
        bounds = self.bound * (1.0 - self.margin), self.bound * (1.0 + self.margin)
        ends = [HOLDS[self.relation](end, bound) for end in self.interval[1:] for bound in bounds]
        if all(ends):
            return "met"
        return "undecided" if any(ends) else "not met"

    def __str__(self) -> str:
        """Figure, limits, bound and outcome."""
        value, low, high = self.interval
        limits = "" if low == high == value else f" ({low:.2f} to {high:.2f})"
        return (
            f"{self.quantity}: {value:.2f}{limits} {self.relation} {self.bound:g}: {self.outcome}"
        )


@dataclass(frozen=True, kw_only=True)
class MetricValues:
    """Figures of the eight missions by setting with variant ("base laisn-2") and metric."""

    values: Mapping[tuple[str, str], Floats]
    exact: bool = False

    @classmethod
    def of(cls, outcomes: Mapping[str, StudyResults]) -> Self:
        """Figures of all replications, missions in the order of `ROUTES`; NaN for those that
        were not flown.
        """
        figures: dict[tuple[str, str], Floats] = {}

        def store(cell: str, metric: str, route: str, values: Floats) -> None:
            table = figures.setdefault(
                (cell, metric), np.full((values.size, len(ROUTES)), math.nan)
            )
            table[:, ROUTES.index(route)] = values

        tables = outcomes["tables"]
        timed = outcomes["replications"]
        for labels, lists in tables.runs:
            cell = f"{labels['case']} {labels['arm']}"
            for metric in COMPARED_METRICS if cell in JUDGED_CELLS else ():
                run_values = lists[metric].reshape(-1, tables.plan.study.runs)
                store(
                    cell,
                    metric,
                    labels["scenario"],
                    run_values.max(axis=1) if "_max_" in metric else run_values.mean(axis=1),
                )
        rows = [
            (row["scenario"], over_time(steps))
            for row, steps in zip(timed.rows, timed.steps, strict=True)
        ]
        for entry in {entry.motion_key: entry for entry in timed.plan.entries}.values():
            rows_of_route = [row for route, row in rows if route == entry.source][:REPLICATIONS]
            for name in TIMED:
                store(BASE, name, entry.source, np.array([row[name] for row in rows_of_route]))
            store(
                BASE,
                "distance_m",
                entry.source,
                np.full(len(rows_of_route), mean_distance(timed.motion(entry))),
            )
        return cls(values=figures)

    @property
    def count(self) -> int:
        """Number of replications."""
        return len(next(iter(self.values.values())))

    @cached_property
    def _weights(self) -> Floats:
        """Weights of the K replications: in their mean, in the first row, and in the means of
        bootstrap resamples, in the others; shape (1 + `RESAMPLES`, K), (1, K) if `exact`.
        """
        mean = np.full((1, self.count), 1.0 / self.count)
        if self.exact:
            return mean
        resampled_counts = np.random.default_rng([self.count, RESAMPLES]).multinomial(
            self.count, mean[0], size=RESAMPLES
        )
        return np.concatenate([mean, resampled_counts / self.count])

    def means_or_nan(self, cell: str, metric: str) -> Floats:
        """Means over replications, and over B = `RESAMPLES` bootstrap resamples of them, the same
        in all cells, shape (1 + B, 8); NaN, shape (1, 8), where there are no figures.
        """
        values = self.values.get((cell, metric))
        if values is None:
            return np.full((1, len(ROUTES)), math.nan)
        # not by BLAS, whose sums depend on processor and threads
        return np.asarray(np.einsum("bk,km->bm", self._weights, values))

    def means(self, cell: str, metric: str = "e_p_mean_m") -> Floats:
        """As `means_or_nan`; NoDataError where there are none."""
        values = self.means_or_nan(cell, metric)
        if not np.all(np.isfinite(values)):
            raise NoDataError
        return values

    def interval(self, values: Floats, kind: Kind = "ratio") -> Interval:
        """Interval of a figure over missions, of the means and of resamples, shape (1 + B,); a
        point if `exact`.

        The standard error of a t interval is the bootstrap's, whose variance is K / (K − 1) times
        too small (Davison & Hinkley 1997, section 2.2).
        """
        value = float(values[0])
        resampled = values[1:]
        count = self.count
        if self.exact or count == 1:
            return Interval(value, value, value)
        if kind == "replications":
            return proportion(round(value * count), count, VERDICT_CONFIDENCE)
        quantile = float(stdtrit(count - 1, (1.0 + VERDICT_CONFIDENCE) / 2.0))
        width_factor = quantile * math.sqrt(count / (count - 1))
        if kind == "share":
            half_width = width_factor * float(resampled.std())
            return Interval(value, value - half_width, value + half_width)
        factor = math.exp(width_factor * float(np.log(resampled).std()))
        return Interval(value, value / factor, value * factor)

    def judge(
        self, criterion: str, values: Floats, relation: Relation, bound: float, kind: Kind = "ratio"
    ) -> JudgedCriterion:
        """A criterion: a figure over missions as of `interval`, and the bound that it must keep."""
        margin = 0.0 if self.exact else MARGIN
        return JudgedCriterion(
            quantity=criterion,
            interval=self.interval(values, kind),
            relation=relation,
            bound=bound,
            margin=margin,
        )


Verdict = Literal["holds", "does not hold", "depends", "undecided", "no data"]


@dataclass(frozen=True, kw_only=True)
class ClaimJudgement:
    """The verdict on a claim, and its criteria."""

    verdict: Verdict
    criteria: Sequence[JudgedCriterion] = ()


def verdict_of(outcomes: Sequence[Outcome]) -> Verdict:
    """All met: holds; none: does not hold; some: depends; undecided where that hangs on a
    criterion that is.
    """
    if "met" in outcomes and "not met" in outcomes:
        return "depends"
    if "undecided" in outcomes:
        return "undecided"
    return "holds" if "met" in outcomes else "does not hold"


def _statistic(name: str, ratio: Floats) -> Floats:
    """A statistic over missions, the last axis, by its name in `claims.toml`: "median", "nine
    tenths", either with "change", or "share RELATION LIMIT".
    """
    if name.startswith("share"):
        _, relation, limit = name.split()
        return np.asarray(np.mean(HOLDS[relation](ratio, float(limit)), axis=-1))
    values = np.abs(np.log(ratio)) if name.endswith("change") else ratio
    quantiles = np.asarray(
        np.quantile(values, 0.9 if name.startswith("nine tenths") else 0.5, axis=-1)
    )
    return np.exp(quantiles) if name.endswith("change") else quantiles


def _median_over_others(values: Floats, routes: Bools) -> Floats:
    """Median over some routes, divided by that over the others."""
    return _statistic("median", values[:, routes]) / _statistic("median", values[:, ~routes])


def _ratio_criteria(claim: "Claim", figures: MetricValues) -> list[JudgedCriterion]:
    ratios = []
    for ratio in claim.ratios:
        routes = np.isin(ROUTES, ratio.get("missions", ROUTES))
        metric = ratio.get("metric", "e_p_mean_m")
        numerator, denominator = (
            np.concatenate(
                [figures.means(cell, metric)[:, routes] for cell in ratio[side]], axis=-1
            )
            for side in ("of", "over")
        )
        ratios.append(numerator / denominator)
    return [
        figures.judge(
            criterion,
            _statistic(name, ratios[i]),
            relation,
            bound,
            "share" if "share" in name else "ratio",
        )
        for criterion, i, name, relation, bound in claim.criteria
    ]


def _lateral(figures: MetricValues) -> list[JudgedCriterion]:
    error = figures.means(BASE, "e_p_max_m")
    largest = figures.values[BASE, "e_p_max_m"]
    is_below = largest[:, LATERAL].max(axis=1) < largest[:, ~LATERAL].min(axis=1)
    meaning = "share of replications with E_P max abeam below each other"
    criteria = [
        figures.judge(
            "median E_P max, abeam over the others", _median_over_others(error, LATERAL), "<", 1.0
        ),
        figures.judge(meaning, np.mean(is_below, keepdims=True), ">", 0.5, "replications"),
    ]
    abeam, astern = (
        figures.means_or_nan(BASE, f"e_p_{sector}_m") for sector in ("abeam", "astern")
    )
    finite = np.isfinite(abeam + astern).all(axis=0)
    better = np.mean((astern / abeam)[:, finite] > 1.0, axis=1) if finite.any() else None
    meaning = "share of missions better abeam than astern"
    return (
        criteria
        if better is None
        else [*criteria, figures.judge(meaning, better, ">", 0.5, "share")]
    )


def _heading(figures: MetricValues) -> list[JudgedCriterion]:
    error = figures.means(HEADING)
    distance = figures.means(BASE, "distance_m")
    growth = error / figures.means(BASE)
    growth_abeam, growth_elsewhere = (
        _statistic("median", growth[:, mask]) for mask in (LATERAL, ~LATERAL)
    )
    slope = np.sum(error * distance, axis=1) / np.sum(distance**2, axis=1)
    # of a line through the origin: what it leaves over the spread about the mean
    residual = np.sum((error - slope[:, None] * distance) ** 2, axis=1)
    spread = np.sum((error - error.mean(axis=1, keepdims=True)) ** 2, axis=1)
    r_squared = 1.0 - np.divide(residual, spread, out=np.ones_like(residual), where=spread > 0.0)
    # both are to exceed 1
    least_growth = np.minimum(growth_abeam / growth_elsewhere, growth_abeam / 5.0)
    return [
        figures.judge("growth abeam, over that elsewhere and over 5", least_growth, ">", 1.0),
        figures.judge("variance that the line explains", r_squared, "≥", 0.8, "share"),
    ]


def _burst(figures: MetricValues) -> list[JudgedCriterion]:
    error = figures.means(BASE, "e_b_max_deg")
    largest = figures.values[BASE, "e_b_max_deg"]
    is_largest = largest[:, BURST].max(axis=1) > largest[:, ~BURST].max(axis=1)
    shares = {"with the largest E_B in a burst": np.mean(is_largest, keepdims=True)}
    peaks = figures.means_or_nan(BASE, "e_b_peaks_at_burst")[:, BURST]
    if np.isfinite(peaks).all():
        shares[f"with the peak within {NEAR_BURST_S:.0f} s of the burst"] = peaks.mean(axis=1)
    error_ratio = _median_over_others(error, BURST)
    meaning = "largest E_B, median of the bursts over the others'"
    return [
        figures.judge(meaning, error_ratio, ">", 1.0),
        *(
            figures.judge(f"share of replications {w}", v, ">", 0.5, "replications")
            for w, v in shares.items()
        ),
    ]


# criteria of claims by the name in their `test`
_TESTS = {"lateral": _lateral, "heading": _heading, "burst": _burst}


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claim of the paper, its criterion in words, and what decides it; see `claims.toml`."""

    number: int
    text: str
    criterion: str
    ratios: Sequence[Mapping[str, Any]] = ()
    criteria: Sequence[tuple[str, int, str, Relation, float]] = ()
    """Words, number of the ratio, statistic, relation and bound."""
    test: str = ""

    def judge(self, figures: MetricValues) -> ClaimJudgement:
        """The verdict on figures of the missions."""
        try:
            criteria = _TESTS[self.test](figures) if self.test else _ratio_criteria(self, figures)
        except NoDataError:
            return ClaimJudgement(verdict="no data")
        return ClaimJudgement(
            verdict=verdict_of([criterion.outcome for criterion in criteria]), criteria=criteria
        )


CLAIMS = TypeAdapter(tuple[Claim, ...]).validate_python(
    tomllib.loads(_data("claims.toml"))["claim"]
)
_RATIO_CELLS = (
    cell
    for claim in CLAIMS
    for ratio in claim.ratios
    for side in ("of", "over")
    for cell in ratio[side]
)
JUDGED_CELLS = frozenset([BASE, HEADING, *_RATIO_CELLS])
"""Cells of the tables, "CASE ARM", whose figures claims are judged by."""


def judge(
    ours: MetricValues, published: Mapping[Key, Mapping[str, float]]
) -> list[tuple[Claim, ClaimJudgement, ClaimJudgement]]:
    """Every claim on our figures and on the published ones, which have our distances."""
    published_values = {
        (f"{setting} {variant}", metric): np.array(
            [[published[setting, route, variant][metric] for route in ROUTES]]
        )
        for setting, variant in dict.fromkeys(
            (setting, variant) for setting, _, variant in published
        )
        for metric in METRICS
    }
    published_values |= {
        key: values[:1] for key, values in ours.values.items() if key[1] == "distance_m"
    }
    theirs = MetricValues(values=published_values, exact=True)
    return [(claim, claim.judge(ours), claim.judge(theirs)) for claim in CLAIMS]


VERDICTS: tuple[Verdict, ...] = ("holds", "depends", "does not hold", "undecided", "no data")


def listed(numbers: Sequence[int]) -> str:
    """Numbers as part of a sentence."""
    words = [str(number) for number in numbers]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]])) if words else "none"


def ratios(
    rows: Mapping[Key, Record],
    published: Mapping[Key, Mapping[str, float]],
    setting: str,
    variant: str,
    metric: str,
) -> Floats:
    """Our figure divided by the published one on each mission that has both. An alternative
    setting, which the paper does not print, is held against the setting in its column `like`.
    """
    mine = {
        (row["like"] or s, m, v): row
        for (s, m, v), row in rows.items()
        if (s, v) == (setting, variant)
    }
    return np.array(
        [row[metric] / published[key][metric] for key, row in mine.items() if key in published]
    )


def _cell_findings(
    setting: str,
    variant: str,
    rows: Mapping[Key, Record],
    published: Mapping[Key, Mapping[str, float]],
) -> dict[str, Finding]:
    findings = {}
    name = f"{setting} {variant}"
    mine = {mission: row for (s, mission, v), row in rows.items() if (s, v) == (setting, variant)}
    to_theirs = ratios(rows, published, setting, variant, "e_p_mean_m")
    if to_theirs.size:
        value, low, high = (round(float(f(to_theirs)), 4) for f in (np.median, np.min, np.max))
        meaning = "mean E_P, ours over the paper's: median, least and largest of the missions"
        findings[f"ratio {name}"] = Finding(value=value, low=low, high=high, what=meaning)
    locked = proportion(
        *(sum(int(row[c]) for row in mine.values()) for c in ("mirror_locked_runs", "runs"))
    )
    findings[f"mirror-locked {name}"] = interval_finding(
        locked, "probability of a mirror lock over all missions, 95 %"
    )
    for mission, row in mine.items():
        if row["like"]:
            ours = row["e_p_mean_m"]
            theirs = published[row["like"], mission, variant]["e_p_mean_m"]
            findings[f"error {name} {mission}"] = plain_finding(ours, "mean E_P", "m")
            findings[f"printed {name} {mission}"] = plain_finding(
                theirs, "mean E_P that the paper prints", "m"
            )
            findings[f"apart {name} {mission}"] = plain_finding(
                abs(ours - theirs), "the difference of the two", "m"
            )
    return findings


def findings_of_rows(
    rows: Mapping[Key, Record],
    published: Mapping[Key, Mapping[str, float]],
    judgements: Sequence[tuple[Claim, ClaimJudgement, ClaimJudgement]],
) -> dict[str, Finding]:
    """All findings, from rows and verdicts."""
    runs = next(iter(rows.values()))["runs"]
    findings = {
        "cells": plain_finding(len(rows), "cells flown"),
        "runs": plain_finding(runs, "runs of each cell"),
    }
    for i, owner in ((1, "our"), (2, "the paper's")):
        for verdict in VERDICTS:
            numbers = [judged[0].number for judged in judgements if judged[i].verdict == verdict]  # type: ignore[union-attr]
            meaning = f"claims of the paper, judged on {owner} figures: {verdict}"
            findings[f"{owner} {verdict} number"] = plain_finding(len(numbers), meaning)
            findings[f"{owner} {verdict}"] = plain_finding(listed(numbers), meaning)
    for claim, ours, _ in judgements:
        for number, criterion in enumerate(ours.criteria, start=1):
            meaning = (
                f"{criterion.quantity}, {criterion.relation} {criterion.bound:g}: "
                f"{criterion.outcome}; {VERDICT_CONFIDENCE:.1%}"
            )
            findings[f"criterion {claim.number}.{number}"] = interval_finding(
                criterion.interval, meaning
            )
    for setting, variant in dict.fromkeys((setting, variant) for setting, _, variant in rows):
        findings |= _cell_findings(setting, variant, rows, published)
    return findings


def further_runs(outcomes: Mapping[str, StudyResults]) -> dict[str, RunTotals]:
    """The runs of all replications of the cells that claims compare."""
    runs = REPLICATIONS * outcomes["tables"].plan.study.runs
    numbers = {
        (labels["point"], labels["arm"], labels["realization"]): runs
        for labels, lists in outcomes["tables"].runs
        if f"{labels['case']} {labels['arm']}" in JUDGED_CELLS and len(lists["run"]) < runs
    }
    return {"tables": numbers} if numbers else {}


def findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]:
    """Findings of both parts of the study."""
    theirs = published()
    return findings_of_rows(rows_of(outcomes), theirs, judge(MetricValues.of(outcomes), theirs))
