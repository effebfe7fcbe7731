"""Flights with figures and report, as Python's users get them from `laisn_sim`."""

from collections.abc import Callable
from functools import wraps
from html import escape
from pathlib import Path
from typing import Any, ParamSpec

from experiments.flight.files import fly_mission
from experiments.flight.fly import navigate_again
from experiments.flight.summary import flight_bounds, position_and_bearing_errors, summarise
from experiments.pages import flight_figures
from experiments.pages.figures import plotly
from laisn.failure import LaisnError
from sim import flight as simulated
from sim.log.reader import read

_Given = ParamSpec("_Given")
PLOTS = ("errors", "routes", "motion")


class Flight(simulated.Flight):
    """A flight that can be drawn and reported; in a notebook it shows a row of errors for each follower."""

    def plot(self, what: str = "errors", follower: int = 0) -> Any:
        """A figure of the flight, interactive in a notebook.

        Args:
            what: "errors", bearing, ranges and fixes of a follower over time; "routes", with estimates; "motion":
                depth, pitch and speed of all vehicles.
            follower: index of the follower; of routes, those of all are drawn.

        Returns:
            A `plotly.graph_objects.Figure`.

        Raises:
            LaisnError: there is no such figure or follower.
        """
        number = len(self.estimates)
        if what not in PLOTS:
            raise LaisnError(f"plot {what!r}: expected one of {', '.join(PLOTS)}")
        if not 0 <= follower < number:
            raise LaisnError(f"follower {follower}: expected 0 … {number - 1}")
        if what == "routes":
            return plotly(flight_figures.track_map(self, range(number), width=7.0))
        if what == "motion":
            return plotly(flight_figures.motion(self))
        errors, bounds = position_and_bearing_errors(self), flight_bounds(self)
        return plotly(flight_figures.over_time(self, follower, errors[follower], bounds[follower]))

    def report(self, path: str | Path | None = None) -> Path:
        """Write the report of the flight, one HTML page.

        Args:
            path: of the page; None: NAME.html in the working directory.

        Returns:
            The path of the page.

        Raises:
            OSError: the file cannot be written.
        """
        # templates and tables, which a figure does not need
        from experiments.pages.flight_report import flight_report

        file = Path(f"{self.scenario.name}.html" if path is None else path)
        errors, bounds = position_and_bearing_errors(self), flight_bounds(self)
        flight_report(self, errors, summarise(self, errors, bounds), file, None, bounds)
        return file

    def _repr_html_(self) -> str:
        rows = []
        for name, (error, _) in zip(self.trajectory.names[1:], position_and_bearing_errors(self), strict=True):
            found = (f"{error.mean():.2f} m", f"{error.max():.2f} m") if error.size else ("–", "–")
            rows.append("".join(f"<td>{cell}</td>" for cell in (escape(name), *found)))
        heads = "<th>follower</th><th>mean E_P</th><th>largest E_P</th>"
        body, about = "".join(f"<tr>{row}</tr>" for row in rows), escape(f"{self!r}"[1:-1])
        return f"<table><caption>{about}</caption><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"


def _with_report(make: Callable[_Given, simulated.Flight]) -> Callable[_Given, Flight]:
    """The same function, whose flight can be drawn and reported."""

    @wraps(make)
    def made(*given: _Given.args, **named: _Given.kwargs) -> Flight:
        return Flight(**vars(make(*given, **named)))

    return made


fly = _with_report(fly_mission)
navigate = _with_report(navigate_again)
read_log = _with_report(read)
