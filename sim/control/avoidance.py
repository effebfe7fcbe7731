"""How a follower gives way to vehicles nearby: a velocity away from each is added to the one that it wants.

    v = v_wanted − Σ w(d) r̂,   w(d) = W min(max((R − d) / (R − F), 0), 1)

R is the sensor's range, F the range of full speed W. Two followers push each other apart at 2 w(d). Let the velocities
that they want close up at a rate c: by what they are commanded their distance changes at 2 w(d) − c, so that it stops
to shrink where w(d) = c / 2 and never comes below F while c < 2 W. Hulls lag behind commands, which takes the way of
some seconds more. Beyond R nothing is changed. A hull keeps its steerage way, so that it does not turn back for
somebody ahead: it slows down.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from sim.control.allocation import clip

DISTANCE, BEARING = range(2)
"""Columns of what is seen of each vehicle: [m], and to starboard of the own heading [rad]; NaN: nothing."""


class Avoidance(NamedTuple):
    """How to give way, of `[formation.proximity]`."""

    reach: float
    """R: giving way begins at this distance [m]."""
    full: float
    """F: at this distance and nearer it is at full speed [m]."""
    speed: float
    """W: that speed [m/s]."""
    least_way: float
    """Least speed through the water along the wanted heading [m/s]."""
    fastest: float
    """Greatest speed through the water [m/s]."""


@compiled
def away(a: Avoidance, seen: Floats, heading: float) -> tuple[float, float]:
    """Velocity away from all vehicles in sight, east and north, no more than the full speed [m/s].

    Args:
        a: how to give way.
        seen: columns DISTANCE and BEARING of each vehicle, shape (v, 2).
        heading: own measured one [rad].
    """
    east, north = 0.0, 0.0
    for j in range(seen.shape[0]):
        if seen[j, DISTANCE] == seen[j, DISTANCE]:
            speed = a.speed * clip((a.reach - seen[j, DISTANCE]) / (a.reach - a.full), 0.0, 1.0)
            towards = heading + seen[j, BEARING]
            east, north = east - speed * np.sin(towards), north - speed * np.cos(towards)
    size = np.hypot(east, north)
    if size > a.speed:
        east, north = east * a.speed / size, north * a.speed / size
    return east, north


@compiled
def give_way(a: Avoidance, wanted: tuple[float, float], push: tuple[float, float]) -> tuple[float, float]:
    """Heading [rad] and speed through the water [m/s] with a velocity added to them, within what a hull can do.

    Args:
        a: how to give way.
        wanted: heading and speed that lead where the follower wants to go.
        push: east and north [m/s].
    """
    heading, speed = wanted
    sine, cosine = np.sin(heading), np.cos(heading)
    along = max(speed + push[0] * sine + push[1] * cosine, a.least_way)
    across = push[0] * cosine - push[1] * sine
    return heading + np.arctan2(across, along), min(np.hypot(along, across), a.fastest)
