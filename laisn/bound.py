"""Posterior Cramér–Rao bound of dead reckoning with ranges: the log and the compass are inputs with
the stated noise.

The recursion of Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Processing 46 (1998):
information about the state is carried from message to message by J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H,
with derivatives at the truth and the state of `laisn.tight`. It bounds every estimator of this
model and no other: one that assumes slowly varying speed can be below. `TrueNoise.speed_change`
gives the bound of such an estimator: the speed is a random walk, and the log a measurement of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, require_numbers
from laisn.mixture import Chain, smooth

_LINE, _SHARES = np.polynomial.hermite_e.hermegauss(5)
_NODES = np.stack(np.meshgrid(_LINE, _LINE), axis=2).reshape(-1, 2)
_WEIGHTS = np.outer(_SHARES, _SHARES).ravel() / _SHARES.sum() ** 2


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
    # of ψ, drawn for each message; ranges share it in proportion [m]
    range_scale_sigma: float = 0.05
    leader_heading_sigma: float = 0.0  # of the heading that the leader broadcasts [rad]
    leader_position_sigma: float = 0.0  # of its broadcast position, along each axis [m]
    # constants
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


_LOG = 2
_COMPASS = 3
_SCALE = 4
_LEADER = 5
_EAST = 6
_NORTH = 7
_OFFSET = 8
_CLOCK = 10
_DRIFT = 11
_SPEED = 12
_STATES = 13
"""State x of s = 13 numbers as of `TightEstimates.names`, position first; what is known has the
variance 0.
"""
_MAX_INTERVALS = 256  # between messages that are computed at once
_ANY_SPEED = 10.0  # standard deviation of the speed before the first reading of the log [m/s]


def _range_information(
    from_leader: Floats, arms: Floats, received: Ints, noise: TrueNoise
) -> Floats:
    """Fisher information of ranges to followers `from_leader` from the leader, shape (q, 2), shape
    (q, s, s).

    `arms` are those of the transmitters `received`, of each follower or of all, shape (q, r, 3) or
    (1, r, 3).
    """
    if not received.size:
        return np.zeros((len(from_leader), _STATES, _STATES))
    flat = from_leader[:, None, :] - arms[..., :2]
    distance = np.sqrt(np.sum(flat**2, axis=2) + arms[..., 2] ** 2)
    share = distance / distance.max(axis=1, keepdims=True)
    rows = np.zeros((*distance.shape, _STATES))
    rows[..., :2] = flat / distance[..., None]
    rows[..., _SCALE] = share
    rows[..., _CLOCK] = 1.0
    # a compass that reads too much puts the true arms further anticlockwise
    quarter_turned = np.stack([-arms[..., 1], arms[..., 0]], axis=-1)
    bearing_row = -np.sum(rows[..., :2] * quarter_turned, axis=2)
    rows[..., _LEADER] = bearing_row
    for j in np.flatnonzero(received > 0):
        rows[:, j, _OFFSET + received[j] - 1] = 1.0
    covariance = noise.range_sigma**2 * np.eye(received.size)
    covariance = covariance + noise.range_scale_sigma**2 * share[..., :, None] * share[..., None, :]
    directions = rows[..., :2]
    covariance = covariance + noise.leader_position_sigma**2 * (
        directions @ directions.swapaxes(1, 2)
    )
    covariance += (
        noise.leader_heading_sigma**2 * bearing_row[..., :, None] * bearing_row[..., None, :]
    )
    return np.asarray(rows.swapaxes(1, 2) @ np.linalg.solve(covariance, rows))


def _expected_information(
    from_leader: Floats, spread: Floats, arms: Floats, noise: TrueNoise
) -> Floats:
    """Mean of the information of one message over positions N(away, spread), by Gauss–Hermite
    quadrature, shape (s, s).
    """
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    received = np.flatnonzero(np.isfinite(arms[:, 2]))
    places = from_leader + _NODES @ root.T
    informations = _range_information(places, arms[None, received], received, noise)
    return np.asarray(np.einsum("q,qij->ij", _WEIGHTS, informations))


def _leader_way_information(
    geometry: BoundGeometry, noise: TrueNoise, i: slice, steps: int
) -> Floats:
    """Information of the leader's way over the `steps` before each message of a slice, shape
    (b, s, s).
    """
    if noise.leader_way_sigma == 0.0 or geometry.leader_velocity is None:
        return np.zeros((geometry.from_leader[i].shape[0], _STATES, _STATES))
    velocity = geometry.leader_velocity[i]
    jacobian = np.zeros((len(velocity), 2, _STATES))
    jacobian[:, 0, _LEADER] = -velocity[:, 1]
    jacobian[:, 1, _LEADER] = velocity[:, 0]
    jacobian[:, :, _EAST : _NORTH + 1] = np.eye(2)
    time = geometry.dt * steps
    return np.asarray(
        jacobian.swapaxes(1, 2) @ jacobian * (time / (10.0 * noise.leader_way_sigma**2))
    )


def _informations_at_truth(geometry: BoundGeometry, noise: TrueNoise, i: slice) -> Floats:
    """Information of the ranges of each message of a slice at the true positions, shape
    (b, s, s).
    """
    from_leader = geometry.from_leader[i]
    arms = geometry.arms[i]
    informations = np.zeros((len(from_leader), _STATES, _STATES))
    present = np.isfinite(arms[..., 2])
    for pattern in np.unique(present, axis=0):
        messages = np.flatnonzero((present == pattern).all(axis=1))
        received = np.flatnonzero(pattern)
        informations[messages] = _range_information(
            from_leader[messages], arms[np.ix_(messages, received)], received, noise
        )
    return informations


class _Transitions(NamedTuple):
    """The way over b intervals between messages, of k filter steps each."""

    rows: Floats  # each step's position by the state at the beginning, shape (b, k, 2, s)
    step: Floats  # F, the state at the end by that, shape (b, s, s)
    added: Floats  # covariance that each step's position has gained, shape (b, k, 2, 2)
    onward: Floats  # that of this with what the state has gained at the end, shape (b, k, 2, s)
    gained: Floats  # Q, of what the state has gained, shape (b, s, s)


def _transitions(speed: Floats, ahead: Floats, dt: float, noise: TrueNoise) -> _Transitions:
    """The way by speeds, shape (b, k), [m/s], and directions times Δt, shape (b, k, 2), [s]."""
    intervals, steps = speed.shape
    way = np.cumsum(speed[..., None] * ahead, axis=1)
    time = dt * np.arange(1, steps + 1)
    # the true way is the measured one turned anticlockwise by the compass bias, less the log's bias
    rows = np.zeros((intervals, steps, 2, _STATES))
    rows[..., 0, 0] = rows[..., 1, 1] = 1.0
    rows[..., _LOG] = -np.cumsum(ahead, axis=1)
    rows[..., 0, _COMPASS] = -way[..., 1]
    rows[..., 1, _COMPASS] = way[..., 0]
    rows[..., 0, _EAST] = rows[..., 1, _NORTH] = time
    t = time[:, None]
    end = time[-1]
    step = np.repeat(np.eye(_STATES)[None], intervals, axis=0)
    step[:, :2] = rows[:, -1]
    step[:, _CLOCK, _DRIFT] = end
    longitudinal = ahead[..., :, None] * ahead[..., None, :]
    heading_variance = ((speed * noise.heading_sigma) ** 2)[..., None, None]
    added = np.cumsum(
        noise.speed_sigma**2 * longitudinal + heading_variance * (dt**2 * np.eye(2) - longitudinal),
        axis=1,
    )
    cross_at_end = np.zeros((intervals, steps, 2, _STATES))
    gained = np.zeros((intervals, _STATES, _STATES))
    cross_at_end[..., :2] = added
    current = noise.current_walk**2 if noise.current > 0.0 else 0.0
    walks = (
        (_LOG, noise.speed_walk**2),
        (_COMPASS, noise.heading_walk**2),
        (_EAST, current),
        (_NORTH, current),
    )
    for state, rate in walks:
        # a bias that wanders moves the position by its mean over a straight way
        state_rows = rows[..., state]
        at_end = state_rows[:, -1, None, None, :]
        added += rate * (t[..., None] / 3.0) * state_rows[..., :, None] * state_rows[..., None, :]
        cross_at_end[..., state] += rate * 0.5 * t * state_rows
        cross_at_end[..., :2] += (rate * (0.5 * t - t * t / (6.0 * end)) * state_rows)[
            ..., None
        ] * at_end
        gained[:, state, state] = rate * end
    gained[:, :2] = cross_at_end[:, -1]
    gained[:, 2:, :2] = cross_at_end[:, -1, :, 2:].swapaxes(1, 2)
    gained[:, _CLOCK : _DRIFT + 1, _CLOCK : _DRIFT + 1] = noise.clock_walk**2 * np.array(
        [[end**3 / 3.0, end**2 / 2.0], [end**2 / 2.0, end]]
    )
    return _Transitions(rows, step, added, cross_at_end, gained)


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
    geometry: BoundGeometry, noise: TrueNoise, i: int, covariance: Floats, mean: bool, steps: int
) -> Floats:
    """Information of message i, `steps` after the one before it, shape (s, s): of its ranges, and
    of the leader's way since then.
    """
    message = slice(i, i + 1)
    if mean:
        from_leader = geometry.from_leader[i]
        gained = _expected_information(from_leader, covariance[:2, :2], geometry.arms[i], noise)
    else:
        gained = _informations_at_truth(geometry, noise, message)[0]
    return np.asarray(gained + _leader_way_information(geometry, noise, message, steps)[0])


def _informed(covariance: Floats, gained: Floats) -> Floats:
    """(P⁻¹ + I)⁻¹ without the inverse of P, which a known start makes singular."""
    informed = np.linalg.solve(np.eye(len(covariance)) + covariance @ gained, covariance)
    return np.asarray(0.5 * (informed + informed.T), dtype=np.float64)


def _steady_speed_bound(geometry: BoundGeometry, noise: TrueNoise, averaged: bool | None) -> Floats:
    """As `position_bound`, where the speed is a random walk that the log measures in each step.

    It is that of a speed which is held: an estimator that also expects manoeuvres is above it.
    """
    n = geometry.speed.size
    variances, unknown = _unknown_states(noise)
    block = np.ix_(unknown, unknown)
    mean = averaged if averaged is not None else geometry.arms.shape[1] < 3
    dt = geometry.dt
    walks = np.zeros(_STATES)
    walks[[_LOG, _COMPASS, _SPEED]] = noise.speed_walk, noise.heading_walk, noise.speed_change
    walks[[_EAST, _NORTH]] = noise.current_walk if noise.current > 0.0 else 0.0
    walks[_DRIFT] = noise.clock_walk
    log = np.zeros((_STATES, _STATES))
    log[np.ix_([_SPEED, _LOG], [_SPEED, _LOG])] = 1.0 / noise.speed_sigma**2
    log = log[block]
    # a reading before the first step, as the speed there must be known
    covariance = _informed(np.diag(variances[unknown]), log)
    bound = np.empty((n, 2, 2))
    messages = dict(zip(geometry.message_step.tolist(), range(n), strict=False))
    last = 0
    for k in range(n):
        u = np.array([np.sin(geometry.heading[k]), np.cos(geometry.heading[k])])
        across = np.array([-u[1], u[0]])
        F = np.eye(_STATES)
        F[:2, _SPEED] = u * dt
        F[:2, _COMPASS] = geometry.speed[k] * across * dt
        F[0, _EAST] = F[1, _NORTH] = F[_CLOCK, _DRIFT] = dt
        Q = np.diag(walks**2 * dt)
        Q[:2, :2] = (geometry.speed[k] * noise.heading_sigma * dt) ** 2 * np.outer(across, across)
        step = F[block]
        covariance = _informed(step @ covariance @ step.T + Q[block], log)
        if k + 1 in messages:
            gained = _message_information(
                geometry, noise, messages[k + 1], covariance, mean, k + 1 - last
            )
            covariance = _informed(covariance, gained[block])
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
    where not 0.
    """
    if noise.speed_change > 0.0:
        if lag > 0.0:
            raise ValueError("lag is not 0, expected 0 where the speed is a state")
        return _steady_speed_bound(geometry, noise, averaged)
    return _dead_reckoning_bound(geometry, noise, averaged, lag)


def _runs(geometry: BoundGeometry) -> Iterator[tuple[int, int, int, int]]:
    """Consecutive intervals between messages of equal length, at most `_MAX_INTERVALS` each.

    Yields the number of the first, how many they are, the step at which they begin, and their
    length [steps].
    """
    ends = np.append(geometry.message_step, geometry.speed.size)
    lengths = np.diff(ends, prepend=0)
    lengths = lengths[lengths > 0]
    first = 0
    while first < lengths.size:
        equal = lengths[first : first + _MAX_INTERVALS] == lengths[first]
        count = equal.size if equal.all() else int(np.argmin(equal))
        begin = int(ends[first] - lengths[first])
        yield first, count, begin, int(lengths[first])
        first += count


def _dead_reckoning_bound(
    geometry: BoundGeometry, noise: TrueNoise, averaged: bool | None, lag: float
) -> Floats:
    """As `position_bound`, where the log is an input.

    All that does not depend on the covariance is computed for many intervals between messages at
    once.
    """
    n = geometry.speed.size
    smoothed = lag > 0.0
    variances, unknown = _unknown_states(noise)
    both = np.ix_(unknown, unknown)
    covariance = np.diag(variances[unknown])
    mean = averaged if averaged is not None else geometry.arms.shape[1] < 3
    # of smoothing alone, and as large as the bounds of a whole mission
    bound = np.empty((n, 2, 2))
    cross_to_next = np.zeros((n if smoothed else 0, 2, unknown.size))
    predicted = [covariance]
    after = [covariance]
    crosses = list[Floats]()
    ahead = geometry.dt * np.stack([np.sin(geometry.heading), np.cos(geometry.heading)], axis=1)
    for first, count, begin, length in _runs(geometry):
        span = slice(begin, begin + count * length)
        way = _transitions(
            geometry.speed[span].reshape(count, length),
            ahead[span].reshape(count, length, 2),
            geometry.dt,
            noise,
        )
        rows = way.rows[..., unknown]
        step = way.step[:, both[0], both[1]]
        gained = way.gained[:, both[0], both[1]]
        block = slice(first, min(first + count, geometry.message_step.size))
        informations = _leader_way_information(geometry, noise, block, length)
        if not mean:
            informations = informations + _informations_at_truth(geometry, noise, block)
        before = np.empty((count, unknown.size, unknown.size))
        informed = np.empty((len(informations), 2, 2))
        for j in range(count):
            before[j] = covariance
            crosses.append(covariance @ step[j].T)
            covariance = step[j] @ crosses[-1] + gained[j]
            if j < len(informations):
                information = informations[j]
                if mean:
                    i = first + j
                    information = information + _expected_information(
                        geometry.from_leader[i], covariance[:2, :2], geometry.arms[i], noise
                    )
                predicted.append(covariance)
                covariance = _informed(covariance, information[both])
                after.append(covariance)
                informed[j] = covariance[:2, :2]
        spread = rows @ before[:, None]
        bound[span] = (spread @ rows.swapaxes(2, 3) + way.added).reshape(-1, 2, 2)
        lasts = begin + length * np.arange(1, count + 1) - 1
        bound[lasts[: len(informed)]] = informed
        if smoothed:
            moved = spread @ step.swapaxes(1, 2)[:, None] + way.onward[..., unknown]
            cross_to_next[span] = moved.reshape(-1, 2, unknown.size)
            last_messages = lasts - length
            inner_crosses = [moved_on[:2] for moved_on in crosses[-count:]]
            for index, cross in zip(last_messages, inner_crosses, strict=True):
                if index >= 0:
                    cross_to_next[index] = cross
    if not smoothed:
        return bound
    links = len(after)
    zeros = np.zeros((links, unknown.size))
    chain = Chain(
        zeros,
        np.array(after),
        zeros,
        np.array(predicted),
        np.array([*crosses, crosses[-1]])[:links],
    )
    messages = geometry.message_step
    steps = np.arange(1, n + 1)
    latest = np.searchsorted(messages, steps, side="right")
    last = np.searchsorted(messages, steps + round(lag / geometry.dt), side="right")
    return smooth(chain, latest, last, (np.zeros((n, 2)), bound), cross_to_next)[1]
