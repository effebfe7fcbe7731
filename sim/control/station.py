"""A follower's station: a place in the leader's trail, and aside of it in a frame that turns slowly.

A station s behind and y to port stands at trail(S − s) + y · port(ψ). The frame's heading ψ follows the trail no faster
than the station can be swum: on the inside of a turn the follower must keep way through the water, on the outside it
must keep up. The leader's instantaneous heading would not do: 80 m astern, a weave of 5° would swing it by 7 m.

Functions take `f`, the record of `[formation]`; `station`, a record of STATION; `trail`, the leader's and how many
points it has; and `dt`, a time step [s].
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Record, Records
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.allocation import clip
from sim.control.trail import arc_at, at, pace

STATION = np.dtype([("behind", np.float64), ("port", np.float64), ("depth", np.float64)])
"""A station [m]."""
FRAME_STATE = np.dtype([("heading", np.float64), ("rate", np.float64)])
"""State of a frame: its heading [rad] and its rate [rad/s]."""

_NEAREST = 5.0
"""A station nearer to the trail is turned as if it were this far aside [m]."""


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
def _turn(f: Record, speeds: tuple[float, float], port: float, towards: float, dt: float, state: Record) -> None:
    """Turn the frame towards a course; the leader's speeds are those over ground now, and through the water then."""
    over_ground, through = speeds
    width = max(abs(port), _NEAREST)
    off = wrap_angle(towards - state.heading)
    wanted = off / f.frame_time_constant
    outside = wanted * port > 0.0
    if outside:
        room = min(f.outer_speedup * over_ground, max(f.outer_max_speed - through, 0.1))
    else:
        room = min(f.inner_slowdown * over_ground, max(through - f.inner_min_speed, 0.1))
    most = f.max_station_acceleration / width
    # what is turned has to be stopped again
    limit = min(room / width, np.sqrt(most * abs(off)))
    wanted = clip(wanted, -limit, limit)
    state.rate += dt * clip((wanted - state.rate) / f.frame_rate_time_constant, -most, most)
    state.heading += dt * state.rate


@compiled
def turn_frame(
    f: Record, station: Record, trail: tuple[Records, int], span: tuple[float, float], dt: float, state: Record
) -> None:
    """Turn a station's frame from one time to another, along the trail as it is known now.

    Args:
        span: from and to [s].
        state: record of FRAME_STATE; brought forward.
    """
    points, count = trail
    over_ground = pace(points, count)
    for i in range(round((span[1] - span[0]) / dt)):
        arc = arc_at(points, count, span[0] + (i + 1) * dt) - station.behind
        _, _, east, north, through = at(points, count, arc)
        ahead = clip(station.behind, 0.0, f.frame_lookahead)
        if ahead > 0.0:
            _, _, east, north, _ = at(points, count, arc + ahead)
        _turn(f, (over_ground, through), station.port, np.arctan2(east, north), dt, state)


@compiled
def station_at(f: Record, station: Record, trail: tuple[Records, int], time: float, state: Record) -> Target:
    """Where a station is, by its frame as it stands.

    Args:
        time: now [s].
        state: record of FRAME_STATE.
    """
    points, count = trail
    port, over_ground = station.port, pace(points, count)
    arc = arc_at(points, count, time) - station.behind
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
