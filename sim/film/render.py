"""Flight -> film. Frames are rendered and encoded by child processes, so that no graphics library is needed here."""

import os
import pickle
import subprocess
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, suppress
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryFile
from threading import Thread
from typing import IO, Any

from PIL import Image

from laisn.failure import LaisnError
from sim.film import graphics
from sim.film.frame_renderer import GROUP, Job
from sim.scenario.settings import Video
from sim.system import atomic_write

_IMPORTS = "from sim.film import frame_renderer"  # first line of the program that a child process runs
_LAST_WORDS = 12


class RenderError(LaisnError):
    """A film that cannot be made, and why."""


class RendererDiedError(RuntimeError):
    """A process that renders ended before its work was done; the text states how, and its last output."""


def _check_file(path: Path, suffix: str) -> None:
    if path.suffix.lower() != suffix:
        raise RenderError(f"{path} should end in {suffix}")
    if path.is_dir():
        raise RenderError(f"{path} is a folder; give the file another name")
    if not path.resolve().parent.is_dir():
        raise RenderError(f"the folder {path.resolve().parent} does not exist")


def _results(job: Job, programs: Sequence[str]) -> Generator[Any, None, None]:
    """Results of child processes as they arrive; none outlives the generator. RendererDiedError: one died."""
    backend = graphics.working()
    if backend is None:
        raise RenderError(graphics.MISSING)
    threads = max(1, (os.cpu_count() or 1) // len(programs))
    content = pickle.dumps(job, protocol=pickle.HIGHEST_PROTOCOL)
    start = f"from sim.system import exit_with_parent; exit_with_parent({os.getpid()}); {_IMPORTS}"
    results: SimpleQueue[Any] = SimpleQueue()
    children, readers = list[Any](), list[Thread]()
    try:
        for program in programs:
            command, environment = graphics.child(f"{start}; frame_renderer.{program}", backend.name, threads)
            log = TemporaryFile()  # noqa: SIM115 (the reader closes it)
            pipe = subprocess.PIPE
            children.append(subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=log))
            readers.append(Thread(target=_read, args=(children[-1], log, content, results), daemon=True))
            readers[-1].start()
        going = len(children)
        while going:
            result = results.get()
            if isinstance(result, RendererDiedError):
                raise result
            if result is None:
                going -= 1
            else:
                yield result
    finally:
        for child in children:
            child.kill()
        for reader in readers:
            reader.join()


def _read(child: Any, log: IO[bytes], content: bytes, results: SimpleQueue[Any]) -> None:
    """Send a child its job and collect its results, then None or, if it failed, an error with the end of its log."""
    with log, child, suppress(BrokenPipeError):
        with suppress(BrokenPipeError):
            child.stdin.write(content)
            child.stdin.close()
        # the last result of a child that dies may be cut short
        with suppress(EOFError, pickle.UnpicklingError):
            while True:
                results.put(pickle.load(child.stdout))
        code = child.wait()
        log.seek(0)
        words = log.read().decode(errors="replace").strip().splitlines()[-_LAST_WORDS:]
        how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        message = "\n".join([f"a process that renders frames {how}", *words])
        results.put(RendererDiedError(message) if code else None)


def render(
    job: Job, path: Path, *, workers: int = 2, progress: Callable[[float], None] | None = None
) -> list[tuple[float, bytes]]:
    """Film a flight: H.264 in MP4, yuv420p, index first. The file appears when it is whole.

    Frames and bytes do not depend on the number of workers.

    Args:
        job: what is filmed.
        path: of the film, ending in .mp4; overwritten.
        workers: processes that render.
        progress: called with the share done, in [0, 1].

    Returns:
        The film as a log takes it: mission time [s] and H.264 access unit of each frame.

    Raises:
        RenderError: a setting is impossible, or nothing renders here.
        RendererDiedError: a child died.
    """
    _check_file(path, ".mp4")
    workers = min(workers, job.groups)
    groups: dict[int, list[bytes]] = {}
    with closing(_results(job, [f"main({worker}, {workers})" for worker in range(workers)])) as results:
        for group, found in results:
            groups[group] = found
            if progress:
                progress(len(groups) / job.groups)
    units = [unit for group in range(job.groups) for unit in groups[group]]
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
        RendererDiedError: the child died.
    """
    _check_file(path, ".png")
    start, end = float(job.flight.trajectory.time[0]), float(job.flight.trajectory.time[-1])
    if not start <= time_s <= end:
        raise RenderError(f"time {time_s:g} s lies outside the mission, {start:g} … {end:g} s")
    with closing(_results(job, [f"main_still({float(time_s)!r})"])) as results:
        (pixels,) = results
    with atomic_write(path) as part:
        Image.fromarray(pixels).convert("RGB").save(part, format="png")
