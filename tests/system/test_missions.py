"""Every shipped vehicle in every role of every built-in scenario, loaded and flown as the command
does.

It keeps its route, depth or station within the bounds of `sim.trial`, which the documents state, or
`laisn check` warns of it, or refuses it with advice that works.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import models
from experiments.flight import library
from experiments.flight.fly import fly
from laisn.arrays import Floats
from laisn_sim.cli.main import app
from sim.assembly import route_of
from sim.flight import Flight, Termination
from sim.hull import hull_of, limits_of
from sim.scenario.file import ScenarioError
from sim.scenario.settings import Scenario
from sim.tracking import cross_track, off_station
from sim.trial import OFF_DEPTH_M, OFF_ROUTE_M, OFF_STATION_M, track_deviations, trial
from sim.vehicle.hull_file import from_dimensions

pytestmark = pytest.mark.system

DURATION_S = {"leader": 60.0, "follower": 150.0, "station": 60.0}
"""Long enough for corners of the followers' routes; leaders and stations at corners have tests of
their own.
"""
STATION = {"behind_m": 20.0, "port_m": 5.0, "depth_m": 14.0}
ROLES = ("leader", "follower", "station")


def table_of(name: str, model: str, role: str) -> dict[str, Any]:
    """A built-in scenario with a vehicle in a role; a scenario without such a role gets a follower
    for it.
    """
    table = library.table_of(name) | {"duration_s": DURATION_S[role]}
    leader = dict(table.get("leader", {}))
    followers = [dict(follower) for follower in table["followers"]]
    if role == "leader":
        return table | {"leader": leader | {"model": model}}
    if role == "station" and "station" not in followers[0]:
        followers = [{"station": STATION}]
    if role == "follower" and "station" in followers[0]:
        followers = [{"route": "T5", "depth_m": 12.0}]
    followers = [follower | {"model": model} for follower in followers]
    return table | {"followers": followers}


def fastest_over_ground(ways: Floats, current: Floats, through_water: float) -> Floats:
    """Speeds along unit vectors of shape (n, 2) that have a speed through the water [m/s]."""
    along = ways @ current
    across_squared = current @ current - along**2
    return along + np.sqrt(through_water**2 - across_squared)


def retimed(table: dict[str, Any], model: str) -> dict[str, Any]:
    """The advice followed: legs with as much or as little time as the vehicle needs."""
    scenario = Scenario(**table)
    vehicle = scenario.leader if scenario.leader.model else scenario.followers[0]
    limits = limits_of(hull_of(scenario, vehicle))
    slowest = 0.1
    if limits.least_speed > 0.0:
        slowest = 1.2 * limits.least_speed + scenario.ocean.current_speed_m_s

    def in_time(key: str, of: Any) -> dict[str, Any]:
        route = route_of(of, key)
        current = scenario.ocean.current_at(vehicle.layer_m, 0.0)
        ways = np.diff(route.waypoint, axis=0) / route.leg_length[:, None]
        fastest = fastest_over_ground(ways, current, 0.75 * limits.top_speed)
        assert (slowest < fastest).all()
        speed = np.clip(route.leg_speed, slowest, fastest)
        times = np.concatenate([[0.0], np.cumsum(route.leg_length / speed)])
        points = np.column_stack([times, route.waypoint])
        return {"waypoints": points.tolist()}

    if scenario.leader.model or scenario.followers[0].station:
        return table | {"leader": table.get("leader", {}) | in_time("leader", scenario.leader)}
    followers = [
        given | in_time("follower", follower)
        for given, follower in zip(table["followers"], scenario.followers, strict=True)
    ]
    return table | {"followers": followers}


SITES = {
    "follower": '<site name="hydrophone" pos="0 0 -0.1"/>',
    "station": '<site name="hydrophone" pos="0 0 -0.1"/>',
    "leader": '<site name="tx_rear" pos="-0.7 0 0"/><site name="tx_front" pos="0.7 0 0"/>'
    '<site name="tx_middle" pos="0 0.1 0"/>',
}


def with_sites(table: dict[str, Any], model: str, role: str) -> dict[str, Any]:
    """The advice followed: a hull of the other role with the sites that it lacks."""
    text = models.path(model).read_text("utf-8")
    text = text.replace("</body>", f"{SITES[role]}</body>", 1)
    if role == "leader":
        return table | {"leader": table["leader"] | {"model": text}}
    return table | {"followers": [f | {"model": text} for f in table["followers"]]}


def loaded(table: dict[str, Any], model: str, role: str) -> Scenario:
    """The scenario, or that which follows the advice of the refusal."""
    try:
        return library.as_scenario(table)
    except ScenarioError as error:
        text = str(error)
    if "lacks <site" in text:
        return library.as_scenario(with_sites(table, model, role))
    assert "more time" in text or "less time" in text, text
    return library.as_scenario(retimed(table, model))


def offs(flight: Flight, i: int) -> tuple[float, float, float]:
    """Largest distances of vehicle i from its route, its depth and its station [m]."""
    scenario = flight.scenario
    truth = flight.trajectory
    vehicle = scenario.vehicles()[i][1]
    station = getattr(vehicle, "station", None)
    if station is not None:
        return 0.0, 0.0, float(off_station(scenario, truth)[:, i - 1].max())
    route = route_of(vehicle, "route")
    level = cross_track(route, truth.time, truth.position[:, i, :2])
    depth = np.abs(truth.depth[:, i] - route.depth.depth_at(truth.time))
    return float(level.max()), float(depth.max()), 0.0


def require_kept(flight: Flight, warnings: list[str]) -> None:
    """Each vehicle keeps to what it is to keep, or was warned of."""
    for i, (_, vehicle) in enumerate(flight.scenario.vehicles()):
        if vehicle.model is None:
            continue
        name = flight.trajectory.names[i]
        if any(line.startswith(f"{name}: ") for line in warnings):
            continue
        level, depth, station = offs(flight, i)
        assert level <= OFF_ROUTE_M
        assert depth <= OFF_DEPTH_M
        assert station <= OFF_STATION_M


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("name", library.names())
@pytest.mark.parametrize("model", models.VEHICLES)
def test_a_shipped_vehicle_flies_or_is_refused_with_advice_that_works(
    model: str, name: str, role: str
) -> None:
    scenario = loaded(table_of(name, model, role), model, role)
    warnings = trial(scenario)
    flight, _ = fly(scenario)
    assert flight.outcome is Termination.COMPLETED
    require_kept(flight, warnings)
    # of vehicles that steer by the truth, the trial is the flight
    if role == "leader":
        assert warnings == track_deviations(flight.scenario, flight.trajectory)


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
    _, _, station = offs(flight, 1)
    assert station < OFF_STATION_M


SMALL = [(0.9, 0.12, 7.0), (1.2, 0.15, 15.0), (1.8, 0.2, 40.0), (2.4, 0.25, 80.0)]
"""Length and diameter [m] and mass [kg] of hulls that `laisn hull` writes."""


@pytest.mark.parametrize("size", SMALL)
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
    level, depth, _ = offs(flight, 1)
    warned = "follower: it is up to" in output
    assert warned == (level > OFF_ROUTE_M or depth > OFF_DEPTH_M)
    if level > OFF_ROUTE_M:
        assert f"up to {level:.1f} m off its route" in output


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
    small = "<mass>0.001</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia>"
    parts = "".join(
        f'<link name="{name}"><pose>{pose}</pose><inertial>{small}</inertial></link>'
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
    square = {"xUabsU": 18.18, "yVabsV": 21.66, "zWabsW": 36.99, "kPabsP": 1.55, "mQabsQ": 1.55}
    square["nRabsR"] = 1.55
    values = "".join(f"<{key}>{-value}</{key}>" for key, value in (added | linear | square).items())
    inertia = "<inertia><ixx>0.16</ixx><iyy>0.16</iyy><izz>0.16</izz></inertia>"
    return (
        '<sdf version="1.9"><model name="bluerov2"><link name="base"><inertial>'
        f"<pose>0 0 -0.02 0 0 0</pose><mass>11.5</mass>{inertia}</inertial><collision name='c'>"
        "<geometry><box><size>0.457 0.338 0.0755</size></box></geometry></collision></link>"
        f"{parts}<plugin filename='gz-sim-hydrodynamics-system' "
        "name='gz::sim::systems::Hydrodynamics'><link_name>base</link_name>"
        f"{values}</plugin></model></sdf>"
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
        corner = [[0, 0, 0], [30 / speed, 30, 0], [60 / speed, 30, 30]]
        follower = {"model": model, "waypoints": corner}
        return {"duration_s": float(round(60 / speed)), "followers": [follower]}

    with pytest.raises(ScenarioError, match=r"cannot stabilise heave and pitch") as caught:
        library.as_scenario(mission(0.6))
    speed = float(str(caught.value).split("on legs of up to ")[1].split(" m/s")[0])
    # 9.07 u² of Munk moment against 11.5 kg × 9.81 × 0.02 m of righting, at 1.3 times the legs'
    assert 1.3 * speed == pytest.approx(np.sqrt(11.5 * 9.81 * 0.02 / 9.07), abs=0.03)
    flight, _ = fly(library.as_scenario(mission(speed)))
    level, depth, _ = offs(flight, 1)
    assert level < OFF_ROUTE_M
    assert depth < OFF_DEPTH_M
