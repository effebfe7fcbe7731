"""A flight as channels of timed messages, serialised on demand."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from foxglove import Schema
from foxglove import messages as fg

from laisn.arrays import Floats, Ints
from laisn.estimates import FixKind
from sim import attitude
from sim.attitude import geodetic
from sim.flight import Flight, Outcome, position_and_bearing_errors
from sim.log import schema
from sim.log.scene import ESTIMATE, TRUTH, draw_acoustics, draw_vehicles
from sim.log.schema import Clock, RecordType, pose, quaternion, timestamp, vector
from sim.scenario.settings import CONTROL_STEP_S
from sim.trajectory import OF_VEHICLES, Trajectory

Frame = tuple[float, bytes]
"""Time since the start [s] and H.264 access unit (Annex B, no B-frames, parameter sets with every key frame)."""
Level = Literal["debug", "info", "warning", "error"]

FIX_LINES: dict[FixKind, tuple[Level, str]] = {
    FixKind.TWO_POINTS: ("debug", "fix: the nearer of two intersections"),
    FixKind.TANGENT: ("debug", "fix: one intersection"),
    FixKind.FUSED: ("debug", "fix: weighted mean of pairs"),
    FixKind.ASTERN: ("info", "fix: no two clear intersections, snapped onto the leader's axis"),
    FixKind.SINGULAR: ("info", "fix skipped: the filter was already exact"),
    FixKind.GATED: ("warning", "fix rejected as a gross error"),
    FixKind.ONE_RANGE: ("info", "fix: one range alone, the estimate moved along its line of sight"),
    FixKind.LOST: ("warning", "no fix: ranges are missing"),
    FixKind.RANGES: ("debug", "ranges used as they are"),
    FixKind.PARTLY: ("info", "ranges used but for those that looked like echoes"),
}
"""Level and text of the lines of `/log` for every kind of fix."""
_OUTCOME_LEVELS: dict[Outcome, Level] = {Outcome.COMPLETED: "info", Outcome.CONTACT: "warning"}


class Event(NamedTuple):
    """A line of `/log` that does not follow from the flight itself, such as a mirror lock."""

    time_s: float
    """Time since the start of the mission [s]."""
    level: Level
    text: str
    source: str = "laisn"
    """Name that the line stands under, such as a vehicle."""


class Channel(NamedTuple):
    """Messages of one topic, in order of time."""

    topic: str
    schema: Schema
    time_ns: Ints
    """Time of each message since 1970, shape (n,), [ns]."""
    rows: Callable[[slice], Iterable[bytes]]
    """Serialised messages of a stretch."""


class _Computed:
    """A column whose rows are computed when they are written: whole, those of a day would take much memory."""

    def __init__(self, rows: Callable[[slice], schema.Array]) -> None:
        self._rows = rows

    def __getitem__(self, part: slice) -> schema.Array:
        return self._rows(part)


Column = schema.Array | _Computed


def numeric(prefix: str, type_: RecordType, time_ns: Ints, arrays: Mapping[str, Column]) -> Channel:
    """A channel of numbers: messages at times, shape (n,), [ns], from arrays by attribute, n rows each."""

    def rows(part: slice) -> list[bytes]:
        return type_.rows({column.attribute: arrays[column.attribute][part] for column in type_.columns})

    return Channel(f"{prefix}/{type_.topic}", type_.schema, time_ns, rows)


def _channel(topic: str, type_: Any, time_ns: Ints, encode: Callable[..., Any], *columns: Column) -> Channel:
    """Messages of a type of Foxglove's, each made from its time [ns] and its row of every column, shape (n, …)."""

    def rows(part: slice) -> Iterator[bytes]:
        values = (column[part].tolist() for column in columns)
        return (encode(*row).encode() for row in zip(time_ns[part].tolist(), *values, strict=True))

    return Channel(topic, type_.get_schema(), time_ns, rows)


def poses(topic: str, time_ns: Ints, position: Column, quaternion: Column) -> Channel:
    """Positions, shape (n, 3), [m], and quaternions (w, x, y, z), shape (n, 4), in the world."""

    def pose_at(at: int, xyz: Sequence[float], wxyz: Sequence[float]) -> fg.PoseInFrame:
        return fg.PoseInFrame(timestamp=timestamp(at), frame_id="world", pose=pose(xyz, wxyz))

    return _channel(topic, fg.PoseInFrame, time_ns, pose_at, position, quaternion)


def _locations(
    flight: Flight, topic: str, time_ns: Ints, position: Floats, covariance: Floats | None = None
) -> Channel:
    """Positions, shape (n, 3), [m], on the map; horizontal covariances, shape (n, 2, 2), make them estimates."""
    kinds = fg.LocationFixPositionCovarianceType
    # Rerun 0.41 writes invalid points for a fix without a colour
    kind, color = (kinds.Unknown, TRUTH) if covariance is None else (kinds.Known, ESTIMATE)

    def spreads(part: slice) -> Floats:
        whole = np.zeros((len(time_ns[part]), 3, 3))
        if covariance is not None:
            whole[:, :2, :2] = covariance[part]
        return whole.reshape(-1, 9)

    def fix_at(at: int, place: Sequence[float], spread: list[float]) -> fg.LocationFix:
        fixed: dict[str, Any] = dict(zip(("latitude", "longitude", "altitude"), place, strict=True))
        return fg.LocationFix(
            timestamp=timestamp(at), frame_id="world", color=color, position_covariance=spread,
            position_covariance_type=kind, **fixed,
        )  # fmt: skip

    place = geodetic(position, flight.scenario.origin_latitude_deg, flight.scenario.origin_longitude_deg)
    return _channel(topic, fg.LocationFix, time_ns, fix_at, place, _Computed(spreads))


def _transforms(topic: str, time_ns: Ints, parents: Iterable[str], children: Sequence[str], *places: Floats) -> Channel:
    """Frames in their parents, from positions, shape (n, c, 3), [m], and quaternions (w, x, y, z), shape (n, c, 4)."""
    frames = list(zip(parents, children, strict=True))

    def transforms_at(at: int, *places: Any) -> fg.FrameTransforms:
        return fg.FrameTransforms(
            transforms=[
                fg.FrameTransform(
                    timestamp=timestamp(at), parent_frame_id=parent, child_frame_id=child, translation=vector(xyz),
                    rotation=quaternion(wxyz),
                )
                for (parent, child), xyz, wxyz in zip(frames, *places, strict=True)
            ]
        )  # fmt: skip

    return _channel(topic, fg.FrameTransforms, time_ns, transforms_at, *places)


def _state(t: Trajectory, v: int, effectors: int) -> dict[str, Column]:
    """Columns of the true state of vehicle v."""
    computed: dict[str, Column] = {
        "depth": _Computed(lambda part: -t.position[part, v, 2]),
        "pitch": _Computed(lambda part: attitude.pitch(t.quaternion[part, v])),
        "roll": _Computed(lambda part: attitude.roll(t.quaternion[part, v])),
    }
    kept = {name: getattr(t, name)[:, v] for name in (*OF_VEHICLES, "heading", "forward_speed")}
    return computed | kept | {"time": t.time, "thrust": t.thrust[:, v, :effectors]}


def _truth(flight: Flight, clock: Clock) -> Iterator[Channel]:
    """Transforms, poses, states and map positions of all vehicles."""
    t = flight.trajectory
    time_ns, second = clock.ns(t.time), round(1.0 / CONTROL_STEP_S)
    yield _transforms("/tf", time_ns, ["world"] * len(t.names), t.names, t.position, t.quaternion)
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(t.site_names), 1))
    parents = [t.names[v] for v in t.site_vehicle]
    yield _transforms("/tf_static", time_ns[:1], parents, t.site_names, t.site_offset[None], upright)
    for v, name in enumerate(t.names):
        effectors = t.effector_names[v] if t.effector_names else ()
        type_ = schema.vehicle_state(effectors)
        yield numeric(f"/{name}", type_, time_ns, _state(t, v, len(effectors)))
        yield poses(f"/{name}/pose", time_ns, t.position[:, v], t.quaternion[:, v])
        yield _locations(flight, f"/{name}/fix", time_ns[::second], t.position[::second, v])


def _follower(flight: Flight, clock: Clock, f: int, errors: tuple[Floats, Floats]) -> Iterator[Channel]:
    """What a follower measured and estimated, and its errors."""
    m, e, name = flight.measurements[f], flight.estimates[f], flight.trajectory.names[f + 1]
    time_ns = clock.ns(m.dt * np.arange(1, m.speed.size + 1))
    for record, types in ((m, schema.MEASURED), (e, schema.estimated(type(e)))):
        for type_ in types:
            at = time_ns[getattr(record, type_.steps) - 1] if type_.steps else time_ns
            yield numeric(f"/{name}", type_, at, vars(record))
    yield numeric(f"/{name}", schema.ERROR, time_ns, dict(zip(schema.ERROR.fields, errors, strict=True)))
    position = _Computed(lambda part: np.column_stack([e.state[part, :2], -m.depth[part]]))
    quaternion = _Computed(lambda part: attitude.from_euler(m.heading[part]))
    yield poses(f"/{name}/estimate", time_ns, position, quaternion)
    second = max(1, round(1.0 / m.dt))
    each = slice(second - 1, None, second)
    yield _locations(flight, f"/{name}/estimate/fix", time_ns[each], position[each], e.covariance[each, :2, :2])


def _events(flight: Flight, clock: Clock, events: Iterable[Event]) -> Channel:
    """Lines of `/log`: the kind of every fix, the events, and last the outcome."""
    lines = list(events)
    for name, m, e in zip(flight.trajectory.names[1:], flight.measurements, flight.estimates, strict=True):
        for step, kind in zip(e.fix_step.tolist(), e.fix_kind.tolist(), strict=True):
            lines.append(Event(step * m.dt, *FIX_LINES[FixKind(kind)], name))
    level = _OUTCOME_LEVELS.get(flight.outcome, "error")
    lines.append(Event(float(flight.trajectory.time[-1]), level, flight.outcome.value))
    lines.sort(key=lambda line: line.time_s)

    def line_at(at: int, i: int) -> fg.Log:
        level = getattr(fg.LogLevel, lines[i].level.capitalize())
        return fg.Log(timestamp=timestamp(at), level=level, message=lines[i].text, name=lines[i].source)

    time_ns = clock.ns([line.time_s for line in lines])
    return _channel("/log", fg.Log, time_ns, line_at, np.arange(time_ns.size))


def _scene(flight: Flight, clock: Clock) -> Iterator[Channel]:
    t = flight.trajectory
    seconds = np.arange(0, t.time.size, round(1.0 / CONTROL_STEP_S), dtype=np.int64)
    received: Ints = np.unique(np.concatenate([m.message_step for m in flight.measurements]))
    for what, times, draw in (
        ("vehicles", t.time[seconds], draw_vehicles(flight, seconds)),
        ("acoustics", received * flight.measurements[0].dt, draw_acoustics(flight, received)),
    ):
        yield _channel(f"/scene/{what}", fg.SceneUpdate, clock.ns(times), draw, np.arange(times.size))


def _camera(video: Sequence[Frame], clock: Clock) -> Channel:
    time_ns = clock.ns([time_s for time_s, _ in video])
    if np.any(np.diff(time_ns) < 0):
        raise ValueError("video frames must be in order of time")

    def rows(part: slice) -> Iterator[bytes]:
        for at, (_, data) in zip(time_ns[part].tolist(), video[part], strict=True):
            yield fg.CompressedVideo(timestamp=timestamp(at), frame_id="camera", data=data, format="h264").encode()

    return Channel("/camera", fg.CompressedVideo.get_schema(), time_ns, rows)


def channels(flight: Flight, events: Iterable[Event], video: Sequence[Frame]) -> list[Channel]:
    """All channels of a flight; ValueError for frames out of order, or an epoch before 1970."""
    clock = Clock(flight.scenario.epoch)
    return [
        *_truth(flight, clock),
        *(
            c
            for f, errors in enumerate(position_and_bearing_errors(flight))
            for c in _follower(flight, clock, f, errors)
        ),
        *_scene(flight, clock),
        _events(flight, clock, events),
        _camera(video, clock),
    ]
