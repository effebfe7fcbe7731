"""The report of one flight: routes, errors of the estimates, and their causes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.flight.summary import flight_bounds, mirror_locked_steps
from experiments.pages import flight_figures, flight_text, range_budget_page
from experiments.pages.flight_figures import ON_AXIS_DEG
from experiments.pages.page import Cell, Code, Figures, Film, number, words, write
from experiments.pages.style import ESTIMATE, FOLLOWER, FULL, INK, LEADER, MUTED, TRANSMITTERS
from experiments.pages.template import page_of
from laisn import metrics
from laisn.arrays import Floats
from laisn.estimates import FIX_WORDS, FixKind
from laisn.messages import Ranges
from laisn.navigators import find
from sim.contact import contacts
from sim.flight import Flight, Outcome

Errors = Sequence[tuple[Floats, Floats]]
"""E_P [m] and E_B [rad] of every follower at filter steps k = 1 … n, shapes (n,)."""

DRAWN_FOLLOWERS = 12
"""Followers with figures of their own; tables and the map have all of them."""
_IN_DEGREES = {"compass_bias_rad": "compass_bias_deg", "leader_compass_bias_rad": "leader_compass_bias_deg"}
VEHICLES = ((LEADER, "leader"), (FOLLOWER, "follower"), (ESTIMATE, "estimate"))


def _drawn(flight: Flight) -> range:
    return range(min(len(flight.estimates), DRAWN_FOLLOWERS))


def _overview(flight: Flight, errors: Errors) -> Figures | None:
    """Position errors over time, of the worst of several followers beside the others."""
    names = flight.trajectory.names[1:]
    if len(names) == 1:
        return None
    worst = max(range(len(names)), key=lambda i: float(np.nanmax(errors[i][0], initial=0.0)))
    panel = flight_figures.position_errors(flight, [position for position, _ in errors], worst)
    return Figures(panels=[panel], legend=[(ESTIMATE, names[worst]), (MUTED, "other followers")])


def _error_row(name: str, one: flight_text.EstimateErrors) -> list[Cell]:
    """Position error and consistency of a follower."""
    k = int(one.error.argmax())
    numbers = [*map(float, (one.error.mean(), one.error.std(), np.percentile(one.error, 95), one.error[k]))]
    return [
        words(name),
        *map(number, numbers),
        number(float(one.time[k]), 0),
        number(100 * float(one.outside.mean()), 1),
    ]


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
            *VEHICLES, (INK, "2σ by the filter; dotted: its RMS error"), (MUTED, "Cramér–Rao bound of the RMS error"),
            *((TRANSMITTERS[j], f"range from the {Ranges._fields[j]} transmitter") for j in used),
        ],
    )  # fmt: skip


def _map(flight: Flight) -> Figures | None:
    """Map of several followers."""
    if len(flight.estimates) == 1:
        return None
    panel = flight_figures.track_map(flight, range(len(flight.estimates)), width=FULL, height=6.0)
    return Figures(panels=[panel], legend=VEHICLES)


def _stations(flight: Flight) -> Figures | None:
    """Distances from stations; None without stations."""
    kept = [i for i in _drawn(flight) if flight.scenario.followers[i].station]
    return Figures(panels=flight_figures.station_errors(flight, kept), legend=VEHICLES[1:2]) if kept else None


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


def failures(flight: Flight) -> dict[str, Any]:
    """Values for the notices: end of the mission, contacts, estimates that are not finite, and mirror locks."""
    names, finite = flight.trajectory.names[1:], [np.isfinite(e.state[e.unknown :]).all() for e in flight.estimates]
    mirror_locked = {
        name: 100 * float(np.mean(mirror_locked_steps(flight, i))) for i, name in enumerate(names) if finite[i]
    }
    return {
        "ended_by": "" if flight.outcome is Outcome.COMPLETED else flight.outcome.value,
        "end_tone": "warning" if flight.outcome is Outcome.CONTACT else "failure",
        "flown_s": f"{flight.trajectory.time[-1]:g}",
        "duration_s": f"{flight.scenario.duration_s:g}",
        "contacts": [(f"{time:g}", pair) for time, pair in contacts(flight.trajectory)],
        "not_finite": [name for name, good in zip(names, finite, strict=True) if not good],
        "mirror_locked": {name: f"{share:.1f}" for name, share in mirror_locked.items() if share},
        "mirror_lock_error_m": f"{metrics.MIRROR_LOCK_ERROR:g}",
    }


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
    """Write the report of one flight.

    Args:
        flight: as flown.
        errors: E_P and E_B of every follower.
        summary: as `summary.json` holds it; `followers` has a row each.
        path: of the HTML file, in the folder of film and log.
        film: MP4, embedded if it is small; None: there is none.
        bounds: `flight_bounds` of the flight; None: they are computed here.

    Raises:
        OSError: the file cannot be written.
    """
    by_name, least = flight_text.errors_by_name(flight), bounds or flight_bounds(flight)
    values: dict[str, Any] = {
        "name": flight.scenario.name,
        "followers": len(flight.estimates),
        "drawn": len(_drawn(flight)),
        "sentences": flight_text.sentences(flight, by_name) or [f"{flight.outcome.value.capitalize()}."],
        **failures(flight),
        "overview": _overview(flight, errors),
        "errors": [_error_row(name, one) for name, one in by_name.items()],
        "consistent": flight_text.percent(flight_text.CONSISTENT_SHARE),
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
        "use_attitude": flight.scenario.navigation.use_attitude,
        "budget": range_budget_page.values(flight),
        "map": _map(flight),
        "stations": _stations(flight),
        "motion": Figures(panels=[flight_figures.motion(flight)], legend=VEHICLES[:2]),
        "scenario": Code(text=flight.scenario.toml(), title="scenario.toml", folded=True),
    }
    write(page_of("experiments.pages", _facts(flight, summary), values, name="flight_report.md.j2"), path)
