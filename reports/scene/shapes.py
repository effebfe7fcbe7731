"""Triangles of the parts of a hull: points, normals and corners."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from sim import attitude

_ROUND = 28  # corners of a circle
_ROWS = 13  # circles of a sphere, with both poles


class Triangles(NamedTuple):
    """A surface; seen from outside, corners run counter-clockwise."""

    points: Floats  # shape (n, 3), [m]
    normals: Floats  # of length 1, shape (n, 3)
    corners: Ints  # indices of points, shape (t, 3)


def _grid(rows: int, columns: int) -> Ints:
    """Triangles between points in rows, each of which is a closed ring: indices of points, row by
    row, shape (t, 3).
    """
    first = np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    neighbour = np.roll(first, -1, axis=1)
    squares = np.stack(
        [first, neighbour, first + columns, first + columns, neighbour, neighbour + columns],
        axis=-1,
    )
    return squares.reshape(-1, 3)


def _directions(rows: int) -> Floats:
    """Points of a sphere of radius 1, from its lower pole up, shape (rows, _ROUND, 3)."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rows)[:, None]
    longitude = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    return np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude) * np.ones_like(longitude),
        ],
        axis=-1,
    )


def ellipsoid(radii: Floats) -> Triangles:
    """An ellipsoid by its half axes, shape (3,), [m]."""
    sphere = _directions(_ROWS).reshape(-1, 3)
    normals = sphere / radii
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Triangles(sphere * radii, normals, _grid(_ROWS, _ROUND))


def capsule(radius: float, half_length: float) -> Triangles:
    """A cylinder along z with half a sphere at each end; half of the cylinder's length [m]."""
    rows = _ROWS + 1 + _ROWS % 2
    sphere = _directions(rows - 1)
    middle = (rows - 1) // 2
    # the equator stands twice: at the end of each half
    normals = np.concatenate([sphere[: middle + 1], sphere[middle:]])
    shift = np.where(np.arange(rows) <= middle, -half_length, half_length)
    points = radius * normals
    points[..., 2] += shift[:, None]
    return Triangles(points.reshape(-1, 3), normals.reshape(-1, 3), _grid(rows, _ROUND))


def cylinder(radius: float, half_length: float) -> Triangles:
    """A cylinder along z; half of its length [m]."""
    angles = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(_ROUND)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    points = [radius * ring - half_length * up, radius * ring + half_length * up]
    normals = [ring, ring]
    corners = [_grid(2, _ROUND)]
    fan = np.stack([np.zeros(_ROUND - 2), np.arange(1, _ROUND - 1), np.arange(2, _ROUND)], axis=-1)
    for end, order in ((-1.0, (0, 2, 1)), (1.0, (0, 1, 2))):
        corners.append(fan[:, order].astype(np.int64) + _ROUND * len(points))
        points.append(radius * ring + end * half_length * up)
        normals.append(np.tile(end * up, (_ROUND, 1)))
    return Triangles(np.concatenate(points), np.concatenate(normals), np.concatenate(corners))


def mesh(points: Floats, corners: Ints) -> Triangles:
    """A mesh with flat faces; points shape (n, 3), corners shape (t, 3)."""
    faces = points[corners]
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    has_area = length[:, 0] > 0.0
    normals = np.repeat(normals[has_area] / length[has_area], 3, axis=0)
    return Triangles(
        faces[has_area].reshape(-1, 3), normals, np.arange(3 * has_area.sum()).reshape(-1, 3)
    )


# corners of a box with half sides of 1, and indices of those of the triangles of its sides
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
_SIDES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
# the same of an octahedron
_TIPS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
_FACES = np.array(
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
)


def diamond(radius: float) -> Triangles:
    """An octahedron whose tips are this far from its middle [m]."""
    return mesh(radius * _TIPS, _FACES)


def triangles_of(geom: Mapping[str, Any], *, at_origin: bool = False) -> Triangles:
    """The surface of a part of `reports.scene.hulls.hull` in the hull's axes, perhaps moved to
    its origin.
    """
    a, b, c = geom["size"]
    match geom["kind"]:
        case "cylinder":
            shape = cylinder(a, b)
        case "capsule":
            shape = capsule(a, b)
        case "box":
            shape = mesh(_CORNERS * (a, b, c), _SIDES)
        case "sphere":
            shape = ellipsoid(np.full(3, a))
        case "ellipsoid":
            shape = ellipsoid(np.array([a, b, c]))
        case _:
            shape = mesh(
                np.array(geom["points"]).reshape(-1, 3), np.array(geom["faces"]).reshape(-1, 3)
            )
    quaternion = np.array(geom["turn"])
    offset = np.zeros(3) if at_origin else np.array(geom["at"])
    return Triangles(
        attitude.rotate(quaternion, shape.points) + offset,
        attitude.rotate(quaternion, shape.normals),
        shape.corners,
    )
