"""A flight from a scenario or a log, and its summary, log, films and pictures."""

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from experiments.campaign.progress import compiling_shown
from experiments.flight.events import flight_events
from experiments.flight.fly import fly
from experiments.flight.library import load_flyable, loaded
from experiments.flight.summary import position_and_bearing_errors, summarise
from laisn.failure import LaisnError
from laisn.navigators import NavigatorFactory
from laisn.plugins import register, takes_readings
from sim.feasibility import film_errors
from sim.flight import Flight
from sim.log import reader, writer
from sim.scenario.settings import Scenario, Video
from sim.scenario.validation_errors import lines_of
from sim.simulation import ControllerFactory


def flight_of(source: str, assignments: Iterable[str] = ()) -> Flight:
    """Fly a scenario (name or TOML file) with overrides "key=value", or read the log of a flight (`.mcap`).

    Raises:
        LaisnError: overrides were given for a log, or the source is invalid.
    """
    path = Path(source)
    if path.suffix != ".mcap":
        scenario = load_flyable(source, assignments)
        with compiling_shown():
            return fly(scenario)[0]
    if list(assignments):
        raise LaisnError(f"{path}: --set changes a scenario; a log is of a finished flight")
    return reader.read(path)


def fly_mission(
    source: str | Path | Mapping[str, Any] | Scenario,
    changes: Mapping[str, Any] | None = None,
    *,
    navigator: type | NavigatorFactory | None = None,
    controller: type | ControllerFactory | None = None,
) -> Flight:
    """Fly a mission: its vehicles move, sense and navigate.

    The same scenario gives the same flight, to the bit; {"run": 7} among the changes selects the noise of run 7.

    Args:
        source: as of `load`.
        changes: as of `load`.
        navigator: class of the followers' navigators, or a function of settings and start that makes one; None: the
            scenario's.
        controller: class of the followers' controllers, with `control(readings, belief, dt)`; or what makes a
            controller of all vehicles from the plant and the control of routes. None: the scenario's. See
            docs/extending.md.

    Raises:
        LaisnError: as of `load`.
    """
    scenario = loaded(source, changes)
    given: dict[str, Any] = {} if navigator is None else {"navigation.variant": register(navigator)}
    if takes_readings(controller):
        given |= {f"followers.{i}.controller": register(controller) for i in range(len(scenario.followers))}
        controller = None
    return fly(loaded(scenario, given) if given else scenario, make_controller=controller)[0]


def video_of(video: Video, changes: Mapping[str, object]) -> Video:
    """Settings of a film with some of them changed; RenderError naming each that is invalid."""
    # drawing libraries take half a second to import
    from sim.film.render import RenderError

    try:
        return Video.model_validate(video.model_dump() | dict(changes))
    except ValidationError as error:
        raise RenderError("; ".join(line.strip() for line in lines_of(error))) from None


def render(
    flight: Flight,
    path: str | Path,
    *,
    time_s: float | None = None,
    follower: int = 0,
    progress: Callable[[float], None] | None = None,
    **video: object,
) -> Path:
    """Film a flight, or take a picture of it; returns the path of the file.

    Args:
        flight: as flown, or as read from a log.
        path: ends in .mp4 for a film, in .png for a picture.
        time_s: mission time of the picture [s]; None: film the whole mission.
        follower: index of the follower that the camera follows.
        progress: called with the rendered share of a film, 0 … 1.
        video: settings of the film by their names in a scenario's [video]: camera, width_px, height_px, speed_up, …

    Raises:
        LaisnError: a setting is invalid, or rendering does not work here (`laisn doctor` reports why).
    """
    from sim.film import render as film

    file, settings, number = Path(path), video_of(flight.scenario.video, video), len(flight.scenario.followers)
    if not 0 <= follower < number:
        raise film.RenderError(f"follower {follower}: expected 0 … {number - 1}")
    errors = position_and_bearing_errors(flight)
    if time_s is not None:
        film.still(flight, time_s, file, errors=errors, video=settings, follower=follower)
        return file
    if too_large := film_errors(flight.scenario.duration_s, settings):
        raise film.RenderError(too_large[0])
    film.render(flight, file, errors=errors, video=settings, follower=follower, progress=progress)
    return file


def flight_summary(flight: Flight) -> dict[str, Any]:
    """Mean, largest and σ of a flight's errors, of all followers and of each, as in `summary.json`."""
    return summarise(flight, position_and_bearing_errors(flight))


def log_flight(flight: Flight, path: str | Path) -> Path:
    """Write a flight as an MCAP log for `read_log`, `laisn replay`, Foxglove and Rerun; returns its path.

    Raises:
        LaisnError: the file cannot be written.
    """
    errors = position_and_bearing_errors(flight)
    summary = json.dumps(summarise(flight, errors), indent=2, allow_nan=False) + "\n"
    writer.write(flight, Path(path), summary=summary, errors=errors, events=flight_events(flight))
    return Path(path)
