"""The Cramér–Rao bound against closed forms and an independent recursion."""

from dataclasses import replace

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.bound import Geometry, TrueNoise, position_bound

KNOWN = TrueNoise(speed_bias=0.0, heading_bias=0.0, range_scale_bias=0.0, range_scale_sigma=0.0, heading_sigma=0.0)
"""No biases, and a compass without errors."""


def at_rest(n: int, away: tuple[float, float], arms: Floats, every: int = 1) -> Geometry:
    step = np.arange(every, n + 1, every)
    return Geometry(
        dt=0.1,
        speed=np.zeros(n),
        heading=np.zeros(n),
        message_step=step,
        from_leader=np.tile(away, (step.size, 1)),
        arms=np.tile(arms, (step.size, 1, 1)),
    )


def test_without_ranges_the_bound_is_that_of_dead_reckoning() -> None:
    """North for n steps: the log's errors add along the way; the compass's and its bias across it."""
    n, sigma, bias = 50, np.deg2rad(2.0), np.deg2rad(5.0)
    noise = TrueNoise(speed_sigma=0.2, speed_bias=0.1, heading_sigma=sigma, heading_bias=bias, start=0.5)
    geometry = replace(at_rest(n, (0.0, -20.0), np.full((3, 3), np.nan)), speed=np.full(n, 1.5))
    bound = position_bound(geometry, noise)[-1]
    along = 0.25 + n * (0.2 * 0.1) ** 2 + (0.1 * 0.1 * n) ** 2
    across = 0.25 + n * (1.5 * sigma * 0.1) ** 2 + (1.5 * 0.1 * n * bias) ** 2
    np.testing.assert_allclose(bound, np.diag([across, along]), rtol=1e-12, atol=1e-12)


def test_biases_turn_and_shorten_the_whole_way_however_it_bends() -> None:
    """Three legs: a compass bias moves the end across the way made good, a log's bias along the sum of headings."""
    heading = np.repeat(np.deg2rad([30.0, 110.0, -160.0]), [40, 70, 25])
    speed = np.repeat([1.5, 1.1, 0.9], [40, 70, 25])
    geometry = replace(at_rest(heading.size, (0.0, 0.0), np.full((3, 3), np.nan)), speed=speed, heading=heading)
    log, compass, still = 0.1, np.deg2rad(5.0), replace(KNOWN, speed_sigma=0.0)
    ahead = 0.1 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    east, north = (speed[:, None] * ahead).sum(axis=0)
    aside, along = np.array([-north, east]), ahead.sum(axis=0)
    for noise, expected in (
        (replace(still, heading_bias=compass), compass**2 * np.outer(aside, aside)),
        (replace(still, speed_bias=log), log**2 * np.outer(along, along)),
    ):
        start = np.eye(2) * still.start**2
        np.testing.assert_allclose(position_bound(geometry, noise)[-1] - start, expected, rtol=1e-9, atol=1e-12)


def test_repeated_ranges_at_rest_add_their_information() -> None:
    """Two transmitters at right angles as seen from the follower: each axis has n/σ² beside 1/σ₀²."""
    arms = np.array([[50.0, 0.0, 0.0], [0.0, 50.0, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.0, range_sigma=0.3, start=2.0)
    bound = position_bound(at_rest(8, (0.0, 0.0), arms), noise, averaged=False)
    for k in range(8):
        np.testing.assert_allclose(bound[k], np.eye(2) / (0.25 + (k + 1) / 0.09), rtol=1e-12, atol=1e-15)


def test_a_scalar_random_walk_reaches_the_riccati_equations_fixed_point() -> None:
    """Motion noise q a step and range noise r along one axis: p⁺ = p r / (p + r) with p = p⁺ + q."""
    arms = np.array([[0.0, 1e7, 0.0]])
    noise = replace(KNOWN, speed_sigma=1.0, range_sigma=0.5)
    north = position_bound(at_rest(300, (0.0, 0.0), arms), noise, averaged=False)[-1, 1, 1]
    q, r = (1.0 * 0.1) ** 2, 0.25
    assert north == pytest.approx(0.5 * (np.sqrt(q * q + 4 * q * r) - q), rel=1e-6)


def test_on_the_axis_of_two_transmitters_only_the_average_says_anything_aside() -> None:
    arms = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.0, start=3.0)
    geometry = at_rest(20, (0.0, -40.0), arms)
    at_truth = position_bound(geometry, noise, averaged=False)[-1]
    averaged = position_bound(geometry, noise)[-1]
    assert at_truth[0, 0] == pytest.approx(9.0)
    assert averaged[0, 0] < 1.0


def test_more_is_known_with_more_and_less_with_more_unknowns() -> None:
    arms = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [-0.1, 0.0, 0.0]])
    geometry = replace(at_rest(200, (-15.0, -20.0), arms, every=10), speed=np.ones(200), heading=np.linspace(0, 3, 200))

    def last(noise: TrueNoise, g: Geometry = geometry) -> float:
        return float(np.trace(position_bound(g, noise, averaged=False)[-1]))

    base = last(TrueNoise())
    two = replace(geometry, arms=geometry.arms[:, :2])
    assert last(TrueNoise(), two) > base
    for unknown in ({"leader_heading_bias": 0.1}, {"current": 0.4}, {"range_offset": 0.02}):
        assert last(TrueNoise(**unknown)) > base
    assert last(TrueNoise(leader_heading_bias=0.1, leader_heading_sigma=0.03)) > last(
        TrueNoise(leader_heading_bias=0.1)
    )
    lost = geometry.arms.copy()
    lost[::2] = np.nan
    assert last(TrueNoise(), replace(geometry, arms=lost)) > base


def test_noise_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match=r"speed_sigma is -1\.0, expected a finite number, zero or more"):
        TrueNoise(speed_sigma=-1.0)
