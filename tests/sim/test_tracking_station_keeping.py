"""Measures of station keeping, and the closest pairs of vehicles."""

import numpy as np
import pytest

from experiments.flight.fly import fly
from sim.scenario.parts import MissionPlan
from sim.tracking import (
    closest_approaches,
    closest_in_a_layer,
    contacts,
    least_distances,
    pair_distances,
    station_keeping,
)
from tests import synthetic
from tests.sim.test_formation import mission


def test_measures_of_station_keeping_begin_when_the_station_is_joined() -> None:
    time, distance = 0.1 * np.arange(1001), np.full(1001, 3.0)
    distance[:200], distance[200:] = 50.0, 1.0
    distance[300] = 11.0
    actual = station_keeping(distance, time)
    assert actual.joined_s == pytest.approx(20.0)
    assert actual.station_rms_m == pytest.approx(np.sqrt((800 + 121) / 801))
    assert actual.station_p95_m == pytest.approx(1.0)
    assert (actual.station_max_m, actual.lost) == (11.0, True)
    # joined at the second instant, as 2 m is not within 2 m; then linear from 0 to 6 m, of which
    # 95 % are below 5.7 m
    rising = station_keeping(np.r_[2.0, np.linspace(0.0, 6.0, 1001)], np.arange(1002.0))
    assert (rising.joined_s, rising.station_p95_m) == pytest.approx((1.0, 5.7))
    assert not station_keeping(np.array([0.0, 10.0]), np.arange(2.0)).lost
    never_joined = station_keeping(np.full(10, 3.0), 0.1 * np.arange(10))
    assert np.isnan(never_joined.joined_s)
    assert never_joined.lost


def test_the_nearest_pair_is_named_with_its_distance_and_time() -> None:
    flight, _ = fly(
        mission(stations=[(10.0, 0.0, 12.0), (10.0, 4.0, 12.0), (30.0, 0.0, 20.0)], duration=5.0)
    )
    space, horizontal = closest_approaches(flight.trajectory)
    assert space.pair == horizontal.pair == ("follower-1", "follower-2")
    distance = np.linalg.norm(
        flight.trajectory.position[:, 1] - flight.trajectory.position[:, 2], axis=1
    )
    assert space.distance_m == pytest.approx(distance.min())
    assert space.time_s == pytest.approx(flight.trajectory.time[np.argmin(distance)])


def test_the_nearest_pair_of_one_layer_is_found_beside_nearer_ones() -> None:
    """Depths 12, 12.9 and 20 m: the third is nearer to the first, but not in its layer; the
    leader is at 8 m.
    """
    stations = [(10.0, 0.0, 12.0), (10.0, 9.0, 12.9), (10.0, 3.5, 20.0)]
    scenario = mission(stations=stations, duration=3.0)
    flight, _ = fly(scenario)
    actual = closest_in_a_layer(MissionPlan.of(scenario), flight.trajectory)
    assert actual is not None
    assert actual.pair == ("follower-1", "follower-2")
    offset = flight.trajectory.position[:, 1, :2] - flight.trajectory.position[:, 2, :2]
    assert actual.distance_m == pytest.approx(np.hypot(*offset.T).min())
    in_two_layers = mission(stations=[(10.0, 0.0, 12.0), (10.0, 9.0, 13.0)])
    assert (
        closest_in_a_layer(
            MissionPlan.of(in_two_layers), synthetic.only(flight.trajectory, [0, 1, 2])
        )
        is None
    )


@pytest.mark.parametrize("instants", [1, 31, 32, 33, 401])
def test_no_pair_is_ever_nearer_than_its_bound(instants: int) -> None:
    """Twelve random walks: distances at each 32nd instant, and their lower bounds at all others."""
    steps = np.random.default_rng(instants).normal(0.0, 0.3, (instants, 12, 3))
    positions = np.cumsum(steps, axis=0) + 5.0 * np.arange(12)[:, None]
    sampled_distance, bound = pair_distances(positions)
    for i in range(12):
        for j in range(12):
            if j >= i:
                assert sampled_distance[i, j] == bound[i, j] == np.inf
                continue
            least_distance = np.linalg.norm(positions[:, i] - positions[:, j], axis=1).min()
            assert bound[i, j] <= least_distance <= sampled_distance[i, j]


def test_a_pair_with_a_place_that_is_not_a_number_has_no_bound() -> None:
    """Vehicle 2 of four at rest is nowhere at one instant between two looks."""
    positions = np.zeros((100, 4, 3))
    positions[..., 0] = 5.0 * np.arange(4)
    positions[40, 2] = np.nan
    bound = pair_distances(positions).bound
    assert np.argwhere(np.isnan(bound)).tolist() == [[2, 0], [2, 1], [3, 2]]
    assert bound[[1, 3, 3], [0, 0, 1]] == pytest.approx([5.0, 15.0, 10.0], abs=1e-5)


def test_least_distances_are_those_of_every_instant() -> None:
    positions = np.random.default_rng(5).normal(0.0, 10.0, (50, 5, 3))
    offsets = positions[:, :, None] - positions[:, None]
    itself = np.where(np.eye(5) > 0, np.inf, 0.0)
    actual = least_distances(positions)
    np.testing.assert_allclose(
        actual.in_space, np.linalg.norm(offsets, axis=-1).min(axis=0) + itself, rtol=1e-14
    )
    np.testing.assert_allclose(
        actual.horizontal,
        np.linalg.norm(offsets[..., :2], axis=-1).min(axis=0) + itself,
        rtol=1e-14,
    )


def test_least_distances_from_a_vehicle_whose_place_is_not_a_number_are_none() -> None:
    positions = np.random.default_rng(6).normal(0.0, 10.0, (50, 4, 3))
    positions[20, 2, 2] = np.nan
    actual = least_distances(positions)
    of_the_lost = [[0, 2], [1, 2], [2, 0], [2, 1], [2, 3], [3, 2]]
    assert np.argwhere(np.isnan(actual.in_space)).tolist() == of_the_lost
    # the depth alone is missing
    assert not np.isnan(actual.horizontal).any()
    positions[20, 2, 0] = np.nan
    assert np.argwhere(np.isnan(least_distances(positions).horizontal)).tolist() == of_the_lost


def test_of_many_vehicles_the_nearest_pair_and_all_contacts_are_those_of_every_instant() -> None:
    """Twenty random walks, 6 m apart at first; the hulls of two touch between two of the instants
    at which all distances are computed. Expected are the least distances over all instants.
    """
    flight = synthetic.make_flight(40.0, 19)
    trajectory = flight.trajectory
    n = trajectory.time.size
    rng = np.random.default_rng(3)
    grid = np.stack([6.0 * (np.arange(20) % 5), 6.0 * (np.arange(20) // 5), np.full(20, -9.0)], 1)
    position = grid + np.cumsum(rng.normal(0.0, 0.02, (n, 20, 3)), axis=0)
    meeting = 205  # distances are computed at 192 and 224
    position[:, 17] = position[:, 4] + [0.0, 0.0, 0.05]
    position[:, 17, 0] += 0.5 * np.abs(np.arange(n) - meeting)
    wandering = synthetic.moved(trajectory, position=position)
    space, horizontal = closest_approaches(wandering)
    names = wandering.names
    for approach, axes in ((space, 3), (horizontal, 2)):
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
        assert approach.time_s == wandering.time[meeting]
    (contact,) = contacts(wandering)
    assert contact.pair == (names[4], names[17])
    assert abs(contact.time_s - wandering.time[meeting]) < 0.5
