"""The plain extended Kalman filter: against filterpy's, and a closed form."""

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from laisn import ekf
from laisn.arrays import Floats
from laisn.messages import Measurements
from laisn.tight.settings import TightSettings
from sim.sensing.errors import SensorErrors
from sim.sensing.observation import measure
from tests.campaign.test_montecarlo import ABEAM, make_truth

SETTINGS = TightSettings()


def by_filterpy(settings: TightSettings, mission: Measurements, start: Floats) -> tuple[Floats, Floats]:
    """Position and covariance after each step, with numerical derivatives of the motion and of the ranges."""
    kalman = ExtendedKalmanFilter(dim_x=5, dim_z=1)
    kalman.x = np.r_[start[:2], 0.0, 0.0, 0.0]
    kalman.P = np.diag(np.square([settings.start_sigma] * 2 + [
        settings.speed_bias_sigma, settings.heading_bias_sigma, settings.range_scale_bias_sigma]))  # fmt: skip
    dt = mission.dt

    def velocity(x: Floats, speed: float, heading: float) -> Floats:
        return np.asarray((speed - x[2]) * np.array([np.sin(heading - x[3]), np.cos(heading - x[3])]))

    def derivative(function, x: Floats) -> Floats:  # type: ignore[no-untyped-def]
        steps = 1e-6 * np.eye(5)
        return np.column_stack([(function(x + step) - function(x - step)) / 2e-6 for step in steps])

    arrival = {k: i for i, k in enumerate(mission.message_step.tolist())}
    before, states, spreads = (mission.speed[0], mission.heading[0]), [], []
    for k, now in enumerate(zip(mission.speed, mission.heading, strict=True), start=1):

        def moved(x: Floats, before=before, now=now) -> Floats:  # type: ignore[no-untyped-def]
            way = 0.5 * dt * (velocity(x, *before) + velocity(x, *now))
            return np.asarray(np.r_[x[:2] + way, x[2:]])

        heading = now[1] - kalman.x[3]
        turn = np.array([[np.sin(heading), np.cos(heading)], [-np.cos(heading), np.sin(heading)]])
        noise = np.diag([settings.speed_sigma**2, (settings.heading_sigma * now[0]) ** 2])
        kalman.Q = np.zeros((5, 5))
        kalman.Q[:2, :2] = dt**2 * turn.T @ noise @ turn
        kalman.Q[2, 2], kalman.Q[3, 3] = 4e-8 * dt, 2.25e-8 * dt
        kalman.F = derivative(moved, kalman.x)
        kalman.P = kalman.F @ kalman.P @ kalman.F.T + kalman.Q
        kalman.x = moved(kalman.x)
        if k in arrival:
            _, east, north, heading, _, depth, *_ = mission.message[arrival[k]]
            ranges = mission.ranges[arrival[k]].copy()
            ranges[settings.transmitters :] = np.nan
            used = np.flatnonzero(np.isfinite(ranges))
            forward, port = (np.array([np.sin(a), np.cos(a)]) for a in (heading, heading - np.pi / 2))
            places = np.array([east, north]) + np.stack([-forward, forward, settings.middle_offset * port])
            below = depth - mission.depth[k - 1] + settings.hydrophone_height

            def expected(x: Floats, used=used, places=places, below=below, ranges=ranges) -> Floats:  # type: ignore[no-untyped-def]
                away = np.hypot(np.hypot(*(x[:2] - places[used]).T), below)
                return np.asarray(away * (1.0 + x[4] / np.nanmax(ranges)))

            share = expected(np.r_[kalman.x[:4], 0.0]) / np.nanmax(ranges)
            noise = settings.range_sigma**2 * np.eye(used.size)
            noise += settings.range_scale_sigma**2 * np.outer(share, share)
            if used.size:
                # of the scale's share in the direction's derivative, 1 + b_r / max z, the filter takes 1
                kalman.update(
                    ranges[used], lambda x, e=expected, share=share: derivative(lambda y: e(np.r_[y[:4], 0.0]), x)
                    + np.outer(share, np.eye(5)[4]), expected, R=noise,
                )  # fmt: skip
        before = now
        states.append(kalman.x[:2].copy())
        spreads.append(kalman.P[[0, 0, 1], [0, 1, 1]])
    return np.array(states), np.array(spreads)


@pytest.mark.parametrize("transmitters", [2, 3])
def test_many_runs_are_filtered_as_filterpy_does_one(transmitters: int) -> None:
    """Also where ranges are missing, which the missions of `make_truth` have."""
    truth = make_truth(offset=ABEAM, attitude=False)
    assert np.any(np.isnan(truth.slant_range[:, :2]))
    settings = replace(SETTINGS, transmitters=transmitters, hydrophone_height=0.1)
    missions = [measure(truth, SensorErrors(depth_sigma=0.05), seed=3, run=run) for run in range(3)]
    found = ekf.filter_runs(settings, missions, truth.start)
    for run, mission in enumerate(missions):
        position, covariance = by_filterpy(settings, mission, truth.start)
        assert found.position[run] == pytest.approx(position, abs=1e-6)
        assert found.covariance[run] == pytest.approx(covariance, rel=1e-5, abs=1e-9)


def test_a_follower_at_rest_knows_its_place_as_a_mean_of_ranges_does() -> None:
    """Of n ranges from due north, biases known: variance of the northing 1 / (1 / σ₀² + n / σ²)."""
    settings = TightSettings(range_scale_sigma=0.0, range_scale_bias_sigma=0.0, range_sigma=0.5, start_sigma=2.0)
    x, P = ekf.initial(settings, np.zeros(2), 1)
    there = np.array([[[0.0, 100.0, 0.0]] * 3])
    for count in (1, 2, 3):
        x, P = ekf.update(settings, x, P, there, np.array([[100.0, np.nan, np.nan]]))
        assert P[0, 1, 1] == pytest.approx(1.0 / (1.0 / 4.0 + count / 0.25), rel=1e-9)
        assert P[0, 0, 0] == pytest.approx(4.0, rel=1e-9)


def test_a_message_without_ranges_changes_nothing() -> None:
    x, P = ekf.initial(SETTINGS, np.array([3.0, 4.0]), 2)
    after = ekf.update(SETTINGS, x, P, np.zeros((2, 3, 3)), np.full((2, 3), np.nan))
    assert np.array_equal(after[0], x)
    assert np.allclose(after[1], P, rtol=1e-15)


def test_runs_with_messages_at_other_steps_are_refused() -> None:
    mission = measure(make_truth(), SensorErrors(), seed=1, run=0)
    later = replace(mission, message_step=mission.message_step - 1)
    with pytest.raises(ValueError, match="messages at the same steps"):
        ekf.filter_runs(SETTINGS, [mission, later], np.zeros(2))
