"""Initialisation from one message: for an unknown start, and for a mixture that is inconsistent with the ranges.

The prior is a ring about the nearest transmitter, as a sum of Gaussians with fresh biases, one for each bearing. Each
is updated with the ranges; what is left on either side of the leader's axis is taken together as one hypothesis.
"""

import math

from laisn.compiled import compiled
from laisn.elementary import sin_cos
from laisn.mixture import place_on_ring
from laisn.tight.belief import CAPACITY, Belief, refresh_output
from laisn.tight.model import ABSENT, Model, X, Y
from laisn.tight.ranging import Heard, update
from laisn.tight.sides import copy, normalise, prune_and_merge

_BEARINGS = 96
_RADIAL_VARIANCE = 25.0
"""Variance of a hypothesis's distance before the update [m²]: wide beside all errors of a range."""
_ALARM = 3.0
"""Smoothed NIS, of which 1 is expected, above which the mixture is inconsistent."""
_SECOND_THOUGHT = 0.002
"""Weight that the hypotheses of the ring are given after an alarm."""
_ASTRAY = 10.0
"""Standard deviation along each axis of the ring's weight around the belief so far [m]."""
_ANYWHERE = 0.01
"""Weight of the ring far from the belief so far, where that at the belief is 1."""


@compiled
def _reset(b: Belief, m: Model, k: int) -> None:
    """Give a component no weight, no position, no bias of the leader, and fresh other biases."""
    b.weight[k] = 0.0
    for i in range(m.states):
        b.state[k, i] = 0.0
        for j in range(m.states):
            b.covariance[k, i, j] = 0.0
        if i not in (X, Y, m.leader):
            b.covariance[k, i, i] = b.fresh[i]


@compiled
def _try_bearing(b: Belief, m: Model, k: int, heard: Heard, nearest: int, distance: float, bearing: float) -> bool:
    """Update component k from a prior at a bearing from north [rad] of the nearest transmitter, about a distance [m].

    False if that failed.
    """
    _reset(b, m, k)
    centre = (heard.arms[nearest, 0], heard.arms[nearest, 1])
    place_on_ring(b.state[k], b.covariance[k], centre, distance, sin_cos(bearing), (_RADIAL_VARIANCE, _BEARINGS))
    return update(b, m, k, heard) >= 0


@compiled
def _gather(b: Belief, m: Model, source: int, target: int, weight: float) -> None:
    """Add a component's moments about the origin to those of another one."""
    b.weight[target] += weight
    for i in range(m.states):
        b.state[target, i] += weight * b.state[source, i]
        for j in range(m.states):
            moment = b.covariance[source, i, j] + b.state[source, i] * b.state[source, j]
            b.covariance[target, i, j] += weight * moment


@compiled
def _finish(b: Belief, m: Model, k: int, heard: Heard) -> None:
    """Make a component of gathered moments, turn it by what the leader's compass may be off, and move it in place."""
    x, P, per = b.state, b.covariance, 1.0 / b.weight[k]
    for i in range(m.states):
        x[k, i] *= per
    for i in range(m.states):
        for j in range(m.states):
            P[k, i, j] = P[k, i, j] * per - x[k, i] * x[k, j]
    if m.leader != ABSENT:
        by_bias_x, by_bias_y, bias = -x[k, Y], x[k, X], b.fresh[m.leader]
        turn = bias + b.leader_variance
        P[k, X, X] += turn * by_bias_x * by_bias_x
        P[k, Y, Y] += turn * by_bias_y * by_bias_y
        P[k, X, Y] += turn * by_bias_x * by_bias_y
        P[k, Y, X] = P[k, X, Y]
        P[k, X, m.leader] = P[k, m.leader, X] = bias * by_bias_x
        P[k, Y, m.leader] = P[k, m.leader, Y] = bias * by_bias_y
        P[k, m.leader, m.leader] = bias
    x[k, X] += heard.east
    x[k, Y] += heard.north


@compiled
def _nearness(b: Belief, k: int, here: tuple[float, float]) -> float:
    """Logarithm of the prior of component k where the belief has been `here` [m]; 0 if that is NaN."""
    dx, dy = b.state[k, X] - here[0], b.state[k, Y] - here[1]
    if dx != dx:
        return 0.0
    return math.log(_ANYWHERE + math.exp(-0.5 * (dx * dx + dy * dy) / (_ASTRAY * _ASTRAY)))


@compiled
def _walk_round(b: Belief, m: Model, heard: Heard, first: int, here: tuple[float, float]) -> bool:
    """Gather what all bearings become into the first components of two hypotheses, left of the axis and right of it."""
    nearest, shortest = 0, math.inf
    for i in range(m.transmitters):
        if heard.ranges[i] < shortest:
            nearest, shortest = i, heard.ranges[i]
    deeper = heard.arms[nearest, 2]
    distance = math.sqrt(max(shortest * shortest - deeper * deeper, 1.0))
    ax, ay = heard.arms[0, 0], heard.arms[0, 1]
    ex, ey = heard.arms[1, 0] - ax, heard.arms[1, 1] - ay
    trial, healthy, best = (CAPACITY - 1) * m.modes, True, -math.inf
    for gathering in (False, True):
        for j in range(_BEARINGS):
            healthy &= _try_bearing(b, m, trial, heard, nearest, distance, 2.0 * math.pi * (j + 0.5) / _BEARINGS)
            evidence = b.evidence[trial] + _nearness(b, trial, here)
            if gathering:
                left = ex * (b.state[trial, Y] - ay) - ey * (b.state[trial, X] - ax) > 0.0
                _gather(b, m, trial, first if left else first + m.modes, math.exp(evidence - best))
            else:
                best = max(best, evidence)
    return healthy


@compiled
def add_ring(b: Belief, m: Model, heard: Heard, weight: float) -> bool:
    """Add two hypotheses of a message with two ranges or more; False if a covariance was not positive definite.

    Args:
        b: the belief; there must be room for three hypotheses more.
        m: settings.
        heard: the message.
        weight: of both together; that of all others is scaled to the rest.
    """
    first = b.alive * m.modes
    here = (b.output.x - heard.east, b.output.y - heard.north)
    for h in range(2):
        k = first + h * m.modes
        _reset(b, m, k)
        for i in range(m.states):
            b.covariance[k, i, i] = 0.0
    east, north, variance = heard.east, heard.north, b.leader_variance
    # about the leader, and with its heading as broadcast: both are put right at the end
    heard.east = heard.north = b.leader_variance = 0.0
    healthy = _walk_round(b, m, heard, first, here)
    heard.east, heard.north, b.leader_variance = east, north, variance
    total = b.weight[first] + b.weight[first + m.modes]
    if not healthy or not total > 0.0:
        return False
    for k in range(first):
        b.weight[k] *= 1.0 - weight
    for h in range(2):
        k = b.alive * m.modes
        if h == 1 and k == first:
            # nothing was left on the other side
            copy(b, m, first + m.modes, first)
        if b.weight[k] > 0.0:
            _finish(b, m, k, heard)
            b.weight[k] *= weight / (total * m.modes)
            for mode in range(1, m.modes):
                copy(b, m, k, k + mode)
            b.alive += 1
    normalise(b, m)
    prune_and_merge(b, m)
    return True


@compiled
def reinitialise_if_inconsistent(b: Belief, m: Model, heard: Heard) -> bool:
    """Add the hypotheses of this message alone where the smoothed NIS is too large; False as of `add_ring`."""
    if b.smoothed_nis < _ALARM:
        return True
    b.smoothed_nis = 1.0
    refresh_output(b, m)
    return add_ring(b, m, heard, _SECOND_THOUGHT)
