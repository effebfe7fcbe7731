"""What a study can be judged by: the columns of its tables, what each is, and its unit."""

from typing import NamedTuple

from experiments.campaign.cells import PERCENTILES
from experiments.study.facts import FACTS
from laisn.estimates import FixKind


class Metric(NamedTuple):
    """A column of results.parquet or runs.parquet."""

    label: str
    """Name on the axis of a figure, with unit."""
    what: str


_UNITS = {"m": "m", "deg": "°", "j": "J", "w": "W"}

_ERRORS = {
    "e_p_mean_m": Metric("mean E_P [m]", "mean position error of the estimate"),
    "e_p_max_m": Metric("largest E_P [m]", "largest position error; of a cell, over all its runs"),
    "e_p_std_m": Metric("σ of E_P [m]", "standard deviation of the position error over steps and runs"),
    "e_b_mean_deg": Metric("mean E_B [°]", "mean bearing error of the estimate, seen from the leader"),
    "e_b_max_deg": Metric("largest E_B [°]", "largest bearing error; of a cell, over all its runs"),
    "e_b_std_deg": Metric("σ of E_B [°]", "standard deviation of the bearing error over steps and runs"),
    "e_p_mean_uncaptured_m": Metric("mean E_P without capture [m]", "mean position error of runs without capture"),
    "captured": Metric("share of runs captured", "runs held at the mirror image for a message interval, E_P > 5 m"),
    "captured_runs": Metric("runs captured", "number of such runs"),
    "gated": Metric("gated fixes of a run", "fixes that the gate rejected"),
    "nees": Metric("NEES", "mean normalised squared position error; 2 if the covariance is right"),
    "bound_rms_m": Metric("Cramér–Rao bound [m]", "least RMS position error of dead reckoning with ranges; tight only"),
    "rms_over_bound": Metric("RMS E_P over the bound", "RMS position error over that of the Cramér–Rao bound"),
    "nis": Metric("NIS", "mean normalised squared innovation; 2 if its covariance is right"),
}
_PERCENTILES = {
    f"e_{kind}_p{p}_{unit}": Metric(f"{p}th percentile of E_{kind.upper()} [{_UNITS[unit]}]", "over steps and runs")
    for kind, unit in (("p", "m"), ("b", "deg"))
    for p in PERCENTILES
}
_FIXES = {
    f"fixes_{kind.name.lower()}": Metric(f"fixes: {kind.name.lower().replace('_', ' ')}", "number over all runs")
    for kind in FixKind
}
_CONTACT = {
    "touched": Metric("share of runs with contact", f"{FACTS['touched']}: share of runs"),
    "ended": Metric("share of runs ended by contact", "whether contact ended the mission: share of runs"),
}
_FACTS = {
    name: Metric(f"{what.partition(' of the ')[0]} [{_UNITS[name.rpartition('_')[2]]}]", what)
    for name, what in FACTS.items()
    if name not in _CONTACT
}

METRICS: dict[str, Metric] = _ERRORS | _PERCENTILES | _FIXES | _FACTS | _CONTACT
"""Metrics by their columns in the tables."""
SHARES = frozenset({"captured", *_CONTACT})
"""Metrics that a run either has or has not: 1 or 0."""
