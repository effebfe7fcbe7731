"""The Cramér–Rao bound of a mission on the terminal and in a file, beside a navigator's errors."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from experiments.campaign.progress import literal, tell
from laisn.failure import LaisnError

_QUARTERS = 4


def show_bound(source: str, assignments: Iterable[str], runs: int, out: Path | None) -> None:
    """Print the bound of the RMS position error of a mission, and the navigator's error beside it.

    Args:
        source: scenario name or TOML file.
        assignments: overrides.
        runs: Monte Carlo runs of the scenario's navigator; 0: none.
        out: `.csv` file for the bound over time; None: none.

    Raises:
        LaisnError: the scenario or the file's name is invalid.
    """
    from experiments.campaign.bound import geometry_of, least_rms, noise_of
    from experiments.campaign.cells import Cell
    from experiments.campaign.missions import mission_of, motion_of
    from experiments.campaign.montecarlo import simulate
    from experiments.campaign.progress import compiling_shown
    from experiments.campaign.store import write_csv
    from experiments.flight.library import load_flyable
    from sim.sensing.hearing import Hearing

    if out is not None and out.suffix != ".csv":
        raise LaisnError(f"--out {out}: should end in .csv")
    scenario = load_flyable(source, assignments)
    console = Console()
    heads = ["follower", *(f"{i + 1}. quarter" for i in range(_QUARTERS)), "whole"]
    heads += [f"{scenario.navigation.variant}, {runs} runs", "× bound", "NEES"] if runs else []
    table = Table(*heads, box=None, pad_edge=False, title="least RMS position error [m]", title_justify="left")
    rows: list[dict[str, str | float]] = []
    with compiling_shown():
        mission = mission_of(motion_of(scenario))
        for i, follower in enumerate(scenario.followers):
            trajectory, _ = mission.seen(scenario, i)
            least = least_rms(geometry_of(trajectory, Hearing.of(scenario, i), i), noise_of(scenario, i))
            whole = float(np.sqrt(np.mean(least**2)))
            parts = [float(np.sqrt(np.mean(part**2))) for part in np.array_split(least, _QUARTERS)]
            cells = [f"{value:.3f}" for value in (*parts, whole)]
            if runs:
                result = simulate(Cell.of(scenario, i, runs, mission=mission), threads=None)
                rms = float(np.hypot(result.errors.e_p_mean_m, result.errors.e_p_std_m))
                cells += [f"{rms:.3f}", f"{rms / whole:.2f}", f"{result.nees:.3g}"]
            table.add_row(literal(follower.name), *cells)
            time = scenario.timing.filter_step_s * np.arange(1, least.size + 1)
            rows += [
                {"follower": follower.name, "time_s": float(t), "bound_m": float(value)}
                for t, value in zip(time, least, strict=True)
            ]
    console.print(table)
    if out is not None:
        write_csv(out, rows)
        tell(console, out)
