"""The tightly coupled navigator written a second time, from docs/tight.md: displacements are
complex numbers, the rest matrices.

It shares no code with `laisn.tight`, and is not written for speed: all `N` states are always there,
those that are switched off with a variance of 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from laisn.arrays import Floats
from laisn.messages import OwnMotion, Reception
from laisn.settings import TightSettings
from tests.laisn.tight.mixture import (
    BENT,
    CLOCK,
    COMPASS,
    EAST,
    LEADER,
    LOG,
    NEW,
    NORTH,
    POSITION,
    RATE,
    SCALE,
    SPEED,
    WALKED,
    Component,
    N,
    Side,
    chances,
    mix,
    moments,
    normalise,
    outer,
    prune_and_merge,
)
from tests.laisn.tight.ranges import (
    Message,
    Watch,
    lateral_offset,
    rotation,
    split,
    to_message,
    update_with_ranges,
    vector,
)


@dataclass
class Turn:
    """A turn since a heading that had been kept for 10 s, the `reference`: the largest angle from
    it, and the time since that was last exceeded.
    """

    reference: complex
    largest: float = 0.0
    since_largest: float = 0.0


@dataclass
class Oracle:
    """One follower. `step` is that of `TightNavigator`."""

    settings: TightSettings
    start: Floats | None
    sides: list[Side] = field(default_factory=list)
    used: int = 0

    def __post_init__(self) -> None:
        settings, assume = self.settings, self.settings.assume
        self.prior_variance = np.zeros(N)
        self.prior_variance[POSITION] = settings.start_sigma**2
        self.prior_variance[LOG], self.prior_variance[COMPASS] = (
            settings.speed_bias_sigma**2,
            settings.heading_bias_sigma**2,
        )
        self.prior_variance[SCALE] = settings.range_scale_bias_sigma**2
        self.prior_variance[LEADER] = (
            0.0 if assume.exact_leader else settings.leader_heading_bias_sigma**2
        )
        self.prior_variance[[EAST, NORTH]] = settings.current_sigma**2 if assume.current else 0.0
        self.prior_variance[8 : 7 + settings.transmitters] = (
            settings.offset_sigma**2 if assume.offsets else 0.0
        )
        if assume.clock:
            self.prior_variance[[CLOCK, RATE]] = (
                settings.clock_offset_sigma**2,
                settings.clock_drift_sigma**2,
            )
        self.prior_variance[NEW] = settings.leader_position_sigma**2
        self.position_variance = settings.leader_position_sigma**2
        self.watch = Watch()
        self.merge_distance = 2.0 if settings.leader_position_sigma else 1.0
        self.clock_walk = 3e-6 if assume.clock else 0.0
        self.max_heading_variance = self.heading_variance = (
            0.0 if assume.exact_leader else settings.leader_heading_sigma**2
        )
        # variances that biases gain in a second: 0.2 mm/s and 0.15 mrad, or drift, a quarter and
        # 2.5 times of it
        drift = np.array([0.25, 2.5]) if assume.drift else np.ones(1)
        rates = (2.5e-3, 1.7e-3) if assume.drift else (2e-4, 1.5e-4)
        self.speed_is_state = assume.steady_speed
        speeds = np.array([0.005, 0.2]) if self.speed_is_state else np.zeros(1)
        if self.speed_is_state:
            self.prior_variance[SPEED] = settings.speed_sigma**2 + settings.speed_bias_sigma**2
        self.n_modes = speeds.size, drift.size
        self.elapsed = self.since_mixing = 0.0
        current = 1e-3 if assume.current else 0.0
        leader = 0.0 if assume.exact_leader else 5e-5
        self.walk_rates = [
            {
                LOG: rates[0] * d,
                COMPASS: rates[1] * d,
                EAST: current,
                NORTH: current,
                LEADER: leader,
                SPEED: speed,
            }
            for speed in speeds
            for d in drift
        ]
        if self.start is not None:
            x = np.concatenate([self.start[:2], np.zeros(N - 2)])
            self.sides = [
                [
                    Component(
                        x.copy(), np.diag(self.prior_variance), 1 / len(self.walk_rates), mode
                    )
                    for mode in range(len(self.walk_rates))
                ]
            ]
        self.readings: list[tuple[float, complex, float]] = []
        self.trapezoids = np.zeros(2, dtype=complex)
        self.last_reading: tuple[float, complex] | None = None
        self.turns: dict[int, Turn] = {}
        self.leader_track: list[Message] = []
        self.leader_positions: list[complex] = []
        self.leg_headings: list[float] = []
        self.uses_mean_heading, self.other_heading_variance = False, self.heading_variance / 16.0
        self.past_legs: list[Floats] = []
        self.first_time = self.displacement_by_log = 0.0
        self.smoothed_nis, self.unused_messages, self.shared_echoes = 1.0, 0, 0

    @property
    def all(self) -> list[Component]:
        return [c for side in self.sides for c in side]

    def step(self, own: OwnMotion, reception: Reception | None, dt: float) -> None:
        direction = complex(np.sin(own.heading), np.cos(own.heading))
        first = self.last_reading is None
        if self.last_reading is None:
            self.last_reading = own.speed, direction
            self.turns[COMPASS] = Turn(direction)
        for speed, unit_vector in (self.last_reading, (own.speed, direction)):
            self.trapezoids = self.trapezoids + 0.5 * dt * unit_vector * np.array([speed, 1.0])
        self.readings.append((own.speed, direction, dt))
        self.watch.read(own, dt)
        self.last_reading = own.speed, direction
        self.elapsed += dt
        if self.speed_is_state:
            self.advance(first, dt)
        if reception is not None:
            self.receive(to_message(self.settings, own, reception, self.watch))

    def with_speed(self, P: Floats) -> Floats:
        """A covariance with that of a speed which is the last reading less b_v and its error."""
        P = P.copy()
        if self.speed_is_state:
            P[SPEED, LOG] = P[LOG, SPEED] = -self.prior_variance[LOG]
        return P

    def advance(self, first: bool, dt: float) -> None:
        """One step of components whose speed is a state: the log measures v + b_v."""
        assert self.last_reading is not None
        H = np.zeros((1, N))
        H[0, [SPEED, LOG]] = 1.0
        for c in self.all:
            if first:
                c.x[SPEED], c.P = self.last_reading[0], self.with_speed(c.P)
            predicted, _ = self.predicted(c, c.x[SPEED], c.x[COMPASS])
            c.x, c.P = predicted.x, predicted.P
            if not first:
                S = H @ c.P @ H.T + self.settings.speed_sigma**2
                residual = self.last_reading[0] - H @ c.x
                c.weight *= float(np.exp(-0.5 * residual @ residual / S[0, 0]) / np.sqrt(S[0, 0]))
                c.update(residual, H, S)
        self.reset_readings()
        if self.sides:
            normalise(self.sides)
        self.since_mixing += dt
        if self.since_mixing >= 1.0 - 1e-6:
            # 3 % change in a second
            rate = -0.5 * np.log(2.0 * 0.97 - 1.0)
            change = chances(self.n_modes[0], rate, self.since_mixing)
            for side in self.sides:
                mix(side, np.kron(change, np.eye(self.n_modes[1])))
            self.since_mixing = 0.0

    def displacement(self) -> tuple[complex, complex, Floats, float]:
        """A = Σ v u Δt, B = Σ u Δt, the covariance of A's random errors, and the time since the
        last message.
        """
        noise, time = np.zeros((2, 2)), 0.0
        for speed, direction, dt in self.readings:
            along, across = vector(direction), vector(1j * direction)
            if not self.speed_is_state:
                noise += (self.settings.speed_sigma * dt) ** 2 * outer(along, along)
            noise += (self.settings.heading_sigma * speed * dt) ** 2 * outer(across, across)
            time += dt
        return complex(self.trapezoids[0]), complex(self.trapezoids[1]), noise, time

    def predicted(self, c: Component, speed: float, compass: float) -> tuple[Component, Floats]:
        """A component after the way since the last message, linearised at some biases; and the
        derivatives F. `speed` is the log's bias, or the speed where that is a state.
        """
        speed_sum, direction_sum, noise, time = self.displacement()
        rotation_factor = np.exp(1j * compass)
        displacement = rotation_factor * (
            speed * direction_sum if self.speed_is_state else speed_sum - speed * direction_sum
        )
        speed_index = SPEED if self.speed_is_state else LOG
        F = np.eye(N)
        F[:2, speed_index], F[:2, COMPASS], F[0, EAST], F[1, NORTH] = (
            vector(
                rotation_factor * direction_sum
                if self.speed_is_state
                else -rotation_factor * direction_sum
            ),
            vector(1j * displacement),
            time,
            time,
        )
        F[CLOCK, RATE] = time
        if not self.speed_is_state:
            F[NEW] = 0.0
        x = F @ c.x
        x[:2] += vector(displacement) - F[:2, speed_index] * speed - F[:2, COMPASS] * compass
        Q = np.zeros((N, N))
        Q[:2, :2] = rotation(compass) @ noise @ rotation(
            compass
        ).T + self.settings.slip**2 * time * np.eye(2)
        if self.settings.leader_position_sigma and not self.speed_is_state:
            Q[NEW, NEW] = self.position_variance
        Q[WALKED, WALKED] = self.settings.leader_position_walk**2 * time
        Q[CLOCK : RATE + 1, CLOCK : RATE + 1] = self.clock_walk**2 * np.array(
            [[time**3 / 3, time**2 / 2], [time**2 / 2, time]]
        )
        for state, rate in self.walk_rates[c.mode].items():
            # a bias that wanders from 0, and its integral along a straight way
            bias, integral = np.eye(N)[state], np.concatenate([F[:2, state], np.zeros(N - 2)])
            cross = 0.5 * (outer(bias, integral) + outer(integral, bias))
            Q += rate**2 * time * (outer(bias, bias) + cross + outer(integral, integral) / 3.0)
        return replace(c, x=x, P=F @ c.P @ F.T + Q), F

    def now(self) -> tuple[Floats, Floats]:
        """Mean and covariance of x, y, vx, vy over the mixture."""
        if not self.sides or self.last_reading is None:
            return np.full(4, np.nan), np.full((4, 4), np.nan)
        parts = []
        for c in self.all:
            speed_index = SPEED if self.speed_is_state else LOG
            predicted, F = self.predicted(c, c.x[speed_index], c.x[COMPASS])
            direction = np.exp(1j * c.x[COMPASS]) * self.last_reading[1]
            speed = c.x[SPEED] if self.speed_is_state else self.last_reading[0] - c.x[LOG]
            velocity, rows = speed * direction, np.vstack([F[:2], np.zeros((2, N))])
            rows[2:, speed_index] = vector(direction if self.speed_is_state else -direction)
            rows[2:, COMPASS] = vector(1j * velocity)
            rows[2, EAST] = rows[3, NORTH] = 1.0
            spread = rows @ c.P @ rows.T
            spread[:2, :2] = predicted.P[:2, :2]
            ahead, across = vector(direction), vector(1j * direction)
            if not self.speed_is_state:
                spread[2:, 2:] += self.settings.speed_sigma**2 * outer(ahead, ahead)
            spread[2:, 2:] += (self.settings.heading_sigma * self.last_reading[0]) ** 2 * outer(
                across, across
            )
            mean = np.concatenate([predicted.x[:2], vector(velocity) + c.x[[EAST, NORTH]]])
            parts.append(Component(mean, spread, c.weight))
        return moments(parts)

    def receive(self, received: Message) -> None:  # noqa: C901, PLR0912 - the steps of the algorithm
        """Mix modes, inflate, predict, split, update, weigh, prune, reinitialise; then use the
        leader's track.
        """
        self.used = 0
        if not received.indices:
            return
        if not self.sides:
            if len(received.indices) > 1:
                if self.settings.leader_position_sigma:
                    self.prior_variance[NEW] = received.position_variance
                walked = self.settings.leader_position_walk**2 * self.watch.clock
                self.prior_variance[WALKED] = walked
                self.add_ring(received, 1.0)
                self.used = len(received.indices)
                for c in self.all:
                    c.taken, c.squared = self.used, np.nan
                self.end_message()
            return
        self.position_variance = received.position_variance
        for side in self.sides:
            change = chances(self.n_modes[1], 0.004, self.elapsed)
            mix(side, np.kron(np.eye(self.n_modes[0]), change))
        if not self.settings.assume.exact_leader:
            received = self.averaged_heading(received)
        if self.settings.assume.deviation:
            self.inflate(received)
        self.sides = [[self.predicted_for(c, received) for c in side] for side in self.sides]
        if {0, 1} <= set(received.indices):
            split(self.settings, self.sides, received)
        used = [
            update_with_ranges(self.settings, self.heading_variance, c, received) for c in self.all
        ]
        self.used = max(used)
        for c, n_used in zip(self.all, used, strict=True):
            c.P[:2, :2] += (n_used > 0) * received.ways.errors[received.ways.last]
        best = max(c.evidence for c in self.all)
        for c in self.all:
            c.weight *= float(np.exp(c.evidence - best))
        normalise(self.sides)
        if not self.settings.assume.exact_leader:
            variance = min(
                self.heading_variance + 0.1 * sum(c.weight * c.excess for c in self.all),
                self.scatter(),
            )
            self.heading_variance = min(
                max(variance, np.deg2rad(0.1) ** 2), self.max_heading_variance
            )
        prune_and_merge(self.sides, self.merge_distance)
        self.smoothed_nis += 0.15 * (
            sum(c.weight * c.normalised_innovation for c in self.all) - self.smoothed_nis
        )
        heaviest_side = max(self.sides, key=lambda side: sum(c.weight for c in side))
        shared = max(heaviest_side, key=lambda c: c.weight).shared
        self.shared_echoes = self.shared_echoes + 1 if shared else 0
        if (
            len(received.indices) > 1
            and self.smoothed_nis >= 3.0
            and not 0 < self.shared_echoes < 10
        ):
            self.smoothed_nis = 1.0
            self.add_ring(received, 0.002)
        self.unused_messages = 0 if self.used else self.unused_messages + 1
        for c in self.all if self.unused_messages >= 3 else []:
            c.P += np.diag([1.0, 1.0, 0.0, np.deg2rad(2.0) ** 2, *np.zeros(N - 4)])
        self.update_current(received)
        self.end_message()

    def end_message(self) -> None:
        self.reset_readings()
        self.elapsed = 0.0

    def reset_readings(self) -> None:
        self.readings, self.trapezoids = [], np.zeros(2, dtype=complex)
        self.watch.since_message = 0.0

    def averaged_heading(self, received: Message) -> Message:
        """A message with the mean heading of a straight leg, where three places of the leader lie
        on a line.

        `leg` holds what the leg's messages read, as if each were read at the leg's present
        direction. Ways of 0.3 m and more have a direction, a line bends by less than 5 mrad, and a
        reading that is four standard deviations off the mean belongs to no leg. The mean is used
        from four readings on, or once its variance is a tenth of that of b_L. The scatter of a
        reading is estimated from those of all legs.
        """
        self.leader_positions = [*self.leader_positions[-2:], complex(*received.position[::-1])]
        displacements, max_variance = (
            np.diff(self.leader_positions),
            self.settings.leader_heading_sigma**2,
        )
        moving = displacements.size == 2 and bool(np.all(abs(displacements) > 0.3))
        bend = float(np.angle(displacements[1] / displacements[0])) if moving else np.inf
        on_leg = abs(bend) < 0.005
        n_before = len(self.leg_headings)
        if on_leg:
            self.leg_headings = [reading + bend for reading in self.leg_headings]
            deviation = (
                np.angle(np.exp(1j * (received.heading - np.mean(self.leg_headings))))
                if n_before
                else 0.0
            )
            on_leg = bool(abs(deviation) <= 4.0 * np.sqrt(max_variance))
        if not on_leg:
            if self.uses_mean_heading:
                self.heading_variance, self.other_heading_variance = (
                    self.other_heading_variance,
                    self.heading_variance,
                )
                for c in self.all:
                    c.P[LEADER, LEADER] += self.scatter() / n_before
            self.past_legs.append(np.array(self.leg_headings))
            self.leg_headings, self.uses_mean_heading = [], False
            return received
        mean = float(np.mean(self.leg_headings)) if n_before else received.heading
        self.leg_headings.append(mean + float(np.angle(np.exp(1j * (received.heading - mean)))))
        prior_variance, max_variance = self.sides[0][0].P[LEADER, LEADER], self.scatter()
        if self.uses_mean_heading:
            for c in self.all:
                c.x[LEADER] += np.mean(self.leg_headings) - mean
                c.P[LEADER, LEADER] += (0.5 * bend) ** 2
        elif (
            len(self.leg_headings) >= 4
            or max_variance / len(self.leg_headings) < 0.1 * prior_variance
        ):
            self.heading_variance, self.other_heading_variance, self.uses_mean_heading = (
                self.other_heading_variance,
                self.heading_variance,
                True,
            )
            for c in self.all:
                c.P[LEADER, LEADER] += max_variance / len(self.leg_headings)
        if not self.uses_mean_heading:
            return received
        heading = float(np.mean(self.leg_headings))
        turn = rotation(received.heading - heading)

        def turned(arms: Floats) -> Floats:
            return np.column_stack([arms[:, :2] @ turn.T, arms[:, 2]])

        return replace(
            received, heading=heading, arms=turned(received.arms), axis=turned(received.axis)
        )

    def scatter(self) -> float:
        """Variance of readings about the means of their legs: of all so far, and one as large as
        in the settings.
        """
        legs = [np.array(leg) for leg in (*self.past_legs, self.leg_headings) if len(leg)]
        squares = sum(float(np.sum((leg - leg.mean()) ** 2)) for leg in legs)
        return min(
            self.max_heading_variance,
            (self.max_heading_variance + squares) / (1 + sum(leg.size - 1 for leg in legs)),
        )

    def inflate(self, received: Message) -> None:
        """A deviation of 3 % of the turn, where it is more than 0.1 rad, of the leader's 0.15
        rad.
        """
        assert self.last_reading is not None
        time = self.elapsed
        ahead = complex(np.sin(received.heading), np.cos(received.heading))
        leaders = [(LEADER, ahead, 0.15)] if self.prior_variance[LEADER] > 0.0 else []
        for state, direction, min_angle in [(COMPASS, self.last_reading[1], 0.1), *leaders]:
            turn = self.turns.setdefault(state, Turn(direction, since_largest=-time))
            largest_before, angle = turn.largest, abs(np.angle(direction / turn.reference))
            turn.since_largest += time
            if angle > max(largest_before, min_angle):
                turn.largest, turn.since_largest = angle, 0.0
            elif turn.since_largest >= 10.0 - 1e-6:
                self.turns[state] = Turn(direction)
            for c in self.all:
                c.P[state, state] += 0.03**2 * (turn.largest**2 - largest_before**2)

    def predicted_for(self, c: Component, received: Message) -> Component:
        """Linearised at the biases that the message suggests, where the way bends by more than 3
        mm.
        """
        if self.speed_is_state:
            if self.settings.leader_position_sigma:
                c.x[NEW], c.P[NEW], c.P[:, NEW] = 0.0, 0.0, 0.0
                c.P[NEW, NEW] = self.position_variance
            return c
        at_prior, _ = self.predicted(c, c.x[LOG], c.x[COMPASS])
        if 0.5 * c.P[COMPASS, COMPASS] * abs(self.displacement()[0]) < 0.003:
            return at_prior
        update_with_ranges(self.settings, self.heading_variance, at_prior, received)
        return self.predicted(c, at_prior.x[LOG], at_prior.x[COMPASS])[0]

    def add_ring(self, received: Message, share: float) -> None:
        """Hypotheses of this message alone: 96 Gaussians on a ring, those left of the axis and
        those right of it.

        The ring is 5 m wide, its Gaussians 0.6 of their distance; near the belief so far, to 10 m,
        they weigh more.
        """
        relative_mean, modes = (
            moments(self.all)[0][:2] - received.position if self.sides else None,
            len(self.walk_rates),
        )
        variance, self.heading_variance = self.heading_variance, 0.0
        at_origin = replace(received, position=np.zeros(2))
        centre = received.arms[np.argmin(received.ranges)]
        distance = np.sqrt(max(received.ranges.min() ** 2 - centre[2] ** 2, 1.0))
        ring: list[Component] = []
        for bearing in 2.0 * np.pi * (np.arange(96) + 0.5) / 96:
            radial = np.array([np.sin(bearing), np.cos(bearing)])
            tangential = np.array([radial[1], -radial[0]])
            P = self.with_speed(np.diag(self.prior_variance))
            P[LEADER, LEADER] = 0.0
            P[:2, :2] = 25.0 * outer(radial, radial) + (
                0.6 * 2 * np.pi / 96 * distance
            ) ** 2 * outer(tangential, tangential)
            x = np.concatenate([centre[:2] + distance * radial, np.zeros(N - 2)])
            x[SPEED] = self.last_reading[0] if self.speed_is_state and self.last_reading else 0.0
            c = Component(x, P, 1.0)
            update_with_ranges(self.settings, self.heading_variance, c, at_origin)
            if relative_mean is not None:
                c.evidence += np.log(
                    0.01 + np.exp(-0.5 * np.sum((c.x[:2] - relative_mean) ** 2) / 100.0)
                )
            ring.append(c)
        self.heading_variance = variance
        best = max(c.evidence for c in ring)
        for c in ring:
            c.weight = float(np.exp(c.evidence - best))
        total = sum(c.weight for c in ring)
        for c in self.all:
            c.weight *= 1.0 - share
        for is_left in (True, False):
            of_side = [c for c in ring if (lateral_offset(c, at_origin)[0] > 0.0) == is_left]
            weight = sum(c.weight for c in of_side)
            if weight > 0.0:
                x, P = moments(of_side)
                turn = np.zeros(N)
                turn[BENT] = -x[1], x[0], 1.0
                P += self.prior_variance[LEADER] * outer(turn, turn)
                P[:2, :2] += self.heading_variance * outer(turn[:2], turn[:2])
                x[:2] += received.position
                weight *= share / total / modes
                self.sides.append(
                    [Component(x.copy(), P.copy(), weight, mode) for mode in range(modes)]
                )
        prune_and_merge(self.sides, self.merge_distance)

    def update_current(self, received: Message) -> None:
        """The leader's way over ground less that of its log: the current, and what its compass
        turns the log's way by.

        Windows grow from 1 s to 10 s, and begin anew after a turn of more than 0.2 rad.
        """
        if self.settings.assume.exact_leader and not self.settings.assume.current:
            return
        if not self.leader_track:
            self.leader_track, self.first_time, self.displacement_by_log = (
                [received],
                received.time,
                0.0,
            )
            return
        first, last = self.leader_track[0], self.leader_track[-1]
        velocity = [
            h.speed * complex(np.sin(h.heading), np.cos(h.heading)) for h in (last, received)
        ]
        self.displacement_by_log += 0.5 * (received.time - last.time) * sum(velocity)
        window = received.time - first.time
        self.leader_track.append(received)
        if abs(np.angle(np.exp(1j * (received.heading - first.heading)))) > 0.2:
            self.leader_track, self.displacement_by_log = [received], 0.0
        elif window >= min(10.0, 1.0 + 0.2 * (received.time - self.first_time)) - 1e-6:
            logged = self.displacement_by_log / window
            current_observed = (received.position - first.position) / window - vector(logged)
            for c in self.all:
                by_heading = np.exp(1j * c.x[LEADER]) * logged
                H = np.zeros((2, N))
                H[:, [EAST, NORTH]], H[:, LEADER] = np.eye(2), vector(1j * by_heading)
                residual = current_observed - c.x[[EAST, NORTH]] - vector(by_heading - logged)
                variance = 0.05**2 * 10.0 / window + 2.0 * self.position_variance / window**2
                variance += self.settings.leader_position_walk**2 / window
                c.update(residual, H, H @ c.P @ H.T + variance * np.eye(2))
            self.leader_track, self.displacement_by_log = [received], 0.0
