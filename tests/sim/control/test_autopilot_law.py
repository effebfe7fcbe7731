"""The autopilot's law, written down once more from its documents, against its commands and what
it remembers.
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


REMEMBERED = (
    "heading_integral",
    "speed_integral",
    "pitch_integral",
    "depth_integral",
    "pitch_command",
)


def damping(c: Floats, way: float, rate: float) -> float:
    return float((c[0] + c[1] * way + c[2] * abs(rate)) * rate)


def law(
    d: np.void,
    wanted: tuple[float, float, float],
    ref: Floats,
    motion: HullMotion,
    memory: Record,
) -> tuple[Floats, ...]:
    """Thrust ahead, side force and moment to port, upward force and nose-up moment; and what is
    remembered.
    """
    heading, turn, speed = wanted
    omega, way, kept = d["omega"], abs(motion.surge), memory.copy()
    lag = 1.0 / (4.0 * omega)
    through = speed / max(np.cos(motion.pitch), 0.5)
    later = through + lag * ref.acceleration
    drag = d["drag_linear"] * np.exp(-d["drag_fade"] * later) * later + d["drag"] * later**2
    slow = through - motion.surge
    ahead = d["surge_mass"] * (ref.acceleration + omega / 2 * slow) + memory.speed_integral + drag
    kept.speed_integral += d["surge_mass"] * (omega / 2) * (omega / 10) * slow * DT

    # turns of the compass are to starboard, moments to port
    off = np.arctan2(np.sin(heading - motion.heading), np.cos(heading - motion.heading))
    soon = turn + lag * ref.turn_acceleration
    wished = ref.turn_acceleration + omega**2 * off + 2 * omega * (turn - -motion.turning)
    to_port = (
        -d["yaw_inertia"] * wished - damping(d["yaw_damping"], way, soon) + memory.heading_integral
    )
    kept.heading_integral -= d["yaw_inertia"] * omega**2 * (omega / 10) * off * DT
    side = (
        -soon * (d["surge_mass"] * motion.surge - d["fin_side"] * way)
        - omega / 2 * d["sway_mass"] * motion.sway
    )

    share = d["by_pitch"] * np.clip((way - 0.3) / 0.3, 0.0, 1.0)
    fast = max(way, 0.3)
    high, lift = ref.depth - motion.depth, d["lift"] * fast**2
    incidence = np.clip(share * memory.depth_integral / lift, *np.deg2rad([-12.0, 12.0]))
    sink = ref.sinking + omega / 5 * high
    steepest = fast * np.sin(np.deg2rad(20.0))
    climb = -np.arcsin(np.clip(sink, -steepest, steepest) / fast)
    turned = np.clip(
        share * climb + incidence - memory.pitch_command, *np.deg2rad([-5.0, 5.0]) * DT
    )
    kept.pitch_command += turned
    pitch, rate = kept.pitch_command, turned / DT
    push = d["heave_mass"] * ((omega / 2) ** 2 * high + omega * (ref.sinking - motion.sinking))
    push += lift / fast * ref.sinking
    upward = memory.depth_integral - incidence * lift - (1 - share) * push
    by_lift, by_thrust = (
        lift / fast * (omega / 5) ** 2 / 4,
        0.2 * d["heave_mass"] * (omega / 2) ** 3,
    )
    if share * abs(sink) < steepest:
        kept.depth_integral -= (share * by_lift + (1 - share) * by_thrust) * high * DT
    wished = omega**2 * (pitch - motion.pitch) + 2 * omega * (rate - -motion.pitching)
    nose_up = (
        d["pitch_inertia"] * wished + d["righting"] * pitch + damping(d["pitch_damping"], way, rate)
    )
    nose_up += memory.pitch_integral
    kept.pitch_integral += (
        d["pitch_inertia"] * omega**2 * (omega / 10) * (pitch - motion.pitch) * DT
    )
    return np.array([ahead, side, to_port, upward, nose_up]), kept


@pytest.mark.parametrize("mode", ["pitch", "thrust"])
@pytest.mark.parametrize("way", [1.2, 0.45, 0.2, -0.7])
@pytest.mark.parametrize("deeper", [0.4, -0.3, 8.0, -8.0])
def test_commands_and_memory_follow_the_law(
    mode: autopilot.DepthControl, way: float, deeper: float
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
    (d,) = records
    reference = record(REFERENCE, 0.0, 0.0, 0.0, 0.0, 0.02, 0.1, 10.0, 0.05)
    motion = HullMotion(
        surge=way,
        sway=0.1,
        heading=6.2,
        turning=0.03,
        pitch=0.06,
        pitching=-0.02,
        depth=10.0 - deeper,
        sinking=0.02,
    )
    wanted = 0.1, 0.04, 1.3
    command = np.zeros(5)
    for integral in (2.0, -400.0):
        memory = record(autopilot.AUTOPILOT_MEMORY)
        for name, value in zip(REMEMBERED, (0.7, -3.0, 0.4, integral, 0.03), strict=True):
            memory[name] = value
        expected, kept = law(d, wanted, reference, motion, memory)
        autopilot.control(BUILT_IN, d, wanted, reference, motion, DT, memory, command)
        # leader.xml: lateral thrusters at ±0.62 m, vertical ones at ±0.46 m
        (bow, stern), (raised, lowered) = (0.62, -0.62), (0.46, -0.46)
        actual = [
            command[0],
            command[1] + command[2],
            bow * command[1] + stern * command[2],
            command[3] + command[4],
            raised * command[3] + lowered * command[4],
        ]
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-9)
        for name in REMEMBERED:
            assert memory[name] == pytest.approx(kept[name], rel=1e-9, abs=1e-12)


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
        given = {
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
        area, drag, slope = given["hull_lift"]
        fins = [
            500.0 * float(np.prod(given[f"fins_{pair}.fin"][:2])) for pair in ("upright", "level")
        ]
        back = plant.model.site(f"{model}/fins_level").pos[0]
        assert d["drag"] == pytest.approx(500.0 * area * drag + given["quadratic_damping"][0])
        assert d["drag_linear"] == given["linear_damping"][0]
        assert d["drag_fade"] == given["linear_damping_fade"][0]
        assert d["lift"] == pytest.approx(
            500.0 * area * slope * given["hull_lift_planes"][1] + fins[1]
        )
        assert d["fin_side"] == pytest.approx(-fins[0] * back)
        assert d["sway_mass"] == pytest.approx(
            plant.model.body(f"{model}/hull").mass[0] + given["added_mass"][7]
        )
        # a strip at x moves at x times the rate, and has x as its lever
        strips = sum(
            500.0 * a * abs(x) ** 3
            for a, x in zip(given["strip_area"], given["strip_x"], strict=True)
        )
        for axis, across, fin in (("pitch", 1, 1), ("yaw", 0, 0)):
            i = {"pitch": 4, "yaw": 5}[axis]
            crossing = strips * given["cross_flow_drag"][across] + given["quadratic_damping"][i]
            expected = [given["linear_damping"][i], fins[fin] * back**2, crossing]
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
