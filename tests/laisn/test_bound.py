"""The Cramér–Rao bound against closed forms and an independent recursion."""

from dataclasses import replace

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.bound import BoundGeometry, TrueNoise, position_bound, position_bounds

KNOWN = TrueNoise(
    speed_bias=0.0, heading_bias=0.0, range_scale_bias=0.0, range_scale_sigma=0.0, heading_sigma=0.0
)
"""No biases, and a compass without errors."""


def at_rest(
    steps: int, from_leader: tuple[float, float], arms: Floats, steps_per_message: int = 1
) -> BoundGeometry:
    message_step = np.arange(steps_per_message, steps + 1, steps_per_message)
    return BoundGeometry(
        dt=0.1,
        speed=np.zeros(steps),
        heading=np.zeros(steps),
        message_step=message_step,
        from_leader=np.tile(from_leader, (message_step.size, 1)),
        arms=np.tile(arms, (message_step.size, 1, 1)),
    )


def test_without_ranges_the_bound_is_that_of_dead_reckoning() -> None:
    """North for n steps: errors of the log add along the course, those of the compass across it."""
    n, sigma, bias = 50, np.deg2rad(2.0), np.deg2rad(5.0)
    noise = TrueNoise(
        speed_sigma=0.2, speed_bias=0.1, heading_sigma=sigma, heading_bias=bias, start=0.5
    )
    geometry = replace(at_rest(n, (0.0, -20.0), np.full((3, 3), np.nan)), speed=np.full(n, 1.5))
    bound = position_bound(geometry, noise)[-1]
    along = 0.25 + n * (0.2 * 0.1) ** 2 + (0.1 * 0.1 * n) ** 2
    across = 0.25 + n * (1.5 * sigma * 0.1) ** 2 + (1.5 * 0.1 * n * bias) ** 2
    np.testing.assert_allclose(bound, np.diag([across, along]), rtol=1e-12, atol=1e-12)


def test_biases_turn_and_shorten_the_whole_path_however_it_bends() -> None:
    """Three legs: a bias of the compass moves the end at right angles to the whole displacement, a
    bias of the log along the sum of the headings' unit vectors.
    """
    heading = np.repeat(np.deg2rad([30.0, 110.0, -160.0]), [40, 70, 25])
    speed = np.repeat([1.5, 1.1, 0.9], [40, 70, 25])
    geometry = replace(
        at_rest(heading.size, (0.0, 0.0), np.full((3, 3), np.nan)), speed=speed, heading=heading
    )
    log, compass, still = 0.1, np.deg2rad(5.0), replace(KNOWN, speed_sigma=0.0)
    ahead = 0.1 * np.stack([np.sin(heading), np.cos(heading)], axis=1)
    east, north = (speed[:, None] * ahead).sum(axis=0)
    aside, along = np.array([-north, east]), ahead.sum(axis=0)
    for noise, expected in (
        (replace(still, heading_bias=compass), compass**2 * np.outer(aside, aside)),
        (replace(still, speed_bias=log), log**2 * np.outer(along, along)),
    ):
        start = np.eye(2) * still.start**2
        np.testing.assert_allclose(
            position_bound(geometry, noise)[-1] - start, expected, rtol=1e-9, atol=1e-12
        )


def test_repeated_ranges_at_rest_add_their_information() -> None:
    """Two transmitters at right angles as seen from the follower: each axis has n/σ² beside
    1/σ₀².
    """
    arms = np.array([[50.0, 0.0, 0.0], [0.0, 50.0, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.0, range_sigma=0.3, start=2.0)
    bound = position_bound(at_rest(8, (0.0, 0.0), arms), noise, averaged=False)
    for k in range(8):
        np.testing.assert_allclose(
            bound[k], np.eye(2) / (0.25 + (k + 1) / 0.09), rtol=1e-12, atol=1e-15
        )


def test_a_scalar_random_walk_reaches_the_riccati_equations_fixed_point() -> None:
    """Motion noise q a step and range noise r along one axis: p⁺ = p r / (p + r) with p = p⁺ +
    q.
    """
    arms = np.array([[0.0, 1e7, 0.0]])
    noise = replace(KNOWN, speed_sigma=1.0, range_sigma=0.5)
    north = position_bound(at_rest(300, (0.0, 0.0), arms), noise, averaged=False)[-1, 1, 1]
    q, r = (1.0 * 0.1) ** 2, 0.25
    assert north == pytest.approx(0.5 * (np.sqrt(q * q + 4 * q * r) - q), rel=1e-6)


def test_on_the_axis_of_two_transmitters_only_the_mean_range_has_information() -> None:
    arms = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.0, start=3.0)
    geometry = at_rest(20, (0.0, -40.0), arms)
    at_truth = position_bound(geometry, noise, averaged=False)[-1]
    averaged = position_bound(geometry, noise)[-1]
    assert at_truth[0, 0] == pytest.approx(9.0)
    assert averaged[0, 0] < 1.0


def test_the_bound_falls_with_more_ranges_and_grows_with_more_unknowns() -> None:
    arms = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [-0.1, 0.0, 0.0]])
    geometry = replace(
        at_rest(200, (-15.0, -20.0), arms, steps_per_message=10),
        speed=np.ones(200),
        heading=np.linspace(0, 3, 200),
    )

    def last(noise: TrueNoise, g: BoundGeometry = geometry) -> float:
        return float(np.trace(position_bound(g, noise, averaged=False)[-1]))

    base = last(TrueNoise())
    two_transmitters = replace(geometry, arms=geometry.arms[:, :2])
    assert last(TrueNoise(), two_transmitters) > base
    for unknown in ({"leader_heading_bias": 0.1}, {"current": 0.4}, {"range_offset": 0.02}):
        assert last(TrueNoise(**unknown)) > base
    assert last(TrueNoise(leader_heading_bias=0.1, leader_heading_sigma=0.03)) > last(
        TrueNoise(leader_heading_bias=0.1)
    )
    arms_with_losses = geometry.arms.copy()
    arms_with_losses[::2] = np.nan
    assert last(TrueNoise(), replace(geometry, arms=arms_with_losses)) > base


def test_a_negative_deviation_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"speed_sigma is -1\.0, expected a finite number, zero or more"
    ):
        TrueNoise(speed_sigma=-1.0)


def least_squares_bound(geometry: BoundGeometry, noise: TrueNoise) -> Floats:
    """The same bound without recursion: least squares of a whole mission in its unknowns,
    derivatives by differences.

    Unknown are the start, the constants, and every random error of log, compass, leader's heading
    and ψ.
    """
    n, m = geometry.speed.size, geometry.message_step.size
    transmitters = geometry.arms.shape[1]
    sizes = {
        "start": 2,
        "speed_bias": 1,
        "heading_bias": 1,
        "range_scale_bias": 1,
        "leader_heading_bias": 1,
        "current": 2,
        "range_offset": transmitters - 1,
        "speed_sigma": n,
        "heading_sigma": n,
        "range_scale_sigma": m,
        "leader_heading_sigma": m,
        "clock_offset": 1,
        "clock_drift": 1,
    }
    ends = np.cumsum(list(sizes.values()))
    slices = {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }
    sigma = np.concatenate([np.full(size, getattr(noise, name)) for name, size in sizes.items()])

    def mission(unknown: Floats) -> tuple[Floats, list[Floats]]:
        """Deviation of the follower from its true position after each step, and the ranges of each
        message, for given errors.
        """
        errors = {name: unknown[part] for name, part in slices.items()}
        speed = geometry.speed - errors["speed_bias"] + errors["speed_sigma"]
        heading = geometry.heading - errors["heading_bias"] + errors["heading_sigma"]
        velocity = (
            np.column_stack([speed * np.sin(heading), speed * np.cos(heading)]) + errors["current"]
        )
        true_velocity = geometry.speed[:, None] * np.column_stack(
            [np.sin(geometry.heading), np.cos(geometry.heading)]
        )
        deviation = errors["start"] + geometry.dt * np.cumsum(velocity - true_velocity, axis=0)
        ranges = []
        for i, k in enumerate(geometry.message_step):
            heading_error = float(
                errors["leader_heading_bias"][0] + errors["leader_heading_sigma"][i]
            )
            rotate = np.array(
                [
                    [np.cos(heading_error), -np.sin(heading_error)],
                    [np.sin(heading_error), np.cos(heading_error)],
                ]
            )
            arms = geometry.arms[i]
            offsets = np.column_stack(
                [geometry.from_leader[i] + deviation[k - 1] - arms[:, :2] @ rotate.T, arms[:, 2]]
            )
            rho = np.linalg.norm(offsets, axis=1)
            scale_error = (
                (errors["range_scale_bias"] + errors["range_scale_sigma"][i])
                * rho
                / np.fmax.reduce(rho)
            )
            measured = rho + scale_error + np.concatenate([[0.0], errors["range_offset"]])
            measured += errors["clock_offset"] + errors["clock_drift"] * geometry.dt * k
            ranges.append(measured[np.isfinite(measured)])
        return deviation, ranges

    step = 1e-6
    plus, minus = ([mission(s * step * e) for e in np.eye(sigma.size)] for s in (1.0, -1.0))
    position_derivatives = np.stack(
        [(a - b) / (2 * step) for (a, _), (b, _) in zip(plus, minus, strict=True)], axis=-1
    )
    bound = np.empty((n, 2, 2))
    for k in range(n):
        messages = [i for i, at in enumerate(geometry.message_step) if at <= k + 1]
        rows = [
            np.stack(
                [(a[i] - b[i]) / (2 * step) for (_, a), (_, b) in zip(plus, minus, strict=True)],
                axis=-1,
            )
            for i in messages
        ]
        # in units of the prior deviations: an error of deviation 0 drops out
        scaled = np.concatenate([np.zeros((0, sigma.size)), *rows]) * sigma
        covariance = np.linalg.inv(np.eye(sigma.size) + scaled.T @ scaled / noise.range_sigma**2)
        bound[k] = (
            (position_derivatives[k] * sigma) @ covariance @ (position_derivatives[k] * sigma).T
        )
    return bound


EVERYTHING = TrueNoise(
    speed_sigma=0.3,
    heading_sigma=0.1,
    range_sigma=0.02,
    range_scale_sigma=0.07,
    leader_heading_sigma=0.02,
    start=1.5,
    speed_bias=0.2,
    heading_bias=0.15,
    range_scale_bias=0.3,
    leader_heading_bias=0.05,
    current=0.1,
    range_offset=0.04,
    clock_offset=0.6,
    clock_drift=0.05,
)


@pytest.mark.parametrize(
    "exact",
    [
        (),
        ("leader_heading_bias",),
        ("current",),
        ("range_offset",),
        ("leader_heading_sigma", "current"),
    ],
)
@pytest.mark.parametrize("transmitters", [2, 3])
def test_the_recursion_is_least_squares_of_the_whole_mission(
    exact: tuple[str, ...], transmitters: int
) -> None:
    """A bending path, transmitters at different depths, some pings lost; errors `exact` are 0."""
    rng = np.random.default_rng(transmitters)
    n, message_step = 14, np.array([2, 5, 9, 12, 14])
    arms = rng.normal(size=(message_step.size, 3, 3)) * [2.0, 2.0, 4.0]
    arms[1, 1], arms[3, 0], arms[4] = np.nan, np.nan, np.nan
    geometry = BoundGeometry(
        dt=0.5,
        speed=rng.uniform(0.5, 2.0, n),
        heading=np.linspace(0.3, 2.9, n),
        message_step=message_step,
        from_leader=rng.normal(size=(message_step.size, 2)) * 3.0 + [-9.0, 6.0],
        arms=arms[:, :transmitters],
    )
    noise = replace(EVERYTHING, **dict.fromkeys(exact, 0.0))
    actual = position_bound(geometry, noise, averaged=False)
    np.testing.assert_allclose(actual, least_squares_bound(geometry, noise), rtol=1e-6, atol=1e-9)


def test_the_average_is_over_the_positions_that_the_bound_itself_allows() -> None:
    """One range of 30 m, position errors of 2.2 and 0.8 m at right angles: the expected information
    is the mean of h hᵀ / σ² over a fine grid.
    """
    noise = replace(KNOWN, speed_sigma=0.0, heading_bias=0.2, range_sigma=0.5, start=0.8)
    # over 10 m to the north a bias of 0.2 rad becomes 2 m across
    geometry = BoundGeometry(
        dt=1.0,
        speed=np.full(10, 1.0),
        heading=np.zeros(10),
        message_step=np.array([10]),
        from_leader=np.array([[18.0, -24.0]]),
        arms=np.array([[[0.0, 0.0, 0.0]]]),
    )
    prior = np.diag([0.8**2 + 2.0**2, 0.8**2])
    grid = np.linspace(-7.0, 7.0, 401)
    weight = np.exp(-0.5 * grid**2)
    weight /= weight.sum()
    east, north = 18.0 + np.sqrt(4.64) * grid[:, None], -24.0 + 0.8 * grid[None, :]
    h = np.stack([east + 0.0 * north, north + 0.0 * east]) / np.hypot(east, north)
    mean = np.einsum("aij,bij,i,j->ab", h, h, weight, weight)
    expected = np.linalg.inv(np.linalg.inv(prior) + mean / 0.25)
    np.testing.assert_allclose(position_bound(geometry, noise)[-1], expected, rtol=1e-5)
    at_truth = position_bound(geometry, noise, averaged=False)[-1]
    assert np.abs(at_truth / expected - 1.0).max() > 1e-3


def test_noise_is_that_of_the_papers_sensors_by_default() -> None:
    """Section 3.1: |N(0, 2°)| has σ = 2° √(1 − 2/π), a uniform error of 0.01 m has 0.01/√12;
    drawn many times here.
    """
    rng = np.random.default_rng(4)
    noise = TrueNoise()
    heading, ranges = np.abs(np.deg2rad(2.0) * rng.normal(size=400_000)), 0.01 * rng.random(400_000)
    assert noise.heading_sigma == pytest.approx(heading.std(), rel=5e-3)
    assert noise.range_sigma == pytest.approx(ranges.std(), rel=5e-3)
    assert (noise.speed_sigma, noise.range_scale_sigma) == (0.2, 0.05)
    # biases: the mean of |N(0, 2°)| is 1.6°, those of Eqs. 26 and 28 are 0.2 m/s and 0.1 m; a prior
    # must leave room
    assert (noise.speed_bias, noise.heading_bias, noise.range_scale_bias) == (
        0.3,
        np.deg2rad(8.0),
        0.2,
    )
    zero = ("start", "leader_heading_sigma", "leader_heading_bias", "current", "range_offset")
    assert [getattr(noise, name) for name in zero] == [0.0] * len(zero)


def test_three_transmitters_are_judged_at_the_truth_and_two_on_the_average() -> None:
    arms = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0], [-0.1, 0.0, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.0, start=0.6)
    for count in (2, 3):
        geometry = at_rest(5, (1.0, -6.0), arms[:count])
        bound = position_bound(geometry, noise)
        np.testing.assert_array_equal(bound, position_bound(geometry, noise, averaged=count == 2))
        assert np.abs(bound - position_bound(geometry, noise, averaged=count == 3)).max() > 1e-5


def test_a_bias_that_wanders_moves_the_position_by_its_integral() -> None:
    """North at v: b_θ of rate q adds v² q t³/3 across the course, b_v of rate q adds q t³/3 along
    it, a current that to both axes.
    """
    n, v, speed_walk, heading_walk, current, current_walk = 40, 1.5, 2e-3, 3e-3, 0.2, 4e-3
    noise = replace(
        KNOWN,
        speed_sigma=0.0,
        speed_walk=speed_walk,
        heading_walk=heading_walk,
        current=current,
        current_walk=current_walk,
    )
    geometry = replace(
        at_rest(n, (0.0, -20.0), np.full((3, 3), np.nan)),
        speed=np.full(n, v),
        message_step=np.array([n]),
    )
    bound = position_bound(
        replace(geometry, from_leader=geometry.from_leader[:1], arms=geometry.arms[:1]), noise
    )
    t = 0.1 * n
    expected = np.diag([(v * heading_walk) ** 2, speed_walk**2]) * t**3 / 3.0 + (
        current**2 * t**2 + current_walk**2 * t**3 / 3.0
    ) * np.eye(2)
    np.testing.assert_allclose(bound[-1], expected, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("lag", [0.0, 1.5, 10.0])
def test_messages_without_information_change_nothing(lag: float) -> None:
    """Prediction over two intervals is that over their sum, also of biases that wander: lost
    messages leave the bound as if they had not been sent.
    """
    noise = TrueNoise(speed_walk=0.02, heading_walk=0.03, current=0.3, current_walk=0.01, start=0.5)
    arms = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.3, 0.0]])
    all_messages = replace(
        at_rest(60, (5.0, -20.0), arms, steps_per_message=5),
        speed=np.full(60, 1.2),
        heading=np.full(60, 0.7),
    )
    arms = all_messages.arms.copy()
    arms[::2] = np.nan
    half_the_messages = replace(
        all_messages,
        message_step=all_messages.message_step[1::2],
        from_leader=all_messages.from_leader[1::2],
        arms=all_messages.arms[1::2],
    )
    expected = position_bound(half_the_messages, noise, lag=lag)
    np.testing.assert_allclose(
        position_bound(replace(all_messages, arms=arms), noise, lag=lag), expected, rtol=1e-9
    )


@pytest.mark.parametrize("lag", [0.5, 100.0])
def test_smoothing_is_least_squares_over_all_messages_that_come_in_time(lag: float) -> None:
    """A random walk with a constant bias along one axis: the inverse of the joint information of
    the positions at all steps.
    """
    n, steps_per_message, q, r, bias, start = 24, 4, 0.02**2, 0.5**2, 0.3, 0.4
    arms = np.array([[0.0, 1e7, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.2, range_sigma=0.5, speed_bias=bias, start=start)
    actual = position_bound(
        at_rest(n, (0.0, 0.0), arms, steps_per_message), noise, averaged=False, lag=lag
    )[:, 1, 1]
    for step in range(1, n + 1):
        joint = np.zeros((n + 2, n + 2))
        joint[0, 0], joint[-1, -1] = start**-2, bias**-2
        for k in range(1, n + 1):
            row = np.zeros(n + 2)
            row[[k - 1, k, -1]] = -1.0, 1.0, 0.1
            joint += np.outer(row, row) / q
            joint[k, k] += (k % steps_per_message == 0 and k <= step + round(10 * lag)) / r
        assert actual[step - 1] == pytest.approx(np.linalg.inv(joint)[step, step], rel=1e-6)


def test_information_on_the_current_grows_with_the_time_of_the_leader_track() -> None:
    """A Kalman filter of position and current along one axis: a current observed over 5 s of the
    leader's track has twice the variance of one over 10 s.
    """
    sigma, prior_sigma = 0.05, 0.4
    noise = replace(
        KNOWN, speed_sigma=0.0, current=prior_sigma, leader_way_sigma=sigma, leader_heading_bias=0.1
    )
    geometry = at_rest(600, (0.0, -20.0), np.full((3, 3), np.nan), steps_per_message=50)
    assert position_bound(geometry, noise)[-1, 0, 0] == pytest.approx((60.0 * prior_sigma) ** 2)
    # a leader at rest has no information on its compass
    bound = position_bound(replace(geometry, leader_velocity=np.zeros((12, 2))), noise)
    position_variance, covariance, current_variance = 0.0, 0.0, prior_sigma**2
    for _ in range(12):
        position_variance, covariance = (
            position_variance + 10.0 * covariance + 25.0 * current_variance,
            covariance + 5.0 * current_variance,
        )
        innovation_variance = current_variance + 2.0 * sigma**2
        position_variance, covariance, current_variance = (
            position_variance - covariance**2 / innovation_variance,
            covariance - covariance * current_variance / innovation_variance,
            2.0 * sigma**2 * current_variance / innovation_variance,
        )
    np.testing.assert_allclose(bound[-1], position_variance * np.eye(2), rtol=1e-9, atol=1e-12)
    # one that heads east at v cannot distinguish a current to the north from a compass error of
    # current / v
    v, moving_east = 1.2, replace(geometry, leader_velocity=np.tile([1.2, 0.0], (12, 1)))
    east, north = (
        25.0 * (prior_sigma**2 - prior_sigma**4 / innovation_variance)
        for innovation_variance in prior_sigma**2 + 2.0 * sigma**2 + np.array([0.0, (0.1 * v) ** 2])
    )
    np.testing.assert_allclose(
        position_bound(moving_east, noise)[49], np.diag([east, north]), rtol=1e-9, atol=1e-12
    )


def test_without_current_the_leader_track_observes_its_compass_bias() -> None:
    """East at v, received at right angles: the information on b_L is 1/σ² + T v² / (10 σ_c²); the
    ranges to two transmitters add none.
    """
    sigma, bias, v = 0.05, 0.1, 1.2
    noise = replace(
        KNOWN,
        speed_sigma=0.0,
        start=3.0,
        range_sigma=1e-4,
        leader_way_sigma=sigma,
        leader_heading_bias=bias,
    )
    arms = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    geometry = at_rest(50, (0.0, -20.0), arms, steps_per_message=50)
    with_track = replace(geometry, leader_velocity=np.array([[v, 0.0]]))
    for case, information in (
        (geometry, bias**-2),
        (with_track, bias**-2 + 5.0 * v**2 / (10.0 * sigma**2)),
    ):
        # ranges give the bearing from the leader's axis, which has the error of its compass
        expected = 1.0 / (3.0**-2 + information / 20.0**2)
        assert position_bound(case, noise, averaged=False)[-1, 0, 0] == pytest.approx(
            expected, rel=1e-3
        )


def test_a_clock_whose_rate_wanders_adds_its_integral_to_a_range() -> None:
    """τ̇ is Brownian motion of rate q: after T, τ has the variance σ_τ² + σ_τ̇² T² + q T³/3."""
    arms = np.array([[0.0, 50.0, 0.0]])
    noise = replace(KNOWN, speed_sigma=0.0, range_sigma=0.1, start=2.0)
    for clock in (
        {"clock_walk": 0.03},
        {"clock_offset": 0.2, "clock_drift": 0.05, "clock_walk": 0.03},
    ):
        with_clock = replace(noise, **clock)
        north = position_bound(at_rest(80, (0.0, 0.0), arms, 80), with_clock, averaged=False)[
            -1, 1, 1
        ]
        clock_variance = (
            with_clock.clock_offset**2
            + (8.0 * with_clock.clock_drift) ** 2
            + with_clock.clock_walk**2 * 8.0**3 / 3.0
        )
        assert north == pytest.approx(1.0 / (0.25 + 1.0 / (0.01 + clock_variance)), rel=1e-9)


def test_a_speed_that_may_change_at_will_has_the_bound_of_dead_reckoning() -> None:
    """The log is then an input as without `speed_change`; a steady speed has a smaller bound."""
    n = 400
    heading = 0.01 * np.arange(n)
    arms = np.array([[-1.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 0.5, 2.0]])
    resting = at_rest(n, (12.0, -9.0), arms, steps_per_message=50)
    geometry = replace(resting, speed=np.full(n, 1.2), heading=heading)
    noise = TrueNoise(start=0.01)
    without_speed_state = position_bound(geometry, noise)
    free = position_bound(geometry, replace(noise, speed_change=100.0))
    held = position_bound(geometry, replace(noise, speed_change=0.005))
    after_messages = geometry.message_step[1:] - 1
    np.testing.assert_allclose(
        free[after_messages], without_speed_state[after_messages], rtol=0.03, atol=1e-5
    )
    assert np.all(
        np.trace(held, axis1=1, axis2=2)[60:] < np.trace(without_speed_state, axis1=1, axis2=2)[60:]
    )


@pytest.mark.parametrize("transmitters", [2, 3])
@pytest.mark.parametrize("lag", [0.0, 4.0])
def test_the_bound_does_not_depend_on_how_many_intervals_are_computed_at_once(
    monkeypatch: pytest.MonkeyPatch, transmitters: int, lag: float
) -> None:
    """Messages at any steps, of which any ranges are lost, one interval at a time or many."""
    rng = np.random.default_rng(3)
    n = 400
    steps = np.sort(rng.choice(np.arange(1, n + 1), 60, replace=False))
    steps = np.union1d(steps, np.arange(200, 300, 4))
    arms = rng.normal(0.0, 1.0, (steps.size, transmitters, 3))
    arms[..., 2] += 3.0
    arms[rng.uniform(size=arms.shape[:2]) < 0.2] = np.nan
    geometry = BoundGeometry(
        dt=0.1,
        speed=rng.uniform(0.8, 1.4, n),
        heading=np.cumsum(rng.normal(0.0, 0.05, n)),
        message_step=steps,
        from_leader=rng.normal(0.0, 20.0, (steps.size, 2)),
        arms=arms,
        leader_velocity=rng.normal(0.0, 1.0, (steps.size, 2)),
    )
    noise = TrueNoise(
        start=2.0,
        current=0.3,
        current_walk=0.01,
        speed_walk=1e-3,
        leader_heading_bias=0.03,
        leader_way_sigma=0.1,
        clock_offset=0.5,
        clock_drift=0.01,
    )
    together = position_bound(geometry, noise, lag=lag)
    monkeypatch.setattr("laisn.bound._MAX_INTERVALS", 1)
    np.testing.assert_allclose(together, position_bound(geometry, noise, lag=lag), rtol=1e-9)


@pytest.mark.parametrize("lag", [0.0, 3.0])
def test_followers_together_have_the_bounds_that_each_has_alone(
    monkeypatch: pytest.MonkeyPatch, lag: float
) -> None:
    """Missions of different lengths, with messages at different steps and losses of their own, of
    two and of three transmitters, and one follower with other noise.
    """
    monkeypatch.setattr("laisn.bound._MAX_INTERVALS", 7)
    monkeypatch.setattr("laisn.bound._MAX_FOLLOWERS", 2)
    rng = np.random.default_rng(5)
    geometries = []
    missions = ((120, 30, 3), (90, 25, 3), (120, 11, 3), (60, 20, 2), (9, 0, 3))
    for n, messages, transmitters in missions:
        arms = rng.normal(0.0, 1.0, (messages, transmitters, 3))
        arms[..., 2] += 3.0
        arms[rng.uniform(size=arms.shape[:2]) < 0.2] = np.nan
        geometry = BoundGeometry(
            dt=0.1,
            speed=rng.uniform(0.8, 1.4, n),
            heading=np.cumsum(rng.normal(0.0, 0.05, n)),
            message_step=np.sort(rng.choice(np.arange(1, n + 1), messages, replace=False)),
            from_leader=rng.normal(0.0, 20.0, (messages, 2)),
            arms=arms,
        )
        geometries += [geometry, replace(geometry, from_leader=geometry.from_leader + 5.0)]
    noises = [TrueNoise(start=1.0, current=0.3)] * 9 + [TrueNoise(start=3.0)]
    together = position_bounds(geometries, noises, lag=lag)
    for bound, geometry, noise in zip(together, geometries, noises, strict=True):
        np.testing.assert_allclose(bound, position_bound(geometry, noise, lag=lag), rtol=1e-12)
    for bound, bound_of_shifted in zip(together[:-1:2], together[1:-1:2], strict=False):
        assert bound.shape == bound_of_shifted.shape
        assert len(bound) == 9 or np.abs(bound - bound_of_shifted).max() > 1e-4


@pytest.mark.parametrize("transmitters", [2, 3])
@pytest.mark.parametrize("lag", [0.0, 1.0])
def test_exact_ranges_have_no_bound(transmitters: int, lag: float) -> None:
    arms = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.1, 0.0]])[:transmitters]
    geometry = at_rest(20, (3.0, -20.0), arms)
    noise = TrueNoise(range_sigma=0.0)
    assert not noise.has_bound
    noisy, exact = position_bounds([geometry] * 2, [TrueNoise(), noise], lag=lag)
    assert np.isnan(exact).all()
    # beside a follower with noise, whose bound is as alone
    np.testing.assert_array_equal(noisy, position_bound(geometry, TrueNoise(), lag=lag))


def test_an_exact_log_that_measures_the_speed_has_no_bound() -> None:
    geometry = at_rest(5, (0.0, -20.0), np.full((3, 3), np.nan))
    noise = TrueNoise(speed_sigma=0.0, speed_change=0.1)
    assert np.isnan(position_bound(geometry, noise)).all()
