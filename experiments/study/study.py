"""A study from its file to its folder: `laisn study` and `laisn_sim.study`."""

from collections.abc import Callable, Mapping
from functools import cached_property
from html import escape
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Unpack

import tomli_w

from experiments.campaign import missions
from experiments.campaign.campaign import BATCH_STEPS, ExecutionOptions, compile_ahead
from experiments.campaign.plans import CellPlan, compute
from experiments.campaign.processes import release_workers
from experiments.campaign.store import CampaignError, Store, columns_of, write_table
from experiments.campaign.version import code_version
from experiments.findings import Finding, Findings, of, read, record
from experiments.flight.fly import fly
from experiments.flight.tables import Table
from experiments.pages import page as pages
from experiments.pages.page import write
from experiments.study.estimate import Results, main_effects
from experiments.study.file import Study, built_in, study_of, table_in
from experiments.study.metrics import METRICS
from experiments.study.plan import Plan, many, plan_of
from experiments.study.run import Outcomes, fly_further, fly_until_narrow, of_one_type, run_tables
from laisn.failure import LaisnError
from laisn.lanes import LANES
from sim.system import atomic_write

RESULTS, RUNS, RECORD, REPORT = "results.parquet", "runs.parquet", "results.json", "report.html"
STUDY = "study.toml"
_CELL_BYTES = 2_000
"""Bytes of a stored cell and its row in the tables; a run adds `_RUN_BYTES`."""
_RUN_BYTES = 80
_TRIED = 17
"""Cells that are computed for an estimate of the time, of which the first is not counted."""

FilmOf = Callable[[Plan, Results, Path], Path | None]
"""Makes the film that is to stand on a study's page, in its folder; None: there is none."""


def effort_text(study: Study, workers: int) -> str:
    """The size of a study, and what it would take if nothing were stored.

    One mission is flown, and cells of it are computed, as a process does it; nothing of it is kept. Planning, storing
    and reading results is work of this process.
    """
    begin = perf_counter()
    plan = plan_of(study, quiet=False)
    seconds, entry, runs = perf_counter() - begin, plan.entries[0], study.runs
    cells = sum(len(e.scenario.followers) for e in plan.entries)
    if entry.closed_loop:
        fly(entry.scenario.first_messages)
        start = perf_counter()
        fly(entry.scenario)
        seconds += plan.flights * (perf_counter() - start) / workers
        size = 4_000 * plan.flights
    else:
        alike = [e for e in plan.entries if e.motion == entry.motion][:_TRIED]
        tried = [CellPlan(scenario=e.scenario, runs=min(runs, LANES)) for e in alike]
        compile_ahead(tried[0])
        start = perf_counter()
        trajectory = missions.simulate_mission(entry.scenario)
        flown = perf_counter()
        one = compute(trajectory, tried[:1])
        first = perf_counter()
        results = compute(trajectory, tried[1:]) or one
        done = perf_counter()
        # what the cells of a mission share is computed once for each batch of them
        each = (done - first) / len(results) if len(tried) > 1 else first - flown
        shared = max(first - flown - each, 0.0)
        batches = max(plan.flights, 4 * workers, cells * runs * entry.scenario.filter_steps / BATCH_STEPS)
        with TemporaryDirectory() as folder:
            store = Store(Path(folder))
            store.put(entry.motion, None, trajectory.arrays)
            stored, kept = store.path(entry.motion).stat().st_size, perf_counter()
            for key, row, arrays in results:
                store.put(key, row, arrays)
                for _ in range(3):  # for its row, its runs and the facts of its mission
                    store.get(key)
            seconds += cells * (perf_counter() - kept) / len(results)
        seconds += (plan.flights * (flown - start) + batches * shared + cells * -(-runs // LANES) * each) / workers
        size = plan.flights * stored + cells * (_CELL_BYTES + runs * _RUN_BYTES)
    return (
        f"{study.name}: {many(len(plan.points), 'point')}, {many(len(plan.arms), 'arm')}, "
        f"{many(study.file.realizations, 'realization')}, "
        f"{many(runs, 'run')} of noise{' at first' if study.until else ''}; "
        f"{many(plan.flights, 'flight')}, {many(cells, 'cell')}, {many(cells * runs, 'run')}; "
        f"about {max(seconds, 1):.0f} s and {size / 1e6:.0f} MB, if nothing is stored yet"
    )


def record_of(plan: Plan, results: Results) -> Findings:
    """The metric of the report at every place, and the arms' differences from the first of them."""
    study, metric = plan.study, plan.study.file.report.metric
    unit, what, first = METRICS[metric].unit, METRICS[metric].what, plan.arms[0]
    found: dict[str, Finding] = {}
    apart = results.differences(first, metric)
    for place in results.rows:
        name = f"{metric}: point {place[0]}, arm {place[1]}, {place[2]}"
        point = ", ".join(f"{key} = {value}" for key, value in plan.points[place[0]].items())
        found[name] = of(results.estimate(place, metric), f"{what}; {point}" if point else what, unit)
        if place in apart:
            found[f"{name}, less {first}"] = of(apart[place], f"paired difference: {what}", unit)
    for name, share in main_effects(plan, results, metric).items():
        found[f"share of variance: {name}"] = of(share, f"of the variance of {metric} over all points")
    command, modules = f"laisn study {study.source}", ("experiments.study.study",)
    return Findings(study=study.name, command=command, modules=modules, version=code_version(), findings=found)


def _write_tables(outcomes: Outcomes, folder: Path) -> None:
    """Write the tables of a study, and the file that repeats it."""
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / STUDY) as part:
        part.write_text(tomli_w.dumps(table_in(outcomes.plan.study, folder)), encoding="utf-8")
    write_table(folder / RESULTS, of_one_type(columns_of(outcomes.rows)))
    write_table(folder / RUNS, run_tables(outcomes.runs))


def run_study(study: Study, folder: Path, *, film: FilmOf | None = None, **options: Unpack[ExecutionOptions]) -> Path:
    """Fly a study, or what is missing of it, and write tables, record and page: the same outcomes give the same bytes.

    Args:
        study: as read from its file.
        folder: of the results.
        film: of the page; None: there is none.
        options: as of `campaign.fly`.

    Returns:
        The page; LaisnError as of `plan_of` and `fly_until_narrow`, or if nothing could be flown.
    """
    (outcomes,) = fly_until_narrow([plan_of(study, quiet=options.get("quiet", False))], folder, **options)
    plan = outcomes.plan
    if not outcomes.rows:
        raise LaisnError("no scenario of the study could be flown: " + "; ".join(outcomes.failures))
    release_workers()
    # drawing takes a third of a second to import, and reading a table needs none of it
    from experiments.study.page import page_of

    filmed = film(plan, outcomes.results, folder) if film else None
    _write_tables(outcomes, folder)
    record_of(plan, outcomes.results).write(folder / RECORD)
    write(page_of(plan, outcomes.results, outcomes.failures, filmed), folder / REPORT)
    return folder / REPORT


def run_built_in(
    name: str,
    folder: Path,
    keys: Mapping[str, Any] | None = None,
    *,
    quick: bool = False,
    film: bool = False,
    **options: Unpack[ExecutionOptions],
) -> Path:
    """Run a built-in study whose folder has findings and a page of its own, or what is missing of it.

    Its folder is a package in `experiments/studies` of study files, which are flown together; `findings.py` with
    `findings_of(outcomes: Mapping[str, Outcomes]) -> dict[str, Finding]`, a pure function of the outcomes by the parts
    of the study, and perhaps `further_runs(outcomes)`, which chooses runs that are flown on, as of `fly_further`; and
    for a page of its own `page.md.j2`, with `figures.py` whose `values(found: Findings, outcomes) -> dict` has what the
    template names and `tables` that are written too, and perhaps `film(values, folder)`. Else the page is that of any
    study.

    Args:
        name: of the study.
        folder: of the results: the tables of each file, `results.json` and `report.html`.
        keys: of study files, as of `study_of`.
        quick: a trial run, without further runs.
        film: make the film of the study.
        options: as of `campaign.fly`.

    Returns:
        The page.

    Raises:
        LaisnError: as of `study_of` and `fly_until_narrow`, something could not be flown, or the study has no film.
    """
    package = f"experiments.studies.{name.replace('-', '_')}"
    if film and not hasattr(import_module(f"{package}.figures"), "film"):
        raise LaisnError(f"--film: the study {name} has a page of its own, without films")
    files = built_in(name)
    given = [study_of(str(file), keys or {}, quick=quick) for file in files.values()]
    quiet = options.get("quiet", False)
    flown = fly_until_narrow([plan_of(study, quiet=quiet) for study in given], folder, **options)
    if failures := {what for one in flown for what in one.failures}:
        raise CampaignError("; ".join(sorted(failures)))
    outcomes = dict(zip(files, flown, strict=True))
    modules = f"{package}.findings", "experiments.study.run"
    findings = import_module(modules[0])
    if hasattr(findings, "further_runs") and not quick:
        fly_further(outcomes, findings.further_runs, folder, **options)
    release_workers()
    for part, one in outcomes.items():
        _write_tables(one, folder / part if len(files) > 1 else folder)
    record(name, f"laisn {name}", modules, findings.findings_of(outcomes)).write(folder / RECORD)
    found = read(folder / RECORD)
    from experiments.study.page import page_of

    if (next(iter(files.values())).parent / pages.NAME).is_file():
        facts = [
            ("runs", ", ".join(dict.fromkeys(f"{one.plan.study.runs:,}" for one in flown))),
            ("version", found.version),
            ("repeat it", f"{found.command}{' --quick' if quick else ''}"),
        ]
        figures = import_module(f"{package}.figures")
        values = {"quick": quick, "found": found, **figures.values(found, outcomes)}
        for table, columns in values.pop("tables", {}).items():
            write_table(folder / f"{table}.parquet", columns)
        page = pages.page_of(package, facts, values, found)
    else:
        page = page_of(flown[0].plan, flown[0].results, {})
    write(page, folder / REPORT)
    if film:
        # the page is there before the film, so that one that fails costs nothing else
        shown = values | {"film": [pages.Film(path=figures.film(values, folder))]}
        write(pages.page_of(package, facts, shown, found), folder / REPORT)
    return folder / REPORT


class StudyFolder:
    """What a study left in its folder: `results.parquet`, `runs.parquet`, `results.json` and `report.html`.

    Attributes:
        folder: of the study.
    """

    def __init__(self, folder: str | Path) -> None:
        """Take a folder that `laisn study` wrote; LaisnError if it has no results."""
        self.folder = Path(folder)
        if not (self.folder / RESULTS).is_file() and not self.parts:
            raise LaisnError(f"{folder}: holds no results of a study ({RESULTS})")

    @cached_property
    def parts(self) -> Mapping[str, "StudyFolder"]:
        """The parts of a built-in study of several files, which have tables of their own; else none."""
        if (self.folder / RESULTS).is_file() or not (self.folder / RECORD).is_file():
            return {}
        return {path.parent.name: StudyFolder(path.parent) for path in sorted(self.folder.glob(f"*/{RESULTS}"))}

    def report(self) -> Path:
        """The page of the study."""
        return self.folder / REPORT

    def _table(self, name: str) -> Table:
        first = next(iter(self.parts.values())).folder if self.parts else self.folder
        return Table.read(first / name)

    @cached_property
    def table(self) -> Table:
        """A row for each point, arm, realization and follower (`results.parquet`); with parts, of the first."""
        return self._table(RESULTS)

    @cached_property
    def runs(self) -> Table:
        """A row for each run of these (`runs.parquet`)."""
        return self._table(RUNS)

    @property
    def findings(self) -> Mapping[str, Finding]:
        """The metric of the report at every point with its interval, and the differences of arms (`results.json`)."""
        return read(self.folder / RECORD).findings

    def plot(self, x: str, y: str = "e_p_mean_m") -> Any:
        """Draw a column over a factor: a line for each arm, the mean of all else.

        Args:
            x: column of a numeric factor, such as "sensors.heading_sigma_deg".
            y: column of a metric.

        Returns:
            A `plotly.graph_objects.Figure`; LaisnError if there is no such column.
        """
        from experiments.study.charts import arms_over

        return arms_over(self.table, x, y)

    def __repr__(self) -> str:
        return f"<StudyFolder in {self.folder}: {len(self.table)} rows, {len(self.runs)} runs>"

    def _repr_html_(self) -> str:
        report = escape(str(self.report()), quote=True)
        return f'<p><a href="{report}">{report}</a></p>{self.table._repr_html_()}'


def parts_of(source: str | Path | Mapping[str, Any]) -> Mapping[str, Path]:
    """The files of a built-in study with findings of its own, as of `built_in`; none of anything else."""
    return {} if isinstance(source, Mapping) or Path(source).exists() else built_in(str(source))


def studies_of(source: str | Path | Mapping[str, Any], keys: Mapping[str, Any], *, quick: bool = False) -> list[Study]:
    """The studies of a source, several of some built-in ones; arguments and errors as of `study_of`."""
    files = [str(path) for path in parts_of(source).values()]
    if files:
        return [study_of(one, keys, quick=quick) for one in files]
    return [study_of(source if isinstance(source, Mapping) else str(source), keys, quick=quick)]


def run(
    source: str | Path | Mapping[str, Any],
    keys: Mapping[str, Any],
    out: str | Path | None,
    *,
    quick: bool = False,
    film: FilmOf | None = None,
    **options: Unpack[ExecutionOptions],
) -> StudyFolder:
    """Run any study and give its results; arguments and errors as of `laisn_sim.study` and `run_study`."""
    (first, *_), parts = studies_of(source, keys, quick=quick), parts_of(source)
    folder = Path(out or Path("out") / f"{source if parts else first.name}{'-quick' * quick}")
    if parts:
        run_built_in(str(source), folder, keys, quick=quick, film=film is not None, **options)
    else:
        run_study(first, folder, film=film, **options)
    return StudyFolder(folder)
