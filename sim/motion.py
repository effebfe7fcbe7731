"""Truth of a scenario: how its vehicles move, by the physics or by the paper's point motion."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from sim.assembly import ocean_of, routes_of, setups_of, vehicle_names
from sim.contact import contacts, first_touch
from sim.geometry import attitude
from sim.scenario.point_motion import plan
from sim.scenario.routes import Route
from sim.scenario.settings import CONTROL_STEP_S, Scenario
from sim.simulation import ControllerFactory, EndedError, simulate
from sim.trajectory import Trajectory
from sim.vehicle.plant import Plant


class ContactError(EndedError):
    """Vehicles touched, in a scenario whose missions end with that."""


class Sites(NamedTuple):
    """Points on the hulls, as of `Trajectory.site_names`, `site_vehicle` and `site_offset`."""

    names: tuple[str, ...]
    vehicle: Ints
    offset: Floats


def simulate_points(
    names: tuple[str, ...],
    routes: Sequence[Route],
    duration: float,
    sites: Sites | None = None,
) -> Trajectory:
    """The point motion of a fleet: hulls level and on their courses, still water, no thrust.

    Args:
        duration: [s]; a multiple of 0.1 s.
        sites: on the hulls; None: no sites.

    Raises:
        LaisnError: a route cannot be flown.
    """
    time: Floats = np.arange(round(duration / CONTROL_STEP_S) + 1, dtype=np.float64) * CONTROL_STEP_S
    n, v = time.size, len(routes)
    position, velocity = np.empty((n, v, 3)), np.empty((n, v, 3))
    heading, turn_rate = np.empty((n, v)), np.empty((n, v))
    for i, route in enumerate(routes):
        motion = plan(route).at(time)
        depth, sinking = route.depth.at(time)
        position[:, i] = np.column_stack([motion.east, motion.north, -depth])
        level = motion.speed * np.array([np.sin(motion.course), np.cos(motion.course)])
        velocity[:, i] = np.column_stack([*level, -sinking])
        heading[:, i], turn_rate[:, i] = motion.course, motion.turn_rate
    zero = np.zeros((n, v))
    sites = sites or Sites((), np.zeros(0, np.int64), np.zeros((0, 3)))
    return Trajectory(
        names=names,
        time=time,
        position=position,
        quaternion=attitude.from_euler(heading),
        velocity=velocity,
        angular_velocity=np.stack([zero, zero, -turn_rate], axis=-1),
        water_velocity=np.zeros((n, v, 3)),
        thrust=np.zeros((n, v, 0)),
        effector_force=np.zeros((v, 0, 3)),
        site_names=sites.names,
        site_vehicle=sites.vehicle,
        site_offset=sites.offset,
    )


def listeners(scenario: Scenario) -> list[str]:
    """Keys by which the motion of followers depends on their estimates: stations, or steering by them."""
    followers = list(enumerate(scenario.followers))
    kept = [f"followers.{i}.station" for i, follower in followers if follower.station]
    kept += [f"followers.{i}.controller" for i, follower in followers if follower.controller]
    return kept + [f"followers.{i}.guidance_position = 'estimate'" for i, f in followers if f.guided_by_estimate]


def simulate_motion(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    make_controller: ControllerFactory | None = None,
) -> Trajectory:
    """Simulate a scenario's vehicles.

    Args:
        scenario: `motion` chooses rigid bodies in water, or point motion in still water with the same sites.
        progress: called now and then with the share that is done, 0 … 1.
        make_controller: makes another controller than that of routes; that of `sim.closed_loop` is needed if there are
            `listeners`. None: there is none.

    Raises:
        LaisnError: a route cannot be flown, the sea is impossible, or the controller that is needed is missing.
        DivergedError: the simulation left finite numbers.
        ContactError: vehicles touched, and that ends the scenario's mission.
    """
    keys = listeners(scenario)
    if keys and make_controller is None:
        raise LaisnError(
            f"scenario {scenario.name!r}: {keys[0]}: its path depends on the noise of the run, so that no campaign can "
            "fly it once for all runs; use `laisn fly --run N`"
        )
    routes = routes_of(scenario)
    plant = Plant(setups_of(scenario, routes), ocean_of(scenario), scenario.timing.physics_step_s)
    if scenario.motion == "kinematic":
        sites = Sites(plant.site_names, plant.site_vehicle, plant.site_offset)
        trajectory = simulate_points(vehicle_names(scenario), routes, scenario.duration_s, sites=sites)
    else:
        trajectory = simulate(
            plant,
            routes,
            scenario.duration_s,
            [vehicle.depth_control for vehicle in (scenario.leader, *scenario.followers)],
            make_controller=make_controller,
            # it may stop soon after the first contact
            ending=first_touch if scenario.contact == "end" else None,
            progress=None if progress is None else lambda time: progress(time / scenario.duration_s),
        )
    met = contacts(trajectory) if scenario.contact == "end" else []
    if not met:
        return trajectory
    time, (one, other) = met[0]
    touched = f"at {time:g} s {one} and {other} touched, which ended the mission"
    raise ContactError(touched, trajectory.part(0, max(round(time / trajectory.dt), 1)))
