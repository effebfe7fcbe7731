"""The scenario reference, generated from the models: every key with unit, default, bounds and
meaning.
"""

import json
import textwrap
from pathlib import Path
from typing import Any, get_origin

from pydantic import BaseModel

from sim.scenario.navigation import FollowerNavigation
from sim.scenario.section import UNITS
from sim.scenario.sensors import VehicleSensors
from sim.scenario.settings import Scenario
from sim.scenario.vehicles import LeaderNavigation, Vehicle

PATH = Path(__file__).resolve().parents[2] / "docs" / "scenario.md"

_INTRODUCTION = """# Scenario reference

After reading this page you can set every key of a scenario.

A scenario is a TOML file. It needs one `[[followers]]` table with a `route`, `waypoints` or a
`station`; all other keys have defaults. A line below reads `key = default`, then the other choices
or the interval of allowed values, then the meaning. `…` as a default means that nothing is set. A
value out of bounds is refused, with its bounds.

- `laisn scenarios T5` prints a complete scenario.
- `laisn check FILE` validates a file.
- `--set KEY=VALUE` changes a key from the command line.

{units}

*Generated from `sim/scenario/settings.py` by `python -m tools.documents.scenario_reference`.*
"""

_UNSTATED_BOUNDS = {(0, 1), (-180, 180), (-360, 360)}
"""Intervals that follow from the quantity: probabilities and angles."""
_UNBOUNDED = 100
"""Limits from here on only exclude numbers that a computation cannot handle."""


def _interval(schema: dict[str, Any]) -> str:
    bounds = {
        key: value
        for schemas in (schema, *schema.get("anyOf", []))
        for key, value in schemas.items()
    }
    low, high = (
        bounds.get(key, bounds.get(f"exclusive{key.title()}")) for key in ("minimum", "maximum")
    )
    if low is None or high is None or (low, high) in _UNSTATED_BOUNDS or high >= _UNBOUNDED:
        return ""
    return f"{low:g} to {high:g}"


def _values(schema: dict[str, Any], definitions: dict[str, Any]) -> str:
    """Choices other than the default, or an interval."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rsplit("/", 1)[1]]
    choices: list[Any] = next(
        (p["enum"] for p in (schema, *schema.get("anyOf", [])) if "enum" in p), []
    )
    others = [value for value in choices if value != schema.get("default")]
    return ", ".join(f"`{json.dumps(value)}`" for value in others) or _interval(schema)


def _default(schema: dict[str, Any]) -> str:
    value = schema.get("default")
    return "…" if value in (None, []) else json.dumps(value)


_AS_NAVIGATION = (LeaderNavigation, FollowerNavigation)
"""Sections with the keys of `[navigation]`."""


def _is_section(field: dict[str, Any]) -> bool:
    return any(
        "$ref" in schema_part
        for schema_part in (field, field.get("items", {}), *field.get("anyOf", []))
    )


def _table(title: str, model: type[BaseModel]) -> list[str]:
    """Heading, text and rows of a section; the common keys of vehicles and sensors have one
    table.
    """
    schema = model.model_json_schema()
    rows = [f"\n## {title}\n", (model.__doc__ or "").strip()]
    common = (
        Vehicle.model_json_schema()["properties"]
        if issubclass(model, Vehicle) and model is not Vehicle
        else {}
    )
    fields = {
        k: f for k, f in schema["properties"].items() if not _is_section(f) and common.get(k) != f
    }
    if not fields or model in (VehicleSensors, *_AS_NAVIGATION):
        return rows
    rows.append("")
    for key, field in fields.items():
        values = [f"`{key} = {_default(field)}`", _values(field, schema.get("$defs", {}))]
        parts = [", ".join(filter(None, values)), field.get("description", "")]
        rows.append(f"- {': '.join(filter(None, parts))}")
    return rows


def _sections(model: type[BaseModel], path: str = "") -> list[tuple[str, type[BaseModel]]]:
    sections: list[tuple[str, type[BaseModel]]] = []
    for key, field in model.model_fields.items():
        candidates = [field.annotation, *getattr(field.annotation, "__args__", ())]
        for candidate in candidates:
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                name = f"{path}{key}"
                title = f"[[{name}]]" if get_origin(field.annotation) is tuple else f"[{name}]"
                sections.append((title, candidate))
                if candidate not in _AS_NAVIGATION:
                    sections += _sections(candidate, f"{name}.")
    return sections


def text() -> str:
    """The whole reference as Markdown."""
    endings = ", ".join(f"`{ending}` ({unit})" for ending, (unit, _) in reversed(UNITS.items()))
    units = textwrap.fill(f"A key ends with its unit: {endings}.", 120)
    lines = [_INTRODUCTION.format(units=units), *_table("Top level", Scenario)]
    lines += _table("`[leader]` and `[[followers]]`", Vehicle)
    for title, model in _sections(Scenario):
        lines += _table(f"`{title}`", model)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
