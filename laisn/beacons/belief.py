"""What a vehicle among beacons believes: a mixture of Gaussians over its position and the errors of its sensors.

State of a component, of n = 8 + 3 B numbers for B beacons; a state with the variance 0 is switched off:

    x, y    position of the receiver, east and north [m]
    b_s     logarithm of true over measured speed
    b_θ     error of the heading, clockwise [rad] …
    b_ω     … and the rate at which it grows [rad/s]
    g       scale error of all ranges
    c       current, east and north [m/s]
    d_i     constant error of the ranges to beacon i [m] …
    δ_i     … and the error of its place, east and north [m]
"""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.beacons.settings import BeaconSettings
from laisn.compiled import compiled
from laisn.mixture import add_moments

X, Y, SPEED, HEADING, GYRO, SCALE, EAST, NORTH = range(8)
"""Indices of the states that all beacons share."""
SHARED, OWN = 8, 3
"""Number of states that all beacons share, and of those of each one."""

KEPT = 256
"""Components that are kept from range to range."""
ROOM = 4 * KEPT
"""Components that there is room for while they are split."""

# How fast what is called constant may wander, as variance in a second: biases of real sensors are never quite constant,
# and a filter that believes them to be loses track of them for good.
_SPEED_WALK = 5e-4**2  # [1/s]
_GYRO_WALK = 2e-5**2  # [rad²/s³]
_CURRENT_WALK = 1e-3**2  # [m²/s³]


class Belief(NamedTuple):
    """A mixture of Gaussians, its heaviest component first; compiled functions change it in place."""

    state: Floats
    """Mean of each component, shape (ROOM, n)."""
    covariance: Floats
    """Its covariance, shape (ROOM, n, n)."""
    weight: Floats
    """Its weight, shape (ROOM,); sum 1 over those alive."""
    alive: Ints
    """How many components there are, shape (1,)."""
    evidence: Floats
    """Logarithm of the probability density of all ranges so far, shape (1,)."""
    fresh: Floats
    """Variances of the states before the mission, shape (n,)."""
    variance: Floats
    """Variance of each beacon's random error, as learnt so far, shape (B,), [m²]."""
    rejected: Ints
    """Ranges of each beacon rejected in a row, shape (B,)."""
    gain: Floats
    """Room for P Hᵀ, shape (n,)."""


def _fresh_variances(settings: BeaconSettings, beacons: int) -> Floats:
    """Variances of the states before the mission, shape (n,)."""
    s = settings
    shared = [s.start_sigma] * 2 + [s.speed_scale_sigma, s.heading_sigma, s.gyro_bias_sigma, s.range_scale_sigma]
    own = [s.range_offset_sigma, s.survey_sigma, s.survey_sigma]
    return np.square([*shared, s.current_sigma, s.current_sigma, *own * beacons])


def new_belief(settings: BeaconSettings, start: tuple[float, float] | None) -> Belief:
    """One component at a known start [m], or none; no beacon is known yet."""
    n = SHARED
    belief = Belief(
        state=np.zeros((ROOM, n)),
        covariance=np.zeros((ROOM, n, n)),
        weight=np.zeros(ROOM),
        alive=np.zeros(1, dtype=np.int64),
        evidence=np.zeros(1),
        fresh=_fresh_variances(settings, 0),
        variance=np.zeros(0),
        rejected=np.zeros(0, dtype=np.int64),
        gain=np.zeros(n),
    )
    if start is not None:
        belief.state[0, :2] = start
        belief.covariance[0] = np.diag(belief.fresh)
        belief.weight[0], belief.alive[0] = 1.0, 1
    return belief


def with_beacon(belief: Belief, settings: BeaconSettings) -> Belief:
    """Belief with fresh states of one more beacon."""
    before, beacons = belief.fresh.size, belief.variance.size + 1
    fresh = _fresh_variances(settings, beacons)
    state, covariance = np.zeros((ROOM, fresh.size)), np.zeros((ROOM, fresh.size, fresh.size))
    # what is not alive stays untouched, and takes no memory
    alive, own = slice(int(belief.alive[0])), np.arange(before, fresh.size)
    state[alive, :before], covariance[alive, :before, :before] = belief.state[alive], belief.covariance[alive]
    covariance[alive, own, own] = fresh[before:]
    return belief._replace(
        state=state,
        covariance=covariance,
        fresh=fresh,
        variance=np.append(belief.variance, settings.range_sigma**2),
        rejected=np.append(belief.rejected, 0),
        gain=np.zeros(fresh.size),
    )


@compiled
def copy(b: Belief, source: int, target: int) -> None:
    """Copy a component."""
    b.state[target] = b.state[source]
    b.covariance[target] = b.covariance[source]
    b.weight[target] = b.weight[source]


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


@compiled
def moments(b: Belief, speed: float, heading: float) -> tuple[Floats, Floats]:
    """Mean of x, y, vx, vy over the mixture, shape (4,), and its covariance, shape (4, 4); NaN if it is empty.

    Args:
        b: the belief.
        speed: last reading of the odometry [m/s] …
        heading: … and of the gyro [rad].
    """
    mean, covariance, rows = np.zeros(4), np.zeros((4, 4)), np.zeros((4, b.fresh.size))
    if b.alive[0] == 0:
        return mean + np.nan, covariance + np.nan
    # about the mean position, so that the squares of large coordinates do not swallow small variances
    east = north = 0.0
    for k in range(b.alive[0]):
        east += b.weight[k] * b.state[k, X]
        north += b.weight[k] * b.state[k, Y]
    for k in range(b.alive[0]):
        x = b.state[k]
        s = speed * np.exp(x[SPEED])
        vx, vy = s * np.sin(heading - x[HEADING]), s * np.cos(heading - x[HEADING])
        rows[0, X] = rows[1, Y] = rows[2, EAST] = rows[3, NORTH] = 1.0
        rows[2, SPEED], rows[2, HEADING], rows[3, SPEED], rows[3, HEADING] = vx, -vy, vy, vx
        here = (x[X] - east, x[Y] - north, vx + x[EAST], vy + x[NORTH])
        add_moments(mean, covariance, b.weight[k], here, rows, b.covariance[k])
    covariance -= np.outer(mean, mean)
    mean[X], mean[Y] = mean[X] + east, mean[Y] + north
    return mean, covariance
