"""Sensors and acoustics of a mission as compiled code takes them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from laisn.arrays import Ints, Records
from sim.scenario.links import LEADER_LINK
from sim.scenario.parts import SensingSettings
from sim.scenario.settings import CONTROL_STEP_S
from sim.sensing import acoustics, noise, sensors
from sim.sensing.links import Link, noise_base


class SensorModel(NamedTuple):
    """Sensors and acoustics of a mission as compiled code takes them."""

    seed: np.uint64
    run: np.uint64
    errors: Records  # of each receiver, of ERRORS, shape (f,)
    # of each receiver in the place of `noise.Address.follower`, shape (f,)
    noise_numbers: Ints
    senses_acceleration: bool  # the leader takes accelerations for tilt
    tilt_gain: float  # `sim.sensing.sensors.complementary_filter_gain` of the leader
    dt: float  # filter step [s]
    stride: int  # instants from one filter step to the next
    message_every: int  # filter steps from one message to the next
    message_offset: int  # filter steps by which all messages are later than multiples of that
    sound: acoustics.Sound
    transmitters: Ints  # how many pings of a message each receiver waits for, shape (f,)
    assumed_sound: Ints  # of each receiver, as of `acoustics.Listener`, shape (f,)


def _sound_of(sensing: SensingSettings, link: Link | None) -> acoustics.Sound:
    """Sound on a link; the clocks of all followers differ from the leader's alike, and so not among
    each other.
    """
    sound = acoustics.sound_of(sensing)
    if link is not None and link.sender > 0:
        return sound._replace(clock_offset=0.0, clock_drift=0.0)
    return sound


def sensor_model_of(
    sensing: SensingSettings,
    link: Link | None = None,
    *,
    leader_receives: bool = False,
    sensing_of: Sequence[SensingSettings] = (),
) -> SensorModel:
    """Sensors and acoustics as compiled code takes them, of the leader's broadcast or another
    link.

    Receivers are the followers, and with `leader_receives` the leader after them. `sensing_of` are
    the settings by the navigation of each follower; none: all navigate as `sensing` has it.
    """
    name = LEADER_LINK if link is None else link.name
    followers = range(len(sensing.of_vehicles) - 1)
    receivers = [sensing_of[i] if sensing_of else sensing for i in followers]
    noise_numbers = [i + noise_base(receivers[i].links, name) for i in followers]
    errors = [sensors.errors_of(sensing, i, link) for i in followers]
    if leader_receives:
        receivers.append(sensing)
        noise_numbers.append(noise.LEADER_NUMBER + noise_base(sensing.links, name))
        errors.append(errors[0])
    transmitters = [receiver.transmitters for receiver in receivers]
    if link is not None:
        transmitters = [min(number, link.transmitters) for number in transmitters]
    assumed_sound = [acoustics.ASSUMED_SOUND.index(receiver.sound_speed) for receiver in receivers]
    return SensorModel(
        seed=np.uint64(sensing.seed),
        run=np.uint64(sensing.run),
        errors=np.array([tuple(e) for e in errors], sensors.ERRORS).view(np.recarray),
        noise_numbers=np.array(noise_numbers, dtype=np.int64),
        senses_acceleration=sensing.broadcast_attitude
        and sensing.sensors.leader_attitude_senses_acceleration,
        tilt_gain=sensors.complementary_filter_gain(sensing.sensors),
        dt=sensing.links.filter_step_s,
        stride=round(sensing.links.filter_step_s / CONTROL_STEP_S),
        message_every=sensing.links.message_every if link is None else link.every,
        message_offset=0 if link is None else link.offset,
        sound=_sound_of(sensing, link),
        transmitters=np.array(transmitters, dtype=np.int64),
        assumed_sound=np.array(assumed_sound, dtype=np.int64),
    )
