"""A follower turns in time: its hull turns at a limited rate, the velocity that its station needs may not.

In a following current a station's velocity through the water may swing by 180° where its way over ground bends by 90°.
A follower that begins to turn when its station does is late, and several metres off. It is told instead the heading
that of all headings which change no faster than it can is nearest to what the station needs from now on and needed
just before: the middle of the envelopes that fall and rise at that rate (McShane 1934). A swing in no time becomes a
turn about the same instant; what changes slowly enough stays as it is.
"""

import numpy as np

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.geometry import signed_angle
from sim.control.station import BEHIND, FRAME, FRAME_RATE, PORT, Frame
from sim.control.trail import arc_at, at, pace

AGILITY = float(np.deg2rad(8.0))
"""Rate of turn that a follower counts on [rad/s]; 10°/s is what it is allowed."""
STEP = 1.0
"""It looks ahead and back in steps of this time [s] …"""
STEPS = 10
"""… and so many of them."""


@compiled
def _through_water(
    trail: tuple[Floats, int], where: tuple[float, float], turning: Floats, current: tuple[float, float], later: float
) -> tuple[float, float]:
    """Velocity through the water that a station needs so much later, east and north [m/s].

    Args:
        trail: of the leader, and how many points it has.
        where: arc of the station [m] and pace of the leader [m/s].
        turning: distance to port [m], heading of the frame [rad] and its rate [rad/s].
        current: east and north [m/s].
        later: less than 0 is past [s].
    """
    course = at(trail[0], trail[1], where[0] + later * where[1])[2]
    frame, swept = turning[1] + later * turning[2], turning[0] * turning[2]
    east = where[1] * np.sin(course) + swept * np.sin(frame)
    north = where[1] * np.cos(course) + swept * np.cos(frame)
    return east - current[0], north - current[1]


@compiled
def in_time(
    f: Frame, station: Floats, trail: tuple[Floats, int], time: float, current: tuple[float, float], memory: Floats
) -> tuple[float, float]:
    """Velocity over ground with which a hull stays nearest to its station, east and north [m/s].

    Args:
        f: `preview` is how early all of it is given, for hull and thrusters lag.
        station: columns BEHIND and PORT are read.
        trail: of the leader, and how many points it has, at least one.
        time: now [s].
        current: as the follower believes it [m/s].
        memory: columns FRAME and FRAME_RATE, shape (2,).
    """
    points, count = trail
    where = arc_at(points, count, time) - station[BEHIND], pace(points, count)
    turning = np.array([station[PORT], memory[FRAME], memory[FRAME_RATE]])
    east, north = _through_water(trail, where, turning, current, f.preview)
    heading = upper = lower = np.arctan2(east, north)
    for side in (-1.0, 1.0):
        then = heading
        for j in range(1, STEPS + 1):
            x, y = _through_water(trail, where, turning, current, f.preview + side * j * STEP)
            then += signed_angle(np.arctan2(x, y) - then)
            upper = max(upper, then - AGILITY * j * STEP)
            lower = min(lower, then + AGILITY * j * STEP)
    speed, heading = np.hypot(east, north), 0.5 * (upper + lower)
    return speed * np.sin(heading) + current[0], speed * np.cos(heading) + current[1]
