"""The paper's five stages: every setting of its tables, those it describes in words, alternatives; its figures."""

import csv
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Literal

from pydantic import TypeAdapter

from experiments.campaign.store import Record
from experiments.flight.library import table_of
from laisn.failure import LaisnError
from laisn.settings import Variant
from sim.scenario.file import assigned, validate
from sim.scenario.routes import LEADER_DEPTH
from sim.scenario.settings import Scenario

Motion = Literal["physics", "kinematic"]
Key = tuple[str, str, Variant]
"""Setting, mission, variant."""
METRICS = {
    "e_p_max_m": "E_P max [m]", "e_b_max_deg": "E_B max [°]", "e_p_mean_m": "E_P mean [m]",
    "e_b_mean_deg": "E_B mean [°]", "e_p_std_m": "σ E_P [m]", "e_b_std_deg": "σ E_B [°]",
}  # fmt: skip
"""The paper's six figures of a row, in its order, and their heads."""
VARIANT_NAMES = {"laisn-2": "LAISN-2", "laisn-3-1": "LAISN-3(1)", "laisn-3-2": "LAISN-3(2)"}
STAGES = (1, 2, 3, 4, 5)


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One setting of the study: keys of the scenario, flown on every mission with each of its variants."""

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


_FILE = tomllib.loads(data("settings.toml"))
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


def scenario(
    setting: Setting, route: str = "T5", *, variant: Variant = "laisn-2", motion: Motion = "physics", seed: int = 1
) -> Scenario:
    """The scenario of one setting, mission and variant.

    Point motion is flown in the plane, as in the paper: the follower goes at the leader's depth.
    """
    keys = {"seed": seed, "motion": motion, **setting.set, "navigation.variant": variant}
    if motion == "kinematic":
        keys["followers.0.depth_m"] = LEADER_DEPTH
    return validate(assigned(table_of(route), keys), f"{route}, {setting.name}")


def columns(setting: Setting) -> Record:
    """The setting as columns of a table, named as in the published ones."""
    made = scenario(setting)
    return {
        "table": setting.table,
        "stage": setting.stage,
        "setting": setting.name,
        "dt_s": made.timing.filter_step_s,
        "dt_range_s": made.timing.message_interval_s,
        "leader_length_m": made.leader.baseline_m or math.nan,
        "h_t_m": made.leader.middle_offset_m or math.nan,
        "tau_rear_m": made.acoustics.range_tau_m[0],
        "tau_other_m": made.acoustics.range_tau_m[1],
        "mu_range_m": made.acoustics.range_scale_mean_m,
        "sigma_range_m": made.acoustics.range_scale_sigma_m,
        "range_error_centred": made.acoustics.range_error_centred,
        "mu_heading_leader_deg": made.sensors.leader_heading_bias_deg,
        "beta_m2": made.navigation.beta_m2,
        "threshold_m": made.navigation.threshold_m,
        "gate": made.navigation.gate,
    }


def published() -> dict[Key, dict[str, float]]:
    """The published figures of every row."""
    rows: dict[Key, dict[str, float]] = {}
    for row in csv.DictReader(data("published_tables.csv").splitlines()):
        variant: Variant = row["variant"]  # type: ignore[assignment]
        rows[row["setting"], row["trajectory"], variant] = {metric: float(row[metric]) for metric in METRICS}
    return rows
