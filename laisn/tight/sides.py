"""Both sides of the leader's axis: two transmitters on it cannot tell port from starboard.

A hypothesis that reaches across the axis is split there into its two halves, so that each is one-sided and its ranges
nearly linear. Halves that the data do not support lose their weight; halves that meet are merged again.
"""

import math

from laisn.compiled import compiled, inlined
from laisn.elementary import sin_cos
from laisn.mixture import blend, half_moments, is_same, is_same_place
from laisn.tight.belief import CAPACITY, Belief
from laisn.tight.estimates import HYPOTHESES
from laisn.tight.model import ABSENT, Model, X, Y
from laisn.tight.ranging import Heard

_SPLIT = 0.3
"""Least lateral standard deviation of a split, as a share of the distance ℓ_c at which the axis matters."""
_REACH = 3.5
"""Farthest axis of a split, in lateral standard deviations."""
_LEAST_WEIGHT = 1e-5


@compiled
def _lateral(b: Belief, m: Model, k: int, heard: Heard) -> tuple[float, float, float, float, float]:
    """Distance ℓ of component k to the left of the line from transmitter 1 to 2, and its derivatives.

    Returns:
        ℓ [m], its derivatives by x, y and b_L, and the distance from the leader's origin [m].
    """
    x, arms = b.state, heard.arms
    bias = x[k, m.leader] if m.leader != ABSENT else 0.0
    s, c = sin_cos(bias)
    ex, ey = arms[1, 0] - arms[0, 0], arms[1, 1] - arms[0, 1]
    per_length = 1.0 / math.sqrt(ex * ex + ey * ey)
    tx, ty = (c * ex - s * ey) * per_length, (s * ex + c * ey) * per_length
    qx, qy = x[k, X] - heard.east, x[k, Y] - heard.north
    ox, oy = qx - (c * arms[0, 0] - s * arms[0, 1]), qy - (s * arms[0, 0] + c * arms[0, 1])
    return tx * oy - ty * ox, -ty, tx, -(tx * qx + ty * qy), math.sqrt(qx * qx + qy * qy)


@inlined
def _copy_outcome(b: Belief, source: int, target: int) -> None:
    """Copy the result of the last update."""
    b.taken[target], b.squared[target] = b.taken[source], b.squared[source]
    b.normalised_innovation[target] = b.normalised_innovation[source]


@compiled
def copy(b: Belief, m: Model, source: int, target: int) -> None:
    """Copy a component."""
    b.weight[target], b.evidence[target] = b.weight[source], b.evidence[source]
    _copy_outcome(b, source, target)
    for g in range(m.states):
        b.state[target, g] = b.state[source, g]
        for h in range(m.states):
            b.covariance[target, g, h] = b.covariance[source, g, h]


@compiled
def _copy_hypothesis(b: Belief, m: Model, source: int, target: int) -> None:
    """Copy all components of a hypothesis."""
    for mode in range(m.modes):
        copy(b, m, source * m.modes + mode, target * m.modes + mode)


@compiled
def _keep_half(b: Belief, m: Model, k: int, heard: Heard, side: float) -> None:
    """Replace component k by its part on one side of the axis: left for +1, right for −1; with its exact moments."""
    x, P, n = b.state, b.covariance, m.states
    lateral, gx, gy, gl, _ = _lateral(b, m, k, heard)
    column = b.before_state
    for i in range(n):
        column[i] = P[k, i, X] * gx + P[k, i, Y] * gy
        if m.leader != ABSENT:
            column[i] += P[k, i, m.leader] * gl
    variance = column[X] * gx + column[Y] * gy
    if m.leader != ABSENT:
        variance += column[m.leader] * gl
    sigma = math.sqrt(variance)
    mass, shift, narrowing = half_moments(side * lateral / sigma)
    b.weight[k] *= mass
    for i in range(n):
        column[i] /= sigma
        x[k, i] += side * shift * column[i]
    for i in range(n):
        for j in range(n):
            P[k, i, j] -= narrowing * column[i] * column[j]


@compiled
def _reaches_across(b: Belief, m: Model, k: int, heard: Heard) -> bool:
    """Whether component k is wide enough at the axis for both of its sides to matter."""
    P = b.covariance
    lateral, gx, gy, gl, distance = _lateral(b, m, k, heard)
    variance = gx * gx * P[k, X, X] + 2.0 * gx * gy * P[k, X, Y] + gy * gy * P[k, Y, Y]
    if m.leader != ABSENT:
        variance += gl * (2.0 * (gx * P[k, X, m.leader] + gy * P[k, Y, m.leader]) + gl * P[k, m.leader, m.leader])
    ex, ey = heard.arms[1, 0] - heard.arms[0, 0], heard.arms[1, 1] - heard.arms[0, 1]
    # where the difference of both ranges has bent by 1.4 of their errors
    critical = distance * math.sqrt(2.8 * m.range_sigma / math.sqrt(ex * ex + ey * ey))
    return variance > (_SPLIT * critical) ** 2 and abs(lateral) < _REACH * math.sqrt(variance)


@compiled
def heaviest(b: Belief, m: Model, h: int) -> int:
    """Component with the most weight of a hypothesis."""
    best: int = h * m.modes
    for mode in range(1, m.modes):
        if b.weight[h * m.modes + mode] > b.weight[best]:
            best = h * m.modes + mode
    return best


@compiled
def hypothesis_weight(b: Belief, m: Model, h: int) -> float:
    """Weight of a hypothesis over its modes."""
    total = 0.0
    for mode in range(m.modes):
        total += b.weight[h * m.modes + mode]
    return total


@compiled
def split(b: Belief, m: Model, heard: Heard) -> None:
    """Split every hypothesis that reaches across the leader's axis."""
    for h in range(b.alive):
        if b.alive < CAPACITY and _reaches_across(b, m, heaviest(b, m, h), heard):
            other = b.alive
            b.alive += 1
            _copy_hypothesis(b, m, h, other)
            for mode in range(m.modes):
                _keep_half(b, m, h * m.modes + mode, heard, 1.0)
                _keep_half(b, m, other * m.modes + mode, heard, -1.0)


@compiled
def _remove(b: Belief, m: Model, h: int) -> None:
    """Remove a hypothesis: the last one takes its place."""
    b.alive -= 1
    if h != b.alive:
        _copy_hypothesis(b, m, b.alive, h)


@compiled
def normalise(b: Belief, m: Model) -> None:
    """Scale the weights to a sum of 1."""
    total = 0.0
    for k in range(b.alive * m.modes):
        total += b.weight[k]
    for k in range(b.alive * m.modes):
        b.weight[k] /= total


@compiled
def _same_place(b: Belief, m: Model, g: int, h: int) -> bool:
    """Whether two hypotheses are nearer than their mean spread, by their heaviest components' positions and b_L.

    The same place is told by another heading of the leader, too; who believes that goes elsewhere from here.
    """
    i, j = heaviest(b, m, g), heaviest(b, m, h)
    x, P = b.state, b.covariance
    if m.leader != ABSENT:
        apart, spread = x[i, m.leader] - x[j, m.leader], P[i, m.leader, m.leader] + P[j, m.leader, m.leader]
        if not is_same(apart, 0.5 * spread):
            return False
    return is_same_place(x, P, i, j)


@compiled
def _merge(b: Belief, m: Model, g: int, h: int) -> None:
    """Merge hypothesis h into g, mode by mode, keeping mean and covariance of both together."""
    for mode in range(m.modes):
        i, j = g * m.modes + mode, h * m.modes + mode
        total = b.weight[i] + b.weight[j]
        if total > 0.0:
            if b.weight[j] > b.weight[i]:
                _copy_outcome(b, j, i)
            blend(b.state, b.covariance, i, j, b.weight[j] / total, m.states)
        b.weight[i] = total
    _remove(b, m, h)


@compiled
def _lightest(b: Belief, m: Model) -> int:
    least = 0
    for h in range(1, b.alive):
        if hypothesis_weight(b, m, h) < hypothesis_weight(b, m, least):
            least = h
    return least


@compiled
def prune_and_merge(b: Belief, m: Model) -> None:
    """Prune hypotheses without weight, merge those at the same position, and keep the heaviest few."""
    h = 0
    while h < b.alive:
        if b.alive > 1 and hypothesis_weight(b, m, h) < _LEAST_WEIGHT:
            _remove(b, m, h)
        else:
            h += 1
    g = 0
    while g < b.alive:
        h = g + 1
        while h < b.alive:
            if _same_place(b, m, g, h):
                _merge(b, m, g, h)
            else:
                h += 1
        g += 1
    while b.alive > HYPOTHESES:
        _remove(b, m, _lightest(b, m))
    normalise(b, m)
