"""A study from its file to its folder: `laisn study` and `laisn_sim.study`."""

import shlex
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING, Any, Unpack

import tomli_w

from experiments.campaign.campaign import FEW_MISSIONS, ExecutionOptions
from experiments.campaign.pool import release_workers
from experiments.campaign.progress import compiling_shown
from experiments.campaign.store import CampaignError, columns_of, write_table
from experiments.flight.fly import fly
from experiments.flight.library import text_of
from experiments.study.estimate import Results, main_effects
from experiments.study.extras import arms_left_out, installed
from experiments.study.file import FOLDER, Study, built_in_files, study_of, table_in
from experiments.study.measure import METRICS
from experiments.study.plan import (
    PlanEntry,
    StudyPlan,
    engines_of,
    idle_keys,
    many,
    plan_of,
)
from experiments.study.run import (
    StudyResults,
    fly_further,
    fly_studies,
    fly_until_narrow,
    run_tables,
    with_uniform_types,
)
from laisn.errors import LaisnError, LaisnWarning
from laisn.lanes import LANES
from laisn.plugins import plugin_options, plugins_version
from reports import page as pages
from reports.findings import Finding, Findings, interval_finding, read_findings, record
from reports.tables import Table
from reports.version import code_version
from sim.feasibility import effect_cautions
from sim.scenario.parts import MotionSettings
from sim.system import atomic_write

if TYPE_CHECKING:
    from experiments.study.page import Answer

RESULTS = "results.parquet"
RUNS = "runs.parquet"
RECORD = "results.json"
REPORT = "report.html"
STUDY = "study.toml"
_CELL_BYTES = 2_000  # bytes of a stored cell and its row in the tables
_RUN_BYTES = 80  # bytes that each of its runs adds
# numbers of entries of a mission that are flown for an estimate of the effort: the next one where
# that before took less than _QUICK_S
_TRIAL_ENTRIES = (1, 16, 128)
_QUICK_S = 2.0  # [s]


def _cost(plan: StudyPlan, workers: int) -> tuple[float, float]:
    """Time [s] and bytes of a plan whose entries are all in closed loop, or none of them.

    Some missions are flown, and some entries of each, as the study does it, in a folder that is
    removed.
    """
    closed = plan.entries[0].closed_loop
    missions = dict[Any, list[PlanEntry]]()
    for entry in plan.entries:
        missions.setdefault(entry.design_key if closed else entry.motion_key, []).append(entry)
    sample = [*missions.values()][: (FEW_MISSIONS + 1) * workers]
    firsts = [mission_entries[0] for mission_entries in sample]
    with TemporaryDirectory() as folder:

        def flight_time(entries: list[PlanEntry], runs: int) -> float:
            begin = perf_counter()
            (outcome,) = fly_studies(
                [plan.part(entries, runs)], Path(folder), workers=workers, quiet=True
            )
            if outcome.failures:
                raise CampaignError("; ".join(outcome.failures))
            return perf_counter() - begin

        with compiling_shown():
            flight_time(
                [replace(entry, scenario=entry.scenario.first_messages) for entry in firsts], 1
            )
        runs = -(-workers // len(sample)) if closed else 1
        flights = plan.part(firsts, runs).flights
        entry_time = 0.0  # of a block of runs of an entry, beside its mission [s]
        time = 0.0
        entries_flown = 0
        # all is stored the second time
        missions_time = flight_time(firsts, runs)
        stored_time = flight_time(firsts, runs)
        size = sum(path.stat().st_size for path in Path(folder).glob("store/*")) / flights
        for count in () if closed else _TRIAL_ENTRIES:
            entries = [entry for mission_entries in sample for entry in mission_entries[:count]]
            if len(entries) > entries_flown and time < _QUICK_S:
                time = flight_time(entries, max(2, min(plan.study.runs, LANES)))
                entry_time = (time - stored_time) / (len(entries) - entries_flown)
                entries_flown = len(entries)
    blocks = -(-plan.study.runs // LANES)
    seconds = plan.flights * max((missions_time - stored_time) / flights - entry_time, 0.0) + len(
        plan.entries
    ) * blocks * max(entry_time, 0.0)
    return seconds, plan.flights * size


def effort_text(study: Study, workers: int) -> str:
    """The size of a study, and what it would take if nothing were stored."""
    begin = perf_counter()
    plan = plan_of(study, quiet=False, workers=workers)
    seconds = perf_counter() - begin
    runs = study.runs
    cells = sum(len(entry.scenario.followers) for entry in plan.entries)
    size = float(cells * (_CELL_BYTES + runs * _RUN_BYTES))
    for closed in (False, True):
        entries = [entry for entry in plan.entries if entry.closed_loop == closed]
        if entries:
            time, stored = _cost(plan.part(entries, runs), workers)
            seconds = seconds + time
            size = size + stored
    return (
        f"{study.name}: {many(len(plan.points), 'point')}, {many(len(plan.arms), 'arm')}, "
        f"{many(study.file.realizations, 'realization')}, "
        f"{many(runs, 'run')} of noise{' at first' if study.until else ''}; "
        f"{many(plan.flights, 'flight')}, {many(cells, 'cell')}, {many(plan.cell_runs, 'run')}; "
        f"about {max(seconds, 1):.0f} s and {size / 1e6:.0f} MB, if nothing is stored yet"
    )


def findings_of(plan: StudyPlan, results: Results) -> dict[str, Finding]:
    """The metric of the report at every condition, the arms' differences from the first of them,
    and shares of the variance.
    """
    metric = plan.study.file.report.metric
    first = plan.arms[0]
    findings = dict[str, Finding]()
    differences = results.differences(first, metric)
    for condition in results.rows:
        name = f"{metric}: point {condition.point}, arm {condition.arm}, {condition.follower}"
        meaning = "; ".join(
            [
                METRICS[metric].meaning,
                *(f"{key} = {value}" for key, value in plan.points[condition.point].items()),
            ]
        )
        findings[name] = interval_finding(
            results.estimate(condition, metric), meaning, METRICS[metric].unit
        )
        if condition in differences:
            meaning = f"paired difference: {METRICS[metric].meaning}"
            findings[f"{name}, less {first}"] = interval_finding(
                differences[condition], meaning, METRICS[metric].unit
            )
    for name, share in main_effects(plan, results, metric).items():
        findings[f"share of variance: {name}"] = interval_finding(
            share, f"of the variance of {metric} over all points"
        )
    return findings


def _write_tables(outcomes: StudyResults, folder: Path) -> None:
    """Write the tables of a study, and the file that repeats it."""
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / STUDY) as unfinished:
        unfinished.write_text(
            tomli_w.dumps(table_in(outcomes.plan.study, folder)), encoding="utf-8"
        )
    write_table(folder / RESULTS, with_uniform_types(columns_of(outcomes.rows)))
    write_table(folder / RUNS, run_tables(outcomes.runs))


def _look_at_worst(
    outcomes: StudyResults, folder: Path, *, film: bool, scene: bool
) -> list[pages.Film | pages.Replay]:
    """Fly the worst run of the worst place alone, and show it in 3D or film it, or both; nothing if
    a flight can repeat none.
    """
    from experiments.flight.results import render
    from experiments.study.page import worst_run
    from reports.flight_report import scene_of_flight

    worst = worst_run(outcomes.plan, outcomes.results)
    if worst is None:
        return []
    flight = fly(worst.scenario)[0]
    films = list[pages.Film | pages.Replay]()
    if scene:
        films.append(pages.Replay(scene=scene_of_flight(flight), alternative="The worst run"))
    if film:
        films.append(pages.Film(path=render(flight, folder / "worst.mp4")))
    return films


class WithoutEffect(LaisnWarning):
    """A study sets or varies keys that have no effect."""


class LeftOut(LaisnWarning):
    """An arm of a built-in study is left out, since a package that it needs is not installed."""


@dataclass(frozen=True, kw_only=True)
class _Package:
    """The modules of a built-in study in `experiments/studies`."""

    study: str  # name; empty: it is not built in, and has no modules

    @property
    def name(self) -> str:
        return f"experiments.studies.{self.study.replace('-', '_')}"

    @cached_property
    def findings(self) -> Any:
        """The module `findings`."""
        return import_module(f"{self.name}.findings") if self.study else None

    @property
    def has_page(self) -> bool:
        """Whether it has a page of its own."""
        return (
            bool(self.study)
            and (FOLDER / self.study.replace("-", "_") / pages.TEMPLATE_NAME).is_file()
        )

    @cached_property
    def figures(self) -> Any:
        """The module `figures` of a page of its own."""
        return import_module(f"{self.name}.figures") if self.has_page else None


def _require_film(film: str, package: _Package) -> None:
    """LaisnError if the study has no such film."""
    if not film:
        return
    if package.has_page and not hasattr(package.figures, "film"):
        raise LaisnError(f"--film: the study {package.study} has a page of its own, without films")
    expected = "example" if package.has_page else "worst"
    if film != expected:
        raise LaisnError(f"--film {film}: expected --film {expected}")


def _require_flown(outcomes: Sequence[StudyResults], package: _Package) -> None:
    """CampaignError if something of a built-in study, or all of another, could not be flown."""
    failures = sorted({failure for part_results in outcomes for failure in part_results.failures})
    if failures and (package.study or not outcomes[0].rows):
        raise CampaignError("; ".join(failures))


def _write_record(
    outcomes: Mapping[str, StudyResults], folder: Path, command: str, package: _Package
) -> Findings:
    """Write the findings of a study; returns them as they are read."""
    if package.study:
        modules = f"{package.name}.findings", "experiments.study.run"
        numbers = package.findings.findings_of(outcomes)
        findings = record(package.study, command, modules, numbers)
    else:
        first = next(iter(outcomes.values()))
        study = first.plan.study
        findings = Findings(
            study=study.name,
            command=command
            or shlex.join(["laisn", "study", study.source, *plugin_options(first.plan.text)]),
            modules=("experiments.study.study",),
            version=code_version(),
            findings=findings_of(first.plan, first.results),
        )
    findings.write(folder / RECORD)
    return read_findings(folder / RECORD)


def _warn_of_keys_without_effect(plans: Sequence[StudyPlan]) -> None:
    """Name, once each, the keys that do nothing in missions whose vehicles move as points, or that
    another key turns off in all missions of a study.
    """
    of_points = (
        MotionSettings.of(entry.scenario)
        for plan in plans
        for entry in plan.entries
        if entry.scenario.motion == "kinematic"
    )
    remarks = [line for motion in of_points for line in effect_cautions(motion)]
    for plan in plans:
        remarks += [f"without effect: {key}, as {why}" for key, why in idle_keys(plan).items()]
    for remark in dict.fromkeys(remarks):
        warnings.warn(remark, WithoutEffect, stacklevel=3)


def run_studies(
    studies: Mapping[str, Study],
    folder: Path,
    name: str = "",
    command: str = "",
    *,
    quick: bool = False,
    film: str = "",
    scene: bool = False,
    **options: Unpack[ExecutionOptions],
) -> Mapping[str, StudyResults]:
    """Fly the parts of a study, or what is missing of them; write tables, record and page: same
    outcomes, same bytes. Returns what came out, by part.

    Args:
        studies: by part.
        folder: of the results; tables of several parts are in folders of their names.
        name: of a built-in study, whose package in `experiments/studies` has `findings.py` with
            `findings_of(outcomes: Mapping[str, StudyResults]) -> dict[str, Finding]`, a pure
            function of the outcomes by part, and perhaps `further_runs(outcomes)`, which chooses
            runs that are flown on, as of `fly_further`; and for a page of its own `page.md.j2`,
            with `figures.py` whose `values(findings: Findings, outcomes) -> dict` has what the
            template names, and `tables` that are written too; perhaps `film(values, folder) ->
            Path`.
        command: that repeats it; empty: `laisn study` with the source of the first one.
        quick: a trial run, without further runs.
        film: "worst" films the worst run, "example" is the film of `figures.py`; empty: none.
        scene: the page shows the worst run in 3D, unless the study has a page of its own.
        options: as of `campaign.fly`.

    Raises:
        LaisnError: as of `plan_of` and `fly_until_narrow`; something of a built-in study, or all of
            another, could not be flown; or the study has no such film.
    """
    package = _Package(study=name)
    _require_film(film, package)
    options["plugins"] = plugins_version(refresh=True)
    left_out = arms_left_out(studies) if package.study else {}
    if left_out:
        for title, reason in left_out.items():
            warnings.warn(f"left out: {title}, which {reason}", LeftOut, stacklevel=2)
        studies = installed(studies)
    quiet = options.get("quiet", False)
    workers = options.get("workers")
    plans = [plan_of(study, quiet=quiet, workers=workers) for study in studies.values()]
    _warn_of_keys_without_effect(plans)
    results = fly_until_narrow(plans, folder, **options)
    _require_flown(results, package)
    outcomes = dict(zip(studies, results, strict=True))
    if hasattr(package.findings, "further_runs") and not quick:
        fly_further(outcomes, package.findings.further_runs, folder, **options)
    release_workers()
    for study_part, part_results in outcomes.items():
        _write_tables(part_results, folder / study_part if len(outcomes) > 1 else folder)
    findings = _write_record(outcomes, folder, command, package)
    if package.has_page:
        remarks = [f"{title}, which {reason}" for title, reason in left_out.items()]
        _write_own_page(
            outcomes, folder, findings, package, remarks=remarks, quick=quick, film=film
        )
    else:
        _write_page(results[0], folder, film=bool(film), scene=scene)
    return outcomes


def _write_page(outcomes: StudyResults, folder: Path, *, film: bool, scene: bool) -> None:
    """Write the page of a study, first without its worst run, so that one that fails costs nothing
    else.
    """
    # drawing takes a third of a second to import, and reading a table needs none of it
    from experiments.study.page import page_of

    def write(films: list[pages.Film | pages.Replay]) -> None:
        page = page_of(outcomes.plan, outcomes.results, outcomes.failures, films)
        pages.write(page, folder / REPORT)

    write([])
    if film or scene:
        write(_look_at_worst(outcomes, folder, film=film, scene=scene))


def _write_own_page(
    outcomes: Mapping[str, StudyResults],
    folder: Path,
    findings: Findings,
    package: _Package,
    *,
    remarks: Sequence[str],
    quick: bool,
    film: str,
) -> None:
    """Write the page that a built-in study has of its own, and its further tables."""
    values = {"quick": quick, "found": findings, **package.figures.values(findings, outcomes)}
    for table, columns in values.pop("tables", {}).items():
        write_table(folder / f"{table}.parquet", columns)
    runs = dict.fromkeys(f"{part_results.plan.study.runs:,}" for part_results in outcomes.values())
    engines = dict.fromkeys(
        engine for part_results in outcomes.values() for engine in engines_of(part_results.plan)
    )
    facts = [
        ("runs", ", ".join(runs)),
        ("engine", ", ".join(engines)),
        ("version", findings.version),
        ("repeat it", findings.command),
        *(("left out", remark) for remark in remarks),
    ]

    def write(films: list[pages.Film]) -> None:
        page = pages.page_of(package.name, facts, values | {"film": films}, findings)
        pages.write(page, folder / REPORT)

    write([])
    if film:
        write([pages.Film(path=package.figures.film(values, folder))])


class StudyFolder:
    """What a study left in its folder: `results.parquet`, `runs.parquet`, `results.json` and
    `report.html`.
    """

    def __init__(
        self, folder: str | Path, outcomes: Mapping[str, StudyResults] | None = None
    ) -> None:
        """Take a folder that `laisn study` wrote, with what was just flown if it was; LaisnError
        if it has no results.
        """
        self.folder = Path(folder)
        self._outcomes = outcomes or {}
        if not (self.folder / RESULTS).is_file() and not self.parts:
            raise LaisnError(f"{folder}: holds no results of a study ({RESULTS})")

    @cached_property
    def parts(self) -> Mapping[str, "StudyFolder"]:
        """The parts of a built-in study of several files, which have tables of their own; else
        none.
        """
        if (self.folder / RESULTS).is_file() or not (self.folder / RECORD).is_file():
            return {}
        return {
            path.parent.name: StudyFolder(path.parent)
            for path in sorted(self.folder.glob(f"*/{RESULTS}"))
        }

    def answers(self) -> list["Answer"]:
        """The answer of each part that was just flown, as a small table."""
        from experiments.study.page import answer

        return [answer(outcome.plan, outcome.results) for outcome in self._outcomes.values()]

    def report(self) -> Path:
        """The page of the study."""
        return self.folder / REPORT

    def _table(self, name: str) -> Table:
        first = next(iter(self.parts.values())).folder if self.parts else self.folder
        return Table.read(first / name)

    @cached_property
    def table(self) -> Table:
        """A row for each point, arm, realization and follower (`results.parquet`); with parts,
        of the first.
        """
        return self._table(RESULTS)

    @cached_property
    def runs(self) -> Table:
        """A row for each run of these (`runs.parquet`)."""
        return self._table(RUNS)

    @property
    def findings(self) -> Mapping[str, Finding]:
        """The metric of the report at every point with its interval, the differences of arms and
        shares of the variance; of a built-in study what its own modules find (`results.json`).
        """
        return read_findings(self.folder / RECORD).findings

    def plot(self, x: str, y: str = "e_p_mean_m") -> Any:
        """A Plotly figure of a column over a numeric factor: a line for each arm, the mean of
        all else.
        """
        from experiments.study.charts import arms_over

        return arms_over(self.table, x, y)

    def __repr__(self) -> str:
        return f"<StudyFolder in {self.folder}: {len(self.table)} rows, {len(self.runs)} runs>"

    def _repr_html_(self) -> str:
        report = escape(str(self.report()), quote=True)
        return f'<p><a href="{report}">{report}</a></p>{self.table._repr_html_()}'


def studies_of(
    source: str | Path | Mapping[str, Any], keys: Mapping[str, Any], *, quick: bool = False
) -> tuple[dict[str, Study], str]:
    """The studies of a source by part, several of some built-in ones, and its name if it has
    findings of its own.

    Arguments and errors as of `study_of`.
    """
    if isinstance(source, Mapping):
        return {"study": study_of(source, keys, quick=quick)}, ""
    name = "" if Path(source).exists() else str(source)
    files = built_in_files(name)
    if files:
        return {
            study_part: study_of(str(file), keys, quick=quick) for study_part, file in files.items()
        }, name
    return {"study": study_of(str(source), keys, quick=quick)}, ""


def run(
    source: str | Path | Mapping[str, Any],
    keys: Mapping[str, Any],
    out: str | Path | None = None,
    *,
    quick: bool = False,
    **options: Any,
) -> StudyFolder:
    """Run any study and give its results; arguments and errors as of `laisn_sim.study` and
    `run_studies`.
    """
    studies, built_in_name = studies_of(source, keys, quick=quick)
    name = built_in_name or next(iter(studies.values())).name
    folder = Path(out or Path("out") / (f"{name}-quick" if quick else name))
    command = _command(built_in_name, keys, quick=quick) if built_in_name else ""
    outcomes = run_studies(studies, folder, built_in_name, command, quick=quick, **options)
    return StudyFolder(folder, outcomes)


def _command(name: str, keys: Mapping[str, Any], *, quick: bool) -> str:
    """The command of a built-in study with some of its keys replaced."""
    words = ["laisn", name]
    if quick:
        words.append("--quick")
    for key, value in keys.items():
        if isinstance(value, Mapping):
            texts = [f"{k}={text_of(v)}" for k, v in value.items()]
        else:
            texts = [] if value is None else [str(value)]
        for text in texts:
            words += [f"--{key}", text]
    return shlex.join(words)
