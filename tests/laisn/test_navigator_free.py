"""LAISN with steps of any length, transmitters at any positions, and single ranges."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import update
from hypothesis import given
from hypothesis import strategies as st

from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.fix import Circle, Circles, RangeCircles, one_range
from laisn.geometry import Point, place_on_body, sin_cos_of, tilted_arms
from laisn.lanes import tuning
from laisn.messages import LeaderMessage, OwnMotion, Ranges, Reception
from laisn.navigator import Filter, Gate, Navigator
from laisn.settings import LAISN_VARIANTS, NavigationSettings, Tuning, Variant
from tests.laisn.passages import BEACONS, SETTINGS, START, passage
from tests.synthetic import bits

ANGLE = st.floats(-3.0, 3.0)
LENGTH = st.floats(0.0, 500.0)


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_durations_of_one_step_change_nothing_to_the_bit(variant: Variant) -> None:
    settings = replace(SETTINGS, variant=variant)
    equal, _ = passage(None)
    changed = replace(equal, durations=np.full(400, 0.5))
    assert np.array_equal(changed.time, equal.time)
    assert bits(Navigator(settings, START).run(changed)) == bits(
        Navigator(settings, START).run(equal)
    )


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_steps_of_any_length_recover_the_truth(variant: Variant) -> None:
    """Jitter and gaps, beacons hundreds of metres apart, no noise."""
    random = np.random.default_rng(5)
    durations = random.uniform(0.3, 0.7, 400)
    durations[[50, 222]] = 6.0
    measurements, truth = passage(durations)
    estimates = Navigator(replace(SETTINGS, variant=variant), START).run(measurements)
    assert np.abs(estimates.state[:, :2] - truth[1:]).max() < 1e-6
    assert not np.isin(estimates.fix_kind, (FixKind.LOST, FixKind.GATED)).any()


def test_a_longer_step_is_predicted_as_so_many_shorter_ones() -> None:
    """Two steps without process noise are one of twice the length."""
    one_step, two_steps = (
        Filter(0.5, np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 2.0, 0.5, 0.25]))
        for _ in range(2)
    )
    one_step.predict(0.0, 1.0)
    two_steps.predict(0.0)
    two_steps.predict(0.0)
    np.testing.assert_allclose(one_step.state, two_steps.state, rtol=0, atol=1e-12)
    np.testing.assert_allclose(one_step.covariance, two_steps.covariance, rtol=0, atol=1e-12)


def test_process_noise_grows_with_the_length_of_the_step() -> None:
    """σa² Δt⁴/4 for the position, σa² Δt² for the velocity (paper, Section 2.1)."""
    filter_ = Filter(0.1, np.zeros(4), np.zeros(4))
    filter_.predict(3.0, 2.0)
    np.testing.assert_allclose(np.diag(filter_.covariance), [36.0, 36.0, 36.0, 36.0])


def test_the_gate_opens_with_the_time_since_the_last_fix() -> None:
    gate = Gate(Tuning.of(NavigationSettings(dt=0.1, follower_speed_max=3.0)), Point(0.0, 0.0))
    gate.lengthen(4.9)
    assert gate.bound(2, 1.0) == pytest.approx(3.0 * 5.1)
    gate.accept(Point(0.0, 0.0), 2)
    assert gate.bound(3, 1.0) == 3.0 * 0.1


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_absurd_durations_are_refused(duration: float) -> None:
    with pytest.raises(LaisnError, match="expected a positive time"):
        Navigator(SETTINGS, START).step(OwnMotion(1.0, 0.0, 9.0), duration=duration)
    with pytest.raises(ValueError, match="durations must be positive"):
        passage(np.full(400, duration))


@given(heading=ANGLE, pitch=ANGLE, roll=ANGLE, baseline=LENGTH, offset=LENGTH)
def test_places_on_a_body_are_those_of_transmitters_on_a_hull(
    heading: float, pitch: float, roll: float, baseline: float, offset: float
) -> None:
    origin, attitude = (3.0, -4.0, 8.0), (heading, pitch, roll)
    offsets = np.array([[-0.5 * baseline, 0, 0], [0.5 * baseline, 0, 0], [0, offset, 0]])
    front, middle = np.array(tilted_arms(baseline, offset, *map(sin_cos_of, attitude))) * [
        1.0,
        1.0,
        -1.0,
    ]
    expected = np.array(origin) + np.stack([-front, front, middle])
    np.testing.assert_allclose(
        place_on_body(origin, attitude, offsets), expected, rtol=0, atol=1e-9
    )


@given(heading=ANGLE, pitch=ANGLE, roll=ANGLE)
def test_a_body_is_turned_as_a_whole(heading: float, pitch: float, roll: float) -> None:
    """Right-handed: forward, port and up stay at right angles, and level, up is up."""
    east, north, depth = (place_on_body((0, 0, 0), (heading, pitch, roll), np.eye(3))).T
    axes = np.stack([east, north, -depth], axis=1)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(
        place_on_body((0, 0, 5), (heading, 0, 0), np.eye(3))[2], [0, 0, 4], atol=1e-12
    )


def test_offsets_from_a_leader_are_equivalent_to_positions_in_its_messages() -> None:
    """A ship that lies still and heads east: forward is east, port is north."""
    measurements, _ = passage(None)
    turned = measurements.message.copy()
    turned[:, 3] = np.pi / 2
    offsets = tuple((east, north, -depth) for east, north, depth in BEACONS.tolist())
    by_positions = Navigator(SETTINGS, START).run(replace(measurements, message=turned))
    settings = replace(SETTINGS, transmitter_offsets=offsets)
    by_offsets = Navigator(settings, START).run(
        replace(measurements, message=turned, transmitters=None)
    )
    np.testing.assert_allclose(by_offsets.state, by_positions.state, rtol=0, atol=1e-9)


def test_two_beacons_are_enough_and_a_third_without_a_position_is_not_used() -> None:
    measurements, truth = passage(None)
    # heading north: forward is north, port is west
    offsets = tuple((north, -east, -depth) for east, north, depth in BEACONS[:2].tolist())
    changed = replace(SETTINGS, variant="laisn-3-2", transmitter_offsets=offsets)
    estimates = Navigator(changed, START).run(replace(measurements, transmitters=None))
    assert np.abs(estimates.state[:, :2] - truth[1:]).max() < 1e-6
    assert set(estimates.fix_kind.tolist()) == {FixKind.TWO_POINTS}


def circles_of_beacons(*radius: float) -> RangeCircles:
    """Beacons at 0 and 100 m east, the third between them and aside."""
    centres = Point(0.0, 0.0), Point(100.0, 0.0), Point(50.0, 1.0)
    return RangeCircles(Circles(*map(Circle, centres, radius)), sin_cos_of(0.0), 0.0, off_hull=True)


@pytest.mark.parametrize(
    ("rear", "front", "east"),
    [
        (40.0, 58.0, 41.0),  # between them, circles 2 m apart
        (133.0, 31.0, 132.0),  # beyond the front one, circle within circle
        (29.0, 131.0, -30.0),  # behind the rear one
        (40.0, 60.0 + 1e-9, 40.0),  # between them, circles that all but touch
    ],
)
def test_where_circles_of_beacons_miss_each_other_the_fix_lies_midway(
    rear: float, front: float, east: float
) -> None:
    """By hand; the paper's point dead astern, at −40 m in the first case, would be 81 m off."""
    received = circles_of_beacons(rear, front, np.nan)
    actual = received.fix(received.pairs()[0], Point(41.0, 1.0), Tuning.of(NavigationSettings()))
    np.testing.assert_allclose((actual.east, actual.north), (east, 0.0), atol=1e-6)
    assert actual.kind == FixKind.ASTERN


def test_one_range_moves_the_prediction_onto_its_circle_along_the_line_of_sight() -> None:
    predicted = Point(130.0, 40.0)
    # from (100, 0) towards (130, 40): 50 m of 50 m
    on_the_circle, inside = (
        one_range(circles_of_beacons(np.nan, r, 3.0).circles, predicted) for r in (50.0, 25.0)
    )
    assert on_the_circle is not None
    assert inside is not None
    np.testing.assert_allclose(on_the_circle[0], (130.0, 40.0))
    np.testing.assert_allclose(inside, ((115.0, 20.0), (0.6, 0.8)))
    assert one_range(circles_of_beacons(np.nan, np.nan, np.nan).circles, Point(1.0, 1.0)) is None
    assert one_range(circles_of_beacons(3.0, np.nan, np.nan).circles, Point(0.0, 0.0)) is None


@given(seed=st.integers(0, 2**32 - 1), sigma=st.floats(0.01, 10.0))
def test_the_update_along_a_line_is_the_textbook_one(seed: int, sigma: float) -> None:
    random = np.random.default_rng(seed)
    filter_ = Filter(0.1, random.normal(0, 5, 4), random.uniform(0.5, 5, 4))
    filter_.predict(2.0)
    filter_.update_speed(1.0, random.uniform(0, 6), 0.2, 0.03)
    state, covariance = filter_.state, filter_.covariance
    bearing = random.uniform(0, 2 * np.pi)
    axis, residual = np.array([np.sin(bearing), np.cos(bearing)]), random.normal(0, 3)
    innovation = filter_.update_position(
        tuple(state[:2] + residual * axis), sigma, (axis[0], axis[1])
    )
    h = np.array([[*axis, 0.0, 0.0]])
    x, p = update(state, covariance, h @ state + residual, sigma**2, h)
    np.testing.assert_allclose(filter_.state, x, rtol=0, atol=1e-8)
    np.testing.assert_allclose(filter_.covariance, p, rtol=0, atol=1e-8)
    variance = float((h @ covariance @ h.T)[0, 0]) + sigma**2
    np.testing.assert_allclose(innovation.covariance, variance * np.eye(2))
    assert float(innovation.residual @ axis) == pytest.approx(residual, abs=1e-9)


@pytest.mark.parametrize("variant", LAISN_VARIANTS)
def test_a_single_range_is_used_if_the_settings_allow_it(variant: Variant) -> None:
    """With a log that reads a tenth too much, one beacon keeps the distance right; the paper
    drifts off it.
    """
    measurements, truth = passage(None, lost=(1, 2))
    fast = replace(measurements, speed=np.full(400, 1.1))
    distance = np.linalg.norm(np.column_stack([truth[1:], np.full(400, 9.0)]) - BEACONS[0], axis=1)

    def largest_error_and_kinds(use_single_range: bool) -> tuple[float, set[int]]:
        estimates = Navigator(
            replace(SETTINGS, variant=variant, use_single_range=use_single_range), START
        ).run(fast)
        estimated = np.column_stack([estimates.state[:, :2], np.full(400, 9.0)])
        error = np.linalg.norm(estimated - BEACONS[0], axis=1) - distance
        return float(np.abs(error[measurements.message_step - 1]).max()), set(
            estimates.fix_kind.tolist()
        )

    assert largest_error_and_kinds(use_single_range=False)[1] == {FixKind.LOST}
    assert largest_error_and_kinds(use_single_range=False)[0] > 10.0
    assert largest_error_and_kinds(use_single_range=True)[1] == {FixKind.ONE_RANGE}
    # the speed update that follows the range moves the estimate by what a step's speeds differ
    assert largest_error_and_kinds(use_single_range=True)[0] < 0.1


def test_single_ranges_do_not_narrow_the_gate_across_the_line_of_sight() -> None:
    navigator = Navigator(
        replace(SETTINGS, use_single_range=True, dt=1.0), np.array([0.0, 100.0, 0.0, 0.0])
    )
    message = LeaderMessage(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(10):
        reception = Reception(message, Ranges(100.0, np.nan, np.nan), np.zeros((3, 3)))
        assert navigator.step(OwnMotion(1.0, 0.0, 0.0), reception)[0].kind is FixKind.ONE_RANGE
    # 20 m aside is more than 3 m/s allow in one second, and less than in all eleven
    beacons = np.array([[0.0, 0, 0], [100.0, 0, 0], [np.nan] * 3])
    position = np.array([20.0, np.sqrt(100.0**2 - 20.0**2)])
    ranges = np.linalg.norm(position - beacons[:, :2], axis=1)
    kind = navigator.step(
        OwnMotion(1.0, 0.0, 0.0), Reception(message, Ranges(*ranges.tolist()), beacons)
    )[0].kind
    assert kind is FixKind.TWO_POINTS
    np.testing.assert_allclose(navigator.state[:2], position, atol=0.1)


def test_lanes_refuse_settings_for_single_vehicles() -> None:
    with_offsets = replace(SETTINGS, transmitter_offsets=((0.0, 0.0, 0.0), (9.0, 0.0, 0.0)))
    for settings in (replace(SETTINGS, use_single_range=True), with_offsets):
        with pytest.raises(LaisnError, match="for single vehicles and their logs"):
            tuning(settings)
