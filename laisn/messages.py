"""All that a follower receives and measures: the only input of a navigator."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from laisn.arrays import ArrayRecord, Floats, Ints, freeze_arrays, require_shapes


class LeaderMessage(NamedTuple):
    """What the leader broadcasts with a ping (paper, Section 2.2); NaN where it does not
    broadcast a quantity.
    """

    timestamp: float  # time of emission on the leader's clock [s]; 0: not known
    east: float  # position of the leader's body origin [m]
    north: float
    heading: float  # measured heading θ [rad]
    speed: float  # measured speed [m/s]
    depth: float  # measured depth of the leader's depth sensor, which sits at its body origin [m]
    pitch: float = np.nan  # measured pitch, positive nose up [rad]
    roll: float = np.nan  # measured roll, positive starboard down [rad]
    heading_sigma: float = np.nan  # standard deviation that the leader gives for its heading [rad]
    # that of its position along each axis, of what errs anew in each message [m]
    position_sigma: float = np.nan


class Ranges(NamedTuple):
    """Slant ranges [m] to the rear, front and middle transmitter; NaN where nothing was
    received.
    """

    rear: float
    front: float
    middle: float


class OwnMotion(NamedTuple):
    """The follower's own measurements at one filter step."""

    speed: float  # speed log, along the hull [m/s]
    heading: float  # compass θ [rad]
    depth: float  # depth from the pressure sensor [m]; NaN for a missing reading
    custom: Mapping[str, Floats] = MappingProxyType({})
    """Readings of further sensors at this step by their names, shape (c,); NaN where one does not
    read."""
    receptions: Mapping[str, "Reception"] = MappingProxyType({})
    """Messages of further links that become available at this step, by the links' names."""


class Bearing(NamedTuple):
    """Direction of the front transmitter in the follower's hull."""

    azimuth: float  # from forward, positive to starboard [rad]
    elevation: float  # positive upward [rad]


class Channel(NamedTuple):
    """A number that a sensor reads."""

    name: str
    unit: str  # of SI, or rad; "" of a pure number


class SensorHeader(NamedTuple):
    """What is known of the readings of a further sensor beside their numbers."""

    channels: tuple[Channel, ...] = ()  # empty: they have no names
    period: float = 0.0  # from one reading to the next [s]; 0: a filter step

    def steps(self, dt: float) -> int:
        """Filter steps of dt [s] from one reading to the next."""
        return max(round(self.period / dt), 1)

    def names(self, count: int) -> tuple[str, ...]:
        """Of so many channels, by their numbers if they have no names."""
        if self.channels:
            return tuple(channel.name for channel in self.channels)
        return tuple(f"value_{i + 1}" for i in range(count))


class Reception(NamedTuple):
    """A leader message and the ranges measured on its pings."""

    message: LeaderMessage
    ranges: Ranges
    transmitters: Floats | None = None
    """Where the rear, front and middle transmitter were, if the message has them: rows of east,
    north, depth, shape (3, 3), [m]; NaN for one that is not there. None: where the settings place
    them about the leader."""
    custom: Mapping[str, Floats] = MappingProxyType({})
    """Readings of further sensors at the step that takes it up by their names, as of
    `OwnMotion`."""
    content: Mapping[str, Floats] = MappingProxyType({})
    """Readings of the sender's further sensors that the message holds by their names."""
    round_trip: float = np.nan
    """Of an answer to a message that the receiver has sent: measured time from that to the answer,
    less the delay of the answer [s]."""
    offsets: Floats | None = None
    """Of a further link: where the transmitters are in the sender's hull, forward, port and up of
    the position and depth that its messages state, shape (3, 3), [m]; NaN for one that is not
    there. None: `transmitters` says where they are, or the settings do."""

    @property
    def bearing(self) -> Bearing | None:
        """Older name of `custom["bearing"]`; None if there is no such sensor."""
        reading = self.custom.get("bearing")
        if reading is None or np.shape(reading) != (2,):
            return None
        return Bearing(*map(float, reading))


@dataclass(frozen=True, kw_only=True, repr=False)
class LinkMessages(ArrayRecord):
    """Messages of a further link that one vehicle received, m of them; ValueError if shapes
    disagree.
    """

    message_step: Ints  # step k at which a message is available, shape (m,), increasing
    message: Floats  # rows of `LeaderMessage`, shape (m, 10)
    ranges: Floats  # rows of `Ranges`: slant ranges, shape (m, 3), [m]
    # of transmitters that are at rest: east, north, depth, shape (3, 3), [m]; NaN for none
    places: Floats | None = None
    round_trip: Floats | None = None  # as of `Reception`, shape (m,), [s]; None: no answers
    content: Mapping[str, Floats] = field(default_factory=dict)
    """Readings of the sender's further sensors by their names, shape (m, c)."""
    offsets: Floats | None = None  # as of `Reception`

    def __post_init__(self) -> None:
        m = self.message_step.size
        require_shapes(
            self,
            {
                "message_step": (m,),
                "message": (m, len(LeaderMessage._fields)),
                "ranges": (m, 3),
            },
        )
        freeze_arrays(self)

    def part(self, first: int, last: int) -> Self:
        """Messages of steps `first` + 1 … `last`, which become 1 … `last` − `first`."""
        in_span = (self.message_step > first) & (self.message_step <= last)
        return replace(
            self,
            message_step=self.message_step[in_span] - first,
            message=self.message[in_span],
            ranges=self.ranges[in_span],
            round_trip=None if self.round_trip is None else self.round_trip[in_span],
            content={name: rows[in_span] for name, rows in self.content.items()},
        )

    def reception(self, i: int, custom: Mapping[str, Floats]) -> Reception:
        """Message i = 0 … m − 1 with its ranges, and the receiver's readings at its step."""
        return Reception(
            message=LeaderMessage(*self.message[i].tolist()),
            ranges=Ranges(*self.ranges[i].tolist()),
            transmitters=self.places,
            custom=custom,
            content={name: rows[i] for name, rows in self.content.items()},
            round_trip=np.nan if self.round_trip is None else float(self.round_trip[i]),
            offsets=self.offsets,
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class Measurements(ArrayRecord):
    """Everything one follower measured in a mission: n filter steps (k = 1 … n) and m messages.

    Raises ValueError if shapes disagree, `message_step` is not increasing within 1 … n, or a
    duration is not positive.
    """

    dt: float  # filter step Δt [s]
    speed: Floats  # speed log, shape (n,), [m/s]; element k − 1 belongs to step k
    heading: Floats  # compass, shape (n,), [rad]
    depth: Floats  # pressure sensor, shape (n,), [m]; NaN for a missing reading
    message_step: Ints  # step k at which a message is available, shape (m,), increasing
    message: Floats  # rows of `LeaderMessage` in the order of its fields, shape (m, 10)
    ranges: Floats  # rows of `Ranges`: slant ranges, shape (m, 3), [m]
    # how long each filter step took, shape (n,), [s]; None: Δt each
    durations: Floats | None = None
    transmitters: Floats | None = None
    """Transmitters (east, north, depth) of each reception, shape (m, 3, 3), [m]; None: no
    message has them.
    """
    custom: Mapping[str, Floats] = field(default_factory=dict)
    """Readings of further sensors by their names, shape (n, …); NaN where there is none."""
    sensors: Mapping[str, SensorHeader] = field(default_factory=dict)
    """Channels and rates of `custom`, as far as they are declared."""
    links: Mapping[str, LinkMessages] = field(default_factory=dict)
    """What was received of further links by their names."""

    def __post_init__(self) -> None:
        n = self.speed.size
        m = self.message_step.size
        expected: dict[str, tuple[int, ...]] = dict.fromkeys(
            ("speed", "heading", "depth", "durations"), (n,)
        )
        expected |= {
            "message_step": (m,),
            "message": (m, len(LeaderMessage._fields)),
            "ranges": (m, 3),
        }
        expected |= {"transmitters": (m, 3, 3)}
        require_shapes(
            self,
            {name: shape for name, shape in expected.items() if getattr(self, name) is not None},
        )
        if m and (
            self.message_step[0] < 1
            or self.message_step[-1] > n
            or np.any(np.diff(self.message_step) < 1)
        ):
            raise ValueError(f"Measurements.message_step must increase within 1 … {n}")
        if self.durations is not None and not np.all(
            (self.durations > 0) & np.isfinite(self.durations)
        ):
            raise ValueError("Measurements.durations must be positive")
        freeze_arrays(self)

    @property
    def own(self) -> Mapping[str, Floats]:
        """Older name of `custom`."""
        return self.custom

    @property
    def time(self) -> Floats:
        """Time of the filter steps since the start, shape (n,), [s]."""
        if self.durations is None:
            return self.dt * np.arange(1, self.speed.size + 1, dtype=np.float64)
        return np.cumsum(self.durations)

    @property
    def last_depth(self) -> Floats:
        """Depth, of a missing reading (NaN) the last one before it, shape (n,), [m]; NaN before
        the first one.
        """
        missing = np.isnan(self.depth)
        if not missing.any():
            return self.depth
        last = np.maximum.accumulate(np.where(missing, 0, np.arange(self.depth.size)))
        return np.asarray(self.depth[last])

    def part(self, first: int, last: int) -> Self:
        """The measurements of steps `first` + 1 … `last`, which become 1 … `last` − `first`."""
        in_part = (self.message_step > first) & (self.message_step <= last)
        messages = ("message_step", "message", "ranges", "transmitters")
        parts = {
            field.name: value[in_part] if field.name in messages else value[first:last]
            for field in fields(self)
            if isinstance(value := getattr(self, field.name), np.ndarray)
        }
        readings_of_part = {name: readings[first:last] for name, readings in self.custom.items()}
        return replace(
            self,
            **parts | {"message_step": parts["message_step"] - first},
            custom=readings_of_part,
            links={name: messages.part(first, last) for name, messages in self.links.items()},
        )

    def with_links(self, names: Collection[str]) -> Self:
        """The measurements with the messages of these further links alone."""
        links = {name: messages for name, messages in self.links.items() if name in names}
        return replace(self, links=links)

    def require_fresh(self, step: int, dt: float) -> None:
        """Raise ValueError unless a navigator with this filter step [s], now at that step, can
        navigate on them.
        """
        if step:
            raise ValueError(f"this navigator is at step {step} already; a mission needs a new one")
        if abs(self.dt - dt) > 1e-9:
            raise ValueError(f"measurements every {self.dt:g} s, but the filter steps {dt:g} s")

    def steps(self) -> Iterator[tuple[OwnMotion, Reception | None]]:
        """Own motion and, where a message arrived, its reception: one pair a step, k = 1 … n."""
        arrival = dict(zip(self.message_step.tolist(), range(self.message_step.size), strict=True))
        further = self._further_arrivals()
        # one by one, as all numbers of a mission as Python objects would take more memory than its
        # arrays
        columns = (map(float, column) for column in (self.speed, self.heading, self.depth))
        for k, motion in enumerate(map(OwnMotion, *columns), start=1):
            i = arrival.get(k)
            custom = {name: rows[k - 1] for name, rows in self.custom.items()}
            reading = motion._replace(custom=custom) if custom else motion
            if k in further:
                receptions = {
                    name: self.links[name].reception(j, custom) for name, j in further[k].items()
                }
                reading = reading._replace(receptions=receptions)
            yield reading, None if i is None else self.reception(i)

    def _further_arrivals(self) -> dict[int, dict[str, int]]:
        """Numbers of the messages of further links by step and name."""
        arrivals: dict[int, dict[str, int]] = {}
        for name, messages in self.links.items():
            for j, step in enumerate(messages.message_step.tolist()):
                arrivals.setdefault(step, {})[name] = j
        return arrivals

    def reception(self, i: int) -> Reception:
        """Message i = 0 … m − 1 with its ranges, and the readings of `custom` at its step."""
        places = None if self.transmitters is None else self.transmitters[i]
        custom = {name: rows[self.message_step[i] - 1] for name, rows in self.custom.items()}
        message = LeaderMessage(*self.message[i].tolist())
        ranges = Ranges(*self.ranges[i].tolist())
        return Reception(message, ranges, places, custom)
