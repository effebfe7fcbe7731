"""Settings of the reproduction and their scenarios, as its study file has them."""

from functools import reduce
from typing import Any, NamedTuple

from experiments.study.file import built_in_files, study_of
from experiments.study.plan import PlanEntry, plan_of

FILES = built_in_files("reproduce")
STUDY = study_of(str(FILES["tables"]), {})
COLUMNS = {
    "dt_s": "timing.filter_step_s",
    "dt_range_s": "timing.message_interval_s",
    "leader_length_m": "leader.baseline_m",
    "h_t_m": "leader.middle_offset_m",
    "tau_rear_m": "acoustics.range_tau_m.0",
    "tau_other_m": "acoustics.range_tau_m.1",
    "mu_range_m": "acoustics.range_scale_mean_m",
    "sigma_range_m": "acoustics.range_scale_sigma_m",
    "range_error_centred": "acoustics.range_error_centred",
    "mu_heading_leader_deg": "sensors.leader_heading_bias_deg",
    "beta_m2": "navigation.beta_m2",
    "threshold_m": "navigation.threshold_m",
    "gate": "navigation.gate",
}
"""Columns of the published tables, and the keys of a scenario that they hold."""


class Setting(NamedTuple):
    """A setting of the paper's tables, as a case of the study file labels it."""

    name: str
    title: str
    stage: int
    table: str
    like: str  # name of the setting whose published figures it is compared with, if not its own
    variants: tuple[str, ...]

    @property
    def printed(self) -> bool:
        """Whether the paper has a table of it."""
        return self.table not in ("text", "alternative")


SETTINGS = [
    Setting(name, case.title, variants=tuple(case.arms), **case.labels)  # type: ignore[arg-type]
    for name, case in STUDY.cases.items()
]


def entries(**keys: Any) -> dict[tuple[str, str, str], PlanEntry]:
    """Entries of the tables by setting, mission and variant."""
    plan = plan_of(study_of(str(FILES["tables"]), {"runs": 1, **keys}))
    return {
        (plan.points[entry.point]["case"], entry.source, entry.arm): entry for entry in plan.entries
    }


ENTRIES = entries()


def columns(setting: str) -> dict[str, Any]:
    """The setting as columns named as in the published tables."""
    table: Any = ENTRIES[setting, "T5", "laisn-3-2"].scenario.model_dump()

    def item_of(section: Any, name: str) -> Any:
        return section[int(name) if name.isdigit() else name]

    return {name: reduce(item_of, key.split("."), table) for name, key in COLUMNS.items()}
