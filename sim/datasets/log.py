"""A data set to its log, and back: beacons are transmitters of a leader at rest, the vehicle a
follower.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.errors import LaisnError
from laisn.messages import LeaderMessage, Measurements, Ranges
from sim.datasets.factor_graph import read_factor_graph
from sim.datasets.range_data import RangeData, read_range_tables
from sim.datasets.vehicle_table import VehicleTable
from sim.log.blocks import LogChannel
from sim.log.contents import Contents, LogError, log_errors
from sim.log.reader import read_recording
from sim.log.schema import OWN_MOTION, PLACED_RECEPTION, PLACES, POSE_FIELDS, RECEPTION, Clock
from sim.log.writer import numeric, poses, write_channels
from sim.system import atomic_write

VEHICLE = "vehicle"  # name of the vehicle in the log
_READERS = {
    ".pyfg": read_factor_graph,
    ".mat": read_range_tables,
    ".txt": read_range_tables,
    ".csv": read_range_tables,
}
_RECORD = "data set"  # metadata record by which such a log is known
# what it holds of the sensors' errors, as the data set states them
_STATED_ERRORS = ("range_sigma", "slip", "heading_walk", "track_slip", "track_heading_walk")
_TRANSMITTERS = Ranges._fields  # names of the transmitters of a message, in order
_nanoseconds = Clock("1970-01-01T00:00:00Z").ns
# a range that does not fit into the reception of its instant is received so much later [s]
_SEPARATION = 1e-6
# columns of an array of messages
_COLUMN_OF = {name: column for column, name in enumerate(LeaderMessage._fields)}
_POSITION_COLUMNS = slice(_COLUMN_OF["east"], _COLUMN_OF["heading"])  # east, north
# east, north, heading, speed, as of `RangeData.range_track`
_TRACK_COLUMNS = slice(_COLUMN_OF["east"], _COLUMN_OF["depth"])


def read_data_set(path: Path) -> RangeData:
    """The odometry and ranges in a file; LaisnError if its name ends in nothing that is known,
    or it cannot be read.
    """
    reader = _READERS.get(path.suffix)
    if reader is None and not path.exists():
        raise LaisnError(f"{path}: cannot be read: No such file or directory")
    if reader is None:
        raise LaisnError(
            f"{path}: the name should end in .csv (a table), .pyfg (a factor graph), "
            "or be that of a .mat or a _DR.txt (a data set of ranging radios), or of the folder or "
            "file of a ROS 2 bag"
        )
    return reader(path)


class Replayable(NamedTuple):
    """A data set read back from its log."""

    measurements: Measurements
    start: Floats  # x, y [m] and velocity [m/s] at step 0, shape (4,)
    stated: dict[str, Any]  # numbers, as of `RangeData`
    # time since the begin of the first step [s], east and north [m], shape (t, 3)
    truth: Floats
    remarks: tuple[str, ...]
    time_s: Floats  # as of `Recording`


def _with_robots_that_fit(data: RangeData) -> RangeData:
    """Data with the ranges to as many robots that move as a reception has transmitters: those with
    the most ranges.
    """
    counts = {
        name: int(np.count_nonzero(data.range_beacon == data.beacons.index(name)))
        for name in data.moving
    }
    left_out = sorted(counts, key=lambda name: -counts[name])[len(_TRANSMITTERS) :]
    if not left_out:
        return data
    remark = (
        f"ranges to {', '.join(left_out)} left out: at most {len(_TRANSMITTERS)} robots that move "
        "are taken, those with the most ranges; --beacons selects others"
    )
    selection = data.with_beacons([name for name in data.beacons if name not in left_out])
    return replace(selection, remarks=(*selection.remarks, remark))


def _times_and_transmitters(data: RangeData) -> tuple[Floats, Ints]:
    """When each range is received [s], and of which transmitter it is, a number in `_TRANSMITTERS`;
    shapes (m,).

    Two or three beacons have a transmitter each. Of more, ranges of one instant take rear, front
    and middle in turn, and a robot that moves always has the same transmitter. What finds no free
    one is received a microsecond later, as is the range to a second robot: a message has one place
    of a robot.
    """
    transmitter_of_robot = {
        data.beacons.index(name): i % len(_TRANSMITTERS) for i, name in enumerate(data.moving)
    }
    times = np.empty(data.ranges.size)
    transmitters = np.empty(data.ranges.size, dtype=np.int64)
    has_own_transmitters = len(data.beacons) <= len(_TRANSMITTERS)
    used_transmitters = set[int]()
    has_robot = False
    last = -math.inf
    for i, (time, beacon) in enumerate(
        zip(data.range_time.tolist(), data.range_beacon.tolist(), strict=True)
    ):
        if time > last:
            used_transmitters = set()
            has_robot = False
        free = next((s for s in range(len(_TRANSMITTERS)) if s not in used_transmitters), 0)
        transmitter = beacon if has_own_transmitters else transmitter_of_robot.get(beacon, free)
        last = max(time, last)
        if transmitter in used_transmitters or (has_robot and beacon in transmitter_of_robot):
            last = last + _SEPARATION
            used_transmitters = set()
            has_robot = False
        used_transmitters.add(transmitter)
        has_robot = has_robot or beacon in transmitter_of_robot
        times[i] = last
        transmitters[i] = transmitter
    return times, transmitters


def _channels(data: RangeData) -> Iterator[LogChannel]:
    """Own motion, receptions and true path."""
    range_times, range_transmitters = _times_and_transmitters(data)
    end, speed, heading = replace(data, range_time=range_times).legs()
    # the first reading, at rest, ends a step at the first pose, so that the next step begins there
    depth = np.zeros(end.size + 1)
    motion = {
        "speed": np.append(0.0, speed),
        "heading": np.append(heading[0], heading),
        "depth": depth,
    }
    yield numeric(f"/{VEHICLE}", OWN_MOTION, _nanoseconds(np.append(data.time[0], end)), motion)

    # what was received at one time is one reception
    reception_times, reception_rows = np.unique(range_times, return_inverse=True)
    message = np.zeros((reception_times.size, len(LeaderMessage._fields)))
    message[:, _COLUMN_OF["timestamp"]] = reception_times
    message[:, _POSITION_COLUMNS] = data.places.mean(axis=0)
    message[:, _COLUMN_OF["pitch"] :] = np.nan
    ranges = np.full((reception_times.size, len(_TRANSMITTERS)), np.nan)
    places = np.full((reception_times.size, *PLACES.shape), np.nan)
    ranges[reception_rows, range_transmitters] = data.ranges
    places[reception_rows, range_transmitters, :2] = data.places[data.range_beacon]
    if data.moving:
        # the other robot's track, as it would broadcast it
        places[reception_rows, range_transmitters, :2] = data.range_track[:, :2]
        is_moving = np.isin(data.range_beacon, [data.beacons.index(name) for name in data.moving])
        message[reception_rows[is_moving], _TRACK_COLUMNS] = data.range_track[is_moving]
    places[reception_rows, range_transmitters, 2] = 0.0
    arrays = {"message": message, "ranges": ranges, "transmitters": places}
    yield numeric(f"/{VEHICLE}", PLACED_RECEPTION, _nanoseconds(reception_times), arrays)

    truth_time, *coordinates = data.truth[np.argsort(data.truth[:, 0], kind="stable")].T
    # no attitude is known: identity
    identity = np.tile([1.0, 0.0, 0.0, 0.0], (truth_time.size, 1))
    yield poses(
        f"/{VEHICLE}/pose",
        _nanoseconds(truth_time),
        np.column_stack([*coordinates, np.zeros(truth_time.size)]),
        identity,
    )


def write_data_set(data: RangeData, path: Path) -> RangeData:
    """Write a data set as a log that `laisn replay` navigates on; the data as written, without
    robots that do not fit. LogError if it cannot be written.
    """
    data = _with_robots_that_fit(data)
    facts = {
        "source": Path(data.source).name,
        "beacons": ",".join(data.beacons),
        "start_east": repr(float(data.start[0])),
        "start_north": repr(float(data.start[1])),
        **{name: repr(data.stated[name]) if name in data.stated else "" for name in _STATED_ERRORS},
    }
    _write(path, list(_channels(data)), facts)
    return data


def write_vehicle_table(table: VehicleTable, path: Path) -> None:
    """Write measurements of a vehicle, named "follower", as a log for `laisn replay`; LogError
    if that fails.
    """
    empty = np.full(table.time_ns.size, np.nan)
    has_motion = np.isfinite(table.columns["speed"]) & np.isfinite(table.columns["heading"])
    ranges = [values for field, values in table.columns.items() if field.startswith("range_")]
    received = np.any(np.isfinite(ranges), axis=0)
    reception = PLACED_RECEPTION if set(PLACES.names) & set(table.columns) else RECEPTION
    channels = []
    motion_rows = np.flatnonzero(has_motion)
    received_rows = np.flatnonzero(received)
    received_rows = received_rows[np.argsort(table.reception_ns[received_rows], kind="stable")]
    for type_, rows, times in (
        (OWN_MOTION, motion_rows, table.time_ns),
        (reception, received_rows, table.reception_ns),
    ):
        arrays = {
            array.attribute: np.column_stack(
                [table.columns.get(field, empty) for field in array.names]
            )[rows]
            for array in type_.columns
        }
        channels.append(numeric("/follower", type_, times[rows], arrays))
    _write(path, channels, {})


def _write(path: Path, channels: Sequence[LogChannel], facts: dict[str, str]) -> None:
    with log_errors(path), atomic_write(path) as temporary:
        write_channels(
            temporary, channels, lambda mcap: mcap.write_metadata(_RECORD, facts) if facts else None
        )


def is_data_set(path: Path) -> bool:
    """Whether a log is of a data set; LogError if it cannot be read."""
    return _RECORD in Contents(path, lambda topic, _: False).metadata


def read_data_set_log(path: Path, longest_gap_s: float = 10.0) -> Replayable:
    """Read a log of `write_data_set`; LogError if it is damaged or of something else, or has too
    long a gap.
    """
    pose_topic = f"/{VEHICLE}/pose"
    motion_topic = f"/{VEHICLE}/motion"
    log = Contents(path, lambda topic, _: topic == pose_topic)
    if _RECORD not in log.metadata:
        raise LogError(f"{path}: no log of a data set; laisn log import FILE --out LOG makes one")
    measurements, remarks, time_s = read_recording(path, VEHICLE, longest_gap_s)
    with log_errors(path):
        facts = log.metadata[_RECORD]
        truth = np.empty((0, 3))
        if pose_topic in log.topics:
            # the first step of Δt ends where the data set begins
            since_start_s = (
                log.topics[pose_topic].time_ns - log.topics[motion_topic].time_ns.min()
            ) / 1e9 + measurements.dt
            truth = np.column_stack([since_start_s, log.topics[pose_topic].table(POSE_FIELDS[:2])])
        start = np.array([float(facts["start_east"]), float(facts["start_north"]), 0.0, 0.0])
        stated = {name: float(facts[name]) for name in _STATED_ERRORS if facts.get(name)}
    return Replayable(measurements, start, stated, truth, remarks, time_s)
