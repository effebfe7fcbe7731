"""Trajectories: interpolation, sites, files."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim import attitude
from sim.trajectory import Trajectory, tilted
from tests import synthetic

RADIUS, RATE = 20.0, 0.05
"""Of a circle [m], and rate of turn on it [rad/s]."""


def circle(time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Closed form of a vehicle that circles at constant pitch: position, velocity, quaternion."""
    angle = RATE * time
    position = np.stack([RADIUS * np.sin(angle), RADIUS * np.cos(angle), -5 + 0.1 * time], axis=-1)
    velocity = np.stack(
        [RADIUS * RATE * np.cos(angle), -RADIUS * RATE * np.sin(angle), 0.1 + 0 * time], axis=-1
    )
    return position, velocity, attitude.from_euler(np.pi / 2 + angle, pitch=0.1)


@pytest.fixture
def trajectory() -> Trajectory:
    """A leader on the circle, and a follower 50 m north of it."""
    time = np.arange(301) * 0.1
    position, velocity, quaternion = circle(time)
    shift = np.array([0.0, 50.0, 0.0])
    n = time.size
    return Trajectory(
        names=("leader", "follower"),
        time=time,
        pose=np.stack(
            [np.hstack([point, quaternion]) for point in (position, position + shift)], axis=1
        ),
        twist=np.stack([np.hstack([velocity, np.zeros((n, 3))])] * 2, axis=1),
        water_velocity=np.zeros((n, 2, 3)),
        effector_states=np.zeros((n, 2, 0)),
        effector_force=np.zeros((2, 0, 3)),
        site_names=("leader/tx_front", "follower/hydrophone"),
        site_vehicle=np.array([0, 1]),
        site_offset=np.array([[1.0, 0, 0], [0, 0, 0.1]]),
    )


def test_interpolation_gives_the_closed_form_between_instants(trajectory: Trajectory) -> None:
    instants = np.array([0.0, 0.033, 7.777, 29.99, 30.0])
    position, quaternion = trajectory.at(instants)
    expected, _, expected_quaternion = circle(instants)
    # cubic Hermite: error ≤ h⁴/384 · max|p⁗| = 0.1⁴/384 · R ω⁴ ≈ 3e-11 m
    np.testing.assert_allclose(position[:, 0], expected, atol=5e-11)
    # spherical interpolation turns about one axis, which a turn with a pitch does not quite do
    np.testing.assert_allclose(
        np.abs(np.einsum("ni,ni->n", quaternion[:, 0], expected_quaternion)), 1.0, atol=1e-12
    )


def test_sites_are_carried_by_the_hull(trajectory: Trajectory) -> None:
    front = trajectory.site_position[0, trajectory.site("leader/tx_front")]
    np.testing.assert_allclose(front, [np.cos(0.1), RADIUS, -5 + np.sin(0.1)], atol=1e-12)
    np.testing.assert_allclose(
        trajectory.site_at("leader/tx_front", [12.3])[0],
        trajectory.site_position[123, 0],
        atol=1e-9,
    )


def test_positions_of_sites_are_those_by_rotations_of_scipy(trajectory: Trajectory) -> None:
    rng = np.random.default_rng(5)
    rotations = Rotation.random(602, rng=rng)
    turned = synthetic.moved(
        trajectory,
        quaternion=rotations.as_quat()[:, [3, 0, 1, 2]].reshape(301, 2, 4),
        site_names=("a", "b", "c", "d"),
        site_vehicle=np.array([1, 0, 1, 0]),
        site_offset=np.vstack([rng.normal(size=(2, 3)), [[0, 0.3, -0.2]], np.zeros((1, 3))]),
    )
    for site, (vehicle, offset) in enumerate(
        zip(turned.site_vehicle, turned.site_offset, strict=True)
    ):
        rotated_offset = rotations.apply(offset.copy()).reshape(301, 2, 3)[:, vehicle]
        np.testing.assert_allclose(
            turned.site_position[:, site], turned.position[:, vehicle] + rotated_offset, atol=1e-13
        )
        np.testing.assert_array_equal(turned.site_path("abcd"[site]), turned.site_position[:, site])


def test_a_leader_is_tilted_in_pitch_alone_by_default(trajectory: Trajectory) -> None:
    tilted_trajectory = tilted(trajectory, 0.2)
    np.testing.assert_allclose(tilted_trajectory.pitch[:, 0], 0.2, atol=1e-12)
    np.testing.assert_allclose(tilted_trajectory.roll[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(tilted_trajectory.heading, trajectory.heading, atol=1e-12)
    np.testing.assert_array_equal(tilted_trajectory.quaternion[:, 1:], trajectory.quaternion[:, 1:])


def test_speed_log_measures_along_the_hull_through_the_water(trajectory: Trajectory) -> None:
    expected = RADIUS * RATE * np.cos(0.1) + 0.1 * np.sin(0.1)
    np.testing.assert_allclose(trajectory.forward_speed, expected, atol=1e-12)


def test_a_saved_trajectory_is_loaded_to_the_bit(trajectory: Trajectory, tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", **trajectory.arrays)
    with np.load(tmp_path / "t.npz") as arrays:
        loaded = Trajectory.of_arrays(arrays)
    assert loaded.names == trajectory.names
    assert loaded.site_names == trajectory.site_names
    for name in (
        "time",
        "position",
        "quaternion",
        "velocity",
        "effector_states",
        "site_offset",
        "site_vehicle",
    ):
        assert np.array_equal(getattr(loaded, name), getattr(trajectory, name))


def test_hulls_with_different_numbers_of_effectors_are_saved_and_loaded(
    trajectory: Trajectory, tmp_path: Path
) -> None:
    names = (("ahead", "aside", "up"), *[("propeller",)] * (len(trajectory.names) - 1))
    assert len(names) > 1
    with_names = replace(trajectory, effector_names=names)
    np.savez(tmp_path / "t.npz", **with_names.arrays)
    with np.load(tmp_path / "t.npz") as arrays:
        assert Trajectory.of_arrays(arrays).effector_names == names


def test_times_outside_the_trajectory_and_unknown_sites_are_refused(trajectory: Trajectory) -> None:
    with pytest.raises(ValueError, match="outside 0 … 30 s"):
        trajectory.at(31.0)
    with pytest.raises(ValueError, match="available: leader/tx_front"):
        trajectory.site("leader/keel")


def test_arrays_cannot_be_changed(trajectory: Trajectory) -> None:
    with pytest.raises(ValueError, match="read-only"):
        trajectory.position[0, 0, 0] = 1.0
