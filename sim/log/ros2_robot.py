"""The description of a vehicle for RViz: its visible shapes as URDF, in one link.

URDF knows boxes, cylinders and spheres alone, and meshes only as files beside it. Capsules are
built of these; ellipsoids and meshes, which are bodies of revolution in the project's hulls, become
discs along their longest axis, so that the text holds the whole hull.
"""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np

from laisn.arrays import Floats
from sim.vehicle.mjcf import spec_of

_DISCS = 12  # an ellipsoid or mesh is made of
_ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns the axis z of a cylinder to x."""
_ALONG_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
_TO_AXIS = (_ALONG_X, _ALONG_Y, np.eye(3))


class RobotShape(NamedTuple):
    """A box, cylinder or sphere in the frame of a hull."""

    kind: str  # "box", "cylinder" or "sphere"
    size: tuple[float, ...]  # edges; radius and length; radius [m]
    position: Floats  # of its centre, shape (3,), [m]
    rotation: Floats  # from the shape to the hull, shape (3, 3)
    rgba: tuple[float, ...]


def roll_pitch_yaw(rotation: Floats) -> tuple[float, float, float]:
    """Angles of a rotation matrix about the fixed axes x, y and z in this order [rad]."""
    cos_pitch = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], cos_pitch)
    if cos_pitch < 1e-9:
        # roll and yaw turn about the same axis, and roll is taken for zero
        return 0.0, pitch, math.atan2(-rotation[0, 1], rotation[1, 1])
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0])


def _profile(points: Floats, axis: int) -> tuple[Floats, Floats]:
    """Places along an axis and the largest distance of points from it there, both increasing with
    the place; points have shape (n, 3), [m].
    """
    coordinate = np.round(points[:, axis], 6)
    radius = np.hypot(*np.delete(points, axis, axis=1).T)
    places = np.unique(coordinate)
    return places, np.array([radius[coordinate == place].max() for place in places])


def _discs(places: Floats, radii: Floats) -> Iterator[tuple[float, float, float]]:
    """Radius, length and place of the middle of each disc of a body of revolution."""
    edges = np.linspace(places[0], places[-1], _DISCS + 1)
    for begin, end in pairwise(edges.tolist()):
        middle = 0.5 * (begin + end)
        yield float(np.interp(middle, places, radii)), end - begin, middle


def _ellipsoid_profile(half_size: Floats, axis: int) -> tuple[Floats, Floats]:
    """As `_profile` of an ellipsoid with half axes, shape (3,), [m]; of two that differ the mean
    area counts.
    """
    others = np.delete(half_size, axis)
    angle = np.linspace(0.0, np.pi, 10 * _DISCS)
    return -half_size[axis] * np.cos(angle), math.sqrt(float(np.prod(others))) * np.sin(angle)


def _shapes_of(model: mujoco.MjModel, geom: int) -> Iterator[RobotShape]:
    kinds = mujoco.mjtGeom
    kind = kinds(model.geom_type[geom])
    material = model.geom_matid[geom]
    color = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    rgba = tuple(float(value) for value in color)
    position = model.geom_pos[geom].astype(np.float64)
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[geom])
    rotation = matrix.reshape(3, 3)
    size = model.geom_size[geom].astype(np.float64)
    if kind == kinds.mjGEOM_BOX:
        yield RobotShape("box", tuple((2.0 * size).tolist()), position, rotation, rgba)
    elif kind == kinds.mjGEOM_SPHERE:
        yield RobotShape("sphere", (float(size[0]),), position, rotation, rgba)
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        radius = float(size[0])
        half_length = float(size[1])
        yield RobotShape("cylinder", (radius, 2.0 * half_length), position, rotation, rgba)
        ends = (-half_length, half_length) if kind == kinds.mjGEOM_CAPSULE else ()
        for end in ends:
            yield RobotShape("sphere", (radius,), position + end * rotation[:, 2], rotation, rgba)
    elif kind in (kinds.mjGEOM_ELLIPSOID, kinds.mjGEOM_MESH):
        if kind == kinds.mjGEOM_ELLIPSOID:
            axis = int(np.argmax(size))
            places, radii = _ellipsoid_profile(size, axis)
        else:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            points = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(np.float64)
            axis = int(np.argmax(np.ptp(points, axis=0)))
            places, radii = _profile(points, axis)
        for radius, length, middle in _discs(places, radii):
            yield RobotShape(
                "cylinder",
                (radius, length),
                position + middle * rotation[:, axis],
                rotation @ _TO_AXIS[axis],
                rgba,
            )


def _words(values: Iterable[float]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _add_visual(link: ElementTree.Element, shape: RobotShape) -> None:
    visual = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(
        visual, "origin", xyz=_words(shape.position), rpy=_words(roll_pitch_yaw(shape.rotation))
    )
    geometry = ElementTree.SubElement(visual, "geometry")
    if shape.kind == "box":
        ElementTree.SubElement(geometry, "box", size=_words(shape.size))
    elif shape.kind == "sphere":
        ElementTree.SubElement(geometry, "sphere", radius=_words(shape.size))
    else:
        radius, length = shape.size
        ElementTree.SubElement(geometry, "cylinder", radius=f"{radius:.6g}", length=f"{length:.6g}")
    # a material has one colour in all of the text
    name = "_".join(f"{round(255 * value):02x}" for value in shape.rgba)
    material = ElementTree.SubElement(visual, "material", name=f"color_{name}")
    ElementTree.SubElement(material, "color", rgba=_words(shape.rgba))


def urdf(name: str, model: str, link: str) -> str:
    """URDF of a vehicle with this name, of a model as `spec_of` takes it; its one link is the
    body's frame.
    """
    compiled = spec_of(model).compile()
    robot = ElementTree.Element("robot", name=name)
    body = ElementTree.SubElement(robot, "link", name=link)
    for geom in range(compiled.ngeom):
        for shape in _shapes_of(compiled, geom):
            _add_visual(body, shape)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"
