"""What a study adds to the film: other estimates, coloured rays, an excerpt of the mission, and
the pitch film.
"""

import inspect
import pickle
import subprocess
from dataclasses import replace

import av
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from experiments.studies.asymmetry import figures
from experiments.studies.asymmetry.figures import fly_example
from experiments.study.file import built_in_files, study_of
from experiments.study.plan import plan_of
from laisn.geometry import horizontal_range
from sim.film import graphics, render
from sim.film.cameras import CameraRig
from sim.film.film_data import (
    ESTIMATE,
    NOTHING,
    Annotations,
    FilmData,
    OtherEstimate,
    RayErrors,
    diverging,
)
from sim.film.render import FilmJob
from sim.flight import excerpt
from sim.scenario.settings import Video
from sim.trajectory import tilted

pytestmark = pytest.mark.system

needs_graphics = pytest.mark.skipif(
    graphics.working() is None, reason="no graphics library renders here: " + graphics.INSTALL
)
COLOUR = (0.30, 1.0, 0.60)


def estimate_beside_truth(flight, east, north):
    """An estimate at a constant distance from the truth."""
    return OtherEstimate(
        label="other", colour=COLOUR, position=flight.hydrophone(0)[:, :2] + [east, north]
    )


@pytest.fixture(scope="module")
def example():
    keys = {"set": {"duration_s": 40.0}, "scenario": ["T6"]}
    return fly_example(plan_of(study_of(str(built_in_files("asymmetry")["missions"]), keys)))


# annotations


def test_colours_diverge_symmetrically_and_saturate():
    colours = diverging([-2.0, -1.0, 0.0, 1.0, 2.0, np.nan])
    assert_array_equal(colours[0], colours[1])
    assert_array_equal(colours[3], colours[4])
    blue, pale, red = colours[1], colours[2], colours[3]
    assert np.argmax(blue) == 2
    assert np.argmax(red) == 0
    assert pale.min() > 0.9
    assert_allclose(diverging([-0.5, 0.5]), [(blue + pale) / 2, (red + pale) / 2])
    assert not (colours[5] == pale).any()


def test_rays_take_the_colours_of_their_message():
    rays = RayErrors(
        label="error", value=np.array([[-0.1, 0.0, 0.1], [np.nan, 0.2, -0.05]]), limit=0.1
    )
    colours = Annotations(rays=rays).ray_colours
    assert_allclose(colours(0), diverging([-1.0, 0.0, 1.0]))
    assert_allclose(colours(1), diverging([np.nan, 1.0, -0.5]))
    assert_allclose(colours(-1), diverging([np.nan] * 3))
    with pytest.raises(ValueError, match="colour bar ends at 0 m"):
        replace(rays, limit=0.0)


def test_positions_between_steps_lie_on_the_line_between_them(flight):
    steps = np.arange(1.0, 601.0)
    other = OtherEstimate(
        label="other", colour=COLOUR, position=np.stack([steps, -2 * steps], axis=1)
    )
    data = FilmData(flight, 4.0, 0, Annotations(others=(other,)))
    states = [data.at(time) for time in (0.0, 10.0, 10.05, 60.0)]
    positions = np.concatenate([state.others for state in states])
    assert_allclose(positions[:, 0], [1.0, 100.0, 100.5, 600.0])
    assert_allclose(positions[:, 1], -2 * positions[:, 0])
    assert_allclose(positions[:, 2], [state.hydrophone[0, 2] for state in states])
    # the trail of the other estimate follows those of leader, follower and its own estimate
    trail = data.trails(states[2])[3]
    assert_allclose(trail[:, 0] * -2, trail[:, 1])
    assert_allclose(trail[-1], states[2].others[0])


def test_a_frame_state_has_its_message(flight):
    data = FilmData(flight, 4.0)
    assert [data.at(t).message[0] for t in (0.5, 1.0, 1.95, 2.0, 60.0)] == [-1, 0, 0, 1, 59]


# excerpt


def test_an_excerpt_shows_what_the_whole_shows(flight):
    part = excerpt(flight, 20.0, 41.0)
    assert_allclose(part.trajectory.time[[0, -1]], [20.0, 41.0])
    assert part.measurements[0].speed.size == 210
    data_of_whole = FilmData(flight, 4.0)
    data_of_part = FilmData(part, 4.0)
    for time in (21.0, 30.03, 41.0):
        whole_state, part_state = data_of_whole.at(time), data_of_part.at(time)
        for name in (
            "position",
            "quaternion",
            "estimate",
            "covariance",
            "ray",
            "ranges",
            "position_error",
        ):
            assert_allclose(
                getattr(part_state, name), getattr(whole_state, name), atol=1e-9, err_msg=name
            )
        assert part_state.fix_kind == whole_state.fix_kind
        # messages at 1, 2 … 20 s came before
        assert part_state.message[0] == whole_state.message[0] - 20


@pytest.mark.parametrize(("start", "end"), [(-1.0, 5.0), (5.0, 61.0), (9.0, 9.0), (9.0, 8.0)])
def test_an_excerpt_lies_within_the_mission(flight, start, end):
    with pytest.raises(ValueError, match="from 0 to 60 s"):
        excerpt(flight, start, end)


# frames


def colour_near(image, pixel, radius=1):
    """Mean over pixels that lie inside a marker for any of its subpixel positions."""
    x, y = (int(np.floor(v)) for v in pixel)
    return (
        np.asarray(image)[y - radius : y + radius + 1, x - radius : x + radius + 1]
        .reshape(-1, 3)
        .mean(axis=0)
    )


STILL_TIME = 40.0


def annotations_of(flight):
    """Another estimate 2.5 m east of the truth, and coloured rays."""
    range_errors = np.zeros((60, 3))
    # at 40 s the 40th message has just arrived
    range_errors[39] = -0.05, 0.05, 0.0
    return Annotations(
        others=(estimate_beside_truth(flight, 2.5, 0.0),),
        rays=RayErrors(label="error", value=range_errors, limit=0.05),
    )


RENDER_STILLS = """
import pickle
from contextlib import closing
import numpy as np
from sim.film.render import FrameRenderer
from sim.film.scene import GlScene
jobs, when = pickle.load(open(sys.argv[1], "rb"))
with closing(GlScene(jobs["plain"].flight, jobs["plain"].video)) as scene:
    frames = {name: FrameRenderer(job, scene).frame(when) for name, job in jobs.items()}
    np.savez(sys.argv[2], **frames)
"""


@pytest.fixture(scope="module")
def stills(flight, tmp_path_factory):
    """Stills with annotations, by camera, and a plain one; two of one process, since its start
    takes longer than a still.
    """
    folder, job = tmp_path_factory.mktemp("shown"), FilmJob(flight=flight, video=Video())
    jobs = {
        "plain": job,
        "profile": replace(job, video=Video(camera="profile"), annotations=annotations_of(flight)),
    }
    (folder / "jobs").write_bytes(pickle.dumps((jobs, STILL_TIME)))
    arguments = (str(folder / "jobs"), str(folder / "stills.npz"))
    command, environment = graphics.child(RENDER_STILLS, graphics.working().name)
    subprocess.run([*command, *arguments], env=environment, check=True, timeout=120)
    render.still(replace(job, annotations=annotations_of(flight)), STILL_TIME, folder / "chase.png")
    with np.load(folder / "stills.npz") as images:
        return {name: images[name][..., :3] for name in jobs} | {
            "chase": np.asarray(Image.open(folder / "chase.png"))
        }


@needs_graphics
@pytest.mark.parametrize("camera", ["chase", "profile"])
def test_the_other_estimate_and_the_rays_have_their_colours_where_they_should(
    flight, stills, camera
):
    time, video = STILL_TIME, Video(camera=camera)
    image = stills[camera]
    data = FilmData(flight, video.speed_up)
    state = data.at(time)
    view = CameraRig(data, 1280 / 720).shot(camera, state).view
    (marker,), _ = view.project(state.hydrophone[0] + [2.5, 0.0, 0.0], 1280, 720)
    assert_allclose(colour_near(image, marker), 255 * np.array(COLOUR), atol=12)
    # nothing covers the transmitters, which have the colours of their rays
    ends, _ = view.project(state.transmitter, 1280, 720)
    rear, front = (colour_near(image, end, radius=0) for end in ends[:2])
    assert_allclose(rear, 255 * diverging(-1.0), atol=30)
    assert_allclose(front, 255 * diverging(1.0), atol=30)


@needs_graphics
def test_the_curve_of_the_other_estimate_is_drawn_where_one_is_given(stills):
    assert inspect.signature(FilmJob).parameters["annotations"].default == Annotations() == NOTHING
    # the panel of the position error: left edge 16, top 288, 292 × 92 px
    panels = [stills[name][290:378, 16:308].astype(float) for name in ("plain", Video().camera)]
    # green more than anything else: the panel itself is blue, the other curve magenta
    is_green = [panel[..., 1] - np.maximum(panel[..., 0], panel[..., 2]) > 25 for panel in panels]
    assert not is_green[0].any()
    # an error of 2.5 m throughout: a level line over two thirds of the 226 px of the axis
    rows, columns = np.nonzero(is_green[1])
    assert np.ptp(columns) > 0.6 * 226
    assert np.ptp(rows) < 10
    assert (np.abs(panels[1] - 255 * np.array(ESTIMATE)).max(axis=2) < 80).any()


# the film of the pitch study


def test_pitch_errors_are_those_of_a_tilted_hull(example):
    flight = example.flight
    truth, level_trajectory = flight.trajectory, tilted(flight.trajectory, 0.0)
    sites = [truth.site(f"leader/{name}") for name in ("tx_rear", "tx_front", "tx_middle")]
    actual = figures.pitch_errors(flight)
    for message in (3, 17, 38):
        step = flight.measurements[0].message_step[message] * flight.stride
        hydrophone = truth.site_at("follower/hydrophone", truth.time[step])[0]
        depth_difference = hydrophone[2] - truth.position[step, 0, 2]
        for i, site in enumerate(sites):
            range_by_navigator = horizontal_range(
                float(np.linalg.norm(truth.site_position[step, site] - hydrophone)),
                float(depth_difference),
            )
            range_of_level_hull = np.linalg.norm(
                (level_trajectory.site_position[step, site] - hydrophone)[:2]
            )
            assert actual[message, i] == pytest.approx(
                range_by_navigator - range_of_level_hull, abs=1e-9
            )


def test_both_navigators_receive_the_same_and_the_colour_bar_covers_every_error(example):
    flight, annotations = figures.scene(example)
    example_time = example.flight.trajectory.time[example.step]
    assert flight.trajectory.time[0] <= example_time <= flight.trajectory.time[-1]
    assert annotations.rays is not None
    assert np.nanmax(np.abs(annotations.rays.value)) <= annotations.rays.limit
    assert np.isfinite(annotations.rays.value).all()
    (aware,) = annotations.others
    assert aware.position.shape == (flight.measurements[0].speed.size, 2)
    assert annotations.rays.value.shape == (flight.measurements[0].message_step.size, 3)
    # the estimates of the two navigators differ
    assert np.abs(aware.position - flight.estimates[0].state[:, :2]).max() > 0.1


@needs_graphics
def test_the_pitch_film_is_rendered(example, tmp_path):
    video = Video(camera="profile", width_px=320, height_px=180, speed_up=40.0, frame_rate_hz=10)
    path = figures.film({"example": example}, tmp_path, video)
    assert path == tmp_path / "film.mp4"
    assert list(tmp_path.iterdir()) == [path]
    flight, _ = figures.scene(example)
    duration = flight.trajectory.time[-1] - flight.trajectory.time[0]
    with av.open(str(path)) as film:
        frames = sum(1 for _ in film.decode(video=0))
    assert frames == max(1, round(duration / 40.0 * 10))
