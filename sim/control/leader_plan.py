"""The leader's route, where its messages carry the next waypoints: the trail goes on along it while nothing is heard.

A follower that has heard a waypoint and its time computes the leader's track to it by the rules of the point motion
(`sim.scenario.point_motion`), and takes the leader to be as far off that track as it was at the last message. Without
waypoints it can only assume that the leader keeps its course, and is off by the way that the leader makes after a turn.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled
from sim.control import trail as of_trail
from sim.control.trail import extend
from sim.scenario.point_motion import SHARPEST_CUT, TURN_RATE

PLANNED_EAST, PLANNED_NORTH, PLANNED_COURSE = range(3)
"""Columns of a planned track: [m], [m], [rad]."""
SPACING = 1.0
"""Planned points follow each other in a trail after this time [s]."""
_HALF_TURN = 0.5 * SHARPEST_CUT / TURN_RATE
"""A turn begins at most so long before its waypoint [s]."""
_OFF_PLAN = 5.0
"""A leader farther off its plan than this has left it after the last waypoint that was heard [m]."""


class LeaderPlan(NamedTuple):
    """The leader's track as a follower computes it from waypoints, at n control steps."""

    track: Floats
    """Columns PLANNED_EAST … PLANNED_COURSE, shape (n, 3)."""
    until: Floats
    """Time until which a message sent at each step tells the track, shape (n,), [s]; of no length: none does."""


def plan_of(track: Floats, times: Floats, waypoints: int, dt: float) -> LeaderPlan:
    """The plan of a leader whose messages carry its next waypoints.

    The track is known until the turn at the last of them, which depends on the next leg, or until the end of the route.

    Args:
        track: east, north [m] and course [rad] of the leader's reference at n control steps, shape (n, 3).
        times: of the leader's waypoints, increasing, shape (w,), [s].
        waypoints: how many a message carries; 0: none.
        dt: control step [s].
    """
    if waypoints == 0:
        return LeaderPlan(np.zeros((0, 3)), np.zeros(0))
    last = np.searchsorted(times, dt * np.arange(len(track)), side="right") + waypoints - 1
    until = np.append(times[:-1] - _HALF_TURN, np.inf)[np.minimum(last, times.size - 1)]
    # the start is known, but no message has been sent yet
    until[0] = -np.inf
    return LeaderPlan(np.ascontiguousarray(track), until)


@compiled
def extend_as_planned(
    plan: LeaderPlan, trail: Floats, count: Ints, heard: tuple[float, int], clock: tuple[int, float]
) -> None:
    """Add where the leader is by the plan to its trail, if the last message told the plan for now.

    Args:
        plan: of the leader.
        trail: columns of `sim.control.trail`, shape (room, TRAIL).
        count: points of it, shape (1,); brought forward.
        heard: time of the last message [s], and how many points the trail had with it; the others are planned ones.
        clock: control step, and its length [s].
    """
    (k, dt), (last, points) = clock, heard
    if k * dt > plan.until[round(last / dt)]:
        return
    # of a leader that stands still, planned points take the place of the one that was heard
    head = points - 1
    since = round(trail[head, of_trail.TIME] / dt)
    if k <= since:
        return
    east = trail[head, of_trail.EAST] + plan.track[k, PLANNED_EAST] - plan.track[since, PLANNED_EAST]
    north = trail[head, of_trail.NORTH] + plan.track[k, PLANNED_NORTH] - plan.track[since, PLANNED_NORTH]
    heading = trail[head, of_trail.HEADING] + plan.track[k, PLANNED_COURSE] - plan.track[since, PLANNED_COURSE]
    extend(trail, count, east, north, k * dt, (trail[head, of_trail.THROUGH], heading))


@compiled
def correct_planned(trail: Floats, count: Ints, heard: int, message: tuple[float, float, float]) -> None:
    """Move planned points of a trail to where the leader was by the message after them; later ones are dropped.

    Its distance from the plan is taken to have grown evenly since the message before.

    Args:
        trail: columns of `sim.control.trail`, shape (room, TRAIL).
        count: points of it, shape (1,); brought forward.
        heard: how many points it had after the last message, at least one.
        message: east, north [m] and time [s].
    """
    total, (east, north, time) = count[0], message
    count[0] = heard
    if total == heard:
        return
    begin, last = trail[heard - 1, of_trail.TIME], total - 1
    while last >= heard and trail[last, of_trail.TIME] > time - 0.5 * SPACING:
        last -= 1
    if last < heard:
        return
    planned_east, planned_north, _, _, _ = of_trail.at(trail, total, of_trail.arc_at(trail, total, time))
    off_east, off_north = east - planned_east, north - planned_north
    if np.hypot(off_east, off_north) > _OFF_PLAN:
        off_east = off_north = 0.0
    for i in range(heard, last + 1):
        when = trail[i, of_trail.TIME]
        share = (when - begin) / (time - begin)
        said = trail[i, of_trail.THROUGH], trail[i, of_trail.HEADING]
        # a point is written where it was read, or before
        extend(
            trail,
            count,
            trail[i, of_trail.EAST] + share * off_east,
            trail[i, of_trail.NORTH] + share * off_north,
            when,
            said,
        )
