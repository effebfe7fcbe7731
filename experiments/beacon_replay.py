"""Replays among surveyed beacons: settings, estimates by each navigator, and their score against
a surveyed path.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from operator import itemgetter
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, ValidationError

from laisn.arrays import Floats
from laisn.beacons import MEDIA, BeaconNavigator, BeaconSettings
from laisn.errors import LaisnError
from laisn.estimates import Estimates
from laisn.messages import Measurements
from laisn.metrics import normalised_square
from laisn.navigator import Navigator
from laisn.settings import NavigationSettings
from sim.datasets.log import Replayable
from sim.scenario.section import FurtherKeys, in_si, with_fields_of


@with_fields_of(BeaconSettings, excluded={"dt", "hydrophone_height"}, optional=True)
class BeaconReplaySettings(FurtherKeys):
    """What is known of odometry and ranges; keys that are not given follow the medium."""

    if TYPE_CHECKING:

        def __init__(self, **keys: Any) -> None: ...

    medium: Literal["auto", "air", "water"] = Field(
        "auto",
        description="what ranges are measured through; auto: computes both and takes the likelier "
        "one",
    )
    outlier_probability: Annotated[float, Field(gt=0, lt=1)] | None = Field(
        None, description="chance of a wrong range"
    )

    def over(self, base: BeaconSettings) -> BeaconSettings:
        """`base` with the settings that are given here in place of its own."""
        return replace(base, **in_si(self.model_dump(exclude={"medium"})))


def beacon_settings(values: Mapping[str, object]) -> BeaconReplaySettings:
    """Settings by their keys; LaisnError naming all keys that are unknown and values out of
    their range.
    """
    try:
        return BeaconReplaySettings.model_validate(dict(values))
    except ValidationError as error:
        keys = BeaconReplaySettings.model_fields
        lines = ["settings of beacons:"]
        for detail in error.errors():
            key = detail["loc"][0]
            note = "" if key in keys else f"; known: {', '.join(keys)}"
            lines.append(f"  beacons.{key}: {detail['msg']}{note}")
        raise LaisnError("\n".join(lines)) from None


class Score(NamedTuple):
    """Distances of estimates from a path, surveyed or stated by the data set, at its times [m]."""

    mean: float
    rms: float
    high: float  # 95 % are shorter [m]
    # mean squared error in units of the covariance where that is regular: 2 if it is consistent
    nees: float


def score(
    estimates: Estimates, measurements: Measurements, truth: Floats, since_s: float = 0.0
) -> Score:
    """Errors where there is an estimate, from `since_s` on; `truth`: time [s], east and north
    [m], shape (t, 3).
    """
    time = measurements.time
    estimated = np.isfinite(estimates.state[:, 0])
    first = max(since_s, float(time[estimated][0]) if estimated.any() else np.inf)
    path = truth[(truth[:, 0] >= first) & (truth[:, 0] <= time[-1])]
    if not len(path):
        return Score(math.nan, math.nan, math.nan, math.nan)
    positions = np.column_stack(
        [np.interp(path[:, 0], time[estimated], estimates.state[estimated, k]) for k in range(2)]
    )
    covariance = estimates.covariance[np.searchsorted(time, path[:, 0]), :2, :2]
    errors = positions - path[:, 1:]
    distance = np.hypot(*errors.T)
    squared = normalised_square(errors[:, 0], errors[:, 1], *covariance[:, [0, 0, 1], [0, 1, 1]].T)
    # single ranges and a known start leave singular covariances
    squared = squared[np.isfinite(squared)]
    return Score(
        mean=float(distance.mean()),
        rms=float(np.sqrt(np.mean(distance**2))),
        high=float(np.percentile(distance, 95)),
        nees=float(squared.mean()) if squared.size else float("nan"),
    )


def dead_reckoning(recorded: Replayable) -> Estimates:
    """Estimates of odometry alone."""
    no_messages = {
        name: getattr(recorded.measurements, name)[:0]
        for name in ("message_step", "message", "ranges")
    }
    return BeaconNavigator(MEDIA["air"], recorded.start).run(
        replace(recorded.measurements, **no_messages, transmitters=None)
    )


def navigate_by_laisn(recorded: Replayable, navigation: NavigationSettings) -> Estimates:
    """Estimates of LAISN: single ranges move the estimate along their line of sight."""
    settings = replace(navigation, dt=recorded.measurements.dt, hydrophone_height=0.0)
    return Navigator(settings, recorded.start).run(recorded.measurements)


def _settings(recorded: Replayable, beacons: BeaconReplaySettings, medium: str) -> BeaconSettings:
    return beacons.over(replace(MEDIA[medium], dt=recorded.measurements.dt, **recorded.stated))


def navigate_among_beacons(
    recorded: Replayable, beacons: BeaconReplaySettings
) -> tuple[Estimates, str]:
    """Estimates of the navigator among beacons, and the medium: of "auto", that in which the ranges
    are the likeliest.
    """
    candidates = list[tuple[float, Estimates, str]]()
    for medium in MEDIA if beacons.medium == "auto" else (beacons.medium,):
        navigator = BeaconNavigator(_settings(recorded, beacons, medium), recorded.start)
        estimates = navigator.run(recorded.measurements)
        candidates.append((navigator.evidence, estimates, medium))
    return max(candidates, key=itemgetter(0))[1:]
