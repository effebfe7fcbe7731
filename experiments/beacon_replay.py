"""Replays among surveyed beacons: settings, estimates by each navigator, and their score against a surveyed path."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError

from laisn.arrays import Floats
from laisn.beacons.navigator import BeaconNavigator
from laisn.beacons.settings import MEDIA, BeaconSettings
from laisn.estimates import Estimates
from laisn.failure import LaisnError
from laisn.messages import Measurements
from laisn.navigator import Navigator
from laisn.settings import NavigationSettings
from sim.datasets.log import Replayable
from sim.scenario.section import FurtherKeys, in_si, with_fields_of


@with_fields_of(BeaconSettings, without={"dt", "hydrophone_height"}, optional=True)
class Beacons(FurtherKeys):
    """What is known of odometry and ranges; keys that are not given follow the medium."""

    if TYPE_CHECKING:

        def __init__(self, **keys: Any) -> None: ...

    medium: Literal["auto", "air", "water"] = Field(
        "auto", description="what ranges are measured through; auto: computes both and takes the likelier one"
    )
    outlier_probability: Annotated[float, Field(gt=0, lt=1)] | None = Field(None, description="chance of a wrong range")

    def over(self, base: BeaconSettings) -> BeaconSettings:
        """Settings with what is given here instead of what stands there."""
        return replace(base, **in_si(self.model_dump(exclude={"medium"}), ()))


def beacons_of(values: Mapping[str, object]) -> Beacons:
    """Settings by their keys.

    Raises:
        LaisnError: a key is not known or a value out of its range; the text names all that are at fault.
    """
    try:
        return Beacons.model_validate(dict(values))
    except ValidationError as error:
        lines = []
        for fault in error.errors():
            key = ".".join(str(part) for part in fault["loc"][:1])
            known = "" if key in Beacons.model_fields else f"; known: {', '.join(Beacons.model_fields)}"
            lines.append(f"  beacons.{key}: {fault['msg']}{known}")
        raise LaisnError("\n".join(["settings of beacons:", *lines])) from None


class Score(NamedTuple):
    """How far estimates are from a path, surveyed or stated by the data set, at its times."""

    mean: float
    """Mean distance [m]."""
    rms: float
    """Root of the mean squared distance [m]."""
    high: float
    """95 % of distances are shorter [m]."""
    nees: float
    """Mean squared error in units of the covariance: 2 if that can be believed."""


def score(estimates: Estimates, measured: Measurements, truth: Floats, since_s: float = 0.0) -> Score:
    """Errors at all times of a surveyed path at which there is an estimate.

    Args:
        estimates: of the mission.
        measured: what they were made of.
        truth: time since the start [s], east and north [m], shape (t, 3).
        since_s: count from this time on [s].
    """
    time = measured.time
    known = np.isfinite(estimates.state[:, 0])
    first = max(since_s, float(time[known][0]) if known.any() else np.inf)
    path = truth[(truth[:, 0] >= first) & (truth[:, 0] <= time[-1])]
    if not len(path):
        return Score(*[float("nan")] * 4)
    place = np.column_stack([np.interp(path[:, 0], time[known], estimates.state[known, k]) for k in range(2)])
    covariance = estimates.covariance[np.searchsorted(time, path[:, 0]), :2, :2]
    off = place - path[:, 1:]
    distance = np.hypot(*off.T)
    # dead reckoning may begin with a covariance of zero
    regular = np.linalg.det(covariance) > 0.0
    squared = np.einsum("ki,ki->k", off[regular], np.linalg.solve(covariance[regular], off[regular, :, None])[..., 0])
    return Score(
        mean=float(distance.mean()),
        rms=float(np.sqrt(np.mean(distance**2))),
        high=float(np.percentile(distance, 95)),
        nees=float(squared.mean()) if squared.size else float("nan"),
    )


def dead_reckoning(recorded: Replayable) -> Estimates:
    """What odometry alone makes of the mission."""
    measured = recorded.measurements
    none = slice(0, 0)
    silent = replace(
        measured,
        message_step=measured.message_step[none],
        message=measured.message[none],
        ranges=measured.ranges[none],
        transmitters=None,
    )
    return BeaconNavigator(MEDIA["air"], recorded.start).run(silent)


def by_laisn(recorded: Replayable, given: NavigationSettings) -> Estimates:
    """Estimates of LAISN: single ranges move the estimate along their line of sight."""
    settings = replace(given, dt=recorded.measurements.dt, hydrophone_height=0.0)
    return Navigator(settings, recorded.start).run(recorded.measurements)


def _settings(recorded: Replayable, given: Beacons, medium: str) -> BeaconSettings:
    base = replace(MEDIA[medium], dt=recorded.measurements.dt)
    stated = {name: getattr(recorded, name) for name in ("range_sigma", "slip", "heading_walk")}
    base = replace(base, **{name: value for name, value in stated.items() if value is not None})
    return given.over(base)


def among_beacons(recorded: Replayable, given: Beacons) -> tuple[Estimates, str]:
    """Estimates of the navigator among beacons, and the medium that was assumed.

    Where that is open, every medium is computed, and the one in which the ranges are the likeliest is taken.
    """
    best: tuple[float, Estimates, str] | None = None
    for medium in MEDIA if given.medium == "auto" else (given.medium,):
        navigator = BeaconNavigator(_settings(recorded, given, medium), recorded.start)
        estimates = navigator.run(recorded.measurements)
        if best is None or navigator.evidence > best[0]:
            best = navigator.evidence, estimates, medium
    assert best is not None
    return best[1], best[2]
