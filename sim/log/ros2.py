"""A flight as a ROS 2 bag that Humble and every later release open.

Frames are those of REP 103 and 105: `map` is east, north, up; `NAME/odom`, which the truth does not
move in it; `NAME/base_link` is forward, port, up, and sensors are fixed in it. A compass heading ψ
is a yaw of 90° − ψ. Truth and estimate are topics and frames of their own. Stamps are the log's
times, the scenario's epoch plus mission time.

Covariances of the estimate are the filter's; its depth and heading are readings. Covariances of
readings are mean squares of the scenario's errors, biases included. An angle that nothing measures
has the variance of an even distribution over a turn.
"""

import math
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints
from laisn.estimates import Estimates
from laisn.messages import LinkMessages, Measurements, Ranges, SensorHeader
from sim import attitude
from sim.flight import FlightRecord
from sim.log.bag_folder import VIEW, require_replaceable
from sim.log.contents import Contents, LogError
from sim.log.reader import read
from sim.log.ros2_encoding import LINK_RECEPTION_TYPE, Template, typestore
from sim.log.ros2_robot import urdf
from sim.log.ros2_view import rviz_view
from sim.log.schema import (
    BEACON_RECEPTION,
    DETAILS,
    ERROR,
    FIX,
    PLACES,
    RECEPTION,
    ROUND_TRIP,
    Clock,
)
from sim.log.tum import estimated_poses, estimates_of
from sim.scenario.parts import MissionPlan, SensingSettings
from sim.scenario.sensors import Sensors
from sim.water.assembly import density_of
from sim.water.waves import GRAVITY

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_BAG_VERSION: Literal[8] = 8  # later ones write what Humble cannot read
_BLOCK_NS = 20 * 10**9  # messages of this time are in memory at once [ns]
SURFACE_PRESSURE_PA = 101325.0  # standard atmosphere
_UNKNOWN_ANGLE = math.pi**2 / 3.0  # variance of an angle that may be any [rad²]
_UNKNOWN_SPEED = 1e6  # variance of a speed that is not measured [m²/s²]
_ULTRASOUND = 0  # radiation_type of sensor_msgs/Range
_POSITION_COVARIANCE_KNOWN = 3  # position_covariance_type of sensor_msgs/NavSatFix
_JPEG_QUALITY = 80
_MAP = "map"
_CAMERA = "/camera"
_EVENTS = "/log"
_LEVELS = {"DEBUG": 10, "INFO": 20, "WARNING": 30, "ERROR": 40, "FATAL": 50}
_DIAGONAL = range(0, 36, 7)  # in a covariance of six by six, by rows

RECEPTION_TYPE = "laisn_msgs/msg/Reception"
PLACED_RECEPTION_TYPE = "laisn_msgs/msg/PlacedReception"
READING_TYPE = "laisn_msgs/msg/Reading"


def _definition(numbers: Sequence[str], others: str = "") -> str:
    """The definition of a message with a header and numbers."""
    return "".join(["std_msgs/Header header\n", *(f"float64 {name}\n" for name in numbers), others])


_DEFINITIONS = {
    RECEPTION_TYPE: _definition(RECEPTION.fields),
    PLACED_RECEPTION_TYPE: _definition(BEACON_RECEPTION.fields),
    LINK_RECEPTION_TYPE: _definition(
        [*BEACON_RECEPTION.fields, ROUND_TRIP],
        "float64[] content\nstring[] channels\nstring[] units\n",
    ),
    READING_TYPE: _definition([], "float64[] values\nstring[] channels\nstring[] units\n"),
}
_KEPT_IN_LOGS = (FIX.topic, ERROR.topic, *(details.topic for details in DETAILS.values()))
"""Ends of the topics of a log that bags have not: what a navigator tells of its fixes, and errors
against the truth.
"""

Rows = Callable[[slice], Sequence[bytes]]
"""Serialised messages of a part of a topic's times."""


@dataclass(frozen=True, kw_only=True)
class RosTopic:
    """Messages of one topic."""

    name: str
    type_name: str
    time_ns: Ints  # since 1970, increasing, shape (n,), [ns]
    rows: Rows
    latched: bool = False  # kept for subscribers that come late


@dataclass(frozen=True, kw_only=True)
class _FlightContext:
    """A flight, and what all its topics need."""

    flight: FlightRecord
    store: "Typestore"
    clock: Clock
    names: tuple[str, ...]  # of vehicles, the leader's first, as topics may have them

    def measurements(self, vehicle: int) -> Measurements:
        """What a vehicle by its number measured; a leader that has sensed under way."""
        if vehicle:
            return self.flight.measurements[vehicle - 1]
        assert self.flight.leader is not None
        return self.flight.leader.measurements

    def estimates(self, vehicle: int) -> Estimates:
        """What a vehicle that navigates has concluded."""
        estimates = estimates_of(self.flight, vehicle)
        assert estimates is not None
        return estimates

    def errors(self, vehicle: int) -> Sensors:
        """Errors of a vehicle's own sensors."""
        sensing = SensingSettings.of(self.flight.scenario)
        return sensing.sensors_of(vehicle - 1) if vehicle else sensing.sensors_of_leader()

    def frame_of_hydrophone(self, vehicle: int) -> str:
        """The frame of what a vehicle estimates: its hydrophone, or the hull of a leader without
        one.
        """
        sites = self.flight.trajectory.site_names
        is_there = f"{self.flight.trajectory.names[vehicle]}/hydrophone" in sites
        return f"{self.names[vehicle]}/{'hydrophone' if is_there else 'base_link'}"

    @property
    def headers(self) -> dict[str, SensorHeader]:
        """Channels and rates of the further sensors of all vehicles by their names."""
        headers = dict[str, SensorHeader]()
        for vehicle in self.sensing_vehicles:
            headers |= self.measurements(vehicle).sensors
        return headers

    @property
    def sensing_vehicles(self) -> list[int]:
        """Numbers of the vehicles that have sensed under way."""
        first = 1 if self.flight.leader is None else 0
        return [*range(first, len(self.flight.measurements) + 1)]


def _ros_names(names: Sequence[str]) -> tuple[str, ...]:
    """Names of vehicles or sensors with the characters that topics may have, each of them once."""
    topic_names = list[str]()
    for name in names:
        plain = re.sub(r"[\W_]+", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z_]", plain) else f"v{plain}"
        number = 1
        unique = plain
        while unique in topic_names:
            number += 1
            unique = f"{plain}_{number}"
        topic_names.append(unique)
    return tuple(topic_names)


def _register(store: "Typestore") -> None:
    from rosbags.typesys import get_types_from_msg

    for name, definition in _DEFINITIONS.items():
        store.register(get_types_from_msg(definition, name))


def _numbers(
    context: _FlightContext,
    name: str,
    type_name: str,
    time_ns: Ints,
    example: Mapping[str, Any],
    columns: Mapping[str, npt.ArrayLike],
    stamped: Sequence[str] = ("header.stamp",),
    *,
    latched: bool = False,
) -> RosTopic:
    """Messages that differ in numbers alone; columns have n rows each."""
    template = Template(context.store, type_name, example)
    arrays = {path: np.asarray(values) for path, values in columns.items()}

    def rows(block: slice) -> list[bytes]:
        block_arrays = {path: values[block] for path, values in arrays.items()}
        return template.rows(time_ns[block], block_arrays, stamped)

    return RosTopic(name=name, type_name=type_name, time_ns=time_ns, rows=rows, latched=latched)


def _text(context: _FlightContext, name: str, text: str) -> RosTopic:
    """One latched text at the start."""
    type_name = "std_msgs/msg/String"
    message = context.store.types[type_name](data=text)
    data = bytes(context.store.serialize_cdr(message, type_name))
    start = context.clock.ns([0.0])
    return RosTopic(
        name=name,
        type_name=type_name,
        time_ns=start,
        rows=lambda block: [data][block],
        latched=True,
    )


def _xyz(path: str, values: Floats) -> dict[str, Floats]:
    return {f"{path}.{axis}": values[:, i] for i, axis in enumerate("xyz")}


def _wxyz(path: str, values: Floats) -> dict[str, Floats]:
    return {f"{path}.{axis}": values[:, i] for i, axis in enumerate("wxyz")}


def _six_by_six(values: Mapping[int, npt.ArrayLike], n: int) -> Floats:
    """Covariances of six by six by rows, shape (n, 36), from their entries by number."""
    covariance = np.zeros((n, 36))
    for entry, column in values.items():
        covariance[:, entry] = column
    return covariance


def _transforms(
    context: _FlightContext,
    name: str,
    time_ns: Ints,
    frames: Sequence[tuple[str, str]],
    positions: Floats,
    quaternions: Floats,
    *,
    latched: bool = False,
) -> RosTopic:
    """Frames, pairs of parent and child, at positions, shape (n, c, 3), [m], turned by quaternions
    (w, x, y, z), shape (n, c, 4).
    """
    columns = dict[str, npt.ArrayLike]()
    for i in range(len(frames)):
        columns |= _xyz(f"transforms.{i}.transform.translation", positions[:, i])
        columns |= _wxyz(f"transforms.{i}.transform.rotation", quaternions[:, i])
    example = {
        "transforms": [
            {"header": {"frame_id": parent}, "child_frame_id": child} for parent, child in frames
        ]
    }
    return _numbers(
        context,
        name,
        "tf2_msgs/msg/TFMessage",
        time_ns,
        example,
        columns,
        [f"transforms.{i}.header.stamp" for i in range(len(frames))],
        latched=latched,
    )


def _nav_sat(
    context: _FlightContext,
    name: str,
    frame: str,
    time_ns: Ints,
    position: Floats,
    covariance: Floats,
) -> RosTopic:
    """Positions, shape (n, 3), [m], on the map, with covariances (east, north, up) by rows, shape
    (n, 9), [m²].
    """
    scenario = context.flight.scenario
    geodetic_position = attitude.geodetic(
        position, scenario.origin_latitude_deg, scenario.origin_longitude_deg
    )
    example = {
        "header": {"frame_id": frame},
        "position_covariance_type": _POSITION_COVARIANCE_KNOWN,
    }
    columns = {
        "latitude": geodetic_position[:, 0],
        "longitude": geodetic_position[:, 1],
        "altitude": geodetic_position[:, 2],
        "position_covariance": covariance,
    }
    return _numbers(context, name, "sensor_msgs/msg/NavSatFix", time_ns, example, columns)


def _static_frames(context: _FlightContext) -> RosTopic:
    """Frames that do not move: of the odometry in the map, and of sites in their vehicles."""
    t = context.flight.trajectory
    frames = [(_MAP, f"{name}/odom") for name in context.names]
    offsets = [np.zeros(3) for _ in context.names]
    for site, vehicle, offset in zip(t.site_names, t.site_vehicle, t.site_offset, strict=True):
        name = context.names[vehicle]
        frames.append((f"{name}/base_link", f"{name}/{site.rpartition('/')[2]}"))
        offsets.append(offset)
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(frames), 1))
    start = context.clock.ns([0.0])
    return _transforms(
        context, "/tf_static", start, frames, np.array([offsets]), upright, latched=True
    )


def _truth(context: _FlightContext) -> Iterator[RosTopic]:
    """Clock, frames, and the true motion of every vehicle."""
    t = context.flight.trajectory
    time_ns = context.clock.ns(t.time)
    yield _numbers(context, "/clock", "rosgraph_msgs/msg/Clock", time_ns, {}, {}, ["clock"])
    frames = [(f"{name}/odom", f"{name}/base_link") for name in context.names]
    yield _transforms(context, "/tf", time_ns, frames, t.position, t.quaternion)
    yield _static_frames(context)
    rows_a_second = round(1.0 / t.dt)
    models = MissionPlan.of(context.flight.scenario).models
    for v, name in enumerate(context.names):
        base = f"{name}/base_link"
        yield _text(context, f"/{name}/robot_description", urdf(name, models[v], base))
        to_body = t.quaternion[:, v] * np.array([1.0, -1.0, -1.0, -1.0])
        velocity = attitude.rotate(to_body, t.velocity[:, v])
        columns = {
            **_xyz("pose.pose.position", t.position[:, v]),
            **_wxyz("pose.pose.orientation", t.quaternion[:, v]),
            **_xyz("twist.twist.linear", velocity),
            **_xyz("twist.twist.angular", t.angular_velocity[:, v]),
        }
        example = {"header": {"frame_id": _MAP}, "child_frame_id": base}
        yield _numbers(
            context, f"/{name}/truth/odometry", "nav_msgs/msg/Odometry", time_ns, example, columns
        )
        places = t.position[::rows_a_second, v]
        yield _nav_sat(
            context,
            f"/{name}/truth/navsat",
            base,
            time_ns[::rows_a_second],
            places,
            np.zeros((len(places), 9)),
        )


def _estimate(context: _FlightContext, vehicle: int) -> Iterator[RosTopic]:
    """Estimated motion of a vehicle's hydrophone, and its fixes."""
    flight = context.flight
    e = context.estimates(vehicle)
    m = context.measurements(vehicle)
    name = context.names[vehicle]
    errors = context.errors(vehicle)
    position, quaternion = estimated_poses(flight, vehicle)
    valid = np.flatnonzero(np.isfinite(e.state).all(axis=1) & np.isfinite(position).all(axis=1))
    n = valid.size
    time_ns = context.clock.ns(m.dt * (valid + 1))
    position = position[valid]
    quaternion = quaternion[valid]
    frame = f"{name}/estimate"
    yield _transforms(
        context,
        "/tf",
        time_ns,
        [(_MAP, frame)],
        position[:, None],
        quaternion[:, None],
    )
    horizontal = e.covariance[valid, :2, :2]
    pose_covariance = _six_by_six(
        {
            0: horizontal[:, 0, 0],
            1: horizontal[:, 0, 1],
            6: horizontal[:, 1, 0],
            7: horizontal[:, 1, 1],
            14: errors.depth_sigma_m**2,
            21: _UNKNOWN_ANGLE,
            28: _UNKNOWN_ANGLE,
            35: _heading_variance(errors),
        },
        n,
    )
    pose = {
        **_xyz("pose.pose.position", position),
        **_wxyz("pose.pose.orientation", quaternion),
        "pose.covariance": pose_covariance,
    }
    yield _numbers(
        context,
        f"/{name}/estimate/pose",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        time_ns,
        {"header": {"frame_id": _MAP}},
        pose,
    )
    # east and north in the body, which is level: forward, then port
    yaw = 0.5 * np.pi - m.heading[valid]
    rotation = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    rotation = rotation.transpose(2, 0, 1)
    velocity = np.einsum("nij,nj->ni", rotation, e.state[valid, 2:])
    velocity_covariance = rotation @ e.covariance[valid, 2:, 2:] @ rotation.transpose(0, 2, 1)
    twist = {
        "twist.twist.linear.x": velocity[:, 0],
        "twist.twist.linear.y": velocity[:, 1],
        "twist.covariance": _six_by_six(
            {
                0: velocity_covariance[:, 0, 0],
                1: velocity_covariance[:, 0, 1],
                6: velocity_covariance[:, 1, 0],
                7: velocity_covariance[:, 1, 1],
                **dict.fromkeys((14, 21, 28, 35), _UNKNOWN_SPEED),
            },
            n,
        ),
    }
    example = {"header": {"frame_id": _MAP}, "child_frame_id": frame}
    yield _numbers(
        context,
        f"/{name}/estimate/odometry",
        "nav_msgs/msg/Odometry",
        time_ns,
        example,
        pose | twist,
    )
    every_second = slice(None, None, max(1, round(1.0 / m.dt)))
    map_covariance = np.zeros((n, 9))
    map_covariance[:, [0, 1, 3, 4]] = horizontal.reshape(n, 4)
    map_covariance[:, 8] = errors.depth_sigma_m**2
    yield _nav_sat(
        context,
        f"/{name}/estimate/navsat",
        context.frame_of_hydrophone(vehicle),
        time_ns[every_second],
        position[every_second],
        map_covariance[every_second],
    )
    yield _fixes(context, vehicle)


def _fixes(context: _FlightContext, vehicle: int) -> RosTopic:
    """Positions that messages gave, as a filter of the user's own may take them."""
    e = context.estimates(vehicle)
    m = context.measurements(vehicle)
    name = context.names[vehicle]
    position, quaternion = estimated_poses(context.flight, vehicle)
    valid = np.flatnonzero(np.isfinite(e.fix_position).all(axis=1) & np.isfinite(e.fix_sigma))
    steps = e.fix_step[valid]
    places = np.column_stack([e.fix_position[valid], position[steps - 1, 2]])
    variance = e.fix_sigma[valid] ** 2
    errors = context.errors(vehicle)
    columns = {
        **_xyz("pose.pose.position", places),
        **_wxyz("pose.pose.orientation", quaternion[steps - 1]),
        "pose.covariance": _six_by_six(
            {
                0: variance,
                7: variance,
                14: errors.depth_sigma_m**2,
                **dict.fromkeys((21, 28, 35), _UNKNOWN_ANGLE),
            },
            valid.size,
        ),
    }
    return _numbers(
        context,
        f"/{name}/acoustic_fix",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        context.clock.ns(m.dt * steps),
        {"header": {"frame_id": _MAP}},
        columns,
    )


def _speed_variance(errors: Sensors) -> float:
    """Mean square of the errors of a log [m²/s²], over whole periods of its drift."""
    drift = 0.5 * errors.speed_drift_m_s**2
    return float(errors.speed_bias_m_s**2 + errors.speed_sigma_m_s**2 + drift)


def _heading_variance(errors: Sensors) -> float:
    """The same of a compass [rad²], whose random part is the absolute value of a normal number and
    so adds to the bias, σ √(2/π) on average.
    """
    bias = errors.heading_bias_deg
    sigma = errors.heading_sigma_deg
    mean_random = sigma * math.sqrt(2.0 / math.pi)
    drift = 0.5 * errors.heading_drift_deg**2
    return math.radians(1.0) ** 2 * (bias**2 + 2.0 * bias * mean_random + sigma**2 + drift)


def _sensed(context: _FlightContext, vehicle: int) -> Iterator[RosTopic]:
    """What a vehicle measured at filter steps."""
    flight = context.flight
    m = context.measurements(vehicle)
    name = context.names[vehicle]
    errors = context.errors(vehicle)
    n = m.speed.size
    time_ns = context.clock.ns(m.dt * np.arange(1, n + 1))
    base = {"header": {"frame_id": f"{name}/base_link"}}
    # −1 states that there is no such reading
    absent = np.zeros((n, 9))
    absent[:, 0] = -1.0
    orientation_covariance = np.zeros((n, 9))
    orientation_covariance[:, [0, 4]] = _UNKNOWN_ANGLE
    orientation_covariance[:, 8] = _heading_variance(errors)
    compass = {
        **_wxyz("orientation", attitude.from_euler(m.heading)),
        "orientation_covariance": orientation_covariance,
        "angular_velocity_covariance": absent,
        "linear_acceleration_covariance": absent,
    }
    yield _numbers(context, f"/{name}/imu", "sensor_msgs/msg/Imu", time_ns, base, compass)
    speed = {
        "twist.twist.linear.x": m.speed,
        "twist.covariance": _six_by_six(
            {
                **dict.fromkeys(_DIAGONAL, _UNKNOWN_SPEED),
                0: _speed_variance(errors),
            },
            n,
        ),
    }
    yield _numbers(
        context,
        f"/{name}/speed_log",
        "geometry_msgs/msg/TwistWithCovarianceStamped",
        time_ns,
        base,
        speed,
    )
    water = density_of(flight.scenario.ocean)
    read_at = np.flatnonzero(np.isfinite(m.depth))
    density = np.array([water.density_at(depth) for depth in m.depth[read_at].tolist()])
    specific_weight = density * GRAVITY  # [N/m³]
    pressure = {
        "fluid_pressure": SURFACE_PRESSURE_PA + water.pressures_at(m.depth[read_at]),
        "variance": np.square(specific_weight * errors.depth_sigma_m),
    }
    yield _numbers(
        context,
        f"/{name}/pressure",
        "sensor_msgs/msg/FluidPressure",
        time_ns[read_at],
        {"header": {"frame_id": f"{name}/depth_sensor"}},
        pressure,
    )
    for sensor, topic_name in zip(m.custom, _ros_names(list(m.custom)), strict=True):
        yield _readings(context, vehicle, sensor, f"/{name}/sensor/{topic_name}")


def _channels_of(header: SensorHeader, count: int) -> dict[str, list[str]]:
    """Names and units of so many channels, as messages have them."""
    units = [channel.unit for channel in header.channels] or [""] * count
    return {"channels": list(header.names(count)), "units": units}


def _readings(context: _FlightContext, vehicle: int, sensor: str, topic: str) -> RosTopic:
    """Readings of a further sensor of a vehicle, at its own rate."""
    m = context.measurements(vehicle)
    rows = m.custom[sensor].reshape(m.speed.size, -1)
    header = m.sensors.get(sensor, SensorHeader())
    stride = header.steps(m.dt)
    steps = np.arange(stride, m.speed.size + 1, stride)
    example = {
        "header": {"frame_id": f"{context.names[vehicle]}/base_link"},
        "values": np.zeros(rows.shape[1]),
        **_channels_of(header, rows.shape[1]),
    }
    time_ns = context.clock.ns(m.dt * steps)
    return _numbers(context, topic, READING_TYPE, time_ns, example, {"values": rows[steps - 1]})


def _reception_columns(
    received: Measurements | LinkMessages, places: Floats | None
) -> dict[str, npt.ArrayLike]:
    """Fields of receptions, also places of transmitters, shape (m, 3, 3), if there are such."""
    count = len(received.message)
    columns = dict[str, npt.ArrayLike]()
    for array in RECEPTION.columns:
        table = getattr(received, array.attribute).reshape(count, len(array.names))
        columns |= {field: table[:, i] for i, field in enumerate(array.names)}
    if places is not None:
        table = places.reshape(count, len(PLACES.names))
        columns |= {field: table[:, i] for i, field in enumerate(PLACES.names)}
    return columns


def _links(context: _FlightContext, vehicle: int) -> Iterator[RosTopic]:
    """Messages of further links that a vehicle has received. NaN stands for the places of
    transmitters and the round trip where a link has none.
    """
    m = context.measurements(vehicle)
    name = context.names[vehicle]
    for link, topic_name in zip(m.links, _ros_names(list(m.links)), strict=True):
        messages = m.links[link]
        count = len(messages.message)
        places = np.full(PLACES.shape, np.nan) if messages.places is None else messages.places
        columns = _reception_columns(messages, np.tile(places, (count, 1, 1)))
        no_answer = np.full(count, np.nan)
        columns[ROUND_TRIP] = no_answer if messages.round_trip is None else messages.round_trip
        example: dict[str, Any] = {"header": {"frame_id": context.frame_of_hydrophone(vehicle)}}
        example |= {"channels": [], "units": []}
        for sensor, rows in messages.content.items():
            header = context.headers.get(sensor, SensorHeader())
            named = _channels_of(header, rows.shape[1])
            example["channels"] += [f"{sensor}.{channel}" for channel in named["channels"]]
            example["units"] += named["units"]
        if messages.content:
            columns["content"] = np.hstack([*messages.content.values()])
            example["content"] = np.zeros(len(example["channels"]))
        yield _numbers(
            context,
            f"/{name}/link/{topic_name}",
            LINK_RECEPTION_TYPE,
            context.clock.ns(m.dt * messages.message_step),
            example,
            columns,
        )


def _received(context: _FlightContext, vehicle: int) -> Iterator[RosTopic]:
    """Messages of the link that a vehicle navigates on, the ranges of each transmitter, and
    messages of further links.
    """
    m = context.measurements(vehicle)
    name = context.names[vehicle]
    time_ns = context.clock.ns(m.dt * m.message_step)
    header = {"header": {"frame_id": context.frame_of_hydrophone(vehicle)}}
    type_name = RECEPTION_TYPE if m.transmitters is None else PLACED_RECEPTION_TYPE
    columns = _reception_columns(m, m.transmitters)
    yield _numbers(context, f"/{name}/reception", type_name, time_ns, header, columns)
    farthest = context.flight.scenario.acoustics.max_range_m or math.inf
    sonar = {
        "radiation_type": _ULTRASOUND,
        "field_of_view": 2.0 * math.pi,
        "max_range": farthest,
    }
    for i, transmitter in enumerate(Ranges._fields):
        rows = np.flatnonzero(np.isfinite(m.ranges[:, i]))
        yield _numbers(
            context,
            f"/{name}/range/{transmitter}",
            "sensor_msgs/msg/Range",
            time_ns[rows],
            header | sonar,
            {"range": m.ranges[rows, i]},
        )
    yield from _links(context, vehicle)


def _events(context: _FlightContext, log: Contents) -> Iterator[RosTopic]:
    """Lines of the log, as nodes of ROS write them."""
    messages = log.topics.get(_EVENTS)
    if messages is None or not messages.data:
        return
    type_name = "rcl_interfaces/msg/Log"
    new_line = context.store.types[type_name]
    stamp = context.store.types["builtin_interfaces/msg/Time"]
    lines = list(map(messages.message_class.FromString, messages.data))
    times = messages.time_ns

    def encode(i: int) -> bytes:
        line = lines[i]
        level = type(line).DESCRIPTOR.fields_by_name["level"].enum_type.values_by_number[line.level]
        seconds, nanoseconds = divmod(int(times[i]), 10**9)
        message = new_line(
            stamp=stamp(sec=seconds, nanosec=nanoseconds),
            level=_LEVELS.get(level.name, 0),
            name=line.name or "mission",
            msg=line.message,
            file="",
            function="",
            line=0,
        )
        return bytes(context.store.serialize_cdr(message, type_name))

    def rows(block: slice) -> list[bytes]:
        return [encode(i) for i in range(*block.indices(len(lines)))]

    yield RosTopic(name="/rosout", type_name=type_name, time_ns=times, rows=rows)


def _pictures(frames: Sequence[bytes]) -> Iterator[bytes]:
    """Frames of H.264 as JPEG, one after the other."""
    import av

    decoder = av.CodecContext.create("h264", "r")

    def jpeg(picture: Any) -> bytes:
        buffer = BytesIO()
        picture.to_image().save(buffer, "JPEG", quality=_JPEG_QUALITY)
        return buffer.getvalue()

    try:
        for data in frames:
            yield from map(jpeg, decoder.decode(av.Packet(data)))
        yield from map(jpeg, decoder.decode(None))
    except av.error.FFmpegError as error:
        raise LogError(f"{_CAMERA}: a frame of the film cannot be decoded: {error}") from error


def _film(context: _FlightContext, log: Contents) -> Iterator[RosTopic]:
    """Frames of the film as compressed pictures."""
    messages = log.topics.get(_CAMERA)
    if messages is None or not messages.data:
        return
    type_name = "sensor_msgs/msg/CompressedImage"
    times = messages.time_ns
    pictures = _pictures([messages.message_class.FromString(data).data for data in messages.data])
    types = context.store.types

    def encode(time_ns: int, picture: bytes) -> bytes:
        seconds, nanoseconds = divmod(time_ns, 10**9)
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        message = types[type_name](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id="camera"),
            format="jpeg",
            data=np.frombuffer(picture, np.uint8),
        )
        return bytes(context.store.serialize_cdr(message, type_name))

    def rows(block: slice) -> list[bytes]:
        # parts follow one another, and so do pictures
        return [encode(time_ns, next(pictures)) for time_ns in times[block].tolist()]

    yield RosTopic(name="/camera/compressed", type_name=type_name, time_ns=times, rows=rows)


def _topics(flight: FlightRecord, log: Contents, store: "Typestore") -> Iterator[RosTopic]:
    context = _FlightContext(
        flight=flight,
        store=store,
        clock=Clock(flight.scenario.epoch),
        names=_ros_names(flight.trajectory.names),
    )
    yield from _truth(context)
    for vehicle in context.sensing_vehicles:
        yield from _sensed(context, vehicle)
        yield from _received(context, vehicle)
        if estimates_of(flight, vehicle) is not None:
            yield from _estimate(context, vehicle)
    yield from _events(context, log)
    yield from _film(context, log)


def _qos(*, latched: bool) -> Any:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    # as Humble and later releases write what has no end
    forever = QosTime(9223372036, 854775807)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if latched else 10,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=forever,
        lifespan=forever,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=forever,
        avoid_ros_namespace_conventions=False,
    )


def _block(topics: Sequence[tuple[Any, RosTopic]], number: int) -> list[tuple[int, Any, bytes]]:
    """Messages of a block of time, in order; those of equal times in the order of topics."""
    messages = list[tuple[int, Any, bytes]]()
    for connection, topic in topics:
        edges = [number * _BLOCK_NS, (number + 1) * _BLOCK_NS]
        block = slice(*np.searchsorted(topic.time_ns, edges).tolist())
        times = topic.time_ns[block].tolist()
        if times:
            rows = topic.rows(block)
            messages += [
                (time_ns, connection, row) for time_ns, row in zip(times, rows, strict=True)
            ]
    messages.sort(key=itemgetter(0))
    return messages


def _write(folder: Path, topics: Sequence[RosTopic], store: "Typestore") -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    writer = Writer(folder, version=_BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        connections = dict[str, Any]()
        for topic in topics:
            if topic.name not in connections:
                connections[topic.name] = writer.add_connection(
                    topic.name,
                    topic.type_name,
                    typestore=store,
                    offered_qos_profiles=[_qos(latched=topic.latched)],
                )
        pairs = [(connections[topic.name], topic) for topic in topics]
        blocks = sorted(
            {
                number
                for topic in topics
                for number in np.unique(topic.time_ns // _BLOCK_NS).tolist()
            }
        )
        for number in blocks:
            for time_ns, connection, data in _block(pairs, number):
                writer.write(connection, time_ns, data)


def _replace_bag(
    folder: Path, topics: Sequence[RosTopic], store: "Typestore", view: str
) -> list[Path]:
    """Write a bag, with a view for RViz if there is one; an earlier bag of this name is replaced
    once the new one is whole.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".bag-") as work:
            # the bag's file is named after its folder
            built = Path(work) / folder.name
            _write(built, topics, store)
            if view:
                (built / VIEW).write_text(view, encoding="utf-8")
            if folder.exists():
                for path in folder.iterdir():
                    path.unlink()
                folder.rmdir()
            os.replace(built, folder)
    except OSError as error:
        raise LogError(f"{folder}: cannot be written: {error.strerror or error}") from error
    return sorted(folder.iterdir())


def write_bag(log_path: Path, folder: Path) -> list[Path]:
    """Write the flight of a log as a ROS 2 bag, a folder with a view for RViz; returns its files.

    An earlier bag of this name is replaced once the new one is whole. LogError if the log holds no
    flight, or the folder holds something else or cannot be written; LaisnError without rosbags.
    """
    store = typestore()
    _register(store)
    require_replaceable(folder)
    flight = read(log_path)
    log = Contents(log_path, lambda topic, _: topic in (_CAMERA, _EVENTS))
    topics = [topic for topic in _topics(flight, log, store) if topic.time_ns.size]
    view = rviz_view(_ros_names(flight.trajectory.names), [topic.name for topic in topics])
    return _replace_bag(folder, topics, store, view)


def left_out(log_path: Path) -> list[str]:
    """Topics of a flight's log that its bag has not; LogError if the log cannot be read."""
    log = Contents(log_path, lambda topic, _: False)
    return sorted(topic for topic in log.topics if topic.rpartition("/")[2] in _KEPT_IN_LOGS)


def remarks_of_left_out(log_path: Path) -> list[str]:
    """What to say of the topics of a flight's log that its bag has not; LogError if the log cannot
    be read.
    """
    topics = left_out(log_path)
    return [f"not in the bag, but in {log_path}: {', '.join(topics)}"] if topics else []


def write_measurement_bag(flight: FlightRecord, folder: Path) -> list[Path]:
    """Write what the followers of a flight measured as a ROS 2 bag, without truth and estimates;
    returns its files. Errors as of `write_bag`.
    """
    store = typestore()
    _register(store)
    require_replaceable(folder)
    context = _FlightContext(
        flight=flight,
        store=store,
        clock=Clock(flight.scenario.epoch),
        names=_ros_names(flight.trajectory.names),
    )
    topics = list[RosTopic]()
    for vehicle in range(1, len(flight.measurements) + 1):
        topics += _sensed(context, vehicle)
        topics += _received(context, vehicle)
    return _replace_bag(folder, [topic for topic in topics if topic.time_ns.size], store, "")
