"""Trail, stations and laws, against closed forms: straight lines, circles, a vehicle without
lag.
"""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from laisn.arrays import Floats, Ints, Record, Records, records
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
    TRAIL,
    Target,
    arc_at,
    extend,
    place_at,
    rate_limited_velocity,
    station_at,
    turn_frame,
    turned_since,
)
from sim.scenario.formation import Formation
from sim.tracking import stations_along
from tests.synthetic import record

FRAME = Formation(inner_slowdown=0.35, preview_s=0.0).record()


def lay_trail(
    points: Floats, times: Floats, headings: Floats | None = None, speed: float = 1.0
) -> tuple[Records, Ints]:
    """A trail of these points, with a leader's speed through the water [m/s]; and its length."""
    trail, count = records(TRAIL, len(points) + 1), np.zeros(1, dtype=np.int64)
    for i, (point, time) in enumerate(zip(points, times, strict=True)):
        heading = 0.0 if headings is None else float(headings[i])
        extend(trail, count, float(point[0]), float(point[1]), float(time), (speed, heading))
    return trail, count


def straight_trail(
    speed: float = 1.5, course: float = 0.3, seconds: int = 60
) -> tuple[Records, Ints, Floats]:
    """A straight trail from the origin with a point a second, its length, and its direction."""
    ahead = np.array([np.sin(course), np.cos(course)])
    times = np.arange(seconds + 1.0)
    trail, count = lay_trail(speed * times[:, None] * ahead, times, np.full(times.size, course))
    return trail, count, ahead


@pytest.mark.parametrize("arc", [-30.0, 0.0, 12.34, 90.0, 120.0])
def test_a_straight_trail_goes_on_at_both_ends(arc: float) -> None:
    trail, count, ahead = straight_trail()
    east, north, ahead_east, ahead_north, through = place_at(trail, count[0], arc)
    assert (east, north) == pytest.approx(tuple(arc * ahead), abs=1e-9)
    assert (ahead_east, ahead_north, through) == pytest.approx((*ahead, 1.0))
    assert trail[count[0] - 1].pace == pytest.approx(1.5)
    assert arc_at(trail, count[0], 70.0) == pytest.approx(105.0)
    assert arc_at(trail, count[0], 12.5) == pytest.approx(18.75)


def test_a_trail_through_few_points_of_a_circle_is_the_circle() -> None:
    """Radius 6 m, a point each 5 s at 1 m/s: chords alone would cut by 0.5 m and be 3 % short."""
    radius, times = 6.0, np.arange(0.0, 41.0, 5.0)
    angle = times / radius
    points = radius * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    trail, count = lay_trail(points, times, angle)
    assert trail[count[0] - 1].arc == pytest.approx(40.0, abs=1e-9)
    for arc in np.linspace(6.0, 34.0, 57):
        east, north, ahead_east, ahead_north, _ = place_at(trail, count[0], arc)
        course = np.arctan2(ahead_east, ahead_north)
        assert np.hypot(east - radius, north) == pytest.approx(radius, abs=0.08)
        assert (course - arc / radius + np.pi) % (2 * np.pi) - np.pi == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    "progress", [lambda t: t * t, lambda t: 2.0 * t - t * t], ids=["ever faster", "ever slower"]
)
def test_a_trail_of_uneven_pace_is_the_circle_everywhere(
    progress: Callable[[Floats], Floats],
) -> None:
    """Points lie far from where an even pace would have them."""
    angle = 3.0 * progress(np.linspace(0.0, 1.0, 61))
    points = 30.0 * np.column_stack([1.0 - np.cos(angle), np.sin(angle)])
    trail, count = lay_trail(points, np.arange(61.0), angle)
    for arc in np.linspace(5.0, 85.0, 160):
        east, north, *_ = place_at(trail, count[0], arc)
        assert np.hypot(east - 30.0, north) == pytest.approx(30.0, abs=0.02)
        assert 30.0 * np.arctan2(north, 30.0 - east) == pytest.approx(arc, abs=0.05)


def test_a_leader_that_hardly_moves_leaves_no_trail_of_its_trembling() -> None:
    rng = np.random.default_rng(5)
    trail, count = lay_trail(rng.uniform(-0.05, 0.05, (500, 2)), np.arange(500.0))
    assert count[0] <= 3
    assert trail[count[0] - 1].arc < 0.5


def test_a_station_stands_behind_and_to_port() -> None:
    trail, count, ahead = straight_trail()
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
    trail, count = records(TRAIL, times.size + 1), np.zeros(1, dtype=np.int64)
    memory, places, velocities, frames = record(FRAME_STATE), [], [], []
    memory.heading = np.pi / 2
    station = record(STATION, 15.0, port, 10.0, 0.0)
    for k, time in enumerate(times):
        extend(trail, count, points[k, 0], points[k, 1], time, (1.0, course[k]))
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
    velocity_of_places = np.gradient(np.array(places), 0.1, axis=0)
    np.testing.assert_allclose(np.array(velocities)[300:-2], velocity_of_places[300:-2], atol=0.12)


@pytest.mark.parametrize("pace", [1.0, 2.5])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.3, 0.3), (-0.2, 0.1)])
def test_an_instantaneous_swing_is_replaced_by_a_turn_about_the_same_instant(
    current: tuple[float, float], pace: float
) -> None:
    """Leader north, then east; a station on the axis passes the corner 20 s later, at 60 s."""
    times = np.arange(0.0, 121.0)
    points = pace * np.column_stack([np.maximum(times - 40.0, 0.0), np.minimum(times, 40.0)])
    trail, count = lay_trail(points, times, np.where(times > 40.0, np.pi / 2, 0.0))
    station, memory = record(STATION, 20.0 * pace, 0.0, 12.0, 0.0), record(FRAME_STATE)
    before, after = (
        np.array([-current[0], pace - current[1]]),
        np.array([pace - current[0], -current[1]]),
    )
    start, end = np.arctan2(*before), np.arctan2(*after)
    for after_corner in (-8.0, -5.0, -2.0, 2.0, 5.0, 8.0):
        command = rate_limited_velocity(
            FRAME, station, (trail, count[0]), 60.0 + after_corner, current, memory, (NO_PLAN, 0.0)
        )
        through_water = np.array(command) - current
        # half way between what a hull may have turned to already and what it may still have to turn
        # from
        upper = max(start, end - AGILITY * max(-after_corner, 0.0))
        lower = min(end, start + AGILITY * max(after_corner, 0.0))
        expected = 0.5 * (upper + lower)
        # the corner of the trail is rounded over the two metres about it
        assert np.arctan2(*through_water) == pytest.approx(expected, abs=0.1)
        assert np.hypot(*through_water) == pytest.approx(
            np.hypot(*(before if after_corner < 0.0 else after)), abs=1e-6
        )


def test_on_a_straight_trail_the_command_is_the_velocity_of_the_station() -> None:
    trail, count, ahead = straight_trail()
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


def velocity_between_envelopes(
    trail: Records, count: int, station: Record, time: float, current: Floats, memory: Record
) -> Floats:
    """Velocity over ground by McShane's envelopes in NumPy: half way between the bounds that the
    headings at all instants within 10 s set to the present one at the hull's turn rate.
    """
    instants = FRAME.preview + np.arange(-10.0, 11.0)
    speed = trail[count - 1].pace
    arcs = arc_at(trail, count, time) - station.behind + instants * speed
    course = np.array([np.arctan2(*place_at(trail, count, arc)[2:4]) for arc in arcs])
    frame, sweep_speed = memory.heading + instants * memory.rate, station.port * memory.rate
    velocity = speed * np.array([np.sin(course), np.cos(course)]) + sweep_speed * np.array(
        [np.sin(frame), np.cos(frame)]
    )
    velocity -= current[:, None]
    heading = np.unwrap(np.arctan2(*velocity))
    max_turn = AGILITY * np.abs(np.arange(-10.0, 11.0))
    command = 0.5 * (np.max(heading - max_turn) + np.min(heading + max_turn))
    return np.asarray(
        np.hypot(*velocity[:, 10]) * np.array([np.sin(command), np.cos(command)]) + current
    )


def test_rate_limited_velocities_lie_between_the_envelopes_on_legs_and_in_bends() -> None:
    """A way that winds ever tighter, and a frame that turns: from bends that a hull follows to
    those that it cannot.
    """
    times = np.arange(0.0, 200.0)
    course = 2.0 * np.sin((0.02 * times) ** 2)
    points = np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0)
    trail, count = lay_trail(points, times, course)
    n, n_straight, n_bends = int(count[0]), 0, 0
    for time in np.arange(60.25, 210.0, 0.7):
        station, memory = record(STATION, 25.0, 8.0, 12.0, 0.0), record(FRAME_STATE, 0.4, 0.01)
        for current in (np.array([0.0, 0.0]), np.array([0.3, 0.5])):
            command = rate_limited_velocity(
                FRAME, station, (trail, n), time, (current[0], current[1]), memory, (NO_PLAN, 0.0)
            )
            expected = velocity_between_envelopes(trail, n, station, time, current, memory)
            assert command == pytest.approx(tuple(expected), abs=1e-9)
            arc = arc_at(trail, n, time) - 25.0
            is_bend = (
                np.ptp(
                    np.unwrap(
                        [np.arctan2(*place_at(trail, n, arc + j)[2:4]) for j in range(-10, 11)]
                    )
                )
                > 1.0
            )
            n_straight, n_bends = n_straight + (not is_bend), n_bends + is_bend
    assert n_straight > 50
    assert n_bends > 50


def test_the_turning_of_a_trail_is_that_of_its_directions_added_up() -> None:
    """The turn of an S is that of both bends together, and little more: by directions at 2000
    places on it.
    """
    times = np.arange(0.0, 100.0)
    course = np.where(times < 50.0, 0.04 * times, 4.0 - 0.04 * times)
    courses = course + 0.3
    trail, count = lay_trail(
        np.cumsum(np.column_stack([np.sin(course), np.cos(course)]), axis=0), times, courses
    )
    for first_arc in (-8.0, 5.0, 48.5, 80.2, 98.9):
        arcs = np.linspace(first_arc, trail[count[0] - 1].arc, 2000)
        directions = np.array([place_at(trail, count[0], arc)[2:4] for arc in arcs])
        turned_by_directions = np.abs(np.diff(np.unwrap(np.arctan2(*directions.T)))).sum()
        turned = turned_since(trail, count[0], first_arc)
        assert turned >= turned_by_directions - 1e-9
        # for the first segment, which comes out of the straight tail, the result is larger
        assert turned <= turned_by_directions + (0.1 if first_arc > 1.0 else 1.0)
    assert turned_since(trail, 1, -10.0) == 0.0
    # beyond its head the way is straight, but for the last segment, which may not have been passed
    assert turned_since(trail, count[0], 150.0) < 0.1


def law_settings(**changes: float) -> Record:
    """Settings of the laws, some of them changed."""
    settings = Formation().record()
    for name, value in changes.items():
        settings[name] = value
    return settings


SETTINGS = law_settings()


def test_at_its_station_a_vehicle_goes_as_the_station_does_less_the_current() -> None:
    target = Target(10.0, 20.0, 0.8, 0.6, 0.8, 0.6)
    east, north, _ = approach(SETTINGS, target, (10.0, 20.0), (0.1, -0.2), 0.1, 0.0)
    assert (east, north) == pytest.approx((0.7, 0.8))


@given(st.floats(-200, 200), st.floats(-200, 200), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_commanded_velocities_are_feasible(x: float, y: float, u: float, v: float) -> None:
    for law in (CONSTANT_BEARING, ILOS, ALOS):
        target = Target(0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
        east, north, _ = approach(law_settings(law=law), target, (x, y), (u, v), 0.1, 0.0)
        assert 0.2 - 1e-9 <= np.hypot(east, north) <= 2.5 + 1e-9
        station_east, station_north = 1.0 - u, -v
        assert (east * station_east + north * station_north) / np.hypot(
            station_east, station_north
        ) >= 0.2 - 1e-9


@pytest.mark.parametrize("law", [CONSTANT_BEARING, ILOS, ALOS])
def test_a_point_that_follows_the_command_arrives(law: int) -> None:
    """In a cross current that is known to the first law and unknown to the others."""
    current, position, integral = np.array([0.0, 0.3]), np.array([-30.0, 15.0]), 0.0
    settings = law_settings(law=law)
    for k in range(6000):
        target = Target(0.1 * k, 0.0, 1.0, 0.0, 1.0, 0.0)
        known_current = (0.0, 0.3) if law == CONSTANT_BEARING else (0.0, 0.0)
        east, north, integral = approach(
            settings, target, (position[0], position[1]), known_current, 0.1, integral
        )
        position = position + 0.1 * (np.array([east, north]) + current)
    error = position - np.array([0.1 * 6000, 0.0])
    assert abs(error[1]) < 0.05
    assert abs(error[0]) < (0.05 if law == CONSTANT_BEARING else 1.0)


@pytest.mark.parametrize(
    ("velocity", "speed"), [((4.0, 3.0), 2.5), ((0.04, 0.03), 0.2), ((0.8, 0.6), 1.0)]
)
def test_a_station_too_fast_or_too_slow_is_followed_at_the_limit(
    velocity: tuple[float, float], speed: float
) -> None:
    """Along the way of the station, of which nothing is lacking."""
    target = Target(0.0, 0.0, *velocity, *velocity)
    actual = approach(
        law_settings(min_along_track_speed=0.0), target, (0.0, 0.0), (0.0, 0.0), 0.1, 0.0
    )
    assert actual == pytest.approx((0.8 * speed, 0.6 * speed, 0.0))


def test_a_far_station_is_approached_at_the_greatest_speed_and_a_near_one_in_proportion() -> None:
    target = Target(0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
    assert approach(SETTINGS, target, (-1e6, 0.0), (0.0, 0.0), 0.1, 0.0)[:2] == pytest.approx(
        (2.0, 0.0)
    )
    assert approach(SETTINGS, target, (-0.05, 0.0), (0.0, 0.0), 0.1, 0.0)[:2] == pytest.approx(
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
    no_limits = {"min_along_track_speed": -99.0, "min_speed": 0.0, "max_speed": 99.0}
    ahead, dt, delta, sigma = (
        np.array([np.sin(course), np.cos(course)]),
        0.1,
        SETTINGS.lookahead,
        SETTINGS.integral_gain,
    )
    target = Target(3.0, -4.0, *(1.2 * ahead), *(1.2 * ahead))
    along, e = np.array([x, y]) @ ahead, np.array([x, y]) @ np.array([ahead[1], -ahead[0]])
    speed = 1.2 - SETTINGS.approach_speed * along / np.hypot(along, delta)
    for law, heading, rate in (
        (
            ILOS,
            course - np.arctan((e + sigma * integral) / delta),
            delta * e / (delta**2 + (e + sigma * integral) ** 2),
        ),
        (ALOS, None, sigma / delta**2 * delta * e / np.hypot(delta, e)),
    ):
        integral_before = integral if law == ILOS else 0.02 * integral
        integral_after = integral_before + dt * rate
        expected_heading = (
            course - integral_after - np.arctan(e / delta) if heading is None else heading
        )
        actual = approach(
            law_settings(law=law, **no_limits),
            target,
            (3.0 + x, y - 4.0),
            (0.0, 0.0),
            dt,
            integral_before,
        )
        assert actual == pytest.approx(
            (speed * np.sin(expected_heading), speed * np.cos(expected_heading), integral_after),
            abs=1e-9,
        )


RADIUS = 40.0


def path_round_a_bend(radius: float) -> tuple[Floats, Floats]:
    """100 m to the north, a quarter circle to port, and 300 m to the west at 1 m/s, each second:
    places and headings.
    """
    arc = np.arange(0.0, 0.5 * np.pi * radius) / radius
    heading = np.concatenate([np.zeros(100), -arc, np.full(300, -0.5 * np.pi)])
    points = np.cumsum(np.column_stack([np.sin(heading), np.cos(heading)]), axis=0)
    return points, heading


def least_radius_of(path: Floats) -> float:
    """Least radius of a path with a point a second, over 4 s [m]."""
    steps = path[4::4] - path[:-4:4]
    course = np.unwrap(np.arctan2(*steps.T))
    length = np.hypot(*steps.T)
    turned = np.maximum(np.abs(np.diff(course)), 1e-9)
    return float((0.5 * (length[1:] + length[:-1]) / turned).min())


@pytest.mark.parametrize("port", [10.0, 25.0])
def test_inner_stations_bend_no_more_than_the_hull_can_turn(port: float) -> None:
    """A leader that turns in 1.1 of the least radius leaves no more than √(1/1.1) to inner ones."""
    points, heading = path_round_a_bend(1.1 * RADIUS)
    paths = []
    for radius in (0.0, RADIUS):
        stations = np.array([record(STATION, 15.0, port, 12.0, radius)]).view(np.recarray)
        formations = np.array([Formation().record()]).view(np.recarray)
        stations_on_path = stations_along(
            points, np.ones(len(points)), heading, stations, formations, 1.0
        )
        paths.append(np.column_stack([stations_on_path.east[:, 0], stations_on_path.north[:, 0]]))
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
        ahead = (np.cos(heading), np.sin(heading))
        planned = plan_detour(target, ahead, 20.0, dt, memory)
        # where the plan is the station's course, the way back to it has begun
        if time < -half + 2.0 or time > half - 2.5:
            continue
        assert (planned.velocity_east, planned.velocity_north) == pytest.approx(ahead)
    end_offset = RADIUS - half
    assert memory.detour == pytest.approx((end_offset, end_offset), abs=0.02 * RADIUS)
    # on course it is left at 0.3 m/s at most, and fades
    for _ in range(round(300.0 / dt)):
        plan_detour(Target(0.0, 0.0, 0.0, 1.0, 0.0, 1.0), (0.0, 1.0), 20.0, dt, memory)
    # as exp(−t / T) with T = lookahead / 0.3 m/s
    assert np.hypot(*memory.detour) == pytest.approx(
        np.sqrt(2.0) * end_offset * np.exp(-4.5), rel=0.2
    )
