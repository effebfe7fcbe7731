"""Estimates of the tightly coupled navigator: states with covariances, and its hypotheses."""

from dataclasses import dataclass
from typing import ClassVar

from laisn.arrays import Floats, Ints
from laisn.estimates import Columns, Details, Estimates, FixKind, FurtherState, Hypotheses

HYPOTHESES = 4
"""Hypotheses that are kept from message to message."""
_STATES = (
    "x_m", "y_m", "log_bias_m_s", "compass_bias_rad", "range_scale_m", "leader_compass_bias_rad",
    "current_east_m_s", "current_north_m_s", "offset_2_m", "offset_3_m", "clock_offset_m", "clock_drift_m_s",
)  # fmt: skip
_KEPT = range(1, HYPOTHESES + 1)


def kind_of(received: int, used: int) -> FixKind:
    """Kind of a message by the number of ranges that were received with an estimate to test them, and used."""
    if received == 0:
        return FixKind.LOST
    if used == 0:
        return FixKind.GATED
    if used < received:
        return FixKind.PARTLY
    return FixKind.ONE_RANGE if used == 1 else FixKind.RANGES


@dataclass(frozen=True, kw_only=True)
class TightEstimates(Estimates):
    """The estimates of one follower in one mission, and what they rest on at each of its f messages.

    A message is a fix here: its position is the mean over the mixture, its σ the root of half the trace of their
    covariance; there is no innovation of a position, so that those are NaN. Raises ValueError naming an array of
    another shape.
    """

    DETAILS = Details(
        "mixture",
        (
            Columns("nis", ("nis",)),
            Columns("full_state", _STATES, (len(_STATES),)),
            Columns("full_sigma", tuple(f"sigma_{state}" for state in _STATES), (len(_STATES),)),
            Columns("weight", tuple(f"weight_{h}" for h in _KEPT), (HYPOTHESES,)),
            Columns("hypothesis", tuple(f"{axis}_{h}" for h in _KEPT for axis in "xy"), (HYPOTHESES, 2)),
            Columns(
                "hypothesis_covariance",
                tuple(f"covariance_{h}_{pair}" for h in _KEPT for pair in ("x_x", "x_y", "x_y", "y_y")),
                (HYPOTHESES, 2, 2),
            ),
            Columns("used", ("used",), integer=True),
        ),
    )
    names: ClassVar[tuple[str, ...]] = _STATES
    """Names of all states that there can be, with units."""

    used: Ints
    """How many of its ranges the heaviest hypothesis used, shape (f,)."""
    nis: Floats
    """Their squared residuals in units of S, shape (f,): `used` on average, if S is right; NaN if none was used,
    or nothing was expected of them."""
    full_state: Floats
    """Mean over the mixture after each message, shape (f, 12), in the order of `names`; NaN for what is no state."""
    full_sigma: Floats
    """Standard deviations of the states, shape (f, 12)."""
    weight: Floats
    """Weight of each hypothesis after each message, heaviest first, shape (f, HYPOTHESES); 0 for none."""
    hypothesis: Floats
    """Position of each, shape (f, HYPOTHESES, 2), [m]; NaN for none."""
    hypothesis_covariance: Floats
    """Its covariance, shape (f, HYPOTHESES, 2, 2), [m²]; NaN for none."""

    @property
    def hypotheses(self) -> Hypotheses:
        """Hypotheses, such as both sides of the leader's axis."""
        return Hypotheses(self.weight, self.hypothesis, self.hypothesis_covariance)

    def further_states(self) -> list[FurtherState]:
        """Biases of the sensors, current, offsets and clock after the last message."""
        if not self.fix_step.size:
            return []
        last = zip(self.names, self.full_state[-1].tolist(), self.full_sigma[-1].tolist(), strict=True)
        return [FurtherState(*state) for state in last][2:]
