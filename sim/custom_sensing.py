"""Further sensors of a vehicle, read one filter step after the other."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from laisn.arrays import Floats
from laisn.messages import SensorHeader
from sim.attitude import body_point_in_world
from sim.link_receiver import Hearing
from sim.sensing import reception, sensor_model
from sim.sensing.acoustics import Motion, site_at
from sim.sensing.sensor import SensorDriver, VehicleState
from sim.simulation import TICK
from sim.trajectory import StateHistory
from sim.water.environment import Environment


@dataclass(frozen=True, kw_only=True)
class Carrier:
    """A vehicle that carries sensors."""

    vehicle: int  # its index
    receiver: int  # its number among the receivers of a link
    noise_number: int  # which random numbers are its own, as of `sim.sensing.noise`
    hydrophone: Floats  # its place in the hull, shape (3,), [m]
    depth_sensor: Floats  # its place in the hull, shape (3,), [m]


def _sources(hearing: Hearing | None, receiver: int, k: int) -> Floats:
    """Places of the transmitters when they sent the pings of the message that came in at a receiver
    at instant k, shape (1, 3, 3): one instant, three transmitters, east, north and up [m]; NaN if
    none came in.
    """
    source = np.full((1, 3, 3), np.nan)
    if hearing is None or hearing.inbox.outcome[receiver] != reception.RECEIVED:
        return source
    sensors = hearing.sensors
    sent_s = hearing.inbox.last_sent[receiver] * sensors.dt
    departures_s = sent_s + sensors.sound.slot * np.arange(3)
    motion = Motion(hearing.motion, 0.0, k)
    for i, (site, time) in enumerate(zip(hearing.sites.transmitters, departures_s, strict=True)):
        source[0, i] = site_at(sensors.sound.on_grid, motion, 0, site, time)
    return source


class CustomSensing:
    """Further sensors of one vehicle, and what they have read."""

    def __init__(
        self,
        drivers: Sequence[SensorDriver],
        carrier: Carrier,
        environment: Environment,
        model: sensor_model.SensorModel,
    ) -> None:
        """Nothing is read yet; `model` gives the seed, the run and the filter step."""
        self._drivers = drivers
        self._carrier = carrier
        self._environment = environment
        self._seed_and_run = (int(model.seed), int(model.run))
        self._stride = model.stride
        # readings of all filter steps so far by sensor, each of shape (c,)
        self._rows: dict[str, list[Floats]] = {driver.name: [] for driver in drivers}

    def __bool__(self) -> bool:
        return bool(self._drivers)

    @property
    def headers(self) -> dict[str, SensorHeader]:
        """Channels and rates by the names of sensors."""
        return {driver.name: driver.header for driver in self._drivers}

    def _state(self, k: int, truth: StateHistory, hearing: Hearing | None) -> VehicleState:
        """True state at instant k, with the sources of a message that is in."""
        carrier = self._carrier
        instant = slice(k, k + 1)
        v = carrier.vehicle
        motion = (truth.pose[instant, v], truth.twist[instant, v], truth.water[instant, v])
        hydrophone = np.array([body_point_in_world(motion[0][0], carrier.hydrophone)])
        places = (hydrophone, _sources(hearing, carrier.receiver, k))
        time = np.array([k * TICK])
        # vehicle 0 is the leader, which counts as follower 0 here
        follower = max(v - 1, 0)
        return VehicleState.of_motion(time, motion, carrier.depth_sensor, places, follower)

    def read(self, k: int, truth: StateHistory, hearing: Hearing | None) -> dict[str, Floats]:
        """Read and record at instant k, a filter step; `hearing` is of the link that the vehicle
        navigates on, None: of none.
        """
        if not self._drivers:
            return {}
        carrier = self._carrier
        step = k // self._stride
        state = self._state(k, truth, hearing)
        is_heard = hearing is not None and (
            hearing.inbox.outcome[carrier.receiver] == reception.RECEIVED
        )
        readings = {}
        for driver in self._drivers:
            true = driver.true(state, self._environment, step)
            draws = driver.draws(*self._seed_and_run, carrier.noise_number, np.array([step]))
            reading: Floats = driver.read(true, draws, step)[0]
            if driver.acoustic and not is_heard:
                reading[:] = np.nan
            readings[driver.name] = reading
            self._rows[driver.name].append(reading)
        return readings

    def readings_at(self, step: int) -> dict[str, Floats]:
        """Readings at a filter step, counted from 1, or the last one before, by the names of
        sensors; IndexError if nothing was read yet.
        """
        return {name: rows[min(step, len(rows)) - 1] for name, rows in self._rows.items()}

    def readings(self, steps: range) -> dict[str, Floats]:
        """Readings of filter steps `steps.start` + 1 to `steps.stop` (the first step is 1), by
        name, shape (n, c).
        """
        return {name: np.array(rows[steps.start : steps.stop]) for name, rows in self._rows.items()}
