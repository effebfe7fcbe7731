"""The page of the study of formations, for whoever plans one."""

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
    Page,
    Section,
    Table,
    Text,
    number,
    share_of,
    with_limits,
    words,
    write,
)
from experiments.pages.style import FULL, SERIES, Colour

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
_ABOUT = (
    "A leader swims an L at 1 m/s and broadcasts where it is. Ten followers keep stations in its trail: six on the "
    "wings, to 30 m aside, and four astern, to 40 m behind. None knows the route; each steers by its log, compass, "
    "gyros and pressure sensor, the messages, and the ranges measured on them. Where a title does not say otherwise: "
    "the tightly coupled navigator, three transmitters, messages every second, calm water. A follower is lost if it "
    "was ever more than 10 m off its station after it had joined it, or never joined it."
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


def _channel() -> list[Text | Table]:
    """What the built-in swarm asks of a modem."""
    swarm = load("swarm", ())
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
    about = (
        f"A message of {message_bits(swarm)} bits tells its number, the leader's place in steps of 1 cm, heading, "
        f"speed and depth, and has a checksum. The farthest station is {reach_m(swarm):.0f} m from a transmitter, "
        "which any modem reaches; largest distances from stations come on top. The transmitters' pings, told apart by "
        "their codes, go with it. Followers only listen, so that ten and fifty of them need the same time on the "
        "channel. The last two columns are what followers would need that ask for their ranges one by one, there and "
        "back: the reason why they do not."
    )
    heads = ["bit/s", "message [s]", "shortest interval [s]", "10 followers that ask [s]", "50 that ask [s]"]
    return [Text(text=about), Table(heads=heads, rows=rows, caption="By the bit rate of the modem.")]


def _weaves(findings: Findings) -> list[Text | Table]:
    """What followers on the axis of two transmitters could know at best, by how the leader weaves."""
    rows = []
    for amplitude, period in WEAVES:
        name = f"weave {amplitude:g} {period:g}"
        rows.append([
            number(amplitude, 0),
            number(period if amplitude else None, 0),
            *(number(findings[f"{name} {behind}"].number) for behind in BEHIND),
            number(100.0 * findings[f"{name} way"].number, 1),
        ])  # fmt: skip
    about = (
        "On the axis of two transmitters a follower can tell neither port from starboard nor well how far it is aside. "
        "A leader that weaves turns that axis away from it. The table has the Cramér–Rao bound of dead reckoning with "
        "these ranges, over the first five minutes, of a follower in the leader's trail that starts at a known place "
        "with a message every second and constant biases of log and compass in water that stands still."
    )
    heads = ["heading swings by [°]", "each [s]", *(f"{metres} m behind: least RMS error [m]" for metres in BEHIND),
             "more way [%]"]  # fmt: skip
    return [Text(text=about), Table(heads=heads, rows=rows, caption="By how the leader weaves; the first row: not.")]


def _rules(findings: Findings) -> list[str]:
    """What a planner should think of, each with the numbers of this study about it."""

    def metres(what: str) -> str:
        return f"{findings[what]:.2f} m"

    def lost(name: str) -> str:
        return f"{findings[f'lost {name}']:.0% i}"

    return [
        f"How often to speak: with a message every second the median follower is {metres('run-median calm')} off its "
        f"station, every 5 s {metres('run-median 5 s')}, every 10 s {metres('run-median 10 s')}; with a fifth of the "
        f"messages lost {metres('run-median loss')}, with 40 % lost in bursts {metres('run-median bursts')}. Shares of "
        f"followers lost: {lost('calm')}, {lost('5 s')}, {lost('10 s')}, {lost('loss')} and {lost('bursts')}.",
        "Where to place stations: behind by at least the way of the longest gap between messages, for a nearer station "
        "is extrapolated past a corner. With two transmitters some metres aside of the leader's axis: the worst "
        f"follower was {metres('worst two')} off with stations on it, {metres('worst two aside')} without, and with "
        f"three transmitters {metres('worst calm')}. With messages every 5 s of which 20 % are lost, "
        f"{lost('5 s loss')} were lost of stations that begin 5 m behind, "
        f"{lost('5 s loss back')} of the same stations 15 m farther behind.",
        f"What to assume: biases that drift, and are assumed to, cost {metres('run-median drift')} in place of "
        f"{metres('run-median calm')}. A leader's compass that errs shows in its way over ground where the water is "
        f"known to be still: the worst follower was {metres('worst compass')} off, {metres('worst compass beside')} "
        "where a current was estimated beside it, as the leader's first leg cannot tell one across it from an error of "
        "its compass. A leader whose own place walks off by 1 cm/s takes its formation along: "
        f"{metres('run-median ins')} off their stations in its true trail, though {metres('error ins')} off in the "
        "world.",
        "When to weave: with two transmitters and stations on the axis, above all far behind; not with three, nor "
        "where stations can be some metres aside, which costs nothing. A leader whose heading swings by 5° each 40 s "
        f"tells a follower 40 m behind its place to {metres('weave 5 40 40')} at best in place of "
        f"{metres('weave 0 40 40')}, one 20 m behind to {metres('weave 5 40 20')} in place of "
        f"{metres('weave 0 40 20')}, for {findings['weave 5 40 way']:.1%} more way. A swing of 2° hardly helps "
        f"({metres('weave 2 40 40')}), one of 10° does more ({metres('weave 10 40 40')}).",
        f"How far apart: by the largest distance, not by the median. It was {metres('max calm')} in calm water and "
        f"{metres('max current')} in a current of up to 0.5 m/s; the nearest two vehicles came within "
        f"{metres('closest calm')} and {metres('closest current')} of each other horizontally. Where messages are rare "
        f"or lost, only layers of their own keep followers apart: they came within {metres('closest bursts')} with "
        "40 % lost in bursts.",
        f"By what to navigate: lost were {lost('laisn-2')} of the followers with LAISN-2, {lost('laisn-3-1')} with "
        f"LAISN-3(1), {lost('laisn-3-2')} with LAISN-3(2), and {lost('calm')} with the tightly coupled navigator.",
        f"What is left without errors: {metres('run-median truth')} for the median follower that steers by the truth, "
        f"and {metres('max truth')} at most.",
        "How many followers: they never transmit, so that the channel carries the same for one and for fifty. Of 50 in "
        f"a grid of four layers the median follower was {metres('run-median fifty')} off, the worst "
        f"{metres('worst fifty')}, and the nearest two of one layer came within {metres('within fifty')} of each "
        "other. In a single layer the stations themselves come within a metre of each other where the leader turns: "
        f"followers that sense each other kept {metres('within fifty near')} apart, the median one "
        f"{metres('run-median fifty near')} off its station.",
    ]


def write_page(findings: Findings, path: Path, *, quick: bool = False) -> Path:
    """Write the page of a record; returns its path.

    Args:
        findings: the study's record.
        path: of the HTML file.
        quick: say that too little was flown to go by.

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
    page = Page(
        title="Formation",
        summary="How well ten followers keep their stations on what they hear."
        + (" A first look: too few and too short runs to go by, without a turn." if quick else ""),
        facts=[
            ("Runs of each condition", str(runs)),
            ("Version", findings.version),
            ("Repeat with", "laisn formation --quick" if quick else f"laisn formation --runs {runs}"),
        ],
        sections=[
            Section(title="All conditions", blocks=[
                Text(text=_ABOUT),
                Figures(panels=[svg(figure, "stations", "Distance from the station in all conditions")],
                        caption="Distance from the station, on a logarithmic axis.",
                        legend=legend),
                table]),
            Section(title="What the sound carries", blocks=_channel()),
            Section(title="A leader that weaves", blocks=_weaves(findings)),
            Section(title="For planners", blocks=[Text(text=rule) for rule in _rules(findings)]),
        ],
    )  # fmt: skip
    write(page, path)
    return path
