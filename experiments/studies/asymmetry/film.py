"""One flight of the pitch study, message by message, for the page; and the study's film of it.

The film shows the leader that pitches, rays in the colour of their errors, and two estimates.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from experiments.flight.range_budget import Cause, RangeErrorBudget, range_error_budget
from experiments.flight.summary import position_and_bearing_errors
from experiments.studies.asymmetry.design import AHRS, EVERYTHING, OFFSET_M, ROUTE, Condition
from laisn.arrays import Floats
from sim.film.annotations import Annotations, OtherEstimate, RayErrors
from sim.film.render import render
from sim.flight import Flight, excerpt, navigate
from sim.motion import simulate_motion
from sim.scenario.settings import Video

_BEFORE_S, _AFTER_S = 40.0, 20.0
"""Stretch of the mission that is filmed before and after the message of the example [s]."""
VIDEO = Video(camera="profile", speed_up=4.0, frame_rate_hz=24)
_AWARE_COLOUR = (0.30, 1.0, 0.60)


@dataclass(frozen=True, kw_only=True)
class Example:
    """A flight with the paper's acoustics, and the range errors of the same motion with every cause at work."""

    condition: Condition
    flight: Flight
    budget: RangeErrorBudget
    step: int
    """Recorded point of a message with a large pitch at a short range."""


def fly_example(condition: Condition, duration: float) -> Example:
    """Simulate a condition with one follower, and take its range errors apart."""
    one, everything = (condition.scenario(ROUTE, OFFSET_M, duration, settings) for settings in ({}, EVERYTHING))
    trajectory = simulate_motion(one)
    flight = navigate(one, trajectory)
    away = trajectory.position[:, 1, :2] - trajectory.position[:, 0, :2]
    pings = flight.measurements[0].message_step * flight.stride
    step = int(pings[np.argmax(np.abs(trajectory.pitch[pings, 0]) / np.hypot(*away[pings].T))])
    budget = range_error_budget(navigate(everything, trajectory))
    return Example(condition=condition, flight=flight, budget=budget, step=step)


def pitch_errors(flight: Flight) -> Floats:
    """What pitch and roll of the leader alone add to the horizontal ranges of each message, shape (m, 3), [m]."""
    budget = range_error_budget(flight)
    received = flight.measurements[0].message_step
    errors = np.full((received.size, 3), np.nan)
    at = np.searchsorted(flight.trajectory.time[received * flight.stride], budget.time)
    errors[at] = budget.share[..., Cause.FORESHORTENING] + budget.share[..., Cause.LEVER_ARM]
    return errors


def scene(example: Example) -> tuple[Flight, Annotations]:
    """What the film shows: the stretch about the message of the example, and an estimate by the broadcast pitch."""
    level, time = example.flight, example.flight.trajectory.time
    # truth and all other noise are the same: random numbers belong to their sensor
    aware = navigate(example.condition.scenario(ROUTE, OFFSET_M, round(float(time[-1]), 6), AHRS.set), level.trajectory)
    message = float(time[example.step])
    start, end = max(float(time[0]), message - _BEFORE_S), min(float(time[-1]), message + _AFTER_S)
    shown = excerpt(level, start, end)
    shown = replace(shown, scenario=level.scenario.model_copy(update={"name": example.condition.key}))
    received = time[level.measurements[0].message_step * level.stride]
    errors = pitch_errors(level)[(received > shown.trajectory.time[0]) & (received <= shown.trajectory.time[-1])]
    largest = float(np.nanmax(np.abs(errors), initial=1e-3))
    digit = 10.0 ** np.floor(np.log10(largest))
    position = excerpt(aware, start, end).estimates[0].state[:, :2]
    return shown, Annotations(
        caption=f"The leader pitches: estimates of a follower {OFFSET_M:g} m below",
        label="level leader assumed",
        others=(OtherEstimate(label="leader's pitch broadcast", colour=_AWARE_COLOUR, position=position),),
        rays=RayErrors(label="range error from pitch", value=errors, limit=float(np.ceil(largest / digit) * digit)),
    )


def film(example: Example, folder: Path, video: Video = VIDEO) -> Path:
    """Render the film of a flight of the study as `film.mp4` into the folder of its results.

    Raises:
        RendererDiedError: a process that renders died.
    """
    flight, added = scene(example)
    path = folder / "film.mp4"
    render(flight, path, errors=position_and_bearing_errors(flight), video=video, annotations=added)
    return path
