"""The paper's five stages as data: every setting of its tables, those it only describes, and named alternatives.

Source of all numbers: paper, Section 3. Where it lists two values (T, β), those that fit its own tables at short
message intervals are used throughout; nothing is tuned to a row.
"""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Literal

from laisn.failure import LaisnError
from laisn.settings import Variant
from sim.scenario.file import assigned, validate
from sim.scenario.routes import LEADER_DEPTH
from sim.scenario.settings import Follower, Scenario

Motion = Literal["physics", "kinematic"]

STAGES = (1, 2, 3, 4, 5)
METRICS = ("e_p_max_m", "e_b_max_deg", "e_p_mean_m", "e_b_mean_deg", "e_p_std_m", "e_b_std_deg")
"""The paper's six figures of a row, in its order."""
BOTH: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")

HEADING_SPREAD = 0.4
"""σθ of the leader's compass over its μθ: the text gives one σθ, Tables 8 and 9 fit this."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One setting of the study: keys of the scenario, flown on every mission with each of its variants."""

    name: str
    stage: int
    table: str
    """Name of the published table; "text" if the paper has words only, "alternative" if it is not the paper's."""
    title: str
    keys: Mapping[str, Any] = field(default_factory=dict)
    """What differs from a scenario's defaults, which are the paper's base setting."""
    variants: tuple[Variant, ...] = BOTH
    like: str = ""
    """Setting of the paper against whose rows an alternative is held; empty for the paper's own."""

    @property
    def scenario(self) -> Scenario:
        """The setting on a mission of no account, for its values."""
        return scenario(self, Follower(route="T5"), "setting", variant="laisn-2", motion="physics", seed=1)


_STEP, _INTERVAL = "timing.filter_step_s", "timing.message_interval_s"
_TAU, _BETA = "acoustics.range_tau_m", "navigation.beta_m2"
_EVERY_5_S, _EVERY_10_S = {_INTERVAL: 5.0}, {_INTERVAL: 10.0}
_SLOW = {**_EVERY_10_S, _STEP: 1.0}


def compass(bias_deg: float) -> dict[str, float]:
    """Keys of a leader's compass that is off by so many degrees."""
    return {
        "sensors.leader_heading_bias_deg": bias_deg,
        "sensors.leader_heading_sigma_deg": HEADING_SPREAD * bias_deg,
    }


SETTINGS = (
    Setting(name="base", stage=1, table="1", title="Δt_D = 1 s", variants=("laisn-2", "laisn-3-1", "laisn-3-2")),
    Setting(
        name="measured-gate", stage=1, table="alternative", title="Δt_D = 1 s, gate by measured speed", like="base",
        keys={"navigation.gate": "v-measured"},
    ),
    Setting(name="5s", stage=2, table="2-4", title="Δt = 0.1 s, Δt_D = 5 s", keys=_EVERY_5_S),
    Setting(name="10s", stage=2, table="2-4", title="Δt = 0.1 s, Δt_D = 10 s", keys=_EVERY_10_S),
    Setting(name="10s-slow", stage=2, table="2-4", title="Δt = 1 s, Δt_D = 10 s", keys=_SLOW),
    Setting(
        name="10s-beta10", stage=2, table="alternative", title="Δt = 0.1 s, Δt_D = 10 s, β = 10", like="10s",
        keys={**_EVERY_10_S, _BETA: 10.0},
    ),
    Setting(
        name="10s-slow-beta10", stage=2, table="alternative", title="Δt = 1 s, Δt_D = 10 s, β = 10", like="10s-slow",
        keys={**_SLOW, _BETA: 10.0},
    ),
    Setting(
        name="10s-slow-beta300", stage=2, table="alternative", title="Δt = 1 s, Δt_D = 10 s, β = 300, T = 10",
        like="10s-slow", keys={**_SLOW, _BETA: 300.0, "navigation.threshold_m": 10.0},
    ),
    Setting(
        name="L1", stage=3, table="5", title="L = 1 m, H_T = 0.1 m", keys={**_EVERY_5_S, "leader.baseline_m": 1.0}
    ),
    Setting(
        name="HT0.2", stage=3, table="6", title="L = 2 m, H_T = 0.2 m", variants=("laisn-3-2",),
        keys={**_EVERY_5_S, "leader.middle_offset_m": 0.2},
    ),
    Setting(
        name="muD0.3", stage=4, table="text", title="μ_D = 0.3 m",
        keys={**_EVERY_5_S, "acoustics.range_scale_mean_m": 0.3},
    ),
    Setting(
        name="tau0.03", stage=4, table="text", title="τ = 0.03 m for all transmitters",
        keys={**_EVERY_5_S, _TAU: [0.03, 0.03, 0.03]},
    ),
    Setting(
        name="tau0.06", stage=4, table="text", title="τ = 0.06 m for all transmitters",
        keys={**_EVERY_5_S, _TAU: [0.06, 0.06, 0.06]},
    ),
    Setting(
        name="asymmetric", stage=4, table="7", title="τ = 0.06 m rear, 0.01 m others",
        keys={**_EVERY_5_S, _TAU: [0.06, 0.01, 0.01]},
    ),
    Setting(
        name="asymmetric-centred", stage=4, table="alternative", title="τ = 0.06 m rear, 0.01 m others, mean removed",
        like="asymmetric", keys={**_EVERY_5_S, _TAU: [0.06, 0.01, 0.01], "acoustics.range_error_centred": True},
    ),
    Setting(name="heading2.5", stage=5, table="8", title="leader's compass 2.5° off", keys=compass(2.5)),
    Setting(name="heading5", stage=5, table="9", title="leader's compass 5° off", keys=compass(5.0)),
)  # fmt: skip

Key = tuple[str, str, Variant]
"""Setting, mission, variant."""


def settings_of(stages: Iterable[int] | None) -> tuple[Setting, ...]:
    """Settings of some stages; None: of all. LaisnError naming an unknown stage."""
    wanted = STAGES if stages is None else tuple(stages)
    for stage in wanted:
        if stage not in STAGES:
            raise LaisnError(f"unknown stage {stage}; available: {', '.join(map(str, STAGES))}")
    return tuple(s for s in SETTINGS if s.stage in wanted)


def scenario(
    setting: Setting, follower: Follower, name: str, *, variant: Variant, motion: Motion, seed: int
) -> Scenario:
    """The scenario of one setting, mission and variant.

    Point motion is flown in the plane, as in the paper: the follower goes at the leader's depth.
    """
    if motion == "kinematic":
        follower = follower.model_copy(update={"depth_m": LEADER_DEPTH})
    mission = {"name": name, "seed": seed, "motion": motion, "followers": [follower.model_dump(mode="json")]}
    return validate(assigned(mission, {**setting.keys, "navigation.variant": variant}), f"{name}, {setting.name}")


def columns(setting: Setting) -> dict[str, str | float]:
    """The setting as columns of a table, named as in the published ones."""
    made = setting.scenario
    timing, leader, acoustics, told = made.timing, made.leader, made.acoustics, made.navigation
    return {
        "table": setting.table,
        "stage": setting.stage,
        "setting": setting.name,
        "dt_s": timing.filter_step_s,
        "dt_range_s": timing.message_interval_s,
        "leader_length_m": leader.baseline_m or math.nan,
        "h_t_m": leader.middle_offset_m or math.nan,
        "tau_rear_m": acoustics.range_tau_m[0],
        "tau_other_m": acoustics.range_tau_m[1],
        "mu_range_m": acoustics.range_scale_mean_m,
        "sigma_range_m": acoustics.range_scale_sigma_m,
        "range_error_centred": acoustics.range_error_centred,
        "mu_heading_leader_deg": made.sensors.leader_heading_bias_deg,
        "beta_m2": told.beta_m2,
        "threshold_m": told.threshold_m,
        "gate": told.gate,
    }


_IDENTITY = (
    "table", "dt_s", "dt_range_s", "leader_length_m", "h_t_m", "tau_rear_m", "tau_other_m", "mu_range_m",
    "sigma_range_m", "mu_heading_leader_deg",
)  # fmt: skip
"""Columns that tell the published rows of one setting from those of another."""


def published() -> dict[Key, dict[str, float]]:
    """The published figures of every row.

    Raises:
        ValueError: a row belongs to none of `SETTINGS`.
    """
    text = (resources.files("experiments.reproduction") / "data" / "published_tables.csv").read_text(encoding="utf-8")
    known = {_identity(columns(s)): s.name for s in SETTINGS if s.table not in {"text", "alternative"}}
    rows: dict[Key, dict[str, float]] = {}
    for number, row in enumerate(csv.DictReader(text.splitlines()), start=2):
        name = known.get(_identity(row))
        if name is None:
            raise ValueError(f"published_tables.csv, line {number}: no stage has this setting")
        variant: Variant = row["variant"]  # type: ignore[assignment]
        rows[name, row["trajectory"], variant] = {metric: float(row[metric]) for metric in METRICS}
    return rows


def _identity(row: Mapping[str, object]) -> Sequence[object]:
    return tuple(row[c] if c == "table" else float(str(row[c])) for c in _IDENTITY)
