"""A flight written as an MCAP log that Foxglove and Rerun draw; `sim.log.reader` reads it back to the bit."""

import json
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import version
from io import BufferedWriter, FileIO
from itertools import repeat
from operator import itemgetter
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import Context
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import CompressedVideo
from mcap.well_known import MessageEncoding

from sim.flight import Flight
from sim.log.channels import Channel, Errors, Event, channels
from sim.log.contents import FLIGHT, SCENARIO, SUMMARY, VEHICLES, VERSIONS, LogError, partial_path
from sim.log.recovery import holds_messages
from sim.log.schema import DETAILS, Clock, timestamp

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


class _Output(BufferedWriter):
    """A file that keeps its first error: the SDK logs errors of its output, and continues without them."""

    error: BaseException | None = None

    def write(self, data: Any) -> int:
        """Write bytes; after an error they are discarded."""
        try:
            return super().write(data) if self.error is None else len(data)
        except BaseException as error:
            self.error = error
            return len(data)

    def check(self) -> None:
        """Flush the file, or raise the first error of writing."""
        if self.error is not None:
            raise self.error
        self.flush()


class LogFile:
    """Writes an MCAP file; the same calls give the same bytes.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self.output, self._context = _Output(FileIO(path, "wb")), Context()
        options = MCAPWriteOptions(compression_threads=0, compression_level=1, disable_seeking=True)
        self.mcap = foxglove.open_mcap(self.output, context=self._context, writer_options=options)

    def write(self, channels: Sequence[Channel], frames: Iterable[tuple[int, bytes]] = ()) -> None:
        """Write all messages in order of time, in blocks of time that are in the file before the next ones begin.

        Args:
            channels: all but the video; one without messages is not in the file.
            frames: serialised messages of the video with their times [ns], in order.
        """
        types = [(c.topic, c.schema) for c in channels] + [("/camera", CompressedVideo.get_schema())]
        log_to = [
            foxglove.Channel(
                topic, schema=schema, message_encoding=MessageEncoding.Protobuf, context=self._context
            ).base.log
            for topic, schema in types
        ]
        frames = iter(frames)
        written, frame = [0] * len(channels), next(frames, None)
        while True:
            left = [int(c.time_ns[i]) for c, i in zip(channels, written, strict=True) if i < c.time_ns.size]
            left += [frame[0]] if frame else []
            if not left:
                return
            end, messages = min(left) + _BLOCK_NS, list[tuple[int, int, bytes]]()
            for k, (channel, first) in enumerate(zip(channels, written, strict=True)):
                written[k] = stop = int(np.searchsorted(channel.time_ns, end))
                if stop > first:
                    messages += zip(channel.time_ns[first:stop].tolist(), repeat(k), channel.rows(first, stop))
            while frame is not None and frame[0] < end:
                messages.append((frame[0], len(channels), frame[1]))
                frame = next(frames, None)
            # stable, so that equal times keep the order of channels and of messages within one
            messages.sort(key=itemgetter(0))
            for at, k, data in messages:
                log_to[k](data, at)
            self.mcap.flush()
            self.output.check()


@contextmanager
def log_file(path: Path) -> Iterator[LogFile]:
    """A log to write, complete and on the disk when the block ends; if the block fails, it stays without an end.

    Raises:
        OSError: it cannot be written.
    """
    log = LogFile(path)
    with log.output as output:
        try:
            yield log
            log.mcap.close()
            output.check()
            os.fsync(output.fileno())
        except BaseException as error:
            # what the SDK still holds is discarded
            output.error = output.error or error
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
    } | {type_.topic: str(type(flight.estimates[0]) is kind) for kind, type_ in DETAILS.items()}
    log.mcap.write_metadata(FLIGHT, facts)


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
    filled = channels(flight, errors, events)
    frames = _frames(video, Clock(flight.scenario.epoch))
    partial = partial_path(path)
    try:
        with log_file(partial) as log:
            _describe(log, flight, summary)
            log.write(filled, frames)
        os.replace(partial, path)
    except BaseException as error:
        kept = holds_messages(partial)
        if not kept:
            with suppress(OSError):
                partial.unlink()
        if not isinstance(error, OSError):
            raise
        hint = f"; what was written is kept: laisn log recover {partial}" if kept else ""
        raise LogError(f"{path}: cannot be written: {error.strerror or error}{hint}") from error
