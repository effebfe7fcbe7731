"""Navigators of a swarm: all followers advance by one filter step in one call, and their estimates
control them.

A swarm is a NamedTuple whose `navigate` is compiled (`laisn.lanes`, `laisn.tight.navigator`), or
any other object with such a method, which Python calls. Compiled code chooses the method by the
type of the NamedTuple.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
import numpy.typing as npt
from numba import types
from numba.extending import overload_method

from laisn.arrays import Bools, Floats, Ints, Record, Records, records
from laisn.compiled import compiled
from laisn.estimates import Estimates, FixKind, FixRecord, FixTable
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.settings import Settings
from laisn.spilled import spillable_zeros

ESTIMATE = np.dtype(
    [
        ("position", np.float64, 2),  # mean, east and north [m]; NaN before there is one
        ("velocity", np.float64, 2),  # over ground [m/s]
        ("log_bias", np.float64),  # [m/s]
        ("compass_bias", np.float64),  # [rad]
        ("current", np.float64, 2),  # [m/s]
        (
            "position_sigma",
            np.float64,
        ),  # largest standard deviation of the position at the last message [m]
        # where the position is ambiguous: from the mean to the likelier hypothesis [m]
        ("offset_to_likelier", np.float64, 2),
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
        # of vehicles that hold roll, and in missions that Python steps or controls, else 0:
        # inclinometer across the hull, the sine of the heel [-], and gyro about the forward axis
        # [rad/s]; positive starboard down
        ("heel", np.float64),
        ("rolling", np.float64),
    ]
)
MESSAGE = np.dtype([(name, np.float64) for name in LeaderMessage._fields])


class SwarmRecord(NamedTuple):
    """What the navigators of f followers conclude, with room for n steps and q fixes of each.

    States are always recorded. Covariances and fixes, which take more time than navigation itself,
    are where `covariance` has room for them.
    """

    state: Floats  # x, y [m], vx, vy [m/s] after each step, shape (f, n, 4)
    covariance: Floats  # of `state`, shape (f, n, 4, 4); (f, 0, 4, 4): neither this nor fixes
    fix: Records  # of `Estimates.fix_dtype`, shape (f, q)
    fix_count: Ints  # fixes of each follower so far, shape (f,)

    @classmethod
    def empty(
        cls, followers: int, steps: int, messages: int, kind: type[Estimates], *, whole: bool
    ) -> Self:
        """Room for the states of a mission; with `whole` also for covariances, and for fixes, up to
        three of a message.
        """
        state = spillable_zeros((followers, steps, 4))
        covariance = spillable_zeros((followers, steps if whole else 0, 4, 4))
        for numbers in (state, covariance):
            numbers[:] = np.nan
        return cls(
            state=state,
            covariance=covariance,
            fix=records(kind.fix_dtype(), followers, 3 * messages if whole else 0),
            fix_count=np.zeros(followers, dtype=np.int64),
        )

    def estimates(self, follower: int, steps: range, kind: type[Estimates]) -> Estimates:
        """The estimates of a follower of filter steps `steps.start` + 1 … `steps.stop`, which
        become 1 …, from a record with covariances and fixes.

        Their fixes, and the latest before them, whose hypotheses still hold.
        """
        fixes = self.fix[follower, : self.fix_count[follower]]
        return self.estimates_with(fixes, follower, steps, kind)

    def estimates_with(
        self, fixes: Records, follower: int, steps: range, kind: type[Estimates]
    ) -> Estimates:
        """The same with fixes that are elsewhere: records of `Estimates.fix_dtype`, shape (f,)."""
        fixes = fixes[in_force(fixes.fix_step, steps)]
        arrays = {name: fixes[name] for name in fixes.dtype.names}
        arrays["fix_step"] = fixes.fix_step - steps.start
        return kind(
            state=self.state[follower, steps.start : steps.stop],
            covariance=self.covariance[follower, steps.start : steps.stop],
            **arrays,
        )


def in_force(fix_step: Ints, steps: range) -> slice:
    """The fixes, of increasing steps, made in filter steps `steps.start` + 1 … `steps.stop`, and
    those of the last step before that has any.
    """
    first = int(np.searchsorted(fix_step, steps.start, side="right"))
    if first > 0:
        first = int(np.searchsorted(fix_step, fix_step[first - 1], side="left"))
    return slice(first, int(np.searchsorted(fix_step, steps.stop, side="right")))


@compiled
def new_fix(record: SwarmRecord, follower: int, step: int, kind: int) -> int:
    """Begin the next fix of a follower, with NaN where a fix has numbers; gives its index."""
    number = record.fix_count[follower]
    fix = record.fix[follower, number]
    record.fix_count[follower] += 1
    fix.fix_step = step
    fix.fix_kind = kind
    fix.fix_sigma = np.nan
    for i in range(2):
        fix.fix_position[i] = np.nan
        fix.innovation[i] = np.nan
        for j in range(2):
            fix.innovation_covariance[i, j] = np.nan
    return int(number)


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
        record: SwarmRecord,
    ) -> int:
        """Advance by one filter step.

        Args:
            step: from 1.
            readings: records of READING, shape (f,).
            received: whether a message is in, shape (f,).
            messages: records of MESSAGE, shape (f,).
            ranges: shape (f, 3), [m]; NaN where nothing was received.
            estimates: out: records of ESTIMATE, shape (f,).
            record: out: what there is room for.

        Returns:
            Number, from 1, of the follower whose covariance is not positive definite any more; 0 if
            there is none.
        """


SwarmFactory = Callable[[Any, Floats], Swarm]
"""Makes the navigators of a swarm from their settings and their known starts x, y [m], vx, vy
[m/s], shape (f, 4).
"""


@overload_method(types.BaseNamedTuple, "navigate", inline="always")
def _navigate(swarm, step, readings, received, messages, ranges, estimates, record):  # type: ignore[no-untyped-def]
    method = getattr(swarm.instance_class, "navigate", None)
    return method and (
        lambda swarm, step, readings, received, messages, ranges, estimates, record: method(
            swarm, step, readings, received, messages, ranges, estimates, record
        )
    )


def write_start(estimates: Records, starts: Floats, settings: Settings) -> None:
    """Write what navigators conclude before their first step, records of ESTIMATE, from their
    starts, shape (f, 4): no position unless the start is known.
    """
    estimates.position = starts[:, :2] if settings.known_start else np.nan
    estimates.velocity = starts[:, 2:] if settings.known_start else 0.0


def reception_of(
    message: Record,
    ranges: Floats,
    custom: Mapping[str, Floats],
    places: Floats | None = None,
) -> Reception:
    """A reception from a record of MESSAGE, ranges, shape (3,), [m], readings of further sensors,
    and places of beacons as of `Reception.transmitters`.
    """
    sent = LeaderMessage(*message.tolist())
    return Reception(sent, Ranges(*ranges.tolist()), places, custom)


class SeparateNavigators:
    """A swarm of navigators of any kind, each of which Python calls with its own measurements."""

    def __init__(
        self, make_navigator: Callable[[Any, Floats], Any], settings: Settings, starts: Floats
    ) -> None:
        """Make a navigator for each of the known starts, shape (f, 4)."""
        self.navigators = [make_navigator(settings, start) for start in starts]
        self.gated: Ints = np.zeros(len(starts), dtype=np.int64)
        self._kinds: list[type[Estimates]] = [
            getattr(navigator, "ESTIMATES", Estimates) for navigator in self.navigators
        ]
        self._fixes = [FixTable(kind) for kind in self._kinds]
        self.custom: list[dict[str, Floats]] = [{} for _ in starts]
        """Readings of further sensors of each follower at this filter step, by their names."""
        self.receptions: list[dict[str, Reception]] = [{} for _ in starts]
        """Messages of further links that become available at this filter step, of each follower, by
        the links' names.
        """
        self.content: list[dict[str, Floats]] = [{} for _ in starts]
        """Readings of the sender that the main link's message holds, of each follower."""
        self.places: Floats | None = None
        """Where the transmitters of messages are, as of `Reception.transmitters`."""

    def navigate(
        self,
        step: int,
        readings: Records,
        received: Bools,
        messages: Records,
        ranges: Floats,
        estimates: Records,
        record: SwarmRecord,
    ) -> int:
        """Advance by one filter step; see `Swarm.navigate`. Gates are not counted."""
        for i in range(len(self.navigators)):
            reception = None
            if received[i]:
                reception = reception_of(messages[i], ranges[i], self.custom[i], self.places)
                reception = reception._replace(content=self.content[i])
            self.advance(i, step, readings[i], reception, estimates, record)
        return 0

    def advance(
        self,
        i: int,
        step: int,
        reading: Record,
        reception: Reception | None,
        estimates: Records,
        record: SwarmRecord,
    ) -> None:
        """Advance navigator i by one filter step, by a record of READING and the message of the
        main link that becomes available at it, if any.
        """
        navigator = self.navigators[i]
        speed, heading, depth, *_ = reading.tolist()
        own = OwnMotion(speed, heading, depth, self.custom[i], self.receptions[i])
        fixes = navigator.step(own, reception)
        state = np.array(navigator.state, dtype=np.float64)
        estimates.position[i], estimates.velocity[i] = np.split(state, 2)
        # of the sensors by which the hull is controlled, from a navigator that has them
        biases = getattr(navigator, "biases", (0.0, 0.0))
        estimates.log_bias[i], estimates.compass_bias[i] = biases
        record.state[i, step - 1] = state
        if record.covariance.shape[1] > 0:
            covariance = getattr(navigator, "covariance", np.nan)
            record.covariance[i, step - 1] = covariance
            self._fixes[i].extend(_fixes_of(fixes, step, reception, state, covariance))

    def estimates(self, record: SwarmRecord, follower: int, steps: range) -> Estimates:
        """The same as of `SwarmRecord.estimates`, of the navigator's own kind."""
        fixes = self._fixes[follower].rows
        return record.estimates_with(fixes, follower, steps, self._kinds[follower])


def _fixes_of(
    fixes: object,
    step: int,
    reception: Reception | None,
    state: Floats,
    covariance: npt.ArrayLike,
) -> list[FixRecord]:
    """Fixes that a navigator's `step` gave; of one that gives none, a fix at its estimate."""
    if isinstance(fixes, list) and all(isinstance(fix, FixRecord) for fix in fixes):
        return fixes
    if reception is None:
        return []
    received = not np.isnan(reception.ranges).all()
    variance = float(np.trace(np.broadcast_to(covariance, (4, 4))[:2, :2]))
    return [
        FixRecord(
            step=step,
            position=state[:2].copy(),
            sigma=float(np.sqrt(0.5 * max(variance, 0.0))),
            kind=FixKind.RANGES if received else FixKind.LOST,
        )
    ]
