"""A flight written as an MCAP log that Foxglove and Rerun draw; `sim.log.reader` reads it back to the bit."""

import json
import os
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from itertools import repeat
from operator import itemgetter
from pathlib import Path
from typing import IO, Any

import numpy as np
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from mcap.well_known import MessageEncoding
from mcap_protobuf.schema import register_schema

from sim.flight import Flight
from sim.log.batches import rescuable
from sim.log.channels import Channel, Errors, channels
from sim.log.clock import Clock, timestamp
from sim.log.events import Event
from sim.log.file import SCENARIO, SUMMARY, VEHICLES, VERSIONS, LogError, partial_path
from sim.log.proving import ProvingWriter
from sim.scenario import file as scenario_file

BLOCK_NS = 10 * 10**9
"""Time that is proved by one record [ns]."""
_BLOCKS_AT_ONCE = 4
"""Blocks that are serialised together: fewer cost time, more cost memory."""
PACKAGES = ("laisn-sim", "mujoco", "numpy", "scipy", "numba", "filterpy", "mcap", "foxglove-schemas-protobuf")
CONVENTIONS = {
    "world": "x east, y north, z up [m]; depth = -z",
    "body": "x forward, y port, z up; origin at the centre of buoyancy",
    "units": "SI and radians, but latitude and longitude in degrees",
    "heading": "compass: clockwise from north",
    "pitch": "positive nose up",
    "roll": "positive starboard down",
    "quaternion": "body to world; Foxglove stores x, y, z, w",
    "angular_velocity": "in the body frame",
    "pose": "the truth",
    "estimate": "what the follower believes: its hydrophone's position, with measured depth and heading",
    "time": "log, publish and message time: scenario epoch plus mission time",
}


@dataclass(frozen=True)
class LogStatistics:
    """What was written."""

    path: Path
    messages: int
    size: int
    """Size of the file [bytes]."""


def _json(value: object) -> bytes:
    return json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False).encode()


def _vehicles(flight: Flight) -> bytes:
    """Names and sites, which `/tf` holds in part only; JSON keeps float64 to the bit."""
    t = flight.trajectory
    sites = zip(t.site_names, t.site_vehicle.tolist(), t.site_offset.tolist(), strict=True)
    table = [{"name": name, "vehicle": vehicle, "offset": offset} for name, vehicle, offset in sites]
    return _json({"names": t.names, "sites": table})


def _frames(video: Iterable[tuple[float, bytes]], clock: Clock) -> Iterator[tuple[int, bytes]]:
    """Frames as serialised messages with their times [ns]."""
    last = -1
    for time_s, data in video:
        at = int(clock.ns(time_s))
        if at < last:
            raise ValueError(f"video frames must be in order of time; {time_s:g} s comes too late")
        last = at
        frame = CompressedVideo(timestamp=timestamp(at), frame_id="camera", data=data, format="h264")
        yield at, frame.SerializeToString()


def _last_ns(all_channels: Sequence[Channel]) -> int:
    return max(int(channel.time_ns[-1]) for channel in all_channels if channel.time_ns.size)


def _blocks(all_channels: Sequence[Channel], ids: Sequence[int]) -> Iterator[tuple[int, list[tuple[int, int, bytes]]]]:
    """Start of each block of time, and its messages (time, channel, data) in order of time."""
    filled = [(channel, id_) for channel, id_ in zip(all_channels, ids, strict=True) if channel.time_ns.size]
    start = min(int(channel.time_ns[0]) for channel, _ in filled)
    end = _last_ns(all_channels)
    for begin in range(start, end + 1, _BLOCKS_AT_ONCE * BLOCK_NS):
        messages: list[tuple[int, int, bytes]] = []
        beyond = begin + _BLOCKS_AT_ONCE * BLOCK_NS
        for channel, id_ in filled:
            first, stop = np.searchsorted(channel.time_ns, [begin, beyond]).tolist()
            messages += zip(channel.time_ns[first:stop].tolist(), repeat(id_), channel.rows(first, stop))
        # stable, so that equal times keep the order of channels and of messages within one
        messages.sort(key=itemgetter(0))
        for block in range(begin, min(beyond, end + 1), BLOCK_NS):
            first, stop = (bisect_left(messages, at, key=itemgetter(0)) for at in (block, block + BLOCK_NS))
            yield block, messages[first:stop]


def _write(
    stream: IO[bytes],
    flight: Flight,
    all_channels: Sequence[Channel],
    summary: str,
    frames: Iterator[tuple[int, bytes]],
) -> int:
    """Write the whole log and return the number of messages; what describes the flight stands before its messages."""
    writer = ProvingWriter(stream)
    epoch_ns = Clock(flight.scenario.epoch).epoch_ns
    texts = [
        (SCENARIO, "application/toml", scenario_file.dumps(flight.scenario).encode()),
        (VEHICLES, "application/json", _vehicles(flight)),
        (SUMMARY, "application/json", summary.encode()),
        (VERSIONS, "application/json", _json({package: version(package) for package in PACKAGES})),
    ]
    for name, media_type, data in texts:
        writer.add_attachment(create_time=epoch_ns, log_time=epoch_ns, name=name, media_type=media_type, data=data)
    writer.add_metadata("conventions", CONVENTIONS)
    facts = {
        "outcome": flight.outcome.name,
        "filter_step_s": repr(flight.measurements[0].dt),
        "seed": str(flight.scenario.seed),
        "run": str(flight.scenario.run),
    }
    writer.add_metadata("laisn", facts)
    schemas: dict[str, int] = {}

    def register(topic: str, message_class: Any) -> int:
        name = message_class.DESCRIPTOR.full_name
        if name not in schemas:
            schemas[name] = register_schema(writer, message_class)
        return int(writer.register_channel(topic, MessageEncoding.Protobuf, schemas[name]))

    ids = [register(channel.topic, channel.message_class) for channel in all_channels]
    count, camera = 0, 0
    frame = next(frames, None)
    if frame is not None:
        camera = register("/camera", CompressedVideo)
    for begin, messages in _blocks(all_channels, ids):
        writer.prove(begin)
        while frame is not None and frame[0] < begin + BLOCK_NS:
            messages.append((frame[0], camera, frame[1]))
            frame = next(frames, None)
        messages.sort(key=itemgetter(0))
        writer.add_messages(messages)
        count += len(messages)
    while frame is not None:
        writer.add_message(camera, frame[0], frame[1], frame[0])
        count += 1
        frame = next(frames, None)
    writer.prove(_last_ns(all_channels) + 1, flight.outcome.name)
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it bare
    return count


def write(
    flight: Flight,
    path: Path,
    *,
    summary: str = "{}",
    errors: Sequence[Errors] = (),
    events: Iterable[Event] = (),
    video: Iterable[tuple[float, bytes]] = (),
) -> LogStatistics:
    """Write a flight; the same arguments give the same bytes.

    The file grows under `partial_path(path)` and gets its name when it is whole. If writing fails, what can be
    rescued with `sim.log.recovery` stays there, and nothing else.

    Args:
        path: the log; an existing one is replaced.
        summary: JSON text, attached as it is.
        errors: E_P [m] and E_B [rad] of each follower, shapes (n,), or nothing.
        events: lines for `/log` besides those about fixes.
        video: times since the start [s] and H.264 access units (Annex B, no B-frames, parameter sets with every key
            frame), in order of time.

    Raises:
        LogError: the file cannot be written, or the flight is a stretch that begins within its mission.
        ValueError: errors or video do not fit the flight, or its epoch no log.
    """
    if flight.trajectory.time[0] != 0:
        raise LogError(f"{path}: a log begins with its mission; this flight at {flight.trajectory.time[0]:g} s of it")
    all_channels = channels(flight, errors, events)
    frames = _frames(video, Clock(flight.scenario.epoch))
    partial = partial_path(path)
    try:
        with partial.open("wb") as stream:
            count = _write(stream, flight, all_channels, summary, frames)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(partial, path)
    except OSError as error:
        kept = _tidy(partial)
        raise LogError(f"{path}: cannot be written: {error.strerror or error}{kept}") from error
    except BaseException:
        _tidy(partial)
        raise
    return LogStatistics(path=path, messages=count, size=path.stat().st_size)


def _tidy(partial: Path) -> str:
    """Remove a partial log unless it can be rescued; says what to do with it then."""
    if rescuable(partial):
        return f"; what was written is kept: laisn log recover {partial}"
    with suppress(OSError):
        partial.unlink()
    return ""
