"""Tallies of lanes: each counts what its own run does."""

import numpy as np

from experiments.campaign import lane_flight
from laisn import lanes
from laisn.lanes import LANES
from laisn.settings import NavigationSettings

STEPS = LANES + 4


def test_each_lane_counts_its_own_longest_mirror_lock() -> None:
    """The leader heads east, so that the mirror image of (3, 10) is (3, -10). The estimate of
    lane i is there for i steps, then at the truth, and at the image again for one step.
    """
    block = lanes.new_block(np.zeros((1, 4)), lanes.tuning(NavigationSettings()))
    tally = np.zeros(lane_flight.SIZE)
    bins = np.zeros(2 * LANES, dtype=np.int64)
    hydrophone, leader = (3.0, 10.0), (0.0, 0.0, 0.5 * np.pi)
    for k in range(STEPS):
        at_image = (k < np.arange(LANES)) | (k == STEPS - 2)
        block[lanes.X : lanes.X + LANES] = 3.0
        block[lanes.Y : lanes.Y + LANES] = np.where(at_image, -10.0, 10.0)
        lane_flight.tally_step(block, tally, bins, hydrophone, leader)
    longest = slice(lane_flight.LONGEST_MIRROR_LOCK, lane_flight.LONGEST_MIRROR_LOCK + LANES)
    assert tally[longest].tolist() == [max(i, 1) for i in range(LANES)]
