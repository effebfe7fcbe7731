"""The paper's evaluation, run again: its tables beside the published ones, its figures, and its claims judged."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Unpack

from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions
from experiments.campaign.plans import CellPlan
from experiments.campaign.store import Arrays, Record, Store, columns_of, write_csv, write_table
from experiments.findings import FILE, Findings
from experiments.flight.library import ROUTES, fly_line
from experiments.pages.page import write
from experiments.pages.template import page_of
from experiments.studies.reproduction import claims, figures, findings, replications, settings
from experiments.studies.reproduction.claims import Claim, Judgement
from experiments.studies.reproduction.settings import FIGURES, METRICS, STAGES, Key, Motion, Setting
from laisn.failure import LaisnError
from sim.scenario.file import dotted
from sim.scenario.settings import Follower, Scenario

SEEDS = range(101, 121)
"""Seeds 1 to 6 served to choose how many replications, and at what confidence, claims are judged by."""
_MOTIONS = {"physics": "rigid bodies in water", "kinematic": "the paper's point motion"}


def fly_command(scenario: Scenario, run: int) -> str:
    """The command that flies one run of a cell of a built-in mission alone, with the very same noise."""
    usual = Scenario(name=scenario.name, followers=(Follower(route=scenario.name),))
    default, given = (dotted(one.model_dump(mode="json")) for one in (usual, scenario))
    return fly_line(scenario.name, {key: value for key, value in given.items() if value != default.get(key)}, run)


def plan_cells(chosen: Sequence[Setting], *, motion: Motion, runs: int, seed: int) -> dict[Key, CellPlan]:
    """The cells of some settings on all missions."""
    drawn = {(f["setting"], mission, f["variant"]) for f in FIGURES for mission in f["missions"]}
    found: dict[Key, CellPlan] = {}
    for setting in chosen:
        for route in ROUTES:
            for variant in setting.variants:
                made = settings.scenario(setting, route, variant=variant, motion=motion, seed=seed)
                key = setting.name, route, variant
                found[key] = CellPlan(scenario=made, runs=runs, keep_steps=key in drawn)
    return found


def table_rows(
    chosen: Sequence[Setting], plans: Mapping[Key, CellPlan], rows: Mapping[Key, Record],
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
        line["fly_worst_run"] = fly_command(plans[key].scenario, row["worst_run"])
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
    chosen, published = settings.settings_of(stage or None), settings.published()
    if motion not in _MOTIONS:
        raise LaisnError(f"unknown motion {motion!r}; available: {', '.join(_MOTIONS)}")
    plans = plan_cells(chosen, motion=motion, runs=runs, seed=seed)
    repeated = replications.tasks(chosen, motion=motion, runs=runs, seed=seed)
    design = Design(cells=list(plans.values()), tasks=repeated, what="replications")
    flown = campaign.fly(design, out or Path("out") / f"reproduce-{motion}", **options)
    folder, rows = flown.store.folder, dict(zip(plans, flown.rows, strict=True))
    table = table_rows(chosen, plans, rows, published)
    write_table(folder / "tables.parquet", columns_of(table))
    write_csv(folder / "tables.csv", table)
    judgements = claims.judge([row for found in flown.tasks.values() for row in found], published)
    record = findings.findings_of(chosen, rows, published, judgements, motion)
    record.write(folder / FILE)
    steps = {key: flown.steps(plan) for key, plan in plans.items() if plan.keep_steps}
    return write_page(chosen, plans, rows, steps, judgements, record, flown.store)


def write_page(
    chosen: Sequence[Setting], plans: Mapping[Key, CellPlan], rows: Mapping[Key, Record],
    steps: Mapping[Key, Arrays], judgements: Sequence[tuple[Claim, Judgement, Judgement]], record: Findings,
    store: Store,
) -> Path:  # fmt: skip
    """Write the report of a reproduction into the folder of its results; returns its path."""
    flights = {key[1]: plan.scenario for key, plan in plans.items()}
    first, runs = next(iter(plans.values())).scenario, record["runs"].value
    stages = sorted({setting.stage for setting in chosen})
    options = "" if len(stages) == len(STAGES) else "".join(f" --stage {stage}" for stage in stages)
    facts = [
        ("Source", "Praczyk & Hożyń, Electronics 2026, 15, 3709"),
        ("Motion", _MOTIONS[first.motion]),
        ("Runs of each cell, seed", f"{runs}, {first.seed}"),
        ("Version", next(iter(rows.values()))["version"]),
        ("Repeat with", f"laisn reproduce --motion {first.motion} --runs {runs} --seed {first.seed}{options}"),
        ("Numbers", "tables.parquet, tables.csv, store/"),
    ]
    values = figures.page_values(chosen, rows, settings.published(), judgements) | {
        "motion": _MOTIONS[first.motion],
        "errors": figures.error_figures(steps),
        "routes": figures.routes({name: campaign.mission(made, store) for name, made in flights.items()}),
    }
    report = store.folder / "report.html"
    write(page_of("experiments.studies.reproduction", facts, values, record), report)
    return report


def judge_with_seeds(
    folder: Path, seeds: Sequence[int] = SEEDS, runs: int = 60, **options: Unpack[ExecutionOptions]
) -> None:
    """Judge the claims on physical missions with every seed, and write the record of their verdicts.

    `runs` are those of each replication; folder and options as of `campaign.fly`.
    """
    work = {
        (seed, name): task
        for seed in seeds
        for name, task in replications.tasks(settings.SETTINGS, motion="physics", runs=runs, seed=seed).items()
    }
    flown = campaign.fly(Design(tasks=work, what="replications"), folder, **options).tasks
    verdicts = {}
    for seed in seeds:
        rows = [row for name, found in flown.items() if name[0] == seed for row in found]
        verdicts[seed] = [ours.verdict for _, ours, _ in claims.judge(rows, settings.published())]
    findings.findings_of_seeds(verdicts).write(folder / FILE)
