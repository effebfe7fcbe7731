"""The stages on drawn routes: tables and report of what was flown."""

from collections.abc import Mapping
from pathlib import Path

from experiments.campaign.campaign import Flown
from experiments.campaign.plans import CellPlan
from experiments.campaign.store import columns_of, write_csv, write_table
from experiments.pages.page import write
from experiments.reproduction.record import fly_once
from experiments.reproduction.routes_page import page_of
from experiments.reproduction.routes_study import Study, distributions, judge, results_of
from experiments.reproduction.stages import Key, Setting


def write_routes(settings: tuple[Setting, ...], plans: Mapping[Key, CellPlan], flown: Flown) -> Path:
    """Write tables and report of the stages on drawn routes, `CLASS-0`, `CLASS-1` and so on; gives the report."""
    folder, first = flown.store.folder, next(iter(plans.values()))
    classes = {name: name.rsplit("-", 1)[0] for _, name, _ in plans}
    rows, seed = dict(zip(plans, flown.rows, strict=True)), first.scenario.seed
    flights = fly_once(plans, flown.store)
    table = distributions(settings, rows, classes, seed)
    write_table(folder / "distributions.parquet", columns_of(table))
    write_csv(folder / "distributions.csv", table)
    cells = [{"setting": key[0], "class": classes[key[1]], **row} for key, row in rows.items()]
    write_table(folder / "tables.parquet", columns_of(cells))
    result = Study(
        motion=first.scenario.motion,
        runs=first.runs,
        seed=seed,
        routes=len(classes) // len(set(classes.values())),
        settings=settings,
        rows=rows,
        classes=classes,
        judgements=judge(results_of(rows, flights), classes, seed),
    )
    report = folder / "report.html"
    write(page_of(result, table, flights), report)
    return report
