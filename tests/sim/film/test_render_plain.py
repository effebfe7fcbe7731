"""Pictures for a paper: without panels, before white or nothing, by a camera of the user's."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.flight.results import Flight, camera_of
from experiments.flight.results import render as render_flight
from laisn.errors import LaisnError
from sim.film import graphics
from sim.film.film_data import FilmData
from sim.film.render import RenderError, cut_out
from tests.synthetic import make_flight

needs_graphics = pytest.mark.skipif(
    graphics.working() is None, reason="no graphics library renders here: " + graphics.INSTALL
)
CAMERA_DISTANCE_M = 3.0


@pytest.fixture(scope="module")
def flight() -> Flight:
    return Flight(**vars(make_flight(60.0)))


def test_a_cut_out_has_the_colours_and_opacities_that_gave_both_pictures() -> None:
    rng = np.random.default_rng(3)
    colour = rng.uniform(0, 255, (5, 7, 3))
    opacity = rng.uniform(0.2, 1.0, (5, 7, 1))
    opaque = np.full((5, 7, 1), 255.0)
    white, black = (
        np.concatenate([opacity * colour + (1 - opacity) * background, opaque], axis=-1)
        for background in (255.0, 0.0)
    )
    picture = cut_out(white.round().astype(np.uint8), black.round().astype(np.uint8))
    np.testing.assert_allclose(picture[..., 3], 255 * opacity[..., 0], atol=1.0)
    np.testing.assert_allclose(picture[..., :3], colour, atol=6.0)


@pytest.mark.parametrize(
    "text",
    ["", "1,2,3", "nobody:1,2,3", "leader:1,2", "1,2,3,1,2,3", "leader:0,0,0", "1,2,3,4,5,x"],
)
def test_a_camera_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(LaisnError, match="view: expected E,N,U,E,N,U"):
        camera_of(text, ("leader", "follower"))


def test_a_camera_stands_where_it_is_put(flight: Flight) -> None:
    state = FilmData(flight, 30.0, 0).at(40.0)
    beside = camera_of("follower:-4.5,2,0.6", flight.trajectory.names).shot(state).view
    np.testing.assert_allclose(beside.position - state.position[1], [-4.5, 2.0, 0.6])
    np.testing.assert_allclose(beside.target, state.position[1])
    fixed = camera_of("10,20,-3,11,22,-5", flight.trajectory.names).shot(state).view
    np.testing.assert_allclose([fixed.position, fixed.target], [[10, 20, -3], [11, 22, -5]])


def test_a_film_cannot_be_transparent(flight: Flight, tmp_path: Path) -> None:
    with pytest.raises(RenderError, match="a film cannot be transparent"):
        render_flight(flight, tmp_path / "film.mp4", background="transparent")


@pytest.mark.system
@needs_graphics
def test_a_large_picture_has_the_hull_alone(flight: Flight, tmp_path: Path) -> None:
    path = tmp_path / "hull.png"
    settings = {"view": f"follower:0,{-CAMERA_DISTANCE_M},0", "plain": True, "width_px": 3840}
    render_flight(flight, path, time_s=0.0, background="transparent", height_px=2160, **settings)
    image = Image.open(path)
    assert image.mode == "RGBA"
    assert image.size == (3840, 2160)
    opacity = np.asarray(image)[..., 3]
    for corner in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        assert opacity[corner] == 0
    # the follower heads east and is seen from the south, abeam: by the lens, of 46° vertically, its
    # picture is as long as a hull
    is_hull = opacity[1080 - 40 : 1080 + 40].max(axis=0) > 200
    hull_columns = np.flatnonzero(is_hull)
    focal = 1080 / np.tan(np.radians(23.0))
    visible_length_m = (hull_columns[-1] - hull_columns[0]) * CAMERA_DISTANCE_M / focal
    assert 1.0 < visible_length_m < 3.0
    assert opacity[1080, 1920] == 255


@pytest.mark.system
@needs_graphics
def test_a_plain_picture_before_white_has_no_words(flight: Flight, tmp_path: Path) -> None:
    path = tmp_path / "plain.png"
    render_flight(flight, path, time_s=30.0, plain=True, background="white", width_px=640)
    picture = np.asarray(Image.open(path).convert("RGB"))
    # where the panels and the text at the foot would be
    assert (picture[:60, :160] == 255).all()
    assert (picture[-40:, 160:480] == 255).all()
    assert (picture < 200).any()
