"""Numbers that docs quote of the hulls' trials: read off motions whose figures are known."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from reports.findings import read_findings
from sim import attitude
from tests.sim.vehicle import test_remus as remus
from tests.sim.vehicle.test_hydrodynamics_kirchhoff import (
    SPHEROID_ADDED,
    SPHEROID_INERTIA,
    SPHEROID_MASS,
)
from tools.documents import hull_trials
from tools.documents.markers import RECORDS
from tools.documents.physics import PUBLISHED_SPEED, PUBLISHED_TURN

LAG_S = dict(zip(PUBLISHED_SPEED, (6.013, 5.0, 4.0, 3.0, 2.5, 2.007), strict=True))
"""Time constants [s] of the surge of known motions, by propeller speed; some lie between two
instants of the history."""


def known_motion(
    rpm: float, duration: float, rudder_deg: float = 0.0, stern_plane_deg: float = 0.0
) -> tuple[Any, Floats]:
    """A hull that speeds up as 1 − exp(−t / T), turns 2 % too quickly, or pitches by a
    ten-thousandth of its speed.
    """
    history = np.zeros((round(duration / remus.DT), 6))
    time = remus.DT * np.arange(len(history))
    history[:, 0] = PUBLISHED_SPEED[round(rpm)] * -np.expm1(-time / LAG_S[round(rpm)])
    pitch = 0.0
    if rudder_deg:
        history[:, 0], history[:, 1] = 0.6 * rpm / 1000.0, -0.8 * rpm / 1000.0
        rate_factor = 1.02 if rudder_deg == 10 else 0.99
        history[:, 5] = -np.deg2rad(rate_factor * PUBLISHED_TURN[round(rpm)][round(rudder_deg)])
    if stern_plane_deg:
        assert stern_plane_deg == -5.0
        pitch = -np.deg2rad(rpm / 100.0)
    return SimpleNamespace(pose=np.r_[np.zeros(3), attitude.from_euler(1.0, pitch)]), history


def test_trials_are_read_as_speeds_rises_turns_and_pitch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remus, "run", known_motion)
    actual = {name: finding.value for name, finding in hull_trials._remus().items()}
    for rpm, speed in PUBLISHED_SPEED.items():
        # after 100 s nothing is left of the lag but exp(−100 / T) of the slowest
        assert actual[f"speed {rpm}"] == pytest.approx(speed, abs=1e-4)
    assert (actual["rise slowest"], actual["rise quickest"]) == pytest.approx(
        (6.013, 2.007), abs=1e-4
    )
    assert actual["turn apart"] == pytest.approx(0.02)
    # the slowest and the quickest turn, at 1 m/s and 1.525 m/s
    radii = [
        rpm / 1000.0 / np.deg2rad((1.02 if rudder == 10 else 0.99) * rate)
        for rpm, turns in PUBLISHED_TURN.items()
        for rudder, rate in turns.items()
    ]
    assert (actual["radius largest"], actual["radius least"]) == pytest.approx(
        (max(radii), min(radii)), rel=1e-5
    )
    assert (actual["pitch 1000"], actual["pitch 1525"]) == pytest.approx((10.0, 15.25))


def test_the_righting_period_is_that_of_the_closed_form() -> None:
    """A hull of mass m and moment of inertia I about its middle, with its centre of gravity h
    below, that is free to surge.

    By the linearised equations of surge and pitch, the inertia I + m h² + A55 − (m h)² / (m + A11)
    swings under the stiffness m g h.
    """
    arm = 0.02
    inertia = SPHEROID_INERTIA[1] + SPHEROID_MASS * arm**2 + SPHEROID_ADDED[4, 4]
    inertia -= (SPHEROID_MASS * arm) ** 2 / (SPHEROID_MASS + SPHEROID_ADDED[0, 0])
    period = 2 * np.pi * np.sqrt(inertia / (SPHEROID_MASS * 9.81 * arm))
    assert hull_trials._righting(0.02).value == pytest.approx(period, rel=1e-3)


RECORDED = read_findings(RECORDS / "hull-trials.json")


def test_estimates_of_the_record_are_those_of_this_code() -> None:
    estimates = hull_trials._estimates()
    assert {*estimates} == {name for name in RECORDED.findings if name.startswith("estimate ")}
    for name, finding in estimates.items():
        assert finding.value == pytest.approx(RECORDED[name].value, rel=1e-9), name


@pytest.mark.long
def test_motions_of_the_record_are_those_of_this_code() -> None:
    """A hundred seconds of Fossen's model, term by term, beside ours."""
    motions = hull_trials._fossen()
    prefixes = {f"remus {name} " for name in ("ours", *hull_trials.REMUS_TERMS)}
    assert {*motions} == {
        name for name in RECORDED.findings if any(name.startswith(prefix) for prefix in prefixes)
    }
    for name, finding in motions.items():
        # Fossen's model is integrated to 1e-7 of its states: processors differ by 1e-9 m in how far
        # a path is apart after 140 m
        assert finding.value == pytest.approx(RECORDED[name].value, rel=1e-6, abs=1e-8), name


@pytest.mark.long
@pytest.mark.system
def test_vehicles_of_the_record_are_those_of_this_code() -> None:
    """The BlueROV2 at full thrust, and how the shipped vehicles keep routes and stations."""
    vehicles = hull_trials._vehicles()
    assert len(vehicles) > 30
    for name, finding in vehicles.items():
        assert finding.value == pytest.approx(RECORDED[name].value, rel=1e-6), name
