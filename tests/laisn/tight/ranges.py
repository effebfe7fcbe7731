"""Ranges and the sides of the leader's axis for `oracle`: rotations and derivatives as
matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import ndtr

from laisn.arrays import Floats
from laisn.messages import OwnMotion, Reception
from laisn.settings import TightSettings
from tests.laisn.tight.mixture import (
    CLOCK,
    COMPASS,
    EAST,
    LEADER,
    LOG,
    NEW,
    NORTH,
    SCALE,
    WALKED,
    Component,
    N,
    Side,
    heaviest,
    log_density,
    outer,
)


def pair(z: complex) -> Floats:
    return np.array([z.real, z.imag])


def rotation(angle: float) -> Floats:
    """Anticlockwise."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class Message:
    """A message: where the leader is, where its transmitters are beside it, and the ranges that
    came.
    """

    time: float
    place: Floats
    heading: float
    speed: float
    arms: Floats
    """East, north, and how much deeper than the hydrophone, shape (t, 3), of the ranges that
    came.
    """
    ranges: Floats
    which: list[int]
    axis: Floats
    """Arms of the rear and front transmitter, received or not, shape (2, 3)."""
    new_variance: float
    """Of the error of the place that is new in this message."""
    echo: float
    """By how much an echo may be longer."""
    lag: Floats
    """How long ago the pings arrived, of all three transmitters; 0 where all is prompt."""
    drift_time: Floats
    """How long the current has acted since the message, less the way of the ping; likewise."""
    ahead: complex
    """Direction of the follower as its compass reads."""
    speed_now: float
    """Its mean speed, and the variance of that."""
    speed_variance: float


@dataclass
class Watch:
    """The follower's clock and the mean of its log: of all readings in 1.5 s, later forgetting."""

    clock: float = 0.0
    mean: float = 0.0
    since_message: float = 0.0

    def read(self, speed: float, dt: float) -> None:
        self.clock += dt
        self.since_message += dt
        share = max(dt / 1.5, dt / self.clock)
        self.mean = (1.0 - share) * self.mean + share * speed

    def variance(self, settings: TightSettings) -> float:
        readings = np.clip(self.since_message, settings.dt, 1.5) / settings.dt
        return float(settings.speed_sigma**2 / readings + 0.03**2)


def _delays(
    settings: TightSettings, watch: Watch, time: float, ranges: Floats
) -> tuple[Floats, Floats]:
    """Times since the arrivals, and with the current, of three pings; all 0 where none is above a
    millisecond.
    """
    way = np.where(np.isnan(ranges), -np.inf, settings.sound_slowness * np.nan_to_num(ranges))
    way[settings.transmitters :] = -np.inf
    leaves = settings.ping_slot * np.arange(3)
    last = max(0.0, float((leaves + way).max()))
    since = watch.clock - time
    since = since if last <= since <= 5.0 else last
    drift_time = np.where(np.isinf(way), 0.0, np.maximum(since - way, 0.0))
    lag = np.where(np.isinf(way), 0.0, np.maximum(since - way - leaves, 0.0))
    late = settings.compensate_motion and bool((drift_time > 1e-3).any())
    return late * lag, late * drift_time


def _largest_echo_excess(
    settings: TightSettings, leader: float, own: float, ranges: Floats
) -> float:
    """An echo of range e has a direct range of √(e² − 4 d d') at least, by the distances from the
    surface or the floor.
    """
    boundaries = [0.0, settings.floor_depth] if settings.floor_depth else [0.0]
    product = max((leader - b) * (own - b) for b in boundaries)
    heard = ranges[: settings.transmitters]
    heard = heard[~np.isnan(heard)] if product > 0.0 else np.zeros(1)
    direct = np.sqrt(np.maximum(heard**2 - 4.0 * product, (leader - own) ** 2))
    return 1.0 + max(0.0, float((heard - direct).max(initial=0.0)))


def velocity(c: Component, received: Message) -> complex:
    """Of the follower through the water over the pings, by the biases of a component."""
    turned = np.exp(1j * c.x[COMPASS]) * received.ahead
    return complex((received.speed_now - c.x[LOG]) * turned)


def beside(c: Component, received: Message) -> tuple[Floats, Floats]:
    """Place from the leader's true one, and derivatives of that and of b_L, shape (3, N)."""
    q = c.x[:2] - received.place - c.x[NEW] - c.x[WALKED]
    rows = np.zeros((3, N))
    for axis in range(2):
        rows[axis, [axis, NEW[axis], WALKED[axis]]] = 1.0, -1.0, -1.0
    rows[2, LEADER] = 1.0
    return q, rows


def to_message(
    settings: TightSettings, own: OwnMotion, reception: Reception, watch: Watch
) -> Message:
    """Transmitters by Euler rotations: about up, then nose up, then starboard down."""
    message = reception.message
    tilted = settings.use_attitude and not np.isnan(message.pitch) and not np.isnan(message.roll)
    pitch, roll = (message.pitch, message.roll) if tilted else (0.0, 0.0)
    level = np.array(
        [pair(1j * np.exp(-1j * message.heading)), pair(-np.exp(-1j * message.heading))]
    )
    forward = np.array([*np.cos(pitch) * level[0], np.sin(pitch)])
    up = np.array([*-np.sin(pitch) * level[0], np.cos(pitch)])
    port = np.cos(roll) * np.array([*level[1], 0.0]) + np.sin(roll) * up
    arms = np.outer([-0.5, 0.5, 0.0], settings.baseline * forward) + np.outer(
        [0.0, 0.0, settings.middle_offset], port
    )
    if settings.compensate_motion:
        arms[:, :2] += np.outer(np.arange(3), settings.ping_slot * message.speed * level[0])
    arms[:, 2] = message.depth - (own.depth - settings.hydrophone_height) - arms[:, 2]
    which = [i for i in range(settings.transmitters) if not np.isnan(reception.ranges[i])]
    place, all_ranges = np.array([message.east, message.north]), np.array(reception.ranges)
    ranges = all_ranges[which]
    stated = message.position_sigma
    sigma = settings.leader_position_sigma if np.isnan(stated) else stated
    lag, drift_time = _delays(settings, watch, message.timestamp, all_ranges)
    return Message(
        message.timestamp,
        place,
        message.heading,
        message.speed,
        arms[which],
        ranges,
        which,
        arms[:2],
        sigma**2,
        _largest_echo_excess(
            settings, message.depth, own.depth - settings.hydrophone_height, all_ranges
        ),
        lag,
        drift_time,
        complex(np.sin(own.heading), np.cos(own.heading)),
        watch.mean,
        watch.variance(settings),
    )


@dataclass
class About:
    """Where the ranges are linearised: beside the mean position, where an update has taken
    `removed` of its covariance, and about an error of the leader's heading of variance `left`.
    """

    turn: float
    left: float
    off: Floats
    removed: Floats


def expected(
    settings: TightSettings, v: float, c: Component, received: Message, about: About
) -> tuple[Floats, Floats, Floats]:
    """Residuals, H and S of the ranges; errors common to them are in proportion to what was
    measured.
    """
    turn = about.turn
    q, rows = beside(c, received)
    q = q + about.off
    t = len(received.which)
    C = rows @ c.P @ rows.T
    C[2, 2] += about.left
    C[:2, :2] -= about.removed
    v_own = velocity(c, received)
    slipped = np.zeros((t, 2))
    residual, H, bent = np.empty(t), np.zeros((t, N)), []
    for j, (arm, i) in enumerate(zip(received.arms, received.which, strict=True)):
        s = rotation(c.x[LEADER] + turn) @ arm[:2]
        lag, drift_time = received.lag[i], received.drift_time[i]
        apart = q - s - lag * pair(v_own) - drift_time * c.x[[EAST, NORTH]]
        rho = max(np.linalg.norm([*apart, arm[2]]), 0.01)
        J = np.array([[1.0, 0.0, s[1]], [0.0, 1.0, -s[0]]])
        g = J.T @ apart / rho
        second = (J.T @ J + np.diag([0.0, 0.0, apart @ s]) - outer(g, g)) / rho
        bent.append(second @ C)
        H[j] = g @ rows
        H[j, SCALE] = received.ranges[j] / max(received.ranges.max(), 0.01)
        ahead = np.exp(1j * c.x[COMPASS]) * received.ahead
        H[j, LOG] += lag * (g[:2] @ pair(ahead))
        H[j, COMPASS] -= lag * (g[:2] @ pair(1j * v_own))
        H[j, [EAST, NORTH]] -= drift_time * g[:2]
        along, across = g[:2] @ pair(ahead), g[:2] @ pair(1j * ahead)
        slipped[j] = lag * along, lag * across
        if i > 0 and settings.assume.offsets:
            H[j, 7 + i] = 1.0
        H[j, CLOCK] = 1.0
        mean = (
            rho
            + H[j, SCALE] * c.x[SCALE]
            + H[j, 8:12] @ c.x[8:12]
            - g[2] * turn
            - g[:2] @ about.off
            + 0.5 * np.trace(bent[-1])
        )
        residual[j] = received.ranges[j] - mean
    S = H @ c.P @ H.T + settings.range_scale_sigma**2 * outer(H[:, SCALE], H[:, SCALE])
    S += v * outer(H[:, LEADER], H[:, LEADER]) + settings.range_sigma**2 * np.eye(t)
    if settings.transmitters == 2:
        S += np.diag((0.12 / np.maximum(received.ranges, 1.0) ** 2) ** 2)
    S += received.speed_variance * outer(slipped[:, 0], slipped[:, 0])
    turned = (settings.heading_sigma * abs(v_own)) ** 2
    S += turned * outer(slipped[:, 1], slipped[:, 1])
    return residual, H, S + 0.5 * np.array([[np.trace(a @ b) for a in bent] for b in bent])


def update_with_ranges(settings: TightSettings, v: float, c: Component, received: Message) -> int:
    """Update with the likeliest subset of the ranges, or with the differences of all; how many
    numbers that are.

    An echo common to all, of a length up to the span with a density of chance / span, leaves the
    differences. Those may be off by as much as a reflection would change them: it adds the same to
    the square of each range.
    """
    t = len(received.which)
    about = About(0.0, v, np.zeros(2), np.zeros((2, 2)))
    residual, H, S = expected(settings, v, c, received, about)
    direct, echo = (
        np.log(1.0 - settings.outlier_probability),
        np.log(settings.outlier_probability / settings.outlier_span),
    )
    span = max(settings.outlier_span, received.echo)
    cost = echo - np.where(residual < 0.0, 6.0, 0.0)
    subsets = [list(u) for size in range(t, -1, -1) for u in combinations(range(t), size)]
    # rows to multiply the ranges by, what residuals are corrected by, a further root of their
    # covariance, and what the hypothesis costs
    none = np.zeros(t)
    kinds = [
        (np.eye(t)[u], none, none, len(u) * direct + np.delete(cost, u).sum()) for u in subsets
    ]
    excess, mean = residual.mean(), received.ranges.mean()
    if t > 1 and 0.0 < excess < span:
        differences = np.column_stack([-np.ones(t - 1), np.eye(t - 1)])
        # of a reflection, whose way is so much longer than the direct one
        longer = (received.ranges - mean) / max(mean - excess, 0.01)
        costs = np.log(settings.outlier_probability / span) + t * direct
        kinds.append((differences, none, none, costs))
        kinds.append((differences, excess * longer, np.sqrt(S.mean()) * longer, costs))

    def likelihood(kind: tuple[Floats, Floats, Floats, float]) -> tuple[float, float]:
        A, correction, root, constant = kind
        covariance = A @ (S + outer(root, root)) @ A.T
        density, squared = log_density(A @ (residual + correction), covariance)
        return density + constant, squared

    A, correction, root, _ = best = max(kinds, key=lambda kind: likelihood(kind)[0])
    # of all its rows only those of differences sum to zero
    c.shared = bool(len(A)) and not A.sum(axis=1).any()
    (c.evidence, c.squared), c.excess, c.taken = likelihood(best), 0.0, len(A)
    c.normalised_innovation = (c.squared + 2.0 * (t - len(A)) * (direct - echo)) / t
    residual = residual + correction
    S += outer(root, root)
    again = False
    if len(A) and not settings.assume.exact_leader:
        by_heading = A @ H[:, LEADER]
        by_residual = np.linalg.solve(A @ S @ A.T, by_heading)
        turn, left = v * (by_residual @ A @ residual), v - v**2 * (by_residual @ by_heading)
        c.excess = turn**2 + left - v
        if left < 0.5 * v:
            again, about.turn, about.left = True, turn, left
    nearest = min((A @ received.ranges).tolist(), default=np.inf)
    erring = settings.leader_position_sigma + settings.leader_position_walk > 0.0
    plain = not (c.shared or erring or received.drift_time.any())
    if len(A) > 1 and plain and nearest < 12.0 and clear_of_axis(settings, c, received):
        gain = np.linalg.solve(A @ S @ A.T, A @ H @ c.P).T[:2]
        again, about.off = True, gain @ A @ residual
        about.removed = gain @ A @ H @ c.P[:, :2]
    if again:
        residual, H, S = expected(settings, v, c, received, about)
        residual = residual + correction
        S += outer(root, root)
    if len(A):
        c.update(A @ residual, A @ H, A @ S @ A.T)
    return len(A)


def clear_of_axis(settings: TightSettings, c: Component, received: Message) -> bool:
    """Three standard deviations off the axis as broadcast, which only two transmitters have."""
    along = received.axis[1, :2] - received.axis[0, :2]
    across = np.array([-along[1], along[0]])
    lateral = across @ (c.x[:2] - received.place - received.axis[0, :2])
    return settings.transmitters > 2 or bool(lateral**2 > 9.0 * across @ c.P[:2, :2] @ across)


def _axis(c: Component, received: Message) -> tuple[Floats, Floats, Floats]:
    """From the rear to the front transmitter, as they seem to a follower that stood still since the
    rear ping arrived; where it was, and derivatives as of `beside`.
    """
    q, rows = beside(c, received)
    moved = pair(velocity(c, received))
    axis = rotation(c.x[LEADER]) @ (received.axis[1, :2] - received.axis[0, :2])
    axis = axis + (received.lag[1] - received.lag[0]) * moved
    return axis, q - received.lag[0] * moved, rows


def aside(c: Component, received: Message) -> tuple[float, Floats]:
    """How far a component lies left of the leader's axis, and the derivatives of that."""
    axis, q, rows = _axis(c, received)
    axis = axis / np.linalg.norm(axis)
    off = q - rotation(c.x[LEADER]) @ received.axis[0, :2]
    row = np.array([-axis[1], axis[0], -axis @ q]) @ rows
    return float(axis[0] * off[1] - axis[1] * off[0]), row


def half(c: Component, received: Message, sign: float) -> Component:
    """The part of a component on one side of the axis, by the moments of a truncated normal
    variable.
    """
    lateral, row = aside(c, received)
    column = c.P @ row / np.sqrt(row @ c.P @ row)
    z = sign * lateral / np.sqrt(row @ c.P @ row)
    mass = ndtr(z)
    if mass < 1e-12:
        return replace(c, weight=0.0)
    more = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi) / mass
    P = c.P - more * (more + z) * outer(column, column)
    return replace(c, x=c.x + sign * more * column, P=P, weight=c.weight * mass)


def split(settings: TightSettings, sides: list[Side], received: Message) -> None:
    """Into halves, where the axis is within 3.5 σ and σ is more than 0.2 of where the axis
    matters, or 1 m.
    """
    for side in list(sides):
        top = heaviest(side)
        lateral, row = aside(top, received)
        axis, q, _ = _axis(top, received)
        length = np.linalg.norm(axis)
        matters = np.linalg.norm(q) * np.sqrt(2.8 * settings.range_sigma / length)
        sigma = np.sqrt(row @ top.P @ row)
        if len(sides) < 16 and sigma > min(0.2 * matters, 1.0) and abs(lateral) < 3.5 * sigma:
            sides.append([half(c, received, -1.0) for c in side])
            side[:] = [half(c, received, 1.0) for c in side]
