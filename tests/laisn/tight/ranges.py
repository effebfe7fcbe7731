"""Ranges and the sides of the leader's axis for `oracle`: rotations and derivatives as matrices."""

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


def vector(z: complex) -> Floats:
    return np.array([z.real, z.imag])


def rotation(angle: float) -> Floats:
    """Matrix of an anticlockwise rotation."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@dataclass
class Message:
    """A message: where the leader is, where its transmitters are beside it, and the ranges that
    came.
    """

    time: float
    position: Floats
    heading: float
    speed: float
    arms: Floats
    """East, north, and how much deeper than the hydrophone, shape (t, 3), of the ranges that
    came.
    """
    ranges: Floats
    indices: list[int]
    axis: Floats
    """Arms of the rear and front transmitter, received or not, shape (2, 3)."""
    position_variance: float
    """Of the error of the place that is new in this message."""
    echo: float
    """By how much an echo may be longer."""
    drift_time: Floats
    """How long the current has acted since the message, less the way of the ping, of all three
    transmitters; 0 where all is prompt.
    """
    ways: WaysOfReadings


@dataclass
class WaysOfReadings:
    """Of the follower since each of three pings arrived, by its readings; 0 where all is prompt."""

    logged: list[complex]
    """East + i north [m]."""
    per_speed: list[complex]
    """What they gain for 1 m/s more [s]."""
    errors: list[Floats]
    """Covariances, shapes (2, 2), of errors that add up reading by reading."""
    mean_errors: list[complex]
    """σ of the error that is in proportion to the time until the last ping arrived."""
    last: int
    """The ping that arrived last."""


class Watch:
    """The follower's clock and all its readings."""

    def __init__(self) -> None:
        self.clock = 0.0
        self.since_message = 0.0
        self.readings: list[tuple[float, float, complex]] = []

    def read(self, own: OwnMotion, dt: float) -> None:
        self.clock += dt
        self.since_message += dt
        self.readings.append((dt, own.speed, complex(np.sin(own.heading), np.cos(own.heading))))

    def between(self, begin: float, end: float) -> tuple[complex, complex, float, Floats]:
        """Ways by log and compass, for 1 m/s, and of the log alone, between two times; how many
        seconds of each reading are in that.
        """
        dt, speed, ahead = (np.array(column) for column in zip(*self.readings, strict=True))
        ends = np.cumsum(dt)
        inside = np.minimum(ends, end) - np.maximum(ends - dt, begin)
        share = np.maximum(inside, 0.0) / 2.0

        def total(values: Floats) -> complex:
            return complex(share @ (values + np.r_[values[:1], values[:-1]]))

        return total(speed * ahead), total(ahead), total(speed).real, 2.0 * share

    def errors(self, settings: TightSettings, begin: float) -> Floats:
        """Covariance of the errors of the way since a time."""
        seconds = self.between(begin, self.clock)[3]
        covariance = settings.slip**2 * (self.clock - max(begin, 0.0)) * np.eye(2)
        for (dt, speed, ahead), time in zip(self.readings, seconds, strict=True):
            along, across = vector(ahead), vector(1j * ahead)
            covariance += time * dt * settings.speed_sigma**2 * outer(along, along)
            covariance += time * dt * (settings.heading_sigma * speed) ** 2 * outer(across, across)
        return covariance


def _ways(
    settings: TightSettings, watch: Watch, lag: Floats, received: list[int]
) -> WaysOfReadings:
    """From ping to ping the speed is a mean of the readings of 3 s about them, since the last
    message.
    """
    nothing = np.zeros((2, 2))
    ways = WaysOfReadings([0j] * 3, [0j] * 3, [nothing] * 3, [0j] * 3, 0)
    if not received:
        return ways
    last = min(received, key=lambda i: float(lag[i]))
    ways.last = last
    for i in received:
        arrived = watch.clock - lag[i]
        ways.logged[i], ways.per_speed[i], _, _ = watch.between(arrived, watch.clock)
        ways.errors[i] = watch.errors(settings, arrived)
    for i in received:
        time = float(lag[i] - lag[last])
        end = min(watch.clock, watch.clock - lag[last] + max(3.0 - time, 0.0) / 2.0)
        begin = max(end - 3.0, watch.clock - watch.since_message)
        if i == last or time <= 0.0 or end - begin < time:
            continue
        speed = watch.between(begin, end)[2] / (end - begin)
        between = ways.per_speed[i] - ways.per_speed[last]
        ways.logged[i] = ways.logged[last] + speed * between
        sigma = np.hypot(settings.speed_sigma * np.sqrt(settings.dt / (end - begin)), 0.03)
        ways.mean_errors[i] = complex(sigma * between)
        across = vector(1j * between / time) * settings.heading_sigma * speed
        added = settings.dt * outer(across, across) + settings.slip**2 * np.eye(2)
        ways.errors[i] = ways.errors[last] + time * added
    return ways


def _delays(
    settings: TightSettings, watch: Watch, time: float, ranges: Floats
) -> tuple[Floats, Floats]:
    """Times since the arrivals, and with the current, of three pings; all 0 where none is above a
    millisecond.
    """
    travel_time = np.where(
        np.isnan(ranges), -np.inf, settings.sound_slowness * np.nan_to_num(ranges)
    )
    travel_time[settings.transmitters :] = -np.inf
    leaves = settings.ping_slot * np.arange(3)
    last = max(0.0, float((leaves + travel_time).max()))
    since_sent = watch.clock - time
    since_sent = since_sent if last <= since_sent <= 20.0 else last
    drift_time = np.where(np.isinf(travel_time), 0.0, np.maximum(since_sent - travel_time, 0.0))
    lag = np.where(np.isinf(travel_time), 0.0, np.maximum(since_sent - travel_time - leaves, 0.0))
    is_late = settings.compensate_motion and bool((drift_time > 1e-3).any())
    return is_late * lag, is_late * drift_time


def _largest_echo_excess(
    settings: TightSettings, leader: float, own: float, ranges: Floats
) -> float:
    """An echo of range e has a direct range of √(e² − 4 d d') at least, by the distances from the
    surface or the floor.
    """
    boundaries = [0.0, settings.floor_depth] if settings.floor_depth else [0.0]
    product = max((leader - b) * (own - b) for b in boundaries)
    received = ranges[: settings.transmitters]
    received = received[~np.isnan(received)] if product > 0.0 else np.zeros(1)
    direct = np.sqrt(np.maximum(received**2 - 4.0 * product, (leader - own) ** 2))
    return 1.0 + max(0.0, float((received - direct).max(initial=0.0)))


def way(c: Component, received: Message, i: int) -> complex:
    """Of the follower through the water since ping i arrived, by the biases of a component."""
    unbiased = received.ways.logged[i] - c.x[LOG] * received.ways.per_speed[i]
    return complex(np.exp(1j * c.x[COMPASS]) * unbiased)


def _way_errors(received: Message, i: int, j: int) -> Floats:
    """Covariance of what the ways since pings i and j err until the last ping arrived."""
    ways = received.ways
    later = min((ways.errors[i], ways.errors[j]), key=np.trace)
    common = outer(vector(ways.mean_errors[i]), vector(ways.mean_errors[j]))
    return later - ways.errors[ways.last] + common


def from_leader(c: Component, received: Message) -> tuple[Floats, Floats]:
    """Position from the leader's true one, and derivatives of that and of b_L, shape (3, N)."""
    offset = c.x[:2] - received.position - c.x[NEW] - c.x[WALKED]
    rows = np.zeros((3, N))
    for axis in range(2):
        rows[axis, [axis, NEW[axis], WALKED[axis]]] = 1.0, -1.0, -1.0
    rows[2, LEADER] = 1.0
    return offset, rows


def to_message(
    settings: TightSettings, own: OwnMotion, reception: Reception, watch: Watch
) -> Message:
    """Transmitters by Euler rotations: about up, then nose up, then starboard down."""
    message = reception.message
    tilted = settings.use_attitude and not np.isnan(message.pitch) and not np.isnan(message.roll)
    pitch, roll = (message.pitch, message.roll) if tilted else (0.0, 0.0)
    level = np.array(
        [vector(1j * np.exp(-1j * message.heading)), vector(-np.exp(-1j * message.heading))]
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
    indices = [i for i in range(settings.transmitters) if not np.isnan(reception.ranges[i])]
    position, all_ranges = np.array([message.east, message.north]), np.array(reception.ranges)
    ranges = all_ranges[indices]
    stated = message.position_sigma
    sigma = settings.leader_position_sigma if np.isnan(stated) else stated
    lag, drift_time = _delays(settings, watch, message.timestamp, all_ranges)
    return Message(
        message.timestamp,
        position,
        message.heading,
        message.speed,
        arms[indices],
        ranges,
        indices,
        arms[:2],
        sigma**2,
        _largest_echo_excess(
            settings, message.depth, own.depth - settings.hydrophone_height, all_ranges
        ),
        drift_time,
        _ways(settings, watch, lag, indices if drift_time.any() else []),
    )


@dataclass
class About:
    """Where the ranges are linearised: beside the mean position, where an update has removed
    `removed_covariance`, and about an error of the leader's heading of some `variance`.
    """

    turn: float
    """Error of the leader's heading [rad]."""
    variance: float
    """Of that error."""
    shift: Floats
    """Of the position, from the mean before the update."""
    removed_covariance: Floats
    """By which the update reduced that of the position."""


def linearise(
    settings: TightSettings, heading_variance: float, c: Component, received: Message, about: About
) -> tuple[Floats, Floats, Floats]:
    """Residuals, H and S of the ranges; errors common to them are in proportion to what was
    measured.
    """
    turn = about.turn
    q, rows = from_leader(c, received)
    q = q + about.shift
    t = len(received.indices)
    C = rows @ c.P @ rows.T
    C[2, 2] += about.variance
    C[:2, :2] -= about.removed_covariance
    directions = np.zeros((t, 2))
    residual, H, second_order = np.empty(t), np.zeros((t, N)), []
    for j, (arm, i) in enumerate(zip(received.arms, received.indices, strict=True)):
        s = rotation(c.x[LEADER] + turn) @ arm[:2]
        moved, drift_time = way(c, received, i), received.drift_time[i]
        offset = q - s - vector(moved) - drift_time * c.x[[EAST, NORTH]]
        rho = max(np.linalg.norm([*offset, arm[2]]), 0.01)
        J = np.array([[1.0, 0.0, s[1]], [0.0, 1.0, -s[0]]])
        g = J.T @ offset / rho
        second = (J.T @ J + np.diag([0.0, 0.0, offset @ s]) - outer(g, g)) / rho
        second_order.append(second @ C)
        H[j] = g @ rows
        H[j, SCALE] = received.ranges[j] / max(received.ranges.max(), 0.01)
        per_speed = np.exp(1j * c.x[COMPASS]) * received.ways.per_speed[i]
        H[j, LOG] += g[:2] @ vector(per_speed)
        H[j, COMPASS] -= g[:2] @ vector(1j * moved)
        H[j, [EAST, NORTH]] -= drift_time * g[:2]
        directions[j] = g[:2]
        if i > 0 and settings.assume.offsets:
            H[j, 7 + i] = 1.0
        H[j, CLOCK] = 1.0
        mean = (
            rho
            + H[j, SCALE] * c.x[SCALE]
            + H[j, 8:12] @ c.x[8:12]
            - g[2] * turn
            - g[:2] @ about.shift
            + 0.5 * np.trace(second_order[-1])
        )
        residual[j] = received.ranges[j] - mean
    S = H @ c.P @ H.T + settings.range_scale_sigma**2 * outer(H[:, SCALE], H[:, SCALE])
    S += heading_variance * outer(H[:, LEADER], H[:, LEADER]) + settings.range_sigma**2 * np.eye(t)
    if settings.transmitters == 2:
        S += np.diag((0.12 / np.maximum(received.ranges, 1.0) ** 2) ** 2)
    for j, i in enumerate(received.indices):
        for k, other in enumerate(received.indices):
            S[j, k] += directions[j] @ _way_errors(received, i, other) @ directions[k]
    return (
        residual,
        H,
        S + 0.5 * np.array([[np.trace(a @ b) for a in second_order] for b in second_order]),
    )


def update_with_ranges(
    settings: TightSettings, heading_variance: float, c: Component, received: Message
) -> int:
    """Update with the likeliest subset of the ranges, or with the differences of all; the count of
    numbers used.

    An echo common to all, of a length up to the span with a density of chance / span, leaves the
    differences. Those may be off by as much as a reflection would change them: it adds the same to
    the square of each range.
    """
    t = len(received.indices)
    about = About(0.0, heading_variance, np.zeros(2), np.zeros((2, 2)))
    residual, H, S = linearise(settings, heading_variance, c, received, about)
    direct, echo = (
        np.log(1.0 - settings.outlier_probability),
        np.log(settings.outlier_probability / settings.outlier_span),
    )
    span = max(settings.outlier_span, received.echo)
    cost_of_leaving_out = echo - np.where(residual < 0.0, 6.0, 0.0)
    subsets = [list(u) for size in range(t, -1, -1) for u in combinations(range(t), size)]
    # rows to multiply the ranges by, what residuals are corrected by, a further root of their
    # covariance, and what the hypothesis costs
    no_correction = np.zeros(t)
    explanations = [
        (
            np.eye(t)[u],
            no_correction,
            no_correction,
            len(u) * direct + np.delete(cost_of_leaving_out, u).sum(),
        )
        for u in subsets
    ]
    excess, mean = residual.mean(), received.ranges.mean()
    if t > 1 and 0.0 < excess < span:
        differences = np.column_stack([-np.ones(t - 1), np.eye(t - 1)])
        # of a reflection, whose way is so much longer than the direct one
        relative_excess = (received.ranges - mean) / max(mean - excess, 0.01)
        costs = np.log(settings.outlier_probability / span) + t * direct
        explanations.append((differences, no_correction, no_correction, costs))
        explanations.append(
            (differences, excess * relative_excess, np.sqrt(S.mean()) * relative_excess, costs)
        )

    def likelihood(explanation: tuple[Floats, Floats, Floats, float]) -> tuple[float, float]:
        A, correction, root, constant = explanation
        covariance = A @ (S + outer(root, root)) @ A.T
        density, squared = log_density(A @ (residual + correction), covariance)
        return density + constant, squared

    A, correction, root, _ = best = max(
        explanations, key=lambda explanation: likelihood(explanation)[0]
    )
    # of all its rows only those of differences sum to zero
    c.shared = bool(len(A)) and not A.sum(axis=1).any()
    (c.evidence, c.squared), c.excess, c.taken = likelihood(best), 0.0, len(A)
    c.normalised_innovation = (c.squared + 2.0 * (t - len(A)) * (direct - echo)) / t
    residual = residual + correction
    S += outer(root, root)
    relinearise = False
    if len(A) and not settings.assume.exact_leader:
        by_heading = A @ H[:, LEADER]
        by_residual = np.linalg.solve(A @ S @ A.T, by_heading)
        turn, variance = (
            heading_variance * (by_residual @ A @ residual),
            heading_variance - heading_variance**2 * (by_residual @ by_heading),
        )
        c.excess = turn**2 + variance - heading_variance
        if variance < 0.5 * heading_variance:
            relinearise, about.turn, about.variance = True, turn, variance
    nearest = min((A @ received.ranges).tolist(), default=np.inf)
    erring = settings.leader_position_sigma + settings.leader_position_walk > 0.0
    may_be_repeated = not (c.shared or erring or received.drift_time.any())
    if len(A) > 1 and may_be_repeated and nearest < 12.0 and clear_of_axis(settings, c, received):
        gain = np.linalg.solve(A @ S @ A.T, A @ H @ c.P).T[:2]
        relinearise, about.shift = True, gain @ A @ residual
        about.removed_covariance = gain @ A @ H @ c.P[:, :2]
    if relinearise:
        residual, H, S = linearise(settings, heading_variance, c, received, about)
        residual = residual + correction
        S += outer(root, root)
    if len(A):
        c.update(A @ residual, A @ H, A @ S @ A.T)
    return len(A)


def clear_of_axis(settings: TightSettings, c: Component, received: Message) -> bool:
    """Three standard deviations off the axis as broadcast, which only two transmitters have."""
    along = received.axis[1, :2] - received.axis[0, :2]
    across = np.array([-along[1], along[0]])
    lateral = across @ (c.x[:2] - received.position - received.axis[0, :2])
    return settings.transmitters > 2 or bool(lateral**2 > 9.0 * across @ c.P[:2, :2] @ across)


def _axis(c: Component, received: Message) -> tuple[Floats, Floats, Floats]:
    """From the rear to the front transmitter, as they seem to a follower that stood still since the
    rear ping arrived; where it was, and derivatives as of `beside`.
    """
    q, rows = from_leader(c, received)
    rear_way, front_way = vector(way(c, received, 0)), vector(way(c, received, 1))
    axis = rotation(c.x[LEADER]) @ (received.axis[1, :2] - received.axis[0, :2])
    return axis + front_way - rear_way, q - rear_way, rows


def lateral_offset(c: Component, received: Message) -> tuple[float, Floats]:
    """How far a component lies left of the leader's axis, and the derivatives of that."""
    axis, q, rows = _axis(c, received)
    axis = axis / np.linalg.norm(axis)
    off = q - rotation(c.x[LEADER]) @ received.axis[0, :2]
    row = np.array([-axis[1], axis[0], -axis @ q]) @ rows
    return float(axis[0] * off[1] - axis[1] * off[0]), row


def half_of(c: Component, received: Message, sign: float) -> Component:
    """The part of a component on one side of the axis, by the moments of a truncated normal
    variable.
    """
    lateral, row = lateral_offset(c, received)
    column = c.P @ row / np.sqrt(row @ c.P @ row)
    z = sign * lateral / np.sqrt(row @ c.P @ row)
    mass = ndtr(z)
    if mass < 1e-12:
        return replace(c, weight=0.0)
    mills_ratio = np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi) / mass
    P = c.P - mills_ratio * (mills_ratio + z) * outer(column, column)
    return replace(c, x=c.x + sign * mills_ratio * column, P=P, weight=c.weight * mass)


def split(settings: TightSettings, sides: list[Side], received: Message) -> None:
    """Split sides at the axis, where that is within 3.5 σ, and σ is more than 1 m or 0.2 of the
    `width` within which left and right are hard to tell.
    """
    for side in list(sides):
        top = heaviest(side)
        lateral, row = lateral_offset(top, received)
        axis, offset, _ = _axis(top, received)
        length = np.linalg.norm(axis)
        width = np.linalg.norm(offset) * np.sqrt(2.8 * settings.range_sigma / length)
        sigma = np.sqrt(row @ top.P @ row)
        if len(sides) < 16 and sigma > min(0.2 * width, 1.0) and abs(lateral) < 3.5 * sigma:
            sides.append([half_of(c, received, -1.0) for c in side])
            side[:] = [half_of(c, received, 1.0) for c in side]
