"""Ranges: predicted for a component, and the update with them.

A range is z_i = ρ_i (1 + b_r / max ρ) + d_i with ρ_i = |p − o − e − w − Rot(b_L) a_i|: o is the
leader's origin as broadcast, e and w its errors, a_i the arm from it to a transmitter as the
broadcast heading places it, and Rot turns anticlockwise by the leader's compass bias.

Where pings leave one after the other, or arrived some time ago, p is the place at their arrival:
less the way since then, Rot(b_θ) (A − b_v B), with the sums of `laisn.tight.motion`. The leader's
way until a ping left is in a_i. What the current carried both since the message's time is
c (t − t_m − ρ_i / c_s).
"""

import math
from typing import cast

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, copy_values, inlined
from laisn.tight.model import COMPASS_BIAS, LOG_BIAS, RANGE_SCALE, X, Y
from laisn.tight.records import (
    ABSENT,
    RANGE_MESSAGE,
    WAY_XX,
    WAY_XY,
    WAY_YY,
    GaussianMixture,
    Model,
    RangeMessage,
)
from laisn.vector_math import log, sin_cos

_LOG_TURN = math.log(2.0 * math.pi)
# log likelihood that an echo loses if its range is shorter than expected, which no echo is
_SHORT_ECHO_PENALTY = 6.0
# the leader's error is estimated from a message if it leaves less than this share of its variance
_INFORMATIVE = 0.5
_MIN_DISTANCE = 0.01  # nearer to a transmitter than this the direction to it means nothing [m]
# within this of a transmitter ranges are linearised a second time, at the updated position, where
# that is so many lateral standard deviations from the axis; nearer to it that would bias the side
_RELINEARISE_DISTANCE = 12.0
_CLEAR_SIGMAS = 3.0
# Two transmitters do not observe a motion that scales all ranges alike with b_r. Errors of the
# linearisation seem to observe it: they repeat from message to message, and come to more than their
# second-order terms. As an error of each range, σ = 0.12 m³ / ρ², with ρ of 1 m and more.
_NEAR_ERROR = 0.12
_MIN_RANGE = 1.0


def new_range_message() -> RangeMessage:
    """Room for a message."""
    return cast(RangeMessage, np.zeros(1, dtype=RANGE_MESSAGE)[0])


@inlined
def relative_position(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage
) -> tuple[float, float]:
    """Place of component k from the leader's true origin, east and north [m]."""
    x = b.state
    qx = x[k, X] - message.east
    qy = x[k, Y] - message.north
    if m.leader_position != ABSENT:
        qx -= x[k, m.leader_position]
        qy -= x[k, m.leader_position + 1]
    if m.leader_position_walk != ABSENT:
        qx -= x[k, m.leader_position_walk]
        qy -= x[k, m.leader_position_walk + 1]
    return qx, qy


@inlined
def relative_covariance(b: GaussianMixture, m: Model, k: int) -> tuple[Floats, Floats]:
    """Covariance of `relative_position`, east and north, with the states, shapes (n,)."""
    P = b.covariance
    relative_cov_x = P[k, X]
    relative_cov_y = P[k, Y]
    if m.leader_position != ABSENT or m.leader_position_walk != ABSENT:
        relative_cov_x = b.work.relative_covariance[0]
        relative_cov_y = b.work.relative_covariance[1]
        for h in range(m.n_states):
            relative_cov_x[h] = P[k, X, h]
            relative_cov_y[h] = P[k, Y, h]
        if m.leader_position != ABSENT:
            for h in range(m.n_states):
                relative_cov_x[h] -= P[k, m.leader_position, h]
                relative_cov_y[h] -= P[k, m.leader_position + 1, h]
        if m.leader_position_walk != ABSENT:
            for h in range(m.n_states):
                relative_cov_x[h] -= P[k, m.leader_position_walk, h]
                relative_cov_y[h] -= P[k, m.leader_position_walk + 1, h]
    return relative_cov_x, relative_cov_y


@inlined
def _relative_component(m: Model, row: Floats, axis: int) -> float:
    """Of covariances with the states, shape (n,), that with `relative_position` along an axis."""
    value: float = row[X + axis]
    if m.leader_position != ABSENT:
        value -= row[m.leader_position + axis]
    if m.leader_position_walk != ABSENT:
        value -= row[m.leader_position_walk + axis]
    return value


@inlined
def way_since_ping(
    b: GaussianMixture, k: int, message: RangeMessage, i: int
) -> tuple[float, float, float, float]:
    """The way of the follower through the water since ping i arrived, by the biases of component k,
    east and north, [m]; and by how much it is shorter for 1 m/s of b_v, [s].
    """
    s, c = sin_cos(b.state[k, COMPASS_BIAS])
    bias = b.state[k, LOG_BIAS]
    bx = message.way[i, 2]
    by = message.way[i, 3]
    ax = message.way[i, 0] - bias * bx
    ay = message.way[i, 1] - bias * by
    return c * ax - s * ay, s * ax + c * ay, c * bx - s * by, s * bx + c * by


@compiled
def _add_delays(b: GaussianMixture, m: Model, k: int, message: RangeMessage, count: int) -> None:
    """Add what the time since each ping arrived changes to residuals' derivatives `row_log` and
    `row_compass`, and to `ph`.
    """
    w = b.work
    P = b.covariance
    for j in range(count):
        i = w.used[j]
        # p is the place less Rot(b_θ) (A − b_v B) and c · drift time: h = ∂ρ/∂(b_v, b_θ, c), and
        # h P
        way_x, way_y, by_log_x, by_log_y = way_since_ping(b, k, message, i)
        w.row_log[i] = w.row_x[i] * by_log_x + w.row_y[i] * by_log_y
        w.row_compass[i] = w.row_x[i] * way_y - w.row_y[i] * way_x
        for h in range(m.n_states):
            w.ph[i, h] += (
                P[k, LOG_BIAS, h] * w.row_log[i] + P[k, COMPASS_BIAS, h] * w.row_compass[i]
            )
        if m.current != ABSENT:
            east = -message.drift_time[i] * w.row_x[i]
            north = -message.drift_time[i] * w.row_y[i]
            for h in range(m.n_states):
                w.ph[i, h] += P[k, m.current, h] * east + P[k, m.current + 1, h] * north


@inlined
def _delay_covariance(b: GaussianMixture, m: Model, message: RangeMessage, i: int, g: int) -> float:
    """What the delays of pings i and g add to the covariance of their ranges [m²]: through log,
    compass and current, and by what dead reckoning errs from the later of them until the last ping
    of the message; see `laisn.delays.Ways`. Where the speed is a state, which errs less than the
    way by the log's readings, it is what they err until now.
    """
    w = b.work
    value: float = w.row_log[i] * w.ph[g, LOG_BIAS] + w.row_compass[i] * w.ph[g, COMPASS_BIAS]
    if m.current != ABSENT:
        east = w.row_x[i] * w.ph[g, m.current]
        north = w.row_y[i] * w.ph[g, m.current + 1]
        value -= message.drift_time[i] * (east + north)
    later = message.way[i] if message.way[i, WAY_XX] < message.way[g, WAY_XX] else message.way[g]
    slope, other = message.way_by_mean_speed[i], message.way_by_mean_speed[g]
    xx, xy, yy = later[WAY_XX], later[WAY_XY], later[WAY_YY]
    if m.speed == ABSENT:
        last = message.way[message.last_to_arrive]
        xx -= last[WAY_XX]
        xy -= last[WAY_XY]
        yy -= last[WAY_YY]
    value += w.row_x[i] * xx * w.row_x[g] + w.row_y[i] * yy * w.row_y[g]
    value += xy * (w.row_x[i] * w.row_y[g] + w.row_y[i] * w.row_x[g])
    along = w.row_x[i] * slope[0] + w.row_y[i] * slope[1]
    value += along * (w.row_x[g] * other[0] + w.row_y[g] * other[1])
    return value


@compiled
def predict_ranges(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage, turn: float, turn_variance: float
) -> int:
    """Residuals of the ranges for component k, with derivatives and covariances, into `b.work`; how
    many there are.

    Second-order EKF (Bar-Shalom, Li & Kirubarajan 2001): ½ tr(F_i P) in the mean and
    ½ tr(F_i P F_j P) in the covariance, F_i being the second derivatives of range i by position and
    leader's compass. It is linearised at `work.shift` from the mean, and about a random error of
    the leader's heading, `turn`, of whose variance `turn_variance` is left [rad²].
    """
    w = b.work
    count = 0
    farthest = 0.0
    for i in range(m.transmitters):
        if message.ranges[i] == message.ranges[i]:
            w.received[count] = w.used[count] = i
            count += 1
            farthest = max(farthest, message.ranges[i])
    per_farthest = 1.0 / max(farthest, _MIN_DISTANCE)
    for j in range(count):
        i = w.used[j]
        w.row_scale[i] = message.ranges[i] * per_farthest
        _linearise_range(b, m, k, message, i, turn, turn_variance)
    if message.late:
        _add_delays(b, m, k, message, count)
    _fill_innovation_covariance(b, m, k, message, count)
    return count


@compiled
def _linearise_range(
    b: GaussianMixture,
    m: Model,
    k: int,
    message: RangeMessage,
    i: int,
    turn: float,
    turn_variance: float,
) -> None:
    """Residual of range i, its derivatives h, its second derivatives F times P, and h P."""
    w = b.work
    x = b.state
    P = b.covariance
    leader_bias = m.leader_bias
    clock = m.clock
    has_leader_bias = leader_bias != ABSENT
    hl = 0.0
    bias = x[k, leader_bias] + turn if has_leader_bias else 0.0
    s, c = sin_cos(bias)
    shift_x = w.shift[0]
    shift_y = w.shift[1]
    qx, qy = relative_position(b, m, k, message)
    qx += shift_x
    qy += shift_y
    if message.late:
        way_x, way_y, _, _ = way_since_ping(b, k, message, i)
        qx -= way_x
        qy -= way_y
        if m.current != ABSENT:
            qx -= message.drift_time[i] * x[k, m.current]
            qy -= message.drift_time[i] * x[k, m.current + 1]
    relative_cov_x, relative_cov_y = relative_covariance(b, m, k)
    pxx = _relative_component(m, relative_cov_x, 0) - w.removed[0]
    pxy = _relative_component(m, relative_cov_x, 1) - w.removed[1]
    pyy = _relative_component(m, relative_cov_y, 1) - w.removed[2]
    # ρ = |q − Rot(b_L) a|, h = ∂ρ/∂(x, y, b_L)
    ax, ay = message.arms[i, 0], message.arms[i, 1]
    sx, sy = c * ax - s * ay, s * ax + c * ay
    dx, dy, dz = qx - sx, qy - sy, message.arms[i, 2]
    rho = max(math.sqrt(dx * dx + dy * dy + dz * dz), _MIN_DISTANCE)
    per_rho = 1.0 / rho
    hx, hy = dx * per_rho, dy * per_rho
    share = w.row_scale[i]
    w.row_x[i] = hx
    w.row_y[i] = hy
    # F P with F = (∂q/∂(x, y, b_L)ᵀ ∂q/∂(x, y, b_L) + q · ∂²q/∂b_L² − h hᵀ) / ρ
    fxx = (1.0 - hx * hx) * per_rho
    fxy = -hx * hy * per_rho
    fyy = (1.0 - hy * hy) * per_rho
    f = w.curvature
    f[i, 0, 0] = fxx * pxx + fxy * pxy
    f[i, 0, 1] = fxx * pxy + fxy * pyy
    f[i, 1, 0] = fxy * pxx + fyy * pxy
    f[i, 1, 1] = fxy * pxy + fyy * pyy
    mean_shift = f[i, 0, 0] + f[i, 1, 1]
    if has_leader_bias:
        hl = hx * sy - hy * sx
        w.row_leader[i] = hl
        fxl = (sy - hx * hl) * per_rho
        fyl = (-sx - hy * hl) * per_rho
        fll = (qx * sx + qy * sy - hl * hl) * per_rho
        pxl = relative_cov_x[leader_bias]
        pyl = relative_cov_y[leader_bias]
        # the random error of this heading turns the arms just as the bias does
        pll = P[k, leader_bias, leader_bias] + turn_variance
        f[i, 0, 0] += fxl * pxl
        f[i, 0, 1] += fxl * pyl
        f[i, 0, 2] = fxx * pxl + fxy * pyl + fxl * pll
        f[i, 1, 0] += fyl * pxl
        f[i, 1, 1] += fyl * pyl
        f[i, 1, 2] = fxy * pxl + fyy * pyl + fyl * pll
        f[i, 2, 0] = fxl * pxx + fyl * pxy + fll * pxl
        f[i, 2, 1] = fxl * pxy + fyl * pyy + fll * pyl
        f[i, 2, 2] = fxl * pxl + fyl * pyl + fll * pll
        mean_shift = f[i, 0, 0] + f[i, 1, 1] + f[i, 2, 2] - 2.0 * hl * turn
    # ẑ = ρ − h · (where it is linearised − mean) + ½ tr(F P) + scale, offset and clock
    expected = rho - hx * shift_x - hy * shift_y + share * x[k, RANGE_SCALE] + 0.5 * mean_shift
    if m.offset != ABSENT and i > 0:
        expected += x[k, m.offset + i - 1]
    if clock != ABSENT:
        expected += x[k, clock]
    w.residual[i] = message.ranges[i] - expected
    # h P, by loops over contiguous rows of the symmetric P, which are vectorised
    ph = w.ph[i]
    n = m.n_states
    for h in range(n):
        ph[h] = relative_cov_x[h] * hx + relative_cov_y[h] * hy + P[k, RANGE_SCALE, h] * share
    if has_leader_bias:
        for h in range(n):
            ph[h] += P[k, leader_bias, h] * hl
    if m.offset != ABSENT and i > 0:
        offset = m.offset + i - 1
        for h in range(n):
            ph[h] += P[k, offset, h]
    if clock != ABSENT:
        for h in range(n):
            ph[h] += P[k, clock, h]


@compiled
def _fill_innovation_covariance(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage, count: int
) -> None:
    """S = H P Hᵀ + σ² I + σ_s² s sᵀ + σ_L² h_L h_Lᵀ + [½ tr(F_i P F_j P)], into
    `work.innovation_covariance`.
    """
    w = b.work
    has_leader_bias = m.leader_bias != ABSENT
    for j in range(count):
        i = w.used[j]
        for h in range(j + 1):
            g = w.used[h]
            # `value` is h_i P h_gᵀ, `second` tr(F_i P F_g P), `noise` those that ranges share
            f = w.curvature[i]
            e = w.curvature[g]
            second = f[0, 0] * e[0, 0] + f[0, 1] * e[1, 0] + f[1, 0] * e[0, 1] + f[1, 1] * e[1, 1]
            noise = m.range_scale_variance * w.row_scale[i] * w.row_scale[g]
            value = (
                w.row_x[i] * _relative_component(m, w.ph[g], 0)
                + w.row_y[i] * _relative_component(m, w.ph[g], 1)
                + w.row_scale[i] * w.ph[g, RANGE_SCALE]
            )
            if message.late:
                value += _delay_covariance(b, m, message, i, g)
            if has_leader_bias:
                second += (
                    f[0, 2] * e[2, 0] + f[2, 0] * e[0, 2] + f[1, 2] * e[2, 1] + f[2, 1] * e[1, 2]
                )
                second += f[2, 2] * e[2, 2]
                noise += b.leader_variance * w.row_leader[i] * w.row_leader[g]
                value += w.row_leader[i] * w.ph[g, m.leader_bias]
            if m.offset != ABSENT and i > 0:
                value += w.ph[g, m.offset + i - 1]
            if m.clock != ABSENT:
                value += w.ph[g, m.clock]
            value += noise + 0.5 * second
            if i == g:
                value += m.range_sigma * m.range_sigma
                if m.transmitters == 2:
                    rho = max(message.ranges[i], _MIN_RANGE)
                    value += (_NEAR_ERROR / (rho * rho)) ** 2
            w.innovation_covariance[i, g] = w.innovation_covariance[g, i] = value


@compiled
def _likelihood(b: GaussianMixture, count: int) -> tuple[float, float]:
    """Logarithm of the density of the ranges in `work.used`, and their squared residuals in units
    of S.

    NaN if S is not positive definite. Leaves its Cholesky factor L and whitened residuals L⁻¹ (z −
    ẑ) in `work`.
    """
    w = b.work
    L = b.work.root
    # S = L Lᵀ; log N = −½ (νᵀ ν + n log 2π) − Σ log L_ii with ν = L⁻¹ (z − ẑ)
    squared = 0.0
    volume = 1.0
    for i in range(count):
        for j in range(i + 1):
            value = w.innovation_covariance[w.used[i], w.used[j]]
            for h in range(j):
                value -= L[i, h] * L[j, h]
            if i > j:
                L[i, j] = value * w.per_root[j]
            elif value > 0.0:
                L[i, i] = math.sqrt(value)
                w.per_root[i] = 1.0 / L[i, i]
            else:
                # NaN comes here too
                return math.nan, math.nan
        white = w.residual[w.used[i]]
        for h in range(i):
            white -= L[i, h] * w.white[h]
        w.white[i] = white * w.per_root[i]
        squared += w.white[i] * w.white[i]
        volume *= L[i, i]
    return -0.5 * (squared + count * _LOG_TURN) - log(volume), squared


@compiled
def _marginalise_common_echo(b: GaussianMixture, count: int) -> tuple[float, float, float]:
    """Whitened residuals of an echo common to all ranges in `work.used`, whose excess e has a flat
    prior.

    With S = L Lᵀ, whitened residuals ν and u = L⁻¹ 1 the density is ∫ N(z − ẑ − e 1; S) de, in
    which only the part of ν across u is left. Follows `_likelihood`; `work.white` is overwritten.
    Returns the likeliest e [m], by how much the squared residuals are smaller, ê² uᵀu, and log uᵀu.
    """
    w = b.work
    size = 0.0  # uᵀ u
    match = 0.0  # uᵀ ν
    for i in range(count):
        value = 1.0
        for h in range(i):
            value -= w.root[i, h] * w.common[h]
        w.common[i] = value * w.per_root[i]
        size += w.common[i] * w.common[i]
        match += w.common[i] * w.white[i]
    excess = match / size
    per_size = 1.0 / math.sqrt(size)
    for i in range(count):
        w.white[i] -= excess * w.common[i]
        w.common[i] *= per_size
    return excess, excess * match, log(size)


@inlined
def _mean_range(b: GaussianMixture, message: RangeMessage, count: int) -> float:
    total = 0.0
    for j in range(count):
        total += message.ranges[b.work.used[j]]
    return total / count


@inlined
def _mean_residual(b: GaussianMixture, count: int) -> float:
    total = 0.0
    for j in range(count):
        total += b.work.residual[b.work.used[j]]
    return total / count


@inlined
def _variance_of_mean(b: GaussianMixture, count: int) -> float:
    """Variance of the mean of the residuals in `work.used` [m²]."""
    total = 0.0
    for j in range(count):
        for h in range(count):
            total += b.work.innovation_covariance[b.work.used[j], b.work.used[h]]
    return total / (count * count)


@compiled
def _add_common_echo(b: GaussianMixture, message: RangeMessage, count: int) -> None:
    """Take out of the residuals in `work.used` what a common echo of excess e has done to their
    differences, and add to S what of that is uncertain.

    A late ping leaves them as they are. A reflection at the surface or the floor adds the same to
    the square of each range, and so −e (ρ_i − ρ̄) / (ρ̄ − e) beside e. `work.tilt` is e / (ρ̄ − e),
    and `work.tilt_variance` the variance of that; both are 0 for a late ping.
    """
    w = b.work
    mean = _mean_range(b, message, count)
    for j in range(count):
        i = w.used[j]
        w.residual[i] += w.tilt * (message.ranges[i] - mean)
        for h in range(count):
            g = w.used[h]
            w.innovation_covariance[i, g] += (
                w.tilt_variance * (message.ranges[i] - mean) * (message.ranges[g] - mean)
            )


@compiled
def _weigh_common_echo(
    b: GaussianMixture, m: Model, message: RangeMessage, count: int, span: float
) -> float:
    """Logarithm of the density of the ranges in `work.used` if all have an echo in common, of
    `work.tilt`, and excesses are spread evenly over a `span` [m]; restores residuals and S.
    """
    w = b.work
    copy_values(w.residual, w.direct_residual)
    for i in range(w.innovation_covariance.shape[0]):
        copy_values(w.innovation_covariance[i], w.direct_covariance[i])
    _add_common_echo(b, message, count)
    density, _ = _likelihood(b, count)
    _, reduction, log_size = _marginalise_common_echo(b, count)
    copy_values(w.direct_residual, w.residual)
    for i in range(w.innovation_covariance.shape[0]):
        copy_values(w.direct_covariance[i], w.innovation_covariance[i])
    return float(
        density
        + (m.log_p_outlier - log(span))
        + count * m.log_p_inlier
        + 0.5 * (reduction + _LOG_TURN - log_size)
    )


@inlined
def _update_component(b: GaussianMixture, m: Model, k: int, count: int) -> None:
    """Update component k: x += W ν and P −= W Wᵀ with W = P Hᵀ L⁻ᵀ, less its part along a shared
    echo, and whitened residuals ν.
    """
    w = b.work
    x = b.state
    P = b.covariance
    n = m.n_states
    white_ph = w.white_ph
    # Wᵀ = L⁻¹ H P by forward substitution, and x += W ν: loops over contiguous rows, which are
    # vectorised
    for j in range(count):
        ph = w.ph[w.used[j]]
        per_root = w.per_root[j]
        white = w.white[j]
        for h in range(n):
            white_ph[j, h] = ph[h]
        for i in range(j):
            root = w.root[j, i]
            for h in range(n):
                white_ph[j, h] -= root * white_ph[i, h]
        for h in range(n):
            white_ph[j, h] *= per_root
            x[k, h] += white_ph[j, h] * white
    if w.shared:
        for h in range(n):
            match = 0.0
            for j in range(count):
                match += white_ph[j, h] * w.common[j]
            for j in range(count):
                white_ph[j, h] -= match * w.common[j]
    for j in range(count, 3):
        for h in range(n):
            white_ph[j, h] = 0.0
    # P −= W Wᵀ
    for h in range(n):
        first = white_ph[0, h]
        second = white_ph[1, h]
        third = white_ph[2, h]
        for i in range(n):
            P[k, h, i] = (
                P[k, h, i]
                - first * white_ph[0, i]
                - second * white_ph[1, i]
                - third * white_ph[2, i]
            )


@compiled
def _is_near(b: GaussianMixture, m: Model, k: int, message: RangeMessage, count: int) -> bool:
    """Whether component k is so near to a transmitter of a range in `work.used` that the circle of
    that range is not straight, and clear of the axis of two transmitters.
    """
    w = b.work
    nearest = math.inf
    for j in range(count):
        nearest = min(nearest, message.ranges[w.used[j]])
    if count < 2 or not nearest < _RELINEARISE_DISTANCE:
        return False
    # the shift is that of the follower alone
    if m.leader_position != ABSENT or m.leader_position_walk != ABSENT or message.late:
        return False
    if m.transmitters > 2:
        return True
    # ℓ = t × (q − a_1) with t the direction from transmitter 1 to 2, and its variance tᵀ P t
    arms = message.arms
    P = b.covariance
    ex, ey = arms[1, 0] - arms[0, 0], arms[1, 1] - arms[0, 1]
    off_x = b.state[k, X] - message.east - arms[0, 0]
    off_y = b.state[k, Y] - message.north - arms[0, 1]
    lateral = ex * off_y - ey * off_x
    variance = ey * ey * P[k, X, X] - 2.0 * ex * ey * P[k, X, Y] + ex * ex * P[k, Y, Y]
    return bool(lateral * lateral > _CLEAR_SIGMAS * _CLEAR_SIGMAS * variance)


@compiled
def _linearise_at_update(b: GaussianMixture, count: int) -> None:
    """Put the linearisation to where an update would move the position, W ν, and what it takes of
    its covariance, W Wᵀ, into `work`; W as of `_update_component`.
    """
    w = b.work
    rows = w.white_ph
    w.shift[0] = w.shift[1] = w.removed[0] = w.removed[1] = w.removed[2] = 0.0
    for j in range(count):
        for h in range(2):
            value = w.ph[w.used[j], h]
            for i in range(j):
                value -= w.root[j, i] * rows[i, h]
            rows[j, h] = value * w.per_root[j]
            w.shift[h] += rows[j, h] * w.white[j]
        w.removed[0] += rows[j, X] * rows[j, X]
        w.removed[1] += rows[j, X] * rows[j, Y]
        w.removed[2] += rows[j, Y] * rows[j, Y]


@inlined
def _leader_turn(b: GaussianMixture, count: int) -> tuple[float, float]:
    """Mean and variance of the random error w of the leader's heading, given the whitened
    residuals: a priori 0 and v; with g the derivative of the ranges by the heading, v gᵀ S⁻¹ e, and
    v − v² gᵀ S⁻¹ g.
    """
    w = b.work
    v = b.leader_variance
    # with t = L⁻¹ g and ν = L⁻¹ e: tᵀ ν, and tᵀ t
    match = 0.0
    size = 0.0
    for i in range(count):
        value = w.row_leader[w.used[i]]
        for h in range(i):
            value -= w.root[i, h] * w.turned[h]
        w.turned[i] = value * w.per_root[i]
        match += w.turned[i] * w.white[i]
        size += w.turned[i] * w.turned[i]
    if w.shared:
        echo_part = 0.0
        for i in range(count):
            echo_part += w.turned[i] * w.common[i]
        size -= echo_part * echo_part
    return v * match, v - v * v * size


@inlined
def _use_subset(b: GaussianMixture, received: int, mask: int) -> int:
    """Put those of the received ranges into `work.used` whose bit is set in the mask; how many
    these are.
    """
    w = b.work
    used = 0
    for j in range(received):
        if (mask >> j) & 1:
            w.used[used] = w.received[j]
            used += 1
    return used


@compiled
def _select_ranges(
    b: GaussianMixture, m: Model, k: int, message: RangeMessage, received: int, density: float
) -> int:
    """Keep the likeliest of all subsets of ranges, or all with a common echo, in `b.work.used`;
    how many these are. `density` is the logarithm of the density of all received ranges.
    """
    w = b.work
    all_ranges = (1 << received) - 1
    best = density + received * m.log_p_inlier
    w.mask = all_ranges
    for mask in range(all_ranges):
        total = 0.0
        for j in range(received):
            if not (mask >> j) & 1:
                total += m.log_density_outlier - (
                    _SHORT_ECHO_PENALTY if w.residual[w.received[j]] < 0.0 else 0.0
                )
        used = _use_subset(b, received, mask)
        density, _ = _likelihood(b, used)
        total += density + used * m.log_p_inlier
        if total > best:
            best = total
            w.mask = mask
    _use_subset(b, received, all_ranges)
    excess = _mean_residual(b, received)
    span = max(m.outlier_span, message.echo_span)
    if received > 1 and 0.0 < excess < span:
        # a late ping, and a reflection
        direct = max(_mean_range(b, message, received) - excess, _MIN_DISTANCE)
        w.tilt = 0.0
        w.tilt_variance = 0.0
        late = _weigh_common_echo(b, m, message, received, span)
        w.tilt = excess / direct
        w.tilt_variance = _variance_of_mean(b, received) / (direct * direct)
        reflected = _weigh_common_echo(b, m, message, received, span)
        if late >= reflected:
            w.tilt = 0.0
            w.tilt_variance = 0.0
        if max(late, reflected) > best:
            best = max(late, reflected)
            w.mask = all_ranges
            w.shared = 1
            _add_common_echo(b, message, received)
    b.evidence[k] = best
    return _use_subset(b, received, w.mask)


@compiled
def update(b: GaussianMixture, m: Model, k: int, message: RangeMessage) -> int:
    """Update component k with the ranges of a message, without those that look like echoes. Returns
    how many it used, less one if these have an echo in common.

    −1: a covariance was not positive definite. Sets `outcome`, `evidence` and `turn_excess`. Where
    the leader's heading errs at random and the ranges determine by how much, they are linearised
    about that, and near a transmitter at the updated position: about the broadcast heading, and at
    the prediction, derivatives and residuals would err together, which in hundreds of messages adds
    up to a bias.
    """
    v = b.leader_variance
    w = b.work
    w.mask = 7
    w.shared = 0
    w.shift[0] = w.shift[1] = w.removed[0] = w.removed[1] = w.removed[2] = 0.0
    received = predict_ranges(b, m, k, message, 0.0, v)
    outcome = b.outcome[k]
    outcome.n_used = 0
    outcome.shared = 0
    outcome.normalised_innovation = 0.0
    b.evidence[k] = b.turn_excess[k] = 0.0
    if received == 0:
        return 0
    density, squared = _likelihood(b, received)
    if density != density:
        return -1
    used = received
    largest = 0.0
    b.evidence[k] = density + received * m.log_p_inlier
    for j in range(received):
        i = b.work.used[j]
        largest = max(largest, b.work.innovation_covariance[i, i])
    # no range can be an echo where leaving any out would cost more likelihood than it could gain
    if not 0.5 * squared < m.log_p_inlier - m.log_density_outlier - 0.5 * (
        _LOG_TURN + log(largest)
    ):
        used = _select_ranges(b, m, k, message, received, density)
        density, squared = _likelihood(b, used)
        if b.work.shared:
            squared -= _marginalise_common_echo(b, used)[1]
    # the excess of a common echo is estimated of the ranges, and takes one degree of freedom
    dof: int = used - b.work.shared
    echo_cost = 2.0 * (received - dof) * (m.log_p_inlier - m.log_density_outlier)
    outcome.n_used = dof
    outcome.shared = w.shared
    outcome.nis_sum = squared
    outcome.normalised_innovation = (squared + echo_cost) / received
    turn = 0.0
    left_variance = v
    is_revised = False
    if m.leader_bias != ABSENT and used > 0:
        estimate, remaining = _leader_turn(b, used)
        b.turn_excess[k] = estimate * estimate + remaining - v
        if remaining < _INFORMATIVE * v:
            turn = estimate
            left_variance = remaining
            is_revised = True
    if not w.shared and _is_near(b, m, k, message, used):
        _linearise_at_update(b, used)
        is_revised = True
    if is_revised:
        predict_ranges(b, m, k, message, turn, left_variance)
        _use_subset(b, received, w.mask)
        if w.shared:
            _add_common_echo(b, message, used)
        density, squared = _likelihood(b, used)
        if density != density:
            return -1
        if w.shared:
            _marginalise_common_echo(b, used)
    _update_component(b, m, k, used)
    return dof
