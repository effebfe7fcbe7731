"""Missions that are stepped from outside, and flights whose followers steer by their own
estimates.
"""

import copy
import pickle
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

import laisn_sim
from laisn.arrays import Floats
from laisn.errors import LaisnError
from laisn.plugins import register
from laisn_sim import Simulation, Wrench
from sim.custom_control import Readings
from sim.flight import FlightRecord, Termination
from sim.simulation import OutsideCommands
from sim.tracking import MissionBounds
from sim.water.floors import LevelFloor

STATIONS = [
    {"name": "port", "station": {"behind_m": 8.0, "port_m": 8.0, "depth_m": 9.0}},
    {"name": "astern", "station": {"behind_m": 16.0, "port_m": 0.0, "depth_m": 11.0}},
]
OPEN_LOOP = {
    "name": "open",
    "duration_s": 20.0,
    "navigation": {"variant": "tight"},
    "acoustics": {"loss_probability": 0.2, "travel_time": True},
    "followers": [{"route": "T5"}],
}
CLOSED_LOOP = {
    "name": "closed",
    "duration_s": 20.0,
    "navigation": {"variant": "laisn-3-2"},
    "acoustics": {"loss_probability": 0.2},
    "leader": {"broadcast_attitude": True},
    "followers": STATIONS,
}


def require_same_bits(actual: FlightRecord, expected: FlightRecord) -> None:
    """All arrays of two flights are equal."""
    pairs = [(actual.trajectory, expected.trajectory)]
    pairs += zip(actual.measurements, expected.measurements, strict=True)
    pairs += zip(actual.estimates, expected.estimates, strict=True)
    for actual_record, expected_record in pairs:
        assert type(actual_record) is type(expected_record)
        for field in fields(expected_record):
            expected_value = getattr(expected_record, field.name)
            if isinstance(expected_value, np.ndarray):
                np.testing.assert_array_equal(
                    getattr(actual_record, field.name), expected_value, field.name
                )
    assert actual.outcome is expected.outcome


@pytest.mark.parametrize("table", [OPEN_LOOP, CLOSED_LOOP], ids=["open loop", "closed loop"])
def test_steps_of_any_length_give_the_flight_of_one_go(table: dict[str, Any]) -> None:
    sim = Simulation(table)
    assert sim.time == 0.0
    for _ in range(7):
        sim.step()
    assert sim.time == 0.7
    sim.step(5.0)
    while not sim.done:
        sim.step(1.3)
    assert sim.time == 20.0
    require_same_bits(sim.flight(), laisn_sim.fly(table))


def test_a_flight_until_now_is_the_beginning_of_the_whole_one() -> None:
    sim = Simulation(OPEN_LOOP).step(12.0)
    beginning = sim.flight()
    assert beginning.outcome is Termination.INTERRUPTED
    whole = sim.step(8.0).flight()
    assert beginning.trajectory.time[-1] == pytest.approx(12.0)
    np.testing.assert_array_equal(beginning.trajectory.pose, whole.trajectory.pose[:121])
    np.testing.assert_array_equal(beginning.estimates[0].state, whole.estimates[0].state[:120])
    np.testing.assert_array_equal(
        beginning.measurements[0].speed, whole.measurements[0].speed[:120]
    )
    before = whole.measurements[0].message_step <= 120
    np.testing.assert_array_equal(
        beginning.measurements[0].message, whole.measurements[0].message[before]
    )
    assert (beginning.estimates[0].fix_step <= 120).all()


FIRST_BELIEFS: list[Any] = []


class FirstBelief:
    """A controller that remembers what it is given first."""

    def __init__(self, vehicle: Any) -> None:
        self.is_first = True

    def control(self, readings: Any, belief: Any, dt: float) -> tuple[float, float, float]:
        """Straight on."""
        if self.is_first:
            FIRST_BELIEFS.append(belief)
        self.is_first = False
        return 0.5, 0.7, 8.0


@pytest.mark.parametrize("variant", ["laisn-2", "tight", "ekf", "dead-reckoning", "particle"])
def test_navigators_begin_with_the_velocity_of_their_start(variant: str) -> None:
    """Before the first step an estimate is the known start, of which velocity is a part: that of
    the hull, which does not turn yet.
    """
    FIRST_BELIEFS.clear()
    changes = {
        "duration_s": 4,
        "navigation.variant": variant,
        "leader.navigation.variant": "dead-reckoning",
        "timing.filter_step_s": 0.5,
        "followers.0.controller": register(FirstBelief),
    }
    sim = Simulation("T5", changes)
    sim.step(0.1)
    for name in ("leader", "follower"):
        sim.reset()
        truth = sim.truth[name]
        start = sim.estimates[name]
        assert np.hypot(*truth.velocity[:2]) > 0.5
        assert (start.east_velocity, start.north_velocity) == pytest.approx(truth.velocity[:2])
        sim.step(0.1)
        moved = sim.estimates[name]
        way = (moved.east - start.east, moved.north - start.north)
        assert way == pytest.approx(0.1 * truth.velocity[:2])
    first = FIRST_BELIEFS[0]
    assert (first.east_velocity, first.north_velocity) == pytest.approx(truth.velocity[:2])


def test_truth_readings_and_estimates_of_each_step_are_those_of_the_flight() -> None:
    sim = Simulation(CLOSED_LOOP)
    names = ("port", "astern")
    snapshots = []
    while not sim.done:
        sim.step()
        snapshots.append((sim.truth, sim.readings, sim.receptions, sim.estimates))
    flight = sim.flight()
    for i, name in enumerate(names):
        measured = flight.measurements[i]
        readings_of_follower = [readings[name] for _, readings, _, _ in snapshots]
        np.testing.assert_array_equal([r.speed for r in readings_of_follower], measured.speed)
        np.testing.assert_array_equal([r.depth for r in readings_of_follower], measured.depth)
        received = [receptions[name] for _, _, receptions, _ in snapshots]
        steps = [k for k, reception in enumerate(received, start=1) if reception is not None]
        assert steps == measured.message_step.tolist()
        np.testing.assert_array_equal([r.ranges for r in received if r], measured.ranges)
        estimated = [(e[name].east, e[name].north) for _, _, _, e in snapshots]
        np.testing.assert_array_equal(estimated, flight.estimates[i].state[:, :2])
    for v, name in enumerate(("leader", *names)):
        truth = [states[name] for states, _, _, _ in snapshots]
        motion = flight.trajectory
        np.testing.assert_array_equal([t.position for t in truth], motion.position[1:, v])
        np.testing.assert_allclose([t.heading for t in truth], motion.heading[1:, v], atol=1e-12)
        np.testing.assert_allclose([t.pitch for t in truth], motion.pitch[1:, v], atol=1e-12)


def test_a_leader_that_is_commanded_turns_and_its_followers_go_with_it() -> None:
    """Northwards and deeper, by a command from outside; then it goes back to its route."""
    sim = Simulation({**CLOSED_LOOP, "duration_s": 160.0}).step(10.0)
    sim.command("leader", (0.0, 0.9, 6.0))
    sim.step(80.0)
    leader = sim.truth["leader"]
    assert np.angle(np.exp(1j * leader.heading)) == pytest.approx(0.0, abs=0.03)
    assert leader.depth == pytest.approx(6.0, abs=0.2)
    assert np.linalg.norm(leader.velocity) == pytest.approx(0.9, abs=0.05)
    follower = sim.truth["astern"]
    assert follower.position[1] > 20.0
    separation = leader.position[:2] - follower.position[:2]
    assert separation == pytest.approx([0.0, 16.0], abs=3.0)
    assert leader.position[1] > 50.0
    sim.command("leader", None)
    sim.step(70.0)
    # the route leads eastwards along north = 0
    leader = sim.truth["leader"]
    assert leader.position[1] == pytest.approx(0.0, abs=5.0)
    assert leader.position[0] > 30.0


def test_commanded_wrenches_and_states_of_effectors_are_applied() -> None:
    sim = Simulation(OPEN_LOOP)
    sim.command("follower", Wrench(surge=5.0))
    sim.step(10.0)
    trajectory = sim.flight().trajectory
    force = trajectory.effector_states[100, 1] @ trajectory.effector_force[1]
    assert force[0] == pytest.approx(5.0, rel=0.02)
    effectors = sim.truth["follower"].effectors
    sim.command("follower", np.zeros_like(effectors))
    sim.step(10.0)
    assert np.abs(sim.truth["follower"].effectors).max() < 1e-6


class Heeling:
    """Heels by a moment of 0.6 N m."""

    def __init__(self, follower: Any) -> None:
        pass

    def control(self, readings: Any, belief: Any, dt: float) -> Wrench:
        return Wrench(roll=0.6)


@pytest.mark.parametrize(
    "command",
    [laisn_sim.Command(heading=0.4, speed=0.9, depth=9.0), Wrench(surge=8.0, yaw=-1.0)],
    ids=["command", "wrench"],
)
def test_a_command_is_worked_out_once_at_each_instant_that_it_holds(command: Any) -> None:
    """In one step of 6 s as in 60 of one instant, also where it is given again at each."""
    in_one, one_by_one, given_again = (Simulation(OPEN_LOOP).step(2.0) for _ in range(3))
    in_one.command("follower", command)
    in_one.step(6.0)
    one_by_one.command("follower", command)
    for _ in range(60):
        one_by_one.step()
        given_again.command("follower", command)
        given_again.step()
    require_same_bits(one_by_one.flight(), in_one.flight())
    require_same_bits(given_again.flight(), in_one.flight())


@pytest.mark.parametrize("forces", [Wrench(surge=5.0), np.zeros(2)])
def test_guidance_begins_anew_at_a_command_after_forces(forces: Any) -> None:
    """As at the first command, and where the vehicle is the scenario's again; not at a command that
    follows another one.
    """
    sim: Any = object.__new__(Simulation)
    plant = SimpleNamespace(names=("rov",), effector_names=[("port", "starboard")])
    routes = SimpleNamespace(commanded_from_outside=np.zeros(1, dtype=np.bool_))
    sim._mission = SimpleNamespace(plant=plant, routes=routes)
    sim._commands = OutsideCommands.none(1, 2)
    sim._bounds = MissionBounds(LevelFloor(30.0), (None,))
    ahead = laisn_sim.Command(heading=0.3, speed=1.0, depth=9.0)
    begins = []
    for command in (ahead, ahead, forces, ahead, ahead, None, ahead):
        sim._commands.begins[:] = False
        sim.command("rov", command)
        begins.append(bool(sim._commands.begins[0]))
    assert begins == [True, False, False, True, False, True, True]


def test_a_follower_goes_on_to_its_station_from_where_commands_have_left_it() -> None:
    """From east to north and down by commands: it wants to turn from there on, by no more than its
    compass is off, and not from the east, where it was before.
    """
    sim = Simulation({**CLOSED_LOOP, "duration_s": 30.0})
    sim.step(5.0)
    sim.command("port", laisn_sim.Command(heading=0.0, speed=1.0, depth=12.0))
    sim.step(15.0)
    sim.command("port", None)
    sim.step(0.1)
    vehicle = sim.truth["port"]
    loop: Any = sim._mission.controller
    wanted = loop.state.memory[0]
    assert np.cos(vehicle.heading) > np.cos(np.deg2rad(3.0))
    assert np.cos(wanted.heading_wanted - vehicle.heading) > np.cos(np.deg2rad(15.0))
    assert wanted.depth_wanted == pytest.approx(vehicle.depth, abs=0.2)


@pytest.mark.parametrize("by_controller", [False, True])
def test_a_moment_of_roll_heels_a_hull_that_can_give_it(by_controller: bool) -> None:
    """To starboard, until the weight below the centre of buoyancy balances it: 0.6 N m =
    m g z sin φ; no other component of the wrench is given.
    """
    follower: dict[str, Any] = {
        "model": "bluerov2_heavy",
        "trim": "neutral",
        "waypoints": [[0, 5, -8], [90, 20, -8]],
        "depth_m": 14.0,
        "start_speed_m_s": 0.0,
    }
    if by_controller:
        follower["controller"] = register(Heeling)
    sim = Simulation({"duration_s": 60.0, "followers": [follower]})
    if not by_controller:
        sim.command("follower", Wrench(roll=0.6))
    sim.step(40.0)
    plant = sim._mission.plant
    roll = sim.truth["follower"].roll
    body = plant.model.body("follower/hull")
    height = plant.coefficients[1]["buoyancy_centre"][2] - body.ipos[2]
    assert np.sin(roll) == pytest.approx(0.6 / (body.mass[0] * 9.81 * height), rel=0.02)
    # the four upright thrusters, 0.218 m to each side: 0.6 N m / (4 · 0.218 m)
    curve = plant.effectors[1, 4]["curve"][: plant.effectors[1, 4]["points"]]
    forces = np.interp(sim.truth["follower"].effectors, *curve.T)
    expected = 0.6 / (4 * 0.218) * np.array([0, 0, 0, 0, -1, 1, -1, 1])
    np.testing.assert_allclose(forces, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("vehicle", "command", "message"),
    [
        ("nobody", (0.0, 1.0, 5.0), "vehicle 'nobody': expected one of leader, follower"),
        ("leader", (0.0, np.nan, 5.0), r"command of leader: .*nan.*; expected heading, speed"),
        ("leader", (0.0, 1.0), "command of leader: .*; expected heading, speed and depth"),
        ("leader", np.zeros(99), "states of [0-9]+ effectors, all finite"),
        ("leader", ("0", 1.0, 5.0), "command of leader: .*; expected heading, speed and depth"),
        ("leader", np.array(["0"] * 5), "states of [0-9]+ effectors, all finite"),
    ],
)
def test_an_invalid_command_is_refused(vehicle: str, command: Any, message: str) -> None:
    with pytest.raises(LaisnError, match=message):
        Simulation(OPEN_LOOP).command(vehicle, command)


@pytest.mark.parametrize(
    "duration",
    [0.0, -1.0, 0.25, np.inf, np.nan, "x", [0.1], True, 10**400, np.complex128(1.0)],
)
def test_a_duration_that_is_no_multiple_of_the_control_step_is_refused(duration: Any) -> None:
    with pytest.raises(LaisnError, match=r"expected a positive multiple of 0\.1 s"):
        Simulation(OPEN_LOOP).step(duration)


def test_a_mission_that_is_over_is_not_stepped() -> None:
    sim = Simulation(OPEN_LOOP)
    with pytest.raises(LaisnError, match="there is no flight yet"):
        sim.flight()
    sim.step(1e6)
    assert sim.outcome is Termination.COMPLETED
    with pytest.raises(LaisnError, match="the mission has ended at 20 s: the mission was flown"):
        sim.step()


def test_a_reset_gives_the_same_bits_or_the_noise_of_another_run() -> None:
    sim = Simulation(CLOSED_LOOP).step(5.0)
    first = sim.flight()
    sim.command("leader", (0.0, 0.5, 3.0))
    again = sim.reset().step(5.0).flight()
    require_same_bits(again, first)
    other_run = sim.reset(run=3).step(5.0).flight()
    assert other_run.scenario.run == 3
    assert not np.array_equal(other_run.measurements[0].speed, first.measurements[0].speed)
    np.testing.assert_array_equal(other_run.trajectory.pose[0], first.trajectory.pose[0])


def test_a_reset_that_is_refused_leaves_the_mission_as_it_is() -> None:
    sim = Simulation(OPEN_LOOP).step(1.0)
    for changes in ({"motion": "kinematic"}, {"duration": 1.0}, [1]):
        with pytest.raises(LaisnError):
            sim.reset(seed=5, changes=changes)
    assert sim.time == 1.0
    assert (sim.scenario.motion, sim.scenario.seed) == ("physics", 1)
    require_same_bits(sim.step(1.0).flight(), Simulation(OPEN_LOOP).step(2.0).flight())
    require_same_bits(sim.reset().step(1.0).flight(), Simulation(OPEN_LOOP).step(1.0).flight())


class Shaky:
    """Dead reckoning with random numbers of its own: a second run gives other estimates."""

    instances: ClassVar[list[Any]] = []
    generator: ClassVar[np.random.Generator] = np.random.default_rng(5)

    def __init__(self, settings: Any, start: Floats) -> None:
        self._dt = settings.dt
        self.state = np.array(start, dtype=np.float64)
        self.covariance = np.eye(4)
        self.steps: list[Floats] = []
        self.instances.append(self)

    def step(self, own: Any, reception: Any, dt: Any = None) -> None:
        sine, cosine = np.sin(own.heading), np.cos(own.heading)
        self.state[2:] = own.speed * sine, own.speed * cosine
        self.state[:2] += self._dt * self.state[2:] + 0.05 * self.generator.normal(size=2)
        self.steps.append(self.state.copy())


@pytest.mark.parametrize("duplicate", [copy.copy, copy.deepcopy, pickle.dumps])
@pytest.mark.parametrize("engine", ["mujoco", "direct"])
def test_a_simulation_is_neither_copied_nor_pickled(
    engine: str, duplicate: Callable[[object], object]
) -> None:
    """Nor is what it consists of; it goes on as if nobody had tried, and its flight is data."""
    scenario = laisn_sim.load(OPEN_LOOP | {"timing": {"engine": engine}})
    sim = Simulation(scenario).step(2.0)
    with pytest.raises(LaisnError, match="to branch, make a second one of the same scenario and"):
        duplicate(sim)
    mission = sim._mission
    parts = [mission, mission.plant]
    if duplicate is not copy.copy:
        parts += [[sim], sim._flown]
        # addresses of MuJoCo's model are in the handles of its steps
        parts += [mission._loop] if engine == "mujoco" else []
    for part in parts:
        with pytest.raises(LaisnError, match="neither copied nor pickled"):
            duplicate(part)
    duplicate(sim.flight())
    require_same_bits(sim.step(2.0).flight(), Simulation(scenario).step(4.0).flight())


def test_a_second_simulation_with_the_same_commands_is_equal_to_the_bit() -> None:
    """Until commands differ."""

    def at_the_branch() -> Simulation:
        sim = Simulation(CLOSED_LOOP).step(3.0)
        sim.command("leader", laisn_sim.Command(heading=0.0, speed=0.9, depth=6.0))
        return sim.step(2.0)

    first, second = at_the_branch(), at_the_branch()
    require_same_bits(first.flight(), second.flight())
    first.command("leader", laisn_sim.Command(heading=3.0, speed=0.9, depth=6.0))
    require_same_bits(second.step(3.0).flight(), at_the_branch().step(3.0).flight())
    apart = first.step(3.0).truth["leader"].heading - second.truth["leader"].heading
    assert abs(apart) > 0.1


def test_a_navigator_with_random_numbers_is_reported_as_it_steered() -> None:
    """And it runs once: as many navigators as followers, and as many steps as filter steps."""
    Shaky.instances.clear()
    flight = laisn_sim.fly(CLOSED_LOOP, navigator=Shaky)
    assert [len(navigator.steps) for navigator in Shaky.instances] == [200, 200]
    for navigator, estimates in zip(Shaky.instances, flight.estimates, strict=True):
        np.testing.assert_array_equal(estimates.state, navigator.steps)


def test_a_factor_graph_in_a_closed_loop_runs_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """One graph for each follower, advanced once in each filter step."""
    pytest.importorskip("gtsam")
    from laisn.rivals.factor_graph import FactorGraph

    advance = FactorGraph._navigate
    advanced: list[FactorGraph] = []

    def advance_and_note(graph: FactorGraph, *arguments: Any) -> Any:
        advanced.append(graph)
        return advance(graph, *arguments)

    monkeypatch.setattr(FactorGraph, "_navigate", advance_and_note)
    flight = laisn_sim.fly(
        {**CLOSED_LOOP, "duration_s": 5.0, "navigation": {"variant": "factor-graph"}}
    )
    graphs = {id(graph): graph for graph in advanced}
    assert [advanced.count(graph) for graph in graphs.values()] == [50, 50]
    for graph, estimates in zip(graphs.values(), flight.estimates, strict=True):
        np.testing.assert_array_equal(estimates.state[-1], graph.state)


def test_an_inverted_usbl_in_a_closed_loop_reads_what_it_logs() -> None:
    sim = Simulation({**CLOSED_LOOP, "navigation": {"variant": "inverted-usbl"}})
    read: dict[str, list[Any]] = {"port": [], "astern": []}
    while not sim.done:
        sim.step()
        for name, reception in sim.receptions.items():
            read[name].append(reception.bearing if reception else (np.nan, np.nan))
    for name, measured in zip(read, sim.flight().measurements, strict=True):
        np.testing.assert_array_equal(read[name], measured.custom["bearing"])
        assert np.isfinite(measured.custom["bearing"]).all(axis=1).sum() > 10


@dataclass(frozen=True, kw_only=True)
class Dvl:
    """Velocity over the floor along the hull's axes [m/s], of noise that it is given."""

    name = "dvl"
    stream = 40
    acoustic = False

    sigma: float = 0.01

    def true(self, state: Any) -> Floats:
        w, x, y, z = state.quaternion.T
        east, north, _ = state.velocity.T
        ahead = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z)])
        return np.column_stack([ahead[0] * east + ahead[1] * north, np.zeros_like(east)])

    def read(self, true: Floats, normals: Floats) -> Floats:
        return np.asarray(true + self.sigma * normals)


class ByDvl(Shaky):
    """Goes by the DVL instead of the log."""

    def step(self, own: Any, reception: Any, dt: Any = None) -> None:
        self.seen = own.custom["dvl"]
        super().step(own._replace(speed=float(self.seen[0])), reception)


def test_a_sensor_of_the_users_is_read_used_and_kept_in_a_closed_loop(tmp_path: Path) -> None:
    from laisn.plugins import register

    sensors = {"custom": [{"sensor": register(Dvl), "sigma": 0.02}]}
    table = {**CLOSED_LOOP, "duration_s": 10.0, "sensors": sensors}
    ByDvl.instances.clear()
    flight = laisn_sim.fly(table, navigator=ByDvl)
    for i, measured in enumerate(flight.measurements):
        dvl = measured.custom["dvl"]
        assert dvl.shape == (100, 2)
        speed = np.hypot(*flight.trajectory.velocity[1:, i + 1, :2].T)
        error = dvl[:, 0] - speed
        # the hull slips a little aside of its way
        assert error.std() == pytest.approx(0.02, rel=0.3)
        np.testing.assert_array_equal(ByDvl.instances[i].seen, dvl[-1])
    read = laisn_sim.read_log(laisn_sim.write_log(flight, tmp_path / "dvl.mcap"))
    for measured, logged in zip(flight.measurements, read.measurements, strict=True):
        np.testing.assert_array_equal(logged.custom["dvl"], measured.custom["dvl"])


def test_observers_get_each_instant_once_in_order() -> None:
    """Joined, their blocks are the truth of the flight, however it was stepped and ended."""
    blocks = []
    starts = []
    sim = Simulation(
        CLOSED_LOOP, observers=[blocks.append, lambda block: starts.append(block.time[0])]
    )
    sim.step()
    assert len(blocks) == 1
    assert blocks[0].time.tolist() == [0.0, 0.1]
    sim.step(5.0)
    assert len(blocks[1].time) == 50
    sim.command("leader", laisn_sim.Command(heading=0.0, speed=0.8, depth=8.0))
    sim.step(0.5)
    assert [len(block.time) for block in blocks[2:]] == [5]
    sim.command("leader", None)
    sim.step(30.0)
    assert sim.done
    truth = sim.flight().trajectory
    assert blocks[0].names == truth.names
    assert starts == [block.time[0] for block in blocks]
    np.testing.assert_array_equal(np.concatenate([block.time for block in blocks]), truth.time)
    for name in ("pose", "twist", "effector_states"):
        joined = np.concatenate([getattr(block.truth, name) for block in blocks])
        np.testing.assert_array_equal(joined, getattr(truth, name), name)
    with pytest.raises(ValueError, match="read-only"):
        blocks[0].truth.pose[0, 0, 0] = 1.0
    sim.reset()
    sim.step(1.0)
    assert blocks[-1].time[0] == 0.0
    assert blocks[-1].time.size == 11


def test_the_last_block_ends_where_hulls_touch() -> None:
    """Two followers meet halfway; what was flown beyond, in the same step, is not shown."""
    head_on = [
        {"waypoints": [[0, start_north, 100], [60, 60 - start_north, 100]], "depth_m": 12.0}
        for start_north in (0, 60)
    ]
    blocks: list[Any] = []
    table = {"name": "s", "duration_s": 40.0, "contact": "end", "followers": head_on}
    sim = Simulation(table, observers=[blocks.append])
    sim.step(40.0)
    assert sim.outcome is Termination.CONTACT
    (block,) = blocks
    assert block.time[-1] == pytest.approx(sim.time)
    assert sim.time < 31.0


# at 14 m of depth, where the floor lies, at instants between filter steps, too
DIVING = {"ocean.floor_depth_m": 14.0, "acoustics.loss_probability": 0.0}


def _dived(step_s: float, table: dict[str, Any], changes: dict[str, Any]) -> Simulation:
    """A mission whose last follower dives to the floor, in steps of this length."""
    sim = Simulation(table, {**DIVING, **changes})
    sim.command(sim.names[-1], (0.0, 1.2, 40.0))
    while not sim.done:
        sim.step(step_s)
    assert sim.outcome is Termination.GROUNDED
    return sim


@pytest.mark.system
@pytest.mark.parametrize(
    ("table", "changes"),
    [
        (OPEN_LOOP, {}),
        (OPEN_LOOP, {"timing.filter_step_s": 0.5}),
        (OPEN_LOOP, {"navigation.variant": "ekf"}),
        (CLOSED_LOOP, {}),
    ],
    ids=["open loop", "filter steps of 0.5 s", "navigator in Python", "closed loop"],
)
def test_what_is_seen_at_an_early_end_is_of_that_instant(
    table: dict[str, Any], changes: dict[str, Any]
) -> None:
    """It does not depend on how far the step went on that ended the mission."""
    slowly = _dived(0.1, table, changes)
    at_once = _dived(20.0, table, changes)
    assert 1.0 < at_once.time == slowly.time < 19.0
    np.testing.assert_equal(at_once.readings, slowly.readings)
    np.testing.assert_equal(at_once.estimates, slowly.estimates)
    np.testing.assert_equal(at_once.receptions, slowly.receptions)
    np.testing.assert_equal(at_once.latest, slowly.latest)
    for name in at_once.names[1:]:
        assert at_once.latest[name].time <= at_once.time


class Diver:
    """A controller that dives, and remembers when it was asked."""

    asked: ClassVar[list[float]] = []

    def __init__(self, _: object) -> None:
        """Nothing is needed."""

    def control(self, readings: Readings, belief: object, dt: float) -> laisn_sim.Command:
        """Dive."""
        self.asked.append(readings.time)
        return laisn_sim.Command(0.0, 1.2, 40.0)


def test_a_controller_is_not_asked_after_the_end_of_its_mission() -> None:
    follower = {"route": "T5", "controller": register(Diver)}
    Diver.asked.clear()
    sim = Simulation({**OPEN_LOOP, "followers": [follower]}, DIVING).step(20.0)
    assert sim.outcome is Termination.GROUNDED
    assert Diver.asked[-1] == pytest.approx(sim.time)
