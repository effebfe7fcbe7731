"""Currents and floors on grids: linear between the points of each axis, constant beyond its ends.

The error of a value falls with the square of the grid spacing, that of its gradient with the
spacing. Where a field bends within the length of a hull, that is left out.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled, inlined, jitable
from sim.attitude import Vector
from sim.water.currents import NO_DRIFT, CurrentFlow, Drift
from sim.water.floors import Reflection


class GridInterval(NamedTuple):
    """Where a value lies on an axis."""

    low: int  # index of the point before it
    high: int  # and of the one behind; the same beyond the ends
    share: float  # of the point behind
    slope: float  # of that share per unit of the axis; 0 beyond the ends


@compiled
def cell_of(axis: Floats, value: float) -> GridInterval:
    """Cell of a value on an axis of one or more increasing points."""
    last = axis.size - 1
    if value <= axis[0] or last == 0:
        return GridInterval(0, 0, 0.0, 0.0)
    if value >= axis[last]:
        return GridInterval(last, last, 0.0, 0.0)
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if axis[middle] <= value:
            low = middle
        else:
            high = middle
    slope = 1.0 / (axis[high] - axis[low])
    return GridInterval(low, high, (value - axis[low]) * slope, slope)


@inlined
def _low(cell: GridInterval) -> tuple[int, float, float]:
    """Index of the point before a value, its weight, and the weight's slope."""
    return cell.low, 1.0 - cell.share, -cell.slope


@inlined
def _high(cell: GridInterval) -> tuple[int, float, float]:
    """The same of the point behind."""
    return cell.high, cell.share, cell.slope


class CurrentGrid(NamedTuple):
    """Velocities of the water on a grid about the origin."""

    time: Floats  # since the start of the mission, shape (t,), increasing, [s]
    depth: Floats  # shape (k,), increasing, [m]
    north: Floats  # shape (j,), increasing, [m]
    east: Floats  # shape (i,), increasing, [m]
    # east, north and, where the field has it, up, shape (t, k, j, i, 2 or 3), [m/s]
    velocity: Floats


class GriddedInstant(NamedTuple):
    """A `GriddedCurrent` at one time."""

    drift: Drift
    grid: CurrentGrid
    time: GridInterval

    @compiled
    def flow(self, position: Vector, velocity: Vector) -> CurrentFlow:
        """As of `sim.water.currents.ShearedInstant.flow`."""
        grid = self.grid
        time = self.time
        x = cell_of(grid.east, position[0])
        y = cell_of(grid.north, position[1])
        z = cell_of(grid.depth, -position[2])
        rises = grid.velocity.shape[4] == 3
        values = grid.velocity
        # trilinear: u = Σ w_i w_j w_k u_ijk, of u_ijk linear in time; t is its change over the
        # interval of time, xy the derivative of u_x by y; e and c are u_ijk and its change
        ux = uy = uz = 0.0
        tx = ty = tz = 0.0
        xx = xy = xz = yx = yy = yz = zx = zy = zz = 0.0
        for k, wz, down in (_low(z), _high(z)):
            # heights count upwards, and the axis is that of depth
            dz = -down
            for j, wy, dy in (_low(y), _high(y)):
                for i, wx, dx in (_low(x), _high(x)):
                    weight = wx * wy * wz
                    by_x = dx * wy * wz
                    by_y = wx * dy * wz
                    by_z = wx * wy * dz
                    ex = values[time.low, k, j, i, 0]
                    ey = values[time.low, k, j, i, 1]
                    cx = values[time.high, k, j, i, 0] - ex
                    cy = values[time.high, k, j, i, 1] - ey
                    ex += time.share * cx
                    ey += time.share * cy
                    ux += weight * ex
                    uy += weight * ey
                    tx += weight * cx
                    ty += weight * cy
                    xx += by_x * ex
                    xy += by_y * ex
                    xz += by_z * ex
                    yx += by_x * ey
                    yy += by_y * ey
                    yz += by_z * ey
                    if rises:
                        ez = values[time.low, k, j, i, 2]
                        cz = values[time.high, k, j, i, 2] - ez
                        ez += time.share * cz
                        uz += weight * ez
                        tz += weight * cz
                        zx += by_x * ez
                        zy += by_y * ez
                        zz += by_z * ez
        # Du/Dt = ∂u/∂t + (∇u) v
        vx, vy, vz = velocity
        rate = (
            time.slope * tx + xx * vx + xy * vy + xz * vz,
            time.slope * ty + yx * vx + yy * vy + yz * vz,
            time.slope * tz + zx * vx + zy * vy + zz * vz,
        )
        return CurrentFlow((ux, uy, uz), rate, ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)))


class GriddedCurrent(NamedTuple):
    """A current on a grid."""

    grid: CurrentGrid

    @compiled
    def at_time(self, time: float) -> GriddedInstant:
        """The current at a time [s]."""
        return GriddedInstant(NO_DRIFT, self.grid, cell_of(self.grid.time, time))


class GriddedFloor(NamedTuple):
    """A floor on a grid about the origin."""

    north: Floats  # shape (j,), increasing, [m]
    east: Floats  # shape (i,), increasing, [m]
    depth: Floats  # shape (j, i), [m]

    @jitable
    def depth_at(self, east: float, north: float) -> float:
        """Depth of the floor below a place [m]."""
        return _tangent_at(self, east, north)[0]

    @jitable
    def reflection(self, source: Vector, receiver: Vector) -> Reflection:
        """How it reflects sound between two places: by the plane that touches it where the sound
        meets it.
        """
        east = 0.5 * (source[0] + receiver[0])
        north = 0.5 * (source[1] + receiver[1])
        image = source
        depth = 0.0
        way_down = 0.0
        way_up = 0.0
        for _ in range(_REFLECTIONS):
            depth, eastward, northward = _tangent_at(self, east, north)
            # heights above the plane, times the length of its normal (eastward, northward, 1)
            from_source = (
                depth + source[2] + eastward * (source[0] - east) + northward * (source[1] - north)
            )
            from_receiver = (
                depth
                + receiver[2]
                + eastward * (receiver[0] - east)
                + northward * (receiver[1] - north)
            )
            way_down = max(from_source, 0.0)
            way_up = max(from_receiver, 0.0)
            twice = 2.0 * way_down / (1.0 + eastward * eastward + northward * northward)
            image = (
                source[0] - twice * eastward,
                source[1] - twice * northward,
                source[2] - twice,
            )
            total = way_down + way_up
            share = way_down / total if total > 0.0 else 0.5
            east = image[0] + share * (receiver[0] - image[0])
            north = image[1] + share * (receiver[1] - image[1])
        return Reflection(image, depth, way_down, way_up)

    @property
    def deepest(self) -> float:
        """The greatest depth [m]."""
        return float(self.depth.max())

    def depths_at(self, east: Floats, north: Floats) -> Floats:
        """Depths of the floor below places, any shape, [m]."""
        out = np.empty(np.shape(east))
        _write_depths(self, np.ravel(east), np.ravel(north), out.reshape(-1))
        return out


# the place of the reflection is found in so many steps; the floor changes little along a path
_REFLECTIONS = 8


@jitable
def _tangent_at(floor: GriddedFloor, east: float, north: float) -> tuple[float, float, float]:
    """Depth of the floor below a place [m], and how it grows to the east and to the north."""
    x = cell_of(floor.east, east)
    y = cell_of(floor.north, north)
    at_south = floor.depth[y.low, x.low] * (1.0 - x.share) + floor.depth[y.low, x.high] * x.share
    at_north = floor.depth[y.high, x.low] * (1.0 - x.share) + floor.depth[y.high, x.high] * x.share
    south_growth = floor.depth[y.low, x.high] - floor.depth[y.low, x.low]
    north_growth = floor.depth[y.high, x.high] - floor.depth[y.high, x.low]
    return (
        float(at_south * (1.0 - y.share) + at_north * y.share),
        float(x.slope * (south_growth * (1.0 - y.share) + north_growth * y.share)),
        float(y.slope * (at_north - at_south)),
    )


@compiled
def _write_depths(floor: GriddedFloor, east: Floats, north: Floats, out: Floats) -> None:
    for i in range(out.size):
        out[i] = floor.depth_at(east[i], north[i])
