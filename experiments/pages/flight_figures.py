"""The figures of one flight's report: each function draws one of them, for one follower or for all vehicles."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.flight.events import largest_sigma
from experiments.flight.summary import true_bearing
from experiments.pages.figures import Line, Part, panel, stack
from experiments.pages.style import ESTIMATE, FOLLOWER, FULL, HALF, INK, LEADER, MUTED, SERIES, TRANSMITTERS
from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS, FixKind
from sim.flight import Flight
from sim.station_keeping import LOST_M, off_station

SIGMAS = 2.0
"""Size of the drawn uncertainty in standard deviations of the filter."""
ON_AXIS_DEG = 15.0
"""Within this angle of the leader's axis, ahead or astern, ranges hardly determine the direction."""
ROW_HEIGHT, STACK_WIDTH, MAP_WIDTH = 4.1, 5.6, 3.3
"""Height of the panels of a follower's row, and widths of its errors over time and of its maps [inch]."""
_TRACK_POINTS = 1500
_DOTS = 1200
_LEAST_WEIGHT = 1e-3


def without_wraps(angle_deg: Floats) -> Floats:
    """A copy with NaN where an angle jumps between 0 and 360, so that no line crosses the panel; shape (n,)."""
    broken = angle_deg.copy()
    broken[1:][np.abs(np.diff(angle_deg)) > 180.0] = np.nan
    return broken


def bearing_part(time: Floats, bearing: Floats) -> Part:
    """B, shape (n,), [rad], over time [s]; darker ground where the follower is near the leader's axis."""
    shaded = [(0.0, ON_AXIS_DEG), (180.0 - ON_AXIS_DEG, 180.0 + ON_AXIS_DEG), (360.0 - ON_AXIS_DEG, 360.0)]
    angle = without_wraps(np.rad2deg(np.mod(bearing, 2 * np.pi)))
    lines, ticks = [Line(x=time, y=angle, colour=FOLLOWER, width=1.2)], (0, 90, 180, 270, 360)
    return Part(lines=lines, y_label="B [°]", y_limits=(0.0, 360.0), ticks=ticks, shaded=shaded)


def error_stack(flight: Flight, follower: int, errors: tuple[Floats, Floats], width: float = STACK_WIDTH) -> Figure:
    """E_P with the filter's own 2σ, E_B, and the bearing B, over time, each on its own axis.

    `errors` are E_P [m] and E_B [rad] at filter steps k = 1 … n, shapes (n,).
    """
    time = flight.trajectory.time[flight.step_index()]
    position, bearing = errors
    two_sigma = SIGMAS * largest_sigma(flight.estimates[follower].covariance)
    # beside a very large uncertainty the errors would be a flat line
    largest, widest = (float(np.nanmax(values, initial=0.0)) for values in (position, two_sigma))
    top = max(1.1 * largest, min(1.1 * widest, 3.0 * largest), 1e-3)
    sigma = Line(x=time, y=np.minimum(two_sigma, 2 * top), colour=INK, width=0.7)
    error = Line(x=time, y=position, colour=ESTIMATE)
    turn = Line(x=time, y=np.rad2deg(np.abs(bearing)), colour=ESTIMATE)
    parts = [
        Part(lines=[sigma, error], y_label="E_P, 2σ [m]", y_limits=(0.0, top)),
        Part(lines=[turn], y_label="E_B [°]", y_limits=(0.0, None)),
        bearing_part(time, true_bearing(flight, follower)),
    ]
    return stack(parts, x_label="time [s]", width=width, height=ROW_HEIGHT)


def position_errors(flight: Flight, errors: Sequence[Floats], worst: int) -> Figure:
    """Position errors of all followers over time, each of shape (n,), [m]; that of the follower `worst` on top."""
    time = flight.trajectory.time[flight.step_index()]
    others = [Line(x=time, y=error, colour=MUTED, width=0.6) for i, error in enumerate(errors) if i != worst]
    lines = [*others, Line(x=time, y=errors[worst], colour=ESTIMATE, width=1.2)]
    return panel(lines, x_label="time [s]", y_label="position error [m]", y_limits=(0.0, None), width=FULL)


def track_map(flight: Flight, followers: Sequence[int], width: float = MAP_WIDTH, height: float = ROW_HEIGHT) -> Figure:
    """True routes of the leader and of some followers from above, and their estimates."""
    steps = flight.step_index()
    every = slice(None, None, max(1, steps.size // _TRACK_POINTS))
    leader = flight.trajectory.position[steps[every], 0, :2]
    lines = [Line(x=leader[:, 0], y=leader[:, 1], colour=LEADER, width=1.4)]
    tracks = [(flight.hydrophone(i)[every, :2], flight.estimates[i].state[every, :2]) for i in followers]
    lines += [Line(x=truth[:, 0], y=truth[:, 1], colour=FOLLOWER, width=1.8) for truth, _ in tracks]
    lines += [Line(x=estimate[:, 0], y=estimate[:, 1], colour=ESTIMATE, width=0.7) for _, estimate in tracks]
    ends = [(leader, LEADER), *((truth, FOLLOWER) for truth, _ in tracks)]
    lines += [Line(x=track[-1:, 0], y=track[-1:, 1], colour=colour, marker="o", size=4.5) for track, colour in ends]
    return panel(lines, x_label="east [m]", y_label="north [m]", title="Routes", equal=True, width=width, height=height)


def difference(flight: Flight, follower: int) -> Figure:
    """Estimate minus truth, east and north, as dots; the cross in the middle is the truth."""
    away = flight.estimates[follower].state[:, :2] - flight.hydrophone(follower)[:, :2]
    some = away[:: max(1, len(away) // _DOTS)]
    origin = np.zeros(1)
    lines = [
        Line(x=some[:, 0], y=some[:, 1], colour=ESTIMATE, marker="o", size=2.2, opacity=0.45),
        Line(x=origin, y=origin, colour=FOLLOWER, marker="P", size=8.0),
    ]
    return panel(
        lines, x_label="east [m]", y_label="north [m]", title="Estimate less truth", equal=True, width=MAP_WIDTH,
        height=ROW_HEIGHT,
    )  # fmt: skip


def station_errors(flight: Flight, followers: Sequence[int]) -> list[Figure]:
    """Distance from the station over time, a panel for each of some followers on stations, all to one scale.

    A panel ends at the distance from which on a follower is lost.
    """
    truth = flight.trajectory
    off = off_station(flight.scenario, truth)[:, list(followers)]
    top = max(min(1.1 * float(np.nanmax(off, initial=0.0)), LOST_M), 1e-3)
    return [
        panel(
            [Line(x=truth.time, y=column, colour=FOLLOWER, width=1.2)],
            x_label="time [s]", y_label="off station [m]", title=truth.names[i + 1], y_limits=(0.0, top), height=1.9,
        )
        for i, column in zip(followers, off.T, strict=True)
    ]  # fmt: skip


def motion(flight: Flight) -> list[tuple[str, Figure]]:
    """Depth, pitch and speed through the water of all vehicles over time, with a name each."""
    truth = flight.trajectory
    deepest = float(truth.depth.max())
    quantities = (
        ("Depth", truth.depth, "depth [m]", (1.05 * deepest, min(0.0, float(truth.depth.min())))),
        ("Pitch", np.rad2deg(truth.pitch), "pitch, nose up [°]", (None, None)),
        ("Speed", truth.forward_speed, "through the water [m/s]", (None, None)),
    )
    colours = [LEADER, *[FOLLOWER] * (len(truth.names) - 1)]
    # the leader last, above the followers
    order, width, figures = [*range(1, len(truth.names)), 0], (FULL - 0.5) / 3, []
    for title, values, label, limits in quantities:
        lines = [Line(x=truth.time, y=values[:, v], colour=colours[v], width=0.9) for v in order]
        figure = panel(lines, x_label="time [s]", y_label=label, title=title, y_limits=limits, width=width)
        figures.append((title, figure))
    return figures


def ranges(flight: Flight, follower: int) -> Figure:
    """Measured slant ranges over time, of the transmitters that the variant uses."""
    measured = flight.measurements[follower]
    time = np.asarray(flight.trajectory.time[0] + measured.message_step * measured.dt, dtype=np.float64)
    used = reversed(range(flight.scenario.navigation.transmitters))
    lines = [Line(x=time, y=measured.ranges[:, j], colour=TRANSMITTERS[j], width=0.9) for j in used]
    return panel(lines, x_label="time [s]", y_label="slant range [m]", width=HALF)


def fixes(flight: Flight, follower: int) -> Figure:
    """A mark over time for every fix, in a row for each kind."""
    found, dt = flight.estimates[follower], flight.measurements[follower].dt
    kinds = sorted(set(found.fix_kind.tolist()))
    at = np.asarray(flight.trajectory.time[0] + found.fix_step * dt, dtype=np.float64)
    marks = []
    for row, kind in enumerate(kinds):
        failed, times = kind in (FixKind.GATED, FixKind.SINGULAR, FixKind.LOST), at[found.fix_kind == kind]
        colour = MUTED if failed else SERIES[row % len(SERIES)]
        marks.append(Line(x=times, y=np.full(times.size, float(row)), colour=colour, marker="|"))
    height, limits = 1.1 + 0.2 * len(kinds), (-0.6, len(kinds) - 0.4)
    figure = panel(marks, x_label="time [s]", y_label="", width=HALF, height=height, y_limits=limits)
    axes = figure.axes[0]
    # room for the names of the kinds
    left, bottom, across, high = axes.get_position().bounds
    axes.set_position((left + 0.25 / HALF, bottom, across - 0.25 / HALF, high))
    axes.set_yticks(range(len(kinds)), [FIX_WORDS[FixKind(kind)] for kind in kinds])
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    return figure


def error_and_bound(flight: Flight, follower: int, error: Floats, bound: Floats, width: float) -> Figure:
    """E_P of a follower, its standard deviation by the filter, and the bound over time; shapes (n,), [m]."""
    time, covariance = flight.trajectory.time[flight.step_index()], flight.estimates[follower].covariance
    lines = [
        Line(x=time, y=error, colour=ESTIMATE),
        Line(x=time, y=np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1]), colour=INK),
        Line(x=time, y=bound, colour=MUTED, width=1.6),
    ]
    name = flight.trajectory.names[follower + 1]
    return panel(lines, x_label="time [s]", y_label="position error [m]", title=name, width=width)


def hypothesis_weights(flight: Flight, follower: int, width: float) -> Figure | None:
    """Weights of a follower's hypotheses over time; None if no second one has a weight of at least 0.001."""
    estimates = flight.estimates[follower]
    weight = estimates.hypotheses.weight
    if np.all(weight[:, 1:] < _LEAST_WEIGHT):
        return None
    time = np.asarray(estimates.fix_step * flight.measurements[follower].dt, dtype=np.float64)
    lines = [Line(x=time, y=weight[:, h], colour=SERIES[h]) for h in range(weight.shape[1])]
    title = f"{flight.trajectory.names[follower + 1]}: hypotheses"
    return panel(lines, x_label="time [s]", y_label="weight", title=title, width=width)
