"""The paper's claims of `claims.toml`, and the verdicts that their criteria lead to.

A claim is judged on figures of the eight missions. Where the published tables have the figures that it needs, it is
judged on them too, so that a criterion which the paper itself would fail shows.
"""

import operator
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from pydantic import TypeAdapter

from experiments.campaign.store import Record
from experiments.flight.library import ROUTES
from experiments.intervals import Interval, proportion
from experiments.studies.reproduction import replications
from experiments.studies.reproduction.replications import NEAR_BURST_S, VERDICT_CONFIDENCE, Figures, limits
from experiments.studies.reproduction.settings import VARIANT_NAMES, Key, data
from laisn.arrays import Bools, Floats

Verdict = Literal["holds", "does not hold", "depends", "undecided", "no data"]
Relation = Literal["<", "≤", ">", "≥"]
Outcome = Literal["met", "not met", "undecided"]
MARGIN = 0.01
"""A figure nearer than this share of its bound cannot be told from it: the paper prints errors of some metres with two
decimals, so that its own ratios are that uncertain."""
LATERAL, BURST = ("T3", "T4"), ("T8",)
"""Missions of followers that stay abeam, and with a burst of speed, as the paper names them."""

_HOLDS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt, "≤": operator.le, ">": operator.gt, "≥": operator.ge,
}  # fmt: skip


class NoDataError(LookupError):
    """Figures that a claim needs are missing."""


class Criterion(NamedTuple):
    """A part of a claim: a figure, and the bound that it must keep."""

    what: str
    value: Floats
    """Shape (), or (B,) of B resamples."""
    relation: Relation
    bound: float
    kind: Literal["ratio", "share", "replications"] = "ratio"
    """A ratio, whose interval is symmetric in its logarithm; a share, whose interval is symmetric; or a share of
    replications, with the exact limits of a proportion."""


Evaluated = tuple[Sequence[Criterion], str]
"""The criteria of a claim on some figures, and the numbers behind them, which say nothing of resamples."""


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
        ends = [_HOLDS[self.relation](end, bound) for end in self.interval[1:] for bound in bounds]
        return "met" if all(ends) else "undecided" if any(ends) else "not met"

    def __str__(self) -> str:
        """Figure, limits, bound and outcome."""
        value, low, high = self.interval
        limits = "" if low == high == value else f" ({low:.2f} to {high:.2f})"
        return f"{self.what}: {value:.2f}{limits} {self.relation} {self.bound:g}: {self.outcome}"


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The verdict on a claim."""

    verdict: Verdict
    figures: str
    """The numbers behind it."""
    criteria: Sequence[Judged] = ()


def verdict_of(outcomes: Sequence[Outcome]) -> Verdict:
    """All met: holds; none: does not hold; some: depends; undecided where that hangs on a criterion that is."""
    if "met" in outcomes and "not met" in outcomes:
        return "depends"
    return "undecided" if "undecided" in outcomes else "holds" if "met" in outcomes else "does not hold"


def _values(figures: Figures, cell: str, metric: str = "e_p_mean_m") -> Floats:
    found = figures.get((cell, metric))
    if found is None or not np.all(np.isfinite(found)):
        raise NoDataError
    return found


def _spread(ratio: Floats, names: Sequence[str] | npt.NDArray[np.str_]) -> str:
    """Median and range of a ratio, with the missions at both ends; nothing of resamples."""
    if ratio.ndim > 1:
        return ""
    low, high = int(np.argmin(ratio)), int(np.argmax(ratio))
    return f"median {np.median(ratio):.2f}, from {ratio[low]:.2f} ({names[low]}) to {ratio[high]:.2f} ({names[high]})"


def _statistic(name: str, ratio: Floats) -> Floats:
    """A statistic over missions, named as in `claims.toml`."""
    if name.startswith("share"):
        _, relation, limit = name.split()
        return np.asarray(np.mean(_HOLDS[relation](ratio, float(limit)), axis=-1))
    values = np.abs(np.log(ratio)) if name.endswith("change") else ratio
    found = np.asarray(np.quantile(values, 0.9 if name.startswith("nine tenths") else 0.5, axis=-1))
    return np.exp(found) if name.endswith("change") else found


def _medians(above: Floats, below: Floats) -> Floats:
    return _statistic("median", above) / _statistic("median", below)


def _of_ratios(claim: "Claim", figures: Figures) -> Evaluated:
    ratios, texts = [], []
    for given in claim.ratios:
        metric, chosen, cells = given.get("metric", "e_p_mean_m"), given.get("missions", ROUTES), given["of"]
        at = np.isin(ROUTES, chosen)
        above, below = (
            np.concatenate([_values(figures, cell, metric)[..., at] for cell in given[side]], axis=-1)
            for side in ("of", "over")
        )
        ratios.append(above / below)
        variants = [f" {VARIANT_NAMES[cell.split()[1]]}" if len(cells) > 1 else "" for cell in cells]
        names = [f"{mission}{variant}" for variant in variants for mission in chosen]
        texts.append(f"{given['name']}: {_spread(ratios[-1], names)}")
    criteria = [
        Criterion(what, _statistic(name, ratios[i]), relation, bound, "share" if name.startswith("share") else "ratio")
        for what, i, name, relation, bound in claim.criteria
    ]
    return criteria, "; ".join(texts)


def _lateral(figures: Figures, each: Figures) -> Evaluated:
    at = np.isin(ROUTES, LATERAL)
    error, largest = _values(figures, "base laisn-2", "e_p_max_m"), each["base laisn-2", "e_p_max_m"]
    worst, best = error[..., at], error[..., ~at]
    below = np.mean(largest[:, at].max(axis=-1) < largest[:, ~at].min(axis=-1))
    criteria = [
        Criterion("median E_P max, abeam over the others", _medians(worst, best), "<", 1.0),
        Criterion("share of replications with E_P max abeam below each other", below, ">", 0.5, "replications"),
    ]
    text = f"E_P max of {', '.join(LATERAL)}: {worst.min():.2f} … {worst.max():.2f} m; "
    text += f"of the others {best.min():.2f} … {best.max():.2f} m"
    none = np.full(error.shape, np.nan)
    abeam, astern = (figures.get(("base laisn-2", f"e_p_{where}_m"), none) for where in ("abeam", "astern"))
    both: Bools = np.asarray(np.isfinite(abeam + astern).reshape(-1, len(ROUTES)).all(axis=0))
    if both.any():
        better, spread = (abeam < astern)[..., both], _spread((astern / abeam)[..., both], np.array(ROUTES)[both])
        criteria.append(
            Criterion("share of missions better abeam than astern", better.mean(axis=-1), ">", 0.5, "share")
        )
        text += (
            f"; mean E_P astern over abeam within a mission: {spread}, abeam better on {better.sum()} of {both.sum()}"
        )
    return criteria, text


def _heading(figures: Figures, each: Figures) -> Evaluated:
    error, distance = _values(figures, "heading5 laisn-2"), _values(figures, "base laisn-2", "distance_m")
    growth, lateral = error / _values(figures, "base laisn-2"), np.isin(ROUTES, LATERAL)
    grown, elsewhere = (_statistic("median", growth[..., at]) for at in (lateral, ~lateral))
    slope = np.sum(error * distance, axis=-1) / np.sum(distance**2, axis=-1)
    # of a line through the origin: what it leaves over the spread about the mean
    left = np.sum((error - slope[..., None] * distance) ** 2, axis=-1)
    spread = np.sum((error - error.mean(axis=-1, keepdims=True)) ** 2, axis=-1)
    fit = 1.0 - np.divide(left, spread, out=np.ones_like(left), where=spread > 0.0)
    criteria = [
        Criterion("growth abeam, over that elsewhere and over 5", np.minimum(grown / elsewhere, grown / 5.0), ">", 1.0),
        Criterion("variance that the line explains", fit, "≥", 0.8, "share"),
    ]
    if error.ndim > 1:
        return criteria, ""
    return criteria, (
        f"E_P grows {grown:.1f} times on {', '.join(LATERAL)}, {elsewhere:.1f} times on the others (medians); "
        f"E_P = {slope:.3f} × mean distance ({np.rad2deg(slope):.1f}°) explains {100 * fit:.0f} % of its variance"
    )


def _burst(figures: Figures, each: Figures) -> Evaluated:
    at = np.isin(ROUTES, BURST)
    error, largest = _values(figures, "base laisn-2", "e_b_max_deg"), each["base laisn-2", "e_b_max_deg"]
    mine, theirs = error[..., at], error[..., ~at]
    most = np.mean(largest[:, at].max(axis=-1) > largest[:, ~at].max(axis=-1))
    criteria = [
        Criterion(
            "largest E_B, median of the bursts over the others'",
            _medians(mine, theirs),
            ">",
            1.0,
        ),
        Criterion("share of replications with the largest E_B in a burst", most, ">", 0.5, "replications"),
    ]
    near = figures.get(("base laisn-2", "e_b_peaks_at_burst"))
    if near is not None:
        what = f"share of replications with the peak within {NEAR_BURST_S:.0f} s of the burst"
        criteria.append(Criterion(what, np.mean(near[..., at], axis=-1), ">", 0.5, "replications"))
    text = f"largest E_B {error.max():.1f}° on {ROUTES[int(np.argmax(error)) % len(ROUTES)]}; {', '.join(BURST)} "
    return criteria, f"{text}{np.median(mine):.1f}°, others: {_spread(theirs, np.array(ROUTES)[~at])}"


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

    def _evaluated(self, figures: Figures, each: Figures) -> Evaluated:
        return _TESTS[self.test](figures, each) if self.test else _of_ratios(self, figures)

    def judge(self, figures: Figures, each: Figures | None = None, drawn: Figures | None = None) -> Judgement:
        """The verdict on figures of the missions, shape (8,).

        Args:
            figures: means over replications.
            each: of each replication, shape (K, 8); None: there is one.
            drawn: of resamples of these, shape (B, 8), for intervals; None: the figures are taken as exact.
        """
        each = each or {key: values[None] for key, values in figures.items()}
        try:
            criteria, text = self._evaluated(figures, each)
            spread = self._evaluated(drawn, each)[0] if drawn else [None] * len(criteria)
        except NoDataError:
            missing = "the rows that this test needs were not run, or are not in the tables"
            return Judgement(verdict="no data", figures=missing)
        count = next(iter(each.values())).shape[0]
        judged = [_judged(*pair, count) for pair in zip(criteria, spread, strict=True)]
        return Judgement(verdict=verdict_of([one.outcome for one in judged]), figures=text, criteria=judged)


def _judged(point: Criterion, spread: Criterion | None, count: int) -> Judged:
    value, margin = float(point.value), MARGIN
    if spread is None:
        interval, margin = Interval(value, value, value), 0.0
    elif point.kind == "replications":
        interval = proportion(round(value * count), count, VERDICT_CONFIDENCE)
    else:
        interval = Interval(value, *limits(value, spread.value, count, is_share=point.kind == "share"))
    return Judged(what=point.what, interval=interval, relation=point.relation, bound=point.bound, margin=margin)


CLAIMS = TypeAdapter(tuple[Claim, ...]).validate_python(tomllib.loads(data("claims.toml"))["claim"])


def judge(
    rows: Iterable[Record], published: Mapping[Key, Mapping[str, float]]
) -> list[tuple[Claim, Judgement, Judgement]]:
    """Every claim on our figures, of rows of `replicate` of all missions, and on the published ones."""
    each = replications.by_replication(rows)
    ours, drawn = replications.means(each), replications.resampled(each)
    printed = (
        {"setting": s, "mission": m, "variant": v, "replication": 0, **row} for (s, m, v), row in published.items()
    )
    theirs = {**replications.means(replications.by_replication(printed))}
    theirs |= {key: values for key, values in ours.items() if key[1] == "distance_m"}
    return [(claim, claim.judge(ours, each, drawn), claim.judge(theirs)) for claim in CLAIMS]
