"""Ten followers in formation, through all conditions: `laisn formation`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Unpack

import numpy as np

from experiments.campaign.campaign import ExecutionOptions
from experiments.campaign.store import Record
from experiments.findings import FILE, Findings, read, record
from experiments.flight.library import load
from experiments.pages.figures import Line, Panel, panel
from experiments.pages.page import Figures, share_of, with_limits, write
from experiments.pages.style import FULL, SERIES, Legend
from experiments.pages.template import page_of
from experiments.studies.formation import limits
from experiments.studies.formation.findings import findings_of
from experiments.study.file import FOLDER, study_of
from experiments.study.plan import plan_of
from experiments.study.run import fly_study

COMMAND = "laisn formation"
MODULES = tuple(f"experiments.studies.formation.{name}" for name in ("findings", "limits"))
STUDY = str(FOLDER / "formation" / "study.toml")
CONDITIONS = study_of(STUDY, {}).titles
"""Titles of the conditions, which are the arms of the study."""
QUICK = {"runs": 2, "set": {"duration_s": 100.0}}
"""Keys of a trial run."""
_SERIES = {
    "run-median": (SERIES[0], "o", "median follower's RMS and its 95 % interval"),
    "worst": (SERIES[1], "D", "worst follower's RMS"),
    "max": (SERIES[4], "|", "largest distance at any time"),
}
"""Findings of the figure: colour, marker and words."""


def record_of(found: Mapping[str, list[list[Record]]]) -> Findings:
    """The record of all conditions, from the rows of their runs, and of the bound behind a weaving leader."""
    return record("formation", COMMAND, MODULES, findings_of(found) | limits.findings())


def picture(findings: Findings) -> tuple[Panel, Legend]:
    """Distance from the station in each condition, the first of them at the top; a bar is a 95 % interval."""
    places = np.arange(len(CONDITIONS), dtype=np.float64)[::-1]
    lines = []
    for key, (colour, marker, text) in _SERIES.items():
        found = [findings[f"{key} {name}"] for name in CONDITIONS]
        ends = [(np.nan, np.nan) if one.low is None or one.high is None else (one.low, one.high) for one in found]
        low, high = np.array(ends).T
        values = np.array([finding.number for finding in found])
        lines.append(
            Line(
                x=values, y=places, colour=colour, marker=marker, size=4.5, name=text, interval=(low, high), across=True
            )
        )
    figure = panel(
        lines, x_label="distance from the station [m]", y_label="", width=FULL, height=1.0 + 0.21 * places.size,
        y_limits=(-0.7, places.size - 0.3), x_log=True,
        y_ticks=dict(zip(places.tolist(), CONDITIONS.values(), strict=True)),
    )  # fmt: skip
    return figure, [(colour, text) for colour, _, text in _SERIES.values()]


def write_page(findings: Findings, path: Path, *, quick: bool = False) -> Path:
    """Write the page of a record, of a trial run if `quick`; returns its path.

    Raises LaisnError if the record lacks a condition.
    """
    figure, legend = picture(findings)
    runs = findings["runs"].value
    facts = [
        ("Runs of each condition", str(runs)),
        ("Version", findings.version),
        ("Repeat with", "laisn formation --quick" if quick else f"laisn formation --runs {runs}"),
    ]
    values = {
        "quick": quick,
        "conditions": CONDITIONS,
        "found": findings,
        "interval": lambda key, digits=2: with_limits(findings[key], digits),
        "share": lambda key: share_of(findings[key]),
        "stations": Figures(panels=[figure], legend=legend),
        "swarm": load("swarm", ()),
        "limits": limits,
    }
    write(page_of("experiments.studies.formation", facts, values, findings), path)
    return path


def run(folder: Path, *, quick: bool = False, runs: int | None = None, **options: Unpack[ExecutionOptions]) -> Path:
    """Fly the study, or what is missing of it, write its record and page, and return the page.

    `quick` is a trial run of two short runs of each condition, `runs` their number in place of the study's own; folder,
    options and errors as of `campaign.fly`.
    """
    keys = (QUICK if quick else {}) | ({"runs": runs} if runs else {})
    record_of(fly_study(plan_of(study_of(STUDY, keys)), folder, **options).by_arm()).write(folder / FILE)
    return write_page(read(folder / FILE), folder / "report.html", quick=quick)
