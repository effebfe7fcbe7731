"""The report of the study on drawn routes."""

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.campaign.store import Record
from experiments.pages import figures
from experiments.pages.figures import Line
from experiments.pages.page import Cell, Figures, Page, Section, Table, Text, number, words
from experiments.pages.style import FOLLOWER, LEADER, SERIES
from experiments.reproduction.page import VERDICT_TONES
from experiments.reproduction.paper_tables import METRIC_NAMES, VARIANT_NAMES
from experiments.reproduction.routes_study import CLAIM_RESAMPLES, CONFIDENCE, Study
from experiments.reproduction.stages import METRICS, Key
from experiments.reproduction.verdict import WORDS
from sim.scenario.random_routes import CLASSES
from sim.trajectory import Trajectory

_DRAWN = 12
"""Routes of a class in its panel."""


def _interval(row: Record, metric: str) -> Cell:
    text = f"{row[metric]:.2f} ({row[f'{metric}_low']:.2f} … {row[f'{metric}_high']:.2f})"
    return Cell(text=text, sort=float(row[metric]))


def _overall(table: Sequence[Record], titles: Mapping[str, str]) -> Table:
    rows = [
        [words(titles[row["setting"]]), words(VARIANT_NAMES[row["variant"]]), *(_interval(row, m) for m in METRICS)]
        for row in table
        if row["class"] == "all"
    ]
    caption = f"Mean over all routes, and its {CONFIDENCE:.0%} interval over the choice of routes."
    return Table(heads=["setting", "variant", *METRIC_NAMES.values()], rows=rows, caption=caption)


def _by_class(table: Sequence[Record], titles: Mapping[str, str]) -> Table:
    cells: dict[tuple[str, str], dict[str, Cell]] = {}
    for row in table:
        where = cells.setdefault((row["setting"], row["variant"]), {})
        where[row["class"]] = _interval(row, "e_p_mean_m")
    rows = [
        [words(titles[setting]), words(VARIANT_NAMES[variant]), *(found[name] for name in CLASSES)]  # type: ignore[index]
        for (setting, variant), found in cells.items()
    ]
    caption = "Mean E_P [m] by class: greatest distance to the leader [m], waypoints near or far apart, headings."
    return Table(heads=["setting", "variant", *CLASSES], rows=rows, caption=caption)


def _claims(result: Study) -> Table:
    rows = []
    for claim, judgement, shares in result.judgements:
        often = ", ".join(
            f"{WORDS[verdict]} {share:.0%}" for verdict, share in sorted(shares.items(), key=lambda s: -s[1])
        )
        tone = VERDICT_TONES[judgement.verdict]
        rows.append(
            [
                number(claim.number),
                words(claim.text),
                words(WORDS[judgement.verdict], tone=tone),
                words(often),
                words(judgement.figures),
                words(claim.criterion),
            ]
        )
    heads = ["", "claim", "all routes", "resampled routes", "figures", "criterion"]
    caption = (
        "The paper's T2 and T5, T3 and T4, and T8 stand here for the third of the routes that is astern most of the "
        f"time, the third that is least, and the tenth with the highest speed. {CLAIM_RESAMPLES} times routes were "
        "drawn again from these with replacement: a verdict that seldom changes does not hang on the choice of routes."
    )
    return Table(heads=heads, rows=rows, caption=caption)


def _routes(result: Study, flights: Mapping[str, Trajectory]) -> Figures:
    panels = []
    for name in CLASSES:
        members = [m for m, c in result.classes.items() if c == name][:_DRAWN]
        every = slice(None, None, max(1, flights[members[0]].time.size // 200))
        leader = flights[members[0]].position[every, 0]
        lines = [Line(x=leader[:, 0], y=leader[:, 1], colour=LEADER, width=1.4)]
        for member in members:
            follower = flights[member].position[every, 1]
            lines.append(Line(x=follower[:, 0], y=follower[:, 1], colour=FOLLOWER, width=0.6))
        panel = figures.panel(lines, x_label="east [m]", y_label="north [m]", title=name, equal=True, height=3.0)
        panels.append(figures.svg(panel, f"class-{name}", f"Routes of class {name}"))
    legend = [(LEADER, "leader"), (FOLLOWER, "followers")]
    return Figures(panels=panels, legend=legend, caption=f"Up to {_DRAWN} routes of each class, as flown.")


def _spread(result: Study) -> Figures:
    """Distribution over routes of mean E_P: the share of routes below a value."""
    panels = []
    for name, title in (("base", "Δt_D = 1 s"), ("5s", "Δt_D = 5 s"), ("asymmetric", "unequal range errors")):
        setting = next((s for s in result.settings if s.name == name), None)
        if setting is None:
            continue
        lines = []
        for i, variant in enumerate(setting.variants):
            keys: list[Key] = [(name, m, variant) for m in result.classes]
            values = np.sort(np.array([result.rows[key]["e_p_mean_m"] for key in keys]))
            share = np.arange(1, values.size + 1) / values.size
            colour = SERIES[0 if variant == "laisn-2" else 1 if variant == "laisn-3-2" else 2]
            lines.append(Line(x=values, y=share, colour=colour, width=1.2 if i == 0 else 1.0))
        panel = figures.panel(
            lines, x_label="mean E_P of a route [m]", y_label="share of routes", title=title.replace("_", " "),
            y_limits=(0.0, 1.0),
        )  # fmt: skip
        panels.append(figures.svg(panel, f"spread-{name}", f"Distribution of mean position errors, {title}"))
    legend = list(zip(SERIES, ("LAISN-2", "LAISN-3(2)", "LAISN-3(1)"), strict=False))
    return Figures(panels=panels, legend=legend, caption="Mean E_P over routes: the share of routes below a value.")


def page_of(result: Study, table: Sequence[Record], flights: Mapping[str, Trajectory]) -> Page:
    """The whole report."""
    titles = {s.name: s.title for s in result.settings}
    motion = {"physics": "rigid bodies in water", "kinematic": "the paper's point motion"}[result.motion]
    stages = sorted({s.stage for s in result.settings})
    chosen = "" if len(stages) == 5 else "".join(f" --stage {s}" for s in stages)
    command = f"laisn reproduce --motion {result.motion} --runs {result.runs} --missions {result.routes}"
    command += f" --seed {result.seed}{chosen}"
    spread = _spread(result)
    return Page(
        title="The paper's evaluation on many routes",
        summary=f"{len(result.classes)} routes drawn in {len(CLASSES)} classes, {len(result.rows)} cells of "
        f"{result.runs} runs, with {motion}.",
        facts=[
            ("Source", "Praczyk & Hożyń, Electronics 2026, 15, 3709"),
            ("Motion", motion),
            ("Routes of each class", str(result.routes)),
            ("Runs of each cell, seed", f"{result.runs}, {result.seed}"),
            ("Version", next(iter(result.rows.values()))["version"]),
            ("Repeat with", command),
            ("Numbers", "distributions.parquet, distributions.csv, tables.parquet, cells/"),
        ],
        sections=[
            Section(title="Claims", blocks=[_claims(result)]),
            Section(
                title="Errors",
                blocks=[
                    Text(text="The choice of eight routes leaves much to chance; these intervals say how much."),
                    _overall(table, titles),
                    *([spread] if spread.panels else []),
                    _by_class(table, titles),
                ],
            ),
            Section(title="Routes", blocks=[_routes(result, flights)]),
        ],
    )
