"""Remedies in the pitch study's report: what each removes, what it leaves, and where it falls short."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.asymmetry import figures as drawing
from experiments.asymmetry.added_error import (
    CAPTURES_WANTED,
    JUDGED_FROM_M,
    QUESTIONS,
    SETTLING_RUNS,
    ComparedMission,
    Mission,
    captures_in_all,
    captures_removed,
    judged,
    mean_added,
    mean_of,
    of_cause,
    open_questions,
    removed_in_all,
)
from experiments.asymmetry.figures import AWARE
from experiments.asymmetry.missions import Plan
from experiments.asymmetry.remedies import (
    CROOKED,
    EXACT,
    INFLATED,
    LEVEL,
    LEVEL_BROADCAST,
    READINGS,
    REAL,
    REMEDIES,
    STEADIED,
)
from experiments.asymmetry.tables import mean_cell
from experiments.asymmetry.verdict import WRONG, Verdict, counts
from experiments.intervals import Interval
from experiments.pages.figures import svg
from experiments.pages.page import Block, Cell, Figures, Notice, Table, number, percent, words
from experiments.pages.style import MUTED, SERIES

CAUSES = {"trim": "trim", "dive": "depth changes", "waves": "waves"}
"""What makes the leader pitch, and its name on the page."""
_COLOURS = dict(
    zip(REMEDIES, (SERIES[2], AWARE, SERIES[4], MUTED, SERIES[3], SERIES[1]), strict=True)
)  # by arm, for the figure


def _against(share: Interval, aim: float, digits: int = 1) -> Cell:
    """A share with its interval, marked if the whole of it is beyond or short of its aim."""
    return percent(share, digits, tone="yes" if share.beyond(aim) else "no" if share.short(aim) else "")


def _verdict_cells(verdicts: Sequence[Verdict]) -> list[Cell]:
    met, undecided, missed, harmless = counts(verdicts)
    return [
        number(met, 0), number(undecided, 0), number(missed, 0, tone="maybe" if missed else ""), number(harmless, 0)
    ]  # fmt: skip


def _remedy_table(missions: dict[Mission, ComparedMission], variants: Sequence[str]) -> Table:
    """How much of the pitch-driven error each remedy removes, and on how many missions it meets its aim."""
    rows = []
    for arm in REMEDIES:
        for variant in variants:
            for cause, name in CAUSES.items():
                chosen = [e for e in judged(missions, variant, cause) if arm.key in e.arms]
                if chosen:
                    rows.append(
                        [
                            words(arm.label), words(variant), words(name), number(len(chosen), 0),
                            words(f"{100 * arm.wanted:.0f} %"),
                            _against(removed_in_all(chosen, arm), arm.wanted),
                            *_verdict_cells([Verdict(e.arms[arm.key].error_verdict) for e in chosen]),
                            *_verdict_cells([Verdict(e.arms[arm.key].capture_verdict) for e in chosen]),
                        ]
                    )  # fmt: skip
    return Table(
        heads=("remedy", "variant", "cause", "missions", "aim", "of the sum [%]",
               *("met", "open", "missed", "no harm shown") * 2),
        rows=rows,
        groups=(("", 5), ("error removed", 1), ("aim on errors without capture is", 4),
                (f"{100 * CAPTURES_WANTED:.0f} % of added captures is", 4)),
        caption="Missions in which the closed form says, before anybody navigates, that pitch moves a fix by "
        f"{100 * JUDGED_FROM_M:g} cm or more in the mean. Of the sum: of all that pitch adds to the mean error on "
        "these missions, captured runs included, with its 95 % interval. Then mission by mission: errors in runs that "
        "nobody captures, and captures. Met or missed: the whole interval lies beyond the aim or short of it; each "
        f"is wrong in about {100 * WRONG:g} % of missions at the edge of the aim. No harm shown: the first runs do "
        "not show that pitch adds anything, or too few of them are free of capture.",
    )  # fmt: skip


def _open_table(missions: dict[Mission, ComparedMission], plan: Plan) -> Table | None:
    """What stays open, and how many runs would settle it; None if nothing does."""
    rows = []
    for arm in REMEDIES:
        for variant in plan.variants:
            chosen = [e for e in judged(missions, variant) if arm.key in e.arms]
            for question in QUESTIONS:
                found = open_questions(chosen, arm, plan.looks, question)
                if found:
                    removed, needed = np.array(found).T
                    few, many = (int(np.sum(needed <= most)) for most in SETTLING_RUNS)
                    share = Interval(*np.quantile(removed, (0.5, 0.25, 0.75)).tolist())
                    rows.append(
                        [
                            words(arm.label), words(variant), words(f"{question}s"), number(len(found), 0),
                            number(few, 0), number(many - few, 0), number(len(found) - many, 0), percent(share, 0),
                        ]
                    )  # fmt: skip
    few_runs, many_runs = (f"{runs:,}" for runs in SETTLING_RUNS)
    table = Table(
        heads=("remedy", "variant", "aim on", "open", f"up to {few_runs}", f"up to {many_runs}", "more",
               "removed there [%]"),
        rows=rows,
        groups=(("", 4), ("settled by so many runs", 3), ("", 1)),
        caption=f"Missions whose verdict is open after {plan.looks[-1]:,} runs, or after fewer where that many would "
        "hardly settle it. They are sorted by the runs that would, if mean and scatter stayed as they are. Removed: "
        "median and quartiles of the shares that the remedy removes on them. The nearer such a share is to the aim, "
        "the more runs it takes to tell on which side it lies.",
    )  # fmt: skip
    return table if rows else None


def _capture_table(missions: dict[Mission, ComparedMission], variants: Sequence[str]) -> Table:
    """How often estimates are captured, behind which leader and with which remedy."""
    rows = []
    for variant in variants:
        for cause, name in CAUSES.items():
            chosen = of_cause(missions, variant, cause)
            for arm in (LEVEL, REAL, LEVEL_BROADCAST, *REMEDIES):
                if chosen and arm.key in chosen[0].arms:
                    removed = captures_removed(chosen, arm) if arm in REMEDIES else None
                    rows.append(
                        [
                            words(variant), words(name), words(arm.label),
                            number(sum(e.arms[arm.key].runs for e in chosen), 0),
                            percent(captures_in_all(chosen, arm), 2),
                            _against(removed, CAPTURES_WANTED) if removed else words("–"),
                        ]
                    )  # fmt: skip
    return Table(
        heads=("variant", "cause", "arm", "runs", "captured [%]", "of those that pitch adds, removed [%]"),
        rows=rows,
        caption="Runs whose estimate is for a message interval more than 5 m off and at least twice as far from the "
        "truth as from its mirror image beyond the leader's axis; all missions. Chance of capture with the limits of "
        "Clopper and Pearson, share removed with those of Fieller, 95 %.",
    )


def _route_table(missions: dict[Mission, ComparedMission], routes: Sequence[str]) -> Table:
    """What pitch does on each route, and how much of it goes, over all conditions and depth offsets of a cause."""
    rows = []
    for route in routes:
        row: list[Cell] = [words(route)]
        for cause in CAUSES:
            chosen = of_cause(missions, "laisn-2", cause, route)
            row.append(mean_cell(mean_added(chosen, REAL)) if chosen else words("–"))
            row += [_against(removed_in_all(chosen, arm), arm.wanted) for arm in (EXACT, STEADIED, READINGS)]
        rows.append(row)
    return Table(
        heads=("route", *("excess [m]", "exact", "AHRS", "each 0.5°") * len(CAUSES)),
        rows=rows,
        groups=(("", 1), *((f"{name}: removed [%]", 4) for name in CAUSES.values())),
        caption="Mean excess of LAISN-2 on each route, ± half of its 95 % interval over runs, and how much of it the "
        "broadcast attitude removes, with 95 % intervals: exactly known, from the AHRS, and with each message 0.5° "
        "off. Green: the whole interval is beyond 99 % (exact) or 90 %; red: short of it.",
    )


def _split_table(missions: dict[Mission, ComparedMission], offsets: Sequence[float]) -> Table:
    """What is left with a broadcast attitude: of the pitch, and of the sensor."""
    rows = []
    for cause, name in CAUSES.items():
        for offset in offsets:
            chosen = [e for e in of_cause(missions, "laisn-2", cause) if e.real.depth_offset_m == offset]
            rows.append(
                [
                    words(name),
                    number(offset, 0),
                    number(mean_of(e.real.pitch_rms_deg for e in chosen), 1),
                    mean_cell(mean_added(chosen, REAL), 1, 100.0),
                    mean_cell(mean_added(chosen, READINGS, LEVEL_BROADCAST), 1, 100.0),
                    mean_cell(mean_added(chosen, LEVEL_BROADCAST), 1, 100.0),
                    number(mean_of(e.real.inclinometer_rms_deg for e in chosen), 1),
                    number(mean_of(e.real.ahrs_rms_deg for e in chosen), 2),
                    mean_cell(mean_added(chosen, STEADIED), 1, 100.0),
                    mean_cell(mean_added(chosen, CROOKED), 1, 100.0),
                ]
            )
    return Table(
        heads=("cause", "offset [m]", "pitch rms [°]", "not known", "by pitch", "by sensor", "inclinometer [°]",
               "AHRS [°]", "left", "left"),
        rows=rows,
        groups=(("", 3), ("excess [cm]", 1), ("each message 0.5° off [cm]", 2), ("AHRS: errors, excess [cm]", 3),
                ("constant 0.5° [cm]", 1)),
        caption="Excess of the mean error of LAISN-2, over all routes. With each message 0.5° off it falls into what "
        "the pitch still does (real leader less level leader, both with that sensor) and what the sensor does to a "
        "level leader's followers; ± half of the 95 % interval over runs. Inclinometer, AHRS: rms error of the "
        "pitch that they give.",
    )  # fmt: skip


def in_words(share: Interval) -> str:
    """A share in per cent with its interval, as part of a sentence."""
    return f"{100 * share.value:.0f} % ({100 * share.low:.0f} to {100 * share.high:.0f} %)"


def _inflated(chosen: Sequence[ComparedMission]) -> str:
    """What inflating σp removes, cause by cause, in words."""
    by_cause = {name: [e for e in chosen if e.real.cause == cause] for cause, name in CAUSES.items()}
    return ", ".join(
        f"{in_words(removed_in_all(mine, INFLATED))} with {name}" for name, mine in by_cause.items() if mine
    )


def remedies(missions: dict[Mission, ComparedMission], plan: Plan) -> dict[str, Any]:
    """Values of the page's template on what each remedy removes."""
    chosen = judged(missions, "laisn-2")
    removed: list[Block] = []
    if chosen:
        by_pitch = sorted(chosen, key=lambda e: e.real.pitch_rms_deg)
        arms = [(arm.short, np.array([e.removed(arm) for e in by_pitch]), _COLOURS[arm]) for arm in REMEDIES]
        figure = svg(drawing.removed_shares(arms, "LAISN-2, a dot for each mission"), "removed")
        caption = (
            "Share of what pitch adds to the mean error in runs without capture. 1: all of it removed. Below 0: more "
            "than without the remedy. In each band pitch grows from the lowest dot to the highest."
        )
        removed.append(Figures(panels=[figure], caption=caption))
    undecided = _open_table(missions, plan)
    return {
        "removed": removed,
        "remedies": _remedy_table(missions, plan.variants),
        "undecided": [undecided] if undecided else [],
        "captures": _capture_table(missions, plan.variants),
        "split": _split_table(missions, plan.offsets_m),
        "by_route": _route_table(missions, plan.routes),
        "inflated": _inflated(chosen),
    }


def shortfalls(missions: dict[Mission, ComparedMission], plan: Plan) -> dict[str, Any]:
    """Values of the page's template on missions where the broadcast attitude falls short of its aim."""
    blocks: list[Block] = []
    for arm in (EXACT, STEADIED, READINGS, CROOKED):
        for cause, label in CAUSES.items():
            chosen = judged(missions, "laisn-2", cause)
            missed = [e for e in chosen if e.arms[arm.key].error_verdict == Verdict.MISSED.value]
            if missed:
                text = (
                    f"{arm.short}, {label}: on {len(missed)} of {len(chosen)} missions (LAISN-2) the runs show that "
                    f"more than {100 * (1 - arm.wanted):.0f} % of the pitch-driven error without captures stays; the "
                    f"largest such rest is {max(e.left_free(arm) for e in missed):.2f} m."
                )
                blocks.append(Notice(text=text, tone="warning"))
    _, undecided, missed_paired, _ = counts(
        e.judge_errors(READINGS, plan.looks, LEVEL_BROADCAST).verdict for e in judged(missions, "laisn-2")
    )
    return {"shortfalls": blocks, "missed_paired": missed_paired, "open_paired": undecided}
