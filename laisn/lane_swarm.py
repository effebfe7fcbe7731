"""LAISN's navigators of a swarm in one compiled call: each follower is a lane."""

from typing import Any, NamedTuple

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


class LaneSwarm(NamedTuple):
    """LAISN's navigators of f followers; biases and current are no states of theirs."""

    block: Floats
    """Lanes, as of `laisn.lane_rows`."""
    tuning: Tuning
    gated: Ints
    """See `Swarm.gated`."""

    @compiled_lanes
    def navigate(
        self, step: int, readings: Floats, received: Bools, messages: Floats, ranges: Floats, estimates: Any
    ) -> int:
        """Advance by one filter step; see `laisn.swarm.Swarm.navigate`."""
        block = self.block
        last, any_received = readings.shape[0] - 1, bool(received.any())
        for lane in range(LANES):
            i = min(lane, last)
            block[row.SPEED + lane], block[row.HEADING + lane] = readings[i, 0], readings[i, 1]
            block[row.DEPTH + lane] = readings[i, 2]
            if any_received:
                block[row.EAST + lane], block[row.NORTH + lane] = messages[i, 1], messages[i, 2]
                block[row.LEADER_HEADING + lane], block[row.LEADER_SPEED + lane] = messages[i, 3], messages[i, 4]
                block[row.LEADER_DEPTH + lane], block[row.PITCH + lane] = messages[i, 5], messages[i, 6]
                block[row.ROLL + lane] = messages[i, 7]
                # a message without ranges has the same effect as none
                block[row.R1 + lane] = ranges[i, 0] if received[i] else np.nan
                block[row.R2 + lane] = ranges[i, 1] if received[i] else np.nan
                block[row.R3 + lane] = ranges[i, 2] if received[i] else np.nan
        advance(block, self.tuning, step, any_received)
        for i in range(readings.shape[0]):
            position, velocity = estimates[i].position, estimates[i].velocity
            position[0], position[1] = block[row.X + i], block[row.Y + i]
            velocity[0], velocity[1] = block[row.VX + i], block[row.VY + i]
            if received[i]:
                for first in fix_rows(self.tuning.variant):
                    self.gated[i] += first >= 0 and block[first + 3 * LANES + i] == _GATED
        return 0


def new_lanes(settings: NavigationSettings, starts: Floats) -> LaneSwarm:
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
    return LaneSwarm(block, tuning, np.zeros(len(starts), dtype=np.int64))
