"""Numbers that README and docs quote of single flights: read off a flight of formulas."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.campaign.montecarlo import CampaignMission, CellSettings
from laisn.arrays import Floats
from sim.flight import FlightRecord
from sim.scenario.sensors import Sensors
from sim.sensing.sensors import tilt_errors
from sim.trajectory import tilted
from tests import synthetic
from tools.documents import flights


def with_position_errors(flight: FlightRecord, errors: Floats) -> FlightRecord:
    """The flight with estimates whose position errors are these, shape (n,), [m]."""
    (estimates,) = flight.estimates
    state = estimates.state.copy()
    state[:, :2] = flight.hydrophone(0)[:, :2] + errors[:, None] * np.array([0.6, -0.8])
    return replace(flight, estimates=(replace(estimates, state=state),))


def test_findings_are_errors_positions_pitch_and_slip_of_each_flight(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The follower is 0.35 rad behind on a circle of 69 m about the centre of the leader's,
    which is 60 m wide.
    """
    flight = synthetic.make_flight(660.0)
    time = flight.trajectory.time[flight.step_index()]
    errors = np.full(time.size, 1.0)
    for peak_time, peak_error in ((469.0, 9.0), (500.0, 2.5), (591.0, 8.0)):
        errors[np.argmin(np.abs(time - peak_time))] = peak_error
    calls = []
    cell = CellSettings.of(flight.scenario)
    _, measured = CampaignMission(cell.motion, flight.trajectory).motion_and_measurements(cell, 0)
    # leaders pitch ever more from flight to flight; that of the following sea by 0.2 rad
    pitched = {
        n: replace(flight, trajectory=tilted(flight.trajectory, 0.1 * n)) for n in range(1, 5)
    }
    inclinometer_errors = tilt_errors(
        pitched[2].trajectory, Sensors(leader_attitude_senses_acceleration=True)
    )[:, 0]

    def load(name: str, settings: Sequence[str]) -> tuple[str, tuple[str, ...]]:
        calls.append((name, tuple(settings)))
        return calls[-1]

    def fly(_: object) -> tuple[FlightRecord, None]:
        errors_by_flight = {1: errors, 2: np.where(np.arange(time.size) % 4 == 0, 5.0, 1.0)}
        return with_position_errors(
            pitched[len(calls)],
            errors_by_flight.get(len(calls), np.full(time.size, float(len(calls)))),
        ), None

    monkeypatch.setattr(flights, "load_scenario", load)
    monkeypatch.setattr(flights, "fly", fly)
    findings = {name: finding.value for name, finding in flights.findings().findings.items()}
    lag, inner, outer = (
        synthetic.LAG_RAD,
        synthetic.LEADER_RADIUS_M,
        synthetic.LEADER_RADIUS_M + synthetic.LANE_M,
    )
    assert findings == pytest.approx(
        {
            "T5 off-axis": 2.5,
            "T5 behind": outer * np.sin(lag),
            "T5 beside": outer * np.cos(lag) - inner,
            "error following-sea": 2.0,
            "error following-sea-ahrs": 3.0,
            "error following-sea-inclinometer": 4.0,
            "pitch following-sea": np.rad2deg(0.2),
            "inclinometer following-sea": np.rad2deg(np.sqrt(np.mean(inclinometer_errors**2))),
            "slip T5": 1e3 * flights.slip(measured),
            "slip following-sea": 1e3 * flights.slip(measured),
        },
        rel=1e-5,
    )
    assert calls == [
        ("T5", ()),
        ("following-sea", ()),
        ("following-sea-ahrs", ()),
        ("following-sea-ahrs", ("sensors.leader_gyro_time_constant_s=0",)),
    ]


def test_slip_is_the_drift_that_log_and_compass_do_not_see() -> None:
    """Nothing along a circle of 50 m at 1 m/s. In a current of 3 cm/s to the east and 4 cm/s to the
    south it is 5 cm/s, which is 5/√2 cm/s along one axis.
    """
    angle = 0.02 * np.arange(0.0, 300.0, 0.1)
    circle = 50.0 * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    drift = np.outer(angle / 0.02, [0.03, -0.04])
    for drift_scale, expected in ((0.0, 0.0), (1.0, 0.05 / np.sqrt(2.0))):
        truth: Any = SimpleNamespace(
            dt=0.1,
            speed=np.ones(angle.size),
            heading=angle,
            hydrophone=np.pad(circle + drift_scale * drift, ((0, 0), (0, 1))),
        )
        assert flights.slip(truth) == pytest.approx(expected, abs=1e-6)
