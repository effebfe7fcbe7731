"""The stages on drawn routes, from drawing to report."""

from collections.abc import Callable, Sequence
from pathlib import Path

from experiments.campaign.campaign import CellPlan
from experiments.campaign.store import Record, Store, columns_of, write_csv, write_table
from experiments.pages.page import write
from experiments.reproduction.record import fly_once, plan_cells
from experiments.reproduction.routes_page import page_of
from experiments.reproduction.routes_study import Study, distributions, draw_followers, evidence_of, judge
from experiments.reproduction.stages import Motion, Setting


def study(
    settings: tuple[Setting, ...], *, motion: Motion, runs: int, missions: int, seed: int, folder: Path,
    run: Callable[[Sequence[CellPlan]], list[Record]],
) -> Path:  # fmt: skip
    """Draw routes, fly the stages on them, write tables and report; arguments and errors as in `reproduce`."""
    followers = draw_followers(missions, seed)
    classes = {name: name.rsplit("-", 1)[0] for name in followers}
    plans = plan_cells(settings, followers, motion=motion, runs=runs, seed=seed, keep_steps=False)
    rows = dict(zip(plans, run(list(plans.values())), strict=True))
    flights = fly_once(plans, Store(folder))
    table = distributions(settings, rows, classes, seed)
    write_table(folder / "distributions.parquet", columns_of(table))
    write_csv(folder / "distributions.csv", table)
    cells = [{"setting": key[0], "class": classes[key[1]], **row} for key, row in rows.items()]
    write_table(folder / "tables.parquet", columns_of(cells))
    result = Study(
        motion=motion,
        runs=runs,
        seed=seed,
        routes=missions,
        settings=settings,
        rows=rows,
        classes=classes,
        judgements=judge(evidence_of(rows, flights), classes, seed),
    )
    report = folder / "report.html"
    write(page_of(result, table, flights), report)
    return report
