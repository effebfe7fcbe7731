"""Motion between messages: dead reckoning of the follower, and heading and current from the
leader's track.

Readings are preintegrated: the sums A = Σ v u Δt and B = Σ u Δt do not depend on the biases, so
that each component is predicted once a message (Lupton & Sukkarieh, IEEE Trans. Robotics 28, 2012).

Where the speed through the water v is a state, the way is v B, and the log a measurement of v +
b_v: components are predicted and updated in each step. Speed is a random walk of one of two modes,
held or in manoeuvres, which are mixed once a second (interacting multiple models, Blom &
Bar-Shalom, IEEE Trans. Automatic Control 33, 1988).

On a straight leg of the leader's exact positions the mean of its headings replaces each of them:
the random error of one reading would err together in derivatives and residuals of the ranges
(Fuller, Measurement Error Models, 1987). The leader's way over ground, less what its log and
compass measure, shows the current, and in still water its compass bias.
"""

import math

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, copy_values, inlined
from laisn.delays import MEAN_SPEED_SIGMA, mean_window
from laisn.geometry import angle_between, wrap_angle
from laisn.mixture import (
    add_moments,
    blend,
    centre_moments,
    copy_component,
    normalise,
    update_scalar,
)
from laisn.tight.model import COMPASS_BIAS, LOG_BIAS, X, Y, refresh_output
from laisn.tight.records import (
    ABSENT,
    INSTANT_SPACING,
    INSTANTS,
    SPARE,
    WAY_PATH,
    WAY_SUMS,
    WAY_XX,
    WAY_XY,
    WAY_YY,
    GaussianMixture,
    Model,
    Preintegration,
    RangeMessage,
)
from laisn.vector_math import sin_cos

# of times that are sums of steps [s]
_ROUNDING = 1e-6


@compiled
def _remember(
    b: GaussianMixture, m: Model, step: tuple[float, float, float, float, float], dt: float
) -> None:
    """Add the sums of a step to the recent way, and what they err, by the readings at its end."""
    o = b.motion
    r = b.recent
    for i in range(5):
        r.sums[i] += step[i]
    along_variance = m.speed_variance * dt * dt
    across_variance = m.heading_variance * o.speed * o.speed * dt * dt
    slip = m.slip_rate * dt
    r.sums[WAY_XX] += along_variance * o.sin * o.sin + across_variance * o.cos * o.cos + slip
    r.sums[WAY_XY] += (along_variance - across_variance) * o.sin * o.cos
    r.sums[WAY_YY] += along_variance * o.cos * o.cos + across_variance * o.sin * o.sin + slip
    if o.clock - r.instant[r.last] < INSTANT_SPACING - _ROUNDING:
        return
    r.last = (r.last + 1) % INSTANTS
    r.instant[r.last] = o.clock
    copy_values(r.sums, r.instant_sums[r.last])


@compiled
def write_way_since(b: GaussianMixture, lag: float, way: Floats) -> None:
    """Put the sums of the recent way since so long ago [s], or since the start, into `way`, shape
    (WAY_SUMS,).
    """
    r = b.recent
    arrival = b.motion.clock - lag
    # the instants before and after it; none is later than the last one but now
    before = r.last
    after = -1
    for _ in range(INSTANTS - 1):
        if r.instant[before] <= arrival:
            break
        after = before
        before = before - 1 if before > 0 else INSTANTS - 1
    after_time = b.motion.clock if after < 0 else r.instant[after]
    span = after_time - r.instant[before]
    share = (after_time - max(arrival, r.instant[before])) / span if span > 0.0 else 0.0
    for i in range(WAY_SUMS):
        after_sum = r.sums[i] if after < 0 else r.instant_sums[after, i]
        way[i] = r.sums[i] - after_sum + share * (after_sum - r.instant_sums[before, i])


@compiled
def take_mean_speed(
    b: GaussianMixture, m: Model, message: RangeMessage, i: int, lag: tuple[float, float]
) -> None:
    """Let the way since ping i of a message have a mean speed until the last ping arrived; so long
    ago each of them did [s]. See `laisn.delays.RecentWay.since`.
    """
    clock = b.motion.clock
    time = lag[0] - lag[1]
    begin, end = mean_window(time, clock - lag[1], clock - b.motion.elapsed, clock)
    if time <= 0.0 or end - begin < time:
        return
    way = message.way[i]
    last_way = message.way[message.last_to_arrive]
    write_way_since(b, clock - begin, b.window)
    path = b.window[WAY_PATH]
    write_way_since(b, clock - end, b.window)
    path -= b.window[WAY_PATH]
    speed = path / (end - begin)
    east, north = way[2] - last_way[2], way[3] - last_way[3]
    way[0] = last_way[0] + speed * east
    way[1] = last_way[1] + speed * north
    sigma = math.sqrt(m.speed_variance * m.dt / (end - begin) + MEAN_SPEED_SIGMA * MEAN_SPEED_SIGMA)
    message.way_by_mean_speed[i, 0] = sigma * east
    message.way_by_mean_speed[i, 1] = sigma * north
    # what the compass errs, across the way, and slip
    across_variance = m.heading_variance * speed * speed * m.dt / time
    way[WAY_XX] = last_way[WAY_XX] + across_variance * north * north + m.slip_rate * time
    way[WAY_XY] = last_way[WAY_XY] - across_variance * east * north
    way[WAY_YY] = last_way[WAY_YY] + across_variance * east * east + m.slip_rate * time


@inlined
def preintegrate_direction(
    b: GaussianMixture, m: Model, speed: float, sine: float, cosine: float, dt: float
) -> None:
    """As `preintegrate`, with sine and cosine of the compass's reading."""
    o = b.motion
    first = o.speed != o.speed
    if first:
        o.speed = speed
        o.sin = sine
        o.cos = cosine
        b.turn.sin, b.turn.cos = sine, cosine
    half_dt = 0.5 * dt
    last_speed = o.speed
    step_ax = half_dt * (last_speed * o.sin + speed * sine)
    step_ay = half_dt * (last_speed * o.cos + speed * cosine)
    step_bx = half_dt * (o.sin + sine)
    step_by = half_dt * (o.cos + cosine)
    o.ax += step_ax
    o.ay += step_ay
    o.bx += step_bx
    o.by += step_by
    # N += (σ_v² u uᵀ + σ_θ² v² (I − u uᵀ)) Δt²
    across_variance = m.heading_variance * speed * speed * dt * dt
    # the error along the way is larger by so much than that across it; no reading has it where the
    # speed is a state
    along_less_across = (m.speed_variance if m.speed == ABSENT else 0.0) * dt * dt - across_variance
    o.nxx += across_variance + along_less_across * sine * sine
    o.nxy += along_less_across * sine * cosine
    o.nyy += across_variance + along_less_across * cosine * cosine
    o.time += dt
    o.clock += dt
    o.elapsed += dt
    o.speed = speed
    o.sin = sine
    o.cos = cosine
    if m.compensate_motion:
        _remember(b, m, (step_ax, step_ay, step_bx, step_by, half_dt * (last_speed + speed)), dt)
    if m.speed != ABSENT:
        _advance_components(b, m, first)


@compiled
def preintegrate(b: GaussianMixture, m: Model, speed: float, heading: float, dt: float) -> None:
    """One filter step at the mean velocity of both ends, with the readings of log and compass at
    its end.
    """
    sine, cosine = sin_cos(heading)
    preintegrate_direction(b, m, speed, sine, cosine, dt)


@inlined
def reset_preintegration(b: GaussianMixture) -> None:
    """Begin a new way: the components have been predicted over the last one."""
    o = b.motion
    o.ax = o.ay = o.bx = o.by = o.nxx = o.nxy = o.nyy = o.time = 0.0


_MIXING_TIME = 1.0  # of the modes of speed [s]


@compiled
def mix_pair(b: GaussianMixture, m: Model, first: int, second: int, switches: float) -> None:
    """Blend two components that are modes of one hypothesis, after a time in which so many
    `switches` from one to the other are expected.

    The interacting multiple model of Blom & Bar-Shalom (Bar-Shalom, Li & Kirubarajan 2001): either
    component becomes a blend of both, by the chance that the mode has changed.
    """
    # a chain of two states that changes at the same rate either way (Poisson)
    stay = 0.5 + 0.5 * math.exp(-2.0 * switches)
    change = 1.0 - stay
    weight = b.weight[first]
    other_weight = b.weight[second]
    new_weight = stay * weight + change * other_weight
    new_other = stay * other_weight + change * weight
    if new_weight <= 0.0 or new_other <= 0.0:
        return
    copy_component(b, first, SPARE)
    blend(b.state, b.covariance, first, second, change * other_weight / new_weight, m.n_states)
    blend(b.state, b.covariance, second, SPARE, change * weight / new_other, m.n_states)
    b.weight[first] = new_weight
    b.weight[second] = new_other


@compiled
def update_weights(b: GaussianMixture, m: Model) -> bool:
    """Multiply the weights by the evidence; False if none is left."""
    components = b.n_hypotheses * m.modes
    best = -math.inf
    for k in range(components):
        if b.weight[k] > 0.0 and b.evidence[k] > best:
            best = b.evidence[k]
    if not math.isfinite(best):
        return False
    for k in range(components):
        b.weight[k] *= math.exp(b.evidence[k] - best)
    normalise(b.weight, components)
    return True


@compiled
def start_speed(b: GaussianMixture, m: Model, k: int) -> None:
    """Set the speed of a fresh component to the last reading of the log, v = z − b_v − n, where it
    is a state.
    """
    if m.speed == ABSENT:
        return
    P = b.covariance
    b.state[k, m.speed] = b.motion.speed
    P[k, m.speed, m.speed] = b.prior_variance[m.speed]
    P[k, m.speed, LOG_BIAS] = P[k, LOG_BIAS, m.speed] = -b.prior_variance[LOG_BIAS]


@compiled
def _update_with_log(b: GaussianMixture, m: Model, k: int) -> float:
    """Update component k with the last reading of the log, z = v + b_v; its log likelihood but for
    a constant.
    """
    x = b.state[k]
    P = b.covariance[k]
    ph = b.ph
    # P Hᵀ and S = H P Hᵀ + σ²
    for i in range(m.n_states):
        ph[i] = P[i, m.speed] + P[i, LOG_BIAS]
    variance = ph[m.speed] + ph[LOG_BIAS] + m.speed_variance
    residual = b.motion.speed - x[m.speed] - x[LOG_BIAS]
    update_scalar(x, P, ph, residual, variance, m.n_states)
    likelihood: float = -0.5 * (residual * residual / variance + math.log(variance))
    return likelihood


@compiled
def _advance_components(b: GaussianMixture, m: Model, first: bool) -> None:
    """Predict all components over a step and update them with its reading of the log; the first
    reading starts their speeds.
    """
    o = b.motion
    components = b.n_hypotheses * m.modes
    for k in range(components):
        if first:
            start_speed(b, m, k)
        predict_component(b, m, k, b.state[k, m.speed], b.state[k, COMPASS_BIAS])
    o.unmixed += o.time
    reset_preintegration(b)
    if not first:
        for k in range(components):
            b.evidence[k] = _update_with_log(b, m, k)
        update_weights(b, m)
    if o.unmixed >= _MIXING_TIME - 1e-6:
        for h in range(b.n_hypotheses):
            for drift in range(m.drift_modes):
                component = h * m.modes + drift
                mix_pair(b, m, component, component + m.drift_modes, m.speed_switches * o.unmixed)
        o.unmixed = 0.0
    refresh_output(b, m)


@inlined
def _displacement(
    o: Preintegration, m: Model, speed: float, compass_bias: float
) -> tuple[float, float, float, float, float, float]:
    """Rotation by a compass bias (cosine, sine), way through the water, and its derivative by
    `speed`.

    That is the log's bias b_v, with the way Rot(b_θ) (A − b_v B), or the speed v where it is a
    state, with the way Rot(b_θ) v B.
    """
    s, c = sin_cos(compass_bias)
    along_x, along_y = c * o.bx - s * o.by, s * o.bx + c * o.by
    if m.speed == ABSENT:
        way_x = c * o.ax - s * o.ay - speed * along_x
        way_y = s * o.ax + c * o.ay - speed * along_y
        return c, s, way_x, way_y, -along_x, -along_y
    return c, s, speed * along_x, speed * along_y, along_x, along_y


@inlined
def _position_noise(
    o: Preintegration,
    m: Model,
    mode: int,
    displacement: tuple[float, float, float, float, float, float],
) -> tuple[float, float, float]:
    """Covariance xx, xy, yy that a component's position gains on a way as of `_displacement`.

    By random errors of the readings, slip, and biases of log and compass, and the current, that
    wander on a straight way.
    """
    c, s, way_x, way_y, by_log_x, by_log_y = displacement
    time = o.time
    third = o.time / 3.0
    q_log = third * (m.log_walk[mode] if m.speed == ABSENT else m.speed_walk[mode])
    q_compass = third * m.compass_walk[mode]
    isotropic = m.slip_rate * time
    if m.current != ABSENT:
        isotropic += m.current_walk * time * time * third
    # Rot(b_θ) N Rot(b_θ)ᵀ + slip and current, and then T/3 (q_v g_v g_vᵀ + q_θ g_θ g_θᵀ) with the
    # derivatives g of the way by either bias
    xx = c * c * o.nxx - 2.0 * c * s * o.nxy + s * s * o.nyy + isotropic
    yy = s * s * o.nxx + 2.0 * c * s * o.nxy + c * c * o.nyy + isotropic
    xy = c * s * (o.nxx - o.nyy) + (c * c - s * s) * o.nxy
    xx += q_log * by_log_x * by_log_x + q_compass * way_y * way_y
    xy += q_log * by_log_x * by_log_y - q_compass * way_x * way_y
    yy += q_log * by_log_y * by_log_y + q_compass * way_x * way_x
    return xx, xy, yy


@compiled
def reset_position_error(b: GaussianMixture, m: Model, k: int) -> None:
    """What errs anew in the broadcast position of each message, e, of component k."""
    P = b.covariance
    for state in (m.leader_position, m.leader_position + 1):
        b.state[k, state] = 0.0
        for j in range(m.n_states):
            P[k, state, j] = P[k, j, state] = 0.0
        P[k, state, state] = b.leader_position_variance


@compiled
def _predict_clock(b: GaussianMixture, m: Model, k: int, time: float) -> None:
    """Predict offset τ and drift τ̇ of component k's clock over a time T [s].

    τ ← τ + τ̇ T, P ← F P Fᵀ + q [[T³/3, T²/2], [T²/2, T]] with q of the drift that wanders.
    """
    x = b.state
    P = b.covariance
    offset = m.clock
    drift = m.clock + 1
    half_time = time / 2.0
    x[k, offset] += time * x[k, drift]
    for j in range(m.n_states):
        P[k, offset, j] += time * P[k, drift, j]
    for j in range(m.n_states):
        P[k, j, offset] += time * P[k, j, drift]
    P[k, offset, offset] += m.clock_walk * time * time * time / 3.0
    P[k, offset, drift] += m.clock_walk * time * half_time
    P[k, drift, offset] += m.clock_walk * time * half_time
    P[k, drift, drift] += m.clock_walk * time


@compiled
def predict_component(
    b: GaussianMixture, m: Model, k: int, speed: float, compass_bias: float
) -> None:
    """Predict component k over the way since the last message, linearised at some biases.

    The true way is r = Rot(b_θ)(A − b_v B), with Rot anticlockwise, as a compass that reads too
    much has to be turned back. P ← F P Fᵀ + Q, with Q of biases that wander for a straight way.
    Where the speed is a state, `speed` is its value, else b_v's; see `_displacement`.
    """
    speed_index = LOG_BIAS if m.speed == ABSENT else m.speed
    x = b.state
    P = b.covariance
    n = m.n_states
    time = b.motion.time
    mode = k % m.modes
    if m.leader_position != ABSENT and m.speed == ABSENT:
        reset_position_error(b, m, k)
    if m.leader_position_walk != ABSENT:
        for state in (m.leader_position_walk, m.leader_position_walk + 1):
            P[k, state, state] += m.leader_position_walk_rate * time
    displacement = _displacement(b.motion, m, speed, compass_bias)
    _, _, way_x, way_y, by_speed_x, by_speed_y = displacement
    by_compass_x = -way_y
    by_compass_y = way_x
    # (x, y) += r(speed, b_θ) + F_v (v − speed) + F_θ (b_θ − compass_bias) + c T
    off_speed = x[k, speed_index] - speed
    off_compass = x[k, COMPASS_BIAS] - compass_bias
    x[k, X] += way_x + by_speed_x * off_speed + by_compass_x * off_compass
    x[k, Y] += way_y + by_speed_y * off_speed + by_compass_y * off_compass
    east, north = m.current, m.current + 1
    has_current = m.current != ABSENT
    if has_current:
        x[k, X] += time * x[k, east]
        x[k, Y] += time * x[k, north]
    # F P: rows x and y change; then (F P) Fᵀ: columns x and y.
    for j in range(n):
        P[k, X, j] += by_speed_x * P[k, speed_index, j] + by_compass_x * P[k, COMPASS_BIAS, j]
        P[k, Y, j] += by_speed_y * P[k, speed_index, j] + by_compass_y * P[k, COMPASS_BIAS, j]
        if has_current:
            P[k, X, j] += time * P[k, east, j]
            P[k, Y, j] += time * P[k, north, j]
    px, pxy, py = _position_noise(b.motion, m, mode, displacement)
    px += P[k, X, X] + by_speed_x * P[k, X, speed_index] + by_compass_x * P[k, X, COMPASS_BIAS]
    pxy += P[k, X, Y] + by_speed_y * P[k, X, speed_index] + by_compass_y * P[k, X, COMPASS_BIAS]
    py += P[k, Y, Y] + by_speed_y * P[k, Y, speed_index] + by_compass_y * P[k, Y, COMPASS_BIAS]
    if has_current:
        px += time * P[k, X, east]
        pxy += time * P[k, X, north]
        py += time * P[k, Y, north]
    # what biases that wander gain, with the position's gain
    q_log = m.log_walk[mode]
    q_speed = q_log if m.speed == ABSENT else m.speed_walk[mode]
    q_compass = m.compass_walk[mode]
    half_time = time / 2.0
    P[k, X, speed_index] += half_time * q_speed * by_speed_x
    P[k, Y, speed_index] += half_time * q_speed * by_speed_y
    P[k, X, COMPASS_BIAS] += half_time * q_compass * by_compass_x
    P[k, Y, COMPASS_BIAS] += half_time * q_compass * by_compass_y
    P[k, LOG_BIAS, LOG_BIAS] += q_log * time
    if m.speed != ABSENT:
        P[k, speed_index, speed_index] += q_speed * time
    P[k, COMPASS_BIAS, COMPASS_BIAS] += q_compass * time
    if m.leader_bias != ABSENT:
        P[k, m.leader_bias, m.leader_bias] += m.leader_walk * time
    if m.clock != ABSENT:
        # before the columns x and y are copied from the rows
        _predict_clock(b, m, k, time)
    if has_current:
        for state in (east, north):
            P[k, state - east, state] += m.current_walk * time * half_time
            P[k, state, state] += m.current_walk * time
    P[k, X, X] = px
    P[k, X, Y] = pxy
    P[k, Y, X] = pxy
    P[k, Y, Y] = py
    for j in range(2, n):
        P[k, j, X], P[k, j, Y] = P[k, X, j], P[k, Y, j]


@compiled
def position(b: GaussianMixture) -> tuple[float, float]:
    """Mean position over the mixture now, between messages too [m]."""
    o = b.motion
    out = b.output
    x = out.x + out.c_cos * o.ax - out.c_sin * o.ay + out.v_x * o.time
    y = out.y + out.c_sin * o.ax + out.c_cos * o.ay + out.v_y * o.time
    x -= out.d_cos * o.bx - out.d_sin * o.by
    y -= out.d_sin * o.bx + out.d_cos * o.by
    return x, y


@compiled
def velocity(b: GaussianMixture) -> tuple[float, float]:
    """Mean velocity over ground over the mixture, by the last readings [m/s]; 0 if there is no
    hypothesis yet.
    """
    o = b.motion
    out = b.output
    speed_east = o.speed * o.sin
    speed_north = o.speed * o.cos
    x = (
        out.c_cos * speed_east
        - out.c_sin * speed_north
        + out.v_x
        - (out.d_cos * o.sin - out.d_sin * o.cos)
    )
    y = (
        out.c_sin * speed_east
        + out.c_cos * speed_north
        + out.v_y
        - (out.d_sin * o.sin + out.d_cos * o.cos)
    )
    return x, y


@compiled
def _add_component(b: GaussianMixture, m: Model, k: int, origin: tuple[float, float]) -> None:
    """Add component k, predicted to this time, to the moments of the mixture about an origin, in
    `b.mixture_mean` and `b.mixture_covariance`.
    """
    covariance = b.mixture_covariance
    rows = b.rows
    x = b.state[k]
    o = b.motion
    weight = b.weight[k]
    log_is_exact = m.speed == ABSENT
    speed_index = LOG_BIAS if log_is_exact else m.speed
    displacement = _displacement(o, m, x[speed_index], x[COMPASS_BIAS])
    c, s, way_x, way_y, by_speed_x, by_speed_y = displacement
    ux, uy = c * o.sin - s * o.cos, s * o.sin + c * o.cos
    speed = o.speed - x[LOG_BIAS] if log_is_exact else x[speed_index]
    sign = -1.0 if log_is_exact else 1.0
    time = o.time
    # F = ∂(x, y, vx, vy)/∂state
    for i in range(4):
        for j in range(m.n_states):
            rows[i, j] = 0.0
    rows[0, X] = 1.0
    rows[0, speed_index] = by_speed_x
    rows[0, COMPASS_BIAS] = -way_y
    rows[1, Y] = 1.0
    rows[1, speed_index] = by_speed_y
    rows[1, COMPASS_BIAS] = way_x
    rows[2, speed_index] = sign * ux
    rows[2, COMPASS_BIAS] = -speed * uy
    rows[3, speed_index] = sign * uy
    rows[3, COMPASS_BIAS] = speed * ux
    values = (x[X] - origin[0] + way_x, x[Y] - origin[1] + way_y, speed * ux, speed * uy)
    if m.current != ABSENT:
        east, north = x[m.current], x[m.current + 1]
        rows[0, m.current] = rows[1, m.current + 1] = time
        rows[2, m.current] = rows[3, m.current + 1] = 1.0
        values = (
            values[0] + time * east,
            values[1] + time * north,
            values[2] + east,
            values[3] + north,
        )
    add_moments(
        b.mixture_mean,
        covariance,
        weight,
        values,
        rows,
        b.covariance[k, : m.n_states, : m.n_states],
    )
    xx, xy, yy = _position_noise(o, m, k % m.modes, displacement)
    covariance[0, 0] += weight * xx
    covariance[0, 1] += weight * xy
    covariance[1, 1] += weight * yy
    # the velocity is that of the last readings, with their random errors: σ_v² u uᵀ + σ_θ² v² n nᵀ
    along_variance = m.speed_variance if log_is_exact else 0.0
    across_variance = m.heading_variance * o.speed * o.speed
    covariance[2, 2] += weight * (along_variance * ux * ux + across_variance * uy * uy)
    covariance[2, 3] += weight * (along_variance - across_variance) * ux * uy
    covariance[3, 3] += weight * (along_variance * uy * uy + across_variance * ux * ux)


@compiled
def moments(b: GaussianMixture, m: Model) -> None:
    """Put mean and covariance of (x, y, vx, vy) over the mixture into `b.mixture_mean` and
    `b.mixture_covariance`; NaN if there is no hypothesis yet.
    """
    zero_or_nan = 0.0 if b.n_hypotheses else np.nan
    origin = position(b)
    for i in range(4):
        b.mixture_mean[i] = zero_or_nan
        for j in range(4):
            b.mixture_covariance[i, j] = zero_or_nan
    for k in range(b.n_hypotheses * m.modes):
        _add_component(b, m, k, origin)
    centre_moments(b.mixture_mean, b.mixture_covariance)
    b.mixture_mean[0], b.mixture_mean[1] = origin


_MAX_STRAIGHT_TURN = 0.005  # a way that bends by less from message to message is straight [rad]
_MIN_DISTANCE = 0.3  # shorter ways between messages have no direction [m]
# a reading so many σ from the mean: the leader has turned without moving aside
_OUTLIER_SIGMAS = 4.0
# of a leg, after which its mean heading is used
_MIN_MESSAGES = 4.0
# it is used sooner where its variance is a smaller share of that of b_L
_SMALL_SHARE = 0.1


@compiled
def average_leader_heading(b: GaussianMixture, m: Model, message: RangeMessage) -> None:
    """Replace the heading of a message by the leg's, with the arms; sets `message.shift` and
    `message.added_variance`.
    """
    o = b.leader
    reading_variance = m.leader_variance
    dx = message.east - o.at_x
    dy = message.north - o.at_y
    last_track = o.track
    o.at_x, o.at_y = message.east, message.north
    o.track = math.atan2(dx, dy) if dx * dx + dy * dy > _MIN_DISTANCE * _MIN_DISTANCE else math.nan
    # by which the leader's way turned at the last message; NaN if that is unknown
    bend = wrap_angle(o.track - last_track)
    straight = abs(bend) < _MAX_STRAIGHT_TURN
    message.shift = message.added_variance = 0.0
    error = wrap_angle(message.heading - o.leg_heading - bend)
    if o.leg > 0.0 and not (
        straight and error * error <= _OUTLIER_SIGMAS * _OUTLIER_SIGMAS * reading_variance
    ):
        if o.steady > 0.0:
            # from here on b_L is again without the mean's random error
            message.added_variance = o.scatter / o.leg
            o.other_variance, b.leader_variance = b.leader_variance, o.other_variance
        o.leg = o.steady = 0.0
        return
    if not straight:
        return
    o.leg += 1.0
    shift = error / o.leg if o.leg > 1.0 else 0.0
    o.leg_heading = o.leg_heading + bend + shift if o.leg > 1.0 else message.heading
    if o.leg > 1.0:
        o.squares += error * (error - shift)
        o.compared += 1.0
        o.scatter = min((reading_variance + o.squares) / (1.0 + o.compared), reading_variance)
    if o.steady > 0.0:
        # the way bends half an interval earlier than the heading
        message.shift = shift
        message.added_variance = 0.25 * bend * bend
    elif (
        o.leg >= _MIN_MESSAGES
        or o.scatter < _SMALL_SHARE * o.leg * b.covariance[0, m.leader_bias, m.leader_bias]
    ):
        message.added_variance = o.scatter / o.leg
        o.steady = 1.0
        o.other_variance, b.leader_variance = b.leader_variance, o.other_variance
    if o.steady > 0.0:
        change = wrap_angle(o.leg_heading - message.heading)
        message.heading += change
        s, c = sin_cos(change)
        for i in range(3):
            ax, ay = message.arms[i, 0], message.arms[i, 1]
            message.arms[i, 0] = c * ax + s * ay
            message.arms[i, 1] = c * ay - s * ax


_WINDOW = 10.0  # longest window [s]
# it is shorter at the start, so that something is known soon: so long after the first message [s],
# and longer by this share of the time since then
_FIRST_WINDOW = 1.0
_GROWTH = 0.2
_MAX_WINDOW_TURN = (
    0.2  # a window with more turn is not used: the way between messages is too uncertain [rad]
)
# of the mean current over a window of 10 s, as the leader's way over ground shows it [m/s]
LEADER_WAY_SIGMA = 0.05


@compiled
def _update_component(
    b: GaussianMixture,
    m: Model,
    k: int,
    measurement: tuple[float, float],
    logged: tuple[float, float],
    variance: float,
) -> None:
    """Update component k with z = c + v_L [u(θ_L − b_L) − u(θ_L)], east and north, linearised once.

    z is `measurement`, of variance R along each axis [m²/s²], `logged` is v_L u(θ_L), the leader's
    mean velocity by its log and compass [m/s].
    """
    x = b.state[k]
    P = b.covariance[k]
    ph = b.ph
    has_leader_bias = m.leader_bias != ABSENT
    bias = x[m.leader_bias] if has_leader_bias else 0.0
    c, s = math.cos(bias), math.sin(bias)
    # ν = z − ẑ and S = H P Hᵀ + R, with H of c and b_L
    logged_turned = (c * logged[0] - s * logged[1], s * logged[0] + c * logged[1])
    for axis in range(2):
        # ∂z/∂b_L; ∂z/∂c is 1
        slope = -logged_turned[1] if axis == 0 else logged_turned[0]
        residual = measurement[axis] - (logged_turned[axis] - logged[axis])
        innovation_variance = variance
        state = m.current + axis
        for i in range(m.n_states):
            ph[i] = P[i, state] if m.current != ABSENT else 0.0
            if has_leader_bias:
                ph[i] += slope * P[i, m.leader_bias]
        if has_leader_bias:
            residual -= slope * (x[m.leader_bias] - bias)
            innovation_variance += slope * ph[m.leader_bias]
        if m.current != ABSENT:
            residual -= x[state]
            innovation_variance += ph[state]
        update_scalar(x, P, ph, residual, innovation_variance, m.n_states)


@compiled
def update_current_from_leader_track(b: GaussianMixture, m: Model, message: RangeMessage) -> None:
    """Take a message's pose and speed; at the end of a window update all components with the
    current it shows.
    """
    o = b.leader
    ended = True
    sx, sy = message.speed * math.sin(message.heading), message.speed * math.cos(message.heading)
    if o.window_time != o.window_time:
        o.first_time = message.time
    else:
        elapsed = message.time - o.last_time
        o.logged_x += 0.5 * elapsed * (o.velocity_x + sx)
        o.logged_y += 0.5 * elapsed * (o.velocity_y + sy)
        turn = angle_between(message.heading, o.first_heading)
        window = message.time - o.window_time
        target = min(_WINDOW, _FIRST_WINDOW + _GROWTH * (message.time - o.first_time))
        ended = turn > _MAX_WINDOW_TURN or window >= target - 1e-6
        if ended and turn <= _MAX_WINDOW_TURN:
            per = 1.0 / window
            logged = (per * o.logged_x, per * o.logged_y)
            measurement = (
                per * (message.east - o.window_x) - logged[0],
                per * (message.north - o.window_y) - logged[1],
            )
            # both ends of the window err
            variance = LEADER_WAY_SIGMA * LEADER_WAY_SIGMA * 10.0 * per
            variance += (
                2.0 * b.leader_position_variance * per * per + m.leader_position_walk_rate * per
            )
            for k in range(b.n_hypotheses * m.modes):
                _update_component(b, m, k, measurement, logged, variance)
    if ended:
        o.window_time = message.time
        o.window_x = message.east
        o.window_y = message.north
        o.logged_x = o.logged_y = 0.0
        o.first_heading = message.heading
    o.velocity_x = sx
    o.velocity_y = sy
    o.last_time = message.time
