"""A whole mission in one compiled loop: what campaigns run, and what `TightNavigator.run` must equal."""

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled
from laisn.tight.belief import Belief
from laisn.tight.estimator import place_arms, receive
from laisn.tight.model import Model
from laisn.tight.own_motion import advance, moments, position
from laisn.tight.ranging import Heard

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@compiled
def filter_mission(
    b: Belief, m: Model, own: Floats, message_step: Ints, messages: Floats, where: Floats, spread: Floats
) -> int:
    """Estimate a whole mission.

    Args:
        b: a new belief.
        m: settings.
        own: speed [m/s], heading [rad] and depth [m] after each step, shape (n, 3).
        message_step: shape (m,), from 1.
        messages: columns of `LeaderMessage` from timestamp to roll, then the three ranges; shape (m, 11).
        where: mean position after each step, shape (n, 2), [m]; overwritten.
        spread: its covariance xx, xy, yy, shape (n, 3), [m²]; overwritten, unless its shape is (0, 3).

    Returns:
        The step at which a covariance was not positive definite; 0 if none was.
    """
    arms, ranges = np.empty((3, 3)), np.empty(3)
    mean, covariance, rows = np.empty(4), np.empty((4, 4)), np.empty((4, m.size))
    i = 0
    for k in range(own.shape[0]):
        advance(b, m, own[k, 0], own[k, 1])
        if i < message_step.size and message_step[i] == k + 1:
            deeper = messages[i, 5] - (own[k, 2] - m.hydrophone_height)
            place_arms(arms, m, (messages[i, 3], messages[i, 6], messages[i, 7]), deeper)
            for j in range(3):
                ranges[j] = messages[i, 8 + j]
            heard = Heard(messages[i, 0], messages[i, 1], messages[i, 2], messages[i, 3], messages[i, 4], arms, ranges)
            if receive(b, m, heard) < 0:
                return k + 1
            i += 1
        where[k, 0], where[k, 1] = position(b)
        if spread.shape[0] > 0:
            moments(b, m, mean, covariance, rows)
            spread[k, 0], spread[k, 1], spread[k, 2] = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    return 0
