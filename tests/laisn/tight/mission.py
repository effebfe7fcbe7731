"""A mission of formulas for the tightly coupled navigator."""

from types import SimpleNamespace

import numpy as np

from laisn.arrays import Floats
from laisn.estimates import FixRecord
from laisn.messages import LeaderMessage, Measurements
from laisn.settings import Assume

EVERYTHING = Assume(
    exact_leader=False, drift=True, deviation=True, current=True, offsets=True, clock=True
)
DT = 0.1


class Mission:
    """A leader that turns, a follower that weaves off its quarter, and exact measurements of
    both.
    """

    def __init__(
        self, steps: int = 3000, every: int = 10, current: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        t = DT * np.arange(steps + 1)
        self.steps, self.every = steps, every
        self.leader_heading = 1.2 + 0.8 * np.sin(0.015 * t)
        self.heading = 1.2 + 0.8 * np.sin(0.015 * t - 0.3) + 0.2 * np.sin(0.05 * t)
        self.speed = 1.1 + 0.2 * np.sin(0.04 * t)
        self.leader_speed = np.ones(t.size)
        drift = np.outer(t, current)
        self.leader = drift + _integral(self.leader_speed, self.leader_heading)
        self.follower = drift + _integral(self.speed, self.heading) + np.array([-18.0, 14.0])
        self.k = np.arange(every, steps + 1, every)

    def arms(self, middle_offset: float = 0.1) -> Floats:
        theta = self.leader_heading[self.k]
        ahead = np.stack([np.sin(theta), np.cos(theta)], axis=1)
        port = np.stack([-np.cos(theta), np.sin(theta)], axis=1)
        return np.stack([-ahead, ahead, middle_offset * port], axis=1)

    def measured(
        self,
        rng: np.random.Generator | None = None,
        *,
        log: float = 0.0,
        compass: float = 0.0,
        leader: float = 0.0,
        scale: float = 0.0,
        offsets: tuple[float, float, float] = (0.0, 0.0, 0.0),
        clock: tuple[float, float] = (0.0, 0.0),
    ) -> Measurements:
        n, m = self.steps, self.k.size
        apart = (self.follower - self.leader)[self.k][:, None, :] - self.arms()
        ranges = np.hypot(apart[..., 0], apart[..., 1])
        ranges = ranges * (1.0 + scale / ranges.max(axis=1, keepdims=True)) + np.array(offsets)
        ranges = ranges + (clock[0] + clock[1] * DT * self.k)[:, None]
        speed, heading = self.speed[1:] + log, self.heading[1:] + compass
        if rng is not None:
            speed = speed + rng.normal(0, 0.2, n)
            heading = heading + rng.normal(0, np.deg2rad(1.2), n)
            ranges = ranges * (
                1.0 + rng.normal(0, 0.05, (m, 1)) / ranges.max(axis=1, keepdims=True)
            )
            ranges = ranges + rng.normal(0, 0.003, ranges.shape)
        message = np.full((m, len(LeaderMessage._fields)), np.nan)
        message[:, 0], message[:, 1:3] = DT * self.k, self.leader[self.k]
        message[:, 3], message[:, 4] = (
            self.leader_heading[self.k] + leader,
            self.leader_speed[self.k],
        )
        message[:, 5] = 8.0
        return Measurements(
            dt=DT,
            speed=speed,
            heading=heading,
            depth=np.full(n, 8.0),
            message_step=self.k,
            message=message,
            ranges=ranges,
        )

    @property
    def start(self) -> Floats:
        return np.concatenate([self.follower[0], np.zeros(2)])


def _integral(speed: Floats, heading: Floats) -> Floats:
    """Way at constant mean velocity over each step: what the trapezoid of exact readings gives."""
    velocity = speed[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    return np.concatenate(
        [np.zeros((1, 2)), np.cumsum(0.5 * DT * (velocity[1:] + velocity[:-1]), axis=0)]
    )


def details(fix: FixRecord) -> SimpleNamespace:
    """Details of a fix, of the hypotheses that there are."""
    count = np.count_nonzero(fix.details["weight"])
    of_hypotheses = {
        name: fix.details[name][:count]
        for name in ("weight", "hypothesis", "hypothesis_covariance")
    }
    return SimpleNamespace(**{**fix.details, **of_hypotheses})
