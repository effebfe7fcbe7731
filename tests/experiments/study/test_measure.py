"""What a run in closed loop is judged by."""

import numpy as np
import pytest

from experiments.flight.fly import fly
from experiments.flight.library import as_scenario
from experiments.study.measure import records_of_run
from laisn.metrics import bearing_errors, position_errors


@pytest.mark.parametrize(("reach_m", "has_estimates"), [(0.0, True), (0.001, False)])
def test_errors_of_a_run_count_from_the_first_estimate_on(
    reach_m: float, has_estimates: bool
) -> None:
    """As a single flight has them: an unknown start leaves none before the first message, and none
    at all where no message is heard.
    """
    scenario = as_scenario(
        "T5",
        {
            "duration_s": 20.0,
            "followers.0.guidance_position": "estimate",
            "navigation.variant": "tight",
            "navigation.assume.known_start": False,
            "acoustics.max_range_m": reach_m,
        },
    )
    (record,) = records_of_run(scenario, 3)
    columns = ("e_p_max_m", "e_p_mean_m", "e_b_max_deg", "e_b_mean_deg")
    if not has_estimates:
        assert [record[name] for name in columns] == [None] * 4
        return
    flight = fly(scenario.model_copy(update={"run": 3}))[0]
    estimate = flight.estimates[0].state[:, :2]
    truth = flight.hydrophone(0)[:, :2]
    leader = flight.trajectory.position[flight.step_index(), 0, :2]
    position = position_errors(estimate, truth)
    bearing = np.rad2deg(bearing_errors(estimate, truth, leader))
    assert np.isnan(position[0])
    expected = [f(e) for e in (position, bearing) for f in (np.nanmax, np.nanmean)]
    np.testing.assert_allclose([record[name] for name in columns], expected, rtol=1e-9)
