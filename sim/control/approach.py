"""Laws that bring a vehicle to a moving station: the velocity over ground and through the water that they ask for.

    constant bearing   v = v_st − U p̃ / √(p̃ᵀp̃ + Δ²), less the estimated current. No integrator: nothing winds up while
                       messages are missing (Breivik and Fossen 2007)
    ILOS               line of sight with an integral of the cross-track error in place of the current
                       (Børhaug, Pavlov and Pettersen 2008)
    ALOS               line of sight with an adaptive crab angle (Fossen 2023)

The two lines of sight follow the station's path; along it all three close up alike.
"""

from typing import NamedTuple

import numpy as np

from laisn.compiled import compiled
from sim.control.allocation import clip
from sim.control.station import Target

LAWS = ("constant-bearing", "ilos", "alos")
CONSTANT_BEARING, ILOS, ALOS = range(3)


class Approach(NamedTuple):
    """Law and gains of `[formation]`."""

    law: int
    """CONSTANT_BEARING, ILOS or ALOS."""
    speed: float
    """U: greatest speed towards the station [m/s]."""
    lookahead: float
    """Δ: distance within which the approach slows down [m]."""
    integral: float
    """σ of ILOS [m/s]; γ of ALOS [1/s] is this by Δ²."""
    least_way: float
    """Least speed through the water along the leader's way [m/s]."""
    slowest: float
    """Least speed through the water [m/s]."""
    fastest: float
    """Greatest speed through the water [m/s]."""


@compiled
def _line_of_sight(
    a: Approach, t: Target, off: tuple[float, float], dt: float, integral: float
) -> tuple[float, float, float]:
    """Velocity through the water, east and north, and the integral brought forward."""
    speed = np.hypot(t.velocity_east, t.velocity_north)
    course = np.arctan2(t.velocity_east, t.velocity_north) if speed > 0.0 else np.arctan2(t.way_east, t.way_north)
    sine, cosine = np.sin(course), np.cos(course)
    along, across = off[0] * sine + off[1] * cosine, off[0] * cosine - off[1] * sine
    wanted = speed - a.speed * along / np.sqrt(along * along + a.lookahead * a.lookahead)
    if a.law == ILOS:
        pulled = across + a.integral * integral
        integral += dt * a.lookahead * across / (a.lookahead * a.lookahead + pulled * pulled)
        heading = course - np.arctan(pulled / a.lookahead)
    else:
        # the crab angle itself is what is integrated
        gain = a.integral / (a.lookahead * a.lookahead)
        rate = gain * a.lookahead * across / np.sqrt(a.lookahead * a.lookahead + across * across)
        integral = clip(integral + dt * rate, -0.8, 0.8)
        heading = course - integral - np.arctan(across / a.lookahead)
    return wanted * np.sin(heading), wanted * np.cos(heading), integral


@compiled
def approach(
    a: Approach, t: Target, place: tuple[float, float], current: tuple[float, float], dt: float, integral: float
) -> tuple[float, float, float]:
    """Velocity through the water that leads to a station.

    Args:
        a: law and gains.
        t: the station.
        place: where the vehicle takes itself to be [m].
        current: what it takes the current to be [m/s].
        dt: since the last call [s].
        integral: of the cross-track error, where the law has one.

    Returns:
        Velocity east and north [m/s], its size within the limits, and the integral brought forward.
    """
    x, y = place[0] - t.east, place[1] - t.north
    if a.law == CONSTANT_BEARING:
        scale = a.speed / np.sqrt(x * x + y * y + a.lookahead * a.lookahead)
        east = t.velocity_east - scale * x - current[0]
        north = t.velocity_north - scale * y - current[1]
    else:
        east, north, integral = _line_of_sight(a, t, (x, y), dt, integral)
    # a hull without way cannot be steered, nor one that goes astern
    way_east, way_north = t.way_east - current[0], t.way_north - current[1]
    way = np.hypot(way_east, way_north)
    if way > 0.0:
        way_east, way_north = way_east / way, way_north / way
        lacking = max(a.least_way - (east * way_east + north * way_north), 0.0)
        east, north = east + lacking * way_east, north + lacking * way_north
    size = np.hypot(east, north)
    if size > 0.0:
        scale = clip(size, a.slowest, a.fastest) / size
        east, north = east * scale, north * scale
    return east, north, integral
