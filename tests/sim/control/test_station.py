"""Trail, stations and laws, against closed forms: straight lines, circles, a vehicle without
lag.
"""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laisn.arrays import Floats, Ints, Record, Records, records
from sim.control import station as way
from sim.control.follower import (
    ALOS,
    CONSTANT_BEARING,
    FOLLOWER_MEMORY,
    ILOS,
    approach,
    plan_detour,
)
from sim.control.station import (
    AGILITY,
    FRAME_STATE,
    NO_PLAN,
    STATION,
    Target,
    rate_limited_velocity,
    station_at,
    turn_frame,
)
from sim.scenario.formation import Formation
from sim.tracking import stations_along
from tests.synthetic import record

FRAME = Formation(inner_slowdown=0.35, preview_s=0.0).record()


def laid(
    points: Floats, times: Floats, headings: Floats | None = None, through: float = 1.0
) -> tuple[Records, Ints]:
    trail, count = records(way.TRAIL, len(points) + 1), np.zeros(1, dtype=np.int64)
    for i, (point, time) in enumerate(zip(points, times, strict=True)):
        heading = 0.0 if headings is None else float(headings[i])
        way.extend(trail, count, float(point[0]), float(point[1]), float(time), (through, heading))
    return trail, count


def straight(
    speed: float = 1.5, course: float = 0.3, seconds: int = 60
) -> tuple[Records, Ints, Floats]:
    ahead = np.array([np.sin(course), np.cos(course)])
    times = np.arange(seconds + 1.0)
    trail, count = laid(speed * times[:, None] * ahead, times, np.full(times.size, course))
    return trail, count, ahead


@pytest.mark.parametrize("arc", [-30.0, 0.0, 12.34, 90.0, 120.0])
def test_a_straight_trail_goes_on_at_both_ends(arc: float) -> None:
    trail, count, ahead = straight()
    east, north, ahead_east, ahead_north, through = way.place_at(trail, count[0], arc)
    assert (east, north) == pytest.approx(tuple(arc * ahead), abs=1e-9)
    assert (ahead_east, ahead_north, through) == pytest.approx((*ahead, 1.0))
    assert trail[count[0] - 1].pace == pytest.approx(1.5)
    assert way.arc_at(trail, count[0], 70.0) == pytest.approx(105.0)
    assert way.arc_at(trail, count[0], 12.5) == pytest.approx(18.75)


def test_a_trail_through_few_points_of_a_circle_is_the_circle() -> None:
    """Radius 6 m, a point each 5 s at 1 m/s: chords alone would cut by 0.5 m and be 3 % short."""
    radius, times = 6.0, np.arange(0.0, 41.0, 5.0)
    angle = times / radius
    points = radius * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    trail, count = laid(points, times, angle)
    assert trail[count[0] - 1].arc == pytest.approx(40.0, abs=1e-9)
    for arc in np.linspace(6.0, 34.0, 57):
        east, north, ahead_east, ahead_north, _ = way.place_at(trail, count[0], arc)
        course = np.arctan2(ahead_east, ahead_north)
        assert np.hypot(east - radius, north) == pytest.approx(radius, abs=0.08)
        assert (course - arc / radius + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    "share", [lambda t: t * t, lambda t: 2.0 * t - t * t], ids=["ever faster", "ever slower"]
)
def test_a_trail_of_uneven_pace_is_the_circle_everywhere(share: Callable[[Floats], Floats]) -> None:
    """Points lie far from where an even pace would have them."""
    angle = 3.0 * share(np.linspace(0.0, 1.0, 61))
    points = 30.0 * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    trail, count = laid(points, np.arange(61.0), angle)
    for arc in np.linspace(5.0, 85.0, 160):
        east, north, *_ = way.place_at(trail, count[0], arc)
        assert np.hypot(east - 30.0, north) == pytest.approx(30.0, abs=0.02)
        assert 30.0 * np.arctan2(north, 30.0 - east) == pytest.approx(arc, abs=0.05)


def test_a_leader_that_hardly_moves_leaves_no_trail_of_its_trembling() -> None:
    rng = np.random.default_rng(5)
    trail, count = laid(rng.uniform(-0.05, 0.05, (500, 2)), np.arange(500.0))
    assert count[0] <= 3
    assert trail[count[0] - 1].arc < 0.5


def test_a_station_stands_behind_and_to_port() -> None:
    trail, count, ahead = straight()
    memory = record(FRAME_STATE, 0.3, 0.0)
    target = station_at(record(STATION, 20.0, 7.0, 12.0, 0.0), (trail, count[0]), 60.0, memory)
    expected = (90.0 - 20.0) * ahead + 7.0 * np.array([-ahead[1], ahead[0]])
    assert (target.east, target.north) == pytest.approx(tuple(expected))
    assert (target.velocity_east, target.velocity_north) == pytest.approx(tuple(1.5 * ahead))


@pytest.mark.parametrize("port", [-30.0, -10.0, 0.0, 10.0, 30.0])
def test_station_velocities_in_a_turn_stay_within_the_speed_limit(port: float) -> None:
    """A leader turns left by 90° at 10°/s and 1 m/s, in still water."""
    times = np.arange(0.0, 260.0, 0.1)
    course = np.pi / 2 - np.clip((times - 50.0) * np.deg2rad(10.0), 0.0, np.pi / 2)
    steps = 0.1 * np.column_stack([np.sin(course), np.cos(course)])
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])[:-1]
    trail, count = records(way.TRAIL, times.size + 1), np.zeros(1, dtype=np.int64)
    memory, places, velocities, frames = record(FRAME_STATE), [], [], []
    memory.heading = np.pi / 2
    station = record(STATION, 15.0, port, 10.0, 0.0)
    for k, time in enumerate(times):
        way.extend(trail, count, points[k, 0], points[k, 1], time, (1.0, course[k]))
        if k:
            turn_frame(FRAME, station, (trail, count[0]), (time - 0.1, time), 0.1, memory)
        target = station_at(station, (trail, count[0]), time, memory)
        places.append((target.east, target.north))
        velocities.append((target.velocity_east, target.velocity_north))
        frames.append(memory.tolist())
    rate = np.array(frames)[:, 1]
    assert np.abs(rate * port).max() <= (0.35 if port > 0 else 0.7) + 1e-6
    assert np.abs(np.diff(rate) / 0.1 * max(abs(port), 5.0)).max() <= 0.02 + 1e-9
    assert frames[-1][0] == pytest.approx(0.0, abs=0.01)
    # a frame that turns is stopped in time
    assert min(frame[0] for frame in frames) > -0.01
    # the computed velocity is that of the place, once the trail has bent
    moved = np.gradient(np.array(places), 0.1, axis=0)
    np.testing.assert_allclose(np.array(velocities)[300:-2], moved[300:-2], atol=0.12)


@pytest.mark.parametrize("pace", [1.0, 2.5])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.3, 0.3), (-0.2, 0.1)])
def test_an_instantaneous_swing_is_replaced_by_a_turn_about_the_same_instant(
    current: tuple[float, float], pace: float
) -> None:
    """Leader north, then east; a station on the axis passes the corner 20 s later, at 60 s."""
    times = np.arange(0.0, 121.0)
    points = pace * np.column_stack([np.maximum(times - 40.0, 0.0), np.minimum(times, 40.0)])
    trail, count = laid(points, times, np.where(times > 40.0, np.pi / 2, 0.0))
    station, memory = record(STATION, 20.0 * pace, 0.0, 12.0, 0.0), record(FRAME_STATE)
    before, after = (
        np.array([-current[0], pace - current[1]]),
        np.array([pace - current[0], -current[1]]),
    )
    start, end = np.arctan2(*before), np.arctan2(*after)
    for late in (-8.0, -5.0, -2.0, 2.0, 5.0, 8.0):
        command = rate_limited_velocity(
            FRAME, station, (trail, count[0]), 60.0 + late, current, memory, (NO_PLAN, 0.0)
        )
        through = np.array(command) - current
        # half way between what a hull may have turned to already and what it may still have to turn
        # from
        upper = max(start, end - AGILITY * max(-late, 0.0))
        lower = min(end, start + AGILITY * max(late, 0.0))
        expected = 0.5 * (upper + lower)
        # the corner of the trail is rounded over the two metres about it
        assert np.arctan2(*through) == pytest.approx(expected, abs=0.1)
        assert np.hypot(*through) == pytest.approx(
            np.hypot(*(before if late < 0.0 else after)), abs=1e-6
        )


def test_on_a_straight_way_nothing_is_foreseen() -> None:
    trail, count, ahead = straight()
    command = rate_limited_velocity(
        FRAME,
        record(STATION, 20.0, 7.0, 12.0, 0.0),
        (trail, count[0]),
        60.0,
        (0.2, -0.1),
        record(FRAME_STATE, 0.3, 0.0),
        (NO_PLAN, 0.0),
    )
    assert command == pytest.approx(tuple(1.5 * ahead))


def between_envelopes(
    trail: Records, count: int, station: Record, time: float, current: Floats, memory: Record
) -> Floats:
    """The same by McShane's envelopes in NumPy: of headings at all instants at once, over ground
    again at the end.
    """
    later = FRAME.preview + np.arange(-10.0, 11.0)
    speed = trail[count - 1].pace
    arcs = way.arc_at(trail, count, time) - station.behind + later * speed
    course = np.array([np.arctan2(*way.place_at(trail, count, arc)[2:4]) for arc in arcs])
    frame, swept = memory.heading + later * memory.rate, station.port * memory.rate
    needed = speed * np.array([np.sin(course), np.cos(course)]) + swept * np.array(
        [np.sin(frame), np.cos(frame)]
    )
    needed -= current[:, None]
    heading = np.unwrap(np.arctan2(*needed))
    reach = AGILITY * np.abs(np.arange(-10.0, 11.0))
    command = 0.5 * (np.max(heading - reach) + np.min(heading + reach))
    return np.asarray(
        np.hypot(*needed[:, 10]) * np.array([np.sin(command), np.cos(command)]) + current
    )


def test_what_is_foreseen_is_between_the_envelopes_on_legs_and_in_bends() -> None:
    """A way that winds ever tighter, and a frame that turns: from bends that a hull follows to
    those that it cannot.
    """
    times = np.arange(0.0, 200.0)
    course = 2.0 * np.sin((0.02 * times) ** 2)
    points = np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    trail, count = laid(points, times, course)
    n, slow, quick = int(count[0]), 0, 0
    for time in np.arange(60.25, 210.0, 0.7):
        station, memory = record(STATION, 25.0, 8.0, 12.0, 0.0), record(FRAME_STATE, 0.4, 0.01)
        for current in (np.array([0.0, 0.0]), np.array([0.3, 0.5])):
            command = rate_limited_velocity(
                FRAME, station, (trail, n), time, (current[0], current[1]), memory, (NO_PLAN, 0.0)
            )
            expected = between_envelopes(trail, n, station, time, current, memory)
            assert command == pytest.approx(tuple(expected), abs=1e-9)
            late = way.arc_at(trail, n, time) - 25.0
            bends = (
                np.ptp(
                    np.unwrap(
                        [np.arctan2(*way.place_at(trail, n, late + j)[2:4]) for j in range(-10, 11)]
                    )
                )
                > 1.0
            )
            slow, quick = slow + (not bends), quick + bends
    assert slow > 50
    assert quick > 50


def test_the_turn_rate_of_a_curve_is_limited() -> None:
    """The turn of an S is that of both bends together, and little more: by directions at 2000
    places on it.
    """
    times = np.arange(0.0, 100.0)
    course = np.where(times < 50.0, 0.04 * times, 4.0 - 0.04 * times)
    courses = course + 0.3
    trail, count = laid(
        np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0), times, courses
    )
    for since in (-8.0, 5.0, 48.5, 80.2, 98.9):
        arcs = np.linspace(since, trail[count[0] - 1].arc, 2000)
        ways = np.array([way.place_at(trail, count[0], arc)[2:4] for arc in arcs])
        turned = np.abs(np.diff(np.unwrap(np.arctan2(*ways.T)))).sum()
        command = way.turned_since(trail, count[0], since)
        assert command >= turned - 1e-9
        # for the first segment, which comes out of the straight tail, the result is larger
        assert command <= turned + (0.1 if since > 1.0 else 1.0)
    assert way.turned_since(trail, 1, -10.0) == 0.0
    # beyond its head the way is straight, but for the last segment, which may not have been passed
    assert way.turned_since(trail, count[0], 150.0) < 0.1


def law(**changes: float) -> Record:
    """Settings of the laws, some of them others."""
    settings = Formation().record()
    for name, value in changes.items():
        settings[name] = value
    return settings


LAW = law()


def test_at_its_station_a_vehicle_goes_as_the_station_does_less_the_current() -> None:
    target = Target(10.0, 20.0, 0.8, 0.6, 0.8, 0.6)
    east, north, _ = approach(LAW, target, (10.0, 20.0), (0.1, -0.2), 0.1, 0.0)
    assert (east, north) == pytest.approx((0.7, 0.8))


@given(st.floats(-200, 200), st.floats(-200, 200), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_commanded_velocities_are_feasible(x: float, y: float, u: float, v: float) -> None:
    for kind in (CONSTANT_BEARING, ILOS, ALOS):
        target = Target(0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
        east, north, _ = approach(law(law=kind), target, (x, y), (u, v), 0.1, 0.0)
        assert 0.2 - 1e-9 <= np.hypot(east, north) <= 2.5 + 1e-9
        way_east, way_north = 1.0 - u, -v
        assert (east * way_east + north * way_north) / np.hypot(way_east, way_north) >= 0.2 - 1e-9


@pytest.mark.parametrize("kind", [CONSTANT_BEARING, ILOS, ALOS])
def test_a_point_that_follows_the_command_arrives(kind: int) -> None:
    """In a cross current that is known to the first law and unknown to the others."""
    current, place, integral = np.array([0.0, 0.3]), np.array([-30.0, 15.0]), 0.0
    settings = law(law=kind)
    for k in range(6000):
        target = Target(0.1 * k, 0.0, 1.0, 0.0, 1.0, 0.0)
        command = (0.0, 0.3) if kind == CONSTANT_BEARING else (0.0, 0.0)
        east, north, integral = approach(
            settings, target, (place[0], place[1]), command, 0.1, integral
        )
        place = place + 0.1 * (np.array([east, north]) + current)
    off = place - np.array([0.1 * 6000, 0.0])
    assert abs(off[1]) < 0.05
    assert abs(off[0]) < (0.05 if kind == CONSTANT_BEARING else 1.0)


@pytest.mark.parametrize(
    ("velocity", "calls"), [((4.0, 3.0), 2.5), ((0.04, 0.03), 0.2), ((0.8, 0.6), 1.0)]
)
def test_a_station_too_fast_or_too_slow_is_followed_at_the_limit(
    velocity: tuple[float, float], calls: float
) -> None:
    """Along the way of the station, of which nothing is lacking."""
    target = Target(0.0, 0.0, *velocity, *velocity)
    actual = approach(law(min_along_track_speed=0.0), target, (0.0, 0.0), (0.0, 0.0), 0.1, 0.0)
    assert actual == pytest.approx((0.8 * calls, 0.6 * calls, 0.0))


def test_a_far_station_is_approached_at_the_greatest_speed_and_a_near_one_in_proportion() -> None:
    target = Target(0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
    assert approach(LAW, target, (-1e6, 0.0), (0.0, 0.0), 0.1, 0.0)[:2] == pytest.approx((2.0, 0.0))
    assert approach(LAW, target, (-0.05, 0.0), (0.0, 0.0), 0.1, 0.0)[:2] == pytest.approx(
        (1.01, 0.0), abs=1e-5
    )


@given(st.floats(-40, 40), st.floats(-40, 40), st.floats(-20, 20), st.floats(-3, 3))
def test_lines_of_sight_are_those_of_their_papers(
    x: float, y: float, integral: float, course: float
) -> None:
    """ILOS and ALOS, with the error e across the way and its integral or the crab angle β.

    ILOS: ψ = χ − arctan((e + σ ∫) / Δ) and ∫' = Δ e / (Δ² + (e + σ ∫)²).
    ALOS: ψ = χ − β − arctan(e / Δ) and β' = γ Δ e / √(Δ² + e²).
    """
    free = {"min_along_track_speed": -99.0, "min_speed": 0.0, "max_speed": 99.0}
    ahead, dt, delta, sigma = (
        np.array([np.sin(course), np.cos(course)]),
        0.1,
        LAW.lookahead,
        LAW.integral_gain,
    )
    target = Target(3.0, -4.0, *(1.2 * ahead), *(1.2 * ahead))
    along, e = np.array([x, y]) @ ahead, np.array([x, y]) @ np.array([ahead[1], -ahead[0]])
    speed = 1.2 - LAW.approach_speed * along / np.hypot(along, delta)
    for kind, heading, rate in (
        (
            ILOS,
            course - np.arctan((e + sigma * integral) / delta),
            delta * e / (delta**2 + (e + sigma * integral) ** 2),
        ),
        (ALOS, None, sigma / delta**2 * delta * e / np.hypot(delta, e)),
    ):
        held = integral if kind == ILOS else 0.02 * integral
        grown = held + dt * rate
        wanted = course - grown - np.arctan(e / delta) if heading is None else heading
        actual = approach(law(law=kind, **free), target, (3.0 + x, y - 4.0), (0.0, 0.0), dt, held)
        assert actual == pytest.approx(
            (speed * np.sin(wanted), speed * np.cos(wanted), grown), abs=1e-9
        )


RADIUS = 40.0


def way_round(radius: float) -> tuple[Floats, Floats]:
    """100 m to the north, a quarter circle to port, and 300 m to the west at 1 m/s, each second:
    places and headings.
    """
    arc = np.arange(0.0, 0.5 * np.pi * radius) / radius
    heading = np.concatenate([np.zeros(100), -arc, np.full(300, -0.5 * np.pi)])
    points = np.cumsum(np.column_stack([np.sin(heading), np.cos(heading)]), axis=0)
    return points, heading


def least_radius_of(path: Floats) -> float:
    """Of a path each second, over 4 s."""
    steps = path[4::4] - path[:-4:4]
    course = np.unwrap(np.arctan2(*steps.T))
    length = np.hypot(*steps.T)
    turned = np.maximum(np.abs(np.diff(course)), 1e-9)
    return float((0.5 * (length[1:] + length[:-1]) / turned).min())


@pytest.mark.parametrize("port", [10.0, 25.0])
def test_inner_stations_bend_no_more_than_the_hull_can_turn(port: float) -> None:
    """A leader that turns in 1.1 of the least radius leaves no more than √(1/1.1) to inner ones."""
    points, heading = way_round(1.1 * RADIUS)
    paths = []
    for radius in (0.0, RADIUS):
        stations = np.array([record(STATION, 15.0, port, 12.0, radius)]).view(np.recarray)
        formations = np.array([Formation().record()]).view(np.recarray)
        placed = stations_along(points, np.ones(len(points)), heading, stations, formations, 1.0)
        paths.append(np.column_stack([placed.east[:, 0], placed.north[:, 0]]))
        # in the end the station is where it is to be: behind on a leg to the west, port is south
        assert paths[-1][-1] == pytest.approx(points[-1] + (15.0, -port), abs=1.0)
    assert least_radius_of(paths[0]) < 0.85 * RADIUS
    assert least_radius_of(paths[1]) > 0.98 * RADIUS


def test_a_detour_is_what_lies_between_the_station_and_the_planned_arc() -> None:
    """A station rounds a right angle at 1 m/s; the hull's heading turns evenly, half of it
    before: the arc from (−πR/4, 0) ends R − πR/4 beyond the station on either axis.
    """
    memory = record(FOLLOWER_MEMORY)
    dt = 0.01
    half = 0.25 * np.pi * RADIUS
    for time in np.arange(-half, half, dt):
        heading = (time + half) / RADIUS
        east, north = (1.0, 0.0) if time < 0.0 else (0.0, 1.0)
        target = Target(0.0, 0.0, east, north, east, north)
        along = (np.cos(heading), np.sin(heading))
        planned = plan_detour(target, along, 20.0, dt, memory)
        # where the plan is the station's course, the way back to it has begun
        if time < -half + 2.0 or time > half - 2.5:
            continue
        assert (planned.velocity_east, planned.velocity_north) == pytest.approx(along)
    off = RADIUS - half
    assert memory.detour == pytest.approx((off, off), abs=0.02 * RADIUS)
    # on course it is left at 0.3 m/s at most, and fades
    for _ in range(round(300.0 / dt)):
        plan_detour(Target(0.0, 0.0, 0.0, 1.0, 0.0, 1.0), (0.0, 1.0), 20.0, dt, memory)
    # as exp(−t / T) with T = lookahead / 0.3 m/s
    assert np.hypot(*memory.detour) == pytest.approx(np.sqrt(2.0) * off * np.exp(-4.5), rel=0.2)
