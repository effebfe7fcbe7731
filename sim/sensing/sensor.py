"""What a sensor is: its declaration, what it sees, and how it is read.

Sensors of this project and of users' are declared alike: name, channels with units, noise and rate
are attributes of a class; `true` gives what it would read without errors, `read` adds the errors.
Compiled code calls the methods of those that every follower and the leader have
(`sim.sensing.sensors`); Python calls those that a scenario lists in `[[sensors.custom]]`, by the
`SensorDriver` here, in closed loops and finished missions alike.
"""

import inspect
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, ClassVar, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.messages import Channel, SensorHeader
from laisn.plugins import calling, class_and_file
from sim.attitude import Vector, body_point_in_world, heading_pitch_roll, rotated
from sim.sensing import noise
from sim.trajectory import speed_through_water
from sim.water.environment import Environment

CUSTOM_STREAMS = range(16, 64)
"""Numbers of noise that sensors of users' may have."""
_REQUIRED = ("name", "stream", "true", "read")
_NAME_LETTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-")
_IDENTIFIER = re.compile("[A-Za-z][A-Za-z0-9_]*")


class VehicleState(NamedTuple):
    """True state of a vehicle at an instant, or at n: then each array has them along its first
    axis.
    """

    time: Floats  # [s]
    position: Floats  # of the body origin in the world, shape (3,), [m]
    quaternion: Floats  # attitude from body to world, (w, x, y, z), shape (4,)
    velocity: Floats  # of the body origin in the world, shape (3,), [m/s]
    angular_velocity: Floats  # in the body frame, shape (3,), [rad/s]
    water_velocity: Floats  # in the world, shape (3,), [m/s]
    hydrophone: Floats  # in the world, shape (3,), [m]
    # where received pings left, of rear, front, middle transmitter, shape (3, 3), [m]; else NaN
    source: Floats
    heading: Floats  # clockwise from north [rad]
    pitch: Floats  # positive nose up [rad]
    roll: Floats  # positive starboard down [rad]
    speed: Floats  # through the water, along the hull [m/s]
    depth: Floats  # of the pressure sensor [m]
    # index of the follower that carries the sensor; the leader counts as follower 0
    follower: int

    @classmethod
    def of_motion(
        cls,
        time: Floats,
        motion: tuple[Floats, Floats, Floats],
        depth_sensor: Sequence[float] | Floats,
        places: tuple[Floats, Floats],
        follower: int,
    ) -> "VehicleState":
        """The state at n instants.

        Args:
            time: shape (n,), [s].
            motion: poses, twists and velocities of the water, shapes (n, 7), (n, 6) and (n, 3).
            depth_sensor: its place in the hull, shape (3,), [m].
            places: of the hydrophone, shape (n, 3), and of the sources, shape (n, 3, 3), [m].
            follower: index of the follower; 0 of the leader, too.
        """
        pose, twist, water = motion
        heading, pitch, roll = heading_pitch_roll(pose[:, 3:])
        up = body_point_in_world(pose.T, np.asarray(depth_sensor))[2]
        return cls(
            time=time,
            position=pose[:, :3],
            quaternion=pose[:, 3:],
            velocity=twist[:, :3],
            angular_velocity=twist[:, 3:],
            water_velocity=water,
            hydrophone=places[0],
            source=places[1],
            heading=heading,
            pitch=pitch,
            roll=roll,
            speed=np.asarray(speed_through_water(pose.T, twist.T, water.T)),
            depth=-np.asarray(up),
            follower=follower,
        )

    def at(self, k: int) -> "VehicleState":
        """The state at one of n instants."""
        instant = {name: array[k] for name, array in zip(self._fields[:-1], self[:-1], strict=True)}
        return self._replace(**instant)

    def in_hull(self, vector: Vector | Floats) -> Vector:
        """Forward, port and up components of a vector of the world; of a state at one instant."""
        w, x, y, z = self.quaternion
        in_hull: Vector = rotated((w, -x, -y, -z), vector)
        return in_hull


class Sensor:
    """A sensor. Classes of users' need not derive from this one, which has the defaults.

    The fields of a class, which is a dataclass, are keys of its table in a scenario, in SI units
    and radians.
    """

    name: ClassVar[str]
    channels: ClassVar[Mapping[str, str]] = {}
    """Names of its numbers and their units: {"forward": "m/s", "altitude": "m"}."""
    stream: ClassVar[int]
    """Number of its noise: 16 … 63 of a user's, for no other sensor."""
    normals: ClassVar[int] = 2
    """How many standard normals each reading takes."""
    acoustic: ClassVar[bool] = False
    """Whether it reads pings, and nothing where all pings of a message are lost."""
    period: float = 0.0
    """Time from one reading to the next, a multiple of the filter step; 0: that step [s]."""

    def true(self, state: Any, environment: Any) -> Any:
        """What it would read without random errors and biases, a number for each channel; NaN
        where it reads nothing.
        """
        raise NotImplementedError

    def read(self, true: Any, draws: Any) -> Any:
        """What it reads, by values of `true` and standard normals, shape (normals,)."""
        raise NotImplementedError


def _is_of(value: Any, kind: Any) -> bool:
    """Whether a value is a number of a kind, and no truth value."""
    return isinstance(value, kind) and not isinstance(value, bool)


def header_of(sensor: Any) -> SensorHeader:
    """Channels and rate of a sensor by its declaration; LaisnError naming what is wrong in it."""
    kind = class_and_file(sensor)
    missing = [name for name in _REQUIRED if not hasattr(sensor, name)]
    if missing:
        raise LaisnError(f"sensor {kind} has no {', '.join(missing)}")
    declared = getattr(sensor, "channels", Sensor.channels)
    if not isinstance(declared, Mapping):
        raise LaisnError(
            f"sensor {kind}: `channels` is {declared!r:.60}; expected names and their units, as in "
            '{"altitude": "m"}'
        )
    name = sensor.name
    if not isinstance(name, str) or not name or not _NAME_LETTERS.issuperset(name):
        raise LaisnError(
            f"sensor {kind}: name = {name!r:.60}; expected letters, digits, '_' and '-' alone"
        )
    wrong = [channel for channel in map(str, declared) if not _IDENTIFIER.fullmatch(channel)]
    if wrong:
        raise LaisnError(
            f"sensor {kind}: channel {wrong[0]!r}; expected letters, digits and '_', the first a "
            "letter"
        )
    period = getattr(sensor, "period", Sensor.period)
    if not _is_of(period, int | float) or not 0.0 <= period < math.inf:
        raise LaisnError(f"sensor {kind}: `period` is {period!r:.60}; expected seconds, 0 or more")
    normals = getattr(sensor, "normals", Sensor.normals)
    if not _is_of(normals, int) or normals < 0:
        raise LaisnError(
            f"sensor {kind}: `normals` is {normals!r:.60}; expected how many normals a reading "
            "takes, a whole number, 0 or more"
        )
    acoustic = getattr(sensor, "acoustic", Sensor.acoustic)
    if not isinstance(acoustic, bool):
        raise LaisnError(f"sensor {kind}: `acoustic` is {acoustic!r:.60}; expected True or False")
    channels = tuple(Channel(str(name), str(unit)) for name, unit in declared.items())
    return SensorHeader(channels=channels, period=float(period))


@dataclass(frozen=True, kw_only=True)
class SensorDriver:
    """Reads a sensor of a scenario's `[[sensors.custom]]`, at filter steps.

    Also one that reads arrays: `true(state)` without an environment gets the states at n instants
    and gives n rows, and `read(true, normals)` rows of them.
    """

    sensor: Any
    dt: float  # filter step [s]

    def __post_init__(self) -> None:
        if not (self.header.channels or self._by_rows):
            raise LaisnError(
                f"sensor {class_and_file(self.sensor)} has no channels; expected their names and "
                'units, as in channels = {"altitude": "m"}'
            )
        steps = self.header.period / self.dt
        if abs(steps - round(steps)) > 1e-6:
            raise LaisnError(
                f"sensor {class_and_file(self.sensor)}: period = {self.header.period:g} s is no "
                f"multiple of filter_step_s = {self.dt:g} of the scenario's [timing]"
            )

    @property
    def kind(self) -> str:
        """Name of its class."""
        return type(self.sensor).__name__

    @property
    def name(self) -> str:
        """Of its readings."""
        return str(self.sensor.name)

    @cached_property
    def header(self) -> SensorHeader:
        """Its channels and rate."""
        return header_of(self.sensor)

    @property
    def is_custom(self) -> bool:
        """Whether its class is the user's own, and none of this project."""
        return type(self.sensor).__module__.partition(".")[0] != __package__.partition(".")[0]

    @cached_property
    def acoustic(self) -> bool:
        """Whether it reads pings."""
        return bool(getattr(self.sensor, "acoustic", Sensor.acoustic))

    @cached_property
    def every(self) -> int:
        """Filter steps from one reading to the next."""
        return self.header.steps(self.dt)

    @cached_property
    def _normals(self) -> int:
        normals: int = getattr(self.sensor, "normals", Sensor.normals)
        return normals

    @cached_property
    def _by_rows(self) -> bool:
        """Whether its methods take and give a row for each of n instants."""
        try:
            parameters = inspect.signature(self.sensor.true).parameters
        except (TypeError, ValueError):
            return False
        return len(parameters) == 1

    def _numbers(
        self, values: Any, method: str, times: Floats, rows: tuple[int, ...] = ()
    ) -> Floats:
        """What a method gave as an array, for instants [s]; LaisnError if it is none of the
        expected shape, or a number of it is infinite.
        """
        expected = "a number for each of its channels"
        if rows:
            expected = f"numbers, a row for each of {rows[0]} filter steps"
        try:
            numbers: Floats = np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            numbers = np.empty(0)
        names = ", ".join(channel.name for channel in self.header.channels)
        names_text = f" ({names})" if names else ""
        gave = f"sensor {class_and_file(self.sensor)}: `{method}` gave"
        channels = len(self.header.channels)
        wrong = numbers.shape[: len(rows)] != rows or numbers.ndim < 1
        if wrong or (channels and numbers.shape[len(rows) :] != (channels,)):
            raise LaisnError(f"{gave} {values!r:.60}; expected {expected}{names_text}")
        by_instant = numbers.reshape(len(times), -1)
        infinite = np.flatnonzero(np.isinf(by_instant).any(axis=1))
        if infinite.size:
            row = by_instant[infinite[0]].tolist()
            raise LaisnError(
                f"{gave} {row!r:.60} at {times[infinite[0]]:g} s; expected {expected}{names_text}, "
                "finite, or NaN for no reading"
            )
        return numbers

    def is_due(self, step: int) -> bool:
        """Whether it reads at a filter step."""
        return step % self.every == 0

    def draws(self, seed: int, run: int, follower: int, steps: Ints) -> Floats:
        """Standard normals of its readings at filter steps, shape (n, normals)."""
        stream = noise.STREAMS * follower + self.sensor.stream
        # a block has two normals of each step
        blocks = [
            noise.normals(seed, run, stream, steps, block)
            for block in range(max(math.ceil(self._normals / 2), 1))
        ]
        return np.hstack(blocks)[:, : self._normals]

    def _due(self, states: VehicleState, first: int) -> Iterator[int]:
        """Indices of those of n states, the first at a filter step, at which it reads."""
        for i in range(len(states.time)):
            is_heard = not self.acoustic or not np.isnan(states.source[i]).all()
            if self.is_due(first + i) and is_heard:
                yield i

    def true(self, states: VehicleState, environment: Environment, first: int) -> Floats:
        """True values at n filter steps, the first of which has this number, shape (n, c); NaN
        where it does not read.
        """
        n = len(states.time)
        with calling(f"sensor {class_and_file(self.sensor)}: true"):
            if self._by_rows:
                rows = self._numbers(self.sensor.true(states), "true", states.time, (n,))
                rows[[i for i in range(n) if not self.is_due(first + i)]] = np.nan
                return rows
            values: dict[int, Floats] = {}
            for i in self._due(states, first):
                result = self.sensor.true(states.at(i), environment)
                values[i] = self._numbers(result, "true", states.time[i : i + 1])
        true = np.full((n, len(self.header.channels)), np.nan)
        for i, row in values.items():
            true[i] = row
        return true

    def read(self, true: Floats, draws: Floats, first: int) -> Floats:
        """Readings of true values, shape (n, c), by draws, shape (n, normals), at filter steps, the
        first of which has this number; NaN where there is no true value.
        """
        times: Floats = self.dt * np.arange(first, first + len(draws), dtype=np.float64)
        with calling(f"sensor {class_and_file(self.sensor)}: read"):
            if self._by_rows:
                result = self.sensor.read(true, draws)
                return self._numbers(result, "read", times, (len(draws),))
            readings = np.full(true.shape, np.nan)
            for i in np.flatnonzero(~np.isnan(true).all(axis=1)).tolist():
                result = self.sensor.read(true[i], draws[i])
                readings[i] = self._numbers(result, "read", times[i : i + 1])
        return readings


def name_in_fields(sensor: str) -> str:
    """What fields of logs call a sensor: names of fields hold no "-"."""
    return sensor.replace("-", "_")


def require_distinct_fields(drivers: Iterable[SensorDriver]) -> None:
    """LaisnError if two sensors, be it of different vehicles, have names that are one name in the
    fields of logs: a message with readings of both would hold those of one.
    """
    named: dict[str, SensorDriver] = {}
    for driver in drivers:
        other = named.setdefault(name_in_fields(driver.name), driver)
        if other.name != driver.name:
            raise LaisnError(
                f"sensors.custom: {other.name!r} ({other.kind}) and {driver.name!r} "
                f"({driver.kind}) are both {name_in_fields(driver.name)!r} in the fields of logs; "
                "give one of them a name that differs in more than '-' and '_'"
            )


def require_distinct(drivers: Sequence[SensorDriver]) -> None:
    """LaisnError if two sensors have one name, also in the fields of logs, or one stream of noise,
    or a stream is not there.
    """
    require_distinct_fields(drivers)
    for first, second in combinations(drivers, 2):
        if first.name == second.name:
            raise LaisnError(
                f"sensors.custom: {first.kind} and {second.kind} are both named {first.name!r}; "
                "expected different names"
            )
        if first.sensor.stream == second.sensor.stream:
            raise LaisnError(
                f"sensors.custom: {first.kind} and {second.kind} both have stream = "
                f"{first.sensor.stream}; expected another one of {CUSTOM_STREAMS[0]} … "
                f"{CUSTOM_STREAMS[-1]}"
            )
    for driver in drivers:
        stream = driver.sensor.stream
        # numbers below are those of the project's own sensors, whose noise another would repeat
        if driver.is_custom and (not isinstance(stream, int) or stream not in CUSTOM_STREAMS):
            raise LaisnError(
                f"sensor {class_and_file(driver.sensor)}: stream = {stream!r}; expected "
                f"{CUSTOM_STREAMS[0]} … {CUSTOM_STREAMS[-1]}"
            )
