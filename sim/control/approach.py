"""Laws that bring a vehicle to a moving station: their commanded velocities over ground and through the water.

    constant bearing   v = v_st − U p̃ / √(p̃ᵀp̃ + Δ²), less the estimated current. No integrator: nothing winds up while
                       messages are missing (Breivik and Fossen 2007)
    ILOS               line of sight with an integral of the cross-track error in place of the current
                       (Børhaug, Pavlov and Pettersen 2008)
    ALOS               line of sight with an adaptive crab angle (Fossen 2023)

The two lines of sight follow the station's path; along it all three close up alike.

A follower gives way to vehicles nearby: a velocity away from each is added to the wanted one,

    v = v_wanted − Σ w(d) r̂,   w(d) = W min(max((R − d) / (R − F), 0), 1)

R is the sensor's range, F the range of full speed W. Two followers push each other apart at 2 w(d). Let the wanted
velocities close up at a rate c: as commanded, their distance changes at 2 w(d) − c, so that it stops
to shrink where w(d) = c / 2 and never comes below F while c < 2 W. Hulls lag behind commands, which takes the way of
some seconds more. Beyond R nothing is changed. A hull keeps its steerage way, so that it does not turn back for
a vehicle ahead: it slows down.

Functions take `a` or `f`, the record of `[formation]`, and `p`, that of `[formation.proximity]`.
"""

import numpy as np

from laisn.arrays import Record, Records
from laisn.compiled import compiled
from sim.control.allocation import clip
from sim.control.station import Target

CONSTANT_BEARING, ILOS, ALOS = range(3)
"""Values of `formation.law`."""


@compiled
def _line_of_sight(
    a: Record, t: Target, off: tuple[float, float], dt: float, integral: float
) -> tuple[float, float, float]:
    """Velocity through the water, east and north, and the integral brought forward."""
    speed = np.hypot(t.velocity_east, t.velocity_north)
    course = np.arctan2(t.velocity_east, t.velocity_north) if speed > 0.0 else np.arctan2(t.way_east, t.way_north)
    sine, cosine = np.sin(course), np.cos(course)
    along, across = off[0] * sine + off[1] * cosine, off[0] * cosine - off[1] * sine
    wanted = speed - a.approach_speed * along / np.sqrt(along * along + a.lookahead * a.lookahead)
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
    a: Record, t: Target, place: tuple[float, float], current: tuple[float, float], dt: float, integral: float
) -> tuple[float, float, float]:
    """Velocity through the water that leads to a station.

    Args:
        t: the station.
        place: estimate of the vehicle's place [m].
        current: estimate of the current [m/s].
        integral: of the cross-track error, where the law has one.

    Returns:
        Velocity east and north [m/s], its size within the limits, and the integral brought forward.
    """
    x, y = place[0] - t.east, place[1] - t.north
    if a.law == CONSTANT_BEARING:
        scale = a.approach_speed / np.sqrt(x * x + y * y + a.lookahead * a.lookahead)
        east = t.velocity_east - scale * x - current[0]
        north = t.velocity_north - scale * y - current[1]
    else:
        east, north, integral = _line_of_sight(a, t, (x, y), dt, integral)
    # a hull without way cannot be steered, nor one that goes astern
    way_east, way_north = t.way_east - current[0], t.way_north - current[1]
    way = np.hypot(way_east, way_north)
    if way > 0.0:
        way_east, way_north = way_east / way, way_north / way
        lacking = max(a.min_along_track_speed - (east * way_east + north * way_north), 0.0)
        east, north = east + lacking * way_east, north + lacking * way_north
    size = np.hypot(east, north)
    if size > 0.0:
        scale = clip(size, a.min_speed, a.max_speed) / size
        east, north = east * scale, north * scale
    return east, north, integral


@compiled
def away(p: Record, seen: Records, heading: float) -> tuple[float, float]:
    """Velocity away from all vehicles in sight, east and north, no more than the full speed [m/s].

    Args:
        seen: `range` [m] and `bearing` of each vehicle, to starboard [rad], shape (v,); NaN: nothing.
        heading: own measured one [rad].
    """
    east, north = 0.0, 0.0
    for j in range(seen.shape[0]):
        if seen[j].range == seen[j].range:
            speed = p.max_avoidance_speed * clip(
                (p.range - seen[j].range) / (p.range - p.full_avoidance_range), 0.0, 1.0
            )
            towards = heading + seen[j].bearing
            east, north = east - speed * np.sin(towards), north - speed * np.cos(towards)
    size = np.hypot(east, north)
    if size > p.max_avoidance_speed:
        east, north = east * p.max_avoidance_speed / size, north * p.max_avoidance_speed / size
    return east, north


@compiled
def give_way(f: Record, wanted: tuple[float, float], push: tuple[float, float]) -> tuple[float, float]:
    """Heading [rad] and speed through the water [m/s] with a velocity added to them, within what a hull can do.

    Args:
        wanted: heading [rad] and speed [m/s] before avoidance.
        push: east and north [m/s].
    """
    heading, speed = wanted
    sine, cosine = np.sin(heading), np.cos(heading)
    along = max(speed + push[0] * sine + push[1] * cosine, f.min_along_track_speed)
    across = push[0] * cosine - push[1] * sine
    return heading + np.arctan2(across, along), min(np.hypot(along, across), f.max_speed)
