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
"""Arms of the study."""


def mission(*assignments: str, route: str = "T6", duration: float = 60.0) -> Scenario:
    return load_scenario(
        route,
        [
            "followers.0.guidance_position=estimate",
            "navigation.variant=laisn-3-2",
            f"duration_s={duration}",
            *assignments,
        ],
    )


def apart(scenario: Scenario, follower: int = 0) -> Floats:
    """Estimated positions used for control, less those of navigation on the finished mission,
    shape (n, 2), [m].
    """
    trajectory, loop = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    measured, estimates = flight.measurements[follower], flight.estimates[follower]
    assert measured.message_step.size > 5
    if scenario.navigation.variant != "tight":
        assert loop.gated[follower] == np.count_nonzero(estimates.fix_kind == FixKind.GATED)
    steered = loop.state.concluded.state[follower, :, :2]
    return np.asarray(steered - estimates.state[:, :2])


TROUBLED = (
    "acoustics.loss_probability=0.2",
    "acoustics.burst_probability=0.1",
    "acoustics.surface_echo_probability=0.1",
    "sensors.speed_drift_m_s=0.3",
    "sensors.heading_drift_deg=9",
    "sensors.leader_position_drift_m_s=0.1",
)
TILTED = (
    "leader.broadcast_attitude=true",
    "navigation.use_attitude=true",
    "sensors.leader_attitude_sigma_deg=0.5",
    "sensors.leader_attitude_senses_acceleration=true",
    "sensors.depth_sigma_m=0.05",
    "leader.depth_profile=[[0, 8], [10, 8], [30, 12]]",
)
SLOW_SOUND = (
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
        TROUBLED,
        TILTED,
    ],
)
def test_the_finished_mission_gives_the_very_estimates_that_steered_it(
    assignments: tuple[str, ...],
) -> None:
    assert not apart(mission("navigation.variant=tight", *assignments)).any()


@pytest.mark.parametrize(
    "assignments",
    [
        SLOW_SOUND,
        (
            *SLOW_SOUND,
            *TROUBLED,
            "acoustics.bottom_echo_probability=0.1",
            "acoustics.max_range_m=90",
            "acoustics.sound_speed_profile=[[0, 1500], [9, 1490], [30, 1510]]",
        ),
        (
            *TILTED,
            *SLOW_SOUND,
            "sensors.leader_gyro_time_constant_s=30",
            "sensors.leader_attitude_offset_sigma_deg=1",
        ),
    ],
)
@pytest.mark.parametrize("variant", ["laisn-3-1", "tight"])
def test_so_it_does_but_for_rounding_where_sound_takes_its_time(
    variant: str, assignments: tuple[str, ...]
) -> None:
    """Where a hull is between two instants, and what a gyro forgets, are rounded otherwise under
    way.
    """
    off = apart(mission(f"navigation.variant={variant}", *assignments))
    np.testing.assert_allclose(off, 0.0, rtol=0, atol=1e-9)


def test_of_two_messages_that_come_in_together_the_first_is_kept() -> None:
    """The vehicles meet at 2 m/s, so that sound takes less than a filter step from 150 m on."""
    nearer = (
        "acoustics.travel_time=true",
        "timing.message_interval_s=0.1",
        "duration_s=5",
        'followers.0={name="f", waypoints=[[0, 154, 0], [20, 134, 0]], depth_m=10, '
        'guidance_position="estimate"}',
        *TILTED[:4],
        "sensors.leader_gyro_time_constant_s=3",
    )
    scenario = mission(*nearer)
    np.testing.assert_allclose(apart(scenario), 0.0, rtol=0, atol=1e-9)
    trajectory, _ = simulate_closed_loop(scenario)
    sent = observe(trajectory, SensingSettings.of(scenario)).emission_step
    assert np.count_nonzero(np.diff(sent) == 2) == 1


def test_the_gate_counts_filter_steps() -> None:
    """Of fixes by echoes as many are rejected as afterwards, which depends on the time since the
    last good one.
    """
    echoes = (
        "acoustics.surface_echo_probability=0.4",
        "timing.filter_step_s=0.5",
        "navigation.variant=laisn-2",
    )
    np.testing.assert_allclose(apart(mission(*echoes)), 0.0, rtol=0, atol=1e-9)


def test_sound_that_takes_its_time_comes_in_later() -> None:
    scenario = mission(*SLOW_SOUND)
    trajectory, _ = simulate_closed_loop(scenario)
    late = navigate(scenario, trajectory).measurements[0].message_step % scenario.message_every
    assert late.size > 50
    assert late.min() >= 3


EXACT = (
    "sensors.speed_bias_m_s=0",
    "sensors.speed_sigma_m_s=0",
    "sensors.heading_bias_deg=0",
    "sensors.heading_sigma_deg=0",
    "sensors.gyro_sigma_deg_s=0",
    "sensors.tilt_sigma_deg=0",
)
EASTWARD = ("ocean.current_speed_m_s=0.4", "ocean.current_direction_deg=90")


def test_a_follower_with_exact_estimates_moves_as_with_the_truth() -> None:
    """But for the lag T of its log: while the speed changes by Δv, measured and true speed differ
    by T Δv of way.

    Position feedback takes back a part of that. The route changes its speed at the start, at 45 s
    and at 95 s.
    """
    exact = (
        *EXACT,
        "acoustics.range_tau_m=[0,0,0]",
        "acoustics.range_scale_mean_m=0",
        "acoustics.range_scale_sigma_m=0",
    )
    flight, _ = fly(mission(*exact, duration=100.0))
    by_truth, _ = fly(mission(*exact, "followers.0.guidance_position=truth", duration=100.0))
    error = np.hypot(*(flight.estimates[0].state[:, :2] - flight.hydrophone(0)[:, :2]).T)
    apart = np.linalg.norm(
        flight.trajectory.position[:, 1] - by_truth.trajectory.position[:, 1], axis=1
    )
    assert error.max() < 0.005
    assert 0.0 < np.median(apart) < 0.01
    assert apart.max() < 0.3
    speed, lag = by_truth.trajectory.forward_speed[:, 1], 1.0
    for begin, end in ((0, 440), (440, 900), (900, 1001)):
        assert apart[begin:end].max() < lag * np.ptp(speed[begin:end])


@pytest.mark.system
def test_commands_are_a_function_of_readings_and_estimates() -> None:
    """For any true motion and water of followers that do not steer by the truth."""
    followers = [
        {"route": "T6", "guidance_position": "truth"},
        {"route": "T6", "guidance_position": "estimate"},
        {"station": {"behind_m": 15.0, "port_m": 9.0, "depth_m": 14.0}},
    ]
    near = {"range_m": 30.0, "full_avoidance_range_m": 3.0}
    scenario = validate(
        {
            "name": "mixed",
            "duration_s": 5.0,
            "followers": followers,
            "formation": {"proximity": near},
        },
        "test",
    )
    flown, loop = simulate_closed_loop(scenario)
    truth = StateHistory(
        *(
            array.copy()
            for array in (flown.pose, flown.twist, flown.water_velocity, flown.effector_states)
        )
    )
    other = deepcopy(truth)
    for array in other:
        array[50, 1:] += np.linspace(0.1, 0.7, array[50, 1:].size).reshape(array[50, 1:].shape)
    commands = []
    for motion in (truth, other):
        state = deepcopy(loop.state)
        guide(50, motion, state)
        commands.append(state.routes.command)
    np.testing.assert_array_equal(commands[1][[0, 2, 3]], commands[0][[0, 2, 3]])
    assert (commands[1][1] != commands[0][1]).any()


@pytest.mark.parametrize("variant", ["laisn-3-2", "tight"])
def test_a_follower_without_receptions_drifts_with_the_water(variant: str) -> None:
    """Its readings are those of still water, so that it swims as there, and the water takes it
    0.4 m/s eastwards.
    """
    silent = (
        "leader.waypoints=[[0, 0, 0], [300, 0, 300]]",
        "followers.0.waypoints=[[0, 20, 0], [300, 20, 300]]",
        "acoustics.max_range_m=1",
        f"navigation.variant={variant}",
        *EXACT,
    )
    still, _ = simulate_closed_loop(mission(*silent, duration=60.0))
    moved, _ = simulate_closed_loop(mission(*silent, *EASTWARD, duration=60.0))
    off = moved.position[:, 1] - still.position[:, 1]
    made_good = (off[600] - off[300]) / 30.0
    assert made_good == pytest.approx([0.4, 0.0, 0.0], abs=0.002)


@pytest.mark.parametrize("variant", ["laisn-3-2", "tight"])
def test_in_a_current_it_keeps_to_its_route(variant: str) -> None:
    """By the current that it estimates, or by the integral of how far it is off."""
    settings = (
        "leader.waypoints=[[0, 0, 0], [600, 0, 600]]",
        "followers.0.waypoints=[[0, 20, 0], [600, 20, 600]]",
        f"navigation.variant={variant}",
        *EXACT,
        *EASTWARD,
    )
    flown, loop = simulate_closed_loop(mission(*settings, duration=400.0))
    assert np.abs(loop.state.concluded.state[0, 3000:, 0] - 20.0).mean() < 0.4
    assert flown.position[3000:, 1, 1] - flown.time[3000:] == pytest.approx(0.0, abs=1.0)


def test_a_follower_without_receptions_follows_the_drift_of_its_log_and_compass() -> None:
    """It keeps 1 m/s northwards by a log that reads 0.2 m/s and a compass that reads 5° too
    much.
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
    made_good = (flight.trajectory.position[1200, 1] - flight.trajectory.position[600, 1]) / 60.0
    expected = 0.8 * np.array([-np.sin(np.deg2rad(5.0)), np.cos(np.deg2rad(5.0))])
    assert made_good[:2] == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize("variant", ["laisn-2", "tight"])
def test_between_filter_steps_it_dead_reckons(variant: str) -> None:
    """From where its navigator has it, and with the velocity that its navigator gives it."""
    scenario = mission(f"navigation.variant={variant}", "timing.filter_step_s=0.5", duration=10.0)
    flown = closed_loop_mission(scenario)
    steered = []
    for k in range(flown.last + 1):
        flown.advance(k)
        steered.append(flown.controller.state.estimates.position[0].copy())
    state = navigate(scenario, flown.trajectory()).estimates[0].state
    for beyond in range(5):
        expected = state[:-1, :2] + 0.1 * beyond * state[:-1, 2:]
        actual = np.array(steered[5 + beyond : -1 : 5])
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9)


def test_a_follower_without_a_position_goes_parallel_to_its_route() -> None:
    """Without receptions and start it turns as planned, and does not correct the remaining
    errors.
    """
    silent = (
        "navigation.variant=tight",
        "navigation.assume.known_start=false",
        "acoustics.max_range_m=0.001",
        *EXACT,
    )
    lost, _ = simulate_closed_loop(mission(*silent, duration=20.0))
    by_truth, _ = simulate_closed_loop(
        mission("followers.0.guidance_position=truth", duration=20.0)
    )
    astray = np.linalg.norm(lost.position[:, 1] - by_truth.position[:, 1], axis=1)
    assert 0.02 < astray.max() < 0.5


@pytest.mark.parametrize("tilt", [False, True])
def test_followers_on_routes_and_stations_move_together(tilt: bool) -> None:
    """By truth and by estimate, with sensors that are equal for all followers: each as alone.

    Whether attitude is broadcast is set explicitly: the default depends on whether there are
    stations.
    """
    routes = [{"route": "T6", "guidance_position": by} for by in ("truth", "estimate")]
    stations = [
        {"station": {"behind_m": 15.0, "port_m": side, "depth_m": 14.0}, "guidance_position": by}
        for side, by in ((-9.0, "truth"), (9.0, "estimate"))
    ]

    exact = "heading_sigma_deg", "speed_sigma_m_s", "gyro_sigma_deg_s", "tilt_sigma_deg"

    def flown(followers: list[dict[str, Any]]) -> Trajectory:
        table = {
            "name": "mixed",
            "duration_s": 30.0,
            "followers": followers,
            "leader": {"broadcast_attitude": tilt},
            "navigation": {"use_attitude": tilt},
            "sensors": dict.fromkeys(exact, 0.0),
            "acoustics": {"range_tau_m": [0.0, 0.0, 0.0], "range_scale_sigma_m": 0.0},
        }
        return simulate_closed_loop(validate(table, "test"))[0]

    together = flown([*routes, *stations])
    for i, alone in enumerate([*routes, *stations]):
        np.testing.assert_allclose(
            flown([alone]).position[:, 1], together.position[:, i + 1], rtol=0, atol=1e-9
        )


def test_its_path_belongs_to_a_run_so_that_campaigns_refuse_it() -> None:
    with pytest.raises(
        ValueError, match=r"followers\.0\.guidance_position = 'estimate'.*laisn fly --run N"
    ):
        simulate_mission(mission())


def test_the_point_motion_cannot_be_steered() -> None:
    with pytest.raises(ValueError, match="needs motion = 'physics'"):
        mission("motion=kinematic")


def test_a_fleet_is_measured_follower_by_follower(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates 3 m east and 4 m south of the truth; followers where their routes have them, but
    for a last stretch.
    """
    calls = []

    def flown(scenario: Scenario) -> tuple[Trajectory, Any]:
        calls.append(scenario)
        kinematic = tuple(
            f.model_copy(update={"guidance_position": "truth"}) for f in scenario.followers
        )
        changes = {"motion": "kinematic", "duration_s": 10.0, "followers": kinematic}
        short = scenario.model_copy(update=changes)
        trajectory = simulate_motion(short)
        position = trajectory.position.copy()
        position[:, 2, 0] += np.where(trajectory.time > 9.05, 8.0, 0.0)
        moved = synthetic.moved(trajectory, position=position)
        hydrophones = [
            moved.site_path(f"{follower.name}/hydrophone")[:, :2] for follower in short.followers
        ]
        beliefs = [path[1:] + np.array([3.0, -4.0]) * (i + 1) for i, path in enumerate(hydrophones)]
        concluded = SimpleNamespace(state=np.stack(beliefs))
        gated = np.zeros(len(beliefs), dtype=np.int64)
        return moved, SimpleNamespace(state=SimpleNamespace(concluded=concluded), gated=gated)

    monkeypatch.setattr(study_measure, "simulate_closed_loop", flown)
    one, other, *_ = (
        {name: row[name] for name in ("e_p_mean_m", "track_error_rms_m", "track_error_end_m")}
        for row in records_of_run(ENTRIES["tight-2 estimate"].scenario_at(3), 3)
    )
    assert list(one.values()) == pytest.approx([5.0, 0.0, 0.0], abs=1e-6)
    # for the last 10 of 101 instants
    assert list(other.values()) == pytest.approx([10.0, 8.0 * np.sqrt(10 / 101), 8.0], abs=1e-6)
    (scenario,) = calls
    assert (scenario.run, scenario.navigation.variant, scenario.navigation.transmitters) == (
        3,
        "tight",
        2,
    )
    assert {follower.guidance_position for follower in scenario.followers} == {"estimate"}
    assert scenario.ocean.current_speed_m_s == 0.0


def test_currents_come_from_all_directions() -> None:
    """Fifths of the greatest one after the other; the tight navigator assumes a current."""
    flown = [ENTRIES["tight-3 current"].scenario_at(run) for run in range(5)]
    assert [mission.ocean.current_speed_m_s for mission in flown] == pytest.approx(
        [0.1, 0.2, 0.3, 0.4, 0.5]
    )
    directions = np.sort([mission.ocean.current_direction_deg for mission in flown])
    assert np.diff(directions, append=directions[0] + 360.0).max() < 140.0
    assert all(mission.navigation.assume.current for mission in flown)
    assert {follower.guidance_position for follower in flown[0].followers} == {"estimate"}
    by_truth = ENTRIES["tight-3 truth"].scenario_at(3)
    assert (by_truth.ocean.current_speed_m_s, by_truth.navigation.assume.current) == (0.0, False)


def test_the_record_counts_lost_followers() -> None:
    """Follower i of run r: error i + r, off its place 10 i, and lost in the first run where i is
    even.
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


def test_a_study_judges_a_run_by_the_estimates_that_steered_it() -> None:
    scenario = mission("navigation.variant=tight", "timing.filter_step_s=0.5", "run=2")
    (row,) = records_of_run(scenario, 2)
    flight, _ = fly(scenario)
    error = np.hypot(*(flight.estimates[0].state[:, :2] - flight.hydrophone(0)[:, :2]).T)
    assert (row["e_p_mean_m"], row["e_p_max_m"]) == pytest.approx(
        (error.mean(), error.max()), rel=1e-12
    )
