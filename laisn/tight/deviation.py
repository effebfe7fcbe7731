"""Deviation: a compass errs by another bias on another heading.

What a turn may have changed of it is a share of the whole turn, however many messages come while it lasts.
"""

from typing import Any

from laisn.compiled import compiled
from laisn.elementary import half_turn_angle, sin_cos
from laisn.tight.belief import Belief
from laisn.tight.model import ABSENT, COMPASS, Model
from laisn.tight.ranging import Heard

_TURN, _LEADER_TURN = 0.1, 0.15
"""Turns up to these change nothing, one's own and the leader's, as readings err by a part of them [rad]."""
_SETTLED = 10.0
"""A turn is over where it has not gone on for so long [s]."""


@compiled
def _gained(turn: Any, direction: tuple[float, float], least: float, time: float) -> float:
    """By how much the square of the angle of a turn has grown in so many seconds [rad²].

    Args:
        turn: its record, brought forward.
        direction: sine and cosine of the heading now.
        least: angle from which on it is a turn [rad].
        time: since this was last asked [s].
    """
    sine, cosine = direction
    started = turn.sin != 0.0 or turn.cos != 0.0
    angle = half_turn_angle(sine * turn.cos - cosine * turn.sin, sine * turn.sin + cosine * turn.cos)
    turn.still += time
    if started and angle > max(turn.angle, least):
        gained: float = angle * angle - turn.angle * turn.angle
        turn.angle, turn.still = angle, 0.0
        return gained
    if not started or turn.still >= _SETTLED - 1e-6:
        turn.sin, turn.cos, turn.angle, turn.still = sine, cosine, 0.0, 0.0
    return 0.0


@compiled
def deviate(b: Belief, m: Model, heard: Heard) -> None:
    """Widen the compasses' biases by what turns since the last message may have changed of them."""
    o = b.motion
    own, leader = _gained(b.turn, (o.sin, o.cos), _TURN, o.time), 0.0
    if m.leader != ABSENT:
        leader = _gained(b.leader_turn, sin_cos(heard.heading), _LEADER_TURN, o.time)
    for k in range(b.alive * m.modes):
        b.covariance[k, COMPASS, COMPASS] += m.deviation * own
        if m.leader != ABSENT:
            b.covariance[k, m.leader, m.leader] += m.deviation * leader
