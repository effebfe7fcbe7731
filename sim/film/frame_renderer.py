"""The child process of a film: renders its share of the frames and encodes them in closed groups of pictures."""

import os
import pickle
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from laisn.arrays import Bytes, Floats
from sim.assembly import models_of, ocean_of
from sim.film.annotations import NOTHING, Annotations
from sim.film.cameras import CameraRig
from sim.film.film_data import FilmData
from sim.film.overlay import Overlay
from sim.film.scene import GlScene
from sim.flight import Flight
from sim.scenario.settings import Video

GROUP = 30
"""Frames of a group of pictures. Each begins with an IDR frame and is encoded by itself, by whichever child."""

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
    """What all children of one film have in common."""

    flight: Flight
    errors: Sequence[tuple[Floats, Floats]]
    video: Video
    follower: int
    workers: int
    samples: int
    """Samples of each pixel for the anti-aliasing, 0 for none."""
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
    """Scene, cameras and overlay of one film, put together.

    Args:
        job: the film.
        scene: the open scene.
    """

    def __init__(self, job: Job, scene: GlScene) -> None:
        video = job.video
        size = (video.width_px, video.height_px)
        self._data = FilmData(job.flight, job.errors, video.speed_up)
        self._cameras = CameraRig(self._data, job.follower, size[0] / size[1])
        film_s = job.times.size / video.frame_rate_hz
        self._overlay = Overlay(self._data, job.follower, size, film_s, job.annotations)
        self._scene, self._camera = scene, video.camera

    def frame(self, time: float, title: bool = True) -> Bytes:
        """The frame at mission time `time` [s], top row first, shape (height, width, 4); reused at every call."""
        state = self._data.at(time)
        shot = self._cameras.shot(self._camera, state)
        self._overlay.canvas.load(self._scene.picture(state, shot, self._overlay.inset_boxes(shot)))
        self._overlay.draw(state, shot, title)
        return self._overlay.canvas.pixels


def open_scene(job: Job) -> GlScene:
    """The scene for a job, in this process."""
    size, scenario = (job.video.width_px, job.video.height_px), job.flight.scenario
    return GlScene(job.flight.trajectory.names, models_of(scenario), ocean_of(scenario), size, job.samples)


def encode(frames: Iterable[Bytes], video: Video) -> Iterator[bytes]:
    """Encode one group of pictures.

    Args:
        frames: shape (height, width, 4) each.
        video: size and frame rate.

    Returns:
        H.264 access units, one for each frame: Annex B, no B-frames, ITU-R BT.709 in limited range.
    """
    # codecs are for children: whoever starts them imports this file too
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
        picture = reformatter.reformat(
            av.VideoFrame.from_ndarray(pixels, format="rgba"),
            format="yuv420p",
            dst_colorspace=_BT709,
            dst_color_range=_LIMITED,
        )
        picture.pts, picture.time_base = number, codec.time_base
        yield from (bytes(packet) for packet in codec.encode(picture))
    yield from (bytes(packet) for packet in codec.encode(None))


def group_file(folder: Path, group: int) -> Path:
    """File that holds the access units of a group of pictures."""
    return folder / f"{group:06d}.units"


def main(folder: Path, worker: int) -> None:
    """Render and encode the groups worker, worker + workers … of the job in `folder`, with a byte to stdout a frame."""
    job: Job = pickle.loads((folder / "job").read_bytes())
    times = job.times

    def frames(renderer: FrameRenderer, group: int) -> Iterator[Bytes]:
        for time in times[group * GROUP : (group + 1) * GROUP]:
            yield renderer.frame(float(time))
            # a parent that is gone ends the child here
            os.write(sys.stdout.fileno(), b".")

    with open_scene(job) as scene:
        renderer = FrameRenderer(job, scene)
        for group in range(worker, job.groups, job.workers):
            units = list(encode(frames(renderer, group), job.video))
            # the name appears when the content is whole
            part = folder / f"{worker}.part"
            part.write_bytes(pickle.dumps(units))
            part.replace(group_file(folder, group))


def main_still(folder: Path, time: float) -> None:
    """Render one frame of the job in `folder` into its file "still.png"."""
    job: Job = pickle.loads((folder / "job").read_bytes())
    with open_scene(job) as scene:
        pixels = FrameRenderer(job, scene).frame(time, title=False)
        Image.fromarray(pixels).convert("RGB").save(folder / "still.png")
