"""Every model compiles, steps without warnings under random control and matches the documents."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import quad

import models
from sim.scenario.vehicles import Leader
from sim.vehicle import mjcf
from sim.vehicle.mjcf import VehicleSetup, compose, resolve, transmitter_places
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean

VEHICLES = ("leader", "follower")
SIZES = {"leader": (2.0, 0.25), "follower": (1.6, 0.19)}
"""Length and diameter of the hulls [m]."""


def leader_and_follower() -> list[VehicleSetup]:
    return [
        VehicleSetup(name="lead", model="leader", position_m=(0, 0, -10), heading_rad=1.0),
        VehicleSetup(
            name="T2", model="follower", position_m=(-20, 5, -12), heading_rad=-2.0, speed_m_s=1.0
        ),
    ]


@pytest.mark.parametrize("name", [*VEHICLES, "ocean"])
def test_model_compiles_and_steps_without_a_warning(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(models.path(name)))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(200):
        data.ctrl[:] = rng.uniform(-200, 200, model.nu)
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()


def test_unknown_model_is_answered_with_what_exists() -> None:
    with pytest.raises(
        ValueError,
        match=r"unknown model 'submarine'; available: bluerov2_heavy, follower, lauv, leader, ",
    ):
        models.path("submarine")


THRUSTERS = (
    "thruster_main",
    "thruster_lateral_bow",
    "thruster_lateral_stern",
    "thruster_vertical_bow",
    "thruster_vertical_stern",
)


@pytest.mark.parametrize("name", VEHICLES)
def test_thrusters_push_in_the_direction_of_their_names(name: str) -> None:
    model = mujoco.MjModel.from_xml_path(str(models.path(name)))
    assert tuple(model.actuator(i).name for i in range(model.nu)) == THRUSTERS
    data = mujoco.MjData(model)
    for i, thruster in enumerate(THRUSTERS):
        mujoco.mj_resetDataKeyframe(model, data, model.key("trim").id)
        data.act[i] = 10.0
        mujoco.mj_forward(model, data)
        axis = 0 if "main" in thruster else 1 if "lateral" in thruster else 2
        force = 10.0 * np.eye(3)[axis]
        np.testing.assert_allclose(data.qfrc_actuator[:3], force, atol=1e-12)
        x = model.site(thruster).pos[0]
        assert np.sign(x) == (1 if "bow" in thruster else -1)
        np.testing.assert_allclose(data.qfrc_actuator[3:], np.cross([x, 0, 0], force), atol=1e-12)


@pytest.mark.parametrize("name", VEHICLES)
def test_hull_is_neutral_and_its_added_mass_that_of_the_spheroid(name: str) -> None:
    """Lamb's factors from their integrals (Lamb 1932), not from the closed forms that MJCF
    cites.
    """
    length, diameter = SIZES[name]
    a, b = length / 2, diameter / 2
    # α₀ = a b² ∫₀^∞ dλ / ((a²+λ)^{3/2} (b²+λ)), β₀ with one power of the roots exchanged
    alpha = a * b**2 * quad(lambda x: 1 / ((a**2 + x) ** 1.5 * (b**2 + x)), 0, np.inf)[0]
    beta = a * b**2 * quad(lambda x: 1 / ((a**2 + x) ** 0.5 * (b**2 + x) ** 2), 0, np.inf)[0]
    mass = 1026 * 4 / 3 * np.pi * a * b**2
    transverse_inertia = mass * (a**2 + b**2) / 5
    rotation_factor = (
        (a**2 - b**2) ** 2
        * (beta - alpha)
        / (2 * (a**2 - b**2) + (a**2 + b**2) * (alpha - beta))
        / (a**2 + b**2)
    )
    expected = [
        mass * alpha / (2 - alpha),
        mass * beta / (2 - beta),
        mass * beta / (2 - beta),
        # roll: 0.3 of the moment of inertia of the hull, as its MJCF states
        0.3 * 0.4 * mass * b**2,
        rotation_factor * transverse_inertia,
        rotation_factor * transverse_inertia,
    ]
    model = compose([VehicleSetup(name="v", model=name, position_m=(0, 0, -10))]).compile()
    coefficients = mjcf.read_coefficients(model, ["v"], 1026.0)[0]
    np.testing.assert_allclose(coefficients["added_mass"], np.diag(expected), rtol=2e-4, atol=1e-12)
    assert np.linalg.eigvalsh(coefficients["added_mass"])[0] > 0
    body = resolve(model, ["v"])[0].body
    np.testing.assert_allclose(model.body_mass[body], mass, rtol=1e-5)
    np.testing.assert_allclose(
        np.sort(model.body_inertia[body]),
        np.sort([0.4 * mass * b**2, transverse_inertia, transverse_inertia]),
        rtol=1e-4,
    )
    assert coefficients["buoyancy"] == pytest.approx(9.81 * model.body_mass[body], rel=1e-12)
    # the strips are the side view of the spheroid, and the same fore and aft
    n_strips = coefficients["n_strips"]
    assert coefficients["strip_area"][:n_strips].sum() == pytest.approx(np.pi * a * b, rel=1e-3)
    assert coefficients["strip_x"][:n_strips] @ coefficients["strip_area"][
        :n_strips
    ] == pytest.approx(0.0, abs=1e-12)


def test_sites_lie_where_the_navigation_expects_them() -> None:
    leader = mujoco.MjModel.from_xml_path(str(models.path("leader")))
    expected = {
        "tx_rear": (-1, 0, 0),
        "tx_front": (1, 0, 0),
        "tx_middle": (0, 0.1, 0),
        "depth_sensor": (0, 0, 0),
        "cg": (0, 0, -0.02),
    }
    for name, position in expected.items():
        np.testing.assert_array_equal(leader.site(name).pos, position)
    follower = mujoco.MjModel.from_xml_path(str(models.path("follower")))
    np.testing.assert_array_equal(follower.site("hydrophone").pos, (0, 0, 0.1))
    np.testing.assert_array_equal(follower.site("depth_sensor").pos, (0, 0, 0))
    for model in (leader, follower):
        np.testing.assert_array_equal(model.site("cg").pos, model.body("hull").ipos)
        assert model.ncam >= 2


def test_vehicles_attached_in_groups_make_the_model_of_those_attached_one_by_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A fleet with names of one letter, of one initial and of others, of three hulls; to the
    byte.
    """
    names = ["leader", "a", "b", *(f"auv-{i}" for i in range(20)), "sub", *"xyz", "x2", "last"]
    hulls = ["leader", *["follower", "remus100"] * len(names)]
    setups = [
        VehicleSetup(name=name, model=hull, position_m=(5.0 * i, 0.0, -10.0), heading_rad=0.1 * i)
        for i, (name, hull) in enumerate(zip(names, hulls, strict=False))
    ]

    def contents() -> bytes:
        model = compose(setups, 50.0).compile()
        content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, content)
        assert [v.name for v in resolve(model, names)] == names
        return content.tobytes()

    in_groups = contents()
    monkeypatch.setattr(mjcf, "_groups", lambda setups: [[setup] for setup in setups])
    assert in_groups == contents()


def test_geoms_neither_collide_nor_meet_a_fluid_of_mujoco() -> None:
    model = compose(leader_and_follower()).compile()
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()
    assert model.opt.density == 0
    assert model.opt.viscosity == 0


def test_setup_edits_the_vehicle() -> None:
    leader = Leader(
        excess_buoyancy_n=7.0,
        cg_offset_x_m=0.05,
        cg_offset_z_m=-0.01,
        baseline_m=1.0,
        middle_offset_m=0.2,
    )
    setup = VehicleSetup(
        name="lead",
        model="leader",
        position_m=(1, 2, -3),
        settings=leader,
        transmitters=transmitter_places(leader),
    )
    model = compose([setup], floor_depth_m=77.0).compile()
    np.testing.assert_array_equal(model.site("lead/tx_rear").pos, (-0.5, 0, 0))
    np.testing.assert_array_equal(model.site("lead/tx_front").pos, (0.5, 0, 0))
    np.testing.assert_array_equal(model.site("lead/tx_middle").pos, (0, 0.2, 0))
    np.testing.assert_allclose(model.body("lead/hull").ipos, (0.05, 0, -0.03))
    np.testing.assert_allclose(model.site("lead/cg").pos, (0.05, 0, -0.03))
    weight = 9.81 * model.body("lead/hull").mass[0]
    assert mjcf.read_coefficients(model, ["lead"], 1026.0)[0]["buoyancy"] == pytest.approx(
        weight + 7.0
    )
    # the highest crest of the floor lies at its depth
    assert model.geom("floor").pos[2] + model.hfield_size[
        0, 2
    ] * model.hfield_data.max() == pytest.approx(-77.0)


def test_a_setup_with_an_unknown_model_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown model 'boat'"):
        compose([VehicleSetup(name="a", model="boat", position_m=(0, 0, 0))])


def test_missing_numeric_is_named_with_size_and_unit() -> None:
    spec = compose(leader_and_follower())
    spec.delete(spec.numeric("T2/linear_damping"))
    with pytest.raises(
        ValueError, match=r"'T2': lacks <numeric name='linear_damping'>, 6 values \[N s/m, N m s\]"
    ):
        mjcf.read_coefficients(spec.compile(), ["lead", "T2"], 1026.0)


def test_numeric_of_wrong_size_is_named_with_size_and_unit() -> None:
    spec = compose(leader_and_follower())
    spec.numeric("lead/hull_lift").data = np.array([0.1])
    spec.numeric("lead/hull_lift").size = 1
    with pytest.raises(
        ValueError, match=r"'lead': <numeric name='hull_lift'> has 1 values, expected 3 values \[m²"
    ):
        mjcf.read_coefficients(spec.compile(), ["lead", "T2"], 1026.0)


@pytest.mark.parametrize("name", VEHICLES)
def test_composed_vehicles_step_under_random_control(name: str) -> None:
    rng = np.random.default_rng(3)
    plant = Plant([VehicleSetup(name="v", model=name, position_m=(0, 0, -30))], Ocean())
    for _ in range(500):
        plant.step(rng.uniform(-200, 200, (1, 5)), 5)
    assert np.isfinite(plant.pose).all()
