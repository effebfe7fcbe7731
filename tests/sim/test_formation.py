"""Followers on stations: their sensors, their inputs, and station keeping."""

import inspect

import numpy as np
import pytest

from experiments.flight import library
from experiments.flight.fly import fly
from experiments.flight.library import load_scenario
from laisn.arrays import Floats, records
from laisn.swarm import ESTIMATE, READING
from reports.summary import summarise
from sim.closed_loop import simulate_closed_loop
from sim.control.follower import (
    FOLLOWER_MEMORY,
    Senses,
    extend_trail,
    init_memory,
    keep_station,
    update_avoidance,
)
from sim.control.guidance import REFERENCE
from sim.control.station import NO_PLAN, STATION, TRAIL
from sim.flight import navigate
from sim.hull import hull_of, limits_of
from sim.scenario.file import validate
from sim.scenario.formation import Formation, Proximity
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.sensing.proximity import SIGHTING, sense_neighbours
from sim.simulation import simulate_motion
from sim.tracking import (
    off_station,
    true_stations,
)
from sim.trajectory import Trajectory
from sim.trial import trial
from tests.synthetic import message, record

STATIONS = [(5.0, 10.0, 11.0), (20.0, 0.0, 12.0), (15.0, -30.0, 13.0)]
"""Distances behind the leader and to its port, and depths [m]."""


def mission(
    *,
    duration: float = 40.0,
    stations: list[tuple[float, float, float]] = STATIONS,
    **tables: object,
) -> Scenario:
    """Followers on stations behind the default leader."""
    followers = [
        {"station": {"behind_m": behind, "port_m": port, "depth_m": depth}}
        for behind, port, depth in stations
    ]
    return validate(
        {"name": "stations", "duration_s": duration, "followers": followers, **tables}, "test"
    )


NOISY = {
    "sensors": {
        "depth_sigma_m": 0.05,
        "speed_drift_m_s": 0.3,
        "heading_drift_deg": 9.0,
        "drift_period_s": 60.0,
        "leader_position_drift_m_s": 0.1,
        "leader_position_drift_deg": 30.0,
        "leader_heading_bias_deg": 3.0,
        "leader_heading_sigma_deg": 1.0,
        "leader_depth_sigma_m": 0.1,
        "leader_attitude_sigma_deg": 1.0,
        "leader_attitude_offset_sigma_deg": 2.0,
    },
    "acoustics": {
        "loss_probability": 0.2,
        "burst_probability": 0.1,
        "surface_echo_probability": 0.1,
        "bottom_echo_probability": 0.1,
        "max_range_m": 33.0,
        "clock_offset_s": 1e-4,
        "clock_drift_ppm": 30.0,
        "sound_speed_bias_m_s": 2.0,
    },
    "ocean": {"current_speed_m_s": 0.3, "waves": {"kind": "regular"}},
    "leader": {"broadcast_attitude": True},
}


@pytest.mark.parametrize("variant", ["laisn-2", "laisn-3-1", "laisn-3-2"])
def test_navigation_after_the_mission_gives_the_estimates_that_steered_it(variant: str) -> None:
    """LAISN's compiled lanes and its readable navigator agree to rounding; see also test_lanes."""
    scenario = mission(navigation={"variant": variant}, **NOISY)
    trajectory, controller = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    lost = np.isnan(flight.measurements[0].ranges).all(axis=1)
    assert 2 < lost.sum() < 38
    for i, estimates in enumerate(flight.estimates):
        estimated_in_flight = controller.state.concluded.state[i, :, :2]
        np.testing.assert_allclose(estimated_in_flight, estimates.state[:, :2], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "assume",
    [
        {},
        {"transmitters": 2, "current": True, "exact_leader": False, "drift": True},
        {"known_start": False},
    ],
)
def test_the_tight_navigator_steers_by_the_estimates_of_navigation_after_the_mission(
    assume: dict[str, object],
) -> None:
    scenario = mission(navigation={"variant": "tight", "assume": assume}, **NOISY)
    trajectory, controller = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    for i, estimates in enumerate(flight.estimates):
        np.testing.assert_array_equal(
            controller.state.concluded.state[i, :, :2], estimates.state[:, :2]
        )


def test_readings_in_flight_are_those_of_measurements_after_the_mission() -> None:
    scenario = mission(**NOISY)
    trajectory, controller = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    for i, measured in enumerate(flight.measurements):
        last = np.array([measured.speed[-1], measured.heading[-1], measured.depth[-1]])
        np.testing.assert_array_equal(controller.state.readings[i].tolist()[:3], last)
        np.testing.assert_array_equal(controller.state.inbox.ranges[i], measured.ranges[-1])
        np.testing.assert_array_equal(
            controller.state.inbox.message[i].tolist(), measured.message[-1]
        )


def test_laisn_2_does_not_receive_the_third_ping_that_comes_after_its_window() -> None:
    """It receives the message with the second ping; the third one follows 0.2 s later."""
    scenario = mission(
        navigation={"variant": "laisn-2"}, acoustics={"ping_slot_s": 0.2}, duration=5.0
    )
    trajectory, controller = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    assert np.isnan(controller.state.inbox.ranges[:, 2]).all()
    for i, measured in enumerate(flight.measurements):
        np.testing.assert_allclose(
            controller.state.inbox.ranges[i], measured.ranges[-1], rtol=0, atol=1e-9
        )


def test_stations_are_kept_with_travel_times_of_sound() -> None:
    acoustics = {"travel_time": True, "sound_speed_profile": [[0.0, 1500.0], [20.0, 1500.1]]}
    scenario = mission(navigation={"variant": "tight"}, acoustics=acoustics)
    trajectory, controller = simulate_closed_loop(scenario)
    flight = navigate(scenario, trajectory)
    assert (flight.measurements[0].message_step % 10 == 1).all()
    for i, estimates in enumerate(flight.estimates):
        np.testing.assert_allclose(
            controller.state.concluded.state[i, :, :2], estimates.state[:, :2], rtol=0, atol=1e-9
        )
    # the largest error of a station is bounded as without travel times
    assert (
        np.sqrt(np.mean(off_station(MotionSettings.of(scenario), trajectory) ** 2, axis=0)).max()
        < 0.6
    )


def test_the_noise_of_a_run_does_not_depend_on_other_vehicles() -> None:
    one_follower, controller = simulate_closed_loop(mission(stations=STATIONS[:1]))
    with_others, controllers = simulate_closed_loop(mission())
    np.testing.assert_array_equal(controller.state.readings[0], controllers.state.readings[0])
    np.testing.assert_array_equal(one_follower.position[:, 1], with_others.position[:, 1])


CROSSING_STATIONS = [(20.0, 6.0, 12.0), (20.0, -6.0, 12.0)]


def crossing(**formation: object) -> Scenario:
    """Two followers of one layer, each of which starts where the other one's station is, 12 m away.

    They approach each other at 0.9 m/s; avoidance speeds of 0.8 m/s each prevent that.
    """
    followers = [
        {
            "station": {"behind_m": behind, "port_m": port, "depth_m": depth},
            "start_m": [-behind, -port],
        }
        for behind, port, depth in CROSSING_STATIONS
    ]
    slow_formation = formation | {"approach_speed_m_s": 0.5}
    return validate(
        {"name": "s", "duration_s": 60.0, "followers": followers, "formation": slow_formation},
        "test",
    )


def test_followers_that_sense_each_other_give_way() -> None:
    without_sensors, _ = simulate_closed_loop(crossing())
    with_sensors, controller = simulate_closed_loop(crossing(proximity={}))

    def least_distance(trajectory: Trajectory) -> float:
        return float(
            np.hypot(*(trajectory.position[:, 1] - trajectory.position[:, 2])[:, :2].T).min()
        )

    assert least_distance(without_sensors) < 1.0
    assert least_distance(with_sensors) > 2.0
    # the last sightings are those of the sensor at the true poses of that instant
    last_poses = np.concatenate([with_sensors.position[-1], with_sensors.quaternion[-1]], axis=1)
    proximity, expected = Proximity().record(), np.empty_like(controller.state.sightings[0])
    for i in range(2):
        sense_neighbours(
            (controller.state.sensors.seed, controller.state.sensors.run),
            proximity,
            600,
            i,
            last_poses,
            expected,
        )
        np.testing.assert_array_equal(controller.state.sightings[i].tolist(), expected.tolist())


def test_a_proximity_sensor_without_detections_changes_nothing() -> None:
    without_sensors, _ = simulate_closed_loop(mission(duration=20.0))
    with_sensors, _ = simulate_closed_loop(
        mission(duration=20.0, formation={"proximity": {"range_m": 4.0}})
    )
    np.testing.assert_array_equal(without_sensors.position, with_sensors.position)


def test_the_controller_does_not_use_the_truth() -> None:
    """It is given readings, estimates, messages and a clock, which are made here without any
    vehicle.
    """
    formation_record, memory = Formation().record(), record(FOLLOWER_MEMORY)
    trail, count, station = (
        records(TRAIL, 50),
        np.zeros(1, dtype=np.int64),
        record(STATION, 20.0, 5.0, 12.0, 0.0),
    )
    reading, reference = record(READING, 1.2, 0.1, 12.0, *[0.0] * 5), record(REFERENCE)
    estimate = record(ESTIMATE)
    estimate.log_bias, estimate.compass_bias = 0.2, 0.1
    init_memory(message(0.0, 0.0, 0.0, 0.0, 1.0), trail, count, memory)
    for second in range(1, 31):
        extend_trail(
            formation_record,
            station,
            message(second, 0.0, second, 0.0, 1.0),
            trail,
            count,
            (second, 0.1),
            memory,
        )
        for tick in range(10):
            now = second + 0.1 * tick
            estimate.position = -5.0, now - 20.0
            wanted_motion, motion = keep_station(
                formation_record,
                station,
                Senses(reading, estimate),
                (trail, count[0]),
                (now, 0.1),
                memory,
                reference,
                NO_PLAN,
            )
    # on its station by its estimate, it continues north at the leader's speed in spite of the
    # biases of its readings
    assert wanted_motion == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
    assert (motion.surge, motion.heading) == pytest.approx((1.0, 0.0), abs=1e-6)
    parameters = set(inspect.signature(keep_station).parameters)
    assert parameters == {
        "formation",
        "station",
        "senses",
        "trail",
        "clock",
        "memory",
        "reference",
        "plan",
    }
    # avoidance depends on its sensor only, here with a vehicle 2 m ahead
    sightings = records(SIGHTING, 2)
    sightings.range, sightings.bearing = (np.nan, 2.0), (np.nan, -0.2)
    update_avoidance(Proximity().record(), sightings, estimate, memory)
    assert set(inspect.signature(update_avoidance).parameters) == {
        "proximity",
        "sightings",
        "estimate",
        "memory",
    }
    wanted_motion, _ = keep_station(
        formation_record,
        station,
        Senses(reading, estimate),
        (trail, count[0]),
        (now, 0.1),
        memory,
        reference,
        NO_PLAN,
    )
    assert wanted_motion[2] < 1.0


def commands_without_messages(
    seconds: float, formation: Formation, position_sigma: float = 0.0
) -> tuple[Floats, Floats]:
    """Commands of a follower on its station that receives messages for 20 s and then none: heading,
    rate of turn and speed at each tick, shape (n, 3), and depth, shape (n,).
    """
    formation_record, memory = formation.record(), record(FOLLOWER_MEMORY)
    trail, count, station = (
        records(TRAIL, 50),
        np.zeros(1, dtype=np.int64),
        record(STATION, 20.0, 0.0, 12.0, 0.0),
    )
    reading, reference = record(READING, 1.0, 0.0, 12.0, *[0.0] * 5), record(REFERENCE)
    estimate, commands = record(ESTIMATE), []
    estimate.position_sigma = position_sigma
    init_memory(message(0.0, 0.0, 0.0, 0.0, 1.0), trail, count, memory)
    for second in range(1, 21):
        extend_trail(
            formation_record,
            station,
            message(second, 0.0, second, 0.0, 1.0),
            trail,
            count,
            (second, 0.1),
            memory,
        )
    for k in range(round(10 * seconds)):
        now = 20.0 + 0.1 * k
        estimate.position[1] = now - 20.0
        wanted_motion, _ = keep_station(
            formation_record,
            station,
            Senses(reading, estimate),
            (trail, count[0]),
            (now, 0.1),
            memory,
            reference,
            NO_PLAN,
        )
        commands.append((*wanted_motion, reference.depth))
    commands_of_ticks = np.array(commands)
    return commands_of_ticks[:, :3], commands_of_ticks[:, 3]


def test_without_messages_a_follower_slows_down_as_its_position_in_the_trail_gets_uncertain() -> (
    None
):
    """σ² = position_sigma² + (0.1 m/s × age)²; full speed up to σ = 3 m, falling to 0.5 m/s at
    σ = 6 m.
    """
    formation = Formation(
        leader_velocity_sigma_m_s=0.1, max_trail_sigma_m=3.0, message_timeout_s=100.0
    )
    for position_sigma in (0.0, 2.0, 3.5):
        wanted_motion, depth = commands_without_messages(99.0, formation, position_sigma)
        sigma = np.sqrt(position_sigma**2 + (0.1 * 0.1 * np.arange(990)) ** 2)
        # commands change by 0.2 m/s each second at most; these change by less after two seconds
        expected = 0.5 + 0.5 * np.clip(2.0 - sigma / 3.0, 0.0, 1.0)
        np.testing.assert_allclose(wanted_motion[20:, 2], expected[20:], rtol=0, atol=0.01)
        assert wanted_motion[:, 0] == pytest.approx(0.0, abs=0.01)
        assert depth == pytest.approx(12.0)


def test_after_the_message_timeout_a_follower_circles_or_surfaces_or_continues() -> None:
    settings = {"leader_velocity_sigma_m_s": 0.1, "message_timeout_s": 120.0}
    wanted_motion, depth = commands_without_messages(200.0, Formation(**settings))
    assert wanted_motion[1190, 1] == pytest.approx(0.0, abs=1e-6)
    assert np.rad2deg(wanted_motion[1300:, 1]) == pytest.approx(4.0)
    assert depth == pytest.approx(12.0)
    _, depth = commands_without_messages(200.0, Formation(timeout_action="surface", **settings))
    assert depth[1190] == pytest.approx(12.0)
    # it rises at 0.2 m/s
    assert depth[1300:1305] == pytest.approx(12.0 - 0.2 * (10.0 + 0.1 * np.arange(5)), abs=0.05)
    assert depth[-1] == pytest.approx(0.2)
    wanted_motion, _ = commands_without_messages(
        200.0, Formation(timeout_action="continue", **settings)
    )
    assert wanted_motion[1300:, 2] == pytest.approx(0.5)


def largest_distances_in_a_dive(**leader: object) -> Floats:
    """Largest distances from stations, two aside and one astern of a leader that dives from 5 to
    40 m in 150 s, shape (3,), [m].
    """
    dive = {"depth_profile": [[0, 5], [30, 5], [180, 40]], **leader}
    stations = [(10.0, -20.0, 12.0), (15.0, 30.0, 13.0), (30.0, 0.0, 14.0)]
    tables = {"leader": dive, "ocean": {"floor_depth_m": 60.0}, "navigation": {"variant": "tight"}}
    scenario = mission(duration=200.0, stations=stations, **tables)
    trajectory, _ = simulate_closed_loop(scenario)
    return off_station(
        MotionSettings.of(scenario),
        trajectory,
        true_stations(MotionSettings.of(scenario), trajectory),
    ).max(axis=0)


def test_a_formation_follows_a_leader_that_dives() -> None:
    """By the leader's pitch, which is broadcast by default."""
    assert (largest_distances_in_a_dive() < 2.0).all()


def test_without_its_attitude_a_leader_that_dives_shifts_its_formation() -> None:
    """A follower takes the axis of the transmitters as horizontal.

    At pitch θ the difference of its ranges is that of a position Δz sin θ farther along the axis.
    The leader dives by 35 m in 150 s at 1 m/s, in the end to 28 m below the uppermost follower.
    The follower astern is left out: there the difference gives 35 m behind and the ranges at most
    30 m, and its error depends on which of the two its navigator rejects.
    """
    shift = 28.0 * np.sin(np.arctan(35.0 / 150.0))
    distances_abeam = largest_distances_in_a_dive(broadcast_attitude=False)[:2]
    assert distances_abeam.max() == pytest.approx(shift, rel=0.1)


def test_followers_turn_by_waypoints_received_before_the_turn() -> None:
    """The leader turns at 45 s; messages come at 30 s and at 60 s. Without waypoints followers go
    straight on.

    Stations 5 and 8 m behind are 10 and 7 m beyond the corner at 60 s. Followers steer by the
    truth, without errors of dead reckoning; the bound is that of followers that receive messages
    each second.
    """
    stations = [(5.0, 10.0, 11.0), (8.0, -9.0, 12.0)]
    followers = [
        {
            "station": {"behind_m": behind, "port_m": port, "depth_m": depth},
            "guidance_position": "truth",
        }
        for behind, port, depth in stations
    ]
    leader = {"waypoints": [[0, 0, 0], [45, 45, 0], [105, 45, 60]]}
    largest = []
    for waypoints in (0, 2):
        scenario = validate(
            {
                "name": "s",
                "duration_s": 60.0,
                "leader": {**leader, "broadcast_waypoints": waypoints},
                "followers": followers,
                "timing": {"message_interval_s": 30.0},
                "navigation": {"variant": "tight"},
            },
            "test",
        )
        # from 45 s to the second message; before the first one the leader's speed is that of its
        # start
        largest.append(
            off_station(MotionSettings.of(scenario), simulate_closed_loop(scenario)[0])[
                450:600
            ].max(axis=0)
        )
    assert (largest[0] > 5.0).all()
    assert (largest[1] < 0.6).all()


def test_a_follower_with_true_positions_keeps_its_station_around_the_corner() -> None:
    followers = [
        {
            "station": {"behind_m": behind, "port_m": port, "depth_m": depth},
            "guidance_position": "truth",
        }
        for behind, port, depth in STATIONS
    ]
    leader = {"waypoints": [[0, 0, 0], [60, 60, 0], [160, 60, 100]]}
    scenario = validate(
        {"name": "s", "duration_s": 160.0, "leader": leader, "followers": followers}, "test"
    )
    flight, _ = fly(scenario)
    summary = summarise(flight)
    for follower_summary in summary["followers"].values():
        assert follower_summary["station_rms_m"] < 0.15
        assert follower_summary["station_max_m"] < 0.6
        assert not follower_summary["lost"]
    # on the last leg, north, the second station is 20 m south of the leader
    leader_position = flight.trajectory.position[-1, 0, :2]
    station = true_stations(MotionSettings.of(scenario), flight.trajectory)[-1, 1]
    np.testing.assert_allclose(
        [station.east, station.north], leader_position - np.array([0.0, 20.0]), atol=0.05
    )


def test_a_follower_joins_its_station_from_a_distant_start() -> None:
    followers = [
        {"station": {"behind_m": 20.0, "port_m": 5.0, "depth_m": 12.0}, "start_m": [-60.0, -30.0]}
    ]
    table = {
        "name": "s",
        "duration_s": 150.0,
        "navigation": {"variant": "laisn-3-2"},
        "followers": followers,
    }
    flight, _ = fly(validate(table, "test"))
    assert flight.trajectory.position[0, 1, :2] == pytest.approx([-60.0, -30.0])
    summary = summarise(flight)["followers"]["follower"]
    # 53 m away, approached at 1 m/s
    assert 35.0 < summary["joined_s"] < 100.0
    assert summary["station_max_m"] < 4.0


def test_a_follower_on_a_route_is_independent_of_others_on_stations() -> None:
    """It steers by its true position."""
    route = {"waypoints": [[0, -10, 5], [12, 0, 8], [30, 12, 20]], "depth_m": 10.0}
    tables: dict[str, object] = {
        "name": "s",
        "duration_s": 20.0,
        "ocean": {"current_speed_m_s": 0.2},
    }
    with_station = validate(
        tables
        | {"followers": [route, {"station": {"behind_m": 5.0, "port_m": 10.0, "depth_m": 12.0}}]},
        "test",
    )
    alone = simulate_motion(validate(tables | {"followers": [route]}, "test"))
    np.testing.assert_allclose(
        simulate_closed_loop(with_station)[0].position[:, 1],
        alone.position[:, 1],
        rtol=0,
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (
            {"followers": [{"station": {"behind_m": 10.0, "depth_m": 10.0}}] * 2},
            "0 m apart in layers 0 m apart",
        ),
        (
            {"followers": [{"station": {"behind_m": 1.0, "depth_m": 10.0}}]},
            "1 m from the leader's place",
        ),
        (
            {"followers": [{"station": {"behind_m": 9.0, "depth_m": 10.0}, "route": "T5"}]},
            "no route",
        ),
        (
            {"followers": [{"route": "T5", "start_m": [0.0, 0.0]}]},
            "start_m is for followers on stations",
        ),
        (
            {"followers": [{"name": "a"}]},
            "a route of the library, waypoints of its own or a station",
        ),
        ({"motion": "kinematic"}, "station needs motion = 'physics'"),
        (
            {"navigation": {"use_single_range": True}},
            "navigation.use_single_range must keep its default",
        ),
        (
            {
                "navigation": {
                    "variant": "tight",
                    "transmitters_m": [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
                }
            },
            "navigation.transmitters_m must keep its default",
        ),
        ({"timing": {"filter_step_s": 0.5}}, "timing.filter_step_s must keep its default"),
        ({"followers": [{"station": {"behind_m": 9.0, "depth_m": 40.0}}]}, "would dive to 40 m"),
        ({"followers": [{"route": "T5"}] * 201}, "at most 200"),
    ],
)
def test_impossible_settings_are_reported_before_the_simulation(
    table: dict[str, object], expected: str
) -> None:
    followers = [{"station": {"behind_m": 10.0, "depth_m": 10.0}}]
    with pytest.raises(ValueError, match=expected):
        validate({"name": "s", "followers": followers} | table, "test")


def test_the_built_in_swarm_is_ten_followers_on_stations() -> None:
    scenario = load_scenario("swarm", [])
    assert sum(follower.station is not None for follower in scenario.followers) == 10


CORNER = {"waypoints": [[0, 0, 0], [150, 150, 0], [400, 150, 250]]}


def slow_swarm(**leader: object) -> Scenario:
    """The built-in swarm of ten REMUS 100 round a right angle at 1 m/s."""
    return library.as_scenario(
        "swarm",
        {"duration_s": 400.0, "leader": CORNER | leader, "followers.*.model": "remus100"},
    )


@pytest.mark.system
def test_hulls_that_turn_slowly_keep_their_stations_behind_one_that_turns_as_slowly() -> None:
    flight, _ = fly(slow_swarm(model="remus100"))
    summaries = summarise(flight)["followers"].values()
    assert not any(follower["lost"] for follower in summaries)
    assert max(follower["station_rms_m"] for follower in summaries) < 2.0


@pytest.mark.system
def test_behind_a_leader_that_turns_fast_followers_err_by_what_the_trial_states() -> None:
    """A hull with a turning radius R passes a corner at 0.3 R at least; feedback and slip add to
    that.
    """
    scenario = slow_swarm()
    warnings = trial(scenario)
    assert len(warnings) == 10
    flight, _ = fly(scenario)
    summaries = summarise(flight)["followers"]
    radius = limits_of(hull_of(MotionSettings.of(scenario), scenario.followers[0])).least_radius
    for warning in warnings:
        name, _, text = warning.partition(": ")
        expected = float(text.split("up to ")[1].split(" m off its station")[0])
        assert summaries[name]["station_max_m"] == pytest.approx(expected, rel=0.25)
        assert summaries[name]["station_max_m"] < 0.5 * radius
