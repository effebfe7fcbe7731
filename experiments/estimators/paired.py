"""Runs of one mission by both navigators, on the same measurements."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.special import chdtri

from experiments.estimators.cases import Case, spoiled
from experiments.estimators.missions import MIDDLE_OFFSET, bound_rms, mission
from laisn import lanes, metrics
from laisn.arrays import Bools, Floats
from laisn.ekf import filter_runs
from laisn.lane_rows import LANES
from laisn.messages import Measurements
from laisn.settings import NavigationSettings
from laisn.tight.mission import run_mission
from laisn.tight.settings import TightSettings
from sim.sensing.sensor_errors import measure
from sim.sensing.truth import MissionTruth

LAG = 60.0
"""How much later the messages are that smoothing uses [s]."""


@dataclass(frozen=True, kw_only=True)
class Paired:
    """Figures of R runs of one mission of n steps; arrays of shape (R,)."""

    route: str
    interval: float
    """Time between messages [s]."""
    laisn_means: Floats
    """Mean E_P of LAISN-2 [m]."""
    laisn_squares: Floats
    """Mean of its E_P² [m²]."""
    tight_means: Floats
    """Mean E_P of the tightly coupled navigator [m]."""
    tight_squares: Floats
    """Mean of its E_P² [m²]."""
    tight_max: float
    """Its largest E_P of all runs [m]."""
    normalised: Floats
    """Mean of eᵀ P⁻¹ e: 2 if P is right."""
    inside: float
    """Share of the steps at which the mean of eᵀ P⁻¹ e over the runs is within its 95 % χ² interval."""
    residuals: Floats
    """Squared residuals of the ranges in units of S, for each range used: 1 if S is right."""
    laisn_lost: Bools
    """LAISN-2 sat at the mirror image for a message interval or longer."""
    tight_lost: Bools
    """So did the tightly coupled navigator."""
    bound_rms: float
    """Least RMS of E_P that the noise allows [m]; NaN where the case has no bound."""
    smoothing: float = math.nan
    """What is left of the bound for who smooths with `LAG`, and reckons with what the case assumes; NaN: not asked."""

    @property
    def runs(self) -> int:
        """R."""
        return self.laisn_means.size

    @property
    def laisn_mean(self) -> float:
        """Mean E_P of LAISN-2 over all runs [m]."""
        return float(self.laisn_means.mean())

    @property
    def tight_mean(self) -> float:
        """Mean E_P of the tightly coupled navigator over all runs [m]."""
        return float(self.tight_means.mean())

    @property
    def laisn_rms(self) -> float:
        """RMS E_P of LAISN-2 over all runs [m]."""
        return float(np.sqrt(self.laisn_squares.mean()))

    @property
    def tight_rms(self) -> float:
        """RMS E_P of the tightly coupled navigator over all runs [m]."""
        return float(np.sqrt(self.tight_squares.mean()))

    @property
    def nees(self) -> float:
        """Mean of eᵀ P⁻¹ e over all runs."""
        return float(self.normalised.mean())

    @property
    def laisn_captured(self) -> int:
        """Runs of LAISN-2 that were captured at the mirror image."""
        return int(self.laisn_lost.sum())

    @property
    def tight_captured(self) -> int:
        """Runs of the tightly coupled navigator that were."""
        return int(self.tight_lost.sum())

    @property
    def ratio(self) -> float:
        """Mean E_P of the tightly coupled navigator over that of LAISN-2."""
        return self.tight_mean / self.laisn_mean


@dataclass(frozen=True, kw_only=True)
class Captured:
    """How many runs were captured at the mirror image."""

    runs: int
    """Runs of each navigator."""
    laisn: int
    """Captured runs of LAISN-2."""
    tight: int
    """Captured runs of the tightly coupled navigator."""


@dataclass(frozen=True, kw_only=True)
class Plain:
    """Figures of R runs of one mission by a plain extended Kalman filter, as in `Paired`; arrays of shape (R,)."""

    route: str
    interval: float
    means: Floats
    squares: Floats
    normalised: Floats
    lost: Bools

    @property
    def runs(self) -> int:
        """R."""
        return self.means.size


def nees(error: Floats, spread: Floats) -> Floats:
    """eᵀ P⁻¹ e of errors, shape (n, 2), with covariances xx, xy, yy, shape (n, 3)."""
    (x, y), (xx, xy, yy) = error.T, spread.T
    return np.asarray((x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy))


def _captured(found: Floats, truth: MissionTruth, steps: int) -> bool:
    """Whether an estimate sat at the mirror image of the truth for so many steps."""
    return metrics.was_captured(found, truth.hydrophone, truth.leader_position, truth.leader_heading, steps)


def _blocks(runs: range) -> Iterator[range]:
    """Runs in blocks of as many as the lanes take."""
    return (runs[first : first + LANES] for first in range(0, len(runs), LANES))


def pair(
    truth: MissionTruth,
    measured: Sequence[Measurements],
    settings: TightSettings,
    message_steps: int,
    laisn: NavigationSettings | None = None,
) -> dict[str, Floats]:
    """Rows of figures of some runs, named as in `Paired`, and `instants`: Σ eᵀ P⁻¹ e over them, shape (n,)."""
    heard = np.concatenate(
        [
            lanes.run(measured[block.start : block.stop], truth.start, laisn or NavigationSettings()).state[:, :2]
            for block in _blocks(range(len(measured)))
        ],
        axis=2,
    )
    rows, instants = [], np.zeros(truth.speed.size)
    for i, given in enumerate(measured):
        states, spread, outcome = run_mission(settings, given, truth.start)
        error = metrics.position_errors(states[:, :2], truth.hydrophone)
        laisns = metrics.position_errors(heard[:, :, i], truth.hydrophone)
        normalised, told = nees(states[:, :2] - truth.hydrophone, spread), np.isfinite(outcome[:, 2])
        instants += normalised
        rows.append(
            (
                laisns.mean(),
                np.mean(laisns**2),
                error.mean(),
                np.mean(error**2),
                error.max(),
                normalised.mean(),
                outcome[told, 2].sum() / max(outcome[told, 1].sum(), 1.0),
                _captured(heard[:, :, i], truth, message_steps),
                _captured(states[:, :2], truth, message_steps),
            )
        )
    names = ("laisn_means", "laisn_squares", "tight_means", "tight_squares", "largest", "normalised", "residuals",
             "laisn_lost", "tight_lost")  # fmt: skip
    columns = np.array(rows, dtype=np.float64).T
    return dict(zip(names, columns, strict=True)) | {"instants": instants}


def paired(route: str, interval: float, found: dict[str, Floats], bound: float) -> Paired:
    """Figures of rows as `pair` gives them."""
    runs = found["laisn_means"].size
    # eᵀ P⁻¹ e of R independent runs adds up to χ² of 2R degrees of freedom (Bar-Shalom, Section 5.4.2)
    low, high = (float(chdtri(2 * runs, tail)) for tail in (0.975, 0.025))
    return Paired(
        route=route,
        interval=interval,
        laisn_means=found["laisn_means"],
        laisn_squares=found["laisn_squares"],
        tight_means=found["tight_means"],
        tight_squares=found["tight_squares"],
        tight_max=float(found["largest"].max()),
        normalised=found["normalised"],
        inside=float(np.mean((found["instants"] >= low) & (found["instants"] <= high))),
        residuals=found["residuals"],
        laisn_lost=found["laisn_lost"] > 0.0,
        tight_lost=found["tight_lost"] > 0.0,
        bound_rms=bound,
    )


def smoothing(case: Case, route: str, interval: float) -> float:
    """Bound of smoothing over that of filtering, of who takes as given what a case assumes; nothing lost, no echoes."""
    least = partial(bound_rms, route, interval, case.transmitters, MIDDLE_OFFSET, False, case.assume)
    return least(LAG) / least()


def compare(
    case: Case,
    route: str,
    interval: float,
    *,
    runs: int,
    seed: int,
    settings: TightSettings | None = None,
    middle_offset: float = MIDDLE_OFFSET,
    weave: bool = False,
) -> Paired:
    """Fly the runs of one mission by both navigators.

    Args:
        case: what is assumed, and what is wrong.
        route: T2 … T9.
        interval: of messages [s].
        runs: how many.
        seed: of all noise.
        settings: of the tightly coupled navigator, but for what the case says; None: its defaults.
        middle_offset: H_T [m].
        weave: the leader weaves about its route.
    """
    truth, errors = mission(route, interval, case.leader_heading_deg, middle_offset, weave)
    given = (settings or TightSettings(middle_offset=middle_offset)).assuming(case.assume, case.transmitters)
    measured = [spoiled(measure(truth, errors, seed=seed, run=run), case, seed, run) for run in range(runs)]
    least = float("nan")
    if case.sound:
        least = bound_rms(route, interval, case.transmitters, middle_offset, weave, case.assume)
    return paired(route, interval, pair(truth, measured, given, round(interval / truth.dt)), least)


def plain_filter(case: Case, route: str, interval: float, *, runs: int, seed: int) -> Plain:
    """Fly the runs of one mission by a plain extended Kalman filter, with the noise that `compare` gives them.

    Args:
        case: nothing in it may be wrong, and all be given that `Assume` has by default.
        route: T2 … T9.
        interval: of messages [s].
        runs: how many.
        seed: of all noise.
    """
    truth, errors = mission(route, interval, case.leader_heading_deg)
    settings = TightSettings(middle_offset=MIDDLE_OFFSET).assuming(case.assume, case.transmitters)
    measured = [measure(truth, errors, seed=seed, run=run) for run in range(runs)]
    found = filter_runs(settings, measured, truth.start)
    off = [metrics.position_errors(position, truth.hydrophone) for position in found.position]
    steps = round(interval / truth.dt)
    return Plain(
        route=route,
        interval=interval,
        means=np.array([error.mean() for error in off]),
        squares=np.array([np.mean(error**2) for error in off]),
        normalised=np.array(
            [
                nees(p - truth.hydrophone, spread).mean()
                for p, spread in zip(found.position, found.covariance, strict=True)
            ]
        ),
        lost=np.array([_captured(position, truth, steps) for position in found.position]),
    )


def captures(route: str, interval: float, transmitters: int, runs: range, seed: int) -> Captured:
    """How many runs of LAISN-2 and of the tightly coupled navigator are captured at the mirror image."""
    truth, errors = mission(route, interval, 0.0)
    settings, steps = TightSettings(transmitters=transmitters), round(interval / truth.dt)
    laisn = tight = 0
    for block in _blocks(runs):
        measured = [measure(truth, errors, seed=seed, run=run) for run in block]
        heard = lanes.run(measured, truth.start, NavigationSettings()).state[:, :2]
        for i, given in enumerate(measured):
            found = run_mission(settings, given, truth.start, covariance=False).state
            laisn += _captured(heard[:, :, i], truth, steps)
            tight += _captured(found, truth, steps)
    return Captured(runs=len(runs), laisn=laisn, tight=tight)
