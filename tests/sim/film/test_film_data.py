"""Footage of a flight: moments between instants, rays, trails, and the sea that is drawn."""

import numpy as np
import pytest

from sim.film.film_data import FilmData
from sim.film.scene import Sea
from sim.scenario.parts import SeaSettings
from sim.scenario.settings import WavesTable
from sim.water.assembly import ocean_of
from tests.sim.water.test_ocean import elevation
from tests.synthetic import make_flight


def test_a_moment_interpolates_truth_and_estimate(flight):
    data = FilmData(flight, speed_up=20.0)
    state = data.at(30.05)
    np.testing.assert_allclose(state.position, flight.trajectory.at(30.05)[0][0])
    np.testing.assert_allclose(
        state.hydrophone[0], flight.trajectory.site_at("follower/hydrophone", 30.05)[0]
    )
    before, after = flight.estimates[0].state[299:301, :2]
    np.testing.assert_allclose(state.estimate[0, :2], (before + after) / 2, atol=1e-9)
    assert state.position_error[0] == data.position_error[0, 299]
    assert np.isnan(data.at(0.0).position_error[0])


def test_rays_have_full_strength_at_the_ping_then_fade_and_are_absent_without_reception(flight):
    data = FilmData(flight, 1.0)
    np.testing.assert_allclose(data.at(5.0).ray[0], 1.0)
    fading = [data.at(5.0 + dt).ray[0, 0] for dt in (0.0, 0.3, 0.6, 0.9)]
    assert (np.diff(fading) < 0).all()
    assert fading[-1] < 0.2
    assert (data.at(0.5).ray == 0).all()
    # the 13th message lacks the front range
    without_front_range = data.at(13.0)
    assert np.isnan(without_front_range.ranges[0, 1])
    assert without_front_range.ray[0, 1] == 0
    assert without_front_range.ray[0, 0] == pytest.approx(1.0)


def test_rays_of_frequent_pings_do_not_flicker(flight):
    data = FilmData(flight, speed_up=20.0)
    strength = [data.at(t).ray[0, 0] for t in np.arange(10.0, 40.0, 20 / 30)]
    assert np.ptp(strength) < 0.15


def test_trail_points_stay_in_place_while_time_goes_on(flight):
    data = FilmData(flight, speed_up=20.0)
    early, late = (data.trails(data.at(time))[1] for time in (30.0, 30.7))
    old = {tuple(p) for p in early[:-1]}
    assert len(old & {tuple(p) for p in late[:-1]}) >= len(old) - 1


def test_the_drawn_sea_is_the_simulated_sea():
    mission = make_flight(2.0).scenario
    waves = WavesTable(kind="regular", height_m=1.0, period_s=8.0, direction_deg=30.0)
    ocean = ocean_of(
        SeaSettings.of(
            mission.model_copy(update={"ocean": mission.ocean.model_copy(update={"waves": waves})})
        )
    )
    sea = Sea.__new__(Sea)
    sea._ocean = ocean
    sea._wavenumber = np.hypot(*ocean.waves.wavenumber_1_m.T)
    x, y = sea.grid(np.array([40.0, -7.0, 0.0]), 100.0)
    drawn = sea.elevation(x, y, 12.3)
    assert np.abs(drawn - elevation(ocean, x[None, :], y[:, None], 12.3)).max() <= 1e-9
    assert np.ptp(drawn) > 0.9
