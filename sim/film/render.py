"""Flight -> film. Frames are rendered and encoded by child processes, so that no graphics library is needed here."""

import os
import pickle
import selectors
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from sim.files import atomic_write
from sim.film import graphics
from sim.film.annotations import NOTHING, Annotations
from sim.film.frame_renderer import GROUP, Job, group_file
from sim.flight import Flight
from sim.scenario.settings import Video
from sim.scenario.video import CAMERAS

Errors = Sequence[tuple[Floats, Floats]]
Progress = Callable[[float], None]

_IMPORTS = "from pathlib import Path; from sim.film import frame_renderer"
"""First line of the program that a child process runs."""
_STILL_SAMPLES = 4
_LAST_WORDS = 12


class RenderError(LaisnError):
    """A film that cannot be made, and why."""


class RendererDiedError(RuntimeError):
    """A process that renders ended before its work was done; the text says how, and then its last words."""


def _job(
    flight: Flight,
    errors: Errors,
    video: Video | None,
    *,
    follower: int = 0,
    workers: int = 1,
    samples: int = 0,
    annotations: Annotations = NOTHING,
) -> Job:
    video = video or flight.scenario.video
    followers = flight.trajectory.names[1:]
    if video.camera not in CAMERAS:
        listed = "\n".join(f"  {name:<10}{what}" for name, what in CAMERAS.items())
        raise RenderError(f"unknown camera {video.camera!r}; available:\n{listed}")
    if video.width_px % 2 or video.height_px % 2 or min(video.width_px, video.height_px) < 2:
        raise RenderError(f"H.264 needs even numbers of pixels, got {video.width_px} × {video.height_px}")
    if not (np.isfinite(video.speed_up) and video.speed_up > 0):
        raise RenderError(f"speed_up = {video.speed_up:g} must be positive")
    if not 0 <= follower < len(followers):
        raise RenderError(f"follower {follower} does not exist; available: 0 … {len(followers) - 1}")
    if workers < 1:
        raise RenderError(f"workers = {workers} must be at least 1")
    measured = flight.measurements[follower]
    annotations.check(measured.speed.size, measured.message_step.size)
    return Job(
        flight=flight,
        errors=errors,
        video=video,
        follower=follower,
        workers=workers,
        samples=samples,
        annotations=annotations,
    )


def _check_file(path: Path, suffix: str) -> None:
    if path.suffix.lower() != suffix:
        raise RenderError(f"{path} should end in {suffix}")
    if path.is_dir():
        raise RenderError(f"{path} is a folder; give the file another name")
    if not path.resolve().parent.is_dir():
        raise RenderError(f"the folder {path.resolve().parent} does not exist")


@contextmanager
def _children(job: Job, programs: Sequence[tuple[str, ...]]) -> Iterator[tuple[Path, list[Any]]]:
    """A folder with the job, and a child for each of the programs; none outlives the block."""
    backend = graphics.working()
    if backend is None:
        raise RenderError(graphics.MISSING)
    threads = max(1, (os.cpu_count() or 1) // len(programs))
    children: list[Any] = []
    with TemporaryDirectory(prefix="laisn-") as name:
        folder = Path(name)
        (folder / "job").write_bytes(pickle.dumps(job, protocol=pickle.HIGHEST_PROTOCOL))
        try:
            ending = f"from sim.processes import exit_with_parent; exit_with_parent({os.getpid()})"
            for number, (program, *arguments) in enumerate(programs):
                words = (str(folder), *arguments)
                command, environment = graphics.child(f"{ending}; {program}", words, backend.name, threads)
                with (folder / f"{number}.log").open("wb") as log:
                    children.append(subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=log))
            yield folder, children
        finally:
            for child in children:
                child.kill()
                child.wait()
                child.stdout.close()


def _require_success(folder: Path, number: int, child: Any) -> None:
    code = child.wait()
    if code:
        words = (folder / f"{number}.log").read_text(errors="replace").strip().splitlines()[-_LAST_WORDS:]
        how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        raise RendererDiedError("\n".join([f"a process that renders frames {how}", *words]))


@contextmanager
def _rendered(job: Job, progress: Progress | None) -> Iterator[Path]:
    """A folder with all groups of pictures of the job, rendered by its children."""
    frames, done = job.times.size, 0
    workers = min(job.workers, job.groups)
    program = f"{_IMPORTS}; frame_renderer.main(Path(sys.argv[1]), int(sys.argv[2]))"
    with (
        _children(job, [(program, str(w)) for w in range(workers)]) as (folder, children),
        selectors.DefaultSelector() as selector,
    ):
        for number, child in enumerate(children):
            selector.register(child.stdout, selectors.EVENT_READ, number)
        while selector.get_map():
            for key, _ in selector.select():
                marks = os.read(key.fd, 4096)
                done += len(marks)
                if not marks:
                    selector.unregister(key.fileobj)
                    _require_success(folder, key.data, children[key.data])
                elif progress:
                    progress(done / frames)
        yield folder


def render(
    flight: Flight,
    path: Path,
    *,
    errors: Errors,
    video: Video | None = None,
    follower: int = 0,
    workers: int = 2,
    progress: Progress | None = None,
    annotations: Annotations = NOTHING,
) -> list[tuple[float, bytes]]:
    """Film a flight: H.264 in MP4, yuv420p, index first. The file appears when it is whole.

    Frames and bytes do not depend on the number of workers.

    Args:
        flight: the mission.
        path: of the film, ending in .mp4; overwritten.
        errors: E_P [m] and E_B [rad] of each follower at steps k = 1 … n, each of shape (n,).
        video: camera, size and speed; the scenario's if None.
        follower: index of the follower that the film keeps to.
        workers: processes that render.
        progress: called with the share done, in [0, 1].
        annotations: what a study adds to the frames.

    Returns:
        The film once more, as a log takes it: mission time [s] and H.264 access unit of each frame (Annex B, no
        B-frames, headers with every IDR frame).

    Raises:
        RenderError: a setting is impossible, or nothing renders here.
        RendererDiedError: a child died.
        ValueError: the annotations do not fit the flight.
    """
    job = _job(flight, errors, video, follower=follower, workers=workers, annotations=annotations)
    _check_file(path, ".mp4")
    with _rendered(job, progress) as folder:
        units = [unit for g in range(job.groups) for unit in pickle.loads(group_file(folder, g).read_bytes())]
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


def still(
    flight: Flight,
    time_s: float,
    path: Path,
    *,
    errors: Errors,
    video: Video | None = None,
    follower: int = 0,
    annotations: Annotations = NOTHING,
) -> None:
    """One frame of the film as PNG, with smoothed edges and without title.

    Args:
        flight: the mission.
        time_s: mission time of the frame.
        path: of the picture, ending in .png; overwritten.
        errors: as of `render`.
        video: camera and size; the scenario's if None.
        follower: index of the follower that the picture keeps to.
        annotations: as of `render`.

    Raises:
        RenderError: a setting is impossible, the time outside the mission, or nothing renders here.
        RendererDiedError: the child died.
        ValueError: the annotations do not fit the flight.
    """
    job = _job(flight, errors, video, follower=follower, samples=_STILL_SAMPLES, annotations=annotations)
    _check_file(path, ".png")
    start, end = float(flight.trajectory.time[0]), float(flight.trajectory.time[-1])
    if not start <= time_s <= end:
        raise RenderError(f"time {time_s:g} s lies outside the mission, {start:g} … {end:g} s")
    program = f"{_IMPORTS}; frame_renderer.main_still(Path(sys.argv[1]), float(sys.argv[2]))"
    with _children(job, [(program, repr(float(time_s)))]) as (folder, (child,)):
        _require_success(folder, 0, child)
        with atomic_write(path) as part:
            part.write_bytes((folder / "still.png").read_bytes())
