"""Compiled loops: a whole mission, as campaigns run it, and the steps of a swarm that steers by its estimates.

Both equal `TightNavigator` to the bit.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints, Record, Records, records
from laisn.compiled import compiled, copy_values
from laisn.elementary import sin_cos
from laisn.estimates import kind_of
from laisn.failure import LaisnError
from laisn.messages import Measurements
from laisn.mixture import heaviest, heaviest_hypothesis, hypothesis_weight
from laisn.navigators import MissionResult
from laisn.settings import TightSettings
from laisn.swarm import MESSAGE
from laisn.tight.estimator import place_arms, receive
from laisn.tight.model import COMPASS, LOG, Belief, Model, X, Y, model_of, new_belief
from laisn.tight.motion import moments, position, preintegrate, preintegrate_direction, velocity
from laisn.tight.ranging import Signal, new_signal

OUTCOME = np.dtype(
    [
        ("received", np.int64),  # ranges received; 0 where there is no estimate to test them
        ("used", np.int64),  # ranges that the heaviest hypothesis used
        ("squared", np.float64),  # their squared residuals in units of S; NaN if none was used
    ]
)


class MissionEstimates(NamedTuple):
    """Estimates of a mission of n steps and m messages."""

    state: Floats
    """Mean x, y [m], vx, vy [m/s] after each step, shape (n, 4); shape (n, 2) without covariances."""
    covariance: Floats
    """Covariance of the position: xx, xy, yy, shape (n, 3), [m²]; of shape (0, 3), it is left out."""
    outcome: Records
    """Records of OUTCOME for each message, shape (m,); of shape (0,), they are left out."""


@compiled
def _receive(b: Belief, m: Model, signal: Signal, message: Record, ranges: Floats, depth: float) -> int:
    """Take a record of MESSAGE and its ranges, shape (3,), at the follower's depth [m]; see `receive`."""
    signal.time, signal.east, signal.north = message.timestamp, message.east, message.north
    signal.heading, signal.speed = message.heading, message.speed
    copy_values(ranges, signal.ranges)
    place_arms(signal, m, message.pitch, message.roll, message.depth - (depth - m.hydrophone_height))
    return receive(b, m, signal)


@compiled
def record_outcome(b: Belief, m: Model, used: int, outcome: Any) -> None:
    """Write the result of a message into a record of OUTCOME; `used` is what `receive` gave."""
    outcome.received = b.received if b.alive > 0 else 0
    outcome.used, outcome.squared = 0, np.nan
    if used > 0:
        last = b.outcome[heaviest(b, m.modes, heaviest_hypothesis(b, m.modes, b.alive))]
        outcome.used = last.taken
        outcome.squared = last.squared if last.taken > 0 else np.nan


@compiled
def filter_mission(
    b: Belief,
    m: Model,
    signal: Signal,
    speed: Floats,
    heading: Floats,
    message_step: Ints,
    messages: tuple[Records, Floats, Floats],
    found: MissionEstimates,
) -> int:
    """Estimate a whole mission; the step at which a covariance was not positive definite, or 0.

    Takes a new belief, room for a message, readings of log and compass after each step, shape (n,), and of m messages,
    at steps from 1, records of MESSAGE, rows of `Ranges`, and the follower's depth [m].
    """
    i, (message, ranges, depth), (states, covariances, outcome) = 0, messages, found
    n = speed.shape[0]
    sine, cosine = np.empty(n), np.empty(n)
    # a loop of its own, which is vectorised
    for k in range(n):
        sine[k], cosine[k] = sin_cos(heading[k])
    for k in range(n):
        preintegrate_direction(b, m, speed[k], sine[k], cosine[k], m.dt)
        if i < message_step.size and message_step[i] == k + 1:
            used = _receive(b, m, signal, message[i], ranges[i], depth[i])
            if used < 0:
                return k + 1
            if outcome.shape[0] > 0:
                record_outcome(b, m, used, outcome[i])
            i += 1
        if covariances.shape[0] > 0:
            moments(b, m)
            copy_values(b.now, states[k])
            covariances[k, 0], covariances[k, 1] = b.now_covariance[0, 0], b.now_covariance[0, 1]
            covariances[k, 2] = b.now_covariance[1, 1]
        else:
            states[k, 0], states[k, 1] = position(b)
    return 0


def run_mission(
    settings: TightSettings, measurements: Measurements, start: Floats | None, *, covariance: bool = True
) -> MissionEstimates:
    """States and covariances of a mission, to the bit those of `TightNavigator`; NaN before a start is found.

    Without `covariance` neither velocities, covariances nor results of messages are computed, which take most of the
    time. ArithmeticError: a covariance is not positive definite. LaisnError: steps differ in length, or transmitters
    are on no leader's hull; `TightNavigator` takes these.
    """
    if measurements.durations is not None or measurements.transmitters is not None or settings.transmitter_offsets:
        raise LaisnError("campaigns take steps of equal length, and transmitters on the leader's hull only")
    model, n = model_of(settings), measurements.speed.size
    outcome = records(OUTCOME, len(measurements.message) if covariance else 0)
    found = MissionEstimates(np.empty((n, 4 if covariance else 2)), np.empty((n if covariance else 0, 3)), outcome)
    speed, heading = np.ascontiguousarray(measurements.speed), np.ascontiguousarray(measurements.heading)
    step = measurements.message_step
    sent = np.ascontiguousarray(measurements.message).view(MESSAGE)[:, 0]
    messages = sent, np.ascontiguousarray(measurements.ranges), measurements.last_depth[step - 1]
    known = None if start is None or not settings.known_start else (float(start[0]), float(start[1]))
    belief = new_belief(settings, model, known)
    failed = filter_mission(belief, model, new_signal(), speed, heading, step, messages, found)
    if failed:
        raise ArithmeticError(f"step {failed}: a covariance is not positive definite")
    return found


def fly(settings: TightSettings, measurements: Measurements, start: Floats) -> MissionResult:
    """One run of a campaign; errors as of `run_mission`. The mean of an update's squared residuals is its ranges."""
    found = run_mission(settings, measurements, start)
    outcome = found.outcome
    kinds = [kind_of(received, used) for received, used, _ in outcome.tolist()]
    known = outcome[np.isfinite(outcome.squared)]
    return MissionResult(found.state, found.covariance, kinds, known.squared.sum(), known.used.sum())


_APART = 2.0
"""Two hypotheses are two places, and not the halves of a wide one, where they are farther apart than this times the
sum of their standard deviations: intervals of 95 % about each do not meet."""


@compiled
def _spread(b: Belief, k: int, east: float, north: float) -> float:
    """Standard deviation of the place of component k in a direction, a unit vector [m]."""
    P = b.covariance
    return math.sqrt(east * east * P[k, X, X] + 2.0 * east * north * P[k, X, Y] + north * north * P[k, Y, Y])


@compiled
def _offset_to_likelier_hypothesis(b: Belief, m: Model, x: float, y: float) -> tuple[float, float]:
    """Offset from the mean position to that of the likelier of two hypotheses [m]; zero where they are one place."""
    first, second, most = heaviest_hypothesis(b, m.modes, b.alive), -1, -1.0
    for h in range(b.alive):
        weight = hypothesis_weight(b, m.modes, h)
        if h != first and weight > most:
            second, most = h, weight
    if second < 0:
        return 0.0, 0.0
    i, j = heaviest(b, m.modes, first), heaviest(b, m.modes, second)
    east, north = b.state[i, X] - b.state[j, X], b.state[i, Y] - b.state[j, Y]
    apart = math.sqrt(east * east + north * north)
    if apart == 0.0:
        return 0.0, 0.0
    east, north = east / apart, north / apart
    if apart < _APART * (_spread(b, i, east, north) + _spread(b, j, east, north)):
        return 0.0, 0.0
    return b.state[i, X] - x, b.state[i, Y] - y


@compiled
def _write_outputs(b: Belief, m: Model, out: Any) -> None:
    """Write biases and current (means over the mixture), its spread, and the offset to the likelier hypothesis."""
    x, y, log_bias, compass_bias = b.output.x, b.output.y, 0.0, 0.0
    xx = xy = yy = 0.0
    for k in range(b.alive * m.modes):
        w, dx, dy = b.weight[k], b.state[k, X] - x, b.state[k, Y] - y
        log_bias += w * b.state[k, LOG]
        compass_bias += w * b.state[k, COMPASS]
        xx += w * (b.covariance[k, X, X] + dx * dx)
        xy += w * (b.covariance[k, X, Y] + dx * dy)
        yy += w * (b.covariance[k, Y, Y] + dy * dy)
    half, across = 0.5 * (xx + yy), 0.5 * (xx - yy)
    out.log_bias, out.compass_bias = log_bias, compass_bias
    out.current[0], out.current[1] = b.output.v_x, b.output.v_y
    out.spread = math.sqrt(half + math.sqrt(across * across + xy * xy))
    out.to_likelier[0], out.to_likelier[1] = _offset_to_likelier_hypothesis(b, m, x, y)


class TightSwarm(NamedTuple):
    """Tightly coupled navigators of f followers, with room for a message and its result; see `Swarm`."""

    beliefs: Any
    model: Model
    signal: Signal
    outcome: Records
    gated: Ints

    @compiled
    def navigate(
        self, step: int, readings: Records, received: Bools, messages: Records, ranges: Floats, estimates: Any
    ) -> int:
        """Advance by one filter step, the same to the bit as `TightNavigator.step`; see `Swarm.navigate`."""
        beliefs, m, signal, outcomes, gated = self
        outcome = outcomes[0]
        for i in range(beliefs.size):
            b, estimate = beliefs[i], estimates[i]
            preintegrate(b, m, readings[i].speed, readings[i].heading, m.dt)
            if received[i]:
                used = _receive(b, m, signal, messages[i], ranges[i], readings[i].depth)
                if used < 0:
                    return i + 1
                record_outcome(b, m, used, outcome)
                gated[i] += outcome.received > 0 and outcome.used == 0
                _write_outputs(b, m, estimate)
            estimate.position[0], estimate.position[1] = position(b)
            estimate.velocity[0], estimate.velocity[1] = velocity(b)
        return 0


def new_tight_swarm(settings: TightSettings, starts: Floats) -> TightSwarm:
    """Navigators of followers at their starts, rows of x, y [m] first, not read where starts are unknown."""
    model = model_of(settings)
    known = [(float(row[0]), float(row[1])) if settings.known_start else None for row in starts]
    beliefs = np.stack([new_belief(settings, model, start) for start in known]).view(np.recarray)
    gated = np.zeros(len(beliefs), dtype=np.int64)
    return TightSwarm(beliefs, model, new_signal(), records(OUTCOME, 1), gated)
