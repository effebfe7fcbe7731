"""The page of a flight's log, opened in the browser."""

import os
import sys
import webbrowser
from pathlib import Path
from typing import Annotated, Literal

import typer

from laisn_sim.cli.errors import echo
from laisn_sim.cli.outputs import OutputFile, output_file, written_files


def write_page(log: Path, out: Path | None) -> OutputFile:
    """Write the report of a log's flight; LaisnError if the log cannot be read, or there is no such
    page to write.
    """
    from experiments.flight.folder import title_of
    from reports.bound import flight_bounds
    from reports.flight_report import flight_report
    from reports.summary import summarise
    from sim.flight import position_and_bearing_errors
    from sim.log.reader import read

    page = output_file(out or Path("out") / "view" / f"{title_of(log)}.html", [".html"], [log])
    flight = read(log)
    bounds = flight_bounds(flight)
    errors = position_and_bearing_errors(flight)
    flight_report(flight, errors, summarise(flight, bounds), page.path, None, bounds)
    return page


def figure(
    page: Annotated[
        Path, typer.Argument(metavar="PAGE", help="a page of laisn, or a folder with report.html")
    ],
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="figures, such as map errors; none: list them"),
    ] = None,
    format_: Annotated[
        Literal["pdf", "svg", "png"], typer.Option("--format", help="pdf, svg or png")
    ] = "pdf",
    width: Annotated[
        float, typer.Option(min=1.0, max=40.0, help="[inch]; a column of a paper has 3.5")
    ] = 7.0,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="default: out/figures/PAGE")
    ] = None,
) -> None:
    """Write figures of a page as vector graphics, with the labels of its axes, for a paper."""
    from rich.console import Console

    from experiments.campaign.progress import show_table
    from experiments.flight.folder import title_of
    from reports import vector

    figures = vector.figures_of(page)
    if not names:
        rows = [(figure.name, figure.labels) for figure in figures]
        show_table(Console(), ("figure", "axes"), rows, numbers=False)
        return
    selection = vector.chosen(figures, names)
    name = page.resolve().name if page.is_dir() else title_of(page)
    folder = out or Path("out") / "figures" / name
    existing = [*folder.glob("*")] if folder.is_dir() else []
    for file in written_files(vector.write_figures(selection, folder, format_, width), existing):
        echo(file)


def open_page(page: Path) -> None:
    """Open a page where there is a screen."""
    open_address(page.resolve().as_uri())


def open_address(address: str) -> None:
    """Open an address where there is a screen; a browser of a terminal shows no 3D."""
    has_screen = sys.platform in ("darwin", "win32") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    if has_screen:
        webbrowser.open(address)
