"""A flight as channels of timed messages, written as an MCAP log that Foxglove and Rerun draw."""

import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from foxglove import messages as fg
from foxglove.mcap import MCAPWriter

from laisn.arrays import Floats, Ints
from laisn.estimates import FIX_WORDS, Estimates, FixKind
from laisn.messages import Measurements, SensorHeader
from sim import attitude
from sim.attitude import geodetic
from sim.flight import (
    FlightRecord,
    FlightUnderWay,
    Termination,
    leader_errors,
    position_and_bearing_errors,
)
from sim.log import schema
from sim.log.blocks import BLOCK_NS, END_NS, BlockFile, LogChannel
from sim.log.contents import (
    FLIGHT,
    SCENARIO,
    SUMMARY,
    VEHICLES,
    VERSIONS,
    LogError,
    holds_messages,
    partial_path,
)
from sim.log.encoding import TimedNumbers, repeated
from sim.log.scene import (
    ESTIMATE,
    TRAIL_S,
    TRUTH,
    VisibleHulls,
    draw_acoustics,
    draw_hulls,
    draw_vehicles,
)
from sim.log.schema import Clock, RecordType, pose, quaternion, timestamp, vector
from sim.scenario.links import LEADER_LINK
from sim.scenario.parts import MissionPlan, SensingSettings, sensing_of_each
from sim.scenario.settings import CONTROL_STEP_S, Video
from sim.sensing.sensors import sensors_of_all
from sim.system import signals_after
from sim.trajectory import Trajectory

_WRITE_INTERVAL_S = 100.0  # mission time from one write of a flight under way to the next [s]
_MARGIN_S = 5.0  # a part begins by so much before the trails that it draws [s]
_PACKAGES = ("laisn-sim", "mujoco", "numpy", "scipy", "numba", "mcap", "foxglove-sdk")
_CONVENTIONS: dict[str, str] = json.loads(
    (Path(__file__).parent / "conventions.json").read_text(encoding="utf-8")
)
Frame = tuple[float, bytes]
"""Time since the start [s] and H.264 access unit (Annex B, no B-frames, parameter sets with
every key frame).
"""
FILM = "film"
"""Metadata record of the film beside a log."""
Level = Literal["debug", "info", "warning", "error"]

_FIX_LEVELS: dict[FixKind, Level] = {
    **dict.fromkeys((FixKind.ASTERN, FixKind.SINGULAR, FixKind.ONE_RANGE, FixKind.PARTLY), "info"),
    **dict.fromkeys((FixKind.GATED, FixKind.LOST), "warning"),
}
_OUTCOME_LEVELS: dict[Termination, Level] = {
    Termination.COMPLETED: "info",
    Termination.CONTACT: "warning",
}


def film_reference(file: str, video: Video) -> dict[str, str]:
    """What a log tells of the film beside it: its file, and its pace. Frame k shows the mission at
    k × `speed_up` / `frame_rate_hz` [s].
    """
    pace = {"frame_rate_hz": str(video.frame_rate_hz), "speed_up": repr(video.speed_up)}
    return {"file": file, **pace}


class Event(NamedTuple):
    """A line of `/log`, such as the kind of a fix, a mirror lock, or how the flight ended."""

    time_s: float
    level: Level
    text: str
    source: str = "laisn"  # a vehicle, or the program


Column = schema.Array | Callable[[slice], schema.Array]
"""Rows, or what computes a stretch of them when they are written: whole, those of a day would
take much memory.
"""


def _stretch(column: Column, rows: slice) -> schema.Array:
    return column(rows) if callable(column) else column[rows]


def numeric(
    prefix: str, type_: RecordType, time_ns: Ints, arrays: Mapping[str, Column]
) -> LogChannel:
    """A channel of numbers: messages at times, shape (n,), [ns], from arrays by attribute, n
    rows each.
    """

    def rows(block: slice) -> list[bytes]:
        return type_.rows(
            {
                column.attribute: _stretch(arrays[column.attribute], block)
                for column in type_.columns
            }
        )

    return LogChannel(f"{prefix}/{type_.topic}", type_.schema, time_ns, rows)


def _channel(
    topic: str, type_: Any, time_ns: Ints, encode: Callable[..., Any], *columns: Column
) -> LogChannel:
    """Messages of a type of Foxglove's, each made from its time [ns] and its row of every
    column, shape (n, …).
    """

    def rows(block: slice) -> Iterator[bytes]:
        values = (_stretch(column, block).tolist() for column in columns)
        return (encode(*row).encode() for row in zip(time_ns[block].tolist(), *values, strict=True))

    return LogChannel(topic, type_.get_schema(), time_ns, rows)


def poses(topic: str, time_ns: Ints, position: Column, quaternion: Column) -> LogChannel:
    """Positions, shape (n, 3), [m], and quaternions (w, x, y, z), shape (n, 4), in the world."""

    def pose_at(time_ns: int, numbers: Sequence[float]) -> bytes:
        message = pose(numbers[:3], numbers[3:])
        return fg.PoseInFrame(timestamp=timestamp(time_ns), frame_id="world", pose=message).encode()

    encoder = TimedNumbers(pose_at)

    def rows(block: slice) -> list[bytes]:
        numbers = np.hstack([_stretch(position, block), _stretch(quaternion, block)])
        return encoder.rows(time_ns[block], numbers)

    return LogChannel(topic, fg.PoseInFrame.get_schema(), time_ns, rows)


def _locations(
    flight: FlightRecord,
    topic: str,
    time_ns: Ints,
    position: Floats,
    covariance: Floats | None = None,
) -> LogChannel:
    """Positions, shape (n, 3), [m], on the map; horizontal covariances, shape (n, 2, 2), make
    them estimates.
    """
    kinds = fg.LocationFixPositionCovarianceType
    # Rerun 0.41 writes invalid points for a fix without a colour
    kind, color = (kinds.Unknown, TRUTH) if covariance is None else (kinds.Known, ESTIMATE)

    def fix_at(
        time_ns: int, geodetic_position: Sequence[float], spread: Sequence[Sequence[float]]
    ) -> fg.LocationFix:
        latitude, longitude, altitude = geodetic_position
        return fg.LocationFix(
            timestamp=timestamp(time_ns),
            frame_id="world",
            color=color,
            position_covariance_type=kind,
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=[*spread[0], 0.0, *spread[1], 0.0, 0.0, 0.0, 0.0],
        )

    geodetic_position = geodetic(
        position, flight.scenario.origin_latitude_deg, flight.scenario.origin_longitude_deg
    )
    spread = np.zeros((time_ns.size, 2, 2)) if covariance is None else covariance
    return _channel(topic, fg.LocationFix, time_ns, fix_at, geodetic_position, spread)


def _transforms(
    topic: str,
    time_ns: Ints,
    parents: Sequence[str],
    children: Sequence[str],
    position: Floats,
    attitudes: Floats,
) -> LogChannel:
    """Frames in their parents, from positions, shape (n, c, 3), [m], and quaternions (w, x, y,
    z), shape (n, c, 4).
    """

    def encoder_of(parent: str, child: str) -> TimedNumbers:
        def transform_at(time_ns: int, numbers: Sequence[float]) -> bytes:
            return fg.FrameTransform(
                timestamp=timestamp(time_ns),
                parent_frame_id=parent,
                child_frame_id=child,
                translation=vector(numbers[:3]),
                rotation=quaternion(numbers[3:]),
            ).encode()

        return TimedNumbers(transform_at)

    encoders = [encoder_of(*frames) for frames in zip(parents, children, strict=True)]

    def rows(block: slice) -> Iterator[bytes]:
        numbers = np.concatenate([position[block], attitudes[block]], axis=2)
        columns = [
            encoder.rows(time_ns[block], numbers[:, c]) for c, encoder in enumerate(encoders)
        ]
        return (repeated(transforms) for transforms in zip(*columns, strict=True))

    return LogChannel(topic, fg.FrameTransforms.get_schema(), time_ns, rows)


def _state(t: Trajectory, v: int, effector_count: int) -> dict[str, Column]:
    """Columns of the true state of vehicle v, by the names of `sim.log.schema.vehicle_state`."""
    computed: dict[str, Column] = {
        "depth": lambda part: -t.pose[part, v, 2],
        "pitch": lambda part: attitude.heading_pitch_roll(t.quaternion[part, v])[1],
        "roll": lambda part: attitude.heading_pitch_roll(t.quaternion[part, v])[2],
    }
    names = (
        "position",
        "quaternion",
        "velocity",
        "angular_velocity",
        "water_velocity",
        "heading",
        "forward_speed",
    )
    recorded = {name: getattr(t, name)[:, v] for name in names}
    effector_states = t.effector_states[:, v, :effector_count]
    return computed | recorded | {"time": t.time, "effector_states": effector_states}


def _truth(flight: FlightRecord, clock: Clock) -> Iterator[LogChannel]:
    t = flight.trajectory
    time_ns = clock.ns(t.time)
    rows_per_second = round(1.0 / CONTROL_STEP_S)
    yield _transforms("/tf", time_ns, ["world"] * len(t.names), t.names, t.position, t.quaternion)
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(t.site_names), 1))
    parents = [t.names[v] for v in t.site_vehicle]
    yield _transforms(
        "/tf_static", time_ns[:1], parents, t.site_names, t.site_offset[None], upright
    )
    for v, name in enumerate(t.names):
        effectors = t.effector_names[v] if t.effector_names else ()
        type_ = schema.vehicle_state(effectors)
        yield numeric(f"/{name}", type_, time_ns, _state(t, v, len(effectors)))
        yield poses(f"/{name}/pose", time_ns, t.position[:, v], t.quaternion[:, v])
        yield _locations(
            flight, f"/{name}/fix", time_ns[::rows_per_second], t.position[::rows_per_second, v]
        )


def _steps_before(flight: FlightRecord) -> int:
    """Filter steps of the mission before the first one of this part of it."""
    return round(float(flight.trajectory.time[0]) / flight.measurements[0].dt)


def _step_times(flight: FlightRecord, m: Measurements, clock: Clock) -> Ints:
    """Times of filter steps since 1970 [ns]."""
    before = _steps_before(flight)
    return clock.ns(m.dt * np.arange(before + 1, before + m.speed.size + 1))


def _headers_of(flight: FlightRecord) -> dict[str, SensorHeader]:
    """Channels and rates of the further sensors of all vehicles by their names."""
    headers: dict[str, SensorHeader] = {}
    if flight.leader is not None:
        headers |= flight.leader.measurements.sensors
    for measurements in flight.measurements:
        headers |= measurements.sensors
    return headers


def _links(flight: FlightRecord, name: str, m: Measurements, time_ns: Ints) -> Iterator[LogChannel]:
    """Messages of further links that a vehicle has received; times are those of all filter steps
    [ns].
    """
    headers = _headers_of(flight)
    for link, messages in m.links.items():
        arrays: dict[str, Column] = {"message": messages.message, "ranges": messages.ranges}
        if messages.places is not None:
            arrays["transmitters"] = np.tile(messages.places, (len(messages.message), 1, 1))
        if messages.round_trip is not None:
            arrays["round_trip"] = messages.round_trip
        content = []
        for sensor, rows in messages.content.items():
            header = headers.get(sensor, SensorHeader())
            content.append((sensor, header.names(rows.shape[1])))
            arrays[sensor] = rows
        type_ = schema.link_reception(
            link,
            with_position=messages.places is not None,
            with_round_trip=messages.round_trip is not None,
            content=tuple(content),
        )
        yield numeric(f"/{name}", type_, time_ns[messages.message_step - 1], arrays)


def _of_vehicle(
    flight: FlightRecord, name: str, record: tuple[Measurements, Estimates | None], clock: Clock
) -> Iterator[LogChannel]:
    """What a vehicle has measured and concluded, as numbers."""
    m, e = record
    before = _steps_before(flight)
    time_ns = _step_times(flight, m, clock)
    measured = schema.MEASURED if m.transmitters is None else schema.MEASURED_AMONG_BEACONS
    # arrays, and the types of the channels that hold them
    records: list[tuple[Any, Any]] = [(m, measured)]
    if e is not None:
        records.append((e, schema.estimated(type(e))))
    for arrays, types in records:
        for type_ in types:
            log_time_ns = time_ns
            if type_.steps:
                log_time_ns = clock.ns(m.dt * (before + getattr(arrays, type_.steps)))
            yield numeric(f"/{name}", type_, log_time_ns, vars(arrays))
    yield from _links(flight, name, m, time_ns)
    yield from further_readings(name, m, time_ns)


def _leader(flight: FlightRecord, clock: Clock) -> Iterator[LogChannel]:
    """What the leader has measured and concluded, if it has sensed under way."""
    if flight.leader is None:
        return
    m = flight.leader.measurements
    e = flight.leader.estimates
    yield from _of_vehicle(flight, "leader", (m, e), clock)
    errors = leader_errors(flight)
    if e is None or errors is None:
        return
    time_ns = _step_times(flight, m, clock)
    columns: dict[str, Column] = {"position_error": errors}
    yield numeric("/leader", schema.POSITION_ERROR, time_ns, columns)
    yield _estimate("leader", m, e, time_ns)


def _estimate(name: str, m: Measurements, e: Estimates, time_ns: Ints) -> LogChannel:
    """Estimated poses of a vehicle: position of its navigator, depth and heading as measured."""

    def position(block: slice) -> Floats:
        return np.column_stack([e.state[block, :2], -m.depth[block]])

    return poses(
        f"/{name}/estimate", time_ns, position, lambda block: attitude.from_euler(m.heading[block])
    )


def further_readings(name: str, m: Measurements, time_ns: Ints) -> Iterator[LogChannel]:
    """Readings of further sensors of a vehicle, at their own rates; times are those of all filter
    steps [ns].
    """
    for sensor, readings in m.custom.items():
        rows = readings.reshape(len(readings), -1)
        header = m.sensors.get(sensor, SensorHeader())
        type_ = schema.custom_reading(sensor, header.names(rows.shape[1]))
        stride = header.steps(m.dt)
        steps = slice(stride - 1, None, stride)
        yield numeric(f"/{name}", type_, time_ns[steps], {"reading": rows[steps]})


def _follower(
    flight: FlightRecord, clock: Clock, f: int, errors: tuple[Floats, Floats]
) -> Iterator[LogChannel]:
    m = flight.measurements[f]
    e = flight.estimates[f]
    name = flight.trajectory.names[f + 1]
    time_ns = _step_times(flight, m, clock)
    yield from _of_vehicle(flight, name, (m, e), clock)
    yield numeric(
        f"/{name}", schema.ERROR, time_ns, dict(zip(schema.ERROR.fields, errors, strict=True))
    )

    yield _estimate(name, m, e, time_ns)
    steps_per_second = max(1, round(1.0 / m.dt))
    each_second = slice(steps_per_second - 1, None, steps_per_second)
    position = np.column_stack([e.state[each_second, :2], -m.depth[each_second]])
    yield _locations(
        flight,
        f"/{name}/estimate/fix",
        time_ns[each_second],
        position,
        e.covariance[each_second, :2, :2],
    )


def _lines(lines: Sequence[Event], clock: Clock) -> LogChannel:
    """Lines of `/log`, in order of time."""

    def line_at(time_ns: int, i: int) -> fg.Log:
        level = getattr(fg.LogLevel, lines[i].level.capitalize())
        return fg.Log(
            timestamp=timestamp(time_ns), level=level, message=lines[i].text, name=lines[i].source
        )

    time_ns = clock.ns([line.time_s for line in lines])
    return _channel("/log", fg.Log, time_ns, line_at, np.arange(time_ns.size))


def _fix_lines(flight: FlightRecord) -> list[Event]:
    """The kind of every fix."""
    lines = list[Event]()
    before = _steps_before(flight)
    for name, m, e in zip(
        flight.trajectory.names[1:], flight.measurements, flight.estimates, strict=True
    ):
        for step, kind in zip(e.fix_step.tolist(), e.fix_kind.tolist(), strict=True):
            fix = FixKind(kind)
            time_s = (before + step) * m.dt
            lines.append(
                Event(time_s, _FIX_LEVELS.get(fix, "debug"), f"fix: {FIX_WORDS[fix]}", name)
            )
    lines.sort(key=lambda line: line.time_s)
    return lines


def _scene(flight: FlightRecord, clock: Clock, hulls: VisibleHulls) -> Iterator[LogChannel]:
    t = flight.trajectory
    # indices of the instants at whole seconds, and filter steps at which a message is in
    seconds = np.arange(0, t.time.size, round(1.0 / CONTROL_STEP_S), dtype=np.int64)
    received: Ints = np.unique(np.concatenate([m.message_step for m in flight.measurements]))
    instants, draw_all = draw_hulls(flight, seconds, hulls)
    scenes = [
        ("hulls", t.time[instants], draw_all),
        ("vehicles", t.time[seconds], draw_vehicles(flight, seconds)),
    ]
    if all(sensing.links.main == LEADER_LINK for sensing in sensing_of_each(flight.scenario)):
        steps = _steps_before(flight) + received
        heard = np.asarray(steps * flight.measurements[0].dt, dtype=np.float64)
        scenes.append(("acoustics", heard, draw_acoustics(flight, received)))
    for name, times, draw in scenes:
        yield _channel(
            f"/scene/{name}", fg.SceneUpdate, clock.ns(times), draw, np.arange(times.size)
        )


def _camera(video: Sequence[Frame], clock: Clock) -> LogChannel:
    time_ns = clock.ns([time_s for time_s, _ in video])
    if np.any(np.diff(time_ns) < 0):
        raise ValueError("video frames must be in order of time")

    def frame_at(time_ns: int, i: int) -> fg.CompressedVideo:
        return fg.CompressedVideo(
            timestamp=timestamp(time_ns), frame_id="camera", data=video[i][1], format="h264"
        )

    return _channel("/camera", fg.CompressedVideo, time_ns, frame_at, np.arange(time_ns.size))


def _channels(
    flight: FlightRecord, hulls: VisibleHulls, video: Sequence[Frame]
) -> list[LogChannel]:
    """All channels of a part of a flight; ValueError for frames out of order, or an epoch before
    1970.
    """
    clock = Clock(flight.scenario.epoch)
    of_flight = [*_truth(flight, clock), *_leader(flight, clock)]
    for f, errors in enumerate(position_and_bearing_errors(flight)):
        of_flight += _follower(flight, clock, f, errors)
    return [
        *of_flight,
        *_scene(flight, clock, hulls),
        _lines(_fix_lines(flight), clock),
        _camera(video, clock),
    ]


def channels(
    flight: FlightRecord, events: Iterable[Event] = (), video: Sequence[Frame] = ()
) -> list[LogChannel]:
    """All channels of a flight, whose lines of `/log` are in order of time; ValueError for frames
    out of order, or an epoch before 1970.
    """
    of_flight = _channels(flight, VisibleHulls(MissionPlan.of(flight.scenario).models), video)
    lines = sorted([*events, *_fix_lines(flight)], key=lambda line: line.time_s)
    lines.append(_ending(float(flight.trajectory.time[-1]), flight.outcome))
    all_lines = _lines(lines, Clock(flight.scenario.epoch))
    return [all_lines if channel.topic == all_lines.topic else channel for channel in of_flight]


def _ending(time_s: float, outcome: Termination) -> Event:
    return Event(time_s, _OUTCOME_LEVELS.get(outcome, "error"), outcome.value)


def write_channels(
    path: Path, channels: Sequence[LogChannel], describe: Callable[[MCAPWriter], None]
) -> None:
    """Write an MCAP file; the same arguments give the same bytes. If that fails, the file stays
    without an end.

    Messages of all channels are in order of time, in blocks of 20 s, each of which is in the file
    before the next one begins; a channel without messages is not in it. `describe` writes
    attachments and metadata.
    """
    file = BlockFile(path)
    try:
        file.describe(describe)
        file.append(channels)
        file.finish()
    except BaseException:
        file.abandon()
        raise


def _json(value: object) -> bytes:
    # float64 keep all their bits
    return json.dumps(
        value, indent=1, allow_nan=False, ensure_ascii=False, default=np.ndarray.tolist
    ).encode()


def _attach(time_ns: int, files: Mapping[str, bytes], mcap: MCAPWriter) -> None:
    for name, data in files.items():
        media = f"application/{name.rpartition('.')[2]}"
        mcap.attach(log_time=time_ns, create_time=time_ns, name=name, media_type=media, data=data)


def _facts(flight: FlightRecord, outcome: Termination) -> dict[str, str]:
    """Metadata of a flight: how it ended, filter step, seed and run, and whose estimates have
    details of a class: "True" or "False" for all followers, else their names.
    """
    facts = {"outcome": outcome.name, "filter_step_s": repr(flight.measurements[0].dt)}
    facts |= {"seed": str(flight.scenario.seed), "run": str(flight.scenario.run)}
    for estimates_class, type_ in schema.DETAILS.items():
        names = [
            name
            for name, estimates in zip(flight.trajectory.names[1:], flight.estimates, strict=True)
            if type(estimates) is estimates_class
        ]
        of_all = len(names) == len(flight.estimates)
        # names where followers navigate differently
        facts[type_.topic] = ", ".join(names) if names and not of_all else str(of_all)
    return facts


def _describe(flight: FlightRecord, mcap: MCAPWriter) -> None:
    """Write what is known before the end of a flight, which is an interrupted one until then."""
    epoch_ns = Clock(flight.scenario.epoch).epoch_ns
    files = {
        SCENARIO: flight.scenario.toml().encode(),
        VEHICLES: _json({name: getattr(flight.trajectory, name) for name in schema.FIXED}),
        VERSIONS: _json({package: version(package) for package in _PACKAGES}),
    }
    _attach(epoch_ns, files, mcap)
    mcap.write_metadata("conventions", _CONVENTIONS)
    headers = _headers_of(flight)
    declared = {name: header for name, header in headers.items() if header.channels}
    if declared:
        texts = {name: schema.header_text(header) for name, header in declared.items()}
        mcap.write_metadata(schema.SENSORS, texts)
    mcap.write_metadata(FLIGHT, _facts(flight, Termination.INTERRUPTED))


class FlightLog:
    """A log that is written while the mission goes on.

    The file grows under `partial_path(path)` and gets its name when it has its end, in place of an
    existing one. If writing fails, what can be recovered with `sim.log.contents.recover` stays
    there, and nothing else.
    """

    def __init__(self, path: Path, video: Sequence[Frame] = ()) -> None:
        """Write nothing yet; frames of `video` are those of the whole flight. LogError: the path is
        a folder.
        """
        if path.is_dir():
            raise LogError(
                f"{path}: cannot be written: it is a folder, expected the name of a file"
            )
        self._path = path
        self._partial = partial_path(path)
        self._video = video
        self._file: BlockFile | None = None
        self._hulls: VisibleHulls | None = None  # compiled once, for all parts
        self._written_ns = 0  # all before this time since 1970 is in the file
        self._written_s = 0.0  # the same since the start
        self.ended = False
        """Whether the file has its end, or has failed."""

    def update(self, flight: FlightUnderWay) -> None:
        """Write what is there of a mission under way, as soon as it is a good piece.

        Signals wait until it is in the file. LogError: the file cannot be written.
        """
        dt = flight.scenario.timing.filter_step_s
        if flight.navigates and flight.steps * dt - self._written_s >= _WRITE_INTERVAL_S:
            with signals_after(), self._complete_or_kept():
                self._append(
                    flight.part(self._first_step(sensing_of_each(flight.scenario))),
                    is_last=False,
                )

    def finish(
        self,
        flight: FlightRecord | FlightUnderWay,
        outcome: Termination,
        *,
        summary: str | None = None,
        events: Iterable[Event] = (),
        film: Mapping[str, str] | None = None,
    ) -> None:
        """Write the rest of a flight, whole or under way, its outcome, and its summary, JSON text.

        `events` are lines for `/log` besides those about fixes; `film` is a `film_reference` to
        that beside the log.

        Raises:
            LogError: the file cannot be written.
            ValueError: frames of `video` are out of order, or the epoch lies before 1970.
        """
        if isinstance(flight, FlightRecord):
            with self._complete_or_kept():
                self._end(flight, outcome, summary, events, film)
            return
        # little is left to be written
        with signals_after(), self._complete_or_kept():
            remaining = flight.part(self._first_step(sensing_of_each(flight.scenario)))
            self._end(remaining, outcome, summary, events, film)

    @contextmanager
    def _complete_or_kept(self) -> Iterator[None]:
        """If the block fails, close the file as it is, and remove it if it holds no messages."""
        try:
            yield
        except BaseException as error:
            self.ended = True
            if self._file is not None:
                with suppress(OSError):
                    self._file.abandon()
            is_partial = holds_messages(self._partial)
            if not is_partial:
                with suppress(OSError):
                    self._partial.unlink()
            if not isinstance(error, OSError):
                raise
            hint = ""
            if is_partial:
                hint = f"; what was written is kept: laisn log recover {self._partial}"
            text = f"{self._path}: cannot be written: {error.strerror or error}{hint}"
            raise LogError(text) from error

    def _first_step(self, sensing_of: Sequence[SensingSettings]) -> int:
        """Filter step at which a part begins that has all that is drawn of what is not yet written,
        also trails.

        Rows of every second, and of slower sensors, are the same from there as from the start.
        """
        dt = sensing_of[0].links.filter_step_s
        stride = round(dt / CONTROL_STEP_S)
        grids = [round(1.0 / CONTROL_STEP_S), stride * max(1, round(1.0 / dt))]
        grids += [driver.every * stride for driver in sensors_of_all(sensing_of)]
        # instants at which rows of all rates fall together
        grid = math.lcm(*grids)
        instants = math.floor((self._written_s - TRAIL_S - _MARGIN_S) / CONTROL_STEP_S)
        return max(instants // grid, 0) * grid // stride

    def _append(self, stretch: FlightRecord, *, is_last: bool) -> None:
        """Write what is new of a part of the flight; unless it is the last, in whole blocks."""
        clock = Clock(stretch.scenario.epoch)
        if self._hulls is None:
            self._hulls = VisibleHulls(MissionPlan.of(stretch.scenario).models)
        channels = _channels(stretch, self._hulls, self._video)
        if self._file is None:
            self._file = BlockFile(self._partial)
            self._file.describe(partial(_describe, stretch))
        end_ns = int(clock.ns(float(stretch.trajectory.time[-1])))
        end_ns = END_NS if is_last else end_ns // BLOCK_NS * BLOCK_NS
        self._file.append(channels, self._written_ns, end_ns)
        self._written_ns = end_ns
        self._written_s = (end_ns - clock.epoch_ns) / 1e9

    def _end(
        self,
        stretch: FlightRecord,
        outcome: Termination,
        summary: str | None,
        events: Iterable[Event],
        film: Mapping[str, str] | None,
    ) -> None:
        """Write the last part, and what only the whole flight tells, of times before as well."""
        self._append(stretch, is_last=True)
        file = cast(BlockFile, self._file)
        clock = Clock(stretch.scenario.epoch)
        lines = sorted(events, key=lambda line: line.time_s)
        end_s = float(stretch.trajectory.time[-1])
        lines.append(_ending(end_s, outcome))
        file.append_block([_lines(lines, clock)])
        if summary is not None:
            file.describe(partial(_attach, clock.epoch_ns, {SUMMARY: summary.encode()}))
        # of records with one name, the last one counts
        facts = _facts(stretch, outcome)
        file.describe(lambda mcap: mcap.write_metadata(FLIGHT, facts))
        if film is not None:
            file.describe(lambda mcap: mcap.write_metadata(FILM, dict(film)))
        file.finish()
        os.replace(self._partial, self._path)
        self.ended = True


def write(
    flight: FlightRecord,
    path: Path,
    *,
    summary: str = "{}",
    events: Iterable[Event] = (),
    video: Sequence[Frame] = (),
    film: Mapping[str, str] | None = None,
) -> None:
    """Write a flight from the start of its mission; the same arguments give the same bytes, those
    that a `FlightLog` of it has.

    Raises:
        LogError: the file cannot be written, or the flight begins within its mission.
        ValueError: frames of `video` are out of order, or the epoch lies before 1970.
    """
    if flight.trajectory.time[0] != 0:
        raise LogError(
            f"{path}: a log begins with its mission; this flight at {flight.trajectory.time[0]:g} "
            "s of it"
        )
    log = FlightLog(path, video)
    log.finish(flight, flight.outcome, summary=summary, events=events, film=film)
