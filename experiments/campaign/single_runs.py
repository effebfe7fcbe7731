"""Runs of a cell one after another, for navigators that do not run as lanes; each with the bits of a single flight."""

import numpy as np

from experiments.campaign import lane_metrics as metric
from experiments.campaign.cells import Cell
from laisn import lane_rows as row
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled_lanes, copy_values
from laisn.failure import LaisnError
from laisn.lane_rows import LANES
from laisn.navigators import MissionResult
from sim.sensing.sensor_errors import measure


@compiled_lanes
def _tally_steps(states: Floats, truth: Floats, tally: Floats, histograms: Ints, lanes_used: int) -> None:
    """Add the errors of all steps.

    Args:
        states: x, y and covariance xx, xy, yy of each step and lane, shape (n, 5, LANES).
        truth: x, y of the hydrophone; x, y and heading of the leader; shape (n, 5).
        tally: as `lane_metrics` has it.
        histograms: of position and bearing, shape (2, BINS).
        lanes_used: how many of the lanes are runs.
    """
    block, bins = np.zeros(row.SIZE), np.zeros(2 * LANES, dtype=np.int64)
    for k in range(states.shape[0]):
        for i, first in enumerate((row.X, row.Y, row.PXX, row.PXY, row.PYY)):
            copy_values(states[k, i], block[first : first + LANES])
        now = truth[k]
        metric.tally_step(block, tally, bins, (now[0], now[1]), (now[2], now[3], now[4]))
        metric.fill_histograms(bins, histograms, lanes_used)


def flown(cell: Cell, run: int) -> MissionResult:
    """One run of a cell, with the noise that a single flight of it gets; errors as of its navigator."""
    measured = measure(
        cell.truth,
        cell.errors,
        seed=cell.seed,
        run=run,
        follower=cell.follower,
        transmitters=cell.settings.transmitters,
    )
    return cell.spec.fly(cell.settings, measured, cell.truth.start)


def fly_block(cell: Cell, runs: range) -> tuple[Floats, Ints]:
    """Tally and histograms of up to LANES runs, as `lane_metrics` has them.

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
    for lane, run in enumerate(runs):
        found = flown(cell, run)
        states[:, :2, lane], states[:, 2:, lane] = found.state[:, :2], found.covariance
        columns[metric.SUM_NIS // LANES, lane] = found.squared
        columns[metric.COUNT_NIS // LANES, lane] = 0.5 * found.numbers
        for kind in found.kinds:
            columns[metric.KINDS // LANES + kind, lane] += 1.0
    tally, histograms = columns.ravel(), np.zeros((2, metric.BINS), dtype=np.int64)
    place = np.column_stack([truth.hydrophone, truth.leader_position, truth.leader_heading])
    _tally_steps(states, place, tally, histograms, len(runs))
    return tally, histograms
