"""Floors of the sea.

A floor is a NamedTuple with the methods `depth_at(east, north)`, and `reflection(source, receiver)`
for sound; compiled code chooses them by its type.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import jitable, method_by_type
from sim.attitude import Vector

method_by_type("depth_at")
method_by_type("reflection")


class Reflection(NamedTuple):
    """How the floor reflects sound on its way from a source to a receiver."""

    image: Vector  # place from which the sound seems to come [m]
    depth: float  # of the floor where it meets the sound [m]
    # straight ways from the source to the floor and from there to the receiver, in proportion
    way_down: float
    way_up: float


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
    def reflection(self, source: Vector, receiver: Vector) -> Reflection:
        """How it reflects sound between two places."""
        return Reflection(
            (source[0], source[1], -2.0 * self.depth - source[2]),
            self.depth,
            abs(-source[2] - self.depth),
            abs(-receiver[2] - self.depth),
        )
