"""Means in studies: intervals over realizations and runs in closed form, and differences that
are paired.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from scipy.stats import beta, binomtest

from experiments.campaign import montecarlo
from experiments.flight.library import load_scenario
from experiments.study import measure
from experiments.study.estimate import Condition, Results, over_realizations, over_runs
from experiments.study.measure import (
    facts_of,
    records_of_run,
)
from laisn.arrays import records
from laisn.swarm import ESTIMATE
from sim import tracking
from sim.power import DISC_DIAMETER_M, disc_power, thruster_power
from sim.scenario.formation import Station
from sim.scenario.parts import MotionSettings
from sim.tracking import STATION_PLACE, track_errors
from tests import straight
from tests.synthetic import make_scenario, make_trajectory


def test_few_realizations_have_the_interval_of_student():
    """t(0.975, 2) = 4.3027 (any table); the means 1, 2, 3 have s = 1."""
    actual = over_realizations(np.array([1.0, 2.0, 3.0]))
    assert actual.value == 2.0
    assert actual.high - 2.0 == pytest.approx(4.3027 / math.sqrt(3), rel=1e-4)
    assert 2.0 - actual.low == pytest.approx(4.3027 / math.sqrt(3), rel=1e-4)


def test_a_single_realization_has_no_interval():
    assert math.isnan(over_realizations(np.array([1.0])).low)


def test_intervals_over_many_realizations_have_nominal_coverage():
    random = np.random.default_rng(1)
    hits = 0
    for _ in range(300):
        actual = over_realizations(random.normal(5.0, 2.0, 40))
        hits += actual.low <= 5.0 <= actual.high
    assert 0.90 < hits / 300 < 0.98


def test_realizations_have_equal_weight_for_any_scatter_of_runs():
    actual = over_runs([np.array([0.0, 4.0]), np.array([4.0, 4.0])])
    assert actual.value == 3.0


def test_shares_have_the_limits_of_clopper_and_pearson():
    actual = over_runs([np.zeros(60)], shares=True)
    assert actual.high == pytest.approx(1 - 0.025 ** (1 / 60), rel=1e-9)
    assert actual.low == 0.0


def test_an_outcome_absent_from_several_realizations_has_an_interval():
    """A realization counts as one run: 0 of 12 leaves up to 1 − 0.025^(1/12)."""
    actual = over_runs([np.zeros(12)] * 12, shares=True)
    assert (actual.value, actual.low) == (0.0, 0.0)
    assert actual.high == pytest.approx(1 - 0.025 ** (1 / 12), rel=1e-9)
    assert over_runs([np.ones(5)] * 12, shares=True).low == pytest.approx(
        0.025 ** (1 / 12), rel=1e-9
    )
    difference = over_runs([np.zeros(12)] * 12, shares=True, paired=True)
    assert difference.low < 0.0 < difference.high


def test_realizations_of_one_run_each_have_about_the_limits_of_clopper_and_pearson():
    """The means of 20 such realizations scatter as those of 19 runs: 5 of 20 have limits between
    those of SciPy for 4 and for 5 of 19.
    """
    share = over_runs([np.array([float(i < 5)]) for i in range(20)], shares=True)
    low, high = (binomtest(k, 19).proportion_ci(method="exact") for k in (4, 5))
    assert low.low < share.low < high.low
    assert low.high < share.high < high.high


def test_shares_of_realizations_have_the_limits_of_the_effective_number_of_runs():
    """Korn and Graubard: p (1 − p) over the variance of the mean, 25, times (t₃₉ / t₃)², from any
    table of Student's t.

    Four realizations of ten runs, of which 1, 2, 5 and 2 have the outcome: their mean is 0.25, its
    variance 0.03 / 4.
    """
    actual = over_runs(
        [(np.arange(10) < count).astype(float) for count in (1, 2, 5, 2)], shares=True
    )
    effective_runs = 0.25 * 0.75 / (0.03 / 4) * (2.0227 / 3.1824) ** 2
    assert actual.value == 0.25
    assert actual.low == pytest.approx(
        beta.ppf(0.025, 0.25 * effective_runs, 0.75 * effective_runs + 1), rel=1e-3
    )
    assert actual.high == pytest.approx(
        beta.ppf(0.975, 0.25 * effective_runs + 1, 0.75 * effective_runs), rel=1e-3
    )
    # realizations that scatter less than single runs would do not make more of them
    equal_realizations = over_runs([(np.arange(10) < 2).astype(float)] * 4, shares=True)
    exact = binomtest(8, 40).proportion_ci(method="exact")
    assert (equal_realizations.low, equal_realizations.high) == pytest.approx(
        (exact.low, exact.high), rel=1e-9
    )


def test_shares_of_different_realizations_have_nominal_coverage():
    """Every realization has a chance of its own, so that its runs are not independent of one
    another.
    """
    random = np.random.default_rng(5)
    hits = 0
    for _ in range(400):
        chances = random.beta(0.3, 2.7, 15)
        actual = over_runs(
            [(random.random(20) < chance).astype(float) for chance in chances], shares=True
        )
        hits += actual.low <= 0.1 <= actual.high
    assert hits / 400 > 0.93


def test_realizations_that_are_all_alike_have_no_interval():
    actual = over_realizations(np.full(30, 2.0))
    assert actual.value == 2.0
    assert math.isnan(actual.low)


def results():
    """60 runs of two arms, whose errors differ by 0.5 m, and scatter together by 1 m."""
    random = np.random.default_rng(3)
    noise = random.normal(0.0, 1.0, 60)
    rows = [{"point": 0, "arm": arm, "follower": "f", "realization": 0} for arm in ("a", "b")]
    run_arrays = [
        {"e_p_mean_m": (10 + noise).tolist()},
        {"e_p_mean_m": (9.5 + noise + random.normal(0, 0.01, 60)).tolist()},
    ]
    return Results.of(rows, [(row, arrays) for row, arrays in zip(rows, run_arrays, strict=True)])


def test_differences_of_arms_are_paired_by_run():
    """Noise of σ = 1 that both arms share drops out; what is left has σ = 0.01."""
    actual = results().difference(Condition(0, "b", "f"), "a", "e_p_mean_m")
    assert actual.value == pytest.approx(-0.5, abs=0.01)
    assert actual.high - actual.low < 0.02
    unpaired = results().estimate(Condition(0, "b", "f"), "e_p_mean_m")
    assert unpaired.high - unpaired.low > 0.3


def test_a_thruster_at_rest_takes_the_power_of_momentum_theory():
    """T^1.5 / √(2ρA) at rest; T v where v is large (both in any textbook on propellers)."""
    area = math.pi * DISC_DIAMETER_M**2 / 4
    assert disc_power(np.array([-9.0]), np.zeros(1), 1026.0) == pytest.approx(
        27.0 / math.sqrt(2 * 1026.0 * area)
    )
    assert disc_power(np.array([0.01]), np.array([50.0]), 1026.0) == pytest.approx(0.5, rel=1e-4)


def test_point_motion_keeps_its_track_and_depth_and_has_no_energy():
    scenario = load_scenario("T3", ["motion=kinematic", "duration_s=30"])
    (facts,) = facts_of(MotionSettings.of(scenario), montecarlo.simulate_mission(scenario))
    assert facts["track_error_max_m"] < 1e-6
    assert facts["depth_error_max_m"] < 1e-9
    assert facts["energy_j"] is None
    assert facts["closest_approach_m"] <= math.hypot(facts["range_mean_m"], 2.0)


def test_energy_is_mean_power_times_time_and_covers_the_work_against_the_water():
    scenario = load_scenario("T5", ["duration_s=40"])
    trajectory = montecarlo.simulate_mission(scenario)
    (facts,) = facts_of(MotionSettings.of(scenario), trajectory)
    assert facts["energy_j"] == pytest.approx(40 * facts["power_mean_w"])
    # no disc can push against the water for less than the work that it does there
    speed_through_water = np.linalg.norm(
        trajectory.velocity[:, 1] - trajectory.water_velocity[:, 1], axis=1
    )
    assert facts["power_mean_w"] > 0.99 * float(
        np.mean(np.abs(trajectory.effector_states[:, 1, 0]) * speed_through_water)
    )


ALONG_AND_ACROSS = np.broadcast_to([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (2, 2, 3)).copy()
"""Two thrusters of each vehicle: one along the hull, one to port."""


def test_facts_of_a_mission_are_those_of_its_motion():
    """A leader at rest 1 m too deep, pitched by 5°; a follower that drifts aside by 3 cm/s and
    down by 1 cm/s.
    """
    scenario = straight.make_scenario()
    depth = scenario.followers[0].depth_m
    flown = straight.make_trajectory(
        (0.0, 40.0, -depth),
        leader=(0.0, 0.0, -9.0),
        follower_velocity=(0.0, 0.03, -0.01),
        heading_pitch_roll=(np.pi / 2, np.deg2rad(5.0), 0.0),
    )
    thrust = np.zeros((flown.time.size, 2, 2))
    thrust[:, 0, 0], thrust[:, 1, 1] = 16.0, -9.0
    flown = replace(flown, effector_states=thrust, effector_force=ALONG_AND_ACROSS)
    (facts,) = facts_of(MotionSettings.of(scenario), flown)
    time, area = flown.time, math.pi * DISC_DIAMETER_M**2 / 4
    # at rest a disc takes T^1.5 / √(2ρA)
    root_of_density_and_area = math.sqrt(2 * scenario.ocean.density_kg_m3 * area)
    north, down = 40.0 + 0.03 * time, 0.01 * time
    track_error = track_errors(MotionSettings.of(scenario), flown)[:, 0]
    # abeam, the fix is moved along the leader by Δz sin φ and keeps its distance
    distance, depth_offset = north[10::10], (depth + down - 9.0)[10::10]
    fix_shift_along = depth_offset * math.sin(math.radians(5.0))
    fix_shift = np.hypot(fix_shift_along, distance - np.sqrt(distance**2 - fix_shift_along**2))
    assert facts == pytest.approx(
        {
            "track_error_rms_m": math.sqrt(sum(track_error**2) / track_error.size),
            "track_error_max_m": max(track_error),
            "track_error_end_m": track_error[-1],
            "cross_track_rms_m": math.sqrt(sum(north**2) / north.size),
            "cross_track_max_m": max(north),
            "closest_horizontal_m": 40.0,
            "closest_in_layer_m": None,
            "depth_error_rms_m": math.sqrt(sum(down**2) / time.size),
            "depth_error_max_m": 0.2,
            "touched": 0.0,
            "closest_approach_m": min(np.hypot(north, depth + down - 9.0)),
            "range_mean_m": 40.3,
            "depth_offset_rms_m": math.sqrt(sum((depth + down - 9.0) ** 2) / time.size),
            "pitch_fix_error_m": sum(fix_shift) / 20,
            "pitch_rms_deg": 0.0,
            "pitch_max_deg": 0.0,
            "power_mean_w": 27.0 / root_of_density_and_area,
            "energy_j": 20.0 * 27.0 / root_of_density_and_area,
            "leader_pitch_rms_deg": 5.0,
            "leader_pitch_max_deg": 5.0,
            "leader_depth_error_rms_m": 1.0,
            "leader_power_mean_w": 64.0 / root_of_density_and_area,
            "leader_energy_j": 20.0 * 64.0 / root_of_density_and_area,
        },
        abs=1e-9,
    )


def test_without_stations_none_are_computed(monkeypatch):
    monkeypatch.setattr(tracking, "stations_along", None)
    flown = straight.make_trajectory((0.0, 40.0, -10.0))
    assert track_errors(MotionSettings.of(straight.make_scenario()), flown).shape == (
        flown.time.size,
        1,
    )


def test_a_follower_that_rises_is_as_far_off_its_depth_as_one_that_sinks():
    scenario = straight.make_scenario()
    start = (0.0, 40.0, -scenario.followers[0].depth_m)
    (facts,) = facts_of(
        MotionSettings.of(scenario),
        straight.make_trajectory(start, follower_velocity=(0.0, 0.0, 0.02)),
    )
    assert facts["depth_error_max_m"] == pytest.approx(0.4)


def test_a_thruster_works_against_the_water_that_it_meets_along_the_hull():
    """1.2 m/s over ground in a current of 0.4 m/s from behind, nose up by 60°: 0.4 m/s along the
    hull.
    """
    flown = straight.make_trajectory(
        (0.0, 40.0, -10.0),
        leader_velocity=(1.2, 0.0, 0.0),
        heading_pitch_roll=(np.pi / 2, np.pi / 3, 0.0),
    )
    thrust, water = np.zeros((flown.time.size, 2, 2)), np.zeros_like(flown.water_velocity)
    thrust[:, 0, 0], water[..., 0] = 8.0, 0.4
    flown = replace(
        flown, effector_states=thrust, effector_force=ALONG_AND_ACROSS, water_velocity=water
    )
    forward = disc_power(np.array(8.0), np.array(0.4), 1026.0)
    assert thruster_power(flown, 0, 1026.0) == pytest.approx(np.full(201, forward))
    # against its way it pushes into its own wake
    backwards = disc_power(np.array(8.0), np.array(0.0), 1026.0)
    assert thruster_power(replace(flown, effector_states=-thrust), 0, 1026.0) == pytest.approx(
        np.full(201, backwards)
    )


def test_powers_of_thrusters_add_up_and_one_across_the_hull_has_no_inflow():
    flown = straight.make_trajectory((0.0, 40.0, -10.0), leader_velocity=(1.2, 0.0, 0.0))
    thrust = np.zeros((flown.time.size, 2, 2))
    thrust[:, 0] = [8.0, 5.0]
    flown = replace(flown, effector_states=thrust, effector_force=ALONG_AND_ACROSS)
    power = float(disc_power(8.0, 1.2, 1026.0) + disc_power(5.0, 0.0, 1026.0))
    assert thruster_power(flown, 0, 1026.0) == pytest.approx(np.full(201, power))


def test_a_run_is_measured_by_its_stations_errors_and_powers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """3 s of ten followers, with everything that is measured set by hand, follower by follower."""
    scenario = make_scenario(3.0, 10)
    trajectory = make_trajectory(scenario)
    stations = [
        Station(behind_m=5.0, depth_m=10.0 + follower_index // 2) for follower_index in range(10)
    ]
    scenario = scenario.model_copy(
        update={
            "followers": tuple(
                follower.model_copy(update={"route": None, "station": station})
                for follower, station in zip(scenario.followers, stations, strict=True)
            )
        }
    )
    instants, number = trajectory.time.size, np.arange(1.0, 11.0)
    thrust = np.zeros_like(trajectory.effector_states)
    # the leader's do not count
    thrust[:, 0], thrust[:, 1:, 3] = 50.0, -number
    trajectory = replace(trajectory, effector_states=thrust)
    estimates = records(ESTIMATE, instants, 10)
    estimates.position[0] = 99.0
    for follower_index, name in enumerate(trajectory.names[1:]):
        hydrophone = trajectory.site_path(f"{name}/hydrophone")[1:]
        estimates.position[1:, follower_index] = hydrophone[:, :2] + (
            follower_index + 1
        ) * np.array([0.3, -0.4])
    # on legs 0.1 to 1 m off, in the turn, the last 11 of 31 instants, up to 1.2 to 12 m
    turning = np.arange(instants) >= instants - 11
    distance = np.where(
        turning[:, None], np.linspace(-2.4, 1.2, instants)[:, None] * number, 0.1 * number
    )
    true_places = records(STATION_PLACE, instants, 10)
    true_places.rate[turning] = -1.1e-3
    true_places.rate[~turning] = 0.9e-3
    loop = SimpleNamespace(
        state=SimpleNamespace(
            concluded=SimpleNamespace(state=np.moveaxis(estimates.position[1:], 0, 1))
        ),
        gated=np.zeros(10, int),
    )
    mission = SimpleNamespace(controller=loop)
    monkeypatch.setattr(measure, "closed_loop_mission", lambda *_, **__: mission)
    monkeypatch.setattr(measure, "fly_mission", lambda *_: trajectory)
    monkeypatch.setattr(measure, "track_errors", lambda *_: distance)
    monkeypatch.setattr(measure, "true_stations", lambda *_: true_places)
    run = pa.Table.from_pylist(records_of_run(scenario, 0)).to_pydict()
    np.testing.assert_allclose(run["station_rms_m"], np.sqrt(np.mean(distance**2, axis=0)))
    np.testing.assert_allclose(
        run["station_p95_m"],
        [
            sorted(column)[28] + 0.5 * (sorted(column)[29] - sorted(column)[28])
            for column in distance.T
        ],
    )
    np.testing.assert_allclose(run["station_max_m"], distance.max(axis=0))
    np.testing.assert_allclose(run["station_turn_max_m"], distance[turning].max(axis=0))
    np.testing.assert_allclose(run["station_leg_rms_m"], 0.1 * number)
    np.testing.assert_allclose(run["track_error_end_m"], distance[-1])
    assert run["lost"] == (distance.max(axis=0) > 10.0).astype(float).tolist()
    assert 0 < sum(run["lost"]) < 10
    np.testing.assert_allclose(run["e_p_mean_m"], 0.5 * number)
    # discs at rest: T^1.5 / √(2ρA)
    area = np.pi * DISC_DIAMETER_M**2 / 4
    np.testing.assert_allclose(run["power_mean_w"], number**1.5 / np.sqrt(2 * 1026.0 * area))
    depths = [vehicle.held_depth_m for vehicle in (scenario.leader, *scenario.followers)]
    for vehicle in range(1, 11):
        others = [other for other in range(11) if other != vehicle]
        closest = [
            np.hypot(
                *(trajectory.position[:, vehicle, :2] - trajectory.position[:, other, :2]).T
            ).min()
            for other in others
        ]
        assert run["closest_horizontal_m"][vehicle - 1] == pytest.approx(min(closest))
        in_layer = [
            closest_to_other
            for closest_to_other, other in zip(closest, others, strict=True)
            if abs(depths[vehicle] - depths[other]) < 1.0
        ]
        assert run["closest_in_layer_m"][vehicle - 1] == (
            pytest.approx(min(in_layer)) if in_layer else None
        )
