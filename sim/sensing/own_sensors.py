"""Sensors of plugins, which a scenario names as "module:Class" in tables `[[sensors.own]]`."""

from typing import NamedTuple, Protocol

from laisn.arrays import Floats
from laisn.failure import LaisnError
from laisn.plugins import find_class
from sim.scenario.section import in_si
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


def own_sensors(scenario: Scenario) -> tuple[OwnSensor, ...]:
    """A scenario's sensors of the user's own.

    Raises:
        LaisnError: one cannot be found, or does not have a key of its table.
    """
    sensors = []
    for table in scenario.sensors.own:
        made = find_class("sensor", table.sensor)
        try:
            sensors.append(made(**in_si(table.model_extra or {}, getattr(made, "__dataclass_fields__", ()))))
        except TypeError as error:
            raise LaisnError(f"sensors.own: {table.sensor}: {error}") from None
    return tuple(sensors)
