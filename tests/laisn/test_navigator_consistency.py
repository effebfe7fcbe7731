"""A filter with the true noise parameters: its covariance must be that of its errors."""

import numpy as np
import pytest
from scipy.stats import chi2

from laisn.arrays import Floats
from laisn.estimates import Estimates
from laisn.metrics import nees
from laisn.navigator import Filter

DT, STEPS_PER_FIX, STEPS, RUNS = 0.1, 10, 100, 500
SIGMA_A, SIGMA_P, SIGMA_V, SIGMA_THETA = 0.05, 0.3, 0.05, np.deg2rad(0.5)
START_SIGMA = np.array([0.5, 0.5, 0.02, 0.02])


def run_matched_filter(random: np.random.Generator) -> tuple[Filter, Floats]:
    """Filter and true state at the end, of a vehicle that accelerates and is measured as the filter
    assumes.
    """
    truth = np.array([0.0, 0.0, 1.5, 1.0])
    kalman = Filter(DT, truth + START_SIGMA * random.normal(size=4), START_SIGMA)
    for step in range(1, STEPS + 1):
        acceleration = SIGMA_A * random.normal(size=2)
        truth = truth + np.concatenate(
            [DT * truth[2:] + DT**2 / 2 * acceleration, DT * acceleration]
        )
        kalman.predict(SIGMA_A)
        if step % STEPS_PER_FIX == 0:
            x, y = truth[:2] + SIGMA_P * random.normal(size=2)
            kalman.update_position((x, y), SIGMA_P)
        speed = np.hypot(*truth[2:]) + SIGMA_V * random.normal()
        heading = np.arctan2(truth[2], truth[3]) + SIGMA_THETA * random.normal()
        kalman.update_speed(speed, heading, SIGMA_V, SIGMA_THETA)
    return kalman, truth


@pytest.mark.system
def test_normalised_errors_of_a_matched_filter_are_chi_square() -> None:
    """Sums over independent runs lie within the 99.9 % interval of χ², with 2 degrees of freedom a
    run for the position, 4 for the state.
    """
    last_steps = [run_matched_filter(np.random.default_rng([7, run])) for run in range(RUNS)]
    truth = np.array([t for _, t in last_steps])
    no_fixes = np.zeros(0)
    estimates = Estimates(
        state=np.array([f.state for f, _ in last_steps]),
        covariance=np.array([f.covariance for f, _ in last_steps]),
        fix_step=np.zeros(0, dtype=np.int64),
        fix_position=np.zeros((0, 2)),
        fix_sigma=no_fixes,
        fix_kind=np.zeros(0, dtype=np.int64),
        innovation=np.zeros((0, 2)),
        innovation_covariance=np.zeros((0, 2, 2)),
    )
    of_position = nees(estimates, truth[:, :2])
    low, high = chi2.interval(0.999, 2 * RUNS)
    assert low < of_position.sum() < high
    error = estimates.state - truth
    of_state = np.einsum("ri,rij,rj->r", error, np.linalg.inv(estimates.covariance), error)
    low, high = chi2.interval(0.999, 4 * RUNS)
    assert low < of_state.sum() < high
