"""What a mission is like beside its errors of navigation: how places and depths were kept, how near, at what power."""

import numpy as np

from experiments.campaign.store import Record
from laisn.arrays import Floats
from sim.assembly import routes_of
from sim.contact import contacts
from sim.scenario.settings import Scenario
from sim.station_keeping import off_places
from sim.trajectory import Trajectory

DISC_DIAMETER_M = 0.1
"""Disc of every thruster: the MJCF has thrusts and no propellers. Powers compare missions; they size no battery."""

FACTS = {
    "off_place_rms_m": "RMS distance from where the route or station has the follower",
    "off_place_max_m": "largest distance from there",
    "depth_error_rms_m": "RMS error of the follower's depth against the depth that it was to hold",
    "depth_error_max_m": "largest error of depth",
    "closest_approach_m": "smallest distance of the follower's origin from that of any other vehicle",
    "touched": "whether the follower's hull touched another",
    "range_mean_m": "mean horizontal distance from the leader",
    "pitch_rms_deg": "RMS pitch of the follower",
    "power_mean_w": "mean power of the follower's thrusters",
    "energy_j": "energy of the follower's thrusters over the mission",
    "leader_pitch_rms_deg": "RMS pitch of the leader",
    "leader_depth_error_rms_m": "RMS error of the leader's depth",
    "leader_power_mean_w": "mean power of the leader's thrusters",
    "leader_energy_j": "energy of the leader's thrusters over the mission",
}
"""Columns of a mission, and what they are."""


def disc_power(thrust: Floats, inflow: Floats, density: float) -> Floats:
    """Power of ideal actuator discs, |T| (v / 2 + √(v² / 4 + |T| / 2ρA)), [W].

    Rankine-Froude momentum theory (Newman, Marine Hydrodynamics, 1977; Breslin & Andersen, 1994). Water that comes from
    behind a disc is taken for still.

    Args:
        thrust: [N], any sign.
        inflow: speed of the disc through the water, positive the way it pushes, [m/s].
        density: of the water [kg/m³].
    """
    area = np.pi * DISC_DIAMETER_M**2 / 4
    size, speed = np.abs(thrust), np.maximum(inflow, 0.0)
    return np.asarray(size * (speed / 2 + np.sqrt(speed**2 / 4 + size / (2 * density * area))))


def thruster_power(trajectory: Trajectory, vehicle: int, density: float) -> Floats:
    """Power of all thrusters of a vehicle at each instant, shape (n,), [W].

    The inflow of a thruster is the hull's forward speed along its axis; thrusters across the hull have none.
    """
    through = trajectory.velocity[:, vehicle] - trajectory.water_velocity[:, vehicle]
    pitch, heading = trajectory.pitch[:, vehicle], trajectory.heading[:, vehicle]
    forward = np.column_stack([np.cos(pitch) * np.sin(heading), np.cos(pitch) * np.cos(heading), np.sin(pitch)])
    thrust = trajectory.thrust[:, vehicle]
    surge = np.einsum("ni,ni->n", through, forward)
    inflow = surge[:, None] * trajectory.effector_force[vehicle, :, 0] * np.sign(thrust)
    return np.asarray(disc_power(thrust, inflow, density).sum(axis=1))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def facts_of(scenario: Scenario, trajectory: Trajectory) -> list[Record]:
    """The facts of a flown mission for each of its followers, by the names in `FACTS`.

    Point motion has no thrusters: its powers are None.
    """
    routes, time, position = routes_of(scenario), trajectory.time, trajectory.position
    off = off_places(scenario, trajectory)
    density, span = scenario.ocean.density_kg_m3, float(trajectory.time[-1] - trajectory.time[0])
    physical = scenario.motion == "physics"
    touching = {name for contact in contacts(trajectory) for name in contact.pair}

    def depth_error(v: int) -> Floats:
        return np.asarray(trajectory.depth[:, v] - routes[v].depth.at(time)[0])

    def power(v: int) -> float | None:
        return float(thruster_power(trajectory, v, density).mean()) if physical else None

    pull = power(0)
    shared: Record = {
        "leader_pitch_rms_deg": _rms(np.rad2deg(trajectory.pitch[:, 0])),
        "leader_depth_error_rms_m": _rms(depth_error(0)),
        "leader_power_mean_w": pull,
        "leader_energy_j": None if pull is None else pull * span,
    }
    found = []
    for v in range(1, len(trajectory.names)):
        astray, depth, own = off[:, v - 1], depth_error(v), power(v)
        apart = np.linalg.norm(np.delete(position, v, axis=1) - position[:, v : v + 1], axis=2)
        found.append(
            {
                "off_place_rms_m": _rms(astray),
                "off_place_max_m": float(astray.max()),
                "depth_error_rms_m": _rms(depth),
                "depth_error_max_m": float(np.abs(depth).max()),
                "closest_approach_m": float(apart.min()),
                "touched": float(trajectory.names[v] in touching),
                "range_mean_m": float(np.hypot(*(position[:, v, :2] - position[:, 0, :2]).T).mean()),
                "pitch_rms_deg": _rms(np.rad2deg(trajectory.pitch[:, v])),
                "power_mean_w": own,
                "energy_j": None if own is None else own * span,
                **shared,
            }
        )
    return found
