"""The shipped Doppler velocity log against the motion of a rigid body."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sim.sensing.dvl import Dvl

FLOOR = SimpleNamespace(floor_depth=lambda east, north: 30.0)


def vehicle_state(up: float, yaw: float = 0.0) -> Any:
    """A vehicle at a height `up` [m] that goes east at 2 m/s and sinks at 0.1 m/s, its bow turned
    by a yaw from east to port [rad].
    """
    sine, cosine = math.sin(yaw), math.cos(yaw)

    def in_hull(vector: Any) -> tuple[float, float, float]:
        return (
            cosine * vector[0] + sine * vector[1],
            -sine * vector[0] + cosine * vector[1],
            vector[2],
        )

    velocity = np.array([2.0, 0.0, -0.1])
    return SimpleNamespace(position=np.array([5.0, 6.0, up]), velocity=velocity, in_hull=in_hull)


def test_it_reads_the_velocity_along_the_hull_s_axes_and_the_altitude() -> None:
    reading: Any = Dvl().true(vehicle_state(-12.0, math.radians(30.0)), FLOOR)  # type: ignore[arg-type]
    # the course over ground lies 30° to starboard of the bow, so that port is negative
    expected = [2.0 * math.cos(math.pi / 6), -2.0 * math.sin(math.pi / 6), -0.1, 18.0]
    assert reading == pytest.approx(expected)


def test_it_reads_nothing_beyond_its_lock() -> None:
    sensor: Any = Dvl(lock=17.0)
    assert np.isnan(sensor.true(vehicle_state(-12.0), FLOOR)).all()
    assert np.isfinite(sensor.true(vehicle_state(-13.5), FLOOR)).all()


def test_errors_have_their_deviations_and_dropouts_their_rate() -> None:
    sensor = Dvl(velocity_sigma=0.02, altitude_sigma=0.1, dropout=0.25)
    draws = np.random.default_rng(4).standard_normal((4000, 5))
    readings = np.array([sensor.read(np.zeros(4), row) for row in draws])
    dropped = np.isnan(readings).all(axis=1)
    # four standard deviations of a binomial proportion
    assert dropped.mean() == pytest.approx(0.25, abs=4 * math.sqrt(0.25 * 0.75 / 4000))
    assert np.isfinite(readings[~dropped]).all()
    assert readings[~dropped].std(axis=0) == pytest.approx([0.02, 0.02, 0.02, 0.1], rel=0.06)
