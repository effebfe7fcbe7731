"""Posterior Cramér–Rao bound of dead reckoning with ranges: the log and the compass are inputs with the stated noise.

The recursion of Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Processing 46 (1998): information about the state is
carried from message to message by J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H, with derivatives at the truth and the state of
`laisn.tight`. It bounds every estimator of this model and no other: one that assumes slowly varying speed can be below.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from laisn.arrays import Floats, Ints, require_numbers
from laisn.mixture import Chain, smooth

_LINE, _SHARES = np.polynomial.hermite_e.hermegauss(5)
_NODES = np.stack(np.meshgrid(_LINE, _LINE), axis=2).reshape(-1, 2)
_WEIGHTS = np.outer(_SHARES, _SHARES).ravel() / _SHARES.sum() ** 2


@dataclass(frozen=True, kw_only=True)
class TrueNoise:
    """Standard deviations of what is truly random in a mission; those of constants are what is known of them before.

    A constant whose standard deviation is 0 is known, and no state. Raises ValueError naming a field that is negative
    or not finite.
    """

    speed_sigma: float = 0.2
    """Standard deviation of a reading of the speed log [m/s]."""
    heading_sigma: float = float(np.deg2rad(2.0) * np.sqrt(1.0 - 2.0 / np.pi))
    """Standard deviation of a reading of the compass [rad]; by default of |N(0, 2°)|, as in the paper's Eq. 27."""
    range_sigma: float = 0.01 / float(np.sqrt(12.0))
    """Standard deviation of each range [m]; by default of a uniform error 0.01 m wide (Eq. 28)."""
    range_scale_sigma: float = 0.05
    """Standard deviation of ψ [m], drawn for each message; the transmitters share it in proportion to their ranges."""
    leader_heading_sigma: float = 0.0
    """Standard deviation of the heading that the leader broadcasts, drawn for each message [rad]."""
    start: float = 0.0
    """Standard deviation of the position at the start, along each axis [m]."""
    speed_bias: float = 0.3
    """Standard deviation, before the mission, of the log's constant bias [m/s]."""
    heading_bias: float = float(np.deg2rad(8.0))
    """Standard deviation, before the mission, of the compass's constant bias [rad]."""
    range_scale_bias: float = 0.2
    """Standard deviation, before the mission, of ψ's mean [m]."""
    leader_heading_bias: float = 0.0
    """Standard deviation, before the mission, of the leader's compass's constant bias [rad]."""
    current: float = 0.0
    """Standard deviation, before the mission, of the constant current along each axis [m/s]."""
    range_offset: float = 0.0
    """Standard deviation, before the mission, of a further transmitter's constant error beside the first one's [m]."""
    speed_walk: float = 0.0
    """How far the log's bias wanders in a second [m/s/√s]; 0 for a constant."""
    heading_walk: float = 0.0
    """How far the compass's bias wanders in a second [rad/√s]."""
    clock_offset: float = 0.0
    """Standard deviation of the clocks' offset at the start, as a range [m]."""
    clock_drift: float = 0.0
    """Standard deviation, before the mission, of the rate at which it grows [m/s]."""
    clock_walk: float = 0.0
    """How far that rate wanders in a second [m/s/√s]. The clock is a state where any of these three is not 0."""
    current_walk: float = 0.0
    """How far a current that is a state wanders in a second, along each axis [m/s/√s]."""
    leader_way_sigma: float = 0.0
    """Standard deviation of a mean current over 10 s as the leader's own way shows it [m/s]; 0: it shows none.

    Longer times give more in proportion: on the current, and of the leader's compass, where these are states.
    """

    def __post_init__(self) -> None:
        require_numbers(self)


@dataclass(frozen=True, kw_only=True)
class Geometry:
    """The true mission of one follower as its sensors meet it: n filter steps, m messages, t transmitters."""

    dt: float
    """Filter step [s]."""
    speed: Floats
    """Speed through the water after each step, shape (n,), [m/s]."""
    heading: Floats
    """Heading after each step, shape (n,), [rad]."""
    message_step: Ints
    """Step at which each message is received, shape (m,), from 1."""
    from_leader: Floats
    """Follower's hydrophone from the leader's origin at emission: east and north, shape (m, 2), [m]."""
    arms: Floats
    """Transmitters from the same origin: east, north, and how much deeper they are than the hydrophone, shape
    (m, t, 3), [m]; NaN where nothing is received."""
    leader_velocity: Floats | None = None
    """Velocity of the leader through the water at emission: east and north, shape (m, 2), [m/s]; None: not sent."""


def _states(noise: TrueNoise, transmitters: int) -> tuple[Floats, dict[str, int]]:
    """Variances before the mission, and where the optional states begin."""
    sigmas = [noise.start, noise.start, noise.speed_bias, noise.heading_bias, noise.range_scale_bias]
    optional = {"leader_heading_bias": 1, "current": 2, "range_offset": transmitters - 1}
    first = {}
    for name, count in optional.items():
        if getattr(noise, name) > 0.0:
            first[name] = len(sigmas)
            sigmas += [getattr(noise, name)] * count
    if noise.clock_offset > 0.0 or noise.clock_drift > 0.0 or noise.clock_walk > 0.0:
        first["clock"] = len(sigmas)
        sigmas += [noise.clock_offset, noise.clock_drift]
    return np.square(sigmas), first


def _range_rows(away: Floats, arms: Floats, first: dict[str, int], size: int) -> Floats:
    """Derivatives of the ranges, shape (q, t, size), of followers `away` from the leader, shape (q, 2), [m]."""
    flat = away[:, None, :] - arms[:, :2]
    distance = np.sqrt(np.sum(flat**2, axis=2) + arms[:, 2] ** 2)
    rows = np.zeros((*distance.shape, size))
    rows[..., :2] = flat / distance[..., None]
    rows[..., 4] = distance / distance.max(axis=1, keepdims=True)
    if "leader_heading_bias" in first:
        # a compass that reads too much puts the true arms further anticlockwise
        turning = np.column_stack([-arms[:, 1], arms[:, 0]])
        rows[..., first["leader_heading_bias"]] = -np.sum(rows[..., :2] * turning, axis=2)
    return rows


def _information(away: Floats, arms: Floats, noise: TrueNoise, first: dict[str, int], size: int) -> Floats:
    """Fisher information of the ranges of one message at each place, shape (q, size, size)."""
    received = np.flatnonzero(np.isfinite(arms[:, 2]))
    if not received.size:
        return np.zeros((len(away), size, size))
    rows = _range_rows(away, arms[received], first, size)
    if "range_offset" in first:
        for j, i in enumerate(received):
            if i > 0:
                rows[:, j, first["range_offset"] + i - 1] = 1.0
    if "clock" in first:
        rows[..., first["clock"]] = 1.0
    share = rows[..., 4]
    covariance = noise.range_sigma**2 * np.eye(received.size)
    covariance = covariance + noise.range_scale_sigma**2 * share[..., :, None] * share[..., None, :]
    if noise.leader_heading_sigma > 0.0:
        turned = _range_rows(away, arms[received], {"leader_heading_bias": 5}, max(size, 6))[..., 5]
        covariance += noise.leader_heading_sigma**2 * turned[..., :, None] * turned[..., None, :]
    return np.asarray(rows.swapaxes(1, 2) @ np.linalg.solve(covariance, rows))


def _expected_information(
    away: Floats, spread: Floats, arms: Floats, noise: TrueNoise, first: dict[str, int], size: int
) -> Floats:
    """Mean of the information over positions N(away, spread), by Gauss–Hermite quadrature, shape (size, size).

    On the axis of two transmitters the information about the lateral position is zero at the truth alone.
    """
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    found = _information(away + _NODES @ root.T, arms, noise, first, size)
    return np.asarray(np.einsum("q,qij->ij", _WEIGHTS, found))


class _Way:
    """The way between two messages, step by step: what it does to the state x of s numbers, and what it adds."""

    def __init__(self, speed: Floats, ahead: Floats, dt: float, noise: TrueNoise, first: dict[str, int], size: int):
        """Take speeds, shape (k,), [m/s], and directions times Δt, shape (k, 2), [s], of its k steps."""
        way, self._time, self._size = np.cumsum(speed[:, None] * ahead, axis=0), dt * np.arange(1, speed.size + 1), size
        # the true way is the measured one turned anticlockwise by the compass bias, less the log's bias
        self.rows = np.repeat(np.eye(size)[None, :2], speed.size, axis=0)
        self.rows[:, :, 2] = -np.cumsum(ahead, axis=0)
        self.rows[:, 0, 3], self.rows[:, 1, 3] = -way[:, 1], way[:, 0]
        self._walks = {2: noise.speed_walk**2, 3: noise.heading_walk**2}
        if "current" in first:
            east = first["current"]
            self.rows[:, 0, east] = self.rows[:, 1, east + 1] = self._time
            self._walks |= dict.fromkeys((east, east + 1), noise.current_walk**2)
        self._clock, self._clock_walk = first.get("clock"), noise.clock_walk**2
        along = ahead[:, :, None] * ahead[:, None, :]
        across = dt**2 * np.eye(2) - along
        turned = ((speed * noise.heading_sigma) ** 2)[:, None, None]
        self._grown = np.cumsum(noise.speed_sigma**2 * along + turned * across, axis=0)

    def added(self) -> Floats:
        """Covariance that each step's position has gained since the way began, shape (k, 2, 2)."""
        gained, third = self._grown.copy(), self._time[:, None, None] / 3.0
        for state, rate in self._walks.items():
            # a bias that wanders moves the position by its mean over a straight way
            moved = self.rows[:, :, state]
            gained += rate * third * moved[:, :, None] * moved[:, None, :]
        return gained

    def onward(self) -> Floats:
        """Covariance of what each step's position has gained with what the state has at the end, shape (k, 2, s)."""
        shared, t, end = np.zeros((self._time.size, 2, self._size)), self._time[:, None], self._time[-1]
        shared[:, :, :2] = self._grown
        for state, rate in self._walks.items():
            moved = self.rows[:, :, state]
            shared[:, :, state] += rate * 0.5 * t * moved
            both = (rate * (0.5 * t - t * t / (6.0 * end)) * moved)[:, :, None] * moved[-1]
            shared[:, :, :2] += both
        return shared

    def matrix(self) -> Floats:
        """F: the state at the end by that at the beginning, shape (s, s)."""
        step = np.eye(self._size)
        step[:2] = self.rows[-1]
        if self._clock is not None:
            step[self._clock, self._clock + 1] = self._time[-1]
        return step

    def noise(self) -> Floats:
        """Q: covariance that the state gains on the way, shape (s, s)."""
        gained = np.zeros((self._size, self._size))
        gained[:2] = self.onward()[-1]
        gained[2:, :2] = gained[:2, 2:].T
        for state, rate in self._walks.items():
            gained[state, state] = rate * self._time[-1]
        if self._clock is not None:
            t, both = self._time[-1], slice(self._clock, self._clock + 2)
            gained[both, both] = self._clock_walk * np.array([[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
        return gained


def position_bound(geometry: Geometry, noise: TrueNoise, *, averaged: bool | None = None, lag: float = 0.0) -> Floats:
    """Bound of the position's covariance after each step, shape (n, 2, 2), [m²], for the model stated above.

    `averaged` takes the mean information over the positions that the bound itself allows, not that at the truth; None:
    for two transmitters, whose information at the truth is zero on their axis. `lag` is how much later than a position
    the messages may be that it rests on [s]: of smoothing, where not 0.
    """
    n, transmitters = geometry.speed.size, geometry.arms.shape[1]
    variances, first = _states(noise, transmitters)
    size = variances.size
    mean = averaged if averaged is not None else transmitters < 3
    covariance: Floats = np.diag(variances)
    # of smoothing alone, and as large as the bounds of a whole mission
    smoothed = lag > 0.0
    bound, onward = np.empty((n, 2, 2)), np.zeros((n if smoothed else 0, 2, size))
    predicted, after, between = [covariance], [covariance], []
    ahead = geometry.dt * np.stack([np.sin(geometry.heading), np.cos(geometry.heading)], axis=1)
    for i, (begin, end) in enumerate(pairwise([0, *geometry.message_step.tolist(), n])):
        if begin == end:
            break
        way = _Way(geometry.speed[begin:end], ahead[begin:end], geometry.dt, noise, first, size)
        step = way.matrix()
        bound[begin:end] = way.rows @ covariance @ way.rows.swapaxes(1, 2) + way.added()
        if smoothed:
            onward[begin:end] = way.rows @ covariance @ step.T + way.onward()
            between.append(covariance @ step.T)
            if begin:
                onward[begin - 1] = between[-1][:2]
        covariance = step @ covariance @ step.T + way.noise()
        if i < geometry.message_step.size:
            if smoothed:
                predicted.append(covariance)
            away, arms = geometry.from_leader[i], geometry.arms[i]
            if mean:
                gained = _expected_information(away, covariance[:2, :2], arms, noise, first, size)
            else:
                gained = _information(away[None], arms, noise, first, size)[0]
            if noise.leader_way_sigma > 0.0 and geometry.leader_velocity is not None:
                # information of the leader's way since the last message
                seen, (east, north) = np.zeros((2, size)), geometry.leader_velocity[i]
                if "leader_heading_bias" in first:
                    seen[:, first["leader_heading_bias"]] = -north, east
                if "current" in first:
                    seen[:, first["current"] : first["current"] + 2] = np.eye(2)
                time = geometry.dt * (end - begin)
                gained = gained + seen.T @ seen * (time / (10.0 * noise.leader_way_sigma**2))
            # (P⁻¹ + I)⁻¹ without the inverse of P, which a known start makes singular
            found = np.linalg.solve(np.eye(size) + covariance @ gained, covariance)
            covariance = np.asarray(0.5 * (found + found.T), dtype=np.float64)
            bound[end - 1] = covariance[:2, :2]
            if smoothed:
                after.append(covariance)
    if not smoothed:
        return bound
    links = len(after)
    nothing = np.zeros((links, size))
    chain = Chain(nothing, np.array(after), nothing, np.array(predicted), np.array([*between, between[-1]])[:links])
    messages, steps = geometry.message_step, np.arange(1, n + 1)
    latest = np.searchsorted(messages, steps, side="right")
    last = np.searchsorted(messages, steps + round(lag / geometry.dt), side="right")
    return smooth(chain, latest, last, (np.zeros((n, 2)), bound), onward)[1]
