"""Tables of docs/speed.md: what was measured, peers, and how long experiments take.

Rows of a benchmark that a record does not have yet are left out.
"""

from typing import NamedTuple

from reports.findings import Finding, Findings
from tools.documents.table_text import Records, markdown

FLEETS = {
    1: "physics of leader and one follower with autopilot, 0.02 s step",
    10: "the same with ten followers",
    50: "the same with fifty followers",
    200: "the same with 200 followers",
}
"""Rows of physics in the table of speeds, by the number of followers."""
CLOSED = {
    10: "ten followers that sense, navigate and keep stations",
    50: "fifty of them",
    200: "200 of them",
}
"""Rows of closed loops, by the number of followers."""
SEAS = {"regular": "leader and one follower in a regular wave", "jonswap": "in a JONSWAP sea"}
"""Rows of seas, by the kind of their waves."""
STUDIED_S = 1000.0
"""Length of the missions of the benchmark of studies, of two vehicles each [s]."""
_STEP_S = 0.02  # of physics
_FILTER_STEP_S = 0.1


def _finding_or_none(record: Findings, key: str) -> Finding | None:
    return record.findings.get(key)


def _physics(record: Findings) -> list[list[str]]:
    rows = []
    for followers, words in FLEETS.items():
        fleet = f"physics: leader + {followers}"
        row_name = f"{fleet}: with autopilot and recording"
        if row_name not in record.findings:
            continue
        bare = record[f"{fleet}: mj_step alone, no water"]
        floor = record[f"{row_name}, floor"]
        factor = record[f"{fleet}: real-time factor"]
        rows.append(
            [
                words,
                f"{record[row_name]:.1f i} µs a step, {factor:,.0f} times real time",
                f"bare `mj_step` {bare:.1f} µs, its needed part {floor:.1f} µs",
            ]
        )
    for kind, words in SEAS.items():
        step = _finding_or_none(record, f"waves: leader + 1, {kind}")
        if step is not None:
            calm = record["waves: leader + 1, calm"]
            rows.append([words, f"{step:.1f i} µs a step", f"calm {calm:.1f} µs"])
    for followers, words in CLOSED.items():
        closed_factor = _finding_or_none(
            record, f"formation: leader + {followers}: real-time factor"
        )
        if closed_factor is None:
            continue
        step = _finding_or_none(record, f"formation: leader + {followers}: closed loop")
        closed_bare = _finding_or_none(record, f"formation: leader + {followers}: mj_step alone")
        measured = f"{closed_factor:,.0f} times real time"
        if step is not None:
            measured = f"{step:.1f i} µs a step, {measured}"
        comparison = "" if closed_bare is None else f"bare `mj_step` {closed_bare:.1f} µs"
        rows.append([words, measured, comparison])
    return rows


def _navigation(record: Findings) -> list[list[str]]:
    filter_row = "navigation: lanes, LAISN-2 filter only"
    filterpy = record[f"{filter_row}, than filterpy"]
    vectorised = record[f"{filter_row}, than NumPy"]
    others = (
        f"{filterpy:,.0f} times as fast as filterpy, {vectorised:.0f} times as NumPy over 60 runs"
    )
    floor_ns = record[f"{filter_row}, floor"]
    rows = [
        [
            "LAISN-2, filter alone, 60 runs side by side",
            f"{record[filter_row]:.1f i} ns a step",
            f"{others}; floor by flops {floor_ns:.1f} ns",
        ]
    ]
    for variant in ("LAISN-2", "LAISN-3(2)"):
        key = f"navigation: lanes, {variant.replace('(', '-').rstrip(')')} with noise and metrics"
        rows.append([f"{variant}, with noise and metrics", f"{record[key]:.1f i} ns a step", ""])
    tight = "tight: tight, 3 transmitters, messages every 1 s"
    if tight in record.findings:
        comparison = f"{record[f'{tight}, than LAISN-2']:.2f} times as fast as LAISN-2 alone"
        measured = f"{record[tight]:.1f i} ns a step"
        comparison_text = f"{comparison}; floor by flops {record[f'{tight}, floor']:.1f} ns"
        rows.append(
            [
                "tightly coupled with three transmitters, one run after another",
                measured,
                comparison_text,
            ]
        )
    return rows


def _files(record: Findings) -> list[list[str]]:
    messages = record["log: writing"]
    size = record["log: size"]
    rows = [
        ["log", f"{messages:.0f i} thousand messages/s", f"{size:.1f} MB for 1000 s without film"]
    ]
    reading = _finding_or_none(record, "log: reading, to a flight")
    if reading is not None:
        rows.append(["reading a log", f"{reading:.0f i} thousand messages/s", ""])
    film = _finding_or_none(record, "film: frames a second, once running")
    if film is not None:
        frame = _finding_or_none(record, "film: processor time of a frame")
        bare = _finding_or_none(record, "film: processor time of a frame of a bare renderer")
        measured = f"{film:.0f i} frames/s"
        comparison = ""
        if frame is not None and bare is not None:
            measured += f", {frame:.0f} ms of the processor a frame"
            comparison = f"a bare `mujoco.Renderer` {bare:.0f} ms"
        rows.append(["film at 1280×720, rendered and encoded", measured, comparison])
    return rows


def _commands(record: Findings) -> list[list[str]]:
    rows = []
    for scenario in ("T5", "swarm"):
        name = f"command: laisn fly {scenario} --no-video"
        finding = _finding_or_none(record, name)
        clock = _finding_or_none(record, f"{name}, by the clock")
        if finding is None:
            continue
        measured = f"{finding:.1f i} s by the clock"
        if clock is not None:
            measured = f"{finding:.1f i} s of the processor, {clock:.1f} s by the clock"
        rows.append([f"`laisn fly {scenario} --no-video` as a whole", measured, ""])
        cold = f"cold: {scenario}: first flight of an installation"
        compiling = _finding_or_none(record, f"{cold}, compiling")
        functions = _finding_or_none(record, f"{cold}, compiled functions")
        if compiling is not None and functions is not None:
            words = f"what its first flight compiles: {functions:d} functions"
            rows.append([words, f"{compiling:.0f} s of the processor", _later(record, scenario)])
    return rows


def _later(record: Findings, scenario: str) -> str:
    """What the first flight of a scenario compiles after that of T5."""
    later = f"cold: {scenario}: first flight after T5"
    compiling = _finding_or_none(record, f"{later}, compiling")
    functions = _finding_or_none(record, f"{later}, compiled functions")
    if compiling is None or functions is None:
        return ""
    return f"after a flight of T5: {functions:d} functions, {compiling:.0f} s"


def speed(records: Records) -> str:
    """What `make bench` measured: median, least and largest of its rounds."""
    record = records["benchmarks"]
    rows = [*_physics(record), *_navigation(record), *_files(record), *_commands(record)]
    return markdown(["what", "measured (least to largest)", "for comparison"], rows)


class Peer(NamedTuple):
    """Another program that was measured by hand."""

    name: str
    work: str  # what was timed
    cost: str  # the time that it takes
    beside: str  # finding of the benchmarks to which that is compared


MEASURED_ONCE = (
    Peer(
        "Stonefish 1.6, console, hulls of 384 faces, fluid at every step",
        "a physics step of 1, 10, 50 vehicles",
        "21 to 32, 229 to 313, 1,142 µs",
        "physics: leader + 10: with autopilot and recording",
    ),
    Peer(
        "MuJoCo 4.0, its ellipsoid fluid model",
        "a physics step of 2, 11, 51 bodies",
        "2.8, 14, 126 µs",
        "physics: leader + 50: with autopilot and recording",
    ),
    Peer(
        "Python Vehicle Simulator of T. I. Fossen (May 2025)",
        "a step of one REMUS 100 with autopilots",
        "195 µs",
        "physics: remus100 + 1: with autopilot and recording",
    ),
    Peer(
        "MJX on the processor",
        "a step of one of 64 missions side by side",
        "5.7 µs",
        "physics: leader + 1: with autopilot and recording",
    ),
    Peer(
        "GTSAM 4.3, ISAM2",
        "a filter step of one follower",
        "23 µs",
        "tight: tight, 3 transmitters, messages every 1 s",
    ),
    Peer(
        "filterpy 2.0, extended Kalman filter",
        "a filter step of one follower",
        "8.4 µs",
        "tight: tight, 3 transmitters, messages every 1 s",
    ),
)
"""Measured within one hour in November 2026, on one core of the same kind of machine."""
# what does the work in these findings
_TITLES = {
    "physics: leader + 10: with autopilot and recording": "eleven vehicles",
    "physics: leader + 50: with autopilot and recording": "51 vehicles",
    "physics: remus100 + 1: with autopilot and recording": "two REMUS 100",
    "physics: leader + 1: with autopilot and recording": "two vehicles",
    "tight: tight, 3 transmitters, messages every 1 s": "`tight`",
}


def peers(records: Records) -> str:
    """Other programs beside rows of the record; those that the record measures come first."""
    record = records["benchmarks"]
    fossen = _finding_or_none(record, "peers: Python Vehicle Simulator, one REMUS 100")
    filterpy = record["navigation: filterpy: predict and updates only"]
    numpy = record["navigation: NumPy vectorised over 60 runs: predict and updates only"]
    lanes = record["navigation: lanes, LAISN-2 filter only"]
    in_lanes = f"LAISN-2 in lanes {lanes:.1f} ns"
    step = "a step of a linear filter"
    rows = [
        ["filterpy 2.0, Kalman filter", step, f"{filterpy.number / 1e3:.1f} µs", in_lanes],
        ["NumPy over 60 runs at once", step, f"{numpy.number / 1e3:.2f} µs", in_lanes],
    ]
    for peer in MEASURED_ONCE:
        cost = peer.cost
        if fossen is not None and peer.name.startswith("Python Vehicle Simulator"):
            cost = f"{fossen:.0f} µs"
        measured = record[peer.beside]
        unit = measured.unit.partition("/")[0]
        rows.append([peer.name, peer.work, cost, f"{_TITLES[peer.beside]} {measured:.1f} {unit}"])
    return markdown(["program", "work", "it takes", "beside, in `make bench`"], rows)


class Cost(NamedTuple):
    """Processor times by which an experiment is estimated."""

    start_s: float  # a command with a report and a log, compiled code at hand
    # a physics step of one vehicle on a route, with what is sensed and judged of it: of missions
    # side by side, and of one alone by MuJoCo
    vehicle_step_us: float
    alone_step_us: float
    # of one vehicle in a formation of a study that navigates under way
    station_step_us: float
    run_step_ns: float  # a filter step of a run of LAISN in lanes
    tight_step_ns: float  # of the tightly coupled navigator
    mission_ms: float  # each mission, however long it is: checks, plans, results

    @classmethod
    def of(cls, record: Findings) -> "Cost":
        """From the record of the benchmarks."""
        formation_s = record["formation: leader + 10: a run of 1000 s, whole, by direct"].number
        # where one of the vehicles is the same in all missions, it is less
        side_by_side = "direct, both vehicles varied"

        def rest_ms(by: str) -> float:
            return record[f"study: T5 by {by}, a mission beside its motion"].number

        def step_us(by: str) -> float:
            # all that grows with the length of a mission counts as its motion
            mission_ms = record[f"study: T5 by {by}, another mission with one run"].number
            return (mission_ms - rest_ms(by)) / (2 * STUDIED_S / _STEP_S) * 1e3

        return cls(
            start_s=record["command: laisn fly T5 --no-video"].number,
            vehicle_step_us=step_us(side_by_side),
            alone_step_us=step_us("mujoco"),
            station_step_us=formation_s / (11 * STUDIED_S / _STEP_S) * 1e6,
            run_step_ns=record["navigation: lanes, LAISN-2 with noise and metrics"].number,
            tight_step_ns=record["tight: tight, 3 transmitters, messages every 1 s"].number,
            mission_ms=rest_ms(side_by_side),
        )

    def motion_s(self, vehicles: int, duration_s: float, *, closed_loop: bool = False) -> float:
        """Processor time of the motion of one of a study's missions; in closed loop with its
        sensing and navigation.
        """
        step_us = self.station_step_us if closed_loop else self.vehicle_step_us
        return duration_s / _STEP_S * vehicles * step_us * 1e-6

    def run_s(self, followers: int, duration_s: float, *, tight: bool = False) -> float:
        """Processor time of a run of noise of a mission whose motion is there."""
        step_ns = self.tight_step_ns if tight else self.run_step_ns
        return duration_s / _FILTER_STEP_S * followers * step_ns * 1e-9


def _time(seconds: float) -> str:
    """A time in words."""
    for limit, per, unit in ((0.1, 1e-3, "ms"), (120.0, 1.0, "s"), (7200.0, 60.0, "min")):
        if seconds < limit:
            value = seconds / per
            return f"{value:.2g} {unit}" if value < 10 else f"{value:.0f} {unit}"
    return f"{seconds / 3600:.1f} h"


def waiting(records: Records) -> str:
    """Experiments with their processor times by the formula of docs/speed.md."""
    cost = Cost.of(records["benchmarks"])
    mission = cost.mission_ms * 1e-3
    t5 = cost.motion_s(2, 1000.0) + mission
    run = cost.run_s(1, 1000.0)
    formation = cost.motion_s(11, 1000.0, closed_loop=True) + mission
    rows = [
        ["one flight of T5 with report and log", _time(cost.start_s)],
        ["T5 in 60,000 runs of noise", _time(cost.start_s + t5 + 60_000 * run)],
        ["1,000 missions like T5, each with 60 runs", _time(1000 * (t5 + 60 * run))],
        [
            "1,000 missions like T5, each with 60 runs of `tight`",
            _time(1000 * (t5 + 60 * cost.run_s(1, 1000.0, tight=True))),
        ],
        ["a million missions like T5, each with one run", _time(1e6 * (t5 + run))],
        ["1,000 runs of a formation of ten in closed loop", _time(1000 * formation)],
        [
            "100 runs of a formation of 200, 1000 s, in closed loop",
            _time(100 * (cost.motion_s(201, 1000.0, closed_loop=True) + mission)),
        ],
    ]
    return markdown(["experiment", "processor time"], rows)


def costs(records: Records) -> str:
    """The symbols of the formula of docs/speed.md, with their values by the record."""
    cost = Cost.of(records["benchmarks"])
    swarm = _finding_or_none(records["benchmarks"], "command: laisn fly swarm --no-video")
    start = f"{cost.start_s:.1f} s"
    if swarm is not None:
        start += f"; of a formation of ten {swarm:.1f} s, which holds its 1000 s of motion"
    rows = [
        ["`start`", "a command with its report and log", start],
        [
            "`m`",
            "each mission, however long it is: checks, plans, results",
            f"{cost.mission_ms:.0f} ms",
        ],
        [
            "`p`",
            "a physics step of one vehicle with what is sensed and judged of it: of a study's "
            "missions side by side; of a mission alone by MuJoCo; of one in a formation that "
            "navigates under way",
            f"{cost.vehicle_step_us:.2f} µs; {cost.alone_step_us:.2f} µs; "
            f"{cost.station_step_us:.2f} µs",
        ],
        [
            "`n`",
            "a filter step of a run: of LAISN; of `tight`",
            f"{cost.run_step_ns:.0f} ns; {cost.tight_step_ns:.0f} ns",
        ],
    ]
    return markdown(["symbol", "of what", "processor time"], rows)
