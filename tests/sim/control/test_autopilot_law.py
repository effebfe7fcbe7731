"""The autopilot's law, written a second time from its documentation, against its commands and its
memory.
"""

import numpy as np
import pytest

from laisn.arrays import Floats, Record
from sim.control import autopilot
from sim.control.autopilot import HullMotion
from sim.control.guidance import REFERENCE
from sim.vehicle.effector_kinds import BUILT_IN
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean
from tests.synthetic import record

DT = 0.1
LIMIT = 1e6
"""Thrust that no state here requires [N]."""


MEMORY_FIELDS = (
    "heading_integral",
    "speed_integral",
    "pitch_integral",
    "depth_integral",
    "pitch_command",
)


def damping(c: Floats, surge_size: float, rate: float) -> float:
    """Moment against a rate of turn: linear, with the speed, and quadratic."""
    return float((c[0] + c[1] * surge_size + c[2] * abs(rate)) * rate)


def law(
    d: np.void,
    guidance_command: tuple[float, float, float],
    ref: Floats,
    motion: HullMotion,
    memory: Record,
) -> tuple[Floats, ...]:
    """Thrust ahead, side force and moment to port, upward force and nose-up moment, shape (5,); and
    the memory afterwards.

    `guidance_command` is heading [rad], turn rate [rad/s] and speed [m/s].
    """
    heading, turn, speed = guidance_command
    omega, surge_size, new_memory = d["omega"], abs(motion.surge), memory.copy()
    lag = 1.0 / (4.0 * omega)
    speed_through_water = speed / max(np.cos(motion.pitch), 0.5)
    speed_ahead_of_lag = speed_through_water + lag * ref.acceleration
    drag = (
        d["drag_linear"] * np.exp(-d["drag_fade"] * speed_ahead_of_lag) * speed_ahead_of_lag
        + d["drag"] * speed_ahead_of_lag**2
    )
    speed_error = speed_through_water - motion.surge
    ahead = (
        d["surge_mass"] * (ref.acceleration + omega / 2 * speed_error)
        + memory.speed_integral
        + drag
    )
    new_memory.speed_integral += d["surge_mass"] * (omega / 2) * (omega / 10) * speed_error * DT

    # turns of the compass are to starboard, moments to port
    heading_error = np.arctan2(np.sin(heading - motion.heading), np.cos(heading - motion.heading))
    turn_ahead_of_lag = turn + lag * ref.turn_acceleration
    acceleration = (
        ref.turn_acceleration + omega**2 * heading_error + 2 * omega * (turn - -motion.turning)
    )
    to_port = (
        -d["yaw_inertia"] * acceleration
        - damping(d["yaw_damping"], surge_size, turn_ahead_of_lag)
        + memory.heading_integral
    )
    new_memory.heading_integral -= d["yaw_inertia"] * omega**2 * (omega / 10) * heading_error * DT
    side = (
        -turn_ahead_of_lag * (d["surge_mass"] * motion.surge - d["fin_side"] * surge_size)
        - omega / 2 * d["sway_mass"] * motion.sway
    )

    pitch_share = d["by_pitch"] * np.clip((surge_size - 0.3) / 0.3, 0.0, 1.0)
    lifting_speed = max(surge_size, 0.3)
    depth_error, lift = ref.depth - motion.depth, d["lift"] * lifting_speed**2
    incidence = np.clip(pitch_share * memory.depth_integral / lift, *np.deg2rad([-12.0, 12.0]))
    sink_rate = ref.sinking + omega / 5 * depth_error
    steepest = lifting_speed * np.sin(np.deg2rad(20.0))
    climb = -np.arcsin(np.clip(sink_rate, -steepest, steepest) / lifting_speed)
    pitch_step = np.clip(
        pitch_share * climb + incidence - memory.pitch_command, *np.deg2rad([-5.0, 5.0]) * DT
    )
    new_memory.pitch_command += pitch_step
    pitch, rate = new_memory.pitch_command, pitch_step / DT
    force_by_thrust = d["heave_mass"] * (
        (omega / 2) ** 2 * depth_error + omega * (ref.sinking - motion.sinking)
    )
    force_by_thrust += lift / lifting_speed * ref.sinking
    upward = memory.depth_integral - incidence * lift - (1 - pitch_share) * force_by_thrust
    by_lift, by_thrust = (
        lift / lifting_speed * (omega / 5) ** 2 / 4,
        0.2 * d["heave_mass"] * (omega / 2) ** 3,
    )
    if pitch_share * abs(sink_rate) < steepest:
        new_memory.depth_integral -= (
            (pitch_share * by_lift + (1 - pitch_share) * by_thrust) * depth_error * DT
        )
    acceleration = omega**2 * (pitch - motion.pitch) + 2 * omega * (rate - -motion.pitching)
    nose_up = (
        d["pitch_inertia"] * acceleration
        + d["righting"] * pitch
        + damping(d["pitch_damping"], surge_size, rate)
    )
    nose_up += memory.pitch_integral
    new_memory.pitch_integral += (
        d["pitch_inertia"] * omega**2 * (omega / 10) * (pitch - motion.pitch) * DT
    )
    return np.array([ahead, side, to_port, upward, nose_up]), new_memory


@pytest.mark.parametrize("mode", ["pitch", "thrust"])
@pytest.mark.parametrize("surge", [1.2, 0.45, 0.2, -0.7])
@pytest.mark.parametrize("depth_error", [0.4, -0.3, 8.0, -8.0])
def test_commands_and_memory_follow_the_law(
    mode: autopilot.DepthControl, surge: float, depth_error: float
) -> None:
    """At all speeds and depths, with every state and every rate off by something."""
    plant = Plant(
        [VehicleSetup(name="leader", model="leader", position_m=(0.0, 0.0, -10.0))], Ocean()
    )
    records = autopilot.design(plant, (mode,)).copy()
    records["effectors"]["limits"] = [-LIMIT, LIMIT]
    records["drag_fade"], records["drag_linear"] = 0.7, 3.0
    records["yaw_damping"] = [1.0, 2.0, 3.0]
    records["pitch_damping"] = [1.5, 2.5, 3.5]
    (design,) = records
    reference = record(REFERENCE, 0.0, 0.0, 0.0, 0.0, 0.02, 0.1, 10.0, 0.05)
    motion = HullMotion(
        surge=surge,
        sway=0.1,
        heading=6.2,
        turning=0.03,
        pitch=0.06,
        pitching=-0.02,
        heel=0.05,
        rolling=0.01,
        depth=10.0 - depth_error,
        sinking=0.02,
    )
    guidance_command = 0.1, 0.04, 1.3
    command = np.zeros(5)
    for integral in (2.0, -400.0):
        memory = record(autopilot.AUTOPILOT_MEMORY)
        for name, value in zip(MEMORY_FIELDS, (0.7, -3.0, 0.4, integral, 0.03), strict=True):
            memory[name] = value
        expected, new_memory = law(design, guidance_command, reference, motion, memory)
        autopilot.control(
            BUILT_IN, design, guidance_command, reference, motion, DT, memory, command
        )
        # leader.xml: lateral thrusters at ±0.62 m, vertical ones at ±0.46 m
        (bow, stern), (bow_vertical, stern_vertical) = (0.62, -0.62), (0.46, -0.46)
        actual = [
            command[0],
            command[1] + command[2],
            bow * command[1] + stern * command[2],
            command[3] + command[4],
            bow_vertical * command[3] + stern_vertical * command[4],
        ]
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)
        for name in MEMORY_FIELDS:
            assert memory[name] == pytest.approx(new_memory[name], rel=1e-9, abs=1e-12)


def test_a_hull_turns_about_its_origin_wherever_its_mass_lies() -> None:
    """Steiner: a centre 0.3 m ahead adds 0.09 m to both moments of inertia, and no righting."""
    plant = Plant(
        [VehicleSetup(name="leader", model="leader", position_m=(0.0, 0.0, -10.0))], Ocean()
    )
    (before,) = autopilot.design(plant, ("pitch",)).copy()
    body = plant.model.body("leader/hull")
    body.ipos[0] += 0.3
    (after,) = autopilot.design(plant, ("pitch",))
    for name in ("yaw_inertia", "pitch_inertia"):
        assert after[name] - before[name] == pytest.approx(0.09 * body.mass[0])
    assert after["righting"] == before["righting"]


def test_levers_and_coefficients_are_those_of_the_mjcf() -> None:
    """What a hull's own law needs, read from its MJCF by name, in water of another density."""
    for model in ("leader", "follower"):
        setup = VehicleSetup(name=model, model=model, position_m=(0.0, 0.0, -10.0))
        plant = Plant([setup], Ocean(density_kg_m3=1000.0))
        (d,) = autopilot.design(plant, ("thrust",))
        coefficients = {
            name: plant.model.numeric(f"{model}/{name}").data
            for name in (
                "added_mass",
                "linear_damping",
                "linear_damping_fade",
                "quadratic_damping",
                "hull_lift",
                "hull_lift_planes",
                "fins_upright.fin",
                "fins_level.fin",
                "strip_x",
                "strip_area",
                "cross_flow_drag",
            )
        }
        area, drag, slope = coefficients["hull_lift"]
        fins = [
            500.0 * float(np.prod(coefficients[f"fins_{pair}.fin"][:2]))
            for pair in ("upright", "level")
        ]
        fins_x = plant.model.site(f"{model}/fins_level").pos[0]
        assert d["drag"] == pytest.approx(
            500.0 * area * drag + coefficients["quadratic_damping"][0]
        )
        assert d["drag_linear"] == coefficients["linear_damping"][0]
        assert d["drag_fade"] == coefficients["linear_damping_fade"][0]
        assert d["lift"] == pytest.approx(
            500.0 * area * slope * coefficients["hull_lift_planes"][1] + fins[1]
        )
        assert d["fin_side"] == pytest.approx(-fins[0] * fins_x)
        assert d["sway_mass"] == pytest.approx(
            plant.model.body(f"{model}/hull").mass[0] + coefficients["added_mass"][7]
        )
        # a strip at x moves at x times the rate, and has x as its lever
        strips = sum(
            500.0 * a * abs(x) ** 3
            for a, x in zip(coefficients["strip_area"], coefficients["strip_x"], strict=True)
        )
        for axis, force_axis, fin in (("pitch", 1, 1), ("yaw", 0, 0)):
            i = {"pitch": 4, "yaw": 5}[axis]
            quadratic = (
                strips * coefficients["cross_flow_drag"][force_axis]
                + coefficients["quadratic_damping"][i]
            )
            expected = [coefficients["linear_damping"][i], fins[fin] * fins_x**2, quadratic]
            np.testing.assert_allclose(d[f"{axis}_damping"], expected, rtol=1e-12)
        assert d["by_pitch"] == 0.0
        names = ("main", "lateral_bow", "lateral_stern", "vertical_bow", "vertical_stern")
        ranges = [plant.model.actuator(f"{model}/thruster_{name}").ctrlrange for name in names]
        np.testing.assert_array_equal(d["effectors"]["limits"][:5], ranges)
        # the matrix that the allocation inverts: forces along an axis, and their levers
        x = {name: plant.model.site(f"{model}/thruster_{name}").pos[0] for name in names}
        wrenches = np.zeros((6, 5))
        wrenches[0, 0] = wrenches[1, 1] = wrenches[1, 2] = wrenches[2, 3] = wrenches[2, 4] = 1.0
        wrenches[5, 1:3] = x["lateral_bow"], x["lateral_stern"]
        wrenches[4, 3:5] = -x["vertical_bow"], -x["vertical_stern"]
        np.testing.assert_allclose(
            wrenches @ d["slow_allocation"][:5], np.diag([1, 1, 1, 0, 1, 1]), atol=1e-12
        )
