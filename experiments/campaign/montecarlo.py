"""Monte Carlo campaigns: noise, navigation and metrics fused over runs, in memory that does not grow with them.

Runs are flown in blocks side by side. Every block is computed alone and added up in the order of runs, so that results
depend neither on the number of threads nor on how runs are split into blocks, to the bit. Run k takes exactly the noise
that `sim.sensing.observation.measure(…, run=k)` gives a single flight.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice

import numpy as np

from experiments.campaign import lane_metrics as metric
from experiments.campaign import lane_sensors as sensing
from experiments.campaign.cells import Cell, CellResult, CellSums
from experiments.campaign.lane_flight import TruthRecord, fly_block, truth_record
from laisn import lane_passes as row
from laisn import lanes
from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from laisn.lane_passes import LANES
from laisn.messages import Measurements
from laisn.navigators import MissionResult
from sim.sensing.observation import measure

_NO_HISTORY = np.empty((0, 4 * LANES))


def _measured(cell: Cell, run: int) -> Measurements:
    """What the follower of a cell measures in a run, with the noise that a single flight of it gets."""
    transmitters = cell.settings.transmitters
    found = measure(cell.truth, cell.errors, seed=cell.seed, run=run, follower=cell.follower, transmitters=transmitters)
    return found if cell.disturbance is None else cell.disturbance.disturb(found, cell.seed, run)


def single_runs(cell: Cell, runs: Iterable[int]) -> list[MissionResult]:
    """Runs of a cell one by one, or those of lanes of up to LANES together; errors as of its navigator."""
    measured, start = [_measured(cell, run) for run in runs], cell.truth.start
    if not cell.spec.lanes:
        return [cell.spec.fly(cell.settings, one, start) for one in measured]
    found = lanes.run(measured, start, cell.settings)  # type: ignore[arg-type]  # the registry's own pair
    unknown = np.full((cell.truth.speed.size, 3), np.nan)
    return [
        MissionResult(found.state[..., i], unknown, found.fix_kind[..., i].ravel().tolist(), 0.0, 0.0)
        for i in range(len(measured))
    ]


def _fly_single_runs(cell: Cell, runs: range) -> tuple[Floats, Ints, Floats]:
    """Results of up to LANES runs, as of `fly_block`.

    Squared innovations of r numbers have mean r; they count as r/2 updates of a position, whose mean is 2.

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
    tally, histograms = columns.ravel(), np.zeros((2, metric.BINS), dtype=np.int64)
    place, nees = (
        np.column_stack([truth.hydrophone, truth.leader_position, truth.leader_heading]),
        np.empty(len(states)),
    )
    metric.tally_states(states, place, tally, histograms, nees, len(runs))
    return tally, histograms, nees


def _blocks(cell: Cell) -> Iterator[range]:
    """Runs of each block of a cell."""
    for i in range(0, len(cell.runs), LANES):
        yield cell.runs[i : i + LANES]


def _in_lanes(cell: Cell) -> bool:
    """Whether measurements are made in lanes too."""
    return cell.spec.lanes and cell.disturbance is None


def _fly(cell: Cell, truth: TruthRecord, runs: range, history: Floats) -> tuple[Floats, Ints, Floats]:
    if not _in_lanes(cell):
        return _fly_single_runs(cell, runs)
    sensors, t = sensing.LaneSensors(cell.errors, cell.settings.transmitters), row.tuning(cell.settings)
    return fly_block(truth, sensors, t, sensing.address(cell.seed, runs[0], cell.follower), len(runs), history)


def _flown(cells: Sequence[Cell], workers: int) -> Iterator[tuple[Floats, Ints, Floats]]:
    """Tallies of all blocks in their order."""
    blocks = (
        partial(_fly, cell, truth, runs, _NO_HISTORY)
        for cell in cells for truth in [truth_record(cell.truth, cell.errors)] for runs in _blocks(cell)
    )  # fmt: skip
    if workers == 1:
        yield from (block() for block in blocks)
        return
    with ThreadPoolExecutor(workers) as pool:
        # the number of tallies that wait is bounded, and with it the memory
        while some := list(islice(blocks, 4 * workers)):
            yield from pool.map(lambda block: block(), some)


def simulate_many(cells: Sequence[Cell], *, threads: int | None = None) -> Iterator[CellResult]:
    """Fly all cells; blocks of all of them share the threads.

    Args:
        cells: of the campaign.
        threads: to compute with; None for all cores that this process may use.

    Yields:
        The result of each cell, in their order, as soon as it is complete.

    Raises:
        ValueError: an estimate left finite numbers, or a seed or run is out of range.
    """
    flown = _flown(cells, threads or len(os.sched_getaffinity(0)))
    for cell in cells:
        sums = CellSums(cell)
        for runs in _blocks(cell):
            sums.add(runs, *next(flown))
        yield sums.result()


def simulate(cell: Cell, *, threads: int | None = 1) -> CellResult:
    """Fly one cell; arguments and errors as in `simulate_many`."""
    return next(simulate_many([cell], threads=threads))


def histories(cell: Cell) -> Floats:
    """States of all runs of a cell after each step: x, y [m], vx, vy [m/s], shape (n, 4, R)."""
    if not _in_lanes(cell):
        return np.stack([found.state for runs in _blocks(cell) for found in single_runs(cell, runs)], axis=-1)
    truth, n = truth_record(cell.truth, cell.errors), cell.truth.speed.size
    parts = []
    for runs in _blocks(cell):
        history = np.empty((n, 4 * LANES))
        _fly(cell, truth, runs, history)
        parts.append(history.reshape(n, 4, LANES)[..., : len(runs)])
    return np.concatenate(parts, axis=-1)
