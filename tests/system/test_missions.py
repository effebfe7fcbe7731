"""Every shipped vehicle in every role of every built-in scenario, loaded and flown as the command
does.

It keeps its route, depth or station within the figures of the documents, or `laisn check` warns of
it, or refuses it with advice that works.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import models
from experiments.flight import library
from experiments.flight.fly import fly
from laisn_sim.cli.main import app
from sim.flight import Termination
from sim.scenario.file import ScenarioError
from sim.scenario.parts import MotionSettings
from sim.tracking import off_station, station_keeping
from sim.trial import OFF_DEPTH_M, OFF_ROUTE_M, OFF_STATION_M, trial
from sim.vehicle.hull_file import from_dimensions
from tools.documents import markers
from tools.documents.vehicle_missions import ROLES, STATION, keeping, largest_deviations

pytestmark = pytest.mark.system

OTHER_MACHINES = 1.05
"""By so much flights of other processors may be farther off than those of the record."""
ROUNDING_M = 0.05


def largest_allowed(model: str, role: str) -> dict[str, float]:
    """Largest distances [m] from route, depth or station: those of the record of these missions,
    where it has been flown, within the bounds that the documents state for all vehicles.
    """
    bounds = {"route": OFF_ROUTE_M, "depth": OFF_DEPTH_M, "station": OFF_STATION_M}
    recorded = markers.records().get("vehicle-missions")
    for quantity in bounds if recorded else ():
        if f"{model} {role} {quantity}" in recorded.findings:
            figure = recorded[f"{model} {role} {quantity}"].number
            bounds[quantity] = min(bounds[quantity], OTHER_MACHINES * figure + ROUNDING_M)
    return bounds


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("name", library.scenario_names())
@pytest.mark.parametrize("model", models.VEHICLES)
def test_a_shipped_vehicle_keeps_to_the_figures_of_the_documents_or_is_warned_of(
    model: str, name: str, role: str
) -> None:
    """Or it is refused, and flown as the refusal advises."""
    result = keeping(model, name, role)
    assert result.outcome is Termination.COMPLETED
    # of vehicles that steer by the truth, the trial is the flight
    if role == "leader":
        assert result.predicted == result.flown
    limits = largest_allowed(model, role)
    assert result.route_m <= limits["route"]
    assert result.depth_m <= limits["depth"]
    assert result.station_m <= limits["station"]


@pytest.mark.parametrize("model", ["leader", "remus100"])
def test_stations_that_slow_turners_cannot_keep_are_named_before_the_flight(model: str) -> None:
    """Thirty REMUS 100 in a grid of four layers, behind a leader that turns by a right angle, as
    sharply as the project's or as they do. None is lost.
    """
    leader = {"model": model, "waypoints": [[0, 0, 0], [60, 60, 0], [210, 60, 150]]}
    shape = {"kind": "grid", "count": 30, "layers": 4, "model": "remus100"}
    table = {"duration_s": 210.0, "leader": leader, "formation": {"shape": shape}}
    scenario = library.as_scenario(table | {"navigation": {"variant": "tight"}})
    warnings = {line.split(":")[0]: line for line in trial(scenario)}
    flight, _ = fly(scenario)
    distances = off_station(MotionSettings.of(flight.scenario), flight.trajectory)
    for i, name in enumerate(flight.trajectory.names[1:]):
        keeping_of_one = station_keeping(distances[:, i], flight.trajectory.time)
        assert not keeping_of_one.lost
        if name in warnings:
            predicted = float(warnings[name].split("it is up to ")[1].split(" m off")[0])
            assert keeping_of_one.station_max_m == pytest.approx(predicted, abs=3.0)
        else:
            # estimates add to what the trial by the truth tells
            assert keeping_of_one.station_max_m < OFF_STATION_M + 1.0
    # a leader that turns as its followers do leaves all on their stations
    warned_followers = warnings.keys() & set(flight.trajectory.names[1:])
    assert bool(warned_followers) == (model == "leader")


def test_a_hull_that_hovers_stays_level_on_its_station() -> None:
    """On stations nothing measures how a hull slips. One that holds its depth by thrust needs its
    rate of depth, or the Munk moment turns it over: the BlueROV at 0.6 m/s, at 0.74 m/s at most.
    """
    leader = {"waypoints": [[0, 0, 0], [300, 180, 0]]}
    follower = {"model": "bluerov2_heavy", "station": STATION}
    flight, _ = fly(
        library.as_scenario({"duration_s": 60.0, "leader": leader, "followers": [follower]})
    )
    assert np.abs(np.rad2deg(flight.trajectory.pitch[:, 1])).max() < 5.0
    _, _, station = largest_deviations(flight, 1)
    assert station < OFF_STATION_M


SMALL_HULLS = [(0.9, 0.12, 7.0), (1.2, 0.15, 15.0), (1.8, 0.2, 40.0), (2.4, 0.25, 80.0)]
"""Length and diameter [m] and mass [kg] of hulls that `laisn hull` writes."""


@pytest.mark.parametrize("size", SMALL_HULLS)
def test_check_says_how_far_a_hull_will_be_off_its_route(
    size: tuple[float, float, float], tmp_path: Path
) -> None:
    """Through the commands: `laisn hull`, `laisn check`, and the flight measured by its legs."""
    (tmp_path / "mine.xml").write_text(from_dimensions(*size).xml())
    file = tmp_path / "mine.toml"
    file.write_text('duration_s = 300\nfollowers = [{ route = "T5", model = "mine.xml" }]\n')
    checked = CliRunner().invoke(app, ["check", str(file)])
    assert checked.exit_code == 0, checked.output
    output = " ".join(checked.output.split())
    flight, _ = fly(library.load_scenario(str(file), (), flyable=True))
    off_route, off_depth, _ = largest_deviations(flight, 1)
    is_warned = "follower: it is up to" in output
    assert is_warned == (off_route > OFF_ROUTE_M or off_depth > OFF_DEPTH_M)
    if off_route > OFF_ROUTE_M:
        assert f"up to {off_route:.1f} m off its route" in output


def bluerov2_sdf() -> str:
    """A BlueROV2 with six thrusters and the coefficients of Wu 2018 (table 5.2) as an SDF model."""
    thrusters = {
        "t1": "0.14 -0.1 0 0 0 0.7853982",
        "t2": "0.14 0.1 0 0 0 -0.7853982",
        "t3": "-0.15 -0.1 0 0 0 -0.7853982",
        "t4": "-0.15 0.1 0 0 0 0.7853982",
        "t5": "0 -0.11 0.07 0 -1.5707963 0",
        "t6": "0 0.11 0.07 0 -1.5707963 0",
    }
    link_inertial = (
        "<mass>0.001</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia>"
    )
    thruster_parts = "".join(
        f'<link name="{name}"><pose>{pose}</pose><inertial>{link_inertial}</inertial></link>'
        f'<joint name="{name}_joint" type="revolute"><parent>base</parent><child>{name}</child>'
        "<axis><xyz>1 0 0</xyz></axis></joint>"
        '<plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">'
        f"<joint_name>{name}_joint</joint_name><max_thrust_cmd>40</max_thrust_cmd>"
        "<min_thrust_cmd>-40</min_thrust_cmd></plugin>"
        for name, pose in thrusters.items()
    )
    added = {"xDotU": 5.5, "yDotV": 12.7, "zDotW": 14.57, "kDotP": 0.12, "mDotQ": 0.12}
    added["nDotR"] = 0.12
    linear = {"xU": 4.03, "yV": 6.22, "zW": 5.18, "kP": 0.07, "mQ": 0.07, "nR": 0.07}
    quadratic = {"xUabsU": 18.18, "yVabsV": 21.66, "zWabsW": 36.99, "kPabsP": 1.55, "mQabsQ": 1.55}
    quadratic["nRabsR"] = 1.55
    coefficients = "".join(
        f"<{key}>{-value}</{key}>" for key, value in (added | linear | quadratic).items()
    )
    inertia = "<inertia><ixx>0.16</ixx><iyy>0.16</iyy><izz>0.16</izz></inertia>"
    return (
        '<sdf version="1.9"><model name="bluerov2"><link name="base"><inertial>'
        f"<pose>0 0 -0.02 0 0 0</pose><mass>11.5</mass>{inertia}</inertial><collision name='c'>"
        "<geometry><box><size>0.457 0.338 0.0755</size></box></geometry></collision></link>"
        f"{thruster_parts}<plugin filename='gz-sim-hydrodynamics-system' "
        "name='gz::sim::systems::Hydrodynamics'><link_name>base</link_name>"
        f"{coefficients}</plugin></model></sdf>"
    )


def test_an_imported_hull_with_large_added_mass_flies(tmp_path: Path) -> None:
    """Its Munk moments are many times what its small inertia is held with: yaw needs a firmer
    autopilot, pitch, which six thrusters do not control, limits its speed.
    """
    (tmp_path / "bluerov2.sdf").write_text(bluerov2_sdf())
    imported = CliRunner().invoke(app, ["hull", "--sdf", str(tmp_path / "bluerov2.sdf")])
    assert imported.exit_code == 0
    (tmp_path / "rov.xml").write_text(imported.stdout)
    model = str(tmp_path / "rov.xml")

    def mission(speed: float) -> dict[str, Any]:
        waypoints = [[0, 0, 0], [30 / speed, 30, 0], [60 / speed, 30, 30]]
        follower = {"model": model, "waypoints": waypoints}
        return {"duration_s": float(round(60 / speed)), "followers": [follower]}

    with pytest.raises(ScenarioError, match=r"cannot stabilise heave and pitch") as caught:
        library.as_scenario(mission(0.6))
    speed = float(str(caught.value).split("on legs of up to ")[1].split(" m/s")[0])
    # 9.07 u² of Munk moment against 11.5 kg × 9.81 × 0.02 m of righting, at 1.3 times the legs'
    assert 1.3 * speed == pytest.approx(np.sqrt(11.5 * 9.81 * 0.02 / 9.07), abs=0.03)
    flight, _ = fly(library.as_scenario(mission(speed)))
    off_route, off_depth, _ = largest_deviations(flight, 1)
    assert off_route < OFF_ROUTE_M
    assert off_depth < OFF_DEPTH_M
