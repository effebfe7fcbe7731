"""One range: split the mixture along its circle, update, weigh, merge, and add a ring of positions where needed."""

import math

from laisn.beacons.belief import HEADING, KEPT, OWN, ROOM, SCALE, SHARED, Belief, X, Y, copy
from laisn.beacons.ranging import Ranging, learn, learn_variance, look
from laisn.compiled import compiled
from laisn.mixture import blend, is_same_place, place_on_ring

_BEND = 0.7
"""A component is split where a circle bends away from its tangent by more than this share of a range's error."""
_LEAST_WEIGHT = 1e-8
BEARINGS = 48
"""Gaussians of a ring."""
STARTERS = 8
"""So many of the first ranges may be the one that an unknown start is found by."""
_SURE = 0.9
"""Errors of ranges are learnt where one component has more weight than this."""
_PATIENCE = 8
"""Ranges of one beacon rejected in a row after which a ring about it is added."""
_DOUBT = 0.01
"""Weight of a ring that is added."""


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
def _merge(b: Belief, i: int, j: int) -> None:
    """Merge component j into i, keeping mean and covariance of both together."""
    total = b.weight[i] + b.weight[j]
    blend(b.state, b.covariance, i, j, b.weight[j] / total, b.fresh.size)
    b.weight[i] = total


@compiled
def _remove(b: Belief, k: int) -> None:
    """Remove a component: the last one takes its place."""
    b.alive[0] -= 1
    if k != b.alive[0]:
        copy(b, b.alive[0], k)


@compiled
def prune_and_merge(b: Belief) -> None:
    """Prune components without weight, merge those at one position, keep the heaviest ones, the heaviest first."""
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
            if is_same_place(b.state, b.covariance, i, j):
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


@compiled
def add_ring(b: Belief, z: Ranging, weight: float, lost: bool) -> None:
    """Add a ring of components about a beacon; nothing where there is no room.

    Args:
        b: the belief.
        z: the range.
        weight: of the ring, where that of all others is 1.
        lost: the other states are those of the heaviest component, with the heading as uncertain as at the start;
            otherwise all are fresh.
    """
    n, own = b.fresh.size, SHARED + OWN * z.beacon
    if b.alive[0] + BEARINGS >= ROOM:
        return
    distance = max(math.sqrt(max(z.range * z.range - z.deeper * z.deeper, 1.0)), 1.0)
    # wide beside all errors of a range, the learning of which follows
    along = 4.0 * (b.variance[z.beacon] + b.fresh[own] + b.fresh[own + 1] + b.fresh[SCALE] * distance * distance)
    for i in range(BEARINGS):
        k = b.alive[0]
        ux, uy = math.sin(2.0 * math.pi * i / BEARINGS), math.cos(2.0 * math.pi * i / BEARINGS)
        x, P = b.state[k], b.covariance[k]
        for j in range(n):
            x[j] = b.state[0, j] if lost else 0.0
            for h in range(n):
                P[j, h] = b.covariance[0, j, h] if lost and min(j, h) > Y else 0.0
            if not lost:
                P[j, j] = b.fresh[j]
        if lost:
            P[HEADING, HEADING] += b.fresh[HEADING]
        place_on_ring(x, P, (z.east, z.north), distance, (ux, uy), (along, BEARINGS))
        b.weight[k] = weight / BEARINGS
        learn(b, k, z)
        b.alive[0] += 1
    b.weight[: b.alive[0]] /= b.weight[: b.alive[0]].sum()


@compiled
def hear(b: Belief, z: Ranging, starter: int) -> bool:
    """Take a range.

    With an unknown start each of the first ranges may be the first right one: the ring of the m-th has the weight of
    all earlier ones being wrong, beside what the components so far say of them.

    Args:
        b: the belief.
        z: the range.
        starter: number m of this range with an unknown start, from 0; −1 with a known one, or after `STARTERS`.

    Returns:
        Whether the heaviest component used it.
    """
    used, total = False, 0.0
    if b.alive[0] > 0:
        split(b, z)
        if b.weight[0] > _SURE:
            learn_variance(b, z)
        for k in range(b.alive[0]):
            believed, density = learn(b, k, z)
            used = believed if k == 0 else used
            b.weight[k] *= math.exp(density - z.wrong)
        total = b.weight[: b.alive[0]].sum()
        b.evidence[0] += math.log(total) + z.wrong
        b.weight[: b.alive[0]] /= total
        b.rejected[z.beacon] = 0 if used else b.rejected[z.beacon] + 1
    if starter >= 0:
        add_ring(b, z, math.exp(min((starter + 1) * z.wrong - b.evidence[0], 700.0)), False)
    elif b.rejected[z.beacon] >= _PATIENCE:
        b.rejected[z.beacon] = 0
        add_ring(b, z, _DOUBT, True)
    if b.alive[0] > 1:
        prune_and_merge(b)
    return used
