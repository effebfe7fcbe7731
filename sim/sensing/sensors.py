"""The sensors: what each would read without errors, and its readings.

One set of functions serves one instant and a finished mission: compiled code calls them with numbers and records, under
way (`sim.sensing.instant`); Python calls them with arrays over filter steps or messages, in dictionaries by the names
of readings (`sim.sensing.observation`).
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from laisn.arrays import Floats
from laisn.compiled import elementwise, select
from sim.geometry.attitude import carried
from sim.sensing.drift import biased
from sim.sensing.errors import heading_reading, path_taken, plain_reading, range_readings, speed_reading
from sim.sensing.noise import Address, Stream, normals_at, uniforms_at
from sim.trajectory import Body, speed_through_water

# compiled code holds numbers, not the members of an enum
_ECHO, _RANGE_UNIFORM, _RANGE_SCALE = int(Stream.ECHO), int(Stream.RANGE_UNIFORM), int(Stream.RANGE_SCALE)


class Sensor(NamedTuple):
    """A sensor that reads one number at a time."""

    name: str
    """Of its readings."""
    stream: Stream
    """Of its noise."""
    column: int
    """Which of the two normals of a step is its own; sensors of one stream stand side by side in their order."""
    bias: str
    """Field of `SensorErrors`; "": it has none."""
    sigma: str
    """Field of `SensorErrors`; "": it has none."""
    read: Callable[..., Any]
    """Reading from the true value, bias, standard deviation and normal; numbers or arrays."""


OWN = (
    Sensor("speed", Stream.OWN_MOTION, 0, "speed_bias", "speed_sigma", speed_reading),
    Sensor("heading", Stream.OWN_MOTION, 1, "heading_bias", "heading_sigma", heading_reading),
    Sensor("depth", Stream.DEPTH, 0, "", "depth_sigma", plain_reading),
)
"""A follower's own sensors that its navigator reads."""
STEERING = (
    Sensor("pitch", Stream.TILT, 0, "", "tilt_sigma", plain_reading),
    Sensor("turning", Stream.GYRO, 0, "", "gyro_sigma", plain_reading),
    Sensor("pitching", Stream.GYRO, 1, "", "gyro_sigma", plain_reading),
)
"""Those that only steer it."""
LEADER = (
    Sensor("speed", Stream.LEADER_MOTION, 0, "leader_speed_bias", "", speed_reading),
    Sensor("heading", Stream.LEADER_MOTION, 1, "leader_heading_bias", "leader_heading_sigma", heading_reading),
    Sensor("depth", Stream.LEADER_DEPTH, 0, "", "leader_depth_sigma", plain_reading),
)
"""The leader's; of its attitude see `read_attitude`."""

Reader = Callable[[Any, Address, Any, Any, tuple[float, float]], None]
"""Reads a list of sensors: errors, address of the noise, true values and readings by name (they may be the same), and
NO_DRAW."""
NO_DRAW = 0.0, 0.0


def _parameter(name: str) -> Callable[[Any], float]:
    """A function that gives a field of the errors, or zero for ""."""
    if not name:
        return elementwise(lambda e: 0.0)
    return elementwise(lambda e: getattr(e, name))


def reader_of(sensors: Sequence[Sensor]) -> Reader:
    """A function that reads a list of sensors, in Python and in compiled code, which unrolls the list."""
    if not sensors:
        return elementwise(lambda e, address, true, readings, drawn: None)
    name, stream, column, bias_name, sigma_name, read = sensors[0]
    bias, sigma, read_others = _parameter(bias_name), _parameter(sigma_name), reader_of(sensors[1:])
    # compiled code holds numbers, not the members of an enum
    number = int(stream)

    @elementwise
    def read_all(e: Any, address: Address, true: Any, readings: Any, drawn: tuple[float, float]) -> None:
        if column == 0:
            drawn = normals_at(address, number)
        readings[name] = read(true[name], bias(e), sigma(e), drawn[column])
        read_others(e, address, true, readings, drawn)

    return read_all


read_own, read_follower, read_leader = reader_of(OWN), reader_of((*OWN, *STEERING)), reader_of(LEADER)


@elementwise
def true_own(e: Any, follower: int, time: Any, body: Body, depth_sensor: Floats, true: Any) -> None:
    """What a follower's own sensors read without random errors and constant biases, by name.

    Args:
        e: record or tuple of `sim.sensing.errors`.
        follower: its index.
        time: [s].
        body: its motion.
        depth_sensor: offset of its pressure sensor, shape (3,), [m].
        true: out.
    """
    speed = speed_through_water(body.pose, body.twist, body.water)
    true["speed"], true["heading"] = biased(e, follower, time, speed, body.heading)
    true["depth"] = -carried(body.pose, depth_sensor)[2]
    true["pitch"], true["turning"], true["pitching"] = body.pitch, body.twist[5], body.twist[4]


@elementwise
def true_message(e: Any, time: Any, leader: Body, true: Any) -> None:
    """What a message of the leader holds without random errors and constant biases, by name, but for its attitude.

    Arguments as of `true_own`.
    """
    true["timestamp"] = time
    true["east"] = leader.pose[0] + e.leader_drift_east * time
    true["north"] = leader.pose[1] + e.leader_drift_north * time
    true["heading"] = leader.heading
    true["speed"] = speed_through_water(leader.pose, leader.twist, leader.water)
    true["depth"] = -leader.pose[2]


@elementwise
def read_attitude(e: Any, true: Any, offset: Any, fluctuation: Any) -> Any:
    """Pitch and roll that the leader broadcasts [rad].

    Args:
        e: record or tuple of `sim.sensing.errors`.
        true: pitch and roll as measured, but for random errors [rad].
        offset: normals of the errors that a run keeps.
        fluctuation: values of the Gauss–Markov processes, of unit variance.
    """
    constant, sigma = e.leader_attitude_offset_sigma, e.leader_tilt_sigma
    pitch = plain_reading(true[0], 0.0, constant, offset[0])
    roll = plain_reading(true[1], 0.0, constant, offset[1])
    return plain_reading(pitch, 0.0, sigma, fluctuation[0]), plain_reading(roll, 0.0, sigma, fluctuation[1])


@elementwise
def paths_taken(e: Any, sent: Address) -> Any:
    """`Path` that a receiver takes for the direct one from the rear, front and middle transmitter."""
    drawn = uniforms_at(sent, _ECHO)
    front, middle = (drawn[0], drawn[0]) if e.common_echoes else (drawn[1], drawn[2])
    return path_taken(drawn[0], e), path_taken(front, e), path_taken(middle, e)


@elementwise
def _along(true: Any, path: Any) -> Any:
    """Of the ranges by each path the one by this path."""
    return select(path == 0, true[0], select(path == 1, true[1], true[2]))


@elementwise
def read_ranges(e: Any, transmitters: int, sent: Address, received: Address, true: Any) -> Any:
    """Ranges of messages that are not lost, to the rear, front and middle transmitter [m].

    Args:
        e: record or tuple of `sim.sensing.errors`.
        transmitters: how many of the leader's the follower uses.
        sent: address of the noise at the filter step at which a message is sent.
        received: at the one at which it is received.
        true: range by each path from each transmitter, shape (3 transmitters, 3 paths, …), [m]; NaN where nothing
            is received.
    """
    paths = 0, 0, 0
    if e.surface_echo_probability + e.bottom_echo_probability > 0.0:
        paths = paths_taken(e, sent)
    ranges = _along(true[0], paths[0]), _along(true[1], paths[1]), _along(true[2], paths[2])
    drawn, normal = uniforms_at(received, _RANGE_UNIFORM), normals_at(received, _RANGE_SCALE)[0]
    return range_readings(e, transmitters, ranges, drawn, normal)
