"""Further sensors of a follower, by tables `[[sensors.own]]` of a scenario: shipped ones and classes of plugins."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.messages import BEARING
from laisn.navigators import NAVIGATORS
from laisn.plugins import find_class
from sim.geometry.attitude import rotate
from sim.scenario.section import in_si
from sim.scenario.sensors import OwnSensor as OwnSensorTable
from sim.scenario.settings import Scenario


class FollowerState(NamedTuple):
    """True state of a follower at filter steps k = 1 … n."""

    time: Floats
    """Shape (n,), [s]."""
    position: Floats
    """Of the body origin in the world, shape (n, 3), [m]."""
    quaternion: Floats
    """Attitude from body to world, (w, x, y, z), shape (n, 4)."""
    velocity: Floats
    """In the world, shape (n, 3), [m/s]."""
    angular_velocity: Floats
    """In the body frame, shape (n, 3), [rad/s]."""
    water_velocity: Floats
    """In the world, shape (n, 3), [m/s]."""
    hydrophone: Floats
    """In the world, shape (n, 3), [m]."""
    source: Floats
    """Where the pings left that are received at a step, from the rear, front and middle transmitter, in the world,
    shape (n, 3, 3), [m]; NaN where none is received."""


class OwnSensor(Protocol):
    """A sensor: a frozen dataclass whose fields are its parameters, keys of its table, in SI units and radians."""

    @property
    def name(self) -> str:
        """Of its readings in `Measurements.own`."""

    @property
    def stream(self) -> int:
        """Number of its noise, 16 … 63, for no other sensor."""

    @property
    def acoustic(self) -> bool:
        """Whether it reads pings, and nothing where all pings of a message are lost."""

    def true(self, state: FollowerState) -> Floats:
        """What it would read without errors, shape (n, c); NaN where it reads nothing."""

    def read(self, true: Floats, normals: Floats) -> Floats:
        """Its readings, shape (n, c), of true values and two standard normals a step, shape (n, 2)."""


@dataclass(frozen=True, kw_only=True)
class InvertedUsbl:
    """Inverted USBL of a follower: azimuth, positive to starboard, and elevation of the
    leader's front transmitter in its own hull [rad]."""

    name = BEARING
    stream = 15
    acoustic = True

    azimuth_sigma: float = float(np.deg2rad(1.0))
    azimuth_bias: float = 0.0
    """As of a head that is mounted askew."""
    elevation_sigma: float = float(np.deg2rad(1.0))

    def true(self, state: FollowerState) -> Floats:
        """Directions without errors, shape (n, 2)."""
        to_hull = state.quaternion * np.array([1.0, -1.0, -1.0, -1.0])
        forward, port, up = rotate(to_hull, state.source[:, 1] - state.hydrophone).T
        return np.column_stack([np.arctan2(-port, forward), np.arctan2(up, np.hypot(forward, port))])

    def read(self, true: Floats, normals: Floats) -> Floats:
        """Readings of true directions."""
        error = normals * (self.azimuth_sigma, self.elevation_sigma) + (self.azimuth_bias, 0.0)
        return np.asarray(true + error)


SHIPPED: Mapping[str, type[Any]] = {"inverted-usbl": InvertedUsbl}
"""Sensors of this project by the names that scenarios accept; all are off by default."""


def own_tables(scenario: Scenario) -> tuple[Any, ...]:
    """Tables of a scenario's further sensors: its own, after the one that its navigator needs."""
    variant, given = scenario.navigation.variant, scenario.sensors.own
    needed = NAVIGATORS[variant].sensor if variant in NAVIGATORS else ""
    there = not needed or any(table.sensor == needed for table in given)
    return given if there else (OwnSensorTable(sensor=needed), *given)


def own_sensors(scenario: Scenario) -> tuple[OwnSensor, ...]:
    """A scenario's further sensors.

    Raises:
        LaisnError: one cannot be found, or does not have a key of its table.
    """
    sensors = []
    for table in own_tables(scenario):
        made = SHIPPED.get(table.sensor) or find_class("sensor", table.sensor)
        try:
            sensors.append(made(**in_si(table.model_extra or {}, getattr(made, "__dataclass_fields__", ()))))
        except TypeError as error:
            raise LaisnError(f"sensors.own: {table.sensor}: {error}") from None
    return tuple(sensors)
