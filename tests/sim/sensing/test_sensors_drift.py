"""Errors that change slowly have the amplitudes, period, phases and directions of the scenario."""

from typing import Any

import numpy as np
import pytest

from sim.scenario.parts import SensingSettings
from sim.scenario.sensors import Sensors
from sim.sensing.observation import observe
from sim.sensing.sensors import SensorErrors, drift, errors_of
from tests.straight import make_scenario, make_trajectory

DRIFTING = Sensors(
    speed_drift_m_s=0.3,
    heading_drift_deg=4.0,
    drift_period_s=200.0,
    speed_drift_phase_deg=30.0,
    heading_drift_phase_deg=90.0,
    leader_position_drift_m_s=0.02,
    leader_position_drift_deg=30.0,
)


def errors_with(sensors: Sensors) -> SensorErrors:
    """Errors of a scenario with these sensors."""
    return errors_of(SensingSettings.of(make_scenario().model_copy(update={"sensors": sensors})))


def drifted_readings(
    errors: SensorErrors, follower: int, time: Any, speed: Any, heading: Any
) -> tuple[Any, Any]:
    return (
        speed + drift(errors, errors.speed_drift, errors.speed_drift_phase, follower, time),
        heading + drift(errors, errors.heading_drift, errors.heading_drift_phase, follower, time),
    )


def test_biases_swing_with_their_amplitudes_periods_and_phases() -> None:
    errors = errors_with(DRIFTING)
    # at the start, and a period later: half of the speed's amplitude (30°), all of the heading's
    for time in (0.0, 200.0):
        assert drifted_readings(errors, 0, time, 1.0, 0.5) == pytest.approx(
            (1.15, 0.5 + np.deg2rad(4.0))
        )
    # half a period later with the other sign; after a quarter √3/2 of the amplitude, and 0
    assert drifted_readings(errors, 0, 100.0, 1.0, 0.5) == pytest.approx(
        (0.85, 0.5 - np.deg2rad(4.0))
    )
    assert drifted_readings(errors, 0, 50.0, 1.0, 0.5) == pytest.approx(
        (1.0 + 0.3 * np.sqrt(0.75), 0.5)
    )


@pytest.mark.parametrize("constant_bias", ["speed_drift_m_s", "heading_drift_deg"])
def test_one_bias_may_swing_alone(constant_bias: str) -> None:
    errors = errors_with(DRIFTING.model_copy(update={constant_bias: 0.0}))
    speed, heading = drifted_readings(errors, 0, 0.0, 1.0, 0.5)
    assert (speed == 1.0, heading == 0.5) == (
        constant_bias == "speed_drift_m_s",
        constant_bias == "heading_drift_deg",
    )


def test_each_follower_is_ahead_of_the_one_before_by_the_golden_angle() -> None:
    """2π (1 − 1/φ) with φ = (1 + √5)/2: the angle between neighbours in a sunflower."""
    golden = 2 * np.pi * (1 - 2 / (1 + np.sqrt(5)))
    for follower in (1, 2, 5):
        expected = 1.0 + 0.3 * np.sin(np.pi / 6 + 2 * np.pi * 20.0 / 200.0 + follower * golden)
        assert drifted_readings(errors_with(DRIFTING), follower, 20.0, 1.0, 0.5)[
            0
        ] == pytest.approx(expected)


def test_a_motion_is_read_with_the_errors_of_its_instants() -> None:
    scenario = make_scenario().model_copy(update={"sensors": DRIFTING})
    truth = observe(
        make_trajectory((0.0, 40.0, -10.0), follower_velocity=(1.0, 0.0, 0.0)),
        SensingSettings.of(scenario),
    )
    time = 0.1 * np.arange(1, truth.speed.size + 1)
    np.testing.assert_allclose(truth.speed, 1.0 + 0.3 * np.sin(np.pi / 6 + np.pi * time / 100.0))
    np.testing.assert_allclose(
        truth.heading, np.pi / 2 + np.deg2rad(4.0) * np.cos(np.pi * time / 100.0)
    )


def test_the_leaders_position_drifts_towards_a_compass_direction() -> None:
    """By 2 cm/s towards 30°, 1 cm/s east and 1.73 cm/s north, until the message is sent."""
    scenario = make_scenario()
    scenario = scenario.model_copy(update={"sensors": DRIFTING})
    truth = observe(
        make_trajectory((0.0, 40.0, -10.0), leader=(5.0, 6.0, -9.0)), SensingSettings.of(scenario)
    )
    position_error = np.column_stack([truth.sent.east, truth.sent.north]) - [5.0, 6.0]
    np.testing.assert_allclose(
        position_error, truth.sent.timestamp[:, None] * [0.01, 0.01 * np.sqrt(3.0)], atol=1e-12
    )
    assert truth.sent.timestamp[-1] > 5.0
