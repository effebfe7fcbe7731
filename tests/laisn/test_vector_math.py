"""Elementary functions of compiled code, against those of NumPy."""

import math

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.compiled import compiled
from laisn.simd import LANES, lanes_of
from laisn.vector_math import (
    arcsin,
    arctan,
    arctan2,
    exp,
    half_turn_angle,
    log,
    powers_of_two,
    sin_cos,
    sin_cos_of_right_angles,
)


@compiled
def _functions(x: Floats, y: Floats) -> Floats:
    out = np.empty((x.size, 4))
    for i in range(x.size):
        out[i, 0] = log(abs(x[i]))
        out[i, 1], out[i, 2] = sin_cos(x[i])
        out[i, 3] = half_turn_angle(x[i], y[i])
    return out


@compiled
def _angles(y: Floats, x: Floats, sine: Floats) -> Floats:
    out = np.empty((x.size, 3))
    for i in range(x.size):
        out[i, 0] = arctan2(y[i], x[i])
        out[i, 1] = arctan(y[i])
        out[i, 2] = arcsin(sine[i])
    return out


@compiled
def _angles_in_lanes(y: Floats, x: Floats, sine: Floats, out: Floats) -> None:
    ys = lanes_of(y)
    xs = lanes_of(x)
    sines = lanes_of(sine)
    results = lanes_of(out)
    for i in range(x.shape[0]):
        results[i, 0] = arctan2(ys[i], xs[i])
        results[i, 1] = arctan(ys[i])
        results[i, 2] = arcsin(sines[i])


@compiled
def _exponentials(x: Floats) -> Floats:
    out = np.empty(x.size)
    for i in range(x.size):
        out[i] = exp(x[i])
    return out


@compiled
def _scaled(x: Floats) -> Floats:
    out = np.empty((x.size, 4))
    for i in range(x.size):
        out[i, 0], out[i, 1] = sin_cos_of_right_angles(x[i])
        out[i, 2], out[i, 3] = powers_of_two(x[i])
    return out


@compiled
def _scaled_in_lanes(x: Floats, out: Floats) -> None:
    values = lanes_of(x)
    results = lanes_of(out)
    for i in range(x.shape[0]):
        results[i, 0], results[i, 1] = sin_cos_of_right_angles(values[i])
        results[i, 2], results[i, 3] = powers_of_two(values[i])


@compiled
def _in_lanes(x: Floats, out: Floats) -> None:
    values = lanes_of(x)
    results = lanes_of(out)
    for i in range(x.shape[0]):
        results[i, 0] = exp(values[i])
        results[i, 1], results[i, 2] = sin_cos(values[i])


def test_functions_of_lanes_have_the_bits_of_those_of_numbers() -> None:
    """In all four quadrants, both signs of zero, and where the exponential has few bits left."""
    generator = np.random.default_rng(5)
    x = generator.uniform(-700.0, 700.0, (500, LANES))
    x[:9] = (np.arange(-4, 5) * (0.5 * math.pi))[:, None] + generator.normal(0.0, 1e-9, LANES)
    x[9] = [0.0, -0.0, 1e-300, -1e-300, 708.0, -707.0, 1.0, -1.0]
    out = np.empty((500, 3, LANES))
    _in_lanes(x, out)
    flat = np.ascontiguousarray(x.ravel())
    np.testing.assert_array_equal(out[:, 0].ravel(), _exponentials(flat))
    expected = _functions(flat, flat)
    for i in (1, 2):
        of_lanes = np.ascontiguousarray(out[:, i].ravel())
        of_numbers = np.ascontiguousarray(expected[:, i])
        np.testing.assert_array_equal(of_lanes.view(np.uint64), of_numbers.view(np.uint64))


def _vectors() -> tuple[Floats, Floats, Floats]:
    """Components y and x of vectors of all directions and many lengths, the axes and diagonals
    among them, and sines, the ends of their range among them; shape (500, LANES) each.
    """
    generator = np.random.default_rng(11)
    angle = generator.uniform(-np.pi, np.pi, (500, LANES))
    length = 10.0 ** generator.uniform(-8.0, 3.0, angle.shape)
    y = length * np.sin(angle)
    x = length * np.cos(angle)
    y[0] = [0.0, 0.0, 1.0, -1.0, 2.0, 2.0, -2.0, -2.0]
    x[0] = [3.0, -3.0, 0.0, 0.0, 2.0, -2.0, 2.0, -2.0]
    sine = generator.uniform(-1.0, 1.0, angle.shape)
    sine[0] = [1.0, -1.0, 0.0, 1.0 - 1e-12, 1e-9 - 1.0, 1e-300, 0.5, -0.5]
    return y, x, sine


def test_angles_agree_with_the_library_in_all_quadrants() -> None:
    y, x, sine = (values.ravel() for values in _vectors())
    result = _angles(y, x, sine)
    assert result[:, 0] == pytest.approx(np.arctan2(y, x), abs=1e-15, rel=1e-15)
    assert result[:, 1] == pytest.approx(np.arctan(y), abs=1e-15, rel=1e-15)
    assert result[:, 2] == pytest.approx(np.arcsin(sine), abs=1e-15, rel=1e-15)


def test_angle_of_no_vector_is_zero_with_the_sign_of_its_first_component() -> None:
    zeros = np.array([0.0, -0.0])
    result = _angles(zeros, np.zeros(2), zeros)
    np.testing.assert_array_equal(np.signbit(result[:, 0]), [False, True])
    np.testing.assert_array_equal(result, np.zeros((2, 3)))


def test_angles_of_lanes_have_the_bits_of_those_of_numbers() -> None:
    y, x, sine = _vectors()
    out = np.empty((len(y), 3, LANES))
    _angles_in_lanes(y, x, sine, out)
    alone = _angles(y.ravel(), x.ravel(), sine.ravel())
    of_lanes = np.moveaxis(out, 1, 2).reshape(-1, 3)
    np.testing.assert_array_equal(of_lanes, alone)


def test_scaled_functions_agree_with_the_library() -> None:
    """In extended precision, over their whole range."""
    generator = np.random.default_rng(9)
    x = np.concatenate([np.linspace(-3.0, 3.0, 60_001), generator.uniform(-1020.0, 1020.0, 20_000)])
    result = _scaled(x)
    exact = x.astype(np.longdouble)
    angle = np.fmod(exact, 4) * 2 * np.arctan(np.longdouble(1))
    assert np.abs(result[:, 0] - np.sin(angle)).max() < 1e-15
    assert np.abs(result[:, 1] - np.cos(angle)).max() < 1e-15
    assert np.abs(result[:, 2] / np.exp2(exact) - 1).max() < 1e-15
    assert np.abs(result[:, 3] * np.exp2(exact) - 1).max() < 1e-15


def test_scaled_functions_of_whole_numbers_are_exact() -> None:
    x = np.arange(-1020.0, 1021.0)
    result = _scaled(x)
    quarter = x.astype(int) % 4
    np.testing.assert_array_equal(result[:, 0], np.array([0.0, 1.0, 0.0, -1.0])[quarter])
    np.testing.assert_array_equal(result[:, 1], np.array([1.0, 0.0, -1.0, 0.0])[quarter])
    np.testing.assert_array_equal(result[:, 2], np.exp2(x))
    np.testing.assert_array_equal(result[:, 3], np.exp2(-x))


def test_scaled_functions_of_lanes_have_the_bits_of_those_of_numbers() -> None:
    x = np.random.default_rng(10).uniform(-1020.0, 1020.0, (500, LANES))
    x[0] = [0.0, -0.0, 0.5, -0.5, 1020.0, -1020.0, 1.5, 2.5]
    out = np.empty((500, 4, LANES))
    _scaled_in_lanes(x, out)
    of_lanes = np.ascontiguousarray(np.moveaxis(out, 1, 2).reshape(-1, 4))
    np.testing.assert_array_equal(of_lanes.view(np.uint64), _scaled(x.ravel()).view(np.uint64))


@pytest.mark.system
def test_elementary_functions_agree_with_the_library() -> None:
    generator = np.random.default_rng(7)
    x = np.concatenate(
        [generator.uniform(-1000, 1000, 20_000), generator.normal(size=20_000) * 1e-6]
    )
    y = generator.normal(size=x.size) * 10.0 ** generator.uniform(-8, 3, x.size)
    result = _functions(x, y)
    assert result[:, 0] == pytest.approx(np.log(np.abs(x)), abs=1e-14)
    assert result[:, 1] == pytest.approx(np.sin(x), abs=1e-14)
    assert result[:, 2] == pytest.approx(np.cos(x), abs=1e-14)
    assert result[:, 3] == pytest.approx(np.arctan2(np.abs(x), y), abs=1e-14)


def test_logarithm_keeps_its_relative_accuracy_near_one() -> None:
    x = 1.0 + np.linspace(-1e-3, 1e-3, 2001)
    assert _functions(x, x)[:, 0] == pytest.approx(np.log(x), rel=1e-14, abs=1e-300)


def test_exponential_keeps_its_relative_accuracy_over_its_whole_range() -> None:
    x = np.concatenate(
        [
            np.linspace(-708.0, 709.0, 40_001),
            np.linspace(-1.0, 1.0, 40_001),
            [0.0, 0.5 * math.log(2.0)],
        ]
    )
    np.testing.assert_allclose(_exponentials(x), np.exp(x), rtol=4e-16)
    assert _exponentials(np.zeros(1))[0] == 1.0


def test_angles_along_the_axes_are_exact_and_that_of_the_origin_is_zero() -> None:
    """`half_turn_angle(x, y)` is that of (|x|, y) from the y axis, arctan2(|x|, y)."""
    angles = _functions(
        np.array([1e-300, 1.0, -1.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0, -1e300, 0.0])
    )[:, 3]
    assert angles == pytest.approx([0.0, math.pi / 2, math.pi / 2, math.pi, 0.0], abs=1e-15)
