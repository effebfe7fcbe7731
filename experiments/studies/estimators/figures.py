"""The figure of the study of the estimators, and what else its page shows."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from experiments.studies.estimators.findings import MESSAGE_INTERVAL, figures_of, missions_of
from experiments.study.plan import levels
from experiments.study.run import StudyResults
from reports.figures import Panel, marks, panel
from reports.findings import Findings
from reports.page import Figures
from reports.style import SERIES

LEGEND = [(SERIES[1], "LAISN-2"), (SERIES[0], "tightly coupled")]


def picture(findings: Findings, cases: Collection[str]) -> Panel:
    """Mean position errors of both navigators, case by case, messages every 5 s; a bar is a 95 %
    interval.
    """
    lines = []
    for name, (colour, title), shift in zip(
        ("laisn-2", "error"), LEGEND, (-0.08, 0.08), strict=True
    ):
        errors = [findings[f"{name} {case} 5"] for case in cases]
        places = np.arange(float(len(cases))) + shift
        lines.append(marks(errors, places, colour=colour, marker="o", name=title))
    values = np.concatenate(
        [[*line.y, *line.interval[0], *line.interval[1]] for line in lines if line.interval]
    )
    return panel(
        lines,
        x_label="case",
        y_label="mean E_P over the routes [m]",
        height=3.0,
        y_log=True,
        y_limits=(float(np.nanmin(values)) / 1.5, float(np.nanmax(values)) * 1.5),
        x_ticks={float(i): case for i, case in enumerate(cases)},
        x_limits=(-0.5, len(cases) - 0.5),
    )


def values(record: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name."""
    studies = {part: results.plan.study for part, results in outcomes.items()}
    titles = {
        part: {name: study.title("case", name) for name in study.cases}
        for part, study in studies.items()
    }
    cases = titles["cases"]
    return {
        "ratio": Figures(panels=[picture(record, cases)], legend=LEGEND),
        "titles": titles,
        "intervals": levels(outcomes["cases"].plan, MESSAGE_INTERVAL),
        "compared_with_ekf": [name for name in cases if f"ekf {name} 5" in record.findings],
        "routes_on_axis": [*studies["locks"].scenarios],
        "offsets": levels(outcomes["offset"].plan, "leader.middle_offset_m"),
        "routes": figures_of(missions_of(outcomes["cases"])),
    }
