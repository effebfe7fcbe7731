"""Plane and hull geometry: angles, bearings, transmitters, circles. Pure, compiled, and shared by all engines."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.compiled import compiled

Floats = npt.NDArray[np.float64]
Triple = tuple[float, float, float]

SINGULAR_VARIANCE = 1e-12
"""A position variance below this is zero [m²].

It stands for a micrometre: far below any sensor, and far above the 1e-30 m² that rounding leaves where an update
with σp = 0 should leave nothing. A second update with σp = 0 would divide one rounding error by another.
"""


class Intersections(NamedTuple):
    """Points where two circles meet; NaN for points that do not exist."""

    n_points: int
    """N: 0, 1 or 2."""
    separation: float
    """Distance between two intersections [m]; 0 where there are fewer."""
    left: tuple[float, float]
    """The point to the left of the way from the first centre to the second, or the only one [m]."""
    right: tuple[float, float]
    """The point to its right [m]."""


@compiled
def wrap_angle(angle: float) -> float:
    """Angle brought into [−π, π] [rad]; both ends stand for the same direction."""
    return float(angle - 2.0 * np.pi * np.rint(angle / (2.0 * np.pi)))


@compiled
def angle_between(a: float, b: float) -> float:
    """Smallest angle between two directions, in [0, π] [rad] (paper, γθ in Section 2.1)."""
    return abs(wrap_angle(a - b))


@compiled
def compass(east: float, north: float) -> float:
    """Compass direction of a vector, clockwise from north, in [0, 2π) [rad]."""
    return float(np.arctan2(east, north) % (2.0 * np.pi))


@compiled
def bearing(heading: float, east: float, north: float) -> float:
    """Bearing B, clockwise from the bow of a hull with that heading, of a point east and north of it [m].

    In [0, 2π) [rad]: 0 is dead ahead, π/2 to starboard, π astern.
    """
    return float((compass(east, north) - heading) % (2.0 * np.pi))


@compiled
def hull_to_world(forward: float, port: float, attitude: Triple) -> Triple:
    """Offset (east, north, up) [m] from the body origin of a point in the hull's forward-port plane.

    `attitude` is (heading, pitch, roll) [rad]: the hull is turned to its heading, then pitched nose up, then rolled
    starboard down, about its own axes.
    """
    heading, pitch, roll = attitude
    raised = port * np.sin(roll)
    ahead = forward * np.cos(pitch) - raised * np.sin(pitch)
    aside = port * np.cos(roll)
    east = ahead * np.sin(heading) - aside * np.cos(heading)
    north = ahead * np.cos(heading) + aside * np.sin(heading)
    return east, north, forward * np.sin(pitch) + raised * np.cos(pitch)


@compiled
def transmitter_positions(origin: Triple, attitude: Triple, baseline: float, middle_offset: float) -> Floats:
    """Rows of (east, north, depth) of the rear, front and middle transmitter, shape (3, 3), [m].

    `origin` is the leader's (east, north, depth) and `attitude` its (heading, pitch, roll). The rear and front
    transmitters sit half a baseline behind and before the origin, the middle one `middle_offset` to its port
    (paper, Section 2.3 and Figure 1).
    """
    forward = (-0.5 * baseline, 0.5 * baseline, 0.0)
    port = (0.0, 0.0, middle_offset)
    positions = np.empty((3, 3))
    for i in range(3):
        east, north, up = hull_to_world(forward[i], port[i], attitude)
        positions[i, 0] = origin[0] + east
        positions[i, 1] = origin[1] + north
        positions[i, 2] = origin[2] - up
    return positions


def place_on_body(origin: Triple, attitude: Triple, offsets: Floats) -> Floats:
    """Rows of (east, north, depth) of points anywhere on a body, shape (n, 3), [m].

    `origin` is the body's (east, north, depth), `attitude` its (heading, pitch, roll), and `offsets` has rows of
    (forward, port, up), shape (n, 3), [m].
    """
    forward, port = (np.array(hull_to_world(*unit, attitude)) for unit in ((1.0, 0.0), (0.0, 1.0)))
    moved = offsets @ np.stack([forward, port, np.cross(forward, port)])
    return np.asarray(np.array(origin) + moved * [1.0, 1.0, -1.0])


@compiled
def horizontal_range(slant_range: float, depth_difference: float) -> float:
    """Horizontal range D = √(R² − Δz²) [m]; 0 where a range error makes R < |Δz|, NaN where R is NaN."""
    squared = slant_range * slant_range - depth_difference * depth_difference
    if squared < 0.0:
        return 0.0
    return float(np.sqrt(squared))


@compiled
def intersections(
    east_i: float, north_i: float, radius_i: float, east_j: float, north_j: float, radius_j: float
) -> Intersections:
    """Intersections of the circle about (east_i, north_i) with the one about (east_j, north_j); all in [m].

    With d the distance of the centres, a = (d² + D_i² − D_j²) / 2d is how far along the way from i to j the common
    chord lies, and h² = D_i² − a² its half-length squared: N = 0 for h² < 0, N = 1 for h² = 0 exactly, else N = 2.
    Here h² is the product of Heron's formula (height of the triangle with sides d, D_i, D_j), for the difference of
    squares loses a short chord to rounding. Concentric circles have N = 0, also if they coincide.
    """
    dx = east_j - east_i
    dy = north_j - north_i
    d = np.sqrt(dx * dx + dy * dy)
    nowhere = (np.nan, np.nan)
    if d == 0.0:
        return Intersections(0, 0.0, nowhere, nowhere)
    a = (d * d + radius_i * radius_i - radius_j * radius_j) / (2.0 * d)
    overlap = (radius_i + radius_j - d) * (d + radius_i - radius_j) * (d - radius_i + radius_j)
    h_squared = (d + radius_i + radius_j) * overlap / (4.0 * d * d)
    if h_squared < 0.0:
        return Intersections(0, 0.0, nowhere, nowhere)
    ux = dx / d
    uy = dy / d
    x = east_i + a * ux
    y = north_i + a * uy
    if h_squared == 0.0:
        return Intersections(1, 0.0, (x, y), nowhere)
    h = np.sqrt(h_squared)
    return Intersections(2, 2.0 * h, (x - h * uy, y + h * ux), (x + h * uy, y - h * ux))
