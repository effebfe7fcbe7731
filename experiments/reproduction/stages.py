"""The paper's five stages as data: every setting of its tables, those it only describes, and named alternatives.

Source of all numbers: paper, Section 3. Where it lists two values (T, β), those that fit its own tables at short
message intervals are used throughout; nothing is tuned to a row.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Literal

from laisn.failure import LaisnError
from laisn.settings import GateRule, Variant
from sim.scenario.routes import LEADER_DEPTH
from sim.scenario.settings import Acoustics, Follower, Leader, Navigation, Scenario, Sensors, Timing

Motion = Literal["physics", "kinematic"]

STAGES = (1, 2, 3, 4, 5)
METRICS = ("e_p_max_m", "e_b_max_deg", "e_p_mean_m", "e_b_mean_deg", "e_p_std_m", "e_b_std_deg")
"""The paper's six figures of a row, in its order."""
BOTH: tuple[Variant, ...] = ("laisn-2", "laisn-3-2")

HEADING_SPREAD = 0.4
"""σθ of the leader's compass over its μθ: the text gives one σθ, Tables 8 and 9 fit this."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One setting of the study, flown on every mission with each of its variants."""

    name: str
    stage: int
    table: str
    """Name of the published table; "text" if the paper has words only, "alternative" if it is not the paper's."""
    title: str
    variants: tuple[Variant, ...] = BOTH
    filter_step_s: float = 0.1
    message_interval_s: float = 1.0
    baseline_m: float = 2.0
    middle_offset_m: float = 0.1
    tau_rear_m: float = 0.01
    tau_other_m: float = 0.01
    range_scale_mean_m: float = 0.1
    range_scale_sigma_m: float = 0.05
    leader_heading_deg: float = 0.0
    beta_m2: float = 0.1
    threshold_m: float = 0.1
    gate: GateRule = "v-max"
    like: str = ""
    """Setting of the paper against whose rows an alternative is held; empty for the paper's own."""


SETTINGS = (
    Setting(
        name="base", stage=1, table="1", title="Δt_D = 1 s", variants=("laisn-2", "laisn-3-1", "laisn-3-2")
    ),
    Setting(
        name="measured-gate", stage=1, table="alternative", title="Δt_D = 1 s, gate by measured speed", like="base",
        gate="v-measured",
    ),
    Setting(name="5s", stage=2, table="2-4", title="Δt = 0.1 s, Δt_D = 5 s", message_interval_s=5.0),
    Setting(name="10s", stage=2, table="2-4", title="Δt = 0.1 s, Δt_D = 10 s", message_interval_s=10.0),
    Setting(
        name="10s-slow", stage=2, table="2-4", title="Δt = 1 s, Δt_D = 10 s", message_interval_s=10.0, filter_step_s=1.0
    ),
    Setting(
        name="10s-beta10", stage=2, table="alternative", title="Δt = 0.1 s, Δt_D = 10 s, β = 10", like="10s",
        message_interval_s=10.0, beta_m2=10.0,
    ),
    Setting(
        name="10s-slow-beta10", stage=2, table="alternative", title="Δt = 1 s, Δt_D = 10 s, β = 10", like="10s-slow",
        message_interval_s=10.0, filter_step_s=1.0, beta_m2=10.0,
    ),
    Setting(
        name="10s-slow-beta300", stage=2, table="alternative", title="Δt = 1 s, Δt_D = 10 s, β = 300, T = 10",
        like="10s-slow", message_interval_s=10.0, filter_step_s=1.0, beta_m2=300.0, threshold_m=10.0,
    ),
    Setting(name="L1", stage=3, table="5", title="L = 1 m, H_T = 0.1 m", message_interval_s=5.0, baseline_m=1.0),
    Setting(
        name="HT0.2", stage=3, table="6", title="L = 2 m, H_T = 0.2 m", message_interval_s=5.0, middle_offset_m=0.2,
        variants=("laisn-3-2",),
    ),
    Setting(
        name="muD0.3", stage=4, table="text", title="μ_D = 0.3 m", message_interval_s=5.0, range_scale_mean_m=0.3
    ),
    Setting(
        name="tau0.03", stage=4, table="text", title="τ = 0.03 m for all transmitters", message_interval_s=5.0,
        tau_rear_m=0.03, tau_other_m=0.03,
    ),
    Setting(
        name="tau0.06", stage=4, table="text", title="τ = 0.06 m for all transmitters", message_interval_s=5.0,
        tau_rear_m=0.06, tau_other_m=0.06,
    ),
    Setting(
        name="asymmetric", stage=4, table="7", title="τ = 0.06 m rear, 0.01 m others", message_interval_s=5.0,
        tau_rear_m=0.06,
    ),
    Setting(name="heading2.5", stage=5, table="8", title="leader's compass 2.5° off", leader_heading_deg=2.5),
    Setting(name="heading5", stage=5, table="9", title="leader's compass 5° off", leader_heading_deg=5.0),
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
    others = setting.tau_other_m
    return Scenario(
        name=name,
        seed=seed,
        motion=motion,
        timing=Timing(filter_step_s=setting.filter_step_s, message_interval_s=setting.message_interval_s),
        leader=Leader(
            depth_m=LEADER_DEPTH, baseline_m=setting.baseline_m, middle_offset_m=setting.middle_offset_m
        ),
        followers=(follower,),
        sensors=Sensors(
            leader_heading_bias_deg=setting.leader_heading_deg,
            leader_heading_sigma_deg=HEADING_SPREAD * setting.leader_heading_deg,
        ),
        acoustics=Acoustics(
            range_tau_m=(setting.tau_rear_m, others, others),
            range_scale_mean_m=setting.range_scale_mean_m,
            range_scale_sigma_m=setting.range_scale_sigma_m,
        ),
        navigation=Navigation(
            variant=variant, beta_m2=setting.beta_m2, threshold_m=setting.threshold_m, gate=setting.gate
        ),
    )  # fmt: skip


def columns(setting: Setting) -> dict[str, str | float]:
    """The setting as columns of a table, named as in the published ones."""
    return {
        "table": setting.table,
        "stage": setting.stage,
        "setting": setting.name,
        "dt_s": setting.filter_step_s,
        "dt_range_s": setting.message_interval_s,
        "leader_length_m": setting.baseline_m,
        "h_t_m": setting.middle_offset_m,
        "tau_rear_m": setting.tau_rear_m,
        "tau_other_m": setting.tau_other_m,
        "mu_range_m": setting.range_scale_mean_m,
        "sigma_range_m": setting.range_scale_sigma_m,
        "mu_heading_leader_deg": setting.leader_heading_deg,
        "beta_m2": setting.beta_m2,
        "threshold_m": setting.threshold_m,
        "gate": setting.gate,
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
