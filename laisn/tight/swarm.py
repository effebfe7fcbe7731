"""The tightly coupled navigators of a swarm in one compiled call, for followers that steer while they navigate."""

import math
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.compiled import compiled, copy_values
from laisn.tight.belief import Belief, new_belief
from laisn.tight.estimator import place_arms, receive
from laisn.tight.mission import record_outcome
from laisn.tight.model import ABSENT, COMPASS, LOG, Model, X, Y, model_of
from laisn.tight.own_motion import advance, position, velocity
from laisn.tight.ranging import Heard, new_heard
from laisn.tight.settings import TightSettings
from laisn.tight.sides import heaviest, hypothesis_weight

_APART = 2.0
"""Two hypotheses are two places, and not the halves of a wide one, where they are farther apart than so many times the
sum of their standard deviations: intervals of 95 % about each do not meet."""


@compiled
def _spread(b: Belief, k: int, east: float, north: float) -> float:
    """Standard deviation of the place of component k in a direction, a unit vector [m]."""
    P = b.covariance
    return math.sqrt(east * east * P[k, X, X] + 2.0 * east * north * P[k, X, Y] + north * north * P[k, Y, Y])


@compiled
def _offset_to_likelier_hypothesis(b: Belief, m: Model, x: float, y: float) -> tuple[float, float]:
    """Offset from the mean position to that of the likelier of two hypotheses [m]; zero where they are one place."""
    first, second, most, next_most = 0, -1, -1.0, -1.0
    for h in range(b.alive):
        weight = hypothesis_weight(b, m, h)
        if weight > most:
            first, second, most, next_most = h, first if h > 0 else -1, weight, most
        elif weight > next_most:
            second, next_most = h, weight
    if second < 0:
        return 0.0, 0.0
    i, j = heaviest(b, m, first), heaviest(b, m, second)
    east, north = b.state[i, X] - b.state[j, X], b.state[i, Y] - b.state[j, Y]
    apart = math.sqrt(east * east + north * north)
    if apart == 0.0:
        return 0.0, 0.0
    east, north = east / apart, north / apart
    if apart < _APART * (_spread(b, i, east, north) + _spread(b, j, east, north)):
        return 0.0, 0.0
    return b.state[i, X] - x, b.state[i, Y] - y


@compiled
def _write_outputs(b: Belief, m: Model, out: Any) -> None:
    """Write biases and current (means over the mixture), its spread, and the offset to the likelier hypothesis."""
    x = y = log_bias = compass_bias = east = north = 0.0
    for k in range(b.alive * m.modes):
        w = b.weight[k]
        x += w * b.state[k, X]
        y += w * b.state[k, Y]
        log_bias += w * b.state[k, LOG]
        compass_bias += w * b.state[k, COMPASS]
        if m.current != ABSENT:
            east += w * b.state[k, m.current]
            north += w * b.state[k, m.current + 1]
    xx = xy = yy = 0.0
    for k in range(b.alive * m.modes):
        w, dx, dy = b.weight[k], b.state[k, X] - x, b.state[k, Y] - y
        xx += w * (b.covariance[k, X, X] + dx * dx)
        xy += w * (b.covariance[k, X, Y] + dx * dy)
        yy += w * (b.covariance[k, Y, Y] + dy * dy)
    half, across = 0.5 * (xx + yy), 0.5 * (xx - yy)
    out.log_bias, out.compass_bias = log_bias, compass_bias
    out.current[0], out.current[1] = east, north
    out.spread = math.sqrt(half + math.sqrt(across * across + xy * xy))
    out.to_likelier[0], out.to_likelier[1] = _offset_to_likelier_hypothesis(b, m, x, y)


class TightSwarm(NamedTuple):
    """Tightly coupled navigators of f followers."""

    beliefs: Any
    """`Belief` of each follower, shape (f,)."""
    model: Model
    """Of all of them."""
    heard: Heard
    """Room for a message."""
    gated: Ints
    """See `Swarm.gated`."""

    @compiled
    def navigate(
        self, step: int, readings: Floats, received: Bools, messages: Floats, ranges: Floats, estimates: Any
    ) -> int:
        """Advance by one filter step, the same to the bit as `TightNavigator.step`; see `laisn.swarm.Swarm.navigate`.

        The step's number is not read.
        """
        beliefs, m, heard, gated = self
        outcome = np.empty(3)
        for i in range(beliefs.size):
            b, message, estimate = beliefs[i], messages[i], estimates[i]
            advance(b, m, readings[i, 0], readings[i, 1], m.dt)
            if received[i]:
                heard.time, heard.east, heard.north = message[0], message[1], message[2]
                heard.heading, heard.speed = message[3], message[4]
                copy_values(ranges[i], heard.ranges)
                place_arms(heard, m, message[6], message[7], message[5] - (readings[i, 2] - m.hydrophone_height))
                used = receive(b, m, heard)
                if used < 0:
                    return i + 1
                record_outcome(b, m, heard, used, outcome)
                # ranges were received, there was an estimate to test them against, and none was used
                gated[i] += outcome[0] > 0.0 and outcome[1] == 0.0 and b.alive > 0
                _write_outputs(b, m, estimate)
            estimate.position[0], estimate.position[1] = position(b)
            estimate.velocity[0], estimate.velocity[1] = velocity(b)
        return 0


def new_tight_swarm(settings: TightSettings, starts: Floats) -> TightSwarm:
    """Navigators of followers at their starts, rows of x, y [m] and more, shape (f, 2) or wider.

    The starts are not read if the settings say that they are unknown.
    """
    model = model_of(settings)
    known = [(float(row[0]), float(row[1])) if settings.known_start else None for row in starts]
    beliefs = [new_belief(settings, model, start) for start in known]
    together = np.zeros(len(beliefs), dtype=beliefs[0].dtype)
    for i, belief in enumerate(beliefs):
        together[i] = belief
    return TightSwarm(together.view(np.recarray), model, new_heard(), np.zeros(len(beliefs), dtype=np.int64))
