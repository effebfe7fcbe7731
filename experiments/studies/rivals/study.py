"""All navigators beside each other: `laisn rivals`."""

from collections.abc import Mapping
from pathlib import Path
from time import process_time
from typing import Any, Unpack

import numpy as np

from experiments.campaign.campaign import ExecutionOptions
from experiments.findings import FILE, Findings, read, record
from experiments.flight.library import load
from experiments.pages.figures import Line, Panel, panel
from experiments.pages.page import Figures, share_of, write
from experiments.pages.style import FULL, SERIES, Legend
from experiments.pages.template import page_of
from experiments.studies.rivals import design
from experiments.studies.rivals.findings import LOST_M, findings_of
from experiments.study.file import study_of
from experiments.study.plan import plan_of
from experiments.study.run import fly_studies
from laisn.navigators import find
from sim.flight import navigation_settings
from sim.motion import simulate_motion
from sim.sensing.errors import errors_of
from sim.sensing.observation import measure, observe, start_of

COMMAND = "laisn rivals"
MODULES = tuple(f"experiments.studies.rivals.{name}" for name in ("design", "findings"))
RUNS, SLOW_RUNS, CLOSED_RUNS, MAP_RUNS = 3, 2, 2, 4
QUICK = {"duration_s": 60.0}
"""Settings of a trial run."""


def step_times_us(duration_s: float = 120.0, repeats: int = 3) -> dict[str, float]:
    """Processor time of a filter step of each navigator, T5 with messages every second, the least of some runs [µs]."""
    times = {}
    for name in design.NAVIGATORS:
        given = ["motion=kinematic", f"duration_s={duration_s}", f"navigation.variant={name}"]
        scenario = load("T5", given)
        motion = simulate_motion(scenario)
        settings, start = navigation_settings(scenario, motion, 0), start_of(motion)
        measured = measure(observe(motion, scenario), errors_of(scenario, 0), seed=scenario.seed, run=0)
        taken = []
        # the first one compiles
        for _ in range(repeats + 1):
            begin = process_time()
            find(name).fly(settings, measured, start)
            taken.append(process_time() - begin)
        times[name] = 1e6 * min(taken[1:]) / measured.speed.size
    return times


def picture(findings: Findings) -> tuple[Panel, Legend]:
    """Mean position errors of all navigators in all conditions, messages every 5 s; a bar is a 95 % interval."""
    places = np.arange(len(design.NAVIGATORS), dtype=np.float64)[::-1]
    lines, legend = [], []
    for i, (condition, (title, _)) in enumerate(design.CONDITIONS.items()):
        found = [findings[f"error {design.arm_name(name, condition, design.USUAL)}"] for name in design.NAVIGATORS]
        ends = [(np.nan, np.nan) if f.low is None or f.high is None else (max(f.low, 1e-2), f.high) for f in found]
        low, high = np.array(ends).T
        values = np.array([finding.number for finding in found])
        y = places + 0.15 * (1.5 - i)
        lines.append(Line(
            x=values, y=y, colour=SERIES[i], marker="o", size=4.5, name=title, interval=(low, high), across=True
        ))  # fmt: skip
        legend.append((SERIES[i], title))
    titles = dict(zip(places.tolist(), design.NAVIGATORS.values(), strict=True))
    figure = panel(
        lines, x_label="mean E_P over the routes [m]", y_label="", width=FULL, height=4.2, x_log=True, y_ticks=titles,
        y_limits=(-0.7, places.size - 0.3),
    )  # fmt: skip
    return figure, legend


def write_page(findings: Findings, path: Path, *, quick: bool = False) -> Path:
    """Write the page of a record; returns its path. Raises LaisnError if the record lacks a case."""
    figure, legend = picture(findings)
    facts = [
        ("Runs of each mission", str(findings["runs"].value)),
        ("Version", findings.version),
        ("Repeat with", COMMAND + (" --quick" if quick else "")),
    ]
    values: dict[str, Any] = {
        "quick": quick,
        "design": design,
        "found": findings.findings,
        "lost_m": LOST_M,
        "share": lambda key: share_of(findings[key]),
        "errors": Figures(panels=[figure], legend=legend),
    }
    write(page_of("experiments.studies.rivals", facts, values, findings), path)
    return path


def run(folder: Path, *, quick: bool = False, **options: Unpack[ExecutionOptions]) -> Path:
    """Fly the study, or what is missing of it, write its record and page, and return the page.

    `quick` is a trial run of a minute of each mission; folder, options and errors as of `campaign.fly`.
    """
    settings: Mapping[str, Any] = QUICK if quick else {}
    runs = (2, 2, 2, 2) if quick else (RUNS, SLOW_RUNS, CLOSED_RUNS, MAP_RUNS)

    tables = (design.open_loop, design.slow, design.closed_loop, design.usbl_map)
    plans = [plan_of(study_of(table(n, settings), {})) for table, n in zip(tables, runs, strict=True)]
    routes, slow, closed, points = (outcomes.by_arm() for outcomes in fly_studies(plans, folder, **options))
    found = findings_of(routes | slow, closed, points, step_times_us())
    record("rivals", COMMAND, MODULES, found).write(folder / FILE)
    return write_page(read(folder / FILE), folder / "report.html", quick=quick)
