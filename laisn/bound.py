"""Posterior Cramér–Rao bound of dead reckoning with ranges: the log and the compass are inputs with
the stated noise.

The recursion of Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Processing 46 (1998):
information about the state is carried from message to message by J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H,
with derivatives at the truth and the state of `laisn.tight`. It bounds every estimator of this
model and no other: one that assumes slowly varying speed can be below. `TrueNoise.speed_change`
gives the bound of such an estimator: the speed is a random walk, and the log a measurement of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, require_numbers
from laisn.mixture import Chain, smooth

_NODES_1D, _WEIGHTS_1D = np.polynomial.hermite_e.hermegauss(5)
_NODES = np.stack(np.meshgrid(_NODES_1D, _NODES_1D), axis=2).reshape(-1, 2)
_WEIGHTS = np.outer(_WEIGHTS_1D, _WEIGHTS_1D).ravel() / _WEIGHTS_1D.sum() ** 2


LEAST_RANGE_SIGMA = 1e-6
"""Least standard deviation of ranges that have a bound [m]: the information of exact ranges is
infinite.
"""


@dataclass(frozen=True, kw_only=True)
class TrueNoise:
    """Standard deviations of what is truly random in a mission; those of constants are what is
    known of them before, 0 if all is known. Raises ValueError naming a field that is negative or
    not finite.
    """

    # random errors, by default the paper's: |N(0, 2°)| of the compass (Eq. 27), ranges uniform in
    # 0.01 m (Eq. 28)
    speed_sigma: float = 0.2  # of a reading of the log [m/s]
    # of a reading of the compass [rad]
    heading_sigma: float = float(np.deg2rad(2.0) * np.sqrt(1.0 - 2.0 / np.pi))
    range_sigma: float = 0.01 / float(np.sqrt(12.0))  # of each range [m]
    # of ψ, the paper's error that is drawn for each message and that its ranges share in proportion
    # to their length; at the longest range [m]
    range_scale_sigma: float = 0.05
    leader_heading_sigma: float = 0.0  # of the heading that the leader broadcasts [rad]
    leader_position_sigma: float = 0.0  # of its broadcast position, along each axis [m]
    # constants: σ of what is known of each before the mission
    start: float = 0.0  # position at the start, along each axis [m]
    speed_bias: float = 0.3  # [m/s]
    heading_bias: float = float(np.deg2rad(8.0))  # [rad]
    range_scale_bias: float = 0.2  # mean of ψ [m]
    leader_heading_bias: float = 0.0  # of the leader's compass [rad]
    current: float = 0.0  # along each axis [m/s]
    range_offset: float = 0.0  # error of a further transmitter's ranges beside the first one's [m]
    # how far constants wander in a second
    speed_walk: float = 0.0  # [m/s/√s]
    heading_walk: float = 0.0  # [rad/√s]
    current_walk: float = 0.0  # along each axis [m/s/√s]
    # the clock is a state where any of these three is not 0
    clock_offset: float = 0.0  # at the start, as a range [m]
    clock_drift: float = 0.0  # rate at which it grows [m/s]
    clock_walk: float = 0.0  # how far that rate wanders in a second [m/s/√s]
    # of a mean current over 10 s as the leader's own way shows it [m/s]; 0: it shows none. Longer
    # times give more in proportion: on the current, and of the leader's compass, where these are
    # states
    leader_way_sigma: float = 0.0

    # how far the speed through the water wanders in a second [m/s/√s]; 0: it is not modelled, and
    # the log is an input
    speed_change: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)

    @property
    def has_bound(self) -> bool:
        """Whether there is a bound: what is measured is not exact."""
        log_is_measured = self.speed_change > 0.0
        return self.range_sigma >= LEAST_RANGE_SIGMA and not (
            log_is_measured and self.speed_sigma == 0.0
        )


@dataclass(frozen=True, kw_only=True)
class BoundGeometry:
    """The true mission of one follower as its sensors meet it: n filter steps, m messages, t
    transmitters.
    """

    dt: float  # filter step [s]
    speed: Floats  # through the water after each step, shape (n,), [m/s]
    heading: Floats  # after each step, shape (n,), [rad]
    message_step: Ints  # at which each message is received, shape (m,), from 1
    # hydrophone from the leader's origin at emission: east and north, shape (m, 2), [m]
    from_leader: Floats
    # transmitters from the same origin: east, north, and how much deeper they are than the
    # hydrophone, shape (m, t, 3), [m]; NaN where nothing is received
    arms: Floats
    # of the leader through the water at emission: east and north, shape (m, 2), [m/s]; None: not
    # sent
    leader_velocity: Floats | None = None


_LOG_BIAS = 2
_COMPASS_BIAS = 3
_RANGE_SCALE = 4
_LEADER_BIAS = 5  # of its compass
_CURRENT_EAST = 6
_CURRENT_NORTH = 7
_RANGE_OFFSET = 8  # of the second transmitter; that of the third comes next
_CLOCK = 10
_DRIFT = 11
_SPEED = 12
_STATES = 13
"""Indices in the state x of s = 13 numbers: those of `TightEstimates.names`, position first, and
the speed through the water. What is known has the variance 0.
"""
_MAX_INTERVALS = 256  # between messages of a follower that are computed at once
_MAX_FOLLOWERS = 32  # that are computed at once, so that little memory is taken
_ANY_SPEED = 10.0  # standard deviation of the speed before the first reading of the log [m/s]


def _range_information(
    from_leader: Floats, arms: Floats, received: Ints, noise: TrueNoise
) -> Floats:
    """Fisher information of the ranges to each of q places, shape (q, s, s).

    `from_leader` are these places as seen from the leader, shape (q, 2). `received` are the indices
    of the r transmitters that are received, `arms` theirs as of `BoundGeometry`, for each place or
    the same for all, shape (q, r, 3) or (1, r, 3).
    """
    if not received.size:
        return np.zeros((len(from_leader), _STATES, _STATES))
    flat = from_leader[:, None, :] - arms[..., :2]
    distance = np.sqrt(np.sum(flat**2, axis=2) + arms[..., 2] ** 2)
    share = distance / distance.max(axis=1, keepdims=True)
    rows = np.zeros((*distance.shape, _STATES))
    rows[..., :2] = flat / distance[..., None]
    rows[..., _RANGE_SCALE] = share
    rows[..., _CLOCK] = 1.0
    # a compass that reads too much puts the true arms further anticlockwise
    quarter_turned = np.stack([-arms[..., 1], arms[..., 0]], axis=-1)
    heading_row = -np.sum(rows[..., :2] * quarter_turned, axis=2)
    rows[..., _LEADER_BIAS] = heading_row
    for j in np.flatnonzero(received > 0):
        rows[:, j, _RANGE_OFFSET + received[j] - 1] = 1.0
    covariance = noise.range_sigma**2 * np.eye(received.size)
    covariance = covariance + noise.range_scale_sigma**2 * share[..., :, None] * share[..., None, :]
    directions = rows[..., :2]
    covariance = covariance + noise.leader_position_sigma**2 * (
        directions @ directions.swapaxes(1, 2)
    )
    covariance += (
        noise.leader_heading_sigma**2 * heading_row[..., :, None] * heading_row[..., None, :]
    )
    return np.asarray(rows.swapaxes(1, 2) @ np.linalg.solve(covariance, rows))


def _expected_informations(
    from_leader: Floats, spread: Floats, arms: Floats, noise: TrueNoise
) -> Floats:
    """Mean of the information of a message of each of f followers over positions
    N(from_leader, spread), by Gauss–Hermite quadrature, shape (f, s, s).

    Shapes are (f, 2), (f, 2, 2) and, of the transmitters, (f, t, 3).
    """
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    places = from_leader[:, None] + _NODES @ root.swapaxes(1, 2)
    informations = np.zeros((len(from_leader), _STATES, _STATES))
    for followers, received in _by_reception(arms):
        at_nodes = np.repeat(arms[np.ix_(followers, received)], len(_NODES), axis=0)
        node_informations = _range_information(
            places[followers].reshape(-1, 2), at_nodes, received, noise
        ).reshape(followers.size, len(_NODES), _STATES, _STATES)
        informations[followers] = np.einsum("q,fqij->fij", _WEIGHTS, node_informations)
    return informations


def _by_reception(arms: Floats) -> list[tuple[Ints, Ints]]:
    """Indices of messages of which the same transmitters are received, and these transmitters;
    arms have shape (b, t, 3).
    """
    present = np.isfinite(arms[..., 2])
    if present.all():
        return [(np.arange(len(arms)), np.arange(arms.shape[1]))]
    return [
        (np.flatnonzero((present == pattern).all(axis=1)), np.flatnonzero(pattern))
        for pattern in np.unique(present, axis=0)
    ]


def _leader_way_information(
    geometry: BoundGeometry, noise: TrueNoise, i: slice, steps: Ints
) -> Floats:
    """Information of the leader's way over the `steps` before each message of a slice, shape (b,),
    shape (b, s, s).
    """
    if noise.leader_way_sigma == 0.0 or geometry.leader_velocity is None:
        return np.zeros((geometry.from_leader[i].shape[0], _STATES, _STATES))
    velocity = geometry.leader_velocity[i]
    jacobian = np.zeros((len(velocity), 2, _STATES))
    jacobian[:, 0, _LEADER_BIAS] = -velocity[:, 1]
    jacobian[:, 1, _LEADER_BIAS] = velocity[:, 0]
    jacobian[:, :, _CURRENT_EAST : _CURRENT_NORTH + 1] = np.eye(2)
    weights = geometry.dt * steps / (10.0 * noise.leader_way_sigma**2)
    return np.asarray(jacobian.swapaxes(1, 2) @ jacobian * weights[:, None, None])


def _informations_at_truth(geometry: BoundGeometry, noise: TrueNoise, i: slice) -> Floats:
    """Information of the ranges of each message of a slice at the true positions, shape
    (b, s, s).
    """
    from_leader = geometry.from_leader[i]
    arms = geometry.arms[i]
    informations = np.zeros((len(from_leader), _STATES, _STATES))
    for messages, received in _by_reception(arms):
        informations[messages] = _range_information(
            from_leader[messages], arms[np.ix_(messages, received)], received, noise
        )
    return informations


class _Transitions(NamedTuple):
    """The way over b intervals between messages, of k filter steps each."""

    # derivatives of the position at each step by the state at the beginning, shape (b, k, 2, s)
    position_jacobian: Floats
    transition: Floats  # F, of the state at the end by that at the beginning, shape (b, s, s)
    # covariance of the process noise in the position from the beginning to each step, shape
    # (b, k, 2, 2)
    position_noise: Floats
    # covariance of that noise with the one in the state at the end, shape (b, k, 2, s)
    cross_to_end: Floats
    process_noise: Floats  # Q, of the state at the end, shape (b, s, s)


def _transitions(speed: Floats, ahead: Floats, dt: float, noise: TrueNoise) -> _Transitions:
    """The way by speeds, shape (b, k), [m/s], and `ahead`, unit vectors of the headings times Δt,
    shape (b, k, 2), [s].
    """
    intervals, steps = speed.shape
    way = np.cumsum(speed[..., None] * ahead, axis=1)
    time = dt * np.arange(1, steps + 1)
    # x_k = rows_k x_0: the true way Rot(b_θ) Σ (v − b_v) u Δt + c t, linearised about b_θ = 0: the
    # measured one turned anticlockwise by the compass bias, less the log's bias
    position_jacobian = np.zeros((intervals, steps, 2, _STATES))
    position_jacobian[..., 0, 0] = position_jacobian[..., 1, 1] = 1.0
    position_jacobian[..., _LOG_BIAS] = -np.cumsum(ahead, axis=1)
    position_jacobian[..., 0, _COMPASS_BIAS] = -way[..., 1]
    position_jacobian[..., 1, _COMPASS_BIAS] = way[..., 0]
    position_jacobian[..., 0, _CURRENT_EAST] = position_jacobian[..., 1, _CURRENT_NORTH] = time
    t = time[:, None]
    end = time[-1]
    transition = np.repeat(np.eye(_STATES)[None], intervals, axis=0)
    transition[:, :2] = position_jacobian[:, -1]
    transition[:, _CLOCK, _DRIFT] = end
    longitudinal = ahead[..., :, None] * ahead[..., None, :]
    heading_variance = ((speed * noise.heading_sigma) ** 2)[..., None, None]
    position_noise = np.cumsum(
        noise.speed_sigma**2 * longitudinal + heading_variance * (dt**2 * np.eye(2) - longitudinal),
        axis=1,
    )
    cross_at_end = np.zeros((intervals, steps, 2, _STATES))
    process_noise = np.zeros((intervals, _STATES, _STATES))
    cross_at_end[..., :2] = position_noise
    current = noise.current_walk**2 if noise.current > 0.0 else 0.0
    walks = (
        (_LOG_BIAS, noise.speed_walk**2),
        (_COMPASS_BIAS, noise.heading_walk**2),
        (_CURRENT_EAST, current),
        (_CURRENT_NORTH, current),
    )
    for state, rate in walks:
        # a bias that wanders moves the position by its mean over a straight way
        state_rows = position_jacobian[..., state]
        at_end = state_rows[:, -1, None, None, :]
        position_noise += (
            rate * (t[..., None] / 3.0) * state_rows[..., :, None] * state_rows[..., None, :]
        )
        cross_at_end[..., state] += rate * 0.5 * t * state_rows
        cross_at_end[..., :2] += (rate * (0.5 * t - t * t / (6.0 * end)) * state_rows)[
            ..., None
        ] * at_end
        process_noise[:, state, state] = rate * end
    process_noise[:, :2] = cross_at_end[:, -1]
    process_noise[:, 2:, :2] = cross_at_end[:, -1, :, 2:].swapaxes(1, 2)
    process_noise[:, _CLOCK : _DRIFT + 1, _CLOCK : _DRIFT + 1] = noise.clock_walk**2 * np.array(
        [[end**3 / 3.0, end**2 / 2.0], [end**2 / 2.0, end]]
    )
    return _Transitions(position_jacobian, transition, position_noise, cross_at_end, process_noise)


def _unknown_states(noise: TrueNoise) -> tuple[Floats, Ints]:
    """Variances of all states at the start, shape (s,), and the indices of those that are not
    known.
    """
    biases = noise.speed_bias, noise.heading_bias, noise.range_scale_bias, noise.leader_heading_bias
    clock = noise.clock_offset, noise.clock_drift
    pairs = [noise.current] * 2 + [noise.range_offset] * 2
    speed = _ANY_SPEED if noise.speed_change > 0.0 else 0.0
    variances = np.square([noise.start, noise.start, *biases, *pairs, *clock, speed])
    states = [0, 1, _CLOCK, _DRIFT] if any((*clock, noise.clock_walk)) else [0, 1]
    return variances, np.union1d(np.flatnonzero(variances), states)


def _message_information(
    geometry: BoundGeometry,
    noise: TrueNoise,
    i: int,
    covariance: Floats,
    takes_mean: bool,
    steps: int,
) -> Floats:
    """Information of message i, `steps` after the one before it, shape (s, s): of its ranges, and
    of the leader's way since then.

    With `takes_mean` that of the ranges is the mean over the positions that `covariance` allows.
    """
    message = slice(i, i + 1)
    if takes_mean:
        from_leader = geometry.from_leader[message]
        spread = covariance[None, :2, :2]
        information = _expected_informations(from_leader, spread, geometry.arms[message], noise)[0]
    else:
        information = _informations_at_truth(geometry, noise, message)[0]
    way = _leader_way_information(geometry, noise, message, np.array([steps]))
    return np.asarray(information + way[0])


def _informed(covariance: Floats, information: Floats) -> Floats:
    """(P⁻¹ + I)⁻¹ of a covariance P and an information I, shapes (…, u, u), without the inverse of
    P, which a known start makes singular.
    """
    informed = np.linalg.solve(np.eye(covariance.shape[-1]) + covariance @ information, covariance)
    return np.asarray(0.5 * (informed + informed.swapaxes(-1, -2)), dtype=np.float64)


def _steady_speed_bound(geometry: BoundGeometry, noise: TrueNoise, averaged: bool | None) -> Floats:
    """As `position_bound`, where the speed is a random walk that the log measures in each step.

    The walk is as slow as that of a vehicle that holds its speed: an estimator that also expects
    manoeuvres is above this bound.
    """
    n = geometry.speed.size
    variances, unknown = _unknown_states(noise)
    block = np.ix_(unknown, unknown)
    takes_mean = averaged if averaged is not None else geometry.arms.shape[1] < 3
    dt = geometry.dt
    walks = np.zeros(_STATES)
    walks[[_LOG_BIAS, _COMPASS_BIAS, _SPEED]] = (
        noise.speed_walk,
        noise.heading_walk,
        noise.speed_change,
    )
    walks[[_CURRENT_EAST, _CURRENT_NORTH]] = noise.current_walk if noise.current > 0.0 else 0.0
    walks[_DRIFT] = noise.clock_walk
    log_information = np.zeros((_STATES, _STATES))
    log_information[np.ix_([_SPEED, _LOG_BIAS], [_SPEED, _LOG_BIAS])] = 1.0 / noise.speed_sigma**2
    log_information = log_information[block]
    # a reading before the first step, as the speed there must be known
    covariance = _informed(np.diag(variances[unknown]), log_information)
    bound = np.empty((n, 2, 2))
    messages = dict(zip(geometry.message_step.tolist(), range(n), strict=False))
    last = 0
    for k in range(n):
        u = np.array([np.sin(geometry.heading[k]), np.cos(geometry.heading[k])])
        across = np.array([-u[1], u[0]])
        F = np.eye(_STATES)
        F[:2, _SPEED] = u * dt
        F[:2, _COMPASS_BIAS] = geometry.speed[k] * across * dt
        F[0, _CURRENT_EAST] = F[1, _CURRENT_NORTH] = F[_CLOCK, _DRIFT] = dt
        Q = np.diag(walks**2 * dt)
        Q[:2, :2] = (geometry.speed[k] * noise.heading_sigma * dt) ** 2 * np.outer(across, across)
        transition = F[block]
        covariance = _informed(transition @ covariance @ transition.T + Q[block], log_information)
        if k + 1 in messages:
            information = _message_information(
                geometry, noise, messages[k + 1], covariance, takes_mean, k + 1 - last
            )
            covariance = _informed(covariance, information[block])
            last = k + 1
        bound[k] = covariance[:2, :2]
    return bound


def position_bound(
    geometry: BoundGeometry, noise: TrueNoise, *, averaged: bool | None = None, lag: float = 0.0
) -> Floats:
    """Bound of the position's covariance after each step, shape (n, 2, 2), [m²], for the model
    stated above.

    `averaged` takes the mean information over the positions that the bound itself allows, not that
    at the truth; None: for two transmitters, whose information at the truth is zero on their axis.
    `lag` is how much later than a position the messages may be that it rests on [s]: of smoothing,
    where not 0. NaN, which is no bound, where ranges or log are exact: `TrueNoise.has_bound`.
    ValueError: a lag where the speed is a state.
    """
    return position_bounds([geometry], [noise], averaged=averaged, lag=lag)[0]


def position_bounds(
    geometries: Sequence[BoundGeometry],
    noises: Sequence[TrueNoise],
    *,
    averaged: bool | None = None,
    lag: float = 0.0,
) -> list[Floats]:
    """`position_bound` of each of several followers; those with equal noise are computed
    together.
    """
    bounds = dict[int, Floats]()
    grouped = dict[tuple[TrueNoise, float, int], list[int]]()
    for i, (geometry, noise) in enumerate(zip(geometries, noises, strict=True)):
        if not noise.has_bound:
            bounds[i] = np.full((geometry.speed.size, 2, 2), np.nan)
        elif noise.speed_change == 0.0:
            kind = (noise, geometry.dt, geometry.arms.shape[1])
            grouped.setdefault(kind, []).append(i)
        elif lag > 0.0:
            raise ValueError("lag is not 0, expected 0 where the speed is a state")
        else:
            bounds[i] = _steady_speed_bound(geometry, noise, averaged)
    for (noise, _, _), indices in grouped.items():
        for first in range(0, len(indices), _MAX_FOLLOWERS):
            batch = indices[first : first + _MAX_FOLLOWERS]
            batch_geometries = [geometries[i] for i in batch]
            results = _dead_reckoning_bounds(batch_geometries, noise, averaged, lag)
            bounds.update(zip(batch, results, strict=True))
    return [bounds[i] for i in range(len(geometries))]


class _Intervals(NamedTuple):
    """Up to `_MAX_INTERVALS` consecutive intervals between messages of one follower: b of them,
    with k filter steps in all, by u unknown states.
    """

    span: slice  # the filter steps, the first of the mission is 0
    begins: Ints  # first step of each interval, shape (b,)
    lasts: Ints  # its last step, shape (b,)
    interval: Ints  # of each step, its number among these, shape (k,)
    n_messages: int  # how many intervals end with a message: all, but perhaps the last
    # what `_Transitions` has, of each step and of each interval
    position_jacobian: Floats  # shape (k, 2, u)
    position_noise: Floats  # shape (k, 2, 2)
    cross_to_end: Floats  # shape (k, 2, u)
    transition: Floats  # shape (b, u, u)
    process_noise: Floats  # shape (b, u, u)
    # of the message at the end of each interval, without the ranges' where their mean is taken;
    # shape (b, u, u)
    information: Floats


def _ends_of(geometry: BoundGeometry) -> Ints:
    """Steps at which the intervals between messages end, the last one with the mission."""
    n = geometry.speed.size
    ends = geometry.message_step
    return ends if ends.size and ends[-1] == n else np.append(ends, n)


def _intervals(
    geometry: BoundGeometry, noise: TrueNoise, unknown: Ints, first: int, takes_mean: bool
) -> _Intervals:
    """Intervals from number `first` on: all that does not depend on the covariance."""
    ends = _ends_of(geometry)
    lasts = ends[first : first + _MAX_INTERVALS] - 1
    begins = np.append(ends[first - 1 : first] if first > 0 else 0, lasts[:-1] + 1)[: lasts.size]
    lengths = lasts - begins + 1
    steps = int(lengths.sum())
    start = int(begins[0]) if steps else 0
    span = slice(start, start + steps)
    ahead = geometry.dt * np.stack(
        [np.sin(geometry.heading[span]), np.cos(geometry.heading[span])], axis=1
    )
    speed = geometry.speed[span]
    u = unknown.size
    position_jacobian = np.empty((steps, 2, u))
    position_noise = np.empty((steps, 2, 2))
    cross_to_end = np.empty((steps, 2, u))
    transition = np.empty((lasts.size, u, u))
    process_noise = np.empty((lasts.size, u, u))
    for length in np.unique(lengths):
        same_length = np.flatnonzero(lengths == length)
        interval_steps = begins[same_length][:, None] - start + np.arange(length)
        way = _transitions(speed[interval_steps], ahead[interval_steps], geometry.dt, noise)
        position_jacobian[interval_steps] = way.position_jacobian[..., unknown]
        position_noise[interval_steps] = way.position_noise
        cross_to_end[interval_steps] = way.cross_to_end[..., unknown]
        transition[same_length] = way.transition[:, unknown[:, None], unknown]
        process_noise[same_length] = way.process_noise[:, unknown[:, None], unknown]
    block = slice(first, min(first + lasts.size, geometry.message_step.size))
    n_messages = max(block.stop - first, 0)
    message_information = _leader_way_information(geometry, noise, block, lengths[:n_messages])
    if not takes_mean:
        message_information = message_information + _informations_at_truth(geometry, noise, block)
    information = np.zeros((lasts.size, u, u))
    information[:n_messages] = message_information[:, unknown[:, None], unknown]
    interval = np.repeat(np.arange(lasts.size), lengths)
    return _Intervals(
        span,
        begins,
        lasts,
        interval,
        n_messages,
        position_jacobian,
        position_noise,
        cross_to_end,
        transition,
        process_noise,
        information,
    )


def _side_by_side(arrays: Sequence[Floats], count: int, filler: Floats | float) -> Floats:
    """Arrays of up to `count` rows of each of f followers as one of shape (count, f, …), with a
    filler where a follower has fewer.
    """
    stacked = np.empty((count, len(arrays), *arrays[0].shape[1:]))
    stacked[:] = filler
    for i, array in enumerate(arrays):
        stacked[: len(array), i] = array
    return stacked


class _Recursion(NamedTuple):
    """Covariances of f followers over b intervals, shapes (b, f, u, u)."""

    before: Floats  # where each interval begins
    between: Floats  # of the state there with the state at its end
    predicted: Floats  # at its end
    after: Floats  # with the message that arrives there


def _advance(
    covariance: Floats,
    blocks: Sequence[_Intervals],
    messages: tuple[Floats, Floats] | None,
    noise: TrueNoise,
    unknown: Ints,
) -> _Recursion:
    """Carry covariances of f followers, shape (f, u, u), over a block of each one's intervals.

    `messages` are hydrophones from the leader and arms, shapes (b, f, 2) and (b, f, t, 3), where
    the mean information of the ranges is taken.
    """
    count = max(len(block.transition) for block in blocks)
    transition = _side_by_side([block.transition for block in blocks], count, np.eye(unknown.size))
    process_noise = _side_by_side([block.process_noise for block in blocks], count, 0.0)
    information = _side_by_side([block.information for block in blocks], count, 0.0)
    recursion = _Recursion(*np.empty((4, *transition.shape)))
    for j in range(count):
        recursion.before[j] = covariance
        recursion.between[j] = covariance @ transition[j].swapaxes(1, 2)
        covariance = transition[j] @ recursion.between[j] + process_noise[j]
        recursion.predicted[j] = covariance
        learnt = information[j]
        if messages is not None:
            from_leader, arms = messages
            ranges = _expected_informations(from_leader[j], covariance[:, :2, :2], arms[j], noise)
            learnt = learnt + ranges[:, unknown[:, None], unknown]
        covariance = _informed(covariance, learnt)
        recursion.after[j] = covariance
    return recursion


class _Smoothing:
    """What the smoothing of one follower's bound needs of its recursion, u unknown states."""

    def __init__(self, geometry: BoundGeometry, start: Floats) -> None:
        """`start` is the covariance at the start, shape (u, u)."""
        self._geometry = geometry
        self._cross_to_next = np.zeros((geometry.speed.size, 2, len(start)))
        self._predicted = [start[None]]
        self._updated = [start[None]]
        self._between = list[Floats]()

    def add(self, block: _Intervals, recursion: _Recursion, follower: int) -> None:
        """Add a block of intervals, which the recursion has for several followers."""
        spread = block.position_jacobian @ recursion.before[block.interval, follower]
        moved = spread @ block.transition[block.interval].swapaxes(1, 2) + block.cross_to_end
        self._cross_to_next[block.span] = moved
        between = recursion.between[: len(block.transition), follower]
        later = block.begins > 0
        self._cross_to_next[block.begins[later] - 1] = between[later, :2]
        self._between.append(between)
        self._predicted.append(recursion.predicted[: block.n_messages, follower])
        self._updated.append(recursion.after[: block.n_messages, follower])

    def smooth(self, bound: Floats, lag: float) -> Floats:
        """A bound, shape (n, 2, 2), with messages of up to a lag later [s]."""
        after = np.concatenate(self._updated)
        between = np.concatenate(self._between)
        links = len(after)
        zeros = np.zeros((links, after.shape[1]))
        chain = Chain(
            zeros,
            after,
            zeros,
            np.concatenate(self._predicted),
            np.concatenate([between, between[-1:]])[:links],
        )
        messages = self._geometry.message_step
        steps = np.arange(1, len(bound) + 1)
        latest = np.searchsorted(messages, steps, side="right")
        last_step = steps + round(lag / self._geometry.dt)
        last = np.searchsorted(messages, last_step, side="right")
        means = np.zeros((len(bound), 2))
        return smooth(chain, latest, last, (means, bound), self._cross_to_next)[1]


def _messages_side_by_side(
    geometries: Sequence[BoundGeometry], block: slice, count: int
) -> tuple[Floats, Floats]:
    """Hydrophones from the leader and arms of a block of each follower's messages, as `_advance`
    takes them.
    """
    from_leader = [geometry.from_leader[block] for geometry in geometries]
    arms = [geometry.arms[block] for geometry in geometries]
    return _side_by_side(from_leader, count, 0.0), _side_by_side(arms, count, np.nan)


def _write_bounds(intervals: _Intervals, recursion: _Recursion, i: int, bound: Floats) -> None:
    """Write the covariances of follower i's position at the steps of some intervals: on the way,
    and with the message at the end of each.
    """
    before = recursion.before[intervals.interval, i]
    jacobian = intervals.position_jacobian
    bound[intervals.span] = jacobian @ before @ jacobian.swapaxes(1, 2) + intervals.position_noise
    message_steps = intervals.lasts[: intervals.n_messages]
    bound[message_steps] = recursion.after[: intervals.n_messages, i, :2, :2]


def _dead_reckoning_bounds(
    geometries: Sequence[BoundGeometry], noise: TrueNoise, averaged: bool | None, lag: float
) -> list[Floats]:
    """As `position_bounds`, where the log is an input, of followers with the same noise, filter
    step and number of transmitters.

    All that does not depend on the covariance is computed for many intervals between messages at
    once, and the rest for all followers.
    """
    variances, unknown = _unknown_states(noise)
    takes_mean = averaged if averaged is not None else geometries[0].arms.shape[1] < 3
    start = np.diag(variances[unknown])
    covariance = np.repeat(start[None], len(geometries), axis=0)
    bounds = [np.empty((geometry.speed.size, 2, 2)) for geometry in geometries]
    smoothing = [_Smoothing(geometry, start) for geometry in geometries] if lag > 0.0 else []
    max_intervals = max(_ends_of(geometry).size for geometry in geometries)
    for first in range(0, max_intervals, _MAX_INTERVALS):
        block = slice(first, first + _MAX_INTERVALS)
        blocks = [
            _intervals(geometry, noise, unknown, first, takes_mean) for geometry in geometries
        ]
        count = max(len(intervals.transition) for intervals in blocks)
        messages = _messages_side_by_side(geometries, block, count) if takes_mean else None
        recursion = _advance(covariance, blocks, messages, noise, unknown)
        covariance = recursion.after[-1]
        for i, intervals in enumerate(blocks):
            _write_bounds(intervals, recursion, i, bounds[i])
            if smoothing:
                smoothing[i].add(intervals, recursion, i)
    return (
        [smoothing[i].smooth(bounds[i], lag) for i in range(len(bounds))] if lag > 0.0 else bounds
    )
