"""Figures of one flight's report; panels of one follower share a time cursor."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS, FixKind
from laisn.messages import Ranges
from reports.figures import DRAWN_POINTS, Line, Panel, Subplot, panel
from reports.style import (
    ESTIMATE,
    FOLLOWER,
    FULL,
    HALF,
    INK,
    LEADER,
    MUTED,
    SERIES,
    TRANSMITTERS,
)
from reports.summary import largest_sigma, true_bearing
from sim.flight import FlightRecord, leader_errors
from sim.scenario.parts import MotionSettings
from sim.tracking import LOST_M, off_station

SIGMAS = 2.0  # size of the drawn uncertainty in standard deviations of the filter
# within this angle of the leader's axis, ahead or astern, ranges hardly determine the direction
ON_AXIS_DEG = 15.0
ROW_HEIGHT = 5.6  # of a follower's figures [inch]
STACK_WIDTH = 8.6  # of the curves of a follower among several [inch]
DIFFERENCE_WIDTH = FULL - STACK_WIDTH - 0.2  # of estimate minus truth beside them [inch]
_MAP_HEIGHTS = (2.8, 6.4)  # least and largest height of a map [inch]
_MARGINS = (0.65, 0.6)  # of a map's axes, across and up [inch]
_TRACK_POINTS = 4000  # most points of all tracks of a map
_DOTS = 1200  # most dots of estimate minus truth, of all followers
_FEW_POINTS = 240  # points of a line of a follower among several, so that the page stays small
_MIN_WEIGHT = 1e-3  # hypotheses that never have so much are not drawn
_ARROWS = 14  # of the current, along each track
_ARROW_VEHICLES = 4  # with such arrows
_LONGEST_ARROW = 0.1  # of the map
_COMPASS = (0, 90, 180, 270, 360)  # ticks of an axis of directions [°]


def without_wraps(angle_deg: Floats) -> Floats:
    """A copy with NaN where an angle jumps between 0 and 360, so that no line crosses the panel;
    shape (n,).
    """
    broken = angle_deg.copy()
    broken[1:][np.abs(np.diff(angle_deg)) > 180.0] = np.nan
    return broken


def bearing_part(time: Floats, bearing: Floats) -> Subplot:
    """B, shape (n,), [rad], over time [s]; darker ground where the follower is near the leader's
    axis.
    """
    shaded = [
        (0.0, ON_AXIS_DEG),
        (180.0 - ON_AXIS_DEG, 180.0 + ON_AXIS_DEG),
        (360.0 - ON_AXIS_DEG, 360.0),
    ]
    angle = without_wraps(np.rad2deg(np.mod(bearing, 2 * np.pi)))
    lines = [Line(x=time, y=angle, colour=FOLLOWER, width=1.2, name="bearing")]
    return Subplot(
        lines=lines, y_label="B [°]", y_limits=(0.0, 360.0), ticks=_COMPASS, shaded=shaded
    )


def error_parts(
    flight: FlightRecord, follower: int, errors: tuple[Floats, Floats], bound: Floats | None
) -> list[Subplot]:
    """E_P with the filter's 2σ, its RMS error by the filter and the bound; E_B; and the bearing B,
    over time.

    `errors` are E_P [m] and E_B [rad] at filter steps k = 1 … n, and `bound` is that of the RMS
    error [m], shapes (n,); None: there is none.
    """
    time = flight.trajectory.time[flight.step_index()]
    covariance = flight.estimates[follower].covariance
    position, bearing = errors
    two_sigma = SIGMAS * largest_sigma(covariance)
    # beside a very large uncertainty the errors would be a flat line
    largest, widest_sigma = (
        float(np.nanmax(values, initial=0.0)) for values in (position, two_sigma)
    )
    top = max(1.1 * largest, min(1.1 * widest_sigma, 3.0 * largest), 1e-3)
    lines = [
        Line(
            x=time, y=np.minimum(two_sigma, 2 * top), colour=INK, width=0.7, name="2σ by the filter"
        )
    ]
    if bound is not None:
        rms = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1])
        lines += [
            Line(
                x=time,
                y=np.minimum(rms, 2 * top),
                colour=INK,
                width=0.7,
                dash=":",
                name="RMS by the filter",
            ),
            Line(x=time, y=bound, colour=MUTED, width=1.6, name="Cramér–Rao bound"),
        ]
    lines.append(Line(x=time, y=position, colour=ESTIMATE, name="E_P"))
    bearing_line = Line(x=time, y=np.rad2deg(np.abs(bearing)), colour=ESTIMATE, name="E_B")
    return [
        Subplot(lines=lines, y_label="E_P [m]", y_limits=(0.0, top), height=1.6),
        Subplot(lines=[bearing_line], y_label="E_B [°]", y_limits=(0.0, None)),
        bearing_part(time, true_bearing(flight, follower)),
    ]


def over_time(
    flight: FlightRecord, follower: int, errors: tuple[Floats, Floats], bound: Floats | None
) -> Panel:
    """Errors, bearing, measured ranges, kinds of fix, and the weights of hypotheses if there
    ever were several.
    """
    parts = [
        *error_parts(flight, follower, errors, bound),
        ranges_part(flight, follower),
        fixes_part(flight, follower),
    ]
    weights = weights_part(flight, follower)
    time = flight.trajectory.time[flight.step_index()]
    return Panel(
        parts=[*parts, weights] if weights else parts,
        x_label="time [s]",
        x_limits=(0.0, float(time[-1])),
        width=FULL if len(flight.estimates) == 1 else STACK_WIDTH,
        height=ROW_HEIGHT,
        link=f"follower{follower}",
        points=DRAWN_POINTS if len(flight.estimates) == 1 else _FEW_POINTS,
    )


def leader_error(flight: FlightRecord) -> Panel | None:
    """E_P of the leader's own estimate with its filter's 2σ over time; None: it has no
    navigator.
    """
    position = leader_errors(flight)
    if flight.leader is None or flight.leader.estimates is None or position is None:
        return None
    time = flight.trajectory.time[flight.step_index()]
    two_sigma = SIGMAS * largest_sigma(flight.leader.estimates.covariance)
    top = 3.0 * max(float(np.nanmax(position, initial=0.0)), 1e-3)
    lines = [
        Line(x=time, y=np.minimum(two_sigma, top), colour=INK, width=0.7, name="2σ by the filter"),
        Line(x=time, y=position, colour=LEADER, name="E_P of the leader"),
    ]
    return panel(lines, x_label="time [s]", y_label="E_P [m]", width=FULL)


def fitted_height(lines: Sequence[Line], width: float) -> float:
    """Height of a map of a width in which its lines fill the box, [inch]."""
    spans = []
    for values in ([line.x for line in lines], [line.y for line in lines]):
        finite = np.concatenate(values)
        finite = finite[np.isfinite(finite)]
        spans.append(float(np.ptp(finite)) if finite.size else 0.0)
    across, up = spans
    low, high = _MAP_HEIGHTS
    if across <= 0.0:
        return high if up > 0.0 else low
    return min(max((width - _MARGINS[0]) * up / across + _MARGINS[1], low), high)


def position_errors(flight: FlightRecord, errors: Sequence[Floats], worst: int) -> Panel:
    """Position errors of all followers over time, each of shape (n,), [m]; that of the follower
    `worst` on top.
    """
    time = flight.trajectory.time[flight.step_index()]
    names = flight.trajectory.names[1:]
    lines = [
        Line(x=time, y=error, colour=MUTED, width=0.6, name=names[i])
        for i, error in enumerate(errors)
        if i != worst
    ]
    lines.append(Line(x=time, y=errors[worst], colour=ESTIMATE, width=1.2, name=names[worst]))
    return panel(
        lines,
        x_label="time [s]",
        y_label="position error [m]",
        y_limits=(0.0, None),
        width=FULL,
        height=3.2,
    )


def current_arrows(place: Floats, velocity: Floats, scale: float) -> Line:
    """Arrows of velocities, shape (n, 2), [m/s], from places, shape (n, 2), [m]; `scale` is the
    length of an arrow for 1 m/s [m].
    """
    arrow = scale * velocity
    normal = np.column_stack([-arrow[:, 1], arrow[:, 0]])
    tip = place + arrow
    barbs = [tip - 0.3 * arrow + side * normal for side in (0.15, -0.15)]
    gap = np.full(place.shape, np.nan)
    points = np.stack([place, tip, barbs[0], tip, barbs[1], gap], axis=1).reshape(-1, 2)
    return Line(x=points[:, 0], y=points[:, 1], colour=SERIES[0], width=1.2, name="current")


def has_current(flight: FlightRecord) -> bool:
    """Whether vehicles flew in a current that is read from a file, of a class of the user's, or
    not the same everywhere and always.
    """
    ocean = flight.scenario.ocean
    varies = bool(ocean.current_profile) or ocean.current_shear_per_s != 0.0
    moves = ocean.current is not None or varies
    return moves and flight.scenario.motion == "physics"


def _arrows_along(flight: FlightRecord, vehicles: Sequence[int]) -> Line:
    """The current that vehicles met, at some of their places; the longest arrow is a tenth of the
    map.
    """
    truth = flight.trajectory
    instants = np.linspace(0, truth.time.size - 1, _ARROWS).astype(int)
    tails = np.concatenate([truth.position[instants, v, :2] for v in vehicles])
    velocity = np.concatenate([truth.water_velocity[instants, v, :2] for v in vehicles])
    fastest = float(np.hypot(*velocity.T).max())
    extent = float(np.ptp(truth.position[:, vehicles, :2], axis=(0, 1)).max())
    return current_arrows(tails, velocity, _LONGEST_ARROW * extent / max(fastest, 1e-9))


def current(flight: FlightRecord, vehicles: Sequence[int]) -> Panel:
    """Speed and direction of the water at vehicles over time."""
    truth = flight.trajectory
    lines: tuple[list[Line], list[Line]] = ([], [])
    for v in (*(v for v in vehicles if v), 0):
        east, north = truth.water_velocity[:, v, :2].T
        towards = without_wraps(np.rad2deg(np.arctan2(east, north)) % 360.0)
        line_style: dict[str, Any] = {"colour": FOLLOWER if v else LEADER, "width": 0.9}
        line_style |= {"x": truth.time, "name": truth.names[v]}
        lines[0].append(Line(y=np.hypot(east, north), **line_style))
        lines[1].append(Line(y=towards, **line_style))
    parts = [
        Subplot(lines=lines[0], y_label="current [m/s]", y_limits=(0.0, None)),
        Subplot(lines=lines[1], y_label="towards [°]", y_limits=(0.0, 360.0), ticks=_COMPASS),
    ]
    return Panel(parts=parts, x_label="time [s]", width=FULL, height=3.4, link="follower0")


def track_map(
    flight: FlightRecord,
    followers: Sequence[int],
    width: float = HALF,
    link: str = "",
) -> Panel:
    """True routes of the leader and of some followers from above, and their estimates, in a box
    that they fill.
    """
    steps = flight.step_index()
    thinned = slice(None, None, max(1, steps.size * (len(flight.estimates) + 2) // _TRACK_POINTS))
    time = flight.trajectory.time[steps[thinned]]
    names = flight.trajectory.names[1:]
    tracks = [(flight.trajectory.position[steps[thinned], 0, :2], LEADER, 1.4, "leader")]
    tracks += [(flight.hydrophone(i)[thinned, :2], FOLLOWER, 1.8, names[i]) for i in followers]
    estimates = [
        (flight.estimates[i].state[thinned, :2], ESTIMATE, 0.7, f"estimate of {names[i]}")
        for i in followers
    ]
    lines = [
        Line(x=track[:, 0], y=track[:, 1], colour=colour, width=thick, name=name, time=time)
        for track, colour, thick, name in (*tracks, *estimates)
    ]
    lines += [
        Line(x=t[-1:, 0], y=t[-1:, 1], colour=colour, marker="o", size=4.5)
        for t, colour, *_ in tracks
    ]
    if has_current(flight):
        lines.append(_arrows_along(flight, [0, *(i + 1 for i in followers)][:_ARROW_VEHICLES]))
    size: dict[str, Any] = {"width": width, "height": fitted_height(lines, width), "link": link}
    return panel(
        lines, x_label="east [m]", y_label="north [m]", title="Routes", equal_scales=True, **size
    )


def difference(flight: FlightRecord, follower: int, height: float = ROW_HEIGHT) -> Panel:
    """Estimate minus truth, east and north, as dots; the cross in the middle is the truth."""
    errors = flight.estimates[follower].state[:, :2] - flight.hydrophone(follower)[:, :2]
    thinned = slice(None, None, max(1, len(errors) * len(flight.estimates) // _DOTS))
    origin = np.zeros(1)
    dots = errors[thinned]
    time = flight.trajectory.time[flight.step_index()[thinned]]
    lines = [
        Line(
            x=dots[:, 0],
            y=dots[:, 1],
            colour=ESTIMATE,
            marker="o",
            opacity=0.45,
            name="difference",
            time=time,
        ),
        Line(x=origin, y=origin, colour=FOLLOWER, marker="P", size=8.0),
    ]
    return panel(
        lines,
        x_label="east [m]",
        y_label="north [m]",
        title="Estimate minus truth",
        equal_scales=True,
        width=HALF if len(flight.estimates) == 1 else DIFFERENCE_WIDTH,
        height=height,
        link=f"follower{follower}",
    )


def station_errors(flight: FlightRecord, followers: Sequence[int]) -> list[Panel]:
    """Distance from the station over time, up to that of a lost follower, a panel for each, all
    to one scale.
    """
    truth = flight.trajectory
    station_errors = off_station(MotionSettings.of(flight.scenario), truth)[:, list(followers)]
    top = max(min(1.1 * float(np.nanmax(station_errors, initial=0.0)), LOST_M), 1e-3)
    return [
        panel(
            [Line(x=truth.time, y=column, colour=FOLLOWER, width=1.2, name=truth.names[i + 1])],
            x_label="time [s]",
            y_label="off station [m]",
            title=truth.names[i + 1],
            y_limits=(0.0, top),
            height=1.9,
        )
        for i, column in zip(followers, station_errors.T, strict=True)
    ]


def motion(flight: FlightRecord) -> Panel:
    """Depth, pitch and speed through the water of all vehicles over time."""
    truth = flight.trajectory
    deepest = float(truth.depth.max())
    quantities = (
        (truth.depth, "depth [m]", (1.05 * deepest, min(0.0, float(truth.depth.min())))),
        (np.rad2deg(truth.pitch), "pitch [°]", (None, None)),
        (truth.forward_speed, "speed [m/s]", (None, None)),
    )
    # the leader last, above the followers
    order = [*range(1, len(truth.names)), 0]
    parts = []
    for values, label, limits in quantities:
        lines = [
            Line(
                x=truth.time,
                y=values[:, v],
                colour=FOLLOWER if v else LEADER,
                width=0.9,
                name=truth.names[v],
            )
            for v in order
        ]
        parts.append(Subplot(lines=lines, y_label=label, y_limits=limits))
    return Panel(parts=parts, x_label="time [s]", width=FULL, height=5.2, link="follower0")


def ranges_part(flight: FlightRecord, follower: int) -> Subplot:
    """Measured slant ranges over time, of the transmitters that the variant uses."""
    measurements = flight.measurements[follower]
    time = np.asarray(
        flight.trajectory.time[0] + measurements.message_step * measurements.dt, dtype=np.float64
    )
    used = reversed(range(flight.scenario.navigation_of(follower).transmitters))
    lines = [
        Line(
            x=time,
            y=measurements.ranges[:, j],
            colour=TRANSMITTERS[j],
            width=0.9,
            name=f"{Ranges._fields[j]} range",
        )
        for j in used
    ]
    return Subplot(lines=lines, y_label="ranges [m]")


def fixes_part(flight: FlightRecord, follower: int) -> Subplot:
    """A mark over time for every fix, in a row for each kind."""
    estimates = flight.estimates[follower]
    dt = flight.measurements[follower].dt
    kinds = [FixKind(kind) for kind in sorted(set(estimates.fix_kind.tolist()))]
    time = np.asarray(flight.trajectory.time[0] + estimates.fix_step * dt, dtype=np.float64)
    marks = []
    for row, kind in enumerate(kinds):
        failed = kind in (FixKind.GATED, FixKind.SINGULAR, FixKind.LOST)
        times = time[estimates.fix_kind == kind]
        colour = MUTED if failed else SERIES[row % len(SERIES)]
        y = np.full(times.size, float(row))
        marks.append(Line(x=times, y=y, colour=colour, marker="|"))
    ticks = {float(row): FIX_WORDS[kind] for row, kind in enumerate(kinds)}
    return Subplot(
        lines=marks,
        y_label="fixes",
        y_limits=(-0.6, max(len(kinds), 1) - 0.4),
        ticks=ticks,
        height=0.7,
    )


def weights_part(flight: FlightRecord, follower: int) -> Subplot | None:
    """Weights of a follower's hypotheses over time; None if no second one has a weight of at
    least 0.001.
    """
    estimates = flight.estimates[follower]
    weight, _, _ = estimates.hypotheses
    if np.all(weight[:, 1:] < _MIN_WEIGHT):
        return None
    dt = flight.measurements[follower].dt
    time = np.asarray(flight.trajectory.time[0] + estimates.fix_step * dt, dtype=np.float64)
    weighty = [h for h in range(weight.shape[1]) if weight[:, h].max() >= _MIN_WEIGHT]
    lines = [
        Line(
            x=time,
            y=weight[:, h],
            colour=SERIES[h % len(SERIES)],
            dash="-" if h < len(SERIES) else "--",
            name=f"hypothesis {h + 1}",
        )
        for h in weighty
    ]
    return Subplot(lines=lines, y_label="weights", y_limits=(0.0, 1.05))
