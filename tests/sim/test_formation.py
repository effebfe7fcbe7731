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
from sim.closed_loop import ClosedLoop, PythonClosedLoop, simulate_closed_loop
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

PLACES = [(5.0, 10.0, 11.0), (20.0, 0.0, 12.0), (15.0, -30.0, 13.0)]


def mission(
    *, duration: float = 40.0, places: list[tuple[float, float, float]] = PLACES, **tables: object
) -> Scenario:
    followers = [{"station": {"behind_m": s, "port_m": y, "depth_m": d}} for s, y, d in places]
    return validate(
        {"name": "stations", "duration_s": duration, "followers": followers, **tables}, "test"
    )


def flown(scenario: Scenario) -> tuple[Trajectory, ClosedLoop | PythonClosedLoop]:
    return simulate_closed_loop(scenario)


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
def test_the_finished_mission_gives_the_estimates_that_steered_it(variant: str) -> None:
    """LAISN's lanes and its readable navigator agree to rounding; see also test_lanes."""
    scenario = mission(navigation={"variant": variant}, **NOISY)
    trajectory, controller = flown(scenario)
    flight = navigate(scenario, trajectory)
    lost = np.isnan(flight.measurements[0].ranges).all(axis=1)
    assert 2 < lost.sum() < 38
    for i, estimates in enumerate(flight.estimates):
        steered = controller.state.concluded.state[i, :, :2]
        np.testing.assert_allclose(steered, estimates.state[:, :2], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "assume",
    [
        {},
        {"transmitters": 2, "current": True, "exact_leader": False, "drift": True},
        {"known_start": False},
    ],
)
def test_the_tight_navigator_steers_by_the_very_estimates(assume: dict[str, object]) -> None:
    scenario = mission(navigation={"variant": "tight", "assume": assume}, **NOISY)
    trajectory, controller = flown(scenario)
    flight = navigate(scenario, trajectory)
    for i, estimates in enumerate(flight.estimates):
        np.testing.assert_array_equal(
            controller.state.concluded.state[i, :, :2], estimates.state[:, :2]
        )


def test_what_is_sensed_under_way_is_what_is_measured_afterwards() -> None:
    scenario = mission(**NOISY)
    trajectory, controller = flown(scenario)
    flight = navigate(scenario, trajectory)
    for i, measured in enumerate(flight.measurements):
        last = np.array([measured.speed[-1], measured.heading[-1], measured.depth[-1]])
        np.testing.assert_array_equal(controller.state.readings[i].tolist()[:3], last)
        np.testing.assert_array_equal(controller.state.inbox.ranges[i], measured.ranges[-1])
        np.testing.assert_array_equal(
            controller.state.inbox.message[i].tolist(), measured.message[-1]
        )


def test_a_ping_that_is_not_waited_for_comes_too_late() -> None:
    """LAISN-2 takes the message up with the second ping; the third one follows 0.2 s later."""
    scenario = mission(
        navigation={"variant": "laisn-2"}, acoustics={"ping_slot_s": 0.2}, duration=5.0
    )
    trajectory, controller = flown(scenario)
    flight = navigate(scenario, trajectory)
    assert np.isnan(controller.state.inbox.ranges[:, 2]).all()
    for i, measured in enumerate(flight.measurements):
        np.testing.assert_allclose(
            controller.state.inbox.ranges[i], measured.ranges[-1], rtol=0, atol=1e-9
        )


def test_stations_are_kept_where_sound_takes_its_time() -> None:
    sound = {"travel_time": True, "sound_speed_profile": [[0.0, 1500.0], [20.0, 1500.1]]}
    scenario = mission(navigation={"variant": "tight"}, acoustics=sound)
    trajectory, controller = flown(scenario)
    flight = navigate(scenario, trajectory)
    assert (flight.measurements[0].message_step % 10 == 1).all()
    for i, estimates in enumerate(flight.estimates):
        np.testing.assert_allclose(
            controller.state.concluded.state[i, :, :2], estimates.state[:, :2], rtol=0, atol=1e-9
        )
    # the worst station of those that receive at once is allowed as much
    assert (
        np.sqrt(np.mean(off_station(MotionSettings.of(scenario), trajectory) ** 2, axis=0)).max()
        < 0.6
    )


def test_the_noise_of_a_run_does_not_depend_on_other_vehicles() -> None:
    alone, controller = flown(mission(places=PLACES[:1]))
    among, controllers = flown(mission())
    np.testing.assert_array_equal(controller.state.readings[0], controllers.state.readings[0])
    np.testing.assert_array_equal(alone.position[:, 1], among.position[:, 1])


CROSSING = [(20.0, 6.0, 12.0), (20.0, -6.0, 12.0)]


def crossing(**formation: object) -> Scenario:
    """Two followers of one layer, each of which starts where the other one's station is, 12 m away.

    They close up at 0.9 m/s, which pushes of 0.8 m/s each undo.
    """
    followers = [
        {"station": {"behind_m": s, "port_m": y, "depth_m": d}, "start_m": [-s, -y]}
        for s, y, d in CROSSING
    ]
    slow = formation | {"approach_speed_m_s": 0.5}
    return validate(
        {"name": "s", "duration_s": 60.0, "followers": followers, "formation": slow}, "test"
    )


def test_followers_that_sense_each_other_give_way() -> None:
    blind, _ = flown(crossing())
    wary, controller = flown(crossing(proximity={}))

    def least(trajectory: Trajectory) -> float:
        return float(
            np.hypot(*(trajectory.position[:, 1] - trajectory.position[:, 2])[:, :2].T).min()
        )

    assert least(blind) < 1.0
    assert least(wary) > 2.0
    # what they saw at the last look is what the sensor makes of the truth at that instant
    look_at = np.concatenate([wary.position[-1], wary.quaternion[-1]], axis=1)
    proximity, seen = Proximity().record(), np.empty_like(controller.state.sightings[0])
    for i in range(2):
        sense_neighbours(
            (controller.state.sensors.seed, controller.state.sensors.run),
            proximity,
            600,
            i,
            look_at,
            seen,
        )
        np.testing.assert_array_equal(controller.state.sightings[i].tolist(), seen.tolist())


def test_a_proximity_sensor_without_detections_changes_nothing() -> None:
    blind, _ = flown(mission(duration=20.0))
    wary, _ = flown(mission(duration=20.0, formation={"proximity": {"range_m": 4.0}}))
    np.testing.assert_array_equal(blind.position, wary.position)


def test_the_controller_does_not_use_the_truth() -> None:
    """It is handed readings, beliefs, messages and a clock: arrays made here, with no vehicle
    behind them.
    """
    law, memory = Formation().record(), record(FOLLOWER_MEMORY)
    trail, count, station = (
        records(TRAIL, 50),
        np.zeros(1, dtype=np.int64),
        record(STATION, 20.0, 5.0, 12.0, 0.0),
    )
    reading, reference = record(READING, 1.2, 0.1, 12.0, 0.0, 0.0, 0.0), record(REFERENCE)
    estimate = record(ESTIMATE)
    estimate.log_bias, estimate.compass_bias = 0.2, 0.1
    init_memory(message(0.0, 0.0, 0.0, 0.0, 1.0), trail, count, memory)
    for second in range(1, 31):
        extend_trail(
            law,
            station,
            message(second, 0.0, second, 0.0, 1.0),
            trail,
            count,
            (second, 0.1),
            memory,
        )
        for tenth in range(10):
            now = second + 0.1 * tenth
            estimate.position = -5.0, now - 20.0
            wanted, motion = keep_station(
                law,
                station,
                Senses(reading, estimate),
                (trail, count[0]),
                (now, 0.1),
                memory,
                reference,
                NO_PLAN,
            )
    # on its station by its estimate, it goes on north at the leader's speed, for any sensor biases
    assert wanted == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
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
    seen = records(SIGHTING, 2)
    seen.range, seen.bearing = (np.nan, 2.0), (np.nan, -0.2)
    update_avoidance(Proximity().record(), seen, estimate, memory)
    assert set(inspect.signature(update_avoidance).parameters) == {
        "proximity",
        "sightings",
        "estimate",
        "memory",
    }
    wanted, _ = keep_station(
        law,
        station,
        Senses(reading, estimate),
        (trail, count[0]),
        (now, 0.1),
        memory,
        reference,
        NO_PLAN,
    )
    assert wanted[2] < 1.0


def quiet_for(seconds: float, formation: Formation, spread: float = 0.0) -> tuple[Floats, Floats]:
    """Headings and speeds wanted, and depths, of a follower on its station without further
    receptions.
    """
    law, memory = formation.record(), record(FOLLOWER_MEMORY)
    trail, count, station = (
        records(TRAIL, 50),
        np.zeros(1, dtype=np.int64),
        record(STATION, 20.0, 0.0, 12.0, 0.0),
    )
    reading, reference = record(READING, 1.0, 0.0, 12.0, 0.0, 0.0, 0.0), record(REFERENCE)
    estimate, rows = record(ESTIMATE), []
    estimate.position_sigma = spread
    init_memory(message(0.0, 0.0, 0.0, 0.0, 1.0), trail, count, memory)
    for second in range(1, 21):
        extend_trail(
            law,
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
        wanted, _ = keep_station(
            law,
            station,
            Senses(reading, estimate),
            (trail, count[0]),
            (now, 0.1),
            memory,
            reference,
            NO_PLAN,
        )
        rows.append((*wanted, reference.depth))
    table = np.array(rows)
    return table[:, :3], table[:, 3]


def test_without_messages_it_slows_down_as_its_place_in_the_trail_gets_uncertain() -> None:
    """σ² = spread² + (0.1 m/s × age)²; full speed while σ is within 3 m, half a metre a second
    from 6 m on.
    """
    formation = Formation(
        leader_velocity_sigma_m_s=0.1, max_trail_sigma_m=3.0, message_timeout_s=100.0
    )
    for spread in (0.0, 2.0, 3.5):
        wanted, depth = quiet_for(99.0, formation, spread)
        sigma = np.sqrt(spread**2 + (0.1 * 0.1 * np.arange(990)) ** 2)
        # hulls gain and lose 0.2 m/s each second; the commands of this one change by less after the
        # first seconds
        expected = 0.5 + 0.5 * np.clip(2.0 - sigma / 3.0, 0.0, 1.0)
        np.testing.assert_allclose(wanted[20:, 2], expected[20:], rtol=0, atol=0.01)
        assert wanted[:, 0] == pytest.approx(0.0, abs=0.01)
        assert depth == pytest.approx(12.0)


def test_after_a_long_silence_it_circles_or_surfaces_or_goes_on() -> None:
    given = {"leader_velocity_sigma_m_s": 0.1, "message_timeout_s": 120.0}
    wanted, depth = quiet_for(200.0, Formation(**given))
    assert wanted[1190, 1] == pytest.approx(0.0, abs=1e-6)
    assert np.rad2deg(wanted[1300:, 1]) == pytest.approx(4.0)
    assert depth == pytest.approx(12.0)
    _, depth = quiet_for(200.0, Formation(timeout_action="surface", **given))
    assert depth[1190] == pytest.approx(12.0)
    # at 0.2 m/s it is up after a minute
    assert depth[1300:1305] == pytest.approx(12.0 - 0.2 * (10.0 + 0.1 * np.arange(5)), abs=0.05)
    assert depth[-1] == pytest.approx(0.2)
    wanted, _ = quiet_for(200.0, Formation(timeout_action="continue", **given))
    assert wanted[1300:, 2] == pytest.approx(0.5)


def largest_distances_in_a_dive(**leader: object) -> Floats:
    """Largest distances from stations, two aside and one astern of a leader that dives from 5 to
    40 m in 150 s, shape (3,), [m].
    """
    dive = {"depth_profile": [[0, 5], [30, 5], [180, 40]], **leader}
    places = [(10.0, -20.0, 12.0), (15.0, 30.0, 13.0), (30.0, 0.0, 14.0)]
    tables = {"leader": dive, "ocean": {"floor_depth_m": 60.0}, "navigation": {"variant": "tight"}}
    scenario = mission(duration=200.0, places=places, **tables)
    trajectory, _ = flown(scenario)
    return off_station(
        MotionSettings.of(scenario),
        trajectory,
        true_stations(MotionSettings.of(scenario), trajectory),
    ).max(axis=0)


def test_a_formation_follows_a_leader_that_dives() -> None:
    """By the leader's pitch, which is broadcast by default."""
    assert (largest_distances_in_a_dive() < 2.0).all()


def test_without_its_attitude_a_leader_that_dives_shifts_its_formation() -> None:
    """A follower takes the axis of the transmitters as level.

    At pitch θ it has the difference of its ranges for that of a place Δz sin θ farther along the
    axis. The leader dives at 35 m in 150 s and 1 m/s, at last 28 m below the uppermost follower.
    Astern that is no place: at last the difference says 35 m behind, where the ranges leave 30 m.
    How far off that follower goes depends on which of the two its navigator doubts.
    """
    shift = 28.0 * np.sin(np.arctan(35.0 / 150.0))
    aside = largest_distances_in_a_dive(broadcast_attitude=False)[:2]
    assert aside.max() == pytest.approx(shift, rel=0.1)


def test_followers_turn_by_waypoints_received_before_the_turn() -> None:
    """The leader turns at 45 s; messages come at 30 s and at 60 s. Without waypoints followers go
    straight on.

    Stations 5 and 8 m behind are 10 and 7 m beyond the corner at 60 s. By the truth, for errors of
    dead reckoning to be left out; the bound is that of followers that receive each second.
    """
    places = [(5.0, 10.0, 11.0), (8.0, -9.0, 12.0)]
    followers = [
        {"station": {"behind_m": s, "port_m": y, "depth_m": d}, "guidance_position": "truth"}
        for s, y, d in places
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
            off_station(MotionSettings.of(scenario), flown(scenario)[0])[450:600].max(axis=0)
        )
    assert (largest[0] > 5.0).all()
    assert (largest[1] < 0.6).all()


def test_a_follower_with_true_positions_keeps_its_station_around_the_corner() -> None:
    followers = [
        {"station": {"behind_m": s, "port_m": y, "depth_m": d}, "guidance_position": "truth"}
        for s, y, d in PLACES
    ]
    leader = {"waypoints": [[0, 0, 0], [60, 60, 0], [160, 60, 100]]}
    scenario = validate(
        {"name": "s", "duration_s": 160.0, "leader": leader, "followers": followers}, "test"
    )
    flight, _ = fly(scenario)
    summary = summarise(flight)
    for row in summary["followers"].values():
        assert row["station_rms_m"] < 0.15
        assert row["station_max_m"] < 0.6
        assert not row["lost"]
    # on the last leg stations stand where geometry has them: behind the leader, which goes north
    leader_at = flight.trajectory.position[-1, 0, :2]
    station = true_stations(MotionSettings.of(scenario), flight.trajectory)[-1, 1]
    np.testing.assert_allclose(
        [station.east, station.north], leader_at - np.array([0.0, 20.0]), atol=0.05
    )


def test_it_joins_its_station_from_anywhere() -> None:
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
    row = summarise(flight)["followers"]["follower"]
    # 53 m away at 1 m/s nearer
    assert 35.0 < row["joined_s"] < 100.0
    assert row["station_max_m"] < 4.0


def test_a_follower_on_a_route_is_independent_of_others_on_stations() -> None:
    """It steers by where it is."""
    route = {"waypoints": [[0, -10, 5], [12, 0, 8], [30, 12, 20]], "depth_m": 10.0}
    tables: dict[str, object] = {
        "name": "s",
        "duration_s": 20.0,
        "ocean": {"current_speed_m_s": 0.2},
    }
    among = validate(
        tables
        | {"followers": [route, {"station": {"behind_m": 5.0, "port_m": 10.0, "depth_m": 12.0}}]},
        "test",
    )
    alone = simulate_motion(validate(tables | {"followers": [route]}, "test"))
    np.testing.assert_allclose(
        flown(among)[0].position[:, 1], alone.position[:, 1], rtol=0, atol=1e-9
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
    kept = summarise(flight)["followers"].values()
    assert not any(follower["lost"] for follower in kept)
    assert max(follower["station_rms_m"] for follower in kept) < 2.0


@pytest.mark.system
def test_behind_a_leader_that_turns_fast_they_are_off_as_far_as_check_says() -> None:
    """A hull that rounds a corner evenly is 0.3 R from it half way; feedback and slip add to it."""
    scenario = slow_swarm()
    warnings = trial(scenario)
    assert len(warnings) == 10
    flight, _ = fly(scenario)
    kept = summarise(flight)["followers"]
    radius = limits_of(hull_of(MotionSettings.of(scenario), scenario.followers[0])).least_radius
    for warning in warnings:
        name, _, text = warning.partition(": ")
        expected = float(text.split("up to ")[1].split(" m off its station")[0])
        assert kept[name]["station_max_m"] == pytest.approx(expected, rel=0.25)
        assert kept[name]["station_max_m"] < 0.5 * radius
