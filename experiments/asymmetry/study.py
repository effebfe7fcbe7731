"""The pitch study: what a leader that is not level does to its followers, where it matters, and what helps.

`run` flies what is missing of the study, writes its tables, and tells the story in `report.html`. Tasks go to disk one
by one, so that a study that was killed goes on where it stopped.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa

from experiments.asymmetry.conditions import CONDITIONS, QUICK_CONDITIONS, SEED, Condition, command_line
from experiments.asymmetry.example import Example, fly_example
from experiments.asymmetry.findings import findings_of
from experiments.asymmetry.flying import fly_condition
from experiments.asymmetry.gates import GateRow, fly_gates
from experiments.asymmetry.map import full_grid, measure_map, quick_grid
from experiments.asymmetry.missions import QUICK, Plan, Row
from experiments.asymmetry.missions_page import Results
from experiments.asymmetry.report import write_report
from experiments.asymmetry.tau import Curve, Curves, fly_curves
from experiments.campaign.missions import digest
from experiments.campaign.processes import Pool
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import Record, Store, columns_of, write_table
from experiments.campaign.version import code_version
from experiments.findings import FILE
from experiments.intervals import Interval
from laisn.settings import NavigationSettings
from laisn.sources import ROOT, Sources

Table = list[dict[str, Any]]
"""Rows by column name."""

_CURVES, _GATES = "curves", "gates"


_COMPUTING = tuple(f"experiments.asymmetry.{name}" for name in ("flying", "gates", "tau"))
"""Where the study's stored numbers come from, besides the campaigns of the code version."""


@cache
def _sources() -> str:
    """Hash of all that these modules can reach."""
    files = Sources(ROOT).reached(_COMPUTING)
    return digest([files[name].read_text(encoding="utf-8") for name in sorted(files)])


def _key(name: str, plan: Plan) -> str:
    return digest([code_version(), _sources(), name, asdict(plan), SEED])


def _compute(name: str, plan: Plan, mission: tuple[Condition, float] | None) -> tuple[str, Record]:
    """One task of the study: its name, and its rows as columns beside the version that computed them."""
    rows: Table
    if mission is not None:
        condition, offset = mission
        rows = [asdict(row) for row in fly_condition(condition, offset, plan)]
    elif name == _GATES:
        rows = [asdict(row) for row in fly_gates(plan)]
    else:
        curves = fly_curves(plan)
        rows = [asdict(c) | {"over": "tau"} for c in curves.tau] + [asdict(c) | {"over": "pitch"} for c in curves.pitch]
    return name, columns_of(rows) | {"version": code_version()}


def _compile_ahead(condition: Condition, plan: Plan) -> None:
    """Compile here, with a word, what each process would else compile for itself before its first result."""
    with compiling_shown():
        fly_condition(condition, plan.offsets_m[0], replace(plan, routes=plan.routes[:1], duration_s=2.0, looks=(1,)))


def _rows_of(record: Record) -> Table:
    columns = {name: values for name, values in record.items() if name != "version"}
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def _curves_of(rows: Table) -> Curves:
    def made(over: str) -> tuple[Curve, ...]:
        chosen: list[dict[str, Any]] = [
            {k: v for k, v in row.items() if k != "over"} for row in rows if row["over"] == over
        ]
        return tuple(
            Curve(**row | {k: tuple(row[k]) for k in ("value", "e_p_mean_m", "excess_half_m")}) for row in chosen
        )

    return Curves(tau=made("tau"), pitch=made("pitch"))


_WITH_INTERVAL = ("detected", "false_alarms", "e_p_mean_m", "e_p_mean_without_echoes_m")


def _gate(row: dict[str, Any]) -> GateRow:
    return GateRow(**row | {rate: Interval(*row[rate]) for rate in _WITH_INTERVAL})


def _table(path: Path, rows: Sequence[Any]) -> None:
    write_table(path, columns_of([asdict(row) for row in rows]))


def run(
    folder: Path,
    *,
    quick: bool = False,
    workers: int | None = None,
    cluster: str | None = None,
    force: bool = False,
    quiet: bool = False,
    film: Callable[[Example, Path], Path | None] | None = None,
) -> Path:
    """Fly the study, or what is missing of it, and write tables and report.

    Args:
        folder: of the results; made if it is not there.
        quick: a first look: three conditions, two routes, short missions.
        workers: local processes; None: one for each core.
        cluster: address of a Dask scheduler (tcp://…); its workers compute instead.
        force: compute everything again.
        quiet: show no progress.
        film: renders the film of the example into the folder, or gives None where that cannot be done.

    Returns:
        The report.

    Raises:
        ValueError: the folder holds results of another version, or the cluster cannot be used.
        WorkerDiedError: a process died; what was computed is stored.
    """
    plan = QUICK if quick else Plan()
    conditions = QUICK_CONDITIONS if quick else CONDITIONS
    missions = {f"{c.key} {offset:g} m": (c, offset) for c in conditions for offset in plan.offsets_m}
    # the longest first, so that no process waits for another at the end
    names = [_CURVES, _GATES, *missions]
    store = Store(folder, force=force)
    missing = [name for name in names if store.read(_key(name, plan)) is None]
    if missing:
        if cluster is None and not quiet:
            _compile_ahead(conditions[0], plan)
        with Pool(min(workers or len(os.sched_getaffinity(0)), len(missing)), cluster) as pool:
            tasks = ((name, plan, missions.get(name)) for name in missing)
            with progress("fleets", len(missing), quiet=quiet) as advance:
                for name, record in pool.each(_compute, tasks):
                    store.write(_key(name, plan), record)
                    advance()

    def stored(name: str) -> Table:
        return _rows_of(store.read(_key(name, plan)) or {})

    with compiling_shown():
        chart: pa.Table = measure_map(quick_grid() if quick else full_grid(), NavigationSettings(side_rule="predicted"))
    shown = fly_example(QUICK_CONDITIONS[-1], plan.duration_s)
    results = Results(
        plan=plan,
        conditions=conditions,
        missions=tuple(Row(**row) for name in missions for row in stored(name)),
        curves=_curves_of(stored(_CURVES)),
        gates=tuple(_gate(row) for row in stored(_GATES)),
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
