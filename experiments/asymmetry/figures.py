"""Drawings of the pitch study: one message to scale, the map around the leader, errors over pitch."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse
from matplotlib.ticker import FixedLocator

from experiments.pages.figures import Line, panel
from experiments.pages.style import FRAME, INK, MUTED, SERIES, Colour
from laisn.arrays import Floats
from sim.geometry import attitude
from sim.trajectory import Trajectory, leveled

LEVEL, REAL, AWARE = SERIES[2], SERIES[1], SERIES[0]
"""Colours of the level leader, the real one, and of a follower that knows the leader's attitude."""
ERROR_LEVELS_M = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
_ERROR_COLOURS = ("#e8f1f8", "#c3dcee", "#8fbfdf", "#f3d19a", "#ea9a5c", "#d1602f", "#8e2a12")
"""Blue below half a metre, orange to brown above; the last for 4 m and more."""
HULL_LENGTH_M, HULL_HEIGHT_M = 2.0, 0.25


def _axes(figure: Figure) -> Axes:
    return figure.axes[0]


def _note(axes: Axes, text: str, at: tuple[float, float], colour: Colour = INK, **style: object) -> None:
    axes.annotate(text, at, color=colour.placeholder, fontsize=7.5, **style)  # type: ignore[arg-type]


class Message:
    """One message in the leader's own axes: forward, port and up of the level hull, from its origin, [m]."""

    def __init__(self, trajectory: Trajectory, step: int, follower: int = 0) -> None:
        """Take recorded point `step` of a trajectory."""
        level = leveled(trajectory)
        name = trajectory.names[follower + 1]
        sites = [trajectory.site(f"leader/{site}") for site in ("tx_rear", "tx_front", "tx_middle")]
        origin, own = trajectory.position[step, 0], level.quaternion[step, 0] * np.array([1.0, -1.0, -1.0, -1.0])
        self.pitch = float(trajectory.pitch[step, 0])
        self.transmitter: Floats = attitude.rotate(own, trajectory.site_position[step, sites] - origin)
        self.assumed: Floats = attitude.rotate(own, level.site_position[step, sites] - origin)
        hydrophone = trajectory.site_position[step, trajectory.site(f"{name}/hydrophone")]
        self.hydrophone: Floats = attitude.rotate(own, hydrophone - origin)

    @property
    def used_range(self) -> Floats:
        """Horizontal ranges that a noiseless follower computes, shape (3,), [m]."""
        slant = np.linalg.norm(self.transmitter - self.hydrophone, axis=1)
        return np.asarray(np.sqrt(np.maximum(slant**2 - self.hydrophone[2] ** 2, 0.0)))

    @property
    def fix(self) -> Floats:
        """Point where the circles about the assumed rear and front transmitter meet, (forward, port), [m]."""
        rear, front = self.assumed[0, 0], self.assumed[1, 0]
        used = self.used_range
        along = float((used[0] ** 2 - used[1] ** 2) / (2 * (front - rear)))
        aside = np.sqrt(max(used[0] ** 2 - (along - rear) ** 2, 0.0))
        return np.array([along, np.copysign(aside, self.hydrophone[1])])


def _frame(figure: Figure, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Show at least these stretches, both axes to one scale."""
    axes = _axes(figure)
    _, _, width, height = axes.get_position().bounds
    wide, high = width * figure.get_figwidth(), height * figure.get_figheight()
    scale = max((x[1] - x[0]) / wide, (y[1] - y[0]) / high)
    axes.set_xlim(sum(x) / 2 - scale * wide / 2, sum(x) / 2 + scale * wide / 2)
    axes.set_ylim(sum(y) / 2 - scale * high / 2, sum(y) / 2 + scale * high / 2)
    axes.set_aspect("equal", adjustable="box")


def _hull(axes: Axes, pitch_deg: float, colour: Colour, dash: str = "-") -> None:
    axes.add_patch(
        Ellipse(
            (0, 0), HULL_LENGTH_M, HULL_HEIGHT_M, angle=pitch_deg, fill=dash == "-", facecolor=MUTED.placeholder,
            edgecolor=colour.placeholder, linestyle=dash, linewidth=0.8, alpha=0.6,
        )
    )  # fmt: skip


def _rays(axes: Axes, message: Message) -> None:
    """Rays from bow and stern in the side view: where they are, and where the follower believes them to be."""
    for i in (0, 1):
        for site, colour, dash, fill in (
            (message.assumed[i], LEVEL, "--", "none"),
            (message.transmitter[i], REAL, "-", REAL.placeholder),
        ):
            ray = np.stack([site, message.hydrophone])[:, [0, 2]]
            axes.plot(*ray.T, color=colour.placeholder, linewidth=0.9, linestyle=dash)
            axes.plot(*site[[0, 2]], marker="o", markersize=4, markerfacecolor=fill, color=colour.placeholder)


def message_side(message: Message) -> Figure:
    """Side view to scale: the pitched hull, its rays, and where the follower believes the transmitters are."""
    figure = panel([], x_label="forward of the leader [m]", y_label="up [m]", title="Seen from the side, to scale",
                   height=3.0)  # fmt: skip
    axes, (x, _, z) = _axes(figure), message.hydrophone
    _hull(axes, float(np.rad2deg(message.pitch)), FRAME)
    _rays(axes, message)
    axes.plot(x, z, marker="s", markersize=4.5, color=INK.placeholder)
    _note(axes, "hydrophone", (x, z - 0.7), ha="center", va="top")
    _frame(figure, (min(x, -1.2) - 2.5, max(x, 1.2) + 2.5), (min(z, 0.0) - 2.5, max(z, 0.0) + 1.5))
    return figure


def message_hull(message: Message) -> Figure:
    """A message drawn enlarged at the hull: how far bow and stern are from the depth that the follower assumes."""
    figure = panel([], x_label="forward of the leader [m]", y_label="up [m]", title="The hull, enlarged", height=3.0)
    axes = _axes(figure)
    _hull(axes, 0.0, LEVEL, "--")
    _hull(axes, float(np.rad2deg(message.pitch)), FRAME)
    _rays(axes, message)
    for i, name in ((0, "stern"), (1, "bow")):
        x, z = message.transmitter[i][[0, 2]]
        at = (x + np.copysign(0.12, x), z + np.copysign(0.14, z))
        text = f"{name} {100 * z:+.0f} cm"
        _note(axes, text, at, REAL, ha="left" if x > 0 else "right", va="center", fontweight="bold")
    _frame(figure, (-2.1, 2.1), (-0.9, 0.9))
    return figure


def message_top(message: Message) -> Figure:
    """View from above, to scale: the circles that the follower draws, and where they meet."""
    figure = panel([], x_label="forward of the leader [m]", y_label="port [m]", title="From above, to scale",
                   height=3.0)  # fmt: skip
    axes, truth, fix = _axes(figure), message.hydrophone[:2], message.fix
    for i in (0, 1):
        axes.add_patch(
            Circle(tuple(message.assumed[i, :2]), float(message.used_range[i]), fill=False, linewidth=0.8,
                   edgecolor=REAL.placeholder, alpha=0.8)
        )  # fmt: skip
    reach = float(np.hypot(*truth))
    axes.add_patch(Circle((0, 0), reach, fill=False, linewidth=0.8, linestyle=":", edgecolor=INK.placeholder))
    for bearing, colour in ((truth, LEVEL), (fix, REAL)):
        axes.plot(*np.stack([np.zeros(2), bearing]).T, color=colour.placeholder, linewidth=0.7, linestyle="--")
    _hull(axes, 0.0, FRAME)
    axes.plot(*truth, marker="s", markersize=4.5, color=LEVEL.placeholder)
    axes.plot(*fix, marker="X", markersize=5.5, color=REAL.placeholder)
    # labels away from each other, across the ray
    across = np.array([-truth[1], truth[0]]) / reach * np.sign(truth[0] * fix[1] - truth[1] * fix[0] or 1.0)
    error = float(np.hypot(*(fix - truth)))
    for text, at, push, colour in (("truth", truth, -across, LEVEL), (f"fix, {error:.2f} m off", fix, across, REAL)):
        place = at + 0.08 * reach * push
        _note(axes, text, (place[0], place[1]), colour, ha="left" if push[0] > 0 else "right", va="center")
    corners = np.stack([truth, fix, [-1.5, 0.0], [1.5, 0.0]])
    pad = 0.3 * reach
    _frame(figure, (corners[:, 0].min() - pad, corners[:, 0].max() + pad),
           (corners[:, 1].min() - 0.4 * pad, corners[:, 1].max() + 0.4 * pad))  # fmt: skip
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
    axes = _axes(figure)
    colours = ListedColormap(_ERROR_COLOURS)
    norm = BoundaryNorm(ERROR_LEVELS_M, len(_ERROR_COLOURS), extend="max")
    closed = np.concatenate([error, error[:, :1]], axis=1)
    axes.contourf(
        np.append(bearing_deg, bearing_deg[0] + 360.0), range_m, closed, levels=ERROR_LEVELS_M, cmap=colours, norm=norm,
        extend="max",
    )  # fmt: skip
    axes.set_yscale("log")
    axes.set_xlim(0, 360)
    axes.set_ylim(float(range_m[0]), float(range_m[-1]))
    axes.yaxis.set_major_locator(FixedLocator([5, 10, 20, 50, 100]))
    axes.yaxis.set_minor_locator(FixedLocator([]))
    axes.set_yticklabels(["5", "10", "20", "50", "100"])
    axes.xaxis.set_major_locator(FixedLocator(range(0, 361, 45)))
    axes.grid(visible=False)
    left, bottom, _, height = axes.get_position().bounds
    axes.set_position((left, bottom, 0.72, height))
    key = figure.add_axes((left + 0.75, bottom, 0.03, height))
    count = len(_ERROR_COLOURS)
    key.pcolormesh([0, 1], np.arange(count + 1), np.arange(count)[:, None], cmap=colours, vmin=0, vmax=count - 1)
    key.set_xticks([])
    key.yaxis.tick_right()
    key.set_yticks(range(count), [f"{level:g}" for level in ERROR_LEVELS_M])
    key.set_title("[m]", fontsize=8, loc="left", pad=5, color=INK.placeholder)
    key.tick_params(length=0, labelcolor=INK.placeholder, labelsize=8)
    for spine in key.spines.values():
        spine.set_visible(False)
    return figure


def over_pitch(pitch_deg: Floats, curves: Sequence[tuple[str, Floats, Floats, Colour]], title: str) -> Figure:
    """Error over pitch: closed form as a line, the engine's numbers as marks.

    Args:
        pitch_deg: shape (p,).
        curves: name, closed form and measured error, shape (p,) each, [m], and colour.
        title: of the panel.
    """
    lines = []
    for _, closed_form, measured, colour in curves:
        lines.append(Line(x=pitch_deg, y=closed_form, colour=colour))
        lines.append(Line(x=pitch_deg, y=measured, colour=colour, marker="o"))
    figure = panel(lines, x_label="pitch of the leader [°]", y_label="position error [m]", title=title)
    axes = _axes(figure)
    axes.margins(x=0.03)
    axes.set_xlim(float(pitch_deg[0]), float(pitch_deg[-1]) * 1.22)
    for name, closed_form, _, colour in curves:
        last = np.flatnonzero(np.isfinite(closed_form))[-1]
        _note(axes, f" {name}", (float(pitch_deg[last]), float(closed_form[last])), colour, va="center")
    return figure


def pitch_over_time(time: Floats, pitch_deg: Floats, title: str) -> Figure:
    """Pitch of the leader over time, shape (n,), [s] and [°]."""
    return panel(
        [Line(x=time, y=pitch_deg, colour=INK, width=0.8)], x_label="time [s]", y_label="pitch [°]", title=title
    )


def excess_over_lever(groups: Sequence[tuple[Floats, Floats, Colour]], title: str) -> Figure:
    """Excess of the mean error over Δz sin φ of each mission, both root mean square, with the line of equality.

    Args:
        groups: lever arm and excess of missions, shape (n,) each, [m], and the colour of their cause.
        title: of the panel.
    """
    top = max(float(lever.max()) for lever, _, _ in groups)
    equal = np.array([0.005, 1.1 * top])
    lines = [Line(x=equal, y=equal, colour=MUTED, dash="--")]
    lines += [Line(x=lever, y=np.maximum(excess, 1e-3), colour=colour, marker="o") for lever, excess, colour in groups]
    figure = panel(
        lines, x_label="Δz sin φ of the mission, rms [m]", y_label="excess of mean E_P [m]", title=title, height=2.8
    )
    axes = _axes(figure)
    axes.set_xscale("log")
    axes.set_yscale("log")
    for drawn in axes.lines[1:]:
        drawn.set_markersize(4)
        drawn.set_alpha(0.7)
    axes.set_xlim(0.005, 1.2 * top)
    axes.set_ylim(9e-4, None)
    return figure


def over_offset(curves: Sequence[tuple[Floats, Floats, Colour]], title: str) -> Figure:
    """Mean position error over the depth offset: offsets and errors of shape (o,), [m], with their colours."""
    lines = []
    for offset, error, colour in curves:
        lines.append(Line(x=offset, y=error, colour=colour, width=1.2))
        lines.append(Line(x=offset, y=error, colour=colour, marker="o"))
    return panel(lines, x_label="depth offset [m]", y_label="mean E_P [m]", title=title, y_limits=(0.0, None))


def removed_shares(arms: Sequence[tuple[str, Floats, Colour]], title: str) -> Figure:
    """Share of the pitch-driven error that each remedy removes: a mark for each mission.

    Args:
        arms: label, shares of shape (n,), and colour.
        title: of the panel.
    """
    lines = []
    for i, (_, share, colour) in enumerate(arms):
        # spread over the row in the order of missions, so that marks do not hide each other
        row = len(arms) - 1 - i + np.linspace(-0.28, 0.28, share.size)
        lines.append(Line(x=np.clip(share, -1.0, 1.1), y=row, colour=colour, marker="o"))
    figure = panel(lines, x_label="share of the pitch-driven error removed", y_label="", title=title, height=2.6)
    axes = _axes(figure)
    left, bottom, width, height = axes.get_position().bounds
    axes.set_position((left + 0.2, bottom, width - 0.2, height))
    for drawn in axes.lines:
        drawn.set_alpha(0.6)
    axes.set_xlim(-1.05, 1.12)
    axes.set_xticks([-1, -0.5, 0, 0.5, 0.9, 1], ["−1 or less", "−0.5", "0", "0.5", "0.9", "1"], fontsize=7)
    axes.set_yticks(range(len(arms)), [label for label, _, _ in reversed(arms)])
    axes.tick_params(axis="y", length=0)
    return figure
