"""The paper's claims of `claims.toml`, and the verdicts that their criteria lead to.

A claim is judged on figures of the eight missions. Where the published tables have the figures that it needs, it is
judged on them too, so that a criterion which the paper itself would fail shows.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import TypeAdapter

from experiments.flight.library import ROUTES
from experiments.studies.reproduction.replications import (
    BASE,
    HOLDS,
    NEAR_BURST_S,
    Figures,
    Judged,
    NoDataError,
    Outcome,
    Relation,
)
from experiments.studies.reproduction.settings import METRICS, VARIANT_NAMES, Key, data
from laisn.arrays import Bools, Floats

Verdict = Literal["holds", "does not hold", "depends", "undecided", "no data"]
HEADING = "heading5 laisn-2"
LATERAL, BURST = np.isin(ROUTES, ("T3", "T4")), np.isin(ROUTES, ("T8",))
"""Missions of followers that stay abeam, and with a burst of speed, as the paper names them; shape (8,)."""

Evaluated = tuple[Sequence[Judged], str]
"""The criteria of a claim on some figures, and the numbers behind them."""


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


def _spread(ratio: Floats, names: Sequence[str] | npt.NDArray[np.str_]) -> str:
    """Median and range of a ratio over missions, with the missions at both ends."""
    low, high = int(np.argmin(ratio)), int(np.argmax(ratio))
    return f"median {np.median(ratio):.2f}, from {ratio[low]:.2f} ({names[low]}) to {ratio[high]:.2f} ({names[high]})"


def _statistic(name: str, ratio: Floats) -> Floats:
    """A statistic over missions, named as in `claims.toml`."""
    if name.startswith("share"):
        _, relation, limit = name.split()
        return np.asarray(np.mean(HOLDS[relation](ratio, float(limit)), axis=-1))
    values = np.abs(np.log(ratio)) if name.endswith("change") else ratio
    found = np.asarray(np.quantile(values, 0.9 if name.startswith("nine tenths") else 0.5, axis=-1))
    return np.exp(found) if name.endswith("change") else found


def _median_over_others(values: Floats, at: Bools) -> Floats:
    """Median of some missions over that of the others."""
    return _statistic("median", values[:, at]) / _statistic("median", values[:, ~at])


def _of_ratios(claim: "Claim", figures: Figures) -> Evaluated:
    ratios, texts = [], []
    for given in claim.ratios:
        metric, chosen, cells = given.get("metric", "e_p_mean_m"), given.get("missions", ROUTES), given["of"]
        at = np.isin(ROUTES, chosen)
        above, below = (
            np.concatenate([figures.means(cell, metric)[:, at] for cell in given[side]], axis=-1)
            for side in ("of", "over")
        )
        ratios.append(above / below)
        variants = [f" {VARIANT_NAMES[cell.split()[1]]}" if len(cells) > 1 else "" for cell in cells]
        names = [f"{mission}{variant}" for variant in variants for mission in chosen]
        texts.append(f"{given['name']}: {_spread(ratios[-1][0], names)}")
    criteria = [
        figures.judge(
            what, _statistic(name, ratios[i]), relation, bound, "share" if name.startswith("share") else "ratio"
        )
        for what, i, name, relation, bound in claim.criteria
    ]
    return criteria, "; ".join(texts)


def _lateral(figures: Figures) -> Evaluated:
    error, largest = figures.means(BASE, "e_p_max_m"), figures.each[BASE, "e_p_max_m"]
    below = largest[:, LATERAL].max(axis=1) < largest[:, ~LATERAL].min(axis=1)
    what = "share of replications with E_P max abeam below each other"
    criteria = [
        figures.judge("median E_P max, abeam over the others", _median_over_others(error, LATERAL), "<", 1.0),
        figures.judge(what, np.mean(below, keepdims=True), ">", 0.5, "replications"),
    ]
    abeam, astern = (figures.known(BASE, f"e_p_{where}_m") for where in ("abeam", "astern"))
    both = np.isfinite(abeam + astern).all(axis=0)
    if not both.any():
        return criteria, f"E_P max [m]: {_spread(error[0], ROUTES)}"
    ratio = (astern / abeam)[:, both]
    better = np.mean(ratio > 1.0, axis=1)
    criteria.append(figures.judge("share of missions better abeam than astern", better, ">", 0.5, "share"))
    return criteria, f"mean E_P astern over abeam within a mission: {_spread(ratio[0], np.array(ROUTES)[both])}"


def _heading(figures: Figures) -> Evaluated:
    error, distance = figures.means(HEADING), figures.means(BASE, "distance_m")
    growth = error / figures.means(BASE)
    grown, elsewhere = (_statistic("median", growth[:, at]) for at in (LATERAL, ~LATERAL))
    slope = np.sum(error * distance, axis=1) / np.sum(distance**2, axis=1)
    # of a line through the origin: what it leaves over the spread about the mean
    left = np.sum((error - slope[:, None] * distance) ** 2, axis=1)
    spread = np.sum((error - error.mean(axis=1, keepdims=True)) ** 2, axis=1)
    fit = 1.0 - np.divide(left, spread, out=np.ones_like(left), where=spread > 0.0)
    least = np.minimum(grown / elsewhere, grown / 5.0)
    return [
        figures.judge("growth abeam, over that elsewhere and over 5", least, ">", 1.0),
        figures.judge("variance that the line explains", fit, "≥", 0.8, "share"),
    ], (
        f"E_P grows {grown[0]:.1f} times abeam, {elsewhere[0]:.1f} times on the others (medians); "
        f"E_P = {slope[0]:.3f} × mean distance ({np.rad2deg(slope[0]):.1f}°)"
    )


def _burst(figures: Figures) -> Evaluated:
    error, largest = figures.means(BASE, "e_b_max_deg"), figures.each[BASE, "e_b_max_deg"]
    most = largest[:, BURST].max(axis=1) > largest[:, ~BURST].max(axis=1)
    shares = {"with the largest E_B in a burst": np.mean(most, keepdims=True)}
    near = figures.known(BASE, "e_b_peaks_at_burst")[:, BURST]
    if np.isfinite(near).all():
        shares[f"with the peak within {NEAR_BURST_S:.0f} s of the burst"] = near.mean(axis=1)
    return [
        figures.judge(
            "largest E_B, median of the bursts over the others'", _median_over_others(error, BURST), ">", 1.0
        ),
        *(figures.judge(f"share of replications {w}", v, ">", 0.5, "replications") for w, v in shares.items()),
    ], f"largest E_B [°]: {_spread(error[0], ROUTES)}"


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

    def judge(self, figures: Figures) -> Judgement:
        """The verdict on figures of the missions."""
        try:
            criteria, text = _TESTS[self.test](figures) if self.test else _of_ratios(self, figures)
        except NoDataError:
            missing = "the rows that this test needs were not run, or are not in the tables"
            return Judgement(verdict="no data", figures=missing)
        return Judgement(verdict=verdict_of([one.outcome for one in criteria]), figures=text, criteria=criteria)


CLAIMS = TypeAdapter(tuple[Claim, ...]).validate_python(tomllib.loads(data("claims.toml"))["claim"])
_COMPARED = (cell for claim in CLAIMS for ratio in claim.ratios for side in ("of", "over") for cell in ratio[side])
JUDGED = frozenset([BASE, HEADING, *_COMPARED])
"""Cells that the claims compare."""


def judge(ours: Figures, published: Mapping[Key, Mapping[str, float]]) -> list[tuple[Claim, Judgement, Judgement]]:
    """Every claim on our figures and on the published ones, which have our distances."""
    each = {
        (f"{setting} {variant}", metric): np.array([[published[setting, route, variant][metric] for route in ROUTES]])
        for setting, variant in dict.fromkeys((setting, variant) for setting, _, variant in published)
        for metric in METRICS
    }
    each |= {key: values[:1] for key, values in ours.each.items() if key[1] == "distance_m"}
    theirs = Figures(each=each, exact=True)
    return [(claim, claim.judge(ours), claim.judge(theirs)) for claim in CLAIMS]
