"""Current and waves against textbook formulas, finite differences and the statistics of the
spectrum.
"""

from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from laisn.arrays import Floats
from sim.water.environment import elevation_at, flow, sea_at, velocity_of_water
from sim.water.ocean import Ocean
from sim.water.waves import Waves, wavenumber

G = 9.81


CHANGE = np.array([[0.0, 0.1, -0.2], [40.0, 0.5, 0.3], [90.0, -0.2, 0.4]])
"""A current that changes: time [s], east and north [m/s]."""


def changing_current(t: float) -> Floats:
    """Velocity of that current [m/s]."""
    return np.array([np.interp(t, CHANGE[:, 0], CHANGE[:, i]) for i in (1, 2)])


def carried_displacement(t: float) -> Floats:
    """Integral of that velocity from 0 to t [m]."""
    knots = np.array([*CHANGE[CHANGE[:, 0] < t, 0], t])
    velocity = np.array([changing_current(knot) for knot in knots])
    return np.asarray(np.trapezoid(velocity, knots, axis=0))


def shearing_sea(seed: int = 1, depth: float = 12.0, change: Floats = CHANGE[:0]) -> Ocean:
    """A short-crested sea in shallow water on a shearing current, so that no term is zero."""
    waves = Waves.jonswap(
        np.random.default_rng(seed),
        significant_height_m=0.6,
        peak_period_s=4.5,
        direction_rad=0.7,
        spread_rad=0.4,
        floor_depth_m=depth,
        n_components=7,
    )
    return Ocean(
        current_speed_m_s=0.6,
        current_direction_rad=2.0,
        current_shear_1_s=0.03,
        added_current=change,
        floor_depth_m=depth,
        waves=waves,
    )


def textbook_velocity(ocean: Ocean, position: Floats, t: float) -> Floats:
    """Finite-depth Airy waves on a current, component by component (Faltinsen 1990)."""
    current, waves, depth = ocean, ocean.waves, ocean.floor_depth_m
    towards = np.array(
        [np.sin(current.current_direction_rad), np.cos(current.current_direction_rad)]
    )
    surface = current.current_speed_m_s * towards
    u = np.array(
        [*(current.current_speed_m_s + current.current_shear_1_s * position[2]) * towards, 0.0]
    )
    drift = surface * t
    if current.added_current.size:
        u[:2] += changing_current(t)
        drift = drift + carried_displacement(t)
    z = min(position[2], 0.0)  # above the still surface nothing of the waves changes with height
    components = zip(
        waves.amplitude_m, waves.wavenumber_1_m, waves.omega_rad_s, waves.phase_rad, strict=True
    )
    for a, wave_vector, omega, phase in components:
        k = np.hypot(*wave_vector)
        theta = wave_vector @ (position[:2] - drift) - omega * t + phase
        horizontal = a * omega * np.cosh(k * (z + depth)) / np.sinh(k * depth) * np.cos(theta)
        vertical = a * omega * np.sinh(k * (z + depth)) / np.sinh(k * depth) * np.sin(theta)
        u += [*(horizontal * wave_vector / k), vertical]
    return u


def potential_flow(
    waves: Waves, depth: float, place: Floats, velocity: Floats, axis: Floats, t: float
) -> list[Floats]:
    """The fields of `Flow` at a place that moves, in still water, by derivatives of the potential
    ϕ = Σ (a ω / k) cosh(k(z+h)) / sinh(kh) sin(k·x − ω t + φ), in extended precision.
    """
    real = np.longdouble
    kx, ky = waves.wavenumber_1_m.T.astype(real)
    k = np.hypot(kx, ky)
    omega = waves.omega_rad_s.astype(real)
    theta = kx * real(place[0]) + ky * real(place[1]) - omega * real(t) + waves.phase_rad
    scale = waves.amplitude_m * omega / k / np.sinh(k * depth)
    above_floor = k * (real(place[2]) + depth)

    def derivative(*by: int) -> float:
        """By x (0), y (1), z (2) and time (3), one after another."""
        horizontal = np.ones(k.size, np.clongdouble)
        for factor in ((kx, ky, k, -omega)[i] * (1 if i == 2 else 1j) for i in by):
            horizontal = horizontal * factor
        vertical = (np.cosh, np.sinh)[by.count(2) % 2](above_floor)
        return float(np.sum(scale * vertical * (horizontal * np.exp(1j * theta)).imag))

    def along(direction: Floats, *by: int) -> float:
        return float(sum(direction[j] * derivative(*by, j) for j in range(len(direction))))

    path = np.append(velocity, 1.0)
    return [
        np.array([derivative(i) for i in range(3)]),
        np.array([along(path, i) for i in range(3)]),
        np.array([[derivative(i, j) for j in range(3)] for i in range(3)]),
        np.array([sum(axis[j] * along(path, i, j) for j in range(3)) for i in range(3)]),
        np.array([along(axis, i, 3) for i in range(3)]),
    ]


def elevation(ocean: Ocean, x: npt.ArrayLike, y: npt.ArrayLike, time: float) -> Floats:
    """Height of the surface above z = 0; x and y broadcast [m]."""
    instant = sea_at(ocean.environment, time)
    return np.asarray(np.vectorize(lambda *point: elevation_at(instant, *map(float, point)))(x, y))


def acceleration_of(ocean: Ocean, point: Floats, time: float) -> Floats:
    """Acceleration of a particle, which is its change of velocity along its own path [m/s²]."""
    velocity = tuple(ocean.velocity(point[None], time)[0])
    instant = sea_at(ocean.environment, time)
    return np.array(flow(instant, tuple(point.tolist()), velocity, (1.0, 0.0, 0.0)).rate)


@given(period=st.floats(0.5, 60), depth=st.floats(0.5, 5000))
def test_wavenumber_solves_the_dispersion_relation(period: float, depth: float) -> None:
    omega = 2 * np.pi / period
    k = float(wavenumber(omega, depth))
    assert G * k * np.tanh(k * depth) == pytest.approx(omega**2, rel=1e-12)


@pytest.mark.parametrize("change", [CHANGE[:0], CHANGE])
def test_velocity_is_the_textbooks(change: Floats) -> None:
    ocean = shearing_sea(change=change)
    points = np.random.default_rng(0).uniform([-50, -50, -12], [50, 50, 0], (20, 3))
    for t in (0.0, 3.7, 40.0, 71.0, 812.0):
        expected = [textbook_velocity(ocean, p, t) for p in points]
        np.testing.assert_allclose(ocean.velocity(points, t), expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("change", [CHANGE[:0], CHANGE])
@pytest.mark.parametrize("heights", [(-8.0, -2.0), (0.01, 0.5)])
def test_flow_derivatives_are_those_of_the_velocity(
    heights: tuple[float, float], change: Floats
) -> None:
    """Below the still surface and above it, where the waves' velocity is held."""
    ocean = shearing_sea(change=change)
    rng = np.random.default_rng(2)
    h = 1e-4
    for _ in range(10):
        p, t = rng.uniform([-50, -50, heights[0]], [50, 50, heights[1]]), float(rng.uniform(0, 100))
        v, e = rng.normal(size=3), rng.normal(size=3)
        e /= np.linalg.norm(e)

        def u(offset: Floats, later: float = 0.0, p: Floats = p, t: float = t) -> Floats:
            return textbook_velocity(ocean, p + offset, t + later)

        def along(offset: Floats, later: float = 0.0, e: Floats = e, u: object = u) -> Floats:
            return np.asarray((u(offset + h * e, later) - u(offset - h * e, later)) / (2 * h))  # type: ignore[operator]

        args = (sea_at(ocean.environment, t), tuple(p), tuple(v), tuple(e))
        velocity, change, gradient, along_change, _ = (np.array(part) for part in flow(*args))
        np.testing.assert_allclose(velocity, u(np.zeros(3)), atol=1e-12)
        np.testing.assert_allclose(change, (u(h * v, h) - u(-h * v, -h)) / (2 * h), atol=1e-6)
        differences = [(u(h * axis) - u(-h * axis)) / (2 * h) for axis in np.eye(3)]
        np.testing.assert_allclose(gradient, np.array(differences).T, atol=1e-6)
        np.testing.assert_allclose(
            along_change, (along(h * v, h) - along(-h * v, -h)) / (2 * h), atol=1e-5
        )
        if heights[1] < 0:
            assert abs(np.trace(gradient)) < 1e-12


@pytest.mark.parametrize("spread", [0.0, 0.4])
@pytest.mark.parametrize("depth", [3.0, 12.0, 200.0])
def test_flow_is_that_of_the_potential(spread: float, depth: float) -> None:
    """To rounding, in long-crested and in short-crested seas."""
    waves = Waves.jonswap(
        np.random.default_rng(4),
        significant_height_m=0.3,
        peak_period_s=3.0,
        direction_rad=2.5,
        spread_rad=spread,
        floor_depth_m=depth,
    )
    ocean = Ocean(floor_depth_m=depth, waves=waves)
    assert ocean.environment.waves.one_way == (spread == 0.0)
    rng = np.random.default_rng(5)
    for _ in range(20):
        place = rng.uniform([-50, -50, -depth], [50, 50, 0])
        velocity, axis = rng.normal(size=(2, 3))
        t = float(rng.uniform(0.0, 100.0))
        actual = flow(sea_at(ocean.environment, t), tuple(place), tuple(velocity), tuple(axis))
        expected = potential_flow(waves, depth, place, velocity, axis, t)
        for term, exact in zip(actual, expected, strict=True):
            np.testing.assert_allclose(term, exact, rtol=0.0, atol=2e-13)


def test_waves_run_one_way_whatever_their_length_and_rounding() -> None:
    """Also a single one of a sea that spreads; opposite ones run two ways."""
    rng = np.random.default_rng(6)
    for direction in rng.uniform(0.0, 2 * np.pi, 20):
        sea = {"significant_height_m": 0.5, "peak_period_s": 4.0, "direction_rad": direction}
        assert Ocean(waves=Waves.jonswap(rng, **sea)).environment.waves.one_way
        single = Waves.jonswap(rng, **sea, spread_rad=0.5, n_components=1)
        assert Ocean(waves=single).environment.waves.one_way
    both_ways = Waves(
        amplitude_m=np.full(2, 0.1),
        wavenumber_1_m=np.array([[0.3, 0.4], [-0.3, -0.4]]),
        omega_rad_s=np.full(2, 2.2),
        phase_rad=np.zeros(2),
    )
    assert not Ocean(waves=both_ways).environment.waves.one_way


def test_a_linear_ramp_of_the_current_is_uniform_acceleration() -> None:
    """0.4 m/s more in 200 s: velocity, acceleration and displacement are those of uniform
    acceleration, at every depth.
    """
    ocean = Ocean(added_current=np.array([[0.0, 0.1, 0.0], [200.0, 0.5, 0.0]]))
    points = np.array([[3.0, 4.0, -2.0], [9.0, -9.0, -20.0]])
    for t, speed, acceleration, displacement in (
        (0.0, 0.1, 0.002, 0.0),
        (50.0, 0.2, 0.002, 7.5),
        (300.0, 0.5, 0.0, 110.0),
    ):
        np.testing.assert_allclose(ocean.velocity(points, t), [[speed, 0, 0]] * 2, atol=1e-15)
        np.testing.assert_allclose(
            np.array([acceleration_of(ocean, point, t) for point in points]),
            [[acceleration, 0, 0]] * 2,
            atol=1e-15,
        )
        assert ocean.environment.current.at_time(t).drift.displacement == pytest.approx(
            (displacement, 0.0), abs=1e-12
        )


def test_elevation_is_carried_along_with_a_changing_current() -> None:
    still, carried = shearing_sea(), shearing_sea(change=CHANGE)
    displacement = carried_displacement(71.0)
    assert carried.environment.current.at_time(71.0).drift.displacement == pytest.approx(
        tuple(displacement), rel=1e-12
    )
    x, y = np.array([0.0, 7.0, -30.0]), np.array([5.0, 5.0, 2.0])
    np.testing.assert_allclose(
        elevation(carried, x + displacement[0], y + displacement[1], 71.0),
        elevation(still, x, y, 71.0),
        atol=1e-12,
    )


def test_no_water_passes_the_floor() -> None:
    ocean = shearing_sea()
    points = np.column_stack(
        [np.random.default_rng(3).uniform(-50, 50, (20, 2)), np.full(20, -ocean.floor_depth_m)]
    )
    np.testing.assert_allclose(ocean.velocity(points, 7.0)[:, 2], 0.0, atol=1e-15)


@pytest.mark.parametrize("z", [0.0, -0.5, -20.0, -180.0, -400.0, -4000.0])
def test_in_deep_water_orbits_are_circles_that_shrink_with_depth(z: float) -> None:
    """The speed is a ω exp(kz); with waves 1.6 m long over 4 km of water, the hyperbolic functions
    of finite depth would overflow.
    """
    ocean = Ocean(
        floor_depth_m=4000.0,
        waves=Waves.regular(height_m=0.05, period_s=1.0, phase_rad=0.3, floor_depth_m=4000.0),
    )
    omega, t = 2 * np.pi, 0.4
    k = omega**2 / G
    speed = 0.025 * omega * np.exp(k * z)
    theta = k * 2.0 - omega * t + 0.3
    expected = speed * np.array([0.0, np.cos(theta), np.sin(theta)])
    np.testing.assert_allclose(
        ocean.velocity(np.array([[5.0, 2.0, z]]), t)[0], expected, rtol=1e-9, atol=1e-290
    )
    flow_terms = flow(sea_at(ocean.environment, t), (5.0, 2.0, z), (0.1, 0.2, 0.3), (0.0, 0.6, 0.8))
    np.testing.assert_allclose(flow_terms[0], expected, rtol=1e-9, atol=1e-290)
    assert all(np.isfinite(term).all() for term in flow_terms)


@pytest.mark.parametrize("z", [-4.0, 0.2])
def test_axis_acceleration_gradient_is_that_of_the_linear_acceleration(z: float) -> None:
    """In small waves without current, particles accelerate by ∂u/∂t alone."""
    waves = Waves.regular(
        height_m=0.1, period_s=4.0, direction_rad=1.2, phase_rad=0.4, floor_depth_m=12.0
    )
    ocean = Ocean(floor_depth_m=12.0, waves=waves)
    p, e, t, h = np.array([3.0, -2.0, z]), np.array([0.6, 0.0, 0.8]), 2.3, 1e-3

    def rate(q: Floats) -> Floats:
        return np.asarray(
            (textbook_velocity(ocean, q, t + h) - textbook_velocity(ocean, q, t - h)) / (2 * h)
        )

    squeeze = flow(
        sea_at(ocean.environment, t), tuple(p), (0.0, 0.0, 0.0), tuple(e)
    ).axis_acceleration_gradient  # type: ignore[arg-type]
    np.testing.assert_allclose(squeeze, (rate(p + h * e) - rate(p - h * e)) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("z", [-3.0, 0.3])
def test_acceleration_is_the_particles_own(z: float) -> None:
    ocean = shearing_sea()
    p, t, h = np.array([4.0, -7.0, z]), 11.0, 1e-4
    u = textbook_velocity(ocean, p, t)
    expected = (
        textbook_velocity(ocean, p + h * u, t + h) - textbook_velocity(ocean, p - h * u, t - h)
    ) / (2 * h)
    np.testing.assert_allclose(acceleration_of(ocean, p, t), expected, atol=1e-6)


def test_surface_moves_with_its_particles() -> None:
    """Kinematic condition at z = 0: ∂η/∂t + U·∇η = w."""
    ocean = shearing_sea()
    h, t, x, y = 1e-4, 5.0, 3.0, 4.0
    time_rate = (elevation(ocean, x, y, t + h) - elevation(ocean, x, y, t - h)) / (2 * h)
    slope_x = (elevation(ocean, x + h, y, t) - elevation(ocean, x - h, y, t)) / (2 * h)
    slope_y = (elevation(ocean, x, y + h, t) - elevation(ocean, x, y - h, t)) / (2 * h)
    current = 0.6 * np.array([np.sin(2.0), np.cos(2.0)])
    vertical = textbook_velocity(ocean, np.array([x, y, 0.0]), t)[2]
    assert time_rate + current @ [slope_x, slope_y] == pytest.approx(vertical, abs=1e-6)


def test_above_the_still_surface_waves_move_as_on_it() -> None:
    waves = Waves.regular(height_m=0.5, period_s=4.0)
    on, above = Ocean(waves=waves).velocity(np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.3]]), 1.0)
    np.testing.assert_array_equal(on, above)


@pytest.mark.parametrize("height", [0.0, 0.5])
def test_the_velocity_alone_is_that_of_the_flow(height: float) -> None:
    """In and above the sea, and below its floor."""
    waves = Waves.none()
    if height > 0.0:
        waves = Waves.jonswap(
            np.random.default_rng(2), significant_height_m=height, peak_period_s=5.0, spread_rad=0.4
        )
    ocean = Ocean(
        current_speed_m_s=0.8,
        current_shear_1_s=0.02,
        added_current=np.array([[0.0, 0.0, 0.0], [10.0, 0.2, -0.1]]),
        waves=waves,
    )
    instant = sea_at(ocean.environment, 7.0)
    for z in (-8.0, 0.3, -90.0):
        whole_flow = flow(instant, (3.0, -20.0, z), (1.0, 0.5, -0.2), (0.6, 0.8, 0.0))
        assert velocity_of_water(instant, (3.0, -20.0, z)) == whole_flow.velocity


@pytest.mark.parametrize(("depth", "speed"), [(0.0, 0.8), (10.0, 0.6), (40.0, 0.0)])
def test_current_shears_with_depth(depth: float, speed: float) -> None:
    """0.8 m/s towards the south-east, losing 0.02 m/s per metre."""
    ocean = Ocean(
        current_speed_m_s=0.8, current_direction_rad=np.radians(135), current_shear_1_s=0.02
    )
    expected = speed * np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0])
    np.testing.assert_allclose(
        ocean.velocity(np.array([[5.0, 6.0, -depth]]), 3.0)[0], expected, atol=1e-15
    )


def test_water_without_current_and_waves_rests() -> None:
    points = np.array([[0.0, 0.0, -3.0], [9.0, 9.0, -30.0]])
    np.testing.assert_array_equal(Ocean().velocity(points, 7.0), 0.0)
    np.testing.assert_array_equal(elevation(Ocean(), np.zeros((2, 3)), 0.0, 1.0), np.zeros((2, 3)))


def test_jonswap_sea_has_its_significant_height() -> None:
    height, period = 0.5, 4.0
    waves = Waves.jonswap(
        np.random.default_rng(5), significant_height_m=height, peak_period_s=period
    )
    environment = Ocean(waves=waves).environment
    series = np.array(
        [elevation_at(sea_at(environment, t), 0.0, 0.0) for t in np.arange(0, 20000, 0.5)]
    )
    assert 4 * series.std() == pytest.approx(height, rel=0.02)


def jonswap(w: Floats, height: float, period: float, gamma: float) -> Floats:
    """Spectral density [m² s] (DNV-RP-C205, Section 3.5.5), its normalisation good to 1 … 2 %."""
    peak = 2 * np.pi / period
    bell = np.exp(-((w - peak) ** 2) / (2 * np.where(w <= peak, 0.07, 0.09) ** 2 * peak**2))
    scale = (1 - 0.287 * np.log(gamma)) * 5 / 16 * height**2 * peak**4
    return np.asarray(scale * w**-5 * np.exp(-1.25 * (peak / w) ** 4) * gamma**bell)


@pytest.mark.parametrize("gamma", [1.0, 3.3, 7.0])
@pytest.mark.parametrize("n", [1, 40, 100])
def test_energy_of_the_sea_is_jonswaps_up_to_any_frequency(n: int, gamma: float) -> None:
    """No bin holds more than 2/n of the energy, so that no cumulative share can be further off
    than that.
    """
    height, period = 0.5, 4.0
    edges = 2 * np.pi / period * np.linspace(0.6, 3.0, 25)
    total = quad(
        jonswap,
        edges[0],
        edges[-1],
        (height, period, gamma),
        points=[2 * np.pi / period],
        limit=200,
    )[0]
    spectrum_shares = [
        quad(jonswap, a, b, (height, period, gamma))[0] / total for a, b in pairwise(edges)
    ]
    for seed in range(5):
        waves = Waves.jonswap(
            np.random.default_rng(seed),
            significant_height_m=height,
            peak_period_s=period,
            peakedness=gamma,
            n_components=n,
        )
        energy = waves.amplitude_m**2 / 2
        assert 4 * np.sqrt(energy.sum()) == pytest.approx(height, rel=1e-12)
        simulated_shares = np.histogram(waves.omega_rad_s, edges, weights=energy / energy.sum())[0]
        np.testing.assert_allclose(
            np.cumsum(simulated_shares), np.cumsum(spectrum_shares), atol=2 / n + 1e-6
        )


def test_bands_of_the_default_sea_have_their_energy() -> None:
    """Over many seas the energy of a band is right on average, and in a single sea to a tenth or
    so near the peak.
    """
    height, period, gamma = 0.5, 4.0, 3.3
    peak = 2 * np.pi / period
    edges = peak * np.array([0.6, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.7, 2.2, 3.0])
    spectrum_energies = np.array(
        [quad(jonswap, a, b, (height, period, gamma))[0] for a, b in pairwise(edges)]
    )
    seas = [
        Waves.jonswap(np.random.default_rng(s), significant_height_m=height, peak_period_s=period)
        for s in range(200)
    ]
    band_energies = np.array(
        [np.histogram(w.omega_rad_s, edges, weights=w.amplitude_m**2 / 2)[0] for w in seas]
    )
    relative_errors = (
        band_energies
        / band_energies.sum(1, keepdims=True)
        / (spectrum_energies / spectrum_energies.sum())
        - 1
    )
    np.testing.assert_allclose(relative_errors.mean(0), 0.0, atol=0.04)
    assert np.sqrt(np.mean(relative_errors[:, 2:] ** 2, axis=0)).max() < 0.06
    # the published normalisation is itself an approximation of 1 … 2 %
    np.testing.assert_allclose(band_energies.mean(0).sum(), spectrum_energies.sum(), rtol=0.03)


def test_sea_is_a_function_of_its_seed() -> None:
    first, same, other = (
        Waves.jonswap(np.random.default_rng(s), significant_height_m=0.5, peak_period_s=4.0)
        for s in (7, 7, 8)
    )
    assert first.phase_rad.tobytes() == same.phase_rad.tobytes()
    assert first.amplitude_m.tobytes() == same.amplitude_m.tobytes()
    assert first.phase_rad.tobytes() != other.phase_rad.tobytes()


def test_too_high_a_regular_wave_is_refused() -> None:
    """They break at a seventh of their length (Miche), in deep water 0.142 g T² / 2π."""
    highest = 0.142 * 9.80665 * 3.0**2 / (2.0 * np.pi)
    with pytest.raises(ValueError, match=rf"expected 0 to {highest:.3f} m, above which waves"):
        Waves.regular(height_m=3.0, period_s=3.0)


def test_wave_components_have_the_set_directional_spread() -> None:
    """The tolerances are five standard errors of the mean and of the standard deviation of 2000
    normal directions.
    """
    n, spread = 2000, 0.3
    waves = Waves.jonswap(
        np.random.default_rng(3),
        significant_height_m=0.5,
        peak_period_s=5.0,
        direction_rad=1.0,
        spread_rad=spread,
        n_components=n,
    )
    towards = np.arctan2(*waves.wavenumber_1_m.T)
    assert abs(towards.mean() - 1.0) < 5 * spread / np.sqrt(n)
    assert towards.std() == pytest.approx(spread, rel=5 / np.sqrt(2 * n))
