"""A follower's station: a place in the leader's trail, and aside of it in a frame that turns slowly.

A station s behind and y to port stands at trail(S − s) + y · port(ψ). The frame's heading ψ follows the trail no faster
than the station can be swum: on the inside of a turn the follower must keep way through the water, on the outside it
must keep up. The leader's instantaneous heading would not do: 80 m astern, a weave of 5° would swing it by 7 m.

A hull turns at a limited rate, the velocity that its station needs may not. In a following current a station's velocity
through the water may swing by 180° where its way over ground bends by 90°. A follower that begins to turn when its
station does is late, and several metres off. `rate_limited_velocity` has instead the heading that of all headings which
change no faster than a hull can is nearest to what the station needs from now on and needed just before: the middle of
the envelopes that fall and rise at that rate (McShane 1934). A swing in no time becomes a turn about the same instant;
what changes slowly enough stays as it is.

Functions take `f`, the record of `[formation]`; `station`, a record of STATION; `trail`, the leader's and how many
points it has; `dt`, a time step, and `time`, now [s]; and `state`, of FRAME_STATE.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Record, Records
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.allocation import clip
from sim.control.trail import arc_at, at, pace, turned_since

STATION = np.dtype([("behind", np.float64), ("port", np.float64), ("depth", np.float64)])  # a station [m]
FRAME_STATE = np.dtype([("heading", np.float64), ("rate", np.float64)])
"""State of a frame: its heading [rad] and its rate [rad/s]."""

_NEAREST = 5.0  # a station nearer to the trail is turned as if it were this far aside [m]
AGILITY = float(np.deg2rad(8.0))  # rate of turn that a follower counts on [rad/s]; 10°/s is what it is allowed
STEP = 1.0  # it looks ahead and back in steps of this time [s] …
STEPS = 10  # … and so many of them
_LITTLE = float(np.sin(AGILITY * STEP))
"""A velocity that changes by less than this share of itself turns by less than a hull does in a step."""


class Target(NamedTuple):
    """Where a station is now, and how it moves."""

    east: float  # [m]
    north: float
    velocity_east: float  # over ground [m/s]
    velocity_north: float
    way_east: float  # velocity over ground of the leader, when it was there [m/s]
    way_north: float


@compiled
def _turn(f: Record, speeds: tuple[float, float], port: float, towards: float, dt: float, state: Record) -> None:
    """Turn the frame towards a course, by the leader's speeds over ground now and through the water then."""
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
    """Turn a station's frame from one time to another [s], along the trail as it is known now."""
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
    """Where a station is, by its frame as it stands."""
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


class _Outlook(NamedTuple):
    """A station about an instant, as far as the trail is known."""

    trail: Records
    points: int  # how many points the trail has
    arc: float  # length of the way to where the station is in the trail [m]
    pace: float  # speed over ground of the leader [m/s]
    port: float  # distance of the station to port [m]
    heading: float  # of its frame [rad]
    rate: float  # rate of turn of its frame [rad/s]
    current: tuple[float, float]  # as the follower estimates it, east and north [m/s]


@compiled
def _through_water(o: _Outlook, later: float) -> tuple[float, float]:
    """Velocity through the water that a station needs so much later (less than 0: earlier), east and north [m/s]."""
    _, _, ahead_east, ahead_north, _ = at(o.trail, o.points, o.arc + later * o.pace)
    frame, swept = o.heading + later * o.rate, o.port * o.rate
    east = o.pace * ahead_east + swept * np.sin(frame)
    north = o.pace * ahead_north + swept * np.cos(frame)
    return east - o.current[0], north - o.current[1]


@compiled
def _turns_slowly(o: _Outlook, preview: float, speed: float) -> bool:
    """Whether all headings that are looked at are surely nearer to the one needed now than a hull turns in a step.

    So it is on straight legs, most of the time. `speed` through the water is needed `preview` later than now.
    """
    reach = STEPS * STEP
    bend = turned_since(o.trail, o.points, o.arc + (preview - reach) * o.pace)
    return bool(o.pace * bend + abs(o.port * o.rate * o.rate) * reach < _LITTLE * speed)


@compiled
def _between_envelopes(o: _Outlook, preview: float, heading: float) -> float:
    """Heading in the middle of the envelopes about the heading that is needed `preview` later than now [rad]."""
    upper = lower = heading
    for side in (-1.0, 1.0):
        then = heading
        for j in range(1, STEPS + 1):
            x, y = _through_water(o, preview + side * j * STEP)
            then += wrap_angle(np.arctan2(x, y) - then)
            upper = max(upper, then - AGILITY * j * STEP)
            lower = min(lower, then + AGILITY * j * STEP)
    return 0.5 * (upper + lower)


@compiled
def rate_limited_velocity(
    f: Record, station: Record, trail: tuple[Records, int], time: float, current: tuple[float, float], state: Record
) -> tuple[float, float]:
    """Velocity over ground with which a hull stays nearest to its station in a current, east and north [m/s]."""
    points, count = trail
    arc = arc_at(points, count, time) - station.behind
    o = _Outlook(points, count, arc, pace(points, count), station.port, state.heading, state.rate, current)
    east, north = _through_water(o, f.preview)
    speed = np.sqrt(east * east + north * north)
    if not _turns_slowly(o, f.preview, speed):
        heading = _between_envelopes(o, f.preview, np.arctan2(east, north))
        east, north = speed * np.sin(heading), speed * np.cos(heading)
    return east + current[0], north + current[1]
