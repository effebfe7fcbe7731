"""One message and the map, for the page of the pitch study."""

from typing import Any

import numpy as np
import pyarrow as pa

from experiments.asymmetry import figures as drawing
from experiments.asymmetry.conditions import command
from experiments.asymmetry.example import EVERYTHING, OFFSET_M, ROUTE, Example
from experiments.asymmetry.figures import LEVEL, REAL
from experiments.flight.range_budget import LABELS, Cause
from experiments.pages.figures import svg
from experiments.pages.page import Code, Figures
from experiments.pages.range_budget_page import asymmetry_over_time, legend_of, share_table
from experiments.pages.style import SERIES
from laisn.arrays import Bools, Floats

_SHOWN = (Cause.LEVER_ARM, Cause.RANDOM, Cause.MOTION)


def _sizes(asymmetry: Floats) -> str:
    """Root mean squares of what causes do to the difference of both ranges, shape (m, causes), in words."""
    rms = 100.0 * np.sqrt(np.nanmean(asymmetry**2, axis=0))
    return ", ".join(f"{LABELS[cause]} {rms[cause]:.1f} cm" for cause in _SHOWN)


def one_message(example: Example) -> dict[str, Any]:
    """Values of the page's template on the ranges of one message and of the minutes around it."""
    budget, message = example.budget, drawing.Message(example.flight.trajectory, example.telling)
    time, pitch = example.flight.trajectory.time, np.rad2deg(example.flight.trajectory.pitch[:, 0])
    half = time <= min(200.0, float(time[-1]))
    seen = budget.time <= min(200.0, float(time[-1]))
    error = float(np.hypot(*(message.fix - message.hydrophone[:2])))
    geometry = Figures(
        panels=[
            svg(drawing.message_side(message), "side"),
            svg(drawing.message_hull(message), "hull"),
            svg(drawing.message_top(message), "top"),
        ],
        caption=f"{example.condition.label}, route {ROUTE}, follower {OFFSET_M:g} m below: a message sent at a pitch "
        f"of {np.rad2deg(message.pitch):+.1f}°. Bow and stern are centimetres off the depth that the follower "
        f"assumes. With the circles drawn about the positions of a level leader, the fix is {error:.2f} m off: it "
        "stays on the dotted circle about the leader; its range is right, its direction is wrong.",
        legend=[(REAL, "as it is"), (LEVEL, "as the follower assumes, and the true position")],
    )
    first_minutes = Figures(
        panels=[
            svg(asymmetry_over_time(budget.time[seen], {c: budget.asymmetry[seen, c] for c in _SHOWN},
                                    "Difference of the bow's and stern's range errors"), "shares"),
            svg(drawing.pitch_over_time(time[half], pitch[half], "Pitch of the leader"), "pitch"),
        ],
        caption="The same mission over its first minutes, with pings one after another, between which the leader "
        "moves on and works in the waves. Only the lever arm comes from the pitch; the random error is the paper's, "
        f"with τ = 1 cm. RMS: {_sizes(budget.asymmetry[seen])}.",
        legend=legend_of(_SHOWN),
    )  # fmt: skip
    return {
        "geometry": geometry,
        "first_minutes": first_minutes,
        "shares": share_table(budget),
        "everything": EVERYTHING,
        "one_mission": Code(text=command(example.condition, ROUTE, OFFSET_M), title="Run it, with film and report:"),
    }


def on_map(chart: pa.Table) -> dict[str, Any]:
    """Values of the page's template on the map: where around the leader its pitch matters."""
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
    maps = Figures(
        panels=panels,
        caption="Error of one noiseless fix. Above: around the leader, at the same depth and 5 m below. "
        "Below: over pitch; lines are the closed form, dots the simulation.",
    )
    return {
        "maps": maps,
        "abeam": abeam,
        "points": chart.num_rows,
        "closed_form_m": float(difference.max()),
        "third_median_m": float(np.median(third)),
        "third_p95_m": float(np.quantile(third, 0.95)),
    }
