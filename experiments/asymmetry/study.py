"""The pitch study: what a leader that is not level does to its followers, where it matters, and what helps.

`run` flies what is missing of the study, writes its tables, and tells the story in `report.html`. Tasks go to disk one
by one, so that a study that was killed goes on where it stopped.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import pyarrow as pa

from experiments.asymmetry.conditions import CONDITIONS, QUICK_CONDITIONS, Condition, command_line
from experiments.asymmetry.example import Example, fly_example
from experiments.asymmetry.findings import findings_of
from experiments.asymmetry.flying import fly_condition
from experiments.asymmetry.gates import GateRow, fly_gates
from experiments.asymmetry.map import full_grid, measure_map, quick_grid
from experiments.asymmetry.missions import QUICK, Plan, Row
from experiments.asymmetry.missions_page import Results
from experiments.asymmetry.report import write_report
from experiments.asymmetry.tau import Curves, fly_curves
from experiments.campaign import campaign
from experiments.campaign.campaign import Design, ExecutionOptions
from experiments.campaign.progress import compiling_shown
from experiments.campaign.store import Record, columns_of, write_table
from experiments.campaign.tasks import Task, typed
from experiments.findings import FILE
from laisn.settings import NavigationSettings

_CURVES, _GATES = "curves", "gates"


def _first_look(condition: Condition, plan: Plan) -> None:
    """Fly so little of a study that compiling is all that takes time."""
    fly_condition(condition, plan.offsets_m[0], replace(plan, routes=plan.routes[:1], duration_s=2.0, looks=(1,)))


def _table(path: Path, rows: Sequence[Any]) -> None:
    write_table(path, columns_of([asdict(row) for row in rows]))


def run(
    folder: Path,
    *,
    quick: bool = False,
    film: Callable[[Example, Path], Path | None] | None = None,
    **options: Unpack[ExecutionOptions],
) -> Path:
    """Fly the study, or what is missing of it, and write tables and report.

    Args:
        folder: of the results; made if it is not there.
        quick: a first look: three conditions, two routes, short missions.
        film: renders the film of the example into the folder, or gives None where that cannot be done.
        options: as of `campaign.fly`.

    Returns:
        The report.

    Raises:
        LaisnError: as of `campaign.fly`.
    """
    plan = QUICK if quick else Plan()
    conditions = QUICK_CONDITIONS if quick else CONDITIONS
    missions: dict[Any, Task] = {
        (c.key, offset): partial(fly_condition, c, offset, plan) for c in conditions for offset in plan.offsets_m
    }
    design = Design(
        # the longest first, so that no process waits for another at the end
        tasks={_CURVES: partial(fly_curves, plan), _GATES: partial(fly_gates, plan), **missions},
        what="fleets",
        ahead=partial(_first_look, conditions[0], plan),
    )
    flown = campaign.fly(design, folder, **options).tasks

    with compiling_shown():
        chart: pa.Table = measure_map(quick_grid() if quick else full_grid(), NavigationSettings(side_rule="predicted"))
    shown = fly_example(QUICK_CONDITIONS[-1], plan.duration_s)
    results = Results(
        plan=plan,
        conditions=conditions,
        missions=tuple(row for name in missions for row in typed(Row, flown[name])),
        curves=typed(Curves, flown[_CURVES])[0],
        gates=tuple(typed(GateRow, flown[_GATES])),
        chart=chart,
        example=shown,
        film=None,
    )
    by_key = {condition.key: condition for condition in conditions}
    missions_flown: list[Record] = [
        asdict(row) | {"fly": command_line(by_key[row.condition], row.route, row.depth_offset_m, variant=row.variant)}
        for row in results.missions
    ]
    command = f"laisn asymmetry{' --quick' if quick else ''}"
    findings_of(plan, results.missions, results.curves, command).write(folder / FILE)
    write_table(folder / "missions.parquet", columns_of(missions_flown))
    _table(folder / "equivalents.parquet", results.curves.tau + results.curves.pitch)
    _table(folder / "gates.parquet", results.gates)
    write_table(folder / "map.parquet", {name: chart[name] for name in chart.column_names})
    report = folder / "report.html"
    try:
        filmed = film(shown, folder) if film else None
    except Exception:
        # a film that fails costs nothing else
        write_report(results, report)
        raise
    write_report(replace(results, film=filmed), report)
    return report
