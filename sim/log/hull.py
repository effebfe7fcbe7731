"""Hulls for the scene of the log: the geoms of a vehicle's MJCF as Foxglove primitives."""

from typing import Any

import mujoco
import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3

from laisn.arrays import Floats
from sim.vehicle.mjcf import spec_of


def pose(position: Floats, quaternion: Floats) -> Any:
    """A Foxglove `Pose`; the quaternion is (w, x, y, z)."""
    x, y, z = position.tolist()
    qw, qx, qy, qz = quaternion.tolist()
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def cylinder(place: Any, color: Any, *, radius: float, length: float) -> Any:
    """A `CylinderPrimitive` about the z axis of `place`; sizes in [m]."""
    size = Vector3(x=2 * radius, y=2 * radius, z=length)
    return CylinderPrimitive(pose=place, size=size, bottom_scale=1.0, top_scale=1.0, color=color)


def _triangles(model: Any, mesh: int, place: Any, color: Any) -> Any:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    points = [Point3(x=x, y=y, z=z) for x, y, z in model.mesh_vert[first : first + count].tolist()]
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = model.mesh_face[first : first + count].ravel().tolist()
    return TriangleListPrimitive(pose=place, points=points, indices=faces, color=color)


def _add(entity: Any, model: Any, geom: int) -> None:
    """Append one geom; MuJoCo gives half sizes, Foxglove wants whole ones."""
    kinds = mujoco.mjtGeom
    kind = kinds(model.geom_type[geom])
    position, quaternion = model.geom_pos[geom], model.geom_quat[geom]
    place = pose(position, quaternion)
    half = model.geom_size[geom].tolist()
    material = model.geom_matid[geom]
    r, g, b, a = (model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]).tolist()
    color = Color(r=r, g=g, b=b, a=a)
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        entity.cylinders.append(cylinder(place, color, radius=half[0], length=2 * half[1]))
    if kind == kinds.mjGEOM_CAPSULE:
        end = np.zeros(3)
        mujoco.mju_rotVecQuat(end, np.array([0.0, 0.0, half[1]]), quaternion)
        size = Vector3(x=2 * half[0], y=2 * half[0], z=2 * half[0])
        for cap in (position - end, position + end):
            entity.spheres.append(SpherePrimitive(pose=pose(cap, quaternion), size=size, color=color))
    elif kind == kinds.mjGEOM_BOX:
        size = Vector3(x=2 * half[0], y=2 * half[1], z=2 * half[2])
        entity.cubes.append(CubePrimitive(pose=place, size=size, color=color))
    elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_ELLIPSOID):
        x, y, z = half if kind == kinds.mjGEOM_ELLIPSOID else half[:1] * 3
        entity.spheres.append(SpherePrimitive(pose=place, size=Vector3(x=2 * x, y=2 * y, z=2 * z), color=color))
    elif kind == kinds.mjGEOM_MESH:
        entity.triangles.append(_triangles(model, model.geom_dataid[geom], place, color))


def hull(model_of: str) -> Any:
    """Everything visible of a model of `sim.vehicle.mjcf.spec_of`, as a `SceneEntity` in the vehicle's body frame."""
    model = spec_of(model_of).compile()
    entity = SceneEntity()
    for geom in range(model.ngeom):
        _add(entity, model, geom)
    return entity
