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
from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, copy_values
from laisn.messages import Measurements
from laisn.settings import Assume, NavigationSettings, TightSettings, Tuning
from laisn.tight.navigator import run_mission
from sim.sensing.observation import measure
from tools.benchmarks.peak import peak_flops
from tools.benchmarks.row import Goal, Row, least_times

ROUTE = "T5"
"""A route near the leader's axis, where ranges to two transmitters do not tell the sides apart."""
RUNS = 60
INTERVALS_S = (1.0, 5.0)
GOALS_NS = {3: 60.0, 2: 250.0}
"""Most that a step may cost [ns], by number of transmitters, with constant biases and an exact
leader.
"""
FLOPS_PER_STEP = 95
FLOPS_PER_MESSAGE = 945
"""Operations of the tightly coupled navigator with five states, three transmitters and one
hypothesis.

In a step: sine and cosine 40, dead reckoning 35, mean position 20. With a message: motion 180, what
three ranges are expected to be 230, their covariance and its factor 160, likelihoods 75, update
165, lever arms, the rule for the leader's axis and output 135.
"""
# settings of the tightly coupled navigator, by the suffix that they give the name of a row
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
    """Step a block of lanes through measurements made beforehand; shapes as of `lanes.stacked`."""
    block = lanes.new_block(start, t)
    prior = lanes.no_prior()
    i = 0
    for k in range(1, readings.shape[0] + 1):
        # rows from speed to own depth
        copy_values(readings[k - 1], block[lanes.SPEED : lanes.SIN])
        received = i < message_step.size and message_step[i] == k
        if received:
            # rows from the leader's position to the ranges
            copy_values(messages[i], block[lanes.EAST : lanes.X1])
            i += 1
        lanes.advance(block, t, k, received, prior)
    return block


def _navigate(settings: TightSettings, missions: Sequence[Measurements], start: Floats) -> None:
    for mission in missions:
        run_mission(settings, mission, start, covariance=False)


def _rows(interval: float) -> Iterator[Row]:
    """Rows at an interval of messages [s]."""
    keys = ["motion=kinematic", "followers.0.depth_m=8", f"timing.message_interval_s={interval}"]
    # its truth and errors alone are used, in which the variant makes no difference
    cell = Cell.of(load_scenario(ROUTE, [*keys, "navigation.variant=laisn-3-2"]))
    truth = cell.truth
    missions = [measure(cell.truth, cell.errors, seed=1, run=run) for run in range(RUNS)]
    ns_per_step_per_s = 1e9 / (RUNS * truth.speed.size)
    interval_text = f"messages every {interval:g} s"
    readings, messages = lanes.stacked(missions)
    start = truth.start[None]
    tuned = lanes.tuning(NavigationSettings())
    cases = [(count, suffix, model) for count in GOALS_NS for suffix, model in _MODELS.items()]
    tasks: list[Callable[[], object]] = [
        partial(filter_only, readings, truth.message_step, messages, start, tuned)
    ]
    tasks += [
        partial(_navigate, TightSettings(transmitters=count, **model), missions, truth.start)
        for count, _, model in cases
    ]
    # in turns, so that a machine that slows down changes no ratio
    laisn_ns, *others_ns = (ns_per_step_per_s * seconds for seconds in least_times(tasks, 7))
    yield Row(f"LAISN-2 in lanes, filter only, {interval_text}", laisn_ns, "ns/step")
    floor = (FLOPS_PER_STEP + FLOPS_PER_MESSAGE * truth.dt / interval) / peak_flops() * 1e9
    for (count, suffix, _), value in zip(cases, others_ns, strict=True):
        counted = count == 3 and not suffix
        yield Row(
            f"tight, {count} transmitters{suffix}, {interval_text}",
            value,
            "ns/step",
            ratio=laisn_ns / value,
            against="LAISN-2",
            floor=floor if counted else np.nan,
            goal=None if suffix else Goal(GOALS_NS[count]),
        )


def navigator_rows() -> list[Row]:
    """Rows of what a filter step of one follower costs, LAISN-2 and tightly coupled, without
    covariances.
    """
    return [row for interval in INTERVALS_S for row in _rows(interval)]
