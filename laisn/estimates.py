"""What a navigator concludes: the kinds of fix, and the record of a mission; of the tightly coupled one all states."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from laisn.arrays import ArrayRecord, Floats, Ints, own_arrays, require_shapes


class FixKind(IntEnum):
    """How a message was turned into a position."""

    TWO_POINTS = 0
    """Two intersections; the one nearest to the prediction was taken."""
    TANGENT = 1
    """One intersection."""
    ASTERN = 2
    """No intersection, or two closer than T: snapped onto the leader's axis."""
    FUSED = 3
    """Weighted mean of several pairs (LAISN-3(2))."""
    GATED = 4
    """Rejected as a gross error: by the gate, or because no range was accepted."""
    SINGULAR = 5
    """The filter was already exact (S singular): the update was skipped."""
    LOST = 6
    """Ranges were missing, so that no fix could be made."""
    ONE_RANGE = 7
    """One range alone: the prediction was moved along its line of sight, onto the circle."""
    RANGES = 8
    """No point was made: all ranges that were received were used themselves (tightly coupled)."""
    PARTLY = 9
    """No point was made: some ranges were used themselves, others looked like echoes and were left out."""


FIX_WORDS = {
    FixKind.TWO_POINTS: "two points",
    FixKind.TANGENT: "tangent",
    FixKind.ASTERN: "on the axis",
    FixKind.FUSED: "weighted mean",
    FixKind.GATED: "rejected",
    FixKind.SINGULAR: "skipped",
    FixKind.LOST: "lost",
    FixKind.ONE_RANGE: "one range",
    FixKind.RANGES: "all ranges",
    FixKind.PARTLY: "but for echoes",
}
"""Names of the kinds of fix in tables, figures and films."""


class Hypotheses(NamedTuple):
    """Positions that are possible after each of f messages, the likeliest first: at most h, which may be 0."""

    weight: Floats
    """Shape (f, h); 0 for none."""
    position: Floats
    """Shape (f, h, 2), [m]; NaN for none."""
    covariance: Floats
    """Of the position, shape (f, h, 2, 2), [m²]; NaN for none."""


class Columns(NamedTuple):
    """An array of estimates, shape (f, …), and the columns of the log that hold its numbers."""

    attribute: str
    names: tuple[str, ...]
    """One for each number; those of equal numbers, as in a symmetric matrix, may be one."""
    shape: tuple[int, ...] = ()
    """Of the array, for each message."""
    integer: bool = False


class Details(NamedTuple):
    """What estimates hold of each message beside the fix: a channel of the log, in SI units and radians."""

    name: str
    """Of the channel and, with a capital, of the type of its messages."""
    columns: tuple[Columns, ...]


class FurtherState(NamedTuple):
    """An estimated quantity beside position and velocity."""

    name: str
    """With its unit in SI."""
    value: float
    sigma: float
    """Standard deviation; both are NaN for what is no state."""


@dataclass(frozen=True, kw_only=True)
class FixRecord:
    """The result of one fix, or of a message whose ranges a navigator uses themselves."""

    step: int
    position: Floats
    """z, or the estimate after the message, shape (2,), [m]; NaN for none."""
    sigma: float
    """σp as the filter was given it, or the root of half the trace of the estimate's covariance [m]."""
    kind: FixKind
    innovation: Floats = field(default_factory=lambda: np.full(2, np.nan))
    """Fix less predicted position, shape (2,), [m]; NaN where no position was used."""
    innovation_covariance: Floats = field(default_factory=lambda: np.full((2, 2), np.nan))
    """Covariance of `innovation`, shape (2, 2), [m²]."""


_FIX_ARRAYS: dict[str, tuple[str, tuple[int, ...], type]] = {
    "fix_step": ("step", (), np.int64),
    "fix_position": ("position", (2,), np.float64),
    "fix_sigma": ("sigma", (), np.float64),
    "fix_kind": ("kind", (), np.int64),
    "innovation": ("innovation", (2,), np.float64),
    "innovation_covariance": ("innovation_covariance", (2, 2), np.float64),
}
"""Arrays of `Estimates` over fixes: attribute of `FixRecord`, shape for each fix, type."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Estimates(ArrayRecord):
    """The estimates of one follower in one mission: n steps (k = 1 … n) and f fixes.

    A message gives one fix; with LAISN-3(1) one of each pair that was received. A navigator that estimates more returns
    a subclass. Raises ValueError naming an array of another shape.
    """

    DETAILS: ClassVar[Details | None] = None
    """What a subclass has to log."""

    state: Floats
    """State after step k, shape (n, 4): x, y [m], vx, vy [m/s]."""
    covariance: Floats
    """Covariance of `state`, shape (n, 4, 4)."""
    fix_step: Ints
    """Step k of each fix, shape (f,)."""
    fix_position: Floats
    """Position z of each fix, shape (f, 2), [m]; NaN where none could be made."""
    fix_sigma: Floats
    """Confidence parameter σp as the filter was given it: with floor and inflation, shape (f,), [m]."""
    fix_kind: Ints
    """`FixKind`, shape (f,)."""
    innovation: Floats
    """Position innovation z − H x̂ before the update, shape (f, 2), [m]."""
    innovation_covariance: Floats
    """S of the position update, shape (f, 2, 2), [m²]; of one range alone, its variance times the unit matrix."""

    @classmethod
    def of(cls, state: Floats, covariance: Floats, fixes: Sequence[FixRecord], **more: Any) -> Self:
        """Estimates of n states and f fixes; `more` are the arrays that a subclass adds."""
        arrays: dict[str, Any] = {
            name: np.array([getattr(fix, attribute) for fix in fixes], kind).reshape(len(fixes), *shape)
            for name, (attribute, shape, kind) in _FIX_ARRAYS.items()
        }
        return cls(state=state, covariance=covariance, **arrays, **more)

    @classmethod
    def details(cls) -> tuple[Columns, ...]:
        """Arrays that a subclass adds."""
        return cls.DETAILS.columns if cls.DETAILS else ()

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape that each array must have."""
        n, f = self.state.shape[0], self.fix_step.size
        return {
            "state": (n, 4),
            "covariance": (n, 4, 4),
            **{name: (f, *shape) for name, (_, shape, _) in _FIX_ARRAYS.items()},
            **{column.attribute: (f, *column.shape) for column in self.details()},
        }

    @property
    def hypotheses(self) -> Hypotheses:
        """What is possible after each message, of a navigator that keeps several hypotheses; otherwise of h = 0."""
        f = self.fix_step.size
        return Hypotheses(np.empty((f, 0)), np.empty((f, 0, 2)), np.empty((f, 0, 2, 2)))

    def further_states(self) -> list[FurtherState]:
        """Biases and other constants after the last message, of a navigator that estimates them."""
        return []

    @property
    def unknown(self) -> int:
        """Steps before the first estimate: 0 where the start is known."""
        missing = np.isnan(self.state[:, 0])
        return missing.size if missing.all() else int(np.argmin(missing))

    def part(self, first: int, last: int) -> Self:
        """The estimates of steps `first` + 1 … `last`, which become 1 … `last` − `first`, and their fixes."""
        kept = (self.fix_step > first) & (self.fix_step <= last)
        parts: dict[str, Any] = {f.name: getattr(self, f.name)[kept] for f in fields(self)[2:]}
        parts["fix_step"] = parts["fix_step"] - first
        return replace(self, state=self.state[first:last], covariance=self.covariance[first:last], **parts)

    def __post_init__(self) -> None:
        require_shapes(self, self.shapes())
        own_arrays(self)


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
