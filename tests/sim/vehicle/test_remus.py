"""The hull of a REMUS 100 against the figures of Fossen's published simulator.

Propeller and fins are written here from the formulas that he prints (Fossen 2021; Allen et al.
2000), in his frame (x forward, y starboard, z down), and turned into ours.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from laisn.arrays import Floats
from sim import attitude
from sim.water.ocean import Ocean
from tests.sim.vehicle.tank import Tank

XML = Path(__file__).with_name("remus100.xml").read_text()
DT = 0.02
RHO = 1026.0
TO_OURS = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Forward-starboard-down to forward-port-up, for velocities and wrenches alike."""


def propeller(rps: float, speed: float) -> tuple[float, float]:
    """Thrust [N] and torque on the hull [N m]: KT and KQ fall linearly with the advance number
    from 0 to 0.6632.
    """
    diameter, advance_max = 0.14, 0.6632
    advance = 0.944 * speed / (diameter * rps) if rps > 0 else 0.0
    thrust = 0.4566 + (0.1798 - 0.4566) * advance / advance_max
    torque = 0.0700 + (0.0312 - 0.0700) * advance / advance_max
    return RHO * diameter**4 * rps**2 * thrust, RHO * diameter**5 * rps**2 * torque


FIN_X_M = -0.8
THRUSTERS = np.array(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 0, 0, 1, 0, 0],
        [0, 1, 0, 0, 0, FIN_X_M],
        [0, 0, 1, 0, -FIN_X_M, 0],
        [0] * 6,
    ]
)
"""Forces and moments in our body frame: the propeller's thrust and torque, the lift of rudder
and stern plane.
"""


def thrusts_of(nu: Floats, rps: float, rudder: float, stern_plane: float) -> Floats:
    """Forces of propeller and fins, from the velocity in Fossen's frame, shape (5,)."""
    u, v, w = nu[:3]
    thrust, torque = propeller(rps, float(np.sqrt(u * u + v * v + w * w)))
    fin_area = 2 * 0.00665
    rudder_force_scale = 0.5 * RHO * (u * u + v * v) * fin_area * 0.5
    plane_force_scale = 0.5 * RHO * (u * u + w * w) * fin_area * 0.7
    surge = (1 - 0.1) * thrust - rudder_force_scale * rudder**2 - plane_force_scale * stern_plane**2
    # fins lift to starboard and down in Fossen's frame, with a minus; the roll moment is a tenth of
    # the propeller's torque, as measured at sea
    return np.array(
        [surge, torque / 10, rudder_force_scale * rudder, plane_force_scale * stern_plane, 0.0]
    )


def run(
    rpm: float,
    duration: float,
    rudder_deg: float = 0.0,
    stern_plane_deg: float = 0.0,
    dt: float = DT,
) -> tuple[Tank, Floats]:
    """Start from rest; returns the tank at the end and the velocity over time in Fossen's body
    frame, shape (n, 6).
    """
    tank = Tank(XML, Ocean(), dt, thrusters=THRUSTERS)
    tank.place([0, 0, -500])
    # response to the commands of the start by first-order lags: 1 s of the propeller, 0.1 s of the
    # fins
    time = dt * np.arange(round(duration / dt))
    rps, fins = rpm / 60 * -np.expm1(-time), -np.expm1(-time / 0.1)
    rudder, plane = np.radians(rudder_deg) * fins, np.radians(stern_plane_deg) * fins
    history = np.empty((time.size, 6))
    for k in range(time.size):
        history[k] = TO_OURS * tank.body_velocity
        tank.step(thrusts_of(history[k], rps[k], rudder[k], plane[k]))
    return tank, history


@pytest.mark.parametrize(
    ("rpm", "published_speed", "published_rise"),
    [
        (300, 0.4860, 5.08),
        (500, 0.8314, 3.66),
        (750, 1.2542, 2.90),
        (1000, 1.6741, 2.50),
        (1250, 2.0930, 2.26),
        (1525, 2.5536, 2.06),
    ],
)
def test_final_speed_and_rise_time_are_those_published(
    rpm: float, published_speed: float, published_rise: float
) -> None:
    """The rise time from rest to 1 − 1/e of the final speed is that of the equation of surge; the
    published one is the first step beyond it of Euler's method with 0.02 s.

    The hull also pitches a little as it speeds up, which the equation of surge leaves out.
    """

    def surge_rate(_: float, state: Floats) -> Floats:
        u, rps = state
        drag = 0.5 * RHO * 0.2128 * 0.055959619 * u * u + 1.5934 * np.exp(-3 * u) * u
        return np.array(
            [(0.9 * propeller(rps, u)[0] - drag) / (31.029384976 + 0.83890859334), rpm / 60 - rps]
        )

    risen_speed = (1 - np.exp(-1)) * published_speed
    _, history = run(rpm, 100.0)
    u = history[:, 0]
    assert u[-1] == pytest.approx(published_speed, rel=1e-3)
    k = int(np.argmax(u >= risen_speed))
    rise_time = DT * (k - (u[k] - risen_speed) / (u[k] - u[k - 1]))
    surge_solution = solve_ivp(
        surge_rate, (0, 20), [0, 0], rtol=1e-10, atol=1e-12, dense_output=True
    ).sol
    assert rise_time == pytest.approx(
        brentq(lambda t: surge_solution(t)[0] - risen_speed, 0.1, 20), abs=1e-3
    )

    state, steps = np.zeros(2), 0
    while state[0] < risen_speed:
        state, steps = state + DT * surge_rate(0.0, state), steps + 1
    assert steps * DT == pytest.approx(published_rise, abs=1e-9)


@pytest.mark.system
@pytest.mark.parametrize(
    ("rudder", "rpm", "published_deg_s", "published_m"),
    [
        (5, 1000, 2.092, 45.7),
        (10, 1000, 3.488, 27.2),
        (15, 1000, 4.644, 20.3),
        (5, 1525, 3.609, 40.4),
        (10, 1525, 5.894, 24.6),
        (15, 1525, 7.767, 18.5),
    ],
)
def test_turn_rate_and_radius_are_those_published(
    rudder: float, rpm: float, published_deg_s: float, published_m: float
) -> None:
    _, history = run(rpm, 200.0, rudder_deg=rudder)
    turn_rate = abs(history[-1, 5])
    assert np.degrees(turn_rate) == pytest.approx(published_deg_s, rel=2e-3)
    assert np.linalg.norm(history[-1, :3]) / turn_rate == pytest.approx(published_m, rel=4e-3)


@pytest.mark.parametrize(("rpm", "published_deg"), [(1000, 8.80), (1525, 20.86)])
def test_pitch_under_stern_planes_is_that_published(rpm: float, published_deg: float) -> None:
    tank, _ = run(rpm, 200.0, stern_plane_deg=-5)
    assert abs(np.degrees(float(attitude.heading_pitch_roll(tank.pose[3:])[1]))) == pytest.approx(
        published_deg, abs=0.02
    )


def test_a_manoeuvre_is_of_second_order_in_the_step() -> None:
    """Propeller, rudder and stern plane at once, for 20 s; steps of 5 ms stand for the limit."""
    coarse, middle, fine = (
        run(1525, 20.0, 10, -3, dt)[0].pose[:3].copy() for dt in (0.04, 0.02, 0.005)
    )
    errors = [np.linalg.norm(p - fine) for p in (coarse, middle)]
    assert errors[0] < 0.05
    assert errors[1] == pytest.approx(
        errors[0] * (0.02**2 - 0.005**2) / (0.04**2 - 0.005**2), rel=0.1
    )
