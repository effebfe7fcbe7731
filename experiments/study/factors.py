"""Factors of a study and the points of its design: lists and ranges of values, in every combination or sampled."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.stats import qmc

Design = Literal["factorial", "latin-hypercube", "sobol"]

_RANGE = ("from", "to", "steps", "scale")
_POINTS_KEY = 0x0D
"""Keeps the random numbers of designs apart from those of seas."""


def _tidy(value: float) -> float | int:
    """A grid value as somebody would write it: 0.3 and not 0.30000000000000004."""
    rounded = float(f"{value:.12g}")
    return int(rounded) if rounded.is_integer() and abs(rounded) < 1e15 else rounded


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A key of the scenario and the values that it takes."""

    key: str
    values: tuple[Any, ...] = ()
    """Values in their order; empty: the whole range, for a sampled design."""
    low: float = 0.0
    high: float = 0.0
    log: bool = False

    @classmethod
    def of(cls, key: str, given: object, *, sampled: bool = False) -> "Factor":
        """A factor as a file gives it.

        Args:
            key: of the scenario.
            given: a list of values, or a table with `from`, `to`, `steps` and `scale` ("linear" or "log").
            sampled: the design draws values from the range, so that it needs no steps.

        Raises:
            ValueError: says what was expected.
        """
        if isinstance(given, list):
            if not given:
                raise ValueError("the list of values is empty")
            if len({repr(value) for value in given}) < len(given):
                raise ValueError("a value stands in the list twice")
            return cls(key=key, values=tuple(given))
        if not isinstance(given, dict) or not {"from", "to"} <= set(given):
            raise ValueError(f"expected a list, or a table with from, to and steps (given: {given!r:.60})")
        unknown = sorted(set(given) - set(_RANGE))
        if unknown:
            raise ValueError(f"unknown {', '.join(unknown)} of a range; known here: {', '.join(_RANGE)}")
        low, high, scale, steps = given["from"], given["to"], given.get("scale", "linear"), given.get("steps")
        if not _is_number(low) or not _is_number(high) or low == high:
            raise ValueError(f"from and to must be two different numbers (given: {low!r}, {high!r})")
        if scale not in ("linear", "log"):
            raise ValueError(f'scale must be "linear" or "log" (given: {scale!r})')
        if scale == "log" and not (low > 0 and high > 0):
            raise ValueError(f"a logarithmic range needs positive ends (given: {low!r}, {high!r})")
        whole = cls(key=key, low=float(low), high=float(high), log=scale == "log")
        if sampled:
            return whole
        if not isinstance(steps, int) or isinstance(steps, bool) or not 2 <= steps <= 10_000:
            raise ValueError(f"steps must be a whole number, 2 to 10000 (given: {steps!r})")
        grid = tuple(_tidy(whole.at(i / (steps - 1))) for i in range(steps))
        return cls(key=key, values=grid, low=whole.low, high=whole.high, log=whole.log)

    def at(self, share: float) -> Any:
        """The value a share of the way, 0 … 1, through the list or range."""
        if self.values:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + (self.high - self.low) * share)


def points_of(
    factors: Sequence[Factor], design: Design, number: int | None, seed: int, most: int
) -> list[dict[str, Any]]:
    """The points of a design, values by key.

    Args:
        factors: of the study.
        design: every combination of the values ("factorial"), or `number` points that fill the ranges evenly.
        number: of points of a sampled design.
        seed: of a sampled design.
        most: largest number of points; it is compared before any point is made.

    Raises:
        ValueError: the number does not suit the design, or is larger than `most`.
    """
    count = math.prod(len(factor.values) for factor in factors) if design == "factorial" else number or 0
    if count > most:
        raise ValueError(f"{count:,} points, at most {most:,} with these arms and seas")
    if design == "factorial":
        if number is not None:
            raise ValueError('points belongs to design = "latin-hypercube" or "sobol"')
        combinations = itertools.product(*(factor.values for factor in factors))
        return [dict(zip((f.key for f in factors), values, strict=True)) for values in combinations]
    if not factors:
        raise ValueError(f"a {design} design needs factors in [vary]")
    if number is None or number < 2:
        raise ValueError(f"a {design} design needs points, at least 2 (given: {number})")
    if design == "sobol" and number & (number - 1):
        near = 2 ** round(math.log2(number))
        raise ValueError(f"a sobol design has a power of two points, such as {near} (given: {number})")
    random = np.random.default_rng([_POINTS_KEY, seed])
    sampler = qmc.LatinHypercube if design == "latin-hypercube" else qmc.Sobol
    shares = sampler(d=len(factors), rng=random).random(number)
    return [{f.key: f.at(float(share)) for f, share in zip(factors, row, strict=True)} for row in shares]
