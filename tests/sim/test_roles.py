"""Roles of vehicles: a leader that navigates, is controlled and receives; links that are received
together, answers, and contents of messages.
"""

import json
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from typer.testing import CliRunner

import laisn_sim
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.estimates import TightEstimates
from laisn.messages import LeaderMessage, LinkMessages, Measurements
from laisn.plugins import register
from laisn_sim import Command, Flight, Simulation
from laisn_sim.cli.main import app
from sim.log.contents import Contents
from sim.scenario.parts import MotionSettings
from sim.sensing.sensor import Sensor
from sim.tracking import bounds_of
from sim.trajectory import Trajectory

TIME, EAST, NORTH, HEADING, SPEED, DEPTH, PITCH, ROLL = range(8)
SIGMA = LeaderMessage._fields.index("position_sigma")
SOUND_SPEED = 1500.0
DELAY = 0.7
"""From the reception of a request to the answer [s]."""
BEACONS = [[-50.0, -50.0, 5.0], [150.0, -50.0, 25.0], [50.0, 120.0, 12.0]]
NO_NOISE = {
    "range_tau_m": [0.0, 0.0, 0.0],
    "range_scale_mean_m": 0.0,
    "range_scale_sigma_m": 0.0,
}
LITTLE_NOISE = {
    "range_tau_m": [1e-4, 1e-4, 1e-4],
    "range_scale_mean_m": 0.0,
    "range_scale_sigma_m": 1e-4,
}
HYDROPHONE = [0.3, 0.0, 0.1]
LINE_WAYPOINTS = [[0.0, 0.0, -20.0], [100.0, 80.0, 40.0]]

MISSION: dict[str, Any] = {
    "duration_s": 12.0,
    "acoustics": {**LITTLE_NOISE, "travel_time": True, "clock_offset_s": 0.002},
    "sensors": {"custom": [{"sensor": "gyros"}]},
    "leader": {
        "hydrophone_m": HYDROPHONE,
        "broadcast_position": "estimate",
        "guidance_position": "estimate",
        "navigation": {"link": "lbl", "variant": "beacons"},
        "sensors": {"speed_bias_m_s": 0.1, "heading_bias_deg": 2.0, "depth_sigma_m": 0.2},
    },
    "links": [
        {"name": "lbl", "beacons_m": BEACONS, "interval_s": 2.0},
        {
            "name": "answer",
            "sender": "wing",
            "answers": "leader",
            "delay_s": DELAY,
            "receivers": ["leader", "follower"],
            "transmitters_m": [[0.5, 0.0, 0.0]],
            "position": "estimate",
            "content": ["position", "depth"],
            "readings": ["gyros"],
        },
    ],
    "navigation": {"variant": "ekf", "further_links": ["lbl"]},
    "followers": [
        {"name": "follower", "route": "T5", "sensors": {"speed_bias_m_s": 0.0}},
        {"name": "wing", "waypoints": LINE_WAYPOINTS, "depth_m": 8.0},
    ],
}


@pytest.fixture(scope="module")
def flown() -> Flight:
    return laisn_sim.fly(MISSION)


def leader_of(flight: Flight) -> tuple[Measurements, Floats, Floats]:
    """Measurements of the leader, its estimates and their covariances."""
    assert flight.leader is not None
    assert flight.leader.estimates is not None
    return (
        flight.leader.measurements,
        flight.leader.estimates.state,
        flight.leader.estimates.covariance,
    )


@pytest.mark.system
def test_the_leader_navigates_on_beacons(flown: Flight) -> None:
    measured, state, _ = leader_of(flown)
    truth = flown.trajectory
    assert measured.transmitters is not None
    assert len(measured.message) == 5
    np.testing.assert_allclose(measured.transmitters[0], BEACONS, rtol=0, atol=1e-9)
    hydrophone = truth.site_path("leader/hydrophone", flown.step_index())
    error = np.hypot(*(state[:, :2] - hydrophone[:, :2]).T)
    assert error.max() < 3.0
    # its clock is that of the beacons; those of followers are 2 ms ahead, which is 3 m
    sent = np.round(measured.message[:, TIME] / 0.1).astype(int)
    at_emission = truth.site_path("leader/hydrophone", sent)
    for i in range(len(sent)):
        positions = np.array(BEACONS) * (1.0, 1.0, -1.0)
        distance = np.linalg.norm(at_emission[i] - positions, axis=1)
        # it moves by up to 1.2 m/s for 0.11 s
        np.testing.assert_allclose(measured.ranges[i], distance, rtol=0, atol=0.15)


@pytest.mark.system
def test_the_leader_broadcasts_its_estimates_and_readings(flown: Flight) -> None:
    measured, state, covariance = leader_of(flown)
    received = flown.measurements[0]
    sent = np.round(received.message[:, TIME] / 0.1).astype(int)
    assert len(sent) >= 10
    hydrophone_forward = HYDROPHONE[0]
    heading = measured.heading[sent - 1]
    forward_axis = np.column_stack([np.sin(heading), np.cos(heading)])
    expected = state[sent - 1, :2] - hydrophone_forward * forward_axis
    np.testing.assert_allclose(received.message[:, [EAST, NORTH]], expected, rtol=0, atol=1e-9)
    for column, reading in (
        (HEADING, measured.heading),
        (SPEED, measured.speed),
        (DEPTH, measured.depth),
    ):
        np.testing.assert_array_equal(received.message[:, column], reading[sent - 1])
    sigma = np.sqrt(0.5 * np.trace(covariance[sent - 1, :2, :2], axis1=1, axis2=2))
    np.testing.assert_allclose(received.message[:, SIGMA], sigma, rtol=1e-12)
    # estimates and readings differ from the truth
    truth = flown.trajectory
    assert np.rad2deg(
        measured.heading - truth.heading[flown.step_index(), 0]
    ).mean() == pytest.approx(2.0, abs=1e-6)
    assert 0.1 < (measured.depth - truth.depth[flown.step_index(), 0]).std() < 0.3
    broadcast = received.message[:, [EAST, NORTH]]
    assert np.abs(broadcast - truth.position[sent, 0, :2]).max() > 0.01


def spline(truth: Trajectory, site: str) -> CubicHermiteSpline:
    """Path of a site between instants, by its positions and the velocities of its hull's origin."""
    vehicle = truth.names.index(site.partition("/")[0])
    return CubicHermiteSpline(truth.time, truth.site_path(site), truth.velocity[:, vehicle])


def arrival(source: Floats, receiver: CubicHermiteSpline, emission_time: float) -> float:
    """Time at which a ping reaches a moving receiver, by the position of its source [s]."""

    def excess_distance(time: float) -> float:
        return float(np.linalg.norm(receiver(time) - source) - SOUND_SPEED * (time - emission_time))

    return float(brentq(excess_distance, emission_time, emission_time + 1.0, xtol=1e-13))


def answers_of(flight: Flight) -> LinkMessages:
    assert flight.leader is not None
    return flight.leader.measurements.links["answer"]


@pytest.mark.system
def test_the_leader_measures_the_round_trip_of_an_answer(flown: Flight) -> None:
    truth = flown.trajectory
    answers = answers_of(flown)
    leader_rear = spline(truth, "leader/tx_rear")
    wing_hydrophone = spline(truth, "wing/hydrophone")
    leader_hydrophone = spline(truth, "leader/hydrophone")
    origin = CubicHermiteSpline(truth.time, truth.position[:, 2], truth.velocity[:, 2])
    assert len(answers.message) >= 9
    for i in range(len(answers.message)):
        request_time = 1.0 + i
        request_arrival = arrival(leader_rear(request_time), wing_hydrophone, request_time)
        answer_time = request_arrival + DELAY
        assert answers.message[i, TIME] == pytest.approx(answer_time, abs=1e-6)
        k = round(answer_time / 0.1)
        heading = truth.heading[k, 2]
        source = origin(answer_time) + 0.5 * np.array([np.sin(heading), np.cos(heading), 0.0])
        answer_arrival = arrival(source, leader_hydrophone, answer_time)
        assert answers.round_trip is not None
        # the transmitter's place in the hull is right to a millimetre here
        assert answers.round_trip[i] == pytest.approx(
            answer_arrival - request_time - DELAY, abs=2e-6
        )
        # the follower's clock is ahead: by it the answer left later than by the leader's
        one_way = SOUND_SPEED * (answer_arrival - answer_time - 0.002)
        assert answers.ranges[i, 0] == pytest.approx(one_way, abs=4e-3)
        assert np.isnan(answers.ranges[i, 1:]).all()
        assert answers.message_step[i] == np.ceil(answer_arrival / 0.1 - 1e-6)


@pytest.mark.system
def test_another_receiver_of_an_answer_measures_no_round_trip(flown: Flight) -> None:
    overheard = flown.measurements[0].links["answer"]
    assert len(overheard.message) >= 9
    assert overheard.round_trip is not None
    assert np.isnan(overheard.round_trip).all()
    assert "answer" not in flown.measurements[1].links
    # clocks of followers agree: the range is the distance from sender to receiver
    truth = flown.trajectory
    answer_time = overheard.message[:, TIME]
    offset = spline(truth, "wing/hydrophone")(answer_time) - spline(truth, "follower/hydrophone")(
        answer_time
    )
    np.testing.assert_allclose(overheard.ranges[:, 0], np.linalg.norm(offset, axis=1), atol=1.0)


@pytest.mark.system
@pytest.mark.parametrize("travel_time", [False, True])
def test_messages_hold_readings_of_the_step_in_which_they_leave(travel_time: bool) -> None:
    """Also where they arrive in that very step, in which the sender has not navigated yet."""
    links = [
        {
            "name": "mate",
            "sender": "wing",
            "interval_s": 1.5,
            "receivers": ["follower"],
            "position": "estimate",
            "readings": ["gyros"],
        }
    ]
    flight = laisn_sim.fly(
        mission_with_beacons(
            acoustics={**LITTLE_NOISE, "travel_time": travel_time},
            sensors={"custom": [{"sensor": "gyros"}]},
            motion="physics",
            links=links,
            navigation={"variant": "ekf", "further_links": ["mate"]},
        )
    )
    received = flight.measurements[0].links["mate"]
    step = np.round(received.message[:, TIME] / 0.1).astype(int)
    assert step.tolist() == [*range(15, 15 * len(step) + 1, 15)]
    assert len(step) >= 12
    assert (received.message_step - step == 1).all() == travel_time
    read = flight.measurements[1]
    for column, readings in ((SPEED, read.speed), (HEADING, read.heading), (DEPTH, read.depth)):
        np.testing.assert_array_equal(received.message[:, column], readings[step - 1])
    np.testing.assert_array_equal(received.content["gyros"], read.custom["gyros"][step - 1])
    # the estimate is that of the last step that is navigated, brought forward
    navigated = step - (0 if travel_time else 1)
    state = flight.estimates[1].state[navigated - 1]
    ahead = 0.1 * (step - navigated)[:, None] * state[:, 2:]
    np.testing.assert_allclose(
        received.message[:, [EAST, NORTH]], state[:, :2] + ahead, rtol=0, atol=1e-9
    )


@pytest.mark.system
def test_an_answer_has_the_content_of_its_table(flown: Flight) -> None:
    answers = answers_of(flown)
    assert np.isnan(answers.message[:, [HEADING, SPEED, PITCH, ROLL]]).all()
    step = np.floor(answers.message[:, TIME] / 0.1 + 1e-6).astype(int)
    measured = flown.measurements[1]
    np.testing.assert_array_equal(answers.message[:, DEPTH], measured.depth[step - 1])
    np.testing.assert_array_equal(answers.content["gyros"], measured.custom["gyros"][step - 1])
    state = flown.estimates[1].state[step - 1]
    time_since_step = answers.message[:, TIME] - 0.1 * step
    expected = state[:, :2] + time_since_step[:, None] * state[:, 2:]
    np.testing.assert_allclose(answers.message[:, [EAST, NORTH]], expected, rtol=0, atol=1e-9)


@pytest.mark.system
def test_a_navigator_listens_to_the_leader_and_to_beacons(flown: Flight) -> None:
    lbl = flown.measurements[0].links["lbl"]
    assert len(lbl.message) == 5
    assert lbl.places is not None
    np.testing.assert_allclose(lbl.places, BEACONS, rtol=0, atol=1e-9)
    without_beacons = laisn_sim.navigate(flown, {"navigation.further_links": []})
    renavigated = laisn_sim.navigate(flown)
    np.testing.assert_array_equal(renavigated.estimates[0].state, flown.estimates[0].state)
    assert np.abs(without_beacons.estimates[0].state - flown.estimates[0].state).max() > 0.1
    # only the leader's messages have fixes
    for flight in (flown, renavigated):
        np.testing.assert_array_equal(
            np.unique(flight.estimates[0].fix_step), flight.measurements[0].message_step
        )


@pytest.mark.system
def test_a_log_holds_the_leader_and_further_links(flown: Flight, tmp_path: Any) -> None:
    path = tmp_path / "flight.mcap"
    laisn_sim.write_log(flown, path)
    from_log = laisn_sim.read_log(path)
    assert from_log.leader is not None
    assert flown.leader is not None
    np.testing.assert_array_equal(
        from_log.leader.measurements.speed, flown.leader.measurements.speed
    )
    for expected, actual in (
        (answers_of(flown), answers_of(from_log)),
        (flown.measurements[0].links["lbl"], from_log.measurements[0].links["lbl"]),
    ):
        np.testing.assert_array_equal(expected.message_step, actual.message_step)
        np.testing.assert_array_equal(expected.message, actual.message)
        np.testing.assert_array_equal(expected.ranges, actual.ranges)
    answers, answers_from_log = answers_of(flown), answers_of(from_log)
    np.testing.assert_array_equal(answers.round_trip, answers_from_log.round_trip)
    np.testing.assert_array_equal(answers.content["gyros"], answers_from_log.content["gyros"])
    renavigated = laisn_sim.navigate(from_log)
    np.testing.assert_array_equal(renavigated.estimates[0].state, flown.estimates[0].state)


CALLS: list[Any] = []


class Eastward:
    """A controller that holds a heading, and records readings and estimates of its calls."""

    def __init__(self, leader: Any) -> None:
        assert leader.sensors.heading_bias_deg is None
        CALLS.clear()

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        CALLS.append((readings, belief))
        return np.pi / 2, 1.0, 12.0


@pytest.fixture
def controlled() -> Simulation:
    """A mission whose leader has the controller `Eastward` and errors of its own sensors."""
    table = {
        "duration_s": 40.0,
        "leader": {
            "controller": register(Eastward),
            "sensors": {"heading_bias_deg": 3.0, "speed_sigma_m_s": 0.1},
        },
        "followers": [{"route": "T5"}],
    }
    return Simulation(table)


@pytest.mark.system
def test_a_leader_is_steered_by_a_plugin_and_by_commands_between_steps(
    controlled: Simulation,
) -> None:
    sim = controlled
    sim.step(25.0)
    leader = sim.truth["leader"]
    # by its compass, which reads 3° too much
    assert np.rad2deg(leader.heading) == pytest.approx(87.0, abs=0.5)
    assert leader.depth == pytest.approx(12.0, abs=0.3)
    readings, belief = CALLS[-1]
    assert (readings.time, sim.readings["leader"].heading) == (25.0, readings.heading)
    assert np.rad2deg(readings.heading - leader.heading) == pytest.approx(3.0, abs=1e-6)
    np.testing.assert_allclose([belief.east, belief.north], leader.position[:2], atol=1e-9)
    call_count = len(CALLS)
    sim.command("leader", Command(heading=0.0, speed=1.0, depth=12.0))
    sim.step(15.0)
    assert len(CALLS) == call_count
    assert np.rad2deg(sim.truth["leader"].heading + 1.0) % 360.0 == pytest.approx(57.3, abs=8.0)
    # messages have the errors of the leader's own sensors
    flight = sim.flight()
    (measured,) = flight.measurements
    sent = np.round(measured.message[:, TIME] / 0.1).astype(int)
    assert flight.leader is not None
    of_leader = flight.leader.measurements
    np.testing.assert_allclose(
        measured.message[:, HEADING], of_leader.heading[sent - 1], atol=1e-12
    )
    np.testing.assert_allclose(measured.message[:, SPEED], of_leader.speed[sent - 1], atol=1e-12)
    assert (
        0.03
        < (of_leader.speed - flight.trajectory.forward_speed[flight.step_index(), 0]).std()
        < 0.3
    )


def mission_with_beacons(**changes: Any) -> dict[str, Any]:
    """Two followers that receive the leader and, on a further link, beacons."""
    return {
        "duration_s": 20.0,
        "motion": "kinematic",
        "links": [{"name": "lbl", "beacons_m": BEACONS}],
        "navigation": {"variant": "ekf", "further_links": ["lbl"]},
        "followers": [
            {"name": "follower", "route": "T5"},
            {"name": "wing", "waypoints": LINE_WAYPOINTS},
        ],
        **changes,
    }


def test_errors_of_links_that_are_received_together_are_independent() -> None:
    """Those of the main link are the same as without a further link, to the bit."""
    with_beacons = laisn_sim.fly(mission_with_beacons()).measurements[0]
    without_beacons = laisn_sim.fly(
        mission_with_beacons(navigation={"variant": "ekf"})
    ).measurements[0]
    np.testing.assert_array_equal(with_beacons.ranges, without_beacons.ranges)
    exact_flight = laisn_sim.fly(mission_with_beacons(acoustics=NO_NOISE))
    exact = exact_flight.measurements[0]
    hydrophone = exact_flight.hydrophone(0)[exact.links["lbl"].message_step - 1]
    for j, (east, north, depth) in enumerate(BEACONS):
        expected = np.linalg.norm(hydrophone - (east, north, -depth), axis=1)
        np.testing.assert_allclose(exact.links["lbl"].ranges[:, j], expected, rtol=0, atol=1e-9)
    uniform = {**NO_NOISE, "range_tau_m": [1.0, 1.0, 1.0]}
    noisy = laisn_sim.fly(mission_with_beacons(acoustics=uniform)).measurements[0]
    errors_of_leader = (noisy.ranges - exact.ranges).ravel()
    errors_of_beacons = (noisy.links["lbl"].ranges - exact.links["lbl"].ranges).ravel()
    assert 0.3 < errors_of_beacons.mean() < 0.7
    # the correlation of 57 independent pairs exceeds this with a probability below 1e-5
    assert abs(np.corrcoef(errors_of_leader, errors_of_beacons)[0, 1]) < 0.55


def test_a_link_has_receivers_and_content() -> None:
    links = [
        {
            "name": "short",
            "sender": "leader",
            "receivers": ["wing"],
            "content": ["position", "heading", "speed", "depth"],
        }
    ]
    table = mission_with_beacons(links=links, navigation={"variant": "ekf", "link": "short"})
    table["leader"] = {"broadcast_attitude": True}
    follower, wing = laisn_sim.fly(table).measurements
    assert (len(follower.message), len(wing.message)) == (0, 20)
    assert np.isfinite(wing.message[:, :PITCH]).all()
    assert np.isnan(wing.message[:, [PITCH, ROLL]]).all()


class Listener:
    """Swims east, and notes what it receives on further links."""

    received: ClassVar[list[tuple[float, float]]] = []

    def __init__(self, follower: Any) -> None:
        self.depth = follower.depth_m

    def control(self, readings: Any, belief: Any, dt: float) -> Command:
        for received in readings.receptions.values():
            self.received.append((readings.time, received.ranges.rear))
        return Command(0.5 * np.pi, 1.0, self.depth)


def test_a_controller_receives_links_on_which_nobody_navigates() -> None:
    """Once a second, sound at once: the range is the distance from the beacon."""
    beacon = np.array([-50.0, -50.0, -5.0])
    table = {
        "duration_s": 10.0,
        "acoustics": NO_NOISE,
        "links": [
            {"name": "lbl", "beacons_m": [[-50.0, -50.0, 5.0]]},
            # with no one to receive it
            {"name": "own", "sender": "follower"},
        ],
        "followers": [{"route": "T5", "name": "follower"}],
    }
    Listener.received.clear()
    flight = laisn_sim.fly(table, controller=Listener)
    time, ranges = np.array(Listener.received).T
    assert time.tolist() == [float(k) for k in range(1, 11)]
    steps = np.rint(time / 0.1).astype(int) - 1
    distance = np.linalg.norm(flight.hydrophone(0)[steps] - beacon, axis=1)
    np.testing.assert_allclose(ranges, distance, rtol=1e-12)
    assert list(flight.measurements[0].links) == ["lbl"]


def test_a_leader_broadcasts_the_errors_of_its_own_sensors() -> None:
    own_errors = {"speed_bias_m_s": 0.2, "heading_bias_deg": 4.0, "heading_sigma_deg": 1.0}
    leader_errors = {f"leader_{key}": value for key, value in own_errors.items()}
    by_table = (
        laisn_sim.fly(mission_with_beacons(leader={"sensors": own_errors})).measurements[0].message
    )
    by_keys = laisn_sim.fly(mission_with_beacons(sensors=leader_errors)).measurements[0].message
    np.testing.assert_array_equal(by_table, by_keys)
    exact = laisn_sim.fly(mission_with_beacons()).measurements[0].message
    assert (by_table[:, SPEED] - exact[:, SPEED]).mean() == pytest.approx(0.2, abs=1e-9)


def test_a_hydrophone_is_at_the_position_of_its_key() -> None:
    follower = {"name": "follower", "route": "T5", "hydrophone_m": [0.5, 0.2, 0.3]}
    flight = laisn_sim.fly(
        mission_with_beacons(followers=[follower], leader={"hydrophone_m": HYDROPHONE})
    )
    for vehicle, offset in ((0, HYDROPHONE), (1, follower["hydrophone_m"])):
        name = flight.trajectory.names[vehicle]
        from_origin = (
            flight.trajectory.site_path(f"{name}/hydrophone")
            - flight.trajectory.position[:, vehicle]
        )
        forward, port, up = offset
        heading = flight.trajectory.heading[:, vehicle]
        east = forward * np.sin(heading) - port * np.cos(heading)
        north = forward * np.cos(heading) + port * np.sin(heading)
        expected = np.column_stack([east, north, np.full(len(east), up)])
        np.testing.assert_allclose(from_origin, expected, rtol=0, atol=1e-12)


def test_a_leader_that_is_not_steered_by_the_truth_may_leave_its_route() -> None:
    by_controller = {"controller": register(Eastward)}
    by_estimate = {
        "guidance_position": "estimate",
        "navigation": {"variant": "dead-reckoning"},
    }
    assert (
        bounds_of(MotionSettings.of(laisn_sim.load(mission_with_beacons(motion="physics")))).routes[
            0
        ]
        is not None
    )
    for leader in (by_controller, by_estimate):
        scenario = laisn_sim.load(mission_with_beacons(motion="physics", leader=leader))
        assert bounds_of(MotionSettings.of(scenario)).routes[0] is None


@pytest.mark.parametrize(
    ("changes", "expected"),
    {
        "kinematic": (
            {"leader.controller": "a:B"},
            "leader.controller needs motion = 'physics'; the paper's point motion is planned whole",
        ),
        "readings of the leader": (
            {
                "links.0": {"name": "lbl", "sender": "leader", "readings": ["gps"]},
                "motion": "physics",
            },
            "links[0].readings needs a table leader.sensors.custom",
        ),
        "no navigator": (
            {"leader.broadcast_position": "estimate", "motion": "physics"},
            "leader.broadcast_position = 'estimate' needs a table leader.navigation",
        ),
        "unknown link": (
            {"navigation.further_links": ["sonar"]},
            "'sonar' is no link: leader, lbl",
        ),
        "one link": ({"navigation.variant": "imm"}, "takes the messages of one link"),
        "twice": ({"navigation.further_links": ["leader"]}, "'leader' is navigation.link already"),
        "receivers": ({"links.0.receivers": ["boat"]}, "'boat' is no vehicle"),
    }.values(),
)
def test_contradictory_settings_of_links_and_leaders_are_refused(
    changes: dict[str, Any], expected: str
) -> None:
    with pytest.raises(LaisnError) as error:
        laisn_sim.load(mission_with_beacons(), changes)
    assert expected in str(error.value)


@pytest.mark.parametrize(
    ("link", "expected"),
    [
        ({"answers": "sonar"}, "expected a link with a schedule"),
        ({"answers": "lbl", "sender": "leader"}, "leader does not receive that link"),
        ({"answers": "leader"}, "needs acoustics.travel_time = true"),
        ({"answers": "leader", "offset_s": 0.5}, "answers replaces interval_s and offset_s"),
    ],
)
def test_impossible_answers_are_refused(link: dict[str, Any], expected: str) -> None:
    links = [{"name": "lbl", "beacons_m": BEACONS}, {"name": "back", "sender": "wing", **link}]
    with pytest.raises(LaisnError) as error:
        laisn_sim.load(mission_with_beacons(links=links, motion="physics"))
    assert expected in str(error.value)


class PositionReceiver(Sensor):
    """Reads the horizontal position without errors."""

    name = "gps"
    channels: ClassVar = {"east": "m", "north": "m"}
    stream = 20

    def true(self, state: Any, environment: Any) -> tuple[float, float]:
        return float(state.position[0]), float(state.position[1])

    def read(self, true: Floats, draws: Floats) -> Floats:
        return true


class ByPositionReceiver:
    """A navigator whose estimate is the reading of the receiver, shifted by 2 m to the east."""

    needs = ("gps",)

    def __init__(self, settings: Any, start: Floats) -> None:
        self.state, self.covariance = np.array(start, float), np.eye(4)

    def step(self, own: Any, reception: Any, dt: float) -> None:
        self.state[:2] = own.custom["gps"] + np.array([2.0, 0.0])


@pytest.mark.system
def test_a_leader_reads_sensors_of_its_own_and_the_error_of_its_estimate_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    table: dict[str, Any] = {
        "duration_s": 6.0,
        "leader": {
            "sensors": {"custom": [{"sensor": register(PositionReceiver)}]},
            "navigation": {"variant": register(ByPositionReceiver)},
            "hydrophone_m": [0.0, 0.0, 0.0],
        },
        "links": [
            {
                "name": "status",
                "sender": "leader",
                "transmitters_m": [[0.0, 0.0, 0.0]],
                "readings": ["gps"],
                "receivers": ["follower"],
            }
        ],
        "navigation": {"variant": "ekf"},
        "followers": [{"name": "follower", "route": "T5"}],
    }
    scenario = laisn_sim.load(table)
    scenario.save("leader.toml")
    result = CliRunner().invoke(app, ["fly", "leader.toml", "--no-video", "--out", "out"])
    assert result.exit_code == 0, result.output
    assert "is 2.00 m off at most, 2.00 m on average" in result.output
    flight = laisn_sim.read_log("out/flight.mcap")
    leader = flight.leader
    assert leader is not None
    position = flight.trajectory.position[flight.step_index(), 0, :2]
    np.testing.assert_array_equal(leader.measurements.custom["gps"], position)
    assert leader.measurements.sensors["gps"].channels[0] == ("east", "m")
    # the follower has no such sensor, but receives the readings of the leader's
    measured = flight.measurements[0]
    assert not measured.custom
    status = measured.links["status"]
    sent = np.round(status.message[:, TIME] / 0.1).astype(int)
    assert len(sent) == 6
    np.testing.assert_array_equal(status.content["gps"], position[sent - 1])
    # 2 m off, in the summary, the log and the page
    summary = json.loads(Path("out/summary.json").read_text("utf-8"))["leader"]
    assert summary["e_p_mean_m"] == pytest.approx(2.0, abs=1e-9)
    assert summary["nees"] == pytest.approx(4.0, abs=1e-9)
    errors = Contents(Path("out/flight.mcap")).require("/leader/error", ())
    np.testing.assert_allclose(errors.table(["position_error"]), 2.0, rtol=0, atol=1e-9)
    page = Path("out/report.html").read_text("utf-8")
    assert "The leader&#39;s own estimate" in page


@pytest.mark.system
def test_a_log_has_all_states_of_a_leader_that_has_received_nothing(tmp_path: Path) -> None:
    """For a leader that navigates by `tight`: the log has no message of the kind by which a reader
    tells its estimates from others.
    """
    table = {
        "duration_s": 3.0,
        "leader": {"navigation": {"variant": "tight"}},
        "followers": [{"route": "T5"}],
    }
    flight = laisn_sim.fly(table)
    path = tmp_path / "flight.mcap"
    laisn_sim.write_log(flight, path)
    from_log = laisn_sim.read_log(path)
    assert flight.leader is not None
    assert from_log.leader is not None
    assert flight.leader.estimates is not None
    assert type(from_log.leader.estimates) is type(flight.leader.estimates) is TightEstimates
    np.testing.assert_array_equal(from_log.leader.estimates.state, flight.leader.estimates.state)
    assert from_log.leader.estimates.used.size == 0
