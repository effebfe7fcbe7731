"""Cameras of the film: projection, what stays in the frame, and what keeps clear of the panels."""

import dataclasses

import numpy as np
import pytest

from experiments.flight.library import load_scenario
from sim import attitude
from sim.film.cameras import CameraRig, View
from sim.film.film_data import FilmData
from tests import synthetic


def test_projection_is_that_of_a_pinhole():
    # looking east from the origin, 90° vertically: a point 10 m ahead, 2 m to the right (south), 1
    # m up
    view = View(position=np.zeros(3), target=np.array([1.0, 0, 0]), fovy_deg=90.0)
    pixels, ahead = view.project(np.array([[10.0, -2.0, 1.0]]), 400, 200)
    np.testing.assert_allclose(pixels, [[200 + 100 * 0.2, 100 - 100 * 0.1]])
    np.testing.assert_allclose(ahead, [10.0])


def test_a_ball_is_seen_as_soon_as_a_point_of_it_is():
    """Balls about the edges of the frame, of which points at random are projected; those far aside
    and behind are not seen.
    """
    rng = np.random.default_rng(6)
    view = View(position=np.array([1.0, 2.0, -3.0]), target=np.array([4.0, 1.0, -5.0]))
    centres = view.position + rng.normal(0.0, 8.0, size=(400, 3))
    radii = rng.uniform(0.1, 3.0, size=400)
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    seen = view.sees(centres, radii, 320 / 180)
    for centre, radius, is_seen in zip(centres, radii, seen, strict=True):
        pixels, ahead = view.project(centre + radius * directions, 320, 180)
        inside = (ahead > 0) & (pixels >= 0).all(axis=1) & (pixels < (320, 180)).all(axis=1)
        assert is_seen or not inside.any()
    right, _, forward = view.axes
    outside = view.position + np.array(
        [10 * forward + 20 * right, 10 * forward - 20 * right, -forward]
    )
    assert not view.sees(outside, np.full(3, 0.5), 320 / 180).any()
    assert view.sees(outside, np.array([0.5, 0.5, np.inf]), 320 / 180).tolist() == [
        False,
        False,
        True,
    ]


def test_a_line_is_cut_at_the_lens():
    view = View(position=np.zeros(3), target=np.array([1.0, 0, 0]), fovy_deg=90.0)
    ((pixels, fraction),) = view.line(np.array([[-5.0, 1.0, 0.0], [5.0, 1.0, 0.0]]), 200, 200)
    assert fraction.min() > 0.5
    np.testing.assert_allclose(fraction[-1], 1.0)
    # at the far end: 1 m to the left at 5 m
    np.testing.assert_allclose(pixels[-1], [100 - 100 / 5, 100])
    assert view.line(np.array([[-5.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]), 200, 200) == []


def test_several_lines_are_projected_as_each_alone():
    """In front of the camera, behind it, of NaN, and from the front to behind and back."""
    view = View(position=np.zeros(3), target=np.array([1.0, 0, 0]), fovy_deg=90.0)
    in_front = [[2.0, 1.0, 0.0], [3.0, 1.0, 0.5], [5.0, 1.0, 0.0], [6.0, 2.0, 0.0]]
    behind = np.array(in_front) * [-1.0, 1.0, 1.0]
    crossing = [[2.0, 1.0, 0.0], [-3.0, 1.0, 0.5], [-5.0, 1.0, 0.0], [1.0, 2.0, 0.0]]
    lines = np.array([in_front, behind, np.full((4, 3), np.nan), crossing])
    stretches = list(view.lines(lines, 200, 200))
    assert [number for number, *_ in stretches] == [0, 3, 3]
    line_by_line = [*view.line(lines[0], 200, 200), *view.line(lines[3], 200, 200)]
    for (_, pixels, fraction), (expected_pixels, expected_fraction) in zip(
        stretches, line_by_line, strict=True
    ):
        np.testing.assert_allclose(pixels, expected_pixels)
        np.testing.assert_allclose(fraction, expected_fraction)
    # the lens cuts lines 0.15 m in front of the camera: the last line leaves after 1.85 of the 5 m
    # of its first segment, and comes back 5.15 of 6 m along its third
    np.testing.assert_allclose(stretches[1][2], [0.0, 1.85 / 5 / 3])
    np.testing.assert_allclose(stretches[2][2], [(2 + 5.15 / 6) / 3, 1.0])


def test_a_camera_cannot_stand_on_its_target():
    with pytest.raises(ValueError, match="cannot look at itself"):
        View(position=np.ones(3), target=np.ones(3))


@pytest.mark.parametrize("camera", ["chase", "top", "pip", "side", "profile", "orbit"])
def test_cameras_keep_leader_and_follower_in_the_frame(flight, camera):
    data = FilmData(flight, 20.0)
    rig = CameraRig(data, 16 / 9)
    for t in np.linspace(0.0, 60.0, 25):
        state = data.at(t)
        shot = rig.shot(camera, state)
        pixels, ahead = shot.view.project(state.position, 1280, 720)
        assert (ahead > 0.5).all()
        assert (pixels >= 0).all()
        assert (pixels <= [1280, 720]).all()
        if shot.surface:
            assert shot.view.position[2] < 0


@pytest.mark.parametrize("depth", [0.2, 1.2, 3.0, 12.0])
def test_seen_from_above_a_follower_at_any_depth_has_the_scale_of_the_bar(flight, depth):
    """A point a metre north of the hydrophone lies focal length / `plane_m` pixels above it, and
    the estimate in the picture.
    """
    truth = flight.trajectory
    position = truth.position.copy()
    position[:, 1, 2] = -depth - (flight.hydrophone(0)[0, 2] - truth.position[0, 1, 2])
    raised = dataclasses.replace(flight, trajectory=synthetic.moved(truth, position=position))
    data = FilmData(raised, 20.0)
    rig = CameraRig(data, 16 / 9)
    for t in (5.0, 30.0, 55.0):
        state = data.at(t)
        ((view, _),) = rig.shot("profile", state).insets
        hydrophone, estimate = state.hydrophone[0], state.estimate[0]
        points = np.array(
            [hydrophone, hydrophone + np.array([0, 1.0, 0]), [*estimate[:2], hydrophone[2]]]
        )
        pixels, _ = view.project(points, 320, 180)
        np.testing.assert_allclose(pixels[0], [160, 90], atol=1e-6)
        scale = 90 / np.tan(np.radians(30)) / view.plane_m
        np.testing.assert_allclose(pixels[1] - pixels[0], [0, -scale], atol=1e-6)
        assert np.all((pixels[2] > 0) & (pixels[2] < [320, 180]))


@pytest.mark.parametrize("pitch_deg", [-15.0, 15.0])
def test_the_film_of_the_diving_leader_shows_its_pitch(flight, pitch_deg):
    """Its hull of 2 m takes a tenth of the picture at least, and leans by half of its pitch or
    more.
    """
    truth = flight.trajectory
    tilted = attitude.from_euler(
        truth.heading[:, 0], np.full(truth.time.size, np.deg2rad(pitch_deg))
    )
    quaternion = truth.quaternion.copy()
    quaternion[:, 0] = tilted
    diving = dataclasses.replace(flight, trajectory=synthetic.moved(truth, quaternion=quaternion))
    data = FilmData(diving, 20.0)
    rig = CameraRig(data, 16 / 9)
    for t in np.linspace(5.0, 55.0, 11):
        state = data.at(t)
        ends = attitude.rotate(state.quaternion[:1], np.array([[-1.0, 0, 0], [1.0, 0, 0]]))
        view = rig.shot(load_scenario("diving", ()).video.camera, state).view
        (stern, bow), _ = view.project(state.position[0] + ends, 1280, 720)
        across, up = np.abs(bow[0] - stern[0]), (stern[1] - bow[1]) * np.sign(pitch_deg)
        assert np.hypot(across, up) > 128
        assert np.rad2deg(np.arctan2(up, across)) > abs(pitch_deg) / 2


@pytest.mark.parametrize("offset_m", [-6.0, -3.0, 0.0, 3.0, 6.0])
def test_the_chasing_camera_keeps_the_estimate_clear_of_the_panels(flight, offset_m):
    """Seen towards the leader, the estimate lies `offset_m` to the right of the follower."""
    to_leader = flight.trajectory.position[flight.step_index(), 0] - flight.hydrophone(0)
    right = (
        np.column_stack([to_leader[:, 1], -to_leader[:, 0]])
        / np.hypot(to_leader[:, 0], to_leader[:, 1])[:, None]
    )
    (actual,) = flight.estimates
    state = actual.state.copy()
    state[:, :2] = flight.hydrophone(0)[:, :2] + offset_m * right
    displaced = dataclasses.replace(flight, estimates=(dataclasses.replace(actual, state=state),))
    data = FilmData(displaced, 20.0)
    rig = CameraRig(data, 16 / 9)
    for t in np.linspace(5.0, 55.0, 11):
        state = data.at(t)
        view = rig.shot("chase", state).view
        pixels, _ = view.project(np.stack([state.hydrophone[0], state.estimate[0]]), 1280, 720)
        # panels take the left, and the upper and lower right corners
        assert (pixels[:, 0] > 308).all()
        assert (pixels[:, 0] < 1032).all()
        assert (pixels[:, 1] < 700).all()
