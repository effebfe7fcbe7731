"""The report of one flight: routes, errors of the estimates, and their causes; the prose stands in templates."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from experiments.flight.range_budget import LABELS, Cause, RangeErrorBudget, range_error_budget
from experiments.flight.summary import approach_events, flight_bounds, mirror_locked_steps, route_events, true_bearing
from experiments.pages import flight_figures, style
from experiments.pages.figures import Line, Panel, panel
from experiments.pages.flight_figures import ON_AXIS_DEG, SIGMAS
from experiments.pages.page import Cell, Code, Figures, Film, Table, number, page_of, paragraphs, words, write
from laisn import metrics
from laisn.arrays import Bools, Floats
from laisn.estimates import FIX_WORDS, FixKind
from laisn.messages import Ranges
from laisn.metrics import longest_mirror_lock, nees
from laisn.navigators import find
from sim.flight import Flight
from sim.sensing.observation import sightings
from sim.tracking import closest_approaches, contacts, off_station, station_keeping

_CAUSES = (Cause.RANDOM, Cause.LEVER_ARM, Cause.MOTION, Cause.DEPTH, Cause.FORESHORTENING, Cause.ECHO)
COLOUR = dict(zip(_CAUSES, style.SERIES, strict=True))
"""Colours of causes that affect bow and stern differently; clock and sound speed affect both (nearly) alike."""
_NOTICEABLE_M = 1e-6
_DRAWN_FOLLOWERS = 3


def _rms(values: Floats) -> float:
    """Root mean square of finite values, shape (n,); NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else np.nan


def _largest(values: Floats) -> float:
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else np.nan


def share_table(budget: RangeErrorBudget, caption: str = "", transmitters: int = 3) -> Table:
    """RMS of each cause's share in the range errors of so many transmitters, and in the asymmetry of bow and stern."""
    at_work, apart = [c for c in Cause if _largest(budget.share[..., c]) > _NOTICEABLE_M], budget.asymmetry
    errors = {c: [_rms(budget.share[:, i, c]) for i in range(transmitters)] for c in at_work}
    rows = [
        [words(LABELS[c]), *(number(100 * e, 1) for e in (*errors[c], _rms(apart[:, c]), _largest(apart[:, c])))]
        for c in at_work
    ]
    idle = ", ".join(LABELS[cause] for cause in Cause if cause not in at_work)
    return Table(
        heads=("cause", *Ranges._fields[:transmitters], "rms", "largest"),
        rows=rows,
        groups=(("", 1), ("share of the range error, rms [cm]", transmitters), ("front less rear [cm]", 2)),
        caption=f"{caption}Each range error is the exact sum of these shares."
        + (f" Without effect here: {idle}." if idle else ""),
    )


def asymmetry_over_time(time: Floats, shares: dict[Cause, Floats], title: str, width: float = style.WIDTH) -> Panel:
    """Shares of causes in D_front − D_rear over time, of shape (m,), [m]; width in [inch]."""
    lines = [
        Line(x=time, y=100.0 * share, colour=COLOUR[cause], width=0.8, name=LABELS[cause])
        for cause, share in shares.items()
    ]
    return panel(lines, x_label="time [s]", y_label="in D_front − D_rear [cm]", title=title, width=width)


def legend_of(causes: Sequence[Cause]) -> list[tuple[style.Colour, str]]:
    return [(COLOUR[cause], LABELS[cause]) for cause in causes]


def range_budget(flight: Flight) -> dict[str, Any]:
    """Range error budgets for the template: followers without a ping, figure and tables."""
    names, used = flight.trajectory.names[1:], flight.scenario.navigation.transmitters
    silent, drawn, panels, tables = list[str](), set[Cause](), list[Panel](), list[Table]()
    width = style.FULL if len(names) == 1 else style.HALF
    for i, name in enumerate(names[:_DRAWN_FOLLOWERS]):
        budget = range_error_budget(flight, i)
        if not np.isfinite(budget.error).any():
            silent.append(name)
            continue
        title = name if len(names) > 1 else ""
        shares = {cause: share for cause in COLOUR if _largest(share := budget.asymmetry[:, cause]) > _NOTICEABLE_M}
        drawn |= set(shares)
        panels.append(asymmetry_over_time(budget.time, shares, title, width))
        tables.append(share_table(budget, f"{name}. " if len(names) > 1 else "", used))
    legend = legend_of([cause for cause in COLOUR if cause in drawn])
    return {
        "silent": silent,
        "figure": Figures(panels=panels, legend=legend) if panels else None,
        "first": "" if len(names) <= _DRAWN_FOLLOWERS else f" The first {_DRAWN_FOLLOWERS} of {len(names)} followers.",
        "tables": tables,
    }


SIDE_M = 1.0
"""Least distance of estimate and truth from the leader's axis, on opposite sides, at which the side is wrong [m]."""
CONSISTENT_SHARE = float(np.exp(-(SIGMAS**2) / 2))
"""Share of errors outside the 2σ ellipse of a consistent filter (Rayleigh distribution)."""
_RARE = 0.02


class EstimateErrors(NamedTuple):
    """One follower's estimate compared with the truth, at the n filter steps with an estimate; arrays of shape (n,)."""

    time: Floats
    error: Floats
    bearing: Floats
    """B, in [0, 2π) [rad]."""
    distance: Floats
    wrong_side: Bools
    """Whether the estimate is on the wrong side of the leader's axis."""
    outside: Bools
    """Whether the truth is outside the filter's own 2σ ellipse."""
    kind: Floats

    @property
    def on_axis(self) -> Bools:
        """Whether the follower is near the leader's axis, ahead or astern."""
        folded = np.mod(self.bearing, np.pi)
        return np.asarray(np.minimum(folded, np.pi - folded) < np.radians(ON_AXIS_DEG))


def estimate_errors(flight: Flight, follower: int) -> EstimateErrors:
    """Errors of a follower's estimate, and its true place relative to the leader."""
    steps, found = flight.step_index(), flight.estimates[follower]
    truth, leader = flight.hydrophone(follower)[:, :2], flight.trajectory.position[steps, 0, :2]
    heading = flight.trajectory.heading[steps, 0]
    starboard = np.column_stack([np.cos(heading), -np.sin(heading)])
    estimate = found.state[:, :2]
    side, estimated_side = (np.einsum("ni,ni->n", point - leader, starboard) for point in (truth, estimate))
    clear = np.minimum(np.abs(side), np.abs(estimated_side)) >= SIDE_M
    square, error = nees(found, truth), np.hypot(*(estimate - truth).T)
    # with an unknown start there is no estimate before the first messages
    known = np.isfinite(error)
    return EstimateErrors(
        time=flight.trajectory.time[steps][known],
        error=error[known],
        bearing=true_bearing(flight, follower)[known],
        distance=np.hypot(*(truth - leader).T)[known],
        wrong_side=(clear & (side * estimated_side < 0))[known],
        # with a singular covariance any error is outside
        outside=np.where(np.isnan(square), np.any(estimate != truth, axis=1), square > SIGMAS**2)[known],
        kind=found.fix_kind.astype(np.float64),
    )


def errors_by_name(flight: Flight) -> dict[str, EstimateErrors]:
    """Errors of all followers; none if an estimate is not finite."""
    if not all(np.isfinite(e.state[e.unknown :]).all() for e in flight.estimates):
        return {}
    return {name: estimate_errors(flight, i) for i, name in enumerate(flight.trajectory.names[1:])}


def percent(share: float) -> str:
    """A share in per cent, without decimals from 10 % on; only exact shares are 0 % or 100 %."""
    if 0 < share < 0.001:
        return "less than 0.1\N{NO-BREAK SPACE}%"
    if 0.999 < share < 1:
        return "more than 99.9\N{NO-BREAK SPACE}%"
    return f"{100 * share:.{0 if share >= 0.0995 else 1}f}\N{NO-BREAK SPACE}%"


def _metres(value: float) -> str:
    return f"{value:.{2 if value < 9.995 else 1}f}\N{NO-BREAK SPACE}m"


def size_numbers(errors: Mapping[str, EstimateErrors]) -> dict[str, Any]:
    """Mean errors of the best and the worst follower, and the largest error with its time and place."""
    means = {name: float(one.error.mean()) for name, one in errors.items()}
    best, worst = min(means, key=means.__getitem__), max(means, key=means.__getitem__)
    name, one = max(errors.items(), key=lambda item: float(item[1].error.max()))
    k = int(one.error.argmax())
    return {
        "followers": len(errors), "several": len(errors) > 1, "best": best, "worst": worst,
        "least_mean": means[best], "greatest_mean": means[worst], "largest": float(one.error[k]), "largest_of": name,
        "largest_s": float(one.time[k]), "largest_distance": float(one.distance[k]),
        "largest_bearing_deg": float(np.degrees(one.bearing[k])),
    }  # fmt: skip


def error_numbers(one: EstimateErrors) -> dict[str, Any]:
    """Time near the leader's axis, kinds of fix, time on the wrong side, and time outside the 2σ ellipse."""
    near, on_axis = one.on_axis, float(one.on_axis.mean())
    split = _RARE <= on_axis <= 1 - _RARE
    kinds, counts = np.unique(one.kind, return_counts=True)
    order, wrong = np.argsort(-counts, kind="stable"), bool(one.wrong_side.any())
    step = float(one.time[1] - one.time[0] if one.time.size > 1 else one.time[0])
    return {
        "axis_deg": f"{ON_AXIS_DEG:g}", "on_axis": on_axis,
        "error_on_axis": float(one.error[near].mean()) if split else None,
        "error_off_axis": float(one.error[~near].mean()) if split else None,
        "fixes": one.kind.size,
        "kinds": [f"{FIX_WORDS[FixKind(int(kinds[i]))]} {percent(float(counts[i]) / one.kind.size)}" for i in order],
        "side_m": f"{SIDE_M:g}", "wrong_side": float(one.wrong_side.mean()),
        "wrong_first_s": float(one.time[int(one.wrong_side.argmax())]) if wrong else None,
        "wrong_longest_s": longest_mirror_lock(one.wrong_side) * step if wrong else None,
        "outside": float(one.outside.mean()), "consistent_outside": CONSISTENT_SHARE,
    }  # fmt: skip


def motion_numbers(flight: Flight) -> dict[str, Any]:
    """Unusual events, station errors from the smallest, closest approaches, and followers that gave way."""
    truth = flight.trajectory
    off, spent = off_station(flight.scenario, truth), sightings(flight.scenario, truth).spent_s
    kept = {
        truth.names[i + 1]: station_keeping(off[:, i], truth.time)
        for i, follower in enumerate(flight.scenario.followers)
        if follower.station
    }
    nearest, level = closest_approaches(truth)
    found = [*route_events(flight), *approach_events(flight)]
    return {
        "events": [f"at {event.time_s:.0f} s {event.text}" for event in found],
        "stations": sorted(({"name": n, "rms": k.station_rms_m} for n, k in kept.items()), key=lambda s: s["rms"]),
        "lost": [name for name, keeping in kept.items() if keeping.lost],
        "nearest": nearest, "nearest_level": level, "giving_way": int(np.count_nonzero(spent)) if kept else 0,
        "gave_way_longest": truth.names[int(spent.argmax()) + 1], "gave_way_s": float(spent.max()),
    }  # fmt: skip


def cause_numbers(budgets: Sequence[RangeErrorBudget]) -> dict[str, Any]:
    """RMS error of D_front − D_rear, and its largest cause; None where there is no error."""
    apart = np.concatenate([budget.asymmetry for budget in budgets])
    there = apart[np.isfinite(apart).all(axis=1)]
    rms = np.sqrt(np.mean(there**2, axis=0)) if there.size else np.zeros(len(Cause))
    most = Cause(int(rms.argmax()))
    if not rms[most]:
        return {"asymmetry_cm": None}
    whole = float(np.sqrt(np.mean(there.sum(axis=1) ** 2)))
    return {"asymmetry_cm": 100 * whole, "cause": LABELS[most], "cause_cm": 100 * float(rms[most])}


def sentences(flight: Flight, errors: Mapping[str, EstimateErrors] | None = None) -> list[str]:
    """Paragraphs on errors, events, stations, geometry, fixes, consistency and range errors; none without errors."""
    errors = errors_by_name(flight) if errors is None else errors
    if not errors:
        return []
    first, *others = errors.values()
    together = EstimateErrors(*map(np.concatenate, zip(first, *others, strict=True))) if others else first
    budgets = [range_error_budget(flight, i) for i in range(len(errors))]
    numbers = size_numbers(errors) | motion_numbers(flight) | error_numbers(together) | cause_numbers(budgets)
    return paragraphs("experiments.pages", "flight_text.md.j2", numbers, {"m": _metres, "percent": percent})


Errors = Sequence[tuple[Floats, Floats]]
"""E_P [m] and E_B [rad] of every follower at filter steps k = 1 … n, shapes (n,)."""

DRAWN_FOLLOWERS = 12
"""Followers with figures of their own; tables and the map have all of them."""
_IN_DEGREES = {"compass_bias_rad": "compass_bias_deg", "leader_compass_bias_rad": "leader_compass_bias_deg"}
VEHICLES = ((style.LEADER, "leader"), (style.FOLLOWER, "follower"), (style.ESTIMATE, "estimate"))


def _drawn(flight: Flight) -> range:
    return range(min(len(flight.estimates), DRAWN_FOLLOWERS))


def _overview(flight: Flight, errors: Errors) -> Figures:
    names = flight.trajectory.names[1:]
    worst = max(range(len(names)), key=lambda i: float(np.nanmax(errors[i][0], initial=0.0)))
    panel = flight_figures.position_errors(flight, [position for position, _ in errors], worst)
    return Figures(panels=[panel], legend=[(style.ESTIMATE, names[worst]), (style.MUTED, "other followers")])


def _error_row(name: str, one: EstimateErrors) -> list[Cell]:
    k = int(one.error.argmax())
    numbers = map(float, (one.error.mean(), one.error.std(), np.percentile(one.error, 95), one.error[k]))
    at, outside = number(float(one.time[k]), 0), number(100 * float(one.outside.mean()), 1)
    return [words(name), *map(number, numbers), at, outside]


def follower_row(flight: Flight, follower: int, errors: tuple[Floats, Floats], bound: Floats) -> Figures:
    """Routes of a follower, its curves over time, and estimate minus truth: side by side, with one time cursor."""
    used = range(flight.scenario.navigation.transmitters)
    return Figures(
        panels=[
            flight_figures.track_map(flight, [follower], link=f"follower{follower}"),
            flight_figures.over_time(flight, follower, errors, bound),
            flight_figures.difference(flight, follower),
        ],
        title=flight.trajectory.names[follower + 1] if len(flight.estimates) > 1 else "",
        legend=[
            *VEHICLES, (style.INK, "2σ by the filter; dotted: its RMS error"),
            (style.MUTED, "Cramér–Rao bound of the RMS error"),
            *((style.TRANSMITTERS[j], f"range from the {Ranges._fields[j]} transmitter") for j in used),
        ],
    )  # fmt: skip


def final_states(flight: Flight) -> list[list[Cell]]:
    """Final estimates of biases, current and offsets with their σ, where a navigator has them."""
    rows = list[list[Cell]]()
    for i in _drawn(flight):
        for name, value, sigma in flight.estimates[i].further_states():
            if np.isfinite(value):
                per = 180.0 / np.pi if name in _IN_DEGREES else 1.0
                cells = [words(flight.trajectory.names[i + 1]), words(_IN_DEGREES.get(name, name))]
                rows.append([*cells, number(per * value), number(per * sigma)])
    return rows


def mirror_locks(flight: Flight, names: Sequence[str]) -> dict[str, float]:
    """Shares of the time in which estimates of these followers are at the mirror image, above 0 [%]."""
    steps = {name: mirror_locked_steps(flight, flight.trajectory.names.index(name) - 1) for name in names}
    return {name: 100 * float(np.mean(locked)) for name, locked in steps.items() if locked.any()}


def _facts(flight: Flight, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    scenario = flight.scenario
    timing = f"{scenario.timing.filter_step_s:g} s, {scenario.timing.message_interval_s:g} s"
    transmitters, variant = scenario.navigation.transmitters, scenario.navigation.variant
    followers, navigator = len(scenario.followers), find(variant).title or variant.upper()
    return [
        ("Vehicles", f"a leader and {followers} follower{'s' if followers > 1 else ''}"),
        ("Navigator", f"{navigator} on {transmitters} transmitters"),
        ("Seed, run", f"{scenario.seed}, {scenario.run}"),
        ("Motion", scenario.motion),
        ("Flown", f"{flight.trajectory.time[-1]:g} s"),
        ("Filter step, message interval", timing),
        ("Version", ", ".join(f"{k} {v}" for k, v in list(summary.get("versions", {}).items())[:3])),
        ("Repeat with", "laisn fly scenario.toml"),
    ]


def flight_report(
    flight: Flight,
    errors: Errors,
    summary: Mapping[str, Any],
    path: Path,
    film: Path | None,
    bounds: Sequence[Floats] | None = None,
) -> None:
    """Write the report of one flight, from its errors and `summary.json`; OSError if that fails.

    `path` is in the folder of film (MP4, embedded if it is small) and log; `bounds` as of `summarise`.
    """
    by_name, least, everyone = errors_by_name(flight), bounds or flight_bounds(flight), range(len(flight.estimates))
    names = flight.trajectory.names[1:]
    finite = [names[i] for i, e in enumerate(flight.estimates) if np.isfinite(e.state[e.unknown :]).all()]
    text = sentences(flight, by_name) or [f"{flight.outcome.value.capitalize()}."]
    error_rows = [_error_row(name, one) for name, one in by_name.items()]
    # large arrays of a long mission, before figures are drawn
    del by_name
    several, kept = len(everyone) > 1, [i for i in _drawn(flight) if flight.scenario.followers[i].station]
    tracks = flight_figures.track_map(flight, everyone, width=style.FULL, height=6.0) if several else None
    values: dict[str, Any] = {
        "flight": flight,
        "followers": len(names),
        "drawn": len(_drawn(flight)),
        "sentences": text,
        "contacts": contacts(flight.trajectory),
        "not_finite": [name for name in names if name not in finite],
        "mirror_locked": mirror_locks(flight, finite),
        "mirror_lock_error_m": metrics.MIRROR_LOCK_ERROR,
        "overview": _overview(flight, errors) if several else None,
        "errors": error_rows,
        "consistent": percent(CONSISTENT_SHARE),
        "films": [Film(path=film, caption="The film of the mission.")] if film else [],
        "followers_found": summary["followers"],
        "kinds": [
            (kind.name.lower(), FIX_WORDS[kind])
            for kind in FixKind
            if any(row.get("fixes", {}).get(kind.name.lower()) for row in summary["followers"].values())
        ],
        "on_station": any("station_rms_m" in row for row in summary["followers"].values()),
        "number": number,
        "words": words,
        "on_axis_deg": f"{ON_AXIS_DEG:g}",
        "rows": [follower_row(flight, i, errors[i], least[i]) for i in _drawn(flight)],
        "states": final_states(flight),
        "budget": range_budget(flight),
        "map": tracks and Figures(panels=[tracks], legend=VEHICLES),
        "stations": kept and Figures(panels=flight_figures.station_errors(flight, kept), legend=VEHICLES[1:2]),
        "motion": Figures(panels=[flight_figures.motion(flight)], legend=VEHICLES[:2]),
        "scenario": Code(text=flight.scenario.toml(), title="scenario.toml", folded=True),
    }
    write(page_of("experiments.pages", _facts(flight, summary), values, name="flight_report.md.j2"), path)
