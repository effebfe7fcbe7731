"""How near vehicles came to their routes, to their stations and to one another, and hulls that
touch.

Vehicles pass through each other in the simulation; contact is detected by geometry. Where the
leader turns by 90°, stations that are as far ahead of each other as they are aside meet: before a
flight, they are followed along the leader's plan (`closest_stations`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints, RecordFields, Records, records, row_dtype
from laisn.compiled import compiled, jitable
from laisn.held import borrowed_values
from sim import attitude
from sim.assembly import routes_of
from sim.control.station import FRAME_STATE, STATION, TRAIL, extend, station_at, turn_frame
from sim.hull import HullLimits, hull_of, limits_of
from sim.scenario.formation import MIN_LAYER_SPACING_M
from sim.scenario.parts import MissionPlan, MotionSettings
from sim.scenario.point_motion import plan as planned_motion
from sim.scenario.routes import Route
from sim.scenario.settings import CONTROL_STEP_S, Follower
from sim.scenario.vehicle_routes import route_of
from sim.sea import Area, areas_of
from sim.trajectory import Trajectory, blocks
from sim.water.assembly import current_at, floor_of
from sim.water.floors import LevelFloor
from sim.water.grids import GriddedFloor

# half the length of the straight part of a hull [m]
LEADER_HALF_M = 1.0
FOLLOWER_HALF_M = 0.7
HULL_RADIUS_M = 0.1  # its radius [m]


@jitable
def _squared_distance(points: Floats, first: int, last: int, east: float, north: float) -> float:
    """Squared distance of a place [m²] to the nearest of the legs between points, shape (m, 2),
    from number `first` to `last`.
    """
    least = math.inf
    for leg in range(first, last + 1):
        along_east = points[leg + 1, 0] - points[leg, 0]
        along_north = points[leg + 1, 1] - points[leg, 1]
        off_east = east - points[leg, 0]
        off_north = north - points[leg, 1]
        length_squared = along_east * along_east + along_north * along_north
        # where the vehicle stops, the leg is a point
        dot = off_east * along_east + off_north * along_north
        share = min(max(dot / (length_squared if length_squared > 0.0 else 1.0), 0.0), 1.0)
        off_east -= share * along_east
        off_north -= share * along_north
        least = min(least, off_east * off_east + off_north * off_north)
    return least


@compiled
def _squared_distances(points: Floats, position: Floats, squared: Floats) -> None:
    """Write the squared distance of each of n places, shape (n, 2), to the nearest of all legs
    between points, shape (n,).
    """
    last = points.shape[0] - 2
    # references to arrays are not counted at each place
    ends = borrowed_values(points)
    for k in range(position.shape[0]):
        squared[k] = _squared_distance(ends, 0, last, position[k, 0], position[k, 1])


@compiled
def _squared_cross_track(
    points: Floats, arrival: Floats, time: Floats, position: Floats, squared: Floats
) -> None:
    """Write the squares of `cross_track`; `arrival` are the times at the points of the route, shape
    (m,), [s].
    """
    last = points.shape[0] - 2
    ends = borrowed_values(points)
    due = 0
    for k in range(time.size):
        if time[k] < arrival[due]:
            due = 0
        while due < last and arrival[due + 1] <= time[k]:
            due += 1
        first_leg = max(due - 1, 0)
        last_leg = min(due + 1, last)
        squared[k] = _squared_distance(ends, first_leg, last_leg, position[k, 0], position[k, 1])


def cross_track(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance at times (n,), [s], from places (n, 2), [m], to the leg that is due or a
    neighbour, the nearest, [m].
    """
    squared = np.empty(time.size)
    _squared_cross_track(route.waypoint, route.time, time, position, squared)
    return np.sqrt(squared, out=squared)


class _PlannedPlaces(NamedTuple):
    """Where the point motion along a route is at times, arrays of shape (n,), [s] and [m]."""

    time: Floats
    east: Floats
    north: Floats


class _PlannedWay:
    """The way of the point motion along a route: it keeps its places at the times that it was last
    asked for, which missions of a study that share the route have in common.
    """

    def __init__(self, route: Route) -> None:
        self._plan = planned_motion(route)
        self._last = _PlannedPlaces(np.empty(0), np.empty(0), np.empty(0))

    def at(self, time: Floats) -> _PlannedPlaces:
        """Places at times of shape (n,), [s]."""
        # another thread may put others in their place
        last = self._last
        if np.array_equal(time, last.time):
            return last
        planned = self._plan.at(time)
        places = _PlannedPlaces(time.copy(), planned.east, planned.north)
        self._last = places
        return places


@lru_cache(maxsize=16)
def _planned_way(route: Route) -> _PlannedWay:
    return _PlannedWay(route)


def track_error(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance to where the point motion along the route is, shape (n,), [m]; arguments as of
    `cross_track`.
    """
    way = _planned_way(route)
    errors = np.empty(time.size)
    for block in blocks(time.size):
        planned = way.at(time[block])
        east = position[block, 0] - planned.east
        north = position[block, 1] - planned.north
        errors[block] = np.sqrt(east * east + north * north)
    return errors


LEFT_ROUTE_M = 100.0
"""A mission ends where a vehicle that keeps to its route by the truth is farther from it [m]."""
_BEYOND_M = 1e6  # length of the leg behind the last waypoint, where vehicles go straight on [m]
_LOOK_EVERY = 10  # distances from routes are looked at in every such instant: 1 s


class MissionBounds(NamedTuple):
    """Where a mission ends: at the floor, far off a route, or beyond a field of the sea."""

    floor: LevelFloor | GriddedFloor
    routes: tuple[Route | None, ...]  # of each vehicle; None: it does not keep to one
    areas: tuple[Area, ...] = ()


class Departure(NamedTuple):
    """A vehicle where it first leaves the bounds of a mission."""

    instant: int
    vehicle: int  # index
    off_route_m: float | None  # distance from its route, where that is why; else None
    # settings key of the field of the sea whose area it has left, where that is why; else empty
    left_field: str = ""


@lru_cache(maxsize=64)
def _points_and_beyond(route: Route) -> Floats:
    """Waypoints of a route, and a place far on where it goes straight on behind the last, shape
    (n, 2), [m].
    """
    points = route.waypoint
    last = points[-1] - points[-2]
    if not last.any():
        return points
    return np.vstack([points, points[-1] + _BEYOND_M * last / np.hypot(*last)])


def distance_from_route(route: Route, time: Floats, position: Floats) -> Floats:
    """Distance at times (n,), [s], from places (n, 3), [m], to the nearest leg of a route at the
    depth that is due, (n,), [m].
    """
    squared = np.empty(time.size)
    _squared_distances(_points_and_beyond(route), np.ascontiguousarray(position[:, :2]), squared)
    return np.asarray(np.hypot(np.sqrt(squared), position[:, 2] + route.depth.depth_at(time)))


def first_departure(time: Floats, pose: Floats, bounds: MissionBounds) -> Departure | None:
    """The first of n instants at which a vehicle is out of bounds, by poses of shape (n, v, 7);
    None: none is.
    """
    departures = list[Departure]()
    grounded = pose[..., 2] < -bounds.floor.depths_at(pose[..., 0], pose[..., 1])
    if grounded.any():
        departures += [
            Departure(int(np.argmax(grounded[:, vehicle])), vehicle, None)
            for vehicle in np.flatnonzero(grounded.any(axis=0)).tolist()
        ]
    for area in bounds.areas:
        for vehicle in range(pose.shape[1]):
            if not area.region.holds(pose[:, vehicle, :2]):
                in_area = area.region.within(pose[:, vehicle, :2])
                departures.append(Departure(int(np.argmin(in_area)), vehicle, None, area.key))
    # of the mission, not of these instants, so that a mission ends alike in steps of any length
    looks = np.flatnonzero(np.rint(time / CONTROL_STEP_S).astype(np.int64) % _LOOK_EVERY == 0)
    if looks.size:
        departures += _off_routes(looks, time, pose, bounds.routes)
    return min(departures, key=lambda departure: departure[:2], default=None)


def _off_routes(
    looks: Ints, time: Floats, pose: Floats, routes: Sequence[Route | None]
) -> list[Departure]:
    """Where vehicles are first far off their routes, at some of n instants by their index."""
    departures = []
    for vehicle, route in enumerate(routes):
        if route is None:
            continue
        distance = distance_from_route(route, time[looks], pose[looks, vehicle, :3])
        if distance.max() > LEFT_ROUTE_M:
            first = int(np.argmax(distance > LEFT_ROUTE_M))
            departures.append(Departure(int(looks[first]), vehicle, float(distance[first])))
    return departures


def bounds_of(motion: MotionSettings) -> MissionBounds:
    """Where a mission ends: at its floor and where fields end for all vehicles, far off
    its route for those that keep to one by the truth.
    """
    leader = motion.plan.leader
    followers = motion.plan.followers
    # vehicles that keep to no route by the truth
    leader_is_free = bool(leader.controller) or leader.guidance_position == "estimate"
    are_free = [leader_is_free, *(f.guided_by_estimate for f in followers)]
    have_station = [False, *(follower.station is not None for follower in followers)]
    routes = tuple(
        None if is_free or has_station else route
        for route, is_free, has_station in zip(
            routes_of(motion.plan), are_free, have_station, strict=True
        )
    )
    return MissionBounds(floor_of(motion.sea), routes, areas_of(motion.sea))


class Contact(NamedTuple):
    """Two hulls where they first touch."""

    time_s: float
    pair: tuple[str, str]  # their names, the leader before followers, followers in their order


def _dot(first: Floats, second: Floats) -> Floats:
    """Dot products of vectors, shape (n, 3), added up in the same order on every machine."""
    return np.asarray(
        first[..., 0] * second[..., 0]
        + first[..., 1] * second[..., 1]
        + first[..., 2] * second[..., 2]
    )


def squared_lengths(vectors: Floats) -> Floats:
    """Squared lengths of vectors, shape (…, 2 or 3), added up in the same order on every
    machine; sums over so short an axis are slow in NumPy."""
    return np.asarray(sum(component * component for component in np.moveaxis(vectors, -1, 0)))


def hull_gap(
    offsets: Floats, first: Floats, second: Floats, half_lengths: tuple[float, float]
) -> Floats:
    """Distances of two straight hulls' axes at n instants, shape (n,), [m].

    `offsets` lead from the middle of the first to that of the second, shape (n, 3), [m]; `first`
    and `second` are unit vectors along them, shape (n, 3), and `half_lengths` half their lengths
    [m].
    """
    cosine = _dot(first, second)
    along_first = _dot(first, offsets)
    along_second = _dot(second, offsets)
    # nearest points, at s and t from the middles along the axes, each within its hull (Ericson,
    # Real-Time Collision Detection, 2005)
    sine_squared = 1.0 - cosine * cosine
    crossed = sine_squared > 1e-9
    s = np.where(
        crossed, (along_first - cosine * along_second) / np.where(crossed, sine_squared, 1.0), 0.0
    )
    s = np.clip(s, -half_lengths[0], half_lengths[0])
    t = np.clip(cosine * s - along_second, -half_lengths[1], half_lengths[1])
    s = np.clip(cosine * t + along_first, -half_lengths[0], half_lengths[0])
    nearest = offsets + t[..., None] * second - s[..., None] * first
    return np.sqrt(_dot(nearest, nearest))


_WINDOW = 32  # instants from one look at all pairs to the next
_ROUNDING_M = 1e-6  # bounds of distances are no better than this [m]


class PairDistances(NamedTuple):
    """Bounds of the least distance of each pair over a time, shapes (v, v), [m]; infinite on the
    diagonal and above.
    """

    seen: Floats  # least distance at some instants
    bound: Floats  # no distance is less at any instant


@compiled
def _farthest_moves(places: Floats, squared: Floats) -> None:
    """Write the squared length of the farthest move of each of v vehicles from where each window of
    instants begins, shape (windows, v); NaN where a place is not a number.
    """
    for i in range(squared.shape[0]):
        begin = i * _WINDOW
        end = min(begin + _WINDOW, places.shape[0])
        for vehicle in range(places.shape[1]):
            farthest = 0.0
            for k in range(begin, end):
                length = 0.0
                for axis in range(places.shape[2]):
                    move = places[k, vehicle, axis] - places[begin, vehicle, axis]
                    length += move * move
                if length > farthest or math.isnan(length):
                    farthest = length
            squared[i, vehicle] = farthest


def pair_distances(places: Floats) -> PairDistances:
    """Bounds of the least distances of vehicles at places of shape (n, v, 2 or 3), [m].

    Pairs are looked at in every `_WINDOW`-th instant. Until the next look two vehicles come nearer
    by no more than they move. So the time grows with the pairs, but hardly with pairs times
    instants.
    """
    count = places.shape[1]
    at_looks = places[::_WINDOW].copy()
    squared_moves = np.empty((len(at_looks), count))
    _farthest_moves(places, squared_moves)
    moved_distance = np.sqrt(squared_moves)
    at_instants = np.full((count, count), np.inf)
    bound = at_instants.copy()
    for i in range(1, count):
        offsets = at_looks[:, i, None] - at_looks[:, :i]
        distance = np.sqrt(squared_lengths(offsets))
        at_instants[i, :i] = distance.min(axis=0)
        bound[i, :i] = (distance - moved_distance[:, i, None] - moved_distance[:, :i]).min(axis=0)
    return PairDistances(at_instants, bound - _ROUNDING_M)


class LeastDistances(NamedTuple):
    """Least distance of each of v vehicles from each other over a time, shapes (v, v), [m];
    infinite on the diagonal, NaN where a place is not a number.
    """

    in_space: Floats
    horizontal: Floats  # whatever their depths


@compiled
def _least_squares(position: Floats, in_space: Floats, horizontal: Floats) -> None:
    """Write the squares of `LeastDistances`, below their diagonals; infinite before."""
    for k in range(position.shape[0]):
        for i in range(1, position.shape[1]):
            for j in range(i):
                east = position[k, i, 0] - position[k, j, 0]
                north = position[k, i, 1] - position[k, j, 1]
                up = position[k, i, 2] - position[k, j, 2]
                level = east * east + north * north
                # unlike those of min, the results of np.minimum are NaN where a number is
                horizontal[i, j] = np.minimum(horizontal[i, j], level)
                in_space[i, j] = np.minimum(in_space[i, j], level + up * up)


def least_distances(position: Floats) -> LeastDistances:
    """How near vehicles came to each other, by positions of shape (n, v, 3), [m]."""
    count = position.shape[1]
    squares = LeastDistances(np.full((count, count), np.inf), np.full((count, count), np.inf))
    _least_squares(position, *squares)
    return LeastDistances(*(np.sqrt(np.minimum(values, values.T)) for values in squares))


def _pairs_within(distances: PairDistances, reach: float | Floats) -> list[list[int]]:
    """Pairs, the later vehicle first, that may come within a reach [m], one of all or of each,
    shape (v, v).
    """
    lower_triangle = np.tri(len(distances.bound), k=-1, dtype=np.bool_)
    # a distance that is not a number bounds nothing
    pairs: list[list[int]] = np.argwhere(lower_triangle & ~(distances.bound > reach)).tolist()
    return pairs


def _first_contacts(pose: Floats) -> Ints:
    """First instant at which the hulls of each pair touch, shape (v, v), below the diagonal; −1
    if they never do.
    """
    count = pose.shape[1]
    first = np.full((count, count), -1)
    for block in blocks(len(pose)):
        touched = _first_contacts_within(pose[block])
        anew = (first < 0) & (touched >= 0)
        first[anew] = block.start + touched[anew]
    return first


def _first_contacts_within(pose: Floats) -> Ints:
    """The same of a block of instants."""
    position = pose[..., :3]
    count = pose.shape[1]

    def axes(instants: Ints, vehicle: int) -> Floats:
        return np.stack(attitude.forward_of(pose[instants, vehicle, 3:].T), axis=-1)

    half_lengths = [LEADER_HALF_M, *[FOLLOWER_HALF_M] * (count - 1)]
    first = np.full((count, count), -1)
    reach = np.add.outer(half_lengths, half_lengths) + 2.0 * HULL_RADIUS_M
    for i, j in _pairs_within(pair_distances(position), reach):
        offsets = position[:, i] - position[:, j]
        close_instants = np.flatnonzero(
            _dot(offsets, offsets) <= (half_lengths[i] + half_lengths[j] + 2.0 * HULL_RADIUS_M) ** 2
        )
        gap = hull_gap(
            offsets[close_instants],
            axes(close_instants, j),
            axes(close_instants, i),
            (half_lengths[j], half_lengths[i]),
        )
        first[i, j] = next(iter(close_instants[gap < 2.0 * HULL_RADIUS_M]), -1)
    return first


def contacts(trajectory: Trajectory) -> list[Contact]:
    """Every pair of vehicles whose hulls touch, when they first do, in order of time."""
    first = _first_contacts(trajectory.pose)
    pairs = [
        Contact(float(trajectory.time[first[i, j]]), (trajectory.names[j], trajectory.names[i]))
        for i, j in np.argwhere(first >= 0)
    ]
    return sorted(pairs)


def first_touch(pose: Floats) -> int | None:
    """First of n instants at which two hulls touch, by their poses, shape (n, v, 7); None: none
    do.
    """
    first = _first_contacts(pose)
    return int(first[first >= 0].min()) if (first >= 0).any() else None


LOST_M = 10.0  # a follower that was ever farther than this from its station is called lost [m]
JOINED_M = 2.0  # a follower has joined when it first is nearer than this to its station [m]


class StationState(RecordFields):
    """Where a station is at one instant."""

    east: float  # [m]
    north: float
    heading: float  # of the formation's frame there [rad]
    rate: float  # its rate of turn [rad/s]


STATION_PLACE = row_dtype(StationState)


@compiled
def _stations(
    leader: Floats,
    speed: Floats,
    heading: Floats,
    stations: Records,
    formations: Records,
    dt: float,
) -> Records:
    """See `stations_along`."""
    n = leader.shape[0]
    f = stations.shape[0]
    out = np.empty((n, f), STATION_PLACE)
    trail = np.empty(n, TRAIL)
    count = np.zeros(1, dtype=np.int64)
    states = np.zeros(f, FRAME_STATE)
    for i in range(f):
        states[i].heading = heading[0]
    for k in range(n):
        time = k * dt
        extend(trail, count, leader[k, 0], leader[k, 1], time, (speed[k], heading[k]))
        for i in range(f):
            known_trail = trail, count[0]
            if k > 0:
                turn_frame(
                    formations[i], stations[i], known_trail, (time - dt, time), dt, states[i]
                )
            target = station_at(stations[i], known_trail, time, states[i])
            out[k, i].east, out[k, i].north = target.east, target.north
            out[k, i].heading = states[i].heading
            out[k, i].rate = states[i].rate
    return out


def stations_along(
    leader: Floats,
    speed: Floats,
    heading: Floats,
    stations: Records,
    formations: Records,
    dt: float,
) -> Records:
    """Where stations are if the leader goes along a way: records of STATION_PLACE, shape (n, f).

    `leader` is its east and north at n instants dt [s] apart, shape (n, 2), [m], with its speed
    through the water [m/s] and heading [rad], shape (n,). `stations` are records of STATION and
    `formations` the settings of `[formation]` for each, shape (f,).
    """
    leader, speed, heading = (np.ascontiguousarray(values) for values in (leader, speed, heading))
    return _stations(leader, speed, heading, stations, formations, dt).view(np.recarray)


def _limits(motion: MotionSettings, follower: Follower) -> HullLimits | None:
    """What the hull of a follower can do; None for the project's own, which keeps all stations."""
    return limits_of(hull_of(motion, follower)) if follower.model and follower.station else None


# the lookahead of an approach, over the least radius of a hull: a line of sight that bends no more
_LOOKAHEAD_RADII = 0.5
# outer stations are turned no faster than with this share of the top speed of a hull
_SPEED_RESERVE = 0.9


def formations_of(motion: MotionSettings) -> Records:
    """Settings of `[formation]` within what each follower's hull can do, records of shape (f,)."""
    settings = motion.formation.record()
    followers = motion.plan.followers
    formations = np.array([settings] * len(followers)).view(np.recarray)
    for f, follower in zip(formations, followers, strict=True):
        limits = _limits(motion, follower)
        if limits is None:
            continue
        f.lookahead = max(f.lookahead, _LOOKAHEAD_RADII * limits.least_radius)
        for speed in ("min_along_track_speed", "min_speed", "timeout_speed", "inner_min_speed"):
            f[speed] = max(f[speed], limits.least_speed)
        f.max_speed = max(min(f.max_speed, limits.top_speed), f.min_speed)
        f.outer_max_speed = min(f.outer_max_speed, _SPEED_RESERVE * limits.top_speed)
    return formations


def stations_of(motion: MotionSettings) -> Records:
    """Stations of all followers, records of STATION, shape (f,); one without has that of the
    leader itself.
    """
    followers = motion.plan.followers
    stations = records(STATION, len(followers))
    for station, follower in zip(stations, followers, strict=True):
        if follower.station is None:
            continue
        station.behind = follower.station.behind_m
        station.port = follower.station.port_m
        station.depth = follower.station.depth_m
        limits = _limits(motion, follower)
        station.planned_radius = 0.0 if limits is None else limits.least_radius
    return stations


def true_stations(motion: MotionSettings, trajectory: Trajectory) -> Records:
    """Where each follower's station, else the leader, truly was: records of STATION_PLACE, shape
    (n, f).
    """
    leader = trajectory.position[:, 0, :2]
    speed = trajectory.forward_speed[:, 0]
    return stations_along(
        leader,
        speed,
        trajectory.heading[:, 0],
        stations_of(motion),
        formations_of(motion),
        trajectory.dt,
    )


@dataclass(frozen=True, kw_only=True)
class StationKeeping:
    """How one follower kept its station, since it joined it."""

    # when first within 2 m of its station [s]; NaN: never, and the others are of all the time
    joined_s: float
    # horizontal distance of its hydrophone from the station, root mean square [m]
    station_rms_m: float
    station_p95_m: float  # distance from the station that it exceeds for 5 % of the time [m]
    station_max_m: float  # largest distance from the station [m]
    lost: bool  # whether it was ever more than 10 m off its station, or never joined


def off_station(
    motion: MotionSettings, trajectory: Trajectory, stations: Records | None = None
) -> Floats:
    """Horizontal distance of hydrophones from stations, by default `true_stations`, shape (n,
    f), [m]; NaN: none.
    """
    followers = motion.plan.followers
    errors = np.full((trajectory.time.size, len(followers)), np.nan)
    with_station = [i for i, follower in enumerate(followers) if follower.station]
    if not with_station:
        # a first flight along routes need not compile what finds stations
        return errors
    places = true_stations(motion, trajectory) if stations is None else stations
    for i in with_station:
        hydrophone = trajectory.site_path(f"{followers[i].name}/hydrophone")[:, :2]
        errors[:, i] = np.hypot(
            hydrophone[:, 0] - places.east[:, i], hydrophone[:, 1] - places.north[:, i]
        )
    return errors


def track_errors(
    motion: MotionSettings, trajectory: Trajectory, stations: Records | None = None
) -> Floats:
    """Horizontal distance of followers from stations, or from where routes have them, shape (n,
    f), [m].
    """
    errors = off_station(motion, trajectory, stations)
    routes = routes_of(motion.plan)
    for i, follower in enumerate(motion.plan.followers):
        if follower.station is None:
            errors[:, i] = track_error(
                routes[i + 1], trajectory.time, trajectory.position[:, i + 1, :2]
            )
    return errors


def station_keeping(errors: Floats, time: Floats) -> StationKeeping:
    """Figures of one follower; both arguments of shape (n,), distances from its station [m] at
    times [s].
    """
    is_joined = errors < JOINED_M
    joined = int(np.argmax(is_joined)) if is_joined.any() else None
    counted = errors[joined or 0 :]
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


def _nearest(
    names: Sequence[str], time: Floats, places: Floats, pairs: Bools | None = None
) -> Approach | None:
    """The pair that came nearest at places of shape (n, v, 2 or 3), of all or of some, shape (v,
    v); None: of none.
    """
    distances = pair_distances(places)
    if pairs is not None:
        distances = PairDistances(*(np.where(pairs, values, np.inf) for values in distances))
    smallest = distances.seen.min()
    if smallest == np.inf:
        return None
    nearest = None
    for i, j in _pairs_within(distances, smallest):
        offsets = places[:, i] - places[:, j]
        distance = np.sqrt(sum(component * component for component in offsets.T))
        k = int(distance.argmin())
        if nearest is None or distance[k] < nearest.distance_m:
            nearest = Approach(float(distance[k]), (names[j], names[i]), float(time[k]))
    return nearest


def _in_one_layer(depth: Floats) -> Bools:
    """Which pairs of vehicles at depths, shape (v,), [m], are too near in depth to pass one above
    the other, shape (v, v); also each with itself.
    """
    return np.abs(depth[:, None] - depth) < MIN_LAYER_SPACING_M


def closest_approaches(trajectory: Trajectory) -> tuple[Approach, Approach]:
    """The pair that came nearest in in_space, and the one that came nearest horizontally, whatever
    their depths.
    """
    names = trajectory.names
    time = trajectory.time
    position = trajectory.position
    in_space = _nearest(names, time, position)
    horizontal = _nearest(names, time, position[..., :2])
    assert in_space is not None and horizontal is not None  # noqa: PT018
    return in_space, horizontal


def closest_in_a_layer(plan: MissionPlan, trajectory: Trajectory) -> Approach | None:
    """The pair of one layer that came nearest horizontally; None if no layer has two vehicles."""
    depths = np.array([vehicle.held_depth_m for _, vehicle in plan.vehicles()])
    return _nearest(
        trajectory.names, trajectory.time, trajectory.position[..., :2], _in_one_layer(depths)
    )


_STEP_S = 0.5  # stations are followed in steps of this time [s]; they move by half a metre in it


def closest_stations(motion: MotionSettings) -> Approach | None:
    """The stations of one layer, the leader's place included, that come nearest along its plan;
    None: none do.
    """
    plan = motion.plan
    stationed = [
        (f"followers[{i}].station", f.station) for i, f in enumerate(plan.followers) if f.station
    ]
    places = np.array(
        [
            (0.0, 0.0, plan.leader.held_depth_m),
            *((s.behind_m, s.port_m, s.depth_m) for _, s in stationed),
        ]
    )
    pairs = _in_one_layer(places[:, 2])
    if np.count_nonzero(pairs) == len(places):
        return None
    time = np.arange(0.0, plan.duration_s + _STEP_S, _STEP_S)
    leader = planned_motion(route_of(plan.leader, "leader")).at(time)
    depth = plan.leader.held_depth_m
    drift = current_at(motion.sea, leader.east, leader.north, depth, time)
    speed_through_water = np.hypot(
        *(leader.speed * np.array([np.sin(leader.course), np.cos(leader.course)]) - drift.T)
    )
    stations = records(STATION, len(places))
    stations.behind, stations.port, stations.depth = places.T
    kept_by = [i for i, follower in enumerate(plan.followers) if follower.station]
    stations.planned_radius[1:] = stations_of(motion).planned_radius[kept_by]
    settings = [motion.formation.record(), *formations_of(motion)[kept_by]]
    formations = np.array(settings).view(np.recarray)
    way = np.column_stack([leader.east, leader.north])
    positions = stations_along(
        way, speed_through_water, leader.course, stations, formations, _STEP_S
    )
    names = ["the leader's place", *(key for key, _ in stationed)]
    return _nearest(names, time, np.stack([positions.east, positions.north], axis=-1), pairs)
