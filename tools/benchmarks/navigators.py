"""What a step costs of LAISN-2, the filter alone, and of the tightly coupled navigator on the
same measurements.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from experiments.campaign.montecarlo import Cell
from experiments.flight.library import load_scenario
from laisn import lanes
from laisn import lanes as row
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, copy_values
from laisn.messages import Measurements
from laisn.settings import Assume, NavigationSettings, TightSettings, Tuning
from laisn.tight.navigator import run_mission
from sim.sensing.observation import measure
from tools.benchmarks.peak import peak_flops
from tools.benchmarks.row import Goal, Row, least_times

ROUTE = "T5"
"""About the leader's axis, where two transmitters leave both sides open."""
RUNS = 60
INTERVALS_S = (1.0, 5.0)
GOALS_NS = {3: 60.0, 2: 250.0}
"""What a step is to cost at most, by transmitters; of constant biases and an exact leader [ns]."""
FLOPS_PER_STEP = 95
FLOPS_PER_MESSAGE = 945
"""Operations of the tightly coupled navigator with five states, three transmitters and one
hypothesis.

In a step: sine and cosine 40, dead reckoning 35, mean position 20. With a message: motion 180, what
three ranges are expected to be 230, their covariance and its factor 160, likelihoods 75, update
165, arms, axis and output 135.
"""
_MODELS: dict[str, dict[str, Any]] = {
    "": {},
    ", all states": {
        "assume": Assume(exact_leader=False, drift=True, current=True, offsets=True),
    },
    ", the speed as a state": {"assume": Assume(steady_speed=True)},
    ", the leader's place as a state": {"leader_position_sigma": 0.5},
}


@compiled
def filter_only(
    readings: Floats, message_step: Ints, messages: Floats, start: Floats, t: Tuning
) -> Floats:
    """Steps of a block on measurements that lie ready."""
    block = row.new_block(start, t)
    prior = lanes.no_prior()
    i = 0
    for k in range(1, readings.shape[0] + 1):
        copy_values(readings[k - 1], block[row.SPEED : row.SIN])
        received = i < message_step.size and message_step[i] == k
        if received:
            copy_values(messages[i], block[row.EAST : row.X1])
            i += 1
        lanes.advance(block, t, k, received, prior)
    return block


def _fly(settings: TightSettings, missions: Sequence[Measurements], start: Floats) -> None:
    for mission in missions:
        run_mission(settings, mission, start, covariance=False)


def _rows(interval: float) -> Iterator[Row]:
    keys = ["motion=kinematic", "followers.0.depth_m=8", f"timing.message_interval_s={interval}"]
    cell = Cell.of(load_scenario(ROUTE, [*keys, "navigation.variant=laisn-3-2"]))
    truth = cell.truth
    missions = [measure(cell.truth, cell.errors, seed=1, run=run) for run in range(RUNS)]
    per = 1e9 / (RUNS * truth.speed.size)
    interval_text = f"messages every {interval:g} s"
    readings, messages = lanes.stacked(missions)
    start = truth.start[None]
    tuned = row.tuning(NavigationSettings())
    cases = [(count, words, model) for count in GOALS_NS for words, model in _MODELS.items()]
    works: list[Callable[[], object]] = [
        partial(filter_only, readings, truth.message_step, messages, start, tuned)
    ]
    works += [
        partial(_fly, TightSettings(transmitters=count, **model), missions, truth.start)
        for count, _, model in cases
    ]
    # in turns, so that a machine that slows down changes no ratio
    laisn, *others = (per * least_time for least_time in least_times(works, 7))
    yield Row(f"LAISN-2 in lanes, filter only, {interval_text}", laisn, "ns/step")
    floor = (FLOPS_PER_STEP + FLOPS_PER_MESSAGE * truth.dt / interval) / peak_flops() * 1e9
    for (count, words, _), value in zip(cases, others, strict=True):
        name = f"tight, {count} transmitters{words}, {interval_text}"
        counted = count == 3 and not words
        goal = None if words else Goal(GOALS_NS[count])
        floor_shown = floor if counted else np.nan
        yield Row(name, value, "ns/step", laisn / value, "LAISN-2", floor_shown, goal)


def tight() -> list[Row]:
    """A filter step of one follower: states without covariances, as a campaign of mirror locks
    takes them.
    """
    return [row for interval in INTERVALS_S for row in _rows(interval)]
