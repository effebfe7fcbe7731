"""One vehicle among beacons, online, step by step: odometry and ranges in, estimates out."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.beacons.estimator import STARTERS, Belief, Ranging, advance, moments, new_belief, receive, with_beacon
from laisn.beacons.settings import BeaconSettings
from laisn.estimates import Estimates, FixKind
from laisn.failure import LaisnError
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.navigators import OnlineNavigator, require_readings, require_time

MOST_BEACONS = 64
"""More places than this are not those of beacons at rest."""


class Update(NamedTuple):
    """What a message changed."""

    step: int
    kind: FixKind
    """`ONE_RANGE` if the heaviest component used a range, `GATED` if it used none, `LOST` if there was none."""
    position: Floats
    """Mean over the mixture, shape (2,), [m]."""
    sigma: float
    """Root of half the trace of its covariance [m]."""


def _heard(reception: Reception) -> list[tuple[Floats, float]]:
    """Places of the beacons that were heard, shape (3,) [m], and the ranges to them [m]."""
    places = np.empty((0, 3)) if reception.transmitters is None else reception.transmitters
    pairs = zip(places, map(float, reception.ranges), strict=False)
    return [(place, measured) for place, measured in pairs if np.isfinite(measured + place.sum())]


def _estimates(state: Floats, covariance: Floats, updates: Sequence[Update]) -> Estimates:
    """The record of a mission of its states and messages."""
    m = len(updates)
    return Estimates(
        state=state,
        covariance=covariance,
        fix_step=np.array([u.step for u in updates], dtype=np.int64),
        fix_position=np.array([u.position for u in updates]).reshape(m, 2),
        fix_sigma=np.array([u.sigma for u in updates], dtype=np.float64),
        fix_kind=np.array([u.kind for u in updates], dtype=np.int64),
        innovation=np.full((m, 2), np.nan),
        innovation_covariance=np.full((m, 2, 2), np.nan),
    )


class BeaconNavigator(OnlineNavigator):
    """The tightly coupled navigator of one vehicle among beacons at rest.

    A reading of its own motion is the mean speed over the step that it ends, and the direction of the way in it.
    """

    def __init__(self, settings: BeaconSettings, start: Floats | None) -> None:
        """Start at a known place, or anywhere.

        Args:
            settings: sensors, and what is known.
            start: receiver's x, y [m] and velocity [m/s] at step 0, shape (4,); None, or settings that say so: unknown,
                so that estimates are NaN until the first range. The heading is known either way.

        Raises:
            ValueError: the start is not four finite numbers.
        """
        super().__init__(start if settings.known_start else None, settings.start_sigma)
        self.settings = settings
        self._belief: Belief = new_belief(settings, self._start)
        self._beacons: dict[tuple[float, float], int] = {}
        self._starter = 0 if self._start is None else -1

    @property
    def evidence(self) -> float:
        """Logarithm of the probability density that the settings gave to all ranges so far: the larger, the likelier.

        Of an unknown start's first ranges it counts only what those before them say.
        """
        return float(self._belief.evidence[0])

    def step(self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None) -> list[Update]:
        """Advance by one filter step.

        Args:
            own: measured in the step; of a missing depth (NaN) the last one is used.
            reception: ranges and the places of their beacons, if any arrived; NaN for none.
            duration: time that this step took, if it is another one than the settings' Δt [s].

        Returns:
            What the message changed, if there was one.

        Raises:
            LaisnError: a reading is not finite or absurd, or there are more places than of beacons at rest.
            ArithmeticError: the estimate is not finite any more; the navigator is not to be used further.
        """
        self._step += 1
        time = self.settings.dt if duration is None else duration
        require_readings(self._step, own, reception, "odometry")
        require_time(self._step, time)
        own = self._with_depth(own)
        if reception is not None and reception.transmitters is None:
            raise LaisnError(
                f"step {self._step}: the message does not place its transmitters; this navigator needs beacons"
            )
        advance(self._belief, (self.settings.slip, self.settings.heading_walk), own.speed, own.heading, time)
        heard = [] if reception is None or math.isnan(own.depth) else _heard(reception)
        used = [self._receive(place, measured, own.depth) for place, measured in heard]
        self._state, self._covariance = moments(self._belief, own.speed, own.heading)
        if self._belief.alive[0] and not np.isfinite(self._covariance).all():
            raise ArithmeticError(f"step {self._step}: the covariance is not finite after {reception}")
        return [] if reception is None else [self._update(used)]

    def run(self, measurements: Measurements) -> Estimates:
        """Estimates of a whole mission from the start, step by step; the same to the bit as `step` in a loop.

        Raises:
            ValueError: the navigator is under way.
            LaisnError: as `step`.
        """
        # it takes steps of any length
        if measurements.durations is None:
            measurements = replace(measurements, durations=np.full(measurements.speed.size, measurements.dt))
        return _estimates(*self._take(measurements, measurements.dt))

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
            accepted=float(np.log1p(-settings.outlier_chance)),
            wrong=float(np.log(settings.outlier_chance / settings.outlier_span)),
        )
        used = receive(self._belief, z, self._starter)
        if self._starter >= 0:
            self._starter = self._starter + 1 if self._starter + 1 < STARTERS else -1
        return bool(used)

    def _update(self, used: Sequence[bool]) -> Update:
        """What a message changed, of which each range was used or not."""
        kind = FixKind.ONE_RANGE if any(used) else (FixKind.GATED if used else FixKind.LOST)
        variance = 0.5 * (self._covariance[0, 0] + self._covariance[1, 1])
        return Update(self._step, kind, self._state[:2].copy(), math.sqrt(variance))
