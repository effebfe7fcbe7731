"""Density by depth out of casts, and the buoyancy that follows it."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn_sim.cli.main import app
from sim.scenario.parts import SeaSettings
from sim.scenario.vehicles import Vehicle
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.assembly import density_cast, density_of, ocean_of, trim_density
from sim.water.densities import DensityProfile
from sim.water.ocean import Ocean
from tests.sim.water.test_casts import PRESSURE, SALINITY, table

pytest.importorskip("gsw")

G = 9.81
# check values of gsw_rho, https://www.teos-10.org/pubs/gsw/html/gsw_rho.html
TEMPERATURE = [28.8099, 28.4392, 22.7862]  # conservative [°C]
DENSITY = [1021.839935738108, 1022.262457966867, 1024.427195413316]
# linear between the points
POINTS = [[0.0, 1004.0], [10.0, 1005.0], [30.0, 1011.0]]


def scenario(file: Path, density_keys: str = "", leader_keys: str = "") -> Path:
    toml = file.parent / "density.toml"
    toml.write_text(
        "duration_s = 20\n[ocean]\norigin = { lat = 4.0, lon = -172.0 }\n"
        f'[ocean.density]\nfile = "{file.name}"\n{density_keys}\n'
        f'[leader]\ndepth_m = 8.0\ntrim = "neutral"\n{leader_keys}\n'
        '[[followers]]\nroute = "T5"\ndepth_m = 20.0\ntrim = "neutral"\n'
    )
    return toml


def cast_of(folder: Path, points: list[list[float]]) -> Path:
    return table(folder / "cast.csv", "depth,density", *np.transpose(points).tolist())


def test_densities_are_the_check_values_of_teos_10(tmp_path: Path) -> None:
    header = "pressure_dbar,conservative_temperature_degC,absolute_salinity [g/kg]"
    toml = scenario(table(tmp_path / "a.csv", header, PRESSURE, TEMPERATURE, SALINITY))
    cast = density_cast(laisn_sim.load(toml).ocean)
    assert cast is not None
    np.testing.assert_allclose(cast.points[:, 1], DENSITY, atol=1e-8)
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert "ocean.density: a.csv: pressure_dbar" in result.stdout
    assert "1021.84 to 1024.43 kg/m³" in result.stdout
    assert "hulls have their trim where each starts" in result.stdout


def test_each_hull_has_its_trim_where_it_starts_or_where_a_key_says(tmp_path: Path) -> None:
    scene = laisn_sim.load(scenario(cast_of(tmp_path, POINTS)))
    assert trim_density(scene.ocean, scene.leader) == pytest.approx(1004.8, rel=1e-12)
    assert trim_density(scene.ocean, scene.followers[0]) == pytest.approx(1008.0, rel=1e-12)
    scene = laisn_sim.load(scenario(cast_of(tmp_path, POINTS), "trim_depth_m = 25.0"))
    assert trim_density(scene.ocean, scene.leader) == pytest.approx(1009.5, rel=1e-12)


def plant_at(ocean: Ocean, depth: float) -> Plant:
    settings = Vehicle.model_construct(trim="neutral")
    setup = VehicleSetup(
        name="own", model="remus100", position_m=(0.0, 0.0, -depth), settings=settings
    )
    return Plant([setup], ocean)


@pytest.mark.parametrize("depth", [5.0, 18.0, 22.0])
def test_a_hull_left_off_its_trim_rises_or_sinks_with_the_difference(depth: float) -> None:
    """The acceleration at first is B (ρ(z)/ρ(z₀) − 1) / (m + A33), the speed after 0.2 s that of a
    first-order lag by the linear damping.
    """
    trim_depth = 12.0
    profile = DensityProfile.through(POINTS)
    plant = plant_at(Ocean(density=profile, trim_depth_m=trim_depth, floor_depth_m=1000.0), depth)
    plant.step(np.zeros((1, 5)), 10)
    density = np.interp([depth, trim_depth], *np.transpose(POINTS))
    # Fossen's remus100: 31.0294 kg, added mass 29.4376 kg, linear damping 3.02335 N s/m
    excess = 31.0294 * G * (density[0] / density[1] - 1.0)
    heave_mass = 31.0294 + 29.4376
    speed = excess / 3.02335 * -np.expm1(-3.02335 / heave_mass * 0.2)
    assert plant.twist[0, 2] == pytest.approx(speed, rel=2e-3)
    assert abs(speed) > 1e-3


def test_at_its_trim_a_hull_moves_as_in_water_of_that_density() -> None:
    profile = DensityProfile.through(POINTS)
    stratified = plant_at(Ocean(density=profile, floor_depth_m=1000.0), 12.0)
    uniform = plant_at(Ocean(density_kg_m3=1005.6, floor_depth_m=1000.0), 12.0)
    for name in stratified.coefficients.dtype.names:
        np.testing.assert_allclose(stratified.coefficients[name], uniform.coefficients[name])
    stratified.step(np.zeros((1, 5)), 50)
    assert stratified.pose[0, 2] == pytest.approx(-12.0, abs=1e-9)


def test_a_hull_swings_about_its_trim_by_the_buoyancy_frequency() -> None:
    """Without damping ω² = N² m / (m + A33) of a neutral hull, N² = g/ρ dρ/dz. The linear damping d
    of a hull at rest makes it decay at d/(2 (m + A33)).
    """
    # [kg/m³ a metre], far more than in the sea, so that it swings before it rests
    density_gradient = 3.0
    profile = DensityProfile.through([[0.0, 1000.0], [100.0, 1000.0 + 100.0 * density_gradient]])
    ocean = Ocean(density=profile, trim_depth_m=50.0, floor_depth_m=1000.0)
    plant = plant_at(ocean, 50.002)
    heave_mass = 31.0294 + 29.4376
    stiffness = 31.0294 * G * density_gradient / profile.density_at(50.0)
    decay = 3.02335 / (2.0 * heave_mass)
    angular_frequency = np.sqrt(stiffness / heave_mass - decay**2)
    steps = 1500
    time = 0.02 * np.arange(1, steps + 1)
    height = np.empty(steps)
    for k in range(steps):
        plant.step(np.zeros((1, 5)))
        height[k] = plant.pose[0, 2] + 50.0
    phase = angular_frequency * time
    expected = (
        -0.002 * np.exp(-decay * time) * (np.cos(phase) + decay / angular_frequency * np.sin(phase))
    )
    np.testing.assert_allclose(height, expected, atol=2e-5)
    assert height.max() > 0.0


def test_pressure_is_the_weight_of_the_water_above() -> None:
    profile = DensityProfile.through(POINTS)
    depth = np.array([0.0, 4.0, 10.0, 20.0, 30.0, 50.0])
    fine_depth = np.linspace(0.0, 50.0, 500_001)
    density = np.interp(fine_depth, *np.transpose(POINTS))
    mass_above = np.concatenate(
        [[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(fine_depth))]
    )
    expected = G * np.interp(depth, fine_depth, mass_above)
    np.testing.assert_allclose(profile.pressures_at(depth), expected, rtol=1e-9, atol=1e-6)


def flown_poses(toml: Path, changes: dict[str, object]) -> Floats:
    return np.asarray(laisn_sim.fly(toml, changes).trajectory.pose)


@pytest.mark.system
def test_uniform_casts_fly_as_the_key_does_and_stratified_ones_differ(tmp_path: Path) -> None:
    uniform = scenario(cast_of(tmp_path, [[0.0, 1005.0], [40.0, 1005.0]]))
    by_key = flown_poses(uniform, {"ocean.density": None, "ocean.density_kg_m3": 1005.0})
    np.testing.assert_allclose(flown_poses(uniform, {}), by_key, atol=1e-9)
    # the leader dives from light into heavy water
    diving_leader = "depth_profile = [[0, 8], [5, 8], [15, 14]]"
    layered = scenario(cast_of(tmp_path, POINTS), leader_keys=diving_leader)
    scene = laisn_sim.load(layered)
    assert ocean_of(SeaSettings.of(scene)).environment.density(20.0) == pytest.approx(1008.0)
    poses_in_layers = flown_poses(layered, {})
    poses_in_uniform_water = flown_poses(
        layered, {"ocean.density": None, "ocean.density_kg_m3": 1004.8}
    )
    assert np.abs(poses_in_layers[:, 0, 2] - poses_in_uniform_water[:, 0, 2]).max() > 1e-3


@pytest.mark.parametrize(
    ("density_keys", "leader_keys", "expected"),
    [
        ("profile = 2", "", "profile = 2; it has 1 cast"),
        ("trim_depth_m = -1.0", "", "greater than or equal to 0"),
        # ballasted for the water at the surface, the hull is too buoyant below
        (
            "trim_depth_m = 0.0",
            'model = "remus100"',
            "in water 1.0135 times as dense as that of its trim it is",
        ),
    ],
)
def test_casts_and_trims_that_cannot_be_flown_are_refused(
    tmp_path: Path, density_keys: str, leader_keys: str, expected: str
) -> None:
    points = [[0.0, 1000.0], [5.0, 1000.0], [25.0, 1090.0]]
    toml = scenario(cast_of(tmp_path, points), density_keys, leader_keys)
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2, result.output
    assert expected in result.output


def test_a_cast_of_the_speed_of_sound_alone_has_no_density(tmp_path: Path) -> None:
    toml = scenario(table(tmp_path / "b.csv", "depth,sound_speed", [1.0, 9.0], [1450.0, 1449.0]))
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert result.exit_code == 2
    assert "it has no salinity, and no density; expected 'salinity'" in result.output
    with_both_keys = toml.read_text().replace("[ocean]", "[ocean]\ndensity_kg_m3 = 1005.0")
    toml.write_text(with_both_keys)
    result = CliRunner().invoke(app, ["check", str(toml)], env={"COLUMNS": "300"})
    assert "the table `density` replaces density_kg_m3" in result.output


def test_a_saved_scenario_with_a_density_reads_back(tmp_path: Path) -> None:
    scene = laisn_sim.load(scenario(cast_of(tmp_path, POINTS)))
    saved = tmp_path / "saved.toml"
    scene.save(saved)
    loaded = laisn_sim.load(saved)
    assert loaded == scene
    assert density_of(loaded.ocean).density_at(20.0) == pytest.approx(1008.0)
