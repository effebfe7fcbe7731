"""Time in the log: the mission's seconds as nanoseconds since 1970, from the scenario's epoch."""

from datetime import UTC, datetime, timedelta

import numpy as np
import numpy.typing as npt
from foxglove.messages import Timestamp

from laisn.arrays import Ints
from laisn.failure import LaisnError


class Clock:
    """Converts times since the start of the mission [s] to times since 1970 [ns].

    Raises LaisnError if the epoch lies before 1970.
    """

    def __init__(self, epoch: str) -> None:
        since_1970 = datetime.fromisoformat(epoch) - datetime(1970, 1, 1, tzinfo=UTC)
        self.epoch_ns = since_1970 // timedelta(microseconds=1) * 1000
        # a Foxglove timestamp counts seconds in 32 bits, which end in 2106
        if not 0 <= self.epoch_ns < (2**32 - 10**8) * 10**9:
            raise LaisnError(f"epoch {epoch} lies outside 1970 … 2102, the years that a log can hold")

    def ns(self, time_s: npt.ArrayLike) -> Ints:
        """Times since 1970 [ns], of the same shape."""
        return np.asarray(self.epoch_ns + np.rint(np.asarray(time_s, dtype=np.float64) * 1e9).astype(np.int64))


def timestamp(time_ns: int) -> Timestamp:
    """A time since 1970 as Foxglove's messages hold it."""
    return Timestamp(sec=time_ns // 10**9, nsec=time_ns % 10**9)
