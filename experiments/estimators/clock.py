"""What an unknown clock costs, before the leader's first turn and after it.

On a straight leg a clock's drift, the log's bias and, far astern, the distance move all ranges alike. After a turn they
are told apart.
"""

from dataclasses import dataclass

import numpy as np

from experiments.campaign.bound import geometry_of, least_rms
from experiments.campaign.missions import mission_of, motion_of
from experiments.estimators.cases import Case, spoiled
from experiments.estimators.missions import MIDDLE_OFFSET, asked_for, mission, noise_known
from laisn import metrics
from laisn.arrays import Floats
from laisn.tight.mission import run_mission
from laisn.tight.settings import Assume, TightSettings
from sim.scenario.routes import library_route
from sim.sensing.hearing import Hearing
from sim.sensing.sensor_errors import measure

SETTLED_S = 60.0
"""Errors after the turn count from so many seconds after it on."""
_EXACT = Case(name="exact clock", title="exact clocks")
_UNKNOWN = Case(name="unknown clock", title="an unknown clock", assume=Assume(clock=True), clock=True)


@dataclass(frozen=True, kw_only=True)
class ClockCost:
    """Mean E_P of R runs with exact clocks, and with one that is off and estimated; arrays of shape (R,), [m]."""

    route: str
    before_exact: Floats
    """Before the leader's first turn."""
    before_unknown: Floats
    after_exact: Floats
    """From a minute after it on."""
    after_unknown: Floats
    before_bound: float
    """RMS of the bound with an unknown clock over that with exact ones."""
    after_bound: float


def _parts(dt: float, steps: int) -> tuple[slice, slice]:
    """Steps before the leader's first turn, and from a minute after it on."""
    turn = float(library_route("L").time[1])
    return slice(0, round(turn / dt)), slice(round((turn + SETTLED_S) / dt), steps)


def clock_cost(route: str, interval: float, transmitters: int, runs: int, seed: int) -> ClockCost:
    """Runs of one mission with exact clocks, and the same runs with a clock that is off and estimated."""
    truth, errors = mission(route, interval, 0.0)
    parts, means = _parts(truth.dt, truth.speed.size), []
    for case in (_EXACT, _UNKNOWN):
        settings = TightSettings(middle_offset=MIDDLE_OFFSET).assuming(case.assume, transmitters)
        for run in range(runs):
            measured = spoiled(measure(truth, errors, seed=seed, run=run), case, seed, run)
            found = run_mission(settings, measured, truth.start, covariance=False).state
            error = metrics.position_errors(found, truth.hydrophone)
            means.append([error[part].mean() for part in parts])
    exact, unknown = np.array(means).reshape(2, runs, 2)
    asked = asked_for(route, interval, 0.0, MIDDLE_OFFSET, False)
    trajectory, _ = mission_of(motion_of(asked)).seen(asked, 0)
    geometry = geometry_of(trajectory, Hearing.of(asked), transmitters=transmitters)
    squares = [least_rms(geometry, noise_known(case.assume)) ** 2 for case in (_EXACT, _UNKNOWN)]
    before, after = (float(np.sqrt(squares[1][part].mean() / squares[0][part].mean())) for part in parts)
    return ClockCost(
        route=route,
        before_exact=exact[:, 0],
        before_unknown=unknown[:, 0],
        after_exact=exact[:, 1],
        after_unknown=unknown[:, 1],
        before_bound=before,
        after_bound=after,
    )
