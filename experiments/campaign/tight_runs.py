"""Runs of the tightly coupled navigator, one after another: for cells what `lanes` are for LAISN.

Each run takes the noise that a single flight of it gets, and gives the bits that `TightNavigator` gives online.
"""

import numpy as np

from experiments.campaign import lane_metrics as metric
from laisn import lane_rows as row
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled_lanes, copy_values
from laisn.failure import LaisnError
from laisn.lane_rows import LANES
from laisn.tight.estimates import kind_of
from laisn.tight.mission import Found, run_mission
from laisn.tight.settings import TightSettings
from sim.sensing.sensor_errors import SensorErrors, measure
from sim.sensing.truth import MissionTruth


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


def _tally_messages(outcome: Floats, tally: Floats) -> None:
    """Add the messages of one run to its columns of a tally, shape (SIZE // LANES,).

    The squared residuals of r ranges have mean r; they count as r/2 updates of a position, whose mean is 2.
    """
    known = np.isfinite(outcome[:, 2])
    tally[metric.SUM_NIS // LANES] = outcome[known, 2].sum()
    tally[metric.COUNT_NIS // LANES] = 0.5 * outcome[known, 1].sum()
    for received, used in outcome[:, :2].astype(np.int64).tolist():
        tally[metric.KINDS // LANES + kind_of(received, used)] += 1.0


def flown(
    truth: MissionTruth, errors: SensorErrors, settings: TightSettings, *, seed: int, run: int, follower: int
) -> Found:
    """One run of a mission; errors as of `run_mission`."""
    measured = measure(truth, errors, seed=seed, run=run, follower=follower, transmitters=settings.transmitters)
    return run_mission(settings, measured, truth.start)


def fly_block(
    truth: MissionTruth, errors: SensorErrors, settings: TightSettings, *, seed: int, runs: range, follower: int
) -> tuple[Floats, Ints]:
    """Tally and histograms of up to LANES runs, as `lane_metrics` has them.

    Raises:
        LaisnError: the start is unknown, so that a run has no error before its first message.
        ArithmeticError: a covariance is not positive definite.
    """
    if not settings.known_start:
        raise LaisnError("navigation.assume.known_start = false is for single flights; cells need errors of all steps")
    states = np.ones((truth.speed.size, 5, LANES))
    columns = np.zeros((metric.SIZE // LANES, LANES))
    for lane, run in enumerate(runs):
        found = flown(truth, errors, settings, seed=seed, run=run, follower=follower)
        states[:, :2, lane], states[:, 2:, lane] = found.state[:, :2], found.covariance
        _tally_messages(found.outcome, columns[:, lane])
    tally, histograms = columns.ravel(), np.zeros((2, metric.BINS), dtype=np.int64)
    place = np.column_stack([truth.hydrophone, truth.leader_position, truth.leader_heading])
    _tally_steps(states, place, tally, histograms, len(runs))
    return tally, histograms
