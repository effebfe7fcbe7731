"""Feasibility of a scenario whose keys are valid: sea, hulls, routes, stations, date, memory and
time.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.navigators import NAVIGATORS, find
from laisn.plugins import find_controller, is_plugin_name, kept_with_plugins
from sim.assembly import are_at_baseline_and_offset, routes_of, setups_of
from sim.cautions import assumption_cautions, navigated_alike, unheard_links
from sim.control.allocation import HEAVE, PITCH, clip
from sim.control.autopilot import (
    INCIDENCE_MAX,
    SPEED_HEAVE,
    SPEED_PITCH,
    Autopilot,
    can_roll,
    greatest_forces,
)
from sim.control.stability import require_stable
from sim.hull import (
    HULL_KEYS,
    MIN_STATION_SPEED,
    Hull,
    calm_plant,
    hull_of,
    needs_way,
    top_speed_of,
)
from sim.log.schema import Clock
from sim.scenario.formation import MIN_LAYER_SPACING_M, MIN_SEPARATION_M, Formation
from sim.scenario.links import LinkTable
from sim.scenario.parts import (
    MissionPlan,
    MotionSettings,
    SeaSettings,
    SensingSettings,
    sensing_of_each,
)
from sim.scenario.point_motion import Plan
from sim.scenario.point_motion import plan as planned_motion
from sim.scenario.routes import Route
from sim.scenario.section import Idle, Section
from sim.scenario.settings import (
    CONTROL_STEP_S,
    Follower,
    Leader,
    Navigation,
    OceanTable,
    Scenario,
    Vehicle,
    Video,
)
from sim.scenario.vehicle_routes import depth_profile_of, route_of
from sim.sea import require_beacons, require_sea
from sim.sensing.sensors import custom_sensors, leader_custom_sensors, sensors_of_all
from sim.sound_cautions import ray_cautions
from sim.tracking import HULL_RADIUS_M, closest_stations
from sim.vehicle.effector_kinds import MIN_STEERAGE_SPEED
from sim.vehicle.effectors import fins_of
from sim.vehicle.mjcf import SEA_WATER, spec_of, transmitter_places
from sim.vehicle.own_hull import gear_remarks, hull_errors
from sim.vehicle.plant import Plant
from sim.vehicle.solvers import direct_solver_error
from sim.water.assembly import (
    current_at,
    current_of_keys,
    density_of,
    sea_of_keys,
    trim_density,
)

# instants times vehicles: two vehicles for a day, 201 for 1000 s; a million takes 1.1 GB of memory
MAX_INSTANTS = 2_100_000
MAX_PHYSICS_STEPS = 200_000_000  # physics steps times vehicles, about an hour on one core
MAX_PIXELS = 120_000_000_000  # of a film: 72 minutes at 1280 × 720 and 30 Hz
_OF_WATER = {
    "density_kg_m3",
    "density",
    "current_speed_m_s",
    "current_shear_per_s",
    "current_profile",
    "current",
    "waves",
}
"""Keys of a sea on which the paper's point motion does not depend."""


def film_errors(duration_s: float, video: Video) -> list[str]:
    """Errors of the film: too many pixels."""
    count = max(1, round(duration_s / video.speed_up * video.frame_rate_hz))
    if count * video.width_px * video.height_px <= MAX_PIXELS:
        return []
    max_frames = MAX_PIXELS // (video.width_px * video.height_px)
    return [
        f"video: a film of {duration_s:g} s at speed_up = {video.speed_up:g} and "
        f"{video.frame_rate_hz} Hz has "
        f"{count:.4g} frames, at {video.width_px} × {video.height_px} there may be {max_frames}"
    ]


def _cost_errors(motion: MotionSettings) -> list[str]:
    """Errors of a mission that takes more memory or time than there is."""
    duration_s = motion.plan.duration_s
    step_s = motion.physics_step_s
    vehicles = 1 + len(motion.plan.followers)
    problems = []
    instants = duration_s / CONTROL_STEP_S * vehicles
    if instants > MAX_INSTANTS:
        problems.append(
            f"duration_s: {duration_s:g} s of {vehicles} vehicles would take "
            f"{instants * 1.1e-6:.3g} GB of "
            f"memory; so many vehicles may fly {MAX_INSTANTS * CONTROL_STEP_S / vehicles:.0f} s"
        )
    steps = duration_s / step_s * vehicles
    if motion.kind == "physics" and steps > MAX_PHYSICS_STEPS:
        problems.append(
            f"timing.physics_step_s: {duration_s:g} s of {vehicles} vehicles in steps of "
            f"{step_s:g} s are {steps:.4g} steps, there may be "
            f"{MAX_PHYSICS_STEPS}"
        )
    return problems


def _errors_of(build: Callable[[], object], where: str) -> list[str]:
    """The error that a call raises, which begins with `where`; no line if it raises none."""
    try:
        build()
    except np.linalg.LinAlgError:
        return [f"{where}: its mass and added mass have no inverse"]
    except LaisnError as error:
        text = str(error)
        return [text if text.startswith(where) else f"{where}: {text}"]
    return []


def _stretch_speeds(sea: SeaSettings, route: Route, depth: float) -> tuple[Floats, Ints]:
    """Speeds through the water at a depth [m] on stretches between instants at which the current or
    the leg changes: at their start and end, shape (2, n), [m/s]; and the leg of each, from 0, (n,).
    """
    over_ground = np.diff(route.waypoint, axis=0) / np.diff(route.time)[:, None]
    changes = [time for time, *_ in sea.ocean.current_profile if time < route.time[-1]]
    times = np.unique([*route.time, *changes])
    legs = np.searchsorted(route.time, 0.5 * (times[1:] + times[:-1])) - 1
    east, north = (np.interp(times, route.time, axis) for axis in route.waypoint.T)
    current = current_at(sea, east, north, depth, times)
    ends = np.stack([over_ground[legs] - current[:-1], over_ground[legs] - current[1:]])
    return np.hypot(ends[..., 0], ends[..., 1]), legs


class SpeedRange(NamedTuple):
    """Speeds through the water of a vehicle during a mission [m/s]."""

    slowest: float
    fastest: float
    mean: float  # over the time


_FIELD_LEVELS = 5  # depths at which another current is looked at
_SEGMENT_POINTS = 9  # instants at which speeds are looked at, in each segment of a plan


def _planned_speeds(sea: SeaSettings, route: Route, depths: Sequence[float]) -> SpeedRange:
    """Speeds through the water along the plan of a route, at depths [m]."""
    duration_s = sea.plan.duration_s
    if sea.ocean.current is None:
        return _speeds_by_keys(sea.ocean, duration_s, route, tuple(depths))
    return _speeds_in(partial(current_at, sea), sea.ocean, duration_s, route, depths)


@lru_cache(maxsize=256)
def _speeds_by_keys(
    ocean: OceanTable, duration_s: float, route: Route, depths: tuple[float, ...]
) -> SpeedRange:
    """`_planned_speeds` in a current of the sea's keys, which follow from no file."""
    return _speeds_in(partial(current_of_keys, ocean), ocean, duration_s, route, depths)


def _speeds_in(
    current_in: Callable[[Floats, Floats, float, Floats], Floats],
    ocean: OceanTable,
    end: float,
    route: Route,
    depths: Sequence[float],
) -> SpeedRange:
    """`_planned_speeds` until an end [s], in the current of a sea at places and times as of
    `current_at`.
    """
    point_motion = planned_motion(route)
    starts = point_motion.start[point_motion.start < end]
    changes = [time for time, *_ in ocean.current_profile if time < end]
    bounds = np.unique([*starts, *changes, end])
    shares = np.linspace(0.0, 1.0, _SEGMENT_POINTS)
    times = (bounds[:-1, None] + np.diff(bounds)[:, None] * shares).ravel()
    motion = point_motion.at(times)
    over_ground = motion.speed * np.array([np.sin(motion.course), np.cos(motion.course)])
    currents = [current_in(motion.east, motion.north, depth, times).T for depth in depths]
    speeds = np.array([np.hypot(*(over_ground - current)) for current in currents])
    mean = np.trapezoid(speeds.mean(axis=0), times) / end
    return SpeedRange(float(speeds.min()), float(speeds.max()), float(mean))


def _speeds(sea: SeaSettings, vehicle: Vehicle) -> SpeedRange:
    """Speeds through the water of a vehicle on its route, or of the leader at its station's
    depth.
    """
    if isinstance(vehicle, Follower) and vehicle.station:
        leader = route_of(sea.plan.leader, "leader")
        return _planned_speeds(sea, leader, [vehicle.held_depth_m])
    depths = [depth for _, depth in vehicle.depth_profile] or [
        vehicle.held_depth_m + side * vehicle.saw_tooth_amplitude_m for side in (-1.0, 1.0)
    ]
    # a current of the keys changes linearly with depth
    levels = 2 if sea.ocean.current is None else _FIELD_LEVELS
    depth_levels = np.linspace(min(depths), max(depths), levels).tolist()
    return _planned_speeds(sea, route_of(vehicle, ""), depth_levels)


# in physics steps up to this one the project's own hulls are stable at all speeds [s]
_USUAL_STEP_S = 0.02


def _speed_errors(vehicle: Vehicle, speeds: SpeedRange, hull: Hull) -> list[str]:
    """Speeds that a hull cannot have: more than its thrust, or less than its fins need."""
    lines = []
    greatest_speed = top_speed_of(hull)
    on_station = isinstance(vehicle, Follower) and vehicle.station is not None
    subject = "its station" if on_station else "its route"
    advice = "the leader's legs" if on_station else "legs"
    if speeds.fastest > greatest_speed:
        lines.append(
            f"its effectors drive it at {greatest_speed:.2g} m/s at most, {subject} needs up to "
            f"{speeds.fastest:.3g} through the water; give {advice} more time or less current"
        )
    if needs_way(_design_of(hull)) and speeds.slowest < MIN_STEERAGE_SPEED:
        lines.append(
            "it has no vertical thrusters and cannot hover: its fins need "
            f"{MIN_STEERAGE_SPEED:g} m/s, {subject} has down to {speeds.slowest:.3g} m/s through "
            f"the water; give {advice} less time, without stops"
        )
    return lines


def _design_of(hull: Hull) -> Autopilot:
    """The autopilot of a hull."""
    _, designs = calm_plant(hull)
    design: Autopilot = designs[0]
    return design


# a study has many scenarios with the same hulls and speeds
_MOST_HULLS_AND_SPEEDS = 1024


@kept_with_plugins(_MOST_HULLS_AND_SPEEDS)
def _stability_errors(hull: Hull, speeds: SpeedRange, orbital_speed: float) -> list[str]:
    """What `_require_stable_hull` reports, in waves whose water moves at up to `orbital_speed`
    [m/s].
    """
    return _errors_of(partial(_require_stable_hull, hull, speeds, orbital_speed), "hull")


def _require_stable_hull(hull: Hull, speeds: SpeedRange, orbital_speed: float) -> None:
    """LaisnError as of `require_stable`, or if an effector cannot have its scales."""
    plant, designs = calm_plant(hull)
    require_stable(
        plant,
        designs,
        speeds.fastest,
        orbital_speed,
        min_speed=speeds.slowest,
        top_speeds=[top_speed_of(hull)],
    )


class VerticalForces(NamedTuple):
    """What a vehicle can hold of its buoyancy less its weight [N]."""

    down: float  # of a hull that is too light
    up: float  # of one that is too heavy


def _vertical_forces(plant: Plant, design: Autopilot, speed: float) -> VerticalForces:
    """Forces with which a vehicle holds its depth at a speed through the water, steadily.

    The hull's lift is that of the incidence that fins and thrusters can hold against its righting
    and the moments of hull and fins at that incidence; what they push down at the stern is lost.
    """
    effectors = design["effectors"]
    stiffness = design["righting"] - _moment_of_incidence(plant) * speed**2
    forces = []
    for side in (-1.0, 1.0):  # down, up
        force = 0.0
        if design["has_heave"]:
            force = side * _greatest(design, speed, HEAVE, side)
        share = design["by_pitch"]
        if design["has_heave"]:
            share *= clip((speed - SPEED_HEAVE) / (SPEED_PITCH - SPEED_HEAVE), 0.0, 1.0)
        if share > 0.0:
            # moments nose up are negative about the body's axis to port
            moment = abs(_greatest(design, speed, PITCH, -side))
            incidence = min(moment / max(abs(stiffness), 1e-9), INCIDENCE_MAX)
            lever = _stern_lever(effectors)
            lift = design["lift"] * speed**2 * incidence
            stern_force = stiffness * incidence / lever if lever > 0.0 else 0.0
            force += share * max(lift - stern_force, 0.0)
        forces.append(force)
    return VerticalForces(*forces)


def _moment_of_incidence(plant: Plant) -> float:
    """Moment nose up of hull and fins at rest, per incidence and speed² [kg]."""
    c = plant.coefficients[0]
    fins = fins_of(plant.effectors[0], plant.fixed_fins[0])
    lift = fins["lift_area"] * fins["force"][:, 2] ** 2
    by_fins = 0.5 * c["density"] * float(lift @ fins["place"][:, 0])
    added = c["added_mass"]
    return float(c["munk_factor"] * (added[2, 2] - added[0, 0]) + by_fins)


def _stern_lever(effectors: npt.NDArray[np.void]) -> float:
    """Lever of the level fins behind the hull's origin [m]; 0 without."""
    fins = fins_of(effectors)
    level = fins[np.abs(fins["force"][:, 2]) > 0.1]
    return float(-level["place"][:, 0].mean()) if level.size else 0.0


def _greatest(design: Autopilot, speed: float, axis: int, side: float) -> float:
    """Largest component of a wrench to one side [N] or [N m]."""
    return greatest_forces(design, speed, axis, side)[0]


# a hull that is trimmed or flown as advised has this share of its vertical forces to spare
_LIFT_RESERVE = 0.3


class DensityRange(NamedTuple):
    """Densities at the planned depths of a vehicle, as shares of that for which its buoyancy is
    stated.
    """

    least: float
    greatest: float


def _densities(sea: SeaSettings, vehicle: Vehicle) -> DensityRange:
    if sea.ocean.density is None:
        return DensityRange(1.0, 1.0)
    water = density_of(sea.ocean)
    reference = trim_density(sea.ocean, vehicle)
    planned = depth_profile_of(vehicle).depth_at(
        np.linspace(0.0, sea.plan.duration_s, _DENSITY_INSTANTS)
    )
    depths = np.linspace(planned.min(), planned.max(), _DENSITY_INSTANTS)
    shares = [water.relative_density_at(depth, reference) for depth in depths.tolist()]
    return DensityRange(min(shares), max(shares))


_DENSITY_INSTANTS = 200  # instants and depths of a plan at which densities are looked at


def _weight_errors(hull: Hull, speeds: SpeedRange, densities: DensityRange) -> list[str]:
    """A vehicle that is heavier or lighter than it can hold at the mean of its speeds."""
    for share in sorted(set(densities)):
        lines = _weight_errors_in(hull, speeds, share)
        if lines and share != 1.0:
            dense = f"in water {share:.4f} times as dense as that of its trim"
            lines = [f"{dense} {line}" for line in lines]
        if lines:
            return lines
    return []


@kept_with_plugins(_MOST_HULLS_AND_SPEEDS)
def _weight_errors_in(hull: Hull, speeds: SpeedRange, share: float) -> list[str]:
    """The same in water of a density, as a share of that in which its buoyancy holds."""
    plant, designs = calm_plant(hull)
    body = plant.model.body("hull/hull")
    coefficients = plant.coefficients[0]
    excess_buoyancy = float(
        share * coefficients["buoyancy"] - body.mass[0] * coefficients["gravity"]
    )
    forces = _vertical_forces(plant, designs[0], speeds.mean)
    if -forces.up <= excess_buoyancy <= forces.down:
        return []
    trim = -excess_buoyancy - (1.0 - _LIFT_RESERVE) * (
        forces.up if excess_buoyancy < 0.0 else -forces.down
    )
    trim += hull.settings.excess_buoyancy_n
    advice = f"trim it with excess_buoyancy_n = {trim:.3g}"
    if hull.settings.trim == "file" and hull.settings.excess_buoyancy_n == 0.0:
        advice += ' or trim = "neutral"'
    for speed in np.arange(speeds.mean, top_speed_of(hull), 0.05):
        faster = _vertical_forces(plant, designs[0], float(speed))
        reserve = (1.0 - _LIFT_RESERVE) * (faster.up if excess_buoyancy < 0.0 else faster.down)
        if abs(excess_buoyancy) <= reserve:
            advice += f", or go at {speed + 0.05:.2g} m/s or more through the water"
            break
    kind = "heavier" if excess_buoyancy < 0.0 else "lighter"
    largest_force = forces.up if excess_buoyancy < 0.0 else forces.down
    return [
        f"it is {abs(excess_buoyancy):.3g} N {kind} than the water that it displaces; hull lift, "
        f"fins and thrusters hold {largest_force:.3g} N at {speeds.mean:.3g} m/s, the mean of its "
        f"mission; {advice}"
    ]


def _is_usual(motion: MotionSettings, vehicle: Vehicle) -> bool:
    """Whether a hull of the project is as it was designed, in water for which it was."""
    return (
        all(getattr(vehicle, name) == Vehicle.model_fields[name].default for name in HULL_KEYS[1:])
        # buoyancy follows the density
        and motion.sea.ocean.density is None
        and motion.sea.ocean.density_kg_m3 == SEA_WATER
        and motion.physics_step_s <= _USUAL_STEP_S
    )


def _control_errors(motion: MotionSettings, key: str, vehicle: Vehicle) -> list[str]:
    """What the autopilot of a vehicle cannot control."""
    custom = vehicle.model is not None
    if not custom and (motion.kind == "kinematic" or _is_usual(motion, vehicle)):
        return []
    waves = motion.sea.ocean.waves
    hull = hull_of(motion, vehicle)
    designed = hull.as_designed
    lines = _errors_of(partial(calm_plant, designed), "hull")
    if not lines:
        speeds = _speeds(motion.sea, vehicle)
        if custom:
            lines = _speed_errors(vehicle, speeds, designed)
        if isinstance(vehicle, Follower) and vehicle.station:
            speeds = _station_speeds(motion.formation, speeds, designed)
        if not lines:
            lines = _weight_errors(designed, speeds, _densities(motion.sea, vehicle))
    if not lines:
        orbital_speed = 0.0 if waves.kind == "none" else np.pi * waves.height_m / waves.period_s
        lines = _stability_errors(hull, speeds, float(orbital_speed))
    return [f"{key}{'.model' if custom else ''}: {line.removeprefix('hull: ')}" for line in lines]


def _station_speeds(formation: Formation, leader: SpeedRange, hull: Hull) -> SpeedRange:
    """Speeds through the water that a follower on a station may be asked for."""
    slowest = formation.min_along_track_speed_m_s
    fastest = min(formation.max_speed_m_s, top_speed_of(hull))
    if needs_way(_design_of(hull)):
        slowest = max(slowest, MIN_STATION_SPEED)
    return SpeedRange(min(slowest, leader.fastest), max(fastest, leader.slowest), leader.mean)


def _leader_too_fast(motion: MotionSettings) -> list[str]:
    limit = motion.formation.max_speed_m_s
    depths = {f.held_depth_m for f in motion.plan.followers if f.station}
    for depth in sorted(depths):
        speeds, legs = _stretch_speeds(motion.sea, route_of(motion.plan.leader, "leader"), depth)
        fastest_on_stretch = speeds.max(axis=0)
        k = int(np.argmax(fastest_on_stretch))
        if fastest_on_stretch[k] > limit:
            return [
                f"leader: on the way to waypoint {legs[k] + 2} followers at {depth:g} m would need "
                f"{fastest_on_stretch[k]:.3g} m/s through the water, formation.max_speed_m_s is "
                f"{limit:g} m/s"
            ]
    return []


def _start_overlap(motion: MotionSettings) -> list[str]:
    """Vehicles that start too close: followers that join stations, or all of them if contact
    ends the mission.
    """
    plan = motion.plan
    joins = [
        isinstance(vehicle, Follower) and vehicle.start_m is not None
        for _, vehicle in plan.vehicles()
    ]
    if motion.contact == "mark" and not any(joins):
        return []
    setups = setups_of(plan, routes_of(plan))
    keys = [key for key, _ in plan.vehicles()]
    overlaps = []
    for i, setup in enumerate(setups):
        for j, other in enumerate(setups[:i]):
            x, y, z = np.subtract(setup.position_m, other.position_m)
            overlaps_other = (
                (joins[i] or joins[j])
                and np.hypot(x, y) < MIN_SEPARATION_M
                and abs(z) < MIN_LAYER_SPACING_M
            )
            if overlaps_other or (
                motion.contact == "end" and np.hypot(np.hypot(x, y), z) < 2.0 * HULL_RADIUS_M
            ):
                overlaps.append(
                    f"{keys[j]} and {keys[i]} start {np.hypot(x, y):.2g} m apart in layers "
                    f"{abs(z):.2g} m apart; at "
                    f"least {MIN_SEPARATION_M:g} m or {MIN_LAYER_SPACING_M:g} m are needed"
                )
    return overlaps


def _station_conflict(motion: MotionSettings) -> list[str]:
    """Stations of one layer that meet where the leader turns, of followers without a sensor to
    give way by.
    """
    closest = None if motion.formation.proximity else closest_stations(motion)
    if closest is None or closest.distance_m >= MIN_SEPARATION_M:
        return []
    return [
        f"{' and '.join(closest.pair)}, in one layer, come within {closest.distance_m:.2g} m of "
        f"each other at {closest.time_s:g} s of the leader's route; at least {MIN_SEPARATION_M:g} "
        f"m are needed: give them layers {MIN_LAYER_SPACING_M:g} m apart, "
        "other places, or formation.proximity to give way by"
    ]


def _transmitters_off_axis(plan: MissionPlan, leader: Leader) -> list[str]:
    """Transmitters of an own hull where navigators of closed loops cannot use them."""
    closed = any(follower.station or follower.guided_by_estimate for follower in plan.followers)
    if leader.model is None or not closed:
        return []
    spec = spec_of(leader.model)
    places = {name: np.array(spec.site(name).pos) for name in ("tx_rear", "tx_front", "tx_middle")}
    for name, (axis, value) in transmitter_places(leader).items():
        places[name][axis] = value
    if are_at_baseline_and_offset(
        np.array([site - (0.0, 0.0, spec.site("depth_sensor").pos[2]) for site in places.values()])
    ):
        return []
    return [
        "leader.model: where followers are on stations or steer by their estimates, tx_rear and "
        "tx_front must be at "
        "(−L/2, 0, 0) and (L/2, 0, 0), tx_middle at (0, H, 0) and depth_sensor at height 0"
    ]


def effect_cautions(motion: MotionSettings) -> list[str]:
    """Lines that name keys which are set and have no effect: of bodies in water, where vehicles
    move as points, and of roll, where effectors cannot hold it.
    """
    if motion.kind == "physics":
        return [
            f"without effect: {name}.roll_control = 'free', as its effectors give no moment of roll"
            for name, vehicle in motion.plan.vehicles()
            if vehicle.roll_control == "free" and not can_roll(_design_of(hull_of(motion, vehicle)))
        ]
    keys = [f"ocean.{key}" for key in motion.sea.ocean.changed_keys() if key in _OF_WATER]
    for name, vehicle in motion.plan.vehicles():
        keys += [f"{name}.{key}" for key in vehicle.changed_keys() if key in HULL_KEYS]
    return [f"without effect on motion = 'kinematic': {', '.join(keys)}"] if keys else []


def _switch_of(table: Section, key: str) -> str:
    """The key of the same table whose value keeps a key from having an effect; "" if none does."""
    for idle in type(table).model_fields[key].metadata:
        if isinstance(idle, Idle) and getattr(table, idle.key) in idle.at:
            return idle.key
    return ""


def _value_text(value: float | str) -> str:
    return repr(value) if isinstance(value, str) else f"{value:g}"


def idle_reason(table: Section, key: str) -> str:
    """What keeps a dotted key of a table from having an effect, such as "ocean.waves.kind =
    'none'"; "" if nothing does, or there is no such key.
    """
    path, dot, name = key.rpartition(".")
    found: Any = table
    for part in path.split(".") if path else ():
        if isinstance(found, tuple):
            # all items, "*", are judged by the first one
            index = int(part) if part.isdecimal() else 0
            found = found[index] if index < len(found) else None
        else:
            found = getattr(found, part, None)
    if not isinstance(found, Section) or name not in type(found).model_fields:
        return ""
    switch = _switch_of(found, name)
    if switch:
        return f"{path}{dot}{switch} = {_value_text(getattr(found, switch))}"
    if not isinstance(table, Scenario):
        return ""
    navigations = [table.navigation_of(follower) for follower in range(len(table.followers))]
    return _unread_reason(navigations, key)


def _unread_reason(navigations: Sequence[Navigation], key: str) -> str:
    """Which navigators, of each follower, leave a dotted key of a table of navigation unread; "" if
    one reads it, or it is none.
    """
    owner, navigation, setting = key.rpartition("navigation.")
    if not navigation or owner.startswith("leader"):
        return ""
    index = owner.removeprefix("followers.").removesuffix(".")
    readers = [navigations[int(index)]] if index.isdecimal() else navigations
    if any(reader.reads(setting) for reader in readers):
        return ""
    return f"{owner}navigation.variant = {_variants_text(readers)}"


def _variants_text(navigations: Sequence[Navigation]) -> str:
    return " and ".join(dict.fromkeys(repr(navigation.variant) for navigation in navigations))


def _idle_keys(table: Section, path: str = "") -> list[str]:
    """Lines that name keys of a table, and of the tables in it, that are set and have no effect by
    the value of another key; `path` is the table's own, up to the dot.
    """
    keys_by_switch: dict[str, list[str]] = {}
    for key in table.changed_keys():
        switch = _switch_of(table, key)
        if switch:
            keys_by_switch.setdefault(switch, []).append(f"{path}{key}")
    lines = []
    for switch, keys in keys_by_switch.items():
        value = _value_text(getattr(table, switch))
        lines.append(f"without effect: {', '.join(keys)}, as {path}{switch} = {value}")
    for key in type(table).model_fields:
        value = getattr(table, key)
        tables = {f"{path}{key}": value}
        if isinstance(value, tuple):
            tables = {f"{path}{key}[{i}]": item for i, item in enumerate(value)}
        for name, inner in tables.items():
            if isinstance(inner, Section):
                lines += _idle_keys(inner, f"{name}.")
    return lines


def _unread_keys(
    common: Navigation, own: Sequence[Navigation | None], navigations: Sequence[Navigation]
) -> list[str]:
    """A line for the keys of each table of navigation that are set and that none of the navigators
    it is for reads: of `[navigation]`, and of each follower's own one, if it has any.

    `navigations` are those of each follower, with keys of both.
    """
    tables = [("navigation", common, navigations)]
    for i, table in enumerate(own):
        if table is not None:
            tables.append((f"followers[{i}].navigation", table, [navigations[i]]))
    lines = []
    for name, table, readers in tables:
        keys = [
            f"{name}.{key}"
            for key in table.keys_set()
            if not any(navigation.reads(key) for navigation in readers)
        ]
        if keys:
            variants = _variants_text(readers)
            lines.append(f"without effect: {', '.join(keys)}, as {name}.variant = {variants}")
    return lines


def _unused_links(links: Sequence[LinkTable], navigations: Sequence[Navigation]) -> list[str]:
    """A line for each link that nobody navigates on."""
    used = {
        name for navigation in navigations for name in (navigation.link, *navigation.further_links)
    }
    return [
        f"without effect: links[{i}] ({link.name!r}), on which nobody navigates"
        for i, link in enumerate(links)
        if link.name not in used
    ]


def cautions(scenario: Scenario) -> list[str]:
    """What a flyable scenario has that its navigators or followers cannot cope with, or that has no
    effect, a line each.
    """
    remarks = [
        *effect_cautions(MotionSettings.of(scenario)),
        *_idle_keys(scenario),
        *_unread_keys(
            scenario.navigation,
            [follower.navigation for follower in scenario.followers],
            [scenario.navigation_of(i) for i in range(len(scenario.followers))],
        ),
    ]
    if not scenario.keys_needing_closed_loop():
        # nobody steers by what is received
        navigations = [navigation for _, navigation in scenario.navigations()]
        remarks += _unused_links(scenario.links, navigations)
    for navigated in navigated_alike(scenario):
        remarks += unheard_links(navigated)
        remarks += assumption_cautions(navigated)
        remarks += ray_cautions(navigated.sensing.sound, navigated.sensing.sound_speed)
    remarks = [*dict.fromkeys(remarks)]
    for key, vehicle in scenario.vehicles():
        if vehicle.model:
            remarks += [f"{key}.model: {remark}" for remark in gear_remarks(vehicle.model)]
    keeping = [
        scenario.navigation_of(i).variant
        for i, follower in enumerate(scenario.followers)
        if follower.station
    ]
    for variant in dict.fromkeys(keeping):
        # those compared with the Cramér–Rao bound come near it; how good a navigator of the user's
        # own is, its flight shows
        if find(variant).compare_with_crlb or is_plugin_name(variant):
            continue
        better = ", ".join(
            repr(name) for name, spec in NAVIGATORS.items() if spec.compare_with_crlb
        )
        remarks.append(
            f"stations are kept by navigator {variant!r}, with errors of metres; {better} keeps "
            "them better"
        )
    return remarks


def _route_motion(vehicle: Vehicle, name: str) -> Plan:
    """The motion along the route of a vehicle; LaisnError if it has none that can be flown."""
    return planned_motion(route_of(vehicle, name))


def _require_readings(
    sensing_of: Sequence[SensingSettings], variants: Sequence[str], of_leader: Navigation | None
) -> None:
    """LaisnError if a further sensor cannot be made, or the navigator of a follower, by its
    variant, or of the leader needs one that is not there.
    """
    sensors_of_all(sensing_of)
    carriers = [
        (variant, custom_sensors(sensing, i))
        for i, (variant, sensing) in enumerate(zip(variants, sensing_of, strict=True))
    ]
    if of_leader is not None:
        carriers.append((of_leader.variant, leader_custom_sensors(sensing_of[0])))
    for variant, drivers in carriers:
        names = [driver.name for driver in drivers]
        spec = find(variant)
        missing = [name for name in spec.needs if name not in names]
        if missing:
            raise LaisnError(
                f"navigator {spec.title} needs readings {', '.join(map(repr, missing))}; "
                f"sensors.custom gives {', '.join(map(repr, names)) or 'none'}"
            )


def _navigator_errors(
    navigations: Sequence[tuple[str, Navigation]], of_leader: Navigation | None
) -> list[str]:
    """What keeps the navigators of followers, by their keys, and of the leader from being made."""
    problems: list[str] = []
    for key, navigation in navigations:
        where = key.removesuffix("navigation").removesuffix(".")
        problems += _settings_errors(navigation, where)
    if of_leader is not None:
        problems += _settings_errors(of_leader, "leader")
    return problems


def _settings_errors(navigation: Navigation, where: str) -> Sequence[str]:
    """What keeps the settings of a navigator from being made."""
    if navigation.variant in NAVIGATORS:
        return _kept_settings_errors(navigation, where)
    # they follow from a class of the user's own as well, which may change
    return _errors_of(navigation.settings, where)


@lru_cache(maxsize=64)
def _kept_settings_errors(navigation: Navigation, where: str) -> Sequence[str]:
    return _errors_of(navigation.settings, where)


def engine_errors(motion: MotionSettings) -> list[str]:
    """A line for each hull that `timing.engine` cannot solve for."""
    if motion.engine != "direct":
        return []
    reasons = [
        (key, direct_solver_error(model))
        for (key, _), model in zip(motion.plan.vehicles(), motion.plan.models, strict=True)
    ]
    return [f"timing.engine: {key}: {reason}" for key, reason in reasons if reason]


def infeasibilities(scenario: Scenario) -> list[str]:
    """Everything that keeps a scenario from being flown, filmed and logged, beyond
    `Scenario.inconsistencies`.
    """
    geometry_errors: list[str] = []
    motion = MotionSettings.of(scenario)
    sensing_of = sensing_of_each(scenario)
    variants = [scenario.navigation_of(i).variant for i in range(len(sensing_of))]
    of_leader = scenario.leader.navigation
    problems = [
        *_errors_of(partial(Clock, scenario.epoch), "epoch"),
        *film_errors(scenario.duration_s, scenario.video),
        *_errors_of(partial(sea_of_keys, scenario.ocean, scenario.seed), "ocean.waves.height_m"),
        *_navigator_errors(scenario.navigations(), of_leader),
        *_errors_of(partial(_require_readings, sensing_of, variants, of_leader), ""),
        *_cost_errors(motion),
    ]
    for _, vehicle in scenario.vehicles():
        if vehicle.controller:
            problems += _errors_of(partial(find_controller, vehicle.controller), "")
    for (key, vehicle), name in zip(scenario.vehicles(), motion.plan.names, strict=True):
        role = "follower" if isinstance(vehicle, Follower) else "leader"
        geometry_errors += [
            f"{key}.model: {line}"
            for line in (hull_errors(vehicle.model, role) if vehicle.model else ())
        ]
        if not (isinstance(vehicle, Follower) and vehicle.station):
            where = f"{key}.{'waypoints' if vehicle.waypoints else 'route'}"
            # a saw-tooth that leaves the water is an error of its own
            without_saw_tooth = vehicle.model_copy(update={"saw_tooth_amplitude_m": 0.0})
            geometry_errors += _errors_of(partial(_route_motion, without_saw_tooth, name), where)
    geometry_errors += (
        [] if geometry_errors else _errors_of(partial(require_sea, motion.sea), "ocean")
    )
    # alike of all followers
    sound = sensing_of[0].sound
    geometry_errors += (
        [] if geometry_errors else _errors_of(partial(require_beacons, sound), "links")
    )
    if geometry_errors:
        # what follows depends on hulls, routes and the sea
        return [*problems, *geometry_errors]
    for key, vehicle in scenario.vehicles():
        problems += _control_errors(motion, key, vehicle)
    problems += engine_errors(motion)
    return [
        *problems,
        *_leader_too_fast(motion),
        *_start_overlap(motion),
        *_station_conflict(motion),
        *_transmitters_off_axis(motion.plan, scenario.leader),
    ]
