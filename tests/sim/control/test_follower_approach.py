"""Avoidance: hand calculations, and two approaching points against the distance where the law
stops them.
"""

import numpy as np
import pytest

from laisn.arrays import Records
from sim.control.follower import give_way, repulsion_velocity
from sim.scenario.formation import Formation, Proximity
from sim.sensing.proximity import SIGHTING

PROXIMITY, FORMATION = (
    Proximity(range_m=5.0, full_avoidance_range_m=3.0, max_avoidance_speed_m_s=0.8).record(),
    Formation().record(),
)


def sighting(east: float, north: float, heading: float = 0.0) -> Records:
    """A vehicle in sight, so far east and north [m] of a hull on this heading [rad]."""
    return np.array([(np.hypot(east, north), np.arctan2(east, north) - heading)], SIGHTING).view(
        np.recarray
    )


@pytest.mark.parametrize(
    ("distance", "speed"), [(5.1, 0.0), (5.0, 0.0), (4.0, 0.4), (3.5, 0.6), (3.0, 0.8), (1.0, 0.8)]
)
def test_the_push_grows_from_the_sensors_range_to_that_of_full_speed(
    distance: float, speed: float
) -> None:
    for heading in (0.0, 2.0):
        push = repulsion_velocity(
            PROXIMITY, sighting(0.6 * distance, 0.8 * distance, heading), heading
        )
        assert push == pytest.approx((-0.6 * speed, -0.8 * speed))


def test_without_neighbours_the_avoidance_velocity_is_zero() -> None:
    assert repulsion_velocity(
        PROXIMITY, np.concatenate([sighting(np.nan, 0.0)] * 3).view(np.recarray), 1.0
    ) == (0.0, 0.0)


def test_pushes_add_up_to_full_speed_at_most() -> None:
    at_right_angles = np.concatenate([sighting(2.0, 0.0), sighting(0.0, 2.0)]).view(np.recarray)
    assert repulsion_velocity(PROXIMITY, at_right_angles, 0.0) == pytest.approx(
        (-0.8 * np.sqrt(0.5), -0.8 * np.sqrt(0.5))
    )
    opposite = np.concatenate([sighting(4.0, 0.0), sighting(-4.0, 0.0)]).view(np.recarray)
    assert repulsion_velocity(PROXIMITY, opposite, 0.0) == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize("closing", [0.4, 1.0, 1.5])
def test_two_approaching_vehicles_stop_at_the_distance_of_the_law(closing: float) -> None:
    """Points that move as commanded stop where their avoidance velocities w(d) make up for the
    speed c at which they close up: 2 w(d) = c at d = R − (R − F) c / 2W, with the range R, that of
    full avoidance F, and its speed W. They come no nearer.
    """
    final_distance = 5.0 - 2.0 * closing / (2 * 0.8)
    distance, min_distance = 12.0, 12.0
    for _ in range(4000):
        push = repulsion_velocity(PROXIMITY, sighting(distance, 0.0), 0.0)[0]
        distance += 0.02 * (-closing - 2.0 * push)
        min_distance = min(min_distance, distance)
    assert distance == pytest.approx(final_distance, abs=1e-3)
    assert min_distance >= final_distance - 1e-9
    assert min_distance >= PROXIMITY.full_avoidance_range


def test_a_hull_that_gives_way_keeps_its_least_and_greatest_speed() -> None:
    """Commanded velocity 1 m/s east; pushed back by 0.5 m/s, by more than it has, and aside; at
    2.4 m/s pushed forward.
    """
    east = np.pi / 2
    assert give_way(FORMATION, (east, 1.0), (-0.5, 0.0)) == pytest.approx((east, 0.5))
    assert give_way(FORMATION, (east, 1.0), (-2.0, 0.0)) == pytest.approx((east, 0.2))
    heading, speed = give_way(FORMATION, (east, 1.0), (0.0, 0.75))
    assert (heading, speed) == pytest.approx((east - np.arctan2(0.75, 1.0), 1.25))
    assert give_way(FORMATION, (east, 2.4), (0.8, 0.0))[1] == pytest.approx(2.5)
