"""A flight from a scenario or a log, and its log, films and pictures."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from pydantic import ValidationError

from experiments.campaign.progress import compiling_shown
from experiments.flight.events import flight_events
from experiments.flight.fly import fly
from experiments.flight.library import load_flyable
from experiments.flight.summary import position_and_bearing_errors, summarise
from laisn.failure import LaisnError
from sim.feasibility import film_errors
from sim.flight import Flight
from sim.log import reader, writer
from sim.scenario.settings import Video


def flight_of(source: str, assignments: Iterable[str] = ()) -> Flight:
    """Fly a scenario, or read the log of a flight.

    Args:
        source: scenario name, TOML file or `.mcap` log.
        assignments: overrides of a scenario, "key=value".

    Raises:
        LaisnError: overrides were given for a log.
        LogError, ScenarioError: the source is at fault.
    """
    path = Path(source)
    if path.suffix != ".mcap":
        scenario = load_flyable(source, assignments)
        with compiling_shown():
            return fly(scenario)[0]
    if list(assignments):
        raise LaisnError(f"{path}: --set changes a scenario; a log was flown already")
    return reader.read(path)


def video_of(video: Video, changes: Mapping[str, object]) -> Video:
    """Settings of a film with some of them changed; RenderError naming each that is invalid."""
    # drawing libraries take half a second to import
    from sim.film.render import RenderError

    try:
        return Video.model_validate(video.model_dump() | dict(changes))
    except ValidationError as error:
        found = (
            f"{one['loc'][0]}: {one['msg'].removeprefix('Value error, ')} (given: {one['input']})"
            for one in error.errors()
        )
        raise RenderError("; ".join(found)) from None


def picture(
    flight: Flight,
    path: str | Path,
    time_s: float | None,
    follower: int,
    changes: Mapping[str, object],
    progress: Callable[[float], None] | None = None,
) -> Path:
    """Film a flight, or picture it at a time; arguments and errors as of `laisn_sim.render`.

    Args:
        progress: called with the rendered share of a film, 0 … 1.
    """
    from sim.film import render

    file, video = Path(path), video_of(flight.scenario.video, changes)
    if not 0 <= follower < len(flight.scenario.followers):
        raise render.RenderError(f"follower {follower}: there are followers 0 … {len(flight.scenario.followers) - 1}")
    errors = position_and_bearing_errors(flight)
    if time_s is not None:
        render.still(flight, time_s, file, errors=errors, video=video, follower=follower)
        return file
    too_much = film_errors(flight.scenario.duration_s, video)
    if too_much:
        raise render.RenderError(too_much[0])
    render.render(flight, file, errors=errors, video=video, follower=follower, progress=progress)
    return file


def log_flight(flight: Flight, path: str | Path) -> Path:
    """Write a flight as an MCAP log, which `read_log`, `laisn replay`, Foxglove and Rerun read; gives its path.

    Raises:
        LaisnError: the file cannot be written.
    """
    errors = position_and_bearing_errors(flight)
    summary = json.dumps(summarise(flight, errors), indent=2, allow_nan=False) + "\n"
    writer.write(flight, Path(path), summary=summary, errors=errors, events=flight_events(flight))
    return Path(path)
