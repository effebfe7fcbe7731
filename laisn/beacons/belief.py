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

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.beacons.settings import BeaconSettings
from laisn.compiled import compiled

X, Y, SPEED, HEADING, GYRO, SCALE, EAST, NORTH = range(8)
"""Indices of the states that all beacons share."""
SHARED, OWN = 8, 3
"""Number of states that all beacons share, and of those of each one."""

KEPT = 256
"""Components that are kept from range to range."""
ROOM = 4 * KEPT
"""Components that there is room for while they are split."""


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
def moments(b: Belief, speed: float, heading: float) -> tuple[Floats, Floats]:
    """Mean of x, y, vx, vy over the mixture, shape (4,), and its covariance, shape (4, 4); NaN if it is empty.

    Args:
        b: the belief.
        speed: last reading of the odometry [m/s] …
        heading: … and of the gyro [rad].
    """
    mean, covariance = np.zeros(4), np.zeros((4, 4))
    if b.alive[0] == 0:
        return mean + np.nan, covariance + np.nan
    n, parts = b.fresh.size, np.empty((b.alive[0], 4))
    rows = np.zeros((4, n))
    for k in range(b.alive[0]):
        x = b.state[k]
        s = speed * np.exp(x[SPEED])
        vx, vy = s * np.sin(heading - x[HEADING]), s * np.cos(heading - x[HEADING])
        rows[0, X] = rows[1, Y] = rows[2, EAST] = rows[3, NORTH] = 1.0
        rows[2, SPEED], rows[2, HEADING], rows[3, SPEED], rows[3, HEADING] = vx, -vy, vy, vx
        parts[k] = np.array([x[X], x[Y], vx + x[EAST], vy + x[NORTH]])
        mean += b.weight[k] * parts[k]
        covariance += b.weight[k] * (rows @ b.covariance[k] @ rows.T)
    for k in range(b.alive[0]):
        off = parts[k] - mean
        covariance += b.weight[k] * np.outer(off, off)
    return mean, covariance
