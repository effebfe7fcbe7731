"""Dead reckoning and mixtures of the tightly coupled navigator: derivatives, composition, halves
and blends.
"""

import numpy as np
import numpy.typing as npt
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

from laisn.arrays import Floats
from laisn.mixture import blend, half_moments
from laisn.settings import Assume, TightSettings
from laisn.tight.estimator import mix_modes, prune_and_merge, split
from laisn.tight.model import GaussianMixture, Model, model_of, new_belief, refresh_output
from laisn.tight.motion import (
    moments,
    position,
    predict_component,
    preintegrate,
    reset_preintegration,
    update_current_from_leader_track,
)
from laisn.tight.ranging import RangeMessage, new_range_message

SETTINGS = TightSettings(
    assume=Assume(exact_leader=False, current=True, offsets=True, clock=True), slip=0.02
)
N = 12
STATE = np.array([10.0, -5.0, 0.2, 0.15, 0.1, 0.05, 0.3, -0.2, 0.01, -0.01, 0.4, 0.02])


def some_covariance(seed: int, scale: float = 0.1) -> Floats:
    root = np.random.default_rng(seed).normal(size=(N, N)) * scale
    return np.asarray(root @ root.T)


def biased_belief(
    settings: TightSettings = SETTINGS, seed: int = 3
) -> tuple[GaussianMixture, Model]:
    model = model_of(settings)
    belief = new_belief(settings, model, (0.0, 0.0))
    for k in range(model.modes):
        belief.state[k, :N] = STATE
        belief.covariance[k, :N, :N] = some_covariance(seed + k)
    refresh_output(belief, model)
    return belief, model


def readings(count: int, seed: int = 1) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    return 1.0 + 0.3 * rng.normal(size=count), 0.4 + np.cumsum(rng.normal(size=count) * 0.05)


def mixture_moments(belief: GaussianMixture, components: range) -> tuple[Floats, Floats]:
    weight = belief.weight[components]
    mean = weight @ belief.state[components] / weight.sum()
    offsets = belief.state[components] - mean
    spread = belief.covariance[components] + offsets[:, :, None] * offsets[:, None, :]
    return mean, np.einsum("k,kij->ij", weight, spread) / weight.sum()


def test_the_displacement_is_the_trapezoid_of_unbiased_readings() -> None:
    speed, heading = readings(20)
    belief, model = biased_belief()
    for v, theta in zip(speed, heading, strict=True):
        preintegrate(belief, model, v, theta, 0.1)
    velocities = (speed - STATE[2]) * np.exp(1j * (np.pi / 2 - (heading - STATE[3])))
    # the first reading stands for the beginning of its step too
    with_first = np.concatenate([[velocities[0]], velocities])
    displacement = 0.1 * np.sum(0.5 * (with_first[1:] + with_first[:-1])) + 2.0 * (
        STATE[6] + 1j * STATE[7]
    )
    x, y = position(belief)
    assert complex(x, y) == pytest.approx(complex(STATE[0], STATE[1]) + displacement, abs=1e-12)


def position_of(state: npt.NDArray[np.complex128], motion: Floats) -> npt.NDArray[np.complex128]:
    """p + Rot(b_θ)(A − b_v B) + c T, analytic in the state."""
    c, s = np.cos(state[3]), np.sin(state[3])
    rotation = np.array([[c, -s], [s, c]])
    return np.asarray(
        state[:2] + rotation @ (motion[0:2] - state[2] * motion[2:4]) + motion[7] * state[6:8]
    )


def test_a_motion_equals_filterpys_with_derivatives_by_complex_steps() -> None:
    belief, model = biased_belief()
    model.log_walk = model.compass_walk = model.current_walk = model.leader_walk = (
        model.clock_walk
    ) = 0.0
    for v, theta in zip(*readings(30), strict=True):
        preintegrate(belief, model, v, theta, 0.1)
    motion = np.array(belief.motion.tolist())
    F = np.eye(N)
    F[:2] = np.stack(
        [position_of(STATE + 1e-30j * unit, motion).imag / 1e-30 for unit in np.eye(N)], axis=1
    )
    # the clock's offset grows by its rate
    F[10, 11] = 3.0
    c, s = np.cos(STATE[3]), np.sin(STATE[3])
    rotation = np.array([[c, -s], [s, c]])
    Q = np.zeros((N, N))
    Q[:2, :2] = rotation @ np.array([[motion[4], motion[5]], [motion[5], motion[6]]]) @ rotation.T
    Q[:2, :2] += 0.02**2 * 3.0 * np.eye(2)
    kalman = KalmanFilter(dim_x=N, dim_z=1)
    kalman.x, kalman.P = STATE.copy(), belief.covariance[0, :N, :N].copy()
    kalman.predict(F=F, Q=Q)
    kalman.x[:2] = position_of(STATE.astype(complex), motion).real
    predict_component(belief, model, 0, STATE[2], STATE[3])
    np.testing.assert_allclose(belief.state[0, :N], kalman.x, atol=1e-12)
    np.testing.assert_allclose(belief.covariance[0, :N, :N], kalman.P, atol=1e-12)


def test_the_covariance_between_messages_is_that_of_a_motion() -> None:
    belief, model = biased_belief()
    for v, theta in zip(*readings(30), strict=True):
        preintegrate(belief, model, v, theta, 0.1)
    moments(belief, model)
    mean, covariance = belief.mixture_mean.copy(), belief.mixture_covariance.copy()
    predict_component(belief, model, 0, STATE[2], STATE[3])
    np.testing.assert_allclose(mean[:2], belief.state[0, :2], atol=1e-12)
    np.testing.assert_allclose(covariance[:2, :2], belief.covariance[0, :2, :2], atol=1e-12)


def test_the_velocity_has_the_last_readings_errors_and_correlates_with_the_position() -> None:
    """v = (s − b_v) Rot(b_θ) u(θ) + c: its mean, covariance, and covariance with the position, by
    complex steps.
    """
    belief, model = biased_belief()
    model.log_walk = model.compass_walk = model.current_walk = model.leader_walk = (
        model.clock_walk
    ) = 0.0
    speed, heading = readings(30)
    for v, theta in zip(speed, heading, strict=True):
        preintegrate(belief, model, v, theta, 0.1)
    motion = np.array(belief.motion.tolist())

    def velocity(state: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
        true = heading[-1] - state[3]
        return np.asarray(
            (speed[-1] - state[2]) * np.array([np.sin(true), np.cos(true)]) + state[6:8]
        )

    derivatives = [
        np.concatenate(
            [position_of(STATE + 1e-30j * unit, motion), velocity(STATE + 1e-30j * unit)]
        ).imag
        / 1e-30
        for unit in np.eye(N)
    ]
    jacobian = np.stack(derivatives, axis=1)
    moments(belief, model)
    np.testing.assert_allclose(
        belief.mixture_mean[2:], velocity(STATE.astype(complex)).real, atol=1e-12
    )
    true = heading[-1] - STATE[3]
    along, across = np.array([np.sin(true), np.cos(true)]), np.array([np.cos(true), -np.sin(true)])
    noise = SETTINGS.speed_sigma**2 * np.outer(along, along)
    noise += (SETTINGS.heading_sigma * speed[-1]) ** 2 * np.outer(across, across)
    expected = jacobian @ belief.covariance[0, :N, :N] @ jacobian.T
    np.testing.assert_allclose(
        belief.mixture_covariance[2:, 2:], expected[2:, 2:] + noise, atol=1e-12
    )
    np.testing.assert_allclose(belief.mixture_covariance[:2, 2:], expected[:2, 2:], atol=1e-12)
    np.testing.assert_allclose(belief.mixture_covariance[2:, :2], expected[2:, :2], atol=1e-12)


def test_biases_that_wander_add_up_over_intervals_as_over_their_sum() -> None:
    """On a straight way at constant speed the wandering biases are a linear system: its steps
    compose exactly.
    """
    one_interval, model = biased_belief()
    sixty_intervals, _ = biased_belief()
    preintegrate(one_interval, model, 1.0, 0.3, 0.1)
    preintegrate(sixty_intervals, model, 1.0, 0.3, 0.1)
    reset_preintegration(one_interval)
    reset_preintegration(sixty_intervals)
    for _ in range(60):
        preintegrate(one_interval, model, 1.0, 0.3, 0.1)
        preintegrate(sixty_intervals, model, 1.0, 0.3, 0.1)
        predict_component(
            sixty_intervals, model, 0, sixty_intervals.state[0, 2], sixty_intervals.state[0, 3]
        )
        reset_preintegration(sixty_intervals)
    predict_component(one_interval, model, 0, one_interval.state[0, 2], one_interval.state[0, 3])
    np.testing.assert_allclose(sixty_intervals.state[0], one_interval.state[0], atol=1e-10)
    np.testing.assert_allclose(
        sixty_intervals.covariance[0], one_interval.covariance[0], rtol=1e-10, atol=1e-13
    )


@given(z=st.floats(-6.0, 6.0))
def test_moments_of_a_half_equal_quadrature(z: float) -> None:
    mass, shift, narrowing = half_moments(z)
    if z < -5.0:
        exact = norm.sf(-z)
        assert mass == pytest.approx(exact, rel=1e-9)
        return
    upper = max(z, 0.0) + 12.0
    density = [
        quad(lambda u, p=p: u**p * norm.pdf(u - z), 0.0, upper, epsabs=1e-15, limit=200)[0]
        for p in range(3)
    ]
    mean = density[1] / density[0]
    assert mass == pytest.approx(density[0], rel=1e-7)
    assert z + shift == pytest.approx(mean, abs=1e-6)
    assert 1.0 - narrowing == pytest.approx(density[2] / density[0] - mean**2, abs=1e-5)


def message(ranges: Floats) -> RangeMessage:
    range_message = new_range_message()
    range_message.east, range_message.north, range_message.heading, range_message.speed = (
        40.0,
        1.0,
        np.pi / 2,
        1.0,
    )
    range_message.arms, range_message.ranges = (
        [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.1, 0.0]],
        ranges,
    )
    return range_message


@pytest.mark.parametrize("drift", [False, True])
def test_both_halves_together_are_the_whole(drift: bool) -> None:
    """A hypothesis that is split at the axis keeps mean and covariance, and its halves lie on
    either side.
    """
    settings = TightSettings(
        assume=Assume(exact_leader=False, current=True, offsets=True, clock=True, drift=drift)
    )
    belief, model = biased_belief(settings)
    belief.state[: model.modes, :2] = [0.0, 0.5]
    belief.covariance[: model.modes, 0, 0] += 4.0
    belief.covariance[: model.modes, 1, 1] += 4.0
    belief.state[: model.modes, 5] = 0.0
    before = [mixture_moments(belief, range(k, k + 1)) for k in range(model.modes)]
    split(belief, model, message(np.full(3, 40.0)))
    assert belief.n_hypotheses == 2
    for k in range(model.modes):
        after = mixture_moments(belief, range(k, 2 * model.modes, model.modes))
        np.testing.assert_allclose(after[0], before[k][0], atol=1e-10)
        np.testing.assert_allclose(after[1], before[k][1], atol=1e-10)
    # the leader heads east, 40 m ahead and 1 m to the north; an axis turned anticlockwise lies
    # lower back here
    left, right = (belief.state[k, 1] - 1.0 + 40.0 * belief.state[k, 5] for k in (0, model.modes))
    assert left > 0.0 > right
    assert belief.weight.sum() == pytest.approx(1.0)


def test_a_follower_abeam_is_not_split() -> None:
    belief, model = biased_belief()
    belief.state[0, :2] = 40.0, -30.0
    split(belief, model, message(np.full(3, 30.0)))
    assert belief.n_hypotheses == 1


def test_hypotheses_in_the_same_place_merge_into_their_moments_and_light_ones_go() -> None:
    belief, model = biased_belief()
    belief.n_hypotheses = 3
    for k, weight in enumerate((0.7, 0.3 - 1e-6, 1e-6)):
        belief.weight[k] = weight
        belief.covariance[k, :N, :N] = some_covariance(k + 20)
        belief.state[k, :N] = STATE
    belief.state[1, 0] += 0.01
    belief.state[2, 0] += 50.0
    expected = mixture_moments(belief, range(2))
    prune_and_merge(belief, model)
    assert belief.n_hypotheses == 1
    np.testing.assert_allclose(belief.state[0], expected[0], atol=1e-12)
    np.testing.assert_allclose(belief.covariance[0], expected[1], atol=1e-12)
    assert belief.weight[0] == pytest.approx(1.0)


def test_mixing_modes_keeps_the_moments_of_the_whole_and_moves_weight() -> None:
    assume = Assume(exact_leader=False, current=True, offsets=True, clock=True, drift=True)
    belief, model = biased_belief(TightSettings(assume=assume))
    belief.weight[:2], belief.motion.elapsed = (0.9, 0.1), 5.0
    belief.state[1, 2:4] += 0.1
    before = mixture_moments(belief, range(2))
    mix_modes(belief, model)
    after = mixture_moments(belief, range(2))
    np.testing.assert_allclose(after[0], before[0], atol=1e-12)
    np.testing.assert_allclose(after[1], before[1], atol=1e-12)
    # each mode changes to the other one 0.004 times a second: dw/dt = −0.004 (w − (1 − w)), from
    # 0.9 towards ½
    expected = 0.5 + 0.4 * np.exp(-0.008 * 5.0)
    np.testing.assert_allclose(belief.weight[:2], [expected, 1.0 - expected], rtol=1e-12)


def test_a_blend_has_the_moments_of_two_gaussians() -> None:
    mean = np.array([[0.0, 1.0], [2.0, -1.0]])
    covariance = np.array([[[1.0, 0.2], [0.2, 2.0]], [[3.0, -0.5], [-0.5, 1.0]]])
    blend(mean, covariance, 0, 1, 0.25, 2)
    np.testing.assert_allclose(mean[0], [0.5, 0.5])
    # within: ¾ P + ¼ P'; between: ¾ · ¼ · apart apartᵀ
    np.testing.assert_allclose(
        covariance[0], [[1.5 + 0.75, 0.025 - 0.75], [0.025 - 0.75, 1.75 + 0.75]]
    )


@pytest.mark.parametrize("exact", [True, False])
def test_the_leader_track_updates_the_current_as_filterpy_does(exact: bool) -> None:
    settings = TightSettings(assume=Assume(exact_leader=exact, current=True))
    model = model_of(settings)
    belief = new_belief(settings, model, (0.0, 0.0))
    n = model.n_states
    root = np.random.default_rng(2).normal(size=(n, n)) * 0.1
    belief.covariance[0, :n, :n] = root @ root.T
    if not exact:
        belief.state[0, model.leader_bias] = 0.1
    kalman = KalmanFilter(dim_x=n, dim_z=2)
    kalman.x, kalman.P = belief.state[0, :n].copy(), belief.covariance[0, :n, :n].copy()
    range_message = new_range_message()
    heading, speed, current = 0.7, 1.3, np.array([0.2, -0.1])
    range_message.heading, range_message.speed = heading, speed
    logged = speed * np.array([np.sin(heading), np.cos(heading)])
    for t in range(2):
        leader_position = (logged + current) * 1.25 * t
        range_message.time, range_message.east, range_message.north = (
            1.25 * t,
            leader_position[0],
            leader_position[1],
        )
        update_current_from_leader_track(belief, model, range_message)
    bias = 0.0 if exact else kalman.x[model.leader_bias]
    angle = heading - bias
    turned = speed * np.array([np.sin(angle), np.cos(angle)])
    H = np.zeros((2, n))
    H[:, model.current : model.current + 2] = np.eye(2)
    if not exact:
        H[:, model.leader_bias] = speed * np.array([-np.cos(angle), np.sin(angle)])
    expected = kalman.x[model.current : model.current + 2] + turned - logged
    kalman.update(H @ kalman.x + current - expected, R=np.eye(2) * 0.05**2 * 10.0 / 1.25, H=H)
    np.testing.assert_allclose(belief.state[0, :n], kalman.x, atol=1e-9)
    np.testing.assert_allclose(belief.covariance[0, :n, :n], kalman.P, atol=1e-9)


@pytest.mark.parametrize(
    ("turn", "updates"), [(0.19, True), (0.21, False), (-0.21, False), (2 * np.pi, True)]
)
def test_a_turning_leader_does_not_update_the_current(turn: float, updates: bool) -> None:
    """The way between two messages is known on a leg that is nearly straight, to 0.2 rad."""
    settings = TightSettings(assume=Assume(current=True))
    model = model_of(settings)
    belief = new_belief(settings, model, (0.0, 0.0))
    before, range_message = belief.state.copy(), new_range_message()
    for t in range(2):
        range_message.time, range_message.east, range_message.north = 1.25 * t, 2.0 * t, 0.0
        range_message.heading, range_message.speed = 0.7 + turn * t, 1.3
        update_current_from_leader_track(belief, model, range_message)
    assert np.array_equal(belief.state, before) != updates
