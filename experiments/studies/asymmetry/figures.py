"""Drawings of the pitch study: one message to scale, the map around the leader, errors over pitch, results."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple, Self

import numpy as np

from experiments.pages.figures import Line, Panel, numbers, panel
from experiments.pages.style import FRAME, FULL, INK, MUTED, SERIES, Colour
from experiments.studies.asymmetry.comparison import Missions, select
from experiments.studies.asymmetry.conditions import AHRS, LEVEL, REAL
from experiments.studies.asymmetry.fix_map import Chart
from laisn.arrays import Bools, Floats
from sim.sensing.acoustics import TRANSMITTERS
from sim.trajectory import Trajectory

LEVEL_COLOUR, REAL_COLOUR, AWARE_COLOUR = SERIES[2], SERIES[1], SERIES[0]
"""Colours of the level leader, the real one, and of a follower that receives the leader's attitude."""
LEGEND = ((LEVEL_COLOUR, "level leader"), (REAL_COLOUR, "real leader"), (AWARE_COLOUR, "AHRS broadcast"))
CAUSE_COLOURS = {"trim": SERIES[0], "dive": SERIES[2], "waves": SERIES[1]}
ERROR_LEVELS_M = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
ERROR_COLOURS = ("#e8f1f8", "#c3dcee", "#8fbfdf", "#f3d19a", "#ea9a5c", "#d1602f", "#8e2a12")
"""Blue below half a metre, orange to brown above; the last for 4 m and more."""
_HULL_M = (2.0, 0.25)
"""Length and height."""


_TURN = np.linspace(0.0, 2.0 * np.pi, 181)


class Message(NamedTuple):
    """One message in the leader's own axes: forward, port and up of the level hull, from its origin, [m]."""

    pitch: float
    hydrophone: Floats
    transmitters: Floats
    """Rear and front, shape (2, 3)."""
    assumed: Floats
    """Where the follower assumes them, likewise."""

    @classmethod
    def of(cls, trajectory: Trajectory, step: int) -> Self:
        """Recorded point `step` of a trajectory, and its first follower."""
        pitch, heading = float(trajectory.pitch[step, 0]), float(trajectory.heading[step, 0])
        hydrophone = trajectory.site_position[step, trajectory.site(f"{trajectory.names[1]}/hydrophone")]
        east, north, up = hydrophone - trajectory.position[step, 0]
        own = np.sin(heading) * east + np.cos(heading) * north, np.sin(heading) * north - np.cos(heading) * east, up
        # rear and front are on the hull's axis
        level = trajectory.site_offset[[trajectory.site(name) for name in TRANSMITTERS[:2]]]
        tilted = level[:, :1] * np.array([np.cos(pitch), 0.0, np.sin(pitch)])
        return cls(pitch, np.array(own), tilted, level)

    @property
    def used_range(self) -> Floats:
        """Horizontal ranges that a noiseless follower computes, shape (2,), [m]."""
        slant = np.linalg.norm(self.transmitters - self.hydrophone, axis=1)
        return np.asarray(np.sqrt(np.maximum(slant**2 - self.hydrophone[2] ** 2, 0.0)))

    @property
    def fix(self) -> Floats:
        """Point where the circles about the assumed rear and front transmitter meet, (forward, port), [m]."""
        (rear, front), used = self.assumed[:, 0], self.used_range
        along = float((used[0] ** 2 - used[1] ** 2) / (2 * (front - rear)))
        aside = np.sqrt(max(used[0] ** 2 - (along - rear) ** 2, 0.0))
        return np.array([along, np.copysign(aside, self.hydrophone[1])])


def _scene(lines: Sequence[Line], points: Floats, pad: tuple[float, float], y_label: str, title: str) -> Panel:
    """A panel that shows some points and a margin about them, both axes to one scale."""
    (left, low), (right, high) = points.min(axis=0) - pad, points.max(axis=0) + pad
    return panel(
        lines, x_label="forward of the leader [m]", y_label=y_label, title=title, height=3.4, equal=True,
        x_limits=(left, right), y_limits=(low, high),
    )  # fmt: skip


def _hull(pitch: float, colour: Colour, dash: str = "-") -> Line:
    """Outline of the hull from the side."""
    forward, up = 0.5 * _HULL_M[0] * np.cos(_TURN), 0.5 * _HULL_M[1] * np.sin(_TURN)
    x, y = forward * np.cos(pitch) - up * np.sin(pitch), forward * np.sin(pitch) + up * np.cos(pitch)
    return Line(x=x, y=y, colour=colour, dash=dash, width=0.8)


def message_hull(message: Message) -> Panel:
    """The hull from the side: rays from bow and stern where they are, and where the follower assumes them."""
    lines = [_hull(0.0, LEVEL_COLOUR, "--"), _hull(message.pitch, FRAME)]
    for i, name in ((0, "stern"), (1, "bow")):
        for site, colour, dash in (
            (message.assumed[i], LEVEL_COLOUR, "--"),
            (message.transmitters[i], REAL_COLOUR, "-"),
        ):
            ray = np.stack([site, message.hydrophone])[:, [0, 2]]
            lines.append(Line(x=ray[:, 0], y=ray[:, 1], colour=colour, width=0.9, dash=dash))
            lines.append(Line(x=ray[:1, 0], y=ray[:1, 1], colour=colour, marker="o", size=4.0))
        x, _, z = message.transmitters[i]
        side = f"{'top' if z > 0 else 'bottom'} {'right' if x > 0 else 'left'}"
        lines[-1] = replace(lines[-1], text=f"{name} {100 * z:+.0f} cm", side=side)
    reach = np.array([(-2.1, -0.9), (2.1, 0.9)])
    return _scene(lines, reach, (0.0, 0.0), "up [m]", "Bow and stern from the side")


def message_top(message: Message) -> Panel:
    """View from above, to scale: the circles that the follower draws, and where they meet."""
    truth, fix = message.hydrophone[:2], message.fix
    reach, error = float(np.hypot(*truth)), float(np.hypot(*(fix - truth)))
    circles = [(message.assumed[i, :2], message.used_range[i], REAL_COLOUR, "-") for i in (0, 1)]
    lines = [_hull(0.0, FRAME)]
    for place, radius, colour, dash in (*circles, (np.zeros(2), reach, INK, ":")):
        x, y = place[0] + radius * np.cos(_TURN), place[1] + radius * np.sin(_TURN)
        lines.append(Line(x=x, y=y, colour=colour, dash=dash, width=0.8))
    # labels away from each other, across the ray
    left = fix[0] < truth[0]
    for text, at, side, colour, mark in (
        ("truth", truth, "right" if left else "left", LEVEL_COLOUR, "s"),
        (f"fix, {error:.2f} m off", fix, "left" if left else "right", REAL_COLOUR, "X"),
    ):
        lines.append(Line(x=np.array([0.0, at[0]]), y=np.array([0.0, at[1]]), colour=colour, width=0.7, dash="--"))
        lines.append(Line(x=at[:1], y=at[1:], colour=colour, marker=mark, size=5.0, text=text, side=f"middle {side}"))
    pad, points = (0.3 * reach, 0.12 * reach), np.array([truth, fix, (-1.5, 0.0), (1.5, 0.0)])
    return _scene(lines, points, pad, "port [m]", "From above, to scale")


def _heat(bearing_deg: Floats, range_m: Floats, error: Floats, title: str) -> Panel:
    """Position error over bearing, shape (b,), and range, shape (r,): error of shape (r, b), [m]."""
    around, closed = np.append(bearing_deg, bearing_deg[0] + 360.0), np.concatenate([error, error[:, :1]], axis=1)
    # bands of equal width to Plotly
    band = np.interp(closed, [*ERROR_LEVELS_M, 1e3], np.arange(len(ERROR_LEVELS_M) + 1))
    last = len(ERROR_LEVELS_M) - 1
    contours = {
        "type": "contour", "x": numbers(around), "y": numbers(range_m), "z": [numbers(row) for row in band],
        "customdata": [numbers(row) for row in closed],
        "hovertemplate": "%{x}°, %{y} m: %{customdata:.2f} m<extra></extra>",
        "contours": {"start": 1, "end": last, "size": 1, "showlines": False}, "line": {"width": 0},
        "colorscale": [[i / last, colour] for i, colour in enumerate(ERROR_COLOURS)],
        "colorbar": {"title": {"text": "[m]"}, "thickness": 10, "tickvals": [*range(1, last + 1)],
                     "ticktext": [f"{level:g}" for level in ERROR_LEVELS_M[1:]]},
    }  # fmt: skip
    return panel(
        [], x_label="bearing B of the follower [°]", y_label="range [m]", title=title, width=FULL / 2, height=3.4,
        traces=[contours], x_limits=(0.0, 360.0), x_ticks=range(0, 361, 45), y_log=True, y_ticks=(5, 10, 20, 50, 100),
        y_limits=(float(range_m[0]), float(range_m[-1])),
    )  # fmt: skip


def chosen(chart: Chart, **fixed: float) -> Bools:
    """Which points of the map have these values in its columns."""
    return np.all([np.isclose(chart[name], value) for name, value in fixed.items()], axis=0)  # type: ignore[no-any-return]


def around_leader(chart: Chart, depth_offset: float) -> Panel:
    """Errors of LAISN-2 around a leader pitched by 5°, from the map."""
    here = chosen(chart, pitch_deg=5.0, depth_offset_m=depth_offset)
    reach, bearing = np.unique(chart["range_m"][here]), np.unique(chart["bearing_deg"][here])
    error = chart["error_laisn-2_m"][here].reshape(reach.size, bearing.size)
    return _heat(bearing, reach, error, f"LAISN-2, pitch 5°, follower {depth_offset:g} m below")


def excess_over_lever(missions: Missions) -> Panel:
    """What pitch adds to the mean error of missions over Δz sin φ, both root mean square, and the line of equality."""
    top = max(m.lever for m in missions)
    equal = np.array([0.005, 1.1 * top])
    lines = [Line(x=equal, y=equal, colour=MUTED, dash="--")]
    for cause, colour in CAUSE_COLOURS.items():
        here = select(missions, cause=cause)
        lever, added = np.array([m.lever for m in here]), np.array([m.added for m in here])
        lines.append(
            Line(x=lever, y=np.maximum(added, 1e-3), colour=colour, marker="o", size=4.0, opacity=0.7, name=cause)
        )
    x_label, y_label = "Δz sin φ of the mission, rms [m]", "added to mean E_P [m]"
    return panel(
        lines, x_label=x_label, y_label=y_label, title="All missions, LAISN-2", height=2.8, x_log=True, y_log=True,
        x_limits=(0.005, 1.2 * top), y_limits=(9e-4, None),
    )  # fmt: skip


def over_offset(missions: Missions, title: str) -> Panel:
    """Mean position error of the median mission over the depth offset, by leader and with an AHRS."""
    offsets = sorted({m.real.depth_offset_m for m in missions})
    by_offset = [select(missions, depth_offset_m=offset) for offset in offsets]
    lines = []
    for arm, colour in ((LEVEL, LEVEL_COLOUR), (REAL, REAL_COLOUR), (AHRS, AWARE_COLOUR)):
        error = np.array([np.median([m.arms[arm.key].e_p_mean_m for m in here]) for here in by_offset])
        dash = "--" if arm is AHRS else "-"
        lines.append(Line(x=np.array(offsets), y=error, colour=colour, width=1.4, dash=dash))
        lines.append(Line(x=np.array(offsets), y=error, colour=colour, marker="o", name=arm.key))
    return panel(lines, x_label="depth offset [m]", y_label="mean E_P [m]", title=title, y_limits=(0.0, None))
