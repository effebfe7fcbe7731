"""A flight written as an MCAP log that Foxglove and Rerun draw; `sim.log.reader` reads it back to the bit."""

import functools
import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.metadata import version
from io import BufferedWriter, FileIO
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import Context
from foxglove.mcap import MCAPWriteOptions, MCAPWriter
from foxglove.messages import CompressedVideo
from mcap.well_known import MessageEncoding

from sim.flight import Flight
from sim.log.channels import Channel, Errors, Event, channels
from sim.log.contents import FLIGHT, SCENARIO, SUMMARY, VEHICLES, VERSIONS, LogError, partial_path
from sim.log.recovery import holds_messages
from sim.log.schema import DETAILS, FIXED, Clock, timestamp

_BLOCK_NS = 10 * 10**9
"""What was logged of this time is in the file before more is logged [ns]."""
_END_NS = 2**63 - 1
"""After all messages [ns]."""
_PACKAGES = ("laisn-sim", "mujoco", "numpy", "scipy", "numba", "filterpy", "mcap", "foxglove-sdk")
_CONVENTIONS = {
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


def _write(
    output: _Output,
    channels: Sequence[Channel],
    frames: Iterable[tuple[int, bytes]],
    describe: Callable[[MCAPWriter], None],
) -> None:
    context, options = Context(), MCAPWriteOptions(compression_threads=0, compression_level=1, disable_seeking=True)
    types = [(c.topic, c.schema) for c in channels] + [("/camera", CompressedVideo.get_schema())]
    mcap = foxglove.open_mcap(output, context=context, writer_options=options)
    try:
        describe(mcap)
        *logs, log_image = [
            foxglove.Channel(topic, schema=schema, message_encoding=MessageEncoding.Protobuf, context=context).base.log
            for topic, schema in types
        ]
        blocks = sorted({block for c in channels for block in np.unique(c.time_ns // _BLOCK_NS).tolist()})
        starts, images = [block * _BLOCK_NS for block in blocks], iter(frames)
        image = next(images, None)
        for start, end in pairwise([*starts, _END_NS]):
            messages = [
                (at, log, data) for log, c in zip(logs, channels, strict=True) for at, data in c.between(start, end)
            ]
            while image is not None and image[0] < end:
                messages.append((image[0], log_image, image[1]))
                image = next(images, None)
            # messages of equal times stay in the order of channels
            messages.sort(key=itemgetter(0))
            for at, log, data in messages:
                log(data, at)
            mcap.flush()
            output.check()
        mcap.close()
        output.check()
        os.fsync(output.fileno())
    except BaseException as error:
        # what the SDK still holds is discarded
        output.error = output.error or error
        mcap.close()
        raise


def write_channels(
    path: Path,
    channels: Sequence[Channel],
    frames: Iterable[tuple[int, bytes]] = (),
    describe: Callable[[MCAPWriter], None] = lambda mcap: None,
) -> None:
    """Write an MCAP file; the same arguments give the same bytes. If that fails, the file stays without an end.

    Args:
        path: the file.
        channels: one without messages is not in the file. Messages of all channels are in order of time, in blocks of
            ten seconds, each of which is in the file before the next one begins.
        frames: of the film, times [ns] and serialised messages.
        describe: writes attachments and metadata.

    Raises:
        OSError: it cannot be written.
    """
    with _Output(FileIO(path, "wb")) as output, ThreadPoolExecutor(1) as thread:
        # apart from the main thread, where handlers of signals may raise: the SDK does not survive an exception
        done = thread.submit(_write, output, channels, frames, describe)
        try:
            done.result()
        except BaseException as error:
            output.error = output.error or error
            raise


def _json(value: object) -> bytes:
    return json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False).encode()


def _frames(video: Iterable[tuple[float, bytes]], clock: Clock) -> Iterator[tuple[int, bytes]]:
    """Frames as serialised messages with their times [ns]."""
    last = -1
    for time_s, data in video:
        at = int(clock.ns(time_s))
        if at < last:
            raise ValueError(f"video frames must be in order of time; {time_s:g} s comes too late")
        last = at
        yield at, CompressedVideo(timestamp=timestamp(at), frame_id="camera", data=data, format="h264").encode()


def _describe(flight: Flight, summary: str, mcap: MCAPWriter) -> None:
    """Attachments and metadata of a flight."""
    at = Clock(flight.scenario.epoch).epoch_ns
    versions = {package: version(package) for package in _PACKAGES}
    # JSON keeps float64 to the bit
    values = {name: getattr(flight.trajectory, name) for name in FIXED}
    vehicles = {name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values.items()}
    files = {SCENARIO: flight.scenario.toml().encode(), SUMMARY: summary.encode()}
    for name, data in (files | {VEHICLES: _json(vehicles), VERSIONS: _json(versions)}).items():
        media = f"application/{name.rpartition('.')[2]}"
        mcap.attach(log_time=at, create_time=at, name=name, media_type=media, data=data)
    mcap.write_metadata("conventions", _CONVENTIONS)
    facts = {
        "outcome": flight.outcome.name,
        "filter_step_s": repr(flight.measurements[0].dt),
        "seed": str(flight.scenario.seed),
        "run": str(flight.scenario.run),
    } | {type_.topic: str(type(flight.estimates[0]) is kind) for kind, type_ in DETAILS.items()}
    mcap.write_metadata(FLIGHT, facts)


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
    if path.is_dir():
        raise LogError(f"{path}: cannot be written: it is a folder, expected the name of a file")
    partial = partial_path(path)
    try:
        describe = functools.partial(_describe, flight, summary)
        write_channels(partial, filled, _frames(video, Clock(flight.scenario.epoch)), describe)
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
