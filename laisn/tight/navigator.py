"""One follower, online, step by step: messages in, estimates out."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.failure import LaisnError
from laisn.geometry import place_on_body
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.mixture import mixture_moments
from laisn.navigators import FARTHEST, OnlineNavigator, require_readings, require_time
from laisn.tight import estimator, own_motion
from laisn.tight.estimates import HYPOTHESES, TightEstimates, kind_of
from laisn.tight.model import Belief, canonical, model_of, new_belief
from laisn.tight.ranging import new_heard
from laisn.tight.settings import TightSettings

ScalarRecord: TypeAlias = Any
"""A record as the only element of an array, shape (1,): a call with it takes 1 µs, with a record 30 µs."""


def scalar_record(record: Any) -> ScalarRecord:
    """A copy of a record, as an array of one; its element is a record over the same memory."""
    return np.array([record], dtype=record.dtype)


@compiled
def advance(b: ScalarRecord, m: ScalarRecord, speed: float, heading: float, dt: float) -> None:
    """`laisn.tight.own_motion.advance` of a belief."""
    own_motion.advance(b[0], m[0], speed, heading, dt)


@compiled
def moments(b: ScalarRecord, m: ScalarRecord) -> None:
    """`laisn.tight.own_motion.moments` of a belief."""
    own_motion.moments(b[0], m[0])


@compiled
def place_arms(heard: ScalarRecord, m: ScalarRecord, pitch: float, roll: float, deeper: float) -> None:
    """`laisn.tight.estimator.place_arms` of a message."""
    estimator.place_arms(heard[0], m[0], pitch, roll, deeper)


@compiled
def receive(b: ScalarRecord, m: ScalarRecord, heard: ScalarRecord) -> int:
    """`laisn.tight.estimator.receive` of a message."""
    return estimator.receive(b[0], m[0], heard[0])


_NOTHING = np.empty(0), np.empty((0, 2)), np.empty((0, 2, 2))


class Update(NamedTuple):
    """What a message changed."""

    step: int
    received: int
    """Ranges that were received from transmitters that are used."""
    used: int
    """Ranges that the heaviest hypothesis used."""
    nis: float
    """Squared residuals of the ranges used, in units of S; NaN if none was used."""
    full_state: Floats
    """Mean over the mixture, shape (12,), in the order of `TightEstimates.names`; NaN for what is no state."""
    full_sigma: Floats
    """Standard deviations of `full_state`, shape (12,)."""
    weight: Floats
    """Weights of the hypotheses, heaviest first, shape (h,)."""
    hypothesis: Floats
    """Positions of the hypotheses, shape (h, 2), [m]."""
    hypothesis_covariance: Floats
    """Covariances of the hypotheses' positions, shape (h, 2, 2), [m²]."""


def _check(step: int, own: OwnMotion, reception: Reception | None) -> None:
    """LaisnError naming what is broken of a step's readings."""
    require_readings(step, own, reception, "log")
    if reception is None:
        return
    message, places = reception.message, reception.transmitters
    if places is not None and not np.nanmax(np.abs(places), initial=0.0) <= 1e3 * FARTHEST:
        raise LaisnError(f"step {step}: a transmitter is farther than {1e3 * FARTHEST:g} m; NaN stands for none")
    if not all(map(math.isfinite, message[:6])):
        raise LaisnError(f"step {step}: leader message {message} is not finite")
    if max(abs(message.east), abs(message.north), abs(message.depth)) > 1e3 * FARTHEST:
        raise LaisnError(f"step {step}: the leader is at {message}, farther than {1e3 * FARTHEST:g} m")


def _estimates(state: Floats, covariance: Floats, updates: Sequence[Update]) -> TightEstimates:
    """The record of a mission of its states and messages."""
    m, s, h = len(updates), len(TightEstimates.names), HYPOTHESES
    weight, where, spread = np.zeros((m, h)), np.full((m, h, 2), np.nan), np.full((m, h, 2, 2), np.nan)
    for i, update in enumerate(updates):
        sides = slice(update.weight.size)
        weight[i, sides], where[i, sides] = update.weight, update.hypothesis
        spread[i, sides] = update.hypothesis_covariance
    full_state = np.array([u.full_state for u in updates]).reshape(m, s)
    full_sigma = np.array([u.full_sigma for u in updates]).reshape(m, s)
    return TightEstimates(
        state=state,
        covariance=covariance,
        fix_step=np.array([u.step for u in updates], dtype=np.int64),
        fix_position=full_state[:, :2],
        fix_sigma=np.sqrt(0.5 * np.sum(full_sigma[:, :2] ** 2, axis=1)),
        fix_kind=np.array([kind_of(u.received, u.used, bool(u.weight.size)) for u in updates], dtype=np.int64),
        innovation=np.full((m, 2), np.nan),
        innovation_covariance=np.full((m, 2, 2), np.nan),
        used=np.array([u.used for u in updates], dtype=np.int64),
        nis=np.array([u.nis for u in updates], dtype=np.float64),
        full_state=full_state,
        full_sigma=full_sigma,
        weight=weight,
        hypothesis=where,
        hypothesis_covariance=spread,
    )


class TightNavigator(OnlineNavigator):
    """The tightly coupled navigator on one follower."""

    def __init__(self, settings: TightSettings, start: Floats | None) -> None:
        """Start at a known state, or anywhere.

        Args:
            settings: sensors, and what is assumed.
            start: hydrophone's x, y [m] and velocity [m/s] at step 0, shape (4,); None, or settings that say so:
                unknown, so that estimates are NaN until the first message with two ranges, and both sides of the leader
                are possible then.

        Raises:
            ValueError: the start is not four finite numbers.
        """
        super().__init__(start if settings.known_start else None, settings.start_sigma)
        self.settings = settings
        self._model = model = model_of(settings)
        self._places = canonical(model)
        self._heard = scalar_record(new_heard())
        self._records = b, _ = scalar_record(new_belief(settings, model, self._start)), scalar_record(model)
        self._belief: Belief = b[0]
        self._moments = b["now"][0], b["now_covariance"][0]
        self._sizes = int(model.modes), int(model.states)

    def step(self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None) -> list[Update]:
        """Advance by one filter step.

        Args:
            own: measured at the end of the step; of a missing depth (NaN) the last one is used.
            reception: message and ranges, if one arrived in the step.
            duration: time that this step took, if it is another one than the settings' Δt [s].

        Returns:
            What the message changed, if there was one.

        Raises:
            LaisnError: a reading is not finite or absurd, or a duration not positive; a missing range is NaN.
            ArithmeticError: the covariance is not positive definite any more; the navigator is not to be used further.
        """
        self._step += 1
        _check(self._step, own, reception)
        own = self._with_depth(own)
        require_time(self._step, duration)
        advance(*self._records, own.speed, own.heading, self.settings.dt if duration is None else duration)
        updates = [] if reception is None else [self._receive(own, reception)]
        moments(*self._records)
        self._state, self._covariance = (moment.copy() for moment in self._moments)
        return updates

    def run(self, measurements: Measurements) -> TightEstimates:
        """Estimates of a whole mission from the start, step by step; the same to the bit as `step` in a loop.

        Raises:
            ValueError: the measurements have another filter step than the settings, or the navigator is under way.
            LaisnError: as `step`.
        """
        return _estimates(*self._take(measurements, self.settings.dt))

    def _place_anywhere(self, own: OwnMotion, reception: Reception) -> bool:
        """Place transmitters that are on no hull, or elsewhere on it; False if there are none."""
        message, settings, places = reception.message, self.settings, reception.transmitters
        if places is None and not settings.transmitter_offsets:
            return False
        if places is None:
            offsets = np.full((3, 3), np.nan)
            offsets[: len(settings.transmitter_offsets)] = settings.transmitter_offsets
            known = settings.use_attitude and not np.isnan(message.pitch + message.roll)
            tilt = (message.pitch, message.roll) if known else (0.0, 0.0)
            places = place_on_body((message.east, message.north, message.depth), (message.heading, *tilt), offsets)
        elif not settings.assume.exact_leader:
            raise LaisnError(
                f"step {self._step}: the message places its transmitters, whom no compass of a leader turns; set "
                "assume.exact_leader"
            )
        hydrophone = own.depth - settings.hydrophone_height
        self._heard["arms"][0] = places - np.array([message.east, message.north, hydrophone])
        self._heard["ranges"][0, np.any(np.isnan(self._heard["arms"][0]), axis=1)] = np.nan
        return True

    def _receive(self, own: OwnMotion, reception: Reception) -> Update:
        message, settings = reception.message, self.settings
        heard, (belief, model) = self._heard, self._records
        heard["time"], heard["east"], heard["north"] = message.timestamp, message.east, message.north
        heard["heading"], heard["speed"], heard["ranges"] = message.heading, message.speed, reception.ranges
        if not self._place_anywhere(own, reception):
            deeper = message.depth - (own.depth - settings.hydrophone_height)
            place_arms(heard, model, message.pitch, message.roll, deeper)
        received = int(np.count_nonzero(np.isfinite(heard["ranges"][0, : settings.transmitters])))
        used = receive(belief, model, heard)
        if used < 0:
            raise ArithmeticError(f"step {self._step}: a covariance is not positive definite after {reception}")
        return self._update(received, used)

    def _update(self, received: int, used: int) -> Update:
        (b, _), (modes, n) = self._records, self._sizes
        components = int(b["alive"][0]) * modes
        full_state, full_sigma = np.full((2, len(TightEstimates.names)), np.nan)
        if not components:
            return Update(self._step, received, 0, np.nan, full_state, full_sigma, *_NOTHING)
        weight, states = b["weight"][0, :components], b["state"][0, :components, :n]
        covariances = b["covariance"][0, :components, :n, :n]
        mean = weight @ states
        variance = np.diagonal(covariances, axis1=1, axis2=2)
        full_state[self._places] = mean
        full_sigma[self._places] = np.sqrt(weight @ (variance + (states - mean) ** 2))
        by_side = weight.reshape(-1, modes)
        of_side = by_side.sum(axis=1)
        sides = sorted(range(of_side.size), key=lambda h: -of_side[h])
        top = sides[0] * modes + int(np.argmax(by_side[sides[0]]))
        taken = int(b["outcome"]["taken"][0, top]) if used else 0
        where, spread = [], []
        for h in sides:
            part = slice(h * modes, (h + 1) * modes)
            centre, covariance = mixture_moments(by_side[h] / of_side[h], states[part, :2], covariances[part, :2, :2])
            where.append(centre)
            spread.append(covariance)
        return Update(
            step=self._step,
            received=received,
            used=taken,
            nis=float(b["outcome"]["squared"][0, top]) if taken else float("nan"),
            full_state=full_state,
            full_sigma=full_sigma,
            weight=of_side[sides],
            hypothesis=np.array(where),
            hypothesis_covariance=np.array(spread),
        )
