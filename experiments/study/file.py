"""Study files: the settings of a study as TOML, read and checked key by key."""

import difflib
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import combinations
from os.path import relpath
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self, TypeVar

from pydantic import ConfigDict, Discriminator, Field, Tag, ValidationError, model_validator

from experiments.flight.library import name_of, scenario_names
from experiments.study.design import LAWS, Design, Draw, Factor, is_rule
from laisn.errors import LaisnError, printable, screenful, shortened
from reports.intervals import FEWEST_RUNS
from sim.scenario.file import dotted, is_file_key, key_of, plain_values, read
from sim.scenario.section import Section
from sim.scenario.settings import Name
from sim.scenario.vehicles import is_mjcf

FOLDER = Path(__file__).parents[1] / "studies"
METRIC = "e_p_mean_m"
ARM = "arm"
CASE = "case"
SCENARIO = "scenario"
"""Names of what varies beside the keys of scenarios: arms, and factors of named settings and of
several scenarios.
"""
ONLY_ARM = "all"  # name of the only arm of a study that names none
Made = TypeVar("Made")  # a factor or a draw
Named = TypeVar("Named", bound="Group")  # an arm or a case


class StudyError(LaisnError):
    """A study that cannot be flown; the text has a line for each error."""


def refusal(source: str, lines: list[str]) -> StudyError:
    """An error that lists all errors, as many as a screen holds."""
    head = f"{source}: {len(lines)} error{'s' if len(lines) != 1 else ''}"
    return StudyError("\n".join(screenful([head, *lines])))


class Report(Section):
    """What the page shows; what is left open is chosen by the factors."""

    metric: str = Field(METRIC, description="a column of results.parquet")
    against: str = Field("", description="the factor along the x axis")
    lines: str = Field("", description="a line for each value of this factor, or each arm")
    panels: str = Field("", description="a panel for each value of this factor, or each arm")


class Until(Section):
    """When runs are enough."""

    metric: str = Field(METRIC, description="a metric of single runs")
    half_width: Annotated[float, Field(gt=0)] = Field(
        ..., description="of its 95 % interval, at every place"
    )
    most: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        10_000, description="runs of each place at most"
    )


class Runs(Section):
    """Runs in batches, until intervals are narrow enough."""

    batch: Annotated[int, Field(ge=FEWEST_RUNS, le=1_000_000)] = 60
    until: Until

    @model_validator(mode="after")
    def _one_batch(self) -> Self:
        if self.until.most < self.batch:
            raise ValueError(f"until.most = {self.until.most} is below batch = {self.batch}")
        return self


class Group(Section):
    """Settings with a name; all other keys are those of the scenario."""

    model_config = ConfigDict(extra="allow")

    name: str = Field("", description="its own; checked with the names of the others")
    title: str = Field("", description="in words")
    disturb: dict[str, Any] = Field(
        {}, description="`use`, a class that adds errors of one's own, and its arguments"
    )

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of the scenario."""
        return self.model_extra or {}

    @property
    def options(self) -> dict[str, Any]:
        """All other keys."""
        return self.model_dump(exclude=set(self.settings), exclude_none=True)


class Arm(Group):
    """Settings that are compared with others on the same noise and the same realizations."""

    every: Annotated[int, Field(ge=1)] = Field(
        1, description="only every Nth run is flown, N being this number; closed loops only"
    )
    leader_pitch_deg: Annotated[float, Field(ge=-90, le=90)] | None = Field(
        None, description="ranges and messages of a leader that keeps this pitch on the same track"
    )


class Case(Group):
    """Settings that belong together: a level of the factor "case"."""

    arms: list[str] = Field([], description="the arms that it has; default: all")
    labels: dict[str, str | int | float] = Field(
        {}, description="further columns of its results, by name"
    )
    steps: bool = Field(False, description="keep errors over time of this case alone")


class StudyFile(Section):
    """The top level of a study file."""

    name: Name | None = None
    question: str = Field("", max_length=2000)
    # tags name the branch in error locations; `_lines_of` leaves them out
    scenario: Annotated[
        Annotated[str, Field(min_length=1), Tag("")]
        | Annotated[list[str], Field(min_length=1), Tag("list")],
        Discriminator(lambda given: "list" if isinstance(given, list) else ""),
    ]
    runs: Annotated[
        Annotated[int, Field(ge=1, le=1_000_000), Tag("")] | Annotated[Runs, Tag("table")],
        Discriminator(lambda given: "table" if isinstance(given, Mapping | Runs) else ""),
    ] = 60
    runs_apart: Annotated[int, Field(ge=0, le=1_000_000)] = 0
    """How far apart the numbers of the runs of two points are: 0 where all points share their
    noise.
    """
    realizations: Annotated[int, Field(ge=1, le=100_000)] = 1
    seed: Annotated[int, Field(ge=0, lt=2**62)] | None = None
    """None: the scenario's."""
    design: Design = "factorial"
    points: Annotated[int, Field(ge=2, le=65536)] | None = None  # of a sampled design
    set: dict[str, Any] = Field(default_factory=dict)
    case: list[Case] = Field(default_factory=list)
    vary: dict[str, Any] = Field(default_factory=dict)
    draw: dict[str, Any] = Field(default_factory=dict)
    arm: list[Arm] = Field(default_factory=list)
    steps: bool = False  # keep errors over time
    engine: Literal["direct", "mujoco"] | None = None
    """Solver of the vehicles' motion, in place of the scenario's `timing.engine`; None: the
    scenario's if its file names one, else "direct" where all hulls allow it.
    """
    bound_lag_s: Annotated[float, Field(ge=0, le=1e4)] = 0.0
    """By how much later [s] messages may be that the bound of smoothing uses; 0: that bound is not
    computed.
    """
    report: Report = Report()

    @property
    def batch(self) -> int:
        """Runs of each place before the first look at intervals, and without `until` all of
        them.
        """
        return self.runs.batch if isinstance(self.runs, Runs) else self.runs


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study as its file gives it; the scenario's keys are validated by `plan_of`."""

    name: str
    source: str  # the file, or the scenario that options vary, for messages
    file: StudyFile
    # built-in names, or paths of files, by the names that the study gives them
    scenarios: Mapping[str, str]
    runs: int  # of each place
    settings: Mapping[str, Any]  # [set]: keys of the scenario, alike in all places
    factors: tuple[Factor, ...]
    draws: tuple[Draw, ...]
    cases: Mapping[str, Case]
    arms: Mapping[str, Arm]
    table: Mapping[str, Any]  # content of the file, with the options of the command in their places

    @property
    def until(self) -> Until | None:
        """When the runs are enough; None: their number is given."""
        return self.file.runs.until if isinstance(self.file.runs, Runs) else None

    def arm(self, name: str) -> Arm:
        """An arm by its name, or the only one of a study without."""
        return self.arms.get(name, Arm(name=name))

    def case_at(self, point: Mapping[str, Any]) -> Case:
        """The case of a point, by its values; an empty one of a study without."""
        return self.cases.get(point.get(CASE, ""), Case())

    def arms_at(self, point: Mapping[str, Any]) -> tuple[str, ...]:
        """The arms that a point has, by its values."""
        return tuple(self.case_at(point).arms or self.arms or [ONLY_ARM])

    def disturb_at(self, point: Mapping[str, Any], arm: str) -> Mapping[str, Any]:
        """The errors beside the scenario's that an arm, or else its case, adds at a point."""
        return self.arm(arm).disturb or self.case_at(point).disturb

    def title(self, kind: str, name: str) -> str:
        """Name of an arm or a case in words."""
        return (self.case_at({CASE: name}) if kind == CASE else self.arm(name)).title or name


def _names_a_law(table: Mapping[str, Any]) -> bool:
    """Whether a table is a distribution, perhaps a misspelled one, rather than a part of a dotted
    key.
    """
    ((name, arguments), *others) = table.items()
    if others:
        return False
    if name in LAWS or isinstance(arguments, list):
        return True
    # a second to import
    from scipy import stats

    return hasattr(stats, name)


_OTHER_WORDS = {"factor": "vary", "factors": "vary", "sweep": "vary", "random": "draw"}
"""Keys of a study by other words for them."""


def _did_you_mean(name: str, names: list[str]) -> str:
    """The key that an unknown one may have meant, as a question; empty if none is close."""
    if _OTHER_WORDS.get(name) in names:
        return f"did you mean {_OTHER_WORDS[name]!r}? "
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}? " if close else ""


def _none_of(kind: str, name: object, available: Sequence[str]) -> str:
    """That there is no arm, case or scenario of a name, and which there are."""
    hint = _did_you_mean(str(name), [*available])
    names = shortened(", ".join(available), 300) or "none"
    return f"there is no {kind} {name!r:.60}; {hint}available: {names}"


def _lines_of(error: ValidationError) -> list[str]:
    """A line for each invalid key of the file's own."""
    lines = []
    for detail in error.errors(include_url=False, include_context=False):
        location = tuple(name for name in detail["loc"] if name not in ("", "table", "list"))
        key = shortened(printable(key_of(location)), 100)
        if detail["type"] == "extra_forbidden":
            model = _SECTIONS.get(location[:-1], StudyFile)
            hint = _did_you_mean(str(location[-1]), [*model.model_fields])
            lines.append(
                f"  {key}: unknown key of a study; {hint}known here: "
                f"{', '.join(model.model_fields)}"
            )
        elif detail["type"] == "missing" and location == ("scenario",):
            lines.append(
                f"  {key}: is missing; a built-in scenario, such as {scenario_names()[0]}, or a "
                "file beside this one"
            )
        else:
            given = shortened(printable(repr(detail["input"])), 80)
            lines.append(f"  {key}: {detail['msg']} (given: {given})")
    return lines


# tables of a study file by where they stand in it
_SECTIONS: dict[tuple[int | str, ...], type[Section]] = {
    ("report",): Report,
    ("runs",): Runs,
    ("runs", "until"): Until,
}


def _with_renamed_files(
    settings: Mapping[str, Any], rename: Callable[[str], str]
) -> dict[str, Any]:
    """The settings, with `rename` applied to every name of a hull's file, alone or in a list."""

    def renamed(value: Any) -> Any:
        if isinstance(value, list):
            return [renamed(name) for name in value]
        return rename(value) if isinstance(value, str) and not is_mjcf(value) else value

    return {key: renamed(value) if is_file_key(key) else value for key, value in settings.items()}


class _Setting(NamedTuple):
    """A key that a part of the file sets."""

    kind: str  # "[set]", "[vary]", "[draw]", "case " or "arm "
    group: str  # name of the case or the arm
    key: str

    @property
    def origin_text(self) -> str:
        return self.kind + self.group


def _settings_of(study: Study) -> list[_Setting]:
    """All keys of the scenario that parts of the file set."""
    settings = [_Setting("[set]", "", key) for key in study.settings]
    settings += [_Setting("[vary]", "", factor.key) for factor in study.factors]
    settings += [_Setting("[draw]", "", draw.key) for draw in study.draws]
    for kind, groups in (("case ", study.cases), ("arm ", study.arms)):
        for name, group in groups.items():
            settings += [_Setting(kind, name, key) for key in group.settings]
    return settings


def _overlap(first: _Setting, second: _Setting) -> str | None:
    """The error line of two settings, `second` later in the file, where both set one key or one
    sets a table around the other's key; None if neither.
    """
    if first.kind == second.kind and first.group != second.group:
        return None
    if first.key == second.key:
        if first.kind == "[set]" and second.group:
            return None
        return (
            f"  {first.key}: stands in {first.origin_text} and in {second.origin_text}; remove one"
        )
    outer, inner = sorted((first.key, second.key), key=len)
    if not inner.startswith(f"{outer}."):
        return None
    return (
        f"  {second.key}: {second.origin_text} sets {second.key}, {first.origin_text} sets "
        f"{first.key}; {inner} is part of {outer}, which replaces it: remove one"
    )


def _overlaps(study: Study) -> list[str]:
    """A line for each key that two parts of the file set, or a table around it, and for each that
    belongs to the study; an arm or a case may override [set].
    """
    settings = _settings_of(study)
    overlaps = (_overlap(first, second) for first, second in combinations(settings, 2))
    lines = dict.fromkeys(line for line in overlaps if line is not None)
    reserved = {s.key for s in settings if s.key in ("seed", "name")}
    reserved |= {s.key for s in settings if s.key == "run" and s.kind in ("[draw]", "arm ")}
    return [
        *lines,
        *(
            f"  {key}: belongs to the study; seeds and runs are numbered by it"
            for key in sorted(reserved)
        ),
    ]


def _is_range(table: Mapping[str, Any]) -> bool:
    """Whether a table is a range of values, perhaps an incomplete one, rather than a part of a
    dotted key.
    """
    return bool({"from", "to", "steps"} & set(table))


@dataclass(frozen=True, kw_only=True)
class _FileReader:
    """Makes the parts of a study from those of its file, and collects a line for each error."""

    file: StudyFile
    folder: Path  # of the file, from which it names others
    lines: list[str] = field(default_factory=list)

    def settings(self, table: Mapping[str, Any]) -> dict[str, Any]:
        """Keys of the scenario, files of hulls named as seen from here."""
        return _with_renamed_files(table, lambda name: str(self.folder / name))

    def groups(self, section: str, groups: Sequence[Named]) -> dict[str, Named]:
        """Arms or cases by their names, their settings by dotted keys."""
        for i, group in enumerate(groups):
            if not group.name.strip():
                self.lines.append(f"  {section}[{i}].name: needs a name")
        names = Counter(group.name for group in groups if group.name.strip())
        repeated = sorted(name for name, count in names.items() if count > 1)
        if repeated:
            self.lines.append(f"  {section}: names must differ; repeated: {', '.join(repeated)}")
        return {
            group.name: type(group)(
                **group.options, **self.settings(dotted(group.settings, is_rule))
            )
            for group in groups
        }

    def require_arms(self, arms: Mapping[str, Arm]) -> None:
        """A line for each arm that a case names and the file does not have."""
        for case in self.file.case:
            self.lines.extend(
                f"  case {case.name}: {_none_of('arm', name, [*arms])}"
                for name in case.arms
                if name not in arms
            )

    def levels(self, key: str, selection: Any, available: Sequence[str]) -> list[str]:
        """The cases or scenarios that [vary] chooses of those of the file; None: all."""
        if selection is None:
            return list(available)
        names = selection if isinstance(selection, list) else [selection]
        # in a study of several files, one that has no cases ignores a vary.case given for all
        if available or key == SCENARIO:
            self.lines.extend(
                f"  vary.{key}: {_none_of(key, name, available)}"
                for name in names
                if name not in available
            )
        return [name for name in names if name in available]

    def valid_parts(
        self, section: str, table: Mapping[str, Any], make: Callable[[str, Any], Made]
    ) -> tuple[Made, ...]:
        """Factors or draws of a part of the file; an invalid one is left out, with a line."""
        parts = []
        for key, value in table.items():
            try:
                parts.append(make(key, value))
            except ValueError as error:
                self.lines.append(f"  {section}.{key}: {error}")
        return tuple(parts)

    def scenario(self, name: str) -> str:
        """A built-in scenario, or a file named as seen from here."""
        if name in scenario_names() or Path(name).is_absolute():
            return name
        return str(self.folder / name)


def study_from_table(
    table: Mapping[str, Any], source: str, name: str, folder: Path = Path()
) -> Study:
    """A study from the table of a study file; StudyError has a line for each error of the file's
    own keys.

    `source` is for messages, `name` of the study if the table has none; files are named as seen
    from `folder`.
    """
    table = plain_values(table)
    try:
        file = StudyFile.model_validate(table)
    except ValidationError as error:
        raise refusal(source, _lines_of(error)) from None
    reader = _FileReader(file=file, folder=folder)
    arms = reader.groups("arm", file.arm)
    cases = reader.groups("case", file.case)
    reader.require_arms(arms)
    has_several = not isinstance(file.scenario, str)
    scenarios = list(file.scenario) if has_several else [str(file.scenario)]
    varied = reader.settings(dotted(file.vary, _is_range))
    levels = {
        CASE: reader.levels(CASE, varied.pop(CASE, None), list(cases)),
        SCENARIO: reader.levels(
            SCENARIO, varied.pop(SCENARIO, None), scenarios if has_several else []
        ),
    }
    varied = {key: names for key, names in levels.items() if names} | varied
    study = Study(
        name=file.name or name,
        source=source,
        file=file,
        scenarios={scenario: reader.scenario(scenario) for scenario in scenarios},
        runs=file.batch,
        settings=reader.settings(dotted(file.set, is_rule)),
        factors=reader.valid_parts(
            "vary", varied, partial(Factor.of, sampled=file.design != "factorial")
        ),
        draws=reader.valid_parts("draw", dotted(file.draw, _names_a_law), Draw.of),
        cases={name: cases[name] for name in levels[CASE]},
        arms=arms,
        table=table,
    )
    lines = reader.lines + _overlaps(study)
    if study.until and study.file.realizations > 1:
        text = (
            "the interval over several realizations does not narrow with runs; use one realization"
        )
        lines.append(f"  runs.until: {text}")
    if lines:
        raise refusal(source, lines)
    return study


def built_in_files(name: str) -> dict[str, Path]:
    """The files of a built-in study with findings of its own, by their names without "study-"; none
    of other names.

    Its folder has `findings.py`, and `study.toml` or several `study-PART.toml`.
    """
    folder = FOLDER / name.replace("-", "_")
    files = sorted(folder.glob("study*.toml")) if re.fullmatch(r"[a-z-]+", name) else []
    return {
        file.stem.removeprefix("study-"): file
        for file in files
        if (folder / "findings.py").is_file()
    }


def shipped() -> tuple[str, ...]:
    """Names of the built-in studies: of files, and of folders with findings and a page of their
    own.
    """
    folders = [path.parent.name.replace("_", "-") for path in FOLDER.glob("*/findings.py")]
    return tuple(
        sorted([*(path.stem for path in FOLDER.glob("*.toml")), *filter(built_in_files, folders)])
    )


class _Source(NamedTuple):
    """Where a study comes from."""

    table: dict[str, Any]
    name: str = "study"  # of a study whose table has none
    title: str = "study"  # in messages
    folder: Path = Path()  # from which its files are named


def _source_of(source: str, *, varies: bool) -> _Source:
    """The source of a study file, of one that ships, or of a scenario that options vary."""
    path = Path(source)
    if source in shipped() and not path.exists():
        path = next(iter(built_in_files(source).values()), FOLDER / f"{source}.toml")
    quoted = shortened(printable(source), 200)
    if source not in scenario_names() and not path.exists():
        available = f"available: {', '.join(shipped())}, a TOML file, or a scenario with --vary"
        raise StudyError(f"unknown study '{quoted}'; {available}")
    table = {} if source in scenario_names() else read(path)
    if "scenario" in table:
        return _Source(table, name_of(path), source, path.parent)
    if {"vary", "draw", "arm", "case", "runs"} & set(table):
        raise StudyError(
            f"{quoted}: a study needs scenario = the name of a built-in one, such as "
            f"{scenario_names()[0]!r}, or of a file beside this one"
        )
    if not varies:
        raise StudyError(f"{quoted} is a scenario: give --vary, or a study")
    return _Source({"scenario": source}, f"study-{name_of(Path(source))}", source)


def _replaced(table: Mapping[str, Any], keys: Mapping[str, Any]) -> dict[str, Any]:
    """A table with some of its keys replaced; those of `vary`, `draw` and `set` one by one."""
    result = {**table, **keys}
    for section in ("vary", "draw", "set"):
        if isinstance(table.get(section), dict) and isinstance(keys.get(section), dict):
            result[section] = table[section] | keys[section]
    return result


def study_of(
    source: str | Mapping[str, Any], keys: Mapping[str, Any], *, quick: bool = False
) -> Study:
    """A study with some of its keys replaced.

    `source` is a study file, one that ships, the table of one, or a scenario that `keys` make a
    study of. `keys` of a study file replace its own, those of `vary`, `draw` and `set` key by key;
    `quick` does so with the file's own [quick]. StudyError: it is unknown, or has errors.
    """
    keys = {key: value for key, value in keys.items() if value is not None}
    if isinstance(source, Mapping):
        origin = _Source(dict(source))
    else:
        varies = any(keys.get(section) for section in ("vary", "draw", "arm"))
        origin = _source_of(source, varies=varies)
    table = origin.table
    quick_keys = table.pop("quick", {})
    if quick:
        if not quick_keys or not isinstance(quick_keys, dict):
            raise StudyError(
                f"{origin.title}: --quick: the study has no [quick], keys of its trial run; see "
                "also --runs"
            )
        table = _replaced(table, quick_keys)
    return study_from_table(_replaced(table, keys), origin.title, origin.name, origin.folder)


def table_in(study: Study, folder: Path) -> dict[str, Any]:
    """The table of an equivalent study file in a folder; other files are named as seen from
    there.
    """

    def relative_to_folder(settings: Mapping[str, Any]) -> dict[str, Any]:
        return _with_renamed_files(settings, lambda name: relpath(name, folder))

    hulls = {factor.key: list(factor.values) for factor in study.factors if is_file_key(factor.key)}
    scenarios = [
        scenario if scenario in scenario_names() else relpath(scenario, folder)
        for scenario in study.scenarios.values()
    ]
    return {
        **study.table,
        "scenario": scenarios if isinstance(study.table["scenario"], list) else scenarios[0],
        "set": relative_to_folder(study.settings),
        "vary": dotted(study.table.get("vary", {}), _is_range) | relative_to_folder(hulls),
        "case": [case.options | relative_to_folder(case.settings) for case in study.cases.values()],
        "arm": [arm.options | relative_to_folder(arm.settings) for arm in study.arms.values()],
    }
