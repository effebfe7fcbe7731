"""Runs of one mission by both navigators, on the same measurements."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from experiments.campaign.missions import mission_of, motion_of
from experiments.estimators.cases import Case, spoiled
from experiments.reproduction.stages import Setting, scenario
from laisn import lanes, metrics
from laisn.arrays import Floats
from laisn.bound import Geometry, TrueNoise, position_bound
from laisn.lane_rows import LANES
from laisn.messages import Measurements
from laisn.settings import NavigationSettings
from laisn.tight.mission import run_mission
from laisn.tight.settings import TightSettings
from sim.scenario.settings import Follower
from sim.sensing.observation import errors_of
from sim.sensing.sensor_errors import SensorErrors, measure
from sim.sensing.truth import MissionTruth

MIDDLE_OFFSET = 0.1
"""H_T of all missions [m]."""


@dataclass(frozen=True, kw_only=True)
class Paired:
    """Figures over all steps of all runs of one mission."""

    route: str
    interval: float
    """Time between messages [s]."""
    runs: int
    laisn_mean: float
    """Mean E_P of LAISN-2 [m]."""
    tight_mean: float
    """Mean E_P of the tightly coupled navigator [m]; root mean square and maximum follow."""
    tight_rms: float
    tight_max: float
    bound_rms: float
    """Least RMS of E_P that the noise allows [m]; NaN where the case has no bound."""
    nees: float
    """Mean of eᵀ P⁻¹ e: 2 if P is right."""
    laisn_captured: int
    """Runs that sat at the mirror image for a message interval or longer."""
    tight_captured: int

    @property
    def ratio(self) -> float:
        """Mean E_P of the tightly coupled navigator over that of LAISN-2."""
        return self.tight_mean / self.laisn_mean


@cache
def mission(route: str, interval: float, leader_heading_deg: float) -> tuple[MissionTruth, SensorErrors]:
    """The paper's point motion on a route as three transmitters are heard, and the paper's sensors."""
    setting = Setting(
        name="estimators", stage=1, table="text", title="estimators", message_interval_s=interval,
        middle_offset_m=MIDDLE_OFFSET, leader_heading_deg=leader_heading_deg,
    )  # fmt: skip
    follower = Follower(route=route)
    asked = scenario(setting, follower, route, variant="laisn-3-2", motion="kinematic", seed=1)
    _, truth = mission_of(motion_of(asked)).seen(asked, 0)
    return truth, errors_of(asked)


@cache
def bound_rms(route: str, interval: float, transmitters: int) -> float:
    """Least RMS of E_P over a mission with constant biases and an exact leader [m]."""
    truth, _ = mission(route, interval, 0.0)
    theta = truth.sent_heading
    ahead = np.stack([np.sin(theta), np.cos(theta), 0.0 * theta], axis=1)
    port = np.stack([-np.cos(theta), np.sin(theta), 0.0 * theta], axis=1)
    geometry = Geometry(
        dt=truth.dt,
        speed=truth.speed,
        heading=truth.heading,
        message_step=truth.message_step,
        from_leader=truth.hydrophone[truth.message_step - 1] - truth.sent_position[:, :2],
        arms=np.stack([-ahead, ahead, MIDDLE_OFFSET * port], axis=1)[:, :transmitters],
    )
    return float(np.sqrt(np.mean(np.trace(position_bound(geometry, TrueNoise()), axis1=1, axis2=2))))


def _blocks(case: Case, route: str, interval: float, runs: int, seed: int) -> Iterator[list[Measurements]]:
    """Measurements of all runs, as many at a time as the lanes take."""
    truth, errors = mission(route, interval, case.leader_heading_deg)
    for first in range(0, runs, LANES):
        yield [
            spoiled(measure(truth, errors, seed=seed, run=run), case, seed, run)
            for run in range(first, min(first + LANES, runs))
        ]


def nees(error: Floats, spread: Floats) -> Floats:
    """eᵀ P⁻¹ e of errors, shape (n, 2), with covariances xx, xy, yy, shape (n, 3)."""
    (x, y), (xx, xy, yy) = error.T, spread.T
    return np.asarray((x * x * yy - 2.0 * x * y * xy + y * y * xx) / (xx * yy - xy * xy))


def compare(
    case: Case, route: str, interval: float, *, runs: int, seed: int, settings: TightSettings | None = None
) -> Paired:
    """Fly the runs of one mission by both navigators.

    Args:
        case: what is assumed, and what is wrong.
        route: T2 … T9.
        interval: of messages [s].
        runs: how many.
        seed: of all noise.
        settings: of the tightly coupled navigator, but for what the case says; None: its defaults.
    """
    truth, _ = mission(route, interval, case.leader_heading_deg)
    given = (settings or TightSettings()).assuming(case.assume, case.transmitters)
    message_steps = round(interval / truth.dt)
    tight_square, tight_sum, laisn_sum, normalised, largest = 0.0, 0.0, 0.0, 0.0, 0.0
    captured = {"laisn": 0, "tight": 0}
    for block in _blocks(case, route, interval, runs, seed):
        heard = lanes.run(block, truth.start, NavigationSettings()).state[:, :2]
        for i, measurements in enumerate(block):
            states, spread, _ = run_mission(given, measurements, truth.start)
            where = states[:, :2]
            for name, found in (("laisn", heard[:, :, i]), ("tight", where)):
                steps = metrics.captured_steps(found, truth.hydrophone, truth.leader_position, truth.leader_heading)
                captured[name] += metrics.longest_capture(steps) >= message_steps
            error = metrics.position_errors(where, truth.hydrophone)
            laisn_sum += float(metrics.position_errors(heard[:, :, i], truth.hydrophone).sum())
            tight_sum += float(error.sum())
            tight_square += float(np.sum(error**2))
            largest = max(largest, float(error.max()))
            normalised += float(nees(where - truth.hydrophone, spread).sum())
    count = runs * truth.speed.size
    return Paired(
        route=route,
        interval=interval,
        runs=runs,
        laisn_mean=laisn_sum / count,
        tight_mean=tight_sum / count,
        tight_rms=float(np.sqrt(tight_square / count)),
        tight_max=largest,
        bound_rms=bound_rms(route, interval, case.transmitters) if case.plain else float("nan"),
        nees=normalised / count,
        laisn_captured=captured["laisn"],
        tight_captured=captured["tight"],
    )
