"""The report of the pitch study, for someone who has not read the code."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from experiments import asymmetry_figures as drawing
from experiments.anatomy import LABELS, Anatomy, Cause
from experiments.asymmetry_conditions import SEED, Condition, command
from experiments.asymmetry_example import DEPTH_SIGMA_M, EVERYTHING, OFFSET_M, ROUTE, Example
from experiments.asymmetry_figures import AWARE, LEVEL, REAL
from experiments.asymmetry_gates import GateRow
from experiments.asymmetry_missions import Plan, Row
from experiments.asymmetry_tables import (
    Excess,
    Mission,
    driven,
    gate_table,
    mission_table,
    paired,
    planner_table,
    remedy_table,
    removed_in_all,
    stage_4_table,
)
from experiments.asymmetry_tau import Curves
from experiments.figures import SERIES, Colour, svg
from experiments.page import Block, Code, Figures, Film, Notice, Page, Section, Table, Text, number, words, write
from experiments.version import code_version

Floats = npt.NDArray[np.float64]

_CAUSE_COLOURS: dict[str, tuple[str, Colour]] = {
    "trim": ("trim", SERIES[0]),
    "dive": ("depth changes", SERIES[2]),
    "waves": ("waves", SERIES[1]),
}
_ASYMMETRY = ((Cause.LEVER_ARM, SERIES[1]), (Cause.RANDOM, SERIES[0]), (Cause.MOTION, SERIES[2]))
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


def _legend(*entries: tuple[Colour, str]) -> list[tuple[str, str]]:
    return [(colour.variable, text) for colour, text in entries]


def _anatomy_table(anatomy: Anatomy) -> Table:
    rows = []
    for cause in Cause:
        share = 100 * anatomy.share[..., cause]
        rows.append(
            [
                words(LABELS[cause]),
                *(number(float(np.sqrt(np.nanmean(share[:, i] ** 2))), 1) for i in range(3)),
                number(100 * float(np.sqrt(np.nanmean(anatomy.asymmetry[:, cause] ** 2))), 1),
                number(100 * float(np.nanmax(np.abs(anatomy.asymmetry[:, cause]))), 1),
            ]
        )
    return Table(
        heads=("cause", "rear", "front", "middle", "rms", "largest"),
        rows=rows,
        groups=(("", 1), ("share of the range error, rms [cm]", 3), ("front less rear [cm]", 2)),
        caption="Each range error is the exact sum of these shares. What both ends have in common moves the fix to and "
        "fro along its ray; what differs turns it about the leader.",
    )


def _question() -> Section:
    return Section(
        title="The question",
        blocks=[
            Text(
                text="A leader carries an acoustic transmitter at its bow and one at its stern. A follower measures the "
                "range to both and draws two circles; it is where they meet. It knows both depths, but it believes that "
                "the leader is level. A real hull is not: it trims against its buoyancy, it noses up and down to change "
                "depth, and it works in waves. Then bow and stern sit at depths that the follower does not expect, one "
                "range comes out too long and the other too short, and the circles meet in the wrong place."
            ),
            Text(
                text="The paper stands in for this by a larger random error at one transmitter (its Stage 4). Here the "
                "leader is a rigid body in water and pitches for a reason. How far off do the followers get, when does "
                "it matter, and what can be done about it?"
            ),
        ],
    )


def _one_message(example: Example) -> Section:
    anatomy, message = example.anatomy, drawing.Message(example.flight.trajectory, example.telling)
    shares = [(anatomy.asymmetry[:, cause], colour) for cause, colour in _ASYMMETRY]
    time, pitch = example.flight.trajectory.time, np.rad2deg(example.flight.trajectory.pitch[:, 0])
    half = time <= min(200.0, float(time[-1]))
    seen = anatomy.time <= min(200.0, float(time[-1]))
    error = float(np.hypot(*(message.fix - message.hydrophone[:2])))
    return Section(
        title="Anatomy of one message",
        blocks=[
            Figures(
                panels=[
                    svg(drawing.message_side(message), "side"),
                    svg(drawing.message_hull(message), "hull"),
                    svg(drawing.message_top(message), "top"),
                ],
                caption=f"{example.condition.label}, route {ROUTE}, follower {OFFSET_M:g} m below: a message "
                f"sent at a pitch of {np.rad2deg(message.pitch):+.1f}°. Bow and stern have left the depth that the follower believes in by centimetres. With the circles drawn about "
                f"the places of a level leader, those centimetres become {error:.2f} m: the fix stays on the dotted circle about "
                "the leader; its range is right, its direction is wrong.",
                legend=_legend((REAL, "as it is"), (LEVEL, "as the follower believes, and the truth it looks for")),
            ),
            Text(
                text="Why so much? The fix comes from the difference of two ranges over a short baseline, which "
                "multiplies it. Written out, with the follower Δz deeper and the leader pitched up by φ, the fix keeps its "
                "range and lands at the bearing B̂ with cos B̂ = cos B cos φ − (Δz/D) sin φ. For small angles that is an error "
                "of Δz sin φ / |sin B|: abeam it does not depend on the range, and not on the baseline either."
            ),
            Figures(
                panels=[
                    svg(drawing.anatomy_over_time(anatomy.time[seen], [(s[seen], c) for s, c in shares],
                                                  "What tells bow from stern"), "shares"),
                    svg(drawing.pitch_over_time(time[half], pitch[half], "Pitch of the leader"), "pitch"),
                ],
                caption="The same flight over its first minutes. The lever arm follows the pitch; the paper's random error "
                "(τ = 1 cm) is the blue fringe.",
                legend=_legend(*((colour, LABELS[cause]) for cause, colour in _ASYMMETRY)),
            ),
            _anatomy_table(anatomy),
            Text(
                text="For this table every cause is switched on at once: travel time with pings "
                f"{EVERYTHING['ping_slot_s']:g} s apart, a speed of sound believed {EVERYTHING['sound_speed_bias_m_s']:g} m/s "
                f"too high, a clock {1e3 * float(EVERYTHING['clock_offset_s']):g} ms ahead, depths measured to "
                f"{100 * DEPTH_SIGMA_M:g} cm. Everywhere else in this report they are off, as in the paper."
            ),
            Code(text=command(example.condition, ROUTE, OFFSET_M), title="Fly it, with film and report:"),
        ],
    )  # fmt: skip


def _map(chart: pa.Table) -> Section:
    columns = {name: chart[name].to_numpy().astype(np.float64) for name in chart.column_names}

    def at(**fixed: float) -> npt.NDArray[np.bool_]:
        chosen = np.ones(chart.num_rows, dtype=np.bool_)
        for name, value in fixed.items():
            chosen &= np.isclose(columns[name], value)
        return chosen

    panels = []
    for offset in (0.0, 5.0):
        here = at(pitch_deg=5.0, depth_offset_m=offset)
        reach, bearing = np.unique(columns["range_m"][here]), np.unique(columns["bearing_deg"][here])
        error = columns["error_laisn-2_m"][here].reshape(reach.size, bearing.size)
        title = f"LAISN-2, pitch 5°, follower {offset:g} m below"
        panels.append(svg(drawing.heat(bearing, reach, error, title), f"heat{offset:g}"))
    pitches = np.unique(columns["pitch_deg"])
    for name, bearing in (("abeam", 90.0), ("on the quarter, B = 135°", 135.0)):
        curves = []
        for offset, colour in ((2.0, SERIES[0]), (5.0, SERIES[2]), (10.0, SERIES[1])):
            here = at(range_m=20.0, bearing_deg=bearing, depth_offset_m=offset)
            curves.append(
                (f"{offset:g} m", columns["error_closed_form_m"][here], columns["error_laisn-2_m"][here], colour)
            )
        title = f"20 m {name}, by depth offset"
        panels.append(svg(drawing.over_pitch(pitches, curves, title), f"pitch{bearing:g}"))
    abeam = at(pitch_deg=5.0, depth_offset_m=10.0, range_m=20.0, bearing_deg=90.0)
    measured = float(columns["error_laisn-2_m"][abeam][0])
    fits = np.isfinite(columns["error_closed_form_m"]) & (columns["error_closed_form_m"] > 0)
    difference = np.abs(columns["error_laisn-2_m"] - columns["error_closed_form_m"])[fits]
    return Section(
        title="The map",
        blocks=[
            Figures(
                panels=panels,
                caption="Error of one noiseless fix. Above: around the leader, at the same depth and 5 m below. Below: over "
                "pitch; lines are the closed form, dots the campaign engine.",
            ),
            Text(
                text=f"At 5° and 10 m the error abeam is {measured:.3f} m at every range. Over all {chart.num_rows:,} points "
                f"of the map, closed form and engine differ by at most {float(difference.max()):.1g} m wherever the circles "
                "meet. At equal depth only foreshortening is left: the baseline looks shorter, which grows with the range "
                "and vanishes abeam. Toward the axis (B = 0°, 180°) a small turn is a large step sideways, until the circles "
                "no longer meet and the follower is put on the axis. Ahead and astern, nose up and nose down differ: there "
                "the lever arm adds to foreshortening or works against it."
            ),
            Text(
                text="A third transmitter amidships makes no difference to a fix: it lies on the same tilted hull, so that every "
                "pair of transmitters is wrong by the same angle (`map.parquet` holds all variants)."
            ),
        ],
    )  # fmt: skip


def _missions(results: Results, missions: dict[Mission, Excess]) -> Section:
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
                text="Each condition is flown with the physics of hull, autopilot and sea; followers on all routes then "
                "navigate behind the leader as it moved and, with the same noise, behind one whose transmitters stayed level. "
                "What the second does better is the pitch-driven part."
            ),
            Figures(
                panels=[scatter],
                caption="Each dot is a mission: a condition, a route, a depth offset. The dashed line says that the mean error "
                "grows by Δz sin φ. Dots far above it are missions in which pitch pushes the estimate over the leader's axis, "
                "where the nearest intersection is the wrong one and stays so. Dots below it are missions in which the pitch "
                "is small beside the other errors, with which it adds in squares. Excesses under 1 mm are drawn at 1 mm.",
                legend=_legend(*legend),
            ),
            Figures(
                panels=panels,
                caption="Mean error of LAISN-2 behind a level leader, the real one, and the real one when it broadcasts its "
                "attitude with an error of 0.5°.",
                legend=_legend((LEVEL, "level leader"), (REAL, "real leader"), (AWARE, "attitude broadcast")),
            ),
            table,
            Code(text=lines, title="Commands that fly the worst route of each row", folded=True),
        ],
    )


def _stage_4(results: Results) -> Section:
    offsets = [o for o in (2.0, 5.0, 10.0) if o in results.plan.offsets_m]
    return Section(
        title="The paper's Stage 4, read in degrees",
        blocks=[
            Text(
                text="The paper raises τ, the width of one transmitter's random error, to 3 and 6 cm. This is the pitch "
                "that raises the mean error as much. The two are not the same thing: τ is drawn anew for each message, a "
                "trimmed hull errs the same way each time."
            ),
            stage_4_table(results.curves, offsets),
        ],
    )


def _remedies(results: Results, missions: dict[Mission, Excess]) -> Section:
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
            text="Attitude broadcast: the message carries the measured pitch and roll, and the follower draws its circles "
            "about the places where the transmitters are, in three dimensions (`leader.broadcast_attitude`, "
            "`navigation.use_attitude`). Inflated σp: the follower trusts fixes less by the pitch it must expect "
            "(`navigation.expected_pitch_deg`)."
        ),
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
                text=f"Inflating σp removes {distrust:.0f} % of the sum: the other source is no better. With the paper's log "
                "and compass a follower drifts by 0.24 m each second, always the same way, and whoever trusts fixes less "
                "follows that drift. A systematic error is not cured by calling it noise."
            )
        )
    blocks.append(
        Text(
            text="The middle transmitter does not see the tilt, but it breaks the symmetry about the leader's axis. Runs "
            f"captured on its wrong side behind the real leader, against the level one, in all missions: {counts}."
        )
    )
    return Section(title="Remedies", blocks=blocks)


def _limits(results: Results) -> Section:
    return Section(
        title="Limits",
        blocks=[
            Text(
                text="All missions are those of one 2 m hull with one autopilot; how much another hull pitches "
                "must be measured on it, what a given pitch does need not. Followers keep a constant depth, so that their "
                "depth offset varies while the leader dives. Waves keep their compass direction: what comes from ahead on the "
                "leader's first leg comes from abeam on its second. Rays are straight, the sea surface and the floor mirror "
                "without loss, and the error of the broadcast attitude is drawn anew for each message; a constant "
                "misalignment of the sensor would act as that much pitch. The follower routes fit the published ones; the "
                "originals were never published."
            ),
        ],
    )


def _met(missions: dict[Mission, Excess]) -> list[Block]:
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
                text="Two reasons. A sensor error of 0.5° in each message is a pitch of 0.5° that nobody told the follower: "
                "errors add in squares, so that it can take away nine tenths of the excess only where the leader pitches by "
                "√10 times as much, 1.6° rms. And a mission near the leader's axis is a lottery of captures: one run more or "
                "less on the wrong side moves its mean by decimetres, whatever the pitch."
            )
        )
    return blocks


def _summary(missions: dict[Mission, Excess]) -> str:
    chosen = driven(missions, "laisn-2")
    if not chosen:
        return "In the conditions flown, pitch made no difference."
    worst = max(chosen, key=lambda e: e.part)
    steep = [e for e in chosen if e.real.pitch_rms_deg >= 2.0]
    removed = f"{100 * removed_in_all(steep, 'attitude-0.5'):.0f} %" if steep else "most"
    return (
        "A pitching leader turns its followers' fixes about itself, by Δz sin φ abeam and more toward its axis. "
        f"On missions that adds up to {worst.part:.1f} m to the mean error (route {worst.real.route}, "
        f"{worst.real.depth_offset_m:g} m below, {worst.real.pitch_rms_deg:.1f}° rms), because estimates are pushed over the "
        f"leader's axis. Broadcasting the attitude to 0.5° removes {removed} of it where the leader pitches by 2° rms or more."
    )


def write_report(results: Results, path: Path) -> None:
    """Write the page; the same results give the same bytes."""
    missions = paired(results.missions)
    short = _met(missions)
    sections: Sequence[Section] = [
        _question(),
        _one_message(results.example),
        _map(results.chart),
        _missions(results, missions),
        _stage_4(results),
        _remedies(results, missions),
        *([Section(title="Where the remedy falls short", blocks=short)] if short else []),
        Section(
            title="Table for a planner",
            blocks=[
                Text(
                    text="If neither leader nor follower can be changed, the formation can. The pitch is the largest that the "
                    "leader reaches, not its mean."
                ),
                *(planner_table(reach, bound) for reach in (40.0, 100.0) for bound in (0.5, 1.0)),
            ],
        ),
        Section(
            title="Gross errors and the gate",
            blocks=[
                Text(
                    text="An echo taken for the ping is the gross error that the paper's gate is for. The two ways to bound what "
                    "a follower can have travelled since its last accepted fix: at its top speed, or at its measured speed."
                ),
                gate_table(results.gates),
            ],
        ),
        _limits(results),
    ]  # fmt: skip
    if results.film:
        film = Film(path=results.film, caption="Following sea: the leader pitches, and the estimates with it.")
        sections = [*sections[:2], Section(title="Film", blocks=[film]), *sections[2:]]
    facts = [
        ("conditions", str(len(results.conditions))),
        ("missions", f"{len({(r.condition, r.route, r.depth_offset_m) for r in results.missions})}"),
        ("flown runs", f"{sum(r.runs for r in results.missions):,} of {results.plan.duration_s:g} s"),
        ("seed", str(SEED)),
        ("version", code_version()),
    ]
    write(Page(title="What a pitching leader does to its followers", summary=_summary(missions), facts=facts,
               sections=sections), path)  # fmt: skip
