"""What studies cost: missions that differ, and runs of one mission, by the command itself."""

import tempfile
from pathlib import Path

from tools.benchmarks.commands import LAISN
from tools.benchmarks.row import Row, time_of_command

MISSIONS = (8, 72)
RUNS = (1_000, 101_000)
"""Of the smaller and of the larger study: their difference is free of what each study costs."""
_STUDY = """name = "speed"
scenario = "T5"
runs = {runs}
realizations = {missions}

[draw]
"followers.0.drag_scale" = {{ uniform = [0.8, 1.2] }}
"""


def _seconds(folder: Path, name: str, runs: int, missions: int) -> float:
    """Processor time of a study in one process [s]."""
    path = folder / f"{name}.toml"
    path.write_text(_STUDY.format(runs=runs, missions=missions), encoding="utf-8")
    call = (*LAISN, "study", str(path), "--workers", "1", "--out", str(folder / name))
    return time_of_command(call).processor_s


def studies() -> list[Row]:
    """A mission of T5 whose coefficients are drawn, with one run, and a further run of it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _seconds(folder, "first", 1, 2)
        few, many = (_seconds(folder, f"missions {n}", 1, n) for n in MISSIONS)
        short, long = (_seconds(folder, f"runs {n}", n, 1) for n in RUNS)
    mission = (many - few) / (MISSIONS[1] - MISSIONS[0])
    run = (long - short) / (RUNS[1] - RUNS[0])
    return [
        Row("T5, another mission with one run", mission * 1e3, "ms"),
        Row("T5, missions a second of one core", 1.0 / mission, "1/s"),
        Row("T5, another run of the same mission", run * 1e6, "µs"),
        Row(f"T5, {MISSIONS[0]} missions with one run, whole", few, "s"),
    ]
