"""The figure of the study of a front, and what else its page shows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.studies.front import findings as study
from experiments.study.run import StudyResults
from reports.figures import Panel, marks, panel
from reports.findings import Findings
from reports.page import Figures, with_limits
from reports.style import FULL, SERIES


def picture(findings: Findings) -> Panel:
    """RMS distance from the station, a row for each thing that followers steer by, a colour for
    each case; bars are 95 % intervals.
    """
    rows = np.arange(len(study.ARMS), dtype=np.float64)[::-1]
    lines = [
        marks(
            [findings[f"station {arm} {case}"] for arm in study.ARMS],
            # three cases: above, on and below the row
            rows + 0.15 * (1 - i),
            horizontal=True,
            colour=SERIES[i],
            marker="o",
            name=title,
        )
        for i, (case, title) in enumerate(study.CASES.items())
    ]
    return panel(
        lines,
        x_label="RMS distance from the station [m]",
        y_label="",
        width=FULL,
        height=2.4,
        x_log=True,
        y_ticks=dict(zip(rows.tolist(), study.ARMS.values(), strict=True)),
        y_limits=(-0.7, rows.size - 0.3),
    )


def values(findings: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name."""
    legend = [(SERIES[i], title) for i, title in enumerate(study.CASES.values())]
    return {
        "study": study,
        "interval": lambda key, digits=2: with_limits(findings[key], digits),
        "stations": Figures(panels=[picture(findings)], legend=legend),
    }
