"""The child process of a film: renders its share of the frames and encodes them in closed groups of pictures."""

import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from laisn.arrays import Bytes, Floats
from sim.film.cameras import CameraRig
from sim.film.film_data import NOTHING, Annotations, FilmData
from sim.film.overlay import Overlay
from sim.film.scene import GlScene
from sim.flight import Flight
from sim.scenario.settings import Video

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
    annotations: Annotations = NOTHING

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
        self._data = FilmData(job.flight, video.speed_up, job.follower, job.annotations)
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
    # codecs are for children; their parent process imports this file too
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


def main(worker: int, workers: int) -> None:
    """Render and encode the groups worker, worker + workers … of the job; results are (group, access units)."""
    job, send = _connect()
    with closing(GlScene(job.flight, job.video)) as scene:
        renderer = FrameRenderer(job, scene)
        for group in range(worker, job.groups, workers):
            frames = (renderer.frame(float(time)) for time in job.times[group * GROUP : (group + 1) * GROUP])
            send((group, list(encode(frames, job.video))))


def main_still(time: float) -> None:
    """Render one frame of the job; the result is its pixels, shape (height, width, 4)."""
    job, send = _connect()
    with closing(GlScene(job.flight, job.video)) as scene:
        send(FrameRenderer(job, scene).frame(time))


def _connect() -> tuple[Job, Callable[[object], None]]:
    """The job, pickled on standard input, and a function that pickles results to standard output."""
    output = os.fdopen(os.dup(1), "wb", buffering=0)
    # what a library prints must not stand between results
    os.dup2(2, 1)
    return pickle.load(sys.stdin.buffer), lambda result: pickle.dump(result, output)
