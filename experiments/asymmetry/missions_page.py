"""Missions and the paper's Stage 4, for the page of the pitch study."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from experiments.asymmetry import figures as drawing
from experiments.asymmetry.added_error import ComparedMission, Mission
from experiments.asymmetry.conditions import Condition
from experiments.asymmetry.example import Example
from experiments.asymmetry.figures import AWARE, LEVEL, REAL
from experiments.asymmetry.gates import GateRow
from experiments.asymmetry.missions import Plan, Row
from experiments.asymmetry.remedies import STEADIED
from experiments.asymmetry.remedies_page import CAUSES
from experiments.asymmetry.tables import mission_table, stage_4_table
from experiments.asymmetry.tau import Curves
from experiments.pages.figures import svg
from experiments.pages.page import Code, Figures
from experiments.pages.style import SERIES, Colour

_CAUSE_COLOURS: dict[str, Colour] = {"trim": SERIES[0], "dive": SERIES[2], "waves": SERIES[1]}


@dataclass(frozen=True, kw_only=True)
class Results:
    """All that the study came to."""

    plan: Plan
    conditions: tuple[Condition, ...]
    missions: tuple[Row, ...]
    curves: Curves
    gates: tuple[GateRow, ...]
    chart: pa.Table
    """Table of errors and pitch that `asymmetry.map.measure_map` returns."""
    example: Example
    film: Path | None


def on_missions(results: Results, missions: dict[Mission, ComparedMission]) -> dict[str, Any]:
    """Values of the page's template on missions and on Stage 4."""
    two = [e for (_, _, _, variant), e in missions.items() if variant == "laisn-2"]
    groups, legend = [], []
    for cause, colour in _CAUSE_COLOURS.items():
        chosen = [e for e in two if e.real.cause == cause]
        if chosen:
            groups.append((np.array([e.lever for e in chosen]), np.array([e.part for e in chosen]), colour))
            legend.append((colour, CAUSES[cause]))
    scatter = svg(drawing.excess_over_lever(groups, "All missions, LAISN-2"), "excess")
    offsets = np.array(results.plan.offsets_m)
    panels = []
    for cause, label in CAUSES.items():
        curves = []
        for arm, colour in (("level", LEVEL), ("real", REAL), (STEADIED.key, AWARE)):
            error = [
                float(
                    np.median(
                        [
                            e.arms[arm].e_p_mean_m
                            for e in two
                            if (e.real.cause, e.real.depth_offset_m) == (cause, offset)
                        ]
                    )
                )
                for offset in results.plan.offsets_m
            ]
            curves.append((offsets, np.array(error), colour))
        panels.append(svg(drawing.over_offset(curves, f"{label}, median mission"), f"offset-{cause}"))
    table, lines = mission_table(missions, results.conditions, results.plan.offsets_m, results.curves)
    excess = Figures(
        panels=[scatter],
        caption="Each dot is a mission: a condition, a route, a depth offset. On the dashed line the mean error grows "
        "by Δz sin φ. Dots far above it are missions in which pitch pushes the estimate over the leader's axis, where "
        "the nearest intersection is the wrong one and stays so. Dots below it are missions in which the pitch is "
        "small beside the other errors, with which it adds in squares. Excesses under 1 mm are drawn at 1 mm.",
        legend=legend,
    )
    by_offset = Figures(
        panels=panels,
        caption="Mean error of LAISN-2 behind a level leader, the real one, and the real one when it broadcasts the "
        "attitude of its AHRS.",
        legend=[(LEVEL, "level leader"), (REAL, "real leader"), (AWARE, "attitude broadcast")],
    )
    return {
        "excess": excess,
        "offsets": by_offset,
        "missions": table,
        "commands": Code(text=lines, title="Commands that run the worst route of each row", folded=True),
        "stage_4": stage_4_table(results.curves, [o for o in (2.0, 5.0, 10.0) if o in results.plan.offsets_m]),
    }
