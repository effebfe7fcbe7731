"""The paper's evaluation, flown again: its tables beside the published ones, its figures, and its claims judged."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Unpack

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions, Flown
from experiments.campaign.plans import CellPlan
from experiments.campaign.store import Record, columns_of, write_csv, write_table
from experiments.findings import FILE
from experiments.flight.library import ROUTES, fly_line
from experiments.pages.page import write
from experiments.reproduction import stages
from experiments.reproduction.claims import CLAIMS, Claim
from experiments.reproduction.findings import findings_of
from experiments.reproduction.page import page_of
from experiments.reproduction.record import (
    Reproduction,
    fly_once,
    followers_of_the_paper,
    plan_cells,
)
from experiments.reproduction.replications import by_cell, means, resampled, tasks
from experiments.reproduction.stages import METRICS, Key, Motion, Setting
from experiments.reproduction.verdict import Judgement, Results
from laisn.failure import LaisnError
from sim.scenario.file import dotted
from sim.scenario.settings import Follower, Scenario


def fly_command(scenario: Scenario, run: int) -> str:
    """The command that flies one run of a cell of a built-in mission alone, with the very same noise."""
    usual = Scenario(name=scenario.name, followers=(Follower(route=scenario.name),))
    default, given = (dotted(one.model_dump(mode="json")) for one in (usual, scenario))
    return fly_line(scenario.name, {key: value for key, value in given.items() if value != default.get(key)}, run)


def table_rows(
    settings: Sequence[Setting], plans: Mapping[Key, CellPlan], rows: Mapping[Key, Record],
    published: Mapping[Key, Mapping[str, float]],
) -> list[Record]:  # fmt: skip
    """Published and own figures side by side, a row for each cell."""
    by_name = {setting.name: setting for setting in settings}
    table = []
    for key, row in rows.items():
        theirs = published.get(key, {})
        line: Record = {**stages.columns(by_name[key[0]]), "trajectory": key[1], "variant": key[2]}
        for metric in METRICS:
            line[f"published_{metric}"] = theirs.get(metric)
            line[f"ours_{metric}"] = row[metric]
            line[f"ratio_{metric.rsplit('_', 1)[0]}"] = row[metric] / theirs[metric] if metric in theirs else None
        line |= {name: value for name, value in row.items() if name not in {*METRICS, "mission", "variant"}}
        line["fly_worst_run"] = fly_command(plans[key].scenario, row["worst_run"])
        table.append(line)
    return table


def judge(
    replications: Iterable[Record], published: Mapping[Key, dict[str, float]]
) -> list[tuple[Claim, Judgement, Judgement]]:
    """Every claim on our figures, with the intervals that replications give, and on the published ones.

    Args:
        replications: rows of `replications.replicate`, of all missions.
        published: the published figures.
    """
    cells = by_cell(replications)
    ours = Results(rows=means(cells), missions=ROUTES, replicated=cells)
    drawn = Results(rows=resampled(cells), missions=ROUTES)
    distance = {m: ours.value("base", m, "laisn-2", "distance_m") for m in ROUTES}
    theirs = Results(
        rows={key: {**row, "distance_m": distance[key[1]]} for key, row in published.items()},
        missions=ROUTES,
    )
    return [(claim, claim.judge(ours, drawn), claim.judge(theirs)) for claim in CLAIMS]


def reproduce(
    stage: Sequence[int] | None = None,
    *,
    motion: Motion = "physics",
    runs: int = 60,
    seed: int = 1,
    out: Path | None = None,
    **options: Unpack[ExecutionOptions],
) -> Path:
    """Fly the paper's stages, write `tables.parquet`, `tables.csv`, `results.json` and `report.html`.

    Args:
        stage: stages to fly; None or none: all five.
        motion: rigid bodies in water, or the paper's point motion.
        runs: of each cell.
        seed: key of all random numbers.
        out: folder; None: out/reproduce-MOTION.
        options: as of `campaign.fly`.

    Returns:
        The report.

    Raises:
        LaisnError: unknown stage or motion, no runs, or as of `campaign.fly`.
    """
    settings = stages.settings_of(stage or None)
    if motion not in ("physics", "kinematic"):
        raise LaisnError(f"unknown motion {motion!r}; available: physics, kinematic")
    folder, followers = out or Path("out") / f"reproduce-{motion}", followers_of_the_paper()
    plans = plan_cells(settings, followers, motion=motion, runs=runs, seed=seed)
    cells = list(plans.values())
    repeated = tasks(settings, followers, motion=motion, runs=runs, seed=seed)
    design = Design(cells=cells, tasks=repeated, what="replications")
    return _write(settings, plans, campaign.fly(design, folder, **options))


def _write(settings: tuple[Setting, ...], plans: Mapping[Key, CellPlan], flown: Flown) -> Path:
    folder, published = flown.store.folder, stages.published()
    rows = dict(zip(plans, flown.rows, strict=True))
    table = table_rows(settings, plans, rows, published)
    write_table(folder / "tables.parquet", columns_of(table))
    write_csv(folder / "tables.csv", table)
    kept = {key: flown.store.arrays(plan.key) for key, plan in plans.items() if plan.keep_steps}
    steps = {key: value for key, value in kept.items() if value is not None}
    flights = fly_once(plans, flown.store)
    repeated = [row for found in flown.tasks.values() for row in found]
    first = next(iter(plans.values()))
    result = Reproduction(
        motion=first.scenario.motion,
        runs=first.runs,
        seed=first.scenario.seed,
        settings=settings,
        plans=plans,
        rows=rows,
        steps=steps,
        published=published,
        judgements=judge(repeated, published),
        folder=folder,
    )
    findings_of(settings, rows, published, result.judgements, first.scenario.motion).write(folder / FILE)
    report = folder / "report.html"
    write(page_of(result, flights), report)
    return report
