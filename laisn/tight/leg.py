"""The leader's heading on a straight leg: the mean of what it broadcasts there, in place of each reading.

A reading errs at random, and turns the arms of the transmitters with it. Linearised there, derivatives and residuals
of the ranges err together: a regression with errors in its regressors (Fuller, Measurement Error Models, 1987), whose
answer is biased however many messages there are. The leader's positions are exact. Where they lie on a straight line
the heading stays, and the error of the mean heading, which is the same for all ranges of the leg but for what each
message adds to the mean, is a part of b_L. How much readings scatter about the means of their legs bounds what they
err by at random.
"""

import math

from laisn.compiled import compiled
from laisn.elementary import sin_cos
from laisn.geometry import wrap_angle
from laisn.tight.belief import Belief
from laisn.tight.model import Model
from laisn.tight.ranging import Heard

_STRAIGHT = 0.005
"""Way that bends by less from message to message is straight [rad]."""
_LEAST_WAY = 0.3
"""Shorter ways between messages have no direction [m]."""
_AGREES = 4.0
"""Standard deviations of a reading from the mean, beyond which the leader has turned without moving aside."""
_ENOUGH = 4.0
"""Messages of a leg after which its mean heading is used; sooner where its variance is little beside that of b_L."""
_LITTLE = 0.1


@compiled
def _bend(b: Belief, heard: Heard) -> float:
    """By how much the leader's way turned at the last message [rad]; NaN if that is unknown."""
    o = b.leader
    dx, dy = heard.east - o.at_x, heard.north - o.at_y
    before = o.track
    o.at_x, o.at_y = heard.east, heard.north
    o.track = math.atan2(dx, dy) if dx * dx + dy * dy > _LEAST_WAY * _LEAST_WAY else math.nan
    return wrap_angle(o.track - before)


@compiled
def _turn_arms(heard: Heard, angle: float) -> None:
    """Turn the arms clockwise."""
    s, c = sin_cos(angle)
    for i in range(3):
        ax, ay = heard.arms[i, 0], heard.arms[i, 1]
        heard.arms[i, 0], heard.arms[i, 1] = c * ax + s * ay, c * ay - s * ax


@compiled
def average_leader_heading(b: Belief, m: Model, heard: Heard) -> None:
    """Replace the heading of a message by the leg's, with the arms; sets `heard.shift` and `heard.wander`."""
    o, told = b.leader, m.leader_variance
    bend = _bend(b, heard)
    straight = abs(bend) < _STRAIGHT
    heard.shift = heard.wander = 0.0
    error = wrap_angle(heard.heading - o.leg_heading - bend)
    if o.leg > 0.0 and not (straight and error * error <= _AGREES * _AGREES * told):
        if o.steady > 0.0:
            # from here on b_L is again without the mean's random error
            heard.wander = o.scatter / o.leg
            o.other_variance, b.leader_variance = b.leader_variance, o.other_variance
        o.leg = o.steady = 0.0
        return
    if not straight:
        return
    o.leg += 1.0
    shift = error / o.leg if o.leg > 1.0 else 0.0
    o.leg_heading = o.leg_heading + bend + shift if o.leg > 1.0 else heard.heading
    if o.leg > 1.0:
        o.squares += error * (error - shift)
        o.compared += 1.0
        o.scatter = min((told + o.squares) / (1.0 + o.compared), told)
    if o.steady > 0.0:
        # the way bends half an interval earlier than the heading
        heard.shift, heard.wander = shift, 0.25 * bend * bend
    elif o.leg >= _ENOUGH or o.scatter < _LITTLE * o.leg * b.covariance[0, m.leader, m.leader]:
        heard.wander = o.scatter / o.leg
        o.steady = 1.0
        o.other_variance, b.leader_variance = b.leader_variance, o.other_variance
    if o.steady > 0.0:
        change = wrap_angle(o.leg_heading - heard.heading)
        heard.heading += change
        _turn_arms(heard, change)
