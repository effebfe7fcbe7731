"""Sensing of vehicles nearby: ranges and bearings in closed form, errors by their moments, noise by
its address.
"""

import numpy as np
import pytest

from laisn.arrays import Floats, records
from sim import attitude
from sim.scenario.settings import Scenario
from sim.sensing.noise import Stream, normals
from sim.sensing.proximity import SIGHTING, look_interval, sense_neighbours

STEPS = 4000


def scenario_with_proximity(run: int = 0, **keys: float) -> Scenario:
    """A scenario whose follower has the proximity sensor with these settings."""
    followers = [{"station": {"behind_m": 20.0, "depth_m": 12.0}}]
    return Scenario(name="s", seed=5, run=run, followers=followers, formation={"proximity": keys})


NO_NOISE = {"range_sigma_m": 0.0, "bearing_sigma_deg": 0.0}


def poses(*positions: tuple[float, float, float], heading: float = 0.0) -> Floats:
    """Poses of vehicles at these positions [m], all with one heading [rad], shape (v, 7)."""
    quaternion = attitude.from_euler(np.full(len(positions), heading))
    return np.column_stack([np.array(positions), quaternion])


def sighted(scenario: Scenario, follower: int, vehicles: Floats, tick: int = 1) -> Floats:
    """Range [m] and bearing [rad] of each vehicle as a follower senses it, shape (v, 2)."""
    assert scenario.formation.proximity
    sightings = records(SIGHTING, vehicles.shape[0])
    sense_neighbours(
        (np.uint64(scenario.seed), np.uint64(scenario.run)),
        scenario.formation.proximity.record(),
        tick,
        follower,
        vehicles,
        sightings,
    )
    return np.column_stack([sightings.range, sightings.bearing])


def test_range_and_bearing_are_those_between_the_hulls_centres() -> None:
    """The follower heads east: what is 3 m east and 4 m north of it is 53.13° to port, 5 m away."""
    actual = sighted(
        scenario_with_proximity(range_m=6.0, **NO_NOISE),
        0,
        poses((3.0, 4.0, -10.0), (0, 0, -10), (0, -2, -10), heading=np.pi / 2),
    )
    assert actual[0] == pytest.approx([5.0, -np.arctan2(4.0, 3.0)])
    assert np.isnan(actual[1]).all()
    assert actual[2] == pytest.approx([2.0, np.pi / 2])


@pytest.mark.parametrize(
    ("position", "is_sensed"),
    [
        ((4.99, 0, -10), True),
        ((5.01, 0, -10), False),
        ((4, 0, -10.7), True),
        ((4, 0, -10.71), False),
        ((4, 0, -9.29), False),
        ((0, 4, -9.31), True),
    ],
)
def test_the_sensor_sees_up_to_its_range_within_its_fan(
    position: tuple[float, float, float], is_sensed: bool
) -> None:
    """A fan of 20° opens by 4 m tan 10° = 0.705 m at 4 m."""
    actual = sighted(
        scenario_with_proximity(**NO_NOISE), 0, poses((90, 90, -10), (0, 0, -10), position)
    )
    assert np.isfinite(actual[2]).all() == is_sensed


def test_errors_have_the_deviations_of_the_scenario_and_no_bias() -> None:
    scenario = scenario_with_proximity(range_sigma_m=0.2, bearing_sigma_deg=4.0)
    vehicles = poses((90, 90, -10), (0, 0, -10), (3, 0, -10))
    actual = np.array([sighted(scenario, 0, vehicles, k)[2] for k in range(1, STEPS + 1)]) - [
        3.0,
        np.pi / 2,
    ]
    sigma = np.array([0.2, np.deg2rad(4.0)])
    # six standard errors of a mean and of a standard deviation
    np.testing.assert_array_less(np.abs(actual.mean(axis=0)), 6 * sigma / np.sqrt(STEPS))
    np.testing.assert_allclose(actual.std(axis=0), sigma, rtol=6 / np.sqrt(2 * STEPS))
    assert abs(np.corrcoef(actual.T)[0, 1]) < 6 / np.sqrt(STEPS)


def test_the_error_of_a_look_at_a_vehicle_depends_on_no_other() -> None:
    """Follower 1 looks at vehicle 3 with the draws of its own stream for that, independently of
    other vehicles.
    """
    scenario = scenario_with_proximity(run=2, range_sigma_m=0.2, bearing_sigma_deg=4.0)
    (draws,) = normals(5, 2, Stream.NEARBY.number(1) + 3, 40)
    positions = [(90, 90, -10), (1, 1, -10), (0, 0, -10), (3, 0, -10), (2, 2, -10)]
    actual = sighted(scenario, 1, poses(*positions), 40)[3]
    assert actual == pytest.approx([3.0 + 0.2 * draws[0], np.pi / 2 + np.deg2rad(4.0) * draws[1]])
    np.testing.assert_array_equal(actual, sighted(scenario, 1, poses(*positions[:4]), 40)[3])
    assert (
        sighted(scenario_with_proximity(run=3, range_sigma_m=0.2), 1, poses(*positions), 40)[3, 0]
        != actual[0]
    )
    assert actual[1] != sighted(scenario, 1, poses(*positions), 45)[3, 1]


def test_no_range_is_negative() -> None:
    scenario = scenario_with_proximity(range_sigma_m=2.0)
    vehicles = poses((90, 90, -10), (0, 0, -10), (0.01, 0, -10))
    ranges = np.array([sighted(scenario, 0, vehicles, k)[2, 0] for k in range(1, 200)])
    assert ranges.min() == 0.0


def test_the_interval_of_looks_is_in_ticks_and_0_without_a_sensor() -> None:
    assert look_interval(None) == 0
    assert look_interval(scenario_with_proximity(period_s=0.5).formation.proximity) == 5
