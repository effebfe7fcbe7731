"""The current as the leader meets it: its way over ground, less what its log and compass say, is the water's way.

It shows on a straight leg too, where a follower's own ranges cannot tell a current from biases of log and compass. In
still water it tells the bias of the leader's compass. Needs a leader that broadcasts its speed through the water.
"""

import math

from laisn.compiled import compiled
from laisn.geometry import angle_between
from laisn.tight.belief import Belief
from laisn.tight.model import ABSENT, Model
from laisn.tight.ranging import Heard

_WINDOW = 10.0
"""Longest window [s]; at the start it is shorter, so that something is known soon."""
_FIRST_WINDOW = 1.0
_GROWTH = 0.2
_TURN = 0.2
"""A window with more turn than this says nothing: the way between messages is not known well enough [rad]."""
CURRENT_SIGMA = 0.05
"""Standard deviation of the mean current over a window of 10 s [m/s]."""


@compiled
def _begin(b: Belief, heard: Heard) -> None:
    o = b.leader
    o.window_time, o.window_x, o.window_y = heard.time, heard.east, heard.north
    o.logged_x = o.logged_y = 0.0
    o.first_heading = heard.heading


@compiled
def _learn_component(
    b: Belief, m: Model, k: int, seen: tuple[float, float], logged: tuple[float, float], variance: float
) -> None:
    """Updates with z = c + v_L [u(θ_L − b_L) − u(θ_L)], east and north, linearised once; `logged` is v_L u(θ_L)."""
    x, P, n, gain = b.state, b.covariance, m.states, b.before_state
    moving, turning = m.current != ABSENT, m.leader != ABSENT
    bias = x[k, m.leader] if turning else 0.0
    c, s = math.cos(bias), math.sin(bias)
    turned = (c * logged[0] - s * logged[1], s * logged[0] + c * logged[1])
    for axis in range(2):
        state = m.current + axis
        slope = -turned[1] if axis == 0 else turned[0]
        residual = seen[axis] - (turned[axis] - logged[axis])
        if turning:
            residual -= slope * (x[k, m.leader] - bias)
        if moving:
            residual -= x[k, state]
        spread = variance
        for i in range(n):
            gain[i] = P[k, i, state] if moving else 0.0
            if turning:
                gain[i] += slope * P[k, i, m.leader]
        if moving:
            spread += gain[state]
        if turning:
            spread += slope * gain[m.leader]
        for i in range(n):
            x[k, i] += gain[i] * residual / spread
            for j in range(i + 1):
                P[k, i, j] -= gain[i] * gain[j] / spread
                P[k, j, i] = P[k, i, j]


@compiled
def update_current_from_leader_track(b: Belief, m: Model, heard: Heard) -> None:
    """Take a message's pose and speed; at the end of a window update all components with the current it shows."""
    o = b.leader
    sx, sy = heard.speed * math.sin(heard.heading), heard.speed * math.cos(heard.heading)
    if o.window_time != o.window_time:
        o.first_time = heard.time
        _begin(b, heard)
    else:
        elapsed = heard.time - o.last_time
        o.logged_x += 0.5 * elapsed * (o.velocity_x + sx)
        o.logged_y += 0.5 * elapsed * (o.velocity_y + sy)
        turn = angle_between(heard.heading, o.first_heading)
        window = heard.time - o.window_time
        wanted = min(_WINDOW, _FIRST_WINDOW + _GROWTH * (heard.time - o.first_time))
        if turn > _TURN:
            _begin(b, heard)
        elif window >= wanted - 1e-6:
            per = 1.0 / window
            logged = (per * o.logged_x, per * o.logged_y)
            seen = (per * (heard.east - o.window_x) - logged[0], per * (heard.north - o.window_y) - logged[1])
            for k in range(b.alive * m.modes):
                _learn_component(b, m, k, seen, logged, CURRENT_SIGMA * CURRENT_SIGMA * 10.0 * per)
            _begin(b, heard)
    o.velocity_x, o.velocity_y, o.last_time, o.last_heading = sx, sy, heard.time, heard.heading
