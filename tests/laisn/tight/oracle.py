"""The tightly coupled navigator written a second time, from docs/tight.md: ways are complex
numbers, the rest matrices.

It shares no code with `laisn.tight`, and is in no hurry: all thirteen states are always there,
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
    PLACE,
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
    aside,
    pair,
    rotation,
    split,
    to_message,
    update_with_ranges,
)


@dataclass
class Turn:
    """A turn since a heading that had been kept for 10 s: the largest angle from it, and when it
    was last exceeded.
    """

    begin: complex
    largest: float = 0.0
    still: float = 0.0


@dataclass
class Oracle:
    """One follower. `step` is that of `TightNavigator`."""

    settings: TightSettings
    start: Floats | None
    sides: list[Side] = field(default_factory=list)
    used: int = 0

    def __post_init__(self) -> None:
        settings, assume = self.settings, self.settings.assume
        self.fresh = np.zeros(N)
        self.fresh[PLACE] = settings.start_sigma**2
        self.fresh[LOG], self.fresh[COMPASS] = (
            settings.speed_bias_sigma**2,
            settings.heading_bias_sigma**2,
        )
        self.fresh[SCALE] = settings.range_scale_bias_sigma**2
        self.fresh[LEADER] = 0.0 if assume.exact_leader else settings.leader_heading_bias_sigma**2
        self.fresh[[EAST, NORTH]] = settings.current_sigma**2 if assume.current else 0.0
        self.fresh[8 : 7 + settings.transmitters] = (
            settings.offset_sigma**2 if assume.offsets else 0.0
        )
        if assume.clock:
            self.fresh[[CLOCK, RATE]] = (
                settings.clock_offset_sigma**2,
                settings.clock_drift_sigma**2,
            )
        self.fresh[NEW] = settings.leader_position_sigma**2
        self.new_variance = settings.leader_position_sigma**2
        self.watch = Watch()
        self.near = 2.0 if settings.leader_position_sigma else 1.0
        self.clock_walk = 3e-6 if assume.clock else 0.0
        self.most = self.v = 0.0 if assume.exact_leader else settings.leader_heading_sigma**2
        # variances that biases gain in a second: 0.2 mm/s and 0.15 mrad, or drift, a quarter and
        # 2.5 times of it
        drift = np.array([0.25, 2.5]) if assume.drift else np.ones(1)
        rates = (2.5e-3, 1.7e-3) if assume.drift else (2e-4, 1.5e-4)
        self.by_speed = assume.steady_speed
        speeds = np.array([0.005, 0.2]) if self.by_speed else np.zeros(1)
        if self.by_speed:
            self.fresh[SPEED] = settings.speed_sigma**2 + settings.speed_bias_sigma**2
        self.counts = speeds.size, drift.size
        self.elapsed = self.unmixed = 0.0
        current = 1e-3 if assume.current else 0.0
        leader = 0.0 if assume.exact_leader else 5e-5
        self.walks = [
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
                    Component(x.copy(), np.diag(self.fresh), 1 / len(self.walks), mode)
                    for mode in range(len(self.walks))
                ]
            ]
        self.readings: list[tuple[float, complex, float]] = []
        self.trapezoids = np.zeros(2, dtype=complex)
        self.last: tuple[float, complex] | None = None
        self.turns: dict[int, Turn] = {}
        self.leader: list[Message] = []
        self.places: list[complex] = []
        self.leg: list[float] = []
        self.steady, self.other_v = False, self.v / 16.0
        self.past_legs: list[Floats] = []
        self.first_time = self.logged = 0.0
        self.smoothed, self.silent, self.echoes = 1.0, 0, 0

    @property
    def all(self) -> list[Component]:
        return [c for side in self.sides for c in side]

    def step(self, own: OwnMotion, reception: Reception | None, dt: float) -> None:
        direction = complex(np.sin(own.heading), np.cos(own.heading))
        first = self.last is None
        if self.last is None:
            self.last = own.speed, direction
            self.turns[COMPASS] = Turn(direction)
        for speed, towards in (self.last, (own.speed, direction)):
            self.trapezoids = self.trapezoids + 0.5 * dt * towards * np.array([speed, 1.0])
        self.readings.append((own.speed, direction, dt))
        self.watch.read(own.speed, dt)
        self.last = own.speed, direction
        self.elapsed += dt
        if self.by_speed:
            self.advance(first, dt)
        if reception is not None:
            self.receive(to_message(self.settings, own, reception, self.watch))

    def started(self, P: Floats) -> Floats:
        """A covariance with that of a speed which is the last reading less b_v and its error."""
        P = P.copy()
        if self.by_speed:
            P[SPEED, LOG] = P[LOG, SPEED] = -self.fresh[LOG]
        return P

    def advance(self, first: bool, dt: float) -> None:
        """One step of components whose speed is a state: the log measures v + b_v."""
        assert self.last is not None
        H = np.zeros((1, N))
        H[0, [SPEED, LOG]] = 1.0
        for c in self.all:
            if first:
                c.x[SPEED], c.P = self.last[0], self.started(c.P)
            moved, _ = self.moved(c, c.x[SPEED], c.x[COMPASS])
            c.x, c.P = moved.x, moved.P
            if not first:
                S = H @ c.P @ H.T + self.settings.speed_sigma**2
                residual = self.last[0] - H @ c.x
                c.weight *= float(np.exp(-0.5 * residual @ residual / S[0, 0]) / np.sqrt(S[0, 0]))
                c.update(residual, H, S)
        self.begin()
        if self.sides:
            normalise(self.sides)
        self.unmixed += dt
        if self.unmixed >= 1.0 - 1e-6:
            # 3 % change in a second
            rate = -0.5 * np.log(2.0 * 0.97 - 1.0)
            change = chances(self.counts[0], rate, self.unmixed)
            for side in self.sides:
                mix(side, np.kron(change, np.eye(self.counts[1])))
            self.unmixed = 0.0

    def way(self) -> tuple[complex, complex, Floats, float]:
        """A = Σ v u Δt, B = Σ u Δt, the covariance of A's random errors, and the time since the
        last message.
        """
        noise, time = np.zeros((2, 2)), 0.0
        for speed, direction, dt in self.readings:
            along, across = pair(direction), pair(1j * direction)
            if not self.by_speed:
                noise += (self.settings.speed_sigma * dt) ** 2 * outer(along, along)
            noise += (self.settings.heading_sigma * speed * dt) ** 2 * outer(across, across)
            time += dt
        return complex(self.trapezoids[0]), complex(self.trapezoids[1]), noise, time

    def moved(self, c: Component, speed: float, compass: float) -> tuple[Component, Floats]:
        """A component after the way since the last message, linearised at some biases; and the
        derivatives F. `speed` is the log's bias, or the speed where that is a state.
        """
        a, b, noise, time = self.way()
        turn = np.exp(1j * compass)
        r = turn * (speed * b if self.by_speed else a - speed * b)
        along = SPEED if self.by_speed else LOG
        F = np.eye(N)
        F[:2, along], F[:2, COMPASS], F[0, EAST], F[1, NORTH] = (
            pair(turn * b if self.by_speed else -turn * b),
            pair(1j * r),
            time,
            time,
        )
        F[CLOCK, RATE] = time
        if not self.by_speed:
            F[NEW] = 0.0
        x = F @ c.x
        x[:2] += pair(r) - F[:2, along] * speed - F[:2, COMPASS] * compass
        Q = np.zeros((N, N))
        Q[:2, :2] = rotation(compass) @ noise @ rotation(
            compass
        ).T + self.settings.slip**2 * time * np.eye(2)
        if self.settings.leader_position_sigma and not self.by_speed:
            Q[NEW, NEW] = self.new_variance
        Q[WALKED, WALKED] = self.settings.leader_position_walk**2 * time
        Q[CLOCK : RATE + 1, CLOCK : RATE + 1] = self.clock_walk**2 * np.array(
            [[time**3 / 3, time**2 / 2], [time**2 / 2, time]]
        )
        for state, rate in self.walks[c.mode].items():
            # a bias that wanders from 0, and its integral along a straight way
            own, through = np.eye(N)[state], np.concatenate([F[:2, state], np.zeros(N - 2)])
            half = 0.5 * (outer(own, through) + outer(through, own))
            Q += rate**2 * time * (outer(own, own) + half + outer(through, through) / 3.0)
        return replace(c, x=x, P=F @ c.P @ F.T + Q), F

    def now(self) -> tuple[Floats, Floats]:
        """Mean and covariance of x, y, vx, vy over the mixture."""
        if not self.sides or self.last is None:
            return np.full(4, np.nan), np.full((4, 4), np.nan)
        parts = []
        for c in self.all:
            along = SPEED if self.by_speed else LOG
            moved, F = self.moved(c, c.x[along], c.x[COMPASS])
            direction = np.exp(1j * c.x[COMPASS]) * self.last[1]
            speed = c.x[SPEED] if self.by_speed else self.last[0] - c.x[LOG]
            velocity, rows = speed * direction, np.vstack([F[:2], np.zeros((2, N))])
            rows[2:, along] = pair(direction if self.by_speed else -direction)
            rows[2:, COMPASS] = pair(1j * velocity)
            rows[2, EAST] = rows[3, NORTH] = 1.0
            spread = rows @ c.P @ rows.T
            spread[:2, :2] = moved.P[:2, :2]
            ahead, across = pair(direction), pair(1j * direction)
            if not self.by_speed:
                spread[2:, 2:] += self.settings.speed_sigma**2 * outer(ahead, ahead)
            spread[2:, 2:] += (self.settings.heading_sigma * self.last[0]) ** 2 * outer(
                across, across
            )
            mean = np.concatenate([moved.x[:2], pair(velocity) + c.x[[EAST, NORTH]]])
            parts.append(Component(mean, spread, c.weight))
        return moments(parts)

    def receive(self, received: Message) -> None:  # noqa: C901, PLR0912 - the steps of the algorithm
        """Mix modes, inflate, predict, split, update, weigh, prune, reinitialise; then use the
        leader's track.
        """
        self.used = 0
        if not received.which:
            return
        if not self.sides:
            if len(received.which) > 1:
                if self.settings.leader_position_sigma:
                    self.fresh[NEW] = received.new_variance
                walked = self.settings.leader_position_walk**2 * self.watch.clock
                self.fresh[WALKED] = walked
                self.add_ring(received, 1.0)
                self.used = len(received.which)
                for c in self.all:
                    c.taken, c.squared = self.used, np.nan
                self.end()
            return
        self.new_variance = received.new_variance
        for side in self.sides:
            change = chances(self.counts[1], 0.004, self.elapsed)
            mix(side, np.kron(np.eye(self.counts[0]), change))
        if not self.settings.assume.exact_leader:
            received = self.averaged_heading(received)
        if self.settings.assume.deviation:
            self.inflate(received)
        self.sides = [[self.moved_to(c, received) for c in side] for side in self.sides]
        if {0, 1} <= set(received.which):
            split(self.settings, self.sides, received)
        self.used = max(update_with_ranges(self.settings, self.v, c, received) for c in self.all)
        best = max(c.evidence for c in self.all)
        for c in self.all:
            c.weight *= float(np.exp(c.evidence - best))
        normalise(self.sides)
        if not self.settings.assume.exact_leader:
            variance = min(
                self.v + 0.1 * sum(c.weight * c.excess for c in self.all), self.scatter()
            )
            self.v = min(max(variance, np.deg2rad(0.1) ** 2), self.most)
        prune_and_merge(self.sides, self.near)
        self.smoothed += 0.15 * (
            sum(c.weight * c.normalised_innovation for c in self.all) - self.smoothed
        )
        heaviest_side = max(self.sides, key=lambda side: sum(c.weight for c in side))
        shared = max(heaviest_side, key=lambda c: c.weight).shared
        self.echoes = self.echoes + 1 if shared else 0
        if len(received.which) > 1 and self.smoothed >= 3.0 and not 0 < self.echoes < 10:
            self.smoothed = 1.0
            self.add_ring(received, 0.002)
        self.silent = 0 if self.used else self.silent + 1
        for c in self.all if self.silent >= 3 else []:
            c.P += np.diag([1.0, 1.0, 0.0, np.deg2rad(2.0) ** 2, *np.zeros(N - 4)])
        self.update_current(received)
        self.end()

    def end(self) -> None:
        self.begin()
        self.elapsed = 0.0

    def begin(self) -> None:
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
        self.places = [*self.places[-2:], complex(*received.place[::-1])]
        ways, most = np.diff(self.places), self.settings.leader_heading_sigma**2
        moving = ways.size == 2 and bool(np.all(abs(ways) > 0.3))
        bend = float(np.angle(ways[1] / ways[0])) if moving else np.inf
        on_leg = abs(bend) < 0.005
        before = len(self.leg)
        if on_leg:
            self.leg = [reading + bend for reading in self.leg]
            off = np.angle(np.exp(1j * (received.heading - np.mean(self.leg)))) if before else 0.0
            on_leg = bool(abs(off) <= 4.0 * np.sqrt(most))
        if not on_leg:
            if self.steady:
                self.v, self.other_v = self.other_v, self.v
                for c in self.all:
                    c.P[LEADER, LEADER] += self.scatter() / before
            self.past_legs.append(np.array(self.leg))
            self.leg, self.steady = [], False
            return received
        mean = float(np.mean(self.leg)) if before else received.heading
        self.leg.append(mean + float(np.angle(np.exp(1j * (received.heading - mean)))))
        known, most = self.sides[0][0].P[LEADER, LEADER], self.scatter()
        if self.steady:
            for c in self.all:
                c.x[LEADER] += np.mean(self.leg) - mean
                c.P[LEADER, LEADER] += (0.5 * bend) ** 2
        elif len(self.leg) >= 4 or most / len(self.leg) < 0.1 * known:
            self.v, self.other_v, self.steady = self.other_v, self.v, True
            for c in self.all:
                c.P[LEADER, LEADER] += most / len(self.leg)
        if not self.steady:
            return received
        heading = float(np.mean(self.leg))
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
        legs = [np.array(leg) for leg in (*self.past_legs, self.leg) if len(leg)]
        squares = sum(float(np.sum((leg - leg.mean()) ** 2)) for leg in legs)
        return min(self.most, (self.most + squares) / (1 + sum(leg.size - 1 for leg in legs)))

    def inflate(self, received: Message) -> None:
        """A deviation of 3 % of the turn, where it is more than 0.1 rad, of the leader's 0.15
        rad.
        """
        assert self.last is not None
        time = self.elapsed
        ahead = complex(np.sin(received.heading), np.cos(received.heading))
        leaders = [(LEADER, ahead, 0.15)] if self.fresh[LEADER] > 0.0 else []
        for state, direction, least in [(COMPASS, self.last[1], 0.1), *leaders]:
            turn = self.turns.setdefault(state, Turn(direction, still=-time))
            before, now = turn.largest, abs(np.angle(direction / turn.begin))
            turn.still += time
            if now > max(before, least):
                turn.largest, turn.still = now, 0.0
            elif turn.still >= 10.0 - 1e-6:
                self.turns[state] = Turn(direction)
            for c in self.all:
                c.P[state, state] += 0.03**2 * (turn.largest**2 - before**2)

    def moved_to(self, c: Component, received: Message) -> Component:
        """Linearised at the biases that the message suggests, where the way bends by more than 3
        mm.
        """
        if self.by_speed:
            if self.settings.leader_position_sigma:
                c.x[NEW], c.P[NEW], c.P[:, NEW] = 0.0, 0.0, 0.0
                c.P[NEW, NEW] = self.new_variance
            return c
        there, _ = self.moved(c, c.x[LOG], c.x[COMPASS])
        if 0.5 * c.P[COMPASS, COMPASS] * abs(self.way()[0]) < 0.003:
            return there
        update_with_ranges(self.settings, self.v, there, received)
        return self.moved(c, there.x[LOG], there.x[COMPASS])[0]

    def add_ring(self, received: Message, share: float) -> None:
        """Hypotheses of this message alone: 96 Gaussians on a ring, those left of the axis and
        those right of it.

        The ring is 5 m wide, its Gaussians 0.6 of their distance; near the belief so far, to 10 m,
        they weigh more.
        """
        here, modes = (
            moments(self.all)[0][:2] - received.place if self.sides else None,
            len(self.walks),
        )
        variance, self.v = self.v, 0.0
        near = replace(received, place=np.zeros(2))
        centre = received.arms[np.argmin(received.ranges)]
        distance = np.sqrt(max(received.ranges.min() ** 2 - centre[2] ** 2, 1.0))
        tried: list[Component] = []
        for bearing in 2.0 * np.pi * (np.arange(96) + 0.5) / 96:
            out = np.array([np.sin(bearing), np.cos(bearing)])
            around = np.array([out[1], -out[0]])
            P = self.started(np.diag(self.fresh))
            P[LEADER, LEADER] = 0.0
            P[:2, :2] = 25.0 * outer(out, out) + (0.6 * 2 * np.pi / 96 * distance) ** 2 * outer(
                around, around
            )
            x = np.concatenate([centre[:2] + distance * out, np.zeros(N - 2)])
            x[SPEED] = self.last[0] if self.by_speed and self.last else 0.0
            c = Component(x, P, 1.0)
            update_with_ranges(self.settings, self.v, c, near)
            if here is not None:
                c.evidence += np.log(0.01 + np.exp(-0.5 * np.sum((c.x[:2] - here) ** 2) / 100.0))
            tried.append(c)
        self.v = variance
        best = max(c.evidence for c in tried)
        for c in tried:
            c.weight = float(np.exp(c.evidence - best))
        total = sum(c.weight for c in tried)
        for c in self.all:
            c.weight *= 1.0 - share
        for left in (True, False):
            part = [c for c in tried if (aside(c, near)[0] > 0.0) == left]
            weight = sum(c.weight for c in part)
            if weight > 0.0:
                x, P = moments(part)
                turn = np.zeros(N)
                turn[BENT] = -x[1], x[0], 1.0
                P += self.fresh[LEADER] * outer(turn, turn)
                P[:2, :2] += self.v * outer(turn[:2], turn[:2])
                x[:2] += received.place
                weight *= share / total / modes
                self.sides.append(
                    [Component(x.copy(), P.copy(), weight, mode) for mode in range(modes)]
                )
        prune_and_merge(self.sides, self.near)

    def update_current(self, received: Message) -> None:
        """The leader's way over ground less that of its log: the current, and what its compass
        turns the log's way by.

        Windows grow from 1 s to 10 s, and begin anew after a turn of more than 0.2 rad.
        """
        if self.settings.assume.exact_leader and not self.settings.assume.current:
            return
        if not self.leader:
            self.leader, self.first_time, self.logged = [received], received.time, 0.0
            return
        first, last = self.leader[0], self.leader[-1]
        velocity = [
            h.speed * complex(np.sin(h.heading), np.cos(h.heading)) for h in (last, received)
        ]
        self.logged += 0.5 * (received.time - last.time) * sum(velocity)
        window = received.time - first.time
        self.leader.append(received)
        if abs(np.angle(np.exp(1j * (received.heading - first.heading)))) > 0.2:
            self.leader, self.logged = [received], 0.0
        elif window >= min(10.0, 1.0 + 0.2 * (received.time - self.first_time)) - 1e-6:
            logged = self.logged / window
            seen = (received.place - first.place) / window - pair(logged)
            for c in self.all:
                turned = np.exp(1j * c.x[LEADER]) * logged
                H = np.zeros((2, N))
                H[:, [EAST, NORTH]], H[:, LEADER] = np.eye(2), pair(1j * turned)
                residual = seen - c.x[[EAST, NORTH]] - pair(turned - logged)
                variance = 0.05**2 * 10.0 / window + 2.0 * self.new_variance / window**2
                variance += self.settings.leader_position_walk**2 / window
                c.update(residual, H, H @ c.P @ H.T + variance * np.eye(2))
            self.leader, self.logged = [received], 0.0
