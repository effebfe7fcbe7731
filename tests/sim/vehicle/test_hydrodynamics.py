"""Drag, lift, fins and the surface against closed forms and independent integrations."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.optimize import brentq

import models
from laisn.arrays import Floats
from sim import attitude
from sim.water.ocean import Ocean
from sim.water.waves import Waves
from tests.sim.vehicle.tank import Tank, hull

G = 9.81
NO_FINS = {
    "fins_upright.fin": [1e-12, 3.09, 1.5708, 0.0],
    "fins_level.fin": [1e-12, 3.09, 1.5708, 0.0],
}


@pytest.mark.parametrize("thrust", [5.0, 20.0, 60.0])
def test_terminal_speed_is_where_drag_balances_thrust(thrust: float) -> None:
    """0.42 on the frontal area (Allen et al. 2000), and linear damping that fades as exp(−3 u)."""
    tank = Tank(models.path("follower").read_text(), Ocean(), 0.02)
    tank.step([thrust, 0, 0, 0, 0], 10000)
    linear = (31.0294 + 0.83891) / 20.0

    def balance(u: float) -> float:
        return 0.5 * 1026 * 0.42 * np.pi * 0.095**2 * u**2 + linear * np.exp(-3 * u) * u - thrust

    assert tank.body_velocity[0] == pytest.approx(brentq(balance, 0.01, 5.0), rel=1e-3)


@pytest.mark.parametrize(
    "twist", [[0.8, -0.3, 0.2, 0.4, -0.5, 0.6], [-0.8, 0.3, -0.2, -0.4, 0.5, -0.6]]
)
def test_damping_fades_with_speed_and_grows_with_its_square_on_each_axis(
    twist: list[float],
) -> None:
    """−(d exp(−f U) + q |ν|) ν with six values each: what they add to the forces on a hull
    without any.
    """
    linear, fade, quadratic = np.array(
        [[3, 5, 7, 2, 11, 13], [3, 0.5, 1, 0, 2, 0.7], [17, 19, 23, 4, 6, 8]], dtype=float
    )

    def wrench(share: float) -> Floats:
        given = {
            "linear_damping": share * linear,
            "linear_damping_fade": fade,
            "quadratic_damping": share * quadratic,
        }
        tank = Tank(models.path("follower").read_text(), Ocean(), 0.02, given)
        tank.place(twist=twist)
        return tank.water_wrench()

    nu = np.array(twist)
    expected = -(linear * np.exp(-fade * np.linalg.norm(nu[:3])) + quadratic * np.abs(nu)) * nu
    np.testing.assert_allclose(wrench(1.0) - wrench(0.0), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("astern", [1.0, -1.0])
@pytest.mark.parametrize("plane", [1, 2])
def test_parts_of_the_hull_force_are_their_textbook_forms(plane: int, astern: float) -> None:
    """At 1.5 m/s and 10° of incidence in one plane, seen from the bow or from the stern."""
    speed, alpha, rho = 1.5, np.radians(10), 1026.0
    u, across = astern * speed * np.cos(alpha), speed * np.sin(alpha)
    pressure = 0.5 * rho * speed**2

    def force(sites: str = "", **numerics: npt.ArrayLike) -> tuple[Floats, Floats]:
        tank = Tank(hull(60.0, [1, 10, 10], sites=sites, **numerics), Ocean(), 0.02)
        tank.place(twist=u * np.eye(6)[0] + across * np.eye(6)[plane])
        applied = tank.water_wrench() - [0, 0, 60.0 * G, 0, 0, 0]
        return applied[:3], applied[3:]

    # sections across the flow: one strip of 0.3 m² at x = 0.4 m
    section, moment = force(cross_flow_drag=[1.1, 1.1], strip_x=0.4, strip_area=0.3)
    expected = -0.5 * rho * 0.3 * 1.1 * across**2 * np.eye(3)[plane]
    np.testing.assert_allclose(section, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([0.4, 0, 0], expected), atol=1e-9)

    # fixed fins: a normal force at the tail
    pair = '<site name="upright" pos="-0.9 0 0" zaxis="0 1 0"/><site name="level" pos="-0.9 0 0"/>'
    fin = [0.05, 3.0, 1.5708, 0.0]
    fins, moment = force(pair, **{"upright.fin": fin, "level.fin": fin})
    expected = -pressure * 0.05 * 3.0 * np.sin(alpha) * np.cos(alpha) * np.eye(3)[plane]
    np.testing.assert_allclose(fins, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([-0.9, 0, 0], expected), atol=1e-9)

    # hull: drag along the axis, drag and lift across it, both less by cos α than in the flow's own
    # direction
    body, moment = force(hull_lift=[0.35, 0.06, 0.28])
    expected = (
        -pressure * 0.35 * np.cos(alpha) * np.array([astern * 0.06 * np.cos(alpha), 0.0, 0.0])
    )
    expected[plane] = -pressure * 0.35 * np.cos(alpha) * (0.06 + 0.28) * np.sin(alpha)
    np.testing.assert_allclose(body, expected, atol=1e-9)
    np.testing.assert_array_equal(moment, 0.0)


@pytest.mark.parametrize("plane", [1, 2])
@pytest.mark.parametrize(
    ("name", "length", "diameter"), [("leader", 2.0, 0.25), ("follower", 1.6, 0.19)]
)
def test_broadside_drag_is_that_of_cylinders(
    name: str, length: float, diameter: float, plane: int
) -> None:
    """Coefficient 1.1 (Hoerner 1965) on the side view of the spheroid, and no force along the
    axis.
    """
    tank = Tank(models.path(name).read_text(), Ocean(), 0.02, {"linear_damping": np.zeros(6)})
    tank.place(twist=0.5 * np.eye(6)[plane])
    force = tank.water_wrench()[:3] - [0, 0, tank.coefficients["buoyancy"]]
    side_view = np.pi / 4 * length * diameter
    expected = -0.5 * 1026 * 1.1 * side_view * 0.5**2 * np.eye(3)[plane]
    np.testing.assert_allclose(force, expected, rtol=1e-3, atol=1e-12)


@pytest.mark.parametrize("name", ["leader", "follower"])
def test_force_is_odd_in_surge_and_has_no_jump_where_it_turns(name: str) -> None:
    tank = Tank(models.path(name).read_text(), Ocean(), 0.02)

    def force(u: float) -> Floats:
        tank.place(twist=[u, 0.5, 0.3, 0, 0, 0])
        return tank.water_wrench()[:3]

    at_rest = force(0.0)
    assert at_rest[0] == 0.0
    for u in (1e-9, 1e-3, 0.2, 1.0):
        ahead, astern = force(u), force(-u)
        assert ahead[0] == -astern[0] < 0.0
        np.testing.assert_allclose(ahead[1:], astern[1:], rtol=1e-12)
    np.testing.assert_allclose(force(1e-9), at_rest, atol=1e-6)


@pytest.mark.parametrize("surge", [1e-3, -1e-3])
def test_hull_pushed_sideways_does_not_run_ahead(surge: float) -> None:
    """20 N of lateral thrust for 30 s: the surge that there was at first does not grow."""
    tank = Tank(models.path("leader").read_text(), Ocean(), 0.02)
    tank.place(twist=surge * np.eye(6)[0])
    tank.step([0, 20, 0, 0, 0], 1500)
    assert tank.pose[1] > 5.0
    assert abs(tank.pose[0]) < 30 * abs(surge)


def test_hull_left_in_a_beam_sea_does_not_run_ahead() -> None:
    """Waves of 1 m from the side: swell, sway and roll, and no reason to go either way along the
    axis.
    """
    waves = Waves.regular(height_m=1.0, period_s=5.0, direction_rad=0.0)
    tank = Tank(models.path("leader").read_text(), Ocean(waves=waves), 0.02)
    tank.place([0, 0, -3], twist=1e-3 * np.eye(6)[0])
    tank.step(n=3000)
    assert abs(tank.pose[0]) < 0.06


def test_cross_flow_drag_of_a_round_hull_is_independent_of_direction() -> None:
    rotated = []
    for roll in (0.0, 0.6):
        tank = Tank(
            hull(60.0, [1, 10, 10], cross_flow_drag=[1.1, 1.1], strip_area=0.3), Ocean(), 0.02
        )
        tank.place(quaternion=attitude.from_euler(0.0, 0.0, roll), twist=[1.0, 0.0, 0.5, 0, 0, 0])
        rotated.append(tank.water_wrench()[:3])
    np.testing.assert_allclose(*rotated, atol=1e-9)


def test_drag_dissipates_energy_for_any_motion() -> None:
    rng = np.random.default_rng(0)
    for name in ("leader", "follower"):
        wet = Tank(models.path(name).read_text(), Ocean(), 0.02)
        dry_numerics = {
            "linear_damping": np.zeros(6),
            "quadratic_damping": np.zeros(6),
            "hull_lift": np.zeros(3),
            "cross_flow_drag": np.zeros(2),
            **NO_FINS,
        }
        ideal = Tank(models.path(name).read_text(), Ocean(), 0.02, dry_numerics)
        for _ in range(50):
            twist = rng.normal(size=6) * [2, 1, 1, 1, 1, 1]
            power = []
            for tank in (wet, ideal):
                tank.place(twist=twist)
                power.append(float(tank.water_wrench() @ twist))
            # lift works on nothing, damping and drag on the motion: the difference is loss
            assert power[0] < power[1]


@pytest.mark.parametrize("name", ["leader", "follower"])
@pytest.mark.parametrize("speed", [1.0, 2.0, 3.0])
def test_hull_runs_straight_by_its_fins(name: str, speed: float) -> None:
    """Eigenvalues of the linearised sway-yaw and heave-pitch motion at constant speed."""
    assert max(_growth(models.path(name), speed, {})) < 0
    assert max(_growth(models.path(name), speed, dict(NO_FINS))) > 0


def _growth(path: Path, speed: float, numerics: dict[str, npt.ArrayLike]) -> tuple[float, float]:
    """Largest growth rates [1/s] in the horizontal and in the vertical plane."""
    tank = Tank(path.read_text(), Ocean(), 0.02, numerics)

    def rate(v: float, w: float, q: float, r: float, pitch: float) -> Floats:
        body = np.array([speed, v, w, 0, q, r])
        lying = attitude.from_euler(np.pi / 2, pitch)
        tank.place(quaternion=lying, twist=[*attitude.rotate(lying, body[:3]), *body[3:]])
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
    tank = Tank(xml, Ocean(), 0.02)
    tank.place([0, 0, -5])
    highest = -5.0
    for _ in range(5000):
        tank.step()
        highest = max(highest, float(tank.pose[2]))
    # a section's share falls evenly from 1 to 0 while its middle rises from −r to r
    assert tank.pose[2] == pytest.approx(radius * (1 - 2 / excess), abs=1e-3)
    assert highest < 4 * radius
    assert abs(float(attitude.heading_pitch_roll(tank.pose[3:])[1])) < 1e-6


def test_a_hull_in_a_trough_is_out_of_the_water() -> None:
    """0.6 m below the still surface, where waves of a long period are 1 m low and 1 m high."""
    trough, crest = (
        Tank(
            models.path("leader").read_text(),
            Ocean(waves=Waves.regular(height_m=2.0, period_s=20.0, phase_rad=phase)),
            0.02,
        )
        for phase in (np.pi, 0.0)
    )
    for tank in (trough, crest):
        tank.place((0.0, 0.0, -0.6))
    assert trough.water_wrench()[2] == 0.0
    assert crest.water_wrench()[2] > 600.0
