"""What Foxglove draws in three dimensions: hulls, trails and uncertainty at 1 Hz, rays and ranges at each ping."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration

from laisn.arrays import Floats, Ints
from laisn.estimates import Estimates, FixKind
from laisn.messages import Ranges
from laisn.tight.estimates import TightEstimates
from sim.assembly import models_of
from sim.flight import Flight
from sim.log.clock import timestamp
from sim.log.hull import cylinder, hull, pose

Draw = Callable[[int, int], bytes]
"""Serialises the SceneUpdate of one instant: index on its own time grid, and time since 1970 [ns]."""

TRAIL_S = 100
"""Length of the trails [s], a point every second."""
CONFIDENCE = float(np.sqrt(-2.0 * np.log(0.05)))
"""Half axes of the 95 % ellipse in standard deviations: the quantile of a Rayleigh distribution."""
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
DISC_M = 0.02
"""Thickness of range discs and of the ellipse [m]."""

TRUTH = Color(r=0.95, g=0.62, b=0.08, a=0.9)
BELIEF = Color(r=0.85, g=0.15, b=0.75, a=0.9)
UNCERTAINTY = Color(r=0.85, g=0.15, b=0.75, a=0.35)
RAY = Color(r=0.20, g=0.75, b=0.95, a=0.9)
RANGE = Color(r=0.20, g=0.75, b=0.95, a=0.05)
ACCEPTED = Color(r=0.15, g=0.80, b=0.25, a=1.0)
REFUSED = Color(r=0.90, g=0.15, b=0.10, a=1.0)


def _varint(number: int) -> bytes:
    groups = bytearray()
    while number > 0x7F:
        groups.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*groups, number])


def _field(number: int, content: bytes) -> bytes:
    """A message within a message, on the wire: its field's number, its length, its content."""
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _line(kind: Any, color: Any, points: bytes) -> bytes:
    """A line two pixels wide, serialised as the field of an entity; `points` are serialised (`_points`).

    A trail is some hundred points each second: taken apart and put together by protobuf, they would cost ten times as
    much.
    """
    before = LinePrimitive(type=kind, thickness=2.0, scale_invariant=True).SerializeToString()
    return _field(SceneEntity.LINES_FIELD_NUMBER, before + points + LinePrimitive(color=color).SerializeToString())


def _update(entities: Iterable[bytes]) -> bytes:
    """A SceneUpdate of serialised entities."""
    return b"".join(_field(SceneUpdate.ENTITIES_FIELD_NUMBER, entity) for entity in entities)


def _points(position: Floats) -> bytes:
    """Points of a line, shape (n, 3), serialised: n times 29 bytes, so that trails are slices."""
    block = np.empty((len(position), 29), dtype=np.uint8)
    sample = LinePrimitive(points=[Point3(x=1.0, y=1.0, z=1.0)])
    block[:] = np.frombuffer(sample.SerializeToString(), dtype=np.uint8)
    for axis in range(3):
        start = 3 + 9 * axis
        block[:, start : start + 8] = np.ascontiguousarray(position[:, axis : axis + 1], "<f8").view(np.uint8)
    return block.tobytes()


def _trail(points: bytes, i: int) -> bytes:
    return points[29 * max(0, i - TRAIL_S) : 29 * (i + 1)]


def ellipse(covariance: Floats) -> tuple[Floats, Floats]:
    """The 95 % ellipses of horizontal positions with covariances of shape (…, 2, 2).

    Returns:
        Longer and shorter half axis, shape (…, 2), [m], and the longer one's direction, shape (…), anticlockwise from
        east, [rad].
    """
    variance, axes = np.linalg.eigh(covariance)
    return CONFIDENCE * np.sqrt(np.maximum(variance[..., ::-1], 0.0)), np.arctan2(axes[..., 1, 1], axes[..., 0, 1])


def _disc(x: float, y: float, z: float, covariance: Floats) -> Any:
    """The 95 % ellipse of a horizontal position with `covariance`, shape (2, 2), as a flat spheroid."""
    half_axes, direction = ellipse(covariance)
    major, minor = 2 * half_axes
    half = direction / 2
    place = pose(np.array([x, y, z]), np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
    return SpherePrimitive(pose=place, size=Vector3(x=major, y=minor, z=DISC_M), color=UNCERTAINTY)


def _other_sides(estimates: Estimates, row: int, z: float) -> list[Any]:
    """Ellipses of all hypotheses after the last message, if there are several."""
    made = int(np.searchsorted(estimates.fix_step, row + 1, side="right")) - 1
    if not isinstance(estimates, TightEstimates) or made < 0:
        return []
    believed = np.flatnonzero(estimates.weight[made] > 0.0)
    places, spread = estimates.hypothesis[made], estimates.hypothesis_covariance[made]
    if believed.size < 2:
        return []
    return [_disc(float(places[h, 0]), float(places[h, 1]), z, spread[h]) for h in believed.tolist()]


def _entity(name: str, frame: str, stamp: Any, **parts: Any) -> Any:
    return SceneEntity(id=name, frame_id=frame, timestamp=stamp, **parts)


def draw_vehicles(flight: Flight, index: Ints) -> Draw:
    """Hulls, trails of truth and belief, and 95 % ellipses; every update is complete, so that seeking shows it all.

    Args:
        index: points of the trajectory to draw at, a second apart, shape (n,).
    """
    names = flight.trajectory.names
    hulls = [hull(model) for model in models_of(flight.scenario)]
    trails = [_points(flight.trajectory.position[index, v]) for v in range(len(names))]
    # the last filter step at or before each point; the state of step k stands in row k − 1
    row = np.minimum(index // flight.stride, [[e.state.shape[0]] for e in flight.estimates]) - 1
    beliefs = [
        np.column_stack([e.state[k[k >= 0], :2], -m.depth[k[k >= 0]]])
        for e, m, k in zip(flight.estimates, flight.measurements, row, strict=True)
    ]
    believed = [_points(belief) for belief in beliefs]
    strip = LinePrimitive.LINE_STRIP
    # fields stand in the order of their numbers: the time comes first, lines come last
    still = []
    for v, name in enumerate(names):
        entity = SceneEntity(id=f"{name}/hull", frame_id=name, frame_locked=True)
        entity.MergeFrom(hulls[v])
        trail = SceneEntity(id=f"{name}/trail", frame_id="world")
        still.append((entity.SerializeToString(), trail.SerializeToString()))

    def draw(i: int, time_ns: int) -> bytes:
        stamp = timestamp(time_ns)
        stamped = SceneEntity(timestamp=stamp).SerializeToString()
        entities: list[bytes] = []
        for trail, (entity, nameplate) in zip(trails, still, strict=True):
            entities += (stamped + entity, stamped + nameplate + _line(strip, TRUTH, _trail(trail, i)))
        for f, name in enumerate(names[1:]):
            skipped = int(np.count_nonzero(row[f] < 0))
            if i < skipped:
                continue
            x, y, z = beliefs[f][i - skipped].tolist()
            covariance = flight.estimates[f].covariance[row[f, i], :2, :2]
            # a filter that left finite numbers has a trail but no ellipse
            ellipses = [_disc(x, y, z, covariance)] if np.isfinite(covariance).all() else []
            ellipses += _other_sides(flight.estimates[f], int(row[f, i]), z)
            place = _entity(f"{name}/estimate", "world", stamp, spheres=ellipses)
            entities.append(place.SerializeToString() + _line(strip, BELIEF, _trail(believed[f], i - skipped)))
        return _update(entities)

    return draw


def _ping(flight: Flight, follower: int, message: int, stamp: Any) -> Any:
    """Rays, range discs and fixes of one message, seen where the vehicles truly are."""
    trajectory, measured, estimated = flight.trajectory, flight.measurements[follower], flight.estimates[follower]
    name, step = trajectory.names[follower + 1], int(measured.message_step[message])
    sites = trajectory.site_position[step * flight.stride]
    hydrophone = sites[trajectory.site(f"{name}/hydrophone")]
    entity = _entity(f"{name}/ping", "world", stamp)
    entity.lifetime.CopyFrom(Duration(nanos=0, seconds=int(np.ceil(flight.scenario.timing.message_interval_s))))
    ends: list[Floats] = []
    for transmitter, slant in zip(Ranges._fields, measured.ranges[message].tolist(), strict=True):
        site = f"leader/tx_{transmitter}"
        if site not in trajectory.site_names or not np.isfinite(slant):
            continue
        source = sites[trajectory.site(site)]
        ends += [source, hydrophone]
        squared = slant**2 - (source[2] - hydrophone[2]) ** 2
        if squared > 0:
            place = pose(np.array([source[0], source[1], hydrophone[2]]), LEVEL)
            entity.cylinders.append(cylinder(place, RANGE, radius=float(np.sqrt(squared)), length=DISC_M))
    if ends:
        entity.MergeFromString(_line(LinePrimitive.LINE_LIST, RAY, _points(np.array(ends))))
    for i in np.flatnonzero(estimated.fix_step == step):
        if np.isfinite(estimated.fix_position[i]).all():
            place = pose(np.array([*estimated.fix_position[i], -measured.depth[step - 1]]), LEVEL)
            color = REFUSED if estimated.fix_kind[i] == FixKind.GATED else ACCEPTED
            entity.spheres.append(SpherePrimitive(pose=place, size=Vector3(x=0.4, y=0.4, z=0.4), color=color))
    return entity


def draw_acoustics(flight: Flight, step: Ints) -> Draw:
    """Rays from the transmitters, discs of the horizontal ranges at the hydrophone's depth, and the fixes (red: gated).

    Args:
        step: filter steps at which any follower hears a message, shape (n,).
    """
    heard = [{k: i for i, k in enumerate(m.message_step.tolist())} for m in flight.measurements]

    def draw(i: int, time_ns: int) -> bytes:
        stamp = timestamp(time_ns)
        k = int(step[i])
        pings = [_ping(flight, f, messages[k], stamp) for f, messages in enumerate(heard) if k in messages]
        return bytes(SceneUpdate(entities=pings).SerializeToString())

    return draw
