"""How often a 95 % interval of `reports.intervals` holds the true mean.

`python -m tools.documents.studies coverage` draws runs from laws with a known mean and counts the
intervals that hold it.
"""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from experiments.study.file import Until
from experiments.study.run import runs_wanted
from laisn.arrays import Floats
from reports.findings import (
    RESULTS_FILE,
    Finding,
    Findings,
    interval_finding,
    plain_finding,
    record,
)
from reports.intervals import Interval, mean_interval, proportion, ratio_intervals

COMMAND = "python -m tools.documents.studies coverage"
MODULES = ("tools.documents.coverage",)
RUNS = (20, 60)
"""Numbers of runs that an interval is made of."""
TRIALS = 10_000
"""Intervals drawn of each law and number of runs."""
LOCK_CHANCE = 0.1
"""Chance that a run locks on the mirror image."""
_ERROR_M = 0.5
_LOCKED_ERROR_M = 20.0
"""Mean error of a run that does not lock, and of one that does [m]."""

Draw = Callable[[np.random.Generator, tuple[int, int]], tuple[Floats, Floats]]
"""Numerators and denominators of a ratio, each of the given shape (runs, trials); the denominators
of a mean are ones.
"""


class Law(NamedTuple):
    """How runs are drawn, and the true mean or ratio that their interval should hold."""

    words: str
    truth: float
    draw: Draw


def _over_one(values: Floats) -> tuple[Floats, Floats]:
    return values, np.ones_like(values)


def _mirror(rng: np.random.Generator, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    error = rng.gamma(9.0, 1.0 / 9.0, shape)
    return _over_one(np.where(rng.random(shape) < LOCK_CHANCE, _LOCKED_ERROR_M, _ERROR_M) * error)


def _ratio(rng: np.random.Generator, shape: tuple[int, int]) -> tuple[Floats, Floats]:
    errors = rng.gamma(2.0, 1.0, shape)
    return errors * rng.gamma(4.0, 0.25, shape), errors + rng.gamma(2.0, 1.0, shape)


LAWS: Mapping[str, Law] = {
    "normal": Law("normal", 0.0, lambda rng, shape: _over_one(rng.normal(0.0, 1.0, shape))),
    "gamma": Law(
        "gamma of skewness 1.4",
        2.0,
        lambda rng, shape: _over_one(rng.gamma(2.0, 1.0, shape)),
    ),
    "exponential": Law(
        "exponential, skewness 2",
        1.0,
        lambda rng, shape: _over_one(rng.exponential(1.0, shape)),
    ),
    "lognormal": Law(
        "lognormal, skewness 6.2",
        float(np.exp(0.5)),
        lambda rng, shape: _over_one(rng.lognormal(0.0, 1.0, shape)),
    ),
    "difference": Law(
        "paired difference of skewed errors",
        0.3,
        lambda rng, shape: _over_one(
            rng.gamma(1.0, 1.0, shape) - 0.7 * rng.gamma(4.0, 0.25, shape)
        ),
    ),
    "ratio": Law("ratio of correlated errors", 0.5, _ratio),
    "mirror": Law(
        "a tenth of the runs locked on the mirror image",
        LOCK_CHANCE * _LOCKED_ERROR_M + (1.0 - LOCK_CHANCE) * _ERROR_M,
        _mirror,
    ),
}


def count_covering(law: str, runs: int, trials: int = TRIALS, seed: int = 1) -> int:
    """Number of intervals, of a number of trials with some runs each, that contain the true mean
    of a distribution.
    """
    _, truth, draw = LAWS[law]
    rng = np.random.default_rng([seed, runs])
    return sum(
        interval.low <= truth <= interval.high
        for interval in ratio_intervals(*draw(rng, (runs, trials)))
    )


class SequentialLaw(NamedTuple):
    """A law of the runs of a study that ends when its interval is narrow."""

    words: str
    mean: float
    half_width: float  # half of the interval at which the study ends


SEQUENTIAL_LAWS: Mapping[str, SequentialLaw] = {
    "normal": SequentialLaw("normal, σ = 1", 0.0, 0.1),
    "binary": SequentialLaw("an outcome of a tenth of the runs", LOCK_CHANCE, 0.03),
}
_BATCH = 60  # runs
_MAX_RUNS = 5_000


def interval_when_stopped(law: str, rng: np.random.Generator) -> Interval:
    """The interval of a study that flies batches until it is narrow enough, as `[runs] until`
    does.
    """
    _, mean, half_width = SEQUENTIAL_LAWS[law]
    values = (
        rng.normal(size=_MAX_RUNS)
        if law == "normal"
        else (rng.random(_MAX_RUNS) < mean).astype(np.float64)
    )
    until = Until(half_width=half_width, most=_MAX_RUNS)
    runs = 0
    count = _BATCH
    interval = Interval(mean, math.nan, math.nan)
    while runs < count:
        runs = count
        sample = values[:count]
        interval = mean_interval(sample) if law == "normal" else proportion(int(sample.sum()), runs)
        count = runs_wanted(runs, (interval.high - interval.low) / 2.0, until, _BATCH)
    return interval


def count_covering_when_stopped(law: str, trials: int = TRIALS, seed: int = 1) -> int:
    """Number of intervals, of a number of such studies, that contain the true mean of a
    distribution.
    """
    rng = np.random.default_rng([seed, 0])
    mean = SEQUENTIAL_LAWS[law].mean
    return sum(
        interval.low <= mean <= interval.high
        for interval in (interval_when_stopped(law, rng) for _ in range(trials))
    )


def findings() -> Findings:
    """Coverage of every law and number of runs."""
    shares: dict[str, Finding] = {
        "trials": plain_finding(TRIALS, "intervals drawn of each law and number of runs")
    }
    for law, (words, _, _) in LAWS.items():
        for runs in RUNS:
            meaning = (
                f"share of 95 % intervals that hold the truth, {runs} runs, {words}; limits 95 %"
            )
            shares[f"{law} {runs}"] = interval_finding(
                proportion(count_covering(law, runs), TRIALS), meaning
            )
    for law, (words, _, half_width) in SEQUENTIAL_LAWS.items():
        meaning = (
            "share of 95 % intervals that hold the truth, runs until half-width "
            f"{half_width:g}, {words}"
        )
        shares[f"until {law}"] = interval_finding(
            proportion(count_covering_when_stopped(law), TRIALS), f"{meaning}; limits 95 %"
        )
    for runs in RUNS:
        shares[f"unseen {runs}"] = plain_finding(
            (1.0 - LOCK_CHANCE) ** runs, f"chance that none of {runs} runs is locked"
        )
    return record("coverage", COMMAND, MODULES, shares)


def run(folder: Path) -> None:
    """Draw everything and write the record into a folder."""
    findings().write(folder / RESULTS_FILE)
