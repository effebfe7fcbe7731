"""The hull of a REMUS 100 against the figures of Fossen's published simulator.

Propeller and fins are written here from the formulas that he prints (Fossen 2021; Allen et al. 2000), in
his frame (x forward, y starboard, z down), and turned into ours.
"""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from sim.geometry import attitude
from sim.water.ocean import Ocean
from tests.vehicle.tank import Tank

Floats = npt.NDArray[np.float64]
XML = Path(__file__).with_name("remus100.xml").read_text()
DT = 0.02
RHO = 1026.0
TO_OURS = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Forward-starboard-down to forward-port-up, for velocities and wrenches alike."""


def propeller(rps: float, speed: float) -> tuple[float, float]:
    """Thrust [N] and torque on the hull [N m]: KT and KQ fall linearly with the advance number from 0 to 0.6632."""
    diameter, advance_max = 0.14, 0.6632
    advance = 0.944 * speed / (diameter * rps) if rps > 0 else 0.0
    thrust = 0.4566 + (0.1798 - 0.4566) * advance / advance_max
    torque = 0.0700 + (0.0312 - 0.0700) * advance / advance_max
    return RHO * diameter**4 * rps**2 * thrust, RHO * diameter**5 * rps**2 * torque


def wrench(nu: Floats, rps: float, rudder: float, stern_plane: float) -> Floats:
    """Of propeller and fins, in our body frame, from the velocity in Fossen's."""
    u, v, w = nu[:3]
    thrust, torque = propeller(rps, float(np.sqrt(u * u + v * v + w * w)))
    fin_area, x_fin = 2 * 0.00665, -0.8
    side = 0.5 * RHO * (u * u + v * v) * fin_area * 0.5
    up = 0.5 * RHO * (u * u + w * w) * fin_area * 0.7
    surge = (1 - 0.1) * thrust - side * rudder**2 - up * stern_plane**2
    sway, heave = -side * rudder, -up * stern_plane
    # the roll moment is a tenth of the propeller's torque, as measured at sea
    return TO_OURS * np.array([surge, sway, heave, torque / 10, -x_fin * heave, x_fin * sway])


def run(rpm: float, duration: float, rudder_deg: float = 0.0, stern_plane_deg: float = 0.0) -> tuple[Tank, Floats]:
    """From rest; returns the tank at the end and the velocity over time in Fossen's body frame, shape (n, 6)."""
    tank = Tank(XML, Ocean.calm(), DT)
    tank.pose[0, 2] = -500
    rps, rudder, plane = 0.0, 0.0, 0.0
    history = []
    for _ in range(round(duration / DT)):
        nu = TO_OURS * tank.body_velocity
        history.append(nu)
        tank.step(wrench(nu, rps, rudder, plane))
        # lags: 1 s of the propeller, 0.1 s of the fins
        rps += DT * (rpm / 60 - rps) / 1.0
        rudder += DT * (np.radians(rudder_deg) - rudder) / 0.1
        plane += DT * (np.radians(stern_plane_deg) - plane) / 0.1
    return tank, np.array(history)


@pytest.mark.parametrize(
    ("rpm", "speed", "rise"),
    [
        (300, 0.4860, 5.08),
        (500, 0.8314, 3.66),
        (750, 1.2542, 2.90),
        (1000, 1.6741, 2.50),
        (1250, 2.0930, 2.26),
        (1525, 2.5536, 2.06),
    ],
)
def test_speed_and_its_rise(rpm: float, speed: float, rise: float) -> None:
    """The rise to 1 − 1/e of the final speed, from rest, as Fossen's code has it when stepped by 0.02 s as well."""
    _, history = run(rpm, 100.0)
    u = history[:, 0]
    assert u[-1] == pytest.approx(speed, rel=1e-3)
    reached = DT * int(np.argmax(u >= (1 - np.exp(-1)) * u[-1]))
    assert reached == pytest.approx(rise, abs=DT)


@pytest.mark.parametrize(
    ("rudder", "rpm", "rate", "radius"),
    [
        (5, 1000, 2.092, 45.7),
        (10, 1000, 3.488, 27.2),
        (15, 1000, 4.644, 20.3),
        (5, 1525, 3.609, 40.4),
        (10, 1525, 5.894, 24.6),
        (15, 1525, 7.767, 18.5),
    ],
)
def test_turn_rate_and_radius(rudder: float, rpm: float, rate: float, radius: float) -> None:
    _, history = run(rpm, 200.0, rudder_deg=rudder)
    turning = abs(history[-1, 5])
    assert np.degrees(turning) == pytest.approx(rate, rel=2e-3)
    assert np.linalg.norm(history[-1, :3]) / turning == pytest.approx(radius, rel=4e-3)


@pytest.mark.parametrize(("rpm", "pitch"), [(1000, 8.80), (1525, 20.86)])
def test_pitch_under_stern_planes(rpm: float, pitch: float) -> None:
    tank, _ = run(rpm, 200.0, stern_plane_deg=-5)
    assert abs(np.degrees(float(attitude.pitch(tank.pose[0, 3:])))) == pytest.approx(pitch, abs=0.02)
