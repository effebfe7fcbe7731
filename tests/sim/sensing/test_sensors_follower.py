"""Errors of one follower's own sensors (`followers.N.sensors`) in flights, campaigns and files."""

from pathlib import Path

import numpy as np
import pytest

import laisn_sim
from experiments.campaign.montecarlo import Cell
from laisn.errors import LaisnError
from reports.bound import noise_of
from sim.flight import FlightRecord
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Scenario
from sim.sensing.sensors import errors_of, read_heading, read_leader_heading

THREE_FOLLOWERS = {
    "motion": "kinematic",
    "duration_s": 30.0,
    "sensors.heading_sigma_deg": 0.0,
    "sensors.speed_sigma_m_s": 0.0,
    "followers": [{"route": "T5"}, {"route": "T3"}, {"route": "T4"}],
}
OWN_ERRORS = {"heading_bias_deg": -7.0, "speed_bias_m_s": 0.05, "depth_sigma_m": 0.5}


@pytest.fixture(scope="module")
def flights() -> tuple[FlightRecord, FlightRecord]:
    """Of three followers, without and with keys of the second one's own."""
    return laisn_sim.fly("T5", THREE_FOLLOWERS), laisn_sim.fly(
        "T5", THREE_FOLLOWERS | {"followers.1.sensors": OWN_ERRORS}
    )


def test_a_key_of_one_follower_changes_that_follower_alone(
    flights: tuple[FlightRecord, FlightRecord],
) -> None:
    common, with_own_errors = flights
    for i in (0, 2):
        np.testing.assert_array_equal(
            common.measurements[i].heading, with_own_errors.measurements[i].heading
        )
        np.testing.assert_array_equal(
            common.measurements[i].ranges, with_own_errors.measurements[i].ranges
        )
        np.testing.assert_array_equal(common.estimates[i].state, with_own_errors.estimates[i].state)
    expected, actual = common.measurements[1], with_own_errors.measurements[1]
    # the biases of [sensors] are 5° and 0.2 m/s, those of its own −7° and 0.05 m/s
    np.testing.assert_allclose(actual.heading - expected.heading, np.deg2rad(-12.0), atol=1e-12)
    np.testing.assert_allclose(actual.speed - expected.speed, -0.15, atol=1e-12)
    assert np.std(actual.depth - expected.depth) == pytest.approx(
        0.5, rel=5 / np.sqrt(2 * expected.depth.size)
    )
    np.testing.assert_array_equal(expected.ranges, actual.ranges)


def test_campaigns_and_bounds_have_the_errors_of_their_follower(
    flights: tuple[FlightRecord, FlightRecord],
) -> None:
    scenario = flights[1].scenario
    assert [
        round(float(np.rad2deg(Cell.of(scenario, i, 1).errors.heading_bias)), 9) for i in range(3)
    ] == [
        5.0,
        -7.0,
        5.0,
    ]
    with_own_errors = laisn_sim.load("T5", {"followers.0.sensors.speed_sigma_m_s": 0.7})
    speed_sigmas = []
    for scenario in (with_own_errors, laisn_sim.load("T5")):
        noise = noise_of(SensingSettings.of(scenario), scenario.navigation)
        speed_sigmas.append(noise.speed_sigma)
    assert speed_sigmas == [0.7, 0.2]


def test_a_bound_takes_the_deviation_of_compass_readings() -> None:
    """The absolute value of a normal error is added to the bias (Equation 27), which deviates less
    than the normal itself; expected are the deviations of 200 000 readings.
    """
    changes = {"sensors.heading_sigma_deg": 2.0, "sensors.leader_heading_sigma_deg": 3.0}
    scenario = laisn_sim.load("T5", changes)
    sensing = SensingSettings.of(scenario)
    errors = errors_of(sensing, 0)
    noise = noise_of(sensing, scenario.navigation)
    normals = np.random.default_rng(3).standard_normal((2, 200_000))
    follower = read_heading(errors, 1.0, tuple(normals))
    leader = read_leader_heading(errors, 1.0, tuple(normals))
    assert noise.heading_sigma == pytest.approx(follower.std(), rel=0.01)
    assert noise.leader_heading_sigma == pytest.approx(leader.std(), rel=0.01)
    assert leader.std() / follower.std() == pytest.approx(1.5)


def test_files_hold_the_keys_of_one_follower(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(
        'name = "own"\n[[followers]]\nroute = "T5"\nsensors = { heading_bias_deg = 1.5 }\n'
    )
    scenario = laisn_sim.load(path)
    sensors = SensingSettings.of(scenario).sensors_of(0)
    assert (sensors.heading_bias_deg, sensors.speed_bias_m_s) == (1.5, 0.2)
    assert scenario.sensors.heading_bias_deg == 5.0


@pytest.mark.parametrize("keys", [{"leader_heading_bias_deg": 1.0}, {"heading_bias_deg": 200.0}])
def test_keys_of_the_leader_and_values_out_of_bounds_are_refused(keys: dict[str, float]) -> None:
    with pytest.raises((LaisnError, ValueError), match=f"sensors.*{next(iter(keys))}"):
        laisn_sim.load("T5", {"followers.0.sensors": keys})


def test_without_such_keys_all_followers_have_the_same_errors() -> None:
    scenario = Scenario(followers=[{"route": "T5"}, {"route": "T3"}])
    sensing = SensingSettings.of(scenario)
    assert sensing.sensors_of(0) == sensing.sensors_of(1) == scenario.sensors
