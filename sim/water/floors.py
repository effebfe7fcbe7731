"""Floors of the sea.

A floor is a NamedTuple with the methods `depth_at(east, north)`, and `reflection_depth(source,
receiver)` for sound; compiled code chooses them by its type.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import jitable, method_by_type
from sim.attitude import Vector

method_by_type("depth_at")
method_by_type("reflection_depth")


class LevelFloor(NamedTuple):
    """A floor of one depth."""

    depth: float  # [m]

    @jitable
    def depth_at(self, east: float, north: float) -> float:
        """Depth of the floor below a place [m]."""
        return self.depth

    def depths_at(self, east: Floats, _north: Floats) -> Floats:
        """Depths of the floor below places, any shape, [m]."""
        return np.full(np.shape(east), self.depth)

    @property
    def deepest(self) -> float:
        """The greatest depth [m]."""
        return self.depth

    @jitable
    def reflection_depth(self, source: Vector, receiver: Vector) -> float:
        """Depth of the floor where it reflects sound between two places [m]."""
        return self.depth
