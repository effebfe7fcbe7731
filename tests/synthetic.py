"""A flight of formulas, and its log: circular routes, plausible measurements, no physics and no
navigator.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from laisn.arrays import Record, records
from laisn.estimates import Estimates, FixKind
from laisn.messages import LeaderMessage, Measurements
from laisn.swarm import MESSAGE
from sim import attitude
from sim.flight import FlightRecord
from sim.log import writer
from sim.log.writer import Event
from sim.scenario.settings import CONTROL_STEP_S, Acoustics, Follower, Leader, Scenario, Timing
from sim.trajectory import OF_VEHICLES, Trajectory

LEADER_RADIUS_M = 60.0
LANE_M = 9.0
"""Followers circle on wider lanes, so far apart [m]."""
LAG_RAD = 0.35
"""Angle on the circle by which a follower trails the leader."""
EFFECTORS = (
    "thruster_main",
    "thruster_lateral_bow",
    "thruster_lateral_stern",
    "thruster_vertical_bow",
    "thruster_vertical_stern",
)
SITES = {
    "leader": {
        "tx_rear": (-1.0, 0.0, 0.0),
        "tx_front": (1.0, 0.0, 0.0),
        "tx_middle": (0.0, 0.1, 0.0),
        "depth_sensor": (0.0, 0.0, 0.0),
    },
    "follower": {"hydrophone": (0.0, 0.0, 0.1), "depth_sensor": (0.0, 0.0, 0.0)},
}
"""Body positions of the sites, as in the vehicle models [m]."""


def make_scenario(
    duration: float = 30.0,
    n_followers: int = 1,
    *,
    filter_step: float = 0.1,
    message_interval: float = 1.0,
    seed: int = 1,
) -> Scenario:
    """One follower is named "follower"; several "follower1", "follower2" …, each a metre deeper
    than the one before.
    """
    names = ["follower"] if n_followers == 1 else [f"follower{i + 1}" for i in range(n_followers)]
    return Scenario(
        name="synthetic",
        seed=seed,
        duration_s=duration,
        timing=Timing(filter_step_s=filter_step, message_interval_s=message_interval),
        leader=Leader(depth_m=8.0),
        followers=tuple(
            Follower(name=name, route="T5", depth_m=10.0 + i) for i, name in enumerate(names)
        ),
        acoustics=Acoustics(),
    )


def make_trajectory(scenario: Scenario) -> Trajectory:
    """The leader turns left from the origin on a circle at 1 m/s, eastwards first; followers
    trail it outside.
    """
    names = ("leader", *(f.name for f in scenario.followers))
    n = round(scenario.duration_s / CONTROL_STEP_S) + 1
    time = CONTROL_STEP_S * np.arange(n, dtype=np.float64)
    lane = np.arange(len(names))
    radius = LEADER_RADIUS_M + LANE_M * lane
    rate = 1.0 / LEADER_RADIUS_M
    angle = rate * time[:, None] - LAG_RAD * (lane > 0)
    depth = np.array([scenario.leader.depth_m, *(f.depth_m for f in scenario.followers)])
    wobble_phase = 0.4 * time[:, None] + lane
    pitch, roll = (
        np.deg2rad(3.0) * np.sin(wobble_phase),
        np.deg2rad(2.0) * np.cos(0.7 * wobble_phase),
    )
    position = np.stack(
        [
            radius * np.sin(angle),
            LEADER_RADIUS_M - radius * np.cos(angle),
            -depth + 0.1 * np.cos(wobble_phase),
        ],
        axis=-1,
    )
    velocity = np.stack(
        [
            radius * rate * np.cos(angle),
            radius * rate * np.sin(angle),
            -0.04 * np.sin(wobble_phase),
        ],
        axis=-1,
    )
    angular_velocity = np.stack(
        [
            np.zeros_like(pitch),
            -0.4 * np.deg2rad(3.0) * np.cos(wobble_phase),
            np.full_like(pitch, rate),
        ],
        axis=-1,
    )
    thrust = np.stack(
        [20 + np.sin(wobble_phase), *(0.5 * np.sin(wobble_phase + i) for i in range(4))], axis=-1
    )
    sites = [
        (f"{name}/{site}", v, offset)
        for v, name in enumerate(names)
        for site, offset in SITES["leader" if v == 0 else "follower"].items()
    ]
    return Trajectory(
        names=names,
        time=time,
        pose=np.concatenate(
            [position, attitude.from_euler(np.pi / 2 - angle, pitch, roll)], axis=2
        ),
        twist=np.concatenate([velocity, angular_velocity], axis=2),
        water_velocity=np.broadcast_to([0.10, -0.05, 0.0], position.shape).copy(),
        effector_states=thrust,
        effector_names=(EFFECTORS,) * len(names),
        effector_force=np.broadcast_to(np.eye(3)[[0, 1, 1, 2, 2]], (len(names), 5, 3)).copy(),
        site_names=tuple(name for name, _, _ in sites),
        site_vehicle=np.array([v for _, v, _ in sites]),
        site_offset=np.array([offset for _, _, offset in sites]),
    )


def moved(trajectory: Trajectory, **replacements: Any) -> Trajectory:
    """The trajectory with other positions, quaternions, velocities, angular velocities or other
    fields.
    """
    pose, twist = (
        np.concatenate(
            [replacements.pop(name, getattr(trajectory, name)) for name in names], axis=2
        )
        for names in (("position", "quaternion"), ("velocity", "angular_velocity"))
    )
    return dataclasses.replace(trajectory, pose=pose, twist=twist, **replacements)


def make_measurements(scenario: Scenario, trajectory: Trajectory, follower: int) -> Measurements:
    """Noisy speed, heading, depth and ranges; pitch and roll are not broadcast, and every 13th
    front range is lost.
    """
    rng = np.random.default_rng([scenario.seed, follower, 0])
    stride = round(scenario.timing.filter_step_s / CONTROL_STEP_S)
    n, v = scenario.filter_steps, follower + 1
    read_index = stride * np.arange(1, n + 1)
    message_step = scenario.message_every * np.arange(1, n // scenario.message_every + 1)
    sent_index = stride * message_step
    m = message_step.size
    hydrophone = trajectory.site(f"{trajectory.names[v]}/hydrophone")
    transmitters = [
        trajectory.site(f"leader/{site}") for site in ("tx_rear", "tx_front", "tx_middle")
    ]
    separation = (
        trajectory.site_position[sent_index][:, transmitters]
        - trajectory.site_position[sent_index][:, [hydrophone]]
    )
    ranges = np.linalg.norm(separation, axis=-1) + rng.uniform(0, 0.01, (m, 3))
    ranges[12::13, 1] = np.nan
    message = np.full((m, len(LeaderMessage._fields)), np.nan)
    message[:, :6] = np.column_stack(
        [
            trajectory.time[sent_index],
            trajectory.position[sent_index, 0, :2],
            trajectory.heading[sent_index, 0],
            trajectory.forward_speed[sent_index, 0],
            trajectory.depth[sent_index, 0],
        ]
    )
    return Measurements(
        dt=scenario.timing.filter_step_s,
        speed=trajectory.forward_speed[read_index, v] + rng.normal(0.2, 0.2, n),
        heading=trajectory.heading[read_index, v]
        + np.deg2rad(5.0)
        + np.abs(rng.normal(0, np.deg2rad(2.0), n)),
        depth=trajectory.depth[read_index, v] + rng.normal(0, 0.02, n),
        message_step=message_step,
        message=message,
        ranges=ranges,
    )


def make_estimates(
    scenario: Scenario, trajectory: Trajectory, measurements: Measurements, follower: int
) -> Estimates:
    """Truth plus a drift of 0.2 m/s that every fix removes; all kinds of fix occur, most of them
    from two points.
    """
    rng = np.random.default_rng([scenario.seed, follower, 1])
    stride = round(scenario.timing.filter_step_s / CONTROL_STEP_S)
    n, v, step = measurements.speed.size, follower + 1, measurements.message_step
    f = step.size
    index = stride * np.arange(1, n + 1)
    truth = trajectory.site_position[
        index, trajectory.site(f"{trajectory.names[v]}/hydrophone"), :2
    ]
    age = measurements.dt * (np.arange(1, n + 1) % scenario.message_every)
    state = np.column_stack(
        [
            truth + 0.2 * age[:, None] * [0.6, -0.8] + rng.normal(0, 0.05, (n, 2)),
            trajectory.velocity[index, v, :2],
        ]
    )
    covariance_factor = np.array(
        [[0.3, 0.1, 0.0, 0.0], [0.0, 0.2, 0.0, 0.0], [0.1, 0.0, 0.2, 0.0], [0.0, 0.1, 0.0, 0.2]]
    )
    covariance = (0.1 + age)[:, None, None] * (covariance_factor @ covariance_factor.T)
    kind = np.full(f, FixKind.TWO_POINTS, dtype=np.int64)
    for order, rare_kind in enumerate(
        (FixKind.ASTERN, FixKind.GATED, FixKind.SINGULAR, FixKind.FUSED, FixKind.TANGENT)
    ):
        kind[4 + 2 * order :: 17] = rare_kind
    kind[np.isnan(measurements.ranges).any(axis=1)] = FixKind.LOST
    innovation = rng.normal(0, 0.2, (f, 2))
    sigma = rng.uniform(0.05, 0.15, f)
    for fix_quantity in (innovation, sigma):
        fix_quantity[kind == FixKind.LOST] = np.nan
    position = state[step - 1, :2] + innovation
    return Estimates(
        state=state,
        covariance=covariance,
        fix_step=step.copy(),
        fix_position=position,
        fix_sigma=sigma,
        fix_kind=kind,
        innovation=innovation,
        innovation_covariance=covariance[step - 1, :2, :2] + sigma[:, None, None] ** 2 * np.eye(2),
    )


def make_flight(
    duration: float = 30.0,
    n_followers: int = 1,
    *,
    filter_step: float = 0.1,
    message_interval: float = 1.0,
    seed: int = 1,
) -> FlightRecord:
    """A whole flight of `duration` [s]; the same arguments give the same arrays."""
    scenario = make_scenario(
        duration, n_followers, filter_step=filter_step, message_interval=message_interval, seed=seed
    )
    trajectory = make_trajectory(scenario)
    measurements = tuple(make_measurements(scenario, trajectory, i) for i in range(n_followers))
    estimates = tuple(
        make_estimates(scenario, trajectory, measurements[i], i) for i in range(n_followers)
    )
    return FlightRecord(
        scenario=scenario, trajectory=trajectory, measurements=measurements, estimates=estimates
    )


def bits(value: Any) -> Any:
    """Nested records with arrays as bytes, so that `==` means equal to the bit, NaN and the sign
    of zero included.
    """
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if dataclasses.is_dataclass(value):
        return {f.name: bits(getattr(value, f.name)) for f in dataclasses.fields(value)}
    return tuple(bits(item) for item in value) if isinstance(value, tuple) else value


def short_flight() -> FlightRecord:
    """A flight of 30 s, for tests of the log."""
    return make_flight(30.0)


def write_log(flight: FlightRecord, folder: Path) -> Path:
    """The log of a flight in a folder, with a summary, errors and an event."""
    path = folder / "mission.mcap"
    events = [Event(12.0, "warning", "mirror lock", "follower")]
    writer.write(flight, path, summary='{"runs": 1}', events=events)
    return path


def messages(path: Path, topic: str) -> list[Any]:
    """All messages of a channel, decoded by the libraries of MCAP and not by this project."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [item.decoded_message for item in reader.iter_decoded_messages(topics=[topic])]


def only(trajectory: Trajectory, vehicles: Sequence[int]) -> Trajectory:
    """Some of the vehicles by index, increasing, 0 first, without their sites."""
    indices, has_effector_names = list(vehicles), bool(trajectory.effector_names)
    return dataclasses.replace(
        trajectory,
        names=tuple(trajectory.names[v] for v in indices),
        effector_names=tuple(trajectory.effector_names[v] for v in indices)
        if has_effector_names
        else (),
        effector_force=trajectory.effector_force[indices],
        **{name: getattr(trajectory, name)[:, indices] for name in OF_VEHICLES},
        site_names=(),
        site_vehicle=np.zeros(0, dtype=np.int64),
        site_offset=np.zeros((0, 3)),
    )


def record(dtype: np.dtype[np.void], *values: Any) -> Record:
    """One record with these values, or of zeros without any."""
    return np.rec.array([values], dtype)[0] if values else records(dtype, 1)[0]


def message(*values: float) -> Record:
    """A message with these values of its first fields, and NaN in the others."""
    unknown = [np.nan] * (len(LeaderMessage._fields) - len(values))
    return record(MESSAGE, *values, *unknown)
