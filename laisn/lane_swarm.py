"""LAISN's navigators of a swarm in one compiled call: each follower is a lane.

Of biases and the current they conclude nothing: LAISN has no such states.
"""

import numpy as np

from laisn import lane_rows as row
from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled_lanes
from laisn.estimates import FixKind
from laisn.failure import LaisnError
from laisn.lane_rows import LANES
from laisn.lanes import advance, fix_rows
from laisn.settings import NavigationSettings
from laisn.tuning import Tuning

_GATED = float(FixKind.GATED)

Navigators = tuple[Floats, Tuning, Ints]
"""A block of lanes, their settings, and how many fixes of each follower were gated so far, shape (f,)."""


def new_navigators(settings: NavigationSettings, starts: Floats) -> Navigators:
    """Navigators of followers at known starts, rows of x, y [m] and vx, vy [m/s], shape (f, 4).

    Raises:
        LaisnError: there are more followers than lanes, or the settings are for single vehicles.
    """
    if len(starts) > LANES:
        raise LaisnError(f"{len(starts)} followers cannot navigate together, at most {LANES}")
    tuning = row.tuning(settings)
    block = row.new_block(np.zeros(4), tuning)
    rows = row.X, row.Y, row.VX, row.VY
    for lane in range(LANES):
        start = starts[min(lane, len(starts) - 1)]
        for first, value in zip(rows, start, strict=True):
            block[first + lane] = value
        block[row.ACCEPTED_X + lane], block[row.ACCEPTED_Y + lane] = start[0], start[1]
    return block, tuning, np.zeros(len(starts), dtype=np.int64)


@compiled_lanes
def navigate(
    navigators: Navigators, k: int, readings: Floats, received: Bools, message: Floats, ranges: Floats, out: Floats
) -> int:
    """Filter step k of all followers; arguments otherwise as of `laisn.tight.swarm.navigate`. Returns −1."""
    block, tuning, gated = navigators
    last, any_received = readings.shape[0] - 1, bool(received.any())
    for lane in range(LANES):
        i = min(lane, last)
        block[row.SPEED + lane], block[row.HEADING + lane] = readings[i, 0], readings[i, 1]
        block[row.DEPTH + lane] = readings[i, 2]
        if any_received:
            block[row.EAST + lane], block[row.NORTH + lane] = message[i, 1], message[i, 2]
            block[row.LEADER_HEADING + lane], block[row.LEADER_SPEED + lane] = message[i, 3], message[i, 4]
            block[row.LEADER_DEPTH + lane], block[row.PITCH + lane] = message[i, 5], message[i, 6]
            block[row.ROLL + lane] = message[i, 7]
            # to hear no ping of a message is the same to it as no message
            block[row.R1 + lane] = ranges[i, 0] if received[i] else np.nan
            block[row.R2 + lane] = ranges[i, 1] if received[i] else np.nan
            block[row.R3 + lane] = ranges[i, 2] if received[i] else np.nan
    advance(block, tuning, k, any_received)
    for i in range(readings.shape[0]):
        out[i, 0], out[i, 1] = block[row.X + i], block[row.Y + i]
        out[i, 9], out[i, 10] = block[row.VX + i], block[row.VY + i]
        if received[i]:
            for first in fix_rows(tuning.variant):
                gated[i] += first >= 0 and block[first + 3 * LANES + i] == _GATED
    return -1
