"""Navigators of a swarm: all followers advance by one filter step in one call, and their estimates
control them.

A swarm is a NamedTuple whose `navigate` is compiled (`laisn.lanes`, `laisn.tight.navigator`), or
any other object with such a method, which Python calls. Compiled code chooses the method by the
type of the NamedTuple.
"""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numba import types
from numba.extending import overload_method

from laisn.arrays import Bools, Floats, Ints, Record, Records
from laisn.messages import Bearing, LeaderMessage, OwnMotion, Ranges, Reception
from laisn.settings import Settings

ESTIMATE = np.dtype(
    [
        ("position", np.float64, 2),  # mean, east and north [m]; NaN before there is one
        ("velocity", np.float64, 2),  # over ground [m/s]
        ("log_bias", np.float64),  # [m/s]
        ("compass_bias", np.float64),  # [rad]
        ("current", np.float64, 2),  # [m/s]
        (
            "spread",
            np.float64,
        ),  # largest standard deviation of the position at the last message [m]
        # where the position is ambiguous: from the mean to the likelier hypothesis [m]
        ("to_likelier", np.float64, 2),
    ]
)
"""Estimate of one follower; a navigator without such states leaves their fields at zero."""
READING = np.dtype(
    [
        ("speed", np.float64),  # speed log [m/s]
        ("heading", np.float64),  # compass [rad]
        ("depth", np.float64),  # pressure sensor [m]
        ("pitch", np.float64),  # inclinometer [rad]
        # gyros: rates about the up and the port axis [rad/s]
        ("turning", np.float64),
        ("pitching", np.float64),
    ]
)
MESSAGE = np.dtype([(name, np.float64) for name in LeaderMessage._fields])


class Swarm(Protocol):
    """Navigators of f followers."""

    @property
    def gated(self) -> Ints:
        """Number of fixes or messages of each follower that its gate has rejected so far, shape
        (f,).
        """

    def navigate(
        self,
        step: int,
        readings: Records,
        received: Bools,
        messages: Records,
        ranges: Floats,
        estimates: Records,
    ) -> int:
        """Advance by one filter step.

        Args:
            step: from 1.
            readings: records of READING, shape (f,).
            received: whether a message is in, shape (f,).
            messages: records of MESSAGE, shape (f,).
            ranges: shape (f, 3), [m]; NaN where nothing was received.
            estimates: out: records of ESTIMATE, shape (f,).

        Returns:
            Number, from 1, of the follower whose covariance is not positive definite any more; 0 if
            there is none.
        """


SwarmFactory = Callable[[Any, Floats], Swarm]
"""Makes the navigators of a swarm from their settings and their known starts x, y [m], vx, vy
[m/s], shape (f, 4).
"""


@overload_method(types.BaseNamedTuple, "navigate", inline="always")
def _navigate(swarm, step, readings, received, messages, ranges, estimates):  # type: ignore[no-untyped-def]
    method = getattr(swarm.instance_class, "navigate", None)
    return method and (
        lambda swarm, step, readings, received, messages, ranges, estimates: method(
            swarm, step, readings, received, messages, ranges, estimates
        )
    )


def reception_of(message: Record, ranges: Floats, bearing: Bearing | None = None) -> Reception:
    """A reception from a record of MESSAGE and ranges, shape (3,), [m]."""
    return Reception(LeaderMessage(*message.tolist()), Ranges(*ranges.tolist()), bearing=bearing)


class SeparateNavigators:
    """A swarm of navigators of any kind, each of which Python calls with its own measurements."""

    def __init__(
        self, make_navigator: Callable[[Any, Floats], Any], settings: Settings, starts: Floats
    ) -> None:
        """Make a navigator for each of the known starts, shape (f, 4)."""
        self.navigators = [make_navigator(settings, start) for start in starts]
        self.gated: Ints = np.zeros(len(starts), dtype=np.int64)
        self.bearings: list[Bearing | None] = [None] * len(starts)
        """What inverted USBLs measured at this filter step."""

    def navigate(
        self,
        step: int,
        readings: Records,
        received: Bools,
        messages: Records,
        ranges: Floats,
        estimates: Records,
    ) -> int:
        """Advance by one filter step; see `Swarm.navigate`. Gates are not counted."""
        for i, navigator in enumerate(self.navigators):
            reception = (
                reception_of(messages[i], ranges[i], self.bearings[i]) if received[i] else None
            )
            navigator.step(OwnMotion(*readings[i].tolist()[:3]), reception)
            estimates.position[i], estimates.velocity[i] = np.split(navigator.state, 2)
            # of the sensors by which the hull is controlled, from a navigator that has them
            estimates.log_bias[i], estimates.compass_bias[i] = getattr(
                navigator, "biases", (0.0, 0.0)
            )
        return 0
