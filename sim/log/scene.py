"""What Foxglove draws in three dimensions: hulls, trails and uncertainty at 1 Hz, rays and ranges at each ping."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Duration,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    SceneEntity,
    SceneUpdate,
    SpherePrimitive,
    TriangleListPrimitive,
)

from laisn.arrays import Floats, Ints
from laisn.estimates import Estimates, FixKind
from laisn.messages import Ranges
from laisn.tight.estimates import TightEstimates
from sim.assembly import models_of
from sim.flight import Flight
from sim.log.clock import timestamp
from sim.log.hull import Shape, hull
from sim.log.schema import pose, vector

Draw = Callable[[int, int], bytes]
"""Serialises the SceneUpdate of one instant: index on its own time grid, and time since 1970 [ns]."""

TRAIL_S = 100
"""Length of the trails [s], a point every second."""
CONFIDENCE = float(np.sqrt(-2.0 * np.log(0.05)))
"""Half axes of the 95 % ellipse in standard deviations: the quantile of a Rayleigh distribution."""
DISC_M = 0.02
"""Thickness of range discs and of the ellipse [m]."""
_FIX_M = 0.4
"""Diameter of a fix [m]."""

TRUTH = Color(r=0.95, g=0.62, b=0.08, a=0.9)
ESTIMATE = Color(r=0.85, g=0.15, b=0.75, a=0.9)
UNCERTAINTY = Color(r=0.85, g=0.15, b=0.75, a=0.35)
RAY = Color(r=0.20, g=0.75, b=0.95, a=0.9)
RANGE = Color(r=0.20, g=0.75, b=0.95, a=0.05)
ACCEPTED = Color(r=0.15, g=0.80, b=0.25, a=1.0)
REJECTED = Color(r=0.90, g=0.15, b=0.10, a=1.0)


def _points(position: Floats) -> list[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y, z in position.tolist()]


def _line(kind: LinePrimitiveLineType, color: Color, points: list[Point3]) -> LinePrimitive:
    """A line two pixels wide."""
    return LinePrimitive(type=kind, thickness=2.0, scale_invariant=True, points=points, color=color)


def _cylinder(place: Pose, size: Sequence[float], color: Color) -> CylinderPrimitive:
    return CylinderPrimitive(pose=place, size=vector(size), bottom_scale=1.0, top_scale=1.0, color=color)


def _primitives(shapes: Sequence[Shape]) -> dict[str, list[Any]]:
    """A hull as fields of a SceneEntity."""
    result: dict[str, list[Any]] = {"cylinders": [], "spheres": [], "cubes": [], "triangles": []}
    for s in shapes:
        place, size = pose(s.position.tolist(), s.quaternion.tolist()), s.size.tolist()
        color = Color(**dict(zip("rgba", s.rgba, strict=True)))
        if s.kind == "cylinder":
            result["cylinders"].append(_cylinder(place, size, color))
        elif s.kind == "ellipsoid":
            result["spheres"].append(SpherePrimitive(pose=place, size=vector(size), color=color))
        elif s.kind == "box":
            result["cubes"].append(CubePrimitive(pose=place, size=vector(size), color=color))
        else:
            points, indices = _points(s.vertices), s.faces.ravel().tolist()
            result["triangles"].append(TriangleListPrimitive(pose=place, points=points, indices=indices, color=color))
    return result


def ellipse(covariance: Floats) -> tuple[Floats, Floats]:
    """The 95 % ellipses of horizontal positions with covariances of shape (…, 2, 2).

    Returns:
        Longer and shorter half axis, shape (…, 2), [m], and the longer one's direction, shape (…), anticlockwise from
        east, [rad].
    """
    variance, axes = np.linalg.eigh(covariance)
    return CONFIDENCE * np.sqrt(np.maximum(variance[..., ::-1], 0.0)), np.arctan2(axes[..., 1, 1], axes[..., 0, 1])


def _disc(position: Sequence[float], half_axes: Sequence[float], direction: float) -> SpherePrimitive:
    """An ellipse as a flat spheroid."""
    place = pose(position, (math.cos(direction / 2), 0.0, 0.0, math.sin(direction / 2)))
    major, minor = half_axes
    return SpherePrimitive(pose=place, size=vector((2 * major, 2 * minor, DISC_M)), color=UNCERTAINTY)


def _discs(position: Floats, covariance: Floats) -> list[SpherePrimitive]:
    """The 95 % ellipses of positions, shape (n, 3), with horizontal covariances, shape (n, 2, 2)."""
    half_axes, direction = ellipse(covariance)
    return [_disc(*one) for one in zip(position.tolist(), half_axes.tolist(), direction.tolist(), strict=True)]


def _hypotheses(estimates: Estimates, row: int, z: float) -> list[SpherePrimitive]:
    """Ellipses of all hypotheses after the last message, if there are several."""
    if not isinstance(estimates, TightEstimates):
        return []
    made = int(np.searchsorted(estimates.fix_step, row + 1, side="right")) - 1
    kept = np.flatnonzero(estimates.weight[made] > 0.0) if made >= 0 else np.empty(0)
    if kept.size < 2:
        return []
    position = np.column_stack([estimates.hypothesis[made, kept], np.full(kept.size, z)])
    return _discs(position, estimates.hypothesis_covariance[made, kept])


def draw_vehicles(flight: Flight, index: Ints) -> Draw:
    """Hulls, trails of truth and estimate, and 95 % ellipses; every update is complete, so that seeking shows it all.

    Args:
        index: points of the trajectory to draw at, a second apart, shape (n,).
    """
    names = flight.trajectory.names
    hulls = [_primitives(hull(model)) for model in models_of(flight.scenario)]
    trails = [_points(flight.trajectory.position[index, v]) for v in range(len(names))]
    # the last filter step at or before each point; the state of step k stands in row k − 1
    rows = [np.minimum(index // flight.stride, e.state.shape[0]) - 1 for e in flight.estimates]
    skipped = [int(np.count_nonzero(row < 0)) for row in rows]
    estimated, discs = [], []
    for e, m, row in zip(flight.estimates, flight.measurements, rows, strict=True):
        row = row[row >= 0]
        position, covariance = np.column_stack([e.state[row, :2], -m.depth[row]]), e.covariance[row, :2, :2]
        # a filter that left finite numbers has a trail but no ellipse
        finite = np.isfinite(covariance).all(axis=(1, 2))
        drawn = iter(_discs(position[finite], covariance[finite]))
        discs.append([[next(drawn)] if there else [] for there in finite.tolist()])  # type: ignore[union-attr]  # of one axis
        estimated.append(_points(position))

    def trail(color: Color, points: list[Point3], i: int) -> LinePrimitive:
        return _line(LinePrimitiveLineType.LineStrip, color, points[max(0, i - TRAIL_S) : i + 1])

    def draw(i: int, time_ns: int) -> bytes:
        stamp, entities = timestamp(time_ns), []
        for name, parts, points in zip(names, hulls, trails, strict=True):
            entities.append(
                SceneEntity(timestamp=stamp, id=f"{name}/hull", frame_id=name, frame_locked=True, **parts)  # type: ignore[arg-type]
            )
            lines = [trail(TRUTH, points, i)]
            entities.append(SceneEntity(timestamp=stamp, id=f"{name}/trail", frame_id="world", lines=lines))
        for f, name in enumerate(names[1:]):
            k = i - skipped[f]
            if k < 0:
                continue
            row = int(rows[f][i])
            spheres = discs[f][k] + _hypotheses(flight.estimates[f], row, -float(flight.measurements[f].depth[row]))
            lines = [trail(ESTIMATE, estimated[f], k)]
            entities.append(
                SceneEntity(timestamp=stamp, id=f"{name}/estimate", frame_id="world", spheres=spheres, lines=lines)
            )
        return SceneUpdate(entities=entities).encode()

    return draw


class _Follower:
    """What a follower received and estimated, message by message."""

    def __init__(self, flight: Flight, follower: int) -> None:
        t = flight.trajectory
        self._id = f"{t.names[follower + 1]}/ping"
        self._lifetime = Duration(sec=math.ceil(flight.scenario.timing.message_interval_s), nsec=0)
        m, e = flight.measurements[follower], flight.estimates[follower]
        self.messages = {step: i for i, step in enumerate(m.message_step.tolist())}
        sites = t.site_position[m.message_step * flight.stride]
        sources = [f"leader/tx_{transmitter}" for transmitter in Ranges._fields]
        there = [k for k, name in enumerate(sources) if name in t.site_names]
        self._ranges = m.ranges[:, there].tolist()
        self._sources = sites[:, [t.site(sources[k]) for k in there]].tolist()
        self._hydrophone = sites[:, t.site(f"{t.names[follower + 1]}/hydrophone")].tolist()
        self._fixes: dict[int, list[SpherePrimitive]] = {}
        for step, position, kind in zip(e.fix_step.tolist(), e.fix_position.tolist(), e.fix_kind.tolist(), strict=True):
            if all(map(math.isfinite, position)):
                color = REJECTED if kind == FixKind.GATED else ACCEPTED
                place = pose([*position, -float(m.depth[step - 1])])
                sphere = SpherePrimitive(pose=place, size=vector([_FIX_M] * 3), color=color)
                self._fixes.setdefault(step, []).append(sphere)

    def ping(self, step: int, time_ns: int) -> SceneEntity:
        """Rays, range discs and fixes of the message of a step, at the true positions of the vehicles."""
        message = self.messages[step]
        x, y, z = self._hydrophone[message]
        ends, discs = [], []
        for (east, north, up), slant in zip(self._sources[message], self._ranges[message], strict=True):
            if math.isfinite(slant):
                ends += [Point3(x=east, y=north, z=up), Point3(x=x, y=y, z=z)]
                squared = slant**2 - (up - z) ** 2
                if squared > 0:
                    width = 2 * math.sqrt(squared)
                    discs.append(_cylinder(pose((east, north, z)), (width, width, DISC_M), RANGE))
        return SceneEntity(
            timestamp=timestamp(time_ns),
            frame_id="world",
            id=self._id,
            lifetime=self._lifetime,
            cylinders=discs,
            spheres=self._fixes.get(step, []),
            lines=[_line(LinePrimitiveLineType.LineList, RAY, ends)] if ends else [],
        )


def draw_acoustics(flight: Flight, steps: Ints) -> Draw:
    """Rays from the transmitters, discs of the horizontal ranges at the hydrophone's depth, and the fixes (red: gated).

    Args:
        steps: filter steps at which any follower receives a message, shape (n,).
    """
    followers = [_Follower(flight, f) for f in range(len(flight.measurements))]

    def draw(i: int, time_ns: int) -> bytes:
        step = int(steps[i])
        pings = [follower.ping(step, time_ns) for follower in followers if step in follower.messages]
        return SceneUpdate(entities=pings).encode()

    return draw
