"""A tightly coupled navigator among beacons at surveyed places: odometry and ranges, one at a time,
as they come.

The sibling of `laisn.tight` for beacons hundreds of metres apart, each with its own errors,
odometry whose gyro drifts, ranges of unknown scale, and unknown starts. The estimate is a mixture
of Gaussians over the position and the errors of the sensors. State of a component, of n = 8 + 3 B
numbers for B beacons at rest; a state with the variance 0 is switched off:

    x, y    position of the receiver, east and north [m]
    b_s     logarithm of true over measured speed
    b_θ     error of the heading, clockwise [rad] …
    b_ω     … and the rate at which it grows [rad/s]
    g       scale error of all ranges
    c       current, east and north [m/s]
    d_i     constant error of the ranges to beacon i [m] …
    δ_i     … and the error of its place, east and north [m]
    ψ_i, ψ̇_i  of a beacon that moves by odometry of its own: error of its heading, clockwise [rad],
            and the rate at which it grows [rad/s]
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from laisn import mixture
from laisn.arrays import Bools, Floats, Ints, Records
from laisn.compiled import compiled
from laisn.errors import LaisnError
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Reception
from laisn.navigators import OnlineNavigator
from laisn.settings import BeaconSettings as BeaconSettings
from laisn.settings import WaterBeaconSettings

X, Y, SPEED_SCALE, HEADING_ERROR, GYRO_BIAS, RANGE_SCALE, CURRENT_EAST, CURRENT_NORTH = range(8)
"""Indices of the states x, y, b_s, b_θ, b_ω, g and c, east and north."""
SHARED = 8
"""Number of these states, which all beacons share; those of each beacon follow."""
STATES_AT_REST = 3
STATES_MOVING = 5
"""Number of states of a beacon at rest, and of one that moves by odometry of its own."""
# indices of d_i, δ_i east and north, ψ_i and ψ̇_i, counted from the beacon's first state
_OFFSET, _PLACE_EAST, _PLACE_NORTH, _TURN, _TURN_RATE = range(STATES_MOVING)

MAX_COMPONENTS = 256
CAPACITY = 4 * MAX_COMPONENTS
"""Components that are kept from range to range, and that there is room for while they are split."""

# How fast what is called constant may wander, as variance in a second: biases of real sensors are
# never quite constant, and a filter that takes them as constant loses track of them for good.
_SPEED_WALK = 5e-4**2  # [1/s]
_GYRO_WALK = 2e-5**2  # [rad²/s³]
_CURRENT_WALK = 1e-3**2  # [m²/s³]


class BeaconBelief(NamedTuple):
    """A mixture of Gaussians, its heaviest component first; compiled functions change it in
    place.
    """

    state: Floats  # mean of each component, shape (CAPACITY, n)
    covariance: Floats  # shape (CAPACITY, n, n)
    weight: Floats  # shape (CAPACITY,); sum 1 over those alive
    outcome: Records  # whether it used the last range: field `used`, shape (CAPACITY,)
    n_states: int  # n, number of states
    # number of hypotheses, of one component each, shape (1,); `laisn.mixture` reads this name
    n_hypotheses: Ints
    evidence: Floats  # logarithm of the probability density of all ranges so far, shape (1,)
    prior_variance: Floats  # variances of the states before the mission, shape (n,)
    first: Ints  # index of each beacon's first state, shape (B,)
    variance: Floats  # of each beacon's random error, as estimated so far, shape (B,), [m²]
    rejected: Ints  # ranges of each beacon rejected in a row, shape (B,)
    ph: Floats  # room for P Hᵀ, which is not divided by S yet, shape (n,)


@compiled
def predict(
    b: BeaconBelief, errors: tuple[float, float], speed: float, heading: float, time: float
) -> None:
    """Predict over one step of odometry, whose mean speed [m/s] and heading [rad] are measured, and
    which took a time Δt [s].

    The true way is e^{b_s} v Δt u(θ − b_θ) + c Δt, with u the direction of a compass heading.
    `errors` are the random walk of the position that odometry does not see [m/√s], and of the
    heading [rad/√s].
    """
    n = b.n_states
    slip, heading_walk = errors
    for k in range(b.n_hypotheses[0]):
        x = b.state[k]
        P = b.covariance[k]
        if b.prior_variance[GYRO_BIAS] > 0.0:
            x[HEADING_ERROR] += time * x[GYRO_BIAS]
            for j in range(n):
                P[HEADING_ERROR, j] += time * P[GYRO_BIAS, j]
            for j in range(n):
                P[j, HEADING_ERROR] += time * P[j, GYRO_BIAS]
            P[GYRO_BIAS, GYRO_BIAS] += time * _GYRO_WALK
        distance = speed * time * math.exp(x[SPEED_SCALE])
        east, north = (
            distance * math.sin(heading - x[HEADING_ERROR]),
            distance * math.cos(heading - x[HEADING_ERROR]),
        )
        x[X] += east + time * x[CURRENT_EAST]
        x[Y] += north + time * x[CURRENT_NORTH]
        for j in range(n):
            P[X, j] += (
                east * P[SPEED_SCALE, j] - north * P[HEADING_ERROR, j] + time * P[CURRENT_EAST, j]
            )
            P[Y, j] += (
                north * P[SPEED_SCALE, j] + east * P[HEADING_ERROR, j] + time * P[CURRENT_NORTH, j]
            )
        for j in range(n):
            P[j, X] += (
                east * P[j, SPEED_SCALE] - north * P[j, HEADING_ERROR] + time * P[j, CURRENT_EAST]
            )
            P[j, Y] += (
                north * P[j, SPEED_SCALE] + east * P[j, HEADING_ERROR] + time * P[j, CURRENT_NORTH]
            )
        P[Y, X] = P[X, Y]
        P[X, X] += slip * slip * time
        P[Y, Y] += slip * slip * time
        P[HEADING_ERROR, HEADING_ERROR] += heading_walk * heading_walk * time
        if b.prior_variance[SPEED_SCALE] > 0.0:
            P[SPEED_SCALE, SPEED_SCALE] += _SPEED_WALK * time
        if b.prior_variance[CURRENT_EAST] > 0.0:
            P[CURRENT_EAST, CURRENT_EAST] += _CURRENT_WALK * time
            P[CURRENT_NORTH, CURRENT_NORTH] += _CURRENT_WALK * time


@compiled
def predict_track(
    b: BeaconBelief,
    beacon: int,
    errors: tuple[float, float],
    displacement: tuple[float, float],
    time: float,
) -> None:
    """Predict the errors of a beacon that by its own odometry has moved by a displacement Δ, east
    and north [m], in a time T [s].

    The true displacement is Rot(ψ) Δ, with Rot anticlockwise, and the place's error grows by
    Rot(ψ) Δ − Δ. `errors` are the random walks of its place [m/√s] and of its heading [rad/√s].
    """
    n = b.n_states
    slip, heading_walk = errors
    east = b.first[beacon] + _PLACE_EAST
    north = b.first[beacon] + _PLACE_NORTH
    turn = b.first[beacon] + _TURN
    rate = b.first[beacon] + _TURN_RATE
    half_time = 0.5 * time
    heading_variance = heading_walk * heading_walk * time
    for k in range(b.n_hypotheses[0]):
        x = b.state[k]
        P = b.covariance[k]
        angle = x[turn] + half_time * x[rate]
        s, c = math.sin(angle), math.cos(angle)
        true_east, true_north = (
            c * displacement[0] - s * displacement[1],
            s * displacement[0] + c * displacement[1],
        )
        x[east] += true_east - displacement[0]
        x[north] += true_north - displacement[1]
        x[turn] += time * x[rate]
        # F P Fᵀ with ∂δ/∂ψ = (−Δ_n, Δ_e) of the true displacement, ∂δ/∂ψ̇ = ½ T ∂δ/∂ψ, ∂ψ/∂ψ̇ = T
        for j in range(n):
            turn_covariance = P[turn, j] + half_time * P[rate, j]
            P[east, j] -= true_north * turn_covariance
            P[north, j] += true_east * turn_covariance
            P[turn, j] += time * P[rate, j]
        for j in range(n):
            turn_covariance = P[j, turn] + half_time * P[j, rate]
            P[j, east] -= true_north * turn_covariance
            P[j, north] += true_east * turn_covariance
            P[j, turn] += time * P[j, rate]
        # Q of a heading that walks randomly while the beacon moves at a constant velocity, with
        # g = ∂δ/∂ψ: q T of ψ, q T/3 g gᵀ of the place, and q T/2 g between both
        third = heading_variance / 3.0
        P[east, east] += slip * slip * time + third * true_north * true_north
        P[north, north] += slip * slip * time + third * true_east * true_east
        P[east, north] -= third * true_east * true_north
        P[north, east] = P[east, north]
        P[east, turn] -= 0.5 * heading_variance * true_north
        P[north, turn] += 0.5 * heading_variance * true_east
        P[turn, east] = P[east, turn]
        P[turn, north] = P[north, turn]
        P[turn, turn] += heading_variance
        if b.prior_variance[rate] > 0.0:
            P[rate, rate] += time * _GYRO_WALK


@compiled
def moments(b: BeaconBelief, speed: float, heading: float) -> tuple[Floats, Floats]:
    """Mean of x, y, vx, vy over the mixture, at the last readings of speed [m/s] and heading [rad],
    and its covariance; NaN if it is empty.
    """
    mean = np.zeros(4)
    covariance = np.zeros((4, 4))
    # derivatives of x, y, vx, vy by the states, and a row that `mixture.add_moments` works in
    rows = np.zeros((5, b.n_states))
    if b.n_hypotheses[0] == 0:
        return mean + np.nan, covariance + np.nan
    east = north = 0.0
    for k in range(b.n_hypotheses[0]):
        east += b.weight[k] * b.state[k, X]
        north += b.weight[k] * b.state[k, Y]
    for k in range(b.n_hypotheses[0]):
        x = b.state[k]
        s = speed * np.exp(x[SPEED_SCALE])
        vx, vy = s * np.sin(heading - x[HEADING_ERROR]), s * np.cos(heading - x[HEADING_ERROR])
        rows[0, X] = rows[1, Y] = rows[2, CURRENT_EAST] = rows[3, CURRENT_NORTH] = 1.0
        rows[2, SPEED_SCALE] = vx
        rows[2, HEADING_ERROR] = -vy
        rows[3, SPEED_SCALE] = vy
        rows[3, HEADING_ERROR] = vx
        centred = (x[X] - east, x[Y] - north, vx + x[CURRENT_EAST], vy + x[CURRENT_NORTH])
        mixture.add_moments(mean, covariance, b.weight[k], centred, rows, b.covariance[k])
    mixture.centre_moments(mean, covariance)
    mean[X], mean[Y] = mean[X] + east, mean[Y] + north
    return mean, covariance


_MIN_DISTANCE = 0.1  # nearer to a beacon than this the direction to it means nothing [m]
_ADAPTATION_GAIN = 0.02  # share of a range in the estimated variance of its beacon
_MAX_INFLATION = 16.0  # a range adds at most this times the variance to it
# bounds of the estimated variance, as multiples of the settings'
_MIN_VARIANCE_FACTOR = 0.25
_MAX_VARIANCE_FACTOR = 16.0


class RangeMeasurement(NamedTuple):
    """A range as compiled code takes it."""

    beacon: int  # counted from 0
    east: float  # its surveyed place [m]
    north: float
    depth_difference: float  # how much deeper it is than the receiver [m]
    range: float  # measured slant range [m]
    variance: float  # of the settings' random error [m²]
    log_p_inlier: float  # logarithm of the chance that the range is right
    log_density_outlier: (
        float  # logarithm of the probability density of a range that is wrong [1/m]
    )


@compiled
def predict_range(b: BeaconBelief, k: int, z: RangeMeasurement) -> tuple[float, float, float]:
    """Predict a range for component k; P Hᵀ goes into `b.ph`.

    Second-order terms follow Bar-Shalom, Li & Kirubarajan 2001, Section 10.3.2: ½ tr(F C) in the
    mean and ½ tr((F C)²) in the variance, with the range's second derivatives F and the covariance
    C of p − δ. Returns residual [m], its variance without the random error [m²], and by how much
    the circle bends away from its tangent [m].
    """
    x = b.state[k]
    P = b.covariance[k]
    n = b.n_states
    offset = b.first[z.beacon] + _OFFSET
    place_east = b.first[z.beacon] + _PLACE_EAST
    place_north = b.first[z.beacon] + _PLACE_NORTH
    dx, dy = x[X] - z.east - x[place_east], x[Y] - z.north - x[place_north]
    distance = max(
        math.sqrt(dx * dx + dy * dy + z.depth_difference * z.depth_difference), _MIN_DISTANCE
    )
    horizontal_distance = max(math.sqrt(dx * dx + dy * dy), _MIN_DISTANCE)
    scale = 1.0 + x[RANGE_SCALE]
    hx, hy = scale * dx / distance, scale * dy / distance
    for j in range(n):
        b.ph[j] = (
            hx * (P[j, X] - P[j, place_east])
            + hy * (P[j, Y] - P[j, place_north])
            + distance * P[j, RANGE_SCALE]
            + P[j, offset]
        )
    ph = b.ph
    variance = (
        hx * (ph[X] - ph[place_east])
        + hy * (ph[Y] - ph[place_north])
        + distance * ph[RANGE_SCALE]
        + ph[offset]
    )
    cxx = P[X, X] - 2.0 * P[X, place_east] + P[place_east, place_east]
    cyy = P[Y, Y] - 2.0 * P[Y, place_north] + P[place_north, place_north]
    cxy = P[X, Y] - P[X, place_north] - P[place_east, Y] + P[place_east, place_north]
    per = scale / distance
    fxx = per * (1.0 - dx * dx / distance**2)
    fyy = per * (1.0 - dy * dy / distance**2)
    fxy = -per * dx * dy / distance**2
    axx, axy = fxx * cxx + fxy * cxy, fxx * cxy + fxy * cyy
    ayx, ayy = fxy * cxx + fyy * cxy, fxy * cxy + fyy * cyy
    second = 0.5 * (axx * axx + 2.0 * axy * ayx + ayy * ayy)
    residual = z.range - scale * distance - x[offset] - 0.5 * (axx + ayy)
    tx, ty = -dy / horizontal_distance, dx / horizontal_distance
    bend = 0.5 * (tx * tx * cxx + 2.0 * tx * ty * cxy + ty * ty * cyy) / horizontal_distance
    return residual, variance + second, bend


@compiled
def update(b: BeaconBelief, k: int, z: RangeMeasurement) -> float:
    """Update component k with a range, unless that is likelier a wrong one. Returns the logarithm
    of the range's probability density [1/m].
    """
    residual, expected, _ = predict_range(b, k, z)
    variance = expected + b.variance[z.beacon]
    density: float = z.log_p_inlier - 0.5 * (
        residual * residual / variance + math.log(2.0 * math.pi * variance)
    )
    b.outcome[k].used = not density < z.log_density_outlier
    if density < z.log_density_outlier:
        return z.log_density_outlier
    mixture.update_scalar(b.state[k], b.covariance[k], b.ph, residual, variance, b.n_states)
    return density


# a component is split where a circle bends away from its tangent by more than this share of its
# error
_SPLIT_BEND = 0.7
_MIN_WEIGHT = 1e-8
_MERGE_DISTANCE = 0.3  # squared Mahalanobis distance of positions, below which they are one
N_RING_COMPONENTS = 48  # Gaussians whose sum is a ring
STARTERS = 8  # first ranges, each of which may be the one that gives an unknown start
# errors of ranges are estimated where one component has more weight than this
_DOMINANT_WEIGHT = 0.9
_MAX_REJECTED = 8  # ranges of one beacon rejected in a row after which a ring about it is added
_MAX_REJECTED_OF_ONE = 24  # the same where the last range of another one was used
_RING_WEIGHT = 0.01  # of the ring that is added


@compiled
def _split_component(b: BeaconBelief, k: int, z: RangeMeasurement) -> None:
    """Split component k in three along the tangent of the circle about a beacon: in units of its
    standard deviation there, means −1, 0, 1, weights ¼, ½, ¼ and variance ½ keep the first three
    moments; the other states follow by their covariance.
    """
    x = b.state[k]
    P = b.covariance[k]
    n = b.n_states
    column = b.ph
    place_east = b.first[z.beacon] + _PLACE_EAST
    place_north = b.first[z.beacon] + _PLACE_NORTH
    dx, dy = x[X] - z.east - x[place_east], x[Y] - z.north - x[place_north]
    horizontal_distance = math.sqrt(dx * dx + dy * dy)
    tx, ty = -dy / horizontal_distance, dx / horizontal_distance
    for j in range(n):
        column[j] = tx * (P[j, X] - P[j, place_east]) + ty * (P[j, Y] - P[j, place_north])
    sigma = math.sqrt(
        tx * (column[X] - column[place_east]) + ty * (column[Y] - column[place_north])
    )
    for j in range(n):
        column[j] /= sigma
    for i in range(n):
        for j in range(n):
            P[i, j] -= 0.5 * column[i] * column[j]
    b.weight[k] *= 0.5
    for side in (-1.0, 1.0):
        other = b.n_hypotheses[0]
        mixture.copy_component(b, k, other)
        b.weight[other] *= 0.5
        for j in range(n):
            b.state[other, j] += side * column[j]
        b.n_hypotheses[0] += 1


@compiled
def split(b: BeaconBelief, z: RangeMeasurement) -> None:
    """Split every component that is too wide for the circle of a range to be straight."""
    k = 0
    while k < b.n_hypotheses[0]:
        _, _, bend = predict_range(b, k, z)
        if (
            bend > _SPLIT_BEND * math.sqrt(b.variance[z.beacon])
            and b.n_hypotheses[0] + 2 <= CAPACITY
        ):
            _split_component(b, k, z)
        else:
            k += 1


@compiled
def prune_and_merge(b: BeaconBelief) -> None:
    """Prune and merge components, keep the heaviest ones, and put the heaviest of all first."""
    count = mixture.prune_and_merge(
        b, 1, b.n_hypotheses[0], _MIN_WEIGHT, MAX_COMPONENTS, -1, _MERGE_DISTANCE
    )
    top = mixture.heaviest_hypothesis(b, 1, count)
    if top > 0:
        spare = CAPACITY - 1
        mixture.copy_component(b, 0, spare)
        mixture.copy_component(b, top, 0)
        mixture.copy_component(b, spare, top)
    mixture.normalise(b.weight, count)
    b.n_hypotheses[0] = count


@compiled
def add_ring(b: BeaconBelief, z: RangeMeasurement, weight: float, lost: bool) -> None:
    """Add a ring of components about a beacon, of a weight where that of all others is 1; nothing
    without room.

    If the place was `lost`, the other states are those of the first component, with the prior
    variance added to that of the heading; otherwise all have the mean and variance of the prior.
    """
    first = b.first[z.beacon]
    if b.n_hypotheses[0] + N_RING_COMPONENTS >= CAPACITY:
        return
    distance = max(
        math.sqrt(max(z.range * z.range - z.depth_difference * z.depth_difference, 1.0)), 1.0
    )
    # wide beside all errors of a range, the update with which follows
    radial_variance = 4.0 * (
        b.variance[z.beacon]
        + b.prior_variance[first + _OFFSET]
        + b.prior_variance[first + _PLACE_EAST]
        + b.prior_variance[RANGE_SCALE] * distance * distance
    )
    for i in range(N_RING_COMPONENTS):
        k = b.n_hypotheses[0]
        ux, uy = (
            math.sin(2.0 * math.pi * i / N_RING_COMPONENTS),
            math.cos(2.0 * math.pi * i / N_RING_COMPONENTS),
        )
        P = b.covariance[k]
        if lost:
            mixture.copy_component(b, 0, k)
            for j in range(b.n_states):
                P[X, j] = P[Y, j] = P[j, X] = P[j, Y] = 0.0
            P[HEADING_ERROR, HEADING_ERROR] += b.prior_variance[HEADING_ERROR]
        else:
            mixture.reset_component(b, k, b.prior_variance)
        mixture.place_on_ring(
            b, k, (z.east, z.north), distance, (ux, uy), (radial_variance, N_RING_COMPONENTS)
        )
        b.weight[k] = weight / N_RING_COMPONENTS
        update(b, k, z)
        b.n_hypotheses[0] += 1
    mixture.normalise(b.weight, b.n_hypotheses[0])


@compiled
def _has_lost_place(b: BeaconBelief, beacon: int) -> bool:
    """Whether the ranges of a beacon were rejected so often in a row that the place is doubted:
    where the last range of another one was used, rather those ranges are wrong.
    """
    rejected = b.rejected[beacon]
    if rejected < _MAX_REJECTED:
        return False
    for i in range(b.rejected.shape[0]):
        if i != beacon and b.rejected[i] == 0:
            return bool(rejected >= _MAX_REJECTED_OF_ONE)
    return True


@compiled
def receive(b: BeaconBelief, z: RangeMeasurement, starter: int) -> bool:
    """Take a range; whether the first component, the heaviest one before it, used it.

    With an unknown start each of the first ranges may be the first right one: the ring of the m-th
    has the weight of all earlier ones being wrong, beside the evidence of the components so far.
    `starter` is the number m, from 0; −1 with a known start, or after `STARTERS`.
    """
    used = False
    if b.n_hypotheses[0] > 0:
        split(b, z)
        if b.weight[0] > _DOMINANT_WEIGHT:
            # adapt the beacon's variance to what the heaviest component makes of the range, before
            # it is updated
            residual, expected, _ = predict_range(b, 0, z)
            variance = b.variance[z.beacon]
            variance += _ADAPTATION_GAIN * (
                min(max(residual * residual - expected, 0.0), _MAX_INFLATION * variance) - variance
            )
            b.variance[z.beacon] = min(
                max(variance, _MIN_VARIANCE_FACTOR * z.variance), _MAX_VARIANCE_FACTOR * z.variance
            )
        for k in range(b.n_hypotheses[0]):
            b.weight[k] *= math.exp(update(b, k, z) - z.log_density_outlier)
        used = b.outcome[0].used
        b.evidence[0] += (
            math.log(mixture.normalise(b.weight, b.n_hypotheses[0])) + z.log_density_outlier
        )
        b.rejected[z.beacon] = 0 if used else b.rejected[z.beacon] + 1
    if starter >= 0:
        add_ring(
            b, z, math.exp(min((starter + 1) * z.log_density_outlier - b.evidence[0], 700.0)), False
        )
    elif _has_lost_place(b, z.beacon):
        b.rejected[z.beacon] = 0
        add_ring(b, z, _RING_WEIGHT, True)
    if b.n_hypotheses[0] > 1:
        prune_and_merge(b)
    return used


MAX_BEACONS = 64  # more places are not those of beacons at rest


MEDIA: dict[str, BeaconSettings] = {
    "air": BeaconSettings(),
    "water": WaterBeaconSettings(),
}
"""What ranges are measured through: radio on land, or sound under water, where a vehicle has a
compass and drifts.
"""


def _variances(s: BeaconSettings, moving: Bools) -> Floats:
    """Of all states before the mission, of beacons some of which move by odometry of their own."""
    sigmas = [
        s.start_sigma,
        s.start_sigma,
        s.speed_scale_sigma,
        s.heading_sigma,
        s.gyro_bias_sigma,
        s.range_scale_sigma,
        s.current_sigma,
        s.current_sigma,
    ]
    for moves in moving:
        sigmas += [s.range_offset_sigma, s.survey_sigma, s.survey_sigma]
        if moves:
            sigmas += [s.heading_sigma, s.gyro_bias_sigma]
    return np.square(sigmas)


def _allocate(s: BeaconSettings, moving: Bools) -> BeaconBelief:
    """A mixture without components, over the states of beacons some of which move."""
    prior_variance = _variances(s, moving)
    n = prior_variance.size
    beacons = moving.size
    counts = np.where(moving, STATES_MOVING, STATES_AT_REST)
    return BeaconBelief(
        state=np.zeros((CAPACITY, n)),
        covariance=np.zeros((CAPACITY, n, n)),
        weight=np.zeros(CAPACITY),
        outcome=np.zeros(CAPACITY, dtype=[("used", np.bool_)]),
        n_states=n,
        n_hypotheses=np.zeros(1, dtype=np.int64),
        evidence=np.zeros(1),
        prior_variance=prior_variance,
        first=(SHARED + np.cumsum(counts) - counts).astype(np.int64),
        variance=np.full(beacons, s.range_sigma**2),
        rejected=np.zeros(beacons, dtype=np.int64),
        ph=np.zeros(n),
    )


def new_belief(settings: BeaconSettings, start: tuple[float, float] | None) -> BeaconBelief:
    """One component at a known start [m], or none; no beacon is known yet."""
    belief = _allocate(settings, np.zeros(0, dtype=bool))
    if start is not None:
        belief.state[0, :2] = start
        belief.covariance[0] = np.diag(belief.prior_variance)
        belief.weight[0] = 1.0
        belief.n_hypotheses[0] = 1
    return belief


def with_beacon(
    belief: BeaconBelief, settings: BeaconSettings, moves: bool = False
) -> BeaconBelief:
    """BeaconBelief with the states of one more beacon, which may move by odometry of its own, with
    the mean and variance of the prior.
    """
    counts = np.diff(belief.first, append=belief.n_states)
    extended = _allocate(settings, np.append(counts == STATES_MOVING, moves))
    n_states = belief.n_states
    # what is not alive stays untouched, and takes no memory
    alive = slice(int(belief.n_hypotheses[0]))
    added = np.arange(n_states, extended.n_states)
    extended.state[alive, :n_states] = belief.state[alive]
    extended.covariance[alive, :n_states, :n_states] = belief.covariance[alive]
    extended.covariance[alive, added, added] = extended.prior_variance[n_states:]
    extended.variance[:-1] = belief.variance
    extended.rejected[:-1] = belief.rejected
    return extended._replace(
        weight=belief.weight,
        outcome=belief.outcome,
        n_hypotheses=belief.n_hypotheses,
        evidence=belief.evidence,
    )


class _Track(NamedTuple):
    """Where a beacon that moves was at its last range."""

    time: float  # since the start [s]
    east: float  # by its message [m]
    north: float


class BeaconNavigator(OnlineNavigator[Estimates]):
    """Takes as own motion the mean speed over the step that a reading ends, and the direction of
    the way in it.

    A beacon at the position of its message, whose speed is not zero, moves: its errors stay those
    of its transmitter. With `track_heading_walk` or `track_slip` it goes by odometry of its own.

    The kind of a fix is by what the heaviest component used. LaisnError also if a message does not
    place its transmitters, or there are too many places.
    """

    def __init__(self, settings: BeaconSettings, start: Floats | None) -> None:
        """Start at the receiver's x, y [m] and velocity [m/s] at step 0, shape (4,). None, or
        `known_start` False: unknown, so that estimates are NaN until the first range; the heading
        is known either way.
        """
        super().__init__(settings, start if settings.known_start else None, settings.start_sigma)
        self._belief: BeaconBelief = new_belief(settings, self._start)
        # number of each beacon by its place, or by the index of its transmitter where that moves
        self._beacons: dict[tuple[float, float] | int, int] = {}
        self._moving = set[int]()
        self._tracks: dict[int, _Track] = {}
        self._time = 0.0
        self._starter = 0 if self._start is None else -1
        chance = settings.outlier_probability
        span = settings.outlier_span
        # the last three fields of `RangeMeasurement`
        self._errors = (
            settings.range_sigma**2,
            float(np.log1p(-chance)),
            float(np.log(chance / span)),
        )

    @property
    def evidence(self) -> float:
        """Logarithm of the probability density that the settings gave to all ranges so far."""
        return float(self._belief.evidence[0])

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        if reception is not None and reception.transmitters is None:
            raise LaisnError(
                f"step {self._step}: the message places no transmitters; this navigator needs "
                "beacons"
            )
        self._time += dt
        predict(
            self._belief,
            (self.settings.slip, self.settings.heading_walk),
            own.speed,
            own.heading,
            dt,
        )
        used = []
        if (
            reception is not None
            and reception.transmitters is not None
            and not math.isnan(own.depth)
        ):
            used = [
                self._receive(
                    self._key(i, transmitter, reception.message), transmitter, r, own.depth
                )
                for i, (transmitter, r) in enumerate(
                    zip(reception.transmitters, reception.ranges, strict=True)
                )
                if np.isfinite(r + transmitter.sum())
            ]
        self._state, self._covariance = moments(self._belief, own.speed, own.heading)
        if self._belief.n_hypotheses[0] and not np.isfinite(self._covariance).all():
            raise ArithmeticError(
                f"step {self._step}: the covariance is not finite after {reception}"
            )
        if reception is None:
            return []
        if any(used):
            kind = FixKind.ONE_RANGE
        elif used:
            kind = FixKind.GATED
        else:
            kind = FixKind.LOST
        return [self._fix_at_estimate(kind)]

    @property
    def runs_by_steps(self) -> bool:
        """Whether `run` gives what `step` gives in a loop."""
        return True

    def run(self, measurements: Measurements) -> Estimates:
        """Estimates of a whole mission, whose filter step may differ from the settings'; see
        `OnlineNavigator.run`.
        """
        durations = measurements.durations
        if durations is None:
            durations = np.full(measurements.speed.size, measurements.dt)
        return super().run(replace(measurements, dt=self.settings.dt, durations=durations))

    def _key(
        self, i: int, transmitter: Floats, message: LeaderMessage
    ) -> tuple[float, float] | int:
        """What tells beacons apart: of one at rest its place, of one that moves the index of its
        transmitter. A beacon moves if its message states its own place, and a speed that is not 0.
        """
        east, north, _ = map(float, transmitter)
        at_message_position = (east, north) == (message.east, message.north)
        if at_message_position and message.speed > 0.0:
            self._moving.add(i)
        return i if at_message_position and i in self._moving else (east, north)

    def _receive(
        self, key: tuple[float, float] | int, transmitter: Floats, measured: float, depth: float
    ) -> bool:
        """Take one range; whether the heaviest component used it."""
        east, north, beacon_depth = map(float, transmitter)
        if key not in self._beacons:
            if len(self._beacons) == MAX_BEACONS:
                raise LaisnError(
                    f"step {self._step}: ranges to more than {MAX_BEACONS} places; a beacon must "
                    "lie still, or send where it is and at what speed it moves"
                )
            self._beacons[key] = len(self._beacons)
            drifts = isinstance(key, int) and self._has_drifting_tracks
            self._belief = with_beacon(self._belief, self.settings, drifts)
        if isinstance(key, int) and self._has_drifting_tracks:
            self._follow_track(self._beacons[key], east, north)
        depth_difference = beacon_depth - (depth - self.settings.hydrophone_height)
        z = RangeMeasurement(
            self._beacons[key], east, north, depth_difference, float(measured), *self._errors
        )
        used = receive(self._belief, z, self._starter)
        if self._starter >= 0:
            self._starter = self._starter + 1 if self._starter + 1 < STARTERS else -1
        return bool(used)

    @property
    def _has_drifting_tracks(self) -> bool:
        """Whether beacons that move go by odometry of their own."""
        return bool(self.settings.track_slip > 0.0 or self.settings.track_heading_walk > 0.0)

    def _follow_track(self, beacon: int, east: float, north: float) -> None:
        """Predict the errors of a beacon's place from its last range to this one; at its first one
        they have grown since the start, on a way that no message showed.
        """
        settings = self.settings
        last = self._tracks.get(beacon, _Track(0.0, east, north))
        self._tracks[beacon] = _Track(self._time, east, north)
        predict_track(
            self._belief,
            beacon,
            (settings.track_slip, settings.track_heading_walk),
            (east - last.east, north - last.north),
            self._time - last.time,
        )
