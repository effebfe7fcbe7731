"""Drawings of the pitch study: one message to scale, the map around the leader, errors over pitch, results."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse
from matplotlib.ticker import NullLocator

from experiments.pages.figures import Line, panel
from experiments.pages.style import FRAME, INK, MUTED, SERIES, Colour
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
_ERROR_LEVELS_M = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
_ERROR_COLOURS = ("#e8f1f8", "#c3dcee", "#8fbfdf", "#f3d19a", "#ea9a5c", "#d1602f", "#8e2a12")
"""Blue below half a metre, orange to brown above; the last for 4 m and more."""
_HULL_M = (2.0, 0.25)
"""Length and height."""


def _note(axes: Axes, text: str, at: Sequence[float], colour: Colour = INK, **style: object) -> None:
    axes.annotate(text, tuple(at), color=colour.placeholder, fontsize=7.5, **style)  # type: ignore[arg-type]


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


def _scene(points: Floats, pad: tuple[float, float], y_label: str, title: str) -> tuple[Figure, Axes]:
    """An empty panel that shows some points and a margin about them, both axes to one scale."""
    figure = panel([], x_label="forward of the leader [m]", y_label=y_label, title=title, height=3.0)
    (axes,) = figure.axes
    low, high = points.min(axis=0) - pad, points.max(axis=0) + pad
    size = np.array(axes.get_position().size) * figure.get_size_inches()
    half, middle = ((high - low) / size).max() * size / 2, (low + high) / 2
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal", adjustable="box")
    return figure, axes


def _hull(axes: Axes, pitch: float, colour: Colour, dash: str = "-") -> None:
    axes.add_patch(
        Ellipse(
            (0, 0), *_HULL_M, angle=float(np.rad2deg(pitch)), fill=dash == "-", facecolor=MUTED.placeholder,
            edgecolor=colour.placeholder, linestyle=dash, linewidth=0.8, alpha=0.6,
        )
    )  # fmt: skip


def message_hull(message: Message) -> Figure:
    """The hull from the side: rays from bow and stern where they are, and where the follower assumes them."""
    figure, axes = _scene(np.array([(-2.1, -0.9), (2.1, 0.9)]), (0.0, 0.0), "up [m]", "Bow and stern from the side")
    _hull(axes, 0.0, LEVEL_COLOUR, "--")
    _hull(axes, message.pitch, FRAME)
    for i, name in ((0, "stern"), (1, "bow")):
        for site, colour, dash in (
            (message.assumed[i], LEVEL_COLOUR, "--"),
            (message.transmitters[i], REAL_COLOUR, "-"),
        ):
            ray, edge = np.stack([site, message.hydrophone])[:, [0, 2]], colour.placeholder
            axes.plot(*ray.T, color=edge, linewidth=0.9, linestyle=dash, marker="o", markersize=4, markevery=[0])
        x, _, z = message.transmitters[i]
        at, side = (x + np.copysign(0.12, x), z + np.copysign(0.14, z)), "left" if x > 0 else "right"
        _note(axes, f"{name} {100 * z:+.0f} cm", at, REAL_COLOUR, ha=side, va="center", fontweight="bold")
    return figure


def message_top(message: Message) -> Figure:
    """View from above, to scale: the circles that the follower draws, and where they meet."""
    truth, fix = message.hydrophone[:2], message.fix
    reach, error = float(np.hypot(*truth)), float(np.hypot(*(fix - truth)))
    pad = (0.3 * reach, 0.12 * reach)
    figure, axes = _scene(np.array([truth, fix, (-1.5, 0.0), (1.5, 0.0)]), pad, "port [m]", "From above, to scale")
    circles = [(tuple(message.assumed[i, :2]), message.used_range[i], REAL_COLOUR, "-") for i in (0, 1)]
    for place, radius, colour, dash in (*circles, ((0, 0), reach, INK, ":")):
        edge = colour.placeholder
        axes.add_patch(Circle(place, radius, fill=False, linewidth=0.8, linestyle=dash, edgecolor=edge, alpha=0.8))
    _hull(axes, 0.0, FRAME)
    # labels away from each other, across the ray
    across = np.array([-truth[1], truth[0]]) / reach * np.sign(truth[0] * fix[1] - truth[1] * fix[0] or 1.0)
    for text, at, push, colour, mark in (
        ("truth", truth, -across, LEVEL_COLOUR, "s"), (f"fix, {error:.2f} m off", fix, across, REAL_COLOUR, "X"),
    ):  # fmt: skip
        axes.plot(*np.stack([np.zeros(2), at]).T, color=colour.placeholder, linewidth=0.7, linestyle="--")
        axes.plot(*at, marker=mark, markersize=5, color=colour.placeholder)
        _note(axes, text, at + 0.08 * reach * push, colour, ha="left" if push[0] > 0 else "right", va="center")
    return figure


def heat(bearing_deg: Floats, range_m: Floats, error: Floats, title: str) -> Figure:
    """Position error over bearing and range.

    Args:
        bearing_deg: shape (b,).
        range_m: shape (r,).
        error: shape (r, b), [m].
        title: of the panel.
    """
    figure = panel([], x_label="bearing B of the follower [°]", y_label="range [m]", title=title, height=2.6)
    (axes,) = figure.axes
    around, closed = np.append(bearing_deg, bearing_deg[0] + 360.0), np.concatenate([error, error[:, :1]], axis=1)
    drawn = axes.contourf(around, range_m, closed, levels=_ERROR_LEVELS_M, colors=_ERROR_COLOURS, extend="max")
    axes.set_yscale("log")
    axes.set_ylim(float(range_m[0]), float(range_m[-1]))
    axes.set_yticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_xlim(0, 360)
    axes.set_xticks(range(0, 361, 45))
    axes.grid(visible=False)
    left, bottom, _, height = axes.get_position().bounds
    axes.set_position((left, bottom, 0.72, height))
    key = figure.add_axes((left + 0.75, bottom, 0.03, height))
    figure.colorbar(drawn, cax=key, ticks=_ERROR_LEVELS_M, extendrect=True, extendfrac="auto", format="%g")
    key.set_title("[m]", fontsize=8, loc="left", pad=5, color=INK.placeholder)
    key.tick_params(length=0, labelcolor=INK.placeholder, labelsize=8)
    key.grid(visible=False)
    key.spines[:].set_visible(False)
    return figure


def chosen(chart: Chart, **fixed: float) -> Bools:
    """Which points of the map have these values in its columns."""
    return np.all([np.isclose(chart[name], value) for name, value in fixed.items()], axis=0)  # type: ignore[no-any-return]


def around_leader(chart: Chart, depth_offset: float) -> Figure:
    """Errors of LAISN-2 around a leader pitched by 5°, from the map."""
    here = chosen(chart, pitch_deg=5.0, depth_offset_m=depth_offset)
    reach, bearing = np.unique(chart["range_m"][here]), np.unique(chart["bearing_deg"][here])
    error = chart["error_laisn-2_m"][here].reshape(reach.size, bearing.size)
    return heat(bearing, reach, error, f"LAISN-2, pitch 5°, follower {depth_offset:g} m below")


def excess_over_lever(missions: Missions) -> Figure:
    """What pitch adds to the mean error of missions over Δz sin φ, both root mean square, and the line of equality."""
    top = max(m.lever for m in missions)
    equal = np.array([0.005, 1.1 * top])
    lines = [Line(x=equal, y=equal, colour=MUTED, dash="--")]
    for cause, colour in CAUSE_COLOURS.items():
        here = select(missions, cause=cause)
        lever, added = np.array([m.lever for m in here]), np.array([m.added for m in here])
        lines.append(Line(x=lever, y=np.maximum(added, 1e-3), colour=colour, marker="o", size=4.0, opacity=0.7))
    x_label, y_label = "Δz sin φ of the mission, rms [m]", "added to mean E_P [m]"
    figure = panel(lines, x_label=x_label, y_label=y_label, title="All missions, LAISN-2", height=2.8)
    (axes,) = figure.axes
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(0.005, 1.2 * top)
    axes.set_ylim(9e-4, None)
    return figure


def over_offset(missions: Missions, title: str) -> Figure:
    """Mean position error of the median mission over the depth offset, by leader and with an AHRS."""
    offsets = sorted({m.real.depth_offset_m for m in missions})
    by_offset = [select(missions, depth_offset_m=offset) for offset in offsets]
    lines = []
    for arm, colour in ((LEVEL, LEVEL_COLOUR), (REAL, REAL_COLOUR), (AHRS, AWARE_COLOUR)):
        error = np.array([np.median([m.arms[arm.key].e_p_mean_m for m in here]) for here in by_offset])
        dash = "--" if arm is AHRS else "-"
        lines.append(Line(x=np.array(offsets), y=error, colour=colour, width=1.4, dash=dash))
        lines.append(Line(x=np.array(offsets), y=error, colour=colour, marker="o"))
    return panel(lines, x_label="depth offset [m]", y_label="mean E_P [m]", title=title, y_limits=(0.0, None))
