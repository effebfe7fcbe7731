"""A flight written as an MCAP log that Foxglove and Rerun draw; `sim.log.reader` reads it back to the bit."""

import json
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.metadata import version
from io import BufferedWriter, FileIO
from operator import itemgetter
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import Context
from foxglove.mcap import MCAPWriteOptions, MCAPWriter
from mcap.well_known import MessageEncoding

from sim.flight import Flight
from sim.log.channels import Channel, Event, Frame, channels
from sim.log.contents import FLIGHT, SCENARIO, SUMMARY, VEHICLES, VERSIONS, LogError, holds_messages, partial_path
from sim.log.schema import DETAILS, FIXED, Clock

_BLOCK_NS = 10 * 10**9
"""What was logged of this time is in the file before more is logged [ns]."""
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
    """A file that keeps its first error and discards what follows: the SDK logs errors of its output and continues."""

    error: BaseException | None = None

    def write(self, data: Any) -> int:
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


def _write(output: _Output, channels: Sequence[Channel], describe: Callable[[MCAPWriter], None]) -> None:
    context, options = Context(), MCAPWriteOptions(compression_threads=0, compression_level=1, disable_seeking=True)
    mcap, proto = foxglove.open_mcap(output, context=context, writer_options=options), MessageEncoding.Protobuf
    try:
        describe(mcap)
        made = [foxglove.Channel(c.topic, schema=c.schema, message_encoding=proto, context=context) for c in channels]
        for block in sorted({block for c in channels for block in np.unique(c.time_ns // _BLOCK_NS).tolist()}):
            messages = list[tuple[int, Any, bytes]]()
            for own, c in zip(made, channels, strict=True):
                part = slice(*np.searchsorted(c.time_ns, [block * _BLOCK_NS, (block + 1) * _BLOCK_NS]).tolist())
                times = c.time_ns[part].tolist()
                messages += [(at, own.base.log, data) for at, data in zip(times, c.rows(part), strict=True)]
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


def write_channels(path: Path, channels: Sequence[Channel], describe: Callable[[MCAPWriter], None]) -> None:
    """Write an MCAP file; the same arguments give the same bytes. If that fails, the file stays without an end.

    Messages of all channels are in order of time, in blocks of ten seconds, each of which is in the file before the
    next one begins; a channel without messages is not in it. `describe` writes attachments and metadata.
    """
    with _Output(FileIO(path, "wb")) as output, ThreadPoolExecutor(1) as thread:
        # apart from the main thread, where handlers of signals may raise: the SDK does not survive an exception
        done = thread.submit(_write, output, channels, describe)
        try:
            done.result()
        except BaseException as error:
            output.error = output.error or error
            raise


def _json(value: object) -> bytes:
    return json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False).encode()


def _describe(flight: Flight, summary: str, mcap: MCAPWriter) -> None:
    """Attachments and metadata of a flight."""
    at = Clock(flight.scenario.epoch).epoch_ns
    # JSON keeps float64 to the bit
    values = {name: getattr(flight.trajectory, name) for name in FIXED}
    files = {
        SCENARIO: flight.scenario.toml().encode(),
        SUMMARY: summary.encode(),
        VEHICLES: _json({name: v.tolist() if isinstance(v, np.ndarray) else v for name, v in values.items()}),
        VERSIONS: _json({package: version(package) for package in _PACKAGES}),
    }
    for name, data in files.items():
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
    events: Iterable[Event] = (),
    video: Sequence[Frame] = (),
) -> None:
    """Write a flight; the same arguments give the same bytes.

    The file grows under `partial_path(path)` and gets its name when it is complete. If writing fails, what can be
    recovered with `sim.log.contents.recover` stays there, and nothing else.

    Args:
        flight: from the start of its mission.
        path: the log; an existing one is replaced.
        summary: JSON text, attached as it is.
        events: lines for `/log` besides those about fixes.
        video: frames in order of time.

    Raises:
        LogError: the file cannot be written, or the flight begins within its mission.
        ValueError: frames are out of order, or the epoch lies before 1970.
    """
    if flight.trajectory.time[0] != 0:
        raise LogError(f"{path}: a log begins with its mission; this flight at {flight.trajectory.time[0]:g} s of it")
    filled = channels(flight, events, video)
    if path.is_dir():
        raise LogError(f"{path}: cannot be written: it is a folder, expected the name of a file")
    partial = partial_path(path)
    try:
        write_channels(partial, filled, lambda mcap: _describe(flight, summary, mcap))
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
