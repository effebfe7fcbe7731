"""Scenario files: TOML in and out, overrides, and messages that say what to mend."""

import difflib
import json
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, get_args

import tomli_w
from pydantic import BaseModel, ValidationError

from laisn.failure import LaisnError
from sim.scenario.settings import Scenario


class ScenarioError(LaisnError):
    """A scenario that cannot be flown; the text names source, key, value and expectation of every fault."""


def _section(location: tuple[int | str, ...]) -> type[BaseModel] | None:
    """The model that a key path ends in."""
    model: type[BaseModel] = Scenario
    for part in location:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        if field is None:
            return None
        annotation = field.annotation
        candidates = [annotation, *get_args(annotation)]
        nested = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)
        if nested is None:
            return None
        model = nested
    return model


def _key(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "scenario"


def _hint(location: tuple[int | str, ...]) -> str:
    model = _section(location[:-1])
    known = list(model.model_fields) if model else []
    close = difflib.get_close_matches(str(location[-1]), known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(known)}"


def _describe(source: str, error: ValidationError) -> str:
    lines = []
    faults = error.errors()
    places = [fault["loc"] for fault in faults]
    for fault in faults:
        location = fault["loc"]
        if fault["type"] == "too_short" and any(p[: len(location)] == location and p != location for p in places):
            continue  # an item that is at fault itself does not count as one
        if fault["type"] == "extra_forbidden":
            lines.append(f"  {_key(location)}: unknown key; {_hint(location)}")
            continue
        message = fault["msg"].removeprefix("Value error, ")
        given = fault["input"]
        shown = "" if isinstance(given, dict | BaseModel) or fault["type"] == "missing" else f" (given: {given!r:.80})"
        lines.append(f"  {_key(location)}: {message}{shown}")
    return f"{source}: {len(lines)} fault{'s' if len(lines) > 1 else ''}\n" + "\n".join(lines)


def _json_ready(value: object) -> object:
    """TOML has dates and knows NaN; JSON does not. Both become text that validation refuses with its key."""
    if isinstance(value, Mapping):
        return {key: _json_ready(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_json_ready(item) for item in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return str(value)
    if isinstance(value, str | int | float | bool) or value is None:
        return value
    return str(value)


def validate(table: Mapping[str, Any], source: str) -> Scenario:
    """A scenario from a table of keys.

    Args:
        table: as read from TOML.
        source: name of the file, for messages.

    Raises:
        ScenarioError: with one line for every fault.
    """
    try:
        return Scenario.model_validate_json(json.dumps(_json_ready(table)), strict=True)
    except ValidationError as error:
        raise ScenarioError(_describe(source, error)) from None


def parse(text: str, source: str) -> dict[str, Any]:
    """The table in a TOML text; ScenarioError names line and column of a syntax error."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{source}: not valid TOML: {error}") from None


def read(path: Path) -> dict[str, Any]:
    """The table in a TOML file; ScenarioError if it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ScenarioError(f"{path}: cannot be read: {reason}") from None
    return parse(text, str(path))


def override(table: Mapping[str, Any], assignments: Iterable[str]) -> dict[str, Any]:
    """A copy of a table with `key.path=value` assignments applied; list items as `followers.0.depth_m=5`.

    Values are TOML (`0.1`, `true`, `[1, 2]`); text may stand without quotes.

    Raises:
        ScenarioError: an assignment without `=`, or a path through something that is no table or list.
    """
    result: dict[str, Any] = json.loads(json.dumps(_json_ready(table)))
    for assignment in assignments:
        path, equals, text = assignment.partition("=")
        if not equals or not path.strip():
            raise ScenarioError(f"--set {assignment}: expected key=value, such as sensors.speed_bias_m_s=0.1")
        try:
            value = tomllib.loads(f"value = {text.strip()}")["value"]
        except tomllib.TOMLDecodeError:
            value = text.strip()
        *parents, last = path.strip().split(".")
        place: Any = result
        try:
            for part in parents:
                place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
            if isinstance(place, list):
                place[int(last)] = value
            else:
                place[last] = value
        except (IndexError, ValueError, TypeError, AttributeError):
            raise ScenarioError(f"--set {assignment}: {path} is no key of this scenario") from None
    return result


def dumps(scenario: Scenario) -> str:
    """The whole scenario as TOML, every default written out; reading it back gives an equal scenario."""
    return tomli_w.dumps(scenario.model_dump(mode="json", exclude_none=True))
