"""Missions that are stepped together: each is what it is alone, to the bit."""

import copy
import os
import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import laisn_sim
from laisn.errors import LaisnError
from laisn.plugins import register
from laisn_sim import Command, Simulation, Simulations, Wrench
from sim.custom_control import Readings
from sim.flight import Termination
from sim.mission_group import MissionGroup
from sim.simulation import DivergedError
from tests.laisn_sim.test_simulation import CLOSED_LOOP, OPEN_LOOP, require_same_bits

DIRECT = {"timing.engine": "direct"}
WAVES = {
    "ocean.waves.kind": "jonswap",
    "ocean.waves.height_m": 1.0,
    "ocean.waves.period_s": 6.0,
    "ocean.waves.components": 10,
}


@pytest.fixture
def moved_together(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many instants were flown side by side, in turn, summed over missions."""
    counts: list[int] = []
    advance = MissionGroup.advance

    def counting(group: MissionGroup, ends: Any) -> dict[int, int]:
        before = sum(mission.instants for mission in group.missions)
        failed = advance(group, ends)
        counts.append(sum(mission.instants for mission in group.missions) - before)
        return failed

    monkeypatch.setattr(MissionGroup, "advance", counting)
    return counts


@pytest.mark.system
@pytest.mark.parametrize(
    ("table", "changes"),
    [
        pytest.param(OPEN_LOOP, {}, id="open loop"),
        pytest.param(CLOSED_LOOP, {}, id="closed loop"),
        pytest.param(OPEN_LOOP, WAVES, id="waves", marks=pytest.mark.long),
    ],
)
def test_each_mission_is_the_one_that_is_flown_alone(
    table: dict[str, Any], changes: dict[str, Any], moved_together: list[int]
) -> None:
    """Ten missions, of which eight lie side by side, and two are too few for that; they differ in
    noise, current and commands, from which they are freed in between.
    """
    each = [{"ocean.current_speed_m_s": 0.02 * i} for i in range(10)]
    sims = Simulations(table, changes, each=each)
    follower = sims.names[-1]
    heading = np.linspace(-1.0, 2.0, 10)

    def command(which: Any, command_one: Callable[[int], Any], command_all: Any) -> None:
        sims.command(follower, command_all, which)
        for i in which:
            alone[i].command(follower, command_one(i))

    alone = [
        Simulation(table, {**changes, **own, **DIRECT, "run": i}) for i, own in enumerate(each)
    ]
    sims.step(3.0)
    for sim in alone:
        sim.step(3.0)
    all_of_them = range(10)
    command(all_of_them, lambda i: Command(heading[i], 0.9, 9.0), Command(heading, 0.9, 9.0))
    for _ in range(4):
        sims.step(1.0)
    for sim in alone:
        sim.step(4.0)
    command([1, 5], lambda i: Wrench(surge=4.0 + i), Wrench(surge=np.array([5.0, 9.0])))
    command([2, 3], lambda _: None, None)
    sims.step(5.0)
    for sim in alone:
        sim.step(5.0)
    assert moved_together == [8 * 30, *[8 * 10] * 4, 8 * 50]
    sims.step(60.0)
    assert sims.done.all()
    for i, sim in enumerate(alone):
        sim.step(60.0)
        require_same_bits(sims[i].flight(), sim.flight())


@pytest.mark.system
def test_arrays_hold_what_each_mission_says_of_itself() -> None:
    sims = Simulations(CLOSED_LOOP, {"acoustics.loss_probability": 0.5}, count=4)
    assert len(sims) == 4
    assert sims.names == ("leader", "port", "astern")
    before = sims.latest["port"]
    assert np.isnan([before.time, before.message.heading, before.ranges.rear]).all()
    sims.step(7.3)
    assert sims.time.tolist() == [7.3] * 4
    for i, sim in enumerate(sims):
        for name, truth in sim.truth.items():
            of_all = sims.truth[name]
            for key in ("position", "quaternion", "velocity", "water_velocity", "effectors"):
                np.testing.assert_array_equal(getattr(of_all, key)[i], getattr(truth, key), key)
            angles = [of_all.depth, of_all.heading, of_all.pitch, of_all.roll]
            expected = [truth.depth, truth.heading, truth.pitch, truth.roll]
            assert [angle[i] for angle in angles] == pytest.approx(expected, abs=1e-15)
        for name in sims.names[1:]:
            reading, readings = sim.readings[name], sims.readings[name]
            for key in reading._fields[:9]:
                assert getattr(readings, key)[i] == pytest.approx(getattr(reading, key), abs=1e-15)
            for of_all, own in (
                (sims.estimates[name], sim.estimates[name]),
                (sims.latest[name].message, sim.latest[name].message),
                (sims.latest[name].ranges, sim.latest[name].ranges),
            ):
                np.testing.assert_array_equal([values[i] for values in of_all], own)
            assert sims.latest[name].time[i] == sim.latest[name].time
    # noise of runs of their own
    assert len(set(sims.readings["port"].heading)) == 4


def test_what_was_received_last_stays_until_the_next_message() -> None:
    """It is the message of the instant at which it was in; one of two in a hundred is lost."""
    sim = Simulation(CLOSED_LOOP)
    seen: dict[str, Any] = {}
    for _ in range(100):
        sim.step()
        for name in sim.names[1:]:
            reception = sim.receptions[name]
            if reception is not None:
                seen[name] = (sim.time, reception.message, reception.ranges)
            if name in seen:
                time, message, ranges = seen[name]
                latest = sim.latest[name]
                assert latest.time == pytest.approx(time)
                np.testing.assert_array_equal(latest.message, message)
                np.testing.assert_array_equal(latest.ranges, ranges)
    assert set(seen) == {"port", "astern"}


@pytest.mark.system
def test_missions_set_out_anew_move_beside_others_unless_the_sea_changes(
    moved_together: list[int],
) -> None:
    """In calm water at whatever time each is; in waves beside those at the same time."""
    for changes, together in (({}, 4 * 20), (WAVES, 3 * 20)):
        moved_together.clear()
        sims = Simulations(OPEN_LOOP, changes, count=4)
        sims.step(2.0)
        sims.reset([False, True, False, False], seed=9)
        assert sims.time.tolist() == [2.0, 0.0, 2.0, 2.0]
        sims.step(2.0)
        assert moved_together[-1] == together
        alone = Simulation(OPEN_LOOP, {**changes, **DIRECT, "run": 1, "seed": 9}).step(2.0)
        require_same_bits(sims[1].flight(), alone.flight())
        others = Simulation(OPEN_LOOP, {**changes, **DIRECT, "run": 2}).step(4.0)
        require_same_bits(sims[2].flight(), others.flight())


@pytest.mark.system
def test_a_mission_that_ends_early_does_not_hold_others_up() -> None:
    """One dives to the floor, and stays in the arrays as it ended."""
    sims = Simulations(OPEN_LOOP, {"ocean.floor_depth_m": 14.0}, count=4)
    sims.command("follower", Command(0.0, 1.2, 40.0), [2])
    sims.step(15.0)
    assert sims.outcomes[2] is Termination.GROUNDED
    assert sims.done.tolist() == [False, False, True, False]
    ended = sims.time[2]
    assert 1.0 < ended < 15.0
    sims.step(20.0)
    assert sims.done.all()
    assert sims.time.tolist() == [20.0, 20.0, ended, 20.0]
    assert -sims.truth["follower"].position[2, 2] > 14.0
    assert sims.readings["follower"].depth[2] == pytest.approx(14.0, abs=0.2)
    assert sims.latest["follower"].time[2] <= ended
    with pytest.raises(LaisnError, match="all missions have ended"):
        sims.step()
    alone = Simulation(OPEN_LOOP, {**DIRECT, "ocean.floor_depth_m": 14.0, "run": 3}).step(20.0)
    require_same_bits(sims[3].flight(), alone.flight())
    sims.reset()
    assert sims.time.tolist() == [0.0] * 4


@pytest.mark.system
def test_a_mission_that_is_lost_does_not_hold_others_up() -> None:
    """Its follower is given a velocity at which drag leaves finite numbers. The commands of the
    others are worked out once for the instant that ended their moving side by side.
    """
    sims = Simulations(OPEN_LOOP, count=4)
    sims.step(1.0)
    sims.command("follower", Command(1.0, 0.8, 9.0))
    sims[1].mission.plant.twist[1, 0] = 1e200
    sims.step(5.0)
    assert sims.outcomes[1] is Termination.DIVERGED
    alone = Simulation(OPEN_LOOP, {**DIRECT, "run": 2}).step(1.0)
    alone.command("follower", Command(1.0, 0.8, 9.0))
    alone.step(5.0)
    require_same_bits(sims[2].flight(), alone.flight())


@pytest.mark.system
def test_a_mission_that_is_lost_tells_where_it_was_last() -> None:
    """Stepped by itself then, it says what it says where it was always alone."""
    sims = Simulations(OPEN_LOOP, count=4).step(3.0)
    alone = Simulation(OPEN_LOOP, {**DIRECT, "run": 1}).step(3.0)
    texts = []
    for sim in (sims[1], alone):
        sim.mission.plant.twist[1, 0] = 1e200
        with pytest.raises(DivergedError, match="last good pose") as caught:
            sim.step()
        texts.append(str(caught.value))
    assert texts[0] == texts[1]


@pytest.mark.system
def test_a_navigator_that_fails_is_named_when_all_others_are_there() -> None:
    """Its covariance is made negative."""
    sims = Simulations(OPEN_LOOP, count=4)
    sims.step(1.0)
    swarm: Any = sims[1].mission.controller
    swarm.swarm.beliefs["covariance"][:] *= -1.0
    with pytest.raises(ArithmeticError, match="mission 1: the covariance of follower 1 is not"):
        sims.step(5.0)
    assert sims.time[[0, 2, 3]].tolist() == [6.0] * 3
    assert sims.time[1] < 6.0


def test_missions_with_parts_in_python_are_stepped_one_by_one() -> None:
    table = {**OPEN_LOOP, "navigation": {"variant": "ekf"}}
    sims = Simulations(table, count=3)
    sims.step(2.0)
    alone = Simulation(table, {"run": 2, **DIRECT}).step(2.0)
    require_same_bits(sims[2].flight(), alone.flight())


def test_the_engine_is_the_one_that_is_named() -> None:
    def engines(*arguments: Any) -> set[str]:
        return {sim.scenario.timing.engine for sim in Simulations(*arguments, count=2)}

    assert engines(OPEN_LOOP) == {"direct"}
    assert engines(OPEN_LOOP, {"timing.engine": "mujoco"}) == {"mujoco"}
    scenario = laisn_sim.Scenario(**OPEN_LOOP)
    assert engines(scenario) == {"direct"}
    assert engines(laisn_sim.load(scenario, {"duration_s": 15.0})) == {"direct"}
    assert engines(scenario, {"timing.engine": "mujoco"}) == {"mujoco"}
    assert engines(laisn_sim.Scenario(**OPEN_LOOP, timing={"engine": "mujoco"})) == {"mujoco"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"count": 0}, "count is 0"),
        ({"count": 2, "each": [{}]}, "count is 2 and each has 1 tables"),
        ({"each": [{"followers.0.name": "a"}, {}]}, "differ in names"),
        ({"each": [{"followers.0.depth_m": -3}]}, r"followers\[0\].depth_m"),
    ],
)
def test_impossible_missions_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(LaisnError, match=message):
        Simulations(OPEN_LOOP, **arguments)


@pytest.mark.parametrize(
    ("command", "which", "message"),
    [
        (Command(np.zeros(2), 1.0, 9.0), None, "arrays of 3"),
        (Command(np.zeros(3), 1.0, 9.0), [0], "arrays of 1"),
        (Command(np.array([0.0, np.nan, 0.0]), 1.0, 9.0), None, "mission 1: command of follower"),
        (np.zeros((3, 1)), None, "mission 0: command of follower"),
        ((0.0, 1.0, 9.0), None, "expected a Command"),
        (None, [3], "indices below 3"),
        (None, [True], "3 truth values"),
        (None, [0.5], "indices below 3"),
    ],
)
def test_an_invalid_command_is_refused(command: Any, which: Any, message: str) -> None:
    sims = Simulations(OPEN_LOOP, count=3)
    with pytest.raises(LaisnError, match=message):
        sims.command("follower", command, which)


def test_resets_take_a_value_for_all_or_one_for_each() -> None:
    sims = Simulations(OPEN_LOOP, count=3)
    sims.reset(seed=[4, 5], run=2, which=[0, 2])
    assert [(sim.scenario.seed, sim.scenario.run) for sim in sims] == [(4, 2), (1, 1), (5, 2)]
    sims.reset([1], each=[{"ocean.current_speed_m_s": 0.2}])
    assert sims[1].scenario.ocean.current_speed_m_s == 0.2
    with pytest.raises(LaisnError, match="seed has 2 values, expected one for each of 3"):
        sims.reset(seed=[1, 2])
    with pytest.raises(LaisnError, match="neither copied nor pickled"):
        copy.copy(sims)


def test_values_of_some_missions_are_given_in_the_order_in_which_these_are_named() -> None:
    """Effectors of missions that no step has moved are commanded: each takes its own."""
    sims = Simulations(OPEN_LOOP, count=3)
    sims.reset([2, 0], seed=[4, 5])
    assert [sim.scenario.seed for sim in sims] == [5, 1, 4]
    sims.command("follower", Command(np.array([1.0, 2.0]), 1.0, 10.0), [2, 0])
    sims.step(15.0)
    headings = sims.truth["follower"].heading
    assert headings[[0, 2]] == pytest.approx([2.0, 1.0], abs=0.2)
    for which in ([1, 1], [True, 1]):
        with pytest.raises(LaisnError, match="each once"):
            sims.command("follower", None, which)


def test_missions_that_are_stepped_or_set_out_by_themselves_are_shown_as_they_are(
    moved_together: list[int],
) -> None:
    sims = Simulations(OPEN_LOOP, count=3)
    sims.step(1.0)
    before = sims.truth["follower"].position
    sims[1].step(2.0)
    np.testing.assert_array_equal(
        sims.truth["follower"].position[1], sims[1].truth["follower"].position
    )
    sims[2].reset()
    np.testing.assert_array_equal(
        sims.truth["follower"].position[2], sims[2].truth["follower"].position
    )
    np.testing.assert_array_equal(sims.truth["follower"].position[0], before[0])
    sims.step(1.0)
    assert sims.time.tolist() == [2.0, 4.0, 1.0]
    assert moved_together == [30, 30]


def test_arrays_belong_to_those_who_read_them() -> None:
    """Writing to them changes nothing that is read later."""

    def arrays() -> list[Any]:
        truth = sims.truth["follower"]
        latest = sims.latest["follower"]
        readings = sims.readings["follower"]
        return [
            *vars(truth).values(),
            *readings[:9],
            *sims.estimates["follower"],
            latest.time,
            *latest.message,
            *latest.ranges,
        ]

    sims = Simulations(OPEN_LOOP, count=3)
    sims.step(3.0)
    expected = [array.copy() for array in arrays()]
    for array in arrays():
        array[...] = 7.0
    for array, value in zip(arrays(), expected, strict=True):
        np.testing.assert_array_equal(array, value)


# as fast as a BlueROV2 can go
SLOWLY = {"leader.waypoints": [[0.0, 0.0, 0.0], [20.0, 6.0, 0.0]]}


@pytest.mark.parametrize(
    ("each", "message"),
    [
        ({"ocean.current_speed_m_s": -1.0}, "current_speed_m_s"),
        ({"motion": "kinematic"}, "motion is 'kinematic'"),
        ({"followers.0.name": "other"}, "differ in names"),
        ({"leader.model": "bluerov2_heavy", **SLOWLY}, "numbers of effectors"),
    ],
)
def test_a_reset_that_is_refused_changes_no_mission(each: dict[str, Any], message: str) -> None:
    sims = Simulations(OPEN_LOOP, count=3)
    sims.step(1.0)
    before = sims.truth["follower"].position
    with pytest.raises(LaisnError, match=message):
        sims.reset(seed=9, each=[{}, {}, each])
    assert sims.time.tolist() == [1.0] * 3
    assert [sim.scenario.seed for sim in sims] == [1] * 3
    assert [sim.scenario.motion for sim in sims] == ["physics"] * 3
    np.testing.assert_array_equal(sims.truth["follower"].position, before)


@pytest.mark.parametrize(
    ("command", "which"),
    [
        (Command(np.array([1.0, 1.0, np.nan]), 1.0, 9.0), None),
        (Wrench(surge=np.array([1.0, np.inf])), [0, 1]),
        (np.array([[0.0] * 5, [0.0] * 5, [np.nan] * 5]), None),
    ],
)
def test_a_command_that_is_refused_reaches_no_mission(command: Any, which: Any) -> None:
    sims = Simulations(OPEN_LOOP, count=3)
    with pytest.raises(LaisnError, match="all finite"):
        sims.command("follower", command, which)
    sims.step(10.0)
    free = Simulations(OPEN_LOOP, count=3)
    free.step(10.0)
    np.testing.assert_array_equal(sims.truth["follower"].position, free.truth["follower"].position)


def test_errors_of_a_scenario_say_in_a_note_which_mission_has_them() -> None:
    with pytest.raises(LaisnError) as made:
        Simulations(OPEN_LOOP, each=[{}, {"duration_s": "x"}])
    with pytest.raises(LaisnError) as set_out:
        Simulations(OPEN_LOOP, count=3).reset([2, 0], each=[{}, {"duration_s": "x"}])
    assert (made.value.__notes__, set_out.value.__notes__) == (["mission 1"], ["mission 0"])


def test_a_vehicle_is_asked_for_even_if_no_mission_is_commanded() -> None:
    with pytest.raises(LaisnError, match="vehicle 'nobody': expected one of leader, follower"):
        Simulations(OPEN_LOOP, count=3).command("nobody", None, [])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"count": 2.5}, "count is 2.5, expected a whole number"),
        ({"count": "3"}, "count is '3', expected a whole number"),
        ({"count": True}, "count is True, expected a whole number"),
        ({"each": 3}, "each is 3, expected a list"),
        ({"each": "abc"}, "each is 'abc', expected a list"),
        ({"each": {"duration_s": 3.0}}, "each is {'duration_s': 3.0}, expected a list"),
        ({"each": [{}, None]}, r"each\[1\] is None, expected a table"),
        ({"each": [{}, 3]}, r"each\[1\] is 3, expected a table"),
        ({"changes": [1]}, r"changes: expected a table"),
    ],
)
def test_numbers_and_changes_of_missions_of_other_types_are_refused(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(LaisnError, match=message):
        Simulations(OPEN_LOOP, **arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": 2.5}, "seed is 2.5, expected"),
        ({"run": "12"}, "run is '12', expected"),
        ({"seed": np.array(5.0)}, r"seed is array\(5.\), expected"),
        ({"seed": np.ones((3, 1))}, r"(?s)seed is array.*, expected"),
        ({"seed": [1, 2, 2.5]}, "seed: Input should be a valid integer"),
        ({"each": 3}, "each is 3, expected"),
        ({"each": {"duration_s": 3.0}}, "each is {'duration_s': 3.0}, expected"),
        ({"each": [{}, {}, 3]}, r"each\[2\] is 3, expected a table"),
        ({"which": [[1], [2, 3]]}, "which is .*, expected indices"),
    ],
)
def test_values_of_other_types_are_refused_when_missions_set_out_anew(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(LaisnError, match=message):
        Simulations(OPEN_LOOP, count=3).reset(**arguments)


@pytest.mark.parametrize(
    "command",
    [
        Command([0.0, [1.0]], 1.0, 9.0),
        Command("1", 1.0, 9.0),
        Command(1j * np.ones(3), 1.0, 9.0),
        Command(np.datetime64("2026-01-01"), 1.0, 9.0),
        np.array(["1"] * 5),
    ],
)
def test_what_is_no_number_is_no_command_of_missions(command: Any) -> None:
    with pytest.raises(LaisnError, match="expected numbers"):
        Simulations(OPEN_LOOP, count=3).command("follower", command)


class _Interrupted(MissionGroup):
    """The first group is interrupted while the others are slow."""

    def advance(self, ends: Any) -> dict[int, int]:
        if self.missions[0] is _Interrupted.first:
            time.sleep(0.1)
            raise KeyboardInterrupt
        time.sleep(0.3)
        return super().advance(ends)

    first: Any = None


def test_no_mission_moves_on_after_a_step_that_was_interrupted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else it would move under the hands of who looks at it or steps it again."""
    monkeypatch.setattr("laisn_sim.simulations.MissionGroup", _Interrupted)
    sims = Simulations(OPEN_LOOP, count=16)
    _Interrupted.first = sims[0].mission
    with pytest.raises(KeyboardInterrupt):
        sims.step(5.0)
    times = sims.time
    time.sleep(0.4)
    np.testing.assert_array_equal(sims.time, times)


class TooDeep:
    """A controller that refuses to work deeper than 9.5 m."""

    def __init__(self, _: object) -> None:
        """Nothing is needed."""

    def control(self, readings: Readings, belief: object, dt: float) -> Command:
        """Hold a course."""
        if readings.depth > 9.5:
            raise RuntimeError("too deep")
        return Command(1.5, 1.0, 9.0)


def test_what_is_wrong_with_a_mission_names_it_and_holds_no_other_up() -> None:
    follower = {"route": "T5", "controller": register(TooDeep), "depth_m": 9.0}
    sims = Simulations({**OPEN_LOOP, "followers": [follower]}, count=3)
    sims.command("follower", Command(1.5, 1.2, 12.0), [1])
    sims.step(15.0)
    sims.command("follower", None, [1])
    with pytest.raises(RuntimeError, match="too deep") as caught:
        sims.step(2.0)
    assert any("mission 1" in note for note in caught.value.__notes__)
    assert sims.time[[0, 2]].tolist() == [17.0, 17.0]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_missions_go_on_in_a_process_that_was_forked_off() -> None:
    """Threads of the first process are not in the second."""
    sims = Simulations(OPEN_LOOP, count=16)
    sims.step(1.0)
    child = os.fork()
    if child == 0:
        signal.alarm(30)
        sims.step(1.0)
        os._exit(int(sims.time.tolist() != [2.0] * 16))
    assert os.waitpid(child, 0)[1] == 0


@pytest.mark.system
def test_a_mission_that_has_ended_has_no_navigator_that_fails_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One dives to the floor; its navigator fails at the end of the step, as the group tells."""
    advance = MissionGroup.advance

    def failing(group: MissionGroup, ends: Any) -> dict[int, int]:
        return {**advance(group, ends), 2: 1}

    monkeypatch.setattr(MissionGroup, "advance", failing)
    sims = Simulations(OPEN_LOOP, {"ocean.floor_depth_m": 14.0}, count=4)
    sims.command("follower", Command(0.0, 1.2, 40.0), [2])
    sims.step(19.0)
    assert sims.outcomes[2] is Termination.GROUNDED
