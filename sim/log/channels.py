"""A flight as channels of timed messages, serialised on demand."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from foxglove import Schema
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    LocationFix,
    LocationFixPositionCovarianceType,
    Log,
    LogLevel,
    SceneUpdate,
)

from laisn.arrays import Floats, Ints
from sim.flight import Flight
from sim.geometry import attitude
from sim.geometry.geodesy import geodetic
from sim.log import schema
from sim.log.clock import Clock, timestamp
from sim.log.events import Event, log_events
from sim.log.scene import ESTIMATE, TRUTH, draw_acoustics, draw_vehicles
from sim.scenario.settings import CONTROL_STEP_S

Errors = tuple[Floats, Floats]
"""E_P [m] and E_B [rad] of a follower at filter steps k = 1 … n, shapes (n,)."""


@dataclass(frozen=True)
class Channel:
    """Messages of one topic, in order of time."""

    topic: str
    schema: Schema
    """Type of its messages."""
    time_ns: Ints
    """Time of each message since 1970, shape (n,), [ns]."""
    rows: Callable[[int, int], list[bytes]]
    """Serialised messages from one index up to another."""


def _numeric(name: str, type_: schema.RecordType, time_ns: Ints, arrays: Callable[[str], schema.Array]) -> Channel:
    """Messages of one vehicle from arrays by attribute, n rows each."""

    def rows(start: int, stop: int) -> list[bytes]:
        return type_.rows(time_ns[start:stop], lambda attribute: arrays(attribute)[start:stop])

    return Channel(f"/{name}/{type_.topic}", type_.schema, time_ns, rows)


def _single(topic: str, type_: Schema, time_ns: Ints, encode: Callable[[int, int], bytes]) -> Channel:
    """Messages that are serialised one by one, from their index and their time [ns]."""

    def rows(start: int, stop: int) -> list[bytes]:
        return [encode(i, int(time_ns[i])) for i in range(start, stop)]

    return Channel(topic, type_, time_ns, rows)


def _transforms(flight: Flight, clock: Clock) -> Channel:
    """World to vehicles, and vehicles to transmitters and hydrophones."""
    t = flight.trajectory
    sites = [i for i, n in enumerate(t.site_names) if n.rpartition("/")[2].startswith(("tx_", "hydrophone"))]
    frames = [("world", name, (0.0, 0.0, 0.0)) for name in t.names]
    frames += [(t.names[t.site_vehicle[i]], t.site_names[i], tuple(t.site_offset[i].tolist())) for i in sites]
    message = FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=schema.STAMP,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=schema.vector(offset),
                rotation=schema.rotation(),
            )
            for parent, child, offset in frames
        ]
    )
    layout = schema.FixedLayout(schema.message_class_of(FrameTransforms.get_schema()).FromString(message.encode()))
    fields = {f"translation.{a}": (t.position, k) for k, a in enumerate("xyz")}
    fields |= {f"rotation.{a}": (t.quaternion, k) for k, a in enumerate("wxyz")}
    time_ns = clock.ns(t.time)

    def rows(start: int, stop: int) -> list[bytes]:
        columns = {
            f"transforms.{v}.{field}": array[start:stop, v, k]
            for v in range(len(t.names))
            for field, (array, k) in fields.items()
        }
        return layout.rows(time_ns[start:stop], columns)

    return Channel("/tf", FrameTransforms.get_schema(), time_ns, rows)


def _locations(topic: str, time_ns: Ints, place: Floats, covariance: Floats | None = None) -> Channel:
    """Latitude, longitude and height, shape (n, 3); horizontal covariances, shape (n, 2, 2), make it an estimate."""
    kinds = LocationFixPositionCovarianceType
    whole = np.zeros((time_ns.size, 3, 3))
    if covariance is not None:
        whole[:, :2, :2] = covariance

    def encode(i: int, at: int) -> bytes:
        latitude, longitude, altitude = place[i].tolist()
        fix = LocationFix(
            timestamp=timestamp(at),
            frame_id="world",
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=whole[i].ravel().tolist(),
            position_covariance_type=kinds.Unknown if covariance is None else kinds.Known,
            # Rerun 0.41 writes invalid points for a fix without a colour
            color=TRUTH if covariance is None else ESTIMATE,
        )
        return fix.encode()

    return _single(topic, LocationFix.get_schema(), time_ns, encode)


def _vehicle(flight: Flight, clock: Clock, v: int) -> list[Channel]:
    t, scenario = flight.trajectory, flight.scenario
    name, time_ns, second = t.names[v], clock.ns(t.time), round(1.0 / CONTROL_STEP_S)
    effectors = t.effector_names[v] if t.effector_names else ()
    place = geodetic(t.position[::second, v], scenario.origin_latitude_deg, scenario.origin_longitude_deg)

    def arrays(attribute: str) -> schema.Array:
        if attribute == "thrust":
            return t.thrust[:, v, : len(effectors)]
        array: schema.Array = getattr(t, attribute)
        return array if attribute == "time" else array[:, v]

    return [
        _numeric(name, schema.POSE, time_ns, arrays),
        _numeric(name, schema.vehicle_state(effectors), time_ns, arrays),
        _locations(f"/{name}/fix", time_ns[::second], place),
    ]


def _follower(flight: Flight, clock: Clock, f: int) -> list[Channel]:
    m, e, scenario = flight.measurements[f], flight.estimates[f], flight.scenario
    name, n = flight.trajectory.names[f + 1], m.speed.size
    time_ns = clock.ns(m.dt * np.arange(1, n + 1))
    second = max(1, round(1.0 / m.dt))
    estimated = {
        "position": np.column_stack([e.state[:, :2], -m.depth]),
        "quaternion": attitude.from_euler(m.heading),
    }
    each = slice(second - 1, None, second)
    place = geodetic(estimated["position"][each], scenario.origin_latitude_deg, scenario.origin_longitude_deg)
    measured, found = (lambda attribute: getattr(m, attribute)), (lambda attribute: getattr(e, attribute))
    fixes = [schema.FIX, *(type_ for kind, type_ in schema.DETAILS.values() if type(e) is kind)]
    return [
        _numeric(name, schema.OWN_MOTION, time_ns, measured),
        _numeric(name, schema.RECEPTION, time_ns[m.message_step - 1], measured),
        _numeric(name, schema.FILTER_STATE, time_ns, found),
        *(_numeric(name, type_, time_ns[e.fix_step - 1], found) for type_ in fixes),
        _numeric(name, schema.ESTIMATE, time_ns, estimated.__getitem__),
        _locations(f"/{name}/estimate/fix", time_ns[each], place, e.covariance[each, :2, :2]),
    ]


def _error(flight: Flight, clock: Clock, f: int, errors: Errors) -> Channel:
    m, name = flight.measurements[f], flight.trajectory.names[f + 1]
    n = m.speed.size
    if any(error.shape != (n,) for error in errors):
        raise ValueError(f"errors of {name} have shapes {[e.shape for e in errors]}, expected ({n},) twice")
    arrays = dict(zip(schema.ERROR.fields, errors, strict=True))
    return _numeric(name, schema.ERROR, clock.ns(m.dt * np.arange(1, n + 1)), arrays.__getitem__)


def _events(flight: Flight, clock: Clock, events: Iterable[Event]) -> Channel:
    lines = log_events(flight, events)

    def encode(i: int, at: int) -> bytes:
        line = lines[i]
        level = getattr(LogLevel, line.level.capitalize())
        return Log(timestamp=timestamp(at), level=level, message=line.text, name=line.source).encode()

    return _single("/log", Log.get_schema(), clock.ns([line.time_s for line in lines]), encode)


def _scene(flight: Flight, clock: Clock) -> list[Channel]:
    t, type_ = flight.trajectory, SceneUpdate.get_schema()
    seconds = np.arange(0, t.time.size, round(1.0 / CONTROL_STEP_S), dtype=np.int64)
    received: Ints = np.unique(np.concatenate([m.message_step for m in flight.measurements]))
    acoustic_ns = clock.ns(received * flight.measurements[0].dt)
    return [
        _single("/scene/vehicles", type_, clock.ns(t.time[seconds]), draw_vehicles(flight, seconds)),
        _single("/scene/acoustics", type_, acoustic_ns, draw_acoustics(flight, received)),
    ]


def channels(flight: Flight, errors: Sequence[Errors], events: Iterable[Event]) -> list[Channel]:
    """All channels of a flight but the video.

    Args:
        errors: for each follower; or none at all, and there are no error channels.
        events: lines for `/log` besides those about fixes.

    Raises:
        ValueError: errors of another length than the estimates, or an epoch before 1970.
    """
    clock = Clock(flight.scenario.epoch)
    followers = range(len(flight.measurements))
    if errors and len(errors) != len(followers):
        raise ValueError(f"errors of {len(errors)} followers given, the flight has {len(followers)}")
    result = [_transforms(flight, clock)]
    for v in range(len(flight.trajectory.names)):
        result += _vehicle(flight, clock, v)
    for f in followers:
        result += _follower(flight, clock, f)
    result += [_error(flight, clock, f, histories) for f, histories in enumerate(errors)]
    return [*result, *_scene(flight, clock), _events(flight, clock, events)]
