"""A mission in closed form for the tightly coupled navigator."""

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
    """A leader that turns, and a follower that weaves astern and aside of it."""

    def __init__(
        self,
        steps: int = 3000,
        steps_per_message: int = 10,
        current: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        time = DT * np.arange(steps + 1)
        self.steps, self.steps_per_message = steps, steps_per_message
        self.leader_heading = 1.2 + 0.8 * np.sin(0.015 * time)
        self.heading = 1.2 + 0.8 * np.sin(0.015 * time - 0.3) + 0.2 * np.sin(0.05 * time)
        self.speed = 1.1 + 0.2 * np.sin(0.04 * time)
        self.leader_speed = np.ones(time.size)
        drift = np.outer(time, current)
        self.leader = drift + _integral(self.leader_speed, self.leader_heading)
        self.follower = drift + _integral(self.speed, self.heading) + np.array([-18.0, 14.0])
        self.message_step = np.arange(steps_per_message, steps + 1, steps_per_message)

    def arms(self, middle_offset: float = 0.1) -> Floats:
        """East and north of rear, front and middle transmitter from the leader, by message."""
        heading = self.leader_heading[self.message_step]
        forward = np.stack([np.sin(heading), np.cos(heading)], axis=1)
        port = np.stack([-np.cos(heading), np.sin(heading)], axis=1)
        return np.stack([-forward, forward, middle_offset * port], axis=1)

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
        """Measurements of the follower, exact but for the errors that are given.

        Args:
            rng: draws random errors of log, compass and ranges, if given.
            log: bias of the log [m/s].
            compass: bias of the compass [rad].
            leader: bias of the leader's compass [rad].
            scale: error of the longest range, in proportion that of the others [m].
            offsets: errors of the ranges to the three transmitters [m].
            clock: error of all ranges at the start [m], and its rate [m/s].
        """
        n_steps, n_messages = self.steps, self.message_step.size
        from_transmitters = (self.follower - self.leader)[self.message_step][
            :, None, :
        ] - self.arms()
        ranges = np.hypot(from_transmitters[..., 0], from_transmitters[..., 1])
        ranges = ranges * (1.0 + scale / ranges.max(axis=1, keepdims=True)) + np.array(offsets)
        ranges = ranges + (clock[0] + clock[1] * DT * self.message_step)[:, None]
        speed, heading = self.speed[1:] + log, self.heading[1:] + compass
        if rng is not None:
            speed = speed + rng.normal(0, 0.2, n_steps)
            heading = heading + rng.normal(0, np.deg2rad(1.2), n_steps)
            ranges = ranges * (
                1.0 + rng.normal(0, 0.05, (n_messages, 1)) / ranges.max(axis=1, keepdims=True)
            )
            ranges = ranges + rng.normal(0, 0.003, ranges.shape)
        message = np.full((n_messages, len(LeaderMessage._fields)), np.nan)
        message[:, 0], message[:, 1:3] = DT * self.message_step, self.leader[self.message_step]
        message[:, 3], message[:, 4] = (
            self.leader_heading[self.message_step] + leader,
            self.leader_speed[self.message_step],
        )
        message[:, 5] = 8.0
        return Measurements(
            dt=DT,
            speed=speed,
            heading=heading,
            depth=np.full(n_steps, 8.0),
            message_step=self.message_step,
            message=message,
            ranges=ranges,
        )

    @property
    def start(self) -> Floats:
        return np.concatenate([self.follower[0], np.zeros(2)])


def _integral(speed: Floats, heading: Floats) -> Floats:
    """Displacements by the trapezoidal rule, as dead reckoning on exact readings has them."""
    velocity = speed[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    return np.concatenate(
        [np.zeros((1, 2)), np.cumsum(0.5 * DT * (velocity[1:] + velocity[:-1]), axis=0)]
    )


def details(fix: FixRecord) -> SimpleNamespace:
    """Details of a fix, without the unused places of hypotheses."""
    count = np.count_nonzero(fix.details["weight"])
    of_hypotheses = {
        name: fix.details[name][:count]
        for name in ("weight", "hypothesis", "hypothesis_covariance")
    }
    return SimpleNamespace(**{**fix.details, **of_hypotheses})
