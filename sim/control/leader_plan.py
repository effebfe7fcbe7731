"""The leader's route, where its messages carry the next waypoints: the trail continues along it between messages.

A follower that has received a waypoint and its time computes the leader's track to it by the rules of the point motion
(`sim.scenario.point_motion`), and takes the leader to be as far off that track as it was at the last message. Without
waypoints it can only assume that the leader keeps its course, and is off by the way that the leader makes after a turn.

`trail` and `count` are those of `sim.control.trail`; `count` has shape (1,) and is brought forward.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, Records, records
from laisn.compiled import compiled
from sim.control.guidance import REFERENCE
from sim.control.trail import arc_at, at, extend
from sim.scenario.point_motion import SHARPEST_CUT, TURN_RATE

SPACING = 1.0
"""Planned points follow each other in a trail after this time [s]."""
_HALF_TURN = 0.5 * SHARPEST_CUT / TURN_RATE
"""A turn begins at most so long before its waypoint [s]."""
_OFF_PLAN = 5.0
"""A leader farther off its plan than this has left it after the last waypoint that was received [m]."""


class LeaderPlan(NamedTuple):
    """The leader's track as a follower computes it from waypoints, at n control steps."""

    track: Records
    """Of REFERENCE, of which place and course are read, shape (n,)."""
    until: Floats
    """Time until which a message sent at each step gives the track, shape (n,), [s]; of no length: none does."""


def plan_of(track: Records, times: Floats, waypoints: int, dt: float) -> LeaderPlan:
    """The plan of a leader whose messages carry its next waypoints.

    The track is known until the turn at the last of them, which depends on the next leg, or until the end of the route.

    Args:
        track: the leader's reference at n control steps, records of REFERENCE, shape (n,).
        times: of the leader's waypoints, increasing, shape (w,), [s].
        waypoints: how many a message carries; 0: none.
        dt: control step [s].
    """
    if waypoints == 0:
        return LeaderPlan(records(REFERENCE, 0), np.zeros(0))
    last = np.searchsorted(times, dt * np.arange(len(track)), side="right") + waypoints - 1
    until = np.append(times[:-1] - _HALF_TURN, np.inf)[np.minimum(last, times.size - 1)]
    # the start is known, but no message has been sent yet
    until[0] = -np.inf
    return LeaderPlan(np.ascontiguousarray(track), until)


@compiled
def extend_as_planned(
    plan: LeaderPlan, trail: Records, count: Ints, received: tuple[float, int], clock: tuple[int, float]
) -> None:
    """Add where the leader is by the plan to its trail, if the last message had the plan for now.

    Args:
        received: time of the last message [s], and how many points the trail had with it; the others are planned ones.
        clock: control step, and its length [s].
    """
    (k, dt), (last, points) = clock, received
    if k * dt > plan.until[round(last / dt)]:
        return
    # of a leader that stands still, planned points take the place of the one that was received
    head = points - 1
    since = round(trail[head].time / dt)
    if k <= since:
        return
    east = trail[head].east + plan.track[k].east - plan.track[since].east
    north = trail[head].north + plan.track[k].north - plan.track[since].north
    heading = trail[head].heading + plan.track[k].course - plan.track[since].course
    extend(trail, count, east, north, k * dt, (trail[head].through, heading))


@compiled
def correct_planned(trail: Records, count: Ints, received: int, message: tuple[float, float, float]) -> None:
    """Move planned points of a trail to where the leader was by the message after them; later ones are dropped.

    Its distance from the plan is taken to have grown evenly since the message before.

    Args:
        received: how many points it had after the last message, at least one.
        message: east, north [m] and time [s].
    """
    total, (east, north, time) = count[0], message
    count[0] = received
    if total == received:
        return
    begin, last = trail[received - 1].time, total - 1
    while last >= received and trail[last].time > time - 0.5 * SPACING:
        last -= 1
    if last < received:
        return
    planned_east, planned_north, _, _, _ = at(trail, total, arc_at(trail, total, time))
    off_east, off_north = east - planned_east, north - planned_north
    if np.hypot(off_east, off_north) > _OFF_PLAN:
        off_east = off_north = 0.0
    for i in range(received, last + 1):
        when = trail[i].time
        share = (when - begin) / (time - begin)
        motion = trail[i].through, trail[i].heading
        # a point is written where it was read, or before
        extend(
            trail,
            count,
            trail[i].east + share * off_east,
            trail[i].north + share * off_north,
            when,
            motion,
        )
