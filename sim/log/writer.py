"""A flight written as an MCAP log that Foxglove and Rerun draw; `sim.log.reader` reads it back to the bit."""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from itertools import repeat
from operator import itemgetter
from pathlib import Path
from typing import IO

import foxglove
import numpy as np
from foxglove import Context, Schema
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import CompressedVideo
from mcap.well_known import MessageEncoding

from sim.flight import Flight
from sim.log.channels import Channel, Errors, channels
from sim.log.clock import Clock, timestamp
from sim.log.events import Event
from sim.log.file import FLIGHT, SCENARIO, SUMMARY, VEHICLES, VERSIONS, LogError, partial_path
from sim.log.recovery import holds_messages
from sim.log.schema import DETAILS

_BLOCK_NS = 10 * 10**9
"""Time after which what was logged is in the file [ns]."""
PACKAGES = ("laisn-sim", "mujoco", "numpy", "scipy", "numba", "filterpy", "mcap", "foxglove-sdk")
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
    "estimate": "the follower's estimate of its hydrophone's position, with measured depth and heading",
    "time": "log, publish and message time: scenario epoch plus mission time",
}


class _Output:
    """Writes to a file and keeps the first error: the SDK logs errors of its output, and continues without them."""

    def __init__(self, stream: IO[bytes]) -> None:
        self.stream, self._position = stream, 0
        self.error: BaseException | None = None

    def write(self, data: bytes | bytearray) -> int:
        """Write bytes; after an error they are discarded."""
        if self.error is None:
            try:
                self.stream.write(data)
            except BaseException as error:
                self.error = error
        self._position += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Give the position; the SDK does not move it."""
        return self._position

    def flush(self) -> None:
        """Do nothing: `check` flushes the file."""

    def check(self) -> None:
        """Flush the file, or raise the first error of writing."""
        if self.error is not None:
            raise self.error
        self.stream.flush()


class LogFile:
    """Writes an MCAP file; the same calls give the same bytes.

    Args:
        stream: an empty file.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self.output, self._context = _Output(stream), Context()
        options = MCAPWriteOptions(compression_threads=0, compression_level=1, disable_seeking=True)
        self.mcap = foxglove.open_mcap(self.output, context=self._context, writer_options=options)

    def channel(self, topic: str, schema: Schema) -> Callable[[bytes, int], None]:
        """Open a channel for protobuf messages of one type; it is in the file with its first message.

        Returns:
            A function that logs a serialised message at a time since 1970 [ns].
        """
        encoding = MessageEncoding.Protobuf
        return foxglove.Channel(topic, schema=schema, message_encoding=encoding, context=self._context).base.log

    def flush(self) -> None:
        """Write everything so far to the file; raises the first error of writing."""
        self.mcap.flush()
        self.output.check()


@contextmanager
def log_file(path: Path) -> Iterator[LogFile]:
    """A log to write, complete and on the disk when the block ends; if the block fails, it stays without an end.

    Raises:
        OSError: it cannot be written.
    """
    with path.open("wb") as stream:
        log = LogFile(stream)
        try:
            yield log
            log.mcap.close()
            log.output.check()
            os.fsync(stream.fileno())
        except BaseException as error:
            # what the SDK still holds is discarded
            log.output.error = log.output.error or error
            log.mcap.close()
            raise


def _json(value: object) -> bytes:
    return json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False).encode()


def _vehicles(flight: Flight) -> bytes:
    """Names, sites and effectors, which `/tf` holds in part only; JSON keeps float64 to the bit."""
    t = flight.trajectory
    sites = zip(t.site_names, t.site_vehicle.tolist(), t.site_offset.tolist(), strict=True)
    table = [{"name": name, "vehicle": vehicle, "offset": offset} for name, vehicle, offset in sites]
    effectors = [
        [{"name": name, "force": force} for name, force in zip(names, forces, strict=False)]
        for names, forces in zip(t.effector_names, t.effector_force.tolist(), strict=False)
    ]
    return _json({"names": t.names, "sites": table, "effectors": effectors})


def _frames(video: Iterable[tuple[float, bytes]], clock: Clock) -> Iterator[tuple[int, bytes]]:
    """Frames as serialised messages with their times [ns]."""
    last = -1
    for time_s, data in video:
        at = int(clock.ns(time_s))
        if at < last:
            raise ValueError(f"video frames must be in order of time; {time_s:g} s comes too late")
        last = at
        frame = CompressedVideo(timestamp=timestamp(at), frame_id="camera", data=data, format="h264")
        yield at, frame.encode()


def _describe(log: LogFile, flight: Flight, summary: str) -> None:
    """Attachments and metadata of a flight."""
    epoch_ns = Clock(flight.scenario.epoch).epoch_ns
    versions = {package: version(package) for package in PACKAGES}
    files = {SCENARIO: flight.scenario.toml().encode(), VEHICLES: _vehicles(flight)}
    files |= {SUMMARY: summary.encode(), VERSIONS: _json(versions)}
    for name, data in files.items():
        media = f"application/{name.rpartition('.')[2]}"
        log.mcap.attach(log_time=epoch_ns, create_time=epoch_ns, name=name, media_type=media, data=data)
    log.mcap.write_metadata("conventions", CONVENTIONS)
    facts = {
        "outcome": flight.outcome.name,
        "filter_step_s": repr(flight.measurements[0].dt),
        "seed": str(flight.scenario.seed),
        "run": str(flight.scenario.run),
    } | {name: str(type(flight.estimates[0]) is kind) for name, (kind, _) in DETAILS.items()}
    log.mcap.write_metadata(FLIGHT, facts)


def _write_messages(log: LogFile, all_channels: Sequence[Channel], frames: Iterator[tuple[int, bytes]]) -> None:
    """Write all messages in order of time, in blocks of time that are in the file before the next ones begin."""
    log_to = [log.channel(channel.topic, channel.schema) for channel in all_channels]
    log_to.append(log.channel("/camera", CompressedVideo.get_schema()))
    filled = [(k, channel) for k, channel in enumerate(all_channels) if channel.time_ns.size]
    begin = min(int(channel.time_ns[0]) for _, channel in filled)
    last = max(int(channel.time_ns[-1]) for _, channel in filled)
    frame = next(frames, None)
    while begin <= last or frame is not None:
        end, messages = begin + _BLOCK_NS, list[tuple[int, int, bytes]]()
        for k, channel in filled:
            first, stop = np.searchsorted(channel.time_ns, [begin, end]).tolist()
            if stop > first:
                rows = channel.rows(first, stop)
                messages += zip(channel.time_ns[first:stop].tolist(), repeat(k), rows, strict=False)
        while frame is not None and frame[0] < end:
            messages.append((frame[0], len(all_channels), frame[1]))
            frame = next(frames, None)
        # stable, so that equal times keep the order of channels and of messages within one
        messages.sort(key=itemgetter(0))
        for at, k, data in messages:
            log_to[k](data, at)
        log.flush()
        begin = end


def write(
    flight: Flight,
    path: Path,
    *,
    summary: str = "{}",
    errors: Sequence[Errors] = (),
    events: Iterable[Event] = (),
    video: Iterable[tuple[float, bytes]] = (),
) -> None:
    """Write a flight; the same arguments give the same bytes.

    The file grows under `partial_path(path)` and gets its name when it is complete. If writing fails, what can be
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
        with log_file(partial) as log:
            _describe(log, flight, summary)
            _write_messages(log, all_channels, frames)
        os.replace(partial, path)
    except OSError as error:
        kept = f"; what was written is kept: laisn log recover {partial}" if _keep(partial) else ""
        raise LogError(f"{path}: cannot be written: {error.strerror or error}{kept}") from error
    except BaseException:
        _keep(partial)
        raise


def _keep(partial: Path) -> bool:
    """Whether a partial log can be rescued; it is removed otherwise."""
    kept = holds_messages(partial)
    if not kept:
        with suppress(OSError):
            partial.unlink()
    return kept
