"""Hulls for the scene of the log: the visible geoms of a vehicle's MJCF."""

from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from laisn.arrays import Floats, Ints
from sim.vehicle.mjcf import spec_of


class Shape(NamedTuple):
    """A part of a hull in the vehicle's body frame."""

    kind: Literal["cylinder", "ellipsoid", "box", "mesh"]
    position: Floats
    """Shape (3,), [m]."""
    quaternion: Floats
    """Part to body (w, x, y, z); a cylinder stands along its own z axis."""
    size: Floats
    """Extents along the part's own axes, shape (3,), [m]."""
    rgba: tuple[float, float, float, float]
    vertices: Floats
    """Of a mesh, shape (n, 3), [m]."""
    faces: Ints
    """Of a mesh, shape (m, 3)."""


def _shapes(model: Any, geom: int) -> list[Shape]:
    """The parts of one geom; MuJoCo gives half sizes."""
    kinds = mujoco.mjtGeom
    kind = kinds(model.geom_type[geom])
    position, quaternion, half = model.geom_pos[geom], model.geom_quat[geom], model.geom_size[geom]
    material = model.geom_matid[geom]
    rgba = tuple((model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]).tolist())

    def shape(name: Any, place: Floats, size: Any, vertices: Any = (), faces: Any = ()) -> Shape:
        return Shape(name, place, quaternion, np.array(size), rgba, np.asarray(vertices), np.asarray(faces))

    width = 2 * half[0]
    if kind == kinds.mjGEOM_CYLINDER:
        return [shape("cylinder", position, [width, width, 2 * half[1]])]
    if kind == kinds.mjGEOM_CAPSULE:
        end = np.zeros(3)
        mujoco.mju_rotVecQuat(end, np.array([0.0, 0.0, half[1]]), quaternion)
        caps = [shape("ellipsoid", cap, [width] * 3) for cap in (position - end, position + end)]
        return [shape("cylinder", position, [width, width, 2 * half[1]]), *caps]
    if kind == kinds.mjGEOM_BOX:
        return [shape("box", position, 2 * half)]
    if kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        return [shape("ellipsoid", position, 2 * half if kind == kinds.mjGEOM_ELLIPSOID else [width] * 3)]
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(np.float64)
        faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        return [shape("mesh", position, np.ptp(vertices, axis=0), vertices, faces)]
    return []


def hull(model_of: str) -> list[Shape]:
    """Everything visible of a model of `sim.vehicle.mjcf.spec_of`."""
    model = spec_of(model_of).compile()
    return [shape for geom in range(model.ngeom) for shape in _shapes(model, geom)]
