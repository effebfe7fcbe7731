"""Missions that are stepped together from Python, with a decision a second, as in learning."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from laisn_sim.simulations import Simulations
from sim.custom_control import Command
from tools.benchmarks.row import Goal, Row, least_time, least_times

WAVES = {"ocean.waves.kind": "jonswap", "ocean.waves.height_m": 1.0, "ocean.waves.period_s": 7.0}
CASES: list[tuple[str, int, Mapping[str, Any]]] = [
    ("T5", 1, {}),
    ("T5", 64, {}),
    ("T5 in JONSWAP waves", 64, WAVES),
]
"""Name of the mission, how many are stepped together, and its further settings."""
GOAL_US = 200.0
"""What a decision of one of many missions is to cost at most, in waves too [µs]."""
_DECISIONS = 20
_REPEATS = 5
_SETTINGS = {"navigation.variant": "tight", "duration_s": 1000.0}


def _decide(sims: Simulations) -> None:
    """Decide by what the follower sees, with a reward by the truth."""
    for _ in range(_DECISIONS):
        own, leader = sims.readings["follower"], sims.latest["follower"].message
        believed = sims.estimates["follower"]
        bearing = np.arctan2(leader.east - believed.east, leader.north - believed.north)
        turn = np.arctan2(np.sin(bearing - own.heading), np.cos(bearing - own.heading))
        sims.command("follower", Command(own.heading + 0.2 * turn, 1.0, 10.0))
        sims.step(1.0)
        np.linalg.norm(sims.truth["leader"].position - sims.truth["follower"].position, axis=1)


def _fly(sims: Simulations) -> None:
    """The same seconds of the same missions, in one step."""
    sims.step(float(_DECISIONS))


def together() -> list[Row]:
    """Processor time of a decision of one mission, and of the mission itself meanwhile."""
    rows = []
    for name, count, further in CASES:
        many = f"{name}, {count} {'mission' if count == 1 else 'missions'}"
        settings = {**_SETTINGS, **further}
        # until the first message is in
        deciding, flying = (Simulations("T5", settings, count=count).step(1.0) for _ in range(2))
        works: list[Callable[[], object]] = [partial(_decide, deciding), partial(_fly, flying)]
        decided, flown = (
            seconds / _DECISIONS / count * 1e6 for seconds in least_times(works, _REPEATS)
        )
        rows += [
            Row(f"{many}, a decision", decided, "µs", goal=Goal(GOAL_US) if count > 1 else None),
            Row(f"{many}, a decision without Python", flown, "µs", decided / flown, "with Python"),
        ]
    sims = Simulations("T5", _SETTINGS, count=8)
    set_out_s = least_time(partial(sims.reset, seed=1), _REPEATS) / len(sims)
    return [*rows, Row("T5, to set a mission out anew", set_out_s * 1e3, "ms")]
