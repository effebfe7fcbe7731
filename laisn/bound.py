"""The least error that any estimator of these ranges can have: posterior Cramér–Rao bound of a mission.

The recursion of Tichavský, Muravchik & Nehorai, IEEE Trans. Signal Processing 46 (1998), Eqs. 16 and 21, for a motion
that its log and compass give but for noise and constant biases: the information about the state is carried from message
to message by J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H. All derivatives are taken at the truth. The state is that of
`laisn.tight`: position, biases of log and compass, common scale error of ranges, and what else is unknown.
"""

from dataclasses import dataclass, fields

import numpy as np

from laisn.arrays import Floats, Ints

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


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

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not np.isfinite(value) or value < 0.0:
                raise ValueError(f"{field.name} is {value}, expected a finite number, zero or more")


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


def _states(noise: TrueNoise, transmitters: int) -> tuple[Floats, dict[str, int]]:
    """Variances before the mission, and where the optional states begin."""
    sigmas = [noise.start, noise.start, noise.speed_bias, noise.heading_bias, noise.range_scale_bias]
    optional = {"leader_heading_bias": 1, "current": 2, "range_offset": transmitters - 1}
    first = {}
    for name, count in optional.items():
        if getattr(noise, name) > 0.0:
            first[name] = len(sigmas)
            sigmas += [getattr(noise, name)] * count
    return np.square(sigmas), first


def _range_rows(away: Floats, arms: Floats, first: dict[str, int], size: int) -> tuple[Floats, Floats]:
    """Ranges [m] and their derivatives, shapes (t,) and (t, size), of a follower `away` from the leader."""
    apart = np.column_stack([away - arms[:, :2], arms[:, 2]])
    distance = np.sqrt(np.sum(apart**2, axis=1))
    rows = np.zeros((distance.size, size))
    rows[:, :2] = apart[:, :2] / distance[:, None]
    rows[:, 4] = distance / distance.max()
    if "leader_heading_bias" in first:
        # a compass that reads too much puts the true arms further anticlockwise
        turning = np.column_stack([-arms[:, 1], arms[:, 0]])
        rows[:, first["leader_heading_bias"]] = -np.sum(rows[:, :2] * turning, axis=1)
    return distance, rows


def _information(away: Floats, arms: Floats, noise: TrueNoise, first: dict[str, int], size: int) -> Floats:
    """Fisher information of the ranges of one message, shape (size, size)."""
    received = np.flatnonzero(np.isfinite(arms[:, 2]))
    if not received.size:
        return np.zeros((size, size))
    distance, rows = _range_rows(away, arms[received], first, size)
    if "range_offset" in first:
        for j, i in enumerate(received):
            if i > 0:
                rows[j, first["range_offset"] + i - 1] = 1.0
    share = distance / distance.max()
    covariance = noise.range_sigma**2 * np.eye(received.size) + noise.range_scale_sigma**2 * np.outer(share, share)
    if noise.leader_heading_sigma > 0.0:
        _, turned = _range_rows(away, arms[received], {"leader_heading_bias": 5}, max(size, 6))
        covariance += noise.leader_heading_sigma**2 * np.outer(turned[:, 5], turned[:, 5])
    return rows.T @ np.linalg.solve(covariance, rows)


def _expected_information(
    away: Floats, spread: Floats, arms: Floats, noise: TrueNoise, first: dict[str, int], size: int
) -> Floats:
    """Mean of the information over positions N(away, spread), by Gauss–Hermite quadrature.

    On the axis of two transmitters the information about the lateral position is zero at the truth alone, and not
    where an estimator with an error looks.
    """
    values, vectors = np.linalg.eigh(spread)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    total = np.zeros((size, size))
    for u, wu in zip(_NODES, _WEIGHTS, strict=True):
        for v, wv in zip(_NODES, _WEIGHTS, strict=True):
            total += wu * wv * _information(away + root @ np.array([u, v]), arms, noise, first, size)
    return total


def position_bound(geometry: Geometry, noise: TrueNoise, *, averaged: bool | None = None) -> Floats:
    """Least covariance of the position after each step, shape (n, 2, 2), [m²].

    Args:
        geometry: the true mission.
        noise: what is random in it, and what is known before.
        averaged: take the mean information over the positions that the bound itself allows, not that at the truth;
            None: for two transmitters, whose information at the truth is zero on their axis.
    """
    n, transmitters = geometry.speed.size, geometry.arms.shape[1]
    variances, first = _states(noise, transmitters)
    size = variances.size
    mean = averaged if averaged is not None else transmitters < 3
    covariance: Floats = np.diag(variances)
    bound = np.empty((n, 2, 2))
    arrival = dict(zip(geometry.message_step.tolist(), range(geometry.message_step.size), strict=True))
    way = np.stack([np.sin(geometry.heading), np.cos(geometry.heading)], axis=1)
    per_step = geometry.dt**2 * (
        noise.speed_sigma**2 * way[:, :, None] * way[:, None, :]
        + (geometry.speed * noise.heading_sigma)[:, None, None] ** 2
        * (np.eye(2) - way[:, :, None] * way[:, None, :])
    )  # fmt: skip
    step = np.eye(size)
    for k in range(n):
        dx, dy = geometry.speed[k] * geometry.dt * way[k]
        # the true way is the measured one turned anticlockwise by the compass bias, less the log's bias
        step[:2, 2] = -geometry.dt * way[k]
        step[:2, 3] = -dy, dx
        if "current" in first:
            step[0, first["current"]] = step[1, first["current"] + 1] = geometry.dt
        covariance = step @ covariance @ step.T
        covariance[:2, :2] += per_step[k]
        i = arrival.get(k + 1)
        if i is not None:
            away, arms = geometry.from_leader[i], geometry.arms[i]
            if mean:
                gained = _expected_information(away, covariance[:2, :2], arms, noise, first, size)
            else:
                gained = _information(away, arms, noise, first, size)
            # (P⁻¹ + I)⁻¹ without the inverse of P, which a known start makes singular
            found = np.linalg.solve(np.eye(size) + covariance @ gained, covariance)
            covariance = np.asarray(0.5 * (found + found.T), dtype=np.float64)
        bound[k] = covariance[:2, :2]
    return bound
