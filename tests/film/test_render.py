"""Film: geometry of the cameras, what the frames show, and the stream that comes out."""

import dataclasses
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
from synthetic import make_flight

from sim.assembly import ocean_of
from sim.film import graphics, render
from sim.film.cameras import Director, View
from sim.film.footage import Footage
from sim.film.overlay import TRUTH
from sim.film.scene import ESTIMATE
from sim.film.seascape import _RIPPLES, WATER, Sea
from sim.film.studio import GROUP, Job
from sim.scenario.settings import Video, Waves
from sim.scenario.video import CAMERAS

needs_graphics = pytest.mark.skipif(
    graphics.working() is None, reason="no graphics library renders here: " + graphics.INSTALL
)


def errors_of(flight):
    """E_P from its definition; E_B plays no role in what is tested."""
    return [
        (np.linalg.norm(e.state[:, :2] - flight.hydrophone(i)[:, :2], axis=1), np.zeros(len(e.state)))
        for i, e in enumerate(flight.estimates)
    ]


def small(**changes):
    return Video(**({"width_px": 320, "height_px": 180, "speed_up": 20.0} | changes))


@pytest.fixture(scope="module")
def flight():
    return make_flight(60.0)


def apart(flight, metres):
    """A flight whose estimate is moved east by so many metres."""
    estimates = tuple(
        dataclasses.replace(e, state=e.state + np.array([metres, 0, 0, 0]), covariance=e.covariance.copy())
        for e in flight.estimates
    )
    return dataclasses.replace(flight, estimates=estimates)


# geometry


def test_projection_is_that_of_a_pinhole():
    # looking east from the origin, 90° vertically: a point 10 m ahead, 2 m to the right (south), 1 m up
    view = View(position=np.zeros(3), target=np.array([1.0, 0, 0]), fovy_deg=90.0)
    pixels, ahead = view.project(np.array([[10.0, -2.0, 1.0]]), 400, 200)
    np.testing.assert_allclose(pixels, [[200 + 100 * 0.2, 100 - 100 * 0.1]])
    np.testing.assert_allclose(ahead, [10.0])


def test_a_line_is_cut_at_the_lens():
    view = View(position=np.zeros(3), target=np.array([1.0, 0, 0]), fovy_deg=90.0)
    ((pixels, ahead, place),) = view.line(np.array([[-5.0, 1.0, 0.0], [5.0, 1.0, 0.0]]), 200, 200)
    assert ahead.min() > 0
    np.testing.assert_allclose(place[-1], 1.0)
    # at the far end: 1 m to the left at 5 m
    np.testing.assert_allclose(pixels[-1], [100 - 100 / 5, 100])
    assert view.line(np.array([[-5.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]), 200, 200) == []


def test_a_camera_cannot_stand_on_its_target():
    with pytest.raises(ValueError, match="cannot look at itself"):
        View(position=np.ones(3), target=np.ones(3))


@pytest.mark.parametrize("camera", ["chase", "top", "pip", "side", "profile", "orbit"])
def test_cameras_keep_leader_and_follower_in_the_frame(flight, camera):
    footage = Footage(flight, errors_of(flight), 20.0)
    director = Director(footage, 0, 16 / 9)
    for t in np.linspace(0.0, 60.0, 25):
        moment = footage.at(t)
        shot = director.shot(camera, moment)
        pixels, ahead = shot.view.project(moment.position, 1280, 720)
        assert (ahead > 0.5).all()
        assert (pixels >= 0).all()
        assert (pixels <= [1280, 720]).all()
        if shot.surface:
            assert shot.view.position[2] < 0


@pytest.mark.parametrize("aside", [-6.0, -3.0, 0.0, 3.0, 6.0])
def test_the_chasing_camera_keeps_the_estimate_clear_of_the_panels(flight, aside):
    """Seen towards the leader, the estimate lies to the right of the follower, or to the left."""
    away = flight.trajectory.position[flight.step_index(), 0] - flight.hydrophone(0)
    right = np.column_stack([away[:, 1], -away[:, 0]]) / np.hypot(away[:, 0], away[:, 1])[:, None]
    (found,) = flight.estimates
    state = found.state.copy()
    state[:, :2] = flight.hydrophone(0)[:, :2] + aside * right
    parted = dataclasses.replace(flight, estimates=(dataclasses.replace(found, state=state),))
    footage = Footage(parted, errors_of(parted), 20.0)
    director = Director(footage, 0, 16 / 9)
    for t in np.linspace(5.0, 55.0, 11):
        moment = footage.at(t)
        view = director.shot("chase", moment).view
        pixels, _ = view.project(np.stack([moment.hydrophone[0], moment.estimate[0]]), 1280, 720)
        # panels take the left, and the upper and lower right corners
        assert (pixels[:, 0] > 308).all()
        assert (pixels[:, 0] < 1032).all()
        assert (pixels[:, 1] < 700).all()


# footage


def test_a_moment_interpolates_truth_and_carries_the_estimate_on(flight):
    footage = Footage(flight, errors_of(flight), 20.0)
    moment = footage.at(30.05)
    np.testing.assert_allclose(moment.position, flight.trajectory.at(30.05)[0][0])
    np.testing.assert_allclose(moment.hydrophone[0], flight.trajectory.site_at("follower/hydrophone", 30.05)[0])
    x, y, vx, vy = flight.estimates[0].state[299]
    np.testing.assert_allclose(moment.estimate[0, :2], [x + 0.05 * vx, y + 0.05 * vy], atol=1e-9)
    assert moment.position_error[0] == footage.position_error[0, 299]
    assert np.isnan(footage.at(0.0).position_error[0])


def test_rays_are_one_at_the_ping_fade_and_are_absent_where_nothing_was_heard(flight):
    footage = Footage(flight, errors_of(flight), 1.0)
    np.testing.assert_allclose(footage.at(5.0).ray[0], 1.0)
    fading = [footage.at(5.0 + dt).ray[0, 0] for dt in (0.0, 0.3, 0.6, 0.9)]
    assert (np.diff(fading) < 0).all()
    assert fading[-1] < 0.2
    assert (footage.at(0.5).ray == 0).all()
    # the 13th message lacks the front range
    lost = footage.at(13.0)
    assert np.isnan(lost.ranges[0, 1])
    assert lost.ray[0, 1] == 0
    assert lost.ray[0, 0] == pytest.approx(1.0)


def test_rays_of_frequent_pings_do_not_flicker(flight):
    footage = Footage(flight, errors_of(flight), 20.0)
    strength = [footage.at(t).ray[0, 0] for t in np.arange(10.0, 40.0, 20 / 30)]
    assert np.ptp(strength) < 0.15


def test_trail_points_stay_in_place_while_time_goes_on(flight):
    footage = Footage(flight, errors_of(flight), 20.0)
    early, late = footage.trail(1, 30.0, 1.0), footage.trail(1, 30.7, 1.0)
    old = {tuple(p) for p in early[:-1]}
    assert len(old & {tuple(p) for p in late[:-1]}) >= len(old) - 1


def test_errors_of_the_wrong_shape_are_refused(flight):
    with pytest.raises(ValueError, match="600 steps"):
        Footage(flight, [(np.zeros(5), np.zeros(5))], 20.0)


def test_the_drawn_sea_is_the_simulated_sea():
    mission = make_flight(2.0).scenario
    waves = Waves(kind="regular", height_m=1.0, period_s=8.0, direction_deg=30.0)
    ocean = ocean_of(mission.model_copy(update={"ocean": mission.ocean.model_copy(update={"waves": waves})}))
    sea = Sea.__new__(Sea)
    sea._waves = ocean.wave_parameters
    sea._steepness = np.hypot(sea._waves[:, 1], sea._waves[:, 2])
    x, y = sea.grid(np.array([40.0, -7.0, 0.0]), 100.0)
    drawn = sea.elevation(x, y, 12.3, 0.7)
    ripples = np.sum(np.abs(_RIPPLES[:, 0]))
    assert np.abs(drawn - ocean.elevation(x[None, :], y[:, None], 12.3)).max() <= ripples + 1e-9
    assert np.ptp(drawn) > 0.9


# settings that cannot be


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"camera": "drone"}, "unknown camera 'drone'.*\n.*chase"),
        ({"speed_up": -1.0}, "speed_up = -1 must be positive"),
        ({"width_px": 321}, "even numbers of pixels"),
    ],
)
def test_impossible_settings_are_refused(flight, tmp_path, changes, words):
    video = Video.model_construct(**(small().model_dump() | changes))
    with pytest.raises(render.RenderError, match=words):
        render.render(flight, tmp_path / "film.mp4", errors=errors_of(flight), video=video)
    assert list(tmp_path.iterdir()) == []


def test_other_impossible_wishes_are_refused(flight, tmp_path):
    errors = errors_of(flight)
    with pytest.raises(render.RenderError, match=r"should end in \.mp4"):
        render.render(flight, tmp_path / "film.avi", errors=errors, video=small())
    with pytest.raises(render.RenderError, match=r"folder .* does not exist"):
        render.render(flight, tmp_path / "nowhere" / "film.mp4", errors=errors, video=small())
    with pytest.raises(render.RenderError, match="follower 1 does not exist"):
        render.render(flight, tmp_path / "film.mp4", errors=errors, video=small(), follower=1)
    with pytest.raises(render.RenderError, match="outside the mission, 0 … 60 s"):
        render.still(flight, 60.5, tmp_path / "still.png", errors=errors, video=small())


def test_without_graphics_one_message_says_what_to_install(flight, tmp_path, monkeypatch):
    monkeypatch.setattr(graphics, "working", lambda: None)
    with pytest.raises(render.RenderError, match=r"no graphics library works here.*apt-get install") as told:
        render.render(flight, tmp_path / "film.mp4", errors=errors_of(flight), video=small())
    assert len(str(told.value).splitlines()) == 1


# frames


def colour_near(image, place, radius=1):
    """Mean over pixels that lie inside a marker whatever its place between pixels."""
    x, y = (round(float(v)) for v in place)
    return np.asarray(image)[y - radius : y + radius + 1, x - radius : x + radius + 1].reshape(-1, 3).mean(axis=0)


@needs_graphics
def test_a_still_shows_markers_where_the_vehicles_are_and_no_band_at_the_horizon(flight, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shifted = apart(flight, 2.5)
    errors, video, when = errors_of(shifted), Video(), 40.0
    path = tmp_path / "still.png"
    render.still(shifted, when, path, errors=errors, video=video)
    assert [p.name for p in tmp_path.iterdir()] == ["still.png"]
    image = Image.open(path)
    assert image.size == (1280, 720)
    footage = Footage(shifted, errors, video.speed_up)
    moment = footage.at(when)
    view = Director(footage, 0, 1280 / 720).shot("chase", moment).view
    (truth,), _ = view.project(moment.hydrophone, 1280, 720)
    (belief,), _ = view.project(moment.estimate, 1280, 720)
    np.testing.assert_allclose(colour_near(image, truth), 255 * np.array(TRUTH), atol=12)
    np.testing.assert_allclose(colour_near(image, belief), 255 * np.array(ESTIMATE), atol=12)
    # open water between the panels: the level line has the colour of the water, and fades into it without a step
    pixels = np.asarray(image).astype(float)
    eye = view.position
    level = eye + 1000.0 * view.axes[2] * [1, 1, 0] / np.hypot(*view.axes[2][:2])
    (horizon,), _ = view.project(level, 1280, 720)
    row = round(float(horizon[1]))
    # beside the rays and the trail: a stretch of columns where rows differ by waves and sand alone
    columns = pixels[:, 900:1020].mean(axis=1)
    np.testing.assert_allclose(columns[row], 255 * np.array(WATER), atol=8)
    steps = np.abs(np.diff(columns[row - 60 : row + 60], axis=0)).max()
    assert steps < 6
    assert pixels.std() > 10


@needs_graphics
def test_every_camera_gives_a_picture_and_the_same_one_every_time(flight, tmp_path):
    program = """
import dataclasses, pickle
import numpy as np
from sim.scenario.video import CAMERAS
from sim.film.studio import Studio, open_stage
job = pickle.load(open(sys.argv[1], "rb"))
pictures = {}
with open_stage(job) as stage:
    for camera in CAMERAS:
        studio = Studio(dataclasses.replace(job, video=job.video.model_copy(update={"camera": camera})), stage)
        first = studio.frame(20.0).copy()
        studio.frame(35.0)
        assert np.array_equal(first, studio.frame(20.0)), camera
        pictures[camera] = first
    # floor and surface move on by whole tiles as the camera travels: that must not show
    studio = Studio(job, stage)
    frames = [studio.frame(t)[..., :3].astype(int) for t in np.arange(5.0, 55.0, 0.6667)]
    pictures["steps"] = np.array([np.abs(b - a).mean() for a, b in zip(frames[:-1], frames[1:])])
np.savez(sys.argv[2], **pictures)
"""
    job = Job(flight=flight, errors=errors_of(flight), video=small(), follower=0, workers=1, samples=0)
    (tmp_path / "job").write_bytes(pickle.dumps(job))
    arguments = (str(tmp_path / "job"), str(tmp_path / "pictures.npz"))
    command, environment = graphics.child(program, arguments, graphics.working().name)
    subprocess.run(command, env=environment, check=True, timeout=120)
    with np.load(tmp_path / "pictures.npz") as pictures:
        steps = pictures["steps"]
        assert steps.max() < 1.5 * np.median(steps)
        for camera in CAMERAS:
            assert pictures[camera].shape == (180, 320, 4)
            assert pictures[camera][..., :3].std() > 5, camera


# films


@needs_graphics
def test_the_film_is_what_was_asked_for_whatever_the_workers(flight, tmp_path):
    errors, shares = errors_of(flight), []
    video = small(frame_rate_hz=25, speed_up=40.0)
    one, two = tmp_path / "one.mp4", tmp_path / "two.mp4"
    render.render(flight, one, errors=errors, video=video, workers=1)
    render.render(flight, two, errors=errors, video=video, workers=2, progress=shares.append)
    assert one.read_bytes() == two.read_bytes()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.mp4", "two.mp4"]
    assert shares[-1] == 1.0
    assert shares == sorted(shares)
    data = two.read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat")
    with av.open(str(two)) as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert (stream.codec_context.width, stream.codec_context.height) == (320, 180)
        assert stream.average_rate == 25
        frames = list(film.decode(stream))
    # 60 s of mission in 1.5 s of film, rounded
    assert len(frames) == 38
    assert [round(f.time * 25) for f in frames] == list(range(38))
    assert [f.key_frame for f in frames] == [i % GROUP == 0 for i in range(38)]
    first, last = (f.to_ndarray(format="rgb24").astype(float) for f in (frames[0], frames[-1]))
    assert np.abs(first - last).mean() > 1


@needs_graphics
def test_access_units_are_annex_b_with_headers_at_every_key_frame(flight, tmp_path):
    video = small(frame_rate_hz=20, speed_up=30.0, width_px=160, height_px=120)
    units = render.render(flight, tmp_path / "f.mp4", errors=errors_of(flight), video=video, workers=1)
    assert [t for t, _ in units] == pytest.approx(np.arange(40) * 1.5)
    decoder = av.CodecContext.create("h264", "r")
    decoder.thread_type = "SLICE"  # threads by frame would hold frames back
    for i, (_, unit) in enumerate(units):
        assert unit.startswith(b"\x00\x00\x00\x01")
        kinds = [part[0] & 31 for part in unit.replace(b"\x00\x00\x00\x01", b"\x00\x00\x01").split(b"\x00\x00\x01")[1:]]
        # 7, 8: parameter sets; 5: IDR; 1: other picture (ITU-T H.264, Table 7-1)
        assert (7 in kinds and 8 in kinds and 5 in kinds) if i % GROUP == 0 else kinds[-1] == 1
        # one frame for each unit, without waiting for a later one
        assert len(decoder.decode(av.Packet(unit))) == 1


@needs_graphics
def test_a_child_that_dies_leaves_no_film_and_its_last_words(flight, tmp_path):
    # a wave field that the ocean refuses when the child builds it
    broken = flight.scenario.model_copy(
        update={"ocean": flight.scenario.ocean.model_copy(update={"waves": Waves(kind="regular", height_m=20.0)})}
    )
    with pytest.raises(render.RendererDiedError, match=r"(?s)ended with code 1.*LaisnError: height_m=20"):
        render.render(
            dataclasses.replace(flight, scenario=broken),
            tmp_path / "film.mp4",
            errors=errors_of(flight),
            video=small(),
            workers=1,
        )
    assert list(tmp_path.iterdir()) == []


@needs_graphics
def test_an_interrupt_leaves_no_film_and_no_children(tmp_path):
    program = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[1])!r})
import numpy as np
from pathlib import Path
from synthetic import make_flight
from sim.film import render
from sim.scenario.settings import Video
flight = make_flight(60.0)
errors = [(np.zeros(600), np.zeros(600))]
def progress(share):
    print("going", flush=True)
render.render(flight, Path({str(tmp_path / "film.mp4")!r}), errors=errors, video=Video(speed_up=1.0), workers=1,
    progress=progress)
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
