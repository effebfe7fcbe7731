"""Feasibility of a scenario whose keys are valid: sea, hulls, routes, stations, date, memory and
time.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from laisn.navigators import NAVIGATORS, find
from laisn.plugins import find_controller, is_plugin_name
from sim.assembly import models_of, ocean_of, on_axis, route_of, routes_of, setups_of, vehicle_names
from sim.cautions import assumption_cautions
from sim.control.autopilot import design, top_speed
from sim.control.stability import least_radius, require_stable, steady_turn
from sim.log.schema import Clock
from sim.scenario.formation import LEAST_APART_M, LEAST_LAYER_M
from sim.scenario.point_motion import TURN_RATE, plan
from sim.scenario.routes import START_SPEED, Route
from sim.scenario.settings import CONTROL_STEP_S, Follower, Scenario, Vehicle, Video
from sim.sensing.sensors import own_sensors
from sim.tracking import HULL_RADIUS_M, closest_stations
from sim.vehicle.effectors import FIN, LEAST_WAY
from sim.vehicle.mjcf import VehicleSetup, spec_of, transmitter_places
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.water import Ocean

# instants times vehicles: two vehicles for a day; a million takes 1.1 GB of memory
MOST_INSTANTS = 2_000_000
MOST_PHYSICS_STEPS = 200_000_000  # physics steps times vehicles, about an hour on one core
MOST_PIXELS = 120_000_000_000  # of a film: 72 minutes at 1280 × 720 and 30 Hz


def film_errors(duration_s: float, video: Video) -> list[str]:
    """Errors of the film: too many pixels."""
    count = max(1, round(duration_s / video.speed_up * video.frame_rate_hz))
    if count * video.width_px * video.height_px <= MOST_PIXELS:
        return []
    most = MOST_PIXELS // (video.width_px * video.height_px)
    return [
        f"video: a film of {duration_s:g} s at speed_up = {video.speed_up:g} and "
        f"{video.frame_rate_hz} Hz has "
        f"{count:.4g} frames, at {video.width_px} × {video.height_px} there may be {most}"
    ]


def _cost(scenario: Scenario) -> list[str]:
    """Missions beyond the limits of memory and time."""
    vehicles = 1 + len(scenario.followers)
    found = []
    instants = scenario.duration_s / CONTROL_STEP_S * vehicles
    if instants > MOST_INSTANTS:
        found.append(
            f"duration_s: {scenario.duration_s:g} s of {vehicles} vehicles would take "
            f"{instants * 1.1e-6:.3g} GB of "
            f"memory; so many vehicles may fly {MOST_INSTANTS * CONTROL_STEP_S / vehicles:.0f} s"
        )
    steps = scenario.duration_s / scenario.timing.physics_step_s * vehicles
    if scenario.motion == "physics" and steps > MOST_PHYSICS_STEPS:
        found.append(
            f"timing.physics_step_s: {scenario.duration_s:g} s of {vehicles} vehicles in steps of "
            f"{scenario.timing.physics_step_s:g} s are {steps:.4g} steps, there may be "
            f"{MOST_PHYSICS_STEPS}"
        )
    return found


def _errors_of(build: Callable[[], object], where: str) -> list[str]:
    try:
        build()
    except np.linalg.LinAlgError:
        return [f"{where}: its mass and added mass have no inverse"]
    except LaisnError as error:
        text = str(error)
        return [text if text.startswith(where) else f"{where}: {text}"]
    return []


def _through_water(scenario: Scenario, route: Route, depth: float) -> tuple[Floats, Ints]:
    """Speeds through water at a depth where the current or the leg changes, shape (2, n), [m/s],
    and legs, (n,).
    """
    over_ground = np.diff(route.waypoint, axis=0) / np.diff(route.time)[:, None]
    changes = [time for time, *_ in scenario.ocean.current_profile if time < route.time[-1]]
    times = np.unique([*route.time, *changes])
    legs = np.searchsorted(route.time, 0.5 * (times[1:] + times[:-1])) - 1
    ends = np.stack(
        [
            over_ground[legs] - scenario.ocean.current_at(depth, end)
            for end in (times[:-1], times[1:])
        ]
    )
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
    found = np.array(
        [_through_water(scenario, route, depth)[0] for depth in (min(depths), max(depths))]
    )
    return float(found.min()), float(found.max())


_OF_HULL = (  # keys of a vehicle, beside its model, on which its stability depends
    "depth_control",
    "trim",
    "cg_offset_x_m",
    "cg_offset_z_m",
    "drag_scale",
    "added_mass_scale",
    "lift_scale",
    "thrust_scale",
)
# in physics steps up to this one the project's own hulls are stable at all speeds [s]
_USUAL_STEP_S = 0.02


def _hull(scenario: Scenario, vehicle: Vehicle) -> tuple[Vehicle, float, float]:
    """What the stability of a vehicle depends on: its hull, the physics step [s] and the density
    of the water.
    """
    model = vehicle.model or ("follower" if isinstance(vehicle, Follower) else "leader")
    hull = Vehicle.model_construct(model=model, **{key: getattr(vehicle, key) for key in _OF_HULL})
    return hull, scenario.timing.physics_step_s, scenario.ocean.density_kg_m3


@lru_cache(maxsize=8)
def _plant(hull: Vehicle, dt: float, density: float) -> tuple[Any, Any]:
    """A vehicle alone in calm water, as a plant named "hull", and its autopilot."""
    setup = VehicleSetup(
        name="hull", model=str(hull.model), position_m=(0.0, 0.0, -10.0), settings=hull
    )
    plant = Plant([setup], Ocean(density_kg_m3=density), dt)
    return plant, design(plant, (hull.depth_control,))


def _speed_errors(scenario: Scenario, vehicle: Vehicle, design: Any) -> list[str]:
    """Speeds that a hull cannot have: more than its thrust, or less than its fins need."""
    lines = []
    top = top_speed(design)
    slowest, fastest = _speeds(scenario, vehicle)
    where = "the slowest leg of its route has"
    if isinstance(vehicle, Follower) and vehicle.station:
        where = "formation.min_along_track_speed_m_s is"
    elif fastest > top:
        lines.append(
            f"its effectors drive it at {top:.2g} m/s at most, the fastest leg of its route has "
            f"{fastest:.3g} through the water"
        )
    if not design["has_heave"] and FIN in design["effectors"]["kind"] and slowest < LEAST_WAY:
        lines.append(
            f"it has no vertical thrusters and cannot hover: its fins need {LEAST_WAY:g} m/s, "
            f"{where} {slowest:.3g} m/s through the water"
        )
    return lines


@lru_cache(maxsize=1024)
def _stability_errors(
    hull: tuple[Vehicle, float, float], fastest: float, orbital: float
) -> list[str]:
    """What `require_stable` reports; a study has many scenarios with the same hulls and speeds."""
    return _errors_of(lambda: require_stable(*_plant(*hull), fastest, orbital), "hull")


def _control_errors(scenario: Scenario, key: str, vehicle: Vehicle) -> list[str]:
    """What the autopilot of a vehicle cannot control."""
    usual = all(
        getattr(vehicle, name) == Vehicle.model_fields[name].default for name in _OF_HULL[1:]
    )
    own = vehicle.model is not None
    waves = scenario.ocean.waves
    if not own and (
        scenario.motion == "kinematic"
        or (usual and scenario.timing.physics_step_s <= _USUAL_STEP_S)
    ):
        return []
    hull = _hull(scenario, vehicle)
    lines = _errors_of(partial(_plant, *hull), "hull")
    if own and not lines:
        lines = _speed_errors(scenario, vehicle, _plant(*hull)[1][0])
    if not lines:
        orbital = 0.0 if waves.kind == "none" else np.pi * waves.height_m / waves.period_s
        lines = _stability_errors(hull, _speeds(scenario, vehicle)[1], float(orbital))
    return [f"{key}{'.model' if own else ''}: {line.removeprefix('hull: ')}" for line in lines]


def _leader_too_fast(scenario: Scenario) -> list[str]:
    fastest = scenario.formation.max_speed_m_s
    depths = {f.layer_m for f in scenario.followers if f.station}
    for depth in sorted(depths):
        ends, legs = _through_water(scenario, route_of(scenario.leader, "leader"), depth)
        speed = ends.max(axis=0)
        k = int(np.argmax(speed))
        if speed[k] > fastest:
            return [
                f"leader: on the way to waypoint {legs[k] + 2} followers at {depth:g} m would need "
                f"{speed[k]:.3g} m/s through the water, formation.max_speed_m_s is {fastest:g} m/s"
            ]
    return []


def _start_overlap(scenario: Scenario) -> list[str]:
    """Vehicles that start too close: followers that join stations, or all of them if contact
    ends the mission.
    """
    joins = [
        isinstance(vehicle, Follower) and vehicle.start_m is not None
        for _, vehicle in scenario.vehicles()
    ]
    if scenario.contact == "mark" and not any(joins):
        return []
    setups = setups_of(scenario, routes_of(scenario))
    keys = [key for key, _ in scenario.vehicles()]
    found = []
    for i, one in enumerate(setups):
        for j, other in enumerate(setups[:i]):
            x, y, z = np.subtract(one.position_m, other.position_m)
            near = (
                (joins[i] or joins[j]) and np.hypot(x, y) < LEAST_APART_M and abs(z) < LEAST_LAYER_M
            )
            if near or (
                scenario.contact == "end" and np.hypot(np.hypot(x, y), z) < 2.0 * HULL_RADIUS_M
            ):
                found.append(
                    f"{keys[j]} and {keys[i]} start {np.hypot(x, y):.2g} m apart in layers "
                    f"{abs(z):.2g} m apart; at "
                    f"least {LEAST_APART_M:g} m or {LEAST_LAYER_M:g} m are needed"
                )
    return found


def _station_conflict(scenario: Scenario) -> list[str]:
    """Stations of one layer that meet where the leader turns, of followers without a sensor to
    give way by.
    """
    near = None if scenario.formation.proximity else closest_stations(scenario)
    if near is None or near.distance_m >= LEAST_APART_M:
        return []
    return [
        f"{' and '.join(near.pair)}, in one layer, come within {near.distance_m:.2g} m of each "
        f"other at {near.time_s:g} s of the leader's route; at least {LEAST_APART_M:g} m are "
        f"needed: give them layers {LEAST_LAYER_M:g} m apart, other places, or formation.proximity "
        "to give way by"
    ]


def _transmitters_off_axis(scenario: Scenario) -> list[str]:
    """Transmitters of an own hull where navigators of closed loops cannot use them."""
    closed = any(follower.station or follower.guided_by_estimate for follower in scenario.followers)
    if scenario.leader.model is None or not closed:
        return []
    spec = spec_of(models_of(scenario)[0])
    places = {name: np.array(spec.site(name).pos) for name in ("tx_rear", "tx_front", "tx_middle")}
    for name, (axis, value) in transmitter_places(scenario.leader).items():
        places[name][axis] = value
    if on_axis(
        np.array(
            [place - (0.0, 0.0, spec.site("depth_sensor").pos[2]) for place in places.values()]
        )
    ):
        return []
    return [
        "leader.model: where followers are on stations or steer by their estimates, tx_rear and "
        "tx_front must be at "
        "(−L/2, 0, 0) and (L/2, 0, 0), tx_middle at (0, H, 0) and depth_sensor at height 0"
    ]


def _wide_turns(scenario: Scenario, vehicle: Vehicle) -> list[str]:
    """A hull that turns more slowly than routes are planned."""
    if vehicle.model is None:
        return []
    plant, designs = _plant(*_hull(scenario, vehicle))
    if least_radius(plant, 0, designs[0]) == 0.0:
        return []
    rate, least = steady_turn(plant, 0, designs[0], START_SPEED)
    return [
        f"it turns at {np.rad2deg(rate):.2g}°/s at most at {START_SPEED:g} m/s, in circles of "
        f"{least:.3g} m; routes are planned with {np.rad2deg(TURN_RATE):g}°/s: it cuts their "
        "corners, or leaves legs that are too short"
    ]


def cautions(scenario: Scenario) -> list[str]:
    """What a flyable scenario has that its navigators or followers cannot cope with, a line
    each.
    """
    found = assumption_cautions(scenario)
    variant = scenario.navigation.variant
    stations = any(follower.station for follower in scenario.followers)
    # how good a navigator of the user's own is, its flight shows
    if stations and not (find(variant).near_bound or is_plugin_name(variant)):
        better = ", ".join(repr(name) for name, one in NAVIGATORS.items() if one.near_bound)
        found.append(
            f"stations are kept by navigator {variant!r}, with errors of metres; {better} keeps "
            "them better"
        )
    turning: dict[str, list[str]] = {}
    for key, vehicle in scenario.vehicles():
        for text in _wide_turns(scenario, vehicle):
            turning.setdefault(text, []).append(key)
    found += [
        f"{' … '.join(dict.fromkeys((keys[0], keys[-1])))}.model: {text}"
        for text, keys in turning.items()
    ]
    return found


def infeasibilities(scenario: Scenario) -> list[str]:
    """Everything that keeps a scenario from being flown, filmed and logged, beyond
    `Scenario.inconsistencies`.
    """
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
        found += (
            _errors_of(partial(find_controller, follower.controller), "")
            if follower.controller
            else []
        )
    for (key, vehicle), name in zip(scenario.vehicles(), vehicle_names(scenario), strict=True):
        role = "follower" if isinstance(vehicle, Follower) else "leader"
        shapes += [
            f"{key}.model: {line}"
            for line in (hull_errors(vehicle.model, role) if vehicle.model else ())
        ]
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
