"""Study files: what a user asks, as TOML, read and checked key by key."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, product
from os.path import relpath
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Discriminator, Field, Tag, ValidationError
from scipy import stats

from experiments.flight.library import name_of, names
from experiments.intervals import FEWEST_RUNS
from experiments.study.design import Design, Draw, Factor, follows_run, known
from laisn.failure import LaisnError
from sim.scenario.file import dotted, is_model_key, plain_values, read
from sim.scenario.section import Section
from sim.scenario.settings import Name
from sim.scenario.validation_errors import key_of
from sim.scenario.vehicles import is_mjcf
from sim.screen import plain, screenful, shortened

FOLDER = Path(__file__).parents[1] / "studies"
"""Studies that ship."""
OWN_DESIGN = ("asymmetry", "estimators", "formation", "reproduce")
"""Studies that ship whose design no file can hold; each has a command of its own."""
METRIC = "e_p_mean_m"
_OF_ARM = ("name", "title", "every")
"""Keys of an arm that are none of the scenario."""
Made = TypeVar("Made")


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
    half_width: Annotated[float, Field(gt=0)] = Field(..., description="of its 95 % interval, at every place")
    most: Annotated[int, Field(ge=1, le=1_000_000)] = Field(10_000, description="runs of each place at most")


class Runs(Section):
    """Runs in batches, until intervals are narrow enough."""

    batch: Annotated[int, Field(ge=FEWEST_RUNS, le=1_000_000)] = 60
    until: Until


class StudyFile(Section):
    """The top level of a study file."""

    name: Name | None = None
    question: str = Field("", max_length=2000)
    scenario: Annotated[str, Field(min_length=1)]
    runs: Annotated[
        Annotated[int, Field(ge=1, le=1_000_000), Tag("")] | Annotated[Runs, Tag("table")],
        Discriminator(lambda given: "table" if isinstance(given, Mapping | Runs) else ""),
    ] = 60
    realizations: Annotated[int, Field(ge=1, le=100_000)] = 1
    seed: Annotated[int, Field(ge=0, lt=2**62)] | None = None
    design: Design = "factorial"
    points: Annotated[int, Field(ge=2, le=65536)] | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    vary: dict[str, Any] = Field(default_factory=dict)
    draw: dict[str, Any] = Field(default_factory=dict)
    arm: list[dict[str, Any]] = Field(default_factory=list)
    report: Report = Report()


@dataclass(frozen=True, kw_only=True)
class Study:
    """A study as its file gives it; the scenario's keys are validated by `plan_of`."""

    name: str
    source: str
    """The file, or the scenario that options vary, for messages."""
    question: str
    scenario: str
    """Built-in name, or path of a file."""
    runs: int
    """Of noise at each point, arm and realization; with `until` a multiple of `batch`."""
    batch: int
    until: Until | None
    realizations: int
    seed: int | None
    """None: the scenario's."""
    design: Design
    points: int | None
    settings: Mapping[str, Any]
    factors: tuple[Factor, ...]
    draws: tuple[Draw, ...]
    arms: Mapping[str, Mapping[str, Any]]
    """Named settings that are compared on the same noise and realizations."""
    titles: Mapping[str, str]
    """Of the arms, in words."""
    every: Mapping[str, int]
    """Of the arms: one of so many runs is flown."""
    report: Report
    table: Mapping[str, Any]
    """Content of the file, with the options of the command in their places."""


def _names_a_law(table: Mapping[str, Any]) -> bool:
    """Whether a table is a distribution, perhaps one that is misspelled, and no part of a key."""
    ((name, given), *others) = table.items()
    return not others and (known(name) or hasattr(stats, name) or isinstance(given, list))


def _lines_of(error: ValidationError) -> list[str]:
    """A line for each invalid key of the file's own."""
    lines = []
    for found in error.errors(include_url=False, include_context=False):
        location = tuple(part for part in found["loc"] if part not in ("", "table"))
        key = shortened(plain(key_of(location)), 100)
        if found["type"] == "extra_forbidden":
            model = _SECTIONS.get(location[:-1], StudyFile)
            lines.append(f"  {key}: unknown key of a study; known here: {', '.join(model.model_fields)}")
        elif found["type"] == "missing" and location == ("scenario",):
            lines.append(f"  {key}: is missing; a built-in scenario, such as {names()[0]}, or a file beside this one")
        else:
            lines.append(f"  {key}: {found['msg']} (given: {shortened(plain(repr(found['input'])), 80)})")
    return lines


_SECTIONS: dict[tuple[int | str, ...], type[Section]] = {
    ("report",): Report, ("runs",): Runs, ("runs", "until"): Until,
}  # fmt: skip


def _with_files(settings: Mapping[str, Any], rename: Callable[[str], str]) -> dict[str, Any]:
    """Values by dotted key, those of hulls' files, alone or in a list, under another name."""

    def named(value: Any) -> Any:
        if isinstance(value, list):
            return [named(one) for one in value]
        return rename(value) if isinstance(value, str) and not is_mjcf(value) else value

    return {key: named(value) if is_model_key(key) else value for key, value in settings.items()}


def _arm_name_errors(names: Sequence[Any]) -> list[str]:
    """A line for each arm without a name of its own."""
    missing = [i for i, name in enumerate(names) if not isinstance(name, str) or not name.strip()]
    lines = [f"  arm[{i}].name: every arm needs a name of its own" for i in missing]
    repeated = sorted({str(name) for i, name in enumerate(names) if i not in missing and names.count(name) > 1})
    return [*lines, f"  arm: names must differ; repeated: {', '.join(repeated)}"] if repeated else lines


def _clash(one: tuple[str, str], other: tuple[str, str]) -> str:
    """A line if of two pairs of part and key both set a key, or one a table around the key of the other."""
    (where, given), (part, key) = one, other
    if key == given:
        return f"  {key}: stands in {where} and in {part}; remove one"
    inner, outer = (key, given) if key.startswith(f"{given}.") else (given, key)
    if not inner.startswith(f"{outer}."):
        return ""
    text = f"{part} sets {key}, {where} sets {given}; {inner} is part of {outer}, which replaces it: remove one"
    return f"  {key}: {text}"


def _overlaps(study: Study) -> list[str]:
    """A line for each key that two parts of the file set; an arm alone may set a key of [set] anew."""
    parts = {"[set]": study.settings, "[vary]": [f.key for f in study.factors], "[draw]": [d.key for d in study.draws]}
    shared = [(part, key) for part, keys in parts.items() for key in keys]
    every, pairs = [*shared], [*combinations(shared, 2)]
    for arm, settings in study.arms.items():
        own = [(f"arm {arm}", key) for key in settings]
        pairs += [pair for pair in product(shared, own) if pair[0] != ("[set]", pair[1][1])]
        pairs += combinations(own, 2)
        every += own
    owned = [key for key in ("run", "seed", "name") if key in {key for _, key in every}]
    lines = [line for pair in pairs if (line := _clash(*pair))]
    return lines + [f"  {key}: belongs to the study; seeds and runs are numbered by it" for key in owned]


def _is_range(table: Mapping[str, Any]) -> bool:
    """Whether a table is a range of values, perhaps an incomplete one, and no part of a key."""
    return bool({"from", "to", "steps"} & set(table))


def of_table(table: Mapping[str, Any], source: str, name: str, folder: Path = Path()) -> Study:
    """A study from a table of keys, such as options of a command.

    Args:
        table: as of a study file.
        source: for messages.
        name: of the study, if the table has none.
        folder: that a scenario's file stands in.

    Raises:
        StudyError: a line for each error of the file's own keys.
    """
    table = plain_values(table, source)
    try:
        file = StudyFile.model_validate(table)
    except ValidationError as error:
        raise refusal(source, _lines_of(error)) from None
    lines: list[str] = []

    def made(part: str, given: Mapping[str, Any], make: Callable[[str, Any], Made]) -> tuple[Made, ...]:
        """Factors or draws of a part of the file; an invalid one is left out, with a line."""
        found = []
        for key, value in given.items():
            try:
                found.append(make(key, value))
            except ValueError as error:
                lines.append(f"  {part}.{key}: {error}")
        return tuple(found)

    def settings_of(given: Mapping[str, Any]) -> dict[str, Any]:
        return _with_files(given, lambda name: str(folder / name))

    lines += _arm_name_errors([arm.get("name") for arm in file.arm])
    arms = {str(arm.get("name", "")): arm for arm in file.arm}
    every = {name: arm.get("every", 1) for name, arm in arms.items()}
    lines += [
        f"  arm {name}: every must be a whole number, 1 or more (given: {number!r:.60})"
        for name, number in every.items()
        if not isinstance(number, int) or number < 1
    ]
    scenario = file.scenario
    if scenario not in names() and not Path(scenario).is_absolute():
        scenario = str(folder / scenario)
    varied, sampled = settings_of(dotted(file.vary, _is_range)), file.design != "factorial"
    until = file.runs.until if isinstance(file.runs, Runs) else None
    runs = file.runs.batch if isinstance(file.runs, Runs) else file.runs
    own = {name: {key: value for key, value in arm.items() if key not in _OF_ARM} for name, arm in arms.items()}
    study = Study(
        name=file.name or name, source=source, question=file.question.strip(), scenario=scenario, runs=runs,
        batch=runs, until=until, realizations=file.realizations, seed=file.seed, design=file.design, points=file.points,
        settings=settings_of(dotted(file.set, follows_run)),
        factors=made("vary", varied, partial(Factor.of, sampled=sampled)),
        draws=made("draw", dotted(file.draw, _names_a_law), Draw.of),
        arms={name: settings_of(dotted(settings, follows_run)) for name, settings in own.items()},
        titles={name: str(arm.get("title", name)) for name, arm in arms.items()}, every=every,
        report=file.report, table=table,
    )  # fmt: skip
    lines += _overlaps(study)
    if study.until and study.realizations > 1:
        text = "the interval over several realizations does not narrow with runs; ask for one realization"
        lines.append(f"  runs.until: {text}")
    if lines:
        raise refusal(source, lines)
    return study


def shipped() -> tuple[str, ...]:
    """Names of the studies that ship."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


def study_of(source: str | Mapping[str, Any], keys: Mapping[str, Any]) -> Study:
    """A study with some of its keys replaced.

    Args:
        source: a study file, one that ships, the table of one, or a scenario that `keys` make a study of.
        keys: of a study file, what to put in their places; of `vary`, `draw` and `set` key by key. None: as it is.

    Raises:
        StudyError: there is no such study, or nothing varies.
    """
    given = {key: value for key, value in keys.items() if value is not None}
    folder, name, source_name = Path(), "study", "study"
    if isinstance(source, Mapping):
        table = dict(source)
    else:
        path, source_name = Path(source), source
        if source in shipped() and not path.exists():
            path = FOLDER / f"{source}.toml"
        shown = shortened(plain(source), 200)
        if source not in names() and not path.exists():
            available = ", ".join((*shipped(), *OWN_DESIGN))
            raise StudyError(f"unknown study '{shown}'; available: {available}, a TOML file, or a scenario with --vary")
        table = {} if source in names() else read(path)
        if "scenario" in table:
            folder, name = path.parent, name_of(path)
        elif given.get("vary") or given.get("draw"):
            table, name = {"scenario": source}, f"study-{name_of(Path(source))}"
        else:
            raise StudyError(f"{shown} is a scenario: say what to --vary, or give a study")
    for part in ("vary", "draw", "set"):
        if isinstance(own := table.get(part, {}), dict) and isinstance(more := given.get(part, {}), dict):
            given[part] = own | more
    return of_table(table | given, source_name, name, folder)


def table_in(study: Study, folder: Path) -> dict[str, Any]:
    """The table of a study file in a folder that asks for the same: other files are named as seen from there."""

    def seen(settings: Mapping[str, Any]) -> dict[str, Any]:
        return _with_files(settings, lambda name: relpath(name, folder))

    hulls = {factor.key: list(factor.values) for factor in study.factors if is_model_key(factor.key)}
    return {
        **study.table,
        "scenario": study.scenario if study.scenario in names() else relpath(study.scenario, folder),
        "set": seen(study.settings),
        "vary": dotted(study.table.get("vary", {}), _is_range) | seen(hulls),
        "arm": [
            {"name": name, "title": study.titles[name], "every": study.every[name], **seen(settings)}
            for name, settings in study.arms.items()
        ],
    }
