"""Sensing, navigation and metrics of a block of runs in one compiled loop.

Beside `lane_sensors` and `lane_metrics` no module of campaigns is compiled.
"""

from typing import NamedTuple

import numpy as np

from experiments.campaign import lane_metrics as metric
from experiments.campaign.lane_sensors import Address, LaneSensors, new_noise, sense_message, sense_own, sent_rows
from laisn import lane_passes as row
from laisn import lanes
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled_lanes, copy_values
from laisn.lane_passes import LANES
from laisn.settings import Tuning
from sim.sensing.errors import SensorErrors
from sim.sensing.observation import MissionTruth


class TruthRecord(NamedTuple):
    """`MissionTruth` as compiled code takes it."""

    start: Floats
    own: Floats
    """Speed, heading, depth and hydrophone x, y of the follower; x, y and heading of the leader; shape (n, 8)."""
    message_step: Ints
    emission_step: Ints
    sent: Floats


def truth_record(truth: MissionTruth, errors: SensorErrors) -> TruthRecord:
    """What a follower's sensors measure, with the echoes of its pings."""
    own = np.column_stack(
        [truth.speed, truth.heading, truth.depth, truth.hydrophone, truth.leader_position, truth.leader_heading]
    )
    received, emitted = truth.message_step.astype(np.int64), truth.emission_step.astype(np.int64)
    return TruthRecord(truth.start.astype(np.float64), own, received, emitted, sent_rows(truth, errors))


@compiled_lanes
def fly_block(
    truth: TruthRecord, sensors: LaneSensors, t: Tuning, address: Address, lanes_used: int, history: Floats
) -> tuple[Floats, Ints, Floats]:
    """Tally, histograms, and the sum over the runs of the NEES of each step, shape (n,).

    States go to `history`, shape (n, 4 LANES), unless it is empty.
    """
    n, m = truth.own.shape[0], truth.message_step.size
    noise = new_noise(address)
    block = row.new_block(truth.start, t)
    tally = np.zeros(metric.SIZE)
    bins = np.zeros(2 * LANES, dtype=np.int64)
    histograms, nees = np.zeros((2, metric.BINS), dtype=np.int64), np.empty(n)
    fixes = lanes.fix_rows(t.variant)
    i = 0
    for k in range(1, n + 1):
        now = truth.own[k - 1]
        sense_own(block, noise, sensors.errors, now[0], now[1], k)
        received = i < m and truth.message_step[i] == k
        if received:
            sense_message(block, noise, sensors, truth.sent[i], now[2], (k, truth.emission_step[i]))
            i += 1
        lanes.advance(block, t, k, received)
        if received:
            metric.tally_fixes(block, tally, fixes)
        metric.tally_step(block, tally, bins, (now[3], now[4]), (now[5], now[6], now[7]))
        nees[k - 1] = metric.sum_nees(tally, lanes_used)
        metric.fill_histograms(bins, histograms, lanes_used)
        if history.size > 0:
            copy_values(block[row.X : row.X + 4 * LANES], history[k - 1])
    return tally, histograms, nees
