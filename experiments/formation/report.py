"""Figure and tables of the formation study's page, whose text is page.md.j2."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.findings import Findings
from experiments.flight.library import load
from experiments.formation.channel import RATES, asked_interval_s, message_bits, reach_m, shortest_interval_s
from experiments.formation.conditions import CONDITIONS
from experiments.formation.weave import BEHIND, WEAVES
from experiments.pages.figures import Line, panel, svg
from experiments.pages.page import (
    Cell,
    Figures,
    Table,
    number,
    share_of,
    with_limits,
    words,
    write,
)
from experiments.pages.style import FULL, SERIES, Colour
from experiments.pages.template import page_of
from sim.scenario.settings import Scenario

_HEADS = ["condition", "median [m]", "worst", "95 %", "largest", "legs", "largest in turns", "E_P [m]", "followers",
          "share [%]", "closest [m]", "of one layer", "power [W]"]  # fmt: skip
_GROUPS = [("", 1), ("distance from the station", 6), ("", 1), ("lost", 2), ("", 3)]
_CAPTION = (
    "Horizontal distances. Median: RMS of a run's median follower, mean over runs. Worst: RMS of the worst follower of "
    "all runs. 95 %: what the median follower exceeds for 5 % of the time. Legs: RMS of the median follower where the "
    "formation goes straight on. Closest: least horizontal distance of two vehicles, whatever their layers; of one "
    "layer: of two that swim less than a metre above each other. Power: of a follower's thrusters. Brackets hold 95 % "
    "intervals, over runs where there are enough; those of shares take followers as independent, which those of one "
    "run are not."
)
_NAMES_INCH = 3.4
"""Room for the names of conditions beside the figure [inch]."""
_SERIES = (("run-median", SERIES[0], "o"), ("worst", SERIES[1], "D"), ("max", SERIES[4], "|"))
_LEGEND = ("median follower's RMS and its 95 % interval", "worst follower's RMS", "largest distance at any time")


def picture(findings: Findings) -> tuple[Figure, list[tuple[Colour, str]]]:
    """Distance from the station in each condition, the first of them at the top; a bar is a 95 % interval."""
    places = np.arange(len(CONDITIONS), dtype=np.float64)[::-1]
    lines = []
    for key, colour, marker in _SERIES:
        found = [findings[f"{key} {condition.name}"] for condition in CONDITIONS]
        values = np.array([finding.number for finding in found])
        lines.append(Line(x=values, y=places, colour=colour, marker=marker, size=4.5))
        lines += [
            Line(x=np.array([finding.low, finding.high]), y=np.repeat(place, 2), colour=colour, width=1.6)
            for finding, place in zip(found, places, strict=True)
            if finding.low is not None and finding.high is not None
        ]
    figure = panel(
        lines,
        x_label="distance from the station [m]",
        y_label="",
        width=FULL,
        height=1.0 + 0.21 * places.size,
        y_limits=(-0.7, places.size - 0.3),
    )
    axes = figure.axes[0]
    left, bottom, across, height = axes.get_position().bounds
    room = _NAMES_INCH / FULL
    axes.set_position((left + room, bottom, across - room, height))
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.margins(x=0.03)
    axes.set_yticks(places, [condition.title for condition in CONDITIONS])
    axes.tick_params(axis="y", length=0)
    return figure, [(colour, text) for (_, colour, _), text in zip(_SERIES, _LEGEND, strict=True)]


def _row(findings: Findings, name: str, title: str) -> list[Cell]:
    def plain(what: str, digits: int = 2) -> Cell:
        return number(findings[f"{what} {name}"].number, digits)

    lost = findings[f"lost-runs {name}"]
    # without a turn on the way there is no largest distance in it
    turn = findings[f"turn {name}"].number or None
    return [
        words(title),
        with_limits(findings[f"run-median {name}"]),
        *(plain(what) for what in ("worst", "p95", "max", "leg")),
        number(turn),
        with_limits(findings[f"error {name}"]),
        Cell(text=f"{lost.value} {lost.what.removeprefix('followers lost, ')}", sort=lost.number),
        share_of(findings[f"lost {name}"]),
        plain("closest", 1),
        plain("within", 1),
        with_limits(findings[f"power {name}"], 1),
    ]


def _channel(swarm: Scenario) -> Table:
    """Message intervals that the built-in swarm needs, by the bit rate of the modem."""
    rows = [
        [
            number(rate),
            number(message_bits(swarm) / rate),
            number(shortest_interval_s(swarm, rate)),
            number(asked_interval_s(swarm, rate, 10), 1),
            number(asked_interval_s(swarm, rate, 50), 1),
        ]
        for rate in RATES
    ]
    heads = ["bit/s", "message [s]", "shortest interval [s]", "10 followers that ask [s]", "50 that ask [s]"]
    return Table(heads=heads, rows=rows, caption="By the bit rate of the modem.")


def _weaves(findings: Findings) -> Table:
    """Bound of followers on the axis of two transmitters, by the leader's weave."""
    rows = []
    for amplitude, period in WEAVES:
        name = f"weave {amplitude:g} {period:g}"
        rows.append([
            number(amplitude, 0),
            number(period if amplitude else None, 0),
            *(number(findings[f"{name} {behind}"].number) for behind in BEHIND),
            number(100.0 * findings[f"{name} way"].number, 1),
        ])  # fmt: skip
    heads = ["heading swings by [°]", "each [s]", *(f"{metres} m behind: least RMS error [m]" for metres in BEHIND),
             "more way [%]"]  # fmt: skip
    return Table(heads=heads, rows=rows, caption="By the leader's weave; first row: none.")


def write_page(findings: Findings, path: Path, *, quick: bool = False) -> Path:
    """Write the page of a record; returns its path.

    Args:
        findings: the study's record.
        path: of the HTML file.
        quick: the record is that of a trial run.

    Raises:
        LaisnError: the record lacks a condition.
        OSError: the file cannot be written.
    """
    figure, legend = picture(findings)
    runs = findings["runs"].value
    table = Table(
        heads=_HEADS,
        rows=[_row(findings, condition.name, condition.title) for condition in CONDITIONS],
        groups=_GROUPS,
        caption=_CAPTION,
    )
    swarm = load("swarm", ())
    facts = [
        ("Runs of each condition", str(runs)),
        ("Version", findings.version),
        ("Repeat with", "laisn formation --quick" if quick else f"laisn formation --runs {runs}"),
    ]
    stations = Figures(
        panels=[svg(figure, "stations", "Distance from the station in all conditions")],
        caption="Distance from the station, on a logarithmic axis.",
        legend=legend,
    )
    values = {
        "quick": quick,
        "bits": message_bits(swarm),
        "reach_m": reach_m(swarm),
        "stations": stations,
        "conditions": table,
        "channel": _channel(swarm),
        "weaves": _weaves(findings),
    }
    write(page_of("experiments.formation", facts, values, findings), path)
    return path
