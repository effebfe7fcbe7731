"""Drag, lift, current, waves and the surface against closed forms and independent integrations."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import models
from sim.geometry import attitude
from sim.water.ocean import Ocean
from sim.water.waves import Waves
from tests.vehicle.tank import Tank, hull

Floats = npt.NDArray[np.float64]
G = 9.81


@pytest.mark.parametrize("thrust", [5.0, 20.0, 60.0])
def test_terminal_speed_is_where_drag_balances_thrust(thrust: float) -> None:
    """0.42 on the frontal area (Allen et al. 2000), and linear damping that fades as exp(−3 u)."""
    tank = Tank(models.path("follower").read_text(), Ocean.calm(), 0.02)
    tank.pose[0, 2] = -50
    for _ in range(10000):
        tank.step([thrust, 0, 0, 0, 0, 0])
    linear = (31.0294 + 0.83891) / 20.0

    def balance(u: float) -> float:
        return 0.5 * 1026 * 0.42 * np.pi * 0.095**2 * u**2 + linear * np.exp(-3 * u) * u - thrust

    assert tank.body_velocity[0] == pytest.approx(brentq(balance, 0.01, 5.0), rel=1e-3)


@pytest.mark.parametrize("astern", [1.0, -1.0])
@pytest.mark.parametrize("plane", [1, 2])
def test_parts_of_the_hull_force_are_their_textbook_forms(plane: int, astern: float) -> None:
    """At 1.5 m/s and 10° of incidence in one plane, seen from the bow or from the stern."""
    speed, alpha, rho = 1.5, np.radians(10), 1026.0
    u, across = astern * speed * np.cos(alpha), speed * np.sin(alpha)
    pressure = 0.5 * rho * speed**2

    def force(**numerics: npt.ArrayLike) -> tuple[Floats, Floats]:
        tank = Tank(hull(60.0, [1, 10, 10], **numerics), Ocean.calm(), 0.02)
        tank.pose[0, 2] = -50
        tank.twist[0, 0], tank.twist[0, plane] = u, across
        tank.prepare()
        applied = tank.data.qfrc_applied - [0, 0, 60.0 * G, 0, 0, 0]
        return applied[:3], applied[3:]

    # sections across the flow: one strip of 0.3 m² at x = 0.4 m
    section, moment = force(cross_flow_drag=[1.1, 1.1], strip_x=0.4, strip_area=0.3)
    expected = -0.5 * rho * 0.3 * 1.1 * across**2 * np.eye(3)[plane]
    np.testing.assert_allclose(section, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([0.4, 0, 0], expected), atol=1e-9)

    # fins: a normal force at the tail
    fins, moment = force(fin_x=-0.9, fin_area=[0.05, 0.05], fin_lift_slope=3.0)
    expected = -pressure * 0.05 * 3.0 * np.sin(alpha) * np.cos(alpha) * np.eye(3)[plane]
    np.testing.assert_allclose(fins, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([-0.9, 0, 0], expected), atol=1e-9)

    # hull: drag against the flow, lift at right angles to it
    body, _ = force(hull_lift=[0.35, 0.06, 0.28, 2.5])
    flow = np.array([u, 0, 0]) + across * np.eye(3)[plane]
    drag, lift = pressure * 0.35 * (0.06 + 2.5 * (0.28 * alpha) ** 2), pressure * 0.35 * 0.28 * alpha
    assert -body @ flow / speed == pytest.approx(drag, rel=1e-12)
    assert np.linalg.norm(body + drag * flow / speed) == pytest.approx(lift, rel=1e-12)
    assert body[plane] < 0


def test_cross_flow_drag_does_not_know_the_direction_of_a_round_hull() -> None:
    rotated = []
    for roll in (0.0, 0.6):
        tank = Tank(hull(60.0, [1, 10, 10], cross_flow_drag=[1.1, 1.1], strip_area=0.3), Ocean.calm(), 0.02)
        tank.pose[0] = [0, 0, -50, *attitude.from_euler(0.0, 0.0, roll)]
        tank.twist[0, :3] = [1.0, 0.0, 0.5]
        tank.prepare()
        rotated.append(tank.data.qfrc_applied[:3].copy())
    np.testing.assert_allclose(*rotated, atol=1e-9)


def test_drag_takes_energy_out_whatever_the_motion() -> None:
    rng = np.random.default_rng(0)
    for name in ("leader", "follower"):
        wet = Tank(models.path(name).read_text(), Ocean.calm(), 0.02)
        dry_numerics = {
            "linear_damping": np.zeros(6),
            "quadratic_damping": np.zeros(6),
            "hull_lift": np.zeros(4),
            "cross_flow_drag": np.zeros(2),
            "fin_area": np.zeros(2),
        }
        ideal = Tank(models.path(name).read_text(), Ocean.calm(), 0.02, dry_numerics)
        for _ in range(50):
            twist = rng.normal(size=6) * [2, 1, 1, 1, 1, 1]
            power = []
            for tank in (wet, ideal):
                tank.pose[0] = [0, 0, -50, 1, 0, 0, 0]
                tank.twist[0] = twist
                tank.prepare()
                power.append(float(tank.data.qfrc_applied @ twist))
            # lift works on nothing, damping and drag on the motion: the difference is loss
            assert power[0] < power[1]


def test_drifting_with_a_uniform_current_there_is_exactly_no_force() -> None:
    ocean = Ocean(current_speed_m_s=0.7, current_direction_rad=1.1)
    tank = Tank(models.path("leader").read_text(), ocean, 0.02, {"buoyancy": 0.0})
    tank.pose[0] = [10, 20, -15, *attitude.from_euler(0.3, 0.1, -0.2)]
    tank.twist[0, :3] = ocean.velocity(tank.pose[:, :3], 0.0)[0]
    tank.prepare()
    np.testing.assert_array_equal(tank.data.qfrc_applied, 0.0)


def test_motion_in_a_uniform_current_is_the_motion_in_still_water_carried_along() -> None:
    ocean = Ocean(current_speed_m_s=0.7, current_direction_rad=1.1)
    drift = ocean.velocity(np.zeros((1, 3)), 0.0)[0]
    still, moving = (Tank(models.path("leader").read_text(), o, 0.02) for o in (Ocean.calm(), ocean))
    wrench = [30, 4, 2, 0.1, 0.3, 1.0]
    for tank, velocity in ((still, np.zeros(3)), (moving, drift)):
        tank.pose[0] = [0, 0, -20, *attitude.from_euler(0.3)]
        tank.twist[0, :3] = velocity
        for _ in range(500):
            tank.step(wrench)
    np.testing.assert_allclose(moving.pose[0, :3], still.pose[0, :3] + 10.0 * drift, atol=1e-9)
    np.testing.assert_allclose(moving.pose[0, 3:], still.pose[0, 3:], atol=1e-10)


def airy(ocean_depth: float, height: float, period: float, k: float, p: Floats, t: float) -> Floats:
    """Velocity of the water in a wave towards east, as textbooks print it (finite depth)."""
    w = 2 * np.pi / period
    scale = height / 2 * w / np.sinh(k * ocean_depth)
    up = k * (p[2] + ocean_depth)
    return np.array([scale * np.cosh(up) * np.cos(k * p[0] - w * t), 0, scale * np.sinh(up) * np.sin(k * p[0] - w * t)])


@pytest.mark.parametrize("depth", [40.0, 4.0])
def test_small_neutral_body_follows_its_wave_orbit(depth: float) -> None:
    height, period = 0.5, 4.0
    k = brentq(lambda k: G * k * np.tanh(k * depth) - (2 * np.pi / period) ** 2, 1e-3, 5.0)
    ocean = Ocean(
        floor_depth_m=depth,
        waves=Waves.regular(height_m=height, period_s=period, direction_rad=np.pi / 2, floor_depth_m=depth),
    )
    radius = 0.02
    displaced = 1026 * 4 / 3 * np.pi * radius**3
    # a sphere adds half of what it displaces (Lamb 1932, Art. 92)
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

    def worst(dt: float) -> float:
        tank = Tank(xml, ocean, dt)
        tank.pose[0, :3] = start
        tank.twist[0, :3] = airy(depth, height, period, k, start, 0.0)
        errors = []
        for _ in range(round(duration / dt)):
            tank.step()
            errors.append(float(np.abs(tank.pose[0, :3] - path(tank.data.time)).max()))
        return max(errors)

    coarse, fine = worst(0.04), worst(0.02)
    assert fine < 0.002 * semi_major_axis
    # what is left is the integrator's, of second order in the step
    assert fine == pytest.approx(coarse / 4, rel=0.1)


def test_neutral_hull_without_drag_pitches_with_the_slope_of_long_waves() -> None:
    """Lying along the wave, moving with the water: added mass and displaced water turn it as the water turns."""
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
    tank.pose[0] = [0, 0, -depth, *attitude.from_euler(np.pi / 2)]
    tank.twist[0, :3] = ocean.velocity(tank.pose[:, :3], 0.0)[0]
    # displacement of the water is vertical a e^{kz} cos θ: at θ = 0 the slope −k a e^{kz} sin θ is nil, and grows
    slope = k * amplitude * np.exp(-k * depth)
    tank.twist[0, 4] = -slope * 2 * np.pi / 6.0
    pitch = []
    for _ in range(1200):
        tank.step()
        pitch.append(float(attitude.pitch(tank.pose[0, 3:])))
    expected = slope * np.sin(2 * np.pi / 6.0 * 0.01 * np.arange(1, 1201))
    np.testing.assert_allclose(pitch, expected, atol=0.01 * slope)


@pytest.mark.parametrize("name", ["leader", "follower"])
@pytest.mark.parametrize("speed", [1.0, 2.0, 3.0])
def test_hull_runs_straight_by_its_fins(name: str, speed: float) -> None:
    """Eigenvalues of the linearised sway-yaw and heave-pitch motion at constant speed."""
    assert max(_growth(models.path(name), speed, {})) < 0
    assert max(_growth(models.path(name), speed, {"fin_area": [0, 0]})) > 0


def _growth(path: Path, speed: float, numerics: dict[str, npt.ArrayLike]) -> tuple[float, float]:
    """Largest growth rates [1/s] in the horizontal and in the vertical plane."""
    tank = Tank(path.read_text(), Ocean.calm(), 0.02, numerics)

    def rate(v: float, w: float, q: float, r: float, pitch: float) -> Floats:
        tank.pose[0] = [0, 0, -50, *attitude.from_euler(np.pi / 2, pitch)]
        body = np.array([speed, v, w, 0, q, r])
        tank.twist[0] = [*tank.rotation @ body[:3], *body[3:]]
        a = tank.acceleration()
        body_rate = tank.rotation.T @ a[:3] - np.cross(body[3:], body[:3])
        # a turn about port lowers the nose
        return np.array([body_rate[1], a[5], body_rate[2], a[4], -q])

    h = 1e-5
    columns = [(rate(*(h * e)) - rate(*(-h * e))) / (2 * h) for e in np.eye(5)]
    full = np.array(columns).T  # rows v, r, w, q, pitch; columns v, w, q, r, pitch
    horizontal = full[np.ix_([0, 1], [0, 3])]
    vertical = full[np.ix_([2, 3, 4], [1, 2, 4])]
    return tuple(float(np.linalg.eigvals(m).real.max()) for m in (horizontal, vertical))  # type: ignore[return-value]


def test_buoyancy_fades_as_the_hull_emerges() -> None:
    """On the surface the immersed share is what carries the weight; nothing flies."""
    mass, radius, excess = 31.0, 0.095, 1.25
    areas, x = np.full(8, 0.03), np.linspace(-0.7, 0.7, 8)
    xml = hull(
        mass,
        [0.1, 4, 4],
        (0, 0, -0.02),
        added_mass=np.diag([0.8, 29, 29, 0.03, 3.4, 3.4]),
        buoyancy=mass * G * excess,
        hull_radius=radius,
        strip_x=x,
        strip_area=areas,
        linear_damping=[2, 60, 60, 1, 11, 11],
    )
    tank = Tank(xml, Ocean.calm(), 0.02)
    tank.pose[0, 2] = -5
    highest = -5.0
    for _ in range(5000):
        tank.step()
        highest = max(highest, float(tank.pose[0, 2]))
    # a section's share falls evenly from 1 to 0 while its middle rises from −r to r
    assert tank.pose[0, 2] == pytest.approx(radius * (1 - 2 / excess), abs=1e-3)
    assert highest < 4 * radius
    assert abs(float(attitude.pitch(tank.pose[0, 3:]))) < 1e-6
