"""Commands of followers do not depend on anything that is hidden from them: readings, messages and
what they know of the start are recorded in one world and played back in another, whose truth is
NaN.
"""

from collections.abc import Callable
from importlib.util import find_spec
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from laisn.arrays import Floats
from laisn.navigators import BEACON_VARIANT, NAVIGATORS
from laisn.plugins import register
from sim import closed_loop
from sim.closed_loop import ClosedLoopState, PythonClosedLoop
from sim.scenario.file import validate
from sim.scenario.settings import Scenario
from sim.sensing import observation, own_sensors, proximity, reception
from sim.simulation import RouteControl, simulate_motion
from sim.trajectory import StateHistory
from sim.vehicle.plant import Plant

DURATION = 12.0

HIDDEN: dict[str, Any] = {
    "sensors": {
        "speed_bias_m_s": -0.4,
        "heading_bias_deg": -30.0,
        "leader_heading_bias_deg": -50.0,
        "leader_speed_bias_m_s": 0.5,
        "leader_position_drift_m_s": 0.3,
    },
    "acoustics": {"range_scale_mean_m": 3.0, "clock_offset_s": 0.01},
    "ocean": {"current_speed_m_s": 0.6, "current_direction_deg": 77.0},
}
"""Other errors of sensors, ranges and water than those of the world where readings are recorded."""


class Curious:
    """A controller that steers by every number of its settings, readings and estimates."""

    def __init__(self, follower: Any) -> None:
        # without the long text of the hull's model, which has no errors
        self.settings_text = repr(follower.model_dump(exclude={"model"}))
        self.heading = 1e-3 * (sum(map(ord, self.settings_text)) % 1000)

    def control(self, readings: Any, belief: Any, dt: float) -> Any:
        inputs = [value for value in (*readings, *belief) if isinstance(value, float)]
        if readings.reception:
            inputs += [*readings.reception.message, *readings.reception.ranges]
        finite = [value for value in inputs if np.isfinite(value)]
        return self.heading + 1e-3 * sum(finite), 1.0, 12.0


def world(variant: str, hidden_errors: bool, **formation: Any) -> Scenario:
    """A leader whose compass is 20° off, and followers of each kind that steers by estimates,
    perhaps with the errors that are hidden from them.
    """
    sensor_errors: dict[str, Any] = {}
    hull_errors: dict[str, Any] = {}
    if hidden_errors:
        sensor_errors = {"speed_bias_m_s": 0.3, "heading_bias_deg": 12.0}
        hull_errors = {"drag_scale": 1.3, "thrust_scale": 0.8}
    followers: list[dict[str, Any]] = [
        {"name": "wing", "station": {"behind_m": 8.0, "port_m": 9.0, "depth_m": 11.0}},
        {"name": "astern", "station": {"behind_m": 9.0, "port_m": 0.0, "depth_m": 14.0}},
        {
            "name": "route",
            "guidance_position": "estimate",
            # holds roll
            "model": "lauv",
            "depth_m": 17.0,
            "waypoints": [[0, -20, -9], [100, 80, -9]],
        },
        {
            "name": "own",
            "controller": register(Curious),
            "depth_m": 19.0,
            "waypoints": [[0, -20, 12], [100, 80, 12]],
        },
    ]
    table: dict[str, Any] = {
        "name": "world",
        "duration_s": DURATION,
        "leader": {"waypoints": [[0, 0, 0], [6, 6, 0], [100, 6, 94]], **hull_errors},
        "followers": [
            {**follower, "sensors": sensor_errors, **hull_errors} for follower in followers
        ],
        # the two on stations, 9.5 m apart, sense each other
        "formation": {"proximity": {"range_m": 12.0, "aperture_deg": 60.0}, **formation},
        "navigation": {"variant": variant, "rival": {"particles": 50}},
        "sensors": {"leader_heading_bias_deg": 20.0, "leader_heading_sigma_deg": 1.0},
    }
    return validate(table | (HIDDEN if hidden_errors else {}), "test")


class Tape:
    """What the sensors and the modems of followers returned, in the order of the calls."""

    def __init__(self) -> None:
        self.values: list[Any] = []
        self.playing = False
        self._next = 0

    def rewind(self) -> None:
        self.playing = True

    def pass_through(self, sense: Callable[[], Any], targets: tuple[Any, ...] = ()) -> Any:
        """What `sense` returns and writes into the targets: called and recorded, or, while the
        tape is playing, repeated from the recording.
        """
        if not self.playing:
            result = sense()
            self.values.append((result, [np.array(target) for target in targets]))
            return result
        result, written = self.values[self._next]
        self._next += 1
        for target, value in zip(targets, written, strict=True):
            target[...] = value
        return result


class Taped:
    """A module of sensing as the closed loop calls it, with some of its functions on a tape."""

    def __init__(self, module: ModuleType, tape: Tape) -> None:
        self._module = module
        self._tape = tape

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


class TapedOwnSensors(Taped):
    """`sim.sensing.own_sensors`."""

    has_read_roll = False

    def read_roll(self, *arguments: Any) -> None:
        self._tape.pass_through(lambda: own_sensors.read_roll(*arguments), (arguments[-1],))
        self.has_read_roll = True

    def read_instruments(self, *arguments: Any) -> None:
        self._tape.pass_through(lambda: own_sensors.read_instruments(*arguments), (arguments[-1],))


class TapedReception(Taped):
    """`sim.sensing.reception`."""

    def receive(self, *arguments: Any) -> None:
        inbox = arguments[-1]
        targets = (
            inbox.message_values,
            inbox.ranges,
            inbox.earliest_step,
            inbox.last_sent,
            inbox.outcome,
        )
        self._tape.pass_through(lambda: reception.receive(*arguments), targets)

    def first_message(self, *arguments: Any) -> Any:
        return self._tape.pass_through(lambda: reception.first_message(*arguments).copy())


class TapedObservation(Taped):
    """`sim.sensing.observation`."""

    def start_of(self, *arguments: Any) -> Any:
        return self._tape.pass_through(lambda: observation.start_of(*arguments))


class TapedProximity(Taped):
    """`sim.sensing.proximity`."""

    def __init__(self, module: ModuleType, tape: Tape) -> None:
        super().__init__(module, tape)
        self.has_sensed = False

    def sense_neighbours(self, *arguments: Any) -> None:
        sightings = arguments[-1]
        targets = (sightings.range, sightings.bearing)
        self._tape.pass_through(lambda: proximity.sense_neighbours(*arguments), targets)
        self.has_sensed |= bool(np.isfinite(sightings.range).any())


class Recording:
    """A closed loop whose commands of followers are recorded; if blind, its truth is NaN."""

    def __init__(self, loop: Any, routes: RouteControl, blind: bool) -> None:
        self.loop = loop
        self.routes = routes
        self.blind = blind
        self.commands: list[Floats] = []

    def control(self, k: int, truth: StateHistory) -> int:
        visible_truth = truth
        if self.blind:
            visible_truth = StateHistory(*(np.full_like(array, np.nan) for array in truth))
        failed = self.loop.control(k, visible_truth)
        self.commands.append(self.routes.command[1:].copy())
        # the leader is steered by its own truth
        self.routes.command[np.isnan(self.routes.command)] = 0.0
        return int(failed)


def commands(scenario: Scenario, blind: bool) -> Floats:
    """Commands of all followers at each instant of a flight, shape (n, f, m)."""
    recordings: list[Recording] = []

    def make(plant: Plant, routes: RouteControl) -> Any:
        loop = closed_loop.closed_loop_of(scenario, plant, routes)
        recordings.append(Recording(loop, routes, blind))
        return recordings[0]

    simulate_motion(scenario, make_controller=make)
    return np.array(recordings[0].commands)


CASES = [
    # among beacons there is no leader
    (variant, "constant-bearing")
    for variant in NAVIGATORS
    if variant != BEACON_VARIANT
]
CASES += [("tight", "ilos"), ("tight", "alos")]


@pytest.mark.system
@pytest.mark.parametrize(("variant", "law"), CASES)
def test_commands_do_not_depend_on_what_is_hidden(
    variant: str, law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if variant == "factor-graph" and find_spec("gtsam") is None:
        pytest.skip("GTSAM is not installed")
    tape = Tape()
    read_custom = PythonClosedLoop._read_custom

    def taped_readings(loop: PythonClosedLoop, k: int, truth: StateHistory) -> None:
        def sense() -> list[Any]:
            read_custom(loop, k, truth)
            return list(loop.latest_custom)

        loop.latest_custom[:] = tape.pass_through(sense)

    # as Python, so that what they call can be taped; what counts no references has none
    in_python = {
        "sense": closed_loop._sense,
        "_look_around": closed_loop._look_around,
        "_receive": closed_loop._receive,
    }
    for name, function in in_python.items():
        monkeypatch.setattr(closed_loop, name, getattr(function, "py_func", function))
    taped_own_sensors = TapedOwnSensors(own_sensors, tape)
    monkeypatch.setattr(closed_loop, "own_sensors", taped_own_sensors)
    monkeypatch.setattr(closed_loop, "reception", TapedReception(reception, tape))
    monkeypatch.setattr(closed_loop, "observation", TapedObservation(observation, tape))
    taped_proximity = TapedProximity(proximity, tape)
    monkeypatch.setattr(closed_loop, "proximity", taped_proximity)
    monkeypatch.setattr(PythonClosedLoop, "_read_custom", taped_readings)
    expected = commands(world(variant, hidden_errors=False, law=law), blind=False)
    tape.rewind()
    actual = commands(world(variant, hidden_errors=True, law=law), blind=True)
    assert expected.shape[0] == round(DURATION / 0.1) + 1
    assert taped_proximity.has_sensed
    assert taped_own_sensors.has_read_roll
    # each follower changes a command by more than 0.1
    assert (np.ptp(expected, axis=0).max(axis=1) > 0.1).all()
    np.testing.assert_array_equal(actual, expected)


def test_the_start_of_the_trail_is_what_the_leader_broadcasts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It goes east, its compass is 20° off to starboard, its log 0.3 m/s."""
    states: list[ClosedLoopState] = []
    original_init = closed_loop.init_closed_loop

    def init(*arguments: Any, **keywords: Any) -> ClosedLoopState:
        states.append(original_init(*arguments, **keywords))
        return states[0]

    monkeypatch.setattr(closed_loop, "init_closed_loop", init)
    leader_errors = {"leader_heading_bias_deg": 20.0, "leader_speed_bias_m_s": 0.3}
    scenario = world("tight", hidden_errors=False)
    sensors = scenario.sensors.model_copy(update={**leader_errors, "leader_heading_sigma_deg": 0.0})

    class StopError(Exception):
        """Ends the flight at its start."""

    def make(plant: Plant, routes: RouteControl) -> Any:
        closed_loop.closed_loop_of(scenario.model_copy(update={"sensors": sensors}), plant, routes)
        raise StopError

    with pytest.raises(StopError):
        simulate_motion(scenario, make_controller=make)
    for trail in states[0].trails[:, 0]:
        assert np.rad2deg(trail.heading) == pytest.approx(110.0)
        assert trail.water_speed == pytest.approx(1.3)
        assert (trail.east, trail.north) == (0.0, 0.0)


def test_a_controller_is_handed_no_error_of_its_sensors_or_hull() -> None:
    """Two worlds that differ in these alone."""
    handed_settings = [
        follower.without_hidden_errors.model_dump()
        for follower in (
            world("tight", hidden_errors).followers[3] for hidden_errors in (False, True)
        )
    ]
    assert handed_settings[0] == handed_settings[1]
