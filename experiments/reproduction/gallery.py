"""The picture of `laisn reproduce`: mean errors of all published rows, the paper's against ours."""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.campaign.store import read_table
from experiments.pages import figures
from experiments.pages.figures import Line
from experiments.pages.style import FRAME, SERIES, Colour
from experiments.reproduction.study import reproduce

GROUPS: tuple[tuple[str, Colour, str], ...] = (
    ("messages every 1 and 5 s, stages 1 to 3", SERIES[0], "o"),
    ("unequal range errors, stage 4", SERIES[2], "D"),
    ("leader's compass off, stage 5", SERIES[3], "s"),
    ("messages every 10 s", SERIES[1], "^"),
)
"""Name, colour and mark of the kinds of rows."""


def _group(row: dict[str, float]) -> int:
    if row["dt_range_s"] == 10:
        return 3
    if row["tau_rear_m"] != row["tau_other_m"]:
        return 1
    return 2 if row["mu_heading_leader_deg"] > 0 else 0


def means(folder: Path) -> list[tuple[int, float, float]]:
    """Group, published and own mean E_P [m] of every published row of a reproduction in `folder`."""
    rows = read_table(folder / "tables.parquet")
    kept = [row for row in rows if row["published_e_p_mean_m"] is not None]
    return [(_group(row), row["published_e_p_mean_m"], row["ours_e_p_mean_m"]) for row in kept]


def picture() -> Figure:
    """Our mean E_P over the paper's, both on logarithmic axes; the diagonal is agreement, the band a factor of two."""
    with tempfile.TemporaryDirectory() as folder:
        reproduce(out=Path(folder), quiet=True)
        points = means(Path(folder))
    span = np.array([0.15, 40.0])
    lines = [
        Line(x=span, y=factor * span, colour=FRAME, width=width, dash=dash)
        for factor, width, dash in ((1.0, 1.2, "-"), (2.0, 0.8, "--"), (0.5, 0.8, "--"))
    ]
    for number, (_, colour, mark) in enumerate(GROUPS):
        pairs = np.array([(theirs, ours) for group, theirs, ours in points if group == number])
        lines.append(Line(x=pairs[:, 0], y=pairs[:, 1], colour=colour, marker=mark))
    figure = figures.panel(lines, x_label="the paper's mean E_P [m]", y_label="our mean E_P [m]", height=3.6)
    axes = figure.axes[0]
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*span)
    axes.set_ylim(*span)
    return figure
