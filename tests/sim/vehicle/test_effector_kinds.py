"""Propellers, moving fins and curves of thrust: forces by closed form, vehicles by the balances
of their sources.
"""

import re

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq, fsolve

import laisn_sim
import models
from experiments.flight.library import vehicle_rows
from laisn.arrays import Floats
from sim.assembly import routes_of
from sim.control.allocation import PITCH, SURGE, YAW, allocate, pseudo_inverse, pseudo_inverse_at
from sim.control.autopilot import AUTOPILOT_MEMORY, apply_wrench, design, top_speed
from sim.control.guidance import reference
from sim.control.stability import least_radius, steady_turn
from sim.scenario.parts import MissionPlan
from sim.scenario.routes import DepthProfile, Route, library_route
from sim.simulation import simulate
from sim.trial import trial
from sim.vehicle import effectors, mjcf
from sim.vehicle.effector_kinds import (
    BUILT_IN,
    EFFECTOR,
    CurveThruster,
    EffectorKind,
    Fin,
    HullFlow,
    Propeller,
    Thruster,
)
from sim.vehicle.effectors import Fitted, kind_of, number_of
from sim.vehicle.hull_file import from_dimensions
from sim.vehicle.hydrodynamics import coupled_damping
from sim.vehicle.mjcf import VehicleSetup, spec_of
from sim.vehicle.own_hull import hull_errors
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean
from tests.sim.vehicle import remus_formation
from tests.synthetic import only
from tools.documents.hull_trials import PUBLISHED_BLUEROV, bluerov_speed
from tools.documents.route_keeping import tracking

RHO = 1026.0
PUBLISHED_VEHICLES = ("remus100", "lauv", "bluerov2_heavy")


def plant_of(*names: str, speed: float = 0.0) -> Plant:
    """Vehicles of these models, 20 m apart at a depth of 10 m."""
    return Plant(
        [
            VehicleSetup(
                name=f"v{i}", model=name, position_m=(0.0, 20.0 * i, -10.0), speed_m_s=speed
            )
            for i, name in enumerate(names)
        ],
        Ocean(),
    )


def record(
    kind: type[EffectorKind],
    axis: tuple[float, float, float],
    position: tuple[float, float, float],
    *parameters: float,
) -> Floats:
    """The record of an effector, shape (1,)."""
    effector = np.zeros(1, EFFECTOR)
    effector["fades"] = kind.fades
    effector["kind"], effector["force"], effector["place"], effector["torque"] = (
        number_of(kind),
        axis,
        position,
        np.cross(position, axis),
    )
    effector["parameters"][0, : len(parameters)] = parameters
    return effector


def flow(v: tuple[float, float, float], w: tuple[float, float, float]) -> HullFlow:
    """Flow of an upright hull by its velocity [m/s] and angular velocity [rad/s] in the body."""
    return HullFlow(RHO, 9.81, v, w, (0.0, 0.0, 1.0))


def effector_load(
    effector: Floats, state: float, v: tuple[float, float, float], w: tuple[float, float, float]
) -> Floats:
    """Force and moment of one effector that are not thrust, shape (6,), [N] and [N m]."""
    fitted = Fitted(BUILT_IN, effector[None], np.array([[state]]))
    thrust, torque, force, moment = effectors.effector_wrench(fitted, 0, flow(v, w))
    assert not any((*thrust, *torque))
    return np.array([*force, *moment])


@pytest.mark.system
@pytest.mark.parametrize("angle", [0.0, np.pi / 4, np.pi / 2, 3.0])
@pytest.mark.parametrize(("u", "turn_rate"), [(1.5, 0.0), (1.5, 0.2), (0.4, -0.1), (-0.8, 0.1)])
def test_fin_has_the_force_of_a_plate_in_the_flow_at_its_place(
    angle: float, u: float, turn_rate: float
) -> None:
    """The closed form ½ρ S a U² sin α |cos α| across the chord, from angles instead of
    components.
    """
    axis, position = (0.0, np.cos(angle), np.sin(angle)), (-0.7, 0.1, -0.05)
    area, slope, stall, drag, deflection = 0.01, 2.5, 0.4, 0.02, 0.12
    fin = record(Fin, axis, position, area, slope, stall, drag)
    # the hull moves along the axis too, and the fin with w × r
    w = np.array([0.0, -turn_rate * axis[2], turn_rate * axis[1]])
    v = np.array([u, 0.05 * axis[1], 0.05 * axis[2]])
    local = v + np.cross(w, position)
    along, across = local[0], local @ axis
    flow_angle, square = np.arctan2(across, along), along**2 + across**2
    incidence = deflection - flow_angle
    normal = 0.5 * RHO * area * slope * square * np.sin(incidence) * abs(np.cos(incidence))
    drag_force = 0.5 * RHO * area * drag * square
    forward_force = -normal * np.sin(deflection) - drag_force * np.cos(flow_angle)
    axis_force = normal * np.cos(deflection) - drag_force * np.sin(flow_angle)
    force = np.array([forward_force, *(axis_force * np.array(axis[1:]))])
    expected = [*force, *np.cross(position, force)]
    np.testing.assert_allclose(
        effector_load(fin, deflection, tuple(v), tuple(w)), expected, rtol=1e-9, atol=1e-12
    )


def test_fin_keeps_the_force_of_its_stall_angle() -> None:
    fin = record(Fin, (0, 1, 0), (-0.7, 0, 0), 0.01, 2.5, 0.3, 0.0)
    no_turn = (0.0, 0.0, 0.0)
    normal = [
        np.hypot(*effector_load(fin, angle, (1.0, 0.0, 0.0), no_turn)[:2])
        for angle in (0.29, 0.3, 0.5, 1.2)
    ]
    assert normal[0] < normal[1]
    np.testing.assert_allclose(
        normal[1:], 0.5 * RHO * 0.01 * 2.5 * np.sin(0.3) * np.cos(0.3), rtol=1e-9
    )


def test_a_fixed_fin_is_a_moving_one_that_is_not_deflected() -> None:
    fin = record(Fin, (0, 0.6, 0.8), (-0.7, 0.1, 0.05), 0.01, 2.5, 0.3, 0.02)
    v, w = (1.2, -0.2, 0.3), (0.1, 0.2, -0.3)
    _, _, force, moment = effectors.effector_wrench(
        Fitted(BUILT_IN, fin[None], np.zeros((1, 0))), 0, flow(v, w)
    )
    np.testing.assert_array_equal([*force, *moment], effector_load(fin, 0.0, v, w))


def test_propeller_has_thrust_and_torque_of_its_coefficients() -> None:
    """Against K_T and K_Q over J as printed in Fossen's remus100.py: linear from 0 to 0.6632."""
    propeller = plant_of("remus100").effectors[0, :1]
    u, n, diameter = 1.6, 20.0, 0.14
    advance = 0.944 * u / (n * diameter)
    thrust = np.interp(advance, [0, 0.6632], [0.4566, 0.1798]) * RHO * n**2 * diameter**4
    torque = np.interp(advance, [0, 0.6632], [0.0700, 0.0312]) * RHO * n**2 * diameter**5
    no_turn = (0.0, 0.0, 0.0)
    np.testing.assert_allclose(
        effector_load(propeller, n, (u, 0.0, 0.0), no_turn),
        [0.9 * thrust, 0, 0, torque / 10, 0, 0],
        rtol=1e-4,
        atol=1e-12,
    )
    astern = effector_load(propeller, -n, (u, 0.0, 0.0), no_turn)
    np.testing.assert_allclose(
        astern[[0, 3]],
        [-0.9 * 0.4566 * RHO * n**2 * diameter**4, -0.07 * RHO * n**2 * diameter**5 / 10],
    )


NO_TURN = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("n", [-20.0, -6.0, 6.0, 20.0])
@pytest.mark.parametrize("u", [-1.6, -0.5, 0.0, 0.5, 1.6])
def test_propeller_astern_is_the_mirror_image_of_one_ahead(n: float, u: float) -> None:
    """Seen from behind, a propeller that turns astern turns ahead: signs of rate, flow, thrust and
    torque change together. On an axis that points astern, force and moment stay the same.
    """
    propeller = plant_of("remus100").effectors[0, :1]
    load = effector_load(propeller, n, (u, 0.0, 0.0), NO_TURN)
    mirrored = effector_load(propeller, -n, (-u, 0.0, 0.0), NO_TURN)
    np.testing.assert_array_equal(mirrored, -load)
    turned = propeller.copy()
    turned["force"] *= -1.0
    turned["torque"] *= -1.0
    np.testing.assert_array_equal(effector_load(turned, -n, (u, 0.0, 0.0), NO_TURN), load)
    # with the flow by the advance, against it as at rest
    square = 0.14**4 * n * abs(n)
    advance = max(0.944 * u / (n * 0.14), 0.0)
    assert load[0] == pytest.approx(0.9 * RHO * square * (0.4566 - 0.41737 * advance), rel=1e-9)
    torque = 0.1 * RHO * square * 0.14 * (0.07 - 0.058504 * advance)
    assert load[3] == pytest.approx(torque, rel=1e-9)


@pytest.mark.parametrize("speed", [-2.0, -0.6, 0.0, 0.6, 2.0])
@pytest.mark.parametrize("force", [-60.0, -9.0, -0.5, 0.0, 0.5, 9.0, 60.0])
def test_limits_and_states_of_a_propeller_astern_are_mirrored(speed: float, force: float) -> None:
    propeller = plant_of("remus100").effectors[0, 0]
    low, high = effectors.force_limits(BUILT_IN, propeller, RHO, speed)
    assert effectors.force_limits(BUILT_IN, propeller, RHO, -speed) == (-high, -low)
    state = effectors.state_for(BUILT_IN, propeller, RHO, force, speed)
    assert state == -effectors.state_for(BUILT_IN, propeller, RHO, -force, -speed) or speed == 0.0
    # a force the way the vehicle moves, or none, is given; some against it begin with a jump
    if force * speed >= 0.0:
        record_of_one = np.array([propeller], dtype=EFFECTOR)
        load = effector_load(record_of_one, state, (speed, 0.0, 0.0), NO_TURN)
        assert load[0] == pytest.approx(force, rel=1e-9, abs=1e-9)


def torpedo(gear: str = "1 0 0 0 0 0") -> str:
    """A hull with a propeller without torque on it."""
    text = from_dimensions(1.8, 0.2, 50.0, fins="x", propeller=0.14).xml()
    text = re.sub(r'(site="propeller" gear=)"[^"]*"', rf'\1"{gear}"', text)
    return re.sub(r'("propeller.propeller" data="[^"]*) \S+"', r'\1 0"', text)


@pytest.mark.parametrize("gear", ["1 0 0 0 0 0", "-1 0 0 0 0 0"])
def test_a_propeller_on_an_axis_that_points_astern_drives_a_hull_at_the_same_speed(
    gear: str,
) -> None:
    """At 10 1/s ahead, at the speed where thrust, with its inflow, and drag balance."""
    plant = plant_of(torpedo(gear), speed=1.0)
    c, fins = plant.coefficients[0], plant.effectors[0, 1:]
    area = c["hull_lift"][0] * c["hull_lift"][1] + (fins["parameters"][:, 0] * 0.01).sum()
    diameter, kt, kt_slope, _, _, wake, deduction, _ = plant.effectors["parameters"][0, 0]

    def balance(u: float) -> float:
        thrust = kt * 10.0 * diameter + kt_slope * (1.0 - wake) * u
        linear = c["linear_damping"][0] * np.exp(-c["linear_damping_fade"][0] * u) * u
        drag = 0.5 * RHO * area * u * u + linear
        return float((1.0 - deduction) * RHO * diameter**3 * 10.0 * thrust - drag)

    command = np.zeros((1, 5))
    command[0, 0] = 10.0 if gear.startswith("1") else -10.0
    plant.step(command, 5000)
    speed = brentq(balance, 0.1, 5.0)
    assert np.linalg.norm(plant.twist[0, :3]) == pytest.approx(speed, abs=1e-4)
    # the autopilot expects the same of it
    ahead, (d,) = design(plant_of(torpedo()), (None,))[0], design(plant, (None,))
    assert top_speed(d) == top_speed(ahead)
    for wanted in (-3.0, 2.0, 20.0):
        states = []
        for autopilot in (ahead, d):
            memory = np.zeros(1, AUTOPILOT_MEMORY).view(np.recarray)[0]
            memory.wrench[SURGE] = wanted
            answer = np.zeros(5)
            apply_wrench(BUILT_IN, autopilot.view(np.recarray)[()], 1.2, memory, answer)
            states.append(answer[0] * autopilot["effectors"]["force"][0, 0])
        assert states[0] == states[1]


@pytest.mark.parametrize("name", PUBLISHED_VEHICLES)
@pytest.mark.parametrize("speed", [0.6, 1.2, 2.0])
def test_states_give_the_requested_forces(name: str, speed: float) -> None:
    for effector in plant_of(name).effectors[0]:
        low, high = effectors.force_limits(BUILT_IN, effector, RHO, speed)
        for force in np.linspace(low, high, 9):
            if isinstance(kind_of(effector), Propeller) and low < force < 0:
                continue  # no state gives these: thrust astern begins with a jump
            state = effectors.state_for(BUILT_IN, effector, RHO, force, speed)
            assert effector["limits"][0] - 1e-9 <= state <= effector["limits"][1] + 1e-9
            no_turn = (0.0, 0.0, 0.0)
            record_of_one = np.array([effector], dtype=EFFECTOR)
            if isinstance(kind_of(effector), Thruster):
                assert state == force
            else:
                load = effector_load(record_of_one, state, (speed, 0.0, 0.0), no_turn)
                actual = load[:3] @ effector["force"]
                # fins: the law is linear in the deflection; cubic terms are left out
                assert actual == pytest.approx(
                    force, rel=0.16 if isinstance(kind_of(effector), Fin) else 1e-6, abs=1e-9
                )


def test_dead_zone_and_unequal_limits_of_a_curve() -> None:
    """A curve with a dead zone is read, holds beyond its ends and is inverted outside the dead
    zone.
    """
    thruster = record(CurveThruster, (1, 0, 0), (0, 0, 0))
    thruster["points"], thruster["limits"] = 4, (-1.0, 1.0)
    thruster["curve"][0, :4] = [[-1, -40], [-0.1, 0], [0.1, 0], [1, 50]]
    at_rest = (0.0, 0.0, 0.0)
    thrusts = [
        effector_load(thruster, state, at_rest, at_rest)[0]
        for state in (-2.0, -0.55, 0.0, 0.05, 0.55, 3.0)
    ]
    np.testing.assert_allclose(thrusts, [-40, -20, 0, 0, 25, 50])
    states = [
        effectors.state_for(BUILT_IN, thruster[0], RHO, force, 0.0)
        for force in (-40.0, -20.0, 0.0, 25.0, 50.0, 60.0)
    ]
    np.testing.assert_allclose(states, [-1, -0.55, 0, 0.55, 1, 1])


def test_state_follows_the_command_with_the_lag_of_the_mjcf() -> None:
    plant = plant_of("remus100")
    command = np.array([[20.0, 0.2, 0.2, -0.1, -0.1]])
    plant.step(command, 25)
    expected = command[0] * -np.expm1(-0.5 / np.array([1.0, 0.1, 0.1, 0.1, 0.1]))
    np.testing.assert_allclose(plant.effector_states[0], expected, rtol=1e-9)
    plant.step(10 * command, 500)
    np.testing.assert_allclose(
        plant.effector_states[0], [25.4167, 0.261799, 0.261799, -0.261799, -0.261799], rtol=1e-4
    )


def test_allocation_by_stern_fins_gives_the_requested_moments() -> None:
    plant = plant_of("remus100")
    effector_records = plant.effectors[0]
    slow, fast = (
        pseudo_inverse(effector_records, effectors.force_limits_of(effector_records, RHO, speed))
        for speed in (0.5, 2.0)
    )
    wrench = np.zeros(6)
    wrench[SURGE], wrench[PITCH], wrench[YAW] = 10.0, 1.0, -0.5
    requested, force = wrench.copy(), np.zeros(5)
    limits = effectors.force_limits_of(effector_records, RHO, 1.3)
    inverse = np.empty(slow.shape)
    pseudo_inverse_at(slow, fast, 1.3, inverse)
    allocate(inverse, limits, wrench, force)
    np.testing.assert_array_equal(wrench, requested)
    actual = effectors.unit_wrenches(effector_records).T @ force
    np.testing.assert_allclose(
        actual[[SURGE, PITCH, YAW]], requested[[SURGE, PITCH, YAW]], rtol=1e-12
    )
    assert actual[3] == pytest.approx(0.0, abs=1e-12)  # the fins of a pair do not roll the hull


FIN_NAMES = ("fin_port", "fin_starboard")


def mixed_hull() -> str:
    """The follower's hull with its five thrusters and two moving stern planes."""
    text = laisn_sim.hull("follower").replace(
        'class="fin" size="0.051 0.0662 0.004"', 'class="fin" size="0.05 0.06 0.004"'
    )
    sites = "".join(
        f'<site name="{name}" pos="-0.72 {port} 0"/>'
        for name, port in zip(FIN_NAMES, (0.11, -0.11), strict=True)
    )
    fins = "".join(
        f'<general name="{name}" site="{name}" gear="0 0 1 0 0 0" dyntype="filterexact" '
        'dynprm="0.1" gainprm="0" ctrlrange="-0.3 0.3"/>'
        for name in FIN_NAMES
    )
    numerics = "".join(f'<numeric name="{name}.fin" data="0.01 3 0.4 0.01"/>' for name in FIN_NAMES)
    text = re.sub(r"<keyframe>.*</keyframe>", "", text, flags=re.DOTALL)
    text = text.replace('<site name="cg"', f'{sites}<site name="cg"').replace(
        "</actuator>", f"{fins}</actuator>"
    )
    return text.replace("</custom>", f"{numerics}</custom>")


def test_fins_take_over_from_thrusters_as_the_speed_grows() -> None:
    assert hull_errors(mixed_hull(), "follower") == []
    plant = plant_of(mixed_hull())
    autopilot = design(plant, (None,))[0]
    effector_records = plant.effectors[0]
    fractions_of_fins = []
    for speed in (0.3, 1.0, 1.5, 2.5):
        inverse = np.empty((effector_records.size, 6))
        pseudo_inverse_at(
            autopilot["slow_allocation"][: effector_records.size],
            autopilot["fast_allocation"][: effector_records.size],
            speed,
            inverse,
        )
        moments = (
            effectors.unit_wrenches(effector_records)[:, PITCH]
            * inverse[: effector_records.size, PITCH]
        )
        assert moments.sum() == pytest.approx(1.0, rel=1e-9)
        fractions_of_fins.append(moments[effector_records["lift_area"] > 0.0].sum())
    assert np.all(np.diff(fractions_of_fins) > 0)


@pytest.mark.parametrize("name", PUBLISHED_VEHICLES)
@pytest.mark.parametrize("role", ["leader", "follower"])
def test_vehicles_have_all_that_a_hull_needs(name: str, role: str) -> None:
    assert hull_errors(models.path(name).read_text("utf-8"), role) == []


def test_vehicles_are_listed_with_effectors_and_limits() -> None:
    limits_by_name = {row[0]: row[1:] for row in vehicle_rows()}
    assert list(limits_by_name) == list(models.VEHICLES)
    assert limits_by_name["remus100"][1:] == (
        "31.03 kg",
        "1 propeller -1525 … 1525 rpm, 4 fin -15 … 15 °",
    )
    assert limits_by_name["remus100"][0].startswith("1.6")
    assert limits_by_name["bluerov2_heavy"][2] == "8 thruster -1 … 1"


@pytest.mark.parametrize("name", ["remus100", "lauv"])
def test_torpedoes_keep_route_and_depth(name: str) -> None:
    """Two corners of 10° and a dive by 4 m, at 1.2 m/s."""
    depth = DepthProfile(time=np.array([0.0, 60.0, 140.0]), depth=np.array([10.0, 10.0, 14.0]))
    route = Route.at_speed("turns", [[0, 0], [90, 0], [170, 14], [260, 14]], 1.2, depth)
    setup = VehicleSetup(
        name="one", model=name, position_m=(0.0, 0.0, -10.0), heading_rad=np.pi / 2, speed_m_s=1.2
    )
    report = tracking(simulate(Plant([setup], Ocean()), [route], 215.0, [None]), [route])[0]
    assert report.cross_track_rms < 0.5
    assert report.depth_error_rms < 0.2


def test_bluerov_keeps_route_and_depth_at_half_a_metre_a_second() -> None:
    route = Route.at_speed("square", [[0, 0], [40, 0], [40, 40]], 0.5, 10.0)
    setup = VehicleSetup(
        name="one",
        model="bluerov2_heavy",
        position_m=(0.0, 0.0, -10.0),
        heading_rad=np.pi / 2,
        speed_m_s=0.5,
    )
    report = tracking(simulate(Plant([setup], Ocean()), [route], 155.0, [None]), [route])[0]
    assert report.cross_track_rms < 0.5
    assert report.depth_error_rms < 0.2


def test_bluerov_has_the_steady_speeds_of_thrust_against_drag() -> None:
    """Four thrusters of 30.4 N at 45° against the drag 13.7 u + 141 u² of the published model."""
    plant = plant_of("bluerov2_heavy")
    thrust = 4 * 30.4 / np.sqrt(2)
    speed = brentq(lambda u: 13.7 * u + 141 * u * u - thrust, 0, 5)
    assert top_speed(design(plant, (None,))[0]) == pytest.approx(speed, abs=0.02)
    # turning on the spot: lever (0.156 + 0.111) / √2 of each thruster against 1.5 r²
    turning = np.array([[1.0, -1.0, -1.0, 1.0, 0, 0, 0, 0]])
    levers = plant.effectors["torque"][0, :4, 2]
    np.testing.assert_allclose(np.abs(levers), (0.156 + 0.111) / np.sqrt(2), rtol=1e-6)
    turning[0, :4] = np.sign(levers)
    plant.step(turning, 1000)
    rate = np.sqrt(4 * 30.4 * (0.156 + 0.111) / np.sqrt(2) / 1.5)
    assert abs(plant.twist[0, 5]) == pytest.approx(rate, rel=0.01)


@pytest.mark.parametrize("trial_name", PUBLISHED_BLUEROV)
def test_bluerov_has_the_steady_speeds_of_the_published_code(trial_name: str) -> None:
    """In fresh water, as there; thrust is within 1 % of the polynomial."""
    assert bluerov_speed(trial_name) == pytest.approx(PUBLISHED_BLUEROV[trial_name], rel=0.01)


def test_lauv_turns_as_its_balances_predict() -> None:
    """The steady turn of surge, sway and yaw, solved from the equations of uuv_simulator on their
    own.

    Roll, pitch and the height of the fins are left out of them.
    """
    plant = plant_of("lauv", speed=1.2)
    rudder, thrust = 0.1, 10.0
    plant.step(np.array([[thrust, rudder, rudder, 0.0, 0.0]]), 3000)
    velocity = np.array(mujoco_rotation(plant)).T @ plant.twist[0, :3]

    def rates(x: Floats) -> Floats:
        u, v, r = x
        across = v - 0.4 * r
        square, flow = u * u + across * across, np.arctan2(across, u)
        incidence = rudder - flow
        fin = 0.5 * RHO * 2 * 0.0064 * 3.0 * square * np.sin(incidence) * np.cos(incidence)
        return np.array(
            [
                thrust - fin * np.sin(rudder) - (2.4 + 2.4 * abs(u)) * u + (18 + 16) * v * r,
                fin * np.cos(rudder)
                - (23 + 80 * abs(v)) * v
                + (11.5 + 0.3 * abs(r)) * r
                - (18 + 1) * u * r,
                -0.4 * fin * np.cos(rudder)
                - (9.7 + 9.1 * abs(r)) * r
                - (3.1 + 1.5 * abs(v)) * v
                - (16 - 1) * u * v,
            ]
        )

    u, v, r = fsolve(rates, [velocity[0], velocity[1], plant.twist[0, 5]])
    assert velocity[0] == pytest.approx(u, rel=0.02)
    assert plant.twist[0, 5] == pytest.approx(r, rel=0.03)
    assert np.hypot(velocity[0], velocity[1]) / abs(plant.twist[0, 5]) == pytest.approx(
        np.hypot(u, v) / abs(r), rel=0.03
    )


def mujoco_rotation(plant: Plant) -> Floats:
    """Body to world of the first vehicle by MuJoCo, shape (3, 3)."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, plant.pose[0, 3:])
    return matrix.reshape(3, 3)


def test_damping_of_6_by_6_acts_off_the_diagonal() -> None:
    """In LAUV's matrix sway and yaw damp each other, with the same signs in MuJoCo's frame."""
    plant = plant_of("lauv")
    plant.twist[0] = [0, 0.3, 0, 0, 0, 0.2]
    coefficients = mjcf.read_coefficients(plant.model, plant.names, RHO)
    assert coefficients["coupled"][0] == 1
    force, moment = coupled_damping(
        coefficients.view(np.recarray)[0], (0.0, 0.3, 0.0), (0.0, 0.0, 0.2)
    )
    assert force == pytest.approx((0.0, 11.5 * 0.2 + 0.3 * 0.04, 0.0))
    assert moment == pytest.approx((0.0, 0.0, -3.1 * 0.3 - 1.5 * 0.09))


def test_the_steady_turn_is_that_of_a_flight() -> None:
    """With the rudder at its limit, at the speed that results: rate and radius are those of the
    balance of sway and yaw.
    """
    setup = VehicleSetup(
        name="deep", model="remus100", position_m=(0.0, 0.0, -200.0), speed_m_s=1.0
    )
    plant = Plant([setup], Ocean(floor_depth_m=1000.0))
    plant.step(np.array([[10.0, 0.261799, 0.261799, 0.0, 0.0]]), 8000)
    velocity = mujoco_rotation(plant).T @ plant.twist[0, :3]
    autopilot = design(plant_of("remus100"), (None,))[0]
    rate, radius = steady_turn(plant_of("remus100"), 0, autopilot, float(velocity[0]))
    assert abs(plant.twist[0, 5]) == pytest.approx(rate, rel=0.05)
    assert np.hypot(*velocity[:2]) / abs(plant.twist[0, 5]) == pytest.approx(radius, rel=0.05)
    # turns of the follower, which is steered by thrusters, have no least radius
    assert least_radius(plant_of("follower"), 0, design(plant_of("follower"), (None,))[0]) == 0.0


@pytest.mark.system
def test_ten_remus_keep_their_stations_behind_a_remus() -> None:
    """To 0.5 m along the route, 1 m at stations and 0.2 m in depth (RMS), in calm water with the
    default errors of sensors.
    """
    flight = laisn_sim.fly(remus_formation.table(corners=4))
    measures = remus_formation.keeping(flight)
    assert not any(follower.lost for follower in measures)
    assert max(follower.station_rms_m for follower in measures) < 1.0
    assert remus_formation.depth_rms(flight) < 0.2
    report = tracking(only(flight.trajectory, [0]), routes_of(MissionPlan.of(flight.scenario))[:1])[
        0
    ]
    assert report.cross_track_rms < 0.5
    assert report.depth_error_rms < 0.2


def test_a_trial_states_how_far_a_hull_that_turns_slowly_leaves_its_route() -> None:
    """A corner of 90° is cut by R (1 - cos 45°), measured from either leg."""
    plant = plant_of("remus100")
    radius = least_radius(plant, 0, design(plant, (None,))[0])
    corner = {"waypoints": [[0, 0, 0], [100, 100, 0], [200, 100, 100]], "model": "remus100"}
    table = {"duration_s": 200, "leader": corner, "followers": [{"route": "T5"}]}
    (caution,) = trial(laisn_sim.load(table))
    assert caution.startswith("leader: it is up to ")
    cross_track_error = float(caution.split("up to ")[1].split(" m off its route")[0])
    assert cross_track_error == pytest.approx(radius * (1.0 - np.sqrt(0.5)), abs=1.5)
    assert not trial(laisn_sim.load("T5"))


def test_missions_that_a_hull_cannot_fly_are_refused_with_the_reason() -> None:
    with pytest.raises(
        laisn_sim.LaisnError, match=r"leader\.model: its effectors drive it at 0\.7\d m/s at most"
    ):
        laisn_sim.load("T5", {"leader.model": "bluerov2_heavy"})
    with pytest.raises(laisn_sim.LaisnError, match=r"cannot give heave independently"):
        laisn_sim.load("T5", {"leader.model": "remus100", "leader.depth_control": "thrust"})
    slow = {"waypoints": [[0, 0, 0], [100, 30, 0]], "model": "lauv"}
    with pytest.raises(
        laisn_sim.LaisnError,
        match=r"followers\[0\]\.model: it has no vertical thrusters and cannot hover",
    ):
        laisn_sim.load("T5", {f"followers.0.{key}": value for key, value in slow.items()})


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "0.00665 1.2 0.44 0",
            "0.00665 1.2 0.44",
            r"rudder_top\.fin'> has 3 values, expected 4: area",
        ),
        (
            "0.00665 1.2 0.44 0",
            "-0.00665 1.2 0.44 0",
            r"rudder_top\.fin'>: value 1, area \[m²\], must be more than 0 .* \(given: -0\.00665\)",
        ),
        (
            'name="rudder_top" class="deflection" site="rudder_top" gear="0 1 0',
            'name="rudder_top" class="deflection" site="rudder_top" gear="1 1 0',
            r"the axis of a fin must be a unit vector across the hull \(given: 1 1 0\)",
        ),
        ("0.14 0.4566", "0.14", r"propeller\.propeller'> has 7 values, expected 8: diameter"),
        ('"propeller.propeller"', '"propeller.curve"', None),
    ],
)
def test_wrong_numerics_of_effectors_are_named(old: str, new: str, message: str | None) -> None:
    text = models.path("remus100").read_text("utf-8")
    assert old in text
    lines = hull_errors(text.replace(old, new, 1), "leader")
    assert len(lines) == 1
    assert re.search(message or "2 to 32 pairs of state and thrust", lines[0])


def test_geoms_of_fins_turn_with_the_deflection() -> None:
    model = spec_of("remus100").compile()
    fins = effectors.MovingFins(model)
    state = np.array([20.0, 0.2, 0.2, -0.1, -0.1])
    fins.turn(state)
    for name, deflection, axis in (("rudder_top", 0.2, 1), ("stern_plane_port", -0.1, 2)):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom(name).quat)
        # the leading edge turns towards the side to which the fin pushes
        chord = rotation.reshape(3, 3)[:, 0]
        assert chord[axis] == pytest.approx(np.sin(deflection))
        assert chord[0] == pytest.approx(np.cos(deflection))
    assert not effectors.MovingFins(spec_of("follower").compile())


def odd_hull() -> str:
    """The follower's hull with three thrusters at unsymmetric positions and two stern planes."""
    text = re.sub(r'<(site|general) name="thruster_[^>]*/>', "", mixed_hull())
    sites = {
        "canted_port": ("-0.6 0.21 0.03", "0.9659 -0.2588 0 0 0 0"),
        "canted_starboard": ("-0.66 -0.2 -0.02", "0.9659 0.2588 0 0 0 0"),
        "nose": ("0.5 0.03 0.05", "0 0 1 0 0 0"),
    }
    for name, (position, gear) in sites.items():
        text = text.replace(
            '<site name="cg"', f'<site name="{name}" pos="{position}"/><site name="cg"'
        )
        text = text.replace(
            "</actuator>",
            f'<general name="{name}" class="thruster" site="{name}" ctrlrange="-40 60" '
            f'gear="{gear}"/></actuator>',
        )
    return text


def test_three_unsymmetric_thrusters_and_two_fins_follow_a_route_by_their_mjcf_alone() -> None:
    text = odd_hull()
    assert hull_errors(text, "follower") == []
    plant = plant_of(text)
    assert len(plant.effector_names[0]) == 5
    depth = DepthProfile(time=np.array([0.0, 40.0, 100.0]), depth=np.array([10.0, 10.0, 12.0]))
    route = Route.at_speed("bend", [[0, 0], [50, 0], [100, 20], [160, 20]], 1.0, depth)
    setup = VehicleSetup(
        name="one", model=text, position_m=(0.0, 0.0, -10.0), heading_rad=np.pi / 2, speed_m_s=1.0
    )
    report = tracking(simulate(Plant([setup], Ocean()), [route], 155.0, [None]), [route])[0]
    assert report.cross_track_rms < 0.5
    assert report.depth_error_rms < 0.2


def test_hulls_that_turn_slowly_plan_wider_turns() -> None:
    """The arc of the planned turn touches both legs: at a right angle its middle is (√2 − 1) R
    from the corner.
    """
    route = Route.at_speed("corner", [[0, 0], [0, 100], [100, 100]], 1.0, 10.0)
    time, radius = np.arange(0.0, 200.0, 0.1), 25.0
    table = reference([route], time, [0.0], [radius])[:, 0]
    closest = np.hypot(table.east, table.north - 100.0).min()
    assert closest == pytest.approx((np.sqrt(2) - 1) * radius, rel=1e-4)
    # it passes the waypoint at its time, as with other turns
    assert time[np.argmin(np.hypot(table.east, table.north - 100.0))] == pytest.approx(
        100.0, abs=0.1
    )
    assert np.abs(np.diff(table.course)).max() / 0.1 == pytest.approx(
        table.speed[1000] / radius, rel=1e-3
    )
    # hulls that turn faster than 10°/s, and routes too short for wide turns, keep the common turns
    assert reference([route], time, [0.0], [0.1]).tobytes() == reference([route], time).tobytes()
    short = Route.at_speed("corners", [[0, 0], [0, 7], [7, 7], [7, 14]], 0.5, 10.0)
    assert reference([short], time, [0.0], [100.0]).tobytes() == reference([short], time).tobytes()


def test_remus_rounds_the_corner_of_the_leaders_route() -> None:
    """The turn is planned with the least radius of the hull, which cannot turn at 10°/s."""
    route = library_route("L", 10.0)
    setup = VehicleSetup(
        name="one",
        model="remus100",
        position_m=(0.0, 0.0, -10.0),
        heading_rad=np.pi / 2,
        speed_m_s=1.0,
    )
    plant = Plant([setup], Ocean())
    radius = least_radius(plant, 0, design(plant, (None,))[0])
    report = tracking(simulate(plant, [route], 1000.0, [None]), [route])[0]
    # the middle of the arc is R (1 − cos 45°) from either leg
    assert report.cross_track_max == pytest.approx(radius * (1 - np.sqrt(0.5)), abs=1.5)
    assert report.depth_error_rms < 0.2
