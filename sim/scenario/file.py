"""Scenario files: TOML in and out, overrides, and messages that say what to mend."""

import copy
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from laisn.failure import LaisnError
from sim.files import read_text
from sim.scenario.settings import KEYS_ALONE, Scenario
from sim.scenario.validation_errors import lines_of
from sim.scenario.vehicles import LONGEST_MODEL
from sim.screen import plain, screenful, shortened

LARGEST_BYTES = 16_000_000
"""Largest scenario file that is read [bytes]: four routes of the most points that a route may have."""
_DEEPEST = 16
"""Most tables within tables; a scenario needs five."""
_ENDLESS = re.compile(r"\d[\d_]{4000,}")
"""What may have more digits than Python reads."""
_WIDEST_BITS = 1024
"""Most bits of an integer; more is beyond every number of a scenario, and costly to write down."""
MODEL = "model"
"""Key of a vehicle's hull: in a file the name of its MJCF, in a `Scenario` its text, which needs no file."""
_MODEL_KEY = re.compile(rf"(leader|followers\.\d+)\.{MODEL}")
_INDEX = re.compile("0|[1-9][0-9]{0,8}")
"""An index of a list within a dotted key."""


class ScenarioError(LaisnError):
    """A scenario that is invalid or not feasible; the text names source, key, value and expectation of every error."""


def _no_checks(scenario: Scenario) -> Iterable[str]:
    return ()


def _json_ready(value: object, depth: int = 0) -> object:
    """TOML has dates and NaN, JSON has not. Both become text that validation refuses with its key.

    Raises:
        RecursionError: tables or lists nest deeper than those of any scenario.
    """
    if depth > _DEEPEST:
        raise RecursionError
    if hasattr(value, "tolist"):
        value = value.tolist()  # numbers and arrays of NumPy
    if isinstance(value, Mapping):
        return {str(key): _json_ready(item, depth + 1) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [_json_ready(item, depth + 1) for item in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return str(value)
    if isinstance(value, int) and value.bit_length() > _WIDEST_BITS:
        return f"an integer of {value.bit_length()} bits"
    if isinstance(value, str):
        # a lone surrogate, which JSON cannot hold, comes from a command line that is no UTF-8
        return value.encode(errors="backslashreplace").decode()
    if isinstance(value, int | float) or value is None:
        return value
    return str(value)


def plain_values(table: Mapping[str, Any], source: str) -> Any:
    """A copy of a table that JSON can hold; ScenarioError if it nests too deep."""
    try:
        return _json_ready(table)
    except RecursionError:
        raise ScenarioError(f"{source}: lists or tables nest more than {_DEEPEST} deep, a scenario's five") from None


def is_mjcf(model: object) -> bool:
    """Whether this is the text of a hull, and not the name of its file."""
    return isinstance(model, str) and model.lstrip().startswith("<")


def is_model_key(key: str) -> bool:
    """Whether a dotted key of a scenario is that of a hull."""
    return _MODEL_KEY.fullmatch(key) is not None


def beside(model: Any, folder: Path) -> Any:
    """The name of a hull's file as seen from here, for one that is named as seen from a folder."""
    return str(folder / model) if isinstance(model, str) and not is_mjcf(model) else model


def _vehicles(table: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The vehicles of a scenario's table that name a hull, with their keys."""
    followers = table.get("followers")
    listed = followers if isinstance(followers, list) else []
    for key, vehicle in [("leader", table.get("leader")), *((f"followers[{i}]", f) for i, f in enumerate(listed))]:
        if isinstance(vehicle, dict) and isinstance(vehicle.get(MODEL), str):
            yield f"{key}.{MODEL}", vehicle


def seen_from(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The table of a scenario file in a folder; changed in place: the hulls that it names lie beside the file."""
    for _, vehicle in _vehicles(table):
        vehicle[MODEL] = beside(vehicle[MODEL], folder)
    return table


def embed(table: dict[str, Any]) -> list[str]:
    """Put texts of hulls into a table, in the places of the names of their files; changed in place.

    Returns:
        A line for each file that cannot be read; the vehicle then has no hull of its own.
    """
    lines = []
    for key, vehicle in _vehicles(table):
        name = vehicle[MODEL]
        if is_mjcf(name):
            continue
        try:
            text = read_text(Path(name), LONGEST_MODEL)
            reason = "" if is_mjcf(text) else "it is no XML"
        except LaisnError as error:
            text, reason = "", str(error)
        if reason:
            lines.append(f"  {key}: {shortened(plain(name), 200)}: cannot be read: {reason}")
            del vehicle[MODEL]
        else:
            vehicle[MODEL] = text
    return lines


def examined(
    table: dict[str, Any], further: Callable[[Scenario], Iterable[str]] = _no_checks
) -> tuple[Scenario | None, list[str]]:
    """The scenario, None if a key is invalid, and a line for each error; arguments as of `validate`.

    All keys are validated first; then what they say together.
    """
    table = copy.deepcopy(table)
    lines = embed(table)
    try:
        scenario = Scenario.model_validate_json(json.dumps(table), context=KEYS_ALONE)
    except ValidationError as error:
        return None, lines + lines_of(error)
    return scenario, [*lines, *(f"  {text}" for text in (*scenario.inconsistencies(), *further(scenario)))]


def validate(
    table: Mapping[str, Any], source: str, further: Callable[[Scenario], Iterable[str]] = _no_checks
) -> Scenario:
    """A scenario from a table of keys.

    Args:
        table: as read from TOML.
        source: name of the file, for messages.
        further: lists more errors of a scenario whose keys are valid, as `sim.feasibility` does.

    Raises:
        ScenarioError: with one line for every error, as many as a screen holds.
    """
    scenario, lines = examined(plain_values(table, source), further)
    if lines or scenario is None:
        head = f"{source}: {len(lines)} error{'s' if len(lines) != 1 else ''}"
        raise ScenarioError("\n".join(screenful([head, *lines])))
    return scenario


def _no_value(error: ValueError, text: str) -> str:
    """Why a TOML text cannot be read, in a user's words."""
    # besides its own, tomllib lets errors of dates and of int() through; the latter tells programmers what to call
    endless = None if isinstance(error, tomllib.TOMLDecodeError) else _ENDLESS.search(text)
    if endless is None:
        return shortened(plain(error), 300)
    digits = sum(character.isdigit() for character in endless.group())
    line = f" (at line {text.count(chr(10), 0, endless.start()) + 1})" if "\n" in text else ""
    return f"a number of {digits} digits, expected one that fits 64 bits{line}"


def parse(text: str, source: str) -> dict[str, Any]:
    """The table in a TOML text, as JSON can hold it; ScenarioError names line and column of a syntax error."""
    try:
        table: dict[str, Any] = plain_values(tomllib.loads(text), source)
        return table
    except ScenarioError:
        raise
    except RecursionError:
        raise ScenarioError(f"{source}: not valid TOML: lists or tables nest too deep") from None
    except ValueError as error:
        raise ScenarioError(f"{source}: not valid TOML: {_no_value(error, text)}") from None


def read(path: Path) -> dict[str, Any]:
    """The table in a TOML file; ScenarioError if it cannot be read, is no plain file or larger than any scenario."""
    try:
        text = read_text(path, LARGEST_BYTES)
    except LaisnError as error:
        raise ScenarioError(f"{path}: cannot be read: {error}") from None
    return parse(text, str(path))


def value_of(text: str, source: str) -> Any:
    """A value on the command line: TOML, or text without quotes; `source` is for messages."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    except RecursionError:
        raise ScenarioError(f"{source}: lists or tables nest too deep") from None
    except ValueError as error:
        raise ScenarioError(f"{source}: {_no_value(error, text)}") from None


def _assign(place: Any, parts: list[str], value: object) -> None:
    """Put a value at the end of a path; IndexError, TypeError or ValueError if the path does not lead there.

    A list index has one form, 0 and not 00, so that equal keys are equal texts.
    """
    *parents, last = (int(part) if _INDEX.fullmatch(part) else part for part in parts)
    for part in parents:
        place = place.setdefault(str(part), {}) if isinstance(place, dict) else place[part]
    if isinstance(place, dict):
        place[str(last)] = value
    else:
        place[last] = value


def _put(table: dict[str, Any], key: str, value: object) -> None:
    """Put a value at a dotted key; ScenarioError if the key leads through something that is no table or list."""
    parts = key.strip().split(".")
    try:
        if len(parts) > _DEEPEST:
            raise IndexError
        _assign(table, parts, value)
    except (IndexError, ValueError, TypeError):
        raise ScenarioError(f"{shortened(plain(key.strip()), 100)} is no key of this scenario") from None


def dotted(table: Mapping[str, Any], is_value: Callable[[Any], bool] = lambda _: False) -> dict[str, Any]:
    """Values of a table by their dotted keys, such as `followers.0.depth_m`: what `assigned` puts in place.

    Args:
        table: of tables, and of lists of tables.
        is_value: whether a table is a value itself, and no part of a key; an empty one always is.
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
    """A copy of a table with values put at dotted keys, such as `followers.0.depth_m`.

    Raises:
        ScenarioError: a key leads through something that is no table or list.
    """
    result: dict[str, Any] = plain_values(table, "scenario")
    for key, value in settings.items():
        _put(result, key, plain_values({"value": value}, key)["value"])
    return result


def _assignment(text: str, option: str = "--set") -> tuple[str, Any]:
    """Key and value of `key.path=value`."""
    source = f"{option} {shortened(plain(text), 200)}"
    path, equals, value = text.partition("=")
    if not equals or not path.strip():
        raise ScenarioError(f"{source}: expected key=value, such as sensors.speed_bias_m_s=0.1")
    return path, plain_values({"value": value_of(value.strip(), source)}, source)["value"]


def values_of(assignments: Iterable[str], option: str = "--set") -> dict[str, Any]:
    """Values by dotted key of assignments `key.path=value`, as `override` takes them; errors as of that."""
    return {path.strip(): value for path, value in (_assignment(text, option) for text in assignments)}


def override(table: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """A copy of a table with `key.path=value` assignments applied; list items as `followers.0.depth_m=5`.

    Values are TOML (`0.1`, `true`, `[1, 2]`); text may stand without quotes.

    Raises:
        ScenarioError: an assignment without `=`, or a path through something that is no table or list.
    """
    result: dict[str, Any] = plain_values(table, "scenario")
    for assignment in assignments:
        path, value = _assignment(assignment)
        try:
            _put(result, path, value)
        except ScenarioError as error:
            raise ScenarioError(f"--set {shortened(plain(assignment), 200)}: {error}") from None
    return result
