"""What a film shows of a formation: where each follower should be, and the two vehicles nearest
to each other.
"""

import dataclasses

import numpy as np
import pytest

from experiments.flight.library import load_scenario
from sim.film.cameras import CameraRig
from sim.film.film_data import FilmData
from sim.film.overlay import Overlay, nearest, place_labels
from sim.flight import FlightRecord
from sim.scenario.formation import Station
from sim.scenario.settings import Follower, Video
from tests.synthetic import make_flight

BEHIND, DEPTH = 10.0, 12.0


def in_formation() -> FlightRecord:
    """The second of three followers has a station straight behind the leader; the others keep to
    routes.
    """
    flight = make_flight(60.0, 3)
    followers = list(flight.scenario.followers)
    followers[1] = Follower(name="follower2", station=Station(behind_m=BEHIND, depth_m=DEPTH))
    scenario = flight.scenario.model_copy(update={"followers": tuple(followers)})
    return dataclasses.replace(flight, scenario=scenario)


def film_data_of(flight: FlightRecord, follower: int = 0) -> FilmData:
    return FilmData(flight, 20.0, follower)


def test_a_station_straight_behind_is_where_the_leader_was() -> None:
    """The leader moves at 1 m/s, so that 10 m behind it is where it was 10 s ago."""
    flight = in_formation()
    actual = film_data_of(flight).at(40.05).station
    leader = flight.trajectory.at(40.05 - BEHIND)[0][0, 0]
    np.testing.assert_allclose(actual[1], [*leader[:2], -DEPTH], atol=0.02)
    assert np.isnan(actual[[0, 2]]).all()
    assert not film_data_of(make_flight(5.0, 3)).on_stations


def test_the_distance_from_a_station_is_that_of_the_hydrophone() -> None:
    flight = in_formation()
    data = film_data_of(flight)
    station_error = data.station_error(1)
    assert station_error is not None
    # step k = 400 is at 40 s
    expected = np.hypot(*(flight.hydrophone(1)[399] - data.at(40.0).station[1])[:2])
    assert station_error[399] == pytest.approx(expected, abs=1e-9)
    assert data.station_error(0) is None


def test_the_nearest_pair_is_found() -> None:
    """Of points 9 m apart in a row the last is 2 m above the second."""
    points = np.array([[0.0, 0, 0], [9.0, 0, 0], [18.0, 0, 0], [9.0, 0, 2.0]])
    pair = nearest(points)
    np.testing.assert_array_equal(pair, points[[1, 3]])


def test_the_overlay_draws_rings_and_prints_the_distance() -> None:
    """On a black picture a ring is bright in the colour of stations, and the labels show
    distances.
    """
    flight = in_formation()
    data = film_data_of(flight, 1)
    overlay = Overlay(data, Video())
    state = data.at(30.0)
    shot = CameraRig(data, 16 / 9).shot("top", state)
    overlay.canvas.load(np.zeros((720, 1280, 4), dtype=np.uint8))
    overlay.draw(state, shot)
    station = state.station[1]
    (centre,), _ = shot.view.project(station, 1280, 720)
    angle = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    ring = centre + 9.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    lit_points = 0
    for x, y in np.round(ring).astype(int):
        # a line lies between pixels
        red, _, blue = np.moveaxis(
            overlay.canvas.pixels[y - 1 : y + 2, x - 1 : x + 2, :3] / 255, 2, 0
        )
        lit_points += bool(((blue > 0.5) & (blue > 1.5 * red)).any())
    # trails and labels cover a few of the 32 points
    assert lit_points > 24
    station_error = float(np.hypot(*(station - state.hydrophone[1])[:2]))
    words = [label.words for label in overlay._labels(state, shot.view)]
    assert f"station, off by {station_error:.1f} m" in words
    # lanes of followers are 9 m apart, each a metre deeper, and the leader is farther off: √82 m,
    # but for a wobble
    assert "9.1 m apart, the nearest" in words
    labels_of_another = [
        label.words for label in Overlay(film_data_of(flight), Video())._labels(state, shot.view)
    ]
    assert not [word for word in labels_of_another if word.startswith("station")]


def test_the_swarm_is_filmed_from_behind() -> None:
    """From above its map hides the vehicles."""
    assert load_scenario("swarm", ()).video.camera == Video().camera == "chase"


def test_every_follower_of_ten_has_a_label() -> None:
    """All ten stand in the picture from above, and there is room for a label of each."""
    data = film_data_of(make_flight(60.0, 10))
    overlay, state = Overlay(data, Video()), data.at(30.0)
    labels = overlay._labels(state, CameraRig(data, 16 / 9).shot("top", state).view)
    placed = {label.words for label, _, _ in place_labels(labels, [], overlay.canvas)}
    assert set(data.flight.trajectory.names[1:]) <= placed
