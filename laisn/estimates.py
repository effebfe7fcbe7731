"""What a navigator concludes: the kinds of fix, and the record of a mission; of the tightly
coupled one all states.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from laisn.arrays import (
    ArrayRecord,
    Floats,
    Ints,
    Records,
    freeze_arrays,
    records,
    require_shapes,
)


class FixKind(IntEnum):
    """How a message was turned into a position."""

    TWO_POINTS = 0  # two intersections; the one nearest to the prediction was taken
    TANGENT = 1  # one intersection
    ASTERN = 2  # no intersection, or two closer than T: snapped onto the leader's axis
    FUSED = 3  # weighted mean of several pairs (LAISN-3(2))
    GATED = 4  # rejected as a gross error: by the gate, or because no range was accepted
    SINGULAR = 5  # the filter was already exact (S singular): the update was skipped
    LOST = 6  # ranges were missing, so that no fix could be made
    # one range alone: the prediction was moved along its line of sight, onto the circle
    ONE_RANGE = 7
    # no point was made: all ranges that were received were used themselves (tightly coupled)
    RANGES = 8
    PARTLY = 9  # likewise, but others looked like echoes and were left out


FIX_WORDS = dict(
    zip(
        FixKind,
        (
            "two points",
            "tangent",
            "on the axis",
            "weighted mean",
            "rejected",
            "skipped",
            "lost",
            "one range",
            "all ranges",
            "but for echoes",
        ),
        strict=True,
    )
)
"""Names of the kinds of fix in tables, figures and films."""


class LogColumns(NamedTuple):
    """An array of estimates, shape (f, …), and the columns of the log that hold its numbers."""

    attribute: str
    # one for each number; those of equal numbers, as in a symmetric matrix, may be one
    names: tuple[str, ...]
    shape: tuple[int, ...] = ()  # of the array, for each message
    integer: bool = False


class Details(NamedTuple):
    """What estimates hold of each message beside the fix: a channel of the log, in SI units and
    radians.
    """

    name: str  # of the channel and, with a capital, of the type of its messages
    columns: tuple[LogColumns, ...]


@dataclass(frozen=True, kw_only=True)
class FixRecord:
    """The result of one fix, or of a message whose ranges a navigator uses themselves."""

    step: int
    position: Floats  # z, or the estimate after the message, shape (2,), [m]; NaN for none
    # σp as the filter was given it, or the root of half the trace of the estimate's covariance [m]
    sigma: float
    kind: FixKind
    innovation: Floats = field(default_factory=lambda: np.full(2, np.nan))
    """Fix less predicted position, shape (2,), [m]; NaN where no position was used."""
    innovation_covariance: Floats = field(default_factory=lambda: np.full((2, 2), np.nan))
    """Covariance of `innovation`, shape (2, 2), [m²]."""
    # what a subclass of `Estimates` adds, by attribute
    details: Mapping[str, Any] = field(default_factory=dict)


_FIX_COLUMNS: dict[str, tuple[tuple[int, ...], bool]] = {
    "fix_step": ((), True),
    "fix_position": ((2,), False),
    "fix_sigma": ((), False),
    "fix_kind": ((), True),
    "innovation": ((2,), False),
    "innovation_covariance": ((2, 2), False),
}
"""Arrays over fixes, of attributes of `FixRecord`, whose names lack "fix_": shape for each fix,
whether integers.
"""


@dataclass(frozen=True, kw_only=True, repr=False)
class Estimates(ArrayRecord):
    """The estimates of one follower in one mission: n steps (k = 1 … n) and f fixes.

    A message gives one fix; with LAISN-3(1) one of each pair that was received. A navigator that
    estimates more returns a subclass. Raises ValueError naming an array of another shape.
    """

    DETAILS: ClassVar[Details | None] = None
    """What a subclass has to log."""

    state: Floats  # state after step k, shape (n, 4): x, y [m], vx, vy [m/s]
    covariance: Floats  # covariance of `state`, shape (n, 4, 4)
    fix_step: Ints  # step k of each fix, shape (f,)
    fix_position: Floats  # position z of each fix, shape (f, 2), [m]; NaN where none could be made
    # confidence parameter σp as the filter was given it: with floor and inflation, shape (f,), [m]
    fix_sigma: Floats
    fix_kind: Ints  # `FixKind`, shape (f,)
    innovation: Floats  # position innovation z − H x̂ before the update, shape (f, 2), [m]
    innovation_covariance: Floats
    """S of the position update, shape (f, 2, 2), [m²]; of one range alone, its variance times
    the unit matrix.
    """

    @classmethod
    def of(cls, state: Floats, covariance: Floats, fixes: Sequence[FixRecord]) -> Self:
        """Estimates of n states and f fixes."""
        records = [{**vars(fix), **fix.details} for fix in fixes]
        arrays = dict[str, Any]()
        for name, (shape, integer) in cls._fix_columns().items():
            rows = [fix[name.removeprefix("fix_")] for fix in records]
            arrays[name] = np.array(rows, np.int64 if integer else np.float64).reshape(
                len(rows), *shape
            )
        return cls(state=state, covariance=covariance, **arrays)

    @classmethod
    def _fix_columns(cls) -> dict[str, tuple[tuple[int, ...], bool]]:
        detail_columns = cls.DETAILS.columns if cls.DETAILS else ()
        return _FIX_COLUMNS | {
            column.attribute: (column.shape, column.integer) for column in detail_columns
        }

    @classmethod
    def fix_dtype(cls) -> np.dtype[Any]:
        """One fix as compiled navigators record it: a field for each array over fixes."""
        return np.dtype(
            [
                (name, np.int64 if integer else np.float64, shape)
                for name, (shape, integer) in cls._fix_columns().items()
            ]
        )

    @property
    def hypotheses(self) -> tuple[Floats, Floats, Floats]:
        """Weight (0 for none), position [m] and covariance [m²] of the h hypotheses after each of f
        messages, the likeliest first; shapes (f, h), (f, h, 2), (f, h, 2, 2).
        """
        f = self.fix_step.size
        return np.empty((f, 0)), np.empty((f, 0, 2)), np.empty((f, 0, 2, 2))

    def further_states(self) -> list[tuple[str, float, float]]:
        """Name with unit, value and standard deviation of estimated constants after the last
        message; NaN for none.
        """
        return []

    @property
    def steps_without_estimate(self) -> int:
        """Steps before the first estimate: 0 where the start is known."""
        missing = np.isnan(self.state[:, 0])
        return missing.size if missing.all() else int(np.argmin(missing))

    def part(self, first: int, last: int) -> Self:
        """The estimates of steps `first` + 1 … `last`, which become 1 … `last` − `first`, and
        their fixes.
        """
        in_part = (self.fix_step > first) & (self.fix_step <= last)
        parts: dict[str, Any] = {f.name: getattr(self, f.name)[in_part] for f in fields(self)[2:]}
        parts["fix_step"] = parts["fix_step"] - first
        return replace(
            self, state=self.state[first:last], covariance=self.covariance[first:last], **parts
        )

    def __post_init__(self) -> None:
        n = self.state.shape[0]
        f = self.fix_step.size
        fix_shapes = {name: (f, *shape) for name, (shape, _) in self._fix_columns().items()}
        require_shapes(self, {"state": (n, 4), "covariance": (n, 4, 4), **fix_shapes})
        freeze_arrays(self)


class FixTable:
    """Fixes of one follower as they are made, in order of their steps; those of a day are in a file
    in place of memory.
    """

    def __init__(self, kind: type[Estimates]) -> None:
        """There is none yet; they are of estimates of some kind."""
        self._columns = {name: name.removeprefix("fix_") for name in kind.fix_dtype().names or ()}
        self._rows: Records = records(kind.fix_dtype(), _FIRST_FIXES)
        self._count = 0

    @property
    def rows(self) -> Records:
        """All fixes until now: records of `Estimates.fix_dtype`, shape (f,)."""
        return self._rows[: self._count]

    def extend(self, fixes: Iterable[FixRecord]) -> None:
        """Add fixes."""
        for fix in fixes:
            if self._count == len(self._rows):
                self._grow()
            values = {**vars(fix), **fix.details}
            row = self._rows[self._count]
            for column, attribute in self._columns.items():
                row[column] = values[attribute]
            self._count += 1

    def _grow(self) -> None:
        rows = records(self._rows.dtype, 2 * len(self._rows))
        rows[: self._count] = self._rows
        self._rows = rows


_FIRST_FIXES = 64
HYPOTHESES = 8  # that are kept from message to message
_STATES = (
    "x_m",
    "y_m",
    "log_bias_m_s",
    "compass_bias_rad",
    "range_scale_m",  # error in proportion to a range, at the largest range
    "leader_compass_bias_rad",
    "current_east_m_s",
    "current_north_m_s",
    "offset_2_m",  # constant error of ranges to the second transmitter, the next of the third
    "offset_3_m",
    "clock_offset_m",
    "clock_drift_m_s",
)
_HYPOTHESIS_NUMBERS = range(1, HYPOTHESES + 1)


@dataclass(frozen=True, kw_only=True)
class TightEstimates(Estimates):
    """Estimates of the tightly coupled navigator, whose f messages are fixes at the mean over
    the mixture.
    """

    DETAILS = Details(
        "mixture",
        (
            LogColumns("nis", ("nis",)),
            LogColumns("full_state", _STATES, (len(_STATES),)),
            LogColumns("full_sigma", tuple(f"sigma_{state}" for state in _STATES), (len(_STATES),)),
            LogColumns("weight", tuple(f"weight_{h}" for h in _HYPOTHESIS_NUMBERS), (HYPOTHESES,)),
            LogColumns(
                "hypothesis",
                tuple(f"{axis}_{h}" for h in _HYPOTHESIS_NUMBERS for axis in "xy"),
                (HYPOTHESES, 2),
            ),
            LogColumns(
                "hypothesis_covariance",
                tuple(
                    f"covariance_{h}_{pair}"
                    for h in _HYPOTHESIS_NUMBERS
                    for pair in ("x_x", "x_y", "x_y", "y_y")
                ),
                (HYPOTHESES, 2, 2),
            ),
            LogColumns("used", ("used",), integer=True),
        ),
    )
    names: ClassVar[tuple[str, ...]] = _STATES  # names of all states that there can be, with units

    # how many of its ranges the heaviest hypothesis used, shape (f,); one less where these have an
    # echo in common, whose excess is estimated of them
    used: Ints
    nis: Floats
    """Their squared residuals in units of S, shape (f,): `used` on average, if S is right; NaN if
    none was used, or nothing was expected of them."""
    full_state: Floats
    """Mean over the mixture after each message, shape (f, 12), in the order of `names`; NaN for
    what is no state.
    """
    full_sigma: Floats  # standard deviations of the states, shape (f, 12)
    # weight of each hypothesis after each message, heaviest first, shape (f, HYPOTHESES); 0 for
    # none
    weight: Floats
    hypothesis: Floats  # position of each, shape (f, HYPOTHESES, 2), [m]; NaN for none
    hypothesis_covariance: Floats  # its covariance, shape (f, HYPOTHESES, 2, 2), [m²]; NaN for none

    @property
    def hypotheses(self) -> tuple[Floats, Floats, Floats]:
        """Hypotheses, such as both sides of the leader's axis."""
        return self.weight, self.hypothesis, self.hypothesis_covariance

    def further_states(self) -> list[tuple[str, float, float]]:
        """Biases of the sensors, current, offsets and clock after the last message."""
        if not self.fix_step.size:
            return []
        return [
            *zip(
                self.names, self.full_state[-1].tolist(), self.full_sigma[-1].tolist(), strict=True
            )
        ][2:]
