"""The paper's evaluation, flown again: its tables beside the published ones, its figures, and its claims judged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments import campaign, stages
from experiments.campaign import CellPlan
from experiments.claims import CLAIMS, Claim
from experiments.evidence import Evidence, Judgement
from experiments.library import ROUTES
from experiments.stages import METRICS, Key, Motion, Setting
from experiments.store import Record, Steps, Store, columns_of, write_csv, write_table
from laisn.settings import Variant
from sim.scenario import Follower, Scenario
from sim.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class ErrorFigure:
    """A figure of the paper: errors over time on some missions."""

    number: int
    setting: str
    variant: Variant
    missions: tuple[str, ...]


FIGURES = (
    ErrorFigure(number=3, setting="base", variant="laisn-2", missions=("T2", "T5", "T6", "T7", "T8", "T9")),
    ErrorFigure(number=4, setting="5s", variant="laisn-2", missions=("T2", "T5", "T6", "T7", "T8", "T9")),
    ErrorFigure(number=5, setting="10s", variant="laisn-2", missions=("T5", "T6")),
    ErrorFigure(number=6, setting="10s-slow", variant="laisn-2", missions=("T2", "T3", "T4", "T5")),
    ErrorFigure(number=7, setting="asymmetric", variant="laisn-2", missions=("T2", "T5")),
    ErrorFigure(number=8, setting="asymmetric", variant="laisn-3-2", missions=("T2", "T5")),
    ErrorFigure(number=9, setting="heading5", variant="laisn-3-2", missions=("T3", "T4")),
)
"""Figures 3 to 9. The text names only some of their missions; the others are chosen like those."""


@dataclass(frozen=True, kw_only=True)
class Reproduction:
    """Everything that came out."""

    motion: Motion
    runs: int
    seed: int
    settings: tuple[Setting, ...]
    plans: Mapping[Key, CellPlan]
    rows: Mapping[Key, Record]
    steps: Mapping[Key, Steps]
    published: Mapping[Key, dict[str, float]]
    evidence: Evidence
    judgements: Sequence[tuple[Claim, Judgement, Judgement]]
    """Each claim with its judgement on our figures and on the published ones."""
    folder: Path


def followers_of_the_paper() -> dict[str, Follower]:
    """The eight missions by name."""
    return {route: Follower(route=route) for route in ROUTES}


def _kept(key: Key) -> bool:
    setting, mission, variant = key
    if (setting, variant) == ("base", "laisn-2"):
        return True
    return any((f.setting, f.variant) == (setting, variant) and mission in f.missions for f in FIGURES)


def plan_cells(
    settings: Sequence[Setting], followers: Mapping[str, Follower], *, motion: Motion, runs: int, seed: int,
    keep_steps: bool = True,
) -> dict[Key, CellPlan]:  # fmt: skip
    """The cells of some settings on some missions."""
    return {
        (setting.name, name, variant): CellPlan(
            scenario=stages.scenario(setting, follower, name, variant=variant, motion=motion, seed=seed),
            runs=runs,
            keep_steps=keep_steps and _kept((setting.name, name, variant)),
        )
        for setting in settings
        for name, follower in followers.items()
        for variant in setting.variants
    }


def fly_once(plans: Mapping[Key, CellPlan], store: Store) -> dict[str, Trajectory]:
    """The flight of each mission by its name."""
    first: dict[str, CellPlan] = {}
    for (_, name, _), plan in plans.items():
        first.setdefault(name, plan)
    return {name: campaign.mission(plan.scenario, store) for name, plan in first.items()}


def mean_distance(flight: Trajectory) -> float:
    """Mean distance of the first follower's hydrophone and the leader [m]."""
    site = flight.site(f"{flight.names[1]}/hydrophone")
    return float(np.hypot(*(flight.site_position[:, site, :2] - flight.position[:, 0, :2]).T).mean())


def _differences(given: Any, default: Any, path: str) -> list[tuple[str, Any]]:
    if isinstance(given, dict) and isinstance(default, dict):
        return [d for k, v in given.items() for d in _differences(v, default.get(k), f"{path}.{k}" if path else k)]
    tables = isinstance(given, list) and bool(given) and isinstance(given[0], dict)
    if tables and len(given) == len(default):
        pairs = enumerate(zip(given, default, strict=True))
        return [d for i, (g, o) in pairs for d in _differences(g, o, f"{path}.{i}")]
    return [] if given == default else [(path, given)]


def fly_command(scenario: Scenario, run: int) -> str:
    """The command that flies one run of a cell of a built-in mission alone, with the very same noise."""
    default = Scenario(name=scenario.name, followers=(Follower(route=scenario.name),)).model_dump(mode="json")
    changed = _differences(scenario.model_dump(mode="json"), default, "")
    texts = [f"--set {key}={str(value).lower() if isinstance(value, bool) else value}" for key, value in changed]
    return " ".join(["laisn fly", scenario.name, f"--run {run}", *(t.replace(", ", ",") for t in texts)])


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


def judge(evidence: Evidence, published: Mapping[Key, dict[str, float]]) -> list[tuple[Claim, Judgement, Judgement]]:
    """Every claim on our figures and on the published ones."""
    distance = {m: evidence.value("base", m, "laisn-2", "distance_m") for m in evidence.missions}
    theirs = Evidence(
        rows={key: {**row, "distance_m": distance.get(key[1], np.nan)} for key, row in published.items()},
        missions=ROUTES,
    )
    return [(claim, claim.judge(evidence), claim.judge(theirs)) for claim in CLAIMS]


def reproduce(
    stage: Sequence[int] | None = None,
    *,
    motion: Motion = "physics",
    runs: int = 60,
    missions: int | None = None,
    seed: int = 1,
    workers: int | None = None,
    out: Path | None = None,
    force: bool = False,
    cluster: str | None = None,
    quiet: bool = False,
) -> Path:
    """Fly the paper's stages, write `tables.parquet`, `tables.csv` and `report.html`.

    Args:
        stage: stages to fly; None or none: all five.
        motion: rigid bodies in water, or the paper's point motion.
        runs: of each cell.
        missions: routes drawn for each class of the paper's routes, in place of the paper's eight; None: the eight.
        seed: key of all random numbers.
        workers: local processes; None: one for each core.
        out: folder; None: out/reproduce-MOTION.
        force: compute everything again.
        cluster: address of a Dask scheduler to compute on.
        quiet: show no progress.

    Returns:
        The report.

    Raises:
        ValueError: unknown stage or motion, no runs, a folder of another version, an unusable cluster.
        WorkerDiedError: a process died; what was computed is stored.
    """
    settings = stages.settings_of(stage or None)
    if motion not in ("physics", "kinematic"):
        raise ValueError(f"unknown motion {motion!r}; available: physics, kinematic")
    if missions is not None:
        from experiments.routes_study import study

        folder = out or Path("out") / f"routes-{motion}"
        return study(
            settings, motion=motion, runs=runs, missions=missions, seed=seed, folder=folder,
            run=lambda plans: campaign.run(
                plans, folder, workers=workers, cluster=cluster, force=force, quiet=quiet
            ),
        )  # fmt: skip
    folder = out or Path("out") / f"reproduce-{motion}"
    plans = plan_cells(settings, followers_of_the_paper(), motion=motion, runs=runs, seed=seed)
    records = campaign.run(
        list(plans.values()), folder, workers=workers, cluster=cluster, force=force, quiet=quiet
    )  # fmt: skip
    rows = dict(zip(plans, records, strict=True))
    return _write(settings, plans, rows, folder)


def _write(
    settings: tuple[Setting, ...], plans: Mapping[Key, CellPlan], rows: Mapping[Key, Record], folder: Path
) -> Path:
    from experiments.page import write
    from experiments.reproduction_page import page_of

    store, published = Store(folder), stages.published()
    table = table_rows(settings, plans, rows, published)
    write_table(folder / "tables.parquet", columns_of(table))
    write_csv(folder / "tables.csv", table)
    kept = {key: store.read_steps(plan.key) for key, plan in plans.items() if plan.keep_steps}
    steps = {key: value for key, value in kept.items() if value is not None}
    flights = fly_once(plans, store)
    distance = {name: mean_distance(flight) for name, flight in flights.items()}
    ours = {key: {**row, "distance_m": distance[key[1]]} for key, row in rows.items()}
    evidence = Evidence(rows=ours, missions=ROUTES, steps=steps)
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
        evidence=evidence,
        judgements=judge(evidence, published),
        folder=folder,
    )
    report = folder / "report.html"
    write(page_of(result, flights), report)
    return report
