"""The report of one flight: routes, errors of the estimates, and their causes; the prose stands
in its template.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from laisn import POSITION, metrics
from laisn.arrays import Bools, Floats
from laisn.estimates import FIX_WORDS, FixKind
from laisn.messages import Ranges
from laisn.metrics import normalised_errors
from laisn.navigators import title_of
from laisn.spilled import release_mapped_memory
from reports import flight_figures, style
from reports.bound import flight_bounds
from reports.figures import Line, Panel, panel
from reports.flight_figures import ON_AXIS_DEG, SIGMAS
from reports.headline import CONSISTENT_OUTSIDE_SHARE, headline, navigators, on_stations, tiles
from reports.page import (
    Code,
    Figures,
    Film,
    PageTable,
    Replay,
    TableCell,
    number,
    page_of,
    words,
    write,
)
from reports.range_budget import (
    LABELS,
    NO_BUDGET,
    Cause,
    RangeErrorBudget,
    range_error_budget,
)
from reports.scene.mission import Scene, scene_of
from reports.summary import (
    approach_events,
    flight_events,
    mirror_locked_steps,
    route_events,
    true_bearing,
)
from reports.verdict import verdict
from sim.flight import FlightRecord
from sim.log.writer import Event
from sim.scenario.parts import MotionSettings
from sim.scenario.section import split_unit
from sim.sensing.proximity import sightings
from sim.tracking import LOST_M, closest_approaches, contacts, track_errors
from sim.trajectory import blocks

_CAUSES = (
    Cause.RANDOM,
    Cause.LEVER_ARM,
    Cause.MOTION,
    Cause.DEPTH,
    Cause.FORESHORTENING,
    Cause.ECHO,
)
CAUSE_COLOURS = dict(zip(_CAUSES, style.SERIES, strict=True))
"""Colours of causes that affect bow and stern differently; clock and sound speed affect both
(nearly) alike.
"""
_NOTICEABLE_M = 1e-6  # causes whose shares never exceed it have no effect
_BUDGET_FOLLOWERS = 3  # followers whose range error budget is shown


def _rms(values: Floats) -> float:
    """Root mean square of finite values, shape (n,); NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else np.nan


def _largest(values: Floats) -> float:
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else np.nan


def share_table(budget: RangeErrorBudget, caption: str = "", transmitters: int = 3) -> PageTable:
    """RMS of each cause's share in the range errors of so many transmitters, and in the
    asymmetry of bow and stern.
    """
    at_work = [c for c in Cause if _largest(budget.share[..., c]) > _NOTICEABLE_M]
    asymmetry = budget.asymmetry
    errors = {c: [_rms(budget.share[:, i, c]) for i in range(transmitters)] for c in at_work}
    rows = [
        [
            words(LABELS[c]),
            *(
                number(100 * e, 1)
                for e in (*errors[c], _rms(asymmetry[:, c]), _largest(asymmetry[:, c]))
            ),
        ]
        for c in at_work
    ]
    idle = ", ".join(LABELS[cause] for cause in Cause if cause not in at_work)
    return PageTable(
        heads=("cause", *Ranges._fields[:transmitters], "rms", "largest"),
        rows=rows,
        groups=(
            ("", 1),
            ("share of the range error, rms [cm]", transmitters),
            ("front less rear [cm]", 2),
        ),
        caption=f"{caption}Each range error is the exact sum of these shares."
        + (f" Without effect here: {idle}." if idle else ""),
    )


def asymmetry_over_time(
    time: Floats, shares: dict[Cause, Floats], title: str, width: float = style.WIDTH
) -> Panel:
    """Shares of causes in D_front − D_rear over time, of shape (m,), [m]; width in [inch]."""
    lines = [
        Line(x=time, y=100.0 * share, colour=CAUSE_COLOURS[cause], width=0.8, name=LABELS[cause])
        for cause, share in shares.items()
    ]
    return panel(
        lines, x_label="time [s]", y_label="in D_front − D_rear [cm]", title=title, width=width
    )


def legend_of(causes: Sequence[Cause]) -> list[tuple[style.Colour, str]]:
    return [(CAUSE_COLOURS[cause], LABELS[cause]) for cause in causes]


def range_budget(flight: FlightRecord) -> dict[str, Any]:
    """Range error budgets for the template: followers without a ping (`silent`), figure and
    tables.
    """
    names = flight.trajectory.names[1:]
    silent = list[str]()
    causes = set[Cause]()
    panels = list[Panel]()
    tables = list[PageTable]()
    width = style.FULL if len(names) == 1 else style.HALF
    for i, name in enumerate(names[:_BUDGET_FOLLOWERS]):
        budget = range_error_budget(flight, i)
        if not np.isfinite(budget.error).any():
            silent.append(name)
            continue
        title = name if len(names) > 1 else ""
        shares = {
            cause: share
            for cause in CAUSE_COLOURS
            if _largest(share := budget.asymmetry[:, cause]) > _NOTICEABLE_M
        }
        causes |= set(shares)
        panels.append(asymmetry_over_time(budget.time, shares, title, width))
        used = flight.scenario.navigation_of(i).transmitters
        tables.append(share_table(budget, f"{name}. " if len(names) > 1 else "", used))
    legend = legend_of([cause for cause in CAUSE_COLOURS if cause in causes])
    return {
        "silent": silent,
        "no_budget": NO_BUDGET,
        "figure": Figures(panels=panels, legend=legend) if panels else None,
        "note": ""
        if len(names) <= _BUDGET_FOLLOWERS
        else f" The first {_BUDGET_FOLLOWERS} of {len(names)} followers.",
        "tables": tables,
    }


SIDE_M = 1.0
"""Least distance of estimate and truth from the leader's axis, on opposite sides, at which the
side is wrong [m].
"""


class _Judged(NamedTuple):
    """A follower's estimates at n filter steps."""

    error: Floats  # distance from the truth, shape (n,), [m]
    # as of `accuracy`, shapes (n,)
    near_axis: Bools
    wrong_side: Bools
    outside: Bools


def _judged(flight: FlightRecord, follower: int, part: slice) -> _Judged:
    """Estimates at a part of the filter steps beside the truth and the leader's axis."""
    steps = flight.step_index()[part]
    estimates = flight.estimates[follower]
    trajectory = flight.trajectory
    truth = trajectory.site_path(f"{trajectory.names[follower + 1]}/hydrophone", steps)[:, :2]
    leader = trajectory.position[steps, 0, :2]
    heading = trajectory.heading[steps, 0]
    estimate = estimates.state[part, :2]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    true_side, estimated_side = (
        np.einsum("ni,ni->n", point - leader, starboard) for point in (truth, estimate)
    )
    nearer = np.minimum(np.abs(true_side), np.abs(estimated_side))
    wrong_side = (nearer >= SIDE_M) & (true_side * estimated_side < 0)
    folded = np.mod(true_bearing(flight, follower, part), np.pi)
    near_axis = np.minimum(folded, np.pi - folded) < np.radians(ON_AXIS_DEG)
    error = estimate - truth
    square = normalised_errors(error, estimates.covariance[part, POSITION, POSITION])
    # with a singular covariance any error is outside
    outside = np.where(np.isnan(square), np.any(estimate != truth, axis=1), square > SIGMAS**2)
    return _Judged(np.hypot(*error.T), near_axis, wrong_side, outside)


def accuracy(flight: FlightRecord, follower: int) -> dict[str, float]:
    """Errors of a follower's estimate at the filter steps with an estimate, [m], and shares of
    these steps, 0 … 1.

    `mean`, `sigma`, `high` (95 % are below) and `largest`: of the error [m]; `largest_s`: when it
    is largest [s]; `outside`: the truth is outside the filter's own 2σ ellipse; `near_axis`: the
    follower is near the leader's axis, ahead or astern, with mean errors there and elsewhere [m];
    `wrong_side`: the estimate is across that axis.
    """
    time = flight.trajectory.time[flight.step_index()]
    parts = [_judged(flight, follower, block) for block in blocks(time.size)]
    error, near_axis, wrong_side, outside = map(np.concatenate, zip(*parts, strict=True))
    # with an unknown start there is no estimate before the first messages
    finite = np.isfinite(error)
    error = error[finite]
    near_axis = near_axis[finite]
    wrong_side = wrong_side[finite]
    outside = outside[finite]
    k = int(error.argmax())
    return {
        "mean": float(error.mean()),
        "sigma": float(error.std()),
        "high": float(np.percentile(error, 95)),
        "largest": float(error[k]),
        "largest_s": float(time[finite][k]),
        "outside": float(outside.mean()),
        "near_axis": float(near_axis.mean()),
        "mean_near": float(error[near_axis].mean()) if near_axis.any() else np.nan,
        "mean_elsewhere": float(error[~near_axis].mean()) if not near_axis.all() else np.nan,
        "wrong_side": float(wrong_side.mean()),
    }


Errors = Sequence[tuple[Floats, Floats]]
"""E_P [m] and E_B [rad] of every follower at filter steps k = 1 … n, shapes (n,)."""

DRAWN_FOLLOWERS = 12  # followers with figures of their own; tables and the map have all of them
_IN_DEGREES = {
    "compass_bias_rad": "compass_bias_deg",
    "leader_compass_bias_rad": "leader_compass_bias_deg",
}
TRACK_LEGEND = (
    (style.LEADER, "leader"),
    (style.FOLLOWER, "follower"),
    (style.ESTIMATE, "estimate"),
)


def _drawn(flight: FlightRecord) -> range:
    return range(min(len(flight.estimates), DRAWN_FOLLOWERS))


def follower_curves(
    flight: FlightRecord, follower: int, errors: tuple[Floats, Floats], bound: Floats
) -> Figures:
    """Curves of a follower over time; if there are several followers, estimate minus truth beside
    them.
    """
    used = range(flight.scenario.navigation_of(follower).transmitters)
    has_bound = bool(np.isfinite(bound).any())
    panels = [flight_figures.over_time(flight, follower, errors, bound if has_bound else None)]
    if len(flight.estimates) > 1:
        panels.append(flight_figures.difference(flight, follower))
    return Figures(
        panels=panels,
        title=flight.trajectory.names[follower + 1] if len(flight.estimates) > 1 else "",
        legend=[
            (style.ESTIMATE, "E_P and E_B"),
            (style.FOLLOWER, "B"),
            (style.INK, "2σ by the filter; dotted: its RMS error"),
            *([(style.MUTED, "Cramér–Rao bound of the RMS error")] if has_bound else []),
            *(
                (style.TRANSMITTERS[j], f"range from the {Ranges._fields[j]} transmitter")
                for j in used
            ),
        ],
    )


def _curves(
    flight: FlightRecord, follower: int, errors: tuple[Floats, Floats], bound: Floats
) -> Figures:
    """`follower_curves`; the memory of arrays in files is released after it."""
    curves = follower_curves(flight, follower, errors, bound)
    release_mapped_memory()
    return curves


class FinalState(NamedTuple):
    """A bias, current or offset as a navigator has it after the last message, in the unit of its
    label.
    """

    value: float
    sigma: float

    @property
    def cell(self) -> TableCell:
        """Both, for a table of several followers."""
        return TableCell(
            text=f"{number(self.value).text} ± {number(self.sigma).text}", sort=self.value
        )


def final_states(flight: FlightRecord) -> dict[str, dict[str, FinalState]]:
    """Final estimates of biases, current and offsets by followers and by their names with units,
    where a navigator has them.
    """
    states = dict[str, dict[str, FinalState]]()
    for i in _drawn(flight):
        of_follower = dict[str, FinalState]()
        for name, value, sigma in flight.estimates[i].further_states():
            if np.isfinite(value):
                scale = 180.0 / np.pi if name in _IN_DEGREES else 1.0
                quantity, unit, _ = split_unit(_IN_DEGREES.get(name, name))
                label = f"{quantity.replace('_', ' ')} [{unit}]"
                of_follower[label] = FinalState(scale * value, scale * sigma)
        if of_follower:
            states[flight.trajectory.names[i + 1]] = of_follower
    return states


def states_table(states: Mapping[str, Mapping[str, FinalState]]) -> PageTable:
    """Final states: of one follower a row each, of several a column each."""
    caption = "Estimates of sensor errors and current after the last message, with their σ."
    if len(states) == 1:
        (of_follower,) = states.values()
        rows = [
            [words(label), number(state.value), number(state.sigma)]
            for label, state in of_follower.items()
        ]
        return PageTable(heads=["state", "estimate", "σ"], rows=rows, caption=caption)
    labels = [*dict.fromkeys(label for of_follower in states.values() for label in of_follower)]
    rows = list[list[TableCell]]()
    for name, of_follower in states.items():
        cells = [
            of_follower[label].cell if label in of_follower else number(None) for label in labels
        ]
        rows.append([words(name), *cells])
    return PageTable(heads=["follower", *labels], rows=rows, caption=caption)


def mirror_locks(flight: FlightRecord, names: Sequence[str]) -> dict[str, float]:
    """Shares of the time in which estimates of these followers are at the mirror image, above 0
    [%].
    """
    steps = {
        name: mirror_locked_steps(flight, flight.trajectory.names.index(name) - 1) for name in names
    }
    return {name: 100 * float(np.mean(locked)) for name, locked in steps.items() if locked.any()}


def _facts(flight: FlightRecord, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    scenario = flight.scenario
    timing = f"{scenario.timing.filter_step_s:g} s, {scenario.timing.message_interval_s:g} s"
    followers = len(scenario.followers)
    return [
        ("Vehicles", f"a leader and {followers} follower{'s' if followers > 1 else ''}"),
        ("Navigator", navigators(flight)),
        ("Seed, run", f"{scenario.seed}, {scenario.run}"),
        ("Motion", scenario.motion),
        ("Flown", f"{flight.trajectory.time[-1]:g} s"),
        ("Filter step, message interval", timing),
        (
            "Version",
            ", ".join(f"{k} {v}" for k, v in list(summary.get("versions", {}).items())[:3]),
        ),
        ("Repeat with", "laisn fly scenario.toml"),
    ]


def leader_values(flight: FlightRecord, summary: Mapping[str, Any]) -> dict[str, Any] | None:
    """The leader's own estimate for the template; None: it has no navigator."""
    figure = flight_figures.leader_error(flight)
    navigation = flight.scenario.leader.navigation
    if figure is None or navigation is None:
        return None
    legend = [(style.LEADER, "E_P of the leader"), (style.INK, "2σ by the filter")]
    return {
        "figure": Figures(panels=[figure], legend=legend),
        "navigator": title_of(navigation.variant),
        "row": summary["leader"],
    }


def _overview(flight: FlightRecord, errors: Errors) -> Figures:
    """Position errors of all followers, that with the largest error drawn on top of the others."""
    positions = [position for position, _ in errors]
    worst = max(range(len(positions)), key=lambda i: float(np.nanmax(positions[i], initial=0.0)))
    chart = flight_figures.position_errors(flight, positions, worst)
    name = flight.trajectory.names[worst + 1]
    legend = [(style.ESTIMATE, name), (style.MUTED, "other followers")]
    return Figures(panels=[chart], legend=legend)


def _segments(summary: Mapping[str, Any]) -> list[float]:
    """Lengths of segments that a follower's path holds [m]."""
    rows = [row.get("relative_errors", ()) for row in summary["followers"].values()]
    return sorted({row["length_m"] for of_follower in rows for row in of_follower})


def _drifts(row: Mapping[str, Any], lengths: Sequence[float]) -> list[float | None]:
    """RMS of a follower's relative error over segments of these lengths; None where its path holds
    none.
    """
    by_length = {drift["length_m"]: drift["rms_m"] for drift in row.get("relative_errors", ())}
    return [by_length.get(length) for length in lengths]


def _fix_kinds(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Kinds of fix that any follower had: name in the summary, and words."""
    counts = [row.get("fixes", {}) for row in summary["followers"].values()]
    return [
        (kind.name.lower(), FIX_WORDS[kind])
        for kind in FixKind
        if any(of_follower.get(kind.name.lower()) for of_follower in counts)
    ]


def _current(flight: FlightRecord) -> Figures | None:
    """The current along the tracks, where it is not the same everywhere and always."""
    if not flight_figures.has_current(flight):
        return None
    vehicles = [0, *(i + 1 for i in _drawn(flight))]
    return Figures(panels=[flight_figures.current(flight, vehicles)], legend=TRACK_LEGEND[:2])


def _tracks(flight: FlightRecord) -> Figures:
    """The map of the mission; beside it, if there is one follower, estimate minus truth."""
    everyone = range(len(flight.estimates))
    maps = [flight_figures.track_map(flight, everyone, link="follower0")]
    if len(everyone) == 1:
        maps.append(flight_figures.difference(flight, 0, maps[0].height))
    arrows = [(style.SERIES[0], "current")] if flight_figures.has_current(flight) else []
    return Figures(panels=maps, legend=[*TRACK_LEGEND, *arrows])


def _stations(flight: FlightRecord, with_station: Sequence[int]) -> Figures | None:
    """Distances of followers, by index, from their stations; None without any."""
    if not with_station:
        return None
    panels = flight_figures.station_errors(flight, with_station)
    return Figures(panels=panels, legend=TRACK_LEGEND[1:2])


def scene_of_flight(flight: FlightRecord, events: Sequence[Event] | None = None) -> Scene:
    """The flight in 3D with its `flight_events`, computed here if None."""
    mirror_locked = [mirror_locked_steps(flight, i) for i in range(len(flight.estimates))]
    return scene_of(flight, flight_events(flight) if events is None else events, mirror_locked)


def _with_estimates(flight: FlightRecord) -> tuple[list[str], list[str]]:
    """Names of followers whose estimates are finite from the first one on, and of those whose are
    not; neither has those that never have one.
    """
    estimated = list[str]()
    not_finite = list[str]()
    for name, estimates in zip(flight.trajectory.names[1:], flight.estimates, strict=True):
        state = estimates.state[estimates.steps_without_estimate :]
        if len(state):
            (estimated if np.isfinite(state).all() else not_finite).append(name)
    return estimated, not_finite


def flight_report(
    flight: FlightRecord,
    errors: Errors,
    summary: Mapping[str, Any],
    path: Path,
    film: Path | None,
    bounds: Sequence[Floats] | None = None,
    events: Sequence[Event] | None = None,
) -> None:
    """Write the report of a flight beside its film (MP4) and log; `bounds` as of `summarise`,
    `events` as of `scene_of_flight`; OSError if that fails.
    """
    bounds_by_follower = bounds or flight_bounds(flight)
    names = flight.trajectory.names[1:]
    estimated, not_finite = _with_estimates(flight)
    gave_way_s = sightings(MotionSettings.of(flight.scenario), flight.trajectory).detected_s
    with_station = [i for i in _drawn(flight) if flight.scenario.followers[i].station]
    overview = _overview(flight, errors) if len(names) > 1 else None
    release_mapped_memory()
    accuracies = {}
    if not not_finite:
        accuracies = {name: accuracy(flight, names.index(name)) for name in estimated}
    release_mapped_memory()
    judgement = verdict(flight, track_errors(MotionSettings.of(flight.scenario), flight.trajectory))
    segments = _segments(summary)
    states = final_states(flight)
    values: dict[str, Any] = {
        "flight": flight,
        "headline": headline(flight, judgement, summary, accuracies),
        "verdict": judgement,
        "followers": len(names),
        "drawn": len(_drawn(flight)),
        "events": [*route_events(flight), *approach_events(flight)],
        "nearest": closest_approaches(flight.trajectory) if with_station else (),
        "gave_way": {name: s for name, s in zip(names, gave_way_s.tolist(), strict=True) if s > 0},
        "contacts": contacts(flight.trajectory),
        "without_estimate": flight.without_estimate,
        "not_finite": not_finite,
        "mirror_locked": mirror_locks(flight, estimated),
        "mirror_lock_error_m": metrics.MIRROR_LOCK_ERROR,
        "overview": overview,
        "accuracies": accuracies,
        "consistent": CONSISTENT_OUTSIDE_SHARE,
        "side_m": SIDE_M,
        "lost_m": LOST_M,
        "films": [Film(path=film, caption="The film of the mission.")] if film else [],
        "summaries": summary["followers"],
        "segments": segments,
        "drifts": {name: _drifts(row, segments) for name, row in summary["followers"].items()},
        "kinds": _fix_kinds(summary),
        "has_stations": on_stations(summary),
        "number": number,
        "words": words,
        "on_axis_deg": f"{ON_AXIS_DEG:g}",
        "has_bound": any(np.isfinite(bound).any() for bound in bounds_by_follower),
        "curves": [_curves(flight, i, errors[i], bounds_by_follower[i]) for i in _drawn(flight)],
        "states": states_table(states) if states else None,
        "leader": leader_values(flight, summary),
        "budget": range_budget(flight),
        "map": _tracks(flight),
        "stations": _stations(flight, with_station),
        "motion": Figures(panels=[flight_figures.motion(flight)], legend=TRACK_LEGEND[:2]),
        "current": _current(flight),
        "has_waves": flight.scenario.ocean.waves.kind != "none",
        "scenario": Code(text=flight.scenario.toml(), title="scenario.toml", folded=True),
    }
    release_mapped_memory()
    facts = _facts(flight, summary)
    replay = Replay(
        scene=scene_of_flight(flight, events), alternative=f"Mission {flight.scenario.name}"
    )
    page = page_of(
        "reports",
        facts,
        values,
        name="flight_report.md.j2",
        tiles=tiles(summary, accuracies),
        replay=replay,
    )
    write(page, path)
