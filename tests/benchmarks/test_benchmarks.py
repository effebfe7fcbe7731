"""Benchmarks: the peers that lanes are compared with do the same work, and the table says what was measured."""

import numpy as np
import pytest

from experiments.benchmarks import run as benchmarks
from experiments.benchmarks.row import Row
from experiments.benchmarks.run import BENCHMARKS, steady_mission, table
from laisn import lanes
from laisn.settings import NavigationSettings
from sim.sensing.sensor_errors import SensorErrors, measure


def test_peers_come_to_the_same_state() -> None:
    truth, settings = steady_mission(60), NavigationSettings()
    missions = [measure(truth, SensorErrors(), seed=1, run=run) for run in range(3)]
    own, messages = lanes.stacked(missions)
    fixes = np.broadcast_to(truth.start[:2, None], (messages.shape[0], 2, 3))
    together = benchmarks.vectorised_numpy(own[:, :2, :3], fixes, truth.start, settings)
    alone = [benchmarks.filterpy_loop(mission, truth.start, settings) for mission in missions]
    assert together == pytest.approx(np.array(alone), abs=1e-9)


def test_the_peak_is_that_of_a_processor() -> None:
    # From one operation per nanosecond to two 512-bit fused units at 6 GHz.
    assert 1e9 < benchmarks.peak_flops() < 2 * 16 * 6e9


def test_table_shows_every_row_and_leaves_out_what_is_unknown() -> None:
    lines = table([Row("one", 2.5, "ns/step", 10.0, "another", 1.25), Row("two", 3.0, "s")]).splitlines()
    assert lines[1].split() == ["one", "2.5", "ns/step", "10.0x", "another", "1.2"]
    assert lines[2].split() == ["two", "3.0", "s"]
    assert all(callable(benchmark) for benchmark in BENCHMARKS.values())
