"""The error budget of a flight's ranges in its report: tables and curves."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.flight.range_budget import LABELS, Cause, RangeErrorBudget, range_error_budget
from experiments.pages.figures import Line, Panel, panel
from experiments.pages.page import Figures, Table, number, words
from experiments.pages.style import FULL, HALF, SERIES, WIDTH, Colour
from laisn.arrays import Floats
from sim.flight import Flight

TRANSMITTERS = ("rear", "front", "middle")
_CAUSES = (Cause.RANDOM, Cause.LEVER_ARM, Cause.MOTION, Cause.DEPTH, Cause.FORESHORTENING, Cause.ECHO)
COLOUR = dict(zip(_CAUSES, SERIES, strict=True))
"""Colours of causes that affect bow and stern differently; clock and sound speed affect both (nearly) alike."""
_NOTICEABLE_M = 1e-6
_DRAWN_FOLLOWERS = 3


def _rms(values: Floats) -> float:
    """Root mean square of finite values, shape (n,); NaN without any."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else np.nan


def _largest(values: Floats) -> float:
    return float(np.nanmax(np.abs(values))) if np.isfinite(values).any() else np.nan


def share_table(budget: RangeErrorBudget, caption: str = "", transmitters: int = 3) -> Table:
    """Root mean square of each cause's share in the range errors, and in the asymmetry of bow and stern.

    `caption` precedes the table's own one; `transmitters` is the number of columns, rear and front first.
    """
    at_work = [cause for cause in Cause if _largest(budget.share[..., cause]) > _NOTICEABLE_M]
    rows = [
        [
            words(LABELS[cause]),
            *(number(100 * _rms(budget.share[:, i, cause]), 1) for i in range(transmitters)),
            number(100 * _rms(budget.asymmetry[:, cause]), 1),
            number(100 * _largest(budget.asymmetry[:, cause]), 1),
        ]
        for cause in at_work
    ]
    idle = ", ".join(LABELS[cause] for cause in Cause if cause not in at_work)
    return Table(
        heads=("cause", *TRANSMITTERS[:transmitters], "rms", "largest"),
        rows=rows,
        groups=(("", 1), ("share of the range error, rms [cm]", transmitters), ("front less rear [cm]", 2)),
        caption=f"{caption}Each range error is the exact sum of these shares."
        + (f" Without effect here: {idle}." if idle else ""),
    )


def asymmetry_over_time(time: Floats, shares: dict[Cause, Floats], title: str, width: float = WIDTH) -> Panel:
    """Shares of causes in D_front − D_rear over time, of shape (m,), [m]; width in [inch]."""
    lines = [
        Line(x=time, y=100.0 * share, colour=COLOUR[cause], width=0.8, name=LABELS[cause])
        for cause, share in shares.items()
    ]
    return panel(lines, x_label="time [s]", y_label="in D_front − D_rear [cm]", title=title, width=width)


def legend_of(causes: Sequence[Cause]) -> list[tuple[Colour, str]]:
    """Legend of the figure `asymmetry_over_time`: colour and name of each cause."""
    return [(COLOUR[cause], LABELS[cause]) for cause in causes]


def values(flight: Flight) -> dict[str, Any]:
    """Values for the report of a flight: followers without a ping, figure and tables."""
    names, used = flight.trajectory.names[1:], flight.scenario.navigation.transmitters
    silent, drawn, panels, tables = list[str](), set[Cause](), list[Panel](), list[Table]()
    width = FULL if len(names) == 1 else HALF
    for i, name in enumerate(names[:_DRAWN_FOLLOWERS]):
        budget = range_error_budget(flight, i)
        if not np.isfinite(budget.error).any():
            silent.append(name)
            continue
        title = name if len(names) > 1 else ""
        shares = {cause: share for cause in COLOUR if _largest(share := budget.asymmetry[:, cause]) > _NOTICEABLE_M}
        drawn |= set(shares)
        panels.append(asymmetry_over_time(budget.time, shares, title, width))
        tables.append(share_table(budget, f"{name}. " if len(names) > 1 else "", used))
    legend = legend_of([cause for cause in COLOUR if cause in drawn])
    return {
        "silent": silent,
        "figure": Figures(panels=panels, legend=legend) if panels else None,
        "first": "" if len(names) <= _DRAWN_FOLLOWERS else f" The first {_DRAWN_FOLLOWERS} of {len(names)} followers.",
        "tables": tables,
    }
