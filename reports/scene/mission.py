"""The data of a scene from a flight: everything at a few rows a second, as `src/mission.js` reads
it.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Bools, Floats, Ints
from laisn.estimates import FIX_WORDS, Estimates, FixKind
from laisn.messages import Measurements, Ranges
from reports.scene.codec import Packer
from reports.scene.hulls import hull
from sim.film import film_data
from sim.flight import FlightRecord, position_and_bearing_errors
from sim.log.writer import Event
from sim.scenario.parts import MissionPlan, MotionSettings, SeaSettings
from sim.tracking import true_stations
from sim.water.assembly import floor_of
from sim.water.floors import LevelFloor
from sim.water.region import region_of

CROWD = 12
"""More followers than these have numbers rounded more coarsely, as the page would be too large."""
_RATES_HZ = (5.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01)
_MAX_POSES = 110_000  # rows times vehicles of a page
SLOW_HZ = 1.0  # ellipses, stations and speeds, which change slowly
_MIN_WEIGHT = 0.01  # hypotheses of less weight are not shown
_TURN_DEG = 25.0  # least change of the leader's heading within `_TURN_S` that is a turn
_STRAIGHT_DEG = 8.0  # change of heading at which a turn begins
_TURN_S = 20  # also a number of rows of headings, one a second
_INTO_TURN_S = 12.0  # from the beginning of a formation's turn to what its page opens with
_SEABED_MARGIN_M = 250.0  # of the floor about the routes
_SEABED_POINTS = 64  # along each side
_SEABED_UNIT_M = 0.05
REFUSED = (FixKind.GATED, FixKind.LOST)  # kinds of fix that a filter does not use


@dataclass(frozen=True, kw_only=True)
class Units:
    """Steps to which numbers are rounded."""

    position: float = 0.001  # [m]
    estimate: float = 0.001  # [m]
    quaternion: float = 1 / 8192
    spread: float = 0.001  # half axes of 1σ ellipses [m]


FINE = Units()
COARSE = Units(position=0.005, estimate=0.01, quaternion=1 / 1024, spread=0.01)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A mission, ready to be put into a page."""

    meta: dict[str, Any]
    data: str  # arrays, deflated, in base64
    waves: bool = False  # whether the simulated sea has waves, which the scene does not show

    @property
    def json(self) -> str:
        """The rest: names, hulls, events and layouts of the arrays."""
        text = json.dumps(self.meta, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        return text.replace("<", "\\u003c")


@dataclass(frozen=True, kw_only=True)
class SceneVehicle:
    """A vehicle of a scene."""

    name: str
    role: str  # leader or follower
    model: int  # index of its hull
    # offsets of the devices in the hull's frame [m]
    hydrophone: list[float] | None = None
    transmitters: list[list[float]] = field(default_factory=list)
    station: float | None = None
    """Height of its station, negative below the surface [m]; None: it has none."""


def rate_of(duration: float, vehicles: int) -> float:
    """Rows a second of a mission of a duration [s]: as many as a page of usual size holds."""
    return next((hz for hz in _RATES_HZ if duration * hz * vehicles <= _MAX_POSES), _RATES_HZ[-1])


def held(values: Floats) -> Floats:
    """Values over time, shape (n, …), where those that are not finite are the last one before, or
    else the first after them; zeros if there is none.
    """
    table = values.reshape(len(values), -1)
    finite = np.isfinite(table).all(axis=1)
    if not finite.any():
        return np.zeros_like(values)
    last = np.maximum.accumulate(np.where(finite, np.arange(len(table)), -1))
    return values[np.where(last < 0, int(np.argmax(finite)), last)]


def smooth_quaternions(quaternion: Floats) -> Floats:
    """Quaternions over time, shape (n, v, 4), with signs that do not jump, so that they can be
    interpolated.
    """
    sign = np.sign(np.sum(quaternion[1:] * quaternion[:-1], axis=2))
    signs = np.cumprod(np.where(sign == 0, 1.0, sign), axis=0)
    return np.concatenate([quaternion[:1], quaternion[1:] * signs[..., None]])


def add_spread(packer: Packer, covariance: Floats, unit: float) -> None:
    """Add half axes of 1σ ellipses, and cosine and sine of twice their direction, which do not jump
    where it turns by 180°; covariance shape (n, f, 2, 2), unit [m].
    """
    spread = np.nan_to_num(covariance, posinf=0.0, neginf=0.0)
    xx, xy, yy = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    mean = (xx + yy) / 2
    half_difference = np.hypot((xx - yy) / 2, xy)
    angle = np.arctan2(2 * xy, xx - yy)
    packer.add("major", np.sqrt(np.maximum(mean + half_difference, 0.0)), unit, 1)
    packer.add("minor", np.sqrt(np.maximum(mean - half_difference, 0.0)), unit, 1)
    packer.add("axis", np.stack([np.cos(angle), np.sin(angle)], axis=-1), 0.02, 1)


def kinds_of_messages(measurements: Measurements, estimates: Estimates) -> Ints:
    """The kind of fix of each message, shape (m,); -1 for none."""
    fix_index = np.searchsorted(estimates.fix_step, measurements.message_step, side="right") - 1
    kinds = np.full(measurements.message_step.size, -1)
    if estimates.fix_step.size:
        is_same = (fix_index >= 0) & (estimates.fix_step[fix_index] == measurements.message_step)
        kinds[is_same] = estimates.fix_kind[fix_index[is_same]]
    return kinds


def add_messages(
    packer: Packer,
    f: int,
    measurements: Measurements,
    estimates: Estimates,
    start: float,
    first: int = 0,
) -> list[list[Any]]:
    """Add times, kinds and ranges of the messages of follower `f` from the `first` on, and
    hypotheses after them; returns those lost or rejected as time, kind and follower.

    `start` is when the measurements begin [s].
    """
    kinds = kinds_of_messages(measurements, estimates)[first:]
    time = start + measurements.time[measurements.message_step[first:] - 1]
    packer.add(f"time{f}", time, 0.01)
    packer.add(f"kind{f}", kinds, order=0)
    packer.add(
        f"range{f}", np.nan_to_num(measurements.ranges[first:]), 0.01, 1
    )  # zero: not received
    branches = _branches(measurements, estimates)
    branches = branches[branches[:, 0] >= first]
    if branches.size:
        packer.add(f"branch{f}", branches, 0.01, 1)
    return [
        [round(float(t), 1), "loss" if kind == FixKind.LOST else "gate", f]
        for t, kind in zip(time.tolist(), kinds.tolist(), strict=True)
        if kind in REFUSED
    ]


def _branches(measurements: Measurements, estimates: Estimates) -> Floats:
    """Hypotheses of the messages after which there were several, shape (h, 7): index of the
    message, weight, place (east, north) [m], half axes [m] and direction of the 1σ ellipse, from
    east to north [rad].
    """
    weight, position, covariance = estimates.hypotheses
    ambiguous = np.flatnonzero(np.count_nonzero(weight > _MIN_WEIGHT, axis=1) > 1)
    message = np.searchsorted(measurements.message_step, estimates.fix_step[ambiguous])
    rows = []
    for index, fix in zip(message.tolist(), ambiguous.tolist(), strict=True):
        for h in np.flatnonzero(weight[fix] > _MIN_WEIGHT).tolist():
            (xx, xy), (_, yy) = covariance[fix, h].tolist()
            mean = (xx + yy) / 2
            half_difference = float(np.hypot((xx - yy) / 2, xy))
            axes = (
                max(mean + half_difference, 0.0) ** 0.5,
                max(mean - half_difference, 0.0) ** 0.5,
            )
            angle = 0.5 * float(np.arctan2(2 * xy, xx - yy))
            rows.append([index, weight[fix, h], *position[fix, h], *axes, angle])
    return np.array(rows, dtype=np.float64).reshape(-1, 7)


class SceneHulls(NamedTuple):
    """Hulls of vehicles."""

    shapes: list[dict[str, Any]]  # of different models, as of `hull`
    index_of_vehicle: list[int]  # the index of each vehicle's
    effectors: list[int]  # indices of those that move a fin or propeller of any hull


def hulls_of(models: Sequence[str]) -> SceneHulls:
    """Hulls of vehicles' models."""
    names = list(dict.fromkeys(models))
    hulls = [hull(name) for name in names]
    moving = [
        piece
        for hull_pieces in hulls
        for piece in (*hull_pieces["fins"], *hull_pieces["propellers"])
    ]
    effectors = sorted({piece["effector"] for piece in moving})
    for piece in moving:
        piece["column"] = effectors.index(piece["effector"])
    return SceneHulls(hulls, [names.index(model) for model in models], effectors)


def _vehicles(flight: FlightRecord, hull_of_vehicle: Sequence[int]) -> list[SceneVehicle]:
    truth = flight.trajectory
    vehicles = []
    for v, name in enumerate(truth.names):
        sites = {
            site.rpartition("/")[2]: [
                round(value, 4) for value in truth.site_offset[truth.site(site)].tolist()
            ]
            for site in truth.site_names
            if site.startswith(f"{name}/")
        }
        station = flight.scenario.followers[v - 1].station if v else None
        transmitters = [f"tx_{transmitter}" for transmitter in Ranges._fields]
        vehicles.append(
            SceneVehicle(
                name=name,
                role="follower" if v else "leader",
                model=hull_of_vehicle[v],
                hydrophone=sites.get("hydrophone"),
                transmitters=[sites[name] for name in transmitters if name in sites],
                station=-station.depth_m if station else None,
            )
        )
    return vehicles


def turns(flight: FlightRecord) -> list[tuple[float, float]]:
    """When the leader begins to turn, and its heading afterwards, [s] and [°]."""
    truth = flight.trajectory
    # once a second
    heading = np.unwrap(truth.heading[:: max(1, round(1 / truth.dt)), 0])
    if heading.size <= _TURN_S:
        return []
    change = np.abs(heading[_TURN_S:] - heading[:-_TURN_S])
    turning = np.diff((change > np.radians(_TURN_DEG)).astype(int), prepend=0) == 1
    begins = []
    for k in np.flatnonzero(turning).tolist():
        # from the end of these seconds back, until the heading is as before the turn
        departure = np.abs(heading[k + _TURN_S : k : -1] - heading[k])
        begin = k + _TURN_S - int(np.argmax(departure < np.radians(_STRAIGHT_DEG)))
        after = heading[min(k + 2 * _TURN_S, heading.size - 1)]
        begins.append((float(truth.time[0]) + begin, float(np.degrees(after)) % 360.0))
    return begins


def _events(flight: FlightRecord, others: Sequence[Event]) -> list[list[Any]]:
    """Turns and what else happened: time, kind and words."""
    events: list[list[Any]] = [
        [round(t, 1), "turn", f"the leader turns to {heading:03.0f}°"]
        for t, heading in turns(flight)
    ]
    for event in others:
        kind = "mirror" if event.text.startswith("mirror lock") else "note"
        events.append([round(event.time_s, 1), kind, f"{event.source}: {event.text}"])
    return sorted(events)


def _locks(flight: FlightRecord, mirror_locked: Sequence[Bools]) -> list[list[float]]:
    """Stretches of mirror locks: follower, beginning and end [s]."""
    time = flight.trajectory.time[flight.step_index()]
    locks = []
    for f, locked in enumerate(mirror_locked):
        edges = np.flatnonzero(np.diff(locked.astype(int), prepend=0, append=0)).tolist()
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            last = min(end, time.size - 1)
            locks.append([f, round(float(time[begin]), 1), round(float(time[last]), 1)])
    return locks


def _opening(flight: FlightRecord) -> float:
    """The time that the page opens with [s]: of a lone follower's largest error, or of a formation
    in its first turn.
    """
    time = flight.trajectory.time
    errors = position_and_bearing_errors(flight)
    if len(errors) == 1:
        error = np.nan_to_num(errors[0][0])
        return float(time[flight.step_index()[int(np.argmax(error))]])
    leader_turns = turns(flight)
    if leader_turns:
        return min(leader_turns[0][0] + _INTO_TURN_S, float(time[-1]))
    return float(time[0] + (time[-1] - time[0]) / 3)


def hues() -> dict[str, list[float]]:
    """Colours of the film."""
    colours = {
        "leader": film_data.LEADER,
        "truth": film_data.TRUTH,
        "estimate": film_data.ESTIMATE,
        "station": film_data.STATION,
    }
    return {name: list(colour) for name, colour in colours.items()}


def fix_words() -> dict[int, str]:
    return {int(kind): words for kind, words in FIX_WORDS.items()}


@dataclass(frozen=True, kw_only=True)
class SentCounts:
    """How much of a mission a page holds already."""

    rows: int = 0
    slow_rows: int = 0
    messages: tuple[int, ...] = ()  # of each follower; empty: none of any


@dataclass(frozen=True, kw_only=True)
class SceneUpdate:
    """What a page does not hold yet of a mission, packed."""

    packer: Packer
    refused: list[list[Any]]  # messages lost or rejected: time, kind and follower
    sent: SentCounts  # with this part


def _stride(hz: float, dt: float) -> int:
    """Points of a trajectory from one row to the next."""
    return max(1, round(1 / (hz * dt)))


def part_of(
    flight: FlightRecord, hulls: SceneHulls, duration: float, sent: SentCounts
) -> SceneUpdate:
    """Rows and messages of a flight that a page does not hold to which `sent` were sent, at the
    rates of a mission of a duration [s].
    """
    truth = flight.trajectory
    followers = range(len(flight.estimates))
    start = float(truth.time[0])
    hz = rate_of(duration, len(truth.names))
    units = FINE if len(followers) <= CROWD else COARSE
    grid = np.arange(0, truth.time.size, _stride(hz, truth.dt))
    slow = np.arange(0, truth.time.size, _stride(min(SLOW_HZ, hz), truth.dt))
    first_row = sent.rows
    first_slow = sent.slow_rows
    packer = Packer()
    seabed = None if first_row else seabed_of(flight)
    if seabed is not None:
        packer.add("seabed", seabed.height, _SEABED_UNIT_M, 1)
    packer.add("position", truth.position[grid[first_row:]], units.position)
    quaternion = smooth_quaternions(truth.quaternion[grid])[first_row:]
    packer.add("quaternion", quaternion, units.quaternion)
    packer.add("speed", truth.forward_speed[slow[first_slow:]], 0.01, 1)
    # the state of step k, at point k × stride of the trajectory, stands in row k − 1
    rows, slow_rows = (np.clip(index // flight.stride - 1, 0, None) for index in (grid, slow))
    states = [held(e.state[:, :2])[rows[first_row:]] for e in flight.estimates]
    packer.add("estimate", np.stack(states, axis=1), units.estimate, 1)
    spread = np.stack(
        [e.covariance[slow_rows[first_slow:], :2, :2] for e in flight.estimates], axis=1
    )
    add_spread(packer, spread, units.spread)
    refused = list[list[Any]]()
    first = sent.messages or (0,) * len(followers)
    for f in followers:
        refused += add_messages(
            packer, f, flight.measurements[f], flight.estimates[f], start, first[f]
        )
    if any(follower.station for follower in flight.scenario.followers):
        places = true_stations(MotionSettings.of(flight.scenario), truth)
        station = np.stack([places.east[slow], places.north[slow]], axis=-1)[first_slow:]
        packer.add("station", np.nan_to_num(station), 0.01)
    if hulls.effectors and truth.effector_states.shape[2]:
        # of all kinds: thrust [N], of a propeller [1/s], of a fin [rad]
        of_parts = truth.effector_states[grid[first_row:]][:, :, hulls.effectors]
        packer.add("effector", of_parts, 0.01, 1)
    messages = tuple(measurements.message_step.size for measurements in flight.measurements)
    return SceneUpdate(
        packer=packer,
        refused=refused,
        sent=SentCounts(rows=grid.size, slow_rows=slow.size, messages=messages),
    )


class Seabed(NamedTuple):
    """A floor that is not level, about a mission."""

    layout: dict[str, float]  # bounds [m], and number of points along each side
    height: Floats  # negative below the surface, by north and east, shape (n, n), [m]


def seabed_of(flight: FlightRecord) -> Seabed | None:
    """The floor that a mission has read from a file; None: it is level."""
    floor = floor_of(SeaSettings.of(flight.scenario))
    if isinstance(floor, LevelFloor):
        return None
    area = region_of(MissionPlan.of(flight.scenario), _SEABED_MARGIN_M)
    east = np.linspace(area.west, area.east, _SEABED_POINTS)
    north = np.linspace(area.south, area.north, _SEABED_POINTS)
    height = -floor.depths_at(*np.meshgrid(east, north))
    bounds = {"west": area.west, "south": area.south, "east": area.east, "north": area.north}
    return Seabed({**bounds, "points": _SEABED_POINTS}, height)


def known_from(flight: FlightRecord) -> list[float]:
    """When each follower has its first estimate [s]."""
    start = float(flight.trajectory.time[0])
    return [
        start + (e.steps_without_estimate + 1) * flight.measurements[0].dt for e in flight.estimates
    ]


def meta_of(
    flight: FlightRecord, hulls: SceneHulls, duration: float, update: SceneUpdate
) -> dict[str, Any]:
    """What a page tells beside the arrays of a part, without events."""
    truth = flight.trajectory
    hz = rate_of(duration, len(truth.names))
    return {
        "name": flight.scenario.name,
        "hz": 1 / (truth.dt * _stride(hz, truth.dt)),
        "slow_hz": 1 / (truth.dt * _stride(min(SLOW_HZ, hz), truth.dt)),
        "start": float(truth.time[0]),
        "end": float(truth.time[-1]),
        "truth": True,  # whether vehicles are where they were, rather than where they are estimated
        "floor": -floor_of(SeaSettings.of(flight.scenario)).deepest,
        "seabed": seabed.layout if (seabed := seabed_of(flight)) else None,
        "hues": hues(),
        "vehicles": [vars(vehicle) for vehicle in _vehicles(flight, hulls.index_of_vehicle)],
        "models": hulls.shapes,
        # of the array "effector"
        "columns": len(hulls.effectors) if truth.effector_states.shape[2] else 0,
        "beacons": [],  # places of fixed transmitters (east, north, up) [m]
        "used": max(n.transmitters for _, n in flight.scenario.navigations()),  # transmitters
        "known": known_from(flight),
        "words": fix_words(),
        "refusedKinds": [int(kind) for kind in REFUSED],
        "events": [],
        "messagesRefused": sorted(update.refused),
        "locks": [],
        "opening": float(truth.time[-1]),
        "follow": 1 if len(flight.estimates) == 1 else -1,  # index of a vehicle; -1: all
        "arrays": update.packer.table(),
    }


def events_of(
    flight: FlightRecord, events: Sequence[Event], mirror_locked: Sequence[Bools]
) -> dict[str, Any]:
    """What a page tells of a whole flight: events, mirror locks, and when it opens."""
    return {
        "events": _events(flight, events),
        "locks": _locks(flight, mirror_locked),
        "opening": _opening(flight),
    }


def scene_of(
    flight: FlightRecord, events: Sequence[Event], mirror_locked: Sequence[Bools]
) -> Scene:
    """The scene of a flight with its events, and the filter steps at which each follower's estimate
    was at the mirror image of the truth, shapes (n,).
    """
    time = flight.trajectory.time
    duration = float(time[-1] - time[0])
    hulls = hulls_of(MissionPlan.of(flight.scenario).models)
    update = part_of(flight, hulls, duration, SentCounts())
    meta = meta_of(flight, hulls, duration, update) | events_of(flight, events, mirror_locked)
    waves = flight.scenario.ocean.waves.kind != "none"
    return Scene(meta=meta, data=update.packer.text(), waves=waves)
