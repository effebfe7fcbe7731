"""Missions that are stepped together: each is what it is alone, to the bit."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import laisn_sim
from laisn.errors import LaisnError
from laisn_sim import Command, Simulation, Simulations, Wrench
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
    [(OPEN_LOOP, {}), (CLOSED_LOOP, {}), (OPEN_LOOP, WAVES)],
    ids=["open loop", "closed loop", "waves"],
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
