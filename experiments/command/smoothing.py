"""Replays of the tightly coupled navigator after the fact: which navigator smooths, and what smoothing changes."""

import math

import numpy as np
from rich.console import Console
from rich.table import Table

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
    """What makes navigators that smooth with messages of up to a lag later [s]; None where none is asked for.

    Raises LaisnError if the lag is not finite; what it returns does so for settings of LAISN.
    """
    if lag_s is None:
        return None
    if not math.isfinite(lag_s):
        raise LaisnError(f"--smooth {lag_s}: expected a finite time in seconds")

    def make(settings: AnySettings, start: Floats) -> AnyNavigator:
        if not isinstance(settings, TightSettings):
            raise LaisnError("--smooth: LAISN's covariances cannot carry it; add --variant tight")
        return SmoothingNavigator(settings, start, lag_s)

    return make


def _consistency(estimates: Estimates, truth: Floats) -> tuple[str, str]:
    """RMS of E_P, and mean NEES, from the first estimate on."""
    squares = metrics.position_errors(estimates.state[:, :2], truth)[estimates.unknown :] ** 2
    normalised = metrics.nees(estimates, truth)
    told = normalised[np.isfinite(normalised)]
    rms = f"{math.sqrt(squares.mean()):.3f} m" if squares.size else "–"
    return rms, f"{told.mean():.3g}" if told.size else "–"


def show_smoothing(console: Console, filtered: Flight, smoothed: Flight, lag_s: float) -> None:
    """Print RMS errors and NEES of every follower, filtered and smoothed."""
    table = Table("follower", "RMS E_P", "smoothed", "NEES", "smoothed", box=None, pad_edge=False)
    for i, name in enumerate(filtered.trajectory.names[1:]):
        truth = filtered.hydrophone(i)[:, :2]
        both = (_consistency(flight.estimates[i], truth) for flight in (filtered, smoothed))
        table.add_row(literal(name), *(cell for pair in zip(*both, strict=True) for cell in pair))
    console.print(literal(f"smoothed with messages of up to {lag_s:g} s later", "bold"))
    console.print(table)
