"""Doppler velocity log of a follower, with bottom lock."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import ClassVar

import numpy as np

from laisn.arrays import Floats
from sim.sensing.noise import Stream
from sim.sensing.sensor import Sensor, VehicleState
from sim.water.environment import Environment

_STANDARD_NORMAL = NormalDist()


@dataclass(frozen=True, kw_only=True)
class Dvl(Sensor):
    """Doppler velocity log: velocity over the ground along the hull's axes, and altitude; nothing
    without bottom lock.
    """

    name = "dvl"
    channels: ClassVar = {"forward": "m/s", "port": "m/s", "up": "m/s", "altitude": "m"}
    stream = Stream.DVL
    normals = 5

    period: float = 0.2  # from one reading to the next [s]
    velocity_sigma: float = 0.01  # of each axis [m/s]
    altitude_sigma: float = 0.05  # [m]
    lock: float = 40.0  # altitude up to which it locks on the bottom [m]
    dropout: float = 0.0  # share of readings without bottom lock

    def true(self, state: VehicleState, environment: Environment) -> Floats:
        """Velocity and altitude; NaN too far above the floor."""
        east, north, up = state.position
        altitude = environment.floor_depth(east, north) + up
        if altitude > self.lock:
            return np.full(4, np.nan)
        return np.array([*state.in_hull(state.velocity), altitude])

    def read(self, true: Floats, draws: Floats) -> Floats:
        """The same with errors, or nothing in a dropout."""
        if _STANDARD_NORMAL.cdf(draws[4]) < self.dropout:
            return np.full(4, np.nan)
        sigma = np.array([*[self.velocity_sigma] * 3, self.altitude_sigma])
        return np.asarray(true + sigma * draws[:4])
