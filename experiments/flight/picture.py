"""Films and pictures of a flight with settings by name."""

from collections.abc import Callable, Mapping
from pathlib import Path

from pydantic import ValidationError

from experiments.flight.summary import position_and_bearing_errors
from sim.feasibility import film_errors
from sim.film import render
from sim.flight import Flight
from sim.scenario.settings import Video


def video_of(video: Video, changes: Mapping[str, object]) -> Video:
    """Settings of a film with some of them changed; RenderError naming each that is invalid."""
    try:
        return Video.model_validate(video.model_dump() | dict(changes))
    except ValidationError as error:
        found = (
            f"{one['loc'][0]}: {one['msg'].removeprefix('Value error, ')} (given: {one['input']})"
            for one in error.errors()
        )
        raise render.RenderError("; ".join(found)) from None


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
