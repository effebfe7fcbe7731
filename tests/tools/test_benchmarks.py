"""Benchmarks: the peers that lanes are compared with do the same work, and the table contains
the measurements.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from subprocess import CalledProcessError
from time import process_time
from types import SimpleNamespace

import numpy as np
import pytest

from laisn import lanes
from laisn.errors import LaisnError
from laisn.lanes import LANES
from laisn.settings import NavigationSettings
from reports.findings import plain_finding, read_findings, version_of
from sim.sensing.observation import measure
from sim.sensing.sensors import SensorErrors
from tests import synthetic
from tools.benchmarks import formation, mission, navigators, peak
from tools.benchmarks import run as benchmarks
from tools.benchmarks.peak import peak_flops
from tools.benchmarks.row import (
    Goal,
    Row,
    least_time,
    least_time_of_command,
    least_times,
    time_of_command,
)
from tools.benchmarks.run import BENCHMARKS, misses, record, renewed, steady_mission, table
from tools.documents.markers import RECORDS
from tools.documents.speed import Cost, costs
from tools.documents.tables import speed, waiting


def test_peers_of_the_lanes_reach_the_same_states() -> None:
    truth, settings = steady_mission(60), NavigationSettings()
    missions = [measure(truth, SensorErrors(), seed=1, run=run) for run in range(3)]
    readings_of_missions, messages = lanes.stacked(missions)
    fixes = np.broadcast_to(truth.start[:2, None], (messages.shape[0], 2, 3))
    readings = readings_of_missions.reshape(len(readings_of_missions), 3, -1)[:, :2, :3]
    vectorised_states = benchmarks.vectorised_numpy(readings, fixes, truth.start, settings)
    filterpy_states = [
        benchmarks.filterpy_loop(mission, truth.start, settings) for mission in missions
    ]
    assert vectorised_states == pytest.approx(np.array(filterpy_states), abs=1e-9)


@pytest.mark.system
def test_the_peak_is_that_of_a_processor() -> None:
    # From one operation per nanosecond to two 512-bit fused units at 6 GHz.
    assert 1e9 < peak_flops() < 2 * 16 * 6e9


def test_the_peak_is_measured_for_longer_than_a_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fastest processor of all takes five ticks of 10 ms for the operations of one
    measurement.
    """
    monkeypatch.setattr(peak, "least_time", lambda work: 1.0)
    assert peak_flops() >= 0.05 * 2 * 16 * 6e9


def test_table_shows_every_row_and_leaves_out_what_is_unknown() -> None:
    rows = [
        Row("one", 2.5, "ns/step", 10.0, "another", 1.25),
        Row("two", 3.0, "s"),
        Row("three", 3.0, "s", goal=Goal(3.0)),
        Row("four", 3.0, "x", goal=Goal(3.1, at_least=True)),
    ]
    lines = table(rows).splitlines()
    assert lines[1].split() == ["one", "2.5", "ns/step", "10.0x", "another", "1.2"]
    assert lines[2].split() == ["two", "3.0", "s"]
    assert lines[3].split() == ["three", "3.0", "s", "≤", "3"]
    assert lines[4].split() == ["four", "3.0", "x", "≥", "3.1", "MISSED"]
    assert all(callable(benchmark) for benchmark in BENCHMARKS.values())


def test_a_goal_that_the_median_misses_is_named_and_fails_the_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of three rounds, of which one or two miss."""
    values = {"late": iter([17.0, 25.0, 26.0]), "once": iter([17.0, 19.0, 16.0])}

    def benchmark_rows() -> list[Row]:
        return [
            Row(name, next(rounds_of_row), "ns/step", goal=Goal(18.0))
            for name, rounds_of_row in values.items()
        ]

    monkeypatch.setattr(benchmarks, "BENCHMARKS", {"lanes": benchmark_rows})
    path = tmp_path / "record.json"
    monkeypatch.setattr("sys.argv", ["run", "--out", str(path)])
    with pytest.raises(SystemExit) as exit_info:
        benchmarks.main()
    text = "1 goals are missed:\nlanes: late: 25 ns/step, the goal is ≤ 18"
    assert exit_info.value.code == text
    recorded = read_findings(path)
    assert recorded["lanes: late, goal"].value == 18
    assert recorded["lanes: late, goal"].what == "at most; missed by the median"
    assert recorded["lanes: once, goal"].what == "at most; met by the median"


def test_what_was_not_measured_misses_no_goal() -> None:
    rows = [Row("film", np.nan, "x", goal=Goal(2.0))]
    assert misses({"film": [rows]}) == []


def test_the_record_states_the_rounds_of_each_benchmark() -> None:
    """Memory is measured once, whatever is measured last."""
    once, thrice = rows_of_rounds("peak", 300.0), rows_of_rounds("step", 1.0, 2.0, 3.0)
    actual = record({"navigation": [[row] for row in thrice], "memory": [once]})
    assert actual["rounds"].value == 3
    assert actual["memory: rounds"].value == 1
    assert "navigation: rounds" not in actual.findings


def test_the_time_of_a_command_is_that_of_its_processes(tmp_path: Path) -> None:
    """A child of the command works for 0.2 s of processor time; the command waits for 0.3 s."""
    work = "import time\nwhile time.process_time() < 0.2: pass"
    program = f"import subprocess, sys, time\nsubprocess.run([sys.executable, '-c', {work!r}])"
    times = time_of_command(("-c", f"{program}\ntime.sleep(0.3)"))
    assert times.processor_s >= 0.2
    assert times.wall_s >= 0.5
    assert times.processor_s < times.wall_s
    with pytest.raises(CalledProcessError):
        time_of_command(("-c", "raise SystemExit(3)"))
    marks_file = tmp_path / "mark"
    least_time_of_command(("-c", f"open({str(marks_file)!r}, 'a').write('.')"), 3)
    assert marks_file.read_text() == "...."


def rows_of_rounds(
    name: str,
    *values: float,
    ratios: tuple[float, ...] = (),
    against: str = "",
    floor: float = np.nan,
) -> list[Row]:
    """A row of each round."""
    faster = ratios or (np.nan,) * len(values)
    return [
        Row(name, value, "ns/step", ratio, against, floor)
        for value, ratio in zip(values, faster, strict=True)
    ]


@pytest.mark.system
def test_the_record_has_the_median_of_the_rounds_and_their_spread() -> None:
    filterpy = rows_of_rounds(
        "lanes", 10.0, 14.0, 11.0, ratios=(2900.0, 2000.0, 2600.0), against="filterpy", floor=3.5
    )
    vectorised = rows_of_rounds(
        "lanes", 10.0, 14.0, 11.0, ratios=(120.0, 90.0, 100.0), against="NumPy", floor=3.5
    )
    actual = record({"navigation": [list(pair) for pair in zip(filterpy, vectorised, strict=True)]})
    value = actual["navigation: lanes"]
    assert (value.value, value.low, value.high, value.unit) == (11.0, 10.0, 14.0, "ns/step")
    assert f"{actual['navigation: lanes, than filterpy']:,.0f i}" == "2,600 (2,000 to 2,900)"
    assert f"{actual['navigation: lanes, than NumPy']:.0f i}" == "100 (90 to 120)"
    assert actual["navigation: lanes, floor"].value == 3.5
    assert actual["rounds"].value == 3
    assert actual.version == version_of(["tools.benchmarks.run"])


@pytest.mark.system
def test_rows_of_named_benchmarks_replace_those_of_a_record_of_this_machine() -> None:
    old = record({"sea": [[Row("a", 1.0, "s"), Row("b", 2.0, "s")]], "log": [[Row("c", 3.0, "s")]]})
    new = record({"sea": [[Row("a", 4.0, "s")], [Row("a", 6.0, "s")]]})
    values = {key: finding.value for key, finding in renewed(old, new).findings.items()}
    assert (values["sea: a"], values["log: c"]) == (5.0, 3.0)
    assert "sea: b" not in values
    assert (values["rounds"], values["sea: rounds"]) == (1, 2)
    of_another_machine = replace(
        new, findings={**new.findings, "machine": plain_finding("64 cores", "where")}
    )
    with pytest.raises(LaisnError, match="this machine has 64 cores: record all benchmarks"):
        renewed(old, of_another_machine)


def test_the_table_of_speeds_is_that_of_the_record() -> None:
    physics = []
    for n, (step_us, mujoco_us) in {1: (3.0, 6.0), 10: (12.0, 15.0), 50: (60.0, 150.0)}.items():
        fleet = f"leader + {n}"
        physics += [
            Row(f"{fleet}: mj_step alone, no water", mujoco_us, "µs/step"),
            Row(
                f"{fleet}: with autopilot and recording",
                step_us,
                "µs/step",
                mujoco_us / step_us,
                "mj_step",
                mujoco_us / 2,
            ),
            Row(f"{fleet}: real-time factor", 20_000.0 / step_us, "x"),
        ]
    navigation = [
        Row("lanes, LAISN-2 filter only", 10.0, "ns/step", 2900.0, "filterpy", 3.5),
        Row("lanes, LAISN-2 filter only", 10.0, "ns/step", 120.0, "NumPy", 3.5),
        Row("lanes, LAISN-2 with noise and metrics", 18.0, "ns/step"),
        Row("lanes, LAISN-3-2 with noise and metrics", 19.0, "ns/step"),
    ]
    log = [Row("writing", 120.0, "k/s"), Row("size", 8.6, "MB")]
    tight = [Row("tight, 3 transmitters, messages every 1 s", 64.0, "ns/step", 0.2, "LAISN-2", 3.4)]
    actual = record({"physics": [physics] * 2, "navigation": [navigation] * 2, "log": [log] * 2})
    lines = speed({"benchmarks": actual}).splitlines()
    first = (
        "| 3.0 (3.0 to 3.0) µs a step, 6,667 times real time | bare `mj_step` 6.0 µs, its "
        "needed part 3.0 µs |"
    )
    assert lines[2].endswith(first)
    assert "60.0 (60.0 to 60.0) µs a step, 333 times real time" in lines[4]
    assert "10.0 (10.0 to 10.0) ns a step | 2,900 times as fast as filterpy, 120" in lines[5]
    assert "floor by flops 3.5 ns" in lines[5]
    assert lines[7].startswith(
        "| LAISN-3(2), with noise and metrics | 19.0 (19.0 to 19.0) ns a step |"
    )
    assert "120 (120 to 120) thousand messages/s | 8.6 MB" in lines[8]
    of_other_benchmarks = record(
        {
            "physics": [physics],
            "navigation": [navigation],
            "log": [log],
            "tight": [tight],
            "film": [[Row("frames a second, once running", 25.0, "1/s")]],
            "command": [
                [
                    Row("laisn fly T5 --no-video", t, "s"),
                    Row("laisn fly T5 --no-video, by the clock", t + 1, "s"),
                ]
                for t in (2.25, 2.5, 2.0)
            ],
        }
    )
    assert "64.0 ns a step | 0.20 times as fast" in speed({"benchmarks": of_other_benchmarks})
    assert "25 frames/s" in speed({"benchmarks": of_other_benchmarks})
    assert "| 2.2 (2.0 to 2.5) s of the processor, 3.2 s by the clock |" in speed(
        {"benchmarks": of_other_benchmarks}
    )


def by_name_and_peer(rows: list[Row]) -> dict[tuple[str, str], Row]:
    return {(row.name, row.against): row for row in rows}


@pytest.mark.system
def test_times_of_navigation_are_reported_per_step_of_a_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Every work takes 3 s: of 300 steps of one run, of 2000 steps of 60 runs, or of five times
    as many.
    """
    monkeypatch.setattr(benchmarks, "least_time", lambda *_: 3.0)
    monkeypatch.setattr(peak, "least_time", lambda *_: 3.0)
    monkeypatch.setattr(benchmarks, "simulate", lambda _: None)
    actual = by_name_and_peer(benchmarks.navigation())
    # 8 fused operations of 2 flops each, 10 million times in every lane
    flops = 16 * LANES * 10_000_000 / 3.0
    assert actual["peak of one core, fused multiply-adds", ""][1:3] == pytest.approx(
        (flops * 1e-9, "GF/s")
    )
    ns_of_one_run, ns_of_lanes = 3e9 / 300, 3e9 / (2000 * 60)
    assert actual["filterpy: predict and updates only", ""].value == pytest.approx(ns_of_one_run)
    readable = actual["navigator (readable engine)", "filterpy"]
    assert (readable.value, readable.ratio) == pytest.approx((ns_of_one_run, 1.0))
    for against, ratio in (("filterpy", ns_of_one_run / ns_of_lanes), ("NumPy", 1.0)):
        row = actual["lanes, LAISN-2 filter only", against]
        assert (row.value, row.unit) == (pytest.approx(ns_of_lanes), "ns/step")
        assert (row.ratio, row.floor) == pytest.approx((ratio, 200 / flops * 1e9))
        with_metrics = actual["lanes, LAISN-3-2 with noise and metrics", against]
        assert (with_metrics.value, with_metrics.ratio) == pytest.approx(
            (ns_of_lanes / 5, 5 * ratio)
        )


def test_times_of_the_tightly_coupled_navigator_are_held_against_laisn_2_and_the_aims(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Works that take 1 to 9 ms, of two runs of 10,000 steps, on a core of 1 GF/s."""
    monkeypatch.setattr(navigators, "RUNS", 2)
    monkeypatch.setattr(navigators, "peak_flops", lambda: 1e9)
    monkeypatch.setattr(
        navigators, "least_times", lambda works, _: [1e-3 * (i + 1) for i in range(len(works))]
    )
    actual = by_name_and_peer(navigators.navigator_rows())
    assert actual["LAISN-2 in lanes, filter only, messages every 5 s", ""].value == pytest.approx(
        50.0
    )
    three_transmitters = "tight, 3 transmitters, messages every 5 s"
    assert actual[three_transmitters, "LAISN-2"][1:6] == pytest.approx(
        (100.0, "ns/step", 0.5, "LAISN-2", 95 + 945 / 50)
    )
    assert actual[three_transmitters, "LAISN-2"].goal == Goal(60.0)
    assert actual["tight, 2 transmitters, messages every 5 s", "LAISN-2"].goal == Goal(250.0)
    assert actual[
        "tight, 3 transmitters, the speed as a state, messages every 5 s", "LAISN-2"
    ].value == pytest.approx(200.0)
    assert actual[
        "tight, 2 transmitters, all states, messages every 5 s", "LAISN-2"
    ].value == pytest.approx(350.0)
    assert actual["tight, 2 transmitters, all states, messages every 5 s", "LAISN-2"].goal is None


def test_times_of_physics_are_reported_per_step_of_a_fleet(monkeypatch: pytest.MonkeyPatch) -> None:
    """In turns 0.1 s of MuJoCo, 0.05 s of what a step needs of it, 0.2 s with water and 0.25 s
    with autopilots.
    """
    monkeypatch.setattr(mission, "FLEETS", {"leader + 1": (1, 100.0)})
    times = iter([0.1, 0.05, 0.2, 0.25])
    monkeypatch.setattr(mission, "least_time", lambda *_: next(times))
    actual = {row.name.removeprefix("leader + 1: "): row for row in mission.physics()}
    # 5000 steps of 0.02 s
    assert actual["mj_step alone, no water"].value == pytest.approx(20.0)
    assert actual["with hydrodynamics"][1:6] == pytest.approx(
        (40.0, "µs/step", 0.5, "mj_step", 10.0)
    )
    assert actual["with autopilot and recording"][1:6] == pytest.approx(
        (50.0, "µs/step", 0.4, "mj_step", 10.0)
    )
    assert actual["real-time factor"][1:3] == pytest.approx((400.0, "x"))
    assert actual["real-time factor"].goal == Goal(4500.0, at_least=True)


def test_a_closed_loop_is_reported_beside_the_solver_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.2 s of MuJoCo, 0.1 s of the closed loop, 0.16 s of one with sensors, 3 s of a whole run by
    MuJoCo, 0.5 s by the other engine.
    """
    times = {3: [0.2, 0.1, 0.16], 2: [3.0, 0.5]}
    monkeypatch.setattr(formation, "SWARMS", {10: 100.0})
    monkeypatch.setattr(formation, "least_times", lambda works, _: times[len(works)])
    monkeypatch.setattr(formation, "least_time", lambda *_: 3.0)
    monkeypatch.setattr(formation, "MAX_FOLLOWERS", 12)
    actual = {row.name.removeprefix("leader + 10: "): row for row in formation.formation()}
    # 5000 steps of 0.02 s
    assert actual["mj_step alone"][1:3] == pytest.approx((40.0, "µs/step"))
    assert actual["closed loop"][1:5] == pytest.approx((20.0, "µs/step", 2.0, "mj_step"))
    assert actual["followers sense each other"][1:5] == pytest.approx(
        (32.0, "µs/step", 1.25, "mj_step")
    )
    assert actual["solver over closed loop"][1:3] == pytest.approx((2.0, "x"))
    assert actual["solver over closed loop"].goal == Goal(1.0, at_least=True)
    assert actual["real-time factor"][1:3] == pytest.approx((1000.0, "x"))
    assert actual["a run of 1000 s, whole"][1:3] == (3.0, "s")
    assert actual["a run of 1000 s, whole, by direct"][1:3] == (0.5, "s")
    assert actual["runs by direct over mujoco"][1:3] == pytest.approx((6.0, "x"))
    assert actual["runs by direct over mujoco"].goal == Goal(5.0, at_least=True)
    assert {f.held_depth_m for f in formation.swarm(50, 1.0).followers} == {10.0}


def test_a_log_is_reported_in_thousand_messages_and_megabytes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(mission, "fly", lambda _: (synthetic.make_flight(5.0), None))
    monkeypatch.setattr(mission, "least_time", lambda work, _: (work(), 0.5)[1])
    monkeypatch.setattr(
        mission.writer, "write", lambda _, path, **__: path.write_bytes(bytes(2_500_000))
    )
    contents = SimpleNamespace(
        topics={name: SimpleNamespace(times=range(15_000)) for name in ("truth", "fix")}
    )
    monkeypatch.setattr(mission, "Contents", lambda *_: contents)
    monkeypatch.setattr(mission.reader, "read", lambda path: None)
    actual = {row.name: row for row in mission.log()}
    assert actual["messages"][1:3] == (30.0, "k")
    assert actual["writing"][1:3] == pytest.approx((60.0, "k/s"))
    assert actual["writing"].goal == Goal(50.0, at_least=True)
    assert actual["reading, to a flight"][1:3] == pytest.approx((60.0, "k/s"))
    assert actual["size"][1:3] == (2.5, "MB")


def test_works_take_turns_and_the_least_time_of_each_counts() -> None:
    seconds, turns = {"one": [0.05, 0.004, 0.02, 0.03], "other": [0.01, 0.06, 0.05, 0.03]}, []

    def work(name: str) -> None:
        turns.append(name)
        until = process_time() + seconds[name].pop(0)
        while process_time() < until:
            pass

    one, other = least_times([partial(work, "one"), partial(work, "other")], 3)
    assert 0.004 <= one < 0.015
    assert 0.03 <= other < 0.045
    assert turns == ["one", "other"] * 4
    seconds["one"] = [0.05, 0.02, 0.03]
    assert 0.02 <= least_time(partial(work, "one"), 2) < 0.03


def test_the_formula_of_waiting_comes_near_what_was_measured_as_a_whole() -> None:
    """Rows that enter the formula are of whole missions and runs; those that it is held against are
    steps and runs.
    """
    measured = read_findings(RECORDS / "benchmarks.json")
    cost = Cost.of(measured)
    # a step of a study's mission has more to it than that of a flight, and less than twice as much
    step_us = measured["physics: leader + 1: with autopilot and recording"].number / 2
    assert 0.8 * step_us < cost.alone_step_us < 2.0 * step_us
    lanes_us = 1e-3 * measured["engines: a vehicle, side by side in lanes"].number
    assert lanes_us < cost.vehicle_step_us < 4.0 * lanes_us
    by_mujoco_us = measured["formation: leader + 10: closed loop"].number / 11
    assert 0.2 * by_mujoco_us < cost.station_step_us < by_mujoco_us
    run = measured.findings.get("study: T5, another run of the same mission")
    if run is not None:
        assert cost.run_s(1, 1000.0) * 1e6 == pytest.approx(run.number, rel=0.3)


def test_experiments_are_priced_by_vehicles_steps_and_runs() -> None:
    """One microsecond a vehicle and step, 50 ns a run and filter step, 100 ms more a mission."""
    cost = Cost(
        start_s=3.0,
        vehicle_step_us=1.0,
        alone_step_us=4.0,
        station_step_us=2.0,
        run_step_ns=50.0,
        tight_step_ns=100.0,
        mission_ms=100.0,
    )
    assert cost.motion_s(2, 1000.0) == pytest.approx(0.1)
    assert cost.motion_s(11, 100.0, closed_loop=True) == pytest.approx(0.11)
    assert cost.run_s(3, 1000.0) == pytest.approx(1.5e-3)
    assert cost.run_s(1, 1000.0, tight=True) == pytest.approx(1e-3)
    assert "| one flight of T5 with report and log |" in waiting(
        {"benchmarks": read_findings(RECORDS / "benchmarks.json")}
    )


def test_the_symbols_of_the_formula_follow_the_record() -> None:
    """Missions of 100,000 vehicle steps that take 323.4 and 73.4 ms, of which 123.4 and 23.4 do not
    grow with their length, have steps of 2 and 0.5 µs; 550,000 steps in 0.11 s take 0.2 µs each.
    """
    measured = read_findings(RECORDS / "benchmarks.json")
    of_missions = {
        "study: T5 by mujoco, another mission with one run": plain_finding(323.4, "", "ms"),
        "study: T5 by mujoco, a mission beside its motion": plain_finding(123.4, "", "ms"),
        "study: T5 by direct, both vehicles varied, another mission with one run": plain_finding(
            73.4, "", "ms"
        ),
        "study: T5 by direct, both vehicles varied, a mission beside its motion": plain_finding(
            23.4, "", "ms"
        ),
        "formation: leader + 10: a run of 1000 s, whole, by direct": plain_finding(0.11, "", "s"),
    }
    record = replace(measured, findings={**measured.findings, **of_missions})
    lines = {line.split("`")[1]: line for line in costs({"benchmarks": record}).splitlines()[2:]}
    assert lines["m"].endswith("| 23 ms |")
    assert lines["p"].endswith("| 0.50 µs; 2.00 µs; 0.20 µs |")
    lanes_ns = measured["navigation: lanes, LAISN-2 with noise and metrics"].number
    assert f"| {lanes_ns:.0f} ns; " in lines["n"]
