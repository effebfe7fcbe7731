"""A follower's station: a place in the leader's trail, and aside of it in a frame that turns slowly.

A station s behind and y to port stands at trail(S − s) + y · port(ψ). The frame's heading ψ follows the trail no faster
than the station can be swum: on the inside of a turn the follower must keep way through the water, on the outside it
must keep up. The leader's instantaneous heading would not do: 80 m astern, a weave of 5° would swing it by 7 m.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Record
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.allocation import clip
from sim.control.trail import arc_at, at, pace

BEHIND, PORT, STATION_DEPTH = range(3)
"""Columns of a station [m]."""
FRAME_STATE = np.dtype([("heading", np.float64), ("rate", np.float64)])
"""State of a frame: its heading [rad] and its rate [rad/s]."""

_NEAREST = 5.0
"""A station nearer to the trail is turned as if it were this far aside [m]."""


class Frame(NamedTuple):
    """How frames turn, of `[formation]`."""

    time: float
    """Time constant with which the frame follows the trail [s]."""
    lag: float
    """Time constant of its rate [s]."""
    ahead: float
    """The frame turns towards the trail's course so far ahead of the station [m]."""
    acceleration: float
    """Greatest change of the station's speed that the frame asks for [m/s²]."""
    inner: float
    """Share of the leader's speed that inner stations may lose in a turn."""
    outer: float
    """Share of the leader's speed that outer stations may gain in a turn."""
    slowest: float
    """Least speed through the water of a station [m/s]."""
    fastest: float
    """Greatest speed through the water of a station [m/s]."""
    preview: float
    """Hull and thrusters lag; a follower begins so early to go as its station will [s]."""


class Target(NamedTuple):
    """Where a station is now, and how it moves."""

    east: float
    """[m]."""
    north: float
    velocity_east: float
    """Over ground [m/s]."""
    velocity_north: float
    way_east: float
    """Velocity over ground of the leader, when it was there [m/s]."""
    way_north: float


@compiled
def _turn(f: Frame, speeds: tuple[float, float], port: float, towards: float, dt: float, state: Record) -> None:
    """Turn the frame towards a course; the leader's speeds are those over ground now, and through the water then."""
    over_ground, through = speeds
    width = max(abs(port), _NEAREST)
    off = wrap_angle(towards - state.heading)
    wanted = off / f.time
    outside = wanted * port > 0.0
    if outside:
        room = min(f.outer * over_ground, max(f.fastest - through, 0.1))
    else:
        room = min(f.inner * over_ground, max(through - f.slowest, 0.1))
    most = f.acceleration / width
    # what is turned has to be stopped again
    limit = min(room / width, np.sqrt(most * abs(off)))
    wanted = clip(wanted, -limit, limit)
    state.rate += dt * clip((wanted - state.rate) / f.lag, -most, most)
    state.heading += dt * state.rate


@compiled
def turn_frame(
    f: Frame, station: Floats, trail: tuple[Floats, int], span: tuple[float, float], dt: float, state: Record
) -> None:
    """Turn a station's frame from one time to another, along the trail as it is known now.

    Args:
        f: how frames turn.
        station: columns BEHIND and PORT are read.
        trail: of the leader, and how many points it has, at least one.
        span: from and to [s].
        dt: step [s].
        state: record of FRAME_STATE; brought forward.
    """
    points, count = trail
    over_ground = pace(points, count)
    for i in range(round((span[1] - span[0]) / dt)):
        arc = arc_at(points, count, span[0] + (i + 1) * dt) - station[BEHIND]
        _, _, east, north, through = at(points, count, arc)
        ahead = clip(station[BEHIND], 0.0, f.ahead)
        if ahead > 0.0:
            _, _, east, north, _ = at(points, count, arc + ahead)
        _turn(f, (over_ground, through), station[PORT], np.arctan2(east, north), dt, state)


@compiled
def station_at(f: Frame, station: Floats, trail: tuple[Floats, int], time: float, state: Record) -> Target:
    """Where a station is, by its frame as it stands.

    Args:
        f: how frames turn.
        station: columns BEHIND and PORT are read.
        trail: of the leader, and how many points it has, at least one.
        time: now [s].
        state: record of FRAME_STATE.
    """
    points, count = trail
    port, over_ground = station[PORT], pace(points, count)
    arc = arc_at(points, count, time) - station[BEHIND]
    east, north, ahead_east, ahead_north, _ = at(points, count, arc)
    sine, cosine, rate = np.sin(state.heading), np.cos(state.heading), state.rate
    return Target(
        east - port * cosine,
        north + port * sine,
        over_ground * ahead_east + port * rate * sine,
        over_ground * ahead_north + port * rate * cosine,
        over_ground * ahead_east,
        over_ground * ahead_north,
    )
