"""Scenario files: TOML in and out, overrides, and errors as lines that name key, expectation and
value.
"""

import difflib
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import to_json

import models
from laisn.failure import ROWS, LaisnError, plain, screenful, shortened
from sim.scenario.settings import KEYS_ALONE, Scenario
from sim.scenario.vehicles import is_mjcf
from sim.system import read_text

Location = tuple[int | str, ...]  # path of a key, such as ("followers", 0, "depth_m")


def key_of(location: Location) -> str:
    """The path as it is printed: `followers[0].depth_m`."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        elif text:
            text += f".{part}"
        else:
            text = str(part)
    return text or "scenario"


def _keys(location: Location) -> list[str]:
    """All keys of the table that a key path ends in."""
    model: type[BaseModel] = Scenario
    for part in location:
        if isinstance(part, str):
            field = model.model_fields.get(part)
            kinds = (field.annotation, *get_args(field.annotation)) if field else ()
            tables = [
                kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)
            ]
            if not tables:
                return []
            model = tables[0]
    return list(model.model_fields)


def _unknown(location: Location) -> str:
    known = _keys(location[:-1])
    close = difflib.get_close_matches(shortened(str(location[-1]), 80), known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(known)}"
    return f"  {shortened(plain(key_of(location)), 100)}: unknown key; {hint}"


def _line(error: Mapping[str, Any]) -> str:
    if error["type"] == "extra_forbidden":
        return _unknown(error["loc"])
    key = shortened(plain(key_of(error["loc"])), 100)
    message = error["msg"].removeprefix("Value error, ")
    given = error["input"]
    if isinstance(given, dict | BaseModel) or error["type"] == "missing":
        return f"  {key}: {message}"
    shown = shortened(repr(given) if not isinstance(given, list | str) else repr(given[:80]), 80)
    return f"  {key}: {message} (given: {plain(shown)})"


def lines_of(error: ValidationError) -> list[str]:
    """A line for each error of a validation; empty ones beyond what a screen holds."""
    errors = error.errors(include_url=False, include_context=False)
    parents = {one["loc"][:n] for one in errors for n in range(len(one["loc"]))}
    # pydantic leaves an invalid item out of its list, which may then seem too short
    errors = [one for one in errors if one["type"] != "too_short" or one["loc"] not in parents]
    lines = [_line(error) for error in errors[:ROWS]]
    return lines + [""] * len(errors[ROWS:])


# of a scenario file: four routes of the most points that a route may have
LARGEST_BYTES = 16_000_000
# of a list, within a dotted key: it has one form, 0 and not 00
_INDEX = re.compile("0|[1-9][0-9]{0,8}")


class ScenarioError(LaisnError):
    """A scenario that is invalid or not feasible; the text names source, key, value and
    expectation of every error.
    """


def plain_values(table: Any) -> Any:
    """A copy of a table or value that JSON can hold: numbers and arrays of NumPy as Python's, other
    objects as text.

    So is an integer that no float can hold.
    """

    def plain_value(value: Any) -> Any:
        if isinstance(value, range):
            return list(value)
        return value.tolist() if hasattr(value, "tolist") else str(value)

    def integer(digits: str) -> int | str:
        return int(digits) if len(digits) < 308 else f"an integer of {len(digits)} digits"

    return json.loads(
        to_json(table, fallback=plain_value, inf_nan_mode="constants"), parse_int=integer
    )


def is_model_key(key: str) -> bool:
    """Whether a dotted key of a scenario is that of a hull."""
    return re.fullmatch(r"(leader|followers\.(\d+|\*)|formation\.shape)\.model", key) is not None


def beside(model: Any, folder: Path) -> Any:
    """The name of a hull's file as seen from here, for one that is named as seen from a folder."""
    named = isinstance(model, str) and not is_mjcf(model) and model not in models.VEHICLES
    return str(folder / model) if named else model


def seen_from(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table of a scenario file in a folder; changed in place: the hulls that it names lie
    beside the file.
    """
    followers = table.get("followers")
    formation = table.get("formation")
    shape = formation.get("shape") if isinstance(formation, dict) else None
    vehicles = [table.get("leader"), shape]
    if isinstance(followers, list):
        vehicles += followers
    for vehicle in vehicles:
        if isinstance(vehicle, dict) and "model" in vehicle:
            vehicle["model"] = beside(vehicle["model"], folder)
    return table


def examined(
    table: dict[str, Any], further: Callable[[Scenario], Iterable[str]] = lambda _: ()
) -> tuple[Scenario | None, list[str]]:
    """The scenario, None if a key is invalid, and a line for each error; arguments as of
    `validate`.
    """
    try:
        scenario = Scenario.model_validate_json(to_json(table), context=KEYS_ALONE)
    except ValidationError as error:
        return None, lines_of(error)
    return scenario, [f"  {text}" for text in (*scenario.inconsistencies(), *further(scenario))]


def validate(
    table: Mapping[str, Any],
    source: str,
    further: Callable[[Scenario], Iterable[str]] = lambda _: (),
) -> Scenario:
    """A scenario from a table of keys; ScenarioError with a line for every error, as many as a
    screen holds.

    `source` is the name of the file, for messages; `further` lists more errors of a scenario whose
    keys are valid, as `sim.feasibility` does.
    """
    scenario, lines = examined(plain_values(table), further)
    if lines or scenario is None:
        head = f"{source}: {len(lines)} error{'s' if len(lines) != 1 else ''}"
        raise ScenarioError("\n".join(screenful([head, *lines])))
    return scenario


def parse(text: str, source: str) -> dict[str, Any]:
    """The table in a TOML text, as JSON can hold it; ScenarioError names line and column of a
    syntax error.
    """
    try:
        return plain_values(tomllib.loads(text))  # type: ignore[no-any-return]
    except ValueError as error:
        raise ScenarioError(f"{source}: not valid TOML: {shortened(plain(error), 300)}") from error


def read(path: Path) -> dict[str, Any]:
    """The table in a TOML file; ScenarioError if it cannot be read, is no plain file or larger
    than any scenario.
    """
    try:
        text = read_text(path, LARGEST_BYTES)
    except LaisnError as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from None
    return parse(text, str(path))


def value_of(text: str) -> Any:
    """A value on the command line: TOML, or text without quotes."""
    try:
        return plain_values(tomllib.loads(f"value = {text}")["value"])
    except tomllib.TOMLDecodeError:
        return text


def _put(table: dict[str, Any], key: str, value: object) -> None:
    """Put a value at a dotted key; ScenarioError if the key leads through something that is no
    table or list.
    """
    place: Any = table
    *parents, last = (int(part) if _INDEX.fullmatch(part) else part for part in key.split("."))
    try:
        for part in parents:
            place = place.setdefault(str(part), {}) if isinstance(place, dict) else place[part]
        place[str(last) if isinstance(place, dict) else last] = value
    except (IndexError, ValueError, TypeError):
        raise ScenarioError(f"{shortened(plain(key), 100)} is no key of this scenario") from None


def dotted(
    table: Mapping[str, Any], is_value: Callable[[Any], bool] = lambda _: False
) -> dict[str, Any]:
    """Values of nested tables and lists of tables by dotted keys; `is_value`: whether a table is
    a value itself.
    """
    found: dict[str, Any] = {}
    for name, value in table.items():
        inner = value
        if isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            inner = {str(i): item for i, item in enumerate(value)}
        if isinstance(inner, Mapping) and inner and not is_value(inner):
            found |= {f"{name}.{key}": one for key, one in dotted(inner, is_value).items()}
        else:
            found[name] = value
    return found


def assigned(table: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of a table with values put at dotted keys, such as `followers.0.depth_m`, or
    `followers.*.depth_m`.
    """
    result: dict[str, Any] = plain_values(table)
    for name, value in settings.items():
        key = str(name).strip()
        followers = result.get("followers", [{}])
        before, every, rest = key.partition("followers.*.")
        if every and not before and isinstance(followers, list):
            for i in range(len(followers)):
                _put(result, f"followers.{i}.{rest}", plain_values(value))
        else:
            _put(result, key, plain_values(value))
    return result


def values_of(assignments: Iterable[str], option: str = "--set") -> dict[str, Any]:
    """Values by dotted key of assignments `key.path=value`, TOML or text without quotes; else
    ScenarioError.
    """
    found = {}
    for text in assignments:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            given = shortened(plain(text), 200)
            raise ScenarioError(
                f"{option} {given}: expected key=value, such as sensors.speed_bias_m_s=0.1"
            )
        found[key.strip()] = value_of(value.strip())
    return found
