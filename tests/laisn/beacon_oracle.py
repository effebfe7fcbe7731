"""The navigator among beacons written a second time: a list of Gaussians, matrices, derivatives of
whole expressions.

It shares no code with `laisn.beacons`. All beacons are there from the beginning: none changes
before it is heard.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from laisn.arrays import Floats
from laisn.beacons import BeaconSettings

X, Y, SPEED, HEADING, GYRO, SCALE, EAST, NORTH = range(8)
CAPACITY, KEPT = 1024, 256


@dataclass
class Component:
    x: Floats
    P: Floats
    weight: float


def moments(weight: Floats, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of a mixture, whose weights need not add up to 1."""
    weight = weight / weight.sum()
    centre = weight @ mean
    off = mean - centre
    return centre, np.einsum("k,kij->ij", weight, covariance) + np.einsum(
        "k,ki,kj->ij", weight, off, off
    )


@dataclass
class BeaconOracle:
    """One vehicle; `places` are those of all beacons: east, north and depth."""

    settings: BeaconSettings
    places: Floats
    start: Floats | None
    robots: tuple[int, ...] = ()
    """Beacons that move by odometry of their own."""
    mixture: list[Component] = field(default_factory=list)
    evidence: float = 0.0

    def __post_init__(self) -> None:
        settings, count = self.settings, len(self.places)
        shared = [
            settings.start_sigma,
            settings.start_sigma,
            settings.speed_scale_sigma,
            settings.heading_sigma,
            settings.gyro_bias_sigma,
        ]
        own = [settings.range_offset_sigma, settings.survey_sigma, settings.survey_sigma]
        turning = [settings.heading_sigma, settings.gyro_bias_sigma]
        of_beacons = [own + turning if i in self.robots else own for i in range(count)]
        self.first = [8 + sum(map(len, of_beacons[:i])) for i in range(count)]
        self.seen: dict[int, tuple[float, Floats]] = {}
        self.fresh = (
            np.array(
                [
                    *shared,
                    settings.range_scale_sigma,
                    settings.current_sigma,
                    settings.current_sigma,
                    *(sigma for sigmas in of_beacons for sigma in sigmas),
                ]
            )
            ** 2
        )
        self.n = self.fresh.size
        self.variance, self.rejected = (
            np.full(count, settings.range_sigma**2),
            np.zeros(count, dtype=int),
        )
        self.received = 0
        self.heard: set[int] = set()
        if self.start is not None:
            x = np.concatenate([self.start[:2], np.zeros(self.n - 2)])
            self.mixture = [Component(x, np.diag(self.fresh), 1.0)]

    def advance(self, speed: float, heading: float, time: float) -> None:
        """The true way is e^{b_s} v Δt u(θ − b_θ) + c Δt, after the gyro's bias has turned b_θ."""
        unit = np.eye(self.n)
        walk = self.settings.heading_walk**2 * unit[HEADING] + self.settings.slip**2 * (
            unit[X] + unit[Y]
        )
        walk += 5e-4**2 * unit[SPEED] * (self.fresh[SPEED] > 0) + 2e-5**2 * unit[GYRO] * (
            self.fresh[GYRO] > 0
        )
        walk += 1e-3**2 * (unit[EAST] + unit[NORTH]) * (self.fresh[EAST] > 0)
        drift = np.eye(self.n)
        drift[HEADING, GYRO] = time if self.fresh[GYRO] > 0 else 0.0
        # the bias that wanders in this step turns the way of the next one
        for c in self.mixture:
            c.x = drift @ c.x
            way = speed * time * np.exp(c.x[SPEED] + 1j * (np.pi / 2 - heading + c.x[HEADING]))
            F = np.eye(self.n)
            F[:2, SPEED], F[:2, HEADING] = [way.real, way.imag], [-way.imag, way.real]
            F[X, EAST] = F[Y, NORTH] = time
            c.x = c.x + np.array([way.real, way.imag, *np.zeros(self.n - 2)])
            c.x[:2] += time * c.x[[EAST, NORTH]]
            c.P = F @ drift @ c.P @ drift.T @ F.T + time * np.diag(walk)

    def follow(self, i: int, place: Floats, time: float) -> None:
        """Robot i says where it is by its odometry, at a time since the start.

        Its way since it last did so is truly turned by the error of its heading, which has grown at
        its rate.
        """
        before, last = self.seen.get(i, (0.0, place[:2]))
        self.seen[i] = time, place[:2]
        self.places[i] = place
        lasted, way = time - before, complex(*(place[:2] - last))
        slip, walk = self.settings.track_slip**2, self.settings.track_heading_walk**2
        east = self.first[i] + 1
        unit = np.eye(self.n)
        for c in self.mixture:
            turned = way * np.exp(1j * (c.x[east + 2] + 0.5 * lasted * c.x[east + 3]))
            aside = -turned.imag * unit[east] + turned.real * unit[east + 1]
            F = np.eye(self.n)
            F += np.outer(aside, unit[east + 2] + 0.5 * lasted * unit[east + 3])
            F[east + 2, east + 3] = lasted
            growth = turned - way
            c.x = c.x + growth.real * unit[east] + growth.imag * unit[east + 1]
            c.x[east + 2] += lasted * c.x[east + 3]
            # ∫ (ψ + s aside)(ψ + s aside)ᵀ ds over the even way
            heading = unit[east + 2]
            Q = np.outer(heading, heading) + np.outer(aside, aside) / 3.0
            Q += 0.5 * (np.outer(heading, aside) + np.outer(aside, heading))
            Q = walk * lasted * Q
            Q += slip * lasted * np.diag(unit[east] + unit[east + 1])
            Q += 2e-5**2 * lasted * np.diag(unit[east + 3]) * (self.fresh[east + 3] > 0)
            c.P = F @ c.P @ F.T + Q

    def now(self, speed: float, heading: float) -> tuple[Floats, Floats]:
        """Mean and covariance of x, y, vx, vy."""
        if not self.mixture:
            return np.full(4, np.nan), np.full((4, 4), np.nan)
        means, spreads = [], []
        for c in self.mixture:
            v = speed * np.exp(c.x[SPEED] + 1j * (np.pi / 2 - heading + c.x[HEADING]))
            rows = np.zeros((4, self.n))
            rows[:2, :2], rows[2:, [EAST, NORTH]] = np.eye(2), np.eye(2)
            rows[2:, SPEED], rows[2:, HEADING] = [v.real, v.imag], [-v.imag, v.real]
            means.append([*c.x[:2], v.real + c.x[EAST], v.imag + c.x[NORTH]])
            spreads.append(rows @ c.P @ rows.T)
        return moments(
            np.array([c.weight for c in self.mixture]), np.array(means), np.array(spreads)
        )

    def look(
        self, c: Component, i: int, measured: float, depth: float
    ) -> tuple[float, float, Floats, float]:
        """Residual, its variance but for the random error, H, and how far the circle bends from
        its tangent.
        """
        own = self.first[i]
        off = np.array(
            [*(c.x[:2] - self.places[i, :2] - c.x[own + 1 : own + 3]), self.places[i, 2] - depth]
        )
        rho, flat, scale = (
            max(np.linalg.norm(off), 0.1),
            max(np.linalg.norm(off[:2]), 0.1),
            1.0 + c.x[SCALE],
        )
        apart = np.zeros((2, self.n))
        apart[:, :2], apart[:, own + 1 : own + 3] = np.eye(2), -np.eye(2)
        C = apart @ c.P @ apart.T
        H = scale * off[:2] / rho @ apart
        H[SCALE], H[own] = rho, 1.0
        bent = scale / rho * (np.eye(2) - np.outer(off[:2], off[:2]) / rho**2) @ C
        tangent = np.array([-off[1], off[0]]) / flat
        residual = measured - scale * rho - c.x[own] - 0.5 * np.trace(bent)
        return (
            residual,
            H @ c.P @ H + 0.5 * np.trace(bent @ bent),
            H,
            0.5 * tangent @ C @ tangent / flat,
        )

    def update_with_ranges(
        self, c: Component, i: int, measured: float, depth: float
    ) -> tuple[bool, float]:
        """Update, unless the range is likelier to be wrong; whether it was used, and how much
        likelier than wrong.
        """
        residual, variance, H, _ = self.look(c, i, measured, depth)
        variance += self.variance[i]
        density = (1.0 - self.settings.outlier_probability) * np.exp(-0.5 * residual**2 / variance)
        ratio = (
            density
            / np.sqrt(2.0 * np.pi * variance)
            * self.settings.outlier_span
            / self.settings.outlier_probability
        )
        if ratio < 1.0:
            return False, 1.0
        gain = c.P @ H / variance
        c.x, c.P = c.x + gain * residual, c.P - np.outer(gain, gain) * variance
        return True, float(ratio)

    def receive_range(self, i: int, measured: float, depth: float) -> bool:
        """Take a range to beacon i at one's own depth; whether the heaviest component used it."""
        used, wrong = False, np.log(self.settings.outlier_probability / self.settings.outlier_span)
        if self.mixture:
            self.split(i, measured, depth)
            if self.mixture[0].weight > 0.9:
                residual, variance, _, _ = self.look(self.mixture[0], i, measured, depth)
                v, least = self.variance[i], self.settings.range_sigma**2
                v += 0.02 * (np.clip(residual**2 - variance, 0.0, 16.0 * v) - v)
                self.variance[i] = np.clip(v, 0.25 * least, 16.0 * least)
            updates = [self.update_with_ranges(c, i, measured, depth) for c in self.mixture]
            for c, (_, ratio) in zip(self.mixture, updates, strict=True):
                c.weight *= ratio
            used = updates[0][0]
            self.evidence += np.log(self.normalise()) + wrong
            self.rejected[i] = 0 if used else self.rejected[i] + 1
        self.received += 1
        self.heard.add(i)
        if self.start is None and self.received <= 8:
            # as likely as that all before were wrong, beside what they are to the others
            self.add_ring(
                i, measured, depth, np.exp(min(self.received * wrong - self.evidence, 700.0)), None
            )
        elif self.rejected[i] >= (24 if 0 in [self.rejected[j] for j in self.heard - {i}] else 8):
            self.rejected[i] = 0
            self.add_ring(i, measured, depth, 0.01, self.mixture[0])
        self.prune_and_merge()
        return used

    def normalise(self) -> float:
        total = sum(c.weight for c in self.mixture)
        for c in self.mixture:
            c.weight /= total
        return total

    def split(self, i: int, measured: float, depth: float) -> None:
        """In three along the tangent: means −σ, 0, σ, weights ¼, ½, ¼, variance σ²/2."""
        k = 0
        while k < len(self.mixture):
            c = self.mixture[k]
            bend = self.look(c, i, measured, depth)[3]
            if bend <= 0.7 * np.sqrt(self.variance[i]) or len(self.mixture) + 2 > CAPACITY:
                k += 1
                continue
            own = self.first[i]
            off = c.x[:2] - self.places[i, :2] - c.x[own + 1 : own + 3]
            tangent = np.zeros(self.n)
            tangent[:2] = np.array([-off[1], off[0]]) / np.linalg.norm(off)
            tangent[own + 1 : own + 3] = -tangent[:2]
            column = c.P @ tangent / np.sqrt(tangent @ c.P @ tangent)
            c.P, c.weight = c.P - 0.5 * np.outer(column, column), 0.5 * c.weight
            self.mixture += [
                Component(c.x + s * column, c.P.copy(), 0.5 * c.weight) for s in (-1.0, 1.0)
            ]

    def add_ring(
        self, i: int, measured: float, depth: float, weight: float, top: Component | None
    ) -> None:
        """48 Gaussians on the circle of a range, of fresh errors, or of those of the heaviest
        component.
        """
        if len(self.mixture) + 48 >= CAPACITY:
            return
        own, deeper = self.first[i], self.places[i, 2] - depth
        distance = np.sqrt(max(measured**2 - deeper**2, 1.0))
        along = 4.0 * (
            self.variance[i]
            + self.fresh[own]
            + self.fresh[own + 1]
            + self.fresh[SCALE] * distance**2
        )
        across = (0.6 * 2.0 * np.pi / 48 * distance) ** 2
        x, P = (
            (np.zeros(self.n), np.diag(self.fresh)) if top is None else (top.x.copy(), top.P.copy())
        )
        P[:2], P[:, :2] = 0.0, 0.0
        P[HEADING, HEADING] += 0.0 if top is None else self.fresh[HEADING]
        for bearing in 2.0 * np.pi * np.arange(48) / 48:
            out, aside = (
                np.array([np.sin(bearing), np.cos(bearing)]),
                np.array([np.cos(bearing), -np.sin(bearing)]),
            )
            c = Component(x.copy(), P.copy(), weight / 48)
            c.x[:2] = self.places[i, :2] + distance * out
            c.P[:2, :2] = along * np.outer(out, out) + across * np.outer(aside, aside)
            self.update_with_ranges(c, i, measured, depth)
            self.mixture.append(c)
        self.normalise()

    def drop(self, k: int) -> None:
        last = self.mixture.pop()
        if k < len(self.mixture):
            self.mixture[k] = last

    def prune_and_merge(self) -> None:
        """Nothing lighter than 1e-8, nothing nearer to another than 0.3 squared, 256 at most,
        the heaviest first.
        """
        if len(self.mixture) < 2:
            return
        k = 0
        while k < len(self.mixture):
            if self.mixture[k].weight < 1e-8:
                self.drop(k)
            else:
                k += 1
        g = 0
        while g < len(self.mixture):
            h = g + 1
            while h < len(self.mixture):
                one, other = self.mixture[g], self.mixture[h]
                off = (one.x - other.x)[:2]
                (a, b), (_, d) = 0.5 * (one.P + other.P)[:2, :2]
                if np.array([off[1], -off[0]]) @ [[a, b], [b, d]] @ [off[1], -off[0]] < 0.3 * (
                    a * d - b * b
                ):
                    x, P = moments(
                        np.array([one.weight, other.weight]),
                        np.array([one.x, other.x]),
                        np.array([one.P, other.P]),
                    )
                    self.mixture[g] = replace(one, x=x, P=P, weight=one.weight + other.weight)
                    self.drop(h)
                else:
                    h += 1
            g += 1
        while len(self.mixture) > KEPT:
            self.drop(int(np.argmin([c.weight for c in self.mixture])))
        top = int(np.argmax([c.weight for c in self.mixture]))
        self.mixture[0], self.mixture[top] = self.mixture[top], self.mixture[0]
        self.normalise()
