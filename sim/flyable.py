"""Whether a scenario whose keys are right can be flown: sea, routes, date, and what all of it would cost."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from laisn.failure import LaisnError
from sim.assembly import ocean_of, route_of, routes_of, setups_of, vehicle_names
from sim.contact import HULL_RADIUS_M
from sim.log.clock import Clock
from sim.scenario.formation import LEAST_APART_M, LEAST_LAYER_M
from sim.scenario.point_motion import Plan, plan
from sim.scenario.settings import CONTROL_STEP_S, Follower, Misfit, Scenario, Vehicle, Video
from sim.scenario.video import CAMERAS

MOST_INSTANTS = 2_000_000
"""Most instants times vehicles: two vehicles for a day. A million takes 1.1 GB of memory and 0.45 GB of log."""
MOST_PHYSICS_STEPS = 200_000_000
"""Most physics steps times vehicles, about an hour on one core."""
MOST_PIXELS = 120_000_000_000
"""Most pixels of a film: 72 minutes at 1280 × 720 and 30 Hz, which is a day and a half at 30 times its pace."""


def frames(duration_s: float, video: Video) -> int:
    """Number of frames of a film of a mission."""
    return max(1, round(duration_s / video.speed_up * video.frame_rate_hz))


def film_misfits(duration_s: float, video: Video) -> list[Misfit]:
    """What keeps a film from being made: no such camera, or too many pixels."""
    found = []
    if video.camera not in CAMERAS:
        text = f"video.camera: unknown camera {video.camera!r}; available: {', '.join(CAMERAS)}"
        found.append(Misfit(("video.camera",), text))
    count = frames(duration_s, video)
    if count * video.width_px * video.height_px > MOST_PIXELS:
        most = MOST_PIXELS // (video.width_px * video.height_px)
        text = (
            f"video: a film of {duration_s:g} s at speed_up = {video.speed_up:g} and {video.frame_rate_hz} Hz has "
            f"{count:.4g} frames, at {video.width_px} × {video.height_px} there may be {most}"
        )
        found.append(Misfit(("video", "duration_s"), text))
    return found


def _cost(scenario: Scenario) -> list[Misfit]:
    """What would take more memory, disk or time than anybody means to spend."""
    vehicles, found = 1 + len(scenario.followers), []
    instants = scenario.duration_s / CONTROL_STEP_S * vehicles
    if instants > MOST_INSTANTS:
        text = (
            f"duration_s: {scenario.duration_s:g} s of {vehicles} vehicles would take {instants * 1.1e-6:.3g} GB of "
            f"memory; so many vehicles may fly {MOST_INSTANTS * CONTROL_STEP_S / vehicles:.0f} s"
        )
        found.append(Misfit(("duration_s", "followers"), text))
    steps = scenario.duration_s / scenario.timing.physics_step_s * vehicles
    if scenario.motion == "physics" and steps > MOST_PHYSICS_STEPS:
        text = (
            f"timing.physics_step_s: {scenario.duration_s:g} s of {vehicles} vehicles in steps of "
            f"{scenario.timing.physics_step_s:g} s are {steps:.4g} steps, there may be {MOST_PHYSICS_STEPS}"
        )
        found.append(Misfit(("duration_s", "followers", "timing.physics_step_s"), text))
    return found


def _tried(build: Callable[[], object], where: str, *keys: str) -> list[Misfit]:
    try:
        build()
    except LaisnError as error:
        text = str(error)
        return [Misfit((where, *keys), text if text.startswith(where) else f"{where}: {text}")]
    return []


def _plan(vehicle: Vehicle, name: str) -> Plan:
    # a saw-tooth that leaves the water is no fault of the route
    return plan(route_of(vehicle.model_copy(update={"saw_tooth_amplitude_m": 0.0}), name))


def _hull_misfits(key: str, model: str | None, role: str) -> list[Misfit]:
    """What a user's own hull lacks."""
    if model is None:
        return []
    # most scenarios have none, and need no MuJoCo to be looked at
    from sim.vehicle.own_hull import faults_of

    return [Misfit((key,), f"{key}: {line}") for line in faults_of(model, role)]


def _outrun(scenario: Scenario) -> list[Misfit]:
    """A leader that swims faster than its followers can."""
    fastest, ocean = scenario.formation.fastest_m_s, scenario.ocean
    depths = [f.layer_m for f in scenario.followers if f.station]
    if not depths:
        return []
    try:
        route = route_of(scenario.leader, "leader")
    except LaisnError:
        return []  # told with its route
    towards = np.deg2rad(ocean.current_direction_deg)
    drift = np.array([np.sin(towards), np.cos(towards)])
    over_ground = np.diff(route.waypoint, axis=0) / np.diff(route.time)[:, None]
    for depth in sorted(set(depths)):
        through = over_ground - (ocean.current_speed_m_s - ocean.current_shear_per_s * depth) * drift
        speed = np.hypot(*through.T)
        leg = int(np.argmax(speed))
        if speed[leg] > fastest:
            text = (
                f"leader: on the way to waypoint {leg + 2} followers at {depth:g} m would need {speed[leg]:.3g} m/s "
                f"through the water, formation.fastest_m_s is {fastest:g} m/s"
            )
            return [Misfit(("leader", "formation.fastest_m_s", "ocean"), text)]
    return []


def _met(scenario: Scenario) -> list[Misfit]:
    """Vehicles that start where another does: followers that join their stations, or all, if contact is the end."""
    joins = [isinstance(vehicle, Follower) and vehicle.start_m is not None for _, vehicle in scenario.vehicles()]
    if scenario.contact == "mark" and not any(joins):
        return []
    try:
        routes = routes_of(scenario)
    except LaisnError:
        return []  # told with its route
    setups, keys = setups_of(scenario, routes), [key for key, _ in scenario.vehicles()]
    found = []
    for i, one in enumerate(setups):
        for j, other in enumerate(setups[:i]):
            x, y, z = np.subtract(one.position_m, other.position_m)
            near = (joins[i] or joins[j]) and np.hypot(x, y) < LEAST_APART_M and abs(z) < LEAST_LAYER_M
            if near or (scenario.contact == "end" and np.hypot(np.hypot(x, y), z) < 2.0 * HULL_RADIUS_M):
                text = (
                    f"{keys[j]} and {keys[i]} start {np.hypot(x, y):.2g} m apart in layers {abs(z):.2g} m apart; at "
                    f"least {LEAST_APART_M:g} m or {LEAST_LAYER_M:g} m are needed"
                )
                found.append(Misfit((keys[j], keys[i]), text))
    return found


def _crowded(scenario: Scenario) -> list[Misfit]:
    """Stations of one layer that meet where the leader turns, of followers that cannot give way."""
    layers = sorted(f.layer_m for f in scenario.followers if f.station)
    alone = all(b - a >= LEAST_LAYER_M for a, b in pairwise(sorted([*layers, scenario.leader.layer_m])))
    if not layers or alone:
        return []
    # following stations takes the plant's libraries, which most scenarios need not wait for
    from sim.station_plan import hardest_crossing, nearest_stations

    near = scenario.formation.proximity
    try:
        crossing = None if near is None else hardest_crossing(scenario, near.range_m)
        found = nearest_stations(scenario) if near is None else crossing and crossing.meeting
    except LaisnError:
        return []  # told with the leader's route
    if found is None or found.apart_m >= LEAST_APART_M:
        return []
    names = ["the leader's place" if i < 0 else f"followers[{i}].station" for i in found.pair]
    text = (
        f"{' and '.join(names)}, in one layer, come within {found.apart_m:.2g} m of each other at {found.time_s:g} s "
        f"of the leader's route"
    )
    elsewhere = f"give them layers {LEAST_LAYER_M:g} m apart, other places"
    if near is None or crossing is None:
        text += f"; at least {LEAST_APART_M:g} m are needed: {elsewhere}, or formation.proximity to give way by"
        return [Misfit(("followers", "formation", "leader"), text)]
    text += f" and close up at {crossing.closing_m_s:.2g} m/s"
    if crossing.way_m_s < crossing.needed_m_s:
        text += f"; to give way takes {crossing.needed_m_s:.2g} m/s through the water, one of them has "
        text += f"{crossing.way_m_s:.2g}: {elsewhere}, or another course in this current"
        return [Misfit(("followers", "formation", "leader", "ocean"), text)]
    if near.range_m < LEAST_APART_M + crossing.braking_m:
        text += f"; to brake in time they have to sense each other {LEAST_APART_M + crossing.braking_m:.2g} m away, "
        text += f"formation.proximity.range_m is {near.range_m:g}: {elsewhere}, or a longer range"
        return [Misfit(("followers", "formation.proximity.range_m", "leader"), text)]
    return []


def misfits(scenario: Scenario) -> list[Misfit]:
    """Everything that keeps a scenario from being flown, filmed and logged, beyond `Scenario.misfits`."""
    found = [
        *_tried(partial(Clock, scenario.epoch), "epoch"),
        *film_misfits(scenario.duration_s, scenario.video),
        *_tried(partial(ocean_of, scenario), "ocean.waves", "ocean.floor_depth_m"),
    ]
    for i, (key, vehicle) in enumerate(scenario.vehicles()):
        found += _hull_misfits(f"{key}.model", vehicle.model, "follower" if i else "leader")
    for (key, vehicle), name in zip(scenario.vehicles(), vehicle_names(scenario), strict=True):
        if isinstance(vehicle, Follower) and vehicle.station:
            continue
        where = f"{key}.{'waypoints' if vehicle.waypoints else 'route'}"
        found += _tried(partial(_plan, vehicle, name), where)
    return [*found, *_outrun(scenario), *_met(scenario), *_crowded(scenario), *_cost(scenario)]
