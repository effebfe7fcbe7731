"""One follower, online, step by step: the readable specification of LAISN. It could run on a vehicle as it is."""

import math
from dataclasses import replace

import numpy as np

from laisn import POSITION
from laisn.arrays import Floats
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.failure import LaisnError
from laisn.filter import Filter, Gate, expected_acceleration, larger, speed_share, turn_share
from laisn.fix import Fix, RangeCircles, fix_variance, one_range, to_circles
from laisn.geometry import Point
from laisn.messages import LeaderMessage, OwnMotion, Reception
from laisn.navigators import OnlineNavigator, require_message
from laisn.settings import NavigationSettings, Tuning
from laisn.variants import SEQUENTIAL, SINGLE

LOST = Fix(np.nan, np.nan, np.nan, float(FixKind.LOST), -1.0)


class Navigator(OnlineNavigator[Estimates]):
    """LAISN on one follower: predict, position update if a message arrived, speed update (paper, Section 2.1)."""

    def __init__(self, settings: NavigationSettings, start: Floats) -> None:
        """Start at the hydrophone's x, y [m], vx, vy [m/s], shape (4,); ValueError if they are not finite."""
        super().__init__(settings, start, settings.position_sigma0)
        sigma0 = np.repeat([settings.position_sigma0, settings.velocity_sigma0], 2)
        self._filter = Filter(settings.dt, self._state, sigma0)
        self._tuning = Tuning.of(settings)
        self._gate = Gate(self._tuning, Point(float(start[0]), float(start[1])))
        self._own: OwnMotion | None = None
        self._message: LeaderMessage | None = None

    @property
    def state(self) -> Floats:
        """x, y, vx, vy after the last step, shape (4,)."""
        return self._filter.state

    @property
    def covariance(self) -> Floats:
        """Covariance of the state, shape (4, 4)."""
        return self._filter.covariance

    def step(
        self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None
    ) -> list[FixRecord]:
        """Advance by one filter step; see `OnlineNavigator.step`. LAISN-3(1) makes up to three fixes of a message."""
        own = self._begin_step(own, duration)
        if reception is not None:
            require_message(self._step, reception.message)
            for what, values in (("range", reception.ranges), ("transmitter", reception.transmitters)):
                if values is not None and np.any(np.isinf(values)):
                    raise LaisnError(f"step {self._step}: {what} {values} is infinite; NaN stands for a missing one")
        if duration is not None:
            self._gate.lengthen(duration - self.settings.dt)
        self._filter.predict(self._acceleration(own, reception), duration)
        records = [] if reception is None else self._update_position(own, reception)
        settings = self.settings
        self._filter.update_speed(own.speed, own.heading, settings.sigma_speed, settings.sigma_heading)
        self._own = own
        return records

    def _acceleration(self, own: OwnMotion, reception: Reception | None) -> float:
        """σa [m/s²]; the leader's changes are those from message to message. A message without ranges is not used."""
        t = self._tuning
        speed_change = turn = 0.0
        if self._own is not None:
            speed_change = speed_share(self._own.speed, own.speed, t.follower_speed_max)
            turn = turn_share(self._own.heading, own.heading)
        if reception is not None and not np.all(np.isnan(reception.ranges)):
            before, now = self._message, reception.message
            if before is not None:
                speed_change = larger(speed_share(before.speed, now.speed, t.leader_speed_max), speed_change)
                turn = larger(turn_share(before.heading, now.heading), turn)
            self._message = now
        return expected_acceleration(speed_change, turn, t)

    def _position(self) -> Point:
        return Point(*self._filter.state[POSITION].tolist())

    def _update_position(self, own: OwnMotion, reception: Reception) -> list[FixRecord]:
        circles = to_circles(reception, own.depth, self.settings)
        if self.settings.variant != SEQUENTIAL:
            predicted = self._position()
            first, second, third = (circles.fix(pair, predicted, self._tuning) for pair in circles.pairs())
            records = [self._apply_fix(SINGLE[self.settings.variant]((first, second, third), predicted), circles, own)]
        else:
            # LAISN-3(1): one update after the other, the state carried along (paper, Section 2.3.1)
            records = []
            for pair in circles.pairs():
                found = circles.fix(pair, self._position(), self._tuning)
                if found.kind != FixKind.LOST:
                    records.append(self._apply_fix(found, circles, own))
            records = records or [self._apply_fix(LOST, circles, own)]
        # one range leaves the way across open, which the gate's bound must still cover
        if any(record.kind not in (FixKind.GATED, FixKind.LOST, FixKind.ONE_RANGE) for record in records):
            self._gate.accept(self._position(), self._step)
        return records

    def _apply_fix(self, found: Fix, circles: RangeCircles, own: OwnMotion) -> FixRecord:
        """Gate a fix and update the filter with it; where there is none, with one range alone, if that may be."""
        one = None
        place, kind = Point(found.east, found.north), FixKind(int(found.kind))
        if kind is FixKind.LOST:
            one = one_range(circles.circles, self._position()) if self.settings.use_single_range else None
            if one is None:
                return FixRecord(step=self._step, position=np.full(2, np.nan), sigma=np.nan, kind=kind)
            place, kind = one.place, FixKind.ONE_RANGE
        sigma_p = 0.0 if one is not None else found.sigma
        sigma = math.sqrt(fix_variance(sigma_p, circles.depth_difference, self._tuning))
        record = FixRecord(step=self._step, position=np.array(place), sigma=sigma, kind=FixKind.GATED)
        if not self._gate.passes(place, self._step, own.speed):
            return record
        if one is None:
            innovation = self._filter.update_position(place, sigma)
        else:
            innovation = self._filter.update_along(place, one.axis, sigma)
        return replace(
            record,
            kind=kind if innovation.applied else FixKind.SINGULAR,
            innovation=innovation.residual,
            innovation_covariance=innovation.covariance,
        )
