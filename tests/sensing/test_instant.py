"""What a follower on a station reads at an instant beside log, compass and pressure: inclinometer and gyros."""

import numpy as np
import pytest

from laisn.arrays import Floats
from sim.geometry import attitude
from sim.scenario.settings import Scenario, Sensors
from sim.sensing.instant import Senses, read_own, senses_of
from tests.synthetic import make_scenario

PITCH, RATES = 0.1, (0.02, -0.03, 0.05)
"""Pitch [rad] and rates of turn about the forward, port and up axis [rad/s]."""


def scenario(tilt_sigma_deg: float, gyro_sigma_deg_s: float) -> Scenario:
    sensors = Sensors(tilt_sigma_deg=tilt_sigma_deg, gyro_sigma_deg_s=gyro_sigma_deg_s)
    return make_scenario(10.0).model_copy(update={"sensors": sensors})


def read(senses: Senses, steps: int, follower: int = 0) -> Floats:
    """Readings of pitch and of the turning about the up and the port axis, step by step, shape (steps, 3)."""
    pose, twist = np.r_[0.0, 0.0, -10.0, attitude.from_euler(1.0, PITCH, 0.2)], np.r_[1.0, 0.0, 0.0, RATES]
    readings = np.empty((steps, 6))
    for k in range(steps):
        read_own(senses, k + 1, follower, (pose, twist, np.zeros(3)), np.zeros(3), readings[k])
    return readings[:, 3:]


def test_perfect_instruments_read_pitch_and_the_rates_of_the_hull() -> None:
    assert read(senses_of(scenario(0.0, 0.0)), 1)[0] == pytest.approx([PITCH, RATES[2], RATES[1]])


def test_instruments_err_as_much_as_the_scenario_says_and_each_on_its_own() -> None:
    n = 2000
    found = read(senses_of(scenario(0.5, 0.1)), n)
    sigma = np.deg2rad([0.5, 0.1, 0.1])
    # five standard deviations of a mean, and of a standard deviation
    assert np.all(np.abs(found.mean(axis=0) - [PITCH, RATES[2], RATES[1]]) < 5 * sigma / np.sqrt(n))
    assert found.std(axis=0) == pytest.approx(sigma, rel=5 / np.sqrt(2 * n))
    assert np.abs(np.corrcoef(found.T) - np.eye(3)).max() < 5 / np.sqrt(n)
    other = read(senses_of(scenario(0.5, 0.1)), n, follower=1)
    assert np.abs([np.corrcoef(a, b)[0, 1] for a, b in zip(found.T, other.T, strict=True)]).max() < 5 / np.sqrt(n)
