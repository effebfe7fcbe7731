"""Currents: how the water moves beside its waves.

A current is a NamedTuple with a method `at_time(time)`, which is called once an instant and gives
the current then: another NamedTuple, with `drift` and the method `flow(place, velocity)`. Compiled
code chooses both methods by the type. `drift` is what all of the water moves alike, and carries
waves along; `flow` is in the frame that moves so.
"""

from typing import NamedTuple

from laisn.arrays import Floats, Two
from laisn.compiled import compiled, jitable, method_by_type
from sim.attitude import Matrix, Vector

method_by_type("at_time")
method_by_type("flow")


class Drift(NamedTuple):
    """Motion that all of the water shares, east and north."""

    velocity: Two  # [m/s]
    acceleration: Two  # [m/s²]
    displacement: Two  # since time 0 [m]


NO_DRIFT = Drift((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


class CurrentFlow(NamedTuple):
    """A current about a point that moves, in the world."""

    velocity: Vector  # of the water [m/s]
    rate: Vector  # its rate of change along the point's path [m/s²]
    gradient: Matrix  # rows velocity, columns place [1/s]


START = 0
VELOCITY = slice(1, 3)
ACCELERATION = slice(3, 5)
DISPLACEMENT = slice(5, 7)
"""Columns of a changing current: time [s]; velocity then [m/s], its rate of change from then on
[m/s²] and the displacement of the water since the first point [m], each east and north."""


@compiled
def drift_at(time: float, change: Floats) -> Drift:
    """The changing part of a current at a time [s], from points of shape (m, 7), columns START,
    VELOCITY, ACCELERATION, DISPLACEMENT.
    """
    m = change.shape[0]
    if m == 0:
        return Drift((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    low, high = 0, m
    while high - low > 1:
        middle = (low + high) // 2
        if change[middle, 0] <= time:
            low = middle
        else:
            high = middle
    _, ux, uy, ax, ay, dx, dy = change[low]
    dt = time - change[low, 0]
    displacement = dx + (ux + 0.5 * ax * dt) * dt, dy + (uy + 0.5 * ay * dt) * dt
    return Drift((ux + ax * dt, uy + ay * dt), (ax, ay), displacement)


class ShearedInstant(NamedTuple):
    """A `ShearedCurrent` at one time."""

    drift: Drift
    surface: Two
    shear: Two

    @jitable
    def flow(self, position: Vector, velocity: Vector) -> CurrentFlow:
        """The steady part at a place [m] for a point that moves with a velocity [m/s]."""
        sx, sy = self.shear
        z = position[2]
        vz = velocity[2]
        zero = (0.0, 0.0, 0.0)
        return CurrentFlow(
            (self.surface[0] + sx * z, self.surface[1] + sy * z, 0.0),
            (sx * vz, sy * vz, 0.0),
            ((0.0, 0.0, sx), (0.0, 0.0, sy), zero),
        )


class ShearedCurrent(NamedTuple):
    """A current U(z) + V(t): steady, along one direction and linear in depth, and what is added
    at all depths.
    """

    surface: Two  # steady part at the surface, east and north [m/s]
    shear: Two  # its change with z [1/s]
    change: Floats  # points between which V changes linearly, shape (m, 7), columns as named above

    @jitable
    def at_time(self, time: float) -> ShearedInstant:
        """The current at a time [s]."""
        return ShearedInstant(drift_at(time, self.change), self.surface, self.shear)
