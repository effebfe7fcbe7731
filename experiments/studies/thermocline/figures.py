"""The figures of the study of thermoclines, and what else its page shows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.studies.thermocline import findings as study
from experiments.study.run import StudyResults
from reports.figures import Line, Panel, panel
from reports.findings import Findings
from reports.page import Figures, with_limits
from reports.style import FULL, SERIES
from sim.water.eigenrays import PathInWater, trace
from sim.water.smooth_profile import speed_and_gradient

_SOURCE_M = 20.0  # depth of the rays' source
_ANGLES_DEG = np.linspace(-16.0, 16.0, 33)
_REACH_M = 200.0
_POINTS = 101
_DEPTH_TICKS = {-depth: f"{depth:.0f}" for depth in (0.0, 10.0, 20.0, 30.0)}


def rays_from(season: str, depth: float = _SOURCE_M) -> list[Line]:
    """Direct rays that leave a depth at even angles, until they meet surface or floor."""
    rays = study.rays_of(season)
    water = PathInWater(rays.profile, rays.deepest, 0, 0)
    ranges = np.linspace(_REACH_M / (_POINTS - 1), _REACH_M, _POINTS - 1)
    lines = []
    for angle in np.deg2rad(_ANGLES_DEG).tolist():
        ends = [trace(water, depth, angle, distance, 200).depth for distance in ranges.tolist()]
        depths = np.array([depth, *ends])
        lines.append(
            Line(
                x=np.concatenate([[0.0], ranges]),
                y=-depths,
                colour=SERIES[0],
                width=0.7,
                name=f"leaves at {np.rad2deg(angle):.0f}°",
            )
        )
    return lines


def ray_picture(season: str) -> Panel:
    """Rays of a source below the thermocline."""
    return panel(
        rays_from(season),
        x_label="distance [m]",
        y_label="depth [m]",
        y_limits=(-30.0, 0.0),
        y_ticks=_DEPTH_TICKS,
        x_limits=(0.0, _REACH_M),
        width=FULL,
        height=3.2,
    )


def profile_picture() -> Panel:
    """Speeds of sound of the seasons."""
    depth = np.linspace(0.0, 30.0, 121)
    lines = [
        Line(
            x=np.array(
                [speed_and_gradient(study.rays_of(season).profile, z, 0)[0] for z in depth.tolist()]
            ),
            y=-depth,
            colour=SERIES[i],
            name=title,
        )
        for i, (season, title) in enumerate(study.SEASONS.items())
    ]
    return panel(
        lines,
        x_label="speed of sound [m/s]",
        y_label="depth [m]",
        y_limits=(-30.0, 0.0),
        y_ticks=_DEPTH_TICKS,
    )


def _off_key(navigator: str, season: str, sound: str = "straight") -> str:
    """The finding of a follower that steers by its estimate."""
    name = f"off {navigator} {season}".removesuffix(" strong")
    return f"{name} {sound}"


def values(record: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name."""
    legend = [(SERIES[i], title) for i, title in enumerate(study.SEASONS.values())]
    return {
        "study": study,
        "legs": [
            season
            for season in study.SEASONS
            if f"error tight {season} 8-20 100" in record.findings
        ],
        "flown": [
            season
            for season in study.BENDING_SEASONS
            if _off_key("tight", season) in record.findings
        ],
        "off": _off_key,
        "interval": lambda key, digits=2: with_limits(record[key], digits),
        "rays": Figures(panels=[ray_picture("strong")]),
        "profiles": Figures(panels=[profile_picture()], legend=legend),
    }
