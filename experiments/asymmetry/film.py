"""The film of the pitch study: the leader pitches, rays in the colour of their errors, and two estimates."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.asymmetry.example import OFFSET_M, Example
from experiments.asymmetry.remedies import STEADIED
from experiments.flight.range_budget import Cause, range_error_budget
from experiments.flight.summary import position_and_bearing_errors
from laisn.arrays import Floats
from sim.film import graphics
from sim.film.annotations import Annotations, OtherEstimate, RayErrors
from sim.film.render import render
from sim.flight import Flight, excerpt, navigate
from sim.scenario.file import assigned, validate
from sim.scenario.settings import Scenario, Video

BEFORE_S, AFTER_S = 40.0, 20.0
"""Stretch of the mission that is filmed before and after the message of the example [s]."""
VIDEO = Video(camera="profile", speed_up=4.0, frame_rate_hz=24)
AWARE_COLOUR = (0.30, 1.0, 0.60)


def _attitude_aware(scenario: Scenario) -> Scenario:
    """A mission whose follower places the transmitters by the attitude that the leader's AHRS measures."""
    return validate(assigned(scenario.model_dump(mode="json"), STEADIED.settings), scenario.name)


def pitch_errors(flight: Flight) -> Floats:
    """What pitch and roll of the leader alone add to the horizontal ranges of each message, shape (m, 3), [m]."""
    budget = range_error_budget(flight)
    heard = flight.measurements[0].message_step
    errors = np.full((heard.size, 3), np.nan)
    at = np.searchsorted(flight.trajectory.time[heard * flight.stride], budget.time)
    errors[at] = budget.share[..., Cause.FORESHORTENING] + budget.share[..., Cause.LEVER_ARM]
    return errors


def _round_up(value: float) -> float:
    """The next number of the form 1, 2, 3 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(step * power for step in (1.0, 2.0, 3.0, 5.0, 10.0) if step * power >= value * (1 - 1e-9)))


def scene(example: Example) -> tuple[Flight, Annotations]:
    """What the film shows: the stretch about the message of the example, and an estimate by the broadcast pitch."""
    level = example.flight
    # truth and all other noise are the same: random numbers belong to their sensor
    aware = navigate(_attitude_aware(level.scenario), level.trajectory)
    time = level.trajectory.time
    told = float(time[example.telling])
    start, end = max(float(time[0]), told - BEFORE_S), min(float(time[-1]), told + AFTER_S)
    shown = excerpt(level, start, end)
    shown = replace(shown, scenario=level.scenario.model_copy(update={"name": example.condition.key}))
    heard, (first, *_, last) = time[level.measurements[0].message_step * level.stride], shown.trajectory.time
    errors = pitch_errors(level)[(heard > first) & (heard <= last)]
    largest = float(np.nanmax(np.abs(errors), initial=0.0))
    added = Annotations(
        caption=f"The leader pitches: estimates of a follower {OFFSET_M:g} m below",
        label="level leader assumed",
        others=(
            OtherEstimate(
                label="leader's pitch broadcast",
                colour=AWARE_COLOUR,
                position=excerpt(aware, start, end).estimates[0].state[:, :2],
            ),
        ),
        rays=RayErrors(label="range error from pitch", value=errors, limit=_round_up(max(largest, 1e-3))),
    )
    return shown, added


def film(example: Example, folder: Path, video: Video = VIDEO) -> Path | None:
    """Render the film of the study's example as `film.mp4` into a folder.

    Args:
        example: a flight of the study.
        folder: of the results.
        video: camera, size and speed.

    Returns:
        The film; None where no graphics library renders.

    Raises:
        RendererDiedError: a process that renders died.
    """
    if graphics.working() is None:
        return None
    flight, added = scene(example)
    path = folder / "film.mp4"
    render(flight, path, errors=position_and_bearing_errors(flight), video=video, annotations=added)
    return path
