"""Flight -> film. Frames are rendered and encoded by child processes, so that no graphics library is needed here."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from joblib.externals.loky import ProcessPoolExecutor
from PIL import Image

from laisn.arrays import Bytes, Floats
from laisn.failure import LaisnError
from sim.film import graphics
from sim.film.cameras import CameraRig
from sim.film.film_data import FilmData
from sim.film.overlay import Overlay
from sim.film.scene import GlScene
from sim.flight import Flight
from sim.scenario.settings import Video
from sim.system import atomic_write, exit_with_parent

GROUP = 30  # frames of a group of pictures. Each begins with an IDR frame and is encoded by itself, by whichever child

_X264 = {
    "preset": "ultrafast",
    "crf": "23",
    "bf": "0",
    "g": str(GROUP),
    # children are the parallelism; headers with every IDR frame let a reader start there
    "threads": "1",
    # what the preset leaves out and costs little: smooth borders of blocks, and transforms that suit a smooth sea
    "x264-params": f"repeat-headers=1:annexb=1:scenecut=0:keyint={GROUP}:min-keyint={GROUP}:deblock=0,0:8x8dct=1",
}
_BT709 = 1
_LIMITED = 1


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is filmed."""

    flight: Flight
    video: Video
    follower: int = 0  # index of the follower that the film keeps to

    @property
    def times(self) -> Floats:
        """Mission time of each frame, shape (frames,), [s]."""
        time, video = self.flight.trajectory.time, self.video
        frames = max(1, round(float(time[-1] - time[0]) / video.speed_up * video.frame_rate_hz))
        return np.asarray(time[0] + np.arange(frames) * video.speed_up / video.frame_rate_hz)

    @property
    def groups(self) -> int:
        """Number of groups of pictures."""
        return -(-self.times.size // GROUP)


class FrameRenderer:
    """Scene, cameras and overlay of one film, put together."""

    def __init__(self, job: Job, scene: GlScene) -> None:
        video = job.video
        self._data = FilmData(job.flight, video.speed_up, job.follower)
        self._cameras = CameraRig(self._data, video.width_px / video.height_px)
        self._overlay = Overlay(self._data, video)
        self._scene, self._camera = scene, video.camera

    def frame(self, time: float) -> Bytes:
        """The frame at mission time `time` [s], top row first, shape (height, width, 4); reused at every call."""
        state = self._data.at(time)
        shot = self._cameras.shot(self._camera, state)
        self._overlay.canvas.load(self._scene.picture(state, shot, self._overlay.inset_boxes(shot)))
        self._overlay.draw(state, shot)
        return self._overlay.canvas.pixels


def encode(frames: Iterable[Bytes], video: Video) -> Iterator[bytes]:
    """H.264 access units of a group of pictures, frames of shape (height, width, 4).

    Annex B, no B-frames, ITU-R BT.709 in limited range.
    """
    # codecs take a tenth of a second to load, and stills need none
    import av
    from av.video.reformatter import VideoReformatter

    codec: Any = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt = video.width_px, video.height_px, "yuv420p"
    codec.framerate = Fraction(video.frame_rate_hz)
    codec.time_base = 1 / codec.framerate
    codec.colorspace = codec.color_primaries = codec.color_trc = _BT709
    codec.color_range = _LIMITED
    codec.options = _X264
    # one for all frames: a new one costs a millisecond
    reformatter = VideoReformatter()
    for number, pixels in enumerate(frames):
        frame = av.VideoFrame.from_ndarray(pixels, format="rgba")
        picture = reformatter.reformat(frame, format="yuv420p", dst_colorspace=_BT709, dst_color_range=_LIMITED)
        picture.pts, picture.time_base = number, codec.time_base
        yield from (bytes(packet) for packet in codec.encode(picture))
    yield from (bytes(packet) for packet in codec.encode(None))


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
