"""One vehicle among beacons, online, step by step: odometry and ranges in, estimates out."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from laisn.arrays import Floats, require_numbers, require_probability
from laisn.beacons.estimator import CAPACITY, STARTERS, Belief, Ranging, moments, predict, receive
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.failure import LaisnError
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.navigators import OnlineNavigator, require_readings

MOST_BEACONS = 64
"""More places than this are not those of beacons at rest."""


@dataclass(frozen=True, kw_only=True)
class BeaconSettings:
    """Settings of the navigator among beacons: standard deviations of its sensors, without their signs.

    The defaults are those of a wheeled vehicle with radio ranges, `MEDIA` has others. Raises ValueError naming the
    field if a value is out of its range.
    """

    POSITIVE: ClassVar[frozenset[str]] = frozenset({"dt", "start_sigma", "range_sigma", "outlier_span"})
    """Numbers that must not be zero."""

    dt: float = 0.1
    """Filter step Δt [s]; steps of other lengths may come between."""
    hydrophone_height: float = 0.0
    """Height of the receiver above the depth sensor when level [m]."""
    known_start: bool = True
    """The start is given. Otherwise the first ranges give it."""
    start_sigma: float = 1.0
    """Standard deviation of the position at the start, along each axis [m]."""
    heading_sigma: float = float(np.deg2rad(5.0))
    """Standard deviation of the heading's error at the start [rad]."""
    gyro_bias_sigma: float = float(np.deg2rad(0.5))
    """Standard deviation of the rate at which that error grows [rad/s]; 0 for a compass."""
    speed_scale_sigma: float = 0.03
    """Standard deviation of the logarithm of true over measured speed."""
    slip: float = 0.05
    """Motion that odometry does not see, in a second, along each axis [m/√s]."""
    heading_walk: float = float(np.deg2rad(0.0573))
    """Random walk of the heading's error beside that rate, in a second [rad/√s]."""
    current_sigma: float = 0.0
    """Standard deviation of a current that carries the vehicle, along each axis [m/s]; 0 for none."""
    range_sigma: float = 0.5
    """Random error of each range [m]; the estimate for each beacon stays between half and four times this."""
    range_scale_sigma: float = 0.1
    """Standard deviation of the scale error that all ranges share: of radio. Sound under water has 0.003."""
    range_offset_sigma: float = 0.1
    """Standard deviation of each beacon's constant error of range [m]."""
    survey_sigma: float = 0.1
    """Standard deviation of each beacon's place, along each axis [m]."""
    outlier_probability: float = 0.05
    """Chance that a range is wrong altogether."""
    outlier_span: float = 20.0
    """Width of the span in which wrong ranges lie [m]; the same for all `MEDIA`, so that their evidence compares."""

    def __post_init__(self) -> None:
        require_probability("outlier_probability", self.outlier_probability)
        require_numbers(self, positive=self.POSITIVE, signed={"hydrophone_height"})


MEDIA = {
    "air": BeaconSettings(),
    "water": BeaconSettings(
        gyro_bias_sigma=0.0,
        slip=0.2,
        current_sigma=0.1,
        range_scale_sigma=0.003,
        survey_sigma=1.0,
    ),
}
"""What ranges are measured through: radio on land, or sound under water, where a vehicle has a compass and drifts."""


def _allocate(settings: BeaconSettings, beacons: int) -> Belief:
    """A mixture without components, over the states of a number of beacons."""
    s = settings
    shared = [s.start_sigma] * 2 + [s.speed_scale_sigma, s.heading_sigma, s.gyro_bias_sigma, s.range_scale_sigma]
    own = [s.range_offset_sigma, s.survey_sigma, s.survey_sigma]
    fresh = np.square([*shared, s.current_sigma, s.current_sigma, *own * beacons])
    n = fresh.size
    return Belief(
        state=np.zeros((CAPACITY, n)),
        covariance=np.zeros((CAPACITY, n, n)),
        weight=np.zeros(CAPACITY),
        outcome=np.zeros(CAPACITY, dtype=[("used", np.bool_)]),
        states=n,
        alive=np.zeros(1, dtype=np.int64),
        evidence=np.zeros(1),
        fresh=fresh,
        variance=np.full(beacons, settings.range_sigma**2),
        rejected=np.zeros(beacons, dtype=np.int64),
        gain=np.zeros(n),
    )


def new_belief(settings: BeaconSettings, start: tuple[float, float] | None) -> Belief:
    """One component at a known start [m], or none; no beacon is known yet."""
    belief = _allocate(settings, 0)
    if start is not None:
        belief.state[0, :2] = start
        belief.covariance[0] = np.diag(belief.fresh)
        belief.weight[0], belief.alive[0] = 1.0, 1
    return belief


def with_beacon(belief: Belief, settings: BeaconSettings) -> Belief:
    """Belief with fresh states of one more beacon."""
    made, before = _allocate(settings, belief.variance.size + 1), belief.states
    # what is not alive stays untouched, and takes no memory
    alive, own = slice(int(belief.alive[0])), np.arange(before, made.states)
    made.state[alive, :before], made.covariance[alive, :before, :before] = belief.state[alive], belief.covariance[alive]
    made.covariance[alive, own, own] = made.fresh[before:]
    made.variance[:-1], made.rejected[:-1] = belief.variance, belief.rejected
    return made._replace(weight=belief.weight, outcome=belief.outcome, alive=belief.alive, evidence=belief.evidence)


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
        """Start at the receiver's x, y [m] and velocity [m/s] at step 0, shape (4,); ValueError if one is not finite.

        None, or `known_start` False: unknown, so that estimates are NaN until the first range. The heading is known
        either way.
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
        """Number of the beacon at a surveyed place, which may be new."""
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
