"""Flight -> film. Frames are rendered and encoded by child processes; their parent loads no
graphics library.
"""

import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryFile
from threading import Thread
from typing import IO, Any, Literal

import numpy as np
from PIL import Image

from laisn.arrays import Bytes, Floats
from laisn.errors import LaisnError
from sim.film import graphics
from sim.film.cameras import CameraRig, OwnCamera
from sim.film.film_data import NOTHING, Annotations, FilmData
from sim.film.overlay import Overlay
from sim.film.scene import GlScene
from sim.flight import FlightRecord
from sim.scenario.settings import Video
from sim.system import atomic_write

_IMPORTS = "from sim.film import render"  # first line of the program that a child process runs
_LAST_WORDS = 12  # lines of the output of a child that died, in the error
# frames of a group of pictures. Each begins with an IDR frame and is encoded by itself, by
# whichever child
GROUP = 30

_X264 = {
    # takes three fifths of the time of "veryfast" at 22, at the same signal-to-noise ratio, for a
    # fifth more bytes
    "preset": "superfast",
    "crf": "24",
    "bf": "0",
    "g": str(GROUP),
    # children are the parallelism; headers with every IDR frame let a reader start there
    "threads": "1",
    "x264-params": f"repeat-headers=1:annexb=1:scenecut=0:keyint={GROUP}:min-keyint={GROUP}",
}
_BT709 = _LIMITED = 1  # as FFmpeg numbers colour spaces and ranges
LOG_WIDTH_PX = 640
"""Most width of the film that a log holds."""
Background = Literal["sea", "white", "transparent"]
NOT_TRANSPARENT = "a film cannot be transparent: expected sea or white, or a picture"


class RenderError(LaisnError):
    """A film that cannot be made, and why."""


class RendererDiedError(RuntimeError):
    """A process that renders ended before its work was done; the text states how, and its last
    output.
    """


@dataclass(frozen=True, kw_only=True)
class FilmJob:
    """What is filmed."""

    flight: FlightRecord
    video: Video
    follower: int = 0  # index of the follower that the film keeps to
    annotations: Annotations = NOTHING
    camera: OwnCamera | None = None  # in place of that of `video`
    plain: bool = False  # without panels, insets and words
    background: Background = "sea"
    """What is behind the hulls; only a picture can be transparent."""

    @property
    def times(self) -> Floats:
        """Mission time of each frame, shape (frames,), [s]."""
        time = self.flight.trajectory.time
        video = self.video
        frames = max(1, round(float(time[-1] - time[0]) / video.speed_up * video.frame_rate_hz))
        return np.asarray(time[0] + np.arange(frames) * video.speed_up / video.frame_rate_hz)

    @property
    def groups(self) -> int:
        """Number of groups of pictures."""
        return -(-self.times.size // GROUP)


class FrameRenderer:
    """Scene, cameras and overlay of one film, put together."""

    def __init__(self, job: FilmJob, scene: GlScene) -> None:
        video = job.video
        self._data = FilmData(job.flight, video.speed_up, job.follower, job.annotations)
        self._job = job
        self._cameras = CameraRig(self._data, video.width_px / video.height_px)
        self._overlay = Overlay(self._data, video, plain=job.plain)
        self._scene = scene
        self._camera = video.camera

    def frame(self, time: float) -> Bytes:
        """The frame at mission time `time` [s], top row first, shape (height, width, 4); reused
        at every call.
        """
        if self._job.background == "sea":
            return self._frame(time, None)
        white = self._frame(time, 1.0)
        if self._job.background == "white":
            return white
        return cut_out(white.copy(), self._frame(time, 0.0))

    def _frame(self, time: float, background_grey: float | None) -> Bytes:
        """The frame before a background of one grey, from 0 to 1, or, with None, in the sea."""
        state = self._data.at(time)
        custom_camera = self._job.camera
        shot = (
            custom_camera.shot(state) if custom_camera else self._cameras.shot(self._camera, state)
        )
        if self._job.plain:
            shot = shot._replace(insets=())
        boxes = self._overlay.inset_boxes(shot)
        self._overlay.canvas.load(self._scene.picture(state, shot, boxes, background_grey))
        self._overlay.draw(state, shot)
        return self._overlay.canvas.pixels


def cut_out(white: Bytes, black: Bytes) -> Bytes:
    """The picture without its background, with its opacity, by the same one before a white and
    before a black background, all of shape (height, width, 4).
    """
    before_white = white[..., :3].astype(np.float64)
    before_black = black[..., :3].astype(np.float64)
    opacity = 1.0 - np.clip((before_white - before_black).mean(axis=-1) / 255.0, 0.0, 1.0)
    colour = before_black / np.maximum(opacity, 1e-6)[..., None]
    picture = np.empty_like(white)
    picture[..., :3] = np.clip(colour, 0.0, 255.0).round()
    picture[..., 3] = (255.0 * opacity).round()
    return picture


class _Encoder:
    """Frames into H.264 access units: Annex B, no B-frames, ITU-R BT.709 in limited range."""

    def __init__(self, width: int, height: int, rate_hz: int) -> None:
        """Encode pictures of a size [px], to which frames are scaled."""
        # codecs take a tenth of a second to load, and the parent of children needs none
        import av
        from av.video.reformatter import VideoReformatter

        self._codec: Any = av.CodecContext.create("libx264", "w")
        self._codec.width = width
        self._codec.height = height
        self._codec.pix_fmt = "yuv420p"
        self._codec.framerate = Fraction(rate_hz)
        self._codec.time_base = 1 / self._codec.framerate
        self._codec.colorspace = self._codec.color_primaries = self._codec.color_trc = _BT709
        self._codec.color_range = _LIMITED
        self._codec.options = _X264
        # one for all frames: a new one costs a millisecond
        self._reformatter = VideoReformatter()
        self._count = 0
        self.units = list[bytes]()
        """Access units of the frames until now."""

    def add(self, frame: Any) -> None:
        """Encode an `av.VideoFrame`."""
        picture = self._reformatter.reformat(
            frame,
            width=self._codec.width,
            height=self._codec.height,
            format="yuv420p",
            dst_colorspace=_BT709,
            dst_color_range=_LIMITED,
        )
        picture.pts = self._count
        picture.time_base = self._codec.time_base
        self._count += 1
        self.units += [bytes(packet) for packet in self._codec.encode(picture)]

    def end(self) -> None:
        """Encode what is still held back."""
        self.units += [bytes(packet) for packet in self._codec.encode(None)]


def log_size(video: Video) -> tuple[int, int]:
    """Width and height of the film that a log holds [px]."""
    width = min(video.width_px, LOG_WIDTH_PX)
    return width, max(2, 2 * round(0.5 * width * video.height_px / video.width_px))


def encode(frames: Iterable[Bytes], video: Video) -> list[list[bytes]]:
    """H.264 access units of frames, shape (height, width, 4), and, if the log is to hold a film,
    of the same frames in the size of `log_size`.
    """
    # as in `_Encoder`
    import av

    sizes = [(video.width_px, video.height_px)]
    if video.in_log:
        sizes.append(log_size(video))
    encoders = [_Encoder(*size, video.frame_rate_hz) for size in sizes]
    for pixels in frames:
        # the frame itself and no copy: encoders take it over before the next one is drawn
        frame = av.VideoFrame.from_numpy_buffer(pixels, format="rgba")
        for encoder in encoders:
            encoder.add(frame)
    for encoder in encoders:
        encoder.end()
    return [encoder.units for encoder in encoders]


def _send(results: Callable[[FilmJob, Callable[[float], Bytes]], Iterable[object]]) -> None:
    """Compute results from the job, pickled on standard input, and its frames; pickle them to
    standard output.
    """
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    # what a library prints must not stand between results
    os.dup2(2, 1)
    job = pickle.load(sys.stdin.buffer)
    with closing(GlScene(job.flight, job.video)) as scene:
        renderer = FrameRenderer(job, scene)
        # what is there stays there: searches for garbage need not pass it with every frame
        gc.freeze()
        for result in results(job, renderer.frame):
            pickle.dump(result, output)


def main(worker: int, workers: int) -> None:
    """Render and encode the groups worker, worker + workers … of the job; results are (group,
    access units as of `encode`).
    """

    def groups(
        job: FilmJob, frame: Callable[[float], Bytes]
    ) -> Iterator[tuple[int, list[list[bytes]]]]:
        for group in range(worker, job.groups, workers):
            times = job.times[group * GROUP : (group + 1) * GROUP].tolist()
            yield group, encode(map(frame, times), job.video)

    _send(groups)


def main_still(time: float) -> None:
    """Render one frame of the job; the result is its pixels, shape (height, width, 4)."""
    _send(lambda _, frame: [frame(time)])


def _check_file(path: Path, suffix: str) -> None:
    if path.suffix.lower() != suffix:
        raise RenderError(f"{path} should end in {suffix}")
    if path.is_dir():
        raise RenderError(f"{path} is a folder; give the file another name")
    if not path.resolve().parent.is_dir():
        raise RenderError(f"the folder {path.resolve().parent} does not exist")


def _results(job: FilmJob, programs: Sequence[str]) -> Generator[Any, None, None]:
    """Results of child processes as they arrive, each of which calls one of `programs`, such as
    "main(0, 2)"; none outlives the generator. RendererDiedError: one died.
    """
    backend = graphics.working()
    if backend is None:
        raise RenderError(graphics.MISSING)
    threads = max(1, (os.cpu_count() or 1) // len(programs))
    content = pickle.dumps(job, protocol=pickle.HIGHEST_PROTOCOL)
    start = f"from sim.system import exit_with_parent; exit_with_parent({os.getpid()}); {_IMPORTS}"
    results: SimpleQueue[Any] = SimpleQueue()
    children = list[Any]()
    readers = list[Thread]()
    try:
        for program in programs:
            command, environment = graphics.child(
                f"{start}; render.{program}", backend.name, threads
            )
            log = TemporaryFile()  # noqa: SIM115 (the reader closes it)
            pipe = subprocess.PIPE
            children.append(
                subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, stderr=log)
            )
            readers.append(
                Thread(target=_read, args=(children[-1], log, content, results), daemon=True)
            )
            readers[-1].start()
        for _ in children:
            while (result := results.get()) is not None:
                if isinstance(result, RendererDiedError):
                    raise result
                yield result
    finally:
        for child in children:
            child.kill()
        for reader in readers:
            reader.join()


def _read(child: Any, log: IO[bytes], content: bytes, results: SimpleQueue[Any]) -> None:
    """Send a child its job and collect its results, then None or, if it failed, an error with
    the end of its log.
    """
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
        ending = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
        message = "\n".join([f"a process that renders frames {ending}", *words])
        results.put(RendererDiedError(message) if code else None)


def render(
    job: FilmJob, path: Path, *, workers: int = 2, progress: Callable[[float], None] | None = None
) -> list[tuple[float, bytes]]:
    """Film a flight: H.264 in MP4, yuv420p, index first. The file appears when it is whole.

    Frames and bytes do not depend on the number of workers.

    Args:
        job: what is filmed.
        path: of the film, ending in .mp4; overwritten.
        workers: processes that render.
        progress: called with the share done, in [0, 1].

    Returns:
        The film as a log takes it: mission time [s] and H.264 access unit of each frame, in the
        size of `log_size` if the log is to hold a film, else as in the file.

    Raises:
        RenderError: a setting is impossible, or nothing renders here.
        RendererDiedError: a child died.
    """
    _check_file(path, ".mp4")
    if job.background == "transparent":
        raise RenderError(NOT_TRANSPARENT)
    workers = min(workers, job.groups)
    groups: dict[int, list[list[bytes]]] = {}
    with closing(
        _results(job, [f"main({worker}, {workers})" for worker in range(workers)])
    ) as results:
        for group, packets in results:
            groups[group] = packets
            if progress:
                progress(len(groups) / job.groups)
    film, *small = (
        [unit for group in range(job.groups) for unit in groups[group][size]]
        for size in range(len(groups[0]))
    )
    with atomic_write(path) as temporary:
        _write_mp4(temporary, film, job.video)
    return list(zip(job.times.tolist(), small[0] if small else film, strict=True))


def _write_mp4(path: Path, units: Sequence[bytes], video: Video) -> None:
    """Wrap access units as they are: one for each frame, in order."""
    import av  # as in `encode`

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
            packet.stream = stream
            packet.time_base = step
            packet.pts = packet.dts = number
            packet.duration = 1
            packet.is_keyframe = number % GROUP == 0
            target.mux(packet)


def still(job: FilmJob, time_s: float, path: Path) -> None:
    """The frame at a mission time [s] as a file that ends in .png; an existing one is overwritten.

    Raises:
        RenderError: a setting is impossible, the time outside the mission, or nothing renders here.
        RendererDiedError: the child died.
    """
    _check_file(path, ".png")
    start = float(job.flight.trajectory.time[0])
    end = float(job.flight.trajectory.time[-1])
    if not start <= time_s <= end:
        raise RenderError(f"time {time_s:g} s lies outside the mission, {start:g} … {end:g} s")
    with closing(_results(job, [f"main_still({float(time_s)!r})"])) as results:
        (pixels,) = results
    with atomic_write(path) as temporary:
        mode = "RGBA" if job.background == "transparent" else "RGB"
        Image.fromarray(pixels).convert(mode).save(temporary, format="png")
