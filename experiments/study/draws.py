"""Draws of a study: keys of the scenario that every sea has anew, as distributions.

A draw is a function of (seed of the study, number of the sea, key): another key, point, arm or worker changes none.
"""

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import stats

from sim.scenario.random_routes import CLASSES, random_waypoints

_DRAW_KEY = 0xD3A3
"""Keeps these random numbers apart from all others that come from the same seed."""


def _uniform(low: float, high: float) -> Any:
    if not low < high:
        raise ValueError(f"uniform expects [low, high] (given: [{low:g}, {high:g}])")
    return stats.uniform(low, high - low)


def _normal(mean: float, sigma: float) -> Any:
    return stats.norm(mean, sigma)


def _truncnorm(mean: float, sigma: float, low: float, high: float) -> Any:
    if not sigma > 0 or not low < high:
        raise ValueError(f"truncnorm expects [mean, sigma, low, high] (given: {[mean, sigma, low, high]})")
    return stats.truncnorm((low - mean) / sigma, (high - mean) / sigma, mean, sigma)


_LISTED: Mapping[str, tuple[Callable[..., Any], str]] = {
    "uniform": (_uniform, "[low, high]"),
    "normal": (_normal, "[mean, sigma]"),
    "truncnorm": (_truncnorm, "[mean, sigma, low, high]"),
}
"""Distributions whose parameters may stand in a list."""


_NAMED = (
    "bernoulli", "beta", "binom", "cauchy", "expon", "gamma", "geom", "gumbel_l", "gumbel_r", "invgamma", "laplace",
    "logistic", "lognorm", "norm", "pareto", "poisson", "randint", "rayleigh", "t", "triang", "truncnorm", "uniform",
    "vonmises", "weibull_min",
)  # fmt: skip
"""Distributions of scipy.stats that a table of parameters names: their quantiles take microseconds at any parameter."""
_LARGEST = 1e9
"""Largest size of a parameter."""


def known(name: str) -> bool:
    """Whether there is a distribution of this name."""
    return name in _LISTED or name in _NAMED or name in ("choice", "route_class")


def _frozen(name: str, given: object) -> Any:
    """A distribution of scipy.stats with its parameters."""
    values = list(given.values()) if isinstance(given, dict) else given
    form = _LISTED[name][1] if name in _LISTED else "a table of its parameters in scipy.stats"
    if not isinstance(values, list) or (isinstance(given, list) and name not in _LISTED):
        raise ValueError(f"{name} expects {form} (given: {given!r:.60})")
    for value in values:
        if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= _LARGEST:
            raise ValueError(f"{name}: a parameter is a number within ±{_LARGEST:g} (given: {value!r:.60})")
    if isinstance(given, dict):
        try:
            return getattr(stats, "norm" if name == "normal" else name)(**given)
        except TypeError as error:
            raise ValueError(f"{name}: {error}") from None
    make, expected = _LISTED[name]
    if len(values) != expected.count(",") + 1:
        raise ValueError(f"{name} expects {expected} (given: {given!r:.60})")
    return make(*values)


@dataclass(frozen=True, kw_only=True)
class Draw:
    """A key of the scenario whose value every sea draws."""

    key: str
    law: str
    """Law of the draws in the file's words, for the page."""
    choices: tuple[Any, ...] = ()
    route_classes: tuple[str, ...] = ()
    """Classes of `CLASSES`, of which each sea has one and a route of it."""
    distribution: Any = field(default=None, compare=False)

    @classmethod
    def of(cls, key: str, given: object) -> "Draw":
        """A draw as a file gives it: a table with one distribution's name and its parameters.

        Raises:
            ValueError: says what was expected.
        """
        if not isinstance(given, dict) or len(given) != 1:
            raise ValueError(f"expected one distribution, such as {{ uniform = [0.2, 0.8] }} (given: {given!r:.60})")
        ((name, parameters),) = given.items()
        if not known(name):
            raise ValueError(
                f"unknown distribution {name!r:.40}; available: choice, route_class, "
                f"{', '.join(sorted({*_LISTED, *_NAMED}))}"
            )
        law = f"{name} {parameters}"
        if name == "choice":
            if not isinstance(parameters, list) or not parameters:
                raise ValueError(f"choice expects a list of values (given: {parameters!r:.60})")
            return cls(key=key, law=law, choices=tuple(parameters))
        if name == "route_class":
            if parameters != "any" and parameters not in CLASSES:
                raise ValueError(f"route_class expects any, {', '.join(CLASSES)} (given: {parameters!r:.60})")
            return cls(key=key, law=law, route_classes=tuple(CLASSES) if parameters == "any" else (parameters,))
        distribution = _frozen(name, parameters)
        if not all(math.isfinite(float(distribution.ppf(share))) for share in (0.01, 0.5, 0.99)):
            raise ValueError(f"{name} has no values with these parameters (given: {parameters!r:.60})")
        return cls(key=key, law=law, distribution=distribution)

    def value(self, seed: int, sea: int) -> Any:
        """What a sea has of it."""
        hashed = int.from_bytes(hashlib.sha256(self.key.encode()).digest()[:8], "big")
        address = [_DRAW_KEY, seed, sea, hashed]
        share = float(np.random.default_rng(address).random())
        if self.route_classes:
            return random_waypoints(self.route_classes[int(share * len(self.route_classes))], [*address, 1])
        if self.choices:
            return self.choices[int(share * len(self.choices))]
        drawn = float(self.distribution.ppf(share))
        return int(drawn) if isinstance(self.distribution.dist, stats.rv_discrete) else drawn
