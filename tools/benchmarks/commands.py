"""What a user waits for: whole commands, with compiled code at hand and on a fresh installation."""

import tempfile
from pathlib import Path
from typing import NamedTuple

from tools.benchmarks.row import Goal, Row, least_time_of_command, time_of_command

LAISN = ("-m", "laisn_sim.cli.main")
FLIGHT_GOALS_S = {"T5": 2.4, "swarm": 5.0}
"""Processor time of a flight without its film, compiled code at hand [s]."""
COLD_GOALS_S = {"T5": 14.0, "swarm": 55.0}
"""Processor time of compiling for the same flights [s]."""
OTHERS = {"laisn check T5": ("check", "T5"), "laisn --help": ("--help",)}
"""Commands without a goal: name of the row, and arguments."""
_REPEATS = 2
"""How often a command is timed, after one run that does not count."""
# flies, and writes how many functions were compiled for that
_FLIGHT_THAT_COUNTS = """
import sys
from laisn.compiled import count_compiled
from laisn_sim.cli.main import main

count_before = count_compiled()
sys.argv = ["laisn", *sys.argv[2:]]
try:
    main()
except SystemExit as ended:
    code = ended.code
else:
    code = 0
with open({count!r}, "w") as file:
    file.write(str(count_compiled() - count_before))
sys.exit(code)
"""


def commands() -> list[Row]:
    """Commands from their start to their end, with compiled code at hand: processor time on all
    cores, and wall clock.
    """
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for scenario, goal in FLIGHT_GOALS_S.items():
            call = (*LAISN, "fly", scenario, "--no-video", "--out", f"{folder}/{scenario}")
            times = least_time_of_command(call, _REPEATS)
            name = f"laisn fly {scenario} --no-video"
            rows += [
                Row(name, times.processor_s, "s", goal=Goal(goal)),
                Row(f"{name}, by the clock", times.wall_s, "s"),
            ]
        for name, arguments in OTHERS.items():
            times = least_time_of_command((*LAISN, *arguments), _REPEATS)
            rows.append(Row(name, times.processor_s, "s"))
    return rows


class _Compiling(NamedTuple):
    """What the first flight of a scenario compiled with a cache."""

    functions: int
    processor_s: float  # more than the same flight with compiled code at hand
    wall_s: float  # of the flight as a whole


def _compiling(scenario: str, cache: Path) -> _Compiling:
    with tempfile.TemporaryDirectory() as folder:
        environment = {"XDG_CACHE_HOME": str(cache)}
        count = Path(folder) / "count"
        flight = ("fly", scenario, "--no-video", "--out", f"{folder}/flight")
        program = ("-c", _FLIGHT_THAT_COUNTS.format(count=str(count)), "laisn", *flight)
        first = time_of_command(program, environment)
        functions = int(count.read_text())
        warm = time_of_command((*LAISN, *flight), environment)
    return _Compiling(functions, first.processor_s - warm.processor_s, first.wall_s)


def cold() -> list[Row]:
    """The first flight after an installation, with an empty cache: how many functions it compiles,
    and how much more processor time it takes than the same flight with compiled code at hand. Then
    the same of one after that of another scenario.
    """
    rows = []
    # bytecode is there, whether other rows were measured or not
    time_of_command(("-c", "import laisn_sim.cli.fly, reports.flight_report"))
    first, second = COLD_GOALS_S
    with tempfile.TemporaryDirectory() as folder:
        for scenario, goal in COLD_GOALS_S.items():
            compiling = _compiling(scenario, Path(folder) / scenario)
            name = f"{scenario}: first flight of an installation"
            rows += [
                Row(f"{name}, compiled functions", compiling.functions, ""),
                Row(f"{name}, compiling", compiling.processor_s, "s", goal=Goal(goal)),
                Row(f"{name}, whole, by the clock", compiling.wall_s, "s"),
            ]
        compiling = _compiling(second, Path(folder) / first)
        name = f"{second}: first flight after {first}"
        rows += [
            Row(f"{name}, compiled functions", compiling.functions, ""),
            Row(f"{name}, compiling", compiling.processor_s, "s"),
        ]
    return rows
