"""First half of the pitch study's report: the question, one message, and the map."""

import numpy as np
import pyarrow as pa

from experiments.asymmetry import figures as drawing
from experiments.asymmetry.conditions import command
from experiments.asymmetry.example import EVERYTHING, OFFSET_M, ROUTE, Example
from experiments.asymmetry.figures import LEVEL, REAL
from experiments.flight.range_budget import LABELS, Cause
from experiments.pages.figures import svg
from experiments.pages.page import Code, Figures, Section, Text
from experiments.pages.range_budget_page import asymmetry_over_time, legend_of, share_table
from experiments.pages.style import SERIES
from laisn.arrays import Bools, Floats

_TOLD = (Cause.LEVER_ARM, Cause.RANDOM, Cause.MOTION)


def question() -> Section:
    """What is asked."""
    return Section(
        title="The question",
        blocks=[
            Text(
                text="A leader carries an acoustic transmitter at its bow and one at its stern. A follower measures "
                "the range to both and draws two circles; it is where they meet. It knows both depths, but it "
                "believes that the leader is level. A real hull is not: it trims against its buoyancy, it noses up "
                "and down to change depth, and it works in waves. Then bow and stern sit at depths that the "
                "follower does not expect, one range comes out too long and the other too short, and the circles "
                "meet in the wrong place."
            ),
            Text(
                text="The paper stands in for this by a larger random error at one transmitter (its Stage 4). Here the "
                "leader is a rigid body in water and pitches for a reason. How far off do the followers get, when does "
                "it matter, and what can be done about it?"
            ),
        ],
    )


def _sizes(asymmetry: Floats) -> str:
    """Root mean squares of what causes do to the difference of both ranges, shape (m, causes), in words."""
    rms = 100.0 * np.sqrt(np.nanmean(asymmetry**2, axis=0))
    return ", ".join(f"{LABELS[cause]} {rms[cause]:.1f} cm" for cause in _TOLD)


def one_message(example: Example) -> Section:
    """How pitch gets into one fix."""
    budget, message = example.budget, drawing.Message(example.flight.trajectory, example.telling)
    time, pitch = example.flight.trajectory.time, np.rad2deg(example.flight.trajectory.pitch[:, 0])
    half = time <= min(200.0, float(time[-1]))
    seen = budget.time <= min(200.0, float(time[-1]))
    error = float(np.hypot(*(message.fix - message.hydrophone[:2])))
    return Section(
        title="Range error budget of one message",
        blocks=[
            Figures(
                panels=[
                    svg(drawing.message_side(message), "side"),
                    svg(drawing.message_hull(message), "hull"),
                    svg(drawing.message_top(message), "top"),
                ],
                caption=f"{example.condition.label}, route {ROUTE}, follower {OFFSET_M:g} m below: a message sent at "
                f"a pitch of {np.rad2deg(message.pitch):+.1f}°. Bow and stern have left the depth that the follower "
                "believes in by centimetres. With the circles drawn about the places of a level leader, those "
                f"centimetres become {error:.2f} m: the fix stays on the dotted circle about the leader; its range "
                "is right, its direction is wrong.",
                legend=[(REAL, "as it is"), (LEVEL, "as the follower believes, and the truth it looks for")],
            ),
            Text(
                text="Why so much? The fix comes from the difference of two ranges over a short baseline, which "
                "multiplies it. Written out, with the follower Δz deeper and the leader pitched up by φ, the fix "
                "keeps its range and lands at the bearing B̂ with cos B̂ = cos B cos φ − (Δz/D) sin φ. For small "
                "angles that is an error of Δz sin φ / |sin B|: abeam it does not depend on the range, and not on "
                "the baseline either."
            ),
            Figures(
                panels=[
                    svg(asymmetry_over_time(budget.time[seen], {c: budget.asymmetry[seen, c] for c in _TOLD},
                                            "What tells bow from stern"), "shares"),
                    svg(drawing.pitch_over_time(time[half], pitch[half], "Pitch of the leader"), "pitch"),
                ],
                caption="The same flight over its first minutes, with pings one after another, between which the "
                "leader moves on and works in the waves. Only the lever arm comes from the pitch; the random error is "
                f"the paper's, with τ = 1 cm. RMS: {_sizes(budget.asymmetry[seen])}.",
                legend=legend_of(_TOLD),
            ),
            share_table(budget),
            Text(
                text="What both ends have in common moves the fix to and fro along its ray; what differs turns it "
                "about the leader. For this table every cause but echoes is switched on at once: travel time, pings "
                f"{EVERYTHING['acoustics.ping_slot_s']:g} s apart, a speed of sound believed "
                f"{EVERYTHING['acoustics.sound_speed_bias_m_s']:g} m/s too high, a clock "
                f"{1e3 * float(EVERYTHING['acoustics.clock_offset_s']):g} ms ahead, depths measured to "
                f"{100 * EVERYTHING['sensors.depth_sigma_m']:g} cm. Everywhere else in this report they are off, "
                "as in the paper."
            ),
            Code(text=command(example.condition, ROUTE, OFFSET_M), title="Fly it, with film and report:"),
        ],
    )  # fmt: skip


def chart_section(chart: pa.Table) -> Section:
    """The section that shows where around the leader its pitch matters."""
    columns = {name: chart[name].to_numpy().astype(np.float64) for name in chart.column_names}

    def at(**fixed: float) -> Bools:
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
    for name, direction in (("abeam", 90.0), ("on the quarter, B = 135°", 135.0)):
        curves = []
        for offset, colour in ((2.0, SERIES[0]), (5.0, SERIES[2]), (10.0, SERIES[1])):
            here = at(range_m=20.0, bearing_deg=direction, depth_offset_m=offset)
            curves.append(
                (f"{offset:g} m", columns["error_closed_form_m"][here], columns["error_laisn-2_m"][here], colour)
            )
        title = f"20 m {name}, by depth offset"
        panels.append(svg(drawing.over_pitch(pitches, curves, title), f"pitch{direction:g}"))
    abeam = columns["error_laisn-2_m"][at(pitch_deg=5.0, depth_offset_m=10.0, bearing_deg=90.0)]
    fits = np.isfinite(columns["error_closed_form_m"]) & (columns["error_closed_form_m"] > 0)
    difference = np.abs(columns["error_laisn-2_m"] - columns["error_closed_form_m"])[fits]
    third = np.abs(columns["error_laisn-3-2_m"] - columns["error_laisn-2_m"])[fits]
    return Section(
        title="The map",
        blocks=[
            Figures(
                panels=panels,
                caption="Error of one noiseless fix. Above: around the leader, at the same depth and 5 m below. "
                "Below: over pitch; lines are the closed form, dots the campaign engine.",
            ),
            Text(
                text=f"At 5° and 10 m the error abeam is {abeam.min():.3f} to {abeam.max():.3f} m, whatever the range. "
                f"Over all {chart.num_rows:,} points of the map, closed form and engine differ by at most "
                f"{float(difference.max()):.1g} m wherever the circles meet. At equal depth only foreshortening is "
                "left: the baseline looks shorter, which grows with the range and vanishes abeam. Toward the axis "
                "(B = 0°, 180°) a small turn is a large step sideways, until the circles no longer meet and the "
                "follower is put on the axis. Ahead and astern, nose up and nose down differ: there the lever arm "
                "adds to foreshortening or works against it."
            ),
            Text(
                text="A third transmitter amidships lies on the same tilted hull, so that every pair of transmitters "
                "is wrong by the same angle. Where the circles meet, the errors of LAISN-3(2) differ from those of "
                f"LAISN-2 by {np.median(third):.1g} m in the median, and by less than {np.quantile(third, 0.95):.1g} m "
                "at 95 % of the points (`map.parquet` holds all variants)."
            ),
        ],
    )  # fmt: skip
