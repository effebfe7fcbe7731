"""Independent replications of the cells that claims are judged on, and what averaging over them leaves open.

A replication is the paper's experiment with noise of its own: as many runs of each cell, and their figures. All cells
of a replication share the numbers of their runs, so that comparisons are paired.
"""

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from scipy.special import stdtrit

from experiments.campaign.cells import Cell
from experiments.campaign.missions import mission_of, motion_of
from experiments.campaign.plans import steps_of
from experiments.campaign.store import Arrays, Record
from experiments.flight.library import ROUTES
from experiments.intervals import Interval, proportion
from experiments.studies.reproduction.settings import Key
from laisn.arrays import Floats
from laisn.geometry import signed_angle
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory

REPLICATIONS = 20
RESAMPLES = 2000
VERDICT_CONFIDENCE = 0.998
"""Of the interval of each criterion; of all 26 together 95 % (Bonferroni)."""
COMPARED = ("e_p_mean_m", "e_p_max_m", "e_b_max_deg")
"""Metrics that they compare."""
BASE = "base laisn-2"
"""The cell whose errors over time they take into account."""
ASTERN_DEG = 10.0
"""A follower within this angle of dead astern counts as astern."""
LATERAL_DEG = (45.0, 135.0)
"""Angle off the bow, either side, that counts as abeam."""
SECTOR_STEPS = 300
"""Steps (of 0.1 s) that a mission must spend in a sector to be counted there."""
NEAR_BURST_S = 30.0
"""The largest bearing error within this time of 95 % of the follower's top speed counts as that of the burst [s]."""
TIMED = ("e_p_abeam_m", "e_p_astern_m", "e_b_peaks_at_burst")
"""Mean E_P [m] abeam and astern, and whether the largest E_B of all runs is that of the burst: 1 or 0."""


def over_time(steps: Arrays) -> dict[str, float]:
    """Errors over time that claims use, named as in `TIMED`; NaN for a sector where the follower hardly is."""
    off_bow = np.rad2deg(np.abs(signed_angle(np.deg2rad(steps["bearing_deg"]))))
    abeam = (off_bow >= LATERAL_DEG[0]) & (off_bow <= LATERAL_DEG[1])
    error, time = steps["e_p_mean_m"], steps["time_s"]
    sectors = (abeam, off_bow >= 180.0 - ASTERN_DEG)
    means = (float(error[sector].mean()) if sector.sum() >= SECTOR_STEPS else np.nan for sector in sectors)
    fastest = time[steps["speed_m_s"] >= 0.95 * steps["speed_m_s"].max()]
    away = np.min(np.abs(time[np.argmax(steps["e_b_max_deg"])] - fastest))
    return dict(zip(TIMED, (*means, float(away <= NEAR_BURST_S)), strict=True))


def mean_distance(flight: Trajectory) -> float:
    """Mean distance of the first follower's hydrophone and the leader [m]."""
    site = flight.site(f"{flight.names[1]}/hydrophone")
    return float(np.hypot(*(flight.site_position[:, site, :2] - flight.position[:, 0, :2]).T).mean())


def replicate_over_time(scenario: Scenario, runs: int, replications: int) -> list[Record]:
    """Of each replication of a mission, `runs` runs each, what `over_time` finds, and the mean distance."""
    mission = mission_of(motion_of(scenario))
    distance = {"distance_m": mean_distance(mission.seen(scenario, 0)[0])}
    numbers = (range(k * runs, (k + 1) * runs) for k in range(replications))
    return [over_time(steps_of(Cell.of(scenario, runs=some, mission=mission))) | distance for some in numbers]


Kind = Literal["ratio", "share", "replications"]
"""A ratio, whose interval is symmetric in its logarithm; a share, whose interval is symmetric; a share of replications,
with the exact limits of a proportion."""


Relation = Literal["<", "≤", ">", "≥"]
Outcome = Literal["met", "not met", "undecided"]
MARGIN = 0.01
"""A figure nearer than this share of its bound is indistinguishable from it: the paper prints errors of some metres
with two decimals, so that its own ratios are that uncertain."""
HOLDS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt, "≤": operator.le, ">": operator.gt, "≥": operator.ge,
}  # fmt: skip
"""Relations of figures to bounds."""


class NoDataError(LookupError):
    """Figures that a claim needs are missing."""


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
        ends = [HOLDS[self.relation](end, bound) for end in self.interval[1:] for bound in bounds]
        return "met" if all(ends) else "undecided" if any(ends) else "not met"

    def __str__(self) -> str:
        """Figure, limits, bound and outcome."""
        value, low, high = self.interval
        limits = "" if low == high == value else f" ({low:.2f} to {high:.2f})"
        return f"{self.what}: {value:.2f}{limits} {self.relation} {self.bound:g}: {self.outcome}"


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Figures of the eight missions by setting with variant ("base laisn-2") and metric."""

    each: Mapping[tuple[str, str], Floats]
    """Of every replication, shape (K, 8)."""
    exact: bool = False
    """Without intervals, as the published ones."""

    @classmethod
    def of(cls, cells: Mapping[Key, Arrays], timed: Sequence[Sequence[Record]], runs: int) -> Self:
        """Figures of replications of a number of runs each.

        Args:
            cells: arrays over the runs of all replications, of each judged cell, missions in the order of `ROUTES`.
            timed: rows of `replicate_over_time` of all missions, or none.
            runs: of each replication.
        """
        found: dict[tuple[str, str], list[Floats]] = {}
        for (setting, _, variant), lists in cells.items():
            for metric in COMPARED:
                each = lists[metric].reshape(-1, runs)
                figure = each.max(axis=1) if "_max_" in metric else each.mean(axis=1)
                found.setdefault((f"{setting} {variant}", metric), []).append(figure)
        for name in (*TIMED, "distance_m") if timed else ():
            found[BASE, name] = [np.array([row[name] for row in rows]) for rows in timed]
        return cls(each={key: np.column_stack(missions) for key, missions in found.items()})

    @property
    def count(self) -> int:
        """Number of replications."""
        return len(next(iter(self.each.values())))

    @cached_property
    def _weights(self) -> Floats:
        """Of the replications in their mean, and in those of replications drawn again, shape (1 + `RESAMPLES`, K)."""
        mean = np.full((1, self.count), 1.0 / self.count)
        if self.exact:
            return mean
        drawn = np.random.default_rng([self.count, RESAMPLES]).multinomial(self.count, mean[0], size=RESAMPLES)
        return np.concatenate([mean, drawn / self.count])

    def known(self, cell: str, metric: str) -> Floats:
        """Means over replications, then those over replications drawn again, alike in all cells, shape (1 + B, 8).

        NaN where there are none.
        """
        values = self.each.get((cell, metric))
        if values is None:
            return np.full((1, len(ROUTES)), math.nan)
        # not by BLAS, whose sums depend on processor and threads
        return np.asarray(np.einsum("bk,km->bm", self._weights, values))

    def means(self, cell: str, metric: str = "e_p_mean_m") -> Floats:
        """As `known`; NoDataError where there are none."""
        found = self.known(cell, metric)
        if not np.all(np.isfinite(found)):
            raise NoDataError
        return found

    def interval(self, values: Floats, kind: Kind = "ratio") -> Interval:
        """Interval of a figure over missions, of the means and of resamples, shape (1 + B,); a point if `exact`.

        The standard error of a t interval is the bootstrap's, whose variance is K / (K − 1) times too small (Davison &
        Hinkley 1997, section 2.2).
        """
        value, drawn, count = float(values[0]), values[1:], self.count
        if self.exact:
            return Interval(value, value, value)
        if kind == "replications":
            return proportion(round(value * count), count, VERDICT_CONFIDENCE)
        quantile = float(stdtrit(count - 1, (1.0 + VERDICT_CONFIDENCE) / 2.0))
        wide = quantile * math.sqrt(count / (count - 1))
        if kind == "share":
            half = wide * float(drawn.std())
            return Interval(value, value - half, value + half)
        factor = math.exp(wide * float(np.log(drawn).std()))
        return Interval(value, value / factor, value * factor)

    def judge(self, what: str, values: Floats, relation: Relation, bound: float, kind: Kind = "ratio") -> Judged:
        """A criterion: a figure over missions as of `interval`, and the bound that it must keep."""
        margin = 0.0 if self.exact else MARGIN
        return Judged(what=what, interval=self.interval(values, kind), relation=relation, bound=bound, margin=margin)
