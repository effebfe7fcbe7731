"""Hulls in ideal water: added mass, its Coriolis and Munk terms, weight and buoyancy, without
any drag.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from laisn.arrays import Floats
from sim import attitude
from sim.water.ocean import Ocean
from tests.sim.vehicle.tank import Tank, hull

G = 9.81


def skew(a: Floats) -> Floats:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def euler_rotation(q: Floats) -> Floats:
    return attitude.rotate(q[None, :], np.eye(3)).T


@dataclass(frozen=True)
class Kirchhoff:
    """A neutral hull in unbounded ideal water at rest, written out in the body frame (Lamb
    1932).
    """

    mass: float
    inertia: Floats
    cg: Floats
    added: Floats

    @property
    def total(self) -> Floats:
        s = skew(self.cg)
        m = self.mass
        rigid = np.block([[m * np.eye(3), -m * s], [m * s, np.diag(self.inertia) - m * s @ s]])
        return rigid + self.added

    def acceleration(self, q: Floats, nu: Floats, wrench: Floats) -> Floats:
        """Rate of change of velocity and angular velocity in the body, from the rate of change of
        the momentum, the couple of the weight and another wrench.
        """
        p = self.total @ nu
        v, w = nu[:3], nu[3:]
        up = euler_rotation(q)[2]
        force = -np.cross(w, p[:3])
        moment = -np.cross(w, p[3:]) - np.cross(v, p[:3]) + np.cross(self.cg, -self.mass * G * up)
        return np.asarray(np.linalg.solve(self.total, np.concatenate([force, moment]) + wrench))

    def rate(self, _: float, state: Floats) -> Floats:
        """Rate of change of position, quaternion and twist in the body."""
        q, nu = state[3:7] / np.linalg.norm(state[3:7]), state[7:]
        spin = np.concatenate([[0.0], nu[3:]])
        w, x = q[0], q[1:]
        q_rate = 0.5 * np.concatenate([[-x @ spin[1:]], w * spin[1:] + np.cross(x, spin[1:])])
        return np.concatenate(
            [euler_rotation(q) @ nu[:3], q_rate, self.acceleration(q, nu, np.zeros(6))]
        )

    def energy(self, state: Floats) -> float:
        """Kinetic energy of hull and water, and potential energy of the centre of gravity [J]."""
        height = (euler_rotation(state[3:7] / np.linalg.norm(state[3:7])) @ self.cg)[2]
        return float(0.5 * state[7:] @ self.total @ state[7:] + self.mass * G * height)


def random_hull(seed: int) -> Kirchhoff:
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(6, 6))
    added = factor @ factor.T + np.diag([2.0, 60, 60, 0.2, 11, 11])
    # MuJoCo requires the triangle inequality of principal inertias
    return Kirchhoff(
        67.0,
        np.array([2.0, 13.0, 13.5]),
        rng.uniform(-0.05, 0.05, 3),
        np.round((added + added.T) / 2, 9),
    )


@pytest.mark.parametrize("seed", range(8))
def test_acceleration_is_kirchhoffs(seed: int) -> None:
    ideal = random_hull(seed)
    rng = np.random.default_rng(100 + seed)
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    nu, wrench = rng.normal(size=6), 50 * rng.normal(size=6)
    rotation = euler_rotation(q)
    # a thruster's gear is a direction, whatever its length, and the command is the force [N]
    thrust = np.linalg.norm(wrench[:3])
    thrusters = np.vstack([wrench / thrust, np.zeros((4, 6))])
    body = hull(ideal.mass, ideal.inertia, ideal.cg, added_mass=ideal.added)
    tank = Tank(body, Ocean(), 1e-3, thrusters=thrusters)
    tank.place([3, -4, -50], q, [*rotation @ nu[:3], *nu[3:]])
    expected = ideal.acceleration(q, nu, wrench)
    # the acceleration of a point in the world, from components in a turning frame
    world = rotation @ (expected[:3] + np.cross(nu[3:], nu[:3]))
    np.testing.assert_allclose(
        tank.acceleration([thrust, 0, 0, 0, 0]), [*world, *expected[3:]], rtol=1e-9, atol=1e-9
    )


def test_motion_without_drag_keeps_energy_and_follows_an_independent_integration() -> None:
    ideal = random_hull(3)
    q = attitude.from_euler(0.4, 0.2, 0.1)
    nu = np.array([1.5, 0.2, -0.1, 0.1, -0.15, 0.2])
    start = np.concatenate([[0, 0, -50], q, nu])
    duration = 5.0
    reference = solve_ivp(ideal.rate, (0, duration), start, rtol=1e-10, atol=1e-12).y[:, -1]
    assert ideal.energy(reference) == pytest.approx(ideal.energy(start), rel=1e-8)

    deviations, drifts = [], []
    for dt in (8e-3, 4e-3, 2e-3):
        tank = Tank(hull(ideal.mass, ideal.inertia, ideal.cg, added_mass=ideal.added), Ocean(), dt)
        tank.place(start[:3], q, [*euler_rotation(q) @ nu[:3], *nu[3:]])
        tank.step(n=round(duration / dt))
        deviations.append(np.concatenate([tank.pose, tank.body_velocity]) - reference)
        drifts.append(ideal.energy(deviations[-1] + reference) - ideal.energy(start))
    errors = [np.abs(e).max() for e in deviations]
    # of second order: half the step has a quarter of the error
    for coarse, fine in [*pairwise(errors), *pairwise(drifts)]:
        assert fine == pytest.approx(coarse / 4, rel=0.1)
    assert abs(drifts[-1]) < 1e-5 * ideal.energy(start)


SPHEROID_ADDED = np.diag([3.731, 89.770, 89.770, 0.0, 15.690, 15.690])
"""Potential flow about a prolate spheroid 2.0 m × 0.30 m in water of 1026 kg/m³ (Lamb 1932)."""
SPHEROID_MASS, SPHEROID_INERTIA = 96.698, np.array([0.87028, 19.77479, 19.77479])


@pytest.mark.parametrize(
    ("thrust", "axis", "expected"),
    [
        ([100, 0, 0, 0, 0], 0, 0.996),
        ([0, 100, 0, 0, 0], 1, 0.536),
        ([0, 0, 100, 0, 0], 2, 0.536),
        ([0, 0, 0, 0, 10], 5, 0.282),
    ],
)
def test_spheroid_accelerates_as_potential_flow_has_it(
    thrust: list[float], axis: int, expected: float
) -> None:
    """Force over mass and added mass, or moment over inertia and added inertia."""
    tank = Tank(hull(SPHEROID_MASS, SPHEROID_INERTIA, added_mass=SPHEROID_ADDED), Ocean(), 0.02)
    assert tank.acceleration(thrust)[axis] == pytest.approx(expected, abs=5e-4)


def test_righting_moment_is_weight_times_arm() -> None:
    tank = Tank(
        hull(SPHEROID_MASS, SPHEROID_INERTIA, (0, 0, -0.02), added_mass=SPHEROID_ADDED),
        Ocean(),
        0.02,
    )
    tank.place(quaternion=attitude.from_euler(0.0, np.radians(30)))
    # nose up by 30°: weight and buoyancy turn it down, and an opposite couple holds it there
    moment = SPHEROID_MASS * G * 0.02 * np.sin(np.radians(30))
    acceleration = tank.acceleration([0, 0, 0, -moment, 0])
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-12)


def _small_oscillation_period(mass: float, inertia: float, added: Floats, arm: float) -> float:
    """Pitch about a low centre of gravity, of a hull that is free to surge: the coupling of surge
    and pitch in the mass matrix lessens the inertia.
    """
    coupled = inertia + mass * arm**2 + added[4, 4] - (mass * arm) ** 2 / (mass + added[0, 0])
    return float(2 * np.pi * np.sqrt(coupled / (mass * G * arm)))


def test_hull_rights_itself_at_the_pendulum_period() -> None:
    arm = 0.02
    tank = Tank(
        hull(SPHEROID_MASS, SPHEROID_INERTIA, (0, 0, -arm), added_mass=SPHEROID_ADDED),
        Ocean(),
        0.002,
    )
    tank.place(quaternion=attitude.from_euler(0.0, np.radians(1)))
    crossing_times: list[float] = []
    previous = 1.0
    while len(crossing_times) < 3:
        tank.step()
        pitch = float(attitude.heading_pitch_roll(tank.pose[3:])[1])
        if previous > 0 >= pitch:
            crossing_times.append(tank.data.time - tank.plant.dt * pitch / (pitch - previous))
        previous = pitch
    expected = _small_oscillation_period(SPHEROID_MASS, SPHEROID_INERTIA[1], SPHEROID_ADDED, arm)
    assert np.diff(crossing_times).mean() == pytest.approx(expected, rel=1e-3)
