"""Errors of a block of runs, summed up where they arise: `laisn.metrics` for lanes, in memory that does not grow."""

import math
from itertools import count

import numpy as np

from laisn import lane_passes as row
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled_lanes, copy_values, inlined
from laisn.elementary import to_bits
from laisn.estimates import FixKind
from laisn.geometry import Point, turn
from laisn.lane_passes import LANES
from laisn.metrics import bearing_error, is_invertible, is_mirror_locked, normalised_square, squared_error

_LOST = int(FixKind.LOST)

_row = count(0, LANES)
SUM_P, SQUARES_P, MAX_P, SUM_B, SQUARES_B, MAX_B = (next(_row) for _ in range(6))
SUM_NEES, COUNT_NEES, SUM_NIS, COUNT_NIS = (next(_row) for _ in range(4))
# Steps that the estimate has been at the mirror image without a break, and the most of them.
MIRROR_LOCK, LONGEST_MIRROR_LOCK = (next(_row) for _ in range(2))
NEES = next(_row)
"""Of the last step; NaN where the covariance is singular."""
KINDS = next(_row)
SIZE = KINDS + len(FixKind) * LANES
"""Numbers of a tally."""

# Histograms have 2⁷ bins an octave: percentiles read from them are right to a share of 2⁻⁷, wherever they lie.
_BINS_PER_OCTAVE_BITS = 7
_BITS_SHIFT = np.uint64(52 - _BINS_PER_OCTAVE_BITS)
_OCTAVES = 20
LOWEST_P = 2.0**-10
"""Position errors below this share one bin [m]."""
LOWEST_B = 2.0**-18
"""Bearing errors below this share one bin [rad]."""
BINS = (_OCTAVES << _BINS_PER_OCTAVE_BITS) + 2
_FIRST_P = (1023 - 10 << _BINS_PER_OCTAVE_BITS) - 1
_FIRST_B = (1023 - 18 << _BINS_PER_OCTAVE_BITS) - 1


def bin_edges(lowest: float) -> Floats:
    """Edges of a histogram's bins, shape (BINS + 1,); the last bin takes all that is larger."""
    shares = 1.0 + np.arange(1 << _BINS_PER_OCTAVE_BITS) / (1 << _BINS_PER_OCTAVE_BITS)
    edges = (lowest * 2.0 ** np.arange(_OCTAVES)[:, None] * shares).ravel()
    top = lowest * 2.0**_OCTAVES
    return np.concatenate([[0.0], edges, [top, np.inf]])


@inlined
def _bin(value: float, first: int) -> np.int64:
    number = np.int64(to_bits(value) >> _BITS_SHIFT) - first
    number = number if number > 0 else np.int64(0)
    return number if number < BINS - 1 else np.int64(BINS - 1)


@compiled_lanes
def tally_step(
    block: Floats, tally: Floats, bins: Ints, hydrophone: tuple[float, float], leader: tuple[float, float, float]
) -> None:
    """Add the errors of a step of a block of estimates to its tally, and their histogram bins, two rows, to `bins`.

    Hydrophone: true x, y [m]; leader: true x, y [m] and heading [rad].
    """
    truth, origin = Point(hydrophone[0], hydrophone[1]), Point(leader[0], leader[1])
    axis = turn(leader[2])
    for lane in range(LANES):
        estimate = row.point_at(block, row.X, lane)
        squared = squared_error(estimate, truth)
        error = math.sqrt(squared)
        bearing = bearing_error(estimate, truth, origin)
        tally[SUM_P + lane] += error
        tally[SQUARES_P + lane] += squared
        tally[MAX_P + lane] = error if error > tally[MAX_P + lane] else tally[MAX_P + lane]
        tally[SUM_B + lane] += bearing
        tally[SQUARES_B + lane] += bearing * bearing
        tally[MAX_B + lane] = bearing if bearing > tally[MAX_B + lane] else tally[MAX_B + lane]
        bins[lane] = _bin(error, _FIRST_P)
        bins[LANES + lane] = _bin(bearing, _FIRST_B)

        mirror_lock = tally[MIRROR_LOCK + lane] + 1.0 if is_mirror_locked(estimate, truth, origin, axis) else 0.0
        tally[MIRROR_LOCK + lane] = mirror_lock
        longest = tally[LONGEST_MIRROR_LOCK + lane]
        tally[LONGEST_MIRROR_LOCK + lane] = mirror_lock if mirror_lock > longest else longest

        pxx, pxy, pyy = block[row.PXX + lane], block[row.PXY + lane], block[row.PYY + lane]
        nees = normalised_square(estimate.east - truth.east, estimate.north - truth.north, pxx, pxy, pyy)
        known = is_invertible(pxx, pxy, pyy)
        tally[NEES + lane] = nees if known else np.nan
        tally[SUM_NEES + lane] += nees if known else 0.0
        tally[COUNT_NEES + lane] += 1.0 if known else 0.0


@compiled_lanes
def tally_fixes(block: Floats, tally: Floats, fixes: tuple[int, int, int]) -> None:
    """Add the fixes of a message, whose rows begin at `fixes` (−1: none).

    A pair of which nothing was received is no fix; a message without any fix counts as one LOST.
    """
    for lane in range(LANES):
        received = False
        for fix in fixes:
            if fix >= 0:
                kind, nis = int(block[fix + 3 * LANES + lane]), block[fix + 5 * LANES + lane]
                if kind != _LOST:
                    received = True
                    tally[KINDS + kind * LANES + lane] += 1.0
                if nis == nis:
                    tally[SUM_NIS + lane] += nis
                    tally[COUNT_NIS + lane] += 1.0
        if not received:
            tally[KINDS + _LOST * LANES + lane] += 1.0


@compiled_lanes
def sum_nees(tally: Floats, lanes: int) -> float:
    """Sum over the first `lanes` lanes of the NEES of the last step; NaN where one is unknown."""
    total = 0.0
    for lane in range(lanes):
        total += tally[NEES + lane]
    return total


@compiled_lanes
def fill_histograms(bins: Ints, histograms: Ints, lanes: int) -> None:
    """Count the errors of a step in the first `lanes` lanes; histograms of position and bearing, shape (2, BINS)."""
    for lane in range(lanes):
        histograms[0, bins[lane]] += 1
        histograms[1, bins[LANES + lane]] += 1


def percentile(histogram: Ints, lowest: float, share: float, largest: float) -> float:
    """Value below which a share of the counted ones lie, by linear interpolation within a bin; `largest` at most."""
    total = np.cumsum(histogram)
    wanted = share * total[-1]
    i = int(np.searchsorted(total, wanted))
    edges = bin_edges(lowest)
    lower, upper = edges[i], min(edges[i + 1], largest)
    inside = (wanted - (total[i] - histogram[i])) / histogram[i]
    return float(min(lower + inside * (upper - lower), largest))


@compiled_lanes
def tally_states(states: Floats, truth: Floats, tally: Floats, histograms: Ints, nees: Floats, lanes_used: int) -> None:
    """Add the errors of all steps; tally, histograms and nees as of `fly_block`.

    Args:
        states: x, y and covariance xx, xy, yy of each step and lane, shape (n, 5, LANES).
        truth: x, y of the hydrophone; x, y and heading of the leader; shape (n, 5).
        tally: sums of the block.
        histograms: of position and bearing, shape (2, BINS).
        nees: receives sums over the runs, shape (n,).
        lanes_used: how many of the lanes are runs.
    """
    block, bins = np.zeros(row.SIZE), np.zeros(2 * LANES, dtype=np.int64)
    for k in range(states.shape[0]):
        for i, first in enumerate((row.X, row.Y, row.PXX, row.PXY, row.PYY)):
            copy_values(states[k, i], block[first : first + LANES])
        now = truth[k]
        tally_step(block, tally, bins, (now[0], now[1]), (now[2], now[3], now[4]))
        nees[k] = sum_nees(tally, lanes_used)
        fill_histograms(bins, histograms, lanes_used)
