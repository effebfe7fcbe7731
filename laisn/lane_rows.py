"""Layout of the numbers of a block of runs: rows of `LANES` doubles in one flat array, a lane for each run.

Passes over a block address `block[ROW + lane]`. Rows are constants of one array, so that a compiler can prove that they
do not overlap, and turns each pass into vector instructions.
"""

from itertools import count
from typing import cast

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled_lanes, inlined
from laisn.failure import LaisnError
from laisn.fix import Fix
from laisn.geometry import Point
from laisn.settings import NavigationSettings, Settings, Tuning

LANES = 64
"""Runs of a block."""

_row = count(0, LANES)

# State and covariance: P are position, V velocity terms, C those between (CXY of x and vy).
X, Y, VX, VY = (next(_row) for _ in range(4))
PXX, PXY, PYY, CXX, CXY, CYX, CYY, VXX, VXY, VYY = (next(_row) for _ in range(10))
# Memory of the last accepted position and of the last measurements.
ACCEPTED_X, ACCEPTED_Y, ACCEPTED_STEP = (next(_row) for _ in range(3))
LAST_SPEED, LAST_HEADING, LAST_LEADER_SPEED, LAST_LEADER_HEADING = (next(_row) for _ in range(4))
# Own measurements of a step, and what follows from them; γ are those of the vehicle that changed most.
SPEED, HEADING, DEPTH, SIN, COS, GAMMA_V, GAMMA_THETA = (next(_row) for _ in range(7))
# A message and the ranges measured on it.
EAST, NORTH, LEADER_HEADING, LEADER_SPEED, LEADER_DEPTH, PITCH, ROLL = (next(_row) for _ in range(7))
R1, R2, R3 = (next(_row) for _ in range(3))
# Transmitters, the horizontal ranges to them (NaN where nothing was received), and one's own depth below the leader's.
X1, Y1, D1, X2, Y2, D2, X3, Y3, D3, DZ = (next(_row) for _ in range(10))
LEADER_SIN, LEADER_COS = (next(_row) for _ in range(2))
# The fix of each pair of transmitters and the fix chosen of them: position, σp, kind, separation of two intersections
# (−1 for fewer), and squared distance from the prediction in units of S (NaN where no update was made).
ZX12, ZY12, SIGMA12, KIND12, SEP12, NIS12 = (next(_row) for _ in range(6))
ZX13, ZY13, SIGMA13, KIND13, SEP13, NIS13 = (next(_row) for _ in range(6))
ZX23, ZY23, SIGMA23, KIND23, SEP23, NIS23 = (next(_row) for _ in range(6))
ZX, ZY, SIGMA, KIND, SEP, NIS = (next(_row) for _ in range(6))
# 1 where an update of this message passed the gate.
PASSED = next(_row)
SIZE = next(_row)
"""Numbers of a block."""


def tuning(settings: Settings) -> Tuning:
    """Settings of LAISN as lanes take them; LaisnError for those of one vehicle's navigator alone."""
    laisn = cast(NavigationSettings, settings)
    if laisn.use_single_range or laisn.transmitter_offsets:
        raise LaisnError(
            "use_single_range and transmitter offsets are for single vehicles and their logs; campaigns take "
            "transmitters on the leader's hull only, and drop a range that arrives alone"
        )
    return Tuning.of(laisn)


@inlined
def point_at(block: Floats, first: int, lane: int) -> Point:
    """The point whose two rows begin at `first`."""
    return Point(block[first + lane], block[first + LANES + lane])


@inlined
def cross_covariance_at(block: Floats, lane: int) -> tuple[float, float, float, float]:
    """Covariance of position and velocity: CXX, CXY, CYX, CYY."""
    return block[CXX + lane], block[CXY + lane], block[CYX + lane], block[CYY + lane]


@inlined
def fix_at(block: Floats, first: int, lane: int) -> Fix:
    """The fix whose rows begin at `first`."""
    return Fix(
        block[first + lane],
        block[first + LANES + lane],
        block[first + 2 * LANES + lane],
        block[first + 3 * LANES + lane],
        block[first + 4 * LANES + lane],
    )


@inlined
def put_fix(block: Floats, first: int, lane: int, fix: Fix) -> None:
    """Write a fix into the rows that begin at `first`."""
    block[first + lane], block[first + LANES + lane] = fix.east, fix.north
    block[first + 2 * LANES + lane] = fix.sigma
    block[first + 3 * LANES + lane] = fix.kind
    block[first + 4 * LANES + lane] = fix.separation


@compiled_lanes
def new_block(start: Floats, t: Tuning) -> Floats:
    """A block before its first step: every lane at the start (x, y, vx, vy), with nothing measured yet."""
    block = np.zeros(SIZE)
    for lane in range(LANES):
        block[X + lane], block[Y + lane], block[VX + lane], block[VY + lane] = start
        block[PXX + lane] = block[PYY + lane] = t.position_variance0
        block[VXX + lane] = block[VYY + lane] = t.velocity_variance0
        block[ACCEPTED_X + lane], block[ACCEPTED_Y + lane] = start[0], start[1]
        block[LAST_SPEED + lane] = block[LAST_HEADING + lane] = np.nan
        block[LAST_LEADER_SPEED + lane] = block[LAST_LEADER_HEADING + lane] = np.nan
    return block


@compiled_lanes
def fill(block: Floats, first: int, values: Floats) -> None:
    """Copy values, shape (rows · LANES,), into the rows from `first` on."""
    for i in range(values.size):
        block[first + i] = values[i]
