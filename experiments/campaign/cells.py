"""Cells of a campaign: missions flown many times, and their results."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, Self

import numpy as np
from scipy.special import chdtri

from experiments.campaign import lane_metrics as metric
from experiments.campaign.missions import Mission, mission_of, motion_of
from experiments.campaign.store import Arrays, Record
from laisn.arrays import Floats, Ints
from laisn.estimates import FixKind
from laisn.failure import LaisnError
from laisn.lane_passes import LANES
from laisn.messages import Measurements
from laisn.navigators import NavigatorSpec, find, spec_of
from laisn.settings import NavigationSettings, Settings
from sim.flight import navigation_settings
from sim.scenario.settings import Scenario
from sim.sensing.errors import SensorErrors, errors_of
from sim.sensing.observation import MissionTruth

PERCENTILES = (50, 90, 95, 99)


class Disturbance(Protocol):
    """Errors of the user's own, added to what a follower measures."""

    def disturb(self, measurements: Measurements, seed: int, run: int) -> Measurements:
        """The measurements of a run with the errors; a function of the arguments alone."""


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell of a campaign: one mission, one set of errors, one navigator, many runs."""

    truth: MissionTruth
    errors: SensorErrors = field(default_factory=SensorErrors)
    settings: Settings = field(default_factory=NavigationSettings)
    navigator: NavigatorSpec | None = None
    """None: the navigator of this project that takes these settings."""
    seed: int = 1
    runs: range = range(60)
    """Numbers of the runs, in steps of one."""
    follower: int = 0
    disturbance: Disturbance | None = None

    def __post_init__(self) -> None:
        if abs(self.settings.dt - self.truth.dt) > 1e-9:
            raise ValueError(f"settings.dt is {self.settings.dt} s, the mission's {self.truth.dt} s")
        if not self.runs or self.runs.step != 1:
            raise ValueError(f"runs are {self.runs}, expected at least one, in steps of one")

    @property
    def spec(self) -> NavigatorSpec:
        """The navigator."""
        return self.navigator or spec_of(self.settings)

    @classmethod
    def of(
        cls, scenario: Scenario, follower: int = 0, runs: int | range = 60, *, mission: Mission | None = None,
        disturbance: Disturbance | None = None,
    ) -> Self:  # fmt: skip
        """The cell of a scenario: its run k is the scenario flown with `run = k`, noise and all.

        Args:
            scenario: to fly; its own `run` does not matter.
            follower: its index, 0 for the first.
            runs: how many, from run 0 on, or which.
            mission: the scenario's flight; None: it is flown, once for scenarios that follow each other and move alike.
            disturbance: errors beside the scenario's.

        Raises:
            LaisnError: there is no such follower, or the mission is not the scenario's.
            CampaignError: the simulation left finite numbers.
        """
        if not 0 <= follower < len(scenario.followers):
            raise LaisnError(f"follower is {follower}, the scenario has {len(scenario.followers)}")
        trajectory, truth = (mission or mission_of(motion_of(scenario))).seen(scenario, follower)
        return cls(
            truth=truth,
            errors=errors_of(scenario, follower),
            settings=navigation_settings(scenario, trajectory, follower),
            navigator=find(scenario.navigation.variant),
            seed=scenario.seed,
            runs=range(runs) if isinstance(runs, int) else runs,
            follower=follower,
            disturbance=disturbance,
        )


class CellResult(NamedTuple):
    """What a cell comes to."""

    row: Record
    """Figures of all steps of all runs by their columns:

    - `seed`, `runs`, `steps` of one run;
    - `e_p_{max,mean,std}_m`, `e_b_{max,mean,std}_deg`, as of `laisn.metrics.Summary`;
    - `e_p_pQ_m`, `e_b_pQ_deg`: percentiles Q of `PERCENTILES`, to within 1 %;
    - `nees`: mean normalised squared error of the position (2 if the covariance is right), where it is not singular;
    - `nees_inside`: share of steps at which the sum of that over the runs is within its 95 % interval, of χ² with two
      degrees of freedom a run (Bar-Shalom, Li & Kirubarajan 2001, section 5.4.2); None if no covariance is regular;
    - `nis`: mean normalised squared innovation of the fixes that were used (2 if S is right);
    - `mirror_locked_runs`: runs whose estimate was for a message interval more than 5 m off and at least twice as
      far from the truth as from its mirror image beyond the leader's axis (`laisn.metrics.is_mirror_locked`);
    - `worst_run`: the run with the largest E_P;
    - `fixes_KIND`: number of fixes of each `FixKind`; "gated" are those that the gate rejected;
    - `e_p_mean_unlocked_m`: mean E_P of the runs that were not mirror_locked; None if all were.
    """
    runs: Arrays
    """Of each run, arrays of shape (R,): `run`, `e_p_max_m`, `e_p_mean_m`, `e_p_rms_m`, `e_b_max_deg`, `e_b_mean_deg`,
    `mirror_locked`, the number of fixes `gated`, and `nees` and `nis`, NaN where there are none."""


class CellSums:
    """Adds up the blocks of a cell, which come in the order of runs."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._tally = np.empty((metric.SIZE // LANES, len(cell.runs)))
        self._histograms = np.zeros((2, metric.BINS), dtype=np.int64)
        self._nees = np.zeros(cell.truth.speed.size)

    def add(self, runs: range, tally: Floats, histograms: Ints, nees: Floats) -> None:
        """Add a block; LaisnError naming the run if an estimate left finite numbers."""
        table = tally.reshape(-1, LANES)[:, : len(runs)]
        diverged = np.flatnonzero(~np.isfinite(table[metric.SUM_P // LANES]))
        if diverged.size:
            raise LaisnError(f"the estimate of run {runs[int(diverged[0])]} left finite numbers; check the settings")
        first = runs[0] - self._cell.runs[0]
        self._tally[:, first : first + len(runs)] = table
        self._histograms += histograms
        self._nees += nees

    def _of_runs(self, number: int) -> Floats:
        """A number of the tally for each run, shape (R,)."""
        return np.asarray(self._tally[number // LANES])

    def _mean(self, total: int, count: int) -> float:
        number = self._of_runs(count).sum()
        return float(self._of_runs(total).sum() / number) if number else math.nan

    def _moments(self, total: int, squares: int) -> tuple[float, float]:
        """Mean and standard deviation of an error over all steps of all runs."""
        values = self._cell.truth.speed.size * len(self._cell.runs)
        mean = float(self._of_runs(total).sum() / values)
        return mean, math.sqrt(max(float(self._of_runs(squares).sum() / values) - mean * mean, 0.0))

    def _percentiles(self, histogram: Ints, lowest: float, largest: int) -> Iterator[tuple[int, float]]:
        top = float(self._of_runs(largest).max())
        return ((p, metric.percentile(histogram, lowest, p / 100.0, top)) for p in PERCENTILES)

    def _share_inside(self) -> float | None:
        low, high = chdtri(2.0 * len(self._cell.runs), np.array([0.975, 0.025]))
        known = self._nees[np.isfinite(self._nees)]
        return float(np.mean((known >= low) & (known <= high))) if known.size else None

    def result(self) -> CellResult:
        """What the cell comes to."""
        steps, (of_position, of_bearing) = self._cell.truth.speed.size, self._histograms
        largest_p, largest_b = self._of_runs(metric.MAX_P), self._of_runs(metric.MAX_B)
        gaps = np.diff(self._cell.truth.message_step)
        shortest_lock = float(np.median(gaps)) if gaps.size else float(steps)
        mirror_locked = self._of_runs(metric.LONGEST_MIRROR_LOCK) >= shortest_lock
        runs: Arrays = {
            "run": np.array(self._cell.runs, dtype=np.int64),
            "e_p_max_m": largest_p,
            "e_p_mean_m": self._of_runs(metric.SUM_P) / steps,
            "e_p_rms_m": np.sqrt(self._of_runs(metric.SQUARES_P) / steps),
            "e_b_max_deg": np.rad2deg(largest_b),
            "e_b_mean_deg": np.rad2deg(self._of_runs(metric.SUM_B) / steps),
            "mirror_locked": mirror_locked,
            "gated": self._of_runs(metric.KINDS + FixKind.GATED * LANES).astype(np.int64),
        }
        normalised = (("nees", metric.SUM_NEES, metric.COUNT_NEES), ("nis", metric.SUM_NIS, metric.COUNT_NIS))
        for name, total, count in normalised:
            number = self._of_runs(count)
            runs[name] = np.divide(self._of_runs(total), number, out=np.full(number.size, np.nan), where=number > 0.0)
        e_p_mean, e_p_std = self._moments(metric.SUM_P, metric.SQUARES_P)
        e_b_mean, e_b_std = self._moments(metric.SUM_B, metric.SQUARES_B)
        row: Record = {
            "seed": self._cell.seed,
            "runs": len(self._cell.runs),
            "steps": steps,
            "e_p_max_m": float(largest_p.max()),
            "e_p_mean_m": e_p_mean,
            "e_p_std_m": e_p_std,
            "e_b_max_deg": math.degrees(largest_b.max()),
            "e_b_mean_deg": math.degrees(e_b_mean),
            "e_b_std_deg": math.degrees(e_b_std),
        }
        of_positions = self._percentiles(of_position, metric.LOWEST_P, metric.MAX_P)
        of_bearings = self._percentiles(of_bearing, metric.LOWEST_B, metric.MAX_B)
        row |= {f"e_p_p{p}_m": value for p, value in of_positions}
        row |= {f"e_b_p{p}_deg": math.degrees(value) for p, value in of_bearings}
        row |= {
            "nees": self._mean(metric.SUM_NEES, metric.COUNT_NEES),
            "nees_inside": self._share_inside(),
            "nis": self._mean(metric.SUM_NIS, metric.COUNT_NIS),
            "mirror_locked_runs": int(np.count_nonzero(mirror_locked)),
            "worst_run": self._cell.runs[int(np.argmax(largest_p))],
        }
        fixes = self._tally[metric.KINDS // LANES :].sum(axis=1)
        row |= {f"fixes_{kind.name.lower()}": int(fixes[kind]) for kind in FixKind}
        row["e_p_mean_unlocked_m"] = None if mirror_locked.all() else float(runs["e_p_mean_m"][~mirror_locked].mean())
        return CellResult(row, runs)
