"""The child process of a film: renders its share of the frames and encodes them in closed groups of pictures."""

import os
import pickle
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from laisn.arrays import Bytes, Floats
from sim.assembly import models_of, ocean_of
from sim.film import pixels
from sim.film.annotations import NOTHING, Annotations
from sim.film.cameras import Director
from sim.film.footage import Footage
from sim.film.overlay import Overlay
from sim.film.scene import Stage
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


class Studio:
    """Stage, cameras and overlay of one film, put together; a context manager through its stage.

    Args:
        job: the film.
        stage: the open stage.
    """

    def __init__(self, job: Job, stage: Stage) -> None:
        video = job.video
        size = (video.width_px, video.height_px)
        self._footage = Footage(job.flight, job.errors, video.speed_up)
        self._director = Director(self._footage, job.follower, size[0] / size[1])
        film_s = job.times.size / video.frame_rate_hz
        self._overlay = Overlay(self._footage, job.follower, size, film_s, job.annotations)
        self._stage, self._camera = stage, video.camera

    def frame(self, time: float, title: bool = True) -> Bytes:
        """The frame at `time` [s] of the mission, top row first, shape (height, width, 4); reused at every call."""
        moment = self._footage.at(time)
        shot = self._director.shot(self._camera, moment)
        picture = self._stage.picture(moment, shot, self._overlay.inset_boxes(shot))
        self._overlay.canvas.load(picture)
        self._overlay.draw(moment, shot, title)
        return self._overlay.canvas.pixels


def open_stage(job: Job) -> Stage:
    """The stage for a job, in this process."""
    size = (job.video.width_px, job.video.height_px)
    scenario = job.flight.scenario
    return Stage(job.flight.trajectory.names, models_of(scenario), ocean_of(scenario), size, job.samples)


def encoder(video: Video) -> Any:
    """An H.264 encoder for one group of pictures: Annex B, no B-frames, a packet for each frame."""
    # codecs are for children: whoever starts them imports this file too
    import av

    codec = av.CodecContext.create("libx264", "w")
    codec.width, codec.height, codec.pix_fmt = video.width_px, video.height_px, "yuv420p"
    codec.time_base = Fraction(1, video.frame_rate_hz)
    codec.framerate = Fraction(video.frame_rate_hz)
    codec.colorspace = codec.color_primaries = codec.color_trc = _BT709
    codec.color_range = _LIMITED
    codec.options = _X264
    return codec


def encode(frames: Iterator[Bytes], video: Video) -> Iterator[bytes]:
    """Access units of one group of pictures, in Annex B form, one for each frame."""
    # as in `encoder`
    import av

    codec = encoder(video)
    planes = np.empty((video.height_px * 3 // 2, video.width_px), np.uint8)
    for number, shown in enumerate(frames):
        pixels.to_yuv420(shown, planes)
        picture = av.VideoFrame.from_ndarray(planes, format="yuv420p")
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

    def frames(studio: Studio, group: int) -> Iterator[Bytes]:
        for time in times[group * GROUP : (group + 1) * GROUP]:
            yield studio.frame(float(time))
            # a parent that is gone ends the child here
            os.write(sys.stdout.fileno(), b".")

    with open_stage(job) as stage:
        studio = Studio(job, stage)
        for group in range(worker, job.groups, job.workers):
            units = list(encode(frames(studio, group), job.video))
            # the name appears when the content is whole
            part = folder / f"{worker}.part"
            part.write_bytes(pickle.dumps(units))
            part.replace(group_file(folder, group))


def main_still(folder: Path, time: float) -> None:
    """Render one frame of the job in `folder` into its file "still.png"."""
    job: Job = pickle.loads((folder / "job").read_bytes())
    with open_stage(job) as stage:
        shown = Studio(job, stage).frame(time, title=False)
        Image.fromarray(shown).convert("RGB").save(folder / "still.png")
