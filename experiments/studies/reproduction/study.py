"""The paper's evaluation, run again: its tables beside the published ones, its figures, and its claims judged."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Unpack

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions, Flown
from experiments.campaign.plans import CellPlan
from experiments.campaign.store import Record, columns_of, write_csv, write_table
from experiments.findings import FILE
from experiments.flight.library import fly_line
from experiments.pages.page import Figures, page_of, write
from experiments.studies.reproduction import figures, findings, settings
from experiments.studies.reproduction.findings import BASE, REPLICATIONS, replicate_over_time
from experiments.studies.reproduction.settings import FIGURES, METRICS, ROUTE, STAGES, Key, Motion, Setting
from experiments.study.plan import Entry

MOTIONS = {"physics": "rigid bodies in water", "kinematic": "the paper's point motion"}


class Simulated(NamedTuple):
    """Scenarios and cells of the tables, what came of them, and the figures that claims are judged by."""

    entries: Mapping[Key, Entry]
    plans: Mapping[Key, CellPlan]
    flown: Flown
    figures: findings.Figures


def simulate(
    chosen: Sequence[Setting], folder: Path, *, motion: Motion, runs: int, seed: int, tables: bool = True,
    **options: Unpack[ExecutionOptions],
) -> Simulated:  # fmt: skip
    """Simulate the cells of the tables, on request, and all replications of those that claims compare."""
    entries = settings.entries(chosen, motion=motion, runs=runs, seed=seed)
    drawn = {(f["setting"], mission, f["variant"]) for f in FIGURES for mission in f["missions"]}
    plans = {key: CellPlan(scenario=one.scenario, runs=runs, keep_steps=key in drawn) for key, one in entries.items()}
    judged = {
        key: replace(plan, runs=REPLICATIONS * runs, keep_steps=False)
        for key, plan in plans.items()
        if f"{key[0]} {key[2]}" in findings.JUDGED
    }
    tasks = {
        route: partial(replicate_over_time, plan.scenario, runs, REPLICATIONS)
        for (setting, route, variant), plan in judged.items()
        if f"{setting} {variant}" == BASE
    }
    cells = [*plans.values(), *judged.values()] if tables else [*judged.values()]
    flown = campaign.fly(Design(cells=cells, tasks=tasks, what="replications"), folder, **options)
    lists = {key: flown.cell(plan)[1] for key, plan in judged.items()}
    return Simulated(entries, plans, flown, findings.Figures.of(lists, [*flown.tasks.values()], runs))


def table_rows(
    chosen: Sequence[Setting], entries: Mapping[Key, Entry], rows: Mapping[Key, Record],
    published: Mapping[Key, Mapping[str, float]],
) -> list[Record]:  # fmt: skip
    """Published and own figures side by side, a row for each cell."""
    columns = {setting.name: settings.columns(setting) for setting in chosen}
    table = []
    for key, row in rows.items():
        theirs = published.get(key, {})
        line: Record = {**columns[key[0]], "trajectory": key[1], "variant": key[2]}
        for metric in METRICS:
            line[f"published_{metric}"] = theirs.get(metric)
            line[f"ours_{metric}"] = row[metric]
            line[f"ratio_{metric.rsplit('_', 1)[0]}"] = row[metric] / theirs[metric] if metric in theirs else None
        line |= {name: value for name, value in row.items() if name not in {*METRICS, "mission", "variant"}}
        changed = {name: value for name, value in entries[key].settings.items() if name != ROUTE}
        line["fly_worst_run"] = fly_line(key[1], changed, row["worst_run"])
        table.append(line)
    return table


def reproduce(
    stage: Sequence[int] | None = None,
    *,
    motion: Motion = "physics",
    runs: int = 60,
    seed: int = 1,
    out: Path | None = None,
    **options: Unpack[ExecutionOptions],
) -> Path:
    """Fly stages of the paper (none: all), write `tables.parquet`, `tables.csv`, `results.json` and the report, which
    it returns.

    `out` is out/reproduce-MOTION unless given; options as of `campaign.fly`. LaisnError: unknown stage or motion, or no
    runs.
    """
    chosen, published = settings.settings_of(stage or None), settings.published()
    folder = out or Path("out") / f"reproduce-{motion}"
    entries, plans, flown, found = simulate(chosen, folder, motion=motion, runs=runs, seed=seed, **options)
    rows = {key: flown.cell(plan)[0] for key, plan in plans.items()}
    table = table_rows(chosen, entries, rows, published)
    write_table(folder / "tables.parquet", columns_of(table))
    write_csv(folder / "tables.csv", table)
    judgements = findings.judge(found, published)
    record = findings.findings_of(chosen, rows, published, judgements, motion)
    record.write(folder / FILE)

    steps = {key: flown.steps(plan) for key, plan in plans.items() if plan.keep_steps}
    flights = {key[1]: campaign.mission(plan.scenario, flown.store) for key, plan in plans.items()}
    stages = sorted({setting.stage for setting in chosen})
    options_text = "" if len(stages) == len(STAGES) else "".join(f" --stage {number}" for number in stages)
    facts = [
        ("Source", "Praczyk & Hożyń, Electronics 2026, 15, 3709"),
        ("Motion", MOTIONS[motion]),
        ("Runs of each cell, seed", f"{runs}, {seed}"),
        ("Version", next(iter(rows.values()))["version"]),
        ("Repeat with", f"laisn reproduce --motion {motion} --runs {runs} --seed {seed}{options_text}"),
        ("Numbers", "tables.parquet, tables.csv, store/"),
    ]
    panel, legend = figures.agreement(table)
    values = figures.page_values(chosen, rows, published, judgements) | {
        "motion": MOTIONS[motion],
        "errors": figures.error_figures(steps),
        "routes": figures.routes(flights),
        "agreement": Figures(panels=[panel], legend=legend),
    }
    report = folder / "report.html"
    write(page_of(__package__, facts, values, record), report)
    return report
