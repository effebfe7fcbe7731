"""What a study can be judged by: the columns of its tables, what each is, and its unit."""

import tomllib
from importlib import resources
from typing import NamedTuple

from experiments.campaign.montecarlo import PERCENTILES
from laisn.estimates import FixKind

UNITS = {
    "deg_sqrt_h": "°/√h", "m_s2": "m/s²", "m_s": "m/s", "kg_m3": "kg/m³", "deg_s": "°/s", "deg_h": "°/h",
    "per_s": "1/s", "ppm": "ppm", "deg": "°", "kg": "kg", "m2": "m²", "m": "m", "s": "s", "n": "N", "j": "J", "w": "W",
}  # fmt: skip
"""Units by the ends of keys and columns, the longer ones first."""


def without_unit(name: str) -> tuple[str, str]:
    """A key or column without the unit at its end, and that unit; empty where it has none."""
    suffix = next((unit for unit in UNITS if name.endswith(f"_{unit}")), "")
    return name.removesuffix(f"_{suffix}") if suffix else name, UNITS.get(suffix, "")


class Metric(NamedTuple):
    """A column of results.parquet or runs.parquet."""

    label: str
    what: str
    unit: str = ""


_DATA = tomllib.loads((resources.files(__package__) / "metrics.toml").read_text(encoding="utf-8"))
MISSION: dict[str, list[str]] = _DATA["mission"]
"""Labels and meanings of what is measured of a mission."""
_PERCENTILES = {
    f"e_{kind}_p{p}_{unit}": [f"{p}th percentile of E_{kind.upper()}", "over steps and runs"]
    for kind, unit in (("p", "m"), ("b", "deg"))
    for p in PERCENTILES
}
_FIXES = {
    f"fixes_{kind.name.lower()}": [f"fixes: {kind.name.lower().replace('_', ' ')}", "number over all runs"]
    for kind in FixKind
}
METRICS: dict[str, Metric] = {
    name: Metric(f"{label} [{unit}]" if unit else label, what, unit)
    for name, (label, what) in (_DATA["errors"] | _PERCENTILES | _FIXES | MISSION).items()
    for _, unit in [without_unit(name)]
}
SHARES = frozenset({"mirror_locked", "lost", "touched", "ended"})
"""Metrics that a run either has or has not: 1 or 0."""
