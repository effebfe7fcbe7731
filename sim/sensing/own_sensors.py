"""What a follower reads of its own sensors at a filter step.

Functions take `s`, the sensors; `k`, a filter step, from 1; and `follower`, an index; the
follower's vehicle is the one after.
"""

from typing import NamedTuple

import numpy as np
from numba import literal_unroll

from laisn.arrays import Floats, Ints
from laisn.compiled import compiled, jitable
from laisn.swarm import READING
from sim.attitude import heel_of
from sim.sensing import noise, sensors
from sim.sensing.noise import Address
from sim.sensing.sensor_model import SensorModel

_INSTRUMENT_STREAMS = tuple(sorted({sensor.stream for sensor in sensors.INSTRUMENTS}))
# compiled code holds numbers, not the members of an enum
_TILT = int(noise.Stream.TILT)
_ROLL_GYRO = int(noise.Stream.ROLL_GYRO)
_HEEL, _ROLLING = ((READING.names or ()).index(name) for name in ("heel", "rolling"))
# pose, twist and water velocity of a vehicle, shapes (7,), (6,) and (3,)
State = tuple[Floats, Floats, Floats]


@jitable
def true_readings(e: sensors.SensorErrors, instant: sensors.Instant, true: Floats) -> None:
    """Write what a follower's own sensors would read without random errors and biases: speed,
    heading, depth, (3,).
    """
    for sensor in literal_unroll(sensors.OWN):
        sensors.write_channels(sensor.true(e, instant, None), sensor.column, true)


@jitable
def read_own(e: sensors.SensorErrors, address: Address, true: Floats, reading: Floats) -> None:
    """Read the own sensors at an address of the noise, by values of `true_readings`; both of
    shape (3,).
    """
    for sensor in literal_unroll(sensors.OWN):
        draws = noise.normals_at(address, sensor.stream)
        sensors.write_channels(sensor.read(e, true[sensor.column :], draws), sensor.column, reading)


class InstrumentNoise(NamedTuple):
    """Normals of the instruments of f followers, drawn for several filter steps at once."""

    # of each stream and follower, as of `noise.draw_ahead`
    normals: Floats
    first: Ints  # the first filter step that they are of, shape (1,); negative: of none


def new_instrument_noise(followers: int) -> InstrumentNoise:
    """Nothing drawn yet."""
    streams = max(_INSTRUMENT_STREAMS) + 1
    return InstrumentNoise(
        normals=np.zeros((streams, followers, 2 * noise.STEPS_AHEAD)),
        first=np.full(1, -noise.STEPS_AHEAD),
    )


@compiled
def _draw_instruments(s: SensorModel, k: int, drawn: InstrumentNoise) -> None:
    """Draw for the instruments of all followers from filter step k on."""
    drawn.first[0] = k
    for stream in _INSTRUMENT_STREAMS:
        for follower in range(drawn.normals.shape[1]):
            address = Address(s.seed, s.run, follower, k)
            noise.draw_ahead(address, stream, drawn.normals[stream, follower])


@compiled
def read_instruments(
    s: SensorModel,
    k: int,
    follower: int,
    state: State,
    depth_sensor: Floats,
    drawn: InstrumentNoise,
    reading: Floats,
) -> None:
    """Read all of a follower's own sensors, but for those of `read_roll`, at filter step k, in the
    order of `laisn.swarm.READING`, with noise that is drawn ahead where that of step k is not yet.
    """
    if not 0 <= k - drawn.first[0] < noise.STEPS_AHEAD:
        _draw_instruments(s, k, drawn)
    i = k - drawn.first[0]
    e = s.errors[follower]
    instant = sensors.instant_of_instruments((k * s.dt, follower), state, depth_sensor)
    for sensor in literal_unroll(sensors.INSTRUMENTS):
        normals = drawn.normals[sensor.stream, follower]
        draws = (normals[i], normals[noise.STEPS_AHEAD + i])
        sensors.write_channels(
            sensor.read(e, sensor.true(e, instant, None), draws), sensor.column, reading
        )


@compiled
def read_roll(s: SensorModel, k: int, follower: int, state: State, reading: Floats) -> None:
    """Read heel and rate of roll of a follower at filter step k, in the order of
    `laisn.swarm.READING`.

    Apart from the other instruments, so that nothing is drawn for it where nobody takes it.
    """
    e = s.errors[follower]
    address = Address(s.seed, s.run, follower, k)
    pose, twist, _ = state
    reading[_HEEL] = sensors.read_heel(e, heel_of(pose[3:]), noise.normals_at(address, _TILT))
    reading[_ROLLING] = sensors.read_rolling(e, twist[3], noise.normals_at(address, _ROLL_GYRO))
