"""Film: content of frames, the stream, and messages where there is none."""

import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from sim.film import graphics, render
from sim.film.cameras import CameraRig
from sim.film.film_data import ESTIMATE, TRUTH, FilmData
from sim.film.render import GROUP, FilmJob
from sim.film.scene import WATER
from sim.scenario.settings import CAMERAS, Video
from tests.sim.film.filmed import small_video, with_estimate_moved_east

pytestmark = pytest.mark.system

needs_graphics = pytest.mark.skipif(
    graphics.working() is None, reason="no graphics library renders here: " + graphics.INSTALL
)


def job_of(flight, **video):
    return FilmJob(flight=flight, video=small_video(**video))


# settings that cannot be


def test_paths_and_times_that_cannot_be_rendered_are_refused(flight, tmp_path):
    job = job_of(flight)
    with pytest.raises(render.RenderError, match=r"should end in \.mp4"):
        render.render(job, tmp_path / "film.avi")
    with pytest.raises(render.RenderError, match=r"folder .* does not exist"):
        render.render(job, tmp_path / "nowhere" / "film.mp4")
    with pytest.raises(render.RenderError, match="outside the mission, 0 … 60 s"):
        render.still(job, 60.5, tmp_path / "still.png")


def test_without_graphics_one_message_reports_what_to_install(flight, tmp_path, monkeypatch):
    monkeypatch.setattr(graphics, "working", lambda: None)
    with pytest.raises(
        render.RenderError, match=r"no graphics library works here.*apt-get install"
    ) as raised:
        render.render(job_of(flight), tmp_path / "film.mp4")
    assert len(str(raised.value).splitlines()) == 1


# frames


def colour_near(image, pixel, radius=1):
    """Mean over pixels that lie inside a marker for any of its subpixel positions."""
    x, y = (round(float(v)) for v in pixel)
    return (
        np.asarray(image)[y - radius : y + radius + 1, x - radius : x + radius + 1]
        .reshape(-1, 3)
        .mean(axis=0)
    )


@needs_graphics
def test_a_still_shows_markers_where_the_vehicles_are_and_no_band_at_the_horizon(
    flight, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    shifted = with_estimate_moved_east(flight, 2.5)
    video, time_s = Video(), 40.0
    path = tmp_path / "still.png"
    render.still(FilmJob(flight=shifted, video=video), time_s, path)
    assert [p.name for p in tmp_path.iterdir()] == ["still.png"]
    image = Image.open(path)
    assert image.size == (1280, 720)
    data = FilmData(shifted, video.speed_up)
    state = data.at(time_s)
    view = CameraRig(data, 1280 / 720).shot("chase", state).view
    (truth,), _ = view.project(state.hydrophone, 1280, 720)
    (estimate,), _ = view.project(state.estimate, 1280, 720)
    np.testing.assert_allclose(colour_near(image, truth), 255 * np.array(TRUTH), atol=12)
    np.testing.assert_allclose(colour_near(image, estimate), 255 * np.array(ESTIMATE), atol=12)
    # open water between the panels: at the horizon the picture has the colour of the water, and
    # rows above and below fade into it without a step
    pixels = np.asarray(image).astype(float)
    eye = view.position
    horizon_point = eye + 1000.0 * view.axes[2] * [1, 1, 0] / np.hypot(*view.axes[2][:2])
    (horizon,), _ = view.project(horizon_point, 1280, 720)
    row = round(float(horizon[1]))
    # beside the rays and the trail: a stretch of columns where rows differ by waves and sand alone
    columns = pixels[:, 900:1020].mean(axis=1)
    np.testing.assert_allclose(columns[row], 255 * np.array(WATER), atol=8)
    largest_step = np.abs(np.diff(columns[row - 60 : row + 60], axis=0)).max()
    assert largest_step < 6
    assert pixels.std() > 10


@needs_graphics
def test_every_camera_gives_a_picture_and_the_same_one_every_time(flight, tmp_path):
    program = """
import dataclasses, pickle
import mujoco
import numpy as np
from sim.scenario.settings import CAMERAS
from contextlib import closing
from sim.film.render import FrameRenderer
from sim.film.scene import GlScene
job, shifted = pickle.load(open(sys.argv[1], "rb"))
pictures = {}
with closing(GlScene(job.flight, job.video)) as scene:
    for camera in CAMERAS:
        video = job.video.model_copy(update={"camera": camera})
        renderer = FrameRenderer(dataclasses.replace(shifted, video=video), scene)
        first = renderer.frame(20.0).copy()
        renderer.frame(35.0)
        # MuJoCo does not clear the memory of a scene: here it is filled with a geom of the follower
        hull = next(g for g in np.flatnonzero(scene._model.geom_bodyid == scene._vehicles[1].body)
                    if g not in scene._inside)
        for geom in scene._scene.geoms[:100]:
            geom.objtype, geom.objid, geom.transparent = mujoco.mjtObj.mjOBJ_GEOM.value, hull, 1
        assert np.array_equal(first, renderer.frame(20.0)), camera
        pictures[camera] = first
    # floor and surface move on by whole tiles as the camera travels, here after 11 s
    renderer = FrameRenderer(job, scene)
    frames = [renderer.frame(t)[..., :3].astype(int) for t in np.arange(5.0, 25.0, 0.6667)]
    pictures["steps"] = np.array([np.abs(b - a).mean() for a, b in zip(frames[:-1], frames[1:])])
np.savez(sys.argv[2], **pictures)
"""
    shifted = with_estimate_moved_east(flight, 2.5)
    jobs = [job_of(filmed) for filmed in (flight, shifted)]
    (tmp_path / "jobs").write_bytes(pickle.dumps(jobs))
    arguments = (str(tmp_path / "jobs"), str(tmp_path / "pictures.npz"))
    command, environment = graphics.child(program, graphics.working().name)
    subprocess.run([*command, *arguments], env=environment, check=True, timeout=120)
    with np.load(tmp_path / "pictures.npz") as pictures:
        steps = pictures["steps"]
        assert steps.max() < 1.5 * np.median(steps)
        for camera in CAMERAS:
            assert pictures[camera].shape == (180, 320, 4)
            assert pictures[camera][..., :3].std() > 5, camera


# films


SHORT_FILM = {"frame_rate_hz": 25, "speed_up": 48.0}
"""The shortest film of two groups of pictures."""


@pytest.fixture(scope="module")
def film(flight, tmp_path_factory):
    """A film by one worker, and its access units with their times."""
    path = tmp_path_factory.mktemp("film") / "one.mp4"
    return path, render.render(job_of(flight, **SHORT_FILM), path, workers=1)


@needs_graphics
def test_the_film_has_the_requested_format_for_any_number_of_workers(flight, film, tmp_path):
    progress_shares, (by_one_worker, _), by_two_workers = [], film, tmp_path / "two.mp4"
    render.render(
        job_of(flight, **SHORT_FILM), by_two_workers, workers=2, progress=progress_shares.append
    )
    assert by_one_worker.read_bytes() == by_two_workers.read_bytes()
    assert [p.name for folder in (by_one_worker.parent, tmp_path) for p in folder.iterdir()] == [
        "one.mp4",
        "two.mp4",
    ]
    assert progress_shares[-1] == 1.0
    assert progress_shares == sorted(progress_shares)
    data = by_two_workers.read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat")
    with av.open(str(by_two_workers)) as container:
        stream = container.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.codec_context.width, stream.codec_context.height) == (320, 180)
        assert stream.average_rate == 25
        frames = list(container.decode(stream))
    # 60 s of mission in 1.25 s of film, rounded
    assert len(frames) == 31
    assert [round(f.time * 25) for f in frames] == list(range(31))
    assert [f.key_frame for f in frames] == [i % GROUP == 0 for i in range(31)]
    first, last = (f.to_ndarray(format="rgb24").astype(float) for f in (frames[0], frames[-1]))
    assert np.abs(first - last).mean() > 1


@needs_graphics
def test_access_units_are_annex_b_with_headers_at_every_key_frame(film):
    _, units = film
    assert [t for t, _ in units] == pytest.approx(np.arange(31) * 1.92)
    decoder = av.CodecContext.create("h264", "r")
    decoder.thread_type = "SLICE"  # threads by frame would hold frames back
    for i, (_, unit) in enumerate(units):
        assert unit.startswith(b"\x00\x00\x00\x01")
        nal_types = [
            nal_unit[0] & 31
            for nal_unit in unit.replace(b"\x00\x00\x00\x01", b"\x00\x00\x01").split(
                b"\x00\x00\x01"
            )[1:]
        ]
        # 7, 8: parameter sets; 5: IDR; 1: other picture (ITU-T H.264, Table 7-1)
        assert (
            (7 in nal_types and 8 in nal_types and 5 in nal_types)
            if i % GROUP == 0
            else nal_types[-1] == 1
        )
        # one frame for each unit, without waiting for a later one
        assert len(decoder.decode(av.Packet(unit))) == 1


@needs_graphics
def test_a_child_that_dies_leaves_no_film_and_its_last_words(flight, tmp_path, monkeypatch):
    # the child fails before it has loaded the renderer, which takes a second
    monkeypatch.setattr(render, "_IMPORTS", "raise ZeroDivisionError('in the child')")
    with pytest.raises(
        render.RendererDiedError, match=r"(?s)ended with code 1\n.*ZeroDivisionError: in the child$"
    ):
        render.render(job_of(flight), tmp_path / "film.mp4", workers=1)
    assert list(tmp_path.iterdir()) == []


@needs_graphics
def test_an_interrupt_leaves_no_film_and_no_children(tmp_path):
    program = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[3])!r})
from pathlib import Path
from tests.synthetic import make_flight
from sim.film import render
from sim.film.render import FilmJob
from sim.scenario.settings import Video
# a child that reports, never ends and has nothing to load; its job is more than a pipe holds
render._IMPORTS = "import os, pickle, sys, time; render = time; render.main = lambda *_: " + \
    "(sys.stdin.buffer.read(), os.write(1, pickle.dumps((0, []))), time.sleep(60))"
flight = make_flight(10.0)
def progress(share):
    print("going", flush=True)
job = FilmJob(flight=flight, video=Video(speed_up=1.0))
render.render(job, Path({str(tmp_path / "film.mp4")!r}), workers=1, progress=progress)
"""
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    parent = subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=environment,
        start_new_session=True,
    )
    assert parent.stdout is not None
    assert parent.stdout.readline() == b"going\n"
    os.kill(parent.pid, signal.SIGINT)
    assert parent.wait(timeout=20) != 0
    parent.stdout.close()
    for _ in range(50):
        try:
            os.killpg(parent.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.1)
    else:
        pytest.fail("children outlive the film")
    assert list(tmp_path.iterdir()) == []
