"""The leader: its mean heading on a straight leg, and the current from its track.

On a straight leg the mean of the headings that it broadcasts replaces each of them. A reading errs at random, and turns
the arms of the transmitters with it. Linearised there, derivatives and residuals of the ranges err together: a
regression with errors in its regressors (Fuller, Measurement Error Models, 1987), whose answer is biased however many
messages there are. The leader's positions are exact. Where they lie on a straight line the heading stays, and the error
of the mean heading, which is the same for all ranges of the leg but for what each message adds to the mean, is a part
of b_L. How much readings scatter about the means of their legs bounds what they err by at random.

The leader's way over ground, less what its log and compass measure, is the water's way. So a current shows on a
straight leg too, where a follower's own ranges cannot separate it from biases of log and compass, and in still water
the bias of the leader's compass. Needs a leader that broadcasts its speed through the water.
"""

import math

from laisn.compiled import compiled
from laisn.elementary import sin_cos
from laisn.geometry import angle_between, wrap_angle
from laisn.mixture import update_scalar
from laisn.tight.model import ABSENT, Belief, Model
from laisn.tight.ranging import Signal

_STRAIGHT = 0.005
"""Way that bends by less from message to message is straight [rad]."""
_LEAST_WAY = 0.3
"""Shorter ways between messages have no direction [m]."""
_OUTLIER_SIGMAS = 4.0
"""Standard deviations of a reading from the mean, beyond which the leader has turned without moving aside."""
_LEAST_MESSAGES = 4.0
"""Messages of a leg after which its mean heading is used; sooner where its variance is little beside that of b_L."""
_SMALL_SHARE = 0.1


@compiled
def _bend(b: Belief, signal: Signal) -> float:
    """By how much the leader's way turned at the last message [rad]; NaN if that is unknown."""
    o = b.leader
    dx, dy = signal.east - o.at_x, signal.north - o.at_y
    before = o.track
    o.at_x, o.at_y = signal.east, signal.north
    o.track = math.atan2(dx, dy) if dx * dx + dy * dy > _LEAST_WAY * _LEAST_WAY else math.nan
    return wrap_angle(o.track - before)


@compiled
def _turn_arms(signal: Signal, angle: float) -> None:
    """Turn the arms clockwise."""
    s, c = sin_cos(angle)
    for i in range(3):
        ax, ay = signal.arms[i, 0], signal.arms[i, 1]
        signal.arms[i, 0], signal.arms[i, 1] = c * ax + s * ay, c * ay - s * ax


@compiled
def average_leader_heading(b: Belief, m: Model, signal: Signal) -> None:
    """Replace the heading of a message by the leg's, with the arms; sets `signal.shift` and `signal.added_variance`."""
    o, given = b.leader, m.leader_variance
    bend = _bend(b, signal)
    straight = abs(bend) < _STRAIGHT
    signal.shift = signal.added_variance = 0.0
    error = wrap_angle(signal.heading - o.leg_heading - bend)
    if o.leg > 0.0 and not (straight and error * error <= _OUTLIER_SIGMAS * _OUTLIER_SIGMAS * given):
        if o.steady > 0.0:
            # from here on b_L is again without the mean's random error
            signal.added_variance = o.scatter / o.leg
            o.other_variance, b.leader_variance = b.leader_variance, o.other_variance
        o.leg = o.steady = 0.0
        return
    if not straight:
        return
    o.leg += 1.0
    shift = error / o.leg if o.leg > 1.0 else 0.0
    o.leg_heading = o.leg_heading + bend + shift if o.leg > 1.0 else signal.heading
    if o.leg > 1.0:
        o.squares += error * (error - shift)
        o.compared += 1.0
        o.scatter = min((given + o.squares) / (1.0 + o.compared), given)
    if o.steady > 0.0:
        # the way bends half an interval earlier than the heading
        signal.shift, signal.added_variance = shift, 0.25 * bend * bend
    elif o.leg >= _LEAST_MESSAGES or o.scatter < _SMALL_SHARE * o.leg * b.covariance[0, m.leader, m.leader]:
        signal.added_variance = o.scatter / o.leg
        o.steady = 1.0
        o.other_variance, b.leader_variance = b.leader_variance, o.other_variance
    if o.steady > 0.0:
        change = wrap_angle(o.leg_heading - signal.heading)
        signal.heading += change
        _turn_arms(signal, change)


_WINDOW = 10.0
"""Longest window [s]; at the start it is shorter, so that something is known soon."""
_FIRST_WINDOW = 1.0
_GROWTH = 0.2
_TURN = 0.2
"""A window with more turn than this is not used: the way between messages is too uncertain [rad]."""
CURRENT_SIGMA = 0.05
"""Standard deviation of the mean current over a window of 10 s [m/s]."""


@compiled
def _begin_window(b: Belief, signal: Signal) -> None:
    o = b.leader
    o.window_time, o.window_x, o.window_y = signal.time, signal.east, signal.north
    o.logged_x = o.logged_y = 0.0
    o.first_heading = signal.heading


@compiled
def _update_component(
    b: Belief, m: Model, k: int, seen: tuple[float, float], logged: tuple[float, float], variance: float
) -> None:
    """Updates with z = c + v_L [u(θ_L − b_L) − u(θ_L)], east and north, linearised once; `logged` is v_L u(θ_L)."""
    x, P, gain, turning = b.state[k], b.covariance[k], b.gain, m.leader != ABSENT
    bias = x[m.leader] if turning else 0.0
    c, s = math.cos(bias), math.sin(bias)
    turned = (c * logged[0] - s * logged[1], s * logged[0] + c * logged[1])
    for axis in range(2):
        # ∂z/∂b_L; ∂z/∂c is 1
        slope = -turned[1] if axis == 0 else turned[0]
        residual, spread, state = seen[axis] - (turned[axis] - logged[axis]), variance, m.current + axis
        for i in range(m.states):
            gain[i] = P[i, state] if m.current != ABSENT else 0.0
            if turning:
                gain[i] += slope * P[i, m.leader]
        if turning:
            residual -= slope * (x[m.leader] - bias)
            spread += slope * gain[m.leader]
        if m.current != ABSENT:
            residual -= x[state]
            spread += gain[state]
        update_scalar(x, P, gain, residual, spread, m.states)


@compiled
def update_current_from_leader_track(b: Belief, m: Model, signal: Signal) -> None:
    """Take a message's pose and speed; at the end of a window update all components with the current it shows."""
    o = b.leader
    sx, sy = signal.speed * math.sin(signal.heading), signal.speed * math.cos(signal.heading)
    if o.window_time != o.window_time:
        o.first_time = signal.time
        _begin_window(b, signal)
    else:
        elapsed = signal.time - o.last_time
        o.logged_x += 0.5 * elapsed * (o.velocity_x + sx)
        o.logged_y += 0.5 * elapsed * (o.velocity_y + sy)
        turn = angle_between(signal.heading, o.first_heading)
        window = signal.time - o.window_time
        wanted = min(_WINDOW, _FIRST_WINDOW + _GROWTH * (signal.time - o.first_time))
        if turn > _TURN:
            _begin_window(b, signal)
        elif window >= wanted - 1e-6:
            per = 1.0 / window
            logged = (per * o.logged_x, per * o.logged_y)
            seen = (per * (signal.east - o.window_x) - logged[0], per * (signal.north - o.window_y) - logged[1])
            for k in range(b.alive * m.modes):
                _update_component(b, m, k, seen, logged, CURRENT_SIGMA * CURRENT_SIGMA * 10.0 * per)
            _begin_window(b, signal)
    o.velocity_x, o.velocity_y, o.last_time = sx, sy, signal.time
