"""The eight routes flown by the physics, and how that is measured."""

import mujoco
import numpy as np
import pytest

from sim import attitude
from sim.scenario.point_motion import SHARPEST_CUT, TURN_RATE, plan
from sim.scenario.routes import Route, library_route, names
from sim.simulation import simulate, simulate_points
from sim.tracking import cross_track, track_error
from sim.vehicle.mjcf import VehicleSetup
from sim.vehicle.plant import Plant
from sim.water.ocean import Ocean
from sim.water.waves import Waves
from tests import synthetic
from tools.documents import route_keeping as study
from tools.documents.route_keeping import TrackingReport, arrival_errors, tracking

NAMES = ("leader", "follower")


def setups(routes, **options):
    return [
        VehicleSetup(
            name=name,
            model=name,
            position_m=(*route.waypoint[0].tolist(), -float(route.depth.depth[0])),
            heading_rad=np.pi / 2,
            speed_m_s=route.start_speed,
            **options,
        )
        for name, route in zip(NAMES, routes, strict=True)
    ]


def test_the_study_flies_all_routes_of_the_paper_for_1000_s() -> None:
    """Missions of the paper take 1000 s (Section 3.1)."""
    mission = study.scenario()
    assert mission.duration_s == 1000.0
    assert [follower.route for follower in mission.followers] == [
        f"T{number}" for number in range(2, 10)
    ]


@pytest.mark.parametrize("name", names()[:-1])
def test_leader_and_follower_fly_their_routes(name):
    """They match the README: 0.07 to 0.21 m off the legs, 0.1 s, 1.6° of pitch and 2.7° of roll."""
    routes = (library_route("L"), library_route(name))
    flown = simulate(Plant(setups(routes), Ocean()), routes, 1000.0)
    assert flown.time.size == 10001
    assert flown.position[0, 1, :2].tolist() == routes[1].waypoint[0].tolist()
    for report in tracking(flown, routes):
        assert 0.07 <= round(report.cross_track_rms, 2) <= 0.21
        assert report.arrival_error_max < 0.1 + 1e-9
        assert round(report.speed_error_rms, 3) <= 0.003
        assert report.depth_error_max < 0.15
        assert round(np.rad2deg(report.pitch_max), 1) <= 1.6
        assert round(np.rad2deg(report.roll_max), 1) <= 2.7
    # the physical vehicles stay close to the paper's point motion
    ideal = simulate_points(NAMES, routes, 1000.0)
    assert np.linalg.norm(flown.position - ideal.position, axis=-1).max() < 0.25


def test_routes_are_kept_in_a_current():
    routes = (library_route("L"), library_route("T6"))
    sea = Ocean(current_speed_m_s=0.3, current_direction_rad=1.0)
    flown = simulate(Plant(setups(routes), sea), routes, 1000.0)
    for report in tracking(flown, routes):
        assert report.cross_track_rms < 0.25
        assert report.arrival_error_max < 0.5
    assert flown.water_velocity[..., 0] == pytest.approx(0.3 * np.sin(1.0))
    assert flown.water_velocity[..., 1] == pytest.approx(0.3 * np.cos(1.0))


STOP = Route.timed("stop", [[0, 0, 0], [60, 60, 0], [120, 60, 0], [200, 60, 60]], 8.0)
"""A route with a stop from 60 to 120 s, and a turn on the spot after it."""


@pytest.mark.parametrize(
    ("sea", "max_distance_m"),
    [
        (Ocean(), 0.05),
        (
            Ocean(added_current=np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 0.0], [100.0, 0.2, -0.2]])),
            1.0,
        ),
    ],
)
def test_a_hull_holds_its_place_at_a_stop(sea: Ocean, max_distance_m: float) -> None:
    """To a few centimetres in still water, to a metre in a current that sets in; and goes on in
    time.
    """
    routes = (STOP, library_route("T6"))
    flown = simulate(Plant(setups(routes), sea), routes, 200.0)
    positions_at_stop = flown.position[620:1201, 0, :2]
    assert np.hypot(*(positions_at_stop - [60.0, 0.0]).T).max() < max_distance_m
    if not sea.added_current.size:
        assert np.hypot(*flown.velocity[700:1200, 0, :2].T).max() < 0.01
        assert np.abs(flown.heading[700:1150, 0] - np.pi / 2).max() < 0.01
    assert np.hypot(*(flown.position[-1, 0, :2] - [60.0, 60.0])) < 0.5
    report = tracking(flown, routes)[0]
    assert report.cross_track_rms < 0.6
    assert report.arrival_error_max < 0.5


def test_the_same_flight_gives_the_same_bytes():
    routes = (library_route("L"), library_route("T7"))
    first, second = (simulate(Plant(setups(routes), Ocean()), routes, 50.0) for _ in range(2))
    assert first.position.tobytes() == second.position.tobytes()
    assert first.effector_states.tobytes() == second.effector_states.tobytes()


def test_the_record_is_that_of_the_plant():
    routes = (library_route("L"), library_route("T7"))
    plant = Plant(setups(routes), Ocean())
    flown = simulate(plant, routes, 20.0)
    assert plant.time == pytest.approx(20.0)
    assert np.array_equal(flown.position[-1], plant.pose[:, :3])
    assert np.array_equal(flown.quaternion[-1], plant.pose[:, 3:])
    assert np.array_equal(flown.velocity[-1], plant.twist[:, :3])
    assert np.array_equal(flown.effector_states[-1], plant.effector_states)
    mujoco.mj_kinematics(plant.model, plant.data)
    assert flown.site_position[-1] == pytest.approx(plant.data.site_xpos)
    # velocity is the derivative of position: central differences are off by the third derivative,
    # dt²/6 of it
    slope = (flown.position[2:] - flown.position[:-2]) / 0.2
    assert np.abs(slope - flown.velocity[1:-1]).max() < 0.005


def test_the_error_of_a_mission_falls_with_the_square_of_the_physics_step():
    """The autopilot closes the loop in a rough sea; 5 ms stands for the limit, its own error
    taken into account.
    """
    routes = (library_route("L"), library_route("T6"))
    waves = Waves.regular(height_m=1.0, period_s=5.0, direction_rad=0.7, floor_depth_m=40.0)
    coarse, middle, fine = (
        simulate(Plant(setups(routes), Ocean(waves=waves), dt), routes, 100.0)
        for dt in (0.05, 0.025, 0.005)
    )
    errors = [np.sqrt(np.mean((flown.position - fine.position) ** 2)) for flown in (coarse, middle)]
    assert errors[0] < 0.001
    assert errors[1] == pytest.approx(
        errors[0] * (0.025**2 - 0.005**2) / (0.05**2 - 0.005**2), rel=0.1
    )
    pitch_errors = [np.sqrt(np.mean((flown.pitch - fine.pitch) ** 2)) for flown in (coarse, middle)]
    assert pitch_errors[1] < 0.3 * pitch_errors[0] < np.radians(0.01)


def test_cross_track_is_the_distance_to_the_legs():
    route = Route.timed("corner", [[0, 0, 0], [100, 0, 100], [200, 100, 100]], 5.0)
    time = np.array([50.0, 95.0, 105.0, 150.0])
    position = np.array([[3.0, 50.0], [4.0, 97.0], [10.0, 98.0], [50.0, 101.0]])
    # the second point is due on the first leg (4 m), but nearer to the second one (3 m)
    assert cross_track(route, time, position) == pytest.approx([3.0, 3.0, 2.0, 1.0])


def test_cross_track_counts_legs_that_are_due_soon_or_were_just_now_in_any_order_of_times():
    points = [[0, 0, 0], [100, 0, 100], [200, 100, 100], [300, 100, 40], [400, 30, 40]]
    route = Route.timed("hook", points, 5.0)
    time = np.array([50.0, 350.0, 205.0])
    # the last leg is 10 m from the first place, and the first leg leads through the second one; the
    # third place is still nearest to the second leg
    position = np.array([[30.0, 50.0], [0.0, 50.0], [95.0, 103.0]])
    expected = [30.0, np.hypot(30.0, 10.0), 3.0]
    assert cross_track(route, time, position) == pytest.approx(expected)


def test_track_error_includes_lateral_offset_and_delay():
    route = Route.timed("straight", [[0, 0, 0], [100, 0, 100]], 5.0)
    time = np.array([30.0, 50.0, 70.0])
    position = np.array([[3.0, 30.0], [0.0, 46.0], [-3.0, 74.0]])
    assert track_error(route, time, position) == pytest.approx([3.0, 4.0, 5.0], abs=0.01)
    # and at other times along the same route
    position += [0.0, 10.0]
    time += 10.0
    assert track_error(route, time, position) == pytest.approx([3.0, 4.0, 5.0], abs=0.01)


def test_arrival_is_when_a_waypoint_is_nearest():
    route = Route.timed("line", [[0, 0, 0], [100, 0, 100], [200, 0, 200]], 5.0)
    time = np.arange(0, 250.0, 0.1)
    # 2 s late, 1 m beside
    position = np.column_stack([np.ones_like(time), np.maximum(time - 2.0, 0.0)])
    assert arrival_errors(route, time, position)[1:] == pytest.approx([2.0, 2.0], abs=0.1)
    # a trajectory that ends before the last waypoint has not missed it
    assert arrival_errors(route, time[:1500], position[:1500]).size == 2
    # one that ends when it is due is rated at it
    assert arrival_errors(route, time[:2001], position[:2001])[2] == pytest.approx(0.0, abs=1e-9)
    assert arrival_errors(route, time[:2000], position[:2000]).size == 2


def test_a_report_is_made_of_root_mean_squares_and_extremes() -> None:
    """100 m north at 1 m/s, with known errors at every instant: lateral, speed, depth, pitch and
    roll.
    """
    route = Route.timed("line", [[0, 0, 0], [100, 0, 100]], 5.0)
    flown = simulate_points(("vehicle",), (route,), 120.0)
    errors = np.where(np.arange(flown.time.size) % 2 == 0, 3.0, -1.0)
    position, velocity = flown.position.copy(), flown.velocity.copy()
    position[:, 0, 0] += errors
    position[:, 0, 2] -= 0.1 * errors
    velocity[:, 0, :2] = np.stack([0.6 + 0.06 * errors, 0.8 + 0.08 * errors], axis=-1)
    quaternion = attitude.from_euler(
        np.pi / 2, np.deg2rad(-2.0) * errors, np.deg2rad(4.0) * errors
    )[:, None]
    moved = synthetic.moved(flown, position=position, velocity=velocity, quaternion=quaternion)
    (report,) = tracking(moved, (route,))
    # of 1001 instants until the last waypoint one more has +3 than −1; what comes after does not
    # count
    mean_square, mean = (501 * 9 + 500) / 1001, (501 * 3 - 500) / 1001
    rms, sigma = np.sqrt(mean_square), np.sqrt(mean_square - mean**2)
    late = abs(float(arrival_errors(route, moved.time, moved.position[:, 0, :2])[-1]))
    expected = {
        "cross_track_rms": rms,
        "cross_track_max": 3.0,
        "arrival_error_max": late,
        "speed_error_rms": 0.1 * rms,
        "depth_error_rms": 0.1 * rms,
        "depth_error_max": 0.3,
        "pitch_max": np.deg2rad(6.0),
        "pitch_std": np.deg2rad(2.0) * sigma,
        "roll_max": np.deg2rad(12.0),
        "roll_std": np.deg2rad(4.0) * sigma,
    }
    assert {key: value for key, value in vars(report).items() if key != "name"} == pytest.approx(
        expected, rel=1e-6
    )


@pytest.mark.parametrize("name", names())
def test_point_motion_errs_at_its_corners_alone(name):
    route = library_route(name)
    (report,) = tracking(simulate_points(("vehicle",), (route,), 1000.0), (route,))
    assert report.arrival_error_max < 0.1 + 1e-9
    assert report.speed_error_rms < 1e-9
    assert report.depth_error_max < 1e-9
    assert report.pitch_max < 1e-9
    # the arc through a corner of c leaves the legs by R (1 − cos(c / 2)) at most, the start by its
    # own turn
    motion = plan(route).at(np.arange(0, 1000, 0.1))
    radius = (motion.speed / TURN_RATE)[motion.turn_rate != 0].max(initial=0)
    assert report.cross_track_max < radius * (1 - np.cos(SHARPEST_CUT / 2)) + 0.01


def test_the_record_has_every_vehicle_and_the_extremes_of_all() -> None:
    names, fields = ("leader", "T2", "T3"), TrackingReport.__dataclass_fields__
    reports = [
        TrackingReport(
            **dict.fromkeys(fields, float(k)) | {"name": name, "pitch_max": np.deg2rad(k)}
        )
        for k, name in enumerate(names, start=1)
    ]
    findings = study.findings_of(reports, reports[1])
    assert [findings[f"off-rms {name}"].value for name in (*names, "T8-plan")] == [
        1.0,
        2.0,
        3.0,
        2.0,
    ]
    assert (findings["off-max least"].value, findings["off-max most"].value) == (1.0, 3.0)
    assert findings["pitch-max most"].value == pytest.approx(3.0)
    assert findings["roll-max T2"].value == pytest.approx(np.rad2deg(2.0), rel=1e-5)
