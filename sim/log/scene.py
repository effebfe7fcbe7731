"""What Foxglove draws: hulls, trails and uncertainty at 1 Hz, rays and ranges at each ping; and
a layout of panels.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import resources
from typing import Any

import jinja2
import mujoco
import numpy as np
from foxglove import messages as fg

from laisn.arrays import Ints
from laisn.estimates import Estimates, FixKind
from laisn.messages import Ranges
from sim.flight import FlightRecord
from sim.log import templates
from sim.log.schema import pose, timestamp, vector
from sim.vehicle.effectors import MovingFins
from sim.vehicle.mjcf import spec_of

Draw = Callable[[int, int], fg.SceneUpdate]
"""Draws the instant of a time since 1970 [ns] and an index on its own time grid."""

# of the paths of vehicles and of estimates that are drawn
TRAIL_S = 100  # length of trails, also in points of trajectories a second apart
_TRAIL_POINTS = 500  # of all trails together, beyond which they have fewer than one a second
_LONGEST_STEP_S = 10  # most time from one point of a trail to the next
_CONFIDENCE = math.sqrt(-2.0 * math.log(0.05))  # half axes of 95 % ellipses [standard deviations]
_DISC_M = 0.02  # thickness of discs and ellipses
_FIX_M = 0.4  # diameter of a fix

TRUTH = fg.Color(r=0.95, g=0.62, b=0.08, a=0.9)
ESTIMATE = fg.Color(r=0.85, g=0.15, b=0.75, a=0.9)
_UNCERTAINTY = fg.Color(r=0.85, g=0.15, b=0.75, a=0.35)
_RAY = fg.Color(r=0.20, g=0.75, b=0.95, a=0.9)
_RANGE = fg.Color(r=0.20, g=0.75, b=0.95, a=0.05)
_ACCEPTED = fg.Color(r=0.15, g=0.80, b=0.25, a=1.0)
_REJECTED = fg.Color(r=0.90, g=0.15, b=0.10, a=1.0)
LEADER_HUE = "#ffad33"
FOLLOWER_HUE = "#fff240"
ESTIMATE_HUE = "#ff40d9"
"""Colours of the film."""


def _points(places: Iterable[Sequence[float]]) -> list[fg.Point3]:
    return [fg.Point3(x=x, y=y, z=z) for x, y, z in places]


def _line(
    kind: fg.LinePrimitiveLineType, color: fg.Color, points: list[fg.Point3]
) -> fg.LinePrimitive:
    return fg.LinePrimitive(
        type=kind, thickness=2.0, scale_invariant=True, points=points, color=color
    )


def _cylinder(pose: fg.Pose, size: Sequence[float], color: fg.Color) -> fg.CylinderPrimitive:
    return fg.CylinderPrimitive(
        pose=pose, size=vector(size), bottom_scale=1.0, top_scale=1.0, color=color
    )


def _sphere(pose: fg.Pose, size: Sequence[float], color: fg.Color) -> fg.SpherePrimitive:
    return fg.SpherePrimitive(pose=pose, size=vector(size), color=color)


def hull(model: mujoco.MjModel) -> dict[str, list[Any]]:
    """Everything visible of a compiled vehicle, in its body frame, as fields of a SceneEntity."""
    parts: dict[str, list[Any]] = {"cylinders": [], "spheres": [], "cubes": [], "triangles": []}
    kinds = mujoco.mjtGeom
    for geom in range(model.ngeom):
        kind = kinds(model.geom_type[geom])
        material = model.geom_matid[geom]
        wxyz = model.geom_quat[geom]
        position = model.geom_pos[geom]
        size = (2 * model.geom_size[geom]).tolist()
        rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        color = fg.Color(**dict(zip("rgba", rgba.tolist(), strict=True)))
        geom_pose = pose(position.tolist(), wxyz.tolist())
        width, length, _ = size
        if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
            parts["cylinders"].append(_cylinder(geom_pose, (width, width, length), color))
        if kind == kinds.mjGEOM_CAPSULE:
            end = np.zeros(3)
            mujoco.mju_rotVecQuat(end, np.array([0.0, 0.0, length / 2]), wxyz)
            ends = [pose(p.tolist()) for p in (position - end, position + end)]
            parts["spheres"] += [_sphere(end_pose, [width] * 3, color) for end_pose in ends]
        elif kind == kinds.mjGEOM_BOX:
            parts["cubes"].append(fg.CubePrimitive(pose=geom_pose, size=vector(size), color=color))
        elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
            parts["spheres"].append(
                _sphere(geom_pose, [width] * 3 if kind == kinds.mjGEOM_SPHERE else size, color)
            )
        elif kind == kinds.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][
                : model.mesh_vertnum[mesh]
            ].astype(np.float64)
            faces = (
                model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
                .ravel()
                .tolist()
            )
            parts["triangles"].append(
                fg.TriangleListPrimitive(
                    pose=geom_pose, points=_points(vertices.tolist()), indices=faces, color=color
                )
            )
    return parts


def _ellipses(estimates: Estimates, row: int, z: float) -> Iterator[fg.SpherePrimitive]:
    """95 % ellipses, flat spheroids, of the estimate in a row, and of all hypotheses after the
    last message before.
    """
    places = [estimates.state[row, :2]]
    spreads = [estimates.covariance[row, :2, :2]]
    latest = int(np.searchsorted(estimates.fix_step, row + 1, side="right")) - 1
    weight, position, covariance = estimates.hypotheses
    present = np.flatnonzero(weight[latest] > 0.0) if latest >= 0 else np.empty(0, dtype=np.int64)
    if present.size > 1:
        places += list(position[latest, present])
        spreads += list(covariance[latest, present])
    for centre, spread in zip(places, spreads, strict=True):
        # a filter that left finite numbers has a trail but no ellipse
        if np.isfinite(spread).all():
            (xx, xy), (_, yy) = spread.tolist()
            mean = (xx + yy) / 2
            half_difference = math.hypot((xx - yy) / 2, xy)
            # eigenvalues, and half of the larger one's direction
            major, minor = (
                2 * _CONFIDENCE * math.sqrt(max(value, 0.0))
                for value in (mean + half_difference, mean - half_difference)
            )
            half_turn = math.atan2(2 * xy, xx - yy) / 4
            ellipse_pose = pose(
                (*centre.tolist(), z), (math.cos(half_turn), 0.0, 0.0, math.sin(half_turn))
            )
            yield _sphere(ellipse_pose, (major, minor, _DISC_M), _UNCERTAINTY)


class VisibleHulls:
    """What is visible of vehicles, and their fins."""

    def __init__(self, models: Sequence[str]) -> None:
        """Compile their models, as `VehicleSetup` takes them."""
        self.models = [spec_of(model).compile() for model in models]
        self.fins = [MovingFins(model) for model in self.models]


def draw_hulls(flight: FlightRecord, index: Ints, hulls: VisibleHulls) -> tuple[Ints, Draw]:
    """Points of the trajectory at which hulls are drawn, shape (n,): the first alone if none has
    moving fins.
    """
    names = flight.trajectory.names
    states = flight.trajectory.effector_states[index]
    compiled = hulls.models
    fins = hulls.fins
    move = states.shape[2] > 0 and any(fins)

    def draw(time_ns: int, i: int) -> fg.SceneUpdate:
        entities = []
        for v, name in enumerate(names):
            if move:
                fins[v].turn(states[i, v])
            options: dict[str, Any] = {
                "id": f"{name}/hull",
                "frame_id": name,
                "frame_locked": True,
                **hull(compiled[v]),
            }
            entities.append(fg.SceneEntity(timestamp=timestamp(time_ns), **options))
        return fg.SceneUpdate(entities=entities)

    return index if move else index[:1], draw


def trail_step(trails: int) -> int:
    """Time from one point of a trail to the next [s]: each update has all of them again."""
    return min(max(1, math.ceil(trails * TRAIL_S / _TRAIL_POINTS)), _LONGEST_STEP_S)


def draw_vehicles(flight: FlightRecord, index: Ints) -> Draw:
    """Complete updates of trails and 95 % ellipses at points of the trajectory a second apart,
    shape (n,).
    """
    names = flight.trajectory.names
    trails = [_points(flight.trajectory.position[index, v].tolist()) for v in range(len(names))]
    # the last filter step at or before each point; the state of step k stands in row k − 1
    rows = [np.minimum(index // flight.stride, e.state.shape[0]) - 1 for e in flight.estimates]
    missing_counts = [int(np.count_nonzero(row < 0)) for row in rows]
    step = trail_step(len(names) + len(flight.estimates))
    # points stand at whole steps of the mission, wherever this part of it begins
    begin = round(float(flight.trajectory.time[index[0]])) if index.size else 0

    def recent(points: list[fg.Point3], last: int, omitted: int = 0) -> list[fg.Point3]:
        """Points of a trail until the point `last` of the mission; `points` lacks the first
        `omitted`, before there was an estimate.
        """
        first = max(omitted, last - TRAIL_S)
        first += -(begin + first) % step
        return [*points[first - omitted : last - omitted : step], points[last - omitted]]

    estimated = [
        _points(np.column_stack([e.state[row, :2], -m.depth[row]])[row >= 0].tolist())
        for e, m, row in zip(flight.estimates, flight.measurements, rows, strict=True)
    ]

    def draw(time_ns: int, i: int) -> fg.SceneUpdate:
        stamp = timestamp(time_ns)
        entities = []

        def trail(
            name: str, color: fg.Color, points: list[fg.Point3], **options: Any
        ) -> fg.SceneEntity:
            lines = [_line(fg.LinePrimitiveLineType.LineStrip, color, points)]
            return fg.SceneEntity(
                timestamp=stamp, id=name, frame_id="world", lines=lines, **options
            )

        for name, points in zip(names, trails, strict=True):
            entities.append(trail(f"{name}/trail", TRUTH, recent(points, i)))
        for name, e, m, row, points, omitted in zip(
            names[1:],
            flight.estimates,
            flight.measurements,
            rows,
            estimated,
            missing_counts,
            strict=True,
        ):
            if row[i] >= 0:
                spheres = list(_ellipses(e, int(row[i]), -float(m.depth[row[i]])))
                trail_points = recent(points, i, omitted)
                entities.append(trail(f"{name}/estimate", ESTIMATE, trail_points, spheres=spheres))
        return fg.SceneUpdate(entities=entities)

    return draw


def _ping(
    flight: FlightRecord,
    follower: int,
    message: int,
    time_ns: int,
    sites: Mapping[str, Sequence[float]],
) -> fg.SceneEntity:
    """Rays, range discs and fixes of a message, at the true positions of the sites [m]."""
    t = flight.trajectory
    m = flight.measurements[follower]
    e = flight.estimates[follower]
    name = t.names[follower + 1]
    step = m.message_step[message]
    x, y, z = sites[f"{name}/hydrophone"]
    ends = []
    discs = []
    fixes = []
    for transmitter, slant_range in zip(Ranges._fields, m.ranges[message].tolist(), strict=True):
        if (
            math.isfinite(slant_range)
            and (source := sites.get(f"leader/tx_{transmitter}")) is not None
        ):
            ends += _points([source, (x, y, z)])
            squared = slant_range**2 - (source[2] - z) ** 2
            if squared > 0:
                width = 2 * math.sqrt(squared)
                discs.append(_cylinder(pose((*source[:2], z)), (width, width, _DISC_M), _RANGE))
    for fix in np.flatnonzero(e.fix_step == step).tolist():
        position = e.fix_position[fix].tolist()
        if all(map(math.isfinite, position)):
            color = _REJECTED if e.fix_kind[fix] == FixKind.GATED else _ACCEPTED
            fixes.append(_sphere(pose((*position, -float(m.depth[step - 1]))), [_FIX_M] * 3, color))
    return fg.SceneEntity(
        timestamp=timestamp(time_ns),
        frame_id="world",
        id=f"{name}/ping",
        lifetime=fg.Duration(sec=math.ceil(flight.scenario.timing.message_interval_s), nsec=0),
        cylinders=discs,
        spheres=fixes,
        lines=[_line(fg.LinePrimitiveLineType.LineList, _RAY, ends)] if ends else [],
    )


def draw_acoustics(flight: FlightRecord, steps: Ints) -> Draw:
    """Rays, discs of horizontal ranges at the hydrophone's depth, fixes (red: gated), at filter
    steps, shape (n,).
    """
    truth = flight.trajectory
    index = steps * flight.stride
    site_names = [
        name
        for name in truth.site_names
        if name.rpartition("/")[2].startswith(("tx_", "hydrophone"))
    ]
    paths = {name: truth.site_path(name, index) for name in site_names}
    messages = [
        {step: i for i, step in enumerate(m.message_step.tolist())} for m in flight.measurements
    ]

    def draw(time_ns: int, i: int) -> fg.SceneUpdate:
        step = int(steps[i])
        sites = {name: path[i].tolist() for name, path in paths.items()}
        pings = [
            _ping(flight, f, of_follower[step], time_ns, sites)
            for f, of_follower in enumerate(messages)
            if step in of_follower
        ]
        return fg.SceneUpdate(entities=pings)

    return draw


def layout(names: Sequence[str], *, camera: bool = True) -> str:
    """A layout for Foxglove, as JSON, for vehicles of these names, the leader first, and a log with
    a film or without.
    """

    def source(name: str) -> str:
        return resources.files("sim.log").joinpath(name).read_text("utf-8")

    environment = templates.environment(loader=jinja2.FunctionLoader(source))
    hues = {"leader": LEADER_HUE, "follower": FOLLOWER_HUE, "estimate": ESTIMATE_HUE}
    text = environment.get_template("foxglove.json.j2").render(
        leader=names[0], followers=list(names[1:]), hues=hues, camera=camera
    )
    return json.dumps(json.loads(text)) + "\n"
