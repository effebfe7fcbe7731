"""The plan of a study: every scenario that it flies, all of them valid before the first is
flown.
"""

import difflib
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from itertools import product
from typing import Any, NamedTuple

from experiments.campaign.plans import disturbance_of
from experiments.campaign.pool import Pool
from experiments.campaign.progress import progress
from experiments.campaign.store import key_of
from experiments.flight.library import missing_extras, table_of, text_of
from experiments.study.design import follows_run, is_number, is_rule, points_of, value_at
from experiments.study.file import ARM as ARM
from experiments.study.file import CASE, ONLY_ARM, SCENARIO, Study, refusal
from experiments.study.measure import METRICS, MISSION_METRICS, RUN_METRICS
from laisn.errors import LaisnError, LaisnWarning
from laisn.lanes import LANES
from laisn.navigators import find
from sim.feasibility import engine_errors, idle_reason, infeasibilities
from sim.scenario.file import ScenarioError, assigned, scenario_or_errors, validate
from sim.scenario.parts import MotionSettings
from sim.scenario.section import Section
from sim.scenario.settings import Scenario
from sim.vehicle.solvers import Engine

FOLLOWER = "follower"
MAX_ENTRIES = 200_000
_READINGS = re.compile(r"(acoustics|sensors)\.(?!custom|own)")
"""Keys that change what sensors read, but neither motion nor feasibility."""
_PROGRESS_FROM = 1000  # least number of scenarios whose planning shows progress
_PARALLEL_FROM = 2000  # least number of scenarios that several processes plan
_BATCH = 200  # scenarios that a process plans before it reports: half a second
MAX_RUNS = 2**31 - LANES


@dataclass(frozen=True, kw_only=True)
class PlanEntry:
    """One scenario of a study: a point of its design, an arm, a realization."""

    point: int  # index into `StudyPlan.points`
    arm: str
    realization: int
    settings: Mapping[str, Any]  # all that differs from the study's scenario, by key
    scenario: Scenario  # of its first run
    motion_key: str  # key of the motion of its mission, which others may share
    source: str  # the scenario that the settings change
    # as of `CellPlan`: columns of the mission's facts by the keys that take their values
    measured: Mapping[str, str] = field(default_factory=dict)

    @property
    def design_key(self) -> tuple[int, str, int]:
        """Point, arm and realization, which are no other entry's."""
        return self.point, self.arm, self.realization

    @cached_property
    def closed_loop(self) -> bool:
        """Whether each of its runs is another mission."""
        return bool(self.scenario.keys_needing_closed_loop()) or any(
            map(follows_run, self.settings.values())
        )

    def settings_at(self, run: int) -> dict[str, Any]:
        """The settings with the values that a run has."""
        return {key: value_at(value, run) for key, value in self.settings.items() if key != "run"}

    def scenario_at(self, run: int, measured: Mapping[str, Any] | None = None) -> Scenario:
        """The scenario of a run, with values of `measured` keys; ScenarioError if it is invalid
        with the values that this run has.
        """
        changed = {
            key: value_at(value, run) for key, value in self.settings.items() if follows_run(value)
        }
        changed |= measured or {}
        if not changed:
            return self.scenario.model_copy(update={"run": run})
        table = assigned(self.scenario.model_dump(mode="json"), changed | {"run": run})
        return validate(table, f"arm {self.arm}, run {run}")


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """All that a study flies."""

    study: Study
    points: list[dict[str, Any]]  # values of the factors by key
    arms: tuple[str, ...]
    entries: list[PlanEntry]

    @cached_property
    def by_design_key(self) -> dict[tuple[int, str, int], PlanEntry]:
        """Entries by their `design_key`."""
        return {entry.design_key: entry for entry in self.entries}

    @cached_property
    def followers(self) -> tuple[str, ...]:
        """Names of the followers; those of the first entry, which has as many as any."""
        return max((tuple(f.name for f in e.scenario.followers) for e in self.entries), key=len)

    @property
    def text(self) -> str:
        """All that names classes of plugins: the study file, and its scenarios."""
        scenarios = {entry.source: entry.scenario for entry in self.entries}.values()
        return "\n".join([repr(self.study.table), *(s.model_dump_json() for s in scenarios)])

    @property
    def cell_runs(self) -> int:
        """Runs of all followers; of arms in closed loop that fly every Nth one, these alone."""
        return sum(
            len(entry.scenario.followers)
            * (len(self.runs_of(entry)) if entry.closed_loop else self.study.runs)
            for entry in self.entries
        )

    @property
    def flights(self) -> int:
        """Missions to fly: each once for all entries that share it, each run of a closed loop."""
        shared = {entry.motion_key for entry in self.entries if not entry.closed_loop}
        return len(shared) + sum(
            len(self.runs_of(entry)) for entry in self.entries if entry.closed_loop
        )

    def runs_of(self, entry: PlanEntry) -> range:
        """Numbers of an entry's runs in closed loop."""
        first = entry.scenario.run
        return range(first, first + self.study.runs, self.study.arm(entry.arm).every)

    def part(self, entries: Sequence[PlanEntry], runs: int) -> "StudyPlan":
        """The plan of some of the entries with another number of runs."""
        return replace(self, study=replace(self.study, runs=runs), entries=[*entries])


def engines_of(plan: StudyPlan) -> list[str]:
    """Solvers of the motion of a plan's missions, by their names in scenarios."""
    physics = {e.scenario.timing.engine for e in plan.entries if e.scenario.motion == "physics"}
    engines: list[str] = sorted(physics)
    if any(entry.scenario.motion != "physics" for entry in plan.entries):
        engines.append("point motion")
    return engines


def levels(plan: StudyPlan, name: str) -> list[Any]:
    """All values of a factor, of the arms or of the followers, in their order."""
    if name == ARM:
        return list(plan.arms)
    if name == FOLLOWER:
        return list(plan.followers)
    return list({repr(point[name]): point[name] for point in plan.points}.values())


def varied(plan: StudyPlan) -> list[str]:
    """Factors of more than one value."""
    return [factor.key for factor in plan.study.factors if len(levels(plan, factor.key)) > 1]


def idle_keys(plan: StudyPlan) -> dict[str, str]:
    """Keys that a study sets, varies or draws and that have no effect in any of its missions, with
    what keeps them from it.
    """
    study = plan.study
    groups = [*study.arms.values(), *study.cases.values()]
    keys = [
        *study.settings,
        *(factor.key for factor in study.factors),
        *(draw.key for draw in study.draws),
        *(key for group in groups for key in group.settings),
    ]
    reasons = {}
    for key in dict.fromkeys(keys):
        reason = next((idle_reason(entry.scenario, key) for entry in plan.entries), "")
        if reason and all(idle_reason(entry.scenario, key) for entry in plan.entries):
            reasons[key] = reason
    return reasons


def many(number: int, noun: str) -> str:
    """A number of things in words: 1 arm, 2 arms, 1,200 runs."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _resolved(settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str], list[str]]:
    """Settings with numbers for sums and without variables, columns that keys take, and a line
    for each invalid one.
    """
    resolved = dict(settings)
    columns = dict[str, str]()
    used = set[str]()
    lines = list[str]()
    for key, value in settings.items():
        if is_rule(value, "sum"):
            parts = value["sum"] if isinstance(value["sum"], list) else [value["sum"]]
            numbers = [
                settings.get(summand) if isinstance(summand, str) else summand for summand in parts
            ]
            used.update(summand for summand in parts if isinstance(summand, str))
            if all(map(is_number, numbers)):
                resolved[key] = sum(numbers)
            else:
                text = (
                    "a sum is a list of numbers and of keys that the study sets to numbers "
                    f"(given: {parts!r:.80})"
                )
                lines.append(f"  {key}: {text}")
        elif is_rule(value, "measured"):
            columns[key] = str(resolved.pop(key)["measured"])
            if columns[key] not in MISSION_METRICS:
                lines.append(
                    f"  {key}: unknown column of a mission {columns[key]!r:.60}; known: "
                    f"{', '.join(MISSION_METRICS)}"
                )
    for name in used - Scenario.model_fields.keys():
        if "." not in name:
            resolved.pop(name, None)
    return resolved, columns, lines


def _assigned_or_errors(
    table: Mapping[str, Any], settings: Mapping[str, Any]
) -> tuple[dict[str, Any], list[str]]:
    """A table with the settings of the first run in it, and a line for each that is invalid or
    has no place there.
    """
    try:
        return assigned(table, {key: value_at(value, 0) for key, value in settings.items()}), []
    except ValueError:
        pass
    result = dict(table)
    lines = []
    for key, value in settings.items():
        try:
            result = assigned(result, {key: value_at(value, 0)})
        except ValueError as error:
            lines.append(f"  {error}")
    return result, lines


def _report_errors(study: Study) -> list[str]:
    """A line for each metric and each factor of the report that does not exist."""
    report = study.file.report
    lines = []
    asked = {"report.metric": report.metric} | (
        {"runs.until.metric": study.until.metric} if study.until else {}
    )
    for key, metric in asked.items():
        if metric not in METRICS:
            similar = difflib.get_close_matches(metric, METRICS, n=3, cutoff=0.4)
            guess = " or ".join(similar)
            hint = f"did you mean {guess}?" if similar else f"metrics are {', '.join(METRICS)}"
            lines.append(f"  {key}: unknown metric {metric!r:.60}; {hint}")
    names = [*(factor.key for factor in study.factors), ARM, FOLLOWER]
    for name in ("against", "lines", "panels"):
        requested = getattr(report, name)
        if requested and requested not in names:
            lines.append(
                f"  report.{name}: {requested!r:.60} is not varied; available: {', '.join(names)}"
            )
    return lines


def _arm_errors(study: Study, point: Mapping[str, Any], entry: PlanEntry) -> list[str]:
    """A line for each key of an arm, or of its case, that does not apply to an entry."""
    arm = study.arm(entry.arm)
    disturb = study.disturb_at(point, entry.arm)
    errors = []
    if arm.every > 1 and not entry.closed_loop:
        errors.append("every applies to closed loops; its runs share one mission")
    if (disturb or entry.measured or arm.leader_pitch_deg is not None) and entry.closed_loop:
        errors.append(
            "disturb, leader_pitch_deg and measured apply to missions that runs share, not to "
            "closed loops"
        )
    if not entry.closed_loop:
        errors += [
            f"{key}.assume.known_start = false is for closed loops and for `laisn fly`: errors of "
            "runs that share a mission are counted from the start; expected true"
            for key, navigation in entry.scenario.navigations()
            if not find(navigation.variant).lanes and not navigation.settings().known_start
        ]
    try:
        disturbance_of(disturb)
    except LaisnError as error:
        errors.append(str(error))
    return [f"  arm {entry.arm}: {text}" for text in errors]


class _Place(NamedTuple):
    """Where in the design of a study a scenario is."""

    order: int  # number among all scenarios of the plan
    point_index: int  # into `StudyPlan.points`
    point: Mapping[str, Any]
    arm: str
    realization: int


class _Examined(NamedTuple):
    """What came of a scenario."""

    place: _Place
    entry: PlanEntry | None  # None: it is invalid
    errors: Sequence[str]  # a line for each


class _Examination:
    """Examines the scenarios of a study one after the other; what many have in common is computed
    and kept once.
    """

    def __init__(self, study: Study, tables: Mapping[str, Mapping[str, Any]]) -> None:
        self.study = study
        self.tables = tables  # content of the scenarios' files, by the names of the scenarios
        # by name and settings, without those that neither motion nor feasibility depends on
        self._infeasibilities_of = dict[str, list[str]]()
        self._motion_keys = dict[str, str]()  # keys of motions, likewise
        self._drawn = cache(self._draw)

    def examine(self, place: _Place) -> _Examined:
        """The entry of a scenario, or its errors."""
        point, arm = place.point, place.arm
        name = point.get(SCENARIO, next(iter(self.tables)))
        settings, columns, lines = _resolved(self._settings(name, point, arm, place.realization))
        motion_settings = {
            key: value for key, value in settings.items() if not _READINGS.match(key)
        }
        motion_text = repr((name, list(motion_settings.items())))
        # any number will do to find out whether a key exists that is to be measured
        changed, invalid = _assigned_or_errors(
            self.tables[name], settings | dict.fromkeys(columns, 1.0)
        )
        scenario, errors = scenario_or_errors(changed, partial(self._infeasibilities, motion_text))
        lines += invalid + errors
        if scenario is None or lines:
            return _Examined(place, None, lines)
        motion = MotionSettings.of(scenario)
        engine = self._engine(motion, changed, settings)
        if engine != scenario.timing.engine:
            settings["timing.engine"] = engine
            timing = scenario.timing.model_copy(update={"engine": engine})
            scenario = scenario.model_copy(update={"timing": timing})
            motion = MotionSettings.of(scenario)
        lines = engine_errors(motion)
        if lines:
            return _Examined(place, None, lines)
        if motion_text not in self._motion_keys:
            self._motion_keys[motion_text] = key_of(motion)
        run = scenario.run + place.point_index * self.study.file.runs_apart
        entry = PlanEntry(
            point=place.point_index,
            arm=arm,
            realization=place.realization,
            settings=settings,
            source=self.study.scenarios[name],
            scenario=scenario.model_copy(update={"run": run}),
            motion_key=self._motion_keys[motion_text],
            measured=columns,
        )
        return _Examined(place, entry, _arm_errors(self.study, point, entry))

    def _engine(
        self, motion: MotionSettings, table: Mapping[str, Any], settings: Mapping[str, Any]
    ) -> Engine:
        """The solver that moves a scenario of a table: that of the study's settings, of `engine`,
        or of the scenario's file; where none names one, each hull's own equations of motion if they
        hold for all hulls.
        """
        if motion.kind != "physics" or "timing.engine" in settings or "timing" in settings:
            return motion.engine
        engine = self.study.file.engine
        if engine is not None:
            return engine
        if "engine" in table.get("timing", {}):
            return motion.engine
        return "mujoco" if engine_errors(replace(motion, engine="direct")) else "direct"

    def _settings(
        self, name: str, point: Mapping[str, Any], arm: str, realization: int
    ) -> dict[str, Any]:
        """All that a scenario changes; later parts override earlier ones."""
        file = self.study.file
        first_seed = file.seed
        if first_seed is None:
            seed = self.tables[name].get("seed")
            first_seed = seed if isinstance(seed, int) else 1
        settings = {
            **self.study.settings,
            **self.study.case_at(point).settings,
            **self.study.arm(arm).settings,
            **{key: value for key, value in point.items() if key not in (SCENARIO, CASE)},
            **self._drawn(first_seed, realization),
        }
        if file.realizations > 1 or file.seed is not None:
            settings["seed"] = first_seed + realization
        return settings

    def _draw(self, first_seed: int, realization: int) -> Mapping[str, Any]:
        return {draw.key: draw.value(first_seed, realization) for draw in self.study.draws}

    def _infeasibilities(self, motion_text: str, scenario: Scenario) -> list[str]:
        """Found once for all scenarios that move and are filmed alike, of the same text of name and
        settings.
        """
        if motion_text not in self._infeasibilities_of:
            lines = [*missing_extras(scenario.navigations()), *infeasibilities(scenario)]
            self._infeasibilities_of[motion_text] = lines
        return self._infeasibilities_of[motion_text]


class _Sections:
    """Sections of scenarios, each kept once: ten thousand scenarios differ in few, and share all
    others in memory.
    """

    def __init__(self) -> None:
        self._kept = dict[tuple[str, Section], Section]()

    def shared(self, outcome: _Examined) -> _Examined:
        """What came of a scenario, with sections that others have, too."""
        entry = outcome.entry
        if entry is None:
            return outcome
        sections = {
            name: self._kept.setdefault((name, value), value)
            for name, value in dict(entry.scenario).items()
            if isinstance(value, Section) and not getattr(value, "custom", None)
        }
        scenario = entry.scenario.model_copy(update=sections)
        return outcome._replace(entry=replace(entry, scenario=scenario))


def _examined_batch(
    study: Study, tables: Mapping[str, Mapping[str, Any]], batch: Sequence[_Place]
) -> tuple[list[_Examined], list[str]]:
    """What came of some scenarios, and the warnings that it gave; of a process beside others."""
    examination = _Examination(study, tables)
    sections = _Sections()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        examined = [examination.examine(place) for place in batch]
    # what entries share travels once
    return [*map(sections.shared, examined)], [str(warning.message) for warning in caught]


def _examined(
    study: Study,
    tables: Mapping[str, Mapping[str, Any]],
    places: Sequence[_Place],
    workers: int | None,
    advance: Callable[[int], None],
) -> Iterator[_Examined]:
    """What came of scenarios, in any order; of many, `workers` processes examine the most."""
    # scenarios that move alike, which have most in common, are neighbours
    ordered = sorted(places, key=lambda place: (place.realization, place.order))
    # this process compiles with the first ones what all need
    alone = _BATCH if workers != 1 and len(ordered) >= _PARALLEL_FROM else len(ordered)
    examination = _Examination(study, tables)
    for place in ordered[:alone]:
        yield examination.examine(place)
        advance(1)
    if alone == len(ordered):
        return
    batches = [ordered[i : i + _BATCH] for i in range(alone, len(ordered), _BATCH)]
    with Pool(workers) as pool:
        for examined, texts in pool.each(
            _examined_batch, ((study, tables, batch) for batch in batches)
        ):
            for text in texts:
                warnings.warn(text, LaisnWarning, stacklevel=2)
            yield from examined
            advance(len(examined))


def _where(study: Study, place: _Place) -> str:
    """Where in the design a scenario is, in words."""
    parts = [f"{key} = {text_of(value)}" for key, value in place.point.items()]
    if study.arms:
        parts.append(f"arm {place.arm}")
    if study.file.realizations > 1:
        parts.append(f"realization {place.realization}")
    return ", ".join(parts)


def _error_lines(study: Study, examined: Sequence[_Examined]) -> list[str]:
    """A line for each error, and where it is unless all scenarios have it."""
    places_of = dict[str, list[_Place]]()  # with this error, in order
    for outcome in examined:
        for line in outcome.errors:
            places_of.setdefault(line, []).append(outcome.place)
    lines = []
    for line, places in places_of.items():
        where = ""
        if len(places) < len(examined):
            where = (
                f"; in {len(places)} of {len(examined)} scenarios, first at "
                f"{_where(study, places[0])}"
            )
        lines.append(line + where)
    return lines


def plan_of(study: Study, *, quiet: bool = True, workers: int | None = 1) -> StudyPlan:
    """Plan a study; StudyError has a line for each error of report, design and scenarios, and
    where it is.

    `workers` processes plan many scenarios, one for each core if None; the plan does not depend on
    it.
    """
    lines = _report_errors(study)
    realizations = range(study.file.realizations)
    entries_per_point = max(len(study.arms), 1) * len(realizations)
    try:
        points = points_of(
            study.factors,
            study.file.design,
            study.file.points,
            study.file.seed or 0,
            MAX_ENTRIES // entries_per_point,
        )
    except ValueError as error:
        lines.append(f"  design: {error}")
    try:
        tables = {name: table_of(source) for name, source in study.scenarios.items()}
    except ScenarioError as error:
        lines.append(f"  scenario: {error}")
    if lines:
        raise refusal(study.source, lines)
    places = [
        _Place(0, index, point, arm, realization)
        for index, point in enumerate(points)
        for arm, realization in product(study.arms_at(point), realizations)
    ]
    places = [place._replace(order=order) for order, place in enumerate(places)]
    total = len(places)
    sections = _Sections()
    with progress("scenarios", total, quiet=quiet or total < _PROGRESS_FROM) as advance:
        examined = [
            sections.shared(outcome)
            for outcome in _examined(study, tables, places, workers, advance)
        ]
    examined.sort(key=lambda outcome: outcome.place.order)
    entries = [outcome.entry for outcome in examined if outcome.entry]
    errors = _number_errors(study, entries) + _error_lines(study, examined)
    if errors:
        raise refusal(study.source, errors)
    arms = tuple(study.arms or [ONLY_ARM])
    return StudyPlan(study=study, points=points, arms=arms, entries=entries)


def _number_errors(study: Study, entries: Sequence[PlanEntry]) -> list[str]:
    """A line if realizations would all be equal, one if runs have no metric by which they are
    enough, and one if there are more than can be numbered.
    """
    errors = []
    has_irregular_waves = any(entry.scenario.ocean.waves.kind == "jonswap" for entry in entries)
    if study.file.realizations > 1 and entries and not study.draws and not has_irregular_waves:
        text = (
            "equal realizations: nothing is drawn in [draw], and there are no irregular waves; "
            "set more runs instead"
        )
        errors.append(f"  realizations: {text}")
    is_open = any(not entry.closed_loop for entry in entries)
    if study.until and is_open and study.until.metric not in RUN_METRICS:
        errors.append(
            f"  runs.until.metric: {study.until.metric!r} is not a metric of single runs; these "
            f"are {', '.join(RUN_METRICS)}"
        )
    runs = study.until.most if study.until else study.runs
    last = max((entry.scenario.run for entry in entries), default=0) + runs
    if last > MAX_RUNS:
        errors.append(f"  runs, runs_apart: the last run is number {last:,}, at most {MAX_RUNS:,}")
    return errors
