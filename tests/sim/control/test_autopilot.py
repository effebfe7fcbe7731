"""Thrust allocation, and step responses of the loops against the second-order systems they are
designed to be.
"""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sim.control import allocation, autopilot
from sim.control.guidance import REFERENCE
from sim.scenario.routes import DepthProfile, Route
from sim.scenario.vehicles import Vehicle
from sim.simulation import DivergedError, simulate
from sim.vehicle import effectors
from sim.vehicle.effector_kinds import BUILT_IN, EFFECTOR
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean
from tests.synthetic import record

thrust = st.floats(-200, 200)
lever = st.floats(0.2, 1.0)
limit = st.tuples(st.floats(-50, -1), st.floats(1, 50))
vector = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))


def effectors_of(forces, places, limits):
    """Records of thrusters: unit forces, positions, and lowest and highest thrust."""
    records = np.zeros(len(forces), EFFECTOR)
    records["force"], records["limits"] = forces, limits
    records["torque"] = np.cross(places, forces)
    return records


def lateral_pair(bow, stern, limits):
    """Lateral thrusters at the bow and the stern."""
    return effectors_of([[0, 1, 0]] * 2, [[bow, 0, 0], [-stern, 0, 0]], limits)


def allocated(records, **wanted):
    """Commands for a wrench, and the wrench that they produce; components by their names in lower
    case. With roll it is the wrench of a user or of an autopilot that holds roll, without it one of
    an autopilot that leaves roll to the hull.
    """
    wrench = np.zeros(6)
    for name, value in wanted.items():
        wrench[getattr(allocation, name.upper())] = value
    command = np.zeros(len(records))
    inverse = allocation.pseudo_inverse(records, records["limits"])
    limits = records["limits"].copy()
    allocation.allocate(inverse, limits, wrench, command)
    if "roll" in wanted:
        wrench[allocation.ROLL] = allocation.add_roll(
            inverse, limits, records.view(np.recarray), wanted["roll"], command
        )
    return command, wrench


@given(thrust, thrust, lever, lever, limit, limit)
def test_allocation_never_exceeds_limits(force, moment, bow, stern, bow_limits, stern_limits):
    limits = np.array([bow_limits, stern_limits])
    command, produced_wrench = allocated(lateral_pair(bow, stern, limits), sway=force, yaw=moment)
    assert np.all(command >= limits[:, 0])
    assert np.all(command <= limits[:, 1])
    # the reported wrench is that of the commands
    assert command.sum() == pytest.approx(produced_wrench[allocation.SWAY], abs=1e-9)
    assert bow * command[0] - stern * command[1] == pytest.approx(
        produced_wrench[allocation.YAW], abs=1e-9
    )


@given(st.floats(-40, 40), st.floats(-40, 40), lever, lever)
def test_allocation_reproduces_what_thrusters_can_give(at_bow, at_stern, bow, stern):
    records = lateral_pair(bow, stern, [[-40, 40]] * 2)
    command, _ = allocated(records, sway=at_bow + at_stern, yaw=bow * at_bow - stern * at_stern)
    assert command == pytest.approx((at_bow, at_stern), abs=1e-9)


@given(thrust, thrust, lever, st.floats(1, 50))
def test_the_moment_comes_first(force, moment, arm, max_thrust):
    """Of a pair with equal levers and limits: the whole moment up to 2 a T, then the force that
    is left.
    """
    command, _ = allocated(
        lateral_pair(arm, arm, [[-max_thrust, max_thrust]] * 2), sway=force, yaw=moment
    )
    expected_moment = np.clip(moment, -2 * arm * max_thrust, 2 * arm * max_thrust)
    assert arm * (command[0] - command[1]) == pytest.approx(expected_moment, abs=1e-9)
    remaining_force = 2 * max_thrust - abs(expected_moment) / arm
    assert command.sum() == pytest.approx(
        np.clip(force, -remaining_force, remaining_force), abs=1e-9
    )


@given(
    st.lists(st.tuples(vector, vector), min_size=3, max_size=8), st.tuples(*[st.floats(-5, 5)] * 6)
)
def test_thrusters_anywhere_give_what_they_can_give_independently(thrusters, wrench):
    """Within limits the commands give the wrench on every component that the pseudo-inverse
    serves, by B u = τ.
    """
    forces, positions = (np.array(column) for column in zip(*thrusters, strict=True))
    assume(np.all(np.linalg.norm(forces, axis=1) > 0.2))
    records = effectors_of(forces, positions, [[-1e6, 1e6]] * len(thrusters))
    inverse = allocation.pseudo_inverse(records, records["limits"])
    served = np.abs(inverse).max(axis=0) > 0
    assume(np.abs(inverse).max() < 1e4)
    names = ("surge", "sway", "heave", "roll", "pitch", "yaw")
    command, produced_wrench = allocated(records, **dict(zip(names, wrench, strict=True)))
    produced = effectors.unit_wrenches(records).T @ command
    np.testing.assert_allclose(produced[served], np.array(wrench)[served], atol=1e-6)
    np.testing.assert_allclose(produced[served], produced_wrench[served], atol=1e-6)
    served[allocation.ROLL] = True  # is reported also where it is a by-product
    assert not produced_wrench[~served].any()
    # as many components as the thrusters have independent wrenches
    served = np.abs(inverse).max(axis=0) > 0
    assert served.sum() <= min(6, len(thrusters))


def seven_thrusters(limit=50.0):
    """Two ahead and two across, these 0.1 m above the origin, and three upward, the third on the
    axis: a wrench of any six components.
    """
    forces = [[1, 0, 0]] * 2 + [[0, 1, 0]] * 2 + [[0, 0, 1]] * 3
    places = [
        *[[-0.5, 0.2, 0], [-0.5, -0.2, 0]],
        *[[0.4, 0, 0.1], [-0.4, 0, 0.1]],
        *[[0.3, 0.15, 0], [0.3, -0.15, 0], [-0.4, 0, 0]],
    ]
    return effectors_of(forces, places, [[-limit, limit]] * 7)


@pytest.mark.parametrize(
    ("sway", "roll"), [(0.0, 0.1), (2.0, 0.0), (-3.0, -0.4)], ids=["roll", "sway", "both"]
)
def test_a_wrench_of_a_user_has_the_roll_that_is_asked_for(sway, roll):
    """Sway pushes 0.1 m above the origin, which rolls the hull by −0.1 m · F; the pair at ±0.15 m
    takes it back, and gives what is asked for.
    """
    command, produced = allocated(seven_thrusters(), sway=sway, roll=roll)
    wrench = effectors.unit_wrenches(seven_thrusters()).T @ command
    np.testing.assert_allclose(wrench, [0, sway, 0, roll, 0, 0], atol=1e-12)
    assert produced == pytest.approx(wrench, abs=1e-12)
    # F_port − F_starboard = (roll + 0.1 F) / 0.15
    assert command[4] - command[5] == pytest.approx((roll + 0.1 * sway) / 0.15)


def test_forces_that_are_allocated_without_roll_leave_it_open():
    command, produced = allocated(seven_thrusters(), sway=2.0)
    assert command[4:] == pytest.approx([0, 0, 0])
    assert command[2:4] == pytest.approx([1, 1])
    assert produced[allocation.ROLL] == 0.0


@given(st.floats(-150, 150), st.floats(-50, 50))
def test_roll_comes_last(heave, roll):
    """Of a pair at ±0.3 m with 50 N each: the whole force up to 100 N, then the moment that is
    left.
    """
    records = effectors_of([[0, 0, 1]] * 2, [[0, 0.3, 0], [0, -0.3, 0]], [[-50, 50]] * 2)
    command, produced = allocated(records, heave=heave, roll=roll)
    force = np.clip(heave, -100, 100)
    left = 0.6 * (50 - abs(force) / 2)
    assert command.sum() == pytest.approx(force, abs=1e-9)
    moment = 0.3 * (command[0] - command[1])
    assert moment == pytest.approx(np.clip(roll, -left, left), abs=1e-9)
    assert produced[allocation.ROLL] == pytest.approx(moment, abs=1e-9)


def test_a_vehicle_without_side_thrusters_serves_neither_sway_nor_yaw():
    records = effectors_of([[1, 0, 0], [0, 0, 1]], [[-0.8, 0, 0], [-0.5, 0, 0]], [[-40, 40]] * 2)
    served = np.abs(allocation.pseudo_inverse(records, records["limits"])).max(axis=0) > 0
    assert served.tolist() == [True, False, False, False, True, False]


@pytest.mark.parametrize("heave_first", [True, False])
@pytest.mark.parametrize("place", [-0.3, 0.3])
def test_a_single_vertical_thruster_serves_either_heave_or_pitch(place, heave_first):
    """A force F at x has the moment -x F about the axis to port."""
    forces = [[1, 0, 0]] * 2 + [[0, 0, 1]]
    places = [[-0.4, 0.2, 0], [-0.4, -0.2, 0], [place, 0, 0]]
    records = effectors_of(forces, places, [[-40, 40]] * 3)
    limits = records["limits"]
    components = allocation.given_components(records, limits, heave_first=heave_first)
    inverse = allocation.pseudo_inverse(records, limits, components)
    heave, pitch = inverse[:, allocation.HEAVE], inverse[:, allocation.PITCH]
    expected = ([0, 0, 1], [0, 0, 0]) if heave_first else ([0, 0, 0], [0, 0, -1 / place])
    np.testing.assert_allclose((heave, pitch), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("place", "force"),
    [
        ([3e-4, -0.1, 0.08], [0, 0, 1]),
        ([0, -0.1, 0.08], [3e-4, 0, 1]),
        ([0, -0.1, 0], [0, 3e-4, 1]),
    ],
)
def test_what_a_thruster_stands_off_by_rounding_gives_no_component(place, force):
    """Four thrusters at 45° and two vertical ones abreast, the second of which is off by 0.3 mm or
    mrad: these share a heave force equally, and a moment of pitch is not given by them.
    """
    diagonal = np.sqrt(0.5)
    forces = [[diagonal, side * diagonal, 0] for side in (1, -1, -1, 1)]
    places = [[x, y, 0] for x in (0.14, -0.14) for y in (-0.09, 0.09)]
    records = effectors_of(
        [*forces, [0, 0, 1], force], [*places, [0, 0.1, 0.08], place], [[-50, 50]] * 6
    )
    assert allocation.PITCH not in allocation.given_components(records, records["limits"])
    command, produced = allocated(records, surge=20.0, heave=30.0, pitch=3.0, yaw=2.0)
    assert produced[allocation.PITCH] == 0.0
    assert command[4:] == pytest.approx([15.0, 15.0], abs=0.05)
    assert produced[allocation.SURGE] == pytest.approx(20.0)


def plant(model="leader", *, ocean=None, depth=10.0, buoyancy=0.0, speed=1.0):
    setup = VehicleSetup(
        name=model,
        model=model,
        position_m=(0.0, 0.0, -depth),
        speed_m_s=speed,
        settings=Vehicle.model_construct(excess_buoyancy_n=buoyancy),
    )
    return Plant([setup], ocean or Ocean())


def northbound(depth=None, speed=1.0):
    """Straight north; the vehicle starts on it."""
    return Route.at_speed("north", [[0, 0], [0, 2000]], speed, depth or DepthProfile.constant(10.0))


def test_the_design_is_read_from_the_vehicle():
    # leader.xml: mass 67.1515, added 1.96437, 63.43995, 11.44948; inertia 13.64016 about a centre
    # 0.02 m low; lag 0.3 s
    design = autopilot.design(plant(), ("pitch",))[0]
    assert design["omega"] == pytest.approx(1 / 1.2)
    assert design["surge_mass"] == pytest.approx(67.1515 + 1.96437)
    assert design["heave_mass"] == pytest.approx(67.1515 + 63.43995)
    assert design["yaw_inertia"] == pytest.approx(13.64016 + 11.44948)
    assert design["pitch_inertia"] == pytest.approx(13.64016 + 67.1515 * 0.02**2 + 11.44948)
    assert design["righting"] == pytest.approx(67.1515 * 9.81 * 0.02)
    # a pair at ±0.62 m: half of the side force each, and the moment over the distance between them
    np.testing.assert_allclose(
        design["slow_allocation"][1:3, [allocation.SWAY, allocation.YAW]],
        [[0.5, 1 / 1.24], [0.5, -1 / 1.24]],
    )
    assert not design["slow_allocation"][5:].any()
    assert design["effectors"]["limits"][0].tolist() == [-60, 150]


@pytest.mark.parametrize("model", ["leader", "follower"])
def test_the_drag_that_the_autopilot_expects_is_that_of_the_plant(model):
    # at constant speed thrust is drag; nothing is left for the integral or the along-track
    # correction to do
    trajectory = simulate(plant(model), [northbound()], 60.0)
    design = autopilot.design(plant(model), ("pitch",))[0]
    # of v = 1 m/s
    expected = design["drag"] + design["drag_linear"] * np.exp(-design["drag_fade"])
    assert trajectory.effector_states[-1, 0, 0] == pytest.approx(expected, rel=1e-3)
    assert trajectory.forward_speed[-1, 0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("model", ["leader", "follower"])
@pytest.mark.parametrize("speed", [1.0, 2.0])
def test_a_turn_of_ninety_degrees_is_flown_at_ten_degrees_per_second(model, speed):
    route = Route.at_speed("corner", [[0, 0], [0, 80], [160, 80]], speed, 10.0)
    trajectory = simulate(plant(model, speed=speed), [route], 160.0 / speed)
    rate = -trajectory.angular_velocity[:, 0, 2]
    assert np.rad2deg(rate.max()) == pytest.approx(10.0, abs=1.0)
    # from 5 to 85 degrees in 8 s
    heading = np.rad2deg((trajectory.heading[:, 0] + 1.0) % (2 * np.pi) - 1.0)
    duration = trajectory.time[np.argmax(heading > 85)] - trajectory.time[np.argmax(heading > 5)]
    assert duration == pytest.approx(8.0, abs=0.3)
    # a well damped loop: the overshoot stays below a fifth of a second's turning
    assert heading.max() < 92.0
    assert heading[-1] == pytest.approx(90.0, abs=0.2)


@pytest.mark.parametrize(("model", "top_speed"), [("leader", 3.0), ("follower", 3.0)])
def test_speed_changes_at_a_fifth_of_a_metre_per_second_squared(model, top_speed):
    # 1 to 3 m/s at 0.2 m/s² takes 10 s; the ramp is the reference's, the vehicle lags it by less
    # than its bandwidth
    time = np.array([0.0, 30.0, 90.0])
    north = np.array([0.0, 30.0, 30.0 + 60.0 * top_speed - (top_speed - 1) ** 2 / 0.4])
    route = Route.timed("ramp", np.column_stack([time, 0 * time, north]), 10.0)
    trajectory = simulate(plant(model), [route], 90.0)
    speed = trajectory.forward_speed[:, 0]
    assert speed.max() < top_speed + 0.02
    assert speed[-1] == pytest.approx(top_speed, abs=0.02)
    ramp = (trajectory.time > 33) & (trajectory.time < 39)
    slope = np.polyfit(trajectory.time[ramp], speed[ramp], 1)[0]
    assert slope == pytest.approx(0.2, abs=0.005)


@pytest.mark.parametrize("buoyancy", [-12.0, 3.0, 12.0])
@pytest.mark.parametrize("model", ["leader", "follower"])
def test_depth_is_held_by_trim_against_excess_buoyancy(model, buoyancy):
    trajectory = simulate(plant(model, buoyancy=buoyancy), [northbound(speed=1.2)], 200.0)
    settled = trajectory.time > 150
    assert trajectory.depth[settled, 0] == pytest.approx(10.0, abs=0.02)
    # buoyant: the nose stays down; the lift of the incidence follows from the hull's and the fins'
    # coefficients
    design = autopilot.design(plant(model), ("pitch",))[0]
    linear_incidence = -buoyancy / (design["lift"] * 1.2**2)
    # cross-flow drag helps: the angle is less than the linear lift alone requires, but of its order
    assert 0.6 * abs(linear_incidence) < abs(trajectory.pitch[-1, 0]) < abs(linear_incidence)
    assert np.sign(trajectory.pitch[-1, 0]) == -np.sign(buoyancy)
    assert np.abs(trajectory.effector_states[-1, 0, 3:].sum()) < 0.1 * abs(buoyancy)


@pytest.mark.parametrize("model", ["leader", "follower"])
def test_depth_is_held_by_thrust_with_a_level_hull(model):
    trajectory = simulate(plant(model, buoyancy=7.0), [northbound()], 150.0, ("thrust",))
    assert trajectory.depth[-1, 0] == pytest.approx(10.0, abs=0.02)
    assert np.rad2deg(trajectory.pitch[-1, 0]) == pytest.approx(0.0, abs=0.1)
    # what floats up is pushed down
    assert trajectory.effector_states[-1, 0, 3:].sum() == pytest.approx(-7.0, abs=0.2)


@pytest.mark.parametrize("mode", ["pitch", "thrust"])
def test_slow_vehicles_hold_depth_too(mode):
    trajectory = simulate(
        plant("follower", buoyancy=3.0, speed=0.3), [northbound(speed=0.3)], 150.0, (mode,)
    )
    assert trajectory.depth[-1, 0] == pytest.approx(10.0, abs=0.03)


@pytest.mark.parametrize("mode", ["pitch", "thrust"])
@pytest.mark.parametrize("model", ["leader", "follower"])
def test_a_step_of_depth_settles_without_much_overshoot(model, mode):
    profile = DepthProfile.through([[0, 10], [20, 10], [20.1, 12]])
    trajectory = simulate(plant(model), [northbound(profile)], 120.0, (mode,))
    assert trajectory.depth[:, 0].max() < 12 + 0.25 * 2
    settled = trajectory.time > 20 + 60
    assert trajectory.depth[settled, 0] == pytest.approx(12.0, abs=0.05)
    steepest = np.rad2deg(np.abs(trajectory.pitch).max())
    if mode == "pitch":
        assert 10 < steepest < 22
    else:
        # 2 m in 6 s at 1 m/s along is a path of 18°; the hull stays level by comparison
        assert steepest < 6


def test_integrals_do_not_wind_up_while_thrusters_are_at_their_limit():
    # an increment, the force that is demanded, and the force that thrusters give
    assert autopilot._increment(0.5, 200.0, 150.0) == 0.0
    assert autopilot._increment(-0.5, 200.0, 150.0) == -0.5
    assert autopilot._increment(0.5, 100.0, 100.0) == 0.5
    assert autopilot._increment(-0.5, -200.0, -60.0) == 0.0


def test_a_route_against_a_current_is_kept():
    ocean = Ocean(current_speed_m_s=0.4, current_direction_rad=np.pi / 2)
    trajectory = simulate(plant(ocean=ocean), [northbound()], 150.0)
    settled = trajectory.time > 60
    assert np.abs(trajectory.position[settled, 0, 0]).max() < 0.05
    # 0.4 m/s from the west: the sine of the crab angle is 0.4 over the speed through the water
    assert trajectory.heading[-1, 0] - 2 * np.pi == pytest.approx(-np.arctan2(0.4, 1.0), abs=0.01)
    assert trajectory.forward_speed[-1, 0] == pytest.approx(np.hypot(0.4, 1.0), abs=0.01)


def test_a_lost_state_stops_the_flight_where_it_appears():
    vehicle = plant()

    def corrupt_state(time):
        if time == 50.0:
            vehicle.twist[0, 0] = np.nan

    with pytest.raises(DivergedError, match="the state of leader is lost") as caught:
        simulate(vehicle, [northbound()], 60.0, progress=corrupt_state)
    # lost is the state that follows the instant at which progress is reported
    assert caught.value.trajectory.time[-1] == pytest.approx(50.0)
    assert np.isfinite(caught.value.trajectory.velocity).all()


def test_progress_is_reported_rarely():
    progress_times = []
    simulate(plant(), [northbound()], 100.0, progress=progress_times.append)
    assert progress_times == pytest.approx([0, 50])


def test_motion_through_the_water_is_along_the_hulls_own_axes():
    """Against SciPy's rotations: hull pitched and rolled, in water that rises and drifts."""
    rng = np.random.default_rng(7)
    for rotation in Rotation.random(5, rng=rng):
        pose = np.r_[3.0, 4.0, -9.0, rotation.as_quat()[[3, 0, 1, 2]]]
        twist, water = rng.normal(size=6), rng.normal(size=3)
        motion = autopilot.true_motion(pose, twist, water)
        through_water = rotation.inv().apply(twist[:3] - water)
        forward = rotation.apply([1.0, 0.0, 0.0])
        assert motion == pytest.approx(
            (
                through_water[0],
                through_water[1],
                np.arctan2(*forward[:2]),
                twist[5],
                np.arcsin(forward[2]),
                twist[4],
                rotation.apply([0.0, 1.0, 0.0])[2],
                twist[3],
                9.0,
                -twist[2],
            )
        )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_integrals_follow_their_errors_until_thrusters_are_at_their_limit(sign):
    """Half a degree off in heading and pitch, 1 cm/s off in speed, 5 cm off in depth; then half a
    radian off, turning away at 5 rad/s.
    """
    (design,) = autopilot.design(plant(), ("pitch",))
    reference, dt = record(REFERENCE), 0.1
    reference.depth = 10.0

    def step_off_reference(angle, speed, depth, rate=0.0):
        motion = autopilot.HullMotion(
            surge=1.0 - sign * speed,
            sway=0.0,
            heading=-sign * angle,
            turning=sign * rate,
            pitch=-sign * angle,
            pitching=sign * rate,
            heel=0.0,
            rolling=0.0,
            depth=10.0 - sign * depth,
            sinking=0.0,
        )
        memory, command = record(autopilot.AUTOPILOT_MEMORY), np.zeros(5)
        autopilot.control(BUILT_IN, design, (0.0, 0.0, 1.0), reference, motion, dt, memory, command)
        return memory, command

    angle, omega = np.deg2rad(0.5), design["omega"]
    memory, command = step_off_reference(angle, 0.01, 0.0)
    assert memory.heading_integral == pytest.approx(
        -sign * 0.1 * design["yaw_inertia"] * omega**3 * angle * dt
    )
    assert memory.pitch_integral == pytest.approx(
        sign * 0.1 * design["pitch_inertia"] * omega**3 * angle * dt
    )
    # the hull's way over ground is its way through the water times the cosine of its pitch
    speed_error = 1.0 / np.cos(angle) - (1.0 - sign * 0.01)
    assert memory.speed_integral == pytest.approx(
        0.05 * design["surge_mass"] * omega**2 * speed_error * dt
    )
    assert np.all(np.abs(command) < design["effectors"]["limits"][:5, 1])
    saturated, command = step_off_reference(0.5, 0.0, 0.0, rate=5.0)
    assert saturated.heading_integral == saturated.pitch_integral == 0.0
    assert np.max(np.abs(command[1:])) == design["effectors"]["limits"][1, 1]
    off_depth, _ = step_off_reference(0.0, 0.0, 0.05)
    assert (
        sign * off_depth.depth_integral < 0.0 == step_off_reference(0.0, 0.0, 0.0)[0].depth_integral
    )
