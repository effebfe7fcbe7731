"""Several Gaussians instead of one: splits along circles, weights, and what becomes one again."""

import math

from laisn.beacons.belief import KEPT, OWN, ROOM, SHARED, Belief, X, Y, copy
from laisn.beacons.ranging import Ranging, look
from laisn.compiled import compiled

_BEND = 0.7
"""A component is split where a circle bends away from its tangent by more than this share of a range's error."""
_LEAST_WEIGHT = 1e-8
_SAME = 0.3
"""Squared Mahalanobis distance of two positions below which they are one."""


@compiled
def _split_component(b: Belief, k: int, z: Ranging) -> None:
    """Split component k in three along the tangent of the circle about a beacon.

    A normal variable is nearly the mixture of three with the means −1, 0, 1, weights ¼, ½, ¼ and the variance ½, which
    keeps its first three moments; the other states follow by their covariance with it.
    """
    x, P, n, column = b.state[k], b.covariance[k], b.fresh.size, b.gain
    own = SHARED + OWN * z.beacon
    dx, dy = x[X] - z.east - x[own + 1], x[Y] - z.north - x[own + 2]
    flat = math.sqrt(dx * dx + dy * dy)
    tx, ty = -dy / flat, dx / flat
    for j in range(n):
        column[j] = tx * (P[j, X] - P[j, own + 1]) + ty * (P[j, Y] - P[j, own + 2])
    sigma = math.sqrt(tx * (column[X] - column[own + 1]) + ty * (column[Y] - column[own + 2]))
    for j in range(n):
        column[j] /= sigma
    for i in range(n):
        for j in range(n):
            P[i, j] -= 0.5 * column[i] * column[j]
    b.weight[k] *= 0.5
    for side in (-1.0, 1.0):
        other = b.alive[0]
        copy(b, k, other)
        b.weight[other] *= 0.5
        b.state[other] += side * column
        b.alive[0] += 1


@compiled
def split(b: Belief, z: Ranging) -> None:
    """Split every component that is too wide for the circle of a range to be straight."""
    k = 0
    while k < b.alive[0]:
        _, _, bend = look(b, k, z)
        if bend > _BEND * math.sqrt(b.variance[z.beacon]) and b.alive[0] + 2 <= ROOM:
            _split_component(b, k, z)
        else:
            k += 1


@compiled
def _same_place(b: Belief, i: int, j: int) -> bool:
    """Whether two components are nearer than their mean spread."""
    dx, dy = b.state[i, X] - b.state[j, X], b.state[i, Y] - b.state[j, Y]
    P, Q = b.covariance[i], b.covariance[j]
    xx, xy, yy = 0.5 * (P[X, X] + Q[X, X]), 0.5 * (P[X, Y] + Q[X, Y]), 0.5 * (P[Y, Y] + Q[Y, Y])
    return bool(dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx < _SAME * (xx * yy - xy * xy))


@compiled
def _merge(b: Belief, i: int, j: int) -> None:
    """Merge component j into i, keeping mean and covariance of both together."""
    total = b.weight[i] + b.weight[j]
    share = b.weight[j] / total
    off = b.state[j] - b.state[i]
    n = b.fresh.size
    for g in range(n):
        for h in range(n):
            change = b.covariance[j, g, h] - b.covariance[i, g, h] + (1.0 - share) * off[g] * off[h]
            b.covariance[i, g, h] += share * change
    b.state[i] += share * off
    b.weight[i] = total


@compiled
def _remove(b: Belief, k: int) -> None:
    """Remove a component: the last one takes its place."""
    b.alive[0] -= 1
    if k != b.alive[0]:
        copy(b, b.alive[0], k)


@compiled
def tidy(b: Belief) -> None:
    """Drop components without weight, merge those in one place, keep the heaviest ones, the heaviest of all first."""
    k = 0
    while k < b.alive[0]:
        if b.weight[k] < _LEAST_WEIGHT:
            _remove(b, k)
        else:
            k += 1
    i = 0
    while i < b.alive[0]:
        j = i + 1
        while j < b.alive[0]:
            if _same_place(b, i, j):
                _merge(b, i, j)
                _remove(b, j)
            else:
                j += 1
        i += 1
    while b.alive[0] > KEPT:
        _remove(b, int(b.weight[: b.alive[0]].argmin()))
    top = int(b.weight[: b.alive[0]].argmax())
    if top > 0:
        spare = ROOM - 1
        copy(b, 0, spare)
        copy(b, top, 0)
        copy(b, spare, top)
    b.weight[: b.alive[0]] /= b.weight[: b.alive[0]].sum()
