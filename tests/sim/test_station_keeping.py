"""Station keeping of followers, and the closest pairs."""

import numpy as np
import pytest

from experiments.flight.fly import fly
from sim.scenario.parts import MissionPlan
from sim.tracking import closest_approaches, closest_in_a_layer, station_keeping
from tests import synthetic
from tests.sim.test_formation import mission


def test_figures_of_keeping_a_station_are_those_since_it_was_joined() -> None:
    time, off = 0.1 * np.arange(1001), np.full(1001, 3.0)
    off[:200], off[200:] = 50.0, 1.0
    off[300] = 11.0
    found = station_keeping(off, time)
    assert found.joined_s == pytest.approx(20.0)
    assert found.station_rms_m == pytest.approx(np.sqrt((800 + 121) / 801))
    assert found.station_p95_m == pytest.approx(1.0)
    assert (found.station_max_m, found.lost) == (11.0, True)
    # from 2 m, which is not within 2 m, evenly up to 6 m: 95 % of the time less than 19/20 of the
    # way
    evenly = station_keeping(np.r_[2.0, np.linspace(0.0, 6.0, 1001)], np.arange(1002.0))
    assert (evenly.joined_s, evenly.station_p95_m) == pytest.approx((1.0, 5.7))
    assert not station_keeping(np.array([0.0, 10.0]), np.arange(2.0)).lost
    never = station_keeping(np.full(10, 3.0), 0.1 * np.arange(10))
    assert np.isnan(never.joined_s)
    assert never.lost


def test_the_nearest_pair_is_named_with_its_distance_and_time() -> None:
    flight, _ = fly(
        mission(places=[(10.0, 0.0, 12.0), (10.0, 4.0, 12.0), (30.0, 0.0, 20.0)], duration=5.0)
    )
    space, level = closest_approaches(flight.trajectory)
    assert space.pair == level.pair == ("follower-1", "follower-2")
    apart = np.linalg.norm(
        flight.trajectory.position[:, 1] - flight.trajectory.position[:, 2], axis=1
    )
    assert space.distance_m == pytest.approx(apart.min())
    assert space.time_s == pytest.approx(flight.trajectory.time[np.argmin(apart)])


def test_the_nearest_pair_of_one_layer_is_found_beside_nearer_ones() -> None:
    """Depths 12, 12.9 and 20 m: the third is nearer to the first, but not in its layer; the
    leader is at 8 m.
    """
    places = [(10.0, 0.0, 12.0), (10.0, 9.0, 12.9), (10.0, 3.5, 20.0)]
    scenario = mission(places=places, duration=3.0)
    flight, _ = fly(scenario)
    found = closest_in_a_layer(MissionPlan.of(scenario), flight.trajectory)
    assert found is not None
    assert found.pair == ("follower-1", "follower-2")
    apart = flight.trajectory.position[:, 1, :2] - flight.trajectory.position[:, 2, :2]
    assert found.distance_m == pytest.approx(np.hypot(*apart.T).min())
    alone = mission(places=[(10.0, 0.0, 12.0), (10.0, 9.0, 13.0)])
    assert (
        closest_in_a_layer(MissionPlan.of(alone), synthetic.only(flight.trajectory, [0, 1, 2]))
        is None
    )
