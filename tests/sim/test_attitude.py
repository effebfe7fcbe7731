"""Attitude conventions, against rotations of SciPy and cases by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from sim import attitude

ANGLE = st.floats(-np.pi, np.pi)
TILT = st.floats(-1.5, 1.5)


@pytest.mark.parametrize(
    ("heading_deg", "forward"),
    [(0, (0, 1, 0)), (90, (1, 0, 0)), (180, (0, -1, 0)), (270, (-1, 0, 0))],
)
def test_heading_is_clockwise_from_north(
    heading_deg: float, forward: tuple[float, float, float]
) -> None:
    quaternion = attitude.from_euler(np.deg2rad(heading_deg))
    np.testing.assert_allclose(
        attitude.rotate(quaternion, np.array([1.0, 0, 0])), forward, atol=1e-15
    )


def test_positive_pitch_lifts_the_bow_and_positive_roll_lowers_starboard() -> None:
    bow = attitude.rotate(attitude.from_euler(0.7, pitch=0.1), np.array([1.0, 0, 0]))
    starboard = attitude.rotate(attitude.from_euler(0.7, roll=0.1), np.array([0.0, -1.0, 0]))
    assert bow[2] == pytest.approx(np.sin(0.1))
    assert starboard[2] == pytest.approx(-np.sin(0.1))


@given(heading=ANGLE, pitch=TILT, roll=ANGLE)
def test_angles_survive_the_conversion_to_a_quaternion_and_back(
    heading: float, pitch: float, roll: float
) -> None:
    quaternion = attitude.from_euler(heading, pitch, roll)
    assert np.linalg.norm(quaternion) == pytest.approx(1.0)
    actual = attitude.heading_pitch_roll(quaternion)
    assert np.cos(actual[0] - heading) == pytest.approx(1.0)
    assert actual[1] == pytest.approx(pitch, abs=1e-7)
    assert np.cos(actual[2] - roll) == pytest.approx(1.0)


def test_rotate_agrees_with_scipy() -> None:
    rng = np.random.default_rng(3)
    quaternion = rng.normal(size=(50, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    vector = rng.normal(size=(50, 3))
    expected = Rotation.from_quat(quaternion[:, [1, 2, 3, 0]]).apply(vector)
    np.testing.assert_allclose(attitude.rotate(quaternion, vector), expected, atol=1e-14)


def test_a_point_of_a_hull_is_placed_by_scipys_matrix() -> None:
    quaternion = Rotation.random(40, rng=np.random.default_rng(4)).as_quat()
    pose, offset = (1.0, 2.0, -3.0, *quaternion.T[[3, 0, 1, 2]]), np.array([0.7, -0.2, 0.3])
    expected = Rotation.from_quat(quaternion).apply(offset) + np.array(pose[:3])
    np.testing.assert_allclose(
        np.column_stack(attitude.body_point_in_world(pose, offset)), expected, atol=1e-14
    )
    forward = np.column_stack(attitude.forward_of(quaternion.T[[3, 0, 1, 2]]))
    np.testing.assert_allclose(
        forward, Rotation.from_quat(quaternion).as_matrix()[:, :, 0], atol=1e-14
    )


@given(heading=st.floats(-20.0, 20.0), pitch=TILT, roll=ANGLE)
def test_heading_is_within_one_turn(heading: float, pitch: float, roll: float) -> None:
    assert (
        0.0
        <= attitude.heading_pitch_roll(attitude.from_euler(heading, pitch, roll))[0]
        <= 2 * np.pi
    )


def test_slerp_agrees_with_scipy_and_takes_the_shorter_arc() -> None:
    start, end = attitude.from_euler(0.1, 0.2, -0.3), attitude.from_euler(1.4, -0.5, 0.2)
    fractions = np.linspace(0, 1, 7)
    rotations = Rotation.from_quat(np.stack([start, end])[:, [1, 2, 3, 0]])
    expected = Slerp([0, 1], rotations)(fractions).as_quat()[:, [3, 0, 1, 2]]
    for sign in (1, -1):
        interpolated = np.array([attitude.slerp(start, sign * end, u) for u in fractions])
        abs_dot_product = np.abs(np.einsum("ni,ni->n", interpolated, expected))
        np.testing.assert_allclose(abs_dot_product, 1.0, atol=1e-14)
    np.testing.assert_array_equal(attitude.slerp(start, start, 0.3), start / np.linalg.norm(start))


def test_quaternions_a_little_longer_than_1_are_interpolated() -> None:
    """Their scalar product exceeds 1, where the arc cosine is not defined."""
    too_long = attitude.from_euler(0.4, 0.1, -0.2) * (1.0 + 1e-9)
    assert too_long @ too_long > 1.0
    for sign in (1.0, -1.0):
        assert attitude.slerp(too_long, sign * too_long, 0.3) == pytest.approx(
            too_long / np.linalg.norm(too_long), rel=1e-12
        )


def test_angles_of_many_attitudes_have_their_shape() -> None:
    quaternion = (
        Rotation.random(24, rng=np.random.default_rng(6))
        .as_quat()[:, [3, 0, 1, 2]]
        .reshape(2, 3, 4, 4)
    )
    angles_of_one = attitude.heading_pitch_roll(quaternion[1, 2, 3])
    for angles, angle in zip(attitude.heading_pitch_roll(quaternion), angles_of_one, strict=True):
        assert angles.shape == (2, 3, 4)
        assert angles[1, 2, 3] == angle
