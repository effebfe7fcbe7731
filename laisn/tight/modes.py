"""Slow and quick drift of biases, side by side: the interacting multiple model of Blom & Bar-Shalom.

Bar-Shalom, Li & Kirubarajan 2001. Each hypothesis has two components, one of each mode; before a message either
becomes a blend of both, by the chance that the drift has changed its mode.
"""

import math

from laisn.compiled import compiled
from laisn.tight.belief import Belief
from laisn.tight.model import Model


@compiled
def mix_modes(b: Belief, m: Model) -> None:
    """Blend the two modes of each hypothesis; nothing where there is one."""
    if m.modes == 1:
        return
    x, P, n = b.state, b.covariance, m.states
    # a chain of two states that changes at the same rate either way (Poisson)
    stay = 0.5 + 0.5 * math.exp(-2.0 * m.mode_switches * b.motion.time)
    for h in range(b.alive):
        slow, quick = 2 * h, 2 * h + 1
        both_slow, both_quick = b.weight[slow], b.weight[quick]
        new_slow = stay * both_slow + (1.0 - stay) * both_quick
        new_quick = stay * both_quick + (1.0 - stay) * both_slow
        if new_slow <= 0.0 or new_quick <= 0.0:
            continue
        # shares of the quick component in either blend
        in_slow = (1.0 - stay) * both_quick / new_slow
        in_quick = stay * both_quick / new_quick
        for i in range(n):
            for j in range(i + 1):
                apart = (x[quick, i] - x[slow, i]) * (x[quick, j] - x[slow, j])
                first, change = P[slow, i, j], P[quick, i, j] - P[slow, i, j]
                P[slow, i, j] = P[slow, j, i] = first + in_slow * change + in_slow * (1.0 - in_slow) * apart
                P[quick, i, j] = P[quick, j, i] = first + in_quick * change + in_quick * (1.0 - in_quick) * apart
        for i in range(n):
            first, change = x[slow, i], x[quick, i] - x[slow, i]
            x[slow, i], x[quick, i] = first + in_slow * change, first + in_quick * change
        b.weight[slow], b.weight[quick] = new_slow, new_quick
