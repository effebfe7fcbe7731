"""The gross-error gate: a fix must lie within the distance that the follower can have covered."""

import numpy as np
import pytest

from laisn.geometry import Point
from laisn.navigator import Gate
from laisn.settings import NavigationSettings, Tuning


def gate_at(start: Point, **settings: object) -> Gate:
    """A gate with these settings, whose last accepted position is `start`."""
    return Gate(Tuning.of(NavigationSettings(**settings)), start)  # type: ignore[arg-type]


def test_bound_is_the_distance_at_top_speed_since_the_last_accepted_position() -> None:
    gate = gate_at(Point(10.0, 0.0), gate="v-max", follower_speed_max=3.0, dt=0.1)
    assert gate.bound(10, 1.0) == pytest.approx(3.0)
    assert gate.passes(Point(12.9, 0.0), 10, 1.0)
    assert not gate.passes(Point(10.0, 3.1), 10, 1.0)
    gate.accept(Point(12.0, 0.0), 10)
    assert gate.bound(15, 1.0) == pytest.approx(1.5)
    assert not gate.passes(Point(10.0, 0.0), 15, 1.0)


def test_bound_at_the_measured_speed() -> None:
    gate = gate_at(Point(0.0, 0.0), gate="v-measured", dt=1.0)
    assert gate.bound(10, 1.2) == pytest.approx(12.0)


def test_a_fix_at_the_reachable_limit_is_accepted() -> None:
    """Three metres east and four north are five, which 5 m/s cover in the second that has
    passed.
    """
    gate = gate_at(Point(1.0, 2.0), gate="v-max", follower_speed_max=5.0, dt=1.0)
    assert gate.passes(Point(4.0, 6.0), 1, 0.0)
    assert not gate.passes(Point(4.0, np.nextafter(6.0, 7.0)), 1, 0.0)


def test_a_gate_that_is_off_passes_everything() -> None:
    assert gate_at(Point(0.0, 0.0), gate="off").passes(Point(1e6, 0.0), 1, 0.0)


def test_a_vehicle_that_keeps_moving_is_never_locked_out() -> None:
    """After any number of rejections the bound exceeds any distance that the vehicle can have
    covered.
    """
    gate = gate_at(Point(0.0, 0.0), gate="v-max", follower_speed_max=3.0, dt=0.1)
    for step in range(10, 10_000, 10):
        travelled = 0.999 * 3.0 * step * 0.1
        assert gate.passes(Point(travelled * np.cos(step), travelled * np.sin(step)), step, 1.0)
