"""Two transmitters very near and very far: the covariance of the tightly coupled navigator is the
size of its errors.
"""

from itertools import pairwise

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.messages import LeaderMessage, Measurements
from laisn.settings import TightSettings
from laisn.tight.navigator import run_mission

DT = 0.1
STEPS = 4000
EVERY = 10
RUNS = 6
START = np.zeros(4)


def abreast(bearing_deg: float, distance: float, deeper: float, run: int) -> Measurements:
    """Of a follower that starts at the origin and keeps its bearing and distance [m] from a leader
    on a straight course east at 1 m/s, `deeper` below it [m], with the paper's errors.
    """
    rng = np.random.default_rng([run, int(10 * distance), int(bearing_deg)])
    k = np.arange(EVERY, STEPS + 1, EVERY)
    bearing = np.pi / 2 + np.deg2rad(bearing_deg)
    offset = distance * np.array([np.sin(bearing), np.cos(bearing)])
    arms = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 0.1]])
    true = np.sqrt(np.sum((offset - arms) ** 2, axis=1) + deeper**2)
    common = rng.normal(0.0, 0.05, (k.size, 1)) / true.max()
    ranges = true * (1.0 + common) + rng.uniform(-0.005, 0.005, (k.size, 3))
    message = np.full((k.size, len(LeaderMessage._fields)), np.nan)
    message[:, 0] = DT * k
    message[:, 1] = DT * k - offset[0]
    message[:, 2] = -offset[1]
    message[:, 3] = np.pi / 2
    message[:, 4] = 1.0
    message[:, 5] = 8.0
    return Measurements(
        dt=DT,
        speed=1.2 + rng.normal(0.0, 0.2, STEPS),
        heading=np.pi / 2 + np.deg2rad(5.0) + rng.normal(0.0, np.deg2rad(1.2), STEPS),
        depth=np.full(STEPS, 8.0 + deeper),
        message_step=k,
        message=message,
        ranges=ranges,
    )


def normalised_error(bearing_deg: float, distance: float, deeper: float) -> float:
    """Mean eᵀP⁻¹e over steps and runs; 2 for a right covariance."""
    truth = np.zeros((STEPS, 2))
    truth[:, 0] = DT * np.arange(1, STEPS + 1)
    nees = []
    for run in range(RUNS):
        measured = abreast(bearing_deg, distance, deeper, run)
        estimates = run_mission(TightSettings(transmitters=2), measured, START)
        e: Floats = estimates.state[:, :2] - truth
        xx, xy, yy = estimates.covariance.T
        squared = e[:, 0] ** 2 * yy - 2.0 * e[:, 0] * e[:, 1] * xy + e[:, 1] ** 2 * xx
        nees.append(np.mean(squared / (xx * yy - xy**2)))
    return float(np.mean(nees))


POSITIONS = [
    # bearing from the leader's bow [°], horizontal distance [m], depth below the leader [m]
    (90.0, 1.5, 0.0),
    (30.0, 1.0, 0.0),
    (150.0, 2.0, 0.0),
    (60.0, 2.0, 0.0),
    (170.0, 1.5, 0.0),
    (0.0, 0.1, 1.0),
    (150.0, 3.0, 1.0),
    (60.0, 5.0, 0.0),
    (120.0, 20.0, 0.0),
    (180.0, 400.0, 0.0),
    (180.0, 500.0, 0.0),
    (0.0, 500.0, 0.0),
]


@pytest.mark.parametrize(("bearing_deg", "distance", "deeper"), POSITIONS)
def test_the_covariance_holds_near_and_far(
    bearing_deg: float, distance: float, deeper: float
) -> None:
    """Six runs of 400 s, whose errors have a memory of minutes: a mean of 0.5 to 4 for a right 2.

    Linearised once and at predictions, this was 5 to 100 near the leader, and more where a run
    locks on the mirror image.
    """
    assert 0.5 < normalised_error(bearing_deg, distance, deeper) < 4.0


def test_errors_near_the_leader_do_not_grow_with_time() -> None:
    """1.5 m abeam the mean position stays: a drift of the linearisation would add up."""
    drifts = []
    for run in range(RUNS):
        measured = abreast(90.0, 1.5, 0.0, run)
        estimates = run_mission(TightSettings(transmitters=2), measured, START)
        north_error = estimates.state[:, 1]
        means = [north_error[begin:end].mean() for begin, end in pairwise((1000, 2000, 3000, 4000))]
        drifts.append(means[-1] - means[0])
    assert abs(float(np.mean(drifts))) < 0.05
