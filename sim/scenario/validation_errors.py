"""Errors that validation finds in the table of a scenario, as lines that name key, expectation and value."""

import difflib
from collections.abc import Mapping
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from laisn.failure import ROWS, plain, shortened
from sim.scenario.settings import Scenario

Location = tuple[int | str, ...]
"""Path of a key, such as ("followers", 0, "depth_m")."""


def key_of(location: Location) -> str:
    """The path as it is printed: `followers[0].depth_m`."""
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "scenario"


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


def _unknown(location: Location) -> str:
    model = _section(location[:-1])
    known = list(model.model_fields) if model else []
    close = difflib.get_close_matches(shortened(str(location[-1]), 80), known, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}?" if close else f"known here: {', '.join(known)}"
    return f"  {shortened(plain(key_of(location)), 100)}: unknown key; {hint}"


def _line(error: Mapping[str, Any]) -> str:
    """An error in a line: key, what is expected, what was given."""
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
    return [*map(_line, errors[:ROWS]), *[""] * len(errors[ROWS:])]
