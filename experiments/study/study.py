"""A study from its file to its page: `laisn study`."""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import NamedTuple, Unpack

import tomli_w

from experiments.campaign import missions
from experiments.campaign.campaign import ExecutionOptions, compile_ahead
from experiments.campaign.plans import CellPlan, compute
from experiments.campaign.store import Store, write_table
from experiments.flight.fly import fly
from experiments.pages.page import write
from experiments.study.estimate import Results
from experiments.study.file import Study, table_in
from experiments.study.plan import Plan, plan_of
from experiments.study.record import record_of
from experiments.study.run import Outcomes, fly_study, run_columns, table_columns
from laisn.failure import LaisnError
from sim.files import atomic_write

RESULTS, RUNS, RECORD, REPORT = "results.parquet", "runs.parquet", "results.json", "report.html"
STUDY = "study.toml"
_CELL_BYTES = 2_000
"""Bytes of a stored cell and its row in the tables; a run adds `_RUN_BYTES`."""
_RUN_BYTES = 80


class Effort(NamedTuple):
    """What a study would take."""

    flights: int
    cells: int
    runs: int
    seconds: float
    megabytes: float


def effort_of(plan: Plan, workers: int) -> Effort:
    """What a study would take if nothing of it were stored, from one mission that is flown and forgotten.

    Args:
        plan: of the study.
        workers: processes that share the work.
    """
    entry, runs = plan.entries[0], plan.study.runs
    cells = sum(len(e.scenario.followers) for e in plan.entries)
    if entry.closed_loop:
        fly(entry.scenario.first_messages)
        start = perf_counter()
        fly(entry.scenario)
        seconds, size = plan.flights * (perf_counter() - start), 4_000 * plan.flights
        return Effort(plan.flights, cells, cells * runs, seconds / workers, size / 1e6)
    cell = CellPlan(scenario=entry.scenario, runs=min(runs, 64))
    compile_ahead(cell)
    start = perf_counter()
    trajectory = missions.simulate_mission(entry.scenario)
    flown = perf_counter()
    compute(trajectory, [cell])
    done = perf_counter()
    with TemporaryDirectory() as folder:
        Store(Path(folder)).write_flight(entry.motion, trajectory)
        stored = sum(path.stat().st_size for path in Path(folder).rglob("*.npz"))
    blocks = -(-runs // 64)
    seconds = plan.flights * (flown - start) + cells * blocks * (done - flown)
    size = plan.flights * stored + cells * (_CELL_BYTES + runs * _RUN_BYTES)
    return Effort(plan.flights, cells, cells * runs, seconds / workers, size / 1e6)


def write_results(plan: Plan, outcomes: Outcomes, folder: Path, film: Path | None = None) -> Path:
    """Write tables, record and page of a study; the same outcomes give the same bytes.

    Returns:
        The page.

    Raises:
        LaisnError: nothing could be flown, or there is no such metric.
    """
    # drawing takes a third of a second to import, and who reads a table draws nothing
    from experiments.study.page import page_of

    if not outcomes.rows:
        raise LaisnError("no scenario of the study could be flown: " + "; ".join(outcomes.failures))
    results = Results.of(outcomes.rows, outcomes.runs)
    with atomic_write(folder / STUDY) as part:
        part.write_text(tomli_w.dumps(table_in(plan.study, folder)), encoding="utf-8")
    write_table(folder / RESULTS, table_columns(outcomes.rows))
    write_table(folder / RUNS, run_columns(outcomes.runs))
    record_of(plan, results).write(folder / RECORD)
    write(page_of(plan, results, outcomes.failures, film), folder / REPORT)
    return folder / REPORT


def run_study(
    study: Study,
    folder: Path,
    *,
    film: Callable[[Plan, Results, Path], Path | None] | None = None,
    **options: Unpack[ExecutionOptions],
) -> Path:
    """Fly a study, or what is missing of it, and write its tables and its page.

    Args:
        study: as read from its file.
        folder: of the results.
        film: makes the film that is to stand on the page; None: there is none.
        options: as of `campaign.fly`.

    Returns:
        The page.

    Raises:
        StudyError: a line for each fault of the study, before anything is flown.
        LaisnError: as of `fly_study` and `write_results`.
    """
    plan = plan_of(study)
    outcomes = fly_study(plan, folder, **options)
    filmed = film(plan, Results.of(outcomes.rows, outcomes.runs), folder) if film and outcomes.rows else None
    return write_results(plan, outcomes, folder, filmed)
