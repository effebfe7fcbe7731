"""What studies cost: missions that differ, by each engine, and runs of one mission, by the command
itself.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tools.benchmarks.commands import LAISN
from tools.benchmarks.row import Goal, Row, time_of_command

MISSIONS = {"mujoco": (8, 72), "direct": (16, 144)}
"""Missions of the smaller and of the larger study, by engine: their difference is free of what each
study costs.
"""
DIRECT_GOAL = 15.0
"""How many times as many missions of calm water as MuJoCo the direct engine is to fly."""
WAVES_GOAL = 4.0
"""The same in a JONSWAP sea."""
MISSION_GOAL_MS = 18.0
"""Processor time with which two cores fly a million missions in two and a half hours [ms]."""
RUNS = (1_000, 41_000)
"""Runs of the smaller and of the larger study, for the same reason."""
WHOLE_S = 1000.0
SHORT_S = 250.0
"""Lengths of missions, whose times differ by that of the motion [s]."""
CALM = "none"
_STUDY = """name = "speed"
scenario = "T5"
runs = {runs}
realizations = {missions}

[set]
duration_s = {duration_s}
"ocean.waves.kind" = "{waves}"

[draw]
{draws}"""
FOLLOWER = ("followers.0",)
BOTH = ("followers.0", "leader")
"""Vehicles whose drag is drawn: with that of the follower alone, all missions have one leader."""


class _Studies(NamedTuple):
    """Studies in one process each, whose files and results are in a folder."""

    folder: Path

    def seconds(
        self,
        runs: int,
        missions: int,
        engine: str,
        duration_s: float = WHOLE_S,
        waves: str = CALM,
        varied: Sequence[str] = FOLLOWER,
    ) -> float:
        """Processor time of a study that was not computed before [s]."""
        number = sum(1 for _ in self.folder.glob("*.toml"))
        path = self.folder / f"study-{number}.toml"
        text = _STUDY.format(
            runs=runs,
            missions=missions,
            duration_s=duration_s,
            waves=waves,
            draws="".join(
                f'"{vehicle}.drag_scale" = {{ uniform = [0.8, 1.2] }}\n' for vehicle in varied
            ),
        )
        path.write_text(text, encoding="utf-8")
        results = self.folder / path.stem
        options = ("--workers", "1", "--engine", engine, "--out", str(results))
        return time_of_command((*LAISN, "study", str(path), *options)).processor_s

    def mission_s(
        self,
        engine: str,
        duration_s: float = WHOLE_S,
        waves: str = CALM,
        varied: Sequence[str] = FOLLOWER,
    ) -> float:
        """Processor time of a further mission with one run [s]."""
        fewest, most = MISSIONS[engine]
        few_s = self.seconds(1, fewest, engine, duration_s, waves, varied)
        many_s = self.seconds(1, most, engine, duration_s, waves, varied)
        return (many_s - few_s) / (most - fewest)


def studies() -> list[Row]:
    """A mission of T5 whose coefficients are drawn, with one run, in calm water and in waves, and a
    further run of it.
    """
    with tempfile.TemporaryDirectory() as name:
        timed = _Studies(Path(name))
        calm_s = dict[str, float]()
        short_s = dict[str, float]()
        wavy_s = dict[str, float]()
        for engine in MISSIONS:
            # what is missing of compiled code
            timed.seconds(1, 3, engine)
            timed.seconds(1, 3, engine, SHORT_S, "jonswap")
            calm_s[engine] = timed.mission_s(engine)
            short_s[engine] = timed.mission_s(engine, SHORT_S)
            wavy_s[engine] = timed.mission_s(engine, waves="jonswap")
        both_s = timed.mission_s("direct", varied=BOTH)
        both_short_s = timed.mission_s("direct", SHORT_S, varied=BOTH)
        few_runs_s, many_runs_s = (timed.seconds(runs, 1, "direct") for runs in RUNS)
    run_s = (many_runs_s - few_runs_s) / (RUNS[1] - RUNS[0])
    # a mission takes its motion, in proportion to its length, and a rest, which is the same of both
    # lengths: short_s = share * (calm_s - rest_s) + rest_s
    share = SHORT_S / WHOLE_S
    rows = list[Row]()
    for engine in MISSIONS:
        rest_s = (short_s[engine] - share * calm_s[engine]) / (1.0 - share)
        goal = Goal(MISSION_GOAL_MS) if engine == "direct" else None
        rows += [
            Row(
                f"T5 by {engine}, another mission with one run",
                calm_s[engine] * 1e3,
                "ms",
                goal=goal,
            ),
            Row(f"T5 by {engine}, a mission beside its motion", rest_s * 1e3, "ms"),
            Row(
                f"T5 in JONSWAP waves by {engine}, another mission with one run",
                wavy_s[engine] * 1e3,
                "ms",
            ),
        ]
    return [
        *rows,
        Row("T5 by direct, both vehicles varied, another mission with one run", both_s * 1e3, "ms"),
        Row(
            "T5 by direct, both vehicles varied, a mission beside its motion",
            (both_short_s - share * both_s) / (1.0 - share) * 1e3,
            "ms",
        ),
        Row(
            "T5, missions by direct over mujoco",
            calm_s["mujoco"] / calm_s["direct"],
            "x",
            goal=Goal(DIRECT_GOAL, at_least=True),
        ),
        Row(
            "T5 in JONSWAP waves, missions by direct over mujoco",
            wavy_s["mujoco"] / wavy_s["direct"],
            "x",
            goal=Goal(WAVES_GOAL, at_least=True),
        ),
        Row("T5, another run of the same mission", run_s * 1e6, "µs"),
    ]
