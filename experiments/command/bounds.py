"""Cramér–Rao bound and range error budget on the terminal and in a file."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console

from experiments.campaign.progress import compiling_shown, print_line, show_table
from experiments.campaign.store import Record, columns_of, write_csv, write_table
from experiments.command.errors import require_output
from experiments.flight.files import flight_of
from experiments.flight.library import load_flyable
from experiments.flight.range_budget import Cause, range_error_budget
from experiments.pages.range_budget_page import TRANSMITTERS, share_table
from sim.flight import Flight

_QUARTERS = 4


def show_bound(source: str, assignments: Iterable[str], runs: int, out: Path | None) -> None:
    """Print the bound of the RMS position error of a mission, and the navigator's error in Monte Carlo runs.

    Raises:
        LaisnError: the scenario or the file's name is invalid.
    """
    from experiments.campaign.bound import geometry_of, least_rms, noise_of
    from experiments.campaign.cells import Cell
    from experiments.campaign.missions import mission_of, motion_of
    from experiments.campaign.montecarlo import simulate

    require_output(out, ".csv")
    scenario = load_flyable(source, assignments)
    console = Console()
    heads = ["follower", *(f"{i + 1}. quarter" for i in range(_QUARTERS)), "whole"]
    heads += [f"{scenario.navigation.variant}, {runs} runs", "× bound", "NEES"] if runs else []
    lines: list[list[str]] = []
    rows: list[dict[str, str | float]] = []
    with compiling_shown():
        mission = mission_of(motion_of(scenario))
        for i, follower in enumerate(scenario.followers):
            trajectory, _ = mission.seen(scenario, i)
            least = least_rms(geometry_of(trajectory, scenario, i), noise_of(scenario, i))
            bounds = [float(np.sqrt(np.mean(part**2))) for part in (*np.array_split(least, _QUARTERS), least)]
            cells = [f"{value:.3f}" for value in bounds]
            if runs:
                result = simulate(Cell.of(scenario, i, runs, mission=mission), threads=None)
                rms = float(np.hypot(result.errors.e_p_mean_m, result.errors.e_p_std_m))
                cells += [f"{rms:.3f}", f"{rms / bounds[-1]:.2f}", f"{result.nees:.3g}"]
            lines.append([follower.name, *cells])
            time = scenario.timing.filter_step_s * np.arange(1, least.size + 1)
            rows += [
                {"follower": follower.name, "time_s": float(t), "bound_m": float(value)}
                for t, value in zip(time, least, strict=True)
            ]
    show_table(console, heads, lines, "least RMS position error [m]")
    if out is not None:
        write_csv(out, rows)
        print_line(console, out)


def records(flight: Flight) -> Iterator[Record]:
    """The error budget of each received ping of a flight, a record each."""
    for i, name in enumerate(flight.trajectory.names[1:]):
        budget = range_error_budget(flight, i)
        for m, t in np.argwhere(np.isfinite(budget.used_range)).tolist():
            yield {
                "follower": name,
                "time_s": float(budget.time[m]),
                "transmitter": TRANSMITTERS[t],
                "level_range_m": float(budget.level_range[m, t]),
                "used_range_m": float(budget.used_range[m, t]),
                **{f"{cause.name.lower()}_m": float(budget.share[m, t, cause]) for cause in Cause},
            }


def show_range_budget(source: str, assignments: Sequence[str], out: Path | None) -> None:
    """Print the error budget of the ranges of a scenario or a log, and write a table with a row for each ping.

    Raises:
        LaisnError: the source or the name of the file is invalid, or overrides were given for a log.
    """
    require_output(out, ".csv", ".parquet")
    flight = flight_of(source, assignments)
    console, heads = Console(), ("cause", *TRANSMITTERS, "front − rear, rms", "largest")
    for i, name in enumerate(flight.trajectory.names[1:]):
        shares = share_table(range_error_budget(flight, i))
        lines = [[cell.text for cell in row] for row in shares.rows]
        show_table(console, heads, lines, f"{name}: rms shares of the range errors [cm]", shares.caption)
    if out is not None:
        rows = list(records(flight))
        if out.suffix == ".csv":
            write_csv(out, rows)
        else:
            write_table(out, columns_of(rows))
        print_line(console, out)
