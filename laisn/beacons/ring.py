"""Where one range alone puts the vehicle: for a start that nobody knows, and for a belief that has lost its way."""

import math

from laisn.beacons.belief import HEADING, OWN, ROOM, SCALE, SHARED, Belief, X, Y
from laisn.beacons.ranging import Ranging, learn
from laisn.compiled import compiled

BEARINGS = 48
"""Gaussians of a ring."""
_OVERLAP = 0.6
"""Standard deviation of each along the ring as a share of their spacing, for which their sum is nearly even."""


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
    across = (_OVERLAP * 2.0 * math.pi / BEARINGS * distance) ** 2
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
        x[X], x[Y] = z.east + distance * ux, z.north + distance * uy
        P[X, X], P[Y, Y] = along * ux * ux + across * uy * uy, along * uy * uy + across * ux * ux
        P[X, Y] = P[Y, X] = (along - across) * ux * uy
        b.weight[k] = weight / BEARINGS
        learn(b, k, z)
        b.alive[0] += 1
    b.weight[: b.alive[0]] /= b.weight[: b.alive[0]].sum()
