"""Film and stills, from a scenario or from a log."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError
from rich.console import Console

from experiments.campaign.progress import phases
from experiments.flight.source import flight_of
from experiments.flight.summary import position_and_bearing_errors
from sim.film import render
from sim.film.cameras import CAMERAS
from sim.flyable import film_misfits
from sim.scenario.settings import Video
from sim.screen import plain


class Wish(NamedTuple):
    """What a user asked of a film; None leaves it to the scenario."""

    camera: str | None
    size: str | None
    speed_up: float | None
    follower: int
    still: float | None
    out: Path | None


def _video(video: Video, wish: Wish) -> Video:
    """The scenario's film settings with the user's wishes; RenderError naming the option."""
    wanted = video.model_dump()
    if wish.camera is not None:
        wanted["camera"] = wish.camera
    if wish.size is not None:
        match = re.fullmatch(r"(\d+)x(\d+)", wish.size)
        if match is None:
            raise render.RenderError(f"--size {wish.size}: expected WIDTHxHEIGHT, such as 1280x720")
        wanted["width_px"], wanted["height_px"] = int(match[1]), int(match[2])
    if wish.speed_up is not None:
        wanted["speed_up"] = wish.speed_up
    try:
        return Video.model_validate(wanted)
    except ValidationError as error:
        faults = (f"{fault['loc'][0]}: {fault['msg']} (given: {fault['input']})" for fault in error.errors())
        raise render.RenderError("; ".join(faults)) from None


def film(source: str, assignments: Iterable[str], wish: Wish) -> Path:
    """Render the film, or one still, of a scenario or a log.

    Args:
        source: scenario name, TOML file or `.mcap` log.
        assignments: overrides of a scenario.
        wish: camera, size and so on.

    Returns:
        The file.

    Raises:
        RenderError: a wish cannot be met.
        LogError, ScenarioError: the source is at fault.
    """
    if wish.camera is not None and wish.camera not in CAMERAS:
        raise render.RenderError(f"unknown camera {wish.camera!r}; available: {', '.join(CAMERAS)}")
    flight = flight_of(source, list(assignments))
    video = _video(flight.scenario.video, wish)
    too_much = film_misfits(flight.scenario.duration_s, video)
    if wish.still is None and too_much:
        raise render.RenderError(too_much[0].text)
    if not 0 <= wish.follower < len(flight.scenario.followers):
        raise render.RenderError(
            f"--follower {wish.follower}: there are followers 0 … {len(flight.scenario.followers) - 1}"
        )
    errors = position_and_bearing_errors(flight)
    if wish.still is not None:
        path = wish.out or Path(f"{flight.scenario.name}.png")
        render.still(flight, wish.still, path, errors=errors, video=video, follower=wish.follower)
    else:
        path = wish.out or Path(f"{flight.scenario.name}.mp4")
        with phases(Console()) as phase, phase("video") as update:
            render.render(flight, path, errors=errors, video=video, follower=wish.follower, progress=update)
    print(plain(path))
    return path
