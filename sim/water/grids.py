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
        x = cell_of(self.east, east)
        y = cell_of(self.north, north)
        at_south = self.depth[y.low, x.low] * (1.0 - x.share) + self.depth[y.low, x.high] * x.share
        at_north = (
            self.depth[y.high, x.low] * (1.0 - x.share) + self.depth[y.high, x.high] * x.share
        )
        return float(at_south * (1.0 - y.share) + at_north * y.share)

    @jitable
    def reflection_depth(self, source: Vector, receiver: Vector) -> float:
        """Depth of the floor where it reflects sound between two places [m], as if it were level
        about there.
        """
        share = 0.5
        depth = 0.0
        for _ in range(_REFLECTIONS):
            east = source[0] + share * (receiver[0] - source[0])
            north = source[1] + share * (receiver[1] - source[1])
            depth = self.depth_at(east, north)
            source_height = max(depth + source[2], 0.0)
            total_height = source_height + max(depth + receiver[2], 0.0)
            share = source_height / total_height if total_height > 0.0 else 0.5
        return depth

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
_REFLECTIONS = 4


@compiled
def _write_depths(floor: GriddedFloor, east: Floats, north: Floats, out: Floats) -> None:
    for i in range(out.size):
        out[i] = floor.depth_at(east[i], north[i])
