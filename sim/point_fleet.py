"""The paper's point motion of a whole fleet as a Trajectory, beside `sim.simulation`, which flies rigid hulls."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Floats, Ints
from laisn.failure import LaisnError
from sim.geometry import attitude
from sim.scenario.point_motion import Limits, plan
from sim.scenario.routes import Route
from sim.trajectory import Trajectory


class Sites(NamedTuple):
    """Points on the hulls."""

    names: tuple[str, ...]
    """"vehicle/site", shape (s,)."""
    vehicle: Ints
    """Index of the vehicle that carries the site, shape (s,)."""
    offset: Floats
    """Sites in the vehicle's body frame, shape (s, 3), [m]."""


def simulate_points(
    names: tuple[str, ...],
    routes: Sequence[Route],
    duration: float,
    dt: float = 0.1,
    limits: Limits | None = None,
    *,
    sites: Sites | None = None,
) -> Trajectory:
    """The point motion of a fleet: hulls level and on their courses, still water, no thrust.

    Args:
        names: of the vehicles, the leader first.
        routes: one for each vehicle.
        duration: [s]; a multiple of `dt`.
        dt: time grid [s].
        limits: of all vehicles.
        sites: on the hulls; None: no sites.

    Raises:
        LaisnError: a route cannot be flown, or there is not one for each vehicle.
    """
    if len(names) != len(routes):
        raise LaisnError(f"{len(names)} vehicles need as many routes, got {len(routes)}")
    time: Floats = np.arange(round(duration / dt) + 1, dtype=np.float64) * dt
    n, v = time.size, len(routes)
    position, velocity = np.empty((n, v, 3)), np.empty((n, v, 3))
    heading, turn_rate = np.empty((n, v)), np.empty((n, v))
    for i, route in enumerate(routes):
        motion = plan(route, limits).at(time)
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
