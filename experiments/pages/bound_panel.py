"""How good an estimate could be, and how good it takes itself to be: a section of the report of a flight."""

from collections.abc import Sequence

import numpy as np

from experiments.pages import figures
from experiments.pages.figures import Line
from experiments.pages.page import Block, Cell, Figures, Section, Table, number, words
from experiments.pages.style import ESTIMATE, FULL, HALF, INK, MUTED, SERIES
from laisn.arrays import Floats
from sim.flight import Flight

_LEAST_WEIGHT = 1e-3
"""A second hypothesis that never weighs more than this is not worth a panel."""
_IN_DEGREES = {"compass_bias_rad": "compass_bias_deg", "leader_compass_bias_rad": "leader_compass_bias_deg"}


def _error_panel(flight: Flight, follower: int, error: Floats, bound: Floats, width: float) -> str:
    """E_P of a follower, what its covariance says of it, and the bound."""
    time, covariance = flight.trajectory.time[flight.step_index()], flight.estimates[follower].covariance
    believed = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1])
    lines = [
        Line(x=time, y=error, colour=ESTIMATE),
        Line(x=time, y=believed, colour=INK),
        Line(x=time, y=bound, colour=MUTED, width=1.6),
    ]
    name = flight.trajectory.names[follower + 1]
    figure = figures.panel(lines, x_label="time [s]", y_label="position error [m]", title=name, width=width)
    return figures.svg(figure, f"bound{follower}", f"Error of {name} beside the least possible")


def _weight_panel(flight: Flight, follower: int, width: float) -> list[str]:
    """Weights of the hypotheses of a follower, if there ever were several."""
    estimates = flight.estimates[follower]
    weight = estimates.hypotheses.weight
    if np.all(weight[:, 1:] < _LEAST_WEIGHT):
        return []
    time = np.asarray(estimates.fix_step * flight.measurements[follower].dt, dtype=np.float64)
    lines = [Line(x=time, y=weight[:, h], colour=SERIES[h]) for h in range(weight.shape[1])]
    name = flight.trajectory.names[follower + 1]
    figure = figures.panel(lines, x_label="time [s]", y_label="weight", title=f"{name}: hypotheses", width=width)
    return [figures.svg(figure, f"weights{follower}", f"Weights of the hypotheses of {name}, the heaviest first")]


def _found(flight: Flight, followers: Sequence[int]) -> list[Block]:
    """What the followers believe of biases, current and offsets at the end, if they estimate them."""
    rows: list[list[Cell]] = []
    for i in followers:
        for name, value, sigma in flight.estimates[i].further_states():
            if np.isfinite(value):
                per = 180.0 / np.pi if name in _IN_DEGREES else 1.0
                label = _IN_DEGREES.get(name, name)
                cells = [words(flight.trajectory.names[i + 1]), words(label)]
                rows.append([*cells, number(per * value), number(per * sigma)])
    if not rows:
        return []
    heads = ["follower", "state", "estimate", "σ"]
    return [Table(heads=heads, rows=rows, caption="What the navigator believes of its sensors after the last message.")]


def section(flight: Flight, errors: Sequence[tuple[Floats, Floats]], bounds: Sequence[Floats], drawn: int) -> Section:
    """Error, believed error and least possible error of the first `drawn` followers over time."""
    width = HALF if drawn > 1 else FULL
    panels = [_error_panel(flight, i, errors[i][0], bounds[i], width) for i in range(drawn)]
    panels += [panel for i in range(drawn) for panel in _weight_panel(flight, i, width)]
    figure = Figures(
        panels=panels,
        caption="E_P, the root of the trace of the estimate's own covariance, and the Cramér–Rao bound: the least RMS "
        "of dead reckoning with log and compass as inputs, corrected by these ranges, with constant biases.",
        legend=[(ESTIMATE, "E_P"), (INK, "what the covariance says"), (MUTED, "bound")],
    )
    return Section(title="What was possible", blocks=[figure, *_found(flight, range(drawn))])
