"""Settings made into a sea, and into the paths of sound in it."""

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.plugins import calling, find_class
from sim.scenario.class_keys import class_arguments
from sim.scenario.parts import MissionPlan, SeaSettings, SoundSettings
from sim.scenario.point_motion import plan as planned_motion
from sim.scenario.sea_files import SeaFile
from sim.scenario.settings import OceanTable, Vehicle
from sim.scenario.vehicle_routes import depth_profile_of, route_of
from sim.system import file_digest
from sim.water.casts import Cast, read_cast, read_density
from sim.water.custom import CustomCaller
from sim.water.densities import DensityProfile, UniformDensity
from sim.water.environment import velocities_at
from sim.water.field_files import (
    CurrentField,
    FieldOrigin,
    FloorField,
    Source,
    read_current,
    read_floor,
)
from sim.water.floors import LevelFloor
from sim.water.grids import GriddedFloor
from sim.water.ocean import Ocean
from sim.water.rays import SoundProfile, StraightRays
from sim.water.refraction import Extent, RefractedRays, refracted_rays
from sim.water.region import Region, region_of
from sim.water.waves import FLOOR_DEPTH_M, Waves, WaveTrain

_INSTANTS = 200  # instants at which the plan of a mission is looked at
# tables of rays reach beyond what is planned by this factor and, besides, by so much [m]
_MARGIN_FACTOR, _MARGIN_M = 1.2, 3.0

# keeps the sea's random numbers apart from all others that come from the same seed
_WAVES_KEY = 0x5EA


def sound_points(sound: SoundSettings) -> Floats | None:
    """Depths [m] and speeds of sound [m/s] of a profile, shape (n, 2); None: there is one speed."""
    cast = sound_cast(sound.sea.ocean)
    if cast is not None:
        return cast.points
    profile = sound.acoustics.sound_speed_profile
    return np.array(profile) if profile else None


def rays_of(sound: SoundSettings) -> StraightRays | RefractedRays:
    """How sound gets through a sea."""
    acoustics = sound.acoustics
    points = sound_points(sound)
    floor = floor_of(sound.sea)
    bends = points is not None and len(set(points[:, 1].tolist())) > 1
    if points is not None and bends and acoustics.rays == "refracted":
        return refracted_rays(
            points,
            floor,
            extent_of(sound),
            surface_echoes=acoustics.surface_echo_probability > 0.0,
        )
    constant = ((0.0, acoustics.sound_speed_m_s),)
    return StraightRays(
        profile=SoundProfile.through(constant if points is None else points),
        varies=points is not None,
        floor=floor,
    )


def planned_places(plan: MissionPlan) -> list[Floats]:
    """Where each vehicle is planned to be, shapes (n, 3), east, north and depth [m].

    Stations, which turn with the leader, are taken as due west of it, as far as they are from it.
    """
    time = np.linspace(0.0, plan.duration_s, _INSTANTS)
    places = []
    leader = np.zeros((_INSTANTS, 3))
    for key, vehicle in plan.vehicles():
        station = getattr(vehicle, "station", None)
        if station is not None:
            west_of_leader = leader[:, :2] - (math.hypot(station.behind_m, station.port_m), 0.0)
            places.append(
                np.column_stack([west_of_leader, np.full(_INSTANTS, vehicle.held_depth_m)])
            )
            continue
        route = route_of(vehicle, key)
        motion = planned_motion(route).at(time)
        depth = route.depth.depth_at(time)
        places.append(np.column_stack([motion.east, motion.north, depth]))
        leader = places[0]
    return places


def extent_of(sound: SoundSettings) -> Extent:
    """Depths and distances that the plans of vehicles need, and the places of beacons, with a
    margin.
    """
    places = planned_places(sound.sea.plan)
    places += [np.array([beacon]) for beacon in sound.beacons_m]
    deepest = max(float(path[:, 2].max()) for path in places)
    farthest = max(
        float(np.hypot(*(a[:, :2] - b[:, :2]).T).max())
        for i, a in enumerate(places)
        for b in places[:i]
    )
    reach = _MARGIN_FACTOR * farthest + _MARGIN_M
    if sound.acoustics.max_range_m:
        reach = min(reach, sound.acoustics.max_range_m)
    return Extent(_MARGIN_FACTOR * deepest + _MARGIN_M, reach)


def _source(key: str, table: SeaFile) -> Source:
    """The file of a table of `[ocean]`; FieldError if it is not that with which the scenario was
    saved.
    """
    assert table.file is not None  # its validation
    source = Source(f"ocean.{key}.file", Path(table.file))
    source.require_content(table.sha256)
    return source


def sound_cast(ocean: OceanTable) -> Cast | None:
    """The speed of sound that is read from a file; None: none. FieldError if there is none in
    it.
    """
    table = ocean.sound_speed
    if table is None:
        return None
    return read_cast(_source("sound_speed", table), _origin(ocean), table.profile)


def density_cast(ocean: OceanTable) -> Cast | None:
    """The density that is read from a file; None: none. FieldError if there is none in it."""
    table = ocean.density
    if table is None:
        return None
    return read_density(_source("density", table), _origin(ocean), table.profile)


def density_of(ocean: OceanTable) -> UniformDensity | DensityProfile:
    """The density of a sea."""
    cast = density_cast(ocean)
    if cast is None:
        return UniformDensity(float(ocean.density_kg_m3))
    return DensityProfile.through(cast.points)


def trim_density(ocean: OceanTable, vehicle: Vehicle) -> float:
    """Density in which the buoyancy of a vehicle's hull holds [kg/m³]."""
    table = ocean.density
    if table is None:
        return ocean.density_kg_m3
    start = float(depth_profile_of(vehicle).depth[0])
    depth = start if table.trim_depth_m is None else table.trim_depth_m
    return density_of(ocean).density_at(depth)


def floor_field(sea: SeaSettings) -> FloorField | None:
    """The floor that is read from a file; None: none. FieldError if it has none."""
    if sea.ocean.floor is None:
        return None
    return _floor_field_in(sea.ocean, region_of(sea.plan))


def _floor_field_in(ocean: OceanTable, region: Region) -> FloorField | None:
    table = ocean.floor
    return None if table is None else read_floor(_source("floor", table), _origin(ocean), region)


def floor_of(sea: SeaSettings) -> LevelFloor | GriddedFloor:
    """The floor of a sea."""
    return _level_unless_read(sea.ocean, floor_field(sea))


def _level_unless_read(ocean: OceanTable, field: FloorField | None) -> LevelFloor | GriddedFloor:
    return LevelFloor(float(ocean.floor_depth_m)) if field is None else field.floor


def _origin(ocean: OceanTable) -> FieldOrigin:
    """The origin of what is read, as `Scenario` has completed it."""
    origin = ocean.origin
    assert origin is not None  # the scenario's validation
    assert origin.latitude_deg is not None
    assert origin.longitude_deg is not None
    assert origin.time is not None
    return FieldOrigin(origin.latitude_deg, origin.longitude_deg, origin.time)


def current_field(sea: SeaSettings) -> CurrentField | None:
    """The current that is read from a file; None: none. FieldError if the file has none, or is not
    that with which the scenario was saved.
    """
    if sea.ocean.current is None or sea.ocean.current.file is None:
        return None
    return _current_field_in(sea.ocean, region_of(sea.plan))


def _current_field_in(ocean: OceanTable, region: Region) -> CurrentField | None:
    table = ocean.current
    if table is None or table.file is None:
        return None
    return read_current(_source("current", table), _origin(ocean), region)


def _custom_current(ocean: OceanTable) -> CustomCaller | None:
    """The current of the user's own; LaisnError if its class is not there, or takes other keys."""
    current = ocean.current
    if current is None or current.model is None:
        return None
    current_class = find_class("current", current.model, "velocity")
    custom = current.custom.model_extra or {}
    keys = class_arguments(current_class, current.model, custom, "ocean.current.custom")
    try:
        with calling(f"current {current.model}"):
            caller = CustomCaller(current_class(**keys))
    except LaisnError as error:
        raise LaisnError(f"ocean.current: {error}") from error
    if not callable(getattr(current_class, "velocity", None)):
        raise LaisnError(f"ocean.current: {current.model} has no `velocity(position, time)`")
    return caller


_NO_WAVES = WaveTrain.on(Waves.none(), (0.0, 0.0), FLOOR_DEPTH_M)


def current_at(
    sea: SeaSettings, east: Floats, north: Floats, depth: Floats | float, time: Floats
) -> Floats:
    """Current without waves at n places [m] and times [s], east and north, shape (n, 2), [m/s]."""
    if sea.ocean.current is None:
        return current_of_keys(sea.ocean, east, north, depth, time)
    ocean = ocean_of(sea)
    calm = ocean.environment._replace(waves=_NO_WAVES)
    height = np.broadcast_to(-np.asarray(depth, dtype=np.float64), np.shape(time))
    positions = np.ascontiguousarray(np.column_stack([east, north, height]))
    velocity = np.empty(positions.shape)
    velocities_at(calm, positions, np.asarray(time, dtype=np.float64), velocity)
    ocean.raise_custom_error()
    return velocity[:, :2]


def current_of_keys(
    ocean: OceanTable, _east: Floats, _north: Floats, depth: Floats | float, time: Floats
) -> Floats:
    """`current_at` in a sea whose keys state the current, the same at all places of a depth."""
    return np.asarray(np.broadcast_to(ocean.current_at(depth, time), (np.size(time), 2)))


def ocean_of(sea: SeaSettings) -> Ocean:
    """The sea without its sound; its waves depend on the seed and not on the run. LaisnError if
    they would break, or if a current cannot be had.
    """
    water = sea.ocean
    if water.current is None and water.floor is None and water.density is None:
        return _sea_of_keys_alone(water, _seed_of_waves(water, sea.seed))
    region = region_of(sea.plan)
    if water.current is not None and water.current.model is not None:
        return replace(_sea_in_region(water, sea.seed, region), custom=_custom_current(water))
    return _kept_sea_in_region(water, _seed_of_waves(water, sea.seed), region, _digests(water))


def _sea_in_region(water: OceanTable, seed: int, region: Region) -> Ocean:
    """A sea with what is read from files of it, but without a current of the user's own."""
    field = _current_field_in(water, region)
    density = density_of(water)
    table = water.density
    return replace(
        sea_of_keys(water, seed),
        density=density if isinstance(density, DensityProfile) else None,
        trim_depth_m=None if table is None else table.trim_depth_m,
        current=None if field is None else field.current,
        floor=_level_unless_read(water, _floor_field_in(water, region)),
    )


def _digests(water: OceanTable) -> tuple[str | None, ...]:
    """Those of the content of the files of a sea."""
    tables = (water.current, water.floor, water.density)
    files = (table.file for table in tables if table is not None and table.file is not None)
    return tuple(file_digest(Path(file)) for file in files)


def _seed_of_waves(water: OceanTable, seed: int) -> int:
    """The seed as far as waves depend on it; 0: they do not."""
    return seed if water.waves.kind == "jonswap" else 0


# missions of a study differ more often in their vehicles than in their sea
_MOST_SEAS = 8


@lru_cache(maxsize=_MOST_SEAS)
def _kept_sea_in_region(
    water: OceanTable, seed: int, region: Region, _digests: tuple[str | None, ...]
) -> Ocean:
    """`_sea_in_region`; a file that was changed is read again."""
    return _sea_in_region(water, seed, region)


@lru_cache(maxsize=_MOST_SEAS)
def _sea_of_keys_alone(water: OceanTable, seed: int) -> Ocean:
    """The sea of a table that names no file and no class of the user's own."""
    return replace(sea_of_keys(water, seed), floor=LevelFloor(float(water.floor_depth_m)))


def sea_of_keys(water: OceanTable, seed: int) -> Ocean:
    """The sea without what is read from files, or is of the user's own. LaisnError if its waves
    would break.
    """
    return _sea_of_keys(water, _seed_of_waves(water, seed))


@lru_cache(maxsize=_MOST_SEAS)
def _sea_of_keys(water: OceanTable, seed: int) -> Ocean:
    waves = water.waves
    direction_and_floor = {
        "direction_rad": float(np.deg2rad(waves.direction_deg)),
        "floor_depth_m": water.floor_depth_m,
    }
    components = Waves.none()
    if waves.kind == "regular":
        components = Waves.regular(
            height_m=waves.height_m, period_s=waves.period_s, **direction_and_floor
        )
    elif waves.kind == "jonswap":
        components = Waves.jonswap(
            np.random.default_rng([_WAVES_KEY, seed]),
            significant_height_m=waves.height_m,
            peak_period_s=waves.period_s,
            spread_rad=float(np.deg2rad(waves.spreading_deg)),
            peakedness=waves.peak_enhancement,
            n_components=waves.components,
            **direction_and_floor,
        )
    return Ocean(
        current_speed_m_s=0.0 if water.current_profile else water.current_speed_m_s,
        current_direction_rad=float(np.deg2rad(water.current_direction_deg)),
        current_shear_1_s=water.current_shear_per_s,
        added_current=water.surface_current(),
        density_kg_m3=water.density_kg_m3,
        floor_depth_m=water.floor_depth_m,
        waves=components,
    )
