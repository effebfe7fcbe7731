"""A flight as channels of timed messages, serialised on demand."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from foxglove import Schema
from foxglove import messages as fg

from laisn.arrays import Floats, Ints
from laisn.estimates import FixKind
from sim import attitude
from sim.attitude import geodetic
from sim.flight import Flight, Outcome
from sim.log import schema
from sim.log.scene import ESTIMATE, TRUTH, draw_acoustics, draw_vehicles
from sim.log.schema import Clock, RecordType, pose, timestamp, vector
from sim.scenario.settings import CONTROL_STEP_S
from sim.trajectory import Trajectory

Errors = tuple[Floats, Floats]
"""E_P [m] and E_B [rad] of a follower at filter steps k = 1 … n, shapes (n,)."""
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
"""Levels of outcomes that are no errors."""


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
    """Type of its messages."""
    time_ns: Ints
    """Time of each message since 1970, shape (n,), [ns]."""
    rows: Callable[[slice], Iterable[bytes]]
    """Serialised messages of a stretch."""

    def between(self, start_ns: int, end_ns: int) -> Iterable[tuple[int, bytes]]:
        """Times [ns] and serialised messages from a time on until before another."""
        part = slice(*np.searchsorted(self.time_ns, (start_ns, end_ns)).tolist())
        return zip(self.time_ns[part].tolist(), self.rows(part), strict=True)


def numeric(prefix: str, type_: RecordType, time_ns: Ints, arrays: Callable[[str], schema.Array]) -> Channel:
    """A channel of numbers: messages at times, shape (n,), [ns], from arrays by attribute, n rows each."""

    def rows(part: slice) -> list[bytes]:
        return type_.rows(time_ns[part], lambda attribute: arrays(attribute)[part])

    return Channel(f"{prefix}/{type_.topic}", type_.schema, time_ns, rows)


def _channel(topic: str, type_: Any, time_ns: Ints, encode: Callable[..., Any], *columns: schema.Array) -> Channel:
    """Messages of a type of Foxglove's, each made from its time [ns] and its row of every column, shape (n, …)."""

    def rows(part: slice) -> Iterator[bytes]:
        values = (column[part].tolist() for column in columns)
        return (encode(*row).encode() for row in zip(time_ns[part].tolist(), *values, strict=True))

    return Channel(topic, type_.get_schema(), time_ns, rows)


def poses(topic: str, time_ns: Ints, position: Floats, quaternion: Floats) -> Channel:
    """Positions, shape (n, 3), [m], and quaternions (w, x, y, z), shape (n, 4), in the world."""

    def pose_at(at: int, xyz: Sequence[float], wxyz: Sequence[float]) -> fg.PoseInFrame:
        return fg.PoseInFrame(timestamp=timestamp(at), frame_id="world", pose=pose(xyz, wxyz))

    return _channel(topic, fg.PoseInFrame, time_ns, pose_at, position, quaternion)


def _locations(
    flight: Flight, topic: str, time_ns: Ints, position: Floats, covariance: Floats | None = None
) -> Channel:
    """Positions, shape (n, 3), [m], on the map; horizontal covariances, shape (n, 2, 2), make them estimates."""
    kinds, origin = fg.LocationFixPositionCovarianceType, flight.scenario
    # Rerun 0.41 writes invalid points for a fix without a colour
    look: dict[str, Any] = {"position_covariance_type": kinds.Unknown, "color": TRUTH}
    whole = np.zeros((time_ns.size, 3, 3))
    if covariance is not None:
        look = {"position_covariance_type": kinds.Known, "color": ESTIMATE}
        whole[:, :2, :2] = covariance

    def fix_at(at: int, place: Sequence[float], spread: list[float]) -> fg.LocationFix:
        fixed: dict[str, Any] = dict(zip(("latitude", "longitude", "altitude"), place, strict=True))
        return fg.LocationFix(timestamp=timestamp(at), frame_id="world", position_covariance=spread, **fixed, **look)

    place = geodetic(position, origin.origin_latitude_deg, origin.origin_longitude_deg)
    return _channel(topic, fg.LocationFix, time_ns, fix_at, place, whole.reshape(-1, 9))


def _transform(
    at: int, parent: str, child: str, xyz: Sequence[float], wxyz: Sequence[float] = (1.0, 0.0, 0.0, 0.0)
) -> fg.FrameTransform:
    w, i, j, k = wxyz
    return fg.FrameTransform(
        timestamp=timestamp(at),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=vector(xyz),
        rotation=fg.Quaternion(x=i, y=j, z=k, w=w),
    )


def _transforms(t: Trajectory, time_ns: Ints) -> Iterator[Channel]:
    """World to vehicles; and at the start vehicles to their sites."""

    def moving(at: int, *places: Any) -> fg.FrameTransforms:
        frames = [_transform(at, "world", *placed) for placed in zip(t.names, *places, strict=True)]
        return fg.FrameTransforms(transforms=frames)

    def fixed(at: int) -> fg.FrameTransforms:
        sites = zip(t.site_vehicle.tolist(), t.site_names, t.site_offset.tolist(), strict=True)
        return fg.FrameTransforms(transforms=[_transform(at, t.names[v], *site) for v, *site in sites])

    yield _channel("/tf", fg.FrameTransforms, time_ns, moving, t.position, t.quaternion)
    yield _channel("/tf_static", fg.FrameTransforms, time_ns[:1], fixed)


def _truth(flight: Flight, clock: Clock) -> Iterator[Channel]:
    """Transforms, poses, states and map positions of all vehicles."""
    t = flight.trajectory
    time_ns, second = clock.ns(t.time), round(1.0 / CONTROL_STEP_S)
    yield from _transforms(t, time_ns)
    for v, name in enumerate(t.names):
        effectors = t.effector_names[v] if t.effector_names else ()

        def arrays(attribute: str, v: int = v, m: int = len(effectors)) -> schema.Array:
            array: schema.Array = getattr(t, attribute)
            return array if attribute == "time" else array[:, v, :m] if attribute == "thrust" else array[:, v]

        yield numeric(f"/{name}", schema.vehicle_state(effectors), time_ns, arrays)
        yield poses(f"/{name}/pose", time_ns, t.position[:, v], t.quaternion[:, v])
        yield _locations(flight, f"/{name}/fix", time_ns[::second], t.position[::second, v])


def _follower(flight: Flight, clock: Clock, f: int, errors: Errors | None) -> Iterator[Channel]:
    """What a follower measured and estimated, and its errors."""
    m, e, name = flight.measurements[f], flight.estimates[f], flight.trajectory.names[f + 1]
    time_ns = clock.ns(m.dt * np.arange(1, m.speed.size + 1))
    for record, types in ((m, schema.MEASURED), (e, schema.estimated(type(e)))):
        for type_ in types:
            at = time_ns[getattr(record, type_.steps) - 1] if type_.steps else time_ns
            yield numeric(f"/{name}", type_, at, partial(getattr, record))
    if errors is not None:
        if any(error.shape != time_ns.shape for error in errors):
            raise ValueError(
                f"errors of {name} have shapes {[e.shape for e in errors]}, expected {time_ns.shape} twice"
            )
        yield numeric(
            f"/{name}", schema.ERROR, time_ns, dict(zip(schema.ERROR.fields, errors, strict=True)).__getitem__
        )
    position = np.column_stack([e.state[:, :2], -m.depth])
    yield poses(f"/{name}/estimate", time_ns, position, attitude.from_euler(m.heading))
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


def channels(flight: Flight, errors: Sequence[Errors], events: Iterable[Event]) -> list[Channel]:
    """All channels of a flight but the video.

    Args:
        errors: for each follower; or none at all, and there are no error channels.
        events: lines for `/log` besides those about fixes.

    Raises:
        ValueError: errors of another length than the estimates, or an epoch before 1970.
    """
    clock, followers = Clock(flight.scenario.epoch), range(len(flight.measurements))
    if errors and len(errors) != len(followers):
        raise ValueError(f"errors of {len(errors)} followers given, the flight has {len(followers)}")
    return [
        *_truth(flight, clock),
        *(channel for f in followers for channel in _follower(flight, clock, f, errors[f] if errors else None)),
        *_scene(flight, clock),
        _events(flight, clock, events),
    ]
