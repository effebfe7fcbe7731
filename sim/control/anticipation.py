"""A follower turns in time: its hull turns at a limited rate, the velocity that its station needs may not.

In a following current a station's velocity through the water may swing by 180° where its way over ground bends by 90°.
A follower that begins to turn when its station does is late, and several metres off. It gets instead the heading
that of all headings which change no faster than it can is nearest to what the station needs from now on and needed
just before: the middle of the envelopes that fall and rise at that rate (McShane 1934). A swing in no time becomes a
turn about the same instant; what changes slowly enough stays as it is.

Functions take the leader's `trail` and how many points it has; `where`, the arc of the station [m] and the pace of the
leader [m/s]; `turning` of the station; and the `current` as the follower estimates it, east and north [m/s].
"""

import numpy as np

from laisn.arrays import Record, Records
from laisn.compiled import compiled
from laisn.geometry import wrap_angle
from sim.control.trail import arc_at, at, pace, turned_since

AGILITY = float(np.deg2rad(8.0))
"""Rate of turn that a follower counts on [rad/s]; 10°/s is what it is allowed."""
STEP = 1.0
"""It looks ahead and back in steps of this time [s] …"""
STEPS = 10
"""… and so many of them."""
_LITTLE = float(np.sin(AGILITY * STEP))
"""A velocity that changes by less than this share of itself turns by less than a hull does in a step."""


Turning = tuple[float, float, float]
"""A station's distance to port [m], the heading of its frame [rad] and its rate [rad/s]."""


@compiled
def _through_water(
    trail: tuple[Records, int], where: tuple[float, float], turning: Turning, current: tuple[float, float], later: float
) -> tuple[float, float]:
    """Velocity through the water that a station needs so much later, east and north [m/s].

    Args:
        later: less than 0 is past [s].
    """
    _, _, ahead_east, ahead_north, _ = at(trail[0], trail[1], where[0] + later * where[1])
    frame, swept = turning[1] + later * turning[2], turning[0] * turning[2]
    east = where[1] * ahead_east + swept * np.sin(frame)
    north = where[1] * ahead_north + swept * np.cos(frame)
    return east - current[0], north - current[1]


@compiled
def _turns_slowly(
    trail: tuple[Records, int], where: tuple[float, float], turning: Turning, preview: float, speed: float
) -> bool:
    """Whether all headings that are looked at are surely nearer to the one needed now than a hull turns in a step.

    So it is on straight legs, most of the time, and nothing has to be looked at.

    Args:
        preview: how much later than now all is looked at [s].
        speed: through the water that is needed then [m/s].
    """
    (arc, over_ground), (port, _, rate) = where, turning
    reach = STEPS * STEP
    bend = turned_since(trail[0], trail[1], arc + (preview - reach) * over_ground)
    return bool(over_ground * bend + abs(port * rate * rate) * reach < _LITTLE * speed)


@compiled
def _between_envelopes(
    trail: tuple[Records, int],
    where: tuple[float, float],
    turning: Turning,
    current: tuple[float, float],
    preview: float,
    heading: float,
) -> float:
    """Heading in the middle of the envelopes.

    Args:
        preview: how much later than now is looked at [s].
        heading: that is needed then [rad].
    """
    upper = lower = heading
    for side in (-1.0, 1.0):
        then = heading
        for j in range(1, STEPS + 1):
            x, y = _through_water(trail, where, turning, current, preview + side * j * STEP)
            then += wrap_angle(np.arctan2(x, y) - then)
            upper = max(upper, then - AGILITY * j * STEP)
            lower = min(lower, then + AGILITY * j * STEP)
    return 0.5 * (upper + lower)


@compiled
def rate_limited_velocity(
    f: Record, station: Record, trail: tuple[Records, int], time: float, current: tuple[float, float], state: Record
) -> tuple[float, float]:
    """Velocity over ground with which a hull stays nearest to its station, east and north [m/s].

    Args:
        state: record of `sim.control.station.FRAME_STATE`.
    """
    points, count = trail
    where = arc_at(points, count, time) - station.behind, pace(points, count)
    turning = station.port, state.heading, state.rate
    east, north = _through_water(trail, where, turning, current, f.preview)
    speed = np.sqrt(east * east + north * north)
    if not _turns_slowly(trail, where, turning, f.preview, speed):
        heading = _between_envelopes(trail, where, turning, current, f.preview, np.arctan2(east, north))
        east, north = speed * np.sin(heading), speed * np.cos(heading)
    return east + current[0], north + current[1]
