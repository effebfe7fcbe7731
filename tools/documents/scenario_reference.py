"""The scenario reference, generated from the models: every key with unit, default, bounds and meaning."""

from pathlib import Path
from typing import Any, get_origin

from pydantic import BaseModel

from sim.scenario.section import split_unit
from sim.scenario.settings import Scenario

PATH = Path(__file__).resolve().parents[2] / "docs" / "scenario.md"

_INTRODUCTION = """# Scenario reference

Generated from `sim/scenario/settings.py` by
`python -m tools.documents.scenario_reference`; a test holds the two together.

A scenario is a TOML file. Only one `[[followers]]` table with a route is needed, all else has defaults;
`laisn scenarios T5` prints a complete one, `laisn check FILE` validates yours, and `--set KEY=VALUE` changes a key from
the command line. Units stand in the names of the keys: `_m`, `_s`, `_deg`, `_n` (newton), `_px`.
"""


def _resolve(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in schema:
        return dict(definitions[schema["$ref"].rsplit("/", 1)[1]])
    return schema


def _type(schema: dict[str, Any], definitions: dict[str, Any]) -> str:
    schema = _resolve(schema, definitions)
    if "enum" in schema:
        return " or ".join(f'`"{value}"`' for value in schema["enum"])
    if "anyOf" in schema:
        return " or ".join(_type(part, definitions) for part in schema["anyOf"] if part.get("type") != "null")
    if schema.get("type") == "array":
        items = schema.get("prefixItems") or [schema.get("items", {})]
        inner = ", ".join(_type(item, definitions) for item in items)
        return f"[{inner}]" if "prefixItems" in schema else f"[{inner}, …]"
    names = {"number": "number", "integer": "integer", "string": "text", "boolean": "true or false"}
    return names.get(str(schema.get("type", "object")), "table")


def _bounds(schema: dict[str, Any]) -> str:
    parts = [schema, *schema.get("anyOf", [])]
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    found = []
    for part in parts:
        if part.get("maximum", 0) >= 2**31 or part.get("exclusiveMaximum", 0) >= 2**31:
            part = {key: value for key, value in part.items() if "aximum" not in key}
        found += [f"{sign} {part[key]:g}" for key, sign in signs.items() if key in part]
    return ", ".join(found)


def _default(schema: dict[str, Any]) -> str:
    if "default" not in schema or schema["default"] is None:
        return ""
    value = schema["default"]
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


def _table(title: str, model: type[BaseModel]) -> list[str]:
    schema = model.model_json_schema()
    definitions = schema.get("$defs", {})
    rows = [
        f"\n## {title}\n",
        f"{(model.__doc__ or '').strip()}\n",
        "| key | type | unit | default | bounds | meaning |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for key, field in schema["properties"].items():
        if any("$ref" in part for part in (field, field.get("items", {}), *field.get("anyOf", []))):
            continue
        cells = [f"`{key}`", _type(field, definitions), split_unit(key)[1], _default(field), _bounds(field)]
        rows.append(f"| {' | '.join(cells)} | {field.get('description', '')} |")
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
    lines = [_INTRODUCTION, *_table("Top level", Scenario)]
    for title, model in _sections(Scenario):
        lines += _table(f"`{title}`", model)
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
