"""The study of the estimators: `laisn estimators`. LAISN-2, the tightly coupled navigator and the bound, paired."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions, Task, with_arrays
from experiments.campaign.store import Record
from experiments.findings import FILE, Findings
from experiments.flight.library import ROUTES
from experiments.pages.figures import Line, Panel, panel
from experiments.pages.page import Figures, write
from experiments.pages.style import SERIES, Legend
from experiments.pages.template import page_of
from experiments.studies.estimators import cases, findings
from experiments.studies.estimators.runs import at_sea, clock_cost, compare, mirror_locks, plain_filter
from laisn.tight.settings import TightSettings

FEW = ("T2", "T5", "T6", "T8")
"""Routes on which settings are varied: two about the leader's axis, and two aside of it."""


@dataclass(frozen=True, kw_only=True)
class Size:
    """How many runs of what."""

    runs: int = 60
    varied: int = 30
    """Where settings are varied."""
    mirror_locks: int = 10_000
    routes: tuple[str, ...] = ROUTES
    few: tuple[str, ...] = FEW


QUICK = Size(runs=4, varied=2, mirror_locks=64, routes=("T2", "T6"), few=("T2",))


def _compile() -> None:
    """Fly so little that compiling is all that takes time: both navigators on point motion, and on a hull at sea."""
    compare(cases.CASES[0], FEW[0], cases.INTERVALS[-1], runs=1, seed=cases.SEED)
    mirror_locks(FEW[0], cases.INTERVALS[-1], 2, range(1), cases.SEED)
    at_sea("calm", FEW[0], runs=1, seed=cases.SEED)


def _scaled(sigma: str, factor: float) -> TightSettings:
    usual = TightSettings()
    return replace(usual, **{sigma: factor * getattr(usual, sigma)})


def tasks(size: Size) -> Iterator[tuple[tuple[Any, ...], Task]]:
    """All tasks by their names, whose parts go from general to special; the longest first."""
    some = min(640, size.mirror_locks)
    for transmitters in (3, 2):
        for route in cases.ON_AXIS:
            for first in range(0, size.mirror_locks, some):
                runs = range(first, min(first + some, size.mirror_locks))
                name = ("mirror_locks", transmitters, route, first)
                yield name, partial(mirror_locks, route, 5.0, transmitters, runs, cases.SEED)
    both = partial(compare, runs=size.runs, seed=cases.SEED)
    few = partial(compare, runs=size.varied, seed=cases.SEED)
    for sea in cases.SEAS:
        for route in size.few:
            yield ("sea", sea, route), partial(at_sea, sea, route, runs=size.varied, seed=cases.SEED)
    for case in cases.CASES:
        for interval in cases.INTERVALS:
            for route in size.routes:
                yield ("case", case.name, interval, route), partial(both, case, route, interval, smoothing=True)
    for route in size.routes:
        yield ("clock", route), partial(clock_cost, route, 5.0, 3, runs=size.varied, seed=cases.SEED)
    for case in cases.BASELINED:
        for interval in cases.INTERVALS:
            plain = partial(plain_filter, case, interval=interval, runs=size.runs, seed=cases.SEED)
            for route in size.routes:
                yield ("ekf", case.name, interval, route), partial(plain, route=route)
    for route in size.few:
        for wrong in cases.WRONG:
            yield ("wrong", wrong.name, route), partial(few, wrong, route, 5.0)
        for sigma in cases.SIGMAS:
            for factor in cases.FACTORS:
                scaled = _scaled(sigma, factor)
                yield ("sigma", sigma, factor, route), partial(few, cases.CASES[0], route, 5.0, settings=scaled)
        for offset in cases.OFFSETS_M:
            yield ("offset", offset, route), partial(few, cases.CASES[0], route, 5.0, middle_offset=offset)
    for route in cases.ON_AXIS:
        for weave in (False, True):
            yield ("weave", weave, route), partial(both, cases.CASES[1], route, 1.0, weave=weave)


def picture(findings: Findings) -> tuple[Panel, Legend]:
    """Mean position errors of both navigators, case by case, messages every 5 s; a bar is a 95 % interval."""
    lines = []
    for name, title, colour, aside in (
        ("laisn-2", "LAISN-2", SERIES[1], -0.08),
        ("error", "tightly coupled", SERIES[0], 0.08),
    ):
        found = [findings[f"{name} {case.name} 5"] for case in cases.CASES]
        ends = [(np.nan, np.nan) if one.low is None or one.high is None else (one.low, one.high) for one in found]
        low, high = np.array(ends).T
        y, places = np.array([one.number for one in found]), np.arange(len(found), dtype=np.float64) + aside
        lines.append(Line(x=places, y=y, colour=colour, marker="o", size=4.5, name=title, interval=(low, high)))
    drawn = np.concatenate([[*line.y, *line.interval[0], *line.interval[1]] for line in lines if line.interval])
    figure = panel(
        lines, x_label="case", y_label="mean E_P over the routes [m]", height=3.0, y_log=True,
        y_limits=(float(np.nanmin(drawn)) / 1.5, float(np.nanmax(drawn)) * 1.5),
        x_ticks={float(i): case.name for i, case in enumerate(cases.CASES)}, x_limits=(-0.5, len(cases.CASES) - 0.5),
    )  # fmt: skip
    return figure, [(SERIES[1], "LAISN-2"), (SERIES[0], "tightly coupled")]


def write_page(found: Findings, rows: Mapping[tuple[Any, ...], Record], path: Path, *, quick: bool) -> Path:
    """Write the page of a record and of the rows that it was made of; returns its path."""
    figure, legend = picture(found)
    drawn = Figures(panels=[figure], legend=legend)
    facts = [
        ("Seed", str(found["seed"].value)),
        ("Runs of each mission", str(found["runs"].value)),
        ("Version", found.version),
        ("Repeat with", found.command + (" --quick" if quick else "")),
    ]
    values = {
        "quick": quick,
        "ratio": drawn,
        "cases": cases,
        "routes": [(name[1], findings.of_route(row)) for name, row in rows.items() if name[0] == "case"],
    }
    write(page_of("experiments.studies.estimators", facts, values, found), path)
    return path


def run(folder: Path, *, quick: bool = False, **options: Unpack[ExecutionOptions]) -> Path:
    """Fly the study, or what is missing of it, write its record and page, and return the page.

    `quick` is a trial run of few runs and routes; folder, options and errors as of `campaign.fly`.
    """
    design = Design(tasks=dict(tasks(QUICK if quick else Size())), what="missions", ahead=_compile)
    flown = campaign.fly(design, folder, **options).tasks
    rows = {name: with_arrays(row) for name, (row,) in flown.items()}
    found = findings.findings_of(rows)
    found.write(folder / FILE)
    return write_page(found, rows, folder / "report.html", quick=quick)
