"""Roll that the autopilot holds: who holds it, with which law, and what becomes of a heel."""

import re
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import laisn_sim
import models
from experiments.flight.library import load_scenario
from laisn.arrays import Floats
from laisn.errors import LaisnError
from sim.attitude import from_euler, heel_of
from sim.control import autopilot
from sim.control.allocation import ROLL, greatest_roll
from sim.control.autopilot import HullMotion, RollControl, design
from sim.control.guidance import REFERENCE
from sim.control.stability import _controlled_hull, _state_matrices, _straight_ahead, require_stable
from sim.feasibility import effect_cautions
from sim.scenario.parts import MotionSettings
from sim.scenario.routes import DepthProfile, Route
from sim.scenario.vehicles import Vehicle
from sim.side_by_side import simulate_side_by_side
from sim.simulation import simulate, simulate_open_loop
from sim.trajectory import Trajectory
from sim.vehicle.effector_kinds import BUILT_IN
from sim.vehicle.effectors import unit_wrenches
from sim.vehicle.hull_file import from_dimensions
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.vehicle.solvers import Engine
from sim.water.ocean import Ocean
from tests.synthetic import record

ROV = models.path("bluerov2_heavy").read_text("utf-8")
DT = 0.1


def with_linear_thrusters(text: str) -> str:
    """The ROV with thrusters whose states are forces."""
    text, count = re.subn(r'<numeric name="thruster_\d.curve" data="[^"]*"/>', "", text)
    assert count == 8
    return text.replace('ctrlrange="-1 1"', 'ctrlrange="-30.4 30.4"')


def plant_of(model: str, roll_control: RollControl | None = None) -> Plant:
    """A neutral vehicle at rest, 10 m deep, in fresh water."""
    setup = VehicleSetup(
        name="hull",
        model=model,
        position_m=(0.0, 0.0, -10.0),
        settings=Vehicle.model_construct(roll_control=roll_control, trim="neutral"),
    )
    return Plant([setup], Ocean(density_kg_m3=1000.0))


def design_of(model: str, roll_control: RollControl | None = None) -> Any:
    return design(plant_of(model, roll_control), (None,))[0]


def heel_in(trajectory: Trajectory, vehicle: int = 0) -> Floats:
    """Sine of the heel at each instant, shape (n,)."""
    return np.asarray(heel_of(trajectory.pose[:, vehicle, 3:].T))


def hovering(plant: Plant, time: float) -> Trajectory:
    """A vehicle kept where it is."""
    point = Route.timed("point", [[0, 0, 0], [1000, 0, 0]], DepthProfile.constant(10.0))
    return simulate(plant, [point], time, (None,))


# --- who holds roll ---


@pytest.mark.parametrize(
    ("model", "holds"),
    [
        ("leader", False),
        ("follower", False),
        ("remus100", False),
        ("lauv", True),
        ("bluerov2_heavy", True),
    ],
)
def test_vehicles_with_authority_hold_roll(model: str, holds: bool) -> None:
    d = design_of(model)
    assert d["holds_roll"] == holds
    assert not design_of(model, "free")["holds_roll"]
    if autopilot.can_roll(d):
        assert design_of(model, "hold")["holds_roll"]


def test_authority_is_the_moment_of_the_effectors_over_that_of_the_hull() -> None:
    """Four thrusters of 30.4 N at 0.218 m; four fins at 0.04 m, ½ρ S C U² δ with U = 0.5 m/s and
    δ = 20°, of which those at the stern of a REMUS 100 share a moment at the smaller slope's force.
    """
    d = design_of("bluerov2_heavy")
    limits = np.tile([-30.4, 30.4], (8, 1))
    attainable = greatest_roll(d["slow_allocation"][:8], limits)
    assert attainable == pytest.approx(4 * 30.4 * 0.218)

    d = design_of("lauv")
    fin = 0.5 * 1000.0 * 0.0064 * 3.0 * 0.5**2 * np.deg2rad(20.0)
    limits = np.array([[-50.0, 50.0], *[[-fin, fin]] * 4])
    attainable = greatest_roll(d["slow_allocation"][:5], limits)
    assert attainable == pytest.approx(4 * fin * 0.04, rel=1e-5)
    # the smaller of the two sides counts
    limits[1] = -0.5 * fin, fin
    halved = greatest_roll(d["slow_allocation"][:5], limits)
    assert halved == pytest.approx(0.5 * attainable)
    assert greatest_roll(design_of("leader")["slow_allocation"][:5], limits) == 0.0


def test_a_hull_is_held_up_to_a_righting_moment_of_its_effectors() -> None:
    """A LAUV whose centre of buoyancy is higher, with fins of 0.134 N m at 0.5 m/s, which is the
    moment of 18 kg · 9.81 m/s² · 0.0290 m at 1.5°.
    """
    text = models.path("lauv").read_text("utf-8")
    centre = 'name="buoyancy_centre" data="0 0 0.01"'
    assert centre in text
    for height, holds in ((0.028, True), (0.031, False)):
        raised = text.replace(centre, f'name="buoyancy_centre" data="0 0 {height}"')
        assert design_of(raised)["holds_roll"] == holds


def test_a_vehicle_without_a_moment_of_roll_cannot_hold_it() -> None:
    with pytest.raises(LaisnError, match=r"roll_control = 'hold' needs effectors that give a mom"):
        design_of("leader", "hold")
    changes = {"duration_s": 5, "leader.roll_control": "hold"}
    with pytest.raises(LaisnError, match=r"leader: roll_control = 'hold' needs effectors"):
        laisn_sim.load("T5", changes)


def test_roll_that_is_left_free_where_nothing_holds_it_is_named() -> None:
    def remarks(*settings: str) -> list[str]:
        return effect_cautions(MotionSettings.of(load_scenario("T5", settings)))

    assert remarks("followers.0.roll_control=free", "leader.roll_control=free") == [
        f"without effect: {key}.roll_control = 'free', as its effectors give no moment of roll"
        for key in ("leader", "followers[0]")
    ]
    # fins of a REMUS 100 can
    for model in ("remus100", "bluerov2_heavy"):
        assert remarks("followers.0.roll_control=free", f"followers.0.model={model}") == []
    kinematic = "without effect on motion = 'kinematic': leader.roll_control"
    assert remarks("leader.roll_control=free", "motion=kinematic") == [kinematic]


# --- the law ---


def command_of(
    d: Any, *, heel: float = 0.0, rolling: float = 0.0, integral: float = 0.0, sway: float = 0.0
) -> tuple[Floats, Any]:
    """Forces of the effectors at 0.5 m/s on a steady course, and the memory after a step."""
    reference = record(REFERENCE)
    reference.depth = 10.0
    motion = HullMotion(
        surge=0.5,
        sway=sway,
        heading=0.0,
        turning=0.0,
        pitch=0.0,
        pitching=0.0,
        heel=heel,
        rolling=rolling,
        depth=10.0,
        sinking=0.0,
    )
    memory = record(autopilot.AUTOPILOT_MEMORY)
    memory.roll_integral = integral
    count = int(np.count_nonzero(np.abs(d["effectors"]["force"]).any(axis=1)))
    states = np.zeros(count)
    autopilot.control(BUILT_IN, d, (0.0, 0.0, 0.5), reference, motion, DT, memory, states)
    return states, memory


def linear_rov() -> Any:
    """The ROV with thrusters whose states are forces, without limits that matter."""
    d = design(plant_of("bluerov2_heavy"), (None,)).copy()
    d["effectors"]["kind"] = 0
    d["effectors"]["limits"][:, :8] = -1e3, 1e3
    return d[0]


def moment_of(d: Any, forces: Floats) -> float:
    moments = unit_wrenches(d["effectors"][: forces.size])[:, 3] * forces
    return float(moments.sum())


@pytest.mark.parametrize(
    ("heel", "rolling", "integral", "sway"),
    [(0.1, 0.0, 0.0, 0.0), (0.0, 0.2, 0.0, 0.0), (0.0, 0.0, 0.3, 0.0), (-0.2, 0.1, 0.05, 0.2)],
)
def test_effectors_give_the_moment_of_the_law(
    heel: float, rolling: float, integral: float, sway: float
) -> None:
    """K = −I_x (ω² sin φ + 2 ω p) + integral, of all effectors together: what others of their
    forces roll the hull by is taken back.
    """
    d = linear_rov()
    # bluerov2_heavy.xml: 0.26 and 0.189 kg m²; lag of the thrusters below 0.3 s
    inertia = 0.26 + 0.189
    omega = 1.0 / (4.0 * 0.3)
    forces, memory = command_of(d, heel=heel, rolling=rolling, integral=integral, sway=sway)
    expected = integral - inertia * (omega**2 * heel + 2.0 * omega * rolling)
    assert moment_of(d, forces) == pytest.approx(expected)
    # K_i = ω / 10 times the stiffness of law and hull
    stiffness = inertia * omega**2 + float(d["righting"])
    assert memory.roll_integral == pytest.approx(integral - 0.1 * omega * stiffness * heel * DT)
    # without the law, sway by thrusters 0.085 m below the origin rolls the hull
    d["holds_roll"] = False
    free_forces, memory = command_of(d, heel=heel, rolling=rolling, integral=integral, sway=sway)
    assert memory.roll_integral == integral
    assert free_forces == pytest.approx(command_of(d, sway=sway)[0])
    assert (abs(moment_of(d, free_forces)) > 1e-3) == (sway != 0.0)
    others = unit_wrenches(d["effectors"][:8]).T[[0, 1, 2, 4, 5]]
    np.testing.assert_allclose(others @ forces, others @ free_forces, atol=1e-12)


def test_the_integral_stands_still_while_limits_withhold_roll() -> None:
    d = linear_rov()
    d["effectors"]["limits"][4:8] = -0.1, 0.1
    _, memory = command_of(d, heel=0.9, integral=1.0)
    assert memory.roll_integral < 1.0
    _, memory = command_of(d, heel=0.9, integral=-1.0)
    assert memory.roll_integral == -1.0


@pytest.mark.parametrize("model", ["leader", "follower", "remus100", "bluerov2_heavy"])
def test_without_roll_control_commands_do_not_depend_on_roll(model: str) -> None:
    roll_control: RollControl | None = "free" if model == "bluerov2_heavy" else None
    d = design_of(model, roll_control)
    level, _ = command_of(d, sway=0.1)
    rolled, memory = command_of(d, heel=0.3, rolling=0.5, integral=2.0, sway=0.1)
    assert rolled.tobytes() == level.tobytes()
    assert memory.roll_integral == 2.0


def test_the_bandwidth_of_roll_is_that_of_the_effectors_that_roll_the_hull() -> None:
    """Slow vertical thrusters, and then slow ones ahead."""
    for number, axis in ((5, "roll_omega"), (1, "omega")):
        lines = ROV.splitlines()
        (k,) = [i for i, line in enumerate(lines) if f'<general name="thruster_{number}"' in line]
        lines[k] = lines[k].replace("<general ", '<general dynprm="0.5" ')
        d = design_of("\n".join(lines))
        assert d[axis] == pytest.approx(1.0 / (4.0 * 0.5))
    assert d["roll_omega"] == pytest.approx(1.0 / (4.0 * 0.3))


def test_inertia_of_roll_is_about_the_origin() -> None:
    """leader.xml: 0.4197 kg m² about a centre 0.02 m low, 67.1515 kg; added 0.1259 kg m²."""
    d = design_of("leader")
    assert d["roll_inertia"] == pytest.approx(0.4197 + 67.1515 * 0.02**2 + 0.1259, rel=1e-3)


# --- the motion ---


def test_the_heel_is_the_rise_of_the_port_axis() -> None:
    for pitch, roll in ((0.0, 0.3), (0.4, -0.2), (-0.7, 1.2)):
        pose = np.r_[0.0, 0.0, -10.0, from_euler(1.0, pitch, roll)]
        motion = autopilot.true_motion(pose, np.r_[np.zeros(3), 0.3, 0.2, 0.1], np.zeros(3))
        assert motion.heel == pytest.approx(np.sin(roll) * np.cos(pitch))
        assert heel_of(pose[3:]) == motion.heel
        assert motion.rolling == 0.3


def in_a_corner(roll_control: RollControl | None, engine: Engine = "mujoco") -> Trajectory:
    """East, then north, at 0.5 m/s."""
    setup = VehicleSetup(
        name="rov",
        model="bluerov2_heavy",
        position_m=(0.0, 0.0, -10.0),
        heading_rad=np.pi / 2,
        speed_m_s=0.5,
        settings=Vehicle.model_construct(roll_control=roll_control),
    )
    plant = Plant([setup], Ocean(density_kg_m3=1000.0), engine=engine)
    route = Route.at_speed("corner", [[0, 0], [10, 0], [10, 20]], 0.5, 10.0)
    return simulate(plant, [route], 40.0, (None,))


def test_a_rov_stays_upright_in_a_corner() -> None:
    """Thrusters that push it round are 0.085 m below its origin, and heel it if nothing is done."""
    free = in_a_corner("free")
    held = in_a_corner(None)
    assert 5.0 < np.rad2deg(np.arcsin(np.abs(heel_in(free)).max())) < 15.0
    assert np.rad2deg(np.abs(heel_in(held)).max()) < 0.05
    np.testing.assert_allclose(held.position, free.position, atol=0.1)


def test_engines_move_a_vehicle_that_holds_roll_alike() -> None:
    direct, mujoco = (in_a_corner(None, engine) for engine in ("direct", "mujoco"))
    np.testing.assert_allclose(direct.pose, mujoco.pose, rtol=0, atol=1e-9)


def test_missions_side_by_side_hold_roll_as_each_alone() -> None:
    """To the bit; one that leaves roll free does not lie beside the others."""
    for roll_controls in ((None,) * 3, (None, "free", "hold")):
        motions = [
            MotionSettings.of(
                load_scenario(
                    "T5",
                    (
                        "timing.engine=direct",
                        "duration_s=15",
                        "followers.0.model=bluerov2_heavy",
                        "followers.0.waypoints=[[0, 0, 0], [10, 5, 0], [40, 5, 15]]",
                        f"followers.0.drag_scale={1.0 + 0.1 * i}",
                        *([f"followers.0.roll_control={control}"] if control else []),
                    ),
                )
            )
            for i, control in enumerate(roll_controls)
        ]
        for motion, together in zip(motions, simulate_side_by_side(motions), strict=True):
            alone = simulate_open_loop(motion)
            assert together is not None
            assert together.pose.tobytes() == alone.pose.tobytes()
            holds = motion.plan.followers[0].roll_control != "free"
            assert (np.abs(heel_in(alone, 1)).max() < 3e-3) == holds


def heeled_rov() -> str:
    """The ROV with its buoyancy 0.001 m to port of its axis."""
    centre = 'name="buoyancy_centre" data="0 0 0.01"'
    assert centre in ROV
    text = ROV.replace(centre, 'name="buoyancy_centre" data="0 0.001 0.01"')
    return with_linear_thrusters(text)


MOMENT = 13.5 * 9.81 * 0.001  # of its buoyancy, the weight [N m]


def test_a_hull_that_is_left_free_heels_by_the_moment_over_its_stiffness() -> None:
    """M cos φ = k sin φ."""
    plant = plant_of(heeled_rov(), "free")
    righting = design(plant, (None,))[0]["righting"]
    # nothing but turbulence damps its swing: it starts where it will be, and swings a little
    plant.pose[0, 3:] = from_euler(0.0, 0.0, np.arctan(MOMENT / righting))
    heel = np.arcsin(heel_in(hovering(plant, 100.0)))
    assert heel.mean() == pytest.approx(np.arctan(MOMENT / righting), rel=0.01)


def test_a_constant_moment_heels_the_hull_by_that_over_both_stiffnesses_and_fades() -> None:
    """At first by M / (I ω² + k), as of law and hull without integral, which then takes it out with
    10/ω = 12 s.
    """
    plant = plant_of(heeled_rov())
    d = design(plant, (None,))[0]
    omega = d["roll_omega"]
    stiffness = d["roll_inertia"] * omega**2 + d["righting"]
    trajectory = hovering(plant, 60.0)
    time = trajectory.time
    tangent = np.tan(np.arcsin(heel_in(trajectory)))
    expected = MOMENT / stiffness * np.exp(-0.1 * omega * time)
    settled = time > 8.0
    assert tangent[settled] == pytest.approx(expected[settled], abs=0.03 * MOMENT / stiffness)
    assert abs(tangent[-1]) < 0.01 * MOMENT / stiffness


def test_a_roll_decays_as_the_linear_law_has_it() -> None:
    """Of heel, rate of roll, the thrusters' lagging moment K and the integral: I φ̈ = −k φ + K,
    under commands that are held for 0.1 s.
    """
    plant = plant_of(with_linear_thrusters(ROV))
    d = design(plant, (None,))[0]
    inertia, righting, omega = (float(d[key]) for key in ("roll_inertia", "righting", "roll_omega"))
    start = 0.002
    plant.twist[0, 3] = start
    trajectory = hovering(plant, 8.0)
    lag = 0.0287
    stiffness = inertia * omega**2
    motion = np.zeros((4, 4))
    motion[:3] = [
        [0.0, 1.0, 0.0, 0.0],
        [-righting / inertia, 0.0, 1.0 / inertia, 0.0],
        [0.0, 0.0, -1.0 / lag, 1.0 / lag],
    ]
    held = expm(DT * motion)
    step = np.zeros((4, 4))
    step[:3, :3] = held[:3, :3]
    step[:3] += np.outer(held[:3, 3], [-stiffness, -2.0 * inertia * omega, 0.0, 1.0])
    step[3] = -0.1 * omega * (stiffness + righting) * DT, 0.0, 0.0, 1.0
    states = [np.array([0.0, start, 0.0, 0.0])]
    for _ in trajectory.time[1:]:
        states.append(step @ states[-1])
    expected = np.array(states)[:, 0]
    assert heel_in(trajectory) == pytest.approx(expected, abs=0.02 * np.abs(expected).max())
    # natural frequency √(ω² + k / I) and relative damping ω over that, but for the delay
    rates = np.log(np.linalg.eigvals(step).astype(complex)) / DT
    swing = rates[np.argmax(np.where(np.abs(rates) < 5.0, rates.imag, 0.0))]
    natural = np.sqrt(omega**2 + righting / inertia)
    assert abs(swing) == pytest.approx(natural, rel=0.1)
    assert -swing.real / abs(swing) == pytest.approx(omega / natural, rel=0.2)


@pytest.mark.parametrize("fins", ["x", "+"])
def test_four_fins_hold_roll_against_the_torque_of_a_propeller(fins: Any) -> None:
    """At 1 m/s, all of the torque on the hull."""
    hull = from_dimensions(1.8, 0.2, 50.0, fins, 0.14)
    text = hull.xml()
    route = Route.at_speed("line", [[0, 0], [0, 200]], 1.0, 10.0)
    heels = []
    for roll_control in (None, "free"):
        setup = VehicleSetup(
            name="hull",
            model=text,
            position_m=(0.0, 0.0, -10.0),
            speed_m_s=1.0,
            settings=Vehicle.model_construct(roll_control=roll_control, trim="neutral"),
        )
        trajectory = simulate(Plant([setup], Ocean()), [route], 100.0, (None,))
        heels.append(abs(float(heel_in(trajectory)[-1])))
    assert heels[1] > np.deg2rad(0.1)
    assert heels[0] < 0.02 * heels[1]


SQUARE = [[0, 0, 0], [24, 10, 0], [60, 10, 15]]
STATION = {"behind_m": 5.0, "depth_m": 12.0}


@pytest.mark.system
@pytest.mark.parametrize(
    ("table", "vehicle"),
    [
        ({"leader": {"waypoints": SQUARE}, "followers": [{"station": STATION}]}, 1),
        (
            {
                "leader": {"waypoints": SQUARE},
                "followers": [{"station": STATION, "guidance_position": "truth"}],
            },
            1,
        ),
        ({"followers": [{"waypoints": SQUARE, "guidance_position": "estimate"}]}, 1),
        ({"leader": {"waypoints": SQUARE, "guidance_position": "estimate", "navigation": {}}}, 0),
    ],
    ids=["station", "station by truth", "route by estimate", "leader by estimate"],
)
def test_vehicles_hold_roll_by_their_own_sensors(table: dict[str, Any], vehicle: int) -> None:
    """With errors of 0.5° of the inclinometer, and 0.1°/s of the gyros."""
    heels = []
    for roll_control in ("hold", "free"):
        own = {"model": "bluerov2_heavy", "roll_control": roll_control}
        leader = dict(table.get("leader", {}))
        followers = [dict(follower) for follower in table.get("followers", [{"route": "T5"}])]
        (followers[0] if vehicle else leader).update(own)
        scenario = {
            "duration_s": 60,
            "leader": leader,
            "followers": followers,
            "navigation": {"variant": "tight"},
        }
        heels.append(heel_in(laisn_sim.fly(scenario).trajectory, vehicle))
    held, free = (np.rad2deg(np.abs(heel)) for heel in heels)
    assert held.max() < 0.5
    assert free.max() > 3.0
    # exact readings leave less
    by_truth = table.get("followers", [{}])[0].get("guidance_position") == "truth"
    assert (held[50:].mean() < 0.01) == by_truth


# --- stability ---


def test_state_matrices_have_the_law_of_roll() -> None:
    """Moment per heel and rate of roll, behind by the lag; sway and yaw have no moment of roll."""
    plant = plant_of("bluerov2_heavy")
    d = design(plant, (None,))[0]
    [matrix] = _state_matrices(_controlled_hull(plant, 0, d), _straight_ahead(np.array([0.4])))
    inertia, omega = d["roll_inertia"], d["roll_omega"]
    lag = 0.25 / omega
    row = np.zeros(16)
    row[ROLL] = -2.0 * omega * inertia / lag
    row[ROLL + 3] = -(omega**2) * inertia / lag
    row[10 + ROLL] = -1.0 / lag
    np.testing.assert_allclose(matrix[10 + ROLL], row, atol=1e-9)
    free = design(plant_of("bluerov2_heavy", "free"), (None,))[0]
    [matrix] = _state_matrices(_controlled_hull(plant, 0, free), _straight_ahead(np.array([0.4])))
    assert np.abs(matrix[10 + ROLL, :10]).max() > 0.1
    assert matrix[10 + ROLL, ROLL] == matrix[10 + ROLL, ROLL + 3] == 0.0


def test_a_hull_that_does_not_right_itself_is_held_upright() -> None:
    """Its centre of gravity is a little above that of buoyancy."""
    for roll_control in (None, "free"):
        setup = VehicleSetup(
            name="hull",
            model="bluerov2_heavy",
            position_m=(0.0, 0.0, -10.0),
            settings=Vehicle.model_construct(roll_control=roll_control, cg_offset_z_m=0.011),
        )
        plant = Plant([setup], Ocean(density_kg_m3=1000.0))
        d = design(plant, (None,))
        if roll_control is None:
            require_stable(plant, d, 0.4)
            continue
        with pytest.raises(LaisnError, match="cannot stabilise roll"):
            require_stable(plant, d, 0.4)
