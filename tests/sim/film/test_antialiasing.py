"""Edges in frames: smoothed as by many samples, and nothing else changed."""

import numpy as np
import pytest

from laisn.arrays import Bytes
from sim.film import antialiasing


def halves(slope: float, across: bool, samples: int) -> Bytes:
    """A slanted edge between dark and bright water, each pixel the mean of samples²."""
    n = 96
    fine = (np.arange(n * samples) + 0.5) / samples
    x, y = np.meshgrid(fine, fine)
    u, v = (y, x) if across else (x, y)
    bright = v > 40.3 + slope * u
    share = bright.reshape(n, samples, n, samples).mean(axis=(1, 3))
    picture = np.array([20, 60, 80]) + share[..., None] * np.array([180, 120, 20])
    return np.round(picture).astype(np.uint8)


@pytest.mark.parametrize("slope", [0.08, 0.15, 0.3, -0.22])
@pytest.mark.parametrize("across", [False, True])
def test_smoothing_brings_an_edge_nearer_to_one_of_many_samples(slope: float, across: bool) -> None:
    hard, true = halves(slope, across, 1), halves(slope, across, 16)
    smooth = hard.copy()
    antialiasing.smooth(hard, smooth, np.array([[0, 0, 96, 96]]))
    inner = np.s_[4:-4, 4:-4]

    def error(picture: Bytes) -> float:
        return float(np.sqrt(np.mean((picture[inner].astype(float) - true[inner]) ** 2)))

    assert error(smooth) < 0.6 * error(hard)


def test_smoothing_leaves_faint_texture_and_what_lies_outside_alone() -> None:
    rng = np.random.default_rng(3)
    sand = (120 + rng.integers(0, 15, size=(60, 80, 1)) + np.zeros(3)).astype(np.uint8)
    out = sand.copy()
    antialiasing.smooth(sand, out, np.array([[0, 0, 80, 60]]))
    np.testing.assert_array_equal(out, sand)
    edge = halves(0.15, False, 1)
    part = edge.copy()
    antialiasing.smooth(edge, part, np.array([[30, -20, 25, 200]]))
    changed = np.argwhere((part != edge).any(axis=2))
    assert len(changed) > 10
    assert changed[:, 1].min() >= 30
    assert changed[:, 1].max() < 55


def test_smoothing_of_areas_that_overlap_is_that_of_each_of_their_pixels_once() -> None:
    """Areas, in any order, beyond the edges of the picture too, change what one about all of them
    changes there.
    """
    edge = halves(0.15, False, 1)
    areas = np.array([[50, 30, 30, 40], [-5, 38, 60, 20], [60, 45, 90, 9], [10, 97, 5, 5]])
    whole, parts = edge.copy(), edge.copy()
    antialiasing.smooth(edge, whole, np.array([[0, 0, 96, 96]]))
    antialiasing.smooth(edge, parts, areas)
    inside = np.zeros((96, 96), bool)
    for left, top, width, height in areas:
        inside[max(top, 0) : top + height, max(left, 0) : left + width] = True
    assert (whole != edge)[inside].any()
    np.testing.assert_array_equal(parts, np.where(inside[..., None], whole, edge))
