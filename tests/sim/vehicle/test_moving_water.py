"""Forces of currents and waves on hulls: acceleration and shear of the water, orbits, slopes."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import models
from laisn.arrays import Floats
from sim import attitude
from sim.water.ocean import Ocean
from sim.water.waves import Waves
from tests.sim.vehicle.tank import Tank, hull

G = 9.81

SPHERE_RADIUS = 0.2
SPHERE_DISPLACED = 1026 * 4 / 3 * np.pi * SPHERE_RADIUS**3
SPHERE = hull(
    SPHERE_DISPLACED,
    np.full(3, 0.4 * SPHERE_DISPLACED * SPHERE_RADIUS**2),
    added_mass=np.diag([SPHERE_DISPLACED / 2] * 3 + [0.0] * 3),
    hull_radius=SPHERE_RADIUS,
)
"""Neutral; it adds half of what it displaces (Lamb 1932)."""


def test_drifting_with_a_uniform_current_there_is_exactly_no_force() -> None:
    ocean = Ocean(current_speed_m_s=0.7, current_direction_rad=1.1)
    tank = Tank(models.path("leader").read_text(), ocean, 0.02, {"buoyancy": 0.0})
    position = np.array([10.0, 20.0, -15.0])
    twist = [*ocean.velocity(position[None], 0.0)[0], 0, 0, 0]
    tank.place(position, attitude.from_euler(0.3, 0.1, -0.2), twist)
    np.testing.assert_array_equal(tank.water_wrench(), 0.0)


def test_motion_in_a_uniform_current_is_the_motion_in_still_water_carried_along() -> None:
    ocean = Ocean(current_speed_m_s=0.7, current_direction_rad=1.1)
    drift = ocean.velocity(np.zeros((1, 3)), 0.0)[0]
    still, moving = (Tank(models.path("leader").read_text(), o, 0.02) for o in (Ocean(), ocean))
    for tank, velocity in ((still, np.zeros(3)), (moving, drift)):
        tank.place([0, 0, -20], attitude.from_euler(0.3), [*velocity, 0, 0, 0])
        tank.step([30, 4, 2, 0.3, 1.0], 500)
    np.testing.assert_allclose(moving.pose[:3], still.pose[:3] + 10.0 * drift, atol=1e-9)
    np.testing.assert_allclose(moving.pose[3:], still.pose[3:], atol=1e-10)


def test_water_that_hardly_varies_acts_as_water_that_does_not() -> None:
    """What only varying water does to a hull, which is left out in other water, goes to nothing
    with the shear of a current.
    """
    wrenches = []
    for shear_1_s in (0.0, 1e-13):
        ocean = Ocean(current_speed_m_s=0.7, current_direction_rad=1.1, current_shear_1_s=shear_1_s)
        tank = Tank(models.path("leader").read_text(), ocean, 0.02)
        tank.place([3.0, 4.0, -20.0], attitude.from_euler(0.3, 0.2, -0.1), [1, 0.4, 0.2, 3, 2, 1])
        wrenches.append(tank.water_wrench())
    without, with_shear = wrenches
    assert np.abs(without).min() > 0.1
    np.testing.assert_allclose(with_shear, without, rtol=1e-10)


def test_a_neutral_hull_is_accelerated_as_the_water_is() -> None:
    """The pressure that accelerates the water moves what weighs as much as it displaces: it
    stays with the water.
    """
    ocean = Ocean(added_current=np.array([[0.0, 0.1, 0.2], [50.0, 0.7, 0.0]]))
    displaced = 1026 * 4 / 3 * np.pi * SPHERE_RADIUS**3
    inertia = np.full(3, 0.4 * displaced * SPHERE_RADIUS**2)
    added = np.diag([displaced / 2] * 3 + [0.0] * 3)
    tank = Tank(hull(displaced, inertia, added_mass=added, hull_radius=SPHERE_RADIUS), ocean, 0.02)
    tank.place([0, 0, -20], attitude.from_euler(0.3), [0.1, 0.2, 0.0, 0, 0, 0])
    tank.step([0.0] * 5, 1000)
    # closed form after 20 s: the current gains 0.24 m/s to the east and loses 0.08 m/s to the north
    np.testing.assert_allclose(tank.twist[:3], [0.34, 0.12, 0.0], atol=1e-6)
    np.testing.assert_allclose(tank.pose[:2], [4.4, 3.2], atol=1e-4)


def airy(
    ocean_depth: float, height: float, period: float, k: float, position: Floats, t: float
) -> Floats:
    """Velocity of the water in a wave towards east, as textbooks print it (finite depth)."""
    omega = 2 * np.pi / period
    speed_scale = height / 2 * omega / np.sinh(k * ocean_depth)
    kz = k * (position[2] + ocean_depth)
    return np.array(
        [
            speed_scale * np.cosh(kz) * np.cos(k * position[0] - omega * t),
            0,
            speed_scale * np.sinh(kz) * np.sin(k * position[0] - omega * t),
        ]
    )


@pytest.mark.parametrize("depth", [40.0, 4.0])
def test_small_neutral_body_follows_its_wave_orbit(depth: float) -> None:
    height, period = 0.5, 4.0
    k = brentq(lambda k: G * k * np.tanh(k * depth) - (2 * np.pi / period) ** 2, 1e-3, 5.0)
    ocean = Ocean(
        floor_depth_m=depth,
        waves=Waves.regular(
            height_m=height, period_s=period, direction_rad=np.pi / 2, floor_depth_m=depth
        ),
    )
    radius = 0.02
    displaced = 1026 * 4 / 3 * np.pi * radius**3
    # a sphere adds half of what it displaces (Lamb 1932)
    xml = hull(
        displaced,
        np.full(3, 0.4 * displaced * radius**2),
        added_mass=np.diag([displaced / 2] * 3 + [0.0] * 3),
        hull_radius=radius,
    )
    start = np.array([0.0, 0.0, -2.0])
    duration = 3 * period
    path = solve_ivp(
        lambda t, p: airy(depth, height, period, k, p, t),
        (0, duration),
        start,
        rtol=1e-9,
        atol=1e-11,
        dense_output=True,
    ).sol
    semi_major_axis = height / 2 * np.cosh(k * (start[2] + depth)) / np.sinh(k * depth)

    def largest_error(dt: float) -> float:
        tank = Tank(xml, ocean, dt)
        tank.place(start, twist=[*airy(depth, height, period, k, start, 0.0), 0, 0, 0])
        errors = []
        for _ in range(round(duration / dt)):
            tank.step()
            errors.append(float(np.abs(tank.pose[:3] - path(tank.data.time)).max()))
        return max(errors)

    coarse, fine = largest_error(0.04), largest_error(0.02)
    assert fine < 0.002 * semi_major_axis
    # what is left is the integrator's, of second order in the step
    assert fine == pytest.approx(coarse / 4, rel=0.1)


def rate_along_path(
    ocean: Ocean, position: Floats, velocity: Floats, t: float, time_step: float = 1e-4
) -> Floats:
    """Rate of change of the water's velocity as met by a point that moves with v."""
    later, before = (
        ocean.velocity((position + offset * velocity)[None], t + offset)[0]
        for offset in (time_step, -time_step)
    )
    return np.asarray((later - before) / (2 * time_step))


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (1.5, 0.0, 0.0), (-0.7, 0.9, 0.4)])
def test_sphere_feels_the_acceleration_of_the_water_however_fast_it_passes(
    velocity: tuple[float, ...],
) -> None:
    """Displaced and added mass times Du/Dt (Taylor 1928; Auton, Hunt and Prud'homme 1988), in
    waves of 1 m.
    """
    ocean = Ocean(
        waves=Waves.regular(height_m=1.0, period_s=4.0, direction_rad=1.0), current_speed_m_s=0.4
    )
    for t in (0.0, 0.9, 2.3):
        tank = Tank(SPHERE, ocean, 0.02)
        position = np.array([3.0, -2.0, -1.5])
        tank.place(position, twist=[*velocity, 0, 0, 0], time=t)
        force = tank.water_wrench()[:3] - [0, 0, SPHERE_DISPLACED * G]
        expected = (
            1.5
            * SPHERE_DISPLACED
            * rate_along_path(ocean, position, ocean.velocity(position[None], t)[0], t)
        )
        np.testing.assert_allclose(force, expected, atol=1e-5)


def test_sphere_at_rest_in_a_shearing_current_is_lifted_to_the_quicker_side() -> None:
    """Added mass times (u − v) × curl u (Auton, Hunt and Prud'homme 1988): upwards, as the
    current grows with z.
    """
    ocean = Ocean(current_speed_m_s=0.8, current_direction_rad=np.pi / 2, current_shear_1_s=0.05)
    tank = Tank(SPHERE, ocean, 0.02)
    tank.place([0, 0, -4])
    lift = SPHERE_DISPLACED / 2 * (0.8 - 0.05 * 4.0) * 0.05
    np.testing.assert_allclose(
        tank.water_wrench()[:3], [0, 0, SPHERE_DISPLACED * G + lift], atol=1e-9
    )


@pytest.mark.parametrize("seed", range(4))
def test_force_on_added_mass_is_that_of_lagranges_equations_in_waves_and_shear(seed: int) -> None:
    """From the energy of the disturbed water alone, by finite differences, without displaced water
    and weight.

    T = ½ ν M_A ν, ν = (Rᵀ (v − u), ω − e × G e): the force is ∂T/∂x − d/dt ∂T/∂v, the moment in the
    body ∂T/∂θ − (d/dt + ω ×) ∂T/∂ω. As the model takes it, the gradient G of
    the water's velocity is the same over the hull: ∂/∂x leaves it as it is.
    """
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(6, 6))
    added = factor @ factor.T + np.diag([2.0, 60, 60, 0.2, 11, 11])
    added = (added + added.T) / 2
    waves = Waves.jonswap(
        rng,
        significant_height_m=0.6,
        peak_period_s=4.0,
        direction_rad=0.7,
        spread_rad=0.4,
        n_components=5,
    )
    ocean = Ocean(
        current_speed_m_s=0.5, current_direction_rad=2.0, current_shear_1_s=0.04, waves=waves
    )
    axis, h, t0 = np.array([1.0, 0.0, 0.0]), 1e-4, 7.0
    position, velocity, angular_velocity = (
        np.array([3.0, -4.0, -2.5]),
        rng.normal(size=3),
        0.3 * rng.normal(size=3),
    )
    start = Rotation.random(rng=rng)

    def water(p: Floats, t: float) -> Floats:
        return ocean.velocity(p[None], t)[0]

    def gradient(p: Floats, t: float) -> Floats:
        return np.array([water(p + h * e, t) - water(p - h * e, t) for e in np.eye(3)]).T / (2 * h)

    def relative(p: Floats, r: Rotation, velocity_gradient: Floats, t: float) -> Floats:
        water_rotation = np.cross(axis, r.inv().apply(velocity_gradient @ r.apply(axis)))
        return np.concatenate(
            [r.inv().apply(velocity - water(p, t)), angular_velocity - water_rotation]
        )

    def energy(p: Floats, r: Rotation, velocity_gradient: Floats) -> float:
        nu = relative(p, r, velocity_gradient, t0)
        return float(0.5 * nu @ added @ nu)

    def impulse(s: float) -> tuple[Floats, Floats]:
        """Impulse of the moving hull: linear in the world, angular in the body."""
        p, r, t = (
            position + s * velocity,
            start * Rotation.from_rotvec(s * angular_velocity),
            t0 + s,
        )
        body_impulse = added @ relative(p, r, gradient(p, t), t)
        return r.apply(body_impulse[:3]), body_impulse[3:]

    velocity_gradient, time_step = gradient(position, t0), 1e-3
    (linear_after, angular_after), (linear_before, angular_before) = (
        impulse(time_step),
        impulse(-time_step),
    )
    energy_by_position = [
        (
            energy(position + h * e, start, velocity_gradient)
            - energy(position - h * e, start, velocity_gradient)
        )
        / (2 * h)
        for e in np.eye(3)
    ]
    force = np.array(energy_by_position) - (linear_after - linear_before) / (2 * time_step)
    energies_of_rotated = [
        [energy(position, start * Rotation.from_rotvec(s * e), velocity_gradient) for s in (h, -h)]
        for e in np.eye(3)
    ]
    by_angle = [(ahead - back) / (2 * h) for ahead, back in energies_of_rotated]
    moment = (
        np.array(by_angle)
        - (angular_after - angular_before) / (2 * time_step)
        - np.cross(angular_velocity, impulse(0.0)[1])
    )

    tank = Tank(hull(60.0, [1, 10, 10], added_mass=added, buoyancy=0.0), ocean, 0.02)
    tank.place(position, start.as_quat(scalar_first=True), [*velocity, *angular_velocity], t0)
    np.testing.assert_allclose(tank.water_wrench(), [*force, *moment], rtol=1e-4, atol=1e-3)


def test_neutral_hull_without_drag_pitches_with_the_slope_of_long_waves() -> None:
    """Lying along the wave, moving with the water: added mass and displaced water turn it as the
    water turns.
    """
    waves = Waves.regular(height_m=0.02, period_s=6.0, direction_rad=np.pi / 2, floor_depth_m=500)
    ocean = Ocean(floor_depth_m=500, waves=waves)
    k, amplitude, depth = (2 * np.pi / 6.0) ** 2 / G, 0.01, 5.0
    xml = hull(
        96.698,
        [0.87028, 19.77479, 19.77479],
        added_mass=np.diag([3.731, 89.770, 89.770, 0.0, 15.690, 15.690]),
        displaced_inertia=19.77479,
        hull_radius=0.15,
    )
    tank = Tank(xml, ocean, 0.01)
    position = np.array([0.0, 0.0, -depth])
    # displacement of the water is vertical a e^{kz} cos θ: at θ = 0 the slope −k a e^{kz} sin θ is
    # nil, and grows
    slope = k * amplitude * np.exp(-k * depth)
    tank.place(
        position, twist=[*ocean.velocity(position[None], 0.0)[0], 0, -slope * 2 * np.pi / 6.0, 0]
    )
    pitches = []
    for _ in range(1200):
        tank.step()
        pitches.append(float(attitude.heading_pitch_roll(tank.pose[3:])[1]))
    expected = slope * np.sin(2 * np.pi / 6.0 * 0.01 * np.arange(1, 1201))
    np.testing.assert_allclose(pitches, expected, atol=0.01 * slope)
