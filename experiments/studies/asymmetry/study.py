"""The pitch study: what a leader that is not level does to its followers, where it matters, and what helps."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions, Task
from experiments.campaign.progress import compiling_shown
from experiments.campaign.store import Record, columns_of, write_table
from experiments.findings import FILE, Finding, of
from experiments.flight.range_budget import Cause
from experiments.intervals import Interval
from experiments.pages.flight_report import asymmetry_over_time, legend_of, share_table
from experiments.pages.page import Cell, Code, Figures, Film, page_of, share_of, write
from experiments.studies.asymmetry import design, figures, findings, fix_map
from experiments.studies.asymmetry.design import CAUSES, QUICK_CONDITIONS, Plan
from experiments.studies.asymmetry.figures import Example, fly_example
from experiments.studies.asymmetry.findings import Curve, Missions, Verdict, paired, select
from experiments.studies.asymmetry.missions import fly_condition, fly_curves
from laisn.settings import NavigationSettings

_CURVES = "curves"
_SHOWN = (Cause.LEVER_ARM, Cause.RANDOM, Cause.MOTION)


def of_message(example: Example) -> dict[str, Any]:
    """Values of the page on the ranges of one message and of the minutes around it."""
    budget, message = example.budget, figures.Message.of(example.flight.trajectory, example.step)
    first = budget.time <= 200.0
    shares = {cause: budget.asymmetry[first, cause] for cause in _SHOWN}
    difference = asymmetry_over_time(budget.time[first], shares, "Difference of the bow's and stern's range errors")
    drawn = figures.message_hull(message), figures.message_top(message)
    line = example.condition.command(design.ROUTE, design.OFFSET_M)
    return {
        "geometry": Figures(panels=drawn, legend=figures.LEGEND[:2]),
        "example": example,
        "pitch_deg": np.rad2deg(message.pitch),
        "fix_error_m": np.hypot(*(message.fix - message.hydrophone[:2])),
        "first_minutes": Figures(panels=[difference], legend=legend_of(_SHOWN)),
        "shares": share_table(budget),
        "everything": design.EVERYTHING,
        "one_mission": Code(text=line, title="Run it, with film and report:"),
    }


def of_map(chart: fix_map.Chart) -> dict[str, Any]:
    """Values of the page on the map: where around the leader its pitch matters."""
    drawn = [figures.around_leader(chart, offset) for offset in (0.0, 5.0)]
    closed_form, two = chart["error_closed_form_m"], chart["error_laisn-2_m"]
    met = closed_form > 0.0
    return {
        "maps": Figures(panels=drawn),
        "abeam": two[figures.chosen(chart, pitch_deg=5.0, depth_offset_m=10.0, bearing_deg=90.0)],
        "points": two.size,
        "closed_form_m": np.abs(two - closed_form)[met].max(),
        "third_m": np.quantile(np.abs(chart["error_laisn-3-2_m"] - two)[met], (0.5, 0.95)),
    }


def against(finding: Finding | Interval, aim: float) -> Cell:
    """A share with its interval, green if the whole of it is beyond its aim, red if it is short of it."""
    found = of(finding, "") if isinstance(finding, Interval) else finding
    tone = "yes" if found.low is not None and found.low >= aim else ""
    return replace(share_of(found), tone="no" if found.high is not None and found.high < aim else tone)


def of_missions(missions: Missions, curves: Sequence[Curve], plan: Plan) -> dict[str, Any]:
    """Values and functions of the page on missions: what pitch adds, and what remains of it with each remedy."""
    two = select(missions, variant="laisn-2")
    judged = select(two, judged=True)
    paired_verdicts = [m.judge("error", design.READINGS, plan.looks, design.LEVEL_BROADCAST).verdict for m in judged]
    return {
        "offsets": Figures(panels=figures.over_offset(two), legend=figures.LEGEND),
        "worst": max(judged, key=lambda m: m.added, default=None),
        "excess": Figures(
            panels=[figures.excess_over_lever(two)],
            legend=[(colour, CAUSES[cause]) for cause, colour in figures.CAUSE_COLOURS.items()],
        ),
        "missed_paired": paired_verdicts.count(Verdict.MISSED),
        "open_paired": paired_verdicts.count(Verdict.OPEN),
        "missions": missions,
        "plan": plan,
        "design": design,
        "findings": findings,
        "curves": curves,
        "deepest": fix_map.deepest_offset,
        "radians": np.deg2rad,
        "stage_4_taus": findings.STAGE_4_TAU_M,
        "names": {variant: variant.upper() for variant in plan.variants} | {"laisn-3-2": "LAISN-3(2)"},
        "shown": lambda interval, spec: format(of(interval, ""), spec).replace(" (– to –)", ""),
        "against": against,
    }


def run(
    folder: Path,
    *,
    quick: bool = False,
    film: Callable[[Example, Path], Path] | None = None,
    **options: Unpack[ExecutionOptions],
) -> Path:
    """Simulate the study, or what is missing of it, and write tables and page, which is returned.

    `quick` is a first look: three conditions, two routes, short missions. `film` renders the film of the example into
    the folder. Folder and options as of `campaign.fly`.
    """
    plan, causes = (design.QUICK, QUICK_CONDITIONS) if quick else (Plan(), design.CONDITIONS)
    fleets: dict[Any, Task] = {
        (c.key, offset): partial(fly_condition, c, offset, plan) for c in causes for offset in plan.offsets_m
    }
    # the longest first, so that no process waits for another at the end; before it the least, to compile
    tasks = {_CURVES: partial(fly_curves, plan), **fleets}
    ahead = partial(fly_condition, causes[0], plan.offsets_m[0], plan.least)
    flown = campaign.fly(Design(tasks=tasks, what="fleets", ahead=ahead), folder, **options).tasks
    rows: list[Record] = [
        {column: np.array(value) if isinstance(value, list) else value for column, value in row.items()}
        for name in fleets for row in flown[name]
    ]  # fmt: skip
    curves = [Curve(**row) for row in flown[_CURVES]]
    with compiling_shown():
        chart = fix_map.measure_map(design.MAP, NavigationSettings(side_rule="predicted"))
    example = fly_example(QUICK_CONDITIONS[-1], plan.duration_s)

    record = findings.findings_of(plan, rows, curves, f"laisn asymmetry{' --quick' if quick else ''}")
    record.write(folder / FILE)
    by_key = {condition.key: condition for condition in causes}
    lines = [
        by_key[row["condition"]].command(row["route"], row["depth_offset_m"], variant=row["variant"]) for row in rows
    ]
    write_table(folder / "missions.parquet", {**columns_of(rows), "fly": lines})
    write_table(folder / "equivalents.parquet", columns_of([asdict(curve) for curve in curves]))
    write_table(folder / "map.parquet", {name: values.astype(np.float32) for name, values in chart.items()})
    values = {"flown": causes, "film": [], "record": record, **of_message(example), **of_map(chart)}
    values |= of_missions(paired(rows), curves, plan)
    facts = [
        ("conditions", str(len(causes))),
        ("runs", f"{record['runs']:,d} of {plan.duration_s:g} s on {record['missions']:d} missions"),
        ("seed", str(design.SEED)),
        ("version", record.version),
        ("repeat with", record.command),
    ]
    page = folder / "report.html"
    write(page_of(__package__, facts, values, record), page)
    # the page is there before the film, so that one that fails costs nothing else
    if film:
        write(page_of(__package__, facts, values | {"film": [Film(path=film(example, folder))]}, record), page)
    return page
