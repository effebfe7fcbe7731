"""One message: predict, split, update, prune and merge; online in `TightNavigator`, and in a loop in campaigns."""

import math
from typing import Any

import numpy as np

from laisn.compiled import compiled
from laisn.elementary import half_turn_angle, sin_cos
from laisn.geometry import Turn, level_arms, tilted_arms, turn
from laisn.mixture import blend, copy_component, normalise
from laisn.tight.hypotheses import add_ring, prune_and_merge, reinitialise_if_inconsistent, split
from laisn.tight.model import ABSENT, COMPASS, LOG, SPARE, Belief, Model, X, Y, refresh_output
from laisn.tight.motion import (
    average_leader_heading,
    predict_component,
    reset_preintegration,
    update_current_from_leader_track,
)
from laisn.tight.ranging import Signal, update

_BEND = 0.003
"""A compass bias so uncertain that the way bends by more than this is taken from the message first [m]."""
_SMOOTHING = 0.15
_VARIANCE_GAIN = 0.1
"""Gain of the estimated variance of the leader's heading, which never exceeds that of the settings."""
_LEAST_LEADER_VARIANCE = math.radians(0.1) ** 2
_MOST_MISSED = 3
"""Messages in a row without an accepted range after which the covariance is inflated."""
_ADDED_POSITION, _ADDED_COMPASS = 1.0, math.radians(2.0) ** 2
"""Variances that each widening adds, of position along each axis [m²] and of the compass's bias [rad²]."""

_TURN, _LEADER_TURN = 0.1, 0.15
"""Turns up to these change nothing, one's own and the leader's, as readings err by a part of them [rad]."""
_SETTLED = 10.0
"""A turn is over where it has not gone on for so long [s]."""


@compiled
def place_arms(signal: Signal, m: Model, pitch: float, roll: float, deeper: float) -> None:
    """Fill in the arms of the transmitters at the broadcast heading, pitch and roll [rad] (level where either is NaN).

    The leader's origin is `deeper` than the hydrophone [m]; NaN: unknown, so that no range counts as received.
    """
    if deeper != deeper:
        for i in range(3):
            signal.ranges[i] = np.nan
    heading = Turn(*sin_cos(signal.heading))
    placed = level_arms(m.baseline, m.middle_offset, heading)
    if m.use_attitude and pitch == pitch and roll == roll:
        placed = tilted_arms(m.baseline, m.middle_offset, heading, turn(pitch), turn(roll))
    (east, north, up), (middle_east, middle_north, middle_up), arms = placed.front, placed.middle, signal.arms
    arms[0, 0], arms[0, 1], arms[0, 2] = -east, -north, deeper + up
    arms[1, 0], arms[1, 1], arms[1, 2] = east, north, deeper - up
    arms[2, 0], arms[2, 1], arms[2, 2] = middle_east, middle_north, deeper - middle_up


@compiled
def mix_modes(b: Belief, m: Model) -> None:
    """Blend the two modes of each hypothesis, slow and quick drift of biases; nothing where there is one.

    The interacting multiple model of Blom & Bar-Shalom (Bar-Shalom, Li & Kirubarajan 2001): each hypothesis has a
    component of each mode, and before a message either becomes a blend of both, by the chance that the drift has
    changed its mode.
    """
    if m.modes == 1:
        return
    # a chain of two states that changes at the same rate either way (Poisson)
    stay = 0.5 + 0.5 * math.exp(-2.0 * m.mode_switches * b.motion.time)
    for h in range(b.alive):
        slow, quick = 2 * h, 2 * h + 1
        weight, other = b.weight[slow], b.weight[quick]
        new_slow, new_quick = stay * weight + (1.0 - stay) * other, stay * other + (1.0 - stay) * weight
        if new_slow <= 0.0 or new_quick <= 0.0:
            continue
        copy_component(b, slow, SPARE)
        blend(b.state, b.covariance, slow, quick, (1.0 - stay) * other / new_slow, m.states)
        blend(b.state, b.covariance, quick, SPARE, (1.0 - stay) * weight / new_quick, m.states)
        b.weight[slow], b.weight[quick] = new_slow, new_quick


@compiled
def _turn_growth(turn: Any, direction: tuple[float, float], least: float, time: float) -> float:
    """Growth of the squared angle of a turn of at least `least` [rad²], `time` seconds after the last call."""
    sine, cosine = direction
    started = turn.sin != 0.0 or turn.cos != 0.0
    angle = half_turn_angle(sine * turn.cos - cosine * turn.sin, sine * turn.sin + cosine * turn.cos)
    turn.still += time
    if started and angle > max(turn.angle, least):
        gained: float = angle * angle - turn.angle * turn.angle
        turn.angle, turn.still = angle, 0.0
        return gained
    if not started or turn.still >= _SETTLED - 1e-6:
        turn.sin, turn.cos, turn.angle, turn.still = sine, cosine, 0.0, 0.0
    return 0.0


@compiled
def inflate_after_turns(b: Belief, m: Model, signal: Signal) -> None:
    """Inflate the compasses' biases by a share of the whole turns since the last message."""
    o = b.motion
    own, leader = _turn_growth(b.turn, (o.sin, o.cos), _TURN, o.time), 0.0
    if m.leader != ABSENT:
        leader = _turn_growth(b.leader_turn, sin_cos(signal.heading), _LEADER_TURN, o.time)
    for k in range(b.alive * m.modes):
        b.covariance[k, COMPASS, COMPASS] += m.deviation * own
        if m.leader != ABSENT:
            b.covariance[k, m.leader, m.leader] += m.deviation * leader


@compiled
def inflate_bias_covariance(b: Belief, m: Model, signal: Signal) -> None:
    """Inflate bias covariances before an update: by deviations, and by the error of the leg's heading."""
    if m.deviation > 0.0:
        inflate_after_turns(b, m, signal)
    if m.leader != ABSENT:
        for k in range(b.alive * m.modes):
            b.state[k, m.leader] += signal.shift
            b.covariance[k, m.leader, m.leader] += signal.added_variance


@compiled
def _propagate_iterated(b: Belief, m: Model, k: int, signal: Signal) -> bool:
    """Predict component k; where its compass bias bends the way too much, at the biases of a first update."""
    x, way = b.state, math.sqrt(b.motion.ax**2 + b.motion.ay**2)
    log_bias, compass_bias, healthy = x[k, LOG], x[k, COMPASS], True
    if 0.5 * b.covariance[k, COMPASS, COMPASS] * way >= _BEND:
        copy_component(b, k, SPARE)
        predict_component(b, m, k, log_bias, compass_bias)
        healthy = update(b, m, k, signal) >= 0
        log_bias, compass_bias = x[k, LOG], x[k, COMPASS]
        copy_component(b, SPARE, k)
    predict_component(b, m, k, log_bias, compass_bias)
    return healthy


@compiled
def _update_weights(b: Belief, m: Model) -> bool:
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
    normalise(b.weight, components)
    return True


@compiled
def update_leader_variance(b: Belief, m: Model) -> None:
    """Estimate the variance of the leader's heading error per message: at most the scatter of readings on legs."""
    excess = 0.0
    for k in range(b.alive * m.modes):
        excess += b.weight[k] * b.turn_excess[k]
    variance = min(b.leader_variance + _VARIANCE_GAIN * excess, b.leader.scatter)
    b.leader_variance = min(max(variance, _LEAST_LEADER_VARIANCE), m.leader_variance)


@compiled
def _check_consistency(b: Belief, m: Model, signal: Signal, received: int, used: int) -> bool:
    """Smooth the NIS, and reinitialise or inflate a belief that the ranges do not fit; False if that failed."""
    normalised_innovation = 0.0
    for k in range(b.alive * m.modes):
        normalised_innovation += b.weight[k] * b.outcome[k].normalised_innovation
    b.smoothed_nis += _SMOOTHING * (normalised_innovation - b.smoothed_nis)
    if received > 1 and not reinitialise_if_inconsistent(b, m, signal):
        return False
    b.missed_updates = 0.0 if used > 0 else b.missed_updates + 1.0
    if b.missed_updates >= _MOST_MISSED:
        for k in range(b.alive * m.modes):
            b.covariance[k, X, X] += _ADDED_POSITION
            b.covariance[k, Y, Y] += _ADDED_POSITION
            b.covariance[k, COMPASS, COMPASS] += _ADDED_COMPASS
    return True


@compiled
def _initialise(b: Belief, m: Model, signal: Signal, received: int) -> int:
    """Begin with this message, if it is enough; what `receive` returns."""
    if received < 2:
        return 0
    if not add_ring(b, m, signal, 1.0):
        return -1
    # all of them were used, but nothing had been expected of them that they could have missed
    for k in range(b.alive * m.modes):
        b.outcome[k].taken, b.outcome[k].squared = received, np.nan
    reset_preintegration(b)
    refresh_output(b, m)
    return received


@compiled
def receive(b: Belief, m: Model, signal: Signal) -> int:
    """Take a message: predict all components to its instant and update them with its ranges.

    A message without ranges changes nothing: the way since the last one continues. With an unknown start the first
    message with two ranges makes the belief. Returns the most ranges that a hypothesis used; −1 if a covariance was not
    positive definite, after which the belief is not to be used any more.
    """
    received = 0
    for i in range(m.transmitters):
        received += signal.ranges[i] == signal.ranges[i]
    b.received = received
    if received == 0:
        return 0
    if b.alive == 0:
        return _initialise(b, m, signal, received)
    mix_modes(b, m)
    if m.leader != ABSENT:
        average_leader_heading(b, m, signal)
    inflate_bias_covariance(b, m, signal)
    for k in range(b.alive * m.modes):
        if not _propagate_iterated(b, m, k, signal):
            return -1
    if not math.isnan(signal.ranges[0] + signal.ranges[1]):
        split(b, m, signal)
    most = 0
    for k in range(b.alive * m.modes):
        used = update(b, m, k, signal)
        if used < 0:
            return -1
        if used > most:
            most = used
    if b.alive * m.modes > 1 and not _update_weights(b, m):
        return -1
    if m.leader != ABSENT:
        update_leader_variance(b, m)
    if b.alive > 1:
        prune_and_merge(b, m)
    if not _check_consistency(b, m, signal, received, most):
        return -1
    if m.current != ABSENT or m.leader != ABSENT:
        update_current_from_leader_track(b, m, signal)
    reset_preintegration(b)
    refresh_output(b, m)
    return most
