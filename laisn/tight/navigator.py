"""One follower, online, step by step: messages in, estimates out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.estimates import FixKind, FixRecord
from laisn.failure import LaisnError
from laisn.geometry import given_transmitters
from laisn.messages import OwnMotion, Reception
from laisn.mixture import mixture_moments
from laisn.navigators import FARTHEST, OnlineNavigator, require_message, require_readings
from laisn.tight.estimates import TightEstimates, kind_of
from laisn.tight.estimator import place_arms, receive
from laisn.tight.model import Belief, model_of, new_belief, prior_sigmas
from laisn.tight.own_motion import moments, preintegrate
from laisn.tight.ranging import new_signal
from laisn.tight.settings import TightSettings

ScalarRecord: TypeAlias = Any
"""A record as the only element of an array, shape (1,): a call with it takes 1 µs, with a record 30 µs."""


def scalar_record(record: Any) -> ScalarRecord:
    """A copy of a record, as an array of one; its element is a record over the same memory."""
    return np.array([record], dtype=record.dtype)


@compiled
def predict(b: ScalarRecord, m: ScalarRecord, speed: float, heading: float, dt: float) -> None:
    """Advance a belief by the readings of a step, as `own_motion.preintegrate`, and its moments."""
    preintegrate(b[0], m[0], speed, heading, dt)
    moments(b[0], m[0])


@compiled
def update(
    b: ScalarRecord, m: ScalarRecord, signal: ScalarRecord, tilt: tuple[float, float], deeper: float, on_hull: bool
) -> int:
    """Update a belief with a message, as `estimator.receive`, and its moments.

    The transmitters are placed by the leader's pitch and roll [rad], and by how much deeper it is [m], if they are
    `on_hull`; otherwise their arms are in the message.
    """
    if on_hull:
        place_arms(signal[0], m[0], tilt[0], tilt[1], deeper)
    used = receive(b[0], m[0], signal[0])
    moments(b[0], m[0])
    return used


@dataclass(frozen=True, kw_only=True)
class Update(FixRecord):
    """The result of a message: position and σ are those of the mean over the mixture."""

    received: int
    """Ranges that were received from transmitters that are used."""
    used: int = 0
    """Ranges that the heaviest hypothesis used."""
    nis: float = math.nan
    """Squared residuals of the ranges used, in units of S; NaN if none was used."""
    full_state: Floats
    """Mean over the mixture, shape (12,), in the order of `TightEstimates.names`; NaN for what is no state."""
    full_sigma: Floats
    """Standard deviations of `full_state`, shape (12,)."""
    weight: Floats = field(default_factory=lambda: np.empty(0))
    """Weights of the hypotheses, heaviest first, shape (h,)."""
    hypothesis: Floats = field(default_factory=lambda: np.empty((0, 2)))
    """Positions of the hypotheses, shape (h, 2), [m]."""
    hypothesis_covariance: Floats = field(default_factory=lambda: np.empty((0, 2, 2)))
    """Covariances of the hypotheses' positions, shape (h, 2, 2), [m²]."""


def _check(step: int, own: OwnMotion, reception: Reception | None) -> None:
    """LaisnError naming what is broken of a step's readings."""
    require_readings(step, own, reception, "log")
    if reception is None:
        return
    message, places = reception.message, reception.transmitters
    if places is not None and not np.nanmax(np.abs(places), initial=0.0) <= 1e3 * FARTHEST:
        raise LaisnError(f"step {step}: a transmitter is farther than {1e3 * FARTHEST:g} m; NaN stands for none")
    require_message(step, message)
    if max(abs(message.east), abs(message.north), abs(message.depth)) > 1e3 * FARTHEST:
        raise LaisnError(f"step {step}: the leader is at {message}, farther than {1e3 * FARTHEST:g} m")


class TightNavigator(OnlineNavigator[TightEstimates]):
    """The tightly coupled navigator on one follower."""

    def __init__(self, settings: TightSettings, start: Floats | None) -> None:
        """Start at a known state, or anywhere.

        Args:
            settings: sensors, and what is assumed.
            start: hydrophone's x, y [m] and velocity [m/s] at step 0, shape (4,); None, or `known_start` False:
                unknown, so that estimates are NaN until the first message with two ranges, after which both sides of
                the leader are possible.

        Raises:
            ValueError: the start is not four finite numbers.
        """
        super().__init__(settings, start if settings.known_start else None, settings.start_sigma)
        self._model = model = model_of(settings)
        self._places = np.array(list(prior_sigmas(settings)))
        self._signal = scalar_record(new_signal())
        self._records = b, _ = scalar_record(new_belief(settings, model, self._start)), scalar_record(model)
        self._belief: Belief = b[0]
        # from here on views of the belief, which hold the moments of the mixture after each step
        moments_now = b["now"][0], b["now_covariance"][0]
        moments_now[0][:], moments_now[1][:] = self._state, self._covariance
        self._state, self._covariance = moments_now
        self._sizes = int(model.modes), int(model.states)

    def step(self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None) -> list[Update]:
        """Advance by one filter step; see `OnlineNavigator.step`."""
        own = self._begin_step(own, duration)
        _check(self._step, own, reception)
        predict(*self._records, own.speed, own.heading, self.settings.dt if duration is None else duration)
        return [] if reception is None else [self._receive(own, reception)]

    def _estimates(self, state: Floats, covariance: Floats, fixes: Sequence[Update]) -> TightEstimates:
        details: dict[str, Any] = {}
        for column in TightEstimates.details():
            nothing: Any = 0 if column.attribute in ("used", "weight") else np.nan
            rows = np.full((len(fixes), *column.shape), nothing, np.int64 if column.integer else np.float64)
            for row, fix in zip(rows[..., None], fixes, strict=True):
                # of fewer hypotheses than there may be, the first rows
                value = np.asarray(getattr(fix, column.attribute))[..., None]
                row[: len(value)] = value
            details[column.attribute] = rows
        return TightEstimates.of(state, covariance, fixes, **details)

    def _receive(self, own: OwnMotion, reception: Reception) -> Update:
        """Take a message; a range to a transmitter whose position is unknown counts as not received."""
        message, settings, signal, (belief, model) = reception.message, self.settings, self._signal, self._records
        signal["time"], signal["east"], signal["north"] = message.timestamp, message.east, message.north
        signal["heading"], signal["speed"], signal["ranges"] = message.heading, message.speed, reception.ranges
        hydrophone, places = own.depth - settings.hydrophone_height, given_transmitters(reception, settings)
        if places is not None:
            if reception.transmitters is not None and not settings.assume.exact_leader:
                raise LaisnError(
                    f"step {self._step}: the message places its transmitters, whom no compass of a leader turns; set "
                    "assume.exact_leader"
                )
            signal["arms"][0] = places - np.array([message.east, message.north, hydrophone])
            signal["ranges"][0, np.any(np.isnan(signal["arms"][0]), axis=1)] = np.nan
        tilt, deeper = (message.pitch, message.roll), message.depth - hydrophone
        used = update(belief, model, signal, tilt, deeper, places is None)
        if used < 0:
            raise ArithmeticError(f"step {self._step}: a covariance is not positive definite after {reception}")
        return self._update(int(belief["received"][0]), used)

    def _update(self, received: int, used: int) -> Update:
        (b, _), (modes, n) = self._records, self._sizes
        components = int(b["alive"][0]) * modes
        full_state, full_sigma = np.full((2, len(TightEstimates.names)), np.nan)
        if not components:
            return Update(
                step=self._step, position=full_state[:2], sigma=math.nan, kind=FixKind.LOST, received=received,
                full_state=full_state, full_sigma=full_sigma,
            )  # fmt: skip
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
            position=full_state[:2],
            sigma=float(np.sqrt(0.5 * np.sum(full_sigma[:2] ** 2))),
            kind=kind_of(received, taken),
            received=received,
            used=taken,
            nis=float(b["outcome"]["squared"][0, top]) if taken else float("nan"),
            full_state=full_state,
            full_sigma=full_sigma,
            weight=of_side[sides],
            hypothesis=np.array(where),
            hypothesis_covariance=np.array(spread),
        )
