"""Hypotheses: both sides of the leader's axis, and initialisation from one message.

Two transmitters cannot distinguish port from starboard. A hypothesis that reaches across the axis is split there into
its two halves, so that each is one-sided and its ranges nearly linear; unsupported ones are pruned, coinciding ones
merged. For an unknown start, and for a mixture that is inconsistent with the ranges, the prior is a ring about the
nearest transmitter: a sum of Gaussians, one for each bearing, each updated with the ranges and merged on either side of
the axis.
"""

import math

from laisn import mixture
from laisn.compiled import compiled
from laisn.elementary import sin_cos
from laisn.estimates import HYPOTHESES
from laisn.tight.model import ABSENT, CAPACITY, SPARE, Belief, Model, X, Y, refresh_output
from laisn.tight.ranging import Signal, update

_SPLIT = 0.3
"""Least lateral standard deviation of a split, as a share of the distance ℓ_c at which the axis matters."""
_REACH = 3.5
_LEAST_WEIGHT = 1e-5


@compiled
def _lateral(b: Belief, m: Model, k: int, signal: Signal) -> tuple[float, float, float]:
    """Distance ℓ of component k to the left of the line from transmitter 1 to 2 [m], with P ∇ℓ in `b.gain`; its
    variance [m²]; and the distance ℓ_c at which the axis matters [m]: where the difference of both ranges has bent by
    1.4 of their errors.
    """
    x, P, arms, gain, turning = b.state, b.covariance, signal.arms, b.gain, m.leader != ABSENT
    s, c = sin_cos(x[k, m.leader] if turning else 0.0)
    ex, ey = arms[1, 0] - arms[0, 0], arms[1, 1] - arms[0, 1]
    length = math.sqrt(ex * ex + ey * ey)
    tx, ty = (c * ex - s * ey) / length, (s * ex + c * ey) / length
    qx, qy = x[k, X] - signal.east, x[k, Y] - signal.north
    ox, oy = qx - (c * arms[0, 0] - s * arms[0, 1]), qy - (s * arms[0, 0] + c * arms[0, 1])
    # ∇ℓ by x, y and b_L
    gx, gy, gl = -ty, tx, -(tx * qx + ty * qy)
    for i in range(m.states):
        gain[i] = P[k, i, X] * gx + P[k, i, Y] * gy
        if turning:
            gain[i] += P[k, i, m.leader] * gl
    variance = gain[X] * gx + gain[Y] * gy
    if turning:
        variance += gain[m.leader] * gl
    critical = math.sqrt(qx * qx + qy * qy) * math.sqrt(2.8 * m.range_sigma / length)
    return tx * oy - ty * ox, variance, critical


@compiled
def _keep_half(b: Belief, m: Model, k: int, signal: Signal, side: float) -> None:
    """Replace component k by its part on one side of the axis: left for +1, right for −1; with its exact moments."""
    x, P, gain = b.state, b.covariance, b.gain
    lateral, variance, _ = _lateral(b, m, k, signal)
    sigma = math.sqrt(variance)
    mass, shift, narrowing = mixture.half_moments(side * lateral / sigma)
    b.weight[k] *= mass
    for i in range(m.states):
        gain[i] /= sigma
        x[k, i] += side * shift * gain[i]
        for j in range(i + 1):
            P[k, i, j] -= narrowing * gain[i] * gain[j]
            P[k, j, i] = P[k, i, j]


@compiled
def split(b: Belief, m: Model, signal: Signal) -> None:
    """Split every hypothesis that is wide enough at the leader's axis for both of its sides to matter."""
    for h in range(b.alive):
        lateral, variance, critical = _lateral(b, m, mixture.heaviest(b, m.modes, h), signal)
        across = variance > (_SPLIT * critical) ** 2 and abs(lateral) < _REACH * math.sqrt(variance)
        if b.alive < CAPACITY and across:
            other = b.alive
            b.alive += 1
            mixture.copy_hypothesis(b, m.modes, h, other)
            for mode in range(m.modes):
                _keep_half(b, m, h * m.modes + mode, signal, 1.0)
                _keep_half(b, m, other * m.modes + mode, signal, -1.0)


@compiled
def prune_and_merge(b: Belief, m: Model) -> None:
    """Prune and merge hypotheses, and keep the heaviest few; those with different leader headings are not merged."""
    b.alive = mixture.prune_and_merge(b, m.modes, b.alive, _LEAST_WEIGHT, HYPOTHESES, m.leader)
    mixture.normalise(b.weight, b.alive * m.modes)


_BEARINGS = 96
_RADIAL_VARIANCE = 25.0
"""Variance of a hypothesis's distance before the update [m²]: wide beside all errors of a range."""
_INCONSISTENT_NIS = 3.0
"""Smoothed NIS, of which 1 is expected, above which the mixture is inconsistent."""
_RING_WEIGHT = 0.002
"""Weight that the hypotheses of the ring are given after an alarm."""
_POSITION_SIGMA = 10.0
"""Standard deviation along each axis of the ring's weight around the belief so far [m]."""
_FAR_WEIGHT = 0.01
"""Weight of the ring far from the belief so far, where that at the belief is 1."""


@compiled
def _rotate_to_bias(b: Belief, m: Model, k: int) -> None:
    """Turn a component about the leader, which is at the origin, by the error of its heading, with b_L."""
    P, by_bias_x, by_bias_y = b.covariance, -b.state[k, Y], b.state[k, X]
    bias = b.fresh[m.leader]
    turn = bias + b.leader_variance
    P[k, X, X] += turn * by_bias_x * by_bias_x
    P[k, Y, Y] += turn * by_bias_y * by_bias_y
    P[k, X, Y] += turn * by_bias_x * by_bias_y
    P[k, Y, X] = P[k, X, Y]
    P[k, X, m.leader] = P[k, m.leader, X] = bias * by_bias_x
    P[k, Y, m.leader] = P[k, m.leader, Y] = bias * by_bias_y
    P[k, m.leader, m.leader] = bias


@compiled
def _merge_ring(b: Belief, m: Model, signal: Signal, first: int, here: tuple[float, float]) -> bool:
    """Update a Gaussian at each bearing, and merge those left and right of the axis into `first` and `first` + modes.

    The leader is at the origin with an exact heading; `here` is the mean so far [m], or NaN. False if an update failed.
    """
    nearest, shortest = 0, math.inf
    for i in range(m.transmitters):
        if signal.ranges[i] < shortest:
            nearest, shortest = i, signal.ranges[i]
    centre, deeper = (signal.arms[nearest, 0], signal.arms[nearest, 1]), signal.arms[nearest, 2]
    distance = math.sqrt(max(shortest * shortest - deeper * deeper, 1.0))
    ax, ay = signal.arms[0, 0], signal.arms[0, 1]
    ex, ey = signal.arms[1, 0] - ax, signal.arms[1, 1] - ay
    best = -math.inf
    for h in range(2):
        mixture.reset_component(b, first + h * m.modes, b.fresh)
    for merging in (False, True):
        for j in range(_BEARINGS):
            direction = sin_cos(2.0 * math.pi * (j + 0.5) / _BEARINGS)
            mixture.reset_component(b, SPARE, b.fresh)
            if m.leader != ABSENT:
                b.covariance[SPARE, m.leader, m.leader] = 0.0
            ring = (_RADIAL_VARIANCE, _BEARINGS)
            mixture.place_on_ring(b.state[SPARE], b.covariance[SPARE], centre, distance, direction, ring)
            if update(b, m, SPARE, signal) < 0:
                return False
            evidence = b.evidence[SPARE]
            dx, dy = b.state[SPARE, X] - here[0], b.state[SPARE, Y] - here[1]
            if dx == dx:
                square = (dx * dx + dy * dy) / (_POSITION_SIGMA * _POSITION_SIGMA)
                evidence += math.log(_FAR_WEIGHT + math.exp(-0.5 * square))
            if merging:
                left = ex * (b.state[SPARE, Y] - ay) - ey * (b.state[SPARE, X] - ax) > 0.0
                b.weight[SPARE] = math.exp(evidence - best)
                mixture.merge_components(b, first if left else first + m.modes, SPARE)
            else:
                best = max(best, evidence)
    return True


@compiled
def add_ring(b: Belief, m: Model, signal: Signal, weight: float) -> bool:
    """Add two hypotheses of a message with two ranges or more, of `weight` together; that of all others is scaled to
    the rest.

    There must be room for two more, and `SPARE`. False if a covariance was not positive definite.
    """
    first = b.alive * m.modes
    here = (b.output.x - signal.east, b.output.y - signal.north)
    east, north, variance = signal.east, signal.north, b.leader_variance
    # about the leader, and with its heading as broadcast
    signal.east = signal.north = b.leader_variance = 0.0
    healthy = _merge_ring(b, m, signal, first, here)
    signal.east, signal.north, b.leader_variance = east, north, variance
    total = b.weight[first] + b.weight[first + m.modes]
    if not healthy or not total > 0.0:
        return False
    for k in range(first):
        b.weight[k] *= 1.0 - weight
    for h in range(2):
        k = b.alive * m.modes
        if h == 1 and k == first:
            # nothing was left on the other side
            mixture.copy_component(b, first + m.modes, first)
        if b.weight[k] > 0.0:
            if m.leader != ABSENT:
                _rotate_to_bias(b, m, k)
            b.state[k, X] += signal.east
            b.state[k, Y] += signal.north
            b.weight[k] *= weight / (total * m.modes)
            for mode in range(1, m.modes):
                mixture.copy_component(b, k, k + mode)
            b.alive += 1
    mixture.normalise(b.weight, b.alive * m.modes)
    prune_and_merge(b, m)
    return True


@compiled
def reinitialise_if_inconsistent(b: Belief, m: Model, signal: Signal) -> bool:
    """Add the hypotheses of this message alone where the smoothed NIS is too large; False as of `add_ring`."""
    if b.smoothed_nis < _INCONSISTENT_NIS:
        return True
    b.smoothed_nis = 1.0
    refresh_output(b, m)
    return add_ring(b, m, signal, _RING_WEIGHT)
