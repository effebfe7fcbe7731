"""Benchmarks: the peers that lanes are compared with do the same work, and the table says what was measured."""

import numpy as np
import pytest

from experiments.benchmarks import run as benchmarks
from experiments.benchmarks.row import Row
from experiments.benchmarks.run import BENCHMARKS, record, steady_mission, table
from experiments.gallery.tables import speed
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


def rounds(
    name: str, *values: float, ratios: tuple[float, ...] = (), against: str = "", floor: float = np.nan
) -> list[Row]:
    """A row of each round."""
    faster = ratios or (np.nan,) * len(values)
    return [Row(name, value, "ns/step", ratio, against, floor) for value, ratio in zip(values, faster, strict=True)]


def test_the_record_has_the_median_of_the_rounds_and_their_spread() -> None:
    filterpy = rounds("lanes", 10.0, 14.0, 11.0, ratios=(2900.0, 2000.0, 2600.0), against="filterpy", floor=3.5)
    vectorised = rounds("lanes", 10.0, 14.0, 11.0, ratios=(120.0, 90.0, 100.0), against="NumPy", floor=3.5)
    found = record({"navigation": [list(pair) for pair in zip(filterpy, vectorised, strict=True)]})
    value = found["navigation: lanes"]
    assert (value.value, value.low, value.high, value.unit) == (11.0, 10.0, 14.0, "ns/step")
    assert f"{found['navigation: lanes, than filterpy']:,.0f i}" == "2,600 (2,000 to 2,900)"
    assert f"{found['navigation: lanes, than NumPy']:.0f i}" == "100 (90 to 120)"
    assert found["navigation: lanes, floor"].value == 3.5
    assert found["rounds"].value == 3
    # it stays when sources change, and says of which it is
    assert found.modules == ()
    assert "+" in found.version


def test_the_table_of_speeds_is_that_of_the_record() -> None:
    physics = []
    for n, (step, bare) in {1: (3.0, 6.0), 10: (12.0, 15.0), 50: (60.0, 150.0)}.items():
        fleet = f"leader + {n}"
        physics += [
            Row(f"{fleet}: mj_step alone, no water", bare, "µs/step"),
            Row(f"{fleet}: with autopilot and recording", step, "µs/step", bare / step, "mj_step", bare / 2),
            Row(f"{fleet}: real-time factor", 20_000.0 / step, "x"),
        ]
    navigation = [
        Row("lanes, LAISN-2 filter only", 10.0, "ns/step", 2900.0, "filterpy", 3.5),
        Row("lanes, LAISN-2 filter only", 10.0, "ns/step", 120.0, "NumPy", 3.5),
        Row("lanes, LAISN-2 with noise and metrics", 18.0, "ns/step"),
        Row("lanes, LAISN-3-2 with noise and metrics", 19.0, "ns/step"),
    ]
    log = [Row("writing", 120.0, "k/s"), Row("size", 8.6, "MB")]
    found = record({"physics": [physics], "navigation": [navigation], "log": [log]})
    lines = speed({"benchmarks": found}).splitlines()
    first = "| 3.0 (3.0 to 3.0) µs a step, 6,667 times real time | bare `mj_step` 6.0 µs, its needed part 3.0 µs |"
    assert lines[2].endswith(first)
    assert "60.0 (60.0 to 60.0) µs a step, 333 times real time" in lines[4]
    assert (
        "10.0 (10.0 to 10.0) ns a step | 2,900 (2,900 to 2,900) times as fast as filterpy, 120 (120 to 120)" in lines[5]
    )
    assert "floor by flops 3.5 ns" in lines[5]
    assert lines[7].startswith("| LAISN-3(2), with noise and metrics | 19.0 (19.0 to 19.0) ns a step |")
    assert "120 (120 to 120) thousand messages/s | 8.6 MB" in lines[8]
    filmed = record({"physics": [physics], "navigation": [navigation], "log": [log],
                     "film": [[Row("frames a second, once running", 25.0, "1/s")]],
                     "command": [[Row("laisn fly T5 --no-video", t, "s")] for t in (2.25, 2.5, 2.0)]})  # fmt: skip
    assert "25 (25 to 25) frames/s" in speed({"benchmarks": filmed})
    assert "| 2.2 (2.0 to 2.5) s by the clock |" in speed({"benchmarks": filmed})
