"""Fixed-lag smoothing: each position also uses the messages of some time after it.

A mixture enters the chain of estimates (`laisn.rts`) as one Gaussian with its mean and covariance.
"""

from dataclasses import replace

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.mixture import mixture_moments
from laisn.rts import Chain, smooth
from laisn.tight.estimates import TightEstimates
from laisn.tight.estimator import inflate_bias_covariance, mix_modes
from laisn.tight.model import COMPASS, LOG, Belief, Model
from laisn.tight.navigator import ScalarRecord, TightNavigator, Update, scalar_record
from laisn.tight.own_motion import moments, predict_component
from laisn.tight.settings import TightSettings

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
    """`own_motion.moments` of a belief."""
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
        """Start at a known state, or anywhere.

        Args:
            settings: as of `TightNavigator`.
            start: likewise.
            lag: how much later than a position the messages may be that it rests on [s].

        Raises:
            ValueError: the start is not four finite numbers, or the lag is not finite, zero or more.
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
