"""Rival methods that filter: dead reckoning, Kalman updates, a geodetic adjustment.

State x = [x, y, b_v, b_θ, b_r, c_x, c_y]: position of the hydrophone [m], biases of log [m/s] and
compass [rad], mean of the error that the ranges share in proportion to their length [m at the
largest], and current [m/s], which is zero unless `assume.current`. The vehicle moves with the mean
velocity of both ends of a step, v = (s − b_v) [sin(θ − b_θ), cos(θ − b_θ)] + c, of log s and
compass θ (L. Paull, S. Saeedi, M. Seto, H. Li, AUV navigation and localization: a review, IEEE J.
Ocean. Eng. 39(1), 2014).
"""

import math
from typing import ClassVar

import numpy as np

from laisn.arrays import Floats, Four, Ints
from laisn.compiled import compiled
from laisn.delays import Delays, RecentWay, delays_of
from laisn.errors import LaisnError
from laisn.estimates import Estimates, FixKind, FixRecord
from laisn.geometry import place_transmitters, signed_angle
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Reception
from laisn.navigator import kalman_update
from laisn.navigators import OnlineNavigator, require_valid
from laisn.rivals.leader_track import CurrentMeasurement, LeaderTrack
from laisn.settings import COMPASS_WALK, CURRENT_WALK, LOG_WALK, TightSettings

STATES = 7
"""Number of states, in the order of x above."""


@compiled
def propagate(
    x: Floats,
    P: Floats,
    readings: Floats,
    durations: Floats,
    sigma: Four,
    out: tuple[Floats, Floats],
) -> Floats:
    """Filter steps without a message: x ← f(x), P ← F P Fᵀ + Q; x is changed in place, the new P is
    returned.

    `readings` are log [m/s] and compass [rad] before the first step and after each of n, shape (n +
    1, 2), `durations` of the steps [s]. `sigma` are random errors of log and compass, the random
    walk of the position that the log does not see [m/√s] and that of the current [m/s/√s]. `out`
    gets x, y, vx, vy after each step, shape (n, 4), and their covariance, shape (n, 4, 4).
    """
    states, covariances = out
    for k in range(durations.size):
        dt = durations[k]
        F = np.eye(STATES)
        Q = np.zeros((STATES, STATES))
        J = np.zeros((2, STATES))
        F[0, 5] = F[1, 6] = dt
        east = north = water_speed = 0.0
        for end in range(2):
            water_speed = readings[k + end, 0] - x[2]
            heading = readings[k + end, 1] - x[3]
            east, north = np.sin(heading), np.cos(heading)
            x[0] += 0.5 * dt * (water_speed * east + x[5])
            x[1] += 0.5 * dt * (water_speed * north + x[6])
            F[0, 2] -= 0.5 * dt * east
            F[1, 2] -= 0.5 * dt * north
            F[0, 3] -= 0.5 * dt * water_speed * north
            F[1, 3] += 0.5 * dt * water_speed * east
        # the velocity's derivatives by the states, and its random error: along by the log, across
        # by the compass
        J[0, 2] = -east
        J[0, 3] = -water_speed * north
        J[0, 5] = 1.0
        J[1, 2] = -north
        J[1, 3] = water_speed * east
        J[1, 6] = 1.0
        along_variance = sigma[0] ** 2
        across_variance = (sigma[1] * readings[k + 1, 0]) ** 2
        xx = along_variance * east * east + across_variance * north * north
        yy = along_variance * north * north + across_variance * east * east
        W = np.array(
            [
                [xx, (along_variance - across_variance) * east * north],
                [(along_variance - across_variance) * east * north, yy],
            ]
        )
        for i in range(2):
            for j in range(2):
                Q[i, j] = dt * dt * W[i, j]
            Q[i, i] += sigma[2] ** 2 * dt
        Q[2, 2] = LOG_WALK**2 * dt
        Q[3, 3] = COMPASS_WALK**2 * dt
        Q[5, 5] = Q[6, 6] = sigma[3] ** 2 * dt
        P = F @ P @ F.T + Q
        PJ = P @ J.T
        V = J @ PJ + W
        states[k, 0] = x[0]
        states[k, 1] = x[1]
        states[k, 2] = water_speed * east + x[5]
        states[k, 3] = water_speed * north + x[6]
        for i in range(2):
            for j in range(2):
                covariances[k, i, j] = P[i, j]
                covariances[k, i, 2 + j] = covariances[k, 2 + j, i] = PJ[i, j]
                covariances[k, 2 + i, 2 + j] = V[i, j]
    return P


class DeadReckoning(OnlineNavigator[Estimates]):
    """Takes no ranges at all; a subclass updates `x` and `P` in `_update`."""

    # whether readings since the last call of `_odometry` are kept for it
    KEEPS_READINGS: ClassVar[bool] = False
    # whether transmitters are moved by the way of the vehicle over the delays of pings, by the
    # estimated biases and current
    MOVES_TRANSMITTERS: ClassVar[bool] = True

    def __init__(self, settings: TightSettings, start: Floats) -> None:
        """Begin at a known state; LaisnError if the start is not four finite numbers."""
        super().__init__(settings, start, settings.start_sigma)
        biases = (
            settings.speed_bias_sigma,
            settings.heading_bias_sigma,
            settings.range_scale_bias_sigma,
        )
        current, walk = (
            (settings.current_sigma, CURRENT_WALK) if settings.assume.current else (0.0, 0.0)
        )
        self.x: Floats = np.concatenate([self._state[:2], np.zeros(STATES - 2)])
        self.P: Floats = np.diag(
            np.square([settings.start_sigma, settings.start_sigma, *biases, current, current])
        )
        # last reading of log [m/s] and compass [rad], shape (1, 2); (0, 2) before the first
        self._reading = np.empty((0, 2))
        # readings and durations as of `propagate`, of each call of `_advance`, if they are kept
        self._advances = list[tuple[Floats, Floats]]()
        self._track = LeaderTrack()
        # the state is a place in the frame of the broadcast positions, so it walks with the
        # leader's error too
        slip = math.hypot(settings.slip, settings.leader_position_walk)
        self._noise = settings.speed_sigma, settings.heading_sigma, slip, walk
        self._recent = RecentWay(*self._noise[:3])
        self._delays = Delays(np.zeros(3), np.zeros(3))
        # of the same pings
        self._ways = self._recent.since(self._delays.lag)

    @property
    def biases(self) -> tuple[float, float]:
        """Estimated biases of log [m/s] and compass [rad]."""
        return float(self.x[2]), float(self.x[3])

    def _navigate(self, own: OwnMotion, reception: Reception | None, dt: float) -> list[FixRecord]:
        self._advance(np.array([[own.speed, own.heading]]), np.array([dt]))
        fixes = [] if reception is None else [self._receive(own, reception)]
        for received in own.receptions.values():
            self._receive_further(own, received)
        return fixes

    def _receive_further(self, own: OwnMotion, reception: Reception) -> None:
        """Update with a message of a further link; methods that take one link's leave it."""

    def run(self, measurements: Measurements) -> Estimates:
        """As `OnlineNavigator.run`; all steps between two messages are one call."""
        if measurements.links:
            return super().run(measurements)
        measurements.require_fresh(self._step, self.settings.dt)
        n = measurements.speed.size
        readings = np.column_stack([measurements.speed, measurements.heading])
        broken = np.flatnonzero(~np.isfinite(readings).all(axis=1) | np.isinf(measurements.depth))
        if broken.size:
            raise LaisnError(f"step {broken[0] + 1}: log, compass or depth are not finite")
        durations = (
            np.full(n, measurements.dt)
            if measurements.durations is None
            else measurements.durations
        )
        states = np.empty((n, 4))
        covariances = np.empty((n, 4, 4))
        fixes = []
        depth = measurements.last_depth
        for i, end in enumerate([*measurements.message_step.tolist(), n]):
            steps = slice(self._step, end)
            states[steps], covariances[steps] = self._advance(readings[steps], durations[steps])
            self._step = end
            if i < measurements.message_step.size:
                speed, heading = readings[end - 1].tolist()
                own = OwnMotion(speed, heading, float(depth[end - 1]))
                reception = measurements.reception(i)
                require_valid(end, own, reception, None)
                fixes.append(self._receive(own, reception))
                states[end - 1] = self._state
                covariances[end - 1] = self._covariance
        return Estimates.of(states, covariances, fixes)

    def _advance(self, readings: Floats, durations: Floats) -> tuple[Floats, Floats]:
        """Bring the estimate forward by n steps, with the log [m/s] and compass [rad] after each,
        shape (n, 2); states and covariances after each.
        """
        n = durations.size
        states = np.empty((n, 4))
        covariances = np.empty((n, 4, 4))
        self._recent.advance(readings, durations)
        if n:
            last_reading = self._reading if self._reading.size else readings[:1]
            steps = np.vstack([last_reading, readings])
            self.P = propagate(self.x, self.P, steps, durations, self._noise, (states, covariances))
            if self.KEEPS_READINGS and durations.any():
                self._advances.append((steps, durations))
            self._reading = readings[-1:]
            self._state = states[-1]
            self._covariance = covariances[-1]
        return states, covariances

    def _receive(
        self, own: OwnMotion, reception: Reception, *, sends_as_leader: bool = True
    ) -> FixRecord:
        """Update with a message; the fix is the estimate after it. `sends_as_leader`: the sender is
        the leader, whose way shows the current too.
        """
        places = place_transmitters(reception, self.settings)
        transmitters = places - (0.0, 0.0, own.depth - self.settings.hydrophone_height)
        if self.settings.compensate_motion:
            self._delays = delays_of(
                reception.message, reception.ranges, self._recent.clock, self.settings
            )
            self._ways = self._recent.since(self._delays.lag)
            if self.MOVES_TRANSMITTERS:
                # as if each ping had left so much farther on, and had been received here and now
                drift = np.outer(self._delays.drift_time, self.x[5:7])
                transmitters[:, :2] += self._ways.less_biases(*self.biases) + drift
        ranges = np.where(np.isfinite(transmitters).all(axis=1), reception.ranges, np.nan)
        ranges[self.settings.transmitters :] = np.nan
        used = bool(np.isfinite(ranges).any()) and self._update(
            transmitters, ranges, own, reception
        )
        current = self._track.receive(reception.message) if sends_as_leader else None
        if current is not None and self.settings.assume.current:
            self._update_current(current)
        if used:
            received = np.flatnonzero(np.isfinite(ranges))
            self.P[:2, :2] += self._ways.covariance_since_last(received)
            self._recent.last_message = self._recent.clock
            # velocity by the new biases; no time passes
            self._advance(self._reading, np.zeros(1))
        return self._fix_at_estimate(FixKind.RANGES if used else FixKind.LOST)

    def _fill_delay_terms(self, H: Floats, directions: Floats, received: Ints) -> Floats:
        """Fill in the derivatives of r ranges by biases and current over the delays; returns the
        covariance of what errs until the last ping arrived, shape (r, r), [m²].

        `H` are the rows of these ranges, shape (r, 7), `directions` their derivatives by the place,
        shape (r, 2), `received` the indices of their transmitters, shape (r,).
        """
        ways = self._ways.less_biases(*self.biases)[received]
        by_log = self._ways.by_log(self.biases[1])[received]
        H[:, 2] = -(directions * by_log).sum(axis=1)
        H[:, 3] = directions[:, 0] * ways[:, 1] - directions[:, 1] * ways[:, 0]
        if self.settings.assume.current:
            H[:, 5:7] = -self._delays.drift_time[received, None] * directions
        between = self._ways.covariance_before_last(received)
        return np.asarray(np.einsum("ik,ijkl,jl->ij", directions, between, directions))

    def _leader_position_variance(self, reception: Reception) -> float:
        """As the function of this name, by the navigator's settings."""
        return leader_position_variance(self.settings, reception.message)

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        """Update `x` and `P` with the readings and the message of this step; whether the ranges
        were used.

        `transmitters` are their positions: east, north, depth below the hydrophone, shape (3, 3),
        [m]; some ranges are NaN.
        """
        return False

    def _update_current(self, measurement: CurrentMeasurement) -> None:
        """Update the current with what the leader's way shows of it."""
        H = np.zeros((2, STATES))
        H[:, 5:] = np.eye(2)
        noise = measurement.variance * np.eye(2)
        self.x, self.P = kalman_update(self.x, self.P, H, measurement.current - self.x[5:], noise)

    def _odometry(self) -> tuple[Floats, Floats, Floats, float]:
        """Odometry since the last call by the compass as it reads: Σ s u Δt [m], Σ u Δt [s],
        covariance of the former [m²], time [s].
        """
        advances = self._advances
        settings = self.settings
        speed, heading = np.vstack([advances[0][0][:1], *(steps[1:] for steps, _ in advances)]).T
        durations = np.concatenate([times for _, times in advances])
        u = np.column_stack([np.sin(heading), np.cos(heading)])
        dt = durations[:, None]
        v = speed[:, None] * u
        longitudinal = settings.speed_sigma * dt * u[1:]
        # velocity turned by 90°
        across = settings.heading_sigma * dt * v[1:, ::-1] * (-1.0, 1.0)
        noise = [
            longitudinal[:, i] * longitudinal[:, j] + across[:, i] * across[:, j]
            for i, j in ((0, 0), (0, 1), (1, 1))
        ]
        noise = [
            noise[0] + settings.slip**2 * durations,
            noise[1],
            noise[2] + settings.slip**2 * durations,
        ]
        terms = np.column_stack(
            [0.5 * dt * (v[:-1] + v[1:]), 0.5 * dt * (u[:-1] + u[1:]), *noise, dt]
        )
        # one after another: the same to the bit in one call of `_advance` and in many
        *sums, xx, xy, yy, time = np.cumsum(terms, axis=0)[-1].tolist()
        self._advances = []
        return (
            np.array(sums[:2]),
            np.array(sums[2:]),
            np.array([[xx, xy], [xy, yy]]) + 1e-12 * np.eye(2),
            time,
        )


def single_transmitter(ranges: Floats) -> int:
    """The transmitter of methods that use one: the middle one, or the rear where that is not
    received.
    """
    return 0 if np.isnan(ranges[2]) else 2


def slant(x: Floats, transmitter: Floats) -> tuple[float, Floats]:
    """Slant range [m], and the horizontal part of the unit vector from a transmitter to the state's
    position, shape (2,).
    """
    separation = x[:2] - transmitter[:2]
    rho = math.sqrt(float(separation @ separation) + float(transmitter[2]) ** 2)
    return rho, separation / rho


def leader_position_variance(settings: TightSettings, message: LeaderMessage) -> float:
    """Variance of the error of the broadcast position that is independent from message to message,
    along each axis [m²].
    """
    sigma = message.position_sigma
    return float((settings.leader_position_sigma if math.isnan(sigma) else sigma) ** 2)


def range_measurement(
    settings: TightSettings, x: Floats, transmitters: Floats, ranges: Floats
) -> tuple[Floats, Floats, Floats]:
    """H, shape (r, n), innovation, shape (r,), and R of the r ranges that are not NaN, for a state
    of n numbers that begins with [x, y, b_v, b_θ, b_r]; `transmitters` as of
    `DeadReckoning._update`.
    """
    received = np.flatnonzero(np.isfinite(ranges))
    z = ranges[received]
    separation = np.column_stack([x[:2] - transmitters[received, :2], transmitters[received, 2]])
    rho = np.linalg.norm(separation, axis=1)
    share = rho / z.max()
    H = np.zeros((z.size, x.size))
    H[:, :2] = separation[:, :2] / rho[:, None]
    H[:, 4] = share
    common = settings.range_scale_sigma**2 * np.outer(share, share)
    R = settings.range_sigma**2 * np.eye(z.size) + common
    return H, z - rho - share * x[4], R


class RangeFilter(DeadReckoning):
    """Extended Kalman filter on the ranges of a message, one measurement, without a test for
    echoes.

    h_i = ρ_i (1 + b_r / max z); R = σ² I + σ_s² s sᵀ + σ_L² u uᵀ with s_i = ρ_i / max z and rows
    u_i of the directions from the transmitters (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation
    with Applications to Tracking and Navigation, 2001, section 10.3). Where pings arrived at other
    times, errors of the way since then are as of `laisn.delays.Ways`.
    """

    def _receive_further(self, own: OwnMotion, reception: Reception) -> None:
        self._receive(own, reception, sends_as_leader=False)

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        H, innovation, R = range_measurement(self.settings, self.x, transmitters, ranges)
        directions = H[:, :2].copy()
        R += self._leader_position_variance(reception) * directions @ directions.T
        if self.settings.compensate_motion:
            received = np.flatnonzero(np.isfinite(ranges))
            R += self._fill_delay_terms(H, directions, received)
        self.x, self.P = kalman_update(self.x, self.P, H, innovation, R)
        return True


class OneWayTravelTime(RangeFilter):
    """The same filter on the range to one transmitter, from the one-way travel time of its ping.

    What the leader broadcasts of itself counts as exact (R. M. Eustice, H. Singh, L. L. Whitcomb,
    J. Field Robotics 28(1), 2011; S. E. Webster et al., Int. J. Robotics Research 31(8), 2012: its
    client without the server's states).
    """

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        single_range = ranges.copy()
        single_range[np.arange(3) != single_transmitter(ranges)] = np.nan
        return bool(np.isfinite(single_range).any()) and super()._update(
            transmitters, single_range, own, reception
        )


class GeodeticAdjustment(DeadReckoning):
    """Dead reckoning since the last message and one range, adjusted by weighted least squares.

    δ = (Aᵀ W A)⁻¹ Aᵀ W l with A = [I; uᵀ] of the direction u from the leader and W = diag(C⁻¹,
    1/σ²), repeated at the adjusted position until it rests; its covariance is (Aᵀ W A)⁻¹. C is what
    course and speed give dead reckoning; constant errors are no unknowns (K. Naus, P. Piskur,
    Applying the geodetic adjustment method for positioning in relation to the swarm leader of
    underwater vehicles based on course, speed, and distance measurements, Energies 15, 8472, 2022).
    """

    def __init__(self, settings: TightSettings, start: Floats) -> None:
        """As of `DeadReckoning`, with mean errors of course, speed and current in place of
        estimated states.
        """
        super().__init__(settings, start)
        self._bias_covariance = self.P[2:, 2:].copy()

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        i = single_transmitter(ranges)
        if math.isnan(ranges[i]):
            return False
        transmitter = transmitters[i]
        z = float(ranges[i])
        dead_reckoned = self.x[:2].copy()
        weight = np.linalg.inv(self.P[:2, :2])
        sigma = math.hypot(self.settings.range_sigma, self.settings.range_scale_sigma)
        sigma = math.hypot(sigma, self.settings.range_scale_bias_sigma)
        sigma = math.sqrt(sigma**2 + self._leader_position_variance(reception))
        for _ in range(10):
            rho, direction = slant(self.x, transmitter)
            normal = weight + np.outer(direction, direction) / sigma**2
            change = np.linalg.solve(
                normal, weight @ (dead_reckoned - self.x[:2]) + direction * (z - rho) / sigma**2
            )
            self.x[:2] += change
            if np.abs(change).max() < 1e-6:
                break
        # mean errors of course and speed act again until the next message
        self.P = np.zeros((STATES, STATES))
        self.P[:2, :2] = np.linalg.inv(normal)
        self.P[2:, 2:] = self._bias_covariance
        return True


# key of [azimuth, elevation] in Reception.custom, from the sensor "inverted-usbl"
_BEARING_READING = "bearing"


class InvertedUsbl(DeadReckoning):
    """Extended Kalman filter on range, azimuth and elevation of one ping in the follower's own
    frame.

    az = atan2(Δe, Δn) − (θ − b_θ) and el = atan(Δz / D) of the vector from hydrophone to
    transmitter; of the front transmitter, as the sensor measures it. An azimuth has the random
    error of the compass beside its own (M. Morgado, P. Oliveira, C. Silvestre, J. F. Vasconcelos,
    Embedded vehicle dynamics aiding for USBL/INS underwater navigation, IEEE Trans. Control Syst.
    Technol. 22(1), 2014). The sensor reads at the step of the message: where the ping arrived
    before, the range alone is of that time.
    """

    def _update(
        self, transmitters: Floats, ranges: Floats, own: OwnMotion, reception: Reception
    ) -> bool:
        settings = self.settings
        reading = reception.custom.get(_BEARING_READING)
        if reading is None or np.shape(reading) != (2,):
            raise LaisnError(
                f"step {self._step}: the message has no azimuth and elevation of an inverted USBL; "
                'flights with sensors.custom = [{ sensor = "inverted-usbl" }] measure them'
            )
        azimuth, elevation = map(float, reading)
        transmitter = transmitters[1]
        z = ranges[1]
        if not np.isfinite([azimuth, elevation, z]).all():
            return False
        rho, direction = slant(self.x, transmitter)
        # `transmitter` has moved with the follower since the ping arrived: its source has not
        lag = float(self._delays.lag[1])
        source = transmitter.copy()
        source[:2] -= self._ways.less_biases(*self.biases)[1] + lag * self.x[5:7]
        source_distance, _ = slant(self.x, source)
        east, north = source[:2] - self.x[:2]
        horizontal_distance = math.hypot(east, north)
        up = -float(transmitter[2])
        H = np.zeros((3, STATES))
        H[0, :2] = direction
        H[0, 4] = 1.0
        self._fill_delay_terms(H[:1], H[:1, :2], np.array([1]))
        H[1, :2] = (-north / horizontal_distance**2, east / horizontal_distance**2)
        H[1, 3] = 1.0
        H[2, :2] = up / source_distance**2 * np.array([east, north]) / horizontal_distance
        expected = math.atan2(east, north) - own.heading + self.x[3]
        innovation = [
            z - rho - self.x[4],
            signed_angle(azimuth - expected),
            elevation - math.atan2(up, horizontal_distance),
        ]
        R = np.diag(
            [
                settings.range_sigma**2 + settings.range_scale_sigma**2,
                settings.azimuth_sigma**2 + settings.heading_sigma**2,
                settings.elevation_sigma**2,
            ]
        )
        R += self._leader_position_variance(reception) * H[:, :2] @ H[:, :2].T
        self.x, self.P = kalman_update(self.x, self.P, H, np.array(innovation), R)
        return True
