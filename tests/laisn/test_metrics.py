"""Metrics on cases with hand calculations."""

import numpy as np
import pytest

from laisn import metrics
from laisn.estimates import Estimates, FixKind


def estimates(**changes: object) -> Estimates:
    arrays: dict[str, object] = {
        "state": np.zeros((3, 4)),
        "covariance": np.tile(np.eye(4), (3, 1, 1)),
        "fix_step": np.array([1, 2, 3]),
        "fix_position": np.zeros((3, 2)),
        "fix_sigma": np.zeros(3),
        "fix_kind": np.array([FixKind.TWO_POINTS, FixKind.GATED, FixKind.TWO_POINTS]),
        "innovation": np.array([[1.0, 2.0], [np.nan, np.nan], [0.0, 3.0]]),
        "innovation_covariance": np.array([np.eye(2), np.full((2, 2), np.nan), 9 * np.eye(2)]),
    }
    return Estimates(**{**arrays, **changes})  # type: ignore[arg-type]


def test_errors_of_a_right_triangle() -> None:
    truth, leader = np.array([[10.0, 0.0]]), np.array([[0.0, 0.0]])
    assert metrics.position_errors(np.array([[13.0, 4.0]]), truth) == pytest.approx(5.0)
    assert metrics.bearing_errors(np.array([[5.0, 5.0]]), truth, leader) == pytest.approx(np.pi / 4)
    assert metrics.bearing_errors(np.array([[-5.0, 0.0]]), truth, leader) == pytest.approx(np.pi)
    assert metrics.bearing_errors(np.array([[5.0, -5e-9]]), truth, leader) == pytest.approx(1e-9)


def test_summary_is_over_all_steps() -> None:
    summary = metrics.summarise(np.array([1.0, 3.0]), np.deg2rad([10.0, 20.0]))
    assert (summary.e_p_max_m, summary.e_p_mean_m, summary.e_p_std_m) == (3.0, 2.0, 1.0)
    assert summary.e_b_max_deg == pytest.approx(20.0)
    assert summary.e_b_mean_deg == pytest.approx(15.0)
    assert summary.e_b_std_deg == pytest.approx(5.0)
    with pytest.raises(ValueError, match="finite"):
        metrics.summarise(np.array([np.nan]), np.array([0.0]))


def test_consistency_of_known_covariances() -> None:
    """eᵀ P⁻¹ e with P = I, and with S = 9 I; NaN for singular covariances and rejected fixes."""
    assert metrics.nees(estimates(), np.array([[3.0, 4.0], [0, 0], [1, 0]])) == pytest.approx(
        [25.0, 0.0, 1.0]
    )
    singular = estimates(covariance=np.zeros((3, 4, 4)))
    assert np.all(np.isnan(metrics.nees(singular, np.zeros((3, 2)))))
    np.testing.assert_allclose(metrics.nis(estimates()), [5.0, np.nan, 1.0])


@pytest.mark.parametrize(("shorter", "expected"), [(2e-4, 1.0), (1e-5, np.nan), (0.0, np.nan)])
def test_an_ellipse_flattened_by_rounding_is_not_used(shorter: float, expected: float) -> None:
    """An error along the long axis, of 1 m; a determinant that rounding made negative makes no
    negative square.
    """
    rotation = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = np.zeros((3, 4, 4))
    covariance[:, :2, :2] = rotation @ np.diag([1.0, shorter**2]) @ rotation.T
    covariance[1:, 0, 1] *= 1.0 + 1e-10 if shorter == 0.0 else 1.0
    nees = metrics.nees(
        estimates(state=np.zeros((3, 4)), covariance=covariance), np.tile([0.6, 0.8], (3, 1))
    )
    np.testing.assert_allclose(nees, np.full(3, expected), rtol=1e-6)


def test_nees_of_gaussian_errors_averages_two() -> None:
    rng = np.random.default_rng(0)
    root = np.array([[2.0, 0.0], [1.0, 0.5]])
    n = 20_000
    covariance = np.zeros((n, 4, 4))
    covariance[:, :2, :2] = root @ root.T
    state = np.concatenate([rng.normal(size=(n, 2)) @ root.T, np.zeros((n, 2))], axis=1)
    nees = metrics.nees(estimates(state=state, covariance=covariance), np.zeros((n, 2)))
    # variance of χ²₂ is 4: five standard errors
    assert nees.mean() == pytest.approx(2.0, abs=5 * 2 / np.sqrt(n))


def test_a_mirror_lock_is_far_from_the_truth_and_near_its_mirror_image() -> None:
    """Truth 4 m to port of the axis, mirror image 8 m away at (−20, −4); the last two truths are
    on the axis.
    """
    leader, east = np.zeros((6, 2)), np.full(6, np.pi / 2)
    truth = np.array([[-20.0, 4.0]] * 4 + [[-20.0, 0.1]] * 2)
    estimate = np.array(
        [[-20.0, -4.0], [-20.0, -0.5], [-20.0, 12.0], [-24.1, -4.0], [-20.0, -6.0], [-20.0, 6.0]]
    )
    mirror_locked = metrics.mirror_locked_steps(estimate, truth, leader, east)
    # the fourth is 4.1 m from the mirror image and 8.99 m from the truth: just beyond twice as far
    assert mirror_locked.tolist() == [True, False, False, True, False, False]
    # the same, turned by 50° to port about the leader and moved with it
    c, s = np.cos(np.deg2rad(50.0)), np.sin(np.deg2rad(50.0))
    rotation, shift = np.array([[c, -s], [s, c]]), np.array([300.0, -70.0])
    transformed = (
        estimate @ rotation.T + shift,
        truth @ rotation.T + shift,
        leader + shift,
        east - np.deg2rad(50.0),
    )
    assert metrics.mirror_locked_steps(*transformed).tolist() == mirror_locked.tolist()


@pytest.mark.parametrize(
    ("steps", "longest"),
    [("1011100", 3), ("1101000", 2), ("1001011", 2), ("1111111", 7), ("0000000", 0)],
)
def test_the_longest_mirror_lock_may_begin_or_end_with_the_mission(
    steps: str, longest: int
) -> None:
    assert metrics.longest_mirror_lock(np.array([step == "1" for step in steps])) == longest


def test_fix_counts_name_every_kind() -> None:
    counts = metrics.fix_counts(estimates())
    assert counts["two_points"] == 2
    assert counts["gated"] == 1
    assert sum(counts.values()) == 3
    assert len(counts) == len(FixKind)


def test_errors_and_mirror_locks_agree_with_complex_numbers() -> None:
    """Angles as arguments of quotients, mirror images as conjugates about the leader's axis."""
    rng = np.random.default_rng(9)
    n = 4000
    truth, leader = rng.normal(0, 8, (n, 2)), rng.normal(0, 3, (n, 2))
    heading = rng.uniform(-7, 7, n)
    z_true, z_leader, axis = truth @ [1, 1j], leader @ [1, 1j], 1j * np.exp(-1j * heading)
    mirror = z_leader + axis * np.conj((z_true - z_leader) / axis)
    # near the mirror image, near the truth, and anywhere
    z_estimated = np.select([np.arange(n) % 3 == 0, np.arange(n) % 3 == 1], [mirror, z_true], 0.0)
    z_estimated = z_estimated + rng.normal(0, 4, n) + 1j * rng.normal(0, 4, n)
    estimate = np.column_stack([z_estimated.real, z_estimated.imag])
    np.testing.assert_allclose(
        metrics.position_errors(estimate, truth), np.abs(z_estimated - z_true), rtol=1e-12
    )
    angle = np.abs(np.angle((z_estimated - z_leader) / (z_true - z_leader)))
    np.testing.assert_allclose(
        metrics.bearing_errors(estimate, truth, leader), angle, rtol=0, atol=1e-12
    )
    mirror_locked = (np.abs(z_estimated - z_true) > 5.0) & (
        2.0 * np.abs(z_estimated - mirror) < np.abs(z_estimated - z_true)
    )
    assert 0.1 < mirror_locked.mean() < 0.9
    np.testing.assert_array_equal(
        metrics.mirror_locked_steps(estimate, truth, leader, heading), mirror_locked
    )


def test_consistency_of_any_covariance_is_that_of_a_linear_solver() -> None:
    rng = np.random.default_rng(10)
    root = rng.normal(size=(3, 2, 2))
    covariance, error = root @ root.transpose(0, 2, 1), rng.normal(size=(3, 2))
    state_covariance = np.tile(np.eye(4), (3, 1, 1))
    state_covariance[:, :2, :2] = covariance
    kinds = np.array([FixKind.TWO_POINTS, FixKind.ASTERN, FixKind.FUSED])
    record = estimates(
        covariance=state_covariance,
        innovation=error,
        innovation_covariance=covariance,
        fix_kind=kinds,
    )
    expected = [e @ np.linalg.solve(p, e) for e, p in zip(error, covariance, strict=True)]
    np.testing.assert_allclose(metrics.nees(record, -error), expected, rtol=1e-10)
    np.testing.assert_allclose(metrics.nis(record), expected, rtol=1e-10)
    for kind in (FixKind.GATED, FixKind.SINGULAR, FixKind.LOST, FixKind.ONE_RANGE):
        assert np.isnan(metrics.nis(estimates(fix_kind=np.full(3, kind), innovation=error))).all()
