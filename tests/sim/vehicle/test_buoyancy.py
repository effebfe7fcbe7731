"""Buoyancy: Archimedes' law in the density of a mission, its centre, and the trim of vehicles."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
import models
from laisn.errors import LaisnError
from laisn_sim.cli.main import app
from sim import attitude
from sim.assembly import routes_of, setups_of
from sim.scenario.parts import MissionPlan, SeaSettings
from sim.scenario.vehicles import Vehicle
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.water.assembly import ocean_of
from sim.water.ocean import Ocean
from tests.sim.vehicle.tank import Tank, hull

G = 9.81
VOLUME = {  # of the displaced water [m³]
    "leader": 67.1515 / 1026.0,
    "follower": 31.0294 / 1026.0,
    "remus100": 31.0294 / 1026.0,  # remus100.py: neutral in 1026 kg/m³
    "lauv": 0.017551375,  # gazebo.xacro
    "bluerov2_heavy": 0.0134,  # von Benzon et al. 2022, Table A1
}


def plant_of(model: str, density: float, **settings: object) -> Plant:
    setup = VehicleSetup(
        name="own",
        model=model,
        position_m=(0.0, 0.0, -50.0),
        settings=Vehicle.model_construct(**settings),
    )
    return Plant([setup], Ocean(density_kg_m3=density, floor_depth_m=1000.0))


@pytest.mark.parametrize("model", models.VEHICLES)
@pytest.mark.parametrize("density", [1000.0, 1026.0, 1030.0])
def test_buoyancy_is_the_weight_of_the_displaced_water(model: str, density: float) -> None:
    (record,) = plant_of(model, density).coefficients
    assert record["buoyancy"] == pytest.approx(density * VOLUME[model] * G, rel=1e-6)


def test_inertia_of_the_displaced_water_follows_its_density() -> None:
    records = [plant_of("remus100", density).coefficients[0] for density in (1026.0, 1000.0)]
    assert records[0]["displaced_inertia"] == 4.02777
    assert records[1]["displaced_inertia"] == pytest.approx(4.02777 * 1000.0 / 1026.0)


@pytest.mark.parametrize("density", [1000.0, 1026.0, 1030.0])
def test_a_hull_left_alone_sinks_or_rises_with_its_excess_weight(density: float) -> None:
    """Speed of (m + A33) dw/dt = B − m g − d w after 0.2 s, with the linear damping alone."""
    plant = plant_of("remus100", density)
    plant.step(np.zeros((1, 5)), 10)
    excess = density * VOLUME["remus100"] * G - 31.0294 * G
    # Fossen's remus100: added mass 29.4376 kg, linear damping 3.02335 N s/m
    mass_and_added_mass = 31.0294 + 29.4376
    speed = excess / 3.02335 * -np.expm1(-3.02335 / mass_and_added_mass * 0.2)
    assert plant.twist[0, 2] == pytest.approx(speed, rel=2e-3, abs=1e-9)


@pytest.mark.parametrize("model", models.VEHICLES)
@pytest.mark.parametrize("density", [1000.0, 1026.0])
def test_a_neutral_trim_is_neutral_at_any_density(model: str, density: float) -> None:
    plant = plant_of(model, density, trim="neutral")
    weight = plant.model.body("own/hull").mass[0] * G
    assert plant.coefficients[0]["buoyancy"] == pytest.approx(weight, rel=1e-12)
    trimmed = plant_of(model, density, trim="neutral", excess_buoyancy_n=3.0)
    assert trimmed.coefficients[0]["buoyancy"] == pytest.approx(weight + 3.0, rel=1e-12)
    plant.step(np.zeros((1, plant.effector_states.shape[1])), 250)
    assert plant.pose[0, 2] == pytest.approx(-50.0, abs=1e-9)


def test_excess_buoyancy_does_not_follow_the_density() -> None:
    coefficients = [
        plant_of("leader", 1000.0, excess_buoyancy_n=n).coefficients[0] for n in (0.0, 7.0)
    ]
    assert coefficients[1]["buoyancy"] - coefficients[0]["buoyancy"] == pytest.approx(7.0)


def follower(*numerics: str) -> str:
    """MJCF of the follower with further numerics."""
    return laisn_sim.hull("follower").replace("</custom>", "".join(numerics) + "</custom>")


def test_the_buoyancy_of_a_file_without_a_density_is_that_in_sea_water() -> None:
    """Files that state no density stay valid; stating 1026 kg/m³ changes nothing."""
    with_density = follower('<numeric name="buoyancy_density" data="1026"/>')
    for density in (1000.0, 1026.0):
        without_density = plant_of(laisn_sim.hull("follower"), density)
        assert (
            plant_of(with_density, density).coefficients.tobytes()
            == without_density.coefficients.tobytes()
        )


@pytest.mark.parametrize(
    ("numeric", "message"),
    [
        ('<numeric name="buoyancy_density" data="0"/>', "buoyancy_density must be more than 0"),
        (
            '<numeric name="buoyancy_density" data="1 2"/>',
            r"<numeric name='buoyancy_density'> has 2 values, expected 1 value \[kg/m³\]",
        ),
        (
            '<numeric name="buoyancy_centre" data="0.1"/>',
            r"<numeric name='buoyancy_centre'> has 1 values, expected 3 values \[m\]",
        ),
        ('<numeric name="neutral" data="1"/>', "<numeric name='neutral'> has no meaning"),
    ],
)
def test_numerics_of_buoyancy_that_are_wrong_are_named(numeric: str, message: str) -> None:
    assert re.search(message, "\n".join(hull_errors(follower(numeric), "follower")))


@pytest.mark.parametrize(
    "centre", [(0.0, 0.0, 0.03), (0.05, 0.0, 0.02), (0.02, 0.004, 0.03)], ids=str
)
def test_a_hull_rests_with_its_centre_of_buoyancy_above_that_of_gravity(
    centre: tuple[float, ...],
) -> None:
    data = " ".join(map(str, centre))
    plant = plant_of(follower(f'<numeric name="buoyancy_centre" data="{data}"/>'), 1026.0)
    plant.step(np.zeros((1, 5)), 6000)
    arm = np.array(centre) - [0.0, 0.0, -0.02]
    up = attitude.rotate(plant.pose[0, 3:], arm / np.linalg.norm(arm))
    np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-4)


def test_the_righting_moment_does_not_depend_on_the_origin() -> None:
    """Moving the origin moves both centres. The moment about the centre of gravity is m g z sin θ,
    with z = 0.02 m from there to the centre of buoyancy.
    """
    plants = [
        plant_of(
            laisn_sim.hull("follower")
            .replace('pos="0 0 -0.02" mass', f'pos="0 0 {-0.02 - shift}" mass')
            .replace(
                "</custom>", f'<numeric name="buoyancy_centre" data="0 0 {-shift}"/></custom>'
            ),
            1026.0,
        )
        for shift in (0.0, 0.05)
    ]
    moments = []
    for plant in plants:
        plant.pose[0, 3:] = attitude.from_euler(0.0, np.radians(5.0))
        to_body = np.array(attitude.rotation(plant.pose[0, 3:])).T
        plant.step(np.zeros((1, 5)), 1)
        force = to_body @ plant.data.qfrc_applied[:3]
        # about the centre of gravity
        centre = plant.model.body("own/hull").ipos
        moments.append(plant.data.qfrc_applied[3:] - np.cross(centre, force))
    expected = [0.0, 31.0294 * G * 0.02 * np.sin(np.radians(5.0)), 0.0]
    np.testing.assert_allclose(np.abs(moments[0]), expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(moments[1], moments[0], rtol=1e-6, atol=1e-9)


def test_water_that_accelerates_carries_a_hull_along_without_turning_it() -> None:
    """Without drag and added mass a neutral hull moves as the water that it displaces, if its
    centre of gravity is that of buoyancy.
    """
    centre = (0.1, 0.03, 0.05)
    data = " ".join(map(str, centre))
    text = hull(31.0, (0.2, 4.0, 4.0), centre).replace(
        "</custom>", f'<numeric name="buoyancy_centre" data="{data}"/></custom>'
    )
    ocean = Ocean(added_current=np.array([[0.0, 0.0, 0.0], [50.0, 0.5, -0.3]]))
    tank = Tank(text, ocean, 0.02)
    tank.place()
    tank.step(n=500)
    np.testing.assert_allclose(tank.twist[:3], [0.1, -0.06, 0.0], atol=1e-9)
    np.testing.assert_allclose(tank.twist[3:], 0.0, atol=1e-9)


def test_the_mission_has_the_density_and_the_trim_of_its_scenario(tmp_path: Path) -> None:
    """Through the command: REMUS in fresh water is 7.7 N heavy, unless it is trimmed. Untrimmed it
    flies at 2 m/s and is refused at 1 m/s.
    """
    table = {
        "duration_s": 5,
        "leader": {"waypoints": [[0, 0, 20], [40, 40, 20]]},
        "followers": [{"model": "remus100", "waypoints": [[0, 0, 0], [20, 40, 0]], "depth_m": 8.0}],
        "ocean": {"density_kg_m3": 1000.0},
    }
    scenario = laisn_sim.load(table)
    plant = Plant(
        setups_of(MissionPlan.of(scenario), routes_of(MissionPlan.of(scenario))),
        ocean_of(SeaSettings.of(scenario)),
    )
    assert plant.coefficients[1]["buoyancy"] == pytest.approx(296.68, abs=0.01)
    assert 31.0294 * G - plant.coefficients[1]["buoyancy"] == pytest.approx(7.7, abs=0.05)
    slow = {"followers.0.waypoints": [[0, 0, 0], [40, 40, 0]]}
    with pytest.raises(LaisnError, match=r"it is 7.71 N heavier than .*trim = \"neutral\""):
        laisn_sim.load(table, slow)
    trimmed = laisn_sim.load(table, slow | {"followers.0.trim": "neutral"})
    assert trimmed.followers[0].trim == "neutral"
    plant = Plant(
        setups_of(MissionPlan.of(trimmed), routes_of(MissionPlan.of(trimmed))),
        ocean_of(SeaSettings.of(trimmed)),
    )
    assert plant.coefficients[1]["buoyancy"] == pytest.approx(31.0294 * G)
    file = tmp_path / "fresh.toml"
    file.write_text(trimmed.toml(), encoding="utf-8")
    result = CliRunner().invoke(app, ["check", str(file)])
    assert result.exit_code == 0, result.output
    refused = CliRunner().invoke(app, ["check", str(file), "--set", "followers.0.trim=light"])
    assert refused.exit_code != 0
    assert "trim" in refused.output
