"""What the tightly coupled navigator concludes: estimates with covariances that can be believed, and its hypotheses."""

from dataclasses import dataclass, fields

from laisn.arrays import Floats, Ints
from laisn.records import own_arrays
from laisn.tight.belief import KEPT
from laisn.tight.model import ABSENT, Model


def state_names(model: Model) -> tuple[str, ...]:
    """Names of the states in their order, with units."""
    names = ["x_m", "y_m", "log_bias_m_s", "compass_bias_rad", "range_scale_m"]
    if model.leader != ABSENT:
        names.append("leader_compass_bias_rad")
    if model.current != ABSENT:
        names += ["current_east_m_s", "current_north_m_s"]
    if model.offset != ABSENT:
        names += [f"offset_{i}_m" for i in range(2, model.transmitters + 1)]
    return tuple(names)


@dataclass(frozen=True, kw_only=True)
class TightEstimates:
    """The estimates of one follower in one mission: n steps (k = 1 … n), m messages, s states, h hypotheses at most.

    Raises ValueError naming the array whose shape disagrees.
    """

    state: Floats
    """Mean over the mixture after step k, shape (n, 4): x, y [m], vx, vy [m/s]."""
    covariance: Floats
    """Covariance of `state`, shape (n, 4, 4)."""
    message_step: Ints
    """Step k of each message, shape (m,)."""
    used: Ints
    """How many of its ranges the heaviest hypothesis used, shape (m,)."""
    nis: Floats
    """Squared residuals of the ranges used, in units of S, shape (m,): `used` on average if S is right; NaN if none."""
    names: tuple[str, ...]
    """Names of the s states, with units."""
    full_state: Floats
    """Mean over the mixture after each message, shape (m, s)."""
    full_sigma: Floats
    """Standard deviations of `full_state`, shape (m, s)."""
    weight: Floats
    """Weight of each hypothesis after each message, heaviest first, shape (m, h); 0 for none."""
    hypothesis: Floats
    """Position of each hypothesis, shape (m, h, 2), [m]; NaN for none."""
    hypothesis_covariance: Floats
    """Covariance of each hypothesis's position, shape (m, h, 2, 2), [m²]; NaN for none."""

    def __post_init__(self) -> None:
        n, m, s = self.state.shape[0], self.message_step.size, len(self.names)
        expected = {
            "state": (n, 4), "covariance": (n, 4, 4), "message_step": (m,), "used": (m,), "nis": (m,),
            "full_state": (m, s), "full_sigma": (m, s), "weight": (m, KEPT), "hypothesis": (m, KEPT, 2),
            "hypothesis_covariance": (m, KEPT, 2, 2),
        }  # fmt: skip
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name in expected and value.shape != expected[item.name]:
                raise ValueError(f"TightEstimates.{item.name} has shape {value.shape}, expected {expected[item.name]}")
        own_arrays(self)
