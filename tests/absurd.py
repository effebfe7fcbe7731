"""Extreme scenarios: keys of the schema with values at their bounds, beyond them, or of other
kinds.
"""

from random import Random
from typing import Any

from sim.scenario.settings import Scenario

SCHEMA = Scenario.model_json_schema()
# values of wrong kinds, not finite, or far outside the bounds of most keys
FOREIGN: tuple[Any, ...] = (
    float("nan"),
    float("inf"),
    -float("inf"),
    1e308,
    -1e308,
    5e-324,
    1e-300,
    1e-7,
    -0.0,
    0,
    -1,
    2**63,
    -(2**63),
    10**400,
    True,
    "",
    "x",
    "T2",
    "[/red]",
    "\x1b[2J",
    "a\x00b",
    "\u202e水😀",
    "x" * 10_000,
    [],
    [[]],
    [[0, 0, 0]],
    [[0, 0, 0], [0, 0, 0]],
    [1, 2, 3],
    [["a"]],
    {},
    {"a": {"b": 1}},
    [{}],
    "2026-01-01",
    "9999-12-31T23:59:59+14:00",
    "0001-01-01T00:00:00-14:00",
)

# values of the keys of text that no enumeration of the schema bounds
TEXTS = {
    "epoch": ("2030-06-01T12:00:00+02:00", "1970-01-01T00:00:00+00:00"),
    "camera": ("chase", "top", "drone"),
}

# keys whose values name files or other tables, or must agree with a map
_NEED_FILES = {"current", "floor", "sound_speed", "origin", "links", "link"}


def _resolved(schema: dict[str, Any]) -> dict[str, Any]:
    return SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema


def _number(rng: Random, schema: dict[str, Any]) -> float | int:
    low = schema.get("minimum", schema.get("exclusiveMinimum", -10.0))
    high = schema.get("maximum", schema.get("exclusiveMaximum", 1e6))
    kind = rng.choice(("low", "high", "near low", "within", "small"))
    value = {
        "low": low,
        "high": high,
        "near low": low + rng.choice((1e-12, 1e-3, 0.1)),
        "within": rng.uniform(low, min(high, 1e9)),
        "small": rng.choice((0.1, 0.2, 0.5, 1.0, 2.0, 10.0)),
    }[kind]
    return int(value) if schema["type"] == "integer" else float(value)


def _route(rng: Random) -> list[list[float]]:
    """Waypoints that often can be flown."""
    time, east, north, points = 0.0, rng.uniform(-50, 50), rng.uniform(-50, 50), []
    for _ in range(rng.choice((2, 2, 3, 6))):
        points.append([time, east, north])
        time += rng.choice((0.5, 20.0, 100.0))
        east, north = east + rng.uniform(-60, 60), north + rng.uniform(-60, 60)
    return points


def _value(rng: Random, key: str, schema: dict[str, Any], wild: float) -> Any:
    if rng.random() < wild:
        return rng.choice(FOREIGN)
    schema = _resolved(schema)
    if key == "route":
        return rng.choice(("L", *(f"T{i}" for i in range(1, 10))))
    if key == "waypoints":
        return _route(rng)
    if key in {"depth_profile", "sound_speed_profile"}:
        low, high = (0, 28) if key == "depth_profile" else (1300, 1700)
        return [[10.0 * i, rng.uniform(low, high)] for i in range(rng.choice((1, 2, 5)))]
    if "enum" in schema:
        return rng.choice(schema["enum"])
    match schema.get("type"):
        case "object":
            return _table(rng, schema, wild)
        case "boolean":
            return rng.random() < 0.5
        case "number" | "integer":
            return _number(rng, schema)
        case "array" if "prefixItems" in schema:
            return [_value(rng, "", item, wild) for item in schema["prefixItems"]]
        case "array":
            return [
                _value(rng, "", schema["items"], wild) for _ in range(rng.choice((1, 1, 1, 2, 3)))
            ]
    return rng.choice(TEXTS.get(key, ("mine", "a.b")))


def _table(rng: Random, schema: dict[str, Any], wild: float) -> dict[str, Any]:
    # missing files are refused, and so is an origin that is not the map's
    keys = {
        key: value
        for key, value in schema["properties"].items()
        if key not in _NEED_FILES or rng.random() < wild
    }
    chosen = [key for key in keys if rng.random() < rng.choice((0.05, 0.3))]
    table = {key: _value(rng, key, keys[key], wild) for key in chosen}
    if rng.random() < wild:
        table[rng.choice(("senors", "", "a.b", "[/red]", "x" * 5000))] = rng.choice(FOREIGN)
    return table


def _follower(rng: Random, wild: float) -> dict[str, Any]:
    """A follower that mostly has a route or a station, not both."""
    follower = {"route": "T5", **_table(rng, SCHEMA["$defs"]["Follower"], wild)}
    if "station" in follower and rng.random() < 0.5:
        behind, port, depth = rng.uniform(4, 40), rng.uniform(-30, 30), rng.uniform(2, 28)
        return {"station": {"behind_m": behind, "port_m": port, "depth_m": depth}}
    return {
        key: value
        for key, value in follower.items()
        if key not in {"station", "start_m", "controller"} or rng.random() < wild
    }


def table(seed: int, wild: float = 0.01) -> dict[str, Any]:
    """A scenario's table, mostly of valid values.

    Args:
        seed: the same seed gives the same table.
        wild: probability that a value is one of `FOREIGN`, or that a table breaks a rule.
    """
    rng = Random(seed)
    scenario = {"duration_s": rng.choice((0.1, 0.2, 1.0, 3.0)), **_table(rng, SCHEMA, wild)}
    followers = scenario.get("followers")
    if not isinstance(followers, list) or rng.random() > wild:
        scenario["followers"] = [_follower(rng, wild) for _ in range(rng.choice((1, 1, 2, 4)))]
    return {"name": "absurd", **scenario}
