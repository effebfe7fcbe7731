"""Guidance on vehicles without lag: a point that moves as commanded, in moving water."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.control import guidance
from sim.scenario import routes
from sim.scenario.point_motion import plan
from sim.scenario.routes import DepthProfile, Route
from tests.synthetic import record

DT = 0.1
NORTHBOUND = Route.timed("north", [[0, 0, 0], [2000, 0, 2000]], 5.0)
CORNER = Route.timed("corner", [[0, 0, 0], [200, 0, 200], [400, 200, 200]], 5.0)


def follow(
    route, duration, water=(0.0, 0.0), offset=(0.0, 0.0), heading=0.0, current_is_known=True
):
    """The reference, and the motion of a point that moves as commanded: east, north, heading, turn
    rate and speed through the water, shape (n, 5).

    `water` is the current [m/s], `offset` the start from the reference [m].
    """
    table = guidance.reference([route], np.arange(0, duration, DT))[:, 0]
    position = np.array([table[0].east, table[0].north]) + np.array(offset)
    velocity = table[0].speed * np.array([np.sin(heading), np.cos(heading)]) - np.array(water)
    speed_through_water = float(velocity @ [np.sin(heading), np.cos(heading)])
    memory = record(guidance.GUIDANCE_MEMORY)
    guidance.start_guidance(
        table[0], heading, speed_through_water, water if current_is_known else (0.0, 0.0), memory
    )
    rows = []
    for row in table:
        if current_is_known:
            guidance.track_current(water, DT, memory)
        else:
            guidance.integrate_offset(row, position, DT, memory)
        psi, rate, speed = guidance.steer(row, position, DT, memory)
        rows.append((*position, psi, rate, speed))
        position = position + DT * (speed * np.array([np.sin(psi), np.cos(psi)]) + np.array(water))
    return table, np.array(rows)


def test_a_reference_holds_motion_and_depth():
    route = Route.timed(
        "dive", [[0, 0, 0], [100, 0, 100]], DepthProfile.through([[0, 5], [50, 10]])
    )
    table = guidance.reference([route, routes.library_route("L")], np.array([0.0, 25.0, 80.0]))
    assert table.shape == (3, 2)
    assert table[:, 0].north == pytest.approx([0, 25, 80])
    # before 0 s the depth is held: half of the first interval of the mean, and a quarter of its
    # rise
    assert table[:, 0].depth == pytest.approx([5 + 0.1 * 6.0 / 8, 7.5, 10])
    assert table[:, 0].sinking == pytest.approx([0.05, 0.1, 0])
    assert table[:, 1].course == pytest.approx(np.pi / 2)


def test_routes_that_are_alike_share_a_reference_that_nobody_can_change():
    time = np.arange(600) * 0.1
    points = [[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]]
    route = Route.at_speed("T2", points, 1.0, DepthProfile.constant(5.0))
    deeper = Route.at_speed("T2", points, 1.0, DepthProfile.constant(6.0))
    before = guidance.reference([route], time).copy()
    guidance.reference([route], time).east[:] = 7.0
    np.testing.assert_array_equal(guidance.reference([route], time), before)
    assert np.all(guidance.reference([deeper], time).depth == before.depth + 1.0)
    assert np.any(guidance.reference([route], time, [0.5]).acceleration != before.acceleration)
    assert np.any(guidance.reference([route], time, None, [9.0]).east != before.east)
    assert np.any(guidance.reference([route], time + 0.05).east != before.east)
    for key, value in (("start_heading", 1.0), ("start_speed", 0.5)):
        changed = guidance.reference([replace(route, **{key: value})], time)
        assert np.any(changed.east != before.east), key
    single = DepthProfile.through([[0.0, 5.0], [10.0, 7.0]])
    repeated = replace(single, period=20.0)
    depths = [guidance.reference([replace(route, depth=d)], time).depth for d in (single, repeated)]
    assert np.any(depths[0] != depths[1])


def test_missions_share_a_reference_only_if_all_that_it_follows_from_is_alike():
    """The answer is that of `reference` for the same arguments, whatever was asked before."""
    arguments = {
        "routes": (NORTHBOUND, CORNER),
        "ticks": 3000,
        "lead": (0.3, 0.3),
        "least_radii": (0.0, 0.0),
    }
    changes = [
        {},
        {"routes": (CORNER, NORTHBOUND)},
        {"routes": (NORTHBOUND, replace(CORNER, start_speed=0.5))},
        {"ticks": 3001},
        {"lead": (0.3, 0.5)},
        {"least_radii": (0.0, 9.0)},
    ]
    tables = []
    for change in [*changes, *changes]:
        changed = arguments | change
        time = DT * np.arange(changed["ticks"] + 1)
        table = guidance.mission_reference(**changed)
        expected = guidance.reference(
            changed["routes"], time, changed["lead"], changed["least_radii"]
        )
        np.testing.assert_array_equal(table, expected)
        assert not table.flags.writeable
        tables.append(table.tobytes())
    assert len(set(tables)) == len(changes)
    assert guidance.mission_reference(**arguments) is guidance.mission_reference(**arguments)


def test_references_of_missions_are_kept_within_a_bounded_memory(monkeypatch):
    routes_of_many = tuple(replace(NORTHBOUND) for _ in range(12))
    none = (0.0,) * 12
    of_many = [guidance.mission_reference(routes_of_many, 9000, none, none) for _ in range(2)]
    # more vehicles than references of single ones are kept
    assert of_many[0] is of_many[1]
    shared = guidance._shared_missions
    shared.clear()
    first, second, third = (
        guidance.mission_reference((NORTHBOUND,), ticks, (0.3,), (0.0,)) for ticks in range(99, 102)
    )
    monkeypatch.setattr(guidance, "_MAX_SHARED_BYTES", 2 * third.nbytes)
    assert guidance.mission_reference((NORTHBOUND,), 99, (0.3,), (0.0,)) is first
    fourth = guidance.mission_reference((NORTHBOUND,), 98, (0.3,), (0.0,))
    # those that were used last stay
    assert [*map(id, shared.values())] == [id(first), id(fourth)]
    assert guidance.mission_reference((NORTHBOUND,), 100, (0.3,), (0.0,)) is not second
    np.testing.assert_array_equal(
        guidance.mission_reference((NORTHBOUND,), 100, (0.3,), (0.0,)), second
    )
    # one that is larger than all that may be kept is not, and leaves the others
    before = [*shared]
    guidance.mission_reference((NORTHBOUND,), 1000, (0.3,), (0.0,))
    assert [*shared] == before
    shared.clear()


def test_on_the_path_nothing_is_corrected():
    table = guidance.reference([CORNER], np.arange(0, 300, DT))[:, 0]
    memory = record(guidance.GUIDANCE_MEMORY, table[0].course, table[0].speed, (0.0, 0.0))
    commands = np.array([guidance.steer(row, (row.east, row.north), DT, memory) for row in table])
    assert commands[:, 0] == pytest.approx(table.course, abs=1e-9)
    assert commands[:, 2] == pytest.approx(table.speed, abs=1e-9)


def test_a_small_cross_track_error_fades_exponentially():
    # y' = −U sin(atan(y / (T U))), for small y: y = y0 exp(−t / T)
    _, flown = follow(NORTHBOUND, 30.0, offset=(0.4, 0.0), heading=-np.arctan(0.1))
    time = np.arange(0, 30.0, DT)
    assert flown[:, 0] == pytest.approx(0.4 * np.exp(-time / 4.0), abs=0.01)


def test_an_along_track_error_is_caught_up():
    _, flown = follow(NORTHBOUND, 80.0, offset=(0.0, -1.0))
    behind = np.arange(0, 80.0, DT) - flown[:, 1]
    assert behind[0] == pytest.approx(1.0)
    assert abs(behind[-1]) < 0.01
    assert flown[:, 4].max() <= 1.0 + 0.3


@pytest.mark.parametrize(("current_is_known", "duration"), [(True, 120.0), (False, 600.0)])
@pytest.mark.parametrize("water", [(0.5, 0.0), (-0.3, 0.4), (0.0, -0.6)])
def test_the_vehicle_crabs_against_a_current(water, current_is_known, duration):
    """By a known current, or by the integral of its offset."""
    _, flown = follow(NORTHBOUND, duration, water=water, current_is_known=current_is_known)
    # what is left of 1 m/s north over ground without the current
    through_water = np.array([0.0, 1.0]) - water
    psi, speed = flown[-1, 2], flown[-1, 4]
    assert psi == pytest.approx(np.arctan2(*through_water), abs=1e-3)
    assert speed == pytest.approx(np.hypot(*through_water), abs=1e-3)
    assert abs(flown[-1, 0]) < 0.01


def test_an_offset_is_converted_to_a_current_within_bounds():
    """Held 1 m to the east it makes 1/400 m/s of it each second; 5 m count as 2 m, and it ends
    at 1 m/s.
    """
    row = guidance.reference([NORTHBOUND], np.zeros(1))[0, 0]
    for offset, seconds, expected in ((1.0, 10.0, 0.025), (5.0, 10.0, 0.05), (-5.0, 500.0, -1.0)):
        memory = record(guidance.GUIDANCE_MEMORY)
        for _ in range(round(seconds / DT)):
            guidance.integrate_offset(row, np.array([offset, 0.0]), DT, memory)
        assert (memory.heading, memory.speed, *memory.current) == pytest.approx(
            (0.0, 0.0, expected, 0.0)
        )


def test_the_current_is_low_passed():
    memory = record(guidance.GUIDANCE_MEMORY)
    for _ in range(round(10.0 / 0.001)):
        guidance.track_current((1.0, 0.0), 0.001, memory)
    assert memory.current[0] == pytest.approx(1 - np.exp(-1), abs=1e-3)


@given(
    st.tuples(st.floats(-100, 100), st.floats(-100, 100)),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    st.floats(0, 1000),
    st.floats(-10, 10),
    st.floats(0, 3),
)
def test_commands_change_no_faster_than_the_vehicle_may(position, water, time, heading, speed):
    row = guidance.reference([routes.library_route("T8")], np.array([time]))[0, 0]
    memory = record(guidance.GUIDANCE_MEMORY, heading, speed, water)
    psi, rate, speed_command = guidance.steer(row, np.array(position), DT, memory)
    assert abs(psi - heading) <= np.deg2rad(10.0) * DT + 1e-12
    assert abs(speed_command - speed) <= 0.2 * DT + 1e-12
    assert rate == pytest.approx((psi - heading) / DT)


def test_the_start_is_taken_as_it_is():
    row = guidance.reference([CORNER], np.zeros(1))[0, 0]
    memory = record(guidance.GUIDANCE_MEMORY)
    guidance.start_guidance(row, 2.0, 0.7, (0.1, -0.2), memory)
    assert (memory.heading, memory.speed, *memory.current) == pytest.approx((2.0, 0.7, 0.1, -0.2))


def test_turns_set_in_and_end_smoothly():
    time = np.arange(0, 400, DT)
    table = guidance.reference([CORNER], time)[:, 0]
    motion = plan(CORNER).at(time)
    assert table.east == pytest.approx(motion.east)
    assert table.speed == pytest.approx(motion.speed)
    turns = np.flatnonzero(motion.turn_rate)
    away_from_ends = np.abs(time - time[turns[0]]) > 1, np.abs(time - time[turns[-1]]) > 1
    assert table[away_from_ends[0] & away_from_ends[1]].course == pytest.approx(
        motion.course[away_from_ends[0] & away_from_ends[1]], abs=1e-9
    )
    # the mean over a width w of a ramp that begins is a parabola of curvature rate / w
    assert table.turn_acceleration.max() == pytest.approx(np.deg2rad(10) / 1.2, rel=1e-6)
    rate = np.gradient(table.course, DT)
    assert np.rad2deg(rate.max()) == pytest.approx(10, abs=1e-6)


def test_accelerations_are_given_early():
    time = np.arange(0, 400, DT)
    on_time = guidance.reference([CORNER], time)[:, 0].turn_acceleration
    early = guidance.reference([CORNER], time, lead=[0.3])[:, 0].turn_acceleration
    assert early[:-3] == pytest.approx(on_time[3:], abs=1e-9)


def test_depth_is_smoothed_and_its_rate_is_that_of_the_mean():
    route = Route.timed(
        "step", [[0, 0, 0], [100, 0, 100]], DepthProfile.through([[0, 5], [50, 5], [50.01, 8]])
    )
    table = guidance.reference([route], np.arange(0, 100, DT))[:, 0]
    # a step's mean is a ramp as long as the width
    assert table.sinking.max() == pytest.approx(3 / 6.0)
    assert table[-1].depth == 8
    assert np.flatnonzero(table.sinking).size * DT == pytest.approx(6.0, abs=2 * DT)
