"""Plane and hull geometry: closed forms and invariants."""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from laisn import geometry
from laisn.geometry import Point, sin_cos_of
from laisn.messages import LeaderMessage, Ranges, Reception
from laisn.settings import Settings
from sim import attitude

COORDINATE = st.floats(-200, 200)
RADIUS = st.floats(0, 200)
ANGLE = st.floats(-20, 20)


@given(angle=ANGLE)
def test_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = geometry.wrap_angle(angle)
    assert -np.pi <= wrapped <= np.pi
    assert np.exp(1j * wrapped) == pytest.approx(np.exp(1j * angle), abs=1e-9)


@given(angle=ANGLE)
def test_signed_angle_is_the_same_direction_for_numbers_and_arrays(angle: float) -> None:
    signed = geometry.signed_angle(angle)
    assert -np.pi <= signed < np.pi
    assert np.exp(1j * signed) == pytest.approx(np.exp(1j * angle), abs=1e-9)
    assert geometry.signed_angle(np.array([angle, np.pi])).tolist() == [signed, -np.pi]


@given(a=ANGLE, b=ANGLE)
def test_angle_between_is_the_arc_cosine_of_the_directions(a: float, b: float) -> None:
    cosine = np.real(np.exp(1j * a) * np.conj(np.exp(1j * b)))
    assert np.cos(geometry.angle_between(a, b)) == pytest.approx(cosine, abs=1e-9)
    assert 0 <= geometry.angle_between(a, b) <= np.pi


@given(
    heading=ANGLE,
    pitch=st.floats(-1.2, 1.2),
    roll=st.floats(-1.2, 1.2),
    forward=COORDINATE,
    port=COORDINATE,
)
def test_hull_points_agree_with_quaternions(
    heading: float, pitch: float, roll: float, forward: float, port: float
) -> None:
    (on_body,) = geometry.place_on_body(
        (0.0, 0.0, 0.0), (heading, pitch, roll), np.array([[forward, port, 0.0]])
    )
    by_quaternion = attitude.rotate(
        attitude.from_euler(heading, pitch, roll), np.array([forward, port, 0.0])
    )
    np.testing.assert_allclose(on_body * [1.0, 1.0, -1.0], by_quaternion, atol=1e-9)


def test_transmitters_of_a_pitched_leader() -> None:
    """Bow up by φ: the front transmitter rises by (L/2) sin φ, the rear one sinks, both move
    inwards.
    """
    phi = np.deg2rad(15)
    message, settings = (
        LeaderMessage(0.0, 10.0, 20.0, 0.0, 1.0, 8.0, phi, 0.0),
        Settings(use_attitude=True),
    )
    rear, front, middle = geometry.place_transmitters(
        Reception(message, Ranges(9.0, 9.0, 9.0)), settings
    )
    np.testing.assert_allclose(front, [10, 20 + np.cos(phi), 8 - np.sin(phi)])
    np.testing.assert_allclose(rear, [10, 20 - np.cos(phi), 8 + np.sin(phi)])
    np.testing.assert_allclose(middle, [9.9, 20, 8])


@given(heading=ANGLE, baseline=RADIUS, offset=COORDINATE)
def test_transmitters_of_a_leader_that_is_tilted_by_nothing_are_those_of_a_level_one(
    heading: float, baseline: float, offset: float
) -> None:
    ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
    level = 0.5 * baseline * ahead, offset * np.array([-ahead[1], ahead[0], 0.0])
    tilted = geometry.tilted_arms(
        baseline, offset, sin_cos_of(heading), sin_cos_of(0.0), sin_cos_of(0.0)
    )
    np.testing.assert_allclose(level, tilted, rtol=0, atol=1e-12)


def test_horizontal_range_of_a_pythagorean_triple_and_of_an_impossible_one() -> None:
    assert geometry.horizontal_range(13.0, -5.0) == 12.0
    assert geometry.horizontal_range(4.9, 5.0) == 0.0
    assert np.isnan(geometry.horizontal_range(np.nan, 5.0))


class Meeting(NamedTuple):
    """Where two circles meet."""

    n_points: int
    separation: float
    left: Point
    right: Point


def meeting(x: float, y: float, r1: float, xj: float, yj: float, r2: float) -> Meeting:
    """Where the circle about (x, y) and the one about (xj, yj) meet: the ends of their chord."""
    chord = geometry.common_chord(Point(x, y), r1, Point(xj, yj), r2)
    if not chord.distinct or chord.half_squared < 0.0:
        return Meeting(0, 0.0, Point(np.nan, np.nan), Point(np.nan, np.nan))
    half = math.sqrt(chord.half_squared)
    east, north = x + chord.offset * chord.direction.east, y + chord.offset * chord.direction.north
    aside_east, aside_north = -half * chord.direction.north, half * chord.direction.east
    return Meeting(
        2 if half > 0.0 else 1,
        2.0 * half,
        Point(east + aside_east, north + aside_north),
        Point(east - aside_east, north - aside_north),
    )


# a circle through the other's centre, and that one as small as rounding: their chord is short, but
# there
@example(x=0.0, y=0.0, dx=12.0, turn=0.0, r1=12.0, r2=1.192092896e-07)
@given(x=COORDINATE, y=COORDINATE, dx=st.floats(0.1, 100), turn=ANGLE, r1=RADIUS, r2=RADIUS)
def test_intersections_lie_on_both_circles(
    x: float, y: float, dx: float, turn: float, r1: float, r2: float
) -> None:
    xj, yj = x + dx * np.cos(turn), y + dx * np.sin(turn)
    meet = meeting(x, y, r1, xj, yj, r2)
    distance = np.hypot(xj - x, yj - y)
    if r1 + r2 < distance - 1e-9 or abs(r1 - r2) > distance + 1e-9:
        assert meet.n_points == 0
    if abs(r1 - r2) + 1e-9 < distance < r1 + r2 - 1e-9:
        assert meet.n_points == 2
    if meet.n_points == 2:
        for px, py in (meet.left, meet.right):
            # near tangency the points are ill-conditioned across the axis, not along the radius
            assert np.hypot(px - x, py - y) == pytest.approx(r1, abs=1e-6)
            assert np.hypot(px - xj, py - yj) == pytest.approx(r2, abs=1e-6)
        assert meet.separation == pytest.approx(
            np.hypot(*np.subtract(meet.left, meet.right)), abs=1e-6
        )
        left_of_axis = (xj - x) * (meet.left[1] - y) - (yj - y) * (meet.left[0] - x)
        assert left_of_axis > 0


@example(d=12.0, r1=12.0, fraction=-1.0 + 1e-8)
@given(d=st.floats(0.1, 100), r1=RADIUS, fraction=st.floats(-1.1, 1.1))
def test_chord_is_that_of_exact_arithmetic(d: float, r1: float, fraction: float) -> None:
    """By Python's fractions; the circles meet, or miss each other by up to a tenth of a radius."""
    r2 = abs(d + fraction * r1)
    meet = meeting(0.0, 0.0, r1, d, 0.0, r2)
    along = (Fraction(d) ** 2 + Fraction(r1) ** 2 - Fraction(r2) ** 2) / (2 * Fraction(d))
    half_squared = Fraction(r1) ** 2 - along**2
    # in Heron's product each factor is a sum of three sides, with their rounding errors
    sides = float(d + r1 + r2)
    factors = [sides, abs(r1 + r2 - d), abs(d + r1 - r2), abs(d - r1 + r2)]
    side_error = 1e-15 * sides
    rounding = (math.prod(f + side_error for f in factors) - math.prod(factors)) / (4 * d * d)
    if half_squared > rounding:
        assert meet.n_points == 2
        assert meet.separation**2 / 4 == pytest.approx(float(half_squared), abs=rounding, rel=1e-12)
    if half_squared < -rounding:
        assert meet.n_points == 0


@given(east=COORDINATE, north=COORDINATE, turn=ANGLE, x=COORDINATE, y=st.floats(1, 100))
def test_intersections_move_with_the_circles(
    east: float, north: float, turn: float, x: float, y: float
) -> None:
    """Turning and shifting both circles turns and shifts the points."""
    r1, r2 = float(np.hypot(x + 1, y)), float(np.hypot(x - 1, y))
    cos, sin = np.cos(turn), np.sin(turn)

    def moved(px: float, py: float) -> tuple[float, float]:
        return east + cos * px - sin * py, north + sin * px + cos * py

    meet = meeting(*moved(-1, 0), r1, *moved(1, 0), r2)
    assert meet.n_points == 2
    np.testing.assert_allclose([meet.left, meet.right], [moved(x, y), moved(x, -y)], atol=1e-7)


def test_worked_circles() -> None:
    """Centres 2 apart: radii √2 meet at (1, ±1); radii 1 touch at (1, 0); radii 0.9 do not meet."""
    root = np.sqrt(2.0)
    two = meeting(0.0, 0.0, root, 2.0, 0.0, root)
    assert two.n_points == 2
    np.testing.assert_allclose([two.left, two.right], [(1, 1), (1, -1)], atol=1e-15)
    assert two.separation == pytest.approx(2.0)
    one = meeting(0.0, 0.0, 1.0, 2.0, 0.0, 1.0)
    assert (one.n_points, one.left) == (1, (1.0, 0.0))
    assert meeting(0.0, 0.0, 0.9, 2.0, 0.0, 0.9).n_points == 0
    assert meeting(1.0, 1.0, 5.0, 1.0, 1.0, 5.0).n_points == 0
