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
REACH_M = 200.0
_DIRECT, _SURFACE, _BOTTOM = map(int, SoundPath)


def linear_time(first: float, second: float, gradient: float, reach: float, drop: float) -> float:
    """Travel time where the speed of sound is linear in depth: along an arc of a circle."""
    square = gradient**2 * (reach**2 + drop**2)
    return math.acosh(1.0 + square / (2.0 * first * second)) / abs(gradient)


def thermocline(depth: Floats, strength: float = 22.5) -> Floats:
    """Speed of sound of summer water over winter water [m/s]."""
    return np.asarray(1457.5 - strength * np.tanh((depth - 17.5) / 4.0))


def summer_points() -> Floats:
    depth = np.arange(0.0, 40.01, 0.25)
    return np.column_stack([depth, thermocline(depth)])


def random_places(seed: int, deepest: float) -> tuple[Floats, Floats]:
    """East, north and up of sources and receivers, at most 200 m apart."""
    rng = np.random.default_rng(seed)
    towards = rng.uniform(0.0, 2.0 * np.pi, PAIRS)
    reach = rng.uniform(0.0, 0.995 * REACH_M, PAIRS)
    up = -rng.uniform(0.0, 0.995 * deepest, (2, PAIRS))
    sources = np.column_stack([np.full(PAIRS, 30.0), np.full(PAIRS, -20.0), up[0]])
    offset = np.column_stack([reach * np.sin(towards), reach * np.cos(towards), up[1] - up[0]])
    return sources, sources + offset


def reach_of(source: Floats, receiver: Floats) -> float:
    return math.hypot(receiver[0] - source[0], receiver[1] - source[1])


def tabled_time(rays: RefractedRays, path: int, source: Floats, receiver: Floats) -> float:
    """Time as missions take it: by the table."""
    a, b = tuple(source.tolist()), tuple(receiver.tolist())
    apparent = rays.apparent_source(path, a, b)
    return math.dist(apparent, b) * float(rays.slowness(path, a, b))


def integrated(sources: Floats, reach: Floats, departure: Floats) -> tuple[Floats, Floats]:
    """Depths and times at which rays that leave downwards at angles reach distances, without
    surface or floor; by range, with Snell's law in the angle, in the formula of the thermocline.
    """
    n = len(sources)

    def rate(_: float, state: Floats) -> Floats:
        depth, angle, _time = state.reshape(3, n)
        speed = thermocline(depth)
        gradient = -22.5 / 4.0 / np.cosh((depth - 17.5) / 4.0) ** 2
        # d(angle)/ds = −c'/c cos(angle), dr = ds cos(angle)
        along = reach / np.cos(angle)
        return np.concatenate(
            [reach * np.tan(angle), -gradient / speed * reach * np.ones(n), along / speed]
        )

    start = np.concatenate([-sources[:, 2], departure, np.zeros(n)])
    end = solve_ivp(rate, (0.0, 1.0), start, rtol=1e-10, atol=1e-11, method="DOP853").y[:, -1]
    depth, _, time = end.reshape(3, n)
    return depth, time


@pytest.fixture(scope="module")
def summer() -> RefractedRays:
    return refracted_rays(
        summer_points(), LevelFloor(40.0), Extent(40.0, REACH_M), surface_echoes=True
    )


@pytest.mark.system
@pytest.mark.parametrize("gradient", [0.8, -0.35])
def test_within_a_millimetre_of_arcs_of_circles_where_the_speed_is_linear(gradient: float) -> None:
    speed = 1450.0 + gradient * np.array([0.0, 60.0])
    rays = refracted_rays(
        [[0.0, speed[0]], [60.0, speed[1]]],
        LevelFloor(60.0),
        Extent(60.0, REACH_M),
        surface_echoes=False,
    )
    errors = []
    for source, receiver in zip(*random_places(1, 60.0), strict=True):
        first, second = 1450.0 - gradient * source[2], 1450.0 - gradient * receiver[2]
        reach = reach_of(source, receiver)
        true = linear_time(first, second, gradient, reach, receiver[2] - source[2])
        traced = rays.ray(_DIRECT, tuple(source.tolist()), tuple(receiver.tolist())).time
        if math.isnan(traced):
            # the arc would leave the water: its highest, or lowest, point is beyond a boundary
            continue
        errors.append([traced - true, tabled_time(rays, _DIRECT, source, receiver) - true])
    assert len(errors) > 0.9 * PAIRS
    traced, tabled = 1500.0 * np.abs(errors).T
    assert traced.max() < 1e-6
    assert tabled.max() < 1e-3


@pytest.mark.system
def test_rays_through_a_thermocline_arrive_as_integrated_independently(
    summer: RefractedRays,
) -> None:
    sources, receivers = random_places(2, 40.0)
    rays = [
        summer.ray(_DIRECT, tuple(a.tolist()), tuple(b.tolist()))
        for a, b in zip(sources, receivers, strict=True)
    ]
    departure = np.array([ray.departure for ray in rays])
    reach = np.array([reach_of(a, b) for a, b in zip(sources, receivers, strict=True)])
    # near the vertical, range is no variable to integrate over
    chosen = np.isfinite(departure) & (np.abs(departure) < np.deg2rad(80.0))
    assert chosen.mean() > 0.8
    depth, time = integrated(sources[chosen], reach[chosen], departure[chosen])
    np.testing.assert_allclose(depth, -receivers[chosen, 2], atol=1e-2)
    traced = np.array([ray.time for ray in rays])[chosen]
    assert 1500.0 * np.abs(traced - time).max() < 1e-3
    tabled = [tabled_time(summer, _DIRECT, a, b) for a, b in zip(sources, receivers, strict=True)]
    assert 1500.0 * np.abs(np.array(tabled)[chosen] - time).max() < 1e-3
    # sound is never later than along the straight line
    straight = [
        math.dist(a, b) * float(summer.straight_slowness(_DIRECT, tuple(a), tuple(b)))
        for a, b in zip(sources.tolist(), receivers.tolist(), strict=True)
    ]
    assert (np.array(tabled) - straight)[chosen].max() < 1e-7


@pytest.mark.system
def test_both_directions_take_equal_times_and_angles(summer: RefractedRays) -> None:
    for source, receiver in zip(*random_places(3, 40.0), strict=True):
        a, b = tuple(source.tolist()), tuple(receiver.tolist())
        there, back = summer.ray(_DIRECT, a, b), summer.ray(_DIRECT, b, a)
        assert there.time == pytest.approx(back.time, abs=1e-12)
        assert there.departure == pytest.approx(-back.elevation, abs=1e-9)
        by_table = (tabled_time(summer, p, source, receiver) for p in (_DIRECT, _SURFACE))
        reversed_ = (tabled_time(summer, p, receiver, source) for p in (_DIRECT, _SURFACE))
        for one, other in zip(by_table, reversed_, strict=True):
            assert 1500.0 * abs(one - other) < 1e-5


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
            whole = quad(lambda z: 1.0 / cubic(z), upper, lower, epsabs=1e-15, limit=200)
            mean = whole[0] / (lower - upper)
        assert mean_slowness(profile, upper, lower) == pytest.approx(float(mean), rel=1e-10)
    # beyond its ends the gradient fades without a jump, and the speed stays
    ends = [speed_and_gradient(profile, z, 0)[:2] for z in (30.0, 30.001, 35.0, 60.0)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)
    assert ends[2] == pytest.approx(ends[3], abs=1e-9)
    assert ends[3][1] == 0.0


@pytest.mark.parametrize(
    ("depths", "errors"),
    [
        ((8.0, 20.0), {50: -23, 100: -138, 200: -608}),
        ((16.0, 16.0), {50: -50, 100: -275, 200: -1021}),
        ((20.0, 20.0), {50: -46, 100: -502, 200: -2440}),
    ],
)
def test_figures_of_a_strong_thermocline(
    summer: RefractedRays, depths: tuple[float, float], errors: dict[int, int]
) -> None:
    # range by the mean slowness of the straight line, less the true one, in mm; computed beside
    # this project by layers of constant gradient
    for reach, error in errors.items():
        source = np.array([0.0, 0.0, -depths[0]])
        receiver = np.array([float(reach), 0.0, -depths[1]])
        time = tabled_time(summer, _DIRECT, source, receiver)
        straight = summer.straight_slowness(_DIRECT, tuple(source), tuple(receiver))
        assert 1e3 * (time / straight - math.dist(source, receiver)) == pytest.approx(error, abs=1)


def test_no_direct_ray_beyond_the_one_that_grazes_the_surface() -> None:
    # rays are arcs of a circle of radius c₀ / |g| about a depth below; one that grazes the surface
    # is the last to arrive
    gradient, speed = -0.5, 1500.0
    rays = traced_rays([[0.0, speed], [100.0, speed + 100.0 * gradient]], LevelFloor(100.0))
    radius = speed / abs(gradient)
    depths = (2.0, 5.0)
    edge = sum(math.sqrt(radius**2 - (radius - depth) ** 2) for depth in depths)
    source = (0.0, 0.0, -depths[0])
    for share, hears in ((0.5, True), (0.99, True), (1.01, False), (1.3, False)):
        receiver = (share * edge, 0.0, -depths[1])
        assert math.isfinite(rays.ray(_DIRECT, source, receiver).time) == hears
        assert math.isfinite(rays.slowness(_DIRECT, source, receiver)) == hears
        assert len(rays.rays(_DIRECT, source, receiver)) == hears


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


def test_three_rays_in_a_channel() -> None:
    # 1/c² = (1 − ε y²) / c₀² about an axis: rays swing about it, and a swing to one side ends at
    # the distance p π / √ε, p the cosine of the angle on the axis
    root = 0.005  # √ε [1/m]
    depth = np.arange(0.0, 100.1, 1.0)
    speed = 1500.0 / np.sqrt(1.0 - (root * (depth - 50.0)) ** 2)
    rays = traced_rays(np.column_stack([depth, speed]), LevelFloor(100.0))
    axis = (0.0, 0.0, -50.0)
    assert len(rays.rays(_DIRECT, axis, (500.0, 0.0, -50.0))) == 1
    actual = rays.rays(_DIRECT, axis, (615.0, 0.0, -50.0))
    swing = math.acos(615.0 * root / math.pi)
    departures = np.array(sorted(ray.departure for ray in actual))
    np.testing.assert_allclose(departures[[0, -1]], [-swing, swing], atol=1e-4)
    # a cubic through points a metre apart has another curvature at its very minimum
    assert np.abs(departures[1:-1]).max() < 0.005
    assert 0.0 in departures.round(9)
    assert [ray.time for ray in actual] == sorted(ray.time for ray in actual)


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
def test_a_mission_measures_what_bent_rays_show(tmp_path: Path, assumed: str) -> None:
    file = tmp_path / "summer.toml"
    file.write_text(TOML.format(assumed=assumed))
    flight = laisn_sim.fly(file)
    measured = flight.measurements[0]
    middle = measured.ranges[:, 2]
    assert len(middle) > 2
    # both go north side by side; the middle transmitter is beside the leader's axis
    aside = flight.trajectory.site_offset[flight.trajectory.site("leader/tx_middle")]
    hydrophone = flight.trajectory.site_offset[flight.trajectory.site("follower/hydrophone")]
    reach = math.hypot(90.0 + aside[1] - hydrophone[1], hydrophone[0] - aside[0])
    first, second = 8.0 - aside[2], 20.0 - hydrophone[2]
    time = linear_time(1484.0 - first, 1484.0 - second, -1.0, reach, second - first)
    slowness = math.log((1484.0 - first) / (1484.0 - second)) / (second - first)
    expected = {
        "mean": 1460.0 * time,
        "straight": time / slowness,
        "profile": math.hypot(reach, second - first),
    }[assumed]
    np.testing.assert_allclose(middle, expected, atol=1e-3)
    assert abs(expected - math.hypot(reach, second - first)) > 0.01 or assumed == "profile"


def test_check_warns_of_shadows(tmp_path: Path) -> None:
    file = tmp_path / "shadow.toml"
    text = TOML.format(assumed="mean").replace("depth_m = 8.0", "depth_m = 1.0")
    text = text.replace("depth_m = 20.0", "depth_m = 1.0").replace("90,", "500,")
    file.write_text(text)
    result = CliRunner().invoke(app, ["check", str(file)])
    assert result.exit_code == 0, result.output
    assert "no direct ray" in result.output


def arrival_where_linear(first: float, second: float, gradient: float, reach: float) -> float:
    """Angle at which the ray arrives at the second depth, positive from above, where the speed is
    1484 m/s and changes by `gradient`: it is an arc about a point at the depth where the speed
    would be 0.
    """
    deep = -1484.0 / gradient
    # of the circle's middle, as far from both ends
    middle = 0.5 * (reach + ((second - deep) ** 2 - (first - deep) ** 2) / reach)
    # along the ray, across the radius: downwards for each metre towards the receiver
    return math.atan(-(reach - middle) / (second - deep))


@pytest.mark.system
@pytest.mark.parametrize("rays", ["refracted", "straight"])
def test_an_inverted_usbl_sees_the_leader_where_the_ray_comes_from(
    tmp_path: Path, rays: str
) -> None:
    file = tmp_path / "summer.toml"
    text = TOML.format(assumed="mean").replace('rays = "refracted"', f'rays = "{rays}"')
    exact = "azimuth_sigma_deg = 0.0\nelevation_sigma_deg = 0.0\n"
    file.write_text(f'{text}[[sensors.custom]]\nsensor = "inverted-usbl"\n{exact}')
    flight = laisn_sim.fly(file)
    measured = flight.measurements[0]
    azimuth, elevation = measured.custom["bearing"][measured.message_step - 1].T
    sites = flight.trajectory
    front = sites.site_offset[sites.site("leader/tx_front")]
    hydrophone = sites.site_offset[sites.site("follower/hydrophone")]
    # both go north side by side, level: forward and port are north and west
    reach = math.hypot(90.0 + front[1] - hydrophone[1], front[0] - hydrophone[0])
    first, second = 8.0 - front[2], 20.0 - hydrophone[2]
    bent = arrival_where_linear(first, second, -1.0, reach)
    straight = math.atan2(second - first, reach)
    assert abs(bent - straight) > 0.01
    expected = bent if rays == "refracted" else straight
    np.testing.assert_allclose(elevation, expected, atol=1e-5)
    aside = math.atan2(-(90.0 + front[1] - hydrophone[1]), front[0] - hydrophone[0])
    np.testing.assert_allclose(azimuth, aside, atol=1e-6)
