"""One message: predict, split, update, prune and merge; online in `TightNavigator`, and in a loop in campaigns."""

import math

import numpy as np

from laisn.compiled import compiled
from laisn.elementary import sin_cos
from laisn.geometry import hull_to_world
from laisn.tight.belief import Belief, refresh_output
from laisn.tight.deviation import deviate
from laisn.tight.leader_way import update_current_from_leader_track
from laisn.tight.leg import average_leader_heading
from laisn.tight.model import ABSENT, COMPASS, LOG, Model, X, Y
from laisn.tight.modes import mix_modes
from laisn.tight.own_motion import begin_interval, move
from laisn.tight.ranging import Heard, update
from laisn.tight.ring import add_ring, reinitialise_if_inconsistent
from laisn.tight.sides import normalise, prune_and_merge, split

_BEND = 0.003
"""A compass bias so uncertain that the way bends by more than this is taken from the message first [m]."""
_SMOOTHING = 0.15
"""Gain of the smoothed NIS."""
_LEARNING = 0.1
"""Gain of the estimated variance of the leader's heading, which never exceeds that of the settings."""
_LEAST_LEADER_VARIANCE = math.radians(0.1) ** 2
_PATIENCE = 3
"""Messages in a row without an accepted range after which the covariance is inflated."""
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
def inflate_bias_covariance(b: Belief, m: Model, heard: Heard) -> None:
    """Inflate bias covariances before an update: by deviations, and by the error of the heading that stands for the
    broadcast one, with which b_L moves.
    """
    if m.deviation > 0.0:
        deviate(b, m, heard)
    if m.leader != ABSENT:
        for k in range(b.alive * m.modes):
            b.state[k, m.leader] += heard.shift
            b.covariance[k, m.leader, m.leader] += heard.wander


@compiled
def _propagate_iterated(b: Belief, m: Model, k: int, heard: Heard) -> bool:
    """Predict component k; where its compass bias bends the way too much, at the biases of a first update."""
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
    healthy = update(b, m, k, heard) >= 0
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
def update_leader_variance(b: Belief, m: Model) -> None:
    """Estimate the variance of the leader's heading error per message: at most the scatter of readings on legs."""
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
    """Smooth the NIS, and reinitialise or inflate a belief that the ranges do not fit; False if that failed."""
    normalised_innovation = 0.0
    for k in range(b.alive * m.modes):
        normalised_innovation += b.weight[k] * b.normalised_innovation[k]
    b.smoothed_nis += _SMOOTHING * (normalised_innovation - b.smoothed_nis)
    if received > 1 and not reinitialise_if_inconsistent(b, m, heard):
        return False
    b.missed_updates = 0.0 if used > 0 else b.missed_updates + 1.0
    if b.missed_updates >= _PATIENCE:
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
    """Take a message: predict all components to its instant and update them with its ranges.

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
        average_leader_heading(b, m, heard)
    inflate_bias_covariance(b, m, heard)
    for k in range(b.alive * m.modes):
        if not _propagate_iterated(b, m, k, heard):
            return -1
    if not math.isnan(heard.ranges[0] + heard.ranges[1]):
        split(b, m, heard)
    most = 0
    for k in range(b.alive * m.modes):
        used = update(b, m, k, heard)
        if used < 0:
            return -1
        if used > most:
            most = used
    if b.alive * m.modes > 1 and not _reweigh(b, m):
        return -1
    if m.leader != ABSENT:
        update_leader_variance(b, m)
    if b.alive > 1:
        prune_and_merge(b, m)
    if not _check_health(b, m, heard, received, most):
        return -1
    if m.current != ABSENT or m.leader != ABSENT:
        update_current_from_leader_track(b, m, heard)
    begin_interval(b)
    refresh_output(b, m)
    return most
