"""One follower, step by step: messages in, estimates out; online, or smoothed with messages up to a lag later.

Smoothing carries later messages back along a chain of Gaussians (`laisn.mixture.smooth`), which a mixture enters as one
with its mean and covariance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.estimates import FixKind, FixRecord, TightEstimates, kind_of
from laisn.failure import LaisnError
from laisn.geometry import given_transmitters
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.mixture import Chain, mixture_moments, smooth
from laisn.navigators import FARTHEST, OnlineNavigator, require_message, require_readings
from laisn.settings import TightSettings
from laisn.tight.estimator import inflate_bias_covariance, mix_modes, place_arms, receive
from laisn.tight.model import COMPASS, LOG, Belief, Model, model_of, new_belief, prior_sigmas
from laisn.tight.motion import moments, predict_component, preintegrate
from laisn.tight.ranging import new_signal

ScalarRecord: TypeAlias = Any
"""A record as the only element of an array, shape (1,): a call with it takes 1 µs, with a record 30 µs."""


def scalar_record(record: Any) -> ScalarRecord:
    """A copy of a record, as an array of one; its element is a record over the same memory."""
    return np.array([record], dtype=record.dtype)


@compiled
def predict(b: ScalarRecord, m: ScalarRecord, speed: float, heading: float, dt: float) -> None:
    """Advance a belief by the readings of a step, as `motion.preintegrate`, and its moments."""
    preintegrate(b[0], m[0], speed, heading, dt)
    moments(b[0], m[0])


@compiled
def update(
    b: ScalarRecord, m: ScalarRecord, signal: ScalarRecord, tilt: tuple[float, float], deeper: float, on_hull: bool
) -> int:
    """Update a belief with a message, as `estimator.receive`, and its moments.

    Transmitters `on_hull` are placed by the leader's tilt [rad] and depth below [m]; otherwise their arms are in the
    message.
    """
    if on_hull:
        place_arms(signal[0], m[0], tilt[0], tilt[1], deeper)
    used = receive(b[0], m[0], signal[0])
    moments(b[0], m[0])
    return used


@dataclass(frozen=True, kw_only=True)
class Update(FixRecord):
    """The result of a message: position and σ are those of the mean over the mixture; fields as of `TightEstimates`."""

    received: int
    """Ranges that were received from transmitters that are used."""
    used: int = 0
    nis: float = math.nan
    full_state: Floats
    full_sigma: Floats
    weight: Floats = field(default_factory=lambda: np.empty(0))
    hypothesis: Floats = field(default_factory=lambda: np.empty((0, 2)))
    hypothesis_covariance: Floats = field(default_factory=lambda: np.empty((0, 2, 2)))


def _check(step: int, own: OwnMotion, reception: Reception | None) -> None:
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
        """Start at the hydrophone's x, y [m] and velocity [m/s] at step 0, shape (4,), or anywhere.

        None, or `known_start` False: estimates are NaN until the first message with two ranges, after which both sides
        of the leader are possible. ValueError: the start is not four finite numbers.
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
        common: dict[str, Any] = {"step": self._step, "position": full_state[:2], "received": received}
        common |= {"full_state": full_state, "full_sigma": full_sigma}
        if not components:
            return Update(**common, sigma=math.nan, kind=FixKind.LOST)
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
            **common,
            sigma=float(np.sqrt(0.5 * np.sum(full_sigma[:2] ** 2))),
            kind=kind_of(received, taken),
            used=taken,
            nis=float(b["outcome"]["squared"][0, top]) if taken else math.nan,
            weight=of_side[sides],
            hypothesis=np.array(where),
            hypothesis_covariance=np.array(spread),
        )


_SAME_TIME = 5e-4
"""A message that is later than the lag by less than this is within it: times are sums [s]."""


_SUMS = ("ax", "ay", "bx", "by", "nxx", "nxy", "nyy", "time")
"""Fields of a belief's motion that add up over the steps of a way."""


@compiled
def _predict_components(b: ScalarRecord, m: ScalarRecord, count: int, log_bias: float, compass_bias: float) -> None:
    """Predict the first components over the way in the belief's motion, linearised at some biases."""
    for k in range(count):
        predict_component(b[0], m[0], k, log_bias, compass_bias)


@compiled
def _moments(b: ScalarRecord, m: ScalarRecord) -> None:
    moments(b[0], m[0])


def _merged(b: Belief, m: Model) -> tuple[Floats, Floats]:
    """Mean and covariance of a belief's mixture, shapes (s,) and (s, s)."""
    count, n = int(b.alive) * m.modes, m.states
    return mixture_moments(b.weight[:count], b.state[:count, :n], b.covariance[:count, :n, :n])


class _Leg:
    """The way from one message to the next, linearised at the biases that the next one leaves."""

    def __init__(self, b: ScalarRecord, signal: ScalarRecord, m: Model, biases: tuple[float, float]) -> None:
        """Take the belief just before a message, which is used up, and the message."""
        self._biases, self._n, count = biases, int(m.states), int(m.modes)
        self._records, before = (b, scalar_record(m)), b[0]
        # views of the belief, which is room to move components from here on
        self._motion, self._state = b["motion"], b["state"][0, :, : self._n]
        self._spread, self._rows = b["covariance"][0, :count, : self._n, : self._n], b["rows"][0, :4, : self._n]
        self._moments = b["now"][0], b["now_covariance"][0]
        self._whole = self._motion.copy()
        self.mean, self.covariance = _merged(before, m)
        mix_modes(before, m)
        modes = before.weight[: int(before.alive) * count].reshape(-1, count).sum(axis=0)
        self._modes = modes / modes.sum()
        before.alive = 1
        before.weight[:count] = self._modes
        self.onward = self.covariance @ self._matrix().T
        self._begin()
        inflate_bias_covariance(before, m, signal[0])
        self.predicted, self.predicted_covariance = self._predicted()

    def _begin(self) -> None:
        """Put the merged Gaussian back to the beginning of the way."""
        self._state[: self._modes.size], self._spread[:] = self.mean, self.covariance

    def _predicted(self) -> tuple[Floats, Floats]:
        """Mean and covariance after the way in the belief's motion."""
        _predict_components(*self._records, self._modes.size, *self._biases)
        return self._state[0].copy(), np.einsum("k,kij->ij", self._modes, self._spread)

    def _matrix(self) -> Floats:
        """Transition matrix F of the way in the belief's motion: a prediction is affine in the state."""
        n, x = self._n, self._state
        x[: n + 1] = np.eye(n + 1, n)
        _predict_components(*self._records, n + 1, *self._biases)
        return np.array((x[:n] - x[n]).T)

    def at(self, motion: ScalarRecord) -> tuple[Floats, Floats, Floats]:
        """Where the way so far is `motion`: mean and covariance of x, y, vx, vy, and theirs with the state at the end.

        Shapes (4,), (4, 4) and (4, s). Mean and covariance are the filter's but for the biases at which they are
        linearised: those that the end is linearised at. Otherwise a difference of the two could be negative.
        """
        for name in _SUMS:
            self._motion[name] = self._whole[name] - motion[name]
        rest = self._matrix()
        self._motion[:] = motion
        self._begin()
        _moments(*self._records)
        rows, mean, covariance = self._rows.copy(), *(moment.copy() for moment in self._moments)
        reading = covariance[2:, 2:] - rows[2:] @ self.covariance @ rows[2:].T
        # the position is two of the states that have come so far; velocities depend on those that stay as they are
        rows[:2] = np.eye(2, self._n)
        moved, spread = self._predicted()
        mean[:2], covariance = moved[:2], rows @ spread @ rows.T
        covariance[2:, 2:] += reading
        return mean, covariance, rows @ spread @ rest.T


class SmoothingNavigator(TightNavigator):
    """The tightly coupled navigator with fixed-lag smoothing: `run` also uses the messages up to a lag later."""

    def __init__(self, settings: TightSettings, start: Floats | None, lag: float) -> None:
        """Start as `TightNavigator`; messages may be later than a position that rests on them by `lag` [s]. ValueError
        as there, or if the lag is not finite, zero or more.
        """
        if not 0.0 <= lag < np.inf:
            raise ValueError(f"lag is {lag} s, expected a finite time, zero or more")
        super().__init__(settings, start)
        self._lag = lag
        self._motions: list[ScalarRecord] = []
        self._latest: list[int] = []
        self._steps = [0] if self._belief.alive else []
        self._before: list[tuple[ScalarRecord, ScalarRecord]] = []

    def step(self, own: OwnMotion, reception: Reception | None = None, duration: float | None = None) -> list[Update]:
        """Advance by one filter step, as `TightNavigator.step`."""
        updates = super().step(own, reception, duration)
        self._motions.append(self._records[0]["motion"].copy())
        self._latest.append(len(self._steps) - 1)
        return updates

    def _receive(self, own: OwnMotion, reception: Reception) -> Update:
        before = self._records[0].copy()
        update = super()._receive(own, reception)
        # the preintegration is reset after a message that was used
        if self._records[0]["motion"]["time"][0] == 0.0:
            self._steps.append(self._step)
            if before["alive"][0]:
                self._before.append((before, self._signal.copy()))
        return update

    def run(self, measurements: Measurements) -> TightEstimates:
        """Smoothed states and covariances of a whole mission; all else is the filter's. Errors: `TightNavigator.run`.

        Steps before the first estimate of an unknown start stay NaN.
        """
        estimates = super().run(measurements)
        if not self._before:
            return estimates
        legs, chain = self._chain()
        times = np.concatenate([[0.0], measurements.time])
        latest = np.array(self._latest)
        last = np.searchsorted(times[self._steps], measurements.time + self._lag + _SAME_TIME, side="right") - 1
        mean, covariance = estimates.state.copy(), estimates.covariance.copy()
        onward = np.zeros((latest.size, 4, self._model.states))
        last[latest < 0] = latest[latest < 0]
        for i in np.flatnonzero(last > latest).tolist():
            mean[i], covariance[i], onward[i] = legs[latest[i]].at(self._motions[i])
        state, spread = smooth(chain, latest, last, (mean, covariance), onward)
        return replace(estimates, state=state, covariance=spread)

    def _chain(self) -> tuple[list[_Leg], Chain]:
        """Ways between the messages, and the beliefs after them."""
        mean, covariance = _merged(self._belief, self._model)
        nothing = np.zeros_like(covariance)
        beliefs, predicted, onward, legs = [(mean, covariance)], [], [nothing], []
        # from the end: a way is linearised at the biases that stand at its end
        for before, signal in reversed(self._before):
            leg = _Leg(before, signal, self._model, (float(mean[LOG]), float(mean[COMPASS])))
            mean = leg.mean
            beliefs.append((leg.mean, leg.covariance))
            predicted.append((leg.predicted, leg.predicted_covariance))
            onward.append(leg.onward)
            legs.append(leg)
        predicted.append(beliefs[-1])
        parts = (*zip(*beliefs, strict=True), *zip(*predicted, strict=True), onward)
        return legs[::-1], Chain(*(np.array(part[::-1]) for part in parts))
