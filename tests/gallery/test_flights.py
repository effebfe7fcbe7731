"""Numbers that README and docs quote of single flights: read off a flight of formulas."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from experiments.gallery import flights
from laisn.arrays import Floats
from sim.flight import Flight
from tests import synthetic


def off_by(flight: Flight, error: Floats) -> Flight:
    """The flight with an estimate that is so far off, shape (n,), [m]."""
    (estimates,) = flight.estimates
    state = estimates.state.copy()
    state[:, :2] = flight.hydrophone(0)[:, :2] + error[:, None] * np.array([0.6, -0.8])
    return replace(flight, estimates=(replace(estimates, state=state),))


def test_flights_are_told_by_errors_and_places(monkeypatch: pytest.MonkeyPatch) -> None:
    """The follower is 0.35 rad behind on a circle of 69 m about the centre of the leader's, which is 60 m wide."""
    whole = synthetic.make_flight(660.0)
    time = whole.trajectory.time[whole.step_index()]
    error = np.full(time.size, 1.0)
    for at, peak in ((469.0, 9.0), (500.0, 2.5), (591.0, 8.0)):
        error[np.argmin(np.abs(time - at))] = peak
    asked = []

    def load(name: str, settings: Sequence[str]) -> tuple[str, tuple[str, ...]]:
        asked.append((name, tuple(settings)))
        return asked[-1]

    def fly(_: object) -> tuple[Flight, None]:
        sizes = {1: error, 2: np.where(np.arange(time.size) % 4 == 0, 5.0, 1.0)}
        return off_by(whole, sizes.get(len(asked), np.full(time.size, float(len(asked))))), None

    monkeypatch.setattr(flights, "load", load)
    monkeypatch.setattr(flights, "fly", fly)
    found = {name: finding.value for name, finding in flights.findings().findings.items()}
    lag, inner, outer = synthetic.LAG_RAD, synthetic.LEADER_RADIUS_M, synthetic.LEADER_RADIUS_M + synthetic.LANE_M
    assert found == pytest.approx(
        {
            "T5 off-axis": 2.5,
            "T5 behind": outer * np.sin(lag),
            "T5 beside": outer * np.cos(lag) - inner,
            "error following-sea": 2.0,
            "error following-sea-ahrs": 3.0,
            "error following-sea-inclinometer": 4.0,
        },
        rel=1e-5,
    )
    assert asked == [
        ("T5", ()), ("following-sea", ()), ("following-sea-ahrs", ()),
        ("following-sea-ahrs", ("sensors.leader_gyro_time_constant_s=0",)),
    ]  # fmt: skip
