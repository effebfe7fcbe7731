"""The data of a scene from a replay on a measured log: estimates, the leader as it broadcast itself
or fixed transmitters, and a surveyed path as the truth if the log has one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.estimates import Estimates
from laisn.messages import LeaderMessage, Measurements
from reports.scene.codec import Packer
from reports.scene.mission import (
    COARSE,
    CROWD,
    FINE,
    REFUSED,
    SLOW_HZ,
    Scene,
    SceneVehicle,
    add_messages,
    add_spread,
    fix_words,
    held,
    hues,
    hulls_of,
    rate_of,
    smooth_quaternions,
)
from sim import attitude

_MAX_BEACONS = 24  # more different places are those of transmitters that move
_SHOWN_DEPTH_M = 5.0  # of a vehicle whose log has no depth
_BELOW_M = 8.0  # from the deepest of all to a floor that no log knows


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A vehicle of a measured log, and what its navigator made of it."""

    name: str
    measurements: Measurements
    time: Floats  # when each filter step ends, shape (n,), [s]
    estimates: Estimates
    baseline: float = np.nan  # from the leader's rear to its front transmitter [m]
    path: Floats | None = None  # surveyed: time [s], east, north [m], shape (t, 3)

    @property
    def begin_s(self) -> float:
        """When the first filter step begins."""
        return float(self.time[0] - self.measurements.time[0])


def _between(times: Floats, values: Floats, grid: Floats) -> Floats:
    """Values over time, shape (n, c), at other times, constant beyond their ends."""
    return np.column_stack([np.interp(grid, times, column) for column in held(values).T])


def _columns(measurements: Measurements, *fields: str) -> Floats:
    """Quantities of all messages, shape (m, c)."""
    return measurements.message[:, [LeaderMessage._fields.index(field) for field in fields]]


def _heading(times: Floats, heading: Floats, grid: Floats) -> Floats:
    return np.interp(grid, times, np.unwrap(held(heading[:, None])[:, 0]))


def _level(heading: Floats) -> Floats:
    """Attitudes of level vehicles, shape (n, 4)."""
    return attitude.from_euler(heading, np.zeros_like(heading), np.zeros_like(heading))


def _depth(vehicle: Measured, grid: Floats) -> Floats:
    depth = np.nan_to_num(vehicle.measurements.last_depth)
    if not depth.any():
        return np.full(grid.size, _SHOWN_DEPTH_M)
    return np.interp(grid, vehicle.time, depth)


def beacons_of(vehicles: Sequence[Measured]) -> Floats:
    """Places of fixed transmitters (east, north, up) that messages name, shape (b, 3), [m]; none
    where transmitters move.
    """
    rows = [
        v.measurements.transmitters for v in vehicles if v.measurements.transmitters is not None
    ]
    if not rows:
        return np.empty((0, 3))
    places = np.concatenate([row.reshape(-1, 3) for row in rows])
    places = np.unique(places[np.isfinite(places).all(axis=1)].round(2), axis=0)
    if len(places) > _MAX_BEACONS:
        return np.empty((0, 3))
    if not places[:, 2].any():
        places[:, 2] = _SHOWN_DEPTH_M
    return places * [1.0, 1.0, -1.0]


def _sources(measurements: Measurements, beacons: Floats) -> Floats:
    """Which beacon each range of each message is of, its row counted from 1, shape (m, 3); 0: of
    none.
    """
    places = measurements.transmitters
    sources = np.zeros((measurements.message_step.size, 3))
    if places is None:
        return sources
    for number, (east, north, _) in enumerate(beacons.tolist(), start=1):
        is_same = np.hypot(places[..., 0] - east, places[..., 1] - north) < 0.02
        sources[is_same] = number
    return sources


def _known_from(vehicle: Measured) -> float:
    """When the first estimate is there [s]."""
    time = vehicle.time
    return float(time[min(vehicle.estimates.steps_without_estimate, time.size - 1)])


class _Rows(NamedTuple):
    """The instants at which a scene has rows: those of positions and attitudes, and fewer for what
    changes slowly.
    """

    start: float  # [s]
    end: float  # [s]
    hz: float  # rows in a second
    slow_hz: float
    grid: Floats  # times of the rows, shape (n,), [s]
    slow: Floats  # times of the slow rows, shape (m,), [s]


def _rows_of(vehicles: Sequence[Measured]) -> _Rows:
    """Rows of a replay, as many in a second as its length and its vehicles allow."""
    start = min(float(vehicle.time[0]) for vehicle in vehicles)
    end = max(float(vehicle.time[-1]) for vehicle in vehicles)
    hz = rate_of(end - start, len(vehicles) + 1)
    slow_hz = min(SLOW_HZ, hz)
    return _Rows(
        start=start,
        end=end,
        hz=hz,
        slow_hz=slow_hz,
        grid=start + np.arange(int((end - start) * hz) + 2) / hz,
        slow=start + np.arange(int((end - start) * slow_hz) + 2) / slow_hz,
    )


class _Way(NamedTuple):
    """What a scene shows of the motion of one vehicle."""

    vehicle: SceneVehicle
    position: Floats  # at each row, shape (n, 3), [m]
    quaternion: Floats  # shape (n, 4)
    speed: Floats  # at each slow row, shape (m,), [m/s]


def _way_of_leader(vehicles: Sequence[Measured], rows: _Rows) -> _Way | None:
    """The leader by the messages of the first vehicle that hold where it is; None if none do."""
    for vehicle in vehicles:
        pose_columns = _columns(vehicle.measurements, "east", "north", "heading", "depth")
        if pose_columns.size == 0 or not np.isfinite(pose_columns[:, :2]).all(axis=1).any():
            continue
        times = vehicle.time[vehicle.measurements.message_step - 1]
        east_north = _between(times, pose_columns[:, :2], rows.grid)
        depth = np.interp(rows.grid, times, np.nan_to_num(pose_columns[:, 3], nan=_SHOWN_DEPTH_M))
        half_baseline = 0.5 * vehicle.baseline
        transmitters = (
            [[-half_baseline, 0.0, 0.0], [half_baseline, 0.0, 0.0]]
            if np.isfinite(half_baseline)
            else []
        )
        leader = SceneVehicle(name="leader", role="leader", model=0, transmitters=transmitters)
        return _Way(
            leader,
            np.column_stack([east_north, -depth]),
            _level(_heading(times, pose_columns[:, 2], rows.grid)),
            _between(times, _columns(vehicle.measurements, "speed"), rows.slow)[:, 0],
        )
    return None


def _way_of_follower(
    vehicle: Measured, model: int, rows: _Rows, estimated: Floats, *, has_truth: bool
) -> _Way:
    """A follower on its true path, where that is known of all, or else on its estimated one, east
    and north at each row, shape (n, 2), [m]; `model` is the index of its hull.
    """
    path = estimated
    if has_truth and vehicle.path is not None:
        path = _between(vehicle.path[:, 0], vehicle.path[:, 1:3], rows.grid)
    return _Way(
        SceneVehicle(name=vehicle.name, role="follower", model=model),
        np.column_stack([path, -_depth(vehicle, rows.grid)]),
        _level(_heading(vehicle.time, vehicle.measurements.heading, rows.grid)),
        np.interp(rows.slow, vehicle.time, np.nan_to_num(vehicle.measurements.speed)),
    )


def _pack(
    packer: Packer, vehicles: Sequence[Measured], ways: Sequence[_Way], rows: _Rows, states: Floats
) -> None:
    """Add what moves, and estimates, shape (n, f, 2), with their covariances."""
    units = FINE if len(vehicles) <= CROWD else COARSE
    quaternion = np.stack([way.quaternion for way in ways], axis=1)
    packer.add("position", np.stack([way.position for way in ways], axis=1), units.position)
    packer.add("quaternion", smooth_quaternions(quaternion), units.quaternion)
    packer.add("speed", np.stack([way.speed for way in ways], axis=1), 0.01, 1)
    packer.add("estimate", states, units.estimate, 1)
    spread = []
    for vehicle in vehicles:
        time = vehicle.time
        row = np.searchsorted(time, rows.slow).clip(0, time.size - 1)
        spread.append(vehicle.estimates.covariance[row, :2, :2])
    add_spread(packer, np.stack(spread, axis=1), units.spread)


def scene_of_measured(name: str, vehicles: Sequence[Measured]) -> Scene:
    """The scene of a replay."""
    rows = _rows_of(vehicles)
    has_truth = all(vehicle.path is not None for vehicle in vehicles)
    beacons = beacons_of(vehicles)
    hulls, hull_of, _ = hulls_of(["leader", "follower"])
    states = [
        _between(vehicle.time, vehicle.estimates.state[:, :2], rows.grid) for vehicle in vehicles
    ]
    leader = None if len(beacons) else _way_of_leader(vehicles, rows)
    ways = [] if leader is None else [leader]
    ways += [
        _way_of_follower(vehicle, hull_of[1], rows, state, has_truth=has_truth)
        for vehicle, state in zip(vehicles, states, strict=True)
    ]
    packer = Packer()
    _pack(packer, vehicles, ways, rows, np.stack(states, axis=1))
    refused: list[list[Any]] = []
    for f, vehicle in enumerate(vehicles):
        refused += add_messages(packer, f, vehicle.measurements, vehicle.estimates, vehicle.begin_s)
        if len(beacons):
            packer.add(f"source{f}", _sources(vehicle.measurements, beacons), order=0)
    heights = np.concatenate([*(way.position[:, 2] for way in ways), beacons[:, 2]])
    received = [np.isfinite(vehicle.measurements.ranges).any(axis=0) for vehicle in vehicles]
    # as of `meta_of`
    meta = {
        "name": name,
        "hz": rows.hz,
        "slow_hz": rows.slow_hz,
        "start": rows.start,
        "end": rows.end,
        "truth": has_truth,
        "floor": float(heights.min()) - _BELOW_M,
        "hues": hues(),
        "vehicles": [vars(way.vehicle) for way in ways],
        "models": hulls,
        "columns": 0,
        "beacons": beacons.tolist(),
        "used": int(np.max(np.flatnonzero(np.any(received, axis=0)), initial=0)) + 1,
        "known": [_known_from(vehicle) for vehicle in vehicles],
        "words": fix_words(),
        "refusedKinds": [int(kind) for kind in REFUSED],
        "events": [],
        "messagesRefused": sorted(refused),
        "locks": [],
        "opening": rows.start + (rows.end - rows.start) / 3,
        "follow": len(ways) - 1 if len(vehicles) == 1 else -1,
        "arrays": packer.table(),
    }
    return Scene(meta=meta, data=packer.text())
