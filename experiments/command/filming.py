"""Film and stills, from a scenario or from a log."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from experiments.campaign.progress import phases
from experiments.flight.picture import require_camera, video_of
from experiments.flight.source import flight_of
from experiments.flight.summary import position_and_bearing_errors
from sim.feasibility import film_errors
from sim.film import render
from sim.scenario.settings import Video
from sim.screen import plain, shortened


class FilmOptions(NamedTuple):
    """What a user asked of a film; None leaves it to the scenario."""

    camera: str | None
    size: str | None
    speed_up: float | None
    follower: int
    still: float | None
    out: Path | None


def _video(video: Video, options: FilmOptions) -> Video:
    """The scenario's film settings with the user's wishes; RenderError naming the option."""
    wanted: dict[str, object] = {}
    if options.camera is not None:
        wanted["camera"] = options.camera
    if options.size is not None:
        match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", options.size)
        if match is None:
            raise render.RenderError(
                f"--size {shortened(plain(options.size), 80)}: expected WIDTHxHEIGHT, such as 1280x720"
            )
        wanted["width_px"], wanted["height_px"] = int(match[1]), int(match[2])
    if options.speed_up is not None:
        wanted["speed_up"] = options.speed_up
    return video_of(video, wanted)


def film(source: str, assignments: Iterable[str], options: FilmOptions) -> Path:
    """Render the film, or one still, of a scenario or a log.

    Args:
        source: scenario name, TOML file or `.mcap` log.
        assignments: overrides of a scenario.
        options: camera, size and so on.

    Returns:
        The file.

    Raises:
        RenderError: the options cannot be met.
        LogError, ScenarioError: the source is at fault.
    """
    if options.camera is not None:
        require_camera(options.camera)
    flight = flight_of(source, list(assignments))
    video = _video(flight.scenario.video, options)
    too_much = film_errors(flight.scenario.duration_s, video)
    if options.still is None and too_much:
        raise render.RenderError(too_much[0])
    if not 0 <= options.follower < len(flight.scenario.followers):
        raise render.RenderError(
            f"--follower {options.follower}: there are followers 0 … {len(flight.scenario.followers) - 1}"
        )
    errors = position_and_bearing_errors(flight)
    if options.still is not None:
        path = options.out or Path(f"{flight.scenario.name}.png")
        render.still(flight, options.still, path, errors=errors, video=video, follower=options.follower)
    else:
        path = options.out or Path(f"{flight.scenario.name}.mp4")
        with phases(Console()) as phase, phase("video") as update:
            render.render(flight, path, errors=errors, video=video, follower=options.follower, progress=update)
    print(plain(path))
    return path
