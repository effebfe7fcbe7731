"""Stations in the leader's trail: where they are, how followers kept them, and which of them meet.

Where the leader turns by 90°, stations that are as far ahead of each other as they are aside meet: each follows the
trail at its own distance, and takes up the new direction only after it. Before a flight, stations are therefore
followed along the leader's plan.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Record, Records, records
from laisn.compiled import compiled
from sim.assembly import route_of, routes_of
from sim.control.station import FRAME_STATE, STATION, station_at, turn_frame
from sim.control.trail import TRAIL, extend
from sim.scenario.formation import LEAST_LAYER_M, Formation
from sim.scenario.point_motion import ACCELERATION, plan
from sim.scenario.settings import Scenario
from sim.tracking import track_error
from sim.trajectory import Trajectory

LOST_M = 10.0  # a follower that was ever farther than this from its station is called lost [m]
JOINED_M = 2.0  # a follower has joined when it first is nearer than this to its station [m]
STATION_PLACE = np.dtype(
    [
        ("east", np.float64),  # [m]
        ("north", np.float64),
        ("heading", np.float64),  # of the formation's frame there [rad]
        ("rate", np.float64),  # its rate of turn [rad/s]
    ]
)
"""Where a station is at one instant."""


@compiled
def _stations(
    leader: Floats, speed: Floats, heading: Floats, stations: Records, formation: Record, dt: float, out: Records
) -> None:
    """Write where stations truly are, of STATION_PLACE, shape (n, f)."""
    n, f = leader.shape[0], stations.shape[0]
    trail, count = np.empty(n, TRAIL), np.zeros(1, dtype=np.int64)
    states = np.zeros(f, FRAME_STATE)
    for i in range(f):
        states[i].heading = heading[0]
    for k in range(n):
        time = k * dt
        extend(trail, count, leader[k, 0], leader[k, 1], time, (speed[k], heading[k]))
        for i in range(f):
            known = trail, count[0]
            if k > 0:
                turn_frame(formation, stations[i], known, (time - dt, time), dt, states[i])
            target = station_at(formation, stations[i], known, time, states[i])
            out[k, i].east, out[k, i].north = target.east, target.north
            out[k, i].heading, out[k, i].rate = states[i].heading, states[i].rate


def stations_along(
    leader: Floats, speed: Floats, heading: Floats, stations: Records, formation: Formation, dt: float
) -> Records:
    """Where stations are if the leader goes along a way: records of STATION_PLACE, shape (n, f).

    Args:
        leader: east and north at n instants, shape (n, 2), [m].
        speed: through the water, shape (n,), [m/s].
        heading: shape (n,), [rad].
        stations: records of STATION, shape (f,).
        formation: how frames turn.
        dt: between instants [s].
    """
    out = records(STATION_PLACE, leader.shape[0], stations.shape[0])
    place, through, ahead = (np.ascontiguousarray(values) for values in (leader, speed, heading))
    _stations(place, through, ahead, stations, formation.record(), dt, out)
    return out


def stations_of(scenario: Scenario) -> Records:
    """Stations of all followers, records of STATION, shape (f,); one without has that of the leader itself."""
    stations = records(STATION, len(scenario.followers))
    for i, follower in enumerate(scenario.followers):
        if follower.station:
            stations[i] = follower.station.record()
    return stations


def true_stations(scenario: Scenario, trajectory: Trajectory) -> Records:
    """Where each follower's station truly was, in the leader's true trail: records of STATION_PLACE, shape (n, f).

    A follower without a station has that of the leader itself, which means nothing.
    """
    leader, speed = trajectory.position[:, 0, :2], trajectory.forward_speed[:, 0]
    return stations_along(
        leader, speed, trajectory.heading[:, 0], stations_of(scenario), scenario.formation, trajectory.dt
    )


@dataclass(frozen=True, kw_only=True)
class StationKeeping:
    """How one follower kept its station, since it joined it."""

    joined_s: float
    """When it was first within 2 m of its station [s]; NaN: never, and the other figures are those of all the time."""
    station_rms_m: float  # horizontal distance of its hydrophone from the station, root mean square [m]
    station_p95_m: float  # distance from the station that it exceeds for 5 % of the time [m]
    station_max_m: float  # largest distance from the station [m]
    lost: bool  # whether it was ever more than 10 m off its station, or never joined


def off_station(scenario: Scenario, trajectory: Trajectory, stations: Records | None = None) -> Floats:
    """Horizontal distance of each follower's hydrophone from its station, shape (n, f), [m]; NaN of one without.

    `stations` are those of `true_stations`; None: they are found here.
    """
    off = np.full((trajectory.time.size, len(scenario.followers)), np.nan)
    kept = [i for i, follower in enumerate(scenario.followers) if follower.station]
    if not kept:
        # a first flight along routes need not compile what finds stations
        return off
    places = true_stations(scenario, trajectory) if stations is None else stations
    for i in kept:
        hydrophone = trajectory.site_path(f"{scenario.followers[i].name}/hydrophone")[:, :2]
        off[:, i] = np.hypot(hydrophone[:, 0] - places.east[:, i], hydrophone[:, 1] - places.north[:, i])
    return off


def track_errors(scenario: Scenario, trajectory: Trajectory, stations: Records | None = None) -> Floats:
    """Horizontal distance of each follower from its station, or from where its route has it, shape (n, f), [m].

    Arguments as of `off_station`.
    """
    kept = off_station(scenario, trajectory, stations)
    routes = routes_of(scenario)
    for i, follower in enumerate(scenario.followers):
        if follower.station is None:
            kept[:, i] = track_error(routes[i + 1], trajectory.time, trajectory.position[:, i + 1, :2])
    return kept


def station_keeping(off: Floats, time: Floats) -> StationKeeping:
    """Figures of one follower; both arguments of shape (n,), distances from its station [m] at times [s]."""
    near = off < JOINED_M
    joined = int(np.argmax(near)) if near.any() else None
    counted = off[joined or 0 :]
    return StationKeeping(
        joined_s=float("nan") if joined is None else float(time[joined]),
        station_rms_m=float(np.sqrt(np.mean(counted**2))),
        station_p95_m=float(np.percentile(counted, 95)),
        station_max_m=float(counted.max()),
        lost=bool(joined is None or counted.max() > LOST_M),
    )


class Approach(NamedTuple):
    """Two vehicles where they came nearest to each other."""

    distance_m: float
    pair: tuple[str, str]
    time_s: float


def _nearest(trajectory: Trajectory, axes: int, pairs: Bools | None = None) -> Approach | None:
    """The pair that came nearest in space (3) or horizontally (2), of all or of some, shape (v, v); None: of none."""
    found, names = None, trajectory.names
    for i, j in zip(*np.tril_indices(len(names), -1), strict=True):
        if pairs is None or pairs[i, j]:
            between = trajectory.position[:, i, :axes] - trajectory.position[:, j, :axes]
            distance = np.sqrt(sum(part * part for part in between.T))
            k = int(distance.argmin())
            if found is None or distance[k] < found.distance_m:
                found = Approach(float(distance[k]), (names[j], names[i]), float(trajectory.time[k]))
    return found


def closest_approaches(trajectory: Trajectory) -> tuple[Approach, Approach]:
    """The pair that came nearest in space, and the one that came nearest horizontally, whatever their depths."""
    space, level = _nearest(trajectory, 3), _nearest(trajectory, 2)
    assert space is not None and level is not None  # noqa: PT018
    return space, level


def closest_in_a_layer(scenario: Scenario, trajectory: Trajectory) -> Approach | None:
    """The pair of one layer that came nearest horizontally; None if no layer has two vehicles."""
    depths = np.array([vehicle.layer_m for vehicle in (scenario.leader, *scenario.followers)])
    return _nearest(trajectory, 2, np.abs(depths[:, None] - depths) < LEAST_LAYER_M)


_STEP_S = 0.5  # stations are followed in steps of this time; they move by half a metre in it [s]


class Crossing(NamedTuple):
    """Two stations of one layer where they are nearest to each other on the leader's route, and what giving way takes.

    Who gives way loses way through the water, and keeps steerage way: in a following current little is left to lose.
    """

    pair: tuple[int, int]  # numbers of their followers from 0 on; −1 is the leader
    apart_m: float
    time_s: float
    closing_m_s: float  # fastest at which the stations come nearer to each other once their followers sense each other
    way_m_s: float
    """Speed through the water of the slower of two vehicles when they begin to detect and avoid each other."""
    needed_m_s: float  # what it takes: its share of the closing, and steerage way besides
    braking_m: float  # distance that they come nearer in until they have lost what they close up at


def crossings(scenario: Scenario, reach_m: float = 0.0) -> list[Crossing]:
    """All pairs of stations of one layer, the leader's place included, followed along the leader's plan.

    `reach_m` is the distance at which followers sense each other.
    """
    kept = [(i, f.station) for i, f in enumerate(scenario.followers) if f.station]
    numbers = [i for i, _ in kept] + [-1]
    places = np.array([[s.behind_m, s.port_m, s.depth_m] for _, s in kept] + [[0.0, 0.0, scenario.leader.layer_m]])
    pairs = np.argwhere(np.tril(np.abs(places[:, None, 2] - places[:, 2]) < LEAST_LAYER_M, -1))
    if not pairs.size:
        return []
    time = np.arange(0.0, scenario.duration_s + _STEP_S, _STEP_S)
    leader = plan(route_of(scenario.leader, "leader")).at(time)
    drift = np.broadcast_to(scenario.ocean.current_at(places[:, 2], time[:, None]), (time.size, len(places), 2))
    over_ground = leader.speed * np.array([np.sin(leader.course), np.cos(leader.course)])
    through, way = np.hypot(*(over_ground - drift[:, -1].T)), np.column_stack([leader.east, leader.north])
    stations = records(STATION, len(places))
    stations.behind, stations.port, stations.depth = places.T
    placed = stations_along(way, through, leader.course, stations, scenario.formation, _STEP_S)
    way, found = np.stack([placed.east, placed.north], axis=-1), []
    for i, j in pairs:
        apart = np.hypot(*(way[:, i] - way[:, j]).T)
        nearest = int(apart.argmin())
        sensed = int(np.flatnonzero(apart[:nearest] >= reach_m)[-1:].sum())
        closing = -float(np.diff(apart[sensed : nearest + 1], prepend=apart[sensed]).min()) / _STEP_S
        # the leader does not give way
        able = [n for n in (i, j) if numbers[n] >= 0]
        step = (way[sensed + 1] - way[sensed]) / _STEP_S - drift[sensed]
        found.append(
            Crossing(
                (numbers[j], numbers[i]),
                float(apart[nearest]),
                float(time[nearest]),
                closing,
                way_m_s=min(float(np.hypot(*step[n])) for n in able),
                needed_m_s=closing / len(able) + scenario.formation.min_along_track_speed_m_s,
                braking_m=closing**2 / (2.0 * len(able) * ACCELERATION),
            )
        )
    return found
