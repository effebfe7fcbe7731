"""Second half of the pitch study's report: missions, the paper's Stage 4, remedies, and where they fall short."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa

from experiments import asymmetry_figures as drawing
from experiments.asymmetry_conditions import Condition
from experiments.asymmetry_example import Example
from experiments.asymmetry_figures import AWARE, LEVEL, REAL
from experiments.asymmetry_gates import GateRow
from experiments.asymmetry_missions import Plan, Row
from experiments.asymmetry_opening import legend_of
from experiments.asymmetry_tables import (
    Excess,
    Mission,
    driven,
    mission_table,
    remedy_table,
    removed_in_all,
    route_table,
    stage_4_table,
)
from experiments.asymmetry_tau import Curves
from experiments.figures import SERIES, Colour, svg
from experiments.page import Block, Code, Figures, Notice, Section, Text

_CAUSE_COLOURS: dict[str, tuple[str, Colour]] = {
    "trim": ("trim", SERIES[0]),
    "dive": ("depth changes", SERIES[2]),
    "waves": ("waves", SERIES[1]),
}
_REMEDY_NAMES = {
    "attitude-0": "attitude, exact",
    "attitude-0.5": "attitude, 0.5°",
    "attitude-2": "attitude, 2°",
    "expected": "σp inflated",
}
REMEDIES = ("attitude-0", "attitude-0.5", "attitude-2", "expected")


@dataclass(frozen=True, kw_only=True)
class Results:
    """All that the study came to."""

    plan: Plan
    conditions: tuple[Condition, ...]
    missions: tuple[Row, ...]
    curves: Curves
    gates: tuple[GateRow, ...]
    chart: pa.Table
    """As of `asymmetry_map.measure_map`."""
    example: Example
    film: Path | None


def on_missions(results: Results, missions: dict[Mission, Excess]) -> Section:
    """What pitch does on missions."""
    two = [e for (_, _, _, variant), e in missions.items() if variant == "laisn-2"]
    groups, legend = [], []
    for cause, (label, colour) in _CAUSE_COLOURS.items():
        chosen = [e for e in two if e.real.cause == cause]
        if chosen:
            groups.append((np.array([e.lever for e in chosen]), np.array([e.part for e in chosen]), colour))
            legend.append((colour, label))
    scatter = svg(drawing.excess_over_lever(groups, "All missions, LAISN-2"), "excess")
    offsets = np.array(results.plan.offsets_m)
    panels = []
    for cause, (label, _) in _CAUSE_COLOURS.items():
        curves = []
        for arm, colour in (("level", LEVEL), ("real", REAL), ("attitude-0.5", AWARE)):
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
    return Section(
        title="On missions",
        blocks=[
            Text(
                text="Each condition is flown with the physics of hull, autopilot and sea; followers on all routes "
                "then navigate behind the leader as it moved and, with the same noise, behind one whose "
                "transmitters stayed level. What the second does better is the pitch-driven part."
            ),
            Figures(
                panels=[scatter],
                caption="Each dot is a mission: a condition, a route, a depth offset. The dashed line says that the "
                "mean error grows by Δz sin φ. Dots far above it are missions in which pitch pushes the estimate "
                "over the leader's axis, where the nearest intersection is the wrong one and stays so. Dots below "
                "it are missions in which the pitch is small beside the other errors, with which it adds in "
                "squares. Excesses under 1 mm are drawn at 1 mm.",
                legend=legend_of(*legend),
            ),
            Figures(
                panels=panels,
                caption="Mean error of LAISN-2 behind a level leader, the real one, and the real one when it "
                "broadcasts its attitude with an error of 0.5°.",
                legend=legend_of((LEVEL, "level leader"), (REAL, "real leader"), (AWARE, "attitude broadcast")),
            ),
            table,
            Code(text=lines, title="Commands that fly the worst route of each row", folded=True),
        ],
    )


def stage_4(results: Results) -> Section:
    """The paper's range errors, read as pitch."""
    offsets = [o for o in (2.0, 5.0, 10.0) if o in results.plan.offsets_m]
    return Section(
        title="The paper's Stage 4, read in degrees",
        blocks=[
            Text(
                text="The paper raises τ, the width of one transmitter's random error, to 3 and 6 cm. This is the "
                "pitch that raises the mean error as much. The two are not the same thing: τ is drawn anew for each "
                "message, a trimmed hull errs the same way each time."
            ),
            stage_4_table(results.curves, offsets),
        ],
    )


def remedies(results: Results, missions: dict[Mission, Excess]) -> Section:
    """What each remedy is worth."""
    arms = []
    chosen = driven(missions, "laisn-2")
    for arm, colour in zip(REMEDIES, (AWARE, SERIES[2], SERIES[4], SERIES[1]), strict=True):
        share = np.array([e.removed(arm) for e in sorted(chosen, key=lambda e: e.real.pitch_rms_deg)])
        arms.append((_REMEDY_NAMES[arm], share, colour))
    names = {cause: label for cause, (label, _) in _CAUSE_COLOURS.items()}
    captured = {
        variant: [sum(getattr(e, arm).captured for (_, _, _, v), e in missions.items() if v == variant)
                  for arm in ("level", "real")]
        for variant in results.plan.variants
    }  # fmt: skip
    counts = "; ".join(f"{variant}: {real:,} against {level:,}" for variant, (level, real) in captured.items())
    blocks: list[Block] = [
        Text(
            text="Attitude broadcast: the message carries the measured pitch and roll, and the follower draws its "
            "circles about the places where the transmitters are, in three dimensions (`leader.broadcast_attitude`, "
            "`navigation.use_attitude`). Inflated σp: the follower trusts fixes less by the pitch it must expect "
            "(`navigation.expected_pitch_deg`)."
        ),
        route_table(missions, results.plan.routes, names),
        remedy_table(missions, results.plan.variants, names),
    ]
    if chosen:
        figure = svg(drawing.removed_shares(arms, "LAISN-2, a dot for each mission"), "removed")
        caption = (
            "1: nothing of the pitch-driven error is left. Below 0: worse than without. In each band pitch grows from "
            "the lowest dot to the highest."
        )
        blocks.append(Figures(panels=[figure], caption=caption))
        distrust = 100 * removed_in_all(chosen, "expected")
        blocks.append(
            Text(
                text=f"Inflating σp removes {distrust:.0f} % of the sum: the other source is no better. With the "
                "paper's log and compass a follower drifts by 0.24 m each second, always the same way, and whoever "
                "trusts fixes less follows that drift. A systematic error is not cured by calling it noise."
            )
        )
    blocks.append(
        Text(
            text="The middle transmitter does not see the tilt, but it breaks the symmetry about the leader's axis. "
            "Runs captured on its wrong side behind the real leader, against the level one, in all missions: "
            f"{counts}."
        )
    )
    return Section(title="Remedies", blocks=blocks)


def shortfalls(missions: dict[Mission, Excess]) -> list[Block]:
    """Where the broadcast attitude falls short of what was hoped for, and why."""
    blocks: list[Block] = []
    for arm, wanted, sigma in (("attitude-0.5", 0.9, 0.5), ("attitude-0", 0.99, 0.0)):
        for cause, (label, _) in _CAUSE_COLOURS.items():
            chosen = driven(missions, "laisn-2", cause)
            short = [e for e in chosen if e.removed(arm) < wanted]
            if not short:
                continue
            gentle = sum(e.real.pitch_rms_deg < sigma * np.sqrt(10.0) for e in short)
            why = (
                f" In {gentle} of them the leader pitches by less than {sigma * np.sqrt(10.0):.1f}° rms."
                if gentle
                else ""
            )
            text = (
                f"{_REMEDY_NAMES[arm]}, {label}: {len(short)} of {len(chosen)} missions (LAISN-2) keep more than "
                f"{100 * (1 - wanted):.0f} % of their pitch-driven error; the largest such error is "
                f"{max(e.part for e in short):.2f} m.{why}"
            )
            blocks.append(Notice(text=text, tone="warning"))
    if blocks:
        blocks.append(
            Text(
                text="Two reasons. A sensor error of 0.5° in each message is a pitch of 0.5° that nobody told the "
                "follower: errors add in squares, so that it can take away nine tenths of the excess only where the "
                "leader pitches by √10 times as much, 1.6° rms. And a mission near the leader's axis is a lottery "
                "of captures: one run more or less on the wrong side moves its mean by decimetres, whatever the "
                "pitch."
            )
        )
    return blocks
