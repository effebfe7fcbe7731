"""One range: split, learn, weigh, and take up what it alone says where that is called for."""

import math

from laisn.beacons.belief import Belief
from laisn.beacons.mixture import split, tidy
from laisn.beacons.ranging import Ranging, learn, learn_variance
from laisn.beacons.ring import add_ring
from laisn.compiled import compiled

STARTERS = 8
"""So many of the first ranges may be the one that an unknown start is found by."""
_SURE = 0.9
"""Errors of ranges are learnt where one component has more weight than this."""
_PATIENCE = 8
"""Ranges of one beacon rejected in a row after which a ring about it is added."""
_DOUBT = 0.01
"""Weight of a ring that is added."""


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
        tidy(b)
    return used
