"""A leader that weaves: positions of both vehicles and the longer path in closed form, and how the
bound changes with the weave.
"""

import numpy as np
import pytest
from scipy.special import j0

from experiments.studies.formation.findings import (
    DISTANCES_BEHIND_M,
    WEAVES,
    extra_way,
    geometry,
    least_error,
    weave_findings,
)


def test_the_follower_is_where_the_leader_was_and_the_transmitters_on_the_axis_now() -> None:
    """For small amplitudes a: with the heading a sin ωt, the leader is a v/ω (1 − cos ωt) aside of
    its course.
    """
    amplitude, omega, delay = np.deg2rad(1.0), 2 * np.pi / 40.0, 20.0
    bound_geometry = geometry(1.0, 40.0, delay)
    time = bound_geometry.dt * bound_geometry.message_step
    time_of_leader = bound_geometry.dt * np.arange(1, 3001) - delay
    np.testing.assert_allclose(
        bound_geometry.heading, amplitude * np.sin(omega * time_of_leader), rtol=0, atol=1e-12
    )
    east = amplitude / omega * (np.cos(omega * time) - np.cos(omega * (time - delay)))
    np.testing.assert_allclose(bound_geometry.from_leader[:, 0], east, atol=0.002)
    np.testing.assert_allclose(bound_geometry.from_leader[:, 1], -delay, atol=0.01)
    heading = amplitude * np.sin(omega * time)
    axis = np.column_stack([np.sin(heading), np.cos(heading)])
    np.testing.assert_allclose(
        bound_geometry.arms[:, 1, :2] - bound_geometry.arms[:, 0, :2], 2.0 * axis, atol=1e-12
    )
    np.testing.assert_array_equal(bound_geometry.arms[:, :, 2], -10.0)


def test_without_a_weave_the_follower_is_straight_behind() -> None:
    bound_geometry = geometry(0.0, 40.0, 40.0)
    np.testing.assert_allclose(
        bound_geometry.from_leader, np.tile([0.0, -40.0], (300, 1)), atol=1e-9
    )
    # a follower that is 40 m behind, and follows by 40 s, swims 1 m/s
    np.testing.assert_array_equal(bound_geometry.speed, 1.0)
    assert (bound_geometry.dt, bound_geometry.speed.size) == (0.1, 3000)
    assert extra_way(0.0) == 0.0


@pytest.mark.parametrize("amplitude", [2.0, 5.0, 10.0])
def test_the_longer_path_of_a_weave_follows_from_a_bessel_function(amplitude: float) -> None:
    """The mean of cos(a sin φ) over a period is J₀(a)."""
    assert extra_way(amplitude) == pytest.approx(1.0 / j0(np.deg2rad(amplitude)) - 1.0, rel=1e-9)


def test_the_bound_shrinks_with_more_amplitude_and_less_distance() -> None:
    for behind in DISTANCES_BEHIND_M:
        errors = [
            least_error(amplitude, 40.0, float(behind)) for amplitude in (0.0, 2.0, 5.0, 10.0)
        ]
        assert errors == sorted(errors, reverse=True)
        assert errors[-1] < 0.6 * errors[0]
    assert all(
        least_error(amplitude, period, 20.0) < least_error(amplitude, period, 40.0)
        for amplitude, period in WEAVES
    )
    actual = weave_findings()
    assert len(actual) == len(WEAVES) * (len(DISTANCES_BEHIND_M) + 1)
    assert actual["weave 5 40 20"].value == pytest.approx(least_error(5.0, 40.0, 20.0), rel=1e-5)
