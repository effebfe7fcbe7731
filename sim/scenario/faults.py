"""Faults that validation finds in a scenario: where each one is, how it is told, and the table without it."""

import copy
import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from sim.scenario.settings import Scenario
from sim.screen import plain, shortened

Location = tuple[int | str, ...]
"""Path of a key, such as ("followers", 0, "depth_m")."""

_STAND_IN = {"route": "T5"}
"""A follower in the place of one that is none, so that the rest can be looked at."""


def key_of(location: Location) -> str:
    """The path as it is told: `followers[0].depth_m`."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "scenario"


def overlaps(one: Sequence[Any], other: Sequence[Any]) -> bool:
    """Whether one of two paths, or of two keys as they are told, begins with the other."""
    n = min(len(one), len(other))
    if one[:n] != other[:n]:
        return False
    longer = one if len(one) > n else other
    return len(longer) == n or not isinstance(longer, str) or longer[n] in ".["


def _section(location: Location) -> type[BaseModel] | None:
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


def _hint(location: Location) -> str:
    model = _section(location[:-1])
    known = list(model.model_fields) if model else []
    close = difflib.get_close_matches(shortened(str(location[-1]), 80), known, n=1, cutoff=0.5)
    return f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(known)}"


def _unknown(location: Location) -> str:
    return f"  {shortened(plain(key_of(location)), 100)}: unknown key; {_hint(location)}"


def unknown_key(key: str) -> str | None:
    """A line if no scenario has a dotted key, such as `followers.0.depth_m`, whatever its value may be."""
    location = tuple(int(part) if part.isdecimal() else part for part in key.split("."))
    for n, part in enumerate(location):
        section = _section(location[:n])
        if isinstance(part, str) and section is not None and part not in section.model_fields:
            return _unknown(location[: n + 1])
    return None


def told_apart(error: ValidationError) -> list[Any]:
    """The faults of a validation, but for those that follow from others."""
    faults = error.errors(include_url=False, include_context=False)
    within = {fault["loc"][:n] for fault in faults for n in range(len(fault["loc"]))}
    # an item that is at fault itself does not count as one, so that its list may seem too short
    return [fault for fault in faults if fault["type"] != "too_short" or fault["loc"] not in within]


def described(fault: Mapping[str, Any]) -> str:
    """A fault in a line: key, what is expected, what was given."""
    if fault["type"] == "extra_forbidden":
        return _unknown(fault["loc"])
    key = shortened(plain(key_of(fault["loc"])), 100)
    message = fault["msg"].removeprefix("Value error, ")
    given = fault["input"]
    if isinstance(given, dict | BaseModel) or fault["type"] == "missing":
        return f"  {key}: {message}"
    shown = shortened(repr(given) if not isinstance(given, list | str) else repr(given[:80]), 80)
    return f"  {key}: {message} (given: {plain(shown)})"


def _put_aside(table: dict[str, Any], place: Location) -> Location:
    """Which part of the table goes with a fault: the key, or the whole list or the follower that the fault is in."""
    at: Any = table
    for n, part in enumerate(place):
        if isinstance(at, list) and place[:n] != ("followers",):
            return place[:n]
        if not isinstance(at, dict | list) or (isinstance(part, int) and part >= len(at)):
            return place[:n]
        at = at.get(part) if isinstance(at, dict) else at[int(part)]
    return place


def without(table: Mapping[str, Any], places: Iterable[Location]) -> tuple[dict[str, Any], set[Location]]:
    """A copy of a table in which what is at fault has its default or a stand-in, and the paths that it was taken from.

    Args:
        table: of a scenario.
        places: of the faults.
    """
    result: dict[str, Any] = copy.deepcopy(dict(table))
    aside = {_put_aside(result, place) for place in places} - {()}
    for path in aside:
        if path == ("name",):
            result["name"] = "unnamed"
        elif path == ("followers",):
            result["followers"] = [dict(_STAND_IN)]
    for path in sorted(aside, key=len, reverse=True):
        *parents, last = path
        at: Any = result
        for part in parents:
            at = at[part] if isinstance(part, int) else at.get(part, {})
        if isinstance(at, list):
            at[int(last)] = {"name": f"follower-{int(last) + 1}", **_STAND_IN}
        elif path not in {("name",), ("followers",)}:
            at.pop(last, None)
    return result, aside
