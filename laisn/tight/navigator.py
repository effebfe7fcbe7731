"""One follower, online, step by step: messages in, estimates out."""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.tight.belief import KEPT, Belief, new_belief
from laisn.tight.estimates import TightEstimates, state_names
from laisn.tight.estimator import place_arms, receive
from laisn.tight.model import model_of
from laisn.tight.own_motion import advance, moments
from laisn.tight.ranging import new_heard
from laisn.tight.settings import TightSettings
from laisn.tight.sides import heaviest, hypothesis_weight

FASTEST = 50.0
"""A reading of the log beyond this is broken, not fast [m/s]."""
FARTHEST = 1e5
"""A range, coordinate or depth beyond this is broken, not far [m]."""


_NOTHING = np.empty(0), np.empty((0, 2)), np.empty((0, 2, 2))


class Update(NamedTuple):
    """What a message changed."""

    step: int
    used: int
    """Ranges that the heaviest hypothesis used."""
    nis: float
    """Squared residuals of the ranges used, in units of S; NaN if none was used."""
    full_state: Floats
    """Mean over the mixture, shape (s,)."""
    full_sigma: Floats
    """Standard deviations of `full_state`, shape (s,)."""
    weight: Floats
    """Weights of the hypotheses, heaviest first, shape (h,)."""
    hypothesis: Floats
    """Positions of the hypotheses, shape (h, 2), [m]."""
    hypothesis_covariance: Floats
    """Covariances of the hypotheses' positions, shape (h, 2, 2), [m²]."""


def _check(step: int, own: OwnMotion, reception: Reception | None) -> None:
    """LaisnError naming what is broken of a step's readings."""
    if not np.all(np.isfinite(own)):
        raise LaisnError(f"step {step}: own motion {own} is not finite")
    if not -FASTEST <= own.speed <= FASTEST:
        raise LaisnError(f"step {step}: the log reads {own.speed:g} m/s, expected −{FASTEST:g} … {FASTEST:g} m/s")
    if reception is None:
        return
    message, ranges = reception.message, reception.ranges
    if reception.transmitters is not None:
        raise LaisnError(f"step {step}: the message places its transmitters; this navigator knows them on a hull only")
    if not np.all(np.isfinite(message[:6])):
        raise LaisnError(f"step {step}: leader message {message} is not finite")
    if max(abs(message.east), abs(message.north), abs(message.depth)) > 1e3 * FARTHEST:
        raise LaisnError(f"step {step}: the leader is at {message}, farther than {1e3 * FARTHEST:g} m")
    for value in ranges:
        if value < 0.0 or value > FARTHEST:
            raise LaisnError(f"step {step}: ranges {ranges}, expected 0 … {FARTHEST:g} m, NaN for a missing one")


class TightNavigator:
    """The tightly coupled navigator on one follower."""

    def __init__(self, settings: TightSettings, start: Floats | None) -> None:
        """Start at a known state, or anywhere.

        Args:
            settings: sensors, and what is assumed.
            start: hydrophone's x, y [m] and velocity [m/s] at step 0, shape (4,); None: unknown, so that estimates are
                NaN until the first message with two ranges, and both sides of the leader are possible then.

        Raises:
            ValueError: the start is not four finite numbers.
        """
        self.settings = settings
        self._model = model_of(settings)
        self._state, self._covariance = np.full(4, np.nan), np.full((4, 4), np.nan)
        known = None
        if start is not None:
            start = np.asarray(start, dtype=np.float64)
            if start.shape != (4,) or not np.all(np.isfinite(start)):
                raise ValueError(f"start is {start}, expected four finite numbers x, y, vx, vy")
            known = (float(start[0]), float(start[1]))
            self._state, self._covariance = start.copy(), np.diag(np.repeat([settings.start_sigma**2, 0.0], 2))
        self._belief: Belief = new_belief(settings, self._model, known)
        self._heard = new_heard()
        self._step = 0

    @property
    def state(self) -> Floats:
        """x, y, vx, vy after the last step, shape (4,): mean over the mixture."""
        return self._state.copy()

    @property
    def covariance(self) -> Floats:
        """Covariance of `state` over the mixture, shape (4, 4)."""
        return self._covariance.copy()

    def step(self, own: OwnMotion, reception: Reception | None = None) -> list[Update]:
        """Advance by one filter step.

        Args:
            own: measured at the end of the step.
            reception: message and ranges, if one arrived in the step.

        Returns:
            What the message changed, if there was one.

        Raises:
            LaisnError: a reading is not finite or absurd; a missing range is NaN.
            ArithmeticError: the covariance is not positive definite any more; the navigator is not to be used further.
        """
        self._step += 1
        _check(self._step, own, reception)
        advance(self._belief, self._model, own.speed, own.heading)
        updates = [] if reception is None else [self._receive(own, reception)]
        moments(self._belief, self._model)
        self._state, self._covariance = self._belief.now.copy(), self._belief.now_covariance.copy()
        return updates

    def run(self, measurements: Measurements) -> TightEstimates:
        """Estimates of a whole mission from the start, step by step; the same to the bit as `step` in a loop.

        Raises:
            ValueError: the measurements have another filter step than the settings, or the navigator is under way.
            LaisnError: their steps differ in length; and as `step`.
        """
        if self._step:
            raise ValueError(f"this navigator is at step {self._step} already; a mission needs a new one")
        if abs(measurements.dt - self.settings.dt) > 1e-9:
            raise ValueError(f"measurements every {measurements.dt:g} s, but the filter steps {self.settings.dt:g} s")
        if measurements.durations is not None:
            raise LaisnError("the filter steps are not equally long; this navigator needs equal ones")
        n = measurements.speed.size
        state, covariance = np.empty((n, 4)), np.empty((n, 4, 4))
        updates: list[Update] = []
        for i, (own, reception) in enumerate(measurements.steps()):
            updates += self.step(own, reception)
            state[i], covariance[i] = self._state, self._covariance
        m, names = len(updates), state_names(self._model)
        weight, where = np.zeros((m, KEPT)), np.full((m, KEPT, 2), np.nan)
        spread = np.full((m, KEPT, 2, 2), np.nan)
        for i, update in enumerate(updates):
            h = update.weight.size
            weight[i, :h], where[i, :h], spread[i, :h] = update.weight, update.hypothesis, update.hypothesis_covariance
        return TightEstimates(
            state=state,
            covariance=covariance,
            message_step=np.array([u.step for u in updates], dtype=np.int64),
            used=np.array([u.used for u in updates], dtype=np.int64),
            nis=np.array([u.nis for u in updates], dtype=np.float64),
            names=names,
            full_state=np.array([u.full_state for u in updates]).reshape(m, len(names)),
            full_sigma=np.array([u.full_sigma for u in updates]).reshape(m, len(names)),
            weight=weight,
            hypothesis=where,
            hypothesis_covariance=spread,
        )

    def _receive(self, own: OwnMotion, reception: Reception) -> Update:
        message, settings = reception.message, self.settings
        heard = self._heard
        heard.time, heard.east, heard.north = message.timestamp, message.east, message.north
        heard.heading, heard.speed, heard.ranges = message.heading, message.speed, reception.ranges
        deeper = message.depth - (own.depth - settings.hydrophone_height)
        place_arms(heard, self._model, message.pitch, message.roll, deeper)
        used = receive(self._belief, self._model, heard)
        if used < 0:
            raise ArithmeticError(f"step {self._step}: a covariance is not positive definite after {reception}")
        return self._update(used)

    def _update(self, used: int) -> Update:
        b, modes = self._belief, self._model.modes
        components, n = int(b.alive) * modes, self._model.size
        weight, states = b.weight[:components], b.state[:components, :n]
        mean = weight @ states
        variance = np.diagonal(b.covariance[:components, :n, :n], axis1=1, axis2=2)
        variance = weight @ (variance + (states - mean) ** 2)
        if not components:
            return Update(self._step, 0, np.nan, np.full(n, np.nan), np.full(n, np.nan), *_NOTHING)
        sides = sorted(range(int(b.alive)), key=lambda h: -hypothesis_weight(b, self._model, h))
        top = heaviest(b, self._model, sides[0])
        where, spread = [], []
        for h in sides:
            part = slice(h * modes, (h + 1) * modes)
            share = b.weight[part] / b.weight[part].sum()
            centre = share @ b.state[part, :2]
            off = b.state[part, :2] - centre
            where.append(centre)
            spread.append(np.einsum("k,kij->ij", share, b.covariance[part, :2, :2] + off[:, :, None] * off[:, None, :]))
        return Update(
            step=self._step,
            used=used,
            nis=float(b.squared[top]) if used else float("nan"),
            full_state=mean,
            full_sigma=np.sqrt(variance),
            weight=np.array([hypothesis_weight(b, self._model, h) for h in sides]),
            hypothesis=np.array(where),
            hypothesis_covariance=np.array(spread),
        )
