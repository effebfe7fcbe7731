"""The pictures of the glossary: leader, transmitters, circles of ranges, estimate and mirror
image from above; and errors beside the covariance that a filter states, and the bound.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from laisn.arrays import Floats
from reports.style import FRAME, INK, SERIES

# the leader is at the origin and heads north, up on the picture
_HALF_BASELINE = 1.0  # [m], drawn larger than the project's
_TRUTH = np.array([5.6, -4.6])  # place of the follower: east, north [m]
_ESTIMATE_ERROR = np.array([-1.3, -1.1])  # of the estimate from the truth [m]
_ERROR_COUNT = (
    120  # drawn of a filter whose errors have a standard deviation of 1 m along each axis
)
_SIGMA_OF_BOUND = 0.7  # [m]


def _point(
    axes: Axes, position: Floats, words: str, colour: str, offset: tuple[float, float]
) -> None:
    axes.plot(*position, "o", color=colour, markersize=5)
    axes.annotate(
        words,
        tuple(position),
        xytext=offset,
        textcoords="offset points",
        color=colour,
        fontsize=8.5,
    )


def picture() -> Figure:
    """A leader that heads north, seen from above, with a follower astern and to starboard of it."""
    figure = Figure(figsize=(6.2, 4.2))
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set_axis_off()
    ink = INK.light
    truth_colour, estimate_colour, mirror_colour = (colour.light for colour in SERIES[:3])
    # the leader and its axis
    axes.plot([0, 0], [-8.2, 3.2], "--", color=FRAME.light, linewidth=0.8)
    axes.annotate("leader's axis", (0.1, 2.6), color=ink, fontsize=8)
    axes.plot([0, 0], [-1.6, 1.6], "-", color=ink, linewidth=5, solid_capstyle="round", alpha=0.35)
    rear = np.array([0.0, -_HALF_BASELINE])
    front = np.array([0.0, _HALF_BASELINE])
    _point(axes, front, "front transmitter", ink, (-98, 6))
    _point(axes, rear, "rear transmitter", ink, (-94, -13))
    axes.annotate(
        "", (-0.7, front[1]), (-0.7, rear[1]), arrowprops={"arrowstyle": "<->", "color": ink}
    )
    axes.annotate("baseline", (-0.9, 0.0), ha="right", va="center", color=ink, fontsize=8)
    # circles of the two ranges, which meet at the truth and at its mirror image
    for transmitter in (rear, front):
        radius = float(np.hypot(*(_TRUTH - transmitter)))
        angle = np.linspace(np.deg2rad(205), np.deg2rad(335), 200)
        axes.plot(
            transmitter[0] + radius * np.cos(angle),
            transmitter[1] + radius * np.sin(angle),
            color=FRAME.light,
            linewidth=0.7,
        )
    mirror = _TRUTH * (-1.0, 1.0)
    estimate = _TRUTH + _ESTIMATE_ERROR
    _point(axes, _TRUTH, "truth", truth_colour, (7, 2))
    _point(axes, estimate, "estimate", estimate_colour, (-6, -14))
    _point(axes, mirror, "mirror image", mirror_colour, (-68, -12))
    axes.plot(*np.transpose([_TRUTH, estimate]), color=estimate_colour, linewidth=1.4)
    axes.annotate(
        "E_P",
        0.5 * (_TRUTH + estimate),
        xytext=(5, -8),
        textcoords="offset points",
        color=estimate_colour,
    )
    # bearings from the leader
    for position, colour in ((_TRUTH, truth_colour), (estimate, estimate_colour)):
        axes.plot(*np.transpose([[0, 0], position]), color=colour, linewidth=0.7)
    _arc(axes, 4.2, _TRUTH, estimate, estimate_colour, "E_B")
    _arc(axes, 1.9, np.array([0.0, 1.0]), _TRUTH, truth_colour, "B")
    axes.set_xlim(-8.5, 8.5)
    axes.set_ylim(-8.1, 3.2)
    return figure


def consistency() -> Figure:
    """Errors of a filter that states its covariance right, and of one that states it too small, by
    their NEES; beside them the least covariance that any filter can have.
    """
    figure = Figure(figsize=(6.2, 3.1), layout="constrained")
    truth_colour, stated_colour, bound_colour = (colour.light for colour in SERIES[:3])
    errors = np.random.default_rng(1).standard_normal((_ERROR_COUNT, 2))
    for axes, nees in zip(figure.subplots(1, 2), (2.0, 10.0), strict=True):
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_xlim(-3.9, 3.9)
        axes.set_ylim(-3.4, 3.4)
        axes.set_title(f"NEES {nees:g}, error {1.0 / _SIGMA_OF_BOUND:.1f} × bound", fontsize=9)
        axes.plot(*errors.T, ".", color=FRAME.light, markersize=4)
        axes.plot(0.0, 0.0, "o", color=truth_colour, markersize=5)
        axes.annotate("truth", (0.1, 0.12), color=truth_colour, fontsize=8)
        # of two dimensions: NEES = 2 (σ of the errors / σ stated)²
        ratio = (2.0 / nees) ** 0.5
        circles = (
            (ratio, stated_colour, "-", "2σ as the filter states it", 2.75),
            (_SIGMA_OF_BOUND, bound_colour, "--", "2σ of the bound", -3.1),
        )
        for sigma, colour, dash, words, height in circles:
            circle = Circle((0.0, 0.0), 2.0 * sigma, fill=False, color=colour, linestyle=dash)
            axes.add_patch(circle)
            axes.annotate(words, (0.0, height), ha="center", color=colour, fontsize=8)
    return figure


def _arc(axes: Axes, radius: float, start: Floats, end: Floats, colour: str, words: str) -> None:
    """An arc about the leader from one direction to another, with its name at the middle."""
    first, last = (np.arctan2(position[0], position[1]) for position in (start, end))
    angle = np.linspace(first, last, 60)
    axes.plot(radius * np.sin(angle), radius * np.cos(angle), color=colour, linewidth=0.9)
    middle = 0.5 * (first + last)
    position = (1.12 * radius * np.sin(middle), 1.12 * radius * np.cos(middle))
    axes.annotate(words, position, ha="center", va="center", color=colour, fontsize=8.5)
