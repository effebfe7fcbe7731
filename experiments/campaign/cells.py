"""Cells of a campaign: what is flown many times over, and what comes of it."""

import math
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from experiments.campaign import lane_metrics as metric
from experiments.campaign.missions import Mission, mission_of, motion_of
from laisn.arrays import Bools, Floats, Ints, own_arrays
from laisn.compiled import compiled_lanes
from laisn.estimates import FixKind
from laisn.failure import LaisnError
from laisn.lane_rows import LANES
from laisn.metrics import Summary
from laisn.navigators import NavigatorSpec, find, spec_of
from laisn.settings import NavigationSettings, Settings
from sim.flight import navigation_settings
from sim.scenario.settings import Scenario
from sim.sensing.errors import SensorErrors, errors_of
from sim.sensing.observation import MissionTruth

PERCENTILES = (50, 90, 95, 99)


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
        cls, scenario: Scenario, follower: int = 0, runs: int | range = 60, *, mission: Mission | None = None
    ) -> Self:
        """The cell of a scenario: its run k is the scenario flown with `run = k`, noise and all.

        Args:
            scenario: to fly; its own `run` does not matter.
            follower: its index, 0 for the first.
            runs: how many, from run 0 on, or which.
            mission: the scenario's flight; None: it is flown, once for scenarios that follow each other and move alike.

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
        )


@dataclass(frozen=True, kw_only=True)
class RunTable:
    """Results of each run, arrays of shape (R,)."""

    run: Ints
    e_p_max_m: Floats
    e_p_mean_m: Floats
    e_b_max_deg: Floats
    e_b_mean_deg: Floats
    mirror_locked: Bools
    gated: Ints
    """Fixes that the gate rejected."""

    def __post_init__(self) -> None:
        own_arrays(self)


@dataclass(frozen=True, kw_only=True)
class CellResult:
    """What a cell comes to."""

    seed: int
    runs: int
    steps: int
    """Steps of one run."""
    errors: Summary
    """Errors over all steps of all runs."""
    e_p_percentiles_m: tuple[float, ...]
    """Percentiles of E_P at `PERCENTILES`, to within 1 % [m]."""
    e_b_percentiles_deg: tuple[float, ...]
    """Percentiles of E_B at `PERCENTILES`, to within 1 % [°]."""
    nees: float
    """Mean normalised squared error of the position (2 if the covariance is right), where it is not singular."""
    nis: float
    """Mean normalised squared innovation of the fixes that were used (2 if S is right)."""
    mirror_locked: int
    """Runs whose estimate was for a message interval more than 5 m off and at least twice as far from the truth as from
    its mirror image beyond the leader's axis: see `laisn.metrics.is_mirror_locked`."""
    fixes: dict[str, int]
    """Number of fixes of each `FixKind`, by its name in lower case; "gated" are those that the gate rejected."""
    worst_run: int
    """The run with the largest E_P."""
    table: RunTable | None
    """Table of the single runs, if it was asked for."""


@compiled_lanes
def _add_in_order(total: Floats, runs: Floats) -> None:
    """Add columns one after another: rounding must not depend on how runs are split into blocks."""
    for i in range(runs.shape[1]):
        for j in range(runs.shape[0]):
            total[j] += runs[j, i]


_OF_RUNS = [
    number // LANES
    for number in (
        metric.MAX_P,
        metric.SUM_P,
        metric.MAX_B,
        metric.SUM_B,
        metric.LONGEST_MIRROR_LOCK,
        metric.KINDS + FixKind.GATED * LANES,
    )
]
"""Rows of a tally that a `RunTable` is made of."""


class CellSums:
    """Adds up the blocks of a cell, which come in the order of runs."""

    def __init__(self, cell: Cell, keep_runs: bool) -> None:
        self._cell = cell
        self._total = np.zeros(metric.SIZE // LANES)
        self._largest = np.zeros(metric.SIZE // LANES)
        self._histograms = np.zeros((2, metric.BINS), dtype=np.int64)
        self._mirror_locked = 0
        self._worst_run = cell.runs[0]
        self._kept = np.empty((len(_OF_RUNS), len(cell.runs))) if keep_runs else None
        gaps = np.diff(cell.truth.message_step)
        self._interval = float(np.median(gaps)) if gaps.size else float(cell.truth.speed.size)

    def add(self, runs: range, tally: Floats, histograms: Ints) -> None:
        """Add a block; LaisnError naming the run if an estimate left finite numbers."""
        table = tally.reshape(-1, LANES)[:, : len(runs)]
        diverged = np.flatnonzero(~np.isfinite(table[metric.SUM_P // LANES]))
        if diverged.size:
            raise LaisnError(f"the estimate of run {runs[int(diverged[0])]} left finite numbers; check the settings")
        _add_in_order(self._total, table)
        worst = int(np.argmax(table[metric.MAX_P // LANES]))
        if table[metric.MAX_P // LANES, worst] > self._largest[metric.MAX_P // LANES]:
            self._worst_run = runs[worst]
        self._largest = np.maximum(self._largest, table.max(axis=1))
        self._histograms += histograms
        self._mirror_locked += int(np.count_nonzero(table[metric.LONGEST_MIRROR_LOCK // LANES] >= self._interval))
        if self._kept is not None:
            first = runs[0] - self._cell.runs[0]
            self._kept[:, first : first + len(runs)] = table[_OF_RUNS]

    def _summary(self) -> Summary:
        values = self._cell.truth.speed.size * len(self._cell.runs)

        def moments(total: int, squares: int) -> tuple[float, float]:
            mean = float(self._total[total // LANES] / values)
            return mean, math.sqrt(max(float(self._total[squares // LANES] / values) - mean * mean, 0.0))

        position, bearing = moments(metric.SUM_P, metric.SQUARES_P), moments(metric.SUM_B, metric.SQUARES_B)
        return Summary(
            e_p_max_m=float(self._largest[metric.MAX_P // LANES]),
            e_p_mean_m=position[0],
            e_p_std_m=position[1],
            e_b_max_deg=math.degrees(self._largest[metric.MAX_B // LANES]),
            e_b_mean_deg=math.degrees(bearing[0]),
            e_b_std_deg=math.degrees(bearing[1]),
        )

    def _percentiles(self, histogram: Ints, lowest: float, largest: int) -> list[float]:
        top = float(self._largest[largest // LANES])
        return [metric.percentile(histogram, lowest, p / 100.0, top) for p in PERCENTILES]

    def _table(self) -> RunTable | None:
        if self._kept is None:
            return None
        largest_p, sum_p, largest_b, sum_b, longest_mirror_lock, gated = self._kept
        steps = self._cell.truth.speed.size
        return RunTable(
            run=np.array(self._cell.runs, dtype=np.int64),
            e_p_max_m=largest_p,
            e_p_mean_m=sum_p / steps,
            e_b_max_deg=np.rad2deg(largest_b),
            e_b_mean_deg=np.rad2deg(sum_b / steps),
            mirror_locked=longest_mirror_lock >= self._interval,
            gated=gated.astype(np.int64),
        )

    def result(self) -> CellResult:
        """What the cell comes to."""

        def mean(total: int, number: int) -> float:
            count = self._total[number // LANES]
            return float(self._total[total // LANES] / count) if count else math.nan

        first = metric.KINDS // LANES
        return CellResult(
            seed=self._cell.seed,
            runs=len(self._cell.runs),
            steps=self._cell.truth.speed.size,
            errors=self._summary(),
            e_p_percentiles_m=tuple(self._percentiles(self._histograms[0], metric.LOWEST_P, metric.MAX_P)),
            e_b_percentiles_deg=tuple(
                math.degrees(p) for p in self._percentiles(self._histograms[1], metric.LOWEST_B, metric.MAX_B)
            ),
            nees=mean(metric.SUM_NEES, metric.COUNT_NEES),
            nis=mean(metric.SUM_NIS, metric.COUNT_NIS),
            mirror_locked=self._mirror_locked,
            fixes={kind.name.lower(): int(self._total[first + kind]) for kind in FixKind},
            worst_run=self._worst_run,
            table=self._table(),
        )
