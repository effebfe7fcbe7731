"""Stations before anything is flown: how near those of one layer come to each other on the leader's route.

Where the leader turns by 90°, stations that are as far ahead of each other as they are aside meet: each follows the
trail at its own distance, and takes up the new direction only after it. Which pairs do that depends on the shape of
the formation, its frame and the corner; here the stations are followed along the leader's plan.
"""

from typing import NamedTuple

import numpy as np

from sim.assembly import route_of
from sim.scenario.formation import LEAST_LAYER_M
from sim.scenario.point_motion import plan
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


def nearest_stations(scenario: Scenario) -> Encounter | None:
    """The two stations of one layer that come nearest to each other; None if no layer has two.

    Raises:
        LaisnError: the leader's route cannot be flown.
    """
    kept = [(i, f.station) for i, f in enumerate(scenario.followers) if f.station]
    places = np.array([[s.behind_m, s.port_m, s.depth_m] for _, s in kept] + [[0.0, 0.0, scenario.leader.layer_m]])
    numbers = [i for i, _ in kept] + [-1]
    alike = np.abs(places[:, None, 2] - places[None, :, 2]) < LEAST_LAYER_M
    pairs = np.argwhere(np.tril(alike, -1))
    if not pairs.size:
        return None
    time = np.arange(0.0, scenario.duration_s + _STEP_S, _STEP_S)
    leader = plan(route_of(scenario.leader, "leader")).at(time)
    ocean, towards = scenario.ocean, np.deg2rad(scenario.ocean.current_direction_deg)
    drift = ocean.current_speed_m_s - ocean.current_shear_per_s * scenario.leader.layer_m
    through = np.hypot(
        leader.speed * np.sin(leader.course) - drift * np.sin(towards),
        leader.speed * np.cos(leader.course) - drift * np.cos(towards),
    )
    way = np.column_stack([leader.east, leader.north])
    found = stations_along(way, through, leader.course, places, scenario.formation, _STEP_S)[..., :2]
    least = [np.hypot(*(found[:, i] - found[:, j]).T) for i, j in pairs]
    nearest = int(np.argmin([apart.min() for apart in least]))
    i, j = pairs[nearest]
    k = int(least[nearest].argmin())
    return Encounter((numbers[j], numbers[i]), float(least[nearest][k]), float(time[k]))
