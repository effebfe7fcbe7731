"""Figures of the reproduction's page, and what its tables show."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from experiments.campaign.store import Arrays, Record, columns_of
from experiments.flight.library import fly_line
from experiments.studies.reproduce import findings
from experiments.studies.reproduce.findings import (
    METRICS,
    VARIANTS,
    Claim,
    ClaimJudgement,
    Key,
    ratios,
)
from experiments.study.run import StudyResults
from reports.figures import Line, Panel, Subplot, decimate, panel
from reports.findings import Findings
from reports.flight_figures import ON_AXIS_DEG, bearing_part
from reports.page import Figures, TableCell, number, ratio_tone
from reports.style import ESTIMATE, FOLLOWER, FRAME, LEADER, SERIES, Colour, Legend
from sim.trajectory import Trajectory

FIGURES: tuple[tuple[int, str, str, str], ...] = (
    (3, "base", "laisn-2", "T2 T5 T6 T7 T8 T9"),
    (4, "5s", "laisn-2", "T2 T5 T6 T7 T8 T9"),
    (5, "10s", "laisn-2", "T5 T6"),
    (6, "10s-slow", "laisn-2", "T2 T3 T4 T5"),
    (7, "asymmetric", "laisn-2", "T2 T5"),
    (8, "asymmetric", "laisn-3-2", "T2 T5"),
    (9, "heading5", "laisn-3-2", "T3 T4"),
)
"""The paper's figures of errors over time: number, setting, variant and missions. The text names
only some of their missions; the others are chosen like those."""
MOTIONS = {"physics": "rigid bodies in water", "kinematic": "the paper's point motion"}
FAR = 2.0  # A row whose mean E_P differs by more than this factor is listed as far off
SLOW = ("10s", "10s-slow", "10s-beta10", "10s-slow-beta10", "10s-slow-beta300")
"""Settings with messages every 10 s, of which the paper's β and T are not known."""
TONES = {"holds": "yes", "does not hold": "no", "depends": "maybe", "undecided": "", "no data": ""}
_POINTS = 300  # of a line over time: there are 96 of them, and a page has at most 6 MB
# groups of rows with the colour, the marker and, for the legend, the sign of their points
_GROUPS: Mapping[str, tuple[Colour, str, str]] = {
    "messages every 1 and 5 s, stages 1 to 3": (SERIES[0], "o", "●"),
    "unequal range errors, stage 4": (SERIES[2], "D", "◆"),
    "leader's compass off, stage 5": (SERIES[3], "s", "■"),
    "messages every 10 s": (SERIES[1], "^", "▲"),
}


def agreement(table: Sequence[Record]) -> tuple[Panel, Legend]:
    """Our mean E_P over the paper's, of all rows of tables.parquet: agreement on the diagonal, a
    band of factor two.
    """
    first_group, *others = _GROUPS
    # by the paper's stage, 0 for the settings of `SLOW`; all other stages are in the first group
    names = dict(zip((4, 5, 0), others, strict=True))
    span = np.array([0.15, 40.0])
    pairs: dict[str, list[tuple[float, float]]] = {name: [] for name in _GROUPS}
    for row in table:
        if row["published_e_p_mean_m"] is not None:
            name = names.get(0 if row["setting"] in SLOW else row["stage"], first_group)
            pairs[name].append((row["published_e_p_mean_m"], row["ours_e_p_mean_m"]))
    bounds = ((1.0, 1.2, "-"), (2.0, 0.8, "--"), (0.5, 0.8, "--"))
    lines = [
        Line(x=span, y=f * span, colour=FRAME, width=width, dash=dash) for f, width, dash in bounds
    ]
    for name, (colour, marker, _) in _GROUPS.items():
        points = np.array(pairs[name]).reshape(-1, 2)
        lines.append(
            Line(x=points[:, 0], y=points[:, 1], colour=colour, marker=marker, name=name, size=3.2)
        )
    figure = panel(
        lines,
        x_label="the paper's mean E_P [m]",
        y_label="our mean E_P [m]",
        height=3.6,
        x_log=True,
        y_log=True,
        x_limits=(0.15, 40.0),
        y_limits=(0.15, 40.0),
    )
    return figure, [(colour, f"{sign} {name}") for name, (colour, _, sign) in _GROUPS.items()]


def error_panel(steps: Arrays, title: str) -> Panel:
    """Mean of E_P and E_B over the runs (thick) and their maximum (thin), and B, over time, each
    on its own axis.
    """
    columns = {column: values.astype(np.float64) for column, values in steps.items()}
    time = columns["time_s"]

    def errors(metric: str, label: str, limit: float | None) -> Subplot:
        lines = []
        for kind, name, width, opacity in (
            ("max", "largest", 0.4, 0.6),
            ("mean", "mean", 1.2, 1.0),
        ):
            x, y = decimate(time, columns[metric.format(kind)], _POINTS)
            lines.append(Line(x=x, y=y, colour=ESTIMATE, width=width, opacity=opacity, name=name))
        return Subplot(lines=lines, y_label=label, y_limits=(0.0, limit))

    # half a turn of E_B would flatten everything else
    smallest_turn = min(
        1.05 * float(columns["e_b_max_deg"].max()), 6.0 * float(columns["e_b_mean_deg"].max()) + 1.0
    )
    parts = [
        errors("e_p_{}_m", "E_P [m]", None),
        errors("e_b_{}_deg", "E_B [°]", smallest_turn),
        bearing_part(time, np.deg2rad(columns["bearing_deg"])),
    ]
    return Panel(parts=parts, x_label="time [s]", title=title, height=3.6)


def error_figures(steps: Mapping[Key, Arrays]) -> list[tuple[int, str, str, Figures]]:
    """The paper's figures, as far as errors over time are kept: number, setting, variant and
    panels.
    """
    figures = []
    for figure, setting, variant, missions in FIGURES:
        steps_of_mission = {m: steps.get((setting, m, variant)) for m in missions.split()}
        panels = [error_panel(s, m) for m, s in steps_of_mission.items() if s]
        figures += [(figure, setting, variant, Figures(panels=panels))] if panels else []
    return figures


def routes(flights: Mapping[str, Trajectory]) -> Figures:
    """Routes of leader and follower on each mission, by its name."""
    panels = []
    for name, flight in flights.items():
        leader, follower = flight.position[:: max(1, flight.time.size // 400), :2].swapaxes(0, 1)
        lines = [
            Line(x=leader[:, 0], y=leader[:, 1], colour=LEADER, width=1.4),
            Line(x=follower[:, 0], y=follower[:, 1], colour=FOLLOWER),
        ]
        panels.append(
            panel(
                lines,
                x_label="east [m]",
                y_label="north [m]",
                title=name,
                equal_scales=True,
                height=3.0,
            )
        )
    return Figures(panels=panels, legend=[(LEADER, "leader"), (FOLLOWER, "follower")])


class TableCells(NamedTuple):
    """Cells of the tables, made of our figures and of the published ones."""

    rows: Mapping[Key, Record]
    published: Mapping[Key, Mapping[str, float]]  # the paper's figures by metric

    def theirs(self, key: Key, metric: str) -> TableCell:
        """The published figure; a dash if there is none."""
        return number(self.published.get(key, {}).get(metric), tone="theirs")

    def ours(self, key: Key, metric: str, printed: Key | None = None) -> TableCell:
        """Our figure, coloured by its ratio to the published one of the same or of another cell."""
        ours = float(self.rows[key][metric])
        theirs = self.published.get(printed or key, {}).get(metric)
        if theirs is None:
            return number(ours)
        ratio = ours / theirs
        return number(ours, tone=ratio_tone(ratio), title=f"{ours:.4g} / {theirs:g} = {ratio:.2f}")

    def median(self, setting: str, variant: str, metric: str) -> TableCell:
        """Median ratio over missions, with the least and the largest of them."""
        values = ratios(self.rows, self.published, setting, variant, metric)
        median = float(np.median(values))
        return number(
            median, tone=ratio_tone(median), title=f"{values.min():.2f} … {values.max():.2f}"
        )

    @staticmethod
    def verdict(judgement: ClaimJudgement) -> TableCell:
        """The verdict on a claim, coloured."""
        words = "depends on the mission" if judgement.verdict == "depends" else judgement.verdict
        return TableCell(text=words, tone=TONES[judgement.verdict])


def table_rows(
    outcomes: StudyResults, published: Mapping[Key, Mapping[str, float]]
) -> list[Record]:
    """Published and own figures side by side, a row for each cell."""
    table = []
    for row in outcomes.rows:
        entry = outcomes.plan.by_design_key[row["point"], row["arm"], 0]
        theirs = published.get(findings.key_of(row), {})
        line: Record = {
            "setting": row["case"],
            "trajectory": row["scenario"],
            "variant": row["arm"],
        }
        for metric in METRICS:
            line[f"published_{metric}"] = theirs.get(metric)
            line[f"ours_{metric}"] = row[metric]
            line[f"ratio_{metric.rsplit('_', 1)[0]}"] = (
                row[metric] / theirs[metric] if metric in theirs else None
            )
        line |= {
            name: value
            for name, value in row.items()
            if name not in {*METRICS, "case", "scenario", "arm"}
        }
        line["fly_worst_run"] = fly_line(entry.source, entry.settings_at(0), row["worst_run"])
        table.append(line)
    return table


def page_values(
    titles: Mapping[str, str],
    rows: Mapping[Key, Record],
    published: Mapping[Key, Mapping[str, float]],
    judgements: Sequence[tuple[Claim, ClaimJudgement, ClaimJudgement]],
) -> dict[str, Any]:
    """What the template names of tables and claims; `titles` are those of settings by name."""
    ratios = {
        key: rows[key]["e_p_mean_m"] / published[key]["e_p_mean_m"]
        for key in rows
        if key in published
    }
    far_off = [key for key, ratio in ratios.items() if not 1 / FAR < ratio < FAR]
    settings: dict[str, dict[str, Any]] = {}
    for (name, _, variant), row in rows.items():
        setting = {
            "name": name,
            "title": titles[name],
            "printed": row["table"] not in ("text", "alternative"),
        }
        entry = settings.setdefault(
            name, setting | {key: row[key] for key in ("stage", "table", "like")} | {"variants": {}}
        )
        entry["variants"][variant] = None
    return {
        "stages": sorted({row["stage"] for row in rows.values()}),
        "settings": settings,
        "missions": list(dict.fromkeys(mission for _, mission, _ in rows)),
        "metrics": METRICS,
        "names": {
            name: text.replace("-", "\N{NON-BREAKING HYPHEN}") for name, text in VARIANTS.items()
        },
        "rows": rows,
        "published": published,
        "judgements": judgements,
        "far": [key for key in far_off if key[0] not in SLOW],
        "slow": sum(key[0] in SLOW for key in far_off),
        "cells": TableCells(rows, published),
        "limits": {
            "far": FAR,
            "on_axis": ON_AXIS_DEG,
            "margin": findings.MARGIN,
            "confidence": findings.VERDICT_CONFIDENCE,
            "replications": findings.REPLICATIONS,
        },
    }


def values(_: Findings, outcomes: Mapping[str, StudyResults]) -> dict[str, Any]:
    """The values that the page's template refers to, by name; and the table that is written beside
    those of the parts.
    """
    tables = outcomes["tables"]
    published = findings.published()
    plan = tables.plan
    rows = findings.rows_of(outcomes)
    steps = {
        findings.key_of(row): step for row, step in zip(tables.rows, tables.steps, strict=True)
    }
    missions = {
        entry.source: tables.motion(entry) for entry in {e.source: e for e in plan.entries}.values()
    }
    table = table_rows(tables, published)
    figure, legend = agreement(table)
    titles = {name: case.title for name, case in plan.study.cases.items()}
    judgements = findings.judge(findings.MetricValues.of(outcomes), published)
    return page_values(titles, rows, published, judgements) | {
        "tables": {"tables": columns_of(table)},
        "motion": MOTIONS[plan.entries[0].scenario.motion],
        "errors": error_figures(steps),
        "routes": routes(missions),
        "agreement": Figures(panels=[figure], legend=legend),
    }
