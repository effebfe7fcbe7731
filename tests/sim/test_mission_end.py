"""Missions that end at the floor or off a route: outcome, files and exit code of the command."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import laisn_sim
from laisn.errors import LaisnError
from laisn_sim.cli.errors import MISSION_FAILED
from laisn_sim.cli.main import app
from sim.assembly import routes_of
from sim.flight import Termination
from sim.scenario.file import ScenarioError
from sim.scenario.parts import MissionPlan
from sim.scenario.routes import DepthProfile, Route
from sim.scenario.settings import Scenario
from sim.simulation import simulate_motion
from sim.tracking import LEFT_ROUTE_M, MissionBounds, distance_from_route, first_departure
from sim.water.floors import LevelFloor


def mission(**vehicle: Any) -> dict[str, Any]:
    """A REMUS 100 that goes straight on at 1 m/s."""
    straight = {"model": "remus100", "waypoints": [[0, 0, 0], [300, 300, 0]]}
    return {"duration_s": 300.0, "followers": [straight | vehicle]}


def test_a_hull_heavier_than_it_can_lift_is_refused_with_advice_that_works() -> None:
    """7.9 N are 2.6 % of its weight; without the check it sinks through the floor."""
    with pytest.raises(ScenarioError, match=r"7.9 N heavier.*excess_buoyancy_n = ") as error:
        laisn_sim.load(mission(excess_buoyancy_n=-7.9))
    trim = float(str(error.value).split("excess_buoyancy_n = ")[1].split(",")[0])
    flight = laisn_sim.fly(mission(excess_buoyancy_n=trim))
    assert flight.outcome is Termination.COMPLETED
    assert np.abs(flight.trajectory.depth[:, 1] - 10.0).max() < 2.0


def test_the_weight_and_speed_that_a_refusal_states_keep_a_hull_at_its_depth() -> None:
    """A weight of 4 N is refused, and sinks the hull; with the weight that is stated, or at the
    speed that is advised, it keeps its depth.
    """
    with pytest.raises(ScenarioError, match="4 N heavier") as error:
        laisn_sim.load(mission(excess_buoyancy_n=-4.0))
    message = str(error.value)
    held_weight = float(message.split("thrusters hold ")[1].split(" N")[0])
    speed = float(message.split("or go at ")[1].split(" m/s")[0])
    assert held_weight < 4.0
    sinking = simulate_motion(Scenario(**mission(excess_buoyancy_n=-4.0)))
    assert sinking.depth[-1, 1] - 10.0 > 5.0
    faster = [[0, 0, 0], [300, 300.0 * speed, 0]]
    for vehicle in (
        {"excess_buoyancy_n": -0.97 * held_weight},
        {"excess_buoyancy_n": -4.0, "waypoints": faster},
    ):
        flight = laisn_sim.fly(mission(**vehicle))
        assert np.abs(flight.trajectory.depth[:, 1] - 10.0).max() < 1.0


def test_a_hull_lighter_than_it_can_hold_down_is_refused() -> None:
    with pytest.raises(ScenarioError, match="8 N lighter"):
        laisn_sim.load(mission(excess_buoyancy_n=8.0))


SINKING = (
    "duration_s = 300\nleader.depth_m = 8.0\nocean.floor_depth_m = 11.5\n[[followers]]\n"
    'waypoints = [[0, 0, 0], [300, 300, 0]]\nmodel = "remus100"\n'
    # a tenth of the thrust that its autopilot and the check count on
    "thrust_scale = 0.1\nexcess_buoyancy_n = -2.0\n"
)


def test_a_vehicle_at_the_floor_ends_the_mission(tmp_path: Path) -> None:
    file = tmp_path / "sinks.toml"
    file.write_text(SINKING)
    result = CliRunner().invoke(app, ["fly", str(file), "--no-video", "--out", str(tmp_path / "a")])
    assert result.exit_code == MISSION_FAILED, result.output
    assert Termination.GROUNDED.value in " ".join(result.output.split())
    summary = json.loads((tmp_path / "a" / "summary.json").read_text())
    assert summary["outcome"] == Termination.GROUNDED.value
    assert Termination.GROUNDED.value in (tmp_path / "a" / "report.html").read_text()
    flight = laisn_sim.read_log(tmp_path / "a" / "flight.mcap")
    assert flight.outcome is Termination.GROUNDED
    depth = flight.trajectory.depth[:, 1]
    assert depth[-1] > 11.5 > depth[:-1].max()
    assert summary["flown_s"] == flight.trajectory.time[-1] < 300.0


OFF_ROUTE = (
    "duration_s = 400\nocean.current_speed_m_s = 1.8\nocean.current_direction_deg = 0\n"
    "[[followers]]\nwaypoints = [[0, 0, 0], [400, 200, 0]]\ndepth_m = 10.0\n"
    # a tenth of the thrust that its autopilot counts on
    "thrust_scale = 0.1\n"
)


@pytest.mark.parametrize(
    ("name", "outcome"), [("sinks", Termination.GROUNDED), ("astray", Termination.OFF_ROUTE)]
)
@pytest.mark.parametrize("duration", [0.7, 45.0])
def test_a_stepped_mission_ends_where_it_ends_without_steps(
    tmp_path: Path, name: str, outcome: Termination, duration: float
) -> None:
    file = tmp_path / f"{name}.toml"
    file.write_text({"sinks": SINKING, "astray": OFF_ROUTE}[name])
    without_steps = laisn_sim.fly(file)
    sim = laisn_sim.Simulation(file)
    while not sim.done:
        sim.step(duration)
    assert sim.outcome is without_steps.outcome is outcome
    stepped = sim.flight()
    assert stepped.outcome is outcome
    np.testing.assert_array_equal(stepped.trajectory.pose, without_steps.trajectory.pose)
    with pytest.raises(LaisnError, match=f"the mission has ended at {sim.time:g} s"):
        sim.step()


def test_a_vehicle_that_is_commanded_may_leave_its_route() -> None:
    """Its mission ends at the floor nevertheless."""
    sim = laisn_sim.Simulation("T5", {"duration_s": 400, "ocean.floor_depth_m": 30.0})
    sim.command("leader", laisn_sim.Command(heading=np.pi, speed=1.2, depth=5.0))
    sim.step(150.0)
    assert sim.truth["leader"].position[1] < -LEFT_ROUTE_M
    assert not sim.done
    sim.command("leader", laisn_sim.Command(heading=np.pi, speed=1.2, depth=40.0))
    while not sim.done:
        sim.step(1.0)
    assert sim.outcome is Termination.GROUNDED


def test_a_vehicle_that_loses_its_route_ends_the_mission(tmp_path: Path) -> None:
    file = tmp_path / "astray.toml"
    file.write_text(OFF_ROUTE)
    result = CliRunner().invoke(app, ["fly", str(file), "--no-video", "--out", str(tmp_path / "a")])
    assert result.exit_code == MISSION_FAILED, result.output
    flight = laisn_sim.read_log(tmp_path / "a" / "flight.mcap")
    assert flight.outcome is Termination.OFF_ROUTE
    truth = flight.trajectory
    distance = distance_from_route(
        routes_of(MissionPlan.of(flight.scenario))[1], truth.time, truth.position[:, 1]
    )
    assert distance[-1] > LEFT_ROUTE_M > distance[:-11].max()


def test_a_mission_within_bounds_has_exit_code_zero(tmp_path: Path) -> None:
    arguments = ["fly", "T5", "--set", "duration_s=20", "--no-video", "--out", str(tmp_path / "a")]
    assert CliRunner().invoke(app, arguments).exit_code == 0


def test_distance_from_a_route_is_that_of_geometry() -> None:
    route = Route.timed("l", [[0, 0, 0], [10, 10, 0], [20, 10, 10]], DepthProfile.constant(5.0))
    positions = np.array(
        [[5.0, 3.0, -5.0], [13.0, 4.0, -1.0], [10.0, 90.0, -5.0], [-3.0, -4.0, -5.0]]
    )
    # beside a leg, beside and above, on the extension of the last leg, before the start
    assert distance_from_route(route, np.full(4, 3.0), positions) == pytest.approx([3, 5, 0, 5])


def test_the_first_departure_is_the_earliest_of_all_vehicles() -> None:
    route = Route.timed("l", [[0, 0, 0], [10, 10, 0]], DepthProfile.constant(5.0))
    time = np.arange(0.0, 10.0, 0.1)
    pose = np.zeros((100, 2, 7))
    pose[..., 2] = -5.0
    bounds = MissionBounds(LevelFloor(20.0), (route, None))
    assert first_departure(time, pose, bounds) is None
    pose[50:, 1, 2] = -20.01
    departure = first_departure(time, pose, bounds)
    assert departure is not None
    assert (departure.instant, departure.vehicle, departure.off_route_m) == (50, 1, None)
    pose[21:, 0, 1] = 101.0
    departure = first_departure(time, pose, bounds)
    assert departure is not None
    # distances from routes are checked each second
    assert (departure.instant, departure.vehicle, departure.off_route_m) == (30, 0, 101.0)
