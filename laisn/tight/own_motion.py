"""Dead reckoning: what log and compass add up to between messages, and what that does to a Gaussian."""

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled, inlined
from laisn.elementary import sin_cos
from laisn.tight import belief as at
from laisn.tight.belief import Belief
from laisn.tight.model import ABSENT, Model
from laisn.tight.states import COMPASS, LOG, X, Y

Floats = npt.NDArray[np.float64]


@compiled
def advance(b: Belief, m: Model, speed: float, heading: float) -> None:
    """One filter step, with the readings of log [m/s] and compass [rad] at its end.

    The way is that of the mean velocity of both ends: a turn would otherwise be a step late.
    """
    o = b.motion
    sine, cosine = sin_cos(heading)
    if o[at.SPEED] != o[at.SPEED]:
        o[at.SPEED], o[at.SIN], o[at.COS] = speed, sine, cosine
        o[at.MESSAGE_SIN], o[at.MESSAGE_COS] = sine, cosine
    half = 0.5 * m.dt
    before = o[at.SPEED]
    o[at.AX] += half * (before * o[at.SIN] + speed * sine)
    o[at.AY] += half * (before * o[at.COS] + speed * cosine)
    o[at.BX] += half * (o[at.SIN] + sine)
    o[at.BY] += half * (o[at.COS] + cosine)
    along = m.speed_variance * m.dt * m.dt
    across = m.heading_variance * speed * speed * m.dt * m.dt
    o[at.NXX] += along * sine * sine + across * cosine * cosine
    o[at.NXY] += (along - across) * sine * cosine
    o[at.NYY] += along * cosine * cosine + across * sine * sine
    o[at.TIME] += m.dt
    o[at.SPEED], o[at.SIN], o[at.COS] = speed, sine, cosine


@compiled
def begin_interval(b: Belief) -> None:
    """Forget the way so far: the components have been moved by it."""
    o = b.motion
    for i in range(at.TIME + 1):
        o[i] = 0.0
    o[at.MESSAGE_SIN], o[at.MESSAGE_COS] = o[at.SIN], o[at.COS]


@compiled
def turned_since_message(b: Belief) -> float:
    """Angle between the headings now and at the last message, 0 … π [rad]."""
    o = b.motion
    cross = o[at.SIN] * o[at.MESSAGE_COS] - o[at.COS] * o[at.MESSAGE_SIN]
    dot = o[at.SIN] * o[at.MESSAGE_SIN] + o[at.COS] * o[at.MESSAGE_COS]
    return float(abs(np.arctan2(cross, dot)))


@inlined
def _way(o: Floats, log_bias: float, compass_bias: float) -> tuple[float, float, float, float, float, float]:
    """Rotation by a compass bias (cosine, sine), way through the water, and its derivative by the log's bias."""
    c, s = np.cos(compass_bias), np.sin(compass_bias)
    along_x, along_y = c * o[at.BX] - s * o[at.BY], s * o[at.BX] + c * o[at.BY]
    way_x = c * o[at.AX] - s * o[at.AY] - log_bias * along_x
    way_y = s * o[at.AX] + c * o[at.AY] - log_bias * along_y
    return c, s, way_x, way_y, -along_x, -along_y


@compiled
def move(b: Belief, m: Model, k: int, log_bias: float, compass_bias: float) -> None:
    """Move component k by the way since the last message, linearised at some biases.

    The true way is r = Rot(b_θ)(A − b_v B), with Rot anticlockwise, as a compass that reads too much has to be turned
    back. What biases do that wander on the way is added for a straight one.
    """
    x, P, o, n = b.mean, b.covariance, b.motion, m.size
    c, s, way_x, way_y, by_log_x, by_log_y = _way(o, log_bias, compass_bias)
    by_compass_x, by_compass_y = -way_y, way_x
    time = o[at.TIME]
    off_log, off_compass = x[k, LOG] - log_bias, x[k, COMPASS] - compass_bias
    x[k, X] += way_x + by_log_x * off_log + by_compass_x * off_compass
    x[k, Y] += way_y + by_log_y * off_log + by_compass_y * off_compass
    east, north = m.current, m.current + 1
    drifting = m.current != ABSENT
    if drifting:
        x[k, X] += time * x[k, east]
        x[k, Y] += time * x[k, north]
    # F P: rows x and y change; then (F P) Fᵀ: columns x and y.
    for j in range(n):
        P[k, X, j] += by_log_x * P[k, LOG, j] + by_compass_x * P[k, COMPASS, j]
        P[k, Y, j] += by_log_y * P[k, LOG, j] + by_compass_y * P[k, COMPASS, j]
        if drifting:
            P[k, X, j] += time * P[k, east, j]
            P[k, Y, j] += time * P[k, north, j]
    px = P[k, X, X] + by_log_x * P[k, X, LOG] + by_compass_x * P[k, X, COMPASS]
    pxy = P[k, X, Y] + by_log_y * P[k, X, LOG] + by_compass_y * P[k, X, COMPASS]
    py = P[k, Y, Y] + by_log_y * P[k, Y, LOG] + by_compass_y * P[k, Y, COMPASS]
    if drifting:
        px += time * P[k, X, east]
        pxy += time * P[k, X, north]
        py += time * P[k, Y, north]
    # Noise of the readings, turned; slip; biases that wander.
    mode = k % m.modes
    q_log, q_compass, q_current = m.log_walk[mode], m.compass_walk[mode], m.current_walk
    third, half = time / 3.0, time / 2.0
    nxx, nxy, nyy = o[at.NXX], o[at.NXY], o[at.NYY]
    slip = m.slip_rate * time
    px += c * c * nxx - 2.0 * c * s * nxy + s * s * nyy + slip
    pxy += c * s * (nxx - nyy) + (c * c - s * s) * nxy
    py += s * s * nxx + 2.0 * c * s * nxy + c * c * nyy + slip
    px += third * (q_log * by_log_x * by_log_x + q_compass * by_compass_x * by_compass_x)
    pxy += third * (q_log * by_log_x * by_log_y + q_compass * by_compass_x * by_compass_y)
    py += third * (q_log * by_log_y * by_log_y + q_compass * by_compass_y * by_compass_y)
    P[k, X, LOG] += half * q_log * by_log_x
    P[k, Y, LOG] += half * q_log * by_log_y
    P[k, X, COMPASS] += half * q_compass * by_compass_x
    P[k, Y, COMPASS] += half * q_compass * by_compass_y
    P[k, LOG, LOG] += q_log * time
    P[k, COMPASS, COMPASS] += q_compass * time
    if drifting:
        px += q_current * time * time * third
        py += q_current * time * time * third
        P[k, X, east] += q_current * time * half
        P[k, Y, north] += q_current * time * half
        P[k, east, east] += q_current * time
        P[k, north, north] += q_current * time
    P[k, X, X], P[k, X, Y], P[k, Y, X], P[k, Y, Y] = px, pxy, pxy, py
    for j in range(2, n):
        P[k, j, X], P[k, j, Y] = P[k, X, j], P[k, Y, j]


@compiled
def position(b: Belief) -> tuple[float, float]:
    """Mean position over the mixture now, between messages too [m]."""
    o, out = b.motion, b.output
    x = out[at.OUT_X] + out[at.C_COS] * o[at.AX] - out[at.C_SIN] * o[at.AY] + out[at.V_X] * o[at.TIME]
    y = out[at.OUT_Y] + out[at.C_SIN] * o[at.AX] + out[at.C_COS] * o[at.AY] + out[at.V_Y] * o[at.TIME]
    x -= out[at.D_COS] * o[at.BX] - out[at.D_SIN] * o[at.BY]
    y -= out[at.D_SIN] * o[at.BX] + out[at.D_COS] * o[at.BY]
    return x, y


@compiled
def _add_component(b: Belief, m: Model, k: int, mean: Floats, covariance: Floats, rows: Floats) -> None:
    """Add component k, moved to now, to the moments of the mixture about the origin (in `mean` and `covariance`)."""
    x, P, o, n, weight = b.mean, b.covariance, b.motion, m.size, b.weight[k]
    c, s, way_x, way_y, by_log_x, by_log_y = _way(o, x[k, LOG], x[k, COMPASS])
    ux, uy = c * o[at.SIN] - s * o[at.COS], s * o[at.SIN] + c * o[at.COS]
    speed, time = o[at.SPEED] - x[k, LOG], o[at.TIME]
    rows[:] = 0.0
    rows[0, X], rows[0, LOG], rows[0, COMPASS] = 1.0, by_log_x, -way_y
    rows[1, Y], rows[1, LOG], rows[1, COMPASS] = 1.0, by_log_y, way_x
    rows[2, LOG], rows[2, COMPASS] = -ux, -speed * uy
    rows[3, LOG], rows[3, COMPASS] = -uy, speed * ux
    here = (x[k, X] + way_x, x[k, Y] + way_y, speed * ux, speed * uy)
    slip = m.slip_rate * time
    if m.current != ABSENT:
        east, north = x[k, m.current], x[k, m.current + 1]
        rows[0, m.current] = rows[1, m.current + 1] = time
        rows[2, m.current] = rows[3, m.current + 1] = 1.0
        here = (here[0] + time * east, here[1] + time * north, here[2] + east, here[3] + north)
        slip += m.current_walk * time * time * time / 3.0
    for i in range(4):
        mean[i] += weight * here[i]
        for j in range(4):
            value = here[i] * here[j]
            for g in range(n):
                if rows[i, g] != 0.0:
                    for h in range(n):
                        value += rows[i, g] * P[k, g, h] * rows[j, h]
            covariance[i, j] += weight * value
    mode = k % m.modes
    q_log, q_compass = m.log_walk[mode] * time / 3.0, m.compass_walk[mode] * time / 3.0
    nxx, nxy, nyy = o[at.NXX], o[at.NXY], o[at.NYY]
    cross = c * s * (nxx - nyy) + (c * c - s * s) * nxy
    cross += q_log * by_log_x * by_log_y - q_compass * way_x * way_y
    covariance[0, 0] += weight * (c * c * nxx - 2.0 * c * s * nxy + s * s * nyy + slip)
    covariance[0, 0] += weight * (q_log * by_log_x * by_log_x + q_compass * way_y * way_y)
    covariance[1, 1] += weight * (s * s * nxx + 2.0 * c * s * nxy + c * c * nyy + slip)
    covariance[1, 1] += weight * (q_log * by_log_y * by_log_y + q_compass * way_x * way_x)
    covariance[0, 1] += weight * cross
    covariance[1, 0] += weight * cross
    # the velocity is the last reading's, with its random error
    along, across = m.speed_variance, m.heading_variance * o[at.SPEED] * o[at.SPEED]
    covariance[2, 2] += weight * (along * ux * ux + across * uy * uy)
    covariance[3, 3] += weight * (along * uy * uy + across * ux * ux)
    covariance[2, 3] += weight * (along - across) * ux * uy
    covariance[3, 2] += weight * (along - across) * ux * uy


@compiled
def moments(b: Belief, m: Model, mean: Floats, covariance: Floats, rows: Floats) -> None:
    """Mean and covariance of (x, y, vx, vy) over the mixture now, between messages too.

    Args:
        b: the belief, after at least one step.
        m: settings.
        mean: shape (4,), [m] and [m/s]; overwritten.
        covariance: shape (4, 4); overwritten.
        rows: room, shape (4, n).
    """
    mean[:] = 0.0
    covariance[:] = 0.0
    # about the mean position, so that the squares of large coordinates do not swallow small variances
    origin_x, origin_y = position(b)
    for k in range(b.alive[0] * m.modes):
        b.mean[k, X] -= origin_x
        b.mean[k, Y] -= origin_y
        _add_component(b, m, k, mean, covariance, rows)
        b.mean[k, X] += origin_x
        b.mean[k, Y] += origin_y
    for i in range(4):
        for j in range(4):
            covariance[i, j] -= mean[i] * mean[j]
    mean[0], mean[1] = origin_x, origin_y
