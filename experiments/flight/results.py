"""Flights from a scenario or a log, with figures, report, film and log, as Python's users get
them from `laisn_sim`.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import wraps
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, cast, get_args

import numpy as np
from pydantic import ValidationError

from experiments.campaign.progress import compiling_shown
from experiments.flight import fly as flying
from experiments.flight.folder import log_in
from experiments.flight.library import as_scenario, load_scenario, scenario_names
from laisn.errors import LaisnError
from laisn.navigators import NavigatorFactory
from laisn.plugins import register, require_factory, takes_readings
from reports import flight_figures
from reports.bound import flight_bounds
from reports.figures import Panel, plotly
from reports.summary import flight_events, summarise
from sim import flight as simulated
from sim.feasibility import film_errors
from sim.flight import position_and_bearing_errors
from sim.log import reader, writer
from sim.scenario.file import lines_of
from sim.scenario.settings import Scenario, Video
from sim.simulation import ControllerFactory

if TYPE_CHECKING:
    from sim.film.cameras import OwnCamera

_Given = ParamSpec("_Given")
PLOTS = ("errors", "routes", "motion")


def flight_of(
    source: str,
    assignments: Iterable[str] = (),
    check: Callable[[Scenario], None] = lambda _: None,
) -> simulated.FlightRecord:
    """Fly a scenario (name or TOML file) with overrides "key=value", or read the log of a flight
    (`.mcap`, or its folder). A scenario is flown if `check` raises no error.
    """
    path = Path(source) if source in scenario_names() else log_in(Path(source))
    if path.suffix != ".mcap":
        scenario = load_scenario(source, assignments, flyable=True)
        check(scenario)
        with compiling_shown():
            return flying.fly(scenario)[0]
    if list(assignments):
        raise LaisnError(f"{path}: --set changes a scenario; a log is of a finished flight")
    return reader.read(path)


class Flight(simulated.FlightRecord):
    """A flight that can be drawn and reported; in a notebook it shows a row of errors for each
    follower.
    """

    def plot(self, plot: str = "errors", follower: int = 0) -> Any:
        """A `plotly.graph_objects.Figure`: "errors", bearing, ranges and fixes of a follower over
        time; "routes" of all vehicles with estimates; "motion", depth, pitch and speed of all.
        LaisnError if there is no such figure or follower.
        """
        return plotly(self._panel(plot, follower))

    def draw(
        self, path: str | Path, plot: str = "errors", follower: int = 0, width: float = 7.0
    ) -> Path:
        """Write a figure of `plot` for a paper, as .pdf, .svg or .png, of a width [inch]; its path.
        LaisnError if there is no such figure, follower or format; OSError if writing fails.
        """
        # matplotlib takes long to load
        from reports.vector import write_panel

        file = Path(path)
        write_panel(self._panel(plot, follower), file, width)
        return file

    def _panel(self, plot: str, follower: int) -> Panel:
        number = len(self.estimates)
        if plot not in PLOTS:
            raise LaisnError(f"plot {plot!r}: expected one of {', '.join(PLOTS)}")
        if not 0 <= follower < number:
            raise LaisnError(f"follower {follower}: expected 0 … {number - 1}")
        if plot == "routes":
            return flight_figures.track_map(self, range(number), width=7.0)
        if plot == "motion":
            return flight_figures.motion(self)
        errors = position_and_bearing_errors(self)
        bounds = flight_bounds(self)
        return flight_figures.over_time(self, follower, errors[follower], bounds[follower])

    def report(self, path: str | Path | None = None) -> Path:
        """Write the report of the flight, one HTML page, by default NAME.html; its path. OSError
        if that fails.
        """
        # templates and tables, which a figure does not need
        from reports.flight_report import flight_report

        file = Path(f"{self.scenario.name}.html" if path is None else path)
        errors = position_and_bearing_errors(self)
        bounds = flight_bounds(self)
        flight_report(self, errors, summarise(self, bounds), file, None, bounds)
        return file

    def _repr_html_(self) -> str:
        body = ""
        for name, (error, _) in zip(
            self.trajectory.names[1:], position_and_bearing_errors(self), strict=True
        ):
            texts = (f"{error.mean():.2f} m", f"{error.max():.2f} m") if error.size else ("–", "–")
            body += f"<tr>{''.join(f'<td>{cell}</td>' for cell in (escape(name), *texts))}</tr>"
        heads = "<th>follower</th><th>mean E_P</th><th>largest E_P</th>"
        summary = escape(f"{self!r}"[1:-1])
        return (
            f"<table><caption>{summary}</caption><thead><tr>{heads}</tr></thead>"
            f"<tbody>{body}</tbody></table>"
        )


def _with_report(make: Callable[_Given, simulated.FlightRecord]) -> Callable[_Given, Flight]:
    @wraps(make)
    def with_report(*arguments: _Given.args, **keywords: _Given.kwargs) -> Flight:
        return Flight(**vars(make(*arguments, **keywords)))

    return with_report


navigate = _with_report(flying.navigate_again)


@_with_report
def read_log(path: Path | str) -> simulated.FlightRecord:
    """The flight of a log, or of a flight's folder, which has one; errors as of
    `sim.log.reader.read`, and LaisnError if the folder has none.
    """
    return reader.read(log_in(Path(path)))


@_with_report
def fly(
    source: str | Path | Mapping[str, Any] | Scenario,
    changes: Mapping[str, Any] | None = None,
    *,
    navigator: type | NavigatorFactory | None = None,
    controller: type | ControllerFactory | None = None,
) -> simulated.FlightRecord:
    """Fly a mission: its vehicles move, sense and navigate. Source, changes and errors as of
    `load_scenario`.

    The same scenario gives the same flight, to the bit; {"run": 7} among the changes selects the
    noise of run 7.

    `navigator` is a class of the followers' navigators, or a function of settings and start that
    makes one; `controller` a class with `control(readings, belief, dt)`, or what makes a controller
    of all vehicles from the plant and the control of routes. None: those of the scenario. See
    docs/extending.md.
    """
    scenario = as_scenario(source, changes)
    for argument, factory in (("navigator", navigator), ("controller", controller)):
        if factory is not None:
            require_factory(argument, factory)
    settings: dict[str, Any] = (
        {} if navigator is None else {"navigation.variant": register(navigator)}
    )
    if takes_readings(controller):
        settings |= {
            f"followers.{i}.controller": register(controller)
            for i in range(len(scenario.followers))
        }
        controller = None
    return flying.fly(
        as_scenario(scenario, settings) if settings else scenario, make_controller=controller
    )[0]


def camera_of(text: str, names: Sequence[str]) -> "OwnCamera":
    """A camera in words: "E,N,U,E,N,U", where it stands and what it looks at in the world [m], or
    "VEHICLE:E,N,U", where it stands from a vehicle that it looks at. LaisnError if it is none.
    """
    from sim.film.cameras import OwnCamera

    vehicle, colon, offsets = text.rpartition(":")
    try:
        values = [float(number) for number in offsets.split(",")]
        if vehicle not in (*names, "") or len(values) != (3 if colon else 6):
            raise ValueError(text)
        if not np.isfinite(values).all() or not np.any(np.array(values[:3]) - ([*values[3:]] or 0)):
            raise ValueError(text)
    except ValueError:
        raise LaisnError(
            "view: expected E,N,U,E,N,U, where the camera stands and what it looks at [m], or "
            f"VEHICLE:E,N,U with one of {', '.join(names)} (given: {text})"
        ) from None
    east, north, up = values[:3]
    if colon:
        return OwnCamera(position=(east, north, up), vehicle=[*names].index(vehicle))
    to_east, to_north, to_up = values[3:]
    return OwnCamera(position=(east, north, up), target=(to_east, to_north, to_up))


def video_of(video: Video, changes: Mapping[str, object]) -> Video:
    """Settings of a film with some of them changed; LaisnError naming each that is invalid."""
    try:
        return Video.model_validate(video.model_dump() | dict(changes))
    except ValidationError as error:
        raise LaisnError("; ".join(line.strip() for line in lines_of(error))) from None


def require_picture(
    followers: Sequence[str],
    duration_s: float,
    video: Video,
    *,
    time_s: float | None = None,
    follower: int = 0,
    view: str | None = None,
    background: str = "sea",
) -> None:
    """LaisnError if a mission of these followers and this duration has no such follower, time or
    camera, or its film is too large; arguments as of `render`.
    """
    from sim.film import render as film

    number = len(followers)
    if not 0 <= follower < number:
        raise film.RenderError(f"follower {follower}: expected 0 … {number - 1}")
    if background not in get_args(film.Background):
        raise film.RenderError(
            f"background {background!r}: expected {', '.join(get_args(film.Background))}"
        )
    if view is not None:
        camera_of(view, ["leader", *followers])
    if time_s is None:
        if too_large := film_errors(duration_s, video):
            raise film.RenderError(too_large[0])
        if background == "transparent":
            raise film.RenderError(film.NOT_TRANSPARENT)
    elif not 0.0 <= time_s <= duration_s:
        raise film.RenderError(f"time {time_s:g} s lies outside the mission, 0 … {duration_s:g} s")


def render(
    flight: simulated.FlightRecord,
    path: str | Path,
    *,
    time_s: float | None = None,
    follower: int = 0,
    progress: Callable[[float], None] | None = None,
    view: str | None = None,
    plain: bool = False,
    background: str = "sea",
    **video: object,
) -> Path:
    """Film a flight (.mp4), or take a picture of it (.png) at the mission time `time_s` [s];
    returns the file.

    The camera follows the follower of this index; `progress` is called with the rendered share;
    `video` has keys of a scenario's [video]. `view` is a camera that a page's "Copy camera" gives,
    see `camera_of`. `plain` leaves panels and words out; the background is "sea", "white" or, of a
    picture, "transparent". LaisnError: a setting is invalid, or rendering does
    not work here (`laisn doctor` reports why).
    """
    from sim.film import render as film

    file = Path(path)
    settings = video_of(flight.scenario.video, video)
    require_picture(
        flight.trajectory.names[1:],
        flight.scenario.duration_s,
        settings,
        time_s=time_s,
        follower=follower,
        view=view,
        background=background,
    )
    job = film.FilmJob(
        flight=flight,
        video=settings,
        follower=follower,
        camera=None if view is None else camera_of(view, flight.trajectory.names),
        plain=plain,
        background=cast(film.Background, background),
    )
    if time_s is not None:
        film.still(job, time_s, file)
        return file
    film.render(job, file, progress=progress)
    return file


def log_flight(flight: simulated.FlightRecord, path: str | Path) -> Path:
    """Write a flight as an MCAP log for `read_log`, `laisn replay`, Foxglove and Rerun;
    LaisnError if that fails.
    """
    summary = json.dumps(summarise(flight), indent=2, allow_nan=False) + "\n"
    writer.write(flight, Path(path), summary=summary, events=flight_events(flight))
    return Path(path)
