"""Edges in frames: smoothed as by many samples, and nothing else changed."""

import numpy as np
import pytest

from laisn.arrays import Bytes
from sim.film import antialiasing


def slanted_edge(slope: float, steep: bool, samples: int) -> Bytes:
    """A slanted edge between dark and bright water, nearly level or nearly upright; each pixel of
    96 × 96 is the mean of samples².
    """
    size = 96
    samples_px = (np.arange(size * samples) + 0.5) / samples
    x, y = np.meshgrid(samples_px, samples_px)
    run, rise = (y, x) if steep else (x, y)
    bright = rise > 40.3 + slope * run
    bright_fraction = bright.reshape(size, samples, size, samples).mean(axis=(1, 3))
    picture = np.array([20, 60, 80]) + bright_fraction[..., None] * np.array([180, 120, 20])
    return np.round(picture).astype(np.uint8)


@pytest.mark.parametrize("slope", [0.08, 0.15, 0.3, -0.22])
@pytest.mark.parametrize("steep", [False, True])
def test_smoothing_brings_an_edge_nearer_to_one_of_many_samples(slope: float, steep: bool) -> None:
    aliased, reference = slanted_edge(slope, steep, 1), slanted_edge(slope, steep, 16)
    smoothed = aliased.copy()
    antialiasing.smooth(aliased, smoothed, np.array([[0, 0, 96, 96]]))
    inner = np.s_[4:-4, 4:-4]

    def error(picture: Bytes) -> float:
        return float(np.sqrt(np.mean((picture[inner].astype(float) - reference[inner]) ** 2)))

    assert error(smoothed) < 0.6 * error(aliased)


def test_smoothing_leaves_faint_texture_and_what_lies_outside_alone() -> None:
    rng = np.random.default_rng(3)
    sand = (120 + rng.integers(0, 15, size=(60, 80, 1)) + np.zeros(3)).astype(np.uint8)
    smoothed_sand = sand.copy()
    antialiasing.smooth(sand, smoothed_sand, np.array([[0, 0, 80, 60]]))
    np.testing.assert_array_equal(smoothed_sand, sand)
    edge = slanted_edge(0.15, False, 1)
    smoothed_edge = edge.copy()
    antialiasing.smooth(edge, smoothed_edge, np.array([[30, -20, 25, 200]]))
    changed = np.argwhere((smoothed_edge != edge).any(axis=2))
    assert len(changed) > 10
    assert changed[:, 1].min() >= 30
    assert changed[:, 1].max() < 55


def test_pixels_of_overlapping_areas_are_smoothed_once() -> None:
    """Areas in any order, some beyond the edges of the picture, change within them what smoothing
    of the whole picture changes there.
    """
    edge = slanted_edge(0.15, False, 1)
    areas = np.array([[50, 30, 30, 40], [-5, 38, 60, 20], [60, 45, 90, 9], [10, 97, 5, 5]])
    smoothed_whole, smoothed_areas = edge.copy(), edge.copy()
    antialiasing.smooth(edge, smoothed_whole, np.array([[0, 0, 96, 96]]))
    antialiasing.smooth(edge, smoothed_areas, areas)
    inside = np.zeros((96, 96), bool)
    for left, top, width, height in areas:
        inside[max(top, 0) : top + height, max(left, 0) : left + width] = True
    assert (smoothed_whole != edge)[inside].any()
    np.testing.assert_array_equal(smoothed_areas, np.where(inside[..., None], smoothed_whole, edge))
