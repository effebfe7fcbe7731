"""The figure of the comparison of the estimators."""

import numpy as np
from matplotlib.figure import Figure

from experiments.findings import Findings
from experiments.pages.figures import Line, panel
from experiments.pages.style import SERIES, Legend
from experiments.studies.estimators.cases import CASES


def picture(findings: Findings) -> tuple[Figure, Legend]:
    """Mean position errors of both navigators, case by case, messages every 5 s; a bar is a 95 % interval."""
    lines = []
    for name, colour, aside in (("laisn-2", SERIES[1], -0.08), ("error", SERIES[0], 0.08)):
        for i, case in enumerate(CASES):
            found = findings[f"{name} {case.name} 5"]
            place = np.array([i + aside])
            lines.append(Line(x=place, y=np.array([found.number]), colour=colour, marker="o", size=4.5))
            if found.low is not None and found.high is not None:
                lines.append(Line(x=np.repeat(place, 2), y=np.array([found.low, found.high]), colour=colour, width=1.4))
    figure = panel(lines, x_label="case", y_label="mean E_P over the routes [m]", height=3.0)
    axes = figure.axes[0]
    axes.set_yscale("log")
    # the panel's margin is that of a linear axis, and may reach below zero
    drawn = np.concatenate([line.y for line in lines])
    axes.set_ylim(drawn.min() / 1.5, drawn.max() * 1.5)
    axes.set_xticks(range(len(CASES)), [case.name for case in CASES])
    axes.set_xlim(-0.5, len(CASES) - 0.5)
    return figure, [(SERIES[1], "LAISN-2"), (SERIES[0], "tightly coupled")]
