"""The figure of the study of formations, and what else its page shows."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.flight.library import load_scenario
from experiments.studies.formation import findings as formation_findings
from experiments.study.run import StudyResults
from reports.figures import Panel, marks, panel
from reports.findings import Findings
from reports.page import Figures, share_of, with_limits
from reports.style import FULL, SERIES

_SERIES = {
    "run-median": (SERIES[0], "o", "median follower's RMS and its 95 % interval"),
    "worst": (SERIES[1], "D", "worst follower's RMS"),
    "max": (SERIES[4], "|", "largest distance at any time"),
}


def picture(findings: Findings, conditions: Mapping[str, str]) -> Panel:
    """Distance from the station in each condition, by its title, the first at the top; a bar is
    a 95 % interval.
    """
    places = np.arange(len(conditions), dtype=np.float64)[::-1]
    lines = [
        marks(
            [findings[f"{key} {name}"] for name in conditions],
            places,
            horizontal=True,
            colour=colour,
            marker=marker,
            name=text,
        )
        for key, (colour, marker, text) in _SERIES.items()
    ]
    return panel(
        lines,
        x_label="distance from the station [m]",
        y_label="",
        width=FULL,
        height=1.0 + 0.21 * places.size,
        y_limits=(-0.7, places.size - 0.3),
        x_log=True,
        y_ticks=dict(zip(places.tolist(), conditions.values(), strict=True)),
    )


def values(record: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name."""
    study = outcomes["study"].plan.study
    conditions = {arm: study.title("arm", arm) for arm in study.arms}
    legend = [(colour, text) for colour, _, text in _SERIES.values()]
    return {
        "conditions": conditions,
        "interval": lambda key, digits=2: with_limits(record[key], digits),
        "share": lambda key: share_of(record[key]),
        "stations": Figures(panels=[picture(record, conditions)], legend=legend),
        "channel": formation_findings.LeaderBroadcast.of(load_scenario("swarm", ())),
        "constants": formation_findings,
    }
