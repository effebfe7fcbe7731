"""The design of a study: factors and the points of their values, and draws, keys that vary by
realization.

A draw is a function of (seed of the study, number of the realization, key): another key, point or
worker changes none.
"""

import hashlib
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError
from scipy.special import ndtri

from sim.scenario.formation import Scatter, scattered_followers
from sim.scenario.point_motion import CLASSES, random_waypoints

Design = Literal["factorial", "latin-hypercube", "sobol"]

_RANGE = ("from", "to", "steps", "scale")
# values that follow the run, other keys of the study, or the mission
RULES = ("cycle", "rotate", "sum", "measured")
_POINTS_KEY = 0x0D  # first of the numbers that seed the points of sampled designs


def _tidy(value: float) -> float | int:
    """A value of a range's steps as written by hand: 0.3 and not 0.30000000000000004."""
    rounded = float(f"{value:.12g}")
    return int(rounded) if rounded.is_integer() and abs(rounded) < 1e15 else rounded


def is_number(value: object) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


@dataclass(frozen=True, kw_only=True)
class Factor:
    """A key of the scenario and the values that it takes."""

    key: str
    # values in their order; empty: the whole range, for a sampled design
    values: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 0.0
    log: bool = False

    @classmethod
    def of(cls, key: str, values: object, *, sampled: bool = False) -> "Factor":
        """A factor as a file gives it: a list of values, or a table with `from`, `to`, `steps` and
        `scale`.

        A sampled design draws values from the range, so that it needs no steps. ValueError states
        what was expected.
        """
        if isinstance(values, list):
            if not values:
                raise ValueError("the list of values is empty")
            if len({repr(value) for value in values}) < len(values):
                raise ValueError("a value stands in the list twice")
            return cls(key=key, values=tuple(values))
        factor = cls._from_range(key, values)
        if sampled:
            return factor
        steps = values.get("steps") if isinstance(values, dict) else None
        if not isinstance(steps, int) or isinstance(steps, bool) or not 2 <= steps <= 10_000:
            raise ValueError(f"steps must be a whole number, 2 to 10000 (given: {steps!r})")
        return replace(
            factor,
            values=tuple(_tidy(factor.value_at_share(i / (steps - 1))) for i in range(steps)),
        )

    @classmethod
    def _from_range(cls, key: str, table: object) -> "Factor":
        """The whole range of a table."""
        if not isinstance(table, dict) or not {"from", "to"} <= table.keys():
            raise ValueError(
                f"expected a list, or a table with from, to and steps (given: {table!r:.60})"
            )
        unknown = sorted(table.keys() - set(_RANGE))
        if unknown:
            raise ValueError(
                f"unknown {', '.join(unknown)} of a range; known here: {', '.join(_RANGE)}"
            )
        low = table["from"]
        high = table["to"]
        scale = table.get("scale", "linear")
        if not is_number(low) or not is_number(high) or low == high:
            raise ValueError(
                f"from and to must be two different numbers (given: {low!r}, {high!r})"
            )
        if scale != "linear" and (scale != "log" or min(low, high) <= 0):
            raise ValueError(
                f'scale must be "linear", or "log" with positive ends (given: {scale!r})'
            )
        return cls(key=key, low=float(low), high=float(high), log=scale == "log")

    def value_at_share(self, share: float) -> Any:
        """The value a share of the way, 0 … 1, through the list or range."""
        if self.values:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + (self.high - self.low) * share)


def points_of(
    factors: Sequence[Factor], design: Design, number: int | None, seed: int, max_points: int
) -> list[dict[str, Any]]:
    """The points of a design, values by key: every combination, or `number` points that fill the
    ranges evenly.

    `max_points` is compared before any point is made. ValueError: the number does not suit the
    design, or is larger.
    """
    if design == "factorial":
        count = math.prod(len(factor.values) for factor in factors)
    else:
        count = number or 0
    if count > max_points:
        raise ValueError(
            f"{count:,} points, at most {max_points:,} with these arms and realizations"
        )
    if design != "factorial":
        return _sampled_points(factors, design, number, seed)
    if number is not None:
        raise ValueError('points belongs to design = "latin-hypercube" or "sobol"')
    keys = [factor.key for factor in factors]
    combinations = itertools.product(*(factor.values for factor in factors))
    return [dict(zip(keys, values, strict=True)) for values in combinations]


def _sampled_points(
    factors: Sequence[Factor], design: Design, number: int | None, seed: int
) -> list[dict[str, Any]]:
    if not factors:
        raise ValueError(f"a {design} design needs factors in [vary]")
    if number is None or number < 2:
        raise ValueError(f"a {design} design needs points, at least 2 (given: {number})")
    if design == "sobol" and number & (number - 1):
        power_of_two = 2 ** round(math.log2(number))
        raise ValueError(
            f"a sobol design has a power of two points, such as {power_of_two} (given: {number})"
        )
    # as in `_distribution_quantile`
    from scipy.stats import qmc

    random = np.random.default_rng([_POINTS_KEY, seed])
    sampler = qmc.LatinHypercube if design == "latin-hypercube" else qmc.Sobol
    shares = sampler(d=len(factors), rng=random).random(number)
    return [
        {f.key: f.value_at_share(float(share)) for f, share in zip(factors, row, strict=True)}
        for row in shares
    ]


def is_rule(value: object, *names: str) -> bool:
    """Whether a value is a table with one of these names alone, of any rule unless some are
    given.
    """
    return (
        isinstance(value, Mapping) and len(value) == 1 and bool({*(names or RULES)} & value.keys())
    )


def follows_run(value: object) -> bool:
    """Whether a value of the scenario differs from run to run."""
    return is_rule(value, "cycle", "rotate")


def value_at(value: Any, run: int) -> Any:
    """The value that a run has: of `cycle` the list's values in turn, of `rotate` that angle
    further each run, in °.

    Both spread evenly over few runs, the golden angle, 137.508°, over any number. ValueError states
    what was expected.
    """
    if not follows_run(value):
        return value
    ((name, argument),) = value.items()
    if name == "cycle" and isinstance(argument, list) and argument:
        return argument[run % len(argument)]
    if name == "rotate" and is_number(argument):
        return run * argument % 360
    raise ValueError(
        f"expected {{ cycle = [value, …] }} or {{ rotate = degrees }} (given: {value!r:.60})"
    )


_DRAW_KEY = 0xD3A3  # first of the numbers that seed a draw
_LIST_DISTRIBUTIONS: Mapping[str, tuple[str, Callable[..., tuple[float, ...]]]] = {
    "uniform": ("[low, high]", lambda low, high: (low, high - low)),
    "normal": ("[mean, sigma]", lambda mean, sigma: (mean, sigma)),
    "truncnorm": ("[mean, sigma, low, high]", lambda mean, sigma, low, high: (
        (low - mean) / sigma, (high - mean) / sigma, mean, sigma)),
}  # fmt: skip
"""Distributions whose parameters may stand in a list, and those of scipy.stats that they are."""
_SCIPY_NAMES = (
    "bernoulli",
    "beta",
    "binom",
    "cauchy",
    "expon",
    "gamma",
    "geom",
    "gumbel_l",
    "gumbel_r",
    "invgamma",
    "laplace",
    "logistic",
    "lognorm",
    "norm",
    "pareto",
    "poisson",
    "randint",
    "rayleigh",
    "t",
    "triang",
    "truncnorm",
    "uniform",
    "vonmises",
    "weibull_min",
)
"""Distributions of scipy.stats that a table of parameters names: their quantiles take
microseconds at any parameter.
"""
_MAX_NUMBER = 1e9  # of parameters
Quantile = Callable[[float, list[int]], Any]
"""The value at a share, 0 … 1, of a probability law. The second argument, the address, are numbers
that seed a generator, for what needs more than one random number.
"""


_STANDARD_QUANTILES: Mapping[str, Callable[[float], float]] = {"uniform": float, "normal": ndtri}
"""Quantiles at location 0 and scale 1, as scipy.stats has them, of laws that most draws name."""


def _quantile_without_stats(name: str, location: float, scale: float) -> Quantile | None:
    """Of a law of `_STANDARD_QUANTILES`; None if it has no values with this scale."""
    if scale <= 0.0:
        return None
    standard = _STANDARD_QUANTILES[name]
    return lambda share, _: float(standard(share) * scale + location)


def _require_bounded(name: str, parameters: Iterable[Any]) -> None:
    """ValueError if a parameter is no number, or too large."""
    for value in parameters:
        if not is_number(value) or abs(value) > _MAX_NUMBER:
            raise ValueError(
                f"{name}: a parameter is a number within ±{_MAX_NUMBER:g} (given: {value!r:.60})"
            )


def _distribution_quantile(name: str, parameters: object) -> Quantile:
    form, make = _LIST_DISTRIBUTIONS.get(name, ("a table of its parameters in scipy.stats", None))
    expected = f"{name} expects {form} (given: {parameters!r:.60})"
    if not isinstance(parameters, dict) and not (isinstance(parameters, list) and make):
        raise ValueError(expected)
    _require_bounded(name, parameters.values() if isinstance(parameters, dict) else parameters)
    if isinstance(parameters, list) and len(parameters) != form.count(",") + 1:
        raise ValueError(expected)
    no_values = f"{expected}, and has no values with these parameters"
    if isinstance(parameters, list) and make and name in _STANDARD_QUANTILES:
        quantile = _quantile_without_stats(name, *make(*parameters))
        if quantile is None:
            raise ValueError(no_values)
        return quantile
    # 45 MB and a second to import
    from scipy import stats

    family: Any = getattr(stats, "norm" if name == "normal" else name)
    try:
        law = family(**parameters) if isinstance(parameters, dict) else family(*make(*parameters))  # type: ignore[misc]
    except (TypeError, ZeroDivisionError) as error:
        raise ValueError(f"{expected}: {error}") from None
    if not np.isfinite(law.ppf([0.01, 0.5, 0.99])).all():
        raise ValueError(no_values)
    kind = int if isinstance(law.dist, stats.rv_discrete) else float
    return lambda share, _: kind(law.ppf(share))


def _choice_quantile(values: object) -> Quantile:
    if not isinstance(values, list) or not values:
        raise ValueError(f"choice expects a list of values (given: {values!r:.60})")
    return lambda share, _: values[int(share * len(values))]


def _route_class_quantile(name: object) -> Quantile:
    if name != "any" and name not in CLASSES:
        raise ValueError(f"route_class expects any, {', '.join(CLASSES)} (given: {name!r:.60})")
    names = tuple(CLASSES) if name == "any" else (str(name),)
    return lambda share, address: random_waypoints(names[int(share * len(names))], address)


def _formation_quantile(arguments: object) -> Quantile:
    try:
        area = Scatter.model_validate(arguments)
    except ValidationError as error:
        first = error.errors()[0]
        expected = f"a table with {', '.join(Scatter.model_fields)}"
        raise ValueError(
            f"formation expects {expected}; {'.'.join(map(str, first['loc']))}: {first['msg']}"
        ) from None
    scattered_followers(area, [0])
    return lambda _, address: scattered_followers(area, address)


LAWS: Mapping[str, Callable[[object], Quantile]] = {
    "choice": _choice_quantile,
    "route_class": _route_class_quantile,
    "formation": _formation_quantile,
    **{
        name: partial(_distribution_quantile, name)
        for name in sorted({*_LIST_DISTRIBUTIONS, *_SCIPY_NAMES})
    },
}
"""Probability laws of draws by their names: each makes a quantile of its parameters."""


@dataclass(frozen=True, kw_only=True)
class Draw:
    """A key of the scenario whose value every realization draws."""

    key: str
    law: str  # name and parameters, for comparisons
    quantile: Quantile = field(compare=False)

    @classmethod
    def of(cls, key: str, distribution: object) -> "Draw":
        """A draw as a file gives it: a table of one law's name and parameters; ValueError states
        what was expected.
        """
        if not isinstance(distribution, dict) or len(distribution) != 1:
            raise ValueError(
                f"expected one distribution, such as {{ uniform = [0.2, 0.8] }} (given: "
                f"{distribution!r:.60})"
            )
        ((name, parameters),) = distribution.items()
        if name not in LAWS:
            raise ValueError(f"unknown distribution {name!r:.40}; available: {', '.join(LAWS)}")
        return cls(key=key, law=f"{name} {parameters}", quantile=LAWS[name](parameters))

    def value(self, seed: int, realization: int) -> Any:
        """What a realization has of it."""
        hashed = int.from_bytes(hashlib.sha256(self.key.encode()).digest()[:8], "big")
        address = [_DRAW_KEY, seed, realization, hashed]
        return self.quantile(float(np.random.default_rng(address).random()), [*address, 1])
