"""Speed beside peers, all measured in one run, on one core but for what needs several processes:
`python -m tools.benchmarks.run`.

Each benchmark is a function that returns rows; `BENCHMARKS` lists them. Times are the least of
several, because other work on the machine can only add to them. A row that misses its goal is named
at the end, and the exit code is 1.
"""

import argparse
import os
import platform
import resource
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
from filterpy.kalman import KalmanFilter

from experiments.campaign.montecarlo import Cell, simulate
from laisn import lanes
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.messages import Measurements
from laisn.navigator import Navigator
from laisn.settings import NavigationSettings
from laisn.swarm import MESSAGE
from reports.findings import Finding, Findings, interval_finding, plain_finding, read_findings
from reports.findings import record as make_record
from reports.intervals import Interval
from sim.sensing.observation import IdealMeasurements, measure
from sim.sensing.sensors import SensorErrors
from tools.benchmarks import mission as benchmarks_mission
from tools.benchmarks.commands import cold, commands
from tools.benchmarks.formation import formation
from tools.benchmarks.memory import memory
from tools.benchmarks.navigators import filter_only, navigator_rows
from tools.benchmarks.peak import peak_flops
from tools.benchmarks.peers import peers
from tools.benchmarks.row import Goal, Row, least_time
from tools.benchmarks.sea import sea
from tools.benchmarks.stepping import stepping
from tools.benchmarks.studies import studies
from tools.benchmarks.together import together
from tools.documents.markers import RECORDS

RUNS = 60
STEPS = 2000
MESSAGE_EVERY = 10  # steps
DT = 0.1  # [s]
FLOPS_PER_STEP = 200
"""Operations of LAISN-2 in a step: predict 50, sine and cosine 35, speed update 105, a tenth of
a fix's update 12.
"""
WHOLE_GOAL_NS = 18.0
"""What a step of LAISN-2 in lanes is to cost at most with noise and metrics [ns]."""


def steady_mission(steps: int = STEPS) -> IdealMeasurements:
    """A leader heading east at 1 m/s, and a follower that weaves 20 m off its quarter."""
    t = np.asarray(DT * np.arange(steps + 1), dtype=np.float64)
    leader = np.stack([t, np.zeros(t.size)], axis=1)
    follower = leader + np.stack(
        [-15.0 + 2.0 * np.sin(0.1 * t), -12.0 + 2.0 * np.cos(0.07 * t)], axis=1
    )
    velocity = np.gradient(follower, DT, axis=0)
    k = np.arange(MESSAGE_EVERY, steps + 1, MESSAGE_EVERY)
    sites = [leader + offset for offset in ((-1.0, 0.0), (1.0, 0.0), (0.0, 0.1))]
    heading_east = np.full(steps + 1, np.pi / 2)
    return IdealMeasurements(
        dt=DT,
        start=np.concatenate([follower[0], velocity[0]]),
        speed=np.hypot(*velocity[1:].T),
        heading=np.arctan2(*velocity[1:].T),
        depth=np.full(steps, 10.0),
        hydrophone=follower[1:],
        leader_position=leader[1:],
        leader_heading=heading_east[1:],
        message_step=k,
        emission_step=k,
        # time, position, heading, speed and depth; the leader broadcasts no more
        sent=np.rec.fromarrays(
            [
                t[k],
                *leader[k].T,
                heading_east[k],
                np.ones(k.size),
                np.full(k.size, 10.0),
                *np.full((4, k.size), np.nan),
            ],
            dtype=MESSAGE,
        ),
        slant_range=np.stack([np.hypot(*(follower - s)[k].T) for s in sites], axis=1),
    )


def filterpy_loop(mission: Measurements, start: Floats, settings: NavigationSettings) -> Floats:
    """Predict, position and speed update of one run with filterpy, without anything else; fixes
    are the start.
    """
    kalman = KalmanFilter(dim_x=4, dim_z=2)
    kalman.x = start.copy()
    kalman.P = np.zeros((4, 4))
    A = np.eye(4) + DT * np.eye(4, k=2)
    G = np.kron(np.array([[DT * DT / 2], [DT]]), np.eye(2))
    Q = settings.sigma_a0**2 * G @ G.T
    H_position, H_velocity = np.eye(4)[:2], np.eye(4)[2:]
    # σp = β / 1 m: any value takes the same time
    position_noise = settings.beta**2 * np.eye(2)
    for k in range(1, mission.speed.size + 1):
        kalman.predict(F=A, Q=Q)
        if k % MESSAGE_EVERY == 0:
            kalman.update(start[:2], R=position_noise, H=H_position)
        speed = mission.speed[k - 1]
        heading = mission.heading[k - 1]
        sine, cosine = np.sin(heading), np.cos(heading)
        jacobian = np.array([[sine, speed * cosine], [cosine, -speed * sine]])
        noise = (jacobian * (settings.sigma_speed**2, settings.sigma_heading**2)) @ jacobian.T
        kalman.update(np.array([speed * sine, speed * cosine]), R=noise, H=H_velocity)
    return np.asarray(kalman.x)


def vectorised_numpy(
    readings: Floats, messages: Floats, start: Floats, settings: NavigationSettings
) -> Floats:
    """The Kalman filter of all R runs at once with NumPy.

    Args:
        readings: speed [m/s] and heading [rad] of each step, shape (n, 2, R).
        messages: fixes, east and north [m], shape (m, 2, R).
        start: east, north [m] and velocity [m/s], shape (4,).
        settings: of the filter.

    Returns:
        States at the end, shape (R, 4).
    """
    runs = readings.shape[2]
    x = np.tile(start, (runs, 1))
    P = np.zeros((runs, 4, 4))
    A = np.eye(4) + DT * np.eye(4, k=2)
    G = np.kron(np.array([[DT * DT / 2], [DT]]), np.eye(2))
    Q = settings.sigma_a0**2 * G @ G.T
    R = np.empty((runs, 2, 2))
    position_noise = settings.beta**2 * np.eye(2)
    speed_variance = settings.sigma_speed**2
    heading_variance = settings.sigma_heading**2

    def update(z: Floats, noise: Floats, states: slice) -> None:
        nonlocal x, P
        S = P[:, states, states] + noise
        det = S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] * S[:, 1, 0]
        inverse = np.empty_like(S)
        inverse[:, 0, 0] = S[:, 1, 1] / det
        inverse[:, 1, 1] = S[:, 0, 0] / det
        inverse[:, 0, 1] = inverse[:, 1, 0] = -S[:, 0, 1] / det
        K = P[:, :, states] @ inverse
        x = x + (K @ (z - x[:, states])[..., None])[..., 0]
        I_KH = np.tile(np.eye(4), (runs, 1, 1))
        I_KH[:, :, states] -= K
        P = I_KH @ P @ I_KH.transpose(0, 2, 1) + K @ noise @ K.transpose(0, 2, 1)

    for k in range(1, readings.shape[0] + 1):
        speed, heading = readings[k - 1]
        x = x @ A.T
        P = A @ P @ A.T + Q
        if k % MESSAGE_EVERY == 0:
            update(messages[k // MESSAGE_EVERY - 1].T, position_noise, slice(0, 2))
        sine, cosine = np.sin(heading), np.cos(heading)
        across_variance = heading_variance * speed * speed
        R[:, 0, 0] = speed_variance * sine * sine + across_variance * cosine * cosine
        R[:, 1, 1] = speed_variance * cosine * cosine + across_variance * sine * sine
        R[:, 0, 1] = R[:, 1, 0] = (speed_variance - across_variance) * sine * cosine
        update(np.stack([speed * sine, speed * cosine], axis=1), R, slice(2, 4))
    return x


def _peak_memory_mb() -> float:
    """Most memory that this process has had [MB]."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit * 1e-6


def navigation() -> list[Row]:
    """A filter step of one run: compiled lanes beside a filterpy loop and vectorised NumPy."""
    truth = steady_mission()
    settings = NavigationSettings()
    missions = [measure(truth, SensorErrors(), seed=1, run=run) for run in range(RUNS)]
    readings, messages = lanes.stacked(missions)
    n = truth.speed.size
    m = truth.message_step.size
    peak = peak_flops()
    floor = FLOPS_PER_STEP / peak * 1e9

    few_steps = 300
    short = measure(steady_mission(few_steps), SensorErrors(), seed=1, run=0)
    navigator_ns = (
        least_time(lambda: Navigator(settings, truth.start).run(short), 3) / few_steps * 1e9
    )
    filterpy_ns = (
        least_time(lambda: filterpy_loop(short, truth.start, settings), 3) / few_steps * 1e9
    )
    # speeds of the log, headings of the compass
    log_and_compass = readings.reshape(n, 3, -1)[:, :2, :RUNS]
    # the leader's east and north stand in for fixes, as only the time counts; a lane holds 3
    # readings and 10 numbers of a message
    stand_in_fixes = messages.reshape(m, 10, -1)[:, :2, :RUNS]
    numpy_s = least_time(
        lambda: vectorised_numpy(log_and_compass, stand_in_fixes, truth.start, settings), 3
    )
    vectorised_ns = numpy_s / (n * RUNS) * 1e9
    rows = [
        Row("peak of one core, fused multiply-adds", peak * 1e-9, "GF/s"),
        Row("filterpy: predict and updates only", filterpy_ns, "ns/step"),
        Row(
            "navigator (readable engine)",
            navigator_ns,
            "ns/step",
            filterpy_ns / navigator_ns,
            "filterpy",
        ),
        Row("NumPy vectorised over 60 runs: predict and updates only", vectorised_ns, "ns/step"),
    ]

    def add_rows(
        name: str, work: Callable[[], object], steps: int, goal: Goal | None = None
    ) -> None:
        value = least_time(work) / (steps * RUNS) * 1e9
        lane = f"lanes, {name}"
        rows.append(Row(lane, value, "ns/step", filterpy_ns / value, "filterpy", floor, goal))
        rows.append(Row(lane, value, "ns/step", vectorised_ns / value, "NumPy", floor))

    tuned = lanes.tuning(settings)
    add_rows(
        "LAISN-2 filter only",
        lambda: filter_only(readings, truth.message_step, messages, truth.start[None], tuned),
        n,
    )
    few_runs, many_runs = (Cell(truth=truth, runs=range(runs)) for runs in (RUNS, 100 * RUNS))
    simulate(few_runs)
    start_mb = _peak_memory_mb()
    simulate(many_runs)
    rows.append(
        Row(
            f"memory of {100 * RUNS} runs beyond that of {RUNS}", _peak_memory_mb() - start_mb, "MB"
        )
    )
    for variant in ("laisn-2", "laisn-3-1", "laisn-3-2"):
        cell = Cell(
            truth=steady_mission(5 * n),
            settings=NavigationSettings(variant=variant),
            runs=range(RUNS),
        )
        goal = Goal(WHOLE_GOAL_NS) if variant == "laisn-2" else None
        name = f"{variant.upper()} with noise and metrics"
        add_rows(name, lambda cell=cell: simulate(cell), 5 * n, goal)  # type: ignore[misc]
    return rows


BENCHMARKS: dict[str, Callable[[], list[Row]]] = {
    "navigation": navigation,
    "tight": navigator_rows,
    "physics": benchmarks_mission.physics,
    "engines": benchmarks_mission.engines,
    "plant": benchmarks_mission.plant,
    "waves": benchmarks_mission.waves,
    "sea": sea,
    "formation": formation,
    "stepping": stepping,
    "together": together,
    "study": studies,
    "log": benchmarks_mission.log,
    "film": benchmarks_mission.film,
    "command": commands,
    "cold": cold,
    "peers": peers,
    "memory": memory,
}
ON_ALL_CORES = ("film", "command", "cold", "study", "memory")
"""What several processes do is measured on all cores, all else on one."""
ONCE = ("cold", "memory")
"""What hardly varies, and takes minutes, is measured once."""


def table(rows: list[Row]) -> str:
    """Rows as aligned text."""
    heads = f"{'':58}{'value':>11} {'unit':8} {'faster':>8}  {'than':9}{'floor':>7}  goal"
    lines = [heads]
    for r in rows:
        ratio = "" if np.isnan(r.ratio) else f"{r.ratio:.1f}x"
        floor = "" if np.isnan(r.floor) else f"{r.floor:.1f}"
        goal = ""
        if r.goal is not None:
            goal = f"  {r.goal}{'' if r.goal.is_met(r.value) else ' MISSED'}"
        line = f"{r.name:58}{r.value:11.1f} {r.unit:8} {ratio:>8}  {r.against:9}{floor:>7}{goal}"
        lines.append(line.rstrip())
    return "\n".join(lines)


def misses(rounds: Mapping[str, Sequence[list[Row]]]) -> list[str]:
    """Rows whose median over the rounds misses their goal, a line each."""
    lines = []
    for name, measured in rounds.items():
        for repeated in zip(*measured, strict=True):
            row = repeated[0]
            value = float(np.median([r.value for r in repeated]))
            if row.goal is not None and not row.goal.is_met(value):
                text = f"{name}: {row.name}: {value:.3g} {row.unit}, the goal is {row.goal}"
                lines.append(text.replace(" ,", ","))
    return lines


def record(rounds: Mapping[str, Sequence[list[Row]]]) -> Findings:
    """What was measured in several rounds: of each row median, least and largest, and the same
    of its ratio.
    """
    machine = (
        f"{os.cpu_count()} cores, {platform.machine()}, {platform.system()}, Python "
        f"{platform.python_version()}"
    )
    findings = {
        "machine": plain_finding(machine, "where"),
        "date": plain_finding(str(date.today()), "when"),
    }
    max_rounds = max(map(len, rounds.values()))
    findings["rounds"] = plain_finding(
        max_rounds, "of a benchmark; limits are the least and the largest of them"
    )
    for name, measured in rounds.items():
        if len(measured) < max_rounds:
            findings[f"{name}: rounds"] = plain_finding(len(measured), "of this benchmark")
        for repeated in zip(*measured, strict=True):
            row = repeated[0]
            # the most memory that a process ever had grows in the first round alone
            measured_once = row.unit == "MB" and name == "navigation"
            rows = repeated[:1] if measured_once else repeated
            key = f"{name}: {row.name}"
            value_key = f"{key}, than {row.against}" if key in findings else key
            findings[value_key] = _spread(
                [r.value for r in rows], row.unit, "median, least and largest of the rounds"
            )
            findings |= _beside(key, rows)
    return make_record(
        "benchmarks", "make bench BENCH_ARGS=--record", ("tools.benchmarks.run",), findings
    )


def renewed(old: Findings, new: Findings) -> Findings:
    """The old record with the benchmarks that the new one has in place of its own.

    LaisnError if the records are of different machines.
    """
    if old["machine"] != new["machine"]:
        raise LaisnError(
            f"the record is of {old['machine']}, and this machine has {new['machine']}: "
            "record all benchmarks"
        )
    # keys of the record as a whole
    not_benchmarks = {"machine", "date", "rounds"}
    names = {key.partition(": ")[0] for key in new.findings} - not_benchmarks
    rounds = {
        f"{name}: rounds": plain_finding(new["rounds"].value, "of this benchmark") for name in names
    }
    kept = {key: f for key, f in old.findings.items() if key.partition(": ")[0] not in names}
    return replace(new, findings={**kept, **rounds, **new.findings, "rounds": old["rounds"]})


def _beside(key: str, rows: Sequence[Row]) -> dict[str, Finding]:
    """What stands beside the value of a row, measured in several rounds: its ratio to another
    program, the machine's floor, and its goal.
    """
    row = rows[0]
    findings = {}
    if row.against:
        findings[f"{key}, than {row.against}"] = _spread(
            [r.ratio for r in rows],
            "",
            f"how many times faster than {row.against}; median, least and largest of the rounds",
        )
    if not np.isnan(row.floor):
        findings[f"{key}, floor"] = _spread([r.floor for r in rows], row.unit, "of the machine")
    if row.goal is not None:
        value = float(np.median([r.value for r in rows]))
        verdict = "met" if row.goal.is_met(value) else "missed"
        bound = "at least" if row.goal.at_least else "at most"
        findings[f"{key}, goal"] = plain_finding(
            row.goal.value, f"{bound}; {verdict} by the median", row.unit
        )
    return findings


def _spread(values: Sequence[float], unit: str, description: str) -> Finding:
    """Median, least and largest of the values; of a single one no limits."""
    if len(values) == 1:
        return plain_finding(values[0], description, unit)
    return interval_finding(
        Interval(float(np.median(values)), min(values), max(values)), description, unit
    )


def main() -> None:
    """Run the benchmarks named on the command line, or all of them."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"benchmarks, of {', '.join(BENCHMARKS)}; all if none is named",
    )
    parser.add_argument("--rounds", type=int, default=3, help="how many times each is run")
    parser.add_argument(
        "--out", type=Path, default=Path("out/benchmarks.json"), help="file of the record"
    )
    parser.add_argument(
        "--record",
        action="store_true",
        help="write the record that the documents quote, of named benchmarks their rows alone",
    )
    arguments = parser.parse_args()
    names = arguments.names or list(BENCHMARKS)
    unknown = [name for name in names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; expected of {', '.join(BENCHMARKS)}")
    cores = os.sched_getaffinity(0) if hasattr(os, "sched_setaffinity") else set()
    measured: dict[str, list[list[Row]]] = {}
    for name in names:
        if cores:
            os.sched_setaffinity(0, cores if name in ON_ALL_CORES else {min(cores)})
        repeats = 1 if name in ONCE else arguments.rounds
        measured[name] = [BENCHMARKS[name]() for _ in range(repeats)]
        print(f"{name}\n{table(measured[name][-1])}\n", flush=True)
    path = RECORDS / "benchmarks.json" if arguments.record else arguments.out
    findings = record(measured)
    if arguments.record and arguments.names and path.exists():
        findings = renewed(read_findings(path), findings)
    findings.write(path)
    print(f"written to {path}")
    missed = misses(measured)
    if missed:
        sys.exit("\n".join([f"{len(missed)} goals are missed:", *missed]))


if __name__ == "__main__":
    main()
