"""How near vehicles came to their routes and to one another, and hulls that touch.

Vehicles pass through each other in the simulation: the solver's contacts are off, as no hull here has the stiffness
and damping that would make the outcome of a collision credible. Contact is detected by geometry.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from sim import attitude
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from sim.trajectory import Trajectory

LEADER_HALF_M, FOLLOWER_HALF_M = 1.0, 0.7  # half the length of the straight part of a hull [m] …
HULL_RADIUS_M = 0.1  # … and its radius [m]


def cross_track(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance to the leg that is due, the one before or the one after, whichever is nearest, shape (n,), [m].

    `time` has shape (n,), [s], and `position`, east and north, shape (n, 2), [m].
    """
    last = route.time.size - 2
    due = np.clip(np.searchsorted(route.time, time, side="right") - 1, 0, last)
    start, along = route.waypoint[:-1], np.diff(route.waypoint, axis=0)
    nearest = np.full(time.size, np.inf)
    for shift in (-1, 0, 1):
        leg = np.clip(due + shift, 0, last)
        offset = position - start[leg]
        squared = np.einsum("ni,ni->n", along[leg], along[leg])
        # where the vehicle stops, the leg is a point
        share = np.einsum("ni,ni->n", offset, along[leg]) / np.where(squared > 0.0, squared, 1.0)
        off_leg = offset - np.clip(share, 0.0, 1.0)[:, None] * along[leg]
        nearest = np.minimum(nearest, np.hypot(*off_leg.T))
    return nearest


def track_error(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance to where the point motion along the route is, shape (n,), [m]; arguments as of `cross_track`."""
    place = plan(route).at(time)
    return np.hypot(position[:, 0] - place.east, position[:, 1] - place.north)


class Contact(NamedTuple):
    """Two hulls where they first touch."""

    time_s: float
    pair: tuple[str, str]  # their names, the leader before followers, followers in their order


def _dot(one: Floats, other: Floats) -> Floats:
    """Dot products of vectors, shape (n, 3), added up in the same order on every machine."""
    return np.asarray(one[..., 0] * other[..., 0] + one[..., 1] * other[..., 1] + one[..., 2] * other[..., 2])


def hull_gap(between: Floats, one: Floats, other: Floats, halves: tuple[float, float]) -> Floats:
    """Distances of two straight hulls' axes at n instants, shape (n,), [m].

    Args:
        between: from the middle of the first to that of the second, shape (n, 3), [m].
        one: unit vectors along the first hull, shape (n, 3).
        other: likewise of the second.
        halves: half their lengths [m].
    """
    along, ahead, across = _dot(one, other), _dot(one, between), _dot(other, between)
    # nearest points s and t along the axes, each within its hull (Ericson, Real-Time Collision Detection, 2005)
    sine_squared = 1.0 - along * along
    crossed = sine_squared > 1e-9
    s = np.where(crossed, (ahead - along * across) / np.where(crossed, sine_squared, 1.0), 0.0)
    s = np.clip(s, -halves[0], halves[0])
    t = np.clip(along * s - across, -halves[1], halves[1])
    s = np.clip(along * t + ahead, -halves[0], halves[0])
    nearest = between + t[..., None] * other - s[..., None] * one
    return np.sqrt(_dot(nearest, nearest))


def _first_contacts(position: Floats, quaternion: Floats) -> Ints:
    """First instant at which the hulls of each pair touch, shape (v, v), below the diagonal; −1 if they never do."""
    axis, count = np.stack(attitude.forward(quaternion), axis=-1), position.shape[1]
    half = [LEADER_HALF_M, *[FOLLOWER_HALF_M] * (count - 1)]
    first = np.full((count, count), -1)
    for i in range(count):
        for j in range(i):
            between = position[:, i] - position[:, j]
            near = np.flatnonzero(_dot(between, between) <= (half[i] + half[j] + 2.0 * HULL_RADIUS_M) ** 2)
            gap = hull_gap(between[near], axis[near, j], axis[near, i], (half[j], half[i]))
            first[i, j] = next(iter(near[gap < 2.0 * HULL_RADIUS_M]), -1)
    return first


def contacts(trajectory: Trajectory) -> list[Contact]:
    """Every pair of vehicles whose hulls touch, when they first do, in order of time."""
    first = _first_contacts(trajectory.position, trajectory.quaternion)
    found = [
        Contact(float(trajectory.time[first[i, j]]), (trajectory.names[j], trajectory.names[i]))
        for i, j in np.argwhere(first >= 0)
    ]
    return sorted(found)


def first_touch(position: Floats, quaternion: Floats) -> int | None:
    """First of n instants at which any two of v hulls touch; None if none do.

    Positions of the hulls' middles have shape (n, v, 3), [m], and attitudes, body to world, shape (n, v, 4).
    """
    first = _first_contacts(position, quaternion)
    return int(first[first >= 0].min()) if (first >= 0).any() else None
