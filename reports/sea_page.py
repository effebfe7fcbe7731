"""The page of a scenario's sea: map of current and floor, section below the routes, profiles."""

from pathlib import Path
from typing import Any, NamedTuple

import contourpy
import numpy as np

from laisn.arrays import Floats
from laisn.errors import printable
from reports.figures import Line, panel
from reports.flight_figures import current_arrows
from reports.page import Figures, page_of, write
from reports.style import FOLLOWER, FRAME, INK, LEADER, MUTED, SERIES, Colour
from sim.scenario.parts import MissionPlan, SeaSettings, SoundSettings
from sim.scenario.settings import Scenario
from sim.sea import PlannedPath, planned_paths, sea_report
from sim.water.assembly import current_at, floor_of, rays_of
from sim.water.region import Region, region_of

_ARROWS = 14  # along the longer side of the map
_FLOOR_POINTS = 61  # along each side of the map
_MARGIN_M = 100.0  # of the map about the routes
_PROFILE_POINTS = 80
_PROFILE_LEGEND = ((SERIES[0], "towards east, and sound"), (SERIES[1], "towards north"))
_NEGLIGIBLE_CURRENT_M_S = 1e-4  # a current below it is none
_LEVEL_FLOOR_M = 1e-4  # a floor whose depths differ by less is level


class _MapExtent(NamedTuple):
    region: Region
    spacing: float  # of arrows [m]


def _extent_of(plan: MissionPlan) -> _MapExtent:
    region = region_of(plan, _MARGIN_M)
    side = max(region.east - region.west, region.north - region.south)
    return _MapExtent(region, side / _ARROWS)


def _colour(number: int) -> Colour:
    """Of a vehicle by its number; 0 is the leader."""
    return LEADER if number == 0 else FOLLOWER


def _routes(paths: list[PlannedPath]) -> list[Line]:
    return [
        Line(
            x=path.position[:, 0],
            y=path.position[:, 1],
            colour=_colour(i),
            width=2.0,
            name=path.key,
        )
        for i, path in enumerate(paths)
    ]


def _contours(sea: SeaSettings, region: Region) -> list[Line]:
    """Lines of equal depth of the floor, with their depths."""
    east = np.linspace(region.west, region.east, _FLOOR_POINTS)
    north = np.linspace(region.south, region.north, _FLOOR_POINTS)
    x, y = np.meshgrid(east, north)
    depth = floor_of(sea).depths_at(x, y)
    if np.ptp(depth) < _LEVEL_FLOOR_M:
        return []
    generator: Any = contourpy.contour_generator(x, y, depth)
    lines = []
    for level in np.linspace(depth.min(), depth.max(), 8)[1:-1]:
        for points in generator.lines(float(level)):
            name = f"floor at {level:.3g} m"
            lines.append(Line(x=points[:, 0], y=points[:, 1], colour=MUTED, name=name))
            middle = points[len(points) // 2]
            label = Line(x=middle[:1], y=middle[1:], colour=MUTED, text=f"{level:.3g}", marker="o")
            lines.append(label)
    return lines


def _map_figure(sea: SeaSettings, paths: list[PlannedPath]) -> tuple[Any, float]:
    """The map, with currents at the leader's depth, and the fastest of them, whose arrow is as long
    as the spacing of arrows [m/s].
    """
    region, spacing = _extent_of(sea.plan)
    east = np.arange(region.west + 0.5 * spacing, region.east, spacing)
    north = np.arange(region.south + 0.5 * spacing, region.north, spacing)
    columns, rows = np.meshgrid(east, north)
    grid = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    depth = sea.plan.leader.held_depth_m
    velocity = current_at(sea, grid[:, 0], grid[:, 1], depth, np.zeros(len(grid)))
    fastest = float(np.hypot(*velocity.T).max(initial=0.0))
    lines = _contours(sea, region)
    if fastest > _NEGLIGIBLE_CURRENT_M_S:
        lines.append(current_arrows(grid, velocity, spacing / fastest))
    lines += _routes(paths)
    figure = panel(
        lines, x_label="east [m]", y_label="north [m]", equal_scales=True, width=6.1, height=4.6
    )
    return figure, fastest


def _distance_along(path: PlannedPath) -> Floats:
    """Horizontal distance along a path at its positions, shape (n,), [m]."""
    steps = np.hypot(*np.diff(path.position[:, :2], axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _section(sea: SeaSettings, paths: list[PlannedPath]) -> Any:
    floor = floor_of(sea)
    lines = []
    for i, path in enumerate(paths):
        distance_along = _distance_along(path)
        depth = floor.depths_at(*path.position[:, :2].T)
        name = f"floor below {path.key}"
        lines.append(Line(x=distance_along, y=-depth, colour=FRAME if i else INK, name=name))
        lines.append(
            Line(
                x=distance_along, y=path.position[:, 2], colour=_colour(i), width=2.0, name=path.key
            )
        )
    lines.append(Line(x=np.zeros(1), y=np.zeros(1), colour=MUTED, name="surface"))
    return panel(
        lines, x_label="distance along the route [m]", y_label="height [m]", width=6.1, height=4.6
    )


def _speed_along(sea: SeaSettings, path: PlannedPath) -> Floats:
    """Speed of the current along a path, shape (n,), [m/s]."""
    east, north, up = path.position.T
    velocity = current_at(sea, east, north, -up, path.time)
    return np.asarray(np.hypot(*velocity.T))


def _current_along_paths(speeds: list[Floats], paths: list[PlannedPath]) -> Any:
    lines = [
        Line(x=path.time, y=speed, colour=_colour(i), name=path.key)
        for i, (path, speed) in enumerate(zip(paths, speeds, strict=True))
    ]
    return panel(lines, x_label="time [s]", y_label="current [m/s]", width=4.1, height=3.0)


def _current_profile(sea: SeaSettings) -> Any:
    depth = np.linspace(0.0, floor_of(sea).deepest, _PROFILE_POINTS)
    zero = np.zeros(_PROFILE_POINTS)
    current = current_at(sea, zero, zero, depth, zero)
    lines = [
        Line(x=current[:, 0], y=-depth, colour=SERIES[0], name="towards east"),
        Line(x=current[:, 1], y=-depth, colour=SERIES[1], name="towards north"),
    ]
    return panel(
        lines, x_label="current at (0, 0) [m/s]", y_label="height [m]", width=4.1, height=3.0
    )


def _sound_profile(sound: SoundSettings) -> Any:
    depth = np.linspace(0.0, floor_of(sound.sea).deepest, _PROFILE_POINTS)
    rays = rays_of(sound)
    speed = np.array([rays.speed(float(value)) for value in depth])
    lines = [Line(x=speed, y=-depth, name="sound")]
    return panel(lines, x_label="speed of sound [m/s]", y_label="height [m]", width=4.1, height=3.0)


def _profiles(sound: SoundSettings, paths: list[PlannedPath], speeds: list[Floats]) -> Figures:
    """Currents, of these speeds along the paths, and speed of sound."""
    return Figures(
        panels=[
            _current_along_paths(speeds, paths),
            _current_profile(sound.sea),
            _sound_profile(sound),
        ],
        legend=[
            (LEADER, "leader"),
            (FOLLOWER, "followers"),
            *_PROFILE_LEGEND,
        ],
    )


def write_sea_page(scenario: Scenario, path: Path) -> None:
    """Write the page of a scenario's sea; OSError if it cannot be written."""
    sound = SoundSettings.of(scenario)
    sea = sound.sea
    paths = list(planned_paths(sea.plan))
    chart, fastest = _map_figure(sea, paths)
    floor = floor_of(sea)
    heights_above_floor = [
        floor.depths_at(*planned.position[:, :2].T) + planned.position[:, 2] for planned in paths
    ]
    least_clearance = min(float(height.min()) for height in heights_above_floor)
    speeds = [_speed_along(sea, planned) for planned in paths]
    fastest_along = max(float(speed.max()) for speed in speeds)
    # a tide may be slack at the start, for which the map is
    has_arrows = fastest > _NEGLIGIBLE_CURRENT_M_S
    flows = has_arrows or fastest_along > _NEGLIGIBLE_CURRENT_M_S
    texts = []
    if flows:
        texts.append(f"Along the plans the current runs at up to {fastest_along:.3g} m/s")
    else:
        texts.append("There is no current")
    if has_arrows:
        depth = scenario.leader.held_depth_m
        texts.append(f"at the start it runs at up to {fastest:.3g} m/s at {depth:g} m on the map")
    texts.append(f"the plans keep {least_clearance:.3g} m above the floor")
    legend = [(LEADER, "leader"), (FOLLOWER, "followers")]
    if has_arrows:
        legend.append((SERIES[0], "current"))
    values = {
        "name": printable(scenario.name),
        "summary": f"{'; '.join(texts)}.",
        "depth": f"{scenario.leader.held_depth_m:g}",
        "arrow": f"{fastest:.3g} m/s",
        "maps": Figures(panels=[chart, _section(sea, paths)], legend=legend),
        "has_arrows": has_arrows,
        "flows": flows,
        "profiles": (
            _profiles(sound, paths, speeds) if flows else Figures(panels=[_sound_profile(sound)])
        ),
        "files": [printable(line).split(": ", 1) for line in sea_report(sound)],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    write(page_of("reports", [("Scenario", scenario.name)], values, name="sea_page.md.j2"), path)
