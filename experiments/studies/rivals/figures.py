"""The figure of the study of rival methods, and what else its page shows."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.studies.rivals import findings as study
from experiments.studies.rivals.findings import CONDITIONS, USUAL_INTERVAL_S, case_name
from experiments.study.run import StudyResults
from reports.figures import Panel, marks, panel
from reports.findings import Findings
from reports.page import Figures, share_of
from reports.style import FULL, SERIES, Legend


def picture(findings: Findings) -> tuple[Panel, Legend]:
    """Mean position errors of all navigators in all conditions, messages every 5 s; a bar is a
    95 % interval.
    """
    navigators = study.navigators_in(findings.findings)
    places = np.arange(len(navigators), dtype=np.float64)[::-1]
    lines = []
    legend = []
    for i, (condition, title) in enumerate(CONDITIONS.items()):
        errors = [
            findings[f"error {case_name(name, condition, USUAL_INTERVAL_S)}"] for name in navigators
        ]
        # a bar needs a positive end on a logarithmic axis
        errors = [f if f.low is None else replace(f, low=max(f.low, 1e-2)) for f in errors]
        lines.append(
            marks(
                errors,
                places + 0.15 * (1.5 - i),
                horizontal=True,
                colour=SERIES[i],
                marker="o",
                name=title,
            )
        )
        legend.append((SERIES[i], title))
    titles = dict(zip(places.tolist(), navigators.values(), strict=True))
    figure = panel(
        lines,
        x_label="mean E_P over the routes [m]",
        y_label="",
        width=FULL,
        height=4.2,
        x_log=True,
        y_ticks=titles,
        y_limits=(-0.7, places.size - 0.3),
    )
    return figure, legend


def values(record: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name."""
    figure, legend = picture(record)
    return {
        "study": study,
        "navigators": study.navigators_in(record.findings),
        "share": lambda key: share_of(record[key]),
        "errors": Figures(panels=[figure], legend=legend),
    }
