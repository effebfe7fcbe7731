"""One message: move, split, learn, tidy. What `TightNavigator` does online and campaigns do in a loop."""

import math

import numpy as np

from laisn.compiled import compiled
from laisn.elementary import sin_cos
from laisn.geometry import hull_to_world
from laisn.tight.belief import Belief, refresh_output
from laisn.tight.deviation import deviate
from laisn.tight.leader_way import watch_leader
from laisn.tight.leg import steady
from laisn.tight.model import ABSENT, COMPASS, LOG, Model, X, Y
from laisn.tight.modes import mix_modes
from laisn.tight.own_motion import begin_interval, move
from laisn.tight.ranging import Heard, learn
from laisn.tight.ring import add_ring, think_again
from laisn.tight.sides import normalise, split, tidy

_BEND = 0.003
"""A compass bias so uncertain that the way bends by more than this is taken from the message first [m]."""
_SMOOTHING = 0.15
"""Gain of the smoothed surprise."""
_LEARNING = 0.1
"""Gain of the learnt variance of the leader's heading, which never exceeds that of the settings."""
_LEAST_LEADER_VARIANCE = math.radians(0.1) ** 2
_PATIENCE = 3
"""Messages in a row without a believed range after which the belief is widened."""
_WIDER_POSITION, _WIDER_COMPASS = 1.0, math.radians(2.0) ** 2
"""Variances that each widening adds, of position along each axis [m²] and of the compass's bias [rad²]."""


@compiled
def place_arms(heard: Heard, m: Model, pitch: float, roll: float, deeper: float) -> None:
    """Fill in the arms of the transmitters at the broadcast heading.

    Args:
        heard: a message; `arms` is overwritten, and without a depth no range counts as received.
        m: settings.
        pitch: as broadcast [rad] …
        roll: … likewise; the leader is taken as level where either is NaN.
        deeper: how much deeper the leader's origin is than the hydrophone [m]; NaN if that is not known.
    """
    arms = heard.arms
    if deeper != deeper:
        heard.ranges[:] = np.nan
    sine, cosine = sin_cos(heard.heading)
    ahead, aside = (sine, cosine, 0.0), (-cosine, sine, 0.0)
    if m.use_attitude and pitch == pitch and roll == roll:
        attitude = (heard.heading, pitch, roll)
        ahead, aside = hull_to_world(1.0, 0.0, attitude), hull_to_world(0.0, 1.0, attitude)
    half = 0.5 * m.baseline
    for i in range(m.transmitters):
        forward = -half if i == 0 else (half if i == 1 else 0.0)
        port = m.middle_offset if i == 2 else 0.0
        arms[i, 0] = forward * ahead[0] + port * aside[0]
        arms[i, 1] = forward * ahead[1] + port * aside[1]
        arms[i, 2] = deeper - (forward * ahead[2] + port * aside[2])


@compiled
def loosen(b: Belief, m: Model, heard: Heard) -> None:
    """What a message does to biases before it is learnt from: deviations, and b_L, which goes with the heading that
    stands for the broadcast one.
    """
    if m.deviation > 0.0:
        deviate(b, m, heard)
    if m.leader != ABSENT:
        for k in range(b.alive * m.modes):
            b.state[k, m.leader] += heard.shift
            b.covariance[k, m.leader, m.leader] += heard.wander


@compiled
def _move_and_look(b: Belief, m: Model, k: int, heard: Heard) -> bool:
    """Move component k; where its compass bias bends the way too much, at the biases that the message suggests."""
    way = math.sqrt(b.motion.ax**2 + b.motion.ay**2)
    x, P, n = b.state, b.covariance, m.states
    log_bias, compass_bias = x[k, LOG], x[k, COMPASS]
    if 0.5 * P[k, COMPASS, COMPASS] * way < _BEND:
        move(b, m, k, log_bias, compass_bias)
        return True
    for i in range(n):
        b.before_state[i] = x[k, i]
        for j in range(n):
            b.before_covariance[i, j] = P[k, i, j]
    move(b, m, k, log_bias, compass_bias)
    healthy = learn(b, m, k, heard) >= 0
    log_bias, compass_bias = x[k, LOG], x[k, COMPASS]
    for i in range(n):
        x[k, i] = b.before_state[i]
        for j in range(n):
            P[k, i, j] = b.before_covariance[i, j]
    move(b, m, k, log_bias, compass_bias)
    return healthy


@compiled
def _reweigh(b: Belief, m: Model) -> bool:
    """Multiply the weights by the evidence; False if none is left."""
    components = b.alive * m.modes
    best = -math.inf
    for k in range(components):
        if b.weight[k] > 0.0 and b.evidence[k] > best:
            best = b.evidence[k]
    if not math.isfinite(best):
        return False
    for k in range(components):
        b.weight[k] *= math.exp(b.evidence[k] - best)
    normalise(b, m)
    return True


@compiled
def learn_leader(b: Belief, m: Model) -> None:
    """Learn how much the leader's heading errs from message to message: at most what readings on legs scatter by."""
    excess = 0.0
    for k in range(b.alive * m.modes):
        excess += b.weight[k] * b.turn_excess[k]
    variance = min(b.leader_variance + _LEARNING * excess, b.leader.scatter)
    b.leader_variance = min(max(variance, _LEAST_LEADER_VARIANCE), m.leader_variance)


@compiled
def count_received(m: Model, heard: Heard) -> int:
    """How many ranges of transmitters that are used there are."""
    count = 0
    for i in range(m.transmitters):
        if heard.ranges[i] == heard.ranges[i]:
            count += 1
    return count


@compiled
def _check_health(b: Belief, m: Model, heard: Heard, received: int, used: int) -> bool:
    """Remember how much the ranges surprise, and doubt a belief that they do not fit; False if that failed."""
    surprise = 0.0
    for k in range(b.alive * m.modes):
        surprise += b.weight[k] * b.surprise[k]
    b.smoothed += _SMOOTHING * (surprise - b.smoothed)
    if received > 1 and not think_again(b, m, heard):
        return False
    b.rejected = 0.0 if used > 0 else b.rejected + 1.0
    if b.rejected >= _PATIENCE:
        for k in range(b.alive * m.modes):
            b.covariance[k, X, X] += _WIDER_POSITION
            b.covariance[k, Y, Y] += _WIDER_POSITION
            b.covariance[k, COMPASS, COMPASS] += _WIDER_COMPASS
    return True


@compiled
def _begin(b: Belief, m: Model, heard: Heard, received: int) -> int:
    """Begin with this message, if it is enough; what `receive` returns."""
    if received < 2:
        return 0
    if not add_ring(b, m, heard, 1.0):
        return -1
    # all of them were used, but nothing had been expected of them that they could have missed
    b.taken[: b.alive * m.modes] = received
    b.squared[: b.alive * m.modes] = np.nan
    begin_interval(b)
    refresh_output(b, m)
    return received


@compiled
def receive(b: Belief, m: Model, heard: Heard) -> int:
    """Take a message: all components move to its instant and learn from its ranges.

    A message of which no ping was heard says nothing: the way since the last one goes on. With an unknown start the
    first message with two ranges makes the belief.

    Returns:
        The most ranges that a hypothesis used; −1 if a covariance was not positive definite, after which the belief is
        not to be used any more.
    """
    received = count_received(m, heard)
    if received == 0:
        return 0
    if b.alive == 0:
        return _begin(b, m, heard, received)
    mix_modes(b, m)
    if m.leader != ABSENT:
        steady(b, m, heard)
    loosen(b, m, heard)
    for k in range(b.alive * m.modes):
        if not _move_and_look(b, m, k, heard):
            return -1
    if not math.isnan(heard.ranges[0] + heard.ranges[1]):
        split(b, m, heard)
    most = 0
    for k in range(b.alive * m.modes):
        used = learn(b, m, k, heard)
        if used < 0:
            return -1
        if used > most:
            most = used
    if b.alive * m.modes > 1 and not _reweigh(b, m):
        return -1
    if m.leader != ABSENT:
        learn_leader(b, m)
    if b.alive > 1:
        tidy(b, m)
    if not _check_health(b, m, heard, received, most):
        return -1
    if m.current != ABSENT or m.leader != ABSENT:
        watch_leader(b, m, heard)
    begin_interval(b)
    refresh_output(b, m)
    return most
