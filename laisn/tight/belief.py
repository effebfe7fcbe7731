"""What a follower believes: a mixture of Gaussians in arrays of fixed size, and what it has sensed since a message."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled
from laisn.tight.model import ABSENT, Model
from laisn.tight.settings import TightSettings
from laisn.tight.states import COMPASS, LOG, SCALE, X, Y

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

KEPT = 4
"""Hypotheses that are kept from message to message."""
ROOM = 2 * KEPT
"""Hypotheses that there is room for while they are split."""

# `Belief.motion`: way by log and compass since the last message, in their own directions.
AX, AY = 0, 1
"""A = Σ v u Δt, with the measured speed v in the measured direction u [m]."""
BX, BY = 2, 3
"""B = Σ u Δt [s]."""
NXX, NXY, NYY = 4, 5, 6
"""Covariance of A's random errors [m²]."""
TIME = 7
"""Since the last message [s]."""
SPEED, SIN, COS = 8, 9, 10
"""The last reading of the log [m/s], and the direction of the last reading of the compass; NaN before the first one."""
MESSAGE_SIN, MESSAGE_COS = 11, 12
"""Direction at the last message."""
_MOTION_SIZE = 13

# `Belief.leader`: window over which the leader's way is held against its log and compass.
WINDOW_TIME, WINDOW_X, WINDOW_Y = 0, 1, 2
"""When and where it began; the time is NaN before the first message."""
LOGGED_X, LOGGED_Y = 3, 4
"""Σ s_L u(θ_L) Δt since then [m]."""
LOGGED_SX, LOGGED_SY = 5, 6
"""… and s_L u(θ_L) of the last message [m/s]."""
FIRST_HEADING, LAST_TIME, LAST_HEADING = 7, 8, 9
FIRST_TIME = 10
"""Of the first message of all."""
_LEADER_SIZE = 11

# `Belief.output`: the mean over the mixture is X + C A − D B + V T, with rotations C and D as complex numbers.
OUT_X, OUT_Y, C_COS, C_SIN, D_COS, D_SIN, V_X, V_Y = range(8)
_OUTPUT_SIZE = 8


class Work(NamedTuple):
    """Room for the ranges of one message and one component; t is 3."""

    residual: Floats
    """z − ẑ, shape (t,), [m]."""
    row_x: Floats
    """Derivative of each range with respect to x, shape (t,) …"""
    row_y: Floats
    row_scale: Floats
    row_leader: Floats
    curvature: Floats
    """Second derivative of each range by (x, y, b_L), times their covariance; shape (t, 3, 3)."""
    spread: Floats
    """S: covariance of the residuals, shape (t, t), [m²]."""
    root: Floats
    """Cholesky factor of S, over the ranges that are used, shape (t, t)."""
    white: Floats
    """Their residuals in units of it, shape (t,)."""
    turned: Floats
    """`row_leader` in units of it, shape (t,)."""
    gain: Floats
    """P Hᵀ, shape (n, t)."""
    white_gain: Floats
    """P Hᵀ root⁻ᵀ, over the ranges that are used, shape (n, t)."""
    used: Ints
    """Which ranges are used, shape (t,)."""


class Belief(NamedTuple):
    """A mixture: component `hypothesis · modes + mode`; arrays have room for all, `alive[0]` hypotheses are alive."""

    mean: Floats
    """Shape (components, n)."""
    covariance: Floats
    """Shape (components, n, n)."""
    weight: Floats
    """Shape (components,); the sum over those alive is 1."""
    evidence: Floats
    """Logarithm of what a message says for each component, shape (components,)."""
    surprise: Floats
    """Squared residuals of a component in units of S, a degree of freedom, shape (components,)."""
    turn_excess: Floats
    """By how much a message says that this variance should be larger, shape (components,), [rad²]."""
    alive: Ints
    """Hypotheses alive, shape (1,)."""
    motion: Floats
    leader: Floats
    output: Floats
    health: Floats
    """Smoothed surprise, messages in a row without a range that was believed, and the variance of the random error of
    the leader's heading as learnt so far [rad²]; shape (3,)."""
    fresh: Floats
    """Variances at the start, shape (n,)."""
    before_mean: Floats
    """Shape (n,); a component before the motion since the last message …"""
    before_covariance: Floats
    """… and its covariance, shape (n, n)."""
    work: Work


SURPRISE, REJECTED, LEADER_VARIANCE = range(3)
"""Indices of `Belief.health`."""


@compiled
def refresh_output(b: Belief, m: Model) -> None:
    """Prepare the mean position over the mixture for the steps until the next message."""
    out = b.output
    out[:] = 0.0
    for k in range(b.alive[0] * m.modes):
        w = b.weight[k]
        cosine, sine, bias = np.cos(b.mean[k, COMPASS]), np.sin(b.mean[k, COMPASS]), b.mean[k, LOG]
        out[OUT_X] += w * b.mean[k, X]
        out[OUT_Y] += w * b.mean[k, Y]
        out[C_COS] += w * cosine
        out[C_SIN] += w * sine
        out[D_COS] += w * cosine * bias
        out[D_SIN] += w * sine * bias
        if m.current != ABSENT:
            out[V_X] += w * b.mean[k, m.current]
            out[V_Y] += w * b.mean[k, m.current + 1]


def new_belief(settings: TightSettings, m: Model, start: tuple[float, float]) -> Belief:
    """One hypothesis: a known start, and biases of zero with the standard deviations of the settings."""
    n, components = m.size, ROOM * m.modes
    sigma = np.empty(n)
    sigma[[X, Y]] = settings.start_sigma
    sigma[LOG], sigma[COMPASS] = settings.speed_bias_sigma, settings.heading_bias_sigma
    sigma[SCALE] = settings.range_scale_bias_sigma
    if m.leader != ABSENT:
        sigma[m.leader] = settings.leader_heading_bias_sigma
    if m.current != ABSENT:
        sigma[m.current : m.current + 2] = settings.current_sigma
    if m.offset != ABSENT:
        sigma[m.offset :] = settings.offset_sigma
    t = 3
    work = Work(
        residual=np.zeros(t),
        row_x=np.zeros(t),
        row_y=np.zeros(t),
        row_scale=np.zeros(t),
        row_leader=np.zeros(t),
        curvature=np.zeros((t, 3, 3)),
        spread=np.zeros((t, t)),
        root=np.zeros((t, t)),
        white=np.zeros(t),
        turned=np.zeros(t),
        gain=np.zeros((n, t)),
        white_gain=np.zeros((n, t)),
        used=np.zeros(t, dtype=np.int64),
    )
    belief = Belief(
        mean=np.zeros((components, n)),
        covariance=np.zeros((components, n, n)),
        weight=np.zeros(components),
        evidence=np.zeros(components),
        surprise=np.zeros(components),
        turn_excess=np.zeros(components),
        alive=np.ones(1, dtype=np.int64),
        motion=np.zeros(_MOTION_SIZE),
        leader=np.zeros(_LEADER_SIZE),
        output=np.zeros(_OUTPUT_SIZE),
        health=np.array([1.0, 0.0, m.leader_variance]),
        fresh=sigma**2,
        before_mean=np.zeros(n),
        before_covariance=np.zeros((n, n)),
        work=work,
    )
    belief.motion[SPEED] = belief.leader[WINDOW_TIME] = np.nan
    belief.mean[: m.modes, [X, Y]] = start
    belief.covariance[: m.modes] = np.diag(sigma**2)
    belief.weight[: m.modes] = 1.0 / m.modes
    refresh_output(belief, m)
    return belief
