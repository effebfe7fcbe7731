"""Densities of the sea.

A density is a NamedTuple with the methods `density_at(depth)`, and
`relative_density_at(depth, reference)`, the density there over that in which the buoyancy of a hull
holds; compiled code chooses them by its type.
"""

from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats
from laisn.compiled import jitable, method_by_type
from sim.water.waves import GRAVITY

method_by_type("density_at")
method_by_type("relative_density_at")


class UniformDensity(NamedTuple):
    """Water of one density."""

    density: float  # [kg/m³]

    @jitable
    def density_at(self, depth: float) -> float:
        """Density at a depth [kg/m³]."""
        return self.density

    @jitable
    def relative_density_at(self, depth: float, reference: float) -> float:
        """1: hulls are made for this water."""
        return 1.0

    def pressures_at(self, depth: Floats) -> Floats:
        """Gauge pressure at depths, any shape, [Pa]: the weight of the water above."""
        return np.asarray(GRAVITY * self.density * depth)


class DensityProfile(NamedTuple):
    """Density by depth, linear between n depths and constant above the first and below the last."""

    depth: Floats  # shape (n,), increasing, [m]
    density: Floats  # shape (n,), [kg/m³]

    @classmethod
    def through(cls, points: npt.ArrayLike) -> Self:
        """Points [[depth, density], …], shape (n, 2), [m] and [kg/m³]."""
        depth, density = np.array(points, dtype=np.float64).T.copy()
        return cls(depth, density)

    @jitable
    def density_at(self, depth: float) -> float:
        """Density at a depth [kg/m³]."""
        last = self.depth.size - 1
        if depth <= self.depth[0]:
            return float(self.density[0])
        if depth >= self.depth[last]:
            return float(self.density[last])
        low = 0
        high = last
        while high - low > 1:
            middle = (low + high) // 2
            if self.depth[middle] <= depth:
                low = middle
            else:
                high = middle
        share = (depth - self.depth[low]) / (self.depth[high] - self.depth[low])
        return float(self.density[low] + share * (self.density[high] - self.density[low]))

    @jitable
    def relative_density_at(self, depth: float, reference: float) -> float:
        """Density at a depth over `reference`, another density [kg/m³]."""
        return self.density_at(depth) / reference

    def pressures_at(self, depth: Floats) -> Floats:
        """Gauge pressure at depths, any shape, [Pa]: the weight of the water above."""
        deepest = max(float(np.max(depth, initial=0.0)), 0.0)
        layer_depths = self.depth[(self.depth > 0.0) & (self.depth < deepest)]
        nodes = np.concatenate([[0.0], layer_depths, [deepest + 1.0]])
        density = np.array([self.density_at(node) for node in nodes.tolist()])
        layers = 0.5 * (density[1:] + density[:-1]) * np.diff(nodes)
        column = np.concatenate([[0.0], np.cumsum(layers)])
        # within a layer the density is linear, and the column of water is a parabola
        low = np.clip(np.searchsorted(nodes, depth, side="right") - 1, 0, nodes.size - 2)
        depth_in_layer = depth - nodes[low]
        slope = (density[low + 1] - density[low]) / (nodes[low + 1] - nodes[low])
        return np.asarray(
            GRAVITY * (column[low] + (density[low] + 0.5 * slope * depth_in_layer) * depth_in_layer)
        )
