"""Controllers and navigators by plugins in the closed loop: commands, wrenches, effectors,
readings.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import laisn_sim
from laisn.arrays import records
from laisn.errors import LaisnError
from laisn.plugins import register, takes_readings
from laisn.swarm import ESTIMATE, READING
from sim import custom_control
from sim.closed_loop import simulate_closed_loop
from sim.control.autopilot import AUTOPILOT_MEMORY
from sim.control.follower import FOLLOWER_MEMORY, Senses
from sim.control.guidance import GUIDANCE_MEMORY, REFERENCE
from sim.flight import FlightRecord, navigate

CALLS: dict[str, list[Any]] = {}
"""Readings, estimate and time step of each call of a controller, by the name of its follower."""
EAST = np.pi / 2


class Holding:
    """Holds a heading, a speed and a depth, and records what it is called with."""

    def __init__(self, follower: Any) -> None:
        self.calls = CALLS[follower.name] = []

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        self.calls.append((readings, belief, dt))
        return EAST, 1.2, 11.0


class Turning:
    """Commands a wrench: a constant force ahead, and a moment to port that damps the turn."""

    def __init__(self, follower: Any) -> None:
        pass

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        return laisn_sim.Wrench(surge=5.0, yaw=2.0 - 4.0 * readings.yaw_rate)


class AtRest:
    """Commands all effectors to rest."""

    def __init__(self, follower: Any) -> None:
        pass

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        return np.zeros(5)


class ReturnsText(AtRest):
    """Returns what is no command."""

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        return "fast"


class WithoutReadings:
    """A controller of all vehicles by the truth, which takes no readings."""

    def control(self, k: int, truth: Any) -> None: ...


def followers(*controllers: type) -> list[dict[str, Any]]:
    """A follower for each controller, on parallel routes eastwards."""
    starts = [[0.0, 0.0], [0.0, -20.0], [-20.0, -10.0]]
    return [
        {
            "name": controller.__name__,
            "controller": register(controller),
            "depth_m": 11.0,
            "waypoints": [[0.0, east - 30.0, north], [300.0, east + 270.0, north]],
        }
        for controller, (east, north) in zip(controllers, starts, strict=False)
    ]


@pytest.fixture(scope="module")
def flight_and_loop() -> tuple[FlightRecord, Any]:
    station = {"name": "station", "station": {"behind_m": 45.0, "port_m": 10.0, "depth_m": 14.0}}
    table = {
        "name": "own",
        "duration_s": 40.0,
        "followers": [*followers(Holding, Turning, AtRest), station],
        "navigation": {"variant": "inverted-usbl"},
        "leader": {"broadcast_attitude": True},
    }
    scenario = laisn_sim.load(table)
    trajectory, loop = simulate_closed_loop(scenario)
    return navigate(scenario, trajectory), loop


def test_a_command_is_held_by_the_autopilot(flight_and_loop: tuple[FlightRecord, Any]) -> None:
    motion = flight_and_loop[0].trajectory
    # the compass reads 6.6° too much, of which the navigator has estimated most; by the readings
    # alone the heading would be 83.4°
    assert np.rad2deg(motion.heading[-50:, 1]).mean() == pytest.approx(90.0, abs=3.0)
    assert motion.depth[-50:, 1].mean() == pytest.approx(11.0, abs=0.3)
    assert 0.9 < np.hypot(*motion.velocity[-50:, 1, :2].T).mean() < 1.5


def test_a_wrench_turns_and_drives_the_hull(flight_and_loop: tuple[FlightRecord, Any]) -> None:
    motion = flight_and_loop[0].trajectory
    assert np.unwrap(motion.heading[:, 2])[-1] < np.unwrap(motion.heading[:, 2])[0] - 1.0
    forces = motion.effector_states[100:, 2] @ motion.effector_force[2][:, 0]
    assert forces.mean() == pytest.approx(5.0, rel=0.05)


def test_effectors_at_rest_leave_the_hull_to_its_drag(
    flight_and_loop: tuple[FlightRecord, Any],
) -> None:
    motion = flight_and_loop[0].trajectory
    assert np.abs(motion.effector_states[100:, 3]).max() < 1e-6
    speed = np.hypot(*motion.velocity[:, 3, :2].T)
    assert speed[-1] < 0.5 * speed[0]


def test_readings_and_estimates_are_those_of_navigation_after_the_mission(
    flight_and_loop: tuple[FlightRecord, Any],
) -> None:
    """For a navigator that uses bearings, which the loop measures at each message."""
    flight, loop = flight_and_loop
    measured, estimates, calls = flight.measurements[0], flight.estimates[0], CALLS["Holding"]
    assert len(calls) == 401
    readings, beliefs = [call[0] for call in calls[1:]], [call[1] for call in calls[1:]]
    np.testing.assert_allclose([reading.speed for reading in readings], measured.speed, atol=1e-9)
    np.testing.assert_allclose(
        [reading.heading for reading in readings], measured.heading, atol=1e-9
    )
    received = [k for k, reading in enumerate(readings, start=1) if reading.reception is not None]
    assert received == measured.message_step.tolist()
    bearings = [readings[k - 1].reception.bearing for k in received]
    np.testing.assert_allclose(
        bearings, measured.custom["bearing"][np.array(received) - 1], atol=1e-9
    )
    # a bias of 5° and the mean of the absolute value of an error of 2°, 2° √(2/π)
    assert np.rad2deg(beliefs[-1].compass_bias) == pytest.approx(
        5.0 + 2.0 * np.sqrt(2.0 / np.pi), abs=3.0
    )
    np.testing.assert_allclose(
        [(belief.east, belief.north) for belief in beliefs], estimates.state[:, :2], atol=1e-6
    )
    for i, estimates_of_follower in enumerate(flight.estimates):
        np.testing.assert_allclose(
            loop.state.concluded.state[i, :, :2], estimates_of_follower.state[:, :2], atol=1e-6
        )
    assert {dt for *_, dt in calls} == {0.1}


def test_a_return_value_that_is_no_command_is_refused_with_the_follower_named() -> None:
    with pytest.raises(
        LaisnError,
        match=r"controller of follower returned 'fast'; expected heading, speed and depth",
    ):
        laisn_sim.fly("T5", {"duration_s": 2.0}, controller=ReturnsText, navigator=Odometer)
    assert takes_readings(ReturnsText)
    assert not takes_readings(WithoutReadings)


class Odometer:
    """A navigator that is defined in a script."""

    def __init__(self, settings: Any, start: Any) -> None:
        self.state, self.covariance = np.array(start, float), np.eye(4)

    def step(self, own: Any, reception: Any, dt: float) -> None:
        self.state[2:] = own.speed * np.sin(own.heading), own.speed * np.cos(own.heading)
        self.state[:2] += dt * self.state[2:]


def test_a_navigator_of_a_script_flies() -> None:
    flight = laisn_sim.fly("T5", {"duration_s": 2.0, "motion": "kinematic"}, navigator=Odometer)
    (measured,), (estimates,) = flight.measurements, flight.estimates
    distance_east = 0.1 * (measured.speed * np.sin(measured.heading)).sum()
    first_step_start = estimates.state[0, 0] - 0.1 * measured.speed[0] * np.sin(measured.heading[0])
    assert estimates.state[-1, 0] == pytest.approx(first_step_start + distance_east)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"followers.0.controller": "mine:Pilot"}, "not loaded: add --plugin mine.py"),
        ({"followers.0.controller": "a b"}, "followers"),
        (
            {"followers.0.controller": "mine:Pilot", "motion": "kinematic"},
            "controller needs motion = 'physics'",
        ),
    ],
)
def test_controllers_that_cannot_fly_are_refused(
    settings: dict[str, object], expected: str
) -> None:
    with pytest.raises(LaisnError, match=expected):
        laisn_sim.load("T5", settings)


def test_a_class_without_readings_is_no_controller_of_a_follower() -> None:
    with pytest.raises(
        LaisnError, match=r"expected a class with `control\(readings, belief, dt\)`"
    ):
        laisn_sim.load("T5", {"followers.0.controller": register(WithoutReadings)})


class Answering:
    """Gives the answers that it is made of, one after the other."""

    def __init__(self, answers: list[Any]) -> None:
        self.answers = iter(answers)

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        return next(self.answers)


@pytest.mark.parametrize("forces", [laisn_sim.Wrench(surge=5.0), np.zeros(2)])
def test_a_command_after_forces_begins_where_the_hull_is(
    monkeypatch: pytest.MonkeyPatch, forces: Any
) -> None:
    """The autopilot gets heading and speed as they are measured at the first command, and at the
    first one after forces that turned the hull; neither is turned towards.
    """
    steered: list[Any] = []
    monkeypatch.setattr(custom_control, "apply_wrench", lambda *_: None)
    monkeypatch.setattr(custom_control, "control", lambda *args: steered.append(args[2]))
    headings = [0.3, 1.3, 2.3]
    speeds = [1.0, 0.9, 0.7]
    answers = [
        forces,
        laisn_sim.Command(headings[1], speeds[1], 5.0),
        forces,
        laisn_sim.Command(headings[2], speeds[2], 5.0),
    ]
    vehicle: Any = SimpleNamespace(controller=register(Answering), without_hidden_errors=answers)
    plant: Any = SimpleNamespace(names=("rov",), effector_names=[("port", "starboard")])
    routes: Any = SimpleNamespace(
        kinds=None,
        reference=records(REFERENCE, 4)[:, None],
        guidance=records(GUIDANCE_MEMORY, 1),
        autopilot_designs=[None],
        autopilot_memories=records(AUTOPILOT_MEMORY, 1),
        command=np.zeros((1, 2)),
    )
    controls = custom_control.CustomControl({0: vehicle}, plant, routes)
    reading = records(READING, 1)[0]
    estimate = records(ESTIMATE, 1)[0]
    memory = records(FOLLOWER_MEMORY, 1)[0]
    for k, moment in enumerate([0, 1, 1, 2]):
        reading.heading = headings[moment]
        reading.speed = speeds[moment]
        # readings are taken as they are, not smoothed with those before
        memory.log = np.nan
        readings = custom_control.readings_of(0.1 * k, reading, None, {}, {})
        controls.command(k, 0, readings, Senses(reading, estimate), memory)
    assert steered == [
        pytest.approx((headings[1], 0.0, speeds[1])),
        pytest.approx((headings[2], 0.0, speeds[2])),
    ]


class Rolling:
    """Rolls a hull by a constant moment, and records what it reads."""

    def __init__(self, vehicle: Any) -> None:
        self.readings = CALLS["rolling"] = []

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        self.readings.append(readings)
        return laisn_sim.Wrench(roll=0.4)


def heel_of_truth(truth: Any) -> float:
    """Angle of the port axis above the level [rad]."""
    port_axis = Rotation.from_quat(np.roll(truth.quaternion, -1)).apply([0.0, 1.0, 0.0])
    return float(np.arcsin(port_axis[2]))


@pytest.mark.parametrize("own_control", [False, True])
def test_readings_have_heel_and_rate_of_roll(own_control: bool) -> None:
    """By a controller, and by a mission that is stepped; of hulls that do not hold roll, too."""
    at_rest = {
        "name": "rov",
        "waypoints": [[0, 20, 0], [30, 20, 0]],
        "model": "bluerov2_heavy",
        "depth_m": 5.0,
    }
    controlled = at_rest | {"controller": register(Rolling)}
    # its propeller heels it
    other = {
        "name": "other",
        "waypoints": [[0, -20, 0], [30, 22, 0]],
        "model": "remus100",
        "depth_m": 5.0,
    }
    table = {
        "name": "roll",
        "duration_s": 8.0,
        "followers": [controlled if own_control else at_rest, other],
        "sensors": {"tilt_sigma_deg": 0.0, "gyro_sigma_deg_s": 0.0},
    }
    sim = laisn_sim.Simulation(table)
    if not own_control:
        sim.command("rov", laisn_sim.Wrench(roll=0.4))
    largest = 0.0
    while not sim.done:
        sim.step()
        for name in ("rov", "other"):
            truth = sim.truth[name]
            reading = sim.readings[name]
            assert reading.heel == pytest.approx(heel_of_truth(truth), abs=1e-9)
            assert reading.roll_rate == pytest.approx(truth.angular_velocity[0], abs=1e-9)
        largest = max(largest, sim.readings["rov"].heel)
    assert abs(sim.readings["other"].heel) > 1e-3
    assert largest > 0.1
