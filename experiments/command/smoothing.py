"""Fixed-lag smoothing of replays by the tightly coupled navigator, and its effect on errors."""

import math

import numpy as np
from rich.console import Console
from rich.table import Table

from experiments.campaign.bound import flight_bound
from experiments.campaign.progress import literal
from laisn import metrics
from laisn.arrays import Floats
from laisn.estimates import Estimates
from laisn.failure import LaisnError
from laisn.navigating import AnyNavigator, AnySettings, NavigatorFactory
from laisn.tight.settings import TightSettings
from laisn.tight.smoothing import SmoothingNavigator
from sim.flight import Flight


def smoothing_factory(lag_s: float | None) -> NavigatorFactory | None:
    """A factory of navigators that smooth with messages of up to a lag later [s]; None without a lag.

    Raises LaisnError if the lag is not finite; the factory does so for settings of LAISN.
    """
    if lag_s is None:
        return None
    if not math.isfinite(lag_s):
        raise LaisnError(f"--smooth {lag_s}: expected a finite time in seconds")

    def make(settings: AnySettings, start: Floats) -> AnyNavigator:
        if not isinstance(settings, TightSettings):
            raise LaisnError("--smooth: LAISN cannot be smoothed; add --variant tight")
        return SmoothingNavigator(settings, start, lag_s)

    return make


def _consistency(estimates: Estimates, truth: Floats) -> tuple[str, str]:
    """RMS of E_P [m], and mean NEES, from the first estimate on."""
    squares = metrics.position_errors(estimates.state[:, :2], truth)[estimates.unknown :] ** 2
    normalised = metrics.nees(estimates, truth)
    known = normalised[np.isfinite(normalised)]
    rms = f"{math.sqrt(squares.mean()):.3f}" if squares.size else "–"
    return rms, f"{known.mean():.3g}" if known.size else "–"


def _least(flight: Flight, follower: int, lag_s: float) -> str:
    """RMS over the flight of the Cramér–Rao bound [m]."""
    bound = flight_bound(flight, follower, lag_s)[flight.estimates[follower].unknown :]
    return f"{math.sqrt(np.mean(bound**2)):.3f}" if bound.size else "–"


def show_smoothing(console: Console, filtered: Flight, smoothed: Flight, lag_s: float) -> None:
    """Print RMS errors of every follower, their bounds, and NEES, filtered and smoothed."""
    heads = ("RMS E_P [m]", "smoothed", "bound [m]", "smoothed", "NEES", "smoothed")
    table = Table("follower", *heads, box=None, pad_edge=False)
    for i, name in enumerate(filtered.trajectory.names[1:]):
        truth = filtered.hydrophone(i)[:, :2]
        both = (_consistency(flight.estimates[i], truth) for flight in (filtered, smoothed))
        errors, normalised = zip(*both, strict=True)
        table.add_row(literal(name), *errors, *(_least(filtered, i, lag) for lag in (0.0, lag_s)), *normalised)
    console.print(literal(f"smoothed with messages of up to {lag_s:g} s later", "bold"))
    console.print(table)
