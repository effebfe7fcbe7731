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
# area [m²] next to nothing; lift slope [1/rad], stall angle [rad] and drag coefficient
NO_FINS = {
    "fins_upright.fin": [1e-12, 3.09, 1.5708, 0.0],
    "fins_level.fin": [1e-12, 3.09, 1.5708, 0.0],
}


@pytest.mark.parametrize("thrust", [5.0, 20.0, 60.0])
def test_terminal_speed_is_where_drag_balances_thrust(thrust: float) -> None:
    """0.42 on the frontal area (Allen et al. 2000), and linear damping that fades as exp(−3 u)."""
    tank = Tank(models.path("follower").read_text(), Ocean(), 0.02)
    tank.step([thrust, 0, 0, 0, 0], 10000)
    # mass and added mass in surge [kg] over a time constant of 20 s
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
    """The wrench with damping less that without is −(d exp(−f U) + q |ν|) ν, with six values each
    of d, f and q.
    """
    linear, fade, quadratic = np.array(
        [[3, 5, 7, 2, 11, 13], [3, 0.5, 1, 0, 2, 0.7], [17, 19, 23, 4, 6, 8]], dtype=float
    )

    def wrench(damping_scale: float) -> Floats:
        numerics = {
            "linear_damping": damping_scale * linear,
            "linear_damping_fade": fade,
            "quadratic_damping": damping_scale * quadratic,
        }
        tank = Tank(models.path("follower").read_text(), Ocean(), 0.02, numerics)
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
    u, cross_flow = astern * speed * np.cos(alpha), speed * np.sin(alpha)
    pressure = 0.5 * rho * speed**2

    def force(sites: str = "", **numerics: npt.ArrayLike) -> tuple[Floats, Floats]:
        tank = Tank(hull(60.0, [1, 10, 10], sites=sites, **numerics), Ocean(), 0.02)
        tank.place(twist=u * np.eye(6)[0] + cross_flow * np.eye(6)[plane])
        applied = tank.water_wrench() - [0, 0, 60.0 * G, 0, 0, 0]
        return applied[:3], applied[3:]

    # sections across the flow: one strip of 0.3 m² at x = 0.4 m
    section_force, moment = force(cross_flow_drag=[1.1, 1.1], strip_x=0.4, strip_area=0.3)
    expected = -0.5 * rho * 0.3 * 1.1 * cross_flow**2 * np.eye(3)[plane]
    np.testing.assert_allclose(section_force, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([0.4, 0, 0], expected), atol=1e-9)

    # fixed fins: a normal force at the tail
    fin_sites = (
        '<site name="upright" pos="-0.9 0 0" zaxis="0 1 0"/><site name="level" pos="-0.9 0 0"/>'
    )
    fin_numeric = [0.05, 3.0, 1.5708, 0.0]
    fin_force, moment = force(fin_sites, **{"upright.fin": fin_numeric, "level.fin": fin_numeric})
    expected = -pressure * 0.05 * 3.0 * np.sin(alpha) * np.cos(alpha) * np.eye(3)[plane]
    np.testing.assert_allclose(fin_force, expected, atol=1e-9)
    np.testing.assert_allclose(moment, np.cross([-0.9, 0, 0], expected), atol=1e-9)

    # hull: drag along the axis, drag and lift across it, both less by cos α than in the flow's own
    # direction
    hull_force, moment = force(hull_lift=[0.35, 0.06, 0.28])
    expected = (
        -pressure * 0.35 * np.cos(alpha) * np.array([astern * 0.06 * np.cos(alpha), 0.0, 0.0])
    )
    expected[plane] = -pressure * 0.35 * np.cos(alpha) * (0.06 + 0.28) * np.sin(alpha)
    np.testing.assert_allclose(hull_force, expected, atol=1e-9)
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
def test_axial_force_is_odd_in_surge_and_continuous_at_rest(name: str) -> None:
    """The forces across the hull are even in surge."""
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
    """20 N of lateral thrust for 30 s: it gets no further ahead than its first surge speed would
    carry it.
    """
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
    forces = []
    for roll in (0.0, 0.6):
        tank = Tank(
            hull(60.0, [1, 10, 10], cross_flow_drag=[1.1, 1.1], strip_area=0.3), Ocean(), 0.02
        )
        tank.place(quaternion=attitude.from_euler(0.0, 0.0, roll), twist=[1.0, 0.0, 0.5, 0, 0, 0])
        forces.append(tank.water_wrench()[:3])
    np.testing.assert_allclose(*forces, atol=1e-9)


def test_drag_dissipates_energy_for_any_motion() -> None:
    rng = np.random.default_rng(0)
    for name in ("leader", "follower"):
        with_drag = Tank(models.path(name).read_text(), Ocean(), 0.02)
        zero_drag = {
            "linear_damping": np.zeros(6),
            "quadratic_damping": np.zeros(6),
            "hull_lift": np.zeros(3),
            "cross_flow_drag": np.zeros(2),
            **NO_FINS,
        }
        without_drag = Tank(models.path(name).read_text(), Ocean(), 0.02, zero_drag)
        for _ in range(50):
            twist = rng.normal(size=6) * [2, 1, 1, 1, 1, 1]
            powers = []
            for tank in (with_drag, without_drag):
                tank.place(twist=twist)
                powers.append(float(tank.water_wrench() @ twist))
            # the difference is the power of damping, drag and lift; lift across the flow has none
            assert powers[0] < powers[1]


@pytest.mark.parametrize("name", ["leader", "follower"])
@pytest.mark.parametrize("speed", [1.0, 2.0, 3.0])
def test_hull_runs_straight_by_its_fins(name: str, speed: float) -> None:
    """Eigenvalues of the linearised sway-yaw and heave-pitch motion at constant speed."""
    assert max(_growth_rates(models.path(name), speed, {})) < 0
    assert max(_growth_rates(models.path(name), speed, dict(NO_FINS))) > 0


def _growth_rates(
    path: Path, speed: float, numerics: dict[str, npt.ArrayLike]
) -> tuple[float, float]:
    """Largest real part of the eigenvalues [1/s] in the horizontal and in the vertical plane, of
    the motion linearised by central differences.
    """
    tank = Tank(path.read_text(), Ocean(), 0.02, numerics)

    def rate(v: float, w: float, q: float, r: float, pitch: float) -> Floats:
        """Rates of change of v, r, w, q and pitch."""
        body_twist = np.array([speed, v, w, 0, q, r])
        quaternion = attitude.from_euler(np.pi / 2, pitch)
        tank.place(
            quaternion=quaternion,
            twist=[*attitude.rotate(quaternion, body_twist[:3]), *body_twist[3:]],
        )
        acceleration = tank.acceleration()
        body_rate = tank.rotation.T @ acceleration[:3] - np.cross(body_twist[3:], body_twist[:3])
        # a turn about port lowers the nose
        return np.array([body_rate[1], acceleration[5], body_rate[2], acceleration[4], -q])

    step = 1e-5
    columns = [(rate(*(step * e)) - rate(*(-step * e))) / (2 * step) for e in np.eye(5)]
    state_matrix = np.array(columns).T  # rows v, r, w, q, pitch; columns v, w, q, r, pitch
    horizontal = state_matrix[np.ix_([0, 1], [0, 3])]
    vertical = state_matrix[np.ix_([2, 3, 4], [1, 2, 4])]
    return tuple(float(np.linalg.eigvals(m).real.max()) for m in (horizontal, vertical))  # type: ignore[return-value]


def test_buoyancy_fades_as_the_hull_emerges() -> None:
    """At the surface the buoyancy of the immersed part equals the weight, and the hull does not
    leap out of the water.
    """
    mass, radius, buoyancy_per_weight = 31.0, 0.095, 1.25
    strip_areas, strip_x = np.full(8, 0.03), np.linspace(-0.7, 0.7, 8)
    xml = hull(
        mass,
        [0.1, 4, 4],
        (0, 0, -0.02),
        added_mass=np.diag([0.8, 29, 29, 0.03, 3.4, 3.4]),
        buoyancy=mass * G * buoyancy_per_weight,
        hull_radius=radius,
        strip_x=strip_x,
        strip_area=strip_areas,
        linear_damping=[2, 60, 60, 1, 11, 11],
    )
    tank = Tank(xml, Ocean(), 0.02)
    tank.place([0, 0, -5])
    highest = -5.0
    for _ in range(5000):
        tank.step()
        highest = max(highest, float(tank.pose[2]))
    # the immersed part of a section falls linearly from 1 to 0 while its middle rises from −r to r
    assert tank.pose[2] == pytest.approx(radius * (1 - 2 / buoyancy_per_weight), abs=1e-3)
    assert highest < 4 * radius
    assert abs(float(attitude.heading_pitch_roll(tank.pose[3:])[1])) < 1e-6


@pytest.mark.parametrize("place", [-0.3, 0.0, 0.8])
@pytest.mark.parametrize("pitch", [0.0, 0.1, -0.2, 1.2])
def test_buoyancy_at_the_surface_does_not_depend_on_the_origin(place: float, pitch: float) -> None:
    """Σ B a/A (wet share) acts at each strip, wherever the origin is along the hull."""
    radius, buoyancy = 0.095, 300.0
    areas = np.array([0.01, 0.03, 0.04, 0.02])
    ahead_of_middle = np.array([-0.7, -0.2, 0.3, 0.7])
    ahead_of_middle -= np.average(ahead_of_middle, weights=areas)
    strip_x = place + ahead_of_middle
    xml = hull(
        31.0,
        [0.1, 4, 4],
        (place, 0, 0),
        buoyancy=buoyancy,
        hull_radius=radius,
        strip_x=strip_x,
        strip_area=areas,
    )
    centre = f'<numeric name="buoyancy_centre" data="{place!r} 0 0"/></custom>'
    tank = Tank(xml.replace("</custom>", centre), Ocean(), 0.02)
    # the middle is 3 cm above the surface
    origin = [-place * np.cos(pitch), 0.0, 0.03 - place * np.sin(pitch)]
    # heading east: a turn about port, which is north, lowers the nose
    tank.place(origin, attitude.from_euler(np.pi / 2, pitch))
    depth = -(0.03 + ahead_of_middle * np.sin(pitch))
    wet = np.clip(0.5 + 0.5 * depth / radius, 0.0, 1.0)
    lift = buoyancy * wet * areas / areas.sum()
    expected = [0.0, 0.0, lift.sum(), 0.0, -np.sum(lift * strip_x) * np.cos(pitch), 0.0]
    np.testing.assert_allclose(tank.water_wrench(), expected, atol=1e-9)


def test_a_hull_in_a_trough_is_out_of_the_water() -> None:
    """0.6 m below the still surface, under a trough 1 m deep and a crest 1 m high."""
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
