"""LAISN written a second time, from the paper's equations alone: plain NumPy, 4×4 matrices, complex
numbers for positions.

It shares no code with `laisn`. Messages are received whole or not at all. Of the open questions it
answers those that `docs/algorithm.md` lists as that page does.
"""

from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats

DT, BASELINE, MIDDLE_OFFSET = 0.1, 2.0, 0.1
THRESHOLD, BETA = 0.1, 0.1
ALPHA, SIGMA_A0, V_MAX = 8.0, 60.0, 3.0
SIGMA_V, SIGMA_THETA = 0.2, np.deg2rad(2.0)
MIN_VARIANCE = 1e-12
PAIRS = ((0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class PairFix:
    """Of a pair of circles: number of intersections, their separation, the fix and its σp."""

    number: int
    separation: float
    z: complex
    sigma: float


def fix_of_pair(
    centre: list[complex], radius: list[float], pair: tuple[int, int], predicted: complex
) -> PairFix:
    """Sections 2.2 and 2.3.2; behind the leader on the pair's own axis (Eq. 23) where the
    circles do not help.
    """
    i, j = pair
    axis_vector = centre[j] - centre[i]
    d = abs(axis_vector)
    # the law of cosines at the centre of the first circle
    cosine = (d**2 + radius[i] ** 2 - radius[j] ** 2) / (2 * d * radius[i])
    # Eq. 23: from P1 against P1 → P2 or P1 → P3; of the pair (2, 3) from P2 against P3 → P2
    snap_axis = axis_vector / d if pair != (1, 2) else -axis_vector / d
    behind = centre[i] - radius[i] * snap_axis
    if abs(cosine) > 1:
        return PairFix(0, 0.0, behind, 0.0)
    angle = np.arccos(cosine)
    points = [centre[i] + radius[i] * axis_vector / d * np.exp(1j * a) for a in (angle, -angle)]
    separation = abs(points[0] - points[1])
    if separation < THRESHOLD:
        return PairFix(2, separation, behind, 0.0)
    return PairFix(2, separation, min(points, key=lambda p: abs(p - predicted)), BETA / separation)


def single_fix(variant: str, fixes: list[PairFix]) -> tuple[complex, float]:
    """The one fix of a message, z and σp (Sections 2.2, 2.3.2 and 2.3.3)."""
    crossing = [m for m in fixes if m.number > 0]
    if variant == "laisn-2" or not crossing:
        return fixes[0].z, fixes[0].sigma
    if variant == "laisn-3-2":
        weight = [1 / (1 + m.sigma) for m in crossing]
        z = sum(w * m.z for w, m in zip(weight, crossing, strict=True)) / sum(weight)
        return z, sum(m.sigma for m in crossing) / 3
    if variant == "laisn-best":
        widest = max(crossing, key=lambda m: m.separation)
        return widest.z, widest.sigma
    clear = [m for m in crossing if m.separation >= THRESHOLD]
    first = clear[0] if clear else fixes[0]
    return first.z, first.sigma


@dataclass
class Oracle:
    """One follower; `gate` is the rule of Section 2.4: "v-max" or "v-measured"."""

    variant: str
    gate: str
    x: Floats
    rejected: int = 0

    def __post_init__(self) -> None:
        self.x = self.x.copy()
        self.P = np.zeros((4, 4))
        self.last_own: tuple[float, float] | None = None
        self.last_leader: tuple[float, float] | None = None
        self.last_accepted, self.steps_since = complex(*self.x[:2]), 0

    def step(
        self,
        speed: float,
        heading: float,
        depth: float,
        message: Floats | None,
        ranges: Floats | None,
    ) -> None:
        """A filter step; `message` as broadcast (time, east, north, heading, speed, depth), None
        if none is heard.
        """
        self.steps_since += 1
        changes = [change(self.last_own, (speed, heading))]
        self.last_own = speed, heading
        if message is not None:
            changes.append(change(self.last_leader, (message[4], message[3])))
            self.last_leader = message[4], message[3]
        gamma_v, gamma_theta = np.max(changes, axis=0)
        sigma_a = ALPHA * (gamma_v + gamma_theta) + SIGMA_A0
        a = np.kron([[1, DT], [0, 1]], np.eye(2))
        q = np.kron([[DT**4 / 4, DT**3 / 2], [DT**3 / 2, DT**2]], np.eye(2))
        self.x, self.P = a @ self.x, a @ self.P @ a.T + sigma_a**2 * q
        if message is not None and ranges is not None:
            self.receive(message, ranges, depth, speed)
        s, c = np.sin(heading), np.cos(heading)
        j = np.array([[s, speed * c], [c, -speed * s]])
        self.update(
            speed * np.array([s, c]), j @ np.diag([SIGMA_V**2, SIGMA_THETA**2]) @ j.T, slice(2, 4)
        )

    def receive(self, message: Floats, ranges: Floats, depth: float, speed: float) -> None:
        """Position update, or three of them with LAISN-3(1)."""
        direction = complex(np.sin(message[3]), np.cos(message[3]))
        leader_position = complex(message[1], message[2])
        centre = [
            leader_position - BASELINE / 2 * direction,
            leader_position + BASELINE / 2 * direction,
            leader_position + MIDDLE_OFFSET * 1j * direction,
        ]
        radius = [float(np.sqrt(max(r**2 - (depth - message[5]) ** 2, 0.0))) for r in ranges]
        accepted = False
        for pair_index in range(3 if self.variant == "laisn-3-1" else 1):
            fixes = [fix_of_pair(centre, radius, pair, complex(*self.x[:2])) for pair in PAIRS]
            z, sigma = (
                (fixes[pair_index].z, fixes[pair_index].sigma)
                if self.variant == "laisn-3-1"
                else single_fix(self.variant, fixes)
            )
            bound = (V_MAX if self.gate == "v-max" else speed) * self.steps_since * DT
            if abs(z - self.last_accepted) > bound:
                self.rejected += 1
                continue
            accepted = True
            if self.P[0, 0] + self.P[1, 1] + 2 * sigma**2 >= 2 * MIN_VARIANCE:
                self.update(np.array([z.real, z.imag]), sigma**2 * np.eye(2), slice(0, 2))
        if accepted:
            self.last_accepted, self.steps_since = complex(*self.x[:2]), 0

    def update(self, z: Floats, r: Floats, components: slice) -> None:
        """Kalman update, Joseph form."""
        h = np.eye(4)[components]
        k = np.linalg.solve(h @ self.P @ h.T + r, h @ self.P).T
        complement = np.eye(4) - k @ h
        self.x, self.P = (
            self.x + k @ (z - h @ self.x),
            complement @ self.P @ complement.T + k @ r @ k.T,
        )


def change(before: tuple[float, float] | None, now: tuple[float, float]) -> tuple[float, float]:
    """γv and γθ of one vehicle between two measurements of (speed, heading) (Section 2.1)."""
    if before is None:
        return 0.0, 0.0
    angle = np.arccos(np.clip(np.cos(now[1] - before[1]), -1, 1))
    return abs(now[0] - before[0]) / V_MAX, float(angle) / np.pi
