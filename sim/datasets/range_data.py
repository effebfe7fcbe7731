"""What data sets of ranges have in common: odometry, beacons, ranges, and perhaps the true path."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple, Self

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.failure import LaisnError
from laisn.records import own_arrays

SLOWEST, FASTEST = 0.01, 50.0
"""Mean speeds beyond these are not believed of a vehicle [m/s]."""


class Legs(NamedTuple):
    """A way in pieces, each straight and of even speed."""

    end: Floats
    """When each ends, shape (k,), [s]."""
    speed: Floats
    """Shape (k,), [m/s]."""
    heading: Floats
    """Compass direction of the way, shape (k,), [rad]."""


def compose(first: Floats, second: Floats) -> Floats:
    """Two steps of odometry as one: way ahead and to port [m] and turn anticlockwise [rad], shape (3,) each."""
    c, s = np.cos(first[2]), np.sin(first[2])
    turned = np.array([c * second[0] - s * second[1], s * second[0] + c * second[1], second[2]])
    return np.asarray(first + turned)


def join_equal_times(time: Floats, odometry: Floats) -> tuple[Bools, Floats]:
    """Leave out poses at the time of the one before; their steps join the step that follows.

    Args:
        time: of each pose, shape (n + 1,), [s].
        odometry: steps between them as of `RangeData`, shape (n, 3).

    Returns:
        Which poses stay, shape (n + 1,), and the steps between those.
    """
    kept = np.concatenate([[True], np.diff(time) != 0.0])
    steps, way = [], np.zeros(3)
    for stays, step in zip(kept[1:].tolist(), odometry, strict=True):
        way = compose(way, step)
        if stays:
            steps.append(way)
            way = np.zeros(3)
    return kept, np.array(steps).reshape(-1, 3)


@dataclass(frozen=True, kw_only=True)
class RangeData:
    """A vehicle's odometry over n steps, and its m ranges to b beacons.

    Raises LaisnError if times do not increase, a number is not finite, or a range is to no beacon.
    """

    source: str
    """Where it is from, for messages."""
    start: Floats
    """East, north [m] and compass heading [rad] at the first time, shape (3,)."""
    time: Floats
    """Time of each pose that odometry joins, shape (n + 1,), [s]."""
    odometry: Floats
    """Way ahead and to port [m], and turn anticlockwise [rad], from each pose to the next, shape (n, 3)."""
    beacons: tuple[str, ...]
    """Their names."""
    places: Floats
    """Where they were surveyed: east, north, shape (b, 2), [m]."""
    range_time: Floats
    """When each range was measured, shape (m,), [s]."""
    range_beacon: Ints
    """To which beacon, counted from 0, shape (m,)."""
    ranges: Floats
    """Shape (m,), [m]."""
    range_sigma: float | None
    """Random error of a range as the data set states it [m]; None: it does not."""
    truth: Floats
    """Time [s], east and north [m] of the path to compare with, shape (t, 3); empty if there is none."""
    slip: float | None = None
    """Random walk of the position that the data set states for its odometry, along each axis [m/√s]; None: none."""
    heading_walk: float | None = None
    """Random walk of the heading likewise [rad/√s]."""
    remarks: tuple[str, ...] = ()
    """What was left out or taken for granted, a sentence each."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray) and not np.all(np.isfinite(value)):
                raise LaisnError(f"{self.source}: {item.name} holds a number that is not finite")
        if self.time.size < 3:
            raise LaisnError(f"{self.source}: {self.time.size} poses; odometry needs three at least")
        late = np.flatnonzero(np.diff(self.time) <= 0.0)
        if late.size:
            raise LaisnError(
                f"{self.source}: the time goes from {self.time[late[0]]:.6f} s to {self.time[late[0] + 1]:.6f} s "
                f"between poses {late[0]} and {late[0] + 1}; times must increase"
            )
        if self.time[0] < 0.0 or self.time[-1] > 4e9:
            raise LaisnError(f"{self.source}: times from {self.time[0]:g} s to {self.time[-1]:g} s, expected 0 … 4e9 s")
        if not self.ranges.size:
            raise LaisnError(f"{self.source}: holds no range between the vehicle and a beacon whose place is known")
        own_arrays(self)

    def doubtful(self) -> tuple[str, ...]:
        """A remark if the mean speed is none of a vehicle, as where milliseconds are taken for seconds."""
        way, duration = float(np.hypot(*self.odometry[:, :2].T).sum()), float(self.time[-1] - self.time[0])
        if way < 1.0 or SLOWEST <= way / duration <= FASTEST:
            return ()
        return (f"a way of {way:.0f} m in {duration:g} s, {way / duration:.2g} m/s: are the times in seconds?",)

    def among(self, names: Sequence[str]) -> Self:
        """Data with the ranges to some beacons only, in the order of their names.

        Raises:
            LaisnError: there is no such beacon; the text names those that there are.
        """
        unknown = [name for name in names if name not in self.beacons]
        if unknown or not names:
            raise LaisnError(
                f"{self.source}: no beacon {', '.join(unknown) or 'is named'}; available: {', '.join(self.beacons)}"
            )
        chosen = list(dict.fromkeys(names))
        index = [self.beacons.index(name) for name in chosen]
        kept = np.isin(self.range_beacon, index)
        number = np.full(len(self.beacons), -1, dtype=np.int64)
        number[index] = np.arange(len(index))
        return replace(
            self,
            beacons=tuple(chosen),
            places=self.places[index],
            range_time=self.range_time[kept],
            range_beacon=number[self.range_beacon[kept]],
            ranges=self.ranges[kept],
        )

    def legs(self) -> Legs:
        """The way as odometry has it, cut where a range was measured, so that each has its own place on it."""
        ahead, port, turn = self.odometry.T
        facing = self.start[2] - np.concatenate([[0.0], np.cumsum(turn)])[:-1]
        speed = np.hypot(ahead, port) / np.diff(self.time)
        heading = facing - np.arctan2(port, ahead)
        within = (self.range_time > self.time[0]) & (self.range_time <= self.time[-1])
        end = np.union1d(self.time[1:], self.range_time[within])
        step = np.searchsorted(self.time, end) - 1
        return Legs(end, speed[step], heading[step])
