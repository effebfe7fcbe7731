"""Scenario files: TOML in and out, overrides, and errors as lines that name key, expectation and
value.
"""

import difflib
import json
import os
import re
import tomllib
import warnings
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import to_json

import models
from laisn.errors import ROWS, LaisnError, LaisnWarning, printable, screenful, shortened
from sim.scenario.navigation import STORED
from sim.scenario.section import PATTERNS, Because, quoted_bool_hint
from sim.scenario.settings import KEYS_ALONE, Scenario
from sim.scenario.vehicles import is_mjcf
from sim.system import read_text

Location = tuple[int | str, ...]  # path of a key, such as ("followers", 0, "depth_m")


def key_of(location: Location) -> str:
    """The path as it is printed: `followers[0].depth_m`."""
    text = ""
    for name in location:
        if isinstance(name, int):
            text += f"[{name}]"
        elif text:
            text += f".{name}"
        else:
            text = str(name)
    return text or "scenario"


def _field(location: Location) -> FieldInfo | None:
    """The declaration of a key, or of the list that holds a value; None if there is none."""
    model: type[BaseModel] | None = Scenario
    field = None
    for name in location:
        if isinstance(name, int):
            continue
        if model is None or name not in model.model_fields:
            return None
        field = model.model_fields[name]
        model = _table_in(field)
    return field


def _table_in(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a key holds, or a list of tables; None of other keys."""
    kinds = [field.annotation]
    for kind in kinds:
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
        kinds += get_args(kind)
    return None


def _is_list_of_tables(field: FieldInfo | None) -> bool:
    return (
        field is not None and _table_in(field) is not None and get_origin(field.annotation) is tuple
    )


def _keys(location: Location) -> list[str]:
    """All keys of the table that a key path ends in."""
    if not location:
        return list(Scenario.model_fields)
    field = _field(location)
    model = _table_in(field) if field else None
    return list(model.model_fields) if model else []


@cache
def _all_keys() -> dict[str, list[str]]:
    """Dotted keys of a scenario by their last names."""
    keys: dict[str, list[str]] = {}

    def add(model: type[BaseModel], parent: str) -> None:
        for name, field in model.model_fields.items():
            keys.setdefault(name, []).append(f"{parent}{name}")
            table = _table_in(field)
            if table is not None:
                add(table, f"{parent}{name}.{'*.' if _is_list_of_tables(field) else ''}")

    add(Scenario, "")
    return keys


def _hint(location: Location) -> str:
    """What an unknown key may have meant."""
    name = shortened(str(location[-1]), 80)
    names = _keys(location[:-1])
    other_keys = sorted(_all_keys().get(name, []), key=lambda key: key.count("."))
    in_same_section = [key for key in other_keys if key.partition(".")[0] == str(location[0])]
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    closest = difflib.get_close_matches(name, names, n=1, cutoff=0.75)
    if in_same_section or (other_keys and not closest):
        return f"did you mean {' or '.join((in_same_section or other_keys)[:3])}?"
    if close:
        return f"did you mean {close[0]!r}?"
    distant = difflib.get_close_matches(name, _all_keys(), n=1, cutoff=0.8)
    if distant:
        return f"did you mean {_all_keys()[distant[0]][0]}?"
    return f"known here: {', '.join(names)}"


def _expected(error: Mapping[str, Any]) -> str:
    """What a value should have been, in words, where pydantic's message does not help."""
    field = _field(error["loc"])
    kind = error["type"]
    message = str(error["msg"]).removeprefix("Value error, ")
    # what the items of a list hold, where its description begins with that: [[east, north], …]
    form = re.match(r"\[+.*?\](?:, …\])?", field.description or "") if field else None
    is_list = isinstance(error["input"], dict) or (
        _is_list_of_tables(field) and not isinstance(error["loc"][-1], int)
    )
    if kind in ("tuple_type", "list_type") and is_list:
        names = ".".join(str(item) for item in error["loc"] if not isinstance(item, int))
        return f"expected a list of tables: write [[{names}]] with two brackets"
    if kind == "missing" and not isinstance(error["loc"][-1], int):
        return _missing(error["loc"], field)
    if kind in _FORM_ERRORS and form and isinstance(error["loc"][-1], int):
        return f"expected {form[0]}"
    if kind == "model_type":
        return f"expected a table; its keys: {', '.join(_keys(error['loc']))}"
    if kind == "string_pattern_mismatch":
        return _expected_text(error)
    return message


_FORM_ERRORS = ("missing", "too_long", "tuple_type", "list_type")
"""Errors of a value in a list whose description begins with its form."""


def _missing(location: Location, field: FieldInfo | None) -> str:
    """What to write for a key that is required."""
    name = str(location[-1])
    if _is_list_of_tables(field):
        return f"missing: at least one table [[{name}]] is required"
    if field is not None and _table_in(field) is not None:
        return f"missing: a table [{name}] is required"
    return "missing, and required"


def _reason(error: Mapping[str, Any]) -> str:
    """Why the bounds are what they are that a number is beyond; empty if that is not declared."""
    field = _field(error["loc"])
    if field is None or not error["type"].endswith(("_than", "_equal")):
        return ""
    return "".join(f"; {bound.text}" for bound in field.metadata if isinstance(bound, Because))


def _expected_text(error: Mapping[str, Any]) -> str:
    """What a text that does not match a pattern should have been."""
    pattern = str(error["msg"]).partition("'")[2].removesuffix("'")
    words = PATTERNS.get(pattern)
    if words is None:
        return str(error["msg"])
    text = str(error["input"])
    close = difflib.get_close_matches(text, re.findall(r'"([^"]+)"', words), n=1, cutoff=0.6)
    return f"did you mean {close[0]!r}? Expected {words}" if close else f"expected {words}"


def _line(error: Mapping[str, Any]) -> str:
    """The text of an error of pydantic's: key, what is wrong, and the value."""
    key = shortened(printable(key_of(error["loc"])), 100)
    if error["type"] == "extra_forbidden":
        return f"{key}: unknown key; {_hint(error['loc'])}"
    message = _expected(error)
    value = error["input"]
    if isinstance(value, dict | BaseModel) or error["type"] == "missing":
        return f"{key}: {message}"
    text = shortened(repr(value) if not isinstance(value, list | str) else repr(value[:80]), 80)
    hint = quoted_bool_hint(value) if error["type"] == "bool_type" else ""
    return f"{key}: {message} (given: {printable(text)}){_reason(error)}{hint}"


def lines_of(error: ValidationError, where: Callable[[Location], str] = lambda _: "") -> list[str]:
    """A line for each error of a validation; empty ones beyond what a screen holds.

    `where` says in which line of a file a key stands, for the beginning of the line.
    """
    errors = error.errors(include_url=False, include_context=False)
    parents = {detail["loc"][:n] for detail in errors for n in range(len(detail["loc"]))}
    # pydantic leaves an invalid item out of its list, which may then seem too short
    errors = [
        detail for detail in errors if detail["type"] != "too_short" or detail["loc"] not in parents
    ]
    lines = [f"  {where(detail['loc'])}{_line(detail)}" for detail in errors[:ROWS]]
    return lines + [""] * len(errors[ROWS:])


_HEADER = re.compile(r"\s*(\[\[?)\s*([^\[\]]+?)\s*\]\]?\s*(#.*)?$")
_KEY = re.compile(r"\s*([\w.\"'*-]+)\s*=")


def key_lines(text: str) -> dict[Location, int]:
    """Numbers of the lines of a TOML text, from 1, in which tables and keys begin.

    Keys within inline tables are not found; the key before the table is.
    """
    lines: dict[Location, int] = {}
    counts: dict[Location, int] = {}
    table: Location = ()
    for number, line in enumerate(text.splitlines(), start=1):
        header = _HEADER.match(line)
        key = _KEY.match(line)
        if header:
            table = tuple(_parts(header[2]))
            # the last of a list of tables that is above this one
            for n in range(1, len(table)):
                if table[:n] in counts:
                    table = (*table[:n], counts[table[:n]] - 1, *table[n:])
            if header[1] == "[[":
                counts[table] = counts.get(table, 0) + 1
                lines.setdefault(table, number)
                table = (*table, counts[table] - 1)
            lines.setdefault(table, number)
        elif key:
            names = tuple(_parts(key[1]))
            for n in range(1, len(names) + 1):
                lines.setdefault((*table, *names[:n]), number)
    return lines


def _parts(key: str) -> list[str]:
    """Names of a dotted key of TOML, quoted or not."""
    return [name.strip().strip("\"'") for name in key.split(".")]


def line_in(text: str, changed: Iterable[str] = ()) -> Callable[[Location], str]:
    """A function that says in which line of a TOML text a key stands, "line 12: ", and nothing of
    a key that is not there or was `changed` afterwards.
    """
    lines = key_lines(text)
    other = [_changed_location(key) for key in changed]

    def where(location: Location) -> str:
        if any(
            _begins(location, changed_key) or _begins(changed_key, location)
            for changed_key in other
        ):
            return ""
        for n in range(len(location), 0, -1):
            if location[:n] in lines:
                return f"line {lines[location[:n]]}: "
        return ""

    return where


def _changed_location(key: str) -> Location:
    """A dotted key as a location; "*", which is any number, stays."""
    return tuple(int(name) if _INDEX.fullmatch(name) else name for name in key.split("."))


def _begins(location: Location, other: Location) -> bool:
    """Whether a location begins with another, in which "*" is any number."""
    return len(other) <= len(location) and all(
        b in (a, "*") for a, b in zip(location, other, strict=False)
    )


# of a scenario file: four routes of the most points that a route may have
LARGEST_BYTES = 16_000_000
# of a list, within a dotted key: it has one form, 0 and not 00
_INDEX = re.compile("0|[1-9][0-9]{0,8}")


class ScenarioError(LaisnError):
    """A scenario that is invalid or not feasible; the text names source, key, value and
    expectation of every error.
    """


# of tables and lists in one another; the deepest key of a scenario has six
DEEPEST = 20
# of an integer that is read, so that a key's own message can say what it expects
_LARGEST_BITS = 14_000


def _require_bounded(table: object) -> None:
    """ScenarioError naming the key of what lies deeper than `DEEPEST`, of text that is no Unicode,
    and of an integer of thousands of digits.
    """
    unchecked: list[tuple[Location, Any]] = [((), table)]
    while unchecked:
        location, value = unchecked.pop()
        if isinstance(value, str):
            problem = "" if _is_unicode(value) else "this is no Unicode text"
        elif isinstance(value, int):
            digits = int(value.bit_length() * 0.30103) + 1
            huge = value.bit_length() > _LARGEST_BITS
            problem = f"an integer of about {digits} digits; at most 308" if huge else ""
        elif isinstance(value, Mapping | list | tuple):
            problem = f"tables and lists more than {DEEPEST} deep"
            if len(location) < DEEPEST:
                problem = ""
                inner = value.items() if isinstance(value, Mapping) else enumerate(value)
                unchecked += [
                    ((*location, key), member) for key, member in inner if type(member) is not float
                ]
                names = (key for key in value if isinstance(value, Mapping))
                if not all(_is_unicode(str(name)) for name in names):
                    problem = "a key that is no Unicode text"
        else:
            problem = ""
        if problem:
            key = f"{shortened(printable(key_of(location)), 100)}: " if location else ""
            raise ScenarioError(f"{key}{problem}")


def _is_unicode(text: str) -> bool:
    """Whether a text has no halves of surrogate pairs, as bytes that are no UTF-8 become."""
    return text.isascii() or not any("\ud800" <= c <= "\udfff" for c in text)


def plain_values(table: object) -> Any:
    """A copy of a table or value that JSON can hold: numbers and arrays of NumPy as Python's, other
    objects as text.

    ScenarioError as of `_require_bounded`.
    """
    _require_bounded(table)

    def plain_value(value: object) -> Any:
        if isinstance(value, range):
            return list(value)
        return value.tolist() if hasattr(value, "tolist") else str(value)

    def integer(digits: str) -> int | str:
        return int(digits) if len(digits) < 308 else f"an integer of {len(digits)} digits"

    return json.loads(
        to_json(table, fallback=plain_value, inf_nan_mode="constants"), parse_int=integer
    )


def is_file_key(key: str) -> bool:
    """Whether a dotted key of a scenario names a file: of a hull, or of a field of the sea."""
    hulls = r"(leader|followers\.(\d+|\*)|formation\.shape)\.model"
    fields = r"ocean\.(current|floor|sound_speed|density)\.file"
    return re.fullmatch(rf"{hulls}|{fields}", key) is not None


def path_from_folder(value: Any, folder: Path) -> Any:
    """The name of a file as seen from here, for one that is named as seen from a folder; the text
    of a hull, a vehicle of `models.VEHICLES` and what is no text stay as they are.
    """
    is_file = isinstance(value, str) and not is_mjcf(value) and value not in models.VEHICLES
    return str(folder / value) if is_file else value


def with_file_paths(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table of a scenario file in a folder; changed in place: hulls and fields that it names
    lie beside the file.
    """
    followers = table.get("followers")
    formation = table.get("formation")
    shape = formation.get("shape") if isinstance(formation, dict) else None
    # the model of a shape is the hull of all its followers
    vehicles = [table.get("leader"), shape]
    if isinstance(followers, list):
        vehicles += followers
    for vehicle in vehicles:
        if isinstance(vehicle, dict) and "model" in vehicle:
            vehicle["model"] = path_from_folder(vehicle["model"], folder)
    ocean = table.get("ocean")
    for source in ocean.values() if isinstance(ocean, dict) else ():
        if isinstance(source, dict) and "file" in source:
            source["file"] = path_from_folder(source["file"], folder)
    return table


_RENAMED = {
    "sensors.own": "sensors.custom",
    "navigation.own": "navigation.custom",
    "ocean.current.own": "ocean.current.custom",
}
"""Keys by their older names, which are accepted with a note."""


def _note_renamed(old: str) -> None:
    warnings.warn(f"{old} is now called {_RENAMED[old]}", LaisnWarning, stacklevel=3)


def _with_new_names(table: dict[str, Any]) -> dict[str, Any]:
    """A table with what stands at older names of keys at the new ones."""
    for old, new in _RENAMED.items():
        *path, name = old.split(".")
        target: Any = table
        for key in path:
            target = target.get(key) if isinstance(target, dict) else None
        if isinstance(target, dict) and name in target:
            renamed = new.rpartition(".")[2]
            renamed_table = {renamed if k == name else k: value for k, value in target.items()}
            table = plain_values(table)
            _set_value(table, ".".join(path), renamed_table)
            _note_renamed(old)
    return table


def _new_name(key: str) -> str:
    """A dotted key by its new name."""
    for old, new in _RENAMED.items():
        if key == old or key.startswith(f"{old}."):
            _note_renamed(old)
            return f"{new}{key.removeprefix(old)}"
    return key


def scenario_or_errors(
    table: dict[str, Any],
    further: Callable[[Scenario], Iterable[str]] = lambda _: (),
    where: Callable[[Location], str] = lambda _: "",
    *,
    stored: bool = False,
) -> tuple[Scenario | None, list[str]]:
    """The scenario, None if a key is invalid, and a line for each error; arguments as of
    `validate`.
    """
    context = {**KEYS_ALONE, **STORED} if stored else KEYS_ALONE
    try:
        renamed = to_json(_with_new_names(table))
        scenario = Scenario.model_validate_json(renamed, context=context)
    except ValidationError as error:
        return None, lines_of(error, where)
    # what a navigator lacks, several checks may find
    errors = dict.fromkeys((*scenario.inconsistencies(), *further(scenario)))
    return scenario, [f"  {text}" for text in errors]


def validate(
    table: Mapping[str, Any],
    source: str,
    further: Callable[[Scenario], Iterable[str]] = lambda _: (),
    where: Callable[[Location], str] = lambda _: "",
    *,
    stored: bool = False,
) -> Scenario:
    """A scenario from a table of keys; ScenarioError with a line for every error, as many as a
    screen holds.

    `source` is the name of the file, for messages; `further` lists more errors of a scenario whose
    keys are valid, as `sim.feasibility` does; `where` is as of `lines_of`. One that is `stored`
    with a flight may name plugins that are not loaded.
    """
    try:
        values = plain_values(table)
    except ScenarioError as error:
        raise ScenarioError(f"{source}: 1 error\n  {error}") from None
    scenario, lines = scenario_or_errors(values, further, where, stored=stored)
    if lines or scenario is None:
        head = f"{source}: {len(lines)} error{'s' if len(lines) != 1 else ''}"
        raise ScenarioError("\n".join(screenful([head, *lines])))
    return scenario


def _toml(text: str) -> dict[str, Any]:
    """The table in a TOML text; ScenarioError with the reason alone if it is none."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ScenarioError(f"tables and lists more than {DEEPEST} deep") from None
    except ValueError as error:
        reason = str(error).partition("; use sys.")[0]
        number = re.search(r"\d[\d_]{999}", text)
        if number is not None and "\n" in text and not isinstance(error, tomllib.TOMLDecodeError):
            reason += f" (at line {text.count(chr(10), 0, number.start()) + 1})"
        reason += _decimal_hint(text, reason)
        raise ScenarioError(f"not valid TOML: {shortened(printable(reason), 300)}") from error


def _decimal_hint(text: str, reason: str) -> str:
    """What to write where the line that a reason names has a decimal comma."""
    place = re.search(r"line (\d+), column", reason)
    line = text.splitlines()[int(place[1]) - 1 :][:1] if place else []
    number = re.search(r"=\s*([-+]?\d+),(\d+)\s*(#.*)?$", line[0]) if line else None
    return f"; decimals have a point: {number[1]}.{number[2]}" if number else ""


def parse(text: str, source: str) -> dict[str, Any]:
    """The table in a TOML text, as JSON can hold it; ScenarioError names line and column of a
    syntax error.
    """
    try:
        return plain_values(_toml(text))  # type: ignore[no-any-return]
    except ScenarioError as error:
        raise ScenarioError(f"{source}: {error}") from error


def read(path: Path) -> dict[str, Any]:
    """The table in a TOML file; ScenarioError if it cannot be read, is no plain file or larger
    than any scenario.
    """
    try:
        text = read_text(path, LARGEST_BYTES)
    except LaisnError as error:
        of_flight = path / "scenario.toml"
        # false of names that no file can have, too
        is_flight = os.path.isfile(of_flight)
        hint = f"; the scenario of its flight is {of_flight}" if is_flight else ""
        raise ScenarioError(f"{path}: cannot be read: {error}{hint}") from None
    return parse(text, str(path))


def value_of(text: str) -> Any:
    """A value on the command line: TOML, or text without quotes; ScenarioError if it is beyond
    what `plain_values` takes.
    """
    try:
        table = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        table = {}
    except (RecursionError, ValueError):
        table = _toml(f"value = {text}")
    # more than one key: the text goes on in another line
    return plain_values(table["value"] if [*table] == ["value"] else text)


def _parts_of(key: str) -> list[int | str]:
    """Names and list indices of a dotted key."""
    return [int(name) if _INDEX.fullmatch(name) else name for name in key.split(".")]


def _set_value(table: dict[str, Any], key: str, value: object) -> None:
    """Put a value at a dotted key; ScenarioError if the key leads through something that is no
    table or list.
    """
    target: Any = table
    parts = _parts_of(key)
    for n, name in enumerate(parts):
        index = str(name) if isinstance(target, dict) else name
        if isinstance(target, dict):
            target.setdefault(index, {})
        elif not (isinstance(target, list) and isinstance(index, int) and index < len(target)):
            text = f"{shortened(printable(key), 100)} is no key of this scenario"
            raise ScenarioError(f"{text}{_list_hint(target, parts, n)}")
        if n == len(parts) - 1:
            target[index] = value
        else:
            target = target[index]


def _list_hint(target: object, parts: list[int | str], n: int) -> str:
    """What to write for the members of a list, if a key of n parts leads to one."""
    if not isinstance(target, list) or not target:
        return ""
    name = ".".join(map(str, parts[:n]))
    if isinstance(parts[n], int):
        return f"; {name} has {len(target)}, of which the last is {name}.{len(target) - 1}"
    key_in_table = ".".join(map(str, parts[n:]))
    return (
        f"; did you mean {name}.0.{key_in_table} of the first, or {name}.*.{key_in_table} of all?"
    )


def dotted(
    table: Mapping[str, Any], is_value: Callable[[Any], bool] = lambda _: False
) -> dict[str, Any]:
    """Values of nested tables and lists of tables by dotted keys; `is_value`: whether a table is
    a value itself.
    """
    values: dict[str, Any] = {}
    for name, value in table.items():
        inner = value
        if isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            inner = {str(i): item for i, item in enumerate(value)}
        if isinstance(inner, Mapping) and inner and not is_value(inner):
            values |= {f"{name}.{key}": member for key, member in dotted(inner, is_value).items()}
        else:
            values[name] = value
    return values


def _expanded_keys(table: Mapping[str, Any], key: str) -> list[str]:
    """A dotted key with each number in place of "*", of a list that is there."""
    table_key, separator, rest = key.partition(".*.")
    if not separator:
        return [key]
    target: Any = table
    for name in _parts_of(table_key):
        if isinstance(target, list) and isinstance(name, int) and name < len(target):
            target = target[name]
        else:
            target = target.get(str(name)) if isinstance(target, Mapping) else None
    if not isinstance(target, list):
        raise ScenarioError(
            f"{shortened(printable(key), 100)}: the scenario has no list {table_key}"
        )
    numbered_keys = (f"{table_key}.{i}.{rest}" for i in range(len(target)))
    return [expanded for number in numbered_keys for expanded in _expanded_keys(table, number)]


def assigned(table: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a table with values put at dotted keys, such as `followers.0.depth_m`, or
    `followers.*.depth_m` for all; ScenarioError if a key leads through what is no table or list.
    """
    result: dict[str, Any] = _with_new_names(plain_values(table))
    for name, value in settings.items():
        for key in _expanded_keys(result, _new_name(str(name).strip())):
            _set_value(result, key, plain_values(value))
    return result


def values_of(assignments: Iterable[str], option: str = "--set") -> dict[str, Any]:
    """Values by dotted key of assignments `key.path=value`, TOML or text without quotes; else
    ScenarioError.
    """
    values = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            quoted = shortened(printable(text), 200)
            raise ScenarioError(
                f"{option} {quoted}: expected key=value, such as sensors.speed_bias_m_s=0.1"
            )
        try:
            values[key.strip()] = value_of(value.strip())
        except ScenarioError as error:
            raise ScenarioError(f"{option} {shortened(printable(key), 100)}: {error}") from None
    return values
