"""The scenario reference, generated from the models: every key with unit, default, bounds and meaning."""

import textwrap
from pathlib import Path
from typing import Any, get_origin

from pydantic import BaseModel

from sim.scenario.section import UNITS
from sim.scenario.sensors import FollowerSensors
from sim.scenario.settings import Scenario
from sim.scenario.vehicles import Vehicle

PATH = Path(__file__).resolve().parents[2] / "docs" / "scenario.md"

_INTRODUCTION = """# Scenario reference

After reading this page you can set every key of a scenario.

A scenario is a TOML file. It needs one `[[followers]]` table with a route; every other key has a default.

- `laisn scenarios T5` prints a complete scenario.
- `laisn check FILE` validates a file.
- `--set KEY=VALUE` changes a key from the command line.

{units}

Values are choices, or an interval: `(` and `)` exclude the limit. Numbers without an upper limit are at
most 10⁶.

*Generated from `sim/scenario/settings.py` by `python -m tools.documents.scenario_reference`.*
"""

_UNBOUNDED = 1e6
"""Upper limits from here on only exclude numbers that a computation cannot handle."""


def _type(schema: dict[str, Any]) -> str:
    names = {"number": "number", "integer": "integer", "string": "text"}
    return next((names[p["type"]] for p in (schema, *schema.get("anyOf", [])) if p.get("type") in names), "")


def _interval(schema: dict[str, Any]) -> str:
    bounds = {key: value for part in (schema, *schema.get("anyOf", [])) for key, value in part.items()}
    low, high = (bounds.get(key, bounds.get(f"exclusive{key.title()}")) for key in ("minimum", "maximum"))
    if high is None or high >= _UNBOUNDED:
        return "" if low is None else f"{'≥' if 'minimum' in bounds else '>'} {low:g}"
    return f"{'[' if 'minimum' in bounds else '('}{low:g}, {high:g}{']' if 'maximum' in bounds else ')'}"


def _values(schema: dict[str, Any], definitions: dict[str, Any]) -> str:
    """Choices or interval; the type of a key that has no default to show it."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rsplit("/", 1)[1]]
    choices: list[Any] = next((p["enum"] for p in (schema, *schema.get("anyOf", [])) if "enum" in p), [])
    if choices:
        return ", ".join(f'`"{value}"`' if isinstance(value, str) else f"`{value}`" for value in choices)
    kind = "" if _default(schema) else _type(schema)
    return " ".join(part for part in (kind, _interval(schema)) if part)


def _default(schema: dict[str, Any]) -> str:
    value = schema.get("default")
    if value in (None, []):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


def _is_section(field: dict[str, Any]) -> bool:
    return any("$ref" in part for part in (field, field.get("items", {}), *field.get("anyOf", [])))


def _table(title: str, model: type[BaseModel]) -> list[str]:
    """Heading, text and rows of a section; the common keys of vehicles and sensors have one table."""
    schema = model.model_json_schema()
    rows = [f"\n## {title}\n", f"{(model.__doc__ or '').strip()}"]
    common = Vehicle.model_json_schema()["properties"] if issubclass(model, Vehicle) and model is not Vehicle else {}
    fields = {k: f for k, f in schema["properties"].items() if not _is_section(f) and common.get(k) != f}
    if not fields or model is FollowerSensors:
        return rows
    rows += ["", "| key | default | values | meaning |", "| --- | --- | --- | --- |"]
    for key, field in fields.items():
        cells = [f"`{key}`", _default(field), _values(field, schema.get("$defs", {})), field.get("description", "")]
        rows.append("|" + "|".join(f" {cell} " if cell else " " for cell in cells) + "|")
    return rows


def _sections(model: type[BaseModel], path: str = "") -> list[tuple[str, type[BaseModel]]]:
    found: list[tuple[str, type[BaseModel]]] = []
    for key, field in model.model_fields.items():
        candidates = [field.annotation, *getattr(field.annotation, "__args__", ())]
        for candidate in candidates:
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                name = f"{path}{key}"
                shown = f"[[{name}]]" if get_origin(field.annotation) is tuple else f"[{name}]"
                found += [(shown, candidate), *_sections(candidate, f"{name}.")]
    return found


def text() -> str:
    """The whole reference as Markdown."""
    listed = ", ".join(f"`{ending}` ({unit})" for ending, (unit, _) in reversed(UNITS.items()))
    units = textwrap.fill(f"A key ends with its unit: {listed}.", 120)
    lines = [_INTRODUCTION.format(units=units), *_table("Top level", Scenario)]
    lines += _table("`[leader]` and `[[followers]]`", Vehicle)
    for title, model in _sections(Scenario):
        lines += _table(f"`{title}`", model)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
