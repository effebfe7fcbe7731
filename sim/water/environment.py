"""The sea as vehicles, sensors and sound meet it.

Velocity of the water at place x and time t: the current there, and waves that ride on it. The parts
of an `Environment` are of any class with the methods of their kind (`sim.water.currents`, `floors`,
`densities`, `rays`); compiled code chooses these by type.
"""

from typing import Any, NamedTuple

from laisn.arrays import Floats
from laisn.compiled import compiled, inlined
from sim.attitude import Vector
from sim.water.rays import Ray
from sim.water.waves import Flow


class Environment(NamedTuple):
    """Current, waves, floor, density and sound of a sea."""

    current: Any  # as `sim.water.currents.ShearedCurrent`
    waves: Any  # as `sim.water.waves.WaveTrain`
    floor: Any  # as `sim.water.floors.LevelFloor`
    rays: Any  # as `sim.water.rays.StraightRays`
    density_model: Any  # as `sim.water.densities.UniformDensity`

    def flow(self, position: Vector, time: float) -> Vector:
        """Velocity of the water at a place [m] and time [s], in the world [m/s]."""
        return velocity_of_water(sea_at(self, time), position)

    def arrivals(self, source: Vector, receiver: Vector) -> tuple[Ray, Ray, Ray]:
        """How sound gets from one place to another [m] that rest: directly, by the surface and by
        the floor.
        """
        return (
            self.rays.ray(0, source, receiver),
            self.rays.ray(1, source, receiver),
            self.rays.ray(2, source, receiver),
        )

    def floor_depth(self, east: float, north: float) -> float:
        """Depth of the floor below a place [m]."""
        return float(self.floor.depth_at(east, north))

    def density(self, depth: float) -> float:
        """Density of the water at a depth [kg/m³]."""
        return float(self.density_model.density_at(depth))


class SeaInstant(NamedTuple):
    """Current, waves and density at one time."""

    time: float  # [s]
    current: Any  # as `sim.water.currents.ShearedInstant`
    waves: Any  # as `sim.water.waves.WaveTrain`
    density_model: Any  # as `sim.water.densities.UniformDensity`


@compiled
def sea_at(environment: Environment, time: float) -> SeaInstant:
    """Current, waves and density of an environment at a time [s]: the first argument of `flow`
    and `elevation_at`.
    """
    current = environment.current.at_time(time)
    return SeaInstant(time, current, environment.waves, environment.density_model)


@compiled
def elevation_at(sea: SeaInstant, x: float, y: float) -> float:
    """Height of the surface above z = 0 at one place [m]."""
    return float(sea.waves.elevation_at(x, y, sea.time, sea.current.drift))


@inlined
def flow(sea: SeaInstant, position: Vector, velocity: Vector, axis: Vector) -> Flow:
    """The water at a place [m] for a point that moves with a velocity [m/s], all in the world;
    `axis` is the unit vector of a hull.
    """
    drift = sea.current.drift
    # waves, and what else is not the same everywhere, are carried along
    drifted_position = (
        position[0] - drift.displacement[0],
        position[1] - drift.displacement[1],
        position[2],
    )
    relative = velocity[0] - drift.velocity[0], velocity[1] - drift.velocity[1], velocity[2]
    current = sea.current.flow(drifted_position, relative)
    water = sea.waves.flow_over(current, drifted_position, relative, axis, sea.time)
    u = water.velocity
    rate = water.rate
    return Flow(
        (u[0] + drift.velocity[0], u[1] + drift.velocity[1], u[2]),
        (rate[0] + drift.acceleration[0], rate[1] + drift.acceleration[1], rate[2]),
        water.gradient,
        water.axis_gradient_rate,
        water.axis_acceleration_gradient,
    )


@inlined
def velocity_of_water(sea: SeaInstant, position: Vector) -> Vector:
    """The velocity of `flow` alone."""
    drift = sea.current.drift
    drifted_position = (
        position[0] - drift.displacement[0],
        position[1] - drift.displacement[1],
        position[2],
    )
    at_rest = (0.0, 0.0, 0.0)
    current = sea.current.flow(drifted_position, at_rest)
    u = sea.waves.velocity_over(current.velocity, drifted_position, sea.time)
    return u[0] + drift.velocity[0], u[1] + drift.velocity[1], u[2]


@compiled
def water_velocity(environment: Environment, position: Floats, time: float, out: Floats) -> None:
    """Write the velocity of the water at places, shape (n, 3), [m], and one time [s] to `out`,
    shape (n, 3), [m/s].
    """
    sea = sea_at(environment, time)
    for i in range(position.shape[0]):
        point = position[i, 0], position[i, 1], position[i, 2]
        u = velocity_of_water(sea, point)
        out[i, 0] = u[0]
        out[i, 1] = u[1]
        out[i, 2] = u[2]


@compiled
def velocities_at(environment: Environment, position: Floats, time: Floats, out: Floats) -> None:
    """Write the velocity of the water at places, shape (n, 3), [m], and times, (n,), [s], to `out`,
    shape (n, 3), [m/s].
    """
    for i in range(position.shape[0]):
        water_velocity(environment, position[i : i + 1], time[i], out[i : i + 1])
