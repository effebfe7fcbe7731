"""The page of a flight's log, opened in the browser."""

import os
import sys
import webbrowser
from pathlib import Path

from laisn_sim.cli.outputs import OutputFile, output_file
from reports.flight_report import flight_report
from reports.summary import flight_bounds, summarise
from sim.flight import position_and_bearing_errors
from sim.log.reader import read


def write_page(log: Path, out: Path | None) -> OutputFile:
    """Write the report of a log's flight; LaisnError if the log cannot be read, or there is no such
    page to write.
    """
    page = output_file(out or Path("out") / "view" / f"{log.stem}.html", [".html"], [log])
    flight = read(log)
    bounds = flight_bounds(flight)
    errors = position_and_bearing_errors(flight)
    flight_report(flight, errors, summarise(flight, bounds), page.path, None, bounds)
    return page


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
