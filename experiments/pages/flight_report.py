"""The report of one flight: where everyone went, how far estimates were off, and why."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.pages import anatomy_page, figures
from experiments.pages.figures import FRAME, INK, MUTED, SERIES, Line
from experiments.pages.page import Cell, Code, Figures, Film, Notice, Page, Section, Table, Text, number, words, write
from laisn import metrics
from laisn.arrays import Floats
from laisn.estimates import FixKind
from sim.flight import Flight, Outcome
from sim.scenario.file import dumps

Errors = Sequence[tuple[Floats, Floats]]
"""E_P [m] and E_B [rad] of every follower at filter steps k = 1 … n, shapes (n,)."""

DRAWN_FOLLOWERS = 6
"""Followers with panels of their own; tables and the map have all of them."""
LEADER_ROUTE, TRUE_ROUTE, ESTIMATE = MUTED, SERIES[0], SERIES[1]

_FIX_NAMES = {
    FixKind.TWO_POINTS: "two points",
    FixKind.TANGENT: "tangent",
    FixKind.ASTERN: "astern",
    FixKind.FUSED: "fused",
    FixKind.GATED: "rejected",
    FixKind.SINGULAR: "skipped",
    FixKind.LOST: "lost",
    FixKind.ONE_RANGE: "one range",
}


def _true_bearing(flight: Flight, follower: int) -> Floats:
    """B from the leader's true pose, shape (n,), [rad]."""
    steps = flight.step_index()
    away = flight.hydrophone(follower)[:, :2] - flight.trajectory.position[steps, 0, :2]
    return np.asarray(np.arctan2(away[:, 0], away[:, 1]) - flight.trajectory.heading[steps, 0])


def without_wraps(scaled: Floats) -> Floats:
    """A copy of a scaled bearing with NaN where it jumps between −10 and 10, so that no line crosses the panel."""
    broken = scaled.copy()
    broken[1:][np.abs(np.diff(scaled)) > 10.0] = np.nan
    return broken


def error_lines(time: Floats, position: Floats, bearing: Floats, direction: Floats) -> list[Line]:
    """The lines of the paper's error figures: scaled B, E_B in degrees and E_P in metres over time.

    Args:
        time: shape (n,), [s].
        position: E_P, shape (n,), [m].
        bearing: E_B, shape (n,), [rad].
        direction: true B, shape (n,), [rad].
    """
    scaled = without_wraps(figures.scaled_bearing(direction))
    return [
        Line(x=time, y=scaled, colour=MUTED, width=1.2),
        Line(x=time, y=np.rad2deg(bearing), colour=SERIES[1]),
        Line(x=time, y=position, colour=SERIES[0]),
    ]


ERROR_LEGEND = (
    ("--c1", "E_P [m]"),
    ("--c2", "E_B [°]"),
    ("--muted", "bearing B, scaled: −10 ahead, 0 astern, 10 ahead"),
)


def _map(flight: Flight) -> str:
    steps = flight.step_index()
    every = max(1, steps.size // 1500)
    leader = flight.trajectory.position[steps[::every], 0, :2]
    lines = [Line(x=leader[:, 0], y=leader[:, 1], colour=FRAME, width=1.6)]
    for i, estimates in enumerate(flight.estimates):
        truth, found = flight.hydrophone(i)[::every, :2], estimates.state[::every, :2]
        lines.append(Line(x=truth[:, 0], y=truth[:, 1], colour=SERIES[i % len(SERIES)], width=1.2))
        lines.append(Line(x=found[:, 0], y=found[:, 1], colour=INK, width=0.6))
    figure = figures.panel(lines, x_label="east [m]", y_label="north [m]", equal=True, height=3.4)
    return figures.svg(figure, "map", "Routes of leader and followers, and the estimates")


def _error_panels(flight: Flight, errors: Errors) -> list[str]:
    time = flight.trajectory.time[flight.step_index()]
    panels = []
    for i, (position, bearing) in enumerate(errors[:DRAWN_FOLLOWERS]):
        name = flight.trajectory.names[i + 1]
        lines = error_lines(time, position, bearing, _true_bearing(flight, i))
        figure = figures.panel(lines, x_label="time [s]", y_label="E_P [m], E_B [°]", title=name)
        panels.append(figures.svg(figure, f"errors{i}", f"Errors of {name} over time"))
    return panels


def _motion_panels(flight: Flight) -> list[str]:
    truth = flight.trajectory
    shown = range(min(len(truth.names), DRAWN_FOLLOWERS))
    colours = [FRAME, *SERIES]
    quantities = (
        ("depth", -truth.depth, "− depth [m]", "Depth"),
        ("pitch", np.rad2deg(truth.pitch), "pitch, nose up [°]", "Pitch"),
        ("speed", truth.forward_speed, "through the water [m/s]", "Speed"),
    )
    return [
        figures.svg(
            figures.panel(
                [Line(x=truth.time, y=values[:, v], colour=colours[v], width=0.9) for v in shown],
                x_label="time [s]",
                y_label=label,
                title=title,
            ),
            name,
            f"{title} of all vehicles over time",
        )
        for name, values, label, title in quantities
    ]


def _range_panels(flight: Flight) -> list[str]:
    panels = []
    for i, (heard, found) in enumerate(zip(flight.measurements, flight.estimates, strict=True)):
        if i == DRAWN_FOLLOWERS:
            break
        name = flight.trajectory.names[i + 1]
        time = np.asarray(heard.message_step * heard.dt, dtype=np.float64)
        ranges = [Line(x=time, y=heard.ranges[:, j], colour=SERIES[j], width=0.8) for j in (2, 1, 0)]
        panel = figures.panel(ranges, x_label="time [s]", y_label="slant range [m]", title=f"{name}: ranges")
        panels.append(figures.svg(panel, f"ranges{i}", f"Measured ranges of {name}"))
        kinds = sorted(set(found.fix_kind.tolist()))
        at = np.asarray(found.fix_step * heard.dt, dtype=np.float64)
        marks = [
            Line(
                x=at[found.fix_kind == kind],
                y=np.full(int(np.sum(found.fix_kind == kind)), float(row)),
                colour=SERIES[min(kind, len(SERIES) - 1)],
                marker="|",
            )
            for row, kind in enumerate(kinds)
        ]
        rows = [_FIX_NAMES[FixKind(kind)] for kind in kinds]
        timeline = figures.timeline(marks, rows, title=f"{name}: fixes")
        panels.append(figures.svg(timeline, f"fixes{i}", f"Kinds of fix of {name} over time"))
    return panels


def _results(flight: Flight, summary: Mapping[str, Any]) -> Table:
    fixes = sorted({kind for row in summary["followers"].values() for kind in row.get("fixes", {})})
    heads = ["follower", "E_P max [m]", "mean", "σ", "E_B max [°]", "mean", "σ"]
    heads += ["rms [m]", *(kind.replace("_", " ").lower() for kind in fixes)]
    rows = []
    for name, row in summary["followers"].items():
        cells: list[Cell] = [words(name)]
        cells += [number(row.get(f"e_p_{what}_m")) for what in ("max", "mean", "std")]
        cells += [number(row.get(f"e_b_{what}_deg")) for what in ("max", "mean", "std")]
        cells.append(number(row.get("off_place_rms_m")))
        cells += [number(int(row.get("fixes", {}).get(kind, 0))) for kind in fixes]
        rows.append(cells)
    groups = [("", 1), ("position error", 3), ("bearing error", 3), ("off its place", 1)]
    return Table(
        heads=heads,
        rows=rows,
        groups=groups + ([("fixes", len(fixes))] if fixes else []),
        caption="Errors of the estimate over all filter steps; how far the follower is from where its route has it; "
        "kinds of fix.",
    )


def _troubles(flight: Flight, errors: Errors) -> list[Notice]:
    notices = []
    if flight.outcome is not Outcome.COMPLETED:
        flown = f"{flight.trajectory.time[-1]:g} s of {flight.scenario.duration_s:g} s"
        notices.append(Notice(tone="failure", text=f"After {flown}: {flight.outcome.value}."))
    for i, (position, _) in enumerate(errors):
        name = flight.trajectory.names[i + 1]
        if not np.all(np.isfinite(position)):
            notices.append(Notice(tone="failure", text=f"{name}: the estimate left finite numbers."))
            continue
        steps = flight.step_index()
        captured = metrics.captured_steps(
            flight.estimates[i].state[:, :2],
            flight.hydrophone(i)[:, :2],
            flight.trajectory.position[steps, 0, :2],
            flight.trajectory.heading[steps, 0],
        )
        if np.any(captured):
            share = 100 * float(np.mean(captured))
            notices.append(
                Notice(
                    tone="warning",
                    text=f"{name}: the estimate was more than {metrics.CAPTURE_ERROR:g} m off, at the mirror image of "
                    f"the truth in the leader's axis, for {share:.1f} % of the mission (mirror capture).",
                )
            )
    return notices


def flight_report(flight: Flight, errors: Errors, summary: Mapping[str, Any], path: Path, film: Path | None) -> None:
    """Write the report of one flight.

    Args:
        flight: as flown.
        errors: E_P and E_B of every follower.
        summary: as `summary.json` holds it; `followers` has a row each.
        path: of the HTML file; the film and the log lie beside it.
        film: MP4, embedded if it is small; None: there is none.

    Raises:
        OSError: the file cannot be written.
    """
    scenario, followers = flight.scenario, flight.trajectory.names[1:]
    drawn = min(len(followers), DRAWN_FOLLOWERS)
    all_drawn = "" if drawn == len(followers) else f" The first {drawn} of {len(followers)} followers are drawn."
    colours = [SERIES[i % len(SERIES)].variable for i in range(drawn)]
    vehicles = [("--frame", "leader"), *zip(colours, followers, strict=False)]
    film_blocks = [Film(path=film, caption="The mission as filmed.")] if film else []
    transmitters = 2 if scenario.navigation.variant == "laisn-2" else 3
    pages = Page(
        title=f"Flight {scenario.name}",
        summary=f"{len(followers)} follower{'s' if len(followers) > 1 else ''} and a leader, navigated by "
        f"{scenario.navigation.variant} on {transmitters} transmitters. {flight.outcome.value.capitalize()}.",
        facts=[
            ("Seed, run", f"{scenario.seed}, {scenario.run}"),
            ("Motion", scenario.motion),
            ("Flown", f"{flight.trajectory.time[-1]:g} s"),
            ("Filter step, message interval", f"{scenario.timing.filter_step_s:g} s, "
             f"{scenario.timing.message_interval_s:g} s"),
            ("Version", ", ".join(f"{k} {v}" for k, v in list(summary.get("versions", {}).items())[:3])),
            ("Repeat with", "laisn fly scenario.toml"),
        ],
        sections=[
            Section(title="Result", blocks=[*_troubles(flight, errors), _results(flight, summary), *film_blocks]),
            Section(
                title="Routes",
                blocks=[
                    Figures(
                        panels=[_map(flight)],
                        caption="True routes in colour, estimates as thin lines on top of them.",
                        legend=[*vehicles, ("--ink", "estimate")],
                    )
                ],
            ),
            Section(
                title="Errors over time",
                blocks=[
                    Figures(
                        panels=_error_panels(flight, errors),
                        caption="E_P is the distance of estimate and hydrophone, E_B the angle between them as seen "
                        f"from the leader's true pose.{all_drawn}",
                        legend=ERROR_LEGEND,
                    )
                ],
            ),
            Section(
                title="Motion",
                blocks=[
                    Figures(panels=_motion_panels(flight), caption="Truth, every 0.1 s.", legend=vehicles),
                ],
            ),
            Section(
                title="Ranges and fixes",
                blocks=[
                    Figures(
                        panels=_range_panels(flight),
                        caption="Ranges as measured; a mark for every fix, by its kind.",
                        legend=[("--c1", "rear"), ("--c2", "front"), ("--c3", "middle transmitter")],
                    )
                ],
            ),
            anatomy_page.section(flight),
            Section(
                title="Scenario",
                blocks=[
                    Text(
                        text="Everything that was flown, defaults written out. `laisn fly scenario.toml` with this "
                        "text gives the same bytes with the same version."
                    ),
                    Code(text=dumps(scenario), title="scenario.toml", folded=True),
                ],
            ),
        ],
    )  # fmt: skip
    write(pages, path)
