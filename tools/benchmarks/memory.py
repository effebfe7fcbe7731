"""Most memory that a command and its child processes take together: a long mission, and many
runs on two workers.
"""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from tools.benchmarks.row import Row

HOURS = (3, 6)
"""Lengths of two missions. Both are so long that the command keeps their arrays in files, so that
their memory grows alike with their length.
"""
RUNS = 100_000
POINTS = 4  # values that the study varies
WORKERS = 2
LEG_S = 1800  # of the routes
SAMPLE_S = 0.1  # between two readings of the memory


def _processes(first: int) -> list[int]:
    """A process and all that descend from it."""
    children = defaultdict(list)
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                children[int(fields[1])].append(int(entry.name))
    processes = [first]
    for process in processes:
        processes += children[process]
    return processes


def _memory(process: int) -> float:
    """Proportional set size [MB]: pages that processes share count once over all of them."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return float(line.split()[1]) * 1.024e-3
    return 0.0


def peak_of(*arguments: str) -> float:
    """Most memory of `laisn` with these arguments and of its children together [MB]."""
    peak = 0.0
    command = [sys.executable, "-m", "laisn_sim.cli.main", *arguments]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as running:
        while running.poll() is None:
            peak = max(peak, sum(map(_memory, _processes(running.pid))))
            time.sleep(SAMPLE_S)
    if running.returncode:
        raise subprocess.CalledProcessError(running.returncode, command)
    return peak


def mission_of(hours: float) -> str:
    """Scenario of a leader and a follower 30 m south of it that weave towards east, at 1 m/s of
    easting."""
    # time [s], east and north [m]
    legs = range(round(hours * 3600 / LEG_S) + 1)
    leader = [[k * LEG_S, k * LEG_S, 600.0 * (k % 4 // 2)] for k in legs]
    follower = [[t, east, north - 30.0] for t, east, north in leader]
    return (
        f"duration_s = {hours * 3600:g}\n[leader]\nwaypoints = {leader}\n"
        f"[[followers]]\nwaypoints = {follower}\ndepth_m = 12.0\n"
    )


STUDY = f"""name = "memory"
scenario = "T5"
runs = {RUNS}

[vary]
"sensors.heading_bias_deg" = {list(range(POINTS))}
"""


def memory() -> list[Row]:
    """Memory of missions by their length, and of a study; nothing where there is no /proc."""
    if not os.path.exists("/proc/self/smaps_rollup"):
        return []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        peaks = []
        (work / "study.toml").write_text(STUDY)
        # of the same code, once, so that nothing is compiled below
        peak_of("fly", "T5", "--no-video", "--out", str(work / "first"))
        for hours in HOURS:
            (work / f"{hours}.toml").write_text(mission_of(hours))
            out = str(work / f"{hours} h")
            peaks.append(peak_of("fly", str(work / f"{hours}.toml"), "--no-video", "--out", out))
        command = ("study", str(work / "study.toml"), "--workers", str(WORKERS))
        # the first one compiles
        study = [peak_of(*command, "--out", str(work / name)) for name in ("study", "again")][1]
    growth = (peaks[1] - peaks[0]) / (HOURS[1] - HOURS[0])
    return [
        Row(f"laisn fly, a mission of {HOURS[0]} h", peaks[0], "MB"),
        Row("laisn fly, each further hour", growth, "MB"),
        Row(f"laisn study, {POINTS} points of {RUNS} runs on {WORKERS} workers", study, "MB"),
    ]
