"""The moving picture of the README: it shows the leader's corner, and all frames of the film of
it in their order.
"""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from experiments.flight.library import load_scenario
from sim.assembly import routes_of
from sim.film.render import FilmJob
from sim.flight import FlightRecord
from sim.scenario.parts import MissionPlan
from tests import synthetic
from tools.documents import draw

COLOURS = ((200, 40, 40), (40, 160, 40), (40, 40, 200))


def test_the_picture_shows_the_whole_turn_of_the_formation() -> None:
    """The last follower passes the corner of the leader's L as many seconds after it as it is
    metres behind.
    """
    scenario = load_scenario("swarm", ())
    leader = routes_of(MissionPlan.of(scenario))[0]
    legs = np.diff(leader.waypoint, axis=0)
    assert legs[0] @ legs[1] == pytest.approx(0.0, abs=1e-6), "a square corner"
    corner_time = leader.time[1]
    farthest_behind_m = max(
        follower.station.behind_m for follower in scenario.followers if follower.station
    )
    begin, end = draw.TURN_S
    # wings begin to turn before their station does, and the formation's frame goes on turning
    assert begin + 30.0 <= corner_time
    assert corner_time + farthest_behind_m / 1.0 + 30.0 <= end <= scenario.duration_s


def test_the_picture_has_all_frames_of_a_film_of_the_stretch_from_above(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    filmed: list[tuple[FlightRecord, Any]] = []

    def render(job: FilmJob, path: Path) -> None:
        video = job.video
        filmed.append((job.flight, video))
        with av.open(str(path), "w") as film:
            stream: Any = film.add_stream("libx264", rate=Fraction(video.frame_rate_hz))
            stream.width, stream.height, stream.pix_fmt = video.width_px, video.height_px, "yuv420p"
            for colour in COLOURS:
                image = np.full((video.height_px, video.width_px, 3), colour, dtype=np.uint8)
                film.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
            film.mux(stream.encode())

    monkeypatch.setattr(draw, "FOLDER", tmp_path)
    monkeypatch.setattr(draw.render, "render", render)
    draw.moving_picture("moved", synthetic.make_flight(20.0), (10.0, 13.0))
    ((flight, video),) = filmed
    assert (flight.trajectory.time[0], flight.trajectory.time[-1]) == pytest.approx((10.0, 13.0))
    assert video.camera == "top"
    with Image.open(tmp_path / "moved.webp") as picture:
        assert (picture.format, picture.size, getattr(picture, "n_frames", 1)) == (
            "WEBP",
            (640, 360),
            3,
        )
        for i, colour in enumerate(COLOURS):
            picture.seek(i)
            mean_colour = np.asarray(picture.convert("RGB"), dtype=np.float64).mean(axis=(0, 1))
            np.testing.assert_allclose(mean_colour, colour, atol=12.0)
            # as long as a frame of the film
            assert picture.info["duration"] * video.frame_rate_hz == 1000
        assert picture.info["loop"] == 0
