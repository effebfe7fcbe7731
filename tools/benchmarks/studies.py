"""What studies cost: missions that differ, by each engine, and runs of one mission, by the command
itself.
"""

import tempfile
from pathlib import Path

from tools.benchmarks.commands import LAISN
from tools.benchmarks.row import Goal, Row, time_of_command

MISSIONS = {"mujoco": (8, 72), "direct": (16, 336)}
DIRECT_GOAL = 15.0
"""How many times as many missions of calm water the direct engine is to fly."""
RUNS = (1_000, 101_000)
"""Of the smaller and of the larger study: their difference is free of what each study costs."""
_STUDY = """name = "speed"
scenario = "T5"
runs = {runs}
realizations = {missions}

[draw]
"followers.0.drag_scale" = {{ uniform = [0.8, 1.2] }}
"""


def _seconds(folder: Path, name: str, runs: int, missions: int, engine: str = "mujoco") -> float:
    """Processor time of a study in one process [s]."""
    path = folder / f"{name}.toml"
    path.write_text(_STUDY.format(runs=runs, missions=missions), encoding="utf-8")
    options = ("--workers", "1", "--engine", engine, "--out", str(folder / name))
    return time_of_command((*LAISN, "study", str(path), *options)).processor_s


def studies() -> list[Row]:
    """A mission of T5 whose coefficients are drawn, with one run, and a further run of it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        mission = {}
        for engine, (fewest, most) in MISSIONS.items():
            # what is missing of compiled code
            _seconds(folder, f"first {engine}", 1, 2, engine)
            few = _seconds(folder, f"{engine} {fewest}", 1, fewest, engine)
            long_s = _seconds(folder, f"{engine} {most}", 1, most, engine)
            mission[engine] = (long_s - few) / (most - fewest)
        short_s, long_run_s = (_seconds(folder, f"runs {n}", n, 1) for n in RUNS)
    run = (long_run_s - short_s) / (RUNS[1] - RUNS[0])
    ratio = mission["mujoco"] / mission["direct"]
    return [
        *(
            Row(f"T5 by {engine}, another mission with one run", seconds * 1e3, "ms")
            for engine, seconds in mission.items()
        ),
        Row(
            "T5, missions by direct over mujoco", ratio, "x", goal=Goal(DIRECT_GOAL, at_least=True)
        ),
        Row("T5, another run of the same mission", run * 1e6, "µs"),
    ]
