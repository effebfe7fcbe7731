"""Numbers of `docs/physics.md` and `docs/vehicles.md`: hulls set against published figures,
models and closed forms.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

import laisn_sim
import models
from laisn.arrays import Floats
from reports.findings import RESULTS_FILE, Finding, Findings, plain_finding, record
from sim import attitude
from sim.assembly import routes_of
from sim.scenario.parts import MissionPlan
from sim.scenario.routes import DepthProfile, Route
from sim.simulation import simulate
from sim.vehicle import mjcf
from sim.vehicle.effectors import Fitted, fins_of, force_limits_of
from sim.vehicle.hull_file import from_dimensions
from sim.vehicle.hydrodynamics import wrench
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.environment import sea_at
from sim.water.ocean import Ocean
from tests.sim.vehicle import fossen_remus100 as fossen
from tests.sim.vehicle import remus_formation
from tests.sim.vehicle import test_remus as remus
from tests.sim.vehicle.tank import Tank, hull
from tests.sim.vehicle.test_hydrodynamics_kirchhoff import (
    SPHEROID_ADDED,
    SPHEROID_INERTIA,
    SPHEROID_MASS,
)
from tests.synthetic import only
from tools.documents.route_keeping import tracking

COMMAND = "python -m tools.documents.studies hull-trials"
MODULES = ("tools.documents.hull_trials",)
PUBLISHED_SPEED = {300: 0.4860, 500: 0.8314, 750: 1.2542, 1000: 1.6741, 1250: 2.0930, 1525: 2.5536}
"""Final speed [m/s] of a REMUS 100 in Fossen's published code, by propeller speed [1/min]."""
PUBLISHED_PITCH = {1000: 8.80, 1525: 20.86}
"""Pitch [°] of a REMUS 100 in Fossen's published code under −5° of stern plane."""
PUBLISHED_TURN = {1000: {5: 2.092, 10: 3.488, 15: 4.644}, 1525: {5: 3.609, 10: 5.894, 15: 7.767}}
"""Turn rate [°/s] of a REMUS 100 in Fossen's published code, by propeller speed [1/min] and
rudder [°].
"""
STERN_PLANE_DEG = -5.0
PUBLISHED_BLUEROV = {
    "turn": 3.9111,
    "ascent": 0.7146,
    "descent": 0.7210,
    "surge": 0.2610,
    "sway": 0.2438,
}
"""Steady speeds [m/s] and turn rate [rad/s] of von Benzon's BlueROV2 in published Python code, in
steps of 0.01 s.

V. N. Fernandez-Ayala, bluerov2_dynamics, `fossen/BlueROV2.py` (MIT licence, commit aafc093).
"""
_PITCH_TRIM = 0.16928464600933177
_ROLL_TRIM = 0.11410268696233682
"""Voltages of the vertical thrusters, over the full one, that cancel the pitching and the rolling
moment of the horizontal ones at a quarter of their voltage.
"""
BLUEROV_COMMANDS = {
    "turn": (1.0, -1.0, -1.0, 1.0, 0.0, 0.0, 0.0, 0.0),
    "ascent": (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0),
    "descent": (0.0, 0.0, 0.0, 0.0, -1.0, -1.0, -1.0, -1.0),
    "surge": (0.25, 0.25, -0.25, -0.25, -_PITCH_TRIM, -_PITCH_TRIM, _PITCH_TRIM, _PITCH_TRIM),
    "sway": (-0.25, 0.25, -0.25, 0.25, -_ROLL_TRIM, _ROLL_TRIM, -_ROLL_TRIM, _ROLL_TRIM),
}
"""Voltages of the eight thrusters, over the full one, in the trials of the BlueROV2: of four
horizontal ones, and of four vertical ones.
"""


def _remus() -> dict[str, Finding]:
    """Final speed and its rise, steady turns, and pitch under stern planes of a REMUS 100."""
    findings = {}
    rises = []  # [s]
    rate_differences = []  # relative
    radii = []  # of turns [m]
    for rpm, published in PUBLISHED_SPEED.items():
        speed = remus.run(rpm, 100.0)[1][:, 0]
        # to the digits of the published table, lest it be rounded twice
        findings[f"speed {rpm}"] = plain_finding(round(float(speed[-1]), 4), "final speed", "m/s")
        risen = (1.0 - np.exp(-1.0)) * published
        k = int(np.argmax(speed >= risen))
        rises.append(remus.DT * (k - (speed[k] - risen) / (speed[k] - speed[k - 1])))
    findings["rise slowest"] = plain_finding(
        float(max(rises)), "rise to 63 % of the final speed at 300 /min", "s"
    )
    findings["rise quickest"] = plain_finding(
        float(min(rises)), "rise to 63 % of the final speed at 1525 /min", "s"
    )
    for rpm, turns in PUBLISHED_TURN.items():
        for rudder, published in turns.items():
            # velocity in the body at the end: surge, sway, heave [m/s], roll, pitch, yaw [rad/s]
            last = remus.run(rpm, 200.0, rudder_deg=rudder)[1][-1]
            rate = float(np.degrees(abs(last[5])))
            findings[f"turn {rpm} {rudder}"] = plain_finding(
                rate, f"turn rate, rudder {rudder}°", "°/s"
            )
            rate_differences.append(abs(rate / published - 1.0))
            radii.append(float(np.linalg.norm(last[:3]) / abs(last[5])))
    findings["turn apart"] = plain_finding(
        max(rate_differences), "largest relative difference of turn rates from the published ones"
    )
    findings["radius largest"] = plain_finding(max(radii), "radius", "m")
    findings["radius least"] = plain_finding(min(radii), "radius", "m")
    for rpm in PUBLISHED_TURN:
        tank, _ = remus.run(rpm, 200.0, stern_plane_deg=STERN_PLANE_DEG)
        pitch = abs(float(np.degrees(attitude.heading_pitch_roll(tank.pose[3:])[1])))
        findings[f"pitch {rpm}"] = plain_finding(
            pitch, f"pitch under {STERN_PLANE_DEG:g}° of stern plane", "°"
        )
    return findings


def _righting(dt: float) -> Finding:
    """Period of a hull in ideal water that is let go at 1°."""
    tank = Tank(
        hull(SPHEROID_MASS, SPHEROID_INERTIA, (0, 0, -0.02), added_mass=SPHEROID_ADDED), Ocean(), dt
    )
    tank.place(quaternion=attitude.from_euler(0.0, np.radians(1)))
    crossings: list[float] = []
    last_pitch = 1.0
    while len(crossings) < 3:
        tank.step()
        pitch = float(attitude.heading_pitch_roll(tank.pose[3:])[1])
        if last_pitch > 0.0 >= pitch:
            crossings.append(tank.data.time - dt * pitch / (pitch - last_pitch))
        last_pitch = pitch
    return plain_finding(
        float(np.diff(crossings).mean()), f"righting period at a step of {dt:g} s", "s"
    )


REMUS_TERMS = {
    "published": fossen.Terms(),
    "hull": fossen.Terms(hull_normal_force=True),
    "advance": fossen.Terms(axial_advance=True),
    "fins": fossen.Terms(fin_incidence=True),
    "slopes": fossen.Terms(fin_incidence=True, fitted_slope=True),
    "all": fossen.OURS,
    "munk": fossen.Terms(munk=True),
    "damping": fossen.Terms(steady_damping=True),
}
"""Fossen's model with terms replaced, by the names of the findings."""
MANOEUVRE_S = 100.0
RUDDER_DEG = 15.0
RPM = 1525.0  # of the propeller [1/min]


def _plant(
    model: str,
    speed: float = 0.0,
    heading: float = 0.0,
    depth: float = 200.0,
    current: float = 0.0,
    density: float = 1026.0,
) -> Plant:
    """A single vehicle of a model in deep water.

    Args:
        model: name, path or text of its MJCF.
        speed: at the start [m/s].
        heading: at the start [rad].
        depth: at the start [m].
        current: speed of a current towards east [m/s].
        density: of the water [kg/m³].
    """
    setup = VehicleSetup(
        name="v", model=model, position_m=(0.0, 0.0, -depth), speed_m_s=speed, heading_rad=heading
    )
    ocean = Ocean(
        current_speed_m_s=current,
        current_direction_rad=np.pi / 2,
        floor_depth_m=1000.0,
        density_kg_m3=density,
    )
    return Plant([setup], ocean)


def remus_flight(
    rudder: float, plane: float, rpm: float, changes: dict[float, tuple[float, float, float]]
) -> Floats:
    """Motion of the shipped REMUS 100, which starts from rest and heads north.

    Args:
        rudder: command [rad], as Fossen's.
        plane: of the stern planes [rad].
        rpm: of the propeller [1/min].
        changes: later commands of rudder, stern planes and propeller, by time [s].

    Returns:
        Place from the start, north, east and down [m], surge [m/s], turn rate to starboard [rad/s]
        and pitch, nose up [rad], each 0.1 s, shape (n, 6).
    """
    plant = _plant("remus100")
    rows = []
    for k in range(round(MANOEUVRE_S * 10) + 1):
        if k:
            # 5 physics steps of 0.02 s
            plant.step(np.array([[rpm / 60.0, rudder, rudder, plane, plane]]), 5)
        x, y, z, *quaternion = plant.pose[0]
        ahead = attitude.rotate(np.array(quaternion), np.array([1.0, 0.0, 0.0]))
        pitch = float(attitude.heading_pitch_roll(np.array(quaternion))[1])
        rows.append([y, x, -z, plant.twist[0, :3] @ ahead, -plant.twist[0, 5], pitch])
        rudder, plane, rpm = changes.get(k / 10, (rudder, plane, rpm))
    out = np.array(rows)
    out[:, 2] -= out[0, 2]
    return out


def _shipped_remus() -> dict[str, Finding]:
    """Turn rates, pitch under stern planes and final speeds of the shipped REMUS 100, whose fins
    feel the flow.
    """
    findings = {}
    for rpm, turns in PUBLISHED_TURN.items():
        for rudder in turns:
            last = remus_flight(float(np.radians(rudder)), 0.0, rpm, {})[-1]
            findings[f"shipped turn {rpm} {rudder}"] = plain_finding(
                float(np.degrees(abs(last[4]))),
                f"turn rate of remus100.xml, rudder {rudder}°",
                "°/s",
            )
        last = remus_flight(0.0, float(np.radians(STERN_PLANE_DEG)), rpm, {})[-1]
        findings[f"shipped pitch {rpm}"] = plain_finding(
            float(np.degrees(last[5])),
            f"pitch of remus100.xml under {STERN_PLANE_DEG:g}° of stern plane",
            "°",
        )
        last = remus_flight(0.0, 0.0, rpm, {})[-1]
        findings[f"shipped speed {rpm}"] = plain_finding(
            float(last[3]), "final speed of remus100.xml", "m/s"
        )
    return findings


def _constant_command(command: tuple[float, float, float], _: float) -> tuple[float, float, float]:
    return command


def _fossen() -> dict[str, Finding]:
    """Turning circle, dive and propeller step of Fossen's model, term by term, and of ours, for
    100 s from rest.
    """
    findings = {}
    rudder = np.radians(RUDDER_DEG)
    plane = np.radians(STERN_PLANE_DEG)

    def dive_command(t: float) -> tuple[float, float, float]:
        """Stern planes for 50 s, under a constant rudder."""
        return np.radians(5.0), plane if t < 50.0 else 0.0, RPM

    ours = remus_flight(np.radians(5.0), plane, RPM, {50.0: (np.radians(5.0), 0.0, RPM)})
    last = (
        remus_flight(rudder, 0.0, RPM, {})[-1],
        remus_flight(0.0, plane, RPM, {})[-1],
        remus_flight(0.0, 0.0, RPM, {})[-1],
    )
    # turn rate [rad/s], pitch [rad], speed [m/s] and distance from ours [m]
    values = {"ours": (last[0][4], last[1][5], last[2][3], 0.0)}
    for name, terms in REMUS_TERMS.items():
        turn, dive, ahead = (
            fossen.fly(partial(_constant_command, commands), MANOEUVRE_S, terms)[1][-1]
            for commands in ((rudder, 0.0, RPM), (0.0, plane, RPM), (0.0, 0.0, RPM))
        )
        _, path = fossen.fly(dive_command, MANOEUVRE_S, terms, (50.0,))
        distance = float(np.linalg.norm(path[:, :3] - ours[:, :3], axis=1).max())
        # columns of `fossen.fly`: 4 pitch, 6 surge, 11 turn rate
        values[name] = turn[11], dive[4], ahead[6], distance
    for name, (turn_rate, pitch, speed, distance) in values.items():
        findings[f"remus {name} turn"] = plain_finding(
            float(np.degrees(turn_rate)), f"turn rate after 100 s, rudder 15°: {name}", "°/s"
        )
        findings[f"remus {name} pitch"] = plain_finding(
            float(np.degrees(pitch)), f"pitch after 100 s, planes -5°: {name}", "°"
        )
        findings[f"remus {name} speed"] = plain_finding(
            float(speed), f"speed after 100 s, 1525 /min: {name}", "m/s"
        )
        findings[f"remus {name} apart"] = plain_finding(
            distance, f"largest distance from ours in 100 s of steps: {name}", "m"
        )
    return findings


@dataclass(frozen=True, kw_only=True)
class PublishedHull:
    """A slender vehicle whose coefficients are published."""

    title: str
    length: float  # [m]
    diameter: float  # [m]
    mass: float  # [kg]
    figures: dict[str, float]
    """By the names of `coefficients_of`; empty: the coefficients of the shipped model are taken."""


def _fin_force(area_times_slope: float) -> float:
    """Force of a pair of fins per angle and speed² [N s²/m² per rad] by its area times the slope of
    its lift coefficient [m²/rad].
    """
    return 0.5 * 1025.0 * area_times_slope


PUBLISHED_HULLS = {
    # T. Prestero, Verification of a Six-Degree of Freedom Simulation Model for the REMUS Autonomous
    # Underwater Vehicle, MIT and WHOI 2001: I, added mass, X_uu, Y_vv, Y_uu_delta_r
    "remus100": PublishedHull(
        title="REMUS 100 (Prestero 2001)",
        length=1.33,
        diameter=0.191,
        mass=30.48,
        figures={
            "inertia in roll": 0.177,
            "inertia in yaw": 3.45,
            "added mass in surge": 0.93,
            "added mass in sway": 35.5,
            "added mass in heave": 35.5,
            "added mass in roll": 0.0704,
            "added mass in pitch": 4.88,
            "added mass in yaw": 4.88,
            "drag at 1 m/s": 1.62,
            "side force at 0.3 m/s of sway": 131.0 * 0.3**2,
            "vertical force at 0.3 m/s of heave": 131.0 * 0.3**2,
            "force of the rudders per angle": 9.64,
            "force of the stern planes per angle": 9.64,
        },
    ),
    "lauv": PublishedHull(
        title="LAUV (lauv_gazebo)", length=1.08, diameter=0.15, mass=18.0, figures={}
    ),
    # Tethys of MBARI: osrf/lrauv (Apache 2.0 licence), lrauv_description/models: tethys (mass, and
    # inertia of the vehicle whole) and tethys_equipped (Hydrodynamics and LiftDrag)
    "tethys": PublishedHull(
        title="Tethys (osrf/lrauv)",
        length=2.3,
        diameter=0.305,
        mass=146.57,
        figures={
            "inertia in roll": 3.0,
            "inertia in yaw": 41.98,
            "added mass in surge": 4.876,
            "added mass in sway": 126.32,
            "added mass in heave": 126.32,
            "added mass in pitch": 33.46,
            "added mass in yaw": 33.46,
            "drag at 1 m/s": 6.2282,
            "side force at 0.3 m/s of sway": 601.27 * 0.3**2,
            "vertical force at 0.3 m/s of heave": 601.27 * 0.3**2,
            "moment at 0.2 rad/s of pitch": 632.7 * 0.2**2,
            "moment at 0.2 rad/s of yaw": 632.7 * 0.2**2,
            "force of the rudders per angle": _fin_force(0.0244 * 4.13),
            "force of the stern planes per angle": _fin_force(0.0244 * 4.13),
        },
    ),
    # Sparus II of the University of Girona, which steers by thrusters: Elkholy2021,
    # marine_modeling_sparus_II (course of the University of Toulon): Body_Mass_Matrix.m, and
    # the whole mass matrix in Parameters.m less it
    "sparus2": PublishedHull(
        title="Sparus II (Toulon)",
        length=1.6,
        diameter=0.23,
        mass=52.0,
        figures={
            "inertia in roll": 0.42,
            "inertia in yaw": 10.47,
            "added mass in surge": 54.0945 - 52.0,
            "added mass in sway": 122.3984 - 52.0,
            "added mass in heave": 121.1792 - 52.0,
            "added mass in roll": 0.8385 - 0.42,
            "added mass in pitch": 26.5838 - 10.42,
            "added mass in yaw": 26.6822 - 10.47,
        },
    ),
}
"""Vehicles with which estimates are compared; the BlueROV2 is no slender hull, and refused."""


def coefficients_of(model: str) -> dict[str, float]:
    """What a hull's file comes to: inertia and added mass [kg, kg m²], forces and moments of the
    water at given velocities [N, N m], forces of fins per angle and speed² [N s²/m² per rad], and
    thrust [N].
    """
    plant = _plant(model)
    (coefficients,) = mjcf.read_coefficients(plant.model, plant.names, 1026.0)
    c = np.array([coefficients], coefficients.dtype).view(np.recarray)[0]
    inertia = mjcf.inertia_tensor(plant.model, plant.model.body("v/hull").id)
    effectors = plant.effectors[0, : len(plant.effector_names[0])]
    pose = np.array([0.0, 0.0, -200.0, 1.0, 0.0, 0.0, 0.0])
    sea = sea_at(plant.ocean.environment, 0.0)

    def load(axis: int, size: float) -> float:
        """Size of the force or moment of the water about an axis that moves with a velocity."""
        force, moment, _ = wrench(
            c,
            pose,
            size * np.eye(6)[axis],
            sea,
            Fitted(plant.kinds, effectors[None], np.zeros((1, effectors.size))),
            0,
        )
        return abs(float(np.array([*force, *moment])[axis] - (c.buoyancy if axis == 2 else 0.0)))

    fins = fins_of(effectors)
    values = {
        "inertia in roll": float(inertia[0, 0]),
        "inertia in yaw": float(inertia[2, 2]),
    }
    for i, name in enumerate(("surge", "sway", "heave", "roll", "pitch", "yaw")):
        values[f"added mass in {name}"] = float(c.added_mass[i, i])
    values |= {
        "drag at 1 m/s": load(0, 1.0),
        "side force at 0.3 m/s of sway": load(1, 0.3),
        "vertical force at 0.3 m/s of heave": load(2, 0.3),
        "moment at 0.2 rad/s of pitch": load(4, 0.2),
        "moment at 0.2 rad/s of yaw": load(5, 0.2),
        "thrust at rest": float(
            np.sum(
                np.maximum(
                    force_limits_of(effectors, 1026.0, 0.0)[:, 1] * effectors["force"][:, 0], 0.0
                )
            )
        ),
    }
    for axis, name in ((1, "rudders"), (2, "stern planes")):
        lift = np.prod(fins["parameters"][:, :2], axis=1) * fins["force"][:, axis] ** 2
        values[f"force of the {name} per angle"] = 0.5 * 1026.0 * float(lift.sum())
    return values


def estimate_ratios(name: str) -> dict[str, float]:
    """Estimated over published figures of one of PUBLISHED_HULLS, by the names of
    `coefficients_of`.
    """
    hull = PUBLISHED_HULLS[name]
    published = hull.figures or coefficients_of(name)
    estimated = coefficients_of(from_dimensions(hull.length, hull.diameter, hull.mass).xml())
    return {key: estimated[key] / value for key, value in published.items() if value > 0.0}


def _estimates() -> dict[str, Finding]:
    """Ratios of estimated to published coefficients."""
    return {
        f"estimate {name} {key}": plain_finding(ratio, f"{key}, estimated over published: {name}")
        for name in PUBLISHED_HULLS
        for key, ratio in estimate_ratios(name).items()
    }


def bluerov_speed(trial: str) -> float:
    """Steady speed [m/s] along the body's axis of a trial, or turn rate [rad/s], after 30 s in
    open loop, in fresh water as its source.
    """
    plant = _plant("bluerov2_heavy", depth=100.0, density=1000.0)
    plant.step(np.array([BLUEROV_COMMANDS[trial]]), 1500)
    if trial == "turn":
        return abs(float(plant.twist[0, 5]))
    velocity = np.array(attitude.rotation(plant.pose[0, 3:])).T @ plant.twist[0, :3]
    return abs(float(velocity[{"surge": 0, "sway": 1}.get(trial, 2)]))


def _vehicles() -> dict[str, Finding]:
    """Speeds of the BlueROV2, and how the vehicles keep T5, or a route of 0.5 m/s, and a station
    in a current.
    """
    findings = {}
    # four horizontal thrusters of 30.4 N at 45°
    thrust = 4 * 30.4 / np.sqrt(2)
    # of surge, linear [N s/m] and quadratic [N s²/m²]
    drags = {"von Benzon": (13.7, 141.0), "Wu": (4.03, 18.18)}
    for name, (linear, quadratic) in drags.items():
        speed = brentq(lambda u, a=linear, b=quadratic: a * u + b * u * u - thrust, 0.0, 5.0)
        findings[f"bluerov balance {name}"] = plain_finding(
            float(speed), f"speed at full thrust by the drag of {name}", "m/s"
        )
    # in open loop the thrusters, above the centre of gravity, turn the hull over: the autopilot
    # holds its pitch
    line = Route.at_speed("line", [[0, 0], [300, 0]], 1.2, 10.0)
    ahead = simulate(_plant("bluerov2_heavy", depth=10.0), [line], 150.0, [None])
    turn = _plant("bluerov2_heavy", depth=20.0)
    horizontal = turn.effectors[0, :4]
    turn.step(np.array([[*np.sign(horizontal["torque"][:, 2]), 0, 0, 0, 0]]), 1500)
    # of the last 10 s
    way = float(np.hypot(*(ahead.position[-1, 0, :2] - ahead.position[-101, 0, :2])))
    speed = way / float(ahead.time[-1] - ahead.time[-101])
    findings["bluerov speed"] = plain_finding(speed, "speed at full thrust, simulated", "m/s")
    findings["bluerov turn"] = plain_finding(
        float(np.degrees(abs(turn.twist[0, 5]))), "turn rate at full thrust, simulated", "°/s"
    )
    # the thrusters are 0.156 m ahead or astern and 0.111 m aside; damping of von Benzon et al.
    rate = np.degrees(np.sqrt(4 * 30.4 * (0.156 + 0.111) / np.sqrt(2) / 1.5))
    findings["bluerov turn balance"] = plain_finding(
        float(rate), "turn rate by thrust and the paper's damping 1.5 r²", "°/s"
    )

    for trial, published in PUBLISHED_BLUEROV.items():
        unit = "rad/s" if trial == "turn" else "m/s"
        findings[f"bluerov {trial} ours"] = plain_finding(
            bluerov_speed(trial), f"steady speed of the trial: {trial}", unit
        )
        findings[f"bluerov {trial} published"] = plain_finding(
            published, f"the same in the published code: {trial}", unit
        )
    hover = Route.timed(
        "hover", [[0, 0, 0], [300, 0, 0], [400, 30, 0]], DepthProfile.constant(10.0)
    )
    plant = _plant("bluerov2_heavy", heading=np.pi / 2, depth=10.0, current=0.3)
    motion = simulate(plant, [hover], 290.0, [None])
    distance = np.hypot(*motion.position[600:, 0, :2].T)
    findings["bluerov hover"] = plain_finding(
        float(np.sqrt(np.mean(distance**2))), "RMS from a station in 0.3 m/s, 60 to 290 s", "m"
    )
    for model in models.VEHICLES:
        for role in ("follower", "leader"):
            flight = laisn_sim.fly(mission_of(model, role))
            report = tracking(flight.trajectory, routes_of(MissionPlan.of(flight.scenario)))[
                role == "follower"
            ]
            key = f"route {model} {role}"
            findings[f"{key} off"] = plain_finding(
                report.cross_track_rms, f"RMS off its route: {model} as {role}", "m"
            )
            findings[f"{key} depth"] = plain_finding(
                report.depth_error_rms, f"RMS error of depth: {model} as {role}", "m"
            )
    return findings


SQUARE_CORNER = ((0.0, 0.0, 0.0), (120.0, 60.0, 0.0), (240.0, 60.0, 60.0))
"""Time [s], east and north [m]: a corner at 0.5 m/s, for a vehicle that cannot fly the paper's
routes.
"""


_LACKING_SITES = {
    ("follower", "leader"): (
        '<site name="tx_rear" pos="-0.2 0 0"/><site name="tx_front" pos="0.2 0 0"/>'
        '<site name="tx_middle" pos="0 0.1 0"/>'
    ),
    ("leader", "follower"): '<site name="hydrophone" pos="0 0 -0.1"/>',
}
"""What the hulls that are made for one role need in the other one, by model and role."""


def model_for(model: str, role: str) -> str:
    """A shipped vehicle's name, or its MJCF with the instruments of a role that it lacks."""
    sites = _LACKING_SITES.get((model, role))
    if sites is None:
        return model
    return models.path(model).read_text("utf-8").replace("</body>", f"{sites}</body>", 1)


def mission_of(model: str, role: str) -> dict[str, Any]:
    """The scenario in which a vehicle is tried as leader, on the paper's L, or as follower, on
    T5.
    """
    vehicle: dict[str, Any] = {"model": model_for(model, role)}
    duration = 1000.0
    if model == "bluerov2_heavy":
        vehicle["waypoints"] = SQUARE_CORNER
        duration = SQUARE_CORNER[-1][0]
    if role == "leader":
        return {"duration_s": duration, "leader": vehicle, "followers": [{"route": "T5"}]}
    return {"duration_s": duration, "followers": [{"route": "T5"} | vehicle]}


def _formation() -> dict[str, Finding]:
    """How ten REMUS 100 keep their stations behind a REMUS 100."""
    flight = laisn_sim.fly(remus_formation.table(corners=18))
    stations = remus_formation.keeping(flight)
    rms = [station.station_rms_m for station in stations]
    leader = tracking(only(flight.trajectory, [0]), routes_of(MissionPlan.of(flight.scenario))[:1])[
        0
    ]
    return {
        "formation best": plain_finding(
            min(rms), "least RMS distance from a station, ten REMUS 100", "m"
        ),
        "formation worst": plain_finding(
            max(rms), "largest RMS distance from a station, ten REMUS 100", "m"
        ),
        "formation lost": plain_finding(
            sum(station.lost for station in stations), "followers lost, ten REMUS 100"
        ),
        "formation depth": plain_finding(
            remus_formation.depth_rms(flight), "RMS error of depth, ten REMUS 100", "m"
        ),
        "formation leader": plain_finding(
            leader.cross_track_rms, "RMS off its route: REMUS 100 that leads ten", "m"
        ),
    }


def findings() -> Findings:
    """Run all trials."""
    findings = (
        _remus()
        | {"righting": _righting(0.02)}
        | _shipped_remus()
        | _fossen()
        | _vehicles()
        | _formation()
        | _estimates()
    )
    return record("hull-trials", COMMAND, MODULES, findings)


def run(folder: Path) -> None:
    """Run all trials and write the record into a folder."""
    findings().write(folder / RESULTS_FILE)
