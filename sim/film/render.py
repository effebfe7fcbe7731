"""Flight -> film. Frames are rendered and encoded by child processes, so that no graphics library is needed here."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

from laisn.arrays import Bytes
from laisn.failure import LaisnError
from sim.film import graphics
from sim.film.frame_renderer import GROUP, FrameRenderer, Job, encode
from sim.film.scene import GlScene
from sim.scenario.settings import Video
from sim.system import atomic_write, exit_with_parent

_job: Job  # of a child process


class RenderError(LaisnError):
    """A film that cannot be made, and why."""


def _check_file(path: Path, suffix: str) -> None:
    if path.suffix.lower() != suffix:
        raise RenderError(f"{path} should end in {suffix}")
    if not path.resolve().parent.is_dir():
        raise RenderError(f"the folder {path.resolve().parent} does not exist")


def _begin(parent: int, job: Job) -> None:
    """Prepare a child process; what graphics libraries print is dropped."""
    global _job
    exit_with_parent(parent)
    _job, nowhere = job, os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)


@cache
def _renderer() -> FrameRenderer:
    return FrameRenderer(_job, GlScene(_job.flight, _job.video))


def _frame(time: float) -> Bytes:
    return _renderer().frame(time)


def _encoded(group: int) -> list[bytes]:
    times = _job.times[group * GROUP : (group + 1) * GROUP].tolist()
    return list(encode(map(_renderer().frame, times), _job.video))


@contextmanager
def _children(job: Job, workers: int) -> Iterator[Any]:
    """An executor of child processes that render a job."""
    # stills and films alone need it
    from joblib.externals.loky import ProcessPoolExecutor

    backend = graphics.working()
    if backend is None:
        raise RenderError(graphics.MISSING)
    environment = graphics.environment(backend.name, max(1, (os.cpu_count() or 1) // workers))
    executor = ProcessPoolExecutor(workers, initializer=_begin, initargs=(os.getpid(), job), env=environment)
    try:
        yield executor
    finally:
        executor.shutdown(kill_workers=True)


def render(
    job: Job, path: Path, *, workers: int = 2, progress: Callable[[float], None] | None = None
) -> list[tuple[float, bytes]]:
    """Film a flight: H.264 in MP4, yuv420p, index first. The file appears when it is whole.

    Frames and bytes do not depend on the number of workers. The exception of a child process is raised here.

    Args:
        job: what is filmed.
        path: of the film, ending in .mp4; overwritten.
        workers: processes that render.
        progress: called with the share done, in [0, 1].

    Returns:
        The film as a log takes it: mission time [s] and H.264 access unit of each frame.

    Raises:
        RenderError: a setting is impossible, or nothing renders here.
    """
    _check_file(path, ".mp4")
    units = list[bytes]()
    with _children(job, min(workers, job.groups)) as children:
        groups = [children.submit(_encoded, group) for group in range(job.groups)]
        for done, group in enumerate(groups, start=1):
            units += group.result()
            if progress:
                progress(done / len(groups))
    with atomic_write(path) as part:
        _write_mp4(part, units, job.video)
    return list(zip(job.times.tolist(), units, strict=True))


def _write_mp4(path: Path, units: Sequence[bytes], video: Video) -> None:
    """Wrap access units as they are: one for each frame, in order."""
    # codecs take a tenth of a second to load, and stills need none
    import av

    step = Fraction(1, video.frame_rate_hz)
    with (
        # a demuxer reads size, profile and headers off the first unit
        av.open(BytesIO(units[0]), format="h264") as source,
        av.open(str(path), "w", format="mp4", options={"movflags": "+faststart"}) as target,
    ):
        stream = target.add_stream_from_template(source.streams.video[0])
        stream.time_base = step
        for number, unit in enumerate(units):
            packet = av.Packet(unit)
            packet.stream, packet.time_base = stream, step
            packet.pts = packet.dts = number
            packet.duration = 1
            packet.is_keyframe = number % GROUP == 0
            target.mux(packet)


def still(job: Job, time_s: float, path: Path) -> None:
    """The frame at a mission time [s] as a file that ends in .png; an existing one is overwritten.

    Raises:
        RenderError: a setting is impossible, the time outside the mission, or nothing renders here.
    """
    _check_file(path, ".png")
    start, end = float(job.flight.trajectory.time[0]), float(job.flight.trajectory.time[-1])
    if not start <= time_s <= end:
        raise RenderError(f"time {time_s:g} s lies outside the mission, {start:g} … {end:g} s")
    with _children(job, 1) as children:
        pixels = children.submit(_frame, time_s).result()
    with atomic_write(path) as part:
        Image.fromarray(pixels).convert("RGB").save(part, format="png")
