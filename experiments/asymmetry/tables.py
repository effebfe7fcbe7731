"""Numbers of the pitch study as tables of its report."""

from collections.abc import Sequence

import numpy as np

from experiments.asymmetry.added_error import ComparedMission, Mission, mean_added, mean_error, mean_of
from experiments.asymmetry.conditions import Condition, command
from experiments.asymmetry.gates import GateRow
from experiments.asymmetry.planner import OFF_AXIS_DEG, PITCH_DEG, rules
from experiments.asymmetry.remedies import LEVEL, REAL
from experiments.asymmetry.tau import Curve, Curves, equivalent
from experiments.intervals import Interval, mean_over_missions
from experiments.pages.page import Cell, Table, number, percent, words


def mean_cell(mean: Interval, digits: int = 2, scale: float = 1.0) -> Cell:
    """A mean with half of its interval, which is symmetric."""
    value, half = (number(scale * v, digits).text for v in (mean.value, mean.high - mean.value))
    return Cell(text=f"{value} ± {half}", sort=number(mean.value).sort)


def between(mean: Interval, digits: int = 2) -> Cell:
    """A mean with its interval in brackets."""
    value, low, high = (number(v, digits).text for v in mean)
    return Cell(text=f"{value} ({low} … {high})", sort=number(mean.value).sort)


def _tau_cell(missions: Sequence[ComparedMission], curves: Curves) -> Cell:
    """Mean of the τ_rear that do what pitch does on each mission, with what the excesses' intervals make of it."""
    values, halves = [], []
    for e in missions:
        curve, excess = curves.tau_of(e.real.route, "laisn-2"), mean_added([e], REAL)
        values.append(equivalent(excess.value, curve))
        low, high = (equivalent(max(limit, 0.0), curve) for limit in (excess.low, excess.high))
        halves.append((high - low) / 2)
    mean, known = mean_of(values), [half for value, half in zip(values, halves, strict=True) if not np.isnan(value)]
    half = float(np.sqrt(np.sum(np.square(known)))) / max(len(known), 1)
    return mean_cell(Interval(mean, mean - half, mean + half), 3)


def _of(missions: dict[Mission, ComparedMission], condition: str, offset: float, variant: str) -> list[ComparedMission]:
    return [e for (c, _, o, v), e in missions.items() if (c, o, v) == (condition, offset, variant)]


def _more_captured(missions: Sequence[ComparedMission]) -> Cell:
    """How many more runs are captured behind the real leader, with the interval of that number."""
    runs = sum(e.real.runs for e in missions)
    more = mean_over_missions([e.captures(REAL) - e.captures(LEVEL) for e in missions])
    value, low, high = (number(runs * share, 0).text for share in more)
    return Cell(text=f"{value} ({low} … {high})", sort=runs * more.value)


def mission_table(
    missions: dict[Mission, ComparedMission], conditions: Sequence[Condition], offsets: Sequence[float], curves: Curves
) -> tuple[Table, str]:
    """A row for each condition and offset, over all routes, and the command that flies the worst route of each."""
    rows, lines = [], []
    for condition in conditions:
        for offset in offsets:
            two, three = (_of(missions, condition.key, offset, variant) for variant in ("laisn-2", "laisn-3-2"))
            worst = max(two, key=lambda e: e.part)
            line = command(condition, worst.real.route, offset)
            lines.append(f"# {condition.label}, {offset:g} m: worst route\n{line}")
            rows.append(
                [
                    words(condition.label, title=line),
                    number(offset, 0),
                    number(two[0].real.pitch_rms_deg, 1),
                    number(two[0].real.pitch_max_deg, 1),
                    mean_cell(mean_error(two, LEVEL)),
                    mean_cell(mean_error(two, REAL)),
                    mean_cell(mean_added(two, REAL)),
                    mean_cell(mean_added(three, REAL)) if three else words("–"),
                    _tau_cell(two, curves),
                    _more_captured(two),
                    words(worst.real.route, title=line),
                    mean_cell(mean_added([worst], REAL)),
                ]
            )
    heads = (
        "condition", "offset [m]", "pitch rms [°]", "max [°]", "level", "real", "excess", "3(2)",
        "as τ_rear [m]", "captured", "worst", "excess",
    )  # fmt: skip
    table = Table(
        heads=heads,
        rows=rows,
        groups=(("", 2), ("leader", 2), ("mean E_P [m], LAISN-2", 3), ("excess", 1), ("", 2), ("route", 2)),
        caption=f"Means over the routes, {worst.real.runs} runs each, ± half of the 95 % interval over runs. 3(2): "
        f"excess of LAISN-3(2). As τ_rear: that of the curves over τ, whose own noise is left out. Captured: runs, of "
        f"{worst.real.runs * len(two)}, that are held at the mirror image beyond the leader's axis behind the real "
        "leader, less those behind a level one, with the 95 % interval. The worst route was picked by its excess, of "
        "which the interval knows nothing. Rest the pointer on a condition for the command that flies it.",
    )
    return table, "\n".join(lines)


def _pitch_cell(excess: Interval, over_pitch: Curve) -> Cell:
    """Pitch that has an excess, with the pitch at its limits; "–" below none, "> 15" beyond all that was flown."""

    def shown(value: float) -> str:
        return "–" if value < 0.0 else "> 15" if np.isnan(p := equivalent(value, over_pitch)) else f"{p:.1f}"

    value, low, high = (shown(v) for v in (excess.value, max(excess.low, 0.0), excess.high))
    return Cell(text=f"{value} ({low} … {high})", sort=number(equivalent(excess.value, over_pitch)).sort)


def stage_4_table(curves: Curves, offsets: Sequence[float]) -> Table:
    """Which pitch does what the paper's τ does, at its message interval of 5 s."""
    rows = []
    for curve in curves.stage_4():
        row: list[Cell] = [words(curve.route)]
        for tau in (0.03, 0.06):
            excess = curve.excess_at(tau)
            row.append(mean_cell(excess))
            row += [_pitch_cell(excess, over) for offset in offsets if (over := curves.pitch_of(curve, offset))]
        rows.append(row)
    per_tau = ["excess [m]", *(f"{offset:g} m" for offset in offsets)]
    return Table(
        heads=("route", *per_tau, *per_tau),
        rows=rows,
        groups=(("", 1), ("τ_rear = 0.03 m, as pitch [°] at Δz of", len(per_tau)), ("τ_rear = 0.06 m", len(per_tau))),
        caption="The constant nose-down pitch that raises the mean E_P of LAISN-2 as much as the paper's larger τ at "
        "the rear transmitter alone does; messages every 5 s, as in its Stage 4. In brackets the pitch at the limits "
        "of the excess, 95 % over runs.",
    )


def gate_table(gates: Sequence[GateRow]) -> Table:
    """Detection and false alarms of the gate rules."""
    rows = [
        [
            words(g.route), number(g.interval_s, 0), words(g.rule), percent(g.detected),
            percent(g.false_alarms, 2), between(g.e_p_mean_m), between(g.e_p_mean_without_echoes_m),
        ]
        for g in gates
    ]  # fmt: skip
    return Table(
        heads=("route", "interval [s]", "gate", "echoes rejected [%]", "false alarms [%]", "E_P [m]", "without echoes"),
        rows=rows,
        caption="Each ping is taken from the surface with a chance of 5 % and from the bottom with 2 %. Rejected: "
        "share of the messages in which the echo spoils a range that LAISN-2 uses. False alarms: share of the "
        "others. All with the 95 % interval over runs.",
    )


def planner_table(greatest_range: float, bound: float) -> Table:
    """Deepest offsets that keep the error under a bound."""
    deepest = rules(greatest_range, bound)
    rows = [
        [number(pitch, 0), *(words("–", "no") if np.isnan(v) else number(float(v), 1) for v in row)]
        for pitch, row in zip(PITCH_DEG, deepest, strict=True)
    ]
    return Table(
        heads=("pitch [°]", *(f"{b:g}°" for b in OFF_AXIS_DEG)),
        rows=rows,
        groups=(("", 1), ("direction to the follower, off the leader's axis", len(OFF_AXIS_DEG))),
        caption=f"Largest depth offset [m] at which pitch adds at most {bound:g} m to a fix, within "
        f"{greatest_range:g} m of the leader; 50 stands for any. A dash: no offset will do, foreshortening alone is "
        "too much.",
    )
