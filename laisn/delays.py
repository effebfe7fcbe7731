"""When the pings of a message left and arrived, and what both vehicles moved meanwhile.

Rear, front and middle ping leave one after the other, a slot apart, and a message is used when all
are in, or later. A range is the distance of the places at these times.
"""

import math
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from laisn.messages import LeaderMessage, Ranges
from laisn.settings import Settings

LONGEST_DELAY = 20.0
"""Of a message that seems to have been longer under way the sender's clock is another one [s].

A message of 10 s with pings 2 s apart takes 14 s beside the way of its sound."""
NEGLIGIBLE_DELAY = 1e-3
"""An arrival within this time is now [s]."""
_MOST_WAITING = 1000  # calls of which readings wait until they are summed up
MEAN_SPEED_TIME = 3.0
"""The speed from ping to ping is the log's mean over this time [s]."""
MEAN_SPEED_SIGMA = 0.03
"""Random error of that speed, of what the vehicle accelerates [m/s]."""


class Delays(NamedTuple):
    """Of the pings from the rear, front and middle transmitter, shape (3,) each."""

    lag: Floats  # how long ago each arrived [s]; NaN where nothing was received
    # time since the message's timestamp without the ping's travel [s]: for so long a current has
    # carried leader and follower alike
    drift_time: Floats


def delays_of(message: LeaderMessage, ranges: Ranges, clock: float, settings: Settings) -> Delays:
    """Delays at a time `clock` since the start [s], by the timestamp of the message on the same
    clock.

    If the timestamp is 0, which states none, or cannot be on that clock, the last ping counts as
    arriving now.
    """
    emission_delays = settings.ping_slot * np.arange(3)
    travel_times = settings.sound_slowness * np.array(ranges)
    last = float(np.nanmax(emission_delays + travel_times, initial=0.0))
    elapsed = clock - message.timestamp
    if message.timestamp == 0.0 or not last <= elapsed <= LONGEST_DELAY:
        elapsed = last
    return Delays(
        np.maximum(elapsed - emission_delays - travel_times, 0.0),
        np.maximum(elapsed - travel_times, 0.0),
    )


def leader_way(message: LeaderMessage, settings: Settings) -> Floats:
    """East and north from the message's place to where each ping leaves, shape (3, 2), [m]."""
    direction = np.array([math.sin(message.heading), math.cos(message.heading)])
    slots = settings.ping_slot * np.arange(3)
    return np.asarray(message.speed * slots[:, None] * direction)


class Ways(NamedTuple):
    """What a vehicle has gone since each of three pings arrived, by log and compass as they read.

    Less their biases b_v and b_θ it is Rot(b_θ) (A − b_v B), with Rot anticlockwise.

    A range is of the place at the ping's arrival, and what dead reckoning errs from there on is
    independent of it. Filters take ranges as if of the place now, by the way, and then add the
    covariance of that error to that of the place; of pings that arrived before the last one the
    further way is an error of the range. That the place before the update holds some of it, too,
    is on the safe side.
    """

    logged: Floats  # A = Σ v u Δt, east and north, shape (3, 2), [m]
    per_speed: Floats  # B = Σ u Δt, what that gains for 1 m/s more, shape (3, 2), [s]
    # of errors that add up step by step, shape (3, 2, 2), [m²]
    covariance: Floats
    # of the way until the last ping arrived, at a mean speed: what it errs for one σ of that, shape
    # (3, 2), [m]
    by_mean_speed: Floats

    def less_biases(self, log_bias: float, compass_bias: float) -> Floats:
        """The ways through the water, shape (3, 2), [m], by biases [m/s], [rad]."""
        return _rotated(self.logged - log_bias * self.per_speed, compass_bias)

    def by_log(self, compass_bias: float) -> Floats:
        """Their derivatives by the bias of the log, shape (3, 2), [s]."""
        return -_rotated(self.per_speed, compass_bias)

    def covariance_since_last(self, received: Ints) -> Floats:
        """That of the errors since the last of the r received pings arrived, shape (2, 2), [m²]."""
        size = np.trace(self.covariance[received], axis1=1, axis2=2)
        return np.asarray(self.covariance[received[size.argmin()]])

    def covariance_of_pairs(self, received: Ints) -> Floats:
        """That of the errors since each two of the r received pings arrived, shape (r, r, 2, 2),
        [m²]: those that add up are common from the later one on.
        """
        covariance = self.covariance[received]
        size = np.trace(covariance, axis1=1, axis2=2)
        is_first_later = np.less.outer(size, size)[:, :, None, None]
        later = np.where(is_first_later, covariance[:, None], covariance[None])
        slope = self.by_mean_speed[received]
        return np.asarray(later + slope[:, None, :, None] * slope[None, :, None, :])

    def covariance_before_last(self, received: Ints) -> Floats:
        """The same of the errors until the last of all pings arrived, shape (r, r, 2, 2), [m²]."""
        return self.covariance_of_pairs(received) - self.covariance_since_last(received)


@compiled
def mean_window(
    time: float, last_arrival: float, last_message: float, clock: float
) -> tuple[float, float]:
    """Begin and end of the readings of which the speed from one ping to the last, which arrived so
    much later, is the mean: around that time, and of no message before, so that the errors of
    messages are independent; all times [s]. Shorter than `time`: there is none.
    """
    end = min(clock, last_arrival + 0.5 * max(MEAN_SPEED_TIME - time, 0.0))
    return max(end - MEAN_SPEED_TIME, last_message), end


def _rotated(vectors: Floats, angle: float) -> Floats:
    """East and north, shape (n, 2), turned anticlockwise by an angle [rad]."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return np.asarray(vectors @ np.array([[cosine, sine], [-sine, cosine]]))


class RecentWay:
    """Readings of log and compass, summed up over the last `LONGEST_DELAY`, and the time since the
    start.
    """

    def __init__(self, speed_sigma: float = 0.0, heading_sigma: float = 0.0, slip: float = 0.0):
        """Begin at rest; random errors of the readings [m/s], [rad], and the walk of the place that
        they do not see [m/√s].
        """
        self.last_message = 0.0  # time of the last message that was used, which the caller sets [s]
        self._variances = speed_sigma**2, heading_sigma**2, slip**2
        self._dt = 0.0
        # at the start and after each step the time, A, B, Σ v Δt, and xx, xy, yy of the covariance
        self._sums = np.zeros((1, 9))
        self._reading = np.empty((0, 2))  # the last one of log and compass; none before the first
        self._waiting = list[tuple[Floats, Floats]]()  # readings and durations, not yet summed up

    @property
    def clock(self) -> float:
        """Time since the start [s]."""
        self._sum_up()
        return float(self._sums[-1, 0])

    def advance(self, readings: Floats, durations: Floats) -> None:
        """Take the readings of log [m/s] and compass [rad] at the ends of n steps, shape (n, 2),
        and how long each took, shape (n,), [s].
        """
        self._waiting.append((readings, durations))
        if len(self._waiting) >= _MOST_WAITING:
            self._sum_up()

    def _sum_up(self) -> None:
        """Add the readings that wait to the sums."""
        readings, durations = (
            np.concatenate([np.empty((0, 2)), *(readings for readings, _ in self._waiting)]),
            np.concatenate([np.empty(0), *(durations for _, durations in self._waiting)]),
        )
        self._waiting.clear()
        takes_time = durations > 0.0
        readings, dt = readings[takes_time], durations[takes_time]
        if not dt.size:
            return
        last_reading = self._reading if self._reading.size else readings[:1]
        speed, heading = np.vstack([last_reading, readings]).T
        self._reading = readings[-1:].copy()
        self._dt = float(dt[-1])
        east, north = np.sin(heading), np.cos(heading)
        velocity = np.column_stack([speed * east, speed * north, east, north, speed])
        speed, east, north = speed[1:], east[1:], north[1:]
        speed_variance, heading_variance, slip_rate = self._variances
        along = speed_variance * dt * dt
        across = heading_variance * speed * speed * dt * dt
        slip = slip_rate * dt
        steps = np.column_stack(
            [
                dt,
                0.5 * dt[:, None] * (velocity[:-1] + velocity[1:]),
                along * east * east + across * north * north + slip,
                (along - across) * east * north,
                along * north * north + across * east * east + slip,
            ]
        )
        # one after another: the same to the bit in one call and in many
        sums = np.cumsum(np.vstack([self._sums[-1:], steps]), axis=0)
        oldest = sums[-1, 0] - LONGEST_DELAY
        first = int(np.searchsorted(self._sums[:, 0], oldest, side="right")) - 1
        self._sums = np.vstack([self._sums[max(first, 0) :], sums[1:]])

    def since(self, lag: Floats) -> Ways:
        """The way since so long ago [s], shape (3,); NaN counts as now, what was before the start
        as at rest.

        From ping to ping, where a difference of ranges of centimetres is a direction, the speed is
        a mean.
        """
        self._sum_up()
        sums = self._sums
        clock = float(sums[-1, 0])
        arrival = sums[-1, 0] - np.nan_to_num(lag)
        way = np.column_stack(
            [column[-1] - np.interp(arrival, sums[:, 0], column) for column in sums.T[1:]]
        )
        logged, per_speed = way[:, :2], way[:, 2:4]
        covariance = way[:, [5, 6, 6, 7]].reshape(3, 2, 2)
        by_mean_speed = np.zeros((3, 2))
        speed_variance, heading_variance, slip_rate = self._variances
        received = np.flatnonzero(np.isfinite(lag))
        for i in received:
            last = received[lag[received].argmin()]
            time = float(lag[i] - lag[last])
            begin, end = mean_window(time, clock - float(lag[last]), self.last_message, clock)
            if time <= 0.0 or end - begin < time:
                continue
            path = np.interp([begin, end], sums[:, 0], sums[:, 5])
            speed = (path[1] - path[0]) / (end - begin)
            between = per_speed[i] - per_speed[last]
            logged[i] = logged[last] + speed * between
            sigma = math.sqrt(speed_variance * self._dt / (end - begin) + MEAN_SPEED_SIGMA**2)
            by_mean_speed[i] = sigma * between
            aside = np.array([-between[1], between[0]]) / time
            across = heading_variance * speed**2 * self._dt * np.outer(aside, aside)
            covariance[i] = covariance[last] + time * (across + slip_rate * np.eye(2))
        return Ways(logged, per_speed, covariance, by_mean_speed)
