"""What claims are judged on: figures of many cells, and the verdict that a test comes to."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from experiments.campaign.store import Steps
from experiments.reproduction.stages import Key
from laisn.arrays import Floats
from laisn.settings import Variant

Verdict = Literal["holds", "does not hold", "depends", "no data"]


@dataclass(frozen=True, kw_only=True)
class Results:
    """Figures of many cells, by setting, mission and variant."""

    rows: Mapping[Key, Mapping[str, float]]
    missions: Sequence[str]
    steps: Mapping[Key, Steps] = field(default_factory=dict)
    lateral: Sequence[str] = ("T3", "T4")
    """Missions of followers that stay abeam; the defaults are those that the paper names."""
    astern: Sequence[str] = ("T2", "T5")
    """Missions of followers that are astern for long."""
    burst: Sequence[str] = ("T8",)
    """Missions with a burst of speed."""

    def value(self, setting: str, mission: str, variant: Variant, metric: str) -> float:
        """One figure; NaN if there is none."""
        return float(self.rows.get((setting, mission, variant), {}).get(metric, np.nan))

    def values(self, setting: str, variant: Variant, metric: str, missions: Iterable[str] | None = None) -> Floats:
        """One figure of all missions, shape (m,)."""
        return np.array(
            [self.value(setting, m, variant, metric) for m in (self.missions if missions is None else missions)]
        )

    def among(self, group: Sequence[str]) -> list[str]:
        """Missions of a group, as often as they occur."""
        return [m for m in self.missions if m in group]

    def others(self, group: Sequence[str]) -> list[str]:
        """Missions that are not of a group."""
        return [m for m in self.missions if m not in group]


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What became of a claim."""

    verdict: Verdict
    figures: str
    """The numbers behind it."""
