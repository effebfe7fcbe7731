"""The plant: what it shows of the state, what it can do, and how it fails."""

import copy
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from laisn.arrays import Floats
from sim import attitude
from sim.control.autopilot import design
from sim.hull import HULL_KEYS
from sim.scenario.vehicles import Vehicle
from sim.vehicle import effectors, hydrodynamics, mjcf
from sim.vehicle.effectors import Fitted
from sim.vehicle.mjcf import VehicleSetup, compose, resolve
from sim.vehicle.mujoco_calls import calls_of
from sim.vehicle.plant import Plant, PlantError, _compiled_fleet
from sim.vehicle.solvers import MujocoSolver
from sim.water.ocean import Ocean
from sim.water.waves import Waves

EAST = np.pi / 2


def setups(
    depth: float = 10.0, speed_m_s: float = 0.0, excess_buoyancy_n: float = 0.0
) -> list[VehicleSetup]:
    settings = Vehicle.model_construct(excess_buoyancy_n=excess_buoyancy_n)
    start: dict[str, Any] = {"heading_rad": EAST, "speed_m_s": speed_m_s, "settings": settings}
    return [
        VehicleSetup(name="leader", model="leader", position_m=(0, 0, -depth), **start),
        VehicleSetup(name="T2", model="follower", position_m=(-20, 5, -depth), **start),
    ]


def rough_sea() -> Ocean:
    waves = Waves.jonswap(np.random.default_rng(1), significant_height_m=0.5, peak_period_s=4.0)
    return Ocean(
        current_speed_m_s=0.4, current_direction_rad=1.0, current_shear_1_s=0.01, waves=waves
    )


def test_neutral_hulls_hang_still_for_ten_minutes() -> None:
    plant = Plant(setups(), Ocean())
    start = plant.pose.copy()
    plant.step(np.zeros((2, 5)), 30000)
    assert plant.time == pytest.approx(600.0)
    assert np.linalg.norm(plant.pose[:, :3] - start[:, :3], axis=1).max() < 1e-3
    np.testing.assert_allclose(plant.pose[:, 3:], start[:, 3:], atol=1e-6)


def test_hull_rights_itself() -> None:
    plant = Plant(setups(), Ocean())
    plant.pose[:, 3:] = attitude.from_euler(EAST, np.radians(25), np.radians(40))
    plant.step(np.zeros((2, 5)), 6000)
    np.testing.assert_allclose(attitude.heading_pitch_roll(plant.pose[:, 3:])[1], 0.0, atol=1e-4)
    np.testing.assert_allclose(attitude.heading_pitch_roll(plant.pose[:, 3:])[2], 0.0, atol=1e-4)


def test_views_follow_the_state() -> None:
    plant = Plant(setups(speed_m_s=1.5), Ocean())
    np.testing.assert_allclose(plant.twist[:, :3], [[1.5, 0, 0]] * 2, atol=1e-12)
    assert np.shares_memory(plant.pose, plant.data.qpos)
    assert np.shares_memory(plant.twist, plant.data.qvel)
    command = np.array([[20.0, 1, 2, 3, 4], [10, 5, 6, 7, 8]])
    plant.step(command, 500)
    assert plant.time == pytest.approx(10.0)
    # sites are where pose and offset put them
    vehicle_of_site = plant.site_vehicle
    expected = plant.pose[vehicle_of_site, :3] + attitude.rotate(
        plant.pose[vehicle_of_site, 3:], plant.site_offset
    )
    mujoco.mj_kinematics(plant.model, plant.data)
    np.testing.assert_allclose(plant.data.site_xpos, expected, atol=1e-12)
    assert plant.site_names[0] == "leader/tx_rear"
    assert plant.site_names[int(np.flatnonzero(vehicle_of_site == 1)[0])] == "T2/hydrophone"


def test_a_step_is_mujocos_own_with_the_water_in_its_middle() -> None:
    """The plant leaves out parts of `mj_step1`; with all of them, and thrust by MuJoCo, the
    vehicles move alike.
    """
    plant = Plant(setups(speed_m_s=1.0), rough_sea())
    model = copy.copy(plant.model)
    model.actuator_gainprm[:, 0] = 1.0
    model.opt.disableflags &= ~mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
    data = mujoco.MjData(model)
    pose, twist = data.qpos.reshape(2, 7), data.qvel.reshape(2, 6)
    pose[:], twist[:] = plant.pose, plant.twist
    records = mjcf.read_coefficients(model, plant.names, plant.ocean.density_kg_m3)
    solver = MujocoSolver(
        calls_of(model, data), data.M.reshape(2, 21), data.qfrc_applied.reshape(2, 6)
    )
    fitted = Fitted(plant.kinds, plant.true_effectors, np.zeros(plant.effectors.shape))
    command = np.array([[30.0, 8, -6, 3, -5], [12, -5, 6, -2, 3]])
    data.ctrl[:] = command.ravel()

    def advance() -> Floats:
        mujoco.mj_step1(model, data)
        assert (
            hydrodynamics.apply_water_forces(
                records, pose, twist, data.time, plant.ocean.environment, solver, fitted
            )
            == -1
        )
        mujoco.mj_factorM(model, data)
        twist[:] -= plant.dt / 2 * last_acceleration
        mujoco.mj_step2(model, data)
        twist[:] += plant.dt / 2 * data.qacc.reshape(2, 6)
        return data.qacc.reshape(2, 6).copy()

    # the first call finds the acceleration at the start, then the state is set back
    start_pose, last_acceleration = data.qpos.copy(), np.zeros((2, 6))
    last_acceleration = advance()
    data.time, data.qpos[:], data.act[:] = 0.0, start_pose, 0.0
    twist[:] = plant.twist
    for _ in range(500):
        last_acceleration = advance()
    plant.step(command, 500)
    np.testing.assert_allclose(plant.pose, pose, rtol=0, atol=1e-9)
    np.testing.assert_allclose(plant.twist, twist, rtol=0, atol=1e-9)


def test_mujoco_reads_no_clock_in_a_step() -> None:
    plant = Plant(setups(), Ocean())
    plant.step(np.zeros((2, 5)), 100)
    assert [timer.duration for timer in plant.data.timer] == [0.0] * len(plant.data.timer)


def test_effectors_follow_commands_within_their_limits_by_a_first_order_lag() -> None:
    """In closed form after a second: the leader has 150 N ahead, the follower 25 N vertically, and
    the lag is 0.3 s.
    """
    plant = Plant(setups(), Ocean())
    plant.step(np.array([[500.0, 8, -6, 3, -5], [12, -5, 6, -2, 300]]), 50)
    limited_command = np.array([[150.0, 8, -6, 3, -5], [12, -5, 6, -2, 25]])
    np.testing.assert_allclose(
        plant.effector_states, limited_command * (1.0 - np.exp(-1.0 / 0.3)), rtol=1e-12
    )


def test_a_wrench_beyond_all_numbers_is_found() -> None:
    """Three forces of 10³⁰⁸ N, each of them finite."""
    plant = Plant(setups(), Ocean())
    records = mjcf.read_coefficients(plant.model, plant.names, 1026.0).copy()
    pose, twist = plant.pose.copy(), np.tile([1.0, 1.0, 1.0, 0.0, 0.0, 0.0], (2, 1))
    pose[1, 3:] = [1.0, 0.0, 0.0, 0.0]
    solver = MujocoSolver(calls_of(plant.model, plant.data), np.zeros((2, 21)), np.zeros((2, 6)))
    fitted = Fitted(plant.kinds, plant.true_effectors, np.zeros(plant.effectors.shape))
    assert (
        hydrodynamics.apply_water_forces(
            records, pose, twist, 0.0, plant.ocean.environment, solver, fitted
        )
        == -1
    )
    records["linear_damping"][1, :3], records["linear_damping_fade"][1] = 1e308, 0.0
    assert (
        hydrodynamics.apply_water_forces(
            records, pose, twist, 0.0, plant.ocean.environment, solver, fitted
        )
        == 1
    )
    assert np.isfinite(solver.applied).all()


def test_moments_of_thrusters_are_those_of_mujoco() -> None:
    """Thrusters may point and twist anywhere, and hulls may lie anyhow."""
    plant = Plant(setups(), Ocean())
    model, rng = plant.model, np.random.default_rng(6)
    model.site_quat[:] = Rotation.random(model.nsite, rng=rng).as_quat()
    model.site_sameframe[:] = 0
    model.actuator_gear[:] = rng.normal(size=model.actuator_gear.shape)
    data = mujoco.MjData(model)
    pose = data.qpos.reshape(2, 7)
    pose[:, 3:] = Rotation.random(2, rng=rng).as_quat()
    mujoco.mj_forward(model, data)
    expected = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        expected, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    # gears are directions: of forces of 1 N
    expected /= np.linalg.norm(model.actuator_gear[:, :3], axis=1)[:, None]
    moments = effectors.unit_wrenches(effectors.read(model, resolve(model, plant.names)))
    moments[..., :3] = attitude.rotate(pose[:, None, 3:], moments[..., :3])
    np.testing.assert_allclose(moments[0], expected[:5, :6], atol=1e-12)
    np.testing.assert_allclose(moments[1], expected[5:, 6:], atol=1e-12)
    assert not expected[:5, 6:].any()


def test_thruster_elsewhere_than_at_its_hull_is_refused() -> None:
    plant = Plant(setups(), Ocean())
    vehicles = resolve(plant.model, plant.names)
    plant.model.actuator_trnid[6, 0] = plant.model.actuator_trnid[0, 0]
    with pytest.raises(
        ValueError,
        match="actuator 'T2/thruster_lateral_bow' must act at a site of the body 'T2/hull'",
    ):
        effectors.read(plant.model, vehicles)


def test_thrust_follows_the_command_with_its_lag_and_within_its_limits() -> None:
    plant = Plant(setups(), Ocean())
    plant.step(np.full((2, 5), 1e4), 15)
    # a first-order lag of 0.3 s reaches 1 − 1/e after 0.3 s
    np.testing.assert_allclose(
        plant.effector_states, (1 - np.exp(-1)) * plant.effectors["limits"][..., 1], rtol=1e-9
    )
    plant.step(np.full((2, 5), -1e4), 500)
    np.testing.assert_allclose(plant.effector_states, plant.effectors["limits"][..., 0], rtol=1e-9)


def test_geoms_change_nothing_in_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plant's model lacks the vehicles' geoms; with them it moves the same, to the bit."""
    command = np.array([[40.0, 5, -5, 1, 1], [20, -3, 3, 0, 2]])
    without_geoms = Plant(setups(), rough_sea())
    monkeypatch.setattr(
        "sim.vehicle.plant.compose", lambda setups, depth, with_geoms: compose(setups, depth)
    )
    # compiled anew, rather than shared with the plant before
    monkeypatch.setattr("sim.vehicle.plant._compiled_fleet", _compiled_fleet.__wrapped__)
    with_geoms = Plant(setups(), rough_sea())
    assert with_geoms.model.ngeom > without_geoms.model.ngeom + 20
    for plant in (without_geoms, with_geoms):
        plant.step(command, 500)
    assert without_geoms.pose.tobytes() == with_geoms.pose.tobytes()
    assert without_geoms.twist.tobytes() == with_geoms.twist.tobytes()


CHANGED_SETTINGS = {
    "cg_offset_x_m": 0.02,
    "cg_offset_z_m": -0.01,
    "drag_scale": 1.3,
    "added_mass_scale": 0.8,
    "lift_scale": 1.2,
    "thrust_scale": 0.9,
    "trim": "neutral",
    "excess_buoyancy_n": 4.0,
    "hydrophone_m": (0.3, 0.0, 0.1),
}
"""Other values of the keys on which a hull depends, beside its model and its autopilot."""


def _computed_before_motion(settings: Vehicle, density: float) -> dict[str, bytes]:
    """All that is computed of a vehicle before it moves, as bytes."""
    setup = VehicleSetup(
        name="T2", model="follower", position_m=(0, 0, -10.0), heading_rad=EAST, settings=settings
    )
    plant = Plant([setup], Ocean(density_kg_m3=density), engine="direct")
    by_pitch, by_thrust = (design(plant, (control,)) for control in ("pitch", "thrust"))
    return {
        "coefficients": plant.true_coefficients.tobytes(),
        "effectors": plant.true_effectors.tobytes(),
        "bodies": plant.bodies.tobytes(),
        "sites": plant.site_offset.tobytes(),
        "by pitch": by_pitch.tobytes(),
        "by thrust": by_thrust.tobytes(),
    }


def test_changed_settings_hold_every_key_of_a_hull() -> None:
    of_autopilot = {"depth_control", "roll_control"}
    assert {*HULL_KEYS, "hydrophone_m"} == {*CHANGED_SETTINGS, *of_autopilot}


def test_cached_hulls_are_those_of_their_settings() -> None:
    """Hulls, coefficients and designs of a study are made once for all missions that have them."""
    hulls = [(Vehicle.model_construct(), 1025.0), (Vehicle.model_construct(), 1000.0)]
    hulls += [
        (Vehicle.model_construct(**{key: value}), 1025.0) for key, value in CHANGED_SETTINGS.items()
    ]
    computed_anew = []
    for settings, density in hulls:
        _compiled_fleet.cache_clear()
        computed_anew.append(_computed_before_motion(settings, density))
    assert len({tuple(computed.values()) for computed in computed_anew}) == len(hulls)
    for _ in range(2):
        for (settings, density), expected in zip(hulls, computed_anew, strict=True):
            assert _computed_before_motion(settings, density) == expected


@pytest.mark.parametrize("settled", [True, False])
def test_hulls_that_are_compiled_once_start_where_their_setups_have_them(settled: bool) -> None:
    """Positions and attitudes are those that MuJoCo's own compiler gives."""
    first = Plant(setups(), Ocean(), settled=settled)
    moved_setups = [
        replace(setup, position_m=(31.7, -0.3 * i, -12.1 - i), heading_rad=1.9 + i)
        for i, setup in enumerate(setups())
    ]
    moved = Plant(moved_setups, Ocean(), settled=settled)
    again = Plant(setups(), Ocean(), settled=settled)
    for plant, setups_of_plant in ((moved, moved_setups), (first, setups()), (again, setups())):
        expected = compose(setups_of_plant, with_geoms=False).compile()
        for name in ("qpos0", "qpos_spring", "body_pos", "body_quat"):
            np.testing.assert_array_equal(getattr(plant.model, name), getattr(expected, name))
        assert plant.pose.tobytes() == expected.qpos0.tobytes()
    heavier = Plant(setups(excess_buoyancy_n=-3.0), Ocean())
    assert heavier.coefficients["buoyancy"][0] == first.coefficients["buoyancy"][0] - 3.0


def test_settled_plants_share_no_model() -> None:
    """Plants that are not settled share one, and each has a state of its own."""
    plants = [Plant(setups(), Ocean()) for _ in range(2)]
    unsettled = [Plant(setups(), Ocean(), settled=False) for _ in range(2)]
    assert len({id(plant.model) for plant in (*plants, *unsettled)}) == 3
    unsettled[0].pose[0, 0] += 1.0
    assert unsettled[1].pose[0, 0] == unsettled[0].pose[0, 0] - 1.0


def test_same_start_gives_the_same_bytes() -> None:
    command = np.array([[40.0, 5, -5, 1, 1], [20, -3, 3, 0, 2]])
    ends = []
    for split in (1, 10):
        plant = Plant(setups(), rough_sea())
        for _ in range(split):
            plant.step(command, 500 // split)
        ends.append(plant.pose.tobytes() + plant.twist.tobytes())
    assert ends[0] == ends[1]


def test_vehicles_do_not_feel_one_another() -> None:
    both, alone = Plant(setups(), rough_sea()), Plant(setups()[1:], rough_sea())
    command = np.array([[40.0, 5, -5, 1, 1], [20, -3, 3, 0, 2]])
    both.step(command, 500)
    alone.step(command[1:], 500)
    np.testing.assert_allclose(both.pose[1], alone.pose[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("vehicle", "speed"), [(0, 2.5), (1, 3.0)])
def test_speed_is_reached_with_reserve(vehicle: int, speed: float) -> None:
    plant = Plant(setups(depth=100.0), Ocean())
    command = np.zeros((2, 5))
    command[:, 0] = 0.8 * plant.effectors["limits"][:, 0, 1]
    plant.step(command, 3000)
    assert np.linalg.norm(plant.twist[vehicle, :3]) > speed


def test_speed_changes_by_two_tenths_per_second() -> None:
    """At full thrust even close to 3 m/s, where drag takes most of the thrust; in m/s²."""
    plant = Plant(setups(depth=100.0, speed_m_s=2.8), Ocean())
    command = np.zeros((2, 5))
    command[:, 0] = plant.effectors["limits"][:, 0, 1]
    plant.step(command, 50)
    before = plant.twist[:, 0].copy()
    plant.step(command, 10)
    assert ((plant.twist[:, 0] - before) / 0.2 > 0.2).all()


@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_turns_ten_degrees_per_second(speed: float) -> None:
    """0.6 of the lateral thrust, bow to port and stern to starboard, turns them faster."""
    plant = Plant(setups(depth=100.0, speed_m_s=speed), Ocean())
    command = np.zeros((2, 5))
    command[:, 0] = [12 * speed**2, 7 * speed**2]
    command[:, 1] = 0.6 * plant.effectors["limits"][:, 1, 1]
    command[:, 2] = -command[:, 1]
    plant.step(command, 1000)
    assert (np.degrees(plant.twist[:, 5]) > 10).all()


def test_vertical_thrusters_outweigh_excess_buoyancy() -> None:
    plant = Plant(setups(excess_buoyancy_n=12.0), Ocean())
    command = np.zeros((2, 5))
    command[:, 3:] = -6.0
    plant.step(command, 3000)
    np.testing.assert_allclose(plant.twist[:, 2], 0.0, atol=2e-3)
    plant.step(2 * command, 3000)
    assert (plant.twist[:, 2] < 0).all()


def test_hulls_driven_upwards_stay_at_the_surface() -> None:
    """At full vertical thrust in waves."""
    plant = Plant(setups(depth=2.0, excess_buoyancy_n=12.0), rough_sea())
    command = np.zeros((2, 5))
    command[:, 3:] = plant.effectors["limits"][:, 3:, 1]
    highest = 0.0
    for _ in range(600):
        plant.step(command, 5)
        highest = max(highest, float(plant.pose[:, 2].max()))
    assert highest < 1.0


def test_command_of_wrong_shape_is_refused() -> None:
    plant = Plant(setups(), Ocean())
    with pytest.raises(ValueError, match=r"shape \(5,\), expected \(2, 5\)"):
        plant.step(np.zeros(5))


def test_lost_state_names_vehicle_time_and_last_good_state() -> None:
    plant = Plant(setups(), Ocean())
    plant.step(np.zeros((2, 5)), 50)
    last_pose = plant.pose.copy()
    plant.twist[1, 0] = np.nan
    with pytest.raises(PlantError, match=r"t = 1\.000 s: the state of T2 is lost") as caught:
        plant.step(np.zeros((2, 5)), 5)
    assert f"  T2: {np.array2string(last_pose[1], precision=4)}" in str(caught.value)


@pytest.mark.parametrize(("vehicle", "name"), [(0, "leader"), (1, "T2")])
def test_command_that_is_not_finite_is_refused(vehicle: int, name: str) -> None:
    plant = Plant(setups(), Ocean())
    command = np.zeros((2, 5))
    command[vehicle, 3] = np.inf
    with pytest.raises(PlantError, match=f"the command of {name} is not finite"):
        plant.step(command)


def test_integration_that_fails_is_stopped_before_mujoco_complains(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Steps of 5 s are far too long: the hulls tumble ever faster."""
    plant = Plant(setups(), Ocean(), dt=5.0)
    plant.twist[:] = 1.0
    with pytest.raises(PlantError, match=r"the state of \S+ is lost") as caught:
        plant.step(np.full((2, 5), 30.0), 300)
    assert "nan" not in str(caught.value)
    assert not plant.data.warning.number.any()
    assert "WARNING" not in "".join(capfd.readouterr())


def test_ten_followers_step_as_one_model() -> None:
    fleet = [VehicleSetup(name="leader", model="leader", position_m=(0, 0, -10))]
    fleet += [
        VehicleSetup(name=f"f{i}", model="follower", position_m=(10 * i, -20, -10))
        for i in range(10)
    ]
    plant = Plant(fleet, rough_sea())
    command = np.random.default_rng(0).uniform(-10, 30, (11, 5))
    plant.step(command, 500)
    assert plant.pose.shape == (11, 7)
    # sites of the leader, and of each follower
    assert len(plant.site_names) == 12 + 10 * 10


def test_warning_of_mujoco_stops_the_run() -> None:
    plant = Plant(setups(), Ocean())
    plant.data.warning[int(mujoco.mjtWarning.mjWARN_INERTIA)].number = 1
    with pytest.raises(PlantError, match="MuJoCo warns: mjWARN_INERTIA"):
        plant.step(np.zeros((2, 5)))
