"""A mission that was flown: scenario, truth, measurements and estimates together."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from laisn.estimates import Estimates
from laisn.messages import Measurements
from sim.scenario import CONTROL_STEP_S, Scenario
from sim.trajectory import Trajectory

Floats = npt.NDArray[np.float64]


class Outcome(Enum):
    """How a mission ended."""

    COMPLETED = "the mission was flown to its end"
    DIVERGED = "the simulation left finite numbers; everything up to that step is kept"
    INTERRUPTED = "the mission was interrupted; everything up to that step is kept"


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One mission, whole. Follower i is vehicle i + 1 of the trajectory.

    Raises ValueError if the numbers of followers disagree.
    """

    scenario: Scenario
    trajectory: Trajectory
    measurements: tuple[Measurements, ...]
    """One for each follower."""
    estimates: tuple[Estimates, ...]
    """One for each follower."""
    outcome: Outcome = Outcome.COMPLETED

    def __post_init__(self) -> None:
        followers = len(self.trajectory.names) - 1
        if not len(self.measurements) == len(self.estimates) == followers == len(self.scenario.followers):
            raise ValueError(
                f"a flight of {followers} followers needs as many measurements and estimates, got "
                f"{len(self.measurements)} and {len(self.estimates)}"
            )

    @property
    def stride(self) -> int:
        """Points of the trajectory from one filter step to the next."""
        return round(self.scenario.timing.filter_step_s / CONTROL_STEP_S)

    def step_index(self) -> npt.NDArray[np.int64]:
        """Index into the trajectory of filter steps k = 1 … n, shape (n,)."""
        n = self.measurements[0].speed.size
        return np.arange(1, n + 1, dtype=np.int64) * self.stride

    def hydrophone(self, follower: int) -> Floats:
        """True position of a follower's hydrophone at filter steps k = 1 … n, shape (n, 3), [m].

        This is the point that the follower estimates.
        """
        name = self.trajectory.names[follower + 1]
        return self.trajectory.site_position[self.step_index(), self.trajectory.site(f"{name}/hydrophone")]
