"""Attitude and speed of LAUV and BlueROV2 in steady motion, against balances of their sources.

The equations of the published models are written anew here, about the centre of gravity, forward,
port and up: six balances of forces and moments in a steady motion of constant depth rate, pitch,
roll and rate of turn, solved for all six at once. No code of `sim` takes part.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import fsolve

from laisn.arrays import Floats
from sim import attitude
from sim.vehicle.effector_kinds import thrust_on_curve
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

G = 9.81


@dataclass(frozen=True)
class Published:
    """A vehicle by its published parameters, about its centre of gravity."""

    mass: float
    inertia: tuple[float, float, float]
    added: tuple[float, ...]
    linear: Floats  # 6×6
    quadratic: Floats  # 6×6
    volume: float
    centre_of_buoyancy: tuple[float, float, float]
    effectors: Callable[[Floats], Floats]  # wrench by velocity (6)

    def imbalance(self, x: Floats, density: float) -> Floats:
        """Sum of all forces and moments, which is zero in a steady motion.

        `x` has velocity in the body (3), roll, pitch (nose up) and the rate of turn about the
        vertical.
        """
        roll, pitch, turn_rate = x[3:]
        # rows: the body's axes in the world (forward, port, up), heading zero
        forward = np.array([np.cos(pitch), 0.0, np.sin(pitch)])
        level_up = np.array([-np.sin(pitch), 0.0, np.cos(pitch)])
        port = np.cos(roll) * np.array([0.0, 1.0, 0.0]) + np.sin(roll) * level_up
        up = np.cross(forward, port)
        vertical = np.array([forward[2], port[2], up[2]])
        nu = np.concatenate([x[:3], turn_rate * vertical])
        momentum = (np.diag([self.mass] * 3 + list(self.inertia)) + np.diag(self.added)) @ nu
        coriolis = np.concatenate(
            [
                np.cross(nu[3:], momentum[:3]),
                np.cross(nu[3:], momentum[3:]) + np.cross(nu[:3], momentum[:3]),
            ]
        )
        buoyancy = density * self.volume * G * vertical
        weight = -self.mass * G * vertical
        restoring = np.concatenate([buoyancy + weight, np.cross(self.centre_of_buoyancy, buoyancy)])
        damping = (self.linear + self.quadratic * np.abs(nu)) @ nu
        return restoring + self.effectors(nu) - damping - coriolis


def steady(vehicle: Published, guess: Floats, density: float) -> Floats:
    """The steady motion nearest to a guess, as `x` of `imbalance`."""
    solution, _, status, message = fsolve(
        vehicle.imbalance, guess, args=(density,), full_output=True
    )
    assert status == 1, message
    return np.asarray(solution)


def motion(plant: Plant) -> Floats:
    """Velocity in the body, roll and pitch [rad] and rate of turn about the vertical."""
    to_world = np.array(attitude.rotation(plant.pose[0, 3:]))
    roll = np.arctan2(to_world[2, 1], to_world[2, 2])
    pitch = np.arcsin(to_world[2, 0])
    turn_rate = (to_world @ plant.twist[0, 3:])[2]
    return np.array([*(to_world.T @ plant.twist[0, :3]), roll, pitch, turn_rate])


def plant_after(
    model: str, command: Floats, seconds: float, density: float, speed: float = 0.0
) -> Plant:
    """A vehicle deep below the surface after a time under a constant command."""
    setup = VehicleSetup(name="v", model=model, position_m=(0.0, 0.0, -400.0), speed_m_s=speed)
    plant = Plant([setup], Ocean(density_kg_m3=density, floor_depth_m=1000.0))
    plant.step(command[None], round(seconds / plant.dt))
    return plant


# uuvsimulator/lauv_gazebo, lauv_description/urdf: base, gazebo, snippets and actuators.xacro
LAUV_FINS = (
    ((-0.4, 0.0, 0.04), (0.0, 1.0, 0.0)),
    ((-0.4, 0.0, -0.04), (0.0, 1.0, 0.0)),
    ((-0.4, 0.04, 0.0), (0.0, 0.0, 1.0)),
    ((-0.4, -0.04, 0.0), (0.0, 0.0, 1.0)),
)


def lauv(thrust: float, rudder: float, plane: float, density: float) -> Published:
    """LAUV with a thrust [N] and deflections of rudders and planes [rad]."""
    linear = np.diag([2.4, 23.0, 23.0, 0.3, 9.7, 9.7])
    quadratic = np.diag([2.4, 80.0, 80.0, 0.0006, 9.1, 9.1])
    for matrix, (force, moment) in ((linear, (11.5, 3.1)), (quadratic, (0.3, 1.5))):
        matrix[1, 5] = -force
        matrix[2, 4] = force
        matrix[4, 2] = -moment
        matrix[5, 1] = moment

    def effectors(nu: Floats) -> Floats:
        total = np.array([thrust, 0.0, 0.0, 0.0, 0.0, 0.0])
        for (position, axis), angle in zip(LAUV_FINS, (rudder, rudder, plane, plane), strict=True):
            local = nu[:3] + np.cross(nu[3:], position)
            across = float(local @ axis)
            incidence = angle - np.arctan2(across, local[0])
            square = local[0] ** 2 + across**2
            lift = 0.5 * density * 0.0064 * 3.0 * square * np.sin(incidence) * np.cos(incidence)
            force = lift * (np.cos(angle) * np.array(axis) - np.sin(angle) * np.eye(3)[0])
            total += np.concatenate([force, np.cross(position, force)])
        return total

    return Published(
        mass=18.0,
        inertia=(0.050625, 1.77491, 1.77491),
        added=(1.0, 16.0, 16.0, 0.005, 1.3, 1.3),
        linear=linear,
        quadratic=quadratic,
        volume=0.017551375,
        centre_of_buoyancy=(0.0, 0.0, 0.01),
        effectors=effectors,
    )


@pytest.mark.parametrize(
    ("thrust", "rudder", "plane"), [(10.0, 0.1, 0.0), (20.0, 0.2, 0.0), (10.0, 0.0, 0.03)]
)
def test_lauv_turns_and_climbs_with_the_attitude_of_its_source(
    thrust: float, rudder: float, plane: float
) -> None:
    density = 1028.0
    plant = plant_after(
        "lauv", np.array([thrust, rudder, rudder, plane, plane]), 90.0, density, 1.2
    )
    simulated = motion(plant)
    published = steady(lauv(thrust, rudder, plane, density), simulated, density)
    np.testing.assert_allclose(simulated, published, atol=2e-3)


# von Benzon et al. 2022, Table A1: positions from the centre of gravity, here with port and up
BLUEROV_POSITIONS = np.array(
    [
        (0.156, -0.111, -0.085),
        (0.156, 0.111, -0.085),
        (-0.156, -0.111, -0.085),
        (-0.156, 0.111, -0.085),
        (0.12, -0.218, 0.0),
        (0.12, 0.218, 0.0),
        (-0.12, -0.218, 0.0),
        (-0.12, 0.218, 0.0),
    ]
)
SQRT_HALF = np.sqrt(0.5)
BLUEROV_AXES = np.array(
    [
        [SQRT_HALF, SQRT_HALF, 0],
        [SQRT_HALF, -SQRT_HALF, 0],
        [-SQRT_HALF, SQRT_HALF, 0],
        [-SQRT_HALF, -SQRT_HALF, 0],
    ]
    + [[0, 0, 1]] * 4
)


def polynomial(voltage: Floats) -> Floats:
    """Published thrust of a thruster [N] by its voltage, from −1 to 1."""
    return np.asarray(
        -140.3 * voltage**9
        + 389.9 * voltage**7
        - 404.1 * voltage**5
        + 176.0 * voltage**3
        + 8.9 * voltage
    )


def bluerov(voltages: Floats) -> Published:
    """BlueROV2 Heavy with voltages of its eight thrusters."""
    force = polynomial(voltages)[:, None] * BLUEROV_AXES
    wrench = np.concatenate([force.sum(axis=0), np.cross(BLUEROV_POSITIONS, force).sum(axis=0)])
    return Published(
        mass=13.5,
        inertia=(0.26, 0.23, 0.37),
        added=(6.36, 7.12, 18.68, 0.189, 0.135, 0.222),
        linear=np.diag([13.7, 0.0, 33.0, 0.0, 0.8, 0.0]),
        quadratic=np.diag([141.0, 217.0, 190.0, 1.19, 0.47, 1.5]),
        volume=0.0134,
        centre_of_buoyancy=(0.0, 0.0, 0.01),
        effectors=lambda _: wrench,
    )


def test_thrust_of_the_bluerov_is_that_of_the_published_polynomial() -> None:
    """Between 0.1 and 1 of its voltage within 1 %, and exact at a quarter."""
    thruster = plant_after("bluerov2_heavy", np.zeros(8), 0.02, 1000.0).effectors.view(np.recarray)[
        0, 0
    ]
    for voltage in (-1.0, -0.25, 0.25, 1.0):
        exact = float(polynomial(np.array(voltage)))
        assert thrust_on_curve(thruster, voltage) == pytest.approx(exact, abs=1e-3)
    for voltage in np.linspace(0.1, 1.0, 181):
        exact = float(polynomial(np.array(voltage)))
        assert thrust_on_curve(thruster, voltage) == pytest.approx(exact, rel=0.01)
        assert thrust_on_curve(thruster, -voltage) == pytest.approx(-exact, rel=0.01)


AHEAD = np.array([1.0, 1.0, -1.0, -1.0, 0.0, 0.0, 0.0, 0.0])
ASIDE = np.array([-1.0, 1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("direction", "voltage", "angle"),
    [(AHEAD, 0.25, 4), (ASIDE, 0.25, 3), (AHEAD, 0.1, 4), (ASIDE, 0.1, 3)],
    ids=["surge", "sway", "surge slowly", "sway slowly"],
)
def test_bluerov_leans_as_the_statics_of_its_source(
    direction: Floats, voltage: float, angle: int
) -> None:
    """Mean of two minutes: in sway at a quarter of the voltage it never stops rolling, as the
    published model has no damping of roll that is linear in its rate.
    """
    density = 1000.0
    command = voltage * direction
    plant = plant_after("bluerov2_heavy", command, 120.0, density)
    motions = []
    for _ in range(240):
        plant.step(command[None], 25)
        motions.append(motion(plant))
    mean_motion = np.mean(motions, axis=0)
    published = steady(bluerov(command), mean_motion, density)
    np.testing.assert_allclose(mean_motion, published, atol=0.02)
    # by statics alone, 57° at a quarter: thrusters 0.085 m below the centre of gravity against
    # buoyancy 0.01 m above it; Munk's moment adds some degrees
    moment = 4 * SQRT_HALF * float(polynomial(np.array(voltage))) * 0.085
    lean = np.arcsin(moment / (density * 0.0134 * G * 0.01))
    assert abs(mean_motion[angle]) == pytest.approx(lean, abs=0.08)
