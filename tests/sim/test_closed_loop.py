"""Followers that steer by their own estimates."""

from copy import deepcopy
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.campaign.montecarlo import simulate_mission
from experiments.flight.fly import fly
from experiments.flight.library import ROUTES, load_scenario
from experiments.studies.closed_loop import findings as study
from experiments.study import measure as study_measure
from experiments.study.file import study_of
from experiments.study.measure import records_of_run
from experiments.study.plan import plan_of
from laisn.arrays import Floats
from laisn.estimates import FixKind
from sim.closed_loop import closed_loop_mission, guide, simulate_closed_loop
from sim.flight import navigate
from sim.scenario.file import validate
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import Scenario
from sim.sensing.observation import observe
from sim.simulation import simulate_motion
from sim.trajectory import StateHistory, Trajectory
from tests import synthetic
from tests.experiments.study.cells import cells_of

ENTRIES = {entry.arm: entry for entry in plan_of(study_of("closed-loop", {})).entries}
"""Entries of the study of closed loops by their arms."""


def mission(*assignments: str, route: str = "T6", duration: float = 60.0) -> Scenario:
    """A follower that steers along a route by its estimates."""
    return load_scenario(
        route,
        [
            "followers.0.guidance_position=estimate",
            "navigation.variant=laisn-3-2",
            f"duration_s={duration}",
            *assignments,
        ],
    )


def position_differences(scenario: Scenario, follower: int = 0) -> Floats:
    """Estimated positions used for control, less those of navigation on the finished mission,
    shape (n, 2), [m].
    """
    trajectory, loop = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    measured, estimates = flight.measurements[follower], flight.estimates[follower]
    assert measured.message_step.size > 5
    if scenario.navigation.variant != "tight":
        assert loop.gated[follower] == np.count_nonzero(estimates.fix_kind == FixKind.GATED)
    in_flight = loop.state.concluded.state[follower, :, :2]
    return np.asarray(in_flight - estimates.state[:, :2])


WITH_LOSSES_AND_DRIFT = (
    "acoustics.loss_probability=0.2",
    "acoustics.burst_probability=0.1",
    "acoustics.surface_echo_probability=0.1",
    "sensors.speed_drift_m_s=0.3",
    "sensors.heading_drift_deg=9",
    "sensors.leader_position_drift_m_s=0.1",
)
WITH_ATTITUDE = (
    "leader.broadcast_attitude=true",
    "navigation.use_attitude=true",
    "sensors.leader_attitude_sigma_deg=0.5",
    "sensors.leader_attitude_senses_acceleration=true",
    "sensors.depth_sigma_m=0.05",
    "leader.depth_profile=[[0, 8], [10, 8], [30, 12]]",
)
WITH_TRAVEL_TIME = (
    "acoustics.travel_time=true",
    "acoustics.ping_slot_s=0.13",
    "acoustics.clock_drift_ppm=30",
)


@pytest.mark.parametrize(
    "assignments",
    [
        (),
        ("timing.filter_step_s=0.5", "timing.message_interval_s=5"),
        ("timing.message_interval_s=0.1", "duration_s=5"),
        WITH_LOSSES_AND_DRIFT,
        WITH_ATTITUDE,
    ],
)
def test_navigation_after_the_mission_gives_the_estimates_that_steered_it(
    assignments: tuple[str, ...],
) -> None:
    assert not position_differences(mission("navigation.variant=tight", *assignments)).any()


@pytest.mark.parametrize(
    "assignments",
    [
        WITH_TRAVEL_TIME,
        (
            *WITH_TRAVEL_TIME,
            *WITH_LOSSES_AND_DRIFT,
            "acoustics.bottom_echo_probability=0.1",
            "acoustics.max_range_m=90",
            "acoustics.sound_speed_profile=[[0, 1500], [9, 1490], [30, 1510]]",
        ),
        (
            *WITH_ATTITUDE,
            *WITH_TRAVEL_TIME,
            "sensors.leader_gyro_time_constant_s=30",
            "sensors.leader_attitude_offset_sigma_deg=1",
        ),
    ],
)
@pytest.mark.parametrize("variant", ["laisn-3-1", "tight"])
def test_with_travel_times_navigation_after_the_mission_agrees_but_for_rounding(
    variant: str, assignments: tuple[str, ...]
) -> None:
    """Positions between two instants, and the decay of the gyros' error, are computed in another
    order in flight.
    """
    difference = position_differences(mission(f"navigation.variant={variant}", *assignments))
    np.testing.assert_allclose(difference, 0.0, rtol=0, atol=1e-9)


def test_of_two_messages_that_arrive_in_one_step_the_first_is_kept() -> None:
    """The vehicles approach each other at 2 m/s; nearer than 150 m sound takes less than a filter
    step, which is also the interval of messages.
    """
    assignments = (
        "acoustics.travel_time=true",
        "timing.message_interval_s=0.1",
        "duration_s=5",
        'followers.0={name="f", waypoints=[[0, 154, 0], [20, 134, 0]], depth_m=10, '
        'guidance_position="estimate"}',
        *WITH_ATTITUDE[:4],
        "sensors.leader_gyro_time_constant_s=3",
    )
    scenario = mission(*assignments)
    np.testing.assert_allclose(position_differences(scenario), 0.0, rtol=0, atol=1e-9)
    trajectory, _ = simulate_closed_loop(scenario)
    sent = observe(trajectory, SensingSettings.of(scenario)).emission_step
    assert np.count_nonzero(np.diff(sent) == 2) == 1


def test_the_gate_counts_filter_steps() -> None:
    """With steps of 0.5 s it rejects as many fixes by echoes as navigation after the mission, which
    depends on the steps since the last good fix.
    """
    echoes = (
        "acoustics.surface_echo_probability=0.4",
        "timing.filter_step_s=0.5",
        "navigation.variant=laisn-2",
    )
    np.testing.assert_allclose(position_differences(mission(*echoes)), 0.0, rtol=0, atol=1e-9)


def test_messages_with_travel_times_arrive_three_steps_later_or_more() -> None:
    scenario = mission(*WITH_TRAVEL_TIME)
    trajectory, _ = simulate_closed_loop(scenario)
    steps_after_second = (
        navigate(scenario, trajectory).measurements[0].message_step % scenario.message_every
    )
    assert steps_after_second.size > 50
    assert steps_after_second.min() >= 3


EXACT_SENSORS = (
    "sensors.speed_bias_m_s=0",
    "sensors.speed_sigma_m_s=0",
    "sensors.heading_bias_deg=0",
    "sensors.heading_sigma_deg=0",
    "sensors.gyro_sigma_deg_s=0",
    "sensors.tilt_sigma_deg=0",
)
EASTWARD_CURRENT = ("ocean.current_speed_m_s=0.4", "ocean.current_direction_deg=90")


def test_a_follower_with_exact_estimates_moves_as_with_the_truth() -> None:
    """But for the lag T of its log: while the speed changes by Δv, the distance by the log and the
    true one come to differ by T Δv.

    Position feedback corrects a part of that. The route changes its speed at the start, at 45 s
    and at 95 s.
    """
    exact = (
        *EXACT_SENSORS,
        "acoustics.range_tau_m=[0,0,0]",
        "acoustics.range_scale_mean_m=0",
        "acoustics.range_scale_sigma_m=0",
    )
    flight, _ = fly(mission(*exact, duration=100.0))
    by_truth, _ = fly(mission(*exact, "followers.0.guidance_position=truth", duration=100.0))
    error = np.hypot(*(flight.estimates[0].state[:, :2] - flight.hydrophone(0)[:, :2]).T)
    distance = np.linalg.norm(
        flight.trajectory.position[:, 1] - by_truth.trajectory.position[:, 1], axis=1
    )
    assert error.max() < 0.005
    assert 0.0 < np.median(distance) < 0.01
    assert distance.max() < 0.3
    speed, lag = by_truth.trajectory.forward_speed[:, 1], 1.0
    for begin, end in ((0, 440), (440, 900), (900, 1001)):
        assert distance[begin:end].max() < lag * np.ptp(speed[begin:end])


@pytest.mark.system
def test_commands_are_a_function_of_readings_and_estimates() -> None:
    """A disturbed truth of motion and water changes the command of the follower that steers by the
    truth, and no other.
    """
    followers = [
        {"route": "T6", "guidance_position": "truth"},
        {"route": "T6", "guidance_position": "estimate"},
        {"station": {"behind_m": 15.0, "port_m": 9.0, "depth_m": 14.0}},
    ]
    proximity = {"range_m": 30.0, "full_avoidance_range_m": 3.0}
    scenario = validate(
        {
            "name": "mixed",
            "duration_s": 5.0,
            "followers": followers,
            "formation": {"proximity": proximity},
        },
        "test",
    )
    trajectory, loop = simulate_closed_loop(scenario)
    truth = StateHistory(
        *(
            array.copy()
            for array in (
                trajectory.pose,
                trajectory.twist,
                trajectory.water_velocity,
                trajectory.effector_states,
            )
        )
    )
    disturbed = deepcopy(truth)
    for array in disturbed:
        array[50, 1:] += np.linspace(0.1, 0.7, array[50, 1:].size).reshape(array[50, 1:].shape)
    commands = []
    for motion in (truth, disturbed):
        state = deepcopy(loop.state)
        guide(50, motion, state)
        commands.append(state.routes.command)
    np.testing.assert_array_equal(commands[1][[0, 2, 3]], commands[0][[0, 2, 3]])
    assert (commands[1][1] != commands[0][1]).any()


@pytest.mark.parametrize("variant", ["laisn-3-2", "tight"])
def test_a_follower_without_receptions_drifts_with_the_water(variant: str) -> None:
    """Its readings are those in still water, so that its motion is the sum of that in still water
    and of the current, 0.4 m/s eastwards.
    """
    without_receptions = (
        "leader.waypoints=[[0, 0, 0], [300, 0, 300]]",
        "followers.0.waypoints=[[0, 20, 0], [300, 20, 300]]",
        "acoustics.max_range_m=1",
        f"navigation.variant={variant}",
        *EXACT_SENSORS,
    )
    in_still_water, _ = simulate_closed_loop(mission(*without_receptions, duration=60.0))
    in_current, _ = simulate_closed_loop(
        mission(*without_receptions, *EASTWARD_CURRENT, duration=60.0)
    )
    difference = in_current.position[:, 1] - in_still_water.position[:, 1]
    difference_rate = (difference[600] - difference[300]) / 30.0
    assert difference_rate == pytest.approx([0.4, 0.0, 0.0], abs=0.002)


@pytest.mark.parametrize("variant", ["laisn-3-2", "tight"])
def test_in_a_current_a_follower_keeps_to_its_route(variant: str) -> None:
    """By its estimate of the current (`tight`), or by the integral of its cross-track error."""
    settings = (
        "leader.waypoints=[[0, 0, 0], [600, 0, 600]]",
        "followers.0.waypoints=[[0, 20, 0], [600, 20, 600]]",
        f"navigation.variant={variant}",
        *EXACT_SENSORS,
        *EASTWARD_CURRENT,
    )
    trajectory, loop = simulate_closed_loop(mission(*settings, duration=400.0))
    assert np.abs(loop.state.concluded.state[0, 3000:, 0] - 20.0).mean() < 0.4
    assert trajectory.position[3000:, 1, 1] - trajectory.time[3000:] == pytest.approx(0.0, abs=1.0)


def test_a_follower_without_receptions_follows_the_drift_of_its_log_and_compass() -> None:
    """It keeps 1 m/s northwards by a log that reads 0.2 m/s too much and a compass that reads 5°
    too much, and thus moves at 0.8 m/s towards −5°.
    """
    scenario = mission(
        "leader.waypoints=[[0, 0, 0], [300, 0, 300]]",
        "followers.0.waypoints=[[0, 20, 0], [300, 20, 300]]",
        "acoustics.max_range_m=1",
        "sensors.speed_bias_m_s=0.2",
        "sensors.speed_sigma_m_s=0",
        "sensors.heading_bias_deg=5",
        "sensors.heading_sigma_deg=0",
        duration=120.0,
    )
    flight, _ = fly(scenario)
    assert np.isnan(flight.measurements[0].ranges).all()
    ground_velocity = (
        flight.trajectory.position[1200, 1] - flight.trajectory.position[600, 1]
    ) / 60.0
    expected = 0.8 * np.array([-np.sin(np.deg2rad(5.0)), np.cos(np.deg2rad(5.0))])
    assert ground_velocity[:2] == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize("variant", ["laisn-2", "tight"])
def test_between_filter_steps_a_follower_dead_reckons(variant: str) -> None:
    """From the position and with the velocity of the last estimate."""
    scenario = mission(f"navigation.variant={variant}", "timing.filter_step_s=0.5", duration=10.0)
    mission_under_way = closed_loop_mission(scenario)
    positions = []
    for k in range(mission_under_way.last + 1):
        mission_under_way.advance(k)
        positions.append(mission_under_way.controller.state.estimates.position[0].copy())
    state = navigate(scenario, mission_under_way.trajectory()).estimates[0].state
    for ticks in range(5):
        expected = state[:-1, :2] + 0.1 * ticks * state[:-1, 2:]
        actual = np.array(positions[5 + ticks : -1 : 5])
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9)


def test_a_follower_without_a_position_goes_parallel_to_its_route() -> None:
    """Without receptions and a known start it turns as planned, and errors of its position are not
    corrected.
    """
    without_position = (
        "navigation.variant=tight",
        "navigation.assume.known_start=false",
        "acoustics.max_range_m=0.001",
        *EXACT_SENSORS,
    )
    dead_reckoned, _ = simulate_closed_loop(mission(*without_position, duration=20.0))
    by_truth, _ = simulate_closed_loop(
        mission("followers.0.guidance_position=truth", duration=20.0)
    )
    distance = np.linalg.norm(dead_reckoned.position[:, 1] - by_truth.position[:, 1], axis=1)
    assert 0.02 < distance.max() < 0.5


@pytest.mark.parametrize("uses_attitude", [False, True])
def test_followers_of_one_mission_move_as_each_alone(uses_attitude: bool) -> None:
    """Each moves as in a mission of its own, by truth or by estimate, with exact sensors.

    Whether attitude is broadcast is set explicitly: the default depends on whether there are
    stations.
    """
    routes = [{"route": "T6", "guidance_position": by} for by in ("truth", "estimate")]
    stations = [
        {"station": {"behind_m": 15.0, "port_m": side, "depth_m": 14.0}, "guidance_position": by}
        for side, by in ((-9.0, "truth"), (9.0, "estimate"))
    ]

    exact_sensors = "heading_sigma_deg", "speed_sigma_m_s", "gyro_sigma_deg_s", "tilt_sigma_deg"

    def fly_followers(followers: list[dict[str, Any]]) -> Trajectory:
        table = {
            "name": "mixed",
            "duration_s": 30.0,
            "followers": followers,
            "leader": {"broadcast_attitude": uses_attitude},
            "navigation": {"use_attitude": uses_attitude},
            "sensors": dict.fromkeys(exact_sensors, 0.0),
            "acoustics": {"range_tau_m": [0.0, 0.0, 0.0], "range_scale_sigma_m": 0.0},
        }
        return simulate_closed_loop(validate(table, "test"))[0]

    together = fly_followers([*routes, *stations])
    for i, follower in enumerate([*routes, *stations]):
        np.testing.assert_allclose(
            fly_followers([follower]).position[:, 1], together.position[:, i + 1], rtol=0, atol=1e-9
        )


def test_a_campaign_refuses_a_closed_loop_whose_path_depends_on_the_run() -> None:
    with pytest.raises(
        ValueError, match=r"followers\.0\.guidance_position = 'estimate'.*laisn fly --run N"
    ):
        simulate_mission(mission())


def test_the_point_motion_cannot_be_steered() -> None:
    with pytest.raises(ValueError, match="needs motion = 'physics'"):
        mission("motion=kinematic")


def test_a_fleet_is_measured_follower_by_follower(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates of follower i are off by i times 3 m east and 4 m south; followers are on their
    routes, but the second is 8 m off in the last second.
    """
    calls = []

    def mission(scenario: Scenario, *, whole: bool) -> Any:
        assert not whole
        calls.append(scenario)
        kinematic = tuple(
            f.model_copy(update={"guidance_position": "truth"}) for f in scenario.followers
        )
        changes = {"motion": "kinematic", "duration_s": 10.0, "followers": kinematic}
        short_scenario = scenario.model_copy(update=changes)
        trajectory = simulate_motion(short_scenario)
        position = trajectory.position.copy()
        position[:, 2, 0] += np.where(trajectory.time > 9.05, 8.0, 0.0)
        displaced = synthetic.moved(trajectory, position=position)
        hydrophones = [
            displaced.site_path(f"{follower.name}/hydrophone")[:, :2]
            for follower in short_scenario.followers
        ]
        estimated_paths = [
            path[1:] + np.array([3.0, -4.0]) * (i + 1) for i, path in enumerate(hydrophones)
        ]
        concluded = SimpleNamespace(state=np.stack(estimated_paths))
        gated = np.zeros(len(estimated_paths), dtype=np.int64)
        loop = SimpleNamespace(state=SimpleNamespace(concluded=concluded), gated=gated)
        return SimpleNamespace(controller=loop, flown=displaced)

    monkeypatch.setattr(study_measure, "closed_loop_mission", mission)
    monkeypatch.setattr(study_measure, "fly_mission", lambda _, mission: mission.flown)
    first, second, *_ = (
        {name: record[name] for name in ("e_p_mean_m", "track_error_rms_m", "track_error_end_m")}
        for record in records_of_run(ENTRIES["tight-2 estimate"].scenario_at(3), 3)
    )
    assert list(first.values()) == pytest.approx([5.0, 0.0, 0.0], abs=1e-6)
    # for the last 10 of 101 instants
    assert list(second.values()) == pytest.approx([10.0, 8.0 * np.sqrt(10 / 101), 8.0], abs=1e-6)
    (scenario,) = calls
    assert (scenario.run, scenario.navigation.variant, scenario.navigation.transmitters) == (
        3,
        "tight",
        2,
    )
    assert {follower.guidance_position for follower in scenario.followers} == {"estimate"}
    assert scenario.ocean.current_speed_m_s == 0.0


def test_currents_come_from_all_directions() -> None:
    """Runs take fifths of the greatest speed in turn; the tight navigator assumes a current."""
    scenarios = [ENTRIES["tight-3 current"].scenario_at(run) for run in range(5)]
    assert [scenario.ocean.current_speed_m_s for scenario in scenarios] == pytest.approx(
        [0.1, 0.2, 0.3, 0.4, 0.5]
    )
    directions = np.sort([scenario.ocean.current_direction_deg for scenario in scenarios])
    assert np.diff(directions, append=directions[0] + 360.0).max() < 140.0
    assert all(scenario.navigation.assume.current for scenario in scenarios)
    assert {follower.guidance_position for follower in scenarios[0].followers} == {"estimate"}
    by_truth = ENTRIES["tight-3 truth"].scenario_at(3)
    assert (by_truth.ocean.current_speed_m_s, by_truth.navigation.assume.current) == (0.0, False)


def test_the_record_counts_lost_followers() -> None:
    """Follower i of run r has an error of i + r and an error of its track of 10 i; in the first run
    it is lost, 60 m off at the end, where i is even.
    """
    runs = [
        [
            {
                "e_p_mean_m": float(i + r),
                "track_error_rms_m": 10.0 * i,
                "track_error_end_m": 60.0 if r == 0 and i % 2 == 0 else 50.0,
            }
            for i in range(len(ROUTES))
        ]
        for r in range(5)
    ]
    outcomes: Any = SimpleNamespace(cells=cells_of(dict.fromkeys(ENTRIES, runs)))
    actual = study.findings_of({"study": outcomes})
    # medians of 40 missions, and of the runs of the last route
    assert (actual["off current tight-2"].value, actual["worst current tight-2"].value) == (
        35.0,
        70.0,
    )
    assert actual["lost-runs current tight-2"].value == 4
    assert actual["error laisn-2 T4"].value == 2.0 + 2.0
    assert actual["off laisn-3-2 T9"].value == 70.0
    assert (actual["lost-runs laisn-2 T2"].value, actual["lost-runs laisn-2 T3"].value) == (1, 0)
    assert (actual["lost-runs laisn-3-1"].value, actual["missions"].value) == (4, 40)
    assert actual["runs"].value == 5
    assert format(actual["lost laisn-2"], ".0% i") == "10 % (3 to 24 %)"


def test_a_study_measures_a_run_by_the_estimates_that_steered_it() -> None:
    scenario = mission("navigation.variant=tight", "timing.filter_step_s=0.5", "run=2")
    (record,) = records_of_run(scenario, 2)
    flight, _ = fly(scenario)
    error = np.hypot(*(flight.estimates[0].state[:, :2] - flight.hydrophone(0)[:, :2]).T)
    assert (record["e_p_mean_m"], record["e_p_max_m"]) == pytest.approx(
        (error.mean(), error.max()), rel=1e-12
    )
