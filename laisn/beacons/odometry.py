"""Dead reckoning: what one step of odometry does to every component."""

import math

from laisn.beacons.belief import EAST, GYRO, HEADING, NORTH, SPEED, Belief, X, Y
from laisn.compiled import compiled

# How fast what is called constant may wander, as variance in a second: biases of real sensors are never quite constant,
# and a filter that believes them to be loses track of them for good.
_SPEED_WALK = 5e-4**2  # [1/s]
_GYRO_WALK = 2e-5**2  # [rad²/s³]
_CURRENT_WALK = 1e-3**2  # [m²/s³]


@compiled
def advance(b: Belief, errors: tuple[float, float], speed: float, heading: float, time: float) -> None:
    """One step of odometry, whose mean speed and heading are measured.

    The true way is e^{b_s} v Δt u(θ − b_θ) + c Δt, with u the direction of a compass heading.

    Args:
        b: the belief.
        errors: random walk of the position that odometry does not see [m/√s], and of the heading [rad/√s].
        speed: mean over the step [m/s].
        heading: of the way in the step [rad].
        time: that the step takes [s].
    """
    n, (slip, heading_walk) = b.fresh.size, errors
    for k in range(b.alive[0]):
        x, P = b.state[k], b.covariance[k]
        if b.fresh[GYRO] > 0.0:
            x[HEADING] += time * x[GYRO]
            for j in range(n):
                P[HEADING, j] += time * P[GYRO, j]
            for j in range(n):
                P[j, HEADING] += time * P[j, GYRO]
            P[GYRO, GYRO] += time * _GYRO_WALK
        way = speed * time * math.exp(x[SPEED])
        east, north = way * math.sin(heading - x[HEADING]), way * math.cos(heading - x[HEADING])
        x[X] += east + time * x[EAST]
        x[Y] += north + time * x[NORTH]
        for j in range(n):
            P[X, j] += east * P[SPEED, j] - north * P[HEADING, j] + time * P[EAST, j]
            P[Y, j] += north * P[SPEED, j] + east * P[HEADING, j] + time * P[NORTH, j]
        for j in range(n):
            P[j, X] += east * P[j, SPEED] - north * P[j, HEADING] + time * P[j, EAST]
            P[j, Y] += north * P[j, SPEED] + east * P[j, HEADING] + time * P[j, NORTH]
        P[Y, X] = P[X, Y]
        P[X, X] += slip * slip * time
        P[Y, Y] += slip * slip * time
        P[HEADING, HEADING] += heading_walk * heading_walk * time
        if b.fresh[SPEED] > 0.0:
            P[SPEED, SPEED] += _SPEED_WALK * time
        if b.fresh[EAST] > 0.0:
            P[EAST, EAST] += _CURRENT_WALK * time
            P[NORTH, NORTH] += _CURRENT_WALK * time
