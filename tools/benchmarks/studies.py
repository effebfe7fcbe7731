"""What studies cost: missions that differ, by each engine, and runs of one mission, by the command
itself.
"""

import tempfile
from pathlib import Path
from typing import NamedTuple

from tools.benchmarks.commands import LAISN
from tools.benchmarks.row import Goal, Row, time_of_command

MISSIONS = {"mujoco": (8, 72), "direct": (16, 144)}
DIRECT_GOAL = 15.0
"""How many times as many missions of calm water the direct engine is to fly."""
RUNS = (1_000, 41_000)
"""Of the smaller and of the larger study: their difference is free of what each study costs."""
WHOLE_S = 1000.0
SHORT_S = 250.0
"""Lengths of missions, whose times differ by that of the motion [s]."""
_STUDY = """name = "speed"
scenario = "T5"
runs = {runs}
realizations = {missions}

[set]
duration_s = {duration_s}

[draw]
"followers.0.drag_scale" = {{ uniform = [0.8, 1.2] }}
"""


class _Studies(NamedTuple):
    """Studies in one process each, whose files and results are in a folder."""

    folder: Path

    def seconds(
        self, runs: int, missions: int, engine: str = "mujoco", duration_s: float = WHOLE_S
    ) -> float:
        """Processor time of a study that was not computed before [s]."""
        number = sum(1 for _ in self.folder.glob("*.toml"))
        path = self.folder / f"study-{number}.toml"
        text = _STUDY.format(runs=runs, missions=missions, duration_s=duration_s)
        path.write_text(text, encoding="utf-8")
        results = self.folder / path.stem
        options = ("--workers", "1", "--engine", engine, "--out", str(results))
        return time_of_command((*LAISN, "study", str(path), *options)).processor_s

    def mission_s(self, engine: str, duration_s: float = WHOLE_S) -> float:
        """Processor time of a further mission with one run [s]."""
        fewest, most = MISSIONS[engine]
        few_s = self.seconds(1, fewest, engine, duration_s)
        many_s = self.seconds(1, most, engine, duration_s)
        return (many_s - few_s) / (most - fewest)


def studies() -> list[Row]:
    """A mission of T5 whose coefficients are drawn, with one run, and a further run of it."""
    with tempfile.TemporaryDirectory() as name:
        timed = _Studies(Path(name))
        mission_s = {}
        for engine in MISSIONS:
            # what is missing of compiled code
            timed.seconds(1, 2, engine)
            mission_s[engine] = timed.mission_s(engine)
        short_s = timed.mission_s("mujoco", SHORT_S)
        few_runs_s, many_runs_s = (timed.seconds(runs, 1) for runs in RUNS)
    run_s = (many_runs_s - few_runs_s) / (RUNS[1] - RUNS[0])
    # the time of the motion is in proportion to its length
    share = SHORT_S / WHOLE_S
    beside_s = (short_s - share * mission_s["mujoco"]) / (1.0 - share)
    ratio = mission_s["mujoco"] / mission_s["direct"]
    return [
        *(
            Row(f"T5 by {engine}, another mission with one run", seconds * 1e3, "ms")
            for engine, seconds in mission_s.items()
        ),
        Row("T5 by mujoco, a mission beside its motion", beside_s * 1e3, "ms"),
        Row(
            "T5, missions by direct over mujoco", ratio, "x", goal=Goal(DIRECT_GOAL, at_least=True)
        ),
        Row("T5, another run of the same mission", run_s * 1e6, "µs"),
    ]
