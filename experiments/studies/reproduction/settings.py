"""The paper's five stages: every setting of its tables, those it describes in words, alternatives; its figures."""

import csv
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from importlib import resources
from typing import Any, Literal

from pydantic import TypeAdapter

from experiments.campaign.store import Record
from experiments.flight.library import ROUTES, table_of
from experiments.study.file import of_table
from experiments.study.plan import Entry, plan_of
from laisn.failure import LaisnError
from laisn.settings import Variant
from sim.scenario.file import assigned, validate
from sim.scenario.routes import LEADER_DEPTH

Motion = Literal["physics", "kinematic"]
Key = tuple[str, str, Variant]
ROUTE = "followers.0.route"
METRICS = {
    "e_p_max_m": "E_P max [m]", "e_b_max_deg": "E_B max [°]", "e_p_mean_m": "E_P mean [m]",
    "e_b_mean_deg": "E_B mean [°]", "e_p_std_m": "σ E_P [m]", "e_b_std_deg": "σ E_B [°]",
}  # fmt: skip
"""The paper's six figures of a row, in its order, and their heads."""
VARIANT_NAMES = {"laisn-2": "LAISN-2", "laisn-3-1": "LAISN-3(1)", "laisn-3-2": "LAISN-3(2)"}
STAGES = (1, 2, 3, 4, 5)


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One setting of the study: keys of the scenario, simulated on every mission with each of its variants."""

    name: str
    stage: int
    table: str
    """Name of the published table; "text" if the paper has words only, "alternative" if it is not the paper's."""
    title: str
    set: Mapping[str, Any] = field(default_factory=dict)
    """What differs from a scenario's defaults, which are the paper's base setting."""
    variants: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")
    like: str = ""
    """Setting of the paper against whose rows an alternative is held; empty for the paper's own."""

    @property
    def printed(self) -> bool:
        """Whether the paper has a table of it."""
        return self.table not in {"text", "alternative"}


def data(name: str) -> str:
    """Text of a file of this study."""
    return (resources.files("experiments.studies.reproduction") / name).read_text(encoding="utf-8")


_FILE = tomllib.loads(data("study.toml"))
SETTINGS = TypeAdapter(tuple[Setting, ...]).validate_python(_FILE["setting"])
FIGURES: list[dict[str, Any]] = _FILE["figure"]
"""Figures 3 to 9, errors over time on some missions: `number`, `setting`, `variant` and `missions`."""


def settings_of(stages: Iterable[int] | None) -> tuple[Setting, ...]:
    """Settings of some stages; None: of all. LaisnError naming an unknown stage."""
    wanted = STAGES if stages is None else tuple(stages)
    for stage in wanted:
        if stage not in STAGES:
            raise LaisnError(f"unknown stage {stage}; available: {', '.join(map(str, STAGES))}")
    return tuple(s for s in SETTINGS if s.stage in wanted)


def entries(chosen: Iterable[Setting], *, motion: Motion, runs: int, seed: int) -> dict[Key, Entry]:
    """Settings as arms, with each of their variants, and missions as points; point motion is at the leader's depth."""
    arms = [{"name": f"{s.name} {v}", **s.set, "navigation.variant": v} for s in chosen for v in s.variants]
    common = {"motion": motion} | ({"followers.0.depth_m": LEADER_DEPTH} if motion == "kinematic" else {})
    table = {"scenario": ROUTES[0], "seed": seed, "runs": runs, "set": common, "vary": {ROUTE: [*ROUTES]}, "arm": arms}
    found = plan_of(of_table(table, "reproduce", "reproduce")).entries
    return {(one.arm.split()[0], one.settings[ROUTE], one.scenario.navigation.variant): one for one in found}  # type: ignore[misc]


def columns(setting: Setting) -> Record:
    """The setting as columns of a table, named as in the published ones."""
    made: Any = validate(assigned(table_of("T5"), setting.set), setting.name).model_dump()

    def inner(part: Any, name: str) -> Any:
        return part[int(name) if name.isdigit() else name]

    values = {name: reduce(inner, key.split("."), made) for name, key in _FILE["columns"].items()}
    return {"table": setting.table, "stage": setting.stage, "setting": setting.name, **values}


def published() -> dict[Key, dict[str, float]]:
    """The published figures of every row."""
    rows: dict[Key, dict[str, float]] = {}
    for row in csv.DictReader(data("published_tables.csv").splitlines()):
        variant: Variant = row["variant"]  # type: ignore[assignment]
        rows[row["setting"], row["trajectory"], variant] = {metric: float(row[metric]) for metric in METRICS}
    return rows
