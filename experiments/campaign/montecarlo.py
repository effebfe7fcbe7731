"""Monte Carlo campaigns: noise, navigation and metrics fused over runs, in memory that does not grow with them.

A cell is a mission flown many times. Its runs are flown in blocks side by side. Every block is computed alone and added
up in the order of runs, so that results depend neither on the number of threads nor on how runs are split into blocks,
to the bit. Run k takes exactly the noise that `sim.sensing.observation.measure(…, run=k)` gives a single flight.
"""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from itertools import chain, islice
from typing import NamedTuple, Protocol, Self

import numpy as np
from scipy.special import chdtri

from experiments.campaign import lane_flight
from experiments.campaign import lane_metrics as metric
from experiments.campaign.missions import Mission, mission_of, motion_of
from experiments.campaign.store import Arrays, Record
from laisn import lane_passes as row
from laisn import lanes
from laisn.arrays import Floats, Ints
from laisn.estimates import FixKind
from laisn.failure import LaisnError
from laisn.lane_passes import LANES
from laisn.messages import Measurements
from laisn.navigators import MissionResult, NavigatorSpec, find, spec_of
from laisn.settings import NavigationSettings, Settings
from sim.flight import navigation_settings
from sim.scenario.settings import Scenario
from sim.sensing.observation import MissionTruth, measure
from sim.sensing.sensors import SensorErrors, errors_of

PERCENTILES = (50, 90, 95, 99)
_NO_HISTORY = np.empty((0, 4 * LANES))


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

    @property
    def in_lanes(self) -> bool:
        """Whether runs are measured and navigated side by side."""
        return self.spec.lanes and self.disturbance is None

    @property
    def blocks(self) -> list[range]:
        """Runs of each block."""
        return [self.runs[i : i + LANES] for i in range(0, len(self.runs), LANES)]

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
            LaisnError: there is no such follower, or the mission is not the scenario's, or it cannot be flown.
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


_Block = tuple[Floats, Ints, Floats]
"""Tally, histograms, and sums over the runs of the NEES of each step, as of `lane_flight.fly_block`."""


def _summed(cell: Cell, flown: Iterator[_Block]) -> CellResult:
    """The result of a cell from its blocks in the order of runs; LaisnError naming the run if an estimate diverged."""
    truth, steps, size = cell.truth, cell.truth.speed.size, len(cell.runs)
    tally, nees = np.empty((metric.SIZE // LANES, size)), np.zeros(steps)
    histograms = np.zeros((2, metric.BINS), dtype=np.int64)
    for block in cell.blocks:
        sums, counts, squares = next(flown)
        table = sums.reshape(-1, LANES)[:, : len(block)]
        diverged = np.flatnonzero(~np.isfinite(table[metric.SUM_P // LANES]))
        if diverged.size:
            raise LaisnError(f"the estimate of run {block[int(diverged[0])]} left finite numbers; check the settings")
        first = block[0] - cell.runs[0]
        tally[:, first : first + len(block)] = table
        histograms += counts
        nees += squares

    def of_runs(number: int) -> Floats:
        return np.asarray(tally[number // LANES])

    gaps = np.diff(truth.message_step)
    shortest_lock = float(np.median(gaps)) if gaps.size else float(steps)
    mirror_locked = of_runs(metric.LONGEST_MIRROR_LOCK) >= shortest_lock
    runs: Arrays = {
        "run": np.array(cell.runs, dtype=np.int64),
        "e_p_max_m": of_runs(metric.MAX_P),
        "e_p_mean_m": of_runs(metric.SUM_P) / steps,
        "e_p_rms_m": np.sqrt(of_runs(metric.SQUARES_P) / steps),
        "e_b_max_deg": np.rad2deg(of_runs(metric.MAX_B)),
        "e_b_mean_deg": np.rad2deg(of_runs(metric.SUM_B) / steps),
        "mirror_locked": mirror_locked,
        "gated": of_runs(metric.KINDS + FixKind.GATED * LANES).astype(np.int64),
    }
    errors: Record = {"seed": cell.seed, "runs": size, "steps": steps}
    percentiles: Record = {}
    for kind, unit, convert, total, squared, largest, lowest, histogram in (
        ("p", "m", float, metric.SUM_P, metric.SQUARES_P, metric.MAX_P, metric.LOWEST_P, histograms[0]),
        ("b", "deg", math.degrees, metric.SUM_B, metric.SQUARES_B, metric.MAX_B, metric.LOWEST_B, histograms[1]),
    ):
        top, mean = float(of_runs(largest).max()), float(of_runs(total).sum() / (steps * size))
        variance = float(of_runs(squared).sum() / (steps * size)) - mean * mean
        for name, value in (("max", top), ("mean", mean), ("std", math.sqrt(max(variance, 0.0)))):
            errors[f"e_{kind}_{name}_{unit}"] = convert(value)
        for p in PERCENTILES:
            value = metric.percentile(histogram, lowest, p / 100.0, top)
            percentiles[f"e_{kind}_p{p}_{unit}"] = convert(value)
    means: Record = {}
    for name, total, count in (
        ("nees", metric.SUM_NEES, metric.COUNT_NEES),
        ("nis", metric.SUM_NIS, metric.COUNT_NIS),
    ):
        number, every = of_runs(count), of_runs(count).sum()
        runs[name] = np.divide(of_runs(total), number, out=np.full(size, np.nan), where=number > 0.0)
        means[name] = float(of_runs(total).sum() / every) if every else math.nan
    low, high = chdtri(2.0 * size, np.array([0.975, 0.025]))
    known = nees[np.isfinite(nees)]
    fixes = tally[metric.KINDS // LANES :].sum(axis=1)
    whole: Record = {
        "nees": means["nees"],
        "nees_inside": float(np.mean((known >= low) & (known <= high))) if known.size else None,
        "nis": means["nis"],
        "mirror_locked_runs": int(np.count_nonzero(mirror_locked)),
        "worst_run": cell.runs[int(np.argmax(runs["e_p_max_m"]))],
        **{f"fixes_{kind.name.lower()}": int(fixes[kind]) for kind in FixKind},
        "e_p_mean_unlocked_m": None if mirror_locked.all() else float(runs["e_p_mean_m"][~mirror_locked].mean()),
    }
    return CellResult(errors | percentiles | whole, runs)


def single_runs(cell: Cell, runs: Sequence[int]) -> list[MissionResult]:
    """Runs of a cell one by one, or those of lanes of up to LANES together; errors as of its navigator."""
    truth, used = cell.truth, cell.settings.transmitters
    measured = [
        measure(truth, cell.errors, seed=cell.seed, run=run, follower=cell.follower, transmitters=used) for run in runs
    ]
    if cell.disturbance is not None:
        disturb = cell.disturbance.disturb
        measured = [disturb(one, cell.seed, run) for one, run in zip(measured, runs, strict=True)]
    if not cell.spec.lanes:
        return [cell.spec.fly(cell.settings, one, truth.start) for one in measured]
    found = lanes.run(measured, truth.start, cell.settings)  # type: ignore[arg-type]  # the registry's own pair
    unknown = np.full((truth.speed.size, 3), np.nan)
    return [
        MissionResult(found.state[..., i], unknown, found.fix_kind[..., i].ravel().tolist(), 0.0, 0.0)
        for i in range(len(measured))
    ]


def _fly_single_runs(cell: Cell, runs: range) -> _Block:
    """Results of up to LANES runs; squared innovations of r numbers count as r/2 updates of a position, of mean 2.

    Raises:
        LaisnError: the start is unknown, so that a run has no error before its first message.
        ArithmeticError: a covariance is not positive definite.
    """
    if not cell.settings.known_start:
        raise LaisnError("navigation.assume.known_start = false is for single flights; cells need errors of all steps")
    truth = cell.truth
    states = np.ones((truth.speed.size, 5, LANES))
    columns = np.zeros((metric.SIZE // LANES, LANES))
    for lane, found in enumerate(single_runs(cell, runs)):
        states[:, :2, lane], states[:, 2:, lane] = found.state[:, :2], found.covariance
        columns[metric.SUM_NIS // LANES, lane] = found.squared
        columns[metric.COUNT_NIS // LANES, lane] = 0.5 * found.numbers
        for kind in found.kinds:
            columns[metric.KINDS // LANES + kind, lane] += 1.0
    tally, histograms, nees = columns.ravel(), np.zeros((2, metric.BINS), dtype=np.int64), np.empty(len(states))
    place = np.column_stack([truth.hydrophone, truth.leader_position, truth.leader_heading])
    metric.tally_states(states, place, tally, histograms, nees, len(runs))
    return tally, histograms, nees


def _fly(cell: Cell, truth: lane_flight.TruthRecord, runs: range, history: Floats = _NO_HISTORY) -> _Block:
    if not cell.in_lanes:
        return _fly_single_runs(cell, runs)
    sensors, t = lane_flight.LaneSensors(cell.errors, cell.settings.transmitters), row.tuning(cell.settings)
    address = lane_flight.address(cell.seed, runs[0], cell.follower)
    return lane_flight.fly_block(truth, sensors, t, address, len(runs), history)


def simulate(cell: Cell, *, threads: int = 1) -> CellResult:
    """Fly a cell with so many threads.

    Raises:
        ValueError: an estimate left finite numbers, or a seed or run is out of range.
    """
    fly = partial(_fly, cell, lane_flight.truth_record(cell.truth, cell.errors))
    if threads == 1:
        return _summed(cell, map(fly, cell.blocks))
    blocks = iter(cell.blocks)
    with ThreadPoolExecutor(threads) as pool:
        # the number of tallies that wait is bounded, and with it the memory
        batches = iter(lambda: [*islice(blocks, 4 * threads)], [])
        return _summed(cell, chain.from_iterable(pool.map(fly, some) for some in batches))


def histories(cell: Cell) -> Floats:
    """States of all runs of a cell after each step: x, y [m], vx, vy [m/s], shape (n, 4, R)."""
    if not cell.in_lanes:
        return np.stack([found.state for runs in cell.blocks for found in single_runs(cell, runs)], axis=-1)
    truth, parts = lane_flight.truth_record(cell.truth, cell.errors), []
    for runs in cell.blocks:
        history = np.empty((cell.truth.speed.size, 4 * LANES))
        _fly(cell, truth, runs, history)
        parts.append(history.reshape(-1, 4, LANES)[..., : len(runs)])
    return np.concatenate(parts, axis=-1)
