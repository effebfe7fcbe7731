"""Flying a study: missions in parallel, each once, then cells; all of it stored, and gone on with after a kill."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign import missions
from experiments.campaign.campaign import CellPlan, compile_ahead, compute_cells, missing_cells
from experiments.campaign.processes import Pool
from experiments.campaign.progress import compiling_shown, progress
from experiments.campaign.store import CampaignError, Record, Store, columns_of
from experiments.campaign.version import code_version
from experiments.flight.fly import fly
from experiments.study.closed_runs import records_of_run
from experiments.study.facts import facts_of
from experiments.study.plan import Entry, Plan
from sim.scenario.settings import Scenario
from sim.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Outcomes:
    """All that came out of a study, one entry beside another."""

    rows: list[Record]
    """One row of results for each entry and follower."""
    runs: list[tuple[Record, Record]]
    """One pair for each entry and follower: what it is, and lists over runs by name."""
    failures: dict[str, list[Entry]] = field(default_factory=dict)
    """Entries that could not be flown, by what happened."""


def plans_of(entry: Entry, runs: int) -> list[CellPlan]:
    """The cells of an entry, one for each follower."""
    return [
        CellPlan(scenario=entry.scenario, runs=runs, follower=follower)
        for follower in range(len(entry.scenario.followers))
    ]


def _facts_key(motion: str) -> str:
    return missions.digest([motion, "facts"])


def _run_key(scenario: Scenario, run: int) -> str:
    return missions.key_of(missions.content_of(scenario), "closed loop", run)


def _fly(scenario: Scenario) -> tuple[Scenario, Trajectory | None, list[Record] | str]:
    """A mission and its facts; None and what happened if it cannot be flown."""
    try:
        trajectory = missions.simulate_mission(scenario)
    except CampaignError as error:
        return scenario, None, str(error).splitlines()[0]
    return scenario, trajectory, facts_of(scenario, trajectory)


def _fly_run(scenario: Scenario, run: int) -> tuple[str, list[Record] | str]:
    """Key of a run in which followers steer by their estimates, and its results for each follower."""
    return _run_key(scenario, run), records_of_run(scenario, run)


def _store_records(store: Store, key: str, records: list[Record]) -> None:
    """A record for each follower, as one row of lists."""
    store.write(key, {"version": code_version()} | columns_of(records))


def _stored_records(store: Store, key: str) -> list[Record] | None:
    row = store.read(key)
    if row is None:
        return None
    columns = {name: values for name, values in row.items() if name != "version"}
    return [dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)]


def _fly_missions(entries: Iterable[Entry], store: Store, pool: Pool, *, quiet: bool) -> dict[str, str]:
    """Fly and store the missions that are missing; what happened to those that cannot be flown, by motion."""
    by_motion = {entry.motion: entry.scenario for entry in entries if not entry.closed_loop}
    wanted = [
        scenario
        for motion, scenario in by_motion.items()
        if _stored_records(store, _facts_key(motion)) is None or not (store.flights / f"{motion}.npz").is_file()
    ]
    failed = {}
    with progress("missions", len(wanted), quiet=quiet) as advance:
        for scenario, trajectory, found in pool.each(_fly, ((scenario,) for scenario in wanted)):
            motion = missions.motion_key(scenario)
            if trajectory is None or isinstance(found, str):
                failed[motion] = str(found)
            else:
                missions.store(store.flights, scenario, trajectory)
                _store_records(store, _facts_key(motion), found)
            advance()
    return failed


def _fly_runs(entries: Iterable[Entry], runs: int, store: Store, pool: Pool, *, quiet: bool) -> dict[str, str]:
    """Fly and store the missing runs of closed loops; what happened to those that diverged, by key."""
    wanted = {
        _run_key(entry.scenario, run): (entry.scenario, run)
        for entry in entries
        if entry.closed_loop
        for run in range(runs)
    }
    missing = [given for key, given in wanted.items() if store.read(key) is None]
    failed = {}
    with progress("runs", len(missing), quiet=quiet) as advance:
        for key, found in pool.each(_fly_run, missing):
            if isinstance(found, str):
                failed[key] = found
            else:
                _store_records(store, key, found)
            advance()
    return failed


def _of_runs(entry: Entry, follower: int, runs: int, store: Store) -> tuple[Record, Record]:
    """Row and lists over runs of a follower of a closed loop."""
    stored = [_stored_records(store, _run_key(entry.scenario, run)) for run in range(runs)]
    lists = columns_of([records[follower] for records in stored if records])
    row: Record = {"variant": entry.scenario.navigation.variant, "seed": entry.scenario.seed, "runs": runs}
    for name, values in lists.items():
        whole = np.array(values, dtype=np.float64)
        if name.endswith(("_max_m", "_max_deg")):
            row[name] = float(whole.max())
        elif name == "closest_approach_m":
            row[name] = float(whole.min())
        elif "_rms_" in name:
            row[name] = float(np.sqrt(np.mean(whole**2)))
        elif name not in ("run", "captured", "gated"):
            row[name] = float(whole.mean())
    row |= {"captured_runs": int(np.sum(lists["captured"])), "fixes_gated": int(np.sum(lists["gated"]))}
    row["worst_run"] = int(lists["run"][int(np.argmax(lists["e_p_max_m"]))])
    return row, lists


def _of_cell(plan: CellPlan, entry: Entry, store: Store) -> tuple[Record, Record]:
    """Row and lists over runs of a follower whose mission all runs share."""
    row, facts = store.read(plan.key), _stored_records(store, _facts_key(entry.motion))
    if row is None or facts is None:
        raise CampaignError(f"{store.folder}: cell {plan.key} vanished while it was computed")
    return row | facts[plan.follower], store.read_runs(plan.key)


def _labels(plan: Plan, entry: Entry, follower: int) -> Record:
    point = plan.points[entry.point]
    drawn = {draw.key: entry.settings[draw.key] for draw in plan.study.draws}
    name = entry.scenario.followers[follower].name
    return {"point": entry.point, **point, "arm": entry.arm, "sea": entry.sea, "follower": name, **drawn}


def _compile_ahead(entry: Entry, plan: CellPlan) -> None:
    """Compile here what each process would else compile for itself."""
    if entry.closed_loop:
        two = min(2 * entry.scenario.timing.message_interval_s, entry.scenario.duration_s)
        with compiling_shown():
            fly(entry.scenario.model_copy(update={"duration_s": two}))
    else:
        compile_ahead(plan)


def fly_study(
    plan: Plan,
    folder: Path,
    *,
    workers: int | None = None,
    cluster: str | None = None,
    force: bool = False,
    quiet: bool = False,
) -> Outcomes:
    """Fly a study, or what is missing of it.

    Args:
        plan: of the study.
        folder: of the results; made if it is not there.
        workers: local processes; None: one for each core.
        cluster: address of a Dask scheduler (tcp://…); its workers fly instead.
        force: compute everything again.
        quiet: show no progress.

    Returns:
        Rows in the order of the plan: the same whatever the workers and interruptions.

    Raises:
        LaisnError: the folder is of another version, the cluster cannot be used, or an estimate diverged.
        CampaignError: a process died or the sources changed; what was computed is stored.
    """
    runs, entries = plan.study.runs, plan.entries
    store = Store(folder, force=force)
    if cluster is None and not quiet:
        _compile_ahead(entries[0], plans_of(entries[0], runs)[0])
    with Pool(len(os.sched_getaffinity(0)) if workers is None else workers, cluster) as pool:
        failed = _fly_missions(entries, store, pool, quiet=quiet)
        failed |= _fly_runs(entries, runs, store, pool, quiet=quiet)
        flown = [e for e in entries if not e.closed_loop and e.motion not in failed]
        missing = missing_cells((cell for entry in flown for cell in plans_of(entry, runs)), store)
        compute_cells(missing, store, pool, quiet=quiet)
    outcomes = Outcomes(rows=[], runs=[])
    for entry in entries:
        keys = [_run_key(entry.scenario, run) for run in range(runs)] if entry.closed_loop else [entry.motion]
        what = next((failed[key] for key in keys if key in failed), None)
        if what is not None:
            outcomes.failures.setdefault(what, []).append(entry)
            continue
        for cell in plans_of(entry, runs):
            found = _of_runs(entry, cell.follower, runs, store) if entry.closed_loop else _of_cell(cell, entry, store)
            measured = {name: value for name, value in found[0].items() if name not in ("key", "version", "motion")}
            labels = _labels(plan, entry, cell.follower)
            outcomes.rows.append(labels | measured)
            outcomes.runs.append((labels, found[1]))
    return outcomes


def table_columns(rows: list[Record]) -> dict[str, list[Any]]:
    """Rows as columns of one type each: where a factor's values are of several, they stand as text."""
    columns = columns_of(rows)
    for name, values in columns.items():
        kinds = {"number" if isinstance(v, int | float) and not isinstance(v, bool) else type(v).__name__
                 for v in values if v is not None}  # fmt: skip
        if len(kinds) > 1:
            columns[name] = [None if v is None else str(v) for v in values]
    return columns


def run_columns(runs: list[tuple[Record, Record]]) -> dict[str, list[Any]]:
    """Lists over runs as columns with a row for each run."""
    rows = [
        labels | dict(zip(lists, values, strict=True))
        for labels, lists in runs
        for values in zip(*lists.values(), strict=True)
    ]
    return table_columns(rows)
