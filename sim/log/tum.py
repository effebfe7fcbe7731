"""Truth and estimates of a flight as trajectories in TUM's format, which evo and other programs
evaluate.

A line is a pose: time since 1970 [s], position (east, north, up) [m], quaternion (x, y, z, w).
"""

from pathlib import Path

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.estimates import Estimates
from sim import attitude
from sim.flight import FlightRecord
from sim.log.reader import read
from sim.log.schema import Clock
from sim.system import atomic_write


def estimates_of(flight: FlightRecord, vehicle: int) -> Estimates | None:
    """What a vehicle, 0 for the leader, has concluded; None: it has no navigator."""
    if vehicle:
        return flight.estimates[vehicle - 1]
    return None if flight.leader is None else flight.leader.estimates


def estimated_poses(flight: FlightRecord, vehicle: int) -> tuple[Floats, Floats]:
    """Estimated positions of the hydrophone of a vehicle that navigates, 0 for the leader, shape
    (n, 3), [m], and its attitude, level and at the measured heading, as quaternions (w, x, y, z),
    shape (n, 4), at filter steps.

    The depth is measured, too. Of a leader without a hydrophone it is the origin of the hull.
    """
    estimates = estimates_of(flight, vehicle)
    assert estimates is not None
    leader = flight.leader
    measured = None if leader is None else leader.measurements
    if vehicle:
        measured = flight.measurements[vehicle - 1]
    assert measured is not None
    up = flight.assumed_hydrophone_height(vehicle) - measured.last_depth
    position = np.column_stack([estimates.state[:, :2], up])
    return position, attitude.from_euler(measured.heading)


def _write(path: Path, time_ns: Ints, position: Floats, quaternion: Floats) -> Path:
    """Write poses at times since 1970, shape (n,), [ns]: positions, shape (n, 3), [m], and
    quaternions (w, x, y, z), shape (n, 4).
    """
    lines = ["# time [s] east north up [m] qx qy qz qw\n"]
    xyzw = np.roll(quaternion, -1, axis=1)
    for stamp_ns, east_north_up, qxyzw in zip(
        time_ns.tolist(), position.tolist(), xyzw.tolist(), strict=True
    ):
        numbers = " ".join(f"{value:.9f}" for value in (*east_north_up, *qxyzw))
        lines.append(f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {numbers}\n")
    with atomic_write(path) as temporary:
        temporary.write_text("".join(lines), encoding="utf-8")
    return path


def write_trajectories(log_path: Path, out: Path) -> list[Path]:
    """Write NAME_truth.tum and NAME_estimate.tum of the hydrophone of each vehicle that navigates,
    at the filter steps from the first estimate on; returns the files. LogError if the log holds no
    flight.
    """
    flight = read(log_path)
    clock = Clock(flight.scenario.epoch)
    out.mkdir(parents=True, exist_ok=True)
    steps = flight.step_index()
    files = list[Path]()
    dt = flight.measurements[0].dt
    for vehicle, name in enumerate(flight.trajectory.names):
        if estimates_of(flight, vehicle) is None:
            continue
        position, quaternion = estimated_poses(flight, vehicle)
        valid = np.flatnonzero(np.isfinite(position).all(axis=1))
        time_ns = clock.ns(dt * (valid + 1))
        truth = flight.hydrophone(vehicle - 1) if vehicle else flight.leader_position()
        truth = truth[valid]
        true_quaternion = flight.trajectory.quaternion[steps[valid], vehicle]
        files.append(_write(out / f"{name}_truth.tum", time_ns, truth, true_quaternion))
        files.append(
            _write(out / f"{name}_estimate.tum", time_ns, position[valid], quaternion[valid])
        )
    return files
