"""Feasibility of a scenario whose keys are valid: sea, hulls, routes, stations, date, memory and time."""

from collections.abc import Callable
from functools import lru_cache, partial
from itertools import pairwise
from typing import Any

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from laisn.navigators import NAVIGATORS, find
from laisn.plugins import find_controller
from sim.assembly import models_of, ocean_of, on_axis, route_of, routes_of, setups_of, vehicle_names
from sim.control.autopilot import design, top_speed
from sim.control.stability import least_radius, require_stable, steady_turn
from sim.log.schema import Clock
from sim.scenario.formation import LEAST_APART_M, LEAST_LAYER_M
from sim.scenario.point_motion import SPEED_MIN, TURN_RATE, plan
from sim.scenario.routes import START_SPEED, Route
from sim.scenario.settings import CONTROL_STEP_S, Follower, Scenario, Vehicle, Video
from sim.sensing.sensors import own_sensors
from sim.tracking import HULL_RADIUS_M, crossings
from sim.vehicle.effectors import FIN, LEAST_WAY
from sim.vehicle.mjcf import VehicleSetup, spec_of, transmitter_places
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.water import Ocean

MOST_INSTANTS = 2_000_000
"""Most instants times vehicles: two vehicles for a day. A million takes 1.1 GB of memory and 0.45 GB of log."""
MOST_PHYSICS_STEPS = 200_000_000  # most physics steps times vehicles, about an hour on one core
MOST_PIXELS = 120_000_000_000
"""Most pixels of a film: 72 minutes at 1280 × 720 and 30 Hz, which is a day and a half at 30 times its pace."""

_LARGE_SHIFT_M = 1.0  # a diving leader that shifts stations by more than this is worth a warning [m]


def film_errors(duration_s: float, video: Video) -> list[str]:
    """Errors of the film: too many pixels."""
    count = max(1, round(duration_s / video.speed_up * video.frame_rate_hz))
    if count * video.width_px * video.height_px <= MOST_PIXELS:
        return []
    most = MOST_PIXELS // (video.width_px * video.height_px)
    return [
        f"video: a film of {duration_s:g} s at speed_up = {video.speed_up:g} and {video.frame_rate_hz} Hz has "
        f"{count:.4g} frames, at {video.width_px} × {video.height_px} there may be {most}"
    ]


def _cost(scenario: Scenario) -> list[str]:
    """Missions beyond the limits of memory and time."""
    vehicles, found = 1 + len(scenario.followers), []
    instants = scenario.duration_s / CONTROL_STEP_S * vehicles
    if instants > MOST_INSTANTS:
        found.append(
            f"duration_s: {scenario.duration_s:g} s of {vehicles} vehicles would take {instants * 1.1e-6:.3g} GB of "
            f"memory; so many vehicles may fly {MOST_INSTANTS * CONTROL_STEP_S / vehicles:.0f} s"
        )
    steps = scenario.duration_s / scenario.timing.physics_step_s * vehicles
    if scenario.motion == "physics" and steps > MOST_PHYSICS_STEPS:
        found.append(
            f"timing.physics_step_s: {scenario.duration_s:g} s of {vehicles} vehicles in steps of "
            f"{scenario.timing.physics_step_s:g} s are {steps:.4g} steps, there may be {MOST_PHYSICS_STEPS}"
        )
    return found


def _errors_of(build: Callable[[], object], where: str) -> list[str]:
    try:
        build()
    except LaisnError as error:
        text = str(error)
        return [text if text.startswith(where) else f"{where}: {text}"]
    return []


def _through_water(scenario: Scenario, route: Route, depth: float) -> tuple[Floats, Ints]:
    """Speeds through the water that a route requires at a depth, and their legs, shape (n,).

    Speeds are those at both ends of intervals in which the current changes linearly on one leg, shape (2, n), [m/s].
    """
    over_ground = np.diff(route.waypoint, axis=0) / np.diff(route.time)[:, None]
    changes = [time for time, *_ in scenario.ocean.current_profile if time < route.time[-1]]
    times = np.unique([*route.time, *changes])
    legs = np.searchsorted(route.time, 0.5 * (times[1:] + times[:-1])) - 1
    ends = np.stack([over_ground[legs] - scenario.ocean.current_at(depth, end) for end in (times[:-1], times[1:])])
    return np.hypot(ends[..., 0], ends[..., 1]), legs


def _speeds(scenario: Scenario, vehicle: Vehicle) -> tuple[float, float]:
    """Lowest and highest speed through the water of a vehicle on its route or station [m/s]."""
    if isinstance(vehicle, Follower) and vehicle.station:
        return scenario.formation.min_along_track_speed_m_s, scenario.formation.max_speed_m_s
    depths = [depth for _, depth in vehicle.depth_profile] or [
        vehicle.layer_m + side * vehicle.saw_tooth_amplitude_m for side in (-1.0, 1.0)
    ]
    route = route_of(vehicle, "")
    # a current changes linearly with depth
    found = np.array([_through_water(scenario, route, depth)[0] for depth in (min(depths), max(depths))])
    return float(found.min()), float(found.max())


_OF_HULL = (
    "depth_control", "cg_offset_x_m", "cg_offset_z_m", "drag_scale", "added_mass_scale", "lift_scale", "thrust_scale",
)  # fmt: skip
"""Keys of a vehicle, beside its model, on which its stability depends."""
_USUAL_STEP_S = 0.02
"""In physics steps up to this one the project's own hulls are stable at all speeds of scenarios [s]."""


Hull = tuple[str, float, float, tuple[Any, ...]]
"""Model of a vehicle, physics step [s], density of the water [kg/m³] and values of `_OF_HULL`."""


def _hull(scenario: Scenario, vehicle: Vehicle) -> Hull:
    model = vehicle.model or ("follower" if isinstance(vehicle, Follower) else "leader")
    values = tuple(getattr(vehicle, key) for key in _OF_HULL)
    return model, scenario.timing.physics_step_s, scenario.ocean.density_kg_m3, values


@lru_cache(maxsize=8)
def _plant(hull: Hull) -> tuple[Any, Any]:
    """A vehicle alone in calm water, as a plant named "hull", and its autopilot."""
    model, dt, density, values = hull
    settings = Vehicle.model_construct(**dict(zip(_OF_HULL, values, strict=True)))
    setup = VehicleSetup(name="hull", model=model, position_m=(0.0, 0.0, -10.0), settings=settings)
    plant = Plant([setup], Ocean(density_kg_m3=density), dt)
    return plant, design(plant, (settings.depth_control,))


def _speed_errors(scenario: Scenario, vehicle: Vehicle, design: Any) -> list[str]:
    """Speeds that a hull cannot have: more than its thrust, or less than its fins need."""
    lines, top, (slowest, fastest) = [], top_speed(design), _speeds(scenario, vehicle)
    where = "the slowest leg of its route has"
    if isinstance(vehicle, Follower) and vehicle.station:
        where = "formation.min_along_track_speed_m_s is"
    elif fastest > top:
        lines.append(
            f"its effectors drive it at {top:.2g} m/s at most, the fastest leg of its route has {fastest:.3g} through "
            "the water"
        )
    if not design["has_heave"] and FIN in design["effectors"]["kind"] and slowest < LEAST_WAY:
        lines.append(
            f"it has no vertical thrusters and cannot hover: its fins need {LEAST_WAY:g} m/s, {where} "
            f"{slowest:.3g} m/s through the water"
        )
    return lines


@lru_cache(maxsize=1024)
def _stability_error(hull: Hull, fastest: float, orbital: float) -> str:
    """What `require_stable` reports; "": nothing. A study has many scenarios with the same hulls and speeds."""
    try:
        require_stable(*_plant(hull), fastest, orbital)
    except LaisnError as error:
        return str(error)
    return ""


def _control_errors(scenario: Scenario, key: str, vehicle: Vehicle) -> list[str]:
    """What the autopilot of a vehicle cannot control."""
    usual = all(getattr(vehicle, name) == Vehicle.model_fields[name].default for name in _OF_HULL[1:])
    own, waves = vehicle.model is not None, scenario.ocean.waves
    if not own and (scenario.motion == "kinematic" or (usual and scenario.timing.physics_step_s <= _USUAL_STEP_S)):
        return []
    try:
        hull = _hull(scenario, vehicle)
        lines = _speed_errors(scenario, vehicle, _plant(hull)[1][0]) if own else []
        if not lines:
            orbital = 0.0 if waves.kind == "none" else np.pi * waves.height_m / waves.period_s
            text = _stability_error(hull, _speeds(scenario, vehicle)[1], float(orbital))
            lines = [text.removeprefix("hull: ")] if text else []
    except LaisnError as error:
        lines = [str(error).removeprefix("hull: ")]
    except np.linalg.LinAlgError:
        lines = ["its mass and added mass have no inverse"]
    return [f"{key}{'.model' if own else ''}: {line}" for line in lines]


def _leader_too_fast(scenario: Scenario) -> list[str]:
    fastest, depths = scenario.formation.max_speed_m_s, {f.layer_m for f in scenario.followers if f.station}
    for depth in sorted(depths):
        ends, legs = _through_water(scenario, route_of(scenario.leader, "leader"), depth)
        speed = ends.max(axis=0)
        k = int(np.argmax(speed))
        if speed[k] > fastest:
            return [
                f"leader: on the way to waypoint {legs[k] + 2} followers at {depth:g} m would need {speed[k]:.3g} m/s "
                f"through the water, formation.max_speed_m_s is {fastest:g} m/s"
            ]
    return []


def _start_overlap(scenario: Scenario) -> list[str]:
    """Vehicles that start too close: followers that join stations, or all of them if contact ends the mission."""
    joins = [isinstance(vehicle, Follower) and vehicle.start_m is not None for _, vehicle in scenario.vehicles()]
    if scenario.contact == "mark" and not any(joins):
        return []
    setups, keys = setups_of(scenario, routes_of(scenario)), [key for key, _ in scenario.vehicles()]
    found = []
    for i, one in enumerate(setups):
        for j, other in enumerate(setups[:i]):
            x, y, z = np.subtract(one.position_m, other.position_m)
            near = (joins[i] or joins[j]) and np.hypot(x, y) < LEAST_APART_M and abs(z) < LEAST_LAYER_M
            if near or (scenario.contact == "end" and np.hypot(np.hypot(x, y), z) < 2.0 * HULL_RADIUS_M):
                found.append(
                    f"{keys[j]} and {keys[i]} start {np.hypot(x, y):.2g} m apart in layers {abs(z):.2g} m apart; at "
                    f"least {LEAST_APART_M:g} m or {LEAST_LAYER_M:g} m are needed"
                )
    return found


def _station_conflict(scenario: Scenario) -> list[str]:
    """Stations of one layer that meet where the leader turns, of followers that cannot give way."""
    layers = sorted(f.layer_m for f in scenario.followers if f.station)
    alone = all(b - a >= LEAST_LAYER_M for a, b in pairwise(sorted([*layers, scenario.leader.layer_m])))
    if not layers or alone:
        return []
    near = scenario.formation.proximity
    met = [one for one in crossings(scenario, near.range_m if near else 0.0) if one.apart_m < LEAST_APART_M]
    if not met:
        return []
    # the nearest; or the one with the least way to lose for what it takes
    worst = min(met, key=lambda one: one.way_m_s - one.needed_m_s if near else one.apart_m)
    names = ["the leader's place" if i < 0 else f"followers[{i}].station" for i in worst.pair]
    text = (
        f"{' and '.join(names)}, in one layer, come within {worst.apart_m:.2g} m of each other at {worst.time_s:g} s "
        f"of the leader's route"
    )
    elsewhere = f"give them layers {LEAST_LAYER_M:g} m apart, other places"
    if near is None:
        text += f"; at least {LEAST_APART_M:g} m are needed: {elsewhere}, or formation.proximity to give way by"
        return [text]
    text += f" and close up at {worst.closing_m_s:.2g} m/s; "
    reach = LEAST_APART_M + worst.braking_m
    if worst.way_m_s < worst.needed_m_s:
        text += f"to give way takes {worst.needed_m_s:.2g} m/s through the water, one of them has "
        return [f"{text}{worst.way_m_s:.2g}: {elsewhere}, or another course in this current"]
    if near.range_m < reach:
        text += f"to brake in time they have to sense each other {reach:.2g} m away, formation.proximity.range_m is "
        return [f"{text}{near.range_m:g}: {elsewhere}, or a longer range"]
    return []


def transmitter_sites(scenario: Scenario) -> Floats:
    """Rear, front and middle transmitter: forward, port, and up from the leader's depth sensor, shape (3, 3), [m]."""
    spec = spec_of(models_of(scenario)[0])
    places = {name: np.array(spec.site(name).pos) for name in ("tx_rear", "tx_front", "tx_middle")}
    for name, (axis, value) in transmitter_places(scenario.leader).items():
        places[name][axis] = value
    height = float(spec.site("depth_sensor").pos[2])
    return np.array([place - (0.0, 0.0, height) for place in places.values()])


def _transmitters_off_axis(scenario: Scenario) -> list[str]:
    """Transmitters of an own hull where navigators of closed loops cannot use them."""
    closed = any(follower.station or follower.guided_by_estimate for follower in scenario.followers)
    if scenario.leader.model is None or not closed or on_axis(transmitter_sites(scenario)):
        return []
    return [
        "leader.model: where followers are on stations or steer by their estimates, tx_rear and tx_front must be at "
        "(−L/2, 0, 0) and (L/2, 0, 0), tx_middle at (0, H, 0) and depth_sensor at height 0"
    ]


def _shift_in_dives(scenario: Scenario, route: Route) -> float:
    """How far a leader that dives shifts stations at most, whose followers assume it level [m].

    At pitch θ the difference of the ranges to its ends is that of a place Δz sin θ farther along its axis, where Δz is
    the difference of depths.
    """
    time = np.arange(0.0, scenario.duration_s + 1.0)
    depth = route.depth.depth_at(time)
    leg = np.clip(np.searchsorted(route.time, time[:-1], side="right") - 1, 0, route.leg_speed.size - 1)
    sinking = np.abs(np.diff(depth))
    sine = sinking / np.hypot(sinking, np.maximum(route.leg_speed[leg], SPEED_MIN))
    layers = np.array([follower.station.depth_m for follower in scenario.followers if follower.station])
    return float((sine[:, None] * np.abs(layers - depth[1:, None])).max())


def _wide_turns(scenario: Scenario, vehicle: Vehicle) -> list[str]:
    """A hull that turns more slowly than routes are planned."""
    if vehicle.model is None:
        return []
    plant, designs = _plant(_hull(scenario, vehicle))
    route = route_of(vehicle, "") if vehicle.route or vehicle.waypoints else route_of(scenario.leader, "")
    radius = least_radius(plant, 0, designs[0])
    if radius == 0.0:
        return []
    rate, least = steady_turn(plant, 0, designs[0], START_SPEED)
    short = _errors_of(partial(plan, route, radius), "")
    what = "legs of its route are too short for that, and it leaves them" if short else "it cuts corners of its route"
    return [
        f"it turns at {np.rad2deg(rate):.2g}°/s at most at {START_SPEED:g} m/s, in circles of {least:.3g} "
        f"m; routes are planned with {np.rad2deg(TURN_RATE):g}°/s: {what}"
    ]


def cautions(scenario: Scenario) -> list[str]:
    """What a flyable scenario has that its navigators or followers cannot cope with, a line each."""
    found, variant, leader = [], scenario.navigation.variant, scenario.leader
    spec, settings = find(variant), scenario.navigation.settings()
    stations = any(follower.station for follower in scenario.followers)
    if scenario.motion == "physics" and scenario.ocean.moves and "current" not in settings.estimated:
        able = spec.near_bound
        what = "navigation.assume.current = false" if able else f"navigator {variant!r}"
        found.append(f"there is a current; {what} assumes still water")
    if stations and not spec.near_bound:
        better = ", ".join(repr(name) for name, one in NAVIGATORS.items() if one.near_bound)
        found.append(f"stations are kept by navigator {variant!r}, with errors of metres; {better} keeps them better")
    if stations:
        route = route_of(leader, "leader")
        rest = float(np.diff(route.time)[route.leg_length == 0].sum())
        if rest:
            way = rest * scenario.formation.min_along_track_speed_m_s
            found.append(f"the leader stops for {rest:g} s; followers on stations go on, by about {way:.3g} m")
        shift = 0.0 if scenario.navigation.use_attitude else _shift_in_dives(scenario, route)
        if shift > _LARGE_SHIFT_M:
            found.append(
                f"the leader dives and followers do not use its pitch, which shifts stations by up to {shift:.3g} m; "
                "leader.broadcast_attitude and navigation.use_attitude prevent that"
            )
    turning: dict[str, list[str]] = {}
    for key, vehicle in scenario.vehicles():
        for text in _wide_turns(scenario, vehicle):
            turning.setdefault(text, []).append(key)
    found += [f"{' … '.join(dict.fromkeys((keys[0], keys[-1])))}.model: {text}" for text, keys in turning.items()]
    if leader.model is not None:
        own = scenario.model_copy(
            update={"leader": leader.model_copy(update={"baseline_m": None, "middle_offset_m": None})}
        )
        for key, axis, rows in (("baseline_m", 0, [0, 1]), ("middle_offset_m", 1, [2])):
            there, hull = (transmitter_sites(one)[rows, axis] for one in (scenario, own))
            if not np.allclose(there, hull, rtol=0.0, atol=1e-9):
                now, own_place = (", ".join(f"{value:.3g}" for value in place) for place in (there, hull))
                moved = "tx_rear and tx_front to x" if axis == 0 else "tx_middle to y"
                found.append(f"leader.{key} moves {moved} = {now} m; the hull has {own_place} m")
    return found


def infeasibilities(scenario: Scenario) -> list[str]:
    """Everything that keeps a scenario from being flown, filmed and logged, beyond `Scenario.inconsistencies`."""
    shapes: list[str] = []
    found = [
        *_errors_of(partial(Clock, scenario.epoch), "epoch"),
        *film_errors(scenario.duration_s, scenario.video),
        *_errors_of(partial(ocean_of, scenario), "ocean.waves"),
        *_errors_of(scenario.navigation.settings, ""),
        *_errors_of(partial(own_sensors, scenario), ""),
        *_cost(scenario),
    ]
    for follower in scenario.followers:
        found += _errors_of(partial(find_controller, follower.controller), "") if follower.controller else []
    for (key, vehicle), name in zip(scenario.vehicles(), vehicle_names(scenario), strict=True):
        role = "follower" if isinstance(vehicle, Follower) else "leader"
        shapes += [f"{key}.model: {line}" for line in (hull_errors(vehicle.model, role) if vehicle.model else ())]
        if not (isinstance(vehicle, Follower) and vehicle.station):
            where = f"{key}.{'waypoints' if vehicle.waypoints else 'route'}"
            # a saw-tooth that leaves the water is an error of its own
            level = vehicle.model_copy(update={"saw_tooth_amplitude_m": 0.0})
            shapes += _errors_of(partial(lambda *of: plan(route_of(*of)), level, name), where)
    if shapes:
        # what follows depends on hulls and routes
        return [*found, *shapes]
    for key, vehicle in scenario.vehicles():
        found += _control_errors(scenario, key, vehicle)
    return [
        *found,
        *_leader_too_fast(scenario),
        *_start_overlap(scenario),
        *_station_conflict(scenario),
        *_transmitters_off_axis(scenario),
    ]
