"""Rays that bend, against closed forms and an independent integration of the ray equations."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import PchipInterpolator
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn_sim.cli.main import app
from sim.water.floors import LevelFloor
from sim.water.rays import Path as SoundPath
from sim.water.refraction import Extent, RefractedRays, refracted_rays, traced_rays
from sim.water.smooth_profile import SmoothProfile, mean_slowness, speed_and_gradient

PAIRS = 400
MAX_RANGE_M = 200.0
_DIRECT, _SURFACE, _BOTTOM = map(int, SoundPath)


def linear_time(
    source_speed: float,
    receiver_speed: float,
    gradient: float,
    horizontal: float,
    depth_difference: float,
) -> float:
    """Travel time where the speed of sound is linear in depth: along an arc of a circle."""
    square = gradient**2 * (horizontal**2 + depth_difference**2)
    return math.acosh(1.0 + square / (2.0 * source_speed * receiver_speed)) / abs(gradient)


def thermocline(depth: Floats, strength: float = 22.5) -> Floats:
    """Speed of sound of summer water over winter water [m/s]."""
    return np.asarray(1457.5 - strength * np.tanh((depth - 17.5) / 4.0))


def summer_points() -> Floats:
    depth = np.arange(0.0, 40.01, 0.25)
    return np.column_stack([depth, thermocline(depth)])


def random_positions(seed: int, deepest: float) -> tuple[Floats, Floats]:
    """East, north and up of sources and receivers, at most 200 m apart."""
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(0.0, 2.0 * np.pi, PAIRS)
    horizontal = rng.uniform(0.0, 0.995 * MAX_RANGE_M, PAIRS)
    up = -rng.uniform(0.0, 0.995 * deepest, (2, PAIRS))
    sources = np.column_stack([np.full(PAIRS, 30.0), np.full(PAIRS, -20.0), up[0]])
    offset = np.column_stack(
        [horizontal * np.sin(bearing), horizontal * np.cos(bearing), up[1] - up[0]]
    )
    return sources, sources + offset


def horizontal_distance(source: Floats, receiver: Floats) -> float:
    return math.hypot(receiver[0] - source[0], receiver[1] - source[1])


def time_by_table(rays: RefractedRays, path: int, source: Floats, receiver: Floats) -> float:
    """Time as missions take it: by the table."""
    a, b = tuple(source.tolist()), tuple(receiver.tolist())
    apparent = rays.apparent_source(path, a, b)
    return math.dist(apparent, b) * float(rays.slowness(path, a, b))


def integrated_rays(
    sources: Floats, horizontal: Floats, departure: Floats
) -> tuple[Floats, Floats]:
    """Depths and times at which rays with these angles of departure, positive downwards, reach
    these horizontal distances: integrated over the range by Snell's law, in the formula of the
    thermocline, without surface or floor.
    """
    n = len(sources)

    def rate(_: float, state: Floats) -> Floats:
        depth, angle, _time = state.reshape(3, n)
        speed = thermocline(depth)
        gradient = -22.5 / 4.0 / np.cosh((depth - 17.5) / 4.0) ** 2
        # d(angle)/ds = −c'/c cos(angle), dr = ds cos(angle)
        path_length = horizontal / np.cos(angle)
        return np.concatenate(
            [
                horizontal * np.tan(angle),
                -gradient / speed * horizontal * np.ones(n),
                path_length / speed,
            ]
        )

    start = np.concatenate([-sources[:, 2], departure, np.zeros(n)])
    end = solve_ivp(rate, (0.0, 1.0), start, rtol=1e-10, atol=1e-11, method="DOP853").y[:, -1]
    depth, _, time = end.reshape(3, n)
    return depth, time


@pytest.fixture(scope="module")
def summer() -> RefractedRays:
    return refracted_rays(
        summer_points(), LevelFloor(40.0), Extent(40.0, MAX_RANGE_M), surface_echoes=True
    )


@pytest.mark.system
@pytest.mark.parametrize("gradient", [0.8, -0.35])
def test_times_are_those_of_arcs_of_circles_where_the_speed_is_linear(gradient: float) -> None:
    speed = 1450.0 + gradient * np.array([0.0, 60.0])
    rays = refracted_rays(
        [[0.0, speed[0]], [60.0, speed[1]]],
        LevelFloor(60.0),
        Extent(60.0, MAX_RANGE_M),
        surface_echoes=False,
    )
    errors = []
    for source, receiver in zip(*random_positions(1, 60.0), strict=True):
        source_speed, receiver_speed = (
            1450.0 - gradient * source[2],
            1450.0 - gradient * receiver[2],
        )
        horizontal = horizontal_distance(source, receiver)
        expected = linear_time(
            source_speed, receiver_speed, gradient, horizontal, receiver[2] - source[2]
        )
        traced = rays.ray(_DIRECT, tuple(source.tolist()), tuple(receiver.tolist())).time
        if math.isnan(traced):
            # the arc would leave the water, as its highest or lowest point is beyond a boundary
            continue
        errors.append(
            [traced - expected, time_by_table(rays, _DIRECT, source, receiver) - expected]
        )
    assert len(errors) > 0.9 * PAIRS
    traced, tabled = 1500.0 * np.abs(errors).T
    assert traced.max() < 1e-6
    assert tabled.max() < 1e-3


@pytest.mark.system
def test_rays_through_a_thermocline_arrive_as_integrated_independently(
    summer: RefractedRays,
) -> None:
    sources, receivers = random_positions(2, 40.0)
    rays = [
        summer.ray(_DIRECT, tuple(a.tolist()), tuple(b.tolist()))
        for a, b in zip(sources, receivers, strict=True)
    ]
    departure = np.array([ray.departure for ray in rays])
    horizontal = np.array(
        [horizontal_distance(a, b) for a, b in zip(sources, receivers, strict=True)]
    )
    # near the vertical, range is no variable to integrate over
    chosen = np.isfinite(departure) & (np.abs(departure) < np.deg2rad(80.0))
    assert chosen.mean() > 0.8
    depth, time = integrated_rays(sources[chosen], horizontal[chosen], departure[chosen])
    np.testing.assert_allclose(depth, -receivers[chosen, 2], atol=1e-2)
    traced = np.array([ray.time for ray in rays])[chosen]
    assert 1500.0 * np.abs(traced - time).max() < 1e-3
    tabled = [time_by_table(summer, _DIRECT, a, b) for a, b in zip(sources, receivers, strict=True)]
    assert 1500.0 * np.abs(np.array(tabled)[chosen] - time).max() < 1e-3
    # sound is never later than along the straight line
    straight = [
        math.dist(a, b) * float(summer.straight_slowness(_DIRECT, tuple(a), tuple(b)))
        for a, b in zip(sources.tolist(), receivers.tolist(), strict=True)
    ]
    assert (np.array(tabled) - straight)[chosen].max() < 1e-7


@pytest.mark.system
def test_both_directions_take_equal_times_and_angles(summer: RefractedRays) -> None:
    for source, receiver in zip(*random_positions(3, 40.0), strict=True):
        a, b = tuple(source.tolist()), tuple(receiver.tolist())
        forward, reverse = summer.ray(_DIRECT, a, b), summer.ray(_DIRECT, b, a)
        assert forward.time == pytest.approx(reverse.time, abs=1e-12)
        assert forward.departure == pytest.approx(-reverse.elevation, abs=1e-9)
        forward_times = (time_by_table(summer, p, source, receiver) for p in (_DIRECT, _SURFACE))
        reverse_times = (time_by_table(summer, p, receiver, source) for p in (_DIRECT, _SURFACE))
        for forward_time, reverse_time in zip(forward_times, reverse_times, strict=True):
            assert 1500.0 * abs(forward_time - reverse_time) < 1e-5


def test_a_profile_is_the_monotone_cubic_through_its_points() -> None:
    points = np.array([[0, 1480], [6, 1481], [12, 1478], [18, 1438], [21, 1438], [30, 1436.5]])
    profile = SmoothProfile.through(points)
    cubic = PchipInterpolator(*points.T)
    for depth in np.linspace(0.0, 30.0, 61).tolist():
        speed, gradient, _ = speed_and_gradient(profile, depth, 0)
        assert speed == pytest.approx(float(cubic(depth)), abs=1e-9)
        assert gradient == pytest.approx(float(cubic.derivative()(depth)), abs=1e-9)
    for upper, lower in ((2.0, 29.0), (29.0, 2.0), (13.0, 13.5), (15.0, 15.0)):
        mean = 1.0 / cubic(upper)
        if upper != lower:
            integral = quad(lambda z: 1.0 / cubic(z), upper, lower, epsabs=1e-15, limit=200)
            mean = integral[0] / (lower - upper)
        assert mean_slowness(profile, upper, lower) == pytest.approx(float(mean), rel=1e-10)
    # beyond its ends the gradient fades without a jump, and the speed stays
    beyond_the_end = [speed_and_gradient(profile, z, 0)[:2] for z in (30.0, 30.001, 35.0, 60.0)]
    assert beyond_the_end[0] == pytest.approx(beyond_the_end[1], abs=1e-3)
    assert beyond_the_end[2] == pytest.approx(beyond_the_end[3], abs=1e-9)
    assert beyond_the_end[3][1] == 0.0


@pytest.mark.parametrize(
    ("depths", "errors_mm"),
    [
        ((8.0, 20.0), {50: -23, 100: -138, 200: -608}),
        ((16.0, 16.0), {50: -50, 100: -275, 200: -1021}),
        ((20.0, 20.0), {50: -46, 100: -502, 200: -2440}),
    ],
)
def test_range_errors_in_a_strong_thermocline_are_those_of_another_computation(
    summer: RefractedRays, depths: tuple[float, float], errors_mm: dict[int, int]
) -> None:
    # range by the mean slowness of the straight line, less the true one, in mm; computed beside
    # this project by layers of constant gradient
    for horizontal, error_mm in errors_mm.items():
        source = np.array([0.0, 0.0, -depths[0]])
        receiver = np.array([float(horizontal), 0.0, -depths[1]])
        time = time_by_table(summer, _DIRECT, source, receiver)
        straight = summer.straight_slowness(_DIRECT, tuple(source), tuple(receiver))
        assert 1e3 * (time / straight - math.dist(source, receiver)) == pytest.approx(
            error_mm, abs=1
        )


def test_no_direct_ray_beyond_the_one_that_grazes_the_surface() -> None:
    # rays are arcs of a circle of radius c₀ / |g| about a depth below; one that grazes the surface
    # is the last to arrive
    gradient, speed = -0.5, 1500.0
    rays = traced_rays([[0.0, speed], [100.0, speed + 100.0 * gradient]], LevelFloor(100.0))
    radius = speed / abs(gradient)
    depths = (2.0, 5.0)
    grazing_range = sum(math.sqrt(radius**2 - (radius - depth) ** 2) for depth in depths)
    source = (0.0, 0.0, -depths[0])
    for relative_range, arrives in ((0.5, True), (0.99, True), (1.01, False), (1.3, False)):
        receiver = (relative_range * grazing_range, 0.0, -depths[1])
        assert math.isfinite(rays.ray(_DIRECT, source, receiver).time) == arrives
        assert math.isfinite(rays.slowness(_DIRECT, source, receiver)) == arrives
        assert len(rays.rays(_DIRECT, source, receiver)) == arrives


def test_echoes_are_direct_rays_to_the_image_where_the_speed_is_constant() -> None:
    rays = traced_rays([[0.0, 1480.0], [30.0, 1480.0]], LevelFloor(30.0))
    source, receiver = (0.0, 0.0, -4.0), (60.0, 25.0, -12.0)
    for path, image, departure in ((_SURFACE, 4.0, -1.0), (_BOTTOM, -56.0, 1.0)):
        ray = rays.ray(path, source, receiver)
        length = math.dist((0.0, 0.0, image), receiver)
        angle = math.asin(abs(image + 12.0) / length)
        assert ray.time == pytest.approx(length / 1480.0, abs=1e-12)
        assert ray.departure == pytest.approx(departure * angle, abs=1e-9)
        assert ray.elevation == pytest.approx(-departure * angle, abs=1e-9)
        assert rays.slowness(path, source, receiver) == pytest.approx(1.0 / 1480.0, rel=1e-10)


def test_a_channel_has_three_rays_to_a_receiver_on_its_axis() -> None:
    # 1/c² = (1 − ε y²) / c₀² about an axis: rays oscillate about it, and half an oscillation ends
    # at the distance p π / √ε, p the cosine of the angle on the axis
    root_epsilon = 0.005  # √ε [1/m]
    depth = np.arange(0.0, 100.1, 1.0)
    speed = 1500.0 / np.sqrt(1.0 - (root_epsilon * (depth - 50.0)) ** 2)
    rays = traced_rays(np.column_stack([depth, speed]), LevelFloor(100.0))
    axis = (0.0, 0.0, -50.0)
    assert len(rays.rays(_DIRECT, axis, (500.0, 0.0, -50.0))) == 1
    rays_to_receiver = rays.rays(_DIRECT, axis, (615.0, 0.0, -50.0))
    departure_angle = math.acos(615.0 * root_epsilon / math.pi)
    departures = np.array(sorted(ray.departure for ray in rays_to_receiver))
    np.testing.assert_allclose(departures[[0, -1]], [-departure_angle, departure_angle], atol=1e-4)
    # a cubic through points a metre apart has another curvature at its very minimum
    assert np.abs(departures[1:-1]).max() < 0.005
    assert 0.0 in departures.round(9)
    assert [ray.time for ray in rays_to_receiver] == sorted(ray.time for ray in rays_to_receiver)


TOML = """
motion = "kinematic"
duration_s = 20
[ocean]
floor_depth_m = 40.0
[acoustics]
rays = "refracted"
sound_speed_m_s = 1460.0
sound_speed_profile = [[0, 1484], [40, 1444]]
range_tau_m = [0.0, 0.0, 0.0]
range_scale_mean_m = 0.0
range_scale_sigma_m = 0.0
[navigation]
sound_speed = "{assumed}"
[leader]
depth_m = 8.0
waypoints = [[0, 0, 0], [20, 0, 20]]
[[followers]]
depth_m = 20.0
waypoints = [[0, 90, 0], [20, 90, 20]]
"""


@pytest.mark.system
@pytest.mark.parametrize("assumed", ["mean", "straight", "profile"])
def test_a_mission_measures_the_travel_times_of_bent_rays(tmp_path: Path, assumed: str) -> None:
    file = tmp_path / "summer.toml"
    file.write_text(TOML.format(assumed=assumed))
    flight = laisn_sim.fly(file)
    measured = flight.measurements[0]
    middle_ranges = measured.ranges[:, 2]
    assert len(middle_ranges) > 2
    # both go north side by side; the middle transmitter is beside the leader's axis
    middle_transmitter = flight.trajectory.site_offset[flight.trajectory.site("leader/tx_middle")]
    hydrophone = flight.trajectory.site_offset[flight.trajectory.site("follower/hydrophone")]
    horizontal = math.hypot(
        90.0 + middle_transmitter[1] - hydrophone[1], hydrophone[0] - middle_transmitter[0]
    )
    source_depth, receiver_depth = 8.0 - middle_transmitter[2], 20.0 - hydrophone[2]
    time = linear_time(
        1484.0 - source_depth,
        1484.0 - receiver_depth,
        -1.0,
        horizontal,
        receiver_depth - source_depth,
    )
    slowness = math.log((1484.0 - source_depth) / (1484.0 - receiver_depth)) / (
        receiver_depth - source_depth
    )
    expected = {
        "mean": 1460.0 * time,
        "straight": time / slowness,
        "profile": math.hypot(horizontal, receiver_depth - source_depth),
    }[assumed]
    np.testing.assert_allclose(middle_ranges, expected, atol=1e-3)
    assert (
        abs(expected - math.hypot(horizontal, receiver_depth - source_depth)) > 0.01
        or assumed == "profile"
    )


def test_check_warns_of_shadows(tmp_path: Path) -> None:
    file = tmp_path / "shadow.toml"
    text = TOML.format(assumed="mean").replace("depth_m = 8.0", "depth_m = 1.0")
    text = text.replace("depth_m = 20.0", "depth_m = 1.0").replace("90,", "500,")
    file.write_text(text)
    result = CliRunner().invoke(app, ["check", str(file)])
    assert result.exit_code == 0, result.output
    assert "no direct ray" in result.output


def arrival_where_linear(
    source_depth: float, receiver_depth: float, gradient: float, horizontal: float
) -> float:
    """Angle at which the ray arrives at the second depth, positive from above, where the speed is
    1484 m/s and changes by `gradient`: it is an arc about a point at the depth where the speed
    would be 0.
    """
    depth_without_speed = -1484.0 / gradient
    # the centre of the circle is as far from both ends
    centre_range = 0.5 * (
        horizontal
        + ((receiver_depth - depth_without_speed) ** 2 - (source_depth - depth_without_speed) ** 2)
        / horizontal
    )
    # the ray is perpendicular to the radius
    return math.atan(-(horizontal - centre_range) / (receiver_depth - depth_without_speed))


@pytest.mark.system
@pytest.mark.parametrize("rays", ["refracted", "straight"])
def test_an_inverted_usbl_sees_the_leader_where_the_ray_comes_from(
    tmp_path: Path, rays: str
) -> None:
    file = tmp_path / "summer.toml"
    text = TOML.format(assumed="mean").replace('rays = "refracted"', f'rays = "{rays}"')
    without_noise = "azimuth_sigma_deg = 0.0\nelevation_sigma_deg = 0.0\n"
    file.write_text(f'{text}[[sensors.custom]]\nsensor = "inverted-usbl"\n{without_noise}')
    flight = laisn_sim.fly(file)
    measured = flight.measurements[0]
    azimuth, elevation = measured.custom["bearing"][measured.message_step - 1].T
    trajectory = flight.trajectory
    front_transmitter = trajectory.site_offset[trajectory.site("leader/tx_front")]
    hydrophone = trajectory.site_offset[trajectory.site("follower/hydrophone")]
    # both go north side by side, level: forward and port are north and west
    horizontal = math.hypot(
        90.0 + front_transmitter[1] - hydrophone[1], front_transmitter[0] - hydrophone[0]
    )
    source_depth, receiver_depth = 8.0 - front_transmitter[2], 20.0 - hydrophone[2]
    bent = arrival_where_linear(source_depth, receiver_depth, -1.0, horizontal)
    straight = math.atan2(receiver_depth - source_depth, horizontal)
    assert abs(bent - straight) > 0.01
    expected = bent if rays == "refracted" else straight
    np.testing.assert_allclose(elevation, expected, atol=1e-5)
    expected_azimuth = math.atan2(
        -(90.0 + front_transmitter[1] - hydrophone[1]), front_transmitter[0] - hydrophone[0]
    )
    np.testing.assert_allclose(azimuth, expected_azimuth, atol=1e-6)
