"""What pitch, and what a remedy, does to the mean error of a mission: arms of the same mission put together."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from experiments.asymmetry.missions import Row
from experiments.asymmetry.remedies import LEVEL, REAL, Arm
from experiments.asymmetry.verdict import Verdict, verdict

Floats = npt.NDArray[np.float64]

SMALLEST_PART_M = 0.02
"""Missions in which pitch does less than this to the mean error say nothing about a remedy."""
Mission = tuple[str, str, float, str]
"""Condition, route, depth offset, variant."""


@dataclass(frozen=True, kw_only=True)
class Excess:
    """One mission in all its arms, by their keys."""

    level: Row
    real: Row
    arms: dict[str, Row]

    @property
    def part(self) -> float:
        """The pitch-driven part of the mean position error [m]."""
        return self.real.e_p_mean_m - self.level.e_p_mean_m

    def left(self, arm: Arm, base: Arm = LEVEL) -> float:
        """What a remedy leaves of it, against a level leader without equipment, or with that of another arm [m]."""
        return self.arms[arm.key].e_p_mean_m - self.arms[base.key].e_p_mean_m

    def removed(self, arm: Arm) -> float:
        """Share of the pitch-driven part that a remedy removes."""
        return 1.0 - self.left(arm) / self.part

    def verdict(self, arm: Arm, missions: int = 1, base: Arm = LEVEL) -> Verdict:
        """Whether the remedy removes the share that it should; `missions` are judged together."""
        return verdict(self._runs(REAL) - self._runs(LEVEL), self._runs(arm) - self._runs(base), arm.wanted, missions)

    def _runs(self, arm: Arm) -> Floats:
        return np.array(self.arms[arm.key].e_p_run_mean_m)

    @property
    def lever(self) -> float:
        """Δz sin φ, both root mean square [m]."""
        return self.real.depth_offset_rms_m * float(np.sin(np.deg2rad(self.real.pitch_rms_deg)))


def paired(rows: Iterable[Row]) -> dict[Mission, Excess]:
    """Rows of the same mission, put together."""
    found: dict[Mission, dict[str, Row]] = {}
    for row in rows:
        found.setdefault((row.condition, row.route, row.depth_offset_m, row.variant), {})[row.arm] = row
    return {mission: Excess(level=arms[LEVEL.key], real=arms[REAL.key], arms=arms) for mission, arms in found.items()}


def mean_of(values: Iterable[float]) -> float:
    """Mean of those that are numbers; NaN if none is."""
    given = [v for v in values if not np.isnan(v)]
    return float(np.mean(given)) if given else float("nan")


def driven(missions: dict[Mission, Excess], variant: str, cause: str | None = None) -> list[Excess]:
    """Missions of a variant in which pitch does something, of one cause or of all."""
    return [
        e
        for (_, _, _, flown), e in missions.items()
        if flown == variant and e.part >= SMALLEST_PART_M and cause in (None, e.real.cause)
    ]


def removed_in_all(missions: Sequence[Excess], arm: Arm, base: Arm = LEVEL) -> float:
    """Share of the pitch-driven parts of missions, added up, that a remedy removes; `base` as in `Excess.left`."""
    return 1.0 - sum(e.left(arm, base) for e in missions) / sum(e.part for e in missions)
