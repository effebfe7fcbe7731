"""A plain extended Kalman filter on ranges: the textbook baseline for the tightly coupled navigator.

State x = [x, y, b_v, b_θ, b_r]: position of the hydrophone [m], biases of log [m/s] and compass [rad], and mean of the
error that the ranges share in proportion to their length [m at the largest]. One Gaussian, linearised at its mean
(Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 10.3); all ranges
of a message are one measurement. No second hypothesis, no second-order terms, no test for echoes.

Many runs of one mission are filtered side by side: arrays begin with an axis of R runs.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.messages import Measurements
from laisn.tight.model import STEADY_COMPASS, STEADY_LOG
from laisn.tight.settings import TightSettings

STATES = 5


class Filtered(NamedTuple):
    """Estimates of R runs of n steps."""

    position: Floats
    """Mean x, y after each step, shape (R, n, 2), [m]."""
    covariance: Floats
    """Covariance of the position: xx, xy, yy, shape (R, n, 3), [m²]."""


def initial(settings: TightSettings, start: Floats, runs: int) -> tuple[Floats, Floats]:
    """State and covariance at a known start, shapes (R, 5) and (R, 5, 5)."""
    sigma = [settings.start_sigma] * 2
    sigma += [settings.speed_bias_sigma, settings.heading_bias_sigma, settings.range_scale_bias_sigma]
    x = np.zeros((runs, STATES))
    x[:, :2] = start[:2]
    return x, np.tile(np.diag(np.square(sigma)), (runs, 1, 1))


def predict(
    settings: TightSettings, x: Floats, P: Floats, before: Floats, now: Floats, dt: float
) -> tuple[Floats, Floats]:
    """One filter step: x ← f(x), P ← F P Fᵀ + Q, with f the mean velocity through the water of both ends.

    Args:
        settings: standard deviations.
        x: state, shape (R, 5).
        P: its covariance, shape (R, 5, 5).
        before: readings of log [m/s] and compass [rad] at the beginning of the step, shape (R, 2).
        now: at its end, likewise.
        dt: duration [s].
    """
    F = np.tile(np.eye(STATES), (x.shape[0], 1, 1))
    x = x.copy()
    for speed, heading in (before.T, now.T):
        true = heading - x[:, 3]
        along = np.stack([np.sin(true), np.cos(true)], axis=1)
        across = np.stack([-np.cos(true), np.sin(true)], axis=1)
        water = speed - x[:, 2]
        x[:, :2] += 0.5 * dt * water[:, None] * along
        F[:, :2, 2] -= 0.5 * dt * along
        F[:, :2, 3] += 0.5 * dt * water[:, None] * across
    Q = np.zeros_like(P)
    speed = now[:, 0, None]
    spread = settings.speed_sigma * along, settings.heading_sigma * speed * across
    Q[:, :2, :2] = dt**2 * sum(part[:, :, None] * part[:, None, :] for part in spread)
    Q[:, 2, 2], Q[:, 3, 3] = STEADY_LOG**2 * dt, STEADY_COMPASS**2 * dt
    return x, F @ P @ F.transpose(0, 2, 1) + Q


def update(
    settings: TightSettings, x: Floats, P: Floats, transmitters: Floats, ranges: Floats
) -> tuple[Floats, Floats]:
    """The ranges of a message: x ← x + K (z − h(x)), P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ with K = P Hᵀ S⁻¹.

    h_i = ρ_i (1 + b_r / max z); R = σ² I + σ_s² s sᵀ with s_i = ρ_i / max z. A range that is missing has no row.

    Args:
        settings: standard deviations.
        x: state, shape (R, 5).
        P: its covariance, shape (R, 5, 5).
        transmitters: east, north and depth below the hydrophone, negative above, shape (R, 3, 3), [m].
        ranges: slant ranges, shape (R, 3), [m]; NaN where nothing was received.
    """
    received = np.isfinite(ranges)
    away = np.concatenate([x[:, None, :2] - transmitters[..., :2], transmitters[..., 2:]], axis=-1)
    rho = np.linalg.norm(away, axis=-1)
    share = np.where(received, rho / np.max(np.where(received, ranges, 1.0), axis=1, keepdims=True), 0.0)
    H = np.zeros((*ranges.shape, STATES))
    H[..., :2] = np.where(received, 1.0 / rho, 0.0)[..., None] * away[..., :2]
    H[..., 4] = share
    innovation = np.where(received, ranges - rho - share * x[:, 4:], 0.0)
    R = settings.range_sigma**2 * np.eye(3) + settings.range_scale_sigma**2 * share[:, :, None] * share[:, None, :]
    HP = H @ P
    S = HP @ H.transpose(0, 2, 1) + R
    K = np.linalg.solve(S, HP).transpose(0, 2, 1)
    rest = np.eye(STATES) - K @ H
    P = rest @ P @ rest.transpose(0, 2, 1) + K @ R @ K.transpose(0, 2, 1)
    return x + (K @ innovation[..., None])[..., 0], P


def transmitters_of(settings: TightSettings, messages: Floats, depth: Floats) -> Floats:
    """Where a level leader's transmitters are, shape (R, 3, 3): east, north, depth below the hydrophone [m].

    Args:
        settings: baseline, offset of the middle transmitter, height of the hydrophone; the third is left out if two are
            used, as NaN.
        messages: rows of `LeaderMessage`, shape (R, 9).
        depth: of the follower's depth sensor, shape (R,), [m].
    """
    east, north, heading, leader_depth = messages[:, 1], messages[:, 2], messages[:, 3], messages[:, 5]
    s, c = np.sin(heading)[:, None], np.cos(heading)[:, None]
    half = 0.5 * settings.baseline
    ahead, port = np.array([-half, half, 0.0]), np.array([0.0, 0.0, settings.middle_offset])
    below = np.broadcast_to((leader_depth - depth + settings.hydrophone_height)[:, None], (heading.size, 3))
    return np.stack([east[:, None] + ahead * s - port * c, north[:, None] + ahead * c + port * s, below], axis=-1)


def filter_runs(settings: TightSettings, missions: Sequence[Measurements], start: Floats) -> Filtered:
    """Filter runs of one mission, which have their messages at the same steps.

    Args:
        settings: of the tightly coupled navigator, whose standard deviations are taken; exact leader, no drift, no
            current and no offsets.
        missions: measurements of each run.
        start: x, y [m] of the known start, shape (2,) or more.

    Raises:
        ValueError: messages are at other steps, or steps differ in length.
    """
    first = missions[0]
    if any(not np.array_equal(m.message_step, first.message_step) or m.durations is not None for m in missions):
        raise ValueError("runs that are filtered side by side need messages at the same steps, and steps of one length")
    own = np.stack([np.column_stack([m.speed, m.heading]) for m in missions])
    depth = np.stack([m.last_depth for m in missions])
    messages, ranges = (np.stack([getattr(m, name) for m in missions]) for name in ("message", "ranges"))
    ranges[..., settings.transmitters :] = np.nan
    arrival = dict(zip((first.message_step - 1).tolist(), range(first.message_step.size), strict=True))
    x, P = initial(settings, start, len(missions))
    position, covariance = np.empty((*own.shape[:2], 2)), np.empty((*own.shape[:2], 3))
    for k in range(own.shape[1]):
        x, P = predict(settings, x, P, own[:, max(k - 1, 0)], own[:, k], first.dt)
        i = arrival.get(k)
        if i is not None:
            there = transmitters_of(settings, messages[:, i], depth[:, k])
            x, P = update(settings, x, P, there, ranges[:, i])
        position[:, k], covariance[:, k] = x[:, :2], P[:, [0, 0, 1], [0, 1, 1]]
    return Filtered(position, covariance)
