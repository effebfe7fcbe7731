"""Stations before anything is flown: how near those of one layer come to each other on the leader's route.

Where the leader turns by 90°, stations that are as far ahead of each other as they are aside meet: each follows the
trail at its own distance, and takes up the new direction only after it. Which pairs do that depends on the shape of
the formation, its frame and the corner; here the stations are followed along the leader's plan.
"""

from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints, records
from sim.assembly import route_of
from sim.control.station import STATION
from sim.scenario.formation import LEAST_APART_M, LEAST_LAYER_M
from sim.scenario.point_motion import ACCELERATION, plan
from sim.scenario.settings import Scenario
from sim.station_keeping import stations_along

_STEP_S = 0.5
"""Stations are followed in steps of this time; they move by half a metre in it [s]."""


class Encounter(NamedTuple):
    """Two stations of one layer where they are nearest to each other on the leader's route."""

    pair: tuple[int, int]
    """Numbers of their followers from 0 on; −1 is the leader."""
    apart_m: float
    time_s: float


class Crossing(NamedTuple):
    """Two stations of one layer that meet, and what their followers have to give way with."""

    meeting: Encounter
    closing_m_s: float
    """Fastest at which the stations come nearer to each other once their followers sense each other."""
    way_m_s: float
    """Speed through the water of the slower of two vehicles when they begin to detect and avoid each other."""
    needed_m_s: float
    """What it takes: its share of the closing, and steerage way besides."""
    braking_m: float
    """Distance that they come nearer in until they have lost what they close up at."""


class _Followed(NamedTuple):
    """Stations of f followers and the leader, followed along the leader's plan."""

    numbers: list[int]
    """Of followers, −1 for the leader at the end, shape (f + 1,)."""
    pairs: Ints
    """Rows of two that are in one layer, shape (p, 2)."""
    time: Floats
    """Shape (n,), [s]."""
    way: Floats
    """East and north, shape (n, f + 1, 2), [m]."""
    drift: Floats
    """Current in each one's layer, shape (n, f + 1, 2), [m/s]."""

    def meeting(self, i: int, j: int) -> Encounter:
        """Where a pair is nearest to each other."""
        apart = self.apart(i, j)
        k = int(apart.argmin())
        return Encounter((self.numbers[j], self.numbers[i]), float(apart[k]), float(self.time[k]))

    def apart(self, i: int, j: int) -> Floats:
        """Distance of a pair, shape (n,), [m]."""
        return np.asarray(np.hypot(*(self.way[:, i] - self.way[:, j]).T))


def _follow(scenario: Scenario) -> _Followed | None:
    """Stations along the leader's plan; None if no layer has two."""
    kept = [(i, f.station) for i, f in enumerate(scenario.followers) if f.station]
    places = np.array([[s.behind_m, s.port_m, s.depth_m] for _, s in kept] + [[0.0, 0.0, scenario.leader.layer_m]])
    alike = np.abs(places[:, None, 2] - places[None, :, 2]) < LEAST_LAYER_M
    pairs = np.argwhere(np.tril(alike, -1))
    if not pairs.size:
        return None
    time = np.arange(0.0, scenario.duration_s + _STEP_S, _STEP_S)
    leader = plan(route_of(scenario.leader, "leader")).at(time)
    drift = np.broadcast_to(scenario.ocean.current_at(places[:, 2], time[:, None]), (time.size, len(places), 2))
    through = np.hypot(
        leader.speed * np.sin(leader.course) - drift[:, -1, 0],
        leader.speed * np.cos(leader.course) - drift[:, -1, 1],
    )
    way = np.column_stack([leader.east, leader.north])
    stations = records(STATION, len(places))
    stations.behind, stations.port, stations.depth = places.T
    found = stations_along(way, through, leader.course, stations, scenario.formation, _STEP_S)
    places = np.stack([found.east, found.north], axis=-1)
    return _Followed([i for i, _ in kept] + [-1], pairs, time, places, drift)


def nearest_stations(scenario: Scenario) -> Encounter | None:
    """The two stations of one layer that come nearest to each other; None if no layer has two.

    Raises:
        LaisnError: the leader's route cannot be flown.
    """
    followed = _follow(scenario)
    met = [] if followed is None else [followed.meeting(i, j) for i, j in followed.pairs]
    return min(met, key=lambda one: one.apart_m, default=None)


def hardest_crossing(scenario: Scenario, reach_m: float) -> Crossing | None:
    """Of stations of one layer that meet, the two whose followers have the least way to lose for what it takes.

    Who gives way loses way through the water, and keeps steerage way: in a following current little is left to lose.

    Args:
        reach_m: distance at which followers sense each other.

    Returns:
        None if no two come as near as stations of one layer must not.

    Raises:
        LaisnError: the leader's route cannot be flown.
    """
    followed, crossings = _follow(scenario), []
    if followed is None:
        return None
    for i, j in followed.pairs:
        meeting, apart = followed.meeting(i, j), followed.apart(i, j)
        if meeting.apart_m >= LEAST_APART_M:
            continue
        nearest = int(apart.argmin())
        outside = np.flatnonzero(apart[:nearest] >= reach_m)
        sensed = int(outside[-1]) if outside.size else 0
        closing = -float(np.diff(apart[sensed : nearest + 1], prepend=apart[sensed]).min()) / _STEP_S
        # the leader does not give way
        able = [n for n in (i, j) if followed.numbers[n] >= 0]
        step = (followed.way[sensed + 1] - followed.way[sensed]) / _STEP_S - followed.drift[sensed]
        way = min(float(np.hypot(*step[n])) for n in able)
        needed = closing / len(able) + scenario.formation.min_along_track_speed_m_s
        crossings.append(Crossing(meeting, closing, way, needed, closing**2 / (2.0 * len(able) * ACCELERATION)))
    return min(crossings, key=lambda crossing: crossing.way_m_s - crossing.needed_m_s, default=None)
