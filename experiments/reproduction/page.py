"""The report of a reproduction: the paper's tables with ours beside them, its figures redrawn, its claims judged."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from experiments.pages import figures
from experiments.pages.figures import Line
from experiments.pages.flight_figures import ON_AXIS_DEG, bearing_part
from experiments.pages.page import Block, Cell, Figures, Notice, Page, Section, Table, Text, number, words
from experiments.pages.style import ESTIMATE, FOLLOWER, LEADER
from experiments.reproduction import paper_tables as tables
from experiments.reproduction.findings import listed
from experiments.reproduction.paper_tables import VARIANT_NAMES
from experiments.reproduction.record import FIGURES, ErrorFigure, Reproduction
from experiments.reproduction.replications import REPLICATIONS, VERDICT_CONFIDENCE
from experiments.reproduction.stages import METRICS, Key
from experiments.reproduction.verdict import MARGIN, WORDS, Judgement
from laisn.arrays import Floats
from sim.trajectory import Trajectory

VERDICT_TONES = {"holds": "yes", "does not hold": "no", "depends": "maybe", "undecided": "", "no data": ""}

_STAGES = {
    1: "Stage 1: routes",
    2: "Stage 2: message interval",
    3: "Stage 3: transmitters",
    4: "Stage 4: range errors",
    5: "Stage 5: leader's compass",
}
_ALTERNATIVES = {
    1: "Not the paper's setting: its gate is described, not given. A bound from the measured speed instead of the top "
    "speed comes closer on most missions, and misses T5 and T9 by far; it is shown, and used nowhere else.",
    2: "Not the paper's settings: it lists β = 0.1 or 100 and T = 0.1 or 10 without saying where, and none of them "
    "gives its 10 s rows. These alternatives are shown, and used nowhere else. β = 300 with T = 10 gives the collapse "
    "of LAISN-3(2) as printed, but lets LAISN-2 collapse as well, which the paper's does not.",
    4: "Not the paper's setting: the error of Eq. 28 lies between 0 and τ, with a mean of τ / 2, so that a larger τ at "
    "the rear makes a constant difference of the ranges. With the mean removed, τ (U − ½), the rows of Table 7 are met "
    "far better; it is shown, and used nowhere else.",
}
_RATIO_NOTE = (
    "Each pair is the paper's figure and ours. White: within a fifth; orange: ours larger, blue: ours smaller, in "
    "steps of 1.2, 1.5 and 2. The ratio shows where the pointer rests."
)


def error_panel(steps: Mapping[str, npt.NDArray[np.float32]], name: str, title: str) -> str:
    """Mean of E_P and E_B over the runs (thick) and their maximum (thin), and B, over time, each on its own axis."""
    columns = {column: values.astype(np.float64) for column, values in steps.items()}
    time = columns["time_s"]

    def errors(mean: Floats, most: Floats, label: str, limit: float | None) -> figures.Part:
        lines = [
            Line(x=time, y=most, colour=ESTIMATE, width=0.4, opacity=0.6),
            Line(x=time, y=mean, colour=ESTIMATE, width=1.2),
        ]
        return figures.Part(lines=lines, y_label=label, y_limits=(0.0, limit))

    # half a turn of E_B would flatten everything else
    turned = min(1.05 * float(columns["e_b_max_deg"].max()), 6.0 * float(columns["e_b_mean_deg"].max()) + 1.0)
    parts = [
        errors(columns["e_p_mean_m"], columns["e_p_max_m"], "E_P [m]", None),
        errors(columns["e_b_mean_deg"], columns["e_b_max_deg"], "E_B [°]", turned),
        bearing_part(time, np.deg2rad(columns["bearing_deg"])),
    ]
    figure = figures.stack(parts, x_label="time [s]", title=title, height=3.6)
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
        "(thick) and maximum (thin). B is the bearing of the follower from the leader, grey within "
        f"{ON_AXIS_DEG:g}° of its axis.",
    )


def _routes(flights: Mapping[str, Trajectory]) -> Figures:
    panels = []
    for name, flight in flights.items():
        every = slice(None, None, max(1, flight.time.size // 400))
        leader, follower = flight.position[every, 0], flight.position[every, 1]
        lines = [
            Line(x=leader[:, 0], y=leader[:, 1], colour=LEADER, width=1.4),
            Line(x=follower[:, 0], y=follower[:, 1], colour=FOLLOWER),
        ]
        figure = figures.panel(lines, x_label="east [m]", y_label="north [m]", title=name, equal=True, height=3.0)
        panels.append(figures.svg(figure, f"route-{name}", f"Routes of leader and follower on {name}"))
    legend = [(LEADER, "leader"), (FOLLOWER, "follower")]
    return Figures(panels=panels, caption="Figure 2. Routes as flown.", legend=legend)


def _claims(result: Reproduction) -> Table:
    def verdict(judgement: Judgement) -> Cell:
        tone = VERDICT_TONES[judgement.verdict]
        return Cell(text=WORDS[judgement.verdict], tone=tone, title=judgement.figures)

    rows = [
        [
            number(claim.number, 0),
            words(claim.text),
            verdict(ours),
            words("; ".join(map(str, ours.criteria))),
            words(ours.figures),
            verdict(theirs),
            words(claim.criterion),
        ]
        for claim, ours, theirs in result.judgements
    ]
    heads = ["", "claim", "our runs", "criteria", "figures", "the paper's tables", "criterion"]
    caption = (
        f"Figures are those of {REPLICATIONS} independent replications of {result.runs} runs, with intervals over "
        f"replications ({VERDICT_CONFIDENCE:.1%}, so that all hold together with 95 %). A criterion is met, or not, if "
        f"its whole interval is on that side of the bound and farther from it than {MARGIN:.0%}, the precision of the "
        "paper's own figures, and undecided otherwise. Every criterion met: holds; some met, some "
        "not: depends on the mission; none met: does not hold; undecided where this hangs on a criterion that is. The "
        "same test on the published "
        "tables stands beside ours, as far as they have its figures. The criteria put the paper's words into numbers, "
        "and were set so that its own tables pass: a claim that fails on our runs fails by a measure that theirs meet."
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
            blocks.append(tables.several_settings(result, tabled, metrics, f"Table {table}. {title}."))
    else:
        for setting in settings:
            if setting.table not in {"text", "alternative"}:
                blocks += [tables.one_setting(result, setting, f"Table {setting.table}. {setting.title}.")]
    described = [s for s in settings if s.table == "text"]
    if described:
        blocks.append(Text(text="Settings that the paper describes in words only."))
        blocks += [tables.one_setting(result, s, s.title) for s in described]
    drawn = [_error_figure(result, f) for f in FIGURES if f.setting in {s.name for s in settings}]
    blocks += [figure for figure in drawn if figure is not None]
    alternatives = [s for s in settings if s.table == "alternative"]
    if alternatives:
        blocks += [Notice(text=_ALTERNATIVES[stage]), tables.alternatives_table(result, alternatives)]
    return Section(title=_STAGES[stage], blocks=blocks)


def page_of(result: Reproduction, flights: Mapping[str, Trajectory]) -> Page:
    """The whole report."""
    stages = sorted({s.stage for s in result.settings})
    all_stages = "" if len(stages) == len(_STAGES) else "".join(f" --stage {s}" for s in stages)
    tested = [claim.number for claim, ours, _ in result.judgements if ours.verdict != "no data"]
    held = [claim.number for claim, ours, _ in result.judgements if ours.verdict == "holds"]
    motion = {"physics": "rigid bodies in water", "kinematic": "the paper's point motion"}[result.motion]
    version = next(iter(result.rows.values()))["version"]
    sections = [
        Section(title="Claims", blocks=[_claims(result)]),
        Section(title="Ours over the paper's", blocks=[tables.median_ratios(result), *tables.far_off(result)]),
        Section(title="Routes", blocks=[_routes(flights)]),
        *(_stage(result, stage) for stage in stages),
        Section(title="All rows", blocks=[tables.all_rows(result)]),
    ]
    return Page(
        title="The paper's evaluation, flown again",
        summary=f"{len(result.rows)} cells of {result.runs} runs with {motion}. {len(held)} of the "
        f"{len(tested)} claims of the paper that these cells test hold: {listed(held)}. "
        "Follower routes were published as pictures only; ours are like them in distance, bearing and speed, so that "
        "single rows differ more than medians.",
        facts=[
            ("Source", "Praczyk & Hożyń, Electronics 2026, 15, 3709"),
            ("Motion", motion),
            ("Runs of each cell, seed", f"{result.runs}, {result.seed}"),
            ("Version", version),
            (
                "Repeat with",
                f"laisn reproduce --motion {result.motion} --runs {result.runs} --seed {result.seed}{all_stages}",
            ),
            ("Numbers", "tables.parquet, tables.csv, cells/"),
        ],
        sections=sections,
    )
