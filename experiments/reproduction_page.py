"""The report of a reproduction: the paper's tables with ours beside them, its figures redrawn, its claims judged."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from experiments import figures
from experiments.claims import Judgement
from experiments.figures import FRAME, MUTED, SERIES, Line
from experiments.page import (
    Block,
    Cell,
    Figures,
    Notice,
    Page,
    Section,
    Table,
    Text,
    number,
    ratio_tone,
    words,
)
from experiments.report import ERROR_LEGEND, without_wraps
from experiments.reproduce import FIGURES, ErrorFigure, Reproduction
from experiments.stages import METRICS, Key, Setting
from laisn.settings import Variant
from sim.trajectory import Trajectory

Floats = npt.NDArray[np.float64]

VARIANT_NAMES: dict[Variant, str] = {"laisn-2": "LAISN-2", "laisn-3-1": "LAISN-3(1)", "laisn-3-2": "LAISN-3(2)"}
METRIC_NAMES = dict(
    zip(METRICS, ("E_P max [m]", "E_B max [°]", "E_P mean [m]", "E_B mean [°]", "σ E_P [m]", "σ E_B [°]"), strict=True)
)
FAR = 2.0
"""A row whose mean E_P differs by more than this factor is listed as far off."""
VERDICT_TONES = {"holds": "yes", "does not hold": "no", "depends": "maybe", "no data": ""}

_STAGES = {
    1: "Stage 1: routes",
    2: "Stage 2: message interval",
    3: "Stage 3: transmitters",
    4: "Stage 4: range errors",
    5: "Stage 5: leader's compass",
}
_RATIO_NOTE = (
    "Each pair is the paper's figure and ours. White: within a fifth; orange: ours larger, blue: ours smaller, in "
    "steps of 1.2, 1.5 and 2. The ratio shows where the pointer rests."
)


def _pair(result: Reproduction, key: Key, metric: str) -> list[Cell]:
    """The published figure and ours, coloured by their ratio."""
    ours = float(result.rows[key][metric])
    theirs = result.published.get(key, {}).get(metric)
    if theirs is None:
        return [number(None), number(ours)]
    ratio = ours / theirs
    title = f"{ours:.4g} / {theirs:g} = {ratio:.2f}"
    return [number(theirs, tone="theirs"), number(ours, tone=ratio_tone(ratio), title=title)]


def _missions(result: Reproduction) -> list[str]:
    return list(dict.fromkeys(mission for _, mission, _ in result.rows))


def _name(mission: str, variant: Variant) -> Cell:
    return words(f"{mission} {VARIANT_NAMES[variant]}".replace("-", "\N{NON-BREAKING HYPHEN}"))


def _single(result: Reproduction, setting: Setting, caption: str) -> Table:
    """A table of one setting: six figures in pairs, or ours alone where nothing was published."""
    rows, published = [], setting.table not in {"text", "alternative"}
    for mission in _missions(result):
        for variant in setting.variants:
            cells = [_name(mission, variant)]
            for metric in METRICS:
                pair = _pair(result, (setting.name, mission, variant), metric)
                cells += pair if published else pair[1:]
            rows.append(cells)
    if not published:
        return Table(heads=["", *METRIC_NAMES.values()], rows=rows, caption=caption)
    groups = [("", 1), *((name, 2) for name in METRIC_NAMES.values())]
    return Table(heads=["", *["paper", "ours"] * len(METRICS)], rows=rows, caption=caption, groups=groups)


def _several(result: Reproduction, settings: Sequence[Setting], metrics: Sequence[str], caption: str) -> Table:
    """A table of several settings, as Tables 2 to 4: two figures of each."""
    rows = []
    for mission in _missions(result):
        for variant in settings[0].variants:
            cells = [_name(mission, variant)]
            for setting in settings:
                for metric in metrics:
                    cells += _pair(result, (setting.name, mission, variant), metric)
            rows.append(cells)
    groups = [("", 1), *((f"{s.title}: {METRIC_NAMES[m]}", 2) for s in settings for m in metrics)]
    heads = ["", *["paper", "ours"] * (len(settings) * len(metrics))]
    return Table(heads=heads, rows=rows, caption=caption, groups=groups)


def error_panel(steps: Mapping[str, npt.NDArray[np.float32]], name: str, title: str) -> str:
    """Mean of E_P and E_B over the runs (thick), their maximum (thin), and scaled B over time."""
    columns = {column: values.astype(np.float64) for column, values in steps.items()}
    time = columns["time_s"]
    scaled = without_wraps(figures.scaled_bearing(np.deg2rad(columns["bearing_deg"])))
    # one turn of E_B would flatten everything else
    top = max(12.0, 1.05 * float(columns["e_p_max_m"].max()))
    lines = [
        Line(x=time, y=scaled, colour=MUTED, width=1.2),
        Line(x=time, y=columns["e_b_max_deg"], colour=SERIES[1], width=0.4),
        Line(x=time, y=columns["e_p_max_m"], colour=SERIES[0], width=0.4),
        Line(x=time, y=columns["e_b_mean_deg"], colour=SERIES[1], width=1.2),
        Line(x=time, y=columns["e_p_mean_m"], colour=SERIES[0], width=1.2),
    ]
    figure = figures.panel(
        lines, x_label="time [s]", y_label="E_P [m], E_B [°], scaled B", title=title, y_limits=(-11.0, top)
    )
    return figures.svg(figure, name, f"Errors over time, {title}")


def _error_figure(result: Reproduction, figure: ErrorFigure) -> Figures | None:
    keys: list[Key] = [(figure.setting, mission, figure.variant) for mission in figure.missions]
    drawn = [key for key in keys if key in result.steps]
    if not drawn:
        return None
    title = next(s.title for s in result.settings if s.name == figure.setting)
    return Figures(
        panels=[error_panel(result.steps[key], f"figure{figure.number}-{key[1]}", key[1]) for key in drawn],
        caption=f"Figure {figure.number}. {VARIANT_NAMES[figure.variant]}, {title}: mean over {result.runs} runs "
        "(thick) and maximum (thin).",
        legend=ERROR_LEGEND,
    )


def _routes(flights: Mapping[str, Trajectory]) -> Figures:
    panels = []
    for name, flight in flights.items():
        every = slice(None, None, max(1, flight.time.size // 400))
        leader, follower = flight.position[every, 0], flight.position[every, 1]
        lines = [
            Line(x=leader[:, 0], y=leader[:, 1], colour=FRAME, width=1.4),
            Line(x=follower[:, 0], y=follower[:, 1], colour=SERIES[0]),
        ]
        figure = figures.panel(lines, x_label="east [m]", y_label="north [m]", title=name, equal=True, height=3.0)
        panels.append(figures.svg(figure, f"route-{name}", f"Routes of leader and follower on {name}"))
    legend = [("--frame", "leader"), ("--c1", "follower")]
    return Figures(panels=panels, caption="Figure 2. Routes as flown.", legend=legend)


def _claims(result: Reproduction) -> Table:
    def verdict(judgement: Judgement) -> Cell:
        tone = VERDICT_TONES[judgement.verdict]
        return Cell(text=judgement.verdict, tone=tone, title=judgement.figures)

    rows = [
        [
            number(claim.number, 0),
            words(claim.text),
            verdict(ours),
            words(ours.figures),
            verdict(theirs),
            words(claim.criterion),
        ]
        for claim, ours, theirs in result.judgements
    ]
    heads = ["", "claim", "our runs", "figures", "the paper's tables", "criterion"]
    caption = (
        "Every part of a criterion true: holds; some: depends; none: does not hold. The same test on the published "
        "tables stands beside ours, as far as they have its figures."
    )
    return Table(heads=heads, rows=rows, caption=caption)


def _medians(result: Reproduction) -> Table:
    """Median ratio over missions of every setting and variant."""
    rows = []
    for setting in result.settings:
        for variant in setting.variants:
            cells = [words(f"Table {setting.table}"), words(setting.title), words(VARIANT_NAMES[variant])]
            found = False
            for metric in METRICS:
                keys: list[Key] = [(setting.name, mission, variant) for mission in _missions(result)]
                ratios = [result.rows[k][metric] / result.published[k][metric] for k in keys if k in result.published]
                found = found or bool(ratios)
                median = float(np.median(ratios)) if ratios else np.nan
                cells.append(number(median, tone=ratio_tone(median)))
            if found:
                rows.append(cells)
    caption = "Ours over the paper's, median over the missions."
    return Table(heads=["", "setting", "variant", *METRIC_NAMES.values()], rows=rows, caption=caption)


def _reason(setting: Setting, row: Mapping[str, float], theirs: float) -> str:
    """What is known about a row that is far off."""
    known = []
    free = row.get("e_p_mean_uncaptured_m")
    if row["captured_runs"]:
        known.append(f"{row['captured_runs']:.0f} of {row['runs']:.0f} runs were on the mirror side for a while")
        if free is not None:
            known.append(f"the others have {free:.2f} m ({free / theirs:.2f} of the paper's)")
    if setting.message_interval_s == 10:
        known.append("none of the listed β and T fits the paper's 10 s rows (see the alternatives)")
    elif setting.name == "asymmetric":
        known.append("the figures of unequal errors hinge on seconds spent astern, which the drawn route does not fix")
    return "; ".join(known) or "the follower's route is only like the published one"


def _far_off(result: Reproduction) -> list[Block]:
    rows = []
    for setting in result.settings:
        for variant in setting.variants:
            for mission in _missions(result):
                key: Key = (setting.name, mission, variant)
                if key not in result.published:
                    continue
                ours, theirs = result.rows[key]["e_p_mean_m"], result.published[key]["e_p_mean_m"]
                if not 1 / FAR < ours / theirs < FAR:
                    reason = _reason(setting, result.rows[key], theirs)
                    cells = [words(f"Table {setting.table}"), words(setting.title), _name(mission, variant)]
                    cells += [number(theirs), number(ours), number(ours / theirs, tone=ratio_tone(ours / theirs))]
                    rows.append([*cells, words(reason)])
    published = sum(key in result.published for key in result.rows)
    text = f"{len(rows)} of {published} rows differ by more than a factor of {FAR:g} in mean E_P."
    if not rows:
        return [Text(text=text)]
    heads = ["", "setting", "row", "paper", "ours", "ratio", "what is known"]
    return [Text(text=text), Table(heads=heads, rows=rows)]


def _all_rows(result: Reproduction) -> Table:
    rows = []
    names = {s.name: s.title for s in result.settings}
    for key, row in result.rows.items():
        cells = [words(names[key[0]]), _name(key[1], key[2])]
        cells += [number(row["e_p_p50_m"]), number(row["e_p_p95_m"]), number(row["e_b_p95_deg"])]
        cells += [number(row["nees"], 1), number(row["nis"], 1), number(int(row["captured_runs"]))]
        cells += [number(int(row["fixes_gated"])), number(int(row["worst_run"]))]
        rows.append(cells)
    heads = ["setting", "row", "E_P 50 % [m]", "95 %", "E_B 95 % [°]", "NEES", "NIS", "captured", "rejected"]
    heads.append("worst run")
    caption = (
        "Percentiles of all steps and runs; NEES and NIS of the position (2 if the covariance is right); runs "
        "that were on the mirror side for a message interval; fixes that the gate rejected; the run with the largest E_P, "
        "which "
        "the command in tables.csv flies."
    )
    return Table(heads=heads, rows=rows, caption=caption)


def _stage(result: Reproduction, stage: int) -> Section:
    settings = [s for s in result.settings if s.stage == stage]
    blocks: list[Block] = [Text(text=_RATIO_NOTE)]
    if stage == 2:
        tabled = [s for s in settings if s.table == "2-4"]
        for table, what in ((2, "max"), (3, "mean"), (4, "std")):
            metrics = [m for m in METRICS if f"_{what}_" in m]
            title = {"max": "Maximum errors", "mean": "Mean errors", "std": "Standard deviations"}[what]
            blocks.append(_several(result, tabled, metrics, f"Table {table}. {title}."))
    else:
        for setting in settings:
            if setting.table not in {"text", "alternative"}:
                blocks += [_single(result, setting, f"Table {setting.table}. {setting.title}.")]
    described = [s for s in settings if s.table == "text"]
    if described:
        blocks.append(Text(text="Settings that the paper describes in words only."))
        blocks += [_single(result, s, s.title) for s in described]
    drawn = [_error_figure(result, f) for f in FIGURES if f.setting in {s.name for s in settings}]
    blocks += [figure for figure in drawn if figure is not None]
    alternatives = [s for s in settings if s.table == "alternative"]
    if alternatives:
        blocks.append(
            Notice(
                text="Not the paper's settings: it lists β = 0.1 or 100 and T = 0.1 or 10 without saying where, and "
                "none of them gives its 10 s rows. These alternatives are shown, and used nowhere else."
            )
        )
        blocks.append(_medians_of(result, alternatives))
    return Section(title=_STAGES[stage], blocks=blocks)


def _medians_of(result: Reproduction, alternatives: Sequence[Setting]) -> Table:
    """Mean E_P with alternative settings beside the published rows of the same intervals."""
    rows = []
    for setting in alternatives:
        printed = next(
            s.name
            for s in result.settings
            if s.table == "2-4"
            and (s.filter_step_s, s.message_interval_s) == (setting.filter_step_s, setting.message_interval_s)
        )
        for variant in setting.variants:
            cells = [words(setting.title), words(VARIANT_NAMES[variant])]
            for mission in _missions(result):
                theirs = result.published[printed, mission, variant]["e_p_mean_m"]
                ours = result.rows[setting.name, mission, variant]["e_p_mean_m"]
                ratio = ours / theirs
                cells += [number(theirs, tone="theirs"), number(ours, tone=ratio_tone(ratio), title=f"{ratio:.2f}")]
            rows.append(cells)
    missions = _missions(result)
    groups = [("", 2), *((m, 2) for m in missions)]
    heads = ["setting", "variant", *["paper", "ours"] * len(missions)]
    return Table(heads=heads, rows=rows, groups=groups, caption="Mean E_P [m] with the alternative settings.")


def page_of(result: Reproduction, flights: Mapping[str, Trajectory]) -> Page:
    """The whole report."""
    stages = sorted({s.stage for s in result.settings})
    all_stages = "" if len(stages) == len(_STAGES) else "".join(f" --stage {s}" for s in stages)
    held = [claim.number for claim, ours, _ in result.judgements if ours.verdict == "holds"]
    motion = {"physics": "rigid bodies in water", "kinematic": "the paper's point motion"}[result.motion]
    version = next(iter(result.rows.values()))["version"]
    sections = [
        Section(title="Claims", blocks=[_claims(result)]),
        Section(title="Ours over the paper's", blocks=[_medians(result), *_far_off(result)]),
        Section(title="Routes", blocks=[_routes(flights)]),
        *(_stage(result, stage) for stage in stages),
        Section(title="All rows", blocks=[_all_rows(result)]),
    ]
    return Page(
        title="The paper's evaluation, flown again",
        summary=f"{len(result.rows)} cells of {result.runs} runs with {motion}. {len(held)} of "
        f"{len(result.judgements)} claims of the paper hold{': ' + ', '.join(map(str, held)) if held else ''}. Follower "
        "routes were published as pictures only; ours are like them in distance, bearing and speed, so that single "
        "rows differ more than medians.",
        facts=[
            ("Source", "Praczyk & Hożyń, Electronics 2026, 15, 3709"),
            ("Motion", motion),
            ("Runs of each cell, seed", f"{result.runs}, {result.seed}"),
            ("Version", version),
            ("Repeat with", f"laisn reproduce --motion {result.motion} --runs {result.runs}{all_stages}"),
            ("Numbers", "tables.parquet, tables.csv, cells/"),
        ],
        sections=sections,
    )
