"""The error budget of a flight's ranges, on the terminal and as a table in a file."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Column, Table

from experiments.campaign.progress import literal, tell
from experiments.campaign.store import Record, columns_of, write_csv, write_table
from experiments.flight.range_budget import Cause, range_error_budget
from experiments.flight.source import flight_of
from experiments.pages.range_budget_page import TRANSMITTERS, share_table
from laisn.failure import LaisnError
from sim.flight import Flight


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


def _print_shares(console: Console, flight: Flight) -> None:
    for i, name in enumerate(flight.trajectory.names[1:]):
        shares = share_table(range_error_budget(flight, i))
        heads = ("cause", *TRANSMITTERS, "front − rear, rms", "largest")
        columns = (Column(head, justify="right" if n else "left") for n, head in enumerate(heads))
        title = literal(f"{name}: rms shares of the range errors [cm]")
        table = Table(*columns, title=title, title_justify="left", box=None)
        for row in shares.rows:
            table.add_row(*(literal(cell.text) for cell in row))
        table.caption, table.caption_justify = literal(shares.caption), "left"
        console.print(table)


def show_range_budget(source: str, assignments: Sequence[str], out: Path | None) -> None:
    """Print the error budget of the ranges of a scenario or a log, and write it if asked to.

    Args:
        source: scenario name, TOML file or `.mcap` log.
        assignments: overrides of a scenario.
        out: `.csv` or `.parquet` file with a row for each ping received; None: none.

    Raises:
        LaisnError: the source or the name of the file is invalid, or overrides were given for a log.
    """
    if out is not None and out.suffix not in {".csv", ".parquet"}:
        raise LaisnError(f"--out {out}: should end in .csv or .parquet")
    flight = flight_of(source, assignments)
    console = Console()
    _print_shares(console, flight)
    if out is not None:
        rows = list(records(flight))
        if out.suffix == ".csv":
            write_csv(out, rows)
        else:
            write_table(out, columns_of(rows))
        tell(console, out)
