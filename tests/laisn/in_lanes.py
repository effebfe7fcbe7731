"""Missions in lanes on explicit measurements, as disturbed cells of campaigns take them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn import lanes
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
    readings: Floats, message_step: Ints, messages: Floats, start: Floats, t: Tuning
) -> tuple[Floats, Floats]:
    """States and kinds of fixes of one block of lanes.

    A loop in Python: the code of `lanes.advance` is in the cache, that of a test's function is not.
    """
    state, kinds = np.zeros((readings.shape[0], 4 * LANES)), np.zeros((messages.shape[0], 3, LANES))
    block, message_index = lanes.new_block(start, t), 0
    prior = lanes.no_prior()
    for step in range(1, readings.shape[0] + 1):
        block[lanes.SPEED : lanes.SIN] = readings[step - 1]
        received = message_index < message_step.size and message_step[message_index] == step
        if received:
            block[lanes.EAST : lanes.X1] = messages[message_index]
        lanes.advance(block, t, step, received, prior)
        state[step - 1] = block[lanes.X : lanes.X + 4 * LANES]
        if received:
            for fix_index, row in enumerate(lanes.fix_rows(t.variant)):
                if row >= 0:
                    kinds[message_index, fix_index] = block[row + 3 * LANES : row + 4 * LANES]
            message_index += 1
    return state, kinds


def run(
    missions: Sequence[Measurements], start: Floats, settings: NavigationSettings
) -> LaneEstimates:
    """Estimates of missions with the same steps of messages, from a known start."""
    t, blocks = lanes.tuning(settings), []
    for first_mission in range(0, len(missions), LANES):
        readings, messages = lanes.stacked(missions[first_mission : first_mission + LANES])
        state, kinds = _run_block(readings, missions[0].message_step, messages, start[None], t)
        fixes_of_message = 3 if settings.variant == "laisn-3-1" else 1
        blocks.append((state.reshape(-1, 4, LANES), kinds[:, :fixes_of_message].astype(np.int64)))
    return LaneEstimates(
        *(
            np.concatenate(parts, axis=-1)[..., : len(missions)]
            for parts in zip(*blocks, strict=True)
        )
    )
