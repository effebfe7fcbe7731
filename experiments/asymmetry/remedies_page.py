"""Remedies in the pitch study's report: what each removes, what it leaves, and where it falls short."""

from collections.abc import Sequence

import numpy as np

from experiments.asymmetry import figures as drawing
from experiments.asymmetry.added_error import SMALLEST_PART_M, Excess, Mission, driven, mean_of, removed_in_all
from experiments.asymmetry.figures import AWARE
from experiments.asymmetry.remedies import (
    CROOKED,
    EXACT,
    INFLATED,
    LEVEL_BROADCAST,
    READINGS,
    REMEDIES,
    STEADIED,
)
from experiments.asymmetry.verdict import Verdict, counts
from experiments.pages.figures import MUTED, SERIES, svg
from experiments.pages.page import Block, Cell, Figures, Notice, Section, Table, Text, number, words

CAUSES = {"trim": "trim", "dive": "depth changes", "waves": "waves"}
"""What makes the leader pitch, and its name on the page."""
_COLOURS = dict(
    zip(REMEDIES, (SERIES[2], AWARE, SERIES[4], MUTED, SERIES[3], SERIES[1]), strict=True)
)  # by arm, for the figure


def _remedy_table(missions: dict[Mission, Excess], variants: Sequence[str]) -> Table:
    """How much of the pitch-driven part each remedy removes."""
    rows = []
    for arm in REMEDIES:
        for variant in variants:
            for cause, name in CAUSES.items():
                chosen = [e for e in driven(missions, variant, cause) if arm.key in e.arms]
                if not chosen:
                    continue
                share = np.array([e.removed(arm) for e in chosen])
                met, undecided, missed = counts(e.verdict(arm, len(chosen)) for e in chosen)
                rows.append(
                    [
                        words(arm.label),
                        words(variant),
                        words(name),
                        number(len(chosen), 0),
                        number(100 * removed_in_all(chosen, arm), 1),
                        number(100 * float(np.median(share)), 1),
                        number(100 * float(share.min()), 0),
                        words(f"{100 * arm.wanted:.0f} %"),
                        number(met, 0),
                        number(undecided, 0),
                        number(missed, 0, tone="maybe" if missed else ""),
                    ]
                )
    return Table(
        heads=("remedy", "variant", "cause", "missions", "of the sum", "median", "smallest", "aim", "met", "open",
               "missed"),
        rows=rows,
        groups=(("", 4), ("removed [%]", 3), ("missions in which the aim is", 4)),
        caption=f"Of the pitch-driven part, real less level, in all missions where it is {100 * SMALLEST_PART_M:g} cm "
        "or more. Negative: the remedy harms. Open: the mean misses the aim, but within the scatter of its runs, as "
        "where one run more or less on the wrong side of the leader's axis decides (paired t-test over the runs, 1 % "
        "over all missions of a row together).",
    )  # fmt: skip


def _route_table(missions: dict[Mission, Excess], routes: Sequence[str]) -> Table:
    """What pitch does on each route, and how much of it goes, over all conditions and depth offsets of a cause."""
    rows = []
    for route in routes:
        row: list[Cell] = [words(route)]
        for cause in CAUSES:
            chosen = [
                e
                for (_, flown, _, variant), e in missions.items()
                if (flown, variant, e.real.cause) == (route, "laisn-2", cause)
            ]
            row.append(number(mean_of(e.part for e in chosen), 2))
            for arm in (EXACT, STEADIED, READINGS):
                share = removed_in_all(chosen, arm)
                row.append(number(100 * share, 1, tone="" if share >= arm.wanted else "maybe"))
        rows.append(row)
    return Table(
        heads=("route", *("excess [m]", "exact", "AHRS", "each 0.5°") * len(CAUSES)),
        rows=rows,
        groups=(("", 1), *((f"{name}: removed [%]", 4) for name in CAUSES.values())),
        caption="Mean excess of LAISN-2 on each route, and how much of it the broadcast attitude removes: exactly "
        "known, from the AHRS, and with each message 0.5° off. Marked: less than 99 % of it (exact) or 90 %.",
    )


def _split_table(missions: dict[Mission, Excess], offsets: Sequence[float]) -> Table:
    """What is left with a broadcast attitude: of the pitch, and of the sensor."""
    rows = []
    for cause, name in CAUSES.items():
        for offset in offsets:
            chosen = [
                e
                for (_, _, below, variant), e in missions.items()
                if (below, variant, e.real.cause) == (offset, "laisn-2", cause)
            ]
            rows.append(
                [
                    words(name),
                    number(offset, 0),
                    number(mean_of(e.real.pitch_rms_deg for e in chosen), 1),
                    number(100 * mean_of(e.part for e in chosen), 1),
                    number(100 * mean_of(e.left(READINGS, LEVEL_BROADCAST) for e in chosen), 1),
                    number(100 * mean_of(e.left(LEVEL_BROADCAST) for e in chosen), 1),
                    number(mean_of(e.real.inclinometer_rms_deg for e in chosen), 1),
                    number(mean_of(e.real.ahrs_rms_deg for e in chosen), 2),
                    number(100 * mean_of(e.left(STEADIED) for e in chosen), 1),
                    number(100 * mean_of(e.left(CROOKED) for e in chosen), 1),
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
        "level leader's followers. Inclinometer, AHRS: rms error of the pitch that they give.",
    )  # fmt: skip


def remedies(missions: dict[Mission, Excess], routes: Sequence[str], offsets: Sequence[float],
             variants: Sequence[str]) -> Section:  # fmt: skip
    """What each remedy is worth."""
    chosen = driven(missions, "laisn-2")
    blocks: list[Block] = [
        Text(
            text="Attitude broadcast: the message carries the measured pitch and roll, and the follower draws its "
            "circles about the places where the transmitters are, in three dimensions (`leader.broadcast_attitude`, "
            "`navigation.use_attitude`). What it is worth depends on the sensor behind it. Vehicles carry an AHRS: "
            "here an inclinometer that is 0.5° off in each reading and takes the accelerations of waves for tilt, "
            "steadied by gyros of 0.3°/√h over 30 s (`sensors.leader_attitude_sigma_deg`, "
            "`leader_attitude_feels_acceleration`, `leader_gyro_time_constant_s`). Beside it stand an error that each "
            "message has anew, and one that a run keeps, as of a crooked mounting. Inflated σp: the follower trusts "
            "fixes less by the pitch it must expect (`navigation.expected_pitch_deg`)."
        )
    ]
    if chosen:
        by_pitch = sorted(chosen, key=lambda e: e.real.pitch_rms_deg)
        arms = [(arm.short, np.array([e.removed(arm) for e in by_pitch]), _COLOURS[arm]) for arm in REMEDIES]
        figure = svg(drawing.removed_shares(arms, "LAISN-2, a dot for each mission"), "removed")
        caption = (
            "1: nothing of the pitch-driven error is left. Below 0: worse than without. In each band pitch grows from "
            "the lowest dot to the highest."
        )
        blocks.append(Figures(panels=[figure], caption=caption))
    blocks += [_remedy_table(missions, variants), _split_table(missions, offsets), _route_table(missions, routes)]
    if chosen:
        distrust = 100 * removed_in_all(chosen, INFLATED)
        blocks.append(
            Text(
                text=f"Inflating σp removes {distrust:.0f} % of the sum: the other source is no better. With the "
                "paper's log and compass a follower drifts by 0.24 m each second, always the same way, and whoever "
                "trusts fixes less follows that drift. A systematic error is not cured by calling it noise."
            )
        )
    captured = {
        variant: [sum(getattr(e, arm).captured for (_, _, _, v), e in missions.items() if v == variant)
                  for arm in ("level", "real")]
        for variant in variants
    }  # fmt: skip
    lost = "; ".join(f"{variant}: {real:,} against {level:,}" for variant, (level, real) in captured.items())
    blocks.append(
        Text(
            text="The middle transmitter does not see the tilt, but it breaks the symmetry about the leader's axis. "
            "Runs captured on its wrong side behind the real leader, against the level one, in all missions: "
            f"{lost}."
        )
    )
    return Section(title="Remedies", blocks=blocks)


def shortfalls(missions: dict[Mission, Excess]) -> list[Block]:
    """Where the broadcast attitude falls short of its aim, and why."""
    blocks: list[Block] = []
    for arm in (EXACT, STEADIED, READINGS, CROOKED):
        for cause, label in CAUSES.items():
            chosen = [e for e in driven(missions, "laisn-2", cause) if arm.key in e.arms]
            judged = [(e, e.verdict(arm, len(chosen))) for e in chosen]
            missed = [e for e, verdict in judged if verdict is Verdict.MISSED]
            if missed:
                text = (
                    f"{arm.short}, {label}: {len(missed)} of {len(chosen)} missions (LAISN-2) keep more than "
                    f"{100 * (1 - arm.wanted):.0f} % of their pitch-driven error; the largest such rest is "
                    f"{max(e.left(arm) for e in missed):.2f} m."
                )
                blocks.append(Notice(text=text, tone="warning"))
    if blocks:
        chosen = driven(missions, "laisn-2")
        _, undecided, missed_paired = counts(
            e.verdict(READINGS, len(chosen), LEVEL_BROADCAST) for e in chosen
        )  # fmt: skip
        blocks.append(
            Text(
                text="An error of 0.5° in each message is a pitch of 0.5° that nobody told the follower: errors add in "
                "squares, so that it can take away nine tenths of the excess only where the leader pitches by √10 "
                "times as much, 1.6° rms. That is the sensor's doing, not the pitch's: against a level leader with the "
                f"same sensor the aim is missed in {missed_paired} of {len(chosen)} missions ({undecided} open). A "
                "constant error adds to the pitch itself and cannot be seen from the ranges: it must be calibrated "
                "away before the mission. Missions near the leader's axis are a lottery of captures: one run "
                "more or less on the wrong side moves their mean by decimetres, whatever the pitch; those are called "
                "open."
            )
        )
    return blocks
