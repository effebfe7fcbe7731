"""The smooth profile of sound: times through it, above, between and below its points."""

import itertools

import pytest
from scipy.integrate import quad

from sim.water.smooth_profile import SmoothProfile, mean_slowness, speed_and_gradient

PROFILE = SmoothProfile.through([[12.0, 1500.0], [20.0, 1520.0], [35.0, 1480.0]])
KNOTS = PROFILE.depth.tolist()


@pytest.mark.parametrize(("upper", "lower"), [(2.0, 14.0), (11.5, 40.0), (15.0, 30.0), (0.0, 60.0)])
def test_mean_slowness_is_the_quadrature_of_slowness_between_two_depths(
    upper: float, lower: float
) -> None:
    """Also above and below the points of the profile, where the gradient fades and then the speed
    is constant.
    """
    limits = sorted({upper, lower, *(depth for depth in KNOTS if upper < depth < lower)})
    time = sum(
        quad(lambda z: 1.0 / speed_and_gradient(PROFILE, z, 0)[0], a, b, epsabs=1e-14)[0]
        for a, b in itertools.pairwise(limits)
    )
    assert mean_slowness(PROFILE, upper, lower) == pytest.approx(time / (lower - upper), rel=1e-9)
