"""Films and pictures of a scenario or a log."""

import re
from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from experiments.campaign.progress import phases
from experiments.command.options import say
from experiments.flight.picture import picture, require_camera
from experiments.flight.source import flight_of
from sim.film.render import RenderError
from sim.screen import plain, shortened


class FilmOptions(NamedTuple):
    """Options of a film; with None the scenario's settings hold."""

    camera: str | None
    size: str | None
    speed_up: float | None
    follower: int
    still: float | None
    out: Path | None


def _changes(options: FilmOptions) -> dict[str, object]:
    """Film settings that the options change; RenderError naming the option."""
    changes: dict[str, object] = {}
    if options.camera is not None:
        require_camera(options.camera)
        changes["camera"] = options.camera
    if options.size is not None:
        match = re.fullmatch(r"(\d{1,9})x(\d{1,9})", options.size)
        if match is None:
            size = shortened(plain(options.size), 80)
            raise RenderError(f"--size {size}: expected WIDTHxHEIGHT, such as 1280x720")
        changes |= {"width_px": int(match[1]), "height_px": int(match[2])}
    if options.speed_up is not None:
        changes["speed_up"] = options.speed_up
    return changes


def film(source: str, assignments: Iterable[str], options: FilmOptions) -> None:
    """Render the film, or a picture, of a scenario or a log and print the name of the file.

    Args:
        source: scenario name, TOML file or `.mcap` log.
        assignments: overrides of a scenario.
        options: camera, size and so on.

    Raises:
        LaisnError: an option or the source is invalid.
    """
    changes = _changes(options)
    flight = flight_of(source, list(assignments))
    path = options.out or Path(f"{flight.scenario.name}.{'mp4' if options.still is None else 'png'}")
    with phases(Console()) as phase, phase("video") if options.still is None else nullcontext() as update:
        say(picture(flight, path, options.still, options.follower, changes, update))
