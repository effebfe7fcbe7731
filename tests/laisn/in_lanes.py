"""Missions in lanes on explicit measurements, as disturbed cells of campaigns take them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn import lanes
from laisn import lanes as row
from laisn.arrays import Floats, Ints
from laisn.lanes import LANES
from laisn.messages import Measurements
from laisn.settings import NavigationSettings, Tuning


class LaneEstimates(NamedTuple):
    """Estimates of R missions: states, shape (n, 4, R), and kinds of the f fixes of m messages,
    shape (m, f, R).
    """

    state: Floats
    fix_kind: Ints


def _run_block(
    own: Floats, message_step: Ints, messages: Floats, start: Floats, t: Tuning
) -> tuple[Floats, Floats]:
    """In Python, which finds the code of a step stored: that of functions of tests is not."""
    state, kinds = np.zeros((own.shape[0], 4 * LANES)), np.zeros((messages.shape[0], 3, LANES))
    block, i = row.new_block(start, t), 0
    prior = lanes.no_prior()
    for k in range(1, own.shape[0] + 1):
        block[row.SPEED : row.SIN] = own[k - 1]
        received = i < message_step.size and message_step[i] == k
        if received:
            block[row.EAST : row.X1] = messages[i]
        lanes.advance(block, t, k, received, prior)
        state[k - 1] = block[row.X : row.X + 4 * LANES]
        if received:
            for j, first in enumerate(lanes.fix_rows(t.variant)):
                if first >= 0:
                    kinds[i, j] = block[first + 3 * LANES : first + 4 * LANES]
            i += 1
    return state, kinds


def run(
    missions: Sequence[Measurements], start: Floats, settings: NavigationSettings
) -> LaneEstimates:
    """Estimates of missions with the same steps of messages, from a known start."""
    t, actual = row.tuning(settings), []
    for first in range(0, len(missions), LANES):
        own, messages = lanes.stacked(missions[first : first + LANES])
        state, kinds = _run_block(own, missions[0].message_step, messages, start[None], t)
        made = 3 if settings.variant == "laisn-3-1" else 1
        actual.append((state.reshape(-1, 4, LANES), kinds[:, :made].astype(np.int64)))
    return LaneEstimates(
        *(
            np.concatenate(parts, axis=-1)[..., : len(missions)]
            for parts in zip(*actual, strict=True)
        )
    )
