"""A whole mission in one compiled loop: what campaigns run, and what `TightNavigator.run` must equal."""

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.messages import Measurements
from laisn.tight.belief import Belief, new_belief
from laisn.tight.estimator import place_arms, receive
from laisn.tight.model import Model, model_of
from laisn.tight.own_motion import advance, moments, position
from laisn.tight.ranging import Heard, new_heard
from laisn.tight.settings import TightSettings


@compiled
def filter_mission(
    b: Belief, m: Model, heard: Heard, own: Floats, message_step: Ints, messages: Floats, where: Floats, spread: Floats
) -> int:
    """Estimate a whole mission.

    Args:
        b: a new belief.
        m: settings.
        heard: room for a message.
        own: speed [m/s], heading [rad] and depth [m] after each step, shape (n, 3).
        message_step: shape (m,), from 1.
        messages: columns of `LeaderMessage` from timestamp to roll, then the three ranges; shape (m, 11).
        where: mean position after each step, shape (n, 2), [m]; overwritten.
        spread: its covariance xx, xy, yy, shape (n, 3), [m²]; overwritten, unless its shape is (0, 3).

    Returns:
        The step at which a covariance was not positive definite; 0 if none was.
    """
    i = 0
    for k in range(own.shape[0]):
        advance(b, m, own[k, 0], own[k, 1])
        if i < message_step.size and message_step[i] == k + 1:
            row = messages[i]
            heard.time, heard.east, heard.north, heard.heading, heard.speed = row[0], row[1], row[2], row[3], row[4]
            heard.ranges[:] = row[8:11]
            place_arms(heard, m, row[6], row[7], row[5] - (own[k, 2] - m.hydrophone_height))
            if receive(b, m, heard) < 0:
                return k + 1
            i += 1
        where[k, 0], where[k, 1] = position(b)
        if spread.shape[0] > 0:
            moments(b, m)
            spread[k, 0], spread[k, 1] = b.now_covariance[0, 0], b.now_covariance[0, 1]
            spread[k, 2] = b.now_covariance[1, 1]
    return 0


def run_mission(settings: TightSettings, measurements: Measurements, start: Floats | None) -> tuple[Floats, Floats]:
    """Position and its covariance after each step of a mission, without the rest that a navigator tells.

    Args:
        settings: of the navigator.
        measurements: of the mission, n steps.
        start: x, y at step 0, shape (2,) or more, [m]; None if unknown.

    Returns:
        Positions, shape (n, 2), [m], and covariances xx, xy, yy, shape (n, 3), [m²]; NaN before a start is found.

    Raises:
        ArithmeticError: a covariance is not positive definite.
    """
    model, n = model_of(settings), measurements.speed.size
    where, spread = np.empty((n, 2)), np.empty((n, 3))
    own = np.column_stack([measurements.speed, measurements.heading, measurements.depth])
    messages = np.column_stack([measurements.message[:, :8], measurements.ranges])
    belief = new_belief(settings, model, None if start is None else (float(start[0]), float(start[1])))
    failed = filter_mission(belief, model, new_heard(), own, measurements.message_step, messages, where, spread)
    if failed:
        raise ArithmeticError(f"step {failed}: a covariance is not positive definite")
    return where, spread
