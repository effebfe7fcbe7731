"""The film of the pitch study: one mission, and the estimates of two minds beside the truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.asymmetry_conditions import Condition, scenario
from experiments.asymmetry_example import OFFSET_M, ROUTE, Example
from experiments.fly import position_and_bearing_errors
from laisn.navigator import Navigator
from sim.errors import measure
from sim.flight import Flight, navigation_settings
from sim.motion import move
from sim.scenario import Video
from sim.sensors import errors_of, observe

DURATION_S = 80.0
MINDS = ("level", "aware")
"""Names of the two: one believes in a level leader, the other places the transmitters by the broadcast attitude."""
VIDEO = Video(camera="chase", speed_up=4.0)


def two_minds(condition: Condition, duration: float = DURATION_S) -> Flight:
    """A flight of two followers in the same place with the same measurements, and an estimate of each mind."""
    one = scenario(condition, ROUTE, OFFSET_M, duration)
    twins = one.model_copy(
        update={
            "name": condition.key,
            "followers": tuple(one.followers[0].model_copy(update={"name": name}) for name in MINDS),
        }
    )
    trajectory = move(twins)
    truth = observe(trajectory, one)
    heard = measure(truth, errors_of(one), seed=one.seed, run=one.run)
    settings = navigation_settings(one, trajectory, 0)
    estimates = tuple(
        Navigator(replace(settings, use_attitude=aware), truth.start).run(heard) for aware in (False, True)
    )
    return Flight(scenario=twins, trajectory=trajectory, measurements=(heard, heard), estimates=estimates)


def film(example: Example, folder: Path) -> Path | None:
    """Render the film of the study's example into a folder; None where nothing renders.

    Args:
        example: its condition is filmed.
        folder: for `asymmetry.mp4`.
    """
    from sim import graphics
    from sim.render import render

    if not any(backend.works for backend in graphics.probe()):
        return None
    flight = two_minds(example.condition)
    path = folder / "asymmetry.mp4"
    render(flight, path, errors=position_and_bearing_errors(flight), video=VIDEO, workers=2)
    return path


def mean_errors(flight: Flight) -> dict[str, float]:
    """Mean E_P of both minds [m]."""
    errors = position_and_bearing_errors(flight)
    return {name: float(np.mean(position)) for name, (position, _) in zip(MINDS, errors, strict=True)}
