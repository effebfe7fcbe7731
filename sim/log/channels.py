"""A flight as channels of timed messages, serialised on demand."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from foxglove import Schema
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    LocationFix,
    LocationFixPositionCovarianceType,
    Log,
    LogLevel,
    Pose,
    PoseInFrame,
    Quaternion,
    SceneUpdate,
)

from laisn.arrays import Floats, Ints
from laisn.tight.estimates import TightEstimates
from sim.flight import Flight
from sim.geometry import attitude
from sim.geometry.geodesy import geodetic
from sim.log.clock import Clock, timestamp
from sim.log.events import Event, log_events
from sim.log.scene import ESTIMATE, TRUTH, draw_acoustics, draw_vehicles, pose, vector
from sim.log.schema import (
    ERROR,
    FILTER_STATE,
    FIX,
    MIXTURE,
    OWN_MOTION,
    RECEPTION,
    STAMP,
    FixedLayout,
    ScalarSchema,
    slot,
    vehicle_state,
)
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


def _numeric(
    topic: str, schema: Schema, layout: FixedLayout, time_ns: Ints, values: Callable[[slice], npt.NDArray[Any]]
) -> Channel:
    def rows(start: int, stop: int) -> list[bytes]:
        part = slice(start, stop)
        return layout.rows(time_ns[part], values(part))

    return Channel(topic, schema, time_ns, rows)


def _scalars(topic: str, schema: ScalarSchema, time_ns: Ints, values: Callable[[slice], npt.NDArray[Any]]) -> Channel:
    return _numeric(topic, schema.schema, schema.layout, time_ns, values)


def _single(topic: str, schema: Schema, time_ns: Ints, encode: Callable[[int, int], bytes]) -> Channel:
    """Messages that are serialised one by one, from their index and their time [ns]."""

    def rows(start: int, stop: int) -> list[bytes]:
        return [encode(i, int(time_ns[i])) for i in range(start, stop)]

    return Channel(topic, schema, time_ns, rows)


def slot_pose(first: int) -> Pose:
    """A pose whose slots take x, y, z and then the quaternion (w, x, y, z)."""
    slots = [slot(first + k) for k in range(7)]
    return pose(slots[:3], slots[3:])


def _transforms(flight: Flight, clock: Clock) -> Channel:
    """World to vehicles, and vehicles to transmitters and hydrophones."""
    t = flight.trajectory

    def transform(parent: str, child: str, translation: Sequence[float], quaternion: Sequence[float]) -> FrameTransform:
        w, x, y, z = quaternion
        return FrameTransform(
            timestamp=STAMP,
            parent_frame_id=parent,
            child_frame_id=child,
            translation=vector(translation),
            rotation=Quaternion(x=x, y=y, z=z, w=w),
        )

    transforms = []
    for v, name in enumerate(t.names):
        slots = [slot(7 * v + k) for k in range(7)]
        transforms.append(transform("world", name, slots[:3], slots[3:]))
    for name, v, offset in zip(t.site_names, t.site_vehicle.tolist(), t.site_offset.tolist(), strict=True):
        if name.rpartition("/")[2].startswith(("tx_", "hydrophone")):
            transforms.append(transform(t.names[v], name, offset, (1.0, 0.0, 0.0, 0.0)))

    def values(part: slice) -> Floats:
        return np.concatenate([t.position[part], t.quaternion[part]], axis=2).reshape(-1, 7 * len(t.names))

    layout = FixedLayout(FrameTransforms(transforms=transforms).encode(), 7 * len(t.names))
    return _numeric("/tf", FrameTransforms.get_schema(), layout, clock.ns(t.time), values)


def _poses(topic: str, time_ns: Ints, values: Callable[[slice], Floats]) -> Channel:
    message = PoseInFrame(timestamp=STAMP, frame_id="world", pose=slot_pose(0))
    return _numeric(topic, PoseInFrame.get_schema(), FixedLayout(message.encode(), 7), time_ns, values)


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
    name, time_ns = t.names[v], clock.ns(t.time)
    second = round(1.0 / CONTROL_STEP_S)
    effectors = t.effector_names[v] if t.effector_names else ()

    def state(part: slice) -> Floats:
        derived = [x[part, v] for x in (t.depth, t.heading, t.pitch, t.roll, t.forward_speed)]
        thrust = t.thrust[..., : len(effectors)]
        vectors = (t.velocity, t.angular_velocity, t.water_velocity, thrust)
        return np.column_stack([t.time[part], *(x[part, v] for x in vectors), *derived])

    return [
        _poses(f"/{name}/pose", time_ns, lambda part: np.hstack([t.position[part, v], t.quaternion[part, v]])),
        _scalars(f"/{name}/state", vehicle_state(effectors), time_ns, state),
        _locations(
            f"/{name}/fix",
            time_ns[::second],
            geodetic(t.position[::second, v], scenario.origin_latitude_deg, scenario.origin_longitude_deg),
        ),
    ]


def _mixture(topic: str, e: TightEstimates, time_ns: Ints) -> Channel:
    """Biases and hypotheses of the tightly coupled navigator after each message."""

    def estimate(part: slice) -> Floats:
        spread = e.hypothesis_covariance[part]
        pairs = np.stack([spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]], axis=2)
        m = len(spread)
        numbers = (e.nis[part], e.full_state[part], e.full_sigma[part], e.weight[part])
        places = (e.hypothesis[part].reshape(m, -1), pairs.reshape(m, -1))
        return np.column_stack([*numbers, *places, e.used[part].view(np.float64)])

    return _scalars(topic, MIXTURE, time_ns, estimate)


def _follower(flight: Flight, clock: Clock, f: int) -> list[Channel]:
    m, e, scenario = flight.measurements[f], flight.estimates[f], flight.scenario
    name, n = flight.trajectory.names[f + 1], m.speed.size
    time_ns = clock.ns(m.dt * np.arange(1, n + 1))
    estimated = np.column_stack([e.state[:, :2], -m.depth])
    second = max(1, round(1.0 / m.dt))
    each = slice(second - 1, None, second)
    place = geodetic(estimated[each], scenario.origin_latitude_deg, scenario.origin_longitude_deg)

    def estimate(part: slice) -> Floats:
        return np.hstack([estimated[part], attitude.from_euler(m.heading[part])])

    def fix(part: slice) -> Floats:
        numbers = (e.fix_position, e.fix_sigma, e.innovation, e.innovation_covariance.reshape(-1, 4))
        return np.column_stack([*(x[part] for x in numbers), e.fix_kind[part].view(np.float64)])

    mixture = [_mixture(f"/{name}/mixture", e, time_ns[e.fix_step - 1])] if isinstance(e, TightEstimates) else []
    return [
        *mixture,
        _scalars(
            f"/{name}/motion",
            OWN_MOTION,
            time_ns,
            lambda part: np.column_stack([m.speed[part], m.heading[part], m.depth[part]]),
        ),
        _scalars(
            f"/{name}/reception",
            RECEPTION,
            time_ns[m.message_step - 1],
            lambda part: np.hstack([m.message[part], m.ranges[part]]),
        ),
        _scalars(
            f"/{name}/filter",
            FILTER_STATE,
            time_ns,
            lambda part: np.hstack([e.state[part], e.covariance[part].reshape(-1, 16)]),
        ),
        _scalars(f"/{name}/innovation", FIX, time_ns[e.fix_step - 1], fix),
        _poses(f"/{name}/estimate", time_ns, estimate),
        _locations(f"/{name}/estimate/fix", time_ns[each], place, e.covariance[each, :2, :2]),
    ]


def _error(flight: Flight, clock: Clock, f: int, errors: Errors) -> Channel:
    m, name = flight.measurements[f], flight.trajectory.names[f + 1]
    n = m.speed.size
    if any(error.shape != (n,) for error in errors):
        raise ValueError(f"errors of {name} have shapes {[e.shape for e in errors]}, expected ({n},) twice")
    values = np.column_stack(errors)
    return _scalars(f"/{name}/error", ERROR, clock.ns(m.dt * np.arange(1, n + 1)), lambda part: values[part])


def _events(flight: Flight, clock: Clock, events: Iterable[Event]) -> Channel:
    lines = log_events(flight, events)

    def encode(i: int, at: int) -> bytes:
        line = lines[i]
        level = getattr(LogLevel, line.level.capitalize())
        return Log(timestamp=timestamp(at), level=level, message=line.text, name=line.source).encode()

    return _single("/log", Log.get_schema(), clock.ns([line.time_s for line in lines]), encode)


def _scene(flight: Flight, clock: Clock) -> list[Channel]:
    t, schema = flight.trajectory, SceneUpdate.get_schema()
    seconds = np.arange(0, t.time.size, round(1.0 / CONTROL_STEP_S), dtype=np.int64)
    received: Ints = np.unique(np.concatenate([m.message_step for m in flight.measurements]))
    acoustic_ns = clock.ns(received * flight.measurements[0].dt)
    return [
        _single("/scene/vehicles", schema, clock.ns(t.time[seconds]), draw_vehicles(flight, seconds)),
        _single("/scene/acoustics", schema, acoustic_ns, draw_acoustics(flight, received)),
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
