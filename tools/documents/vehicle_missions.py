"""Every shipped vehicle in every role of every built-in scenario: `python -m
tools.documents.studies vehicle-missions`.

Missions are loaded and flown as the commands do. One that is refused is flown as the refusal
advises.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import models
from experiments.flight import library
from experiments.flight.fly import fly
from laisn.arrays import Floats
from reports.findings import RESULTS_FILE, Finding, Findings, plain_finding, record
from sim.flight import FlightRecord, Termination
from sim.hull import hull_of, limits_of
from sim.scenario.file import ScenarioError
from sim.scenario.parts import MotionSettings
from sim.scenario.settings import Scenario
from sim.scenario.vehicle_routes import route_of
from sim.scenario.vehicles import Vehicle
from sim.tracking import cross_track, off_station
from sim.trial import track_deviations, trial

COMMAND = "python -m tools.documents.studies vehicle-missions"
MODULES = ("tools.documents.vehicle_missions",)
ROLES = ("leader", "follower", "station")
DURATION_S = {"leader": 60.0, "follower": 150.0, "station": 60.0}
"""Length of the missions by role: long enough for corners of the followers' routes."""
STATION = {"behind_m": 20.0, "port_m": 5.0, "depth_m": 14.0}
SITES = {
    "follower": '<site name="hydrophone" pos="0 0 -0.1"/>',
    "station": '<site name="hydrophone" pos="0 0 -0.1"/>',
    "leader": '<site name="tx_rear" pos="-0.7 0 0"/><site name="tx_front" pos="0.7 0 0"/>'
    '<site name="tx_middle" pos="0 0.1 0"/>',
}
"""What a hull needs in a role."""


@dataclass(frozen=True, kw_only=True)
class Keeping:
    """How a model's vehicles kept to what they are to keep in a mission, but for those of which the
    trial before the flight warns.
    """

    outcome: Termination
    refused: bool  # at first; flown as advised
    predicted: tuple[str, ...]  # the warnings
    flown: tuple[str, ...]  # what the trial would have said of the flight itself
    route_m: float  # largest distance from a route
    depth_m: float  # … from a depth that is due
    station_m: float  # … from a station


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


def fastest_over_ground(directions: Floats, current: Floats, through_water: float) -> Floats:
    """Speeds over ground along unit vectors of shape (n, 2) in a current of shape (2,) that take a
    speed through the water [m/s].
    """
    following = directions @ current
    across_squared = current @ current - following**2
    return following + np.sqrt(through_water**2 - across_squared)


def retimed(table: dict[str, Any]) -> dict[str, Any]:
    """The advice followed: legs with as much or as little time as the vehicle needs."""
    scenario = Scenario(**table)
    vehicle = scenario.leader if scenario.leader.model else scenario.followers[0]
    limits = limits_of(hull_of(MotionSettings.of(scenario), vehicle))
    # least speed over ground [m/s]: 0.1 where the vehicle can hover, else enough for its fins
    # whatever the direction of the current
    slowest = 0.1
    if limits.least_speed > 0.0:
        slowest = 1.2 * limits.least_speed + scenario.ocean.current_speed_m_s

    def in_time(key: str, timed_vehicle: Vehicle) -> dict[str, Any]:
        route = route_of(timed_vehicle, key)
        current = scenario.ocean.current_at(vehicle.held_depth_m, 0.0)
        directions = np.diff(route.waypoint, axis=0) / route.leg_length[:, None]
        # the rest of the top speed is a reserve for coming back to the route
        fastest = fastest_over_ground(directions, current, 0.75 * limits.top_speed)
        assert (slowest < fastest).all()
        speed = np.clip(route.leg_speed, slowest, fastest)
        times = np.concatenate([[0.0], np.cumsum(route.leg_length / speed)])
        points = np.column_stack([times, route.waypoint])
        return {"waypoints": points.tolist()}

    if scenario.leader.model or scenario.followers[0].station:
        return table | {"leader": table.get("leader", {}) | in_time("leader", scenario.leader)}
    followers = [
        entry | in_time("follower", follower)
        for entry, follower in zip(table["followers"], scenario.followers, strict=True)
    ]
    return table | {"followers": followers}


def with_sites(table: dict[str, Any], model: str, role: str) -> dict[str, Any]:
    """The advice followed: a hull of the other role with the sites that it lacks."""
    text = models.path(model).read_text("utf-8")
    text = text.replace("</body>", f"{SITES[role]}</body>", 1)
    if role == "leader":
        return table | {"leader": table["leader"] | {"model": text}}
    return table | {"followers": [f | {"model": text} for f in table["followers"]]}


def scenario_or_advised(table: dict[str, Any], model: str, role: str) -> tuple[Scenario, bool]:
    """The scenario, or that which follows the advice of the refusal, and whether it was refused."""
    try:
        return library.as_scenario(table), False
    except ScenarioError as error:
        text = str(error)
    if "lacks <site" in text:
        return library.as_scenario(with_sites(table, model, role)), True
    assert "more time" in text or "less time" in text, text
    return library.as_scenario(retimed(table)), True


def largest_deviations(flight: FlightRecord, i: int) -> tuple[float, float, float]:
    """Largest distances of vehicle i from its route, its depth and its station [m]."""
    scenario = flight.scenario
    truth = flight.trajectory
    vehicle = scenario.vehicles()[i][1]
    station = getattr(vehicle, "station", None)
    if station is not None:
        return 0.0, 0.0, float(off_station(MotionSettings.of(scenario), truth)[:, i - 1].max())
    route = route_of(vehicle, "route")
    off_route = cross_track(route, truth.time, truth.position[:, i, :2])
    depth = np.abs(truth.depth[:, i] - route.depth.depth_at(truth.time))
    return float(off_route.max()), float(depth.max()), 0.0


def keeping(model: str, name: str, role: str) -> Keeping:
    """Load and fly a built-in scenario with a vehicle in a role."""
    scenario, refused = scenario_or_advised(table_of(name, model, role), model, role)
    predicted = trial(scenario)
    flight, _ = fly(scenario)
    worst = np.zeros(3)  # route, depth, station [m]
    for i, (_, vehicle) in enumerate(scenario.vehicles()):
        prefix = f"{flight.trajectory.names[i]}: "
        if vehicle.model and not any(line.startswith(prefix) for line in predicted):
            worst = np.maximum(worst, largest_deviations(flight, i))
    return Keeping(
        outcome=flight.outcome,
        refused=refused,
        predicted=tuple(predicted),
        flown=tuple(track_deviations(MotionSettings.of(flight.scenario), flight.trajectory)),
        route_m=float(worst[0]),
        depth_m=float(worst[1]),
        station_m=float(worst[2]),
    )


def _role_findings(model: str, role: str) -> dict[str, Finding]:
    """How a vehicle keeps to what it is to keep in a role of all built-in scenarios."""
    missions = [keeping(model, name, role) for name in library.scenario_names()]
    largest = {
        "route": max(mission.route_m for mission in missions),
        "depth": max(mission.depth_m for mission in missions),
        "station": max(mission.station_m for mission in missions),
    }
    key = f"{model} {role}"
    findings = {
        f"{key} {quantity}": plain_finding(
            value, f"largest distance from its {quantity}, {key}", "m"
        )
        for quantity, value in largest.items()
        if (quantity == "station") == (role == "station")
    }
    return findings | {
        f"{key} warned": plain_finding(
            sum(bool(mission.predicted) for mission in missions), f"missions with a warning, {key}"
        ),
        f"{key} refused": plain_finding(
            sum(mission.refused for mission in missions), f"missions refused at first, {key}"
        ),
        f"{key} completed": plain_finding(
            sum(mission.outcome is Termination.COMPLETED for mission in missions),
            f"missions flown to their end, {key}",
        ),
    }


def findings() -> Findings:
    """Fly all missions."""
    findings = dict[str, Finding]()
    for model in models.VEHICLES:
        for role in ROLES:
            findings |= _role_findings(model, role)
            print(f"  {model} as {role}", flush=True)
    return record("vehicle-missions", COMMAND, MODULES, findings)


def run(folder: Path) -> None:
    """Fly all missions and write the record into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    findings().write(folder / RESULTS_FILE)
