"""What a sea from files, or of the user's own, must be for a mission; and what was read of it."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.scenario.parts import MissionPlan, SeaSettings, SoundSettings
from sim.scenario.point_motion import plan as planned_motion
from sim.scenario.settings import FASTEST_CURRENT_M_S
from sim.scenario.vehicle_routes import route_of
from sim.sensing.sonar import half_heard_m, sonar_of
from sim.water.assembly import (
    current_at,
    current_field,
    density_cast,
    floor_field,
    floor_of,
    sound_cast,
)
from sim.water.region import Region

_CLEARANCE_M = 1.0  # between a plan and the floor
_INSTANTS = 500  # instants at which the plan of a mission is looked at


class PlannedPath(NamedTuple):
    """Where a vehicle is to be."""

    key: str  # of the vehicle in the scenario
    time: Floats  # shape (n,), [s]
    position: Floats  # east, north and up, shape (n, 3), [m]

    def at(self, instant: int) -> str:
        """Time and place at an instant, by its index, for a message."""
        east, north, up = self.position[instant]
        return f"at {self.time[instant]:.0f} s, {east:.0f} m east, {north:.0f} m north, {-up:.3g} m"


class Area(NamedTuple):
    """Where a field is known."""

    key: str  # that names its file
    region: Region


def planned_paths(plan: MissionPlan) -> Iterator[PlannedPath]:
    """Plans of all vehicles that have routes."""
    time = np.linspace(0.0, plan.duration_s, _INSTANTS)
    for (key, vehicle), name in zip(plan.vehicles(), plan.names, strict=True):
        if getattr(vehicle, "station", None) is not None:
            continue
        route = route_of(vehicle, name)
        motion = planned_motion(route).at(time)
        depth = route.depth.depth_at(time)
        yield PlannedPath(key, time, np.column_stack([motion.east, motion.north, -depth]))


def areas_of(sea: SeaSettings) -> tuple[Area, ...]:
    """Where the fields of a sea are known, of which vehicles may not leave any."""
    fields = {"current": current_field(sea), "floor": floor_field(sea)}
    return tuple(
        Area(f"ocean.{key}.file", field.region)
        for key, field in fields.items()
        if field is not None
    )


def _extent(region: Region) -> str:
    """Where a region lies, for a message."""
    return (
        f"{region.west:.0f} to {region.east:.0f} m east and {region.south:.0f} to "
        f"{region.north:.0f} m north"
    )


def _require_area(area: Area, path: PlannedPath) -> None:
    outside = ~area.region.within(path.position[:, :2])
    if outside.any():
        first = int(np.argmax(outside))
        raise LaisnError(
            f"{area.key}: {path.key} leaves it {path.at(first)}; it covers {_extent(area.region)} "
            "of the origin"
        )


def _require_current(sea: SeaSettings, path: PlannedPath) -> None:
    field = current_field(sea)
    if field is not None:
        land = field.on_land(path.position[:, :2])
        if land.any():
            first = int(np.argmax(land))
            raise LaisnError(
                f"ocean.current.file: {path.key} runs over land, where the file has no values, "
                f"{path.at(first)}"
            )
    east, north, up = path.position.T
    speed = np.hypot(*current_at(sea, east, north, -up, path.time).T)
    fastest = int(np.argmax(speed))
    if speed[fastest] > FASTEST_CURRENT_M_S:
        raise LaisnError(
            f"ocean.current: {path.key} meets {speed[fastest]:.3g} m/s {path.at(fastest)}; at most "
            f"{FASTEST_CURRENT_M_S:g} m/s are flown"
        )


def _require_floor(sea: SeaSettings, path: PlannedPath) -> None:
    east, north, up = path.position.T
    depth = floor_of(sea).depths_at(east, north)
    shallow = depth < _CLEARANCE_M - up
    if shallow.any():
        first = int(np.argmax(shallow))
        raise LaisnError(
            f"ocean.floor.file: {path.key} would ground {path.at(first)} deep; the floor lies at "
            f"{depth[first]:.3g} m there ({_CLEARANCE_M:g} m is kept clear)"
        )


def require_sea(sea: SeaSettings) -> None:
    """LaisnError where a plan leaves a field, runs over land, or meets the floor or too fast a
    current; errors of files as of `sim.water.field_files` and `sim.water.casts`.
    """
    sound_cast(sea.ocean)
    density_cast(sea.ocean)
    if sea.ocean.current is None and sea.ocean.floor is None:
        return
    areas = areas_of(sea)
    for path in planned_paths(sea.plan):
        for area in areas:
            _require_area(area, path)
        if sea.ocean.current is not None:
            _require_current(sea, path)
        if sea.ocean.floor is not None:
            _require_floor(sea, path)


def require_beacons(sound: SoundSettings) -> None:
    """LaisnError where a beacon lies below a floor from a file. Beyond the part that was read, the
    floor is that of its edge, as it is for sound.
    """
    field = floor_field(sound.sea)
    if field is None:
        return
    for east, north, depth in sound.beacons_m:
        place = np.array([[east, north]])
        floor_depth = float(field.floor.depths_at(*place.T)[0])
        if depth > floor_depth:
            beyond = ""
            if not field.region.within(place)[0]:
                beyond = (
                    f"; that is the depth of its edge, as {_extent(field.region)} of the origin "
                    "were read of it"
                )
            raise LaisnError(
                f"links: the beacon at {east:g} m east, {north:g} m north, {depth:g} m deep is "
                f"below the floor of ocean.floor.file, which lies at {floor_depth:.3g} m there"
                f"{beyond}"
            )


def sea_report(sound: SoundSettings) -> list[str]:
    """What was read of a sea, a line for each file, and how far messages are heard in it."""
    fields = {
        "current": current_field(sound.sea),
        "floor": floor_field(sound.sea),
        "sound_speed": sound_cast(sound.sea.ocean),
        "density": density_cast(sound.sea.ocean),
    }
    lines = [f"ocean.{key}: {field.report}" for key, field in fields.items() if field is not None]
    density = sound.sea.ocean.density
    if density is not None:
        trim = density.trim_depth_m
        where = "where each starts" if trim is None else f"at {trim:g} m"
        lines.append(f"ocean.density: hulls have their trim {where}, and follow the density")
    sonar = sonar_of(sound.acoustics)
    if sonar.detects:
        half_heard = half_heard_m(sonar)
        lines.append(
            f"acoustics.source_level_db: half of the messages are heard at {half_heard:.0f} m; "
            f"absorption {1e3 * sonar.absorption:.2f} dB/km"
        )
    return lines
