"""The rival methods: each against an independent implementation or a closed form, and all as
navigators of missions.
"""

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter
from scipy.optimize import least_squares

import laisn_sim
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.estimates import FixKind
from laisn.messages import LeaderMessage, Measurements, OwnMotion, Ranges, Reception
from laisn.navigators import NAVIGATORS, find
from laisn.rivals import speed_modes
from laisn.rivals.filters import (
    DeadReckoning,
    GeodeticAdjustment,
    InvertedUsbl,
    OneWayTravelTime,
    RangeFilter,
)
from laisn.rivals.leader_track import LeaderTrack
from laisn.rivals.speed_modes import SpeedModes
from laisn.settings import Assume, RivalSettings
from sim.sensing.observation import measure
from sim.sensing.sensors import SensorErrors
from tests.experiments.campaign.test_montecarlo import ABEAM, make_truth

SETTINGS = RivalSettings()
RIVALS = [name for name, spec in NAVIGATORS.items() if spec.settings is RivalSettings]
START = np.array([0.0, 0.0, 1.0, 0.0])
EXACT_LOG = {"speed_bias_sigma": 0.0, "heading_bias_sigma": 0.0, "range_scale_bias_sigma": 0.0}


def navigator_of(name: str, settings: RivalSettings, start: Floats) -> Any:
    if name == "factor-graph":
        pytest.importorskip("gtsam")
    return find(name).make(settings, start)


def message(east: float, north: float, heading: float = 0.0, depth: float = 10.0) -> LeaderMessage:
    # its time is not stated: its pings arrive when it is used
    return LeaderMessage(
        timestamp=0.0, east=east, north=north, heading=heading, speed=1.0, depth=depth
    )


def run_filterpy(
    settings: RivalSettings,
    mission: Measurements,
    start: Floats,
    only_transmitter: int | None = None,
) -> tuple[Floats, Floats]:
    """Position and covariance after each step, with numerical derivatives of the motion and of
    the ranges; with `only_transmitter`, of its ranges alone.
    """
    kalman = ExtendedKalmanFilter(dim_x=7, dim_z=1)
    kalman.x = np.r_[start[:2], np.zeros(5)]
    current, current_walk = (
        (settings.current_sigma, 1e-6) if settings.assume.current else (0.0, 0.0)
    )
    kalman.P = np.diag(
        np.square(
            [settings.start_sigma] * 2
            + [
                settings.speed_bias_sigma,
                settings.heading_bias_sigma,
                settings.range_scale_bias_sigma,
                current,
                current,
            ]
        )
    )
    dt = mission.dt

    def velocity(x: Floats, speed: float, heading: float) -> Floats:
        return np.asarray(
            (speed - x[2]) * np.array([np.sin(heading - x[3]), np.cos(heading - x[3])]) + x[5:]
        )

    def derivative(function, x: Floats) -> Floats:  # type: ignore[no-untyped-def]
        steps = 1e-6 * np.eye(7)
        return np.column_stack([(function(x + step) - function(x - step)) / 2e-6 for step in steps])

    message_of_step = {k: i for i, k in enumerate(mission.message_step.tolist())}
    last_readings, states, covariances = (mission.speed[0], mission.heading[0]), [], []
    leader_messages: list[Floats] = []
    for k, readings in enumerate(zip(mission.speed, mission.heading, strict=True), start=1):

        def after_step(x: Floats, last_readings=last_readings, readings=readings) -> Floats:  # type: ignore[no-untyped-def]
            displacement = 0.5 * dt * (velocity(x, *last_readings) + velocity(x, *readings))
            return np.asarray(np.r_[x[:2] + displacement, x[2:]])

        heading = readings[1] - kalman.x[3]
        rotation = np.array(
            [[np.sin(heading), np.cos(heading)], [-np.cos(heading), np.sin(heading)]]
        )
        noise = np.diag([settings.speed_sigma**2, (settings.heading_sigma * readings[0]) ** 2])
        kalman.Q = np.zeros((7, 7))
        kalman.Q[:2, :2] = dt**2 * rotation.T @ noise @ rotation
        kalman.Q[2, 2], kalman.Q[3, 3] = 4e-8 * dt, 2.25e-8 * dt
        kalman.Q[5, 5] = kalman.Q[6, 6] = current_walk * dt
        kalman.F = derivative(after_step, kalman.x)
        kalman.P = kalman.F @ kalman.P @ kalman.F.T + kalman.Q
        kalman.x = after_step(kalman.x)
        if k in message_of_step:
            _, east, north, heading, _, depth, *_ = mission.message[message_of_step[k]]
            ranges = mission.ranges[message_of_step[k]].copy()
            ranges[settings.transmitters :] = np.nan
            if only_transmitter is not None:
                ranges[np.arange(3) != only_transmitter] = np.nan
            used = np.flatnonzero(np.isfinite(ranges))
            forward, port = (
                np.array([np.sin(a), np.cos(a)]) for a in (heading, heading - np.pi / 2)
            )
            transmitters = np.array([east, north]) + np.stack(
                [-forward, forward, settings.middle_offset * port]
            )
            depth_difference = depth - mission.depth[k - 1] + settings.hydrophone_height

            def expected(
                x: Floats,
                used=used,
                transmitters=transmitters,
                depth_difference=depth_difference,
                ranges=ranges,
            ) -> Floats:  # type: ignore[no-untyped-def]
                distance = np.hypot(np.hypot(*(x[:2] - transmitters[used]).T), depth_difference)
                return np.asarray(distance * (1.0 + x[4] / np.nanmax(ranges)))

            scale_derivative = expected(np.r_[kalman.x[:4], np.zeros(3)]) / np.nanmax(ranges)
            noise = settings.range_sigma**2 * np.eye(used.size)
            noise += settings.range_scale_sigma**2 * np.outer(scale_derivative, scale_derivative)
            if used.size:
                # of the scale's share in the direction's derivative, 1 + b_r / max z, the filter
                # takes 1
                kalman.update(
                    ranges[used],
                    lambda x, e=expected, scale_derivative=scale_derivative: (
                        derivative(lambda y: e(np.r_[y[:4], np.zeros(3)]), x)
                        + np.outer(scale_derivative, np.eye(7)[4])
                    ),
                    expected,
                    R=noise,
                )
            # the leader's velocity over ground less that through the water, over 1 s to 10 s
            leader_messages.append(mission.message[message_of_step[k]])
            t, *leader_path, course, log_speed = np.array(leader_messages)[:, :5].T
            through_water = np.trapezoid(log_speed * np.array([np.sin(course), np.cos(course)]), t)
            window_needed = min(10.0, 1.0 + 0.2 * (t[-1] - mission.message[0, 0])) - 1e-6
            if abs(course[-1] - course[0]) > 0.2:
                leader_messages = leader_messages[-1:]
            elif t[-1] - t[0] >= window_needed:
                window = t[-1] - t[0]
                current_observed = (
                    np.array(leader_path)[:, -1] - np.array(leader_path)[:, 0] - through_water
                ) / window
                if settings.assume.current:
                    kalman.update(
                        current_observed,
                        lambda x: np.eye(7)[5:],
                        lambda x: x[5:],
                        R=0.05**2 * 10.0 / window * np.eye(2),
                    )
                leader_messages = leader_messages[-1:]
        last_readings = readings
        states.append(kalman.x[:2].copy())
        covariances.append(kalman.P[[0, 0, 1], [0, 1, 1]])
    return np.array(states), np.array(covariances)


@pytest.mark.parametrize(("transmitters", "current"), [(2, False), (3, False), (3, True)])
def test_the_range_filter_is_filterpys(transmitters: int, current: bool) -> None:
    """Also where ranges are missing, which the missions of `make_truth` have."""
    truth = make_truth(offset=ABEAM, attitude=False)
    assert np.any(np.isnan(truth.slant_range[:, :2]))
    assume = Assume(current=current)
    settings = replace(SETTINGS, transmitters=transmitters, hydrophone_height=0.1, assume=assume)
    mission = measure(truth, SensorErrors(depth_sigma=0.05), seed=3, run=1)
    actual = RangeFilter(settings, truth.start).run(mission)
    position, covariance = run_filterpy(settings, mission, truth.start)
    assert actual.state[:, :2] == pytest.approx(position, abs=1e-6)
    assert actual.covariance[:, (0, 0, 1), (0, 1, 1)] == pytest.approx(
        covariance, rel=1e-5, abs=1e-9
    )


def test_the_filter_on_one_way_travel_times_is_filterpys_on_one_range() -> None:
    truth = make_truth(offset=ABEAM, attitude=False)
    mission = measure(truth, SensorErrors(), seed=3, run=1)
    ranges = mission.ranges.copy()
    ranges[np.isnan(ranges[:, 2]), 0] = np.nan
    mission = replace(mission, ranges=ranges)
    actual = OneWayTravelTime(SETTINGS, truth.start).run(mission)
    position, covariance = run_filterpy(SETTINGS, mission, truth.start, only_transmitter=2)
    assert actual.state[:, :2] == pytest.approx(position, abs=1e-5)
    assert actual.covariance[:, (0, 0, 1), (0, 1, 1)] == pytest.approx(
        covariance, rel=1e-5, abs=1e-9
    )


@pytest.mark.parametrize("method", [RangeFilter, OneWayTravelTime])
def test_a_follower_at_rest_has_the_covariance_of_a_mean_of_ranges(
    method: type[DeadReckoning],
) -> None:
    """Of n ranges from due north, biases known: variance of the northing 1 / (1 / σ₀² + n / σ²)."""
    settings = RivalSettings(
        range_scale_sigma=0.0, range_sigma=0.5, start_sigma=2.0, speed_sigma=0.0, **EXACT_LOG
    )
    navigator = method(settings, np.zeros(4))
    for count in (1, 2, 3):
        navigator.step(
            OwnMotion(0.0, 0.0, 10.0), Reception(message(0.1, 101.0), Ranges(100.0, np.nan, np.nan))
        )
        assert navigator.covariance[1, 1] == pytest.approx(
            1.0 / (1.0 / 4.0 + count / 0.25), rel=1e-3
        )
        assert navigator.covariance[0, 0] == pytest.approx(4.0, rel=1e-3)


def test_dead_reckoning_on_a_straight_line_has_the_covariance_of_its_closed_form() -> None:
    """At speed s for t = n Δt: σ₀² + σ_bv² t² + n σ_v² Δt² + slip² t along the course; across it
    s σ_bθ and s σ_θ take the places of σ_bv and σ_v.
    """
    settings = replace(SETTINGS, slip=0.05, heading_bias_sigma=0.1)
    navigator, n, speed = DeadReckoning(settings, START), 500, 1.5
    for _ in range(n):
        assert navigator.step(OwnMotion(speed, np.pi / 2, 10.0)) == []
    time, dt = 50.0, 0.1
    assert navigator.state == pytest.approx([75.0, 0.0, 1.5, 0.0], abs=1e-9)
    in_both_directions = settings.start_sigma**2 + settings.slip**2 * time
    along = (
        in_both_directions
        + settings.speed_bias_sigma**2 * time**2
        + n * (settings.speed_sigma * dt) ** 2
    )
    across = (
        in_both_directions
        + (speed * 0.1 * time) ** 2
        + n * (speed * settings.heading_sigma * dt) ** 2
    )
    # random walks of the biases, integrated twice
    walks = 4e-8 * time**3 / 3, 2.25e-8 * speed**2 * time**3 / 3
    assert navigator.covariance[0, 0] == pytest.approx(along + walks[0], rel=1e-5)
    assert navigator.covariance[1, 1] == pytest.approx(across + walks[1], rel=1e-5)
    assert navigator.covariance[2, 2] == pytest.approx(0.3**2 + 4e-8 * time + 0.2**2, rel=1e-9)
    fixes = navigator.step(
        OwnMotion(speed, 0.0, 10.0), Reception(message(9.0, 9.0), Ranges(9.0, 9.0, 9.0))
    )
    assert fixes[0].kind == FixKind.LOST


def test_an_inverted_usbl_places_the_follower_by_range_and_bearing() -> None:
    """With a start of next to no weight and exact readings the position is that of the transmitter
    less D u(heading + azimuth).
    """
    settings = RivalSettings(
        start_sigma=1e3,
        azimuth_sigma=1e-6,
        elevation_sigma=1e-3,
        range_scale_sigma=0.0,
        heading_sigma=1e-9,
        **EXACT_LOG,
    )
    heading, azimuth, distance, depth_difference = 0.4, 0.7, 60.0, 8.0
    position = np.array([20.0, -5.0]) - distance * np.array(
        [np.sin(heading + azimuth), np.cos(heading + azimuth)]
    )
    navigator = InvertedUsbl(settings, np.append(position + np.array([0.3, -0.2]), [0.0, 0.0]))
    custom = {"bearing": np.array([azimuth, np.arctan2(depth_difference, distance)])}
    # the front transmitter of a leader that heads north is 1 m ahead
    received = Reception(
        message(20.0, -6.0),
        Ranges(np.nan, np.hypot(distance, depth_difference), np.nan),
        custom=custom,
    )
    for _ in range(4):
        navigator.step(OwnMotion(0.0, heading, 10.0 + depth_difference), received)
    assert navigator.state[:2] == pytest.approx(position, abs=2e-3)
    with pytest.raises(LaisnError, match="no azimuth and elevation of an inverted USBL"):
        navigator.step(OwnMotion(0.0, heading, 18.0), received._replace(custom={}))


def test_a_geodetic_adjustment_minimises_the_weighted_squares_of_its_observations() -> None:
    settings = replace(SETTINGS, start_sigma=1.5)
    navigator = GeodeticAdjustment(settings, START)
    dead_reckoning = DeadReckoning(settings, START)
    for _ in range(50):
        navigator.step(OwnMotion(1.0, 1.0, 10.0))
        dead_reckoning.step(OwnMotion(1.0, 1.0, 10.0))
    own, measured, transmitter = OwnMotion(1.0, 1.0, 10.0), 20.0, np.array([-0.1, 24.0])
    dead_reckoning.step(own)
    navigator.step(own, Reception(message(0.0, 24.0), Ranges(np.nan, np.nan, measured)))
    root = np.linalg.cholesky(np.linalg.inv(dead_reckoning.covariance[:2, :2])).T
    sigma = np.linalg.norm(
        [settings.range_sigma, settings.range_scale_sigma, settings.range_scale_bias_sigma]
    )

    def residuals(p: Floats) -> Floats:
        return np.append(
            root @ (p - dead_reckoning.state[:2]),
            (np.linalg.norm(p - transmitter) - measured) / sigma,
        )

    best = least_squares(residuals, dead_reckoning.state[:2], xtol=1e-12)
    # iterations stop where the range's own curvature no longer matters
    assert navigator.state[:2] == pytest.approx(best.x, abs=1e-3)
    assert navigator.covariance[:2, :2] == pytest.approx(
        np.linalg.inv(best.jac.T @ best.jac), rel=1e-3
    )


def test_a_factor_graph_whose_window_holds_all_is_the_solution_of_the_whole_problem() -> None:
    """Six messages, all poses, biases, the current and common errors at once by scipy's least
    squares.
    """
    settings = replace(
        SETTINGS, lag=1e3, start_sigma=0.5, current_sigma=0.1, assume=Assume(current=True)
    )
    navigator, rng = navigator_of("factor-graph", settings, START), np.random.default_rng(5)
    readings, receptions, position = [], [], np.zeros(2)
    s, c, dt = np.sin(0.3), np.cos(0.3), 0.1
    offsets = np.array([[-s, -c], [s, c], [-0.1 * c, 0.1 * s]])
    for k in range(1, 61):
        heading = 0.9 + 0.01 * k
        position = position + dt * np.array([np.sin(heading) + 0.05, np.cos(heading) - 0.08])
        own_motion = OwnMotion(1.1 + 0.1 * rng.normal(), heading + 0.05 + 0.02 * rng.normal(), 10.0)
        readings.append(own_motion[:2])
        reception = None
        if k % 10 == 0:
            leader = message(15.0 + 0.1 * k, 6.0 - 0.05 * k, 0.3)
            true_ranges = np.linalg.norm(
                position - np.array([leader.east, leader.north]) - offsets, axis=1
            )
            reception = Reception(
                leader, Ranges(*(true_ranges + 0.05 * rng.normal() + 0.003 * rng.normal(size=3)))
            )
            receptions.append(reception)
        navigator.step(own_motion, reception)
    all_readings = np.array([readings[0], *readings])
    u = np.column_stack([np.sin(all_readings[:, 1]), np.cos(all_readings[:, 1])])
    step_displacements = (
        0.5 * dt * (all_readings[:-1, :1] * u[:-1] + all_readings[1:, :1] * u[1:]),
        0.5 * dt * (u[:-1] + u[1:]),
    )

    def residuals(unknowns: Floats) -> Floats:
        poses, (speed_bias, scale), current, common = (
            unknowns[:21].reshape(7, 3),
            unknowns[21:23],
            unknowns[23:25],
            unknowns[25:],
        )
        terms = [
            poses[0, :2] / 0.5,
            [
                poses[0, 2] / settings.heading_bias_sigma,
                speed_bias / settings.speed_bias_sigma,
                scale / settings.range_scale_bias_sigma,
                *current / 0.1,
            ],
        ]
        for i, reception in enumerate(receptions):
            leg, (pose_before, pose_after) = slice(10 * i, 10 * i + 10), poses[i : i + 2]
            displacement, path_per_speed, directions = (
                step_displacements[0][leg].sum(axis=0),
                step_displacements[1][leg].sum(axis=0),
                u[1:][leg],
            )
            across = all_readings[1:, :1][leg] * np.column_stack(
                [-directions[:, 1], directions[:, 0]]
            )
            noise = dt**2 * (
                settings.speed_sigma**2 * directions.T @ directions
                + settings.heading_sigma**2 * across.T @ across
            )
            rotation = np.array(
                [
                    [np.cos(pose_before[2]), np.sin(pose_before[2])],
                    [-np.sin(pose_before[2]), np.cos(pose_before[2])],
                ]
            )
            odometry_residual = (
                rotation @ (pose_after[:2] - pose_before[:2] - current)
                - displacement
                + speed_bias * path_per_speed
            )
            terms.append(np.linalg.solve(np.linalg.cholesky(noise), odometry_residual))
            terms.append([(pose_after[2] - pose_before[2]) / (1.5e-4 * np.sqrt(1.0))])
            transmitters = np.array([reception.message.east, reception.message.north]) + offsets
            distance = np.linalg.norm(pose_after[:2] - transmitters, axis=1)
            measured = np.array(reception.ranges)
            terms.append(
                (distance * (1.0 + common[i] / measured.max()) - measured) / settings.range_sigma
            )
            terms.append([(common[i] - scale) / settings.range_scale_sigma])
        return np.concatenate(terms)

    best = least_squares(
        residuals, np.zeros(31), x_scale="jac", xtol=1e-14, ftol=1e-14, max_nfev=2000
    )
    position_covariance = np.linalg.inv(best.jac.T @ best.jac)[18:20, 18:20]
    assert navigator.x[[0, 1, 3, 2, 4, 5, 6]] == pytest.approx(
        [*best.x[18:25]], abs=3e-2 * np.sqrt(position_covariance.max())
    )
    assert navigator.P[:2, :2] == pytest.approx(
        position_covariance, rel=0.1, abs=0.05 * position_covariance.max()
    )
    # with the heading, in units of the standard deviations
    covariance = np.linalg.inv(best.jac.T @ best.jac)[18:21, 18:21]
    sigmas = np.sqrt(np.diag(covariance))
    actual = navigator.P[np.ix_([0, 1, 3], [0, 1, 3])]
    unit = np.outer(sigmas, sigmas)
    np.testing.assert_allclose(actual / unit, covariance / unit, atol=0.1)


def test_without_gtsam_the_factor_graph_names_the_command_that_installs_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "gtsam", None)
    with pytest.raises(LaisnError, match="pip install"):
        find("factor-graph").make(SETTINGS, START)


@pytest.fixture(scope="module")
def flight() -> Any:
    changes = {"motion": "kinematic", "duration_s": 60.0, "acoustics.loss_probability": 0.2}
    return laisn_sim.fly("T7", {"navigation.variant": "inverted-usbl", **changes})


@pytest.mark.parametrize("name", RIVALS)
def test_a_rival_gives_the_same_step_by_step_as_over_a_mission(name: str, flight: Any) -> None:
    (measured,), (usbl,) = flight.measurements, flight.estimates
    settings, start = RivalSettings(lag=5.0, particles=200), usbl.state[0]
    over_mission = navigator_of(name, settings, start).run(measured)
    navigator, fixes, states, covariances = navigator_of(name, settings, start), [], [], []
    for own_motion, reception in measured.steps():
        fixes += navigator.step(own_motion, reception)
        states.append(navigator.state)
        covariances.append(navigator.covariance)
    np.testing.assert_array_equal(over_mission.state, states)
    np.testing.assert_array_equal(over_mission.covariance, covariances)
    assert over_mission.fix_kind.tolist() == [fix.kind for fix in fixes]
    kinds = {FixKind.LOST} if name == "dead-reckoning" else {FixKind.LOST, FixKind.RANGES}
    assert set(over_mission.fix_kind.tolist()) == kinds
    renavigated = laisn_sim.navigate(
        flight, {"navigation.variant": name, "navigation.rival.particles": 200}
    )
    assert np.isfinite(renavigated.estimates[0].state).all()


def test_the_built_in_usbl_is_added_for_its_navigator_alone(flight: Any) -> None:
    """As a sensor of a scenario it reads the direction of the front transmitter plus its bias."""
    assert flight.measurements[0].custom["bearing"].shape == (600, 2)
    assert (
        not laisn_sim.fly("T7", {"motion": "kinematic", "duration_s": 2.0}).measurements[0].custom
    )
    sensor = {
        "sensor": "inverted-usbl",
        "azimuth_sigma_deg": 0.0,
        "azimuth_bias_deg": 2.0,
        "elevation_sigma_deg": 0.0,
    }
    biased = laisn_sim.fly(
        "T7", {"motion": "kinematic", "duration_s": 20.0, "sensors.custom": [sensor]}
    )
    (measured,), truth = biased.measurements, biased.trajectory
    to_leader = truth.site_path("leader/tx_front") - truth.site_path("follower/hydrophone")
    true_azimuth = (
        np.arctan2(*to_leader[measured.message_step, :2].T)
        - truth.heading[measured.message_step, 1]
    )
    azimuth = measured.custom["bearing"][measured.message_step - 1, 0]
    np.testing.assert_allclose(
        np.cos(azimuth - true_azimuth), np.cos(np.deg2rad(2.0)), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"navigation.rival.particles": 3}, "particles"),
        ({"navigation.assume.known_start": False}, "known_start"),
    ],
)
def test_settings_that_rivals_cannot_use_are_refused(
    settings: dict[str, object], expected: str
) -> None:
    with pytest.raises(LaisnError, match=expected):
        laisn_sim.load("T5", {"navigation.variant": "particle", **settings})


def test_modes_of_speed_are_mixed_as_by_filterpy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Due north with an exact compass the motion is linear: position, log bias and speed."""
    monkeypatch.setattr(speed_modes, "MIXING_TIME", 0.1)
    settings = replace(
        SETTINGS,
        heading_sigma=0.0,
        heading_bias_sigma=0.0,
        range_scale_sigma=0.0,
        range_scale_bias_sigma=0.0,
        range_sigma=0.05,
    )
    rng = np.random.default_rng(3)
    dt = settings.dt
    filters = []
    for walk in (0.005, 0.2):
        kalman = KalmanFilter(dim_x=3, dim_z=1)
        kalman.P = np.diag([settings.start_sigma**2, settings.speed_bias_sigma**2, 100.0])
        kalman.F = np.array([[1.0, 0.0, dt], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        kalman.Q = np.diag([0.0, 4e-8 * dt, walk**2 * dt])
        filters.append(kalman)
    expected = IMMEstimator(filters, [0.5, 0.5], np.array([[0.97, 0.03], [0.03, 0.97]]))
    navigator = SpeedModes(settings, np.zeros(4))
    for k in range(1, 201):
        # the vehicle doubles its speed after 12 s
        speed = 1.0 if k < 120 else 2.0
        north = 0.1 * k if k < 120 else 12.0 + 0.2 * (k - 120)
        reading = speed + 0.1 + 0.2 * rng.normal()
        expected.predict()
        rows = [[0.0, 1.0, 1.0]]
        sigmas = [settings.speed_sigma]
        measured = [reading]
        reception = None
        if k % 10 == 0:
            # the front transmitter is 1 m ahead of the leader
            distance = 101.0 - north + 0.05 * rng.normal()
            rows.append([-1.0, 0.0, 0.0])
            sigmas.append(0.05)
            measured.append(distance - 101.0)
            reception = Reception(message(0.0, 100.0), Ranges(np.nan, distance, np.nan))
        # one update a step: each of filterpy's changes the modes
        for kalman in filters:
            kalman.dim_z = len(measured)
            kalman.H = np.array(rows)
            kalman.R = np.diag(np.square(sigmas))
        expected.update(np.array(measured).reshape(-1, 1))
        navigator.step(OwnMotion(reading, 0.0, 10.0), reception)
        north_and_speed = [1, 3]
        np.testing.assert_allclose(
            navigator.state[north_and_speed], expected.x.ravel()[[0, 2]], atol=2e-5
        )
        np.testing.assert_allclose(
            navigator.covariance[np.ix_(north_and_speed, north_and_speed)],
            expected.P[np.ix_([0, 2], [0, 2])],
            rtol=1e-3,
            atol=1e-7,
        )
        weights = navigator.weights
    # the weights of the two modes at the end
    np.testing.assert_allclose(weights, expected.cbar, atol=1e-3)


def leader_message(k: int, current: Floats, turn: float = 0.0) -> LeaderMessage:
    """A leader at 1.5 m/s through water that moves, a message a second."""
    heading = 0.4 + turn
    displacement = k * (1.5 * np.array([np.sin(heading), np.cos(heading)]) + current)
    return LeaderMessage(float(k), *displacement.tolist(), heading, 1.5, 10.0)


def test_the_leaders_track_shows_the_current() -> None:
    """Windows grow from 1 s to 10 s; there is none across a turn."""
    current = np.array([0.3, -0.2])
    track = LeaderTrack()
    times = []
    for k in range(80):
        observation = track.receive(leader_message(k, current))
        if observation is not None:
            np.testing.assert_allclose(observation.current, current, atol=1e-12)
            window = k - (times[-1] if times else 0)
            assert observation.variance == pytest.approx(0.05**2 * 10.0 / window)
            times.append(k)
    windows = np.diff([0, *times])
    assert windows[0] <= 2
    assert np.all(np.diff(windows) >= 0)
    assert windows[-1] == 10
    assert track.receive(leader_message(80, current, turn=0.3)) is None


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("current", [False, True])
def test_all_rivals_take_the_current_from_the_leaders_track(name: str, current: bool) -> None:
    """A follower that rests in the water, beside the leader's start, and hears no range."""
    water_velocity = np.array([0.3, -0.2])
    settings = replace(SETTINGS, speed_sigma=0.01, assume=Assume(current=current))
    navigator = navigator_of(name, replace(settings, **EXACT_LOG), np.zeros(4))
    for k in range(1, 121):
        for _ in range(9):
            navigator.step(OwnMotion(0.0, 0.0, 10.0), None)
        reception = Reception(leader_message(k, water_velocity), Ranges(np.nan, np.nan, np.nan))
        navigator.step(OwnMotion(0.0, 0.0, 10.0), reception)
    expected = water_velocity if current else np.zeros(2)
    np.testing.assert_allclose(navigator.state[2:], expected, atol=0.03)


def test_the_first_step_whose_readings_are_not_finite_is_named(flight: Any) -> None:
    speed = flight.measurements[0].speed.copy()
    speed[[2, 6]] = np.nan, np.inf
    broken = replace(flight.measurements[0], speed=speed)
    with pytest.raises(LaisnError, match="step 3: log, compass or depth are not finite"):
        navigator_of("ekf", SETTINGS, START).run(broken)
