"""One vehicle among beacons, online, step by step: odometry and ranges in, estimates out."""

import math
from dataclasses import replace

import numpy as np

from laisn.arrays import Floats
from laisn.beacons.estimator import STARTERS, Belief, Ranging, moments, new_belief, predict, receive, with_beacon
from laisn.beacons.settings import BeaconSettings
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.failure import LaisnError
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.navigators import OnlineNavigator, require_readings

MOST_BEACONS = 64
"""More places than this are not those of beacons at rest."""


def _received_ranges(reception: Reception) -> list[tuple[Floats, float]]:
    """Places of the beacons, shape (3,) [m], with the ranges to them [m], of ranges that were received."""
    places = np.empty((0, 3)) if reception.transmitters is None else reception.transmitters
    pairs = zip(places, map(float, reception.ranges), strict=False)
    return [(place, measured) for place, measured in pairs if np.isfinite(measured + place.sum())]


class BeaconNavigator(OnlineNavigator[Estimates]):
    """The tightly coupled navigator of one vehicle among beacons at rest.

    A reading of its own motion is the mean speed over the step that it ends, and the direction of the way in it.
    """

    def __init__(self, settings: BeaconSettings, start: Floats | None) -> None:
        """Start at a known place, or anywhere.

        Args:
            settings: sensors, and what is known.
            start: receiver's x, y [m] and velocity [m/s] at step 0, shape (4,); None, or `known_start` False: unknown,
                so that estimates are NaN until the first range. The heading is known either way.

        Raises:
            ValueError: the start is not four finite numbers.
        """
        super().__init__(settings, start if settings.known_start else None, settings.start_sigma)
        self._belief: Belief = new_belief(settings, self._start)
        self._beacons: dict[tuple[float, float], int] = {}
        self._starter = 0 if self._start is None else -1

    @property
    def evidence(self) -> float:
        """Logarithm of the probability density that the settings gave to all ranges so far: the larger, the likelier.

        Of an unknown start's first ranges it counts only what follows from those before them.
        """
        return float(self._belief.evidence[0])

    def step(
        self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None
    ) -> list[FixRecord]:
        """Advance by one filter step; see `OnlineNavigator.step`.

        The kind of a fix is `ONE_RANGE` if the heaviest component used a range, `GATED` if it used none, and `LOST` if
        there was none. LaisnError also if a message does not place its transmitters, or there are too many places.
        """
        own = self._begin_step(own, duration)
        require_readings(self._step, own, reception, "odometry")
        time = self.settings.dt if duration is None else duration
        if reception is not None and reception.transmitters is None:
            raise LaisnError(
                f"step {self._step}: the message does not place its transmitters; this navigator needs beacons"
            )
        predict(self._belief, (self.settings.slip, self.settings.heading_walk), own.speed, own.heading, time)
        received = [] if reception is None or math.isnan(own.depth) else _received_ranges(reception)
        used = [self._receive(place, measured, own.depth) for place, measured in received]
        self._state, self._covariance = moments(self._belief, own.speed, own.heading)
        if self._belief.alive[0] and not np.isfinite(self._covariance).all():
            raise ArithmeticError(f"step {self._step}: the covariance is not finite after {reception}")
        if reception is None:
            return []
        kind = FixKind.ONE_RANGE if any(used) else (FixKind.GATED if used else FixKind.LOST)
        sigma = math.sqrt(0.5 * (self._covariance[0, 0] + self._covariance[1, 1]))
        return [FixRecord(step=self._step, position=self._state[:2], sigma=sigma, kind=kind)]

    def run(self, measurements: Measurements) -> Estimates:
        """Estimates of a whole mission, whose filter step may differ from the settings'; see `OnlineNavigator.run`."""
        durations = measurements.durations
        if durations is None:
            durations = np.full(measurements.speed.size, measurements.dt)
        return super().run(replace(measurements, dt=self.settings.dt, durations=durations))

    def _beacon(self, place: tuple[float, float]) -> int:
        """Number of the beacon at a surveyed place; a new place is a new beacon."""
        if place not in self._beacons:
            if len(self._beacons) == MOST_BEACONS:
                raise LaisnError(
                    f"step {self._step}: ranges to more than {MOST_BEACONS} places; beacons must lie still"
                )
            self._beacons[place] = len(self._beacons)
            self._belief = with_beacon(self._belief, self.settings)
        return self._beacons[place]

    def _receive(self, place: Floats, measured: float, depth: float) -> bool:
        """Take one range; whether the heaviest component used it."""
        settings = self.settings
        z = Ranging(
            beacon=self._beacon((float(place[0]), float(place[1]))),
            east=float(place[0]),
            north=float(place[1]),
            deeper=float(place[2] - (depth - settings.hydrophone_height)),
            range=measured,
            variance=settings.range_sigma**2,
            accepted=float(np.log1p(-settings.outlier_probability)),
            wrong=float(np.log(settings.outlier_probability / settings.outlier_span)),
        )
        used = receive(self._belief, z, self._starter)
        if self._starter >= 0:
            self._starter = self._starter + 1 if self._starter + 1 < STARTERS else -1
        return bool(used)
