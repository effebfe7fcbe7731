"""What followers measure under way, recorded step by step."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, copy_values
from laisn.messages import LeaderMessage, LinkMessages, Measurements, SensorHeader
from laisn.spilled import spillable_zeros
from sim.sensing.reception import NO_MESSAGE, Inbox


class MeasurementRecord(NamedTuple):
    """What f followers read and receive, with room for n filter steps and q messages of each."""

    own: Floats  # speed [m/s], heading [rad] and depth [m] at each step, shape (f, n, 3)
    message_step: Ints  # filter step at which each message is in, shape (f, q)
    message: Floats  # rows of `LeaderMessage`, shape (f, q, 10)
    ranges: Floats  # rows of `laisn.messages.Ranges`, shape (f, q, 3), [m]
    messages: Ints  # how many are in so far, shape (f,)

    @classmethod
    def empty(cls, followers: int, steps: int, message_every: int) -> Self:
        """Room for a mission of so many filter steps, with a message every so many of them."""
        q = steps // message_every + 1
        return cls(
            own=spillable_zeros((followers, steps, 3)),
            message_step=spillable_zeros((followers, q), np.int64),
            message=spillable_zeros((followers, q, len(LeaderMessage._fields))),
            ranges=spillable_zeros((followers, q, 3)),
            messages=np.zeros(followers, dtype=np.int64),
        )

    def within(self, follower: int, steps: int) -> slice:
        """Which messages are in by the first steps, of a follower."""
        arrived = self.message_step[follower, : self.messages[follower]]
        return slice(0, int(np.searchsorted(arrived, steps, side="right")))

    def messages_of(self, follower: int, steps: int, offsets: Floats) -> LinkMessages:
        """The messages of the first steps, as of a further link with transmitters at `offsets`."""
        messages = self.within(follower, steps)
        return LinkMessages(
            message_step=self.message_step[follower, messages],
            message=self.message[follower, messages],
            ranges=self.ranges[follower, messages],
            offsets=offsets,
        )

    def measurements(
        self,
        follower: int,
        steps: range,
        dt: float,
        custom: Mapping[str, Floats],
        headers: Mapping[str, SensorHeader],
        places: Floats | None = None,
        links: Mapping[str, LinkMessages] = MappingProxyType({}),
    ) -> Measurements:
        """All that a follower measured in filter steps `steps.start` + 1 … `steps.stop` of dt [s],
        with readings of further sensors and their headers, the places of beacons, shape (3, 3),
        [m], and messages of further links.
        """
        arrived = self.message_step[follower, : self.messages[follower]]
        messages = slice(
            *np.searchsorted(arrived, [steps.start, steps.stop], side="right").tolist()
        )
        rows = slice(steps.start, steps.stop)
        count = messages.stop - messages.start
        return Measurements(
            dt=dt,
            speed=self.own[follower, rows, 0],
            heading=self.own[follower, rows, 1],
            depth=self.own[follower, rows, 2],
            message_step=self.message_step[follower, messages] - steps.start,
            message=self.message[follower, messages],
            ranges=self.ranges[follower, messages],
            transmitters=None if places is None else np.tile(places, (count, 1, 1)),
            custom=custom,
            sensors=headers,
            links=dict(links),
        )


@compiled
def record_step(
    record: MeasurementRecord, inbox: Inbox, step: int, follower: int, reading: Floats
) -> None:
    """Record what a follower reads at a filter step, and the message that is in, if there is
    one.
    """
    for i in range(3):
        record.own[follower, step - 1, i] = reading[i]
    if inbox.outcome[follower] == NO_MESSAGE:
        return
    m = record.messages[follower]
    record.messages[follower] += 1
    record.message_step[follower, m] = step
    copy_values(inbox.message_values[follower], record.message[follower, m])
    copy_values(inbox.ranges[follower], record.ranges[follower, m])
