"""Station keeping of followers, and the closest pairs."""

import numpy as np
import pytest

from experiments.flight.fly import fly
from sim.scenario.parts import MissionPlan
from sim.tracking import (
    closest_approaches,
    closest_in_a_layer,
    contacts,
    pair_distances,
    station_keeping,
)
from tests import synthetic
from tests.sim.test_formation import mission


def test_figures_of_keeping_a_station_are_those_since_it_was_joined() -> None:
    time, off = 0.1 * np.arange(1001), np.full(1001, 3.0)
    off[:200], off[200:] = 50.0, 1.0
    off[300] = 11.0
    actual = station_keeping(off, time)
    assert actual.joined_s == pytest.approx(20.0)
    assert actual.station_rms_m == pytest.approx(np.sqrt((800 + 121) / 801))
    assert actual.station_p95_m == pytest.approx(1.0)
    assert (actual.station_max_m, actual.lost) == (11.0, True)
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
    actual = closest_in_a_layer(MissionPlan.of(scenario), flight.trajectory)
    assert actual is not None
    assert actual.pair == ("follower-1", "follower-2")
    apart = flight.trajectory.position[:, 1, :2] - flight.trajectory.position[:, 2, :2]
    assert actual.distance_m == pytest.approx(np.hypot(*apart.T).min())
    alone = mission(places=[(10.0, 0.0, 12.0), (10.0, 9.0, 13.0)])
    assert (
        closest_in_a_layer(MissionPlan.of(alone), synthetic.only(flight.trajectory, [0, 1, 2]))
        is None
    )


@pytest.mark.parametrize("instants", [1, 31, 32, 33, 401])
def test_no_pair_is_ever_nearer_than_its_bound(instants: int) -> None:
    """Twelve random walks, looked at in every 32nd instant."""
    steps = np.random.default_rng(instants).normal(0.0, 0.3, (instants, 12, 3))
    places = np.cumsum(steps, axis=0) + 5.0 * np.arange(12)[:, None]
    seen, bound = pair_distances(places)
    for i in range(12):
        for j in range(12):
            if j >= i:
                assert seen[i, j] == bound[i, j] == np.inf
                continue
            least = np.linalg.norm(places[:, i] - places[:, j], axis=1).min()
            assert bound[i, j] <= least <= seen[i, j]


def test_of_many_vehicles_the_nearest_pair_and_all_contacts_are_those_of_every_instant() -> None:
    """Twenty vehicles 6 m apart that wander; two of them pass within reach of their hulls, between
    two looks.
    """
    flight = synthetic.make_flight(40.0, 19)
    trajectory = flight.trajectory
    n = trajectory.time.size
    rng = np.random.default_rng(3)
    grid = np.stack([6.0 * (np.arange(20) % 5), 6.0 * (np.arange(20) // 5), np.full(20, -9.0)], 1)
    position = grid + np.cumsum(rng.normal(0.0, 0.02, (n, 20, 3)), axis=0)
    meeting = 205  # looks are at 192 and 224
    position[:, 17] = position[:, 4] + [0.0, 0.0, 0.05]
    position[:, 17, 0] += 0.5 * np.abs(np.arange(n) - meeting)
    moved = synthetic.moved(trajectory, position=position)
    space, level = closest_approaches(moved)
    names = moved.names
    for approach, axes in ((space, 3), (level, 2)):
        distances = {
            (names[j], names[i]): np.linalg.norm(
                position[:, i, :axes] - position[:, j, :axes], axis=1
            )
            for i in range(20)
            for j in range(i)
        }
        nearest = min(distances, key=lambda pair: distances[pair].min())
        assert approach.pair == nearest == (names[4], names[17])
        assert approach.distance_m == pytest.approx(distances[nearest].min(), abs=1e-12)
        assert approach.time_s == moved.time[meeting]
    (contact,) = contacts(moved)
    assert contact.pair == (names[4], names[17])
    assert abs(contact.time_s - moved.time[meeting]) < 0.5
