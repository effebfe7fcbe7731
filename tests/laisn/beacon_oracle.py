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
CAPACITY, MAX_KEPT = 1024, 256


@dataclass
class Component:
    x: Floats
    P: Floats
    weight: float


def moments(weight: Floats, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Mean and covariance of a mixture; its weights are normalised."""
    weight = weight / weight.sum()
    mean_of_all = weight @ mean
    offsets = mean - mean_of_all
    return mean_of_all, np.einsum("k,kij->ij", weight, covariance) + np.einsum(
        "k,ki,kj->ij", weight, offsets, offsets
    )


@dataclass
class BeaconOracle:
    """One vehicle; `beacon_positions` are east, north and depth of each beacon.

    Of beacon i the states begin at `first_state[i]`: the offset of its ranges, the errors of its
    surveyed position to the east and to the north, and for a robot those of its heading and gyro.
    """

    settings: BeaconSettings
    beacon_positions: Floats
    start: Floats | None
    robots: tuple[int, ...] = ()
    """Beacons that move by odometry of their own."""
    mixture: list[Component] = field(default_factory=list)
    evidence: float = 0.0

    def __post_init__(self) -> None:
        settings, count = self.settings, len(self.beacon_positions)
        vehicle_sigmas = [
            settings.start_sigma,
            settings.start_sigma,
            settings.speed_scale_sigma,
            settings.heading_sigma,
            settings.gyro_bias_sigma,
        ]
        beacon_sigmas = [settings.range_offset_sigma, settings.survey_sigma, settings.survey_sigma]
        odometry_sigmas = [settings.heading_sigma, settings.gyro_bias_sigma]
        sigmas_of_beacons = [
            beacon_sigmas + odometry_sigmas if i in self.robots else beacon_sigmas
            for i in range(count)
        ]
        self.first_state = [8 + sum(map(len, sigmas_of_beacons[:i])) for i in range(count)]
        self.last_odometry: dict[int, tuple[float, Floats]] = {}
        self.prior_variance = (
            np.array(
                [
                    *vehicle_sigmas,
                    settings.range_scale_sigma,
                    settings.current_sigma,
                    settings.current_sigma,
                    *(sigma for sigmas in sigmas_of_beacons for sigma in sigmas),
                ]
            )
            ** 2
        )
        self.n_states = self.prior_variance.size
        self.variance, self.rejected = (
            np.full(count, settings.range_sigma**2),
            np.zeros(count, dtype=int),
        )
        self.received = 0
        self.heard: set[int] = set()
        if self.start is not None:
            x = np.concatenate([self.start[:2], np.zeros(self.n_states - 2)])
            self.mixture = [Component(x, np.diag(self.prior_variance), 1.0)]

    def advance(self, speed: float, heading: float, time: float) -> None:
        """The true displacement is e^{b_s} v Δt u(θ − b_θ) + c Δt, once b_θ has grown by b_g Δt."""
        unit = np.eye(self.n_states)
        walk_rates = self.settings.heading_walk**2 * unit[HEADING] + self.settings.slip**2 * (
            unit[X] + unit[Y]
        )
        walk_rates += 5e-4**2 * unit[SPEED] * (self.prior_variance[SPEED] > 0) + 2e-5**2 * unit[
            GYRO
        ] * (self.prior_variance[GYRO] > 0)
        walk_rates += 1e-3**2 * (unit[EAST] + unit[NORTH]) * (self.prior_variance[EAST] > 0)
        gyro_step = np.eye(self.n_states)
        gyro_step[HEADING, GYRO] = time if self.prior_variance[GYRO] > 0 else 0.0
        # the random walk of a bias in this step affects the displacement of the next one
        for c in self.mixture:
            c.x = gyro_step @ c.x
            displacement = (
                speed * time * np.exp(c.x[SPEED] + 1j * (np.pi / 2 - heading + c.x[HEADING]))
            )
            F = np.eye(self.n_states)
            F[:2, SPEED], F[:2, HEADING] = (
                [displacement.real, displacement.imag],
                [-displacement.imag, displacement.real],
            )
            F[X, EAST] = F[Y, NORTH] = time
            c.x = c.x + np.array(
                [displacement.real, displacement.imag, *np.zeros(self.n_states - 2)]
            )
            c.x[:2] += time * c.x[[EAST, NORTH]]
            c.P = F @ gyro_step @ c.P @ gyro_step.T @ F.T + time * np.diag(walk_rates)

    def follow(self, i: int, claimed: Floats, time: float) -> None:
        """Robot i claims a position by its odometry, at a time since the start.

        Its true displacement since its last claim is that of its odometry, turned by the error of
        its heading, which has grown at its rate.
        """
        last_time, last_position = self.last_odometry.get(i, (0.0, claimed[:2]))
        self.last_odometry[i] = time, claimed[:2]
        self.beacon_positions[i] = claimed
        duration, odometry = time - last_time, complex(*(claimed[:2] - last_position))
        slip, walk = self.settings.track_slip**2, self.settings.track_heading_walk**2
        east = self.first_state[i] + 1
        unit = np.eye(self.n_states)
        for c in self.mixture:
            displacement = odometry * np.exp(1j * (c.x[east + 2] + 0.5 * duration * c.x[east + 3]))
            across = -displacement.imag * unit[east] + displacement.real * unit[east + 1]
            F = np.eye(self.n_states)
            F += np.outer(across, unit[east + 2] + 0.5 * duration * unit[east + 3])
            F[east + 2, east + 3] = duration
            correction = displacement - odometry
            c.x = c.x + correction.real * unit[east] + correction.imag * unit[east + 1]
            c.x[east + 2] += duration * c.x[east + 3]
            # ∫ (ψ + s across)(ψ + s across)ᵀ ds over the displacement, s from 0 to 1
            heading = unit[east + 2]
            Q = np.outer(heading, heading) + np.outer(across, across) / 3.0
            Q += 0.5 * (np.outer(heading, across) + np.outer(across, heading))
            Q = walk * duration * Q
            Q += slip * duration * np.diag(unit[east] + unit[east + 1])
            Q += 2e-5**2 * duration * np.diag(unit[east + 3]) * (self.prior_variance[east + 3] > 0)
            c.P = F @ c.P @ F.T + Q

    def now(self, speed: float, heading: float) -> tuple[Floats, Floats]:
        """Mean and covariance of x, y, vx, vy."""
        if not self.mixture:
            return np.full(4, np.nan), np.full((4, 4), np.nan)
        means, covariances = [], []
        for c in self.mixture:
            v = speed * np.exp(c.x[SPEED] + 1j * (np.pi / 2 - heading + c.x[HEADING]))
            rows = np.zeros((4, self.n_states))
            rows[:2, :2], rows[2:, [EAST, NORTH]] = np.eye(2), np.eye(2)
            rows[2:, SPEED], rows[2:, HEADING] = [v.real, v.imag], [-v.imag, v.real]
            means.append([*c.x[:2], v.real + c.x[EAST], v.imag + c.x[NORTH]])
            covariances.append(rows @ c.P @ rows.T)
        return moments(
            np.array([c.weight for c in self.mixture]), np.array(means), np.array(covariances)
        )

    def linearise(
        self, c: Component, i: int, measured: float, depth: float
    ) -> tuple[float, float, Floats, float]:
        """Residual, its variance without the random error of the range, H, and how far the circle
        departs from its tangent within one standard deviation.
        """
        first = self.first_state[i]
        offset = np.array(
            [
                *(c.x[:2] - self.beacon_positions[i, :2] - c.x[first + 1 : first + 3]),
                self.beacon_positions[i, 2] - depth,
            ]
        )
        rho, horizontal, scale = (
            max(np.linalg.norm(offset), 0.1),
            max(np.linalg.norm(offset[:2]), 0.1),
            1.0 + c.x[SCALE],
        )
        difference = np.zeros((2, self.n_states))
        difference[:, :2], difference[:, first + 1 : first + 3] = np.eye(2), -np.eye(2)
        C = difference @ c.P @ difference.T
        H = scale * offset[:2] / rho @ difference
        H[SCALE], H[first] = rho, 1.0
        curvature = scale / rho * (np.eye(2) - np.outer(offset[:2], offset[:2]) / rho**2) @ C
        tangent = np.array([-offset[1], offset[0]]) / horizontal
        residual = measured - scale * rho - c.x[first] - 0.5 * np.trace(curvature)
        return (
            residual,
            H @ c.P @ H + 0.5 * np.trace(curvature @ curvature),
            H,
            0.5 * tangent @ C @ tangent / horizontal,
        )

    def update_with_ranges(
        self, c: Component, i: int, measured: float, depth: float
    ) -> tuple[bool, float]:
        """Update, unless the range is likelier to be wrong; whether it was used, and the ratio of
        the likelihoods of right and wrong, 1 at least.
        """
        residual, variance, H, _ = self.linearise(c, i, measured, depth)
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
        """Take a range to beacon i at a depth; whether the heaviest component used it."""
        used, log_wrong = (
            False,
            np.log(self.settings.outlier_probability / self.settings.outlier_span),
        )
        if self.mixture:
            self.split(i, measured, depth)
            if self.mixture[0].weight > 0.9:
                residual, predicted_variance, _, _ = self.linearise(
                    self.mixture[0], i, measured, depth
                )
                variance_of_range, nominal = self.variance[i], self.settings.range_sigma**2
                variance_of_range += 0.02 * (
                    np.clip(residual**2 - predicted_variance, 0.0, 16.0 * variance_of_range)
                    - variance_of_range
                )
                self.variance[i] = np.clip(variance_of_range, 0.25 * nominal, 16.0 * nominal)
            updates = [self.update_with_ranges(c, i, measured, depth) for c in self.mixture]
            for c, (_, ratio) in zip(self.mixture, updates, strict=True):
                c.weight *= ratio
            used = updates[0][0]
            self.evidence += np.log(self.normalise()) + log_wrong
            self.rejected[i] = 0 if used else self.rejected[i] + 1
        self.received += 1
        self.heard.add(i)
        if self.start is None and self.received <= 8:
            # weighed by the likelihood that all ranges before were wrong, over that of the mixture
            self.add_ring(
                i,
                measured,
                depth,
                np.exp(min(self.received * log_wrong - self.evidence, 700.0)),
                None,
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
            sagitta = self.linearise(c, i, measured, depth)[3]
            if sagitta <= 0.7 * np.sqrt(self.variance[i]) or len(self.mixture) + 2 > CAPACITY:
                k += 1
                continue
            first = self.first_state[i]
            offset = c.x[:2] - self.beacon_positions[i, :2] - c.x[first + 1 : first + 3]
            tangent = np.zeros(self.n_states)
            tangent[:2] = np.array([-offset[1], offset[0]]) / np.linalg.norm(offset)
            tangent[first + 1 : first + 3] = -tangent[:2]
            column = c.P @ tangent / np.sqrt(tangent @ c.P @ tangent)
            c.P, c.weight = c.P - 0.5 * np.outer(column, column), 0.5 * c.weight
            self.mixture += [
                Component(c.x + s * column, c.P.copy(), 0.5 * c.weight) for s in (-1.0, 1.0)
            ]

    def add_ring(
        self, i: int, measured: float, depth: float, weight: float, heaviest: Component | None
    ) -> None:
        """48 Gaussians on the circle of a range. Other states have their prior, or are those of the
        heaviest component, if one is given.
        """
        if len(self.mixture) + 48 >= CAPACITY:
            return
        first, depth_difference = self.first_state[i], self.beacon_positions[i, 2] - depth
        distance = np.sqrt(max(measured**2 - depth_difference**2, 1.0))
        radial_variance = 4.0 * (
            self.variance[i]
            + self.prior_variance[first]
            + self.prior_variance[first + 1]
            + self.prior_variance[SCALE] * distance**2
        )
        tangential_variance = (0.6 * 2.0 * np.pi / 48 * distance) ** 2
        x, P = (
            (np.zeros(self.n_states), np.diag(self.prior_variance))
            if heaviest is None
            else (heaviest.x.copy(), heaviest.P.copy())
        )
        P[:2], P[:, :2] = 0.0, 0.0
        P[HEADING, HEADING] += 0.0 if heaviest is None else self.prior_variance[HEADING]
        for bearing in 2.0 * np.pi * np.arange(48) / 48:
            radial, tangential = (
                np.array([np.sin(bearing), np.cos(bearing)]),
                np.array([np.cos(bearing), -np.sin(bearing)]),
            )
            c = Component(x.copy(), P.copy(), weight / 48)
            c.x[:2] = self.beacon_positions[i, :2] + distance * radial
            c.P[:2, :2] = radial_variance * np.outer(
                radial, radial
            ) + tangential_variance * np.outer(tangential, tangential)
            self.update_with_ranges(c, i, measured, depth)
            self.mixture.append(c)
        self.normalise()

    def drop(self, k: int) -> None:
        last = self.mixture.pop()
        if k < len(self.mixture):
            self.mixture[k] = last

    def prune_and_merge(self) -> None:
        """Drop weights below 1e-8, merge components whose squared distance in units of their mean
        covariance is below 0.3, keep the 256 heaviest, the heaviest of all first.
        """
        if len(self.mixture) < 2:
            return
        k = 0
        while k < len(self.mixture):
            if self.mixture[k].weight < 1e-8:
                self.drop(k)
            else:
                k += 1
        i = 0
        while i < len(self.mixture):
            j = i + 1
            while j < len(self.mixture):
                first, second = self.mixture[i], self.mixture[j]
                offset = (first.x - second.x)[:2]
                (a, b), (_, d) = 0.5 * (first.P + second.P)[:2, :2]
                if np.array([offset[1], -offset[0]]) @ [[a, b], [b, d]] @ [
                    offset[1],
                    -offset[0],
                ] < 0.3 * (a * d - b * b):
                    x, P = moments(
                        np.array([first.weight, second.weight]),
                        np.array([first.x, second.x]),
                        np.array([first.P, second.P]),
                    )
                    self.mixture[i] = replace(first, x=x, P=P, weight=first.weight + second.weight)
                    self.drop(j)
                else:
                    j += 1
            i += 1
        while len(self.mixture) > MAX_KEPT:
            self.drop(int(np.argmin([c.weight for c in self.mixture])))
        heaviest = int(np.argmax([c.weight for c in self.mixture]))
        self.mixture[0], self.mixture[heaviest] = self.mixture[heaviest], self.mixture[0]
        self.normalise()
