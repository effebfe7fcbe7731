"""Followers with the tightly coupled navigator: one, step by step or smoothed; a mission of a
campaign; a swarm.

All equal `TightNavigator` to the bit. Smoothing carries messages up to a lag later back along a
chain of Gaussians (`laisn.mixture.smooth`), which a mixture enters as one with its mean and
covariance.
"""

import math
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from laisn.arrays import Bools, Floats, Ints, Record, RecordFields, Records, records
from laisn.compiled import compiled, compiled_apart, copy_values
from laisn.errors import LaisnError
from laisn.estimates import FixKind, FixRecord, TightEstimates
from laisn.geometry import given_transmitters, place_transmitters
from laisn.held import borrowed_values
from laisn.messages import Measurements, OwnMotion, Reception
from laisn.mixture import (
    Chain,
    heaviest,
    heaviest_hypothesis,
    hypothesis_weight,
    mixture_moments,
    smooth,
)
from laisn.navigators import MissionResult, OnlineNavigator
from laisn.settings import TightSettings
from laisn.swarm import MESSAGE, SwarmRecord, new_fix
from laisn.tight.details import FIX, kind_of_message, write_fix
from laisn.tight.estimator import (
    inflate_bias_covariance,
    largest_echo_excess,
    mix_modes,
    place_arms,
    receive,
    receive_beside,
)
from laisn.tight.model import (
    COMPASS_BIAS,
    LOG_BIAS,
    X,
    Y,
    model_beside,
    model_of,
    new_belief,
    prior_sigmas,
)
from laisn.tight.motion import (
    moments,
    position,
    predict_component,
    preintegrate,
    preintegrate_direction,
    velocity,
)
from laisn.tight.ranging import new_range_message
from laisn.tight.records import BELIEF, GaussianMixture, Model, RangeMessage
from laisn.vector_math import sin_cos

ScalarRecord: TypeAlias = npt.NDArray[np.void]
"""A record as the only element of an array, shape (1,): a call with it takes 1 µs, with a record
30 µs.
"""


def scalar_record(record: RecordFields) -> ScalarRecord:
    """A copy of a record, as an array of one; its element is a record over the same memory."""
    return np.array([record], dtype=record.dtype)


@compiled
def predict(b: ScalarRecord, m: ScalarRecord, speed: float, heading: float, dt: float) -> None:
    """Advance a belief by the readings of a step, as `motion.preintegrate`, and its moments."""
    preintegrate(b[0], m[0], speed, heading, dt)
    moments(b[0], m[0])


@compiled
def _copy_message(m: Model, message: Record, ranges: Floats, range_message: RangeMessage) -> None:
    """Put a record of MESSAGE and its ranges, shape (3,), into a message with its ranges."""
    range_message.time = message.timestamp
    range_message.east = message.east
    range_message.north = message.north
    range_message.heading = message.heading
    range_message.speed = message.speed
    range_message.depth = message.depth
    range_message.leader_position_variance = m.leader_position_variance
    if message.position_sigma == message.position_sigma:
        range_message.leader_position_variance = message.position_sigma * message.position_sigma
    copy_values(ranges, range_message.ranges)


@compiled
def _receive(
    b: GaussianMixture,
    m: Model,
    range_message: RangeMessage,
    message: Record,
    ranges: Floats,
    depth: float,
    on_hull: bool,
) -> int:
    """Take a record of MESSAGE and its ranges, shape (3,), at the follower's depth [m]; see
    `receive`. Transmitters are placed on the leader's hull, or lie in `range_message`.
    """
    _copy_message(m, message, ranges, range_message)
    leader_below = message.depth - (depth - m.hydrophone_height)
    if on_hull:
        place_arms(range_message, m, message.pitch, message.roll, leader_below)
    else:
        range_message.echo_span = largest_echo_excess(m, range_message, leader_below)
    return receive(b, m, range_message)


@compiled
def update(
    b: ScalarRecord,
    m: ScalarRecord,
    range_message: ScalarRecord,
    sent: Records,
    ranges: Floats,
    depth: float,
    on_hull: bool,
) -> int:
    """Update a belief with the only one of messages, as `_receive`, and its moments."""
    used = _receive(b[0], m[0], range_message[0], sent[0], ranges, depth, on_hull)
    moments(b[0], m[0])
    return used


@compiled
def update_beside(
    b: ScalarRecord,
    m: ScalarRecord,
    link_model: ScalarRecord,
    range_message: ScalarRecord,
    sent: Records,
    ranges: Floats,
) -> int:
    """Update a belief with the only one of messages of a further link, of the model `link_model`,
    whose transmitters lie in `range_message`, as of `receive_beside`, and its moments.
    """
    _copy_message(link_model[0], sent[0], ranges, range_message[0])
    used = receive_beside(b[0], m[0], link_model[0], range_message[0])
    moments(b[0], m[0])
    return used


@compiled
def write_fix_of_message(
    b: ScalarRecord, m: ScalarRecord, indices: Ints, used: int, fixes: Records
) -> None:
    """Write the result of a message into the only one of fixes; see `details.write_fix`."""
    write_fix(b[0], m[0], indices, used, fixes[0])


def reported_states(settings: TightSettings) -> Ints:
    """Indices in `TightEstimates.names` of the states that are reported, the first ones of a
    belief; errors of broadcast positions and the speed come after them.
    """
    n_reported = len(TightEstimates.names)
    return np.array(
        [state for state in prior_sigmas(settings) if state < n_reported], dtype=np.int64
    )


class TightNavigator(OnlineNavigator[TightEstimates]):
    """The tightly coupled navigator on one follower; the details of a fix are as of
    `TightEstimates`.
    """

    ESTIMATES = TightEstimates

    def __init__(self, settings: TightSettings, start: Floats | None) -> None:
        """Start at the hydrophone's x, y [m] and velocity [m/s] at step 0, shape (4,). None, or
        `known_start` False: anywhere; estimates are NaN until the first message with two ranges.
        LaisnError: it is not four finite numbers.
        """
        super().__init__(settings, start if settings.known_start else None, settings.start_sigma)
        model = model_of(settings)
        self._model = model
        self._reported_indices = reported_states(settings)
        self._message = scalar_record(new_range_message())
        # of further links
        self._message_beside = scalar_record(new_range_message())
        self._model_beside = scalar_record(model_beside(model))
        b = scalar_record(new_belief(settings, model, self._start))
        self._records = b, scalar_record(model)
        self._belief: GaussianMixture = b[0]
        # from here on views of the belief, which hold the moments of the mixture after each step
        b["mixture_mean"][0] = self._state
        b["mixture_covariance"][0] = self._covariance
        self._state = b["mixture_mean"][0]
        self._covariance = b["mixture_covariance"][0]

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        predict(*self._records, own.speed, own.heading, dt)
        fixes = [] if reception is None else [self._receive(own, reception)]
        for received in own.receptions.values():
            self._receive_beside(own, received)
        return fixes

    def _receive(self, own: OwnMotion, reception: Reception) -> FixRecord:
        """Take a message; a range to a transmitter whose position is unknown counts as not
        received.
        """
        message = reception.message
        places = given_transmitters(reception, self.settings)
        ranges = np.array(reception.ranges, dtype=np.float64)
        if places is not None:
            if reception.transmitters is not None and not self.settings.assume.exact_leader:
                raise LaisnError(
                    f"step {self._step}: the message places its transmitters, whom no compass of a "
                    "leader turns; set assume.exact_leader"
                )
            arms = places - (
                message.east,
                message.north,
                own.depth - self.settings.hydrophone_height,
            )
            ranges[np.isnan(arms).any(axis=1)] = np.nan
            self._message["arms"] = arms
        sent = np.array([message], dtype=MESSAGE)
        used = update(*self._records, self._message, sent, ranges, float(own.depth), places is None)
        if used < 0:
            raise ArithmeticError(
                f"step {self._step}: a covariance is not positive definite after {reception}"
            )
        return self._fix(used)

    def _receive_beside(self, own: OwnMotion, reception: Reception) -> None:
        """Take a message of a further link."""
        message = reception.message
        ranges = np.array(reception.ranges, dtype=np.float64)
        arms = place_transmitters(reception, self.settings) - (
            message.east,
            message.north,
            own.depth - self.settings.hydrophone_height,
        )
        ranges[np.isnan(arms).any(axis=1)] = np.nan
        self._message_beside["arms"] = arms
        # who is at rest states an exact place
        at_rest = reception.transmitters is not None
        variance = 0.0 if at_rest else self._model.leader_position_variance
        self._model_beside["leader_position_variance"] = variance
        sent = np.array([message], dtype=MESSAGE)
        used = update_beside(*self._records, self._model_beside, self._message_beside, sent, ranges)
        if used < 0:
            raise ArithmeticError(
                f"step {self._step}: a covariance is not positive definite after {reception}"
            )

    def _fix(self, used: int) -> FixRecord:
        """The result of a message of which so many ranges were used by any hypothesis."""
        fixes = records(FIX, 1)
        write_fix_of_message(*self._records, self._reported_indices, used, fixes)
        fix = fixes[0]
        details = {
            column.attribute: fix[column.attribute] for column in TightEstimates.DETAILS.columns
        }
        return FixRecord(
            step=self._step,
            position=fix.fix_position.copy(),
            sigma=float(fix.fix_sigma),
            kind=FixKind(int(fix.fix_kind)),
            details=details,
        )


# a message that is later than the lag by less than this is within it: times are sums [s]
_SAME_TIME = 5e-4
# of a belief's motion over the steps of a way
_SUMS = "ax", "ay", "bx", "by", "nxx", "nxy", "nyy", "time"


@compiled
def _predict_components(
    b: ScalarRecord, m: ScalarRecord, count: int, log_bias: float, compass_bias: float
) -> None:
    """Predict the first components over the way in the belief's motion, linearised at some
    biases.
    """
    for k in range(count):
        predict_component(b[0], m[0], k, log_bias, compass_bias)


@compiled
def _moments(b: ScalarRecord, m: ScalarRecord) -> None:
    moments(b[0], m[0])


def _merged(b: GaussianMixture, m: Model) -> tuple[Floats, Floats]:
    """Mean and covariance of a belief's mixture, shapes (s,) and (s, s)."""
    count = int(b.n_hypotheses) * m.modes
    n = m.n_states
    return mixture_moments(b.weight[:count], b.state[:count, :n], b.covariance[:count, :n, :n])


class _Leg:
    """The way from one message to the next, linearised at the biases that the next one leaves."""

    def __init__(
        self, b: ScalarRecord, range_message: ScalarRecord, m: Model, biases: tuple[float, float]
    ) -> None:
        """Take the belief just before a message, which is used up, and the message."""
        self._biases = biases
        self._n = int(m.n_states)
        count = int(m.modes)
        self._records = (b, scalar_record(m))
        belief = b[0]
        # views of the belief, which is room to move components from here on
        self._state = b["state"][0, :, : self._n]
        self._motion = b["motion"]
        self._spread = b["covariance"][0, :count, : self._n, : self._n]
        self._rows = b["rows"][0, :4, : self._n]
        self._moments = b["mixture_mean"][0], b["mixture_covariance"][0]
        self._whole_motion = self._motion.copy()
        self.mean, self.covariance = _merged(belief, m)
        mix_modes(belief, m)
        mode_weights = (
            belief.weight[: int(belief.n_hypotheses) * count].reshape(-1, count).sum(axis=0)
        )
        self._mode_weights = mode_weights / mode_weights.sum()
        belief.n_hypotheses = 1
        belief.weight[:count] = self._mode_weights
        # covariance of the state at the beginning of the way with that at its end
        self.cross_to_next = self.covariance @ self._transition().T
        self._begin()
        inflate_bias_covariance(belief, m, range_message[0])
        self.predicted, self.predicted_covariance = self._predicted()

    def _begin(self) -> None:
        """Put the merged Gaussian back to the beginning of the way."""
        self._state[: self._mode_weights.size] = self.mean
        self._spread[:] = self.covariance

    def _predicted(self) -> tuple[Floats, Floats]:
        """Mean and covariance after the way in the belief's motion."""
        _predict_components(*self._records, self._mode_weights.size, *self._biases)
        return self._state[0].copy(), np.einsum("k,kij->ij", self._mode_weights, self._spread)

    def _transition(self) -> Floats:
        """Transition matrix F of the way in the belief's motion: a prediction is affine in the
        state.
        """
        n = self._n
        x = self._state
        x[: n + 1] = np.eye(n + 1, n)
        _predict_components(*self._records, n + 1, *self._biases)
        return np.array((x[:n] - x[n]).T)

    def at(self, motion: ScalarRecord) -> tuple[Floats, Floats, Floats]:
        """Where the way so far is `motion`: mean and covariance of x, y, vx, vy, and theirs with
        the state at the end, linearised at the same biases, so that no difference of covariances is
        negative.
        """
        for name in _SUMS:
            self._motion[name] = self._whole_motion[name] - motion[name]
        transition = self._transition()
        self._motion[:] = motion
        self._begin()
        _moments(*self._records)
        rows = self._rows.copy()
        mean, covariance = (moment.copy() for moment in self._moments)
        reading_covariance = covariance[2:, 2:] - rows[2:] @ self.covariance @ rows[2:].T
        # the position is two of the states that have come so far; velocities depend on those that
        # stay as they are
        rows[:2] = np.eye(2, self._n)
        state, spread = self._predicted()
        mean[:2] = state[:2]
        covariance = rows @ spread @ rows.T
        covariance[2:, 2:] += reading_covariance
        return mean, covariance, rows @ spread @ transition.T


class SmoothingNavigator(TightNavigator):
    """The tightly coupled navigator with fixed-lag smoothing: `run` also uses the messages up to
    a lag later.
    """

    def __init__(self, settings: TightSettings, start: Floats | None, lag: float) -> None:
        """Start as `TightNavigator`; messages may be later than a position that rests on them by
        `lag` [s].
        """
        if settings.assume.steady_speed:
            raise LaisnError(
                "assume.steady_speed is true, expected false: smoothing takes log and compass as "
                "inputs"
            )
        if not 0.0 <= lag < np.inf:
            raise LaisnError(f"lag is {lag} s, expected a finite time, zero or more")
        super().__init__(settings, start)
        self._lag = lag
        # of each step so far: the belief's motion since the last message that was used, and the
        # index in the chain of the last belief at or before its end; −1: there is none yet
        self._motions: list[ScalarRecord] = []
        self._latest: list[int] = []
        # steps of the chain's beliefs: 0 for a known start, and those of messages that were used
        self._steps = [0] if self._belief.n_hypotheses else []
        # of each message that was used: the belief just before it, and its message with the ranges
        self._priors: list[tuple[ScalarRecord, ScalarRecord]] = []

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        if own.receptions:
            raise LaisnError(
                f"step {self._step}: smoothing takes the messages of one link; set "
                "navigation.further_links = []"
            )
        fixes = super()._navigate(own, reception, dt)
        self._motions.append(self._records[0]["motion"].copy())
        self._latest.append(len(self._steps) - 1)
        return fixes

    def _receive(self, own: OwnMotion, reception: Reception) -> FixRecord:
        prior = self._records[0].copy()
        fix = super()._receive(own, reception)
        # the preintegration is reset after a message that was used
        if self._records[0]["motion"]["time"][0] == 0.0:
            self._steps.append(self._step)
            if prior["n_hypotheses"][0]:
                self._priors.append((prior, self._message.copy()))
        return fix

    def run(self, measurements: Measurements) -> TightEstimates:
        """Smoothed states and covariances of a whole mission; all else, and errors, are the
        filter's.
        """
        estimates = super().run(measurements)
        if not self._priors:
            return estimates
        legs, chain = self._chain()
        times = np.concatenate([[0.0], measurements.time])
        latest = np.array(self._latest)
        last_to_use = (
            np.searchsorted(
                times[self._steps], measurements.time + self._lag + _SAME_TIME, side="right"
            )
            - 1
        )
        mean = estimates.state.copy()
        covariance = estimates.covariance.copy()
        cross_to_next = np.zeros((latest.size, 4, self._model.n_states))
        last_to_use[latest < 0] = latest[latest < 0]
        for i in np.flatnonzero(last_to_use > latest).tolist():
            mean[i], covariance[i], cross_to_next[i] = legs[latest[i]].at(self._motions[i])
        state, spread = smooth(chain, latest, last_to_use, (mean, covariance), cross_to_next)
        return replace(estimates, state=state, covariance=spread)

    def _chain(self) -> tuple[list[_Leg], Chain]:
        """Ways between the messages, and the beliefs after them."""
        final_mean, final_covariance = _merged(self._belief, self._model)
        legs = list[_Leg]()
        # from the end: a way is linearised at the biases that stand at its end
        for before, range_message in reversed(self._priors):
            mean = legs[0].mean if legs else final_mean
            legs.insert(
                0,
                _Leg(
                    before,
                    range_message,
                    self._model,
                    (float(mean[LOG_BIAS]), float(mean[COMPASS_BIAS])),
                ),
            )
        return legs, Chain(
            mean=np.array([*(leg.mean for leg in legs), final_mean]),
            covariance=np.array([*(leg.covariance for leg in legs), final_covariance]),
            predicted=np.array([legs[0].mean, *(leg.predicted for leg in legs)]),
            predicted_covariance=np.array(
                [legs[0].covariance, *(leg.predicted_covariance for leg in legs)]
            ),
            cross_to_next=np.array(
                [*(leg.cross_to_next for leg in legs), np.zeros_like(final_covariance)]
            ),
        )


Messages = tuple[Ints, Records, Floats, Floats]
"""Steps of messages, these as records of MESSAGE, rows of `Ranges`, and the follower's depth
[m].
"""


class MissionEstimates(NamedTuple):
    """Estimates of a mission of n steps and m messages."""

    # mean x, y [m], vx, vy [m/s] after each step, shape (n, 4); shape (n, 2) without covariances
    state: Floats
    # of the position: xx, xy, yy, shape (n, 3), [m²]; of shape (0, 3), it is left out
    covariance: Floats
    # of each message ranges received, or 0 without an estimate to test them; those that the
    # heaviest hypothesis used; and their squared residuals in units of S, NaN if none was used:
    # shape (m, 3); of shape (0, 3), left out
    outcome: Floats


@compiled
def outcome_of(b: GaussianMixture, m: Model, used: int) -> tuple[int, int, float]:
    """Result of a message, as of `MissionEstimates`; `used` is what `receive` gave."""
    if used > 0:
        last = b.outcome[heaviest(b, m.modes, heaviest_hypothesis(b, m.modes, b.n_hypotheses))]
        return b.received, last.n_used, last.nis_sum if last.n_used > 0 else np.nan
    return b.received if b.n_hypotheses > 0 else 0, 0, np.nan


@compiled
def filter_mission(
    b: GaussianMixture,
    m: Model,
    range_message: RangeMessage,
    readings: tuple[Floats, Floats],
    messages: Messages,
    estimates: MissionEstimates,
) -> int:
    """Estimate a whole mission of a new belief from its readings of log and compass; the step at
    which a covariance was not positive definite, or 0.
    """
    speed, heading = readings
    message_step, message, ranges, depth = messages
    states, covariances, outcome = estimates
    i = 0
    n = speed.shape[0]
    sine, cosine = np.empty(n), np.empty(n)
    # a loop of its own, which is vectorised
    for k in range(n):
        sine[k], cosine[k] = sin_cos(heading[k])
    for k in range(n):
        preintegrate_direction(b, m, speed[k], sine[k], cosine[k], m.dt)
        if i < message_step.size and message_step[i] == k + 1:
            used = _receive(b, m, range_message, message[i], ranges[i], depth[i], True)
            if used < 0:
                return k + 1
            if outcome.shape[0] > 0:
                outcome[i, 0], outcome[i, 1], outcome[i, 2] = outcome_of(b, m, used)
            i += 1
        if covariances.shape[0] > 0:
            moments(b, m)
            copy_values(b.mixture_mean, states[k])
            covariances[k, 0] = b.mixture_covariance[0, 0]
            covariances[k, 1] = b.mixture_covariance[0, 1]
            covariances[k, 2] = b.mixture_covariance[1, 1]
        else:
            states[k, 0], states[k, 1] = position(b)
    return 0


def run_mission(
    settings: TightSettings,
    measurements: Measurements,
    start: Floats | None,
    *,
    covariance: bool = True,
) -> MissionEstimates:
    """States and covariances of a mission, to the bit those of `TightNavigator`; NaN before a start
    is found.

    Without `covariance` neither velocities, covariances nor results of messages are computed, which
    take most of the time. ArithmeticError: a covariance is not positive definite. LaisnError: steps
    differ in length, or transmitters are on no leader's hull; `TightNavigator` takes these.
    """
    if (
        measurements.durations is not None
        or measurements.transmitters is not None
        or settings.transmitter_offsets
    ):
        raise LaisnError(
            "campaigns take steps of equal length, and transmitters on the leader's hull only"
        )
    model = model_of(settings)
    n = measurements.speed.size
    outcome = np.empty((len(measurements.message) if covariance else 0, 3))
    estimates = MissionEstimates(
        np.empty((n, 4 if covariance else 2)), np.empty((n if covariance else 0, 3)), outcome
    )
    readings = (measurements.speed, measurements.heading)
    step = measurements.message_step
    sent = np.ascontiguousarray(measurements.message).view(MESSAGE)[:, 0]
    messages = (
        step,
        sent,
        np.ascontiguousarray(measurements.ranges),
        measurements.last_depth[step - 1],
    )
    initial = (
        None if start is None or not settings.known_start else (float(start[0]), float(start[1]))
    )
    belief = new_belief(settings, model, initial)
    failed = filter_mission(belief, model, new_range_message(), readings, messages, estimates)
    if failed:
        raise ArithmeticError(f"step {failed}: a covariance is not positive definite")
    return estimates


def fly(settings: TightSettings, measurements: Measurements, start: Floats) -> MissionResult:
    """One run of a campaign; errors as of `run_mission`. The degrees of freedom of the squared
    residuals of an update are the ranges that it used, as of `TightEstimates.used`.
    """
    estimates = run_mission(settings, measurements, start)
    received, used, squared = estimates.outcome.T
    kinds = [kind_of_message(int(r), int(u)) for r, u in zip(received, used, strict=True)]
    has_nis = np.isfinite(squared)
    return MissionResult(
        estimates.state, estimates.covariance, kinds, squared[has_nis].sum(), used[has_nis].sum()
    )


# Two hypotheses are two places, and not the halves of a wide one, where intervals of 95 % about
# each do not meet.
_SEPARATION = 2.0


@compiled
def _spread(b: GaussianMixture, k: int, east: float, north: float) -> float:
    """Standard deviation of the place of component k [m] along a unit vector (east, north)."""
    P = b.covariance
    return math.sqrt(
        east * east * P[k, X, X] + 2.0 * east * north * P[k, X, Y] + north * north * P[k, Y, Y]
    )


@compiled
def _offset_to_likelier_hypothesis(
    b: GaussianMixture, m: Model, x: float, y: float
) -> tuple[float, float]:
    """Offset from the mean position to that of the likelier of two hypotheses [m]; zero where
    they are one place.
    """
    first = heaviest_hypothesis(b, m.modes, b.n_hypotheses)
    second = -1
    largest = -1.0
    for h in range(b.n_hypotheses):
        weight = hypothesis_weight(b, m.modes, h)
        if h != first and weight > largest:
            second = h
            largest = weight
    if second < 0:
        return 0.0, 0.0
    i = heaviest(b, m.modes, first)
    j = heaviest(b, m.modes, second)
    east, north = b.state[i, X] - b.state[j, X], b.state[i, Y] - b.state[j, Y]
    distance = math.sqrt(east * east + north * north)
    if distance == 0.0:
        return 0.0, 0.0
    east, north = east / distance, north / distance
    if distance < _SEPARATION * (_spread(b, i, east, north) + _spread(b, j, east, north)):
        return 0.0, 0.0
    return b.state[i, X] - x, b.state[i, Y] - y


@compiled
def _write_outputs(b: GaussianMixture, m: Model, out: Record) -> None:
    """Write biases and current (means over the mixture), its spread, and the offset to the
    likelier hypothesis.
    """
    x = b.output.x
    y = b.output.y
    log_bias = 0.0
    compass_bias = 0.0
    xx = xy = yy = 0.0
    for k in range(b.n_hypotheses * m.modes):
        w = b.weight[k]
        dx = b.state[k, X] - x
        dy = b.state[k, Y] - y
        log_bias += w * b.state[k, LOG_BIAS]
        compass_bias += w * b.state[k, COMPASS_BIAS]
        xx += w * (b.covariance[k, X, X] + dx * dx)
        xy += w * (b.covariance[k, X, Y] + dx * dy)
        yy += w * (b.covariance[k, Y, Y] + dy * dy)
    mean_variance = 0.5 * (xx + yy)
    half_difference = 0.5 * (xx - yy)
    out.log_bias = log_bias
    out.compass_bias = compass_bias
    out.current[0] = b.output.v_x
    out.current[1] = b.output.v_y
    out.position_sigma = math.sqrt(
        mean_variance + math.sqrt(half_difference * half_difference + xy * xy)
    )
    out.offset_to_likelier[0], out.offset_to_likelier[1] = _offset_to_likelier_hypothesis(
        b, m, x, y
    )


@compiled
def _record_state(
    b: GaussianMixture, m: Model, estimate: Record, i: int, step: int, record: SwarmRecord
) -> None:
    """Record state and covariance of follower i after a step."""
    state = record.state[i, step - 1]
    if record.covariance.shape[1] > 0:
        moments(b, m)
        copy_values(b.mixture_mean, state)
        for j in range(4):
            copy_values(b.mixture_covariance[j], record.covariance[i, step - 1, j])
    else:
        for j in range(2):
            state[j] = estimate.position[j]
            state[2 + j] = estimate.velocity[j]


class TightSwarm(NamedTuple):
    """Tightly coupled navigators of f followers, with room for a message; see `Swarm`."""

    beliefs: Records  # of BELIEF, shape (f,)
    model: Model
    range_message: RangeMessage  # room for the message of one follower after the other
    gated: Ints  # messages of each follower whose ranges were all rejected so far, shape (f,)
    reported_indices: Ints  # of the states in `TightEstimates.names`, shape (n,)

    @compiled_apart
    def navigate(
        self,
        step: int,
        readings: Records,
        received: Bools,
        messages: Records,
        ranges: Floats,
        estimates: Records,
        record: SwarmRecord,
    ) -> int:
        """Advance by one filter step, the same to the bit as `TightNavigator.step`; see
        `Swarm.navigate`.

        Counts no references to arrays, which would take time at each step.
        """
        return _navigate(
            borrowed_values(self),
            step,
            (borrowed_values(readings), borrowed_values(received)),
            (borrowed_values(messages), borrowed_values(ranges)),
            borrowed_values(estimates),
            borrowed_values(record),
        )


@compiled
def _navigate(
    swarm: TightSwarm,
    step: int,
    measured: tuple[Records, Bools],
    sent: tuple[Records, Floats],
    estimates: Records,
    record: SwarmRecord,
) -> int:
    """`TightSwarm.navigate` with readings and whether a message is in, and with messages and
    ranges.
    """
    readings, received = measured
    messages, ranges = sent
    beliefs = swarm.beliefs
    m = swarm.model
    records_covariance = record.covariance.shape[1] > 0
    # loops of their own: what is due at each step would wait for all that a message needs at hand
    for i in range(beliefs.size):
        preintegrate(beliefs[i], m, readings[i].speed, readings[i].heading, m.dt)
    for i in range(beliefs.size):
        if not received[i]:
            continue
        b = beliefs[i]
        depth = readings[i].depth
        used = _receive(b, m, swarm.range_message, messages[i], ranges[i], depth, True)
        if used < 0:
            return i + 1
        received_ranges, used_ranges, _ = outcome_of(b, m, used)
        swarm.gated[i] += received_ranges > 0 and used_ranges == 0
        _write_outputs(b, m, estimates[i])
        if records_covariance:
            fix = record.fix[i, new_fix(record, i, step, 0)]
            write_fix(b, m, swarm.reported_indices, used, fix)
    for i in range(beliefs.size):
        b = beliefs[i]
        estimate = estimates[i]
        estimate.position[0], estimate.position[1] = position(b)
        estimate.velocity[0], estimate.velocity[1] = velocity(b)
        _record_state(b, m, estimate, i, step, record)
    return 0


def new_tight_swarm(settings: TightSettings, starts: Floats) -> TightSwarm:
    """Navigators of followers at their starts, rows of x, y [m] first, not read where starts are
    unknown.
    """
    model = model_of(settings)
    initial = [(float(row[0]), float(row[1])) if settings.known_start else None for row in starts]
    beliefs = np.array(
        [new_belief(settings, model, start) for start in initial], dtype=BELIEF
    ).view(np.recarray)
    gated = np.zeros(len(beliefs), dtype=np.int64)
    return TightSwarm(beliefs, model, new_range_message(), gated, reported_states(settings))
