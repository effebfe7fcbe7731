"""Hulls that touch: which, when, and the mission that ends with it.

Vehicles pass through each other in the simulation: the solver's contacts are off, as no hull here has the stiffness
and damping that would make a collision's outcome worth believing. That hulls touch is found by their geometry.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.geometry import attitude
from sim.trajectory import Trajectory

LEADER_HALF_M, FOLLOWER_HALF_M = 1.0, 0.7
"""Half the length of the straight part of a hull [m] …"""
HULL_RADIUS_M = 0.1
"""… and its radius [m]."""


class Contact(NamedTuple):
    """Two hulls where they first touch."""

    time_s: float
    pair: tuple[str, str]
    """Their names, the leader before followers, followers in their order."""


@compiled
def hull_gap(between: Floats, one: Floats, other: Floats, halves: tuple[float, float]) -> float:
    """Distance of two straight hulls' axes [m].

    Args:
        between: from the middle of the first to that of the second, shape (3,), [m].
        one: unit vector along the first hull, shape (3,).
        other: likewise of the second.
        halves: half their lengths [m].
    """
    along, ahead, across = 0.0, 0.0, 0.0
    for i in range(3):
        along += one[i] * other[i]
        ahead += one[i] * between[i]
        across += other[i] * between[i]
    # nearest points s and t along the axes, each within its hull (Ericson, Real-Time Collision Detection, 2005)
    bent = 1.0 - along * along
    s = (ahead - along * across) / bent if bent > 1e-9 else 0.0
    s = min(max(s, -halves[0]), halves[0])
    t = min(max(along * s - across, -halves[1]), halves[1])
    s = min(max(along * t + ahead, -halves[0]), halves[0])
    squared = 0.0
    for i in range(3):
        part = between[i] + t * other[i] - s * one[i]
        squared += part * part
    return float(np.sqrt(squared))


@compiled
def _first_contacts(position: Floats, axis: Floats, half: Floats, reach: float, first: Floats) -> None:
    """First instant at which the hulls of each pair touch, shape (v, v); −1 if they never do."""
    first[:] = -1.0
    for k in range(position.shape[0]):
        for i in range(position.shape[1]):
            for j in range(i):
                between = position[k, i] - position[k, j]
                limit, squared = half[i] + half[j] + reach, 0.0
                # not by np.dot, for which numba loads a library of linear algebra in an eighth of a second
                for part in between:
                    squared += part * part
                if first[i, j] >= 0.0 or squared > limit * limit:
                    continue
                if hull_gap(between, axis[k, j], axis[k, i], (half[j], half[i])) < reach:
                    first[i, j] = k


def _touching(position: Floats, quaternion: Floats) -> Floats:
    """First instants of contact, as of `_first_contacts`."""
    axis = np.ascontiguousarray(np.stack(attitude.forward(quaternion), axis=-1))
    half = np.full(position.shape[1], FOLLOWER_HALF_M)
    half[0] = LEADER_HALF_M
    first = np.empty((half.size, half.size))
    _first_contacts(np.ascontiguousarray(position), axis, half, 2.0 * HULL_RADIUS_M, first)
    return first


def contacts(trajectory: Trajectory) -> list[Contact]:
    """Every pair of vehicles whose hulls touch, when they first do, in order of time."""
    first = _touching(trajectory.position, trajectory.quaternion)
    found = [
        Contact(float(trajectory.time[int(first[i, j])]), (trajectory.names[j], trajectory.names[i]))
        for i, j in np.argwhere(first >= 0.0)
    ]
    return sorted(found)


Ending = Callable[[Floats, Floats], int | None]
"""What ends a mission early: of positions and attitudes, as of `first_touch`, the first instant that does."""


def first_touch(position: Floats, quaternion: Floats) -> int | None:
    """First of n instants at which any two of v hulls touch; None if none do.

    Args:
        position: of the hulls' middles, shape (n, v, 3), [m].
        quaternion: body to world, shape (n, v, 4).
    """
    first = _touching(position, quaternion)
    return int(first[first >= 0.0].min()) if (first >= 0.0).any() else None
