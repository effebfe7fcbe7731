"""One follower, online, step by step: the readable specification of LAISN. It could run on a
vehicle as it is.

The linear Kalman filter with its process noise, its gate, and the navigator (paper, Sections 2.1
and 2.4). The only module that uses filterpy.
"""

import math
from dataclasses import replace
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np

from laisn import POSITION
from laisn.arrays import Floats, Two
from laisn.compiled import formula
from laisn.delays import RecentWay, delays_of
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.fix import (
    CHOOSE_PAIR,
    SEQUENTIAL,
    Fix,
    RangeCircles,
    fix_variance,
    one_range,
    to_circles,
)
from laisn.geometry import Point, angle_between, is_singular
from laisn.later import later
from laisn.messages import LeaderMessage, OwnMotion, Reception
from laisn.navigators import OnlineNavigator
from laisn.settings import GATE_MEASURED, GATE_OFF, NavigationSettings, Tuning

_H_POSITION = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])
_H_VELOCITY = np.array([[0, 0, 1.0, 0], [0, 0, 0, 1.0]])

_PER_PI = 1.0 / math.pi
_FOR_OTHER_FILTERS = (
    "scipy.linalg",
    "scipy.ndimage",
    "scipy.sparse",
    "scipy.sparse.linalg",
    "scipy.stats",
)
"""What filterpy imports of SciPy, and its Kalman filter does not use."""


@formula
def speed_share(last_speed: float, speed: float, speed_max: float) -> float:
    """γv: change of speed as a share of the top speed; 0 if the first is NaN."""
    share = abs(speed - last_speed) * (1.0 / speed_max)
    return share if share > 0.0 else 0.0


@formula
def turn_share(last_heading: float, heading: float) -> float:
    """γθ: smallest angle between two headings as a share of π; 0 if the first is NaN."""
    share = angle_between(heading, last_heading) * _PER_PI
    return share if share > 0.0 else 0.0


@formula
def expected_acceleration(speed_change: float, turn: float, t: Tuning) -> float:
    """σa = α (γv + γθ) + σa0 [m/s²]: more where a vehicle manoeuvres (paper, Section 2.1)."""
    return t.alpha * (speed_change + turn) + t.sigma_a0


class Innovation(NamedTuple):
    """Innovation of a position update."""

    residual: Floats  # z − H x̂, shape (2,), [m]
    covariance: Floats  # S, shape (2, 2), [m²]
    applied: bool  # False where S was singular and the update was skipped


def kalman_update(
    x: Floats, P: Floats, H: Floats, innovation: Floats, R: Floats
) -> tuple[Floats, Floats]:
    """Joseph form: x ← x + K ν, P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ with K = P Hᵀ S⁻¹, S = H P
    Hᵀ + R.
    """
    HP = H @ P
    K = np.linalg.solve(HP @ H.T + R, HP).T
    complement = np.eye(x.size) - K @ H
    return x + K @ innovation, complement @ P @ complement.T + K @ R @ K.T


@lru_cache(maxsize=8)
def _motion(dt: float) -> tuple[Floats, Floats]:
    """Transition over a step of constant velocity, and Q for a constant unit acceleration
    (Section 2.1).
    """
    noise = np.asarray(
        np.kron([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]], np.eye(2)), dtype=np.float64
    )
    return np.eye(4) + dt * np.eye(4, k=2), noise


@cache
def _kalman_filter() -> Any:
    """The class of filterpy, whose other filters load what they need of SciPy when they are
    used.
    """
    with later(*_FOR_OTHER_FILTERS):
        from filterpy.kalman import KalmanFilter
    return KalmanFilter


class Filter:
    """State [x, y, vx, vy] and its covariance."""

    def __init__(self, dt: float, start: Floats, sigma0: Floats) -> None:
        """Start at a known state and its standard deviations, shapes (4,); `dt` is the filter
        step [s].
        """
        self._kalman = _kalman_filter()(dim_x=4, dim_z=2)
        # one-dimensional: a column would broadcast against the rows of z without an error
        self._kalman.x = np.array(start, dtype=np.float64)
        self._kalman.P = np.diag(np.square(sigma0))
        self._dt = dt

    @property
    def state(self) -> Floats:
        """State x, y, vx, vy, shape (4,); a copy."""
        return np.array(self._kalman.x)

    @property
    def covariance(self) -> Floats:
        """Covariance of `state`, shape (4, 4); a copy."""
        return np.array(self._kalman.P)

    def predict(self, sigma_a: float, duration: float | None = None) -> None:
        """One step, of another `duration` than Δt [s] if given, under accelerations of standard
        deviation σa [m/s²].
        """
        transition, noise = _motion(self._dt if duration is None else duration)
        self._kalman.predict(F=transition, Q=sigma_a**2 * noise)

    def update_position(self, position: Two, sigma: float, axis: Two | None = None) -> Innovation:
        """Position update in Joseph form; skipped where the filter is already exact and σp = 0.

        With an axis the position is on a line through the prediction along that unit vector, and σp
        is along it.
        """
        z = np.array(position)
        x = self._kalman.x
        P = self._kalman.P
        residual = z - x[POSITION]
        H = _H_POSITION if axis is None else np.array([[*axis, 0.0, 0.0]])
        R = sigma**2 * np.eye(len(H))
        S = H @ P @ H.T + R
        applied = not is_singular(S[0, 0], S[-1, -1])
        if applied and axis is None:
            self._kalman.update(z, R=R, H=H)
        elif applied:
            self._kalman.x, self._kalman.P = kalman_update(x, P, H, H[:, POSITION] @ residual, R)
        return Innovation(residual, S * np.eye(2) if axis else S, applied)

    def update_speed(
        self, speed: float, heading: float, sigma_speed: float, sigma_heading: float
    ) -> None:
        """Speed update from log and compass, R = J diag(σV², σθ²) Jᵀ (paper, Section 2.1)."""
        sine, cosine = np.sin(heading), np.cos(heading)
        jacobian = np.array([[sine, speed * cosine], [cosine, -speed * sine]])
        noise = (jacobian * (sigma_speed**2, sigma_heading**2)) @ jacobian.T
        self._kalman.update(np.array([speed * sine, speed * cosine]), R=noise, H=_H_VELOCITY)


@formula
def gate_radius(elapsed: float, speed: float, t: Tuning) -> float:
    """Greatest distance that a vehicle can have come in a time [s], at top speed or at the one
    measured [m].
    """
    top = speed if t.gate == GATE_MEASURED else t.follower_speed_max
    return np.inf if t.gate == GATE_OFF else top * elapsed


@formula
def exceeds_gate(position: Point, start: Point, bound: float) -> bool:
    """Whether a place lies farther from a start than the bound [m]."""
    east, north = position.east - start.east, position.north - start.north
    return math.sqrt(east * east + north * north) > bound


class Gate:
    """Gate around the last accepted position: the state right after the update that was
    accepted.
    """

    def __init__(self, tuning: Tuning, start: Point) -> None:
        self._tuning = tuning
        self._position = start
        self._step = 0
        self._extra = 0.0

    def lengthen(self, extra: float) -> None:
        """Account for a step that takes longer than Δt by `extra` [s]."""
        self._extra += extra

    def bound(self, step: int, speed: float) -> float:
        """Greatest distance from the last accepted position at step k [m], at a measured speed
        [m/s].
        """
        # steps of Δt are counted, not added up, so that this is exact where there are no others
        return gate_radius((step - self._step) * self._tuning.dt + self._extra, speed, self._tuning)

    def passes(self, position: Point, step: int, speed: float) -> bool:
        """Whether a fix at that position passes."""
        return not exceeds_gate(position, self._position, self.bound(step, speed))

    def accept(self, position: Point, step: int) -> None:
        """Take the state after an update as the new last accepted position."""
        self._position = position
        self._step = step
        self._extra = 0.0


_NO_FIX = Fix(np.nan, np.nan, np.nan, float(FixKind.LOST), -1.0)


class Navigator(OnlineNavigator[Estimates]):
    """LAISN on one follower: predict, position update if a message arrived, speed update (paper,
    Section 2.1).

    LAISN-3(1) makes up to three fixes of a message.
    """

    def __init__(self, settings: NavigationSettings, start: Floats) -> None:
        """Start at the hydrophone's x, y [m], vx, vy [m/s], shape (4,); LaisnError if they are
        not finite.
        """
        super().__init__(settings, start, settings.position_sigma0)
        sigma0 = np.repeat([settings.position_sigma0, settings.velocity_sigma0], 2)
        self._filter = Filter(settings.dt, self._state, sigma0)
        self._covariance = self._filter.covariance
        self._tuning = Tuning.of(settings)
        self._gate = Gate(self._tuning, Point(float(start[0]), float(start[1])))
        self._last_motion: OwnMotion | None = None
        self._message: LeaderMessage | None = None
        self._recent = RecentWay()

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        if self.settings.compensate_motion:
            self._recent.advance(np.array([[own.speed, own.heading]]), np.array([dt]))
        self._gate.lengthen(dt - self.settings.dt)
        self._filter.predict(self._acceleration(own, reception), dt)
        records = [] if reception is None else self._update_position(own, reception)
        settings = self.settings
        self._filter.update_speed(
            own.speed, own.heading, settings.sigma_speed, settings.sigma_heading
        )
        self._last_motion = own
        self._state = self._filter.state
        self._covariance = self._filter.covariance
        return records

    def _acceleration(self, own: OwnMotion, reception: Reception | None) -> float:
        """σa [m/s²]; the leader's changes are those from message to message. A message without
        ranges is not used.
        """
        t = self._tuning
        speed_change = turn = 0.0
        if self._last_motion is not None:
            speed_change = speed_share(self._last_motion.speed, own.speed, t.follower_speed_max)
            turn = turn_share(self._last_motion.heading, own.heading)
        if reception is not None and not np.all(np.isnan(reception.ranges)):
            last_message = self._message
            message = reception.message
            if last_message is not None:
                speed_change = max(
                    speed_share(last_message.speed, message.speed, t.leader_speed_max), speed_change
                )
                turn = max(turn_share(last_message.heading, message.heading), turn)
            self._message = message
        return expected_acceleration(speed_change, turn, t)

    def _displacement_since_pings(self, reception: Reception) -> Floats | None:
        """What the follower has moved since each ping arrived, by its readings, as of
        `to_circles`.
        """
        if not self.settings.compensate_motion:
            return None
        message, ranges = reception.message, reception.ranges
        delays = delays_of(message, ranges, self._recent.clock, self.settings)
        return self._recent.since(delays.lag).logged

    def _position(self) -> Point:
        return Point(*self._filter.state[POSITION].tolist())

    def _update_position(self, own: OwnMotion, reception: Reception) -> list[FixRecord]:
        circles = to_circles(
            reception, own.depth, self.settings, self._displacement_since_pings(reception)
        )
        if self.settings.variant != SEQUENTIAL:
            predicted = self._position()
            first, second, third = (
                circles.fix(pair, predicted, self._tuning) for pair in circles.pairs()
            )
            choose = CHOOSE_PAIR[self.settings.variant]
            fix = choose((first, second, third), predicted)
            records = [self._apply_fix(fix, circles, own)]
        else:
            # LAISN-3(1): one update after the other, the state carried along (paper, Section 2.3.1)
            records = []
            for pair in circles.pairs():
                fix = circles.fix(pair, self._position(), self._tuning)
                if fix.kind != FixKind.LOST:
                    records.append(self._apply_fix(fix, circles, own))
            records = records or [self._apply_fix(_NO_FIX, circles, own)]
        # one range leaves the way across open, which the gate's bound must still cover
        if any(
            record.kind not in (FixKind.GATED, FixKind.LOST, FixKind.ONE_RANGE)
            for record in records
        ):
            self._gate.accept(self._position(), self._step)
        return records

    def _apply_fix(self, fix: Fix, circles: RangeCircles, own: OwnMotion) -> FixRecord:
        """Gate a fix and update the filter with it; where there is none, with one range alone,
        if that may be.
        """
        position = Point(fix.east, fix.north)
        axis = None
        sigma_p = fix.sigma
        kind = FixKind(int(fix.kind))
        if kind is FixKind.LOST:
            nearest = None
            if self.settings.use_single_range:
                nearest = one_range(circles.circles, self._position())
            if nearest is None:
                return FixRecord(
                    step=self._step, position=np.full(2, np.nan), sigma=np.nan, kind=kind
                )
            position, axis = nearest
            sigma_p = 0.0
            kind = FixKind.ONE_RANGE
        sigma = math.sqrt(fix_variance(sigma_p, circles.depth_difference, self._tuning))
        record = FixRecord(
            step=self._step, position=np.array(position), sigma=sigma, kind=FixKind.GATED
        )
        if not self._gate.passes(position, self._step, own.speed):
            return record
        innovation = self._filter.update_position(position, sigma, axis)
        return replace(
            record,
            kind=kind if innovation.applied else FixKind.SINGULAR,
            innovation=innovation.residual,
            innovation_covariance=innovation.covariance,
        )
